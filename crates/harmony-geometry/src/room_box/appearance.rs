//! Whether the faces of a box differ in colour.
//!
//! Wall, floor and ceiling mostly have colours of their own, and two walls differ in shading. So a box whose faces
//! tell more about the colour of a pixel explains the picture better: the mutual information of face and colour
//! cluster over a coarse grid of pixels. Furniture blurs it and does not turn it round.

use harmony_scene::{Mat3, Vec2, Vec3};

use super::solved::CameraBox;
use crate::GrayImage;

/// Colour clusters.
const CLUSTERS: usize = 10;
/// Rounds of k-means.
const ROUNDS: usize = 12;

/// Colour clusters on a coarse grid.
pub(super) struct Appearance {
    /// Rays of the samples, room axes.
    rays: Vec<Vec3>,
    cluster: Vec<u8>,
}

impl Appearance {
    /// `half` is half the photo in pixels, `focal` in the same; `None` for an image without colour differences.
    pub fn new(image: &GrayImage, rotation: &Mat3, focal: f64, half: Vec2) -> Option<Self> {
        let (size, pixels) = image.thumbnail();
        let cluster = clusters(pixels)?;
        let room_from_camera = rotation.transpose();
        let rays = (0..size.pixels())
            .map(|i| {
                let (x, y) = (i as u32 % size.width, i as u32 / size.width);
                let u = (f64::from(x) + 0.5) / f64::from(size.width) * 2.0 - 1.0;
                let v = (f64::from(y) + 0.5) / f64::from(size.height) * 2.0 - 1.0;
                room_from_camera * Vec3::new(u * half.x, v * half.y, focal)
            })
            .collect();
        Some(Self { rays, cluster })
    }

    /// Mutual information of face and colour, nats a sample.
    pub fn information(&self, b: &CameraBox) -> f64 {
        let mut table = [[0u32; CLUSTERS]; 6];
        for (ray, cluster) in self.rays.iter().zip(&self.cluster) {
            table[face(b, *ray)][usize::from(*cluster)] += 1;
        }
        let total = self.rays.len().max(1) as f64;
        let mut by_cluster = [0.0; CLUSTERS];
        let mut information = 0.0;
        for row in &table {
            for (sum, n) in by_cluster.iter_mut().zip(row) {
                *sum += f64::from(*n) / total;
            }
        }
        for row in &table {
            let face = row.iter().map(|n| f64::from(*n)).sum::<f64>() / total;
            for (n, of_cluster) in row.iter().zip(by_cluster) {
                let joint = f64::from(*n) / total;
                if joint > 0.0 {
                    information += joint * (joint / (face * of_cluster)).ln();
                }
            }
        }
        information
    }
}

/// Face that a ray from the camera meets: 0 left, 1 right, 2 floor, 3 ceiling, 4 back, 5 front.
pub(super) fn face(b: &CameraBox, ray: Vec3) -> usize {
    let reach = |d: f64, low: f64, high: f64| if d < 0.0 { low / -d } else { high / d.max(1e-12) };
    let x = reach(ray.x, b.left, b.right);
    let y = reach(ray.y, b.floor, b.ceiling);
    let z = reach(ray.z, b.back, f64::INFINITY);
    if x <= y && x <= z {
        usize::from(ray.x >= 0.0)
    } else if y <= z {
        2 + usize::from(ray.y >= 0.0)
    } else {
        4 + usize::from(ray.z >= 0.0)
    }
}

/// k-means in a roughly even colour space; deterministic (farthest-point start).
fn clusters(pixels: &[[f32; 3]]) -> Option<Vec<u8>> {
    let points: Vec<[f32; 3]> = pixels
        .iter()
        .map(|[r, g, b]| {
            // Brightness, red against green, yellow against blue; colour counts more than brightness.
            [0.299 * r + 0.587 * g + 0.114 * b, 1.5 * (r - g), 0.75 * (r + g - 2.0 * b)]
        })
        .collect();
    let distance = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>();
    let mut centres = vec![*points.first()?];
    let mut nearest: Vec<f32> = points.iter().map(|p| distance(p, &centres[0])).collect();
    while centres.len() < CLUSTERS {
        let (far, d) = nearest.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        if d < 1e-4 {
            break;
        }
        let centre = points[far];
        for (n, p) in nearest.iter_mut().zip(&points) {
            *n = n.min(distance(p, &centre));
        }
        centres.push(centre);
    }
    if centres.len() < 2 {
        return None;
    }
    let mut label = vec![0u8; points.len()];
    for _ in 0..ROUNDS {
        let mut sums = vec![([0.0f32; 3], 0.0f32); centres.len()];
        for (l, p) in label.iter_mut().zip(&points) {
            let best = (0..centres.len())
                .min_by(|a, b| distance(p, &centres[*a]).total_cmp(&distance(p, &centres[*b])))
                .unwrap_or(0);
            *l = best as u8;
            let (sum, n) = &mut sums[best];
            for k in 0..3 {
                sum[k] += p[k];
            }
            *n += 1.0;
        }
        for (centre, (sum, n)) in centres.iter_mut().zip(&sums) {
            if *n > 0.0 {
                *centre = sum.map(|v| v / n);
            }
        }
    }
    Some(label)
}
