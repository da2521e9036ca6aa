//! Phases: how each ended, how long it took, what it warned of.

use std::fmt::Write;

use harmony_scene::Scene;

use crate::html::{duration, esc, warnings};
use crate::{PhaseStatus, ReportData};

pub(crate) fn phases(scene: &Scene, report: &ReportData) -> String {
    let mut out = "<h2 id=\"phases\">Phases</h2><div class=\"card\">".to_owned();
    if report.phases.is_empty() {
        out.push_str("<p class=\"soft\">Nothing is known about the phases of this run.</p>");
    }
    for phase in &report.phases {
        let (class, sign, word) = match phase.status {
            PhaseStatus::Done => ("good", "✓", "done"),
            PhaseStatus::Kept => ("good", "=", "kept from an earlier run"),
            PhaseStatus::Pending => ("soft", "·", "not started"),
            PhaseStatus::Skipped => ("soft", "–", "left out"),
            PhaseStatus::Failed => ("poor", "✗", "failed"),
        };
        let list = warnings(scene.warnings.iter().filter(|w| w.phase == phase.name), true);
        let count = scene.warnings.iter().filter(|w| w.phase == phase.name).count();
        let more = match count {
            0 => String::new(),
            1..=3 => format!("<div class=\"more\">{list}</div>"),
            n => format!("<details class=\"more\"><summary>{n} warnings</summary>{list}</details>"),
        };
        let time = if let (Some(own), Some(waited)) = (phase.own_seconds, phase.waited_seconds) {
            let (own, waited) = (duration(own), duration(waited));
            format!(
                "<span class=\"time\">own work <span>{own}</span><br>waiting for players <span>{waited}</span></span>"
            )
        } else {
            let time = if phase.seconds > 0.0 { duration(phase.seconds) } else { String::new() };
            format!("<span class=\"time\" title=\"what the players' answers took\">{time}</span>")
        };
        let _ = write!(
            out,
            "<div class=\"phase\"><b class=\"{class}\" title=\"{word}\">{sign}</b><span><b>{}</b> <span \
             class=\"soft\">{word}</span> {}</span>{time}{more}</div>",
            esc(&phase.name.replace('_', " ")),
            esc(&phase.outcome),
        );
    }
    out.push_str("</div>");
    let known = |name: &str| name == "input" || report.phases.iter().any(|p| p.name == name);
    let rest = warnings(scene.warnings.iter().filter(|w| !known(&w.phase)), true);
    if !rest.is_empty() {
        let _ = write!(out, "<div class=\"card\" style=\"margin-top:14px\"><h3>Further warnings</h3>{rest}</div>");
    }
    out
}
