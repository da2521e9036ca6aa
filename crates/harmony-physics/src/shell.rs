//! The room as colliders: floor, ceiling and walls as boxes outside the room's box, walls with their openings cut out.

use harmony_mesh::shell_material_name;
use harmony_scene::{Room, Surface, Vec2};

use crate::hull::Hull;

/// Thickness of floor, walls and ceiling, outward, metres. Thick enough that nothing passes through in a step.
pub const SHELL_M: f64 = 0.2;

/// Hulls of each face by the name of its node, in the room frame.
pub fn shell(room: &Room) -> Vec<(String, Vec<Hull>)> {
    Surface::ALL.into_iter().map(|s| (shell_material_name(s).to_owned(), face(room, s))).collect()
}

fn face(room: &Room, surface: Surface) -> Vec<Hull> {
    let e = &room.extents;
    let size = surface.size(e);
    // Floor and ceiling reach under and over the walls, so that no edge is open.
    let margin = if surface.wall().is_none() { Vec2::splat(SHELL_M) } else { Vec2::ZERO };
    let (low, high) = (-margin, size + margin);
    let holes: Vec<(Vec2, Vec2)> = room
        .openings
        .iter()
        .filter(|o| Some(o.wall) == surface.wall())
        .map(|o| (Vec2::new(o.u[0], o.y[0]).max(low), Vec2::new(o.u[1], o.y[1]).min(high)))
        .filter(|(a, b)| a.is_finite() && b.is_finite() && (*b - *a).min_element() > 1e-3)
        .collect();
    rectangles(low, high, &holes)
        .into_iter()
        .map(|(a, b)| {
            let (p, q) = (surface.point(e, a), surface.point(e, b));
            let out = -surface.normal() * SHELL_M;
            let (low, high) = (p.min(q), p.max(q));
            Hull::cuboid(low.min(low + out), high.max(high + out))
        })
        .collect()
}

/// A rectangle less holes as rectangles: strips between the holes' sides, each cut by the holes across it.
fn rectangles(low: Vec2, high: Vec2, holes: &[(Vec2, Vec2)]) -> Vec<(Vec2, Vec2)> {
    let mut edges: Vec<f64> = holes.iter().flat_map(|(a, b)| [a.x, b.x]).chain([low.x, high.x]).collect();
    edges.sort_by(f64::total_cmp);
    edges.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
    let mut out: Vec<(Vec2, Vec2)> = Vec::new();
    for pair in edges.windows(2) {
        let (left, right) = (pair[0], pair[1]);
        let middle = f64::midpoint(left, right);
        let mut taken: Vec<(f64, f64)> =
            holes.iter().filter(|(a, b)| a.x < middle && middle < b.x).map(|(a, b)| (a.y, b.y)).collect();
        taken.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut from = low.y;
        for (a, b) in taken.into_iter().chain([(high.y, high.y)]) {
            if a - from > 1e-3 {
                out.push((Vec2::new(left, from), Vec2::new(right, a)));
            }
            from = from.max(b);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::room;
    use harmony_scene::{Opening, OpeningKind, Vec3, Wall};

    fn inside(hulls: &[Hull], p: Vec3) -> bool {
        hulls.iter().any(|h| h.outside(p) < 0.0)
    }

    #[test]
    fn openings_are_open_and_the_rest_is_wall() {
        let mut room = room();
        room.openings = vec![
            Opening { kind: OpeningKind::Door, wall: Wall::Left, u: [1.0, 1.9], y: [0.0, 2.0], object: None },
            Opening { kind: OpeningKind::Window, wall: Wall::Left, u: [2.5, 9.9], y: [0.9, 2.0], object: None },
        ];
        let all = shell(&room);
        assert_eq!(all.len(), 6);
        let left = &all.iter().find(|(n, _)| n == "wall_left").unwrap().1;
        assert!(left.iter().all(Hull::is_sound));
        assert!(!inside(left, Vec3::new(-0.05, 1.0, 1.5)), "the door is open");
        assert!(inside(left, Vec3::new(-0.05, 2.2, 1.5)) && inside(left, Vec3::new(-0.05, 1.0, 0.5)));
        assert!(!inside(left, Vec3::new(-0.05, 1.5, 3.0)) && inside(left, Vec3::new(-0.05, 0.5, 3.0)));
        let e = room.extents;
        let area: f64 = left.iter().map(|h| h.moments().mass / SHELL_M).sum();
        assert!((area - (e.depth * e.height - 0.9 * 2.0 - (e.depth - 2.5) * 1.1)).abs() < 1e-6, "{area}");
        let floor = &all.iter().find(|(n, _)| n == "floor").unwrap().1;
        assert_eq!(floor.len(), 1);
        assert!((floor[0].bounds().1.y).abs() < 1e-12 && floor[0].bounds().0.x < 0.0);
    }
}
