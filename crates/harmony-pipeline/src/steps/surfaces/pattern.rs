//! Patterns that the layout answer names, at their size, fitted to what is seen.

use glam::{DMat2, DVec2};
use harmony_imaging::tile::{Look, Survey};
use harmony_prompts::{LayoutPattern, LayoutPatternKind as Named};
use harmony_shape::material::{MaterialSpec, Pattern, PatternFit, PatternKind, bake_tile, fit_evidence};
use image::RgbaImage;

/// A look with the named pattern, refined by what was seen: its size, its contrast (never more than was seen), and for
/// boards the grain, where that is rougher than the pattern's own. `None` when what was seen says more than the name: it
/// shows a repeat of its own, or the grain of something that has no pieces.
pub fn named_look(named: &LayoutPattern, look: &Look, seen: Option<&Survey>, px_per_m: f64, seed: u64) -> Option<Look> {
    let grainy = matches!(named.kind, Named::Carpet | Named::Concrete | Named::Marble | Named::Terrazzo);
    if seen.is_some_and(|s| grainy || s.look.periods().is_some()) {
        return None;
    }
    let hint = pattern(named);
    let fitted = seen.map_or_else(|| hint.clone(), |s| fitted(&hint, &s.delit(), px_per_m));
    let printed = |pattern: Pattern| printed(look, pattern, px_per_m, seed);
    let look = printed(fitted.clone());
    let Some((survey, own)) = seen.and_then(|s| Some((s, s.unevenness()?))) else { return Some(look) };
    let Some(as_named) = survey.unevenness_in(&look) else { return Some(look) };
    let contrast = (own.pieces / as_named.pieces.max(1e-4)).min(1.0);
    let boards = matches!(fitted.kind, PatternKind::Planks | PatternKind::Parquet);
    if boards && own.grain > ROUGHER * as_named.grain {
        // The seams are in the grain that was seen: boards that are laid over it differ by tone alone.
        let tones = printed(Pattern { joint: NO_JOINT, amount: NO_WOOD, ..fitted });
        return Some(tones.with_contrast(contrast).with_grain_of(&survey.look));
    }
    Some(look.with_contrast(contrast))
}

/// Grain this many times as rough as the named pattern's is what the photo shows: worn, scratched, knotty.
const ROUGHER: f32 = 1.8;
/// As good as nothing, where 0 is what is usual.
const NO_JOINT: f64 = 1e-5;
const NO_WOOD: f64 = 1e-3;

/// A look with a pattern at its size.
fn printed(look: &Look, pattern: Pattern, px_per_m: f64, seed: u64) -> Look {
    let [r, g, b] = look.color.map(|c| c.round().clamp(0.0, 255.0) as u8);
    let mut spec = MaterialSpec::plain("surface", &format!("#{r:02x}{g:02x}{b:02x}"));
    spec.map = Some(pattern);
    let tile = bake_tile(&spec, Some(1.0 / px_per_m));
    let DVec2 { x: cos, y: sin } = DVec2::from_angle(f64::from(tile.turn));
    let [width, height] = tile.size.map(|s| f64::from(s).max(1e-6));
    let cell_from_metres =
        DMat2::from_cols(DVec2::new(cos / width, -sin / height), DVec2::new(sin / width, cos / height));
    look.printed(&tile.color, cell_from_metres * (1.0 / px_per_m), seed)
}

/// How much more of what is seen another pattern than the named one must explain.
const CLEARLY: f64 = 0.12;

/// The named pattern fitted to what is seen; for planks or stripes the one that lies across it, and for stripes (one or
/// the repeat?) those of half or twice the width, where that explains clearly more.
fn fitted(hint: &Pattern, seen: &RgbaImage, px_per_m: f64) -> Pattern {
    let explained = |fit: &PatternFit| fit.along_u.unwrap_or(0.0).max(fit.along_v.unwrap_or(0.0));
    let mut best = fit_evidence(hint, seen, px_per_m);
    let mut most = explained(&best) + CLEARLY;
    let others: &[(f64, f64)] = match hint.kind {
        PatternKind::Stripes => &[(90.0, 1.0), (0.0, 0.5), (0.0, 2.0), (90.0, 0.5), (90.0, 2.0)],
        PatternKind::Planks => &[(90.0, 1.0)],
        _ => &[],
    };
    for (turn, scale) in others {
        let mut other = hint.clone();
        other.turn_deg += turn;
        other.width *= scale;
        other.length *= scale;
        let fit = fit_evidence(&other, seen, px_per_m);
        if explained(&fit) > most {
            most = explained(&fit);
            best = fit;
        }
    }
    best.pattern
}

/// Widest tuft of a carpet, metres.
const MAX_TUFT: f64 = 0.03;

/// The pattern as the answer describes it.
fn pattern(named: &LayoutPattern) -> Pattern {
    let (kind, variant) = match named.kind {
        Named::Planks | Named::Panels => (PatternKind::Planks, ""),
        Named::Parquet => (PatternKind::Parquet, "basket"),
        Named::Herringbone => (PatternKind::Parquet, "herringbone"),
        Named::Tiles => (PatternKind::Tiles, "stack"),
        Named::Checks => (PatternKind::Tiles, "checkerboard"),
        Named::Brick => (PatternKind::Brick, "running"),
        Named::Stripes => (PatternKind::Stripes, ""),
        Named::Dots => (PatternKind::Dots, ""),
        // The answer does not tell a figure's shape. Most figures of wallpapers are of plants.
        Named::Motif => (PatternKind::Motif, "leaf"),
        Named::Carpet => (PatternKind::Pile, ""),
        Named::Concrete => (PatternKind::Concrete, ""),
        Named::Marble => (PatternKind::Marble, ""),
        Named::Terrazzo => (PatternKind::Terrazzo, ""),
    };
    // Widths of tiles and bricks are those of the repeat.
    let repeat = matches!(kind, PatternKind::Tiles | PatternKind::Brick);
    let size = |metres: f64| if repeat && metres > 0.0 { metres + named.joint_m } else { metres };
    let mut pattern = Pattern::new(kind);
    variant.clone_into(&mut pattern.variant);
    let length = if named.length_m > 0.0 { named.length_m } else { named.width_m };
    // Planks run along u by their length. Tiles and bricks are as wide along u as the answer has them long; bricks lie.
    let (along, across) = match kind {
        PatternKind::Tiles => (length, named.width_m),
        PatternKind::Brick => (length.max(named.width_m), length.min(named.width_m)),
        _ => (named.width_m, named.length_m),
    };
    // A carpet's tufts are no wider than a finger: a larger width is that of a roll or of its tiles.
    if kind != PatternKind::Pile || along < MAX_TUFT {
        pattern.width = size(along);
        pattern.length = size(across);
    }
    pattern.joint = named.joint_m;
    // Counter-clockwise to whoever looks at the face, whose v runs down; our patterns turn u towards v, and our stripes stand
    // where the answer's lie.
    let across = if kind == PatternKind::Stripes { 90.0 } else { 0.0 };
    pattern.turn_deg = across - named.turn_deg;
    pattern.colors.clone_from(&named.colors);
    pattern
}

#[cfg(test)]
mod tests {
    use harmony_imaging::tile::{Fineness, Grain};

    use super::*;

    #[test]
    fn stripes_stand_as_they_are_seen_however_they_were_named() {
        // Vertical stripes, each 0.1 m, on what was named as lying stripes.
        let mut hint = Pattern::new(PatternKind::Stripes);
        (hint.width, hint.length, hint.turn_deg) = (0.1, 0.1, -90.0);
        hint.colors = vec!["#cdb398".into(), "#b3977a".into()];
        let tone = |x: u32| if (x / 10).is_multiple_of(2) { [205, 179, 152, 255] } else { [179, 151, 122, 255] };
        let seen = RgbaImage::from_fn(200, 160, |x, y| {
            let hidden = (60..130).contains(&x) && y > 70;
            image::Rgba(if hidden { [0; 4] } else { tone(x) })
        });
        let fit = fitted(&hint, &seen, 100.0);
        assert!(fit.turn_deg.rem_euclid(180.0).abs() < 1.0, "{}", fit.turn_deg);
    }

    #[test]
    fn stripes_that_were_named_level_lie_where_nothing_was_seen() {
        let named = |turn_deg: f64| LayoutPattern {
            kind: Named::Stripes,
            width_m: 0.25,
            length_m: 0.0,
            joint_m: 0.0,
            turn_deg,
            colors: vec!["#f0e0c0".into(), "#806040".into()],
        };
        let differs = |turn_deg: f64| {
            let painted =
                named_look(&named(turn_deg), &Look::plain([120.0; 3], 1), None, 100.0, 1).unwrap().paint(240, 240);
            let rough = |step: [u32; 2]| -> u32 {
                let pairs = (0..200).flat_map(|x| (0..200).map(move |y| (x, y)));
                let tone = |x: u32, y: u32| painted.get_pixel(x, y).0[1];
                pairs.map(|(x, y)| u32::from(tone(x, y).abs_diff(tone(x + step[0], y + step[1])))).sum()
            };
            [rough([20, 0]), rough([0, 20])]
        };
        let [along, up] = differs(0.0);
        assert!(up > 4 * along, "level stripes change upwards: {along} {up}");
        let [along, up] = differs(90.0);
        assert!(along > 4 * up, "upright ones along the wall: {along} {up}");
    }

    #[test]
    fn the_length_of_tiles_runs_as_that_of_planks() {
        let named = |kind: Named, width_m: f64, length_m: f64| LayoutPattern {
            kind,
            width_m,
            length_m,
            joint_m: 0.01,
            turn_deg: 0.0,
            colors: Vec::new(),
        };
        let along = |named: &LayoutPattern| {
            let p = pattern(named);
            [p.width, p.length].map(|v| (v * 1000.0).round())
        };
        assert_eq!(along(&named(Named::Tiles, 0.3, 0.44)), [450.0, 310.0]);
        assert_eq!(along(&named(Named::Tiles, 0.3, 0.0)), [310.0, 310.0]);
        assert_eq!(
            along(&named(Named::Brick, 0.24, 0.07)),
            [250.0, 80.0],
            "bricks lie, whichever side was called length"
        );
        assert_eq!(along(&named(Named::Planks, 0.14, 1.8)), [140.0, 1800.0]);
    }

    #[test]
    fn named_tiles_are_laid_at_their_size_where_nothing_was_seen() {
        let named = LayoutPattern {
            kind: Named::Checks,
            width_m: 0.3,
            length_m: 0.3,
            joint_m: 0.0,
            turn_deg: 0.0,
            colors: vec!["#f0f0f0".into(), "#202020".into()],
        };
        let look = Look::plain([120.0; 3], 1);
        let painted = named_look(&named, &look, None, 100.0, 1).unwrap().paint(240, 240);
        let tone = |x: u32, y: u32| painted.get_pixel(x, y).0[1] > 120;
        // Centres of 30 texel checks: neighbours differ, the second next is the same.
        for (x, y) in (0..6).flat_map(|i| (0..6).map(move |j| (15 + 30 * i, 15 + 30 * j))) {
            assert_ne!(tone(x, y), tone(x + 30, y), "{x} {y}");
            assert_ne!(tone(x, y), tone(x, y + 30), "{x} {y}");
        }
    }

    /// Planks of two named tones that are 60 % apart, and what the photo shows of the floor.
    fn planks(seen: impl Fn(u32, u32) -> f32) -> (Survey, Look) {
        let texture = RgbaImage::from_fn(360, 300, |x, y| {
            let v = (120.0 * seen(x, y)).round().clamp(0.0, 255.0) as u8;
            image::Rgba([v, v, v, 255])
        });
        let survey = Survey::of(&texture, &Fineness::full(360, 300), 160.0, Grain::Coarse, 5).unwrap();
        let named = LayoutPattern {
            kind: Named::Planks,
            width_m: 0.15,
            length_m: 2.0,
            joint_m: 0.004,
            turn_deg: 0.0,
            colors: vec!["#909090".into(), "#606060".into()],
        };
        let look = named_look(&named, &survey.look, Some(&survey), 160.0, 5).unwrap();
        (survey, look)
    }

    /// A hash of a place, -1 to 1.
    fn random(x: u32, y: u32) -> f32 {
        let h = (x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77)).wrapping_mul(0xC2B2_AE3D);
        ((h ^ h >> 15).wrapping_mul(0x2C1B_3C6D) >> 8) as f32 / f32::from(1_u16 << 15) / 256.0 - 1.0
    }

    #[test]
    fn worn_boards_keep_the_grain_that_was_seen() {
        let (survey, look) = planks(|x, y| 1.0 + 0.3 * random(x / 2, y / 6));
        let (seen, made) = (survey.unevenness().unwrap(), survey.unevenness_in(&look).unwrap());
        assert!(seen.grain > 0.1, "{seen:?}");
        assert!((0.7..1.3).contains(&(made.grain / seen.grain)), "{made:?} against {seen:?}");
    }

    #[test]
    fn boards_are_no_more_different_than_they_were_seen() {
        let (survey, look) = planks(|x, y| 1.0 + 0.02 * random(x / 400, y / 24) + 0.01 * random(x, y));
        let (seen, made) = (survey.unevenness().unwrap(), survey.unevenness_in(&look).unwrap());
        assert!(made.pieces < 1.3 * seen.pieces + 0.005, "{made:?} against {seen:?}");
        assert!(made.pieces > 0.3 * seen.pieces, "{made:?} against {seen:?}");
    }
}
