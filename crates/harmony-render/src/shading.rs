//! Light of the photo on things of plain colours, so that a look without lamps has form.
//!
//! What was modelled has colours that were said, the same on all sides. The photo shows them lit: brighter on top than
//! below, darker in corners. One law of light for the room is fitted to what the photo shows of such surfaces
//! ([`LightLaw`]), with a colour for each material; the law at the vertices becomes [`Mesh::colors`]. Sides that the photo
//! does not show get the same law. Lit renders take the materials without these colours.

mod ambient;
mod fit;
mod pile;

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};
use harmony_mesh::{Bvh, Group, Material, Mesh, Tile};
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
    let (slots, glossy) = slots(things);
    let said: Vec<Vec<[f64; 3]>> = things
        .iter()
        .map(|t| if t.plain.is_empty() { Vec::new() } else { mean_color(t.mesh) })
        .map(|all| all.into_iter().map(|c| c.map(f64::from)).collect())
        .collect();
    let samples = samples(&world, things, &slots, &said, camera, photo);
    let (law, gains) = fit(&samples, &glossy, room);
    let meshes = things
        .par_iter()
        .zip(&slots)
        .zip(&said)
        .map(|((thing, slots), said)| {
            let gains: Vec<[f64; 3]> = slots.iter().map(|slot| gains[*slot]).collect();
            thing.plain.contains(&true).then(|| lit(&world.bvh, thing, said, &gains, &law))
        })
        .collect();
    Shaded { law, meshes, samples: samples.len() }
}

/// For each material of each thing the number of its colour in the fit, and whether that colour shines. Hairs of one thing
/// have one together: no pixel tells a dark strand from the light one beside it, and each by itself would become the mean
/// of both.
fn slots(things: &[Stands<'_>]) -> (Vec<Vec<usize>>, Vec<bool>) {
    let mut glossy = Vec::new();
    let of = |thing: &Stands<'_>| {
        let mut hair = None;
        let of_material = |k: usize| {
            let material = thing.mesh.materials.get(k);
            let next = glossy.len();
            let slot = if material.is_some_and(|m| m.hairy) { *hair.get_or_insert(next) } else { next };
            if slot == next {
                glossy.push(material.is_some_and(Material::shines));
            }
            slot
        };
        (0..thing.plain.len()).map(of_material).collect()
    };
    (things.iter().map(of).collect(), glossy)
}

/// Pixels of the photo that show a plain material where the scene shows it too.
fn samples(
    world: &World,
    things: &[Stands<'_>],
    slots: &[Vec<usize>],
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
            let slot = slots[number][material];
            let is_same = |(other, of): (usize, usize)| {
                other == number && slots.get(other).and_then(|slots| slots.get(of)) == Some(&slot)
            };
            let same = [(margin, 0.0), (-margin, 0.0), (0.0, margin), (0.0, -margin)].iter().all(|(i, j)| {
                met(f64::from(x) + 0.5 + i, f64::from(y) + 0.5 + j)
                    .is_some_and(|other| is_same(world.owner[other.triangle]))
            });
            if !same {
                return None;
            }
            let towards = camera.centre() - hit.point;
            let normal = if hit.normal.dot(towards) < 0.0 { -hit.normal } else { hit.normal };
            let decode = |c: u8| f64::from(tables().decode[usize::from(c)]);
            Some(Sample {
                slot,
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
fn lit(world: &Bvh, thing: &Stands<'_>, said: &[[f64; 3]], gains: &[[f64; 3]], law: &LightLaw) -> Mesh {
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
        .zip(&pile::light(&placed))
        .map(|(((p, n), open), pile)| law.at(n.as_dvec3(), p.as_dvec3(), f64::from(*open)) as f32 * pile)
        .collect();
    let is_plain = |slot: usize| thing.plain.get(slot) == Some(&true);
    mesh.colors = vec![[1.0; 3]; mesh.positions.len()];
    let colors = &mut mesh.colors;
    for group in mesh.groups.iter().filter(|g| is_plain(g.material)) {
        let slot = group.material;
        let numbers = || group.triangles.iter().flatten().map(|i| *i as usize);
        // The brightest place of a slot has white vertices: the rest of the light is in its colour. No colour is brighter
        // than white: all channels give way together, or the hue would turn.
        let brightest = numbers().map(|i| light[i]).fold(0.05, f32::max);
        let shown = |k: usize| (said[slot][k] * gains[slot][k]) as f32 * brightest;
        let level = brightest / (0..3).map(shown).fold(1.0, f32::max);
        numbers().for_each(|i| colors[i] = [(light[i] / level).clamp(0.0, 1.0); 3]);
        repaint(&mut mesh.materials[slot], gains[slot].map(|g| g as f32 * level));
    }
    mesh
}

/// Multiplies a material's colour; factors above one, which no file can say of a pattern, go into the pattern itself.
fn repaint(material: &mut Material, factor: [f32; 3]) {
    let wanted: [f32; 3] = std::array::from_fn(|k| material.base_color[k] * factor[k]);
    let mut rest = wanted;
    if let Some(tile) = material.tile.as_ref().filter(|_| wanted.iter().any(|w| *w > 1.0)) {
        material.tile = Some(Arc::new(dyed(tile, wanted)));
        rest = [1.0; 3];
    }
    for (value, rest) in material.base_color.iter_mut().zip(rest) {
        *value = rest.clamp(0.0, 1.0);
    }
}

/// A tile with its linear colours multiplied, each channel by its own factor.
fn dyed(tile: &Tile, factor: [f32; 3]) -> Tile {
    let table = factor.map(|f| tables().decode.map(|c| tables().encode(c * f)));
    let mut color = (*tile.color).clone();
    for pixel in color.pixels_mut() {
        for (c, table) in pixel.0.iter_mut().zip(&table) {
            *c = table[usize::from(*c)];
        }
    }
    Tile { color: Arc::new(color), ..tile.clone() }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;
    use harmony_scene::{ImageSize, Intrinsics};
    use image::{Rgb, RgbaImage};

    use super::*;

    fn plate(color: [f32; 3], tile: Option<[u8; 3]>) -> Mesh {
        let positions = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, z)| Vec3::new(x, 0.0, z));
        let mut material = Material::plain("top", color);
        material.tile = tile.map(|[r, g, b]| {
            Arc::new(Tile {
                size: [0.1; 2],
                turn: 0.0,
                color: Arc::new(RgbaImage::from_pixel(4, 4, image::Rgba([r, g, b, 255]))),
                normal: None,
                surface: None,
            })
        });
        Mesh {
            positions: positions.to_vec(),
            normals: vec![Vec3::Y; 4],
            uvs: vec![Vec2::ZERO; 4],
            metric_uvs: positions.map(|p| Vec2::new(p.x, p.z)).to_vec(),
            groups: vec![Group { material: 0, triangles: vec![[0, 2, 1], [0, 3, 2]] }],
            materials: vec![material],
            ..Mesh::default()
        }
    }

    /// The plate's look in a photo of one colour, as the scene shows it then.
    fn shown(mesh: &Mesh, photo: [u8; 3]) -> [u8; 3] {
        let size = ImageSize::new(160, 120);
        let lens = Intrinsics::from_horizontal_fov(size, 0.6);
        let camera = Camera::looking(size, lens, DVec3::new(1.0, 1.6, 2.4), DVec3::new(0.0, -0.4, -0.5));
        let photo = RgbImage::from_pixel(160, 120, Rgb(photo));
        let pose = Pose { position: DVec3::new(1.0, 0.5, 1.0), yaw: 0.0, scale: 1.0, stretch: DVec3::ONE };
        let all = Mask::from_fn(size, |_, _| true);
        let things = [Stands { mesh, pose, visible: Some(&all), plain: &[true] }];
        let room = Extents { width: 2.0, height: 2.5, depth: 3.0 };
        let shaded = shade(&Mesh::default(), &things, &camera, &photo, &room);
        assert!(shaded.samples > 20, "{}", shaded.samples);
        let lit = shaded.meshes[0].as_ref().unwrap();
        lit.check().unwrap();
        let frame = crate::render(&camera, &[crate::Instance::posed(lit, &pose, 1)], &crate::RenderOptions::default());
        let at = frame.ids.iter().position(|id| *id == 1).unwrap();
        let middle = frame.ids.iter().enumerate().filter(|(_, id)| **id == 1).map(|(i, _)| i).collect::<Vec<_>>();
        let i = middle.get(middle.len() / 2).copied().unwrap_or(at) as u32;
        let [r, g, b, _] = frame.color.get_pixel(i % 160, i / 160).0;
        [r, g, b]
    }

    fn near(a: [u8; 3], b: [u8; 3], by: u8) -> bool {
        a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= by)
    }

    #[test]
    fn a_plate_of_a_colour_that_is_a_little_off_becomes_the_photos() {
        let got = shown(&plate([0.4, 0.2, 0.1], None), [190, 140, 100]);
        assert!(near(got, [190, 140, 100], 16), "{got:?}");
        let got = shown(&plate([1.0; 3], Some([170, 125, 90])), [190, 140, 100]);
        assert!(near(got, [190, 140, 100], 16), "{got:?}");
    }

    #[test]
    fn a_burnt_out_photo_does_not_turn_the_hue_of_a_pattern() {
        // Orange wood under a glare that burns out its red: what is shown lies between the wood and the photo.
        let (wood, photo) = ([229, 146, 79], [254, 190, 130]);
        let got = shown(&plate([1.0; 3], Some(wood)), photo);
        let green = |c: [u8; 3]| tables().decode[usize::from(c[1])] / tables().decode[usize::from(c[0])];
        let (least, most) = (green(wood), green(photo));
        assert!(green(got) > 0.95 * least && green(got) < 1.03 * most, "{got:?}: {} of {least} to {most}", green(got));
        assert!(got[0] > 200, "{got:?}");
    }
}
