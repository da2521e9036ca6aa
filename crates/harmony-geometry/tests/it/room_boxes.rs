//! The room box of single photos, against rooms with known truth.

#![allow(clippy::print_stdout, reason = "tests")]

use std::fmt::Write as _;

use crate::common::{angle_deg, gray, rooms};
use harmony_geometry::{GrayImage, LayoutPrior, estimate_room_box, estimate_view};
use harmony_scene::{Camera, Extents, ImageSize, Vec2};

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
            let _ = write!(
                line,
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
    assert!(rooms.is_empty() || sum / rooms.len() as f64 >= 0.9);
}

/// Pictures that are no rooms: always a camera inside a box, with little confidence.
#[test]
fn pictures_without_a_room_give_a_plausible_one() {
    let mut seed = 3u32;
    let mut noise = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 24) as u8
    };
    let mut pictures = vec![];
    for (w, h) in [(640, 480), (2000, 400), (300, 900), (9, 7), (1, 1), (3, 400)] {
        let size = ImageSize::new(w, h);
        pictures.push((size, vec![200; size.pixels()]));
        pictures.push((size, (0..size.pixels()).map(|_| noise()).collect()));
        // A slope and a checkerboard.
        pictures.push((size, (0..size.pixels()).map(|i| (i as u32 / w * 255 / h) as u8).collect()));
        pictures.push((
            size,
            (0..size.pixels())
                .map(|i| if (i as u32 % w / 16 + i as u32 / w / 16).is_multiple_of(2) { 30 } else { 220 })
                .collect(),
        ));
    }
    for (size, luma) in pictures {
        let image = GrayImage::from_luma8(size, &luma).unwrap();
        let view = estimate_view(&image, None);
        let mut prior = LayoutPrior::unknown(size);
        for hinted in [false, true] {
            if hinted {
                prior.camera.corner_px = Some([f64::NAN, 3.0]);
                prior.camera.height_m = Some(-4.0);
                prior.camera.yaw_deg = Some(1e9);
                prior.extents.height = f64::INFINITY;
            }
            let room = estimate_room_box(&image, &view, &prior);
            let e = room.extents;
            assert!(e.contains(room.camera.centre(), -0.01), "{size:?}: camera {} in {e:?}", room.camera.centre());
            assert!((1.5..=30.0).contains(&e.height) && e.width <= 120.0 && e.depth <= 120.0);
            assert!(room.camera.intrinsics.fx > 0.0 && room.camera.rotation.is_finite());
            assert!(room.confidence <= 0.75 && !room.evidence.fallbacks.is_empty());
            let map = room.point_map(ImageSize::new(32, 24));
            assert!(map.xyz.iter().all(|p| p.is_finite()), "every ray meets the box");
        }
    }
}
