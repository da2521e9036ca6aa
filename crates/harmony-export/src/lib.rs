//! A run's scene as files of other programs, and what they hold compared with the scene.
//! Key `data.formats`.
//!
//! # Idea
//! A run folder is read once into a [`World`]; each format is one module that writes it, with the same ids, metres and
//! looks. [`check()`] reads every written file back by other code than wrote it and compares.
//!
//! | module | writes below the export folder |
//! |---|---|
//! | `glb` | `glb/scene.glb`, `glb/shell.glb`, `glb/level_<name>.glb` |
//! | `usd` | `usd/scene.usda` with textures, `usd/scene.usdz` |
//! | `mjcf`, `urdf` | `mjcf/scene.xml`, `mjcf/objects/<id>.xml`; `urdf/<id>/<id>.urdf` |
//! | `blend` | `blend/scene.blend`, by Blender as a program of its own |
//! | `obj` | `obj/scene.obj`, `obj/scene.mtl` with textures |
//! | `plan` | floor plan and wall elevations as SVG and DXF, furniture as CSV |
//!
//! # Frames
//! GLB and OBJ keep the room frame (+Y up); USD, MJCF, URDF and Blender files are +Z up, by [`world::z_up`].
//!
//! # Source in the paper
//! The data set's per-scene files (appendix) and the bodies of "Physical Simulations"; the formats are beyond the paper.

mod blend;
mod budget;
mod check;
mod error;
mod files;
mod glb;
mod manifest;
mod mjcf;
mod moving;
mod obj;
pub mod plan;
mod text;
mod urdf;
mod usd;
pub mod world;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::{Arc, OnceLock};

use harmony_mesh::Mesh;
use harmony_physics::{Bodies, BodySettings};
use harmony_scene::ObjectId;
use rayon::prelude::*;

pub use budget::Budget;
pub use check::{Checked, Difference, Inventory, Report, Rules, Seen, check};
pub use error::ExportError;
pub use files::Files;
pub use glb::GlbOptions;
pub use manifest::{BodyRow, MANIFEST, Manifest};
pub use usd::animation;
pub(crate) use usd::level_name as usd_level_name;
pub use world::World;

/// What can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// glTF 2.0 binary.
    Glb,
    /// OpenUSD text with its textures.
    Usd,
    /// The same as one package.
    Usdz,
    /// MuJoCo's XML.
    Mjcf,
    /// Unified Robot Description Format, an object each.
    Urdf,
    /// Blender.
    Blend,
    /// Wavefront OBJ.
    Obj,
    /// Drawings and list.
    Plan,
}

impl Format {
    /// All.
    pub const ALL: [Self; 8] =
        [Self::Glb, Self::Usd, Self::Usdz, Self::Mjcf, Self::Urdf, Self::Blend, Self::Obj, Self::Plan];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Glb => "glb",
            Self::Usd => "usd",
            Self::Usdz => "usdz",
            Self::Mjcf => "mjcf",
            Self::Urdf => "urdf",
            Self::Blend => "blend",
            Self::Obj => "obj",
            Self::Plan => "plan",
        }
    }
}

impl FromStr for Format {
    type Err = ExportError;

    fn from_str(text: &str) -> Result<Self, ExportError> {
        Self::ALL
            .into_iter()
            .find(|f| f.name() == text)
            .ok_or_else(|| ExportError::Format { name: text.chars().take(40).collect() })
    }
}

/// How a scene is exported.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Triangles and textures.
    pub budget: Budget,
    /// Of GLB files.
    pub glb: GlbOptions,
    /// Folder in which convex decompositions are kept.
    pub cache: Option<PathBuf>,
}

/// The rigid bodies of a scene.
///
/// # Errors
/// [`ExportError::Body`] for an object that cannot become one.
pub fn bodies(world: &World, options: &Options) -> Result<Bodies, ExportError> {
    let meshes: BTreeMap<ObjectId, Arc<Mesh>> =
        world.items.iter().map(|i| (i.object.id.clone(), Arc::clone(&i.mesh))).collect();
    let settings = BodySettings { cache: options.cache.clone() };
    Ok(harmony_physics::bodies(&world.scene, &meshes, &settings)?)
}

/// Makes the files of the formats and writes them below a folder.
///
/// # Errors
/// [`ExportError`]; nothing was written when a file could not be made.
pub fn export(world: &World, formats: &[Format], folder: &Path, options: &Options) -> Result<Files, ExportError> {
    let world = &world.within(&options.budget);
    let (physical, visual): (Vec<Format>, Vec<Format>) = formats.iter().partition(|f| f.has_bodies());
    let make = |some: &[Format], bodies: &Bodies| -> Result<Vec<Files>, ExportError> {
        let stage = OnceLock::new();
        let stage = || stage.get_or_init(|| usd::stage(world, bodies));
        let one = |format: &Format| match format {
            Format::Glb => glb::write(world, options.glb),
            Format::Usd => usd::write(world, stage()),
            Format::Usdz => usd::write_package(world, stage()),
            Format::Mjcf => mjcf::write(world, bodies),
            Format::Urdf => urdf::write(world, bodies),
            Format::Blend => blend::write(world),
            Format::Obj => obj::write(world),
            Format::Plan => Ok(plan::write(world)),
        };
        some.par_iter().map(one).collect()
    };
    let none = Bodies { objects: Vec::new(), shell: Vec::new() };
    // What needs no bodies is made while they are.
    let (bodies, visual) = rayon::join(
        || if physical.is_empty() { Ok(none.clone()) } else { bodies(world, options) },
        || make(&visual, &none),
    );
    let bodies = bodies?;
    let mut files = Files::default();
    for some in visual?.into_iter().chain(make(&physical, &bodies)?) {
        files.extend(some);
    }
    let mut manifest = Manifest::of(world, formats, options, &bodies, &files);
    if let Ok(before) = Manifest::read(folder) {
        manifest.keep(before);
    }
    files.write(folder)?;
    harmony_io::write_json(&folder.join(MANIFEST), &manifest)?;
    Ok(files)
}
