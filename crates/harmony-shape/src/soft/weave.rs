//! Strands: braids, basket work, wire nets.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::grid::{along, lengths, square_to, tube, weld};
use crate::Piece;
use crate::tree::Outline;

/// Most triangles of basket work or a net.
const MAX_TRIANGLES: f64 = 80_000.0;

/// `strands` plaited along a polyline, the whole of `radius`, one turn in `pitch` metres.
///
/// Two strands are twisted; three and more go from side to side over and under each other.
pub fn braid(curve: &[DVec3], closed: bool, radius: f64, strands: u32, pitch: f64) -> Piece {
    let mut piece = Piece { closed: true, ..Piece::default() };
    let mut curve = curve.to_vec();
    if closed && curve.len() > 2 {
        curve.push(curve[0]);
    }
    let lengths = lengths(&curve);
    let whole = lengths.last().copied().unwrap_or(0.0);
    if whole < 1e-4 {
        return piece;
    }
    let strands = strands.clamp(2, 9);
    let radius = radius.clamp(0.0005, 0.5);
    let pitch = pitch.max(radius).max(whole / 400.0);
    // A closed braid has whole turns.
    let turns = if closed { (whole / pitch).round().max(1.0) } else { whole / pitch };
    let steps = ((turns * 14.0).ceil() as usize).clamp(8, 2400);
    // Frames carried along the centre line without twist.
    let mut side = square_to(along(&curve, &lengths, 0.0).1);
    let frames: Vec<(DVec3, DVec3, DVec3)> = (0..=steps)
        .map(|k| {
            let (p, d) = along(&curve, &lengths, whole * k as f64 / steps as f64);
            side = (side - d * side.dot(d)).normalize_or(square_to(d));
            (p, side, d.cross(side))
        })
        .collect();
    let plaited = strands > 2;
    let thick = radius * if plaited { 0.9 / f64::from(strands - 1).sqrt() * 0.72 } else { 0.5 };
    for strand in 0..strands {
        let phase = f64::from(strand) / f64::from(strands);
        let points: Vec<DVec3> = frames
            .iter()
            .enumerate()
            .map(|(k, (p, a, b))| {
                let t = turns * k as f64 / steps as f64 + phase;
                let (s, c) = libm::sincos(TAU * t);
                let reach = radius - thick;
                if plaited {
                    // A figure of eight: across once, over and under twice.
                    *p + *a * (reach * s) + *b * (thick * 1.05 * libm::sin(2.0 * TAU * t))
                } else {
                    *p + *a * (reach * s) + *b * (reach * c)
                }
            })
            .collect();
        tube(&mut piece, &points, &[thick], 7, false);
    }
    piece
}

/// A piece's surface as basket work instead of the piece: strands of `radius`, `cell` apart, over and under.
///
/// Strands follow the cuts of the surface with planes square to two axes (those that it does not face).
pub fn wicker(child: &Piece, cell: f64, radius: f64) -> Piece {
    let mut piece = Piece { closed: true, ..Piece::default() };
    let Some((lo, hi)) = child.bounds() else { return piece };
    let area: f64 = child.triangles.iter().map(|t| face(child, t).length() / 2.0).sum();
    let radius = radius.clamp(0.0003, 0.1);
    // Two families, two points a cell, eight triangles each.
    let least = (area * 2.0 * 2.0 * 8.0 / MAX_TRIANGLES).sqrt();
    let cell = cell.max(2.2 * radius).max(least).max((hi - lo).max_element() / 300.0);
    let group = weld(&child.positions);
    for axis in 0..3 {
        let mut plane = lo[axis] + cell * 0.5 + 1e-6 * std::f64::consts::E;
        let mut number = 0_u32;
        while plane < hi[axis] {
            for line in cuts(child, &group, axis, plane) {
                strand(&mut piece, &line, cell, radius, number);
            }
            plane += cell;
            number += 1;
        }
    }
    piece
}

/// Twice the area of a triangle along its normal.
fn face(piece: &Piece, t: &[u32; 3]) -> DVec3 {
    let [a, b, c] = t.map(|i| piece.positions[i as usize]);
    (b - a).cross(c - a)
}

/// Points with normals where a plane cuts the surface, joined to lines. Parts that face along the axis are left out.
fn cuts(piece: &Piece, group: &[u32], axis: usize, plane: f64) -> Vec<Vec<(DVec3, DVec3)>> {
    type Edge = (u32, u32);
    let mut points: BTreeMap<Edge, (DVec3, DVec3)> = BTreeMap::new();
    let mut links: BTreeMap<Edge, Vec<Edge>> = BTreeMap::new();
    for t in &piece.triangles {
        let n = face(piece, t).normalize_or(DVec3::ZERO);
        if n[axis].abs() > 0.75 {
            continue;
        }
        let mut ends: Vec<Edge> = Vec::with_capacity(2);
        for k in 0..3 {
            let (i, j) = (t[k] as usize, t[(k + 1) % 3] as usize);
            let (p, q) = (piece.positions[i], piece.positions[j]);
            if (p[axis] < plane) == (q[axis] < plane) {
                continue;
            }
            let s = (plane - p[axis]) / (q[axis] - p[axis]);
            let name = (group[i].min(group[j]), group[i].max(group[j]));
            let entry = points.entry(name).or_insert((p.lerp(q, s), DVec3::ZERO));
            entry.1 += n;
            ends.push(name);
        }
        if let [a, b] = ends[..] {
            links.entry(a).or_default().push(b);
            links.entry(b).or_default().push(a);
        }
    }
    let mut lines = Vec::new();
    // Open lines first, from their ends; then what is left are rings.
    for only_ends in [true, false] {
        let starts: Vec<Edge> = links.iter().filter(|(_, l)| !only_ends || l.len() == 1).map(|(k, _)| *k).collect();
        for start in starts {
            let mut line = vec![points[&start]];
            let mut at = start;
            while let Some(next) = links.get_mut(&at).and_then(Vec::pop) {
                if let Some(back) = links.get_mut(&next)
                    && let Some(k) = back.iter().position(|b| *b == at)
                {
                    back.swap_remove(k);
                }
                line.push(points[&next]);
                at = next;
            }
            if line.len() > 1 {
                lines.push(line);
            }
        }
    }
    lines
}

/// A strand that goes over and under along a line of points with normals.
fn strand(piece: &mut Piece, line: &[(DVec3, DVec3)], cell: f64, radius: f64, number: u32) {
    let centres: Vec<DVec3> = line.iter().map(|l| l.0).collect();
    let lengths = lengths(&centres);
    let whole = lengths[lengths.len() - 1];
    if whole < cell * 0.5 {
        return;
    }
    let steps = ((whole / cell * 2.0).round() as usize).max(2);
    let mut points = Vec::with_capacity(steps + 1);
    let mut k = 0;
    for m in 0..=steps {
        let s = whole * m as f64 / steps as f64;
        while k + 2 < lengths.len() && lengths[k + 1] < s {
            k += 1;
        }
        let (p, _) = along(&centres, &lengths, s);
        let normal = (line[k].1.normalize_or(DVec3::Y) + line[k + 1].1.normalize_or(DVec3::Y)).normalize_or(DVec3::Y);
        let wave = libm::cos(PI * (s / cell + f64::from(number)));
        points.push(p + normal * (radius * 0.9 * wave));
    }
    tube(piece, &points, &[radius], 4, false);
}

/// A wire net within an outline, in the xy plane, with a rim along the outline and its holes.
pub fn wire_net(outline: &Outline, pitch: f64, radius: f64) -> Piece {
    let mut piece = Piece { closed: true, ..Piece::default() };
    net(outline, pitch, radius.clamp(0.0002, 0.05), &mut piece);
    piece
}

fn net(outline: &Outline, pitch: f64, radius: f64, piece: &mut Piece) {
    let mut loops = vec![&outline.points];
    loops.extend(&outline.holes);
    let all = || loops.iter().flat_map(|l| l.iter());
    let span = |k: usize| all().fold((f64::MAX, f64::MIN), |(lo, hi), p| (lo.min(p[k]), hi.max(p[k])));
    if outline.points.len() < 3 {
        return;
    }
    let ((x0, x1), (y0, y1)) = (span(0), span(1));
    let pitch = pitch
        .max(2.5 * radius)
        .max(((x1 - x0) * (y1 - y0) * 16.0 / MAX_TRIANGLES).sqrt() / 2.0)
        .max((x1 - x0).max(y1 - y0) / 400.0);
    for axis in 0..2 {
        let (lo, hi) = if axis == 0 { (x0, x1) } else { (y0, y1) };
        let count = ((hi - lo) / pitch).round().max(1.0);
        for k in 0..count as usize {
            let v = lo + (hi - lo) * (k as f64 + 0.5) / count;
            // Where the line crosses the loops, in pairs.
            let mut crossings: Vec<f64> = Vec::new();
            for points in &loops {
                for (i, p) in points.iter().enumerate() {
                    let q = points[(i + 1) % points.len()];
                    if (p[axis] < v) != (q[axis] < v) {
                        crossings.push(p[1 - axis] + (q[1 - axis] - p[1 - axis]) * (v - p[axis]) / (q[axis] - p[axis]));
                    }
                }
            }
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let z = if axis == 0 { radius * 0.8 } else { -radius * 0.8 };
                let end = |w: f64| if axis == 0 { DVec3::new(v, w, z) } else { DVec3::new(w, v, z) };
                tube(piece, &[end(pair[0]), end(pair[1])], &[radius, radius], 5, false);
            }
        }
    }
    for points in &loops {
        let ring: Vec<DVec3> = points.iter().map(|p| DVec3::new(p[0], p[1], 0.0)).collect();
        tube(piece, &ring, &[radius * 1.8], 6, true);
    }
    for island in &outline.islands {
        net(island, pitch, radius, piece);
    }
}

#[cfg(test)]
mod tests {
    use super::super::collider::tests::block;
    use super::super::grid::testing::sound;
    use super::*;

    #[test]
    fn braids_stay_within_their_radius() {
        let curve: Vec<DVec3> = (0..20).map(|k| DVec3::new(f64::from(k) * 0.02, 0.0, 0.0)).collect();
        for strands in [2, 3, 5] {
            let b = braid(&curve, false, 0.01, strands, 0.05);
            sound(&b);
            let far = b.positions.iter().map(|p| p.y.hypot(p.z)).fold(0.0, f64::max);
            assert!((0.008..0.0115).contains(&far), "{strands}: {far}");
        }
    }

    #[test]
    fn basket_work_covers_the_box_and_goes_over_and_under() {
        let b = block(DVec3::new(-0.2, 0.0, -0.2), DVec3::new(0.2, 0.3, 0.2));
        let w = wicker(&b, 0.03, 0.004);
        sound(&w);
        let (lo, hi) = w.bounds().unwrap();
        let size = hi - lo;
        assert!((size.x - 0.4).abs() < 0.03 && (size.y - 0.3).abs() < 0.03, "{lo} {hi}");
        // Centres of strands on the front stand before and behind it.
        let front = w.positions.iter().filter(|p| p.x.abs() < 0.15 && (0.05..0.25).contains(&p.y) && p.z > 0.15);
        let (near, far) = front.fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p.z), b.max(p.z)));
        assert!(far > 0.205 && near < 0.195, "{near} {far}");
        assert!(w.triangles.len() as f64 <= MAX_TRIANGLES * 1.5);
        assert!(wicker(&b, 0.0001, 0.00001).triangles.len() as f64 <= MAX_TRIANGLES * 2.0);
    }

    #[test]
    fn a_net_keeps_to_its_outline_and_out_of_its_holes() {
        let outline = Outline {
            points: vec![[0.0, 0.0], [1.0, 0.0], [1.0, 0.6], [0.0, 0.6]],
            holes: vec![vec![[0.4, 0.2], [0.4, 0.4], [0.6, 0.4], [0.6, 0.2]]],
            islands: Vec::new(),
        };
        let n = wire_net(&outline, 0.05, 0.001);
        sound(&n);
        let (lo, hi) = n.bounds().unwrap();
        assert!(lo.x > -0.004 && hi.x < 1.004 && hi.y < 0.604 && hi.z < 0.003);
        assert!(!n.positions.iter().any(|p| (p.x - 0.5).abs() < 0.09 && (p.y - 0.3).abs() < 0.09));
    }
}
