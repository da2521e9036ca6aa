//! Scores and times the metrics on raw files, for `bench/metrics_vs_scipy.sh`.
//!
//! - `metrics_bench make FOLDER POINTS` samples a procedural furnished room and a displaced copy of it into
//!   `truth.f64` and `prediction.f64` (little-endian x, y, z), and draws `render.png` and `target.png`;
//! - `metrics_bench score FOLDER` writes our distances (`from_prediction.f64`, `from_truth.f64`), resized pictures
//!   (`resized_WIDTHxHEIGHT.png`) and prints all numbers as JSON;
//! - `metrics_bench time FOLDER ROUNDS` prints `build query` in seconds, a line a round, for the truth as the index.

#![allow(clippy::print_stdout, reason = "a command-line program")]

use std::error::Error;
use std::f64::consts::{PI, TAU};
use std::fs;
use std::path::Path;
use std::time::Instant;

use glam::{DMat3, DVec3};
use harmony_bench::metrics::gen3dsr::{Distances, THRESHOLDS};
use harmony_bench::metrics::midi::{MidiOptions, midi_of_points};
use harmony_bench::metrics::nearest::NearestIndex;
use harmony_bench::metrics::picture::{pixel_loss, resize_bicubic};
use harmony_bench::metrics::sample::{Seed, sample_surface};
use harmony_bench::metrics::soup::Triangle;
use harmony_bench::metrics::two_way::two_way;
use harmony_scene::ImageSize;
use image::{Rgb, RgbImage};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Width, height, depth of the room, metres.
const ROOM: DVec3 = DVec3::new(5.2, 2.7, 4.8);
const OBJECTS: usize = 40;
/// ICP of the midi protocol takes its rounds on at most this many points of each set.
const MIDI_POINTS: usize = 100_000;
/// Sizes the target is resized to, besides the render's.
const SIZES: [(u32, u32); 5] = [(224, 224), (97, 311), (640, 480), (500, 100), (1, 1)];

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["make", folder, points] => make(Path::new(folder), points.parse()?),
        ["score", folder] => score(Path::new(folder)),
        ["time", folder, rounds] => time(Path::new(folder), rounds.parse()?),
        _ => Err("metrics_bench make FOLDER POINTS | score FOLDER | time FOLDER ROUNDS".into()),
    }
}

fn make(folder: &Path, count: usize) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(folder)?;
    let mut numbers = ChaCha8Rng::seed_from_u64(1);
    let (mut truth, mut prediction) = (Vec::new(), Vec::new());
    let shell = lattice(&|u, v| [u, 0.0, v], 1).into_iter().chain(lattice(&|u, v| [u, 1.0, v], 1));
    let shell = shell.chain(lattice(&|u, v| [u, v, 0.0], 1)).chain(lattice(&|u, v| [0.0, u, v], 1));
    for t in shell {
        truth.push(t.map(|p| p * ROOM));
        prediction.push(t.map(|p| p * ROOM * 1.01 + DVec3::splat(0.004)));
    }
    for i in 0..OBJECTS {
        let mut within = |low: f64, high: f64| low + (high - low) * numbers.random::<f64>();
        let half = DVec3::new(within(0.05, 0.5), within(0.05, 0.6), within(0.05, 0.4));
        let turn = DMat3::from_rotation_y(within(0.0, TAU));
        let place = DVec3::new(within(0.5, 4.7), half.y, within(0.5, 4.3));
        let (moved, grown) = (DVec3::new(within(-0.1, 0.1), 0.0, within(-0.1, 0.1)), within(0.9, 1.1));
        let shape = match i % 3 {
            0 => block(),
            1 => lattice(
                &|u, v| [(TAU * u).cos() * (PI * v).sin(), (PI * v).cos(), (TAU * u).sin() * (PI * v).sin()],
                24,
            ),
            _ => lattice(&|u, v| [(TAU * u).cos(), 2.0 * v - 1.0, (TAU * u).sin()], 24),
        };
        for t in shape {
            truth.push(t.map(|p| turn * (p * half) + place));
            prediction.push(t.map(|p| turn * (p * half * grown) + place + moved));
        }
    }
    for (name, soup, draw) in [("truth", truth, 0), ("prediction", prediction, 1)] {
        let sample = sample_surface(&soup, count, Seed { seed: 0, draw })?;
        write(&folder.join(name).with_extension("f64"), sample.points.iter().flat_map(DVec3::to_array))?;
    }
    for (name, width, height) in [("render", 512, 384), ("target", 813, 611)] {
        let mut noise = || numbers.random_range(0..60_u32);
        let picture = RgbImage::from_fn(width, height, |x, y| {
            Rgb([x * 200 / width, y * 200 / height, (x / 16 + y / 16) % 2 * 190].map(|v| (v + noise()) as u8))
        });
        picture.save(folder.join(name).with_extension("png"))?;
    }
    Ok(())
}

fn score(folder: &Path) -> Result<(), Box<dyn Error>> {
    let (prediction, truth) = (read(&folder.join("prediction.f64"))?, read(&folder.join("truth.f64"))?);
    let ways = two_way(&prediction, &truth)?;
    write(&folder.join("from_prediction.f64"), ways.from_prediction.iter().copied())?;
    write(&folder.join("from_truth.f64"), ways.from_truth.iter().copied())?;
    let some = |points: &[DVec3]| -> Vec<DVec3> {
        points.iter().copied().step_by(points.len().div_ceil(MIDI_POINTS)).collect()
    };
    let midi = midi_of_points(&some(&prediction), &some(&truth), &MidiOptions::default())?;
    let picture = |name: &str| Ok::<_, image::ImageError>(image::open(folder.join(name))?.into_rgb8());
    let (render, target) = (picture("render.png")?, picture("target.png")?);
    for (width, height) in SIZES.into_iter().chain([render.dimensions()]) {
        let resized = resize_bicubic(&target, ImageSize::new(width, height)).ok_or("an empty picture")?;
        resized.save(folder.join(format!("resized_{width}x{height}.png")))?;
    }
    let numbers = serde_json::json!({
        "gen3dsr": Distances::of(&ways, &THRESHOLDS),
        "midi": midi,
        "midi_step": [prediction.len().div_ceil(MIDI_POINTS), truth.len().div_ceil(MIDI_POINTS)],
        "pixel_loss": pixel_loss(&render, &target),
    });
    println!("{}", serde_json::to_string(&numbers)?);
    Ok(())
}

fn time(folder: &Path, rounds: usize) -> Result<(), Box<dyn Error>> {
    let (prediction, truth) = (read(&folder.join("prediction.f64"))?, read(&folder.join("truth.f64"))?);
    for _ in 0..rounds {
        let start = Instant::now();
        let index = NearestIndex::build(&truth)?;
        let built = start.elapsed().as_secs_f64();
        let distances = index.distances(&prediction)?;
        let all = start.elapsed().as_secs_f64();
        println!("{built:.6} {:.6}", all - built);
        drop(distances);
    }
    Ok(())
}

/// A surface over the unit square as triangles, `n` cells a side.
fn lattice(surface: &dyn Fn(f64, f64) -> [f64; 3], n: usize) -> Vec<Triangle> {
    let at = |i: usize, j: usize| DVec3::from_array(surface(i as f64 / n as f64, j as f64 / n as f64));
    (0..n * n)
        .flat_map(|k| {
            let (i, j) = (k % n, k / n);
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
            [[a, b, c], [b, d, c]]
        })
        .collect()
}

/// The cube [-1, 1].
fn block() -> Vec<Triangle> {
    let side = |axis: usize, at: f64| {
        lattice(
            &move |u, v| {
                let mut p = [at; 3];
                (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (2.0 * u - 1.0, 2.0 * v - 1.0);
                p
            },
            1,
        )
    };
    (0..3).flat_map(|axis| [side(axis, -1.0), side(axis, 1.0)]).flatten().collect()
}

fn read(path: &Path) -> Result<Vec<DVec3>, Box<dyn Error>> {
    let bytes = fs::read(path)?;
    let numbers: Result<Vec<f64>, _> = bytes.chunks_exact(8).map(|b| b.try_into().map(f64::from_le_bytes)).collect();
    Ok(numbers?.chunks_exact(3).map(DVec3::from_slice).collect())
}

fn write(path: &Path, values: impl Iterator<Item = f64>) -> std::io::Result<()> {
    fs::write(path, values.flat_map(f64::to_le_bytes).collect::<Vec<u8>>())
}
