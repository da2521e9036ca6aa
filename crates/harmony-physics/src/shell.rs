//! The room as colliders: floor, ceiling and walls as boxes outside the room's box, walls with their openings and niches
//! cut out; blocks as they are; slopes as wedges.

use harmony_mesh::shell_material_name;
use harmony_scene::{Opening, Room, Surface, Vec2, Vec3, Wall};

use crate::hull::Hull;

/// Thickness of floor, walls and ceiling, outward, metres. Thick enough that nothing passes through in a step.
pub const SHELL_M: f64 = 0.2;

/// Hulls of each face by the name of its node, in the room frame.
pub fn shell(room: &Room) -> Vec<(String, Vec<Hull>)> {
    let mut shell: Vec<(Surface, Vec<Hull>)> = Surface::ALL.into_iter().map(|s| (s, face(room, s))).collect();
    for (surface, hull) in others(room) {
        shell.iter_mut().filter(|(s, _)| *s == surface).for_each(|(_, hulls)| hulls.push(hull.clone()));
    }
    shell.into_iter().map(|(s, hulls)| (shell_material_name(s).to_owned(), hulls)).collect()
}

/// Blocks, the backs and sides of niches, and what is solid above slopes, with the surface that each belongs to.
fn others(room: &Room) -> Vec<(Surface, Hull)> {
    let e = &room.extents;
    let mut out = Vec::new();
    for block in &room.shape.blocks {
        let touched = |w: &Wall| w.distance(e, block.min).min(w.distance(e, block.max)) < 1e-3;
        let wall = Wall::ALL.into_iter().find(touched).unwrap_or(Wall::Back);
        let solids = room.shape.niches.iter().fold(vec![(block.min, block.max)], |solids, niche| {
            solids.into_iter().flat_map(|solid| without(solid, (niche.min, niche.max))).collect()
        });
        out.extend(solids.into_iter().map(|(min, max)| (wall.surface(), Hull::cuboid(min, max))));
    }
    for niche in &room.shape.niches {
        // A jacket as thick as the walls, less the niche and what is free before it.
        let out_of_room = -niche.surface.normal() * SHELL_M;
        let jacket = (niche.min - SHELL_M, niche.max + SHELL_M);
        let (low, high) = (niche.min, niche.max);
        let before = (low.min(low - out_of_room), high.max(high - out_of_room));
        let inside_room = |(min, max): &(Vec3, Vec3)| e.contains((*min + *max) / 2.0, 0.0);
        let pieces = without(jacket, before).into_iter().filter(|p| !inside_room(p));
        out.extend(
            pieces
                .flat_map(|p| without(p, (Vec3::ZERO, e.as_vec())))
                .map(|(min, max)| (niche.surface, Hull::cuboid(min, max))),
        );
    }
    for slope in &room.shape.slopes {
        let length = slope.wall.length(e);
        let wedge: Vec<Vec3> = [0.0, length]
            .into_iter()
            .flat_map(|u| {
                let at = |d: f64, y: f64| slope.wall.point(e, u, y) + slope.wall.normal() * d;
                [at(0.0, slope.low), at(0.0, e.height), at(slope.run, e.height)]
            })
            .collect();
        out.extend(Hull::of(&wedge).map(|hull| (Surface::Ceiling, hull)));
    }
    out
}

/// A box less another, as boxes.
fn without((min, max): (Vec3, Vec3), (low, high): (Vec3, Vec3)) -> Vec<(Vec3, Vec3)> {
    let (low, high) = (low.max(min), high.min(max));
    if (high - low).min_element() <= 1e-6 {
        return vec![(min, max)];
    }
    let (mut rest_min, mut rest_max) = (min, max);
    let mut out = Vec::new();
    for axis in 0..3 {
        let mut below = rest_max;
        below[axis] = low[axis];
        out.push((rest_min, below));
        let mut above = rest_min;
        above[axis] = high[axis];
        out.push((above, rest_max));
        (rest_min[axis], rest_max[axis]) = (low[axis], high[axis]);
    }
    out.retain(|(a, b)| (*b - *a).min_element() > 1e-6);
    out
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
        .filter(|o| Some(o.wall) == surface.wall() && o.inset.abs() < 0.01)
        .map(|o| (Vec2::new(o.u[0], o.y[0]).max(low), Vec2::new(o.u[1], o.y[1]).min(high)))
        .chain(room.shape.niches.iter().filter(|n| n.surface == surface).map(|n| {
            let (a, b) = (surface.coordinates(n.min), surface.coordinates(n.max));
            (a.max(low), b.min(high))
        }))
        .filter(|(a, b)| a.is_finite() && b.is_finite() && (*b - *a).min_element() > 1e-3)
        .collect();
    let arches = room.openings.iter().filter(|o| Some(o.wall) == surface.wall() && o.inset.abs() < 0.01);
    let arches: Vec<Hull> = arches.flat_map(|o| spandrels(room, o)).collect();
    rectangles(low, high, &holes)
        .into_iter()
        .map(|(a, b)| {
            let (p, q) = (surface.point(e, a), surface.point(e, b));
            let out = -surface.normal() * SHELL_M;
            let (low, high) = (p.min(q), p.max(q));
            Hull::cuboid(low.min(low + out), high.max(high + out))
        })
        .chain(arches)
        .collect()
}

/// The wall between an arch and the corners of its rectangle: prisms around these, over the chords of the arch.
fn spandrels(room: &Room, opening: &Opening) -> Vec<Hull> {
    if opening.rounded() <= 0.0 {
        return Vec::new();
    }
    let (wall, arc) = (opening.wall, opening.top());
    let middle = arc.len() / 2;
    let fans = [(arc[0].x, &arc[..=middle]), (arc[arc.len() - 1].x, &arc[middle..])];
    let prism = |corner: Vec2, chord: &[Vec2]| {
        let foot = [corner, chord[0], chord[1]].map(|p| wall.point(&room.extents, p.x, p.y));
        Hull::of(&[foot, foot.map(|p| p - wall.normal() * SHELL_M)].concat())
    };
    let prism = &prism;
    fans.into_iter()
        .flat_map(|(u, half)| half.windows(2).filter_map(move |chord| prism(Vec2::new(u, opening.y[1]), chord)))
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
    use harmony_scene::{OpeningKind, Vec3, Wall};

    fn inside(hulls: &[Hull], p: Vec3) -> bool {
        hulls.iter().any(|h| h.outside(p) < 0.0)
    }

    #[test]
    fn openings_are_open_and_the_rest_is_wall() {
        let mut room = room();
        room.openings = vec![
            Opening {
                kind: OpeningKind::Door,
                wall: Wall::Left,
                u: [1.0, 1.9],
                y: [0.0, 2.0],
                inset: 0.0,
                rise: 0.0,
                object: None,
            },
            Opening {
                kind: OpeningKind::Window,
                wall: Wall::Left,
                u: [2.5, 9.9],
                y: [0.9, 2.0],
                inset: 0.0,
                rise: 0.0,
                object: None,
            },
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

    #[test]
    fn under_an_arch_one_walks_and_beside_it_is_wall() {
        let mut room = room();
        room.openings = vec![Opening {
            kind: OpeningKind::Door,
            wall: Wall::Back,
            u: [1.0, 2.0],
            y: [0.0, 2.0],
            inset: 0.0,
            rise: 0.5,
            object: None,
        }];
        let all = shell(&room);
        let back = &all.iter().find(|(n, _)| n == "wall_back").unwrap().1;
        assert!(back.iter().all(Hull::is_sound));
        // A half circle of 0.5 m around (1.5, 1.5): the chords lie up to 1 cm inside it.
        for (u, y) in [(1.5, 1.98), (1.15, 1.82), (1.85, 1.82), (1.02, 1.4)] {
            assert!(!inside(back, Vec3::new(u, y, -0.1)), "{u} {y} is open");
        }
        for (u, y) in [(1.5, 2.02), (1.1, 1.85), (1.9, 1.85), (1.02, 1.9), (0.98, 1.0)] {
            assert!(inside(back, Vec3::new(u, y, -0.1)), "{u} {y} is wall");
        }
    }

    #[test]
    fn blocks_niches_and_slopes_are_solid_around_what_is_free() {
        let mut room = room();
        room.openings.clear();
        let e = room.extents;
        room.shape.blocks.push(harmony_scene::Block {
            kind: "corner".into(),
            min: Vec3::new(e.width - 1.0, 0.0, 0.0),
            max: Vec3::new(e.width, e.height, 1.0),
        });
        room.shape.niches.push(harmony_scene::Niche {
            kind: "niche".into(),
            surface: Surface::Back,
            sides: None,
            glow: None,
            min: Vec3::new(0.5, 0.5, -0.3),
            max: Vec3::new(1.0, 1.5, 0.0),
        });
        room.shape.slopes.push(harmony_scene::Slope { wall: Wall::Front, low: 1.0, run: 1.0 });
        let all: Vec<Hull> = shell(&room).into_iter().flat_map(|(_, hulls)| hulls).collect();
        // A grid over the box: solid exactly where the room is not free.
        for k in 0..24 * 16 * 24 {
            let share = Vec3::new(f64::from(k % 24), f64::from(k / 24 % 16), f64::from(k / 24 / 16)) + 0.37;
            let p = share / Vec3::new(24.0, 16.0, 24.0) * e.as_vec();
            assert_eq!(inside(&all, p), !room.is_free(p), "{p}");
        }
        let (jamb, back) = (Vec3::new(0.45, 1.0, -0.15), Vec3::new(0.7, 1.0, -0.4));
        assert!(inside(&all, jamb) && inside(&all, back) && !inside(&all, Vec3::new(0.7, 1.0, -0.2)));
    }
}
