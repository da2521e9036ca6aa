//! OpenUSD: a stage as `.usda` text with its textures, and the same as one `.usdz` package.
//!
//! # Frame and units
//! +Z up, metres, kilograms, seconds (what Isaac Sim assumes); every prim is in [`crate::world::z_up`] of the room. An
//! object's Xform is its body frame: a translation and a turn about +Z, no scale.
//!
//! # What stands where
//! | path | holds |
//! |---|---|
//! | `/World` | `kind = "assembly"`, gravity, all below |
//! | `/World/room/<face>` | the shell, and its colliders without a body: static |
//! | `/World/<level>/<id>` | one Xform an object, `kind = "component"`; meshes under `visual`, convex hulls under `collision` |
//! | `/World/lights/<id>`, `/World/camera` | UsdLux lights that stay, the photo's camera |
//! | `/World/<level>/<id>/<light>` | the light of a thing that moves: below its Xform, or its `body` where parts open |
//! | `/World/Looks` | UsdPreviewSurface materials, and physics materials by friction and restitution |
//!
//! # Light
//! Intensities are radiometric and normalised (`inputs:normalize`): Φ watts are an intensity of Φ/π, a sun of E W/m2 has E;
//! the scene's exposure is in `inputs:exposure`. Ambient light is a dome, which a closed room lets in by its openings only.
//!
//! # Sources
//! UsdPhysics, UsdLux and UsdPreviewSurface schema pages of OpenUSD 26; the rules of packages from its usdz specification.

pub mod animation;
mod physics;
mod stage;
mod text;
mod usdz;

use crate::files::Files;
use crate::{ExportError, World};

pub(crate) use stage::{level_name, stage};
use usdz::package;

/// `scene.usda` and its textures.
///
/// # Errors
/// [`ExportError::Texture`].
pub(crate) fn write(world: &World, stage: &str) -> Result<Files, ExportError> {
    let mut files = Files::default();
    files.text("usd/scene.usda", stage.to_owned());
    for picture in world.looks.small_files()? {
        files.add(format!("usd/textures/{}", picture.name), picture.bytes);
    }
    Ok(files)
}

/// `scene.usdz`.
///
/// # Errors
/// [`ExportError::Texture`], [`ExportError::TooLarge`].
pub(crate) fn write_package(world: &World, stage: &str) -> Result<Files, ExportError> {
    let mut entries = vec![("scene.usda".to_owned(), stage.as_bytes().into())];
    for picture in world.looks.small_files()? {
        entries.push((format!("textures/{}", picture.name), picture.bytes));
    }
    let mut files = Files::default();
    files.add("usd/scene.usdz", package("usd/scene.usdz", &entries)?);
    Ok(files)
}
