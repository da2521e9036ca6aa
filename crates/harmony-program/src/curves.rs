//! Curves as polylines: dividing, measuring, hanging.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use harmony_shape::tree::Curve;

/// Steps of a smooth curve between two given points.
const STEPS: usize = 12;

/// Points of a polyline, with the first one again at the end when it is closed.
fn around(curve: &Curve) -> Vec<DVec3> {
    let mut points: Vec<DVec3> = curve.points.iter().copied().map(DVec3::from).collect();
    if curve.closed && points.len() > 1 {
        points.push(points[0]);
    }
    points
}

/// Length, metres.
pub(crate) fn length(curve: &Curve) -> f64 {
    around(curve).windows(2).map(|w| (w[1] - w[0]).length()).sum()
}

/// Point and unit direction at a share of the length; the ends beyond 0 and 1.
pub(crate) fn at(curve: &Curve, t: f64) -> (DVec3, DVec3) {
    let points = around(curve);
    let mut left = length(curve) * t.clamp(0.0, 1.0);
    let mut last = (points.first().copied().unwrap_or_default(), DVec3::Z);
    for w in points.windows(2) {
        let step = w[1] - w[0];
        let long = step.length();
        if long <= 0.0 {
            continue;
        }
        let direction = step / long;
        if left <= long {
            return (w[0] + direction * left, direction);
        }
        left -= long;
        last = (w[1], direction);
    }
    last
}

/// A centripetal Catmull-Rom spline through points (Barry and Goldman's pyramid), so that it makes no loops between
/// points at uneven distances.
pub(crate) fn spline(points: &[DVec3], closed: bool) -> Vec<[f64; 3]> {
    let mut through: Vec<DVec3> = Vec::with_capacity(points.len());
    for &p in points {
        if through.last().is_none_or(|q| (p - *q).length() > 1e-9) {
            through.push(p);
        }
    }
    if closed && through.len() > 2 && (through[0] - through[through.len() - 1]).length() <= 1e-9 {
        through.pop();
    }
    let n = through.len();
    if n < 3 {
        return through.into_iter().map(|p| p.to_array()).collect();
    }
    let get = |i: isize| -> DVec3 {
        if closed {
            return through[i.rem_euclid(n as isize) as usize];
        }
        // The ends go on as a mirror of the inside.
        match i {
            -1 => through[0] * 2.0 - through[1],
            i if i as usize >= n => through[n - 1] * 2.0 - through[n - 2],
            i => through[i as usize],
        }
    };
    let mut out = Vec::new();
    let segments = if closed { n } else { n - 1 };
    for s in 0..segments as isize {
        let p = [get(s - 1), get(s), get(s + 1), get(s + 2)];
        let knot = |a: DVec3, b: DVec3| (b - a).length().sqrt().max(1e-6);
        let t1 = knot(p[0], p[1]);
        let t2 = t1 + knot(p[1], p[2]);
        let t3 = t2 + knot(p[2], p[3]);
        for k in 0..STEPS {
            let t = t1 + (t2 - t1) * k as f64 / STEPS as f64;
            let mix = |a: DVec3, b: DVec3, ta: f64, tb: f64| a * ((tb - t) / (tb - ta)) + b * ((t - ta) / (tb - ta));
            let (a1, a2, a3) = (mix(p[0], p[1], 0.0, t1), mix(p[1], p[2], t1, t2), mix(p[2], p[3], t2, t3));
            let (b1, b2) = (mix(a1, a2, 0.0, t2), mix(a2, a3, t1, t3));
            out.push(mix(b1, b2, t1, t2).to_array());
        }
    }
    if !closed {
        out.push(through[n - 1].to_array());
    }
    out
}

/// Part of a circle in the plane across `axis`, from angle to angle (degrees, anticlockwise seen from the axis' tip).
///
/// Angle 0 points to +x (across y and z) or to +z (across x).
pub(crate) fn arc(centre: DVec3, radius: f64, from_deg: f64, to_deg: f64, axis: DVec3) -> Vec<[f64; 3]> {
    let axis = axis.try_normalize().unwrap_or(DVec3::Y);
    let start = if axis.x.abs() < 0.9 { DVec3::X } else { DVec3::Z };
    let a = (start - axis * start.dot(axis)).normalize_or(DVec3::X);
    let b = axis.cross(a);
    let sweep = to_deg - from_deg;
    let steps = ((sweep.abs() / 7.5).ceil() as usize).clamp(2, 480);
    (0..=steps)
        .map(|i| {
            let angle = (from_deg + sweep * i as f64 / steps as f64).to_radians();
            (centre + a * (radius * libm::cos(angle)) + b * (radius * libm::sin(angle))).to_array()
        })
        .collect()
}

/// A helix about +y from y = 0 upwards, from radius to radius.
pub(crate) fn helix(radius: f64, end_radius: f64, pitch: f64, turns: f64) -> Vec<[f64; 3]> {
    let steps = ((turns.abs() * 24.0).ceil() as usize).clamp(2, 4800);
    (0..=steps)
        .map(|i| {
            let t = i as f64 / steps as f64;
            let (r, angle) = (radius + (end_radius - radius) * t, TAU * turns * t);
            [r * libm::cos(angle), pitch * turns.abs() * t, r * libm::sin(angle)]
        })
        .collect()
}

/// What a hanging cord of length `slack` times the distance looks like between two points.
///
/// The catenary's parameter solves `sinh(x) / x = sqrt(L^2 - v^2) / h` (h: horizontal, v: vertical distance) by Newton.
/// Below a slack of 1.0005 it is a straight line; where the points stand nearly above one another it hangs in a bight.
pub(crate) fn catenary(from: DVec3, to: DVec3, slack: f64) -> Vec<[f64; 3]> {
    let d = to - from;
    let (h, v) = (libm::hypot(d.x, d.z), d.y);
    let length = d.length() * slack;
    if slack < 1.0005 || d.length() < 1e-9 {
        return vec![from.to_array(), to.to_array()];
    }
    let steps = 32;
    if h < 1e-3 {
        // Down to the bight and up again.
        let low = from.y.min(to.y) - (length - v.abs()) / 2.0;
        let bight = DVec3::new(f64::midpoint(from.x, to.x), low, f64::midpoint(from.z, to.z));
        return vec![from.to_array(), bight.to_array(), to.to_array()];
    }
    let ratio = (length * length - v * v).sqrt() / h;
    let mut x = if ratio < 3.0 {
        (6.0 * (ratio - 1.0)).sqrt()
    } else {
        libm::log(2.0 * ratio) + libm::log(libm::log(2.0 * ratio))
    };
    for _ in 0..12 {
        let f = libm::sinh(x) / x - ratio;
        let slope = (x * libm::cosh(x) - libm::sinh(x)) / (x * x);
        if slope.abs() < 1e-12 {
            break;
        }
        x = (x - f / slope).max(1e-6);
    }
    let a = h / (2.0 * x);
    // Lowest point: y = a cosh((s - s0) / a) with the given rise over h.
    let s0 = h / 2.0 - a * libm::asinh(v / (2.0 * a * libm::sinh(h / (2.0 * a))));
    let base = a * libm::cosh(-s0 / a);
    (0..=steps)
        .map(|i| {
            let t = f64::from(i) / f64::from(steps);
            let s = h * t;
            let y = from.y + a * libm::cosh((s - s0) / a) - base;
            [from.x + d.x * t, y, from.z + d.z * t]
        })
        .collect()
}

/// The slack at which a cord between two points sags by `sag` in its middle: by halving, for `sag` grows with it.
pub(crate) fn slack_for_sag(from: DVec3, to: DVec3, sag: f64) -> f64 {
    let middle = f64::midpoint(from.y, to.y);
    let (mut low, mut high) = (1.0, 20.0);
    for _ in 0..60 {
        let slack = f64::midpoint(low, high);
        let points = catenary(from, to, slack);
        let y = points.get(points.len() / 2).filter(|_| points.len() > 2).map_or(middle, |p| p[1]);
        if middle - y < sag { low = slack } else { high = slack }
    }
    f64::midpoint(low, high)
}

/// A curve shifted sideways in the horizontal plane (to the right of its direction, seen from above, for a positive
/// distance).
pub(crate) fn offset(curve: &Curve, distance: f64) -> Curve {
    let n = curve.points.len();
    let points: Vec<DVec3> = curve.points.iter().copied().map(DVec3::from).collect();
    let side = |i: usize, j: usize| (points[j] - points[i]).cross(DVec3::Y).normalize_or_zero();
    let moved = (0..n).map(|i| {
        let before = if i > 0 {
            side(i - 1, i)
        } else if curve.closed {
            side(n - 1, 0)
        } else {
            DVec3::ZERO
        };
        let after = if i + 1 < n {
            side(i, i + 1)
        } else if curve.closed {
            side(n - 1, 0)
        } else {
            DVec3::ZERO
        };
        let across = (before + after).normalize_or_zero();
        // A mitre, at most twice the distance.
        let mitre = if before == DVec3::ZERO || after == DVec3::ZERO {
            1.0
        } else {
            (1.0 / across.dot(after).max(0.5)).min(2.0)
        };
        (points[i] + across * (distance * mitre)).to_array()
    });
    Curve { points: moved.collect(), closed: curve.closed }
}

/// Columns of a frame at a point of a curve: x along it, y as upright as it can be.
pub(crate) fn frame_along(direction: DVec3) -> DMat3 {
    let x = direction.try_normalize().unwrap_or(DVec3::X);
    let reference = if x.y.abs() > 0.999 { DVec3::NEG_X } else { DVec3::Y };
    let y = (reference - x * reference.dot(x)).normalize_or(DVec3::Y);
    DMat3::from_cols(x, y, x.cross(y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_catenary_has_its_length_and_its_ends() {
        let (a, b) = (DVec3::new(0.0, 2.0, 0.0), DVec3::new(3.0, 1.2, 4.0));
        for slack in [1.01, 1.2, 3.0] {
            let points = catenary(a, b, slack);
            let curve = Curve { points: points.clone(), closed: false };
            let wanted = (b - a).length() * slack;
            assert!((length(&curve) - wanted).abs() <= 0.01 * wanted, "{} {wanted}", length(&curve));
            assert!((DVec3::from(points[32]) - b).length() <= 1e-6);
        }
        // A level cord of slack 1.1 over 2 m: sinh(x)/x = 1.1 has x = 0.7634; sag = a (cosh x - 1), a = 1 / x.
        let level = catenary(DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0), 1.1);
        let x: f64 = 0.763_4;
        assert!((level[16][1] + (x.cosh() - 1.0) / x).abs() <= 1e-3, "{}", level[16][1]);
        let slack = slack_for_sag(DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0), 0.3);
        assert!((catenary(DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0), slack)[16][1] + 0.3).abs() <= 1e-6);
    }

    #[test]
    fn a_spline_goes_through_its_points() {
        let points = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.0, 1.0, 0.5)];
        let open = spline(&points, false);
        assert_eq!(open.len(), 3 * STEPS + 1);
        for (i, p) in points.iter().enumerate() {
            assert!((DVec3::from(open[i * STEPS]) - *p).length() <= 1e-12);
        }
        assert_eq!(spline(&points, true).len(), 4 * STEPS);
    }

    #[test]
    fn an_arc_turns_anticlockwise_about_its_axis() {
        let quarter = arc(DVec3::ZERO, 2.0, 0.0, 90.0, DVec3::Z);
        assert!((DVec3::from(quarter[0]) - DVec3::new(2.0, 0.0, 0.0)).length() <= 1e-12);
        assert!((DVec3::from(*quarter.last().unwrap()) - DVec3::new(0.0, 2.0, 0.0)).length() <= 1e-12);
    }

    #[test]
    fn an_offset_square_is_larger_by_the_distance() {
        // Clockwise seen from above (+y), so that its left is outside: x to -z turns left.
        let square = Curve { points: vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]], closed: true };
        let inner = offset(&square, 0.1);
        for (p, q) in inner.points.iter().zip([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]]) {
            assert!((p[0] - q[0]).abs() <= 1e-9 && (p[2] - q[1]).abs() <= 1e-9, "{p:?}");
        }
    }
}
