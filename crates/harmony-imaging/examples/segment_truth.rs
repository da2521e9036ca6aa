//! Measures the graph cut on rooms with true masks: `segment_truth <gt folder> [<picture folder>]`.
//!
//! Prompts are true boxes moved by up to 2 % of their size, and true outlines simplified to some 16 points and moved by
//! noise of 1 % of the image. Parameters can be tried out as `smoothness=0.5 color=1 error=0.015 relative=0.1`;
//! `noise=0.003` are outlines that somebody drew with care, of up to 60 points.

#![allow(clippy::print_stdout)] // its output is its purpose

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use harmony_imaging::outline::trace_outline;
use harmony_imaging::segment::{SegmentPrompt, SegmentSettings, Segmented, segment_all, segment_box};
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

/// Overlap with the truth: by box, outline as drawn, by outline, outlines together, boxes together.
type Overlaps = [f64; 5];

fn main() -> Result<(), Box<dyn Error>> {
    let mut settings = SegmentSettings::default();
    let mut folders = Vec::new();
    let mut outline_noise = 0.01;
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some(("smoothness", v)) => settings.smoothness = v.parse()?,
            Some(("color", v)) => settings.color_weight = v.parse()?,
            Some(("error", v)) => settings.outline_error = v.parse()?,
            Some(("noise", v)) => outline_noise = v.parse()?,
            Some(("relative", v)) => settings.outline_error_of_object = v.parse()?,
            _ => folders.push(argument),
        }
    }
    let root = folders.first().ok_or("which folder?")?;
    let mut noise = Noise(1);
    let mut classes: Vec<(&str, Vec<Overlaps>)> =
        ["all", "furniture", "furniture in one piece", "all in one piece", "four corners"]
            .map(|name| (name, Vec::new()))
            .to_vec();
    let mut scenes: Vec<_> = std::fs::read_dir(root)?.flatten().map(|e| e.path()).filter(|p| p.is_dir()).collect();
    scenes.sort();
    for scene in scenes {
        let photo = image::open(scene.join("photo.jpg"))?.to_rgb8();
        let ids = image::open(scene.join("instances.png"))?.to_luma8();
        let objects: serde_json::Value = serde_json::from_slice(&std::fs::read(scene.join("objects.json"))?)?;
        let size = ImageSize::new(photo.width(), photo.height());
        let (mut truths, mut outlines, mut boxes) = (Vec::new(), Vec::new(), Vec::new());
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
            let sigma = outline_noise * f64::from(size.width.max(size.height)) / std::f64::consts::SQRT_2;
            // What is a quadrilateral is drawn by its corners.
            let corners = few_points(&truth, 4);
            let whole = filled(&corners, size).iou(&truth) > 0.93 && corners.len() == 4;
            let drawn = if whole { corners } else { few_points(&truth, if outline_noise < 0.01 { 60 } else { 20 }) };
            let outline: Vec<[f64; 2]> =
                drawn.iter().map(|p| [p[0] + sigma * noise.normal(), p[1] + sigma * noise.normal()]).collect();
            let text = |key: &str| object[key].as_str().unwrap_or("").to_owned();
            truths.push((text("label"), text("level"), truth));
            outlines.push(SegmentPrompt::from_outline(outline));
            boxes.push(SegmentPrompt::from_box(rough));
        }
        let started = Instant::now();
        let alone = |prompts: &[SegmentPrompt]| -> Vec<Segmented> {
            prompts.iter().map(|prompt| segment_box(&photo, prompt, &settings)).collect()
        };
        let (by_box, by_outline) = (alone(&boxes), alone(&outlines));
        let elapsed = started.elapsed();
        let (all_outlines, all_boxes) =
            (segment_all(&photo, &outlines, &settings), segment_all(&photo, &boxes, &settings));
        println!("{} ({} objects, one by one {elapsed:.1?})", scene.display(), truths.len());
        for (i, (label, level, truth)) in truths.iter().enumerate() {
            let drawn = filled(outlines[i].outline.as_deref().unwrap_or(&[]), size);
            let values = [
                by_box[i].mask.iou(truth),
                drawn.iou(truth),
                by_outline[i].mask.iou(truth),
                all_outlines[i].mask.iou(truth),
                all_boxes[i].mask.iou(truth),
            ];
            println!(
                "  {label:16} {level:10} {:7} px  box {:.3} (score {:.2}, together {:.3})  outline drawn {:.3} -> {:.3} (score {:.2}, together {:.3})",
                truth.count(),
                values[0],
                by_box[i].score,
                values[4],
                values[1],
                values[2],
                by_outline[i].score,
                values[3]
            );
            // A polygon can't say what an object hidden in parts looks like.
            let traced = filled(&trace_outline(truth, 0.0), size);
            let in_one = traced.iou(truth) > 0.9;
            let is_furniture = level == "furniture";
            let quad = outlines[i].outline.as_ref().is_some_and(|o| o.len() == 4);
            for (class, counts) in [true, is_furniture, is_furniture && in_one, in_one, quad].iter().enumerate() {
                if *counts {
                    classes[class].1.push(values);
                }
            }
        }
        if let Some(folder) = folders.get(1) {
            let name = scene.file_name().and_then(|n| n.to_str()).unwrap_or("scene");
            let traced = |all: &[Segmented]| {
                all.iter().enumerate().fold(photo.clone(), |picture, (i, one)| {
                    let points = trace_outline(&one.mask, 0.0);
                    sheet::draw_polyline(&picture, &points, sheet::LineEnds::Closed, sheet::palette(i), 2.0)
                })
            };
            traced(&all_boxes).save(Path::new(folder).join(format!("{name}_boxes.png")))?;
            let mut picture = traced(&all_outlines);
            for (i, prompt) in outlines.iter().enumerate() {
                let points = prompt.outline.as_deref().unwrap_or(&[]);
                picture = sheet::draw_polyline(&picture, points, sheet::LineEnds::Closed, sheet::palette(i), 1.0);
            }
            picture.save(Path::new(folder).join(format!("{name}_outlines.png")))?;
        }
    }
    for (class, values) in &classes {
        let mean = |k: usize| values.iter().map(|v| v[k]).sum::<f64>() / values.len().max(1) as f64;
        println!(
            "{class} {}: box {:.3} (together {:.3}), outline drawn {:.3} -> {:.3} (together {:.3})",
            values.len(),
            mean(0),
            mean(4),
            mean(1),
            mean(2),
            mean(3)
        );
    }
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
