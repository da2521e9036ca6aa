//! Tables of protocol scores.

use std::fmt::Write;

use super::{Numbers, PieceScore, Protocol, ProtocolScore};
use crate::metrics::two_way::mean;
use crate::report::csv::{line, number};

type Of = fn(&ProtocolScore) -> Option<&Numbers>;

fn f(numbers: Option<&Numbers>, i: usize) -> Option<f64> {
    numbers?.at.get(i).map(|at| at.f1)
}

fn average(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let all: Vec<f64> = values.flatten().collect();
    (!all.is_empty()).then(|| mean(&all))
}

/// Means by protocol for a terminal: score, then the floors.
pub fn text(scores: &[ProtocolScore], pieces: &[PieceScore]) -> String {
    let mut out = format!(
        "{:<12} {:<28} {:>4} {:>7} {:>9} {:>8} {:>8} {:>8}  unit of CD\n",
        "protocol", "", "n", "failed", "CD", "F@0.1", "F@0.01", "F@0.001"
    );
    let cell = |v: Option<f64>, digits: usize| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"));
    for protocol in Protocol::ALL {
        let own: Vec<&ProtocolScore> = scores.iter().filter(|s| s.protocol == protocol).collect();
        if own.is_empty() {
            continue;
        }
        let rows: [(&str, Of); 3] = [
            ("score", |s| s.score.as_ref()),
            ("truth against truth", |s| s.floor.as_ref()),
            ("truth in the run's frame", |s| s.floor_in_run_frame.as_ref()),
        ];
        for (i, (what, of)) in rows.into_iter().enumerate() {
            let n = own.iter().filter(|s| of(s).is_some()).count();
            if n == 0 && i > 0 {
                continue;
            }
            let failed = own.iter().filter(|s| s.failure.is_some()).count();
            let _ = writeln!(
                out,
                "{:<12} {what:<28} {n:>4} {:>7} {:>9} {:>8} {:>8} {:>8}  {}",
                if i == 0 { protocol.name() } else { "" },
                if i == 0 { failed.to_string() } else { String::new() },
                cell(average(own.iter().map(|s| Some(of(s)?.chamfer))), 4),
                cell(average(own.iter().map(|s| f(of(s), 0))), 2),
                cell(average(own.iter().map(|s| f(of(s), 1))), 2),
                cell(average(own.iter().map(|s| f(of(s), 2))), 3),
                if i == 0 { protocol.unit() } else { "" },
            );
        }
    }
    if !pieces.is_empty() {
        let n = pieces.len();
        let share =
            |test: &dyn Fn(&PieceScore) -> bool| 100.0 * pieces.iter().filter(|p| test(p)).count() as f64 / n as f64;
        let mut turns: Vec<f64> = pieces.iter().filter_map(|p| p.rotation_deg).collect();
        turns.sort_by(f64::total_cmp);
        let _ = writeln!(
            out,
            "objects: {n}, found {:.1} %, ADD-S within 0.1 of the diameter {:.1} %, 3D IoU {:.3} (missed ones 0), rotation by ICP \
             {} deg (median)",
            share(&|p| p.found.is_some()),
            share(&PieceScore::within_tenth),
            pieces.iter().map(|p| p.iou).sum::<f64>() / n as f64,
            cell(turns.get(turns.len() / 2).copied(), 1),
        );
    }
    out
}

/// A line a run and protocol.
pub fn csv(scores: &[ProtocolScore]) -> String {
    let mut head = vec!["truth", "run", "protocol", "unit", "points", "truth_points"]
        .into_iter()
        .map(str::to_owned)
        .collect::<Vec<_>>();
    for what in ["score", "floor", "floor_in_run_frame"] {
        head.push(format!("{what}_cd"));
        for t in ["0.1", "0.01", "0.001"] {
            head.extend(["precision", "recall", "f"].map(|k| format!("{what}_{k}_{t}")));
        }
    }
    head.push("failure".to_owned());
    let mut out = line(head);
    for s in scores {
        let mut fields = vec![
            s.truth.clone(),
            s.run.display().to_string(),
            s.protocol.name().to_owned(),
            s.protocol.unit().to_owned(),
            s.points[0].to_string(),
            s.points[1].to_string(),
        ];
        for n in [&s.score, &s.floor, &s.floor_in_run_frame] {
            fields.push(n.as_ref().map_or_else(String::new, |n| number(n.chamfer)));
            for i in 0..3 {
                let at = n.as_ref().and_then(|n| n.at.get(i));
                let values = at.map_or([None; 3], |a| [Some(a.precision), Some(a.recall), Some(a.f1)]);
                fields.extend(values.map(|v| v.map_or_else(String::new, number)));
            }
        }
        fields.push(s.failure.clone().unwrap_or_default());
        out.push_str(&line(fields));
    }
    out
}

/// A line a true object.
pub fn objects_csv(pieces: &[PieceScore]) -> String {
    let head = ["truth", "object", "found", "diameter_m", "add_s_m", "within_tenth", "iou_3d", "rotation_deg"];
    let mut out = line(head.map(str::to_owned));
    let optional = |v: Option<f64>| v.map_or_else(String::new, number);
    for p in pieces {
        out.push_str(&line([
            p.truth.clone(),
            p.id.clone(),
            p.found.clone().unwrap_or_default(),
            number(p.diameter_m),
            optional(p.add_s_m),
            p.within_tenth().to_string(),
            number(p.iou),
            optional(p.rotation_deg),
        ]));
    }
    out
}
