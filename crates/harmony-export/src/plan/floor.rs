//! The floor plan: seen from above, back wall up.
//!
//! Drawing frame: x = room x, y = -room z. Walls are drawn with an assumed thickness: the photo shows their inside only.

use glam::DVec2;
use harmony_scene::{Level, Opening, OpeningKind, Surface, Wall};

use super::drawing::{Anchor, Drawing, Layer, Shape};
use super::labels::{Rect, Wanted, place};
use super::outline::{Drawn, Stroke, drawn, visible};
use super::page;
use super::schedule::Row;
use crate::World;
use crate::world::{Item, Jointed};

/// Thickness that walls are drawn with, metres.
pub(crate) const WALL_M: f64 = 0.12;
/// Doors that are wider have two leaves, metres (as the door template has).
pub(crate) const DOUBLE_M: f64 = 1.25;
/// Height at which the plan is cut, metres.
const CUT_M: f64 = 1.2;
/// Fill of walls that the photo shows.
const FILL: &str = "#c8c8c8";
/// Room for dimensions around the plan, millimetres.
const AROUND_MM: f64 = 34.0;

/// A room point in the plan.
fn flat(p: glam::DVec3) -> DVec2 {
    DVec2::new(p.x, -p.z)
}

/// A wall in the plan: a place along it and outward from its inside.
struct Run<'a> {
    world: &'a World,
    wall: Wall,
    /// Of a plane before it (behind: negative), metres.
    inset: f64,
}

impl Run<'_> {
    fn at(&self, u: f64, outward: f64) -> DVec2 {
        flat(self.wall.point(&self.world.scene.room.extents, u, 0.0))
            - flat(self.wall.normal()) * (outward - self.inset)
    }

    fn measured(&self) -> bool {
        self.world.scene.room.seen.contains(&self.wall.surface())
    }

    fn openings(&self) -> Vec<&Opening> {
        let length = self.wall.length(&self.world.scene.room.extents);
        let mut all: Vec<&Opening> = self
            .world
            .scene
            .room
            .openings
            .iter()
            .filter(|o| o.wall == self.wall && o.u[1] > 0.0 && o.u[0] < length && o.u[1] - o.u[0] > 0.02)
            .collect();
        all.sort_by(|a, b| a.u[0].total_cmp(&b.u[0]));
        all
    }

    /// Where the wall itself is open: openings in its plane, and niches that are cut at the height of the plan.
    fn gaps(&self) -> Vec<[f64; 2]> {
        let niches = self
            .world
            .scene
            .room
            .shape
            .niches
            .iter()
            .filter(|n| n.surface == self.wall.surface() && cut(n.min.y, n.max.y));
        let along = niches.map(|n| [self.wall.coordinates(n.min).x, self.wall.coordinates(n.max).x]);
        let own = self.openings().into_iter().filter(|o| o.inset.abs() < 0.01).map(|o| o.u);
        let mut all: Vec<[f64; 2]> = own.chain(along).collect();
        all.sort_by(|a, b| a[0].total_cmp(&b[0]));
        all
    }
}

/// Whether the plan cuts what lies between two heights.
fn cut(low: f64, high: f64) -> bool {
    low <= CUT_M && high >= CUT_M
}

/// What makes the room other than its box: blocks filled as walls, niches in outline, where slopes reach the ceiling
/// dashed.
fn shape(drawing: &mut Drawing, world: &World) {
    let room = &world.scene.room;
    let rectangle = |min: glam::DVec3, max: glam::DVec3| {
        [(min.x, min.z), (max.x, min.z), (max.x, max.z), (min.x, max.z)].map(|(x, z)| DVec2::new(x, -z))
    };
    for block in &room.shape.blocks {
        let points = rectangle(block.min, block.max);
        if cut(block.min.y, block.max.y) {
            drawing.add(Layer::Walls, Shape::Area { points: points.to_vec(), fill: FILL });
            drawing.closed(Layer::Walls, &points);
        } else {
            drawing.closed(Layer::Details, &points);
        }
    }
    for niche in &room.shape.niches {
        let layer = if cut(niche.min.y, niche.max.y) { Layer::Openings } else { Layer::Details };
        // What lies above the cut is dashed: a tray in the ceiling.
        drawing.closed(layer, &rectangle(niche.min, niche.max)).dashed = niche.surface == Surface::Ceiling;
    }
    for slope in &room.shape.slopes {
        let run = Run { world, wall: slope.wall, inset: 0.0 };
        let length = slope.wall.length(&room.extents);
        let mark = drawing.line(Layer::Details, &[run.at(0.0, -slope.run), run.at(length, -slope.run)]);
        mark.dashed = true;
    }
}

/// Whether an opening's left end, seen from inside, is where its range begins.
pub(crate) fn begins_left(wall: Wall) -> bool {
    matches!(wall, Wall::Back | Wall::Right)
}

/// Whether a door is hinged on the left seen from inside: across from its handle where its mesh has one, else assumed.
pub(crate) fn hinged_left(world: &World, opening: &Opening) -> bool {
    let item = opening.object.as_ref().and_then(|id| world.item(id));
    match item.and_then(|i| i.opens.first()).map(|o| o.joint) {
        Some(Jointed::Hinge { pivot, .. }) => pivot.x < 0.0,
        _ => true,
    }
}

/// Whether it is said of a door that it slides.
pub(crate) fn slides(world: &World, opening: &Opening) -> bool {
    let item = opening.object.as_ref().and_then(|id| world.item(id));
    item.is_some_and(|i| harmony_catalogue::slides(&i.object.label))
}

/// The sheet.
pub(crate) fn plan(world: &World, rows: &[Row]) -> Drawing {
    let e = world.scene.room.extents;
    let room = DVec2::new(e.width, e.depth);
    let area = page::PAPER_MM - DVec2::new(2.0 * page::EDGE_MM + page::COLUMN_MM, 2.0 * page::EDGE_MM);
    let scale = page::scale_for(room + 2.0 * WALL_M, area - 2.0 * AROUND_MM);
    let middle = DVec2::new(e.width, -e.depth) / 2.0;
    let origin = middle - (DVec2::splat(page::EDGE_MM) + area / 2.0) / 1000.0 * scale;
    let mut drawing = page::sheet("Floor plan", scale, origin);
    let mut taken = Vec::new();
    for wall in Wall::ALL {
        walls(&mut drawing, &Run { world, wall, inset: 0.0 });
    }
    shape(&mut drawing, world);
    let things = things(world, rows);
    let lines = visible(&things);
    strokes(&mut drawing, world, rows, &lines);
    let mut labelled: Vec<Drawn> = things;
    labelled.extend(overhead(world, rows, &mut drawing));
    for wall in Wall::ALL {
        openings(&mut drawing, &Run { world, wall, inset: 0.0 }, &mut taken);
    }
    taken.extend(camera(&mut drawing, world));
    dimensions(&mut drawing, world);
    let at_page = |x: f64, y: f64| page::at(&drawing, x, y);
    let inside = Rect {
        low: at_page(page::EDGE_MM + 2.0, page::EDGE_MM + 2.0),
        high: at_page(page::EDGE_MM + area.x - 2.0, page::EDGE_MM + area.y - 2.0),
    };
    let (north_at, bar_at) = (
        at_page(page::EDGE_MM + 16.0, page::EDGE_MM + area.y - 16.0),
        at_page(page::EDGE_MM + 8.0, page::EDGE_MM + 6.0),
    );
    labelled.sort_by_key(|d| d.thing);
    let wanted: Vec<Wanted<'_>> = labelled
        .iter()
        .map(|d| {
            let row = &rows[d.thing];
            let large = world.items[row.item].object.level == Level::Furniture;
            Wanted { number: row.number, name: large.then_some(row.label.as_str()), outline: &d.outline }
        })
        .collect();
    place(&mut drawing, &wanted, &lines, &taken, inside);
    north(&mut drawing, world, north_at);
    page::scale_bar(&mut drawing, bar_at);
    page::list(&mut drawing, rows);
    let unseen: Vec<&str> = Wall::ALL
        .into_iter()
        .filter(|w| !Run { world, wall: *w, inset: 0.0 }.measured())
        .map(|w| w.surface().name())
        .collect();
    let walls = if unseen.is_empty() {
        "All four walls are in the photo".to_owned()
    } else {
        format!("Dashed: not in the photo, assumed ({})", unseen.join(", "))
    };
    let notes = [
        walls,
        format!("Wall thickness {:.0} mm is assumed; hinges: across from handles, else left", WALL_M * 1000.0),
        "N: direction in which the photo was taken".to_owned(),
        "+-: one sigma that the confidence implies".to_owned(),
    ];
    page::title(&mut drawing, world, "Floor plan", &notes);
    drawing
}

/// Draws what is seen of things, each on the layer of its level; what is within an outline is detail.
pub(crate) fn strokes(drawing: &mut Drawing, world: &World, rows: &[Row], lines: &[Stroke]) {
    for stroke in lines {
        let level = world.items[rows[stroke.thing].item].object.level;
        let layer = match (stroke.outer, level) {
            (false, _) => Layer::Details,
            (true, Level::Decoration) => Layer::Decoration,
            (true, Level::Wall) => Layer::WallMounted,
            (true, _) => Layer::Furniture,
        };
        let points: Vec<DVec2> = stroke.points.iter().map(|p| DVec2::from_array(*p)).collect();
        drawing.line(layer, &points);
    }
}

fn walls(drawing: &mut Drawing, run: &Run<'_>) {
    let length = run.wall.length(&run.world.scene.room.extents);
    // Back and front walls own the corners.
    let end = if matches!(run.wall, Wall::Back | Wall::Front) { WALL_M } else { 0.0 };
    let mut from = -end;
    let mut solid = Vec::new();
    for gap in run.gaps() {
        solid.push([from, gap[0].max(from)]);
        from = gap[1].max(from);
    }
    solid.push([from, length + end]);
    for [a, b] in solid.into_iter().filter(|[a, b]| b - a > 1e-4) {
        let points = [run.at(a, 0.0), run.at(b, 0.0), run.at(b, WALL_M), run.at(a, WALL_M)];
        if run.measured() {
            drawing.add(Layer::Walls, Shape::Area { points: points.to_vec(), fill: FILL });
            drawing.closed(Layer::Walls, &points);
        } else {
            drawing.closed(Layer::WallsAssumed, &points);
        }
    }
}

fn openings(drawing: &mut Drawing, run: &Run<'_>, taken: &mut Vec<Rect>) {
    for opening in run.openings() {
        let run = &Run { inset: opening.inset, ..*run };
        let [a, b] = opening.u;
        match opening.kind {
            OpeningKind::Window => {
                for outward in [0.0, WALL_M * 0.42, WALL_M * 0.58, WALL_M] {
                    let mark = drawing.line(Layer::Openings, &[run.at(a, outward), run.at(b, outward)]);
                    mark.width_mm = Some(if outward == 0.0 || outward == WALL_M { 0.3 } else { 0.18 });
                }
                let sill = WALL_M + 0.03;
                drawing.line(
                    Layer::Details,
                    &[
                        run.at(a - 0.03, WALL_M),
                        run.at(a - 0.03, sill),
                        run.at(b + 0.03, sill),
                        run.at(b + 0.03, WALL_M),
                    ],
                );
            }
            OpeningKind::Door => {
                // The threshold.
                drawing.line(Layer::Details, &[run.at(a, 0.0), run.at(b, 0.0)]);
                drawing.line(Layer::Details, &[run.at(a, WALL_M), run.at(b, WALL_M)]);
                if opening.object.is_none() {
                    continue;
                }
                if slides(run.world, opening) {
                    let m = f64::midpoint(a, b);
                    for (u, v, n) in [(a, m + 0.04, 0.35), (m - 0.04, b, 0.65)] {
                        let (low, high) = (WALL_M * (n - 0.1), WALL_M * (n + 0.1));
                        drawing.closed(
                            Layer::Openings,
                            &[run.at(u, low), run.at(v, low), run.at(v, high), run.at(u, high)],
                        );
                    }
                    continue;
                }
                let (left, right) = if begins_left(run.wall) { (a, b) } else { (b, a) };
                let single = if hinged_left(run.world, opening) { (left, right) } else { (right, left) };
                if b - a > DOUBLE_M {
                    let m = f64::midpoint(a, b);
                    leaf(drawing, run, left, m, taken);
                    leaf(drawing, run, right, m, taken);
                } else {
                    leaf(drawing, run, single.0, single.1, taken);
                }
            }
        }
    }
}

/// A door leaf hinged at one place, closing to another, drawn open into the room with its swing.
fn leaf(drawing: &mut Drawing, run: &Run<'_>, hinge: f64, lock: f64, taken: &mut Vec<Rect>) {
    let width = (lock - hinge).abs();
    let centre = run.at(hinge, 0.0);
    let into = flat(run.wall.normal());
    let along = (run.at(lock, 0.0) - centre).normalize_or(DVec2::X);
    let tip = centre + into * width;
    let thick = along * 0.04;
    drawing.closed(Layer::Openings, &[centre, tip, tip + thick, centre + thick]);
    let (i, a) = (into.y.atan2(into.x), along.y.atan2(along.x));
    // Anticlockwise from one to the other, the short way.
    let (from, to) = if (a - i).rem_euclid(std::f64::consts::TAU) < std::f64::consts::PI { (i, a) } else { (a, i) };
    let mark = drawing.add(Layer::Openings, Shape::Arc { centre, radius: width, from, to });
    mark.width_mm = Some(0.13);
    let far = centre + along * width;
    taken.push(Rect { low: centre.min(tip).min(far), high: centre.max(tip).max(far) });
}

/// What is drawn with hidden lines removed: all but what hangs above and what fills openings.
fn things(world: &World, rows: &[Row]) -> Vec<Drawn> {
    let fills = |item: &Item| world.scene.room.openings.iter().any(|o| o.object.as_ref() == Some(&item.object.id));
    rows.iter()
        .enumerate()
        .filter(|(_, row)| {
            let item = &world.items[row.item];
            !hangs_above(item) && !fills(item)
        })
        .map(|(n, row)| {
            let item = &world.items[row.item];
            let pose = item.object.pose;
            drawn(n, &item.mesh, &move |p| {
                let room = pose.point(p);
                (flat(room), room.y)
            })
        })
        .collect()
}

/// Whether a thing is above the plane that a plan is cut at: under the ceiling, or high on a wall.
fn hangs_above(item: &Item) -> bool {
    match item.object.level {
        Level::Ceiling => true,
        Level::Wall => item.room_bounds().min.y > CUT_M,
        Level::Furniture | Level::Decoration => false,
    }
}

/// What hangs above, dashed.
fn overhead(world: &World, rows: &[Row], drawing: &mut Drawing) -> Vec<Drawn> {
    let mut out = Vec::new();
    for (n, row) in rows.iter().enumerate() {
        let item = &world.items[row.item];
        if !hangs_above(item) {
            continue;
        }
        let pose = item.object.pose;
        let d = drawn(n, &item.mesh, &move |p| {
            let room = pose.point(p);
            (flat(room), room.y)
        });
        for l in &d.outline {
            let points: Vec<DVec2> = l.iter().map(|p| DVec2::from_array(*p)).collect();
            drawing.closed(Layer::Ceiling, &points);
        }
        out.push(d);
    }
    out
}

/// Direction of view in the plan.
fn view(world: &World) -> DVec2 {
    flat(world.camera.forward()).normalize_or(DVec2::Y)
}

fn camera(drawing: &mut Drawing, world: &World) -> [Rect; 1] {
    let at = flat(world.camera.centre());
    let ahead = view(world);
    let side = ahead.perp();
    let size = drawing.mm(3.0);
    let triangle = vec![at, at + ahead * size + side * size * 0.6, at + ahead * size - side * size * 0.6];
    let body = vec![
        at - side * size * 0.5,
        at + side * size * 0.5,
        at + side * size * 0.5 - ahead * size,
        at - side * size * 0.5 - ahead * size,
    ];
    drawing.add(Layer::Camera, Shape::Area { points: triangle.clone(), fill: "#b3261e" });
    drawing.closed(Layer::Camera, &triangle);
    drawing.closed(Layer::Camera, &body);
    let half = world.camera.horizontal_fov() / 2.0;
    let reach = drawing.mm(34.0);
    for turn in [half, -half] {
        let ray = DVec2::from_angle(turn).rotate(ahead);
        let mark = drawing.line(Layer::Camera, &[at + ray * size * 1.3, at + ray * reach]);
        mark.dashed = true;
    }
    let height = world.camera.centre().y;
    let text = format!("camera, {height:.2} m above the floor");
    let label = at + DVec2::new(drawing.mm(4.5), 0.0);
    drawing.text(Layer::Camera, label, 2.0, Anchor::Left, text);
    let (low, high) = (label - drawing.mm(2.0), label + DVec2::new(drawing.mm(36.0), drawing.mm(2.0)));
    let low = triangle.iter().fold(low, |a, p| a.min(*p));
    let high = triangle.iter().fold(high, |a, p| a.max(*p));
    [Rect { low, high }]
}

fn north(drawing: &mut Drawing, world: &World, at: DVec2) {
    let ahead = view(world);
    let r = drawing.mm(7.0);
    drawing.add(Layer::Sheet, Shape::Circle { centre: at, radius: r });
    let (tip, left, right) =
        (at + ahead * r, at - ahead * r * 0.7 + ahead.perp() * r * 0.5, at - ahead * r * 0.7 - ahead.perp() * r * 0.5);
    let notch = at - ahead * r * 0.35;
    drawing.add(Layer::Sheet, Shape::Area { points: vec![tip, left, notch], fill: "#111111" });
    drawing.closed(Layer::Sheet, &[tip, left, notch, right]);
    let letter = at + ahead * (r + drawing.mm(2.6));
    drawing.text(Layer::Sheet, letter, 3.0, Anchor::Middle, "N");
    let below = at - DVec2::new(0.0, r + drawing.mm(4.5));
    let turn = (-ahead.x).atan2(ahead.y).to_degrees();
    let side = if turn >= 0.0 { "left" } else { "right" };
    drawing.text(Layer::Sheet, below, 1.8, Anchor::Middle, "of the camera");
    let second = below - DVec2::new(0.0, drawing.mm(3.0));
    drawing.text(Layer::Sheet, second, 1.8, Anchor::Middle, format!("{:.1} deg {side}", turn.abs()));
}

fn dimensions(drawing: &mut Drawing, world: &World) {
    let e = world.scene.room.extents;
    let (near, far) = (WALL_M + drawing.mm(9.0), WALL_M + drawing.mm(18.0));
    for wall in Wall::ALL {
        let run = Run { world, wall, inset: 0.0 };
        let length = wall.length(&e);
        let mut stops = vec![0.0];
        for o in run.openings() {
            stops.extend(o.u.map(|u| u.clamp(0.0, length)));
        }
        stops.push(length);
        stops.dedup_by(|a, b| (*a - *b).abs() < 0.01);
        // The line lies outside: to the left of the way along the wall for the back wall, to the right for others.
        let outward = -flat(wall.normal());
        let along = (run.at(length, 0.0) - run.at(0.0, 0.0)).normalize_or(DVec2::X);
        let sign = along.perp().dot(outward).signum();
        if stops.len() > 2 {
            for pair in stops.windows(2) {
                drawing.dimension(run.at(pair[0], 0.0), run.at(pair[1], 0.0), sign * near);
            }
        }
        // The whole is said once each way.
        if matches!(wall, Wall::Back | Wall::Left) {
            let offset = if stops.len() > 2 { far } else { near };
            drawing.dimension(run.at(0.0, 0.0), run.at(length, 0.0), sign * offset);
        }
    }
}
