//! Lamps of all levels. Only shades of lit lamps glow.

use glam::Vec3;

use super::{Origin, Piece, Sculptor};
use crate::generate::dice::Dice;
use crate::generate::paint::{Look, Palette, Rgb};
use crate::generate::solid::{Patch, lathe, pillow, rod, sheet, tube};

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// A hollow shade: lower and upper radius, height, belly, lobes; its lower edge at y = 0.
fn shade(low: f32, high: f32, h: f32, belly: f32, lobes: (f32, f32)) -> Patch {
    let t = 0.006;
    let at = |k: f32| low + (high - low) * k + belly * (k * std::f32::consts::PI).sin();
    let mut profile: Vec<(f32, f32)> = (0..=6).map(|i| (at(i as f32 / 6.0), h * i as f32 / 6.0)).collect();
    profile.push((0.012, h));
    profile.push((0.012, h - t));
    profile.extend((0..=6).rev().map(|i| ((at(i as f32 / 6.0) - t).max(0.013), (h * i as f32 / 6.0).min(h - t))));
    profile.push((low - t, 0.0));
    // Ring-shaped: the first ring is met again.
    profile.push(profile[0]);
    ring_lathe(&profile, 28, lobes)
}

/// A surface of revolution whose profile is a loop.
fn ring_lathe(profile: &[(f32, f32)], n: u32, lobes: (f32, f32)) -> Patch {
    let mut patch = Patch::default();
    let rings = profile.len() as u32 - 1;
    for (r, y) in &profile[..rings as usize] {
        for i in 0..n {
            let angle = i as f32 / n as f32 * std::f32::consts::TAU;
            let r = r * (1.0 + lobes.0 * (angle * lobes.1).cos());
            patch.points.push(v(r * angle.cos(), *y, -r * angle.sin()));
        }
    }
    for k in 0..rings {
        for j in 0..n {
            let (a, b) = (k * n + j, k * n + (j + 1) % n);
            let (c, e) = ((k + 1) % rings * n + (j + 1) % n, (k + 1) % rings * n + j);
            patch.triangles.extend([[a, b, c], [a, c, e]]);
        }
    }
    patch
}

/// Whether it is lit, and its shade's look.
fn shade_look(d: &mut Dice, p: &Palette) -> (bool, Look) {
    let color: Rgb = if d.chance(0.6) { [232, 218, 192] } else { p.fabric(d) };
    let lit = d.chance(0.4);
    if lit {
        (true, Look::glow("shade", [255, 226, 176], d.f(0.75, 1.0)))
    } else {
        (false, Look::plain("shade", color, 0.9))
    }
}

fn shade_shape(d: &mut Dice, low: f32) -> Patch {
    let h = low * d.f(0.9, 1.5);
    let fluted = if d.chance(0.3) { (0.02, 14.0) } else { (0.0, 1.0) };
    shade(low, low * d.f(0.45, 0.95), h, low * d.f(-0.12, 0.15), fluted)
}

/// A lamp to stand on furniture, with a turned foot.
pub(in super::super) fn table_lamp(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let glaze = p.glaze(d);
    let foot = s.look(Look::gloss("foot", glaze));
    let metal = s.look(Look::metal(p.metal));
    let (lit, look) = shade_look(d, p);
    let look = s.look(look);
    let h = d.f(0.16, 0.28);
    let (a, b, c) = (d.f(0.045, 0.085), d.f(0.03, 0.1), d.f(0.012, 0.05));
    let profile = [(a, 0.0), (a * 1.05, 0.012), (b, h * 0.3), (b * d.f(0.6, 1.1), h * 0.55), (c, h * 0.85), (0.014, h)];
    s.add(foot, lathe(&profile, 24, if d.chance(0.3) { (0.05, 8.0) } else { (0.0, 1.0) }));
    let low = d.f(0.11, 0.16);
    let cover = shade_shape(d, low);
    let top = cover.bounds().1.y;
    s.add(metal, rod(v(0.0, h - 0.01, 0.0), v(0.0, h + 0.01 + top, 0.0), 0.006, 0.006, 6));
    s.add(look, cover.moved(0.0, h + 0.015, 0.0));
    if lit {
        s.lights();
    }
    s.finish("table lamp", Origin::Bottom)
}

/// A jointed lamp that leans over a desk.
pub(in super::super) fn desk_lamp(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let color = if d.chance(0.5) { p.metal } else { p.glaze(d) };
    let look = s.look(Look::gloss("lamp", color));
    s.add(look, lathe(&[(0.085, 0.0), (0.085, 0.012), (0.05, 0.024), (0.014, 0.03)], 20, (0.0, 1.0)));
    let (h, out) = (d.f(0.3, 0.42), d.f(0.12, 0.2));
    let elbow = v(0.0, h * 0.62, -0.05 - out * 0.3);
    let head = v(0.0, h, out * 0.6);
    s.add(look, tube(&[v(0.0, 0.02, 0.0), elbow * 0.6, elbow], &[0.008], 6));
    s.add(look, tube(&[elbow, elbow.lerp(head, 0.5), head], &[0.007], 6));
    let cone = lathe(&[(0.06, 0.0), (0.055, 0.03), (0.03, 0.07), (0.02, 0.09)], 18, (0.0, 1.0));
    s.add(look, cone.tilted(-0.5, 0.0, 0.0).moved(head.x, head.y - 0.06, head.z + 0.02));
    s.finish("desk lamp", Origin::Bottom)
}

/// A standing lamp: straight, tripod or arched.
pub(in super::super) fn floor_lamp(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let metal = s.look(Look::metal(p.metal));
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let (lit, look) = shade_look(d, p);
    let look = s.look(look);
    let h = d.f(1.15, 1.5);
    let low = d.f(0.15, 0.24);
    let cover = shade_shape(d, low);
    let top = cover.bounds().1.y;
    let mut at = v(0.0, h, 0.0);
    match d.int(0, 2) {
        0 => {
            s.add(metal, lathe(&[(0.14, 0.0), (0.14, 0.014), (0.05, 0.03), (0.016, 0.05)], 24, (0.0, 1.0)));
            s.add(metal, rod(v(0.0, 0.03, 0.0), v(0.0, h + top, 0.0), 0.013, 0.01, 8));
        }
        1 => {
            for i in 0..3 {
                let (sin, cos) = (0.5 + i as f32 * 2.094).sin_cos();
                let foot = v(cos * 0.26, 0.0, sin * 0.26);
                let path = [v(0.0, h - 0.03, 0.0), foot * 0.5 + v(0.0, h * 0.46, 0.0), foot + v(0.0, 0.012, 0.0)];
                s.add(wood, tube(&path, &[0.015, 0.017, 0.011], 8).warped(|q| v(q.x, q.y.max(0.0), q.z)));
            }
            s.add(metal, rod(v(0.0, h - 0.06, 0.0), v(0.0, h + top, 0.0), 0.016, 0.01, 8));
        }
        _ => {
            s.add(metal, lathe(&[(0.15, 0.0), (0.15, 0.02), (0.11, 0.035)], 24, (0.0, 1.0)));
            let path: Vec<Vec3> = (0..=14)
                .map(|i| {
                    let t = i as f32 / 14.0;
                    v(0.42 * t.powf(2.2), 0.03 + (h + 0.16) * (1.0 - (1.0 - t).powf(1.7)), 0.0)
                })
                .collect();
            at = v(0.42, h - 0.02, 0.0);
            s.add(metal, tube(&path, &[0.014, 0.01], 8));
            s.add(metal, rod(v(0.42, h + 0.19, 0.0), v(0.42, h + 0.02, 0.0), 0.007, 0.007, 6));
        }
    }
    s.add(look, cover.moved(at.x, at.y, at.z));
    if lit {
        s.lights();
    }
    s.finish("floor lamp", Origin::Bottom)
}

/// A lamp on a cord of which `drop` metres hang from the ceiling.
pub(in super::super) fn pendant(d: &mut Dice, p: &Palette, drop: f32) -> Piece {
    let mut s = Sculptor::new();
    let cord = s.look(Look::plain("cord", [40, 38, 38], 0.7));
    let (lit, look) = shade_look(d, p);
    let look = if !lit && d.chance(0.5) { Look::gloss("shade", p.glaze(d)) } else { look };
    let look = s.look(look);
    let r = d.f(0.14, 0.26);
    let cover = match d.int(0, 2) {
        0 => pillow(v(r, r * d.f(0.75, 1.1), r), 1.0, 1.0, 24, 14).moved(0.0, r, 0.0),
        1 => shade(r, 0.03, r * d.f(0.6, 1.2), r * d.f(0.15, 0.4), (0.0, 1.0)),
        _ => shade_shape(d, r),
    };
    let top = cover.bounds().1.y;
    s.add(look, cover);
    s.add(cord, rod(v(0.0, top - 0.01, 0.0), v(0.0, drop - 0.01, 0.0), 0.004, 0.004, 6));
    s.add(cord, lathe(&[(0.02, drop - 0.05), (0.05, drop - 0.02), (0.055, drop)], 16, (0.0, 1.0)));
    if lit {
        s.lights();
    }
    s.finish("pendant lamp", Origin::Bottom)
}

/// A flat lamp at the ceiling.
pub(in super::super) fn ceiling_lamp(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let metal = s.look(Look::metal(p.metal));
    let lit = d.chance(0.5);
    let look = if lit { Look::glow("shade", [255, 240, 214], 0.95) } else { Look::gloss("shade", [236, 232, 224]) };
    let look = s.look(look);
    let (r, h, lobes) = (d.f(0.15, 0.26), d.f(0.08, 0.14), d.int(5, 9) as f32);
    let k = if d.chance(0.4) { 0.05 } else { 0.0 };
    s.add(look, lathe(&[(r * 0.3, 0.0), (r * 0.7, h * 0.15), (r * 0.93, h * 0.5), (r, h * 0.85)], 36, (k, lobes)));
    s.add(metal, lathe(&[(r * 1.03, h * 0.83), (r * 1.05, h * 0.9), (r * 0.8, h)], 36, (k, lobes)));
    if lit {
        s.lights();
    }
    s.finish("ceiling lamp", Origin::Bottom)
}

/// Arms with small shades around a turned column.
pub(in super::super) fn chandelier(d: &mut Dice, p: &Palette, drop: f32) -> Piece {
    let mut s = Sculptor::new();
    let metal = s.look(Look::metal(p.metal));
    let (lit, look) = shade_look(d, p);
    let look = s.look(look);
    let body = [
        (0.01, 0.0),
        (0.035, 0.04),
        (0.02, 0.1),
        (0.05, 0.16),
        (0.015, 0.24),
        (0.008, drop - 0.04),
        (0.05, drop - 0.03),
        (0.06, drop),
    ];
    s.add(metal, lathe(&body, 16, (0.0, 1.0)));
    let (n, r) = (d.int(4, 6), d.f(0.22, 0.34));
    for i in 0..n {
        let (sin, cos) = (i as f32 / n as f32 * std::f32::consts::TAU).sin_cos();
        let at = |k: f32, y: f32| v(cos * k * r, y, sin * k * r);
        s.add(metal, tube(&[at(0.05, 0.15), at(0.4, 0.08), at(0.8, 0.1), at(1.0, 0.18)], &[0.009, 0.007], 6));
        let cup = lathe(&[(0.03, 0.0), (0.05, 0.03), (0.058, 0.08), (0.05, 0.12)], 12, (0.0, 1.0));
        s.add(look, cup.moved(cos * r, 0.17, sin * r));
    }
    if lit {
        s.lights();
    }
    s.finish("chandelier", Origin::Bottom)
}

/// A fan with twisted blades.
pub(in super::super) fn ceiling_fan(d: &mut Dice, p: &Palette) -> Piece {
    let mut s = Sculptor::new();
    let metal = s.look(Look::metal(p.metal));
    let color = p.wood(d);
    let wood = Look::wood(d, color);
    let wood = s.look(wood);
    let (n, r, drop) = (d.int(3, 5), d.f(0.45, 0.6), d.f(0.3, 0.4));
    let body =
        [(0.03, 0.0), (0.08, 0.03), (0.1, 0.08), (0.08, 0.13), (0.015, 0.16), (0.015, drop - 0.05), (0.06, drop)];
    s.add(metal, lathe(&body, 20, (0.0, 1.0)));
    let twist = d.f(0.15, 0.3);
    for i in 0..n {
        let blade = sheet(8, 2, 0.008, |a, b| {
            let w = (b - 0.5) * (0.1 + 0.05 * a) * (1.0 - 0.3 * a.powf(6.0));
            v(0.08 + (r - 0.08) * a, 0.09 + w * twist, w)
        });
        s.add(wood, blade.tilted(0.0, i as f32 / n as f32 * std::f32::consts::TAU, 0.0));
    }
    s.finish("ceiling fan", Origin::Bottom)
}
