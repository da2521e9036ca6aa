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
        // An area below a millionth of the quad's square is a line. NaN fails as well.
        if !((b - a).perp_dot(c - a).abs() > 1e-9 * size * size) {
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
