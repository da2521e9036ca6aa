//! How far a finished run's light is from a room with truth: median absolute difference of luminance, in stops.
//!
//! `cargo run --release -p harmony-lighting --example light_error -- RUN TRUTH_ROOM [OUT]`
//!
//! Compares `RUN/render_lit.png` with `TRUTH_ROOM/photo.jpg`, renders the scene from every `TRUTH_ROOM/views/N` with the
//! run's light and reflectances, and compares those. Pictures go to OUT. For judging only.
#![expect(clippy::print_stdout, reason = "an example")]

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use harmony_lighting::{CyclesJob, CyclesRenderer, display_linear, picture_error};
use harmony_scene::{AlbedoField, Camera, ImageSize, Intrinsics, Scene};
use image::RgbImage;
use image::imageops::{FilterType, resize};

/// Size at which pictures are compared and rendered, pixels across.
const WIDTH: u32 = 480;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [run, truth, rest @ ..] = args.as_slice() else { return Err("usage: light_error RUN TRUTH_ROOM [OUT]".into()) };
    let photo = image::open(truth.join("photo.jpg"))?.into_rgb8();
    for name in ["render_flat.png", "render_lit.png"] {
        if let Ok(picture) = image::open(run.join(name)) {
            tell(name, &photo, &picture.into_rgb8());
        }
    }
    let scene: Scene = serde_json::from_slice(&std::fs::read(run.join("scene.json"))?)?;
    let field = std::fs::read(run.join("6_lighting/albedo.json")).ok();
    let field: Option<AlbedoField> = field.map(|bytes| serde_json::from_slice(&bytes)).transpose()?;
    let cycles = CyclesRenderer::find().ok_or("no Blender was found")?;
    for view in ["1", "2"] {
        let folder = truth.join("views").join(view);
        let photo = image::open(folder.join("photo.jpg"))?.into_rgb8();
        let camera = camera(&folder.join("camera.json"), &photo)?;
        let camera = camera.resized(camera.size.fit_within(WIDTH));
        let glb = run.join("6_lighting/scene_for_light.glb");
        let mut job = CyclesJob::lit(glb, camera, scene.lighting.clone());
        job.room = Some(scene.room.extents);
        job.albedo = field.clone().map(Arc::new);
        job.samples = CyclesJob::PREVIEW_SAMPLES;
        let picture = cycles.render(&job)?.image.ok_or("no picture")?;
        tell(&format!("view {view}"), &photo, &picture);
        if let [out, ..] = rest {
            std::fs::create_dir_all(out)?;
            picture.save(out.join(format!("lit_{view}.png")))?;
        }
    }
    Ok(())
}

fn tell(name: &str, photo: &RgbImage, picture: &RgbImage) {
    let size = ImageSize::new(photo.width(), photo.height()).fit_within(WIDTH / 2);
    let small = |p: &RgbImage| display_linear(&resize(p, size.width, size.height, FilterType::Triangle));
    let error = picture_error(&small(photo), &small(picture), &[]);
    println!("{name}: {:.3} stops, chroma {:.4}", error.stops, error.chroma);
}

/// `camera.json` of a truth room: K, R, t.
fn camera(path: &Path, photo: &RgbImage) -> Result<Camera, Box<dyn Error>> {
    let value: serde_json::Value = serde_json::from_slice(&std::fs::read(path)?)?;
    let number = |v: &serde_json::Value| v.as_f64().ok_or("camera.json lacks a number");
    let (k, r, t) = (&value["K"], &value["R"], &value["t"]);
    let row = |i: usize| -> Result<DVec3, &'static str> {
        Ok(DVec3::new(number(&r[i][0])?, number(&r[i][1])?, number(&r[i][2])?))
    };
    Ok(Camera {
        size: ImageSize::new(photo.width(), photo.height()),
        intrinsics: Intrinsics {
            fx: number(&k[0][0])?,
            fy: number(&k[1][1])?,
            cx: number(&k[0][2])?,
            cy: number(&k[1][2])?,
        },
        rotation: DMat3::from_cols(row(0)?, row(1)?, row(2)?).transpose(),
        translation: DVec3::new(number(&t[0])?, number(&t[1])?, number(&t[2])?),
    })
}
