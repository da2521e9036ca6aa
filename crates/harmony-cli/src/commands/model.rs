//! `harmony model`: the modelling program of an object, to open, change and run again.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use harmony_imaging::sheet::{Cell, contact_sheet};
use harmony_pipeline::views::mesh_view;
use harmony_pipeline::{Built, Phase, Program, Surroundings, program_mesh};
use harmony_scene::{Camera, ObjectId, Room, Scene, SceneCamera, SceneObject, Size};
use image::RgbaImage;
use serde_json::Value;

use crate::display::hinted;
use crate::{EXIT_OK, say};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  harmony model run sofa_01
      print the program that models the sofa, and what it becomes
  harmony model run sofa_01 --program sofa.py --out sofa
      run a changed program: sofa.glb, and sofa.png from four sides; the run is left as it is
  harmony model run sofa_01 --program sofa.py --size 2.1,0.8,0.9 --out sofa
      the same at another size (width, height, depth); in a run that is not finished yet, to try what answers a question
  harmony model run sofa_01 --program sofa.py --keep
      put the program into the run's answers; the next `harmony reconstruct` with the same arguments places it")]
pub struct Args {
    /// Run folder.
    run: PathBuf,
    /// Object id, as `harmony show` lists them.
    object: String,
    /// A changed program; without it the run's own one is taken.
    #[arg(long)]
    program: Option<PathBuf>,
    /// Width, height and depth to run it at, metres; without it the object's own.
    #[arg(long, value_name = "W,H,D", value_parser = size, requires = "program")]
    size: Option<Size>,
    /// Write the mesh to OUT.glb and four views of it to OUT.png.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Put the changed program into the run's answers.
    #[arg(long, requires = "program")]
    keep: bool,
}

/// Runs the command.
///
/// # Errors
/// A folder that holds no scene, an object that has no program, a program that cannot be used.
pub fn run(args: &Args) -> Result<u8> {
    let id = ObjectId::new(&args.object).with_context(|| format!("{:?} is no object id", args.object))?;
    let Given { camera, room, object } = given(args, &id)?;
    let answer = object.as_ref().and_then(|object| answer_of(&args.run, object));
    let source = match (&args.program, &object) {
        (Some(file), _) => {
            std::fs::read_to_string(file).with_context(|| format!("{} cannot be read", file.display()))?
        }
        (None, Some(object)) => own_program(&args.run, object)
            .with_context(|| format!("{id} has no program: it was made as {}", object.mesh_source))?,
        (None, None) => bail!("{id} has no program"),
    };
    let size = args.size.or(object.map(|o| o.size)).context("the object's size is not known: give --size")?;
    let params = answer.as_ref().map(|a| a.params.clone()).unwrap_or_default();
    let program = Program { source, params };
    if args.program.is_none() {
        say!("{}", program.source.trim_end())?;
    }
    let photo = photo_of(&args.run, camera)?;
    let around = Surroundings::new(camera, room.extents);
    let Built { shape, tree, raw, .. } = program_mesh(&program, size, &around, &photo)
        .map_err(anyhow::Error::msg)
        .context("the program cannot be used")?;
    say!(
        "# {} nodes, {} materials, {} triangles; {:.3} x {:.3} x {:.3} m",
        tree.nodes.len(),
        tree.materials.len(),
        shape.mesh.triangle_count(),
        size.width,
        size.height,
        size.depth
    )?;
    let wanted = size.as_vec();
    if ((raw - wanted).abs() / wanted).max_element() > OTHER_SIZE {
        say!("# made {:.3} x {:.3} x {:.3} m by the program and fitted into that", raw.x, raw.y, raw.z)?;
    }
    for part in &shape.parts {
        say!("#   line {:3}  {} x {}, {} triangles", part.line, part.instances, part.name, part.triangles)?;
    }
    if let Some(out) = &args.out {
        let mesh = Arc::new(shape.mesh);
        harmony_io::glb::write_mesh_glb(&out.with_extension("glb"), id.as_str(), Arc::clone(&mesh), Value::Null)?;
        let views: Vec<RgbaImage> = (0..4).map(|k| mesh_view(&mesh, k, 400)).collect();
        let names = ["front", "left", "back", "right"];
        let cells: Vec<Cell<'_>> =
            names.iter().zip(&views).map(|(n, image)| Cell { label: (*n).to_owned(), image }).collect();
        harmony_io::picture::write_rgb_png(&out.with_extension("png"), &contact_sheet(&cells, 2, 400))?;
        say!("# written: {0}.glb, {0}.png", out.display())?;
    }
    if args.keep {
        let Some(answer) = answer else {
            bail!("no answer of the run holds a program of {id}; its level was modelled without programs");
        };
        answer.keep(&program.source)?;
        say!("# kept in {}; run the same `harmony reconstruct` again to place it", answer.file.display())?;
    }
    Ok(EXIT_OK)
}

/// Difference from which a program's size is another than the one asked for, relative.
const OTHER_SIZE: f64 = 0.02;

/// What a program is run with.
struct Given {
    camera: Camera,
    room: Room,
    /// The object in the scene of a finished run; `None` where the size is given and it is not there yet.
    object: Option<SceneObject>,
}

/// Camera and room of the run, and the object, where there is one already.
fn given(args: &Args, id: &ObjectId) -> Result<Given> {
    let (run, layout) = (&args.run, args.run.join(Phase::Layout.folder()));
    if run.join("scene.json").is_file() || args.size.is_none() || !layout.join("room.json").is_file() {
        let mut scene = scene_of(run)?;
        let camera = Camera::from(&scene.camera);
        if let Some(k) = scene.objects.iter().position(|o| o.id == *id) {
            return Ok(Given { camera, room: scene.room, object: Some(scene.objects.swap_remove(k)) });
        }
        let known: Vec<&str> = scene.objects.iter().map(|o| o.id.as_str()).collect();
        bail!("there is no object {id} in the scene; there are {}", known.join(", "));
    }
    let found: Value = harmony_io::read_json(&layout.join("camera.json"))?;
    let camera: SceneCamera = serde_json::from_value(found["camera"].clone()).context("1_layout/camera.json")?;
    Ok(Given { camera: Camera::from(&camera), room: harmony_io::read_json(&layout.join("room.json"))?, object: None })
}

/// A size as it is given on the command line.
fn size(text: &str) -> Result<Size, String> {
    let sides: Vec<f64> = text.split(',').filter_map(|side| side.trim().parse().ok()).collect();
    match sides[..] {
        [width, height, depth] if sides.iter().all(|s| (0.001..=50.0).contains(s)) => Ok(Size { width, height, depth }),
        _ => Err("give width, height and depth in metres, as 2.1,0.8,0.9".to_owned()),
    }
}

/// The scene of a finished run: sizes, camera and room that programs are run with.
fn scene_of(run: &Path) -> Result<Scene> {
    let file = run.join("scene.json");
    if !file.is_file() && run.join("run.json").is_file() {
        let hint = "the same `harmony reconstruct` goes on and writes it at its end; meanwhile `--program FILE --size W,H,D` \
                    tries a program at a size, once the layout is there";
        return Err(hinted(format!("the run {} is not finished: it has no scene.json yet", run.display()), Some(hint)));
    }
    harmony_io::read_json(&file)
        .with_context(|| format!("{} holds no readable scene.json: is it a run folder?", run.display()))
}

/// The program beside the object's mesh.
fn own_program(run: &Path, object: &SceneObject) -> Option<String> {
    let file = run.join(object.level.folder()).join("meshes").join(format!("{}.program.py", object.id));
    std::fs::read_to_string(file).ok()
}

/// The photo at the camera's size.
fn photo_of(run: &Path, camera: Camera) -> Result<image::RgbImage> {
    let file = std::fs::read_dir(run)?
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .find(|path| path.file_stem().is_some_and(|stem| stem == "input"))
        .with_context(|| format!("{} holds no input photo", run.display()))?;
    let photo = harmony_io::load_photo(&file)?;
    let (width, height) = (camera.size.width, camera.size.height);
    Ok(image::imageops::resize(&photo.image, width, height, image::imageops::FilterType::CatmullRom))
}

/// Where the run's answer holds an object's program.
struct Answered {
    file: PathBuf,
    /// Index of the entry with the text: the object's own or the one that it shares.
    entry: usize,
    params: std::collections::BTreeMap<String, f64>,
}

impl Answered {
    fn keep(&self, source: &str) -> Result<()> {
        let mut answer: Value = harmony_io::read_json(&self.file)?;
        let objects = answer_objects(&mut answer).context("the answer holds no objects")?;
        objects[self.entry]["program"] = Value::from(source);
        Ok(harmony_io::write_json(&self.file, &answer)?)
    }
}

/// The list of objects in a recorded answer.
fn answer_objects(answer: &mut Value) -> Option<&mut Vec<Value>> {
    if answer.get("objects").is_some() {
        return answer["objects"].as_array_mut();
    }
    answer.get_mut("answer")?.get_mut("objects")?.as_array_mut()
}

fn answer_of(run: &Path, object: &SceneObject) -> Option<Answered> {
    let folder = run.join("calls/vision_language").join(object.level.folder());
    let mut calls: Vec<PathBuf> = std::fs::read_dir(folder)
        .ok()?
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .filter(|path| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with("programs")))
        .collect();
    calls.sort();
    for call in calls {
        let file = call.join("answer.json");
        let Ok(mut answer) = harmony_io::read_json::<Value>(&file) else { continue };
        let Some(objects) = answer_objects(&mut answer) else { continue };
        let of = |id: &str| objects.iter().position(|o| o["id"] == id);
        let Some(own) = of(object.id.as_str()) else { continue };
        let params = serde_json::from_value(objects[own]["params"].clone()).unwrap_or_default();
        let has_text = |k: usize| objects[k]["program"].is_string();
        let entry = if has_text(own) { Some(own) } else { objects[own]["same_as"].as_str().and_then(of) };
        if let Some(entry) = entry.filter(|k| has_text(*k)) {
            return Some(Answered { file, entry, params });
        }
    }
    None
}
