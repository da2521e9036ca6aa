//! The questions are asked, and what was answered is kept.

use std::collections::BTreeMap;
use std::sync::Arc;

use futures::StreamExt;
use harmony_calls::Calls;
use harmony_roles::Role;
use serde::{Deserialize, Serialize};

use super::pictures::{JudgeScene, Pair, shown};
use super::question::{Better, Criterion, JudgeAnswer, JudgeQuestion};
use super::tally::{CriterionScore, tally};
use crate::score::Look;

/// Questions under way at a time; the player's own limits hold beside it.
const AT_ONCE: usize = 8;

/// How it is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JudgeOptions {
    /// Which render is shown.
    pub look: Look,
    /// How often each pair is asked about, in both orders.
    pub rounds: usize,
    /// Decides which order comes first, and the bootstrap.
    pub seed: u64,
}

/// One question and its answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Which scene.
    pub scene: String,
    /// Which sets.
    pub pair: Pair,
    /// Which round, from 1.
    pub round: usize,
    /// Whether the second set was A.
    pub swapped: bool,
    /// Under which name the call is recorded.
    pub call: String,
    /// The verdicts, in the letters of the question; `None` when no usable answer came.
    pub verdicts: Option<BTreeMap<Criterion, Better>>,
    /// What the judge saw.
    pub observations: String,
    /// Why there is no answer.
    pub error: Option<String>,
}

/// All that a judge said.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// What asked.
    pub generator: String,
    /// Who judged: player, model and version.
    pub judge: String,
    /// Names of the sets.
    pub sets: Vec<String>,
    /// Which render was shown.
    pub look: Look,
    /// Seed.
    pub seed: u64,
    /// Rounds.
    pub rounds: usize,
    /// Scores by criterion.
    pub scores: Vec<CriterionScore>,
    /// Questions, by scene, pair, round and order.
    pub trials: Vec<Trial>,
}

/// A name of `[a-z0-9_]` that is its scene's alone.
fn slug(scene: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
    let short: String = scene.chars().map(plain).take(40).collect();
    format!("{short}_{}", &blake3::hash(scene.as_bytes()).to_hex()[..8])
}

/// Whether the second set is A in the first question about a scene.
fn second_first(seed: u64, scene: &str, pair: Pair, round: usize) -> bool {
    let text = format!("{seed}|{}|{}|{round}|{scene}", pair.first, pair.second);
    blake3::hash(text.as_bytes()).as_bytes()[0] & 1 == 1
}

/// Asks about every scene, in both orders. What is recorded already is not asked again.
pub async fn judge(
    scenes: &[JudgeScene],
    sets: &[String],
    options: JudgeOptions,
    calls: &Calls,
    tell: &(dyn Fn(String) + Sync),
) -> Judgement {
    let mut trials = Vec::new();
    for scene in scenes {
        for round in 1..=options.rounds.max(1) {
            let swapped = second_first(options.seed, &scene.scene, scene.pair, round);
            for (order, swapped) in [("first", swapped), ("second", !swapped)] {
                let Pair { first, second } = scene.pair;
                // The numbers of a pair are those of the command line, not letters of the question.
                let call = format!("judge/{}/p{first}_{second}/r{round}_{order}", slug(&scene.scene));
                trials.push((scene, round, swapped, call));
            }
        }
    }
    let total = trials.len();
    let done = std::sync::atomic::AtomicUsize::new(0);
    let asked = futures::stream::iter(trials.into_iter().map(|(scene, round, swapped, call)| {
        let done = &done;
        async move {
            let trial = ask(scene, round, swapped, call, calls).await;
            let count = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            let outcome = trial.error.as_deref().unwrap_or("answered");
            tell(format!("{count}/{total} {}: {outcome}", trial.scene));
            trial
        }
    }));
    let trials: Vec<Trial> = asked.buffered(AT_ONCE).collect().await;
    let card = calls.cast().card(Role::VisionLanguage);
    let judge = format!("{} {}", card.player, card.model).trim().to_owned();
    Judgement {
        generator: concat!("HARMONY ", env!("CARGO_PKG_VERSION")).to_owned(),
        judge,
        sets: sets.to_vec(),
        look: options.look,
        seed: options.seed,
        rounds: options.rounds.max(1),
        scores: tally(&trials, sets.len(), options.seed),
        trials,
    }
}

async fn ask(scene: &JudgeScene, round: usize, swapped: bool, call: String, calls: &Calls) -> Trial {
    let mut trial = Trial {
        scene: scene.scene.clone(),
        pair: scene.pair,
        round,
        swapped,
        call: call.clone(),
        verdicts: None,
        observations: String::new(),
        error: None,
    };
    let (photo, views) = match scene.load() {
        Ok(loaded) => loaded,
        Err(reason) => {
            trial.error = Some(reason);
            return trial;
        }
    };
    let question = JudgeQuestion { pictures: shown(&Arc::clone(&photo), &views, swapped), round };
    match calls.ask_as::<JudgeAnswer>(&question.request(call), JudgeAnswer::check).await {
        Ok(answer) => {
            trial.verdicts = Some(Criterion::ALL.into_iter().map(|c| (c, answer.verdict(c).better)).collect());
            trial.observations = answer.observations;
        }
        Err(error) => trial.error = Some(error.to_string()),
    }
    trial
}
