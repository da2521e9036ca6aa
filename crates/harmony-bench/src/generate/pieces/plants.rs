//! Plants in pots.

use glam::Vec3;

use super::{Origin, Piece, Sculptor};
use crate::generate::dice::Dice;
use crate::generate::paint::{Look, Palette, Rgb};
use crate::generate::solid::{lathe, leaf, pillow, tube};

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

const GREENS: [Rgb; 5] = [[64, 104, 56], [88, 124, 66], [50, 84, 52], [112, 136, 82], [76, 112, 88]];

fn pot(s: &mut Sculptor, d: &mut Dice, p: &Palette, r: f32, h: f32) {
    let glaze = p.glaze(d);
    let look = s.look(Look::plain("pot", glaze, 0.4));
    let soil = s.look(Look::plain("soil", [62, 46, 36], 0.95));
    let (foot, belly) = (r * d.f(0.6, 0.95), r * d.f(0.9, 1.2));
    let profile = [(foot, 0.0), (belly, h * 0.45), (r, h), (r * 0.88, h), (r * 0.86, h * 0.86), (r * 0.1, h * 0.85)];
    s.add(look, lathe(&profile, 24, if d.chance(0.25) { (0.03, 10.0) } else { (0.0, 1.0) }));
    s.add(soil, lathe(&[(r * 0.5, h * 0.84), (r * 0.87, h * 0.87), (r * 0.4, h * 0.89)], 16, (0.0, 1.0)));
}

/// Leaves and stems above `base`, `h` high, spreading to `r`.
fn foliage(s: &mut Sculptor, d: &mut Dice, base: f32, h: f32, r: f32) {
    let greens: Vec<usize> = (0..2).map(|_| s.look(Look::plain("leaf", d.pick(&GREENS), 0.6))).collect();
    let bark = s.look(Look::plain("bark", [104, 84, 60], 0.9));
    let kind = d.int(0, 3);
    match kind {
        // Upright blades.
        0 => {
            for i in 0..d.int(9, 16) {
                let a = i as f32 * 2.4;
                let out = d.f(0.02, 0.35);
                let look = d.pick(&greens);
                let stem = v(a.cos() * r * 0.15, base, a.sin() * r * 0.15);
                s.add(look, leaf(stem, v(a.cos() * out, 1.0, a.sin() * out), h * d.f(0.6, 1.0), h * 0.09, 0.02));
            }
        }
        // A rosette of drooping leaves on stalks.
        1 => {
            for i in 0..d.int(12, 20) {
                let a = i as f32 * 2.4;
                let up = d.f(0.5, 1.6);
                let stem = v(0.0, base, 0.0);
                let tip = v(a.cos() * r * 0.5, base + h * 0.3 * up, a.sin() * r * 0.5);
                s.add(bark, tube(&[stem, stem.lerp(tip, 0.6) + v(0.0, 0.03, 0.0), tip], &[0.006, 0.004], 5));
                let look = d.pick(&greens);
                s.add(look, leaf(tip, v(a.cos(), 0.6 * up, a.sin()), r * 0.62, r * d.f(0.3, 0.5), 0.35));
            }
        }
        // A little tree.
        2 => {
            let lean = d.f(-0.06, 0.06);
            let crown = v(lean, base + h * 0.55, lean * 0.6);
            s.add(
                bark,
                tube(&[v(0.0, base - 0.02, 0.0), v(-lean, base + h * 0.3, 0.0), crown], &[0.02, 0.016, 0.011], 7),
            );
            for i in 0..d.int(60, 85) {
                let a = i as f32 * 2.399;
                let y = d.f(-1.0, 1.0);
                let q = (1.0 - y * y).sqrt();
                let direction = v(a.cos() * q, y * 0.8 + 0.3, a.sin() * q);
                let look = d.pick(&greens);
                let stem = crown + direction * (r * d.f(0.15, 0.55)) * v(1.0, h * 0.4 / r, 1.0);
                s.add(look, leaf(stem, direction, r * d.f(0.3, 0.42), r * 0.16, 0.2));
            }
        }
        // Fat lobes, as of a cactus.
        _ => {
            let lobes = |d: &mut Dice| d.int(7, 11) as f32;
            let column = |rad: f32, high: f32, d: &mut Dice| {
                let profile = [
                    (rad * 0.7, 0.0),
                    (rad, high * 0.2),
                    (rad * 1.05, high * 0.6),
                    (rad * 0.8, high * 0.88),
                    (rad * 0.3, high),
                ];
                lathe(&profile, 36, (0.09, lobes(d)))
            };
            let main = column(r * 0.3, h, d);
            s.add(greens[0], main.moved(0.0, base - 0.01, 0.0));
            for x in [-1.0_f32, 1.0] {
                let (y, high) = (base + h * d.f(0.3, 0.5), h * d.f(0.25, 0.4));
                let arm = [
                    v(0.0, y, 0.0),
                    v(x * r * 0.5, y + 0.02, 0.0),
                    v(x * r * 0.62, y + high * 0.3, 0.0),
                    v(x * r * 0.62, y + high, 0.0),
                ];
                s.add(greens[1], tube(&arm, &[r * 0.12, r * 0.14, r * 0.13, r * 0.06], 10));
            }
            if d.chance(0.5) {
                let flower = s.look(Look::plain("flower", [220, 110, 130], 0.7));
                s.add(flower, pillow(v(r * 0.12, r * 0.08, r * 0.12), 1.0, 1.0, 8, 6).moved(0.0, base + h, 0.0));
            }
        }
    }
}

/// A plant that stands on the floor.
pub(in super::super) fn plant(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let (r, h) = (d.f(0.12, 0.2), d.f(0.22, 0.4));
    pot(&mut s, d, p, r, h);
    let (tall, wide) = (d.f(0.45, 1.0), d.f(0.26, 0.42));
    foliage(&mut s, d, h * 0.86, tall, wide);
    s.finish("potted plant", Origin::Bottom)
}

/// A plant for a table or a shelf.
pub(in super::super) fn small_plant(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let (r, h) = (d.f(0.045, 0.075), d.f(0.08, 0.13));
    pot(&mut s, d, p, r, h);
    let (tall, wide) = (d.f(0.12, 0.26), d.f(0.08, 0.14));
    foliage(&mut s, d, h * 0.86, tall, wide);
    s.finish("plant", Origin::Bottom)
}
