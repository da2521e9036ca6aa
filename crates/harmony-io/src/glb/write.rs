//! A [`GlbScene`] as bytes.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::{Arc, LazyLock, Mutex, PoisonError, Weak};

use glam::{Vec2, Vec3};
use harmony_mesh::{Material, Mesh};
use image::{DynamicImage, RgbImage, RgbaImage};
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use super::document::{
    ARRAY_BUFFER, Accessor, Asset, Buffer, BufferView, Document, ELEMENT_ARRAY_BUFFER, FLOAT, ImageEntry,
    MaterialEntry, MeshEntry, Node, Pbr, Primitive, Scene, Texture, TextureRef, UNSIGNED_INT, UNSIGNED_SHORT,
};
use super::normals::unit;
use super::{GlbError, GlbNode, GlbScene, TextureEncoding, lights};
use crate::picture::{rgb_jpeg, rgb_png, rgba_png};

/// In a material's extras: its emission is [`GlbScene::glow`], not a lamp's.
pub(super) const GLOW_KEY: &str = "ambient_glow";
/// Quality of embedded JPEG textures.
const JPEG_QUALITY: u8 = 92;
/// A texture becomes JPEG when PNG is larger than that many times the JPEG.
const JPEG_GAIN: f64 = 1.5;
/// Smaller textures stay PNG, pixels.
const JPEG_MIN_PIXELS: u32 = 64 * 64;
/// Longest text of an extras-free name.
const MAX_NAME: usize = 200;

/// Puts a scene together.
pub(super) fn glb_bytes(scene: &GlbScene<'_>) -> Result<Vec<u8>, GlbError> {
    let glow = if scene.glow.is_finite() { scene.glow.clamp(0.0, 1.0) } else { 0.0 };
    let mut w = Writer { textures: scene.textures, compressed: compressed(scene), glow, ..Writer::default() };
    let mut roots = Vec::new();
    if !scene.shell.is_empty() {
        let children = scene.shell.iter().map(|n| w.mesh_node(n)).collect::<Result<Vec<_>, _>>()?;
        roots.push(w.node(Node { name: "room".to_owned(), children, ..Node::default() }));
    }
    for object in &scene.objects {
        roots.push(w.mesh_node(object)?);
    }
    if let Some(camera) = &scene.camera {
        let (entry, node) = lights::camera(camera);
        w.doc.cameras.push(entry);
        roots.push(w.node(node));
    }
    let mut extras = scene.extras.clone();
    if let Some(lighting) = scene.lighting {
        let (entries, nodes) = lights::lights(lighting);
        if !entries.is_empty() {
            let children = nodes.into_iter().map(|n| w.node(n)).collect();
            roots.push(w.node(Node { name: "lights".to_owned(), children, ..Node::default() }));
            w.uses("KHR_lights_punctual");
            w.doc.extensions.insert("KHR_lights_punctual".to_owned(), json!({ "lights": entries }));
        }
        if !extras.is_object() {
            extras = json!({});
        }
        extras["ambient"] = json!({
            "color": lighting.ambient_color,
            "intensity": lighting.ambient_intensity,
            "exposure": lighting.exposure,
            "view": lighting.view,
        });
    }
    w.doc.asset = Asset { version: "2.0".to_owned(), generator: scene.generator.clone() };
    w.doc.scene = Some(0);
    w.doc.scenes = vec![Scene { name: "scene".to_owned(), nodes: roots, extras }];
    w.finish()
}

#[derive(Default)]
struct Writer {
    doc: Document,
    binary: Vec<u8>,
    textures: TextureEncoding,
    glow: f64,
    /// Entry by mesh; looked up only, never iterated. The value keeps the pointer's owner alive.
    meshes: HashMap<*const Mesh, (Arc<Mesh>, usize)>,
    images: HashMap<*const RgbaImage, (Arc<RgbaImage>, Embedded)>,
    /// What [`compressed`] made; each is taken out once.
    compressed: HashMap<*const RgbaImage, Compressed>,
    materials: BTreeMap<String, usize>,
}

/// A texture in the file.
#[derive(Debug, Clone, Copy)]
struct Embedded {
    /// `None` for an image without pixels.
    texture: Option<usize>,
    alpha: Alpha,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Alpha {
    Opaque,
    /// Cut-outs: nearly every texel is on or off.
    Mask,
    Blend,
}

/// A texture as it goes into the file.
struct Compressed {
    alpha: Alpha,
    file: Result<(Arc<[u8]>, &'static str), GlbError>,
}

impl Compressed {
    fn new(image: &Arc<RgbaImage>, encoding: TextureEncoding) -> Self {
        let alpha = alpha_of(image);
        Self { alpha, file: encoded(image, alpha, encoding) }
    }
}

/// The textures of a scene, each on a core of its own: nothing else in a file takes as long.
fn compressed(scene: &GlbScene<'_>) -> HashMap<*const RgbaImage, Compressed> {
    let mut textures: Vec<&Arc<RgbaImage>> = Vec::new();
    let mut known = HashSet::new();
    for mesh in scene.shell.iter().chain(&scene.objects).map(|node| &node.mesh) {
        let materials = mesh.groups.iter().filter_map(|group| mesh.materials.get(group.material));
        let new = materials.filter_map(|material| material.texture.as_ref());
        textures.extend(new.filter(|t| !t.is_empty() && known.insert(Arc::as_ptr(t))));
    }
    let made: Vec<Compressed> = textures.par_iter().map(|t| Compressed::new(t, scene.textures)).collect();
    textures.into_iter().map(Arc::as_ptr).zip(made).collect()
}

impl Writer {
    fn uses(&mut self, extension: &str) {
        if !self.doc.extensions_used.iter().any(|e| e == extension) {
            self.doc.extensions_used.push(extension.to_owned());
        }
    }

    fn node(&mut self, node: Node) -> usize {
        self.doc.nodes.push(node);
        self.doc.nodes.len() - 1
    }

    fn mesh_node(&mut self, node: &GlbNode) -> Result<usize, GlbError> {
        let t = &node.transform;
        if !(t.translation.is_finite() && t.yaw.is_finite() && t.scale.is_finite() && t.scale.min_element().abs() > 0.0)
        {
            return Err(GlbError::Transform { node: node.name.clone() });
        }
        let mesh = self.mesh(&node.name, &node.mesh)?;
        let half = t.yaw / 2.0;
        Ok(self.node(Node {
            name: node.name.chars().take(MAX_NAME).collect(),
            mesh: Some(mesh),
            translation: (t.translation != glam::DVec3::ZERO).then(|| t.translation.to_array()),
            rotation: (t.yaw != 0.0).then(|| [0.0, half.sin(), 0.0, half.cos()]),
            scale: (t.scale != glam::DVec3::ONE).then(|| t.scale.to_array()),
            extras: node.extras.clone(),
            ..Node::default()
        }))
    }

    fn mesh(&mut self, name: &str, mesh: &Arc<Mesh>) -> Result<usize, GlbError> {
        if let Some((_, index)) = self.meshes.get(&Arc::as_ptr(mesh)) {
            return Ok(*index);
        }
        mesh.check().map_err(|source| GlbError::Mesh { node: name.to_owned(), source })?;
        let mut attributes = BTreeMap::new();
        attributes.insert("POSITION".to_owned(), self.vectors(&mesh.positions, true));
        let normals: Vec<Vec3> = mesh.normals.iter().map(|n| unit(*n).unwrap_or(Vec3::Y)).collect();
        attributes.insert("NORMAL".to_owned(), self.vectors(&normals, false));
        let textured = mesh.groups.iter().any(|g| mesh.materials[g.material].texture.is_some());
        if textured || self.textures == TextureEncoding::Lossless {
            let uvs: Vec<f32> =
                mesh.uvs.iter().flat_map(|uv| if uv.is_finite() { *uv } else { Vec2::ZERO }.to_array()).collect();
            attributes.insert("TEXCOORD_0".to_owned(), self.floats(&uvs, 2, None));
        }
        let mut primitives = Vec::new();
        for group in &mesh.groups {
            let distinct = |t: &&[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
            let indices: Vec<u32> = group.triangles.iter().filter(distinct).flatten().copied().collect();
            if indices.is_empty() {
                continue;
            }
            let material = self.material(&mesh.materials[group.material])?;
            primitives.push(Primitive {
                attributes: attributes.clone(),
                indices: Some(self.indices(&indices, mesh.positions.len())),
                material: Some(material),
                ..Primitive::default()
            });
        }
        if primitives.is_empty() {
            return Err(GlbError::Mesh { node: name.to_owned(), source: harmony_mesh::MeshError::Empty });
        }
        self.doc.meshes.push(MeshEntry { name: name.chars().take(MAX_NAME).collect(), primitives });
        let index = self.doc.meshes.len() - 1;
        self.meshes.insert(Arc::as_ptr(mesh), (Arc::clone(mesh), index));
        Ok(index)
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        self.doc.buffer_views.push(BufferView {
            byte_offset: Some(self.binary.len()),
            byte_length: bytes.len(),
            target,
            ..BufferView::default()
        });
        self.binary.extend_from_slice(bytes);
        self.doc.buffer_views.len() - 1
    }

    fn accessor(&mut self, accessor: Accessor) -> usize {
        self.doc.accessors.push(accessor);
        self.doc.accessors.len() - 1
    }

    fn vectors(&mut self, values: &[Vec3], bounds: bool) -> usize {
        let range = bounds.then(|| {
            values.iter().fold((Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)), |(lo, hi), p| {
                (lo.min(*p), hi.max(*p))
            })
        });
        let flat: Vec<f32> = values.iter().flat_map(glam::Vec3::to_array).collect();
        self.floats(&flat, 3, range)
    }

    fn floats(&mut self, values: &[f32], components: usize, range: Option<(Vec3, Vec3)>) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        let list = |v: Vec3| v.to_array().map(f64::from).to_vec();
        self.accessor(Accessor {
            buffer_view: Some(view),
            component_type: FLOAT,
            count: values.len() / components,
            kind: if components == 3 { "VEC3" } else { "VEC2" }.to_owned(),
            min: range.map(|r| list(r.0)),
            max: range.map(|r| list(r.1)),
            ..Accessor::default()
        })
    }

    fn indices(&mut self, indices: &[u32], vertices: usize) -> usize {
        // 65535 restarts primitives in some programs and is no index.
        let (component_type, bytes): (u32, Vec<u8>) = if vertices <= 65_535 {
            (UNSIGNED_SHORT, indices.iter().flat_map(|i| (*i as u16).to_le_bytes()).collect())
        } else {
            (UNSIGNED_INT, indices.iter().flat_map(|i| i.to_le_bytes()).collect())
        };
        let view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        self.accessor(Accessor {
            buffer_view: Some(view),
            component_type,
            count: indices.len(),
            kind: "SCALAR".to_owned(),
            ..Accessor::default()
        })
    }

    /// The entry of a material; equal materials share one.
    fn material(&mut self, material: &Material) -> Result<usize, GlbError> {
        let unit = |v: f32, default: f64| if v.is_finite() { f64::from(v).clamp(0.0, 1.0) } else { default };
        let embedded = match &material.texture {
            Some(texture) => self.texture(texture)?,
            None => Embedded { texture: None, alpha: Alpha::Opaque },
        };
        let factor = material.base_color.map(|c| unit(c, 1.0));
        let mut extensions = Map::new();
        let mut add = |name: &str, value: Value| extensions.insert(name.to_owned(), value);
        let ior = f64::from(material.ior);
        if ior.is_finite() && ior >= 1.0 && (ior - 1.5).abs() > 1e-6 {
            add("KHR_materials_ior", json!({ "ior": ior }));
        }
        let transmission = unit(material.transmission, 0.0);
        if transmission > 0.0 {
            add("KHR_materials_transmission", json!({ "transmissionFactor": transmission }));
        }
        let emitted = material.emissive.map(|e| if e.is_finite() { f64::from(e).max(0.0) } else { 0.0 });
        let strength = emitted.into_iter().fold(0.0, f64::max);
        if strength > 1.0 {
            add("KHR_materials_emissive_strength", json!({ "emissiveStrength": strength }));
        }
        for name in extensions.keys() {
            if !self.doc.extensions_used.iter().any(|e| e == name) {
                self.doc.extensions_used.push(name.clone());
            }
        }
        // A lamp's own light stays what it is.
        let glow = if strength > 0.0 { 0.0 } else { self.glow };
        let emissive_factor = (strength > 0.0)
            .then(|| emitted.map(|e| e / strength.max(1.0)))
            .or_else(|| (glow > 0.0).then(|| [factor[0], factor[1], factor[2]].map(|c| c * glow)));
        let glow_texture = embedded.texture.filter(|_| glow > 0.0);
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
                base_color_texture: embedded.texture.map(|index| TextureRef { index, ..TextureRef::default() }),
                metallic_factor: Some(unit(material.metallic, 0.0)),
                roughness_factor: Some(unit(material.roughness, 0.6)),
                metallic_roughness_texture: None,
            },
            emissive_factor,
            emissive_texture: glow_texture.map(|index| TextureRef { index, ..TextureRef::default() }),
            extras: if glow > 0.0 { json!({ GLOW_KEY: glow }) } else { Value::Null },
            alpha_mode: alpha_mode.map(str::to_owned),
            alpha_cutoff,
            double_sided: material.double_sided,
            extensions,
            ..MaterialEntry::default()
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
        let made = self.compressed.remove(&Arc::as_ptr(image));
        let Compressed { alpha, file } = made.unwrap_or_else(|| Compressed::new(image, self.textures));
        let texture = if image.is_empty() {
            None
        } else {
            let (bytes, mime) = file?;
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
            Some(self.doc.textures.len() - 1)
        };
        let embedded = Embedded { texture, alpha };
        self.images.insert(Arc::as_ptr(image), (Arc::clone(image), embedded));
        Ok(embedded)
    }

    fn finish(mut self) -> Result<Vec<u8>, GlbError> {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        if !self.binary.is_empty() {
            self.doc.buffers = vec![Buffer { byte_length: self.binary.len(), uri: None }];
        }
        self.doc.extensions_used.sort();
        let mut text = serde_json::to_vec(&self.doc)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let with_binary = if self.binary.is_empty() { 0 } else { 8 + self.binary.len() };
        let total = 12 + 8 + text.len() + with_binary;
        let total_u32 = u32::try_from(total).map_err(|_| GlbError::TooLarge {
            what: "bytes",
            count: total as u64,
            limit: u32::MAX.into(),
        })?;
        let mut out = Vec::with_capacity(total);
        out.extend(b"glTF");
        out.extend(2_u32.to_le_bytes());
        out.extend(total_u32.to_le_bytes());
        out.extend((text.len() as u32).to_le_bytes());
        out.extend(b"JSON");
        out.extend(text);
        if !self.binary.is_empty() {
            out.extend((self.binary.len() as u32).to_le_bytes());
            out.extend(b"BIN\0");
            out.extend(self.binary);
        }
        Ok(out)
    }
}

fn alpha_of(image: &RgbaImage) -> Alpha {
    let (mut clear, mut between) = (0_usize, 0_usize);
    for p in image.pixels() {
        match p.0[3] {
            255 => {}
            0..=8 => clear += 1,
            _ => between += 1,
        }
    }
    match (clear, between) {
        (0, 0) => Alpha::Opaque,
        // Soft rims of cut-outs are a small part of them.
        (c, b) if b <= (c / 8).max(image.as_raw().len() / 4 / 50) && c > 0 => Alpha::Mask,
        _ => Alpha::Blend,
    }
}

fn encoded(
    image: &Arc<RgbaImage>,
    alpha: Alpha,
    encoding: TextureEncoding,
) -> Result<(Arc<[u8]>, &'static str), GlbError> {
    let png = lossless(image, alpha)?;
    if alpha == Alpha::Opaque
        && encoding == TextureEncoding::Compact
        && image.width() * image.height() >= JPEG_MIN_PIXELS
    {
        let jpeg = rgb_jpeg(&without_alpha(image), JPEG_QUALITY)?;
        if png.len() as f64 > JPEG_GAIN * jpeg.len() as f64 {
            return Ok((jpeg.into(), "image/jpeg"));
        }
    }
    Ok((png, "image/png"))
}

/// The texture as PNG, made once as long as somebody holds it: a mesh is written with its answer, as an object, and in the
/// scene.
fn lossless(image: &Arc<RgbaImage>, alpha: Alpha) -> Result<Arc<[u8]>, GlbError> {
    /// By address, which stays that texture's own as long as the `Weak` is here.
    type Known = HashMap<usize, (Weak<RgbaImage>, Arc<[u8]>)>;
    static KNOWN: LazyLock<Mutex<Known>> = LazyLock::new(Mutex::default);
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let key = Arc::as_ptr(image) as usize;
    if let Some((_, file)) = known().get(&key) {
        return Ok(Arc::clone(file));
    }
    let file = if alpha == Alpha::Opaque { rgb_png(&without_alpha(image))? } else { rgba_png(image)? };
    let file: Arc<[u8]> = file.into();
    let mut known = known();
    known.retain(|_, (texture, _)| texture.strong_count() > 0);
    known.insert(key, (Arc::downgrade(image), Arc::clone(&file)));
    Ok(file)
}

fn without_alpha(image: &RgbaImage) -> RgbImage {
    DynamicImage::ImageRgba8(image.clone()).into_rgb8()
}
