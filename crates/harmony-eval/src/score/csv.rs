//! Comma-separated tables.

use harmony_bench::report::csv::{line, number};

use super::table::{Evaluation, SceneRow};
use crate::statistics::Mean;

fn optional(value: Option<f64>) -> String {
    value.map_or_else(String::new, number)
}

/// `scenes.csv`: a line a scene, a column a figure; then an empty line, and the means of each column.
pub fn scenes(e: &Evaluation) -> String {
    let key = |c: &super::Column| format!("{}_{}_{}", e.sets[c.key.set], c.key.look.name(), c.key.metric.key());
    let mut out = line(["scene".to_owned()].into_iter().chain(e.columns.iter().map(key)).chain(["remarks".to_owned()]));
    for row in &e.scenes {
        let values = e.columns.iter().map(|c| optional(e.value(row, c.key)));
        out.push_str(&line([row.scene.clone()].into_iter().chain(values).chain([remarks(e, row)])));
    }
    out.push('\n');
    let mut footer = |name: &str, value: &dyn Fn(&super::Column) -> String| {
        out.push_str(&line([name.to_owned()].into_iter().chain(e.columns.iter().map(value)).chain([String::new()])));
    };
    let mean = |m: Option<Mean>| optional(m.map(|m| m.mean));
    let count = |m: Option<Mean>| m.map_or(0, |m| m.n).to_string();
    footer("AVERAGE", &|c| mean(c.own));
    footer("NUM_SCORED", &|c| count(c.own));
    footer("AVERAGE_INTERSECT", &|c| mean(c.intersection));
    footer("INTERSECT_NUM", &|c| count(c.intersection));
    footer("AVERAGE_FAILURES_AS_WORST", &|c| mean(c.failures_as_worst));
    footer("NUM_ALL", &|c| count(c.failures_as_worst));
    out
}

/// Why figures are missing.
fn remarks(e: &Evaluation, row: &SceneRow) -> String {
    let mut said: Vec<String> = Vec::new();
    if row.photo.is_none() {
        said.push("no photo".to_owned());
    }
    for (set, score) in e.sets.iter().zip(&row.sets) {
        said.extend(score.failure.iter().map(|f| format!("{set}: {f}")));
        said.extend(score.shots.values().flat_map(|s| &s.errors).map(|f| format!("{set}: {f}")));
    }
    said.join("; ")
}

/// `table.csv`: a line a column with its three means, then a line a comparison.
pub fn table(e: &Evaluation) -> String {
    let head = ["set", "render", "figure", "mean_over", "n", "mean", "sd", "low", "high"];
    let mut out = line(head.map(str::to_owned));
    for c in &e.columns {
        for (over, m) in [("own", c.own), ("intersection", c.intersection), ("failures_as_worst", c.failures_as_worst)]
        {
            out.push_str(&line([
                e.sets[c.key.set].clone(),
                c.key.look.name().to_owned(),
                c.key.metric.key().to_owned(),
                over.to_owned(),
                m.map_or(0, |m| m.n).to_string(),
                optional(m.map(|m| m.mean)),
                optional(m.and_then(|m| m.sd)),
                optional(m.and_then(|m| Some(m.interval?.low))),
                optional(m.and_then(|m| Some(m.interval?.high))),
            ]));
        }
    }
    if e.comparisons.is_empty() {
        return out;
    }
    let head =
        ["set", "against", "render", "figure", "n", "mean", "low", "high", "median", "lower", "higher", "equal", "p"];
    out.push('\n');
    out.push_str(&line(head.map(str::to_owned)));
    for c in &e.comparisons {
        let p = &c.paired;
        out.push_str(&line([
            e.sets[0].clone(),
            e.sets[c.against].clone(),
            c.look.name().to_owned(),
            c.metric.key().to_owned(),
            p.difference.n.to_string(),
            number(p.difference.mean),
            optional(p.difference.interval.map(|i| i.low)),
            optional(p.difference.interval.map(|i| i.high)),
            number(p.median),
            p.lower.to_string(),
            p.higher.to_string(),
            p.equal.to_string(),
            number(p.p),
        ]));
    }
    out
}
