//! Cloth and skins: weave, knit, terry, bouclé, pile, leather, rattan.

use super::Pattern;
use super::noise::{Cells, Noise, gauss, hash, lerp, smooth, unit};
use super::plan::{Palette, amount, length, tone_sigma, width};
use super::space::{Paint, Rgb, Sample, Space, mix, times};

use std::f64::consts::PI;

/// Which thread lies on top at a crossing: +1 the warp (along v), -1 the weft.
fn over(variant: &str, i: i64, j: i64) -> f64 {
    let up = match variant {
        "twill" | "denim" => (i + j).rem_euclid(4) < 2,
        "herringbone" => {
            let k = i.rem_euclid(12);
            let lean = if k < 6 { k } else { 11 - k };
            (lean + j).rem_euclid(4) < 2
        }
        "basket" | "panama" => (i.div_euclid(2) + j.div_euclid(2)).rem_euclid(2) == 0,
        "satin" => (i + 2 * j).rem_euclid(5) != 0,
        _ => (i + j).rem_euclid(2) == 0,
    };
    if up { 1.0 } else { -1.0 }
}

/// Threads over and under: warp along v, weft along u; variants `twill`, `basket`, `satin`, `herringbone`; colours: warp, weft.
pub(super) fn weave(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let warp = palette.main[0];
    let weft = palette.main.get(1).copied().unwrap_or(warp);
    let yarn = width(p).max(3.0 * space.px);
    // Whole repeats of every variant: 60 threads hold 2, 4, 5 and 12; smaller tiles what fits.
    let step = match p.variant.as_str() {
        "satin" => 5,
        "herringbone" => 12,
        _ => 4,
    };
    let nu = ((space.w / yarn / step as f64).round().max(1.0)) as i64 * step;
    let (nv, b) = space.down(yarn, step);
    let a = space.w / nu as f64;
    let variant = p.variant.clone();
    // A thread that is drawn wider than it is stands for several, whose differences average out: at full strength they would
    // be a plaid.
    let drawn = (width(p) / yarn).sqrt();
    let sigma = drawn * tone_sigma(p, 0.22);
    let slub = drawn * amount(p, 0.4);
    let thick_u = Noise::periodic(space, [yarn * 14.0, yarn], 81);
    let thick_v = Noise::periodic(space, [yarn, yarn * 14.0], 82);
    let fuzz = Noise::periodic(space, [(yarn * 0.4).max(1.6 * space.px); 2], 83);
    let drift = Noise::periodic(space, [yarn * 40.0, yarn * 40.0], 84);
    let wander = Noise::periodic(space, [yarn * 9.0, yarn * 9.0], 85);
    let seed = space.seed;
    let shows = space.shows(yarn * 1.4);
    Box::new(move |u, v| {
        let (du, dv) = (0.16 * yarn * slub * wander.at(u, v), 0.16 * yarn * slub * wander.at(v, u + 0.37 * yarn));
        let (x, y) = ((u + du) / a, (v + dv) / b);
        let (i, j) = (x.floor() as i64, y.floor() as i64);
        let (fx, fy) = (x - i as f64 - 0.5, y - j as f64 - 0.5);
        let side = |t: f64| if t < 0.0 { -1 } else { 1 };
        // Height of a thread between crossings goes over smoothly.
        let here = over(&variant, i, j);
        let ease = |t: f64| 0.5 - 0.5 * libm::cos(PI * t.abs());
        let e_warp = lerp(here, over(&variant, i, j + side(fy)), ease(fy));
        let e_weft = -lerp(here, over(&variant, i + side(fx), j), ease(fx));
        let (ti, tj) = (i.rem_euclid(nu), j.rem_euclid(nv));
        let (hi, hj) = (hash(seed, ti, -1), hash(seed, tj, -2));
        let w_warp = 1.0 + slub * (0.30 * thick_v.at(u, v) + 0.10 * gauss(hi, 1));
        let w_weft = 1.0 + slub * (0.30 * thick_u.at(u, v) + 0.10 * gauss(hj, 1));
        let round = |t: f64, w: f64| {
            let q = t / (0.54 * w);
            (1.0 - q * q).max(0.0).sqrt()
        };
        let h_warp = round(fx, w_warp) + 0.55 * e_warp - if fx.abs() > 0.54 * w_warp { 1.0 } else { 0.0 };
        let h_weft = round(fy, w_weft) + 0.55 * e_weft - if fy.abs() > 0.54 * w_weft { 1.0 } else { 0.0 };
        let top = smooth(-0.15, 0.15, h_warp - h_weft);
        let h = h_warp.max(h_weft);
        let tone_i = libm::exp(sigma * gauss(hi, 2) * 0.6);
        let tone_j = libm::exp(sigma * gauss(hj, 2) * 0.6);
        let color = mix(times(weft, tone_j), times(warp, tone_i), top);
        let f = fuzz.at(u, v);
        // Between threads less light gets out.
        let shade =
            lerp(1.0, lerp(0.62, 1.06, smooth(-0.3, 1.2, h)), shows) * (1.0 + 0.05 * f + 0.03 * drift.fbm(u, v, 2));
        Sample {
            height: 1000.0 * yarn * (0.20 * h * shows + 0.03 * f),
            color: times(color, shade),
            rough: 0.02 * f,
            cover: 1.0,
            id: hash(ti as u64, tj, 0),
        }
    })
}

/// Knitted stitches: two legs of a V a stitch, courses along u; `width`: a stitch; variant `rib`: every other wale sunk.
pub(super) fn knit(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let stitch = width(p);
    let (nu, a) = {
        let n = (space.w / stitch / 2.0).round().max(1.0) * 2.0;
        (n as i64, space.w / n)
    };
    let (nv, b) = space.down(stitch * 0.75, 1);
    let sigma = tone_sigma(p, 0.12);
    let rib = p.variant == "rib";
    let fuzz = Noise::periodic(space, [(stitch * 0.10).max(1.6 * space.px); 2], 86);
    let wander = Noise::periodic(space, [stitch * 3.0, stitch * 3.0], 87);
    let seed = space.seed;
    let slope = 0.30;
    Box::new(move |u, v| {
        let u2 = u + 0.07 * stitch * wander.at(u, v);
        let v2 = v + 0.07 * stitch * wander.at(v, u);
        let x = u2 / a;
        let i = x.floor();
        let fx = x - i - 0.5;
        let wale = (i as i64).rem_euclid(nu);
        // Image v is downwards: a V opens upwards, towards smaller v.
        let y = v2 / b;
        let mut best = (-1.0, 0_i64, 0.0, 0.0);
        for k in -1..=1_i64 {
            let j = y.floor() as i64 + k;
            // 0 at the stitch's lower point, 1 at its upper end, reaching into the next course.
            let t = (j as f64 + 1.0 - y + 0.0) / 1.45 + 0.16;
            if !(0.0..=1.0).contains(&t) {
                continue;
            }
            // Middle of the leg, in stitches from the wale's centre.
            let centre = 0.09 + slope * (t - 0.06) + 0.05 * libm::sin(PI * t);
            let r = 0.175 * (0.75 + 0.5 * libm::sin(PI * t).max(0.0));
            let lean = 0.86;
            let d = (fx.abs() - centre) * lean / r;
            if d.abs() >= 1.0 {
                continue;
            }
            // Legs rise from under the course below and go under the one above.
            let h = (1.0 - d * d).sqrt() * 0.8 + 0.55 * libm::sin(PI * (t * 0.9 + 0.1));
            if h > best.0 {
                best = (h, j, t, d);
            }
        }
        let (h, j, t, d) = best;
        let row = j.rem_euclid(nv);
        let id = hash(seed, wale, row);
        let f = fuzz.fbm(u, v, 2);
        // Two plies twisted about each other.
        let side = if fx < 0.0 { 1.0 } else { -1.0 };
        let ply = libm::cos((t * 5.0 + 0.5 * d * side) * 2.0 * PI);
        let sunk = if rib && wale % 2 == 1 { 0.55 } else { 0.0 };
        let deep = smooth(-0.2, 1.1, h - sunk);
        let tone = libm::exp(sigma * 0.5 * gauss(id, 1)) * lerp(0.45, 1.06, deep) * (1.0 + 0.05 * ply + 0.07 * f);
        Sample {
            height: 1000.0 * stitch * (0.17 * (h.max(-0.3) - sunk) + 0.012 * ply + 0.02 * f),
            color: times(palette.pick(hash(seed, row, 3)), tone),
            rough: 0.02 * f,
            cover: 1.0,
            id,
        }
    })
}

/// Loops of towelling: small jittered cells, each leaning its own way.
pub(super) fn terry(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let w = width(p).max(3.0 * space.px);
    let (loops, below) = (Cells::new(space, [w * 0.8, w], 0.9, 91), Cells::new(space, [w, w], 1.0, 92));
    let nap = Noise::periodic(space, [0.03, 0.03], 93);
    let fuzz = Noise::periodic(space, [(w * 0.2).max(1.6 * space.px); 2], 94);
    let sigma = tone_sigma(p, 0.15);
    Box::new(move |u, v| {
        let bump = |c: &Cells, u: f64, v: f64| {
            let n = c.at(u, v);
            let turn = unit(n.id, 5) * PI;
            let (s, co) = (libm::sin(turn), libm::cos(turn));
            let (x, y) = (n.to[0] * co + n.to[1] * s, n.to[1] * co - n.to[0] * s);
            // A loop lies as an arch: long one way, round the other.
            let q = f64::hypot(x * 0.85, y * 1.45);
            ((1.0 - q * q * 1.3).max(0.0).sqrt() * (0.75 + 0.5 * unit(n.id, 6)), n.id)
        };
        let (h1, id) = bump(&loops, u, v);
        let (h2, _) = bump(&below, u + 0.3 * w, v);
        let h = h1.max(0.75 * h2) + 0.25 * nap.fbm(u, v, 2);
        let f = fuzz.at(u, v);
        let tone = libm::exp(sigma * 0.5 * gauss(id, 1)) * lerp(0.55, 1.08, smooth(-0.1, 1.0, h)) * (1.0 + 0.05 * f);
        Sample {
            height: 1000.0 * w * (0.34 * h + 0.03 * f),
            color: times(palette.pick(id), tone),
            rough: 0.03 * f,
            cover: 1.0,
            id,
        }
    })
}

/// Curls of bouclé or sheepskin: rings of thick yarn on top of one another.
pub(super) fn boucle(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let w = width(p).max(5.0 * space.px);
    let layers = [
        (Cells::new(space, [w, w], 1.0, 101), 0.0),
        (Cells::new(space, [w * 1.15, w * 1.05], 1.0, 102), 0.22),
        (Cells::new(space, [w * 0.8, w * 0.85], 1.0, 103), -0.18),
    ];
    let warp = Noise::periodic(space, [w * 0.7, w * 0.7], 104);
    let lump = Noise::periodic(space, [w * 5.0, w * 5.0], 105);
    let fuzz = Noise::periodic(space, [(w * 0.09).max(1.6 * space.px); 2], 106);
    let sigma = tone_sigma(p, 0.18);
    Box::new(move |u, v| {
        let (wu, wv) = (u + 0.22 * w * warp.at(u, v), v + 0.22 * w * warp.at(v + 0.31 * w, u));
        let mut h = -0.4;
        let mut id = 0;
        for (cells, lift) in &layers {
            cells.around(wu, wv, |to, point| {
                let r0 = w * (0.30 + 0.16 * unit(point, 1));
                let thick = w * 0.15;
                let squash = 0.75 + 0.5 * unit(point, 2);
                let d = (f64::hypot(to[0] * squash, to[1]) - r0) / thick;
                if d.abs() < 1.0 {
                    let tilt = (to[0] * (unit(point, 3) - 0.5) + to[1] * (unit(point, 4) - 0.5)) / w;
                    let top = (1.0 - d * d).sqrt() * 0.6 + lift + 0.9 * tilt + 0.25 * (unit(point, 5) - 0.5);
                    if top > h {
                        (h, id) = (top, point);
                    }
                }
            });
        }
        let f = fuzz.fbm(u, v, 2);
        let tone = libm::exp(sigma * 0.5 * gauss(id, 1)) * lerp(0.58, 1.07, smooth(-0.4, 0.7, h)) * (1.0 + 0.05 * f);
        Sample {
            height: 1000.0 * w * (0.26 * h + 0.025 * f + 0.10 * lump.fbm(u, v, 2)),
            color: times(palette.pick(id), tone),
            rough: 0.02 * f,
            cover: 1.0,
            id,
        }
    })
}

/// Carpet: cut tufts, `loop`ed ones, or long `shag` that lies every way; `amount`: how far the pile leans in patches.
pub(super) fn pile(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let w = width(p).max(2.5 * space.px);
    let shag = p.variant == "shag";
    let tufts = Cells::new(space, [w, w], if p.variant == "loop" { 0.35 } else { 0.95 }, 111);
    let lay_u = Noise::periodic(space, [0.10_f64.max(6.0 * w); 2], 112);
    let lay_v = Noise::periodic(space, [0.10_f64.max(6.0 * w); 2], 113);
    let tread = Noise::periodic(space, [0.22, 0.22], 114);
    let fibre = Noise::periodic(space, [(w * 0.3).max(1.7 * space.px); 2], 115);
    let sigma = tone_sigma(p, 0.30);
    let lean = amount(p, 0.4);
    Box::new(move |u, v| {
        let (lu, lv) = (lay_u.fbm(u, v, 2), lay_v.fbm(u, v, 2));
        let mut h = 0.0_f64;
        let mut id = 0;
        if shag {
            // Strands: stretched bumps along the way the pile lies, the topmost one seen.
            tufts.around(u, v, |to, point| {
                let turn = libm::atan2(lv + 0.7 * (unit(point, 1) - 0.5), lu + 0.7 * (unit(point, 2) - 0.5));
                let (s, c) = (libm::sin(turn), libm::cos(turn));
                let (x, y) = ((to[0] * c + to[1] * s) / w, (to[1] * c - to[0] * s) / w);
                let y = y + 0.25 * x * x * (unit(point, 3) - 0.5);
                let q = 1.0 - (x * x * 1.1 + y * y * 12.0);
                let top = q.max(0.0).sqrt() * 0.7
                    + 0.6 * unit(point, 4) * smooth(0.0, 0.3, q)
                    + 0.3 * x * smooth(0.0, 0.2, q);
                if top > h {
                    (h, id) = (top, point);
                }
            });
        } else {
            let (du, dv) = (0.35 * w * lean * lu, 0.35 * w * lean * lv);
            let n = tufts.at(u + du, v + dv);
            id = n.id;
            h = (1.0 - 1.5 * n.d1 * n.d1).max(0.0).sqrt() * (0.8 + 0.4 * unit(n.id, 4));
        }
        let f = fibre.fbm(u, v, 2);
        let trodden = tread.fbm(u, v, 3);
        let tone = libm::exp(sigma * 0.6 * gauss(id, 1) + lean * (0.10 * lu + 0.12 * trodden))
            * lerp(0.55, 1.08, smooth(0.0, 1.0, h))
            * (1.0 + 0.10 * f);
        Sample {
            height: 1000.0 * w * (0.34 * h + 0.06 * f + 0.15 * lean * trodden),
            color: times(palette.pick(id), tone),
            rough: 0.02 * f,
            cover: 1.0,
            id,
        }
    })
}

/// Grained leather: pebbles between creases; `amount`: depth of the grain.
pub(super) fn leather(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let w = width(p).max(3.0 * space.px);
    let (grain, fine) = (Cells::new(space, [w, w], 1.0, 121), Cells::new(space, [w * 0.45; 2], 1.0, 122));
    let warp = Noise::periodic(space, [w * 2.0; 2], 123);
    let cloud = Noise::periodic(space, [0.05, 0.05], 124);
    let crease = Noise::periodic(space, [0.035, 0.02], 125);
    let depth = amount(p, 0.5);
    Box::new(move |u, v| {
        let (wu, wv) = (u + 0.5 * w * warp.at(u, v), v + 0.5 * w * warp.at(v + 0.4 * w, u));
        let (n, m) = (grain.at(wu, wv), fine.at(wu, wv));
        let pebble = smooth(0.0, 0.32, n.d2 - n.d1) * (0.85 + 0.3 * unit(n.id, 1));
        let small = smooth(0.0, 0.35, m.d2 - m.d1);
        let fold = smooth(0.16, 0.0, crease.at(u, v).abs()) * 0.5;
        let c = cloud.fbm(u, v, 3);
        let h = 0.8 * pebble + 0.2 * small - 0.35 * fold;
        let tone = libm::exp(0.06 * c) * lerp(1.0, lerp(0.70, 1.04, smooth(-0.1, 0.9, h)), depth.sqrt());
        Sample {
            height: 1000.0 * w * 0.13 * depth * 1.4 * h,
            color: times(palette.main[0], tone),
            rough: 0.06 * (1.0 - pebble) + 0.04 * c,
            cover: 1.0,
            id: n.id,
        }
    })
}

/// Woven bands of cane or wicker: stakes along v, flat strands around them; `cane`: open octagonal caning.
pub(super) fn rattan(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, p.colors.len() >= 2, |c| times(c, 0.12));
    let w = width(p);
    let (nu, a) = {
        let n = (space.w / w / 2.0).round().max(1.0) * 2.0;
        (n as i64, space.w / n)
    };
    let (nv, b) = space.down(if p.variant == "cane" { w } else { w * 0.5 * (length(p) / w) }, 2);
    let sigma = tone_sigma(p, 0.35);
    let fibre_u = Noise::periodic(space, [w * 4.0, (w * 0.06).max(1.6 * space.px)], 131);
    let fibre_v = Noise::periodic(space, [(w * 0.06).max(1.6 * space.px), w * 4.0], 132);
    let wander = Noise::periodic(space, [w * 3.0; 2], 133);
    let stain = Noise::periodic(space, [w * 9.0; 2], 134);
    let seed = space.seed;
    let cane = p.variant == "cane";
    let wood = move |main: Rgb, id: u64, f: f64| times(main, libm::exp(sigma * 0.6 * gauss(id, 1) + 0.13 * f));
    Box::new(move |u, v| {
        let (x, y) = ((u + 0.05 * w * wander.at(u, v)) / a, (v + 0.05 * w * wander.at(v, u)) / b);
        let (i, j) = (x.floor() as i64, y.floor() as i64);
        let (fx, fy) = (x - i as f64 - 0.5, y - j as f64 - 0.5);
        let (hi, hj) = (hash(seed, i.rem_euclid(nu), -3), hash(seed, j.rem_euclid(nv), -4));
        let up = (i + j).rem_euclid(2) == 0;
        let s = if up { 1.0 } else { -1.0 };
        let (fu, fv) = (fibre_u.fbm(u, v, 2), fibre_v.fbm(u, v, 2));
        if cane {
            // Straight strands both ways, thin, over holes; diagonals close the corners.
            let strip = |t: f64, half: f64| 1.0 - (t.abs() / half).min(1.0);
            let (sx, sy) = (strip(fx, 0.17), strip(fy, 0.17));
            let diag = |t: f64| {
                let q = t - t.round();
                1.0 - (q.abs() / 0.13).min(1.0)
            };
            let (d1, d2) = (diag(x + y), diag(x - y));
            let h = [sx, sy, d1 * 0.9, d2 * 0.95].into_iter().fold(0.0, f64::max);
            let id = if sx >= sy { hi } else { hj };
            let body = smooth(0.0, 0.2, h);
            let color = mix(palette.joint, wood(palette.main[0], id, if sx > sy { fv } else { fu }), body);
            return Sample { height: 1000.0 * w * 0.12 * h.sqrt(), color, rough: 0.2 * (1.0 - body), cover: body, id };
        }
        let ease = libm::cos(PI * fx);
        let weft = (1.0 - (fy / 0.5) * (fy / 0.5)).max(0.0).sqrt() * 0.55 - 0.75 * s * ease;
        let stake = if fx.abs() < 0.20 { (1.0 - (fx / 0.20) * (fx / 0.20)).sqrt() * 0.7 } else { -1.6 };
        let on_stake = stake > weft;
        let h = stake.max(weft);
        let id = if on_stake { hi } else { hash(hj, i.rem_euclid(nu), 1) };
        let deep = smooth(-1.1, 0.7, h);
        let color = wood(palette.pick(hj), if on_stake { hi } else { hj }, if on_stake { fv } else { fu });
        let shade = lerp(0.30, 1.08, deep) * (1.0 - 0.10 * smooth(0.1, 0.8, stain.fbm(u, v, 2)));
        Sample {
            height: 1000.0 * w * (0.16 * h + 0.012 * if on_stake { fv } else { fu }),
            color: mix(palette.joint, times(color, shade), smooth(-1.2, -0.5, h)),
            rough: 0.05 * fu,
            cover: 1.0,
            id,
        }
    })
}
