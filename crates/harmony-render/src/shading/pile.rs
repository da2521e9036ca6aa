//! Light within hair: it reaches the tips, and little of it the roots.

use glam::Vec3;
use harmony_mesh::{Mesh, connected};

/// Most vertices of a hair: a larger connected piece is what it grows on.
const HAIR: usize = 64;
/// Light on roots and on tips, as shares of that on the surface; of what is seen, most is near the tips.
const LIGHT: [f32; 2] = [0.8, 1.07];

/// Factors on the light at the vertices of a placed mesh; 1 where there is no hair.
pub(super) fn light(mesh: &Mesh) -> Vec<f32> {
    let mut out = vec![1.0; mesh.positions.len()];
    let is_hairy = |g: usize| mesh.materials.get(mesh.groups[g].material).is_some_and(|m| m.hairy);
    let hairy = || mesh.groups.iter().enumerate().filter(|(g, _)| is_hairy(*g));
    if hairy().next().is_none() {
        return out;
    }
    let strand = connected(mesh, &is_hairy);
    let mut places: Vec<(u32, u32)> =
        hairy().flat_map(|(_, g)| g.triangles.iter().flatten().map(|i| (strand[*i as usize], *i))).collect();
    places.sort_unstable();
    places.dedup();
    for piece in places.chunk_by(|a, b| a.0 == b.0) {
        let up = piece.iter().map(|(_, i)| mesh.normals[*i as usize]).sum::<Vec3>().normalize_or(Vec3::Y);
        let height = |i: u32| mesh.positions[i as usize].dot(up);
        let heights = piece.iter().map(|(_, i)| height(*i));
        let (low, high) = heights.fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(v), h.max(v)));
        for (_, i) in piece {
            let share = if piece.len() > HAIR || high <= low { 0.0 } else { (height(*i) - low) / (high - low) };
            out[*i as usize] = LIGHT[0] + (LIGHT[1] - LIGHT[0]) * share;
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
