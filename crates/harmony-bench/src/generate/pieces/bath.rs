//! Bathroom and kitchen fixtures.

use glam::Vec3;

use super::{Origin, Piece, Sculptor};
use crate::generate::dice::Dice;
use crate::generate::paint::{Look, Palette};
use crate::generate::solid::{block, lathe, oval, pillow, rod, skin, tube};

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// A toilet with its tank at -Z.
pub(in super::super) fn toilet(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let white = s.look(Look::gloss("ceramic", [238, 238, 234]));
    let metal = s.look(Look::metal(p.metal));
    let (w, h) = (d.f(0.35, 0.4), d.f(0.38, 0.43));
    let ring = |y: f32, k: f32, z: f32| -> Vec<Vec3> {
        oval(w / 2.0 * k, 0.26 * k, 2.3, y, 24).into_iter().map(|q| q + v(0.0, 0.0, z)).collect()
    };
    let bowl = [
        ring(0.0, 0.62, -0.04),
        ring(0.1, 0.55, -0.05),
        ring(h * 0.6, 0.8, 0.0),
        ring(h - 0.04, 1.0, 0.02),
        ring(h - 0.02, 1.0, 0.02),
    ];
    s.add(white, skin(&bowl));
    s.add(white, skin(&[ring(h - 0.022, 1.02, 0.02), ring(h, 1.03, 0.02), ring(h + 0.015, 0.98, 0.015)]));
    s.add(white, block(w * 0.98, d.f(0.3, 0.38), 0.17, 0.03).moved(0.0, h - 0.06, -0.3));
    s.add(white, block(w, 0.03, 0.19, 0.012).moved(0.0, h + 0.27, -0.3));
    s.add(metal, pillow(v(0.025, 0.012, 0.018), 1.0, 1.0, 10, 6).moved(0.06, h + 0.33, -0.3));
    s.finish("toilet", Origin::Bottom)
}

/// A washbasin on a column.
pub(in super::super) fn washbasin(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let white = s.look(Look::gloss("ceramic", [238, 238, 234]));
    let metal = s.look(Look::metal(p.metal));
    let (w, b, h, power) = (d.f(0.5, 0.64), d.f(0.4, 0.48), d.f(0.8, 0.86), d.f(2.6, 5.0));
    s.add(
        white,
        lathe(&[(0.11, 0.0), (0.1, 0.05), (0.075, h * 0.5), (0.11, h - 0.14)], 20, (0.0, 1.0)).moved(0.0, 0.0, -0.06),
    );
    let ring = |y: f32, k: f32| oval(w / 2.0 * k, b / 2.0 * k, power, y, 32);
    let basin = [
        ring(h - 0.18, 0.45),
        ring(h - 0.1, 0.8),
        ring(h - 0.04, 1.0),
        ring(h, 1.0),
        ring(h, 0.86),
        ring(h - 0.06, 0.74),
        ring(h - 0.11, 0.4),
    ];
    s.add(white, skin(&basin));
    let tap = [
        v(0.0, h - 0.01, -b * 0.44),
        v(0.0, h + 0.12, -b * 0.44),
        v(0.0, h + 0.14, -b * 0.36),
        v(0.0, h + 0.1, -b * 0.22),
    ];
    s.add(metal, tube(&tap, &[0.016, 0.013, 0.011], 8));
    s.add(metal, rod(v(0.0, h + 0.11, -b * 0.44), v(0.06, h + 0.15, -b * 0.44), 0.008, 0.006, 6));
    s.finish("washbasin", Origin::Bottom)
}

/// A tub of `w` by 0.75 metres.
pub(in super::super) fn bathtub(d: &mut Dice, p: &Palette, w: f32) -> Piece {
    let mut s = Sculptor::new();
    let white = s.look(Look::gloss("ceramic", [240, 240, 238]));
    let metal = s.look(Look::metal(p.metal));
    let (h, b, power) = (d.f(0.52, 0.6), d.f(0.7, 0.78), d.f(2.6, 8.0));
    let foot = 0.07;
    let ring = |y: f32, k: f32, e: f32| oval(w / 2.0 * k, b / 2.0 * (k - e), power, y, 36);
    let tub = [
        ring(foot, 0.7, 0.0),
        ring(foot + 0.1, 0.84, 0.0),
        ring(h - 0.05, 0.96, 0.0),
        ring(h - 0.02, 1.0, 0.0),
        ring(h, 0.99, 0.0),
        ring(h - 0.01, 0.94, 0.04),
        ring(h * 0.5, 0.84, 0.06),
        ring(foot + 0.08, 0.66, 0.06),
    ];
    s.add(white, skin(&tub));
    for (x, z) in [(-1.0_f32, 1.0_f32), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)] {
        s.add(metal, pillow(v(0.04, 0.06, 0.04), 1.0, 1.0, 10, 6).moved(x * w * 0.28, 0.06, z * b * 0.22));
    }
    let side = d.sign() as f32;
    let spout =
        [v(side * w * 0.44, h - 0.02, 0.0), v(side * w * 0.44, h + 0.14, 0.0), v(side * w * 0.36, h + 0.14, 0.0)];
    s.add(metal, tube(&spout, &[0.018, 0.014], 8));
    s.finish("bathtub", Origin::Bottom)
}

/// A refrigerator with rounded doors.
pub(in super::super) fn fridge(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = if d.chance(0.6) { d.pick(&[[226, 226, 224], [160, 164, 168], [60, 62, 66]]) } else { p.glaze(d) };
    let body = s.look(Look::gloss("enamel", color));
    let metal = s.look(Look::metal(p.metal));
    let (w, h, b) = (d.f(0.56, 0.72), d.f(1.5, 1.9), d.f(0.58, 0.66));
    s.add(body, block(w, h, b - 0.07, 0.02).moved(0.0, 0.0, -0.035));
    let split = h * d.f(0.3, 0.66);
    for (y0, y1) in [(0.05, split - 0.006), (split + 0.006, h - 0.01)] {
        let bulge = |y: f32, k: f32| -> Vec<Vec3> {
            oval(w / 2.0 * k, 0.04 * k, 5.0, y, 24).into_iter().map(|q| q + v(0.0, 0.0, b / 2.0 - 0.045)).collect()
        };
        s.add(body, skin(&[bulge(y0, 0.97), bulge(y0 + 0.02, 1.0), bulge(y1 - 0.02, 1.0), bulge(y1, 0.97)]));
        let (x, mid) = (-w * 0.4, f32::midpoint(y0, y1));
        let long = (y1 - y0) * 0.22;
        let grip = [
            v(x, mid - long, b / 2.0 - 0.01),
            v(x, mid - long * 0.8, b / 2.0 + 0.03),
            v(x, mid + long * 0.8, b / 2.0 + 0.03),
            v(x, mid + long, b / 2.0 - 0.01),
        ];
        s.add(metal, tube(&grip, &[0.01], 8));
    }
    s.finish("refrigerator", Origin::Bottom)
}
