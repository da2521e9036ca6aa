//! How far an outline reaches in evenly spread directions: the support function of a silhouette, without drawing it.
//!
//! The joint solve compares thousands of poses; the outermost points of the convex parts are a few hundred numbers.

use harmony_scene::{Camera, PixelBox, Pose, Vec2, Vec3};

use super::contour::{Contour, DIRECTIONS, direction};
use super::cut_by_border;
use super::proxy::Proxy;
use super::raster::NEAR;
use crate::noise::Noise;
use crate::{Item, PartialScene, Shape};

/// Edges of an object that the image's border cuts, at most.
const MAX_EDGES: usize = 2000;

/// The reach of a mask in each direction, and what is needed to compare a pose with it.
#[derive(Debug, Clone)]
pub(crate) struct Outline {
    /// Pixels, and whether the mask ends there by itself.
    reach: [(f64, bool); DIRECTIONS],
    /// One sigma, pixels.
    pub(crate) sigma: f64,
    /// Edges of the mesh, of an object that the image's border cuts: what of them is in the image makes its outline there.
    edges: Vec<[Vec3; 2]>,
    /// Where the outline counts: the image on the sides where its border cuts the mask, no limit on the others.
    within: PixelBox,
}

impl Outline {
    pub(crate) fn new(
        scene: &PartialScene,
        item: &Item,
        contour: &Contour,
        mask_box: &PixelBox,
        noise: &Noise,
    ) -> Self {
        let image = scene.camera.size;
        let cut = cut_by_border(mask_box, image);
        let far = 1e6;
        let side = |k: usize, own: f64, none: f64| if cut[k] { own } else { none };
        let within = PixelBox {
            x0: side(0, 0.0, -far),
            y0: side(1, 0.0, -far),
            x1: side(2, f64::from(image.width), far),
            y1: side(3, f64::from(image.height), far),
        };
        let hidden = if item.traits.heavily_occluded { noise.outline_hidden } else { 1.0 };
        let extent = mask_box.width().max(mask_box.height());
        let sigma =
            (noise.outline_px * f64::from(image.width) / 1000.0).hypot(noise.outline_relative * extent) * hidden;
        let is_cut = cut.contains(&true);
        Self {
            reach: std::array::from_fn(|k| contour.reach(direction(k))),
            sigma,
            edges: if is_cut { edges_of(item.shape.proxy()) } else { Vec::new() },
            within,
        }
    }

    /// How far a posed shape reaches in each direction, pixels. Of an object that the border cuts, what is beyond it says
    /// nothing about where the mask should end by itself.
    pub(crate) fn reach_of(&self, camera: &Camera, shape: &Shape, pose: &Pose) -> [f64; DIRECTIONS] {
        let linear = camera.rotation * pose.linear();
        let offset = camera.to_camera(pose.position);
        let k = camera.intrinsics;
        let pixel = |c: Vec3| Vec2::new(k.fx * c.x / c.z + k.cx, k.fy * c.y / c.z + k.cy);
        let directions: [Vec2; DIRECTIONS] = std::array::from_fn(direction);
        let mut far = [f64::NEG_INFINITY; DIRECTIONS];
        let mut inside = far;
        let extend = |far: &mut [f64; DIRECTIONS], p: Vec2| {
            for (far, d) in far.iter_mut().zip(&directions) {
                *far = far.max(p.dot(*d));
            }
        };
        for c in shape.extremes().iter().map(|p| linear * *p + offset).filter(|c| c.z >= NEAR) {
            extend(&mut far, pixel(c));
        }
        for [p, q] in &self.edges {
            let (p, q) = (linear * *p + offset, linear * *q + offset);
            if p.z >= NEAR
                && q.z >= NEAR
                && let Some(ends) = clipped(pixel(p), pixel(q), &self.within)
            {
                for end in ends {
                    extend(&mut inside, end);
                }
            }
        }
        if !self.edges.is_empty() {
            for (i, far) in far.iter_mut().enumerate() {
                if self.reach[i].1 {
                    *far = inside[i];
                }
            }
        }
        far
    }

    /// Errors of a posed shape's reach, sigmas; one for each direction. Where the mask is cut the outline may go on, but
    /// must get there.
    pub(crate) fn residuals(&self, camera: &Camera, shape: &Shape, pose: &Pose) -> [f64; DIRECTIONS] {
        let far = self.reach_of(camera, shape, pose);
        std::array::from_fn(|i| {
            let (reach, free) = self.reach[i];
            let off = if reach.is_finite() && far[i].is_finite() { (far[i] - reach) / self.sigma } else { 0.0 };
            if free { off } else { off.min(0.0) }
        })
    }

    /// Box of a posed shape's outline, image pixels; `None` where it is not in view.
    pub(crate) fn box_of(&self, camera: &Camera, shape: &Shape, pose: &Pose) -> Option<PixelBox> {
        let far = self.reach_of(camera, shape, pose);
        let quarter = DIRECTIONS / 4;
        let b = PixelBox { x0: -far[2 * quarter], y0: -far[3 * quarter], x1: far[0], y1: far[quarter] };
        [b.x0, b.y0, b.x1, b.y1].iter().all(|v| v.is_finite()).then_some(b)
    }
}

/// The edges of a form, at most [`MAX_EDGES`] of them.
fn edges_of(proxy: &Proxy) -> Vec<[Vec3; 2]> {
    let at = |i: u32| proxy.points[i as usize].as_dvec3();
    let mut edges: Vec<[u32; 2]> = proxy
        .triangles
        .iter()
        .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let step = edges.len().div_ceil(MAX_EDGES).max(1);
    edges.into_iter().step_by(step).map(|[a, b]| [at(a), at(b)]).collect()
}

/// The part of a segment that is inside of a box.
fn clipped(a: Vec2, b: Vec2, within: &PixelBox) -> Option<[Vec2; 2]> {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    let sides = [(Vec2::X, -within.x0), (Vec2::Y, -within.y0), (Vec2::NEG_X, within.x1), (Vec2::NEG_Y, within.y1)];
    for (normal, limit) in sides {
        let (da, db) = (normal.dot(a) + limit, normal.dot(b) + limit);
        match (da >= 0.0, db >= 0.0) {
            (true, true) => {}
            (false, false) => return None,
            (true, false) => to = to.min(da / (da - db)),
            (false, true) => from = from.max(da / (da - db)),
        }
    }
    (from <= to).then(|| [a.lerp(b, from), a.lerp(b, to)])
}
