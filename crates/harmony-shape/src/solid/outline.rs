//! Outlines in the plane: orientation, insets, corners, triangles.

use earcut::Earcut;
use glam::DVec2;

use super::math::left;
use crate::tree::Outline;

/// Corners sharper than this are edges, radians.
pub(super) const CREASE: f64 = 0.7;
/// Longest miter relative to the offset.
const MITER: f64 = 3.0;

/// One island: the outer loop counter-clockwise, then holes clockwise, so that material lies to the left of each.
#[derive(Debug, Clone, Default)]
pub(super) struct Island {
    pub loops: Vec<Vec<DVec2>>,
}

/// A point of a loop as the end of one of its sides.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    pub p: DVec2,
    /// Outward normal in the plane.
    pub normal: DVec2,
    /// How the point moves when the outline is inset by one metre.
    pub inset: DVec2,
    /// Length along the loop.
    pub u: f64,
}

/// The islands of an outline, cleaned.
pub(super) fn islands(outline: &Outline) -> Result<Vec<Island>, String> {
    let mut out = Vec::new();
    collect(outline, &mut out, 0)?;
    Ok(out)
}

fn collect(outline: &Outline, out: &mut Vec<Island>, depth: u32) -> Result<(), String> {
    if depth > 8 {
        return Err("islands of an outline are nested too deeply; 8 levels are allowed".into());
    }
    if !outline.points.is_empty() || outline.islands.is_empty() {
        let outer = ring(&outline.points, true).ok_or("an outline needs at least three points that span an area")?;
        let mut loops = vec![outer];
        loops.extend(outline.holes.iter().filter_map(|h| ring(h, false)));
        out.push(Island { loops });
    }
    outline.islands.iter().try_for_each(|i| collect(i, out, depth + 1))
}

/// A loop without doubled points, turned as asked; `None` when it spans no area.
fn ring(points: &[[f64; 2]], counter_clockwise: bool) -> Option<Vec<DVec2>> {
    let mut out: Vec<DVec2> = Vec::with_capacity(points.len());
    for p in points {
        let p = DVec2::from_array(*p);
        if out.last().is_none_or(|q| q.distance_squared(p) > 1e-12) {
            out.push(p);
        }
    }
    while out.len() > 1 && out[0].distance_squared(out[out.len() - 1]) <= 1e-12 {
        out.pop();
    }
    let area = signed_area(&out);
    if out.len() < 3 || area.abs() < 1e-10 {
        return None;
    }
    if (area > 0.0) != counter_clockwise {
        out.reverse();
    }
    Some(out)
}

pub(super) fn signed_area(points: &[DVec2]) -> f64 {
    (0..points.len()).map(|i| points[i].perp_dot(points[(i + 1) % points.len()])).sum::<f64>() / 2.0
}

/// Directions of the sides.
fn directions(points: &[DVec2]) -> Vec<DVec2> {
    let n = points.len();
    (0..n).map(|i| (points[(i + 1) % n] - points[i]).normalize_or(DVec2::X)).collect()
}

/// How each point moves towards the material when the sides move by one metre.
pub(super) fn miters(points: &[DVec2]) -> Vec<DVec2> {
    let d = directions(points);
    let n = points.len();
    (0..n)
        .map(|i| {
            let (a, b) = (left(d[(i + n - 1) % n]), left(d[i]));
            let m = (a + b) / (1.0 + a.dot(b)).max(1e-3);
            m.clamp_length_max(MITER)
        })
        .collect()
}

/// A loop as runs of columns; runs end at sharp corners. Neighbouring runs share their end points.
pub(super) fn runs(points: &[DVec2], crease: f64) -> Vec<Vec<Column>> {
    let n = points.len();
    let d = directions(points);
    let insets = miters(points);
    let sharp: Vec<bool> = (0..n)
        .map(|i| {
            let (a, b) = (d[(i + n - 1) % n], d[i]);
            libm::atan2(a.perp_dot(b), a.dot(b)).abs() > crease
        })
        .collect();
    let start = sharp.iter().position(|s| *s).unwrap_or(0);
    let mut out = Vec::new();
    let mut run: Vec<Column> = Vec::new();
    let mut u = 0.0;
    for k in 0..=n {
        let i = (start + k) % n;
        let (before, after) = (-left(d[(i + n - 1) % n]), -left(d[i]));
        let smooth = (before + after).normalize_or(after);
        let column = |normal| Column { p: points[i], normal, inset: insets[i], u };
        if k > 0 && (sharp[i] || k == n) {
            run.push(column(if sharp[i] { before } else { smooth }));
            out.push(std::mem::take(&mut run));
        }
        if k < n {
            if run.is_empty() {
                run.push(column(if sharp[i] { after } else { smooth }));
            } else {
                run.push(column(smooth));
            }
            u += points[i].distance(points[(i + 1) % n]);
        }
    }
    out
}

/// Largest inset that folds no side over and leaves material between opposite sides.
pub(super) fn safe_inset(islands: &[Island]) -> f64 {
    let mut least = f64::INFINITY;
    for island in islands {
        let sides: Vec<(DVec2, DVec2)> =
            island.loops.iter().flat_map(|l| (0..l.len()).map(move |i| (l[i], l[(i + 1) % l.len()]))).collect();
        for points in &island.loops {
            let (d, m) = (directions(points), miters(points));
            let n = points.len();
            for i in 0..n {
                let j = (i + 1) % n;
                let rate = d[i].dot(m[i] - m[j]);
                if rate > 1e-9 {
                    least = least.min(points[i].distance(points[j]) / rate);
                }
            }
            if sides.len() <= 1500 {
                for i in 0..n {
                    let from = points[i].midpoint(points[(i + 1) % n]);
                    let thick =
                        sides.iter().filter_map(|s| crossing(from, left(d[i]), *s)).fold(f64::INFINITY, f64::min);
                    least = least.min(thick / 2.0);
                }
            }
        }
    }
    least * 0.9
}

/// Distance along a ray to a side that it meets.
fn crossing(from: DVec2, direction: DVec2, (a, b): (DVec2, DVec2)) -> Option<f64> {
    let side = b - a;
    let det = direction.perp_dot(side);
    if det.abs() < 1e-12 {
        return None;
    }
    let t = (a - from).perp_dot(side) / det;
    let s = (a - from).perp_dot(direction) / det;
    (t > 1e-6 && (0.0..=1.0).contains(&s)).then_some(t)
}

/// Triangles of an island, counter-clockwise, as indices into its loops one after the other.
pub(super) fn triangles(loops: &[Vec<DVec2>]) -> Vec<[u32; 3]> {
    let points: Vec<DVec2> = loops.iter().flatten().copied().collect();
    let mut starts = Vec::new();
    let mut sum = 0_u32;
    for l in loops {
        if sum > 0 {
            starts.push(sum);
        }
        sum += l.len() as u32;
    }
    let mut flat: Vec<u32> = Vec::new();
    Earcut::new().earcut(points.iter().map(|p| [p.x, p.y]), &starts, &mut flat);
    flat.chunks_exact(3)
        .map(|t| {
            let [a, b, c] = [t[0], t[1], t[2]];
            let at = |i: u32| points[i as usize];
            if (at(b) - at(a)).perp_dot(at(c) - at(a)) < 0.0 { [a, c, b] } else { [a, b, c] }
        })
        .collect()
}

/// Lowest and highest corner of all loops.
pub(super) fn bounds(islands: &[Island]) -> (DVec2, DVec2) {
    islands
        .iter()
        .flat_map(|i| i.loops.iter().flatten())
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(lo, hi): (DVec2, DVec2), p| (lo.min(*p), hi.max(*p)))
}
