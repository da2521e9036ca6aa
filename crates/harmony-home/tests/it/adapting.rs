//! One room in another size.

use glam::DVec3;
use harmony_export::World;
use harmony_home::HomeError;
use harmony_home::adapt::adapt;
use harmony_scene::{Extents, ObjectId, Opening, OpeningKind, Surface, Wall};

use crate::support::{at_wall, on, on_wall, thing, world};

const FROM: Extents = Extents { width: 4.0, height: 2.6, depth: 5.0 };

fn group(mut item: harmony_export::world::Item, name: &str) -> harmony_export::world::Item {
    item.object.relations.group = Some(name.to_owned());
    item
}

fn facing(mut item: harmony_export::world::Item, id: &str) -> harmony_export::world::Item {
    item.object.relations.facing_toward = Some(ObjectId::new(id).unwrap());
    item
}

/// A sofa at the left wall with a picture above it, a cabinet in the back right corner with a vase, a table with two
/// chairs in the middle, a window in the back wall.
fn room() -> World {
    let window = Opening {
        kind: OpeningKind::Window,
        wall: Wall::Back,
        u: [0.5, 1.5],
        y: [0.9, 2.1],
        inset: 0.0,
        rise: 0.0,
        object: Some(ObjectId::new("window_01").unwrap()),
    };
    let left = std::f64::consts::FRAC_PI_2;
    let items = vec![
        on_wall(thing("window_01", "window", [1.0, 1.2, 0.1], [1.0, 0.9, 0.0], 0.0), Wall::Back),
        at_wall(thing("sofa_01", "sofa", [1.8, 0.8, 0.9], [0.5, 0.0, 2.6], left), Wall::Left),
        on_wall(thing("picture_01", "painting", [0.8, 0.6, 0.03], [0.015, 1.3, 2.6], left), Wall::Left),
        at_wall(thing("cabinet_01", "cabinet", [0.8, 1.0, 0.4], [3.5, 0.0, 0.25], 0.0), Wall::Back),
        on(thing("vase_01", "vase", [0.1, 0.3, 0.1], [3.6, 1.0, 0.25], 0.0), "cabinet_01"),
        group(thing("table_01", "table", [1.0, 0.75, 0.8], [2.4, 0.0, 2.6], 0.0), "dining"),
        group(thing("chair_01", "chair", [0.4, 0.9, 0.4], [2.4, 0.0, 3.3], std::f64::consts::PI), "dining"),
        facing(thing("chair_02", "chair", [0.4, 0.9, 0.4], [2.4, 0.0, 1.9], 0.0), "table_01"),
    ];
    let seen = Surface::ALL.into_iter().filter(|s| *s != Surface::Front).collect();
    world(FROM, seen, vec![window], items)
}

fn at(world: &World, id: &str) -> DVec3 {
    world.items.iter().find(|i| i.name() == id).unwrap().object.pose.position
}

#[test]
fn in_a_larger_room_walls_relations_and_clearances_are_kept() {
    let before = room();
    let to = Extents { width: 5.2, height: 2.8, depth: 6.0 };
    let (after, report) = adapt(&before, to).unwrap();
    assert_eq!(after.scene.room.extents, to);
    assert_eq!(report.conflicts, Vec::<String>::new());
    // Distances to the walls that hold things stay.
    assert!((at(&after, "sofa_01").x - 0.5).abs() < 1e-9);
    assert!((at(&after, "cabinet_01").z - 0.25).abs() < 1e-9);
    assert!((to.width - at(&after, "cabinet_01").x - 0.5).abs() < 1e-9, "near the corner it stays in the corner");
    // What belongs together moves together.
    for (a, b) in
        [("sofa_01", "picture_01"), ("cabinet_01", "vase_01"), ("table_01", "chair_01"), ("table_01", "chair_02")]
    {
        let apart = |w: &World| at(w, a) - at(w, b);
        assert!((apart(&after) - apart(&before)).length() < 1e-9, "{a} and {b}");
    }
    // The table keeps the shares of free room: 1.9 m to the left of it, 1.1 m to the right, in x.
    let table = at(&after, "table_01").x;
    assert!((table - (0.5 + 4.2 * 1.9 / 3.0)).abs() < 1e-9, "{table}");
    // A window takes its opening with it.
    let window = &after.scene.room.openings[0];
    let middle = f64::midpoint(window.u[0], window.u[1]);
    assert!((middle - at(&after, "window_01").x).abs() < 1e-9);
    assert!((middle - (0.5 + 4.2 * 0.5 / 3.0)).abs() < 1e-9, "{middle}");
}

#[test]
fn in_a_smaller_room_things_are_moved_apart_or_told() {
    let before = room();
    let overlap = |w: &World, a: &str, b: &str| {
        let bounds = [a, b].map(|id| w.items.iter().find(|i| i.name() == id).unwrap().room_bounds());
        let met = bounds[0].max.min(bounds[1].max) - bounds[0].min.max(bounds[1].min);
        met.x.min(met.z).max(0.0)
    };
    let (after, report) = adapt(&before, Extents { width: 3.0, height: 2.6, depth: 4.6 }).unwrap();
    for (a, b) in [("sofa_01", "table_01"), ("sofa_01", "chair_01"), ("cabinet_01", "table_01")] {
        assert!(overlap(&after, a, b) < 0.02, "{a} and {b}: {report:?}");
    }
    for item in &after.items {
        let b = item.room_bounds();
        assert!(b.min.x > -0.1 && b.max.x < 3.1 && b.min.z > -0.1 && b.max.z < 4.7, "{} stays inside", item.name());
    }
    let (_, tight) = adapt(&before, Extents { width: 2.0, height: 2.6, depth: 2.2 }).unwrap();
    assert!(tight.conflicts.iter().any(|c| c.contains("overlap by") || c.contains("larger than")), "{tight:?}");
    let (low, report) = adapt(&before, Extents { height: 1.95, ..FROM }).unwrap();
    assert!(report.conflicts.is_empty(), "{report:?}");
    let picture = low.items.iter().find(|i| i.name() == "window_01").unwrap().room_bounds();
    assert!(picture.max.y <= 1.95, "what hangs too high is lowered");
}

#[test]
fn sizes_that_are_no_rooms_are_refused() {
    for to in [
        Extents { width: 0.0, ..FROM },
        Extents { width: f64::NAN, ..FROM },
        Extents { depth: 400.0, ..FROM },
        Extents { height: 0.5, ..FROM },
    ] {
        assert!(matches!(adapt(&room(), to).unwrap_err(), HomeError::Size { .. }), "{to:?}");
    }
}
