//! Rulings from both orders, and scores from rulings.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use serde::{Deserialize, Serialize};

use super::bradley_terry::{PRIOR, strengths};
use super::pictures::Pair;
use super::play::{Judgement, Trial};
use super::question::{Better, Criterion};
use crate::statistics::{Interval, bootstrap_times, sign_test};

/// Bootstrap samples of strengths: each is an iteration of its own.
const RESAMPLES: usize = 1000;

/// Which set won.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The pair's first.
    First,
    /// The pair's second.
    Second,
    /// Neither, or both orders disagree.
    Tie,
}

/// What became of one criterion of a pair in one round.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ruling {
    /// Which scene.
    pub scene: String,
    /// Which sets.
    pub pair: Pair,
    /// Which round.
    pub round: usize,
    /// Who won; `None` when an order has no answer.
    pub outcome: Option<Outcome>,
    /// Whether both orders said the same.
    pub agree: bool,
}

/// A set's strength.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Strength {
    /// Log strength, mean 0 over the sets: a difference of 1.1 is winning three times of four.
    pub log: f64,
    /// Bootstrap interval over scenes.
    pub interval: Option<Interval>,
    /// Pairs won, ties as halves.
    pub won: f64,
    /// Pairs ruled.
    pub of: usize,
}

/// Scores of one criterion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CriterionScore {
    /// Which.
    pub criterion: Criterion,
    /// By set.
    pub strengths: Vec<Strength>,
    /// Wins of the first, of the second, ties, and the sign test's p over scenes, pair by pair.
    pub pairs: Vec<PairScore>,
    /// Pairs without an answer in both orders.
    pub missing: usize,
    /// Share of the ruled pairs where both orders said the same; `None` without any.
    pub consistent: Option<f64>,
}

/// Two sets on one criterion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairScore {
    /// Which sets.
    pub pair: Pair,
    /// Won by the first.
    pub first: usize,
    /// Won by the second.
    pub second: usize,
    /// Ties.
    pub ties: usize,
    /// Sign test over scenes: the rounds of a scene are one vote.
    pub p: f64,
}

/// The verdict in terms of sets instead of letters.
fn outcome(better: Better, swapped: bool) -> Outcome {
    match (better, swapped) {
        (Better::Same, _) => Outcome::Tie,
        (Better::A, false) | (Better::B, true) => Outcome::First,
        (Better::B, false) | (Better::A, true) => Outcome::Second,
    }
}

/// The rulings on one criterion, by scene, pair and round.
pub(super) fn rulings(trials: &[Trial], criterion: Criterion) -> Vec<Ruling> {
    let mut by: BTreeMap<(&str, Pair, usize), Vec<Option<Outcome>>> = BTreeMap::new();
    for t in trials {
        let said = t.verdicts.as_ref().and_then(|v| v.get(&criterion)).map(|better| outcome(*better, t.swapped));
        by.entry((&t.scene, t.pair, t.round)).or_default().push(said);
    }
    by.into_iter()
        .map(|((scene, pair, round), said)| {
            let (outcome, agree) = match said[..] {
                [Some(a), Some(b)] if a == b => (Some(a), true),
                [Some(_), Some(_)] => (Some(Outcome::Tie), false),
                _ => (None, false),
            };
            Ruling { scene: scene.to_owned(), pair, round, outcome, agree }
        })
        .collect()
}

/// Wins by pair of sets, ties as halves.
fn wins<'a>(rulings: impl Iterator<Item = &'a Ruling>, sets: usize) -> Vec<Vec<f64>> {
    let mut wins = vec![vec![0.0; sets]; sets];
    for r in rulings {
        let Pair { first, second } = r.pair;
        let share = match r.outcome {
            Some(Outcome::First) => 1.0,
            Some(Outcome::Second) => 0.0,
            Some(Outcome::Tie) => 0.5,
            None => continue,
        };
        wins[first][second] += share;
        wins[second][first] += 1.0 - share;
    }
    wins
}

/// Scores of all criteria.
pub fn tally(trials: &[Trial], sets: usize, seed: u64) -> Vec<CriterionScore> {
    Criterion::ALL.into_iter().map(|criterion| score(trials, sets, seed, criterion)).collect()
}

fn score(trials: &[Trial], sets: usize, seed: u64, criterion: Criterion) -> CriterionScore {
    let rulings = rulings(trials, criterion);
    let all = wins(rulings.iter(), sets);
    let log = strengths(&all, PRIOR);
    let scenes: Vec<&str> = rulings.iter().map(|r| r.scene.as_str()).collect::<BTreeSet<_>>().into_iter().collect();
    let by_scene: Vec<Vec<Vec<f64>>> =
        scenes.iter().map(|s| wins(rulings.iter().filter(|r| r.scene == *s), sets)).collect();
    let strength = |set: usize| {
        let interval = bootstrap_times(scenes.len(), RESAMPLES, seed, |drawn| {
            let mut sum = vec![vec![0.0; sets]; sets];
            for scene in drawn {
                for (row, more) in sum.iter_mut().zip(&by_scene[*scene]) {
                    row.iter_mut().zip(more).for_each(|(a, b)| *a += b);
                }
            }
            strengths(&sum, PRIOR)[set]
        });
        let ruled = rulings.iter().filter(|r| r.outcome.is_some() && (r.pair.first == set || r.pair.second == set));
        Strength { log: log[set], interval, won: all[set].iter().sum(), of: ruled.count() }
    };
    let ruled = rulings.iter().filter(|r| r.outcome.is_some()).count();
    CriterionScore {
        criterion,
        strengths: (0..sets).map(strength).collect(),
        pairs: pair_scores(&rulings),
        missing: rulings.len() - ruled,
        consistent: (ruled > 0).then(|| rulings.iter().filter(|r| r.agree).count() as f64 / ruled as f64),
    }
}

fn pair_scores(rulings: &[Ruling]) -> Vec<PairScore> {
    let pairs: BTreeSet<Pair> = rulings.iter().map(|r| r.pair).collect();
    pairs
        .into_iter()
        .map(|pair| {
            let of = |outcome| rulings.iter().filter(move |r| r.pair == pair && r.outcome == Some(outcome));
            let votes = votes(rulings.iter().filter(|r| r.pair == pair));
            let lead = |sign: i64| votes.values().filter(|v| v.signum() == sign).count();
            PairScore {
                pair,
                first: of(Outcome::First).count(),
                second: of(Outcome::Second).count(),
                ties: of(Outcome::Tie).count(),
                p: sign_test(lead(1), lead(-1)),
            }
        })
        .collect()
}

/// By scene, how many rounds more the first won than the second.
pub(super) fn votes<'a>(rulings: impl Iterator<Item = &'a Ruling>) -> BTreeMap<String, i64> {
    let mut votes = BTreeMap::new();
    for r in rulings {
        let step = match r.outcome {
            Some(Outcome::First) => 1,
            Some(Outcome::Second) => -1,
            Some(Outcome::Tie) => 0,
            None => continue,
        };
        *votes.entry(r.scene.clone()).or_insert(0) += step;
    }
    votes
}

/// The scores for a terminal.
pub fn text(j: &Judgement) -> String {
    let mut out = format!("judged by {}, {} renders, {} questions\n", j.judge, j.look.name(), j.trials.len());
    let width = j.sets.iter().map(|s| s.chars().count()).max().unwrap_or(0).max(3);
    let _ = writeln!(out, "{:<16} {:<width$} {:>9} {:>9} {:>17}", "criterion", "set", "won", "strength", "95 %");
    for score in &j.scores {
        for (i, (set, s)) in j.sets.iter().zip(&score.strengths).enumerate() {
            let title = if i == 0 { score.criterion.title() } else { "" };
            let won = format!("{:.1}/{}", s.won, s.of);
            let sure = s.interval.map_or_else(|| "-".to_owned(), |i| format!("{:+.2}..{:+.2}", i.low, i.high));
            let _ = writeln!(out, "{title:<16} {set:<width$} {won:>9} {:>+9.2} {sure:>17}", s.log);
        }
        for p in &score.pairs {
            let names = format!("{} : {}", j.sets[p.pair.first], j.sets[p.pair.second]);
            let _ = writeln!(
                out,
                "{:<16} {names}: {} : {}, {} ties, sign test p={:.3}",
                "", p.first, p.second, p.ties, p.p
            );
        }
        let same = score.consistent.map_or_else(|| "-".to_owned(), |c| format!("{:.0} %", 100.0 * c));
        let _ =
            writeln!(out, "{:<16} both orders agree in {same} of the pairs, {} without an answer", "", score.missing);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(scene: usize, swapped: bool, better: Option<Better>) -> Trial {
        let verdicts = better.map(|b| Criterion::ALL.into_iter().map(|c| (c, b)).collect());
        Trial {
            scene: format!("scene_{scene:02}"),
            pair: Pair { first: 0, second: 1 },
            round: 1,
            swapped,
            call: String::new(),
            verdicts,
            observations: String::new(),
            error: None,
        }
    }

    fn overall(trials: &[Trial]) -> CriterionScore {
        tally(trials, 2, 3).pop().unwrap()
    }

    #[test]
    fn a_judge_who_always_says_a_decides_nothing() {
        let trials: Vec<Trial> =
            (0..20).flat_map(|s| [false, true].map(|swapped| trial(s, swapped, Some(Better::A)))).collect();
        let score = overall(&trials);
        assert_eq!((score.pairs[0].first, score.pairs[0].second, score.pairs[0].ties), (0, 0, 20));
        assert_eq!((score.consistent, score.pairs[0].p), (Some(0.0), 1.0));
        assert!(score.strengths.iter().all(|s| s.log.abs() < 1e-9));
    }

    #[test]
    fn wins_are_those_of_sets_and_not_of_letters() {
        // Scene 0 to 14: the first set; 15 to 19: the second; whatever the letters are.
        let said = |s: usize, swapped: bool| if (s < 15) == swapped { Better::B } else { Better::A };
        let trials: Vec<Trial> =
            (0..20).flat_map(|s| [true, false].map(|swapped| trial(s, swapped, Some(said(s, swapped))))).collect();
        let score = overall(&trials);
        assert_eq!((score.pairs[0].first, score.pairs[0].second, score.consistent), (15, 5, Some(1.0)));
        let lead = score.strengths[0].log - score.strengths[1].log;
        assert!((lead - (15.5_f64 / 5.5).ln()).abs() < 1e-6, "{lead}");
        assert!((score.pairs[0].p - sign_test(15, 5)).abs() < 1e-12);
        let i = score.strengths[0].interval.unwrap();
        assert!(i.low < score.strengths[0].log && score.strengths[0].log < i.high);
    }

    #[test]
    fn a_missing_answer_is_missing_and_no_tie() {
        let trials = [
            trial(0, false, Some(Better::A)),
            trial(0, true, None),
            trial(1, false, Some(Better::A)),
            trial(1, true, Some(Better::B)),
        ];
        let score = overall(&trials);
        assert_eq!((score.missing, score.pairs[0].first, score.pairs[0].ties), (1, 1, 0));
    }
}
