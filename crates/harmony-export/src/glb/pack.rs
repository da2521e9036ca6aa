//! Geometry packed by EXT_meshopt_compression, and unpacked again for readers that don't know it.

use harmony_io::GlbError;
use serde_json::{Map, Value, json};

use super::container::Parts;

const NAME: &str = "EXT_meshopt_compression";

/// A vertex of `N` bytes.
#[derive(Clone, Copy)]
struct Bytes<const N: usize>([u8; N]);

impl<const N: usize> Default for Bytes<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

/// How an accessor's elements lie in their view.
struct Layout {
    count: usize,
    stride: usize,
    indices: bool,
}

fn layout(parts: &Parts, view: usize) -> Option<Layout> {
    // The writer gives every accessor a view of its own.
    let mut users = parts.doc["accessors"].as_array()?.iter().filter(|a| a["bufferView"].as_u64() == Some(view as u64));
    let accessor = users.next()?;
    if users.next().is_some() {
        return None;
    }
    let size = match accessor["componentType"].as_u64()? {
        5120 | 5121 => 1,
        5122 | 5123 => 2,
        _ => 4,
    };
    let components = match accessor["type"].as_str()? {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        _ => return None,
    };
    let indices = parts.doc["bufferViews"][view]["target"].as_u64() == Some(34_963);
    Some(Layout { count: accessor["count"].as_u64()? as usize, stride: size * components, indices })
}

/// Packs all vertices and indices. The vertex format is 0, the one that the extension knows.
pub(super) fn pack(parts: &mut Parts) {
    let mut fallback = 0;
    for view in 0..parts.views.len() {
        if parts.doc["bufferViews"][view]["target"].is_null() {
            continue;
        }
        let Some(l) = layout(parts, view) else { continue };
        let bytes = &parts.views[view];
        if bytes.len() != l.count * l.stride {
            continue;
        }
        let packed = if l.indices { pack_indices(bytes, &l) } else { pack_vertices(bytes, &l) };
        let Some(packed) = packed.filter(|p| p.len() < bytes.len()) else { continue };
        let place = &mut parts.doc["bufferViews"][view];
        place["buffer"] = json!(1);
        place["byteOffset"] = json!(fallback);
        place["byteLength"] = json!(bytes.len());
        fallback = (fallback + bytes.len()).next_multiple_of(4);
        let mut of = Map::new();
        of.insert("buffer".to_owned(), json!(0));
        of.insert("byteOffset".to_owned(), json!(0));
        of.insert("byteLength".to_owned(), json!(packed.len()));
        of.insert("byteStride".to_owned(), json!(l.stride));
        of.insert("mode".to_owned(), json!(if l.indices { "TRIANGLES" } else { "ATTRIBUTES" }));
        of.insert("count".to_owned(), json!(l.count));
        place["extensions"] = json!({ NAME: of });
        if !l.indices {
            place["byteStride"] = json!(l.stride);
        }
        parts.views[view] = packed;
    }
    if fallback > 0 {
        parts.fallback = fallback;
        parts.uses(NAME, true);
    }
}

fn pack_vertices(bytes: &[u8], l: &Layout) -> Option<Vec<u8>> {
    fn of<const N: usize>(bytes: &[u8]) -> Option<Vec<u8>> {
        let all: Vec<Bytes<N>> = bytes.chunks_exact(N).map(|c| Bytes(c.try_into().unwrap_or([0; N]))).collect();
        meshopt::encode_vertex_buffer_level(&all, 2, Some(0)).ok()
    }
    match l.stride {
        4 => of::<4>(bytes),
        8 => of::<8>(bytes),
        12 => of::<12>(bytes),
        16 => of::<16>(bytes),
        _ => None,
    }
}

fn pack_indices(bytes: &[u8], l: &Layout) -> Option<Vec<u8>> {
    if !l.count.is_multiple_of(3) {
        return None;
    }
    let indices: Vec<u32> = if l.stride == 2 {
        bytes.chunks_exact(2).map(|b| u32::from(u16::from_le_bytes([b[0], b[1]]))).collect()
    } else {
        bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    };
    let vertices = indices.iter().max().map_or(0, |m| *m as usize + 1);
    let ordered = meshopt::optimize_vertex_cache(&indices, vertices);
    meshopt::encode_index_buffer(&ordered, vertices).ok()
}

/// The same file without packing, for [`harmony_io::read_glb`].
///
/// # Errors
/// [`GlbError`] for what cannot be unpacked.
pub(crate) fn unpacked(bytes: &[u8]) -> Result<Vec<u8>, GlbError> {
    /// Bytes of one view that are unpacked at most.
    const MOST: usize = 512 << 20;
    let mut parts = Parts::of(bytes)?;
    for index in 0..parts.views.len() {
        let Some(of) = parts.doc["bufferViews"][index].pointer(&format!("/extensions/{NAME}")).cloned() else {
            continue;
        };
        let broken = GlbError::Broken { what: "packed buffer view", index };
        let number = |key: &str| of[key].as_u64().map_or(0, |v| v as usize);
        let (count, stride) = (number("count"), number("byteStride"));
        if count.checked_mul(stride).is_none_or(|n| n > MOST) {
            return Err(broken);
        }
        let packed = &parts.views[index];
        let plain = match (of["mode"].as_str(), stride) {
            (Some("TRIANGLES"), 2) => meshopt::decode_index_buffer::<u16>(packed, count)
                .ok()
                .map(|i| i.into_iter().flat_map(u16::to_le_bytes).collect::<Vec<u8>>()),
            (Some("TRIANGLES"), 4) => meshopt::decode_index_buffer::<u32>(packed, count)
                .ok()
                .map(|i| i.into_iter().flat_map(u32::to_le_bytes).collect()),
            (Some("ATTRIBUTES"), 4) => vertices::<4>(packed, count),
            (Some("ATTRIBUTES"), 8) => vertices::<8>(packed, count),
            (Some("ATTRIBUTES"), 12) => vertices::<12>(packed, count),
            (Some("ATTRIBUTES"), 16) => vertices::<16>(packed, count),
            _ => None,
        };
        parts.views[index] = plain.ok_or(broken)?;
        let view = &mut parts.doc["bufferViews"][index];
        view["buffer"] = json!(0);
        if let Some(view) = view.as_object_mut() {
            view.remove("extensions");
        }
    }
    if let Some(doc) = parts.doc.as_object_mut() {
        for key in ["extensionsUsed", "extensionsRequired"] {
            let left = doc.get_mut(key).and_then(Value::as_array_mut).map(|list| {
                list.retain(|n| n != NAME);
                list.len()
            });
            if left == Some(0) {
                doc.remove(key);
            }
        }
    }
    parts.bytes()
}

fn vertices<const N: usize>(packed: &[u8], count: usize) -> Option<Vec<u8>> {
    let all = meshopt::decode_vertex_buffer::<Bytes<N>>(packed, count).ok()?;
    Some(all.into_iter().flat_map(|b| b.0).collect())
}
