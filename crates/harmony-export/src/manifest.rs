//! `export.json`: what was exported, how, and what is to be known about it.

use std::collections::BTreeMap;
use std::path::Path;

use harmony_io::read_json;
use harmony_physics::Bodies;
use serde::{Deserialize, Serialize};

use crate::files::Files;
use crate::{Budget, ExportError, Format, Options, World};

/// Name of the file.
pub const MANIFEST: &str = "export.json";

/// What stands in `export.json`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Manifest {
    /// Program and version.
    pub generator: String,
    /// Formats by name.
    pub formats: Vec<String>,
    /// Triangles that the scene was reduced to.
    pub faces: Option<usize>,
    /// Longest side of textures, pixels.
    pub texture_px: Option<u32>,
    /// Hash of each file (BLAKE3), by its path.
    pub files: BTreeMap<String, String>,
    /// What moves, what it weighs, how well its colliders fit.
    pub bodies: Vec<BodyRow>,
    /// Parts that open, by object.
    pub opens: BTreeMap<String, Vec<String>>,
    /// Why an object stays rigid although things of its kind open.
    pub rigid: BTreeMap<String, String>,
    /// What was noticed, one sentence each.
    pub notes: Vec<String>,
}

/// One body, in short.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct BodyRow {
    /// The object.
    pub id: String,
    /// Whether it moves.
    pub dynamic: bool,
    /// Kilograms.
    pub mass_kg: f64,
    /// Against wood.
    pub friction: f64,
    /// Restitution.
    pub restitution: f64,
    /// Convex hulls.
    pub hulls: usize,
    /// Distance of colliders and mesh at the 95th percentile, metres.
    pub fit_m: f64,
    /// What was assumed.
    pub notes: Vec<String>,
}

impl Manifest {
    pub(crate) fn of(world: &World, formats: &[Format], options: &Options, bodies: &Bodies, files: &Files) -> Self {
        Self {
            generator: concat!("harmony ", env!("CARGO_PKG_VERSION")).to_owned(),
            formats: formats.iter().map(|f| f.name().to_owned()).collect(),
            faces: options.budget.faces,
            texture_px: options.budget.texture,
            files: files.iter().map(|(p, b)| (p.to_owned(), blake3::hash(b).to_hex().to_string())).collect(),
            bodies: bodies
                .objects
                .iter()
                .map(|b| BodyRow {
                    id: b.id.clone(),
                    dynamic: b.motion == harmony_physics::Motion::Dynamic,
                    mass_kg: b.mass_kg,
                    friction: b.friction,
                    restitution: b.restitution,
                    hulls: b.hulls.len(),
                    fit_m: b.fit_m,
                    notes: b.notes.clone(),
                })
                .collect(),
            opens: world
                .items
                .iter()
                .filter(|i| !i.opens.is_empty())
                .map(|i| (i.name().to_owned(), i.opens.iter().map(|o| o.name.clone()).collect()))
                .collect(),
            rigid: world.items.iter().filter_map(|i| Some((i.name().to_owned(), i.rigid.clone()?))).collect(),
            notes: world.notes.clone(),
        }
    }

    /// Reads the manifest of an export folder.
    ///
    /// # Errors
    /// [`ExportError::NothingExported`] when there is none.
    pub fn read(folder: &Path) -> Result<Self, ExportError> {
        let path = folder.join(MANIFEST);
        if !path.is_file() {
            return Err(ExportError::NothingExported { folder: folder.to_owned() });
        }
        let mut manifest: Self = read_json(&path)?;
        // Paths come from a file: those that lead elsewhere are not followed.
        manifest.files.retain(|p, _| {
            !p.starts_with('/') && p.split('/').all(|part| !part.is_empty() && part != ".." && part != ".")
        });
        Ok(manifest)
    }

    /// Keeps what an earlier export left of other formats, when it was made within the same budget.
    pub(crate) fn keep(&mut self, before: Self) {
        if before.generator != self.generator || before.budget() != self.budget() {
            return;
        }
        // Packages lie beside their layer.
        let format_of = |path: &str| match path.split_once('/') {
            Some((_, "scene.usdz")) => "usdz".to_owned(),
            Some((folder, _)) => folder.to_owned(),
            None => String::new(),
        };
        let again = self.formats.clone();
        for (path, hash) in before.files {
            if !again.contains(&format_of(&path)) {
                self.files.entry(path).or_insert(hash);
            }
        }
        self.formats.extend(before.formats.into_iter().filter(|f| !again.contains(f)));
        if self.bodies.is_empty() {
            self.bodies = before.bodies;
        }
    }

    /// Formats that this program knows.
    pub fn formats(&self) -> Vec<Format> {
        self.formats.iter().filter_map(|f| f.parse().ok()).collect()
    }

    /// The budget it was exported with.
    pub fn budget(&self) -> Budget {
        Budget { faces: self.faces, texture: self.texture_px }
    }
}
