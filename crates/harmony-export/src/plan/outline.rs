//! What is seen of things from one direction, as lines: silhouettes of their parts, hidden lines removed.
//!
//! # Idea
//! A mesh is taken apart into its connected parts (boards, handles, legs of a part model; one for a generated mesh). The
//! union of a part's projected triangles is its silhouette, exact but for the simplification of large meshes. A part's
//! line is drawn where no nearer part covers it. A mesh of one part also gets lines where it steps up: the arms and the
//! back of a sofa above its seat.
//!
//! # Limits
//! Parts are ordered by their nearest point, not cut where they pass through each other. Lines are true to 2 mm.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_mesh::{Mesh, connected, simple_form};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::float::clip::FloatClip;
use i_overlay::float::single::SingleFloatOverlay;
use i_overlay::string::clip::ClipRule;

/// A closed line, the first point not repeated.
pub(crate) type Loop = Vec<[f64; 2]>;

/// How far a drawn line may be from the silhouette, metres.
const TOLERANCE: f64 = 0.002;
/// Parts with less area are not drawn, square metres.
const SMALLEST: f64 = 4e-5;
/// Most parts of one thing, the largest ones.
const MAX_PARTS: usize = 120;
/// A step of a generated mesh that gets a line, metres.
const STEP: f64 = 0.06;
/// Share of a thing's own area that lies above a step and below it at least.
const STEP_AREA: f64 = 0.06;

/// A silhouette.
#[derive(Debug, Clone)]
pub(crate) struct Silhouette {
    /// Outer loops anticlockwise, holes clockwise.
    pub loops: Vec<Loop>,
    /// How near its nearest point is to the viewer, metres; larger is nearer.
    pub near: f64,
}

/// All that is drawn of one thing.
#[derive(Debug, Clone)]
pub(crate) struct Drawn {
    /// Number of the thing.
    pub thing: usize,
    /// Parts.
    pub parts: Vec<Silhouette>,
    /// Union of the parts.
    pub outline: Vec<Loop>,
}

/// A visible line.
#[derive(Debug, Clone)]
pub(crate) struct Stroke {
    /// Number of the thing.
    pub thing: usize,
    /// Points.
    pub points: Vec<[f64; 2]>,
    /// Whether it is on the thing's outline.
    pub outer: bool,
}

/// Twice the signed area, positive anticlockwise.
fn area2(points: &[[f64; 2]]) -> f64 {
    let n = points.len();
    (0..n).map(|i| points[i][0] * points[(i + 1) % n][1] - points[(i + 1) % n][0] * points[i][1]).sum()
}

/// Area of loops with holes.
pub(crate) fn area(loops: &[Loop]) -> f64 {
    loops.iter().map(|l| area2(l)).sum::<f64>() / 2.0
}

/// Bounds of loops.
pub(crate) fn bounds(loops: &[Loop]) -> Option<(DVec2, DVec2)> {
    let mut points = loops.iter().flatten().map(|p| DVec2::from_array(*p));
    let first = points.next()?;
    Some(points.fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p))))
}

/// Union of loops that are all anticlockwise (holes clockwise).
fn union(loops: &[Loop]) -> Vec<Loop> {
    let nothing: Vec<Loop> = Vec::new();
    let shapes = loops.overlay(&nothing, OverlayRule::Subject, FillRule::NonZero);
    shapes.into_iter().flatten().filter(|l| l.len() >= 3).collect()
}

/// What a mesh shows: `place` gives the drawing's point and the nearness to the viewer of a mesh point.
pub(crate) fn drawn(thing: usize, mesh: &Arc<Mesh>, place: &dyn Fn(DVec3) -> (DVec2, f64)) -> Drawn {
    let mesh = simple_form(mesh);
    let points: Vec<(DVec2, f64)> = mesh.positions.iter().map(|p| place(p.as_dvec3())).collect();
    let mut by_part: BTreeMap<u32, Vec<[u32; 3]>> = BTreeMap::new();
    let part_of = connected(&mesh, &|_| true);
    for t in mesh.triangles() {
        by_part.entry(part_of[t[0] as usize]).or_default().push(t);
    }
    let mut parts: Vec<Silhouette> = by_part.values().filter_map(|t| silhouette(t, &points)).collect();
    if parts.len() == 1 {
        let triangles: Vec<[u32; 3]> = mesh.triangles().collect();
        parts.extend(steps(&triangles, &points, area(&parts[0].loops)));
    }
    parts.sort_by(|a, b| area(&b.loops).total_cmp(&area(&a.loops)));
    let all: Vec<Loop> = parts.iter().flat_map(|p| p.loops.iter().cloned()).collect();
    let outline = union(&all).iter().map(|l| straightened(l)).filter(|l| l.len() >= 3).collect();
    parts.truncate(MAX_PARTS);
    Drawn { thing, parts, outline }
}

fn silhouette(triangles: &[[u32; 3]], points: &[(DVec2, f64)]) -> Option<Silhouette> {
    let loops: Vec<Loop> = triangles
        .iter()
        .filter_map(|t| {
            let mut l: Loop = t.iter().map(|i| points[*i as usize].0.to_array()).collect();
            let a = area2(&l);
            if a < 0.0 {
                l.reverse();
            }
            (a.abs() > 1e-9).then_some(l)
        })
        .collect();
    let loops: Vec<Loop> =
        union(&loops).iter().map(|l| straightened(l)).filter(|l| l.len() >= 3 && area2(l).abs() > SMALLEST).collect();
    if area(&loops) < SMALLEST {
        return None;
    }
    let near = triangles.iter().flatten().map(|i| points[*i as usize].1).fold(f64::NEG_INFINITY, f64::max);
    Some(Silhouette { loops, near })
}

/// Steps of height that level faces are counted by.
const BINS: usize = 48;

/// Silhouettes of what lies above the largest level faces of a mesh of one part.
fn steps(triangles: &[[u32; 3]], points: &[(DVec2, f64)], whole: f64) -> Vec<Silhouette> {
    let near = |t: &[u32; 3]| t.map(|i| points[i as usize].1);
    let top = triangles.iter().flat_map(near).fold(f64::NEG_INFINITY, f64::max);
    let bottom = triangles.iter().flat_map(near).fold(f64::INFINITY, f64::min);
    if !(top - bottom).is_finite() || top - bottom < 2.0 * STEP {
        return Vec::new();
    }
    // Projected area of faces that look at the viewer, by their nearness.
    let mut level = [0.0; BINS];
    let bin = |n: f64| (((n - bottom) / (top - bottom) * BINS as f64) as usize).min(BINS - 1);
    for t in triangles {
        let [a, b, c] = t.map(|i| points[i as usize]);
        let face = (b.0 - a.0).perp_dot(c.0 - a.0) / 2.0;
        let tilt = [a.1, b.1, c.1].into_iter().fold(f64::NEG_INFINITY, f64::max)
            - [a.1, b.1, c.1].into_iter().fold(f64::INFINITY, f64::min);
        let reach = (b.0 - a.0).length().max((c.0 - a.0).length());
        if face > 0.0 && tilt < 0.5 * reach {
            level[bin((a.1 + b.1 + c.1) / 3.0)] += face;
        }
    }
    let mut found: Vec<(f64, usize)> = (0..BINS)
        .map(|k| (level[k] + if k > 0 { level[k - 1] } else { 0.0 }, k))
        .filter(|(a, k)| *a > 0.15 * whole && *k + 3 < BINS)
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut heights: Vec<f64> = Vec::new();
    for (_, k) in found {
        let h = bottom + (k + 1) as f64 / BINS as f64 * (top - bottom) + STEP / 2.0;
        if heights.len() < 2 && heights.iter().all(|o| (o - h).abs() > 2.0 * STEP) && h < top - STEP / 2.0 {
            heights.push(h);
        }
    }
    heights
        .into_iter()
        .filter_map(|h| {
            let above: Vec<[u32; 3]> =
                triangles.iter().filter(|t| near(t).into_iter().sum::<f64>() / 3.0 > h).copied().collect();
            silhouette(&above, points)
        })
        .filter(|s| (STEP_AREA..=1.0 - STEP_AREA).contains(&(area(&s.loops) / whole.max(1e-9))))
        .collect()
}

/// A closed line with points left out that are less than the tolerance beside it (Douglas and Peucker 1973).
fn straightened(points: &[[f64; 2]]) -> Loop {
    let n = points.len();
    if n < 4 {
        return points.to_vec();
    }
    let p: Vec<DVec2> = points.iter().map(|q| DVec2::from_array(*q)).collect();
    // Two far points stay: the line is two open ones between them.
    let far =
        |from: usize| (0..n).max_by(|a, b| p[*a].distance(p[from]).total_cmp(&p[*b].distance(p[from]))).unwrap_or(0);
    let (a, b) = (far(0), far(far(0)));
    let (a, b) = (a.min(b), a.max(b));
    let mut keep = vec![false; n];
    (keep[a], keep[b]) = (true, true);
    let mut stack = vec![(a, b), (b, a + n)];
    while let Some((from, to)) = stack.pop() {
        let (start, end) = (p[from % n], p[to % n]);
        let along = (end - start).try_normalize();
        let off = |i: usize| {
            let d = p[i % n] - start;
            along.map_or(d.length(), |along| along.perp_dot(d).abs())
        };
        if let Some(worst) = (from + 1..to).max_by(|x, y| off(*x).total_cmp(&off(*y)))
            && off(worst) > TOLERANCE
        {
            keep[worst % n] = true;
            stack.extend([(from, worst), (worst, to)]);
        }
    }
    (0..n).filter(|i| keep[*i]).map(|i| points[i]).collect()
}

/// Lines that no nearer part covers.
pub(crate) fn visible(things: &[Drawn]) -> Vec<Stroke> {
    struct Part<'a> {
        thing: usize,
        silhouette: &'a Silhouette,
        outline: &'a [Loop],
        low: DVec2,
        high: DVec2,
    }
    let mut parts: Vec<Part<'_>> = things
        .iter()
        .flat_map(|d| d.parts.iter().map(move |s| (d, s)))
        .filter_map(|(d, s)| {
            let (low, high) = bounds(&s.loops)?;
            Some(Part { thing: d.thing, silhouette: s, outline: &d.outline, low, high })
        })
        .collect();
    parts.sort_by(|a, b| b.silhouette.near.total_cmp(&a.silhouette.near));
    let rule = ClipRule { invert: true, boundary_included: false };
    let mut out = Vec::new();
    for (i, part) in parts.iter().enumerate() {
        let nearer: Vec<Loop> = parts[..i]
            .iter()
            .filter(|o| o.low.cmplt(part.high).all() && part.low.cmplt(o.high).all())
            .flat_map(|o| o.silhouette.loops.iter().cloned())
            .collect();
        for l in &part.silhouette.loops {
            let mut closed = l.clone();
            closed.push(l[0]);
            let lines = if nearer.is_empty() { vec![closed] } else { closed.clip_by(&nearer, FillRule::NonZero, rule) };
            for line in lines.into_iter().filter(|l| l.len() >= 2) {
                split_by_outline(part.thing, &line, part.outline, &mut out);
            }
        }
    }
    out
}

/// Runs of a line that lie on the thing's outline, and those that do not.
fn split_by_outline(thing: usize, line: &[[f64; 2]], outline: &[Loop], out: &mut Vec<Stroke>) {
    let on = |a: DVec2, b: DVec2| {
        let m = (a + b) / 2.0;
        outline.iter().any(|l| {
            (0..l.len()).any(|i| {
                let (s, e) = (DVec2::from_array(l[i]), DVec2::from_array(l[(i + 1) % l.len()]));
                let t = ((m - s).dot(e - s) / (e - s).length_squared().max(1e-12)).clamp(0.0, 1.0);
                (s + (e - s) * t).distance(m) < 2.0 * TOLERANCE
            })
        })
    };
    let mut run: Option<Stroke> = None;
    for w in line.windows(2) {
        let outer = on(DVec2::from_array(w[0]), DVec2::from_array(w[1]));
        match &mut run {
            Some(stroke) if stroke.outer == outer => stroke.points.push(w[1]),
            _ => out.extend(run.replace(Stroke { thing, points: vec![w[0], w[1]], outer })),
        }
    }
    out.extend(run);
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use harmony_mesh::{Group, Material};

    use super::*;

    /// An upright box between two corners.
    fn boxed(low: Vec3, high: Vec3) -> Mesh {
        let corner = |i: u32| {
            let pick = |bit: u32, l: f32, h: f32| if i & bit == 0 { l } else { h };
            Vec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Mesh {
            positions: (0..8).map(corner).collect(),
            normals: vec![Vec3::Y; 8],
            uvs: vec![glam::Vec2::ZERO; 8],
            groups: vec![Group {
                material: 0,
                triangles: quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect(),
            }],
            materials: vec![Material::plain("m", [0.5; 3])],
            ..Mesh::default()
        }
    }

    /// From above: x right, -z up, nearness is height.
    fn above(p: DVec3) -> (DVec2, f64) {
        (DVec2::new(p.x, -p.z), p.y)
    }

    fn length(strokes: &[Stroke], thing: usize) -> f64 {
        let of = |s: &Stroke| {
            s.points.windows(2).map(|w| DVec2::from_array(w[0]).distance(DVec2::from_array(w[1]))).sum::<f64>()
        };
        strokes.iter().filter(|s| s.thing == thing).map(of).sum()
    }

    #[test]
    fn a_table_top_hides_its_legs_and_half_a_stool() {
        let mut table = boxed(Vec3::new(0.0, 0.7, 0.0), Vec3::new(1.0, 0.75, 0.6));
        table.append(&boxed(Vec3::new(0.1, 0.0, 0.1), Vec3::new(0.15, 0.7, 0.15)));
        let stool = boxed(Vec3::new(0.8, 0.0, 0.2), Vec3::new(1.2, 0.45, 0.4));
        let things = [drawn(0, &Arc::new(table), &above), drawn(1, &Arc::new(stool), &above)];
        assert!((area(&things[0].outline) - 0.6).abs() < 1e-6);
        let lines = visible(&things);
        assert!((length(&lines, 0) - 3.2).abs() < 1e-3, "only the top's own edge: {}", length(&lines, 0));
        // 0.2 m of each long side and one short side stand out.
        assert!((length(&lines, 1) - 0.6).abs() < 1e-3, "{}", length(&lines, 1));
        assert!(lines.iter().all(|s| s.outer));
    }

    #[test]
    fn an_l_shaped_thing_has_an_l_shaped_footprint() {
        let mut sofa = boxed(Vec3::new(0.0, 0.0, 0.0), Vec3::new(2.0, 0.4, 0.8));
        sofa.append(&boxed(Vec3::new(1.2, 0.0, 0.7), Vec3::new(2.0, 0.4, 1.8)));
        let d = drawn(0, &Arc::new(sofa), &above);
        assert!((area(&d.outline) - (1.6 + 0.8)).abs() < 1e-4, "{}", area(&d.outline));
        assert_eq!(d.outline.len(), 1);
        assert_eq!(d.outline[0].len(), 6, "{:?}", d.outline);
    }
}
