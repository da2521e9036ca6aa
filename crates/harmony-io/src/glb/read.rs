//! GLB bytes as meshes. Nothing in the file is trusted.

use std::sync::Arc;

use glam::{DAffine3, DMat4, DQuat, DVec3, Vec2, Vec3};
use harmony_mesh::{Group, Mesh};
use serde_json::Value;

use super::accessor::Source;
use super::document::{Document, Node, Primitive};
use super::material::Materials;
use super::normals::{creased, unit};
use super::{GlbError, LoadedGlb, LoadedNode, ReadLimits};

/// Required extensions that geometry does not depend on, or that are understood.
const UNDERSTOOD: [&str; 14] = [
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_specular",
    "KHR_materials_clearcoat",
    "KHR_materials_sheen",
    "KHR_materials_volume",
    "KHR_materials_variants",
    "KHR_lights_punctual",
    "EXT_texture_webp",
];

/// Length of the JSON for a node with all that belongs to it, generously.
const JSON_BYTES_PER_NODE: usize = 1024;

/// Reads a file's meshes.
pub(super) fn read(bytes: &[u8], limits: &ReadLimits) -> Result<LoadedGlb, GlbError> {
    if bytes.len() as u64 > limits.bytes {
        return Err(GlbError::TooLarge { what: "bytes", count: bytes.len() as u64, limit: limits.bytes });
    }
    let (text, binary) = chunks(bytes)?;
    // Parsed JSON takes many times its text's memory, so the text is bounded by what so many nodes can need.
    let most = limits.nodes.saturating_mul(JSON_BYTES_PER_NODE).max(1 << 16);
    if text.len() > most {
        return Err(GlbError::TooLarge { what: "bytes of JSON", count: text.len() as u64, limit: most as u64 });
    }
    let doc: Document = serde_json::from_slice(text)?;
    if !doc.asset.version.starts_with("2.") {
        return Err(GlbError::Version { version: doc.asset.version.chars().take(20).collect() });
    }
    let mut notes = Vec::new();
    for extension in &doc.extensions_required {
        match extension.as_str() {
            "KHR_draco_mesh_compression" => return Err(GlbError::Unsupported { what: "Draco compression" }),
            "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
                return Err(GlbError::Unsupported { what: "meshopt compression" });
            }
            name if !UNDERSTOOD.contains(&name) => {
                notes.push(format!("the file requires {}, which is left out", short(name)));
            }
            _ => {}
        }
    }
    let source = Source { doc: &doc, binary };
    let mut reader = Reader {
        materials: Materials::new(limits.texture_pixels),
        meshes: vec![None; doc.meshes.len()],
        vertices: 0,
        source,
        limits,
        notes,
    };
    let mut nodes = reader.walk()?;
    let mut triangles = 0;
    nodes.retain(|n| n.mesh.triangle_count() > 0);
    for n in &nodes {
        triangles += n.mesh.triangle_count();
        if triangles > limits.triangles {
            let (count, limit) = (triangles as u64, limits.triangles as u64);
            return Err(GlbError::TooLarge { what: "triangles", count, limit });
        }
    }
    let mut notes = reader.notes;
    notes.append(&mut reader.materials.notes);
    Ok(LoadedGlb { nodes, notes })
}

fn short(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(60).collect()
}

/// The JSON and the binary chunk.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8]), GlbError> {
    let word = |at: usize| {
        bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).ok_or(GlbError::Truncated)
    };
    if !bytes.starts_with(b"glTF") {
        return Err(GlbError::NotGlb);
    }
    let version = word(4)?;
    if version != 2 {
        return Err(GlbError::Version { version: version.to_string() });
    }
    if word(8)? as usize > bytes.len() {
        return Err(GlbError::Truncated);
    }
    let (mut at, mut text, mut binary) = (12_usize, None, None);
    while at + 8 <= bytes.len() {
        let (length, kind) = (word(at)? as usize, word(at + 4)?);
        let data = bytes[at + 8..].get(..length).ok_or(GlbError::Truncated)?;
        match kind {
            0x4e4f_534a if text.is_none() => text = Some(data),
            0x004e_4942 if binary.is_none() => binary = Some(data),
            _ => {}
        }
        at = (at + 8).saturating_add(length).next_multiple_of(4);
    }
    Ok((text.ok_or(GlbError::Truncated)?, binary.unwrap_or(&[])))
}

struct Reader<'a> {
    source: Source<'a>,
    limits: &'a ReadLimits,
    materials: Materials,
    meshes: Vec<Option<Arc<Mesh>>>,
    vertices: usize,
    notes: Vec<String>,
}

impl Reader<'_> {
    /// Depth-first over the scene; every node at most once, so that cycles end.
    fn walk(&mut self) -> Result<Vec<LoadedNode>, GlbError> {
        let doc = self.source.doc;
        if doc.nodes.len() > self.limits.nodes {
            let (count, limit) = (doc.nodes.len() as u64, self.limits.nodes as u64);
            return Err(GlbError::TooLarge { what: "nodes", count, limit });
        }
        let mut roots: Vec<usize> = if let Some(scene) = doc.scenes.get(doc.scene.unwrap_or(0)) {
            scene.nodes.clone()
        } else {
            // Without a scene every node that is nobody's child is a root.
            let mut child = vec![false; doc.nodes.len()];
            for c in doc.nodes.iter().flat_map(|n| &n.children) {
                if let Some(flag) = child.get_mut(*c) {
                    *flag = true;
                }
            }
            (0..doc.nodes.len()).filter(|i| !child[*i]).collect()
        };
        roots.reverse();
        let mut stack: Vec<(usize, DAffine3)> = roots.into_iter().map(|i| (i, DAffine3::IDENTITY)).collect();
        let mut visited = vec![false; doc.nodes.len()];
        let mut out = Vec::new();
        while let Some((index, scene_from_parent)) = stack.pop() {
            let Some(node) = doc.nodes.get(index) else {
                return Err(GlbError::Broken { what: "node", index });
            };
            if std::mem::replace(&mut visited[index], true) {
                self.notes.push(format!("node {index} is a child twice and was taken once"));
                continue;
            }
            let local = transform(node).unwrap_or_else(|| {
                self.notes.push(format!("node {index} has no usable transform and was left in place"));
                DAffine3::IDENTITY
            });
            let scene_from_node = scene_from_parent * local;
            if !scene_from_node.is_finite() {
                self.notes.push(format!("node {index} lies at no finite place and was left out"));
                continue;
            }
            if let Some(mesh) = node.mesh {
                if node.skin.is_some() {
                    self.notes.push(format!("node {index} has a skin: its mesh is taken in rest pose"));
                }
                let name = if node.name.trim().is_empty() { format!("node_{index}") } else { short(&node.name) };
                let mesh = self.mesh(mesh)?;
                out.push(LoadedNode { name, mesh, transform: scene_from_node, extras: node.extras.clone() });
            }
            stack.extend(node.children.iter().rev().map(|c| (*c, scene_from_node)));
        }
        Ok(out)
    }

    fn mesh(&mut self, index: usize) -> Result<Arc<Mesh>, GlbError> {
        let doc = self.source.doc;
        let entry = doc.meshes.get(index).ok_or(GlbError::Broken { what: "mesh", index })?;
        if let Some(mesh) = &self.meshes[index] {
            return Ok(Arc::clone(mesh));
        }
        let mut mesh = Mesh::default();
        let mut materials: Vec<Option<usize>> = Vec::new();
        // Where the vertices of each primitive begin.
        let mut starts: Vec<(&Primitive, usize)> = Vec::new();
        for primitive in &entry.primitives {
            self.primitive(primitive, index, &mut mesh, &mut materials, &mut starts)?;
        }
        if mesh.materials.iter().all(|m| m.tile.is_none()) {
            mesh.metric_uvs.clear();
        }
        if mesh.colors.iter().flatten().all(|c| *c > 0.999) {
            mesh.colors.clear();
        }
        let mesh = Arc::new(mesh);
        self.meshes[index] = Some(Arc::clone(&mesh));
        Ok(mesh)
    }

    fn primitive<'p>(
        &mut self,
        primitive: &'p Primitive,
        mesh_index: usize,
        mesh: &mut Mesh,
        materials: &mut Vec<Option<usize>>,
        starts: &mut Vec<(&'p Primitive, usize)>,
    ) -> Result<(), GlbError> {
        let mode = primitive.mode.unwrap_or(4);
        if !(4..=6).contains(&mode) {
            self.notes.push(format!("mesh {mesh_index}: points or lines were left out"));
            return Ok(());
        }
        if primitive.extensions.contains_key("KHR_draco_mesh_compression") {
            return Err(GlbError::Unsupported { what: "Draco compression" });
        }
        let attribute = |name: &str| primitive.attributes.get(name).copied();
        let Some(position) = attribute("POSITION") else {
            self.notes.push(format!("mesh {mesh_index}: a part without positions was left out"));
            return Ok(());
        };
        let left = self.limits.vertices.saturating_sub(self.vertices);
        // A stated count costs memory only when the bytes are there; accessors without bytes are bounded here.
        self.vertices += self.source.count(position)?.min(left + 1);
        let positions: Vec<Vec3> = self.source.floats::<3>(position, left)?.into_iter().map(Vec3::from_array).collect();
        let order = match primitive.indices {
            Some(i) => self.source.indices(i, self.limits.triangles.saturating_mul(3))?,
            None => (0..positions.len() as u32).collect(),
        };
        let mut triangles = triangles(&order, mode);
        if let Some(index) = triangles.iter().flatten().find(|i| **i as usize >= positions.len()) {
            return Err(GlbError::BadIndex { index: *index, count: positions.len() });
        }
        let all = triangles.len();
        triangles.retain(|t| {
            t.iter().all(|i| positions[*i as usize].is_finite()) && t[0] != t[1] && t[1] != t[2] && t[2] != t[0]
        });
        if triangles.len() < all {
            self.notes.push(format!("mesh {mesh_index}: {} of {all} triangles are not usable", all - triangles.len()));
        }
        if triangles.is_empty() {
            return Ok(());
        }
        let same_length = |n: usize| n == positions.len();
        let normals = match attribute("NORMAL") {
            Some(i) => Some(self.source.floats::<3>(i, left)?).filter(|n| same_length(n.len())),
            None => None,
        };
        let look = self.materials.get(&self.source, primitive.material)?;
        let uvs = match attribute(&format!("TEXCOORD_{}", look.tex_coord)) {
            Some(i) => Some(self.source.floats::<2>(i, left)?).filter(|n| same_length(n.len())),
            None => None,
        };
        let has_uvs = uvs.is_some();
        let uvs: Vec<Vec2> = match uvs {
            Some(uvs) => uvs.into_iter().map(|uv| look.uv(Vec2::from_array(uv))).collect(),
            None => vec![Vec2::ZERO; positions.len()],
        };
        let colors = match attribute("COLOR_0") {
            Some(i) => Some(self.source.floats::<3>(i, left)?).filter(|c| same_length(c.len())).map(bounded_colors),
            None => None,
        };
        let metric_uvs = match look.material.tile.as_ref().filter(|_| has_uvs) {
            Some(tile) => uvs.iter().map(|uv| tile.metric(*uv)).collect(),
            None => vec![Vec2::ZERO; positions.len()],
        };
        let colors = colors.unwrap_or_else(|| vec![[1.0; 3]; positions.len()]);
        let mut part = Mesh { positions, uvs, metric_uvs, colors, ..Mesh::default() };
        part.groups = vec![Group { material: 0, triangles }];
        match normals {
            Some(normals) => {
                // Zero and NaN normals of some exporters are replaced by those of the faces.
                let smooth = {
                    let mut copy = part.clone();
                    copy.recompute_normals();
                    copy.normals
                };
                let given = normals.into_iter().map(Vec3::from_array);
                part.normals = given.zip(smooth).map(|(n, s)| unit(n).unwrap_or(s)).collect();
            }
            None => part = creased(&part),
        }
        let mut material = look.material.clone();
        if (material.texture.is_some() || material.tile.is_some()) && !has_uvs {
            (material.texture, material.tile) = (None, None);
            self.notes.push(format!("mesh {mesh_index}: a texture without coordinates was left out"));
        }
        let key = primitive.material.filter(|_| has_uvs);
        let slot = key.and_then(|k| materials.iter().position(|m| *m == Some(k)));
        let slot = slot.unwrap_or_else(|| {
            materials.push(key);
            mesh.materials.push(material);
            materials.len() - 1
        });
        let base = add_vertices(mesh, &mut part, primitive, starts) as u32;
        mesh.groups.extend(part.groups.into_iter().map(|g| Group {
            material: slot,
            triangles: g.triangles.into_iter().map(|t| t.map(|i| i + base)).collect(),
        }));
        // Vertices that no triangle uses may not be finite; they are not worth a refusal.
        for p in mesh.positions.iter_mut().filter(|p| !p.is_finite()) {
            *p = Vec3::ZERO;
        }
        Ok(())
    }
}

/// Adds a part's vertices, unless an earlier primitive of the mesh has the same ones; where they begin.
fn add_vertices<'p>(
    mesh: &mut Mesh,
    part: &mut Mesh,
    primitive: &'p Primitive,
    starts: &mut Vec<(&'p Primitive, usize)>,
) -> usize {
    let same = |(other, start): &&(&Primitive, usize)| {
        let span = *start..*start + part.positions.len();
        other.attributes == primitive.attributes
            && mesh.positions.get(span.clone()) == Some(&part.positions[..])
            && mesh.normals.get(span.clone()) == Some(&part.normals[..])
            && mesh.uvs.get(span.clone()) == Some(&part.uvs[..])
            && mesh.metric_uvs.get(span.clone()) == Some(&part.metric_uvs[..])
            && mesh.colors.get(span) == Some(&part.colors[..])
    };
    if let Some((_, start)) = starts.iter().find(same) {
        return *start;
    }
    let start = mesh.positions.len();
    starts.push((primitive, start));
    mesh.positions.append(&mut part.positions);
    mesh.normals.append(&mut part.normals);
    mesh.uvs.append(&mut part.uvs);
    mesh.metric_uvs.append(&mut part.metric_uvs);
    mesh.colors.append(&mut part.colors);
    start
}

fn triangles(order: &[u32], mode: u32) -> Vec<[u32; 3]> {
    match mode {
        5 => order
            .windows(3)
            .enumerate()
            .map(|(k, w)| if k % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .collect(),
        6 => order.windows(2).skip(1).map(|w| [order[0], w[0], w[1]]).collect(),
        _ => order.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}

/// Linear colours from 0 to 1; what is not finite is white.
fn bounded_colors(colors: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    colors.into_iter().map(|c| c.map(|v| if v.is_finite() { v.clamp(0.0, 1.0) } else { 1.0 })).collect()
}

/// `parent_from_node`, or `None` when it is not finite.
fn transform(node: &Node) -> Option<DAffine3> {
    if let Some(m) = node.matrix {
        let m = DMat4::from_cols_array(&m);
        return m.is_finite().then(|| DAffine3::from_mat4(m));
    }
    let t = DVec3::from_array(node.translation.unwrap_or([0.0; 3]));
    let s = DVec3::from_array(node.scale.unwrap_or([1.0; 3]));
    let q = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    if !(t.is_finite() && s.is_finite() && q.is_finite() && q.length() > 1e-9) {
        return None;
    }
    Some(DAffine3::from_scale_rotation_translation(s, q.normalize(), t))
}

impl LoadedGlb {
    /// All nodes as one mesh, transforms applied (mirrored nodes keep their outside).
    ///
    /// # Errors
    /// [`GlbError::Empty`] when there is no triangle.
    pub fn into_mesh(self) -> Result<Mesh, GlbError> {
        let mut out = Mesh::default();
        for node in &self.nodes {
            let mut mesh = (*node.mesh).clone();
            let linear = node.transform.matrix3;
            let determinant = linear.determinant();
            // Cofactors instead of the inverse transpose: the same direction, and defined for flattened nodes too.
            let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
            let sign = if determinant < 0.0 { -1.0 } else { 1.0 };
            let normal = glam::DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * sign;
            if node.transform != DAffine3::IDENTITY {
                mesh.map(
                    |p| node.transform.transform_point3(p.as_dvec3()).as_vec3(),
                    |n| (normal * n.as_dvec3()).try_normalize().unwrap_or(DVec3::Y).as_vec3(),
                );
            }
            if determinant < 0.0 {
                for t in mesh.groups.iter_mut().flat_map(|g| &mut g.triangles) {
                    t.swap(1, 2);
                }
            }
            out.append(&mesh);
        }
        if out.triangle_count() == 0 {
            return Err(GlbError::Empty);
        }
        out.check().map_err(|source| GlbError::Mesh { node: String::new(), source })?;
        Ok(out)
    }

    /// The `extras` of the node with a name.
    pub fn extras(&self, name: &str) -> Option<&Value> {
        self.nodes.iter().find(|n| n.name == name).map(|n| &n.extras)
    }
}
