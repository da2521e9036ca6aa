//! A [`GlbScene`] as bytes.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use glam::{Vec2, Vec3};
use harmony_mesh::{Mesh, Tile};
use image::{RgbImage, RgbaImage};
use serde_json::json;

use super::document::{
    ARRAY_BUFFER, Accessor, Asset, Buffer, BufferView, Document, ELEMENT_ARRAY_BUFFER, FLOAT, MeshEntry, Node,
    Primitive, Scene, UNSIGNED_INT, UNSIGNED_SHORT,
};
use super::normals::{tangents, unit};
use super::surface::Embedded;
use super::texture::{Files, tiled};
use super::{GlbError, GlbNode, GlbScene, NodeGroup, TextureEncoding, lights};

/// In a material's extras: its emission is [`GlbScene::glow`], not a lamp's.
pub(super) const GLOW_KEY: &str = "ambient_glow";
/// Longest text of an extras-free name.
pub(super) const MAX_NAME: usize = 200;

/// Puts a scene together.
pub(super) fn glb_bytes(scene: &GlbScene<'_>, groups: &[NodeGroup]) -> Result<Vec<u8>, GlbError> {
    let glow = if scene.glow.is_finite() { scene.glow.clamp(0.0, 1.0) } else { 0.0 };
    let mut w = Writer { textures: scene.textures, files: Files::of(scene), glow, ..Writer::default() };
    let mut roots = Vec::new();
    let group_of: HashMap<&str, usize> =
        groups.iter().enumerate().flat_map(|(k, g)| g.members.iter().map(move |m| (m.as_str(), k))).collect();
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); groups.len()];
    let mut shell = Vec::new();
    for face in &scene.shell {
        let node = w.mesh_node(face)?;
        match group_of.get(face.name.as_str()) {
            Some(k) => members[*k].push(node),
            None => shell.push(node),
        }
    }
    if !shell.is_empty() {
        roots.push(w.node(Node { name: "room".to_owned(), children: shell, ..Node::default() }));
    }
    for object in &scene.objects {
        let node = w.mesh_node(object)?;
        match group_of.get(object.name.as_str()) {
            Some(k) => members[*k].push(node),
            None => roots.push(node),
        }
    }
    for (group, children) in groups.iter().zip(members).filter(|(_, children)| !children.is_empty()) {
        let name = group.name.chars().take(MAX_NAME).collect();
        roots.push(w.node(Node { name, children, extras: group.extras.clone(), ..Node::default() }));
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

/// A file as it grows. Maps by address are looked up only, never iterated; their values keep the owner alive.
#[derive(Default)]
pub(super) struct Writer {
    pub(super) doc: Document,
    binary: Vec<u8>,
    textures: TextureEncoding,
    pub(super) glow: f64,
    meshes: HashMap<*const Mesh, (Arc<Mesh>, usize)>,
    pub(super) images: HashMap<*const RgbaImage, (Arc<RgbaImage>, Embedded)>,
    pub(super) maps: HashMap<*const RgbImage, (Arc<RgbImage>, usize)>,
    /// Textures by the bytes of their files.
    pub(super) embedded: BTreeMap<Arc<[u8]>, usize>,
    pub(super) files: Files,
    pub(super) materials: BTreeMap<String, usize>,
}

impl Writer {
    pub(super) fn uses(&mut self, extension: &str) {
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
        let any_tile = mesh.groups.iter().any(|g| tiled(mesh, &mesh.materials[g.material]));
        // Without tiles all primitives share the vertices; with tiles each has its own, for their coordinates differ.
        let shared = if any_tile { None } else { Some(self.attributes(mesh, None, None, &[])) };
        let mut primitives = Vec::new();
        for group in &mesh.groups {
            let distinct = |t: &&[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
            let mut indices: Vec<u32> = group.triangles.iter().filter(distinct).flatten().copied().collect();
            if indices.is_empty() {
                continue;
            }
            let look = &mesh.materials[group.material];
            let tile = look.tile.as_deref().filter(|_| tiled(mesh, look));
            let material = self.material(look, tile)?;
            let (attributes, count) = if let Some(attributes) = &shared {
                (attributes.clone(), mesh.positions.len())
            } else {
                let used = compact(&mut indices, mesh.positions.len());
                (self.attributes(mesh, Some(&used), tile, &indices), used.len())
            };
            primitives.push(Primitive {
                attributes,
                indices: Some(self.indices(&indices, count)),
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

    /// Vertices of a mesh, all or those named; texture coordinates of the tile where there is one, tangents by them and the
    /// triangles where it has normals.
    fn attributes(
        &mut self,
        mesh: &Mesh,
        used: Option<&[u32]>,
        tile: Option<&Tile>,
        indices: &[u32],
    ) -> BTreeMap<String, usize> {
        fn pick<T: Copy>(all: &[T], used: Option<&[u32]>) -> Vec<T> {
            used.map_or_else(|| all.to_vec(), |used| used.iter().map(|i| all[*i as usize]).collect())
        }
        let finite = |uv: Vec2| if uv.is_finite() { uv } else { Vec2::ZERO };
        let positions = pick(&mesh.positions, used);
        let mut attributes = BTreeMap::new();
        attributes.insert("POSITION".to_owned(), self.vectors(&positions, true));
        let normals: Vec<Vec3> = pick(&mesh.normals, used).into_iter().map(|n| unit(n).unwrap_or(Vec3::Y)).collect();
        attributes.insert("NORMAL".to_owned(), self.vectors(&normals, false));
        if mesh.colors.len() == mesh.positions.len() && !mesh.colors.is_empty() {
            let colors = pick(&mesh.colors, used);
            attributes.insert("COLOR_0".to_owned(), self.colors(&colors));
        }
        let textured = mesh.groups.iter().any(|g| mesh.materials[g.material].texture.is_some());
        let uvs: Option<Vec<Vec2>> = match tile {
            Some(tile) => Some(pick(&mesh.metric_uvs, used).into_iter().map(|m| finite(tile.uv(m))).collect()),
            None if textured || self.textures == TextureEncoding::Lossless => {
                Some(pick(&mesh.uvs, used).into_iter().map(finite).collect())
            }
            None => None,
        };
        if let Some(uvs) = uvs {
            if tile.is_some_and(|t| t.normal.is_some()) {
                let all = tangents(&positions, &normals, &uvs, indices);
                let flat: Vec<f32> = all.iter().flat_map(glam::Vec4::to_array).collect();
                attributes.insert("TANGENT".to_owned(), self.floats(&flat, 4, None));
            }
            let flat: Vec<f32> = uvs.iter().flat_map(Vec2::to_array).collect();
            attributes.insert("TEXCOORD_0".to_owned(), self.floats(&flat, 2, None));
        }
        attributes
    }

    pub(super) fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
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

    /// Linear colours as 16-bit shares, with an opaque alpha that keeps elements at multiples of four bytes.
    fn colors(&mut self, colors: &[[f32; 3]]) -> usize {
        let share = |v: f32| (v.clamp(0.0, 1.0) * 65_535.0).round() as u16;
        let bytes: Vec<u8> = colors
            .iter()
            .flat_map(|[r, g, b]| [share(*r), share(*g), share(*b), u16::MAX])
            .flat_map(u16::to_le_bytes)
            .collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        self.accessor(Accessor {
            buffer_view: Some(view),
            component_type: UNSIGNED_SHORT,
            normalized: true,
            count: colors.len(),
            kind: "VEC4".to_owned(),
            ..Accessor::default()
        })
    }

    fn floats(&mut self, values: &[f32], components: usize, range: Option<(Vec3, Vec3)>) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        let list = |v: Vec3| v.to_array().map(f64::from).to_vec();
        self.accessor(Accessor {
            buffer_view: Some(view),
            component_type: FLOAT,
            count: values.len() / components,
            kind: format!("VEC{components}"),
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

/// Numbers the vertices that indices use from 0 in their own order; which they are.
fn compact(indices: &mut [u32], count: usize) -> Vec<u32> {
    let mut place = vec![u32::MAX; count];
    for i in indices.iter() {
        place[*i as usize] = 0;
    }
    let used: Vec<u32> = (0..count as u32).filter(|i| place[*i as usize] == 0).collect();
    for (k, i) in used.iter().enumerate() {
        place[*i as usize] = k as u32;
    }
    for i in indices.iter_mut() {
        *i = place[*i as usize];
    }
    used
}
