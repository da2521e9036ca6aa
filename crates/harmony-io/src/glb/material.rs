//! Materials of a GLB file in our terms.

use std::sync::Arc;

use glam::Vec2;
use harmony_mesh::{Material, Tile};
use image::{DynamicImage, RgbImage, RgbaImage};
use serde_json::Value;

use super::GlbError;
use super::accessor::Source;
use super::document::{MaterialEntry, TextureRef};
use crate::picture;

/// A material, and how its texture coordinates are made.
#[derive(Debug, Clone)]
pub(super) struct Look {
    pub material: Material,
    /// Which set of coordinates.
    pub tex_coord: u32,
    /// KHR_texture_transform: offset, rotation, scale.
    transform: Option<(Vec2, f32, Vec2)>,
}

impl Look {
    /// Coordinates as the texture wants them.
    pub(super) fn uv(&self, uv: Vec2) -> Vec2 {
        let uv = if uv.is_finite() { uv } else { Vec2::ZERO };
        match self.transform {
            None => uv,
            Some((offset, rotation, scale)) => {
                let (sin, cos) = rotation.sin_cos();
                let s = uv * scale;
                offset + Vec2::new(cos * s.x + sin * s.y, -sin * s.x + cos * s.y)
            }
        }
    }
}

/// Materials and textures already made.
pub(super) struct Materials {
    looks: Vec<Option<Arc<Look>>>,
    images: Vec<Option<Arc<RgbaImage>>>,
    pixels_left: u64,
    pub notes: Vec<String>,
}

fn unit(value: Option<f64>, default: f32) -> f32 {
    value.filter(|v| v.is_finite()).map_or(default, |v| v.clamp(0.0, 1.0) as f32)
}

fn number(value: Option<&Value>) -> Option<f64> {
    value.and_then(Value::as_f64).filter(|v| v.is_finite())
}

/// Linear value of an sRGB byte.
pub(super) fn linear(byte: f32) -> f32 {
    let c = byte / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

impl Materials {
    pub(super) fn new(pixels: u64) -> Self {
        Self { looks: Vec::new(), images: Vec::new(), pixels_left: pixels, notes: Vec::new() }
    }

    /// The look of a primitive; none given is glTF's default material.
    pub(super) fn get(&mut self, source: &Source<'_>, index: Option<usize>) -> Result<Arc<Look>, GlbError> {
        let Some(index) = index else { return Ok(Arc::new(self.make(source, &MaterialEntry::default(), "default"))) };
        let entry = source.doc.materials.get(index).ok_or(GlbError::Broken { what: "material", index })?;
        self.looks.resize(source.doc.materials.len(), None);
        if let Some(look) = &self.looks[index] {
            return Ok(Arc::clone(look));
        }
        let name: String = entry.name.chars().filter(|c| !c.is_control()).take(60).collect();
        let name = if name.is_empty() { format!("material_{index}") } else { name };
        let look = Arc::new(self.make(source, entry, &name));
        self.looks[index] = Some(Arc::clone(&look));
        Ok(look)
    }

    fn make(&mut self, source: &Source<'_>, entry: &MaterialEntry, name: &str) -> Look {
        let pbr = &entry.pbr_metallic_roughness;
        let extension = |name: &str, key: &str| entry.extensions.get(name).and_then(|e| e.get(key));
        let mut factor = pbr.base_color_factor.unwrap_or([1.0; 4]);
        let mut reference = pbr.base_color_texture.as_ref();
        let old: Option<TextureRef> = extension("KHR_materials_pbrSpecularGlossiness", "diffuseTexture")
            .and_then(|t| serde_json::from_value(t.clone()).ok());
        let old_style = entry.extensions.contains_key("KHR_materials_pbrSpecularGlossiness");
        if old_style {
            reference = old.as_ref().or(reference);
            if let Some(list) =
                extension("KHR_materials_pbrSpecularGlossiness", "diffuseFactor").and_then(Value::as_array)
            {
                for (f, v) in factor.iter_mut().zip(list) {
                    *f = v.as_f64().unwrap_or(1.0);
                }
            }
        }
        let mut base_color = factor.map(|c| unit(Some(c), 1.0));
        let mut texture = reference.and_then(|r| self.texture(source, r.index));
        let mut metallic = unit(pbr.metallic_factor, 1.0);
        let mut roughness = unit(pbr.roughness_factor, 1.0);
        if old_style {
            metallic = 0.0;
            let gloss = number(extension("KHR_materials_pbrSpecularGlossiness", "glossinessFactor"));
            roughness = 1.0 - unit(gloss, 1.0);
        }
        let surface = pbr.metallic_roughness_texture.as_ref().and_then(|r| self.texture(source, r.index));
        let tile = tile_place(&entry.extras).zip(texture.clone()).map(|((size, turn), color)| {
            let normal = entry.normal_texture.as_ref().and_then(|r| self.texture(source, r.index));
            Arc::new(Tile {
                size,
                turn,
                color,
                normal: normal.map(|n| opaque(&n)),
                surface: surface.as_ref().map(|s| opaque(s)),
            })
        });
        if let (Some(map), None) = (&surface, &tile) {
            // Our materials have one roughness and one metalness: the texture's means (green and blue).
            let mean = mean(map);
            roughness *= mean[1] / 255.0;
            metallic *= mean[2] / 255.0;
        }
        let strength = number(extension("KHR_materials_emissive_strength", "emissiveStrength")).unwrap_or(1.0);
        let glows = entry.extras.get(super::write::GLOW_KEY).is_some();
        let given = entry.emissive_factor.filter(|_| !glows);
        let mut emissive = given.unwrap_or([0.0; 3]).map(|e| unit(Some(e), 0.0));
        if emissive.iter().any(|e| *e > 0.0)
            && let Some(map) = entry.emissive_texture.as_ref().and_then(|r| self.texture(source, r.index))
        {
            let mean = mean(&map);
            for (e, m) in emissive.iter_mut().zip(mean) {
                *e *= linear(m);
            }
        }
        let emissive = emissive.map(|e| e * strength.clamp(0.0, 1e6) as f32);
        match entry.alpha_mode.as_deref() {
            Some("BLEND") => {}
            Some("MASK") => {
                let cutoff = unit(entry.alpha_cutoff, 0.5) / base_color[3].max(1e-3);
                if let Some(t) = &mut texture {
                    for p in Arc::make_mut(t).pixels_mut() {
                        p.0[3] = if f32::from(p.0[3]) / 255.0 >= cutoff { 255 } else { 0 };
                    }
                }
                base_color[3] = 1.0;
            }
            _ => {
                base_color[3] = 1.0;
                if let Some(t) = &mut texture
                    && t.pixels().any(|p| p.0[3] < 255)
                {
                    for p in Arc::make_mut(t).pixels_mut() {
                        p.0[3] = 255;
                    }
                }
            }
        }
        let mut transmission = unit(number(extension("KHR_materials_transmission", "transmissionFactor")), 0.0);
        let map: Option<TextureRef> = extension("KHR_materials_transmission", "transmissionTexture")
            .and_then(|t| serde_json::from_value(t.clone()).ok());
        if let Some(map) = map.filter(|_| transmission > 0.0).and_then(|r| self.texture(source, r.index)) {
            transmission *= mean(&map)[0] / 255.0;
        }
        // The alpha that was meant, where what is written is the fallback of a clear thing.
        if let Some(alpha) = number(entry.extras.pointer("/harmony/alpha")).filter(|_| transmission > 0.0) {
            base_color[3] = unit(Some(alpha), 1.0);
        }
        let sheen_color = extension("KHR_materials_sheen", "sheenColorFactor");
        let sheen = sheen_color.map_or(0.0, |color| {
            // The number that was meant; of other writers' files the brightest channel.
            let meant = number(entry.extras.pointer("/harmony/sheen"));
            let brightest = || (0..3).filter_map(|k| number(color.get(k))).fold(0.0, f64::max);
            unit(Some(meant.unwrap_or_else(brightest)), 0.0)
        });
        let place = reference.and_then(|r| r.extensions.get("KHR_texture_transform"));
        let pair = |key: &str, default: f32| {
            let list = place.and_then(|p| p.get(key)).and_then(Value::as_array);
            let at = |k: usize| number(list.and_then(|l| l.get(k))).map_or(default, |v| v as f32);
            Vec2::new(at(0), at(1))
        };
        let rotation = number(place.and_then(|p| p.get("rotation"))).unwrap_or(0.0) as f32;
        let other_set = place.and_then(|p| p.get("texCoord")).and_then(Value::as_u64).map(|v| v as u32);
        Look {
            tex_coord: other_set.or(reference.and_then(|r| r.tex_coord)).unwrap_or(0),
            transform: place.map(|_| (pair("offset", 0.0), rotation, pair("scale", 1.0))),
            material: Material {
                name: name.to_owned(),
                base_color,
                texture: if tile.is_some() { None } else { texture },
                tile,
                sheen,
                roughness,
                metallic,
                ior: number(extension("KHR_materials_ior", "ior")).map_or(1.5, |v| v.clamp(1.0, 3.0) as f32),
                transmission,
                emissive,
                double_sided: entry.double_sided,
                hairy: entry.extras.pointer("/harmony/hairy").is_some_and(|v| v == &Value::Bool(true)),
            },
        }
    }

    /// A texture's image; a broken or foreign one is left out with a note.
    fn texture(&mut self, source: &Source<'_>, index: usize) -> Option<Arc<RgbaImage>> {
        let texture = source.doc.textures.get(index)?;
        let webp = texture.extensions.get("EXT_texture_webp").and_then(|e| e.get("source")).and_then(Value::as_u64);
        let image = webp.map(|v| v as usize).or(texture.source)?;
        self.images.resize(source.doc.images.len(), None);
        if let Some(done) = self.images.get(image)? {
            return Some(Arc::clone(done));
        }
        let entry = &source.doc.images[image];
        let decoded = match entry.buffer_view.map(|v| source.view(v)) {
            Some(Ok(bytes)) => self.decode(bytes),
            Some(Err(_)) => Err("its bytes are not there".to_owned()),
            None => Err("it is not inside the file".to_owned()),
        };
        match decoded {
            Ok(image_data) => {
                let image_data = Arc::new(image_data);
                self.images[image] = Some(Arc::clone(&image_data));
                Some(image_data)
            }
            Err(why) => {
                self.notes.push(format!("texture {index} was left out: {why}"));
                None
            }
        }
    }

    fn decode(&mut self, bytes: &[u8]) -> Result<RgbaImage, String> {
        let reader = image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format();
        let (w, h) = reader.map_err(|e| e.to_string())?.into_dimensions().map_err(|e| e.to_string())?;
        let pixels = u64::from(w) * u64::from(h);
        if pixels > self.pixels_left {
            return Err(format!("{w} x {h} pixels are too many"));
        }
        self.pixels_left -= pixels;
        Ok(picture::decode(bytes).map_err(|e| e.to_string())?.into_rgba8())
    }
}

/// Size in metres and turn of a tile, as our own files have them.
fn tile_place(extras: &Value) -> Option<([f32; 2], f32)> {
    let tile = extras.pointer("/harmony/tile")?;
    let side = |k: usize| number(tile.get("size")?.get(k)).map(|v| v as f32).filter(|v| (1e-4..1e4).contains(v));
    Some(([side(0)?, side(1)?], number(tile.get("turn")).unwrap_or(0.0) as f32))
}

fn opaque(image: &RgbaImage) -> Arc<RgbImage> {
    Arc::new(DynamicImage::ImageRgba8(image.clone()).into_rgb8())
}

/// Mean of each colour channel, 0 to 255.
fn mean(image: &RgbaImage) -> [f32; 3] {
    let n = f64::from(image.width() * image.height()).max(1.0);
    let mut sum = [0.0_f64; 3];
    for p in image.pixels() {
        for (s, v) in sum.iter_mut().zip(p.0) {
            *s += f64::from(v);
        }
    }
    sum.map(|s| (s / n) as f32)
}
