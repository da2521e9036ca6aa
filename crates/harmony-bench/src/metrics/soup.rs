//! Triangle soups: what the metrics measure.

use glam::{DVec2, DVec3};
use harmony_mesh::Mesh;
use harmony_scene::{ImageSize, Intrinsics, Mask};

/// Three corners, in the frame and unit that the user of the soup states.
pub type Triangle = [DVec3; 3];

/// The mesh's triangles, each position carried by `place`; triangles with missing vertices are left out.
pub fn soup_of(mesh: &Mesh, place: impl Fn(DVec3) -> DVec3) -> Vec<Triangle> {
    let positions: Vec<DVec3> = mesh.positions.iter().map(|p| place(p.as_dvec3())).collect();
    let corner = |i: u32| positions.get(i as usize).copied();
    mesh.triangles().filter_map(|[a, b, c]| Some([corner(a)?, corner(b)?, corner(c)?])).collect()
}

/// The soup, grown by `factor` about the frame's origin.
pub fn scaled(triangles: &[Triangle], factor: f64) -> Vec<Triangle> {
    triangles.iter().map(|t| t.map(|p| p * factor)).collect()
}

/// Area of a triangle, in the square of its unit.
pub fn area(triangle: &Triangle) -> f64 {
    let [a, b, c] = triangle;
    (*b - *a).cross(*c - *a).length() / 2.0
}

/// The part of the camera frame that falls into the image: four planes through the centre, and a nearest depth.
#[derive(Debug, Clone, Copy)]
pub struct Frustum {
    /// Inward normals of the left, right, top, bottom and near plane.
    normals: [DVec3; 5],
    /// A point is inside a plane when its product with the normal is at least this.
    offsets: [f64; 5],
}

impl Frustum {
    /// The frustum of a pinhole camera at the origin of the camera frame; `near` is the nearest depth, metres.
    ///
    /// With `near` 0 only the four side planes cut: they leave nothing behind the camera.
    pub fn new(size: ImageSize, intrinsics: &Intrinsics, near: f64) -> Self {
        let low = intrinsics.direction(DVec2::ZERO);
        let high = intrinsics.direction(DVec2::new(f64::from(size.width), f64::from(size.height)));
        Self {
            normals: [
                DVec3::new(1.0, 0.0, -low.x),
                DVec3::new(-1.0, 0.0, high.x),
                DVec3::new(0.0, 1.0, -low.y),
                DVec3::new(0.0, -1.0, high.y),
                DVec3::Z,
            ],
            offsets: [0.0, 0.0, 0.0, 0.0, near],
        }
    }

    /// Whether a point of the camera frame is inside or on the border.
    pub fn contains(&self, point: DVec3) -> bool {
        self.normals.iter().zip(self.offsets).all(|(n, offset)| n.dot(point) >= offset)
    }

    /// The parts of the triangles that are inside (Sutherland and Hodgman, "Reentrant Polygon Clipping", CACM 1974).
    ///
    /// Triangles with corners that are not finite go through as they are: sampling skips and counts them.
    pub fn cut(&self, triangles: &[Triangle]) -> Vec<Triangle> {
        let mut kept = Vec::with_capacity(triangles.len());
        let (mut polygon, mut next) = (Vec::with_capacity(8), Vec::with_capacity(8));
        for triangle in triangles {
            if triangle.iter().all(|p| self.contains(*p)) || triangle.iter().any(|p| !p.is_finite()) {
                kept.push(*triangle);
                continue;
            }
            polygon.clear();
            polygon.extend_from_slice(triangle);
            for (normal, offset) in self.normals.iter().zip(self.offsets) {
                keep_inside(&polygon, *normal, offset, &mut next);
                std::mem::swap(&mut polygon, &mut next);
            }
            if let Some((first, rest)) = polygon.split_first() {
                kept.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
            }
        }
        kept
    }
}

fn keep_inside(polygon: &[DVec3], normal: DVec3, offset: f64, kept: &mut Vec<DVec3>) {
    kept.clear();
    let Some(mut before) = polygon.last().copied() else { return };
    let height = |p: DVec3| normal.dot(p) - offset;
    for &point in polygon {
        let (from, to) = (height(before), height(point));
        if (from < 0.0) != (to < 0.0) {
            kept.push(before + (point - before) * (from / (from - to)));
        }
        if to >= 0.0 {
            kept.push(point);
        }
        before = point;
    }
}

/// The surface of a depth map in the camera frame, metres: two triangles between four neighbouring pixel centres,
/// wherever all corners of the triangle are in `valid`.
///
/// `depth` is planar (along the optical axis), row by row. Nothing is cut at depth steps, as in the Gen3DSR script.
/// Departs from it in the position of pixels: ours have their centres at (0.5, 0.5), its at (0, 0).
pub fn depth_soup(depth: &[f32], intrinsics: &Intrinsics, valid: &Mask) -> Vec<Triangle> {
    let (width, height) = (valid.size().width as usize, valid.size().height as usize);
    let point = |x: usize, y: usize| {
        let i = y * width + x;
        let depth = depth.get(i).copied().filter(|d| valid.bits()[i] && d.is_finite() && *d > 0.0)?;
        Some(intrinsics.direction(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)) * f64::from(depth))
    };
    let mut triangles = Vec::new();
    for y in 1..height {
        for x in 1..width {
            let (a, b, c, d) = (point(x - 1, y - 1), point(x, y - 1), point(x - 1, y), point(x, y));
            for corners in [[a, c, b], [d, b, c]] {
                if let [Some(a), Some(b), Some(c)] = corners {
                    triangles.push([a, b, c]);
                }
            }
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn frustum() -> Frustum {
        let size = ImageSize::new(200, 100);
        // Half a width of 1 and half a height of 0.5 at depth 1.
        Frustum::new(size, &Intrinsics::centred(size, 100.0), 0.1)
    }

    fn total(triangles: &[Triangle]) -> f64 {
        triangles.iter().map(area).sum()
    }

    #[test]
    fn a_wall_is_cut_to_what_the_image_shows_of_it() {
        let wall = |z: f64| {
            let corner = |x: f64, y: f64| DVec3::new(x, y, z);
            let (a, b, c, d) = (corner(-50.0, -50.0), corner(50.0, -50.0), corner(50.0, 50.0), corner(-50.0, 50.0));
            [[a, b, c], [a, c, d]]
        };
        for z in [0.1, 1.0, 3.0] {
            let cut = frustum().cut(&wall(z));
            assert!((total(&cut) - 2.0 * z * z).abs() <= 1e-11, "{z}: {}", total(&cut));
            assert!(cut.iter().flatten().all(|p| p.x.abs() <= z + 1e-12 && p.y.abs() <= z / 2.0 + 1e-12));
        }
        assert!(total(&frustum().cut(&wall(-1.0))) == 0.0, "behind the camera");
        assert!(total(&frustum().cut(&wall(0.05))) == 0.0, "nearer than the near plane");
        let small = [[DVec3::new(0.0, 0.0, 2.0), DVec3::new(0.1, 0.0, 2.0), DVec3::new(0.0, 0.1, 2.0)]];
        assert_eq!(frustum().cut(&small), small);
    }

    proptest! {
        #[test]
        fn cutting_keeps_what_is_inside_and_nothing_else(
            corners in [[-3.0..3.0, -3.0..3.0, -3.0..3.0], [-3.0..3.0, -3.0..3.0, -3.0..3.0], [-3.0..3.0, -3.0..3.0, -3.0..3.0]],
        ) {
            let triangle = corners.map(DVec3::from_array);
            let cut = frustum().cut(&[triangle]);
            // The share of the area is the share of points: a lattice over the triangle.
            let lattice = 60;
            let mut inside = 0;
            for i in 0..lattice {
                for j in 0..lattice {
                    let (u, v) = ((i as f64 + 0.5) / lattice as f64, (j as f64 + 0.5) / lattice as f64);
                    let root = u.sqrt();
                    let [a, b, c] = triangle;
                    inside += usize::from(frustum().contains(a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v)));
                }
            }
            let share = inside as f64 / f64::from(lattice * lattice);
            let whole = area(&triangle);
            prop_assert!((total(&cut) - share * whole).abs() <= 0.04 * whole + 1e-9);
            for p in cut.iter().flatten() {
                prop_assert!(frustum().normals.iter().zip(frustum().offsets).all(|(n, o)| n.dot(*p) >= o - 1e-9));
            }
        }
    }

    #[test]
    fn a_flat_depth_map_becomes_a_wall_with_a_hole() {
        let size = ImageSize::new(5, 4);
        let k = Intrinsics::centred(size, 10.0);
        let all = Mask::from_fn(size, |_, _| true);
        let wall = depth_soup(&[2.0; 20], &k, &all);
        assert_eq!(wall.len(), 24);
        assert!((total(&wall) - 12.0 * 0.04).abs() <= 1e-9, "4 x 3 cells of 0.2 m");
        let holed = Mask::from_fn(size, |x, y| (x, y) != (1, 1));
        assert_eq!(depth_soup(&[2.0; 20], &k, &holed).len(), 24 - 6);
    }
}
