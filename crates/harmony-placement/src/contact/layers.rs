//! What hangs before what: curtains, sheers and blinds that share a stretch of wall, and other things on it that are in one
//! another.
//!
//! Their places along the wall come from masks, their distances from it from nothing: two that share a stretch would be
//! in one another. At the end of a level the one behind keeps its place and the one before it is moved off the wall, by
//! a bounded distance in metres. Who is in front is read from the photo's pixels, else from what is see-through. It
//! looks at pairs on one wall; what hangs from a ceiling is not asked.

use harmony_scene::{Pose, Vec3, Wall};

use super::collision::collisions;
use super::rows::{along, axis};
use crate::scene::attachment::{Attachment, attachment_of, reach};
use crate::scene::subtree::take_along;
use crate::{PartialScene, Placed, PlacementSettings};

/// What two things share of a wall at least to lie in layers, metres on each axis: seams and hems may touch.
const SHARED_M: f64 = 0.03;
/// Farthest that one is moved off its wall for another, metres.
const MAX_OFF_M: f64 = 0.3;
/// Points on each axis of a shared stretch at which the photo is asked whose it is.
const ASKED: u32 = 24;

/// Moves hanging things that share a stretch of wall off it, one before the other: the one whose pixels the photo has
/// there is in front, else the one that is not see-through. What else is on the wall has hanging things before it in the same
/// way, a radiator its curtain; where it is in front, the cloth gives way and it stays at its wall. What a reviewer has put
/// in its place stays there.
pub(crate) fn hang_in_layers(scene: &mut PartialScene, settings: &PlacementSettings) {
    let on_wall: Vec<(usize, Wall)> = (0..scene.placed.len())
        .filter(|i| !scene.placed[*i].item.traits.opening)
        .filter_map(|i| Some((i, wall_of(scene, i, settings)?)))
        .collect();
    for (k, (a, wall)) in on_wall.iter().enumerate() {
        for (b, other) in &on_wall[k + 1..] {
            let hangs = |i: usize| scene.placed[i].item.traits.hangs;
            if wall != other || !(hangs(*a) || hangs(*b)) {
                continue;
            }
            let goes = |i: usize| hangs(i) && !scene.placed[i].item.traits.corrected;
            if let Some((front, back)) = in_layers(scene, *a, *b, *wall).filter(|(front, _)| goes(*front)) {
                put_before(scene, front, back, *wall);
            }
        }
    }
}

/// Moves what is on a wall off it where it is still in another thing there, after both went along the wall and up as far as
/// they may: a clock hangs before its panel. The one whose pixels the photo has is in front; an opening never is.
pub(crate) fn yield_off_walls(scene: &mut PartialScene, settings: &PlacementSettings) {
    for collision in collisions(scene, settings) {
        let (Some(a), Some(b)) = (scene.position(&collision.a), scene.position(&collision.b)) else { continue };
        let (Some(wall), Some(other)) = (wall_of(scene, a, settings), wall_of(scene, b, settings)) else { continue };
        let opens = |i: usize| scene.placed[i].item.traits.opening;
        let order = match (opens(a), opens(b)) {
            (true, true) => None,
            (true, false) => Some((b, a)),
            (false, true) => Some((a, b)),
            (false, false) => in_layers(scene, a, b, wall),
        };
        if let Some((front, back)) = order.filter(|_| wall == other) {
            put_before(scene, front, back, wall);
        }
    }
}

/// The wall that an object is held by.
fn wall_of(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Option<Wall> {
    match attachment_of(scene, object, &settings.noise) {
        Attachment::OnWall(plane) => Some(plane.wall),
        _ => None,
    }
}

/// Which of two things on a wall is before the other, front first; `None` when they share no stretch of it.
fn in_layers(scene: &PartialScene, a: usize, b: usize, wall: Wall) -> Option<(usize, usize)> {
    let shared = shared(scene, a, b, wall)?;
    Some(if is_before(scene, a, b, wall, &shared) { (a, b) } else { (b, a) })
}

/// Moves an object that is in another one off their wall until it is before it, and what rests on it along.
fn put_before(scene: &mut PartialScene, front: usize, back: usize, wall: Wall) {
    let normal = wall.normal();
    let [near, far] = [front, back].map(|i| off(&scene.placed[i], normal));
    let by = far[1] - near[0];
    if by > 0.0 && near[1] > far[0] && by <= MAX_OFF_M {
        let pose = scene.placed[front].pose;
        take_along(scene, front, Pose { position: pose.position + normal * by, ..pose });
    }
}

/// From where to where a placed thing reaches along a direction, metres.
fn off(placed: &Placed, direction: Vec3) -> [f64; 2] {
    let (low, high) = reach(&placed.item, &placed.pose);
    let ends = [low, high].map(|v| (placed.pose.position + v).dot(direction));
    [ends[0].min(ends[1]), ends[0].max(ends[1])]
}

/// The stretch that two things share: along the wall, and up.
fn shared(scene: &PartialScene, a: usize, b: usize, wall: Wall) -> Option<[[f64; 2]; 2]> {
    let common = |p: [f64; 2], q: [f64; 2]| [p[0].max(q[0]), p[1].min(q[1])];
    let (along_a, along_b) = (along(scene, a, wall), along(scene, b, wall));
    let up = [a, b].map(|i| off(&scene.placed[i], Vec3::Y));
    let stretch = [common(along_a, along_b), common(up[0], up[1])];
    stretch.iter().all(|s| s[1] - s[0] > SHARED_M).then_some(stretch)
}

/// Whether the first of two hangs before the other.
fn is_before(scene: &PartialScene, a: usize, b: usize, wall: Wall, shared: &[[f64; 2]; 2]) -> bool {
    let normal = wall.normal();
    let plane = off(&scene.placed[a], normal)[1].max(off(&scene.placed[b], normal)[1]);
    let (mut own, mut others) = (0, 0);
    for (i, j) in (0..ASKED).flat_map(|i| (0..ASKED).map(move |j| (i, j))) {
        let at = |[low, high]: [f64; 2], k: u32| low + (f64::from(k) + 0.5) / f64::from(ASKED) * (high - low);
        let point = axis(wall) * at(shared[0], i) + Vec3::Y * at(shared[1], j) + normal * plane;
        let Some(pixel) = scene.camera.project(point) else { continue };
        let (x, y) = (pixel.x.floor() as i64, pixel.y.floor() as i64);
        own += u32::from(scene.placed[a].item.mask.get(x, y));
        others += u32::from(scene.placed[b].item.mask.get(x, y));
    }
    let clear = |i: usize| scene.placed[i].item.shape.is_see_through();
    if own == others { !clear(a) } else { own > others }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_scene::{Level, Support};

    use super::*;
    use crate::Traits;
    use crate::testing::{add, empty_room};

    fn curtain(scene: &mut PartialScene, name: &str, width: f64, x: f64) {
        let normal = Wall::Back.normal();
        add(scene, name, Vec3::new(width, 2.2, 0.12), Vec3::new(x, 0.1, 0.0) + normal * 0.06, |p| {
            let mut item = (*p.item).clone();
            (item.level, item.traits) = (Level::Wall, Traits { hangs: true, soft: true, ..Traits::default() });
            (p.item, p.support) = (Arc::new(item), Support::Wall { wall: Wall::Back });
        });
    }

    #[test]
    fn the_drape_that_the_photo_shows_hangs_before_the_sheer_and_neighbours_stay() {
        let settings = PlacementSettings::default();
        let mut scene = empty_room();
        curtain(&mut scene, "sheer_01", 2.0, 1.6);
        curtain(&mut scene, "drape_01", 0.6, 0.9);
        curtain(&mut scene, "drape_02", 0.6, 2.91);
        // The photo shows the sheer where no drape is.
        let drape = scene.placed[1].item.mask.clone();
        let mut sheer = (*scene.placed[0].item).clone();
        sheer.mask = sheer.mask.minus(&drape).into();
        scene.placed[0].item = Arc::new(sheer);
        hang_in_layers(&mut scene, &settings);
        let z = |i: usize| scene.placed[i].pose.position.z;
        assert!((z(0) - 0.06).abs() < 1e-6 && (z(1) - 0.18).abs() < 1e-6, "{} {}", z(0), z(1));
        assert!((z(2) - 0.06).abs() < 1e-9, "it only touches the sheer's hem");
    }

    /// A thing on the back wall, whose back is so far from it, metres.
    fn hung(scene: &mut PartialScene, name: &str, size: Vec3, [x, y, off]: [f64; 3]) {
        add(scene, name, size, Vec3::new(x, y, off + size.z / 2.0), |p| {
            let mut item = (*p.item).clone();
            item.level = Level::Wall;
            (p.item, p.support) = (Arc::new(item), Support::Wall { wall: Wall::Back });
        });
    }

    #[test]
    fn a_clock_in_a_panel_hangs_before_it_with_what_is_on_it_and_one_beside_it_stays() {
        let settings = PlacementSettings::default();
        let mut scene = empty_room();
        hung(&mut scene, "panel_01", Vec3::new(2.4, 2.0, 0.05), [2.0, 0.2, 0.002]);
        hung(&mut scene, "clock_01", Vec3::new(0.4, 0.4, 0.06), [1.8, 1.4, 0.002]);
        hung(&mut scene, "clock_02", Vec3::new(0.4, 0.4, 0.06), [3.5, 1.4, 0.002]);
        add(&mut scene, "bird_01", Vec3::new(0.1, 0.1, 0.05), Vec3::new(1.8, 1.8, 0.03), |p| {
            p.support = Support::Object { id: harmony_scene::ObjectId::new("clock_01").unwrap() };
        });
        // The photo shows the clock where both are.
        let clock = scene.placed[1].item.mask.clone();
        let mut panel = (*scene.placed[0].item).clone();
        panel.mask = panel.mask.minus(&clock).into();
        scene.placed[0].item = Arc::new(panel);
        let before: Vec<f64> = scene.placed.iter().map(|p| p.pose.position.z).collect();
        yield_off_walls(&mut scene, &settings);
        assert_eq!(collisions(&scene, &settings), vec![]);
        let moved: Vec<f64> = scene.placed.iter().zip(&before).map(|(p, z)| p.pose.position.z - z).collect();
        assert_eq!((moved[0], moved[2]), (0.0, 0.0));
        assert!((moved[1] - 0.05).abs() < 1e-6 && (moved[3] - moved[1]).abs() < 1e-9, "{moved:?}");
        let settled: Vec<_> = scene.placed.iter().map(|p| p.pose).collect();
        yield_off_walls(&mut scene, &settings);
        assert_eq!(scene.placed.iter().map(|p| p.pose).collect::<Vec<_>>(), settled, "once");
    }

    #[test]
    fn a_curtain_hangs_before_a_shelf_that_it_hides_and_leaves_one_that_is_seen_before_it() {
        let settings = PlacementSettings::default();
        let offs = |shelf_hides: bool| {
            let mut scene = empty_room();
            curtain(&mut scene, "drape_01", 0.8, 1.0);
            hung(&mut scene, "shelf_01", Vec3::new(0.8, 0.04, 0.2), [1.6, 1.2, 0.0]);
            let (hidden, seen) = if shelf_hides { (0, 1) } else { (1, 0) };
            let seen = scene.placed[seen].item.mask.clone();
            let mut item = (*scene.placed[hidden].item).clone();
            item.mask = item.mask.minus(&seen).into();
            scene.placed[hidden].item = Arc::new(item);
            hang_in_layers(&mut scene, &settings);
            [0, 1].map(|i| scene.placed[i].pose.position.z)
        };
        let [drape, shelf] = offs(false);
        assert!((drape - 0.26).abs() < 1e-6 && (shelf - 0.1).abs() < 1e-9, "{drape} {shelf}");
        let [drape, shelf] = offs(true);
        assert!((drape - 0.06).abs() < 1e-9 && (shelf - 0.1).abs() < 1e-9, "{drape} {shelf}");
    }
}
