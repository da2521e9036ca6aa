//! What a reviewer of two pictures would notice: gross faults only, most of them, and now and then one that is none.

use glam::DVec3;
use harmony_pipeline::LookKind;
use harmony_prompts::{PlacedObject, ReviewActionAnswer, ReviewActionKind, ReviewAnswer, ReviewQuestion};
use harmony_scene::Support;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::{Oracle, normal};
use crate::truth::TruthObject;

/// Displacement that can be seen by comparing two pictures, metres.
const VISIBLE_MOVE: f64 = 0.2;
/// Turn that can be seen, degrees.
const VISIBLE_TURN: f64 = 40.0;
/// Ratio of sizes that can be seen.
const VISIBLE_RATIO: f64 = 1.25;

impl Oracle {
    pub(super) fn review(&self, question: &ReviewQuestion) -> ReviewAnswer {
        let mut actions = Vec::new();
        for row in &question.placed {
            let id = row.id.as_str();
            let Some(object) = self.known(id).filter(|o| o.level == question.level) else { continue };
            let purpose = format!("review {id}");
            let mut rng = self.draws.rng(&purpose);
            let sees = rng.random::<f64>() < self.noise.noticed;
            let imagines = rng.random::<f64>() < self.noise.false_alarms;
            if imagines {
                let delta = DVec3::new(0.3 * normal(&mut rng), 0.0, 0.3 * normal(&mut rng));
                let made_up = action(id, ReviewActionKind::Move, "it looks shifted");
                actions.push(ReviewActionAnswer { delta_m: Some(delta.to_array()), ..made_up });
                continue;
            }
            let Some(mended) = self.mended(row, object, &mut rng) else { continue };
            self.shown(LookKind::Review, &purpose, sees);
            if sees {
                actions.push(mended);
            }
        }
        let converged = actions.is_empty();
        ReviewAnswer { issues: actions.iter().map(|a| a.reason.clone()).collect(), actions, converged }
    }
    /// The action that puts an object right, as well as a reviewer can say it, where its fault can be seen.
    fn mended(&self, row: &PlacedObject, object: &TruthObject, rng: &mut ChaCha8Rng) -> Option<ReviewActionAnswer> {
        let action = |kind: ReviewActionKind, reason: &str| action(row.id.as_str(), kind, reason);
        if let Support::Object { id: host } = &object.support {
            let right = self.id_of(host.as_str());
            let is_right = matches!(&row.support, Support::Object { id } if Some(id.as_str()) == right.as_deref());
            if let (false, Some(right)) = (is_right, right) {
                let rehost = action(ReviewActionKind::Rehost, "it stands on something else in the photo");
                return Some(ReviewActionAnswer { other: Some(right), ..rehost });
            }
        }
        let turn = object.yaw.to_degrees() - row.yaw_deg;
        let turn = (turn + 180.0).rem_euclid(360.0) - 180.0;
        if Self::turns_matter(object) && turn.abs() > VISIBLE_TURN {
            let quarter = (turn / 45.0).round() * 45.0;
            let rotate = action(ReviewActionKind::Rotate, "it is turned differently in the photo");
            return Some(ReviewActionAnswer { angle_deg: Some(quarter), ..rotate });
        }
        let now = row.size.as_vec().max(DVec3::splat(1e-3));
        let ratio = (object.size / now).max(DVec3::splat(1e-3));
        let ratio = (ratio.x * ratio.y * ratio.z).cbrt();
        if ratio.max(1.0 / ratio) > VISIBLE_RATIO {
            let factor = (ratio * (0.3 * self.noise.size * normal(rng)).exp()).clamp(0.25, 4.0);
            let rescale = action(ReviewActionKind::Rescale, "its size differs from the photo");
            return Some(ReviewActionAnswer { factor: Some([factor; 3]), ..rescale });
        }
        let off = object.position - DVec3::from_array(row.position);
        let off = DVec3::new(off.x, 0.0, off.z);
        (off.length() > VISIBLE_MOVE).then(|| {
            let guess = off * (1.0 + 2.0 * self.noise.size * normal(rng)).clamp(0.2, 2.0);
            let shift = action(ReviewActionKind::Move, "it stands elsewhere in the photo");
            ReviewActionAnswer { delta_m: Some(guess.to_array()), ..shift }
        })
    }
}

/// An action without its figures.
fn action(id: &str, action: ReviewActionKind, reason: &str) -> ReviewActionAnswer {
    ReviewActionAnswer {
        action,
        id: id.to_owned(),
        other: None,
        delta_m: None,
        position_m: None,
        angle_deg: None,
        factor: None,
        reason: reason.to_owned(),
    }
}
