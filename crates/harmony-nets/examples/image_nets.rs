//! SAM 2, CLIP, OWLv2 and LPIPS at full size: against arrays from PyTorch, and the time they take.
//!
//! ```text
//! image_nets parity NET FOLDER    compares with the arrays that tests/parity/{sam2,clip,owlv2,lpips_nets}.py left in FOLDER
//! image_nets time NET FOLDER [ROUNDS]
//! ```
//!
//! NET is `sam2_tiny`, `sam2_small`, `sam2_base_plus`, `sam2_large`, `clip`, `owlv2_base`, `owlv2_large` or `lpips`.
//! Threads: `RAYON_NUM_THREADS`.

#![expect(clippy::print_stdout, reason = "a program")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use harmony_nets::clip::{ClipConfig, ClipImageEncoder, TextTower};
use harmony_nets::cpu::Cpu;
use harmony_nets::detector::{Owlv2, Owlv2Config, Owlv2Size};
use harmony_nets::lpips::{Lpips, LpipsNet};
use harmony_nets::resample::Pixels;
use harmony_nets::sam2::{Label, MaskLogits, Masks, Prompt, Sam2, Sam2Config, Sam2Size, logits_at};
use harmony_nets::{Backend, WeightFile};
use image::RgbImage;

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Largest difference that is let through, relative to the largest value of an output.
const LIMIT: f64 = 1e-4;

#[path = "../tests/image_nets/seeded.rs"]
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
        return Err("usage: image_nets parity|time NET FOLDER [ROUNDS]".into());
    };
    let folder = PathBuf::from(folder);
    let backend = Arc::new(Cpu::default());
    match mode.as_str() {
        "parity" => {
            let mut report = Report { net: net.clone(), good: true };
            compare(net, &folder, &backend, &mut report)?;
            Ok(report.good)
        }
        "time" => {
            let rounds = rest.first().map_or(Ok(3), |r| r.parse())?;
            time(net, &folder, &backend, rounds)?;
            Ok(true)
        }
        other => Err(format!("no such mode: {other}").into()),
    }
}

/// Prints a line an output.
struct Report {
    net: String,
    good: bool,
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
        let relative = off(worst) / largest;
        self.good &= relative <= LIMIT;
        println!(
            "| {} | {what} | {} | {relative:.1e} | {worst}: {:.6} for {:.6} | {:.1e} |{}",
            self.net,
            found.len(),
            found[worst],
            wanted[worst],
            l2.sqrt(),
            if relative <= LIMIT { "" } else { " TOO FAR" },
        );
        Ok(())
    }
}

fn compare(net: &str, folder: &Path, backend: &Arc<Cpu>, report: &mut Report) -> Outcome {
    match net.split_once('_').unwrap_or((net, "")) {
        ("sam2", size) => sam2(size, folder, backend, report),
        ("clip", _) => clip(folder, backend, report),
        ("owlv2", size) => owlv2(size, folder, backend, report),
        ("lpips", _) => lpips(folder, backend, report),
        _ => Err(format!("no such network: {net}").into()),
    }
}

fn load_sam2(size: &str, folder: &Path, backend: Arc<Cpu>) -> Outcome<Sam2<Cpu>> {
    let weights = WeightFile::open(&folder.join(format!("sam2.1_hiera_{size}.pt")))?;
    let size = Sam2Size::from_name(size).ok_or("sizes are tiny, small, base_plus, large")?;
    Ok(Sam2::load(backend, &weights.at("model"), Sam2Config::of(size))?)
}

fn sam2(size: &str, folder: &Path, backend: &Arc<Cpu>, report: &mut Report) -> Outcome {
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

fn clip(folder: &Path, backend: &Arc<Cpu>, report: &mut Report) -> Outcome {
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
    let pooled = tower.pooled(backend, &ids(&wanted, 77, END)?)?;
    let features = backend.read(&backend.linear(&pooled, &projection, Act::None, None)?)?;
    report.line("text_embeds", &features, &wanted)
}

fn load_owlv2(size: &str, folder: &Path, backend: Arc<Cpu>) -> Outcome<Owlv2<Cpu>> {
    let weights = WeightFile::open(&folder.join("model.safetensors"))?;
    let size = if size == "large" { Owlv2Size::Large } else { Owlv2Size::Base };
    Ok(Owlv2::load(backend, &weights, Owlv2Config::of(size))?)
}

fn owlv2(size: &str, folder: &Path, backend: &Arc<Cpu>, report: &mut Report) -> Outcome {
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

fn load_lpips(net: LpipsNet, folder: &Path, backend: Arc<Cpu>) -> Outcome<Lpips<Cpu>> {
    let trunk = if net == LpipsNet::Alex { "alexnet.pth" } else { "vgg16.pth" };
    let trunk = WeightFile::open(&folder.join(trunk))?;
    let heads = WeightFile::open(&folder.join(format!("lpips_v0.1_{}_linear.pth", net.name())))?;
    Ok(Lpips::load(backend, &trunk, &heads, net)?)
}

fn lpips(folder: &Path, backend: &Arc<Cpu>, report: &mut Report) -> Outcome {
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

fn time(net: &str, folder: &Path, backend: &Arc<Cpu>, rounds: usize) -> Outcome {
    let start = Instant::now();
    let seconds = |start: Instant| start.elapsed().as_secs_f64();
    match net.split_once('_').unwrap_or((net, "")) {
        ("sam2", size) => {
            let net = load_sam2(size, folder, backend.clone())?;
            println!("load_s {:.3}", seconds(start));
            let photo = photo(1280, 960);
            for _ in 0..rounds {
                let start = Instant::now();
                let image = net.encode(&photo)?;
                let encode = seconds(start);
                let start = Instant::now();
                let masks = net.predict(&image, &[Prompt::from_box([110.0, 75.0, 602.5, 400.0])], Masks::Best)?;
                let full = logits_at(&masks[0][0].logits, 1280, 960);
                println!("encode_s {encode:.3} box_s {:.3} ({} values)", seconds(start), full.len());
            }
        }
        ("clip", _) => {
            let weights = WeightFile::open(&folder.join("model.safetensors"))?;
            let net = ClipImageEncoder::load(backend.clone(), &weights, &ClipConfig::vit_b32())?;
            println!("load_s {:.3}", seconds(start));
            let image = [pixels(0, 224)];
            for _ in 0..rounds {
                let start = Instant::now();
                net.embed_pixels(&image)?;
                println!("image_s {:.4}", seconds(start));
            }
        }
        ("owlv2", size) => {
            let net = load_owlv2(size, folder, backend.clone())?;
            println!("load_s {:.3}", seconds(start));
            let wanted = WeightFile::open(&folder.join(format!("owlv2_{size}.safetensors")))?;
            let (image, ids) = (pixels(0, net.config().vision.image_size), ids(&wanted, 16, END)?);
            for _ in 0..rounds {
                let start = Instant::now();
                let image = net.encode_pixels(image.clone())?;
                net.logits(&image, &net.embed_text(&ids)?)?;
                println!("image_s {:.3}", seconds(start));
            }
        }
        _ => return Err(format!("no timing of {net}").into()),
    }
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or("? kB").trim();
    let kib: f64 = peak.trim_end_matches(" kB").parse()?;
    println!("peak_mib {:.0}", kib / 1024.0);
    Ok(())
}
