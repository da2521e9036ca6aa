//! The four walls seen from inside, with what stands and hangs before them.
//!
//! Drawing frame: x to the viewer's right along the wall, y up from the floor, each wall at its place on the sheet.

use glam::DVec2;
use harmony_scene::{Level, OpeningKind, Slope, Support, Wall, clipped};

use super::drawing::{Anchor, Drawing, Layer, Shape};
use super::floor::{DOUBLE_M, WALL_M, begins_left, strokes};
use super::labels::{Rect, Wanted, place};
use super::outline::{Drawn, drawn, visible};
use super::page;
use super::schedule::Row;
use crate::World;
use crate::world::Item;

/// Things nearer to a wall than this are drawn before it, metres.
const NEAR_M: f64 = 0.6;
/// Room for dimensions beside each wall, above it, and below it with its name, millimetres.
const BESIDE_MM: f64 = 22.0;
const ABOVE_MM: f64 = 6.0;
const BELOW_MM: f64 = 32.0;

/// The sheet of four walls.
pub(crate) fn elevations(world: &World, rows: &[Row]) -> Drawing {
    let e = world.scene.room.extents;
    let (left, low) = (page::EDGE_MM, page::EDGE_MM + page::TITLE_MM);
    let cell = (page::PAPER_MM - DVec2::new(left, low) - page::EDGE_MM) / 2.0;
    let largest = DVec2::new(e.width.max(e.depth), e.height);
    let scale = page::scale_for(largest, cell - DVec2::new(2.0 * BESIDE_MM, ABOVE_MM + BELOW_MM));
    let mut drawing = page::sheet("Wall elevations", scale, DVec2::ZERO);
    for (k, wall) in Wall::ALL.into_iter().enumerate() {
        let corner = DVec2::new(left + cell.x * (k % 2) as f64, low + cell.y * (1 - k / 2) as f64);
        let size = DVec2::new(wall.length(&e), e.height);
        let floor = page::at(&drawing, corner.x + cell.x / 2.0, corner.y + BELOW_MM);
        let spare = ((cell.y - ABOVE_MM - BELOW_MM) / 1000.0 * scale - size.y).max(0.0);
        let origin = floor + DVec2::new(-size.x / 2.0, spare / 2.0);
        let frame = Rect {
            low: page::at(&drawing, corner.x + 1.0, corner.y + 1.0),
            high: page::at(&drawing, corner.x + cell.x - 1.0, corner.y + cell.y - 1.0),
        };
        elevation(&mut drawing, world, rows, wall, origin, frame);
    }
    let bar = page::at(&drawing, page::EDGE_MM + 8.0, page::EDGE_MM + 6.0);
    page::scale_bar(&mut drawing, bar);
    let notes = [
        format!("Drawn: what is less than {NEAR_M} m before the wall"),
        "Numbers as in the floor plan".to_owned(),
        "Dashed lines of a door meet at its hinge".to_owned(),
    ];
    page::title(&mut drawing, world, "Elevations", &notes);
    drawing
}

/// Place along the wall from the viewer's left, of the wall's own coordinate.
fn across(wall: Wall, length: f64, u: f64) -> f64 {
    if begins_left(wall) { u } else { length - u }
}

fn belongs(world: &World, wall: Wall, item: &Item) -> bool {
    let o = &item.object;
    if o.level == Level::Ceiling {
        return false;
    }
    match &o.support {
        Support::Wall { wall: on } => return *on == wall,
        Support::Object { id } => {
            return world.item(id).is_some_and(|host| host.object.id != o.id && before(world, wall, host));
        }
        Support::Floor | Support::Ceiling | Support::Block { .. } | Support::Niche { .. } => {}
    }
    before(world, wall, item)
}

fn before(world: &World, wall: Wall, item: &Item) -> bool {
    let e = &world.scene.room.extents;
    if let Support::Wall { wall: on } = &item.object.support {
        return *on == wall;
    }
    let b = item.room_bounds();
    let nearest = wall.distance(e, b.min).min(wall.distance(e, b.max));
    nearest < NEAR_M && item.object.support == Support::Floor && b.size().y > 0.05
}

fn elevation(drawing: &mut Drawing, world: &World, rows: &[Row], wall: Wall, origin: DVec2, frame: Rect) {
    let e = world.scene.room.extents;
    let length = wall.length(&e);
    let at = |x: f64, y: f64| origin + DVec2::new(x, y);
    let measured = world.scene.room.seen.contains(&wall.surface());
    let things: Vec<Drawn> = rows
        .iter()
        .enumerate()
        .filter(|(_, row)| belongs(world, wall, &world.items[row.item]))
        .map(|(n, row)| {
            let item = &world.items[row.item];
            let pose = item.object.pose;
            drawn(n, &item.mesh, &move |p| {
                let room = pose.point(p);
                let c = wall.coordinates(room);
                (origin + DVec2::new(across(wall, length, c.x), c.y), wall.distance(&e, room))
            })
        })
        .collect();
    // The room's section: floor, walls and ceiling cut.
    let room = &world.scene.room;
    let section = [(0.0, 0.0), (length, 0.0), (length, e.height), (0.0, e.height)];
    let section = section.map(|(u, y)| wall.point(&e, u, y)).to_vec();
    let under = |polygon: Vec<glam::DVec3>, slope: &Slope| clipped(&polygon, |p| slope.below(&e, p));
    let section = room.shape.slopes.iter().filter(|s| s.wall != wall).fold(section, under);
    let drawn_at = |p: &glam::DVec3| {
        let c = wall.coordinates(*p);
        at(across(wall, length, c.x), c.y)
    };
    let layer = if measured { Layer::Walls } else { Layer::WallsAssumed };
    drawing.closed(layer, &section.iter().map(drawn_at).collect::<Vec<_>>());
    // Faces of blocks and niches that look the same way, and what comes down to the wall.
    for face in room.faces().all().iter().filter(|f| f.normal.dot(wall.normal()) > 0.1) {
        if face.plane(&e).is_none_or(|p| p.inset.abs() > 0.01) {
            drawing.closed(Layer::Details, &face.polygon.iter().map(drawn_at).collect::<Vec<_>>());
        }
    }
    let ground = [at(-3.0 * WALL_M, 0.0), at(length + 3.0 * WALL_M, 0.0)];
    drawing.line(Layer::Walls, &ground).width_mm = Some(0.7);
    for opening in world.scene.room.openings.iter().filter(|o| o.wall == wall) {
        let (mut a, mut b) = (across(wall, length, opening.u[0]), across(wall, length, opening.u[1]));
        if a > b {
            std::mem::swap(&mut a, &mut b);
        }
        let [low, high] = opening.y;
        let outline = opening.outline();
        let outline: Vec<DVec2> = outline.iter().map(|p| at(across(wall, length, p.x), p.y)).collect();
        drawing.closed(Layer::Openings, &outline);
        if opening.kind == OpeningKind::Door && opening.object.is_some() && !super::floor::slides(world, opening) {
            let m = f64::midpoint(a, b);
            let leaves = if b - a > DOUBLE_M {
                vec![(a, m), (b, m)]
            } else {
                vec![if super::floor::hinged_left(world, opening) { (a, b) } else { (b, a) }]
            };
            for (hinge, lock) in leaves {
                let points = [at(lock, low), at(hinge, f64::midpoint(low, high)), at(lock, high)];
                let mark = drawing.line(Layer::Details, &points);
                mark.dashed = true;
            }
        }
    }
    let lines = visible(&things);
    strokes(drawing, world, rows, &lines);
    dimensions(drawing, world, wall, origin);
    let wanted: Vec<Wanted<'_>> =
        things.iter().map(|d| Wanted { number: rows[d.thing].number, name: None, outline: &d.outline }).collect();
    place(drawing, &wanted, &lines, &[], frame);
    let name = wall.surface().name();
    let said = if measured { format!("{name} wall") } else { format!("{name} wall (not in the photo: assumed)") };
    let below = origin + DVec2::new(length / 2.0, -drawing.mm(24.0));
    drawing.text(Layer::Sheet, below, 3.2, Anchor::Middle, said);
    let rule = (drawing.mm(28.0), drawing.mm(2.6));
    let ends = [below - DVec2::new(rule.0, rule.1), below + DVec2::new(rule.0, -rule.1)];
    drawing.add(Layer::Sheet, Shape::Line { points: ends.to_vec(), closed: false });
}

fn dimensions(drawing: &mut Drawing, world: &World, wall: Wall, origin: DVec2) {
    let e = world.scene.room.extents;
    let length = wall.length(&e);
    let at = |x: f64, y: f64| origin + DVec2::new(x, y);
    let (near, far) = (drawing.mm(9.0), drawing.mm(16.0));
    let mut stops = vec![0.0, length];
    let mut heights: Vec<f64> = Vec::new();
    for o in world.scene.room.openings.iter().filter(|o| o.wall == wall) {
        stops.extend(o.u.map(|u| across(wall, length, u).clamp(0.0, length)));
        heights.extend(o.y.map(|y| y.clamp(0.0, e.height)));
    }
    let chain = |mut stops: Vec<f64>| {
        stops.sort_by(f64::total_cmp);
        stops.dedup_by(|a, b| (*a - *b).abs() < 0.02);
        stops
    };
    let stops = chain(stops);
    if stops.len() > 2 {
        for pair in stops.windows(2) {
            drawing.dimension(at(pair[1], 0.0), at(pair[0], 0.0), near);
        }
    }
    let offset = if stops.len() > 2 { far } else { near };
    drawing.dimension(at(length, 0.0), at(0.0, 0.0), offset);
    drawing.dimension(at(0.0, 0.0), at(0.0, e.height), near);
    if !heights.is_empty() {
        heights.extend([0.0, e.height]);
        for pair in chain(heights).windows(2) {
            drawing.dimension(at(length, pair[1]), at(length, pair[0]), near);
        }
    }
}
