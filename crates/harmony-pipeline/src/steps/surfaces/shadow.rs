//! Deep shadows on walls around what stands before them: light of the photo that belongs to things, not to the wall. Left
//! on it they go on into what the thing hides, as dark blots. Soft ones stay: they are much of a wall's look.

use image::{Rgba, RgbaImage};

use harmony_imaging::color::linear_from_rgb8;

/// Side of the cells that are judged, metres.
const CELL: f64 = 0.04;
/// How far from what hides the wall its shadow reaches, metres.
const REACH: f64 = 0.2;
/// How much darker than the wall's light a cell next to a thing is when a shadow begins there, and how much its
/// neighbours are that belong to it, nats.
const BEGINS: f64 = 0.4;
const GOES_ON: f64 = 0.3;
/// What begins this near to a wall's edge is the corner's, metres.
const CORNER: f64 = 0.2;
/// Scale of the robust fit, nats.
const SCALE: f64 = 0.05;
/// Fewest cells that make a law of light, and the largest share of them that shadows may be.
const FEWEST: usize = 60;
const MOST: f64 = 0.35;

/// Forgets the texels of a wall that lie in the shadow of what stands before it: darker than the wall's own smooth light
/// (a quadratic in place, fitted to all that is seen, robustly), and joined to what hides the wall.
pub fn forget(texture: &mut RgbaImage, px_per_m: f64) {
    let side = ((CELL * px_per_m).round() as u32).max(2);
    let (columns, rows) = (texture.width().div_ceil(side), texture.height().div_ceil(side));
    if columns < 3 || rows < 3 {
        return;
    }
    let light: Vec<Option<f64>> =
        (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))).map(|(x, y)| mean(texture, side, x, y)).collect();
    let place = |i: usize| {
        let (x, y) = (i as u32 % columns, i as u32 / columns);
        [f64::from(x) / f64::from(columns) - 0.5, f64::from(y) / f64::from(rows) - 0.5]
    };
    let seen: Vec<(usize, f64)> = light.iter().enumerate().filter_map(|(i, v)| Some((i, (*v)?))).collect();
    if seen.len() < FEWEST {
        return;
    }
    let basis = |i: usize| {
        let [u, v] = place(i);
        [1.0, u, v, u * u, u * v, v * v]
    };
    let law = fit(&seen.iter().map(|(i, v)| (basis(*i), *v)).collect::<Vec<_>>());
    let darker = |i: usize| {
        let usual: f64 = basis(i).iter().zip(law).map(|(b, w)| b * w).sum();
        light[i].map_or(0.0, |v| usual - v)
    };
    let around = |i: usize| {
        let (x, y) = ((i as u32 % columns) as i64, (i as u32 / columns) as i64);
        [(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().filter_map(move |(a, b)| {
            let (x, y) = (x + a, y + b);
            let inside = x >= 0 && y >= 0 && x < i64::from(columns) && y < i64::from(rows);
            inside.then(|| (y * i64::from(columns) + x) as usize)
        })
    };
    // Corners of the room are dark by themselves.
    let corner = (CORNER / CELL) as u32;
    let inner = |i: usize| {
        let (x, y) = (i as u32 % columns, i as u32 / columns);
        x.min(y) >= corner && x + corner < columns && y + corner < rows
    };
    // Steps from what hides the wall, through shadow.
    let most = (REACH / CELL) as usize;
    let mut steps: Vec<Option<usize>> = vec![None; light.len()];
    let mut front: Vec<usize> = seen
        .iter()
        .map(|(i, _)| *i)
        .filter(|i| inner(*i) && darker(*i) > BEGINS && around(*i).any(|j| light[j].is_none()))
        .collect();
    for step in 0..most {
        for i in &front {
            steps[*i] = Some(step);
        }
        let mut next: Vec<usize> = front
            .iter()
            .flat_map(|i| around(*i))
            .filter(|j| steps[*j].is_none() && light[*j].is_some() && darker(*j) > GOES_ON)
            .collect();
        next.sort_unstable();
        next.dedup();
        front = next;
    }
    let shadows = steps.iter().flatten().count();
    if shadows == 0 || shadows as f64 > MOST * seen.len() as f64 {
        return;
    }
    for (x, y, pixel) in texture.enumerate_pixels_mut() {
        if steps[((y / side) * columns + x / side) as usize].is_some() {
            *pixel = Rgba([0; 4]);
        }
    }
}

/// Logarithm of a cell's mean luminance, where most of it is seen.
fn mean(texture: &RgbaImage, side: u32, x: u32, y: u32) -> Option<f64> {
    let (mut sum, mut count, mut all) = (0.0, 0, 0);
    for j in y * side..((y + 1) * side).min(texture.height()) {
        for i in x * side..((x + 1) * side).min(texture.width()) {
            let [r, g, b, a] = texture.get_pixel(i, j).0;
            all += 1;
            if a > 0 {
                let [r, g, b] = linear_from_rgb8([r, g, b]).map(f64::from);
                sum += 0.2126 * r + 0.7152 * g + 0.0722 * b;
                count += 1;
            }
        }
    }
    (count * 2 > all).then(|| (sum / f64::from(count)).max(1e-4).ln())
}

/// Weighted least squares, reweighted (Geman and McClure) so that shadows do not bend the law; darker cells start with
/// less weight, for light is what most of the bright ones share.
fn fit(rows: &[([f64; 6], f64)]) -> [f64; 6] {
    let mut values: Vec<f64> = rows.iter().map(|r| r.1).collect();
    let middle = values.len() / 2;
    let median = *values.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut law = [median, 0.0, 0.0, 0.0, 0.0, 0.0];
    for round in 0..15 {
        let scale = if round < 5 { 4.0 * SCALE } else { SCALE };
        let mut a = [[0.0; 7]; 6];
        for (i, row) in a.iter_mut().enumerate() {
            // A level law where little is seen.
            row[i] = if i == 0 { 1e-9 } else { 0.02 * rows.len() as f64 };
        }
        for (b, wanted) in rows {
            let off = wanted - b.iter().zip(law).map(|(b, w)| b * w).sum::<f64>();
            let w = (1.0 + (off / scale).powi(2)).powi(-2);
            for i in 0..6 {
                for j in 0..6 {
                    a[i][j] += w * b[i] * b[j];
                }
                a[i][6] += w * b[i] * wanted;
            }
        }
        let Some(next) = solve(a) else { break };
        law = next;
    }
    law
}

fn solve(mut a: [[f64; 7]; 6]) -> Option<[f64; 6]> {
    for k in 0..6 {
        if a[k][k].abs() < 1e-12 {
            return None;
        }
        for i in k + 1..6 {
            let f = a[i][k] / a[k][k];
            let above = a[k];
            for (value, above) in a[i].iter_mut().zip(above) {
                *value -= f * above;
            }
        }
    }
    let mut x = [0.0; 6];
    for k in (0..6).rev() {
        let known: f64 = (k + 1..6).map(|j| a[k][j] * x[j]).sum();
        x[k] = (a[k][6] - known) / a[k][k];
    }
    x.iter().all(|v| v.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of 3 by 2.5 m in light that falls off to one side, with a chest before it and a stain.
    fn wall(shadow: f64, stain: f64) -> RgbaImage {
        RgbaImage::from_fn(300, 250, |x, y| {
            let (u, v) = (f64::from(x) / 100.0, f64::from(y) / 100.0);
            if (1.0..1.8).contains(&u) && v > 1.5 {
                return Rgba([0; 4]);
            }
            let away = (u - 1.8).max(1.0 - u).max(1.5 - v).max(0.0);
            let dark = if away < 0.2 { 1.0 - shadow * (1.0 - away / 0.2) } else { 1.0 };
            let spot = if (u - 0.5).hypot(v - 0.6) < 0.15 { 1.0 - stain } else { 1.0 };
            let light = (190.0 - 25.0 * u) * dark * spot;
            Rgba([light as u8, light as u8, light as u8, 255])
        })
    }

    fn gone(texture: &RgbaImage, x: u32, y: u32) -> bool {
        texture.get_pixel(x, y).0[3] == 0
    }

    #[test]
    fn a_shadow_around_a_chest_goes_and_the_rest_stays() {
        let mut texture = wall(0.7, 0.6);
        forget(&mut texture, 100.0);
        assert!(gone(&texture, 97, 200) && gone(&texture, 183, 200) && gone(&texture, 140, 146));
        assert!(!gone(&texture, 60, 200) && !gone(&texture, 280, 30) && !gone(&texture, 10, 10));
        assert!(!gone(&texture, 50, 60), "a stain that touches nothing is the wall's own");
    }

    #[test]
    fn uneven_light_and_soft_shadows_stay() {
        let mut texture = wall(0.2, 0.0);
        let before = texture.clone();
        forget(&mut texture, 100.0);
        assert_eq!(texture, before);
    }
}
