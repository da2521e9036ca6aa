//! Convex pieces for collision.

use glam::{DVec3, Vec3};
use parry3d::math::Vector;
use parry3d::transformation::vhacd::{VHACD, VHACDParameters};

use crate::Mesh;

/// Most points of a piece.
pub const MAX_HULL_POINTS: usize = 32;
/// Most pieces of a foreign mesh.
const MAX_PIECES: usize = 24;
/// Size of a voxel of the decomposition, metres: a table's top must not reach down to the seats below it.
const VOXEL_M: f64 = 0.02;
/// Fewest and most voxels along the longest side. Time goes with their square.
const RESOLUTION: [f64; 2] = [24.0, 64.0];

/// The convex hull of a few points, in the frame of its mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ConvexPart {
    /// Hull points, at most [`MAX_HULL_POINTS`].
    pub points: Vec<Vec3>,
}

/// Convex pieces of any mesh: an approximate convex decomposition, or one hull, or the box.
///
/// `longest_m` is about how long the object's longest side is in the room, metres. Of large meshes [`crate::simple_form`] does.
pub fn convex_parts(mesh: &Mesh, longest_m: f64) -> Vec<ConvexPart> {
    let count = mesh.positions.len() as u32;
    let triangles: Vec<[u32; 3]> = mesh.triangles().filter(|t| t.iter().all(|i| *i < count)).collect();
    let used: Vec<DVec3> =
        triangles.iter().flatten().map(|i| mesh.positions[*i as usize].as_dvec3()).filter(|p| p.is_finite()).collect();
    if used.is_empty() {
        return Vec::new();
    }
    let lo = used.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
    let hi = used.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
    let flat = (hi - lo).min_element() < 1e-3 * (hi - lo).max_element();
    if !flat && triangles.len() >= 4 && mesh.positions.iter().all(|p| p.is_finite()) {
        let parts = decompose(mesh, &triangles, longest_m);
        if !parts.is_empty() {
            return parts;
        }
    }
    let whole = hull_points(&used);
    if whole.len() >= 4 && !flat { vec![ConvexPart { points: whole }] } else { vec![box_part(lo, hi)] }
}

/// Approximate convex decomposition (Mamou and Ghorbel 2009, as in parry).
fn decompose(mesh: &Mesh, triangles: &[[u32; 3]], longest_m: f64) -> Vec<ConvexPart> {
    let points: Vec<Vector> = mesh.positions.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let resolution = (longest_m / VOXEL_M).clamp(RESOLUTION[0], RESOLUTION[1]) as u32;
    let parameters = VHACDParameters { resolution, concavity: 0.03, ..VHACDParameters::default() };
    let decomposition = VHACD::decompose(&parameters, &points, triangles, true);
    decomposition
        .compute_exact_convex_hulls(&points, triangles)
        .into_iter()
        .map(|(hull, _)| {
            let hull: Vec<DVec3> = hull.iter().map(|p| DVec3::new(p.x.into(), p.y.into(), p.z.into())).collect();
            ConvexPart { points: hull_points(&hull) }
        })
        .filter(|part| part.points.len() >= 4)
        .take(MAX_PIECES)
        .collect()
}

fn box_part(lo: DVec3, hi: DVec3) -> ConvexPart {
    let points = (0..8).map(|i| {
        let pick = |bit: i32, l: f64, h: f64| if i & bit == 0 { l } else { h };
        DVec3::new(pick(1, lo.x, hi.x), pick(2, lo.y, hi.y), pick(4, lo.z, hi.z)).as_vec3()
    });
    ConvexPart { points: points.collect() }
}

/// At most [`MAX_HULL_POINTS`] points of a set that are farthest in evenly spread directions: the hull's corners when
/// there are few, an inner approximation of it otherwise.
pub fn hull_points(points: &[DVec3]) -> Vec<Vec3> {
    let mut out: Vec<usize> = Vec::new();
    for x in -1..=1 {
        for y in -1..=1 {
            for z in -1..=1 {
                // the odd factors decide ties between corners of boxes
                let d = DVec3::new(f64::from(x), f64::from(y), f64::from(z));
                if d != DVec3::ZERO {
                    farthest(points, d + DVec3::new(1e-3, 1.7e-3, 2.3e-3), &mut out);
                }
            }
        }
    }
    for d in [(2, 1, 0), (-2, 1, 0), (0, 1, 2), (0, 1, -2), (1, 0, 2), (-1, 0, -2)] {
        if out.len() < MAX_HULL_POINTS {
            farthest(points, DVec3::new(d.0.into(), d.1.into(), d.2.into()), &mut out);
        }
    }
    out.sort_unstable();
    out.iter().map(|i| points[*i].as_vec3()).collect()
}

fn farthest(points: &[DVec3], direction: DVec3, out: &mut Vec<usize>) {
    let best = (0..points.len()).max_by(|a, b| points[*a].dot(direction).total_cmp(&points[*b].dot(direction)));
    if let Some(i) = best
        && !out.iter().any(|j| points[*j].distance_squared(points[i]) < 1e-16)
    {
        out.push(i);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_scene::Size;

    use super::*;
    use crate::PartModel;

    #[test]
    fn a_table_keeps_the_room_below_it_free() {
        let json = r#"{"parts":[{"shape":"box","from":[0,0.9,0],"to":[1,1,1]},
            {"shape":"box","from":[0,0,0],"to":[0.08,0.92,0.08],"mirror":"xz"}]}"#;
        let size = Size { width: 1.2, height: 0.75, depth: 0.8 };
        let mesh = PartModel::from_json(json).unwrap().build(size).unwrap().mesh;
        let parts = convex_parts(&mesh, 1.2);
        assert!((2..=MAX_PIECES).contains(&parts.len()), "{}", parts.len());
        let middle = Vec3::new(0.0, 0.35, 0.0);
        for part in &parts {
            assert!((4..=MAX_HULL_POINTS).contains(&part.points.len()));
            // some direction separates the piece from the middle of the room under the top
            let free = (0..200).any(|k| {
                let a = k as f32 * 2.399_963;
                let y = 1.0 - k as f32 / 100.0;
                let r = (1.0 - y * y).max(0.0).sqrt();
                let d = Vec3::new(r * a.cos(), y, r * a.sin());
                part.points.iter().all(|p| (*p - middle).dot(d) > 0.05)
            });
            assert!(free, "{part:?}");
        }
    }

    #[test]
    fn a_finely_cut_table_has_the_parts_of_the_coarse_one() {
        let json = r#"{"parts":[{"shape":"box","from":[0,0.9,0],"to":[1,1,1]},
            {"shape":"box","from":[0,0,0],"to":[0.08,0.92,0.08],"mirror":"xz"}]}"#;
        let size = Size { width: 1.2, height: 0.75, depth: 0.8 };
        let coarse = PartModel::from_json(json).unwrap().build(size).unwrap().mesh;
        let mut fine = coarse.clone();
        while fine.triangle_count() <= 12_000 {
            for group in &mut fine.groups {
                let old = std::mem::take(&mut group.triangles);
                for [a, b, c] in old {
                    let middle = |p: u32, q: u32| (fine.positions[p as usize] + fine.positions[q as usize]) / 2.0;
                    let n = fine.positions.len() as u32;
                    let new = [middle(a, b), middle(b, c), middle(c, a)];
                    fine.positions.extend(new);
                    fine.normals.extend([Vec3::Y; 3]);
                    fine.uvs.extend([glam::Vec2::ZERO; 3]);
                    group.triangles.extend([[a, n, n + 2], [n, b, n + 1], [n + 2, n + 1, c], [n, n + 1, n + 2]]);
                }
            }
        }
        let bounds = |parts: &[ConvexPart]| {
            let all = || parts.iter().flat_map(|p| &p.points);
            (all().fold(Vec3::MAX, |l, p| l.min(*p)), all().fold(Vec3::MIN, |h, p| h.max(*p)))
        };
        let (a, b) = (convex_parts(&coarse, 1.2), convex_parts(&crate::simple_form(&Arc::new(fine)), 1.2));
        let ((low, high), (fine_low, fine_high)) = (bounds(&a), bounds(&b));
        assert!(b.len().abs_diff(a.len()) <= 3, "{} and {}", a.len(), b.len());
        assert!((low - fine_low).abs().max_element() < 0.01 && (high - fine_high).abs().max_element() < 0.01);
    }

    #[test]
    fn flat_and_broken_meshes_get_a_box() {
        let mut mesh = Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Z], ..Mesh::default() };
        assert!(convex_parts(&mesh, 1.2).is_empty());
        mesh.groups.push(crate::Group { material: 0, triangles: vec![[0, 1, 2], [0, 1, 9]] });
        let parts = convex_parts(&mesh, 1.2);
        assert_eq!(parts.len(), 1);
        assert_eq!(parts[0].points.len(), 8);
    }
}
