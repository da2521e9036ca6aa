//! Meshes as large as those of an image-to-3D model: the same surface cut finer, with texture.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use harmony_mesh::{Group, Material, Mesh};
use image::{Rgba, RgbaImage};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Side of a texture, pixels.
const TEXTURE_PX: u32 = 1024;
/// Side of its patches of one colour, pixels.
const PATCH_PX: u32 = 16;

/// The same surface in about `faces` triangles: the longest edges are halved until there are so many. Equal positions
/// become one vertex; every group becomes one.
pub(super) fn densified(mesh: &Mesh, faces: usize) -> Mesh {
    let (mut positions, mut triangles) = welded(mesh);
    while triangles.len() < faces {
        let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(edges_of).collect();
        edges.sort_unstable();
        let mut counted: Vec<([u32; 2], usize, f32)> = Vec::with_capacity(edges.len() / 2);
        for edge in edges {
            match counted.last_mut() {
                Some((last, count, _)) if *last == edge => *count += 1,
                _ => counted.push((edge, 1, positions[edge[0] as usize].distance(positions[edge[1] as usize]))),
            }
        }
        counted.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.0.cmp(&b.0)));
        let long = counted.first().map_or(0.0, |e| 0.5 * e.2);
        // Halving an edge adds a triangle for each that it belongs to.
        let mut more = faces - triangles.len();
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        for (edge, count, length) in counted {
            if length <= long || count > more {
                break;
            }
            more -= count;
            middles.insert(edge, positions.len() as u32);
            positions.push((positions[edge[0] as usize] + positions[edge[1] as usize]) / 2.0);
        }
        if middles.is_empty() {
            break;
        }
        triangles = triangles.iter().flat_map(|t| halved(*t, &middles)).collect();
    }
    let mut out = Mesh {
        uvs: vec![Vec2::ZERO; positions.len()],
        positions,
        groups: vec![Group { material: 0, triangles }],
        materials: vec![Material::plain("surface", [0.5; 3])],
        normals: Vec::new(),
        metric_uvs: Vec::new(),
        colors: Vec::new(),
    };
    out.recompute_normals();
    out
}

fn welded(mesh: &Mesh) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    let mut positions = Vec::new();
    let mut number = |i: u32| {
        let p = mesh.positions[i as usize];
        *known.entry(p.to_array().map(f32::to_bits)).or_insert_with(|| {
            positions.push(p);
            positions.len() as u32 - 1
        })
    };
    let triangles: Vec<[u32; 3]> = mesh.triangles().map(|t| t.map(&mut number)).collect();
    let distinct = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    (positions, triangles.into_iter().filter(distinct).collect())
}

fn edges_of(t: &[u32; 3]) -> [[u32; 2]; 3] {
    let [a, b, c] = *t;
    [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)])
}

/// The two to four triangles of one of which some edges have a middle; itself when none has.
fn halved(t: [u32; 3], middles: &HashMap<[u32; 2], u32>) -> Vec<[u32; 3]> {
    let m = edges_of(&t).map(|e| middles.get(&e).copied());
    // Turned so that the case is one of four.
    for k in 0..3 {
        let [a, b, c] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
        match [m[k], m[(k + 1) % 3], m[(k + 2) % 3]] {
            [Some(x), Some(y), Some(z)] => return vec![[a, x, z], [x, b, y], [z, y, c], [x, y, z]],
            [Some(x), Some(y), None] => return vec![[a, x, c], [x, b, y], [x, y, c]],
            [Some(x), None, None] => return vec![[a, x, c], [x, b, c]],
            _ => {}
        }
    }
    vec![t]
}

/// Texture coordinates by position, and a texture of patches: as many bytes as a photo-like one, once it is compressed.
pub(super) fn textured(mesh: &mut Mesh, rng: &mut ChaCha8Rng) {
    let Some(bounds) = mesh.bounds() else { return };
    let size = bounds.size().max_element().max(1e-6) as f32;
    let low = bounds.min.as_vec3();
    mesh.uvs = mesh.positions.iter().map(|p| (*p - low) / size).map(|p| Vec2::new(0.5 * (p.x + p.z), p.y)).collect();
    let base: [u8; 3] = std::array::from_fn(|_| rng.random_range(60..200));
    let n = TEXTURE_PX / PATCH_PX;
    let shades: Vec<u8> = (0..n * n).map(|_| rng.random_range(0..40)).collect();
    let image = RgbaImage::from_fn(TEXTURE_PX, TEXTURE_PX, |x, y| {
        let shade = shades[((y / PATCH_PX) * n + x / PATCH_PX) as usize] + rng.random_range(0..4);
        Rgba([base[0] + shade, base[1] + shade, base[2] + shade, 255])
    });
    for material in &mut mesh.materials {
        material.texture = Some(Arc::new(image.clone()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(mesh: &Mesh) -> f32 {
        let at = |i: u32| mesh.positions[i as usize];
        mesh.triangles().map(|[a, b, c]| (at(b) - at(a)).cross(at(c) - at(a)).length() / 2.0).sum()
    }

    #[test]
    fn a_finer_mesh_is_the_same_closed_surface() {
        let json = r#"{"parts":[{"shape":"sphere"},{"shape":"box","from":[0,0,0],"to":[0.3,0.2,0.1]}]}"#;
        let size = harmony_scene::Size { width: 1.0, height: 1.0, depth: 1.0 };
        let coarse = harmony_mesh::PartModel::from_json(json).unwrap().build(size).unwrap().mesh;
        let fine = densified(&coarse, 20_000);
        fine.check().unwrap();
        assert!((19_990..=20_000).contains(&fine.triangle_count()), "{}", fine.triangle_count());
        assert!((area(&fine) / area(&coarse) - 1.0).abs() < 1e-3);
        assert_eq!(fine.bounds(), coarse.bounds());
        // Every edge that two triangles had is still one of two: no cracks.
        let odd = |mesh: &Mesh| {
            let (_, triangles) = welded(mesh);
            let mut count: HashMap<[u32; 2], usize> = HashMap::new();
            triangles.iter().flat_map(edges_of).for_each(|e| *count.entry(e).or_default() += 1);
            count.values().filter(|n| **n % 2 == 1).count()
        };
        assert_eq!((odd(&coarse), odd(&fine)), (0, 0));
    }
}
