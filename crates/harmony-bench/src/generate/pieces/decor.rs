//! Small things that stand on others, and odds and ends for the floor.

use glam::Vec3;

use super::{Origin, Piece, Sculptor};
use crate::generate::dice::Dice;
use crate::generate::paint::{Look, Palette, draw};
use crate::generate::pictures;
use crate::generate::solid::{block, brick, lathe, leaf, pillow, rod, sheet, slab, tapered, tube};

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// A vase of random profile, sometimes with twigs.
pub(in super::super) fn vase(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let glaze = p.glaze(d);
    let look = s.look(Look::gloss("glaze", glaze));
    let (h, r) = (d.f(0.14, 0.36), d.f(0.045, 0.1));
    let (foot, belly, neck, lip) = (r * d.f(0.5, 0.9), r, r * d.f(0.3, 0.75), r * d.f(0.4, 0.95));
    let at = d.f(0.25, 0.6);
    let outer = [
        (foot, 0.0),
        (foot * 1.02, 0.008),
        (f32::midpoint(foot, belly) * 1.08, h * at * 0.5),
        (belly, h * at),
        (f32::midpoint(belly, neck), h * (at + 0.88) / 2.0),
        (neck, h * 0.88),
        (lip, h),
    ];
    let mut profile = outer.to_vec();
    profile.extend(outer[3..].iter().rev().map(|(r, y)| ((r - 0.006).max(0.008), *y - 0.003)));
    let lobes = if d.chance(0.35) { (d.f(0.02, 0.06), d.int(5, 12) as f32) } else { (0.0, 1.0) };
    s.add(look, lathe(&profile, 28, lobes));
    if d.chance(0.35) {
        let twig = s.look(Look::plain("twig", [122, 128, 78], 0.9));
        let flower = p.fabric(d);
        let bloom = s.look(Look::plain("bloom", flower, 0.8));
        for i in 0..d.int(3, 6) {
            let a = i as f32 * 2.4 + d.f(0.0, 0.5);
            let tip = v(a.cos() * d.f(0.03, 0.12), h + d.f(0.12, 0.3), a.sin() * d.f(0.03, 0.12));
            s.add(twig, tube(&[v(0.0, h * 0.7, 0.0), v(tip.x * 0.3, h * 1.05, tip.z * 0.3), tip], &[0.003], 5));
            if d.chance(0.7) {
                s.add(bloom, pillow(Vec3::splat(d.f(0.015, 0.032)), 1.0, 1.0, 8, 6).moved(tip.x, tip.y, tip.z));
            } else {
                s.add(twig, leaf(tip, v(a.cos(), 1.0, a.sin()), 0.08, 0.03, 0.1));
            }
        }
    }
    s.finish("vase", Origin::Bottom)
}

/// A bowl, sometimes with fruit.
pub(in super::super) fn bowl(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let glaze = p.glaze(d);
    let look = s.look(Look::gloss("glaze", glaze));
    let (r, h) = (d.f(0.09, 0.17), d.f(0.05, 0.1));
    let profile = [
        (r * 0.42, 0.0),
        (r * 0.44, 0.008),
        (r * 0.74, h * 0.35),
        (r * 0.95, h * 0.75),
        (r, h),
        (r - 0.007, h),
        (r * 0.9 - 0.006, h * 0.75),
        (r * 0.66, h * 0.4),
        (r * 0.3, h * 0.2),
    ];
    s.add(look, lathe(&profile, 30, if d.chance(0.3) { (0.03, 9.0) } else { (0.0, 1.0) }));
    if d.chance(0.5) {
        let color = d.pick(&[[196, 62, 44], [226, 150, 52], [144, 168, 70], [214, 190, 80]]);
        let fruit = s.look(Look::plain("fruit", color, 0.5));
        for i in 0..d.int(3, 5) {
            let a = i as f32 * 1.5;
            let q = pillow(Vec3::splat(d.f(0.032, 0.04)), 1.0, 1.0, 12, 8);
            s.add(fruit, q.moved(a.cos() * r * 0.42, h * 0.72 + d.f(0.0, 0.01), a.sin() * r * 0.42));
        }
    }
    s.finish("bowl", Origin::Bottom)
}

/// A mug with a handle.
pub(in super::super) fn mug(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let glaze = p.glaze(d);
    let look = s.look(Look::gloss("glaze", glaze));
    let (r, h, k) = (d.f(0.036, 0.046), d.f(0.08, 0.11), d.f(0.8, 1.15));
    let profile = [
        (r * k * 0.9, 0.0),
        (r * k, 0.01),
        (r, h * 0.6),
        (r, h),
        (r - 0.004, h),
        (r * 0.85, h * 0.3),
        (r * 0.3, 0.012),
    ];
    s.add(look, lathe(&profile, 24, (0.0, 1.0)));
    let grip = [
        v(r * 0.96, h * 0.82, 0.0),
        v(r + 0.026, h * 0.75, 0.0),
        v(r + 0.03, h * 0.42, 0.0),
        v(r * 0.96, h * 0.25, 0.0),
    ];
    s.add(look, tube(&grip, &[0.006], 6));
    s.finish("mug", Origin::Bottom)
}

/// A plate with a rim.
pub(in super::super) fn plate(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let glaze = p.glaze(d);
    let look = s.look(Look::gloss("glaze", glaze));
    let r = d.f(0.1, 0.145);
    let profile =
        [(r * 0.55, 0.0), (r * 0.65, 0.006), (r, 0.02), (r * 0.99, 0.024), (r * 0.64, 0.012), (r * 0.2, 0.009)];
    s.add(look, lathe(&profile, 30, (0.0, 1.0)));
    s.finish("plate", Origin::Bottom)
}

/// A stack of books, each turned a little.
pub(in super::super) fn books(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let paper = s.look(Look::plain("paper", [232, 226, 210], 0.9));
    let mut y = 0.0;
    let n = d.int(2, 5);
    let (w, b) = (d.f(0.2, 0.27), d.f(0.15, 0.19));
    for i in 0..n {
        let color = if d.chance(0.5) { p.fabric(d) } else { p.glaze(d) };
        let cover = s.look(Look::plain("cover", color, 0.7));
        let (t, k, turn) = (d.f(0.016, 0.036), 1.0 - 0.06 * i as f32, d.f(-0.25, 0.25));
        for part in [0.0, t - 0.003] {
            s.add(cover, brick(w * k, 0.003, b * k).tilted(0.0, turn, 0.0).moved(0.0, y + part, 0.0));
        }
        let spine = brick(0.004, t, b * k).moved(-w * k / 2.0 - 0.001, 0.0, 0.0);
        s.add(cover, spine.tilted(0.0, turn, 0.0).moved(0.0, y, 0.0));
        s.add(paper, brick(w * k - 0.01, t - 0.004, b * k - 0.008).tilted(0.0, turn, 0.0).moved(0.0, y + 0.002, 0.0));
        y += t;
    }
    s.finish("books", Origin::Bottom)
}

/// A picture frame that leans on its strut.
pub(in super::super) fn photo_frame(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let image = s.look(Look::picture("picture", pictures::painting(d, p)));
    let (w, h) = (d.f(0.12, 0.2), d.f(0.15, 0.24));
    let lean = -0.2;
    s.add(wood, block(w, h, 0.016, 0.005).tilted(lean, 0.0, 0.0));
    s.add(image, brick(w - 0.03, h - 0.03, 0.006).moved(0.0, 0.015, 0.006).tilted(lean, 0.0, 0.0));
    s.add(wood, rod(v(0.0, h * 0.6, -h * 0.12), v(0.0, 0.005, -h * 0.42), 0.005, 0.005, 6));
    s.finish("photo frame", Origin::Bottom)
}

/// A candle in a holder.
pub(in super::super) fn candle(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let glaze = p.glaze(d);
    let dish = s.look(Look::gloss("glaze", glaze));
    let wax = s.look(Look::plain("wax", [238, 228, 204], 0.6));
    let (r, h) = (d.f(0.02, 0.04), d.f(0.06, 0.18));
    s.add(dish, lathe(&[(r * 1.3, 0.0), (r * 1.7, 0.012), (r * 1.6, 0.018), (r, 0.014)], 20, (0.0, 1.0)));
    s.add(wax, lathe(&[(r, 0.012), (r * 0.98, h), (r * 0.8, h + 0.004), (r * 0.2, h - 0.002)], 20, (0.0, 1.0)));
    s.add(dish, rod(v(0.0, h - 0.004, 0.0), v(0.002, h + 0.014, 0.0), 0.0015, 0.001, 5));
    s.finish("candle", Origin::Bottom)
}

/// A screen's picture: windows of text, or nothing.
fn screen(d: &mut Dice) -> Look {
    let (seed, on) = (d.number(), d.chance(0.4));
    let image = draw(96, 64, |a, b| {
        if !on {
            return [22, 24, 28];
        }
        let line = crate::generate::dice::hash_unit((b * 20.0) as u32, 1, seed);
        if a > 0.1 && a < 0.2 + 0.6 * line && (b * 20.0).fract() < 0.5 { [70, 84, 104] } else { [204, 214, 224] }
    });
    let mut look = Look::picture("screen", image);
    look.material.roughness = 0.15;
    look
}

/// A monitor, or a television when wide.
pub(in super::super) fn monitor(d: &mut Dice, label: &'static str, w: f32) -> Piece {
    let mut s = Sculptor::new();
    let shell = s.look(Look::plain("plastic", d.pick(&[[34, 34, 36], [60, 62, 66], [206, 206, 204]]), 0.35));
    let look = screen(d);
    let look = s.look(look);
    let (h, t) = (w * 0.58, d.f(0.02, 0.035));
    let lift = if label == "tv" { d.f(0.05, 0.08) } else { d.f(0.09, 0.15) };
    let bow = if d.chance(0.4) { 0.05 } else { 0.0 };
    let bend = |q: Vec3| v(q.x, q.y, q.z + bow * (q.x / w) * (q.x / w) * 4.0 * w * 0.3);
    s.add(shell, sheet(12, 2, t, |a, b| v((a - 0.5) * w, lift + b * h, 0.0)).warped(bend));
    let face = sheet(12, 2, 0.004, |a, b| v((a - 0.5) * (w - 0.03), lift + 0.018 + b * (h - 0.034), t / 2.0));
    s.add(look, face.warped(bend));
    s.add(shell, pillow(v(w * 0.25, h * 0.25, 0.03), 0.6, 0.6, 14, 8).moved(0.0, lift + h / 2.0, -0.02));
    if label == "tv" && d.chance(0.5) {
        for x in [-1.0_f32, 1.0] {
            s.add(shell, tapered([0.03, 0.22], [0.02, 0.03], lift + 0.04, 0.004).moved(x * w * 0.33, 0.0, 0.0));
        }
    } else {
        s.add(shell, tapered([0.1, 0.035], [0.05, 0.025], lift + h * 0.4, 0.006).moved(0.0, 0.006, -0.035));
        s.add(shell, slab(w * 0.36, 0.014, 0.17, d.f(2.0, 6.0), 24));
    }
    s.finish(label, Origin::Bottom)
}

/// A laptop, open.
pub(in super::super) fn laptop(d: &mut Dice) -> Piece {
    let mut s = Sculptor::new();
    let shell = s.look(Look::plain("aluminium", d.pick(&[[170, 172, 176], [60, 62, 66], [196, 190, 184]]), 0.35));
    let keys = s.look(Look::plain("keys", [40, 40, 44], 0.6));
    let look = screen(d);
    let look = s.look(look);
    let (w, b) = (d.f(0.3, 0.36), d.f(0.21, 0.25));
    s.add(shell, slab(w, 0.016, b, 14.0, 20));
    s.add(keys, brick(w * 0.86, 0.002, b * 0.46).moved(0.0, 0.0155, -b * 0.12));
    let lean = -d.f(0.15, 0.4);
    let lid = |patch: crate::generate::solid::Patch| patch.tilted(lean, 0.0, 0.0).moved(0.0, 0.014, -b / 2.0 + 0.004);
    s.add(shell, lid(block(w, b, 0.008, 0.003)));
    s.add(look, lid(brick(w - 0.02, b - 0.022, 0.004).moved(0.0, 0.012, 0.004)));
    s.finish("laptop", Origin::Bottom)
}

/// Pens in a cup.
pub(in super::super) fn pen_holder(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let glaze = p.glaze(d);
    let cup = s.look(Look::plain("cup", glaze, 0.5));
    let (r, h) = (d.f(0.032, 0.045), d.f(0.09, 0.12));
    s.add(cup, lathe(&[(r * 0.9, 0.0), (r, h), (r - 0.004, h), (r * 0.8, 0.01)], 20, (0.0, 1.0)));
    for i in 0..d.int(3, 6) {
        let color = p.glaze(d);
        let pen = s.look(Look::plain("pen", color, 0.4));
        let a = i as f32 * 1.9;
        let foot = v(a.cos() * r * 0.5, 0.012, a.sin() * r * 0.5);
        s.add(pen, rod(foot, v(-foot.x * 1.3, h + d.f(0.03, 0.07), -foot.z * 1.3), 0.004, 0.0035, 6));
    }
    s.finish("pen holder", Origin::Bottom)
}

/// A soft cushion lying down.
pub(in super::super) fn cushion(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = p.fabric(d);
    let cloth = Look::fabric(d, color);
    let cloth = s.look(cloth);
    let half = v(d.f(0.18, 0.25), d.f(0.06, 0.085), d.f(0.16, 0.22));
    s.add(cloth, pillow(half, 0.9, 0.6, 20, 10).lumpy(0.006, 9.0, 2.0));
    s.finish("cushion", Origin::Bottom)
}

/// A woven basket.
pub(in super::super) fn basket(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = p.woods[1].map(|c| 60 + c / 2);
    let look = Look::fabric(d, color);
    let look = s.look(look);
    let (r, h) = (d.f(0.15, 0.22), d.f(0.22, 0.38));
    let (a, b) = (d.f(0.75, 0.95), d.f(1.0, 1.15));
    let profile = [(r * a, 0.0), (r * b, h * 0.4), (r, h), (r - 0.015, h), (r * b - 0.02, h * 0.4), (r * 0.5, 0.02)];
    s.add(look, lathe(&profile, 36, (0.012, 18.0)));
    for x in [-1.0_f32, 1.0] {
        let grip = [v(x * r * 0.97, h - 0.02, -0.06), v(x * r * 1.05, h + 0.05, 0.0), v(x * r * 0.97, h - 0.02, 0.06)];
        s.add(look, tube(&grip, &[0.01], 6));
    }
    s.finish("basket", Origin::Bottom)
}

/// A bin for paper.
pub(in super::super) fn waste_bin(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let look = s.look(Look::plain("bin", if d.chance(0.5) { p.metal } else { p.fabrics[1] }, 0.5));
    let (r, h) = (d.f(0.11, 0.15), d.f(0.26, 0.36));
    s.add(
        look,
        lathe(&[(r * 0.75, 0.0), (r, h), (r * 1.04, h + 0.006), (r - 0.006, h), (r * 0.7, 0.01)], 28, (0.0, 1.0)),
    );
    s.finish("waste bin", Origin::Bottom)
}

/// A ball.
pub(in super::super) fn ball(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = p.fabric(d);
    let look = Look::fabric(d, color);
    let look = s.look(look);
    s.add(look, pillow(Vec3::splat(d.f(0.09, 0.13)), 1.0, 1.0, 24, 16));
    s.finish("ball", Origin::Bottom)
}

/// A rug, 11 mm thick.
pub(in super::super) fn rug(d: &mut Dice, p: &Palette, w: f32, depth: f32) -> Piece {
    let mut s = Sculptor::new();
    let look = s.look(Look::picture("rug", pictures::rug(d, p)));
    let power = d.pick(&[2.0, 30.0, 30.0, 30.0, 6.0]);
    s.add(look, slab(w, 0.011, depth, power, 40));
    s.finish("rug", Origin::Bottom)
}

/// A kettle or coffee machine for the kitchen.
pub(in super::super) fn kettle(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let metal = s.look(Look::metal(d.pick(&[[170, 172, 174], [50, 50, 54], [176, 60, 48]])));
    let dark = s.look(Look::plain("plastic", [40, 40, 42], 0.5));
    let _ = p;
    let (r, h) = (d.f(0.075, 0.095), d.f(0.18, 0.23));
    s.add(
        metal,
        lathe(&[(r, 0.0), (r * 1.02, 0.03), (r * 0.9, h * 0.6), (r * 0.62, h * 0.95), (r * 0.2, h)], 26, (0.0, 1.0)),
    );
    s.add(dark, pillow(v(0.015, 0.016, 0.015), 1.0, 1.0, 8, 6).moved(0.0, h + 0.01, 0.0));
    s.add(
        metal,
        tube(
            &[v(r * 0.8, h * 0.5, 0.0), v(r + 0.03, h * 0.75, 0.0), v(r + 0.055, h * 0.86, 0.0)],
            &[0.022, 0.014, 0.01],
            8,
        ),
    );
    let grip = [
        v(-r * 0.6, h * 0.92, 0.0),
        v(-r - 0.04, h * 0.9, 0.0),
        v(-r - 0.05, h * 0.4, 0.0),
        v(-r * 0.92, h * 0.2, 0.0),
    ];
    s.add(dark, tube(&grip, &[0.011], 6));
    s.finish("kettle", Origin::Bottom)
}
