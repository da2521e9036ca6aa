//! An analysis as text, CSV and a page.

use std::fmt::Write as _;

use super::{Analysis, Estimate, Results};
use crate::page::escape;

fn interval(e: &Estimate, digits: usize) -> String {
    format!("[{:.digits$}, {:.digits$}]", e.low, e.high)
}

fn p_value(p: f64) -> String {
    if p < 0.0001 { "p < 0.0001".to_owned() } else { format!("p = {p:.4}") }
}

/// For a terminal.
pub(super) fn text(a: &Analysis) -> String {
    let mut out = String::new();
    let _ = writeln!(out, "study {} (version {}): {} answers in the log", a.study, a.version, a.answers);
    if a.undecodable > 0 {
        let _ = writeln!(out, "{} answers do not decode and are left out", a.undecodable);
    }
    if a.unsigned > 0 {
        let _ = writeln!(out, "{} answers came from files without an invitation", a.unsigned);
    }
    for p in a.participants.iter().filter(|p| !p.left_out.is_empty()) {
        let _ = writeln!(out, "left out: {} ({})", p.code, p.left_out.join("; "));
    }
    section(&mut out, a, &a.counted, "");
    if let Some(everybody) = &a.everybody {
        section(&mut out, a, everybody, "\nWith those who were left out\n");
    }
    if let Some(tau) = a.self_agreement {
        let _ = writeln!(out, "people agree with themselves on repeated scenes: Kendall's tau {tau:.2}");
    }
    for note in &a.notes {
        let _ = writeln!(out, "note: {note}");
    }
    out
}

fn section(out: &mut String, a: &Analysis, r: &Results, head: &str) {
    let gaps = if r.rankings == r.people * r.scenes { "complete" } else { "some missing" };
    let _ = writeln!(out, "{head}{} people, {} scenes, {} rankings ({gaps})\n", r.people, r.scenes, r.rankings);
    let wide = a.methods.iter().map(|m| m.chars().count()).max().unwrap_or(6).max(6);
    let _ = writeln!(
        out,
        "{:wide$}  {:>12} {:>14}  {:>6} {:>14}  {:>6} {:>14}  {:>8} {:>16}",
        "Method", "Mean rank", "95 %", "Top-1", "95 %", "Top-2", "95 %", "Strength", "95 %"
    );
    for row in &r.table {
        let _ = writeln!(
            out,
            "{:wide$}  {:>12} {:>14}  {:>6.1} {:>14}  {:>6.1} {:>14}  {:>8.2} {:>16}",
            row.method,
            format!("{:.2} ± {:.2}", row.mean_rank.value, row.sd),
            interval(&row.mean_rank, 2),
            row.top1.value,
            interval(&row.top1, 1),
            row.top2.value,
            interval(&row.top2, 1),
            row.log_strength.value,
            interval(&row.log_strength, 2)
        );
    }
    let _ = writeln!(
        out,
        "\nStrength: Plackett-Luce, logarithm against {}; intervals: {} draws of people and of scenes",
        a.reference, a.bootstrap.0
    );
    for test in &r.tests {
        let f = &test.friedman;
        let _ = writeln!(
            out,
            "Friedman over {} {}: chi2 = {:.2}, {} degrees of freedom, {}; Kendall's W = {:.2}; Nemenyi's critical difference {:.2} at 5 %",
            f.blocks,
            test.blocks,
            f.chi2,
            a.methods.len() - 1,
            p_value(f.p),
            f.w,
            test.critical_difference
        );
    }
    for v in &r.versus {
        let _ = writeln!(
            out,
            "{} above {}: {:.1} % {}; better for {} people, worse for {}, sign test {}",
            a.reference,
            v.method,
            v.wins.value,
            interval(&v.wins, 1),
            v.people[0],
            v.people[1],
            p_value(v.sign_p)
        );
    }
    if let Some(w) = &r.agreement {
        let _ = writeln!(
            out,
            "agreement of people within a scene: Kendall's W median {:.2}, from {:.2} to {:.2}",
            w.median, w.low, w.high
        );
    }
    match r.letters {
        Some([chi2, degrees, p]) => {
            let _ =
                writeln!(out, "letters against ranks: chi2 = {chi2:.1}, {degrees} degrees of freedom, {}", p_value(p));
        }
        None => {
            let _ = writeln!(out, "letters against ranks: too few rankings to tell");
        }
    }
    let _ = writeln!(
        out,
        "strengths predict pairwise wins within {:.1} points; median time a ranking {:.0} s",
        r.model_misfit, r.median_seconds
    );
}

/// A field of a CSV file.
pub(crate) fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// The table.
pub(super) fn csv(a: &Analysis) -> String {
    let mut out =
        "people_counted,method,rankings,mean_rank,sd,mean_rank_low,mean_rank_high,top1_percent,top1_low,top1_high,\
                   top2_percent,top2_low,top2_high,log_strength,log_strength_low,log_strength_high\n"
            .to_owned();
    for (name, results) in [("by_rule", Some(&a.counted)), ("everybody", a.everybody.as_ref())] {
        for row in results.iter().flat_map(|r| &r.table) {
            let n = results.map_or(0, |r| r.rankings);
            let e = |e: &Estimate, d: usize| format!("{:.d$},{:.d$},{:.d$}", e.value, e.low, e.high);
            let _ = writeln!(
                out,
                "{name},{},{n},{:.4},{:.4},{:.4},{:.4},{},{},{}",
                field(&row.method),
                row.mean_rank.value,
                row.sd,
                row.mean_rank.low,
                row.mean_rank.high,
                e(&row.top1, 2),
                e(&row.top2, 2),
                e(&row.log_strength, 4)
            );
        }
    }
    out
}

/// Every ranking that counts.
pub(super) fn rankings_csv(a: &Analysis) -> String {
    let mut out = "participant,scene".to_owned();
    a.methods.iter().for_each(|m| {
        out.push(',');
        out.push_str(&field(m));
    });
    out.push_str(",active_s\n");
    for r in &a.rankings {
        let _ = write!(out, "{},{}", field(&r.participant), field(&r.scene));
        r.ranks.iter().for_each(|rank| {
            let _ = write!(out, ",{rank}");
        });
        let _ = writeln!(out, ",{:.1}", r.active_ms as f64 / 1000.0);
    }
    out
}

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem;color:#1c2026;\
background:#fff}table{border-collapse:collapse;margin:1rem 0}td,th{padding:.3rem .7rem;border-bottom:1px solid #d5d9e0;\
text-align:right}td:first-child,th:first-child{text-align:left}small{color:#5c6470}tr.ref td{font-weight:600}svg{max-width:\
100%;height:auto}";

/// A page; works from disk, offline.
pub(super) fn html(a: &Analysis) -> String {
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width,initial-scale=1\"><title>Study {0}</title><style>{STYLE}</style></head><body>\
         <h1>Study {0}</h1>",
        escape(&a.study)
    );
    let out_count = a.participants.iter().filter(|p| !p.left_out.is_empty()).count();
    let _ = write!(
        out,
        "<p>{} people took part, {out_count} are left out by the rule that was fixed when the study was built.</p>",
        a.participants.len()
    );
    page_section(&mut out, a, &a.counted, "Results");
    if let Some(everybody) = &a.everybody {
        page_section(&mut out, a, everybody, "With those who were left out");
    }
    out.push_str("<h2>People</h2><table><tr><th>Code</th><th>Rankings</th><th>Median time</th><th>Checks passed</th><th>Left out</th></tr>");
    for p in &a.participants {
        let _ = write!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{:.0} s</td><td>{} of {}</td><td>{}</td></tr>",
            escape(&p.code),
            p.rankings,
            p.median_ms as f64 / 1000.0,
            p.checks_passed,
            p.checks_passed + p.checks_failed,
            escape(&p.left_out.join("; "))
        );
    }
    out.push_str("</table><h2>All in words</h2><pre>");
    out.push_str(&escape(&text(a)));
    out.push_str("</pre></body></html>\n");
    out
}

fn page_section(out: &mut String, a: &Analysis, r: &Results, head: &str) {
    let _ = write!(
        out,
        "<h2>{head}</h2><p>{} people, {} scenes, {} rankings.</p>{}<table><tr><th>Method</th><th>Mean rank ↓</th><th>Top-1 \
         (%) ↑</th><th>Top-2 (%) ↑</th><th>Strength</th></tr>",
        r.people,
        r.scenes,
        r.rankings,
        bars(a, r)
    );
    for row in &r.table {
        let class = if row.method == a.reference { " class=\"ref\"" } else { "" };
        let _ = write!(
            out,
            "<tr{class}><td>{}</td><td>{:.2} ± {:.2} <small>{}</small></td><td>{:.1} <small>{}</small></td><td>{:.1} \
             <small>{}</small></td><td>{:.2} <small>{}</small></td></tr>",
            escape(&row.method),
            row.mean_rank.value,
            row.sd,
            interval(&row.mean_rank, 2),
            row.top1.value,
            interval(&row.top1, 1),
            row.top2.value,
            interval(&row.top2, 1),
            row.log_strength.value,
            interval(&row.log_strength, 2)
        );
    }
    out.push_str("</table><p>How often the row's method stands above the column's, percent:</p><table><tr><th></th>");
    a.methods.iter().for_each(|m| {
        let _ = write!(out, "<th>{}</th>", escape(m));
    });
    out.push_str("</tr>");
    for (i, row) in r.wins.iter().enumerate() {
        let _ = write!(out, "<tr><td>{}</td>", escape(&a.methods[i]));
        for (j, share) in row.iter().enumerate() {
            let _ = if i == j { write!(out, "<td></td>") } else { write!(out, "<td>{share:.1}</td>") };
        }
        out.push_str("</tr>");
    }
    out.push_str("</table>");
}

/// Mean ranks with intervals, as a drawing.
fn bars(a: &Analysis, r: &Results) -> String {
    let k = a.methods.len() as f64;
    let (left, width, step) = (180.0, 620.0, 34.0);
    let height = step * k + 40.0;
    let x = |rank: f64| left + (rank - 1.0) / (k - 1.0).max(1.0) * (width - 20.0);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {} {height}\" width=\"{}\" role=\"img\" aria-label=\"mean ranks with 95 percent intervals\" \
         font-family=\"system-ui,sans-serif\" font-size=\"14\">",
        left + width,
        left + width
    );
    for rank in 1..=a.methods.len() {
        let at = x(rank as f64);
        let _ = write!(
            svg,
            "<line x1=\"{at}\" x2=\"{at}\" y1=\"6\" y2=\"{}\" stroke=\"#d5d9e0\"/><text x=\"{at}\" y=\"{}\" \
             text-anchor=\"middle\">{rank}</text>",
            height - 26.0,
            height - 8.0
        );
    }
    let mut rows: Vec<_> = r.table.iter().collect();
    rows.sort_by(|a, b| a.mean_rank.value.total_cmp(&b.mean_rank.value));
    for (i, row) in rows.iter().enumerate() {
        let y = 22.0 + step * i as f64;
        let color = if row.method == a.reference { "#1d5fc4" } else { "#5c6470" };
        let _ = write!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text><line x1=\"{}\" x2=\"{}\" y1=\"{y}\" y2=\"{y}\" \
             stroke=\"{color}\" stroke-width=\"4\" stroke-linecap=\"round\"/><circle cx=\"{}\" cy=\"{y}\" r=\"7\" \
             fill=\"{color}\"/>",
            left - 16.0,
            y + 5.0,
            escape(&row.method),
            x(row.mean_rank.low),
            x(row.mean_rank.high),
            x(row.mean_rank.value)
        );
    }
    svg + "</svg>"
}
