//! Things to sit on.

use glam::Vec3;

use super::{Origin, Piece, Sculptor};
use crate::generate::dice::Dice;
use crate::generate::paint::{Look, Palette, Rgb};
use crate::generate::solid::{block, lathe, leg, oval, pillow, rod, sheet, skin, slab, tapered, tube};

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// A chair without arms: splayed legs, a dished seat and one of three curved backs.
pub(in super::super) fn chair(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let (wood_color, cloth) = (p.wood(d), p.fabric(d));
    let wood = if d.chance(0.75) { Look::wood(d, wood_color) } else { Look::metal(p.metal) };
    let wood = s.look(wood);
    let soft = if d.chance(0.55) { Look::fabric(d, cloth) } else { Look::wood(d, wood_color) };
    let soft = s.look(soft);
    let (w, depth, sh) = (d.f(0.40, 0.47), d.f(0.39, 0.44), d.f(0.44, 0.47));
    let (bh, lean) = (d.f(0.78, 1.02), d.f(0.05, 0.11));
    let (thick, power, dish) = (d.f(0.025, 0.06), d.f(3.0, 7.0), d.f(0.004, 0.014));
    let seat = slab(w, thick, depth, power, 20).warped(|q| {
        let back = 1.0 + 0.08 * (q.z / depth);
        v(q.x * back, q.y + dish * ((q.x / w) * (q.x / w) * 8.0 - 1.0), q.z)
    });
    s.add(soft, seat.moved(0.0, sh - thick, 0.0));
    let (splay, r, hip) = (d.f(0.0, 0.035), d.f(0.013, 0.02), sh - thick + 0.012);
    for x in [-1.0_f32, 1.0] {
        let a = x * (w / 2.0 - 0.035);
        s.add(
            wood,
            leg(v(a, hip, depth / 2.0 - 0.045), v(a + x * splay, 0.0, depth / 2.0 - 0.03 + splay), r, r * 0.65, 8),
        );
        let post = [
            v(a + x * splay, 0.0, -depth / 2.0 - 0.03),
            v(a, sh * 0.6, -depth / 2.0 + 0.012),
            v(a, sh + 0.02, -depth / 2.0 + 0.01),
            v(a * 1.02, sh + (bh - sh) * 0.6, -depth / 2.0 - lean * 0.45),
            v(a * 1.02, bh, -depth / 2.0 - lean),
        ];
        s.add(wood, tube(&post, &[r * 0.8, r, r, r * 0.85, r * 0.7], 8).warped(|q| v(q.x, q.y.max(0.0), q.z)));
    }
    let bow = d.f(0.02, 0.05);
    let back = |u: f32, y: f32| {
        let x = (u - 0.5) * (w - 0.05);
        let t = ((y - sh) / (bh - sh)).clamp(0.0, 1.0);
        v(x, y, -depth / 2.0 + 0.005 - lean * t.powf(1.3) - bow * (1.0 - 4.0 * (u - 0.5) * (u - 0.5)))
    };
    match d.int(0, 2) {
        0 => {
            let (low, high) = (sh + d.f(0.06, 0.2), bh + d.f(0.0, 0.03));
            s.add(soft, sheet(10, 6, 0.025, |u, t| back(u, low + (high - low) * t)));
        }
        1 => {
            let n = d.int(2, 4);
            for i in 0..n {
                let y = sh + (bh - sh) * (0.3 + 0.68 * i as f32 / n as f32);
                let h = (bh - sh) * 0.42 / n as f32;
                s.add(wood, sheet(8, 2, 0.014, |u, t| back(u, y + h * t + 0.012 * (u * std::f32::consts::TAU).sin())));
            }
        }
        _ => {
            s.add(wood, sheet(8, 2, 0.022, |u, t| back(u, bh - 0.06 + 0.06 * t)));
            let n = d.int(3, 6);
            for i in 0..n {
                let u = 0.14 + 0.72 * i as f32 / (n - 1) as f32;
                let path = [back(u, sh - 0.01) + v(0.0, 0.0, 0.02), back(u, f32::midpoint(sh, bh)), back(u, bh - 0.03)];
                s.add(wood, tube(&path, &[0.008, 0.011, 0.008], 6));
            }
        }
    }
    s.finish("chair", Origin::Bottom)
}

/// An upholstered armchair whose back and arms are one bent shell.
pub(in super::super) fn armchair(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let cloth_color = p.fabric(d);
    let cloth = Look::fabric(d, cloth_color);
    let cloth = s.look(cloth);
    let feet = Look::wood(d, p.woods[1]);
    let feet = s.look(feet);
    let (w, depth) = (d.f(0.68, 0.92), d.f(0.68, 0.86));
    let (leg_h, seat_h) = (d.f(0.09, 0.2), d.f(0.38, 0.46));
    let (back_h, arm_h) = (d.f(0.72, 0.98), d.f(0.52, 0.66));
    let (thick, flare, power) = (d.f(0.07, 0.12), d.f(0.0, 0.1), d.f(2.6, 5.0));
    let (a, b) = (w / 2.0 - thick, depth / 2.0 - thick);
    // From the left arm's front, around the back, to the right arm's front.
    let n = 22;
    let rings: Vec<Vec<Vec3>> = (0..=n)
        .map(|i| {
            let t = i as f32 / n as f32;
            let angle = (0.14 - 1.28 * t) * std::f32::consts::PI;
            let (sin, cos) = angle.sin_cos();
            let bend = |c: f32| c.signum() * c.abs().powf(2.0 / power);
            let (x, z) = (-bend(cos) * a, bend(sin) * b);
            let behind = ((-sin).max(0.0)).powf(0.7);
            let top = arm_h + (back_h - arm_h) * behind;
            let out = v(x / a, 0.0, z / b).normalize_or(Vec3::X);
            (0..10)
                .map(|k| {
                    let (s, c) = (k as f32 / 10.0 * std::f32::consts::TAU).sin_cos();
                    let y = leg_h + (top - leg_h) * (0.5 + 0.5 * s.signum() * s.abs().powf(0.5));
                    let up = (y - leg_h) / (top - leg_h);
                    v(x, y, z) + out * (thick * 0.5 * c.signum() * c.abs().powf(0.7) + flare * up * up)
                })
                .collect()
        })
        .collect();
    s.add(cloth, skin(&rings));
    let base = slab(w - thick * 1.4, seat_h - leg_h - 0.06, depth - thick * 0.9, power, 20);
    s.add(cloth, base.moved(0.0, leg_h, thick * 0.3));
    let cushion = pillow(v(a - thick * 0.4, 0.075, depth / 2.0 - thick * 0.7), 0.6, 0.45, 20, 8);
    s.add(cloth, cushion.lumpy(0.004, 9.0, 1.0).moved(0.0, seat_h - 0.05, thick * 0.45));
    s.top(seat_h + 0.02, [0.0, 0.05], 0.05, 0.05, 0.0);
    for (x, z) in [(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)] {
        let (hx, hz) = (x * a * 0.75, z * b * 0.72);
        s.add(feet, leg(v(hx, leg_h + 0.02, hz), v(hx + x * 0.04, 0.0, hz + z * 0.04), 0.026, 0.014, 8));
    }
    let mut piece = s.finish("armchair", Origin::Bottom);
    piece.tops.clear();
    piece
}

/// A sofa, straight or with a chaise (then `corner` is the side it is on, -1 or 1).
pub(in super::super) fn sofa(d: &mut Dice, p: &Palette, width: f32, corner: Option<f32>) -> Piece {
    let mut s = Sculptor::new();
    let color = p.fabrics[0];
    let cloth = Look::fabric(d, color);
    let cloth = s.look(cloth);
    let accent = p.fabric(d);
    let accent = Look::fabric(d, accent);
    let accent = s.look(accent);
    let feet = Look::wood(d, p.woods[1]);
    let feet = s.look(feet);
    let (depth, leg_h, seat_h) = (d.f(0.82, 0.98), d.f(0.05, 0.16), d.f(0.38, 0.45));
    let (back_h, arm_h, arm_w) = (d.f(0.74, 0.92), d.f(0.54, 0.66), d.f(0.12, 0.22));
    let (back_t, lean) = (d.f(0.16, 0.22), d.f(0.04, 0.1));
    s.add(cloth, slab(width - 0.04, seat_h - leg_h - 0.1, depth - 0.04, 14.0, 24).moved(0.0, leg_h, 0.0));
    let sag = d.f(-0.03, 0.05);
    let n = 12;
    let rings: Vec<Vec<Vec3>> = (0..=n)
        .map(|i| {
            let t = i as f32 / n as f32 * 2.0 - 1.0;
            let top = back_h + sag * (1.0 - t * t);
            oval((top - leg_h) / 2.0, back_t / 2.0, 4.0, 0.0, 14)
                .into_iter()
                .map(|q| {
                    let y = leg_h + (top - leg_h) / 2.0 + q.x;
                    let up = (y - leg_h) / (top - leg_h);
                    v(t * (width / 2.0 - 0.03), y, -depth / 2.0 + back_t / 2.0 + lean - lean * up + q.z)
                })
                .collect()
        })
        .collect();
    s.add(cloth, skin(&rings));
    let (roll, out) = (d.f(0.0, 0.5), d.f(0.0, 0.05));
    for x in [-1.0_f32, 1.0] {
        let rings: Vec<Vec<Vec3>> = (0..=6)
            .map(|i| {
                let t = i as f32 / 6.0;
                let h = arm_h - leg_h - 0.05 * (t - 0.2).max(0.0);
                let soft = 1.0 - 0.25 * ((t - 0.5).abs() * 2.0).powf(6.0);
                oval(arm_w / 2.0 * soft, h / 2.0 * (0.97 + 0.03 * soft), 3.5, 0.0, 14)
                    .into_iter()
                    .map(|q| {
                        let up = (q.z / h + 0.5).clamp(0.0, 1.0);
                        let wide = 1.0 + roll * 0.6 * up.powf(4.0);
                        let x = x * (width / 2.0 - arm_w / 2.0 + out * up) + q.x * wide;
                        v(x, leg_h + h / 2.0 + q.z, -depth / 2.0 + 0.02 + t * (depth - 0.03))
                    })
                    .collect()
            })
            .collect();
        s.add(cloth, skin(&rings));
    }
    let inner = width - 2.0 * arm_w;
    let seats = if width > 1.95 && d.chance(0.6) { 3 } else { 2 };
    for i in 0..seats {
        let (w, x) = (inner / seats as f32, inner * ((i as f32 + 0.5) / seats as f32 - 0.5));
        let front = depth - back_t - lean;
        let seat = pillow(v(w / 2.0, 0.085, front / 2.0), 0.4, 0.3, 16, 6).lumpy(0.004, 7.0, i as f32);
        s.add(cloth, seat.moved(x, seat_h - 0.065, depth / 2.0 - front / 2.0 + 0.01));
        let back = pillow(v(w / 2.0 - 0.01, 0.2, 0.085), 0.55, 0.6, 12, 6).tilted(-0.22, d.f(-0.04, 0.04), 0.0);
        s.add(cloth, back.moved(x, seat_h + 0.2, -depth / 2.0 + back_t + lean + 0.05));
    }
    if d.chance(0.6) {
        let (x, turn) = (d.f(-0.4, 0.4) * inner, d.f(-0.3, 0.3));
        let throw = pillow(v(0.2, 0.2, 0.07), 0.7, 0.9, 12, 6).tilted(-0.4, turn, 0.1);
        s.add(accent, throw.moved(x, seat_h + 0.22, -depth / 2.0 + back_t + lean + 0.2));
    }
    let mut corners = vec![(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
    if let Some(side) = corner {
        let (w, long) = (inner / seats as f32 + arm_w * 0.9, d.f(0.55, 0.8));
        let x = side * (width / 2.0 - w / 2.0);
        s.add(cloth, slab(w, seat_h - leg_h - 0.1, long, 10.0, 20).moved(x, leg_h, depth / 2.0 + long / 2.0 - 0.05));
        let seat = pillow(v(w / 2.0 - 0.01, 0.085, long / 2.0), 0.4, 0.3, 16, 6);
        s.add(cloth, seat.moved(x, seat_h - 0.065, depth / 2.0 + long / 2.0 - 0.03));
        corners.push((side, 1.0 + 2.0 * (long - 0.1) / depth));
    }
    for (x, z) in corners {
        let hip = v(x * (width / 2.0 - 0.12), leg_h + 0.01, z * (depth / 2.0 - 0.1));
        s.add(feet, leg(hip, v(hip.x + x * 0.03, 0.0, hip.z), 0.028, 0.016, 8));
    }
    s.finish("sofa", Origin::Bottom)
}

/// A swivel chair on a star base.
pub(in super::super) fn office_chair(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let frame = s.look(Look::plain("plastic", [44, 44, 48], 0.4));
    let color = p.fabric(d);
    let cloth = Look::fabric(d, color);
    let cloth = s.look(cloth);
    let (w, sh, bh) = (d.f(0.46, 0.52), d.f(0.44, 0.5), d.f(0.9, 1.12));
    let turn = d.f(0.0, 1.2);
    for i in 0..5 {
        let (sin, cos) = (turn + i as f32 * 1.2566).sin_cos();
        let at = |r: f32, y: f32| v(r * cos, y, r * sin);
        s.add(frame, tube(&[at(0.0, 0.12), at(0.15, 0.105), at(0.28, 0.07)], &[0.026, 0.02, 0.014], 6));
        s.add(frame, pillow(v(0.022, 0.028, 0.022), 1.0, 1.0, 8, 6).moved(0.28 * cos, 0.028, 0.28 * sin));
    }
    s.add(frame, rod(v(0.0, 0.1, 0.0), v(0.0, sh - 0.05, 0.0), 0.028, 0.022, 8));
    s.add(cloth, pillow(v(w / 2.0, 0.05, w / 2.0 - 0.01), 0.5, 0.5, 20, 8).moved(0.0, sh - 0.05, 0.0));
    let bow = d.f(0.03, 0.07);
    let (low, wide) = (sh + 0.12, w * d.f(0.8, 0.98));
    let back = sheet(10, 8, 0.035, |a, t| {
        let x = (a - 0.5) * wide * (1.0 - 0.25 * (t - 0.45) * (t - 0.45) * 4.0);
        let bend = bow * (1.0 - 4.0 * (a - 0.5) * (a - 0.5));
        v(x, low + (bh - low) * t, -w / 2.0 - 0.02 - bend - 0.07 * t * t)
    });
    s.add(cloth, back);
    let spine = [v(0.0, sh - 0.06, -0.1), v(0.0, sh - 0.04, -w / 2.0 - 0.08), v(0.0, sh + 0.25, -w / 2.0 - 0.05 - bow)];
    s.add(frame, tube(&spine, &[0.02, 0.022, 0.016], 6));
    s.finish("office chair", Origin::Bottom)
}

fn top_cloth(s: &mut Sculptor, d: &mut Dice, color: Rgb) -> usize {
    let look = Look::fabric(d, color);
    s.look(look)
}

/// A low round or lobed seat.
pub(in super::super) fn pouf(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = p.fabric(d);
    let cloth = top_cloth(&mut s, d, color);
    let (r, h, lobes) = (d.f(0.2, 0.3), d.f(0.34, 0.45), d.int(6, 12) as f32);
    let profile =
        [(r * 0.85, 0.0), (r, h * 0.18), (r * 1.04, h * 0.5), (r, h * 0.82), (r * 0.8, h * 0.97), (r * 0.3, h)];
    s.add(cloth, lathe(&profile, 40, (d.f(0.0, 0.04), lobes)));
    s.finish("pouf", Origin::Bottom)
}

/// A three-legged stool.
pub(in super::super) fn stool(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let (r, h) = (d.f(0.15, 0.19), d.f(0.43, 0.66));
    s.add(wood, lathe(&[(r * 0.9, h - 0.035), (r, h - 0.02), (r, h - 0.008), (r * 0.94, h)], 24, (0.0, 1.0)));
    s.top(h, [0.0, 0.0], r * 1.2, r * 1.2, 1.0);
    for i in 0..3 {
        let (sin, cos) = (0.4 + i as f32 * 2.094).sin_cos();
        let out = d.f(0.02, 0.05);
        let hip = v(cos * r * 0.7, h - 0.02, sin * r * 0.7);
        s.add(wood, leg(hip, v(cos * (r + out), 0.0, sin * (r + out)), 0.02, 0.013, 8));
    }
    s.finish("stool", Origin::Bottom)
}

/// A long seat, upholstered or of wood.
pub(in super::super) fn bench(d: &mut Dice, p: &Palette, width: f32) -> Piece {
    let mut s = Sculptor::new();
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let color = p.fabric(d);
    let cloth = top_cloth(&mut s, d, color);
    let (depth, h) = (d.f(0.34, 0.42), d.f(0.42, 0.48));
    s.add(wood, slab(width, 0.04, depth, 12.0, 20).moved(0.0, h - 0.09, 0.0));
    s.add(cloth, pillow(v(width / 2.0 - 0.01, 0.05, depth / 2.0 - 0.01), 0.35, 0.2, 24, 8).moved(0.0, h - 0.05, 0.0));
    for x in [-1.0_f32, 1.0] {
        if width > 1.1 {
            s.add(
                wood,
                tapered([0.05, depth * 0.9], [0.07, depth * 0.6], h - 0.085, 0.01).moved(x * width * 0.38, 0.0, 0.0),
            );
        } else {
            for z in [-1.0_f32, 1.0] {
                let hip = v(x * width * 0.4, h - 0.08, z * depth * 0.36);
                s.add(wood, leg(hip, v(hip.x + x * 0.03, 0.0, hip.z + z * 0.02), 0.024, 0.015, 8));
            }
        }
    }
    s.add(wood, block(width * 0.76, 0.03, 0.03, 0.006).moved(0.0, h * 0.4, 0.0));
    s.finish("bench", Origin::Bottom)
}
