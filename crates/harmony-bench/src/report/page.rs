//! `report.html`: one page that works from disk and asks nothing of the network.

use std::fmt::Write;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::svg::histogram;
use crate::run::{BenchResult, PICTURES};
use crate::score::{RoomScore, in_all};
use crate::summary::{self, Figure, find, number, summary, targets};

/// Cases shown with their pictures, for each of the two orders.
const WORST: usize = 6;

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1d2126;--soft:#69727d;--line:#dfe3e8;--paper:#fff;--panel:#f6f7f9;--bar:#5b7fa6;\
--good:#177245;--bad:#b3261e}\
@media(prefers-color-scheme:dark){:root{--ink:#e6e8eb;--soft:#9aa3ad;--line:#383e46;--paper:#16191d;--panel:#1f2328;\
--bar:#7fa3cc;--good:#6cc79a;--bad:#f2857c}}\
body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:1180px;margin:2rem auto;\
padding:0 1rem}h1{font-size:1.5rem;margin-bottom:.2rem}h2{font-size:1.15rem;margin-top:2.2rem}p{margin:.3rem 0}\
.soft,small{color:var(--soft)}.wide{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums;\
width:100%;font-size:.87rem}th,td{padding:.2rem .55rem;text-align:right;border-bottom:1px solid var(--line);\
white-space:nowrap}th{color:var(--soft);font-weight:600}th:first-child,td:first-child{text-align:left}td.sub{\
padding-left:1.6rem}.met{color:var(--good);font-weight:600}.missed{color:var(--bad);font-weight:600}\
.charts{display:grid;grid-template-columns:repeat(auto-fill,minmax(260px,1fr));gap:1rem}\
figure{margin:0;padding:.6rem;background:var(--panel);border-radius:6px}figcaption{font-size:.85rem}\
svg{width:100%;height:auto;display:block}svg text{font-size:10px;fill:var(--soft)}.bar{fill:var(--bar)}\
.axis{stroke:var(--soft);fill:none}.target{stroke:var(--bad);stroke-dasharray:4 3;fill:none}\
.middle{stroke:var(--ink);fill:none}.case{margin-bottom:1rem}.case img{width:100%;height:auto;border-radius:4px}\
.true{color:#00965a}.run{color:#e11e78}";

/// What the page allows itself.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";

/// Text as HTML text.
pub(super) fn esc(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The page; pictures come from the folder `cases` in `out`, where they are there.
pub fn page(result: &BenchResult, out: &Path) -> String {
    let figures = summary(&result.raw);
    let height = match (result.level, result.exact_height) {
        (None, _) => "finished runs, judged afterwards",
        (_, true) => "room height exact",
        (_, false) => "room height as noisy as the rest",
    };
    let changes = if result.changes.is_empty() {
        "settings as they stand".to_owned()
    } else {
        format!("changed settings: {}", result.changes.join(", "))
    };
    let changes = match result.meshes {
        Some(meshes) => format!("meshes {}; {changes}", meshes.name()),
        None => changes,
    };
    let (met, missed) = figures.iter().fold((0, 0), |(a, b), f| match f.met() {
        Some(true) => (a + 1, b),
        Some(false) => (a, b + 1),
        None => (a, b),
    });
    let mut html = format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width\"><meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\"><title>\
         HARMONY benchmark: {0}</title><style>{STYLE}</style></head><body><h1>HARMONY benchmark</h1><p>{0} \
         ({height})</p><p class=\"soft\">{1}</p><p><span class=\"met\">{met} targets met</span>, \
         <span class=\"missed\">{missed} not met</span>, in metres as delivered.</p>",
        esc(&result.title),
        esc(&changes),
    );
    html.push_str("<h2>Figures, metres as delivered</h2>");
    table(&mut html, &figures);
    for line in &result.absent {
        let _ = write!(html, "<p class=\"soft\">{}</p>", esc(line));
    }
    html.push_str(
        "<h2>Distributions</h2><p class=\"soft\">Solid line: median. Dashed line: target. The last bar \
                   holds all that lies beyond the axis.</p><div class=\"charts\">",
    );
    for f in figures.iter().filter(|f| f.values.len() > 1) {
        let chart = histogram(&f.values, &f.unit, f.target[0], f.more_is_better);
        let _ = write!(
            html,
            "<figure><figcaption>{} <small>n = {}</small></figcaption>{chart}</figure>",
            esc(f.name.trim()),
            f.count
        );
    }
    html.push_str(
        "</div><h2>Rooms</h2><p class=\"soft\">Turn and centre: errors of the camera. Position and size: medians.</p>",
    );
    rooms(&mut html, &result.raw);
    looks(&mut html, &result.raw);
    super::views::section(&mut html, &result.raw, out);
    worst(&mut html, result, out);
    html.push_str(
        "<h2>Figures after scale alignment</h2><p class=\"soft\">Each run scaled by the median ratio of true \
                   to predicted depth.</p>",
    );
    table(&mut html, &summary(&result.aligned));
    html.push_str(NOTES);
    html.push_str("</body></html>\n");
    html
}

/// What each look mended, over all rooms.
fn looks(html: &mut String, rooms: &[RoomScore]) {
    let all = in_all(rooms.iter().flat_map(|r| &r.looks));
    if all.is_empty() {
        return;
    }
    html.push_str(
        "<h2>Looks at what was placed</h2><p class=\"soft\">Objects that a look moved, turned or resized, against the \
         truth; one tolerance is 15 cm, 10 degrees or 12 %.</p><div class=\"wide\"><table><tr><th>look<th>questions\
         <th>faults shown<th>named<th>changed<th>mended<th>made worse<th>tolerances gained<th>added: right<th>wrong<th>taken out</tr>",
    );
    for s in all {
        let _ = write!(
            html,
            "<tr><td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}</tr>",
            s.look.about(),
            s.questions,
            s.there,
            s.found,
            s.moved,
            s.mended,
            s.made,
            number(s.gained),
            s.added_right,
            s.added_wrong,
            s.removed,
        );
    }
    html.push_str("</table></div>");
}

const NOTES: &str = "<h2>How it is measured</h2><p class=\"soft\">gen3dsr: points drawn evenly from the surfaces of \
both sides, each in the frame of its own camera, in metres, without registration; CD is half the sum of both mean \
distances, F the harmonic mean of precision and recall. True objects are cut by the photo's frustum like predicted \
ones, because the truth holds whole rooms; with \"truth whole\" they are not. midi: scene in [-1, 1], rigid ICP, squared \
distances. Both leave out rooms whose reconstruction is empty. F@0.001 mostly tells how densely surfaces are sampled: \
compare it with best_f1 in scores.json.</p>";

fn table(html: &mut String, figures: &[Figure]) {
    html.push_str(
        "<div class=\"wide\"><table><tr><th>figure<th>n<th>value<th>p25<th>median<th>p75<th>p90<th>worst<th>unit\
         <th>target<th></tr>",
    );
    for f in figures {
        let cell = |v: Option<f64>| v.map_or_else(String::new, number);
        let verdict = match f.met() {
            Some(true) => "<td class=\"met\">met",
            Some(false) => "<td class=\"missed\">not met",
            None => "<td>",
        };
        let class = if f.name.starts_with(' ') { " class=\"sub\"" } else { "" };
        let _ = write!(
            html,
            "<tr><td{class}>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}{verdict}</tr>",
            esc(f.name.trim()),
            f.count,
            number(f.value),
            cell(f.p25),
            cell(f.median),
            cell(f.p75),
            cell(f.p90),
            cell(f.worst),
            esc(&f.unit),
            targets(f),
        );
    }
    html.push_str("</table></div>");
}

fn rooms(html: &mut String, rooms: &[RoomScore]) {
    html.push_str(
        "<div class=\"wide\"><table><tr><th>room<th>turn deg<th>centre m<th>objects<th>missed<th>position m<th>worst m\
         <th>size %<th>F@0.1 %<th>CD m<th>PL<th>N-CLIP<th>LPIPS<th>cutting<th>floating<th>s</tr>",
    );
    for r in rooms {
        let figures = summary(std::slice::from_ref(r));
        let value = |name: &str| find(&figures, name).map_or_else(|| "-".to_owned(), |f| number(f.value));
        let worst = r.matched().map(|o| o.position_m).fold(f64::NAN, f64::max);
        let _ = write!(
            html,
            "<tr><td>{}<td>{:.2}<td>{:.3}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}\
             <td>{:.1}</tr>",
            esc(&r.case()),
            r.camera.rotation_deg,
            r.camera.centre_m,
            r.objects.len(),
            r.missed.len(),
            number(r.median_position()),
            number(worst),
            value(summary::SIZE),
            value(summary::F_OBJECTS),
            value(summary::CHAMFER_OBJECTS),
            value(summary::PIXEL_LOSS),
            value(summary::N_CLIP),
            value(summary::LPIPS),
            r.penetrating.len(),
            r.floating.len(),
            r.seconds,
        );
        if let Some(failure) = &r.failure {
            let _ = write!(html, "<tr><td class=\"missed\" colspan=\"16\">{}</tr>", esc(failure));
        }
    }
    html.push_str("</table></div>");
}

/// The cases that are farthest off by position, and those by F; each once.
fn worst(html: &mut String, result: &BenchResult, out: &Path) {
    let f = |r: &RoomScore| r.geometry.as_ref().and_then(|g| g.objects.as_ref()?.f(0.1));
    let mut by_position: Vec<&RoomScore> = result.raw.iter().filter(|r| r.median_position().is_finite()).collect();
    by_position.sort_by(|a, b| b.median_position().total_cmp(&a.median_position()));
    let mut by_f: Vec<&RoomScore> = result.raw.iter().filter(|r| f(r).is_some()).collect();
    by_f.sort_by(|a, b| f(a).unwrap_or(0.0).total_cmp(&f(b).unwrap_or(0.0)));
    by_position.truncate(WORST);
    by_f.truncate(WORST);
    by_f.retain(|r| !by_position.iter().any(|p| p.case() == r.case()));
    let _ = write!(
        html,
        "<h2>Worst cases</h2><p class=\"soft\">By median error of position, then by F@0.1. Photo, render of the run, and \
         outlines: <span class=\"true\">true</span>, <span class=\"run\">found</span>.</p>"
    );
    for r in by_position.into_iter().chain(by_f) {
        let case = r.case();
        let plain = !case.contains(['/', '\\']);
        let Some(jpeg) = plain.then(|| std::fs::read(out.join(PICTURES).join(format!("{case}.jpg"))).ok()).flatten()
        else {
            continue;
        };
        let mut far: Vec<_> = r.matched().collect();
        far.sort_by(|a, b| b.position_m.total_cmp(&a.position_m));
        let far: Vec<String> = far
            .iter()
            .take(3)
            .map(|o| format!("{} {:.2} m", o.truth.as_ref().unwrap_or(&o.id), o.position_m))
            .collect();
        let _ = write!(
            html,
            "<figure class=\"case\"><figcaption><b>{}</b>: position {} m in the median, F@0.1 {} %. Farthest off: \
             {}.{}</figcaption><img alt=\"photo, render, outlines\" src=\"data:image/jpeg;base64,{}\"></figure>",
            esc(&case),
            number(r.median_position()),
            f(r).map_or_else(|| "-".to_owned(), number),
            esc(&far.join(", ")),
            if r.missed.is_empty() { String::new() } else { format!(" Missed: {}.", esc(&r.missed.join(", "))) },
            STANDARD.encode(jpeg),
        );
    }
}
