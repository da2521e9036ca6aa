//! Views in tables.

use std::fmt::Write;

use super::{LitScore, PictureScore, RegionScore, ViewScore};
use crate::report::csv::{line, number};
use crate::score::RoomScore;

/// A figure of a region, or a dash.
fn shown(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
}

/// Mean silhouette IoU of a view's objects; those that the run lacks count as 0.
pub(crate) fn mean_iou(view: &ViewScore) -> Option<f64> {
    let n = view.objects.len();
    (n > 0).then(|| view.objects.iter().map(|o| o.iou).sum::<f64>() / n as f64)
}

/// Median depth error of a view's objects, metres.
fn depth_m(view: &ViewScore) -> Option<f64> {
    let apart: Vec<f64> = view.objects.iter().filter_map(|o| o.depth_m).collect();
    (!apart.is_empty()).then(|| crate::summary::quantile(&apart, 0.5))
}

/// A line a view for a terminal.
pub fn text(rooms: &[RoomScore]) -> String {
    let mut out = format!(
        "{:<24} {:<5} {:>7} {:>7} {:>6} {:>6} | {:>5} {:>7} {:>6} {:>6} | {:>7} {:>6} {:>6} | {:>5} {:>7} {:>8}\n",
        "room",
        "view",
        "PL",
        "gain",
        "SSIM",
        "LPIPS",
        "seen",
        "PL",
        "SSIM",
        "LPIPS",
        "unseen",
        "SSIM",
        "LPIPS",
        "IoU",
        "depth",
        "nothing"
    );
    for room in rooms {
        if let Some(lit) = &room.lit {
            lit_line(&mut out, &room.case(), "photo", lit);
        }
        for view in &room.views {
            let p = &view.flat;
            let of = |r: Option<&RegionScore>, f: fn(&RegionScore) -> Option<f64>, digits: usize| {
                shown(r.and_then(f), digits)
            };
            let (pl, ssim, lpips) = (|r: &RegionScore| Some(r.pl), |r: &RegionScore| r.ssim, |r: &RegionScore| r.lpips);
            let (seen, unseen) = (p.seen.as_ref(), p.unseen.as_ref());
            let _ = writeln!(
                out,
                "{:<24} {:<5} {:>7.4} {:>7.4} {:>6} {:>6} | {:>5} {:>7} {:>6} {:>6} | {:>7} {:>6} {:>6} | {:>5} {:>5} m \
                 {:>6.2} %",
                room.case(),
                view.view,
                p.all.pl,
                p.pl_gain,
                of(Some(&p.all), ssim, 3),
                of(Some(&p.all), lpips, 3),
                of(seen, |r| Some(r.share), 2),
                of(seen, pl, 4),
                of(seen, ssim, 3),
                of(seen, lpips, 3),
                of(unseen, pl, 4),
                of(unseen, ssim, 3),
                of(unseen, lpips, 3),
                shown(mean_iou(view), 3),
                shown(depth_m(view), 3),
                100.0 * view.nothing,
            );
            if let Some(lit) = &view.lit {
                lit_line(&mut out, &room.case(), &view.view, lit);
            }
        }
    }
    out
}

fn lit_line(out: &mut String, case: &str, view: &str, lit: &LitScore) {
    let part = |r: &Option<RegionScore>| shown(r.as_ref().map(|r| r.pl), 4);
    let _ = writeln!(
        out,
        "{case:<24} {view:<5} lit: PL {:.4} (flat {:.4}), SSIM {}, seen {}, unseen {}, luminance {:.2} stops off ({:+.2})",
        lit.lit.all.pl,
        lit.flat_pl,
        shown(lit.lit.all.ssim, 3),
        part(&lit.lit.seen),
        part(&lit.lit.unseen),
        lit.stops,
        lit.stops_bias,
    );
}

/// `views.csv`: a line a view, look and region; the photo's own view has a lit picture alone.
pub fn csv(rooms: &[RoomScore]) -> String {
    let head = [
        "room",
        "seed",
        "view",
        "look",
        "region",
        "share",
        "pl",
        "ssim",
        "lpips",
        "pl_gain",
        "nothing",
        "iou",
        "depth_m",
        "flat_pl",
        "stops",
        "stops_bias",
    ];
    let mut out = line(head.map(str::to_owned));
    let optional = |v: Option<f64>| v.map_or_else(String::new, number);
    for room in rooms {
        let seed = room.seed.map_or_else(String::new, |s| s.to_string());
        let mut rows = |view: &str, look: &str, p: &PictureScore, of: Option<&ViewScore>, lit: Option<&LitScore>| {
            for (region, r) in [("all", Some(&p.all)), ("seen", p.seen.as_ref()), ("unseen", p.unseen.as_ref())] {
                let Some(r) = r else { continue };
                let whole = region == "all";
                let of = of.filter(|_| whole);
                let lit = lit.filter(|_| whole);
                out.push_str(&line([
                    room.room.clone(),
                    seed.clone(),
                    view.to_owned(),
                    look.to_owned(),
                    region.to_owned(),
                    number(r.share),
                    number(r.pl),
                    optional(r.ssim),
                    optional(r.lpips),
                    optional(whole.then_some(p.pl_gain)),
                    optional(of.map(|v| v.nothing)),
                    optional(of.and_then(mean_iou)),
                    optional(of.and_then(depth_m)),
                    optional(lit.map(|l| l.flat_pl)),
                    optional(lit.map(|l| l.stops)),
                    optional(lit.map(|l| l.stops_bias)),
                ]));
            }
        };
        if let Some(lit) = &room.lit {
            rows("photo", "lit", &lit.lit, None, Some(lit));
        }
        for view in &room.views {
            rows(&view.view, "flat", &view.flat, Some(view), None);
            if let Some(lit) = &view.lit {
                rows(&view.view, "lit", &lit.lit, None, Some(lit));
            }
        }
    }
    out
}
