//! Looks into the cost of a room's objects: found pose against true pose. Run by hand:
//! `HARMONY_ROOM=.. HARMONY_OBJECT=.. cargo test -p harmony-placement --lib probe -- --ignored --nocapture`.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/truth/room.rs"]
#[allow(dead_code)]
mod room;

use std::sync::Arc;

use harmony_scene::{Level, PointMapKind, Pose};
use room::{GtRoom, Noise};

use crate::first_pose::Starter;
use crate::view::View;
use crate::*;

#[test]
#[ignore = "for looking, not for judging"]
fn found_against_true() {
    let name = std::env::var("HARMONY_ROOM").unwrap_or("kitchen_01".to_owned());
    let wanted = std::env::var("HARMONY_OBJECT").ok();
    let kind = if std::env::var_os("HARMONY_DENSE").is_some() { PointMapKind::Metric } else { PointMapKind::RoomBox };
    let Some(gt) = GtRoom::load(&name) else { return };
    let mut noise = Noise { size: 0.15, seed: 7, ..Noise::default() };
    if std::env::var_os("HARMONY_NOISE").is_some() {
        noise = Noise { mesh: 0.1, mask_px: 2.0, pitch: 0.014, focal: 0.03, depth: 0.03, ..noise };
    }
    let mut scene = gt.scene(Some(kind), &noise);
    let settings = PlacementSettings::default();
    for level in Level::ALL {
        let mut items = gt.items(level, &noise);
        scene.upcoming = gt.upcoming(level);
        if let Some(i) = items.iter().position(|i| wanted.as_deref() == Some(i.id.as_str())) {
            let item = Arc::new(items.swap_remove(i));
            let waiting: Vec<Arc<Item>> = items.iter().cloned().map(Arc::new).collect();
            for (title, others) in [("alone", waiting), ("after the others", Vec::new())] {
                if others.is_empty() {
                    let mut rest = std::mem::take(&mut items);
                    rest.retain(|i| i.id != item.id);
                    let _ = place_level(&mut scene, rest, None, &settings);
                }
                let neighbours = level::neighbours(&scene, &item, &others, None);
                let view = View::new(&scene, None, &item.mask, &neighbours, settings.window_px).unwrap();
                println!("== {title}: mask {:?} free {:?}", view.mask_box, view.free);
                let truth = gt.truth(item.id.as_str()).unwrap();
                let starter = Starter { scene: &scene, item: &item, view: &view, settings: &settings };
                for h in starter.all() {
                    let judge = cost::Judge {
                        view: &view,
                        frame: h.frame,
                        size_sigma: 0.2,
                        use_depth: scene.points.as_ref().is_some_and(RoomPoints::is_dense),
                    };
                    let (c, m) = judge.cost(&h.pose);
                    println!(
                        "  start {:?} yaw {:.2} scale {:.2} {:?} price {} cost {c:.3} iou {:.3} {:?}",
                        h.pose.position, h.pose.yaw, h.pose.scale, h.frame.anchoring, h.price, m.iou, m.outline
                    );
                }
                let found = solve::solve(&scene, &item, &view, &settings);
                let truth_pose = Pose::new(truth.position(), truth.yaw(), 1.0);
                let judge = cost::Judge {
                    view: &view,
                    frame: found.frame,
                    size_sigma: 0.2,
                    use_depth: scene.points.as_ref().is_some_and(RoomPoints::is_dense),
                };
                for (name, pose) in
                    [("found", found.pose), ("true", truth_pose), ("true, settled", found.frame.settle(&truth_pose))]
                {
                    println!(
                        "  {name}: {:?} yaw {:.2} scale {:.3} -> {:.4} {:?}",
                        pose.position,
                        pose.yaw,
                        pose.scale,
                        judge.cost(&pose).0,
                        judge.cost(&pose).1
                    );
                }
            }
            return;
        }
        let _ = place_level(&mut scene, items, None, &settings);
    }
}

#[test]
#[ignore = "for looking, not for judging"]
fn collisions_of_the_truth() {
    for name in room::names().unwrap_or_default() {
        let gt = GtRoom::load(&name).unwrap();
        let mut scene = gt.scene(None, &Noise::default());
        let settings = PlacementSettings::default();
        for level in Level::ALL {
            for item in gt.items(level, &Noise::default()) {
                let truth = gt.truth(item.id.as_str()).unwrap();
                let pose = Pose::new(truth.position(), truth.yaw(), 1.0);
                let support = match (&item.relations.on_top_of, level) {
                    (Some(id), _) => harmony_scene::Support::Object { id: id.clone() },
                    (None, Level::Wall) => {
                        harmony_scene::Support::Wall { wall: item.relations.wall_affinity.wall().unwrap() }
                    }
                    (None, Level::Ceiling) => harmony_scene::Support::Ceiling,
                    _ => harmony_scene::Support::Floor,
                };
                scene.placed.push(Placed { item: Arc::new(item), pose, support, evidence: Evidence::default() });
            }
        }
        println!("{name}");
        for c in collisions(&scene, &settings) {
            println!("  {} {} {:.3}", c.a, c.b, c.penetration);
        }
    }
}
