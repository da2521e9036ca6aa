//! Principal axes and de-tilting of meshes (paper Sec. 3.2, "Mesh Canonicalization").
//!
//! The axes are the eigenvectors of the points' covariance, so that every vertex counts the same: finely meshed parts
//! weigh more. The de-tilt turns the axis nearest to +Y onto it by the shortest rotation. Known weak regime: things
//! that lean by their form, such as chairs, whose principal axes are not upright; by default meshes are set upright by
//! their faces (decision 0011).

use harmony_scene::{Mat3, Vec3};
use nalgebra::{Matrix3, SymmetricEigen};

/// Principal axes of a point set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// Mean of the points.
    pub centre: Vec3,
    /// Unit axes, largest spread first, right-handed.
    pub axes: [Vec3; 3],
    /// Standard deviations along the axes.
    pub spread: [f64; 3],
}

/// Principal axes; `None` with fewer than three finite points.
pub fn pca(points: &[Vec3]) -> Option<Axes> {
    let finite: Vec<Vec3> = points.iter().copied().filter(|p| p.is_finite()).collect();
    if finite.len() < 3 {
        return None;
    }
    let n = finite.len() as f64;
    let centre = finite.iter().copied().sum::<Vec3>() / n;
    let mut scatter = Matrix3::<f64>::zeros();
    for p in &finite {
        let d = *p - centre;
        let v = nalgebra::Vector3::new(d.x, d.y, d.z);
        scatter += v * v.transpose();
    }
    let eigen = SymmetricEigen::new(scatter / n);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let column = |i: usize| {
        let c = eigen.eigenvectors.column(order[i]);
        Vec3::new(c[0], c[1], c[2])
    };
    let (a, b) = (column(0), column(1));
    let spread = order.map(|i| eigen.eigenvalues[i].max(0.0).sqrt());
    Some(Axes { centre, axes: [a, b, a.cross(b)], spread })
}

/// Largest tilt that de-tilting takes back, radians: beyond half a right angle another axis is nearer to up.
pub const DETILT_LIMIT: f64 = std::f64::consts::FRAC_PI_4;

/// The rotation that turns the principal axis nearest to +Y onto +Y, if it is within 45 degrees; else none.
///
/// `None` also when the points have no shape. The rotation is the shortest one, so the yaw is disturbed least.
pub fn detilt(vertices: &[Vec3]) -> Option<Mat3> {
    let axes = pca(vertices)?;
    let nearest = axes.axes.iter().copied().max_by(|a, b| a.y.abs().total_cmp(&b.y.abs()))?;
    let up = if nearest.y < 0.0 { -nearest } else { nearest };
    (up.y >= DETILT_LIMIT.cos()).then(|| Mat3::from_quat(glam::DQuat::from_rotation_arc(up, Vec3::Y)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Surface points of a box, finer along longer sides.
    fn block(size: Vec3) -> Vec<Vec3> {
        let mut out = Vec::new();
        for i in 0..=12 {
            for j in 0..=12 {
                for k in 0..=12 {
                    if [i, j, k].iter().any(|v| *v == 0 || *v == 12) {
                        let f = Vec3::new(f64::from(i), f64::from(j), f64::from(k)) / 12.0 - 0.5;
                        out.push(f * size);
                    }
                }
            }
        }
        out
    }

    proptest! {
        #[test]
        fn a_tilted_sofa_comes_upright_and_keeps_its_yaw(
            tilt in -38f64..38.0, about in 0.0f64..std::f64::consts::TAU,
        ) {
            // Longest axis across: what is turned up must not be that one.
            let tilted = Mat3::from_axis_angle(Vec3::new(about.cos(), 0.0, about.sin()), tilt.to_radians());
            let points: Vec<Vec3> = block(Vec3::new(2.2, 0.8, 0.95)).into_iter().map(|p| tilted * p).collect();
            let upright = detilt(&points).unwrap() * tilted;
            prop_assert!((upright * Vec3::Y).y >= 0.9999);
            let front = upright * Vec3::Z;
            // The shortest rotation back is the opposite of the tilt, so nothing is left of either.
            prop_assert!(front.z >= 0.9999, "front {front}");
        }
    }

    #[test]
    fn axes_are_sorted_right_handed_and_unit() {
        let a = pca(&block(Vec3::new(1.0, 3.0, 2.0))).unwrap();
        assert!(a.spread[0] > a.spread[1] && a.spread[1] > a.spread[2]);
        assert!(a.axes[0].y.abs() > 0.999 && a.axes[1].z.abs() > 0.999);
        assert!(a.axes[0].cross(a.axes[1]).distance(a.axes[2]) <= 1e-9);
        assert!(a.centre.length() <= 1e-12);
        assert!(pca(&[Vec3::ONE, Vec3::NAN, Vec3::ZERO]).is_none());
    }
}
