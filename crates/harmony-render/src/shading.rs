//! Light of the photo on things of plain colours, so that a look without lamps has form.
//!
//! What was modelled has colours that were said, the same on all sides. The photo shows them lit: brighter on top than
//! below, darker in corners. One law of light for the room is fitted to what the photo shows of such surfaces
//! ([`LightLaw`]), with a colour for each material; the law at the vertices becomes [`Mesh::colors`]. Sides that the photo
//! does not show get the same law. Lit renders take the materials without these colours.

mod ambient;
mod fit;

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};
use harmony_mesh::{Bvh, Group, Mesh, Tile};
use harmony_scene::{Camera, Extents, Mask, Pose};
use image::RgbImage;
use rayon::prelude::*;

pub use fit::LightLaw;
use fit::{Sample, fit};

use crate::bake::mean_color;
use crate::srgb::tables;

/// Columns of the grid of pixels that are looked at.
const COLUMNS: u32 = 220;
/// Pixels around a sample that must show the same thing.
const MARGIN: i64 = 2;
/// Longest edge after [`Mesh::split_long_edges`], metres.
const EDGE: f32 = 0.14;
/// How far the camera sees, metres.
const FARTHEST: f64 = 100.0;
/// Most triangles of a mesh that edges are cut for.
const TRIANGLES: usize = 60_000;

/// A thing as it stands in the room.
#[derive(Debug, Clone, Copy)]
pub struct Stands<'a> {
    /// Its mesh, canonical frame.
    pub mesh: &'a Mesh,
    /// Where.
    pub pose: Pose,
    /// Its visible pixels in the photo.
    pub visible: Option<&'a Mask>,
    /// For each material whether its colour was said and is to be lit; others keep their look: pixels of the photo, what
    /// shines, what is clear. Empty for a thing that is in the way of light and nothing more.
    pub plain: &'a [bool],
}

/// What came of it.
#[derive(Debug, Clone)]
pub struct Shaded {
    /// The law.
    pub law: LightLaw,
    /// The meshes with their materials' colours fitted and [`Mesh::colors`], `None` for what has nothing plain.
    pub meshes: Vec<Option<Mesh>>,
    /// Pixels that were used.
    pub samples: usize,
}

/// Everything in the room's frame, for rays.
struct World {
    bvh: Bvh,
    /// Thing and material of each triangle; the shell is `usize::MAX`.
    owner: Vec<(usize, usize)>,
}

impl World {
    fn new(shell: &Mesh, things: &[Stands<'_>]) -> Self {
        let mut all = Mesh::default();
        let mut owner = Vec::new();
        let mut add = |mesh: &Mesh, number: usize, place: &dyn Fn(Vec3) -> Vec3| {
            let base = all.positions.len() as u32;
            all.positions.extend(mesh.positions.iter().map(|p| place(*p)));
            let mut triangles = Vec::with_capacity(mesh.triangle_count());
            for group in &mesh.groups {
                owner.extend(std::iter::repeat_n((number, group.material), group.triangles.len()));
                triangles.extend(group.triangles.iter().map(|t| t.map(|i| i + base)));
            }
            all.groups.push(Group { material: 0, triangles });
        };
        add(shell, usize::MAX, &|p| p);
        for (number, thing) in things.iter().enumerate() {
            let linear = thing.pose.linear();
            let at = thing.pose.position;
            add(thing.mesh, number, &|p| (linear * p.as_dvec3() + at).as_vec3());
        }
        Self { bvh: Bvh::new(&all), owner }
    }
}

/// Lights the plain materials of things as the photo has them.
pub fn shade(shell: &Mesh, things: &[Stands<'_>], camera: &Camera, photo: &RgbImage, room: &Extents) -> Shaded {
    let world = World::new(shell, things);
    let firsts: Vec<usize> = things
        .iter()
        .scan(0, |next, thing| {
            let first = *next;
            *next += thing.plain.len();
            Some(first)
        })
        .collect();
    let slots: usize = things.iter().map(|t| t.plain.len()).sum();
    let said: Vec<Vec<[f64; 3]>> = things
        .iter()
        .map(|t| if t.plain.is_empty() { Vec::new() } else { mean_color(t.mesh) })
        .map(|all| all.into_iter().map(|c| c.map(f64::from)).collect())
        .collect();
    let samples = samples(&world, things, &firsts, &said, camera, photo);
    let (law, gains) = fit(&samples, slots, room);
    let meshes = things
        .par_iter()
        .zip(&firsts)
        .map(|(thing, first)| {
            let gains = gains.get(*first..first + thing.plain.len())?;
            thing.plain.contains(&true).then(|| lit(&world.bvh, thing, gains, &law))
        })
        .collect();
    Shaded { law, meshes, samples: samples.len() }
}

/// Pixels of the photo that show a plain material where the scene shows it too.
fn samples(
    world: &World,
    things: &[Stands<'_>],
    firsts: &[usize],
    said: &[Vec<[f64; 3]>],
    camera: &Camera,
    photo: &RgbImage,
) -> Vec<Sample> {
    let step = (photo.width() / COLUMNS).max(1) as usize;
    let (width, height) = photo.dimensions();
    let places: Vec<(u32, u32)> =
        (0..height).step_by(step).flat_map(|y| (0..width).step_by(step).map(move |x| (x, y))).collect();
    let met = |x: f64, y: f64| {
        let ray = camera.ray(DVec2::new(x, y));
        world.bvh.raycast(ray.origin, ray.direction, FARTHEST)
    };
    let surrounded = |mask: &Mask, x: u32, y: u32| {
        [(0, 0), (MARGIN, 0), (-MARGIN, 0), (0, MARGIN), (0, -MARGIN)].iter().all(|(i, j)| {
            let (x, y) = (i64::from(x) + i, i64::from(y) + j);
            let inside = x >= 0 && y >= 0 && x < i64::from(width) && y < i64::from(height);
            inside && mask.bits()[(y * i64::from(width) + x) as usize]
        })
    };
    places
        .into_par_iter()
        .filter_map(|(x, y)| {
            let hit = met(f64::from(x) + 0.5, f64::from(y) + 0.5)?;
            let (number, material) = *world.owner.get(hit.triangle)?;
            let thing = things.get(number)?;
            if !*thing.plain.get(material)? || !surrounded(thing.visible?, x, y) {
                return None;
            }
            // Edges belong to nobody, even where the mask is a little too large.
            let margin = MARGIN as f64;
            let same = [(margin, 0.0), (-margin, 0.0), (0.0, margin), (0.0, -margin)].iter().all(|(i, j)| {
                met(f64::from(x) + 0.5 + i, f64::from(y) + 0.5 + j)
                    .is_some_and(|other| world.owner[other.triangle] == (number, material))
            });
            if !same {
                return None;
            }
            let towards = camera.centre() - hit.point;
            let normal = if hit.normal.dot(towards) < 0.0 { -hit.normal } else { hit.normal };
            let decode = |c: u8| f64::from(tables().decode[usize::from(c)]);
            Some(Sample {
                slot: firsts[number] + material,
                normal,
                point: hit.point,
                openness: ambient::openness(&world.bvh, hit.point, normal),
                photo: photo.get_pixel(x, y).0.map(decode),
                said: said[number][material],
            })
        })
        .collect()
}

/// A thing's mesh with fitted colours and the law at its vertices.
fn lit(world: &Bvh, thing: &Stands<'_>, gains: &[[f64; 3]], law: &LightLaw) -> Mesh {
    let mut mesh = thing.mesh.clone();
    let scale = thing.pose.stretch * thing.pose.scale;
    mesh.split_long_edges(scale.as_vec3(), EDGE, TRIANGLES);
    let (linear, at) = (thing.pose.linear(), thing.pose.position);
    let turn = linear.inverse().transpose();
    let mut placed = mesh.clone();
    placed.map(|p| (linear * p.as_dvec3() + at).as_vec3(), |n| (turn * n.as_dvec3()).normalize_or(DVec3::Y).as_vec3());
    let open = ambient::at_vertices(world, &placed);
    let light: Vec<f32> = placed
        .positions
        .par_iter()
        .zip(&placed.normals)
        .zip(&open)
        .map(|((p, n), open)| law.at(n.as_dvec3(), p.as_dvec3(), f64::from(*open)) as f32)
        .collect();
    let mut levels = vec![1.0_f32; mesh.materials.len()];
    let mut plain = vec![false; mesh.positions.len()];
    for group in mesh.groups.iter().filter(|g| thing.plain.get(g.material) == Some(&true)) {
        let numbers = || group.triangles.iter().flatten().map(|i| *i as usize);
        levels[group.material] = numbers().map(|i| light[i]).fold(0.05, f32::max);
        numbers().for_each(|i| plain[i] = true);
    }
    mesh.colors = vec![[1.0; 3]; mesh.positions.len()];
    for (slot, material) in mesh.materials.iter_mut().enumerate() {
        let (Some(true), Some(gain)) = (thing.plain.get(slot), gains.get(slot)) else { continue };
        let wanted: [f32; 3] = std::array::from_fn(|k| material.base_color[k] * gain[k] as f32 * levels[slot]);
        // A factor above one has to go into the pattern, or the vertices give way.
        let most = wanted.iter().copied().fold(1.0, f32::max);
        if most > 1.0
            && let Some(tile) = &material.tile
        {
            material.tile = Some(Arc::new(brighter(tile, most)));
        }
        for (value, wanted) in material.base_color.iter_mut().zip(wanted) {
            *value = (wanted / most).clamp(0.0, 1.0);
        }
        if material.tile.is_none() && most > 1.0 {
            levels[slot] /= most;
        }
    }
    let mut level_of = vec![1.0_f32; mesh.positions.len()];
    for group in &mesh.groups {
        for i in group.triangles.iter().flatten() {
            level_of[*i as usize] = levels[group.material];
        }
    }
    for (i, color) in mesh.colors.iter_mut().enumerate().filter(|(i, _)| plain[*i]) {
        *color = [(light[i] / level_of[i]).clamp(0.0, 1.0); 3];
    }
    mesh
}

/// A tile with its linear colours multiplied.
fn brighter(tile: &Tile, factor: f32) -> Tile {
    let table: Vec<u8> = tables().decode.iter().map(|c| tables().encode(c * factor)).collect();
    let mut color = (*tile.color).clone();
    for pixel in color.pixels_mut() {
        for c in pixel.0.iter_mut().take(3) {
            *c = table[usize::from(*c)];
        }
    }
    Tile { color: Arc::new(color), ..tile.clone() }
}
