//! Euclidean distance transform.
//!
//! P. Felzenszwalb, D. Huttenlocher, "Distance Transforms of Sampled Functions", Theory of Computing 8, 2012: the
//! lower envelope of parabolas, once along columns and once along rows.

/// Distance in pixels from each pixel to the nearest one of `targets`; infinite when there is none.
pub(crate) fn distance_to(targets: &[bool], width: usize, height: usize) -> Vec<f32> {
    let far = 1e20_f64;
    let mut grid: Vec<f64> = targets.iter().map(|t| if *t { 0.0 } else { far }).collect();
    let longest = width.max(height);
    let (mut line, mut result) = (vec![0.0; longest], vec![0.0; longest]);
    let mut envelope = Envelope { vertex: vec![0; longest], start: vec![0.0; longest + 1] };
    for x in 0..width {
        for y in 0..height {
            line[y] = grid[y * width + x];
        }
        envelope.transform(&line[..height], &mut result[..height]);
        for y in 0..height {
            grid[y * width + x] = result[y];
        }
    }
    for row in grid.chunks_exact_mut(width.max(1)) {
        envelope.transform(row, &mut result[..width]);
        row.copy_from_slice(&result[..width]);
    }
    grid.into_iter().map(|d| if d >= far / 2.0 { f32::INFINITY } else { d.sqrt() as f32 }).collect()
}

/// Signed distance to the boundary of a set: positive inside, about 0.5 at the pixels beside the boundary.
pub(crate) fn signed_distance(inside: &[bool], width: usize, height: usize) -> Vec<f32> {
    let outside: Vec<bool> = inside.iter().map(|b| !b).collect();
    let to_inside = distance_to(inside, width, height);
    let to_outside = distance_to(&outside, width, height);
    inside.iter().zip(to_inside.iter().zip(&to_outside)).map(|(b, (i, o))| if *b { o - 0.5 } else { 0.5 - i }).collect()
}

/// Radius of the largest disc inside a set that holds each of its pixels, at most `limit`; 0 outside the set.
///
/// `depth` is the set's [`signed_distance`].
pub(crate) fn half_thickness(depth: &[f32], width: usize, height: usize, limit: f32) -> Vec<f32> {
    let core: Vec<bool> = depth.iter().map(|d| *d >= limit).collect();
    let to_core = distance_to(&core, width, height);
    let mut radius: Vec<f32> =
        depth.iter().zip(&to_core).map(|(d, c)| if *d > 0.0 && *c <= limit { limit } else { d.max(0.0) }).collect();
    for y in 0..height {
        for x in 0..width {
            let d = depth[y * width + x];
            if d <= 0.0 || d >= limit || !is_ridge(depth, width, height, x, y) {
                continue;
            }
            let reach = d.ceil() as usize;
            for v in y.saturating_sub(reach)..(y + reach + 1).min(height) {
                for u in x.saturating_sub(reach)..(x + reach + 1).min(width) {
                    let apart = (u.abs_diff(x) as f32).hypot(v.abs_diff(y) as f32);
                    let i = v * width + u;
                    if apart <= d && depth[i] > 0.0 {
                        radius[i] = radius[i].max(d);
                    }
                }
            }
        }
    }
    radius
}

/// Whether no neighbour lies deeper by a whole step: the middle of a thin part, near enough.
fn is_ridge(depth: &[f32], width: usize, height: usize, x: usize, y: usize) -> bool {
    let d = depth[y * width + x];
    let (rows, columns) = (y.saturating_sub(1)..(y + 2).min(height), x.saturating_sub(1)..(x + 2).min(width));
    rows.flat_map(|v| columns.clone().map(move |u| (u, v))).all(|(u, v)| depth[v * width + u] < d + 0.7)
}

struct Envelope {
    vertex: Vec<usize>,
    start: Vec<f64>,
}

impl Envelope {
    /// Squared distance transform of one line.
    fn transform(&mut self, f: &[f64], out: &mut [f64]) {
        if f.is_empty() {
            return;
        }
        let square = |q: usize| (q * q) as f64;
        let mut k = 0;
        self.vertex[0] = 0;
        self.start[0] = f64::NEG_INFINITY;
        self.start[1] = f64::INFINITY;
        for q in 1..f.len() {
            loop {
                let v = self.vertex[k];
                let s = ((f[q] + square(q)) - (f[v] + square(v))) / (2 * (q - v)) as f64;
                if s <= self.start[k] {
                    k -= 1; // start[0] is -infinity: never below 0
                } else {
                    k += 1;
                    self.vertex[k] = q;
                    self.start[k] = s;
                    self.start[k + 1] = f64::INFINITY;
                    break;
                }
            }
        }
        let mut k = 0;
        for (q, d) in out.iter_mut().enumerate() {
            while self.start[k + 1] < q as f64 {
                k += 1;
            }
            let v = self.vertex[k];
            *d = square(q.abs_diff(v)) + f[v];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_a_full_search() {
        let (w, h) = (23, 17);
        let targets: Vec<bool> = (0..w * h).map(|i| (i * 7919 + 13) % 41 == 0).collect();
        let fast = distance_to(&targets, w, h);
        for y in 0..h {
            for x in 0..w {
                let slow = (0..w * h)
                    .filter(|i| targets[*i])
                    .map(|i| ((x as f32 - (i % w) as f32).powi(2) + (y as f32 - (i / w) as f32).powi(2)).sqrt())
                    .fold(f32::INFINITY, f32::min);
                assert!((fast[y * w + x] - slow).abs() < 1e-4, "at {x} {y}");
            }
        }
        assert!(distance_to(&[false; 12], 4, 3).iter().all(|d| d.is_infinite()));
        assert!(distance_to(&[], 0, 0).is_empty());
    }

    #[test]
    fn signed_distance_is_symmetric_about_an_edge() {
        let inside: Vec<bool> = (0..80).map(|i| i % 10 >= 5).collect();
        let d = signed_distance(&inside, 10, 8);
        assert!((d[4] + 0.5).abs() < 1e-6 && (d[5] - 0.5).abs() < 1e-6);
        assert!((d[0] + 4.5).abs() < 1e-6 && (d[9] - 4.5).abs() < 1e-6);
    }

    #[test]
    fn thickness_is_that_of_the_part_a_pixel_belongs_to() {
        // A block of 40 x 40 with an arm 8 wide.
        let (w, h) = (100, 60);
        let inside: Vec<bool> = (0..w * h)
            .map(|i| {
                let (x, y) = (i % w, i / w);
                (10..50).contains(&x) && (10..50).contains(&y) || (50..90).contains(&x) && (26..34).contains(&y)
            })
            .collect();
        let t = half_thickness(&signed_distance(&inside, w, h), w, h, 12.0);
        assert_eq!(t[30 * w + 30], 12.0, "the block is thicker than asked for");
        for (x, y) in [(70, 26), (70, 30), (80, 33)] {
            assert!((t[y * w + x] - 4.0).abs() <= 0.6, "arm at {x}, {y}: {}", t[y * w + x]);
        }
        assert_eq!(t[5 * w + 5], 0.0);
    }
}
