//! Rows at a wall: what stands side by side and is together longer than its place, and what is built together.

use std::collections::BTreeMap;

use harmony_scene::{ObjectId, Pose, Vec3, Wall};

use super::collision::collisions;
use crate::scene::attachment::{Attachment, angle_between, attachment_of, reach};
use crate::stats::median;
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

/// Gaps of a joined row that are closed and edges of it that come into line are so far apart at most, metres: two errors of a
/// place. And the most that a side changes with it, as a share.
const MAX_APART: f64 = 0.1;
const MAX_CHANGED: f64 = 0.2;

/// Builds together what was said to be: of the members of each joined row at one wall the lower and upper edges and the fronts
/// come into line, and the gaps between neighbours are closed. Returns whether anything changed.
///
/// The members were measured one by one, each a few centimetres off; what they have in common is their mean, where those that
/// agree with their masks weigh most.
pub(crate) fn join_rows(scene: &mut PartialScene, settings: &PlacementSettings) -> bool {
    let mut rows: BTreeMap<(String, Wall, bool), Vec<usize>> = BTreeMap::new();
    for (i, p) in scene.placed.iter().enumerate() {
        let Some(name) = &p.item.relations.joined_row else { continue };
        let (wall, hangs) = match attachment_of(scene, i, &settings.noise) {
            Attachment::AgainstWall(face) => (face.wall, false),
            Attachment::OnWall(face) => (face.wall, true),
            _ => continue,
        };
        // What is turned another way has other sides along the wall.
        if angle_between(p.pose.yaw, wall.yaw()).abs() < settings.noise.yaw_square {
            rows.entry((name.clone(), wall, hangs)).or_default().push(i);
        }
    }
    let before: Vec<Pose> = scene.placed.iter().map(|p| p.pose).collect();
    for ((_, wall, hangs), mut members) in rows {
        if hangs {
            line_up(scene, &members, Vec3::NEG_Y);
        }
        line_up(scene, &members, Vec3::Y);
        line_up(scene, &members, wall.normal());
        let along = axis(wall);
        let middle = |scene: &PartialScene, i: usize| span(scene, i, along).iter().sum::<f64>();
        members.sort_by(|a, b| middle(scene, *a).total_cmp(&middle(scene, *b)));
        for pair in members.windows(2) {
            let (left, right) = (span(scene, pair[0], along), span(scene, pair[1], along));
            let gap = right[0] - left[1];
            if gap > SEAM && gap < MAX_APART {
                let seam = left[1] + gap / 2.0;
                set_end(scene, pair[0], along, seam - SEAM / 2.0);
                set_end(scene, pair[1], -along, -(seam + SEAM / 2.0));
            }
        }
    }
    scene.placed.iter().zip(before).any(|(p, before)| p.pose != before)
}

/// Brings the ends of a row's members in a direction to where those that are near their median are in the mean.
fn line_up(scene: &mut PartialScene, members: &[usize], direction: Vec3) {
    let ends: Vec<f64> = members.iter().map(|i| span(scene, *i, direction)[1]).collect();
    let median = median(&mut ends.clone());
    let near: Vec<(usize, f64)> =
        members.iter().copied().zip(ends).filter(|(_, end)| (end - median).abs() < MAX_APART).collect();
    let weight = |i: usize| scene.placed[i].evidence.silhouette_iou.unwrap_or(0.2).powi(2).max(1e-3);
    let total: f64 = near.iter().map(|(i, _)| weight(*i)).sum();
    let line = near.iter().map(|(i, end)| weight(*i) * end).sum::<f64>() / total;
    for (i, _) in near {
        set_end(scene, i, direction, line);
    }
}

/// From where to where an object reaches in a direction along one of the room's axes, metres.
fn span(scene: &PartialScene, object: usize, direction: Vec3) -> [f64; 2] {
    let p = &scene.placed[object];
    let (low, high) = reach(&p.item, &p.pose);
    let ends = [p.pose.position + low, p.pose.position + high].map(|v| v.dot(direction));
    [ends[0].min(ends[1]), ends[0].max(ends[1])]
}

/// Lengthens or shortens an object so that it ends there in a direction and as before on the other side; not when that is no
/// error of a size.
fn set_end(scene: &mut PartialScene, object: usize, direction: Vec3, end: f64) {
    let [from, to] = span(scene, object, direction);
    let factor = (end - from) / (to - from);
    if !(1e-9..=MAX_CHANGED).contains(&(factor - 1.0).abs()) {
        return;
    }
    let pose = &mut scene.placed[object].pose;
    // Its front looks away from the wall: its width lies along it.
    let side = if direction.y.abs() > 0.5 {
        &mut pose.stretch.y
    } else if direction.dot(pose.front()).abs() > 0.5 {
        &mut pose.stretch.z
    } else {
        &mut pose.stretch.x
    };
    *side *= factor;
    // The other end stays: an object's position is at its bottom, in the middle of its level sides.
    let moved = if direction.y > 0.5 {
        0.0
    } else if direction.y < -0.5 {
        end - to
    } else {
        (end - to) / 2.0
    };
    pose.position += direction * moved;
}

/// The room axis along a wall.
pub(crate) fn axis(wall: Wall) -> Vec3 {
    if wall.normal().x.abs() > 0.5 { Vec3::Z } else { Vec3::X }
}

/// From where to where an object reaches along a wall's axis, metres.
pub(crate) fn along(scene: &PartialScene, object: usize, wall: Wall) -> [f64; 2] {
    span(scene, object, axis(wall))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use harmony_scene::Support;

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

    #[test]
    fn a_joined_row_has_one_line_above_and_below_and_no_gaps() {
        let settings = PlacementSettings::default();
        let mut scene = empty_room();
        let hung = [("a_01", 1.0, 1.4, 0.7, 0.34), ("b_01", 1.63, 1.43, 0.68, 0.36), ("c_01", 2.26, 1.38, 0.74, 0.33)];
        for (name, x, y, height, depth) in hung {
            let (size, at) = (Vec3::new(0.6, height, depth), Vec3::new(x, y, depth / 2.0));
            add(&mut scene, name, size, at, |p| {
                p.support = Support::Wall { wall: Wall::Back };
                p.evidence.silhouette_iou = Some(0.9);
                Arc::make_mut(&mut p.item).relations.joined_row = Some("wall_units".to_owned());
            });
        }
        // One that hangs half a metre higher is of the row and not of its line; another row, and what is of none, stay.
        let others =
            [("d_01", 2.88, 2.0, Some("wall_units")), ("e_01", 3.5, 1.4, Some("other")), ("f_01", 0.3, 1.4, None)];
        for (name, x, y, row) in others {
            add(&mut scene, name, Vec3::new(0.6, 0.3, 0.6), Vec3::new(x, y, 0.3), |p| {
                p.support = Support::Wall { wall: Wall::Back };
                Arc::make_mut(&mut p.item).relations.joined_row = row.map(str::to_owned);
            });
        }
        assert!(join_rows(&mut scene, &settings));
        let all = |d: Vec3| [0, 1, 2].map(|i| span(&scene, i, d));
        let one = |values: [f64; 3], at: f64| values.iter().all(|v| (v - at).abs() < 1e-6);
        let (up, out, along) = (all(Vec3::Y), all(Vec3::Z), all(Vec3::X));
        assert!(one(up.map(|s| s[0]), (1.4 + 1.43 + 1.38) / 3.0), "{up:?}");
        assert!(one(up.map(|s| s[1]), (2.1 + 2.11 + 2.12) / 3.0), "{up:?}");
        assert!(one(out.map(|s| s[1]), (0.34 + 0.36 + 0.33) / 3.0) && one(out.map(|s| s[0]), 0.0), "{out:?}");
        assert!((along[0][0] - 0.7).abs() < 1e-6, "the outer side stays: {along:?}");
        for pair in along.windows(2) {
            assert!((pair[1][0] - pair[0][1] - SEAM).abs() < 1e-9, "{along:?}");
        }
        assert_eq!(span(&scene, 3, Vec3::Y)[0], 2.0);
        for i in [4, 5] {
            assert_eq!(scene.placed[i].pose.stretch, Vec3::ONE);
        }
        assert!(!join_rows(&mut scene, &settings), "once is enough");
    }
}
