//! Outlines pulled along an axis, and bent sheets.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat3, DVec2, DVec3};

use super::collect::Collector;
use super::math::{left, sin_cos, turned};
use super::outline::{self, CREASE, Island};
use crate::Piece;
use crate::tree::{Axis, Outline};

/// Largest turn of a bend or twist between two rows, degrees.
const STEP_DEG: f64 = 5.0;

/// What is pulled, how far and how.
#[derive(Debug, Clone, Copy)]
pub struct Extrusion<'a> {
    /// The outline.
    pub outline: &'a Outline,
    /// Length, metres.
    pub depth: f64,
    /// Along which axis.
    pub axis: Axis,
    /// Edge radius of both ends, metres.
    pub bevel: f64,
    /// Bend over the whole length, degrees.
    pub bend_deg: f64,
    /// Twist over the whole length, degrees.
    pub twist_deg: f64,
}

/// An outline pulled along an axis: closed, with holes and islands, ends rounded.
///
/// The outline's (x, y) become (x, y), (-z, y) or (x, -z) for the axes z, x, y; the piece is centred on x or z, or
/// stands on y = 0. A bend leads towards +y, for y towards +z.
///
/// # Errors
/// When the outline spans no area.
pub fn extrude(e: &Extrusion<'_>) -> Result<Piece, String> {
    let islands = outline::islands(e.outline)?;
    Ok(pulled(&islands, e, CREASE))
}

fn pulled(islands: &[Island], e: &Extrusion<'_>, crease: f64) -> Piece {
    let depth = e.depth.max(1e-5);
    let bevel = e.bevel.clamp(0.0, (depth * 0.499).min(outline::safe_inset(islands).max(0.0)));
    let steps = if bevel < 2e-5 {
        0
    } else if bevel < 0.004 {
        2
    } else {
        4
    };
    let turn = e.bend_deg.abs().max(e.twist_deg.abs());
    let rows = ((turn / STEP_DEG).ceil() as usize).clamp(1, 90);
    let mut out = Collector::new();
    // (inset, place along, outward share of the normal, axial share, length along the surface)
    let mut profile: Vec<[f64; 5]> = Vec::new();
    let arc = |k: usize| {
        let (s, c) = sin_cos(FRAC_PI_2 * k as f64 / steps.max(1) as f64);
        (s, c, bevel * FRAC_PI_2 * k as f64 / steps.max(1) as f64)
    };
    if steps > 0 {
        for k in 0..=steps {
            let (s, c, length) = arc(k);
            profile.push([bevel * (1.0 - s), bevel * (1.0 - c), s, -c, length]);
        }
    } else {
        profile.push([0.0, 0.0, 1.0, 0.0, 0.0]);
    }
    let (low, high) = if steps > 0 { (bevel, depth - bevel) } else { (0.0, depth) };
    let reached = profile[profile.len() - 1][4];
    for k in 1..=rows {
        let t = (high - low) * k as f64 / rows as f64;
        profile.push([0.0, low + t, 1.0, 0.0, reached + t]);
    }
    if steps > 0 {
        let base = profile[profile.len() - 1][4];
        for k in 1..=steps {
            let (s, c, length) = arc(k);
            profile.push([bevel * (1.0 - c), depth - bevel * (1.0 - s), c, s, base + length]);
        }
    }
    let (lo, hi) = outline::bounds(islands);
    for island in islands {
        for points in &island.loops {
            for run in outline::runs(points, crease) {
                let group = out.group();
                out.grid(group, run.len() - 1, profile.len() - 1, |i, j| {
                    let (c, [inset, t, side, axial, v]) = (run[i], profile[j]);
                    let p = c.p + c.inset * inset;
                    (p.extend(t), (c.normal * side).extend(axial), DVec2::new(c.u, v))
                });
            }
        }
        let inset: Vec<Vec<DVec2>> = island
            .loops
            .iter()
            .map(|l| l.iter().zip(outline::miters(l)).map(|(p, m)| *p + m * profile[0][0]).collect())
            .collect();
        let caps = outline::triangles(&inset);
        for end in [false, true] {
            let group = out.group();
            let normal = if end { DVec3::Z } else { DVec3::NEG_Z };
            let first: Vec<u32> = inset
                .iter()
                .flatten()
                .map(|p| {
                    let u = if end { p.x - lo.x } else { hi.x - p.x };
                    out.vertex(group, p.extend(if end { depth } else { 0.0 }), normal, DVec2::new(u, hi.y - p.y))
                })
                .collect();
            for t in &caps {
                let [a, b, c] = t.map(|i| first[i as usize]);
                out.triangle(if end { [a, b, c] } else { [a, c, b] });
            }
        }
    }
    place(out.finish(), depth, e)
}

/// Bends, twists and turns the piece from (outline x, outline y, along) into its axes.
fn place(piece: Piece, depth: f64, e: &Extrusion<'_>) -> Piece {
    let start = if e.axis == Axis::Y { 0.0 } else { -depth / 2.0 };
    let (bend, twist) = (e.bend_deg.to_radians(), e.twist_deg.to_radians());
    // for the y axis +z is the outline's -y
    let sign = if e.axis == Axis::Y { -1.0 } else { 1.0 };
    let shape = |p: DVec3| {
        let along = p.z + start;
        let flat = if twist == 0.0 { p.truncate() } else { turned(p.truncate(), twist * p.z / depth) };
        if bend.abs() < 1e-6 {
            return flat.extend(along);
        }
        let radius = depth / bend;
        let (s, c) = sin_cos(bend * along / depth);
        let arm = radius - sign * flat.y;
        DVec3::new(flat.x, sign * (radius - arm * c), arm * s)
    };
    let axes = match e.axis {
        Axis::Z => DMat3::IDENTITY,
        Axis::X => DMat3::from_cols(DVec3::NEG_Z, DVec3::Y, DVec3::X),
        Axis::Y => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
    };
    if bend == 0.0 && twist == 0.0 {
        let mut piece = piece;
        for p in &mut piece.positions {
            *p = axes * shape(*p);
        }
        for n in &mut piece.normals {
            *n = axes * *n;
        }
        return piece;
    }
    piece.deformed(|p| axes * shape(p))
}

/// A profile line with thickness, pulled along an axis.
#[derive(Debug, Clone, Copy)]
pub struct BentSheet<'a> {
    /// Points of the line: (z, y) along x, (x, y) along z, (x, z) upright.
    pub profile: &'a [[f64; 2]],
    /// Length along the axis, metres.
    pub width: f64,
    /// Thickness, metres.
    pub thick: f64,
    /// Smooth across the profile's corners.
    pub smooth: bool,
    /// Along which axis.
    pub axis: Axis,
}

/// A sheet that follows a profile line: corrugation, blade, arch, folded paper.
///
/// # Errors
/// When the profile has fewer than two points.
pub fn bent_sheet(sheet: &BentSheet<'_>) -> Result<Piece, String> {
    let mut line: Vec<DVec2> = Vec::new();
    for [a, b] in sheet.profile {
        // into the outline's coordinates of the axis
        let p = match sheet.axis {
            Axis::X => DVec2::new(-a, *b),
            Axis::Z => DVec2::new(*a, *b),
            Axis::Y => DVec2::new(*a, -b),
        };
        if line.last().is_none_or(|q| q.distance_squared(p) > 1e-12) {
            line.push(p);
        }
    }
    if line.len() < 2 {
        return Err("a bent sheet needs a profile of at least two points".into());
    }
    let half = if sheet.thick > 0.0 { sheet.thick / 2.0 } else { 5e-4 };
    let d: Vec<DVec2> = line.windows(2).map(|w| (w[1] - w[0]).normalize_or(DVec2::X)).collect();
    let offset = |i: usize, side: f64| {
        let (a, b) = (left(d[i.saturating_sub(1)]), left(d[i.min(d.len() - 1)]));
        let m = ((a + b) / (1.0 + a.dot(b)).max(0.1)).clamp_length_max(2.0);
        line[i] + m * (half * side)
    };
    let n = line.len();
    let around: Vec<DVec2> = (0..n).map(|i| offset(i, -1.0)).chain((0..n).rev().map(|i| offset(i, 1.0))).collect();
    let crease = if sheet.smooth { 1.4 } else { 0.35 };
    let island = if outline::signed_area(&around) < 0.0 { around.into_iter().rev().collect() } else { around };
    let whole = Extrusion {
        outline: &Outline::default(),
        depth: sheet.width,
        axis: sheet.axis,
        bevel: 0.0,
        bend_deg: 0.0,
        twist_deg: 0.0,
    };
    Ok(pulled(&[Island { loops: vec![island] }], &whole, crease))
}
