//! Light within hair: it reaches the tips, and little of it the roots.

use std::collections::BTreeMap;

use glam::Vec3;
use harmony_mesh::Mesh;

/// Side of the cubes within which roots and tips are told apart, metres.
const CELL: f32 = 0.025;
/// Least height of hair, metres: flatter is the surface itself.
const LEAST: f32 = 0.003;
/// Light on roots and on tips, as shares of that on the surface; of what is seen, most is near the tips.
const LIGHT: [f32; 2] = [0.55, 1.12];

/// What is in a cube.
#[derive(Default)]
struct Cell {
    normal: Vec3,
    places: Vec<u32>,
}

/// Factors on the light at the vertices of a placed mesh; 1 where there is no hair.
pub(super) fn light(mesh: &Mesh) -> Vec<f32> {
    let mut out = vec![1.0; mesh.positions.len()];
    let hairy = mesh.groups.iter().filter(|g| mesh.materials.get(g.material).is_some_and(|m| m.hairy));
    let mut places: Vec<u32> = hairy.flat_map(|g| g.triangles.iter().flatten().copied()).collect();
    places.sort_unstable();
    places.dedup();
    let mut cells: BTreeMap<[i32; 3], Cell> = BTreeMap::new();
    for place in places {
        let at = (mesh.positions[place as usize] / CELL).floor();
        let cell = cells.entry([at.x as i32, at.y as i32, at.z as i32]).or_default();
        cell.normal += mesh.normals[place as usize];
        cell.places.push(place);
    }
    for cell in cells.values() {
        let up = cell.normal.normalize_or(Vec3::Y);
        let height = |place: &u32| mesh.positions[*place as usize].dot(up);
        let (low, high) = cell.places.iter().map(height).fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(v), h.max(v)));
        if high - low < LEAST {
            continue;
        }
        for place in &cell.places {
            let share = (height(place) - low) / (high - low);
            out[*place as usize] = LIGHT[0] + (LIGHT[1] - LIGHT[0]) * share;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use glam::Vec2;
    use harmony_mesh::{Group, Material};

    use super::*;

    #[test]
    fn roots_are_darker_than_tips_and_what_has_no_hair_is_as_it_was() {
        // Upright hairs of 2 cm on a plane, and the same shape in another material.
        let mut mesh = Mesh::default();
        for (slot, hairy) in [(0_usize, true), (1, false)] {
            mesh.materials.push(Material { hairy, ..Material::plain("wool", [0.8; 3]) });
            let mut group = Group { material: slot, triangles: Vec::new() };
            for k in 0..10_u32 {
                let base = mesh.positions.len() as u32;
                let at = Vec3::new(0.002 * k as f32 + slot as f32, 0.001, 0.01);
                mesh.positions.extend([at, at + Vec3::X * 0.001, at + Vec3::Y * 0.02]);
                mesh.normals.extend([Vec3::Y; 3]);
                mesh.uvs.extend([Vec2::ZERO; 3]);
                group.triangles.push([base, base + 1, base + 2]);
            }
            mesh.groups.push(group);
        }
        let light = light(&mesh);
        for (i, factor) in light.iter().enumerate() {
            let wanted = if i >= 30 { 1.0 } else { LIGHT[usize::from(i % 3 == 2)] };
            assert!((factor - wanted).abs() < 1e-3, "{i}: {factor}");
        }
    }
}
