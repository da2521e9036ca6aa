//! Openings of a layout answer, and rounded tops, measured. Beyond the paper, whose openings are rectangles around
//! objects. Key `layout.openings`.
//!
//! Passages, openings without a leaf, and windows are outlined in the photo. The outline's rays on the plane that the photo shows
//! beside it give where it is; what ends near the floor goes down to it, and what the picture cuts is as large as was
//! said. Whether a top is rounded follows from heights along it: of straight tops and arcs of circles the one that fits
//! best, an arc only where it fits clearly better.

use harmony_scene::{Camera, Opening, OpeningKind, Room, Vec2, Wall, WallPlane};

use crate::stats::median;

/// A passage or a window as a layout answer gives it.
#[derive(Debug, Clone, PartialEq)]
pub struct OpeningHint {
    /// A passage is a door without a leaf.
    pub kind: OpeningKind,
    /// The wall that it is in.
    pub wall: Wall,
    /// Outline in the photo, pixels of the camera's image.
    pub face: Vec<Vec2>,
    /// How far its top is rounded, metres; used where the outline does not tell.
    pub rise: f64,
    /// Its width and height, metres; used where the picture's border cuts it.
    pub size: Vec2,
}

/// Openings smaller than this are none, metres.
const SMALLEST: f64 = 0.3;
/// A lower end this near to the floor is there, metres.
const AT_FLOOR: f64 = 0.25;
/// Points this near to the picture's border, as a share of its longer side, are where it is cut.
const AT_BORDER: f64 = 0.01;
/// Corners this near to a side's end are on that side, metres.
const AT_END: f64 = 0.02;
/// Points this far beyond and within the outline, as a share of its size, show the wall that it is cut into.
const BESIDE: f64 = 0.08;
/// Heights taken along a top.
const SAMPLES: usize = 21;
/// An arc is believed from this rise on, share of the width.
const MIN_RISE: f64 = 0.06;
/// An arc's median error is at most this share of the straight top's.
const CLEARLY: f64 = 0.5;

/// Openings of a layout answer in a room, and what was not believed, in words.
pub fn measure_openings(hints: &[OpeningHint], camera: &Camera, room: &Room) -> (Vec<Opening>, Vec<String>) {
    let (mut out, mut notes) = (Vec::new(), Vec::new());
    for hint in hints {
        if let Some(opening) = opening(hint, camera, room) {
            out.push(opening);
        } else {
            let what = if hint.kind == OpeningKind::Window { "window" } else { "passage" };
            notes.push(format!("a {what} in the {:?} wall is not where its outline is; left out", hint.wall));
        }
    }
    (out, notes)
}

fn opening(hint: &OpeningHint, camera: &Camera, room: &Room) -> Option<Opening> {
    let e = &room.extents;
    let plane = plane_of(hint, camera, room)?;
    let placed: Vec<(Vec2, Vec2)> =
        hint.face.iter().filter_map(|p| Some((*p, on_plane(plane, camera, room, *p)?))).collect();
    let corners: Vec<Vec2> = placed.iter().map(|(_, corner)| *corner).collect();
    if corners.len() < 3 {
        return None;
    }
    let (mut low, mut high) = corners.iter().fold((Vec2::MAX, Vec2::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
    let ends_at_border = |at_end: &dyn Fn(&Vec2) -> bool| {
        placed.iter().any(|(pixel, corner)| at_end(corner) && is_at_border(camera, *pixel))
    };
    let cut = [ends_at_border(&|c| c.x < low.x + AT_END), ends_at_border(&|c| c.x > high.x - AT_END)];
    match cut {
        [true, false] => low.x = low.x.min(high.x - hint.size.x),
        [false, true] => high.x = high.x.max(low.x + hint.size.x),
        _ => {}
    }
    if ends_at_border(&|c| c.y > high.y - AT_END) {
        high.y = high.y.max(hint.size.y);
    }
    let u = [low.x.max(0.0), high.x.min(plane.wall.length(e))];
    let at_floor = hint.kind == OpeningKind::Door && low.y < AT_FLOOR;
    let y = [if at_floor { 0.0 } else { low.y.max(0.0) }, high.y.min(e.height)];
    if u[1] - u[0] < SMALLEST || y[1] - y[0] < SMALLEST {
        return None;
    }
    let outlined = rise_of(&tops(&corners, u), u);
    let rise = if corners.len() > 4 { outlined } else { hint.rise.max(0.0) };
    Some(Opening { kind: hint.kind, wall: plane.wall, u, y, inset: plane.inset, rise, object: None })
}

fn is_at_border(camera: &Camera, pixel: Vec2) -> bool {
    let size = Vec2::new(f64::from(camera.size.width), f64::from(camera.size.height));
    let near = AT_BORDER * size.max_element();
    pixel.cmple(Vec2::splat(near)).any() || pixel.cmpge(size - near).any()
}

/// The plane, looking as the named wall does, that most rays in the outline and just outside it meet: a window that fills the
/// back of a recess has the wall's face around it, and is not there.
fn plane_of(hint: &OpeningHint, camera: &Camera, room: &Room) -> Option<WallPlane> {
    let n = hint.face.len();
    if n < 3 {
        return None;
    }
    let middle = hint.face.iter().sum::<Vec2>() / n as f64;
    let faces = room.faces();
    let probes = (0..n).flat_map(|i| {
        let (a, b) = (hint.face[i], hint.face[(i + 1) % n]);
        let on_edge = [0.25, 0.5, 0.75].map(|t| a.lerp(b, t) - middle);
        on_edge.into_iter().flat_map(move |p| [1.0 + BESIDE, 1.0 - BESIDE, 0.5].map(|far| middle + p * far))
    });
    let met: Vec<f64> = probes
        .filter(|p| camera.contains(*p))
        .filter_map(|p| faces.hit_plane(&camera.ray(p)))
        .filter(|p| p.wall == hint.wall)
        .map(|p| p.inset)
        .collect();
    let inset = median(&met).or_else(|| room.planes(hint.wall).first().map(|p| p.inset))?;
    Some(WallPlane { wall: hint.wall, inset })
}

/// Where a pixel's ray meets a plane, before the camera.
fn on_plane(plane: WallPlane, camera: &Camera, room: &Room, pixel: Vec2) -> Option<Vec2> {
    let ray = camera.ray(pixel);
    let k = plane.distance(&room.extents, ray.origin) / -ray.direction.dot(plane.normal());
    (k.is_finite() && k > 0.05).then(|| plane.coordinates(ray.at(k)))
}

/// Heights of an outline's upper side at places along it.
fn tops(outline: &[Vec2], u: [f64; 2]) -> Vec<Vec2> {
    let n = outline.len();
    let at = |k: usize| u[0] + (u[1] - u[0]) * (k as f64 + 0.5) / SAMPLES as f64;
    (0..SAMPLES)
        .filter_map(|k| {
            let x = at(k);
            let crossing = |i: usize| {
                let (a, b) = (outline[i], outline[(i + 1) % n]);
                let share = (x - a.x) / (b.x - a.x);
                (share.is_finite() && (0.0..=1.0).contains(&share)).then_some(a.y + (b.y - a.y) * share)
            };
            (0..n).filter_map(crossing).max_by(f64::total_cmp).map(|y| Vec2::new(x, y))
        })
        .collect()
}

/// How far a top is rounded, metres, from points `(u, height)` along it; 0 when it is straight, or nothing clear.
///
/// The arc ends at `u`. Errors count by their median, so that what hides a part of the top does not decide.
pub fn rise_of(tops: &[Vec2], u: [f64; 2]) -> f64 {
    let half = (u[1] - u[0]) / 2.0;
    let middle = f64::midpoint(u[0], u[1]);
    let inner: Vec<Vec2> = tops.iter().copied().filter(|p| p.is_finite() && (p.x - middle).abs() < half).collect();
    if inner.len() < SAMPLES / 2 || half < 0.1 {
        return 0.0;
    }
    let error = |rise: f64| {
        let drop = |x: f64| {
            if rise <= 0.0 {
                return 0.0;
            }
            let radius = (half * half + rise * rise) / (2.0 * rise);
            radius - (radius * radius - (x - middle).powi(2)).max(0.0).sqrt()
        };
        // The height of the top itself is free: the median of what the points say.
        let heights: Vec<f64> = inner.iter().map(|p| p.y + drop(p.x)).collect();
        let top = median(&heights).unwrap_or_default();
        median(&heights.iter().map(|h| (h - top).abs()).collect::<Vec<_>>()).unwrap_or(f64::MAX)
    };
    let steps = 40;
    let best = (1..=steps)
        .map(|k| half * f64::from(k) / f64::from(steps))
        .map(|rise| (rise, error(rise)))
        .min_by(|a, b| a.1.total_cmp(&b.1));
    match best {
        Some((rise, off)) if rise > 2.0 * half * MIN_RISE && off < CLEARLY * error(0.0) => rise,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Block, Extents, ImageSize, Intrinsics, RoomShape, Vec3};

    use super::*;

    fn room(blocks: Vec<Block>) -> Room {
        Room {
            room_type: "room".into(),
            extents: Extents { width: 5.0, height: 2.6, depth: 5.0 },
            shape: RoomShape { blocks, ..RoomShape::default() },
            seen: vec![],
            openings: vec![],
            floor_texture: None,
            wall_texture: None,
        }
    }

    fn camera() -> Camera {
        let size = ImageSize::new(640, 480);
        let lens = Intrinsics::from_horizontal_fov(size, 1.3);
        Camera::looking(size, lens, Vec3::new(1.8, 1.5, 4.7), Vec3::new(0.05, -0.1, -1.0))
    }

    fn seen(opening: &Opening, room: &Room) -> OpeningHint {
        let plane = WallPlane { wall: opening.wall, inset: opening.inset };
        let project = |p: &Vec2| camera().project(plane.point(&room.extents, p.x, p.y)).unwrap();
        OpeningHint {
            kind: opening.kind,
            wall: opening.wall,
            face: opening.outline().iter().map(project).collect(),
            rise: 0.0,
            size: Vec2::ZERO,
        }
    }

    fn passage_at(wall: Wall, u: [f64; 2], inset: f64, rise: f64) -> Opening {
        Opening { kind: OpeningKind::Door, wall, u, y: [0.0, 2.1], inset, rise, object: None }
    }

    #[test]
    fn passages_are_measured_on_walls_and_on_the_face_of_a_block() {
        let corner = Block { kind: "corner".into(), min: Vec3::new(3.0, 0.0, 0.0), max: Vec3::new(5.0, 2.6, 1.6) };
        let r = room(vec![corner]);
        for truth in [
            passage_at(Wall::Back, [0.6, 1.6], 0.0, 0.0),
            passage_at(Wall::Back, [3.4, 4.4], 1.6, 0.5),
            passage_at(Wall::Left, [1.5, 2.6], 0.0, 0.3),
        ] {
            let (found, notes) = measure_openings(&[seen(&truth, &r)], &camera(), &r);
            assert!(notes.is_empty(), "{notes:?}");
            let got = &found[0];
            assert_eq!((got.wall, got.is_passage()), (truth.wall, true));
            let off = [got.u[0] - truth.u[0], got.u[1] - truth.u[1], got.y[0], got.y[1] - 2.1, got.inset - truth.inset];
            assert!(off.iter().all(|v| v.abs() < 0.02), "{got:?}");
            assert!((got.rise - truth.rise).abs() < 0.04, "{} instead of {}", got.rise, truth.rise);
        }
    }

    #[test]
    fn a_low_window_ends_where_its_outline_does_not_at_the_floor() {
        let r = room(vec![]);
        let truth =
            Opening { kind: OpeningKind::Window, y: [0.2, 1.6], ..passage_at(Wall::Back, [0.6, 1.6], 0.0, 0.0) };
        let (found, notes) = measure_openings(&[seen(&truth, &r)], &camera(), &r);
        assert!(notes.is_empty(), "{notes:?}");
        assert_eq!(found[0].kind, OpeningKind::Window);
        assert!((found[0].y[0] - 0.2).abs() < 0.02, "{:?}", found[0]);
    }

    #[test]
    fn a_window_that_fills_the_back_of_a_recess_is_there() {
        let mut recessed = room(vec![]);
        recessed.shape.niches.push(harmony_scene::Niche {
            kind: "window recess".into(),
            surface: harmony_scene::Surface::Back,
            sides: None,
            glow: None,
            min: Vec3::new(1.2, 0.9, -0.4),
            max: Vec3::new(3.0, 2.2, 0.0),
        });
        let window =
            Opening { kind: OpeningKind::Window, y: [0.92, 2.18], ..passage_at(Wall::Back, [1.22, 2.98], -0.4, 0.0) };
        let (found, notes) = measure_openings(&[seen(&window, &recessed)], &camera(), &recessed);
        assert!(notes.is_empty(), "{notes:?}");
        let found = &found[0];
        assert!((found.inset + 0.4).abs() < 1e-6, "{found:?}");
        assert!((found.u[0] - 1.22).abs() < 0.02 && (found.u[1] - 2.98).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn what_the_picture_cuts_is_as_wide_as_was_said() {
        let r = room(vec![]);
        let truth = passage_at(Wall::Left, [0.9, 3.6], 0.0, 0.0);
        let mut hint = seen(&truth, &r);
        let inside = |p: &Vec2| p.clamp(Vec2::ZERO, Vec2::new(640.0, 480.0));
        // The near jamb is outside of the picture: the outline ends at its border.
        hint.face = hint.face.iter().map(inside).collect();
        let width = |size: Vec2| {
            let (found, _) = measure_openings(&[OpeningHint { size, ..hint.clone() }], &camera(), &r);
            found[0].u[1] - found[0].u[0]
        };
        assert!(width(Vec2::ZERO) < 2.5, "{}", width(Vec2::ZERO));
        assert!((width(Vec2::new(2.7, 2.1)) - 2.7).abs() < 0.02, "{}", width(Vec2::new(2.7, 2.1)));
    }

    #[test]
    fn an_outline_that_is_on_no_such_wall_is_left_out_and_said() {
        let r = room(vec![]);
        let hint = OpeningHint {
            kind: OpeningKind::Door,
            wall: Wall::Front,
            face: vec![Vec2::ZERO, Vec2::new(9.0, 0.0), Vec2::ONE],
            rise: 0.0,
            size: Vec2::ZERO,
        };
        let (found, notes) = measure_openings(&[hint], &camera(), &r);
        assert!(found.is_empty() && notes.len() == 1);
    }

    #[test]
    fn a_straight_top_with_something_before_its_end_is_no_arch() {
        let at = |k: usize| 1.0 + (k as f64 + 0.5) / 21.0;
        let wave = |k: usize| if k.is_multiple_of(2) { 0.006 } else { -0.006 };
        let straight: Vec<Vec2> = (0..21).map(|k| Vec2::new(at(k), 2.1 + wave(k))).collect();
        assert_eq!(rise_of(&straight, [1.0, 2.0]), 0.0);
        let mut hidden = straight.clone();
        hidden[..5].iter_mut().for_each(|p| p.y -= 0.4);
        assert_eq!(rise_of(&hidden, [1.0, 2.0]), 0.0);
        // A half circle with the same roughness, and a fifth of it hidden.
        let arc = |x: f64| 2.1 - 0.5 + (0.25 - (x - 1.5_f64).powi(2)).max(0.0).sqrt();
        let mut round: Vec<Vec2> = (0..21).map(|k| Vec2::new(at(k), arc(at(k)) + wave(k))).collect();
        assert!((rise_of(&round, [1.0, 2.0]) - 0.5).abs() < 0.04, "{}", rise_of(&round, [1.0, 2.0]));
        round[14..18].iter_mut().for_each(|p| p.y -= 0.3);
        assert!((rise_of(&round, [1.0, 2.0]) - 0.5).abs() < 0.1, "{}", rise_of(&round, [1.0, 2.0]));
    }
}
