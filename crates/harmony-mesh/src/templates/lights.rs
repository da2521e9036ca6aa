//! Lamps and fans.

use harmony_scene::MaterialCategory::{Fabric, Metal, Other, Wood};

use super::maker::{Maker, Piece, Span};
use super::{ShadeShape, TemplateParams};
use crate::{Axis, Mirror, Shape};

fn slots(m: &mut Maker) {
    m.slot("shade", "#efe6d2", Fabric);
    m.slot("body", "#3b3936", Metal);
    m.slot("bulb", "#fff3d6", Other);
}

/// A shade that fills a box, with a bulb in it.
fn shade(m: &mut Maker, shape: ShadeShape, x: Span, y: Span, z: Span) {
    let piece = |shape| Piece::new(shape, "shade", x, y, z);
    let (w, h) = ((x[1] - x[0]).min(z[1] - z[0]), y[1] - y[0]);
    let centre = [f64::midpoint(x[0], x[1]), f64::midpoint(y[0], y[1]), f64::midpoint(z[0], z[1])];
    match shape {
        ShadeShape::Drum => m.add(piece(Shape::Cylinder).hollow(0.02)),
        ShadeShape::Cone => m.add(piece(Shape::Cylinder).hollow(0.02).top(0.6)),
        ShadeShape::Globe => m.add(piece(Shape::Sphere)),
        ShadeShape::Dome => m.add(piece(Shape::Lathe).hollow(0.03).points(&[
            [1.0, 0.0],
            [0.95, 0.3],
            [0.78, 0.62],
            [0.5, 0.85],
            [0.12, 1.0],
        ])),
        ShadeShape::Square => m.add(piece(Shape::Cylinder).sides(4).hollow(0.04)),
        ShadeShape::Bulb => m.add(piece(Shape::Lathe).points(&[
            [0.35, 0.0],
            [0.36, 0.2],
            [0.7, 0.42],
            [1.0, 0.68],
            [0.75, 0.92],
            [0.0, 1.0],
        ])),
    }
    if matches!(shape, ShadeShape::Drum | ShadeShape::Cone | ShadeShape::Dome | ShadeShape::Square) {
        let r = (w * 0.13).min(h * 0.3);
        let [cx, cy, cz] = centre;
        m.add(Piece::new(Shape::Sphere, "bulb", [cx - r, cx + r], [cy - r, cy + r], [cz - r, cz + r]));
    }
}

pub(super) fn floor_lamp(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    let (w, h, d) = (m.w, m.h, m.d);
    let (cx, cz) = (w / 2.0, d / 2.0);
    let tall = (h * 0.2).min(w * 0.85);
    let r = (w * 0.03).clamp(0.006, 0.014);
    let foot = (w * 0.34).min(0.17);
    m.add(
        Piece::new(Shape::Cylinder, "body", [cx - foot, cx + foot], [0.0, 0.022], [cz - foot, cz + foot]).round(0.006),
    );
    m.add(Piece::new(Shape::Cylinder, "body", [cx - r, cx + r], [0.01, h - tall * 0.4], [cz - r, cz + r]));
    shade(m, p.shade.unwrap_or(ShadeShape::Drum), [0.0, w], [h - tall, h], [0.0, d]);
}

pub(super) fn arc_lamp(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let cz = d / 2.0;
    let foot = (d * 0.45).min(0.17).min(w * 0.2);
    m.add(Piece::new(Shape::Cylinder, "body", [0.0, foot * 2.0], [0.0, 0.05], [cz - foot, cz + foot]).round(0.008));
    let dish = (w * 0.2).min(0.2).min(d * 0.5);
    let bar = Piece::new(Shape::Tube, "body", [foot * 0.9, w - dish * 0.9], [0.04, h], [cz - 0.01, cz + 0.01]);
    m.add(bar.thick(0.022, s).smooth(true).path(&[
        [0.0, 0.0, 0.5],
        [0.0, 0.55, 0.5],
        [0.12, 0.86, 0.5],
        [0.45, 1.0, 0.5],
        [0.8, 0.93, 0.5],
        [1.0, 0.78, 0.5],
    ]));
    let y = h * 0.78;
    shade(m, p.shade.unwrap_or(ShadeShape::Dome), [w - dish * 2.0, w], [y - dish * 1.1, y], [cz - dish, cz + dish]);
}

pub(super) fn tripod_lamp(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    m.slot("legs", "#9a6f45", Wood);
    let (w, h, d) = (m.w, m.h, m.d);
    let (cx, cz) = (w / 2.0, d / 2.0);
    let tall = (h * 0.22).min(w * 0.7);
    let joint = h - tall * 1.05;
    let reach = 0.44 * w.min(d);
    let (lean, length) = ((reach / joint).atan(), (reach.powi(2) + joint.powi(2)).sqrt());
    let r = 0.016_f64.min(w * 0.05);
    for k in 0..3 {
        let azimuth = 120.0 * f64::from(k);
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let (mx, mz) = (cx + sin * reach / 2.0, cz + cos * reach / 2.0);
        let y = [joint / 2.0 - length / 2.0 + r * 0.4, joint / 2.0 + length / 2.0];
        let leg = Piece::new(Shape::Cylinder, "legs", [mx - r, mx + r], y, [mz - r, mz + r]);
        m.add(leg.top(1.35).turn(-lean.to_degrees(), azimuth, 0.0));
    }
    let hub = r * 2.2;
    m.add(Piece::new(
        Shape::Cylinder,
        "body",
        [cx - hub, cx + hub],
        [joint - 0.05, joint + 0.02],
        [cz - hub, cz + hub],
    ));
    m.add(Piece::new(
        Shape::Cylinder,
        "body",
        [cx - r / 2.0, cx + r / 2.0],
        [joint, h - tall * 0.4],
        [cz - r / 2.0, cz + r / 2.0],
    ));
    let half = (w.min(d) * 0.5).min(tall * 0.75);
    shade(m, p.shade.unwrap_or(ShadeShape::Drum), [cx - half, cx + half], [h - tall, h], [cz - half, cz + half]);
}

pub(super) fn table_lamp(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    m.slot("base", "#b7a58d", super::MaterialCategory::Ceramic);
    let (w, h, d) = (m.w, m.h, m.d);
    let (cx, cz) = (w / 2.0, d / 2.0);
    let shape = p.shade.unwrap_or(ShadeShape::Cone);
    let split = h * if shape == ShadeShape::Globe { 0.4 } else { 0.56 };
    let r = w.min(d) * 0.3;
    let base = Piece::new(Shape::Lathe, "base", [cx - r, cx + r], [0.0, split * 0.92], [cz - r, cz + r]);
    m.add(base.points(&[
        [0.7, 0.0],
        [0.72, 0.04],
        [0.55, 0.08],
        [0.85, 0.25],
        [1.0, 0.45],
        [0.8, 0.7],
        [0.3, 0.88],
        [0.2, 1.0],
    ]));
    let n = r * 0.12;
    m.add(Piece::new(Shape::Cylinder, "body", [cx - n, cx + n], [split * 0.85, h * 0.8], [cz - n, cz + n]));
    shade(m, shape, [0.0, w], [split, h], [0.0, d]);
}

pub(super) fn desk_lamp(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let cx = w / 2.0;
    let foot = (w * 0.45).min(d * 0.3);
    let z = [d * 0.02, d * 0.02 + foot * 2.0];
    m.add(Piece::new(Shape::Cylinder, "body", [cx - foot, cx + foot], [0.0, 0.02], z).round(0.006));
    let head = (w * 0.42).min(d * 0.28).min(h * 0.25);
    let arm = Piece::new(Shape::Tube, "body", [cx - 0.006, cx + 0.006], [0.01, h * 0.97], [z[0], d - head]);
    let zc = (foot / (d - head - z[0])).min(0.6);
    m.add(arm.thick(0.012, s).path(&[[0.5, 0.0, zc], [0.5, 0.62, 0.0], [0.5, 1.0, 0.7], [0.5, 0.93, 1.0]]));
    let shape = p.shade.unwrap_or(ShadeShape::Dome);
    let y = [h * 0.94 - head * 1.2, h * 0.97];
    shade(m, shape, [cx - head, cx + head], y, [d - head * 2.0, d]);
}

pub(super) fn pendant(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    let (w, h, d) = (m.w, m.h, m.d);
    let (cx, cz) = (w / 2.0, d / 2.0);
    let shape = p.shade.unwrap_or(ShadeShape::Dome);
    let tall = match shape {
        ShadeShape::Globe => w.min(d),
        ShadeShape::Dome | ShadeShape::Cone => w.min(d) * 0.62,
        _ => w.min(d) * 0.7,
    }
    .min(h * 0.8);
    let r = (w * 0.02).clamp(0.003, 0.006);
    m.add(Piece::new(Shape::Cylinder, "body", [cx - r, cx + r], [tall * 0.95, h], [cz - r, cz + r]));
    let rose = (w * 0.2).min(0.06);
    let cap = Piece::new(Shape::Cylinder, "body", [cx - rose, cx + rose], [h - 0.025, h], [cz - rose, cz + rose]);
    m.add(cap.round(0.005));
    let neck = w * 0.09;
    m.add(Piece::new(
        Shape::Cylinder,
        "body",
        [cx - neck, cx + neck],
        [tall * 0.95, tall * 1.08],
        [cz - neck, cz + neck],
    ));
    shade(m, shape, [0.0, w], [0.0, tall], [0.0, d]);
}

pub(super) fn chandelier(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let (cx, cz) = (w / 2.0, d / 2.0);
    let arms = p.cushions.unwrap_or(6).clamp(3, 9);
    let hang = h * 0.45;
    let r = 0.01;
    m.add(Piece::new(Shape::Cylinder, "body", [cx - r, cx + r], [hang * 0.5, h], [cz - r, cz + r]));
    let rose = 0.06_f64.min(w * 0.15);
    m.add(
        Piece::new(Shape::Cylinder, "body", [cx - rose, cx + rose], [h - 0.03, h], [cz - rose, cz + rose]).round(0.008),
    );
    let hub = w * 0.08;
    let ball = Piece::new(Shape::Lathe, "body", [cx - hub, cx + hub], [0.0, hang * 0.7], [cz - hub, cz + hub]);
    m.add(ball.points(&[[0.0, 0.0], [0.5, 0.08], [1.0, 0.3], [0.5, 0.55], [0.35, 0.8], [0.15, 1.0]]));
    let reach = 0.42 * w.min(d);
    let small = (w * 0.075).min(0.07);
    for k in 0..arms {
        let azimuth = 360.0 * f64::from(k) / f64::from(arms);
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let (mx, mz) = (cx + sin * reach / 2.0, cz + cos * reach / 2.0);
        let arm = Piece::new(
            Shape::Tube,
            "body",
            [mx - 0.008, mx + 0.008],
            [hang * 0.08, hang * 0.45],
            [mz - reach / 2.0, mz + reach / 2.0],
        );
        m.add(arm.thick(0.013, s).smooth(true).turn(0.0, azimuth, 0.0).path(&[
            [0.5, 0.4, 0.0],
            [0.5, 0.0, 0.45],
            [0.5, 0.25, 0.9],
            [0.5, 1.0, 1.0],
        ]));
        let (ex, ez) = (cx + sin * reach, cz + cos * reach);
        let y = hang * 0.45;
        let shape = p.shade.unwrap_or(ShadeShape::Bulb);
        let tall = small * 2.2;
        shade(m, shape, [ex - small, ex + small], [y, (y + tall).min(h)], [ez - small, ez + small]);
    }
}

pub(super) fn ceiling_light(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    let (w, h, d) = (m.w, m.h, m.d);
    let plate = h * 0.25;
    let square = p.shade == Some(ShadeShape::Square) || p.round == Some(false);
    if square {
        m.cube("body", [w * 0.04, w * 0.96], [h - plate, h], [d * 0.04, d * 0.96]);
        m.add(Piece::new(Shape::Box, "shade", [0.0, w], [0.0, h - plate * 0.8], [0.0, d]).round(h * 0.2));
        return;
    }
    m.add(Piece::new(Shape::Cylinder, "body", [w * 0.06, w * 0.94], [h - plate, h], [d * 0.06, d * 0.94]).oval());
    m.add(Piece::new(Shape::Lathe, "shade", [0.0, w], [0.0, h - plate * 0.8], [0.0, d]).oval().points(&[
        [0.0, 0.0],
        [0.5, 0.06],
        [0.85, 0.3],
        [1.0, 0.75],
        [0.98, 1.0],
    ]));
}

pub(super) fn ceiling_fan(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    m.slot("blades", "#7a5a3e", Wood);
    let (w, h, d) = (m.w, m.h, m.d);
    let (cx, cz) = (w / 2.0, d / 2.0);
    let radius = w.min(d) / 2.0;
    let hub = radius * 0.17;
    let rod = 0.014;
    m.add(Piece::new(Shape::Cylinder, "body", [cx - rod, cx + rod], [h * 0.4, h], [cz - rod, cz + rod]));
    let cap = hub * 0.6;
    m.add(Piece::new(Shape::Cylinder, "body", [cx - cap, cx + cap], [h * 0.9, h], [cz - cap, cz + cap]).top(1.3));
    let motor = [h * 0.3, h * 0.58];
    m.add(Piece::new(Shape::Cylinder, "body", [cx - hub, cx + hub], motor, [cz - hub, cz + hub]).round(hub * 0.3));
    m.add(
        Piece::new(
            Shape::Lathe,
            "shade",
            [cx - hub * 0.85, cx + hub * 0.85],
            [0.0, h * 0.32],
            [cz - hub * 0.85, cz + hub * 0.85],
        )
        .points(&[[0.0, 0.0], [0.6, 0.1], [1.0, 0.55], [0.9, 1.0]]),
    );
    let blades = p.cushions.unwrap_or(5).clamp(2, 10);
    let y = f64::midpoint(motor[0], motor[1]);
    for k in 0..blades {
        let azimuth = 360.0 * f64::from(k) / f64::from(blades);
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let length = radius - hub * 1.15;
        let mid = hub * 1.15 + length / 2.0;
        let (mx, mz) = (cx + sin * mid, cz + cos * mid);
        let half = radius * 0.105;
        let blade = Piece::new(
            Shape::Slab,
            "blades",
            [mx - half, mx + half],
            [y - 0.005, y + 0.005],
            [mz - length / 2.0, mz + length / 2.0],
        );
        m.add(blade.corner(0.35).turn(0.0, azimuth, 6.0));
        let arm = (hub * 1.1, hub * 0.12);
        let (ax, az) = (cx + sin * arm.0, cz + cos * arm.0);
        let holder = Piece::new(
            Shape::Box,
            "body",
            [ax - arm.1, ax + arm.1],
            [y - 0.012, y - 0.002],
            [az - hub * 0.5, az + hub * 0.5],
        );
        m.add(holder.turn(0.0, azimuth, 0.0));
    }
}

pub(super) fn wall_sconce(m: &mut Maker, p: &TemplateParams) {
    slots(m);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let cx = w / 2.0;
    let plate = (w * 0.3).min(h * 0.2);
    let y = h * 0.4;
    m.add(
        Piece::new(Shape::Cylinder, "body", [cx - plate, cx + plate], [y - plate, y + plate], [0.0, 0.02])
            .axis(Axis::Z)
            .round(0.004),
    );
    let r = w.min(d * 0.8) / 2.0;
    let zc = d - r;
    let arm = Piece::new(Shape::Tube, "body", [cx - 0.006, cx + 0.006], [h * 0.2, y + 0.01], [0.01, zc + 0.006]);
    m.add(arm.thick(0.014, s).path(&[[0.5, 1.0, 0.0], [0.5, 0.0, 0.35], [0.5, 0.0, 1.0], [0.5, 0.9, 1.0]]));
    shade(m, p.shade.unwrap_or(ShadeShape::Cone), [cx - r, cx + r], [h * 0.4, h], [d - 2.0 * r, d]);
}

/// A standing or table fan.
pub(super) fn fan(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#e4e4e2", super::MaterialCategory::Plastic);
    m.slot("blades", "#9fb0b8", super::MaterialCategory::Plastic);
    m.slot("cage", "#c9c9c7", Metal);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let cx = w / 2.0;
    let r = (w * 0.5).min(h * 0.42);
    let y = h - r;
    let deep = (d * 0.45).min(r * 0.7);
    let z = [d - deep, d];
    let foot = (w * 0.36).min(d * 0.48);
    m.add(
        Piece::new(Shape::Cylinder, "body", [cx - foot, cx + foot], [0.0, 0.03], [d / 2.0 - foot, d / 2.0 + foot])
            .round(0.01),
    );
    let pole = 0.016;
    m.add(Piece::new(Shape::Cylinder, "body", [cx - pole, cx + pole], [0.0, y], [d / 2.0 - pole, d / 2.0 + pole]));
    let hub = r * 0.24;
    m.add(
        Piece::new(
            Shape::Cylinder,
            "body",
            [cx - hub, cx + hub],
            [y - hub, y + hub],
            [(d / 2.0 - pole).min(z[0] - hub), z[1] - deep * 0.2],
        )
        .axis(Axis::Z)
        .round(hub * 0.3),
    );
    for k in 0..3 {
        let a = 120.0 * f64::from(k) + 20.0;
        let (sin, cos) = a.to_radians().sin_cos();
        let (bx, by) = (cx + cos * r * 0.5, y + sin * r * 0.5);
        let zc = f64::midpoint(z[0], z[1]);
        let blade = Piece::new(
            Shape::Slab,
            "blades",
            [bx - r * 0.36, bx + r * 0.36],
            [by - r * 0.22, by + r * 0.22],
            [zc - 0.004, zc + 0.004],
        );
        m.add(blade.corner(0.45).turn(14.0, 0.0, a));
    }
    for (k, share) in [(0, 1.0), (1, 0.97), (2, 0.72), (3, 0.46)] {
        let q = r * share;
        let zz = if k == 0 { z[0] } else { z[1] - 0.012 - if k == 1 { deep * 0.25 } else { 0.0 } };
        let ring = Piece::new(Shape::Tube, "cage", [cx - q, cx + q], [y - q, y + q], [zz, zz + 0.01]);
        m.add(ring.thick(0.007, s).smooth(true).closed().path(&circle(12)));
    }
    for k in 0..8 {
        let a = 180.0 * f64::from(k) / 8.0;
        let spoke =
            Piece::new(Shape::Box, "cage", [cx - r, cx + r], [y - 0.002, y + 0.002], [z[1] - 0.014, z[1] - 0.01]);
        m.add(spoke.turn(0.0, 0.0, a));
    }
}

/// A circle in the xy plane as a path.
pub(super) fn circle(n: u32) -> Vec<[f64; 3]> {
    (0..n)
        .map(|k| {
            let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / f64::from(n)).sin_cos();
            [0.5 + 0.5 * cos, 0.5 + 0.5 * sin, 0.5]
        })
        .collect()
}

/// A candle, or a candlestick when it is slender.
pub(super) fn candle(m: &mut Maker, _p: &TemplateParams) {
    m.slot("wax", "#efe7d3", Other);
    m.slot("wick", "#2b2622", Other);
    m.slot("holder", "#a58a55", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let (cx, cz) = (w / 2.0, d / 2.0);
    let slender = h > w * 3.0;
    let base = if slender { h * 0.4 } else { 0.0 };
    if slender {
        m.add(Piece::new(Shape::Lathe, "holder", [0.0, w], [0.0, base], [0.0, d]).points(&[
            [1.0, 0.0],
            [0.95, 0.06],
            [0.3, 0.2],
            [0.2, 0.6],
            [0.45, 0.85],
            [0.5, 1.0],
        ]));
    }
    let r = if slender { w.min(d) * 0.2 } else { w.min(d) * 0.5 };
    let top = h * 0.95;
    m.add(Piece::new(Shape::Cylinder, "wax", [cx - r, cx + r], [base * 0.95, top], [cz - r, cz + r]).round(r * 0.1));
    let wick = r * 0.08;
    m.add(Piece::new(Shape::Cylinder, "wick", [cx - wick, cx + wick], [top - 0.001, h], [cz - wick, cz + wick]));
}

/// A radiator: ribs between two headers.
pub(super) fn radiator(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#e8e6e1", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let n = (w / 0.07).round().clamp(3.0, 24.0);
    let step = w / n;
    let rib = Piece::new(Shape::Box, "body", [step * 0.12, step * 0.88], [h * 0.06, h], [d * 0.2, d]);
    m.row(rib.round(0.012_f64.min(step * 0.3)), Axis::X, n as u32, step);
    for y in [h * 0.1, h * 0.86] {
        m.add(
            Piece::new(
                Shape::Cylinder,
                "body",
                [0.01, w - 0.01],
                [y, y + 0.045_f64.min(h * 0.1)],
                [d * 0.35, d * 0.85],
            )
            .axis(Axis::X),
        );
    }
    m.add(Piece::new(Shape::Box, "body", [w * 0.1, w * 0.1 + 0.03], [0.0, h * 0.8], [0.0, d * 0.6]).mirror(Mirror::X));
}
