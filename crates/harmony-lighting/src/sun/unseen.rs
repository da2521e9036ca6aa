//! Openings that the photo does not show, from the patches of sun that they throw. Beyond the paper.
//!
//! Every corner of a patch, carried towards the sun, leaves through the opening: on the right wall and for the right
//! direction the patches become rectangles that lie where windows do. A thing's edge and the end of its shadow tell the
//! direction; without such a pair it is the one under which the patches are most like windows, and its height rests on
//! the usual height of a window's top.

use glam::{DVec2, DVec3};
use harmony_scene::{Camera, Opening, OpeningKind, Ray, Room, Wall};

use super::{HEIGHT_DEG, Sky};

/// What was said of the sun: places in the room, metres.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ToldSun {
    /// Outlines of patches, corner by corner.
    pub patches: Vec<Vec<DVec3>>,
    /// Places on the edge of something, each with where its shadow lies.
    pub shadows: Vec<(DVec3, DVec3)>,
}

/// Where the sun stands, and the openings that let it in.
#[derive(Debug, Clone, PartialEq)]
pub struct UnseenOpenings {
    /// Unit vector towards the sun.
    pub towards: DVec3,
    /// Windows without an object.
    pub openings: Vec<Opening>,
}

/// Steps in which directions are tried, degrees.
const STEP_DEG: f64 = 2.0;
/// Usual height of a window's top above the floor and how far it is from that, metres.
const TOP: (f64, f64) = (2.1, 0.3);
/// How much of its bounds a window's patch leaves free, as the logarithm's sigma: curtains and what stands before it cut it.
const CUT: f64 = 0.2;
/// Shadows tell the direction to so many degrees.
const SHADOW_DEG: f64 = 6.0;
/// Corners may lie so far beyond a wall's edges, metres.
const BEYOND: f64 = 0.15;
/// A window's least width and height, metres.
const LEAST: [f64; 2] = [0.2, 0.3];
/// Panes this near to each other are one window, metres.
const GAP: f64 = 0.25;

/// The openings behind the patches of sun that were told; `None` where no wall that the photo does not show explains them.
pub fn unseen_openings(room: &Room, camera: &Camera, told: &ToldSun) -> Option<UnseenOpenings> {
    let ways: Vec<DVec3> = told.shadows.iter().filter_map(|(tip, end)| (*tip - *end).try_normalize()).collect();
    let shadow = ways.iter().sum::<DVec3>().try_normalize().filter(|way| way.y > 0.0);
    let steps = |from: f64, to: f64| {
        let n = ((to - from) / STEP_DEG).floor() as usize;
        (0..=n).map(move |k| from + STEP_DEG * k as f64)
    };
    let skies = steps(0.0, 360.0 - STEP_DEG)
        .flat_map(|azimuth| steps(HEIGHT_DEG[0], HEIGHT_DEG[1]).map(move |height| Sky { azimuth, height }));
    let tried = skies.map(Sky::towards).filter_map(|towards| {
        let off = shadow.map_or(0.0, |shadow| shadow.angle_between(towards).to_degrees() / SHADOW_DEG);
        // Three sigmas from what shadows say is another sun.
        if off > 3.0 {
            return None;
        }
        let of_wall = |wall| Some((behind(room, camera, &told.patches, towards, wall)?, wall));
        let ((cost, panes), wall) = Wall::ALL.into_iter().filter_map(of_wall).min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        Some((cost + 0.5 * off * off, towards, wall, panes))
    });
    let (_, towards, wall, panes) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let window = |[low, high]: [DVec2; 2]| Opening {
        kind: OpeningKind::Window,
        wall,
        u: [low.x, high.x],
        y: [low.y, high.y],
        inset: 0.0,
        rise: 0.0,
        object: None,
    };
    Some(UnseenOpenings { towards, openings: joined(panes).into_iter().map(window).collect() })
}

/// The patches carried towards the sun onto a wall, as rectangles, and what speaks against them, nats. `None` where they do
/// not leave through that wall, or where the photo shows the wall there.
fn behind(
    room: &Room,
    camera: &Camera,
    patches: &[Vec<DVec3>],
    towards: DVec3,
    wall: Wall,
) -> Option<(f64, Vec<[DVec2; 2]>)> {
    let (e, speed) = (&room.extents, -towards.dot(wall.normal()));
    if speed < 0.05 {
        return None;
    }
    let (length, mut cost, mut panes) = (wall.length(e), 0.0, Vec::new());
    for patch in patches {
        let corners: Vec<DVec2> =
            patch.iter().map(|p| wall.coordinates(*p + towards * (wall.distance(e, *p) / speed))).collect();
        let (low, high) = corners.iter().fold((DVec2::MAX, DVec2::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
        let size = high - low;
        let fits = low.x > -BEYOND && high.x < length + BEYOND && low.y > -BEYOND && high.y < e.height + BEYOND;
        if !fits || size.x < LEAST[0] || size.y < LEAST[1] {
            return None;
        }
        let middle = low.midpoint(high);
        if is_seen(room, camera, wall.point(e, middle.x, middle.y)) {
            return None;
        }
        let filled = (area(&corners) / (size.x * size.y)).clamp(1e-3, 1.0);
        cost += 0.5 * (filled.ln() / CUT).powi(2);
        let edge = DVec2::splat(0.02);
        panes.push([low.max(edge), high.min(DVec2::new(length, e.height) - edge)]);
    }
    let top = panes.iter().map(|pane| pane[1].y).reduce(f64::max)?;
    cost += 0.5 * ((top - TOP.0) / TOP.1).powi(2);
    Some((cost, panes))
}

/// Whether the photo shows a place on a wall.
fn is_seen(room: &Room, camera: &Camera, at: DVec3) -> bool {
    let eye = camera.centre();
    let shown = camera.project(at).is_some_and(|p| camera.contains(p));
    let ray = Ray { origin: eye, direction: (at - eye).normalize_or_zero() };
    shown && room.faces().exit(&ray).is_none_or(|exit| exit.point.distance(at) < 0.1)
}

/// Of a polygon.
fn area(corners: &[DVec2]) -> f64 {
    let n = corners.len();
    (0..n).map(|i| corners[i].perp_dot(corners[(i + 1) % n])).sum::<f64>().abs() / 2.0
}

/// Rectangles, those that touch or nearly do as one.
fn joined(mut panes: Vec<[DVec2; 2]>) -> Vec<[DVec2; 2]> {
    let near = |a: &[DVec2; 2], b: &[DVec2; 2]| {
        let gap = a[0].max(b[0]) - a[1].min(b[1]);
        gap.max_element() < GAP
    };
    loop {
        let pair = (0..panes.len()).find_map(|i| (0..i).find(|j| near(&panes[i], &panes[*j])).map(|j| (i, j)));
        let Some((i, j)) = pair else { return panes };
        let other = panes.swap_remove(i);
        panes[j] = [panes[j][0].min(other[0]), panes[j][1].max(other[1])];
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Extents, ImageSize, Intrinsics, RoomShape};

    use super::*;

    fn room() -> Room {
        Room {
            room_type: "bedroom".into(),
            extents: Extents { width: 4.0, height: 2.6, depth: 5.0 },
            shape: RoomShape::default(),
            seen: vec![],
            openings: vec![],
            floor_texture: None,
            wall_texture: None,
        }
    }

    /// From near the front wall, straight at the back one.
    fn camera() -> Camera {
        let size = ImageSize::new(640, 480);
        Camera::looking(size, Intrinsics::from_horizontal_fov(size, 1.0), DVec3::new(2.0, 1.5, 4.8), DVec3::NEG_Z)
    }

    /// What a window throws onto the floor.
    fn patch(wall: Wall, u: [f64; 2], y: [f64; 2], towards: DVec3) -> Vec<DVec3> {
        [(u[0], y[0]), (u[1], y[0]), (u[1], y[1]), (u[0], y[1])]
            .map(|(u, y)| {
                let at = wall.point(&room().extents, u, y);
                at - towards * (at.y / towards.y)
            })
            .to_vec()
    }

    #[test]
    fn patches_tell_the_window_behind_the_camera_and_the_sun_with_a_shadow() {
        let towards = DVec3::new(0.35, 0.75, 1.0).normalize();
        let tip = DVec3::new(1.0, 0.8, 2.0);
        let shadows = vec![(tip, tip - towards * (tip.y / towards.y))];
        let (u, y) = ([1.0, 2.2], [0.9, 2.0]);
        let told = ToldSun { patches: vec![patch(Wall::Front, u, y, towards)], shadows };
        let found = unseen_openings(&room(), &camera(), &told).expect("a window");
        assert!(found.towards.angle_between(towards).to_degrees() < 3.0, "{:?}", found.towards);
        let [opening] = &found.openings[..] else { panic!("{found:?}") };
        assert_eq!((opening.wall, opening.kind), (Wall::Front, OpeningKind::Window));
        let off = [opening.u[0] - u[0], opening.u[1] - u[1], opening.y[0] - y[0], opening.y[1] - y[1]];
        assert!(off.iter().all(|v| v.abs() < 0.15), "{opening:?}");
    }

    #[test]
    fn without_a_shadow_windows_have_the_usual_top_and_two_panes_are_one_window() {
        let towards = DVec3::new(0.35, 0.75, 1.0).normalize();
        let panes = [[0.9, 1.5], [1.6, 2.2]].map(|u| patch(Wall::Front, u, [0.9, 2.1], towards));
        let found =
            unseen_openings(&room(), &camera(), &ToldSun { patches: panes.to_vec(), shadows: vec![] }).expect("one");
        let [opening] = &found.openings[..] else { panic!("{found:?}") };
        assert_eq!(opening.wall, Wall::Front);
        assert!((opening.y[1] - 2.1).abs() < 0.1 && (opening.u[1] - opening.u[0] - 1.3).abs() < 0.2, "{opening:?}");
        assert!(found.towards.angle_between(towards).to_degrees() < 6.0, "{:?}", found.towards);
    }

    #[test]
    fn a_wall_that_the_photo_shows_has_no_window_that_it_does_not_show() {
        // As if the sun came in through the back wall, where there is none.
        let towards = DVec3::new(0.1, 0.75, -1.0).normalize();
        let tip = DVec3::new(1.0, 0.8, 2.0);
        let shadows = vec![(tip, tip - towards * (tip.y / towards.y))];
        let told = ToldSun { patches: vec![patch(Wall::Back, [1.0, 2.2], [0.9, 2.0], towards)], shadows };
        assert_eq!(unseen_openings(&room(), &camera(), &told), None);
    }
}
