//! Bars along a line and bent boards.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DVec2, DVec3};

use super::{Whole, smooth_path};
use crate::part_model::Part;
use crate::part_model::solid::SolidBuilder;

/// A round bar along a path.
pub(super) fn tube(b: &mut SolidBuilder, half: DVec3, part: &Part, whole: &Whole) {
    let radius = (part.thickness.unwrap_or(0.06).clamp(0.002, 1.0) * whole.smallest / 2.0).max(2e-4);
    // never thicker than half of the box's larger sides
    let mut sides = half.to_array();
    sides.sort_by(f64::total_cmp);
    let radius = radius.min(sides[1] * 0.9).max(1e-4);
    let inside = (half - DVec3::splat(radius)).max(DVec3::ZERO);
    let given = part.path.as_deref().unwrap_or(&[]);
    let mut line: Vec<DVec3> = given
        .iter()
        .map(|p| (DVec3::from_array(*p).clamp(DVec3::ZERO, DVec3::ONE) * 2.0 - DVec3::ONE) * inside)
        .collect();
    line.dedup_by(|a, b| a.distance(*b) < radius * 0.05);
    let mut closed = part.closed.unwrap_or(false);
    if closed && line.len() > 1 && line[0].distance(line[line.len() - 1]) < radius * 0.05 {
        line.pop();
    }
    if line.len() < 2 {
        line = vec![DVec3::new(0.0, -inside.y.max(radius), 0.0), DVec3::new(0.0, inside.y.max(radius), 0.0)];
    }
    closed &= line.len() > 2;
    let corners = line.clone();
    line = if part.smooth.unwrap_or(false) { smooth_path(&line, 5, closed) } else { fillet(&line, radius, closed) };
    line.dedup_by(|a, b| a.distance(*b) < radius * 0.02);
    sweep_circle(b, &line, radius, whole.sides(radius).min(12), closed);
    let mut segments: Vec<[DVec3; 2]> = corners.windows(2).map(|w| [w[0], w[1]]).collect();
    if closed {
        segments.push([corners[corners.len() - 1], corners[0]]);
    }
    for [p, q] in segments.into_iter().take(16) {
        let axis = (q - p).normalize_or(DVec3::Y);
        let (u, v) = axis.any_orthonormal_pair();
        let around = (0..8).map(|k| DVec2::from_angle(TAU * f64::from(k) / 8.0) * radius);
        b.piece(around.flat_map(|c| [p + u * c.x + v * c.y, q + u * c.x + v * c.y]).collect());
    }
}

/// Rounds the corners of a polyline by arcs of about three radii.
fn fillet(line: &[DVec3], radius: f64, closed: bool) -> Vec<DVec3> {
    let n = line.len();
    let mut out = Vec::with_capacity(n * 4);
    for i in 0..n {
        if !closed && (i == 0 || i == n - 1) {
            out.push(line[i]);
            continue;
        }
        let (before, here, after) = (line[(i + n - 1) % n], line[i], line[(i + 1) % n]);
        let (d0, d1) = (before - here, after - here);
        let cut = (radius * 3.0).min(d0.length() * 0.45).min(d1.length() * 0.45);
        let (p, q) = (here + d0.normalize_or_zero() * cut, here + d1.normalize_or_zero() * cut);
        if d0.normalize_or_zero().dot(d1.normalize_or_zero()) < -0.99 {
            out.push(here);
            continue;
        }
        for k in 0..=4 {
            let t = f64::from(k) / 4.0;
            out.push(p * (1.0 - t).powi(2) + here * 2.0 * t * (1.0 - t) + q * t * t);
        }
    }
    out
}

fn sweep_circle(b: &mut SolidBuilder, line: &[DVec3], radius: f64, sides: usize, closed: bool) {
    let n = line.len();
    let tangent = |i: usize| {
        let (a, c) = if closed {
            (line[(i + n - 1) % n], line[(i + 1) % n])
        } else {
            (line[i.saturating_sub(1)], line[(i + 1).min(n - 1)])
        };
        (c - a).normalize_or(DVec3::Y)
    };
    // frames carried along without twist
    let mut frames: Vec<(DVec3, DVec3)> = Vec::with_capacity(n);
    let mut u = tangent(0).any_orthonormal_vector();
    for i in 0..n {
        let t = tangent(i);
        u = (u - t * u.dot(t)).try_normalize().unwrap_or_else(|| t.any_orthonormal_vector());
        frames.push((u, t.cross(u)));
    }
    // a closed line's twist is spread over its length
    let twist = if closed {
        let t = tangent(0);
        let end = (u - t * u.dot(t)).normalize_or(frames[0].0);
        f64::atan2(end.dot(frames[0].1), end.dot(frames[0].0))
    } else {
        0.0
    };
    let ring = |i: usize, k: usize| {
        let j = i % n;
        let (u, v) = frames[j];
        let untwist = -twist * j as f64 / n as f64;
        let c = DVec2::from_angle(TAU * (k % sides) as f64 / sides as f64 + untwist);
        let normal = u * c.x + v * c.y;
        (line[j] + normal * radius, normal)
    };
    let group = b.group();
    let rows = if closed { n } else { n - 1 };
    b.patch_with_normals(group, sides, rows, |k, i| ring(i, k));
    if !closed {
        let mut start: Vec<DVec3> = (0..sides).map(|k| ring(0, k).0).collect();
        start.reverse();
        b.flat_convex(&start, -tangent(0));
        let end: Vec<DVec3> = (0..sides).map(|k| ring(n - 1, k).0).collect();
        b.flat_convex(&end, tangent(n - 1));
    }
}

/// A board bent about +Y: its middle lies at the back (-Z), its ends reach forward.
pub(super) fn back(b: &mut SolidBuilder, half: DVec3, part: &Part, whole: &Whole) {
    let alpha = part.bend_deg.unwrap_or(60.0).clamp(5.0, 330.0).to_radians() / 2.0;
    let thickness = part.thickness.unwrap_or(0.12).clamp(0.005, 1.0) * whole.smallest;
    let thickness = thickness.min(half.x * 0.9).min(half.z * 1.6).max(2e-4);
    let widest = alpha.min(FRAC_PI_2).sin();
    let outer = |a: f64| DVec2::new(half.x * a.sin() / widest, -a.cos() / (1.0 - alpha.cos()));
    let reach = (2.0 * half.z - thickness * alpha.cos().max(0.0)).max(half.z * 0.2);
    // outer curve and its inward normal
    let curve = |a: f64| {
        let p = outer(a);
        let position = DVec2::new(p.x, p.y * reach);
        let e = 1e-4;
        let step = outer(a + e) - outer(a - e);
        let along = DVec2::new(step.x, step.y * reach).normalize_or(DVec2::X);
        (position, DVec2::new(-along.y, along.x))
    };
    let edge = (part.round.unwrap_or(0.35).clamp(0.0, 0.5) * thickness).min(half.y * 0.9);
    let corner_steps = if edge < 0.001 * whole.largest { 0 } else { whole.bevel_segments(edge) + 1 };
    // section (inward, up) around its middle with normals, counter-clockwise
    let (hw, hy) = (thickness / 2.0, half.y);
    let mut loop_points: Vec<(DVec2, DVec2)> = Vec::new();
    for quarter in 0..4 {
        let (sx, sy) = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)][quarter];
        for k in 0..=corner_steps {
            let t = if corner_steps == 0 { 0.5 } else { k as f64 / corner_steps as f64 };
            let n = DVec2::from_angle(FRAC_PI_2 * (quarter as f64 + t));
            let r = if corner_steps == 0 { DVec2::new(sx, sy) * edge } else { n * edge };
            loop_points.push((DVec2::new(sx * (hw - edge), sy * (hy - edge)) + r, n));
        }
    }
    let stations = ((alpha * 2.0).to_degrees() / 9.0).ceil().clamp(6.0, 36.0) as usize;
    let length = 2.0 * alpha * half.x.max(half.z);
    let lead = (edge / length).min(0.2 / stations as f64);
    let mut angles: Vec<(f64, f64)> = vec![(-alpha, edge), (-alpha * (1.0 - 2.0 * lead), 0.0)];
    angles.extend((1..stations).map(|k| (alpha * (2.0 * k as f64 / stations as f64 - 1.0), 0.0)));
    angles.extend([(alpha * (1.0 - 2.0 * lead), 0.0), (alpha, edge)]);
    let ends = part.top.unwrap_or(1.0).clamp(0.1, 1.0);
    // the rim falls towards the ends
    let level = |a: f64, y: f64| {
        let t = ((a.abs() / alpha - 0.3) / 0.6).clamp(0.0, 1.0);
        -hy + (y + hy) * (1.0 - (1.0 - ends) * t * t * (3.0 - 2.0 * t))
    };
    let place = |i: usize, k: usize| {
        let (a, inset) = angles[i];
        let (p, inward) = curve(a);
        let (s, n) = loop_points[k % loop_points.len()];
        let s = s - n * inset.min(hw * 0.9).min(hy * 0.9) * f64::from(u8::from(corner_steps > 0));
        let q = p + inward * (hw + s.x);
        let normal = DVec3::new(inward.x * n.x, n.y, inward.y * n.x);
        (DVec3::new(q.x, level(a, s.y), q.y), normal.normalize_or(DVec3::Y))
    };
    let n = loop_points.len();
    if corner_steps == 0 {
        for k in 0..n {
            let group = b.group();
            b.patch(group, angles.len() - 1, 1, |i, j| place(i, k + j).0);
        }
    } else {
        let group = b.group();
        b.patch_with_normals(group, angles.len() - 1, n, place);
    }
    for (i, reverse) in [(0, false), (angles.len() - 1, true)] {
        let mut outline: Vec<DVec3> = (0..n).map(|k| place(i, k).0).collect();
        if reverse {
            outline.reverse();
        }
        let e = (outline[1] - outline[0]).cross(outline[n / 2] - outline[0]);
        b.flat_convex(&outline, e.normalize_or(DVec3::Z));
    }
    let pieces = (alpha.to_degrees() / 22.5).ceil().clamp(1.0, 8.0) as usize;
    for s in 0..pieces {
        let angle = |k: usize| alpha * (k as f64 / pieces as f64 - 1.0);
        let wedge = (0..=4).flat_map(|k| {
            let a = angle(2 * s) + (angle(2 * s + 2) - angle(2 * s)) * f64::from(k) / 4.0;
            let (p, inward) = curve(a);
            [(a, p), (a, p + inward * thickness)]
        });
        b.piece(wedge.flat_map(|(a, q)| [-hy, hy].map(|y| DVec3::new(q.x, level(a, y), q.y))).collect());
    }
    // exactly into the box
    b.map_points(|lo, hi, p| {
        let (c, h) = ((lo + hi) / 2.0, (hi - lo) / 2.0);
        DVec3::new((p.x - c.x) * half.x / h.x.max(1e-9), p.y, (p.z - c.z) * half.z / h.z.max(1e-9)).clamp(-half, half)
    });
}
