//! What a reviewer of two pictures would notice: gross faults only, most of them, and now and then one that is none.

use glam::DVec3;
use harmony_prompts::{ReviewActionAnswer, ReviewActionKind, ReviewAnswer, ReviewQuestion};
use harmony_scene::Support;
use rand::Rng;

use super::{Oracle, normal};

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
            let mut rng = self.draws.rng(&format!("review {id}"));
            let sees = rng.random::<f64>() < self.noise.noticed;
            let imagines = rng.random::<f64>() < self.noise.false_alarms;
            let action = |kind: ReviewActionKind, reason: &str| ReviewActionAnswer {
                action: kind,
                id: id.to_owned(),
                other: None,
                delta_m: None,
                position_m: None,
                angle_deg: None,
                factor: None,
                reason: reason.to_owned(),
            };
            if imagines {
                let delta = DVec3::new(0.3 * normal(&mut rng), 0.0, 0.3 * normal(&mut rng));
                let made_up = action(ReviewActionKind::Move, "it looks shifted");
                actions.push(ReviewActionAnswer { delta_m: Some(delta.to_array()), ..made_up });
                continue;
            }
            if !sees {
                continue;
            }
            if let Support::Object { id: host } = &object.support {
                let right = self.id_of(host.as_str());
                let is_right = matches!(&row.support, Support::Object { id } if Some(id.as_str()) == right.as_deref());
                if let (false, Some(right)) = (is_right, right) {
                    let rehost = action(ReviewActionKind::Rehost, "it stands on something else in the photo");
                    actions.push(ReviewActionAnswer { other: Some(right), ..rehost });
                    continue;
                }
            }
            let turn = object.yaw.to_degrees() - row.yaw_deg;
            let turn = (turn + 180.0).rem_euclid(360.0) - 180.0;
            if Self::turns_matter(object) && turn.abs() > VISIBLE_TURN {
                let quarter = (turn / 45.0).round() * 45.0;
                let rotate = action(ReviewActionKind::Rotate, "it is turned differently in the photo");
                actions.push(ReviewActionAnswer { angle_deg: Some(quarter), ..rotate });
                continue;
            }
            let now = row.size.as_vec().max(DVec3::splat(1e-3));
            let ratio = (object.size / now).max(DVec3::splat(1e-3));
            let ratio = (ratio.x * ratio.y * ratio.z).cbrt();
            if ratio.max(1.0 / ratio) > VISIBLE_RATIO {
                let factor = (ratio * (0.3 * self.noise.size * normal(&mut rng)).exp()).clamp(0.25, 4.0);
                let rescale = action(ReviewActionKind::Rescale, "its size differs from the photo");
                actions.push(ReviewActionAnswer { factor: Some([factor; 3]), ..rescale });
                continue;
            }
            let off = object.position - DVec3::from_array(row.position);
            let off = DVec3::new(off.x, 0.0, off.z);
            if off.length() > VISIBLE_MOVE {
                let guess = off * (1.0 + 2.0 * self.noise.size * normal(&mut rng)).clamp(0.2, 2.0);
                let shift = action(ReviewActionKind::Move, "it stands elsewhere in the photo");
                actions.push(ReviewActionAnswer { delta_m: Some(guess.to_array()), ..shift });
            }
        }
        let converged = actions.is_empty();
        ReviewAnswer { issues: actions.iter().map(|a| a.reason.clone()).collect(), actions, converged }
    }
}
