//! Reads exported files back and compares them with the scene.
//!
//! Each format has a reader of its own here that shares no code with its writer beyond names; each yields an [`Inventory`]
//! in the room frame (or, for files of one object, in its body frame). Compared are counts, names, places, sizes, masses,
//! friction, and the bounds of colliders with those of what they stand for.

mod compare;
mod drawings;
mod inventory;
mod mjcf;
mod obj;
mod usd;
mod usda;

use std::path::Path;

use harmony_io::{ReadLimits, read_bounded, read_glb};
use harmony_physics::Bodies;

use crate::manifest::Manifest;
use crate::world::World;
use crate::{ExportError, Format, Options, glb};

pub use compare::{Difference, Rules};
pub use inventory::{Inventory, Seen};

/// Largest file that is read back, bytes.
const MAX_BYTES: u64 = 2 << 30;

/// What was found in one file.
#[derive(Debug, Clone)]
pub struct Checked {
    /// Path below the export folder.
    pub file: String,
    /// Objects in it.
    pub objects: usize,
    /// Triangles of all of them and of the room.
    pub triangles: usize,
    /// Colliders.
    pub colliders: usize,
    /// Bytes.
    pub bytes: usize,
}

/// What a check found.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// By file.
    pub files: Vec<Checked>,
    /// What differs from the scene; empty when all is well.
    pub differences: Vec<Difference>,
}

/// Why a file cannot be read back, in words; it becomes a [`Difference`].
pub(crate) type Unreadable = String;

/// Reads all files of an export folder back and compares them with the scene of the run.
///
/// # Errors
/// [`ExportError::NothingExported`] without `export.json`; what differs is in the report, not an error here.
pub fn check(world: &World, folder: &Path, cache: Option<&Path>) -> Result<Report, ExportError> {
    let manifest = Manifest::read(folder)?;
    let mut options = Options { budget: manifest.budget(), ..Options::default() };
    options.cache = cache.map(Path::to_owned);
    let world = &world.within(&options.budget);
    let formats = manifest.formats();
    let bodies = if formats.iter().any(|f| f.has_bodies()) { Some(crate::bodies(world, &options)?) } else { None };
    let mut report = Report::default();
    for path in manifest.files.keys() {
        let at = folder.join(path);
        let bytes = match read_bounded(&at, MAX_BYTES) {
            Ok(bytes) => bytes,
            Err(e) => {
                report.differences.push(Difference::of_file(path, format!("cannot be read: {e}")));
                continue;
            }
        };
        if manifest.files.get(path).is_some_and(|hash| *hash != blake3::hash(&bytes).to_hex().to_string()) {
            report
                .differences
                .push(Difference::of_file(path, "is not the file that was exported: its hash differs".to_owned()));
        }
        one(world, bodies.as_ref(), folder, path, &bytes, &mut report);
    }
    Ok(report)
}

/// Checks one file, when it is one that says something of its own.
fn one(world: &World, bodies: Option<&Bodies>, folder: &Path, path: &str, bytes: &[u8], report: &mut Report) {
    let found: Result<(Inventory, Rules), Unreadable> = match path {
        "glb/scene.glb" => of_glb(bytes).map(|i| (i, Rules::scene(world).with_joints())),
        "glb/shell.glb" => of_glb(bytes).map(|i| (i, Rules::shell())),
        _ if path.starts_with("glb/level_") => {
            let level = path.trim_start_matches("glb/level_").trim_end_matches(".glb");
            of_glb(bytes).map(|i| (i, Rules::level(world, level).with_joints()))
        }
        "usd/scene.usda" => usd::layer(bytes).map(|i| (i, Rules::scene(world).with_bodies().with_joints())),
        "usd/scene.usdz" => usd::package(bytes).map(|i| (i, Rules::scene(world).with_bodies().with_joints())),
        "mjcf/scene.xml" => mjcf::scene(bytes, &folder.join("mjcf/assets"))
            .map(|i| (i, Rules::scene(world).with_bodies().with_joints())),
        "blend/scene.blend" => {
            crate::blend::read(&folder.join(path), world).map(|i| (i, Rules::scene(world).with_joints()))
        }
        "obj/scene.obj" => obj::scene(bytes).map(|i| (i, Rules::scene(world))),
        "plan/furniture.csv" => drawings::list(bytes).map(|i| (i, Rules::list(world))),
        "plan/floor_plan.dxf" | "plan/elevations.dxf" | "plan/floor_plan.svg" | "plan/elevations.svg" => {
            let ends = |s: &str| path.ends_with(s);
            if let Err(reason) = drawings::drawing(bytes, world, ends(".dxf"), ends("floor_plan.dxf")) {
                report.differences.push(Difference::of_file(path, reason));
            }
            return;
        }
        _ => {
            let own = |prefix: &str, end: &str| path.strip_prefix(prefix).and_then(|p| p.strip_suffix(end));
            let found = if let Some(id) = own("mjcf/objects/", ".xml") {
                mjcf::scene(bytes, &folder.join("mjcf/assets")).map(|i| (i, Rules::alone(id).with_joints()))
            } else if let Some(id) = own("urdf/", ".urdf") {
                let id = id.split('/').next_back().unwrap_or(id).to_owned();
                mjcf::urdf(bytes, &folder.join("urdf").join(&id)).map(|i| (i, Rules::alone(&id).with_joints()))
            } else {
                return;
            };
            found.map(|(inventory, rules)| (inventory, rules.with_bodies()))
        }
    };
    match found {
        Err(reason) => report.differences.push(Difference::of_file(path, reason)),
        Ok((inventory, rules)) => {
            report.files.push(Checked {
                file: path.to_owned(),
                objects: inventory.objects.len(),
                triangles: inventory.objects.values().chain(inventory.faces.values()).map(|s| s.triangles).sum(),
                colliders: inventory.objects.values().map(|s| s.hulls).sum(),
                bytes: bytes.len(),
            });
            report.differences.extend(compare::compare(path, world, bodies, &inventory, &rules));
        }
    }
}

fn of_glb(bytes: &[u8]) -> Result<Inventory, Unreadable> {
    let plain = glb::unpacked(bytes).map_err(|e| e.to_string())?;
    let loaded = read_glb(&plain, &ReadLimits::default()).map_err(|e| e.to_string())?;
    let mut out = Inventory::default();
    for node in &loaded.nodes {
        // A part that opens is a child of its object and says so.
        let of = node.extras.pointer("/joint/of").and_then(serde_json::Value::as_str);
        let mut seen = match of.and_then(|of| out.objects.remove(of)) {
            Some(object) => Seen { parts: object.parts + 1, ..object },
            None => Seen { position: Some(node.transform.translation), ..Seen::default() },
        };
        for t in node.mesh.triangles() {
            for i in t {
                let p = node.mesh.positions.get(i as usize).ok_or("a triangle points past the vertices")?;
                seen.visual(node.transform.transform_point3(p.as_dvec3()));
            }
            seen.triangles += 1;
        }
        out.add(of.unwrap_or(&node.name), seen);
    }
    Ok(out)
}

/// Formats that hold bodies.
impl Format {
    pub(crate) fn has_bodies(self) -> bool {
        matches!(self, Self::Usd | Self::Usdz | Self::Mjcf | Self::Urdf)
    }
}
