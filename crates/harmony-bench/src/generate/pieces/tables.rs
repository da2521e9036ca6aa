//! Tables and desks.

use glam::Vec3;

use super::{Origin, Piece, Sculptor};
use crate::generate::dice::Dice;
use crate::generate::paint::{Look, Palette};
use crate::generate::solid::{block, brick, lathe, leg, rod, slab, tapered, tube};

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// How a dining table stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) enum TableStyle {
    /// Four legs near the corners.
    Legs,
    /// One turned column.
    Pedestal,
}

/// A table top and its marked place; `power` 2 is round.
fn top(s: &mut Sculptor, look: usize, size: [f32; 2], h: f32, thick: f32, power: f32) {
    let [w, d] = size;
    s.add(look, slab(w, thick, d, power, if power < 4.0 { 36 } else { 28 }).moved(0.0, h - thick, 0.0));
    let share = if power < 3.0 { 0.68 } else { 0.9 };
    s.top(h, [0.0, 0.0], w * share, d * share, 1.0);
}

/// A dining table of `w` by `depth`.
pub(in super::super) fn dining_table(d: &mut Dice, p: &Palette, size: [f32; 2], style: TableStyle) -> Piece {
    let mut s = Sculptor::new();
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let [w, depth] = size;
    let (h, thick) = (d.f(0.72, 0.77), d.f(0.025, 0.05));
    match style {
        TableStyle::Legs => {
            let power = d.f(6.0, 30.0);
            top(&mut s, wood, size, h, thick, power);
            let (r, splay) = (d.f(0.026, 0.04), d.f(-0.02, 0.03));
            for (x, z) in [(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)] {
                let hip = v(x * (w / 2.0 - 0.09), h - thick + 0.005, z * (depth / 2.0 - 0.08));
                s.add(wood, leg(hip, v(hip.x + x * splay, 0.0, hip.z + z * splay), r, r * d.f(0.5, 0.7), 10));
            }
            for z in [-1.0_f32, 1.0] {
                let rail = brick(w - 0.2, 0.06, 0.02).moved(0.0, h - thick - 0.055, z * (depth / 2.0 - 0.09));
                s.add(wood, rail);
            }
        }
        TableStyle::Pedestal => {
            top(&mut s, wood, size, h, thick, 2.0 + d.f(0.0, 0.3));
            let (a, b, c) = (d.f(0.05, 0.09), d.f(0.035, 0.06), d.f(0.17, 0.24));
            let profile = [
                (c, 0.0),
                (c, 0.018),
                (c * 0.55, 0.05),
                (b, 0.16),
                (a, h * 0.4),
                (b, h * 0.7),
                (a * 1.6, h - thick + 0.005),
            ];
            s.add(wood, lathe(&profile, 24, (0.0, 1.0)));
        }
    }
    s.finish("dining table", Origin::Bottom)
}

/// A low table before a sofa.
pub(in super::super) fn coffee_table(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let metal = s.look(Look::metal(p.metal));
    let h = d.f(0.34, 0.46);
    let kind = d.int(0, 3);
    let (w, depth) = if kind == 0 {
        let r = d.f(0.6, 0.85);
        (r, r)
    } else {
        (d.f(0.85, 1.25), d.f(0.48, 0.65))
    };
    let power = [2.0, 2.4, 4.0, 16.0][kind];
    top(&mut s, wood, [w, depth], h, d.f(0.025, 0.06), power);
    match d.int(0, 2) {
        0 => {
            for (x, z) in [(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)] {
                let k = if power < 3.0 { 0.28 } else { 0.4 };
                let hip = v(x * w * k, h - 0.02, z * depth * k);
                s.add(wood, leg(hip, v(hip.x * 1.14, 0.0, hip.z * 1.14), 0.026, 0.014, 8));
            }
            if d.chance(0.5) {
                s.add(wood, slab(w * 0.7, 0.015, depth * 0.66, power, 24).moved(0.0, h * 0.4, 0.0));
            }
        }
        1 => {
            for x in [-1.0_f32, 1.0] {
                let a = x * w * if power < 3.0 { 0.25 } else { 0.4 };
                let z = depth * if power < 3.0 { 0.3 } else { 0.42 };
                let path = [
                    v(a, h - 0.02, -z),
                    v(a * 1.05, 0.03, -z * 0.96),
                    v(a * 1.08, 0.012, -z * 0.9),
                    v(a * 1.08, 0.012, z * 0.9),
                    v(a * 1.05, 0.03, z * 0.96),
                    v(a, h - 0.02, z),
                ];
                s.add(metal, tube(&path, &[0.012], 8));
            }
        }
        _ => s.add(wood, tapered([w * 0.5, depth * 0.55], [w * 0.36, depth * 0.4], h - 0.02, 0.03)),
    }
    s.finish("coffee table", Origin::Bottom)
}

/// A small table beside a seat.
pub(in super::super) fn side_table(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let metal = s.look(Look::metal(p.metal));
    let (w, h) = (d.f(0.36, 0.5), d.f(0.45, 0.62));
    let power = d.pick(&[2.0, 2.0, 3.5, 9.0]);
    top(&mut s, wood, [w, w * d.f(0.9, 1.0)], h, d.f(0.018, 0.035), power);
    if d.chance(0.5) {
        let n = d.int(3, 4);
        for i in 0..n {
            let (sin, cos) = ((i as f32 + 0.5) / n as f32 * std::f32::consts::TAU).sin_cos();
            let hip = v(cos * w * 0.3, h - 0.012, sin * w * 0.3);
            s.add(wood, leg(hip, v(cos * w * 0.42, 0.0, sin * w * 0.42), 0.018, 0.011, 8));
        }
    } else {
        let r = d.f(0.012, 0.03);
        let profile = [
            (w * 0.34, 0.0),
            (w * 0.33, 0.014),
            (r * 1.5, 0.035),
            (r, 0.1),
            (r * d.f(1.0, 2.2), h * 0.5),
            (r, h * 0.85),
            (r * 2.5, h - 0.012),
        ];
        s.add(metal, lathe(&profile, 20, (0.0, 1.0)));
    }
    s.finish("side table", Origin::Bottom)
}

/// A desk; its user sits on the +Z side.
pub(in super::super) fn desk(d: &mut Dice, p: &Palette, w: f32) -> Piece {
    let mut s = Sculptor::new();
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let metal = s.look(Look::metal(p.metal));
    let (depth, h, thick) = (d.f(0.6, 0.74), d.f(0.72, 0.76), d.f(0.024, 0.04));
    let power = d.f(8.0, 40.0);
    top(&mut s, wood, [w, depth], h, thick, power);
    let drawers = d.chance(0.6);
    let side = d.sign() as f32;
    for x in [-1.0_f32, 1.0] {
        if drawers && x == side {
            let bw = d.f(0.34, 0.42);
            let at = x * (w / 2.0 - bw / 2.0 - 0.02);
            s.add(wood, block(bw, h - thick + 0.002, depth - 0.06, 0.008).moved(at, 0.0, -0.01));
            let n = d.int(2, 4);
            for i in 0..n {
                let dh = (h - thick - 0.06) / n as f32;
                let y = 0.04 + i as f32 * dh;
                s.add(wood, block(bw - 0.03, dh - 0.015, 0.02, 0.006).moved(at, y, depth / 2.0 - 0.04));
                let y = y + dh * 0.62;
                let z = depth / 2.0 - 0.012;
                s.add(metal, rod(v(at - 0.06, y, z), v(at + 0.06, y, z), 0.007, 0.007, 6));
            }
        } else {
            for z in [-1.0_f32, 1.0] {
                let hip = v(x * (w / 2.0 - 0.07), h - thick + 0.004, z * (depth / 2.0 - 0.07));
                s.add(wood, leg(hip, v(hip.x + x * 0.02, 0.0, hip.z + z * 0.02), 0.026, 0.016, 8));
            }
        }
    }
    s.add(wood, brick(w - 0.2, d.f(0.08, 0.3), 0.016).moved(0.0, h - thick - 0.3, -depth / 2.0 + 0.08));
    s.finish("desk", Origin::Bottom)
}
