//! Repeating patterns: the shifts that carry a face onto itself fill its gaps.

use glam::IVec2;

/// Longest side at which shifts are searched, texels.
const SEARCH_PX: usize = 72;
/// Shortest shift as a share of the face's shorter side.
const SHORTEST: f64 = 0.1;
/// Share of the known texels that must meet known texels under a shift.
const OVERLAP: f64 = 0.3;
/// Mean squared difference under a shift, relative to that of unrelated texels (twice the variance).
const ALIKE: f64 = 0.12;
/// Most shifts that are used.
const SHIFTS: usize = 4;
/// Rounds of continuation.
const ROUNDS: usize = 16;
/// Widest border, as a share of the face's shorter side.
const WIDEST_BORDER: f64 = 0.2;
/// Thinnest border, texels.
const THINNEST_BORDER: usize = 3;
/// Share of a line along the edge that must be seen.
const SEEN_OF_LINE: f64 = 0.2;
/// Largest standard deviation along a line of a border, relative to the face's.
const UNIFORM: f64 = 0.5;
/// Half width of the refinement at full size, in steps of the search.
const REFINE: i32 = 1;

/// Colours of a face, row-major, `None` where unknown.
pub(super) struct Picture {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<Option<[f32; 3]>>,
}

impl Picture {
    fn get(&self, p: IVec2) -> Option<[f32; 3]> {
        let inside = p.x >= 0 && p.y >= 0 && (p.x as usize) < self.width && (p.y as usize) < self.height;
        inside.then(|| self.pixels[p.y as usize * self.width + p.x as usize]).flatten()
    }

    fn known(&self) -> usize {
        self.pixels.iter().flatten().count()
    }

    /// Means of blocks of `k x k`, unknown when less than half of a block is known.
    fn shrunk(&self, k: usize) -> Self {
        let (width, height) = (self.width.div_ceil(k), self.height.div_ceil(k));
        let block = |i: usize| {
            let (mut sum, mut n) = ([0.0; 3], 0);
            for y in i / width * k..(i / width * k + k).min(self.height) {
                for x in i % width * k..(i % width * k + k).min(self.width) {
                    if let Some(c) = self.pixels[y * self.width + x] {
                        sum = [sum[0] + c[0], sum[1] + c[1], sum[2] + c[2]];
                        n += 1;
                    }
                }
            }
            (2 * n >= k * k).then(|| sum.map(|s| s / n as f32))
        };
        Self { width, height, pixels: (0..width * height).map(block).collect() }
    }

    /// Mean squared difference of known texels that meet under a shift, and how many do.
    fn difference(&self, shift: IVec2, stride: usize) -> (f64, usize) {
        let (mut sum, mut n) = (0.0, 0);
        for y in (0..self.height).step_by(stride) {
            for x in (0..self.width).step_by(stride) {
                let here = self.pixels[y * self.width + x];
                let Some((a, b)) = here.zip(self.get(IVec2::new(x as i32, y as i32) + shift)) else { continue };
                sum += (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>() / 3.0;
                n += 1;
            }
        }
        (sum / n.max(1) as f64, n)
    }

    /// Twice the variance: what unrelated texels differ by.
    fn unrelated(&self) -> f64 {
        let n = self.known().max(1) as f64;
        (0..3)
            .map(|k| {
                let values = || self.pixels.iter().flatten().map(|c| f64::from(c[k]));
                let mean = values().sum::<f64>() / n;
                2.0 * values().map(|v| (v - mean).powi(2)).sum::<f64>() / n / 3.0
            })
            .sum::<f64>()
            .max(1e-9)
    }

    /// The shifts under which the picture looks most like itself, best first.
    fn shifts(&self) -> Vec<IVec2> {
        let k = self.width.max(self.height).div_ceil(SEARCH_PX).max(1);
        let small = self.shrunk(k);
        let (w, h) = (small.width as i32, small.height as i32);
        let least = (SHORTEST * f64::from(w.min(h))).max(2.0);
        let enough = OVERLAP * small.known() as f64;
        let unrelated = small.unrelated();
        let mut found: Vec<(f64, IVec2)> = Vec::new();
        for dy in 0..h * 3 / 4 {
            for dx in -w * 3 / 4..w * 3 / 4 {
                let shift = IVec2::new(dx, dy);
                if f64::from(shift.length_squared()).sqrt() < least || (dy == 0 && dx < 0) {
                    continue;
                }
                let (difference, n) = small.difference(shift, 1);
                if n as f64 >= enough && difference < ALIKE * unrelated {
                    found.push((difference, shift));
                }
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut out: Vec<IVec2> = Vec::new();
        for (_, shift) in found {
            let apart = |other: &IVec2| f64::from((*other - shift).length_squared()).sqrt() >= least;
            if out.iter().all(apart) {
                out.push(shift);
            }
            if out.len() == SHIFTS {
                break;
            }
        }
        out.into_iter().map(|s| self.refined(s * k as i32, k as i32)).collect()
    }

    fn refined(&self, shift: IVec2, step: i32) -> IVec2 {
        let reach = REFINE * step;
        let stride = (self.width.max(self.height) / 150).max(1);
        let near = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| shift + IVec2::new(x, y)));
        let score = |s: &IVec2| self.difference(*s, stride).0;
        near.min_by(|a, b| score(a).total_cmp(&score(b))).unwrap_or(shift)
    }

    /// Continues border and lattice; returns whether a lattice was found.
    pub fn complete(&mut self) -> bool {
        let Some(border) = Border::find(self) else { return self.continue_pattern() };
        let [left, top, right, bottom] = border.widths;
        let (w, h) = (self.width, self.height);
        let (iw, ih) = (w - left - right, h - top - bottom);
        let at = |x: usize, y: usize| (y + top) * w + x + left;
        let pixels = (0..iw * ih).map(|i| self.pixels[at(i % iw, i / iw)]).collect();
        let mut inside = Self { width: iw, height: ih, pixels };
        let repeats = inside.continue_pattern();
        for (i, color) in inside.pixels.into_iter().enumerate() {
            self.pixels[at(i % iw, i / iw)] = color;
        }
        for (i, pixel) in self.pixels.iter_mut().enumerate() {
            if pixel.is_none() {
                *pixel = border.color([i % w, i / w], [w, h]);
            }
        }
        repeats
    }

    /// Fills unknown texels from known ones one shift away, again and again; what no shift reaches stays unknown. Returns
    /// whether there are such shifts.
    fn continue_pattern(&mut self) -> bool {
        let shifts = self.shifts();
        for _ in 0..ROUNDS {
            let mut filled = Vec::new();
            for i in 0..self.pixels.len() {
                if self.pixels[i].is_some() {
                    continue;
                }
                let p = IVec2::new((i % self.width) as i32, (i / self.width) as i32);
                let color = shifts.iter().find_map(|s| self.get(p + *s).or_else(|| self.get(p - *s)));
                filled.extend(color.map(|c| (i, c)));
            }
            if filled.is_empty() {
                break;
            }
            for (i, color) in filled {
                self.pixels[i] = Some(color);
            }
        }
        !shifts.is_empty()
    }
}

/// A border of stripes around a face, as rugs have.
#[derive(Debug)]
struct Border {
    /// Left, top, right, bottom, texels.
    widths: [usize; 4],
    /// Colours from the edge inwards.
    profile: Vec<[f32; 3]>,
}

impl Border {
    /// From the sides that are seen: the lines along the edge of which each has one colour, unlike the face as a whole.
    fn find(picture: &Picture) -> Option<Self> {
        let (w, h) = (picture.width, picture.height);
        let widest = (w.min(h) as f64 * WIDEST_BORDER) as usize;
        let spread = (picture.unrelated() / 2.0).sqrt();
        let line = |side: usize, t: usize| -> Vec<[f32; 3]> {
            let along = if side.is_multiple_of(2) { h } else { w };
            let at = |k: usize| match side {
                0 => k * w + t,
                1 => t * w + k,
                2 => k * w + w - 1 - t,
                _ => (h - 1 - t) * w + k,
            };
            // The corners belong to two sides.
            (widest..along.saturating_sub(widest)).filter_map(|k| picture.pixels[at(k)]).collect()
        };
        let mut found: [Option<Vec<[f32; 3]>>; 4] = Default::default();
        for (side, found) in found.iter_mut().enumerate() {
            let along = if side.is_multiple_of(2) { h } else { w }.saturating_sub(2 * widest);
            let mut profile = Vec::new();
            let mut started = false;
            for t in 0..widest {
                let colors = line(side, t);
                let seen = colors.len() as f64 >= SEEN_OF_LINE * along as f64 && colors.len() > 8;
                if !seen && !started {
                    // The outermost texels are rarely seen well.
                    profile.push(None);
                    continue;
                }
                if !seen {
                    break;
                }
                let (mean, deviation) = statistics(&colors);
                if deviation > UNIFORM * spread {
                    // The first lines may show what is beside the face.
                    if started || t > widest / 4 {
                        break;
                    }
                    profile.push(None);
                    continue;
                }
                started = true;
                profile.push(Some(mean));
            }
            if started && profile.iter().flatten().count() >= THINNEST_BORDER {
                let first = profile.iter().flatten().next().copied()?;
                *found = Some(profile.into_iter().map(|c| c.unwrap_or(first)).collect());
            } else if (0..widest / 2).any(|t| line(side, t).len() as f64 >= SEEN_OF_LINE * along as f64) {
                // Seen, and without a border.
                *found = Some(Vec::new());
            }
        }
        let mut widths: Vec<usize> = found.iter().flatten().map(Vec::len).filter(|n| *n > 0).collect();
        widths.sort_unstable();
        let width = *widths.get(widths.len() / 2)?;
        // A run that never ended is no border, but the face.
        if width + 1 >= widest {
            return None;
        }
        let alike = |p: &&Vec<[f32; 3]>| p.len().abs_diff(width) <= 2 + width / 4 && !p.is_empty();
        let profile = found.iter().flatten().find(alike)?.clone();
        let has = |side: usize| match (&found[side], &found[(side + 2) % 4]) {
            (Some(own), _) => alike(&own),
            (None, Some(opposite)) => alike(&opposite),
            (None, None) => found.iter().flatten().all(|p| alike(&p)),
        };
        let widths = std::array::from_fn(|side| if has(side) { width } else { 0 });
        Some(Self { widths, profile })
    }

    /// The border's colour at a texel, if it is in it.
    fn color(&self, [x, y]: [usize; 2], [w, h]: [usize; 2]) -> Option<[f32; 3]> {
        let away = [x, y, w - 1 - x, h - 1 - y];
        let inside = away.iter().zip(&self.widths).filter(|(a, width)| a < width).map(|(a, _)| *a).min()?;
        self.profile.get(inside).or(self.profile.last()).copied()
    }
}

/// Mean, and standard deviation over the channels.
fn statistics(colors: &[[f32; 3]]) -> ([f32; 3], f64) {
    let n = colors.len().max(1) as f32;
    let mean: [f32; 3] = std::array::from_fn(|k| colors.iter().map(|c| c[k]).sum::<f32>() / n);
    let sum: f32 = colors.iter().flat_map(|c| (0..3).map(move |k| (c[k] - mean[k]).powi(2))).sum();
    (mean, f64::from(sum / (3.0 * n)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkered_rug_is_continued_through_a_large_gap() {
        let (w, h) = (300, 200);
        let truth = |x: usize, y: usize| {
            let v = if (x / 23 + y / 17).is_multiple_of(2) { 200.0 } else { 40.0 };
            [v, 120.0, 255.0 - v]
        };
        let hole = |x: usize, y: usize| (60..190).contains(&x) && (50..200).contains(&y);
        let pixels = (0..w * h).map(|i| (!hole(i % w, i / w)).then(|| truth(i % w, i / w))).collect();
        let mut picture = Picture { width: w, height: h, pixels };
        assert!(picture.complete());
        let wrong = (0..w * h)
            .filter(|i| hole(i % w, i / w))
            .filter(|i| picture.pixels[*i].is_none_or(|c| (c[0] - truth(i % w, i / w)[0]).abs() > 40.0))
            .count();
        assert!(wrong * 20 < 130 * 150, "{wrong} of {} wrong", 130 * 150);
    }

    #[test]
    fn noise_has_no_pattern() {
        let mut state = 1_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as f32
        };
        let pixels = (0..6400).map(|i| (i % 80 < 50).then(|| [next(), next(), next()])).collect();
        let mut picture = Picture { width: 80, height: 80, pixels };
        assert!(!picture.complete());
        assert_eq!(picture.known(), 50 * 80);
    }

    #[test]
    fn a_border_goes_round_corners_that_are_not_seen_and_the_pattern_stays_inside_it() {
        let (w, h, border) = (240, 180, 12);
        let truth = |x: usize, y: usize| {
            let edge = [x, y, w - 1 - x, h - 1 - y].into_iter().min().unwrap_or(0);
            if edge < border {
                return [170.0, 90.0, 60.0];
            }
            let light = ((x - border) / 18 + (y - border) / 18).is_multiple_of(2);
            if light { [230.0, 225.0, 215.0] } else { [40.0, 70.0, 50.0] }
        };
        // The far corner is out of view: half of two sides.
        let hole = |x: usize, y: usize| x + y > 250;
        let pixels = (0..w * h).map(|i| (!hole(i % w, i / w)).then(|| truth(i % w, i / w))).collect();
        let mut picture = Picture { width: w, height: h, pixels };
        assert!(picture.complete());
        let (mut wrong, mut all) = (0, 0);
        for i in (0..w * h).filter(|i| hole(i % w, i / w)) {
            all += 1;
            let want = truth(i % w, i / w);
            wrong += usize::from(picture.pixels[i].is_none_or(|c| (0..3).any(|k| (c[k] - want[k]).abs() > 40.0)));
        }
        assert!(wrong * 16 < all, "{wrong} of {all} wrong");
    }
}
