//! Tables and desks.

use harmony_scene::MaterialCategory::{Metal, Wood};

use super::maker::{Maker, Piece};
use super::storage::{self, Cell};
use super::{LegStyle, TemplateParams};
use crate::{Axis, Mirror, Shape};

/// What differs between tables.
struct Table {
    thick: f64,
    legs: LegStyle,
    leg: f64,
    inset: f64,
    apron: bool,
    /// Height of a lower shelf as a share of the table's, if any.
    shelf: Option<f64>,
}

fn table(m: &mut Maker, p: &TemplateParams, t: &Table) {
    m.slot("top", "#8d6543", Wood);
    m.slot("legs", "#7a5537", Wood);
    let (w, h, d) = (m.w, m.h, m.d);
    let round = p.round.unwrap_or(false);
    let thick = t.thick.min(h * 0.25);
    let legs = p.legs.unwrap_or(if round { LegStyle::Pedestal } else { t.legs });
    let y = [h - thick, h];
    if round {
        m.add(Piece::new(Shape::Cylinder, "top", [0.0, w], y, [0.0, d]).oval().round(thick * 0.3));
    } else {
        m.add(Piece::new(Shape::Slab, "top", [0.0, w], y, [0.0, d]).corner(0.02).round(thick * 0.2));
    }
    let inset = if round { 0.16 * w.min(d) } else { t.inset };
    let leg = t.leg.min(w * 0.12).min(d * 0.2);
    if legs == LegStyle::Block {
        let side = leg.max(0.03);
        m.add(
            Piece::new(Shape::Box, "legs", [inset, inset + side], [0.0, y[0] + 0.001], [0.01, d - 0.01])
                .mirror(Mirror::X),
        );
    } else {
        m.legs(legs, "legs", y[0] + 0.001, inset, leg);
    }
    let framed = matches!(legs, LegStyle::Four | LegStyle::Tapered) && !round;
    if framed && t.apron {
        let tall = (h * 0.1).min(0.08);
        let i = inset + leg * 0.25;
        let (lo, board) = (y[0] - tall, 0.02_f64.min(leg));
        let x = [i, w - i];
        m.add(Piece::new(Shape::Box, "legs", x, [lo, y[0] + 0.001], [i, i + board]).mirror(Mirror::Z));
        m.add(Piece::new(Shape::Box, "legs", [i, i + board], [lo, y[0] + 0.001], [i, d - i]).mirror(Mirror::X));
    }
    let shelf =
        if p.shelves.is_some_and(|n| n > 0) { t.shelf.or(Some(0.3)) } else { t.shelf.filter(|_| p.shelves.is_none()) };
    if let Some(at) = shelf {
        let y = [h * at, h * at + thick * 0.6];
        let i = inset + leg * 0.4;
        if round && legs != LegStyle::Pedestal {
            m.add(Piece::new(Shape::Cylinder, "top", [i, w - i], y, [i, d - i]).oval());
        } else if framed || legs == LegStyle::Block {
            m.add(Piece::new(Shape::Slab, "top", [i, w - i], y, [i, d - i]).corner(0.02));
        }
    }
    let drawers = p.drawers.unwrap_or(0).min(4);
    if drawers > 0 && !round {
        m.slot("body", "#85603f", Wood);
        m.slot("fronts", "#8d6543", Wood);
        m.slot("handles", "#3c3a38", Metal);
        let tall = (h * 0.22).min(0.13);
        let x = [inset + leg, w - inset - leg];
        let yb = [y[0] - tall, y[0]];
        let front = d - 0.02;
        let (cx, cy) = storage::carcass(m, "body", x, yb, [0.03, front - 0.004], 0.012);
        let step = (cx[1] - cx[0]) / f64::from(drawers);
        for k in 0..drawers {
            let cell = [cx[0] + step * f64::from(k), cx[0] + step * f64::from(k + 1)];
            storage::cell(m, Cell::Drawer, cell, cy, [0.03, front], 0);
        }
    }
}

pub(super) fn dining(m: &mut Maker, p: &TemplateParams) {
    let t = Table { thick: 0.035, legs: LegStyle::Four, leg: 0.07, inset: 0.03, apron: true, shelf: None };
    table(m, p, &t);
}

pub(super) fn coffee(m: &mut Maker, p: &TemplateParams) {
    let t = Table { thick: 0.032, legs: LegStyle::Four, leg: 0.05, inset: 0.02, apron: false, shelf: Some(0.28) };
    table(m, p, &t);
}

pub(super) fn round(m: &mut Maker, p: &TemplateParams) {
    let p = TemplateParams { round: Some(p.round.unwrap_or(true)), ..p.clone() };
    let t = Table { thick: 0.03, legs: LegStyle::Pedestal, leg: 0.05, inset: 0.03, apron: false, shelf: None };
    table(m, &p, &t);
}

pub(super) fn side(m: &mut Maker, p: &TemplateParams) {
    let t = Table { thick: 0.025, legs: LegStyle::Tapered, leg: 0.035, inset: 0.02, apron: false, shelf: None };
    table(m, p, &t);
}

pub(super) fn console(m: &mut Maker, p: &TemplateParams) {
    let t = Table { thick: 0.03, legs: LegStyle::Four, leg: 0.04, inset: 0.01, apron: true, shelf: Some(0.18) };
    table(m, p, &t);
}

/// A desk: a table, with `drawers` in a pedestal on the right when there are three or more.
pub(super) fn desk(m: &mut Maker, p: &TemplateParams) {
    let t = Table { thick: 0.03, legs: LegStyle::Four, leg: 0.045, inset: 0.015, apron: false, shelf: None };
    let drawers = p.drawers.unwrap_or(3);
    if drawers < 3 {
        let p = TemplateParams { drawers: Some(drawers), ..p.clone() };
        return table(m, &p, &t);
    }
    let plain = TemplateParams { drawers: None, shelves: None, ..p.clone() };
    table(m, &plain, &t);
    m.slot("body", "#85603f", Wood);
    m.slot("fronts", "#8d6543", Wood);
    m.slot("handles", "#3c3a38", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let wide = (w * 0.3).min(0.42);
    let x = [w - 0.06 - wide, w - 0.06];
    let front = d - 0.03;
    let (cx, cy) = storage::carcass(m, "body", x, [h * 0.08, h - 0.03], [0.04, front - 0.004], 0.015);
    let rows = drawers.min(6);
    let step = (cy[1] - cy[0]) / f64::from(rows);
    for k in 0..rows {
        let y = [cy[0] + step * f64::from(k), cy[0] + step * f64::from(k + 1)];
        storage::cell(m, Cell::Drawer, cx, y, [0.04, front], 0);
    }
}

/// An upright piano: case, keys, music desk, stool not included.
pub(super) fn piano(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#241d1a", Wood);
    m.slot("keys", "#ece8dd", super::MaterialCategory::Plastic);
    m.slot("black_keys", "#151515", super::MaterialCategory::Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    let key = h * 0.58;
    m.cube("body", [0.0, w], [h * 0.08, h * 0.97], [0.0, d * 0.55]);
    m.add(Piece::new(Shape::Box, "body", [0.0, w], [h * 0.97, h], [0.0, d * 0.58]).round(0.006));
    m.cube("body", [0.0, w], [0.0, h * 0.08], [0.0, d * 0.6]);
    m.add(Piece::new(Shape::Box, "body", [0.0, w], [key - 0.07, key], [d * 0.5, d]).round(0.01));
    let end = Piece::new(Shape::Box, "body", [0.0, 0.045_f64.min(w * 0.1)], [0.0, key + 0.07], [d * 0.5, d * 0.98]);
    m.add(end.round(0.01).mirror(Mirror::X));
    let keys = [0.05_f64.min(w * 0.1), w - 0.05_f64.min(w * 0.1)];
    m.cube("keys", keys, [key - 0.005, key + 0.015], [d * 0.72, d * 0.97]);
    let n = 30;
    let step = (keys[1] - keys[0]) / f64::from(n);
    let sharp = Piece::new(
        Shape::Box,
        "black_keys",
        [keys[0] + step * 0.7, keys[0] + step * 1.2],
        [key + 0.014, key + 0.025],
        [d * 0.72, d * 0.87],
    );
    m.row(sharp, Axis::X, (n - 1) as u32, step);
    let desk = Piece::new(Shape::Slab, "body", [w * 0.2, w * 0.8], [key + 0.1, h * 0.86], [d * 0.56, d * 0.58]);
    m.add(desk.turn(-12.0, 0.0, 0.0));
}
