//! Finished runs against truth by named protocols, whatever the truth was read from.
//! Key `eval.geometry`.
//!
//! | protocol | truth | scale | registration | points of each side |
//! |---|---|---|---|---|
//! | `gen3dsr` | surfaces in the camera's frame, metres | none | none | as asked, 1,000,000 in the script |
//! | `harmony` | vertices of the floor furniture | each side by its own largest extent | principal axes, four flips, rigid ICP | 30,000 |
//! | `harmony-iso` | the same | each side by its root mean square radius | the same | 30,000 |
//! | `midi` | surfaces | the truth's box to [-1, 1] | rigid ICP | 20,480 an object, over all at most as asked |
//!
//! `harmony` is the geometry script of the paper's release and almost surely its Table 1: its numbers are **shares of the
//! scene's largest side, not metres**. That side is measured along the axes of each side's own frame (the truth's camera,
//! the run's room), so that even a perfect room is scaled wrongly when the camera is turned; `harmony-iso` does not depend
//! on the frame. Beside every score stands its floor: the truth against another sampling of itself, and, for the two, the
//! truth in the run's frame, which no run can pass.
//!
//! A run that has nothing to compare fails and is counted; the scripts leave it out of their means, and so do the means
//! here, which tell how many were left out.

mod extent;
mod front;
mod front3d;
mod objects;
mod pairing;
mod table;
mod truth;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

pub use extent::{EXTENT_POINTS, ExtentError, Sizing, extent_score};
pub use front::{FrontError, Mirror};
pub use objects::{PieceScore, pieces};
pub use pairing::pair_runs;
pub use table::{csv, objects_csv, text};
pub use truth::{RunPiece, RunSurfaces, TruthPiece, TruthSurfaces, TruthsError, truths_in};

use crate::metrics::gen3dsr::{Alignment, Gen3dsrOptions, Surfaces, TruthRegion, gen3dsr};
use crate::metrics::midi::{MidiOptions, POINTS_PER_OBJECT, midi};
use crate::metrics::sample::{Seed, sample_surface};
use crate::metrics::soup::Triangle;

/// Fewest points of an object in `midi`.
const MIDI_FEWEST: usize = 256;

/// A protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[expect(missing_docs, reason = "the module says what each is")]
pub enum Protocol {
    Gen3dsr,
    Harmony,
    HarmonyIso,
    Midi,
}

impl Protocol {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Gen3dsr, Self::Harmony, Self::HarmonyIso, Self::Midi];

    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gen3dsr => "gen3dsr",
            Self::Harmony => "harmony",
            Self::HarmonyIso => "harmony-iso",
            Self::Midi => "midi",
        }
    }

    /// What a distance of 1 is.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Gen3dsr => "m",
            Self::Harmony => "largest sides",
            Self::HarmonyIso => "sizes by rms radius",
            Self::Midi => "square of half the largest side",
        }
    }
}

impl std::str::FromStr for Protocol {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|p| p.name() == text);
        found.ok_or_else(|| format!("protocols are {}", Self::ALL.map(Self::name).join(", ")))
    }
}

/// Precision, recall and F at one distance, percent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct At {
    /// Distance, in the protocol's unit (not squared).
    pub threshold: f64,
    /// Share of the predicted points that are near.
    pub precision: f64,
    /// Share of the true points that are near.
    pub recall: f64,
    /// Their harmonic mean.
    pub f1: f64,
}

/// Numbers of one comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Numbers {
    /// Chamfer distance as the protocol defines it.
    pub chamfer: f64,
    /// By distance, the largest first.
    pub at: Vec<At>,
}

/// One run by one protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProtocolScore {
    /// Name of the truth.
    pub truth: String,
    /// The run.
    pub run: PathBuf,
    /// Which.
    pub protocol: Protocol,
    /// Points of each side.
    pub points: [usize; 2],
    /// The score; `None` when there is nothing to compare.
    pub score: Option<Numbers>,
    /// Truth against another sampling of itself.
    pub floor: Option<Numbers>,
    /// Truth in the run's frame; only where the frame matters.
    pub floor_in_run_frame: Option<Numbers>,
    /// Why there is no score.
    pub failure: Option<String>,
}

/// What is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct ProtocolOptions {
    /// Which protocols, in order.
    pub protocols: Vec<Protocol>,
    /// Points of each side; `harmony` and `harmony-iso` take at most 30,000.
    pub points: usize,
    /// Seed of the samplings.
    pub seed: u64,
}

/// Scores of one run.
pub fn score_run(
    truth: &TruthSurfaces,
    run: &RunSurfaces,
    folder: &Path,
    options: &ProtocolOptions,
) -> Vec<ProtocolScore> {
    let one = |protocol: &Protocol| {
        let blank = ProtocolScore {
            truth: truth.name.clone(),
            run: folder.to_owned(),
            protocol: *protocol,
            points: [0; 2],
            score: None,
            floor: None,
            floor_in_run_frame: None,
            failure: None,
        };
        let done = match protocol {
            Protocol::Gen3dsr => metres(truth, run, options, &blank),
            Protocol::Harmony => extent(truth, run, options, Sizing::LargestExtent, &blank),
            Protocol::HarmonyIso => extent(truth, run, options, Sizing::RmsRadius, &blank),
            Protocol::Midi => boxed(truth, run, options, &blank),
        };
        done.unwrap_or_else(|failure| ProtocolScore { failure: Some(failure), ..blank })
    };
    options.protocols.iter().map(one).collect()
}

/// The run's triangles in the frame of its camera.
fn seen(run: &RunSurfaces) -> Vec<Vec<Triangle>> {
    run.pieces.iter().map(|p| p.triangles.iter().map(|t| t.map(|q| run.camera.to_camera(q))).collect()).collect()
}

fn metres(
    truth: &TruthSurfaces,
    run: &RunSurfaces,
    o: &ProtocolOptions,
    blank: &ProtocolScore,
) -> Result<ProtocolScore, String> {
    let predicted = seen(run).concat();
    let real: Vec<Triangle> = truth.pieces.iter().flat_map(|p| p.triangles.iter().copied()).collect();
    let options = Gen3dsrOptions {
        points: o.points,
        seed: o.seed,
        alignment: Alignment::Raw,
        truth_region: if truth.whole_room { TruthRegion::Frustum } else { TruthRegion::Whole },
        ..Gen3dsrOptions::default()
    };
    let side = |objects| Surfaces { objects, background: None };
    let s = gen3dsr(side(&predicted), side(&real), truth.camera.size, &truth.camera.intrinsics, &options);
    let s = s.map_err(|e| e.to_string())?;
    let numbers = |d: &crate::metrics::gen3dsr::Distances| Numbers {
        chamfer: d.chamfer,
        at: d
            .at
            .iter()
            .map(|t| At { threshold: t.threshold, precision: t.precision, recall: t.recall, f1: t.f1 })
            .collect(),
    };
    Ok(ProtocolScore {
        points: [o.points; 2],
        score: Some(numbers(&s.score)),
        floor: Some(numbers(&s.floor)),
        ..blank.clone()
    })
}

fn extent(
    truth: &TruthSurfaces,
    run: &RunSurfaces,
    o: &ProtocolOptions,
    sizing: Sizing,
    blank: &ProtocolScore,
) -> Result<ProtocolScore, String> {
    let points = o.points.min(EXTENT_POINTS);
    let furniture: Vec<Triangle> =
        run.pieces.iter().filter(|p| p.furniture).flat_map(|p| p.triangles.iter().copied()).collect();
    let draw = |soup: &[Triangle], draw| sample_surface(soup, points, Seed { seed: o.seed, draw }).map(|s| s.points);
    let predicted = draw(&furniture, 0).map_err(|_| "the run has no floor furniture".to_owned())?;
    let real = truth.vertices(points, Seed { seed: o.seed, draw: 1 });
    if real.is_empty() {
        return Err("the truth has no floor furniture".to_owned());
    }
    let soup: Vec<Triangle> =
        truth.pieces.iter().filter(|p| p.furniture).flat_map(|p| p.triangles.iter().copied()).collect();
    // What a perfect run would be sampled from: the truth's surfaces. A truth of points alone has only them.
    let again = draw(&soup, 2).unwrap_or_else(|_| truth.vertices(points, Seed { seed: o.seed, draw: 2 }));
    let back = run.camera.rotation.transpose();
    let in_room: Vec<glam::DVec3> = again.iter().map(|p| back * *p).collect();
    let score = |points: &[glam::DVec3]| extent_score(points, &real, sizing).map_err(|e| e.to_string());
    Ok(ProtocolScore {
        points: [predicted.len(), real.len()],
        score: Some(score(&predicted)?),
        floor: score(&again).ok(),
        floor_in_run_frame: score(&in_room).ok(),
        ..blank.clone()
    })
}

fn boxed(
    truth: &TruthSurfaces,
    run: &RunSurfaces,
    o: &ProtocolOptions,
    blank: &ProtocolScore,
) -> Result<ProtocolScore, String> {
    let predicted = seen(run);
    let each = |pieces: usize| (o.points / pieces.max(1)).clamp(MIDI_FEWEST, POINTS_PER_OBJECT);
    let sampled = |seed: u64, points: usize| -> Vec<glam::DVec3> {
        let pieces = truth.pieces.iter().zip(0..);
        pieces
            .flat_map(|(p, draw)| {
                sample_surface(&p.triangles, points, Seed { seed, draw }).map(|s| s.points).unwrap_or_default()
            })
            .collect()
    };
    let points = each(truth.pieces.len());
    let real = sampled(o.seed ^ 1, points);
    let options = MidiOptions { points_per_object: each(predicted.len()), seed: o.seed, ..MidiOptions::default() };
    let numbers = |s: &crate::metrics::midi::MidiScore| {
        let f = s.score.f_score;
        let at =
            At { threshold: f.threshold, precision: 100.0 * f.precision, recall: 100.0 * f.recall, f1: 100.0 * f.f1 };
        Numbers { chamfer: s.score.chamfer, at: vec![at] }
    };
    let s = midi(&predicted, &real, &options).map_err(|e| e.to_string())?;
    let own: Vec<Vec<Triangle>> = truth.pieces.iter().map(|p| p.triangles.clone()).collect();
    let options = MidiOptions { points_per_object: points, seed: o.seed ^ 2, ..MidiOptions::default() };
    let floor = midi(&own, &real, &options).ok();
    Ok(ProtocolScore {
        points: [s.prediction_points, s.truth_points],
        score: Some(numbers(&s)),
        floor: floor.as_ref().map(numbers),
        ..blank.clone()
    })
}
