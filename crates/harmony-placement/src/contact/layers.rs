//! What hangs before what: curtains, sheers and blinds that share a stretch of wall.
//!
//! Their places along the wall come from masks, their distances from it from nothing: two that share a stretch would be
//! in one another. At the end of a level the one behind keeps its place and the one before it is moved off the wall, by
//! a bounded distance in metres. Who is in front is read from the photo's pixels, else from what is see-through. It
//! looks at pairs on one wall; what hangs from a ceiling is not asked.

use harmony_scene::{Vec3, Wall};

use super::rows::{along, axis};
use crate::scene::attachment::{Attachment, attachment_of, reach};
use crate::{PartialScene, Placed, PlacementSettings};

/// What two hanging things share of a wall at least to lie in layers, metres on each axis: seams and hems may touch.
const SHARED_M: f64 = 0.03;
/// Farthest that one is moved off its wall for another, metres.
const MAX_OFF_M: f64 = 0.3;
/// Points on each axis of a shared stretch at which the photo is asked whose it is.
const ASKED: u32 = 24;

/// Moves hanging things that share a stretch of wall off it, one before the other: the one whose pixels the photo has
/// there is in front, else the one that is not see-through.
pub(crate) fn hang_in_layers(scene: &mut PartialScene, settings: &PlacementSettings) {
    let hanging: Vec<(usize, Wall)> = (0..scene.placed.len())
        .filter(|i| scene.placed[*i].item.traits.hangs)
        .filter_map(|i| match attachment_of(scene, i, &settings.noise) {
            Attachment::OnWall(plane) => Some((i, plane.wall)),
            _ => None,
        })
        .collect();
    for (k, (a, wall)) in hanging.iter().enumerate() {
        for (b, other) in &hanging[k + 1..] {
            let Some(shared) = (wall == other).then(|| shared(scene, *a, *b, *wall)).flatten() else { continue };
            let (front, back) = if is_before(scene, *a, *b, *wall, &shared) { (*a, *b) } else { (*b, *a) };
            let normal = wall.normal();
            let [near, far] = [front, back].map(|i| off(&scene.placed[i], normal));
            let by = far[1] - near[0];
            if by > 0.0 && near[1] > far[0] && by <= MAX_OFF_M {
                scene.placed[front].pose.position += normal * by;
            }
        }
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
}
