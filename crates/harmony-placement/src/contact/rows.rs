//! Rows at a wall: what stands side by side and is together longer than its place.

use std::collections::BTreeMap;

use harmony_scene::{ObjectId, Vec3, Wall};

use super::collision::collisions;
use crate::scene::attachment::{Attachment, attachment_of, reach};
use crate::{PartialScene, PlacementSettings};

/// Most that a member of a row gives of its width, and what is left between two of them, metres.
const MAX_NARROWED: f64 = 0.2;
const SEAM: f64 = 5e-4;

/// Makes narrower what stands side by side at a wall and is still in one another after everything was brought apart: a
/// row of cupboards whose sizes, each a little off, are together longer than their wall. Tells which, and by what share.
///
/// Like the parting that comes before it this is the projection onto contact and no hypothesis: rigid things are not in one
/// another whatever a mask says, so that the rule of `accept` is not asked. What bounds it is [`MAX_NARROWED`].
pub(crate) fn narrow_rows(scene: &mut PartialScene, settings: &PlacementSettings) -> Vec<(ObjectId, f64)> {
    let mut narrowed: BTreeMap<usize, f64> = BTreeMap::new();
    for collision in collisions(scene, settings) {
        let (Some(a), Some(b)) = (scene.position(&collision.a), scene.position(&collision.b)) else { continue };
        let (Attachment::AgainstWall(wall), Attachment::AgainstWall(other)) =
            (attachment_of(scene, a, &settings.noise), attachment_of(scene, b, &settings.noise))
        else {
            continue;
        };
        let (span_a, span_b) = (along(scene, a, wall.wall), along(scene, b, wall.wall));
        let overlap = span_a[1].min(span_b[1]) - span_a[0].max(span_b[0]);
        let a_first = span_a[0] + span_a[1] < span_b[0] + span_b[1];
        let shares = [(a, span_a, a_first), (b, span_b, !a_first)].map(|(object, span, first)| {
            let taken = (overlap / 2.0 + SEAM) / (span[1] - span[0]);
            (object, taken, if first { -1.0 } else { 1.0 })
        });
        let total = |(object, taken, _): &(usize, f64, f64)| narrowed.get(object).unwrap_or(&0.0) + taken;
        if wall != other || overlap <= 0.0 || shares.iter().any(|share| total(share) > MAX_NARROWED) {
            continue;
        }
        for (object, taken, side) in shares {
            let pose = &mut scene.placed[object].pose;
            // What the wall's axis is to the room, the width is to the object.
            pose.stretch.x *= 1.0 - taken;
            pose.position += axis(wall.wall) * side * (overlap / 2.0 + SEAM) / 2.0;
            *narrowed.entry(object).or_default() += taken;
        }
    }
    narrowed.into_iter().map(|(object, share)| (scene.placed[object].item.id.clone(), share)).collect()
}

/// The room axis along a wall.
pub(crate) fn axis(wall: Wall) -> Vec3 {
    if wall.normal().x.abs() > 0.5 { Vec3::Z } else { Vec3::X }
}

/// From where to where an object reaches along a wall's axis, metres.
pub(crate) fn along(scene: &PartialScene, object: usize, wall: Wall) -> [f64; 2] {
    let p = &scene.placed[object];
    let (low, high) = reach(&p.item, &p.pose);
    let at = |v: Vec3| (p.pose.position + v).dot(axis(wall));
    [at(low), at(high)]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn a_row_of_cupboards_that_is_longer_than_its_place_is_made_narrower() {
        let settings = PlacementSettings::default();
        let mut scene = empty_room();
        let row = [("a_01", 1.0), ("b_01", 1.55), ("c_01", 2.1)];
        for (name, x) in row {
            add(&mut scene, name, Vec3::new(0.6, 0.9, 0.6), Vec3::new(x, 0.0, 0.301), |p| {
                Arc::make_mut(&mut p.item).relations.wall_affinity = Wall::Back.into();
            });
        }
        // Another is in one of them, and not at the wall.
        add(&mut scene, "d_01", Vec3::new(0.6, 0.9, 0.6), Vec3::new(2.3, 0.0, 0.85), |_| {});
        let narrowed = narrow_rows(&mut scene, &settings);
        assert_eq!(narrowed.iter().map(|(id, _)| id.as_str()).collect::<Vec<_>>(), ["a_01", "b_01", "c_01"]);
        let left = collisions(&scene, &settings);
        assert_eq!(left.iter().map(|c| (c.a.as_str(), c.b.as_str())).collect::<Vec<_>>(), [("c_01", "d_01")]);
        // The middle one gave half of both overlaps, the outer sides of the row stay.
        let spans = [0, 1, 2].map(|i| along(&scene, i, Wall::Back));
        assert!((spans[0][0] - 0.7).abs() < 1e-6 && (spans[2][1] - 2.4).abs() < 1e-6, "{spans:?}");
        assert!((spans[1][1] - spans[1][0] - 0.549).abs() < 1e-6, "{spans:?}");
        // Half of a width is no error of a size.
        scene.placed[1].pose.position.x = 1.2;
        assert_eq!(narrow_rows(&mut scene, &settings), []);
    }
}
