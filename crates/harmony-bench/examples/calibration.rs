//! Camera errors of calibration alone, on rooms with truth: Algorithm 1, the photo's lines, and both with pins.
//!
//! `cargo run --release -p harmony-bench --example calibration -- ROOMS [noise] [seeds]`

#![allow(clippy::print_stdout, clippy::unwrap_used)] // prints a table

use std::path::Path;
use std::time::Instant;

use harmony_bench::oracle::{NoiseLevel, Oracle};
use harmony_bench::summary::quantile;
use harmony_bench::truth::{TruthRoom, rooms_in};
use harmony_geometry::{CalibrationSettings, FocalPrior, GrayImage, calibrate, calibrate_with_photo, estimate_view};
use harmony_scene::{Camera, Extents, ImageSize, Mat3, Vec3, Wall};

fn angle(a: Mat3, b: Mat3) -> f64 {
    let t = a * b.transpose();
    ((t.x_axis.x + t.y_axis.y + t.z_axis.z - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees()
}

/// By how many pixels the image of each room edge is off, in the mean over what is in the image.
fn edges_off(truth: &TruthRoom, camera: &Camera, extents: &Extents) -> String {
    type End = fn(&Extents) -> Vec3;
    let edges: [(&str, End, Vec3); 8] = [
        ("floor-back", |_| Vec3::ZERO, Vec3::X),
        ("floor-left", |_| Vec3::ZERO, Vec3::Z),
        ("floor-right", |e| Vec3::new(e.width, 0.0, 0.0), Vec3::Z),
        ("ceiling-back", |e| Vec3::new(0.0, e.height, 0.0), Vec3::X),
        ("ceiling-left", |e| Vec3::new(0.0, e.height, 0.0), Vec3::Z),
        ("ceiling-right", |e| Vec3::new(e.width, e.height, 0.0), Vec3::Z),
        ("back-left", |_| Vec3::ZERO, Vec3::Y),
        ("back-right", |e| Vec3::new(e.width, 0.0, 0.0), Vec3::Y),
    ];
    let mut out = Vec::new();
    for (name, end, along) in edges {
        let length = along.dot(Vec3::new(truth.extents.width, truth.extents.height, truth.extents.depth));
        let mut offs = Vec::new();
        for k in 0..100 {
            let t = along * (length * (f64::from(k) + 0.5) / 100.0);
            let Some(seen) = truth.camera.project(end(&truth.extents) + t).filter(|p| truth.camera.contains(*p)) else {
                continue;
            };
            let near = end(extents) + t;
            if let (Some(a), Some(b)) = (camera.project(near), camera.project(near + along * 0.05)) {
                offs.push((b - a).normalize_or_zero().perp_dot(seen - a));
            }
        }
        if !offs.is_empty() {
            out.push(format!("{name} {:.1}", offs.iter().sum::<f64>() / offs.len() as f64));
        }
    }
    out.join(", ")
}

fn main() {
    let mut args = std::env::args().skip(1);
    let folder = args.next().expect("a folder of rooms");
    let level: NoiseLevel = args.next().unwrap_or_else(|| "real".into()).parse().unwrap();
    let seeds: u64 = args.next().map_or(3, |s| s.parse().unwrap());
    let mut table: [[Vec<f64>; 3]; 2] = Default::default();
    for room in rooms_in(Path::new(&folder)).unwrap() {
        let truth = TruthRoom::load(&room).unwrap();
        let photo = harmony_io::load_photo(&truth.photo()).unwrap();
        let size = ImageSize::new(photo.image.width(), photo.image.height());
        let gray = GrayImage::from_rgb8(size, photo.image.as_raw()).unwrap();
        for seed in 1..=seeds {
            let oracle = Oracle::new(truth.clone(), level.noise(), seed, true);
            let map = oracle.point_map();
            let prior = oracle.layout_prior();
            let focal = map.intrinsics.resized(map.size, size).fx;
            let view = estimate_view(&gray, Some(FocalPrior { focal_px: focal, sigma: 0.02 }));
            let begun = Instant::now();
            let c = calibrate(&map, &prior, &CalibrationSettings::default()).unwrap();
            let first = begun.elapsed();
            let (joint, _) = calibrate_with_photo(&map, &prior, &view, &CalibrationSettings::default()).unwrap();
            let evidence = joint.evidence.joint;
            let both = begun.elapsed();
            let shift = |e: f64| {
                let only_right = truth.walls.contains(&Wall::Right) && !truth.walls.contains(&Wall::Left);
                if only_right { truth.extents.width - e } else { 0.0 }
            };
            let errors = |camera: &Camera, width: f64| {
                let camera = camera.resized(size);
                let mut centre = camera.centre();
                centre.x += shift(width);
                [
                    angle(camera.rotation, truth.camera.rotation),
                    centre.distance(truth.camera.centre()),
                    100.0 * (camera.intrinsics.fx / truth.camera.intrinsics.fx - 1.0).abs(),
                ]
            };
            let (a, b) = (errors(&c.camera, c.extents.width), errors(&joint.camera, joint.extents.width));
            let turned = |k: i32| Mat3::from_rotation_y(f64::from(k) * std::f64::consts::FRAC_PI_2);
            let lines = (0..4).map(|k| angle(view.rotation * turned(k), truth.camera.rotation)).fold(180.0, f64::min);
            println!(
                "{:<16} {seed}  Alg. 1 {:>6.2} deg {:.3} m {:.1} %   joint {:>6.2} deg {:.3} m {:.1} %   lines {lines:>5.2} deg  {:.0} + {:.0} ms  {:?} {:?} {:?}",
                truth.name,
                a[0],
                a[1],
                a[2],
                b[0],
                b[1],
                b[2],
                first.as_secs_f64() * 1e3,
                (both.as_secs_f64() - first.as_secs_f64()) * 1e3,
                evidence.map(|e| format!(
                    "{} cells {:.3}, pins {:.1} px, sigma {:.2} deg {:.3}",
                    e.cells,
                    e.depth_rms,
                    e.pin_rms_px.unwrap_or(f64::NAN),
                    e.sigma_rotation_deg,
                    e.sigma_focal
                )),
                joint.seen,
                joint.evidence.fallbacks,
            );
            if std::env::var_os("EDGES").is_some() {
                println!("    edges off, px: {}", edges_off(&truth, &joint.camera.resized(size), &joint.extents));
            }
            for i in 0..3 {
                table[0][i].push(a[i]);
                table[1][i].push(b[i]);
            }
        }
    }
    for (name, rows) in ["Algorithm 1", "joint"].iter().zip(&table) {
        let q = |i: usize| format!("{:.3} / {:.3}", quantile(&rows[i], 0.5), quantile(&rows[i], 0.9));
        println!("{name:<12} rotation {} deg  centre {} m  focal {} %", q(0), q(1), q(2));
    }
}
