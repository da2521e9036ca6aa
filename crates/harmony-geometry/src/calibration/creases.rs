//! Where the point map bends: room edges measured by depth alone.
//!
//! A map's error is smooth, some percent over a tenth of the image: it moves a wall, but it hardly moves the crease
//! between two walls. On a plane inverse depth is linear in the pixels, so that across an edge it has a knee; where a
//! profile of the map has one that bends as the two faces must, the edge is known to some pixels, whatever is painted
//! or shaded beside it.

use harmony_scene::{ImageSize, Mat3, PointMap, Surface, Vec2, Vec3};

use super::joint::{faces_of, inverse_depth_of};
use super::lens::Lens;
use crate::RoomEdge;
use crate::room_box::pins::Pin;
use crate::room_box::solved::CameraBox;
use crate::stats::{median, median_absolute_deviation};

/// Profiles across an edge, how far they reach to both sides and how far from its expected image the knee may be;
/// shares of the image's longer side.
const PROFILES: usize = 32;
const HALF: f64 = 0.05;
const SEARCH: f64 = 0.025;
/// Map pixels on both sides of a profile that are averaged with it.
const BESIDE: i32 = 2;
/// Largest RMS of a profile about its two straight pieces, relative.
const MAX_RMS: f64 = 0.012;
/// The bend over the one that the two faces should have, and how far the slope of a piece may be from its face's,
/// in units of that bend.
const BEND: [f64; 2] = [0.6, 1.5];
const SLOPE: f64 = 0.5;
/// A knee must leave this share at most of the squares that a straight line leaves.
const MAX_LEFT: f64 = 0.5;
/// Profiles that must agree, their spread (a share of the image's longer side), one sigma of an edge that they hold.
const LEAST: usize = 6;
const MAX_SPREAD: f64 = 0.008;
const SIGMA: f64 = 0.002;

/// The map's depths, by pixels relative to the principal point ([`Lens::relative`]).
pub(super) struct Depths<'a> {
    points: &'a PointMap,
    lens: Lens,
    depth_row: Vec3,
}

impl<'a> Depths<'a> {
    pub(super) fn new(points: &'a PointMap, lens: Lens) -> Self {
        Self { points, lens, depth_row: points.rotation.transpose() * Vec3::Z }
    }

    /// Photo pixels to a pixel of the map.
    fn step(&self) -> f64 {
        f64::from(self.lens.photo.width) / f64::from(self.points.size.width.max(1))
    }

    /// Inverse planar depth, in the map's units.
    fn inverse(&self, at: Vec2) -> Option<f64> {
        let size = self.points.size;
        let scale = Vec2::new(
            f64::from(size.width) / f64::from(self.lens.photo.width),
            f64::from(size.height) / f64::from(self.lens.photo.height),
        );
        let p = self.lens.pixel(at) * scale;
        let inside = p.x >= 0.0 && p.y >= 0.0 && p.x < f64::from(size.width) && p.y < f64::from(size.height);
        let z =
            self.depth_row.dot(self.points.at(p.x as u32, p.y as u32).filter(|_| inside)?) + self.points.translation.z;
        (z > 1e-6 && z.is_finite()).then(|| 1.0 / z)
    }

    /// The mean over some map pixels along `along`.
    fn smooth(&self, at: Vec2, along: Vec2) -> Option<f64> {
        let (sum, count) = (-BESIDE..=BESIDE)
            .filter_map(|k| self.inverse(at + along * (f64::from(k) * self.step())))
            .fold((0.0, 0), |(sum, count), v| (sum + v, count + 1));
        (count > BESIDE).then(|| sum / f64::from(count))
    }
}

/// Pins where the map bends, for each edge between two faces that are seen; `group` is the first edge's.
///
/// Not the edges of the floor: what stands along a wall has such an edge with the floor as well.
pub(super) fn pins_on_creases(
    solved: &CameraBox,
    depths: &Depths,
    seen: impl Fn(Surface) -> bool,
    group: usize,
) -> Vec<Pin> {
    let rotation = solved.rotation();
    let side_px = f64::from(depths.lens.photo.width.max(depths.lens.photo.height));
    let mut out = Vec::new();
    for (k, edge) in RoomEdge::ALL.into_iter().enumerate() {
        if !faces_of(edge).into_iter().all(|f| f != Surface::Floor && seen(f)) {
            continue;
        }
        let Some([start, end]) = image_of(solved, &rotation, edge, depths.lens.photo) else { continue };
        let along = (end - start).normalize_or_zero();
        let knees: Vec<(Vec2, f64)> = (0..PROFILES)
            .filter_map(|i| {
                let at = start.lerp(end, (i as f64 + 0.5) / PROFILES as f64);
                let off = Profile::new(solved, &rotation, edge, depths, at, along, side_px)?.knee(side_px)?;
                Some((at, off))
            })
            .collect();
        if knees.len() < LEAST {
            continue;
        }
        let offsets: Vec<f64> = knees.iter().map(|k| k.1).collect();
        let Some((middle, deviation)) = median_absolute_deviation(&offsets) else { continue };
        let spread = 1.48 * deviation;
        if spread > MAX_SPREAD * side_px {
            continue;
        }
        let near = |off: f64| (off - middle).abs() <= 2.5 * spread.max(depths.step());
        let points: Vec<Vec2> =
            knees.iter().filter(|k| near(k.1)).map(|(at, off)| *at + across(along) * *off).collect();
        // Profiles side by side share their error.
        let sigma = SIGMA * side_px * (points.len() as f64).sqrt();
        out.extend(points.into_iter().map(|point| Pin { edge, point, sigma, group: group + k, given: false }));
    }
    out
}

fn across(along: Vec2) -> Vec2 {
    Vec2::new(-along.y, along.x)
}

/// The part of an edge that is in the image: two pixels relative to the principal point.
fn image_of(solved: &CameraBox, rotation: &Mat3, edge: RoomEdge, photo: ImageSize) -> Option<[Vec2; 2]> {
    let (p, d) = solved.edge(edge);
    let [low, high] = match edge {
        RoomEdge::FloorBack | RoomEdge::CeilingBack => [-solved.left, solved.right],
        RoomEdge::BackLeft | RoomEdge::BackRight => [-solved.floor, solved.ceiling],
        _ => [-solved.back, 0.0],
    };
    let half = Vec2::new(f64::from(photo.width), f64::from(photo.height)) / 2.0;
    let seen: Vec<Vec2> = (0..=200)
        .filter_map(|i| {
            let q = *rotation * (p + d * (low + (high - low) * f64::from(i) / 200.0));
            let at = Vec2::new(q.x, q.y) * solved.focal / q.z;
            (q.z > 0.05 && at.abs().cmple(half).all()).then_some(at)
        })
        .collect();
    Some([*seen.first()?, *seen.last()?])
}

/// Inverse depths across an edge, over the one at its middle.
struct Profile {
    /// Offset, photo pixels, and value.
    values: Vec<(f64, f64)>,
    /// Slopes that the faces on the negative and the positive side should have, per pixel.
    slopes: [f64; 2],
    half: f64,
}

impl Profile {
    fn new(
        solved: &CameraBox,
        rotation: &Mat3,
        edge: RoomEdge,
        depths: &Depths,
        at: Vec2,
        along: Vec2,
        side_px: f64,
    ) -> Option<Self> {
        let (half, step) = (HALF * side_px, depths.step());
        let count = (half / step) as i32;
        let normal = across(along);
        let raw: Vec<(f64, f64)> = (-count..=count)
            .filter_map(|j| {
                let off = f64::from(j) * step;
                Some((off, depths.smooth(at + normal * off, along)?))
            })
            .collect();
        if raw.len() < (1.6 * f64::from(count)) as usize {
            return None;
        }
        let middle = median(&raw.iter().map(|v| v.1).collect::<Vec<_>>())?;
        // 1 / depth of a face along the profile, over its value at the edge.
        let slope = |face: Surface| {
            let at_edge = inverse_depth(solved, rotation, face, at)?;
            Some((inverse_depth(solved, rotation, face, at + normal)? - at_edge) / at_edge)
        };
        let [Some(a), Some(b)] = faces_of(edge).map(slope) else { return None };
        // The room is in front of both faces: what is nearer counts, so that the slope grows across the edge.
        Some(Self {
            values: raw.into_iter().map(|(off, v)| (off, v / middle)).collect(),
            slopes: [a.min(b), a.max(b)],
            half,
        })
    }

    /// Offset of the knee, photo pixels.
    fn knee(&self, side_px: f64) -> Option<f64> {
        let search = SEARCH * side_px;
        let step = 2.0 * self.half / self.values.len() as f64;
        let count = (search / step) as i32;
        let fits: Vec<(f64, Fit)> = (-count..=count)
            .filter_map(|k| {
                let at = f64::from(k) * step;
                Some((at, Fit::new(&self.values, at)?))
            })
            .collect();
        let best = (1..fits.len().checked_sub(1)?).min_by(|a, b| fits[*a].1.rss.total_cmp(&fits[*b].1.rss))?;
        let (at, fit) = &fits[best];
        let before = fits[best - 1].1.rss;
        let after = fits[best + 1].1.rss;
        // At the end of the search there is no minimum.
        if before <= fit.rss || after <= fit.rss {
            return None;
        }
        let bend = self.slopes[1] - self.slopes[0];
        let per_value = 1.0 / fit.value;
        let sound = (fit.rss / self.values.len() as f64).sqrt() * per_value <= MAX_RMS
            && (BEND[0]..=BEND[1]).contains(&(fit.bend * per_value / bend))
            && (fit.slope * per_value - self.slopes[0]).abs() <= SLOPE * bend
            && fit.rss <= MAX_LEFT * Fit::straight(&self.values);
        // The parabola through three neighbours.
        let finer = 0.5 * (before - after) / (before - 2.0 * fit.rss + after);
        sound.then_some(at + finer * step)
    }
}

/// `value + slope (x - at) + bend max(0, x - at)`.
struct Fit {
    value: f64,
    slope: f64,
    bend: f64,
    rss: f64,
}

impl Fit {
    fn new(values: &[(f64, f64)], at: f64) -> Option<Self> {
        let mut normal = Mat3::ZERO;
        let (mut right, mut squares) = (Vec3::ZERO, 0.0);
        for (x, v) in values {
            let row = Vec3::new(1.0, x - at, (x - at).max(0.0));
            normal += Mat3::from_cols(row * row.x, row * row.y, row * row.z);
            right += row * *v;
            squares += v * v;
        }
        (normal.determinant().abs() > 1e-9).then(|| {
            let s = normal.inverse() * right;
            Self { value: s.x, slope: s.y, bend: s.z, rss: (squares - s.dot(right)).max(0.0) }
        })
    }

    /// Squares left by a straight line.
    fn straight(values: &[(f64, f64)]) -> f64 {
        let n = values.len() as f64;
        let (sx, sv) = values.iter().fold((0.0, 0.0), |s, (x, v)| (s.0 + x, s.1 + v));
        let (mx, mv) = (sx / n, sv / n);
        let (sxx, sxv, svv) = values.iter().fold((0.0, 0.0, 0.0), |s, (x, v)| {
            (s.0 + (x - mx).powi(2), s.1 + (x - mx) * (v - mv), s.2 + (v - mv).powi(2))
        });
        svv - sxv * sxv / sxx.max(1e-12)
    }
}

/// [`inverse_depth_of`] at a pixel relative to the principal point.
fn inverse_depth(solved: &CameraBox, rotation: &Mat3, face: Surface, at: Vec2) -> Option<f64> {
    let ray = rotation.transpose() * Vec3::new(at.x / solved.focal, at.y / solved.focal, 1.0);
    inverse_depth_of(solved, face, ray)
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Intrinsics, PointMapKind};

    use super::*;

    const PHOTO: ImageSize = ImageSize { width: 960, height: 640 };

    fn room() -> CameraBox {
        CameraBox {
            focal: 700.0,
            yaw: 0.15,
            tilt: 0.08,
            roll: 0.0,
            left: 1.6,
            right: 2.5,
            floor: 1.5,
            ceiling: 1.1,
            back: 4.0,
            shift: 0.0,
        }
    }

    /// A map of half the photo's size whose depths are those of the room times `error` of the place (0 to 1 each way).
    fn map(room: &CameraBox, error: impl Fn(f64, f64) -> f64) -> PointMap {
        let size = ImageSize::new(PHOTO.width / 2, PHOTO.height / 2);
        let rotation = room.rotation();
        let faces = [Surface::Left, Surface::Right, Surface::Floor, Surface::Ceiling, Surface::Back];
        let mut depth = Vec::new();
        for y in 0..size.height {
            for x in 0..size.width {
                let (u, v) = ((f64::from(x) + 0.5) * 2.0, (f64::from(y) + 0.5) * 2.0);
                let at = Vec2::new(u - f64::from(PHOTO.width) / 2.0, v - f64::from(PHOTO.height) / 2.0);
                let nearest = faces.iter().filter_map(|f| inverse_depth(room, &rotation, *f, at)).fold(0.0, f64::max);
                let share = error(u / f64::from(PHOTO.width), v / f64::from(PHOTO.height));
                depth.push((share / nearest) as f32);
            }
        }
        PointMap::from_depth(PointMapKind::Relative, size, Intrinsics::centred(size, room.focal / 2.0), &depth)
    }

    fn depths(points: &PointMap) -> Depths<'_> {
        Depths::new(points, Lens::of(points, PHOTO))
    }

    /// Four percent, waves of a third of the image.
    fn smooth(x: f64, y: f64) -> f64 {
        1.0 + 0.04 * (19.0 * x + 1.0).sin() * (17.0 * y).cos()
    }

    /// Mean distance of an edge's pins to the true edge, pixels; `None` without pins.
    fn off(pins: &[Pin], edge: RoomEdge) -> Option<f64> {
        let (room, here) = (room(), pins.iter().filter(|p| p.edge == edge).collect::<Vec<_>>());
        let sum: f64 = here.iter().map(|p| room.distance_to_edge(&room.rotation(), edge, p.point)).sum();
        (!here.is_empty()).then(|| sum / here.len() as f64)
    }

    #[test]
    fn edges_are_where_a_map_with_a_smooth_error_bends() {
        let points = map(&room(), smooth);
        // Expected some ten pixels beside where it is.
        let expected = CameraBox { left: 1.68, ceiling: 1.15, ..room() };
        let edge = RoomEdge::BackLeft;
        let at = expected.edge(edge);
        let image = |c: Vec3| Vec2::new(c.x, c.y) * room().focal / c.z;
        let beside = room().distance_to_edge(&room().rotation(), edge, image(expected.rotation() * at.0)).abs();
        assert!(beside > 8.0, "{beside}");
        let pins = pins_on_creases(&expected, &depths(&points), |_| true, 3);
        for edge in [RoomEdge::BackLeft, RoomEdge::CeilingBack, RoomEdge::CeilingLeft] {
            let off = off(&pins, edge).unwrap_or(f64::NAN);
            assert!(off.abs() < 2.5, "{edge:?} {off}");
        }
        // What stands on the floor along a wall bends there too.
        assert!(pins.iter().all(|p| !faces_of(p.edge).contains(&Surface::Floor)));
    }

    #[test]
    fn without_a_bend_or_a_face_there_is_no_pin() {
        // A flat picture of the room: depth says nothing.
        let flat = map(&CameraBox { left: 90.0, right: 90.0, floor: 90.0, ceiling: 90.0, ..room() }, |_, _| 1.0);
        let none = |seen: fn(Surface) -> bool, points: &PointMap| {
            pins_on_creases(&room(), &depths(points), seen, 0).iter().all(|p| p.edge != RoomEdge::BackLeft)
        };
        assert!(none(|_| true, &flat));
        let points = map(&room(), |_, _| 1.0);
        assert!(none(|s| s != Surface::Left, &points) && !none(|_| true, &points));
    }

    #[test]
    fn what_stands_in_the_corner_is_no_crease_of_the_walls() {
        // Something round before the corner, nearer by a tenth to a fifth.
        let points = map(&room(), |x, _| if (0.05..0.35).contains(&x) { 0.85 + 0.3 * (x - 0.2).powi(2) } else { 1.0 });
        let pins = pins_on_creases(&room(), &depths(&points), |_| true, 0);
        assert!(pins.iter().all(|p| p.edge != RoomEdge::BackLeft), "{pins:?}");
    }
}
