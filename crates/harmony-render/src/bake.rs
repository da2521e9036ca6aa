//! Textures for part models from the object's own pixels (DESIGN section 7).
//!
//! Every texel of the unwrap knows its surface point. A point that the camera sees, inside the object's mask, takes the
//! photo's colour; the others are completed: first from the mirror image across the object's plane of symmetry
//! (x = 0), then from what was observed of the same slot nearby, last from the slot's own colour.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};
use harmony_mesh::Mesh;
use harmony_scene::{Camera, Mask, Pose};
use image::{Rgba, RgbImage, RgbaImage};
use rayon::prelude::*;

use crate::{DepthFrame, Instance, RenderOptions, render_depth_ids};

/// How to bake.
#[derive(Debug, Clone, PartialEq)]
pub struct BakeOptions {
    /// Slots (material names) that keep their colour.
    pub plain_slots: Vec<String>,
    /// Pixels by which the mask is shrunk before colours are taken from it.
    pub erode_px: i32,
    /// Smallest cosine between surface normal and view at which a texel is taken from the photo.
    pub min_cosine: f64,
    /// Texture side in pixels; 0 chooses 256 to 1024 from the object's size in the photo.
    pub texture_size: u32,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self { plain_slots: Vec::new(), erode_px: 2, min_cosine: 0.12, texture_size: 0 }
    }
}

/// A mesh with its texture, and how much of it was seen.
#[derive(Debug, Clone)]
pub struct BakedMesh {
    /// The mesh; its photo slots share one texture.
    pub mesh: Mesh,
    /// Share of the photo slots' texels that were taken from the photo, 0 to 1.
    pub observed: f64,
    /// sRGB colour of each slot (by name): median of its observed pixels, else its own colour.
    pub colors: Vec<SlotColour>,
}

/// Median colour of a slot in the photo.
#[derive(Debug, Clone, PartialEq)]
pub struct SlotColour {
    /// Slot name.
    pub slot: String,
    /// sRGB.
    pub rgb: [u8; 3],
    /// Photo pixels it was taken from (0: nothing was seen, the colour is the mesh's own).
    pub pixels: usize,
}

/// Observed samples kept for the smooth completion of one slot.
const SAMPLES_PER_SLOT: usize = 600;
/// Reach of the smooth completion, as a fraction of the object's diagonal.
const REACH: f64 = 0.08;
/// Texels of padding around charts.
const PADDING: usize = 6;

/// A texel of the unwrap that lies on the surface.
#[derive(Clone, Copy)]
struct Texel {
    at: usize,
    slot: usize,
    point: Vec3,
    normal: Vec3,
    color: Option<[f32; 3]>,
}

/// Puts the photo's pixels on the mesh and completes what was not seen.
///
/// `mesh` is in its canonical frame with a unique unwrap, `pose` carries it into the room, `visible` holds the photo
/// pixels that belong to this object.
pub fn bake_texture(
    mesh: &Mesh,
    pose: &Pose,
    camera: &Camera,
    photo: &RgbImage,
    visible: &Mask,
    options: &BakeOptions,
) -> BakedMesh {
    let side = texture_side(visible, options);
    let mut texels = surface_texels(mesh, side, &options.plain_slots);
    observe(&mut texels, mesh, pose, camera, photo, visible, options);
    let observed_count = texels.iter().filter(|t| t.color.is_some()).count();
    let observed = observed_count as f64 / texels.len().max(1) as f64;
    let colors = slot_medians(mesh, &texels);
    complete(&mut texels, mesh, &colors);

    let mut texture = RgbaImage::new(side, side);
    let mut covered = vec![false; (side * side) as usize];
    for texel in &texels {
        if let Some(c) = texel.color {
            let (x, y) = (texel.at as u32 % side, texel.at as u32 / side);
            texture.put_pixel(x, y, Rgba([byte(c[0]), byte(c[1]), byte(c[2]), 255]));
            covered[texel.at] = true;
        }
    }
    pad(&mut texture, &mut covered, side as usize);
    let mut mesh = mesh.clone();
    let texture = Arc::new(texture);
    for material in &mut mesh.materials {
        if !options.plain_slots.contains(&material.name) {
            material.texture = Some(Arc::clone(&texture));
            material.base_color = [1.0, 1.0, 1.0, material.base_color[3]];
        }
    }
    BakedMesh { mesh, observed, colors }
}

/// Median photo colour of each slot as visible in the pose, to recolour a part model without baking.
pub fn slot_colors(
    mesh: &Mesh,
    pose: &Pose,
    camera: &Camera,
    photo: &RgbImage,
    visible: &Mask,
    options: &BakeOptions,
) -> Vec<SlotColour> {
    let mut texels = surface_texels(mesh, 256, &[]);
    observe(&mut texels, mesh, pose, camera, photo, visible, options);
    slot_medians(mesh, &texels)
}

fn byte(v: f32) -> u8 {
    v.round().clamp(0.0, 255.0) as u8
}

fn texture_side(visible: &Mask, options: &BakeOptions) -> u32 {
    if options.texture_size > 0 {
        return options.texture_size.clamp(16, 4096);
    }
    // The unwrap shows all sides, the photo less than half of them: about 2.2 texels a photo pixel's edge.
    let wanted = (visible.count() as f64).sqrt() * 2.2;
    [256, 384, 512, 768, 1024].into_iter().find(|s| f64::from(*s) >= wanted).unwrap_or(1024)
}

/// All texels whose centres lie in a triangle of the unwrap, slots that keep their colour left out.
fn surface_texels(mesh: &Mesh, side: u32, plain: &[String]) -> Vec<Texel> {
    let mut taken = vec![false; (side * side) as usize];
    let mut texels = Vec::new();
    let s = f64::from(side);
    for group in &mesh.groups {
        if mesh.materials.get(group.material).is_none_or(|m| plain.contains(&m.name)) {
            continue;
        }
        for triangle in &group.triangles {
            let t = triangle.map(|i| i as usize);
            let uv = t.map(|i| DVec2::new(f64::from(mesh.uvs[i].x), f64::from(mesh.uvs[i].y)) * s);
            let area = (uv[1] - uv[0]).perp_dot(uv[2] - uv[0]);
            if area.abs() < 1e-9 || !area.is_finite() {
                continue;
            }
            let low = uv[0].min(uv[1]).min(uv[2]).floor().max(DVec2::ZERO);
            let high = uv[0].max(uv[1]).max(uv[2]).ceil().min(DVec2::splat(s));
            for y in low.y as u32..high.y as u32 {
                for x in low.x as u32..high.x as u32 {
                    let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let w0 = (uv[1] - p).perp_dot(uv[2] - p) / area;
                    let w1 = (uv[2] - p).perp_dot(uv[0] - p) / area;
                    let w2 = 1.0 - w0 - w1;
                    let at = (y * side + x) as usize;
                    if w0 < -1e-6 || w1 < -1e-6 || w2 < -1e-6 || taken[at] {
                        continue;
                    }
                    taken[at] = true;
                    let w = [w0 as f32, w1 as f32, w2 as f32];
                    let mix = |v: &[Vec3]| v[t[0]] * w[0] + v[t[1]] * w[1] + v[t[2]] * w[2];
                    texels.push(Texel {
                        at,
                        slot: group.material,
                        point: mix(&mesh.positions),
                        normal: mix(&mesh.normals).normalize_or(Vec3::Y),
                        color: None,
                    });
                }
            }
        }
    }
    texels
}

/// Takes the photo's colour for every texel that the camera sees inside the mask.
fn observe(
    texels: &mut [Texel],
    mesh: &Mesh,
    pose: &Pose,
    camera: &Camera,
    photo: &RgbImage,
    visible: &Mask,
    options: &BakeOptions,
) {
    let size = camera.size;
    if photo.width() != size.width || photo.height() != size.height || visible.size() != size {
        return;
    }
    let safe = shrunk(visible, options.erode_px);
    let own: DepthFrame = render_depth_ids(camera, &[Instance::posed(mesh, pose, 1)], &RenderOptions::default());
    let linear = pose.linear();
    let normal_matrix = linear.inverse().transpose();
    let eye = camera.centre();
    texels.par_iter_mut().for_each(|texel| {
        let point = pose.position + linear * texel.point.as_dvec3();
        let normal = (normal_matrix * texel.normal.as_dvec3()).normalize_or(DVec3::Y);
        let view = (eye - point).normalize_or(DVec3::Y);
        if normal.dot(view) < options.min_cosine {
            return;
        }
        let Some(pixel) = camera.project(point).filter(|p| camera.contains(*p)) else { return };
        let (x, y) = (pixel.x as i64, pixel.y as i64);
        if !safe.get(x, y) {
            return;
        }
        let depth = camera.depth(point);
        let front = nearest_depth(&own, x, y);
        // A grazing surface changes depth within a pixel: the tolerance grows with the slope.
        let tolerance = 0.006 + depth * 0.004 + 0.01 * (1.0 - normal.dot(view));
        if front > 0.0 && depth - front > tolerance {
            return;
        }
        texel.color = Some(bilinear(photo, pixel));
    });
}

/// The mask shrunk; a thin object keeps what it has.
fn shrunk(mask: &Mask, radius: i32) -> Mask {
    let all = mask.count();
    for r in (0..=radius).rev() {
        let safe = mask.dilated(-r);
        if safe.count() * 3 >= all {
            return safe;
        }
    }
    mask.clone()
}

fn nearest_depth(frame: &DepthFrame, x: i64, y: i64) -> f64 {
    let i = y as usize * frame.window.width as usize + x as usize;
    frame.depth.get(i).map_or(0.0, |d| f64::from(*d))
}

fn bilinear(photo: &RgbImage, p: DVec2) -> [f32; 3] {
    let (w, h) = (photo.width() as i64, photo.height() as i64);
    let (x, y) = (p.x - 0.5, p.y - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = ((x - x0) as f32, (y - y0) as f32);
    let at = |dx: i64, dy: i64| {
        photo.get_pixel((x0 as i64 + dx).clamp(0, w - 1) as u32, (y0 as i64 + dy).clamp(0, h - 1) as u32).0
    };
    let (a, b, c, d) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1));
    std::array::from_fn(|k| {
        let top = f32::from(a[k]) * (1.0 - fx) + f32::from(b[k]) * fx;
        let bottom = f32::from(c[k]) * (1.0 - fx) + f32::from(d[k]) * fx;
        top * (1.0 - fy) + bottom * fy
    })
}

fn slot_medians(mesh: &Mesh, texels: &[Texel]) -> Vec<SlotColour> {
    (0..mesh.materials.len())
        .map(|slot| {
            let mut channels: [Vec<u8>; 3] = Default::default();
            for color in texels.iter().filter(|t| t.slot == slot).filter_map(|t| t.color) {
                for (channel, v) in channels.iter_mut().zip(color) {
                    channel.push(byte(v));
                }
            }
            let pixels = channels[0].len();
            let own = mesh.materials[slot].base_color;
            let rgb = if pixels == 0 {
                [0, 1, 2].map(|k| crate::srgb::tables().encode(own[k]))
            } else {
                channels.map(|mut c| {
                    let middle = c.len() / 2;
                    *c.select_nth_unstable(middle).1
                })
            };
            SlotColour { slot: mesh.materials[slot].name.clone(), rgb, pixels }
        })
        .collect()
}

/// Fills texels that were not observed.
fn complete(texels: &mut [Texel], mesh: &Mesh, colors: &[SlotColour]) {
    let Some(bounds) = mesh.bounds() else { return };
    let diagonal = bounds.size().length().max(1e-6);
    let mirrored = mirror_index(texels, diagonal);
    let samples: Vec<Vec<(Vec3, [f32; 3])>> = (0..mesh.materials.len()).map(|slot| sample(texels, slot)).collect();
    let reach = (REACH * diagonal) as f32;
    let fills: Vec<Option<[f32; 3]>> = texels
        .par_iter()
        .map(|texel| {
            if texel.color.is_some() {
                return None;
            }
            if let Some(color) = from_mirror(texel, &mirrored, diagonal) {
                return Some(color);
            }
            let own = colors[texel.slot].rgb.map(f32::from);
            Some(smooth(texel.point, &samples[texel.slot], own, reach))
        })
        .collect();
    for (texel, fill) in texels.iter_mut().zip(fills) {
        if let Some(color) = fill {
            texel.color = Some(color);
        }
    }
}

/// Observed texels in cells of a fine grid, by (slot, cell).
type Cells = BTreeMap<(usize, [i32; 3]), Vec<(Vec3, Vec3, [f32; 3])>>;

fn cell_of(p: Vec3, diagonal: f64) -> [i32; 3] {
    let size = (diagonal / 90.0) as f32;
    (p / size).floor().to_array().map(|v| v as i32)
}

fn mirror_index(texels: &[Texel], diagonal: f64) -> Cells {
    let mut cells = Cells::new();
    for texel in texels {
        if let Some(color) = texel.color {
            let cell = cells.entry((texel.slot, cell_of(texel.point, diagonal))).or_default();
            if cell.len() < 8 {
                cell.push((texel.point, texel.normal, color));
            }
        }
    }
    cells
}

fn from_mirror(texel: &Texel, cells: &Cells, diagonal: f64) -> Option<[f32; 3]> {
    let flip = Vec3::new(-1.0, 1.0, 1.0);
    let (point, normal) = (texel.point * flip, texel.normal * flip);
    let [cx, cy, cz] = cell_of(point, diagonal);
    let mut best: Option<(f32, [f32; 3])> = None;
    for dx in -1..=1 {
        for dy in -1..=1 {
            for dz in -1..=1 {
                for (p, n, color) in cells.get(&(texel.slot, [cx + dx, cy + dy, cz + dz])).into_iter().flatten() {
                    let distance = p.distance_squared(point);
                    if n.dot(normal) > 0.8 && best.is_none_or(|(d, _)| distance < d) {
                        best = Some((distance, *color));
                    }
                }
            }
        }
    }
    best.map(|(_, color)| color)
}

/// An even choice of a slot's observed texels.
fn sample(texels: &[Texel], slot: usize) -> Vec<(Vec3, [f32; 3])> {
    let seen: Vec<_> = texels.iter().filter(|t| t.slot == slot).filter_map(|t| Some((t.point, t.color?))).collect();
    let step = (seen.len() / SAMPLES_PER_SLOT).max(1);
    seen.into_iter().step_by(step).collect()
}

/// Weighted mean of observed colours nearby; far from all of them it settles at the slot's median.
fn smooth(point: Vec3, samples: &[(Vec3, [f32; 3])], own: [f32; 3], reach: f32) -> [f32; 3] {
    let mut sum = own.map(|c| c * 0.05);
    let mut weight = 0.05;
    for (p, color) in samples {
        let w = (-p.distance_squared(point) / (2.0 * reach * reach)).exp();
        for (s, c) in sum.iter_mut().zip(color) {
            *s += c * w;
        }
        weight += w;
    }
    sum.map(|s| s / weight)
}

/// Grows the charts' border colours outwards, so that filtering does not pull in what lies between charts.
fn pad(texture: &mut RgbaImage, covered: &mut Vec<bool>, side: usize) {
    for _ in 0..PADDING {
        let mut grown = Vec::new();
        for at in 0..covered.len() {
            if covered[at] {
                continue;
            }
            let (x, y) = (at % side, at / side);
            let mut sum = [0_u32; 3];
            let mut n = 0;
            for (nx, ny) in [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)] {
                if nx < side && ny < side && covered[ny * side + nx] {
                    let p = texture.get_pixel(nx as u32, ny as u32).0;
                    for (s, v) in sum.iter_mut().zip(p) {
                        *s += u32::from(v);
                    }
                    n += 1;
                }
            }
            if n > 0 {
                grown.push((at, sum.map(|s| (s / n) as u8)));
            }
        }
        for (at, c) in grown {
            texture.put_pixel((at % side) as u32, (at / side) as u32, Rgba([c[0], c[1], c[2], 255]));
            covered[at] = true;
        }
    }
    for (at, on) in covered.iter().enumerate() {
        if !on {
            texture.put_pixel((at % side) as u32, (at / side) as u32, Rgba([128, 128, 128, 255]));
        }
    }
}
