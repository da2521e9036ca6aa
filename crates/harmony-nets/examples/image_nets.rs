//! SAM 2, CLIP, OWLv2 and LPIPS at full size: against arrays from PyTorch, and the time they take.
//!
//! ```text
//! image_nets parity NET FOLDER [DEVICE]  compares with the arrays that tests/parity/{sam2,clip,owlv2,lpips_nets}.py left
//!                                        in FOLDER
//! image_nets time NET FOLDER [ROUNDS] [DEVICE]
//! image_nets turns NET FOLDER            one pass for each line on stdin, with time and peak memory: the encoder of SAM 2
//!                                        or CLIP on one image, OWLv2 on one image and four phrases
//! image_nets profile NET FOLDER DEVICE   kernels of one pass, the longest first
//! ```
//!
//! DEVICE is `cpu`, or with the feature `cuda` also `cuda` (large layers in bf16) and `cuda-f32`.
//! NET is `sam2_tiny`, `sam2_small`, `sam2_base_plus`, `sam2_large`, `clip`, `owlv2_base`, `owlv2_large` or `lpips`.
//! Threads: `RAYON_NUM_THREADS`.

#![expect(clippy::print_stdout, reason = "a program")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

#[cfg(feature = "cuda")]
use harmony_nets::NetError;
use harmony_nets::clip::{ClipConfig, ClipImageEncoder, TextTower};
use harmony_nets::cpu::Cpu;
use harmony_nets::detector::{Owlv2, Owlv2Config, Owlv2Size};
use harmony_nets::lpips::{Lpips, LpipsNet};
use harmony_nets::resample::Pixels;
use harmony_nets::sam2::{Label, MaskLogits, Masks, Prompt, Sam2, Sam2Config, Sam2Size, logits_at, preprocess};
use harmony_nets::{Backend, DType, WeightFile};
use image::RgbImage;
use rayon::prelude::*;

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Largest difference that is let through, relative to the largest value of an output; in bf16 the relative L2 error.
const LIMIT: f64 = 1e-4;
const LIMIT_BF16: f64 = 2e-2;

#[path = "measure/mod.rs"]
mod measure;
#[path = "../tests/it/image_nets/seeded.rs"]
mod seeded;

use seeded::{photo, uniform};

fn main() -> ExitCode {
    match run(&std::env::args().skip(1).collect::<Vec<_>>()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

fn run(args: &[String]) -> Outcome<bool> {
    let [mode, net, folder, rest @ ..] = args else {
        return Err("usage: image_nets parity|time|turns|profile NET FOLDER [ROUNDS] [DEVICE]".into());
    };
    let (rounds, device) = match rest {
        [] => (3, "cpu"),
        [one] => one.parse().map_or((3, one.as_str()), |rounds| (rounds, "cpu")),
        [rounds, device, ..] => (rounds.parse()?, device.as_str()),
    };
    let folder = PathBuf::from(folder);
    match device {
        "cpu" => work(mode, net, &folder, rounds, device, &Arc::new(Cpu::default())),
        #[cfg(feature = "cuda")]
        "cuda" | "cuda-f32" => {
            let kind = if device == "cuda" { DType::BF16 } else { DType::F32 };
            let cuda = Arc::new(harmony_nets::cuda::Cuda::open(0)?.computing_in(kind));
            if mode == "profile" {
                let ((), kernels) = cuda.profiled(|| {
                    // The first pass compiles kernels and chooses algorithms: the second is looked at.
                    time(net, &folder, &cuda, 1)
                        .map_err(|e| NetError::Device { device: net.into(), reason: e.to_string() })
                })?;
                let sum: f64 = kernels.iter().map(|k| k.1 as f64 * k.2).sum();
                println!("{sum:.2} ms in kernels, loading included");
                for (name, count, ms) in kernels.iter().take(25) {
                    println!("{:9.3} ms = {count:5} x {ms:7.4}  {name}", *count as f64 * ms);
                }
                return Ok(true);
            }
            let good = work(mode, net, &folder, rounds, device, &cuda)?;
            println!("device memory at most {} MiB", cuda.memory().1 >> 20);
            Ok(good)
        }
        other => Err(format!("no such device here: {other}").into()),
    }
}

fn work<B: Backend>(
    mode: &str,
    net: &str,
    folder: &Path,
    rounds: usize,
    device: &str,
    backend: &Arc<B>,
) -> Outcome<bool> {
    match mode {
        "parity" => {
            let mut report =
                Report { net: format!("{net} {device}"), good: true, bf16: backend.preferred() == DType::BF16 };
            compare(net, folder, backend, &mut report)?;
            Ok(report.good)
        }
        "time" => time(net, folder, backend, rounds).map(|()| true),
        "turns" => turns(net, folder, backend).map(|()| true),
        other => Err(format!("no such mode: {other}").into()),
    }
}

/// Prints a line an output.
struct Report {
    net: String,
    good: bool,
    bf16: bool,
}

impl Report {
    fn line(&mut self, what: &str, found: &[f32], wanted: &WeightFile) -> Outcome {
        let wanted =
            wanted.find(what).ok_or_else(|| format!("no array {what} in {}", wanted.path().display()))?.to_f32();
        if found.len() != wanted.len() {
            return Err(format!("{what}: {} values instead of {}", found.len(), wanted.len()).into());
        }
        let largest = wanted.iter().fold(0f64, |m, v| m.max(f64::from(v.abs())));
        let off = |i: usize| (f64::from(found[i]) - f64::from(wanted[i])).abs();
        // Not-a-number sorts last, so that it is the worst.
        let worst = (0..found.len()).max_by(|i, j| off(*i).total_cmp(&off(*j))).unwrap_or(0);
        let square = |v: f64| v * v;
        let l2 = (0..found.len()).map(|i| square(off(i))).sum::<f64>()
            / wanted.iter().map(|v| square(f64::from(*v))).sum::<f64>();
        let (relative, l2) = (off(worst) / largest, l2.sqrt());
        let good = if self.bf16 { l2 <= LIMIT_BF16 } else { relative <= LIMIT };
        self.good &= good;
        println!(
            "| {} | {what} | {} | {relative:.1e} | {worst}: {:.6} for {:.6} | {l2:.1e} |{}",
            self.net,
            found.len(),
            found[worst],
            wanted[worst],
            if good { "" } else { " TOO FAR" },
        );
        Ok(())
    }
}

fn compare<B: Backend>(net: &str, folder: &Path, backend: &Arc<B>, report: &mut Report) -> Outcome {
    match net.split_once('_').unwrap_or((net, "")) {
        ("sam2", size) => sam2(size, folder, backend, report),
        ("clip", _) => clip(folder, backend, report),
        ("owlv2", size) => owlv2(size, folder, backend, report),
        ("lpips", _) => lpips(folder, backend, report),
        _ => Err(format!("no such network: {net}").into()),
    }
}

fn load_sam2<B: Backend>(size: &str, folder: &Path, backend: Arc<B>) -> Outcome<Sam2<B>> {
    let weights = WeightFile::open(&folder.join(format!("sam2.1_hiera_{size}.pt")))?;
    let size = Sam2Size::from_name(size).ok_or("sizes are tiny, small, base_plus, large")?;
    Ok(Sam2::load(backend, &weights.at("model"), Sam2Config::of(size))?)
}

fn sam2<B: Backend>(size: &str, folder: &Path, backend: &Arc<B>, report: &mut Report) -> Outcome {
    let wanted = WeightFile::open(&folder.join(format!("sam2_{size}.safetensors")))?;
    let net = load_sam2(size, folder, backend.clone())?;
    let image = net.encode(&photo(480, 320))?;
    report.line("image_embed", &backend.read(&image.embedding)?, &wanted)?;
    report.line("high_res0", &backend.read(&image.finest)?, &wanted)?;
    report.line("high_res1", &backend.read(&image.fine)?, &wanted)?;
    let bounds = [11.0, 7.5, 60.25, 40.0].map(|v| v * 5.0);
    let points = vec![([100.0, 105.0], Label::Inside), ([352.5, 40.0], Label::Outside)];
    let prompts = [
        ("box", Prompt::from_box(bounds)),
        ("points", Prompt { points: points.clone(), ..Prompt::default() }),
        ("both", Prompt { points, ..Prompt::from_box(bounds) }),
    ];
    for (name, prompt) in prompts {
        for (tag, masks) in [("best", Masks::Best), ("multi", Masks::Three)] {
            let found = net.predict(&image, std::slice::from_ref(&prompt), masks)?.remove(0);
            let ious: Vec<f32> = found.iter().map(|m| m.iou).collect();
            report.line(&format!("{name}.{tag}.iou"), &ious, &wanted)?;
            let low: Vec<f32> = found.iter().flat_map(|m| m.logits.clone().for_reuse().values).collect();
            report.line(&format!("{name}.{tag}.low"), &low, &wanted)?;
            if (name, tag) == ("box", "best") {
                report.line("box.best.masks", &logits_at(&found[0].logits, 480, 320), &wanted)?;
            }
        }
    }
    // The mask of the round before is PyTorch's, so that differences do not add up over rounds.
    let before = wanted.find("both.multi.low").ok_or("no array both.multi.low")?.to_f32();
    let side = 4 * net.config().cells();
    let mask = Some(MaskLogits { side, values: before[..side * side].to_vec() });
    let refined = net.predict(&image, &[Prompt { mask, ..Prompt::from_box(bounds) }], Masks::Best)?.remove(0);
    report.line("refined.low", &refined[0].logits.clone().for_reuse().values, &wanted)?;
    let raw = net.predict_raw(&image, &[Prompt::from_box(bounds)])?.remove(0);
    let all: Vec<f32> = raw.masks.iter().flat_map(|m| m.logits.values.clone()).collect();
    report.line("all.masks", &all, &wanted)?;
    report.line("all.score", &[raw.object_score], &wanted)
}

/// What the scripts feed: `[3, side, side]` by channels.
fn pixels(index: usize, side: usize) -> Pixels {
    let planes = uniform(&format!("pixels{index}"), 3 * side * side);
    let at = |i: usize| (0..3).map(move |c| c * side * side + i);
    let data = (0..side * side).flat_map(at).map(|i| planes[i] * 1.7).collect();
    Pixels { width: side, height: side, data }
}

/// Rows of ids up to and with the first end mark.
fn ids(wanted: &WeightFile, length: usize, end: u32) -> Outcome<Vec<Vec<u32>>> {
    let all = wanted.find("ids").ok_or("no array ids")?.to_f32();
    let row = |row: &[f32]| {
        let row: Vec<u32> = row.iter().map(|id| *id as u32).collect();
        let stop = row.iter().position(|id| *id == end).map_or(row.len(), |i| i + 1);
        row[..stop].to_vec()
    };
    Ok(all.chunks_exact(length).map(row).collect())
}

const END: u32 = 49_407;

fn clip<B: Backend>(folder: &Path, backend: &Arc<B>, report: &mut Report) -> Outcome {
    use harmony_nets::backend::Act;
    use harmony_nets::clip::Layout;
    use harmony_nets::params::Params;

    let wanted = WeightFile::open(&folder.join("clip_full.safetensors"))?;
    let weights = WeightFile::open(&folder.join("model.safetensors"))?;
    let config = ClipConfig::vit_b32();
    let images = ClipImageEncoder::load(backend.clone(), &weights, &config)?;
    report.line("image_embeds", &images.embed_pixels(&[pixels(0, 224), pixels(1, 224)])?.concat(), &wanted)?;
    // The text tower without a tokenizer: its vocabulary is not here.
    let p = Params::new(&**backend, &weights, backend.preferred());
    let tower = TextTower::load(&p, config.text, Layout::Transformers)?;
    let projection = p.linear_without_bias("text_projection", config.features, config.text.width)?;
    let pooled = tower.pooled(&**backend, &ids(&wanted, 77, END)?)?;
    let features = backend.read(&backend.linear(&pooled, &projection, Act::None, None)?)?;
    report.line("text_embeds", &features, &wanted)
}

fn load_owlv2<B: Backend>(size: &str, folder: &Path, backend: Arc<B>) -> Outcome<Owlv2<B>> {
    let weights = WeightFile::open(&folder.join("model.safetensors"))?;
    let size = if size == "large" { Owlv2Size::Large } else { Owlv2Size::Base };
    Ok(Owlv2::load(backend, &weights, Owlv2Config::of(size))?)
}

fn owlv2<B: Backend>(size: &str, folder: &Path, backend: &Arc<B>, report: &mut Report) -> Outcome {
    let wanted = WeightFile::open(&folder.join(format!("owlv2_{size}.safetensors")))?;
    let net = load_owlv2(size, folder, backend.clone())?;
    let image = net.encode_pixels(pixels(0, net.config().vision.image_size))?;
    report.line("boxes", image.boxes.as_flattened(), &wanted)?;
    let phrases = net.embed_text(&ids(&wanted, 16, END)?)?;
    report.line("text_embeds", &phrases.concat(), &wanted)?;
    report.line("logits", &net.logits(&image, &phrases)?.concat(), &wanted)
}

/// The second picture of the script: mirrored, its upper half inverted.
fn changed(photo: &RgbImage) -> RgbImage {
    let mut other = image::imageops::flip_horizontal(photo);
    let half = photo.height() / 2;
    for (_, y, pixel) in other.enumerate_pixels_mut() {
        if y < half {
            pixel.0 = pixel.0.map(|v| 255 - v);
        }
    }
    other
}

fn load_lpips<B: Backend>(net: LpipsNet, folder: &Path, backend: Arc<B>) -> Outcome<Lpips<B>> {
    let trunk = if net == LpipsNet::Alex { "alexnet.pth" } else { "vgg16.pth" };
    let trunk = WeightFile::open(&folder.join(trunk))?;
    let heads = WeightFile::open(&folder.join(format!("lpips_v0.1_{}_linear.pth", net.name())))?;
    Ok(Lpips::load(backend, &trunk, &heads, net)?)
}

fn lpips<B: Backend>(folder: &Path, backend: &Arc<B>, report: &mut Report) -> Outcome {
    let wanted = WeightFile::open(&folder.join("lpips_full.safetensors"))?;
    let a = photo(512, 384);
    let b = changed(&a);
    for net in [LpipsNet::Alex, LpipsNet::Vgg] {
        let found = load_lpips(net, folder, backend.clone())?.distance(&a, &b)?;
        let layers: Vec<f32> = found.layers.iter().map(|v| *v as f32).collect();
        report.line(&format!("{}.layers", net.name()), &layers, &wanted)?;
        report.line(&format!("{}.value", net.name()), &[found.value as f32], &wanted)?;
    }
    Ok(())
}

/// A pass for each line on stdin, from normalised pixels to values on the host.
fn turns<B: Backend>(net: &str, folder: &Path, backend: &Arc<B>) -> Outcome {
    match net.split_once('_').unwrap_or((net, "")) {
        ("sam2", size) => {
            let net = load_sam2(size, folder, backend.clone())?;
            let photo = photo(1280, 960);
            let pixels = preprocess(&photo, net.config().image_size);
            measure::turns(|| {
                let image = net.encode_pixels(pixels.clone(), photo.dimensions())?;
                Ok(backend.read(&image.embedding)?.len())
            })
        }
        ("clip", _) => {
            let weights = WeightFile::open(&folder.join("model.safetensors"))?;
            let net = ClipImageEncoder::load(backend.clone(), &weights, &ClipConfig::vit_b32())?;
            let pixels = [pixels(0, 224)];
            measure::turns(|| Ok(net.embed_pixels(&pixels)?.len()))
        }
        ("owlv2", size) => {
            let net = load_owlv2(size, folder, backend.clone())?;
            let wanted = WeightFile::open(&folder.join(format!("owlv2_{size}.safetensors")))?;
            let ids = ids(&wanted, 16, END)?;
            let pixels = pixels(0, net.config().vision.image_size);
            measure::turns(|| {
                let image = net.encode_pixels(pixels.clone())?;
                Ok(net.logits(&image, &net.embed_text(&ids)?)?.len())
            })
        }
        _ => Err(format!("no timing of {net}").into()),
    }
}

/// Boxes of a photo of 1280 x 960: rows and columns of them, as many as furniture of a full room.
fn boxes() -> Vec<Prompt> {
    let at = |i: usize| {
        let (x, y) = ((i % 6) as f64 * 200.0 + 20.0, (i / 6) as f64 * 180.0 + 30.0);
        Prompt::from_box([x, y, x + 190.0, y + 160.0])
    };
    (0..30).map(at).collect()
}

fn middle(mut seconds: Vec<f64>) -> f64 {
    seconds.sort_by(f64::total_cmp);
    seconds.get(seconds.len() / 2).copied().unwrap_or(f64::NAN) * 1e3
}

/// Medians in milliseconds over `rounds`, the first two passes not counted; every pass ends with values on the host.
fn time<B: Backend>(net: &str, folder: &Path, backend: &Arc<B>, rounds: usize) -> Outcome {
    let start = Instant::now();
    let seconds = |start: Instant| start.elapsed().as_secs_f64();
    let rounds = 0..rounds + 2;
    let mut parts = Vec::<(String, Vec<f64>)>::new();
    let mut note = |round: usize, name: &str, value: f64| {
        if round < 2 {
            return;
        }
        match parts.iter_mut().find(|p| p.0 == name) {
            Some(part) => part.1.push(value),
            None => parts.push((name.to_owned(), vec![value])),
        }
    };
    match net.split_once('_').unwrap_or((net, "")) {
        ("sam2", size) => {
            let net = load_sam2(size, folder, backend.clone())?;
            println!("load_s {:.3}", seconds(start));
            // A CPU takes a second a box.
            let count = if backend.preferred() == DType::BF16 { 30 } else { 2 };
            let (photo, boxes) = (photo(1280, 960), &boxes()[..count]);
            let pixels = preprocess(&photo, net.config().image_size);
            for round in rounds {
                let pixels = pixels.clone();
                let start = Instant::now();
                let image = net.encode_pixels(pixels, photo.dimensions())?;
                backend.read(&backend.slice(&image.finest, 1, 0, 1)?)?;
                note(round, "encode", seconds(start));
                let start = Instant::now();
                net.predict(&image, &boxes[..1], Masks::Best)?;
                note(round, "one box", seconds(start));
                let start = Instant::now();
                let masks = net.predict(&image, boxes, Masks::Best)?;
                note(round, &format!("{count} boxes"), seconds(start));
                let start = Instant::now();
                let full: Vec<Vec<bool>> = masks.par_iter().map(|m| above(&m[0].logits, 1280, 960)).collect();
                note(round, &format!("{count} masks of 1280 x 960"), seconds(start));
                if full.iter().any(|m| m.len() != 1280 * 960) {
                    return Err("a mask of another size".into());
                }
                let start = Instant::now();
                let image = net.encode(&photo)?;
                let masks = net.predict(&image, boxes, Masks::Best)?;
                let full: Vec<Vec<bool>> = masks.par_iter().map(|m| above(&m[0].logits, 1280, 960)).collect();
                note(round, &format!("photo to {count} masks"), seconds(start));
                drop(full);
            }
        }
        ("clip", _) => {
            let weights = WeightFile::open(&folder.join("model.safetensors"))?;
            let net = ClipImageEncoder::load(backend.clone(), &weights, &ClipConfig::vit_b32())?;
            println!("load_s {:.3}", seconds(start));
            let images: Vec<Pixels> = (0..16).map(|i| pixels(i % 2, 224)).collect();
            for round in rounds {
                let start = Instant::now();
                net.embed_pixels(&images[..1])?;
                note(round, "one image", seconds(start));
                let start = Instant::now();
                net.embed_pixels(&images)?;
                note(round, "16 images", seconds(start));
            }
        }
        ("owlv2", size) => {
            let net = load_owlv2(size, folder, backend.clone())?;
            println!("load_s {:.3}", seconds(start));
            let wanted = WeightFile::open(&folder.join(format!("owlv2_{size}.safetensors")))?;
            let ids = ids(&wanted, 16, END)?;
            let many: Vec<Vec<u32>> = ids.iter().cycle().take(32).cloned().collect();
            let image = pixels(0, net.config().vision.image_size);
            for round in rounds {
                for (name, ids) in [("image and 4 phrases", &ids), ("image and 32 phrases", &many)] {
                    let image = image.clone();
                    let start = Instant::now();
                    let image = net.encode_pixels(image)?;
                    net.logits(&image, &net.embed_text(ids)?)?;
                    note(round, name, seconds(start));
                }
            }
        }
        _ => return Err(format!("no timing of {net}").into()),
    }
    for (name, values) in parts {
        println!("ours {net} {name}: {:.2} ms", middle(values));
    }
    println!("{}", measure::peak_memory());
    Ok(())
}

fn above(logits: &MaskLogits, width: u32, height: u32) -> Vec<bool> {
    logits_at(logits, width, height).into_iter().map(|v| v > 0.0).collect()
}
