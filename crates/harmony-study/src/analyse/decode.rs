//! From the log to rankings of methods.
//!
//! Paper: "identities are decoded only afterward, from the stored seed". The order of panels is computed anew from
//! participant and trial; an answer whose stored order differs is left out and counted.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::log::{Entry, Via};
use crate::private::{OTHER_ROOM, PHOTO_ITSELF, PrivateStudy, TrialKind};
use crate::record::Answer;
use crate::shuffle::panel_order;

/// One person's ranking of one scene.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Ranking {
    /// Who.
    pub participant: String,
    /// Of which scene.
    pub scene: String,
    /// Rank of each method, in the study's order.
    pub ranks: Vec<u8>,
    /// Which letter each method had, 0 = A.
    pub letters: Vec<usize>,
    /// Time at it, milliseconds.
    pub active_ms: u64,
}

/// What is known of a participant.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Participant {
    /// Code.
    pub code: String,
    /// Whether they handed in.
    pub finished: bool,
    /// Scenes ranked.
    pub rankings: usize,
    /// Median time a trial, milliseconds.
    pub median_ms: u64,
    /// Attention checks passed.
    pub checks_passed: usize,
    /// Attention checks failed.
    pub checks_failed: usize,
    /// Kendall's tau of each repeated scene with its first ranking.
    pub repeats: Vec<f64>,
    /// Why they are left out; empty = they count.
    pub left_out: Vec<String>,
}

/// The log, decoded.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Decoded {
    /// Rankings of scenes, repeats and checks not among them.
    pub rankings: Vec<Ranking>,
    /// Participants by code.
    pub participants: Vec<Participant>,
    /// Answers in the log, changes of earlier ones among them.
    pub answers: usize,
    /// Answers that do not decode.
    pub undecodable: usize,
    /// Answers from files that nobody signed.
    pub unsigned: usize,
}

impl Decoded {
    /// Rankings of those who count.
    pub fn counted(&self) -> Vec<&Ranking> {
        let out: BTreeSet<&str> =
            self.participants.iter().filter(|p| !p.left_out.is_empty()).map(|p| p.code.as_str()).collect();
        self.rankings.iter().filter(|r| !out.contains(r.participant.as_str())).collect()
    }
}

/// Decodes a log. With `partial`, those who did not hand in count, too.
pub fn decode(entries: &[Entry], study: &PrivateStudy, partial: bool) -> Decoded {
    let mut latest: BTreeMap<(&str, &str), &Answer> = BTreeMap::new();
    let mut finished = BTreeSet::new();
    let mut decoded = Decoded::default();
    for entry in entries {
        match entry {
            Entry::Study { .. } => {}
            Entry::Finish { participant } => {
                finished.insert(participant.as_str());
            }
            Entry::Answer { answer, via } => {
                decoded.answers += 1;
                decoded.unsigned += usize::from(*via == Via::UnsignedFile);
                if answer.check(study).is_err() {
                    decoded.undecodable += 1;
                    continue;
                }
                let held = latest.entry((&answer.participant, &answer.trial)).or_insert(answer);
                if answer.revision > held.revision {
                    *held = answer;
                }
            }
        }
    }
    let codes: BTreeSet<&str> = latest.keys().map(|(p, _)| *p).collect();
    for code in codes {
        let answers: Vec<&Answer> = latest.iter().filter(|((p, _), _)| *p == code).map(|(_, a)| *a).collect();
        person(code, &answers, finished.contains(code), study, partial, &mut decoded);
    }
    decoded
}

fn person(code: &str, answers: &[&Answer], finished: bool, study: &PrivateStudy, partial: bool, decoded: &mut Decoded) {
    let mut scenes: BTreeMap<&str, Ranking> = BTreeMap::new();
    let mut repeated: BTreeMap<&str, Ranking> = BTreeMap::new();
    let (mut passed, mut failed) = (0, 0);
    let mut times = Vec::new();
    for answer in answers {
        let Some(trial) = study.trials.iter().find(|t| t.id == answer.trial) else { continue };
        times.push(answer.active_ms);
        let order = panel_order(&study.study, code, &trial.id, trial.panels.len());
        let method_of = |letter: usize| trial.panels[order[letter]].method.as_str();
        let rank_of = |method: &str| (0..order.len()).find(|l| method_of(*l) == method).map(|l| (answer.ranks[l], l));
        if trial.kind == TrialKind::Check {
            let first = rank_of(PHOTO_ITSELF).is_some_and(|(r, _)| r == 1);
            let last = rank_of(OTHER_ROOM).is_some_and(|(r, _)| usize::from(r) == order.len());
            if first && last {
                passed += 1;
            } else {
                failed += 1;
            }
            continue;
        }
        let placed: Option<Vec<(u8, usize)>> = study.methods.iter().map(|m| rank_of(m)).collect();
        let Some(placed) = placed else { continue };
        let ranking = Ranking {
            participant: code.to_owned(),
            scene: trial.scene.clone(),
            ranks: placed.iter().map(|(r, _)| *r).collect(),
            letters: placed.iter().map(|(_, l)| *l).collect(),
            active_ms: answer.active_ms,
        };
        if trial.kind == TrialKind::Repeat { &mut repeated } else { &mut scenes }.insert(&trial.scene, ranking);
    }
    let repeats = repeated
        .iter()
        .filter_map(|(scene, again)| Some(super::stats::kendall_tau(&scenes.get(scene)?.ranks, &again.ranks)))
        .collect();
    times.sort_unstable();
    let median_ms = times.get(times.len() / 2).copied().unwrap_or(0);
    let mut left_out = Vec::new();
    if !finished && !partial {
        left_out.push("did not hand in".to_owned());
    }
    if median_ms < study.exclusion.min_median_ms {
        left_out.push(format!("{:.1} s a trial are too few", median_ms as f64 / 1000.0));
    }
    if failed > study.exclusion.failed_checks {
        left_out.push(format!("failed {failed} of {} attention checks", passed + failed));
    }
    decoded.participants.push(Participant {
        code: code.to_owned(),
        finished,
        rankings: scenes.len(),
        median_ms,
        checks_passed: passed,
        checks_failed: failed,
        repeats,
        left_out,
    });
    decoded.rankings.extend(scenes.into_values());
}
