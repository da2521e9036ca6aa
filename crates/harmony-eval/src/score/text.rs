//! Tables for the terminal.

use std::fmt::Write;

use super::table::{Column, Evaluation};
use crate::statistics::{Interval, Mean};

/// `0.0921` in four digits; `-` for nothing.
fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"))
}

fn interval(interval: Option<Interval>) -> String {
    interval.map_or_else(|| "-".to_owned(), |i| format!("{:.4}..{:.4}", i.low, i.high))
}

/// The three means of every column.
pub fn table(e: &Evaluation) -> String {
    let titles: Vec<String> = e.columns.iter().map(|c| e.title(c.key)).collect();
    let width = titles.iter().map(|t| t.chars().count()).max().unwrap_or(0).max(6);
    let mut out = format!(
        "{:<width$} {:>5} {:>8} {:>8} {:>16} {:>5} {:>8} {:>5} {:>8}\n",
        "figure", "n", "own", "sd", "95 %", "n", "shared", "n", "worst"
    );
    for (title, Column { own, intersection, failures_as_worst, .. }) in titles.iter().zip(&e.columns) {
        let n = |m: &Option<Mean>| m.map_or(0, |m| m.n);
        let mean = |m: &Option<Mean>| number(m.map(|m| m.mean));
        let _ = writeln!(
            out,
            "{title:<width$} {:>5} {:>8} {:>8} {:>16} {:>5} {:>8} {:>5} {:>8}",
            n(own),
            mean(own),
            number(own.and_then(|m| m.sd)),
            interval(own.and_then(|m| m.interval)),
            n(intersection),
            mean(intersection),
            n(failures_as_worst),
            mean(failures_as_worst),
        );
    }
    if e.columns.is_empty() {
        out.push_str("no scene has both a photo and a render\n");
    }
    out
}

/// The first set against the others; empty when there are none.
pub fn comparisons(e: &Evaluation) -> String {
    if e.comparisons.is_empty() {
        return String::new();
    }
    let titles: Vec<String> = e
        .comparisons
        .iter()
        .map(|c| format!("{} {} - {}", c.look.name(), c.metric.title(), e.sets[c.against]))
        .collect();
    let width = titles.iter().map(|t| t.chars().count()).max().unwrap_or(0);
    let mut out = format!(
        "{:<width$} {:>5} {:>9} {:>18} {:>9} {:>6} {:>6} {:>5} {:>9}\n",
        format!("{} minus", e.sets[0]),
        "n",
        "mean",
        "95 %",
        "median",
        "better",
        "worse",
        "equal",
        "sign test"
    );
    for (title, c) in titles.iter().zip(&e.comparisons) {
        let p = &c.paired;
        let sure = p.difference.interval.map_or_else(|| "-".to_owned(), |i| format!("{:+.4}..{:+.4}", i.low, i.high));
        let _ = writeln!(
            out,
            "{title:<width$} {:>5} {:>+9.4} {sure:>18} {:>+9.4} {:>6} {:>6} {:>5} {:>9}",
            p.difference.n,
            p.difference.mean,
            p.median,
            p.lower,
            p.higher,
            p.equal,
            format!("p={:.3}", p.p)
        );
    }
    out
}
