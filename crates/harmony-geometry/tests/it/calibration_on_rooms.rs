//! Calibration of point maps made from rooms with known truth.
//!
//! The maps are made like a feed-forward estimator's: unknown scale, an arbitrary rigid frame, a smooth

//! multiplicative error of the depth, softened depth edges, no readings here and there.

#![allow(clippy::print_stdout, reason = "tests")]

use crate::common::{Room, angle_deg, gray, rooms};
use harmony_geometry::{
    AnchorKind, Calibration, CalibrationError, CalibrationMethod, CalibrationSettings, FocalPrior, LayoutPins,
    LayoutPrior, LineSegment, PinnedEdge, RIGHT_POSITION_M, RIGHT_ROTATION_DEG, RoomEdge, ViewEstimate, calibrate,
    calibrate_with_photo, estimate_view,
};
use harmony_scene::{Camera, Extents, ImageSize, Mat3, PointMap, PointMapKind, Similarity, Surface, Vec2, Vec3};

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

/// Rotation in degrees, and the distance of the camera centres as far as the seen walls fix it.
fn errors(found: &Calibration, room: &Room) -> (f64, f64) {
    let (c, t) = (found.camera.centre(), room.camera.centre());
    // Where only the right wall is seen, the left one (and with it x = 0) is the prior's guess.
    let from_right = !found.seen.contains(&Surface::Left) && found.seen.contains(&Surface::Right);
    let x = if from_right { (found.extents.width - c.x) - (room.extents.width - t.x) } else { c.x - t.x };
    let centre = Vec3::new(x, c.y - t.y, c.z - t.z).length();
    (angle_deg(found.camera.rotation, room.camera.rotation), centre)
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
        let (rotation, centre) = errors(&found, &room);
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

/// A sensor's map: metres are kept, and a wrong prior height is reported instead of believed.
#[test]
fn metric_maps_keep_their_scale() {
    for room in rooms() {
        let size = ImageSize::new(480, 480 * room.camera.size.height / room.camera.size.width);
        let map = point_map(
            &room,
            size,
            &Distortion { kind: PointMapKind::Metric, smooth: 0.0, grain: 0.004, frame: frame(1.0) },
        );
        let mut prior = prior(&room);
        prior.extents.height *= 1.1;
        let found = calibrate(&map, &prior, &CalibrationSettings::default()).unwrap();
        let (rotation, centre) = errors(&found, &room);
        println!("{}: rotation {rotation:.3} deg, centre {centre:.3} m, {:?}", room.name, found.evidence.height_ratio);
        assert!((found.room_from_points.scale - 1.0).abs() <= 1e-12);
        assert!(rotation <= 0.3, "{}: {rotation:.3} degrees", room.name);
        // A glass door fills a wall of one room: what the map has there is the pane, 0.096 m behind the wall.
        assert!(centre <= 0.1, "{}: {centre:.3} m", room.name);
        if let Some(ratio) = found.evidence.height_ratio {
            assert!((ratio * 1.1 - 1.0).abs() <= 0.01, "{}: height ratio {ratio:.3}", room.name);
        }
    }
}

/// Any rigid frame and scale of the same map gives the same camera.
#[test]
fn the_frame_of_the_map_does_not_matter() {
    let Some(room) = rooms().into_iter().next() else { return };
    let size = ImageSize::new(320, 240);
    let at = |frame| {
        let map =
            point_map(&room, size, &Distortion { kind: PointMapKind::Relative, smooth: 0.002, grain: 0.0, frame });
        calibrate(&map, &prior(&room), &CalibrationSettings::default()).unwrap()
    };
    let plain = at(Similarity::IDENTITY);
    for scale in [0.02, 1.7, 40.0] {
        let moved = at(frame(scale));
        assert!(angle_deg(plain.camera.rotation, moved.camera.rotation) <= 0.05);
        assert!(plain.camera.centre().distance(moved.camera.centre()) <= 0.01, "scale {scale}");
        // The anchor lands where the box says, exactly.
        let e = moved.extents;
        let corner = moved.anchor;
        assert!(corner.y == 0.0 && [0.0, e.width].iter().any(|x| (corner.x - x).abs() <= 1e-9));
        assert_eq!(moved.evidence.anchor_kind, AnchorKind::FloorCorner);
    }
}

/// Noise without any surface: the prior's camera stands in, and it says so.
#[test]
fn a_shapeless_map_falls_back_to_the_prior() {
    let size = ImageSize::new(160, 120);
    let mut seed = 1u32;
    let depth: Vec<f32> = (0..size.pixels())
        .map(|_| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            1.0 + (seed >> 16) as f32 / 65536.0 * 3.0
        })
        .collect();
    let map = PointMap::from_depth(
        PointMapKind::Relative,
        size,
        harmony_scene::Intrinsics::from_horizontal_fov(size, 1.1),
        &depth,
    );
    let mut prior = LayoutPrior::unknown(ImageSize::new(1600, 1200));
    prior.camera.height_m = Some(1.4);
    prior.camera.tilt_deg = Some(12.0);
    let found = calibrate(&map, &prior, &CalibrationSettings::default()).unwrap();
    assert_ne!(found.evidence.method, CalibrationMethod::Manhattan);
    assert!(!found.evidence.fallbacks.is_empty());
    assert_eq!(found.confidence(), None, "nobody knows how far it is off");
    assert!((found.camera.centre().y - 1.4).abs() <= 1e-6);
    assert!((-found.camera.forward().y.asin().to_degrees() - 12.0).abs() <= 1e-6);
    // The similarity carries the map's camera onto this one.
    let centre = found.room_from_points.point(map.camera_centre());
    assert!(centre.distance(found.camera.centre()) <= 1e-9);
}

/// Where the map shows no surface, the photo's lines give the directions, and it says so.
#[test]
fn a_shapeless_map_takes_its_directions_from_the_photo() {
    for room in rooms() {
        let distortion = Distortion { kind: PointMapKind::Relative, smooth: 0.05, grain: 0.4, frame: frame(0.4) };
        let map = point_map(&room, ImageSize::new(518, 392), &distortion);
        let focal_px = room.camera.intrinsics.fx * 1.02;
        let view = estimate_view(&gray(&room.folder.join("photo.jpg")), Some(FocalPrior { focal_px, sigma: 0.03 }));
        let settings = CalibrationSettings::default();
        let alone = calibrate(&map, &prior(&room), &settings).unwrap();
        let (found, _) = calibrate_with_photo(&map, &prior(&room), &view, &settings).unwrap();
        let (before, after) = (errors(&alone, &room).0, errors(&found, &room).0);
        println!("{}: rotation {before:.1} -> {after:.2} deg, {:?}", room.name, found.evidence.fallbacks);
        assert_ne!(found.evidence.method, CalibrationMethod::Manhattan, "{}", room.name);
        assert!(before > 3.0 && after <= 1.5, "{}: {before:.2} -> {after:.2} deg", room.name);
        assert!(found.evidence.fallbacks.iter().any(|f| f.contains("lines")), "{}", room.name);
    }
}

/// Where the map's surfaces are turned against what is seen, because its depths slope across the image, the photo's lines
/// overrule them.
#[test]
fn a_map_that_is_turned_against_the_photo_gives_way_to_its_lines() {
    let (size, unit) = (ImageSize::new(518, 392), 0.4);
    let mut overruled = 0;
    for (room, slope) in
        rooms().iter().flat_map(|room| [[0.3, 0.0], [-0.8, 0.0], [0.0, 0.5]].map(|slope| (room, slope)))
    {
        let distortion = Distortion { kind: PointMapKind::Relative, smooth: 0.0, grain: 0.0, frame: frame(unit) };
        let mut map = point_map(room, size, &distortion);
        let eye = map.camera_centre();
        for (i, p) in map.xyz.iter_mut().enumerate() {
            let (x, y) = (i as u32 % size.width, i as u32 / size.width);
            let at = [f64::from(x) / f64::from(size.width) - 0.5, f64::from(y) / f64::from(size.height) - 0.5];
            let ray = p.as_dvec3() - eye;
            // 1 / depth changes evenly over the image, so that planes stay planes: by `slope` over its width at 4 m.
            let by = (slope[0] * at[0] + slope[1] * at[1]) * (map.rotation * ray).z / unit / 4.0;
            *p = (eye + ray / (1.0 + by).max(0.1)).as_vec3();
        }
        let focal_px = room.camera.intrinsics.fx * 1.02;
        let view = estimate_view(&gray(&room.folder.join("photo.jpg")), Some(FocalPrior { focal_px, sigma: 0.03 }));
        let prior = LayoutPrior { pins: pins_off(room, 0.005), ..prior(room) };
        let settings = CalibrationSettings::default();
        let alone = calibrate(&map, &prior, &settings).unwrap();
        let (found, _) = calibrate_with_photo(&map, &prior, &view, &settings).unwrap();
        let (before, after) = (errors(&alone, room).0, errors(&found, room).0);
        println!("{} {slope:?}: rotation {before:.1} -> {after:.2} deg", room.name);
        assert!(before > 5.0 && after <= 1.0, "{} {slope:?}: {before:.2} -> {after:.2} deg", room.name);
        overruled += usize::from(found.evidence.fallbacks.iter().any(|f| f.contains("not that of the photo's lines")));
    }
    assert!(overruled > 3 || rooms().is_empty(), "{overruled}");
}

/// Two points of each room edge that is in the image, off by some share of the image's width, one up, the next down.
fn pins_off(room: &Room, by: f64) -> LayoutPins {
    let Extents { width: w, height: h, depth: d } = room.extents;
    let ends = |edge| match edge {
        RoomEdge::FloorBack => (Vec3::ZERO, Vec3::new(w, 0.0, 0.0)),
        RoomEdge::FloorLeft => (Vec3::ZERO, Vec3::new(0.0, 0.0, d)),
        RoomEdge::FloorRight => (Vec3::new(w, 0.0, 0.0), Vec3::new(w, 0.0, d)),
        RoomEdge::CeilingBack => (Vec3::new(0.0, h, 0.0), Vec3::new(w, h, 0.0)),
        RoomEdge::CeilingLeft => (Vec3::new(0.0, h, 0.0), Vec3::new(0.0, h, d)),
        RoomEdge::CeilingRight => (Vec3::new(w, h, 0.0), Vec3::new(w, h, d)),
        RoomEdge::BackLeft => (Vec3::ZERO, Vec3::new(0.0, h, 0.0)),
        RoomEdge::BackRight => (Vec3::new(w, 0.0, 0.0), Vec3::new(w, h, 0.0)),
    };
    let off = by * f64::from(room.camera.size.width);
    let mut sign = 1.0;
    let mut edges = Vec::new();
    for edge in RoomEdge::ALL {
        let (a, b) = ends(edge);
        let seen: Vec<Vec2> = (0..=40)
            .filter_map(|i| room.camera.project(a.lerp(b, f64::from(i) / 40.0)))
            .filter(|p| room.camera.contains(*p))
            .collect();
        if let (Some(first), Some(last)) = (seen.first(), seen.last())
            && first.distance(*last) > 0.1 * f64::from(room.camera.size.width)
        {
            let across = (*last - *first).perp().normalize();
            let points = [*first, *last]
                .map(|p| {
                    sign = -sign;
                    p + across * (off * sign)
                })
                .to_vec();
            edges.push(PinnedEdge { edge, points });
        }
    }
    LayoutPins { edges }
}

/// Where the map shows no surface and the pins are rough as well, its depths and the photo's lines still find the room:
/// of those whose ceiling is in view, which gives the scale.
#[test]
fn a_shapeless_map_and_rough_pins_still_give_the_room() {
    for room in rooms() {
        let distortion = Distortion { kind: PointMapKind::Relative, smooth: 0.08, grain: 0.2, frame: frame(0.4) };
        let map = point_map(&room, ImageSize::new(518, 392), &distortion);
        let focal_px = room.camera.intrinsics.fx * 1.02;
        let view = estimate_view(&gray(&room.folder.join("photo.jpg")), Some(FocalPrior { focal_px, sigma: 0.03 }));
        let prior = LayoutPrior { pins: pins_off(&room, 0.02), ..prior(&room) };
        let (found, _) = calibrate_with_photo(&map, &prior, &view, &CalibrationSettings::default()).unwrap();
        let (rotation, centre) = errors(&found, &room);
        println!("{}: rotation {rotation:.2} deg, centre {centre:.3} m, ceiling {}", room.name, room.ceiling_visible);
        assert_ne!(found.evidence.method, CalibrationMethod::Manhattan, "{}", room.name);
        assert!(rotation <= 1.0, "{}: {rotation:.2} deg", room.name);
        assert!(!room.ceiling_visible || centre <= 0.2, "{}: {centre:.3} m", room.name);
        // Which lines are the edges' was a guess there, and is passed on as one.
        let smooth = Distortion { kind: PointMapKind::Relative, smooth: 0.02, grain: 0.01, frame: frame(0.4) };
        let map = point_map(&room, ImageSize::new(518, 392), &smooth);
        let pins = pins_off(&room, 0.008);
        let prior = LayoutPrior { pins, ..prior };
        let (sure, _) = calibrate_with_photo(&map, &prior, &view, &CalibrationSettings::default()).unwrap();
        // ln left, ln right, logit floor, ln back.
        let held = |c: &Calibration| {
            c.posterior.as_ref().map(|p| [4, 5, 6, 7].map(|i| p.information[i * 10 + i]).iter().sum::<f64>())
        };
        let (guessed, sure) = (held(&found).unwrap(), held(&sure).unwrap());
        println!("{}: information {guessed:.0}, of a smooth map {sure:.0}", room.name);
        assert!(guessed < sure / 4.0, "{}: {guessed} {sure}", room.name);
    }
}

/// A map whose focal length is off by a few percent does not keep the camera there.
#[test]
fn a_focal_length_that_is_off_is_corrected() {
    let mut off = Vec::new();
    for room in rooms() {
        for share in [0.93, 0.95, 1.05, 1.07] {
            let distortion = Distortion { kind: PointMapKind::Relative, smooth: 0.02, grain: 0.01, frame: frame(0.4) };
            let map = point_map(&room, ImageSize::new(518, 392), &distortion);
            let map = map.with_focal(share * map.intrinsics.fx);
            let focal_px = share * room.camera.intrinsics.fx;
            let view = estimate_view(&gray(&room.folder.join("photo.jpg")), Some(FocalPrior { focal_px, sigma: 0.03 }));
            let prior = LayoutPrior { pins: pins_off(&room, 0.008), ..prior(&room) };
            let (found, _) = calibrate_with_photo(&map, &prior, &view, &CalibrationSettings::default()).unwrap();
            let truth = room.camera.resized(found.camera.size).intrinsics.fx;
            let error = (found.camera.intrinsics.fx / truth - 1.0).abs();
            println!("{}: focal length {share:.2} -> {:.1} % off", room.name, 100.0 * error);
            off.push(error);
        }
    }
    // Where two walls are seen, one nearly from the front (the kitchen), directions say little of the lens.
    off.sort_by(f64::total_cmp);
    let (middle, worst) = (off.get(off.len() / 2).copied(), off.last().copied());
    assert!(middle.is_none_or(|m| m <= 0.02) && worst.is_none_or(|w| w <= 0.055), "{off:?}");
}

#[test]
fn empty_maps_and_broken_maps_are_errors() {
    let size = ImageSize::new(64, 48);
    let k = harmony_scene::Intrinsics::from_horizontal_fov(size, 1.1);
    let mut map = PointMap::from_depth(PointMapKind::Metric, size, k, &vec![0.0; size.pixels()]);
    let (prior, settings) = (LayoutPrior::unknown(size), CalibrationSettings::default());
    assert!(matches!(calibrate(&map, &prior, &settings), Err(CalibrationError::TooFewPoints { got: 0, .. })));
    map.xyz.pop();
    assert!(matches!(calibrate(&map, &prior, &settings), Err(CalibrationError::BadMap { .. })));
    let mut bad = prior;
    bad.extents.height = f64::NAN;
    map.xyz.push(glam::Vec3::NAN);
    assert!(matches!(calibrate(&map, &bad, &settings), Err(CalibrationError::BadPrior { .. })));
}

/// A small empty box, seen with its floor, its ceiling and two walls.
fn empty_box() -> Room {
    let extents = Extents { width: 3.4, height: 2.5, depth: 3.6 };
    let size = ImageSize::new(800, 600);
    let lens = harmony_scene::Intrinsics::from_horizontal_fov(size, 1.3);
    let camera = Camera::looking(size, lens, Vec3::new(2.1, 1.5, 3.3), Vec3::new(-0.25, -0.12, -1.0));
    let depth = |x: u32, y: u32| {
        let ray = camera.ray(Vec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        extents.exit(&ray).map_or(0.0, |(_, at)| camera.depth(at)) as f32
    };
    let depth_m =
        (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y))).map(|(x, y)| depth(x, y)).collect();
    let (name, folder) = ("box".to_owned(), std::path::PathBuf::new());
    Room {
        name,
        folder,
        camera,
        extents,
        walls_visible: vec![Surface::Back, Surface::Left],
        ceiling_visible: true,
        depth_m,
    }
}

/// The joints of tiles of half a metre on floor and back wall, as segments of the photo.
fn joints(room: &Room) -> Vec<(LineSegment, Option<u8>)> {
    let Extents { width, height, depth } = room.extents;
    let steps = |length: f64| (1..(length / 0.5) as u32).map(|k| 0.5 * f64::from(k));
    let along_depth = steps(width).map(|x| (Vec3::new(x, 0.0, 0.0), Vec3::new(x, 0.0, depth), 2));
    let across = steps(depth).map(|z| (Vec3::new(0.0, 0.0, z), Vec3::new(width, 0.0, z), 0));
    let upright = steps(width).map(|x| (Vec3::new(x, 0.0, 0.0), Vec3::new(x, height, 0.0), 1));
    let seen = |(a, b, axis): (Vec3, Vec3, u8)| {
        let inside = |k: &i32| {
            let p = room.camera.project(a.lerp(b, f64::from(*k) / 40.0))?;
            room.camera.contains(p).then_some(p)
        };
        let points: Vec<Vec2> = (0..=40).filter_map(|k| inside(&k)).collect();
        let (start, end) = (*points.first()?, *points.last()?);
        (start.distance(end) > 40.0).then_some((LineSegment { start, end, strength: 1.0 }, Some(axis)))
    };
    along_depth.chain(across).chain(upright).filter_map(seen).collect()
}

/// A good map, good pins and lines make the camera sure, and it is right; a shapeless map alone does not.
#[test]
fn a_camera_is_sure_where_map_and_pins_are_good_and_not_where_there_is_hardly_any_evidence() {
    let room = empty_box();
    let found = |smooth: f64, grain: f64, prior: &LayoutPrior, lines: &Vec<(LineSegment, Option<u8>)>| {
        let distortion = Distortion { kind: PointMapKind::Relative, smooth, grain, frame: frame(0.4) };
        let map = point_map(&room, ImageSize::new(518, 392), &distortion);
        let mut view = ViewEstimate::from_hints(room.camera.size, room.camera.intrinsics, &prior.camera);
        view.segments = lines.clone();
        calibrate_with_photo(&map, prior, &view, &CalibrationSettings::default()).unwrap().0
    };
    let mut given = LayoutPrior { pins: pins_off(&room, 0.0005), ..prior(&room) };
    given.camera.height_m = Some(1.5);
    let good = found(0.004, 0.003, &given, &joints(&room));
    let (rotation, centre) = errors(&good, &room);
    println!("good: {rotation:.3} deg, {centre:.3} m, confidence {:?}", good.confidence());
    assert!(rotation <= RIGHT_ROTATION_DEG && centre <= RIGHT_POSITION_M, "{rotation} {centre}");
    assert!(good.confidence().is_some_and(|sure| sure > 0.9), "{:?}", good.confidence());
    let poor = found(0.1, 0.4, &prior(&room), &Vec::new());
    println!("poor: {:?}, confidence {:?}", errors(&poor, &room), poor.confidence());
    assert!(poor.confidence().is_some_and(|sure| sure < 0.5), "{:?}", poor.confidence());
}
