//! A robot's links as convex pieces, for distances.
//!
//! # What stands for a link
//! The convex hulls of its collision meshes, and its boxes, where the model has collision meshes (Panda): what its makers
//! gave. A model whose collision geoms are a few capsules for walking (H1) has its visual meshes instead, each cut into
//! slices along its longest side: the hulls of the slices hold the mesh, and stand off where a slice is hollow. So
//! distances are never larger than those of the mesh itself, but for hulls of more than 64 corners, which lose fractions of
//! a millimetre.

use glam::{DAffine3, DVec3};
use harmony_physics::Hull;
use rayon::prelude::*;

use crate::model::{Form, Geom, Link, Model};

/// Slices of a mesh.
const SLICES: usize = 6;

/// Convex pieces of every link, link frame.
pub fn pieces(model: &Model) -> Vec<Vec<Hull>> {
    (0..model.links.len()).into_par_iter().map(|link| pieces_of(model, link)).collect()
}

/// Convex pieces of one link, link frame.
pub fn pieces_of(model: &Model, link: usize) -> Vec<Hull> {
    let link = &model.links[link];
    if has_collision_meshes(model) { collision(link) } else { visual(link) }
}

fn has_collision_meshes(model: &Model) -> bool {
    model.links.iter().flat_map(|l| &l.geoms).any(|g| !g.visual && matches!(g.form, Form::Mesh(_)))
}

fn collision(link: &Link) -> Vec<Hull> {
    link.geoms.iter().filter(|g| !g.visual).filter_map(|g| Hull::of(&points(g))).collect()
}

fn visual(link: &Link) -> Vec<Hull> {
    let meshes = link.geoms.iter().filter(|g| g.visual);
    meshes
        .flat_map(
            |g| if matches!(g.form, Form::Mesh(_)) { sliced(g) } else { Hull::of(&points(g)).into_iter().collect() },
        )
        .collect()
}

/// Points whose hull is that of a geom, link frame; round forms by their polygons of 16 sides.
fn points(geom: &Geom) -> Vec<DVec3> {
    let ring = |radius: f64, z: f64| {
        (0..16).map(move |k| {
            let a = std::f64::consts::TAU * f64::from(k) / 16.0;
            DVec3::new(radius * a.cos(), radius * a.sin(), z)
        })
    };
    let own: Vec<DVec3> = match &geom.form {
        Form::Mesh(mesh) => mesh.positions.iter().map(|p| p.as_dvec3()).collect(),
        Form::Box(half) => (0..8)
            .map(|k| {
                let side = |bit: usize, v: f64| if k & bit == 0 { -v } else { v };
                DVec3::new(side(1, half.x), side(2, half.y), side(4, half.z))
            })
            .collect(),
        Form::Cylinder(radius, half) => ring(*radius, -half).chain(ring(*radius, *half)).collect(),
        Form::Capsule(radius, half) => ball(*radius, -half).chain(ball(*radius, *half)).collect(),
        Form::Sphere(radius) => ball(*radius, 0.0).collect(),
    };
    own.into_iter().map(|p| geom.link_from_geom.transform_point3(p)).collect()
}

fn ball(radius: f64, z: f64) -> impl Iterator<Item = DVec3> {
    (-2..=2).flat_map(move |row| {
        let up = f64::from(row) * std::f64::consts::FRAC_PI_4;
        (0..12).map(move |k| {
            let a = std::f64::consts::TAU * f64::from(k) / 12.0;
            DVec3::new(radius * up.cos() * a.cos(), radius * up.cos() * a.sin(), z + radius * up.sin())
        })
    })
}

/// Hulls of a mesh's slices along its longest side.
fn sliced(geom: &Geom) -> Vec<Hull> {
    let Form::Mesh(mesh) = &geom.form else { return vec![] };
    let place: DAffine3 = geom.link_from_geom;
    let Some(bounds) = mesh.bounds() else { return vec![] };
    let size = bounds.size();
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { usize::from(size.z > size.y) + 1 };
    let step = size[axis] / SLICES as f64;
    if step < 0.01 {
        return Hull::of(&points(geom)).into_iter().collect();
    }
    // Files of bare triangles have a corner once for every triangle that it is of.
    let mut corners = mesh.positions.clone();
    corners.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    corners.dedup();
    let slice = |k: usize| {
        let low = bounds.min[axis] + step * k as f64;
        let high = low + step;
        let within = |p: &DVec3| p[axis] >= low && p[axis] <= high;
        let mut inside: Vec<DVec3> = corners.iter().map(|p| p.as_dvec3()).filter(within).collect();
        for t in mesh.triangles() {
            let corners = t.map(|i| mesh.positions[i as usize].as_dvec3());
            for e in 0..3 {
                let (a, b) = (corners[e], corners[(e + 1) % 3]);
                for plane in [low, high] {
                    let (da, db) = (a[axis] - plane, b[axis] - plane);
                    if (da < 0.0) != (db < 0.0) {
                        inside.push(a + (b - a) * (da / (da - db)));
                    }
                }
            }
        }
        let moved: Vec<DVec3> = inside.into_iter().map(|p| place.transform_point3(p)).collect();
        Hull::of(&moved).or_else(|| Hull::of_sheet(&moved, 0.002))
    };
    (0..SLICES).filter_map(slice).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_mesh::{Group, Mesh};

    use super::*;
    use crate::model::tests::arm;

    #[test]
    fn slices_follow_a_bend_that_one_hull_would_fill() {
        // An L of two bars, 1 m long and 0.1 m thick, as one mesh.
        let bars = [
            Hull::cuboid(DVec3::ZERO, DVec3::new(1.0, 0.1, 0.1)),
            Hull::cuboid(DVec3::ZERO, DVec3::new(0.1, 0.9, 0.1)),
        ];
        let mut mesh = Mesh::default();
        let mut group = Group::default();
        for bar in &bars {
            let base = mesh.positions.len() as u32;
            mesh.positions.extend(bar.vertices.iter().map(|v| v.as_vec3()));
            group.triangles.extend(bar.faces.iter().map(|f| f.map(|i| i + base)));
        }
        mesh.groups.push(group);
        let mut model = arm();
        model.links[0].geoms = vec![Geom {
            link_from_geom: DAffine3::from_translation(DVec3::Z),
            form: Form::Mesh(Arc::new(mesh)),
            visual: true,
            color: [0.5; 3],
        }];
        let hulls = &pieces(&model)[0];
        let volume: f64 = hulls.iter().map(|h| h.moments().mass).sum();
        let one = 0.1 * (0.01 + (0.9 * 0.9 / 2.0));
        assert!(volume < 0.6 * one && volume > 0.018, "{volume} of {one}");
        let (low, high) = hulls
            .iter()
            .map(Hull::bounds)
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        assert!(low.distance(DVec3::Z) < 1e-5 && high.distance(DVec3::new(1.0, 0.9, 1.1)) < 1e-5, "{low} {high}");
    }
}
