//! The floor plan of a home as SVG, 100 pixels a metre.
//!
//! Solid walls in dark grey, rooms with name and size, doors with their swing, furniture as the outlines of its boxes.
//! Measured drawings with hidden lines are an export (`harmony export HOME --to plan`).

use std::fmt::Write as _;

use glam::{DVec2, DVec3};
use harmony_export::world::Item;
use harmony_scene::{Level, OpeningKind, Wall};

use crate::frame::Rect;
use crate::home::Home;
use crate::layout::DoorKind;
use crate::merge::Merged;
use crate::rooms::flat;
use crate::walls::{Free, blocks};

/// Pixels a metre.
const SCALE: f64 = 100.0;
/// White around the plan, metres.
const MARGIN: f64 = 0.5;
/// Height at which the plan is cut, metres.
const CUT_M: f64 = 1.2;

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The plan, in the scene's frame: x to the right, z down.
pub fn plan_svg(home: &Home, merged: &Merged) -> String {
    let e = merged.world.scene.room.extents;
    let outer = home.outer_wall;
    let around = MARGIN + outer;
    let (width, depth) = ((e.width + 2.0 * around) * SCALE, (e.depth + 2.0 * around) * SCALE);
    let at = |p: DVec2| (p + around) * SCALE;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {depth:.0}\" font-family=\"sans-serif\">\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    let rectangle = |out: &mut String, r: &Rect, style: &str| {
        let (a, s) = (at(r.min), r.size() * SCALE);
        let _ = writeln!(
            out,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" {style}/>",
            a.x, a.y, s.x, s.y
        );
    };
    let origin = flat(merged.origin);
    let shifted = |r: &Rect| Rect { min: r.min - origin, max: r.max - origin };
    for room in &home.rooms {
        let fill = if room.run.is_some() {
            "fill=\"#f6f3ec\""
        } else {
            "fill=\"#fff\" stroke=\"#999\" stroke-dasharray=\"8 6\""
        };
        room.free().iter().for_each(|r| rectangle(&mut out, &shifted(r), fill));
    }
    let inside = Rect { min: DVec2::ZERO, max: DVec2::new(e.width, e.depth) };
    let free: Vec<Free> = home
        .rooms
        .iter()
        .flat_map(crate::home::HomeRoom::free)
        .chain(home.doors.iter().filter(|d| d.rooms.len() == 2).map(|d| d.floor(&home.rooms, outer)))
        .map(|r| Free { rect: shifted(&r), y: [0.0, CUT_M + 1.0] })
        .collect();
    for block in blocks(&inside.grown(outer), CUT_M + 1.0, &free, outer).iter().filter(|b| b.kind == "wall") {
        rectangle(&mut out, &Rect { min: flat(block.min), max: flat(block.max) }, "fill=\"#3c4048\"");
    }
    // What is low is drawn first: tables stand on rugs.
    let mut items: Vec<&Item> = merged.world.items.iter().collect();
    items.sort_by(|a, b| a.room_bounds().max.y.total_cmp(&b.room_bounds().max.y));
    for item in items {
        let o = &item.object;
        let Some(bounds) = item.mesh.bounds().filter(|_| o.level != Level::Ceiling) else { continue };
        let corner = |x: f64, z: f64| {
            let p = at(flat(o.pose.point(bounds.min + (bounds.max - bounds.min) * DVec3::new(x, 0.0, z))));
            format!("{:.1},{:.1}", p.x, p.y)
        };
        let points = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)].join(" ");
        let style = match o.level {
            Level::Furniture => "fill=\"#d9cdb8\" stroke=\"#6b5d45\" stroke-width=\"1.5\"",
            Level::Wall => "fill=\"#a9c3d6\" stroke=\"#4d6b80\"",
            _ => "fill=\"#fff\" fill-opacity=\"0.6\" stroke=\"#6b5d45\" stroke-width=\"0.7\"",
        };
        let _ = writeln!(out, "<polygon points=\"{points}\" {style}><title>{}</title></polygon>", escaped(item.name()));
    }
    for door in &home.doors {
        swing(&mut out, home, door, &|p| at(p - origin));
    }
    for opening in merged.world.scene.room.openings.iter().filter(|o| o.kind == OpeningKind::Window) {
        let face = |u: f64| flat(opening.wall.point(&e, u, 0.0) + opening.wall.normal() * opening.inset);
        let (a, b) = (at(face(opening.u[0])), at(face(opening.u[1])));
        let _ = writeln!(
            out,
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"#2a9fd6\" stroke-width=\"5\"/>",
            a.x, a.y, b.x, b.y
        );
    }
    for room in &home.rooms {
        let rect = shifted(&room.solved.rect);
        let (p, size) = (at(rect.centre()), rect.size());
        let photo = if room.run.is_some() { "" } else { ", no photo" };
        let _ = writeln!(
            out,
            "<text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"middle\" font-size=\"20\" font-weight=\"bold\" stroke=\"#fff\" \
             stroke-width=\"4\" paint-order=\"stroke\">{}</text><text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"middle\" \
             font-size=\"15\" stroke=\"#fff\" stroke-width=\"3\" paint-order=\"stroke\">{:.2} x {:.2} m, {:.1} m2{photo}</text>",
            p.x,
            p.y,
            escaped(&room.name),
            p.x,
            p.y + 20.0,
            size.x,
            size.y,
            room.free().iter().map(Rect::area).sum::<f64>()
        );
    }
    out.push_str("</svg>\n");
    out
}

/// A door's leaf, open, with the way that it swings.
fn swing(out: &mut String, home: &Home, door: &crate::home::HomeDoor, at: &dyn Fn(DVec2) -> DVec2) {
    if door.kind == DoorKind::Opening {
        return;
    }
    let face = home.rooms[door.rooms[0]].solved.rect.side(door.side);
    let [a, b] = door.range;
    let upright = matches!(door.side, Wall::Left | Wall::Right);
    let point = |u: f64, out: f64| if upright { DVec2::new(face + out, u) } else { DVec2::new(u, face + out) };
    let inward = -crate::layout::outward(door.side) * (b - a);
    let (hinge, open, shut) = (at(point(a, 0.0)), at(point(a, inward)), at(point(b, 0.0)));
    let radius = (b - a) * SCALE;
    // Counter-clockwise on the page where the way from open to shut turns left.
    let turns = (open - hinge).perp_dot(shut - hinge) > 0.0;
    let _ = writeln!(
        out,
        "<path d=\"M{:.1} {:.1} L{:.1} {:.1} A{radius:.1} {radius:.1} 0 0 {} {:.1} {:.1}\" fill=\"none\" stroke=\"#b0552f\" \
         stroke-width=\"2\"/>",
        hinge.x,
        hinge.y,
        open.x,
        open.y,
        u8::from(turns),
        shut.x,
        shut.y
    );
}
