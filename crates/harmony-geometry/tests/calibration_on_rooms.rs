//! Calibration of point maps made from rooms with known truth.
//!
//! The maps are made like a feed-forward estimator's: unknown scale, an arbitrary rigid frame, a smooth
//! multiplicative error of the depth, softened depth edges, no readings here and there.

mod common;

use common::{Room, rooms};
use harmony_geometry::{CalibrationSettings, LayoutPrior, calibrate};
use harmony_scene::{Camera, Extents, ImageSize, Mat3, PointMap, PointMapKind, Similarity, Surface, Vec3};

struct Distortion {
    kind: PointMapKind,
    /// Amplitude of the smooth multiplicative error.
    smooth: f64,
    /// Amplitude of the error from pixel to pixel.
    grain: f64,
    frame: Similarity,
}

fn point_map(room: &Room, size: ImageSize, d: &Distortion) -> PointMap {
    let camera = room.camera.resized(size);
    let mut noise = 12345u64;
    let mut grain = || {
        noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (noise >> 33) as f64 / f64::from(1u32 << 31) * 2.0 - 1.0
    };
    let mut depth = Vec::with_capacity(size.pixels());
    for y in 0..size.height {
        for x in 0..size.width {
            let (u, v) = (f64::from(x) / f64::from(size.width), f64::from(y) / f64::from(size.height));
            let z = room.depth_at(u, v);
            let smooth = d.smooth * ((5.0 * u + 1.0).sin() * (4.0 * v + 2.0).cos() + 0.5 * (9.0 * u * v).sin());
            depth.push((z * (1.0 + smooth + d.grain * grain())) as f32);
        }
    }
    let mut map = PointMap::from_depth(d.kind, size, camera.intrinsics, &depth);
    // points = frame * camera; so camera_from_points is the inverse, with the map's unit kept.
    for p in &mut map.xyz {
        *p = d.frame.point(p.as_dvec3()).as_vec3();
    }
    map.rotation = d.frame.rotation.transpose();
    map.translation = -(map.rotation * d.frame.translation);
    map
}

fn frame(scale: f64) -> Similarity {
    Similarity {
        scale,
        rotation: Mat3::from_rotation_z(0.3) * Mat3::from_rotation_x(-0.7) * Mat3::from_rotation_y(1.1),
        translation: Vec3::new(0.3, -0.2, 0.5) * scale,
    }
}

fn prior(room: &Room) -> LayoutPrior {
    // The height is the truth's (the only metric reference); width and depth are off as a model's are.
    let e = room.extents;
    let mut prior = LayoutPrior::unknown(room.camera.size);
    prior.extents = Extents { width: e.width * 1.15, height: e.height, depth: e.depth * 0.9 };
    prior
}

fn errors(found: &Camera, truth: &Camera) -> (f64, f64) {
    let turn = found.rotation * truth.rotation.transpose();
    let trace = turn.x_axis.x + turn.y_axis.y + turn.z_axis.z;
    let rotation = ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees();
    (rotation, found.centre().distance(truth.centre()))
}

/// Rotation below a degree and the centre within a decimetre, for maps as good as a network's; where floor and
/// ceiling are seen the scale follows from the height alone.
#[test]
fn relative_maps_are_calibrated_from_the_room_height() {
    for room in rooms() {
        let size = ImageSize::new(518, 518 * room.camera.size.height / room.camera.size.width);
        let map = point_map(
            &room,
            size,
            &Distortion { kind: PointMapKind::Relative, smooth: 0.004, grain: 0.003, frame: frame(0.31) },
        );
        let mut prior = prior(&room);
        if !room.ceiling_visible {
            prior.camera.height_m = Some(room.camera.centre().y);
        }
        let start = std::time::Instant::now();
        let found = calibrate(&map, &prior, &CalibrationSettings::default()).unwrap();
        let took = start.elapsed();
        let (rotation, centre) = errors(&found.camera, &room.camera);
        println!(
            "{}: rotation {rotation:.2} deg, centre {centre:.3} m, extents {:?} (truth {:?}), seen {:?}, anchor {:?}, {took:?}\n   {:?}",
            room.name, found.extents, room.extents, found.seen, found.evidence.anchor_kind, found.evidence.fallbacks
        );
        for p in &found.evidence.planes {
            println!(
                "      {:?} {} at {:.3} m rms {:.4} share {:.3}",
                p.surface, p.measured, p.distance_m, p.rms_m, p.share
            );
        }
        assert!(rotation <= 1.0, "{}: rotation off by {rotation:.2} degrees", room.name);
        assert!(centre <= 0.1, "{}: centre off by {centre:.3} m", room.name);
        for wall in &room.walls_visible {
            assert!(found.seen.contains(wall), "{}: {wall:?} wall is in view and was not found", room.name);
        }
        assert!(found.seen.contains(&Surface::Floor));
        assert!(found.extents.contains(found.camera.centre(), 0.0), "the camera is in the room");
    }
}
