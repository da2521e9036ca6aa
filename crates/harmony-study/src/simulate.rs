//! Participants with known preferences.
//!
//! Each scene shifts the strengths of the methods a little, so does each person; an order is then drawn by Plackett
//! and Luce's model (Gumbel noise on log strengths). The analysis must find the strengths again, and a lab can see
//! beforehand how wide its intervals would be.

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::build::code;
use crate::log::{Entry, Via};
use crate::private::{OTHER_ROOM, PHOTO_ITSELF, PrivateStudy, TrialKind};
use crate::record::{Answer, LayoutShown};
use crate::shuffle::{panel_order, trial_order};

/// Who takes part.
#[derive(Debug, Clone, PartialEq)]
pub struct Crowd {
    /// People.
    pub people: usize,
    /// Log strength of each method, in the study's order.
    pub strengths: Vec<f64>,
    /// Standard deviation of a scene's own shifts.
    pub scene_sd: f64,
    /// Standard deviation of a person's own shifts.
    pub person_sd: f64,
    /// People, of all, who rank at random and fast.
    pub careless: usize,
    /// Seed.
    pub seed: u64,
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (a, b) = (rng.random_range(f64::MIN_POSITIVE..1.0), rng.random_range(0.0..std::f64::consts::TAU));
    (-2.0 * a.ln()).sqrt() * b.cos()
}

fn gumbel(rng: &mut ChaCha8Rng) -> f64 {
    -(-rng.random_range(f64::MIN_POSITIVE..1.0_f64).ln()).ln()
}

/// The entries of a log that this crowd would leave, in the order in which they would come. The codes are those of the
/// study's invitations.
pub fn simulate(study: &PrivateStudy, crowd: &Crowd) -> Vec<Entry> {
    let k = study.methods.len();
    let mut rng = ChaCha8Rng::seed_from_u64(crowd.seed);
    let mut shifts = |n: usize, sd: f64| -> Vec<Vec<f64>> {
        (0..n).map(|_| (0..k).map(|_| sd * normal(&mut rng)).collect()).collect()
    };
    let of_scenes = shifts(study.trials.len(), crowd.scene_sd);
    let of_people = shifts(crowd.people, crowd.person_sd);
    let mut entries = Vec::new();
    for (person, own) in of_people.iter().enumerate() {
        let participant = code(&study.secret, person);
        let careless = person < crowd.careless;
        for t in trial_order(&study.study, &participant, study.trials.len()) {
            let trial = &study.trials[t];
            // A repeated scene has the shifts of its first showing.
            let scene =
                study.trials.iter().position(|s| s.kind == TrialKind::Scene && s.scene == trial.scene).unwrap_or(t);
            let strength = |method: &str| match study.methods.iter().position(|m| m == method) {
                _ if careless => 0.0,
                Some(m) => crowd.strengths[m] + of_scenes[scene][m] + own[m],
                None if method == PHOTO_ITSELF => 50.0,
                None if method == OTHER_ROOM => -50.0,
                None => 0.0,
            };
            let order = panel_order(&study.study, &participant, &trial.id, trial.panels.len());
            let scores: Vec<f64> =
                order.iter().map(|i| strength(&trial.panels[*i].method) + gumbel(&mut rng)).collect();
            let ranks = scores.iter().map(|s| 1 + scores.iter().filter(|o| *o > s).count() as u8).collect();
            let active_ms = if careless { 1500 } else { 20_000 + rng.random_range(0..40_000) };
            let answer = Answer {
                study: study.study.clone(),
                version: study.version.clone(),
                participant: participant.clone(),
                trial: trial.id.clone(),
                revision: 1,
                order: order.iter().map(|i| trial.panels[*i].id.clone()).collect(),
                ranks,
                active_ms,
                total_ms: active_ms + 500,
                changes: k as u32,
                zooms: 0,
                views: 0,
                layout: LayoutShown::Grid,
            };
            entries.push(Entry::Answer { answer, via: Via::Server });
        }
        entries.push(Entry::Finish { participant });
    }
    entries
}
