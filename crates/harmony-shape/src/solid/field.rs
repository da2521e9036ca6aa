//! Signed distances of simple solids, for smooth unions.

use glam::{DAffine3, DVec2, DVec3};

/// A solid as a distance (negative inside, metres; close to exact near the surface).
#[derive(Debug, Clone)]
pub enum Field {
    /// Ellipsoid about the origin.
    Ellipsoid(DVec3),
    /// Box about the origin: half sizes and edge radius.
    Box(DVec3, f64),
    /// A polyline with a radius at each point.
    Tube(Vec<(DVec3, f64)>),
    /// A closed polygon of (radius, height) turned about y, as deep as `oval` times its width.
    Turned(Vec<DVec2>, f64),
    /// Closed polygons in (x, y), material inside an odd number of them, from `z0` to `z1`.
    Pulled(Vec<Vec<DVec2>>, f64, f64),
    /// Another one moved: the map to the field's own coordinates and how much longer lengths are outside.
    Moved(DAffine3, f64, Box<Field>),
    /// Several, united over a width.
    United(Vec<Field>, f64),
}

impl Field {
    /// Moved by a map.
    #[must_use]
    pub fn moved(self, map: &DAffine3) -> Self {
        let det = map.matrix3.determinant().abs();
        Self::Moved(map.inverse(), libm::cbrt(det.max(1e-18)), Box::new(self))
    }

    /// Distance at a point.
    pub fn at(&self, p: DVec3) -> f64 {
        match self {
            Self::Ellipsoid(r) => {
                // first-order distance: exact on the surface, and for balls everywhere
                let k = (p / *r).length();
                let g = (p / (*r * *r)).length();
                if g < 1e-9 { -r.min_element() } else { k * (k - 1.0) / g }
            }
            Self::Box(half, round) => {
                let q = p.abs() - (*half - DVec3::splat(*round));
                q.max(DVec3::ZERO).length() + q.max_element().min(0.0) - round
            }
            Self::Tube(points) => match points.as_slice() {
                [] => 1e3,
                [(c, r)] => p.distance(*c) - r,
                _ => points.windows(2).map(|w| segment(p, w[0], w[1])).fold(f64::INFINITY, f64::min),
            },
            Self::Turned(polygon, oval) => {
                let r = (p.x * p.x + (p.z / oval) * (p.z / oval)).sqrt();
                polygon_distance(std::slice::from_ref(polygon), DVec2::new(r, p.y))
            }
            Self::Pulled(loops, z0, z1) => {
                let flat = polygon_distance(loops, p.truncate());
                let along = (z0 - p.z).max(p.z - z1);
                let outside = DVec2::new(flat, along).max(DVec2::ZERO).length();
                outside + flat.max(along).min(0.0)
            }
            Self::Moved(inverse, scale, field) => field.at(inverse.transform_point3(p)) * scale,
            Self::United(fields, k) => {
                fields.iter().map(|f| f.at(p)).reduce(|a, b| smooth_least(a, b, *k)).unwrap_or(1e3)
            }
        }
    }

    /// The smooth union's direction of steepest growth, by central differences.
    pub fn gradient(&self, p: DVec3, step: f64) -> DVec3 {
        let along = |d: DVec3| self.at(p + d * step) - self.at(p - d * step);
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)) / (2.0 * step)
    }
}

/// Quadratic smooth minimum (Quilez): at most k / 4 below the smaller one.
fn smooth_least(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0);
    a.min(b) - if k > 0.0 { h * h / (4.0 * k) } else { 0.0 }
}

fn segment(p: DVec3, (a, ra): (DVec3, f64), (b, rb): (DVec3, f64)) -> f64 {
    let d = b - a;
    let t = ((p - a).dot(d) / d.length_squared().max(1e-18)).clamp(0.0, 1.0);
    p.distance(a + d * t) - (ra + (rb - ra) * t)
}

fn polygon_distance(loops: &[Vec<DVec2>], p: DVec2) -> f64 {
    let mut least = f64::INFINITY;
    let mut inside = false;
    for points in loops {
        let n = points.len();
        for i in 0..n {
            let (a, b) = (points[i], points[(i + 1) % n]);
            let d = b - a;
            let t = ((p - a).dot(d) / d.length_squared().max(1e-18)).clamp(0.0, 1.0);
            least = least.min(p.distance_squared(a + d * t));
            if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * d.x {
                inside = !inside;
            }
        }
    }
    if inside { -least.sqrt() } else { least.sqrt() }
}
