//! Cleaning and orienting meshes that came from elsewhere.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use glam::{DMat3, DVec3, Vec2, Vec3};
use meshopt::{SimplifyOptions, VertexDataAdapter};

use crate::{Group, Material, Mesh};

/// Positions closer than this share of the mesh's diagonal are the same.
const WELD: f32 = 1e-6;
/// Triangles with a height below this share of the mesh's diagonal have no area.
const FLAT: f32 = 1e-7;
/// Largest error of the simplification, as a share of the mesh's extent.
const MAX_ERROR: f32 = 0.05;

/// Rounded position, normal and texture coordinates: equal ones are one vertex.
type CornerKey = ([i64; 3], [i32; 3], [i32; 2], [i32; 2]);

/// What [`clean`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CleanReport {
    /// Triangles that came in.
    pub triangles_in: usize,
    /// Triangles that were not finite, out of range or without area.
    pub dropped: usize,
    /// Vertices merged or unused.
    pub vertices_removed: usize,
    /// Triangles that went out.
    pub triangles_out: usize,
}

/// Drops broken, degenerate and unused geometry, welds equal vertices, and simplifies to at most `max_triangles`.
///
/// Simplification: edge collapses by quadric error (Garland and Heckbert 1997, as in meshoptimizer), borders and
/// texture seams kept; when these keep it above the budget, without regard to topology. Missing normals and texture
/// coordinates are made up; vertex colours are averaged into the materials. The result may be empty; [`Mesh::check`] tells.
pub fn clean(mesh: &Mesh, max_triangles: usize) -> (Mesh, CleanReport) {
    let averaged;
    let mesh = if mesh.colors.is_empty() {
        mesh
    } else {
        let mut copy = mesh.clone();
        copy.average_colors();
        averaged = copy;
        &averaged
    };
    let mut report = CleanReport { triangles_in: mesh.triangle_count(), ..CleanReport::default() };
    let count = mesh.positions.len();
    let finite = |i: u32| mesh.positions.get(i as usize).is_some_and(|p| p.is_finite() && p.abs().max_element() < 1e9);
    let used = mesh.triangles().filter(|t| t.iter().all(|i| finite(*i))).flatten().map(|i| mesh.positions[i as usize]);
    let (lo, hi) = used.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
    let diagonal = if lo.is_finite() { (hi - lo).length() } else { 0.0 };
    let normals_known = mesh.normals.len() == count;
    let uvs_known = mesh.uvs.len() == count;
    let metric_known = mesh.metric_uvs.len() == count && count > 0;

    let mut out = Mesh { materials: mesh.materials.clone(), ..Mesh::default() };
    if out.materials.is_empty() {
        out.materials.push(Material::plain("body", [0.5; 3]));
    }
    let mut weld: HashMap<CornerKey, u32> = HashMap::new();
    let step = (diagonal * WELD).max(f32::MIN_POSITIVE);
    for group in &mesh.groups {
        let mut triangles = Vec::with_capacity(group.triangles.len());
        for t in &group.triangles {
            if !t.iter().all(|i| finite(*i)) {
                continue;
            }
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
            let height = (b - a).cross(c - a).length() / longest.max(f32::MIN_POSITIVE);
            if height.is_nan() || height <= diagonal * FLAT {
                continue;
            }
            let face = (b - a).cross(c - a).normalize_or(Vec3::Y);
            let corner = |i: u32| {
                let k = i as usize;
                let normal = if normals_known { mesh.normals[k].normalize_or(face) } else { Vec3::ZERO };
                let uv = if uvs_known && mesh.uvs[k].is_finite() { mesh.uvs[k] } else { Vec2::ZERO };
                let metric =
                    if metric_known && mesh.metric_uvs[k].is_finite() { mesh.metric_uvs[k] } else { Vec2::ZERO };
                (mesh.positions[k], if normal.is_finite() { normal } else { face }, uv, metric)
            };
            let welded = t.map(|i| {
                let (p, n, uv, metric) = corner(i);
                let key = (
                    ((p - lo) / step).to_array().map(|v| v.round() as i64),
                    (n * 100.0).to_array().map(|v| v.round() as i32),
                    (uv * 16_384.0).to_array().map(|v| v.round() as i32),
                    (metric * 4096.0).to_array().map(|v| v.round() as i32),
                );
                *weld.entry(key).or_insert_with(|| {
                    out.positions.push(p);
                    out.normals.push(n);
                    out.uvs.push(uv);
                    if metric_known {
                        out.metric_uvs.push(metric);
                    }
                    (out.positions.len() - 1) as u32
                })
            });
            if welded[0] != welded[1] && welded[1] != welded[2] && welded[2] != welded[0] {
                triangles.push(welded);
            }
        }
        let material = if group.material < out.materials.len() { group.material } else { 0 };
        out.groups.push(Group { material, triangles });
    }
    report.dropped = report.triangles_in - out.triangle_count();
    if out.triangle_count() > max_triangles {
        simplify(&mut out, max_triangles);
    }
    out.groups.retain(|g| !g.triangles.is_empty());
    compact(&mut out);
    if !normals_known {
        out.recompute_normals();
    }
    report.vertices_removed = count.saturating_sub(out.positions.len());
    report.triangles_out = out.triangle_count();
    (out, report)
}

fn simplify(mesh: &mut Mesh, max_triangles: usize) {
    let share = max_triangles as f64 / mesh.triangle_count().max(1) as f64;
    let bytes = meshopt::typed_to_bytes(&mesh.positions);
    let Ok(vertices) = VertexDataAdapter::new(bytes, size_of::<Vec3>(), 0) else { return };
    for group in &mut mesh.groups {
        let indices: Vec<u32> = group.triangles.iter().flatten().copied().collect();
        let target = ((indices.len() / 3) as f64 * share).floor() as usize * 3;
        let mut reduced = meshopt::simplify(&indices, &vertices, target, MAX_ERROR, SimplifyOptions::empty(), None);
        if reduced.len() > target {
            reduced = meshopt::simplify_sloppy(&reduced, &vertices, target, 1.0, None);
        }
        reduced.truncate(target);
        group.triangles = reduced.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    }
}

/// The shape of a mesh in few triangles, for silhouettes, depths and convex parts: meshes of up to 6000 as they are, larger
/// ones simplified to 3000, whose surface is at most 0.4 % of the extent away.
pub fn simple_form(mesh: &Arc<Mesh>) -> Arc<Mesh> {
    const MAX_TRIANGLES: usize = 6000;
    const SIMPLE_TRIANGLES: usize = 3000;
    const SIMPLE_ERROR: f32 = 0.004;
    if mesh.triangle_count() > MAX_TRIANGLES {
        Arc::new(simplified(mesh, SIMPLE_TRIANGLES, SIMPLE_ERROR))
    } else {
        Arc::clone(mesh)
    }
}

/// The shape alone in fewer triangles: one group, no texture coordinates.
///
/// Edge collapses as in [`clean`] down to `triangles`, as long as the surface goes no farther than `error` (share of the
/// mesh's extent); vertices stay where they were. Triangles with indices or positions that are none are left out.
pub fn simplified(mesh: &Mesh, triangles: usize, error: f32) -> Mesh {
    let mut place: HashMap<[u32; 3], u32> = HashMap::with_capacity(mesh.positions.len());
    let mut positions: Vec<Vec3> = Vec::new();
    let welded: Vec<Option<u32>> = mesh
        .positions
        .iter()
        .map(|p| {
            // Adding zero turns -0 into 0.
            p.is_finite().then(|| {
                *place.entry((*p + 0.0).to_array().map(f32::to_bits)).or_insert_with(|| {
                    positions.push(*p);
                    positions.len() as u32 - 1
                })
            })
        })
        .collect();
    let mut indices: Vec<u32> = Vec::with_capacity(3 * mesh.triangle_count());
    // Leaves and cards often have a triangle for each side: the two are a closed body without inside, which collapses whole
    // at no error. One of them is enough for the shape.
    let mut taken: HashSet<[u32; 3]> = HashSet::with_capacity(mesh.triangle_count());
    for t in mesh.triangles() {
        let [Some(a), Some(b), Some(c)] = t.map(|i| welded.get(i as usize).copied().flatten()) else { continue };
        let mut corners = [a, b, c];
        corners.sort_unstable();
        if a != b && b != c && c != a && taken.insert(corners) {
            indices.extend([a, b, c]);
        }
    }
    let target = triangles.saturating_mul(3);
    if indices.len() > target
        && let Ok(vertices) = VertexDataAdapter::new(meshopt::typed_to_bytes(&positions), size_of::<Vec3>(), 0)
    {
        indices = meshopt::simplify(&indices, &vertices, target, error, SimplifyOptions::empty(), None);
    }
    let mut out = Mesh {
        uvs: vec![Vec2::ZERO; positions.len()],
        normals: vec![Vec3::Y; positions.len()],
        positions,
        groups: vec![Group { material: 0, triangles: indices.as_chunks::<3>().0.to_vec() }],
        materials: vec![Material::plain("shape", [0.5; 3])],
        metric_uvs: Vec::new(),
        colors: Vec::new(),
    };
    compact(&mut out);
    out.recompute_normals();
    out
}

/// Leaves out vertices that no triangle uses.
fn compact(mesh: &mut Mesh) {
    let mut new_index = vec![u32::MAX; mesh.positions.len()];
    let (mut positions, mut normals, mut uvs, mut metric_uvs) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for i in mesh.groups.iter_mut().flat_map(|g| &mut g.triangles).flatten() {
        let k = *i as usize;
        if new_index[k] == u32::MAX {
            new_index[k] = positions.len() as u32;
            positions.push(mesh.positions[k]);
            normals.push(mesh.normals[k]);
            uvs.push(mesh.uvs[k]);
            metric_uvs.extend(mesh.metric_uvs.get(k));
        }
        *i = new_index[k];
    }
    (mesh.positions, mesh.normals, mesh.uvs, mesh.metric_uvs) = (positions, normals, uvs, metric_uvs);
}

/// Turns the mesh by `canonical_from_mesh`, then centres it in x and z with its bottom at y = 0.
pub fn canonicalise(mesh: &mut Mesh, canonical_from_mesh: DMat3) {
    let r = canonical_from_mesh.as_mat3();
    mesh.map(|p| r * p, |n| r * n);
    if let Some(b) = mesh.bounds() {
        let c = b.centre();
        let shift = DVec3::new(c.x, b.min.y, c.z).as_vec3();
        mesh.map(|p| p - shift, |n| n);
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::Size;

    use super::*;
    use crate::{PartModel, TemplateParams, template};

    fn ball() -> Mesh {
        let json = r#"{"parts":[{"shape":"sphere"}]}"#;
        PartModel::from_json(json).unwrap().build(Size { width: 1.0, height: 1.0, depth: 1.0 }).unwrap().mesh
    }

    #[test]
    fn broken_geometry_goes_and_the_rest_stays() {
        let mut mesh = ball();
        let good = mesh.triangle_count();
        let n = mesh.positions.len() as u32;
        mesh.positions.extend([Vec3::new(f32::NAN, 0.0, 0.0), Vec3::X, Vec3::splat(0.1)]);
        mesh.normals.extend([Vec3::Y; 3]);
        mesh.uvs.extend([Vec2::ZERO; 3]);
        mesh.groups[0].triangles.extend([[0, 1, n], [0, 1, 99_999], [2, 2, 3], [0, 1, 1]]);
        mesh.groups.push(Group { material: 77, triangles: vec![[0, n + 1, n + 2]] });
        let (cleaned, report) = clean(&mesh, 1_000_000);
        cleaned.check().unwrap();
        assert_eq!(report.dropped, 4);
        assert_eq!(cleaned.triangle_count(), good + 1);
        assert!(clean(&Mesh::default(), 100).0.check().is_err());
    }

    #[test]
    fn a_budget_is_kept_and_the_shape_too() {
        let size = Size { width: 2.0, height: 0.9, depth: 0.9 };
        let sofa = template("sofa", &TemplateParams::default(), size).build(size).unwrap().mesh;
        // the small budget costs the sofa its feet
        for (budget, tolerance) in [(1500, 0.1), (400, 0.2)] {
            let (small, report) = clean(&sofa, budget);
            small.check().unwrap();
            assert!(report.triangles_out <= budget && report.triangles_out > budget / 3, "{report:?}");
            let (a, b) = (sofa.bounds().unwrap(), small.bounds().unwrap());
            assert!((a.size() - b.size()).abs().max_element() < tolerance, "{a:?} {b:?}");
        }
        let ball = ball();
        let (small, _) = clean(&ball, ball.triangle_count() / 4);
        for t in small.triangles() {
            let middle = t.map(|i| small.positions[i as usize]).into_iter().sum::<Vec3>() / 3.0;
            let r = middle.distance(Vec3::new(0.0, 0.5, 0.0));
            assert!((0.4..=0.51).contains(&r), "{r}");
        }
    }

    #[test]
    fn a_shape_in_fewer_triangles_stays_within_its_error() {
        let ball = ball();
        let error = 0.01;
        let small = simplified(&ball, 0, error);
        small.check().unwrap();
        assert!(small.triangle_count() < ball.triangle_count() / 2, "{}", small.triangle_count());
        for t in small.triangles() {
            let middle = t.map(|i| small.positions[i as usize]).into_iter().sum::<Vec3>() / 3.0;
            let r = middle.distance(Vec3::new(0.0, 0.5, 0.0));
            assert!((0.5 - 3.0 * error..=0.501).contains(&r), "{r}");
        }
        // What is broken stays out, and nothing gives nothing.
        let mut broken = ball.clone();
        broken.positions.push(Vec3::NAN);
        let n = ball.positions.len() as u32;
        broken.groups[0].triangles.extend([[0, 1, n], [0, 1, 99_999]]);
        assert_eq!(
            simplified(&broken, usize::MAX, 0.0).triangle_count(),
            simplified(&ball, usize::MAX, 0.0).triangle_count()
        );
        assert_eq!(simplified(&Mesh::default(), 100, error).triangle_count(), 0);
    }

    #[test]
    fn cards_with_two_sides_stay() {
        // A hundred double triangles, in the air and apart, and one below.
        let mut mesh = Mesh { groups: vec![Group::default()], ..Mesh::default() };
        mesh.materials.push(Material::plain("leaf", [0.5; 3]));
        for k in 0..100_u32 {
            let at = Vec3::new((k % 10) as f32, if k == 0 { 0.0 } else { 5.0 }, (k / 10) as f32);
            mesh.positions.extend([at, at + Vec3::X * 0.5, at + Vec3::Z * 0.5]);
            mesh.groups[0].triangles.extend([[3 * k, 3 * k + 1, 3 * k + 2], [3 * k, 3 * k + 2, 3 * k + 1]]);
        }
        let less = simplified(&mesh, 50, 0.01);
        assert_eq!(less.triangle_count(), 100, "none can go without changing the outline");
        assert!(less.bounds().unwrap().min.y == 0.0);
    }

    #[test]
    fn canonical_meshes_stand_on_the_floor_in_the_middle() {
        let mut mesh = ball();
        mesh.map(|p| p * Vec3::new(1.0, 2.0, 0.5) + Vec3::new(3.0, -4.0, 5.0), |n| n);
        canonicalise(&mut mesh, DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2));
        let b = mesh.bounds().unwrap();
        assert!(b.min.y.abs() < 1e-5 && b.centre().x.abs() < 1e-5 && b.centre().z.abs() < 1e-5, "{b:?}");
        assert!((b.size() - DVec3::new(1.0, 0.5, 2.0)).abs().max_element() < 1e-4, "{b:?}");
    }
}
