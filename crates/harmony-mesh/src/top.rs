//! What stands on a mesh.
//!
//! A generated cabinet's top is level where the photo shows it and bent where its back was made up: what stands there tilts by
//! some degrees, and slides. Here the top of what carries things becomes one level plane, by the least that does: only what is
//! nearly level and nearly at the top's height moves, upright.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use crate::Mesh;

/// Faces that lean by less are level ones that were bent, degrees.
const MAX_LEAN_DEG: f64 = 15.0;
/// Parts of a top are this near to its height, a share of the mesh's height: a bent one, not a second shelf.
const THICKNESS: f64 = 0.04;
/// A top covers so much of the footprint at least.
const MIN_SHARE: f64 = 0.4;
/// And is so high at least, a share of the mesh's height: seats and lower shelves are not tops.
const MIN_HEIGHT: f64 = 0.6;

/// Makes the top of a canonical mesh (+Y up) level; gives the farthest that a point moved, in the mesh's unit.
///
/// 0 where there is no plane that could be a top: round things, seats, beds with a headboard that is higher by far.
pub fn level_top(mesh: &mut Mesh) -> f64 {
    let Some(bounds) = mesh.bounds().filter(|b| b.size().min_element() > 0.0) else { return 0.0 };
    let size = bounds.size();
    let half = THICKNESS * size.y;
    let level = level_faces(mesh);
    let (least, floor) = (MIN_SHARE * size.x * size.z, bounds.min.y + MIN_HEIGHT * size.y);
    let Some(height) = densest(&level, half).filter(|(h, area)| *area >= least && *h >= floor).map(|(h, _)| h) else {
        return 0.0;
    };
    // Copies of a vertex (seams of texture and normals) go with it.
    let mut moved: BTreeMap<[u32; 3], f32> = BTreeMap::new();
    let mut farthest = 0.0_f64;
    for face in level.iter().filter(|f| (f.height - height).abs() <= half) {
        for i in face.corners {
            let p = mesh.positions[i as usize];
            moved.insert(p.to_array().map(f32::to_bits), height as f32);
            farthest = farthest.max((f64::from(p.y) - height).abs());
        }
    }
    for p in &mut mesh.positions {
        if let Some(y) = moved.get(&p.to_array().map(f32::to_bits)) {
            *p = Vec3::new(p.x, *y, p.z);
        }
    }
    farthest
}

/// A face that looks up.
struct LevelFace {
    corners: [u32; 3],
    height: f64,
    /// Area seen from above.
    area: f64,
}

fn level_faces(mesh: &Mesh) -> Vec<LevelFace> {
    let least = MAX_LEAN_DEG.to_radians().cos();
    let level = |corners: [u32; 3]| {
        let [a, b, c] = corners.map(|i| mesh.positions[i as usize].as_dvec3());
        let cross: DVec3 = (b - a).cross(c - a);
        let up = cross.try_normalize()?.y;
        (up >= least).then(|| LevelFace { corners, height: (a.y + b.y + c.y) / 3.0, area: 0.5 * cross.y })
    };
    mesh.triangles().filter_map(level).collect()
}

/// The height about which, by half a thickness up and down, most area lies (its median there), and that area.
fn densest(faces: &[LevelFace], half: f64) -> Option<(f64, f64)> {
    let mut by_height: Vec<(f64, f64)> = faces.iter().map(|f| (f.height, f.area)).collect();
    by_height.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut first, mut area) = (0, 0.0);
    let mut best: Option<(usize, usize, f64)> = None;
    for (last, (height, own)) in by_height.iter().enumerate() {
        area += own;
        while by_height[first].0 < height - 2.0 * half {
            area -= by_height[first].1;
            first += 1;
        }
        if best.is_none_or(|(.., most)| area > most) {
            best = Some((first, last, area));
        }
    }
    let (first, last, area) = best?;
    let mut sum = 0.0;
    let median = by_height[first..=last].iter().find(|(_, own)| {
        sum += own;
        sum >= 0.5 * area
    })?;
    Some((median.0, area))
}

#[cfg(test)]
mod tests {
    use harmony_scene::Size;

    use super::*;
    use crate::{Bvh, TemplateParams, template};

    fn built(name: &str, width: f64, height: f64, depth: f64) -> Mesh {
        let size = Size { width, height, depth };
        template(name, &TemplateParams::default(), size).build(size).unwrap().mesh
    }

    /// Heights of the mesh seen from above, over a grid of its footprint's inner part.
    fn heights(mesh: &Mesh) -> Vec<f64> {
        let bounds = mesh.bounds().unwrap();
        let bvh = Bvh::new(mesh);
        let at = |i: u32, k: usize| bounds.min[k] + (0.1 + 0.8 * f64::from(i) / 8.0) * bounds.size()[k];
        (0..81)
            .filter_map(|n| bvh.raycast(DVec3::new(at(n % 9, 0), 9.0, at(n / 9, 2)), DVec3::NEG_Y, 20.0))
            .map(|hit| hit.point.y)
            .collect()
    }

    fn spread(heights: &[f64]) -> f64 {
        heights.iter().copied().fold(f64::MIN, f64::max) - heights.iter().copied().fold(f64::MAX, f64::min)
    }

    /// A cabinet cut finely, its back half bent by `bend` times its height.
    fn bent(bend: f32) -> Mesh {
        let mut mesh = built("cabinet", 0.8, 0.7, 0.4);
        let mut fine = Mesh { materials: mesh.materials.clone(), ..Mesh::default() };
        // Each triangle in 16: templates have two a side.
        for _ in 0..2 {
            fine = Mesh { materials: mesh.materials.clone(), ..Mesh::default() };
            for group in &mesh.groups {
                let mut triangles = Vec::new();
                for t in &group.triangles {
                    let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
                    let n = mesh.normals[t[0] as usize];
                    let (ab, bc, ca) = ((a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0);
                    for corners in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
                        let first = fine.positions.len() as u32;
                        fine.positions.extend(corners);
                        fine.normals.extend([n; 3]);
                        triangles.push([first, first + 1, first + 2]);
                    }
                }
                fine.groups.push(crate::Group { material: group.material, triangles });
            }
            mesh = fine.clone();
        }
        fine.map(|p| Vec3::new(p.x, p.y - bend * 0.7 * (-p.z).max(0.0) / 0.2 * (p.y / 0.7), p.z), |n| n);
        fine
    }

    #[test]
    fn a_top_that_is_bent_at_its_back_becomes_level_and_a_cut_does_not_open() {
        let mut mesh = bent(0.035);
        let before = heights(&mesh);
        assert!(spread(&before) > 0.015, "{}", spread(&before));
        let farthest = level_top(&mut mesh);
        assert!(farthest > 0.005 && farthest < 0.04 * 0.75, "{farthest}");
        let after = heights(&mesh);
        assert_eq!(after.len(), before.len(), "no ray falls through");
        assert!(spread(&after) < 1e-5, "{}", spread(&after));
    }

    #[test]
    fn what_has_no_top_stays_as_it_is() {
        for (name, w, h, d) in [("chair", 0.5, 0.95, 0.55), ("vase", 0.2, 0.4, 0.2), ("bed", 1.6, 1.2, 2.0)] {
            let mut mesh = built(name, w, h, d);
            let before = mesh.positions.clone();
            level_top(&mut mesh);
            assert_eq!(mesh.positions, before, "{name}");
        }
        assert_eq!(level_top(&mut Mesh::default()), 0.0);
    }

    #[test]
    fn a_top_that_slopes_more_is_meant() {
        // A lectern's.
        let mut mesh = built("cabinet", 0.8, 0.7, 0.4);
        mesh.map(|p| Vec3::new(p.x, p.y * (1.0 + 0.5 * p.z), p.z), |n| n);
        let before = mesh.positions.clone();
        level_top(&mut mesh);
        assert_eq!(mesh.positions, before);
    }
}
