//! Small things that every generator needs.

use std::f64::consts::PI;

use glam::{DMat3, DVec2, DVec3};

/// Largest distance between a curve and its chords, metres, for small radii.
const SAGITTA: f64 = 4e-4;

/// Sine and cosine with the same bits everywhere.
pub fn sin_cos(angle: f64) -> (f64, f64) {
    libm::sincos(angle)
}

/// Number of straight pieces of a full circle.
pub fn divisions(radius: f64) -> usize {
    let sagitta = SAGITTA + 8e-4 * radius;
    ((PI * (radius / (2.0 * sagitta)).sqrt()).ceil() as usize).clamp(8, 72)
}

/// Turn about x, then y, then z, degrees.
pub fn turn_deg(turn: [f64; 3]) -> DMat3 {
    let [x, y, z] = turn.map(|a| sin_cos(a.to_radians()));
    let about_x = DMat3::from_cols(DVec3::X, DVec3::new(0.0, x.1, x.0), DVec3::new(0.0, -x.0, x.1));
    let about_y = DMat3::from_cols(DVec3::new(y.1, 0.0, -y.0), DVec3::Y, DVec3::new(y.0, 0.0, y.1));
    let about_z = DMat3::from_cols(DVec3::new(z.1, z.0, 0.0), DVec3::new(-z.0, z.1, 0.0), DVec3::Z);
    about_z * about_y * about_x
}

/// Turn of `v` about a unit axis, radians.
pub fn about(axis: DVec3, angle: f64, v: DVec3) -> DVec3 {
    let (s, c) = sin_cos(angle);
    v * c + axis.cross(v) * s + axis * (axis.dot(v) * (1.0 - c))
}

/// Angle between unit vectors, radians.
pub fn angle(a: DVec3, b: DVec3) -> f64 {
    libm::atan2(a.cross(b).length(), a.dot(b))
}

/// A right-handed frame whose third axis is `d`: the second one as close to up as it can be (towards -z where `d` is
/// vertical).
pub fn frame(d: DVec3) -> (DVec3, DVec3) {
    let up = if d.y.abs() > 0.999 { DVec3::NEG_Z } else { DVec3::Y };
    let x = up.cross(d).normalize_or(DVec3::X);
    (x, d.cross(x))
}

/// Running sums, starting with 0.
pub fn cumulative(steps: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sum = 0.0;
    std::iter::once(0.0)
        .chain(steps.map(|s| {
            sum += s;
            sum
        }))
        .collect()
}

/// `p` turned by `angle`, counter-clockwise.
pub fn turned(p: DVec2, angle: f64) -> DVec2 {
    let (s, c) = sin_cos(angle);
    DVec2::new(p.x * c - p.y * s, p.x * s + p.y * c)
}

/// Left normal of a direction.
pub fn left(d: DVec2) -> DVec2 {
    DVec2::new(-d.y, d.x)
}
