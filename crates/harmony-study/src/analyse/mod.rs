//! What a study found: the paper's table, with intervals and tests.
//! Key `study.table`.
//!
//! Rankings of one person are not independent, nor are those of one scene. Intervals therefore draw people *and*
//! scenes with replacement (a two-way bootstrap), and tests take people, or scenes, as blocks, never single rankings.

pub mod decode;
pub mod plackett_luce;
mod report;
pub mod stats;

use std::collections::{BTreeMap, BTreeSet};

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;

use crate::StudyError;
use crate::log::Entry;
use crate::private::PrivateStudy;
use decode::{Decoded, Participant, Ranking, decode};
use plackett_luce::Order;
use stats::{Friedman, chi2_above, friedman, nemenyi_critical, nemenyi_p, sign_test};

/// How to analyse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AnalyseOptions {
    /// Draws of the bootstrap.
    pub draws: usize,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// People who did not hand in count, too.
    pub partial: bool,
}

impl Default for AnalyseOptions {
    fn default() -> Self {
        Self { draws: 2000, seed: 2026, partial: false }
    }
}

/// A value with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// 2.5 % of the draws are below.
    pub low: f64,
    /// 2.5 % of the draws are above.
    pub high: f64,
}

/// A row of the paper's table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodRow {
    /// Name.
    pub method: String,
    /// Mean rank over all rankings.
    pub mean_rank: Estimate,
    /// Standard deviation of the ranks.
    pub sd: f64,
    /// Share ranked first, percent.
    pub top1: Estimate,
    /// Share ranked first or second, percent.
    pub top2: Estimate,
    /// Plackett-Luce log strength above the reference; the reference itself has 0.
    pub log_strength: Estimate,
}

/// The reference against another method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Versus {
    /// The other method.
    pub method: String,
    /// Share of rankings that put the reference above it, percent.
    pub wins: Estimate,
    /// People whose mean rank of the reference is better, worse.
    pub people: [usize; 2],
    /// Two-sided sign test over people.
    pub sign_p: f64,
}

/// Two methods' difference by Nemenyi's test.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pair {
    /// One method.
    pub a: String,
    /// The other.
    pub b: String,
    /// Mean rank of `b` above that of `a`.
    pub difference: f64,
    /// Nemenyi's p-value.
    pub p: f64,
}

/// Friedman's test with what follows from it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BlockTest {
    /// `people` or `scenes`.
    pub blocks: &'static str,
    /// The test.
    pub friedman: Friedman,
    /// Difference of mean ranks from which two methods differ at 5 %.
    pub critical_difference: f64,
    /// All pairs.
    pub pairs: Vec<Pair>,
}

/// Agreement of people within scenes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// Kendall's W over people, by scene.
    pub by_scene: BTreeMap<String, f64>,
    /// Median, least and largest.
    pub median: f64,
    /// Least.
    pub low: f64,
    /// Largest.
    pub high: f64,
}

/// Results of one choice of people.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Results {
    /// People.
    pub people: usize,
    /// Scenes.
    pub scenes: usize,
    /// Rankings; people times scenes when nobody left one out.
    pub rankings: usize,
    /// The paper's table.
    pub table: Vec<MethodRow>,
    /// The reference against each other method.
    pub versus: Vec<Versus>,
    /// Share of rankings that put the row's method above the column's, percent.
    pub wins: Vec<Vec<f64>>,
    /// Friedman's and Nemenyi's tests with people and with scenes as blocks, where there are enough.
    pub tests: Vec<BlockTest>,
    /// Agreement of people.
    pub agreement: Option<Agreement>,
    /// Largest difference between pairwise wins as seen and as Plackett and Luce's strengths have them, percent.
    pub model_misfit: f64,
    /// Whether ranks depend on letters: chi-square, degrees of freedom, p.
    pub letters: Option<[f64; 3]>,
    /// Median time a ranking, seconds.
    pub median_seconds: f64,
}

/// The whole analysis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Analysis {
    /// The study's name.
    pub study: String,
    /// Version of its site.
    pub version: String,
    /// Methods in the study's order.
    pub methods: Vec<String>,
    /// The method that the others are compared with.
    pub reference: String,
    /// Answers in the log, changes of earlier ones among them.
    pub answers: usize,
    /// Answers that do not decode: 0 unless the log was made elsewhere.
    pub undecodable: usize,
    /// Answers from files that nobody signed.
    pub unsigned: usize,
    /// Results of those who count by the rule that was fixed when the study was built.
    pub counted: Results,
    /// Results of everybody, where somebody was left out.
    pub everybody: Option<Results>,
    /// People.
    pub participants: Vec<Participant>,
    /// Mean of Kendall's tau of repeated scenes: how much people agree with themselves.
    pub self_agreement: Option<f64>,
    /// Rankings of those who count.
    #[serde(skip)]
    pub rankings: Vec<Ranking>,
    /// How the bootstrap was drawn: draws and seed.
    pub bootstrap: (usize, u64),
    /// What the build noted: panels of another shape, scenes left out.
    pub notes: Vec<String>,
}

/// Analyses a log.
///
/// # Errors
/// [`StudyError::NoAnswers`].
pub fn analyse(entries: &[Entry], study: &PrivateStudy, options: &AnalyseOptions) -> Result<Analysis, StudyError> {
    let decoded = decode(entries, study, options.partial);
    let counted = decoded.counted();
    if counted.is_empty() {
        let why = match (decoded.answers, decoded.rankings.len()) {
            (0, _) => "nobody has answered yet",
            (_, 0) => "none of them decodes",
            _ => "everybody is left out: see --partial, or the exclusion rule of the study",
        };
        return Err(StudyError::NoAnswers { answers: decoded.answers, why });
    }
    let reference = study.methods.iter().position(|m| *m == study.reference).unwrap_or(0);
    let all: Vec<&Ranking> = decoded.rankings.iter().collect();
    let everybody = (all.len() > counted.len()).then(|| results(&all, &study.methods, reference, options));
    let taus: Vec<f64> =
        decoded.participants.iter().filter(|p| p.left_out.is_empty()).flat_map(|p| p.repeats.clone()).collect();
    Ok(Analysis {
        study: study.study.clone(),
        version: study.version.clone(),
        methods: study.methods.clone(),
        reference: study.methods[reference].clone(),
        answers: decoded.answers,
        undecodable: decoded.undecodable,
        unsigned: decoded.unsigned,
        counted: results(&counted, &study.methods, reference, options),
        everybody,
        self_agreement: (!taus.is_empty()).then(|| taus.iter().sum::<f64>() / taus.len() as f64),
        rankings: counted.into_iter().cloned().collect(),
        participants: decoded.participants,
        bootstrap: (options.draws, options.seed),
        notes: study.notes.iter().chain(&study.left_out).cloned().collect(),
    })
}

/// Sums over weighted rankings.
struct Sums {
    weight: f64,
    rank: Vec<f64>,
    square: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
    above: Vec<f64>,
}

impl Sums {
    fn of(rankings: &[&Ranking], weights: &[f64], k: usize) -> Self {
        let mut sums = Self {
            weight: 0.0,
            rank: vec![0.0; k],
            square: vec![0.0; k],
            first: vec![0.0; k],
            second: vec![0.0; k],
            above: vec![0.0; k * k],
        };
        for (ranking, w) in rankings.iter().zip(weights).filter(|(_, w)| **w > 0.0) {
            sums.weight += w;
            for (i, rank) in ranking.ranks.iter().enumerate() {
                let r = f64::from(*rank);
                sums.rank[i] += w * r;
                sums.square[i] += w * r * r;
                sums.first[i] += w * f64::from(u8::from(*rank == 1));
                sums.second[i] += w * f64::from(u8::from(*rank <= 2));
                for (j, other) in ranking.ranks.iter().enumerate() {
                    sums.above[i * k + j] += w * f64::from(u8::from(rank < other));
                }
            }
        }
        sums
    }

    fn sd(&self, i: usize) -> f64 {
        let mean = self.rank[i] / self.weight;
        let n = self.weight;
        if n > 1.0 { ((self.square[i] - n * mean * mean) / (n - 1.0)).max(0.0).sqrt() } else { 0.0 }
    }
}

fn orders(rankings: &[&Ranking], weights: &[f64]) -> Vec<Order> {
    rankings
        .iter()
        .zip(weights)
        .filter(|(_, w)| **w > 0.0)
        .map(|(ranking, w)| {
            let mut best_first: Vec<usize> = (0..ranking.ranks.len()).collect();
            best_first.sort_by_key(|i| ranking.ranks[*i]);
            Order { best_first, weight: *w }
        })
        .collect()
}

/// All results of some rankings.
fn results(rankings: &[&Ranking], methods: &[String], reference: usize, options: &AnalyseOptions) -> Results {
    let k = methods.len();
    let people: Vec<&str> = distinct(rankings.iter().map(|r| r.participant.as_str()));
    let scenes: Vec<&str> = distinct(rankings.iter().map(|r| r.scene.as_str()));
    let ones = vec![1.0; rankings.len()];
    let sums = Sums::of(rankings, &ones, k);
    let strengths = plackett_luce::fit(&orders(rankings, &ones), k, None);
    let draws = bootstrap(rankings, &people, &scenes, k, &strengths, options);
    let estimate = |value: f64, of: &dyn Fn(&Draw) -> f64| {
        let mut values: Vec<f64> = draws.iter().map(of).filter(|v| v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        Estimate { value, low: quantile(&values, 0.025), high: quantile(&values, 0.975) }
    };
    let n = sums.weight;
    let table = methods
        .iter()
        .enumerate()
        .map(|(i, method)| MethodRow {
            method: method.clone(),
            mean_rank: estimate(sums.rank[i] / n, &|d| d.sums.rank[i] / d.sums.weight),
            sd: sums.sd(i),
            top1: estimate(100.0 * sums.first[i] / n, &|d| 100.0 * d.sums.first[i] / d.sums.weight),
            top2: estimate(100.0 * sums.second[i] / n, &|d| 100.0 * d.sums.second[i] / d.sums.weight),
            log_strength: estimate(strengths[i] - strengths[reference], &|d| d.strengths[i] - d.strengths[reference]),
        })
        .collect();
    let by_person = means(rankings, &people, k, |r| &r.participant);
    let versus = (0..k)
        .filter(|j| *j != reference)
        .map(|j| {
            let better = by_person.iter().filter(|m| m[reference] < m[j]).count();
            let worse = by_person.iter().filter(|m| m[reference] > m[j]).count();
            let cell = reference * k + j;
            Versus {
                method: methods[j].clone(),
                wins: estimate(100.0 * sums.above[cell] / n, &|d| 100.0 * d.sums.above[cell] / d.sums.weight),
                people: [better, worse],
                sign_p: sign_test(better, worse),
            }
        })
        .collect();
    let wins: Vec<Vec<f64>> = (0..k).map(|i| (0..k).map(|j| 100.0 * sums.above[i * k + j] / n).collect()).collect();
    let by_scene = means(rankings, &scenes, k, |r| &r.scene);
    let tests = [("people", &by_person), ("scenes", &by_scene)]
        .into_iter()
        .filter_map(|(blocks, rows)| block_test(blocks, rows, methods))
        .collect();
    let mut times: Vec<f64> = rankings.iter().map(|r| r.active_ms as f64 / 1000.0).collect();
    times.sort_by(f64::total_cmp);
    Results {
        people: people.len(),
        scenes: scenes.len(),
        rankings: rankings.len(),
        table,
        versus,
        model_misfit: misfit(&wins, &strengths),
        wins,
        tests,
        agreement: agreement(rankings, &scenes),
        letters: letters(rankings, k),
        median_seconds: quantile(&times, 0.5),
    }
}

fn distinct<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    names.collect::<BTreeSet<_>>().into_iter().collect()
}

/// Mean ranks of each method, by person or by scene.
fn means<'a>(
    rankings: &[&'a Ranking],
    names: &[&str],
    k: usize,
    name: impl Fn(&'a Ranking) -> &'a String,
) -> Vec<Vec<f64>> {
    let mut rows = vec![(0.0, vec![0.0; k]); names.len()];
    for ranking in rankings {
        if let Ok(at) = names.binary_search(&name(ranking).as_str()) {
            rows[at].0 += 1.0;
            rows[at].1.iter_mut().zip(&ranking.ranks).for_each(|(sum, r)| *sum += f64::from(*r));
        }
    }
    rows.into_iter().map(|(n, sums)| sums.into_iter().map(|s| s / n).collect()).collect()
}

fn block_test(blocks: &'static str, rows: &[Vec<f64>], methods: &[String]) -> Option<BlockTest> {
    let test = friedman(rows)?;
    let k = methods.len();
    let mut pairs = Vec::new();
    for i in 0..k {
        for j in i + 1..k {
            let difference = test.mean_ranks[j] - test.mean_ranks[i];
            let p = nemenyi_p(difference, k, test.blocks);
            pairs.push(Pair { a: methods[i].clone(), b: methods[j].clone(), difference, p });
        }
    }
    Some(BlockTest { blocks, critical_difference: nemenyi_critical(k, test.blocks, 0.05), friedman: test, pairs })
}

fn agreement(rankings: &[&Ranking], scenes: &[&str]) -> Option<Agreement> {
    let by_scene: BTreeMap<String, f64> = scenes
        .iter()
        .filter_map(|scene| {
            let rows: Vec<Vec<f64>> = rankings
                .iter()
                .filter(|r| r.scene == *scene)
                .map(|r| r.ranks.iter().map(|x| f64::from(*x)).collect())
                .collect();
            Some(((*scene).to_owned(), friedman(&rows)?.w))
        })
        .collect();
    let mut values: Vec<f64> = by_scene.values().copied().collect();
    values.sort_by(f64::total_cmp);
    let (low, high) = (*values.first()?, *values.last()?);
    Some(Agreement { by_scene, median: quantile(&values, 0.5), low, high })
}

/// Chi-square of letters against ranks: no effect of the place on the page is the wish.
fn letters(rankings: &[&Ranking], k: usize) -> Option<[f64; 3]> {
    let mut counts = vec![0.0; k * k];
    for ranking in rankings {
        for (letter, rank) in ranking.letters.iter().zip(&ranking.ranks) {
            counts[letter * k + usize::from(*rank) - 1] += 1.0;
        }
    }
    let expected = rankings.len() as f64 / k as f64;
    if expected < 5.0 {
        return None;
    }
    let chi2: f64 = counts.iter().map(|c| (c - expected).powi(2) / expected).sum();
    // Rows and columns are both permutations: the statistic is chi-square after this factor, with (k - 1)^2 degrees.
    let chi2 = chi2 * (k as f64 - 1.0) / k as f64;
    let degrees = (k as f64 - 1.0).powi(2);
    Some([chi2, degrees, chi2_above(chi2, degrees)])
}

fn misfit(wins: &[Vec<f64>], strengths: &[f64]) -> f64 {
    let mut worst = 0.0_f64;
    for (i, row) in wins.iter().enumerate() {
        for (j, seen) in row.iter().enumerate().filter(|(j, _)| *j != i) {
            let predicted = 100.0 / (1.0 + (strengths[j] - strengths[i]).exp());
            worst = worst.max((predicted - seen).abs());
        }
    }
    worst
}

struct Draw {
    sums: Sums,
    strengths: Vec<f64>,
}

/// People and scenes drawn with replacement; a ranking counts as often as its person times its scene were drawn.
fn bootstrap(
    rankings: &[&Ranking],
    people: &[&str],
    scenes: &[&str],
    k: usize,
    start: &[f64],
    options: &AnalyseOptions,
) -> Vec<Draw> {
    let place = |names: &[&str], name: &str| names.binary_search(&name).unwrap_or(0);
    let places: Vec<(usize, usize)> =
        rankings.iter().map(|r| (place(people, &r.participant), place(scenes, &r.scene))).collect();
    (0..options.draws)
        .into_par_iter()
        .filter_map(|draw| {
            let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
            rng.set_stream(draw as u64);
            let mut drawn = |n: usize| {
                let mut counts = vec![0.0; n];
                (0..n).for_each(|_| counts[rng.random_range(0..n)] += 1.0);
                counts
            };
            let (of_people, of_scenes) = (drawn(people.len()), drawn(scenes.len()));
            let weights: Vec<f64> = places.iter().map(|(p, s)| of_people[*p] * of_scenes[*s]).collect();
            let sums = Sums::of(rankings, &weights, k);
            // With gaps in the data a draw can be empty.
            (sums.weight > 0.0)
                .then(|| Draw { strengths: plackett_luce::fit(&orders(rankings, &weights), k, Some(start)), sums })
        })
        .collect()
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    if sorted.is_empty() {
        return f64::NAN;
    }
    let at = share * (sorted.len() - 1) as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    sorted[low] + (sorted[high] - sorted[low]) * (at - at.floor())
}

/// All that can be written about an analysis.
impl Analysis {
    /// For a terminal.
    pub fn text(&self) -> String {
        report::text(self)
    }

    /// The table, one row a method.
    pub fn csv(&self) -> String {
        report::csv(self)
    }

    /// Every ranking that counts, one row each.
    pub fn rankings_csv(&self) -> String {
        report::rankings_csv(self)
    }

    /// A page.
    pub fn html(&self) -> String {
        report::html(self)
    }
}

/// Decoded answers, for those who want to do their own statistics.
pub fn decoded(entries: &[Entry], study: &PrivateStudy, partial: bool) -> Decoded {
    decode(entries, study, partial)
}
