//! Where the walls are cut: behind windows and doors, and for passages and windows that the layout answer outlined.

use std::sync::Arc;

use harmony_geometry::rise_of;
use harmony_mesh::Mesh;
use harmony_placement::Placed;
use harmony_scene::{Camera, Extents, Mask, Opening, OpeningKind, Pose, Room, Support, Vec2, Wall, WallPlane};

use super::beyond;
use crate::state::SceneState;

/// Openings of one wall that share more than this both ways overlap, metres.
const SHARED: f64 = 0.1;
/// A passage of which a window or a door leaves less than this share is that window or door.
const LEFT: f64 = 0.5;
/// A silhouette's top is looked for from this far above where it was fitted, metres.
const TOP_MARGIN: f64 = 0.15;
/// Steps down from there, metres.
const TOP_STEP: f64 = 0.01;
/// Places along a top.
const TOP_PLACES: usize = 25;
/// Part of a side that a window must cover there for its hole to reach so far.
const COVERED: f64 = 0.25;
/// Side of a cell in which its outline is told, metres.
const CELL: f64 = 0.01;

/// Cuts the walls for the windows and doors as they stand now, and for what the layout answer outlined, which gets its
/// picture of beyond.
pub fn open_walls(state: &mut SceneState) {
    state.partial.room.openings = openings(state);
    state.beyond = beyond(state);
}

/// [`open_walls`] where a window, a door or a passage is not where its hole is: a new picture of beyond is another scene
/// to draw.
pub fn keep_walls_open(state: &mut SceneState) {
    if openings(state) != state.partial.room.openings {
        open_walls(state);
    }
}

/// Holes that the placed windows and doors cut into the walls, and the passages and windows that the layout answer told
/// of (a window only where no placed thing is one), and those behind the camera that the sun comes in through.
fn openings(state: &SceneState) -> Vec<Opening> {
    let (camera, room) = (&state.partial.camera, &state.partial.room);
    let filled = |p: &Placed| filled(camera, room, p, state.mesh_of(&p.item.id).map(Arc::as_ref));
    let mut out: Vec<Opening> = state.partial.placed.iter().filter_map(filled).collect();
    // Measured anew: room and camera have moved a little with what was placed.
    let (told, _) = crate::phases::layout::openings(&state.layout.answer, camera, room);
    let filled = out.clone();
    for opening in told {
        if opening.kind == OpeningKind::Window && filled.iter().any(|o| meet(o, &opening)) {
            continue;
        }
        let whole = area(opening.u, opening.y);
        let left = filled.iter().fold(opening, beside);
        if area(left.u, left.y) > LEFT * whole && !out[filled.len()..].iter().any(|o| meet(o, &left)) {
            out.push(left);
        }
    }
    for unseen in &state.unseen_openings {
        if !out.iter().any(|o| meet(o, unseen)) {
            out.push(unseen.clone());
        }
    }
    out
}

/// What a window or a door leaves of a passage: the largest part beside it, or the one below it (a fanlight over an open door).
fn beside(passage: Opening, filled: &Opening) -> Opening {
    if !meet(filled, &passage) {
        return passage;
    }
    let (u, y) = (passage.u, passage.y);
    let below = Opening { y: [y[0], filled.y[0]], rise: 0.0, ..passage.clone() };
    let right = Opening { u: [filled.u[1], u[1]], ..passage.clone() };
    let left = Opening { u: [u[0], filled.u[0]], ..passage };
    let larger = |a: Opening, b: Opening| if area(b.u, b.y) > area(a.u, a.y) { b } else { a };
    larger(larger(left, right), below)
}

/// Of a rectangle; 0 where an end lies before its beginning.
fn area(u: [f64; 2], y: [f64; 2]) -> f64 {
    (u[1] - u[0]).max(0.0) * (y[1] - y[0]).max(0.0)
}

/// Whether two openings share more than a frame's width.
fn meet(a: &Opening, b: &Opening) -> bool {
    let share = |p: [f64; 2], q: [f64; 2]| p[1].min(q[1]) - p[0].max(q[0]);
    a.wall == b.wall && share(a.u, b.u) > SHARED && share(a.y, b.y) > SHARED
}

/// The hole of a window or a door.
fn filled(camera: &Camera, room: &Room, p: &Placed, mesh: Option<&Mesh>) -> Option<Opening> {
    let e = room.extents;
    let kind = harmony_catalogue::opening(&p.item.label)?;
    let Support::Wall { wall } = p.support else { return None };
    let plane = room.plane_behind(wall, p.pose.position);
    let closed = mesh.and_then(|mesh| closed_by(mesh, &p.pose, wall));
    let ([left, right], [low, high]) = closed.unwrap_or_else(|| {
        let (size, at) = (p.size(), wall.coordinates(p.pose.position));
        ([at.x - size.width / 2.0, at.x + size.width / 2.0], [at.y, at.y + size.height])
    });
    // The frame covers the wall's edge all around.
    let inset = 0.03_f64.min((right - left) * 0.1);
    let u = [(left + inset).max(0.02), (right - inset).min(wall.length(&e) - 0.02)];
    let y0 = if kind == OpeningKind::Door { 0.0 } else { (low + inset).max(0.02) };
    let y = [y0, (high - inset).min(e.height - 0.02)];
    let tops = seen_top(camera, &e, plane, &p.item.mask, u, y);
    (u[1] - u[0] > 0.1 && y[1] - y[0] > 0.1).then(|| Opening {
        kind,
        wall,
        u,
        y,
        inset: plane.inset,
        rise: rise_of(&tops, u),
        object: Some(p.item.id.clone()),
    })
}

/// Heights at which a silhouette begins, coming down along a plane from above its top, where the picture shows that.
fn seen_top(camera: &Camera, e: &Extents, plane: WallPlane, mask: &Mask, u: [f64; 2], y: [f64; 2]) -> Vec<Vec2> {
    let inside = |u: f64, y: f64| {
        let pixel = camera.project(plane.point(e, u, y)).filter(|p| camera.contains(*p))?;
        Some(mask.get(pixel.x as i64, pixel.y as i64))
    };
    let from = y[1] + TOP_MARGIN;
    let steps = ((from - y[0]) / TOP_STEP) as usize;
    (0..TOP_PLACES)
        .filter_map(|k| {
            let u = u[0] + (u[1] - u[0]) * (k as f64 + 0.5) / TOP_PLACES as f64;
            let mut heights = (0..steps).map(|i| from - i as f64 * TOP_STEP);
            // A top that the picture's edge cuts off tells nothing.
            if inside(u, from) != Some(false) {
                return None;
            }
            heights.find(|y| inside(u, *y) == Some(true)).map(|y| Vec2::new(u, y))
        })
        .collect()
}

/// What a window or door closes of its wall, along it and up, metres: its outline without sills and horns that reach past
/// the casing, behind which a hole would stay open. `None` for a mesh without area.
fn closed_by(mesh: &Mesh, pose: &Pose, wall: Wall) -> Option<([f64; 2], [f64; 2])> {
    let outline = Outline::of(mesh, pose, wall)?;
    let [columns, rows] = outline.cells;
    let (mut x, mut y) = ([0, columns], [0, rows]);
    // What the rows leave may free columns, and the other way round.
    for _ in 0..2 {
        x = trimmed(x, |k| outline.share([k, k + 1], y));
        y = trimmed(y, |k| outline.share(x, [k, k + 1]));
    }
    let at = |axis: usize, k: usize| outline.low[axis] + k as f64 * outline.cell[axis];
    Some((x.map(|k| at(0, k)), y.map(|k| at(1, k))))
}

/// A range without the ends of which little is covered.
fn trimmed([mut from, mut to]: [usize; 2], share: impl Fn(usize) -> f64) -> [usize; 2] {
    let most = (to - from) / 3;
    let (first, last) = (from, to);
    while from - first < most && share(from) < COVERED {
        from += 1;
    }
    while last - to < most && share(to - 1) < COVERED {
        to -= 1;
    }
    [from, to]
}

/// What a mesh covers of a wall, seen along the wall's normal.
struct Outline {
    low: Vec2,
    cell: Vec2,
    cells: [usize; 2],
    covered: Vec<bool>,
}

impl Outline {
    fn of(mesh: &Mesh, pose: &Pose, wall: Wall) -> Option<Self> {
        let points: Vec<Vec2> = mesh.positions.iter().map(|p| wall.coordinates(pose.point(p.as_dvec3()))).collect();
        let (low, high) = points.iter().fold((Vec2::MAX, Vec2::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
        let size = high - low;
        if !(size.is_finite() && size.min_element() > 1e-3) {
            return None;
        }
        let cells = size.to_array().map(|s| ((s / CELL) as usize).clamp(8, 400));
        let cell = size / Vec2::new(cells[0] as f64, cells[1] as f64);
        let mut covered = vec![false; cells[0] * cells[1]];
        for [a, b, c] in mesh.groups.iter().flat_map(|g| &g.triangles) {
            let corners = [a, b, c].map(|i| (points[*i as usize] - low) / cell);
            fill(&mut covered, cells, corners);
        }
        Some(Self { low, cell, cells, covered })
    }

    /// Part of a block of cells that is covered.
    fn share(&self, x: [usize; 2], y: [usize; 2]) -> f64 {
        let row = |v: usize| self.covered[v * self.cells[0]..][x[0]..x[1]].iter().filter(|c| **c).count();
        let all = (x[1] - x[0]) * (y[1] - y[0]);
        (y[0]..y[1]).map(row).sum::<usize>() as f64 / all.max(1) as f64
    }
}

/// Marks the cells whose middle lies in a triangle.
fn fill(covered: &mut [bool], [columns, rows]: [usize; 2], [a, b, c]: [Vec2; 3]) {
    let double = (b - a).perp_dot(c - a);
    if double == 0.0 {
        return;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let range =
        |l: f64, h: f64, n: usize| (l - 0.5).ceil().max(0.0) as usize..((h + 0.5).floor().max(0.0) as usize).min(n);
    for y in range(low.y, high.y, rows) {
        for x in range(low.x, high.x, columns) {
            let p = Vec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let inside = |q: Vec2, r: Vec2| (r - q).perp_dot(p - q) * double.signum() >= 0.0;
            if inside(a, b) && inside(b, c) && inside(c, a) {
                covered[y * columns + x] = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use harmony_mesh::{Group, Material};
    use harmony_scene::Vec3;

    use super::*;

    /// Boards in one plane: left, right, low, high.
    fn boards(of: &[[f64; 4]]) -> Mesh {
        let mut mesh = Mesh { materials: vec![Material::plain("board", [0.5; 3])], ..Mesh::default() };
        let mut triangles = Vec::new();
        for [l, r, b, t] in of {
            let first = mesh.positions.len() as u32;
            mesh.positions
                .extend([[*l, *b], [*r, *b], [*r, *t], [*l, *t]].map(|[x, y]| Vec3::new(x, y, 0.0).as_vec3()));
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        mesh.groups = vec![Group { material: 0, triangles }];
        mesh
    }

    fn at_back(x: f64, y: f64) -> Pose {
        Pose { position: Vec3::new(x, y, 0.0), yaw: 0.0, scale: 1.0, stretch: Vec3::ONE }
    }

    fn near(found: [f64; 2], wanted: [f64; 2]) {
        assert!((0..2).all(|k| (found[k] - wanted[k]).abs() < 0.015), "{found:?} instead of {wanted:?}");
    }

    #[test]
    fn a_sill_that_reaches_past_the_casing_widens_no_hole() {
        let mesh = boards(&[[-0.5, 0.5, 0.0, 1.2], [-0.6, 0.6, 0.0, 0.04]]);
        let (u, y) = closed_by(&mesh, &at_back(2.0, 0.9), Wall::Back).unwrap();
        near(u, [1.5, 2.5]);
        near(y, [0.9, 2.1]);
    }

    #[test]
    fn an_apron_below_and_horns_above_are_left_out_and_an_open_frame_is_not() {
        // Two stiles and two rails, a small knob above and one handle below.
        let frame = [[-0.5, -0.4, 0.0, 2.0], [0.4, 0.5, 0.0, 2.0], [-0.5, 0.5, 0.0, 0.1], [-0.5, 0.5, 1.9, 2.0]];
        let mesh = boards(&[&frame[..], &[[-0.05, 0.05, 2.0, 2.2], [-0.1, 0.1, -0.1, 0.0]]].concat());
        let (u, y) = closed_by(&mesh, &at_back(1.0, 0.1), Wall::Back).unwrap();
        near(u, [0.5, 1.5]);
        near(y, [0.1, 2.1]);
    }

    #[test]
    fn a_leaf_beside_a_passage_takes_its_own_part_and_no_more() {
        let opening = |u: [f64; 2], object: bool| Opening {
            kind: OpeningKind::Door,
            wall: Wall::Left,
            u,
            y: [0.0, 2.2],
            inset: 0.0,
            rise: 0.0,
            object: object.then(|| harmony_scene::ObjectId::new("door_01").unwrap()),
        };
        let passage = opening([2.0, 4.5], false);
        let left = |u: [f64; 2]| beside(passage.clone(), &opening(u, true)).u;
        assert_eq!(left([0.2, 2.05]), [2.0, 4.5], "a frame's width");
        assert_eq!(left([0.2, 2.25]), [2.25, 4.5]);
        assert_eq!(left([4.0, 5.0]), [2.0, 4.0]);
        assert_eq!(left([5.0, 6.0]), [2.0, 4.5]);
        let fanlight = Opening { y: [1.7, 2.2], ..opening([2.05, 4.45], true) };
        let below = beside(Opening { rise: 0.3, ..passage.clone() }, &fanlight);
        assert_eq!((below.u, below.y, below.rise), ([2.0, 4.5], [0.0, 1.7], 0.0));
        let other = Opening { wall: Wall::Back, ..opening([2.0, 4.0], true) };
        assert_eq!(beside(passage.clone(), &other), passage);
    }

    #[test]
    fn what_has_no_area_tells_nothing() {
        assert!(closed_by(&Mesh::default(), &at_back(1.0, 1.0), Wall::Back).is_none());
        assert!(closed_by(&boards(&[[0.0, 0.0, 0.0, 1.0]]), &at_back(1.0, 1.0), Wall::Back).is_none());
    }
}
