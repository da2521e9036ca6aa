//! The shapes, each built around the origin with given half extents.

mod boxes;
mod cloth;
mod leaves;
mod planar;
mod round;
mod sweep;

use glam::{DMat3, DVec2, DVec3};

use super::solid::{Solid, SolidBuilder};
use super::{Axis, Part, Shape};

/// What a shape may know about the whole object.
#[derive(Debug, Clone, Copy)]
pub(super) struct Whole {
    /// Largest side of the object, metres: sets how finely curves are divided.
    pub largest: f64,
    /// Smallest side of the object, metres: thicknesses are fractions of it.
    pub smallest: f64,
    /// Many parts: curves are divided more coarsely.
    pub many: bool,
}

impl Whole {
    /// Number of sides of a circle.
    fn sides(&self, radius: f64) -> usize {
        let n = match radius / self.largest {
            r if r < 0.012 => 8,
            r if r < 0.04 => 12,
            r if r < 0.1 => 20,
            r if r < 0.25 => 28,
            _ => 36,
        };
        if self.many { (n * 2 / 3).max(6) } else { n }
    }

    /// Segments of an eighth of a circle on a rounded edge.
    fn bevel_segments(&self, radius: f64) -> usize {
        match radius / self.largest {
            r if r < 0.025 || self.many => 1,
            r if r < 0.08 => 2,
            _ => 3,
        }
    }
}

/// Builds a part's shape in its own frame: centred, `half` extents in metres.
pub(super) fn solid(part: &Part, half: DVec3, whole: &Whole) -> Solid {
    let axis = part.axis.unwrap_or(if part.shape == Shape::Extrude { Axis::Z } else { Axis::Y });
    let turned = matches!(part.shape, Shape::Cylinder | Shape::Lathe | Shape::Back | Shape::Cloth);
    let object_from_upright = if turned { from_upright(axis) } else { DMat3::IDENTITY };
    let half_upright = (object_from_upright.transpose() * half).abs();
    let mut builder = SolidBuilder::new(half.max_element());
    match part.shape {
        Shape::Box | Shape::Group => boxes::rounded_box(&mut builder, half, part.round.unwrap_or(0.0), whole),
        Shape::Slab => {
            boxes::slab(&mut builder, half, part.corner.unwrap_or(0.1), part.round.unwrap_or(0.3), whole);
        }
        Shape::Cushion => boxes::cushion(&mut builder, half, part.puff.unwrap_or(0.4), whole),
        Shape::Sphere => round::sphere(&mut builder, half, whole),
        Shape::Cylinder => round::cylinder(&mut builder, half_upright, part, whole),
        Shape::Lathe => round::lathe(&mut builder, half_upright, part, whole),
        Shape::Back => sweep::back(&mut builder, half_upright, part, whole),
        Shape::Tube => sweep::tube(&mut builder, half, part, whole),
        Shape::Extrude => planar::extrude(&mut builder, half, part, axis),
        Shape::Leaves => leaves::leaves(&mut builder, half, part),
        Shape::Cloth => cloth::cloth(&mut builder, half_upright, part),
    }
    let mut solid = builder.finish();
    if turned {
        solid.transform(&glam::DAffine3::from_mat3(object_from_upright));
    }
    solid
}

/// Cyclic change of axes that carries +Y to the axis: a rotation.
fn from_upright(axis: Axis) -> DMat3 {
    match axis {
        Axis::Y => DMat3::IDENTITY,
        Axis::X => DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y),
        Axis::Z => DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X),
    }
}

/// Catmull-Rom curve through points, `steps` samples a segment, ends included.
fn smooth_path<V>(points: &[V], steps: usize, closed: bool) -> Vec<V>
where
    V: Copy + std::ops::Add<Output = V> + std::ops::Mul<f64, Output = V>,
{
    let n = points.len();
    if n < 3 {
        return points.to_vec();
    }
    let at = |i: isize| {
        let i = if closed { i.rem_euclid(n as isize) } else { i.clamp(0, n as isize - 1) };
        points[i as usize]
    };
    let segments = if closed { n } else { n - 1 };
    let mut out = Vec::with_capacity(segments * steps + 1);
    for s in 0..segments as isize {
        let p = [at(s - 1), at(s), at(s + 1), at(s + 2)];
        for k in 0..steps {
            let t = k as f64 / steps as f64;
            let (t2, t3) = (t * t, t * t * t);
            out.push(
                p[0] * (-0.5 * t3 + t2 - 0.5 * t)
                    + p[1] * (1.5 * t3 - 2.5 * t2 + 1.0)
                    + p[2] * (-1.5 * t3 + 2.0 * t2 + 0.5 * t)
                    + p[3] * (0.5 * t3 - 0.5 * t2),
            );
        }
    }
    if !closed {
        out.push(points[n - 1]);
    }
    out
}

/// Splits a polyline (closed or not) into runs between corners sharper than 35 degrees; each run is a list of indices.
fn runs(points: &[DVec2], closed: bool) -> Vec<Vec<usize>> {
    /// Cosine of the sharpest corner that is still shaded smoothly.
    const SMOOTH: f64 = 0.819;
    let n = points.len();
    let sharp = |i: usize| {
        let (before, after) = (points[i] - points[(i + n - 1) % n], points[(i + 1) % n] - points[i]);
        before.normalize_or_zero().dot(after.normalize_or_zero()) < SMOOTH
    };
    let mut out = Vec::new();
    if closed {
        let start = (0..n).find(|i| sharp(*i)).unwrap_or(0);
        let mut run = vec![start];
        for k in 1..=n {
            let i = (start + k) % n;
            run.push(i);
            if k == n || sharp(i) {
                out.push(std::mem::replace(&mut run, vec![i]));
            }
        }
    } else {
        let mut run = vec![0];
        for i in 1..n {
            run.push(i);
            if i == n - 1 || sharp(i) {
                out.push(std::mem::replace(&mut run, vec![i]));
            }
        }
    }
    out
}

/// Whether a polygon can be extruded.
pub(super) fn is_simple_outline(points: Vec<DVec2>) -> bool {
    planar::is_simple(&planar::tidy(points))
}
