//! Beds and case furniture: boards, fronts, handles.

use harmony_scene::MaterialCategory::{Fabric, Metal, Paper, Stone, Wood};

use super::maker::{Maker, Piece, Span};
use super::{BackStyle, LegStyle, TemplateParams};
use crate::{Axis, Mirror, Shape};

/// What fills a cell of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cell {
    Drawer,
    /// A door hinged on the left.
    DoorLeft,
    /// A door hinged on the right.
    DoorRight,
    Open,
    /// Book spines, at most so many.
    Books(u32),
}

/// Boards around a box that is open to the front; returns the free inside (x, y).
pub(super) fn carcass(m: &mut Maker, slot: &str, x: Span, y: Span, z: Span, board: f64) -> (Span, Span) {
    m.cube(slot, [x[0], x[0] + board], y, z);
    m.cube(slot, [x[1] - board, x[1]], y, z);
    let inner = [x[0] + board - 0.001, x[1] - board + 0.001];
    m.cube(slot, inner, [y[0], y[0] + board], z);
    m.cube(slot, inner, [y[1] - board, y[1]], z);
    m.cube(slot, inner, [y[0] + board - 0.001, y[1] - board + 0.001], [z[0], z[0] + board * 0.5]);
    ([x[0] + board, x[1] - board], [y[0] + board, y[1] - board])
}

/// A drawer or door front with its handle, or what stands in an open cell.
pub(super) fn cell(m: &mut Maker, kind: Cell, x: Span, y: Span, z: Span, seed: u32) {
    let (cw, ch) = (x[1] - x[0], y[1] - y[0]);
    if cw < 0.01 || ch < 0.01 {
        return;
    }
    let gap = 0.003_f64.min(cw * 0.05).min(ch * 0.05);
    let front = z[1];
    let thick = 0.018_f64.min((z[1] - z[0]) * 0.2);
    let knob = 0.012_f64.min(cw * 0.1).min(ch * 0.1);
    match kind {
        Cell::Drawer => {
            let panel = Piece::new(
                Shape::Box,
                "fronts",
                [x[0] + gap, x[1] - gap],
                [y[0] + gap, y[1] - gap],
                [front - thick, front],
            );
            m.add(panel.round(0.003));
            let (cx, cy) = (f64::midpoint(x[0], x[1]), y[0] + ch * 0.56);
            let half = (cw * 0.16).min(0.09);
            if cw > 0.25 {
                let bar = Piece::new(
                    Shape::Box,
                    "handles",
                    [cx - half, cx + half],
                    [cy - knob * 0.4, cy + knob * 0.4],
                    [front - 0.001, front + knob * 1.8],
                );
                m.add(bar.round(knob * 0.3));
            } else {
                let ball = Piece::new(
                    Shape::Sphere,
                    "handles",
                    [cx - knob, cx + knob],
                    [cy - knob, cy + knob],
                    [front - knob * 0.3, front + knob * 1.7],
                );
                m.add(ball);
            }
        }
        Cell::DoorLeft | Cell::DoorRight => {
            let panel = Piece::new(
                Shape::Box,
                "fronts",
                [x[0] + gap, x[1] - gap],
                [y[0] + gap, y[1] - gap],
                [front - thick, front],
            );
            m.add(panel.round(0.003));
            let at = if kind == Cell::DoorLeft { x[1] - cw * 0.09 } else { x[0] + cw * 0.09 };
            let length = (ch * 0.16).clamp(knob * 2.0, 0.14);
            let cy = y[0] + ch * if ch > 1.2 { 0.5 } else { 0.62 };
            let bar = Piece::new(
                Shape::Box,
                "handles",
                [at - knob * 0.4, at + knob * 0.4],
                [cy - length / 2.0, cy + length / 2.0],
                [front - 0.001, front + knob * 1.8],
            );
            m.add(bar.round(knob * 0.3));
        }
        Cell::Open => {}
        Cell::Books(most) => books(m, x, y, z, (seed, most)),
    }
}

/// A row of book spines that fills most of a shelf.
fn books(m: &mut Maker, x: Span, y: Span, z: Span, (seed, most): (u32, u32)) {
    m.slot("books", "#8c5a48", Paper);
    m.slot("books2", "#5b6b7c", Paper);
    m.slot("books3", "#d3c7b0", Paper);
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12_345);
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 16) / 65_536.0
    };
    let fill = x[0] + (x[1] - x[0]) * (0.62 + 0.34 * next());
    let tallest = (y[1] - y[0]) * 0.92;
    let unit = ((x[1] - x[0]) / f64::from(most.max(1)) * 1.15).max(0.034);
    let deep = (z[1] - z[0]).min(0.24);
    let mut at = x[0] + 0.004;
    while at < fill {
        let wide = (unit * (0.5 + 0.8 * next())).min(x[1] - at - 0.002);
        if wide < 0.006 {
            break;
        }
        let tall = tallest * (0.62 + 0.38 * next());
        let front = z[1] - 0.02 - 0.03 * next();
        let slot = ["books", "books2", "books3"][(next() * 3.0) as usize % 3];
        let book = Piece::new(
            Shape::Box,
            slot,
            [at, at + wide * 0.97],
            [y[0], y[0] + tall],
            [(front - deep * 0.8).max(z[0] + 0.01), front],
        );
        m.add(book);
        at += wide;
    }
}

fn case_slots(m: &mut Maker, color: &str) {
    m.slot("body", color, Wood);
    m.slot("fronts", color, Wood);
    m.slot("handles", "#3c3a38", Metal);
    m.slot("legs", "#4a3626", Wood);
}

/// A case with a grid of cells, row by row from the top; columns are equally wide, rows weighted.
struct Case<'a> {
    rows: &'a [(f64, Vec<Cell>)],
    legs: LegStyle,
    /// Height under the body, metres.
    leg: f64,
    /// Overhang of the top board, metres.
    overhang: f64,
}

fn case(m: &mut Maker, c: &Case) {
    let (w, h, d) = (m.w, m.h, m.d);
    let leg = if c.legs == LegStyle::None { 0.0 } else { c.leg.min(h * 0.45) };
    let board = 0.022_f64.min(w * 0.06).min(h * 0.06).min(d * 0.2);
    let knob = 0.02_f64.min(d * 0.08);
    let front = d - knob;
    let over = c.overhang.min(w * 0.04);
    let body_x = [over, w - over];
    let top = h - if over > 0.0 { board } else { 0.0 };
    let (x, y) = carcass(m, "body", body_x, [leg, top], [0.0, front - 0.002], board);
    if over > 0.0 {
        let plate = Piece::new(Shape::Box, "body", [0.0, w], [top - 0.001, h], [0.0, front + over]);
        m.add(plate.round(board * 0.15));
    }
    match c.legs {
        LegStyle::Block => m.cube("body", [over, w - over], [0.0, leg + 0.001], [0.02, front - 0.04]),
        style => m.legs(style, "legs", leg + 0.002, 0.03 + over, (0.04_f64).min(w * 0.1)),
    }
    let total: f64 = c.rows.iter().map(|r| r.0).sum::<f64>().max(1e-6);
    let mut high = y[1];
    for (n, (weight, cells)) in c.rows.iter().enumerate() {
        let low = high - (y[1] - y[0]) * weight / total;
        if n + 1 < c.rows.len() {
            m.cube("body", x, [low - board * 0.4, low + board * 0.4], [board * 0.4, front - 0.006]);
        }
        let step = (x[1] - x[0]) / cells.len().max(1) as f64;
        for (k, kind) in cells.iter().enumerate() {
            let cx = [x[0] + step * k as f64, x[0] + step * (k + 1) as f64];
            if k > 0 {
                let t = board * 0.4;
                m.cube("body", [cx[0] - t, cx[0] + t], [low, high], [board * 0.4, front - 0.006]);
            }
            let seed = (n * 16 + k) as u32;
            cell(m, *kind, cx, [low + board * 0.2, high - board * 0.2], [board * 0.5, front], seed);
        }
        high = low;
    }
}

fn doors(count: u32) -> Vec<Cell> {
    (0..count.clamp(1, 8)).map(|k| if k % 2 == 0 && count > 1 { Cell::DoorLeft } else { Cell::DoorRight }).collect()
}

pub(super) fn nightstand(m: &mut Maker, p: &TemplateParams) {
    case_slots(m, "#8f6b4a");
    let drawers = p.drawers.unwrap_or(2).min(5);
    let mut rows: Vec<(f64, Vec<Cell>)> = (0..drawers).map(|_| (1.0, vec![Cell::Drawer])).collect();
    if p.doors.is_some_and(|n| n > 0) {
        rows.push((2.0, doors(p.doors.unwrap_or(1))));
    } else if p.shelves.is_some_and(|n| n > 0) || rows.is_empty() {
        rows.push((1.2, vec![Cell::Open]));
    }
    let legs = p.legs.unwrap_or(LegStyle::Four);
    let leg = if matches!(legs, LegStyle::Block) { 0.05 } else { m.h * 0.25 };
    case(m, &Case { rows: &rows, legs, leg, overhang: 0.012 });
}

pub(super) fn dresser(m: &mut Maker, p: &TemplateParams) {
    case_slots(m, "#94714f");
    let columns = if m.w > m.h * 1.1 { 2 } else { 1 };
    let drawers = p.drawers.unwrap_or(columns * if m.h > 1.0 { 5 } else { 3 }).clamp(1, 16);
    let rows_n = drawers.div_ceil(columns);
    let rows: Vec<(f64, Vec<Cell>)> = (0..rows_n)
        .map(|k| (1.0 + 0.12 * f64::from(k), vec![Cell::Drawer; (drawers - k * columns).min(columns) as usize]))
        .collect();
    case(m, &Case { rows: &rows, legs: p.legs.unwrap_or(LegStyle::Tapered), leg: m.h * 0.14, overhang: 0.012 });
}

/// Cabinet, sideboard, television stand.
pub(super) fn cabinet(m: &mut Maker, p: &TemplateParams) {
    case_slots(m, "#8c6a4a");
    let low = m.h < 0.62;
    let mut rows: Vec<(f64, Vec<Cell>)> = Vec::new();
    let drawers = p.drawers.unwrap_or(0).min(8);
    if drawers > 0 {
        rows.push((if low { 1.0 } else { 0.35 }, vec![Cell::Drawer; drawers as usize]));
    }
    let wanted = p.doors.unwrap_or(if drawers > 0 && low { 0 } else { (m.w / 0.48).round().clamp(1.0, 6.0) as u32 });
    if p.shelves.is_some_and(|n| n > 0) && p.doors.is_none() {
        for _ in 0..p.shelves.unwrap_or(1).min(8) {
            rows.push((1.0, vec![Cell::Open]));
        }
    } else if wanted > 0 {
        let mut cells = doors(wanted);
        if p.shelves.is_some_and(|n| n > 0) && cells.len() >= 2 {
            cells.insert(cells.len() / 2, Cell::Open);
        }
        rows.push((1.0, cells));
    }
    if rows.is_empty() {
        rows.push((1.0, vec![Cell::Open]));
    }
    case(m, &Case { rows: &rows, legs: p.legs.unwrap_or(LegStyle::Four), leg: (m.h * 0.18).min(0.16), overhang: 0.01 });
}

/// A television stand: an open shelf between doors.
pub(super) fn tv_stand(m: &mut Maker, p: &TemplateParams) {
    case_slots(m, "#7d5f45");
    let rows: Vec<(f64, Vec<Cell>)> = if p.drawers.is_some() || p.doors.is_some() || p.shelves.is_some() {
        let mut cells: Vec<Cell> = vec![Cell::Open; p.shelves.unwrap_or(0).min(4) as usize];
        let side: Vec<Cell> = (0..p.drawers.unwrap_or(0).min(6)).map(|_| Cell::Drawer).collect();
        let leaf = p.doors.unwrap_or(0).min(6);
        cells.extend(side);
        cells.extend(if leaf > 0 { doors(leaf) } else { Vec::new() });
        vec![(1.0, if cells.is_empty() { vec![Cell::Open] } else { cells })]
    } else if m.w > 1.1 {
        vec![(0.45, vec![Cell::Open, Cell::Open]), (0.55, vec![Cell::Drawer, Cell::Drawer, Cell::Drawer])]
    } else {
        vec![(0.5, vec![Cell::Open]), (0.5, doors(2))]
    };
    case(m, &Case { rows: &rows, legs: p.legs.unwrap_or(LegStyle::Tapered), leg: m.h * 0.24, overhang: 0.01 });
}

pub(super) fn wardrobe(m: &mut Maker, p: &TemplateParams) {
    case_slots(m, "#b29b80");
    let leaves = p.doors.unwrap_or((m.w / 0.5).round().clamp(1.0, 6.0) as u32).clamp(1, 8);
    let mut rows = vec![(1.0, doors(leaves))];
    let drawers = p.drawers.unwrap_or(0).min(6);
    if drawers > 0 {
        rows.push((0.22, vec![Cell::Drawer; drawers as usize]));
    }
    case(m, &Case { rows: &rows, legs: p.legs.unwrap_or(LegStyle::Block), leg: 0.07, overhang: 0.015 });
}

pub(super) fn bookshelf(m: &mut Maker, p: &TemplateParams) {
    case_slots(m, "#9a7650");
    let n = p.shelves.unwrap_or((m.h / 0.36).round().clamp(1.0, 8.0) as u32).clamp(1, 10);
    let columns = if m.w > 1.15 { (m.w / 0.8).round().clamp(1.0, 4.0) as usize } else { 1 };
    let filled = p.filled.unwrap_or(true);
    // many shelves share the parts that a model may have
    let cells_n = n as usize * columns;
    let per_cell = (110 / cells_n.max(1)).min(14) as u32;
    let rows: Vec<(f64, Vec<Cell>)> = (0..n as usize)
        .map(|r| {
            let cells = (0..columns)
                .map(|c| {
                    let skip = (r * 7 + c * 3) % 4 == 3;
                    if filled && !skip && per_cell > 1 { Cell::Books(per_cell) } else { Cell::Open }
                })
                .collect();
            (1.0, cells)
        })
        .collect();
    let legs = p.legs.unwrap_or(LegStyle::None);
    case(m, &Case { rows: &rows, legs, leg: 0.08, overhang: 0.0 });
}

/// Boards on the wall: `shelves` of them.
pub(super) fn wall_shelf(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#9a7650", Wood);
    m.slot("brackets", "#35353a", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let n = p.shelves.unwrap_or(if h > 0.4 { (h / 0.35).round() as u32 } else { 1 }).clamp(1, 6);
    let board = 0.028_f64.min(h * 0.6);
    if n == 1 {
        m.add(Piece::new(Shape::Box, "body", [0.0, w], [h - board, h], [0.0, d]).round(0.004));
        let low = (h - board - d * 0.6).max(0.0);
        let bracket =
            Piece::new(Shape::Extrude, "brackets", [w * 0.12, w * 0.12 + 0.02], [low, h - board], [0.0, d * 0.8])
                .axis(Axis::X)
                .points(&[[0.0, 0.0], [0.14, 0.0], [1.0, 0.86], [1.0, 1.0], [0.0, 1.0]]);
        if h - board - low > 0.01 {
            m.add(bracket.mirror(Mirror::X));
        }
        return;
    }
    let step = (h - board) / f64::from(n - 1);
    m.row(Piece::new(Shape::Box, "body", [0.0, w], [0.0, board], [0.0, d]).round(0.004), Axis::Y, n, step);
    m.add(Piece::new(Shape::Box, "body", [0.0, board], [0.0, h], [0.0, d * 0.98]).mirror(Mirror::X));
}

/// Base units under a counter.
pub(super) fn kitchen_base(m: &mut Maker, p: &TemplateParams) {
    case_slots(m, "#d8d4cc");
    m.slot("counter", "#6d6862", Stone);
    let (w, h, d) = (m.w, m.h, m.d);
    let (counter, kick, board) = (0.04_f64.min(h * 0.1), (0.11 * h).min(0.1), 0.02);
    let front = d - 0.045_f64.min(d * 0.1);
    let top = h - counter;
    let (x, y) = carcass(m, "body", [0.0, w], [kick, top], [0.0, front - 0.002], board);
    m.cube("body", [0.0, w], [0.0, kick + 0.001], [0.0, front - 0.06]);
    m.add(Piece::new(Shape::Box, "counter", [0.0, w], [top, h], [0.0, d]).round(0.005));
    let units = p.doors.unwrap_or((w / 0.55).round().max(1.0) as u32).clamp(1, 12);
    let step = (x[1] - x[0]) / f64::from(units);
    let drawers = p.drawers.unwrap_or(units).min(units);
    for k in 0..units {
        let cx = [x[0] + step * f64::from(k), x[0] + step * f64::from(k + 1)];
        let split = if k < drawers { y[1] - (y[1] - y[0]) * 0.22 } else { y[1] };
        let z = [board, front];
        if k < drawers {
            cell(m, Cell::Drawer, cx, [split, y[1]], z, 0);
        }
        cell(m, if k % 2 == 0 { Cell::DoorLeft } else { Cell::DoorRight }, cx, [y[0], split], z, 0);
    }
}

pub(super) fn kitchen_wall(m: &mut Maker, p: &TemplateParams) {
    case_slots(m, "#d8d4cc");
    let units = p.doors.unwrap_or((m.w / 0.45).round().max(1.0) as u32);
    let rows = vec![(1.0, doors(units.clamp(1, 12)))];
    case(m, &Case { rows: &rows, legs: LegStyle::None, leg: 0.0, overhang: 0.0 });
}

/// A bed; its head is at the back. `extra` adds a footboard.
pub(super) fn bed(m: &mut Maker, p: &TemplateParams) {
    m.slot("blanket", "#a9b0b5", Fabric);
    m.slot("mattress", "#e9e6df", Fabric);
    m.slot("pillows", "#efece6", Fabric);
    let (w, h, d) = (m.w, m.h, m.d);
    let back = p.back.unwrap_or(BackStyle::Upholstered);
    let soft = matches!(back, BackStyle::Upholstered | BackStyle::Tufted | BackStyle::Curved);
    let soft = soft || back == BackStyle::None;
    m.slot("frame", if soft { "#8b8276" } else { "#7d5838" }, if soft { Fabric } else { Wood });
    m.slot("legs", "#4a3626", Wood);
    let top = if back == BackStyle::None { h * 0.82 } else { (h * 0.56).min(0.62) };
    let legs = p.legs.unwrap_or(LegStyle::Four);
    let leg = if matches!(legs, LegStyle::None | LegStyle::Block) { 0.0 } else { (top * 0.22).min(0.14) };
    let bare = back == BackStyle::None && legs == LegStyle::None;
    let thick = if bare { top * 0.8 } else { (top * 0.42).min(0.26) };
    let rail_top = top - thick * 0.72;
    let board = if back == BackStyle::None { 0.0 } else { (0.045 * d).clamp(0.03, 0.12).min(d * 0.2) };
    let foot = if p.extra.unwrap_or(false) { 0.05_f64.min(d * 0.1) } else { 0.0 };
    let side = 0.025_f64.min(w * 0.04);
    let z = [board * 0.8, d - foot];
    let frame = Piece::new(Shape::Box, "frame", [0.004, w - 0.004], [leg, rail_top], [z[0], z[1]]);
    m.add(frame.round(if soft { 0.025 } else { 0.006 }));
    let bed_x = [side, w - side];
    let mattress = Piece::new(Shape::Box, "mattress", bed_x, [rail_top - 0.01, top], [board, z[1] - 0.015]);
    m.add(mattress.round(0.05_f64.min(thick * 0.4)));
    match legs {
        LegStyle::None => {}
        LegStyle::Block => m.cube("frame", [0.05, w - 0.05], [0.0, rail_top * 0.5], [0.08, d - 0.08]),
        other => m.legs(other, "legs", leg + 0.01, 0.06, 0.06),
    }
    headboard(m, back, [0.0, w], [leg * 0.5, h], [0.0, board]);
    if foot > 0.0 {
        let footboard = Piece::new(Shape::Slab, "frame", [0.0, w], [leg * 0.5, top + 0.08], [d - foot, d]);
        m.add(footboard.corner(0.08));
    }
    // the cover hangs over both sides and leaves the pillows free
    let head = board + (z[1] - board) * 0.3;
    let cover = 0.03_f64.min(thick * 0.2);
    let drop = (thick * 0.75).min(top - leg);
    let blanket = Piece::new(
        Shape::Cushion,
        "blanket",
        [0.0, w],
        [top - drop, top + cover * 1.6],
        [head, (z[1] + 0.004).min(d - foot)],
    );
    m.add(blanket.puff(0.1));
    let fold = Piece::new(
        Shape::Box,
        "mattress",
        [0.004, w - 0.004],
        [top - drop * 0.8, top + cover * 1.9],
        [head - 0.02, head + (z[1] - board) * 0.1],
    );
    m.add(fold.round(cover * 1.6));
    let count = p.cushions.unwrap_or(if w > 1.15 { 2 } else { 1 }).min(8);
    let across = if w > 1.15 { 2 } else { 1 };
    let room = (w - 2.0 * side) / f64::from(across);
    for k in 0..count {
        let (column, row) = (k % across, k / across);
        let wide = (room * 0.86).min(0.72) * (1.0 - 0.14 * f64::from(row.min(3)));
        let tall = (wide * 0.62).min(0.45);
        let plump = (tall * 0.42).min(0.17);
        let cx = side + room * (f64::from(column) + 0.5);
        let z0 = board + 0.02 + f64::from(row) * plump * 0.95;
        let y0 = top + cover * 0.2;
        let pillow = Piece::new(
            Shape::Cushion,
            if row == 0 { "pillows" } else { "cushions" },
            [cx - wide / 2.0, cx + wide / 2.0],
            [y0, y0 + tall],
            [z0, z0 + plump],
        );
        m.add(pillow.puff(0.8).turn(-38.0, 0.0, 0.0));
    }
    m.slot("cushions", "#8f9aa3", Fabric);
}

fn headboard(m: &mut Maker, style: BackStyle, x: Span, y: Span, z: Span) {
    let t = z[1] - z[0];
    match style {
        BackStyle::None => {}
        BackStyle::Tufted => {
            m.cube("frame", x, y, [z[0], z[0] + t * 0.5]);
            let count = ((x[1] - x[0]) / 0.17).round().clamp(3.0, 16.0);
            let step = (x[1] - x[0]) / count;
            let low = y[0] + (y[1] - y[0]) * 0.3;
            let pad = Piece::new(Shape::Cushion, "frame", [x[0], x[0] + step], [low, y[1]], [z[0] + t * 0.3, z[1]]);
            m.row(pad.puff(0.4), Axis::X, count as u32, step);
        }
        BackStyle::Slat | BackStyle::Bars | BackStyle::Ladder => {
            let post = (t * 0.9).min(0.05);
            m.add(Piece::new(Shape::Box, "frame", [x[0], x[0] + post], y, z).round(post * 0.2).mirror(Mirror::X));
            let rail = Piece::new(Shape::Box, "frame", x, [y[1] - 0.06, y[1] - 0.005], z);
            m.add(rail.round(post * 0.25));
            let low = y[0] + (y[1] - y[0]) * 0.4;
            m.cube("frame", x, [low, low + 0.05], z);
            let count = ((x[1] - x[0]) / 0.12).round().clamp(3.0, 20.0);
            let step = (x[1] - x[0] - post) / count;
            let x0 = x[0] + post / 2.0 + step / 2.0;
            let slat = if style == BackStyle::Bars { 0.012 } else { step * 0.3 };
            let mid = f64::midpoint(z[0], z[1]);
            let bar = Piece::new(
                Shape::Box,
                "frame",
                [x0 - slat / 2.0, x0 + slat / 2.0],
                [low, y[1] - 0.03],
                [mid - slat.min(t) / 2.0, mid + slat.min(t) / 2.0],
            );
            m.row(bar, Axis::X, count as u32, step);
        }
        BackStyle::Solid | BackStyle::Mesh => {
            m.add(Piece::new(Shape::Box, "frame", x, y, [z[0], z[0] + t.min(0.05)]).round(0.008));
        }
        BackStyle::Upholstered | BackStyle::Curved => {
            m.add(Piece::new(Shape::Cushion, "frame", x, y, z).puff(0.1));
        }
    }
}

/// A cot or crib: bars all around a mattress.
pub(super) fn crib(m: &mut Maker, _p: &TemplateParams) {
    m.slot("frame", "#e6e0d6", Wood);
    m.slot("mattress", "#efece6", Fabric);
    let (w, h, d) = (m.w, m.h, m.d);
    let t = 0.04_f64.min(w * 0.08).min(d * 0.08);
    let low = h * 0.3;
    m.add(
        Piece::new(Shape::Box, "frame", [0.0, t], [0.0, h], [0.0, t]).round(0.006).square(Axis::Y).mirror(Mirror::Xz),
    );
    for y in [low, h - t] {
        m.add(Piece::new(Shape::Box, "frame", [0.0, w], [y, y + t * 0.8], [0.0, t * 0.7]).mirror(Mirror::Z));
        m.add(Piece::new(Shape::Box, "frame", [0.0, t * 0.7], [y, y + t * 0.8], [0.0, d]).mirror(Mirror::X));
    }
    for (axis, length) in [(Axis::X, w), (Axis::Z, d)] {
        let n = (length / 0.1).round().clamp(3.0, 14.0);
        let step = (length - t) / n;
        let at = [t / 2.0 + step / 2.0 - 0.008, t / 2.0 + step / 2.0 + 0.008];
        let across = [t * 0.2, t * 0.2 + 0.014];
        let (x, z) = if axis == Axis::X { (at, across) } else { (across, at) };
        let bar = Piece::new(Shape::Box, "frame", x, [low, h - t * 0.5], z);
        m.row(bar.mirror(if axis == Axis::X { Mirror::Z } else { Mirror::X }), axis, n as u32, step);
    }
    let bed = Piece::new(Shape::Box, "mattress", [t * 0.5, w - t * 0.5], [low, low + 0.1], [t * 0.5, d - t * 0.5]);
    m.add(bed.round(0.03));
}
