//! The window in which one object is compared with its mask and the point map.
//!
//! A crop of the camera about the mask, at a resolution of its own, holds per pixel: mask, whether another object's
//! mask could hide this one, the map's planar depth, and the depth of what is placed. A pose is drawn into it and
//! compared: uncovered, beside and hidden areas over the length of the mask's edge (so that they are widths, image
//! pixels), and relative depths in sigmas. Image pixels are those of the scene's camera; window pixels are scaled from
//! them. It holds for the scene that it was made in: after others have moved a new one is needed.

use std::sync::Arc;

use harmony_geometry::robust_mean_scalar;
use harmony_mesh::Bounds;
use harmony_scene::{Camera, ImageSize, Intrinsics, Mask, ObjectId, PixelBox, Pose, Support, Vec2, Vec3};

use super::contour::Contour;
use super::outline::Outline;
use super::proxy::Proxy;
use super::raster::{NEAR, Span, rasterise, with_scratch};
use crate::scene::attachment::hang_of;
use crate::scene::shape::corners;
use crate::{Item, PartialScene, Placed, PlacementSettings, Shape};

/// Fewest pixels with a depth in the point map that say something about an object's own.
const MIN_DEPTHS: usize = 12;

/// Sigmas at which another surface was met.
const OTHER_SURFACE: f32 = 10.0;

/// Mask margin around the mask's box, fraction of its size on each side.
const PADDING: f64 = 0.36;

/// Window pixels per image pixel, at most.
const MAX_ZOOM: f64 = 4.0;

/// Whether the pixel of another object could hide this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Other {
    /// No other object is seen here, or one that cannot hide this one.
    None,
    /// An object that may be nearer and is not placed yet.
    MayHide,
    /// Another object: the point map decides, if there is one.
    AskDepth,
}

/// An object's mask seen through a crop of the camera, with everything that decides what could be visible.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    /// The crop, scaled so that the window has the wanted number of pixels.
    camera: Camera,
    /// The part of the image it shows, image pixels.
    region: PixelBox,
    /// Window pixels per image pixel.
    zoom: f64,
    mask: Vec<bool>,
    /// Pixels of the mask that the mask of what stands on it has, too: to be hidden there is no fault.
    shared: Vec<bool>,
    mask_count: f64,
    /// Pixels along the mask's edge.
    edge_count: f64,
    /// Pixels of the mask of which the map has a depth.
    depth_count: usize,
    others: Vec<Other>,
    /// Planar depth of the point map, NaN where there is none.
    reference: Vec<f32>,
    /// Planar depth of what is placed, 0 where nothing is.
    scene: Vec<f32>,
    /// The same without what is see-through, where something is, and without what is under a cloth: what is behind glass may be
    /// seen or not, so that neither is held against a pose.
    opaque: Option<Vec<f32>>,
    /// Two surfaces closer than this along the view do not hide each other, metres.
    hiding: f32,
    /// Robust box of the mask, image pixels.
    pub(crate) mask_box: PixelBox,
    /// Free sides of the mask: left, top, right, bottom.
    pub(crate) free: [bool; 4],
    /// The mask's outline.
    pub(crate) contour: Contour,
    /// How far it reaches.
    pub(crate) outline: Outline,
    size: ImageSize,
}

/// How a pose agrees with mask and point map.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Match {
    /// IoU where both could be visible.
    pub(crate) iou: f64,
    /// IoU of mask and what would be visible in the partial scene, nothing excused but unplaced neighbours and pixels
    /// that are in the mask of what stands on it, too.
    pub(crate) strict_iou: f64,
    /// Share of the mask that the silhouette covers and nothing placed hides.
    pub(crate) covered: f64,
    /// Area of the silhouette beyond the mask over the length of the mask's edge, image pixels.
    pub(crate) beside_px: f64,
    /// Area of the mask that the silhouette leaves uncovered, in the same measure.
    pub(crate) missed_px: f64,
    /// Area of the silhouette that something placed should hide, in the same measure.
    pub(crate) hidden_px: f64,
    /// Mean of `ln(depth / map's depth)` over the mask, absolute, in units of one sigma at a pixel and soft beyond a few of them;
    /// what is not covered counts as another surface. `None` where the map has no depth.
    pub(crate) depth: Option<f64>,
}

impl Window {
    /// Prepares the window in which an item is compared with the photo; `skip` is its number where it is placed already,
    /// `waiting` are items that are not placed yet. `None` where its mask is empty.
    pub(crate) fn new(
        scene: &PartialScene,
        item: &Item,
        skip: Option<usize>,
        waiting: &[Arc<Item>],
        settings: &PlacementSettings,
    ) -> Option<Self> {
        let neighbours = super::neighbours(scene, item, waiting, skip);
        let (image, mask, noise) = (scene.camera.size, &item.mask, &settings.noise);
        let mask_box = clean_box(mask)?;
        let region = padded(&mask_box, image);
        let zoom = (f64::from(settings.window_px) / region.width().max(region.height())).min(MAX_ZOOM);
        let size = ImageSize::new(
            ((region.width() * zoom).round() as u32).max(1),
            ((region.height() * zoom).round() as u32).max(1),
        );
        let k = scene.camera.intrinsics;
        let camera = Camera {
            size,
            intrinsics: Intrinsics {
                fx: k.fx * zoom,
                fy: k.fy * zoom,
                cx: (k.cx - region.x0) * zoom,
                cy: (k.cy - region.y0) * zoom,
            },
            ..scene.camera
        };
        let contour = Contour::new(scene, item, &neighbours, settings);
        let n = size.pixels();
        let mut window = Self {
            camera,
            region,
            zoom,
            mask: Vec::with_capacity(n),
            shared: Vec::with_capacity(n),
            mask_count: 0.0,
            edge_count: 0.0,
            depth_count: 0,
            others: Vec::with_capacity(n),
            reference: Vec::with_capacity(n),
            scene: vec![0.0; n],
            opaque: None,
            hiding: noise.hiding_m as f32,
            mask_box,
            free: contour.free_sides(),
            outline: Outline::new(scene, item, &contour, &mask_box, noise),
            contour,
            size,
        };
        let near: Vec<super::Neighbour> = neighbours
            .iter()
            .filter(|n| n.mask.bounds().is_some_and(|b| b.intersection(&region).area() > 0.0))
            .copied()
            .collect();
        let stands = |p: &&Placed| matches!(&p.support, Support::Object { id } if *id == item.id);
        let guests: Vec<&Mask> = scene.placed.iter().filter(stands).map(|p| &*p.item.mask).collect();
        for y in 0..size.height {
            for x in 0..size.width {
                let at = Vec2::new(region.x0 + (f64::from(x) + 0.5) / zoom, region.y0 + (f64::from(y) + 0.5) / zoom);
                let (u, v) = (at.x as i64, at.y as i64);
                let on = mask.get(u, v);
                window.mask.push(on);
                window.shared.push(on && guests.iter().any(|mask| mask.get(u, v)));
                window.mask_count += f64::from(u8::from(on));
                window.others.push(if near.iter().any(|n| n.may_hide && !n.placed && n.mask.get(u, v)) {
                    Other::MayHide
                } else if near.iter().any(|n| n.mask.get(u, v)) {
                    Other::AskDepth
                } else {
                    Other::None
                });
                let depth = if settings.point_map { scene.depth_at(u, v) } else { None };
                window.depth_count += usize::from(on && depth.is_some());
                window.reference.push(depth.map_or(f32::NAN, |z| z as f32));
            }
        }
        if window.mask_count < 1.0 {
            return None;
        }
        window.edge_count = edge_count(&window.mask, size.width as usize);
        // Cloth lies on what carries it, however the two shapes run into one another.
        let under = item.relations.on_top_of.as_ref().filter(|_| hang_of(item).is_some());
        window.draw_scene(scene, skip, under);
        Some(window)
    }

    /// Draws what is placed; `under` hides nothing of what is compared.
    fn draw_scene(&mut self, scene: &PartialScene, skip: Option<usize>, under: Option<&ObjectId>) {
        let size = self.size;
        let mut depth = std::mem::take(&mut self.scene);
        let whole = PixelBox { x0: 0.0, y0: 0.0, x1: f64::from(size.width), y1: f64::from(size.height) };
        // What stands out of the walls hides what is behind it, too.
        for block in &scene.room.shape.blocks {
            let form = Proxy::boxed(block.min.as_vec3(), block.max.as_vec3());
            rasterise(&self.camera, &form, &Pose::new(Vec3::ZERO, 0.0, 1.0), &mut depth);
        }
        for (i, placed) in scene.placed.iter().enumerate() {
            if Some(i) != skip && may_be_seen(&self.camera, &placed.item.shape.bounds(), &placed.pose, &whole) {
                let shape = &placed.item.shape;
                let is_under = under == Some(&placed.item.id);
                let opaque = match (shape.opaque(), &mut self.opaque) {
                    (None, None) if !is_under => None,
                    (_, known) => Some(known.get_or_insert_with(|| depth.clone())),
                };
                if let Some(opaque) = opaque.filter(|_| !is_under) {
                    rasterise(&self.camera, shape.opaque().unwrap_or(shape.proxy()), &placed.pose, opaque);
                }
                rasterise(&self.camera, shape.proxy(), &placed.pose, &mut depth);
            }
        }
        self.scene = depth;
    }

    /// Area of the whole mask over the length of its edge, image pixels.
    pub(crate) fn whole_px(&self) -> f64 {
        self.mask_count / (self.edge_count * self.zoom)
    }

    /// Compares a pose with mask and point map; `depth_scale` is the relative difference of depths beyond which another
    /// surface is met.
    pub(crate) fn compare(&self, shape: &Shape, pose: &Pose, depth_scale: f64) -> Match {
        with_scratch(|scratch| {
            let span = scratch.draw_alone(&self.camera, shape.proxy(), pose);
            self.agreement(&scratch.depth, span, depth_scale as f32)
        })
    }

    /// Agreement of drawn depths with mask and point map; nothing is drawn outside of the span.
    fn agreement(&self, depth: &[f32], span: Span, depth_scale: f32) -> Match {
        let (mut both, mut strict_both, mut beside) = (0_u32, 0_u32, 0_u32);
        let (mut compared, mut soft) = (0_u32, 0.0_f32);
        for (i, z) in span.rows(self.size.width as usize).flat_map(|row| row.clone().zip(&depth[row])) {
            let z = *z;
            if z <= 0.0 {
                continue;
            }
            let s = self.scene[i];
            if self.mask[i] {
                both += 1;
                let hides = self.opaque.as_ref().map_or(s, |o| o[i]);
                let behind = hides > 0.0 && z > hides + self.hiding;
                strict_both += u32::from(!behind || self.shared[i]);
                let r = self.reference[i];
                if r.is_finite() {
                    let a = 2.0 * (z - r).abs() / ((z + r) * depth_scale);
                    soft += a / (1.0 + a / OTHER_SURFACE);
                    compared += 1;
                }
                continue;
            }
            // Not seen in the photo: excused where something nearer may stand before it.
            let nearly_behind = s > 0.0 && z > s - self.hiding;
            let hidden = nearly_behind
                || match self.others[i] {
                    Other::None => false,
                    Other::MayHide => {
                        let r = self.reference[i];
                        !r.is_finite() || r < z - self.hiding
                    }
                    Other::AskDepth => self.reference[i] < z - self.hiding,
                };
            beside += u32::from(!hidden);
        }
        let union = self.mask_count + f64::from(beside);
        let (both, strict_both) = (f64::from(both), f64::from(strict_both));
        let edge = self.edge_count * self.zoom;
        Match {
            iou: both / union,
            strict_iou: strict_both / union,
            covered: strict_both / self.mask_count,
            beside_px: f64::from(beside) / edge,
            missed_px: (self.mask_count - both) / edge,
            hidden_px: (both - strict_both) / edge,
            depth: (self.depth_count >= MIN_DEPTHS).then(|| {
                // Foliage and slats cover half of what they seem to.
                let missed = self.depth_count.saturating_sub(2 * compared as usize);
                let all = compared as usize + missed;
                (f64::from(soft) + missed as f64 * f64::from(OTHER_SURFACE)) / all as f64
            }),
        }
    }

    /// Median absolute difference of an object's depths to the point map's over mask and silhouette, metres.
    pub(crate) fn depth_residual(&self, shape: &Shape, pose: &Pose) -> Option<f64> {
        let mut off: Vec<f64> = self.both_depths(shape, pose).into_iter().map(|(z, r)| (z - r).abs()).collect();
        if off.len() < MIN_DEPTHS { None } else { Some(crate::stats::median(&mut off)) }
    }

    /// Depths of an object and of the map where both are seen and nothing placed hides the object.
    fn both_depths(&self, shape: &Shape, pose: &Pose) -> Vec<(f64, f64)> {
        with_scratch(|scratch| {
            let span = scratch.draw_alone(&self.camera, shape.proxy(), pose);
            let depth = &scratch.depth;
            span.rows(self.size.width as usize)
                .flatten()
                .filter(|i| self.mask[*i] && depth[*i] > 0.0 && self.reference[*i].is_finite())
                .filter(|i| !(self.scene[*i] > 0.0 && depth[*i] > self.scene[*i] + self.hiding))
                .map(|i| (f64::from(depth[i]), f64::from(self.reference[i])))
                .collect()
        })
    }

    /// Depths along the view of the reference and of the rendered front surface, where both are seen: the points
    /// of the paper's `c_ref` and `c_ren`. `None` where there are too few of either.
    pub(crate) fn front_depths(&self, shape: &Shape, pose: &Pose) -> Option<(Vec<f64>, Vec<f64>)> {
        let reference: Vec<f64> = self.masked().filter_map(|i| finite(self.reference[i])).collect();
        let rendered: Vec<f64> = with_scratch(|scratch| {
            let span = scratch.draw_alone(&self.camera, shape.proxy(), pose);
            let depth = &scratch.depth;
            span.rows(self.size.width as usize)
                .flatten()
                .map(|i| (depth[i], self.scene[i]))
                .filter(|(z, s)| *z > 0.0 && !(*s > 0.0 && *z > *s + self.hiding))
                .map(|(z, _)| f64::from(z))
                .collect()
        });
        (reference.len() >= MIN_DEPTHS && rendered.len() >= MIN_DEPTHS).then_some((reference, rendered))
    }

    /// Depth of the point map over that of the object, where both are seen at one pixel; `None` where that is at too few.
    pub(crate) fn depth_ratio(&self, shape: &Shape, pose: &Pose) -> Option<f64> {
        let logs: Vec<f64> = self.both_depths(shape, pose).into_iter().map(|(z, r)| (r / z).ln()).collect();
        (logs.len() >= MIN_DEPTHS).then(|| robust_mean_scalar(&logs)).flatten().map(f64::exp)
    }

    fn masked(&self) -> impl Iterator<Item = usize> {
        (0..self.mask.len()).filter(|i| self.mask[*i])
    }

    fn centre_of(&self, i: usize) -> Vec2 {
        let w = self.size.width;
        Vec2::new(f64::from(i as u32 % w) + 0.5, f64::from(i as u32 / w) + 0.5)
    }

    /// Positions (image pixels) of the window's samples within the mask.
    pub(crate) fn masked_pixels(&self) -> Vec<Vec2> {
        let corner = Vec2::new(self.region.x0, self.region.y0);
        self.masked().map(|i| corner + self.centre_of(i) / self.zoom).collect()
    }

    /// Reference points (room frame) within the mask.
    pub(crate) fn masked_points(&self) -> Vec<Vec3> {
        self.masked()
            .filter_map(|i| Some(self.camera.unproject(self.centre_of(i), finite(self.reference[i])?)))
            .collect()
    }
}

fn finite(z: f32) -> Option<f64> {
    z.is_finite().then_some(f64::from(z))
}

/// Pixels of a mask with a neighbour outside of it, at least one.
fn edge_count(mask: &[bool], width: usize) -> f64 {
    let on = |i: usize| mask[i];
    let edge = (0..mask.len()).filter(|i| {
        let (x, i) = (i % width, *i);
        let inside = x > 0 && x + 1 < width && i >= width && i + width < mask.len();
        on(i) && !(inside && on(i - 1) && on(i + 1) && on(i - width) && on(i + width))
    });
    (edge.count() as f64).max(1.0)
}

/// Whether a posed box can be seen in a window of an image: not when all its corners are before the camera and it is beside
/// the window.
pub fn may_be_seen(camera: &Camera, bounds: &Bounds, pose: &Pose, window: &PixelBox) -> bool {
    let corners = corners(bounds).map(|p| camera.to_camera(pose.point(p)));
    if corners.iter().any(|c| c.z <= 2.0 * NEAR) {
        return true;
    }
    let k = camera.intrinsics;
    let pixels = corners.map(|c| Vec2::new(k.fx * c.x / c.z + k.cx, k.fy * c.y / c.z + k.cy));
    let (low, high) = pixels.iter().fold((Vec2::MAX, Vec2::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
    // Two pixels cover rounding and the samples beside a pixel's centre.
    let w = window;
    high.x >= w.x0 - 2.0 && high.y >= w.y0 - 2.0 && low.x <= w.x1 + 2.0 && low.y <= w.y1 + 2.0
}

/// The mask's box without stray specks: the tightest box of rows and columns that hold all but 0.2 % of it.
pub(super) fn clean_box(mask: &Mask) -> Option<PixelBox> {
    let size = mask.size();
    let (w, h) = (size.width as usize, size.height as usize);
    let (mut columns, mut rows) = (vec![0_usize; w], vec![0_usize; h]);
    let mut count = 0;
    let b = mask.bounds()?;
    let (x0, x1) = (b.x0 as usize, b.x1 as usize);
    for (row, bits) in rows.iter_mut().zip(mask.bits().chunks_exact(w)) {
        for (column, on) in columns[x0..x1].iter_mut().zip(&bits[x0..x1]) {
            *column += usize::from(*on);
            *row += usize::from(*on);
        }
        count += *row;
    }
    let range = |counts: &[usize]| {
        let limit = count / 1000;
        let end = |it: &mut dyn Iterator<Item = (usize, &usize)>| {
            let mut sum = 0;
            for (i, c) in it {
                sum += c;
                if sum > limit {
                    return Some(i);
                }
            }
            None
        };
        Some((end(&mut counts.iter().enumerate())?, end(&mut counts.iter().enumerate().rev())? + 1))
    };
    let ((x0, x1), (y0, y1)) = (range(&columns)?, range(&rows)?);
    Some(PixelBox { x0: x0 as f64, y0: y0 as f64, x1: x1 as f64, y1: y1 as f64 })
}

/// A box grown for the window: a fraction of its larger side, at least a few pixels, cut to the image.
fn padded(b: &PixelBox, image: ImageSize) -> PixelBox {
    let margin = PADDING * b.width().max(b.height()) + 6.0;
    PixelBox {
        x0: (b.x0 - margin).floor(),
        y0: (b.y0 - margin).floor(),
        x1: (b.x1 + margin).ceil(),
        y1: (b.y1 + margin).ceil(),
    }
    .clamped(image)
}

#[cfg(test)]
mod tests {
    use super::super::cut_by_border;
    use super::*;
    use crate::RoomPoints;
    use crate::testing::{boxed, empty_room};

    #[test]
    fn what_is_behind_glass_may_be_seen_or_not() {
        let scene = crate::testing::empty_room();
        let at = Vec3::new(2.0, 0.0, 1.5);
        let chair = crate::testing::boxed(&scene, Vec3::new(0.5, 0.9, 0.5), at, 0.0);
        let before = Vec3::new(2.05, 0.0, 2.6);
        let pane = crate::testing::boxed(&scene, Vec3::new(1.2, 1.2, 0.02), before, 0.0);
        let placed = |transmission: f32| {
            let mut mesh = (**pane.shape.mesh()).clone();
            mesh.materials.iter_mut().for_each(|m| m.transmission = transmission);
            let item = crate::Item {
                id: harmony_scene::ObjectId::numbered("pane", 1),
                shape: std::sync::Arc::new(Shape::new(std::sync::Arc::new(mesh), Vec::new())),
                ..pane.clone()
            };
            let mut scene = scene.clone();
            let evidence = crate::Evidence::default();
            let (pose, support) = (Pose::new(before, 0.0, 1.0), harmony_scene::Support::Floor);
            scene.placed.push(crate::Placed { item: std::sync::Arc::new(item), pose, support, evidence });
            scene
        };
        let compare = |scene: &PartialScene, mask: &Mask| {
            let item = crate::Item { mask: mask.clone().into(), ..chair.clone() };
            let window = Window::new(scene, &item, None, &[], &PlacementSettings::default()).unwrap();
            window.compare(&chair.shape, &Pose::new(at, 0.0, 1.0), 0.03)
        };
        // Seen as if nothing were there: right behind glass, wrong behind wood.
        let (glass, wood) = (placed(1.0), placed(0.0));
        assert!(compare(&glass, &chair.mask).strict_iou > 0.9);
        assert!(compare(&wood, &chair.mask).strict_iou < 0.3);
        // Seen above the pane alone: right behind both.
        let top = chair.mask.bounds().unwrap();
        let half = Mask::from_fn(chair.mask.size(), |x, y| {
            chair.mask.get(i64::from(x), i64::from(y)) && f64::from(y) < top.y0 + 0.1 * top.height()
        });
        assert!((compare(&glass, &half).iou - compare(&wood, &half).iou).abs() < 1e-9);
    }

    #[test]
    fn what_a_throw_lies_on_does_not_hide_it() {
        use crate::testing::{BACK_Z, add, armchair, throw_over_an_edge};
        let mut scene = empty_room();
        let chair = Arc::new(armchair());
        add(&mut scene, "armchair_01", chair.extent(), Vec3::new(1.2, 0.0, 1.5), |p| {
            Arc::make_mut(&mut p.item).shape = Arc::clone(&chair);
        });
        let host = scene.placed[0].item.id.clone();
        // Its front leaf is stuck in the upholstery.
        let at = scene.placed[0].pose.point(Vec3::new(0.0, 0.98 - 0.586, BACK_Z));
        let [throw, before] = throw_over_an_edge();
        let mut item = boxed(&scene, throw.extent(), at, 0.0);
        item.mask = crate::testing::seen(&scene, &before, &Pose::new(at, 0.0, 1.0)).into();
        item.shape = Arc::new(throw);
        (item.traits.soft, item.traits.drapes) = (true, true);
        let covered = |item: &Item| {
            let window = Window::new(&scene, item, None, &[], &PlacementSettings::default()).unwrap();
            window.compare(&item.shape, &Pose::new(at, 0.0, 1.0), 0.1).covered
        };
        assert!(covered(&item) < 0.7, "{}", covered(&item));
        item.relations.on_top_of = Some(host);
        assert!(covered(&item) > 0.95, "{}", covered(&item));
        // A box on it is hidden by it.
        item.traits.drapes = false;
        assert!(covered(&item) < 0.7, "{}", covered(&item));
    }

    #[test]
    fn what_a_chimney_breast_hides_is_hidden() {
        let mut scene = empty_room();
        let at = Vec3::new(1.0, 0.0, 0.4);
        let shelf = boxed(&scene, Vec3::new(0.6, 1.0, 0.3), at, 0.0);
        let settings = PlacementSettings::default();
        let iou = |scene: &PartialScene| {
            let window = Window::new(scene, &shelf, None, &[], &settings).unwrap();
            window.compare(&shelf.shape, &Pose::new(at, 0.0, 1.0), 0.1).strict_iou
        };
        assert!(iou(&scene) > 0.95);
        let (min, max) = (Vec3::new(0.2, 0.0, 0.9), Vec3::new(2.2, 2.5, 1.2));
        scene.room.shape.blocks.push(harmony_scene::Block { kind: "breast".into(), min, max });
        assert!(iou(&scene) < 0.1, "{}", iou(&scene));
    }

    /// A table whose mask holds the vase on it, as masks of different levels may.
    #[test]
    fn what_stands_on_a_table_and_is_in_its_mask_takes_nothing_from_its_agreement() {
        let mut scene = empty_room();
        let at = Vec3::new(2.2, 0.0, 2.5);
        let table = boxed(&scene, Vec3::new(0.8, 0.7, 0.6), at, 0.0);
        let mut vase = boxed(&scene, Vec3::new(0.5, 0.5, 0.3), at + Vec3::Y * 0.5 + Vec3::Z * 0.35, 0.0);
        vase.id = harmony_scene::ObjectId::numbered("vase", 1);
        let settings = PlacementSettings::default();
        let pose = Pose::new(at, 0.0, 1.0);
        let iou = |scene: &PartialScene| {
            let window = Window::new(scene, &table, None, &[], &settings).unwrap();
            window.compare(&table.shape, &pose, 0.1).strict_iou
        };
        assert!(iou(&scene) > 0.95);
        let mut own = vase.clone();
        own.mask = vase.mask.minus(&table.mask).into();
        let before = Pose::new(at + Vec3::Y * 0.5 + Vec3::Z * 0.35, 0.0, 1.0);
        for (item, held) in [(vase, true), (own, false)] {
            let (item, support) = (Arc::new(item), Support::Object { id: table.id.clone() });
            scene.placed = vec![crate::Placed { item, pose: before, support, evidence: crate::Evidence::default() }];
            assert_eq!(iou(&scene) > 0.95, held, "{}", iou(&scene));
        }
    }

    /// A box that the image's lower border cuts: the outline that counts is that of the part in view, which is narrower
    /// than the part below.
    #[test]
    fn an_outline_ends_where_the_image_cuts_its_mask() {
        let scene = empty_room();
        let at = Vec3::new(2.2, 0.0, 3.9);
        let item = boxed(&scene, Vec3::new(0.6, 1.1, 0.6), at, 0.0);
        let window = Window::new(&scene, &item, None, &[], &PlacementSettings::default()).unwrap();
        let pose = Pose::new(at, 0.0, 1.0);
        let cut = window.outline.box_of(&scene.camera, &item.shape, &pose).unwrap();
        let bottom = f64::from(scene.camera.size.height);
        assert!(cut.y1 > bottom + 50.0 && window.free == [true, true, true, false], "{cut:?} {:?}", window.free);
        // The mask's own box is the expectation on the free sides: pixels whose centres are covered.
        let b = item.mask.bounds().unwrap();
        for (mask, outline) in [(b.x0, cut.x0), (b.x1, cut.x1), (b.y0, cut.y0)] {
            assert!((mask - outline).abs() <= 1.0, "{b:?} {cut:?}");
        }
        let residuals = window.outline.residuals(&scene.camera, &item.shape, &pose);
        assert!(residuals.iter().all(|r| r.abs() < 0.5), "{residuals:?}");
        // Nowhere in view, it has no outline.
        let below = Pose::new(at - Vec3::Y * 3.0, 0.0, 1.0);
        assert!(window.outline.box_of(&scene.camera, &item.shape, &below).is_none());
    }

    /// Pictures of sensors and scans have frames of some pixels: a mask that ends there is cut all the same.
    #[test]
    fn a_mask_that_ends_a_little_before_the_border_is_cut_by_it() {
        let image = ImageSize::new(640, 480);
        let cut = |x0: f64, x1: f64| cut_by_border(&PixelBox { x0, y0: 100.0, x1, y1: 200.0 }, image);
        assert_eq!(cut(300.0, 633.0), [false, false, true, false]);
        assert_eq!(cut(7.0, 620.0), [true, false, false, false]);
    }

    /// A long table of which something hides the near half: the depths in its mask are those of its far half.
    #[test]
    fn depths_are_compared_where_both_are_seen() {
        let mut scene = empty_room();
        let at = Vec3::new(2.0, 0.0, 2.5);
        let mut item = boxed(&scene, Vec3::new(0.8, 0.7, 2.4), at, 0.0);
        let pose = Pose::new(at, 0.0, 1.0);
        let size = scene.camera.size;
        let mut depth = vec![0.0; size.pixels()];
        rasterise(&scene.camera, item.shape.proxy(), &pose, &mut depth);
        let pixel =
            |i: usize| Vec2::new(f64::from(i as u32 % size.width) + 0.5, f64::from(i as u32 / size.width) + 0.5);
        let farther = |(i, z): (usize, &f32)| {
            if *z > 0.0 { scene.camera.unproject(pixel(i), 1.05 * f64::from(*z)) } else { Vec3::NAN }
        };
        let xyz = depth.iter().enumerate().map(farther).collect();
        scene.points = Some(RoomPoints {
            kind: harmony_scene::PointMapKind::Relative,
            size,
            xyz,
            confidence: vec![1.0; size.pixels()],
        });
        let whole = item.mask.clone();
        let middle = whole.bounds().unwrap().centre().y as i64;
        item.mask = Mask::from_fn(size, |x, y| i64::from(y) < middle && whole.get(i64::from(x), i64::from(y))).into();
        let window = Window::new(&scene, &item, None, &[], &PlacementSettings::default()).unwrap();
        let ratio = window.depth_ratio(&item.shape, &pose).unwrap();
        assert!((ratio - 1.05).abs() < 0.005, "{ratio}");
        // Of the two sets by themselves the means tell another tale.
        let (reference, rendered) = window.front_depths(&item.shape, &pose).unwrap();
        let apart = robust_mean_scalar(&reference).unwrap() / robust_mean_scalar(&rendered).unwrap();
        assert!(apart > 1.1, "{apart}");
        // Beside its mask nothing is compared.
        let beside = Pose::new(at - Vec3::X * 2.0, 0.0, 1.0);
        assert!(window.depth_ratio(&item.shape, &beside).is_none());
    }
}
