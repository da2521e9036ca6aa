//! Fits light to a finished run again, without the model's rounds, and renders previews: for work on the fit.
//!
//! `cargo run --release -p harmony-lighting --example fit_run -- RUN OUT`
//!
//! Reads `scene.json`, `input.*`, masks and `6_lighting/scene_for_light.glb` of the run; writes OUT as a run folder
//! that `light_error` can judge: `scene.json`, `6_lighting/`, `render_lit.png` at preview size.
#![expect(clippy::print_stdout, reason = "an example")]

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use harmony_lighting::{
    Comparison, CyclesJob, CyclesRenderer, Emitter, FieldNode, FitOptions, Measured, RenderMode, display_linear,
    fit_scene, lights_from_scene, neutral_field, picture_error, updated_field,
};
use harmony_scene::{Camera, ImageSize, Scene, ViewTransform};
use image::RgbImage;
use image::imageops::{FilterType, resize};

/// Size of the measurement, pixels across.
const MEASURED: u32 = 160;
const FACES: [(&str, &str); 6] = [
    ("floor", "floor"),
    ("ceiling", "ceiling"),
    ("wall_back", "wall"),
    ("wall_left", "wall"),
    ("wall_right", "wall"),
    ("wall_front", "wall"),
];

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [run, out] = args.as_slice() else { return Err("usage: fit_run RUN OUT".into()) };
    std::fs::create_dir_all(out.join("6_lighting"))?;
    let mut scene: Scene = serde_json::from_slice(&std::fs::read(run.join("scene.json"))?)?;
    let input = ["jpg", "png", "jpeg"].map(|e| run.join(format!("input.{e}"))).into_iter().find(|p| p.is_file());
    let photo = image::open(input.ok_or("no photo")?)?.into_rgb8();
    let cycles = CyclesRenderer::find().ok_or("no Blender was found")?;
    let camera = Camera::from(&scene.camera);

    let mut lighting = lights_from_scene(&scene.room, &scene.objects, |_| Emitter::default());
    for light in &mut lighting.lights {
        if let Some(before) = scene.lighting.lights.iter().find(|l| l.id == light.id) {
            light.on = before.on;
        }
    }
    let glb = run.join("6_lighting/scene_for_light.glb");
    std::fs::copy(&glb, out.join("6_lighting/scene_for_light.glb"))?;
    let mut job = CyclesJob::lit(glb, camera, lighting.clone());
    job.room = Some(scene.room.extents);
    let mut nodes: Vec<FieldNode> = FACES.iter().map(|(name, kind)| FieldNode::new(name, kind)).collect();
    nodes.extend(scene.objects.iter().map(|o| FieldNode::new(o.id.as_str(), "object")));

    let size = camera.size.fit_within(MEASURED);
    let mut measure =
        CyclesJob { mode: RenderMode::PerLight, camera: camera.resized(size), denoise: false, ..job.clone() };
    measure.node_ids = nodes.iter().zip(1..).map(|(n, id)| (n.name.clone(), id)).collect();
    measure.views = ViewTransform::ALL.to_vec();
    let output = cycles.render(&measure)?;
    let measured = Measured {
        lights: output.lights,
        albedo: output.albedo.ok_or("no reflectances")?,
        ids: output.ids.ok_or("no ids")?,
        views: output.views,
    };
    let small = resize(&photo, size.width, size.height, FilterType::Triangle);
    let weights = weights(run, &scene, &measured, size)?;
    let fit = fit_scene(&measured, &small, &weights, &FitOptions::default())?;
    for candidate in &fit.candidates {
        println!("  {:?}: {:.3} stops, chroma {:.4}", candidate.view, candidate.error.stops, candidate.error.chroma);
    }
    let typical = lighting.clone();
    let notes = fit.apply(&mut lighting, &typical);
    println!("view {:?}, exposure {:.2}; {}", lighting.view, lighting.exposure, notes.join("; "));
    for l in &lighting.lights {
        println!("  {} {:.2} W {:.2?} on {}", l.id, l.intensity, l.color, l.on);
    }
    println!("  ambient {:.3} {:.2?}", lighting.ambient_intensity, lighting.ambient_color);

    let step = |field: &_, render: &_| {
        let seen = Comparison { photo: &fit.photo, render, ids: &measured.ids, weights: &weights };
        updated_field(field, &nodes, &seen, [1.0; 3])
    };
    let mut field = step(&neutral_field(&camera), &fit.predicted(&measured));
    job.lighting = lighting.clone();
    for round in 0..2 {
        job.albedo = Some(Arc::new(field.clone()));
        let picture = cycles.render(&job.preview())?.image.ok_or("no picture")?;
        picture.save(out.join(format!("preview_{round}.png")))?;
        picture.save(out.join("render_lit.png"))?;
        let shown: RgbImage = resize(&picture, size.width, size.height, FilterType::Triangle);
        let error = |weights: &[f32]| picture_error(&display_linear(&small), &display_linear(&shown), weights);
        println!("preview {round}: {:?}, all pixels {:?}", error(&weights), error(&[]));
        std::fs::write(out.join("6_lighting/albedo.json"), serde_json::to_string(&field)?)?;
        field = step(&field, &fit.view.to_linear(&shown));
    }
    scene.lighting = lighting;
    std::fs::write(out.join("scene.json"), serde_json::to_string_pretty(&scene)?)?;
    Ok(())
}

/// What counts, by the run's masks.
fn weights(run: &Path, scene: &Scene, measured: &Measured, size: ImageSize) -> Result<Vec<f32>, Box<dyn Error>> {
    let mut masks = Vec::new();
    for object in &scene.objects {
        let path = run.join(object.mask.as_deref().unwrap_or_default());
        let mask = if path.is_file() { Some(image::open(path)?.into_luma8()) } else { None };
        masks.push(mask.map(|m| resize(&m, size.width, size.height, FilterType::Triangle).into_raw()));
    }
    Ok(measured
        .ids
        .iter()
        .enumerate()
        .map(|(i, id)| {
            let lit = measured.albedo.rgb[i].iter().any(|a| *a > 0.02);
            let inside = |m: &Option<Vec<u8>>| m.as_ref().is_some_and(|m| m[i] > 127);
            let seen = match (*id as usize).checked_sub(FACES.len() + 1) {
                Some(object) => masks.get(object).is_some_and(inside),
                None => *id > 0 && !masks.iter().any(inside),
            };
            f32::from(u8::from(seen && lit))
        })
        .collect())
}
