//! Focal length and rotation from single images, against rooms with known truth.

#![allow(clippy::print_stdout, reason = "tests")]

use crate::common::{angle_deg, gray, rooms};
use harmony_geometry::{FocalPrior, estimate_view};

#[test]
fn rotation_and_focal_length_of_the_rooms() {
    for room in rooms() {
        let image = gray(&room.folder.join("photo.jpg"));
        let start = std::time::Instant::now();
        let free = estimate_view(&image, None);
        let took = start.elapsed();
        let truth = room.camera.intrinsics.fx;
        let known = estimate_view(&image, Some(FocalPrior { focal_px: truth, sigma: 0.02 }));
        println!(
            "{}: free focal {:+.1} % ({:?}, sigma {:.3}), rotation {:.2} deg (yaw {:.1} tilt {:.1}); known focal: rotation {:.2} deg; support {:?} {:?} confidence {:.2}, {} segments, {took:?}",
            room.name,
            100.0 * (free.intrinsics.fx / truth - 1.0),
            free.focal,
            free.focal_sigma,
            angle_deg(free.rotation, room.camera.rotation),
            free.yaw_deg(),
            free.tilt_deg(),
            angle_deg(known.rotation, room.camera.rotation),
            free.support.map(|v| (v * 100.0).round()),
            free.counts,
            free.confidence,
            free.segments.len(),
        );
        assert!((free.intrinsics.fx / truth - 1.0).abs() <= 0.05, "{}: focal length", room.name);
        assert!(angle_deg(free.rotation, room.camera.rotation) <= 1.0, "{}: rotation", room.name);
        assert!(angle_deg(known.rotation, room.camera.rotation) <= 0.6, "{}: rotation, lens known", room.name);
    }
}

/// Real photos with calibrated lenses (ScanNet, Kinect): a prior of a typical lens is enough to come near.
#[test]
fn lenses_of_real_photos() {
    let Some(shared) = harmony_testing::shared("") else { return };
    let mut errors = Vec::new();
    for (name, focal) in [
        ("photos/dorm_room_01.jpg", 1161.0),
        ("photos/office_06.jpg", 1165.0),
        ("photos/lounge_chair_01.jpg", 1165.7),
        ("photos/bedroom_07.png", 519.0),
        ("photos/dining_room_02.png", 519.0),
        ("rgbd/home_dining_1_rgb.png", 518.0),
        ("rgbd/7scenes_kitchen_000000.color.jpg", 585.0),
        ("rgbd/sunrgbd_000017.jpg", 529.5),
        ("masks/total3d_1/img.jpg", 529.5),
        ("masks/total3d_2/img.jpg", 529.5),
        ("masks/total3d_3/img.jpg", 529.5),
        ("masks/im3d_1/img.jpg", 529.5),
        ("masks/im3d_2/img.jpg", 529.5),
        ("masks/im3d_3/img.jpg", 529.5),
        ("masks/im3d_6/img.jpg", 529.5),
        ("masks/im3d_7/img.jpg", 529.5),
    ] {
        let path = shared.join(name);
        if !path.is_file() {
            continue;
        }
        let view = estimate_view(&gray(&path), None);
        let error = view.intrinsics.fx / focal - 1.0;
        println!(
            "{name}: focal {:+.0} % ({:?}, sigma {:.2}), yaw {:.1} tilt {:.1} roll {:.1}, confidence {:.2}",
            100.0 * error,
            view.focal,
            view.focal_sigma,
            view.yaw_deg(),
            view.tilt_deg(),
            view.roll().to_degrees(),
            view.confidence
        );
        errors.push(error.abs());
    }
    errors.sort_by(f64::total_cmp);
    if let Some(median) = errors.get(errors.len() / 2) {
        println!("median {:.1} %", median * 100.0);
        assert!(*median <= 0.12);
    }
}
