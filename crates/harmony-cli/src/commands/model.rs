//! `harmony model`: the modelling program of an object, to open, change and run again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use harmony_imaging::sheet::{Cell, contact_sheet};
use harmony_pipeline::views::mesh_view;
use harmony_pipeline::{Built, Phase, Program, program_mesh};
use harmony_scene::{Camera, ObjectId, Scene, SceneCamera, SceneObject, Size};
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
    let Given { camera, object } = given(args, &id)?;
    let own = object.as_ref().and_then(|object| own_program(&args.run, object));
    let answer = own.as_deref().and_then(|own| answer_with(&args.run, own, id.as_str()));
    let source = match (&args.program, &object) {
        (Some(file), _) => {
            std::fs::read_to_string(file).with_context(|| format!("{} cannot be read", file.display()))?
        }
        (None, Some(object)) => {
            own.with_context(|| format!("{id} has no program: it was made as {}", object.mesh_source))?
        }
        (None, None) => bail!("{id} has no program"),
    };
    let size = args.size.or(object.map(|o| o.size)).context("the object's size is not known: give --size")?;
    let params = answer.as_ref().map(|a| a.params.clone()).unwrap_or_default();
    let program = Program { source, params };
    if args.program.is_none() {
        say!("{}", program.source.trim_end())?;
    }
    let photo = photo_of(&args.run, camera)?;
    let Built { shape, tree, raw, .. } =
        program_mesh(&program, size, &photo).map_err(anyhow::Error::msg).context("the program cannot be used")?;
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
        if !answer.sharers.is_empty() {
            say!("# shared: {} change with it", answer.sharers.join(", "))?;
        }
        say!("# kept in {}; run the same `harmony reconstruct` again to place it", answer.file.display())?;
    }
    Ok(EXIT_OK)
}

/// Difference from which a program's size is another than the one asked for, relative.
const OTHER_SIZE: f64 = 0.02;

/// What a program is run with.
struct Given {
    camera: Camera,
    /// The object in the scene of a finished run; `None` where the size is given and it is not there yet.
    object: Option<SceneObject>,
}

/// Camera of the run, and the object, where there is one already.
fn given(args: &Args, id: &ObjectId) -> Result<Given> {
    let (run, layout) = (&args.run, args.run.join(Phase::Layout.folder()));
    if run.join("scene.json").is_file() || args.size.is_none() || !layout.join("room.json").is_file() {
        let mut scene = scene_of(run)?;
        let camera = Camera::from(&scene.camera);
        if let Some(k) = scene.objects.iter().position(|o| o.id == *id) {
            return Ok(Given { camera, object: Some(scene.objects.swap_remove(k)) });
        }
        let known: Vec<&str> = scene.objects.iter().map(|o| o.id.as_str()).collect();
        bail!("there is no object {id} in the scene; there are {}", known.join(", "));
    }
    let found: Value = harmony_io::read_json(&layout.join("camera.json"))?;
    let camera: SceneCamera = serde_json::from_value(found["camera"].clone()).context("1_layout/camera.json")?;
    Ok(Given { camera: Camera::from(&camera), object: None })
}

/// A size as it is given on the command line.
fn size(text: &str) -> Result<Size, String> {
    let sides: Vec<f64> = text.split(',').filter_map(|side| side.trim().parse().ok()).collect();
    match sides[..] {
        [width, height, depth] if sides.iter().all(|s| (0.001..=50.0).contains(s)) => Ok(Size { width, height, depth }),
        _ => Err("give width, height and depth in metres, as 2.1,0.8,0.9".to_owned()),
    }
}

/// The scene of a finished run: its sizes and camera.
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

/// The run's answer that holds the program in force.
struct Answered {
    file: PathBuf,
    /// Where the text is in it, as a JSON pointer.
    at: String,
    /// What the object gives the program.
    params: BTreeMap<String, f64>,
    /// Other objects with the same program.
    sharers: Vec<String>,
}

impl Answered {
    fn keep(&self, source: &str) -> Result<()> {
        let mut answer: Value = harmony_io::read_json(&self.file)?;
        let text = answer.pointer_mut(&self.at).context("the answer has changed")?;
        *text = Value::from(source);
        Ok(harmony_io::write_json(&self.file, &answer)?)
    }
}

/// The latest answer that holds a program's text: of the first question about it, a second look, or the last one.
fn answer_with(run: &Path, source: &str, id: &str) -> Option<Answered> {
    let of = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        paths.sort();
        paths
    };
    let phases = of(&run.join("calls/vision_language"));
    // Programs come first by name, looks after them: the last one that holds it is in force.
    let calls = phases.iter().flat_map(|phase| of(phase));
    let mut found = calls.filter_map(|call| {
        let file = call.join("answer.json");
        let answer: Value = harmony_io::read_json(&file).ok()?;
        let entries = with_programs(&answer, String::new());
        let of_id = |entry: &&(String, &Value)| entry.1["id"] == id;
        let holds = |entry: &&(String, &Value)| entry.1["program"].as_str().map(str::trim) == Some(source.trim());
        let holder = entries.iter().filter(holds).find(of_id).or_else(|| entries.iter().find(holds))?;
        let own = entries.iter().find(of_id).unwrap_or(holder);
        let shared = |entry: &&(String, &Value)| entry.1["same_as"] == holder.1["id"] || holds(entry);
        let others = entries.iter().filter(shared).filter_map(|entry| entry.1["id"].as_str());
        Some(Answered {
            at: format!("{}/program", holder.0),
            params: serde_json::from_value(own.1["params"].clone()).unwrap_or_default(),
            sharers: others.filter(|other| *other != id).map(str::to_owned).collect(),
            file,
        })
    });
    found.next_back()
}

/// The objects of an answer that hold a program or name another one's, each with its JSON pointer.
fn with_programs(value: &Value, at: String) -> Vec<(String, &Value)> {
    let below: Vec<(String, &Value)> = match value {
        Value::Object(fields) => fields.iter().flat_map(|(key, v)| with_programs(v, format!("{at}/{key}"))).collect(),
        Value::Array(items) => {
            items.iter().enumerate().flat_map(|(k, v)| with_programs(v, format!("{at}/{k}"))).collect()
        }
        _ => Vec::new(),
    };
    let own = (value.get("program").is_some() || value.get("same_as").is_some()).then_some((at, value));
    own.into_iter().chain(below).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_program_in_force_is_changed_where_it_was_answered_last() {
        let run = tempfile::tempdir().unwrap();
        let put = |call: &str, answer: Value| {
            let folder = run.path().join("calls/vision_language").join(call);
            std::fs::create_dir_all(&folder).unwrap();
            harmony_io::write_json(&folder.join("answer.json"), &answer).unwrap();
            folder.join("answer.json")
        };
        let first = put(
            "3_furniture/programs",
            json!({ "objects": [
                { "id": "chair_01", "program": "old" }, { "id": "chair_02", "same_as": "chair_01", "params": { "n": 2.0 } },
            ] }),
        );
        let look = put("3_furniture/second_look_1", json!({ "objects": [{ "id": "chair_01", "program": "new\n" }] }));
        let last = put(
            "6_lighting/last_look_1",
            json!({ "actions": [{ "action": "reshape", "id": "chair_01", "program": "refused" }] }),
        );

        let shared = answer_with(run.path(), "old", "chair_02").unwrap();
        assert_eq!((&shared.file, shared.params["n"]), (&first, 2.0));
        assert_eq!(shared.sharers, ["chair_01"], "both have this text");
        let own = answer_with(run.path(), "new", "chair_01").unwrap();
        assert_eq!(own.file, look);
        own.keep("mine").unwrap();
        let text = |file: &Path, at: &str| harmony_io::read_json::<Value>(file).unwrap().pointer(at).unwrap().clone();
        assert_eq!(text(&look, "/objects/0/program"), "mine");
        assert_eq!(text(&first, "/objects/0/program"), "old");
        assert_eq!(text(&last, "/actions/0/program"), "refused");
        assert!(answer_with(run.path(), "nobody's", "chair_01").is_none());
    }
}
