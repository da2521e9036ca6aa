//! Straight edges of a grey image.
//!
//! The scheme of LSD (R. Grompone von Gioi, J. Jakubowicz, J.-M. Morel, G. Randall, "LSD: a Line Segment Detector",
//! IPOL 2012): pixels with a common gradient direction are grown into regions, strongest first; a region becomes a
//! rectangle by its second moments; a rectangle that chance could make is dropped. Ours differs: the number of false
//! alarms is bounded by Chernoff's inequality instead of summing the binomial tail, rectangles are thinned by raising
//! the tolerance only, and collinear pieces are joined afterwards. Weak regime: curved and very faint edges.

use harmony_scene::Vec2;
use serde::{Deserialize, Serialize};

use crate::GrayImage;

/// Images are averaged down to this many pixels on the longer side before looking.
const WORKING_PX: u32 = 960;
/// Directions within this angle belong together, degrees.
const TOLERANCE_DEG: f64 = 22.5;
/// Least gradient, luma a pixel: the quantisation of 8 bits (2 grey levels) seen through the tolerance.
const MIN_GRADIENT: f32 = 5.2 / 255.0;
/// Share of a rectangle's area that its region covers.
const MIN_DENSITY: f64 = 0.6;
/// Shortest segment, pixels of the working image.
const SHORTEST_PX: f64 = 9.0;
/// Pieces are joined within this angle, offset and gap (of the shorter piece's length).
const JOIN_DEG: f64 = 1.2;
const JOIN_OFFSET_PX: f64 = 1.2;
const JOIN_GAP: f64 = 1.0;

/// A straight edge of the image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LineSegment {
    /// One end, pixels; going from `start` to `end` the brighter side is on the right (image y down).
    pub start: Vec2,
    /// Other end, pixels.
    pub end: Vec2,
    /// Mean gradient magnitude across it, luma (0..1) a pixel.
    pub strength: f64,
}

impl LineSegment {
    /// Length, pixels.
    pub fn length(&self) -> f64 {
        self.start.distance(self.end)
    }

    /// Middle, pixels.
    pub fn middle(&self) -> Vec2 {
        (self.start + self.end) / 2.0
    }

    /// Unit direction from start to end; zero for a point.
    pub fn direction(&self) -> Vec2 {
        (self.end - self.start).normalize_or_zero()
    }
}

/// Finds the straight edges of an image, longest first; pixels of the image as given.
pub fn detect_segments(image: &GrayImage) -> Vec<LineSegment> {
    let small = image.fit_within(WORKING_PX);
    let size = small.size();
    if size.width < 4 || size.height < 4 {
        return Vec::new();
    }
    let field = Field::new(&small);
    let mut found = join(grow_all(&field));
    let k = Vec2::new(
        f64::from(image.size().width) / f64::from(size.width),
        f64::from(image.size().height) / f64::from(size.height),
    );
    for s in &mut found {
        (s.start, s.end) = (s.start * k, s.end * k);
    }
    found.sort_by(|a, b| b.length().total_cmp(&a.length()));
    found
}

/// Gradient on the corners between pixels: entry (x, y) lies at pixel position (x + 1, y + 1).
struct Field {
    width: usize,
    height: usize,
    magnitude: Vec<f32>,
    /// Direction along the edge (gradient turned by -90 degrees: the brighter side is on the right), radians.
    angle: Vec<f32>,
}

impl Field {
    fn new(image: &GrayImage) -> Self {
        let smooth = smooth(image);
        let (w, h) = (image.size().width as usize, image.size().height as usize);
        let (width, height) = (w - 1, h - 1);
        let mut magnitude = vec![0.0; width * height];
        let mut angle = vec![0.0; width * height];
        for y in 0..height {
            for x in 0..width {
                let [a, b] = [smooth[y * w + x], smooth[y * w + x + 1]];
                let [c, d] = [smooth[(y + 1) * w + x], smooth[(y + 1) * w + x + 1]];
                let gx = (b + d - a - c) / 2.0;
                let gy = (c + d - a - b) / 2.0;
                magnitude[y * width + x] = (gx * gx + gy * gy).sqrt();
                // With y down, turning by -90 degrees takes (gx, gy) to (gy, -gx); its right side is (gx, gy).
                angle[y * width + x] = (-gx).atan2(gy);
            }
        }
        Self { width, height, magnitude, angle }
    }
}

/// A small binomial blur, [1 4 6 4 1] / 16 mixed down to sigma 0.7: JPEG blocks and sensor grain.
fn smooth(image: &GrayImage) -> Vec<f32> {
    const KERNEL: [f32; 5] = [0.01, 0.2, 0.58, 0.2, 0.01];
    let (w, h) = (image.size().width as usize, image.size().height as usize);
    let mut across = vec![0.0f32; w * h];
    for (row_in, row_out) in image.luma().chunks_exact(w).zip(across.chunks_exact_mut(w)) {
        for (x, out) in row_out.iter_mut().enumerate() {
            *out = (0..5).map(|k| KERNEL[k] * row_in[(x + k).saturating_sub(2).min(w - 1)]).sum();
        }
    }
    let mut out = vec![0.0f32; w * h];
    for (y, row_out) in out.chunks_exact_mut(w).enumerate() {
        for (k, weight) in KERNEL.iter().enumerate() {
            let from = (y + k).saturating_sub(2).min(h - 1) * w;
            for (o, v) in row_out.iter_mut().zip(&across[from..from + w]) {
                *o += weight * v;
            }
        }
    }
    out
}

fn grow_all(field: &Field) -> Vec<LineSegment> {
    let mut seeds: Vec<u32> =
        (0..field.magnitude.len() as u32).filter(|i| field.magnitude[*i as usize] >= MIN_GRADIENT).collect();
    // Strongest first, in 1024 steps, so that the order inside a step is the image's.
    let strongest = field.magnitude.iter().fold(0.0f32, |m, v| m.max(*v)).max(f32::MIN_POSITIVE);
    seeds.sort_by_key(|i| std::cmp::Reverse((field.magnitude[*i as usize] / strongest * 1023.0) as u32));

    let mut used = vec![false; field.magnitude.len()];
    let mut region = Vec::new();
    let mut out = Vec::new();
    // ln of the number of rectangles one could test, (W H)^2.5.
    let tests = 2.5 * ((field.width * field.height) as f64).ln();
    for seed in seeds {
        if used[seed as usize] {
            continue;
        }
        let mut tolerance = TOLERANCE_DEG.to_radians();
        grow(field, &mut used, seed, tolerance, &mut region);
        let mut rectangle = fit(field, &region);
        if rectangle.density(region.len()) < MIN_DENSITY && region.len() > 8 {
            // A bend: keep only what agrees more closely with the seed.
            for i in &region {
                used[*i as usize] = false;
            }
            tolerance /= 2.0;
            grow(field, &mut used, seed, tolerance, &mut region);
            rectangle = fit(field, &region);
        }
        if rectangle.length < SHORTEST_PX || rectangle.density(region.len()) < MIN_DENSITY {
            continue;
        }
        if rectangle.log_chance(region.len(), tolerance) + tests > 0.0 {
            continue;
        }
        let half = rectangle.direction * (rectangle.length / 2.0);
        out.push(LineSegment {
            start: rectangle.centre - half,
            end: rectangle.centre + half,
            strength: rectangle.strength,
        });
    }
    out
}

/// Grows a region of like direction from a seed; its pixels become used.
fn grow(field: &Field, used: &mut [bool], seed: u32, tolerance: f64, region: &mut Vec<u32>) {
    region.clear();
    region.push(seed);
    used[seed as usize] = true;
    let start = f64::from(field.angle[seed as usize]);
    let (mut sin, mut cos) = start.sin_cos();
    let least = tolerance.cos();
    let mut next = 0;
    while next < region.len() {
        let (x, y) = (region[next] as usize % field.width, region[next] as usize / field.width);
        next += 1;
        let norm = (sin * sin + cos * cos).sqrt();
        for ny in y.saturating_sub(1)..(y + 2).min(field.height) {
            for nx in x.saturating_sub(1)..(x + 2).min(field.width) {
                let i = ny * field.width + nx;
                if used[i] || field.magnitude[i] < MIN_GRADIENT {
                    continue;
                }
                let (s, c) = f64::from(field.angle[i]).sin_cos();
                if s * sin + c * cos >= least * norm {
                    used[i] = true;
                    region.push(i as u32);
                    sin += s;
                    cos += c;
                }
            }
        }
    }
}

struct Rectangle {
    centre: Vec2,
    direction: Vec2,
    length: f64,
    width: f64,
    strength: f64,
}

impl Rectangle {
    fn density(&self, pixels: usize) -> f64 {
        pixels as f64 / (self.length * self.width).max(1.0)
    }

    /// Upper bound (Chernoff) of the logarithm of the chance that so many of its pixels agree by accident.
    fn log_chance(&self, pixels: usize, tolerance: f64) -> f64 {
        let n = (self.length * self.width).max(pixels as f64);
        let p = tolerance / std::f64::consts::PI;
        let q = (pixels as f64 / n).min(1.0 - 1e-9);
        if q <= p {
            return 0.0;
        }
        -n * (q * (q / p).ln() + (1.0 - q) * ((1.0 - q) / (1.0 - p)).ln())
    }
}

/// The rectangle of a region by magnitude-weighted moments.
fn fit(field: &Field, region: &[u32]) -> Rectangle {
    let at = |i: u32| Vec2::new((i as usize % field.width) as f64 + 1.0, (i as usize / field.width) as f64 + 1.0);
    let (mut total, mut centre) = (0.0, Vec2::ZERO);
    let mut mean = Vec2::ZERO;
    for i in region {
        let m = f64::from(field.magnitude[*i as usize]);
        total += m;
        centre += at(*i) * m;
        mean += Vec2::from_angle(f64::from(field.angle[*i as usize])) * m;
    }
    let centre = centre / total.max(f64::MIN_POSITIVE);
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for i in region {
        let m = f64::from(field.magnitude[*i as usize]);
        let d = at(*i) - centre;
        xx += m * d.x * d.x;
        yy += m * d.y * d.y;
        xy += m * d.x * d.y;
    }
    let mut direction = Vec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy));
    if direction.dot(mean) < 0.0 {
        direction = -direction;
    }
    let (mut low, mut high, mut wide) = (0.0f64, 0.0f64, 0.0f64);
    for i in region {
        let d = at(*i) - centre;
        let along = d.dot(direction);
        (low, high) = (low.min(along), high.max(along));
        wide = wide.max(d.perp_dot(direction).abs());
    }
    Rectangle {
        centre: centre + direction * f64::midpoint(low, high),
        direction,
        length: high - low,
        width: (2.0 * wide).max(1.0),
        strength: total / region.len().max(1) as f64,
    }
}

/// Joins collinear pieces of one edge (same direction, same polarity), longest first.
fn join(mut pieces: Vec<LineSegment>) -> Vec<LineSegment> {
    pieces.sort_by(|a, b| b.length().total_cmp(&a.length()));
    let mut out: Vec<LineSegment> = Vec::with_capacity(pieces.len());
    for piece in pieces {
        let fits = |host: &LineSegment| {
            let d = host.direction();
            if d.dot(piece.direction()) < JOIN_DEG.to_radians().cos() {
                return false;
            }
            let offset = |p: Vec2| (p - host.middle()).perp_dot(d).abs();
            if offset(piece.start).max(offset(piece.end)) > JOIN_OFFSET_PX {
                return false;
            }
            let half = host.length() / 2.0;
            let (a, b) = ((piece.start - host.middle()).dot(d), (piece.end - host.middle()).dot(d));
            let gap = (a.min(b) - half).max(-half - a.max(b));
            gap <= JOIN_GAP * piece.length()
        };
        match out.iter_mut().find(|host| fits(host)) {
            Some(host) => *host = joined(host, &piece),
            None => out.push(piece),
        }
    }
    out
}

/// One segment over both: the line by length-weighted ends, the ends where they reach.
fn joined(host: &LineSegment, piece: &LineSegment) -> LineSegment {
    let (a, b) = (host.length(), piece.length());
    let total = a + b;
    let centre = (host.middle() * a + piece.middle() * b) / total;
    // Second moments of two uniform rods.
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (rod, length) in [(host, a), (piece, b)] {
        let (c, d) = (rod.middle() - centre, rod.direction() * length);
        xx += length * (c.x * c.x + d.x * d.x / 12.0);
        yy += length * (c.y * c.y + d.y * d.y / 12.0);
        xy += length * (c.x * c.y + d.x * d.y / 12.0);
    }
    let mut direction = Vec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy));
    if direction.dot(host.direction()) < 0.0 {
        direction = -direction;
    }
    let along = [host.start, host.end, piece.start, piece.end].map(|p| (p - centre).dot(direction));
    let low = along.iter().copied().fold(f64::INFINITY, f64::min);
    let high = along.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    LineSegment {
        start: centre + direction * low,
        end: centre + direction * high,
        strength: (host.strength * a + piece.strength * b) / total,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmony_scene::ImageSize;

    /// A white convex quad on dark ground, sampled 4 x 4 a pixel.
    fn quad(size: ImageSize, corners: [Vec2; 4]) -> GrayImage {
        let inside = |p: Vec2| (0..4).all(|i| (corners[(i + 1) % 4] - corners[i]).perp_dot(p - corners[i]) >= 0.0);
        let bytes: Vec<u8> = (0..size.pixels())
            .map(|i| {
                let (x, y) = (f64::from(i as u32 % size.width), f64::from(i as u32 / size.width));
                let hits = (0..16)
                    .filter(|k| {
                        inside(Vec2::new(x + (f64::from(k % 4) + 0.5) / 4.0, y + (f64::from(k / 4) + 0.5) / 4.0))
                    })
                    .count();
                40 + (hits * 10) as u8
            })
            .collect();
        GrayImage::from_luma8(size, &bytes).unwrap()
    }

    #[test]
    fn the_sides_of_a_quad_are_found_to_a_fraction_of_a_pixel() {
        let corners = [Vec2::new(60.3, 40.7), Vec2::new(250.2, 62.4), Vec2::new(231.8, 171.6), Vec2::new(45.1, 190.9)];
        let found = detect_segments(&quad(ImageSize::new(320, 240), corners));
        assert_eq!(found.len(), 4, "{found:?}");
        for i in 0..4 {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let side = (b - a).normalize();
            let best = found
                .iter()
                .min_by(|s, t| {
                    let off = |s: &LineSegment| (s.middle() - a).perp_dot(side).abs();
                    off(s).total_cmp(&off(t))
                })
                .unwrap();
            assert!((best.middle() - a).perp_dot(side).abs() <= 0.25, "side {i} offset");
            let turn = best.direction().dot(side).abs().min(1.0).acos().to_degrees();
            assert!(turn <= 0.4, "side {i} direction off by {turn:.2} degrees");
            // The corners go clockwise on the screen: the bright inside is on the right.
            assert!(best.direction().dot(side) > 0.0, "polarity");
            assert!((best.length() - a.distance(b)).abs() <= 6.0);
        }
    }

    #[test]
    fn noise_and_blank_images_have_no_lines() {
        let size = ImageSize::new(200, 150);
        assert!(detect_segments(&GrayImage::from_luma8(size, &vec![128; size.pixels()]).unwrap()).is_empty());
        let mut seed = 7u32;
        let noise: Vec<u8> = (0..size.pixels())
            .map(|_| {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (seed >> 24) as u8
            })
            .collect();
        let found = detect_segments(&GrayImage::from_luma8(size, &noise).unwrap());
        assert!(found.len() <= 2, "{} lines in noise", found.len());
    }
}
