//! Building: on a layout, by doors; what comes out as files.

use glam::DVec2;
use harmony_export::World;
use harmony_home::HomeError;
use harmony_home::build::{How, build};
use harmony_home::files::{HomeFile, write};
use harmony_home::home::Conflict;
use harmony_home::layout::HomeLayout;
use harmony_home::merge::merge;
use harmony_home::rooms::RoomRun;
use harmony_scene::{QuarterTurn, Support, Surface, Wall};

use crate::support::{Off, cabinet, flat, run, turns};

/// Errors as photos have them: a few percent of scale, 40 cm of what was not seen, a centimetre of doors.
const OFFS: [Off; 3] = [
    Off { scale: 1.04, front: 0.4, door: 0.01 },
    Off { scale: 0.97, front: -0.3, door: -0.01 },
    Off { scale: 1.02, front: 0.2, door: 0.0 },
];

fn runs(layout: &HomeLayout) -> Vec<RoomRun> {
    (0..3).map(|k| run(layout, k, turns()[k], OFFS[k])).collect()
}

/// Where a room's cabinet is in a built home, layout frame.
fn found(world: &World, origin: glam::DVec3, room: &str) -> DVec2 {
    let id = format!("{room}_cabinet_01");
    let p = world.items.iter().find(|i| i.name() == id).unwrap().object.pose.position + origin;
    DVec2::new(p.x, p.z)
}

#[test]
fn on_a_layout_runs_find_their_rooms_and_turns_and_objects_their_places() {
    let layout = flat();
    // In another order than the layout's, without names.
    let mut all = runs(&layout);
    all.rotate_left(1);
    let mut built = build(Some(&layout), all).unwrap();
    let How::Layout(assignment) = &built.how else { panic!("{:?}", built.how) };
    assert_eq!(assignment.runs.iter().map(|r| r.room).collect::<Vec<_>>(), [1, 2, 0]);
    assert!(assignment.next > 1.0, "{assignment:?}");
    assert!(built.cost[1] < 0.5 * built.cost[0], "refinement lowers the cost: {:?}", built.cost);
    for (k, room) in built.home.rooms.iter().enumerate() {
        assert_eq!(room.solved.place.turn, turns()[k], "{}", room.name);
        assert!((room.solved.place.scale * OFFS[k].scale - 1.0).abs() < 0.01, "{:?}", room.solved.place);
        assert_eq!(room.solved.rect, layout.rooms[k].bounds());
    }
    for door in &built.home.doors {
        for (seen, before) in door.seen.iter().zip(&door.before) {
            let (now, then) = (seen.unwrap().1, before.unwrap());
            assert!(now.abs() < 0.03, "{now} after, {then} before");
        }
    }
    assert_eq!(built.home.conflicts, []);
    let merged = merge(&mut built.home);
    for (k, room) in layout.rooms.iter().enumerate() {
        let off = (found(&merged.world, merged.origin, &room.name) - cabinet(&layout, k, turns()[k])).length();
        assert!(off < 0.02, "{}: {off} m", room.name);
    }
    // Things go with what carries them, and keep their names apart.
    let vase = merged.world.items.iter().find(|i| i.name() == "kitchen_vase_01").unwrap();
    assert!(matches!(&vase.object.support, Support::Object { id } if id.as_str() == "kitchen_cabinet_01"));
    let cabinet = merged.world.items.iter().find(|i| i.name() == "kitchen_cabinet_01").unwrap();
    let apart = (vase.object.pose.position - cabinet.object.pose.position).length();
    assert!((apart - 0.2_f64.hypot(0.8)).abs() < 0.01, "{apart}");
}

#[test]
fn by_their_doors_alone_rooms_come_to_the_same_home() {
    let layout = flat();
    let mut built = build(None, runs(&layout)).unwrap();
    // The living room's own turn is that of the home: the layout is turned by it.
    let own = built.home.rooms[0].solved.place.turn;
    assert_eq!(own, QuarterTurn::default());
    for (k, room) in built.home.rooms.iter().enumerate() {
        let quarters = (u8::from(turns()[k]) + 4 - u8::from(turns()[0])) % 4;
        assert_eq!(u8::from(room.solved.place.turn), quarters, "{}", room.name);
    }
    assert_eq!(built.home.doors.len(), 2);
    for door in &built.home.doors {
        assert_eq!(door.rooms[0].min(door.rooms[1]), 0, "both doors are the living room's");
        let meet = (door.seen[0].unwrap().1 - door.seen[1].unwrap().1).abs();
        assert!(meet < 0.03, "{meet}");
    }
    // Kitchen and bedroom do not overlap, and distances are those of the layout.
    assert!(!built.home.conflicts.iter().any(|c| matches!(c, Conflict::Overlap { .. })), "{:?}", built.home.conflicts);
    let merged = merge(&mut built.home);
    let between = |a: &str, b: &str| {
        let [p, q] = [a, b].map(|r| found(&merged.world, merged.origin, r));
        (p - q).length()
    };
    let wanted = |a: usize, b: usize| (cabinet(&layout, a, turns()[a]) - cabinet(&layout, b, turns()[b])).length();
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let (found, truth) = (between(&layout.rooms[a].name, &layout.rooms[b].name), wanted(a, b));
        assert!((found - truth).abs() < 0.15, "{found} m for {truth} m");
    }
}

#[test]
fn a_home_is_a_scene_that_is_read_like_a_run_and_says_what_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("home");
    let file = write(build(Some(&flat()), runs(&flat())).unwrap(), &out).unwrap();
    let read: HomeFile = harmony_io::read_json(&out.join("home.json")).unwrap();
    assert_eq!(read, file);
    for name in ["home.glb", "scene_full.glb", "plan.svg", "render_canonical.png", "layout.json"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let world = World::read(&out).unwrap();
    // Four leaves were seen, two doors are there: 3 cabinets, 3 vases, 2 doors.
    assert_eq!(world.items.len(), 8);
    let room = &world.scene.room;
    let origin = file.origin;
    let free = |x: f64, y: f64, z: f64| room.is_free(glam::DVec3::new(x, y, z) - origin);
    assert!(free(5.06, 1.0, 1.2), "one walks through the kitchen's door");
    assert!(!free(5.06, 2.3, 1.2) && !free(5.06, 1.0, 2.5), "not over it, nor through the wall");
    assert!(!free(9.0, 1.0, 1.0), "what is no room is solid");
    let layout: HomeLayout = HomeLayout::parse(&std::fs::read_to_string(out.join("layout.json")).unwrap()).unwrap();
    assert_eq!(layout.rooms[2].bounds(), flat().rooms[2].bounds());
    assert_eq!(layout.rooms[1].photo_faces, Some(Wall::Left));
    let again = write(build(Some(&flat()), runs(&flat())).unwrap(), &out).unwrap_err();
    assert!(matches!(again, HomeError::Exists { .. }));
}

#[test]
fn what_does_not_fit_is_told_with_its_size_or_refused() {
    let layout = flat();
    let mut all = runs(&layout);
    all.truncate(2);
    let mut off = run(&layout, 2, turns()[2], Off { door: 0.5, ..OFFS[2] });
    off.named = true;
    all.push(off);
    let built = build(Some(&layout), all).unwrap();
    let off = built.home.conflicts.iter().find_map(|c| match c {
        Conflict::DoorOff { room, centimetres, .. } if room == "bedroom" => Some(*centimetres),
        _ => None,
    });
    assert!(off.is_some_and(|cm| (30.0..55.0).contains(&cm)), "{:?}", built.home.conflicts);

    // A side wall that the run has 70 cm too near: doors and the other walls say where the room is.
    let mut mistaken = run(&layout, 1, turns()[1], OFFS[1]);
    let extents = &mut mistaken.world.scene.room.extents;
    extents.width += 0.7;
    mistaken.world.scene.room.seen.retain(|s| *s != Surface::Left);
    let kept = build(Some(&layout), vec![mistaken]).unwrap();
    let kitchen = &kept.home.rooms[1];
    let door = kept.home.doors[0].seen.iter().flatten().next().unwrap().1;
    assert!(door.abs() < 0.05, "{door}: {:?}", kitchen.solved.place);
    let walls = kept.home.conflicts.iter().filter_map(|c| match c {
        Conflict::WallOff { wall, centimetres, .. } => Some((*wall, centimetres.round())),
        _ => None,
    });
    let walls: Vec<(Wall, f64)> = walls.collect();
    assert!(matches!(walls[..], [(Wall::Right, cm)] if (60.0..75.0).contains(&cm)), "{walls:?}");

    let two = build(Some(&layout), runs(&layout)[..2].to_vec()).unwrap();
    assert!(two.home.conflicts.contains(&Conflict::NoPhoto { room: "bedroom".to_owned() }));

    let mut wrong = run(&layout, 1, turns()[1], Off { scale: 1.4, ..OFFS[1] });
    wrong.named = true;
    assert!(matches!(build(Some(&layout), vec![wrong]).unwrap_err(), HomeError::Scale { .. }));

    let mut nameless = run(&layout, 1, turns()[1], OFFS[1]);
    (nameless.name, nameless.named) = ("cellar".to_owned(), true);
    let why = build(Some(&layout), vec![nameless]).unwrap_err().to_string();
    assert!(why.contains("no room cellar") && why.contains("living, kitchen, bedroom"), "{why}");

    let mut alone = run(&layout, 1, turns()[1], OFFS[1]);
    alone.world.scene.room.openings.clear();
    let why = build(None, vec![run(&layout, 0, turns()[0], OFFS[0]), alone]).unwrap_err();
    assert!(matches!(why, HomeError::Apart { ref room } if room == "kitchen"), "{why}");
}
