//! What a photo says of light on surfaces: one smooth law for the room, one colour for each material.
//!
//! In logarithms the law is linear: `ln photo = ln said + slot + scene + b(normal, place) . w + g ln openness`, with `said`
//! the colour that a material was given. It is solved by iterated reweighting (Huber) with weak priors, so that what was
//! seen of few surfaces stays near to what was said. The hue of the light is what most materials ask for alike.

use glam::DVec3;
use harmony_scene::Extents;
use nalgebra::{SMatrix, SVector};

/// Numbers of the law of a room: the general level, six of direction, three of place, one of openness.
const TERMS: usize = 11;
type Terms = SVector<f64, TERMS>;
/// Deviation of a pixel from which it counts as an outlier, nats.
const HUBER: f64 = 0.2;
/// Prior deviation of a slot's colour from what was said, nats.
const SLOT_SIGMA: f64 = 0.5;
/// Prior deviations of the terms, nats for a whole unit, and their means.
const SIGMA: [f64; TERMS] = [0.7, 0.3, 0.3, 0.3, 0.2, 0.2, 0.2, 0.3, 0.3, 0.3, 0.25];
const MEAN: [f64; TERMS] = [0.0, 0.0, 0.15, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.6];
/// Added to linear values before logarithms are taken, so that black does not outweigh all.
pub(super) const AIR: f64 = 0.01;
const ROUNDS: usize = 12;
/// Darkest and brightest light of the law, nats: three stops below and two thirds of one above the said colour.
const LIGHT: [f64; 2] = [-2.0, 0.45];
/// Pixels by which the brightness and the hue of a slot are believed half.
const LEVEL_PIXELS: f64 = 8.0;
const HUE_PIXELS: f64 = 80.0;
/// Largest change of a slot's brightness, nats: a stop and a half.
const MAX_LEVEL: f64 = 1.04;
/// Difference of a channel against the others from which a slot's pixels are not its own, nats.
const FOREIGN: f64 = 0.6;
/// Largest change of a channel against the others, nats, beside the hue of the room's light.
const MAX_HUE: f64 = 0.22;
/// The same of what shines, whose highlights have the hue of what it mirrors; and which of its pixels, in order of brightness, has
/// its colour: red-brown leather was salmon.
const MAX_GLOSSY_HUE: f64 = 0.08;
const DULL: f64 = 0.3;
/// Largest hue of that light in a channel, nats; pixels that have to speak against white light; and most of one slot that
/// count: many things tell of light, one large thing of its paint.
const MAX_TINT: f64 = 1.2;
const WHITE_PIXELS: f64 = 300.0;
const ONE_SLOT_PIXELS: f64 = 150.0;

/// A pixel of the photo that shows a material.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Which slot.
    pub slot: usize,
    /// Unit normal.
    pub normal: DVec3,
    /// Room frame, metres.
    pub point: DVec3,
    /// From 0 to 1.
    pub openness: f64,
    /// Linear colour of the photo.
    pub photo: [f64; 3],
    /// Linear colour that was said.
    pub said: [f64; 3],
}

/// The light law of a room, as the photo has it.
#[derive(Debug, Clone, PartialEq)]
pub struct LightLaw {
    terms: Terms,
    room: DVec3,
}

fn basis(normal: DVec3, point: DVec3, open: f64, room: DVec3) -> Terms {
    let n = normal;
    let p = (point / room - 0.5).clamp(DVec3::splat(-0.6), DVec3::splat(0.6));
    let open = open.clamp(0.1, 1.0).ln();
    Terms::from([1.0, n.x, n.y, n.z, n.y * n.y - 1.0 / 3.0, n.x * n.y, n.z * n.y, p.x, p.y, p.z, open])
}

impl LightLaw {
    /// Light on a place as a factor on the colour that was said.
    pub fn at(&self, normal: DVec3, point: DVec3, open: f64) -> f64 {
        basis(normal, point, open, self.room).dot(&self.terms).clamp(LIGHT[0], LIGHT[1]).exp()
    }
}

/// The law and the factor on each slot's colour by channel, each within a stop and a half of what was said; `glossy`: of each slot,
/// whether it shines.
pub(super) fn fit(samples: &[Sample], glossy: &[bool], room: &Extents) -> (LightLaw, Vec<[f64; 3]>) {
    let room = DVec3::new(room.width, room.height, room.depth).max(DVec3::splat(0.1));
    let log = |v: f64| (v.max(0.0) + AIR).ln();
    let luminance = |c: [f64; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
    let rows: Vec<(Terms, usize, f64)> = samples
        .iter()
        .map(|s| {
            let wanted = log(luminance(s.photo)) - log(luminance(s.said));
            (basis(s.normal, s.point, s.openness, room), s.slot, wanted)
        })
        .collect();
    let mut terms = Terms::from(MEAN);
    let mut slot = vec![0.0; glossy.len()];
    for _ in 0..ROUNDS {
        (terms, slot) = step(&rows, &terms, &slot);
    }
    let law = LightLaw { terms, room };
    let mut channels: Vec<[Vec<f64>; 3]> = vec![Default::default(); glossy.len()];
    for s in samples {
        let light = law.at(s.normal, s.point, s.openness);
        for (k, list) in channels[s.slot].iter_mut().enumerate() {
            list.push(log(s.photo[k]) - log(s.said[k] * light));
        }
    }
    let asked: Vec<Option<Asked>> =
        channels.into_iter().zip(glossy).map(|(lists, glossy)| Asked::of(lists, *glossy)).collect();
    let tint = tint(&asked);
    (law, asked.iter().map(|asked| gain(asked.as_ref(), tint)).collect())
}

/// What the pixels of a slot ask for, nats.
struct Asked {
    is_glossy: bool,
    pixels: f64,
    level: f64,
    /// By channel, against the level.
    hue: [f64; 3],
}

impl Asked {
    fn of(lists: [Vec<f64>; 3], is_glossy: bool) -> Option<Self> {
        let pixels = lists[0].len();
        if pixels == 0 {
            return None;
        }
        let nth = if is_glossy { (pixels as f64 * DULL) as usize } else { pixels / 2 };
        let own = lists.map(|mut list| *list.select_nth_unstable_by(nth, f64::total_cmp).1);
        let level = 0.2126 * own[0] + 0.7152 * own[1] + 0.0722 * own[2];
        Some(Self { is_glossy, pixels: pixels as f64, level, hue: own.map(|m| m - level) })
    }
}

/// The hue of the room's light: what most slots ask for alike, for their colours were said for even white light. A photo
/// by lamps is yellow all over.
fn tint(asked: &[Option<Asked>]) -> [f64; 3] {
    std::array::from_fn(|k| {
        // Light is white until more speaks against it.
        let mut told = vec![(0.0, WHITE_PIXELS)];
        told.extend(asked.iter().flatten().map(|a| (a.hue[k], a.pixels.min(ONE_SLOT_PIXELS))));
        told.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all: f64 = told.iter().map(|t| t.1).sum();
        let mut sum = 0.0;
        let middle = told.iter().find(|t| {
            sum += t.1;
            sum >= all / 2.0
        });
        middle.map_or(0.0, |t| t.0.clamp(-MAX_TINT, MAX_TINT))
    })
}

/// The factors of a slot in a light of a hue: brightness soon, a hue of its own only by many pixels, for the few of a small
/// thing are its neighbours' too.
fn gain(asked: Option<&Asked>, tint: [f64; 3]) -> [f64; 3] {
    let Some(Asked { is_glossy, pixels, level, hue }) = asked else { return tint.map(f64::exp) };
    // Pixels of quite another hue are another thing's, which the scene has elsewhere.
    if (0..3).any(|k| (hue[k] - tint[k]).abs() > FOREIGN) {
        return tint.map(f64::exp);
    }
    let brightness = (level * pixels / (pixels + LEVEL_PIXELS)).clamp(-MAX_LEVEL, MAX_LEVEL);
    let most = if *is_glossy { MAX_GLOSSY_HUE } else { MAX_HUE };
    std::array::from_fn(|k| {
        let own = ((hue[k] - tint[k]) * pixels / (pixels + HUE_PIXELS)).clamp(-most, most);
        (brightness + tint[k] + own).exp()
    })
}

/// One round of reweighted least squares. Slots are eliminated: each has one number and its own rows.
fn step(rows: &[(Terms, usize, f64)], terms: &Terms, slot: &[f64]) -> (Terms, Vec<f64>) {
    let precision = Terms::from(SIGMA).map(|s| s.powi(-2));
    let mut normal = SMatrix::<f64, TERMS, TERMS>::from_diagonal(&precision);
    let mut right = Terms::from(MEAN).component_mul(&precision);
    // Of each slot: weight, weighted sum of the basis, weighted sum of what is wanted.
    let mut own = vec![(SLOT_SIGMA.powi(-2), Terms::zeros(), 0.0); slot.len()];
    for (b, s, wanted) in rows {
        let error = wanted - slot[*s] - b.dot(terms);
        let weight = HUBER / error.abs().max(HUBER);
        normal.ger(weight, b, b, 1.0);
        right.axpy(weight * wanted, b, 1.0);
        let o = &mut own[*s];
        o.0 += weight;
        o.1.axpy(weight, b, 1.0);
        o.2 += weight * wanted;
    }
    for (weight, sums, wanted) in &own {
        normal.ger(-1.0 / weight, sums, sums, 1.0);
        right.axpy(-wanted / weight, sums, 1.0);
    }
    let terms = normal.cholesky().map_or(*terms, |c| c.solve(&right));
    let slot = own.iter().map(|(weight, sums, wanted)| (wanted - sums.dot(&terms)) / weight).collect();
    (terms, slot)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOM: Extents = Extents { width: 4.0, height: 2.5, depth: 5.0 };

    /// Three boxes' visible sides under a light from above and the left; the second was said too bright.
    fn seen(truth: impl Fn(DVec3) -> f64, said: [f64; 3], real: [f64; 3], slot: usize) -> Vec<Sample> {
        let sides = [DVec3::Y, DVec3::Z, DVec3::X, DVec3::new(0.6, 0.8, 0.0)];
        (0..80)
            .map(|i| {
                let normal = sides[i % 4];
                let point = DVec3::new(0.5 + 0.03 * i as f64, 0.4, 2.0);
                let light = truth(normal);
                Sample { slot, normal, point, openness: 1.0, photo: real.map(|c| c * light), said: [said[0]; 3] }
            })
            .collect()
    }

    #[test]
    fn light_is_told_from_paint_by_the_sides_of_things() {
        let truth = |n: DVec3| 0.8 + 0.3 * n.y - 0.2 * n.x;
        let mut all = seen(truth, [0.5; 3], [0.5; 3], 0);
        all.extend(seen(truth, [0.8; 3], [0.4; 3], 1));
        let (law, gains) = fit(&all, &[false; 3], &ROOM);
        let at = |n: DVec3| law.at(n, DVec3::new(1.5, 0.4, 2.0), 1.0);
        let ratio = at(DVec3::Y) / at(DVec3::X);
        // Weak priors draw it a little towards an even light.
        assert!((ratio - 1.1 / 0.6).abs() < 0.25, "{ratio}");
        // What is predicted is what was seen, whoever holds the level.
        for (slot, real, said) in [(0, 0.5, 0.5), (1, 0.4, 0.8)] {
            let predicted = said * gains[slot][0] * at(DVec3::Z);
            assert!((predicted / (real * truth(DVec3::Z)) - 1.0).abs() < 0.08, "{slot}: {predicted}");
        }
        assert_eq!(gains[2], [1.0; 3], "what was not seen keeps what was said");
    }

    #[test]
    fn a_third_of_wrong_pixels_does_not_turn_the_light() {
        let truth = |n: DVec3| 0.8 + 0.3 * n.y;
        let mut all = seen(truth, [0.5; 3], [0.5; 3], 0);
        for s in all.iter_mut().step_by(3) {
            s.photo = [0.02; 3];
        }
        let (law, gains) = fit(&all, &[false], &ROOM);
        let predicted = 0.5 * gains[0][0] * law.at(DVec3::Y, DVec3::new(1.5, 0.4, 2.0), 1.0);
        assert!((predicted / 0.55 - 1.0).abs() < 0.15, "{predicted}");
    }

    #[test]
    fn in_lamplight_all_that_was_said_for_white_light_is_yellow_and_a_foreign_slot_too() {
        let lamp = [1.3, 1.0, 0.45];
        let mut all = Vec::new();
        for slot in 0..8 {
            let paint = [0.6 - 0.04 * slot as f64, 0.3, 0.2 + 0.05 * slot as f64];
            let samples = seen(|_| 1.0, [0.5; 3], std::array::from_fn(|k| paint[k] * lamp[k]), slot);
            all.extend(samples.into_iter().map(|s| Sample { said: paint, ..s }));
        }
        // A mask that shows something blue.
        let blue = seen(|_| 1.0, [0.5; 3], [0.02, 0.1, 0.6], 8);
        all.extend(blue.into_iter().map(|s| Sample { said: [0.5; 3], ..s }));
        let (_, gains) = fit(&all, &[false; 10], &ROOM);
        for slot in [0, 7, 8, 9] {
            let ratio = gains[slot][0] / gains[slot][2];
            assert!((2.3..3.4).contains(&ratio), "slot {slot}: {:?}", gains[slot]);
        }
        // In white light nothing that is not seen changes its hue.
        let mut white = Vec::new();
        for slot in 0..8 {
            white.extend(seen(|_| 1.0, [0.5; 3], [0.4; 3], slot));
        }
        let (_, gains) = fit(&white, &[false; 9], &ROOM);
        assert!(gains[8].iter().all(|g| (g - gains[8][0]).abs() < 1e-6), "{:?}", gains[8]);
    }

    #[test]
    fn pixels_of_another_hue_do_not_recolour_a_slot() {
        // What was said to be red shows leather: its outline is off.
        let mut all = seen(|_| 1.0, [0.5; 3], [0.5; 3], 0);
        let (red, leather) = ([0.3, 0.035, 0.025], [0.43, 0.25, 0.12]);
        all.extend(seen(|_| 1.0, red, leather, 1).into_iter().map(|s| Sample { said: red, ..s }));
        let (_, gains) = fit(&all, &[false; 2], &ROOM);
        assert_eq!(gains[1], [1.0; 3]);
    }

    #[test]
    fn highlights_make_no_salmon_of_leather() {
        let leather = [0.3, 0.08, 0.03];
        let mut all = seen(|_| 1.0, [0.5; 3], [0.5; 3], 0);
        let mirrored = |i: usize| if i % 5 < 3 { [0.06, 0.057, 0.054] } else { [0.0; 3] };
        all.extend(seen(|_| 1.0, leather, leather, 1).into_iter().enumerate().map(|(i, s)| {
            let photo = std::array::from_fn(|k| leather[k] + mirrored(i)[k]);
            Sample { photo, said: leather, ..s }
        }));
        let warmth = |glossy: bool| {
            let (_, gains) = fit(&all, &[false, glossy], &ROOM);
            gains[1][0] / gains[1][2]
        };
        assert!((warmth(true) - 1.0).abs() < 0.05, "{}", warmth(true));
        // Its median is a highlight.
        assert!(warmth(false) < 0.9, "{}", warmth(false));
    }

    #[test]
    fn without_pixels_the_law_is_a_usual_room() {
        let (law, gains) = fit(&[], &[false], &ROOM);
        let at = |n: DVec3, open: f64| law.at(n, DVec3::new(2.0, 1.25, 2.5), open);
        assert_eq!(gains, vec![[1.0; 3]]);
        assert!(at(DVec3::Y, 1.0) > at(DVec3::NEG_Y, 1.0) && at(DVec3::Y, 0.3) < 0.7);
    }
}
