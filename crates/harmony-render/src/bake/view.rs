//! What the photo shows of the mesh.

use glam::{DMat3, DVec2, DVec3, Vec3};
use harmony_mesh::{Group, Mesh};
use harmony_scene::{Camera, Mask, Pose};
use image::RgbImage;
use rayon::prelude::*;

use super::BakeOptions;
use super::plausible::{Seen, edge_distances, smooth, weights};
use super::texels::Texel;
use crate::{Instance, RenderOptions, render_depth_ids};

/// Every so many texels are looked at to know how fine a texture has to be.
const EVERY: usize = 13;
/// Most samples along one side of a texel.
const MAX_SAMPLES: f64 = 4.0;

/// Width of the zone along the mask's border in which made-up colours are mixed in, pixels.
const INNER: i32 = 3;
/// Cosine from which the photo counts fully.
const SQUARELY: f64 = 0.35;
/// Photo pixels a texel, across the direction in which the photo is coarsest: nothing is taken below the first, and all
/// above the second.
const SHARP: [f32; 2] = [0.02, 0.08];
/// Pixels from an edge of the model's own within which the photo counts less, for the model is never exact.
const EDGE: f32 = 2.0;
/// Share that is left right at such an edge.
const AT_EDGE: f32 = 0.4;
/// Weight of a pixel below which its colour is not the slot's.
const PLAUSIBLE: f32 = 0.05;

/// A colour found in the photo.
pub(super) struct Sight {
    /// sRGB, 0 to 255.
    pub color: [f32; 3],
    /// Between normal and view.
    pub cosine: f64,
    /// How far it should count, 0 to 1.
    pub share: f32,
}

/// The mesh posed before the camera, with the photo.
pub(super) struct View<'a> {
    camera: &'a Camera,
    photo: &'a RgbImage,
    pose: Pose,
    linear: DMat3,
    normal_map: DMat3,
    eye: DVec3,
    /// Pixels whose colours are surely the object's.
    safe: Mask,
    /// The same, further and further from the border.
    inner: Vec<Mask>,
    /// Planar depth of the mesh, metres; 0 where it is not.
    depth: Vec<f32>,
    /// Material index plus one.
    slots: Vec<u32>,
    /// Weight of each pixel by its colour and by how near the model's own edges are, 0 to 1.
    trust: Vec<f32>,
    min_cosine: f64,
}

impl<'a> View<'a> {
    /// `None` when photo, mask and camera do not belong together or the pose is degenerate.
    pub fn new(
        mesh: &Mesh,
        pose: &Pose,
        camera: &'a Camera,
        photo: &'a RgbImage,
        visible: &Mask,
        options: &BakeOptions,
        named: &[[f32; 3]],
    ) -> Option<Self> {
        let size = camera.size;
        let linear = pose.linear();
        let sound = linear.determinant().abs() > 1e-12 && linear.is_finite() && pose.position.is_finite();
        if photo.dimensions() != (size.width, size.height) || visible.size() != size || !sound {
            return None;
        }
        // each slot is an instance, so that the ids tell which slot is in front
        let pieces: Vec<Mesh> = mesh
            .groups
            .iter()
            .map(|g| Mesh { groups: vec![Group { material: 0, triangles: g.triangles.clone() }], ..mesh.clone() })
            .collect();
        let instances: Vec<Instance> = pieces
            .iter()
            .zip(&mesh.groups)
            .map(|(piece, g)| Instance::posed(piece, pose, g.material as u32 + 1))
            .collect();
        let frame = render_depth_ids(camera, &instances, &RenderOptions::default());
        if frame.depth.len() != size.pixels() {
            return None;
        }
        let safe = shrunk(visible, options.erode_px.clamp(0, 64));
        let seen = Seen { photo, visible, slots: &frame.ids, depth: &frame.depth, named };
        let trust = if options.trusted { vec![1.0; size.pixels()] } else { trust(&seen) };
        Some(Self {
            inner: (1..=INNER).map(|r| safe.dilated(-r)).collect(),
            safe,
            camera,
            photo,
            pose: *pose,
            linear,
            normal_map: linear.inverse().transpose(),
            eye: camera.centre(),
            depth: frame.depth,
            slots: frame.ids,
            trust,
            min_cosine: options.min_cosine,
        })
    }

    /// What the photo shows of a texel's surface point after reflection; `None` where it is hidden, turned away, or off
    /// the object's pixels.
    pub fn color(&self, texel: &Texel, mirror: [f32; 3]) -> Option<Sight> {
        let flip = Vec3::from_array(mirror);
        let point = self.pose.position + self.linear * (texel.point * flip).as_dvec3();
        let normal = (self.normal_map * (texel.normal * flip).as_dvec3()).try_normalize()?;
        let cosine = normal.dot((self.eye - point).try_normalize()?);
        if cosine < self.min_cosine {
            return None;
        }
        let pixel = self.camera.project(point).filter(|p| self.camera.contains(*p))?;
        let depth = self.camera.depth(point);
        // within a pixel a slanted surface changes depth by this much
        let slope = depth / self.camera.intrinsics.fx * (1.0 - cosine * cosine).max(0.0).sqrt() / cosine;
        let tolerance = (0.003 + 0.0015 * depth + 1.5 * slope).min(0.06);
        let front = self.front(pixel, texel.slot, depth)?;
        let itself = flip == Vec3::ONE;
        // a mirrored point must lie on the surface; the point itself does
        if depth - front > tolerance || (!itself && front - depth > tolerance) {
            return None;
        }
        let steps = texel.steps.map(|s| {
            let next = point + self.linear * (s * flip).as_dvec3();
            self.camera.project(next).map_or(DVec2::ZERO, |p| p - pixel)
        });
        let color = self.filtered(pixel, steps)?;
        let frontal = smooth([self.min_cosine as f32, SQUARELY.max(self.min_cosine + 0.01) as f32], cosine as f32);
        let sharp = smooth(SHARP, coarsest(steps) as f32);
        let inner = self.inner.iter().filter(|m| m.get(pixel.x as i64, pixel.y as i64)).count();
        let inner = (inner as f32 + 1.0) / (INNER as f32 + 1.0);
        let trust = self.trust[pixel.y as usize * self.camera.size.width as usize + pixel.x as usize];
        let share = frontal * sharp * inner * trust;
        (share > PLAUSIBLE).then_some(Sight { color, cosine, share })
    }

    /// Depth of the slot at a pixel: there, or at the neighbour that comes nearest to `depth`.
    fn front(&self, pixel: DVec2, slot: usize, depth: f64) -> Option<f64> {
        let (w, h) = (self.camera.size.width as i64, self.camera.size.height as i64);
        let (x, y) = (pixel.x as i64, pixel.y as i64);
        let at = |x: i64, y: i64| {
            let i = (y * w + x) as usize;
            (self.slots[i] == slot as u32 + 1).then(|| f64::from(self.depth[i]))
        };
        if let Some(z) = at(x, y) {
            return Some(z);
        }
        let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
        near.filter(|(x, y)| *x >= 0 && *y >= 0 && *x < w && *y < h)
            .filter_map(|(x, y)| at(x, y))
            .min_by(|a, b| (a - depth).abs().total_cmp(&(b - depth).abs()))
    }

    /// Mean photo colour over a texel's footprint, of the pixels that are surely the object's.
    fn filtered(&self, pixel: DVec2, [a, b]: [DVec2; 2]) -> Option<[f32; 3]> {
        let (x, y) = (pixel.x as i64, pixel.y as i64);
        if !self.safe.get(x, y) {
            return None;
        }
        let count = |v: DVec2| if v.is_finite() { v.length().round().clamp(1.0, MAX_SAMPLES) } else { 1.0 };
        let (n, m) = (count(a), count(b));
        let (mut sum, mut weight) = ([0.0_f32; 3], 0.0);
        for i in 0..n as u32 {
            for j in 0..m as u32 {
                let offset = a * ((f64::from(i) + 0.5) / n - 0.5) + b * ((f64::from(j) + 0.5) / m - 0.5);
                let p = pixel + if n * m > 1.0 { offset } else { DVec2::ZERO };
                if self.safe.get(p.x.floor() as i64, p.y.floor() as i64) {
                    let c = bilinear(self.photo, p);
                    sum = [sum[0] + c[0], sum[1] + c[1], sum[2] + c[2]];
                    weight += 1.0;
                }
            }
        }
        if weight > 0.0 { Some(sum.map(|s| s / weight)) } else { Some(bilinear(self.photo, pixel)) }
    }

    /// Photo pixels that a texel covers, along a side: what three quarters of the texels that the photo shows stay below.
    pub fn pixels_a_texel(&self, texels: &[Texel]) -> f64 {
        let seen = texels.par_iter().step_by(EVERY).filter_map(|texel| {
            self.color(texel, [1.0; 3])?;
            let point = self.pose.position + self.linear * texel.point.as_dvec3();
            let pixel = self.camera.project(point)?;
            let [a, b] = texel.steps.map(|s| self.camera.project(point + self.linear * s.as_dvec3()));
            Some((a? - pixel).perp_dot(b? - pixel).abs().sqrt())
        });
        let mut seen: Vec<f64> = seen.filter(|s| s.is_finite()).collect();
        if seen.is_empty() {
            return 0.0;
        }
        let at = seen.len() * 3 / 4;
        *seen.select_nth_unstable_by(at, f64::total_cmp).1
    }

    /// Adds the colours of each slot's sure pixels to its channels.
    pub fn collect(&self, channels: &mut [[Vec<u8>; 3]]) {
        let width = self.camera.size.width as usize;
        for (i, slot) in self.slots.iter().enumerate() {
            let Some(own) = (*slot as usize).checked_sub(1).and_then(|s| channels.get_mut(s)) else { continue };
            if self.safe.bits()[i] && self.trust[i] > 0.5 {
                let pixel = self.photo.get_pixel((i % width) as u32, (i / width) as u32).0;
                for (channel, value) in own.iter_mut().zip(pixel) {
                    channel.push(value);
                }
            }
        }
    }
}

/// Plausible colours, less near the model's own edges.
fn trust(seen: &Seen) -> Vec<f32> {
    let away = edge_distances(seen);
    let mut out = weights(seen);
    for (w, d) in out.iter_mut().zip(away) {
        *w *= AT_EDGE + (1.0 - AT_EDGE) * (f32::from(d) / EDGE).min(1.0);
    }
    out
}

/// Length of the shorter axis of a texel's footprint in the image, pixels.
fn coarsest([a, b]: [DVec2; 2]) -> f64 {
    // The smaller singular value of the matrix with these columns.
    let (sum, det) = (a.length_squared() + b.length_squared(), a.perp_dot(b));
    let root = (sum * sum - 4.0 * det * det).max(0.0).sqrt();
    ((sum - root) / 2.0).max(0.0).sqrt()
}

/// The mask shrunk; a thin object keeps what it has.
fn shrunk(mask: &Mask, radius: i32) -> Mask {
    let all = mask.count();
    let fits = (1..=radius).rev().map(|r| mask.dilated(-r)).find(|safe| safe.count() * 3 >= all);
    fits.unwrap_or_else(|| mask.clone())
}

fn bilinear(photo: &RgbImage, p: DVec2) -> [f32; 3] {
    let (w, h) = (i64::from(photo.width()), i64::from(photo.height()));
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
