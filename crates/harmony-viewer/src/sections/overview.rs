//! Title, summary and the numbers at the top.

use std::fmt::Write;

use harmony_scene::Scene;

use crate::html::{Facts, dollars, duration, esc, warnings};
use crate::{PhaseStatus, ReportData};

pub(crate) fn overview(scene: &Scene, report: &ReportData) -> String {
    let mut out = String::new();
    let title = if report.title.is_empty() { "Scene" } else { &report.title };
    let _ = write!(out, "<header><h1>{}</h1><p>", esc(title));
    for chip in [&scene.room.room_type.replace('_', " "), &report.profile, &report.finished] {
        if !chip.is_empty() {
            let _ = write!(out, "<span class=\"chip\">{}</span>", esc(chip));
        }
    }
    let failed = report.phases.iter().find(|p| p.status == PhaseStatus::Failed);
    if let Some(phase) = failed {
        let _ = write!(out, "<span class=\"chip poor\">stopped in {}</span>", esc(&phase.name));
    }
    out.push_str("</p>");
    if !scene.summary.is_empty() {
        let _ = write!(out, "<p>{}</p>", esc(&scene.summary));
    }
    out.push_str(
        "<nav><a href=\"#pictures\">Pictures</a><a href=\"#scene3d\">3D view</a><a href=\"#phases\">Phases</a>\
         <a href=\"#room\">Room and camera</a><a href=\"#objects\">Objects</a><a href=\"#calls\">Calls</a></nav>\
         </header><main><div class=\"tiles\">",
    );
    let placed = scene.objects.len();
    let seconds: f64 = report.phases.iter().map(|p| p.seconds).filter(|s| s.is_finite()).sum();
    let costs: Vec<f64> = report.calls.iter().filter_map(|c| c.cost_usd).filter(|c| c.is_finite()).collect();
    let cost = if costs.is_empty() {
        ("–".to_owned(), "no price of a model call is known".to_owned())
    } else {
        (dollars(costs.iter().sum()), "for model calls".to_owned())
    };
    let per_object = |n: usize| {
        if placed > 0 { format!("calls, {:.1} a placed object", n as f64 / placed as f64) } else { "calls".to_owned() }
    };
    let tiles = [
        (placed.to_string(), "objects placed".to_owned()),
        (report.dropped.len().to_string(), "looked for, not placed".to_owned()),
        (scene.warnings.len().to_string(), "warnings".to_owned()),
        (report.calls.len().to_string(), per_object(report.calls.len())),
        cost,
        (duration(seconds), "for players' answers".to_owned()),
    ];
    for (value, name) in tiles {
        let _ = write!(out, "<div class=\"card tile\"><b>{}</b><span>{}</span></div>", esc(&value), esc(&name));
    }
    out.push_str("</div>");
    let input = warnings(scene.warnings.iter().filter(|w| w.phase == "input"), false);
    if !input.is_empty() {
        let _ = write!(out, "<div class=\"card\" style=\"margin-top:14px\"><h3>About the photo</h3>{input}</div>");
    }
    if !report.facts.is_empty() {
        let list = Facts::default().add_all(&report.facts).html("");
        let _ = write!(out, "<details style=\"margin-top:14px\"><summary>About this run</summary>{list}</details>");
    }
    out
}
