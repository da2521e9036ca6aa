//! Bodies of revolution.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3};

use super::{Whole, runs, smooth_path};
use crate::part_model::Part;
use crate::part_model::solid::SolidBuilder;

/// How a profile is turned.
struct Turn {
    sides: usize,
    /// Flat sides instead of a smooth round.
    faceted: bool,
    /// First angle from +Z towards +X.
    start: f64,
    /// Stretch of x and z.
    stretch: DVec2,
}

impl Turn {
    fn round(sides: usize, stretch: DVec2) -> Self {
        Self { sides, faceted: false, start: 0.0, stretch }
    }

    fn point(&self, profile: DVec2, side: usize) -> DVec3 {
        let (sin, cos) = (self.start + TAU * (side % self.sides) as f64 / self.sides as f64).sin_cos();
        DVec3::new(profile.x * sin * self.stretch.x, profile.y, profile.x * cos * self.stretch.y)
    }
}

/// Turns a profile (radius, height) about +Y. An open profile goes from bottom to top and gets flat caps where its ends
/// are off the axis; a closed one encloses the wall of a ring.
fn revolve(b: &mut SolidBuilder, profile: &[DVec2], closed: bool, turn: &Turn) {
    for run in runs(profile, closed) {
        let rows = run.len() - 1;
        if turn.faceted {
            for side in 0..turn.sides {
                let group = b.group();
                b.patch(group, 1, rows, |i, j| turn.point(profile[run[j]], side + i));
            }
        } else {
            let group = b.group();
            b.patch(group, turn.sides, rows, |i, j| turn.point(profile[run[j]], i));
        }
    }
    if !closed {
        let cap = |p: DVec2| -> Vec<DVec3> { (0..turn.sides).map(|i| turn.point(p, i)).collect() };
        if let (Some(first), Some(last)) = (profile.first(), profile.last()) {
            if first.x > 0.0 {
                let mut outline = cap(*first);
                outline.reverse();
                b.flat_convex(&outline, DVec3::NEG_Y);
            }
            if last.x > 0.0 {
                b.flat_convex(&cap(*last), DVec3::Y);
            }
        }
    }
}

/// Radius and x, z stretch for the cross section: a circle in the smaller side, or an oval that fills it.
fn section(half: DVec3, oval: bool) -> (f64, DVec2) {
    let radius = half.x.min(half.z);
    (radius, if oval { DVec2::new(half.x / radius, half.z / radius) } else { DVec2::ONE })
}

pub(super) fn sphere(b: &mut SolidBuilder, half: DVec3, whole: &Whole) {
    let sides = whole.sides(half.max_element());
    let rows = (sides / 2).max(4);
    let radius = half.x;
    let profile: Vec<DVec2> = (0..=rows)
        .map(|k| {
            let a = PI * k as f64 / rows as f64;
            let r = if k == 0 || k == rows { 0.0 } else { radius * a.sin() };
            DVec2::new(r, -half.y * a.cos())
        })
        .collect();
    let group = b.group();
    let turn = Turn::round(sides, DVec2::new(1.0, half.z / radius));
    // one smooth group whatever the stretch
    b.patch(group, sides, rows, |i, j| turn.point(profile[j], i));
    b.piece_of_all();
}

pub(super) fn cylinder(b: &mut SolidBuilder, half: DVec3, part: &Part, whole: &Whole) {
    let (widest, stretch) = section(half, part.oval.unwrap_or(false));
    let top = part.top.unwrap_or(1.0).clamp(0.0, 10.0);
    let (low, high) = if top > 1.0 { (widest / top, widest) } else { (widest, widest * top) };
    let turn = match part.sides {
        Some(n) => {
            let sides = n.clamp(3, 64) as usize;
            // flats face the axes, and the corners reach where the box's faces are
            let start = if sides.is_multiple_of(2) { PI / sides as f64 } else { 0.0 };
            let grow = if sides == 4 { std::f64::consts::SQRT_2 } else { 1.0 };
            Turn { sides, faceted: sides <= 16, start, stretch: stretch * grow }
        }
        None => Turn::round(whole.sides(widest), stretch),
    };
    if let Some(wall) = part.hollow.filter(|w| *w > 0.0) {
        let wall = wall.clamp(0.01, 0.9) * widest;
        let inner = |r: f64| (r - wall).max(r * 0.05);
        let (low, high) = (low.max(widest * 0.02), high.max(widest * 0.02));
        let profile = [
            DVec2::new(low, -half.y),
            DVec2::new(high, half.y),
            DVec2::new(inner(high), half.y),
            DVec2::new(inner(low), -half.y),
        ];
        revolve(b, &profile, true, &turn);
    } else {
        let bevel = part.round.unwrap_or(0.0).clamp(0.0, 0.5) * 2.0 * half.y.min(low.min(high).max(widest * 0.1));
        let mut profile = Vec::new();
        if bevel > 0.001 * whole.largest && high > bevel && low > bevel {
            let steps = whole.bevel_segments(bevel) + 1;
            let arc = |k: usize| (FRAC_PI_2 * k as f64 / steps as f64).sin_cos();
            profile.extend((0..=steps).map(|k| {
                let (sin, cos) = arc(k);
                DVec2::new(low - bevel + bevel * sin, -half.y + bevel * (1.0 - cos))
            }));
            profile.extend((0..=steps).map(|k| {
                let (sin, cos) = arc(k);
                DVec2::new(high - bevel + bevel * cos, half.y - bevel + bevel * sin)
            }));
        } else {
            profile.extend([DVec2::new(low, -half.y), DVec2::new(high, half.y)]);
        }
        revolve(b, &profile, false, &turn);
    }
    b.piece_of_all();
}

pub(super) fn lathe(b: &mut SolidBuilder, half: DVec3, part: &Part, whole: &Whole) {
    let (radius, stretch) = section(half, part.oval.unwrap_or(false));
    let given = part.points.as_deref().unwrap_or(&[]);
    let mut profile: Vec<DVec2> = given.iter().map(|[r, y]| DVec2::new(r.clamp(0.0, 1.0), y.clamp(0.0, 1.0))).collect();
    if profile.len() < 2 {
        profile = vec![DVec2::new(1.0, 0.0), DVec2::new(1.0, 1.0)];
    }
    if profile.first().zip(profile.last()).is_some_and(|(a, b)| a.y > b.y) {
        profile.reverse();
    }
    if part.smooth.unwrap_or(true) {
        let steps = (40 / profile.len()).clamp(2, 5);
        profile = smooth_path(&profile, steps, false);
    }
    let count = profile.len();
    for (k, p) in profile.iter_mut().enumerate() {
        // only the ends may lie on the axis
        let least = if k == 0 || k == count - 1 { 0.0 } else { 0.015 };
        *p = DVec2::new(p.x.max(least) * radius, (p.y.clamp(0.0, 1.0) * 2.0 - 1.0) * half.y);
    }
    profile.dedup_by(|a, b| a.distance(*b) < 1e-4 * radius.max(half.y));
    if let Some(wall) = part.hollow.filter(|w| *w > 0.0) {
        let wall = wall.clamp(0.01, 0.9) * radius;
        let floor = -half.y + wall.min(half.y * 0.5);
        let inner: Vec<DVec2> = profile
            .iter()
            .rev()
            .map(|p| DVec2::new((p.x - wall).max(p.x * 0.3).max(0.01 * radius), p.y.max(floor)))
            .collect();
        let bottom = profile[0];
        if bottom.x > 0.0 {
            profile.insert(0, DVec2::new(0.0, bottom.y));
        }
        profile.extend(inner);
        profile.push(DVec2::new(0.0, floor));
        profile.dedup_by(|a, b| a.distance(*b) < 1e-4 * radius.max(half.y));
    }
    if profile.len() < 2 || profile.iter().all(|p| p.x <= 0.0) {
        profile = vec![DVec2::new(radius, -half.y), DVec2::new(radius, half.y)];
    }
    revolve(b, &profile, false, &Turn::round(whole.sides(radius), stretch));
    b.piece_of_all();
}
