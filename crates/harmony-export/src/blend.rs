//! A Blender file, made by Blender itself as a program of its own (GPL: never linked).
//!
//! The scene goes to it as a GLB without glow and without the photo's light in vertex colours; camera, lights in watts,
//! ambient light, exposure and view transform go with the job. Collections are the levels; textures are packed.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Duration;

use glam::DVec3;
use harmony_lighting::{CyclesRenderer, LitError};
use harmony_scene::{LightKind, ViewTransform};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::check::Inventory;
use crate::files::Files;
use crate::usd_level_name;
use crate::{ExportError, World, glb};

const SCRIPT: &str = include_str!("../blender/scene.py");
/// Importing a large scene from a slow disk.
const LIMIT: Duration = Duration::from_mins(5);

fn blender() -> Result<&'static CyclesRenderer, LitError> {
    static FOUND: OnceLock<Option<CyclesRenderer>> = OnceLock::new();
    FOUND.get_or_init(CyclesRenderer::find).as_ref().ok_or(LitError::NotFound)
}

fn temporary() -> Result<tempfile::TempDir, LitError> {
    let made = tempfile::Builder::new().prefix("harmony-blend-").tempdir();
    made.map_err(|source| LitError::Io { what: "make a temporary folder for Blender", source })
}

/// `blend/scene.blend`.
///
/// # Errors
/// [`ExportError::Blender`], [`ExportError::Glb`].
pub(crate) fn write(world: &World) -> Result<Files, ExportError> {
    let blender = blender()?;
    let folder = temporary()?;
    let io = |what: &'static str| move |source| LitError::Io { what, source };
    let (scene, blend) = (folder.path().join("scene.glb"), folder.path().join("scene.blend"));
    std::fs::write(&scene, glb::for_relighting(world)?).map_err(io("write the scene for Blender"))?;
    let job = job(world, &scene, &blend);
    blender.run_script(SCRIPT, &job, folder.path(), LIMIT)?;
    let bytes = std::fs::read(&blend).map_err(io("read what Blender wrote"))?;
    let mut files = Files::default();
    files.add("blend/scene.blend", bytes);
    Ok(files)
}

fn job(world: &World, glb: &Path, blend: &Path) -> Value {
    let c = &world.camera;
    let k = &c.intrinsics;
    let r = c.rotation.transpose();
    let lighting = &world.scene.lighting;
    let levels: BTreeMap<&str, &str> = world.items.iter().map(|i| (i.name(), usd_level_name(i.object.level))).collect();
    let lights: Vec<Value> = lighting
        .lights
        .iter()
        .map(|light| {
            let mut out = json!({
                "id": light.id, "position": light.position, "color": light.color, "intensity": light.intensity, "on": light.on,
                "object": light.object,
            });
            match &light.kind {
                LightKind::Point { radius_m } => {
                    out["kind"] = json!("point");
                    out["radius_m"] = json!(radius_m);
                }
                LightKind::Area { direction, size_m } => {
                    out["kind"] = json!("area");
                    out["direction"] = json!(direction);
                    out["size_m"] = json!(size_m);
                }
                LightKind::Sun { direction } => {
                    out["kind"] = json!("sun");
                    out["direction"] = json!(direction);
                }
            }
            out
        })
        .collect();
    let view = match lighting.view {
        ViewTransform::Standard => ["Standard", "None"],
        ViewTransform::Filmic => ["Filmic", "None"],
        ViewTransform::FilmicHighContrast => ["Filmic", "High Contrast"],
        ViewTransform::Agx => ["AgX", "None"],
        ViewTransform::AgxHighContrast => ["AgX", "AgX - High Contrast"],
        ViewTransform::AgxPunchy => ["AgX", "AgX - Punchy"],
    };
    json!({
        "mode": "make",
        "glb": glb,
        "blend": blend,
        "generator": world.scene.generator,
        "levels": levels,
        "camera": {
            "width": c.size.width, "height": c.size.height, "fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy,
            "rotation": [r.x_axis.to_array(), r.y_axis.to_array(), r.z_axis.to_array()],
            "centre": c.centre().to_array(),
        },
        "lights": lights,
        "ambient_color": lighting.ambient_color,
        "ambient_intensity": lighting.ambient_intensity,
        "exposure": lighting.exposure,
        "view": view,
    })
}

/// What Blender says is in a file.
#[derive(Debug, Deserialize)]
struct Found {
    objects: Vec<FoundObject>,
    lights: Vec<[f64; 3]>,
    camera: Option<[f64; 3]>,
    unpacked: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct FoundObject {
    name: String,
    of: Option<String>,
    collection: String,
    triangles: usize,
    origin: [f64; 3],
    low: [f64; 3],
    high: [f64; 3],
}

/// What is in a Blender file, as Blender reads it.
///
/// # Errors
/// In words; a Blender that is not here is one.
pub(crate) fn read(path: &Path, world: &World) -> Result<Inventory, String> {
    let blender = blender().map_err(|e| e.to_string())?;
    let folder = temporary().map_err(|e| e.to_string())?;
    let inventory = folder.path().join("inventory.json");
    let path = std::path::absolute(path).map_err(|e| e.to_string())?;
    let job = json!({ "mode": "inventory", "blend": path, "inventory": inventory });
    blender.run_script(SCRIPT, &job, folder.path(), LIMIT).map_err(|e| e.to_string())?;
    let found: Found = harmony_io::read_json(&inventory).map_err(|e| e.to_string())?;
    if !found.unpacked.is_empty() {
        return Err(format!("textures are not in the file: {}", found.unpacked.join(", ")));
    }
    let room = |v: [f64; 3]| DVec3::new(v[0], v[2], -v[1]);
    let lights = found.lights.into_iter().map(room).collect();
    let mut out = Inventory { lights: Some(lights), camera: found.camera.map(room), ..Inventory::default() };
    for o in found.objects {
        let (a, b) = (room(o.low), room(o.high));
        let owner = o.of.unwrap_or_else(|| o.name.clone());
        let whole = owner == o.name;
        // Parts that open may come before what they belong to.
        let mut seen = out.objects.remove(&owner).unwrap_or_default();
        if whole {
            seen.position = Some(room(o.origin));
        } else {
            seen.parts += 1;
        }
        seen.visual(a);
        seen.visual(b);
        seen.triangles += o.triangles;
        let level = world.items.iter().find(|i| i.name() == owner).map(|i| usd_level_name(i.object.level));
        if let Some(level) = level.filter(|l| *l != o.collection) {
            return Err(format!("{} is in collection {} instead of {level}", o.name, o.collection));
        }
        out.add(&owner, seen);
    }
    Ok(out)
}
