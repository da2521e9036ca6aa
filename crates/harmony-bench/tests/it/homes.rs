//! Floor plans of homes and their rooms.

use harmony_bench::generate::{GeneratorSettings, generate};
use harmony_bench::homes::plan;
use harmony_home::frame::{Place, in_room};
use harmony_home::layout::HomeLayout;
use harmony_scene::{ImageSize, Wall};

#[test]
fn floor_plans_are_layouts_whose_rooms_are_all_joined_and_whose_doors_are_the_same_from_both_sides() {
    for seed in 0..40 {
        let plan = plan(seed, None);
        let count = plan.rooms.len();
        assert!((2..=5).contains(&count), "seed {seed}");
        // Checked as a user's is: no overlaps, doors within walls of both rooms.
        let layout = HomeLayout::parse(&serde_json::to_string(&plan.layout).unwrap()).unwrap();
        let mut reached = vec![true];
        reached.resize(count, false);
        for _ in 0..count {
            for door in 0..layout.doors.len() {
                let rooms: Vec<usize> = layout.sides(door).unwrap().iter().map(|s| s.room).collect();
                if rooms.iter().any(|r| reached[*r]) {
                    for room in rooms {
                        reached[room] = true;
                    }
                }
            }
        }
        assert!(reached.iter().all(|r| *r), "seed {seed}: every room has a way");
        for (k, door) in layout.doors.iter().enumerate() {
            for seat in layout.sides(k).unwrap() {
                let room = &plan.rooms[seat.room];
                let rect = layout.rooms[seat.room].bounds();
                let at = if matches!(seat.side, Wall::Left | Wall::Right) { door.at.y } else { door.at.x };
                let (wall, u) = in_room(&rect, room.turn, seat.side, at);
                let own = room.fixed.doors.iter().find(|d| d.wall == wall && (d.u - u).abs() < 1e-6);
                assert!(own.is_some_and(|d| (d.width - door.width).abs() < 1e-9), "seed {seed}, {}", room.name);
                // The room's own place of it leads back to the layout's.
                let e = room.fixed.extents;
                let place = Place { turn: room.turn, yaw: 0.0, scale: 1.0, at: rect.centre(), floor: 0.0 };
                let home = place.point(&e, wall.point(&e, u, 0.0));
                let along = if matches!(seat.side, Wall::Left | Wall::Right) { home.z } else { home.x };
                assert!((along - at).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn a_room_of_a_home_has_the_size_and_the_doors_that_the_home_asks_for() {
    let plan = plan(1, Some(2));
    let room = &plan.rooms[0];
    let settings = GeneratorSettings {
        kinds: vec![room.kind],
        fixed: Some(room.fixed.clone()),
        image: Some(ImageSize::new(240, 180)),
        points: 100,
        shell_points: 100,
        views: false,
        ..GeneratorSettings::default()
    };
    let made = generate(16, &settings);
    assert_eq!(made.extents, room.fixed.extents);
    for door in &room.fixed.doors {
        let own = made.openings.iter().find(|o| o.door && o.wall == door.wall);
        let own = own.unwrap_or_else(|| panic!("no door in {:?}", door.wall));
        assert!((f64::midpoint(own.u[0], own.u[1]) - door.u).abs() < 1e-6);
        assert!((own.u[1] - own.u[0] - door.width).abs() < 0.01);
    }
    assert!(made.openings.iter().filter(|o| !o.door).all(|o| room.fixed.outside.contains(&o.wall)));
}
