//! How upright generated meshes are after de-tilting, on rooms with truth.
//!
//! `cargo run --release -p harmony-bench --example detilt -- ROOMS [noise] [seeds]`

#![allow(clippy::print_stdout, clippy::unwrap_used)] // prints a table

use std::path::Path;

use glam::{DMat3, DVec3};
use harmony_bench::metrics::icp::best_rigid;
use harmony_bench::oracle::{NoiseLevel, Oracle};
use harmony_bench::summary::quantile;
use harmony_bench::truth::{TruthRoom, rooms_in};

fn main() {
    let mut args = std::env::args().skip(1);
    let folder = args.next().expect("a folder of rooms");
    let level: NoiseLevel = args.next().unwrap_or_else(|| "real".into()).parse().unwrap();
    let seeds: u64 = args.next().map_or(1, |s| s.parse().unwrap());
    let mut errors: [Vec<f64>; 4] = Default::default();
    for room in rooms_in(Path::new(&folder)).unwrap() {
        let truth = TruthRoom::load(&room).unwrap();
        for seed in 1..=seeds {
            let oracle = Oracle::new(truth.clone(), level.noise(), seed, true);
            for object in truth.visible() {
                let generated = oracle.generated(object);
                let points = |m: &harmony_mesh::Mesh, k: f64| {
                    m.positions.iter().map(|p| p.as_dvec3() * k).collect::<Vec<DVec3>>()
                };
                let unit = generated.bounds().unwrap().size().length() / object.size.length();
                let Some(rigid) = best_rigid(&points(&object.mesh, 1.0), &points(&generated, 1.0 / unit)) else {
                    continue;
                };
                let (mesh, _) = harmony_mesh::clean(&generated, 80_000);
                let off = |turn: DMat3| (turn * rigid.rotation * DVec3::Y).y.clamp(-1.0, 1.0).acos().to_degrees();
                let by_pca = harmony_geometry::detilt(&points(&mesh, 1.0)).unwrap_or(DMat3::IDENTITY);
                let upright = harmony_mesh::upright(&mesh).turn;
                let mut stood = generated.clone();
                harmony_mesh::canonicalise(&mut stood, upright);
                harmony_mesh::stand(&mut stood);
                let unit = stood.bounds().unwrap().size().length() / object.size.length();
                let stood = best_rigid(&points(&object.mesh, 1.0), &points(&stood, 1.0 / unit));
                let left = stood.map_or(f64::NAN, |r| (r.rotation * DVec3::Y).y.clamp(-1.0, 1.0).acos().to_degrees());
                let row = [off(DMat3::IDENTITY), off(by_pca), off(upright), left];
                println!(
                    "{:<16} {:<18} tilted {:>5.1}  PCA {:>5.1}  by faces {:>5.1}  on its base {:>5.1}",
                    truth.name, object.id, row[0], row[1], row[2], row[3]
                );
                for (all, v) in errors.iter_mut().zip(row) {
                    all.push(v);
                }
            }
        }
    }
    for (name, v) in ["as generated", "PCA", "by faces", "on its base"].iter().zip(&errors) {
        let above = v.iter().filter(|e| **e > 3.0).count() as f64 / v.len() as f64;
        println!(
            "{name:<14} median {:.2}  90th {:.2}  worst {:.1} deg, above 3 deg {:.0} %",
            quantile(v, 0.5),
            quantile(v, 0.9),
            quantile(v, 1.0),
            100.0 * above
        );
    }
}
