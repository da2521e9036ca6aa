//! Finds object-like regions without any model: what differs from the colours of floor, walls and ceiling.

mod background;
mod superpixels;

use glam::DVec2;
use harmony_scene::{Camera, ImageSize, Mask, PixelBox, RoomFaces, Surface};
use image::RgbImage;
use rayon::prelude::*;

use crate::color::{distance_squared, lab_from_rgb8, rgb8_from_lab};
use crate::resample::{Window, resize_window};

/// Label of a pixel that shows no known surface.
pub const UNKNOWN_SURFACE: u8 = 255;

/// The label of a room face in a surface label map: its place in [`Surface::ALL`].
pub fn surface_id(surface: Surface) -> u8 {
    match surface {
        Surface::Floor => 0,
        Surface::Ceiling => 1,
        Surface::Back => 2,
        Surface::Left => 3,
        Surface::Right => 4,
        Surface::Front => 5,
    }
}

/// Which surface of the room each pixel's ray meets, row-major, as [`surface_id`].
///
/// All [`UNKNOWN_SURFACE`] when the camera is outside the room's box.
pub fn surface_labels(camera: &Camera, faces: &RoomFaces) -> Vec<u8> {
    if !faces.extents().contains(camera.centre(), 1e-6) {
        return vec![UNKNOWN_SURFACE; camera.size.pixels()];
    }
    let width = camera.size.width.max(1) as usize;
    (0..camera.size.pixels())
        .into_par_iter()
        .map(|i| {
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            faces.exit(&camera.ray(pixel)).map_or(UNKNOWN_SURFACE, |exit| surface_id(exit.surface))
        })
        .collect()
}

/// Parameters of the search.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionSettings {
    /// Longest side of the image that is analysed, pixels.
    pub working_px: u32,
    /// Most regions returned.
    pub max_regions: usize,
    /// Smallest region, as a fraction of the image.
    pub min_area: f64,
}

impl Default for RegionSettings {
    fn default() -> Self {
        Self { working_px: 400, max_regions: 24, min_area: 0.002 }
    }
}

/// A candidate object region.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Full-frame mask.
    pub mask: Mask,
    /// Tight box of the mask.
    pub bounds: PixelBox,
    /// Share of the image.
    pub area: f64,
    /// Mean colour, sRGB.
    pub color: [u8; 3],
    /// Share of the region before floor, ceiling and the walls (all four together); what is missing to 1 is unknown.
    pub on_floor: f64,
    /// See `on_floor`.
    pub on_ceiling: f64,
    /// See `on_floor`.
    pub on_walls: f64,
    /// The face that most of the region is seen against; `None` when that is unknown.
    pub surface: Option<Surface>,
    /// The region crosses or touches the boundary of floor and wall.
    pub touches_floor_boundary: bool,
    /// Image borders touched: left, top, right, bottom.
    pub touches_border: [bool; 4],
    /// How much it looks like a thing, 0 to 1: contrast to its surface, edges and bare surface around it, compactness,
    /// size.
    pub objectness: f64,
}

/// Proposes regions, best first. `surfaces` has one label a pixel ([`surface_id`]); another length counts as unknown.
pub fn propose_regions(photo: &RgbImage, surfaces: &[u8], settings: &RegionSettings) -> Vec<Region> {
    let size = crate::size_of(photo);
    if size.pixels() == 0 {
        return Vec::new();
    }
    let work = size.fit_within(settings.working_px.clamp(32, 2048));
    let picture = Picture::new(photo, surfaces, work);
    let mut candidates: Vec<(f64, Vec<bool>)> = picture
        .proposals()
        .into_iter()
        .filter_map(|set| {
            let area = set.iter().filter(|b| **b).count() as f64 / set.len() as f64;
            (area >= settings.min_area && area <= MAX_AREA).then(|| (picture.objectness(&set), set))
        })
        .collect();
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<(f64, Vec<bool>)> = Vec::new();
    for (score, set) in candidates {
        if kept.len() >= settings.max_regions {
            break;
        }
        if kept.iter().all(|(_, other)| overlap(&set, other) < SAME_OVERLAP) {
            kept.push((score, set));
        }
    }
    kept.into_iter().filter_map(|(score, set)| picture.region(photo, score, &set)).collect()
}

/// Largest region, as a fraction of the image.
const MAX_AREA: f64 = 0.6;
/// Regions that overlap this much (intersection over union) are one.
const SAME_OVERLAP: f64 = 0.7;
/// Colour distance to the bare surface below which a part is bare, and from which it surely is not.
const BARE_DISTANCE: (f32, f32) = (6.0, 22.0);
/// Neighbouring parts this alike in colour belong to one thing, Lab units; from strict to loose.
const MERGE_STEPS: [f32; 3] = [10.0, 20.0, 40.0];

/// The photo at working size, with what is needed to judge its parts.
struct Picture {
    size: ImageSize,
    lab: Vec<[f32; 3]>,
    surfaces: Vec<u8>,
    parts: superpixels::Superpixels,
    /// Mean colour, pixels, and foreground share (0 bare, 1 surely not) of each part.
    part: Vec<Part>,
    /// Colour step to the right and lower neighbour, Lab units.
    gradient: Vec<f32>,
}

struct Part {
    color: [f32; 3],
    pixels: usize,
    foreground: f32,
}

impl Picture {
    fn new(photo: &RgbImage, surfaces: &[u8], work: ImageSize) -> Self {
        let size = crate::size_of(photo);
        let (w, h) = (work.width as usize, work.height as usize);
        let small = resize_window(photo, Window::whole((size.width, size.height)), work);
        let lab: Vec<[f32; 3]> = small.pixels().map(|p| lab_from_rgb8(p.0)).collect();
        let surfaces: Vec<u8> = if surfaces.len() == size.pixels() {
            (0..w * h)
                .map(|i| {
                    let x = (2 * (i % w) + 1) * size.width as usize / (2 * w);
                    let y = (2 * (i / w) + 1) * size.height as usize / (2 * h);
                    surfaces[y * size.width as usize + x]
                })
                .collect()
        } else {
            vec![UNKNOWN_SURFACE; w * h]
        };
        let background = background::Background::of(&lab, &surfaces, w);
        let parts = superpixels::divide(&lab, w, h, (w * h / 2500).max(8));
        let mut sums = vec![([0.0_f64; 3], 0.0_f64, 0_usize); parts.count];
        for ((label, lab), surface) in parts.labels.iter().zip(&lab).zip(&surfaces) {
            let (color, distance, n) = &mut sums[*label as usize];
            for (s, c) in color.iter_mut().zip(lab) {
                *s += f64::from(*c);
            }
            *distance += f64::from(background.distance(*surface, *lab));
            *n += 1;
        }
        let part = sums
            .into_iter()
            .map(|(color, distance, n)| {
                let mean = (distance / n.max(1) as f64) as f32;
                Part {
                    color: color.map(|c| (c / n.max(1) as f64) as f32),
                    pixels: n,
                    foreground: ((mean - BARE_DISTANCE.0) / (BARE_DISTANCE.1 - BARE_DISTANCE.0)).clamp(0.0, 1.0),
                }
            })
            .collect();
        let gradient = (0..w * h)
            .map(|i| {
                let right = if i % w + 1 < w { distance_squared(lab[i], lab[i + 1]) } else { 0.0 };
                let below = if i / w + 1 < h { distance_squared(lab[i], lab[i + w]) } else { 0.0 };
                right.max(below).sqrt()
            })
            .collect();
        Self { size: work, lab, surfaces, parts, part, gradient }
    }

    /// Neighbouring pairs of parts that are not bare, each once.
    fn neighbours(&self) -> Vec<(u32, u32)> {
        let w = self.size.width as usize;
        let mut pairs = Vec::new();
        for (i, a) in self.parts.labels.iter().enumerate() {
            let right = (i % w + 1 < w).then(|| i + 1);
            let below = (i + w < self.parts.labels.len()).then(|| i + w);
            for j in [right, below].into_iter().flatten() {
                let b = self.parts.labels[j];
                if *a != b && self.part[*a as usize].foreground > 0.0 && self.part[b as usize].foreground > 0.0 {
                    pairs.push((*a.min(&b), *a.max(&b)));
                }
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    /// Connected sets of parts that are not bare: alike in colour, from strict to loose, and whatever hangs together.
    fn proposals(&self) -> Vec<Vec<bool>> {
        let neighbours = self.neighbours();
        let mut proposals: Vec<Vec<bool>> = Vec::new();
        let mut seen: Vec<Vec<u32>> = Vec::new();
        for limit in MERGE_STEPS.into_iter().chain([f32::INFINITY]) {
            let mut group: Vec<u32> = (0..self.parts.count as u32).collect();
            for (a, b) in &neighbours {
                let (pa, pb) = (&self.part[*a as usize], &self.part[*b as usize]);
                if distance_squared(pa.color, pb.color).sqrt() < limit {
                    let (ra, rb) = (root(&group, *a), root(&group, *b));
                    group[ra.max(rb) as usize] = ra.min(rb);
                }
            }
            let roots: Vec<u32> = (0..self.parts.count as u32).map(|p| root(&group, p)).collect();
            for leader in 0..self.parts.count as u32 {
                let members: Vec<u32> = (0..self.parts.count as u32)
                    .filter(|p| roots[*p as usize] == leader && self.part[*p as usize].foreground > 0.0)
                    .collect();
                let pixels: usize = members.iter().map(|p| self.part[*p as usize].pixels).sum();
                if pixels * 1000 < self.lab.len() || seen.contains(&members) {
                    continue;
                }
                let mut set: Vec<bool> = self.parts.labels.iter().map(|l| members.binary_search(l).is_ok()).collect();
                let (w, h) = (self.size.width as usize, self.size.height as usize);
                crate::components::clean(&mut set, w, h, pixels / 10, pixels / 8);
                proposals.push(set);
                seen.push(members);
            }
        }
        proposals
    }

    /// Mean of contrast to the surface, edge strength and bare surface along the outline, compactness and size.
    fn objectness(&self, set: &[bool]) -> f64 {
        let (w, h) = (self.size.width as usize, self.size.height as usize);
        let (mut area, mut contrast) = (0.0_f64, 0.0_f64);
        let (mut outline, mut edge, mut border, mut bare) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        let mut bounds = (w, h, 0, 0);
        for i in (0..set.len()).filter(|i| set[*i]) {
            let (x, y) = (i % w, i / w);
            area += 1.0;
            contrast += f64::from(self.part[self.parts.labels[i] as usize].foreground);
            bounds = (bounds.0.min(x), bounds.1.min(y), bounds.2.max(x + 1), bounds.3.max(y + 1));
            if x == 0 || y == 0 || x + 1 == w || y + 1 == h {
                border += 1.0;
                continue;
            }
            let around = [i - 1, i + 1, i - w, i + w];
            if around.iter().any(|j| !set[*j]) {
                outline += 1.0;
                let beside_bare = |j: &usize| !set[*j] && self.part[self.parts.labels[*j] as usize].foreground < 0.3;
                bare += f64::from(u8::from(around.iter().any(beside_bare)));
                let strongest = [i, i - 1, i - w, i + 1, i + w].iter().map(|j| self.gradient[*j]).fold(0.0, f32::max);
                edge += f64::from((strongest / 15.0).min(1.0));
            }
        }
        if area == 0.0 {
            return 0.0;
        }
        let boxed = ((bounds.2 - bounds.0) * (bounds.3 - bounds.1)) as f64;
        let share = area / set.len() as f64;
        let size = (share / 0.03).min(1.0).sqrt() * (1.0 - ((share - 0.3) / 0.3).clamp(0.0, 1.0));
        let free = outline / (outline + border).max(1.0);
        let sharp = edge / outline.max(1.0);
        // A whole thing stands before bare surface; a part of a thing is bordered by its other parts.
        let alone = bare / outline.max(1.0);
        let sum = 0.2 * contrast / area + 0.15 * sharp + 0.3 * alone + 0.15 * area / boxed + 0.2 * size;
        (sum * (0.5 + 0.5 * free)).clamp(0.0, 1.0)
    }

    fn region(&self, photo: &RgbImage, objectness: f64, set: &[bool]) -> Option<Region> {
        let (w, h) = (self.size.width as usize, self.size.height as usize);
        let small = Mask::from_fn(self.size, |x, y| set[y as usize * w + x as usize]);
        let mask = small.resized(crate::size_of(photo));
        let bounds = mask.bounds()?;
        let mut on = [0.0_f64; 6];
        let (mut area, mut sum) = (0.0_f64, [0.0_f64; 3]);
        for (i, _) in set.iter().enumerate().filter(|(_, b)| **b) {
            if let Some(n) = on.get_mut(self.surfaces[i] as usize) {
                *n += 1.0;
            }
            for (s, c) in sum.iter_mut().zip(self.lab[i]) {
                *s += f64::from(c);
            }
            area += 1.0;
        }
        let grown = small.dilated(2);
        let is_floor = |i: usize| self.surfaces[i] == surface_id(Surface::Floor);
        let is_wall = |i: usize| (2..=5).contains(&self.surfaces[i]);
        let touches_floor_boundary = (0..w * h).any(|i| {
            let below = i + w;
            grown.bits()[i] && below < w * h && grown.bits()[below] && is_wall(i) && is_floor(below)
        });
        let most = (0..6).max_by(|a, b| on[*a].total_cmp(&on[*b]).then(b.cmp(a)));
        Some(Region {
            bounds,
            area: area / set.len() as f64,
            color: rgb8_from_lab(sum.map(|s| (s / area.max(1.0)) as f32)),
            on_floor: on[0] / area.max(1.0),
            on_ceiling: on[1] / area.max(1.0),
            on_walls: on[2..].iter().sum::<f64>() / area.max(1.0),
            surface: most.filter(|k| on[*k] * 2.0 > area).map(|k| Surface::ALL[k]),
            touches_floor_boundary,
            touches_border: mask.touches_border(1),
            objectness,
            mask,
        })
    }
}

/// The group's smallest member.
fn root(group: &[u32], mut i: u32) -> u32 {
    while group[i as usize] != i {
        i = group[i as usize];
    }
    i
}

fn overlap(a: &[bool], b: &[bool]) -> f64 {
    let both = a.iter().zip(b).filter(|(a, b)| **a && **b).count();
    let either = a.iter().zip(b).filter(|(a, b)| **a || **b).count();
    if either == 0 { 0.0 } else { both as f64 / either as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmony_scene::{Extents, Intrinsics, Vec3};
    use image::Rgb;

    fn room() -> (Camera, Extents) {
        let size = ImageSize::new(320, 240);
        let extents = Extents { width: 4.0, height: 2.5, depth: 5.0 };
        let intrinsics = Intrinsics::from_horizontal_fov(size, 1.3);
        (Camera::looking(size, intrinsics, Vec3::new(2.0, 1.4, 4.5), Vec3::new(0.0, -0.15, -1.0)), extents)
    }

    #[test]
    fn surface_labels_follow_the_box() {
        let (camera, extents) = room();
        let labels = surface_labels(&camera, &extents.into());
        let at = |x: usize, y: usize| labels[y * 320 + x];
        assert_eq!(at(160, 235), surface_id(Surface::Floor));
        assert_eq!(at(160, 90), surface_id(Surface::Back));
        assert_eq!(at(2, 100), surface_id(Surface::Left));
        assert_eq!(at(317, 100), surface_id(Surface::Right));
        let outside = Camera::looking(camera.size, camera.intrinsics, Vec3::new(2.0, 1.4, 9.0), Vec3::NEG_Z);
        assert!(surface_labels(&outside, &extents.into()).iter().all(|l| *l == UNKNOWN_SURFACE));
        for (k, surface) in Surface::ALL.into_iter().enumerate() {
            assert_eq!(surface_id(surface) as usize, k);
        }
    }

    #[test]
    fn a_painting_and_a_chest_are_found_and_placed() {
        let (camera, extents) = room();
        let labels = surface_labels(&camera, &extents.into());
        let painting = |x: u32, y: u32| (120..170).contains(&x) && (60..95).contains(&y);
        let chest = |x: u32, y: u32| (190..250).contains(&x) && (120..175).contains(&y);
        let photo = RgbImage::from_fn(320, 240, |x, y| {
            let light = (x / 16) as u8;
            if painting(x, y) {
                Rgb([40, 80, 160])
            } else if chest(x, y) {
                Rgb([120, 40, 30])
            } else {
                match labels[(y * 320 + x) as usize] {
                    0 => Rgb([150 + light, 120 + light, 90]),
                    1 => Rgb([240, 240, 240]),
                    _ => Rgb([200 + light, 200 + light, 190 + light]),
                }
            }
        });
        let found = propose_regions(&photo, &labels, &RegionSettings::default());
        let best = |truth: &dyn Fn(u32, u32) -> bool| {
            let truth = Mask::from_fn(camera.size, truth);
            found
                .iter()
                .max_by(|a, b| a.mask.iou(&truth).total_cmp(&b.mask.iou(&truth)))
                .map(|r| (r, r.mask.iou(&truth)))
        };
        let (region, iou) = best(&painting).unwrap();
        assert!(iou > 0.9 && region.on_walls > 0.99 && !region.touches_floor_boundary, "{iou}");
        assert_eq!(region.surface, Some(Surface::Back));
        let (region, iou) = best(&chest).unwrap();
        assert!(iou > 0.9 && region.touches_floor_boundary && region.on_floor > 0.1, "{iou}");
        assert!(found.windows(2).all(|w| w[0].objectness >= w[1].objectness));
        assert!(propose_regions(&photo, &[], &RegionSettings::default()).iter().all(|r| r.surface.is_none()));
        let flat = RgbImage::from_pixel(64, 64, Rgb([90, 90, 90]));
        assert!(propose_regions(&flat, &[], &RegionSettings::default()).is_empty());
        assert!(propose_regions(&RgbImage::new(0, 0), &[], &RegionSettings::default()).is_empty());
    }
}
