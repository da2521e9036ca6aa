//! Maps as estimators and sensors write them.

use glam::{DMat3, DVec3, Vec3};
use image::{ImageBuffer, Luma};

use harmony_testing::shared;

use super::*;

fn options(width: u32, height: u32) -> PointMapOptions {
    PointMapOptions::new(ImageSize::new(width, height))
}

/// A slanted wall seen by a camera with the given lens and pose: (points, planar depth).
fn slanted_wall(size: ImageSize, k: Intrinsics, rotation: DMat3, translation: DVec3) -> (Vec<Vec3>, Vec<f32>) {
    let mut depth = Vec::new();
    let mut points = Vec::new();
    for y in 0..size.height {
        for x in 0..size.width {
            let d = k.direction(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            // z = 3 + 0.4 x in the camera's frame.
            let z = 3.0 / (1.0 - 0.4 * d.x);
            depth.push(z as f32);
            points.push((rotation.transpose() * (d * z - translation)).as_vec3());
        }
    }
    (points, depth)
}

fn pose() -> (DMat3, DVec3) {
    (DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(-0.2), DVec3::new(0.3, -0.5, 1.0))
}

fn entries(points: &[Vec3], lead: &[usize], size: ImageSize, k: [f64; 4], pose: (DMat3, DVec3)) -> Vec<NpyEntry> {
    let shape = |tail: &[usize]| [lead, tail].concat();
    let rows = pose.0.transpose();
    let (h, w) = (size.height as usize, size.width as usize);
    vec![
        NpyEntry::f32("world_points", &shape(&[h, w, 3]), points.iter().flat_map(glam::Vec3::to_array)),
        NpyEntry::f32("world_points_conf", &shape(&[h, w]), points.iter().map(|_| 2.5)),
        NpyEntry::f32(
            "intrinsic",
            &shape(&[3, 3]),
            [k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, 1.0].map(|v| v as f32),
        ),
        NpyEntry::f32(
            "extrinsic",
            &shape(&[3, 4]),
            [rows.x_axis.extend(pose.1.x), rows.y_axis.extend(pose.1.y), rows.z_axis.extend(pose.1.z)]
                .iter()
                .flat_map(|r| r.as_vec4().to_array()),
        ),
    ]
}

#[test]
fn a_saved_map_comes_back_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("1_layout/points.npz");
    let size = ImageSize::new(37, 28);
    let k = Intrinsics { fx: 30.0, fy: 31.0, cx: 18.0, cy: 14.5 };
    let (rotation, translation) = pose();
    let (mut xyz, _) = slanted_wall(size, k, rotation, translation);
    xyz[5] = Vec3::NAN;
    let mut confidence = vec![1.25; xyz.len()];
    confidence[5] = 0.0;
    let map = PointMap { kind: PointMapKind::RoomBox, size, xyz, confidence, intrinsics: k, rotation, translation };
    save_point_map(&file, &map).unwrap();
    // The file says that its centres are at one half: asking for integer centres must not shift them.
    let asked = PointMapOptions { pixel_centres: PixelCentres::Integer, ..options(370, 280) };
    let back = load_point_map(&file, &asked).unwrap();
    assert_eq!(back.kind, PointMapKind::RoomBox);
    assert_eq!((back.size, back.intrinsics, back.rotation, back.translation), (size, k, rotation, translation));
    assert_eq!(back.confidence, map.confidence);
    assert!(back.xyz.iter().zip(&map.xyz).enumerate().all(|(i, (a, b))| (i == 5 && a.is_nan()) || a == b));
}

#[test]
fn vggt_predictions_with_leading_axes_and_integer_centres_project_to_pixel_centres() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("predictions.npz");
    let size = ImageSize::new(56, 42);
    let k = Intrinsics { fx: 50.0, fy: 50.0, cx: 28.0, cy: 21.0 };
    let (points, _) = slanted_wall(size, k, pose().0, pose().1);
    // VGGT's convention: the centre of the top-left pixel is (0, 0), so its principal point is half a pixel less.
    let two: Vec<Vec3> = points.iter().map(|p| *p + 9.0).chain(points.iter().copied()).collect();
    for (lead, frame, points) in [(vec![], 0, points.clone()), (vec![1], 0, points.clone()), (vec![1, 2], 1, two)] {
        let n = lead.iter().product::<usize>();
        let mut all = entries(&points, &lead, size, [50.0, 50.0, 27.5, 20.5], pose());
        if n == 2 {
            // Both frames have the same camera.
            let one = entries(&points, &[], size, [50.0, 50.0, 27.5, 20.5], pose());
            let repeat = |e: &NpyEntry| e.clone();
            all = vec![all[0].clone(), repeat(&one[2]), repeat(&one[3])];
        }
        npz::write_npz(&file, &all).unwrap();
        let asked = PointMapOptions { pixel_centres: PixelCentres::Integer, frame, ..options(560, 420) };
        let map = load_point_map(&file, &asked).unwrap();
        assert_eq!(map.kind, PointMapKind::Relative);
        assert!((map.intrinsics.cx - 28.0).abs() <= 1e-6 && (map.intrinsics.cy - 21.0).abs() <= 1e-6);
        let p = map.rotation * map.at(10, 7).unwrap() + map.translation;
        assert!((50.0 * p.x / p.z + 28.0 - 10.5).abs() <= 1e-4);
        assert!((50.0 * p.y / p.z + 21.0 - 7.5).abs() <= 1e-4);
    }
}

#[test]
fn depth_in_an_archive_gives_the_same_points_as_the_point_map() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("depth.npz");
    let size = ImageSize::new(56, 42);
    let k = Intrinsics { fx: 50.0, fy: 52.0, cx: 27.0, cy: 22.0 };
    let (points, depth) = slanted_wall(size, k, pose().0, pose().1);
    let mut all = entries(&points, &[], size, [50.0, 52.0, 27.0, 22.0], pose());
    all[0] = NpyEntry::f32("depth", &[1, 42, 56, 1], depth);
    all.remove(1);
    npz::write_npz(&file, &all).unwrap();
    let map = load_point_map(&file, &options(56, 42)).unwrap();
    let worst = map.xyz.iter().zip(&points).map(|(a, b)| (*a - *b).length()).fold(0.0, f32::max);
    assert!(worst <= 1e-4, "{worst}");
}

#[test]
fn missing_intrinsics_are_found_from_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("points.npz");
    let size = ImageSize::new(80, 60);
    let k = Intrinsics { fx: 70.0, fy: 71.0, cx: 41.0, cy: 29.0 };
    let (mut points, _) = slanted_wall(size, k, DMat3::IDENTITY, DVec3::ZERO);
    for p in points.iter_mut().step_by(17) {
        *p = Vec3::new(p.x + 0.4, p.y, p.z); // some wrong points
    }
    let all = [NpyEntry::f32("points", &[60, 80, 3], points.iter().flat_map(glam::Vec3::to_array))];
    npz::write_npz(&file, &all).unwrap();
    let got = load_point_map(&file, &options(160, 120)).unwrap().intrinsics;
    assert!((got.fx - 70.0).abs() <= 0.05 && (got.fy - 71.0).abs() <= 0.05, "{got:?}");
    assert!((got.cx - 41.0).abs() <= 0.05 && (got.cy - 29.0).abs() <= 0.05, "{got:?}");
}

#[test]
fn padded_and_cropped_maps_are_laid_onto_the_photo() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("points.npz");
    // A wide photo, 4:3, padded to a square of 56: rows 7 to 49 are photo.
    let square = ImageSize::new(56, 56);
    let k = Intrinsics { fx: 50.0, fy: 50.0, cx: 28.0, cy: 28.0 };
    let (points, _) = slanted_wall(square, k, pose().0, pose().1);
    npz::write_npz(&file, &entries(&points, &[], square, [50.0, 50.0, 28.0, 28.0], pose())).unwrap();
    let map = load_point_map(&file, &options(1600, 1200)).unwrap();
    assert_eq!(map.size, ImageSize::new(56, 42));
    assert!((map.intrinsics.cy - 21.0).abs() <= 1e-6);
    assert_eq!(map.xyz[0], points[7 * 56]);
    // A tall photo, 3:4: nothing tells whether it was padded or cropped.
    let tall = options(1200, 1600);
    assert!(matches!(load_point_map(&file, &tall), Err(PointsError::Aspect { .. })));
    let map = load_point_map(&file, &PointMapOptions { fit: MapFit::Cropped, ..tall }).unwrap();
    // 56 * 4/3 = 74.7, to the patch: 70 rows; 7 above and below have no points.
    assert_eq!(map.size, ImageSize::new(56, 70));
    assert!((map.intrinsics.cy - 35.0).abs() <= 1e-6);
    assert_eq!(map.at(0, 6), None);
    assert_eq!(map.xyz[7 * 56], points[0]);
    let map = load_point_map(&file, &PointMapOptions { fit: MapFit::Padded, ..tall }).unwrap();
    assert_eq!(map.size, ImageSize::new(42, 56));
}

#[test]
fn sixteen_bit_depth_images_are_metres_with_holes() {
    let folder = tempfile::tempdir().unwrap();
    let image: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::from_fn(64, 48, |x, y| {
        Luma([if x == 3 {
            0
        } else if y == 4 {
            65_535
        } else {
            5000 + x as u16
        }])
    });
    let k = parse_intrinsics("50,51,32,24").unwrap();
    for name in ["depth.png", "depth.pgm"] {
        let file = folder.path().join(name);
        image.save(&file).unwrap();
        let map = load_point_map(&file, &PointMapOptions { intrinsics: Some(k), ..options(64, 48) }).unwrap();
        assert_eq!(map.kind, PointMapKind::Metric);
        assert_eq!((map.at(3, 10), map.at(10, 4)), (None, None));
        assert!((map.at(10, 10).unwrap().z - 5.010).abs() <= 1e-5);
        // TUM's scale, and a photo of twice the size: the lens is scaled to the map.
        let asked = PointMapOptions {
            intrinsics: Some(k.resized(ImageSize::new(64, 48), ImageSize::new(128, 96))),
            depth_scale: Some(5000.0),
            ..options(128, 96)
        };
        let map = load_point_map(&file, &asked).unwrap();
        assert!((map.at(10, 10).unwrap().z - 1.002).abs() <= 1e-5);
        assert!((map.intrinsics.fx - 50.0).abs() <= 1e-9);
        assert!(matches!(load_point_map(&file, &options(64, 48)), Err(PointsError::NoIntrinsics)));
    }
}

#[test]
fn wrong_files_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let size = ImageSize::new(56, 42);
    let k = Intrinsics { fx: 50.0, fy: 50.0, cx: 28.0, cy: 21.0 };
    let (points, _) = slanted_wall(size, k, pose().0, pose().1);
    let good = entries(&points, &[], size, [50.0, 50.0, 28.0, 21.0], pose());
    let write = |name: &str, all: &[NpyEntry]| {
        let file = folder.path().join(name);
        npz::write_npz(&file, all).unwrap();
        load_point_map(&file, &options(56, 42)).unwrap_err()
    };
    let inverse = (pose().0.transpose(), -(pose().0.transpose() * pose().1));
    let mut all = good.clone();
    all[3] = entries(&points, &[], size, [50.0, 50.0, 28.0, 21.0], inverse)[3].clone();
    let error = write("inverse.npz", &all);
    assert!(matches!(error, PointsError::Inconsistent { .. } | PointsError::TooFew { .. }), "{error}");
    let mut all = good.clone();
    all[3] = NpyEntry::f32("extrinsic", &[3, 4], [0.0; 12]);
    assert!(matches!(write("zero.npz", &all), PointsError::NotRigid { .. }));
    let mut all = good.clone();
    all[2] = NpyEntry::f32("intrinsic", &[3, 3], [f32::NAN; 9]);
    assert!(matches!(write("nan.npz", &all), PointsError::Implausible { .. }));
    let mut all = good.clone();
    all[1] = NpyEntry::f32("confidence", &[4, 4], [1.0; 16]);
    assert!(matches!(write("conf.npz", &all), PointsError::Shape { .. }));
    assert!(matches!(write("none.npz", &good[2..]), PointsError::NoPoints { .. }));
    let nowhere = [NpyEntry::f32("points", &[42, 56, 3], vec![f32::NAN; 42 * 56 * 3])];
    assert!(matches!(write("empty.npz", &nowhere), PointsError::TooFew { .. }));
    let grey = folder.path().join("grey.png");
    image::GrayImage::new(32, 32).save(&grey).unwrap();
    assert!(matches!(load_point_map(&grey, &options(32, 32)), Err(PointsError::NotDepth { .. })));
    assert!(matches!(load_point_map(Path::new("x.obj"), &options(9, 9)), Err(PointsError::UnknownFormat { .. })));
    for text in ["", "1,2,3", "a,b,c,d", "1,2,3,4,5", "nan,1,1,1", "-5,5,1,1"] {
        assert!(parse_intrinsics(text).is_err_and(|e| e.hint().is_some()), "{text}");
    }
}

#[test]
fn recorded_sensor_depth_loads() {
    let cases = [
        ("rgbd/nyu_basement_00000", "518.8579,519.46961,325.58245,253.73617", None),
        ("rgbd/tum_fr3_office", "535.4,539.2,320.1,247.6", Some(5000.0)),
        ("rgbd/home_dining_1", "518,519,325.5,253.5", None),
    ];
    for (stem, lens, scale) in cases {
        let found = ["_depth.png", "_depth.pgm"].iter().find_map(|end| shared(&format!("{stem}{end}")));
        let Some(file) = found else { continue };
        let asked = PointMapOptions {
            intrinsics: Some(parse_intrinsics(lens).unwrap()),
            depth_scale: scale,
            pixel_centres: PixelCentres::Integer,
            ..options(640, 480)
        };
        let map = load_point_map(&file, &asked).unwrap();
        let mut depths: Vec<f32> = map.xyz.iter().filter(|p| p.is_finite()).map(|p| p.z).collect();
        depths.sort_by(f32::total_cmp);
        let median = depths[depths.len() / 2];
        assert!((0.5..8.0).contains(&median), "{stem}: median depth {median} m is that of a room");
    }
}

#[test]
fn a_synthetic_room_of_another_project_loads_by_frame() {
    let Some(file) = shared("rgbd/pi3_room/condition.npz") else { return };
    for frame in [0, 7] {
        let asked = PointMapOptions { frame, ..options(434, 350) };
        let map = load_point_map(&file, &asked).unwrap();
        assert_eq!(map.size, ImageSize::new(434, 350));
        assert!((map.rotation.determinant() - 1.0).abs() <= 1e-4);
    }
    let asked = PointMapOptions { frame: 8, ..options(434, 350) };
    assert!(matches!(load_point_map(&file, &asked), Err(PointsError::NoSuchFrame { count: 8, .. })));
}

#[test]
fn true_depth_of_a_benchmark_room_lies_on_its_floor() {
    let Some(file) = shared("gt/bedroom_01/depth.png") else { return };
    let text = std::fs::read_to_string(file.with_file_name("camera.json")).unwrap();
    let camera: serde_json::Value = serde_json::from_str(&text).unwrap();
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let k = Intrinsics {
        fx: number(&camera["K"][0][0]),
        fy: number(&camera["K"][1][1]),
        cx: number(&camera["K"][0][2]),
        cy: number(&camera["K"][1][2]),
    };
    let map = load_point_map(&file, &PointMapOptions { intrinsics: Some(k), ..options(960, 720) }).unwrap();
    let vector = |v: &serde_json::Value| DVec3::new(number(&v[0]), number(&v[1]), number(&v[2]));
    let r = &camera["R"];
    let rotation = DMat3::from_cols(vector(&r[0]), vector(&r[1]), vector(&r[2])).transpose();
    let t = vector(&camera["t"]);
    let ids = image::open(file.with_file_name("instances.png")).unwrap().to_luma8();
    let mut heights = Vec::new();
    for (i, id) in ids.as_raw().iter().enumerate() {
        if *id == 1 {
            heights.push((rotation.transpose() * (map.xyz[i].as_dvec3() - t)).y.abs());
        }
    }
    heights.sort_by(f64::total_cmp);
    assert!(heights.len() > 1000);
    // Depth is rounded to millimetres.
    assert!(heights[heights.len() / 2] <= 0.001, "median height {} m", heights[heights.len() / 2]);
}
