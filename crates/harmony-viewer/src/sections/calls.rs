//! Model calls: totals by role, and every call.

use std::collections::BTreeMap;
use std::fmt::Write;

use crate::html::{dollars, duration, esc, grouped};
use crate::{CallRow, ReportData};

#[derive(Default)]
struct Total {
    calls: u64,
    recorded: u64,
    seconds: f64,
    tokens_in: u64,
    tokens_out: u64,
    cost: f64,
    unpriced: u64,
    problems: u64,
}

impl Total {
    fn add(&mut self, call: &CallRow) {
        self.calls += 1;
        self.recorded += u64::from(call.from_record);
        self.seconds += if call.seconds.is_finite() { call.seconds.max(0.0) } else { 0.0 };
        self.tokens_in = self.tokens_in.saturating_add(call.tokens_in);
        self.tokens_out = self.tokens_out.saturating_add(call.tokens_out);
        match call.cost_usd.filter(|c| c.is_finite()) {
            Some(cost) => self.cost += cost,
            None => self.unpriced += 1,
        }
        self.problems += u64::from(!call.problem.is_empty());
    }

    fn row(&self, role: &str, players: &str) -> String {
        let cost = if self.unpriced == self.calls { "–".to_owned() } else { dollars(self.cost) };
        format!(
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td \
             class=\"n\">{}</td><td class=\"n\">{} / {}</td><td class=\"n\">{cost}</td></tr>",
            esc(role),
            esc(players),
            grouped(self.calls),
            grouped(self.recorded),
            grouped(self.problems),
            duration(self.seconds),
            grouped(self.tokens_in),
            grouped(self.tokens_out),
        )
    }
}

pub(crate) fn calls(report: &ReportData, placed: usize) -> String {
    let mut out = "<h2 id=\"calls\">Model calls</h2>".to_owned();
    if report.calls.is_empty() {
        out.push_str("<p class=\"soft\">No model was asked.</p>");
        return out;
    }
    let mut roles: BTreeMap<&str, (Total, Vec<&str>)> = BTreeMap::new();
    let mut all = Total::default();
    for call in &report.calls {
        let (total, players) = roles.entry(&call.role).or_default();
        total.add(call);
        all.add(call);
        if !players.contains(&call.player.as_str()) {
            players.push(&call.player);
        }
    }
    out.push_str(
        "<div class=\"card scroll\"><table><tr><th>Role</th><th>Played by</th><th class=\"n\">Calls</th><th class=\"n\">From \
         record</th><th class=\"n\">Problems</th><th class=\"n\">Time</th><th class=\"n\">Tokens in / out</th><th \
         class=\"n\">Cost</th></tr>",
    );
    for (role, (total, players)) in &roles {
        out.push_str(&total.row(role, &players.join(", ")));
    }
    out.push_str(&all.row("All", "").replace("<td", "<td style=\"font-weight:600\""));
    out.push_str("</table>");
    if placed > 0 {
        let _ = write!(out, "<p class=\"soft\">{:.1} calls a placed object.</p>", all.calls as f64 / placed as f64);
    }
    out.push_str("</div>");
    let _ = write!(
        out,
        "<details style=\"margin-top:12px\"><summary>Every call</summary><div class=\"card scroll\"><table><tr><th>Name</th>\
         <th>Role</th><th>Player</th><th class=\"n\">Time</th><th class=\"n\">Tokens</th><th class=\"n\">Cost</th><th \
         class=\"n\">Tries</th><th>Remarks</th></tr>"
    );
    for c in &report.calls {
        let mut remarks = Vec::new();
        if c.from_record {
            remarks.push("from the record");
        }
        if !c.problem.is_empty() {
            remarks.push(&c.problem);
        }
        let _ = write!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{} / {}</td><td \
             class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td></tr>",
            esc(&c.name),
            esc(&c.role),
            esc(&c.player),
            duration(c.seconds),
            grouped(c.tokens_in),
            grouped(c.tokens_out),
            c.cost_usd.filter(|v| v.is_finite()).map(dollars).unwrap_or_default(),
            c.tries,
            esc(&remarks.join("; ")),
        );
    }
    out.push_str("</table></div></details>");
    out
}
