//! Turned solids: lathe, cylinder, ball.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3};

use super::collect::Collector;
use super::math::{cumulative, divisions, left, sin_cos};
use crate::Piece;

/// Corners sharper than this are never smoothed, degrees.
const ALWAYS_SHARP_DEG: f64 = 80.0;
/// Largest ratio of radii within one band of texture coordinates.
const BAND: f64 = 1.5;

/// A profile turned about y.
#[derive(Debug, Clone, Copy)]
pub struct Lathe<'a> {
    /// (radius, height), in either direction.
    pub profile: &'a [[f64; 2]],
    /// Edges flatter than this angle are smooth, degrees.
    pub smooth_deg: f64,
    /// Wall thickness inwards, 0: none.
    pub wall: f64,
    /// Depth relative to width.
    pub oval: f64,
    /// Lobes around, 0: none.
    pub lobes: u32,
    /// Depth of the lobes relative to the radius.
    pub lobe_depth: f64,
    /// Flat sides, 0: round. The radius is that of the corners; one side faces +z.
    pub sides: u32,
}

impl<'a> Lathe<'a> {
    /// A round one of a profile.
    pub fn of(profile: &'a [[f64; 2]]) -> Self {
        Self { profile, smooth_deg: 40.0, wall: 0.0, oval: 1.0, lobes: 0, lobe_depth: 0.0, sides: 0 }
    }
}

/// One point of the unit circle as the shape bends it.
#[derive(Clone, Copy)]
struct Spoke {
    /// x and z of radius 1.
    at: DVec2,
    /// Its change along the circle.
    tangent: DVec2,
    /// Angle of the plain circle.
    angle: f64,
    /// Length along the unit circle.
    length: f64,
}

/// One end of a side of the profile.
#[derive(Clone, Copy)]
struct Knot {
    /// Radius and height.
    p: DVec2,
    /// Outward normal in the plane of the profile.
    normal: DVec2,
    /// Length along the profile.
    s: f64,
}

/// A profile turned about y; poles are welded, texture coordinates lie in bands and discs of nearly true scale.
///
/// # Errors
/// When the profile has fewer than two different points.
pub fn lathe(l: &Lathe<'_>) -> Result<Piece, String> {
    let (points, ring) = clean(l.profile)?;
    let (points, ring) = oriented(points, ring);
    let (points, ring) = if l.wall > 0.0 && !ring { walled(&points, l.wall) } else { (points, ring) };
    let largest = points.iter().map(|p| p.x).fold(0.0, f64::max);
    if largest < 1e-6 {
        return Err("every radius of the profile is 0; give the radius first and the height second".into());
    }
    let spokes = spokes(l, largest);
    let mut out = Collector::new();
    let bands = bands(&points, ring, l.smooth_deg.clamp(0.0, ALWAYS_SHARP_DEG).to_radians());
    let whole = bands.iter().flat_map(|b| &b.knots).map(|k| k.s).fold(0.0, f64::max);
    for band in bands {
        if l.sides == 0 {
            emit(&mut out, &spokes, &band, whole, None);
        } else {
            for pair in spokes.windows(2) {
                emit(&mut out, pair, &band, whole, Some(pair[0].at + pair[1].at));
            }
        }
    }
    Ok(Piece { outwards: true, ..out.finish() })
}

fn clean(profile: &[[f64; 2]]) -> Result<(Vec<DVec2>, bool), String> {
    let mut points: Vec<DVec2> = Vec::new();
    for [r, y] in profile {
        let p = DVec2::new(if *r < 1e-7 { 0.0 } else { *r }, *y);
        if points.last().is_none_or(|q| q.distance_squared(p) > 1e-13) {
            points.push(p);
        }
    }
    let ring = points.len() > 3 && points[0].distance_squared(points[points.len() - 1]) < 1e-12;
    if ring {
        points.pop();
    }
    if points.len() < 2 { Err("a profile needs at least two different points".into()) } else { Ok((points, ring)) }
}

/// Turned so that outside lies to the right of its direction.
fn oriented(mut points: Vec<DVec2>, ring: bool) -> (Vec<DVec2>, bool) {
    let n = points.len();
    let sides = if ring { n } else { n - 1 };
    let volume: f64 = (0..sides)
        .map(|i| {
            let (a, b) = (points[i], points[(i + 1) % n]);
            (a.x * a.x + a.x * b.x + b.x * b.x) * (b.y - a.y)
        })
        .sum();
    let outwards = points[n - 1].x - points[0].x;
    if volume < -1e-15 || (volume.abs() <= 1e-15 && outwards > 0.0) {
        points.reverse();
    }
    (points, ring)
}

/// The profile with an inner wall: out along the profile, back inside it.
fn walled(points: &[DVec2], wall: f64) -> (Vec<DVec2>, bool) {
    let n = points.len();
    let normal = |i: usize| {
        let d = (points[i + 1] - points[i]).normalize_or(DVec2::Y);
        left(d)
    };
    let inner: Vec<DVec2> = (0..n)
        .map(|i| {
            let (a, b) = (normal(i.saturating_sub(1)), normal(i.min(n - 2)));
            let mut m = ((a + b) / (1.0 + a.dot(b)).max(0.1)).clamp_length_max(2.0);
            if points[i].x == 0.0 {
                m = DVec2::new(0.0, if m.y < 0.0 { -1.0 } else { 1.0 });
            }
            let p = points[i] + m * wall;
            DVec2::new(p.x.max(0.0), p.y)
        })
        .collect();
    let mut out: Vec<DVec2> = points.to_vec();
    out.extend(inner.iter().rev());
    // a profile that is closed at both ends is a shell: two surfaces, told apart by the jump along the axis
    (out, points[0].x >= 1e-9)
}

fn spokes(l: &Lathe<'_>, radius: f64) -> Vec<Spoke> {
    let mut n = divisions(radius * l.oval.max(1.0));
    if l.lobes > 0 {
        let each = (n.div_ceil(l.lobes as usize)).max(8).next_multiple_of(2);
        n = each * l.lobes as usize;
    }
    if l.sides > 0 {
        n = l.sides.max(3) as usize;
    }
    let half = if l.sides > 0 { 0.5 } else { 0.0 };
    let mut out: Vec<Spoke> = (0..=n)
        .map(|i| {
            // the seam lies at the back
            let angle = FRAC_PI_2 + TAU * (i as f64 + half) / n as f64;
            let (s, c) = if i == n { sin_cos(FRAC_PI_2 + TAU * half / n as f64) } else { sin_cos(angle) };
            let (f, df) = lobe(l, angle);
            let at = DVec2::new(f * c, -f * s * l.oval);
            let tangent = DVec2::new(df * c - f * s, -(df * s + f * c) * l.oval);
            Spoke { at, tangent, angle, length: 0.0 }
        })
        .collect();
    let lengths = cumulative(out.windows(2).map(|w| w[0].at.distance(w[1].at)).collect::<Vec<_>>().into_iter());
    for (s, length) in out.iter_mut().zip(lengths) {
        s.length = length;
    }
    out
}

/// Radius of the lobed circle and its derivative.
fn lobe(l: &Lathe<'_>, angle: f64) -> (f64, f64) {
    if l.lobes == 0 {
        return (1.0, 0.0);
    }
    let k = f64::from(l.lobes) / 2.0;
    // valleys at the seam; between them rounded lobes
    let (s, c) = sin_cos(k * (angle - FRAC_PI_2));
    let slope = if s.abs() < 1e-9 { 0.0 } else { k * c * s.signum() };
    (1.0 - l.lobe_depth * (1.0 - s.abs()), l.lobe_depth * slope)
}

/// A stretch of the profile that is unrolled as one.
struct Band {
    knots: Vec<Knot>,
    /// Radius at which lengths around are true; `None`: a disc.
    radius: Option<f64>,
}

fn bands(points: &[DVec2], ring: bool, smooth: f64) -> Vec<Band> {
    let n = points.len();
    let sides = if ring { n } else { n - 1 };
    let side = |k: usize| (points[k % n], points[(k + 1) % n]);
    let normal = |k: usize| {
        let (a, b) = side(k);
        -left((b - a).normalize_or(DVec2::Y))
    };
    let flat = |k: usize| {
        let (a, b) = side(k);
        (b.x - a.x).abs() > (b.y - a.y).abs()
    };
    // a side along the axis joins the two surfaces of a shell: it is not there
    let missing = |k: usize| {
        let (a, b) = side(k);
        a.x < 1e-9 && b.x < 1e-9
    };
    let joint = |k: usize| -> Option<DVec2> {
        // smooth normal between side k and the next one
        if !ring && k + 1 >= sides {
            return None;
        }
        let (a, b) = (normal(k), normal((k + 1) % sides));
        let off_axis = points[(k + 1) % n].x > 1e-9;
        (off_axis && libm::acos(a.dot(b).clamp(-1.0, 1.0)) <= smooth).then(|| (a + b).normalize_or(a))
    };
    let mut out: Vec<Band> = Vec::new();
    let mut s = 0.0;
    let mut open: Option<(Vec<Knot>, bool)> = None;
    let mut close = |open: &mut Option<(Vec<Knot>, bool)>| {
        if let Some((knots, disc)) = open.take() {
            let radius = knots.iter().map(|k| k.p.x).sum::<f64>() / knots.len() as f64;
            out.push(Band { knots, radius: (!disc).then_some(radius) });
        }
    };
    for k in 0..sides {
        let (a, b) = side(k);
        if missing(k) {
            close(&mut open);
            continue;
        }
        let length = a.distance(b);
        let before = if k > 0 {
            joint(k - 1)
        } else if ring {
            joint(sides - 1)
        } else {
            None
        };
        let starting = pole(a, normal(k)).or(before).unwrap_or(normal(k));
        let ending = pole(b, normal(k)).or(joint(k)).unwrap_or(normal(k));
        let fits = open.as_ref().is_some_and(|(knots, disc)| {
            let lo = knots.iter().map(|q| q.p.x).fold(b.x, f64::min);
            let hi = knots.iter().map(|q| q.p.x).fold(b.x, f64::max);
            *disc == flat(k) && before.is_some() && (*disc || hi <= BAND * lo)
        });
        if !fits {
            close(&mut open);
        }
        let (knots, _) = open.get_or_insert_with(|| (vec![Knot { p: a, normal: starting, s }], flat(k)));
        s += length;
        knots.push(Knot { p: b, normal: ending, s });
    }
    close(&mut open);
    out
}

/// Normal at a pole of a smooth surface: along the axis where the side is nearly flat there.
fn pole(p: DVec2, normal: DVec2) -> Option<DVec2> {
    (p.x < 1e-9 && normal.y.abs() > 0.85).then(|| DVec2::new(0.0, normal.y.signum()))
}

fn emit(out: &mut Collector, spokes: &[Spoke], band: &Band, whole: f64, facet: Option<DVec2>) {
    let group = out.group();
    let inner = band.knots.iter().map(|k| k.p.x).fold(f64::INFINITY, f64::min);
    let first = band.knots[0];
    let falling = band.knots[band.knots.len() - 1].p.x < first.p.x;
    let total = band.knots[band.knots.len() - 1].s - first.s;
    let side = if band.knots.iter().map(|k| k.normal.y).sum::<f64>() < 0.0 { 1.0 } else { -1.0 };
    out.grid(group, spokes.len() - 1, band.knots.len() - 1, |i, j| {
        let (spoke, knot) = (spokes[i], band.knots[j]);
        let p = DVec3::new(spoke.at.x * knot.p.x, knot.p.y, spoke.at.y * knot.p.x);
        let (radial, around) = match facet {
            // halfway between the corners the radius is shorter, and so is the slope
            Some(sum) => (sum / 2.0, spokes[1].at - spokes[0].at),
            None => (spoke.at, spoke.tangent),
        };
        let slope = DVec2::new(-knot.normal.y, knot.normal.x);
        let up = DVec3::new(radial.x * slope.x, slope.y, radial.y * slope.x);
        let normal = DVec3::new(around.x, 0.0, around.y).cross(up).normalize_or(DVec3::Y * knot.normal.y.signum());
        let uv = if let Some(r) = band.radius {
            DVec2::new(spoke.length * r, whole - knot.s)
        } else {
            let travelled = if falling { total - (knot.s - first.s) } else { knot.s - first.s };
            let (s, c) = sin_cos(spoke.angle);
            DVec2::new(c, side * s) * (inner + travelled) + DVec2::splat(inner + total)
        };
        (p, normal, uv)
    });
}

/// A ball or ellipsoid standing on y = 0.
pub fn sphere(radii: DVec3) -> Piece {
    let r = radii.max(DVec3::splat(1e-5));
    let n = (divisions(r.max_element()) / 2).clamp(6, 32);
    let profile: Vec<[f64; 2]> = (0..=n)
        .map(|k| {
            let (s, c) = sin_cos(PI * k as f64 / n as f64);
            [if k == 0 || k == n { 0.0 } else { r.x * s }, r.y * (1.0 - c)]
        })
        .collect();
    let l = Lathe { smooth_deg: 180.0, oval: r.z / r.x, ..Lathe::of(&profile) };
    // normals and bottom of an ellipsoid are known exactly
    let mut piece = lathe(&l).unwrap_or_default();
    for (p, n) in piece.positions.iter().zip(&mut piece.normals) {
        let q = *p - DVec3::new(0.0, r.y, 0.0);
        *n = (q / (r * r)).normalize_or(DVec3::Y);
    }
    piece
}

/// A cylinder, cone, prism or pipe, upright on y = 0.
///
/// # Errors
/// When both radii are 0.
pub fn cylinder(radius: f64, height: f64, top: f64, bevel: f64, sides: u32, wall: f64) -> Result<Piece, String> {
    let (radius, top) = (radius.max(0.0), top.max(0.0));
    let mut corners = Vec::new();
    let thick = wall > 0.0 && wall < radius.max(top);
    if thick {
        let inner = |r: f64| (r - wall).max(0.0);
        corners.extend([[inner(radius), 0.0], [radius, 0.0], [top, height], [inner(top), height]]);
    } else {
        corners.extend([[0.0, 0.0], [radius, 0.0], [top, height], [0.0, height]]);
    }
    let most = if thick { wall * 0.45 } else { height * 0.49 };
    let bevel = bevel.clamp(0.0, most.min(height * 0.49));
    let profile = if bevel > 2e-5 { rounded(&corners, bevel, thick) } else { close(&corners, thick) };
    lathe(&Lathe { sides, smooth_deg: 40.0, ..Lathe::of(&profile) })
}

fn close(corners: &[[f64; 2]], ring: bool) -> Vec<[f64; 2]> {
    let mut out = corners.to_vec();
    if ring {
        out.push(corners[0]);
    }
    out
}

/// Corners off the axis as quarter circles or what comes nearest to them.
fn rounded(corners: &[[f64; 2]], bevel: f64, ring: bool) -> Vec<[f64; 2]> {
    let n = corners.len();
    let at = |i: usize| DVec2::from_array(corners[i % n]);
    let steps = if bevel < 0.004 { 2 } else { 4 };
    let mut out: Vec<[f64; 2]> = Vec::new();
    for i in 0..n {
        let p = at(i);
        if p.x < 1e-9 || (!ring && (i == 0 || i == n - 1)) {
            out.push(p.to_array());
            continue;
        }
        let (to_a, to_b) = (at(i + n - 1) - p, at(i + 1) - p);
        let (a, b) = (to_a.normalize_or(DVec2::X), to_b.normalize_or(DVec2::X));
        let opening = libm::acos(a.dot(b).clamp(-1.0, 1.0)) / 2.0;
        if to_a.length() < 1e-9 || to_b.length() < 1e-9 || opening > 1.5 {
            out.push(p.to_array());
            continue;
        }
        let (sin, cos) = sin_cos(opening);
        let tangent = (bevel * cos / sin).min(to_a.length() * 0.49).min(to_b.length() * 0.49);
        let radius = tangent * sin / cos;
        let middle = p + (a + b).normalize_or(DVec2::X) * (radius / sin);
        let (from, to) = (p + a * tangent - middle, p + b * tangent - middle);
        let sweep = libm::atan2(from.perp_dot(to), from.dot(to));
        for k in 0..=steps {
            let q = middle + super::math::turned(from, sweep * f64::from(k) / f64::from(steps));
            out.push(q.to_array());
        }
    }
    if ring {
        out.push(out[0]);
    }
    out
}
