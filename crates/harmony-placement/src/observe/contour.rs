//! The outline of a mask, and why it ends where it does: ONE answer a sample, from which everything else is read.
//!
//! A mask's edge is walked at a bounded number of samples. At each the mask ends because the object does (free),
//! because the image does (border), or because something nearer hides the rest (occluded): by the point map's depths on
//! both sides, and where those do not tell by the masks of what may be nearer. Reaches in sixteen directions and free
//! sides of boxes are majorities over samples. Image pixels, normals out of the mask. Known weak regime: without depths
//! the mask of a neighbour that merely touches may count as hiding.

use harmony_scene::{ImageSize, Level, Mask, PixelBox, Vec2};

use super::{Neighbour, border_px};
use crate::{Item, PartialScene, PlacementSettings};

/// Directions in which the reach of outlines is compared; every fourth is a side of the image.
pub(crate) const DIRECTIONS: usize = 16;

/// Samples of an outline, at most.
const MAX_SAMPLES: usize = 1500;

/// Cosine from which on a normal looks in a direction.
const TOWARDS: f64 = 0.5;

/// Why a mask ends at a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// The object itself ends there.
    Free,
    /// The image's border cuts it.
    Border,
    /// Something nearer hides the rest: by the point map, or, where that does not tell, by the mask of what may be nearer.
    Occluded,
}

/// A pixel of the outline, and why the mask ends there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Centre of the pixel, image pixels.
    pub(crate) at: Vec2,
    /// Unit vector out of the mask.
    pub(crate) normal: Vec2,
    /// Why the mask ends there.
    pub(crate) end: End,
}

/// The outline of a mask.
#[derive(Debug, Clone)]
pub(crate) struct Contour {
    samples: Vec<Sample>,
    /// Depth of the band in which an outermost part is looked at, pixels.
    band: f64,
    /// Whether an aslant corner of which something nearer makes one side is nobody's: of flat things on walls. Outlines of
    /// furniture are no rectangles, and tell aslant what their hidden sides do not.
    cornered: bool,
}

/// Unit vector of a direction: 0 is right in the image, a quarter of them down.
pub(crate) fn direction(k: usize) -> Vec2 {
    Vec2::from_angle(std::f64::consts::TAU * k as f64 / DIRECTIONS as f64)
}

impl Contour {
    /// Walks the outline of an item's mask; `others` are the masks of other objects.
    pub(crate) fn new(scene: &PartialScene, item: &Item, others: &[Neighbour], settings: &PlacementSettings) -> Self {
        let mask: &Mask = &item.mask;
        let (size, nearer) = (mask.size(), settings.noise.nearer);
        let depth_at = |(x, y): (i64, i64)| if settings.point_map { scene.depth_at(x, y) } else { None };
        let edge = edge_pixels(mask);
        let step = edge.len().div_ceil(MAX_SAMPLES).max(1);
        let bounds = mask.bounds().map(|b| b.padded(0.1, size));
        let near: Vec<&Neighbour> = others
            .iter()
            .filter(|n| n.mask.bounds().zip(bounds).is_some_and(|(b, own)| b.intersection(&own).area() > 0.0))
            .collect();
        let reason = |(x, y): (i64, i64), normal: Vec2| {
            let beyond = |by: f64| (x + (normal.x * by).round() as i64, y + (normal.y * by).round() as i64);
            let (u, v) = beyond(border_px(size));
            if u < 0 || v < 0 || u >= i64::from(size.width) || v >= i64::from(size.height) {
                return End::Border;
            }
            let here = depth_at((x, y));
            let hidden = [2.0, 4.0, 6.0].into_iter().map(beyond).any(|(u, v)| {
                // What it stands on comes nearer below it, and hides nothing.
                let stands = normal.y > TOWARDS && near.iter().any(|n| n.may_carry && n.mask.get(u, v));
                match (depth_at((u, v)), here) {
                    _ if stands => false,
                    (Some(there), Some(here)) if there < nearer * here => true,
                    (Some(there), Some(here)) if there * nearer > here => false,
                    // No depth, or as good as the same: a curtain hangs a hand's breadth before its window.
                    _ => !mask.get(u, v) && near.iter().any(|n| n.may_hide && n.mask.get(u, v)),
                }
            });
            if hidden { End::Occluded } else { End::Free }
        };
        let sample = |p: (i64, i64)| {
            let normal = outward(mask, p.0, p.1);
            Sample { at: Vec2::new(p.0 as f64 + 0.5, p.1 as f64 + 0.5), normal, end: reason(p, normal) }
        };
        let samples = edge.into_iter().step_by(step).map(sample).collect();
        Self { samples, band: band_px(size), cornered: item.level == Level::Wall }
    }

    /// How far the mask reaches in a direction, pixels, and whether it ends there by itself; strays do not count.
    pub(crate) fn reach(&self, d: Vec2) -> (f64, bool) {
        let at = |s: &Sample| s.at.dot(d) + 0.5 * (d.x.abs() + d.y.abs());
        let mut along: Vec<f64> = self.samples.iter().map(at).collect();
        if along.is_empty() {
            return (f64::NEG_INFINITY, false);
        }
        let stray = along.len() / 300;
        let reach = *along.select_nth_unstable_by(stray, |a, b| b.total_cmp(a)).1;
        // Two sides meet at an aslant corner: if what hides the object made one of them, the corner is not its own.
        let sides = [Vec2::X * d.x.signum(), Vec2::Y * d.y.signum()];
        let (mut band, mut free, mut shown) = ([0, 0], [0, 0], [0, 0]);
        for s in self.samples.iter().filter(|s| at(s) > reach - self.band) {
            let side = usize::from(s.normal.dot(sides[1]) > s.normal.dot(sides[0]));
            band[side] += 1;
            free[side] += usize::from(s.end == End::Free);
            shown[side] += usize::from(s.end != End::Occluded);
        }
        let aslant = self.cornered && d.x.abs().min(d.y.abs()) > 0.1;
        // A majority: corners of what hides belong to both.
        let most = |some: usize, band: usize| 5 * some > 2 * band;
        let free = most(free[0] + free[1], band[0] + band[1]);
        (reach, free && (!aslant || (0..2).all(|k| band[k] == 0 || most(shown[k], band[k]))))
    }

    /// Whether the mask ends by itself at each side of a box around it: left, top, right, bottom.
    pub(crate) fn free_sides(&self) -> [bool; 4] {
        [8, 12, 0, 4].map(|k| self.reach(direction(k)).1)
    }

    /// Share of the outline that looks to a side (a unit vector), in that quarter of the mask's box, and ends at something
    /// else than itself.
    pub(crate) fn cut_share(&self, b: &PixelBox, side: Vec2) -> f64 {
        let quarter = 0.25 * (b.width() * side.x.abs() + b.height() * side.y.abs());
        let outer =
            self.samples.iter().filter(|s| s.normal.dot(side) > TOWARDS && (s.at - b.centre()).dot(side) > quarter);
        let (all, cut) = outer.fold((0, 0), |(all, cut), s| (all + 1, cut + usize::from(s.end != End::Free)));
        if all > 0 { cut as f64 / f64::from(all) } else { 1.0 }
    }
}

fn band_px(size: ImageSize) -> f64 {
    (0.003 * f64::from(size.width.max(size.height))).max(2.0)
}

/// Pixels of a mask that have a neighbour outside of it.
fn edge_pixels(mask: &Mask) -> Vec<(i64, i64)> {
    let Some(b) = mask.bounds() else { return Vec::new() };
    let mut out = Vec::new();
    for y in b.y0 as i64..b.y1 as i64 {
        for x in b.x0 as i64..b.x1 as i64 {
            if mask.get(x, y) && [(-1, 0), (1, 0), (0, -1), (0, 1)].iter().any(|(u, v)| !mask.get(x + u, y + v)) {
                out.push((x, y));
            }
        }
    }
    out
}

/// The direction in which a mask ends at a pixel of its edge.
fn outward(mask: &Mask, x: i64, y: i64) -> Vec2 {
    let mut sum = Vec2::ZERO;
    for v in -2..=2 {
        for u in -2..=2 {
            if mask.get(x + u, y + v) {
                sum -= Vec2::new(u as f64, v as f64);
            }
        }
    }
    sum.normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use harmony_scene::{PointMapKind, Vec3};

    use super::*;
    use crate::RoomPoints;
    use crate::testing::{boxed, empty_room};

    fn rectangle(size: ImageSize, x: std::ops::Range<u32>, y: std::ops::Range<u32>) -> Mask {
        Mask::from_fn(size, |u, v| x.contains(&u) && y.contains(&v))
    }

    fn seen(scene: &PartialScene, mask: &Mask, level: Level) -> Item {
        Item { mask: mask.clone().into(), level, ..boxed(scene, Vec3::ONE, Vec3::new(2.0, 0.0, 2.0), 0.0) }
    }

    #[test]
    fn a_mask_reaches_as_far_as_its_box_and_ends_by_itself() {
        let scene = empty_room();
        let mask = rectangle(scene.camera.size, 100..180, 90..150);
        let contour = Contour::new(&scene, &seen(&scene, &mask, Level::Furniture), &[], &PlacementSettings::default());
        assert_eq!(contour.free_sides(), [true; 4]);
        assert_eq!(contour.reach(Vec2::X), (180.0, true));
        assert_eq!(contour.reach(Vec2::NEG_Y), (-90.0, true));
    }

    #[test]
    fn the_border_and_what_may_be_nearer_cut_and_what_may_not_does_not() {
        let scene = empty_room();
        let size = scene.camera.size;
        let mask = rectangle(size, 0..80, 90..150);
        let before = rectangle(size, 20..60, 150..170);
        let cut = |may_hide: bool| {
            let other = Neighbour { mask: &before, may_hide, may_carry: false, placed: false };
            Contour::new(&scene, &seen(&scene, &mask, Level::Furniture), &[other], &PlacementSettings::default())
                .free_sides()
        };
        assert_eq!(cut(true), [false, true, true, true], "half of the lower side is free");
        let wide = rectangle(size, 0..80, 150..170);
        let other = Neighbour { mask: &wide, may_hide: true, may_carry: false, placed: false };
        let contour =
            Contour::new(&scene, &seen(&scene, &mask, Level::Furniture), &[other], &PlacementSettings::default());
        assert_eq!(contour.free_sides(), [false, true, true, false]);
        assert_eq!(cut(false), [false, true, true, true]);
        // Where the hidden side meets a free one the corner is not a window's own.
        for (level, own) in [(Level::Wall, false), (Level::Furniture, true)] {
            let contour = Contour::new(&scene, &seen(&scene, &mask, level), &[other], &PlacementSettings::default());
            assert_eq!(contour.reach(Vec2::new(0.9, 0.4).normalize()).1, own);
            assert!(contour.reach(Vec2::new(0.9, -0.4).normalize()).1, "the upper corner is");
        }
    }

    #[test]
    fn depth_outvotes_the_masks() {
        let mut scene = empty_room();
        let size = scene.camera.size;
        let mask = rectangle(size, 100..180, 90..150);
        // Something without a mask is nearer on the right; below there is a mask of something that is not.
        let depth = |x: u32, y: u32| {
            if x >= 180 {
                1.0
            } else if y >= 150 {
                2.5
            } else {
                2.0
            }
        };
        let at = |i: usize| {
            let (x, y) = (i as u32 % size.width, i as u32 / size.width);
            scene.camera.unproject(Vec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5), depth(x, y))
        };
        let xyz: Vec<Vec3> = (0..size.pixels()).map(at).collect();
        scene.points =
            Some(RoomPoints { kind: PointMapKind::Relative, size, xyz, confidence: vec![1.0; size.pixels()] });
        let below = rectangle(size, 90..190, 150..170);
        let other = Neighbour { mask: &below, may_hide: true, may_carry: false, placed: false };
        let contour =
            Contour::new(&scene, &seen(&scene, &mask, Level::Furniture), &[other], &PlacementSettings::default());
        assert_eq!(contour.free_sides(), [true, true, false, true]);
    }
}
