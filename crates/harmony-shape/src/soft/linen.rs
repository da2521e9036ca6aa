//! Rolled and folded cloths.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::noise::{Dice, noise2};
use super::sheet::Middle;
use crate::Piece;

/// A rolled sheet lying along x on `y = 0`: `width` long, `radius` outside, with `turns` that show at its ends.
///
/// The free end lies at the back, low. The roll gives way a little where it lies.
pub fn roll(width: f64, radius: f64, turns: f64, thick: f64) -> Piece {
    let width = width.clamp(0.01, 10.0);
    let radius = radius.clamp(0.005, 2.0);
    let thick = thick.clamp(0.0005, radius * 0.5);
    // Turns that fit, and no fewer than it takes to be a roll.
    let turns = turns.clamp(1.2, 30.0).min((radius / thick - 0.6).max(1.2));
    let half = thick / 2.0;
    let pitch = ((radius - half) - 0.6 * thick) / turns;
    let rows = 2 * ((turns * 20.0) as usize).clamp(16, 300) + 1;
    let nu = 2 * ((width / 0.05).ceil() as usize).clamp(2, 12) + 1;
    let mut points = Vec::with_capacity(nu * rows);
    let mut flat = Vec::with_capacity(nu * rows);
    let mut length = 0.0;
    for j in 0..rows {
        let t = j as f64 / (rows - 1) as f64;
        let r = radius - half - pitch * turns * t;
        if j > 0 {
            length += r * TAU * turns / (rows - 1) as f64;
        }
        for i in 0..nu {
            let u = i as f64 / (nu - 1) as f64;
            // The free end is behind and below; the roll is wound over the top towards it.
            let angle = -0.75 * PI + TAU * turns * t;
            let (s, c) = libm::sincos(angle);
            let uneven = noise2(u * width / 0.08, t * turns * 2.0, 17);
            // Layers are not quite flush at the ends.
            let x = (u - 0.5) * width + 0.012 * radius * noise2(t * turns * 1.5, 3.0 * u, 5);
            let rr = r + 0.10 * pitch.min(thick) * uneven;
            let (y, z) = (rr * s, rr * c);
            let y = if y < -0.82 * radius { -0.82 * radius + (y + 0.82 * radius) * 0.35 } else { y };
            points.push(DVec3::new(x, y, z));
            flat.push(DVec2::new(u * width, length));
        }
    }
    let middle = Middle { points, flat, nu, nv: rows };
    let mut piece = middle.thickened(|_, _| half);
    // The spiral draws in at once: made as wide as it was asked to be.
    let (lo, hi) = piece.bounds().unwrap_or_default();
    let fit = 2.0 * radius / (hi.z - lo.z).max(1e-6);
    for p in &mut piece.positions {
        p.y *= fit;
        p.z = (p.z - f64::midpoint(lo.z, hi.z)) * fit;
    }
    let low = piece.positions.iter().fold(f64::MAX, |m, p| m.min(p.y));
    for p in &mut piece.positions {
        p.y -= low;
    }
    piece
}

/// A folded cloth of width and depth `size` standing on `y = 0`: `layers` of `thick` with rounded folds at the front.
///
/// One sheet in a zigzag; every layer lies a little differently.
pub fn folded(size: [f64; 2], layers: u32, thick: f64, seed: u32) -> Piece {
    let [w, d] = size.map(|v| v.clamp(0.02, 5.0));
    let layers = layers.clamp(1, 40) as usize;
    let thick = thick.clamp(0.0005, d * 0.2);
    let mut dice = Dice::new(seed, 31);
    let radius = thick * 0.5;
    let straight = (d - 2.0 * (radius + thick / 2.0)).max(d * 0.3);
    let steps = (straight / 0.03).ceil().clamp(3.0, 20.0) as usize;
    // The path in (z, y): from the back of the lowest layer to the front, up, back, up, ...
    let mut path: Vec<DVec2> = Vec::new();
    for k in 0..layers {
        let y = (k as f64 + 0.5) * thick;
        let slip = 0.015 * d * dice.bell();
        let (from, to) = if k % 2 == 0 { (-straight / 2.0, straight / 2.0) } else { (straight / 2.0, -straight / 2.0) };
        for s in 0..=steps {
            path.push(DVec2::new(from + (to - from) * s as f64 / steps as f64 + slip, y));
        }
        if k + 1 < layers {
            let (side, bend) = (to.signum(), 1.0 + 0.25 * dice.unit());
            for s in 1..6 {
                let (sin, cos) = libm::sincos(-PI / 2.0 + PI * f64::from(s) / 6.0);
                path.push(DVec2::new(to + slip + side * radius * bend * 1.3 * cos, y + radius + radius * sin));
            }
        }
    }
    let nu = ((w / 0.035).ceil() as usize).clamp(4, 24) + 1;
    let (mut points, mut flat) = (Vec::new(), Vec::new());
    let (mut length, mut last) = (0.0, path[0]);
    for p in &path {
        length += p.distance(last);
        last = *p;
        for i in 0..nu {
            let u = i as f64 / (nu - 1) as f64;
            let level = p.y / thick;
            // Layers sag between and slip against each other; more so higher up.
            let rise = thick * 0.16 * noise2(u * w / 0.09, p.x / 0.09 + 7.3 * level.floor(), seed);
            let lift = thick
                * 0.10
                * layers.min(8) as f64
                * (level / layers as f64)
                * noise2(u * w / 0.2, p.x / 0.2, seed ^ 9);
            let slip = 0.006 * noise2(u * 3.0, level * 1.7, seed ^ 2);
            let narrow = 1.0 - 0.02 * (0.5 + 0.5 * noise2(level * 2.1, 0.3, seed ^ 4));
            points.push(DVec3::new((u - 0.5) * w * narrow, p.y + rise + lift, p.x + slip));
            flat.push(DVec2::new(u * w, length));
        }
    }
    let middle = Middle { points, flat, nu, nv: path.len() };
    let mut piece = middle.divided().thickened(|_, _| thick * 0.46);
    let low = piece.positions.iter().fold(f64::MAX, |m, p| m.min(p.y));
    for p in &mut piece.positions {
        p.y -= low;
    }
    piece
}

#[cfg(test)]
mod tests {
    use super::super::grid::testing::sound;
    use super::*;

    #[test]
    fn rolls_and_stacks_have_their_sizes() {
        let r = roll(0.4, 0.06, 4.0, 0.009);
        sound(&r);
        let (lo, hi) = r.bounds().unwrap();
        assert!((hi.x - lo.x - 0.4).abs() < 0.02 && (hi.z - lo.z - 0.12).abs() < 0.01, "{lo} {hi}");
        assert!(lo.y.abs() < 1e-9 && (0.1..0.125).contains(&hi.y));
        let f = folded([0.4, 0.3], 4, 0.02, 3);
        sound(&f);
        let (lo, hi) = f.bounds().unwrap();
        assert!((hi.y - 0.08).abs() < 0.02 && (hi.z - lo.z - 0.3).abs() < 0.04, "{lo} {hi}");
        assert_eq!(f, folded([0.4, 0.3], 4, 0.02, 3));
        sound(&folded([0.3, 0.3], 1, 0.01, 1));
        sound(&roll(0.1, 0.005, 50.0, 1.0));
    }
}
