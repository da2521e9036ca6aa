//! The mesh files of robot models: binary STL, and OBJ (positions and faces alone).
//!
//! Lengths are those of the file times the model's scale; nothing is moved.

use std::path::Path;

use glam::{Vec2, Vec3};
use harmony_io::read_bounded;
use harmony_mesh::{Group, Material, Mesh};

use crate::RobotError;

/// Largest mesh file, bytes.
const LARGEST: u64 = 256 << 20;

/// Reads a mesh file.
///
/// # Errors
/// [`RobotError::NoMesh`] when there is none, [`RobotError::Mesh`] when it cannot be used.
pub(crate) fn read(name: &str, path: &Path, scale: Vec3) -> Result<Mesh, RobotError> {
    if !path.is_file() {
        return Err(RobotError::NoMesh { mesh: name.to_owned(), path: path.to_owned() });
    }
    let bad = |why: String| RobotError::Mesh { path: path.to_owned(), why };
    let bytes = read_bounded(path, LARGEST)?;
    let kind = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let (positions, triangles) = match kind.as_str() {
        "stl" => stl(&bytes).map_err(bad)?,
        "obj" => obj(&bytes).map_err(bad)?,
        other => return Err(bad(format!("files of kind \".{other}\" are not read"))),
    };
    if triangles.is_empty() {
        return Err(bad("it has no triangle".to_owned()));
    }
    let mut mesh = Mesh {
        positions: positions.into_iter().map(|p| p * scale).collect(),
        groups: vec![Group { material: 0, triangles }],
        materials: vec![Material::plain(name, [0.5; 3])],
        ..Mesh::default()
    };
    mesh.uvs = vec![Vec2::ZERO; mesh.positions.len()];
    mesh.recompute_normals();
    mesh.check().map_err(|e| RobotError::Mesh { path: path.to_owned(), why: e.to_string() })?;
    Ok(mesh)
}

type Triangles = (Vec<Vec3>, Vec<[u32; 3]>);

fn stl(bytes: &[u8]) -> Result<Triangles, String> {
    let count = bytes.get(80..84).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let count = count.ok_or("it is shorter than the head of a binary STL")? as usize;
    if bytes.len() < 84 + 50 * count {
        return Err(format!("it says {count} triangles and is too short for them (is it a text STL?)"));
    }
    let number = |at: usize| f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let (mut positions, mut triangles) = (Vec::with_capacity(3 * count), Vec::with_capacity(count));
    for k in 0..count {
        let at = 84 + 50 * k + 12;
        for corner in 0..3 {
            let at = at + 12 * corner;
            positions.push(Vec3::new(number(at), number(at + 4), number(at + 8)));
        }
        let first = 3 * k as u32;
        triangles.push([first, first + 1, first + 2]);
    }
    Ok((positions, triangles))
}

fn obj(bytes: &[u8]) -> Result<Triangles, String> {
    let text = std::str::from_utf8(bytes).map_err(|e| e.to_string())?;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (number, line) in text.lines().enumerate() {
        let bad = || format!("line {} cannot be read", number + 1);
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let v: Vec<f32> = words.take(3).map_while(|w| w.parse().ok()).collect();
                let [x, y, z] = v[..] else { return Err(bad()) };
                positions.push(Vec3::new(x, y, z));
            }
            Some("f") => {
                let mut corners: Vec<u32> = Vec::new();
                for word in words {
                    let index: i64 = word.split('/').next().and_then(|w| w.parse().ok()).ok_or_else(bad)?;
                    let index = if index < 0 { positions.len() as i64 + index } else { index - 1 };
                    if index < 0 || index >= positions.len() as i64 {
                        return Err(bad());
                    }
                    corners.push(index as u32);
                }
                triangles.extend((2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]]));
            }
            _ => {}
        }
    }
    Ok((positions, triangles))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_formats_give_the_triangles_and_broken_ones_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("quad.obj");
        std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1 2/2 3/3 -1\n").unwrap();
        let mesh = read("quad", &path, Vec3::splat(2.0)).unwrap();
        assert_eq!((mesh.triangle_count(), mesh.positions[2]), (2, Vec3::new(2.0, 2.0, 0.0)));
        let mut bytes = vec![0_u8; 84 + 50];
        bytes[80] = 1;
        bytes[84 + 24..84 + 28].copy_from_slice(&1.0_f32.to_le_bytes());
        bytes[84 + 40..84 + 44].copy_from_slice(&1.0_f32.to_le_bytes());
        let path = folder.path().join("one.stl");
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(read("one", &path, Vec3::ONE).unwrap().triangle_count(), 1);
        std::fs::write(&path, &bytes[..100]).unwrap();
        assert!(matches!(read("one", &path, Vec3::ONE), Err(RobotError::Mesh { .. })));
        let said = read("two", &folder.path().join("two.stl"), Vec3::ONE).unwrap_err();
        assert!(said.to_string().contains("two.stl"), "{said}");
    }
}
