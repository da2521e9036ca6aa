//! A surface's texture without the light of the photo, shadows' and sun patches' edges too: what is lit again should
//! hold no light of its own.
//!
//! The logarithm of photo over material (under even light) holds light, grain and joints. What is left of it by a median
//! over 20 cm is light: boards' joints, grain and small stains are too narrow to stay in it, while the edge of a shadow
//! stays where it is, so that dividing it out leaves no halo. Differences no larger than those between the material's own
//! pieces may be the material's and stay; so does what has another hue (an inlay, a stain of paint).

use image::{Rgba, RgbaImage};

use super::base::Color;

/// Side of a cell, metres.
const CELL: f64 = 0.02;
/// Half the median's window, metres.
const WINDOW: f64 = 0.1;
/// Most cells from the middle of the window to its edge.
const MAX_REACH: i64 = 6;
/// Width of the slow part, which is light however small, metres.
const SLOW: f64 = 0.5;
/// Difference of hue (logarithms of channels against their mean) that is hardly the light's.
const HUE: f32 = 0.4;
/// Light that is this far from usual, as a logarithm, leaves too little of the material to be brought back; from the first
/// on less and less is.
const FAR: [f32; 2] = [1.1, 1.7];
/// Level from which a channel may be cut off.
const BLOWN: u8 = 251;
/// Colour below which a ratio says nothing, 8-bit levels.
const DARKEST: f32 = 4.0;
/// A texel takes the light of those cells around it that are this near to its own ratio: it lies on one side of a shadow's
/// edge.
const SIDE: f32 = 0.15;

/// What is known of a surface.
pub(super) struct Seen<'a> {
    /// What was seen; alpha `kept` or more counts.
    pub texture: &'a RgbaImage,
    /// Least alpha.
    pub kept: u8,
    /// Texels a metre.
    pub px_per_m: f64,
    /// Differences between pieces of the material, as logarithms.
    pub pieces: f32,
}

/// The texture under even light, where `material` tells the surface's colour without grain under that light. Alpha 0 where
/// the light leaves nothing to be seen.
pub(super) fn even(seen: &Seen<'_>, material: impl Fn(u32, u32) -> Color) -> RgbaImage {
    let cell = ((CELL * seen.px_per_m).round() as usize).max(1);
    let grid = Grid::of(seen, cell, &material);
    let reach = ((WINDOW * seen.px_per_m / cell as f64).round() as i64).clamp(1, MAX_REACH);
    let middle = grid.medians(reach);
    let slow = grid.slow(&middle, (SLOW * seen.px_per_m / cell as f64).max(1.0));
    let light: Vec<Color> = middle.iter().zip(&slow).map(|(m, s)| light_of(*m, *s, seen.pieces)).collect();
    let mut out = seen.texture.clone();
    for (x, y, p) in out.enumerate_pixels_mut() {
        if p.0[3] < seen.kept {
            continue;
        }
        let light = grid.at(&light, x, y, ratio(p.0, material(x, y)));
        let level = mean(light);
        let believed = 1.0 - ((level.abs() - FAR[0]) / (FAR[1] - FAR[0])).clamp(0.0, 1.0);
        if believed <= 0.0 || p.0[..3].iter().all(|v| *v >= BLOWN) {
            *p = Rgba([0; 4]);
            continue;
        }
        for (v, l) in p.0.iter_mut().zip(light) {
            *v = ((f32::from(*v) + DARKEST) / l.exp() - DARKEST).round().clamp(0.0, 255.0) as u8;
        }
    }
    out
}

/// What of a median is light: the slow part, and the rest where it is more than pieces of the material differ by.
fn light_of(middle: Color, slow: Color, pieces: f32) -> Color {
    let rest: Color = std::array::from_fn(|c| middle[c] - slow[c]);
    let level = mean(rest);
    // From twice as much on it is light altogether.
    let share = (level.abs() / pieces.max(1e-3) - 1.0).clamp(0.0, 1.0);
    let light: Color = std::array::from_fn(|c| slow[c] + share * rest[c]);
    let level = mean(light);
    let hue = light.iter().map(|v| (v - level).powi(2)).sum::<f32>().sqrt();
    let own = (-(hue / HUE).powi(2)).exp();
    light.map(|v| own * v)
}

/// Logarithm of photo over material.
fn ratio(photo: [u8; 4], material: Color) -> Color {
    std::array::from_fn(|c| ((f32::from(photo[c]) + DARKEST) / (material[c].max(0.0) + DARKEST)).ln())
}

fn mean(v: Color) -> f32 {
    (v[0] + v[1] + v[2]) / 3.0
}

/// Means of cells.
struct Grid {
    cell: usize,
    width: usize,
    height: usize,
    cells: Vec<Option<Color>>,
}

impl Grid {
    fn of(seen: &Seen<'_>, cell: usize, material: &impl Fn(u32, u32) -> Color) -> Self {
        let size = [seen.texture.width(), seen.texture.height()].map(|n| (n as usize).div_ceil(cell).max(1));
        let mut sums: Vec<(Color, f32)> = vec![([0.0; 3], 0.0); size[0] * size[1]];
        for (x, y, p) in seen.texture.enumerate_pixels().filter(|(_, _, p)| p.0[3] >= seen.kept) {
            let (sum, n) = &mut sums[y as usize / cell * size[0] + x as usize / cell];
            sum.iter_mut().zip(ratio(p.0, material(x, y))).for_each(|(s, r)| *s += r);
            *n += 1.0;
        }
        let cells = sums.iter().map(|(sum, n)| (*n > 0.0).then(|| sum.map(|s| s / n))).collect();
        Self { cell, width: size[0], height: size[1], cells }
    }

    /// The median of the cells around each, by channel; nothing is 0.
    fn medians(&self, reach: i64) -> Vec<Color> {
        let mut around: [Vec<f32>; 3] = Default::default();
        (0..self.cells.len())
            .map(|i| {
                if self.cells[i].is_none() {
                    return [0.0; 3];
                }
                let (x, y) = ((i % self.width) as i64, (i / self.width) as i64);
                around.iter_mut().for_each(Vec::clear);
                for v in (y - reach).max(0)..=(y + reach).min(self.height as i64 - 1) {
                    for u in (x - reach).max(0)..=(x + reach).min(self.width as i64 - 1) {
                        if let Some(color) = self.cells[v as usize * self.width + u as usize] {
                            around.iter_mut().zip(color).for_each(|(a, c)| a.push(c));
                        }
                    }
                }
                std::array::from_fn(|c| {
                    let half = around[c].len() / 2;
                    *around[c].select_nth_unstable_by(half, f32::total_cmp).1
                })
            })
            .collect()
    }

    /// Gaussian means over the cells that were seen.
    fn slow(&self, values: &[Color], sigma: f64) -> Vec<Color> {
        let mut now: Vec<[f32; 4]> = values
            .iter()
            .zip(&self.cells)
            .map(|(v, seen)| if seen.is_some() { [v[0], v[1], v[2], 1.0] } else { [0.0; 4] })
            .collect();
        // Three means over a window are a Gaussian, nearly: variance (w^2 - 1) / 12 each.
        let half = (((4.0 * sigma * sigma + 1.0).sqrt() - 1.0) / 2.0).round() as usize;
        for _ in 0..3 {
            now = run(&now, self.width, self.height, half, true);
            now = run(&now, self.width, self.height, half, false);
        }
        now.iter().map(|v| if v[3] > 1e-6 { [v[0], v[1], v[2]].map(|c| c / v[3]) } else { [0.0; 3] }).collect()
    }

    /// Bilinear among cells that were seen, those first that are near to the texel's own value.
    fn at(&self, values: &[Color], x: u32, y: u32, own: Color) -> Color {
        let place = |at: u32| (at as f32 + 0.5) / self.cell as f32 - 0.5;
        let (fx, fy) = (place(x), place(y));
        let (mut sum, mut total) = ([0.0_f32; 3], 0.0_f32);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (cx, cy) = (fx.floor() + dx, fy.floor() + dy);
            let weight = (1.0 - (fx - cx).abs()) * (1.0 - (fy - cy).abs());
            if cx < 0.0 || cy < 0.0 || cx as usize >= self.width || cy as usize >= self.height {
                continue;
            }
            let i = cy as usize * self.width + cx as usize;
            if self.cells[i].is_some() {
                let off = (mean(values[i]) - mean(own)).abs() / SIDE;
                let weight = weight.max(1e-3) / (1.0 + off.powi(4));
                sum.iter_mut().zip(values[i]).for_each(|(s, v)| *s += weight * v);
                total += weight;
            }
        }
        if total > 1e-6 { sum.map(|s| s / total) } else { [0.0; 3] }
    }
}

/// Sums over windows along rows or columns.
fn run(values: &[[f32; 4]], width: usize, height: usize, half: usize, along_rows: bool) -> Vec<[f32; 4]> {
    let (lines, length) = if along_rows { (height, width) } else { (width, height) };
    let index = |line: usize, k: usize| if along_rows { line * width + k } else { k * width + line };
    let mut out = vec![[0.0; 4]; values.len()];
    for line in 0..lines {
        let mut sum = [0.0_f64; 4];
        let add = |sum: &mut [f64; 4], k: usize, sign: f64| {
            sum.iter_mut().zip(values[index(line, k)]).for_each(|(s, v)| *s += sign * f64::from(v));
        };
        for k in 0..half.min(length) {
            add(&mut sum, k, 1.0);
        }
        for k in 0..length {
            if k + half < length {
                add(&mut sum, k + half, 1.0);
            }
            if k > half {
                add(&mut sum, k - half - 1, -1.0);
            }
            out[index(line, k)] = sum.map(|s| (s / (2 * half + 1) as f64) as f32);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const PX_PER_M: f64 = 100.0;

    /// Boards 12 cm wide with dark joints and tones of their own, 3 m x 2 m.
    fn boards(x: u32, y: u32) -> Color {
        let tone = [1.0, 0.94, 1.05, 0.97][(x / 12 % 4) as usize];
        let joint = if x.is_multiple_of(12) { 0.7 } else { 1.0 };
        let grain = 1.0 + 0.02 * f32::from(u8::from((x * 7 + y * 13).is_multiple_of(5)));
        [150.0, 110.0, 80.0].map(|c| c * tone * joint * grain)
    }

    fn lit(light: impl Fn(u32, u32) -> Color) -> RgbaImage {
        RgbaImage::from_fn(300, 200, |x, y| {
            let (c, l) = (boards(x, y), light(x, y));
            let [r, g, b]: [u8; 3] = std::array::from_fn(|k| (c[k] * l[k]).round().clamp(0.0, 255.0) as u8);
            Rgba([r, g, b, 255])
        })
    }

    fn evened(texture: &RgbaImage) -> RgbaImage {
        // The mean of the boards: of their tones 0.99, their joints 0.975, their grain 1.004.
        let middle = [150.0, 110.0, 80.0].map(|c| c * 0.969);
        even(&Seen { texture, kept: 224, px_per_m: PX_PER_M, pieces: 0.06 }, |_, _| middle)
    }

    fn red(image: &RgbaImage, xs: std::ops::Range<u32>, ys: std::ops::Range<u32>) -> f64 {
        let n = f64::from(xs.len() as u32 * ys.len() as u32);
        let all = ys.flat_map(|y| xs.clone().map(move |x| (x, y)));
        all.map(|(x, y)| f64::from(image.get_pixel(x, y).0[0])).sum::<f64>() / n
    }

    #[test]
    fn a_patch_of_sun_goes_edges_and_all_and_joints_stay() {
        let patch = |x: u32, y: u32| (60..180).contains(&x) && (50..150).contains(&y);
        let floor = evened(&lit(|x, y| if patch(x, y) { [1.5, 1.45, 1.35] } else { [0.75, 0.78, 0.8] }));
        // Whole repeats of boards within the patch and outside of it.
        let (inside, outside) = (red(&floor, 96..144, 70..130), red(&floor, 192..288, 10..190));
        assert!((inside / outside - 1.0).abs() < 0.1, "{inside} and {outside}");
        // Across the lower edge, on one board: no step, no halo.
        let steps: Vec<f64> = (140..158).map(|y| red(&floor, 98..106, y..y + 2)).collect();
        let (least, most) = (steps.iter().copied().fold(255.0, f64::min), steps.iter().copied().fold(0.0, f64::max));
        assert!(most / least < 1.25, "{steps:?}");
        let joint = red(&floor, 120..121, 70..130) / red(&floor, 124..130, 70..130);
        assert!((0.6..0.8).contains(&joint), "{joint}");
    }

    #[test]
    fn what_is_evenly_lit_stays() {
        let photo = lit(|_, _| [1.0; 3]);
        let floor = evened(&photo);
        let off: f64 = floor.pixels().zip(photo.pixels()).map(|(a, b)| f64::from(a.0[0].abs_diff(b.0[0]))).sum();
        assert!(off / f64::from(300 * 200) < 4.0, "{}", off / f64::from(300 * 200));
        let tones = red(&floor, 86..95, 50..150) / red(&floor, 74..83, 50..150);
        assert!(!(0.98..=1.02).contains(&tones), "boards keep their tones: {tones}");
    }

    #[test]
    fn an_inlay_of_another_hue_is_no_light() {
        let inlay = |x: u32, y: u32| (100..200).contains(&x) && (60..140).contains(&y);
        let photo = lit(|x, y| if inlay(x, y) { [1.1, 0.5, 0.4] } else { [1.0; 3] });
        let floor = evened(&photo);
        let [r, g, _, _] = floor.get_pixel(150, 100).0;
        assert!(f64::from(r) / f64::from(g) > 2.2, "{r} {g}");
    }

    #[test]
    fn what_is_blown_or_unseen_says_nothing() {
        let mut photo = lit(|x, _| if x > 200 { [4.0; 3] } else { [1.0; 3] });
        photo.get_pixel_mut(10, 10).0 = [0; 4];
        let floor = evened(&photo);
        assert_eq!(floor.get_pixel(250, 100).0[3], 0);
        assert_eq!(floor.get_pixel(10, 10).0[3], 0);
    }
}
