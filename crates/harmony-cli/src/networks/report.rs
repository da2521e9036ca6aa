//! What `harmony doctor` says of devices and networks.

use std::time::Instant;

use harmony_models::{Store, table};
use harmony_nets::backend::{Act, Backend, LinearWeights};
use harmony_nets::clip::ClipConfig;
use harmony_nets::cpu::Cpu;
use harmony_nets::detector::{Owlv2Config, Owlv2Size};
use harmony_nets::sam2::{Sam2Config, Sam2Size};
use harmony_nets::vggt::VggtConfig;
use harmony_nets::{HostTensor, NetError};

use super::status::{Device, Expected, Status, weights};

/// Rows, inputs and outputs of the product that is timed: a feed-forward layer of VGGT for one photo.
const PRODUCT: [usize; 3] = [1041, 1024, 4096];
/// Runs of it; the best one counts, as others may be at work here.
const RUNS: usize = 3;
/// Rows and columns of patches of a photo of 4:3.
const PATCHES: [usize; 2] = [28, 37];

/// Devices, weights, expected times.
pub fn status(store: &Store) -> Status {
    let cpu = Cpu::new();
    let device = match speed(&cpu, RUNS) {
        Ok(speed) => Device { name: cpu.device(), operations_per_s: Some(speed), problem: None },
        Err(error) => Device { name: cpu.device(), operations_per_s: None, problem: Some(error.to_string()) },
    };
    let gpu = match gpu() {
        Ok((name, speed)) => Device { name, operations_per_s: Some(speed), problem: None },
        Err(why) => Device { name: "no GPU".to_owned(), operations_per_s: None, problem: Some(why) },
    };
    let devices = vec![device, gpu];
    let best = devices.iter().rev().find_map(|d| d.operations_per_s);
    let expected = |speed: f64| {
        let here = |id| table::find(id).is_some_and(|m| store.has(m).unwrap_or(false));
        let each = |(model, work, operations): (_, _, f64)| Expected {
            model,
            work,
            seconds: operations / speed,
            here: here(model),
        };
        work().into_iter().map(each).collect()
    };
    Status {
        absent: None,
        expected: best.map_or_else(Vec::new, expected),
        devices,
        folder: store.folder().to_path_buf(),
        weights: weights(store),
    }
}

/// Operations a second of a matrix product.
fn speed<B: Backend>(backend: &B, runs: usize) -> Result<f64, NetError> {
    let [rows, inputs, outputs] = PRODUCT;
    let values = |n: usize| (0..n).map(|i| ((i * 37 % 101) as f32 - 50.0) * 1e-3).collect::<Vec<f32>>();
    let dtype = backend.preferred();
    let weight = HostTensor::from_f32(&[outputs, inputs], values(outputs * inputs));
    let layer = backend.load_linear(&LinearWeights { weight, bias: None, scale: None }, dtype)?;
    let x = backend.load(&HostTensor::from_f32(&[rows, inputs], values(rows * inputs)), dtype)?;
    let mut best = f64::INFINITY;
    for _ in 0..=runs {
        let start = Instant::now();
        let y = backend.linear(&x, &layer, Act::None, None)?;
        backend.read(&backend.slice(&y, 0, 0, 1)?)?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok(2.0 * (rows * inputs * outputs) as f64 / best)
}

#[cfg(feature = "cuda")]
fn gpu() -> Result<(String, f64), String> {
    let cuda = harmony_nets::cuda::Cuda::open(0).map_err(|e| e.to_string())?;
    let (free, total) = cuda.device_memory().unwrap_or((0, 0));
    let speed = speed(&cuda, 10).map_err(|e| e.to_string())?;
    let driver = std::fs::read_to_string("/proc/driver/nvidia/version").unwrap_or_default();
    let driver =
        driver.split_whitespace().find(|w| w.split('.').count() >= 2 && w.starts_with(|c: char| c.is_ascii_digit()));
    let driver = driver.map_or_else(String::new, |d| format!(", driver {d}"));
    let gib = |bytes: usize| bytes as f64 / f64::from(1 << 30);
    let words = format!("{}{driver}, {:.1} of {:.1} GiB free", cuda.device(), gib(free), gib(total));
    Ok((words, speed))
}

#[cfg(not(feature = "cuda"))]
fn gpu() -> Result<(String, f64), String> {
    Err("this build has no CUDA (feature `cuda`)".to_owned())
}

/// Operations of a transformer: `blocks` of `tokens`, `width` wide, each token looking at `seen` others.
fn transformer(blocks: usize, tokens: usize, width: usize, seen: usize) -> f64 {
    // Queries, keys, values and output take 4 squares of the width, the feed-forward layers 8; two operations each.
    let products = 24.0 * (tokens * width * width) as f64;
    blocks as f64 * (products + 4.0 * (tokens * seen * width) as f64)
}

fn vggt() -> f64 {
    let c = VggtConfig::published();
    let patches = PATCHES[0] * PATCHES[1];
    let tokens = patches + 1 + c.registers;
    let trunk = transformer(c.embed_depth + 2 * c.depth, tokens, c.dim, tokens);
    // The depth head: 0.29 Tera-operations for 37 by 37 patches, nearly all of it convolutions of fixed width.
    trunk + 0.29e12 * patches as f64 / (37.0 * 37.0)
}

fn sam2(size: Sam2Size) -> f64 {
    let c = Sam2Config::of(size);
    let blocks: usize = c.stages.iter().sum();
    let mut sum = 0.0;
    let mut done = 0;
    for (stage, (count, width)) in c.stages.iter().zip(c.channels()).enumerate() {
        let tokens = ((c.image_size / 4) >> stage).pow(2);
        for block in done..done + count {
            let seen = if c.global_blocks.contains(&block) { tokens } else { c.windows[stage].pow(2) };
            sum += transformer(1, tokens, width, seen);
        }
        done += count;
    }
    debug_assert_eq!(done, blocks, "every block is in a stage");
    sum
}

fn owlv2(size: Owlv2Size) -> f64 {
    let c = Owlv2Config::of(size).vision;
    let tokens = c.grid() * c.grid() + 1;
    transformer(c.layers, tokens, c.width, tokens)
}

fn clip() -> f64 {
    let c = ClipConfig::vit_b32().vision;
    let tokens = c.grid() * c.grid() + 1;
    transformer(c.layers, tokens, c.width, tokens)
}

/// Models, what they do, and how many operations that takes.
fn work() -> Vec<(&'static str, &'static str, f64)> {
    vec![
        ("vggt-1b", "one photo", vggt()),
        ("sam2.1-large", "one photo, before its boxes", sam2(Sam2Size::Large)),
        ("sam2.1-base-plus", "one photo, before its boxes", sam2(Sam2Size::BasePlus)),
        ("sam2.1-small", "one photo, before its boxes", sam2(Sam2Size::Small)),
        ("sam2.1-tiny", "one photo, before its boxes", sam2(Sam2Size::Tiny)),
        ("owlv2-base", "one photo, whatever the phrases", owlv2(Owlv2Size::Base)),
        ("owlv2-large", "one photo, whatever the phrases", owlv2(Owlv2Size::Large)),
        ("clip-vit-b32", "one picture", clip()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_are_those_that_are_known() {
        // The trunk of VGGT takes 3.05 Tera-operations for 37 by 37 patches (computed for the reference sheet).
        let c = VggtConfig::published();
        let tokens = 37 * 37 + 5;
        let trunk = transformer(c.embed_depth + 2 * c.depth, tokens, c.dim, tokens);
        assert!((trunk / 3.05e12 - 1.0).abs() < 0.01, "{trunk:e}");
        // CLIP ViT-B/32: 4.4 Giga-multiply-adds a picture, its makers' code says.
        assert!((clip() / 8.8e9 - 1.0).abs() < 0.05, "{:e}", clip());
        assert!(sam2(Sam2Size::Large) > 2.0 * sam2(Sam2Size::BasePlus));
    }

    #[test]
    fn the_speed_of_this_machine_can_be_measured() {
        let speed = speed(&Cpu::new(), 1).expect("a product");
        assert!(speed.is_finite() && speed > 1e6, "{speed:e}");
    }
}
