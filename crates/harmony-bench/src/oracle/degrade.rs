//! A mesh as an image-to-3D model leaves it at its worse: tilted, thin parts thick, the back made up, bits in the air.

use glam::{DMat3, DVec3, Vec2, Vec3};
use harmony_mesh::{Group, Mesh};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::normal;

/// Tilt, degrees.
const TILT_DEG: [f64; 2] = [3.0, 9.0];
/// How far the surface moves outwards, share of the longest side: a slat of 15 mm on a chair of 0.9 m gets 35 mm thick.
const SWELL: [f64; 2] = [0.006, 0.014];
/// Relief of the far side, share of each side.
const RELIEF: f64 = 0.035;
/// Bits in the air.
const FLOATERS: [usize; 2] = [2, 5];
/// Their size, share of the longest side.
const FLOATER_SIZE: [f64; 2] = [0.008, 0.03];
/// Their distance from the object's box, share of the longest side.
const FLOATER_GAP: [f64; 2] = [0.02, 0.10];

fn between(rng: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// Spoils a canonical mesh (bottom at y = 0, centred); `towards` is the direction to the camera in its frame. The same
/// stream of numbers gives the same mesh.
pub(super) fn degraded(mesh: &Mesh, towards: DVec3, rng: &mut ChaCha8Rng) -> Mesh {
    let mut out = mesh.clone();
    let Some(bounds) = mesh.bounds() else { return out };
    let size = bounds.size().max(DVec3::splat(1e-3));
    let longest = size.max_element();
    swell(&mut out, between(rng, SWELL) * longest);
    relief(&mut out, bounds.centre(), size, towards, rng);
    for _ in 0..rng.random_range(FLOATERS[0]..=FLOATERS[1]) {
        let (part, gap) = (between(rng, FLOATER_SIZE) * longest, between(rng, FLOATER_GAP) * longest);
        let direction = DVec3::new(normal(rng), normal(rng).abs(), normal(rng)).normalize_or(DVec3::Y);
        let reach = (size / 2.0 / direction.abs().max(DVec3::splat(1e-6))).min_element();
        floater(&mut out, bounds.centre() + direction * (reach + gap + part), part, rng);
    }
    let (tilt, about) = (between(rng, TILT_DEG).to_radians(), rng.random::<f64>() * std::f64::consts::TAU);
    let turn = DMat3::from_axis_angle(DVec3::new(about.cos(), 0.0, about.sin()), tilt).as_mat3();
    out.map(|p| turn * p, |n| turn * n);
    out
}

/// Moves every vertex outwards: equal positions by the mean of their normals, so that nothing tears.
fn swell(mesh: &mut Mesh, by: f64) {
    let mut means: std::collections::BTreeMap<[u32; 3], Vec3> = std::collections::BTreeMap::new();
    for t in mesh.triangles() {
        let p = t.map(|i| mesh.positions[i as usize]);
        let n = (p[1] - p[0]).cross(p[2] - p[0]);
        for q in p {
            *means.entry(q.to_array().map(f32::to_bits)).or_default() += n;
        }
    }
    for p in &mut mesh.positions {
        let n = means.get(&p.to_array().map(f32::to_bits)).copied().unwrap_or(Vec3::ZERO);
        *p += n.normalize_or_zero() * by as f32;
    }
}

/// A smooth random field on the side away from the camera, growing from nothing in the middle.
fn relief(mesh: &mut Mesh, centre: DVec3, size: DVec3, towards: DVec3, rng: &mut ChaCha8Rng) {
    let towards = towards.normalize_or(DVec3::Z);
    let waves: Vec<(DVec3, DVec3, f64)> = (0..6)
        .map(|_| {
            let mut three = || DVec3::new(normal(rng), normal(rng), normal(rng));
            let (k, d) = (three() * 6.0, three());
            (k, d, rng.random::<f64>() * std::f64::consts::TAU)
        })
        .collect();
    for p in &mut mesh.positions {
        let unit = (p.as_dvec3() - centre) / size;
        let far = (-(unit * size).dot(towards) / (0.5 * size.length())).clamp(0.0, 1.0);
        let field: DVec3 =
            waves.iter().map(|(k, d, phase)| *d * (k.dot(unit) + phase).sin()).sum::<DVec3>() / 6.0_f64.sqrt();
        *p = (p.as_dvec3() + field * size * RELIEF * far).as_vec3();
    }
}

/// A small octahedron of irregular size, coloured like some point of the mesh.
fn floater(mesh: &mut Mesh, at: DVec3, size: f64, rng: &mut ChaCha8Rng) {
    let uv = match mesh.uvs.len() {
        0 => Vec2::ZERO,
        n => mesh.uvs[rng.random_range(0..n)],
    };
    let base = mesh.positions.len() as u32;
    let metric = !mesh.metric_uvs.is_empty();
    for axis in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
        mesh.positions.push((at + axis * size * (0.6 + 0.4 * rng.random::<f64>())).as_vec3());
        mesh.normals.push(axis.as_vec3());
        mesh.uvs.push(uv);
        if metric {
            mesh.metric_uvs.push(Vec2::ZERO);
        }
    }
    let faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let triangles = faces.map(|f: [u32; 3]| f.map(|i| base + i)).to_vec();
    mesh.groups.push(Group { material: 0, triangles });
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    fn board() -> Mesh {
        // A standing board: 1 m wide, 1.2 m high, 20 mm thick.
        let json = r#"{"parts":[{"shape":"box","from":[0,0,0],"to":[1,1,1]}]}"#;
        let size = harmony_scene::Size { width: 1.0, height: 1.2, depth: 0.02 };
        harmony_mesh::PartModel::from_json(json).unwrap().build(size).unwrap().mesh
    }

    #[test]
    fn swelling_moves_faces_outwards_by_the_distance() {
        let mut mesh = board();
        swell(&mut mesh, 0.01);
        let b = mesh.bounds().unwrap();
        // Corners move along the mean of their faces' areas: the large faces by nearly all of it.
        assert!((b.size().z - 0.04).abs() < 0.004, "{:?}", b.size());
    }

    #[test]
    fn the_same_numbers_give_the_same_mesh_with_its_faults() {
        let mesh = board();
        let make = |seed| degraded(&mesh, DVec3::Z, &mut ChaCha8Rng::seed_from_u64(seed));
        let (a, b, c) = (make(5), make(5), make(6));
        assert_eq!(a.positions, b.positions);
        assert_ne!(a.positions, c.positions);
        a.check().unwrap();
        let bits = (a.triangle_count() - mesh.triangle_count()) / 8;
        assert!((2..=5).contains(&bits), "{bits} bits in the air");
        // The top's normals were +Y: they lean by the tilt, whatever it is about.
        let top: Vec<usize> = (0..mesh.normals.len()).filter(|i| mesh.normals[*i].y > 0.999).collect();
        assert!(!top.is_empty());
        for i in top {
            let lean = f64::from(a.normals[i].y).clamp(-1.0, 1.0).acos().to_degrees();
            assert!((2.9..=9.1).contains(&lean), "{lean}");
        }
    }
}
