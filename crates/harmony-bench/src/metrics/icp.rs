//! Rigid alignment of point sets: iterative closest points.
//!
//! P. J. Besl, N. D. McKay, "A Method for Registration of 3-D Shapes", PAMI 1992, with every source point paired to
//! its nearest target point; the rotation by W. Kabsch, "A solution for the best rotation to relate two sets of
//! vectors", 1976. No scale, no rejection. It finds the nearest minimum only: sets that start turned by more than some
//! tens of degrees, or apart by more than their features, settle wrongly.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, SVD};
use serde::Serialize;

use super::nearest::{Nearest, NearestError, NearestIndex};
use super::two_way::mean;

/// Precision asked of the singular value decomposition, and its most steps.
const SVD_PRECISION: f64 = 1e-15;
const SVD_STEPS: usize = 200;

/// `target = rotation * source + translation`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rigid {
    /// A rotation, determinant 1.
    pub rotation: DMat3,
    /// In the unit of the points.
    pub translation: DVec3,
}

impl Rigid {
    /// Leaves everything where it is.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// The point in the target frame.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IcpOptions {
    /// Most rounds of pairing and solving.
    pub max_iterations: usize,
    /// Stop when the mean distance changes by less than this from one round to the next, unit of the points.
    pub tolerance: f64,
}

/// An alignment and how it came about.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Icp {
    /// Carries the source onto the target.
    pub target_from_source: Rigid,
    /// Rounds of pairing and solving.
    pub iterations: usize,
    /// Whether the mean distance settled within the rounds allowed.
    pub converged: bool,
    /// Mean distance of the pairs of the last round before it was solved, unit of the points.
    pub mean_distance: f64,
}

/// Aligns `source` to the points of `target`, from where it is.
///
/// # Errors
/// [`NearestError`] when a set is empty or not finite.
pub fn rigid_icp(source: &[DVec3], target: &[DVec3], options: &IcpOptions) -> Result<Icp, NearestError> {
    if source.is_empty() {
        return Err(NearestError::Empty);
    }
    let index = NearestIndex::build(target)?;
    let mut icp =
        Icp { target_from_source: Rigid::IDENTITY, iterations: 0, converged: false, mean_distance: f64::INFINITY };
    let mut moved = source.to_vec();
    while icp.iterations < options.max_iterations && !icp.converged {
        let pairs = index.nearest(&moved)?;
        let matched: Vec<DVec3> = pairs.iter().map(|pair| target[pair.index as usize]).collect();
        let distance = mean(&pairs.iter().map(|Nearest { distance, .. }| *distance).collect::<Vec<_>>());
        icp.iterations += 1;
        // Solved from the source itself, so that rounding does not add up.
        let Some(solved) = best_rigid(source, &matched) else { break };
        icp.target_from_source = solved;
        icp.converged = (icp.mean_distance - distance).abs() < options.tolerance;
        icp.mean_distance = distance;
        for (moved, source) in moved.iter_mut().zip(source) {
            *moved = solved.apply(*source);
        }
    }
    Ok(icp)
}

/// The rigid motion with the least sum of squared distances from the points of `from` to those of `to`, pair by pair.
///
/// A turn that the points leave open (they lie on a line, say) is chosen by the decomposition. `None` without points,
/// or when a number is not finite.
pub fn best_rigid(from: &[DVec3], to: &[DVec3]) -> Option<Rigid> {
    let count = from.len().min(to.len());
    if count == 0 {
        return None;
    }
    let centre = |points: &[DVec3]| points[..count].iter().sum::<DVec3>() / count as f64;
    let (from_centre, to_centre) = (centre(from), centre(to));
    let mut covariance = DMat3::ZERO;
    for (a, b) in from.iter().zip(to) {
        let (a, b) = (*a - from_centre, *b - to_centre);
        covariance += DMat3::from_cols(b * a.x, b * a.y, b * a.z);
    }
    if !covariance.is_finite() {
        return None;
    }
    let svd =
        SVD::try_new(Matrix3::from_column_slice(&covariance.to_cols_array()), true, true, SVD_PRECISION, SVD_STEPS)?;
    let (mut u, v_t) = (svd.u?, svd.v_t?);
    if (u * v_t).determinant() < 0.0 {
        // A reflection would fit better; the direction that carries least is turned instead.
        u.column_mut(svd.singular_values.imin()).neg_mut();
    }
    let rotation = DMat3::from_cols_slice((u * v_t).as_slice());
    Some(Rigid { rotation, translation: to_centre - rotation * from_centre })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const OPTIONS: IcpOptions = IcpOptions { max_iterations: 50, tolerance: 1e-5 };

    fn motion(axis: [f64; 3], angle: f64, translation: [f64; 3]) -> Rigid {
        let axis = DVec3::from_array(axis).normalize_or(DVec3::Y);
        Rigid { rotation: DMat3::from_axis_angle(axis, angle), translation: DVec3::from_array(translation) }
    }

    /// Points on three unequal faces of a box.
    fn corner() -> Vec<DVec3> {
        let at = |i: usize| ((i % 40) as f64 / 40.0, (i / 40) as f64 / 40.0);
        (0..1600)
            .flat_map(|i| {
                let (u, v) = at(i);
                [DVec3::new(u, v * 0.5, 0.0), DVec3::new(u, 0.0, v * 0.8), DVec3::new(0.0, u * 0.5, v * 0.8)]
            })
            .collect()
    }

    proptest! {
        #[test]
        fn a_known_motion_is_recovered_from_pairs(
            points in prop::collection::vec([-2.0..2.0, -2.0..2.0, -2.0..2.0].prop_map(DVec3::from_array), 4..40),
            axis in [-1.0..1.0, -1.0..1.0, -1.0..1.0],
            angle in -3.0..3.0,
            translation in [-5.0..5.0, -5.0..5.0, -5.0..5.0],
        ) {
            let expected = motion(axis, angle, translation);
            let moved: Vec<_> = points.iter().map(|p| expected.apply(*p)).collect();
            let found = best_rigid(&points, &moved).unwrap();
            prop_assert!((found.rotation.determinant() - 1.0).abs() <= 1e-9);
            for (p, m) in points.iter().zip(moved) {
                prop_assert!((found.apply(*p) - m).length() <= 1e-7);
            }
        }
    }

    #[test]
    fn a_mirrored_set_is_turned_not_mirrored() {
        let points = corner();
        let mirrored: Vec<_> = points.iter().map(|p| DVec3::new(-p.x, p.y, p.z)).collect();
        let found = best_rigid(&points, &mirrored).unwrap();
        assert!((found.rotation.determinant() - 1.0).abs() <= 1e-12);
    }

    #[test]
    fn a_small_motion_is_undone() {
        let target = corner();
        let away = motion([0.2, 1.0, -0.3], 0.1, [0.02, -0.03, 0.015]);
        let source: Vec<_> = target.iter().map(|p| away.apply(*p)).collect();
        let icp = rigid_icp(&source, &target, &OPTIONS).unwrap();
        assert!(icp.converged && icp.iterations < 50, "{icp:?}");
        let worst = source.iter().zip(&target).map(|(s, t)| icp.target_from_source.apply(*s).distance(*t));
        assert!(worst.fold(0.0, f64::max) <= 1e-3, "{icp:?}");
    }

    #[test]
    fn scale_is_left_alone_and_the_rounds_are_counted() {
        let target = corner();
        let source: Vec<_> = target.iter().map(|p| *p * 1.2).collect();
        let icp = rigid_icp(&source, &target, &IcpOptions { max_iterations: 2, tolerance: 0.0 }).unwrap();
        assert_eq!((icp.iterations, icp.converged), (2, false));
        assert!((icp.target_from_source.rotation.determinant() - 1.0).abs() <= 1e-12);
        assert_eq!(rigid_icp(&[], &target, &OPTIONS), Err(NearestError::Empty));
        let still = rigid_icp(&target, &target, &OPTIONS).unwrap();
        assert!(still.mean_distance <= 1e-12 && still.converged);
    }
}
