//! Small things and plants.

use harmony_scene::MaterialCategory::{Ceramic, Fabric, Glass, Metal, Other, Paper, Plastic, Rattan, Wood};

use super::maker::{Maker, Piece, Span};
use super::{PlantHabit, TemplateParams};
use crate::{Axis, LeafHabit, Mirror, Shape};

pub(super) fn pillow(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#b7a890", Fabric);
    let (w, h, d) = (m.w, m.h, m.d);
    if p.round == Some(true) {
        let axis = if h <= d { Axis::Y } else { Axis::Z };
        let pouf = Piece::new(Shape::Lathe, "body", [0.0, w], [0.0, h], [0.0, d]).oval().axis(axis);
        m.add(pouf.points(&[[0.0, 0.0], [0.6, 0.04], [0.93, 0.22], [1.0, 0.5], [0.93, 0.78], [0.6, 0.96], [0.0, 1.0]]));
        return;
    }
    m.add(Piece::new(Shape::Cushion, "body", [0.0, w], [0.0, h], [0.0, d]).puff(0.85));
}

/// A folded blanket or towel.
pub(super) fn blanket(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#a8a29a", Fabric);
    let (w, h, d) = (m.w, m.h, m.d);
    let layers = ((h / 0.03).round() as u32).clamp(1, 6);
    let step = h / f64::from(layers);
    for k in 0..layers {
        let inset = 0.004 * f64::from(k % 3) * w.min(d);
        let y = [step * f64::from(k), step * (f64::from(k) + 1.02)];
        m.add(
            Piece::new(Shape::Box, "body", [inset, w - inset], [y[0], y[1].min(h)], [0.0, d - inset])
                .round(step * 0.45),
        );
    }
}

fn book_at(m: &mut Maker, cover: &str, x: Span, y: Span, z: Span) {
    m.slot("pages", "#efe8d8", Paper);
    let t = ((y[1] - y[0]) * 0.1).min(0.003);
    let edge = (x[1] - x[0]) * 0.025;
    m.add(Piece::new(Shape::Box, cover, x, [y[0], y[0] + t], z));
    m.add(Piece::new(Shape::Box, cover, x, [y[1] - t, y[1]], z));
    m.add(Piece::new(
        Shape::Box,
        "pages",
        [x[0] + edge, x[1] - edge],
        [y[0] + t * 0.5, y[1] - t * 0.5],
        [z[0] + edge, z[1] - edge],
    ));
    m.add(Piece::new(Shape::Box, cover, [x[0], x[0] + edge * 1.5], y, z));
}

pub(super) fn book(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#7b3f36", Paper);
    let (w, h, d) = (m.w, m.h, m.d);
    book_at(m, "body", [0.0, w], [0.0, h], [0.0, d]);
}

/// Books: lying on each other, or standing in a row when they are higher than wide.
pub(super) fn book_stack(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#7b4a3c", Paper);
    m.slot("books2", "#4d6072", Paper);
    m.slot("books3", "#c9b58f", Paper);
    let (w, h, d) = (m.w, m.h, m.d);
    let names = ["body", "books2", "books3"];
    let lying = h < d.max(w) * 0.85;
    let n =
        p.cushions.unwrap_or(if lying { (h / 0.03).round() as u32 } else { (w / 0.035).round() as u32 }).clamp(1, 14);
    for k in 0..n {
        let slot = names[(k as usize * 2 + k as usize / 3) % 3];
        let vary = f64::from((k * 37) % 11) / 11.0;
        if lying {
            let step = h / f64::from(n);
            let (iw, id) = (w * 0.1 * vary, d * 0.08 * (1.0 - vary));
            let y = [step * f64::from(k), step * f64::from(k + 1)];
            book_at(m, slot, [iw * 0.5, w - iw], y, [id, d - id * 0.4]);
        } else {
            let step = w / f64::from(n);
            let x = [step * f64::from(k), step * (f64::from(k) + 0.97)];
            m.cube(slot, x, [0.0, h * (1.0 - 0.28 * vary)], [d * 0.15 * vary, d * (1.0 - 0.05 * vary)]);
        }
    }
}

pub(super) fn vase(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#c6bba8", Ceramic);
    let (w, h, d) = (m.w, m.h, m.d);
    let flowers = p.filled.unwrap_or(p.habit.is_some());
    let top = if flowers { h * 0.45 } else { h };
    let r = if flowers { (w.min(d) * 0.24).max(0.02) } else { w.min(d) / 2.0 };
    let (cx, cz) = (w / 2.0, d / 2.0);
    let body = Piece::new(Shape::Lathe, "body", [cx - r, cx + r], [0.0, top], [cz - r, cz + r]).hollow(0.06);
    m.add(body.points(&[[0.55, 0.0], [0.72, 0.08], [0.97, 0.32], [0.98, 0.5], [0.66, 0.76], [0.48, 0.88], [0.6, 1.0]]));
    if flowers {
        bouquet(m, [cx, cz], top * 0.95);
    }
}

/// Stems that fan out of a neck, with blossoms that fill the upper part.
fn bouquet(m: &mut Maker, [cx, cz]: [f64; 2], neck: f64) {
    m.slot("leaves", "#5d7a4a", Other);
    m.slot("flowers", "#d9a7a0", Other);
    let (w, h, d) = (m.w, m.h, m.d);
    let y = [neck * 0.8, neck + (h - neck) * 0.75];
    let spread = w.min(d) * 0.36;
    let stems = Piece::new(Shape::Leaves, "leaves", [cx - spread, cx + spread], y, [cz - spread, cz + spread]);
    m.add(stems.leaves(LeafHabit::Upright, 16, 0.16).seed(3));
    let head = [neck + (h - neck) * 0.32, h];
    let blossoms = Piece::new(Shape::Leaves, "flowers", [0.0, w], head, [0.0, d]);
    m.add(blossoms.leaves(LeafHabit::Flowers, 14, 0.36).seed(5));
}

pub(super) fn bottle(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#4d6a4f", Glass);
    m.slot("cap", "#2d2a28", Plastic);
    let (w, h, d) = (m.w, m.h, m.d);
    m.add(Piece::new(Shape::Lathe, "body", [0.0, w], [0.0, h * 0.94], [0.0, d]).points(&[
        [0.9, 0.0],
        [1.0, 0.03],
        [1.0, 0.3],
        [1.0, 0.56],
        [0.8, 0.7],
        [0.38, 0.8],
        [0.33, 0.92],
        [0.36, 1.0],
    ]));
    let r = w.min(d) * 0.2;
    let (cx, cz) = (w / 2.0, d / 2.0);
    m.add(Piece::new(Shape::Cylinder, "cap", [cx - r, cx + r], [h * 0.92, h], [cz - r, cz + r]).round(r * 0.15));
}

pub(super) fn bowl(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#b9ab94", Ceramic);
    let (w, h, d) = (m.w, m.h, m.d);
    let fruit = p.filled.unwrap_or(h > w * 0.42);
    let rim = if fruit { h * 0.7 } else { h };
    m.add(Piece::new(Shape::Lathe, "body", [0.0, w], [0.0, rim], [0.0, d]).oval().hollow(0.05).points(&[
        [0.4, 0.0],
        [0.42, 0.08],
        [0.72, 0.3],
        [0.93, 0.7],
        [1.0, 1.0],
    ]));
    if fruit {
        m.slot("fruit", "#c8642f", Other);
        let r = w.min(d) * 0.17;
        let (cx, cz) = (w / 2.0, d / 2.0);
        let top = h - r;
        let mut ball = |x: f64, y: f64, z: f64| {
            m.add(Piece::new(Shape::Sphere, "fruit", [x - r, x + r], [y - r, y + r], [z - r, z + r]));
        };
        for k in 0..4 {
            let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_2 + 0.4).sin_cos();
            ball(cx + cos * r * 1.45, top - r * 0.75, cz + sin * r * 1.45);
        }
        ball(cx, top, cz);
    }
}

pub(super) fn plate(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#ece8e0", Ceramic);
    let (w, h, d) = (m.w, m.h, m.d);
    m.add(Piece::new(Shape::Lathe, "body", [0.0, w], [0.0, h], [0.0, d]).oval().hollow(0.04).points(&[
        [0.5, 0.0],
        [0.62, 0.15],
        [0.9, 0.75],
        [1.0, 1.0],
    ]));
}

pub(super) fn cup(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#e6e1d6", Ceramic);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let r = (w * 0.78).min(d);
    let z = [(d - r) / 2.0, f64::midpoint(d, r)];
    m.add(Piece::new(Shape::Lathe, "body", [0.0, r], [0.0, h], z).hollow(0.08).points(&[
        [0.8, 0.0],
        [0.9, 0.04],
        [0.97, 0.4],
        [1.0, 1.0],
    ]));
    if w > r * 1.05 {
        let ear =
            Piece::new(Shape::Tube, "body", [r * 0.93, w], [h * 0.2, h * 0.82], [d / 2.0 - 0.005, d / 2.0 + 0.005]);
        m.add(ear.thick(s * 0.11, s).smooth(true).path(&[
            [0.0, 1.0, 0.5],
            [0.75, 0.95, 0.5],
            [1.0, 0.6, 0.5],
            [0.7, 0.1, 0.5],
            [0.0, 0.0, 0.5],
        ]));
    }
}

pub(super) fn carton(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#b08d62", Paper);
    let (w, h, d) = (m.w, m.h, m.d);
    m.add(Piece::new(Shape::Box, "body", [0.0, w], [0.0, h], [0.0, d]).round(0.004_f64.min(h * 0.05)));
    if h > 0.06 {
        let seam = 0.0012;
        m.cube("body", [0.0, w], [h - seam, h], [d * 0.5 - 0.02, d * 0.5 + 0.02]);
    }
}

pub(super) fn basket(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#b38f5f", Rattan);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let round = p.round.unwrap_or((w - d).abs() < 0.15 * w);
    if round {
        m.add(Piece::new(Shape::Lathe, "body", [0.0, w], [0.0, h * 0.97], [0.0, d]).oval().hollow(0.06).points(&[
            [0.74, 0.0],
            [0.8, 0.05],
            [0.93, 0.45],
            [0.97, 1.0],
        ]));
    } else {
        let t = 0.012_f64.min(w * 0.08).min(d * 0.08);
        m.add(Piece::new(Shape::Box, "body", [0.0, w], [0.0, h * 0.97], [0.0, t]).round(t * 0.4).mirror(Mirror::Z));
        m.add(Piece::new(Shape::Box, "body", [0.0, t], [0.0, h * 0.97], [0.0, d]).round(t * 0.4).mirror(Mirror::X));
        m.cube("body", [t * 0.5, w - t * 0.5], [0.0, t], [t * 0.5, d - t * 0.5]);
    }
    let rings = ((h / 0.05).round() as u32).clamp(2, 8);
    if round {
        let step = h * 0.94 / f64::from(rings);
        for k in 0..rings {
            let y = step * (f64::from(k) + 0.6);
            let grow = 0.80 + 0.17 * (y / h).sqrt();
            let (rx, rz) = (w / 2.0 * (grow + 0.03).min(1.0), d / 2.0 * (grow + 0.03).min(1.0));
            let ring = Piece::new(
                Shape::Cylinder,
                "body",
                [w / 2.0 - rx, w / 2.0 + rx],
                [y, y + step * 0.5],
                [d / 2.0 - rz, d / 2.0 + rz],
            );
            m.add(ring.oval().hollow(0.1));
        }
    }
    let ear = w * 0.2;
    let handle =
        Piece::new(Shape::Tube, "body", [0.0, w * 0.03], [h * 0.8, h], [d / 2.0 - ear / 2.0, d / 2.0 + ear / 2.0]);
    m.add(
        handle
            .thick(s * 0.035, s)
            .smooth(true)
            .path(&[[0.5, 0.0, 0.0], [0.5, 0.9, 0.1], [0.5, 1.0, 0.5], [0.5, 0.9, 0.9], [0.5, 0.0, 1.0]])
            .mirror(Mirror::X),
    );
}

pub(super) fn trash_bin(m: &mut Maker, p: &TemplateParams) {
    m.slot("body", "#6f7376", Metal);
    let (w, h, d) = (m.w, m.h, m.d);
    let lid = p.extra.unwrap_or(h > 0.45);
    let top = if lid { h * 0.9 } else { h };
    if p.round == Some(false) || (w - d).abs() > 0.25 * w {
        m.add(
            Piece::new(Shape::Cylinder, "body", [0.0, w], [0.0, top], [0.0, d]).sides(4).oval().hollow(0.06).top(1.15),
        );
    } else {
        m.add(Piece::new(Shape::Cylinder, "body", [0.0, w], [0.0, top], [0.0, d]).oval().hollow(0.05).top(1.12));
    }
    m.add(Piece::new(Shape::Cylinder, "body", [w * 0.07, w * 0.93], [0.0, h * 0.03], [d * 0.07, d * 0.93]).oval());
    if lid {
        m.slot("lid", "#55585a", Plastic);
        m.add(Piece::new(Shape::Lathe, "lid", [0.0, w], [top * 0.99, h], [0.0, d]).oval().points(&[
            [1.0, 0.0],
            [0.96, 0.4],
            [0.6, 0.85],
            [0.0, 1.0],
        ]));
    }
}

/// A soft toy bear, sitting.
pub(super) fn teddy_bear(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#a97c50", Fabric);
    m.slot("nose", "#2a211c", Plastic);
    m.slot("muzzle", "#cfae84", Fabric);
    let (w, h, d) = (m.w, m.h, m.d);
    let mut ball = |slot: &str, c: [f64; 3], r: [f64; 3], both: bool| {
        let piece = Piece::new(
            Shape::Sphere,
            slot,
            [(c[0] - r[0]) * w, (c[0] + r[0]) * w],
            [(c[1] - r[1]) * h, (c[1] + r[1]) * h],
            [(c[2] - r[2]) * d, (c[2] + r[2]) * d],
        );
        m.add(if both { piece.mirror(Mirror::X) } else { piece });
    };
    ball("body", [0.5, 0.32, 0.42], [0.3, 0.3, 0.38], false);
    ball("muzzle", [0.5, 0.33, 0.58], [0.2, 0.2, 0.26], false);
    ball("body", [0.5, 0.74, 0.46], [0.28, 0.22, 0.36], false);
    ball("body", [0.24, 0.92, 0.44], [0.1, 0.08, 0.1], true);
    ball("muzzle", [0.5, 0.69, 0.74], [0.13, 0.09, 0.14], false);
    ball("nose", [0.5, 0.73, 0.87], [0.045, 0.03, 0.05], false);
    ball("nose", [0.4, 0.79, 0.78], [0.025, 0.022, 0.03], true);
    ball("body", [0.14, 0.42, 0.5], [0.14, 0.2, 0.2], true);
    ball("body", [0.24, 0.1, 0.78], [0.16, 0.1, 0.24], true);
    ball("muzzle", [0.24, 0.1, 0.97], [0.1, 0.075, 0.04], true);
}

/// A figure or sculpture on a foot.
pub(super) fn figurine(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#b8b0a2", Ceramic);
    let (w, h, d) = (m.w, m.h, m.d);
    m.add(Piece::new(Shape::Box, "body", [w * 0.1, w * 0.9], [0.0, h * 0.1], [d * 0.1, d * 0.9]).round(0.004));
    m.add(
        Piece::new(Shape::Lathe, "body", [w * 0.08, w * 0.92], [h * 0.1, h * 0.76], [d * 0.08, d * 0.92])
            .oval()
            .points(&[[0.62, 0.0], [0.55, 0.2], [0.6, 0.42], [0.8, 0.7], [0.95, 0.86], [0.5, 0.96], [0.26, 1.0]]),
    );
    let r = w.min(d) * 0.25;
    m.add(Piece::new(Shape::Sphere, "body", [w / 2.0 - r, w / 2.0 + r], [h * 0.73, h], [d / 2.0 - r, d / 2.0 + r]));
}

pub(super) fn suitcase(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#5b6670", Plastic);
    m.slot("handle", "#2a2a2c", Metal);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let top = h * 0.92;
    m.add(Piece::new(Shape::Box, "body", [0.0, w], [h * 0.03, top], [0.0, d]).round(0.04_f64.min(d * 0.3)));
    let rib = Piece::new(Shape::Box, "body", [w * 0.14, w * 0.18], [h * 0.1, top - h * 0.06], [d - 0.002, d + 0.004]);
    m.row(rib, Axis::X, 5, w * 0.17);
    let grip = Piece::new(Shape::Tube, "handle", [w * 0.33, w * 0.67], [top - 0.01, h], [d * 0.45, d * 0.55]);
    m.add(grip.thick(s * 0.08, s).path(&[[0.0, 0.0, 0.5], [0.0, 1.0, 0.5], [1.0, 1.0, 0.5], [1.0, 0.0, 0.5]]));
    let r = h * 0.03;
    m.add(
        Piece::new(Shape::Cylinder, "handle", [w * 0.08, w * 0.08 + r], [0.0, r * 2.0], [d * 0.1, d * 0.1 + r * 2.0])
            .axis(Axis::X)
            .mirror(Mirror::Xz),
    );
}

/// A potted plant; the pot takes the lower part.
pub(super) fn plant(m: &mut Maker, p: &TemplateParams) {
    m.slot("leaves", "#55773f", Other);
    m.slot("pot", "#b9a184", Ceramic);
    m.slot("soil", "#3b2d23", Other);
    let (w, h, d, s) = (m.w, m.h, m.d, m.smallest);
    let habit = p.habit.unwrap_or(if h > 1.15 { PlantHabit::Tree } else { PlantHabit::Bushy });
    let (cx, cz) = (w / 2.0, d / 2.0);
    let share = match habit {
        PlantHabit::Tree => 0.2,
        PlantHabit::Palm => 0.22,
        PlantHabit::Upright => 0.3,
        PlantHabit::Cactus => 0.32,
        PlantHabit::Trailing => 0.4,
        PlantHabit::Bushy | PlantHabit::Flowers => 0.36,
    };
    let pot = (h * share).min(0.42);
    let hanging = habit == PlantHabit::Trailing;
    let r = (pot * 0.56).min(w.min(d) * if hanging { 0.3 } else { 0.4 });
    let low = if hanging { h * 0.3 } else { 0.0 };
    let (px, pz) = ([cx - r, cx + r], [cz - r, cz + r]);
    let pot_top = low + pot;
    if p.round == Some(false) {
        m.add(Piece::new(Shape::Cylinder, "pot", px, [low, pot_top], pz).sides(4).hollow(0.1).top(1.2));
    } else {
        m.add(Piece::new(Shape::Lathe, "pot", px, [low, pot_top], pz).hollow(0.08).smooth(false).points(&[
            [0.7, 0.0],
            [0.74, 0.03],
            [0.94, 0.86],
            [1.0, 0.87],
            [1.0, 1.0],
        ]));
    }
    let soil = r * 0.9;
    m.add(Piece::new(
        Shape::Cylinder,
        "soil",
        [cx - soil, cx + soil],
        [pot_top - pot * 0.2, pot_top - pot * 0.1],
        [cz - soil, cz + soil],
    ));
    let ground = pot_top - pot * 0.12;
    let leaves = |y: Span| Piece::new(Shape::Leaves, "leaves", [0.0, w], y, [0.0, d]);
    match habit {
        PlantHabit::Bushy => m.add(leaves([ground, h]).leaves(LeafHabit::Bushy, 130, 0.34).seed(7)),
        PlantHabit::Flowers => {
            m.slot("flowers", "#d98fa0", Other);
            m.add(leaves([ground, h * 0.86]).leaves(LeafHabit::Bushy, 80, 0.36).seed(7));
            let top = Piece::new(
                Shape::Leaves,
                "flowers",
                [w * 0.08, w * 0.92],
                [ground + (h - ground) * 0.35, h],
                [d * 0.08, d * 0.92],
            );
            m.add(top.leaves(LeafHabit::Flowers, 12, 0.3).seed(9));
        }
        PlantHabit::Palm => m.add(leaves([ground, h]).leaves(LeafHabit::Palm, 12, 0.42).seed(2)),
        PlantHabit::Upright => {
            let half = r * 1.1;
            let box_x = [(cx - half).max(0.0), (cx + half).min(w)];
            let box_z = [(cz - half).max(0.0), (cz + half).min(d)];
            let narrow = Piece::new(Shape::Leaves, "leaves", box_x, [ground, h], box_z);
            let wide = w.min(d) > half * 2.6;
            m.add(if wide { leaves([ground, h]) } else { narrow }.leaves(LeafHabit::Upright, 14, 0.2).seed(4));
        }
        PlantHabit::Trailing => {
            m.add(leaves([0.0, h]).leaves(LeafHabit::Trailing, 110, 0.2).seed(6));
            let crown = Piece::new(
                Shape::Leaves,
                "leaves",
                [cx - r * 1.4, cx + r * 1.4],
                [ground, h],
                [cz - r * 1.4, cz + r * 1.4],
            );
            m.add(crown.leaves(LeafHabit::Bushy, 40, 0.4).seed(3));
        }
        PlantHabit::Tree => {
            m.slot("trunk", "#6b503a", Wood);
            let crown = ground + (h - ground) * 0.36;
            let t = (w * 0.05).clamp(0.012, 0.05);
            let trunk = Piece::new(
                Shape::Tube,
                "trunk",
                [cx - t * 1.6, cx + t * 1.6],
                [ground - 0.02, h * 0.8],
                [cz - t, cz + t],
            );
            m.add(trunk.thick(t, s).smooth(true).path(&[
                [0.5, 0.0, 0.5],
                [0.25, 0.35, 0.6],
                [0.7, 0.7, 0.4],
                [0.5, 1.0, 0.5],
            ]));
            m.add(leaves([crown, h]).leaves(LeafHabit::Bushy, 150, 0.3).seed(8));
        }
        PlantHabit::Cactus => {
            let body = (w.min(d) * 0.24).min(r * 0.8);
            let column = |m: &mut Maker, x: f64, y: Span, r: f64| {
                let piece = Piece::new(Shape::Lathe, "leaves", [x - r, x + r], y, [cz - r, cz + r]);
                m.add(piece.points(&[[0.8, 0.0], [0.95, 0.15], [1.0, 0.5], [0.97, 0.8], [0.7, 0.95], [0.0, 1.0]]));
            };
            column(m, cx, [ground, h], body);
            let reach = (w / 2.0 - body * 0.6).max(body * 1.2);
            for (side, at, top) in [(-1.0, 0.4, 0.78), (1.0, 0.5, 0.9)] {
                let x = cx + side * reach.min(w / 2.0 - body * 0.55);
                let y = ground + (h - ground) * at;
                let elbow = Piece::new(
                    Shape::Tube,
                    "leaves",
                    [cx.min(x), cx.max(x)],
                    [y, y + body * 1.6],
                    [cz - body * 0.5, cz + body * 0.5],
                );
                let path = if side > 0.0 {
                    [[0.0, 0.2, 0.5], [0.85, 0.2, 0.5], [1.0, 1.0, 0.5]]
                } else {
                    [[1.0, 0.2, 0.5], [0.15, 0.2, 0.5], [0.0, 1.0, 0.5]]
                };
                m.add(elbow.thick(body, s).path(&path));
                column(m, x, [y + body * 0.4, ground + (h - ground) * top], body * 0.55);
            }
        }
    }
}

/// A guitar, standing.
pub(super) fn guitar(m: &mut Maker, _p: &TemplateParams) {
    m.slot("body", "#b5793f", Wood);
    m.slot("neck", "#3a281c", Wood);
    let (w, h, d) = (m.w, m.h, m.d);
    let body = h * 0.48;
    m.add(Piece::new(Shape::Extrude, "body", [0.0, w], [0.0, body], [0.0, d * 0.85]).smooth(true).points(&[
        [0.5, 0.0],
        [0.85, 0.06],
        [1.0, 0.3],
        [0.8, 0.56],
        [0.88, 0.82],
        [0.66, 1.0],
        [0.34, 1.0],
        [0.12, 0.82],
        [0.2, 0.56],
        [0.0, 0.3],
        [0.15, 0.06],
    ]));
    let (cx, r) = (w / 2.0, w * 0.13);
    m.add(
        Piece::new(Shape::Cylinder, "neck", [cx - r, cx + r], [body * 0.62 - r, body * 0.62 + r], [d * 0.8, d * 0.87])
            .axis(Axis::Z),
    );
    let t = w * 0.07;
    m.cube("neck", [cx - t, cx + t], [body * 0.7, h * 0.9], [d * 0.7, d]);
    m.cube("neck", [cx - t * 1.5, cx + t * 1.5], [h * 0.88, h], [d * 0.68, d * 0.9]);
    m.cube("neck", [cx - w * 0.16, cx + w * 0.16], [body * 0.24, body * 0.29], [d * 0.82, d * 0.92]);
}
