//! The page's section on other views: figures a view, and the pictures that were compared.

use std::fmt::Write;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::page::esc;
use crate::run::PICTURES;
use crate::score::RoomScore;
use crate::summary::number;
use crate::views::{LitScore, RegionScore, ViewScore, mean_iou, picture_name};

/// Writes the section; nothing where no room has views.
pub(super) fn section(html: &mut String, rooms: &[RoomScore], out: &Path) {
    if rooms.iter().all(|r| r.views.is_empty() && r.lit.is_none()) {
        return;
    }
    html.push_str(
        "<h2>From where the photo was not taken</h2><p class=\"soft\">Flat pictures of the finished scene; seen: \
         surfaces that the room's photo shows. Lit pictures at their own size, the flat one shrunk to it.</p>\
         <div class=\"wide\"><table><tr><th>view<th>PL<th>SSIM<th>LPIPS<th>seen %<th>PL seen<th>SSIM seen<th>PL unseen\
         <th>SSIM unseen<th>IoU<th>nothing %<th>lit PL<th>flat PL there<th>lit SSIM<th>stops</tr>",
    );
    for room in rooms {
        if let Some(lit) = &room.lit {
            row(html, &format!("{}, photo", room.case()), None, Some(lit));
        }
        for view in &room.views {
            row(html, &format!("{}, {}", room.case(), view.view), Some(view), view.lit.as_ref());
        }
    }
    html.push_str("</table></div>");
    for room in rooms {
        let names = room.lit.iter().map(|_| "lit").chain(room.views.iter().map(|v| v.view.as_str()));
        for view in names {
            let name = picture_name(&room.case(), view);
            let plain = !name.contains(['/', '\\']);
            let Some(jpeg) = plain.then(|| std::fs::read(out.join(PICTURES).join(&name)).ok()).flatten() else {
                continue;
            };
            let missing: Vec<&str> = room.views.iter().find(|v| v.view == view).map_or_else(Vec::new, worst);
            let _ = write!(
                html,
                "<figure class=\"case\"><figcaption><b>{}</b>, {}: photo, flat, lit where it was made.{}</figcaption>\
                 <img alt=\"photo, flat, lit\" src=\"data:image/jpeg;base64,{}\"></figure>",
                esc(&room.case()),
                if view == "lit" { "the photo's own view".to_owned() } else { format!("view {}", esc(view)) },
                if missing.is_empty() {
                    String::new()
                } else {
                    format!(" Outlines worst: {}.", esc(&missing.join(", ")))
                },
                STANDARD.encode(jpeg),
            );
        }
    }
}

/// The three objects whose outlines agree least.
fn worst(view: &ViewScore) -> Vec<&str> {
    let mut objects: Vec<_> = view.objects.iter().filter(|o| o.iou < 0.8).collect();
    objects.sort_by(|a, b| a.iou.total_cmp(&b.iou));
    objects.into_iter().take(3).map(|o| o.truth.as_str()).collect()
}

fn row(html: &mut String, name: &str, view: Option<&ViewScore>, lit: Option<&LitScore>) {
    let cell = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), number);
    let flat = view.map(|v| &v.flat);
    let seen = flat.and_then(|f| f.seen.as_ref());
    let unseen = flat.and_then(|f| f.unseen.as_ref());
    let pl = |r: Option<&RegionScore>| cell(r.map(|r| r.pl));
    let ssim = |r: Option<&RegionScore>| cell(r.and_then(|r| r.ssim));
    let cells = [
        pl(flat.map(|f| &f.all)),
        ssim(flat.map(|f| &f.all)),
        cell(flat.and_then(|f| f.all.lpips)),
        cell(seen.map(|r| 100.0 * r.share)),
        pl(seen),
        ssim(seen),
        pl(unseen),
        ssim(unseen),
        cell(view.and_then(mean_iou)),
        cell(view.map(|v| 100.0 * v.nothing)),
        cell(lit.map(|l| l.lit.all.pl)),
        cell(lit.map(|l| l.flat_pl)),
        cell(lit.and_then(|l| l.lit.all.ssim)),
        cell(lit.map(|l| l.stops)),
    ];
    let _ = write!(html, "<tr><td>{}<td>{}</tr>", esc(name), cells.join("<td>"));
}
