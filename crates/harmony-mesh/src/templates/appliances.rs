//! Kitchen and bath, electronics.

use harmony_scene::MaterialCategory::{Ceramic, Glass, Metal, Plastic, Wood};

use super::TemplateParams;
use super::lights::circle;
use super::maker::{Maker, Piece, Span};
use super::storage::{self, Cell};
use crate::{Axis, Mirror, Shape};

fn bar(m: &mut Maker, slot: &str, x: Span, y: Span, z0: f64, d: f64) {
    let s = m.smallest;
    let upright = (y[1] - y[0]) > (x[1] - x[0]);
    let path = if upright {
        [[0.5, 0.0, 0.0], [0.5, 0.0, 1.0], [0.5, 1.0, 1.0], [0.5, 1.0, 0.0]]
    } else {
        [[0.0, 0.5, 0.0], [0.0, 0.5, 1.0], [1.0, 0.5, 1.0], [1.0, 0.5, 0.0]]
    };
    let thick = (x[1] - x[0]).min(y[1] - y[0]);
    m.add(Piece::new(Shape::Tube, slot, x, y, [z0, d]).thick(thick, s).path(&path));
}

/// Refrigerator: freezer below (default), or `doors` 2 side by side when it is wide.
pub(super) fn fridge(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#c9cccf", Metal);
    m.slot("handles", "#8f9397", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let front = d * 0.955;
    let leaf = d * 0.08;
    m.cube("body", [0.0, w], [0.015, h], [0.0, front - leaf - 0.006]);
    m.cube("handles", [0.02, w - 0.02], [0.0, 0.03], [0.05, front - leaf - 0.02]);
    let wide = p.doors.unwrap_or(if w > 0.8 { 2 } else { 1 }) >= 2 && w > 0.6;
    let split = h * 0.36;
    let z = [front - leaf, front];
    let gap = 0.004;
    let upper = [split + gap, h - gap];
    let lower = [0.035, split - gap];
    let thick = 0.018_f64.min(w * 0.04);
    if wide {
        for (x, at) in [([gap, w / 2.0 - gap], w / 2.0 - 0.05), ([w / 2.0 + gap, w - gap], w / 2.0 + 0.05)] {
            m.add(Piece::new(Shape::Box, "body", x, upper, z).round(0.01));
            bar(m, "handles", [at - thick / 2.0, at + thick / 2.0], [split + 0.1, h * 0.8], front - 0.002, d);
        }
    } else {
        m.add(Piece::new(Shape::Box, "body", [gap, w - gap], upper, z).round(0.01));
        bar(m, "handles", [w * 0.88 - thick / 2.0, w * 0.88 + thick / 2.0], [split + 0.05, h * 0.72], front - 0.002, d);
    }
    m.add(Piece::new(Shape::Box, "body", [gap, w - gap], lower, z).round(0.01));
    if wide {
        bar(m, "handles", [w * 0.2, w * 0.8], [split - 0.09, split - 0.09 + thick], front - 0.002, d);
    } else {
        bar(
            m,
            "handles",
            [w * 0.88 - thick / 2.0, w * 0.88 + thick / 2.0],
            [split * 0.55, split - 0.05],
            front - 0.002,
            d,
        );
    }
}

/// Cooker with hob.
pub(super) fn oven(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#c4c6c8", Metal);
    m.slot("glass", "#1c1d1f", Glass);
    m.slot("knobs", "#4a4b4d", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    let front = d * 0.93;
    let hob = p.extra != Some(false) && h > 0.7;
    let top = if hob { h - 0.012 } else { h };
    m.cube("body", [0.0, w], [0.0, top], [0.0, front - 0.03]);
    let panel = h * 0.13;
    m.add(Piece::new(Shape::Box, "body", [0.0, w], [top - panel, top], [front - 0.04, front]).round(0.006));
    let r = (panel * 0.24).min(w * 0.05);
    let y = top - panel / 2.0;
    let x0 = w * 0.12;
    let knob = Piece::new(Shape::Cylinder, "knobs", [x0 - r, x0 + r], [y - r, y + r], [front - 0.002, front + r * 1.2]);
    m.row(knob.axis(Axis::Z).top(0.85), Axis::X, 5, w * 0.19);
    let door = [h * 0.16, top - panel - 0.006];
    m.add(Piece::new(Shape::Box, "body", [0.006, w - 0.006], door, [front - 0.04, front]).round(0.006));
    let tall = door[1] - door[0];
    m.add(
        Piece::new(
            Shape::Slab,
            "glass",
            [w * 0.12, w * 0.88],
            [door[0] + tall * 0.14, door[0] + tall * 0.74],
            [front - 0.01, front + 0.003],
        )
        .corner(0.06),
    );
    let bar_y = door[0] + tall * 0.87;
    bar(m, "knobs", [w * 0.1, w * 0.9], [bar_y - 0.01, bar_y + 0.01], front - 0.002, d);
    m.add(Piece::new(Shape::Box, "body", [0.006, w - 0.006], [0.03, h * 0.155], [front - 0.04, front]).round(0.006));
    if hob {
        m.add(Piece::new(Shape::Box, "glass", [0.01, w - 0.01], [top - 0.001, top + 0.006], [0.02, front - 0.02]));
        for (fx, fz, fr) in [(0.28, 0.3, 0.13), (0.72, 0.3, 0.17), (0.28, 0.7, 0.17), (0.72, 0.7, 0.13)] {
            let r = fr * w.min(d) * 0.85;
            let (cx, cz) = (w * fx, front * fz);
            m.add(
                Piece::new(Shape::Cylinder, "knobs", [cx - r, cx + r], [top + 0.004, h], [cz - r, cz + r]).hollow(0.12),
            );
        }
    }
}

pub(super) fn microwave(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#b9bbbd", Metal);
    m.slot("glass", "#1c1d1f", Glass);
    m.slot("handle", "#55575a", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let front = d * 0.94;
    m.cube("body", [0.0, w], [0.0, h], [0.0, front]);
    m.add(
        Piece::new(Shape::Slab, "glass", [w * 0.04, w * 0.72], [h * 0.12, h * 0.88], [front - 0.004, front + 0.004])
            .corner(0.05),
    );
    m.cube("glass", [w * 0.79, w * 0.96], [h * 0.66, h * 0.86], [front - 0.004, front + 0.003]);
    bar(m, "handle", [w * 0.745, w * 0.765], [h * 0.15, h * 0.85], front - 0.002, d);
    for j in 0..3 {
        let y = h * (0.18 + 0.15 * f64::from(j));
        let key =
            Piece::new(Shape::Box, "handle", [w * 0.8, w * 0.84], [y, y + h * 0.08], [front - 0.002, front + 0.004]);
        m.row(key, Axis::X, 3, w * 0.055);
    }
}

/// Washing machine or dryer.
pub(super) fn washing_machine(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#ecebe8", Metal);
    m.slot("door", "#8d9195", Metal);
    m.slot("glass", "#2a3036", Glass);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let front = d * 0.95;
    m.add(Piece::new(Shape::Box, "body", [0.0, w], [0.015, h], [0.0, front]).round(0.012));
    m.cube("door", [0.03, w - 0.03], [0.0, 0.02], [0.03, front - 0.03]);
    let (cx, cy, r) = (w / 2.0, h * 0.46, w.min(h) * 0.29);
    m.add(
        Piece::new(
            Shape::Lathe,
            "glass",
            [cx - r * 0.84, cx + r * 0.84],
            [cy - r * 0.84, cy + r * 0.84],
            [front - 0.01, d],
        )
        .axis(Axis::Z)
        .points(&[[1.0, 0.0], [0.96, 0.5], [0.7, 0.85], [0.0, 1.0]]),
    );
    let ring = Piece::new(Shape::Tube, "door", [cx - r, cx + r], [cy - r, cy + r], [front - 0.012, front + r * 0.14]);
    m.add(ring.thick(r * 0.22, s).smooth(true).closed().path(&circle(16)));
    let y = h * 0.89;
    m.cube("door", [w * 0.02, w * 0.98], [h * 0.82, h * 0.825], [front - 0.002, front + 0.002]);
    m.cube("body", [w * 0.05, w * 0.3], [y - h * 0.035, y + h * 0.035], [front - 0.002, front + 0.006]);
    let k = h * 0.035;
    m.add(
        Piece::new(Shape::Cylinder, "door", [w * 0.52 - k, w * 0.52 + k], [y - k, y + k], [front - 0.002, d * 0.985])
            .axis(Axis::Z),
    );
    m.cube("glass", [w * 0.65, w * 0.92], [y - h * 0.025, y + h * 0.025], [front - 0.002, front + 0.003]);
}

pub(super) fn dishwasher(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#c9cccf", Metal);
    m.slot("handle", "#7d8185", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let front = d * 0.95;
    m.cube("body", [0.0, w], [h * 0.1, h], [0.0, front - 0.03]);
    m.cube("handle", [0.01, w - 0.01], [0.0, h * 0.1], [0.0, front - 0.07]);
    m.add(Piece::new(Shape::Box, "body", [0.003, w - 0.003], [h * 0.11, h * 0.86], [front - 0.03, front]).round(0.006));
    m.add(Piece::new(Shape::Box, "body", [0.003, w - 0.003], [h * 0.87, h], [front - 0.03, front]).round(0.006));
    bar(m, "handle", [w * 0.12, w * 0.88], [h * 0.79, h * 0.81], front - 0.002, d);
}

/// A hood over a cooker.
pub(super) fn range_hood(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#c4c6c8", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    m.cube("body", [0.0, w], [0.0, h * 0.09], [0.0, d]);
    m.add(Piece::new(Shape::Cylinder, "body", [0.0, w], [h * 0.088, h * 0.4], [0.0, d]).sides(4).oval().top(0.42));
    m.cube("body", [w * 0.32, w * 0.68], [h * 0.38, h], [d * 0.3, d * 0.7]);
}

pub(super) fn toilet(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#f1f0ec", Ceramic);
    m.slot("seat", "#f6f5f2", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    let seat = h * 0.54;
    let tank = d * 0.28;
    m.add(Piece::new(Shape::Box, "body", [w * 0.04, w * 0.96], [seat * 0.95, h * 0.95], [0.0, tank]).round(0.03));
    m.add(Piece::new(Shape::Box, "body", [0.0, w], [h * 0.94, h], [0.0, tank + 0.012]).round(0.012));
    let bowl = Piece::new(Shape::Lathe, "body", [w * 0.06, w * 0.94], [0.0, seat * 0.94], [d * 0.22, d * 0.99]);
    m.add(bowl.oval().points(&[[0.55, 0.0], [0.5, 0.1], [0.46, 0.35], [0.68, 0.65], [0.97, 0.9], [1.0, 1.0]]));
    m.add(Piece::new(Shape::Box, "body", [w * 0.26, w * 0.74], [0.0, seat * 0.9], [d * 0.04, d * 0.5]).round(0.04));
    let ring = Piece::new(Shape::Slab, "seat", [w * 0.05, w * 0.95], [seat * 0.93, seat], [d * 0.27, d]);
    m.add(ring.corner(0.48).round(0.4));
    let lid = Piece::new(Shape::Slab, "seat", [w * 0.07, w * 0.93], [seat * 0.995, seat * 1.04], [d * 0.28, d * 0.985]);
    m.add(lid.corner(0.48).round(0.4));
    m.add(Piece::new(Shape::Cylinder, "seat", [w * 0.45, w * 0.55], [h * 0.99, h], [tank * 0.4, tank * 0.7]));
}

pub(super) fn bathtub(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#f1f0ec", Ceramic);
    m.slot("tap", "#b9bcbf", Metal);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let tap = h * 0.2;
    let rim = h - tap * 0.6;
    if p.round == Some(false) {
        let wall = 0.07_f64.min(d * 0.12).min(w * 0.12);
        m.add(Piece::new(Shape::Box, "body", [0.0, w], [0.0, rim], [0.0, wall]).round(0.02).mirror(Mirror::Z));
        m.add(Piece::new(Shape::Box, "body", [0.0, wall], [0.0, rim], [0.0, d]).round(0.02).mirror(Mirror::X));
        m.cube("body", [wall * 0.5, w - wall * 0.5], [rim * 0.1, rim * 0.22], [wall * 0.5, d - wall * 0.5]);
    } else {
        let tub = Piece::new(Shape::Lathe, "body", [0.0, w], [0.0, rim], [0.0, d]).oval().hollow(0.1);
        m.add(tub.points(&[[0.72, 0.0], [0.76, 0.06], [0.84, 0.4], [0.93, 0.85], [1.0, 0.96], [0.99, 1.0]]));
    }
    let pipe = Piece::new(Shape::Tube, "tap", [w * 0.48, w * 0.52], [rim * 0.9, h], [0.0, d * 0.22]);
    m.add(pipe.thick(0.025_f64.min(s * 0.1), s).smooth(true).path(&[
        [0.5, 0.0, 0.05],
        [0.5, 0.8, 0.0],
        [0.5, 1.0, 0.5],
        [0.5, 0.7, 1.0],
    ]));
}

/// Wash basin on a cabinet, or on a pedestal when it has no doors or drawers and is small.
pub(super) fn sink(m: &mut Maker, p: &TemplateParams) {
    m.slot("basin", "#f2f1ee", Ceramic);
    m.slot("body", "#b79c7a", Wood);
    m.slot("fronts", "#b79c7a", Wood);
    m.slot("handles", "#4a4845", Metal);
    m.slot("tap", "#b9bcbf", Metal);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let tap = (h * 0.18).min(0.16);
    let rim = h - tap;
    let r = (w * 0.38).min(d * 0.4);
    let (cx, cz) = (w / 2.0, d * 0.54);
    if w < 0.6 && p.doors.is_none() && p.drawers.is_none() {
        let bowl =
            Piece::new(Shape::Lathe, "basin", [0.0, w], [rim - 0.18_f64.min(rim * 0.3), rim], [d * 0.08, d]).oval();
        m.add(bowl.hollow(0.08).points(&[[0.3, 0.0], [0.7, 0.2], [0.95, 0.7], [1.0, 1.0]]));
        m.add(Piece::new(Shape::Box, "basin", [w * 0.2, w * 0.8], [rim - 0.06, rim], [0.0, d * 0.3]).round(0.02));
        let leg = w * 0.17;
        m.add(
            Piece::new(Shape::Cylinder, "basin", [cx - leg, cx + leg], [0.0, rim - 0.12], [cz - leg, cz + leg])
                .top(0.85),
        );
    } else {
        let slab = 0.035;
        let front = d - 0.02;
        let (x, y) = storage::carcass(m, "body", [0.01, w - 0.01], [0.08 * h, rim - slab], [0.0, front - 0.004], 0.018);
        m.cube("body", [0.03, w - 0.03], [0.0, 0.08 * h + 0.002], [0.0, front - 0.05]);
        m.add(Piece::new(Shape::Box, "basin", [0.0, w], [rim - slab - 0.001, rim], [0.0, d]).round(0.006));
        let doors = p.doors.unwrap_or(if w > 0.55 { 2 } else { 1 }).clamp(1, 6);
        let step = (x[1] - x[0]) / f64::from(doors);
        for k in 0..doors {
            let cell = [x[0] + step * f64::from(k), x[0] + step * f64::from(k + 1)];
            let kind = if k % 2 == 0 && doors > 1 { Cell::DoorLeft } else { Cell::DoorRight };
            storage::cell(m, kind, cell, y, [0.018, front], 0);
        }
        let tall = (tap * 0.7).min(0.11);
        let bowl = Piece::new(Shape::Lathe, "basin", [cx - r, cx + r], [rim - 0.002, rim + tall], [cz - r, cz + r]);
        m.add(bowl.hollow(0.06).points(&[[0.5, 0.0], [0.8, 0.25], [0.96, 0.7], [1.0, 1.0]]));
    }
    let pipe = Piece::new(Shape::Tube, "tap", [cx - 0.012, cx + 0.012], [rim - 0.01, h], [0.02, cz]);
    m.add(pipe.thick(0.022_f64.min(s * 0.08), s).smooth(true).path(&[
        [0.5, 0.0, 0.1],
        [0.5, 0.75, 0.05],
        [0.5, 1.0, 0.45],
        [0.5, 0.75, 1.0],
    ]));
}

/// Television or monitor; `extra` false hangs it on the wall.
pub(super) fn tv(m: &mut Maker, p: &TemplateParams) {
    m.slot("screen", "#121316", Glass);
    m.slot("frame", "#1b1b1d", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    let stands = p.extra.unwrap_or(d > 0.1);
    let foot = if stands { (h * 0.1).min(0.09) } else { 0.0 };
    let thick = if stands { 0.035_f64.min(d * 0.4) } else { d };
    let cz = d / 2.0;
    let z = if stands { [cz - thick / 2.0, cz + thick / 2.0] } else { [0.0, d] };
    let bezel = (0.012 * w).clamp(0.004, 0.02);
    m.add(Piece::new(Shape::Box, "frame", [0.0, w], [foot, h], [z[0], z[1] - 0.001]).round(thick * 0.15));
    m.cube("screen", [bezel, w - bezel], [foot + bezel * 1.4, h - bezel], [z[1] - 0.003, z[1]]);
    if stands {
        let bar = thick * 0.45;
        let leg = Piece::new(Shape::Tube, "frame", [w * 0.16, w * 0.16 + bar], [0.0, foot + 0.02], [0.0, d]);
        let s = m.smallest;
        m.add(
            leg.thick(bar, s)
                .path(&[[0.5, 0.0, 0.0], [0.5, 0.9, 0.48], [0.5, 0.9, 0.52], [0.5, 0.0, 1.0]])
                .mirror(Mirror::X),
        );
    }
}

pub(super) fn monitor(m: &mut Maker, _p: &TemplateParams) {
    m.slot("screen", "#15171b", Glass);
    m.slot("frame", "#232427", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    let foot = h * 0.26;
    let thick = 0.03_f64.min(d * 0.3);
    let z = [d * 0.5, d * 0.5 + thick];
    m.add(Piece::new(Shape::Box, "frame", [0.0, w], [foot, h], [z[0], z[1] - 0.001]).round(thick * 0.2));
    let bezel = 0.012 * w;
    m.cube("screen", [bezel, w - bezel], [foot + bezel * 2.0, h - bezel], [z[1] - 0.003, z[1]]);
    m.cube("frame", [w * 0.45, w * 0.55], [0.01, h * 0.6], [d * 0.34, d * 0.46]);
    m.cube("frame", [w * 0.46, w * 0.54], [h * 0.5, h * 0.6], [d * 0.4, d * 0.52]);
    m.add(Piece::new(Shape::Slab, "frame", [w * 0.28, w * 0.72], [0.0, 0.014], [d * 0.1, d]).corner(0.15));
}

pub(super) fn laptop(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#a9abae", Metal);
    m.slot("screen", "#1a1c20", Glass);
    m.slot("keys", "#2b2c2f", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    if p.filled == Some(false) || h < 0.06 {
        m.add(Piece::new(Shape::Slab, "body", [0.0, w], [0.0, h], [0.0, d]).corner(0.06));
        return;
    }
    let base = 0.016_f64.min(h * 0.1);
    let z0 = d * 0.12;
    m.add(Piece::new(Shape::Slab, "body", [0.0, w], [0.0, base], [z0, d]).corner(0.05));
    m.cube("keys", [w * 0.07, w * 0.93], [base - 0.001, base + 0.0015], [z0 + (d - z0) * 0.14, z0 + (d - z0) * 0.6]);
    m.cube("keys", [w * 0.35, w * 0.65], [base - 0.001, base + 0.0008], [z0 + (d - z0) * 0.66, z0 + (d - z0) * 0.93]);
    let lean = (z0 / h).atan().to_degrees() * 1.1;
    let tall = (h - base) / lean.to_radians().cos();
    let y = [base, base + tall];
    let zc = z0 * 0.5;
    m.add(
        Piece::new(Shape::Slab, "body", [0.0, w], y, [zc - base * 0.25, zc + base * 0.25])
            .corner(0.05)
            .turn(-lean, 0.0, 0.0),
    );
    let screen = Piece::new(
        Shape::Box,
        "screen",
        [w * 0.03, w * 0.97],
        [y[0] + tall * 0.06, y[1] - tall * 0.05],
        [zc + base * 0.2, zc + base * 0.32],
    );
    m.add(screen.turn(-lean, 0.0, 0.0));
}

pub(super) fn keyboard(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#2b2c2f", Plastic);
    m.slot("keys", "#3d3f43", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    m.add(Piece::new(Shape::Slab, "body", [0.0, w], [0.0, h * 0.7], [0.0, d]).corner(0.1));
    let step = (d * 0.94) / 5.0;
    let row = Piece::new(Shape::Box, "keys", [w * 0.02, w * 0.98], [h * 0.65, h], [d * 0.04, d * 0.04 + step * 0.85]);
    m.row(row.round(h * 0.1), Axis::Z, 5, step);
}

pub(super) fn speaker(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#2a2826", Wood);
    m.slot("cones", "#3f4144", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    m.add(Piece::new(Shape::Box, "body", [0.0, w], [0.0, h], [0.0, d * 0.97]).round(0.008));
    let r = (w * 0.38).min(h * 0.22);
    for (y, r) in [(h * 0.3, r), (h * 0.62, r * if h > 0.6 { 1.0 } else { 0.5 }), (h * 0.85, r * 0.4)] {
        if y < h * 0.8 || h > 0.6 {
            let cone = Piece::new(Shape::Lathe, "cones", [w / 2.0 - r, w / 2.0 + r], [y - r, y + r], [d * 0.95, d]);
            m.add(cone.axis(Axis::Z).smooth(false).points(&[
                [1.0, 0.0],
                [1.0, 0.8],
                [0.85, 1.0],
                [0.75, 0.8],
                [0.3, 0.45],
                [0.28, 0.6],
                [0.0, 0.75],
            ]));
        }
    }
}

/// A clothes iron shaped, kettle shaped or similar small appliance: a vessel with a handle.
pub(super) fn kettle(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#b9bcbf", Metal);
    m.slot("handle", "#2a2a2c", Plastic);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let r = (w * 0.72).min(d);
    let x = [0.0, r];
    let z = [(d - r) / 2.0, f64::midpoint(d, r)];
    m.add(Piece::new(Shape::Lathe, "body", x, [0.0, h * 0.9], z).points(&[
        [0.95, 0.0],
        [1.0, 0.06],
        [0.95, 0.3],
        [0.75, 0.8],
        [0.66, 0.94],
        [0.3, 1.0],
        [0.0, 1.0],
    ]));
    let knob = r * 0.07;
    m.add(Piece::new(
        Shape::Sphere,
        "handle",
        [r / 2.0 - knob, r / 2.0 + knob],
        [h * 0.88, h],
        [d / 2.0 - knob, d / 2.0 + knob],
    ));
    let grip = Piece::new(Shape::Tube, "handle", [r * 0.8, w], [h * 0.12, h * 0.88], [d / 2.0 - 0.01, d / 2.0 + 0.01]);
    m.add(grip.thick(0.022_f64.min(s * 0.2), s).path(&[
        [0.0, 1.0, 0.5],
        [1.0, 0.95, 0.5],
        [0.95, 0.1, 0.5],
        [0.3, 0.0, 0.5],
    ]));
}
