//! The scene-level geometry protocol of MIDI-3D (Z. Huang et al., "MIDI", CVPR 2025), which others follow.
//!
//! A fixed number of surface points from every predicted object, put together; the truth as stored surface points;
//! rigid ICP of the prediction to the truth; then the sum of both mean *squared* distances, and an F-score at 0.1 on
//! distances that are not squared.
//!
//! # Reading of the source
//! MIDI's data are prepared so that a scene fills about [-1, 1], hence its 0.1 is no length in metres. We carry the
//! truth's bounding box to [-1, 1] along its longest side, centre to the origin, and by default move the prediction
//! by that same map, so that errors of scale and place count as far as ICP leaves them ([`Normalisation`]).
//! ICP stops when the mean distance of two rounds differs by less than 1e-5, in normalised units.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::icp::{Icp, IcpOptions, rigid_icp};
use super::nearest::NearestError;
use super::sample::{NoSurface, Seed, sample_surface};
use super::soup::Triangle;
use super::two_way::{ThresholdScore, TwoWay, two_way};

/// Surface points drawn from each predicted object (MIDI's data).
pub const POINTS_PER_OBJECT: usize = 20_480;
/// Threshold of the F-score, normalised units.
pub const TAU: f64 = 0.1;
/// Most rounds of ICP.
pub const ICP_ITERATIONS: usize = 50;
/// ICP stops when the mean distance changes by less, normalised units.
pub const ICP_TOLERANCE: f64 = 1e-5;

/// How a scene is brought to [-1, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Normalisation {
    /// Both sets by the box of the truth: wrong scale counts.
    ByTruth,
    /// Each set by its own box, for predictions without a common frame or scale.
    EachByItself,
    /// The sets already are.
    Given,
}

/// What the protocol leaves open, and its constants.
#[derive(Debug, Clone, PartialEq)]
pub struct MidiOptions {
    /// Surface points drawn from each predicted object.
    pub points_per_object: usize,
    /// Seed of the samplings.
    pub seed: u64,
    /// How the scene is brought to [-1, 1].
    pub normalisation: Normalisation,
    /// Rounds and tolerance of ICP, normalised units.
    pub icp: IcpOptions,
    /// Threshold of the F-score, normalised units.
    pub tau: f64,
}

impl Default for MidiOptions {
    fn default() -> Self {
        Self {
            points_per_object: POINTS_PER_OBJECT,
            seed: 0,
            normalisation: Normalisation::ByTruth,
            icp: IcpOptions { max_iterations: ICP_ITERATIONS, tolerance: ICP_TOLERANCE },
            tau: TAU,
        }
    }
}

/// Numbers of one pair of point sets, normalised units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MidiDistances {
    /// Sum of both mean squared distances.
    pub chamfer: f64,
    /// Precision, recall and F-score as shares, 0..1.
    pub f_score: ThresholdScore,
}

/// The result of one scene, with all that a reader needs to compare it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MidiScore {
    /// Always "midi".
    pub protocol: &'static str,
    /// Unit of distances.
    pub unit: &'static str,
    /// Always "rigid ICP".
    pub alignment: &'static str,
    /// How the scene was brought to [-1, 1].
    pub normalisation: Normalisation,
    /// Whether backgrounds were compared: never.
    pub background: bool,
    /// Seed of the samplings.
    pub seed: u64,
    /// Predicted points.
    pub prediction_points: usize,
    /// True points.
    pub truth_points: usize,
    /// Predicted objects without a surface, left out.
    pub skipped_objects: usize,
    /// The alignment found.
    pub icp: Icp,
    /// The protocol's numbers, after ICP.
    pub score: MidiDistances,
    /// The same before ICP.
    pub before_icp: MidiDistances,
}

/// Why a scene has no score.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MidiError {
    /// No predicted object has a surface.
    #[error("no predicted object has a surface")]
    EmptyPrediction(#[source] NoSurface),
    /// A box to normalise by has no extent.
    #[error("points within {size} of each other give no scale")]
    NoExtent {
        /// Longest side of the box.
        size: f64,
    },
    /// A set is empty, or coordinates are not finite.
    #[error(transparent)]
    Points(#[from] NearestError),
}

/// Compares predicted objects with true surface points; both in one frame and unit, of any kind.
///
/// # Errors
/// [`MidiError`].
pub fn midi(objects: &[Vec<Triangle>], truth: &[DVec3], options: &MidiOptions) -> Result<MidiScore, MidiError> {
    let mut points = Vec::with_capacity(objects.len() * options.points_per_object);
    let mut skipped = 0;
    for (object, draw) in objects.iter().zip(0..) {
        match sample_surface(object, options.points_per_object, Seed { seed: options.seed, draw }) {
            Ok(sample) => points.extend(sample.points),
            Err(NoSurface { .. }) => skipped += 1,
        }
    }
    if skipped == objects.len() {
        let triangles = objects.iter().map(Vec::len).sum();
        return Err(MidiError::EmptyPrediction(NoSurface { triangles }));
    }
    Ok(MidiScore { skipped_objects: skipped, ..midi_of_points(&points, truth, options)? })
}

/// The protocol from the point sets on.
///
/// # Errors
/// [`MidiError`].
pub fn midi_of_points(prediction: &[DVec3], truth: &[DVec3], options: &MidiOptions) -> Result<MidiScore, MidiError> {
    if prediction.is_empty() || truth.is_empty() {
        return Err(NearestError::Empty.into());
    }
    let (own, by_truth) = (|points| UnitBox::around(points), UnitBox::around(truth));
    let (for_prediction, for_truth) = match options.normalisation {
        Normalisation::ByTruth => (by_truth?, by_truth?),
        Normalisation::EachByItself => (own(prediction)?, by_truth?),
        Normalisation::Given => (UnitBox::UNIT, UnitBox::UNIT),
    };
    let (prediction, truth) = (for_prediction.carry(prediction), for_truth.carry(truth));
    let before_icp = MidiDistances::of(&two_way(&prediction, &truth)?, options.tau);
    let icp = rigid_icp(&prediction, &truth, &options.icp)?;
    let aligned: Vec<DVec3> = prediction.iter().map(|p| icp.target_from_source.apply(*p)).collect();
    Ok(MidiScore {
        protocol: "midi",
        unit: match options.normalisation {
            Normalisation::ByTruth | Normalisation::EachByItself => "half the longest side of the truth's box",
            Normalisation::Given => "as given",
        },
        alignment: "rigid ICP",
        normalisation: options.normalisation,
        background: false,
        seed: options.seed,
        prediction_points: prediction.len(),
        truth_points: truth.len(),
        skipped_objects: 0,
        icp,
        score: MidiDistances::of(&two_way(&aligned, &truth)?, options.tau),
        before_icp,
    })
}

impl MidiDistances {
    /// The protocol's numbers from distances in normalised units.
    pub fn of(ways: &TwoWay, tau: f64) -> Self {
        Self { chamfer: ways.chamfer_squared(), f_score: ways.share_at(tau) }
    }
}

/// What becomes [-1, 1] along its longest side.
#[derive(Debug, Clone, Copy)]
struct UnitBox {
    centre: DVec3,
    half: f64,
}

impl UnitBox {
    const UNIT: Self = Self { centre: DVec3::ZERO, half: 1.0 };

    fn around(points: &[DVec3]) -> Result<Self, MidiError> {
        let (min, max) =
            points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)));
        let size = (max - min).max_element();
        if size > 0.0 {
            Ok(Self { centre: (min + max) / 2.0, half: size / 2.0 })
        } else {
            Err(MidiError::NoExtent { size })
        }
    }

    fn carry(&self, points: &[DVec3]) -> Vec<DVec3> {
        points.iter().map(|p| (*p - self.centre) / self.half).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The outside of a box as triangles.
    fn block(min: [f64; 3], max: [f64; 3]) -> Vec<Triangle> {
        let corner =
            |i: usize| DVec3::from_array([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { max[axis] } else { min[axis] }));
        [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
            .iter()
            .flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]].map(|t| t.map(corner)))
            .collect()
    }

    fn furniture() -> Vec<Vec<Triangle>> {
        vec![
            block([0.0, 0.0, 0.0], [2.0, 0.8, 0.9]),
            block([3.0, 0.0, 0.2], [3.5, 1.8, 1.0]),
            block([1.0, 0.0, 2.0], [1.6, 0.5, 2.7]),
        ]
    }

    fn truth() -> Vec<DVec3> {
        let draw = |(o, draw): (Vec<Triangle>, u32)| sample_surface(&o, 8000, Seed { seed: 99, draw }).unwrap().points;
        furniture().into_iter().zip(0..).flat_map(draw).collect()
    }

    fn options() -> MidiOptions {
        MidiOptions { points_per_object: 8000, ..MidiOptions::default() }
    }

    fn moved(by: impl Fn(DVec3) -> DVec3) -> Vec<Vec<Triangle>> {
        furniture().iter().map(|o| o.iter().map(|t| t.map(&by)).collect()).collect()
    }

    #[test]
    fn a_rigid_error_is_taken_out_before_the_score() {
        let turn = glam::DMat3::from_rotation_y(0.06);
        let s = midi(&moved(|p| turn * p + DVec3::new(0.1, 0.02, -0.05)), &truth(), &options()).unwrap();
        assert_eq!((s.prediction_points, s.truth_points, s.skipped_objects), (24_000, 24_000, 0));
        assert!(s.icp.converged, "{:?}", s.icp);
        assert!(s.score.chamfer < s.before_icp.chamfer / 10.0, "{s:?}");
        assert!(s.score.f_score.f1 > 0.999_999 - 1e-6, "{s:?}");
        assert_eq!(s, midi(&moved(|p| turn * p + DVec3::new(0.1, 0.02, -0.05)), &truth(), &options()).unwrap());
    }

    #[test]
    fn scale_counts_unless_each_set_is_normalised_by_itself() {
        let twice = moved(|p| p * 2.0);
        let by_truth = midi(&twice, &truth(), &options()).unwrap();
        let each = MidiOptions { normalisation: Normalisation::EachByItself, ..options() };
        let each = midi(&twice, &truth(), &each).unwrap();
        assert!(by_truth.score.f_score.f1 < 0.9 && each.score.f_score.f1 > 0.999, "{by_truth:?} {each:?}");
    }

    #[test]
    fn units_and_places_do_not_matter_when_both_share_them() {
        let prediction: Vec<DVec3> = truth().iter().map(|p| *p + DVec3::new(0.05, 0.0, 0.01)).collect();
        let other = |points: &[DVec3]| points.iter().map(|p| *p * 1000.0 + DVec3::splat(700.0)).collect::<Vec<_>>();
        let a = midi_of_points(&prediction, &truth(), &options()).unwrap();
        let b = midi_of_points(&other(&prediction), &other(&truth()), &options()).unwrap();
        assert!((a.before_icp.chamfer - b.before_icp.chamfer).abs() <= 1e-9);
        // Half the longest side is 1.75 m; nobody is farther than the shift.
        let shift = DVec3::new(0.05, 0.0, 0.01).length() / 1.75;
        assert!(a.before_icp.chamfer > 0.0 && a.before_icp.chamfer <= 2.0 * shift * shift);
        assert!(a.score.chamfer <= 1e-9, "{a:?}");
    }

    #[test]
    fn what_has_no_score_says_why() {
        let empty = vec![vec![[DVec3::ZERO; 3]]];
        assert!(matches!(midi(&empty, &truth(), &options()), Err(MidiError::EmptyPrediction(_))));
        assert!(matches!(midi(&[], &truth(), &options()), Err(MidiError::EmptyPrediction(_))));
        let one = [DVec3::ONE];
        assert_eq!(midi_of_points(&one, &one, &options()).unwrap_err(), MidiError::NoExtent { size: 0.0 });
        assert_eq!(midi_of_points(&one, &[], &options()).unwrap_err(), NearestError::Empty.into());
        let some = [vec![[DVec3::ZERO; 3]], furniture().remove(0)];
        assert_eq!(midi(&some, &truth(), &options()).unwrap().skipped_objects, 1);
    }
}
