//! Faces as materials: what was seen of each, continued; and what was not seen (`unseen`), in its neighbours' material.

mod unseen;

use std::collections::BTreeMap;

use harmony_imaging::color::lab_distance;
use harmony_imaging::tile::{Grain, Look, Survey};
use harmony_prompts::{LayoutPart, LayoutPartKind, LayoutPattern, LayoutSurface};
use harmony_scene::{Extents, Room, Surface};
use image::{RgbaImage, imageops};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::evidence::Face;
use super::pattern::named_look;
use unseen::{ENOUGH, Light, ONE_PAINT, Plain, of_one_paint};

/// A face of which less is seen takes its neighbours' material, square metres.
const MIN_SEEN: f64 = 0.12;
const SEED: u64 = 0x5eed;

/// A level stretch of a face: the whole of it, but on walls with parts.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Strip {
    /// Heights, metres; the whole face when it is no wall.
    from: f64,
    to: f64,
    kind: Option<LayoutPartKind>,
    color: Option<[u8; 3]>,
}

/// A strip with what was seen of it.
struct Piece {
    surface: Surface,
    strip: Strip,
    rows: [u32; 2],
    size: [u32; 2],
    survey: Option<Survey>,
    grain: Grain,
    px_per_m: f64,
}

/// A strip's textures and a line about it.
struct PaintedPiece {
    image: RgbaImage,
    even: Option<RgbaImage>,
    note: Value,
}

/// The faces' textures and a line about each.
pub struct Painted {
    /// In the photo's light; opaque.
    pub textures: BTreeMap<Surface, RgbaImage>,
    /// Under even light, for whoever lights them again; empty where nobody does, and where nobody looked at the photo, for
    /// what stands in the room is paint on the faces then.
    pub even: BTreeMap<Surface, RgbaImage>,
    /// What each was made from.
    pub notes: Vec<Value>,
}

/// Paints all faces. Where nobody looked at the photo (`is_seen`) grain and pattern of what was seen are those of things on
/// it, a rug or a shelf, and are not taken any further. `is_lit`: the path tracer will light them.
pub fn paint(faces: &[Face], answer: &[LayoutSurface], room: &Room, is_seen: bool, is_lit: bool) -> Painted {
    let extents = &room.extents;
    let strips = all_strips(answer, extents);
    let jobs: Vec<(&Face, Strip)> =
        faces.iter().flat_map(|f| strips[&f.surface].iter().map(move |s| (f, *s))).collect();
    let mut pieces: Vec<Piece> = jobs.into_par_iter().map(|(face, strip)| Piece::of(face, strip, extents)).collect();
    if !is_seen {
        for survey in pieces.iter_mut().filter_map(|p| p.survey.as_mut()) {
            survey.look = Look::plain(survey.look.color, SEED);
        }
    }
    let light = Light::of(&pieces, answer);
    let plain = Plain::of(&pieces, room);
    of_one_paint(&mut pieces, answer);
    let painted: Vec<PaintedPiece> =
        pieces.par_iter().map(|piece| piece.painted(&pieces, &plain, &light, answer, is_seen && is_lit)).collect();
    Painted {
        textures: whole(faces, &pieces, &painted, |p| Some(&p.image)),
        even: whole(faces, &pieces, &painted, |p| p.even.as_ref()),
        notes: painted.iter().map(|p| p.note.clone()).collect(),
    }
}

/// The faces that have textures of that kind, put together from their strips.
fn whole(
    faces: &[Face],
    pieces: &[Piece],
    painted: &[PaintedPiece],
    of: impl Fn(&PaintedPiece) -> Option<&RgbaImage>,
) -> BTreeMap<Surface, RgbaImage> {
    let face = |face: &Face| {
        let mut whole = RgbaImage::new(face.texture.width(), face.texture.height());
        for (piece, painted) in pieces.iter().zip(painted).filter(|(p, _)| p.surface == face.surface) {
            imageops::replace(&mut whole, of(painted)?, 0, i64::from(piece.rows[0]));
        }
        Some((face.surface, whole))
    };
    faces.iter().filter_map(face).collect()
}

/// The strips of every face. A wainscot goes round the room, whichever wall it was named on, but for walls that were
/// described without it.
fn all_strips(answer: &[LayoutSurface], extents: &Extents) -> BTreeMap<Surface, Vec<Strip>> {
    let round = goes_round(answer);
    let strips = |surface: Surface| {
        let mut whole = vec![Strip { from: 0.0, to: surface.size(extents).y, kind: None, color: None }];
        if surface.wall().is_none() {
            return whole;
        }
        let named = answer.iter().find(|s| s.surface.surface() == surface);
        let own = named.map_or(&[][..], |s| &s.parts);
        for part in own.iter().chain(round.filter(|_| named.is_none())) {
            whole = cut(&whole, part);
        }
        whole
    };
    Surface::ALL.into_iter().map(|s| (s, strips(s))).collect()
}

/// What walls have that were not described: the wainscot of those that were.
pub(super) fn goes_round(answer: &[LayoutSurface]) -> Option<&LayoutPart> {
    answer.iter().flat_map(|s| &s.parts).find(|p| p.kind == LayoutPartKind::Wainscot)
}

/// The strips with a part laid over them.
fn cut(strips: &[Strip], part: &LayoutPart) -> Vec<Strip> {
    let top = strips.last().map_or(0.0, |s| s.to);
    let (from, to) = (part.from_m.max(0.0), part.to_m.min(top));
    // A part that is hardly there, or leaves hardly anything, is no part.
    if to - from < 0.04 {
        return strips.to_vec();
    }
    let from = if from < 0.04 { 0.0 } else { from };
    let to = if top - to < 0.04 { top } else { to };
    let mut out = Vec::new();
    for s in strips {
        let below = Strip { to: s.to.min(from), ..*s };
        let above = Strip { from: s.from.max(to), ..*s };
        out.extend([below, above].into_iter().filter(|k| k.to - k.from > 1e-6));
    }
    out.push(Strip { from, to, kind: Some(part.kind), color: part.rgb() });
    out.sort_by(|a, b| a.from.total_cmp(&b.from));
    out
}

impl Piece {
    fn of(face: &Face, strip: Strip, extents: &Extents) -> Self {
        let (width, height) = face.texture.dimensions();
        let is_wall = face.surface.wall().is_some();
        let row = |v: f64| {
            (f64::from(height) * (1.0 - v / extents.height.max(0.1))).round().clamp(0.0, f64::from(height)) as u32
        };
        let rows = if is_wall { [row(strip.to), row(strip.from)] } else { [0, height] };
        let tall = rows[1].saturating_sub(rows[0]);
        let texture = imageops::crop_imm(&face.texture, 0, rows[0], width, tall).to_image();
        let coarse = face.surface == Surface::Floor || strip.kind.is_some_and(|k| k != LayoutPartKind::Accent);
        let grain = if coarse { Grain::Coarse } else { Grain::Fine };
        let fineness = face.fineness.from_row(rows[0] as usize);
        let survey = Survey::of(&texture, &fineness, face.px_per_m, grain, SEED ^ face.surface as u64);
        Self { surface: face.surface, strip, rows, size: [width, tall], survey, grain, px_per_m: face.px_per_m }
    }

    fn seen(&self) -> Option<&Survey> {
        self.survey.as_ref().filter(|s| s.seen_area >= MIN_SEEN)
    }

    /// The strip's textures; the one under even light where it is wanted.
    fn painted(
        &self,
        all: &[Self],
        plain: &Plain,
        light: &Light,
        answer: &[LayoutSurface],
        is_even_wanted: bool,
    ) -> PaintedPiece {
        let named = self.named_pattern(answer);
        let paper = self.same_paper(all, answer);
        let (look, image, from) = if let (Some(own), Some(paper)) = (self.seen(), &paper) {
            let look = paper.tinted(own.look.color);
            let image = own.complete_as(&look);
            (look, image, "what was seen of it, in the pattern of a wall that was named alike")
        } else if let Some(own) = self.seen() {
            match named.and_then(|n| named_look(n, &own.look, Some(own), self.px_per_m, SEED)) {
                Some(look) => {
                    let image = own.complete_as(&look);
                    (look, image, "what was seen of it, in the named pattern")
                }
                None => match self.alike_seen_better(all, answer) {
                    Some(look) => {
                        (look.clone(), own.complete_as(&look), "what was seen of it, and the grain of a wall like it")
                    }
                    None => (own.look.clone(), own.complete(), "what was seen of it"),
                },
            }
        } else {
            let (look, from) = self.borrowed(all, plain, light, answer);
            let (look, from) = match paper {
                Some(paper) => {
                    (paper.tinted(look.color), "the layout answer, in the pattern of a wall that was named alike")
                }
                None => (named.and_then(|n| named_look(n, &look, None, self.px_per_m, SEED)).unwrap_or(look), from),
            };
            let image = match &self.survey {
                // The little that was seen stays.
                Some(survey) => survey.complete_in(&look),
                None => look.paint(self.size[0], self.size[1]),
            };
            (look, image, from)
        };
        let even = is_even_wanted.then(|| match &self.survey {
            Some(survey) => survey.even(&look, self.grain),
            None => image.clone(),
        });
        let look = self.survey.as_ref().map(|s| &s.look);
        let note = json!({
            "surface": self.surface, "heights_m": [self.strip.from, self.strip.to], "part": self.strip.kind,
            "seen_m2": self.survey.as_ref().map_or(0.0, |s| (s.seen_area * 1000.0).round() / 1000.0),
            "from": from, "color": look.map(|l| l.color.map(|c| c.round() as u8)),
            "periods_px": look.and_then(Look::periods).map(|p| p.map(|v| [v.x, v.y])),
        });
        PaintedPiece { image, even, note }
    }

    /// The paper of a wall that was named like this one, where the photo shows its repeat and not this one's: of one colour and
    /// pattern, they are of one paper, and its picture says more than a name.
    fn same_paper<'a>(&self, all: &'a [Self], answer: &[LayoutSurface]) -> Option<&'a Look> {
        let whole = |p: &Self| p.surface.wall().is_some() && p.strip.kind.is_none();
        let repeats = |p: &Self| p.seen().is_some_and(|s| s.look.periods().is_some());
        let named = |p: &Self| {
            let of_face = answer.iter().find(|s| s.surface.surface() == p.surface)?;
            Some((of_face.rgb()?, of_face.pattern.as_ref()?.kind))
        };
        let (own, kind) = named(self).filter(|_| whole(self) && !repeats(self))?;
        let alike = |p: &&Self| {
            let as_fine = (p.px_per_m / self.px_per_m - 1.0).abs() < 0.01;
            named(p).is_some_and(|(color, other)| as_fine && other == kind && lab_distance(color, own) < ONE_PAINT)
        };
        let others = all.iter().filter(|p| whole(p) && repeats(p)).filter(alike);
        let best = others.filter_map(|p| p.seen()).max_by(|a, b| a.seen_area.total_cmp(&b.seen_area))?;
        Some(&best.look)
    }

    /// What a wall goes on as of which too little is seen to tell its grain, and which was named without a pattern: the grain of
    /// the wall that was named alike and shows most, or none. The mouldings of a casing in a strip a hand wide had become the
    /// wainscot of a whole wall.
    fn alike_seen_better(&self, all: &[Self], answer: &[LayoutSurface]) -> Option<Look> {
        let plain = |p: &Self| {
            let named = answer.iter().find(|s| s.surface.surface() == p.surface)?;
            let is_wall = p.surface.wall().is_some() && p.strip.kind.is_none();
            named.rgb().filter(|_| is_wall && named.pattern.is_none())
        };
        let (own, named) = (self.seen()?, plain(self)?);
        if own.seen_area >= ENOUGH || own.look.periods().is_some() {
            return None;
        }
        let alike = |p: &&Self| plain(p).is_some_and(|color| lab_distance(color, named) < ONE_PAINT);
        let others = all.iter().filter(alike).filter_map(Self::seen).filter(|s| s.seen_area >= ENOUGH);
        let best = others.max_by(|a, b| a.seen_area.total_cmp(&b.seen_area));
        let color = own.look.color;
        Some(best.map_or_else(|| Look::plain(color, SEED), |other| other.look.tinted(color)))
    }

    /// The pattern that the answer gives this strip.
    fn named_pattern<'a>(&self, answer: &'a [LayoutSurface]) -> Option<&'a LayoutPattern> {
        let of_face = |s: &&LayoutSurface| s.surface.surface() == self.surface;
        match self.strip.kind {
            Some(kind) => {
                let own = answer.iter().filter(of_face).chain(answer);
                own.flat_map(|s| &s.parts).find(|p| p.kind == kind).and_then(|p| p.pattern.as_ref())
            }
            None => answer.iter().find(of_face).and_then(|s| s.pattern.as_ref()),
        }
    }

    /// The material of a strip of which nothing, or hardly anything, was seen.
    fn borrowed(&self, all: &[Self], plain: &Plain, light: &Light, answer: &[LayoutSurface]) -> (Look, &'static str) {
        let named = match self.strip.kind {
            Some(_) => self.strip.color,
            None => answer.iter().find(|s| s.surface.surface() == self.surface).and_then(LayoutSurface::rgb),
        };
        // The same part elsewhere.
        if let Some(kind) = self.strip.kind {
            let same = all.iter().filter(|p| p.strip.kind == Some(kind)).filter_map(Self::seen);
            if let Some(other) = same.max_by(|a, b| a.seen_area.total_cmp(&b.seen_area)) {
                return (other.look.clone(), "the same part of another wall");
            }
        }
        let base = &plain.look;
        match (self.surface, named) {
            (Surface::Floor, Some(color)) => (Look::plain(light.on(color), SEED), "the layout answer"),
            (Surface::Floor, None) => (Look::plain(base.color.map(|c| c * 0.6), SEED), "a guess"),
            (Surface::Ceiling, Some(color)) => (base.unpatterned().tinted(light.on(color)), "the layout answer"),
            (Surface::Ceiling, None) => {
                (base.unpatterned().tinted(base.color.map(|c| c + (255.0 - c) / 2.0)), "the plainest wall, whiter")
            }
            (_, Some(color)) => (base.tinted(light.on(color)), "the layout answer's colour, the plainest wall's grain"),
            (_, None) => (plain.on(self.surface), "the plainest wall"),
        }
    }
}

#[cfg(test)]
mod tests {
    use harmony_imaging::tile::Fineness;
    use harmony_prompts::SurfaceName;
    use harmony_scene::{Opening, OpeningKind, Wall};
    use image::Rgba;

    use super::unseen::FACING;
    use super::*;

    const ROOM: Extents = Extents { width: 3.0, height: 2.5, depth: 4.0 };

    fn room(windows: &[Wall]) -> Room {
        let window = |wall| Opening {
            kind: OpeningKind::Window,
            wall,
            u: [1.0, 2.0],
            y: [0.9, 2.0],
            inset: 0.0,
            rise: 0.0,
            object: None,
        };
        Room {
            room_type: "bedroom".into(),
            extents: ROOM,
            shape: harmony_scene::RoomShape::default(),
            seen: vec![],
            openings: windows.iter().map(|w| window(*w)).collect(),
            floor_texture: None,
            wall_texture: None,
        }
    }

    fn face(surface: Surface, color: Option<[u8; 3]>) -> Face {
        let size = surface.size(&ROOM);
        let (w, h) = ((size.x * 50.0) as u32, (size.y * 50.0) as u32);
        let texture = RgbaImage::from_fn(w, h, |x, y| match color {
            Some([r, g, b]) if x > w / 3 => Rgba([r, g, b.saturating_add(((x * 7 + y * 3) % 4) as u8), 255]),
            _ => Rgba([0; 4]),
        });
        Face { surface, fineness: Fineness::full(w as usize, h as usize), texture, px_per_m: 50.0 }
    }

    fn faces(colors: [Option<[u8; 3]>; 6]) -> Vec<Face> {
        Surface::ALL.into_iter().zip(colors).map(|(s, c)| face(s, c)).collect()
    }

    fn mean(image: &RgbaImage) -> [f64; 3] {
        let n = f64::from(image.width() * image.height());
        let sum = image.pixels().fold([0.0; 3], |s, p| std::array::from_fn(|c| s[c] + f64::from(p.0[c])));
        sum.map(|s| s / n)
    }

    #[test]
    fn an_unseen_wall_takes_the_plain_neighbours_colour_not_the_accent_walls() {
        let (blue, grey) = ([40, 80, 140], [190, 186, 178]);
        let painted =
            paint(&faces([Some([90, 80, 70]), None, Some(blue), Some(grey), None, None]), &[], &room(&[]), true, false);
        for surface in [Surface::Right, Surface::Front] {
            let color = mean(&painted.textures[&surface]);
            assert!(color.iter().zip(grey).all(|(a, b)| (a - f64::from(b)).abs() < 5.0), "{surface:?}: {color:?}");
        }
        let ceiling = mean(&painted.textures[&Surface::Ceiling]);
        assert!(ceiling[0] > 210.0, "a ceiling is whiter: {ceiling:?}");
        let back = mean(&painted.textures[&Surface::Back]);
        assert!(back[2] > back[0] + 80.0, "the accent wall stays: {back:?}");
        assert!(painted.textures.values().flat_map(|t| t.pixels()).all(|p| p.0[3] == 255));
    }

    #[test]
    fn a_wall_that_faces_the_window_is_lighter_than_the_windows_own() {
        let painted =
            paint(&faces([None, None, Some([150; 3]), None, None, None]), &[], &room(&[Wall::Back]), true, false);
        let right = mean(&painted.textures[&Surface::Right]);
        assert!((right[0] - 150.0 * f64::from(FACING)).abs() < 4.0, "{right:?}");
    }

    #[test]
    fn a_named_colour_is_seen_under_the_rooms_light() {
        let named = |surface, hex: &str| LayoutSurface {
            surface,
            color_hex: Some(hex.into()),
            finish: None,
            pattern: None,
            parts: vec![],
        };
        // The back wall is named at 200 and seen at 150: three quarters of the light.
        let answer = [named(SurfaceName::WallBack, "#c8c8c8"), named(SurfaceName::WallRight, "#50a0a0")];
        let painted = paint(&faces([None, None, Some([150; 3]), None, None, None]), &answer, &room(&[]), true, false);
        let right = mean(&painted.textures[&Surface::Right]);
        assert!((right[0] - 60.0).abs() < 5.0 && (right[1] - 120.0).abs() < 5.0, "{right:?}");
    }

    #[test]
    fn a_wall_named_as_a_seen_one_looks_like_it_whatever_the_others_do() {
        let named = |surface, hex: &str| LayoutSurface {
            surface,
            color_hex: Some(hex.into()),
            finish: None,
            pattern: None,
            parts: vec![],
        };
        // A white wall of which the photo shows grey, and a floor and a blue wall that were named in other ways.
        let answer = [
            named(SurfaceName::Floor, "#8a7a5a"),
            named(SurfaceName::WallBack, "#f0ece6"),
            named(SurfaceName::WallLeft, "#3a5470"),
            named(SurfaceName::WallRight, "#f0ece6"),
        ];
        let seen = [Some([150, 100, 60]), None, Some([180, 176, 170]), Some([40, 90, 150]), None, None];
        let painted = paint(&faces(seen), &answer, &room(&[]), true, false);
        let right = mean(&painted.textures[&Surface::Right]);
        assert!(right.iter().zip([180.0, 176.0, 170.0]).all(|(a, b)| (a - b).abs() < 8.0), "{right:?}");
    }

    #[test]
    fn a_strip_of_a_dark_corner_is_not_what_its_whole_wall_looks_like() {
        let named = |surface| LayoutSurface {
            surface,
            color_hex: Some("#b0b0b0".into()),
            finish: None,
            pattern: None,
            parts: vec![],
        };
        let mut all = faces([None, None, Some([150; 3]), Some([70; 3]), None, None]);
        for (x, _, p) in all[3].texture.enumerate_pixels_mut() {
            // 10 cm, floor to ceiling.
            p.0[3] = if (80..85).contains(&x) { 255 } else { 0 };
        }
        let far = |answer: &[LayoutSurface]| {
            let painted = paint(&all, answer, &room(&[]), true, false);
            let left = &painted.textures[&Surface::Left];
            assert!(left.get_pixel(82, 60).0[0] < 85, "what was seen stays");
            left.get_pixel(190, 60).0[0]
        };
        let both = [named(SurfaceName::WallBack), named(SurfaceName::WallLeft)];
        assert!((105..140).contains(&far(&both)), "{}", far(&both));
        assert!(far(&both[..1]) < 85, "nobody said that they are of one paint");
    }

    #[test]
    fn a_few_boards_that_mirror_a_door_are_not_what_a_dark_floor_looks_like() {
        let dark = LayoutSurface {
            surface: SurfaceName::Floor,
            color_hex: Some("#5a3426".into()),
            finish: None,
            pattern: None,
            parts: vec![],
        };
        let far = |last: u32| {
            let mut all = faces([Some([150, 100, 70]), None, Some([200; 3]), Some([200; 3]), None, None]);
            all.iter_mut().filter(|f| f.surface == Surface::Floor).for_each(|f| {
                for (x, y, p) in f.texture.enumerate_pixels_mut() {
                    p.0[3] = if (90..90 + last).contains(&x) && y < 50 { 255 } else { 0 };
                }
            });
            let painted = paint(&all, std::slice::from_ref(&dark), &room(&[]), true, false);
            mean(&painted.textures[&Surface::Floor])[0]
        };
        assert!((60.0..105.0).contains(&far(12)), "{}", far(12));
        assert!(far(50) > 130.0, "a square metre is what the floor looks like: {}", far(50));
    }

    #[test]
    fn the_mouldings_in_a_narrow_strip_are_not_what_a_plain_wall_goes_on_as() {
        let mut all = faces([None, None, Some([150, 140, 120]), None, None, None]);
        let right = all.iter_mut().find(|f| f.surface == Surface::Right).unwrap();
        let (w, h) = right.texture.dimensions();
        right.texture = RgbaImage::from_fn(w, h, |x, _| {
            let tone = if (x / 3).is_multiple_of(2) { 150 } else { 110 };
            if x < 12 { Rgba([tone, tone - 10, tone - 30, 255]) } else { Rgba([0; 4]) }
        });
        let named = |wall| {
            serde_json::from_value(json!({ "surface": wall, "color_hex": "#c2ab88", "finish": "matt" })).unwrap()
        };
        let answer: Vec<LayoutSurface> = vec![named("wall_back"), named("wall_right")];
        let painted = paint(&all, &answer, &room(&[]), true, false);
        let right = &painted.textures[&Surface::Right];
        let rough = |x: u32| {
            (20..100)
                .map(|y| u32::from(right.get_pixel(x, y).0[0].abs_diff(right.get_pixel(x + 3, y).0[0])))
                .sum::<u32>()
        };
        let far: u32 = (60..90).map(rough).sum::<u32>() / 30;
        assert!(far < 80 * 8, "stripes go on: {far}");
        assert!(rough(3) > 80 * 20, "what was seen stays: {}", rough(3));
    }

    #[test]
    fn walls_of_one_paper_repeat_the_wall_that_shows_its_repeat() {
        let pattern = LayoutPattern {
            kind: harmony_prompts::LayoutPatternKind::Motif,
            width_m: 0.2,
            length_m: 0.2,
            joint_m: 0.0,
            turn_deg: 0.0,
            colors: vec!["#b0b0a0".into(), "#303040".into()],
        };
        let named = |surface, pattern: Option<&LayoutPattern>| LayoutSurface {
            surface,
            color_hex: Some("#b0b0a0".into()),
            finish: None,
            pattern: pattern.cloned(),
            parts: vec![],
        };
        let mut all = faces([None, None, Some([170; 3]), Some([120; 3]), None, None]);
        // A cross every 17 by 13 texels, which no named motif is.
        for (x, y, p) in all[2].texture.enumerate_pixels_mut().filter(|(_, _, p)| p.0[3] > 0) {
            let (u, v) = (x % 17, y % 13);
            if (u == 8 && v < 7) || (v == 3 && (5..12).contains(&u)) {
                p.0 = [50, 50, 70, 255];
            }
        }
        let repeats = |answer: &[LayoutSurface], surface: Surface| {
            let painted = paint(&all, answer, &room(&[]), true, false);
            let wall = &painted.textures[&surface];
            // Along a row, how well it repeats after 17 texels, and not after 10.
            let at = |x: u32, y: u32| f64::from(wall.get_pixel(x, y).0[0]);
            let off = |by: u32| -> f64 {
                let points = (2..20).flat_map(|x| (20..60).map(move |y| (x, y)));
                points.map(|(x, y)| (at(x, y) - at(x + by, y)).abs()).sum()
            };
            off(17) < 0.6 * off(10)
        };
        let both = [
            named(SurfaceName::WallBack, Some(&pattern)),
            named(SurfaceName::WallLeft, Some(&pattern)),
            named(SurfaceName::WallRight, Some(&pattern)),
        ];
        assert!(repeats(&both, Surface::Left) && repeats(&both, Surface::Right));
        let apart = [named(SurfaceName::WallBack, Some(&pattern)), named(SurfaceName::WallLeft, None)];
        assert!(!repeats(&apart, Surface::Left), "nobody said so");
    }

    #[test]
    fn a_wainscot_goes_round_the_room_at_its_height() {
        let part =
            LayoutPart { kind: LayoutPartKind::Wainscot, from_m: 0.0, to_m: 1.0, color_hex: None, pattern: None };
        let of = |surface: SurfaceName, parts: Vec<LayoutPart>| LayoutSurface {
            surface,
            color_hex: None,
            finish: None,
            pattern: None,
            parts,
        };
        let answer = [of(SurfaceName::WallBack, vec![part]), of(SurfaceName::WallLeft, Vec::new())];
        let strips = all_strips(&answer, &room(&[]).extents);
        let counts = [Surface::Back, Surface::Right, Surface::Front, Surface::Left].map(|s| strips[&s].len());
        assert_eq!(counts, [2, 2, 2, 1], "a wall that was described without it has none");
        let mut all = faces([None, None, Some([200, 198, 196]), None, None, None]);
        for (_, y, p) in all[2].texture.enumerate_pixels_mut().filter(|(_, _, p)| p.0[3] > 0) {
            if y >= 75 {
                *p = Rgba([70, 110, 80, 255]);
            }
        }
        let painted = paint(&all, &answer, &room(&[]), true, false);
        let front = &painted.textures[&Surface::Front];
        assert!(front.get_pixel(60, 60).0[0] > 185 && front.get_pixel(60, 90).0[0] < 90);
        // The edge is sharp where nothing was seen, too.
        let back = &painted.textures[&Surface::Back];
        assert!(back.get_pixel(5, 73).0[0] > 185 && back.get_pixel(5, 77).0[0] < 90);
    }

    #[test]
    fn what_is_lit_again_holds_no_shadow_and_nothing_is_made_for_nobody() {
        let mut all = faces([Some([160, 140, 120]), None, Some([200; 3]), None, None, None]);
        // A shadow with a sharp edge over the nearer half of the floor.
        let half = all[0].texture.height() / 2;
        for (_, _, p) in all[0].texture.enumerate_pixels_mut().filter(|(_, y, _)| *y >= half) {
            p.0 = [p.0[0] / 2, p.0[1] / 2, p.0[2] / 2, p.0[3]];
        }
        let painted = paint(&all, &[], &room(&[]), true, true);
        let tones = |of: &BTreeMap<Surface, RgbaImage>| {
            let floor = &of[&Surface::Floor];
            [half - 40, half + 40].map(|y| f64::from(floor.get_pixel(120, y).0[0]))
        };
        let ([bright, dark], [far, near]) = (tones(&painted.textures), tones(&painted.even));
        assert!(bright / dark > 1.8 && (far / near - 1.0).abs() < 0.1, "{bright} {dark}, {far} {near}");
        assert_eq!(painted.even.len(), Surface::ALL.len());
        assert!(paint(&all, &[], &room(&[]), true, false).even.is_empty(), "nobody lights them");
        assert!(paint(&all, &[], &room(&[]), false, true).even.is_empty(), "things are paint on them");
    }

    #[test]
    fn what_nobody_looked_at_lends_its_colour_alone() {
        let mut all = faces([Some([120, 110, 100]), None, None, None, None, None]);
        // Things stand all over the part of the floor that is seen.
        for (x, y, p) in all[0].texture.enumerate_pixels_mut().filter(|(_, _, p)| p.0[3] > 0) {
            if (x / 6 + y / 6).is_multiple_of(3) || (x * y).is_multiple_of(7) {
                *p = Rgba([40, 30, 30, 255]);
            }
        }
        let spread = |is_seen: bool| {
            let floor = &paint(&all, &[], &room(&[]), is_seen, false).textures[&Surface::Floor];
            let tones = floor.enumerate_pixels().filter(|(x, _, _)| *x < 20).map(|(_, _, p)| f64::from(p.0[0]));
            let (n, sum, squares) = tones.fold((0.0, 0.0, 0.0), |(n, s, q), v| (n + 1.0, s + v, q + v * v));
            (squares / n - (sum / n) * (sum / n)).sqrt()
        };
        assert!(spread(false) < 3.0 && spread(true) > 10.0, "{} and {}", spread(false), spread(true));
    }
}
