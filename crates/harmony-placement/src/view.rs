//! The window in which one object is compared with its mask and the point map.

use harmony_mesh::Bounds;
use harmony_scene::{Camera, ImageSize, Intrinsics, Mask, PixelBox, Pose, Vec2, Vec3};

use crate::formulas::front_surface_depth;
use crate::proxy::Proxy;
use crate::raster::{Scratch, Span, rasterise, to_camera, with_scratch};
use crate::shape::corners;
use crate::{PartialScene, RoomPoints, Shape};

/// Two surfaces closer than this along the view hide neither each other, metres.
const HIDING_TOLERANCE: f32 = 0.03;

/// Depth differences beyond this count little more, metres: another surface was hit.
const DEPTH_SOFT_LIMIT: f64 = 0.4;

/// Fewest pixels with a depth in the point map that say something about an object's own.
const FEWEST_DEPTHS: u32 = 4;

/// Mask margin around the mask's box, fraction of its size on each side.
const WINDOW_PADDING: f64 = 0.6;

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
pub(crate) struct View {
    /// The crop, scaled so that the window has the wanted number of pixels.
    camera: Camera,
    /// The camera of the whole image.
    full: Camera,
    /// The part of the image it shows, image pixels.
    region: PixelBox,
    /// Window pixels per image pixel.
    zoom: f64,
    mask: Vec<bool>,
    mask_count: f64,
    others: Vec<Other>,
    /// Planar depth of the point map, NaN where there is none.
    reference: Vec<f32>,
    /// Planar depth of what is placed, 0 where nothing is.
    scene: Vec<f32>,
    /// The same without what is see-through, where something is: what is behind glass may be seen or not, so that neither
    /// is held against a pose.
    opaque: Option<Vec<f32>>,
    /// Robust box of the mask, image pixels.
    pub(crate) mask_box: PixelBox,
    /// Free edges of the mask: left, top, right, bottom.
    pub(crate) free: [bool; 4],
    /// Where an outline counts: the image on the sides where its border cuts the mask, no limit on the others.
    pub(crate) within: PixelBox,
    size: ImageSize,
}

/// How a pose agrees with mask and point map.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Match {
    /// IoU where both could be visible.
    pub(crate) iou: f64,
    /// IoU of mask and what would be visible in the partial scene, nothing excused but unplaced neighbours.
    pub(crate) strict_iou: f64,
    /// See [`View::outline`].
    pub(crate) outline: Option<PixelBox>,
    /// Mean soft depth difference over mask and silhouette, metres; `None` without depth there.
    pub(crate) soft_depth: Option<f64>,
    /// Share of the mask that has depth to compare with.
    pub(crate) depth_share: f64,
}

/// The mask of another object.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Neighbour<'a> {
    /// Where it is seen.
    pub(crate) mask: &'a Mask,
    /// Whether it is not placed yet and may be nearer than the object in question.
    pub(crate) may_hide: bool,
}

/// Whether any neighbour that may hide the object is seen at a pixel.
fn hiding(neighbours: &[Neighbour], x: i64, y: i64) -> bool {
    neighbours.iter().any(|n| n.may_hide && n.mask.get(x, y))
}

impl View {
    /// Prepares the window of a mask. `mask_box` must be the mask's box, not empty.
    pub(crate) fn new(
        scene: &PartialScene,
        skip: Option<usize>,
        mask: &Mask,
        neighbours: &[Neighbour],
        window_px: u32,
    ) -> Option<Self> {
        let image = scene.camera.size;
        let cleaned = clean_box(mask)?;
        let region = padded(&cleaned, image);
        let zoom = (f64::from(window_px) / region.width().max(region.height())).min(4.0);
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
        let n = size.pixels();
        let mut view = Self {
            camera,
            full: scene.camera,
            region,
            zoom,
            mask: Vec::with_capacity(n),
            mask_count: 0.0,
            others: Vec::with_capacity(n),
            reference: Vec::with_capacity(n),
            scene: vec![0.0; n],
            opaque: None,
            mask_box: cleaned,
            free: free_edges(mask, &cleaned, neighbours),
            within: within_border(&cleaned, image),
            size,
        };
        let near: Vec<Neighbour> = neighbours
            .iter()
            .filter(|n| n.mask.bounds().is_some_and(|b| b.intersection(&region).area() > 0.0))
            .copied()
            .collect();
        for y in 0..size.height {
            for x in 0..size.width {
                let px = region.x0 + (f64::from(x) + 0.5) / zoom;
                let py = region.y0 + (f64::from(y) + 0.5) / zoom;
                let (ix, iy) = (px as i64, py as i64);
                let on = mask.get(ix, iy);
                view.mask.push(on);
                view.mask_count += f64::from(u8::from(on));
                view.others.push(if hiding(&near, ix, iy) {
                    Other::MayHide
                } else if near.iter().any(|n| n.mask.get(ix, iy)) {
                    Other::AskDepth
                } else {
                    Other::None
                });
                view.reference.push(scene.points.as_ref().map_or(f32::NAN, |p| reference_depth(p, scene, px, py)));
            }
        }
        if view.mask_count < 1.0 {
            return None;
        }
        let mut depth = std::mem::take(&mut view.scene);
        let whole = PixelBox { x0: 0.0, y0: 0.0, x1: f64::from(size.width), y1: f64::from(size.height) };
        for (i, placed) in scene.placed.iter().enumerate() {
            if Some(i) != skip && may_be_seen(&view.camera, &placed.item.shape.bounds(), &placed.pose, &whole) {
                let shape = &placed.item.shape;
                let opaque = match (shape.opaque(), &mut view.opaque) {
                    (None, None) => None,
                    (_, known) => Some(known.get_or_insert_with(|| depth.clone())),
                };
                if let Some(opaque) = opaque {
                    rasterise(&view.camera, shape.opaque().unwrap_or(shape.proxy()), &placed.pose, opaque);
                }
                rasterise(&view.camera, shape.proxy(), &placed.pose, &mut depth);
            }
        }
        view.scene = depth;
        Some(view)
    }

    /// Box of the (unoccluded) projection of a mesh in image pixels; `None` when it is not in view.
    ///
    /// Where the image's border cuts the mask, only what is inside of the border counts: of a chair of which the back
    /// is in view, the seat below the border says nothing about where the mask should end.
    #[cfg(test)]
    pub(crate) fn outline(&self, proxy: &Proxy, pose: &Pose) -> Option<PixelBox> {
        with_scratch(|scratch| {
            to_camera(&self.full, proxy, pose, &mut scratch.points);
            self.outline_of_points(proxy, scratch)
        })
    }

    /// [`View::outline`] of a mesh whose vertices are in the camera's frame already.
    fn outline_of_points(&self, proxy: &Proxy, scratch: &mut Scratch) -> Option<PixelBox> {
        let whole = outline_of_points(&self.full, scratch.points.iter().copied());
        self.cut_outline(whole, |within| clipped_outline(&self.full, proxy, scratch, within))
    }

    /// The same from the hulls of a shape, which is quicker.
    pub(crate) fn outline_of_shape(&self, shape: &Shape, pose: &Pose) -> Option<PixelBox> {
        let whole = outline_of(&self.full, shape.hulls().iter().flatten().copied(), pose);
        self.cut_outline(whole, |within| {
            with_scratch(|scratch| {
                to_camera(&self.full, shape.proxy(), pose, &mut scratch.points);
                clipped_outline(&self.full, shape.proxy(), scratch, within)
            })
        })
    }

    fn cut_outline(
        &self,
        whole: Option<PixelBox>,
        clipped: impl FnOnce(&PixelBox) -> Option<PixelBox>,
    ) -> Option<PixelBox> {
        let w = &self.within;
        let inside = |o: &PixelBox| o.x0 >= w.x0 && o.y0 >= w.y0 && o.x1 <= w.x1 && o.y1 <= w.y1;
        whole.and_then(|o| if inside(&o) { Some(o) } else { clipped(w) })
    }

    /// Whether the image's border cuts the mask.
    pub(crate) fn is_cut(&self) -> bool {
        let (w, size) = (&self.within, self.full.size);
        w.x0 >= 0.0 || w.y0 >= 0.0 || w.x1 <= f64::from(size.width) || w.y1 <= f64::from(size.height)
    }

    /// Compares a pose with mask and point map.
    pub(crate) fn compare(&self, proxy: &Proxy, pose: &Pose) -> Match {
        with_scratch(|scratch| {
            // The window's camera stands where the full one does: its vertices are those of the outline.
            let span = scratch.draw_alone(&self.camera, proxy, pose);
            let mut out = self.agreement(&scratch.depth, span);
            out.outline = self.outline_of_points(proxy, scratch);
            out
        })
    }

    /// Agreement of drawn depths with mask and point map; nothing is drawn outside of the span.
    fn agreement(&self, depth: &[f32], span: Span) -> Match {
        let (mut both, mut strict_both, mut beside) = (0_u32, 0_u32, 0_u32);
        let (mut compared, mut soft) = (0_u32, 0.0);
        for (i, z) in span.rows(self.size.width as usize).flat_map(|row| row.clone().zip(&depth[row])) {
            let z = *z;
            if z <= 0.0 {
                continue;
            }
            let s = self.scene[i];
            if self.mask[i] {
                both += 1;
                let hides = self.opaque.as_ref().map_or(s, |o| o[i]);
                let behind = hides > 0.0 && z > hides + HIDING_TOLERANCE;
                strict_both += u32::from(!behind);
                let r = self.reference[i];
                if r.is_finite() {
                    let a = f64::from((z - r).abs());
                    soft += a / (1.0 + a / DEPTH_SOFT_LIMIT);
                    compared += 1;
                }
                continue;
            }
            // Not seen in the photo: excused where something nearer may stand before it.
            let nearly_behind = s > 0.0 && z > s - HIDING_TOLERANCE;
            let hidden = nearly_behind
                || match self.others[i] {
                    Other::None => false,
                    Other::MayHide => {
                        let r = self.reference[i];
                        !r.is_finite() || r < z - HIDING_TOLERANCE
                    }
                    Other::AskDepth => self.reference[i] < z - HIDING_TOLERANCE,
                };
            beside += u32::from(!hidden);
        }
        let union = self.mask_count + f64::from(beside);
        Match {
            iou: f64::from(both) / union,
            strict_iou: f64::from(strict_both) / union,
            outline: None,
            soft_depth: (compared >= FEWEST_DEPTHS).then(|| soft / f64::from(compared)),
            depth_share: f64::from(compared) / self.mask_count,
        }
    }

    /// Median absolute difference of an object's depths to the point map's over mask and silhouette, metres.
    pub(crate) fn depth_residual(&self, proxy: &Proxy, pose: &Pose) -> Option<f64> {
        with_scratch(|scratch| {
            let span = scratch.draw_alone(&self.camera, proxy, pose);
            let mut off: Vec<f32> = span
                .rows(self.size.width as usize)
                .flatten()
                .filter(|i| self.mask[*i] && scratch.depth[*i] > 0.0 && self.reference[*i].is_finite())
                .map(|i| (scratch.depth[i] - self.reference[i]).abs())
                .collect();
            if off.len() < FEWEST_DEPTHS as usize {
                return None;
            }
            let middle = off.len() / 2;
            let (_, median, _) = off.select_nth_unstable_by(middle, f32::total_cmp);
            Some(f64::from(*median))
        })
    }

    /// Depths along the view of the reference and of the rendered front surface, where both are seen: the points
    /// of the paper's `c_ref` and `c_ren`.
    pub(crate) fn front_depths(&self, proxy: &Proxy, pose: &Pose) -> (Vec<f64>, Vec<f64>) {
        let reference = self.masked_reference();
        let rendered = with_scratch(|scratch| {
            let span = scratch.draw_alone(&self.camera, proxy, pose);
            let depth = &scratch.depth;
            span.rows(self.size.width as usize)
                .flatten()
                .map(|i| (depth[i], self.scene[i]))
                .filter(|(z, s)| *z > 0.0 && !(*s > 0.0 && *z > *s + HIDING_TOLERANCE))
                .map(|(z, _)| f64::from(z))
                .collect()
        });
        (reference, rendered)
    }

    /// Depth of the point map over that of the object, where both are seen at one pixel; `None` where that is at too few.
    pub(crate) fn depth_ratio(&self, proxy: &Proxy, pose: &Pose) -> Option<f64> {
        let logs: Vec<f64> = with_scratch(|scratch| {
            let span = scratch.draw_alone(&self.camera, proxy, pose);
            let depth = &scratch.depth;
            span.rows(self.size.width as usize)
                .flatten()
                .filter(|i| self.mask[*i] && depth[*i] > 0.0 && self.reference[*i].is_finite())
                .filter(|i| !(self.scene[*i] > 0.0 && depth[*i] > self.scene[*i] + HIDING_TOLERANCE))
                .map(|i| f64::from(self.reference[i] / depth[i]).ln())
                .collect()
        });
        (logs.len() >= crate::steps::FEWEST_DEPTHS).then(|| front_surface_depth(&logs)).flatten().map(f64::exp)
    }

    /// Reference depths within the mask.
    pub(crate) fn masked_reference(&self) -> Vec<f64> {
        self.mask
            .iter()
            .zip(&self.reference)
            .filter(|(on, z)| **on && z.is_finite())
            .map(|(_, z)| f64::from(*z))
            .collect()
    }

    /// Positions (image pixels) of the window's samples within the mask.
    pub(crate) fn masked_pixels(&self) -> Vec<Vec2> {
        let w = self.size.width;
        let at = |i: usize| Vec2::new(f64::from(i as u32 % w) + 0.5, f64::from(i as u32 / w) + 0.5);
        let corner = Vec2::new(self.region.x0, self.region.y0);
        (0..self.mask.len()).filter(|i| self.mask[*i]).map(|i| corner + at(i) / self.zoom).collect()
    }

    /// Reference points (room frame) within the mask.
    pub(crate) fn masked_points(&self) -> Vec<Vec3> {
        let w = self.size.width;
        (0..self.mask.len())
            .filter(|i| self.mask[*i] && self.reference[*i].is_finite())
            .map(|i| {
                let pixel = Vec2::new(f64::from(i as u32 % w) + 0.5, f64::from(i as u32 / w) + 0.5);
                self.camera.unproject(pixel, f64::from(self.reference[i]))
            })
            .collect()
    }
}

/// Whether a posed box can be seen in a window of an image: not when all its corners are before the camera and it is beside
/// the window.
pub fn may_be_seen(camera: &Camera, bounds: &Bounds, pose: &Pose, window: &PixelBox) -> bool {
    let corners = corners(bounds).map(|p| camera.to_camera(pose.point(p)));
    if corners.iter().any(|c| c.z <= 2.0 * crate::raster::NEAR) {
        return true;
    }
    let Some(o) = outline_of_points(camera, corners.into_iter()) else { return true };
    // Two pixels cover rounding and the samples beside a pixel's centre.
    let w = window;
    o.x1 >= w.x0 - 2.0 && o.y1 >= w.y0 - 2.0 && o.x0 <= w.x1 + 2.0 && o.y0 <= w.y1 + 2.0
}

/// Box of the whole projection of canonical points in image pixels; `None` when none is before the camera.
pub(crate) fn outline_of(camera: &Camera, points: impl Iterator<Item = Vec3>, pose: &Pose) -> Option<PixelBox> {
    let linear = camera.rotation * pose.linear();
    let offset = camera.to_camera(pose.position);
    outline_of_points(camera, points.map(|p| linear * p + offset))
}

/// The same of points in the camera's frame.
fn outline_of_points(camera: &Camera, points: impl Iterator<Item = Vec3>) -> Option<PixelBox> {
    let (mut low, mut high) = (Vec2::MAX, Vec2::MIN);
    for c in points.filter(|c| c.z >= crate::raster::NEAR) {
        let pixel = pixel_of(camera, c);
        low = low.min(pixel);
        high = high.max(pixel);
    }
    (low.x <= high.x).then_some(PixelBox { x0: low.x, y0: low.y, x1: high.x, y1: high.y })
}

/// Bit of a vertex that is not before the camera; the lower four say beyond which sides of a box it is.
const BEHIND: u8 = 16;

/// Box of the part of a mesh's projection that is inside of `within`, image pixels; `None` when none is. The vertices are
/// in the camera's frame.
fn clipped_outline(camera: &Camera, proxy: &Proxy, scratch: &mut Scratch, within: &PixelBox) -> Option<PixelBox> {
    let Scratch { points, pixels, sides, .. } = scratch;
    let planes = [(Vec2::X, -within.x0), (Vec2::Y, -within.y0), (Vec2::NEG_X, within.x1), (Vec2::NEG_Y, within.y1)];
    pixels.clear();
    pixels.extend(points.iter().map(|c| pixel_of(camera, *c)));
    sides.clear();
    sides.extend(points.iter().zip(pixels.iter()).map(|(c, pixel)| {
        if c.z > crate::raster::NEAR {
            let inside = |i: usize| planes[i].0.dot(*pixel) + planes[i].1 >= 0.0;
            (0..4).map(|i| u8::from(!inside(i)) << i).sum()
        } else {
            BEHIND
        }
    }));
    let (mut low, mut high) = (Vec2::MAX, Vec2::MIN);
    let (mut polygon, mut spare) = (Vec::with_capacity(8), Vec::with_capacity(8));
    for t in &proxy.triangles {
        let t = t.map(|i| i as usize);
        let [a, b, c] = t.map(|i| sides[i]);
        // Most triangles are wholly inside, or wholly beyond one side.
        if a | b | c == 0 {
            for p in t.map(|i| pixels[i]) {
                low = low.min(p);
                high = high.max(p);
            }
            continue;
        }
        if a & b & c != 0 {
            continue;
        }
        polygon.clear();
        if (a | b | c) & BEHIND == 0 {
            polygon.extend(t.map(|i| pixels[i]));
        } else {
            polygon.extend(crate::raster::clip(t.map(|i| points[i])).into_iter().map(|p| pixel_of(camera, p)));
        }
        // Sutherland and Hodgman, one side of the box after the other.
        for (normal, limit) in planes {
            spare.clear();
            for i in 0..polygon.len() {
                let (p, q) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                let (dp, dq) = (normal.dot(p) + limit, normal.dot(q) + limit);
                if dp >= 0.0 {
                    spare.push(p);
                }
                if (dp >= 0.0) != (dq >= 0.0) {
                    spare.push(p + (q - p) * (dp / (dp - dq)));
                }
            }
            std::mem::swap(&mut polygon, &mut spare);
        }
        for p in &polygon {
            low = low.min(*p);
            high = high.max(*p);
        }
    }
    (low.x <= high.x).then_some(PixelBox { x0: low.x, y0: low.y, x1: high.x, y1: high.y })
}

fn pixel_of(camera: &Camera, c: Vec3) -> Vec2 {
    let k = camera.intrinsics;
    Vec2::new(k.fx * c.x / c.z + k.cx, k.fy * c.y / c.z + k.cy)
}

/// Planar depth of the point map at an image position, NaN where it has none.
fn reference_depth(points: &RoomPoints, scene: &PartialScene, px: f64, py: f64) -> f32 {
    if !points.is_dense() {
        return f32::NAN;
    }
    let point = points.at(scene.camera.size, Vec2::new(px, py));
    point.map(|p| scene.camera.depth(p) as f32).filter(|z| *z > 0.0).unwrap_or(f32::NAN)
}

/// The mask's box without stray specks: the tightest box of rows and columns that hold all but 0.2 % of it.
pub(crate) fn clean_box(mask: &Mask) -> Option<PixelBox> {
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

/// A box grown for the window: a fraction of its size, at least a few pixels, cut to the image.
fn padded(b: &PixelBox, image: ImageSize) -> PixelBox {
    let margin = WINDOW_PADDING * b.width().max(b.height()) * 0.6 + 6.0;
    let (dx, dy) = (margin.max(WINDOW_PADDING * b.width() * 0.5), margin.max(WINDOW_PADDING * b.height() * 0.5));
    let g =
        PixelBox { x0: (b.x0 - dx).floor(), y0: (b.y0 - dy).floor(), x1: (b.x1 + dx).ceil(), y1: (b.y1 + dy).ceil() };
    g.clamped(image)
}

/// Distance from the image's border at which it cuts a mask, relative to the image's longer side: masks end a little
/// before it, and sensors and scans leave a frame around their pictures.
const BORDER: f64 = 0.012;

/// The same in pixels.
pub(crate) fn border_px(image: ImageSize) -> f64 {
    (BORDER * f64::from(image.width.max(image.height))).max(2.0)
}

/// The image's own sides where they cut a box, sides far outside where not.
fn within_border(b: &PixelBox, image: ImageSize) -> PixelBox {
    let (w, h) = (f64::from(image.width), f64::from(image.height));
    let [left, top, right, bottom] = cut_by_border(b, image);
    let far = 1e6;
    PixelBox {
        x0: if left { 0.0 } else { -far },
        y0: if top { 0.0 } else { -far },
        x1: if right { w } else { far },
        y1: if bottom { h } else { far },
    }
}

/// Which sides of a mask's box the image's border cuts: left, top, right, bottom.
pub(crate) fn cut_by_border(b: &PixelBox, image: ImageSize) -> [bool; 4] {
    let border = border_px(image);
    let (w, h) = (f64::from(image.width), f64::from(image.height));
    [b.x0 <= border, b.y0 <= border, b.x1 >= w - border, b.y1 >= h - border]
}

/// Which edges of the mask's box are the object's own: not cut by the image border, nor by what may hide it.
fn free_edges(mask: &Mask, b: &PixelBox, neighbours: &[Neighbour]) -> [bool; 4] {
    let image = mask.size();
    let mut free = cut_by_border(b, image).map(|cut| !cut);
    if !neighbours.iter().any(|n| n.may_hide) {
        return free;
    }
    for (edge, free) in free.iter_mut().enumerate().filter(|(_, f)| **f) {
        let (all, extreme) = side(mask, b, neighbours, edge);
        // Hidden along most of its side, or where it would end.
        *free = all < 0.5 && extreme < 0.4;
    }
    free
}

/// Shares of an edge's outermost pixels that have a hiding neighbour just outside: of the whole side, and of the
/// band in which the edge of the box was measured.
fn side(mask: &Mask, b: &PixelBox, neighbours: &[Neighbour], edge: usize) -> (f64, f64) {
    let (x0, x1, y0, y1) = (b.x0 as i64, b.x1 as i64, b.y0 as i64, b.y1 as i64);
    let across = if edge.is_multiple_of(2) { b.width() } else { b.height() };
    let band = (across * 0.02).clamp(1.0, 6.0) as i64;
    let (dx, dy) = [(-1, 0), (0, -1), (1, 0), (0, 1)][edge];
    let lines = if edge.is_multiple_of(2) { y0..y1 } else { x0..x1 };
    let (mut all, mut all_cut, mut near, mut near_cut) = (0.0, 0.0, 0.0, 0.0);
    for line in lines {
        let outermost = match edge {
            0 => (x0..x1).find(|x| mask.get(*x, line)).map(|x| (x, line, x - x0)),
            1 => (y0..y1).find(|y| mask.get(line, *y)).map(|y| (line, y, y - y0)),
            2 => (x0..x1).rev().find(|x| mask.get(*x, line)).map(|x| (x, line, x1 - 1 - x)),
            _ => (y0..y1).rev().find(|y| mask.get(line, *y)).map(|y| (line, y, y1 - 1 - y)),
        };
        let Some((x, y, inset)) = outermost else { continue };
        let cut = f64::from(u8::from((1..=4).any(|k| hiding(neighbours, x + k * dx, y + k * dy))));
        all += 1.0;
        all_cut += cut;
        if inset < band {
            near += 1.0;
            near_cut += cut;
        }
    }
    let share = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 1.0 };
    (share(all_cut, all), share(near_cut, near))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PlacementSettings;
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
            View::new(scene, None, mask, &[], 128).unwrap().compare(chair.shape.proxy(), &Pose::new(at, 0.0, 1.0))
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

    /// A box that the image's lower border cuts: the outline that counts is that of the part in view, which is narrower
    /// than the part below.
    #[test]
    fn an_outline_ends_where_the_image_cuts_its_mask() {
        let scene = empty_room();
        let at = Vec3::new(2.2, 0.0, 3.9);
        let item = boxed(&scene, Vec3::new(0.6, 1.1, 0.6), at, 0.0);
        let view = View::new(&scene, None, &item.mask, &[], PlacementSettings::default().window_px).unwrap();
        let pose = Pose::new(at, 0.0, 1.0);
        let whole = outline_of(&scene.camera, item.shape.hulls().iter().flatten().copied(), &pose).unwrap();
        let cut = view.outline(item.shape.proxy(), &pose).unwrap();
        let bottom = f64::from(scene.camera.size.height);
        assert!(whole.y1 > bottom + 50.0 && !view.free[3], "{whole:?}");
        assert!((cut.y1 - bottom).abs() < 1e-6 && cut.y0 == whole.y0, "{cut:?}");
        // The mask's own box is the expectation: pixels whose centres are covered.
        let b = item.mask.bounds().unwrap();
        for (mask, outline) in [(b.x0, cut.x0), (b.x1, cut.x1), (b.y0, cut.y0)] {
            assert!((mask - outline).abs() <= 1.0, "{b:?} {cut:?}");
        }
        // Nowhere in view, it has no outline; a free side does not cut.
        let below = Pose::new(at - Vec3::Y * 3.0, 0.0, 1.0);
        assert!(view.outline(item.shape.proxy(), &below).is_none());
        let beside = view.outline(item.shape.proxy(), &Pose::new(at + Vec3::X * 3.0, 0.0, 1.0));
        assert!(beside.is_some_and(|o| o.x1 > f64::from(scene.camera.size.width)));
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
        item.mask = Mask::from_fn(size, |x, y| i64::from(y) < middle && whole.get(i64::from(x), i64::from(y)));
        let view = View::new(&scene, None, &item.mask, &[], PlacementSettings::default().window_px).unwrap();
        let ratio = view.depth_ratio(item.shape.proxy(), &pose).unwrap();
        assert!((ratio - 1.05).abs() < 0.005, "{ratio}");
        // Of the two sets by themselves the means tell another tale.
        let (reference, rendered) = view.front_depths(item.shape.proxy(), &pose);
        let apart = front_surface_depth(&reference).unwrap() / front_surface_depth(&rendered).unwrap();
        assert!(apart > 1.1, "{apart}");
        // Beside its mask nothing is compared.
        let beside = Pose::new(at - Vec3::X * 2.0, 0.0, 1.0);
        assert!(view.depth_ratio(item.shape.proxy(), &beside).is_none());
    }
}
