//! Lights a finished scene by its photo: default lights, per-light images, fit, measured loop, final picture.
//!
//! `cargo run -p harmony-lighting --example fit_photo -- scene.json scene_full.glb photo.png out_folder`
#![expect(clippy::print_stdout, reason = "a program for people")]

use std::error::Error;
use std::path::PathBuf;

use harmony_lighting::{
    CyclesJob, CyclesRenderer, FitOptions, Judgement, assess, fit_lights, judge, lights_from_scene, propose, relight,
};
use harmony_scene::{Camera, ImageSize, Scene};
use image::imageops::{FilterType, resize};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [scene, glb, photo, out] = args.as_slice() else {
        return Err("usage: fit_photo scene.json scene.glb photo out_folder".into());
    };
    let scene: Scene = serde_json::from_slice(&std::fs::read(scene)?)?;
    let photo = image::open(photo)?.into_rgb8();
    std::fs::create_dir_all(out)?;
    let Some(cycles) = CyclesRenderer::find() else { return Err("no Blender was found".into()) };
    println!("Blender {}", cycles.version());

    let mut lighting = lights_from_scene(&scene.room, &scene.objects, |_| None);
    let camera = Camera::from(&scene.camera).resized(ImageSize::new(photo.width(), photo.height()));
    let mut job = CyclesJob::lit(glb, camera, lighting.clone());
    job.room = Some(scene.room.extents);

    let passes = cycles.render(&job.per_light())?;
    println!("per-light images: {:?}, albedo gain {:.2}", passes.timings, passes.albedo_gain);
    let size = passes.lights[0].image.size;
    let small = resize(&photo, size.width, size.height, FilterType::Triangle);
    let light = passes.response.to_linear(&small);
    let fit = fit_lights(&passes.lights, &light, &[], &FitOptions::default())?;
    passes.response.to_picture(&relight(&passes.lights, &fit.gains)).save(out.join("fit_sum.png"))?;
    println!("common gain {:.2}, residual {:.3} to {:.3}", fit.common_gain, fit.residual_before, fit.residual_after);
    let before = cycles.render(&job.preview())?;
    println!("preview: {:?}", before.timings);
    let picture = before.image.ok_or("no picture")?;
    picture.save(out.join("preview_default.png"))?;
    println!("default lights: {}", serde_json::to_string(&assess(&photo, &picture, None))?);
    for note in fit.apply(&mut lighting) {
        println!("  {note}");
    }
    for (l, g) in lighting.lights.iter().zip(&fit.gains) {
        println!("  {} {:.2} W {:.2?} gain {g:.2?} on {}", l.id, l.intensity, l.color, l.on);
    }
    println!("  ambient {:.3} {:.2?}", lighting.ambient_intensity, lighting.ambient_color);

    // The measured loop: what a model's answer would be, by the numbers alone.
    job.lighting = lighting;
    let mut picture = cycles.render(&job.preview())?.image.ok_or("no picture")?;
    let mut found = assess(&photo, &picture, None);
    picture.save(out.join("preview_fitted.png"))?;
    for round in 0..3 {
        println!("round {round}: {}", serde_json::to_string(&found)?);
        let delta = propose(&found, &job.lighting);
        if delta.is_converged() {
            break;
        }
        let mut next = job.clone();
        delta.apply(&mut next.lighting, &scene.room.extents);
        picture = cycles.render(&next.preview())?.image.ok_or("no picture")?;
        let after = assess(&photo, &picture, None);
        if let Judgement::Refuse { reason } = judge(&found, &after) {
            println!("refused: {reason}");
            break;
        }
        (job, found) = (next, after);
    }
    picture.save(out.join("preview_final.png"))?;
    std::fs::write(out.join("lights.json"), serde_json::to_string_pretty(&job.lighting)?)?;
    Ok(())
}
