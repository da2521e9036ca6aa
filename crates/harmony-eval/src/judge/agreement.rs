//! How far two judges agree.
//!
//! Cohen's kappa (J. Cohen, "A Coefficient of Agreement for Nominal Scales", 1960) over scenes and pairs, with the three
//! categories first, second, tie: 1 is full agreement, 0 what chance gives with how often each judge says what.

use std::collections::BTreeMap;

use serde::Serialize;

use super::play::Judgement;
use super::question::Criterion;
use super::tally::{rulings, votes};

/// Two judges on one criterion.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// Which.
    pub criterion: Criterion,
    /// Scenes of pairs that both ruled.
    pub n: usize,
    /// Share where both said the same; `None` without any.
    pub same: Option<f64>,
    /// Cohen's kappa; `None` without any, or when both always say one and the same thing.
    pub kappa: Option<f64>,
}

/// Holds two judges of the same sets against each other: scenes and pairs are matched by names.
pub fn agreement(a: &Judgement, b: &Judgement) -> Vec<Agreement> {
    Criterion::ALL.into_iter().map(|c| one(&said(a, c), &said(b, c), c)).collect()
}

/// -1, 0 or 1 by scene and names of the pair.
fn said(j: &Judgement, criterion: Criterion) -> BTreeMap<(String, String, String), i64> {
    let all = rulings(&j.trials, criterion);
    let mut out = BTreeMap::new();
    for first in 0..j.sets.len() {
        for second in first + 1..j.sets.len() {
            let of_pair = all.iter().filter(|r| r.pair.first == first && r.pair.second == second);
            for (scene, lead) in votes(of_pair) {
                // The same two sets may have been named the other way round.
                let (a, b) = (&j.sets[first], &j.sets[second]);
                let (a, b, lead) = if a <= b { (a, b, lead) } else { (b, a, -lead) };
                out.insert((scene, a.clone(), b.clone()), lead.signum());
            }
        }
    }
    out
}

fn one(
    a: &BTreeMap<(String, String, String), i64>,
    b: &BTreeMap<(String, String, String), i64>,
    criterion: Criterion,
) -> Agreement {
    let both: Vec<(i64, i64)> = a.iter().filter_map(|(k, x)| Some((*x, *b.get(k)?))).collect();
    let n = both.len() as f64;
    if both.is_empty() {
        return Agreement { criterion, n: 0, same: None, kappa: None };
    }
    let same = both.iter().filter(|(x, y)| x == y).count() as f64 / n;
    let chance: f64 = [-1, 0, 1]
        .iter()
        .map(|k| both.iter().filter(|p| p.0 == *k).count() as f64 * both.iter().filter(|p| p.1 == *k).count() as f64)
        .sum::<f64>()
        / (n * n);
    let kappa = (chance < 1.0 - 1e-12).then(|| (same - chance) / (1.0 - chance));
    Agreement { criterion, n: both.len(), same: Some(same), kappa }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(values: &[i64]) -> BTreeMap<(String, String, String), i64> {
        values.iter().enumerate().map(|(i, v)| ((i.to_string(), "a".to_owned(), "b".to_owned()), *v)).collect()
    }

    #[test]
    fn kappa_is_that_of_the_textbook() {
        // Cohen's own example has two categories: 20 yes-yes, 5, 10, 15 no-no: kappa 0.4.
        let mut pairs = vec![(1, 1); 20];
        pairs.extend(vec![(1, -1); 5]);
        pairs.extend(vec![(-1, 1); 10]);
        pairs.extend(vec![(-1, -1); 15]);
        let (a, b): (Vec<i64>, Vec<i64>) = pairs.into_iter().unzip();
        let found = one(&said(&a), &said(&b), Criterion::Overall);
        assert_eq!((found.n, found.same), (50, Some(0.7)));
        assert!((found.kappa.unwrap() - 0.4).abs() < 1e-12);
        let none = one(&said(&[1, 1]), &said(&[1, 1]), Criterion::Overall);
        assert_eq!((none.same, none.kappa), (Some(1.0), None), "nothing to tell chance from");
        assert_eq!(one(&said(&[]), &said(&[1]), Criterion::Overall).n, 0);
    }
}
