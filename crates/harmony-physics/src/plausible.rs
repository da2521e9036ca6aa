//! How plausible a scene is as a place: a few numbers, each with what it counts.
//!
//! Penetration, floating and stability come from [`crate::settle`]. The floor is looked at in cells of [`CELL_M`]: a cell
//! is taken when a collider is above it between ankle and head, and walkable when a person of [`PERSON_M`] radius fits. A door
//! is free when its leaf can swing a quarter turn into the room about one of its sides, or is a passage that can be walked.
//! Rugs and what hangs above heads hinder nobody.

use std::collections::VecDeque;

use harmony_scene::{OpeningKind, Room, Scene, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::bodies::Bodies;
use crate::settle::Settled;
use crate::world::Placed;

/// Side of a floor cell, metres.
pub const CELL_M: f64 = 0.05;
/// Radius that a standing person takes, metres.
pub const PERSON_M: f64 = 0.22;
/// Heights between which things are in the way, metres.
const IN_THE_WAY: (f64, f64) = (0.06, 1.8);
/// Penetrations and gaps above this are seen, metres.
pub const SEEN_M: f64 = 0.01;
/// Largest room whose floor is looked at, metres a side.
const LARGEST_M: f64 = 100.0;

/// A door and whether it opens.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DoorSwing {
    /// The door's object, or its wall.
    pub door: String,
    /// Whether the leaf can swing open.
    pub free: bool,
    /// What is in the way of the better side.
    pub blocked_by: Vec<String>,
}

/// The table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plausibility {
    /// Objects that move.
    pub dynamic: usize,
    /// Of those, stable over five seconds.
    pub stable: usize,
    /// Of those, thrown or gone.
    pub exploded: usize,
    /// Pairs deeper than a centimetre in each other.
    pub penetrating_pairs: usize,
    /// The deepest, metres.
    pub deepest_m: f64,
    /// Objects that move and hang more than a centimetre above everything, or above nothing.
    pub floating: usize,
    /// Objects that move and touch what the scene says they rest on.
    pub supports_right: usize,
    /// Share of the floor that a person can stand on.
    pub walkable_share: f64,
    /// Share of that in its largest connected part.
    pub connected_share: f64,
    /// Whether the largest part reaches a door; `None` when the room has no door that is known.
    pub reaches_door: Option<bool>,
    /// Every door.
    pub doors: Vec<DoorSwing>,
}

impl Plausibility {
    /// Name, value and whether it is as it should be, a line each, for tables.
    pub fn rows(&self) -> Vec<(&'static str, String, bool)> {
        let of = |n: usize| format!("{n} of {}", self.dynamic);
        let free = self.doors.iter().filter(|d| d.free).count();
        let enough = self.stable as f64 >= 0.97 * self.dynamic as f64;
        vec![
            ("stable after 5 s", of(self.stable), enough),
            ("exploded", of(self.exploded), self.exploded == 0),
            (
                "in each other by more than 1 cm",
                format!("{} pairs, deepest {:.1} cm", self.penetrating_pairs, 100.0 * self.deepest_m),
                self.penetrating_pairs == 0,
            ),
            ("floating by more than 1 cm", of(self.floating), self.floating == 0),
            ("touches what it rests on", of(self.supports_right), self.supports_right == self.dynamic),
            (
                "walkable floor",
                format!("{:.0} %, {:.0} % of it connected", 100.0 * self.walkable_share, 100.0 * self.connected_share),
                self.walkable_share > 0.1 && self.connected_share > 0.9,
            ),
            (
                "connected to a door",
                match self.reaches_door {
                    Some(true) => "yes".to_owned(),
                    Some(false) => "no".to_owned(),
                    None => "no door is known".to_owned(),
                },
                self.reaches_door != Some(false),
            ),
            (
                "doors free to open",
                if self.doors.is_empty() {
                    "no door is known".to_owned()
                } else {
                    format!("{free} of {}", self.doors.len())
                },
                free == self.doors.len(),
            ),
        ]
    }
}

/// The table of a scene whose objects are at `places` and whose settling is known.
pub fn plausibility(scene: &Scene, bodies: &Bodies, places: &[Placed], settled: &Settled) -> Plausibility {
    let footprints = footprints(scene, bodies, places);
    let floor = Floor::new(scene, &footprints);
    let dynamic = settled.dynamic();
    let deep: Vec<f64> = settled.penetrations.iter().map(|p| p.depth_m).filter(|d| *d > SEEN_M).collect();
    let doors: Vec<DoorSwing> = swings(scene, &footprints);
    let (stable, count) = settled.stable();
    Plausibility {
        dynamic: count,
        stable,
        exploded: dynamic.filter(|o| o.exploded).count(),
        penetrating_pairs: deep.len(),
        deepest_m: settled.penetrations.first().map_or(0.0, |p| p.depth_m),
        floating: settled.dynamic().filter(|o| o.gap_m.is_none_or(|g| g > SEEN_M)).count(),
        supports_right: settled.dynamic().filter(|o| o.support_right).count(),
        walkable_share: floor.walkable_share(),
        connected_share: floor.connected_share(),
        reaches_door: floor.reaches_door(scene),
        doors,
    }
}

/// A convex outline on the floor of something in the way.
struct Footprint {
    object: String,
    outline: Vec<Vec2>,
}

fn footprints(scene: &Scene, bodies: &Bodies, places: &[Placed]) -> Vec<Footprint> {
    let mut out = Vec::new();
    for ((object, body), place) in scene.objects.iter().zip(&bodies.objects).zip(places) {
        // A door's own leaf stands in its opening.
        if harmony_catalogue::opening(&object.label).is_some() {
            continue;
        }
        for hull in &body.hulls {
            let points: Vec<Vec3> = hull.vertices.iter().map(|v| place.point(*v)).collect();
            let (low, high) = crate::surface::bounds(points.iter());
            if high.y > IN_THE_WAY.0 && low.y < IN_THE_WAY.1 {
                let flat = points.iter().map(|p| Vec2::new(p.x, p.z)).collect();
                out.push(Footprint { object: body.id.clone(), outline: convex_outline(flat) });
            }
        }
    }
    out
}

/// Convex hull in the plane, counter-clockwise (Andrew 1979).
fn convex_outline(mut points: Vec<Vec2>) -> Vec<Vec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let half = |points: &mut dyn Iterator<Item = Vec2>| {
        let mut chain: Vec<Vec2> = Vec::new();
        for p in points {
            while chain.len() >= 2
                && (chain[chain.len() - 1] - chain[chain.len() - 2]).perp_dot(p - chain[chain.len() - 1]) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut out = half(&mut points.iter().copied());
    out.extend(half(&mut points.iter().rev().copied()));
    out
}

impl Footprint {
    /// Whether a disc touches it.
    fn meets(&self, centre: Vec2, radius: f64) -> bool {
        let n = self.outline.len();
        if n == 0 {
            return false;
        }
        let mut edges = (0..n).map(|i| (self.outline[i], self.outline[(i + 1) % n]));
        let inside = n >= 3 && edges.clone().all(|(a, b)| (b - a).perp_dot(centre - a) >= 0.0);
        inside
            || edges.any(|(a, b)| {
                let d = b - a;
                let t = ((centre - a).dot(d) / d.length_squared().max(1e-12)).clamp(0.0, 1.0);
                (a + d * t).distance_squared(centre) <= radius * radius
            })
    }
}

/// Whether a person has room at a place of the floor, as far as the room itself goes.
fn stands_free(room: &Room, at: Vec2) -> bool {
    let around = [Vec2::X, Vec2::NEG_X, Vec2::Y, Vec2::NEG_Y].map(|d| at + d * PERSON_M);
    let heights = [0.1, 1.0, 1.7].map(|y: f64| y.min(0.9 * room.extents.height));
    around.iter().all(|p| heights.iter().all(|y| room.is_free(Vec3::new(p.x, *y, p.y))))
}

/// The floor in cells.
struct Floor {
    columns: usize,
    rows: usize,
    walkable: Vec<bool>,
    /// The largest connected part.
    largest: Vec<bool>,
}

impl Floor {
    fn new(scene: &Scene, footprints: &[Footprint]) -> Self {
        let e = &scene.room.extents;
        let side =
            |length: f64| if length.is_finite() { (length.clamp(0.0, LARGEST_M) / CELL_M).ceil() as usize } else { 0 };
        let (columns, rows) = (side(e.width), side(e.depth));
        let mut walkable = vec![true; columns * rows];
        for (i, cell) in walkable.iter_mut().enumerate() {
            let at = Vec2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5) * CELL_M;
            *cell = stands_free(&scene.room, at) && !footprints.iter().any(|f| f.meets(at, PERSON_M));
        }
        let mut floor = Self { columns, rows, walkable, largest: Vec::new() };
        floor.largest = floor.largest_part();
        floor
    }

    fn largest_part(&self) -> Vec<bool> {
        let mut part = vec![0_u32; self.walkable.len()];
        let (mut best, mut best_count, mut next) = (0, 0, 0);
        for start in 0..part.len() {
            if !self.walkable[start] || part[start] != 0 {
                continue;
            }
            next += 1;
            part[start] = next;
            let mut queue = VecDeque::from([start]);
            let mut count = 0;
            while let Some(i) = queue.pop_front() {
                count += 1;
                let (x, y) = (i % self.columns, i / self.columns);
                let around = [
                    (x > 0).then(|| i - 1),
                    (x + 1 < self.columns).then(|| i + 1),
                    (y > 0).then(|| i - self.columns),
                    (y + 1 < self.rows).then(|| i + self.columns),
                ];
                for j in around.into_iter().flatten().filter(|j| self.walkable[*j]) {
                    if part[j] == 0 {
                        part[j] = next;
                        queue.push_back(j);
                    }
                }
            }
            if count > best_count {
                (best, best_count) = (next, count);
            }
        }
        part.into_iter().map(|p| best != 0 && p == best).collect()
    }

    fn share(set: &[bool], of: usize) -> f64 {
        set.iter().filter(|c| **c).count() as f64 / of.max(1) as f64
    }

    fn walkable_share(&self) -> f64 {
        Self::share(&self.walkable, self.walkable.len())
    }

    fn connected_share(&self) -> f64 {
        Self::share(&self.largest, self.walkable.iter().filter(|c| **c).count())
    }

    /// Whether the largest part comes within an arm's length of a door.
    fn reaches_door(&self, scene: &Scene) -> Option<bool> {
        let mut any = None;
        for door in scene.room.openings.iter().filter(|o| o.kind == OpeningKind::Door) {
            let e = &scene.room.extents;
            let near = PERSON_M + 2.0 * CELL_M;
            let reached = (0..self.largest.len()).filter(|i| self.largest[*i]).any(|i| {
                let at = Vec2::new((i % self.columns) as f64 + 0.5, (i / self.columns) as f64 + 0.5) * CELL_M;
                let p = Vec3::new(at.x, 0.0, at.y);
                let u = door.wall.coordinates(p).x;
                let away = door.wall.distance(e, p) - door.inset;
                (0.0..=near).contains(&away) && u >= door.u[0] && u <= door.u[1]
            });
            any = Some(any.unwrap_or(false) || reached);
        }
        any
    }
}

/// Whether each door can swing open.
fn swings(scene: &Scene, footprints: &[Footprint]) -> Vec<DoorSwing> {
    let e = &scene.room.extents;
    let doors = scene.room.openings.iter().filter(|o| o.kind == OpeningKind::Door);
    doors
        .map(|door| {
            let width = door.u[1] - door.u[0];
            let flat = |u: f64| {
                let p = door.wall.point(e, u, 0.0) + door.wall.normal() * door.inset;
                Vec2::new(p.x, p.z)
            };
            let n = door.wall.normal();
            let into = Vec2::new(n.x, n.z);
            // A wide door has two leaves, each of half the width, about the two sides.
            let double = width > 1.3;
            let leaf = if double { width / 2.0 } else { width };
            let side = |hinge: f64, towards: f64| -> Vec<String> {
                let hinge_at = flat(hinge);
                let along = (flat(towards) - hinge_at).normalize_or(Vec2::X);
                let mut blocking: Vec<String> = Vec::new();
                for k in 1..=18 {
                    let angle = f64::from(k) * 5.0_f64.to_radians();
                    let ray = along * angle.cos() + into * angle.sin();
                    let steps = (leaf / 0.04).ceil().clamp(1.0, 200.0) as usize;
                    for s in 1..=steps {
                        let at = hinge_at + ray * (leaf * s as f64 / steps as f64);
                        let hit = footprints.iter().filter(|f| f.meets(at, 0.02)).map(|f| f.object.clone());
                        blocking.extend(hit);
                    }
                }
                blocking.sort();
                blocking.dedup();
                blocking
            };
            let (first, second) = (side(door.u[0], door.u[1]), side(door.u[1], door.u[0]));
            let blocked_by = if double {
                let mut both = [first, second].concat();
                both.sort();
                both.dedup();
                both
            } else if first.len() <= second.len() {
                first
            } else {
                second
            };
            let name = door.object.as_ref().map_or_else(
                || format!("door in {}", harmony_mesh::shell_material_name(door.wall.surface())),
                ToString::to_string,
            );
            DoorSwing { door: name, free: blocked_by.is_empty(), blocked_by }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use harmony_mesh::Mesh;
    use harmony_scene::{ObjectId, Opening, SceneObject, Support, Wall};

    use super::*;
    use crate::bodies::{BodySettings, bodies};
    use crate::settle::{places, settle};
    use crate::testing::{cuboid, scene};

    fn table(things: Vec<(SceneObject, Arc<Mesh>)>, openings: Vec<Opening>) -> Plausibility {
        let meshes: BTreeMap<ObjectId, Arc<Mesh>> = things.iter().map(|(o, m)| (o.id.clone(), Arc::clone(m))).collect();
        let mut scene = scene(things.into_iter().map(|(o, _)| o).collect());
        scene.room.openings = openings;
        let bodies = bodies(&scene, &meshes, &BodySettings::default()).unwrap();
        let start = places(&scene);
        let settled = settle(&scene, &bodies, &start);
        plausibility(&scene, &bodies, &start, &settled)
    }

    fn door(wall: Wall, u: [f64; 2]) -> Opening {
        Opening { kind: OpeningKind::Door, wall, u, y: [0.0, 2.0], inset: 0.0, rise: 0.0, object: None }
    }

    #[test]
    fn an_empty_room_is_walkable_to_its_walls() {
        let found = table(vec![], vec![door(Wall::Left, [1.0, 1.9])]);
        // 5 x 4 m less a margin of 0.22 m all around.
        let want = (5.0 - 0.44) * (4.0 - 0.44) / 20.0;
        assert!((found.walkable_share - want).abs() < 0.03, "{} {want}", found.walkable_share);
        assert!((found.connected_share - 1.0).abs() < 1e-9 && found.reaches_door == Some(true));
        assert!(found.doors[0].free && found.rows().iter().all(|r| r.2), "{:?}", found.rows());
        assert_eq!(table(vec![], vec![]).reaches_door, None);
    }

    #[test]
    fn a_wall_of_boxes_parts_the_room_and_a_box_blocks_the_door() {
        let bar = || cuboid("box_01", "box", Vec3::new(0.3, 1.0, 4.0), Vec3::new(3.5, 0.0, 2.0), Support::Floor);
        let found = table(vec![bar()], vec![door(Wall::Right, [1.0, 1.9])]);
        assert!((found.connected_share - 3.13 / (3.13 + 0.91)).abs() < 0.05, "{}", found.connected_share);
        assert_eq!(found.reaches_door, Some(false), "the larger part is on the other side");
        let near = || cuboid("box_02", "box", Vec3::splat(0.3), Vec3::new(0.4, 0.0, 1.45), Support::Floor);
        let found = table(vec![near()], vec![door(Wall::Left, [1.0, 1.9])]);
        assert!(!found.doors[0].free && found.doors[0].blocked_by == ["box_02"], "{:?}", found.doors);
        // Beside one hinge the other is free.
        let aside = cuboid("box_02", "box", Vec3::splat(0.3), Vec3::new(0.85, 0.0, 1.05), Support::Floor);
        assert!(table(vec![aside], vec![door(Wall::Left, [1.0, 1.9])]).doors[0].free);
    }

    #[test]
    fn what_is_wrong_is_counted() {
        let found = table(
            vec![
                cuboid("box_01", "box", Vec3::splat(0.4), Vec3::new(2.0, 0.0, 2.0), Support::Floor),
                cuboid("box_02", "box", Vec3::splat(0.4), Vec3::new(2.35, 0.0, 2.0), Support::Floor),
                cuboid("box_03", "box", Vec3::splat(0.4), Vec3::new(4.0, 0.3, 2.0), Support::Floor),
            ],
            vec![],
        );
        assert_eq!((found.dynamic, found.stable, found.penetrating_pairs, found.floating), (3, 0, 1, 1));
        assert!((found.deepest_m - 0.05).abs() < 1e-3);
    }
}
