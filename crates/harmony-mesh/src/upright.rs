//! Setting generated meshes upright.
//!
//! The paper turns the principal axis nearest to up onto up (Sec. 3.2, "Mesh Canonicalization"). A chair's principal
//! axes lean with its back, an L-shaped sofa's with its long side, so that de-tilting by them can tilt what was
//! straight. What furniture has are level and plumb faces, and the plane it stands on: the up direction is sought that
//! makes most of the surface level or plumb, and the principal axis is one of the candidates only.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::{DMat3, DQuat, DVec3};

use crate::Mesh;

/// Largest tilt that is looked for, degrees.
const MAX_TILT_DEG: f64 = 24.0;
/// Softness of "level" and "plumb" in the coarse and the fine search, degrees.
const SOFTNESS_DEG: [f64; 3] = [5.0, 2.5, 1.5];
/// Step of the coarse search, degrees.
const STEP_DEG: f64 = 2.0;
/// Faces that are looked at.
const MAX_FACES: usize = 3000;
/// A tilt of so many degrees costs one unit of [`TILT_PRICE`]: generators tilt by a few degrees.
const USUAL_TILT_DEG: f64 = 10.0;
/// Price of a usual tilt, share of the surface.
const TILT_PRICE: f64 = 0.03;
/// Price of standing on an edge instead of a face: share of the surface a unit of lift over the footprint.
const LIFT_PRICE: f64 = 1.5;
/// Spreads across the axis of a turned thing (vase, lamp, bin) differ by less than this, relative.
const ROUND: f64 = 0.06;

/// The turn that sets a mesh upright.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Upright {
    /// Takes the mesh's frame to one whose +Y is up; the shortest such turn, so that the yaw is disturbed least.
    pub turn: DMat3,
    /// Share of the surface that is level or plumb then, softly counted.
    pub share: f64,
    /// The same before.
    pub share_before: f64,
}

struct Faces {
    /// Unit normal and share of the area.
    normals: Vec<(DVec3, f64)>,
    /// Hull-like sample of the surface, for the footprint.
    points: Vec<DVec3>,
    size: f64,
}

/// Finds the turn that sets a mesh upright; the mesh's own +Y is up within 24 degrees.
///
/// A mesh without faces gets the identity.
pub fn upright(mesh: &Mesh) -> Upright {
    let faces = faces_of(mesh);
    if faces.normals.is_empty() || faces.size <= 0.0 {
        return Upright { turn: DMat3::IDENTITY, share: 0.0, share_before: 0.0 };
    }
    if let Some(axis) = turning_axis(&faces) {
        let turn = DMat3::from_quat(DQuat::from_rotation_arc(axis, DVec3::Y));
        let share = |up| aligned(&faces, up, SOFTNESS_DEG[2]);
        return Upright { turn, share: share(axis), share_before: share(DVec3::Y) };
    }
    let up_of = |a: f64, b: f64| DVec3::new(a.to_radians().tan(), 1.0, b.to_radians().tan()).normalize();
    let mut best = (f64::NEG_INFINITY, 0.0, 0.0);
    let steps = (MAX_TILT_DEG / STEP_DEG) as i32;
    for i in -steps..=steps {
        for j in -steps..=steps {
            let (a, b) = (f64::from(i) * STEP_DEG, f64::from(j) * STEP_DEG);
            if a.hypot(b) <= MAX_TILT_DEG {
                let score = score(&faces, up_of(a, b), SOFTNESS_DEG[0]);
                if score > best.0 {
                    best = (score, a, b);
                }
            }
        }
    }
    for (softness, step) in [(SOFTNESS_DEG[1], 0.5), (SOFTNESS_DEG[2], 0.15)] {
        let centre = best;
        best.0 = f64::NEG_INFINITY;
        for i in -4..=4 {
            for j in -4..=4 {
                let (a, b) = (centre.1 + f64::from(i) * step, centre.2 + f64::from(j) * step);
                let score = score(&faces, up_of(a, b), softness);
                if score > best.0 {
                    best = (score, a, b);
                }
            }
        }
    }
    let up = up_of(best.1, best.2);
    Upright {
        turn: DMat3::from_quat(DQuat::from_rotation_arc(up, DVec3::Y)),
        share: aligned(&faces, up, SOFTNESS_DEG[2]),
        share_before: aligned(&faces, DVec3::Y, SOFTNESS_DEG[2]),
    }
}

fn faces_of(mesh: &Mesh) -> Faces {
    let corner = |i: u32| mesh.positions[i as usize].as_dvec3();
    let count = mesh.triangle_count();
    let step = count.div_ceil(MAX_FACES).max(1);
    let mut normals = Vec::new();
    let mut points = Vec::new();
    let mut total = 0.0;
    for t in mesh.triangles().step_by(step) {
        let [a, b, c] = t.map(corner);
        let cross = (b - a).cross(c - a);
        let area = cross.length();
        if let Some(normal) = cross.try_normalize() {
            normals.push((normal, area));
            points.extend([a, b, c]);
            total += area;
        }
    }
    for (_, area) in &mut normals {
        *area /= total;
    }
    let size = mesh.bounds().map_or(0.0, |b| b.size().length());
    Faces { normals, points, size }
}

/// The axis of a thing that was turned on a lathe, if it is one: of the principal axes of the surface the one across
/// which it spreads evenly, near enough to up.
fn turning_axis(faces: &Faces) -> Option<DVec3> {
    let middles = |k: usize| (faces.points[3 * k] + faces.points[3 * k + 1] + faces.points[3 * k + 2]) / 3.0;
    let centre: DVec3 = faces.normals.iter().enumerate().map(|(k, (_, area))| middles(k) * *area).sum();
    let mut scatter = nalgebra::Matrix3::<f64>::zeros();
    for (k, (_, area)) in faces.normals.iter().enumerate() {
        let d = middles(k) - centre;
        let v = nalgebra::Vector3::new(d.x, d.y, d.z);
        scatter += v * v.transpose() * *area;
    }
    let eigen = nalgebra::SymmetricEigen::new(scatter);
    let column =
        |i: usize| DVec3::new(eigen.eigenvectors[(0, i)], eigen.eigenvectors[(1, i)], eigen.eigenvectors[(2, i)]);
    let up = (0..3).max_by(|a, b| column(*a).y.abs().total_cmp(&column(*b).y.abs()))?;
    let [a, b] = [(up + 1) % 3, (up + 2) % 3].map(|i| eigen.eigenvalues[i].max(0.0).sqrt());
    let axis = column(up) * column(up).y.signum();
    let own = eigen.eigenvalues[up].max(0.0).sqrt();
    // A cube spreads evenly about every axis, and a board about none that could be told.
    let told = (own / a.max(b) - 1.0).abs() > 0.15 && a.min(b) > 0.0;
    (told && (a / b - 1.0).abs() < ROUND && axis.y >= MAX_TILT_DEG.to_radians().cos() && is_turned(faces, axis, centre))
        .then_some(axis)
}

/// Whether the normals lie in the planes through an axis, as those of turned things do.
fn is_turned(faces: &Faces, axis: DVec3, centre: DVec3) -> bool {
    let mut off = 0.0;
    for (k, (normal, area)) in faces.normals.iter().enumerate() {
        let middle = (faces.points[3 * k] + faces.points[3 * k + 1] + faces.points[3 * k + 2]) / 3.0 - centre;
        let around = axis.cross(middle).normalize_or_zero();
        off += area * normal.dot(around).abs();
    }
    off < 0.18
}

fn score(faces: &Faces, up: DVec3, softness_deg: f64) -> f64 {
    let tilt = up.y.clamp(-1.0, 1.0).acos().to_degrees();
    aligned(faces, up, softness_deg) - TILT_PRICE * (tilt / USUAL_TILT_DEG).powi(2) - LIFT_PRICE * lift(faces, up)
}

/// Share of a mesh's surface that is level or plumb when `up` is up.
pub(crate) fn level_share(mesh: &Mesh, up: DVec3) -> f64 {
    aligned(&faces_of(mesh), up, SOFTNESS_DEG[2])
}

/// Share of the surface that is level or plumb.
fn aligned(faces: &Faces, up: DVec3, softness_deg: f64) -> f64 {
    let sigma = softness_deg.to_radians();
    faces
        .normals
        .iter()
        .map(|(n, area)| {
            let c = n.dot(up).abs().min(1.0);
            // Angle to the nearer of level (c = 1) and plumb (c = 0).
            let off = if c > FRAC_1_SQRT_2 { c.acos() } else { c.asin() } / sigma;
            area * (-0.5 * off * off).exp()
        })
        .sum()
}

/// How far a mesh is from standing on its lowest points: mean height of the lowest points of the four quarters of its
/// footprint over the ground, relative to its size.
fn lift(faces: &Faces, up: DVec3) -> f64 {
    let side = up.cross(DVec3::Z).normalize_or(DVec3::X);
    let front = side.cross(up);
    let mut low = [f64::INFINITY; 4];
    let centre = faces.points.iter().sum::<DVec3>() / faces.points.len().max(1) as f64;
    for p in &faces.points {
        let d = *p - centre;
        let quarter = usize::from(d.dot(side) > 0.0) + 2 * usize::from(d.dot(front) > 0.0);
        low[quarter] = low[quarter].min(d.dot(up));
    }
    let ground = low.iter().copied().fold(f64::INFINITY, f64::min);
    let heights: f64 = low.iter().filter(|v| v.is_finite()).map(|v| v - ground).sum();
    heights / 4.0 / faces.size
}

#[cfg(test)]
mod tests {
    use harmony_scene::Size;

    use super::*;
    use crate::{TemplateParams, template};

    fn built(name: &str, width: f64, height: f64, depth: f64) -> Mesh {
        let size = Size { width, height, depth };
        template(name, &TemplateParams::default(), size).build(size).unwrap().mesh
    }

    #[test]
    fn tilted_furniture_comes_upright_and_keeps_its_yaw() {
        for (name, w, h, d) in [
            ("chair", 0.5, 0.95, 0.55),
            ("sofa", 2.0, 0.8, 0.9),
            ("table", 1.4, 0.74, 0.8),
            ("bed", 1.6, 1.0, 2.1),
            ("floor_lamp", 0.4, 1.6, 0.4),
        ] {
            for (tilt_deg, about) in [(0.0_f64, 0.0_f64), (5.0, 0.7), (8.0, 2.9), (12.0, 4.4)] {
                let mut mesh = built(name, w, h, d);
                let axis = DVec3::new(about.cos(), 0.0, about.sin());
                let tilt = DMat3::from_axis_angle(axis, tilt_deg.to_radians());
                let m = tilt.as_mat3();
                mesh.map(|p| m * p, |n| m * n);
                let found = upright(&mesh);
                let left = (found.turn * tilt * DVec3::Y).y.clamp(-1.0, 1.0).acos().to_degrees();
                assert!(left < 0.8, "{name} tilted {tilt_deg}: {left:.2} deg left");
                let front = found.turn * tilt * DVec3::Z;
                assert!(front.x.atan2(front.z).abs().to_degrees() < 1.5, "{name}: {front}");
                assert!(found.share >= found.share_before - 1e-9);
            }
        }
    }

    #[test]
    fn an_empty_mesh_stays_as_it_is() {
        assert_eq!(upright(&Mesh::default()).turn, DMat3::IDENTITY);
    }
}
