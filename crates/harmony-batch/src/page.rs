//! The status as one HTML page beside the set: no script, no network, pictures by relative path.

use crate::queue::SceneRow;
use crate::set::SetFolder;
use crate::status::{Status, spoken};

const STYLE: &str = "\
body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1200px;padding:0 1rem;color:#222;background:#fafafa}\
h1{font-size:1.4rem}h2{font-size:1.1rem;margin-top:2rem}\
.bar{display:flex;height:1.4rem;border-radius:4px;overflow:hidden;background:#ddd}\
.bar div{height:100%}.done{background:#2e7d4f}.failed{background:#b3392f}.cancelled{background:#888}.running{background:#3b6fb5}\
.facts{display:flex;flex-wrap:wrap;gap:.5rem 2rem;margin:1rem 0;padding:0;list-style:none}.facts b{font-size:1.2rem}\
table{border-collapse:collapse;width:100%}th,td{text-align:left;padding:.25rem .6rem;border-bottom:1px solid #ddd;vertical-align:top}\
td.n,th.n{text-align:right}code{background:#eee;padding:.1rem .3rem;border-radius:3px;word-break:break-all}\
.note{background:#fff3cd;padding:.6rem .8rem;border-radius:4px}\
.scenes{display:grid;grid-template-columns:repeat(auto-fill,minmax(280px,1fr));gap:1rem}\
.scenes a{color:inherit;text-decoration:none}.scenes figure{margin:0;background:#fff;border:1px solid #ddd;border-radius:4px;padding:.4rem}\
.scenes img{width:100%;display:block;aspect-ratio:8/3;object-fit:contain;background:#eee}\
.none{width:100%;aspect-ratio:8/3;background:#eee;display:grid;place-items:center;color:#888}figcaption{font-size:.85rem;margin-top:.3rem}\
summary{cursor:pointer}";

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The page.
pub fn page(status: &Status, folder: &SetFolder) -> String {
    let c = &status.counts;
    let name = folder.path().file_name().unwrap_or_default().to_string_lossy();
    let mut out = format!(
        "<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content=\"width=device-width\">\
         <title>{0}: {1} of {2} scenes</title><style>{STYLE}</style><h1>{0}: {1} of {2} scenes</h1>",
        escaped(&name),
        c.done,
        c.all()
    );
    let part = |n: i64| n as f64 * 100.0 / c.all().max(1) as f64;
    out += "<div class=bar role=img aria-label=progress>";
    for (class, n) in [("done", c.done), ("failed", c.failed), ("cancelled", c.cancelled), ("running", c.running)] {
        out += &format!("<div class={class} style=\"width:{:.2}%\" title=\"{n} {class}\"></div>", part(n));
    }
    out += "</div>";
    if status.set.state.name() != "running" {
        out += &format!("<p class=note>The set is {}. {}</p>", status.set.state.name(), escaped(&status.set.reason));
    }
    out += "<ul class=facts>";
    let mut fact = |what: &str, value: String| out += &format!("<li>{what}<br><b>{}</b></li>", escaped(&value));
    fact("done", c.done.to_string());
    fact("running", c.running.to_string());
    fact("queued", c.queued.to_string());
    fact("waiting for a retry", c.waiting.to_string());
    fact("failed", c.failed.to_string());
    fact("cancelled", c.cancelled.to_string());
    if c.done > 0 {
        fact("a scene takes", spoken(c.mean_busy_ms / 1000.0));
    }
    if let Some(left) = status.left_s.filter(|_| c.open() > 0) {
        fact("time left", spoken(left));
    }
    let slots: i64 = status.workers.iter().map(|w| w.slots).sum();
    fact("workers, places", format!("{}, {slots}", status.workers.len()));
    out += "</ul><p>";
    out += &escaped(&status.money());
    out += &format!(". Bills of the runs: {:.2} US$; what a killed run lost is not on them.</p>", c.bills_usd);
    if !status.causes.is_empty() {
        out += "<h2>Failures by stage and cause</h2><table><tr><th>stage<th>cause<th class=n>failed<th class=n>waiting<th>one of them<th>try again";
        for cause in &status.causes {
            let words = cause.cause.replace('\'', "_");
            let command = format!("harmony batch retry SET --stage {} --cause '{words}'", cause.stage);
            out += &format!(
                "<tr><td>{}<td>{}<td class=n>{}<td class=n>{}<td><a href=\"logs/{4}.log\">{4}</a><td><code>{5}</code>",
                escaped(&cause.stage),
                escaped(&cause.cause),
                cause.failed,
                cause.waiting,
                escaped(&cause.example),
                escaped(&command)
            );
        }
        out += "</table>";
    }
    if !status.running.is_empty() {
        out += "<h2>Running</h2><table><tr><th>scene<th>worker<th class=n>since<th class=n>calls<th class=n>US$";
        for row in &status.running {
            let since = spoken((status.now - row.started) as f64 / 1000.0);
            out += &format!(
                "<tr><td>{}<td>{}<td class=n>{since}<td class=n>{}<td class=n>{:.2}",
                escaped(&row.scene),
                escaped(&row.worker),
                row.calls,
                row.paid_usd
            );
        }
        out += "</table>";
    }
    if !status.failed.is_empty() {
        out += &heading("Failed", status.failed.len(), c.failed);
        out += "<table><tr><th>scene<th>stage<th>message<th class=n>US$";
        for row in &status.failed {
            out += &format!(
                "<tr><td><a href=\"logs/{0}.log\">{0}</a><td>{1}<td>{2}<td class=n>{3:.2}",
                escaped(&row.scene),
                escaped(&row.stage),
                escaped(&row.message),
                row.paid_usd
            );
        }
        out += "</table>";
    }
    if !status.done.is_empty() {
        out += &heading("Done", status.done.len(), c.done);
        out += "<div class=scenes>";
        for row in &status.done {
            out += &figure(row, folder);
        }
        out += "</div>";
    }
    if !status.workers.is_empty() {
        out += "<h2>Workers</h2><table><tr><th>machine<th class=n>process<th class=n>places<th class=n>busy<th class=n>heard of";
        for worker in &status.workers {
            out += &format!(
                "<tr><td>{}<td class=n>{}<td class=n>{}<td class=n>{}<td class=n>{} ago",
                escaped(&worker.host),
                worker.pid,
                worker.slots,
                worker.busy,
                spoken(worker.silent_ms as f64 / 1000.0)
            );
        }
        out += "</table>";
    }
    out += "</html>\n";
    out
}

fn heading(what: &str, shown: usize, all: i64) -> String {
    if shown as i64 == all {
        format!("<h2>{what}</h2>")
    } else {
        format!("<h2>{what}</h2><p>The last {shown} of {all}; <code>scenes.csv</code> has all.</p>")
    }
}

fn figure(row: &SceneRow, folder: &SetFolder) -> String {
    let scene = escaped(&row.scene);
    let picture = if folder.thumb(&row.scene).is_file() {
        format!("<img loading=lazy src=\"thumbs/{scene}.jpg\" alt=\"photo and render of {scene}\">")
    } else {
        "<div class=none>no picture</div>".to_owned()
    };
    format!(
        "<a href=\"scenes/{scene}/report.html\"><figure>{picture}<figcaption>{scene}: {}, {:.2} US$, {} calls</figcaption></figure></a>",
        spoken(row.busy_ms as f64 / 1000.0),
        row.paid_usd,
        row.calls
    )
}
