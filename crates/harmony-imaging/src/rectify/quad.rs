//! Quadrilaterals: the map onto one, and the one that fits a mask.

use glam::{DMat3, DVec2, DVec3};
use harmony_scene::Mask;

use crate::polygon::rasterize;

/// The projective map of the unit square (0,0), (1,0), (1,1), (0,1) onto the corners in that order.
///
/// P. Heckbert, "Fundamentals of Texture Mapping and Image Warping", 1989, Sec. 2.2.3. `None` for a quadrilateral that
/// is not convex or has no area.
pub(super) fn quad_from_square(q: [DVec2; 4]) -> Option<DMat3> {
    if !q.iter().all(|p| p.is_finite()) {
        return None;
    }
    let turns: Vec<f64> = (0..4).map(|i| (q[(i + 1) % 4] - q[i]).perp_dot(q[(i + 2) % 4] - q[(i + 1) % 4])).collect();
    let convex = turns.iter().all(|t| *t > 1e-9) || turns.iter().all(|t| *t < -1e-9);
    if !convex {
        return None;
    }
    let s = q[0] - q[1] + q[2] - q[3];
    let (d1, d2) = (q[1] - q[2], q[3] - q[2]);
    let determinant = d1.perp_dot(d2);
    let g = s.perp_dot(d2) / determinant;
    let h = d1.perp_dot(s) / determinant;
    let (a, b) = (q[1] - q[0] + g * q[1], q[3] - q[0] + h * q[3]);
    Some(DMat3::from_cols(DVec3::new(a.x, a.y, g), DVec3::new(b.x, b.y, h), DVec3::new(q[0].x, q[0].y, 1.0)))
}

/// Applies a projective map; `None` on its horizon.
pub(super) fn apply(map: &DMat3, p: DVec2) -> Option<DVec2> {
    let v = *map * p.extend(1.0);
    (v.z.abs() > 1e-12).then(|| DVec2::new(v.x / v.z, v.y / v.z))
}

/// Convex hull (Andrew's monotone chain), counter-clockwise in x right, y up: clockwise on the screen reversed.
fn convex_hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut hull: Vec<DVec2> = Vec::new();
    for way in 0..2 {
        let floor = hull.len();
        let ordered: Box<dyn Iterator<Item = &DVec2>> =
            if way == 0 { Box::new(points.iter()) } else { Box::new(points.iter().rev()) };
        for p in ordered {
            while hull.len() >= floor + 2
                && (hull[hull.len() - 1] - hull[hull.len() - 2]).perp_dot(*p - hull[hull.len() - 2]) <= 0.0
            {
                hull.pop();
            }
            hull.push(*p);
        }
        hull.pop();
    }
    hull
}

/// The corners of the mask's pixels that can be on its hull: the ends of each row's run.
fn extreme_points(mask: &Mask) -> Vec<DVec2> {
    let width = mask.size().width as usize;
    let mut points = Vec::new();
    for (y, row) in mask.bits().chunks_exact(width.max(1)).enumerate() {
        let (Some(first), Some(last)) = (row.iter().position(|b| *b), row.iter().rposition(|b| *b)) else { continue };
        for x in [first as f64, last as f64 + 1.0] {
            points.push(DVec2::new(x, y as f64));
            points.push(DVec2::new(x, y as f64 + 1.0));
        }
    }
    points
}

/// The quadrilateral around a hull with little extra area: edges are dropped one by one, each time the one whose
/// neighbours meet with the least area added.
fn enclosing_quad(mut hull: Vec<DVec2>) -> Option<[DVec2; 4]> {
    while hull.len() > 4 {
        let n = hull.len();
        let mut best: Option<(f64, usize, DVec2)> = None;
        for i in 0..n {
            let (before, a, b, after) = (hull[(i + n - 1) % n], hull[i], hull[(i + 1) % n], hull[(i + 2) % n]);
            let (d1, d2) = (a - before, b - after);
            let cross = d1.perp_dot(d2);
            if cross.abs() < 1e-9 {
                continue;
            }
            let t = (b - a).perp_dot(d2) / cross;
            if t < 0.0 {
                continue; // the neighbours part instead of meeting
            }
            let corner = a + d1 * t;
            let area = (b - a).perp_dot(corner - a).abs() / 2.0;
            if best.is_none_or(|(least, _, _)| area < least) {
                best = Some((area, i, corner));
            }
        }
        let (_, i, corner) = best?;
        hull[i] = corner;
        hull.remove((i + 1) % n);
    }
    <[DVec2; 4]>::try_from(hull).ok()
}

/// Overlap of a quadrilateral with the mask, as intersection over union.
fn overlap(quad: &[DVec2; 4], mask: &Mask) -> f64 {
    let points = quad.map(|p| [p.x, p.y]);
    let filled = rasterize(&points, mask.size().width as usize, mask.size().height as usize);
    let both = filled.iter().zip(mask.bits()).filter(|(a, b)| **a && **b).count();
    let either = filled.iter().zip(mask.bits()).filter(|(a, b)| **a || **b).count();
    if either == 0 { 0.0 } else { both as f64 / either as f64 }
}

/// Moves corners, and whole sides, while the overlap grows.
fn improve(mut quad: [DVec2; 4], mask: &Mask) -> [DVec2; 4] {
    let longest = f64::from(mask.size().width.max(mask.size().height));
    let mut best = overlap(&quad, mask);
    let mut step = (longest / 50.0).max(1.0);
    while step >= 0.5 {
        let mut moved = false;
        for choice in 0..8 {
            for way in [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y] {
                let mut tried = quad;
                tried[choice % 4] += way * step;
                if choice >= 4 {
                    tried[(choice + 1) % 4] += way * step;
                }
                let score = overlap(&tried, mask);
                if score > best + 1e-9 && quad_from_square(tried).is_some() {
                    (quad, best, moved) = (tried, score, true);
                }
            }
        }
        if !moved {
            step /= 2.0;
        }
    }
    quad
}

/// Top-left first, clockwise on the screen.
fn ordered(quad: [DVec2; 4]) -> [DVec2; 4] {
    let centre = quad.iter().sum::<DVec2>() / 4.0;
    let mut corners = quad;
    corners.sort_by(|a, b| (*a - centre).to_angle().total_cmp(&(*b - centre).to_angle()));
    // Now clockwise on the screen (y down) from the angle -pi. Of the four turns take the one whose first side is most
    // nearly along +x.
    let along = |k: usize| {
        (corners[(k + 1) % 4] - corners[k]).normalize_or_zero().x
            - (corners[(k + 3) % 4] - corners[(k + 2) % 4]).normalize_or_zero().x
    };
    let first = (0..4).max_by(|a, b| along(*a).total_cmp(&along(*b))).unwrap_or(0);
    std::array::from_fn(|k| corners[(first + k) % 4])
}

/// See [`super::min_area_quad`].
pub(super) fn fit(mask: &Mask) -> Option<[DVec2; 4]> {
    let b = mask.bounds()?;
    let boxed = [DVec2::new(b.x0, b.y0), DVec2::new(b.x1, b.y0), DVec2::new(b.x1, b.y1), DVec2::new(b.x0, b.y1)];
    // The fit is done on a small copy of the mask's surroundings.
    let enclosing = enclosing_quad(convex_hull(extreme_points(mask))).filter(|q| quad_from_square(*q).is_some());
    let start = [Some(boxed), enclosing]
        .into_iter()
        .flatten()
        .max_by(|a, b| overlap(a, mask).total_cmp(&overlap(b, mask)))
        .unwrap_or(boxed);
    Some(ordered(improve_small(start, mask, &b)))
}

/// [`improve`] on the mask's box at no more than some hundred pixels.
fn improve_small(quad: [DVec2; 4], mask: &Mask, b: &harmony_scene::PixelBox) -> [DVec2; 4] {
    const MARGIN: f64 = 8.0;
    let k = (f64::max(b.width(), b.height()) / 240.0).max(1.0);
    let origin = DVec2::new(b.x0, b.y0) - MARGIN * k;
    let side = |length: f64| (length / k + 2.0 * MARGIN).ceil() as u32;
    let size = harmony_scene::ImageSize::new(side(b.width()), side(b.height()));
    let small = Mask::from_fn(size, |x, y| {
        let p = origin + DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) * k;
        mask.get(p.x.floor() as i64, p.y.floor() as i64)
    });
    improve(quad.map(|p| (p - origin) / k), &small).map(|p| p * k + origin)
}
