//! How plants grow.
//!
//! Leaves follow each other by the golden angle (Vogel 1979); every leaf and stem differs a little in length, tilt and
//! bend, because evenness is what looks made.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::super::grid::{ball, square_to, turn};
use super::super::noise::Dice;
use super::leaf::{Form, Outline, place};
use super::stem::Stem;
use super::{Plant, PlantSpec};
use crate::Piece;

/// Golden angle.
const GOLDEN: f64 = 2.399_963_229_728_653;

/// Most leaves, blades or leaflets of a plant.
const MAX_LEAVES: u32 = 1500;

/// A plant while it grows.
pub(super) struct Growth<'a> {
    spec: PlantSpec,
    own: Option<&'a Piece>,
    dice: Dice,
    plant: Plant,
}

/// A horizontal direction.
fn around(angle: f64) -> DVec3 {
    let (s, c) = libm::sincos(angle);
    DVec3::new(s, 0.0, c)
}

/// A direction by its angle around and its height over the horizon.
fn aim(angle: f64, rise: f64) -> DVec3 {
    let (s, c) = libm::sincos(rise);
    around(angle) * c + DVec3::Y * s
}

impl<'a> Growth<'a> {
    pub fn new(spec: &PlantSpec, own: Option<&'a Piece>) -> Self {
        let dice = Dice::new(spec.seed, 61);
        let mut plant = Plant::default();
        plant.stems.closed = true;
        Self { spec: *spec, own, dice, plant }
    }

    fn count(&self, usual: u32, most: u32) -> u32 {
        (if self.spec.count == 0 { usual } else { self.spec.count }).clamp(1, most)
    }

    /// A leaf at a place, tilted at random by up to `loose` radians.
    fn leaf(&mut self, form: &Form, at: DVec3, forward: DVec3, up: DVec3, loose: f64) {
        let side = forward.cross(up).normalize_or(DVec3::X);
        let forward = turn(forward, side, loose * self.dice.bell());
        let up = turn(up, forward.normalize_or(DVec3::Z), loose * 1.3 * self.dice.bell());
        let scale = 1.0 + 0.18 * self.dice.bell();
        if let Some(own) = self.own {
            place(&mut self.plant.leaves, own, at, forward, up, scale);
        } else {
            let form = Form {
                curl: form.curl * (1.0 + 0.5 * self.dice.bell()),
                twist: form.twist + 0.25 * self.dice.bell(),
                ..*form
            };
            place(&mut self.plant.leaves, &form.mesh(), at, forward, up, scale);
        }
    }

    /// Stems that fan out, leaves all along their upper part.
    pub fn bush(&mut self) {
        let [h, r] = [self.spec.height, self.spec.spread / 2.0];
        let leaves = self.count(190, MAX_LEAVES);
        let stems = (f64::from(leaves).sqrt() * 1.1).round().clamp(4.0, 26.0) as u32;
        let each = leaves.div_ceil(stems);
        let length = (0.26 * (h * r * 2.0).sqrt()).min(0.24) * (190.0 / f64::from(leaves)).sqrt().clamp(0.5, 2.0);
        let form = Form {
            length,
            width: 0.5 * length,
            outline: Outline::Oval,
            fold: 0.30,
            curl: 0.7,
            twist: 0.0,
            ripple: 0.015,
            rows: 6,
            cols: 4,
        };
        for k in 0..stems {
            let spread = ((f64::from(k) + 0.5) / f64::from(stems)).sqrt();
            let angle = GOLDEN * f64::from(k) + 0.3 * self.dice.bell();
            let base = around(angle) * (0.10 * r * spread);
            // Outer stems lean to the width, inner ones reach the height.
            let reach = around(angle) * (r * 0.86 * spread) + DVec3::Y * (h * (0.95 - 0.38 * spread * spread));
            let reach = reach * (1.0 + 0.12 * self.dice.bell());
            let direct = (reach - base).normalize_or(DVec3::Y);
            let wander = square_to(direct) * self.dice.bell() + DVec3::Y * 0.25;
            let lift = direct + DVec3::Y * 0.5;
            let stem = Stem::grown(base, lift, reach.length(), 8, |t| (direct - lift) * 1.2 * t + wander * 0.5);
            stem.draw(&mut self.plant.stems, 0.006 * h.max(0.3), 0.0022 * h.max(0.3), 5);
            for m in 0..each {
                let t = 0.25 + 0.75 * (f64::from(m) + 0.6) / f64::from(each);
                let (at, d) = stem.at(t);
                let side = turn(square_to(d), d, GOLDEN * f64::from(m) + angle);
                let last = m + 1 == each;
                let outward = if last { d } else { side + d * 0.55 + DVec3::Y * 0.15 };
                // Leaves turn their face to the light: up and outwards.
                let light = DVec3::Y + around(angle) * 0.5 * spread;
                let small =
                    Form { length: length * (0.75 + 0.35 * t), width: 0.5 * length * (0.75 + 0.35 * t), ..form };
                self.leaf(&small, at, outward, light, 0.26);
            }
        }
    }

    /// Long leaves from one point, upright inside, flat outside.
    pub fn rosette(&mut self) {
        let [h, r] = [self.spec.height, self.spec.spread / 2.0];
        let n = self.count(26, 200);
        for k in 0..n {
            // From the oldest, outermost leaf to the youngest.
            let age = 1.0 - (f64::from(k) + 0.5) / f64::from(n);
            let angle = GOLDEN * f64::from(k) + 0.12 * self.dice.bell();
            let rise = PI / 2.0 * (1.0 - 0.80 * libm::pow(age, 0.8));
            let (s, c) = libm::sincos(rise);
            let length = (h * s + r * 1.15 * c) * (0.55 + 0.45 * libm::sin(PI * (0.25 + 0.6 * age)));
            let form = Form {
                length,
                width: 0.17 * length.max(0.4 * r),
                outline: Outline::Lance,
                fold: 0.45,
                curl: 0.3 + 0.9 * age,
                twist: 0.1 * self.dice.bell(),
                ripple: 0.02,
                rows: 12,
                cols: 4,
            };
            let out = around(angle);
            self.leaf(&form, out * (0.03 * r * age), aim(angle, rise), DVec3::Y - out * 0.4, 0.12);
        }
        // The heart of the rosette is closed by a short stub.
        let stub = Stem::grown(DVec3::ZERO, DVec3::Y, 0.06 * h, 2, |_| DVec3::ZERO);
        stub.draw(&mut self.plant.stems, 0.05 * r, 0.03 * r, 8);
    }

    /// A frond: a rachis with paired leaflets whose lengths follow `profile`.
    fn frond(&mut self, rachis: &Stem, pairs: u32, longest: f64, width: f64, droop: f64, first: f64) {
        for m in 0..pairs {
            let t = first + (1.0 - first) * (f64::from(m) + 0.5) / f64::from(pairs);
            let (at, d) = rachis.at(t);
            let u = (t - first) / (1.0 - first);
            let length = longest * libm::pow(libm::sin(PI * (0.08 + 0.90 * libm::pow(u, 0.75))), 0.9);
            let side = d.cross(DVec3::Y).normalize_or(square_to(d));
            let up = side.cross(d);
            for sign in [-1.0, 1.0] {
                let spread = 0.35 + 0.5 * u;
                let out = side * sign + d * spread + up * (0.25 - droop * 0.3);
                let form = Form {
                    length: length * (1.0 + 0.10 * self.dice.bell()),
                    width,
                    outline: Outline::Lance,
                    fold: 0.35,
                    curl: droop + 0.15 * self.dice.bell(),
                    twist: 0.15 * self.dice.bell(),
                    ripple: 0.0,
                    rows: if length > 0.12 { 4 } else { 3 },
                    cols: 2,
                };
                let loose = up + side * (0.25 * self.dice.bell());
                place(&mut self.plant.leaves, &form.mesh(), at, out, loose, 1.0);
            }
        }
        let (at, d) = rachis.at(1.0);
        let form = Form {
            length: longest * 0.3,
            width: width * 0.9,
            outline: Outline::Lance,
            fold: 0.3,
            curl: droop,
            twist: 0.0,
            ripple: 0.0,
            rows: 3,
            cols: 2,
        };
        place(&mut self.plant.leaves, &form.mesh(), at, d, DVec3::Y, 1.0);
    }

    /// Arching fronds.
    pub fn fern(&mut self) {
        let [h, r] = [self.spec.height, self.spec.spread / 2.0];
        let n = self.count(26, 60);
        let pairs = (480 / n).clamp(10, 22);
        for k in 0..n {
            let age = (f64::from(k) + 0.5) / f64::from(n);
            let angle = GOLDEN * f64::from(k) + 0.25 * self.dice.bell();
            let rise = 1.45 - 0.75 * age + 0.12 * self.dice.bell();
            let length = (h * h + r * r).sqrt() * (0.80 + 0.25 * self.dice.unit());
            let out = around(angle);
            let fall = 1.3 + 0.9 * age + 0.3 * self.dice.bell();
            let sway = out.cross(DVec3::Y) * (0.5 * self.dice.bell());
            let rachis = Stem::grown(out * (0.04 * r), aim(angle, rise), length, 10, |t| {
                (out * 0.5 - DVec3::Y) * (fall * (0.3 + 1.3 * t)) + sway
            });
            rachis.draw(&mut self.plant.stems, 0.0022 * (1.0 + length), 0.0008, 4);
            let leaflet = 0.20 * length;
            self.frond(&rachis, pairs, leaflet, (1.5 * length / f64::from(pairs)).min(0.3 * leaflet), 0.35, 0.16);
        }
    }

    /// Fronds on slim canes.
    pub fn palm(&mut self) {
        let [h, r] = [self.spec.height, self.spec.spread / 2.0];
        let n = self.count(13, 40);
        let pairs = (480 / n).clamp(12, 30);
        for k in 0..n {
            let age = (f64::from(k) + 0.5) / f64::from(n);
            let angle = GOLDEN * f64::from(k) + 0.3 * self.dice.bell();
            let rise = 1.50 - 0.50 * age + 0.08 * self.dice.bell();
            let length = h * (1.12 - 0.30 * age) * (1.0 + 0.10 * self.dice.bell());
            let out = around(angle);
            let fall = 0.9 + 0.7 * age;
            let sway = out.cross(DVec3::Y) * (0.3 * self.dice.bell());
            let rachis = Stem::grown(out * (0.05 * r), aim(angle, rise), length, 12, |t| {
                (out * 0.9 - DVec3::Y * 0.9) * (fall * (0.1 + 2.0 * t * t)) + sway
            });
            rachis.draw(&mut self.plant.stems, 0.008 * h.max(0.4), 0.0016, 6);
            self.frond(&rachis, pairs, 0.24 * length, 0.026 * length.min(1.6), 0.55, 0.38);
        }
    }

    /// Stems that rise over the rim and hang, leaves at alternating sides.
    pub fn vine(&mut self) {
        let [h, r] = [self.spec.height, self.spec.spread / 2.0];
        let n = self.count(14, 60);
        let each = (230 / n).clamp(6, 34);
        let leaf = (0.40 * r).clamp(0.02, 0.12);
        let form = Form {
            length: leaf,
            width: 0.80 * leaf,
            outline: Outline::Heart,
            fold: 0.25,
            curl: 0.5,
            twist: 0.0,
            ripple: 0.02,
            rows: 5,
            cols: 4,
        };
        for k in 0..n {
            let angle = GOLDEN * f64::from(k) + 0.2 * self.dice.bell();
            let out = around(angle);
            // Some stay short and make the crown.
            let share = if k % 3 == 0 { 0.30 } else { 0.60 + 0.40 * self.dice.unit() };
            let length = 0.25 * h + r * 0.6 + 0.80 * h * share;
            let drift = out.cross(DVec3::Y) * (5.0 * self.dice.bell()) + out * (2.5 * self.dice.bell());
            let reach = r * (0.55 + 0.35 * self.dice.unit());
            let stem = Stem::grown(out * (0.08 * r), aim(angle, 0.75), length, 26, |t| {
                // Up, over, and down: gravity wins once it is outside.
                let bend = (length / reach.max(0.05)) * 1.1;
                -DVec3::Y * bend * (0.8 + t) + drift * libm::sin(9.0 * t + angle)
            });
            stem.draw(&mut self.plant.stems, 0.0022, 0.0010, 4);
            for m in 0..each {
                let t = (f64::from(m) + 0.7) / f64::from(each);
                let (at, d) = stem.at(t);
                let side = d.cross(out).normalize_or(square_to(d)) * if m % 2 == 0 { 1.0 } else { -1.0 };
                // Stalks lift the leaf off the stem, the blade turns outwards and hangs.
                let stalk = (side * 0.8 + out * 0.7 + DVec3::Y * 0.5).normalize_or(out);
                let tip = at + stalk * (0.45 * leaf);
                Stem::grown(at, stalk, 0.45 * leaf, 1, |_| DVec3::ZERO).draw(&mut self.plant.stems, 0.0009, 0.0007, 3);
                let hang = side * 0.6 + out * 0.5 - DVec3::Y * (0.3 + 0.5 * t);
                let scale = 1.15 - 0.5 * t;
                let small = Form { length: leaf * scale, width: 0.80 * leaf * scale, ..form };
                self.leaf(&small, tip, hang, out + DVec3::Y * 0.8, 0.3);
            }
        }
    }

    /// A dense rosette of fleshy leaves.
    pub fn succulent(&mut self) {
        let [h, r] = [self.spec.height, self.spec.spread / 2.0];
        let n = self.count(46, 200);
        for k in 0..n {
            let age = 1.0 - (f64::from(k) + 0.5) / f64::from(n);
            let angle = GOLDEN * f64::from(k) + 0.05 * self.dice.bell();
            let rise = PI / 2.0 - (PI / 2.0 - 0.12) * libm::pow(age, 0.55);
            let length = r * (0.34 + 0.62 * age) * (1.0 + 0.06 * self.dice.bell());
            let out = around(angle);
            let base = out * (0.06 * r * age) + DVec3::Y * (0.30 * h * (1.0 - age));
            let leaf = fleshy(length, 0.42 * length, 0.20 * length, 0.35 * age - 0.5);
            let up = DVec3::Y - out * 0.1;
            place(&mut self.plant.leaves, &leaf, base, aim(angle, rise), up, 1.0);
        }
        let stub = Stem::grown(DVec3::ZERO, DVec3::Y, 0.3 * h, 2, |_| DVec3::ZERO);
        stub.draw(&mut self.plant.stems, 0.12 * r, 0.06 * r, 8);
    }

    /// Blades that rise and arch over.
    pub fn grass(&mut self) {
        let [h, r] = [self.spec.height, self.spec.spread / 2.0];
        let n = self.count(150, 900);
        for k in 0..n {
            let place_out = ((f64::from(k) + 0.5) / f64::from(n)).sqrt();
            let angle = GOLDEN * f64::from(k) + 0.4 * self.dice.bell();
            let base = around(angle) * (0.22 * r * place_out);
            let lean = 0.12 + 0.55 * place_out * (0.6 + 0.4 * self.dice.unit());
            let length = (h * 1.02 + 0.3 * r * place_out) * (0.55 + 0.45 * self.dice.unit());
            let form = Form {
                length,
                width: (0.018 * h).clamp(0.002, 0.02) * (0.7 + 0.6 * self.dice.unit()),
                outline: Outline::Blade,
                fold: 0.5,
                curl: 0.5 + 1.2 * place_out * self.dice.unit(),
                twist: 0.8 * self.dice.bell(),
                ripple: 0.0,
                rows: 7,
                cols: 2,
            };
            let forward = aim(angle + 0.5 * self.dice.bell(), PI / 2.0 - lean);
            place(&mut self.plant.leaves, &form.mesh(), base, forward, DVec3::Y - around(angle) * 0.2, 1.0);
        }
    }

    /// Stems with a flower each and some leaves.
    pub fn flowers(&mut self) {
        let [h, r] = [self.spec.height, self.spec.spread / 2.0];
        let n = self.count(9, 60);
        let head = (0.34 * r).min(0.17 * h).max(0.01) * (9.0 / f64::from(n)).sqrt().clamp(0.5, 1.3);
        for k in 0..n {
            let out_share = ((f64::from(k) + 0.3) / f64::from(n)).sqrt();
            let angle = GOLDEN * f64::from(k) + 0.3 * self.dice.bell();
            let out = around(angle);
            let reach = out * ((r - head) * out_share)
                + DVec3::Y * (h * (0.97 - 0.26 * out_share) * (1.0 + 0.05 * self.dice.bell()));
            let base = out * (0.04 * r);
            let direct = (reach - base).normalize_or(DVec3::Y);
            let bend = out * 0.35 + square_to(direct) * (0.3 * self.dice.bell());
            let stem = Stem::grown(base, direct - bend * 0.5, reach.length() * 0.96, 8, |_| bend);
            stem.draw(&mut self.plant.stems, 0.0035 * h.max(0.3), 0.0022 * h.max(0.3), 5);
            let (at, d) = stem.at(1.0);
            let face = (d * 0.7 + out * 0.5 + DVec3::Y * 0.4).normalize_or(d);
            let radius = head * (0.85 + 0.3 * self.dice.unit());
            self.blossom(at, face, radius);
            for m in 0..4_u32 {
                let t = 0.22 + 0.15 * f64::from(m) + 0.05 * self.dice.bell();
                let (at, d) = stem.at(t);
                let side = turn(square_to(d), d, GOLDEN * f64::from(m) + angle * 2.0);
                let length = 0.9 * head * (1.5 - t);
                let form = Form {
                    length,
                    width: 0.36 * length,
                    outline: Outline::Oval,
                    fold: 0.35,
                    curl: 0.8,
                    twist: 0.0,
                    ripple: 0.02,
                    rows: 7,
                    cols: 4,
                };
                self.leaf(&form, at, side + d * 0.9, DVec3::Y + d * 0.3, 0.25);
            }
        }
    }

    /// Three rings of petals around a centre, the inner ones more upright.
    fn blossom(&mut self, at: DVec3, face: DVec3, radius: f64) {
        let side = square_to(face);
        let turned = TAU * self.dice.unit();
        for (ring, (count, rise, size)) in [(9_u32, 0.25, 1.0), (8, 0.7, 0.82), (6, 1.1, 0.6)].into_iter().enumerate() {
            for k in 0..count {
                let angle =
                    turned + TAU * (f64::from(k) + 0.5 * ring as f64) / f64::from(count) + 0.08 * self.dice.bell();
                let out = turn(side, face, angle);
                let (s, c) = libm::sincos(rise + 0.15 * self.dice.bell());
                let length = radius * size * (1.0 + 0.08 * self.dice.bell());
                let form = Form {
                    length,
                    width: 0.62 * length,
                    outline: Outline::Oval,
                    fold: 0.25,
                    curl: if ring == 0 { 0.5 } else { -0.25 },
                    twist: 0.0,
                    ripple: 0.03,
                    rows: 4,
                    cols: 4,
                };
                place(
                    &mut self.plant.flowers,
                    &form.mesh(),
                    at + face * (0.03 * radius),
                    out * c + face * s,
                    face - out * 0.2,
                    1.0,
                );
            }
        }
        let r = 0.16 * radius;
        ball(&mut self.plant.flowers, at + face * (0.10 * radius), side, face, DVec3::new(r, r * 0.8, r), 5, 8);
    }

    /// A trunk with branches and leaves at their ends.
    pub fn tree(&mut self) {
        let [h, r] = [self.spec.height, self.spec.spread / 2.0];
        let leaves = self.count(260, MAX_LEAVES);
        let lean = around(TAU * self.dice.unit()) * 0.10;
        let wander = around(TAU * self.dice.unit()) * 0.35;
        let trunk = Stem::grown(DVec3::ZERO, DVec3::Y + lean, 0.80 * h, 12, |t| wander * libm::sin(5.0 * t) - lean * t);
        let thick = 0.014 * h.max(0.4);
        trunk.draw(&mut self.plant.stems, thick, 0.35 * thick, 9);
        let mut twigs: Vec<Stem> = Vec::new();
        let limbs = 9_u32;
        for k in 0..limbs {
            let t = 0.42 + 0.58 * f64::from(k) / f64::from(limbs - 1);
            let (at, d) = trunk.at(t);
            let angle = GOLDEN * f64::from(k) + 0.3 * self.dice.bell();
            // Lower limbs are longer and flatter.
            let rise = 0.45 + 0.75 * (t - 0.42) / 0.58;
            let length = (r * 0.95 * (1.0 - 0.25 * (t - 0.42))).min(0.5 * h) * (1.0 + 0.15 * self.dice.bell());
            let bend = DVec3::Y * 0.6 + square_to(d) * (0.4 * self.dice.bell());
            let limb = Stem::grown(at, aim(angle, rise), length, 7, |_| bend);
            limb.draw(&mut self.plant.stems, 0.42 * thick * (1.3 - t), 0.14 * thick, 6);
            for m in 0..4_u32 {
                let s = 0.40 + 0.18 * f64::from(m);
                let (at, d) = limb.at(s);
                let side = turn(square_to(d), d, GOLDEN * f64::from(m) + angle);
                let bend = DVec3::Y * 0.5;
                let twig = Stem::grown(at, side * 0.8 + d + DVec3::Y * 0.3, length * (0.75 - 0.35 * s), 5, |_| bend);
                twig.draw(&mut self.plant.stems, 0.15 * thick, 0.06 * thick, 4);
                twigs.push(twig);
            }
            twigs.push(limb);
        }
        twigs.push(trunk);
        let each = leaves.div_ceil(twigs.len() as u32);
        let length = (0.34 * (r * h).sqrt()).min(0.22) * (260.0 / f64::from(leaves)).sqrt().clamp(0.5, 1.8);
        for (k, twig) in twigs.iter().enumerate() {
            for m in 0..each {
                let t = 0.55 + 0.45 * (f64::from(m) + 0.8) / f64::from(each);
                let (at, d) = twig.at(t);
                let side = turn(square_to(d), d, GOLDEN * (f64::from(m) + k as f64 * 3.0));
                let form = Form {
                    length,
                    width: 0.52 * length,
                    outline: Outline::Oval,
                    fold: 0.3,
                    curl: 0.6,
                    twist: 0.0,
                    ripple: 0.02,
                    rows: 5,
                    cols: 4,
                };
                let forward = if m + 1 == each { d } else { side + d * 0.6 };
                self.leaf(&form, at, forward, DVec3::Y + d * 0.3, 0.3);
            }
        }
    }

    /// The plant at the size asked for.
    pub fn fitted(self) -> Plant {
        let mut plant = self.plant;
        let all = [&plant.leaves, &plant.stems, &plant.flowers];
        let points = || all.iter().flat_map(|p| &p.positions);
        let high = points().fold(f64::MIN, |m, p| m.max(p.y));
        let low = points().fold(f64::MAX, |m, p| m.min(p.y));
        let wide = points().fold(0.0_f64, |m, p| m.max((p.x * p.x + p.z * p.z).sqrt()));
        let PlantSpec { height, spread, kind, .. } = self.spec;
        let hangs = kind == crate::tree::PlantKind::Vine;
        // Of a vine a fifth stands above the pot, the rest hangs.
        let stretch = if hangs { 0.2 * height } else { height } / high.max(1e-6);
        let hanging = 0.8 * height / (-low).max(1e-6);
        let across = spread / 2.0 / wide.max(1e-6);
        // A plant that lies on the ground around its pot bends up rather than through it.
        let map = |p: DVec3| {
            let y = if p.y > 0.0 {
                p.y * stretch
            } else if hangs {
                p.y * hanging
            } else {
                0.0
            };
            DVec3::new(p.x * across, y, p.z * across)
        };
        for piece in [&mut plant.leaves, &mut plant.stems, &mut plant.flowers] {
            for (p, n) in piece.positions.iter_mut().zip(&mut piece.normals) {
                let up = if p.y < 0.0 && hangs { hanging } else { stretch };
                *n = (*n / DVec3::new(across, up, across)).normalize_or(*n);
                *p = map(*p);
            }
        }
        plant
    }
}

/// A thick pointed leaf: a closed lens from the origin along +z.
fn fleshy(length: f64, width: f64, thick: f64, curl: f64) -> Piece {
    let (rows, sides) = (7_u32, 8_u32);
    let mut piece = Piece { closed: true, ..Piece::default() };
    for j in 0..=rows {
        let t = f64::from(j) / f64::from(rows);
        let half = width / 2.0
            * libm::pow(libm::sin(PI * libm::pow(t, 1.25) * 0.94 + 0.18).max(0.0), 0.7)
            * if j == rows { 0.02 } else { 1.0 };
        let deep = thick / 2.0
            * libm::pow(libm::sin(PI * libm::pow(t, 0.8) * 0.97 + 0.09), 0.8)
            * if j == rows { 0.02 } else { 1.0 };
        let (s, c) = libm::sincos(curl * t);
        let centre = DVec3::new(0.0, -s * length * t * 0.5, length * t * c.abs().max(0.7));
        for k in 0..=sides {
            let (sin, cos) = libm::sincos(TAU * f64::from(k % sides) / f64::from(sides));
            // Flat above, keeled below.
            let y = if sin > 0.0 { 0.35 * sin } else { 1.3 * sin };
            let p = centre + DVec3::new(half * cos, deep * y, 0.0);
            super::super::grid::push(&mut piece, p, DVec3::Y, glam::DVec2::new(half * cos, t * length));
        }
    }
    super::super::grid::grid_triangles(sides + 1, rows + 1, 0, &mut piece.triangles);
    super::super::grid::smooth_normals(&mut piece);
    // Ends are within other leaves or a point: open by a hair.
    piece.closed = false;
    piece
}
