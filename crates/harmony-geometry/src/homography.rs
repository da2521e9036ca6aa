//! Plane-to-plane maps.

use harmony_scene::{Mat3, Vec2, Vec3};

/// A projective map of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homography {
    /// The 3x3 matrix H, up to scale.
    pub matrix: Mat3,
}

impl Homography {
    /// Maps a point; `None` when it goes to infinity.
    pub fn point(&self, p: Vec2) -> Option<Vec2> {
        let q = self.matrix * Vec3::new(p.x, p.y, 1.0);
        (q.z.abs() > 1e-12).then(|| Vec2::new(q.x / q.z, q.y / q.z))
    }

    /// The inverse map; `None` when the map is singular.
    pub fn inverse(&self) -> Option<Self> {
        let scale = self.matrix.to_cols_array().iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let unit = self.matrix * (1.0 / scale);
        (unit.is_finite() && unit.determinant().abs() > 1e-14).then(|| Self { matrix: unit.inverse() })
    }
}

/// The homography that takes the four `source` points to the four `target` points, in order.
///
/// Closed form through the unit square (P. Heckbert, "Fundamentals of Texture Mapping and Image Warping",
/// 1989, Sec. 2.2.2). `None` when three of the points of a quad lie on a line.
pub fn homography_from_quad(source: [Vec2; 4], target: [Vec2; 4]) -> Option<Homography> {
    let from_unit = quad_from_unit_square(source)?;
    let to = quad_from_unit_square(target)?;
    let inverse = Homography { matrix: from_unit }.inverse()?;
    let matrix = to * inverse.matrix;
    matrix.is_finite().then_some(Homography { matrix })
}

/// The map of (0,0), (1,0), (1,1), (0,1) onto a quad's points, in order.
fn quad_from_unit_square(p: [Vec2; 4]) -> Option<Mat3> {
    let size = p.iter().fold(0.0f64, |m, q| m.max(q.distance(p[0])));
    for i in 0..4 {
        let (a, b, c) = (p[i], p[(i + 1) % 4], p[(i + 2) % 4]);
        // Three points that span next to nothing are a line.
        let area = (b - a).perp_dot(c - a).abs();
        if area.is_nan() || area <= 1e-9 * size * size {
            return None;
        }
    }
    let s = p[0] - p[1] + p[2] - p[3];
    let d1 = p[1] - p[2];
    let d2 = p[3] - p[2];
    let det = d1.perp_dot(d2);
    let g = s.perp_dot(d2) / det;
    let h = d1.perp_dot(s) / det;
    let c0 = p[1] - p[0] + g * p[1];
    let c1 = p[3] - p[0] + h * p[3];
    Some(Mat3::from_cols(Vec3::new(c0.x, c0.y, g), Vec3::new(c1.x, c1.y, h), Vec3::new(p[0].x, p[0].y, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn quad(seed: [f64; 8], size: f64) -> [Vec2; 4] {
        // A square whose corners move by less than half its side, so it stays convex.
        [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| {
            let i = (x + 2.0 * y) as usize * 2;
            Vec2::new(x + 0.24 * seed[i], y + 0.24 * seed[i + 1]) * size + Vec2::new(40.0, -7.0)
        })
    }

    proptest! {
        #[test]
        fn corners_land_and_lines_stay_lines(
            a in prop::array::uniform8(-1.0f64..1.0), b in prop::array::uniform8(-1.0f64..1.0), k in 0.1f64..0.9,
        ) {
            let (source, target) = (quad(a, 300.0), quad(b, 2.0));
            let h = homography_from_quad(source, target).unwrap();
            let back = h.inverse().unwrap();
            for (s, t) in source.iter().zip(target) {
                prop_assert!(h.point(*s).unwrap().distance(t) <= 1e-9);
                prop_assert!(back.point(t).unwrap().distance(*s) <= 1e-6);
            }
            let ends = [h.point(source[0]).unwrap(), h.point(source[2]).unwrap()];
            let between = h.point(source[0].lerp(source[2], k)).unwrap();
            prop_assert!((ends[1] - ends[0]).perp_dot(between - ends[0]).abs() <= 1e-8);
        }
    }

    #[test]
    fn three_points_on_a_line_have_no_homography() {
        let square = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let flat = [Vec2::ZERO, Vec2::X, Vec2::X * 2.0, Vec2::Y];
        assert!(homography_from_quad(flat, square).is_none());
        assert!(homography_from_quad(square, flat).is_none());
        assert!(homography_from_quad([Vec2::NAN; 4], square).is_none());
        assert!(homography_from_quad([Vec2::ONE; 4], square).is_none());
    }
}
