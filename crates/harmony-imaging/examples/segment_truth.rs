//! Measures the graph cut on rooms with true masks: `segment_truth <gt folder> [<picture folder>]`.
//!
//! Prompts are true boxes moved by up to 2 % of their size, and true outlines simplified to some 16 points and moved by
//! noise of 1 % of the image.

#![allow(clippy::print_stdout)] // its output is its purpose

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use harmony_imaging::outline::trace_outline;
use harmony_imaging::segment::{SegmentPrompt, SegmentSettings, segment_all, segment_box};
use harmony_imaging::sheet;
use harmony_scene::{ImageSize, Mask, PixelBox};

/// A small deterministic source of noise.
struct Noise(u64);

impl Noise {
    /// Uniform in -1 to 1.
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Standard normal, nearly (sum of twelve).
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() / 2.0
    }
}

/// At most `most` points within the least tolerance that achieves it.
fn few_points(mask: &Mask, most: usize) -> Vec<[f64; 2]> {
    let mut tolerance = 1.0;
    loop {
        let outline = trace_outline(mask, tolerance);
        if outline.len() <= most {
            return outline;
        }
        tolerance *= 1.25;
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let root = arguments.next().ok_or("which folder?")?;
    let pictures = arguments.next();
    let settings = SegmentSettings::default();
    let mut noise = Noise(1);
    let (mut boxes, mut outlines, mut plain, mut together) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut furniture = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut scenes: Vec<_> = std::fs::read_dir(&root)?.flatten().map(|e| e.path()).filter(|p| p.is_dir()).collect();
    scenes.sort();
    for scene in scenes {
        let photo = image::open(scene.join("photo.jpg"))?.to_rgb8();
        let ids = image::open(scene.join("instances.png"))?.to_luma8();
        let objects: serde_json::Value = serde_json::from_slice(&std::fs::read(scene.join("objects.json"))?)?;
        let size = ImageSize::new(photo.width(), photo.height());
        let mut prompts = Vec::new();
        let mut truths = Vec::new();
        let mut rows = Vec::new();
        let started = Instant::now();
        for object in objects["objects"].as_array().ok_or("no objects")? {
            let index = object["index"].as_u64().unwrap_or(0) as u8;
            let truth = Mask::from_fn(size, |x, y| ids.get_pixel(x, y).0[0] == index);
            let Some(b) = truth.bounds() else { continue };
            if truth.count() < size.pixels() / 1500 {
                continue;
            }
            let mut moved = |v: f64, side: f64| v + 0.02 * side * noise.uniform();
            let (w, h) = (b.width(), b.height());
            let rough = PixelBox { x0: moved(b.x0, w), y0: moved(b.y0, h), x1: moved(b.x1, w), y1: moved(b.y1, h) };
            let by_box = segment_box(&photo, &SegmentPrompt::from_box(rough), &settings);
            let sigma = 0.01 * f64::from(size.width.max(size.height)) / std::f64::consts::SQRT_2;
            let outline: Vec<[f64; 2]> = few_points(&truth, 20)
                .iter()
                .map(|p| [p[0] + sigma * noise.normal(), p[1] + sigma * noise.normal()])
                .collect();
            let prompt = SegmentPrompt::from_outline(outline.clone());
            let by_outline = segment_box(&photo, &prompt, &settings);
            let filled = filled(&outline, size);
            let label = object["label"].as_str().unwrap_or("").to_owned();
            let level = object["level"].as_str().unwrap_or("").to_owned();
            rows.push((label, level, truth.count(), by_box, by_outline, filled));
            prompts.push(prompt);
            truths.push(truth);
        }
        let elapsed = started.elapsed();
        let all = segment_all(&photo, &prompts, &settings);
        println!("{} ({} objects, one by one {elapsed:.1?})", scene.display(), rows.len());
        for ((label, level, area, by_box, by_outline, filled), (truth, all)) in rows.iter().zip(truths.iter().zip(&all))
        {
            let values = [by_box.mask.iou(truth), filled.iou(truth), by_outline.mask.iou(truth), all.mask.iou(truth)];
            println!(
                "  {label:24} {level:10} {area:7} px  box {:.3} (score {:.2})  outline drawn {:.3} -> {:.3} (score {:.2})  together {:.3}",
                values[0], by_box.score, values[1], values[2], by_outline.score, values[3]
            );
            boxes.push(values[0]);
            plain.push(values[1]);
            outlines.push(values[2]);
            together.push(values[3]);
            if level == "furniture" {
                furniture.0.push(values[0]);
                furniture.1.push(values[1]);
                furniture.2.push(values[2]);
                furniture.3.push(values[3]);
            }
        }
        if let Some(folder) = &pictures {
            let name = scene.file_name().and_then(|n| n.to_str()).unwrap_or("scene");
            let by_box: Vec<&Mask> = rows.iter().map(|r| &r.3.mask).collect();
            sheet::overlay_masks(&photo, &by_box, &[]).save(Path::new(folder).join(format!("{name}_boxes.png")))?;
            let joint: Vec<&Mask> = all.iter().map(|a| &a.mask).collect();
            let mut picture = sheet::overlay_masks(&photo, &joint, &[]);
            for (i, prompt) in prompts.iter().enumerate() {
                let points = prompt.outline.as_deref().unwrap_or(&[]);
                picture = sheet::draw_polyline(&picture, points, sheet::LineEnds::Closed, sheet::palette(i), 1.0);
            }
            picture.save(Path::new(folder).join(format!("{name}_outlines.png")))?;
        }
    }
    println!(
        "all {}: box {:.3}, outline drawn {:.3} -> {:.3}, together {:.3}",
        boxes.len(),
        mean(&boxes),
        mean(&plain),
        mean(&outlines),
        mean(&together)
    );
    println!(
        "furniture {}: box {:.3}, outline drawn {:.3} -> {:.3}, together {:.3}",
        furniture.0.len(),
        mean(&furniture.0),
        mean(&furniture.1),
        mean(&furniture.2),
        mean(&furniture.3)
    );
    Ok(())
}

/// The drawn polygon itself, as a mask.
fn filled(outline: &[[f64; 2]], size: ImageSize) -> Mask {
    Mask::from_fn(size, |x, y| {
        let (px, py) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        let mut inside = false;
        for (i, a) in outline.iter().enumerate() {
            let b = outline[(i + 1) % outline.len()];
            if (a[1] <= py) != (b[1] <= py) && px < a[0] + (py - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
                inside = !inside;
            }
        }
        inside
    })
}
