//! Calibration of real (and two synthetic) depth frames without any pins: the room's axes against planes that are

//! fitted here, and against the poses that came with the frames.

#![allow(clippy::print_stdout, reason = "tests")]

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DQuat, DVec3};
use harmony_geometry::{
    CalibrationSettings, FocalPrior, GrayImage, LayoutPrior, calibrate_with_photo, estimate_view, percentile,
};
use harmony_io::{PixelCentres, PointMapOptions, load_photo, load_point_map};
use harmony_scene::{ImageSize, Intrinsics, PointMap};

/// Camera to world; `None` where the frame has no pose.
type Pose = Option<DMat3>;

struct Frame {
    sequence: &'static str,
    photo: PathBuf,
    depth: PathBuf,
    unit: f64,
    lens: [f64; 4],
    pose: Pose,
}

fn numbers(line: &str) -> Vec<f64> {
    line.split_whitespace().map(|v| v.parse().unwrap()).collect()
}

/// Line `k` (from 1) of a file of `tx ty tz qx qy qz qw`.
fn of_quaternion(file: &Path, k: usize) -> DMat3 {
    let text = std::fs::read_to_string(file).unwrap();
    let v = numbers(text.lines().nth(k - 1).unwrap());
    DMat3::from_quat(DQuat::from_xyzw(v[3], v[4], v[5], v[6]).normalize())
}

fn of_matrix(file: &Path) -> DMat3 {
    let v = numbers(&std::fs::read_to_string(file).unwrap());
    DMat3::from_mat4(DMat4::from_cols_array(&v.try_into().unwrap()).transpose())
}

fn frames(folder: &Path) -> Vec<Frame> {
    let mut out = Vec::new();
    for k in ["000000", "000300", "000600"] {
        out.push(Frame {
            sequence: "7-Scenes kitchen",
            photo: folder.join(format!("7scenes_kitchen_{k}.color.jpg")),
            depth: folder.join(format!("7scenes_kitchen_{k}.depth.png")),
            unit: 1000.0,
            lens: [585.0, 585.0, 320.0, 240.0],
            pose: Some(of_matrix(&folder.join(format!("7scenes_kitchen_{k}.pose.txt")))),
        });
    }
    for k in [1, 3, 5] {
        out.push(Frame {
            sequence: "home dining",
            photo: folder.join(format!("home_dining_{k}_rgb.png")),
            depth: folder.join(format!("home_dining_{k}_depth.pgm")),
            unit: 1000.0,
            lens: [518.0, 519.0, 325.5, 253.5],
            pose: Some(of_quaternion(&folder.join("home_dining_pose.txt"), k)),
        });
    }
    for k in [1, 3] {
        // The published focal length has a minus before its y: the poses' y axis looks up.
        let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0));
        out.push(Frame {
            sequence: "ICL-NUIM living (synthetic)",
            photo: folder.join(format!("iclnuim_living_{k}_rgb.png")),
            depth: folder.join(format!("iclnuim_living_{k}_depth.png")),
            unit: 5000.0,
            lens: [481.2, 480.0, 319.5, 239.5],
            pose: Some(of_quaternion(&folder.join("iclnuim_living_pose.txt"), k) * flip),
        });
    }
    for k in ["00000", "00050", "00100"] {
        out.push(Frame {
            sequence: "NYU basement",
            photo: folder.join(format!("nyu_basement_{k}_rgb.jpg")),
            depth: folder.join(format!("nyu_basement_{k}_depth.png")),
            unit: 1000.0,
            lens: [518.857_9, 519.469_61, 325.582_45, 253.736_17],
            pose: None,
        });
    }
    for (sequence, name, kind, unit, lens) in [
        ("TUM fr3 office", "tum_fr3_office", "png", 5000.0, [535.4, 539.2, 320.1, 247.6]),
        ("Augmented ICL-NUIM", "aug_iclnuim_chair", "jpg", 1000.0, [525.0, 525.0, 319.5, 239.5]),
    ] {
        out.push(Frame {
            sequence,
            photo: folder.join(format!("{name}_rgb.{kind}")),
            depth: folder.join(format!("{name}_depth.png")),
            unit,
            lens,
            pose: None,
        });
    }
    out
}

/// The plane with most points within 1.5 % of their depth, among those whose normal has `along` in this range:
/// its unit normal (towards the camera) and its share of the points. By random triples, then least squares.
fn plane(map: &PointMap, up: DVec3, along: std::ops::RangeInclusive<f64>) -> Option<(DVec3, f64)> {
    let points: Vec<DVec3> = map.xyz.iter().step_by(23).filter(|p| p.is_finite()).map(|p| p.as_dvec3()).collect();
    let mut state = 7u64;
    let mut pick = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        points[(state >> 33) as usize % points.len()]
    };
    let on = |n: DVec3, d: f64| points.iter().filter(move |p| (n.dot(**p) - d).abs() < 0.015 * p.z);
    let mut best: Option<(DVec3, f64, usize)> = None;
    for _ in 0..3000 {
        let (a, b, c) = (pick(), pick(), pick());
        let n = (b - a).cross(c - a).normalize_or_zero();
        let n = if n.dot(a) > 0.0 { -n } else { n };
        if n == DVec3::ZERO || !along.contains(&n.dot(up)) {
            continue;
        }
        let count = on(n, n.dot(a)).count();
        if best.is_none_or(|b| count > b.2) {
            best = Some((n, n.dot(a), count));
        }
    }
    let (mut n, mut d, mut count) = best?;
    for _ in 0..5 {
        let members: Vec<DVec3> = on(n, d).copied().collect();
        let mean = members.iter().sum::<DVec3>() / members.len() as f64;
        let mut scatter = nalgebra::Matrix3::zeros();
        for p in &members {
            let v = *p - mean;
            let v = nalgebra::Vector3::new(v.x, v.y, v.z);
            scatter += v * v.transpose();
        }
        let eigen = scatter.symmetric_eigen();
        let v = eigen.eigenvectors.column(eigen.eigenvalues.imin());
        let fitted = DVec3::new(v[0], v[1], v[2]);
        n = if fitted.dot(mean) > 0.0 { -fitted } else { fitted };
        (d, count) = (n.dot(mean), members.len());
    }
    Some((n, count as f64 / points.len() as f64))
}

fn angle(turn: DMat3) -> f64 {
    ((turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees()
}

#[test]
fn room_axes_of_depth_frames_agree_with_planes_and_poses() {
    let Some(folder) = harmony_testing::shared("rgbd") else { return };
    let mut done: Vec<(&str, DMat3, Pose)> = Vec::new();
    let (mut floors, mut walls, mut poses) = (Vec::new(), Vec::new(), Vec::new());
    for frame in frames(&folder) {
        let photo = load_photo(&frame.photo).unwrap();
        let size = ImageSize::new(photo.image.width(), photo.image.height());
        let [fx, fy, cx, cy] = frame.lens;
        let options = PointMapOptions {
            intrinsics: Some(Intrinsics { fx, fy, cx, cy }),
            depth_scale: Some(frame.unit),
            pixel_centres: PixelCentres::Integer,
            ..PointMapOptions::new(size)
        };
        let map = load_point_map(&frame.depth, &options).unwrap();
        let gray = GrayImage::from_rgb8(size, photo.image.as_raw()).unwrap();
        let view = estimate_view(&gray, Some(FocalPrior { focal_px: fx, sigma: 0.02 }));
        let prior = LayoutPrior::unknown(size);
        let (c, _) = calibrate_with_photo(&map, &prior, &view, &CalibrationSettings::default()).unwrap();
        let (given, kept) = (map.intrinsics, c.camera.intrinsics);
        for (a, b) in [(given.fx, kept.fx), (given.fy, kept.fy), (given.cx, kept.cx), (given.cy, kept.cy)] {
            assert!((a - b).abs() < 1e-6, "{}: {given:?} became {kept:?}", frame.sequence);
        }
        let rotation = c.camera.rotation;
        let up = rotation * DVec3::Y;
        // Who holds a camera holds it about upright: what is under it is within 50 degrees of that.
        let floor = plane(&map, -DVec3::Y, 0.64..=1.0).filter(|p| p.1 > 0.1);
        let floor_deg = floor.map(|(n, _)| n.dot(up).clamp(-1.0, 1.0).acos().to_degrees());
        let wall = floor.and_then(|(n, _)| plane(&map, n, -0.1..=0.1)).filter(|p| p.1 > 0.15);
        let wall_deg = wall.map(|(n, _)| {
            let axes = [rotation * DVec3::X, rotation * DVec3::Z];
            axes.map(|a| n.dot(a).abs().clamp(0.0, 1.0).acos().to_degrees()).into_iter().fold(90.0, f64::min)
        });
        println!(
            "{:<28} {:?} {:?} support {:.2}: floor {floor_deg:.2?} deg of {:.0?} %, wall {wall_deg:.2?} deg of {:.0?} %",
            frame.sequence,
            c.evidence.method,
            c.evidence.fallbacks,
            c.evidence.axis_support,
            floor.map(|p| p.1 * 100.0),
            wall.map(|p| p.1 * 100.0),
        );
        floors.extend(floor_deg);
        walls.extend(wall_deg);
        for (sequence, other, pose) in &done {
            if let (true, Some(a), Some(b)) = (*sequence == frame.sequence, frame.pose, pose) {
                let truth = a.transpose() * *b;
                // Which wall is called the back wall may differ from frame to frame.
                let off = (0..4)
                    .map(|k| DMat3::from_rotation_y(f64::from(k) * std::f64::consts::FRAC_PI_2))
                    .map(|turn| angle((rotation * turn * other.transpose()).transpose() * truth))
                    .fold(180.0, f64::min);
                println!("{:<28} turn between two frames off by {off:.2} deg of {:.0}", "", angle(truth));
                poses.push(off);
            }
        }
        done.push((frame.sequence, rotation, frame.pose));
    }
    // A Kinect's depths alone bend planes by a degree or two; the frames are clutter at close range.
    for (name, v, most) in
        [("floors", &floors, [2.0, 5.0]), ("walls", &walls, [3.0, 7.0]), ("poses", &poses, [3.0, 5.0])]
    {
        let [median, worst] = [50.0, 100.0].map(|p| percentile(v, p).unwrap());
        println!("{name}: {} values, median {median:.2} deg, worst {worst:.2}", v.len());
        assert!(median <= most[0] && worst <= most[1], "{name}");
    }
    assert!(floors.len() >= 6 && walls.len() >= 6 && poses.len() == 7);
}
