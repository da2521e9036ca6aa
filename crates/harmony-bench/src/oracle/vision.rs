//! Point map, boxes and masks from the truth.

use std::collections::BTreeSet;
use std::sync::Arc;

use async_trait::async_trait;
use glam::{DMat3, DVec3};
use harmony_roles::{
    DetectRequest, Detection, Detections, Detector, GeometryAnswer, GeometryEstimator, GeometryRequest, PlayerCard,
    RoleError, SegmentPrompt, SegmentRequest, SegmentedMask, Segmenter,
};
use harmony_scene::{ImageSize, Intrinsics, Mask, PixelBox, PointMap, PointMapKind};
use rand::Rng;

use super::{Draws, Noise, Oracle, card, normal, same_kind, smooth_field};

/// Longer side of the point map, pixels, as VGGT gives it; sides are multiples of 14.
const POINT_MAP_PX: f64 = 518.0;
const PATCH: f64 = 14.0;

/// Depth jumps larger than this (relative) are edges across which depths bleed.
const JUMP: f32 = 0.05;

#[async_trait]
impl GeometryEstimator for Oracle {
    fn card(&self) -> PlayerCard {
        card("point map")
    }

    async fn estimate(&self, _: &GeometryRequest) -> Result<GeometryAnswer, RoleError> {
        Ok(GeometryAnswer::Points(Arc::new(self.spent.measured(|| self.point_map()))))
    }
}

impl Oracle {
    /// The truth's depth as an estimator gives it: its size, its focal length, its errors, its own scale and frame.
    pub fn point_map(&self) -> PointMap {
        let photo = self.room.camera.size;
        let k = POINT_MAP_PX / f64::from(photo.width.max(photo.height));
        let side = |pixels: u32| ((f64::from(pixels) * k / PATCH).round().max(1.0) * PATCH) as u32;
        let size = ImageSize::new(side(photo.width), side(photo.height));
        let mut depth: Vec<f32> = Vec::with_capacity(size.pixels());
        for y in 0..size.height {
            for x in 0..size.width {
                let sx = ((f64::from(x) + 0.5) * f64::from(photo.width) / f64::from(size.width)) as usize;
                let sy = ((f64::from(y) + 0.5) * f64::from(photo.height) / f64::from(size.height)) as usize;
                depth.push(self.room.depth[sy * photo.width as usize + sx]);
            }
        }
        let confidence = blur_edges(&mut depth, size, self.noise.depth_bleed);
        multiply(&mut depth, size, &self.noise, &self.draws);
        let exact = self.room.camera.intrinsics.resized(photo, size);
        let focal = 1.0 + self.noise.focal * self.draws.normal("focal").clamp(-2.5, 2.5);
        let intrinsics = Intrinsics { fx: exact.fx * focal, fy: exact.fy * focal, ..exact };
        let mut map = PointMap::from_depth(PointMapKind::Relative, size, intrinsics, &depth);
        for (own, c) in map.confidence.iter_mut().zip(confidence) {
            *own *= c;
        }
        self.carry_off(&mut map);
        map
    }

    /// Moves a map into a frame and scale that nobody knows.
    fn carry_off(&self, map: &mut PointMap) {
        let mut rng = self.draws.rng("frame");
        let scale = (0.2 + 1.8 * rng.random::<f64>()) as f32;
        let turn = |rng: &mut rand_chacha::ChaCha8Rng| 0.4 * normal(rng);
        let rotation = DMat3::from_rotation_y(turn(&mut rng))
            * DMat3::from_rotation_x(turn(&mut rng))
            * DMat3::from_rotation_z(turn(&mut rng));
        let shift = DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng));
        for p in &mut map.xyz {
            if p.is_finite() {
                *p = (rotation * (p.as_dvec3() * f64::from(scale)) + shift).as_vec3();
            }
        }
        // x_camera = R (p - shift): the camera of the map in its own frame.
        map.rotation = rotation.transpose();
        map.translation = -(map.rotation * shift);
    }

    /// What a segmenter gives for an object: ragged, with holes, at times merged with a neighbour.
    fn mask_of(&self, object: usize, size: ImageSize) -> Mask {
        let id = &self.room.objects[object].id;
        let mut mask = self.room.mask(self.room.objects[object].index);
        if self.draws.happens(&format!("merged {id}"), self.noise.merged_or_missed / 2.0)
            && let Some(other) = self.neighbour(object)
        {
            mask = mask.or(&self.room.mask(self.room.objects[other].index));
        }
        let mut mask = if size == mask.size() { mask } else { mask.resized(size) };
        ragged(&mut mask, self.noise.mask_px, &self.draws, id);
        pierce(&mut mask, self.noise.holes, &self.draws, id);
        mask
    }

    /// The object whose box overlaps another's most.
    fn neighbour(&self, object: usize) -> Option<usize> {
        let own = self.boxes[object]?;
        let own = PixelBox { x0: own.x0 - 6.0, y0: own.y0 - 6.0, x1: own.x1 + 6.0, y1: own.y1 + 6.0 };
        (0..self.boxes.len())
            .filter(|i| *i != object && self.room.objects[*i].level == self.room.objects[object].level)
            .filter_map(|i| Some((i, self.boxes[i]?.intersection(&own).area())))
            .filter(|(_, shared)| *shared > 0.0)
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(i, _)| i)
    }
}

/// Mixes depths across depth edges, as networks do; returns a confidence that is low there.
fn blur_edges(depth: &mut [f32], size: ImageSize, radius: f64) -> Vec<f32> {
    let (w, h) = (size.width as usize, size.height as usize);
    let mut confidence = vec![1.0_f32; depth.len()];
    let r = radius.ceil() as usize;
    if r == 0 {
        return confidence;
    }
    let source = depth.to_vec();
    for y in 0..h {
        for x in 0..w {
            let z = source[y * w + x];
            let (mut low, mut high, mut sum, mut n) = (f32::MAX, 0.0_f32, 0.0, 0.0);
            for j in y.saturating_sub(r)..(y + r + 1).min(h) {
                for i in x.saturating_sub(r)..(x + r + 1).min(w) {
                    let v = source[j * w + i];
                    let far = ((i as f64 - x as f64).powi(2) + (j as f64 - y as f64).powi(2)).sqrt();
                    if v > 0.0 && far <= radius {
                        (low, high) = (low.min(v), high.max(v));
                        sum += v;
                        n += 1.0;
                    }
                }
            }
            if z > 0.0 && n > 0.0 && high - low > JUMP * low {
                depth[y * w + x] = sum / n;
                confidence[y * w + x] = 0.4;
            }
        }
    }
    confidence
}

/// The smooth and the independent multiplicative error.
fn multiply(depth: &mut [f32], size: ImageSize, noise: &Noise, draws: &Draws) {
    if noise.depth_smooth == 0.0 && noise.depth_pixel == 0.0 {
        return;
    }
    let length = noise.depth_length * f64::from(size.width.max(size.height));
    let smooth = smooth_field(&mut draws.rng("depth smooth"), size.width as usize, size.height as usize, length);
    let mut rng = draws.rng("depth pixel");
    for (z, s) in depth.iter_mut().zip(smooth) {
        let error = noise.depth_smooth * f64::from(s) + noise.depth_pixel * normal(&mut rng);
        *z *= (1.0 + error).max(0.3) as f32;
    }
}

/// Moves the border of a mask in and out by up to some pixels.
fn ragged(mask: &mut Mask, pixels: f64, draws: &Draws, id: &str) {
    let Some(b) = mask.bounds() else { return };
    if pixels <= 0.0 {
        return;
    }
    let size = mask.size();
    let margin = pixels.ceil() as i64 + 1;
    let (x0, y0) = (b.x0 as i64 - margin, b.y0 as i64 - margin);
    let (w, h) = ((b.x1 as i64 + margin - x0) as usize, (b.y1 as i64 + margin - y0) as usize);
    let field = smooth_field(&mut draws.rng(&format!("ragged {id}")), w, h, 8.0);
    let source = mask.clone();
    for j in 0..h {
        for i in 0..w {
            let (x, y) = (x0 + i as i64, y0 + j as i64);
            if x < 0 || y < 0 || x >= i64::from(size.width) || y >= i64::from(size.height) {
                continue;
            }
            let on = source.get(x, y);
            // Distance to the border, positive inside, as far as it matters; the image's border is none.
            let mut nearest = f64::from(margin as i32);
            for dy in -margin..=margin {
                for dx in -margin..=margin {
                    let (u, v) = (x + dx, y + dy);
                    let inside = u >= 0 && v >= 0 && u < i64::from(size.width) && v < i64::from(size.height);
                    if inside && source.get(u, v) != on {
                        nearest = nearest.min(((dx * dx + dy * dy) as f64).sqrt() - 0.5);
                    }
                }
            }
            let signed = if on { nearest } else { -nearest };
            let shift = (f64::from(field[j * w + i]) * pixels / 2.0).clamp(-pixels, pixels);
            mask.set(x as u32, y as u32, signed + shift > 0.0);
        }
    }
}

/// Cuts round holes of some share of the area.
fn pierce(mask: &mut Mask, share: f64, draws: &Draws, id: &str) {
    let (area, Some(b)) = (mask.count() as f64, mask.bounds()) else { return };
    if share <= 0.0 || area < 400.0 {
        return;
    }
    let mut rng = draws.rng(&format!("holes {id}"));
    let radius = (area * share / 3.0 / std::f64::consts::PI).sqrt().max(1.0);
    for _ in 0..3 {
        let (x, y) = (b.x0 + rng.random::<f64>() * b.width(), b.y0 + rng.random::<f64>() * b.height());
        let (x0, x1) = ((x - radius).max(b.x0) as u32, (x + radius).min(b.x1 - 1.0) as u32);
        let (y0, y1) = ((y - radius).max(b.y0) as u32, (y + radius).min(b.y1 - 1.0) as u32);
        for v in y0..=y1 {
            for u in x0..=x1 {
                if (f64::from(u) - x).hypot(f64::from(v) - y) <= radius {
                    mask.set(u, v, false);
                }
            }
        }
    }
}

#[async_trait]
impl Detector for Oracle {
    fn card(&self) -> PlayerCard {
        card("boxes")
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        let image = ImageSize::new(request.image.width(), request.image.height());
        let (kx, ky) = (
            f64::from(image.width) / f64::from(self.room.camera.size.width),
            f64::from(image.height) / f64::from(self.room.camera.size.height),
        );
        let mut detections = Vec::new();
        let mut asked = BTreeSet::new();
        for phrase in &request.phrases {
            if !asked.insert(phrase.label.clone()) {
                continue;
            }
            for i in self.seen(request.level) {
                let object = &self.room.objects[i];
                let missed = self.draws.happens(&format!("missed {}", object.id), self.noise.merged_or_missed / 2.0)
                    || self.overlooks(&object.id);
                if missed || !same_kind(&object.label, &phrase.label) {
                    continue;
                }
                let mut rng = self.draws.rng(&format!("box {} {}", object.id, phrase.label));
                let Some(b) = self.box_off(i, 1.0, &mut rng) else { continue };
                let bounds = PixelBox { x0: b.x0 * kx, y0: b.y0 * ky, x1: b.x1 * kx, y1: b.y1 * ky };
                let score = (0.85 + 0.07 * normal(&mut rng)).clamp(0.3, 0.99);
                detections.push(Detection {
                    label: phrase.label.clone(),
                    phrase: phrase.phrase.clone(),
                    bounds: bounds.clamped(image),
                    score: Some(score),
                    outline: None,
                });
            }
        }
        Ok(Detections { detections, ..Detections::default() })
    }
}

#[async_trait]
impl Segmenter for Oracle {
    fn card(&self) -> PlayerCard {
        card("masks")
    }

    async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError> {
        let image = ImageSize::new(request.image.width(), request.image.height());
        let mask = |prompt: &SegmentPrompt| match self.recognise(None, &prompt.label, &prompt.bounds, image) {
            Some(object) => SegmentedMask { mask: self.mask_of(object, image), score: Some(0.95) },
            None => SegmentedMask { mask: Mask::empty(image), score: Some(0.0) },
        };
        Ok(self.spent.measured(|| request.prompts.iter().map(mask).collect()))
    }
}
