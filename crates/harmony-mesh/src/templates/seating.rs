//! Sofas, chairs, stools, benches.

use std::f64::consts::PI;

use harmony_scene::MaterialCategory::{Fabric, Leather, Metal, Plastic, Wood};

use super::maker::{Maker, Piece};
use super::{ArmStyle, BackStyle, LegStyle, TemplateParams};
use crate::{Axis, Mirror, Shape};

/// A sofa: base, arms, back, seat and back cushions, legs. `extra` adds a chaise on the right.
pub(super) fn sofa(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#8d8b86", Fabric);
    m.slot("cushions", "#98968f", Fabric);
    m.slot("legs", "#4a3626", Wood);
    let (w, h, full_depth) = (m.w, m.h, m.d);
    let chaise = p.extra.unwrap_or(false) && w > 1.2;
    // with a chaise the body takes the rear part of the depth
    let d = if chaise { full_depth * 0.6 } else { full_depth };
    let legs = p.legs.unwrap_or(LegStyle::Four);
    let leg = if matches!(legs, LegStyle::Block | LegStyle::None) { 0.02 } else { (0.15 * h).min(0.13) };
    let seat_top = (0.52 * h).min(0.47);
    let cushion = (0.2 * h).clamp(0.06, 0.17);
    let back = (0.2 * d).clamp(0.06, 0.22);
    let arms = p.arms.unwrap_or(ArmStyle::Padded);
    let arm = if arms == ArmStyle::None { 0.0 } else { (0.1 * w).clamp(0.07, 0.22).min(w * 0.2) };
    let (left, right) =
        (if arms == ArmStyle::Right { 0.0 } else { arm }, if arms == ArmStyle::Left { 0.0 } else { arm });
    let arm_top = (0.7 * h).max(seat_top + 0.04).min(h);
    let soft = 0.045_f64.min(h * 0.07);
    let base_top = seat_top - cushion * 0.8;
    let base = [left * 0.6, w - right * 0.6];
    m.add(Piece::new(Shape::Box, "body", base, [leg, base_top], [back * 0.3, d - 0.015]).round(soft * 0.5));
    let panel = Piece::new(Shape::Box, "body", [left * 0.5, w - right * 0.5], [leg, h * 0.93], [0.0, back]);
    m.add(panel.round(soft));
    let arm_piece = |x: [f64; 2]| -> Vec<Piece> {
        match arms {
            ArmStyle::Rolled => {
                let roll = (x[1] - x[0]) * 0.62;
                let cx = f64::midpoint(x[0], x[1]);
                vec![
                    Piece::new(Shape::Box, "body", [cx - arm * 0.36, cx + arm * 0.36], [leg, arm_top - roll], [0.0, d])
                        .round(soft * 0.6),
                    Piece::new(
                        Shape::Cylinder,
                        "body",
                        [cx - roll, cx + roll],
                        [arm_top - roll * 2.0, arm_top],
                        [0.01, d],
                    )
                    .axis(Axis::Z)
                    .round(0.02),
                ]
            }
            ArmStyle::Open => {
                let t = (0.06_f64).min(arm);
                let cx = f64::midpoint(x[0], x[1]);
                let x = [cx - t / 2.0, cx + t / 2.0];
                vec![
                    Piece::new(Shape::Box, "legs", x, [0.0, arm_top - t], [d * 0.9 - t, d * 0.9]).round(t * 0.2),
                    Piece::new(Shape::Box, "legs", x, [0.0, arm_top - t], [d * 0.12, d * 0.12 + t]).round(t * 0.2),
                    Piece::new(Shape::Box, "legs", [x[0] - 0.01, x[1] + 0.01], [arm_top - t * 0.7, arm_top], [0.0, d])
                        .round(t * 0.3),
                ]
            }
            _ => vec![Piece::new(Shape::Box, "body", x, [leg, arm_top], [0.0, d]).round(soft * 1.2)],
        }
    };
    if left > 0.0 {
        for piece in arm_piece([0.0, arm]) {
            m.add(piece);
        }
    }
    if right > 0.0 {
        for piece in arm_piece([w - arm, w]) {
            m.add(piece);
        }
    }
    let inner = [left + 0.004, w - right - 0.004];
    let seats = p.seats.unwrap_or(((inner[1] - inner[0]) / 0.72).round().max(1.0) as u32).clamp(1, 8);
    let step = (inner[1] - inner[0]) / f64::from(seats);
    let tufted = p.back == Some(BackStyle::Tufted);
    for k in 0..seats {
        let x = [inner[0] + step * f64::from(k) + 0.003, inner[0] + step * f64::from(k + 1) - 0.003];
        let long = chaise && k == seats - 1;
        let front = if long { full_depth } else { d };
        let y = [seat_top - cushion, seat_top];
        m.add(Piece::new(Shape::Cushion, "cushions", x, y, [back * 0.85, front]).puff(0.18));
        if long {
            m.add(
                Piece::new(Shape::Box, "body", [x[0], w], [leg, base_top], [d - 0.05, full_depth - 0.015])
                    .round(soft * 0.5),
            );
        }
        if tufted {
            continue;
        }
        let top = h - 0.004;
        let thick = (0.16 * d).clamp(0.06, 0.17);
        let y = [seat_top - 0.02, top];
        let lean = 9.0;
        let z = [back * 0.75, back * 0.75 + thick];
        m.add(Piece::new(Shape::Cushion, "cushions", x, y, z).puff(0.42).turn(-lean, 0.0, 0.0));
    }
    if tufted {
        channels(m, "cushions", inner, [seat_top - 0.02, h], [back * 0.7, back * 1.35]);
    }
    let pillows = p.cushions.unwrap_or(0).min(8);
    for k in 0..pillows {
        m.slot("pillows", "#b9a98c", Fabric);
        let side = (0.42_f64).min(h * 0.5).min(step);
        let spread = inner[1] - inner[0] - side;
        let from_left = k % 2 == 0;
        let nth = f64::from(k / 2) * side * 0.62;
        let x0 = if from_left { inner[0] + nth.min(spread) } else { inner[1] - side - nth.min(spread) };
        let z0 = back + (0.15 * d).min(0.13) + 0.02 * f64::from(k / 2);
        let lean = if from_left { 12.0 } else { -12.0 };
        let y = [seat_top - 0.01, seat_top - 0.01 + side];
        let pillow = Piece::new(Shape::Cushion, "pillows", [x0, x0 + side], y, [z0, z0 + side * 0.34]);
        m.add(pillow.puff(0.85).turn(-18.0, lean, 0.0));
    }
    match legs {
        LegStyle::None => {}
        LegStyle::Block => m.cube("legs", [0.04, w - 0.04], [0.0, leg + 0.01], [0.04, d - 0.04]),
        _ if chaise => {
            // six feet under the L
            let t = 0.05_f64.min(w * 0.08);
            let long = w - step;
            for (x, z) in [
                (0.05, 0.05),
                (0.05, d - 0.06 - t),
                (w - 0.06 - t, 0.05),
                (w - 0.06 - t, full_depth - 0.06 - t),
                (long + 0.05, full_depth - 0.06 - t),
                (long - 0.02, d - 0.06 - t),
            ] {
                let foot = Piece::new(Shape::Cylinder, "legs", [x, x + t], [0.0, leg + 0.01], [z, z + t]);
                m.add(foot.top(1.5));
            }
        }
        other => m.legs(other, "legs", leg + 0.01, 0.05, (0.05_f64).min(w * 0.08)),
    }
}

/// Vertical padded channels.
fn channels(m: &mut Maker, slot: &str, x: [f64; 2], y: [f64; 2], z: [f64; 2]) {
    let count = ((x[1] - x[0]) / 0.14).round().clamp(3.0, 16.0);
    let step = (x[1] - x[0]) / count;
    let piece = Piece::new(Shape::Cushion, slot, [x[0], x[0] + step], y, z).puff(0.45);
    m.row(piece, Axis::X, count as u32, step);
}

/// An armchair, or a tub chair when the back is curved.
pub(super) fn armchair(m: &mut Maker, p: &TemplateParams) {
    if p.back != Some(BackStyle::Curved) && p.round != Some(true) {
        let mut p = p.clone();
        p.seats = Some(1);
        p.extra = None;
        p.legs = p.legs.or(Some(LegStyle::Tapered));
        return sofa(m, &p);
    }
    m.slot("body", "#7d7468", Fabric);
    m.slot("cushions", "#8a8175", Fabric);
    m.slot("legs", "#3d2c20", Wood);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let leg = (0.16 * h).min(0.14);
    let seat = 0.5 * h;
    let shell = 0.1 * w.min(d);
    let back = Piece::new(Shape::Back, "body", [0.0, w], [leg * 1.1, h], [0.0, d * 0.9]);
    m.add(back.bend(220.0).top(0.66).thick(shell, s).round(0.5 * shell));
    let base = Piece::new(
        Shape::Cylinder,
        "body",
        [shell * 0.7, w - shell * 0.7],
        [leg, seat - 0.06],
        [shell * 0.6, d * 0.97],
    );
    m.add(base.oval().round(0.03));
    let pad = Piece::new(Shape::Lathe, "cushions", [shell, w - shell], [seat - 0.1, seat + 0.03], [shell, d]);
    m.add(pad.oval().points(&[
        [0.0, 0.0],
        [0.9, 0.0],
        [0.99, 0.25],
        [1.0, 0.55],
        [0.93, 0.85],
        [0.6, 0.97],
        [0.0, 1.0],
    ]));
    m.legs(p.legs.unwrap_or(LegStyle::Tapered), "legs", leg + 0.02, 0.14 * w, 0.04);
}

/// A dining chair.
pub(super) fn chair(m: &mut Maker, p: &TemplateParams) {
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let back = p.back.unwrap_or(BackStyle::Slat);
    let legs = p.legs.unwrap_or(LegStyle::Four);
    let padded = matches!(back, BackStyle::Upholstered | BackStyle::Tufted | BackStyle::Curved);
    if padded {
        m.slot("seat", "#8b8377", Fabric);
        m.slot("frame", "#5a4230", Wood);
    } else {
        m.slot("frame", "#7d5636", Wood);
        m.slot("seat", "#86603f", Wood);
    }
    let seat = if back == BackStyle::None { h } else { (0.52 * h).min(0.48) };
    let t = (0.085 * w).clamp(0.02, 0.045);
    let thick = if padded { 0.09_f64 } else { 0.035 }.min(seat * 0.3);
    let seat_shape = if padded || p.cushions.is_some_and(|n| n > 0) { Shape::Cushion } else { Shape::Slab };
    let mut pad = Piece::new(seat_shape, "seat", [0.0, w], [seat - thick, seat], [0.02, d]).puff(0.22).corner(0.16);
    if seat_shape == Shape::Slab {
        pad = pad.round(thick * 0.35);
    }
    m.add(pad);
    let under = seat - thick * 0.8;
    match legs {
        LegStyle::Four | LegStyle::Block | LegStyle::None | LegStyle::Trestle => {
            let leg = Piece::new(Shape::Box, "frame", [0.012, 0.012 + t], [0.0, under], [0.03, 0.03 + t]);
            m.add(leg.round(t * 0.15).square(Axis::Y).mirror(Mirror::Xz));
            let apron = t * 1.4;
            m.cube("frame", [t, w - t], [under - apron, under], [d - 0.03 - t * 0.8, d - 0.03 - t * 0.2]);
            m.add(
                Piece::new(Shape::Box, "frame", [0.012 + t * 0.2, 0.012 + t * 0.8], [under - apron, under], [t, d - t])
                    .mirror(Mirror::X),
            );
        }
        other => m.legs(other, "frame", under, 0.015, t),
    }
    let lean = 7.0;
    let y = [seat - thick * 0.5, h];
    let z0 = 0.02;
    match back {
        BackStyle::None => {}
        BackStyle::Upholstered => {
            let pad = Piece::new(Shape::Cushion, "seat", [0.01, w - 0.01], [seat - thick * 0.4, h], [z0, z0 + 0.085]);
            m.add(pad.puff(0.15).turn(-lean, 0.0, 0.0));
        }
        BackStyle::Tufted => channels(m, "seat", [0.0, w], [seat - thick * 0.4, h], [z0, z0 + 0.09]),
        BackStyle::Curved => {
            let shell = Piece::new(Shape::Back, "seat", [0.0, w], [seat - thick * 0.3, h], [0.0, d * 0.62]);
            m.add(shell.bend(175.0).top(0.5).thick(0.045_f64.min(d * 0.2), s));
        }
        BackStyle::Solid => {
            let shell = Piece::new(Shape::Back, "seat", [0.01, w - 0.01], [seat + 0.06, h], [z0, z0 + d * 0.16]);
            m.add(shell.bend(55.0).thick(0.018, s).turn(-lean, 0.0, 0.0));
            let post = Piece::new(Shape::Box, "frame", [w * 0.16, w * 0.16 + t * 0.8], y, [z0, z0 + t * 0.6]);
            m.add(post.round(t * 0.15).turn(-lean * 0.7, 0.0, 0.0).mirror(Mirror::X));
        }
        BackStyle::Ladder | BackStyle::Slat | BackStyle::Mesh | BackStyle::Bars => {
            let post = Piece::new(Shape::Box, "frame", [0.012, 0.012 + t], y, [z0, z0 + t * 0.8]);
            m.add(post.round(t * 0.2).turn(-lean, 0.0, 0.0).mirror(Mirror::X));
            let rise = h - seat;
            // what lies higher lies further back
            let behind = |y: f64| z0 - (y - (y0_mid(seat, thick, h))) * (lean * PI / 180.0).tan();
            let rail = |y: f64, height: f64, slot: &str| {
                let z = behind(y);
                Piece::new(Shape::Slab, slot, [t, w - t], [y - height / 2.0, y + height / 2.0], [z, z + t * 0.5])
                    .corner(0.2)
                    .turn(-lean, 0.0, 0.0)
            };
            match back {
                BackStyle::Ladder => {
                    let rungs = p.shelves.unwrap_or(3).clamp(1, 6);
                    for k in 0..rungs {
                        let y = h - 0.035 - rise * 0.72 * f64::from(k) / f64::from(rungs);
                        m.add(rail(y, (rise * 0.13).min(0.07), "frame"));
                    }
                }
                BackStyle::Mesh => {
                    m.add(rail(h - 0.03, 0.05, "frame"));
                    m.add(rail(seat + rise * 0.2, 0.04, "frame"));
                    m.slot("mesh", "#c9b48c", Wood);
                    let y = seat + rise * 0.57;
                    m.add(rail(y, rise * 0.7, "mesh"));
                }
                _ => {
                    m.add(rail(h - 0.035, 0.07_f64.min(rise * 0.25), "frame"));
                    m.add(rail(seat + rise * 0.14, 0.035_f64.min(rise * 0.1), "frame"));
                    let slats = p.shelves.unwrap_or(((w - 2.0 * t) / 0.07).round() as u32).clamp(2, 9);
                    let step = (w - 2.0 * t) / f64::from(slats);
                    let slim = (step * 0.4).min(0.035);
                    let x0 = t + step / 2.0;
                    let y = [seat + rise * 0.12, h - 0.04];
                    let z = behind(f64::midpoint(y[0], y[1])) + t * 0.1;
                    let slat = Piece::new(Shape::Box, "frame", [x0 - slim / 2.0, x0 + slim / 2.0], y, [z, z + t * 0.3]);
                    m.row(slat.round(t * 0.08).turn(-lean, 0.0, 0.0), Axis::X, slats, step);
                }
            }
        }
    }
    if p.arms.is_some_and(|a| a != ArmStyle::None) && back != BackStyle::None {
        let y = seat + (h - seat) * 0.48;
        let arm = Piece::new(Shape::Slab, "frame", [0.0, t * 1.3], [y - t * 0.5, y], [z0, d * 0.85]);
        m.add(arm.corner(0.3).mirror(Mirror::X));
        let post =
            Piece::new(Shape::Box, "frame", [t * 0.2, t * 1.1], [seat - thick, y - t * 0.4], [d * 0.8 - t, d * 0.8]);
        m.add(post.round(t * 0.15).mirror(Mirror::X));
    }
}

fn y0_mid(seat: f64, thick: f64, top: f64) -> f64 {
    f64::midpoint(seat - thick * 0.5, top)
}

/// An office chair on castors.
pub(super) fn office_chair(m: &mut Maker, p: &TemplateParams) {
    m.slot("seat", "#2c2d30", Fabric);
    m.slot("frame", "#3a3b3e", Plastic);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let seat = (0.48 * h).min(0.52);
    let thick = 0.085_f64.min(seat * 0.25);
    let wide = w * 0.78;
    let x = [(w - wide) / 2.0, f64::midpoint(w, wide)];
    m.legs(p.legs.unwrap_or(LegStyle::StarWheels), "frame", seat - thick * 0.7, 0.06, 0.04);
    m.add(Piece::new(Shape::Cushion, "seat", x, [seat - thick, seat], [d * 0.16, d * 0.94]).puff(0.3));
    m.cube("frame", [w * 0.35, w * 0.65], [seat - thick - 0.03, seat - thick * 0.8], [d * 0.3, d * 0.75]);
    let headrest = p.extra.unwrap_or(h > 1.12);
    let back_top = if headrest { h * 0.86 } else { h };
    let y = [seat + (h - seat) * 0.1, back_top];
    let z = [d * 0.02, d * 0.2];
    let mesh = matches!(p.back, None | Some(BackStyle::Mesh));
    if mesh {
        let shell = Piece::new(Shape::Back, "seat", [x[0] + 0.01, x[1] - 0.01], y, [z[0], z[1] + d * 0.03]);
        m.add(shell.bend(70.0).thick(0.03, s).turn(-8.0, 0.0, 0.0));
    } else {
        m.add(Piece::new(Shape::Cushion, "seat", x, y, z).puff(0.35).turn(-8.0, 0.0, 0.0));
    }
    let spine = [w * 0.46, w * 0.54];
    m.add(
        Piece::new(Shape::Tube, "frame", spine, [seat - thick - 0.02, seat + (h - seat) * 0.45], [0.0, d * 0.42])
            .thick(0.04, s)
            .smooth(true)
            .path(&[[0.5, 0.0, 1.0], [0.5, 0.02, 0.4], [0.5, 0.25, 0.06], [0.5, 1.0, 0.1]]),
    );
    if headrest {
        let head = [w * 0.3, w * 0.7];
        m.add(Piece::new(Shape::Cushion, "seat", head, [h * 0.88, h], [d * 0.0, d * 0.1]).puff(0.4));
        m.cube("frame", [w * 0.47, w * 0.53], [h * 0.8, h * 0.92], [d * 0.0, d * 0.03]);
    }
    if p.arms != Some(ArmStyle::None) {
        let y = seat + (h - seat) * 0.36;
        let pad = Piece::new(Shape::Slab, "frame", [0.0, w * 0.1], [y - 0.03, y], [d * 0.32, d * 0.76]);
        m.add(pad.corner(0.4).mirror(Mirror::X));
        let post = Piece::new(Shape::Tube, "frame", [w * 0.03, w * 0.3], [seat - thick - 0.01, y], [d * 0.5, d * 0.58]);
        m.add(post.thick(0.03, s).path(&[[1.0, 0.0, 0.5], [0.08, 0.1, 0.5], [0.0, 1.0, 0.5]]).mirror(Mirror::X));
    }
}

/// A stool, low or bar height.
pub(super) fn stool(m: &mut Maker, p: &TemplateParams) {
    m.slot("seat", "#8a6542", Wood);
    m.slot("legs", "#6b4d33", Wood);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let back = p.back.filter(|b| *b != BackStyle::None);
    let seat = if back.is_some() { h * 0.76 } else { h };
    let padded = p.cushions.is_some_and(|n| n > 0);
    let thick = if padded { 0.08 } else { 0.035_f64 }.min(seat * 0.25);
    let round = p.round.unwrap_or((w - d).abs() < 0.12 * w);
    let y = [seat - thick, seat];
    let top = match (round, padded) {
        (true, true) => Piece::new(Shape::Lathe, "seat", [0.0, w], y, [0.0, d]).oval().points(&[
            [0.0, 0.0],
            [0.92, 0.0],
            [1.0, 0.4],
            [0.95, 0.8],
            [0.6, 0.97],
            [0.0, 1.0],
        ]),
        (true, false) => Piece::new(Shape::Cylinder, "seat", [0.0, w], y, [0.0, d]).oval().round(thick * 0.35),
        (false, true) => Piece::new(Shape::Cushion, "seat", [0.0, w], y, [0.0, d]).puff(0.2),
        (false, false) => Piece::new(Shape::Slab, "seat", [0.0, w], y, [0.0, d]).corner(0.12),
    };
    m.add(top);
    let t = (0.09 * w).clamp(0.018, 0.04);
    let legs = p.legs.unwrap_or(LegStyle::Tapered);
    m.legs(legs, "legs", seat - thick * 0.8, w * 0.06, t);
    if matches!(legs, LegStyle::Four | LegStyle::Tapered) && seat > 0.35 {
        let y = seat * 0.36;
        let inset = if legs == LegStyle::Four { w * 0.08 } else { w * 0.1 };
        let ring = Piece::new(Shape::Tube, "legs", [inset, w - inset], [y, y + t * 0.6], [inset, d - inset]);
        m.add(
            ring.thick(t * 0.6, s).path(&[[0.0, 0.5, 0.0], [1.0, 0.5, 0.0], [1.0, 0.5, 1.0], [0.0, 0.5, 1.0]]).closed(),
        );
    }
    if back.is_some() {
        let shell = Piece::new(Shape::Back, "seat", [0.0, w], [seat + (h - seat) * 0.35, h], [0.0, d * 0.4]);
        m.add(shell.bend(130.0).thick(0.025, s));
        let post = Piece::new(Shape::Box, "legs", [w * 0.2, w * 0.2 + t], [seat - thick, h * 0.95], [0.01, 0.01 + t]);
        m.add(post.mirror(Mirror::X));
    }
}

/// A bench: board or padded seat.
pub(super) fn bench(m: &mut Maker, p: &TemplateParams) {
    let padded = p.cushions.is_some_and(|n| n > 0) || p.back == Some(BackStyle::Upholstered);
    m.slot("seat", if padded { "#9b9184" } else { "#8b6543" }, if padded { Fabric } else { Wood });
    m.slot("legs", "#5f4630", Wood);
    let (w, h, d) = (m.w, m.h, m.d);
    let back = p.back.filter(|b| *b != BackStyle::None);
    let seat = if back.is_some() { (0.52 * h).min(0.47) } else { h };
    let thick = if padded { 0.1 } else { 0.045_f64 }.min(seat * 0.3);
    let shape = if padded { Shape::Cushion } else { Shape::Slab };
    m.add(Piece::new(shape, "seat", [0.0, w], [seat - thick, seat], [0.0, d]).corner(0.04).puff(0.15));
    m.legs(p.legs.unwrap_or(LegStyle::Four), "legs", seat - thick * 0.9, 0.04, 0.055_f64.min(d * 0.2));
    if back.is_some() {
        let t = 0.04_f64.min(d * 0.15);
        let post = Piece::new(Shape::Box, "legs", [0.04, 0.04 + t], [seat - thick, h], [0.0, t]);
        m.add(post.mirror(Mirror::X));
        let gap = (h - seat) / 3.0;
        let board = Piece::new(Shape::Slab, "seat", [0.0, w], [seat + gap * 0.5, seat + gap * 1.2], [t * 0.5, t]);
        m.row(board, Axis::Y, 3, gap * 0.9);
    }
}

/// An ottoman or pouffe.
pub(super) fn ottoman(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#a08f7c", Fabric);
    m.slot("legs", "#4a3626", Wood);
    let (w, h, d) = (m.w, m.h, m.d);
    if p.round.unwrap_or((w - d).abs() < 0.06 * w) {
        m.add(Piece::new(Shape::Lathe, "body", [0.0, w], [0.0, h], [0.0, d]).oval().points(&[
            [0.0, 0.0],
            [0.8, 0.0],
            [0.93, 0.12],
            [1.0, 0.45],
            [0.96, 0.78],
            [0.8, 0.94],
            [0.45, 0.99],
            [0.0, 1.0],
        ]));
        return;
    }
    let legs = p.legs.unwrap_or(LegStyle::Tapered);
    let leg = if legs == LegStyle::None { 0.0 } else { (0.25 * h).min(0.14) };
    let top = (0.35 * (h - leg)).min(0.14);
    m.add(Piece::new(Shape::Box, "body", [0.01, w - 0.01], [leg, h - top * 0.7], [0.01, d - 0.01]).round(0.03));
    m.add(Piece::new(Shape::Cushion, "body", [0.0, w], [h - top, h], [0.0, d]).puff(0.2));
    m.legs(legs, "legs", leg + 0.01, 0.05, 0.04);
}

/// A leather or fabric bean bag.
pub(super) fn bean_bag(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#6f7680", Leather);
    let (w, h, d) = (m.w, m.h, m.d);
    m.add(Piece::new(Shape::Lathe, "body", [0.0, w], [0.0, h * 0.8], [0.0, d]).oval().points(&[
        [0.0, 0.0],
        [0.75, 0.0],
        [0.97, 0.12],
        [1.0, 0.35],
        [0.85, 0.65],
        [0.55, 0.88],
        [0.0, 1.0],
    ]));
    let y = [h * 0.35, h];
    m.add(Piece::new(Shape::Cushion, "body", [w * 0.16, w * 0.84], y, [0.0, d * 0.5]).puff(0.9).turn(-20.0, 0.0, 0.0));
}

/// A rail with hooks or a stand for coats.
pub(super) fn coat_rack(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#6b4a30", Wood);
    m.slot("hooks", "#3a3a3c", Metal);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    if h < 0.5 {
        m.add(Piece::new(Shape::Slab, "body", [0.0, w], [0.0, h], [0.0, d * 0.25]));
        let n = (w / 0.12).clamp(2.0, 12.0) as u32;
        let step = w / f64::from(n);
        let hook = Piece::new(Shape::Tube, "hooks", [step * 0.4, step * 0.6], [h * 0.15, h * 0.7], [d * 0.2, d]);
        let hook = hook.thick(0.012, s).path(&[[0.5, 0.8, 0.0], [0.5, 0.2, 0.5], [0.5, 0.3, 0.9], [0.5, 1.0, 1.0]]);
        m.row(hook, Axis::X, n, step);
        return;
    }
    let r = 0.022;
    let (cx, cz) = (w / 2.0, d / 2.0);
    m.add(Piece::new(Shape::Cylinder, "body", [cx - r, cx + r], [0.0, h], [cz - r, cz + r]));
    for k in 0..4 {
        let azimuth = 45.0 + 90.0 * f64::from(k);
        let arm = Piece::new(
            Shape::Tube,
            "body",
            [cx - 0.012, cx + 0.012],
            [h * 0.84, h * 0.97],
            [cz - w.min(d) * 0.48, cz + w.min(d) * 0.48],
        );
        if k < 2 {
            m.add(arm.thick(0.02, s).turn(0.0, azimuth, 0.0).path(&[
                [0.5, 1.0, 0.0],
                [0.5, 0.1, 0.42],
                [0.5, 0.1, 0.58],
                [0.5, 1.0, 1.0],
            ]));
        }
    }
    for azimuth in [45.0, 135.0] {
        let foot = Piece::new(Shape::Box, "body", [cx - 0.02, cx + 0.02], [0.0, 0.05], [0.0, d]);
        m.add(foot.turn(0.0, azimuth, 0.0).round(0.008));
    }
}
