//! Materials and textures of a scene, each once and with a name that every format can write.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use harmony_io::picture;
use harmony_mesh::{Material, Mesh, Tile};
use image::{DynamicImage, RgbImage, RgbaImage};
use rayon::prelude::*;

use crate::ExportError;

/// Quality of colour textures as JPEG, as in our GLB files.
const JPEG_QUALITY: u8 = 92;
/// Quality of normals and surface values as JPEG.
const MAP_QUALITY: u8 = 95;

/// How something looks.
#[derive(Debug, Clone)]
pub struct Look {
    /// `[A-Za-z0-9_]`, unlike all others: the object that has it first, and its slot.
    pub name: String,
    /// Factors; its images are those below.
    pub material: Material,
    /// Colour, index into [`Looks::pictures`].
    pub color: Option<usize>,
    /// Normals.
    pub normal: Option<usize>,
    /// Occlusion, roughness, metalness.
    pub surface: Option<usize>,
}

impl Look {
    /// How much light is stopped, for formats without transmission.
    pub fn opacity(&self) -> f64 {
        let m = &self.material;
        let clear = f64::from(m.transmission.clamp(0.0, 1.0));
        f64::from(m.base_color[3].clamp(0.0, 1.0)) * (1.0 - clear * (1.0 - CLEAR_OPACITY))
    }
}

/// Opacity of what lets all light through: a pane can still be seen.
const CLEAR_OPACITY: f64 = 0.15;

/// What a picture holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureKind {
    /// sRGB colour.
    Color,
    /// Tangent-space normals, or occlusion, roughness and metalness.
    Data,
}

/// A texture.
#[derive(Debug, Clone)]
pub struct Picture {
    /// `[A-Za-z0-9_]`, unlike all others, without an extension.
    pub name: String,
    /// Colour or data.
    pub kind: PictureKind,
    /// Pixels.
    pub pixels: Arc<RgbaImage>,
    /// Whether alpha says anything.
    pub alpha: bool,
    small: Encoded,
    lossless: Encoded,
}

/// Bytes once they were made; who asks while they are waits for them.
type Encoded = Arc<Mutex<Option<Arc<[u8]>>>>;

/// A texture as a file.
#[derive(Debug, Clone)]
pub struct PictureFile {
    /// File name with its extension.
    pub name: String,
    /// Its bytes.
    pub bytes: Arc<[u8]>,
}

/// All looks and pictures of a scene.
#[derive(Debug, Clone, Default)]
pub struct Looks {
    /// Looks.
    pub looks: Vec<Look>,
    /// Pictures.
    pub pictures: Vec<Picture>,
    /// By mesh (its address; the `Arc` is held): the look of each group.
    by_mesh: BTreeMap<usize, (Arc<Mesh>, Vec<usize>)>,
}

/// The tile that a material of a mesh is drawn by, if it is.
pub(super) fn tile_of<'m>(mesh: &Mesh, material: &'m Material) -> Option<&'m Tile> {
    material.tile.as_deref().filter(|tile| {
        material.texture.is_none() && !tile.color.is_empty() && mesh.metric_uvs.len() == mesh.positions.len()
    })
}

/// Text as a name of formats that know letters, digits and underscores only.
pub(crate) fn identifier(text: &str) -> String {
    let mut out: String = text.chars().take(60).map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !out.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
        out.insert(0, '_');
    }
    out
}

impl Looks {
    /// Looks of named meshes, in their order.
    pub fn of<'a>(named: impl Iterator<Item = (&'a str, &'a Arc<Mesh>)>) -> Self {
        let mut out = Self::default();
        let mut known: BTreeMap<String, usize> = BTreeMap::new();
        let mut taken: BTreeMap<String, usize> = BTreeMap::new();
        for (owner, mesh) in named {
            let key = Arc::as_ptr(mesh) as usize;
            if out.by_mesh.contains_key(&key) {
                continue;
            }
            let of_groups = mesh
                .groups
                .iter()
                .map(|group| out.look(owner, mesh, &mesh.materials[group.material], &mut known, &mut taken))
                .collect();
            out.by_mesh.insert(key, (Arc::clone(mesh), of_groups));
        }
        out
    }

    /// The look of each group of a mesh; empty for one that is not of the scene.
    pub fn of_mesh(&self, mesh: &Arc<Mesh>) -> &[usize] {
        self.by_mesh.get(&(Arc::as_ptr(mesh) as usize)).map_or(&[], |(_, looks)| looks)
    }

    fn look(
        &mut self,
        owner: &str,
        mesh: &Mesh,
        material: &Material,
        known: &mut BTreeMap<String, usize>,
        taken: &mut BTreeMap<String, usize>,
    ) -> usize {
        let tile = tile_of(mesh, material);
        let color = material.texture.as_ref().or(tile.map(|t| &t.color)).filter(|t| !t.is_empty());
        let rgba = |image: &Arc<RgbImage>| Arc::new(DynamicImage::ImageRgb8((**image).clone()).into_rgba8());
        let address = |p: Option<*const u8>| p.map_or(0, |p| p as usize);
        let maps = [tile.and_then(|t| t.normal.as_ref()), tile.and_then(|t| t.surface.as_ref())];
        let key = format!(
            "{} {:?} {} {:?} {:?} {} {} {} {} {} {:?} {}",
            material.name,
            material.base_color,
            address(color.map(|c| c.as_raw().as_ptr())),
            maps.map(|m| address(m.filter(|m| !m.is_empty()).map(|m| m.as_raw().as_ptr()))),
            tile.map(|t| (t.size, t.turn)),
            material.sheen,
            material.roughness,
            material.metallic,
            material.ior,
            material.transmission,
            material.emissive,
            material.double_sided,
        );
        if let Some(look) = known.get(&key) {
            return *look;
        }
        let base =
            identifier(&if owner == material.name { owner.to_owned() } else { format!("{owner}_{}", material.name) });
        let count = taken.entry(base.clone()).or_insert(0);
        *count += 1;
        let name = if *count == 1 { base } else { format!("{base}_{count}") };
        let color = color.map(|c| self.picture(&name, PictureKind::Color, c));
        let [normal, surface] = maps;
        let normal = normal.map(|n| self.picture(&format!("{name}_normal"), PictureKind::Data, &rgba(n)));
        let surface = surface.map(|s| self.picture(&format!("{name}_surface"), PictureKind::Data, &rgba(s)));
        let mut material = material.clone();
        (material.texture, material.tile) = (None, None);
        self.looks.push(Look { name, material, color, normal, surface });
        known.insert(key, self.looks.len() - 1);
        self.looks.len() - 1
    }

    fn picture(&mut self, name: &str, kind: PictureKind, pixels: &Arc<RgbaImage>) -> usize {
        if let Some(found) = self.pictures.iter().position(|p| p.kind == kind && *p.pixels == **pixels) {
            return found;
        }
        let alpha = kind == PictureKind::Color && pixels.pixels().any(|p| p.0[3] < 255);
        self.pictures.push(Picture {
            name: name.to_owned(),
            kind,
            pixels: Arc::clone(pixels),
            alpha,
            small: Arc::default(),
            lossless: Arc::default(),
        });
        self.pictures.len() - 1
    }

    /// All pictures as small files: JPEG, or PNG where alpha matters.
    ///
    /// # Errors
    /// [`ExportError::Texture`].
    pub fn small_files(&self) -> Result<Vec<PictureFile>, ExportError> {
        self.pictures.par_iter().map(Picture::small).collect()
    }

    /// All pictures as PNG.
    ///
    /// # Errors
    /// [`ExportError::Texture`].
    pub fn png_files(&self) -> Result<Vec<PictureFile>, ExportError> {
        self.pictures.par_iter().map(Picture::png).collect()
    }
}

impl Picture {
    /// Name of the small file.
    pub fn small_name(&self) -> String {
        format!("{}.{}", self.name, if self.alpha { "png" } else { "jpg" })
    }

    /// As JPEG, or PNG where alpha matters; encoded once.
    ///
    /// # Errors
    /// [`ExportError::Texture`].
    pub fn small(&self) -> Result<PictureFile, ExportError> {
        let quality = if self.kind == PictureKind::Data { MAP_QUALITY } else { JPEG_QUALITY };
        let bytes = self.encoded(&self.small, || {
            if self.alpha { picture::rgba_png(&self.pixels) } else { picture::rgb_jpeg(&self.rgb(), quality) }
        })?;
        Ok(PictureFile { name: self.small_name(), bytes })
    }

    /// As PNG; encoded once.
    ///
    /// # Errors
    /// [`ExportError::Texture`].
    pub fn png(&self) -> Result<PictureFile, ExportError> {
        let bytes = self.encoded(&self.lossless, || {
            if self.alpha { picture::rgba_png(&self.pixels) } else { picture::rgb_png(&self.rgb()) }
        })?;
        Ok(PictureFile { name: format!("{}.png", self.name), bytes })
    }

    fn rgb(&self) -> RgbImage {
        DynamicImage::ImageRgba8((*self.pixels).clone()).into_rgb8()
    }

    fn encoded(
        &self,
        known: &Encoded,
        make: impl FnOnce() -> Result<Vec<u8>, picture::PictureError>,
    ) -> Result<Arc<[u8]>, ExportError> {
        let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bytes) = &*known {
            return Ok(Arc::clone(bytes));
        }
        let bytes: Arc<[u8]> =
            make().map_err(|source| ExportError::Texture { name: self.name.clone(), source })?.into();
        *known = Some(Arc::clone(&bytes));
        Ok(bytes)
    }
}
