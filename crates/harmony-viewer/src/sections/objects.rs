//! One card an object.

use std::fmt::Write;
use std::path::Path;

use harmony_scene::{Level, Scene, SceneObject, Support};

use crate::html::{Facts, esc, meter, warnings};
use crate::pictures::{Picture, SMALL};
use crate::{ObjectReport, ReportData};

pub(crate) fn objects(run: &Path, scene: &Scene, report: &ReportData) -> String {
    let mut out = "<h2 id=\"objects\">Objects</h2>".to_owned();
    if scene.objects.is_empty() {
        out.push_str("<p class=\"soft\">No object was placed.</p>");
    } else {
        out.push_str(
            "<div class=\"bar\"><input type=\"search\" id=\"search\" placeholder=\"Search\" aria-label=\"Search \
             objects\"><select id=\"level\" aria-label=\"Level\"><option value=\"\">All levels</option>",
        );
        for level in Level::ALL {
            let n = scene.objects.iter().filter(|o| o.level == level).count();
            if n > 0 {
                let _ = write!(out, "<option value=\"{0}\">{0} ({n})</option>", level.stage());
            }
        }
        out.push_str("</select></div><div class=\"objects\">");
        let nothing = ObjectReport::default();
        for object in &scene.objects {
            let extra = report.objects.get(&object.id).unwrap_or(&nothing);
            out.push_str(&card(run, scene, object, extra));
        }
        out.push_str("</div>");
    }
    if !report.dropped.is_empty() {
        out.push_str(
            "<h2>Looked for, not placed</h2><div class=\"card scroll\"><table><tr><th>Object</th><th>Phase</th><th>Why</th></tr>",
        );
        for d in &report.dropped {
            let _ = write!(
                out,
                "<tr><td>{}</td><td>{}</td><td>{}</td></tr>",
                esc(&d.label),
                esc(&d.phase.replace('_', " ")),
                esc(&d.reason)
            );
        }
        out.push_str("</table></div>");
    }
    out
}

fn card(run: &Path, scene: &Scene, object: &SceneObject, extra: &ObjectReport) -> String {
    let id = esc(object.id.as_str());
    let mut out = format!(
        "<article class=\"card object\" id=\"object-{id}\" data-id=\"{id}\" data-level=\"{}\" data-label=\"{}\"><div \
         class=\"top\"><div><h3>{}</h3><small>{id}</small></div><div><span class=\"chip\">{}</span></div></div>",
        object.level.stage(),
        esc(&object.label),
        esc(if object.label.is_empty() { object.id.as_str() } else { &object.label }),
        object.level.stage(),
    );
    if !object.description.is_empty() {
        let _ = write!(out, "<p>{}</p>", esc(&object.description));
    }
    let shown: String = [("photo", &extra.crop), ("completed", &extra.completed), ("mesh", &extra.mesh_view)]
        .into_iter()
        .filter_map(|(what, path)| {
            let p = Picture::read(run, path.as_deref()?, SMALL)?;
            Some(format!("<div><img src=\"{}\" alt=\"{id}, {what}\" loading=\"lazy\"><span>{what}</span></div>", p.src))
        })
        .collect();
    if !shown.is_empty() {
        let _ = write!(out, "<div class=\"pictures\">{shown}</div>");
    }
    out.push_str(&meter(Some(object.confidence.overall), &extra.confidence_because));
    out.push_str(&facts(object, extra).html("narrow"));
    out.push_str(&warnings(scene.warnings.iter().filter(|w| w.object.as_ref() == Some(&object.id)), false));
    let _ = write!(out, "<p><button type=\"button\" data-show=\"{id}\" hidden>Show in 3D</button></p></article>");
    out
}

fn facts(object: &SceneObject, extra: &ObjectReport) -> Facts {
    let mut f = Facts::default();
    let (s, p) = (&object.size, &object.pose);
    f.add("Size", &format!("{:.2} x {:.2} x {:.2} m (w, h, d)", s.width, s.height, s.depth));
    f.add("Place", &format!("{:.2}, {:.2}, {:.2} m", p.position.x, p.position.y, p.position.z));
    f.add("Turned", &format!("{:.0}°", p.yaw.to_degrees()));
    let on = match &object.support {
        Support::Floor => "the floor".to_owned(),
        Support::Ceiling => "the ceiling".to_owned(),
        Support::Wall { wall } => format!("the {} wall", wall.surface().name()),
        Support::Object { id } => id.to_string(),
        Support::Block { block } => harmony_scene::Ledge::Block(*block).id().to_string(),
        Support::Niche { niche } => harmony_scene::Ledge::Niche(*niche).id().to_string(),
    };
    f.add("Rests on", &on);
    let r = &object.relations;
    let mut relations = Vec::new();
    for (word, other) in [("in front of", &r.in_front_of), ("behind", &r.behind), ("facing", &r.facing_toward)] {
        if let Some(other) = other {
            relations.push(format!("{word} {other}"));
        }
    }
    relations.extend(r.group.iter().map(|g| format!("group {g}")));
    relations.extend(r.matched_set.iter().map(|g| format!("set {g}")));
    relations.extend(r.joined_row.iter().map(|g| format!("row {g}")));
    f.add("Relations", &relations.join(", "));
    let m = &object.material;
    let mut material = format!("{:?}, roughness {:.2}", m.category, m.pbr.roughness).to_lowercase();
    if m.pbr.metallic > 0.0 {
        let _ = write!(material, ", metallic {:.2}", m.pbr.metallic);
    }
    if m.pbr.transmission > 0.0 {
        let _ = write!(material, ", transmission {:.2}", m.pbr.transmission);
    }
    let _ = write!(material, ", {:.1} kg", m.physical.weight_kg);
    f.add("Material", &material);
    f.add("Mesh", &object.mesh_source);
    let c = &object.confidence;
    let mut evidence = Vec::new();
    evidence.extend(c.detection.map(|v| format!("detection {v:.2}")));
    evidence.extend(c.silhouette_iou.map(|v| format!("silhouette IoU {v:.2}")));
    evidence.extend(c.depth_residual_m.map(|v| format!("depth off by {v:.3} m")));
    f.add("Evidence", &evidence.join(", "));
    f.add_all(&extra.facts);
    f
}
