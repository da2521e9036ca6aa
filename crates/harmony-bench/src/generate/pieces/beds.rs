//! Beds, and who lies on them.

use glam::Vec3;

use super::{Origin, Piece, Sculptor};
use crate::generate::dice::Dice;
use crate::generate::paint::{Look, Palette, scaled};
use crate::generate::solid::{block, leg, pillow, sheet, slab};

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// A made bed with its head at -Z; its cover is flat where things may lie.
pub(in super::super) fn bed(d: &mut Dice, p: &Palette, w: f32, long: f32) -> Piece {
    let mut s = Sculptor::new();
    let color = p.wood(d);
    let soft = d.chance(0.5);
    let cloth_color = p.fabric(d);
    let frame = if soft { Look::fabric(d, cloth_color) } else { Look::wood(d, color) };
    let frame = s.look(frame);
    let cover_color = p.fabric(d);
    let cover = Look::fabric(d, cover_color);
    let cover = s.look(cover);
    let linen = s.look(Look::plain("linen", scaled([240, 236, 228], d.f(0.88, 1.0)), 0.9));
    let second = p.fabric(d);
    let second = Look::fabric(d, second);
    let second = s.look(second);
    let (leg_h, top) = (d.f(0.06, 0.18), d.f(0.46, 0.6));
    s.add(frame, block(w, 0.16, long - 0.08, 0.03).moved(0.0, leg_h, 0.04));
    for (x, z) in [(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)] {
        let hip = v(x * (w / 2.0 - 0.1), leg_h + 0.01, z * (long / 2.0 - 0.14));
        s.add(frame, leg(hip, v(hip.x + x * 0.02, 0.0, hip.z), 0.034, 0.02, 8));
    }
    let mattress = top - leg_h - 0.12;
    s.add(linen, slab(w - 0.05, mattress, long - 0.14, 9.0, 20).moved(0.0, leg_h + 0.1, 0.05));
    // The cover hangs over three sides with a wavy hem.
    let (from, to, hang, waves) = (-long / 2.0 + d.f(0.5, 0.75), long / 2.0 - 0.005, d.f(0.16, 0.3), d.f(9.0, 16.0));
    let half = w / 2.0 - 0.012;
    let phase = d.f(0.0, 6.0);
    let hem = |t: f32, out: f32| out * (0.5 + 0.5 * (t * waves + phase).sin()) * 0.03;
    let blanket = sheet(22, 10, 0.02, |a, b| {
        let (x, z) = ((a * 2.0 - 1.0) * (half + hang), from + b * (to + hang - from));
        let (ox, oz) = ((x.abs() - half).max(0.0), (z - to).max(0.0));
        let out = ox.max(oz) / hang;
        let (cx, cz) = (x.clamp(-half, half), z.min(to));
        let bulge = 0.02 * out.sqrt() + hem(if oz > ox { x } else { z }, out);
        let down = (ox.max(oz) - 0.012).max(0.0);
        v(
            cx + x.signum() * if ox > 0.0 { bulge } else { 0.0 },
            top + 0.012 - down,
            cz + if oz > 0.0 { bulge } else { 0.0 },
        )
    });
    s.add(cover, blanket);
    s.top(top + 0.022, [0.0, f32::midpoint(from, to)], w * 0.6, (to - from) * 0.6, 1.0);
    let pillows = if w > 1.3 { 2 } else { 1 };
    for i in 0..pillows {
        let x = if pillows == 1 { 0.0 } else { (i as f32 - 0.5) * w * 0.48 };
        let pw = if pillows == 1 { w * 0.36 } else { w * 0.22 };
        let head = pillow(v(pw, 0.085, 0.22), 0.8, 0.55, 16, 6).lumpy(0.008, 9.0, i as f32);
        s.add(linen, head.tilted(-0.18, d.f(-0.08, 0.08), 0.0).moved(x, top + 0.05, -long / 2.0 + 0.36));
        if d.chance(0.6) {
            let extra = pillow(v(0.19, 0.17, 0.06), 0.7, 0.8, 12, 6).tilted(-0.75, d.f(-0.2, 0.2), 0.0);
            s.add(second, extra.moved(x, top + 0.17, -long / 2.0 + 0.44));
        }
    }
    let (hh, arch, t) = (d.f(0.85, 1.3), d.f(0.0, 0.22), d.f(0.05, 0.1));
    let style = d.int(0, 2);
    let head = sheet(18, 3, t, |a, b| {
        let x = (a - 0.5) * (w + 0.04);
        let e = 2.0 * a - 1.0;
        let high = hh
            - match style {
                0 => arch * e * e,
                1 => arch * (1.0 - (e * 4.7).cos()) * 0.4,
                _ => 0.0,
            };
        v(
            x,
            0.18 + (high - 0.18) * b,
            -long / 2.0 + t / 2.0 - 0.03 * b * b + if soft { 0.012 * (a * 40.0).sin() } else { 0.0 },
        )
    });
    s.add(frame, head);
    s.finish("bed", Origin::Bottom)
}

/// A sitting teddy bear.
pub(in super::super) fn teddy(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = if d.chance(0.6) { [172, 120, 64] } else { p.fabric(d) };
    let fur = Look::fabric(d, color);
    let fur = s.look(fur);
    let nose = s.look(Look::plain("nose", [36, 28, 26], 0.4));
    let k = d.f(0.8, 1.4);
    let mut ball = |look: usize, at: Vec3, half: Vec3| {
        s.add(look, pillow(half * k, 1.0, 1.0, 12, 8).moved(at.x * k, at.y * k, at.z * k));
    };
    ball(fur, v(0.0, 0.085, 0.0), v(0.075, 0.085, 0.065));
    ball(fur, v(0.0, 0.215, 0.008), v(0.068, 0.062, 0.06));
    ball(fur, v(0.0, 0.2, 0.06), v(0.03, 0.025, 0.026));
    ball(nose, v(0.0, 0.21, 0.086), v(0.011, 0.009, 0.008));
    for x in [-1.0_f32, 1.0] {
        ball(fur, v(x * 0.052, 0.268, 0.0), v(0.024, 0.026, 0.014));
        ball(fur, v(x * 0.085, 0.12, 0.025), v(0.027, 0.05, 0.03));
        ball(fur, v(x * 0.06, 0.034, 0.085), v(0.034, 0.033, 0.062));
        ball(nose, v(x * 0.026, 0.23, 0.062), v(0.007, 0.008, 0.006));
    }
    s.finish("teddy bear", Origin::Bottom)
}
