//! People with known preferences: the analysis must find them.

use harmony_study::StudyError;
use harmony_study::analyse::{AnalyseOptions, analyse};
use harmony_study::log::{Entry, Via};
use harmony_study::simulate::{Crowd, simulate};

use crate::fixture::{METHODS, answer, study};

const STRENGTHS: [f64; 6] = [2.2, 0.6, 0.5, -0.3, -0.6, -0.9];

fn crowd(people: usize) -> Crowd {
    Crowd { people, strengths: STRENGTHS.to_vec(), scene_sd: 0.3, person_sd: 0.2, careless: 0, seed: 11 }
}

fn quick() -> AnalyseOptions {
    AnalyseOptions { draws: 300, ..AnalyseOptions::default() }
}

#[test]
fn the_preferences_of_a_crowd_are_found() {
    let study = study(6, 20, |_| {});
    let entries = simulate(study.secret(), &crowd(40));
    let analysis = analyse(&entries, study.secret(), &quick()).unwrap();
    let r = &analysis.counted;
    assert_eq!((r.people, r.scenes, r.rankings), (40, 20, 800));
    let mut ranks: Vec<usize> = (0..6).collect();
    ranks.sort_by(|a, b| r.table[*a].mean_rank.value.total_cmp(&r.table[*b].mean_rank.value));
    assert_eq!(ranks[0], 0);
    assert_eq!(ranks[3..], [3, 4, 5], "the order of the lower half");
    // Ranks from 1 to 6: their means add to 21, shares to 100 and 200.
    let sum = |f: &dyn Fn(usize) -> f64| (0..6).map(f).sum::<f64>();
    assert!((sum(&|i| r.table[i].mean_rank.value) - 21.0).abs() <= 1e-9);
    assert!((sum(&|i| r.table[i].top1.value) - 100.0).abs() <= 1e-9);
    assert!((sum(&|i| r.table[i].top2.value) - 200.0).abs() <= 1e-9);
    for (i, row) in r.table.iter().enumerate() {
        assert_eq!(row.method, METHODS[i]);
        let truth = STRENGTHS[i] - STRENGTHS[0];
        // Shifts of scenes and people flatten the marginal strengths a little.
        assert!((row.log_strength.value - truth).abs() <= 0.3, "{i}: {} {truth}", row.log_strength.value);
        assert!(
            row.log_strength.low - 0.15 <= truth && truth <= row.log_strength.high + 0.3,
            "{i}: {:?}",
            row.log_strength
        );
        assert!(row.mean_rank.low < row.mean_rank.value && row.mean_rank.value < row.mean_rank.high);
    }
    assert_eq!(r.tests.len(), 2);
    assert!(r.tests.iter().all(|t| t.friedman.p < 1e-6));
    let people = &r.tests[0];
    let p = |a: usize, b: usize| people.pairs.iter().find(|q| q.a == METHODS[a] && q.b == METHODS[b]).unwrap().p;
    assert!(p(0, 5) < 1e-6 && p(1, 2) > 0.05);
    assert!(r.versus.iter().all(|v| v.people == [40, 0] && v.sign_p < 1e-9));
    assert!(r.letters.unwrap()[2] > 0.01, "the place on the page has no effect: {:?}", r.letters);
    let w = r.agreement.as_ref().unwrap();
    assert!(w.by_scene.len() == 20 && w.low <= w.median && w.median <= w.high && w.median > 0.3);
    assert!(r.model_misfit < 8.0);
}

#[test]
fn nothing_is_found_where_nothing_is() {
    let study = study(6, 20, |_| {});
    let none = Crowd { strengths: vec![0.0; 6], scene_sd: 0.0, person_sd: 0.0, ..crowd(16) };
    // Of twenty worlds without preferences a test at 5 % finds one; four or more have a chance of 1.6 %.
    let found = (0..20)
        .filter(|seed| {
            let entries = simulate(study.secret(), &Crowd { seed: *seed, ..none.clone() });
            let options = AnalyseOptions { draws: 0, ..AnalyseOptions::default() };
            analyse(&entries, study.secret(), &options).unwrap().counted.tests[0].friedman.p < 0.05
        })
        .count();
    assert!(found <= 3, "{found} of 20");
}

#[test]
fn intervals_hold_the_truth_as_often_as_they_say() {
    // The truth of a mean rank: that of a very large crowd over very many scenes.
    let wide = study(3, 1, |_| {});
    let strengths = vec![0.8, 0.0, -0.8];
    let base = Crowd { people: 0, strengths, scene_sd: 0.5, person_sd: 0.5, careless: 0, seed: 0 };
    let mut sum = 0.0;
    for seed in 0..3000 {
        let entries = simulate(wide.secret(), &Crowd { people: 1, seed: 90_000 + seed, ..base.clone() });
        let options = AnalyseOptions { draws: 0, ..AnalyseOptions::default() };
        sum += analyse(&entries, wide.secret(), &options).unwrap().counted.table[0].mean_rank.value;
    }
    let truth = sum / 3000.0;
    let study = study(3, 15, |_| {});
    let worlds = 60;
    let held = (0..worlds)
        .filter(|seed| {
            let entries = simulate(study.secret(), &Crowd { people: 15, seed: *seed, ..base.clone() });
            let options = AnalyseOptions { draws: 200, ..AnalyseOptions::default() };
            let row = analyse(&entries, study.secret(), &options).unwrap().counted.table[0].mean_rank;
            row.low <= truth && truth <= row.high
        })
        .count();
    // 95 % of 60 is 57; below 51 has a chance of about one percent. The two-way bootstrap is known to be wide.
    assert!(held >= 51, "{held} of {worlds} intervals hold {truth:.3}");
}

#[test]
fn careless_people_are_left_out_by_the_rule_and_both_results_are_given() {
    let study = study(6, 8, |o| (o.checks, o.repeats) = (2, 2));
    let entries = simulate(study.secret(), &Crowd { careless: 3, ..crowd(12) });
    let analysis = analyse(&entries, study.secret(), &quick()).unwrap();
    let out: Vec<_> = analysis.participants.iter().filter(|p| !p.left_out.is_empty()).collect();
    assert_eq!(out.len(), 3, "{out:?}");
    assert!(out.iter().all(|p| p.left_out.join(" ").contains("1.5 s")));
    assert_eq!(analysis.counted.people, 9);
    assert_eq!(analysis.everybody.as_ref().unwrap().people, 12);
    assert_eq!(analysis.counted.scenes, 8, "repeats and checks are no scenes");
    assert!(analysis.participants.iter().filter(|p| p.left_out.is_empty()).all(|p| p.checks_passed == 2));
    assert!(analysis.self_agreement.unwrap() > 0.2);
    let text = analysis.text();
    assert!(text.contains("9 people, 8 scenes, 72 rankings (complete)") && text.contains("left out"), "{text}");
    let csv = analysis.csv();
    assert_eq!(csv.lines().count(), 1 + 6 + 6);
    let columns = csv.lines().map(|l| l.split(',').count()).collect::<std::collections::BTreeSet<_>>();
    assert_eq!(columns.len(), 1);
    assert_eq!(analysis.rankings_csv().lines().count(), 1 + 72);
    assert!(analysis.html().contains("<svg") && analysis.html().contains(METHODS[5]));
    // The same seed, the same words.
    assert_eq!(text, analyse(&entries, study.secret(), &quick()).unwrap().text());
}

#[test]
fn ranks_are_decoded_through_the_seed() {
    let study = study(3, 1, |_| {});
    let secret = study.secret();
    let mut entries = Vec::new();
    for code in ["anna-0001", "bert-0001", "cleo-0001", "dora-0001"] {
        // Each ranks by the method, whatever letter it has: the second method first, then the third.
        let mut a = answer(secret, code, 0, vec![0; 3]);
        for (rank, id) in a.ranks.iter_mut().zip(&a.order) {
            let method = &secret.trials[0].panels.iter().find(|p| p.id == *id).unwrap().method;
            *rank = [3, 1, 2][METHODS.iter().position(|m| m == method).unwrap()];
        }
        entries.push(Entry::Answer { answer: a, via: Via::Server });
        entries.push(Entry::Finish { participant: code.to_owned() });
    }
    // A later revision counts, whatever it says; an answer that does not decode does not.
    if let Entry::Answer { answer, .. } = entries[0].clone() {
        let mut changed = answer.clone();
        changed.revision = 2;
        changed.ranks.reverse();
        changed.ranks.rotate_left(1);
        entries.push(Entry::Answer { answer: changed, via: Via::Server });
        let mut broken = answer;
        broken.order.reverse();
        broken.revision = 3;
        entries.push(Entry::Answer { answer: broken, via: Via::Server });
    }
    let analysis = analyse(&entries, secret, &quick()).unwrap();
    assert_eq!((analysis.answers, analysis.undecodable), (6, 1));
    for ranking in analysis.rankings.iter().filter(|r| r.participant != "anna-0001") {
        assert_eq!(ranking.ranks, [3, 1, 2]);
    }
    assert_ne!(analysis.rankings.iter().find(|r| r.participant == "anna-0001").unwrap().ranks, [3, 1, 2]);
}

#[test]
fn a_log_without_usable_answers_says_why() {
    let study = study(3, 1, |_| {});
    let error = analyse(&[], study.secret(), &quick()).unwrap_err();
    assert!(matches!(error, StudyError::NoAnswers { answers: 0, .. }));
    let one = answer(study.secret(), "anna-0001", 0, vec![1, 2, 3]);
    let entries = [Entry::Answer { answer: one, via: Via::Server }];
    let error = analyse(&entries, study.secret(), &quick()).unwrap_err();
    assert!(error.to_string().contains("--partial"), "{error}");
    let partial = AnalyseOptions { partial: true, ..quick() };
    let analysis = analyse(&entries, study.secret(), &partial).unwrap();
    assert_eq!(analysis.counted.rankings, 1);
    assert!(analysis.counted.tests.is_empty() && analysis.counted.agreement.is_none());
    assert!(analysis.text().contains("too few rankings"));
}
