//! The geometry protocol of Gen3DSR's evaluation on 3D-FRONT: in metres. The paper's Table 1 almost surely uses another one
//! ([`crate::protocols`]).
//!
//! Source: `src/eval_front.py` and `src/util.py` of the Gen3DSR repository (A. Dogaru et al., "Gen3DSR", 2025).
//! Objects are compared in the camera frame, in metres, without any registration. The prediction's objects are cut by
//! the four side planes of the camera's frustum; true objects and both backgrounds are not. The script skips scenes
//! whose reconstruction is empty: here they are [`Gen3dsrError::EmptyPrediction`], and [`Gen3dsrSummary`] counts them.
//!
//! At the finest threshold, 1 mm, the score mostly measures how densely surfaces are sampled; every score therefore
//! comes with its floor, the truth against another sampling of itself.

use glam::DVec3;
use harmony_scene::{ImageSize, Intrinsics};
use serde::{Deserialize, Serialize};

use super::nearest::{NearestError, NearestIndex};
use super::sample::{NoSurface, Seed, sample_surface};
use super::soup::{Frustum, Triangle, scaled};
use super::two_way::{ThresholdScore, TwoWay};

/// Points drawn from each side (the script's default).
pub const POINTS: usize = 1_000_000;
/// Thresholds of precision and recall, metres (the script's).
pub const THRESHOLDS: [f64; 3] = [0.1, 0.01, 0.001];

/// How the prediction was brought to the truth's scale.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Alignment {
    /// As it is.
    Raw,
    /// Scaled about the camera's centre, by a factor from [`super::depth::median_depth_scale`] for instance.
    Scaled {
        /// Multiplies predicted lengths.
        factor: f64,
    },
}

/// Which part of the true objects counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TruthRegion {
    /// All that is handed in, as in the script (whose truth holds the objects of one view).
    Whole,
    /// The part inside the frustum, for a truth that holds the whole room. A departure from the script.
    Frustum,
}

/// What the protocol leaves open.
#[derive(Debug, Clone, PartialEq)]
pub struct Gen3dsrOptions {
    /// Points drawn from each side.
    pub points: usize,
    /// Seed of the samplings.
    pub seed: u64,
    /// Thresholds of precision and recall, metres.
    pub thresholds: Vec<f64>,
    /// Scale of the prediction.
    pub alignment: Alignment,
    /// Which part of the true objects counts.
    pub truth_region: TruthRegion,
}

impl Default for Gen3dsrOptions {
    fn default() -> Self {
        Self {
            points: POINTS,
            seed: 0,
            thresholds: THRESHOLDS.to_vec(),
            alignment: Alignment::Raw,
            truth_region: TruthRegion::Whole,
        }
    }
}

/// Surfaces in the camera frame, metres (a prediction to be scaled: its own unit).
#[derive(Debug, Clone, Copy, Default)]
pub struct Surfaces<'a> {
    /// All objects.
    pub objects: &'a [Triangle],
    /// Walls, floor and ceiling, for instance from [`super::soup::depth_soup`]; counts only when the truth has one.
    pub background: Option<&'a [Triangle]>,
}

/// Chamfer distance and scores.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Distances {
    /// Half the sum of both mean distances, metres.
    pub chamfer: f64,
    /// Precision, recall and F1 in percent, for each threshold in metres.
    pub at: Vec<ThresholdScore>,
}

/// The result of one scene, with all that a reader needs to compare it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gen3dsrScore {
    /// Always "gen3dsr".
    pub protocol: &'static str,
    /// Unit of thresholds and distances: always "metres"; scores are in percent.
    pub unit: &'static str,
    /// Points drawn from each side.
    pub points: usize,
    /// Seed of the samplings.
    pub seed: u64,
    /// Scale of the prediction.
    pub alignment: Alignment,
    /// Which part of the true objects counted.
    pub truth_region: TruthRegion,
    /// Whether backgrounds were compared, too.
    pub background: bool,
    /// Predicted area that was compared, square metres.
    pub prediction_area: f64,
    /// Predicted triangles left out: without area, or with corners that are not finite.
    pub prediction_skipped: usize,
    /// True area that was compared, square metres.
    pub truth_area: f64,
    /// Prediction against truth.
    pub score: Distances,
    /// Truth against a second sampling of the truth: what a perfect prediction would get.
    pub floor: Distances,
}

/// Why a scene has no score.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Gen3dsrError {
    /// Nothing predicted falls into the image. The script skips such scenes.
    #[error("the prediction has no surface in the image")]
    EmptyPrediction(#[source] NoSurface),
    /// The truth has no surface.
    #[error("the truth has no surface")]
    EmptyTruth(#[source] NoSurface),
    /// The scale is not a positive number.
    #[error("a scale of {factor} cannot be applied")]
    Scale {
        /// The factor.
        factor: f64,
    },
    /// No points are asked for, or coordinates are out of range.
    #[error(transparent)]
    Points(#[from] NearestError),
}

/// Compares a predicted scene with the true one; both are in the frame of the camera with `intrinsics`.
///
/// # Errors
/// [`Gen3dsrError`].
pub fn gen3dsr(
    prediction: Surfaces<'_>,
    truth: Surfaces<'_>,
    size: ImageSize,
    intrinsics: &Intrinsics,
    options: &Gen3dsrOptions,
) -> Result<Gen3dsrScore, Gen3dsrError> {
    let factor = match options.alignment {
        Alignment::Raw => 1.0,
        Alignment::Scaled { factor } if factor > 0.0 && factor.is_finite() => factor,
        Alignment::Scaled { factor } => return Err(Gen3dsrError::Scale { factor }),
    };
    let frustum = Frustum::new(size, intrinsics, 0.0);
    let mut predicted = frustum.cut(&scaled(prediction.objects, factor));
    let mut real = match options.truth_region {
        TruthRegion::Whole => truth.objects.to_vec(),
        TruthRegion::Frustum => frustum.cut(truth.objects),
    };
    if let Some(background) = truth.background {
        real.extend_from_slice(background);
        predicted.extend(scaled(prediction.background.unwrap_or_default(), factor));
    }
    let draw = |soup: &[Triangle], draw| sample_surface(soup, options.points, Seed { seed: options.seed, draw });
    let predicted = draw(&predicted, 0).map_err(Gen3dsrError::EmptyPrediction)?;
    let again = draw(&real, 2).map_err(Gen3dsrError::EmptyTruth)?;
    let real = draw(&real, 1).map_err(Gen3dsrError::EmptyTruth)?;
    let index = NearestIndex::build(&real.points)?;
    let compare = |points: &[DVec3]| {
        let ways = TwoWay {
            from_prediction: index.distances(points)?,
            from_truth: NearestIndex::build(points)?.distances(&real.points)?,
        };
        Ok::<_, NearestError>(Distances::of(&ways, &options.thresholds))
    };
    Ok(Gen3dsrScore {
        protocol: "gen3dsr",
        unit: "metres",
        points: options.points,
        seed: options.seed,
        alignment: options.alignment,
        truth_region: options.truth_region,
        background: truth.background.is_some(),
        prediction_area: predicted.area,
        prediction_skipped: predicted.skipped,
        truth_area: real.area,
        score: compare(&predicted.points)?,
        floor: compare(&again.points)?,
    })
}

impl Distances {
    /// The protocol's numbers from distances in metres.
    pub fn of(ways: &TwoWay, thresholds: &[f64]) -> Self {
        Self { chamfer: ways.chamfer(), at: thresholds.iter().map(|t| ways.percent_at(*t)).collect() }
    }

    /// The mean of each number over scenes with the same thresholds; `None` without scenes or when thresholds differ.
    fn mean(scenes: &[&Self]) -> Option<Self> {
        let first = scenes.first()?;
        let thresholds = |d: &Self| d.at.iter().map(|s| s.threshold).collect::<Vec<_>>();
        if scenes.iter().any(|d| thresholds(d) != thresholds(first)) {
            return None;
        }
        let over = |value: &dyn Fn(&Self) -> f64| scenes.iter().map(|d| value(d)).sum::<f64>() / scenes.len() as f64;
        let at = |i: usize| ThresholdScore {
            threshold: first.at[i].threshold,
            precision: over(&|d| d.at[i].precision),
            recall: over(&|d| d.at[i].recall),
            f1: over(&|d| d.at[i].f1),
        };
        Some(Self { chamfer: over(&|d| d.chamfer), at: (0..first.at.len()).map(at).collect() })
    }
}

/// Means over scenes, as the script takes them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gen3dsrSummary {
    /// Scenes that were compared.
    pub scenes: usize,
    /// Scenes left out because their reconstruction is empty.
    pub skipped: usize,
    /// Mean of each number over the scenes.
    pub score: Distances,
    /// Mean of the floors.
    pub floor: Distances,
}

impl Gen3dsrSummary {
    /// Means over `scores`; `None` without scores, or when their thresholds differ.
    pub fn of(scores: &[Gen3dsrScore], skipped: usize) -> Option<Self> {
        let score = Distances::mean(&scores.iter().map(|s| &s.score).collect::<Vec<_>>())?;
        let floor = Distances::mean(&scores.iter().map(|s| &s.floor).collect::<Vec<_>>())?;
        Some(Self { scenes: scores.len(), skipped, score, floor })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS_HERE: usize = 50_000;

    fn camera() -> (ImageSize, Intrinsics) {
        let size = ImageSize::new(200, 100);
        (size, Intrinsics::centred(size, 100.0))
    }

    fn wall(half_width: f64, half_height: f64, z: f64) -> Vec<Triangle> {
        let corner = |x: f64, y: f64| DVec3::new(x * half_width, y * half_height, z);
        let (a, b, c, d) = (corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0));
        vec![[a, b, c], [a, c, d]]
    }

    fn compare(prediction: Surfaces<'_>, truth: Surfaces<'_>, options: Gen3dsrOptions) -> Gen3dsrScore {
        let (size, k) = camera();
        gen3dsr(prediction, truth, size, &k, &Gen3dsrOptions { points: POINTS_HERE, ..options }).unwrap()
    }

    fn objects(objects: &[Triangle]) -> Surfaces<'_> {
        Surfaces { objects, background: None }
    }

    #[test]
    fn a_plane_behind_another_is_as_far_as_it_is() {
        // Both exactly fill the frustum's cut of the first.
        let (near, far) = (wall(2.0, 1.0, 2.0), wall(2.0, 1.0, 2.05));
        let options = Gen3dsrOptions::default();
        let s = compare(objects(&far), objects(&near), options.clone());
        // Nearest points are up to about a sample spacing aside: sqrt(8 / 50,000) = 13 mm, so 50 mm become 51.
        assert!(s.score.chamfer >= 0.05 && s.score.chamfer <= 0.053, "{s:?}");
        assert!(s.score.at[0].f1 > 99.99 && s.score.at[1].f1 == 0.0);
        assert!((s.truth_area - 8.0).abs() <= 1e-9 && (s.prediction_area - 8.0).abs() <= 1e-9);
        // Mean distance to a Poisson sample of density n / A is half its inverse root.
        let expected = 0.5 * (8.0 / POINTS_HERE as f64).sqrt();
        assert!((s.floor.chamfer / expected - 1.0).abs() <= 0.03, "{} {expected}", s.floor.chamfer);
        // And 1 - exp(-pi n t^2 / A) of the points have a neighbour within t.
        let share = 100.0 * (1.0 - (-std::f64::consts::PI * POINTS_HERE as f64 * 1e-4 / 8.0).exp());
        assert!((s.floor.at[1].f1 - share).abs() <= 2.0, "{:?} {share}", s.floor.at[1]);
        assert_eq!(s, compare(objects(&far), objects(&near), options), "same seed, same numbers");
    }

    #[test]
    fn the_prediction_is_cut_and_the_truth_when_asked() {
        let wide = wall(20.0, 10.0, 2.0);
        let seen = wall(2.0, 1.0, 2.0);
        let s = compare(objects(&wide), objects(&seen), Gen3dsrOptions::default());
        assert!((s.prediction_area - 8.0).abs() <= 1e-9);
        assert!(s.score.at[0].precision == 100.0 && s.score.at[0].recall == 100.0);
        let s = compare(objects(&wide), objects(&wide), Gen3dsrOptions::default());
        assert!((s.truth_area - 800.0).abs() <= 1e-9 && s.score.at[0].recall < 5.0, "the script keeps the truth whole");
        let options = Gen3dsrOptions { truth_region: TruthRegion::Frustum, ..Gen3dsrOptions::default() };
        let s = compare(objects(&wide), objects(&wide), options);
        assert!((s.truth_area - 8.0).abs() <= 1e-9 && s.score.at[0].recall == 100.0);
    }

    #[test]
    fn a_scale_is_applied_before_the_cut() {
        let (half, full) = (wall(4.0, 4.0, 1.0), wall(2.0, 1.0, 2.0));
        let options = Gen3dsrOptions { alignment: Alignment::Scaled { factor: 2.0 }, ..Gen3dsrOptions::default() };
        let s = compare(objects(&half), objects(&full), options);
        assert!((s.prediction_area - 8.0).abs() <= 1e-9);
        assert!((s.score.chamfer - s.floor.chamfer).abs() <= 2e-4);
    }

    #[test]
    fn backgrounds_count_when_the_truth_has_one() {
        let (object, back) = (wall(0.5, 0.5, 2.0), wall(3.0, 1.5, 3.0));
        let with = Surfaces { objects: &object, background: Some(&back) };
        let s = compare(with, with, Gen3dsrOptions::default());
        assert!(s.background && (s.prediction_area - 19.0).abs() <= 1e-9 && (s.truth_area - 19.0).abs() <= 1e-9);
        let s = compare(with, objects(&object), Gen3dsrOptions::default());
        assert!(!s.background && (s.prediction_area - 1.0).abs() <= 1e-9);
        let s = compare(objects(&object), with, Gen3dsrOptions::default());
        assert!(s.background && s.score.at[0].recall < 15.0 && s.score.at[0].precision > 99.9);
    }

    #[test]
    fn what_has_no_score_says_why_and_means_are_plain() {
        let (size, k) = camera();
        let (behind, wall) = (wall(1.0, 1.0, -2.0), wall(1.0, 1.0, 2.0));
        let options = Gen3dsrOptions { points: 1000, ..Gen3dsrOptions::default() };
        let run = |p: &[Triangle], t: &[Triangle], options: &Gen3dsrOptions| {
            gen3dsr(objects(p), objects(t), size, &k, options)
        };
        assert!(matches!(run(&behind, &wall, &options), Err(Gen3dsrError::EmptyPrediction(_))));
        assert!(matches!(run(&wall, &[], &options), Err(Gen3dsrError::EmptyTruth(_))));
        let none = Gen3dsrOptions { points: 0, ..options.clone() };
        assert_eq!(run(&wall, &wall, &none).unwrap_err(), Gen3dsrError::Points(NearestError::Empty));
        let bad = Gen3dsrOptions { alignment: Alignment::Scaled { factor: f64::NAN }, ..options.clone() };
        assert!(matches!(run(&wall, &wall, &bad), Err(Gen3dsrError::Scale { .. })));
        let one = run(&wall, &wall, &options).unwrap();
        let mut other = one.clone();
        other.score.chamfer += 2.0;
        other.score.at[0].f1 = 0.0;
        let mean = Gen3dsrSummary::of(&[one.clone(), other], 3).unwrap();
        assert!((mean.score.chamfer - one.score.chamfer - 1.0).abs() <= 1e-12);
        assert!((mean.score.at[0].f1 - one.score.at[0].f1 / 2.0).abs() <= 1e-12);
        assert_eq!((mean.scenes, mean.skipped), (2, 3));
        assert_eq!(Gen3dsrSummary::of(&[], 3), None);
    }
}
