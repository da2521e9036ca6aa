//! Compares a network of full size with the reference's outputs, or times it. Called by `cargo xtask parity`.
//!
//!     parity compare WEIGHTS EXPECTED     every output against the reference's, one line each
//!     parity time WEIGHTS EXPECTED        one pass for each line on stdin, with time and peak memory

#![expect(clippy::print_stdout, reason = "a program")]

use std::path::Path;
use std::time::Instant;

use harmony_nets::WeightFile;
use harmony_nets::cpu::Cpu;
use harmony_nets::vggt::{Frame, FrameGeometry, Heads, Vggt};

#[path = "measure/mod.rs"]
mod measure;

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

fn main() -> Outcome {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [mode, weights, expected] = arguments.as_slice() else {
        return Err("parity compare|time WEIGHTS EXPECTED".into());
    };
    let expected = WeightFile::open(Path::new(expected))?;
    let images = expected.find("full.images").ok_or("no images among the expected arrays")?;
    let [_, height, width, _] = *images.shape() else { return Err("images have four axes".into()) };
    let frames: Vec<Frame> = images
        .to_f32()
        .chunks_exact(height * width * 3)
        .map(|rgb| Frame { width, height, rgb: rgb.to_vec(), photo: [0, 0, width, height] })
        .collect();
    let start = Instant::now();
    let file = WeightFile::open(Path::new(weights))?;
    let backend = Cpu::new();
    let network = Vggt::load(&backend, &file.at(""))?;
    eprintln!("loaded in {:.2} s", start.elapsed().as_secs_f64());
    if mode == "compare" {
        let found = network.run(&backend, &frames, Heads { depth: true, points: true })?;
        return compare(&expected, &found);
    }
    measure::turns(|| Ok(network.run(&backend, &frames, Heads { depth: true, points: false })?.len()))
}

fn compare(expected: &WeightFile, found: &[FrameGeometry]) -> Outcome {
    let join = |f: &dyn Fn(&FrameGeometry) -> Vec<f32>| found.iter().flat_map(f).collect::<Vec<f32>>();
    let outputs = [
        ("pose_enc", join(&|f| f.pose.to_vec())),
        ("depth", join(&|f| f.depth.clone())),
        ("depth_conf", join(&|f| f.depth_confidence.clone())),
        ("world_points", join(&|f| f.points.concat())),
        ("world_points_conf", join(&|f| f.point_confidence.clone())),
    ];
    let mut good = true;
    for (name, values) in outputs {
        let wanted = expected.find(&format!("full.{name}")).ok_or("an output is missing")?.to_f32();
        if wanted.len() != values.len() {
            return Err(format!("{name}: {} values, wanted {}", values.len(), wanted.len()).into());
        }
        let square = |v: &[f32]| v.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>();
        let rms = (square(&wanted) / wanted.len() as f64).sqrt();
        let difference: Vec<f32> = wanted.iter().zip(&values).map(|(w, f)| w - f).collect();
        let relative = |(w, d): (&f32, &f32)| f64::from(d.abs()) / f64::from(w.abs()).max(rms);
        // NaN is the worst of all.
        let worst = wanted.iter().zip(&difference).map(relative).fold(0.0, |a, b| if b <= a { a } else { b });
        let l2 = (square(&difference) / square(&wanted)).sqrt();
        let low = wanted.iter().copied().fold(f32::INFINITY, f32::min);
        let high = wanted.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        println!("| VGGT-1B {name} | {} | {low:.3} to {high:.3} | {l2:.1e} | {worst:.1e} |", wanted.len());
        good &= worst <= 1e-4;
    }
    if good { Ok(()) } else { Err("a head is off by more than 1e-4".into()) }
}
