//! Things on walls; their origin is the centre of their box, their back towards -Z.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::Vec3;

use super::{Origin, Piece, Sculptor};
use crate::generate::dice::{Dice, hash_unit};
use crate::generate::paint::{Look, Palette, draw, scaled};
use crate::generate::pictures;
use crate::generate::solid::{Patch, block, brick, lathe, pillow, rod, sheet, slab, tapered};

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// How far behind the wall's plane a pane lies, metres.
pub(in super::super) const PANE_BEHIND: f32 = 0.096;

/// Four bars around a rectangle of `w` by `h` (outer size), `t` wide, from z0 to z1.
fn bars(s: &mut Sculptor, look: usize, size: [f32; 2], t: f32, z: [f32; 2]) {
    let ([w, h], b, zc) = (size, z[1] - z[0], f32::midpoint(z[0], z[1]));
    let bevel = (t * 0.2).min(b * 0.3);
    for x in [-1.0_f32, 1.0] {
        s.add(look, block(t, h, b, bevel).moved(x * (w - t) / 2.0, -h / 2.0, zc));
    }
    for y in [-h / 2.0, h / 2.0 - t] {
        s.add(look, block(w - t, t, b, bevel).moved(0.0, y, zc));
    }
}

/// A window for an opening of `w` by `h`; z = 0 of the returned shift is the wall's plane.
///
/// Returns the piece and where its centre lies along the wall's normal.
pub(in super::super) fn window(d: &mut Dice, p: &Palette, w: f32, h: f32) -> (Piece, f64) {
    let mut s = Sculptor::new();
    let paint = s.look(Look::plain("frame", p.trim, 0.4));
    let mut pane = Look::picture("view", pictures::view(d));
    pane.material.emissive = [0.02; 3];
    let pane = s.look(pane);
    let t = d.f(0.04, 0.07);
    s.add(pane, brick(w - 0.004, h - 0.004, 0.008).moved(0.0, -h / 2.0 + 0.002, -PANE_BEHIND - 0.004));
    bars(&mut s, paint, [w - 0.002, h - 0.002], t, [-0.1, -0.045]);
    let columns = ((w / d.f(0.5, 0.9)).round() as usize).clamp(1, 3);
    for i in 1..columns {
        let x = w * (i as f32 / columns as f32 - 0.5);
        s.add(paint, block(t, h - t, 0.045, 0.008).moved(x, -h / 2.0 + t / 2.0, -0.072));
    }
    if d.chance(0.4) {
        let y = h * d.f(0.1, 0.3);
        s.add(paint, block(w - t, 0.03, 0.03, 0.006).moved(0.0, y, -0.075));
    }
    // Architrave and sill, proud of the wall.
    let proud = d.f(0.014, 0.024);
    let trim = d.f(0.04, 0.08);
    bars(&mut s, paint, [w + 2.0 * trim, h + 2.0 * trim], trim, [0.0005, proud]);
    if d.chance(0.7) {
        s.add(paint, block(w + 2.0 * trim + 0.04, 0.03, 0.09, 0.008).moved(0.0, -h / 2.0 - trim - 0.0, 0.0455));
    }
    let z =
        s.parts.iter().map(|(_, q)| q.bounds()).fold((0.0_f32, 0.0_f32), |(lo, hi), (a, b)| (lo.min(a.z), hi.max(b.z)));
    (s.finish("window", Origin::Centre), f64::from(f32::midpoint(z.0, z.1)))
}

/// Two wavy curtains on a rod for a window of `w` metres.
pub(in super::super) fn curtains(d: &mut Dice, p: &Palette, w: f32, h: f32) -> Piece {
    let mut s = Sculptor::new();
    let color = p.fabric(d);
    let cloth = Look::fabric(d, color);
    let cloth = s.look(cloth);
    let metal = s.look(Look::metal(p.metal));
    let (pleats, deep) = (d.f(5.0, 8.0), d.f(0.018, 0.03));
    let wide = d.f(0.26, 0.42);
    for x in [-1.0_f32, 1.0] {
        let phase = d.f(0.0, 6.0);
        let gather = if d.chance(0.3) { 0.35 } else { 0.0 };
        let flare = d.f(0.9, 1.1);
        let panel = sheet(36, 6, 0.006, |a, b| {
            let tie = 1.0 - gather * (1.0 - ((b - 0.4) * 2.4).powi(2)).max(0.0);
            let k = wide * tie * (flare + (1.0 - flare) * b);
            let wave = (a * pleats * TAU + phase + 0.6 * b).sin() * deep * (1.2 - 0.3 * b);
            v(x * (w / 2.0 + 0.13) - x * a * k, -h / 2.0 + b * (h - 0.03), wave)
        });
        s.add(cloth, panel);
        s.add(metal, pillow(v(0.026, 0.026, 0.026), 1.0, 1.0, 10, 8).moved(x * (w / 2.0 + 0.2), h / 2.0 - 0.02, 0.0));
    }
    let end = w / 2.0 + 0.19;
    s.add(metal, rod(v(-end, h / 2.0 - 0.02, 0.0), v(end, h / 2.0 - 0.02, 0.0), 0.011, 0.011, 8));
    s.finish("curtains", Origin::Centre)
}

/// A closed door leaf with its lining, on the wall.
pub(in super::super) fn door(d: &mut Dice, p: &Palette, w: f32, h: f32) -> Piece {
    let mut s = Sculptor::new();
    let color = if d.chance(0.6) { p.trim } else { p.woods[0] };
    let leaf = if d.chance(0.5) { Look::wood(d, color) } else { Look::plain("paint", color, 0.4) };
    let leaf = s.look(leaf);
    let frame = s.look(Look::plain("frame", p.trim, 0.4));
    let metal = s.look(Look::metal(p.metal));
    let t = 0.07;
    for x in [-1.0_f32, 1.0] {
        s.add(frame, block(t, h, 0.032, 0.008).moved(x * (w - t) / 2.0, 0.0, 0.016));
    }
    s.add(frame, block(w - t, t, 0.032, 0.008).moved(0.0, h - t, 0.016));
    s.add(leaf, brick(w - 2.0 * t + 0.004, h - t, 0.018).moved(0.0, 0.002, 0.009));
    let (rows, columns) = (d.int(1, 4), d.int(1, 2));
    let inner = w - 2.0 * t - 0.12;
    for i in 0..columns {
        for j in 0..rows {
            let (cw, ch) = (inner / columns as f32 - 0.05, (h - t - 0.2) / rows as f32 - 0.07);
            let x = inner * ((i as f32 + 0.5) / columns as f32 - 0.5);
            let y = 0.12 + (h - t - 0.2) * (j as f32 + 0.5) / rows as f32;
            let panel = tapered([cw, ch], [cw - 0.05, ch - 0.05], 0.012, 0.004).tilted(FRAC_PI_2, 0.0, 0.0);
            s.add(leaf, panel.moved(x, y, 0.016));
        }
    }
    let side = d.sign() as f32 * (w / 2.0 - t - 0.06);
    s.add(metal, rod(v(side, 1.02, 0.015), v(side, 1.02, 0.055), 0.012, 0.009, 8));
    s.add(metal, rod(v(side, 1.02, 0.05), v(side - side.signum() * 0.11, 1.015, 0.05), 0.009, 0.008, 8));
    s.finish("door", Origin::Centre)
}

/// A framed painting.
pub(in super::super) fn painting(d: &mut Dice, p: &Palette, w: f32, h: f32) -> Piece {
    let mut s = Sculptor::new();
    let color = if d.chance(0.5) { p.wood(d) } else { p.metal };
    let frame = s.look(Look::plain("frame", color, 0.4));
    let image = s.look(Look::picture("picture", pictures::painting(d, p)));
    let t = d.f(0.015, 0.06);
    let deep = d.f(0.018, 0.032);
    bars(&mut s, frame, [w, h], t, [0.0, deep]);
    s.add(image, brick(w - t, h - t, deep * 0.6).moved(0.0, -h / 2.0 + t / 2.0, deep * 0.3));
    s.finish("painting", Origin::Centre)
}

/// A mirror, oval or with soft corners, in a bulging frame.
pub(in super::super) fn mirror(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let frame = if d.chance(0.5) { Look::metal(p.metal) } else { Look::wood(d, p.woods[1]) };
    let frame = s.look(frame);
    let base = scaled(p.walls[0], 0.86);
    let image = draw(64, 64, |a, b| {
        let sheen = if (a + b * 0.6 - 0.5).abs() < 0.12 { 1.12 } else { 1.0 };
        scaled(base, (0.72 + 0.25 * b) * sheen)
    });
    let mut glass = Look::picture("mirror", image);
    glass.material.roughness = 0.05;
    let glass = s.look(glass);
    let (w, h, power) = (d.f(0.45, 0.75), d.f(0.55, 1.0), d.pick(&[2.0, 2.6, 5.0, 20.0]));
    let t = d.f(0.02, 0.05);
    let rim = |patch: Patch| patch.tilted(FRAC_PI_2, 0.0, 0.0);
    s.add(frame, rim(slab(w, 0.024, h, power, 40)));
    s.add(glass, rim(slab(w - 2.0 * t, 0.006, h - 2.0 * t, power, 40)).moved(0.0, 0.0, 0.0205));
    s.finish("mirror", Origin::Centre)
}

/// A round wall clock.
pub(in super::super) fn clock(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = if d.chance(0.5) { p.metal } else { p.wood(d) };
    let rim = s.look(Look::plain("rim", color, 0.4));
    let minute = d.f(0.0, TAU);
    let image = draw(96, 96, |a, b| {
        let (x, y) = (a - 0.5, b - 0.5);
        let (r, angle) = (x.hypot(y), x.atan2(-y));
        let tick = (angle / TAU * 12.0 + 12.5).fract() - 0.5;
        let hand = |at: f32, long: f32, wide: f32| {
            let (s, c) = at.sin_cos();
            let (along, off) = (x * s - y * c, x * c + y * s);
            along > -0.04 && along < long && off.abs() < wide
        };
        if (r > 0.36 && r < 0.44 && tick.abs() < 0.08)
            || hand(minute, 0.36, 0.012)
            || hand(minute / 12.0 + 2.0, 0.24, 0.018)
        {
            [40, 38, 38]
        } else {
            [240, 237, 228]
        }
    });
    let face = s.look(Look::picture("face", image));
    let r = d.f(0.13, 0.2);
    let turned = |patch: Patch| patch.tilted(FRAC_PI_2, 0.0, 0.0);
    s.add(
        rim,
        turned(lathe(
            &[(r * 0.94, 0.0), (r, 0.008), (r, 0.032), (r * 0.93, 0.038), (r * 0.9, 0.024), (r * 0.2, 0.022)],
            32,
            (0.0, 1.0),
        )),
    );
    s.add(face, turned(slab(r * 1.81, 0.004, r * 1.81, 2.0, 32)).moved(0.0, 0.0, 0.0225));
    s.finish("clock", Origin::Centre)
}

/// A shelf on brackets, flat on top.
pub(in super::super) fn wall_shelf(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let metal = s.look(Look::metal(p.metal));
    let (w, b, t) = (d.f(0.6, 1.15), d.f(0.18, 0.25), d.f(0.02, 0.04));
    s.add(wood, slab(w, t, b, 20.0, 28).moved(0.0, 0.0, b / 2.0));
    s.top(t, [0.0, b / 2.0], w * 0.92, b * 0.8, 0.5);
    for x in [-1.0_f32, 1.0] {
        let at = x * w * 0.34;
        s.add(
            metal,
            sheet(6, 2, 0.012, |a, c| {
                let z = 0.004 + (b - 0.03) * a;
                let low = -0.1 * (1.0 - a).powf(1.6) - 0.008;
                v(0.0, low + (0.002 - low) * c, z)
            })
            .moved(at, 0.0, 0.0),
        );
    }
    s.finish("wall shelf", Origin::Centre)
}

/// A kitchen cabinet on the wall.
pub(in super::super) fn wall_cabinet(d: &mut Dice, p: &Palette, w: f32, h: f32) -> Piece {
    let mut s = Sculptor::new();
    let color = p.woods[0];
    let body = Look::wood(d, color);
    let body = s.look(body);
    let metal = s.look(Look::metal(p.metal));
    let b = 0.33;
    s.add(body, tapered([w - 0.006, b - 0.02], [w - 0.006, b - 0.02], h, 0.006).moved(0.0, 0.0, b / 2.0 - 0.01));
    s.add(body, block(w - 0.012, h - 0.012, 0.022, 0.007).moved(0.0, 0.006, b - 0.014));
    s.add(metal, rod(v(w * 0.36, 0.06, b + 0.012), v(w * 0.36, 0.2, b + 0.012), 0.007, 0.007, 6));
    s.finish("wall cabinet", Origin::Centre)
}

/// A ribbed radiator under a window.
pub(in super::super) fn radiator(d: &mut Dice, p: &Palette, w: f32) -> Piece {
    let mut s = Sculptor::new();
    let paint = s.look(Look::plain("paint", scaled(p.trim, 0.97), 0.35));
    let h = d.f(0.45, 0.6);
    let n = (w / 0.075) as usize;
    for i in 0..n {
        let x = w * ((i as f32 + 0.5) / n as f32 - 0.5);
        s.add(paint, pillow(v(0.03, h / 2.0, 0.05), 0.3, 0.5, 8, 6).moved(x, 0.0, 0.055));
    }
    for y in [-h * 0.38, h * 0.38] {
        s.add(paint, rod(v(-w / 2.0, y, 0.05), v(w / 2.0, y, 0.05), 0.02, 0.02, 8));
    }
    let dent = hash_unit(n as u32, 3, 1);
    s.add(paint, brick(0.04, 0.05 + dent * 0.01, 0.05).moved(w * 0.4, -0.03, 0.026));
    s.finish("radiator", Origin::Centre)
}
