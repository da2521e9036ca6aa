//! The room box of single photos, against rooms with known truth.

mod common;

use common::{angle_deg, gray, rooms};
use harmony_geometry::{LayoutPrior, estimate_room_box, estimate_view};
use harmony_scene::{Camera, Extents, Vec2};

/// Share of the pixels on which two boxes show the same face.
fn agreement(a: (&Camera, &Extents), b: (&Camera, &Extents)) -> f64 {
    let size = a.0.size;
    let (mut same, mut all) = (0, 0);
    for y in (4..size.height).step_by(8) {
        for x in (4..size.width).step_by(8) {
            let pixel = Vec2::new(f64::from(x), f64::from(y));
            let face = |(c, e): (&Camera, &Extents)| e.exit(&c.ray(pixel)).map(|h| h.0);
            all += 1;
            same += usize::from(face(a) == face(b));
        }
    }
    f64::from(same as u32) / f64::from(all)
}

#[test]
fn boxes_from_lines_show_the_right_faces() {
    let mut sum = 0.0;
    let rooms = rooms();
    for room in &rooms {
        let image = gray(&room.folder.join("photo.jpg"));
        let view = estimate_view(&image, None);
        let mut line = String::new();
        for (name, extents) in [
            ("unknown", LayoutPrior::unknown(room.camera.size).extents),
            (
                "model",
                Extents {
                    width: room.extents.width * 1.15,
                    height: room.extents.height,
                    depth: room.extents.depth * 0.9,
                },
            ),
        ] {
            let prior = LayoutPrior { extents, ..LayoutPrior::unknown(room.camera.size) };
            let start = std::time::Instant::now();
            let found = estimate_room_box(&image, &view, &prior);
            let took = start.elapsed();
            let same = agreement((&found.camera, &found.extents), (&room.camera, &room.extents));
            sum += same / 2.0;
            line += &format!(
                " | {name}: same {same:.2}, camera {:.2} (truth {:.2}), box {:.2}, support {:.2}, conf {:.2}, {took:?}",
                found.camera.centre(),
                room.camera.centre(),
                found.extents.as_vec(),
                found.evidence.edge_support,
                found.confidence,
            );
            assert!(angle_deg(found.camera.rotation, room.camera.rotation) <= 1.0);
        }
        println!("{}{line}", room.name);
    }
    println!("mean {:.3}", sum / rooms.len().max(1) as f64);
}
