//! Whether a change stays: the energy of the whole scene before and after it.
//!
//! All objects are counted, for a change uncovers and hides others; to it comes what pairs that are in one another
//! cost, and the mask of what is gone, which nothing explains. The reviewer's word is worth the odds of being right
//! (`accept`). Nats; the report tells the terms that rose. Objects without a mask count only by what they hide and
//! touch.

use harmony_scene::ObjectId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ReviewOutcome;
use crate::accept::{accepts, odds, total};
use crate::contact::collision::collisions;
use crate::scene::Energy;
use crate::terms::{NAMED, absent_energy, scene_energy};
use crate::{Evidence, PartialScene, PlacementSettings, measure};

/// Outline agreement below which a mask was not met at all.
const MET: f64 = 0.05;

/// The judgement of an action.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Verdict {
    /// Whether the change stays.
    pub kept: bool,
    /// Energy of the whole scene after it, less than before: negative speaks for it, nats.
    pub energy_change: f64,
    /// Why, in one sentence.
    pub reason: String,
    /// Mean silhouette IoU of the objects concerned, before.
    pub iou_before: f64,
    /// And after.
    pub iou_after: f64,
    /// Mean depth residual before, metres, when there is depth.
    pub depth_before_m: Option<f64>,
    /// And after.
    pub depth_after_m: Option<f64>,
    /// Deepest penetration before, metres.
    pub penetration_before_m: f64,
    /// And after.
    pub penetration_after_m: f64,
}

/// Compares the scene before and after actions that were tried together.
///
/// A change is kept when the energy of the whole scene does not rise by more than the word of a reviewer is worth: masks and
/// depths of everything that it touches, hides or uncovers, sizes, turns, places, and how deep things are in one another. The
/// mask of an object that is gone is not explained by anything.
pub fn judge(before: &PartialScene, after: &ReviewOutcome, settings: &PlacementSettings) -> Verdict {
    let concerned: Vec<&ObjectId> = after.touched.iter().chain(&after.removed).collect();
    let old = |id: &ObjectId| before.position(id).map(|i| measure(before, i, settings));
    let earlier: Vec<Evidence> = concerned.iter().filter_map(|id| old(id)).collect();
    let (was, is) = (scene_energy(before, settings), scene_energy(&after.scene, settings));
    let gone = before.placed.iter().enumerate().filter(|(_, p)| after.removed.contains(&p.item.id));
    // A mask that was not met by what is gone is explained as little as before.
    let unexplained: f64 = gone
        .filter_map(|(i, _)| {
            let absent = absent_energy(before, i, settings)?;
            let met = measure(before, i, settings).silhouette_iou.is_none_or(|iou| iou >= MET);
            Some(if met { absent } else { absent.min(was[i].silhouette) })
        })
        .sum();
    let (pressed, presses) = (penetration(before, settings), penetration(&after.scene, settings));
    let change = total(&is) + presses + unexplained - total(&was) - pressed;
    let kept = after.missed.is_none() && accepts(0.0, change, odds(settings.noise.wrong_review));
    let iou = |all: &[Evidence]| mean(all.iter().filter_map(|e| e.silhouette_iou));
    let depth = |all: &[Evidence]| mean(all.iter().filter_map(|e| e.depth_residual_m));
    let deepest = |all: &[Evidence]| all.iter().map(|e| e.penetration_m).fold(0.0, f64::max);
    let reason = if let Some(missed) = &after.missed {
        missed.clone()
    } else if kept {
        "the evidence does not speak against it".to_owned()
    } else if unexplained > 0.0 {
        format!("the photo shows it: without it {unexplained:.0} nats of its mask are not explained")
    } else {
        format!("the evidence speaks against it: {}", against(&was, &is, presses - pressed))
    };
    Verdict {
        kept,
        energy_change: change,
        reason,
        iou_before: iou(&earlier).unwrap_or(0.0),
        iou_after: iou(&after.evidence).unwrap_or(0.0),
        depth_before_m: depth(&earlier),
        depth_after_m: depth(&after.evidence),
        penetration_before_m: deepest(&earlier),
        penetration_after_m: deepest(&after.evidence),
    }
}

/// Compares two placements of the same objects.
///
/// Negative: the second one explains more, nats.
pub fn energy_change(before: &PartialScene, after: &PartialScene, settings: &PlacementSettings) -> f64 {
    let of = |scene: &PartialScene| total(&scene_energy(scene, settings)) + penetration(scene, settings);
    of(after) - of(before)
}

/// The name of a term, and the term.
type Term = (&'static str, fn(&Energy) -> f64);

/// The terms that rose most, in words.
fn against(was: &[Energy], is: &[Energy], deeper: f64) -> String {
    let sum = |all: &[Energy], of: fn(&Energy) -> f64| all.iter().map(of).sum::<f64>();
    let terms: [Term; 7] = [
        ("silhouettes", |e| e.silhouette),
        ("depths", |e| e.depth),
        ("sizes", |e| e.size),
        ("turns", |e| e.yaw),
        ("places", |e| e.place),
        ("supports", |e| e.support),
        ("relations", |e| e.prior),
    ];
    let risen = terms.iter().map(|(name, of)| (*name, sum(is, *of) - sum(was, *of)));
    let mut risen: Vec<(&str, f64)> = risen.chain([("things in one another", deeper)]).filter(|r| r.1 > 0.5).collect();
    risen.sort_by(|a, b| b.1.total_cmp(&a.1));
    let told: Vec<String> = risen.iter().map(|(name, by)| format!("{name} +{by:.1} nats")).collect();
    told.join(", ")
}

/// What things that are in one another cost.
fn penetration(scene: &PartialScene, settings: &PlacementSettings) -> f64 {
    collisions(scene, settings).iter().map(|c| NAMED.loss(c.penetration / settings.noise.penetration)).sum()
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let all: Vec<f64> = values.collect();
    (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
}
