//! GLB files as generators leave them, whole and broken.

use std::sync::{Arc, OnceLock};

use harmony_mesh::Mesh;
use serde_json::json;

/// Faces of the file that is too large for anybody.
pub const HUGE_FACES: usize = 5_000_000;

/// Corners of the huge file, along each side: its faces repeat, so that the file stays below the usual limit on answers
/// and has to be read.
const HUGE_SIDE: u32 = 400;

/// A GLB file of positions and triangles, without normals and material, as trimesh exports untextured meshes (mesh
/// sheet, section 3).
pub fn plain(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for p in positions {
        for axis in 0..3 {
            low[axis] = low[axis].min(p[axis]);
            high[axis] = high[axis].max(p[axis]);
        }
    }
    let indices_len = triangles.len() * 12;
    let mut binary: Vec<u8> = Vec::with_capacity(indices_len + positions.len() * 12);
    for index in triangles.iter().flatten() {
        binary.extend_from_slice(&index.to_le_bytes());
    }
    for value in positions.iter().flatten() {
        binary.extend_from_slice(&value.to_le_bytes());
    }
    let mut head = json!({
        "asset": {"version": "2.0", "generator": "trimesh"},
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"name": "world", "mesh": 0}],
        "buffers": [{"byteLength": binary.len()}],
    });
    if triangles.is_empty() {
        head["nodes"] = json!([{"name": "world"}]);
        head["buffers"] = json!([]);
    } else {
        head["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": 1}, "indices": 0, "mode": 4}]}]);
        head["accessors"] = json!([
            {"bufferView": 0, "componentType": 5125, "count": triangles.len() * 3, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": positions.len(), "type": "VEC3", "min": low, "max": high},
        ]);
        head["bufferViews"] = json!([
            {"buffer": 0, "byteOffset": 0, "byteLength": indices_len},
            {"buffer": 0, "byteOffset": indices_len, "byteLength": positions.len() * 12},
        ]);
    }
    let mut head = head.to_string().into_bytes();
    head.resize(head.len().next_multiple_of(4), b' ');
    let mut chunks = vec![(0x4E4F_534A_u32, head)];
    if !binary.is_empty() && !triangles.is_empty() {
        chunks.push((0x004E_4942, binary));
    }
    let total = 12 + chunks.iter().map(|(_, data)| 8 + data.len()).sum::<usize>();
    let mut file = Vec::with_capacity(total);
    file.extend_from_slice(b"glTF");
    file.extend_from_slice(&2_u32.to_le_bytes());
    file.extend_from_slice(&(total as u32).to_le_bytes());
    for (kind, data) in chunks {
        file.extend_from_slice(&(data.len() as u32).to_le_bytes());
        file.extend_from_slice(&kind.to_le_bytes());
        file.extend_from_slice(&data);
    }
    file
}

/// Positions and triangles of a mesh.
fn raw(mesh: &Mesh) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let positions = mesh.positions.iter().map(glam::Vec3::to_array).collect();
    let triangles = mesh.groups.iter().flat_map(|group| group.triangles.iter().copied()).collect();
    (positions, triangles)
}

/// A mesh as a file.
pub fn of(mesh: &Mesh) -> Vec<u8> {
    let (positions, triangles) = raw(mesh);
    plain(&positions, &triangles)
}

/// A mesh of which every third vertex is no number.
pub fn with_nan(mesh: &Mesh) -> Vec<u8> {
    let (mut positions, triangles) = raw(mesh);
    positions.iter_mut().step_by(3).for_each(|p| p[1] = f32::NAN);
    plain(&positions, &triangles)
}

/// A file without a triangle.
pub fn empty() -> Vec<u8> {
    plain(&[], &[])
}

/// Five million faces: a wavy sheet, its faces repeated.
pub fn huge() -> Arc<Vec<u8>> {
    static FILE: OnceLock<Arc<Vec<u8>>> = OnceLock::new();
    Arc::clone(FILE.get_or_init(|| Arc::new(sheet(HUGE_SIDE, HUGE_FACES))))
}

/// A wavy sheet of `n` x `n` corners and so many faces; they repeat when there are more than the corners give.
pub fn sheet(n: u32, faces: usize) -> Vec<u8> {
    let positions: Vec<[f32; 3]> = (0..n * n)
        .map(|i| {
            let (x, z) = ((i % n) as f32 / n as f32 - 0.5, (i / n) as f32 / n as f32 - 0.5);
            [2.0 * x, 0.3 * (20.0 * x).sin() * (17.0 * z).cos(), 2.0 * z]
        })
        .collect();
    let cell = |i: usize| {
        let cells = ((n - 1) * (n - 1)) as usize;
        let (at, second) = ((i / 2 % cells) as u32, i % 2 == 1);
        let corner = at / (n - 1) * n + at % (n - 1);
        if second { [corner + 1, corner + n, corner + n + 1] } else { [corner, corner + n, corner + 1] }
    };
    let triangles: Vec<[u32; 3]> = (0..faces).map(cell).collect();
    plain(&positions, &triangles)
}

#[cfg(test)]
mod tests {
    use harmony_io::{ReadLimits, read_glb};

    use super::*;

    #[test]
    fn whole_files_are_read_and_broken_ones_are_broken_as_said() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let faces = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        let file = plain(&corners, &faces);
        let mesh = read_glb(&file, &ReadLimits::default()).unwrap().into_mesh().unwrap();
        assert_eq!(mesh.triangle_count(), 4);
        assert_eq!(read_glb(&of(&mesh), &ReadLimits::default()).unwrap().into_mesh().unwrap().triangle_count(), 4);
        assert!(read_glb(&file[..file.len() / 2], &ReadLimits::default()).is_err());
        assert!(read_glb(&empty(), &ReadLimits::default()).and_then(harmony_io::LoadedGlb::into_mesh).is_err());
        let broken = with_nan(&mesh);
        assert_eq!(&broken[..4], b"glTF");
    }
}
