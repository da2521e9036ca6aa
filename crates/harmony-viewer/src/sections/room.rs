//! The room and the camera, with the evidence for them.

use harmony_scene::{Camera, OpeningKind, Scene, Surface};

use crate::html::{Facts, esc, meter};
use crate::{Evidence, ReportData};

pub(crate) fn room(scene: &Scene, report: &ReportData) -> String {
    let e = &scene.room.extents;
    let mut room = Facts::default();
    room.add("Size", &format!("{:.2} m wide, {:.2} m deep, {:.2} m high", e.width, e.depth, e.height));
    let name = |s: &Surface| s.name();
    let seen: Vec<_> = Surface::ALL.iter().filter(|s| scene.room.seen.contains(s)).map(name).collect();
    let guessed: Vec<_> = Surface::ALL.iter().filter(|s| !scene.room.seen.contains(s)).map(name).collect();
    room.add_noted("Measured", &seen.join(", "), "");
    room.add_noted("Assumed", &guessed.join(", "), "not seen in the photo");
    for opening in &scene.room.openings {
        let kind = match opening.kind {
            OpeningKind::Window => "Window",
            OpeningKind::Door => "Door",
        };
        let [u0, u1] = opening.u;
        let [y0, y1] = opening.y;
        let side = opening.wall.surface().name();
        room.add(
            kind,
            &format!("{side} wall, {:.2} m wide, {:.2} m high, {:.2} m above the floor", u1 - u0, y1 - y0, y0),
        );
    }
    for (what, texture) in [("Floor", &scene.room.floor_texture), ("Walls", &scene.room.wall_texture)] {
        if let Some(t) = texture {
            let words = [&t.color, &t.material, &t.pattern].map(|s| s.trim());
            let words: Vec<_> = words.iter().filter(|w| !w.is_empty()).copied().collect();
            room.add(what, &words.join(", "));
        }
    }
    let camera = Camera::from(&scene.camera);
    let (c, forward) = (camera.centre(), camera.forward());
    let mut facts = Facts::default();
    facts.add("Position", &format!("{:.2}, {:.2}, {:.2} m (x, y, z)", c.x, c.y, c.z));
    facts.add("Height", &format!("{:.2} m above the floor", c.y));
    let yaw = (-forward.x).atan2(-forward.z).to_degrees();
    let pitch = forward.y.clamp(-1.0, 1.0).asin().to_degrees();
    let side = if yaw >= 0.0 { "left" } else { "right" };
    let tilt = if pitch <= 0.0 { "down" } else { "up" };
    facts.add("Direction", &format!("{:.1}° to the {side}, {:.1}° {tilt}", yaw.abs(), pitch.abs()));
    facts.add("Field of view", &format!("{:.1}° across", camera.horizontal_fov().to_degrees()));
    let k = &camera.intrinsics;
    facts.add("Focal length", &format!("{:.0} px of {} x {}", k.fx, camera.size.width, camera.size.height));
    format!(
        "<h2 id=\"room\">Room and camera</h2><div class=\"two\">{}{}</div>",
        card("Room", &report.room, room),
        card("Camera", &report.camera, facts)
    )
}

fn card(title: &str, evidence: &Evidence, mut facts: Facts) -> String {
    facts.add_all(&evidence.facts);
    let method = if evidence.method.is_empty() { String::new() } else { format!("<p>{}</p>", esc(&evidence.method)) };
    format!(
        "<div class=\"card\"><h3>{title}</h3>{method}{}{}</div>",
        meter(evidence.confidence, &evidence.because),
        facts.html("")
    )
}
