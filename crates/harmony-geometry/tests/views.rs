//! Focal length and rotation from single images, against rooms with known truth.

mod common;

use common::{angle_deg, gray, rooms};
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
    }
}
