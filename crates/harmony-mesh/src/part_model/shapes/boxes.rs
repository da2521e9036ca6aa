//! Boxes, boards and upholstery.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{DVec2, DVec3};

use super::Whole;
use crate::part_model::solid::SolidBuilder;

/// Edge radii below this share of the object are drawn sharp.
const SHARP: f64 = 0.001;

/// Thickness of a pillow's seam as a share of its own.
const SEAM: f64 = 0.05;

/// A box with rounded edges; `round` is a fraction of the smallest side.
pub(super) fn rounded_box(b: &mut SolidBuilder, half: DVec3, round: f64, whole: &Whole) {
    let radius = round.clamp(0.0, 0.5) * 2.0 * half.min_element();
    if radius < SHARP * whole.largest {
        plain_box(b, half);
    } else {
        grid_box(b, half, radius, whole.bevel_segments(radius), [1; 3], None);
    }
    b.piece_of_all();
}

fn plain_box(b: &mut SolidBuilder, half: DVec3) {
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let (u, v) = face_axes(axis, sign);
            let corner = |a: f64, c: f64| {
                let mut p = DVec3::ZERO;
                p[axis] = sign * half[axis];
                p[u] = a * half[u];
                p[v] = c * half[v];
                p
            };
            let group = b.group();
            let mut normal = DVec3::ZERO;
            normal[axis] = sign;
            b.patch_with_normals(group, 1, 1, |i, j| (corner(i as f64 * 2.0 - 1.0, j as f64 * 2.0 - 1.0), normal));
        }
    }
}

/// Axes `(u, v)` of a face so that u x v is the outward normal.
fn face_axes(axis: usize, sign: f64) -> (usize, usize) {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    if sign > 0.0 { (u, v) } else { (v, u) }
}

/// Six grids that meet in the middle of the rounded edges; `inner` divisions of the flat middle along each axis; `shape` moves points
/// afterwards (normals are then taken from the faces).
fn grid_box(
    b: &mut SolidBuilder,
    half: DVec3,
    radius: f64,
    segments: usize,
    inner: [usize; 3],
    shape: Option<&dyn Fn(DVec3) -> DVec3>,
) {
    let samples = |h: f64, inner: usize| -> Vec<(f64, f64)> {
        let core = (h - radius).max(0.0);
        let angle = |k: usize| (FRAC_PI_4 * k as f64 / segments as f64).tan();
        let low = (0..=segments).map(|k| (-core, -angle(segments - k)));
        let middle = (1..inner).map(|k| (core * (2.0 * k as f64 / inner as f64 - 1.0), 0.0));
        let high = (0..=segments).map(|k| (core, angle(k)));
        low.chain(middle).chain(high).collect()
    };
    let along = [0, 1, 2].map(|k| samples(half[k], inner[k]));
    let group = b.group();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let (u, v) = face_axes(axis, sign);
            b.patch_with_normals(group, along[u].len() - 1, along[v].len() - 1, |i, j| {
                let ((cu, tu), (cv, tv)) = (along[u][i], along[v][j]);
                let (mut core, mut dir) = (DVec3::ZERO, DVec3::ZERO);
                core[axis] = sign * (half[axis] - radius).max(0.0);
                core[u] = cu;
                core[v] = cv;
                dir[axis] = sign;
                dir[u] = tu;
                dir[v] = tv;
                let normal = dir.normalize_or(DVec3::Y);
                let p = core + normal * radius;
                shape.map_or((p, normal), |f| (f(p), DVec3::ZERO))
            });
        }
    }
}

/// A board: rounded outline across its thinnest side, rounded rim.
pub(super) fn slab(b: &mut SolidBuilder, half: DVec3, corner: f64, round: f64, whole: &Whole) {
    let thin = (0..3).fold(0, |best, k| if half[k] < half[best] { k } else { best });
    let (u, v) = face_axes(thin, 1.0);
    let corner = corner.clamp(0.0, 0.5) * 2.0 * half[u].min(half[v]);
    let rim = (round.clamp(0.0, 0.5) * 2.0 * half[thin]).min(corner * 0.9);
    let steps = if corner < SHARP * whole.largest { 0 } else { (whole.sides(corner) / 4).max(2) };
    let rim = if rim < SHARP * whole.largest { 0.0 } else { rim };
    // outline with outward normals, counter-clockwise in (u, v)
    let mut outline: Vec<(DVec2, DVec2)> = Vec::new();
    for quarter in 0..4 {
        let (su, sv) = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)][quarter];
        let centre = DVec2::new(su * (half[u] - corner), sv * (half[v] - corner));
        for k in 0..=steps {
            let t = if steps == 0 { 0.5 } else { k as f64 / steps as f64 };
            let n = DVec2::from_angle(FRAC_PI_2 * (quarter as f64 + t));
            outline.push((centre + n * corner, n));
        }
    }
    if steps == 0 {
        for (k, point) in outline.iter_mut().enumerate() {
            let (su, sv) = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)][k];
            point.0 = DVec2::new(su * half[u], sv * half[v]);
        }
    }
    let rim_steps = if rim > 0.0 { whole.bevel_segments(rim) + 1 } else { 0 };
    // profile: (height, inset), bottom to top
    let mut profile: Vec<(f64, f64, f64)> = Vec::new(); // height, inset, slope of the normal
    let h = half[thin];
    for k in 0..=rim_steps {
        let a = if rim_steps == 0 { 0.0 } else { FRAC_PI_2 * (1.0 - k as f64 / rim_steps as f64) };
        profile.push((-(h - rim) - rim * a.sin(), rim * (1.0 - a.cos()), -a));
    }
    for k in (0..=rim_steps).rev() {
        let (height, inset, a) = profile[k];
        profile.push((-height, inset, -a));
    }
    let place = |p: DVec2, height: f64| {
        let mut out = DVec3::ZERO;
        out[thin] = height;
        out[u] = p.x;
        out[v] = p.y;
        out
    };
    let n = outline.len();
    let at = |i: usize, j: usize| {
        let ((p, normal), (height, inset, a)) = (outline[i % n], profile[j]);
        (place(p - normal * inset, height), place(normal * a.cos(), a.sin()))
    };
    if steps == 0 {
        for i in 0..n {
            let group = b.group();
            b.patch(group, 1, profile.len() - 1, |k, j| at(i + k, j).0);
        }
    } else {
        let group = b.group();
        b.patch_with_normals(group, n, profile.len() - 1, at);
    }
    let cap = |j: usize| -> Vec<DVec3> { (0..n).map(|i| at(i, j).0).collect() };
    let mut bottom = cap(0);
    bottom.reverse();
    let mut up = DVec3::ZERO;
    up[thin] = 1.0;
    b.flat_convex(&bottom, -up);
    b.flat_convex(&cap(profile.len() - 1), up);
    b.piece_of_all();
}

/// Upholstery: up to 0.5 a firm cushion with crowned faces, above it a pillow that is thin at its seam.
pub(super) fn cushion(b: &mut SolidBuilder, half: DVec3, puff: f64, whole: &Whole) {
    let puff = puff.clamp(0.0, 1.0);
    if puff > 0.5 {
        pillow(b, half, (puff - 0.5) * 2.0, whole);
    } else {
        firm_cushion(b, half, puff * 2.0, whole);
    }
    b.piece_of_all();
}

fn firm_cushion(b: &mut SolidBuilder, half: DVec3, puff: f64, whole: &Whole) {
    let thin = (0..3).fold(0, |best, k| if half[k] < half[best] { k } else { best });
    let radius = half[thin] * (0.35 + 0.4 * puff);
    let crown = 0.12 + 0.5 * puff;
    let shape = |p: DVec3| {
        let mut out = p;
        let mut dome = 1.0;
        for k in 0..3 {
            if k != thin {
                let t = (p[k] / half[k]).clamp(-1.0, 1.0);
                dome *= 1.0 - t.powi(2);
                // the sides bulge a little too
                let other = (p[3 - k - thin] / half[3 - k - thin]).clamp(-1.0, 1.0);
                let bulge = 0.02 * puff;
                out[k] = p[k] * (1.0 + bulge * (1.0 - other.powi(2))) / (1.0 + bulge);
            }
        }
        out[thin] = p[thin] * (1.0 + crown * dome.powf(0.7)) / (1.0 + crown);
        out
    };
    let segments = if whole.many { 1 } else { 2 };
    let mut inner = [if whole.many { 2 } else { 5 }; 3];
    inner[thin] = 1;
    grid_box(b, half, radius, segments, inner, Some(&shape));
}

fn pillow(b: &mut SolidBuilder, half: DVec3, puff: f64, whole: &Whole) {
    let thin = (0..3).fold(0, |best, k| if half[k] < half[best] { k } else { best });
    let (u, v) = face_axes(thin, 1.0);
    let n: usize = if whole.many { 6 } else { 8 };
    let sample = |k: usize| (FRAC_PI_2 * (2.0 * k as f64 / n as f64 - 1.0)).sin();
    let pinch = 0.05 + 0.09 * puff;
    let power = 5.0 - 2.0 * puff;
    let at = |i: usize, j: usize, sign: f64| {
        let (a, c) = (sample(i), sample(j));
        let mut p = DVec3::ZERO;
        // sides drawn in between the corners
        p[u] = half[u] * a * (1.0 - pinch * (1.0 - c * c) * a.abs().powi(2));
        p[v] = half[v] * c * (1.0 - pinch * (1.0 - a * a) * c.abs().powi(2));
        let full = (1.0 - a.abs().powf(power)) * (1.0 - c.abs().powf(power));
        p[thin] = sign * half[thin] * (SEAM + (1.0 - SEAM) * full.max(0.0).powf(0.55));
        p
    };
    let group = b.group();
    b.patch(group, n, n, |i, j| at(i, j, 1.0));
    b.patch(group, n, n, |i, j| at(j, i, -1.0));
    let seam = b.group();
    for edge in 0..4 {
        b.patch(seam, n, 1, |k, side| {
            let (i, j) = [(k, 0), (n, k), (n - k, n), (0, n - k)][edge];
            at(i, j, side as f64 * 2.0 - 1.0)
        });
    }
}
