//! How plausible the scene is as a place: what a simulation said of it, when it was asked.

use std::fmt::Write;

use crate::PlausibilityRow;
use crate::html::esc;

/// Marks of the section, so that it can be filled in later.
const BEGIN: &str = "<!--plausibility-->";
const END: &str = "<!--/plausibility-->";

/// The section; without rows it says how to get them.
pub(crate) fn plausibility(rows: &[PlausibilityRow]) -> String {
    let mut out = format!("{BEGIN}<h2 id=\"plausibility\">Plausibility</h2><div class=\"card\">");
    if rows.is_empty() {
        out.push_str("<p class=\"soft\">Not simulated: harmony simulate fills this in.</p>");
    } else {
        out.push_str("<table><thead><tr><th>What</th><th>Measured</th><th>As it should be</th></tr></thead><tbody>");
        for row in rows {
            let (class, word) = if row.good { ("good", "yes") } else { ("poor", "no") };
            let _ = write!(
                out,
                "<tr><td>{}</td><td>{}</td><td class=\"{class}\"><b>{word}</b></td></tr>",
                esc(&row.what),
                esc(&row.value)
            );
        }
        out.push_str("</tbody></table>");
    }
    let _ = write!(out, "</div>{END}");
    out
}

/// The page with the section filled in; `None` for a page that has none.
pub(crate) fn filled(page: &str, rows: &[PlausibilityRow]) -> Option<String> {
    let begin = page.find(BEGIN)?;
    let end = begin + page[begin..].find(END)? + END.len();
    Some(format!("{}{}{}", &page[..begin], plausibility(rows), &page[end..]))
}
