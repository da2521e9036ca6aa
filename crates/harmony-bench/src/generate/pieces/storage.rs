//! Cabinets, shelves and wardrobes.

use glam::Vec3;

use super::{Origin, Piece, Sculptor};
use crate::generate::dice::Dice;
use crate::generate::paint::{Look, Palette, scaled};
use crate::generate::solid::{block, brick, leg, pillow, rod, slab, tapered};

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// Fronts of doors or drawers on a face of `w` by `h` whose lower left corner is at (-w/2, y0), with handles.
fn fronts(s: &mut Sculptor, d: &mut Dice, looks: [usize; 2], face: [f32; 4], grid: [usize; 2]) {
    let [w, h, y0, z] = face;
    let [columns, rows] = grid;
    let (gap, proud) = (d.f(0.006, 0.014), d.f(0.012, 0.024));
    let knob = d.int(0, 2);
    let inset = d.chance(0.4);
    for i in 0..columns {
        for j in 0..rows {
            let (cw, ch) = (w / columns as f32, h / rows as f32);
            let (x, y) = (-w / 2.0 + (i as f32 + 0.5) * cw, y0 + j as f32 * ch);
            s.add(looks[0], block(cw - gap, ch - gap, proud, 0.006).moved(x, y + gap / 2.0, z + proud / 2.0 - 0.004));
            if inset && ch > 0.3 && cw > 0.25 {
                let panel = tapered([cw - 0.14, ch - 0.14], [cw - 0.2, ch - 0.2], 0.014, 0.004).tilted(
                    std::f32::consts::FRAC_PI_2,
                    0.0,
                    0.0,
                );
                s.add(looks[0], panel.moved(x, y + ch / 2.0, z + proud - 0.008));
            }
            let door = ch > cw * 0.9;
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let (hx, hy) = if door { (x + side * (cw / 2.0 - 0.05), y + ch * 0.52) } else { (x, y + ch * 0.6) };
            let hz = z + proud + 0.012;
            match knob {
                0 => s.add(looks[1], pillow(v(0.015, 0.015, 0.02), 1.0, 1.0, 8, 6).moved(hx, hy, hz)),
                1 if door => s.add(looks[1], rod(v(hx, hy - 0.07, hz), v(hx, hy + 0.07, hz), 0.009, 0.009, 6)),
                _ => s.add(looks[1], brick(if door { 0.02 } else { 0.12 }, 0.018, 0.036).moved(hx, hy, hz - 0.01)),
            }
        }
    }
}

/// Feet under a body of `w` by `depth`.
fn feet(s: &mut Sculptor, look: usize, w: f32, depth: f32, h: f32) {
    for (x, z) in [(-1.0_f32, 1.0_f32), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)] {
        let hip = v(x * (w / 2.0 - 0.07), h + 0.004, z * (depth / 2.0 - 0.07));
        s.add(look, leg(hip, v(hip.x + x * 0.025, 0.0, hip.z + z * 0.02), 0.024, 0.014, 8));
    }
}

/// A closed cabinet with feet, doors or drawers, and a top that stands out.
pub(in super::super) fn cabinet(d: &mut Dice, p: &Palette, label: &'static str, size: [f32; 3]) -> Piece {
    let mut s = Sculptor::new();
    let [w, h, depth] = size;
    let color = p.wood(d);
    let wood = if d.chance(0.7) { Look::wood(d, color) } else { Look::plain("paint", color, 0.4) };
    let wood = s.look(wood);
    let other = if d.chance(0.4) { p.wood(d) } else { scaled(color, d.f(0.86, 1.08)) };
    let front = Look::wood(d, other);
    let front = s.look(front);
    let metal = s.look(Look::metal(p.metal));
    let foot = if label.contains("base cabinet") { 0.07 } else { d.f(0.04, 0.17) };
    let thick = d.f(0.02, 0.04);
    let lip = d.f(0.0, 0.012);
    s.add(
        wood,
        tapered([w - 0.02, depth - 0.03], [w - 0.02 * d.f(0.0, 2.0), depth - 0.03], h - foot - thick + 0.004, 0.008)
            .moved(0.0, foot, -0.01),
    );
    s.add(wood, slab(w, thick, depth + lip, 30.0, 28).moved(0.0, h - thick, 0.0));
    if foot < 0.08 {
        s.add(wood, brick(w - 0.06, foot + 0.004, depth - 0.1).moved(0.0, 0.0, -0.02));
    } else {
        feet(&mut s, wood, w, depth - 0.05, foot);
    }
    let columns = ((w / d.f(0.42, 0.62)).round() as usize).clamp(1, 4);
    let rows = if d.chance(0.5) { 1 } else { ((h / 0.25) as usize).clamp(1, 4) };
    let face = [w - 0.05, h - foot - thick - 0.03, foot + 0.015, depth / 2.0 - 0.026];
    fronts(&mut s, d, [front, metal], face, [columns, rows]);
    s.top(h, [0.0, 0.0], w * 0.93, depth * 0.86, 1.2);
    s.finish(label, Origin::Bottom)
}

/// A small cabinet beside the bed.
pub(in super::super) fn nightstand(d: &mut Dice, p: &Palette) -> Piece {
    let size = [d.f(0.38, 0.5), d.f(0.44, 0.58), d.f(0.36, 0.42)];
    cabinet(d, p, "nightstand", size)
}

/// A wardrobe with a cornice.
pub(in super::super) fn wardrobe(d: &mut Dice, p: &Palette, height: f32) -> Piece {
    let mut s = Sculptor::new();
    let (w, depth) = (d.f(0.9, 1.9), d.f(0.54, 0.62));
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let metal = s.look(Look::metal(p.metal));
    let crown = d.f(0.03, 0.08);
    s.add(wood, tapered([w - 0.05, depth - 0.05], [w - 0.05, depth - 0.06], height - crown, 0.012));
    s.add(wood, tapered([w - 0.05, depth - 0.05], [w, depth], crown, 0.01).moved(0.0, height - crown, 0.0));
    s.add(wood, tapered([w, depth - 0.02], [w - 0.04, depth - 0.04], d.f(0.06, 0.12), 0.01));
    let columns = ((w / 0.5).round() as usize).clamp(2, 4);
    let face = [w - 0.08, height - crown - 0.16, 0.13, depth / 2.0 - 0.032];
    let rows = if d.chance(0.3) { 2 } else { 1 };
    fronts(&mut s, d, [wood, metal], face, [columns, rows]);
    s.top(height, [0.0, 0.0], w * 0.85, depth * 0.75, 0.4);
    s.finish("wardrobe", Origin::Bottom)
}

/// An open bookcase with slightly bowed sides, filled with books and now and then a box.
pub(in super::super) fn bookcase(d: &mut Dice, p: &Palette, size: [f32; 3]) -> Piece {
    let mut s = Sculptor::new();
    let [w, h, depth] = size;
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let colors: Vec<usize> = (0..5)
        .map(|i| {
            let c = if i % 2 == 0 { p.fabric(d) } else { p.glaze(d) };
            s.look(Look::plain("paper", c, 0.8))
        })
        .collect();
    let t = d.f(0.018, 0.03);
    let taper = d.f(0.8, 1.0);
    for x in [-1.0_f32, 1.0] {
        let side = tapered([t, depth], [t, depth * taper], h, 0.004);
        let shift = depth * (taper - 1.0) / 2.0 / h;
        s.add(wood, side.warped(|q| v(q.x + x * (w / 2.0 - t / 2.0), q.y, q.z + shift * q.y)));
    }
    s.add(wood, brick(w - t, h - 0.02, 0.01).moved(0.0, 0.01, -depth / 2.0 + 0.005));
    let n = ((h / d.f(0.3, 0.38)) as usize).max(2);
    let inner = depth * taper;
    let zc = -depth / 2.0 + inner / 2.0;
    for i in 0..=n {
        let y = if i == n { h - t } else { 0.05 + (h - 0.05) * i as f32 / n as f32 };
        s.add(wood, brick(w - t * 1.2, t, inner - 0.01).moved(0.0, y, zc));
        if i == n || d.chance(0.12) {
            continue;
        }
        let room = (h - 0.05) / n as f32 - t - 0.03;
        let (mut x, end) = (-w / 2.0 + t + 0.008, w / 2.0 - t - d.f(0.01, 0.25));
        while x < end - 0.05 {
            let (bw, bh) = (d.f(0.016, 0.05), room * d.f(0.62, 0.97));
            let bd = (inner - 0.05) * d.f(0.7, 0.95);
            let look = d.pick(&colors);
            s.add(look, brick(bw, bh, bd).moved(x + bw / 2.0, y + t - 0.002, zc + 0.01));
            x += bw + 0.001;
            if d.chance(0.07) {
                x += d.f(0.05, 0.15);
            }
        }
    }
    s.top(h, [0.0, zc], w * 0.9, inner * 0.8, 0.5);
    s.finish("bookcase", Origin::Bottom)
}
