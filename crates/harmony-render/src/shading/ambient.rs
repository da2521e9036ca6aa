//! How much of the room a point of a surface sees: ambient occlusion at places, and at all vertices by what is near.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use harmony_mesh::{Bvh, Mesh};
use rayon::prelude::*;

/// Distance at which what stands before a surface takes no light any more, metres.
const REACH: f64 = 1.2;
/// Rays a point.
const RAYS: usize = 32;
/// Places an object is measured at, about.
const PLACES: f64 = 3000.0;
/// Smallest distance of places, metres.
const FINEST: f32 = 0.012;
/// Rays begin this far above the surface, metres.
const ABOVE: f64 = 0.004;

/// Openness of a point from 0 (buried) to 1 (nothing within [`REACH`]): the cosine-weighted mean over the half space of
/// `1 - (1 - d / REACH)^2`, with `d` the distance of what a ray meets.
///
/// Directions are a spiral over the half space, turned with the normal only, so that flat faces get smooth values.
pub(super) fn openness(world: &Bvh, point: DVec3, normal: DVec3) -> f64 {
    let n = normal.normalize_or(DVec3::Y);
    let (s, t) = n.any_orthonormal_pair();
    let origin = point + n * ABOVE;
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let open: f64 = (0..RAYS)
        .map(|k| {
            let r2 = (k as f64 + 0.5) / RAYS as f64;
            let (r, turn) = (r2.sqrt(), golden * k as f64);
            let direction = s * (r * turn.cos()) + t * (r * turn.sin()) + n * (1.0 - r2).sqrt();
            let near = world.raycast(origin, direction, REACH).map_or(1.0, |hit| hit.distance / REACH);
            1.0 - (1.0 - near) * (1.0 - near)
        })
        .sum();
    open / RAYS as f64
}

/// A place that stands for the vertices around it.
#[derive(Debug, Clone, Copy)]
struct Place {
    point: Vec3,
    normal: Vec3,
    open: f32,
}

/// Least height between sheets that are told apart, metres.
const SHEET: f32 = 0.006;

type Cell = (i32, i32, i32);

/// Openness at the vertices of a mesh that is in the room's frame.
///
/// It is measured at some thousand vertices and taken from those around a vertex that face as it does.
pub(super) fn at_vertices(world: &Bvh, mesh: &Mesh) -> Vec<f32> {
    let step = spacing(mesh);
    let cell = |p: Vec3| {
        let c = (p / step).floor();
        (c.x as i32, c.y as i32, c.z as i32)
    };
    // Sheets that lie upon each other (a drawer's front on its body) are told apart by their height along the normal.
    let sheet = (0.15 * step).max(SHEET);
    // What stands for a cell is the vertex nearest to the middle of those in it: their mean lies off the surface.
    let mut cells: BTreeMap<(Cell, u8, i32), Vec<u32>> = BTreeMap::new();
    for (i, (p, n)) in mesh.positions.iter().zip(&mesh.normals).enumerate() {
        let side = facing(*n);
        let height = (p[usize::from(side / 2)] / sheet).floor() as i32;
        cells.entry((cell(*p), side, height)).or_default().push(i as u32);
    }
    let keys: Vec<Cell> = cells.keys().map(|(cell, _, _)| *cell).collect();
    let members: Vec<Vec<u32>> = cells.into_values().collect();
    let places: Vec<Place> = members
        .into_par_iter()
        .map(|members| {
            let position = |i: &u32| mesh.positions[*i as usize];
            let mean = members.iter().map(position).sum::<Vec3>() / members.len() as f32;
            let off = |i: &u32| (position(i) - mean).length_squared();
            let nearest = members.iter().min_by(|a, b| off(a).total_cmp(&off(b))).copied().unwrap_or(members[0]);
            let (point, normal) = (position(&nearest), mesh.normals[nearest as usize]);
            Place { point, normal, open: openness(world, point.as_dvec3(), normal.as_dvec3()) as f32 }
        })
        .collect();
    let mut of_cell: BTreeMap<Cell, Vec<usize>> = BTreeMap::new();
    for (i, key) in keys.iter().enumerate() {
        of_cell.entry(*key).or_default().push(i);
    }
    mesh.positions
        .par_iter()
        .zip(&mesh.normals)
        .map(|(p, n)| {
            let (x, y, z) = cell(*p);
            let (mut sum, mut total) = (0.0, 0.0);
            for near in (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| (x + i, y + j, z + k))))
            {
                for place in of_cell.get(&near).into_iter().flatten().map(|i| places[*i]) {
                    let faces = place.normal.dot(*n).max(0.0);
                    let apart = place.point - *p;
                    let off = apart.dot(*n) / sheet;
                    let away = apart.length_squared() / (step * step) + off * off;
                    // What is inside something else (a body behind its drawers) says little of what is outside.
                    let shows = place.open + 0.02;
                    let weight = faces * faces * faces * (-1.2 * away).exp() * shows * shows + 1e-9;
                    sum += weight * place.open;
                    total += weight;
                }
            }
            if total > 0.0 { sum / total } else { 1.0 }
        })
        .collect()
}

/// Distance of places that gives [`PLACES`] of them, metres.
fn spacing(mesh: &Mesh) -> f32 {
    let area: f64 = mesh
        .triangles()
        .map(|t| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            f64::from((b - a).cross(c - a).length()) / 2.0
        })
        .sum();
    ((area / PLACES).sqrt() as f32).max(FINEST)
}

/// Which side of a cube a normal points to.
fn facing(n: Vec3) -> u8 {
    let a = n.abs();
    let (axis, value) = if a.x >= a.y && a.x >= a.z {
        (0, n.x)
    } else if a.y >= a.z {
        (1, n.y)
    } else {
        (2, n.z)
    };
    axis * 2 + u8::from(value < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;
    use harmony_mesh::{Group, Material};

    fn square(side: f32, y: f32, up: bool) -> Mesh {
        let positions =
            [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, z)| Vec3::new(x * side, y, z * side));
        let triangles = if up { vec![[0, 2, 1], [0, 3, 2]] } else { vec![[0, 1, 2], [0, 2, 3]] };
        Mesh {
            positions: positions.to_vec(),
            normals: vec![if up { Vec3::Y } else { Vec3::NEG_Y }; 4],
            uvs: vec![Vec2::ZERO; 4],
            groups: vec![Group { material: 0, triangles }],
            materials: vec![Material::plain("m", [0.5; 3])],
            ..Mesh::default()
        }
    }

    #[test]
    fn nothing_around_is_open_and_a_lid_closes() {
        let far = Bvh::new(&square(50.0, 10.0, false));
        assert!((openness(&far, DVec3::ZERO, DVec3::Y) - 1.0).abs() < 1e-12);
        let lid = Bvh::new(&square(50.0, 0.05, false));
        let closed = openness(&lid, DVec3::ZERO, DVec3::Y);
        assert!(closed < 0.25, "{closed}");
        // An endless ceiling at half the reach: straight up 0.75 is open, and more towards the horizon.
        let half = openness(&Bvh::new(&square(50.0, 0.604, false)), DVec3::ZERO, DVec3::Y);
        assert!(half > 0.75 && half < 0.95, "{half}");
    }

    #[test]
    fn a_front_is_not_darkened_by_the_body_behind_it() {
        // A panel two centimetres before a wall of the same mesh, which it hides wholly.
        let lie = |side: f32, y: f32| {
            let mut sheet = square(side, y, true);
            sheet.split_long_edges(Vec3::ONE, 0.1, 100_000);
            sheet
        };
        let (body, front) = (lie(0.4, 0.0), lie(0.4, 0.02));
        let count = body.positions.len();
        let mut both = body;
        both.append(&front);
        let open = at_vertices(&Bvh::new(&both), &both);
        assert!(open[count..].iter().all(|o| *o > 0.9), "{:?}", &open[count..]);
        let middle = |i: usize| both.positions[i].abs().max_element() < 0.2;
        assert!((0..count).filter(|i| middle(*i)).all(|i| open[i] < 0.3));
    }

    #[test]
    fn the_floor_is_darker_below_a_table_than_beside_it() {
        let mut floor = square(3.0, 0.0, true);
        floor.split_long_edges(Vec3::ONE, 0.2, 100_000);
        let world = Bvh::new(&square(0.4, 0.3, false));
        let open = at_vertices(&world, &floor);
        let mean = |keep: &dyn Fn(Vec3) -> bool| {
            let all: Vec<f32> = floor.positions.iter().zip(&open).filter(|(p, _)| keep(**p)).map(|(_, o)| *o).collect();
            all.iter().sum::<f32>() / all.len() as f32
        };
        let below = mean(&|p| p.abs().max_element() < 0.15);
        let far = mean(&|p| p.abs().max_element() > 2.2);
        assert!(below < 0.7 && far > 0.98, "{below} {far}");
    }
}
