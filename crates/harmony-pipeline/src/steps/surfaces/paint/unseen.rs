//! What a face looks like of which the photo shows too little: the usual wall's material, the named colour in the room's light,
//! and what was seen of faces that were named alike.

use harmony_imaging::color::{lab_distance, lab_from_rgb8};
use harmony_imaging::tile::{Look, Survey};
use harmony_prompts::LayoutSurface;
use harmony_scene::{OpeningKind, Room, Surface};

use super::{Piece, SEED};

/// Seen area beyond which more of it says no more about what is usual in the room, square metres.
pub(super) const ENOUGH: f64 = 0.8;
/// Chroma (Lab) that outweighs one such area: an accent wall is the most colourful one.
const COLOURFUL: f64 = 10.0;
/// Lightness (Lab) that is worth one such area.
const LIGHT: f64 = 200.0;
/// Chroma up to which a ceiling is taken for white under coloured light.
const WHITE: f32 = 15.0;
/// How much lighter a wall is that faces a window than the window's own, which has the light behind it.
pub(super) const FACING: f32 = 1.12;
/// Difference of named colours (Lab) up to which walls are of one paint.
pub(super) const ONE_PAINT: f64 = 3.0;

/// The material of walls that are not seen: that of the seen wall which is most likely the usual one.
pub(super) struct Plain {
    pub(super) look: Look,
    /// The walls with windows, when the seen one is among them.
    windows: Vec<Surface>,
}

impl Plain {
    /// Much of it is seen, it is light, and not colourful; colours are judged against a seen ceiling, taken for white.
    pub(super) fn of(pieces: &[Piece], room: &Room) -> Self {
        let lab = |survey: &Survey| lab_from_rgb8(survey.look.color.map(|c| c.round().clamp(0.0, 255.0) as u8));
        let ceiling = pieces.iter().filter(|p| p.surface == Surface::Ceiling).find_map(Piece::seen).map(lab);
        let white = ceiling.filter(|c| c[1].hypot(c[2]) < WHITE).unwrap_or([0.0; 3]);
        let score = |survey: &Survey| {
            let [l, a, b] = lab(survey);
            let chroma = (a - white[1]).hypot(b - white[2]);
            (survey.seen_area / ENOUGH).min(1.0) - f64::from(chroma) / COLOURFUL + f64::from(l) / LIGHT
        };
        let usual = pieces
            .iter()
            .filter(|p| p.surface.wall().is_some() && p.strip.kind.is_none())
            .filter_map(|p| Some((p.surface, p.seen()?)))
            .max_by(|a, b| score(a.1).total_cmp(&score(b.1)));
        let with_windows: Vec<Surface> =
            room.openings.iter().filter(|o| o.kind == OpeningKind::Window).map(|o| o.wall.surface()).collect();
        match usual {
            Some((surface, survey)) => {
                let windows = if with_windows.contains(&surface) { with_windows } else { Vec::new() };
                Self { look: survey.look.clone(), windows }
            }
            None => Self { look: Look::plain([168.0, 164.0, 158.0], SEED), windows: Vec::new() },
        }
    }

    /// The material on a wall that is not seen.
    pub(super) fn on(&self, surface: Surface) -> Look {
        if self.windows.is_empty() || self.windows.contains(&surface) {
            self.look.clone()
        } else {
            self.look.tinted(self.look.color.map(|c| (c * FACING).min(250.0)))
        }
    }
}

/// What photos make of the colours that walls are named, as a factor of the bytes: the median of 39 walls in 20 photos of
/// which more than [`ENOUGH`] was seen (a sixth more or less; 0.75 and twice as far off where less was seen).
const USUAL: f32 = 0.78;
/// What that says of a wall, against one of which enough was seen.
const USUAL_WEIGHT: f32 = 0.2;

/// What a face says of the light in the room, one of which enough was seen being 1. Little is often a dark corner: half as
/// much of a face says a quarter.
fn weight_of(survey: &Survey) -> f32 {
    (survey.seen_area / ENOUGH).min(1.0).powi(2) as f32
}

/// Walls of which little was seen take a share of the colour of the walls that were named alike, and of what photos usually
/// make of it: a strip of a dark corner is not what the whole wall looks like. So does a floor, by its own name alone: a few
/// boards behind a rug mirror a door.
pub(super) fn of_one_paint(pieces: &mut [Piece], answer: &[LayoutSurface]) {
    struct Seen {
        index: usize,
        is_floor: bool,
        named: [u8; 3],
        color: [f32; 3],
        weight: f32,
    }
    let whole = |p: &Piece| (p.surface.wall().is_some() || p.surface == Surface::Floor) && p.strip.kind.is_none();
    let seen: Vec<Seen> = pieces
        .iter()
        .enumerate()
        .filter(|(_, p)| whole(p))
        .filter_map(|(index, p)| {
            let survey = p.seen()?;
            let named = answer.iter().find(|s| s.surface.surface() == p.surface).and_then(LayoutSurface::rgb)?;
            let is_floor = p.surface == Surface::Floor;
            Some(Seen { index, is_floor, named, color: survey.look.color, weight: weight_of(survey) })
        })
        .collect();
    for own in seen.iter().filter(|s| s.weight < 1.0) {
        let alike = |s: &&Seen| s.is_floor == own.is_floor && lab_distance(s.named, own.named) < ONE_PAINT;
        let total: f32 = USUAL_WEIGHT + seen.iter().filter(alike).map(|s| s.weight).sum::<f32>();
        let color = std::array::from_fn(|k| {
            let usual = USUAL_WEIGHT * USUAL * f32::from(own.named[k]);
            let all = (usual + seen.iter().filter(alike).map(|s| s.weight * s.color[k]).sum::<f32>()) / total;
            own.weight * own.color[k] + (1.0 - own.weight) * all
        });
        let piece = &mut pieces[own.index];
        piece.survey = piece.survey.take().map(|survey| survey.settling_at(color));
    }
}

/// What the photo's light makes of colours that the answer gives.
pub(super) struct Light(Vec<Named>);

/// A face whose colour was both named and seen.
struct Named {
    color: [u8; 3],
    /// Logarithm of seen over named, by channel.
    ratio: [f32; 3],
    weight: f32,
}

/// Difference of colours (Lab) at which one says much less about the other.
const ALIKE: f32 = 10.0;
/// Weight of a floor or a ceiling against that of a wall: light falls on them at another angle.
const NOT_A_WALL: f32 = 0.2;

impl Light {
    pub(super) fn of(pieces: &[Piece], answer: &[LayoutSurface]) -> Self {
        let of_piece = |piece: &Piece| {
            let named = answer.iter().find(|s| s.surface.surface() == piece.surface).and_then(LayoutSurface::rgb)?;
            let survey = piece.seen()?;
            let ratio = |k: usize| (survey.look.color[k] / f32::from(named[k]).max(8.0)).clamp(0.2, 1.6).ln();
            let weight = if piece.surface.wall().is_some() { 1.0 } else { NOT_A_WALL };
            Some(Named { color: named, ratio: std::array::from_fn(ratio), weight: weight * weight_of(survey) })
        };
        Self(pieces.iter().filter(|p| p.strip.kind.is_none()).filter_map(of_piece).collect())
    }

    /// The named colour by the ratios of seen to named of the faces that were named alike, and by the usual one.
    pub(super) fn on(&self, color: [u8; 3]) -> [f32; 3] {
        let (mut sum, mut total) = ([USUAL_WEIGHT * USUAL.ln(); 3], USUAL_WEIGHT);
        for named in &self.0 {
            let off = lab_distance(named.color, color) as f32;
            let weight = named.weight * (-off / ALIKE).exp();
            total += weight;
            sum.iter_mut().zip(named.ratio).for_each(|(s, r)| *s += weight * r);
        }
        std::array::from_fn(|k| (f32::from(color[k]) * (sum[k] / total).exp()).clamp(0.0, 255.0))
    }
}
