//! What hangs on or fills a hole in a wall, and textiles.

use harmony_scene::MaterialCategory::{Fabric, Glass, Metal, Paper, Plastic, Stone, Wood};

use super::TemplateParams;
use super::lights::circle;
use super::maker::{Maker, Piece, Span};
use crate::{Axis, Mirror, Shape};

/// Four boards around an opening.
fn frame(m: &mut Maker, slot: &str, x: Span, y: Span, z: Span, width: f64) {
    let r = (width * 0.12).min(0.006);
    m.add(Piece::new(Shape::Box, slot, [x[0], x[0] + width], y, z).round(r));
    m.add(Piece::new(Shape::Box, slot, [x[1] - width, x[1]], y, z).round(r));
    let inner = [x[0] + width * 0.9, x[1] - width * 0.9];
    m.add(Piece::new(Shape::Box, slot, inner, [y[0], y[0] + width], z).round(r));
    m.add(Piece::new(Shape::Box, slot, inner, [y[1] - width, y[1]], z).round(r));
}

pub(super) fn window(m: &mut Maker, p: &TemplateParams) {
    m.slot("frame", "#ece9e3", Wood);
    m.slot("glass", "#cfe0ea", Glass);
    let (w, h, d) = (m.w, m.h, m.d);
    let casing = (0.07 * w.min(h)).clamp(0.02, 0.09);
    let sash = casing * 0.6;
    let sill = if h > 0.5 { 0.03_f64.min(h * 0.05) } else { 0.0 };
    let z = [0.0, d * if sill > 0.0 { 0.7 } else { 1.0 }];
    frame(m, "frame", [0.0, w], [sill * 0.9, h], z, casing);
    if sill > 0.0 {
        m.add(Piece::new(Shape::Box, "frame", [0.0, w], [0.0, sill], [0.0, d]).round(0.004));
    }
    let [columns, rows] = p.panes.unwrap_or([if w > h * 0.75 { 2 } else { 1 }, 1]).map(|n| n.clamp(1, 8));
    let (x, y) = ([casing, w - casing], [sill + casing, h - casing]);
    let (sx, sy) = ((x[1] - x[0]) / f64::from(columns), (y[1] - y[0]) / f64::from(rows));
    let zs = [d * 0.12, d * 0.52];
    m.add(Piece::new(
        Shape::Box,
        "glass",
        [x[0] * 0.8, w - x[0] * 0.8],
        [y[0] - casing * 0.2, y[1] + casing * 0.2],
        [d * 0.27, d * 0.37],
    ));
    if columns * rows <= 4 {
        for i in 0..columns {
            for j in 0..rows {
                let px = [x[0] + sx * f64::from(i), x[0] + sx * f64::from(i + 1)];
                let py = [y[0] + sy * f64::from(j), y[0] + sy * f64::from(j + 1)];
                frame(m, "frame", px, py, zs, sash);
            }
        }
    } else {
        frame(m, "frame", x, y, zs, sash);
        let bar = sash * 0.28;
        if columns > 1 {
            let piece = Piece::new(Shape::Box, "frame", [x[0] + sx - bar, x[0] + sx + bar], y, zs);
            m.row(piece, Axis::X, columns - 1, sx);
        }
        if rows > 1 {
            let piece = Piece::new(Shape::Box, "frame", x, [y[0] + sy - bar, y[0] + sy + bar], [zs[0], zs[1] - 0.001]);
            m.row(piece, Axis::Y, rows - 1, sy);
        }
    }
}

pub(super) fn door(m: &mut Maker, p: &TemplateParams) {
    m.slot("leaf", "#d9d2c6", Wood);
    m.slot("frame", "#e6e1d8", Wood);
    m.slot("handle", "#8d8a84", Metal);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let casing = (0.075 * w).clamp(0.02, 0.08);
    let body = (d * 0.55).max(d - 0.07);
    let z = [0.0, body];
    m.add(Piece::new(Shape::Box, "frame", [0.0, casing], [0.0, h], z).round(0.005).mirror(Mirror::X));
    m.add(Piece::new(Shape::Box, "frame", [casing * 0.9, w - casing * 0.9], [h - casing, h], z).round(0.005));
    let (x, y) = ([casing, w - casing], [0.004, h - casing]);
    let leaf = [0.0, body * 0.72];
    let glazed = p.filled == Some(false);
    let [columns, rows] = p.panes.unwrap_or([if w > 1.3 { 2 } else { 1 }, 2]).map(|n| n.clamp(1, 5));
    let double = w > 1.25;
    let rail = (0.13 * (x[1] - x[0])).min(0.11);
    if glazed {
        m.slot("glass", "#cfe0ea", Glass);
        frame(m, "leaf", x, y, leaf, rail);
        m.cube(
            "glass",
            [x[0] + rail * 0.8, x[1] - rail * 0.8],
            [y[0] + rail * 0.8, y[1] - rail * 0.8],
            [leaf[1] * 0.4, leaf[1] * 0.55],
        );
        if double {
            m.cube("leaf", [w / 2.0 - rail, w / 2.0 + rail], y, leaf);
        }
    } else {
        m.cube("leaf", x, y, leaf);
        let (px, py) = ([x[0] + rail, x[1] - rail], [y[0] + rail * 1.6, y[1] - rail]);
        let (gx, gy) = ((px[1] - px[0]) / f64::from(columns), (py[1] - py[0]) / f64::from(rows));
        for i in 0..columns {
            for j in 0..rows {
                let margin = rail * 0.35;
                let cx = [px[0] + gx * f64::from(i) + margin, px[0] + gx * f64::from(i + 1) - margin];
                let cy = [py[0] + gy * f64::from(j) + margin, py[0] + gy * f64::from(j + 1) - margin];
                let t = leaf[1];
                // a moulding around a slightly raised panel
                frame(m, "leaf", cx, cy, [t - 0.002, t + body * 0.12], (rail * 0.22).min((cx[1] - cx[0]) * 0.2));
            }
        }
    }
    if double {
        m.cube("frame", [w / 2.0 - 0.004, w / 2.0 + 0.004], y, [leaf[1] - 0.002, leaf[1] + 0.004]);
    }
    let at = if double { w / 2.0 + rail * 0.6 } else { x[1] - rail * 0.6 };
    let hy = (h * 0.48).min(1.02);
    let rose = (rail * 0.3).min(0.026);
    m.add(
        Piece::new(
            Shape::Cylinder,
            "handle",
            [at - rose, at + rose],
            [hy - rose, hy + rose],
            [leaf[1] - 0.002, leaf[1] + 0.01],
        )
        .axis(Axis::Z),
    );
    let lever =
        Piece::new(Shape::Tube, "handle", [at - rail * 1.1, at + 0.008], [hy - 0.008, hy + 0.008], [leaf[1], d]);
    m.add(lever.thick(0.015_f64.min(s * 0.4), s).path(&[[1.0, 0.5, 0.0], [1.0, 0.5, 1.0], [0.0, 0.5, 1.0]]));
}

pub(super) fn painting(m: &mut Maker, p: &TemplateParams) {
    m.slot("canvas", "#b9b2a2", Paper);
    m.slot("frame", "#4b3524", Wood);
    let (w, h, d) = (m.w, m.h, m.d);
    if p.legs == Some(super::LegStyle::None) {
        m.cube("canvas", [0.0, w], [0.0, h], [0.0, d]);
        return;
    }
    let width = (0.045 * w.min(h)).clamp(0.006, 0.05);
    frame(m, "frame", [0.0, w], [0.0, h], [0.0, d], width);
    let inner = width * 0.8;
    m.cube("canvas", [inner, w - inner], [inner, h - inner], [d * 0.1, d * 0.7]);
}

pub(super) fn mirror(m: &mut Maker, p: &TemplateParams) {
    m.plain_slot("glass", "#c9d3d6", Glass);
    m.slot("frame", "#6b5238", Wood);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let width = (0.04 * w.min(h)).clamp(0.006, 0.05);
    if p.round.unwrap_or(false) {
        m.add(
            Piece::new(
                Shape::Cylinder,
                "glass",
                [width * 0.5, w - width * 0.5],
                [width * 0.5, h - width * 0.5],
                [0.0, d * 0.6],
            )
            .axis(Axis::Z)
            .oval(),
        );
        let ring = Piece::new(Shape::Tube, "frame", [0.0, w], [0.0, h], [0.0, d]);
        m.add(ring.thick(width.min(d), s).smooth(true).closed().path(&circle(16)));
        return;
    }
    frame(m, "frame", [0.0, w], [0.0, h], [0.0, d], width);
    m.cube("glass", [width * 0.8, w - width * 0.8], [width * 0.8, h - width * 0.8], [0.0, d * 0.6]);
}

pub(super) fn clock(m: &mut Maker, p: &TemplateParams) {
    m.slot("face", "#f2efe8", Plastic);
    m.slot("frame", "#37332f", Metal);
    m.slot("hands", "#1d1c1b", Metal);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let (cx, cy) = (w / 2.0, h / 2.0);
    let r = w.min(h) / 2.0;
    if p.round == Some(false) {
        m.cube("frame", [0.0, w], [0.0, h], [0.0, d * 0.8]);
        m.cube("face", [w * 0.06, w * 0.94], [h * 0.06, h * 0.94], [d * 0.5, d * 0.86]);
    } else {
        m.add(
            Piece::new(Shape::Cylinder, "face", [w * 0.03, w * 0.97], [h * 0.03, h * 0.97], [0.0, d * 0.7])
                .axis(Axis::Z),
        );
        let rim = Piece::new(Shape::Tube, "frame", [cx - r, cx + r], [cy - r, cy + r], [0.0, d]);
        m.add(rim.thick((r * 0.12).min(d), s).smooth(true).closed().path(&circle(16)));
    }
    for k in 0..12 {
        let a = f64::from(k) * 30.0;
        let (sin, cos) = a.to_radians().sin_cos();
        let (x, y) = (cx + sin * r * 0.78, cy + cos * r * 0.78);
        let tick = Piece::new(
            Shape::Box,
            "hands",
            [x - r * 0.015, x + r * 0.015],
            [y - r * 0.05, y + r * 0.05],
            [d * 0.68, d * 0.76],
        );
        m.add(tick.turn(0.0, 0.0, -a));
    }
    for (angle, length, thick) in [(-55.0, 0.45, 0.035), (60.0, 0.68, 0.022)] {
        let (sin, cos) = f64::to_radians(angle).sin_cos();
        let (x, y) = (cx + sin * r * length * 0.45, cy + cos * r * length * 0.45);
        let hand = Piece::new(
            Shape::Box,
            "hands",
            [x - r * thick, x + r * thick],
            [y - r * length * 0.55, y + r * length * 0.55],
            [d * 0.72, d * 0.84],
        );
        m.add(hand.turn(0.0, 0.0, -angle));
    }
}

pub(super) fn rug(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#b5a48f", Fabric);
    let (w, h, d) = (m.w, m.h, m.d);
    if p.round.unwrap_or(false) {
        m.add(Piece::new(Shape::Cylinder, "body", [0.0, w], [0.0, h], [0.0, d]).oval().round(h * 0.3));
    } else {
        m.add(Piece::new(Shape::Slab, "body", [0.0, w], [0.0, h], [0.0, d]).corner(0.012).round(0.3));
    }
}

/// Curtains on a rod: a pair drawn aside, or one closed when `seats` is 1 or `filled` is true.
pub(super) fn curtain(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#c9bfae", Fabric);
    m.slot("rod", "#4a4038", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let rod = (0.028_f64).min(d * 0.3).min(h * 0.03);
    let cz = d / 2.0;
    let single = p.seats == Some(1) || w < 0.75;
    let closed = p.filled == Some(true);
    let lap = if single { 0.0 } else { 0.03 };
    let y = [0.0, h - rod * 0.6];
    let z = [0.0, d];
    let rod_y = [h - rod, h];
    m.add(Piece::new(Shape::Cylinder, "rod", [rod, w - rod], rod_y, [cz - rod / 2.0, cz + rod / 2.0]).axis(Axis::X));
    let knob = rod * 0.9;
    let ball = Piece::new(
        Shape::Sphere,
        "rod",
        [0.0, knob * 2.0],
        [h - rod / 2.0 - knob, h - rod / 2.0 + knob],
        [cz - knob, cz + knob],
    );
    m.add(ball.mirror(Mirror::X));
    let folds = |width: f64| ((width / 0.11).round() as u32).clamp(2, 20);
    if single {
        m.add(Piece::new(Shape::Cloth, "body", [rod * 2.0, w - rod * 2.0], y, z).folds(folds(w)).seed(3));
        return;
    }
    let each = if closed { w / 2.0 + lap - rod * 2.0 } else { (w * 0.24).max(0.22).min(w / 2.0 - rod * 2.0) };
    let left = [rod * 2.0, rod * 2.0 + each];
    let right = [w - rod * 2.0 - each, w - rod * 2.0];
    m.add(Piece::new(Shape::Cloth, "body", left, y, z).folds(folds(each)).seed(5));
    m.add(Piece::new(Shape::Cloth, "body", right, y, z).folds(folds(each)).seed(8));
}

/// A blind: head rail and slats.
pub(super) fn blind(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#e3ded4", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    let head = 0.05_f64.min(h * 0.1);
    m.cube("body", [0.0, w], [h - head, h], [0.0, d]);
    let n = ((h - head) / 0.045).round().clamp(4.0, 56.0);
    let step = (h - head) / n;
    let slat =
        Piece::new(Shape::Box, "body", [w * 0.005, w * 0.995], [step * 0.5, step * 0.5 + 0.002], [d * 0.15, d * 0.85]);
    m.row(slat.turn(35.0, 0.0, 0.0), Axis::Y, n as u32, step);
    m.cube("body", [0.0, w], [0.0, step * 0.4], [d * 0.25, d * 0.75]);
}

/// A towel over a rail.
pub(super) fn towel(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#d5cfc4", Fabric);
    m.slot("rail", "#9a9a98", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let r = (0.02_f64).min(d * 0.3);
    m.add(
        Piece::new(
            Shape::Cylinder,
            "rail",
            [0.0, w],
            [h - r * 1.3, h - r * 0.3],
            [d * 0.5 - r / 2.0, d * 0.5 + r / 2.0],
        )
        .axis(Axis::X),
    );
    let x = [w * 0.08, w * 0.92];
    m.add(Piece::new(Shape::Box, "body", x, [0.0, h - r * 0.4], [d * 0.5 + r * 0.4, d]).round(d * 0.12));
    m.add(Piece::new(Shape::Box, "body", x, [h * 0.18, h - r * 0.4], [0.0, d * 0.5 - r * 0.4]).round(d * 0.12));
    m.add(Piece::new(Shape::Box, "body", x, [h - r * 1.5, h], [0.0, d]).round(r * 0.7));
}

/// A fireplace: mantel, surround and a dark opening.
pub(super) fn fireplace(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#e2ddd4", Stone);
    m.slot("firebox", "#201d1b", Stone);
    m.slot("logs", "#5b3f2a", Wood);
    let (w, h, d) = (m.w, m.h, m.d);
    let side = w * 0.19;
    let mantel = h * 0.08;
    let lintel = h * 0.2;
    let front = d * 0.82;
    let hearth = (h * 0.05).min(0.06);
    m.cube("body", [0.0, w], [0.0, hearth], [0.0, d]);
    m.add(
        Piece::new(Shape::Box, "body", [w * 0.03, side], [hearth, h - mantel], [0.0, front])
            .round(0.006)
            .mirror(Mirror::X),
    );
    m.cube("body", [side * 0.95, w - side * 0.95], [h - mantel - lintel, h - mantel], [0.0, front * 0.97]);
    m.add(Piece::new(Shape::Box, "body", [0.0, w], [h - mantel, h], [0.0, d]).round(0.012));
    m.cube("firebox", [side, w - side], [hearth, h - mantel - lintel], [0.0, d * 0.1]);
    m.cube("firebox", [side * 0.98, side * 1.06], [hearth, h - mantel - lintel], [0.0, front * 0.9]);
    m.cube("firebox", [w - side * 1.06, w - side * 0.98], [hearth, h - mantel - lintel], [0.0, front * 0.9]);
    let r = h * 0.035;
    for (k, y) in [(0, hearth), (1, hearth), (2, hearth + r * 1.7)] {
        let z = d * 0.3 + f64::from(k % 2) * r * 2.2 + if k == 2 { r * 1.1 } else { 0.0 };
        let log = Piece::new(Shape::Cylinder, "logs", [w * 0.32, w * 0.68], [y, y + r * 2.0], [z, z + r * 2.0]);
        m.add(log.axis(Axis::X));
    }
}

/// A switch, socket, thermostat, vent: a small plate.
pub(super) fn wall_plate(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#efede8", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    m.add(Piece::new(Shape::Slab, "body", [0.0, w], [0.0, h], [0.0, d * 0.6]).corner(0.08));
    m.add(Piece::new(Shape::Slab, "body", [w * 0.28, w * 0.72], [h * 0.22, h * 0.78], [d * 0.4, d]).corner(0.08));
}

/// An air conditioner on the wall.
pub(super) fn air_conditioner(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#eeeeec", Plastic);
    m.slot("vent", "#9fa3a5", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    let profile = [[0.0, 0.0], [0.55, 0.0], [0.85, 0.16], [1.0, 0.42], [1.0, 0.82], [0.9, 1.0], [0.0, 1.0]];
    m.add(Piece::new(Shape::Extrude, "body", [0.0, w], [0.0, h], [0.0, d]).axis(Axis::X).points(&profile));
    let flap = Piece::new(Shape::Box, "vent", [w * 0.04, w * 0.96], [h * 0.06, h * 0.085], [d * 0.55, d * 0.92]);
    m.add(flap.turn(-28.0, 0.0, 0.0));
    m.cube("vent", [w * 0.05, w * 0.95], [h * 0.86, h * 0.87], [d * 0.9, d * 0.97]);
}
