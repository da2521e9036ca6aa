//! Sections carried along curves: pipes, cables, mouldings, frames.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DVec2, DVec3};

use super::collect::Collector;
use super::math::{self, about, angle, divisions, sin_cos};
use super::outline::{self, CREASE, Column, Island};
use crate::Piece;
use crate::tree::{Curve, Section};

/// Bends sharper than this are mitred corners, radians.
const SHARP: f64 = 0.6;
/// Steepest miter: cosine of half the bend.
const MIN_COS: f64 = 0.35;
/// Most rows that rings may cost.
const MAX_ROWS: usize = 3000;

/// What is carried along what.
#[derive(Debug, Clone, Copy)]
pub struct Sweep<'a> {
    /// Centre line.
    pub curve: &'a Curve,
    /// What is carried.
    pub section: &'a Section,
    /// Size at the end relative to the start.
    pub taper: f64,
    /// Twist over the whole length, degrees.
    pub twist_deg: f64,
    /// Pitch and depth of rings around a round section, 0: none.
    pub rings: [f64; 2],
    /// Rounded ends of a round section.
    pub round_caps: bool,
}

/// One place of the section.
#[derive(Clone, Copy)]
struct Row {
    centre: DVec3,
    /// Axes of the section.
    x: DVec3,
    y: DVec3,
    /// Direction of the curve that the section belongs to.
    d: DVec3,
    /// Normal of the plane in which the points lie (a miter).
    plane: DVec3,
    scale: f64,
    /// Share of the direction in the normals.
    lean: f64,
    /// Length along the curve.
    s: f64,
}

impl Row {
    fn point(&self, p: DVec2) -> DVec3 {
        let o = (self.x * p.x + self.y * p.y) * self.scale;
        let cos = self.d.dot(self.plane).max(MIN_COS);
        self.centre + o - self.d * (o.dot(self.plane) / cos)
    }

    fn normal(&self, n: DVec2) -> DVec3 {
        let flat = (1.0 - self.lean * self.lean).max(0.0).sqrt();
        (self.x * n.x + self.y * n.y) * flat + self.d * self.lean
    }
}

/// Carries a section along a curve without turning it more than the curve does (parallel transport); closed curves
/// spread what is left over. Sharp corners are mitred, and the section shrinks where the curve bends tighter than it.
///
/// # Errors
/// When the curve has no length or the section no area.
pub fn sweep(sweep: &Sweep<'_>) -> Result<Piece, String> {
    let (points, closed) = path(sweep)?;
    let (islands, round) = section(sweep.section)?;
    let reach = islands.iter().flat_map(|i| i.loops.iter().flatten()).map(|p| p.length()).fold(0.0, f64::max);
    let mut spans = rows(sweep, &points, closed, reach);
    let caps = sweep.round_caps && round.is_some() && !closed;
    if let (true, Some(radius)) = (caps, round) {
        round_ends(&mut spans, radius);
    }
    let mut out = Collector::new();
    for island in &islands {
        for points in &island.loops {
            let runs = if round.is_some() { vec![circle_run(points)] } else { outline::runs(points, CREASE) };
            for run in runs {
                let group = out.group();
                for span in &spans {
                    out.grid(group, run.len() - 1, span.len() - 1, |i, j| {
                        let (c, row): (Column, Row) = (run[i], span[j]);
                        (row.point(c.p), row.normal(c.normal), DVec2::new(c.u, row.s))
                    });
                }
            }
        }
        if !closed && !caps {
            flat_ends(&mut out, island, &spans);
        }
    }
    Ok(out.finish())
}

fn path(sweep: &Sweep<'_>) -> Result<(Vec<DVec3>, bool), String> {
    let mut points: Vec<DVec3> = Vec::new();
    for p in &sweep.curve.points {
        let p = DVec3::from_array(*p);
        if points.last().is_none_or(|q| q.distance_squared(p) > 1e-12) {
            points.push(p);
        }
    }
    let mut closed = sweep.curve.closed;
    if points.len() > 3 && points[0].distance_squared(points[points.len() - 1]) < 1e-10 {
        points.pop();
        closed = true;
    }
    if points.len() < 2 {
        return Err("a sweep needs a curve of at least two different points".into());
    }
    closed &= points.len() > 2;
    let ends = if closed { points.len() } else { points.len() - 1 };
    let length: f64 = (0..ends).map(|i| points[i].distance(points[(i + 1) % points.len()])).sum();
    // rings, twists and tapers need rows between the points of straight stretches
    let mut step = f64::INFINITY;
    if sweep.rings[0] > 0.0 && sweep.rings[1] > 0.0 {
        step = (sweep.rings[0] / 6.0).max(length / MAX_ROWS as f64);
    }
    if sweep.twist_deg != 0.0 {
        step = step.min(length * 6.0 / sweep.twist_deg.abs().max(6.0)).max(length / MAX_ROWS as f64);
    }
    if step.is_finite() {
        let mut fine = Vec::new();
        for i in 0..ends {
            let (a, b) = (points[i], points[(i + 1) % points.len()]);
            let n = ((a.distance(b) / step).ceil() as usize).clamp(1, MAX_ROWS);
            fine.extend((0..n).map(|k| a.lerp(b, k as f64 / n as f64)));
        }
        if !closed {
            fine.push(points[points.len() - 1]);
        }
        points = fine;
    }
    Ok((points, closed))
}

/// The section's islands, and its radius when it is round.
fn section(section: &Section) -> Result<(Vec<Island>, Option<f64>), String> {
    match section {
        Section::Round(radius) => {
            let radius = radius.max(1e-5);
            let n = divisions(radius);
            let ring = (0..n)
                .map(|k| {
                    let (s, c) = sin_cos(TAU * k as f64 / n as f64);
                    DVec2::new(c, s) * radius
                })
                .collect();
            Ok((vec![Island { loops: vec![ring] }], Some(radius)))
        }
        Section::Outline(o) => Ok((outline::islands(o)?, None)),
    }
}

fn circle_run(points: &[DVec2]) -> Vec<Column> {
    let n = points.len();
    let radius = points[0].length();
    (0..=n)
        .map(|k| {
            let p = points[k % n];
            let u = TAU * radius * k as f64 / n as f64;
            Column { p, normal: p.normalize_or(DVec2::X), inset: DVec2::ZERO, u }
        })
        .collect()
}

/// The rows in stretches between sharp corners.
fn rows(sweep: &Sweep<'_>, points: &[DVec3], closed: bool, reach: f64) -> Vec<Vec<Row>> {
    let n = points.len();
    let ends = if closed { n } else { n - 1 };
    let d: Vec<DVec3> = (0..ends).map(|i| (points[(i + 1) % n] - points[i]).normalize_or(DVec3::Y)).collect();
    let lengths: Vec<f64> = (0..ends).map(|i| points[i].distance(points[(i + 1) % n])).collect();
    let along = math::cumulative(lengths.iter().copied());
    let total = along[ends].max(1e-9);
    // frames of the straight pieces
    let mut axes = vec![math::frame(d[0])];
    for k in 1..ends {
        axes.push(carried(axes[k - 1], d[k - 1], d[k]));
    }
    let leftover = if closed {
        let (x, _) = carried(axes[ends - 1], d[ends - 1], d[0]);
        let (x0, y0) = axes[0];
        -libm::atan2(x.dot(y0), x.dot(x0))
    } else {
        0.0
    };
    let twist = sweep.twist_deg.to_radians() + leftover;
    let wave = |s: f64| {
        if sweep.rings[0] <= 0.0 || sweep.rings[1] <= 0.0 {
            return (0.0, 0.0);
        }
        let k = TAU / sweep.rings[0];
        let (sin, cos) = sin_cos(k * s);
        (sweep.rings[1] * (cos - 1.0) / 2.0, -sweep.rings[1] * k * sin / 2.0)
    };
    let place = |i: usize| {
        let inner = closed || (i > 0 && i < ends);
        let before = if i > 0 {
            i - 1
        } else if closed {
            ends - 1
        } else {
            0
        };
        let after = if i < ends {
            i
        } else if closed {
            0
        } else {
            ends - 1
        };
        (inner, before, after, if inner { angle(d[before], d[after]) } else { 0.0 })
    };
    // sizes: taper and rings, less where the curve bends tighter than the section; changes of size are spread
    let wanted: Vec<f64> =
        along.iter().map(|s| 1.0 + (sweep.taper - 1.0) * s / total + wave(*s).0 / reach.max(1e-9)).collect();
    let mut scales = wanted.clone();
    for (i, scale) in scales.iter_mut().enumerate() {
        let (inner, before, after, bend) = place(i);
        let tight = lengths[before].min(lengths[after]) / (2.0 * libm::tan((bend / 2.0).min(1.4)).max(1e-9));
        if inner && bend > 0.02 && reach * *scale > 0.95 * tight {
            *scale = (0.95 * tight / reach).max(0.05);
        }
    }
    for _ in 0..if closed { 2 } else { 1 } {
        for i in 1..=ends {
            scales[i] = spread(scales[i], scales[i - 1], wanted[i - 1], lengths[i - 1] / reach);
        }
        for i in (0..ends).rev() {
            scales[i] = spread(scales[i], scales[i + 1], wanted[i + 1], lengths[i] / reach);
        }
        if closed {
            let least = scales[0].min(scales[ends]);
            (scales[0], scales[ends]) = (least, least);
        }
    }
    let mut spans: Vec<Vec<Row>> = vec![Vec::new()];
    for i in 0..=ends {
        let (inner, before, after, bend) = place(i);
        let plane = if inner { (d[before] + d[after]).normalize_or(d[after]) } else { d[after] };
        let s = along[i];
        let scale = scales[i];
        let slope = if (scale - wanted[i]).abs() < 1e-12 {
            reach * (sweep.taper - 1.0) / total + wave(s).1
        } else {
            let (p, q) = (i.saturating_sub(1), (i + 1).min(ends));
            reach * (scales[q] - scales[p]) / (along[q] - along[p]).max(1e-9)
        };
        let slope = slope.clamp(-3.0, 3.0);
        let lean = -slope / (1.0 + slope * slope).sqrt();
        let sharp = inner && bend > SHARP;
        let row = |k: usize, smooth: bool| {
            let (x, y) = axes[k];
            let own = twist * s / total;
            let (x, y) = (about(d[k], own, x), about(d[k], own, y));
            Row { centre: points[i % n], x, y, d: d[k], plane, scale, lean: if smooth { lean } else { 0.0 }, s }
        };
        if sharp {
            if i > 0 {
                spans.last_mut().into_iter().for_each(|l| l.push(row(before, false)));
            }
            if i < ends {
                if i > 0 {
                    spans.push(Vec::new());
                }
                spans.last_mut().into_iter().for_each(|l| l.push(row(after, false)));
            }
        } else {
            // at the seam of a closed curve the frame of the last piece carries the leftover turn
            let k = if i == ends { before } else { after };
            let mut r = row(k, true);
            if inner {
                r = halfway(r, d[before], d[after], k == before);
            }
            spans.last_mut().into_iter().for_each(|l| l.push(r));
        }
    }
    spans.retain(|l| l.len() > 1);
    spans
}

/// A size next to one that was reduced: it may grow by 0.7 a length of the section's reach.
fn spread(own: f64, near: f64, near_wanted: f64, step: f64) -> f64 {
    if near < near_wanted - 1e-12 { own.min(near + 0.7 * step) } else { own }
}

fn carried((x, _): (DVec3, DVec3), from: DVec3, to: DVec3) -> (DVec3, DVec3) {
    let axis = from.cross(to);
    let x = match axis.try_normalize() {
        Some(a) if axis.length() > 1e-9 => about(a, angle(from, to), x),
        _ => x,
    };
    let x = (x - to * x.dot(to)).normalize_or(math::frame(to).0);
    (x, to.cross(x))
}

/// The section of a smooth bend stands square to the mean direction.
fn halfway(mut r: Row, before: DVec3, after: DVec3, from_before: bool) -> Row {
    let (from, to) = (r.d, r.plane);
    let axis = if from_before { before.cross(after) } else { after.cross(before) };
    if let (Some(a), true) = (axis.try_normalize(), axis.length() > 1e-9) {
        let half = angle(from, to);
        r.x = about(a, half, r.x);
        r.y = about(a, half, r.y);
        r.d = to;
    }
    r
}

/// Half balls at both ends.
fn round_ends(spans: &mut [Vec<Row>], radius: f64) {
    let steps = 4;
    let ball = |row: &Row, k: i32, sign: f64| {
        // k = 0 at the pole
        let (s, c) = sin_cos(FRAC_PI_2 * f64::from(k) / f64::from(steps));
        let r = radius * row.scale;
        let arc = r * FRAC_PI_2 * f64::from(steps - k) / f64::from(steps);
        Row {
            centre: row.centre + row.d * (sign * r * c),
            scale: if k == 0 { 0.0 } else { row.scale * s },
            lean: sign * c,
            s: row.s + sign * arc,
            ..*row
        }
    };
    if let Some(span) = spans.first_mut() {
        let first = span[0];
        let mut ahead: Vec<Row> = (0..steps).map(|k| ball(&first, k, -1.0)).collect();
        ahead.append(span);
        *span = ahead;
    }
    if let Some(span) = spans.last_mut() {
        let last = span[span.len() - 1];
        span.extend((0..steps).rev().map(|k| ball(&last, k, 1.0)));
    }
}

fn flat_ends(out: &mut Collector, island: &Island, spans: &[Vec<Row>]) {
    let caps = outline::triangles(&island.loops);
    let first = spans.first().and_then(|s| s.first());
    let last = spans.last().and_then(|s| s.last());
    for (row, end) in [(first, false), (last, true)] {
        let Some(row) = row else { continue };
        let group = out.group();
        let normal = if end { row.d } else { -row.d };
        let vertices: Vec<u32> = island
            .loops
            .iter()
            .flatten()
            .map(|p| {
                let u = if end { p.x } else { -p.x };
                out.vertex(group, row.point(*p), normal, DVec2::new(u, -p.y) * row.scale)
            })
            .collect();
        for t in &caps {
            let [a, b, c] = t.map(|i| vertices[i as usize]);
            out.triangle(if end { [a, b, c] } else { [a, c, b] });
        }
    }
}
