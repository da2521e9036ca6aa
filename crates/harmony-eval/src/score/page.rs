//! eval.html: the tables, then every scene with its pictures side by side, the worst on top.

use std::fmt::Write;

use super::metric::MetricId;
use super::table::{ColumnKey, Evaluation, Look, SceneRow, SceneScore, Shot};
use crate::page::{esc, page as around, picture_of};
use crate::statistics::Mean;

/// The page.
pub fn page(e: &Evaluation) -> String {
    let mut html =
        format!("<h1>Renders against their photos</h1><p>{} scenes; {}</p>", e.scenes.len(), esc(&e.sets.join(", ")));
    for note in &e.notes {
        let _ = write!(html, "<p class=\"soft\">{}</p>", esc(note));
    }
    html.push_str("<h2>Means</h2>");
    means(&mut html, e);
    if !e.comparisons.is_empty() {
        html.push_str("<h2>Paired differences</h2>");
        differences(&mut html, e);
    }
    html.push_str(NOTES);
    html.push_str("<h2>Scenes, the worst on top</h2>");
    for row in worst_first(e) {
        scene(&mut html, e, row);
    }
    around("HARMONY: renders against their photos", &html)
}

const NOTES: &str = "<p class=\"soft\">Lower is better. own: over what the column has. shared: over the scenes that \
every column of the figure has. failures as worst: over all scenes, a missing one counted with the worst value of the \
figure in any column. 95 %: bootstrap over scenes. N-CLIP: one minus the cosine of CLIP ViT-B/32 features; PL: mean \
squared difference of sRGB values; the photo is resized to the render's size.</p>";

fn four(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"))
}

fn means(html: &mut String, e: &Evaluation) {
    html.push_str(
        "<div class=\"wide\"><table><tr><th>figure<th>n<th>own mean<th>sd<th>95 %<th>n<th>shared mean<th>n<th>failures as \
         worst<th>missing</tr>",
    );
    for c in &e.columns {
        let n = |m: Option<Mean>| m.map_or(0, |m| m.n);
        let mean = |m: Option<Mean>| four(m.map(|m| m.mean));
        let sure =
            c.own.and_then(|m| m.interval).map_or_else(|| "-".to_owned(), |i| format!("{:.4} .. {:.4}", i.low, i.high));
        let _ = write!(
            html,
            "<tr><td>{}<td>{}<td>{}<td>{}<td>{sure}<td>{}<td>{}<td>{}<td>{}<td>{}</tr>",
            esc(&e.title(c.key)),
            n(c.own),
            mean(c.own),
            four(c.own.and_then(|m| m.sd)),
            n(c.intersection),
            mean(c.intersection),
            n(c.failures_as_worst),
            mean(c.failures_as_worst),
            c.missing,
        );
    }
    html.push_str("</table></div>");
}

fn differences(html: &mut String, e: &Evaluation) {
    let _ = write!(
        html,
        "<div class=\"wide\"><table><tr><th>{} minus<th>n<th>mean<th>95 %<th>median<th>better<th>worse<th>equal<th>sign test \
         p</tr>",
        esc(&e.sets[0])
    );
    for c in &e.comparisons {
        let p = &c.paired;
        let sure = p.difference.interval;
        let class = sure.map_or("", |i| {
            if i.high < 0.0 {
                "good"
            } else if i.low > 0.0 {
                "bad"
            } else {
                ""
            }
        });
        let _ = write!(
            html,
            "<tr><td>{} {} {}<td>{}<td class=\"{class}\">{:+.4}<td>{}<td>{:+.4}<td>{}<td>{}<td>{}<td>{:.4}</tr>",
            esc(&e.sets[c.against]),
            c.look.name(),
            c.metric.title(),
            p.difference.n,
            p.difference.mean,
            sure.map_or_else(|| "-".to_owned(), |i| format!("{:+.4} .. {:+.4}", i.low, i.high)),
            p.median,
            p.lower,
            p.higher,
            p.equal,
            p.p,
        );
    }
    html.push_str("</table></div>");
}

/// Scenes that the first set lacks come first, then those with the highest value of its first figure.
fn worst_first(e: &Evaluation) -> Vec<&SceneRow> {
    let order = |row: &SceneRow| {
        let value = |look, metric| e.value(row, ColumnKey { set: 0, look, metric });
        let found = MetricId::ALL.iter().find_map(|m| value(Look::Lit, *m).or_else(|| value(Look::Flat, *m)));
        found.unwrap_or(f64::INFINITY)
    };
    let mut rows: Vec<&SceneRow> = e.scenes.iter().collect();
    rows.sort_by(|a, b| order(b).total_cmp(&order(a)).then_with(|| a.scene.cmp(&b.scene)));
    rows
}

fn scene(html: &mut String, e: &Evaluation, row: &SceneRow) {
    let _ = write!(html, "<h3>{}</h3><div class=\"row\">", esc(&row.scene));
    match &row.photo {
        Some(photo) => {
            let _ = write!(html, "<figure>{}<figcaption>photo</figcaption></figure>", picture_of(photo, "photo"));
        }
        None => html.push_str("<figure><figcaption class=\"bad\">no photo</figcaption></figure>"),
    }
    for (set, score) in e.sets.iter().zip(&row.sets) {
        panels(html, set, score);
    }
    html.push_str("</div>");
}

fn panels(html: &mut String, set: &str, score: &SceneScore) {
    let star = if score.starred { "*" } else { "" };
    let things = score.objects.map_or_else(String::new, |n| format!(", {n} objects"));
    for (look, shot) in &score.shots {
        let name = format!("{set}{star} {}{things}", look.name());
        let _ = write!(
            html,
            "<figure>{}<figcaption>{}<br>{}</figcaption></figure>",
            picture_of(&shot.file, &name),
            esc(&name),
            values(shot)
        );
    }
    if let Some(failure) = &score.failure {
        let _ = write!(
            html,
            "<figure><figcaption class=\"bad\">{}{star}: {}</figcaption></figure>",
            esc(set),
            esc(failure)
        );
    }
}

fn values(shot: &Shot) -> String {
    let mut said: Vec<String> = shot.values.iter().map(|(m, v)| format!("{} {v:.4}", m.title())).collect();
    said.extend(shot.errors.iter().map(|e| format!("<span class=\"bad\">{}</span>", esc(e))));
    if (shot.squash - 1.0).abs() > 0.01 {
        said.push(format!("photo squashed by {:.2}", shot.squash));
    }
    said.join(" &middot; ")
}
