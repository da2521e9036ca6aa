//! Materials as they are written.
//!
//! # Clear things
//! glTF wants materials with KHR_materials_transmission opaque; a viewer without the extension then shows white blocks.
//! Here they are blended, with a base alpha that falls to [`CLEAR_ALPHA`] for full transmission: such a viewer shows a
//! tinted pane. Viewers with the extension (three.js, Blender) let light through either way; what remains of their
//! alpha lets the background through once more, which for a clear pane is the same picture, its highlights weaker. The
//! alpha that was meant stands in the material's extras.
//!
//! # Tiles
//! A material with a tile has base colour, normals and metallic-roughness as textures that repeat, and its primitives
//! have texture coordinates in tiles. Size and turn of the tile in metres stand in the extras (`harmony.tile`), so that
//! the metric coordinates can be read back.

use std::sync::Arc;

use harmony_mesh::{Material, Tile};
use image::{RgbImage, RgbaImage};
use serde_json::{Map, Value, json};

use super::GlbError;
use super::document::{ImageEntry, MaterialEntry, NormalRef, Pbr, Texture, TextureRef};
use super::texture::{Alpha, Compressed, File};
use super::write::{GLOW_KEY, MAX_NAME, Writer};

/// Base alpha of what lets all light through.
const CLEAR_ALPHA: f64 = 0.30;
/// Roughness of sheen: as of velvet and wool.
const SHEEN_ROUGHNESS: f64 = 0.4;

/// A texture in the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Embedded {
    /// `None` for an image without pixels.
    texture: Option<usize>,
    alpha: Alpha,
}

impl Embedded {
    fn reference(self) -> Option<TextureRef> {
        self.texture.map(|index| TextureRef { index, ..TextureRef::default() })
    }
}

impl Writer {
    /// The entry of a material; equal materials share one. `tile`: what it is drawn by, where there is no texture.
    pub(super) fn material(&mut self, material: &Material, tile: Option<&Tile>) -> Result<usize, GlbError> {
        let unit = |v: f32, default: f64| if v.is_finite() { f64::from(v).clamp(0.0, 1.0) } else { default };
        let color = material.texture.as_ref().or(tile.map(|t| &t.color));
        let embedded = match color {
            Some(texture) => self.texture(texture)?,
            None => Embedded { texture: None, alpha: Alpha::Opaque },
        };
        let map = |writer: &mut Self, image: Option<&Arc<RgbImage>>| image.map_or(Ok(None), |i| writer.map(i));
        let normal = map(self, tile.and_then(|t| t.normal.as_ref()))?;
        let surface = map(self, tile.and_then(|t| t.surface.as_ref()))?;
        let mut factor = material.base_color.map(|c| unit(c, 1.0));
        let mut extensions = Map::new();
        let mut extras = Map::new();
        let mut add = |name: &str, value: Value| extensions.insert(name.to_owned(), value);
        let ior = f64::from(material.ior);
        if ior.is_finite() && ior >= 1.0 && (ior - 1.5).abs() > 1e-6 {
            add("KHR_materials_ior", json!({ "ior": ior }));
        }
        let transmission = unit(material.transmission, 0.0);
        if transmission > 0.0 {
            add("KHR_materials_transmission", json!({ "transmissionFactor": transmission }));
            extras.insert("alpha".to_owned(), json!(factor[3]));
            factor[3] *= 1.0 - transmission * (1.0 - CLEAR_ALPHA);
        }
        let sheen = unit(material.sheen, 0.0);
        if sheen > 0.0 {
            let tint = sheen_tint(material, color);
            add(
                "KHR_materials_sheen",
                json!({ "sheenColorFactor": tint.map(|c| c * sheen), "sheenRoughnessFactor": SHEEN_ROUGHNESS }),
            );
            extras.insert("sheen".to_owned(), json!(sheen));
        }
        if material.hairy {
            extras.insert("hairy".to_owned(), json!(true));
        }
        let emitted = material.emissive.map(|e| if e.is_finite() { f64::from(e).max(0.0) } else { 0.0 });
        let strength = emitted.into_iter().fold(0.0, f64::max);
        if strength > 1.0 {
            add("KHR_materials_emissive_strength", json!({ "emissiveStrength": strength }));
        }
        let names: Vec<String> = extensions.keys().cloned().collect();
        for name in &names {
            self.uses(name);
        }
        if let Some(tile) = tile {
            extras.insert("tile".to_owned(), json!({ "size": tile.size, "turn": tile.turn }));
        }
        // A lamp's own light stays what it is.
        let glow = if strength > 0.0 { 0.0 } else { self.glow };
        let emissive_factor = (strength > 0.0)
            .then(|| emitted.map(|e| e / strength.max(1.0)))
            .or_else(|| (glow > 0.0).then(|| [factor[0], factor[1], factor[2]].map(|c| c * glow)));
        let mut all_extras = Map::new();
        if !extras.is_empty() {
            all_extras.insert("harmony".to_owned(), Value::Object(extras));
        }
        if glow > 0.0 {
            all_extras.insert(GLOW_KEY.to_owned(), json!(glow));
        }
        let (alpha_mode, alpha_cutoff) = match embedded.alpha {
            _ if factor[3] < 1.0 => (Some("BLEND"), None),
            Alpha::Opaque => (None, None),
            Alpha::Mask => (Some("MASK"), Some(0.5)),
            Alpha::Blend => (Some("BLEND"), None),
        };
        let entry = MaterialEntry {
            name: material.name.chars().take(MAX_NAME).collect(),
            pbr_metallic_roughness: Pbr {
                base_color_factor: Some(factor),
                base_color_texture: embedded.reference(),
                metallic_factor: Some(unit(material.metallic, 0.0)),
                roughness_factor: Some(unit(material.roughness, 0.6)),
                metallic_roughness_texture: surface.map(|index| TextureRef { index, ..TextureRef::default() }),
            },
            normal_texture: normal.map(|index| NormalRef { index, ..NormalRef::default() }),
            emissive_factor,
            emissive_texture: embedded.reference().filter(|_| glow > 0.0),
            alpha_mode: alpha_mode.map(str::to_owned),
            alpha_cutoff,
            double_sided: material.double_sided,
            extensions,
            extras: if all_extras.is_empty() { Value::Null } else { Value::Object(all_extras) },
        };
        let key = serde_json::to_string(&entry)?;
        let next = self.doc.materials.len();
        let index = *self.materials.entry(key).or_insert(next);
        if index == next {
            self.doc.materials.push(entry);
        }
        Ok(index)
    }

    fn texture(&mut self, image: &Arc<RgbaImage>) -> Result<Embedded, GlbError> {
        if let Some((_, embedded)) = self.images.get(&Arc::as_ptr(image)) {
            return Ok(*embedded);
        }
        let Compressed { alpha, file } = self.files.color(image);
        let texture = if image.is_empty() { None } else { Some(self.embed(file?)) };
        let embedded = Embedded { texture, alpha };
        self.images.insert(Arc::as_ptr(image), (Arc::clone(image), embedded));
        Ok(embedded)
    }

    fn map(&mut self, image: &Arc<RgbImage>) -> Result<Option<usize>, GlbError> {
        if let Some((_, texture)) = self.maps.get(&Arc::as_ptr(image)) {
            return Ok(Some(*texture));
        }
        if image.is_empty() {
            return Ok(None);
        }
        let file = self.files.map(image)?;
        let texture = self.embed(file);
        self.maps.insert(Arc::as_ptr(image), (Arc::clone(image), texture));
        Ok(Some(texture))
    }

    /// The texture of an image file; the same bytes are written once.
    fn embed(&mut self, (bytes, mime): File) -> usize {
        if let Some(texture) = self.embedded.get(&bytes) {
            return *texture;
        }
        let view = self.view(&bytes, None);
        self.doc.images.push(ImageEntry {
            name: format!("texture_{}", self.doc.images.len()),
            buffer_view: Some(view),
            mime_type: Some(mime.to_owned()),
            uri: None,
        });
        if self.doc.samplers.is_empty() {
            // Linear with mipmaps, repeating.
            self.doc.samplers.push(json!({ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 }));
        }
        let source = Some(self.doc.images.len() - 1);
        self.doc.textures.push(Texture { sampler: Some(0), source, ..Texture::default() });
        let texture = self.doc.textures.len() - 1;
        self.embedded.insert(bytes, texture);
        texture
    }
}

/// Share of white in the colour of a sheen: fibres are dyed, their glint is not.
const SHEEN_WHITE: f64 = 0.25;
/// Luminance of a cloth whose sheen is as bright as its number says; a darker one's is darker with it. White fibres on
/// a dark red cover would leave it brown.
const SHEEN_FULL: f64 = 0.2;

/// The colour of a cloth's sheen: mostly its own hue.
fn sheen_tint(material: &Material, color: Option<&Arc<RgbaImage>>) -> [f64; 3] {
    let mean = color.filter(|c| !c.is_empty()).map_or([1.0; 3], |image| {
        let n = image.pixels().len() as f64;
        let mut sum = [0.0; 3];
        for p in image.pixels() {
            for (s, c) in sum.iter_mut().zip(p.0) {
                *s += f64::from(super::material::linear(f32::from(c))) / n;
            }
        }
        sum
    });
    let own: [f64; 3] = std::array::from_fn(|k| mean[k] * f64::from(material.base_color[k]).clamp(0.0, 1.0));
    let most = own.iter().copied().fold(1e-6, f64::max);
    // Rounded, so that equal materials stay equal in the file.
    let level = (0.2126 * own[0] + 0.7152 * own[1] + 0.0722 * own[2]) / SHEEN_FULL;
    own.map(|c| ((SHEEN_WHITE + (1.0 - SHEEN_WHITE) * c / most) * level.min(1.0) * 1000.0).round() / 1000.0)
}
