//! Tiles against what their patterns say, by counts of their own.

use image::{Rgba, RgbaImage};

use super::bake::field;
use super::color::{bytes_of, linear_hex, linear_of, luminance};
use super::noise::{gauss, hash};
use super::*;

const KINDS: [PatternKind; 26] = {
    use PatternKind as K;
    [
        K::Planks,
        K::Parquet,
        K::Tiles,
        K::Brick,
        K::Checks,
        K::Stripes,
        K::Dots,
        K::Motif,
        K::Weave,
        K::Knit,
        K::Terry,
        K::Boucle,
        K::Pile,
        K::Leather,
        K::Wood,
        K::Marble,
        K::Terrazzo,
        K::Concrete,
        K::Plaster,
        K::Rattan,
        K::Corrugated,
        K::Quilting,
        K::Grime,
        K::Ramp,
        K::Over,
        K::Tint,
    ]
};

fn spec(map: Pattern, color: &str) -> MaterialSpec {
    MaterialSpec { map: Some(map), ..MaterialSpec::plain("slot", color) }
}

fn pattern(kind: PatternKind, variant: &str, colors: &[&str]) -> Pattern {
    let layers = if matches!(kind, PatternKind::Over | PatternKind::Tint) {
        vec![pattern(PatternKind::Dots, "", &["#ffffff", "#a04030"]), pattern(PatternKind::Checks, "", &[])]
    } else {
        Vec::new()
    };
    Pattern {
        variant: variant.to_owned(),
        colors: colors.iter().map(|c| (*c).to_owned()).collect(),
        layers,
        ..Pattern::new(kind)
    }
}

/// Every kind, and every variant that has a layout of its own.
fn all() -> Vec<Pattern> {
    let mut list: Vec<Pattern> = KINDS.iter().map(|k| pattern(*k, "", &[])).collect();
    for (kind, variant) in [
        (PatternKind::Parquet, "chevron"),
        (PatternKind::Parquet, "basket"),
        (PatternKind::Tiles, "diagonal"),
        (PatternKind::Tiles, "hex"),
        (PatternKind::Tiles, "running"),
        (PatternKind::Brick, "flemish"),
        (PatternKind::Weave, "satin"),
        (PatternKind::Weave, "herringbone"),
        (PatternKind::Pile, "shag"),
        (PatternKind::Rattan, "cane"),
        (PatternKind::Quilting, "diamond"),
    ] {
        list.push(pattern(kind, variant, &[]));
    }
    list
}

fn mean_of(image: &RgbaImage) -> [f64; 3] {
    let n = image.pixels().len() as f64;
    let mut sum = [0.0; 3];
    for p in image.pixels() {
        for (s, c) in sum.iter_mut().zip(linear_of([p.0[0], p.0[1], p.0[2]])) {
            *s += c / n;
        }
    }
    sum
}

#[test]
fn tiles_have_no_seam() {
    for p in all() {
        // Coarse is enough, and quick.
        let f = field(&p, [0.4, 0.35, 0.3], Some(0.004_f64.min(super::plan::width(&p) / 6.0)));
        let (w, h) = (f.px[0] as usize, f.px[1] as usize);
        let step = |a: usize, b: usize| {
            let (a, b) = (f.samples[a], f.samples[b]);
            (luminance(a.color) - luminance(b.color)).abs() + 0.05 * (a.height - b.height).abs()
        };
        let column = |x: usize| (0..h).map(|y| step(y * w + x, y * w + (x + 1) % w)).sum::<f64>() / h as f64;
        let row = |y: usize| (0..w).map(|x| step(y * w + x, (y + 1) % h * w + x)).sum::<f64>() / w as f64;
        let inner_columns = (0..w - 1).map(column).fold(0.0, f64::max);
        let inner_rows = (0..h - 1).map(row).fold(0.0, f64::max);
        // The border may be a joint, the strongest step that there is; a seam would be far above it.
        assert!(
            column(w - 1) <= 1.25 * inner_columns + 1e-3,
            "{:?} {}: {} {inner_columns}",
            p.kind,
            p.variant,
            column(w - 1)
        );
        assert!(row(h - 1) <= 1.25 * inner_rows + 1e-3, "{:?} {}: {} {inner_rows}", p.kind, p.variant, row(h - 1));
    }
}

#[test]
fn the_mean_colour_is_the_slots_or_the_colours_own() {
    use PatternKind as K;
    for kind in [K::Planks, K::Brick, K::Motif, K::Knit, K::Terrazzo, K::Corrugated, K::Ramp, K::Over, K::Tint] {
        let p = pattern(kind, "", &[]);
        let coarse = Some(0.004_f64.min(super::plan::width(&p) / 5.0));
        let s = spec(p, "#8a6f58");
        let tile = bake_tile(&s, coarse);
        let (got, want) = (bytes_of(mean_of(&tile.color)), mean_color(&s));
        for (g, w) in got.into_iter().zip(want) {
            assert!(g.abs_diff(w) <= 1, "{:?}: {got:?}, not {want:?}", s.map.unwrap().kind);
        }
    }
    // Two colours half and half: the mean of their linear values.
    let s = spec(pattern(PatternKind::Checks, "", &["#ffffff", "#000000"]), "#123456");
    assert_eq!(mean_color(&s), [188; 3]);
    // A red joint of 1 cm around tiles of 10 cm: 19 % of the surface.
    let mut p = pattern(PatternKind::Tiles, "", &["#000000", "#ff0000"]);
    (p.width, p.length, p.joint) = (0.1, 0.1, 0.01);
    assert!(mean_color(&spec(p, "#123456"))[0].abs_diff(bytes_of([0.19; 3])[0]) <= 1);
    // Recoloured, the relation of colours stays.
    let s = recolored(&spec(pattern(PatternKind::Checks, "", &["#c08060", "#604030"]), "#123456"), [90, 110, 70]);
    assert!(mean_color(&s).into_iter().zip([90, 110, 70]).all(|(a, b)| a.abs_diff(b) <= 1), "{:?}", mean_color(&s));
    let [a, b] = [0, 1].map(|k| linear_hex(&s.map.as_ref().unwrap().colors[k]));
    let [c, d] = ["#c08060", "#604030"].map(linear_hex);
    for k in 0..3 {
        assert!((a[k] / b[k] / (c[k] / d[k]) - 1.0).abs() <= 0.05);
    }
}

#[test]
fn the_same_spec_gives_the_same_bytes_and_another_seed_others() {
    for kind in [PatternKind::Planks, PatternKind::Boucle, PatternKind::Marble] {
        let p = pattern(kind, "", &[]);
        let bake = |p: &Pattern| bake_tile(&spec(p.clone(), "#a08060"), Some(0.004_f64.min(plan::width(p) / 5.0)));
        let (a, b) = (bake(&p), bake(&p));
        assert_eq!((a.color.as_raw(), &a.normal, &a.surface), (b.color.as_raw(), &b.normal, &b.surface));
        let c = bake(&Pattern { seed: 1, ..p });
        assert_eq!(a.size, c.size);
        let differ = a.color.pixels().zip(c.color.pixels()).filter(|(x, y)| x != y).count();
        assert!(differ * 2 > a.color.pixels().len(), "{kind:?}");
    }
}

#[test]
fn planks_are_as_wide_as_they_should_be() {
    for width in [0.09, 0.145, 0.21] {
        let mut p = pattern(PatternKind::Planks, "", &["#a07850"]);
        p.width = width;
        let tile = bake_tile(&spec(p.clone(), "#000000"), None);
        let (w, h) = tile.color.dimensions();
        // Grooves are the darkest rows: count those well below the mean of their neighbours.
        let rows: Vec<f64> = (0..h)
            .map(|y| (0..w).map(|x| f64::from(tile.color.get_pixel(x, y).0[1])).sum::<f64>() / f64::from(w))
            .collect();
        let at = |y: i64| rows[y.rem_euclid(i64::from(h)) as usize];
        let dip = |y: i64| f64::midpoint(at(y - 4), at(y + 4)) - at(y);
        let grooves =
            (0..i64::from(h)).filter(|y| dip(*y) > 5.0 && dip(*y) >= dip(y - 1) && dip(*y) > dip(y + 1)).count();
        let found = f64::from(tile.size[1]) / grooves as f64;
        assert!((found / width - 1.0).abs() <= 0.01, "{found} m wide, not {width}");
        // Turned by a quarter, they run along v.
        p.turn_deg = 90.0;
        let turned = bake_tile(&spec(p, "#000000"), None);
        assert_eq!((turned.size, turned.turn), ([tile.size[1], tile.size[0]], 0.0));
        let (a, b) = (tile.color.get_pixel(7, 12), turned.color.get_pixel(turned.color.width() - 1 - 12, 7));
        assert_eq!(a, b, "u has become v");
    }
}

#[test]
fn a_mask_shows_the_first_pattern_where_it_is_white_and_the_second_where_it_is_black() {
    let plain = |color: &str| pattern(PatternKind::Checks, "", &[color, color]);
    let mask = pattern(PatternKind::Stripes, "", &["#ffffff", "#000000"]);
    let layers = vec![plain("#c02020"), plain("#2020c0"), mask];
    let s = spec(Pattern { layers, ..Pattern::new(PatternKind::Over) }, "#704070");
    let tile = bake_tile(&s, None);
    // Stripes of 5 cm side by side: the middles of the first two.
    let at = |metres: f32| {
        let x = metres / tile.size[0] * tile.color.width() as f32;
        tile.color.get_pixel(x as u32, 3).0
    };
    let ([r, _, b, _], [r2, _, b2, _]) = (at(0.025), at(0.075));
    assert!(r > b.saturating_add(60) && b2 > r2.saturating_add(60), "{:?} {:?}", at(0.025), at(0.075));
}

#[test]
fn an_odd_turn_is_the_coordinates() {
    let mut p = pattern(PatternKind::Stripes, "", &[]);
    p.turn_deg = 30.0;
    let tile = bake_tile(&spec(p, "#808080"), None);
    assert!((tile.turn - 30_f32.to_radians()).abs() <= 1e-6);
    // A step along the stripes, u turned by 30 + 90 degrees, does not change the column.
    let a = glam::Vec2::new(0.31, 0.12);
    let along = glam::Vec2::from_angle(120_f32.to_radians()) * 0.4;
    assert!((tile.uv(a).x - tile.uv(a + along).x).abs() <= 1e-5);
    assert!((tile.metric(tile.uv(a)) - a).length() <= 1e-5);
}

#[test]
fn normals_are_unit_and_say_what_the_relief_says() {
    let mut p = pattern(PatternKind::Corrugated, "", &[]);
    (p.width, p.amount) = (0.08, 0.5);
    let tile = bake_tile(&spec(p.clone(), "#888888"), Some(0.002));
    let normal = tile.normal.unwrap();
    for n in normal.pixels() {
        let v = n.0.map(|b| f64::from(b) / 127.5 - 1.0);
        assert!((v.iter().map(|c| c * c).sum::<f64>().sqrt() - 1.0).abs() <= 0.012);
    }
    // A cosine of depth 14 mm and pitch 80 mm: steepest slope pi 14 / 80 at a quarter, falling there.
    let (w, h) = normal.dimensions();
    let n = f64::from(w) * 0.08 / f64::from(tile.size[0]);
    let quarter = normal.get_pixel((n / 4.0) as u32, h / 3).0.map(|b| f64::from(b) / 127.5 - 1.0);
    let slope = quarter[0] / quarter[2];
    assert!((slope - std::f64::consts::PI * 14.0 / 80.0).abs() <= 0.04, "{slope}");
    assert!(quarter[1].abs() <= 0.03);
    // Along v: the upper end of an upright wave leans up, against v, which is +y in a normal map.
    p.turn_deg = 90.0;
    let tile = bake_tile(&spec(p.clone(), "#888888"), Some(0.002));
    let normal = tile.normal.unwrap();
    let n = f64::from(normal.height()) * 0.08 / f64::from(tile.size[1]);
    // Height falls with v there, so that the surface faces larger v: down the image.
    let quarter = normal.get_pixel(normal.width() / 3, (n / 4.0) as u32).0.map(|b| f64::from(b) / 127.5 - 1.0);
    assert!((quarter[1] / quarter[2] + std::f64::consts::PI * 14.0 / 80.0).abs() <= 0.04, "{quarter:?}");
    // No bump, no map.
    let flat = MaterialSpec { bump: 0.0, ..spec(p, "#888888") };
    assert!(bake_tile(&flat, Some(0.002)).normal.is_none());
}

#[test]
fn slots_become_materials() {
    let mut s = MaterialSpec::plain("bulb", "#ffd68c");
    (s.emit, s.kelvin, s.alpha, s.transmission) = (300.0, Some(2700.0), 0.5, 0.9);
    let m = material(&s);
    assert_eq!((m.name.as_str(), m.base_color[3], m.transmission, m.tile.is_some()), ("bulb", 0.5, 0.9, false));
    // 300 cd/m2 is three times white; its hue is that of a lamp.
    let e = m.emissive.map(f64::from);
    assert!((luminance(e) - 3.0).abs() <= 1e-4, "{e:?}");
    assert!(e[0] > e[1] && e[1] > e[2]);
    assert_eq!(m.base_color[..3], linear_hex("#ffd68c").map(|c| c as f32));
    let m = material(&spec(pattern(PatternKind::Dots, "", &[]), "#ffd68c"));
    assert_eq!(m.base_color, [1.0; 4]);
    // Green times the factor is the slot's roughness.
    let green = m.tile.unwrap().surface.as_ref().unwrap().get_pixel(0, 0).0[1];
    assert!((f64::from(green) / 255.0 * f64::from(m.roughness) - 0.6).abs() <= 0.005);
}

/// A piece of a surface as a camera sees it: the tile sampled at another scale, with noise and a smooth shade.
fn seen(p: &Pattern, slot: &str, size: [f64; 2], px_per_m: f64) -> RgbaImage {
    let tile = bake_tile(&spec(p.clone(), slot), None);
    let (w, h) = tile.color.dimensions();
    RgbaImage::from_fn((size[0] * px_per_m) as u32, (size[1] * px_per_m) as u32, |x, y| {
        let mut sum = [0.0; 3];
        for k in 0..9 {
            let at = |v: u32, s: u32| (f64::from(v) + (f64::from(s) + 0.5) / 3.0) / px_per_m;
            let uv = tile.uv(glam::Vec2::new(at(x, k % 3) as f32, at(y, k / 3) as f32));
            let i = (uv.x.rem_euclid(1.0) * w as f32) as u32 % w;
            let j = (uv.y.rem_euclid(1.0) * h as f32) as u32 % h;
            let c = tile.color.get_pixel(i, j).0;
            for (s, c) in sum.iter_mut().zip(linear_of([c[0], c[1], c[2]])) {
                *s += c / 9.0;
            }
        }
        let wave = libm::sin(f64::from(x) / px_per_m * 2.1) * libm::cos(f64::from(y) / px_per_m * 1.7);
        let noise = hash(77, i64::from(x), i64::from(y));
        let color = std::array::from_fn(|k| sum[k] * (1.0 + 0.05 * wave) * (1.0 + 0.03 * gauss(noise, k as u64)));
        let [r, g, b] = bytes_of(color);
        // A piece of furniture stands before it.
        let hidden = (f64::from(x) / px_per_m - 0.9).abs() < 0.25 && (f64::from(y) / px_per_m - 0.4).abs() < 0.25;
        Rgba([r, g, b, if hidden { 0 } else { 255 }])
    })
}

fn near(got: &str, want: &str, most: u8) -> bool {
    let (a, b) = (parse_hex(got).unwrap(), parse_hex(want).unwrap());
    a.into_iter().zip(b).all(|(a, b)| a.abs_diff(b) <= most)
}

/// Difference of two phases, in periods.
fn phase(a: f64, b: f64, period: f64) -> f64 {
    let d = ((a - b) / period).rem_euclid(1.0);
    d.min(1.0 - d)
}

#[test]
fn planks_are_fitted() {
    let mut truth = pattern(PatternKind::Planks, "", &["#a67c52"]);
    (truth.width, truth.tone, truth.seed, truth.offset) = (0.137, 0.4, 9, [0.0, 0.045]);
    let view = seen(&truth, "#000000", [2.2, 1.4], 400.0);
    let mut hint = pattern(PatternKind::Planks, "", &["#8a6a50"]);
    (hint.width, hint.seed) = (0.16, 1);
    let fit = fit_evidence(&hint, &view, 400.0);
    let p = &fit.pattern;
    assert!((p.width / 0.137 - 1.0).abs() <= 0.03, "{} {fit:?}", p.width);
    assert!(phase(p.offset[1], 0.045, 0.137) <= 0.1, "{}", p.offset[1]);
    assert!(near(&p.colors[0], "#a67c52", 4), "{:?}", p.colors);
    assert!((0.2..0.7).contains(&p.tone), "{}", p.tone);
    assert_eq!((p.seed, p.kind), (1, PatternKind::Planks), "the rest stays");
}

#[test]
fn tiles_and_bricks_are_fitted() {
    let mut truth = pattern(PatternKind::Tiles, "", &["#c8beb0", "#706a64"]);
    (truth.width, truth.length, truth.joint, truth.seed, truth.offset) = (0.31, 0.245, 0.006, 4, [0.11, 0.05]);
    let view = seen(&truth, "#000000", [2.4, 1.8], 350.0);
    let mut hint = truth.clone();
    (hint.width, hint.length, hint.seed, hint.offset) = (0.36, 0.28, 0, [0.0; 2]);
    hint.colors = vec!["#ffffff".into(), "#888888".into()];
    let p = fit_evidence(&hint, &view, 350.0).pattern;
    assert!((p.width / 0.31 - 1.0).abs() <= 0.03 && (p.length / 0.245 - 1.0).abs() <= 0.03, "{} {}", p.width, p.length);
    assert!(phase(p.offset[0], 0.11, 0.31) <= 0.1 && phase(p.offset[1], 0.05, 0.245) <= 0.1, "{:?}", p.offset);
    assert!(near(&p.colors[0], "#c8beb0", 4), "{:?}", p.colors);
    assert!(near(&p.colors[1], "#706a64", 24), "joints are thin: {:?}", p.colors);

    let mut truth = pattern(PatternKind::Brick, "", &["#9a5a44", "#b8b0a4"]);
    (truth.width, truth.length, truth.seed, truth.offset) = (0.24, 0.078, 3, [0.07, 0.02]);
    let view = seen(&truth, "#000000", [2.0, 1.3], 400.0);
    let mut hint = pattern(PatternKind::Brick, "", &["#804030", "#c0c0c0"]);
    hint.width = 0.22;
    let fit = fit_evidence(&hint, &view, 400.0);
    let p = &fit.pattern;
    assert!((p.width / 0.24 - 1.0).abs() <= 0.03 && (p.length / 0.078 - 1.0).abs() <= 0.03, "{fit:?}");
    // Courses two by two: a shift by one course and half a brick is the same wall.
    let (du, dv) = ((p.offset[0] - 0.07) / 0.24, (p.offset[1] - 0.02) / 0.078);
    let courses = dv.round();
    assert!((dv - courses).abs() <= 0.1 && phase(du + courses * 0.5, 0.0, 1.0) <= 0.1, "{:?}", p.offset);
    assert!(near(&p.colors[0], "#9a5a44", 12), "worn and toned: {:?}", p.colors);
}

#[test]
fn checks_and_stripes_are_fitted() {
    for variant in ["", "gingham"] {
        let mut truth = pattern(PatternKind::Checks, variant, &["#e8e0d0", "#305878"]);
        (truth.width, truth.seed, truth.offset) = (0.182, 2, [0.05, 0.13]);
        let view = seen(&truth, "#000000", [2.0, 1.5], 300.0);
        let mut hint = pattern(PatternKind::Checks, variant, &["#ffffff", "#203040"]);
        hint.width = 0.2;
        let fit = fit_evidence(&hint, &view, 300.0);
        let p = &fit.pattern;
        assert!((p.width / 0.182 - 1.0).abs() <= 0.03, "{variant}: {fit:?}");
        assert!(near(&p.colors[0], "#e8e0d0", 4) && near(&p.colors[1], "#305878", 4), "{variant}: {:?}", p.colors);
        let (du, dv) = ((p.offset[0] - 0.05) / 0.182, (p.offset[1] - 0.13) / 0.182);
        assert!(phase(du, 0.0, 1.0) <= 0.1 && phase(dv, 0.0, 1.0) <= 0.1, "{variant}: {:?}", p.offset);
        // The light squares are where they were.
        let moved = (du.round() + dv.round()).rem_euclid(2.0);
        assert_eq!(moved, 0.0, "{variant}: {:?}", p.offset);
    }
    let mut truth = pattern(PatternKind::Stripes, "", &["#e0d0c0", "#803848"]);
    (truth.width, truth.joint, truth.offset) = (0.09, 0.04, [0.03, 0.0]);
    let view = seen(&truth, "#000000", [1.6, 0.9], 400.0);
    let mut hint = pattern(PatternKind::Stripes, "", &["#ffffff", "#ff0000"]);
    (hint.width, hint.joint) = (0.075, 0.045);
    let fit = fit_evidence(&hint, &view, 400.0);
    let p = &fit.pattern;
    assert!((p.width / 0.09 - 1.0).abs() <= 0.05 && (p.joint / 0.04 - 1.0).abs() <= 0.08, "{fit:?}");
    assert!(((p.width + p.joint) / 0.13 - 1.0).abs() <= 0.02);
    assert!(phase(p.offset[0], 0.03, 0.13) <= 0.05, "{:?}", p.offset);
    assert!(near(&p.colors[0], "#e0d0c0", 4) && near(&p.colors[1], "#803848", 4), "{:?}", p.colors);
}

#[test]
fn a_description_stays_where_pixels_do_not_speak() {
    // A plain wall that is called planks; and far too small a piece.
    let plain = seen(&pattern(PatternKind::Plaster, "smooth", &["#c0b0a0"]), "#000000", [1.6, 1.2], 300.0);
    let mut hint = pattern(PatternKind::Planks, "", &[]);
    hint.width = 0.15;
    let fit = fit_evidence(&hint, &plain, 300.0);
    assert_eq!((fit.along_u, fit.along_v), (None, None), "{fit:?}");
    assert_eq!((fit.pattern.width, fit.pattern.offset), (0.15, [0.0; 2]));
    assert!(near(&fit.pattern.colors[0], "#c0b0a0", 4), "its colour is measured all the same");
    let tiny = RgbaImage::from_pixel(8, 8, Rgba([9, 9, 9, 255]));
    assert_eq!(fit_evidence(&hint, &tiny, 300.0).pattern, hint);
    assert_eq!(fit_evidence(&hint, &plain, f64::NAN).pattern, hint);
}
