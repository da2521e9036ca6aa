use super::*;
use crate::noise::{Random, hash};
use crate::tile::grain::evened;

/// A tiled floor: squares of 33.4 x 33.4 texels in two tones with dark joints, under light that falls off to the right.
fn tiles(width: u32, height: u32) -> RgbaImage {
    RgbaImage::from_fn(width, height, |x, y| {
        let (u, v) = (f64::from(x) / 33.4, f64::from(y) / 33.4);
        let joint = u.fract() < 0.09 || v.fract() < 0.09;
        let odd = (u.floor() + v.floor()).rem_euclid(2.0) > 0.5;
        let tone = if joint {
            60.0
        } else if odd {
            205.0
        } else {
            150.0
        };
        let light = 1.0 - 0.06 * x as f32 / width as f32;
        let grain = (hash(u64::from(y) << 32 | u64::from(x)) % 7) as f32 - 3.0;
        opaque([tone * light + grain, tone * light * 0.95 + grain, tone * light * 0.9 + grain])
    })
}

fn difference(a: &RgbaImage, b: &RgbaImage, inside: impl Fn(u32, u32) -> bool) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for (x, y, p) in a.enumerate_pixels().filter(|(x, y, _)| inside(*x, *y)) {
        sum += p.0[..3].iter().zip(b.get_pixel(x, y).0).map(|(a, b)| f64::from(a.abs_diff(b))).sum::<f64>() / 3.0;
        n += 1.0;
    }
    sum / n
}

fn survey(texture: &RgbaImage) -> Survey {
    let fineness = Fineness::full(texture.width() as usize, texture.height() as usize);
    Survey::of(texture, &fineness, 100.0, Grain::Fine, 7).unwrap()
}

#[test]
fn a_tiled_floor_goes_on_in_step_where_the_photo_ends() {
    let truth = tiles(600, 400);
    // Seen is a wedge at the left with furniture in it, as from a camera.
    let hidden = |x: u32, y: u32| x > 180 + y / 2 || ((90..150).contains(&x) && (100..180).contains(&y));
    let mut texture = truth.clone();
    for (_, _, p) in texture.enumerate_pixels_mut().filter(|(x, y, _)| hidden(*x, *y)) {
        *p = Rgba([255, 0, 255, 0]);
    }
    let survey = survey(&texture);
    let lengths = survey.look.periods().expect("a lattice").map(DVec2::length);
    // The checks repeat along their diagonals or every two tiles.
    for length in lengths {
        let diagonal = 33.4 * 2.0_f64.sqrt();
        assert!((length - diagonal).abs() < 0.6 || (length - 66.8).abs() < 0.6, "{lengths:?}");
    }
    let whole = survey.complete();
    assert!(whole.pixels().all(|p| p.0[3] == 255));
    // 150 against 205 is 55 levels: half of the tiles wrong would be 27 on their own.
    let near = difference(&whole, &truth, |x, y| hidden(x, y) && x < 420);
    let far = difference(&whole, &truth, |x, y| hidden(x, y) && x > 500);
    assert!(near < 12.0 && far < 26.0, "near {near}, far {far}");
    // Where it was seen, the photo stays.
    let seen = difference(&whole, &truth, |x, y| x < 60 && (20..380).contains(&y));
    assert!(seen < 1.0, "{seen}");
}

#[test]
fn carpet_goes_on_with_its_grain_and_gets_no_pattern() {
    let texture = RgbaImage::from_fn(400, 300, |x, y| {
        let n = hash(u64::from(x / 2) * 7919 + u64::from(y / 2)) % 40;
        if x > 220 { Rgba([0; 4]) } else { opaque([90.0 + n as f32, 100.0 + n as f32, 120.0 + n as f32]) }
    });
    let survey = survey(&texture);
    assert!(survey.look.periods().is_none());
    let whole = survey.complete();
    let spread = |x0: u32, x1: u32| {
        let values: Vec<f64> = whole
            .enumerate_pixels()
            .filter(|(x, _, _)| (x0..x1).contains(x))
            .map(|(_, _, p)| f64::from(p.0[1]))
            .collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt())
    };
    let (seen, unseen) = (spread(0, 180), spread(260, 400));
    assert!((seen.0 - unseen.0).abs() < 4.0, "{seen:?} {unseen:?}");
    assert!(unseen.1 > 0.6 * seen.1 && unseen.1 < 1.4 * seen.1, "{seen:?} {unseen:?}");
}

#[test]
fn a_nook_beside_something_tells_the_light_and_leaves_no_shape() {
    // A wall at 180; something hides a block, and a sharp shadow of 110 beside it is seen but not to be kept.
    let texture = RgbaImage::from_fn(300, 300, |x, y| {
        let d = x.abs_diff(150).max(y.abs_diff(150));
        let [r, g, b, _] = opaque([if d < 56 { 110.0 } else { 180.0 }; 3]).0;
        Rgba([
            r,
            g,
            b,
            if d < 40 {
                0
            } else if d < 60 {
                160
            } else {
                255
            },
        ])
    });
    let whole = survey(&texture).complete();
    let row: Vec<f64> = (80..150).map(|x| f64::from(whole.get_pixel(x, 150).0[0])).collect();
    let steepest = row.windows(4).map(|w| (w[3] - w[0]).abs()).fold(0.0, f64::max);
    assert!(steepest < 25.0, "the edge of 70 is gone: {steepest}");
    assert!(row[69] < 165.0, "it stays darker there: {}", row[69]);
    assert!((row[0] - 180.0).abs() < 3.0);
}

#[test]
fn a_line_on_a_wall_is_not_repeated_on_others() {
    let line = |y: u32| (140..144).contains(&y);
    let texture = RgbaImage::from_fn(420, 300, |x, y| {
        let grain = (hash(u64::from(x) * 977 + u64::from(y)) % 5) as f32;
        opaque([if line(y) { 250.0 } else { 150.0 + grain }; 3])
    });
    let painted = survey(&texture).look.paint(400, 400);
    assert!(painted.pixels().all(|p| p.0[0] < 175));
}

#[test]
fn other_surfaces_are_painted_in_the_same_colour() {
    let texture = RgbaImage::from_fn(200, 200, |x, y| opaque([170.0 + ((x * 13 + y * 7) % 5) as f32, 160.0, 140.0]));
    let painted = survey(&texture).look.paint(64, 48);
    assert_eq!(painted.dimensions(), (64, 48));
    let mean = painted.pixels().map(|p| f64::from(p.0[0])).sum::<f64>() / (64.0 * 48.0);
    assert!((mean - 172.0).abs() < 2.0, "{mean}");
    assert!(Survey::of(&RgbaImage::new(50, 50), &Fineness::full(50, 50), 100.0, Grain::Fine, 7).is_none());
}

#[test]
fn a_printed_pattern_lies_at_its_size_under_the_light_that_was_seen() {
    // A floor of 160 that darkens to 80 along x; stripes of 10 texels, one in ten dark.
    let texture = RgbaImage::from_fn(300, 200, |x, _| opaque([160.0 - 80.0 * x as f32 / 300.0; 3]));
    let survey = survey(&texture);
    let delit = survey.delit();
    assert!(delit.get_pixel(40, 100).0[0].abs_diff(delit.get_pixel(260, 100).0[0]) < 6);
    let stripes = RgbaImage::from_fn(10, 1, |x, _| opaque([if x == 0 { 20.0 } else { 200.0 }; 3]));
    let look = survey.look.printed(&stripes, DMat2::from_diagonal(DVec2::new(0.1, 0.1)), 3);
    let painted = look.paint(60, 20);
    let dark: Vec<u32> = (0..60).filter(|x| painted.get_pixel(*x, 7).0[0] < 70).collect();
    assert_eq!(dark, [0, 10, 20, 30, 40, 50]);
    let mean = painted.pixels().map(|p| f64::from(p.0[0])).sum::<f64>() / 1200.0;
    assert!((mean - f64::from(look.color[0])).abs() < 4.0, "{mean}");
}

#[test]
fn shapes_that_happen_to_look_alike_are_no_pattern() {
    // Four dark blots on a wall, nearly at the corners of a parallelogram, each of another shape.
    let blots =
        [(90.0, 80.0, 30.0, 20.0), (250.0, 90.0, 24.0, 34.0), (130.0, 210.0, 36.0, 16.0), (292.0, 216.0, 22.0, 30.0)];
    let texture = RgbaImage::from_fn(400, 300, |x, y| {
        let dark = blots.iter().any(|(u, v, a, b): &(f64, f64, f64, f64)| {
            ((f64::from(x) - u) / a).powi(2) + ((f64::from(y) - v) / b).powi(2) < 1.0
        });
        opaque([if dark { 90.0 } else { 160.0 }; 3])
    });
    assert!(survey(&texture).look.periods().is_none());
}

#[test]
fn a_tile_that_was_made_even_still_meets_itself() {
    // Light and dark halves with soft borders, one of them across the edge.
    let side = 80;
    let tile: Vec<Color> = (0..side * side)
        .map(|i| [128.0 + 24.0 * (std::f32::consts::TAU * ((i % side) as f32 + 0.5) / side as f32).sin(); 3])
        .collect();
    for grain in [Grain::Fine, Grain::Coarse] {
        let ratios = evened(&tile, side, grain);
        let step = |x: usize| (ratios[(x + 1) % side][0] - ratios[x][0]).abs();
        let inside = (0..side - 1).map(step).fold(0.0, f32::max);
        assert!(step(side - 1) < 1.5 * inside + 0.002, "{grain:?}: {} at the edge, {inside} inside", step(side - 1));
    }
}

/// A wall with the shadow of something that stood before it, 6 cm wider than that on each side.
#[test]
fn a_shadow_does_not_end_in_the_outline_of_what_stood_before_it() {
    let from_middle = |x: u32, y: u32| (f64::from(x) - 150.0).abs().max((f64::from(y) - 100.0).abs());
    let mut wall = RgbaImage::from_fn(300, 200, |x, y| {
        let tone = if from_middle(x, y) < 20.0 { 110.0 } else { 180.0 };
        let grain = (hash(u64::from(y) << 32 | u64::from(x)) % 5) as f32 - 2.0;
        opaque([tone + grain; 3])
    });
    for (_, _, p) in wall.enumerate_pixels_mut().filter(|(x, y, _)| from_middle(*x, *y) < 14.0) {
        *p = Rgba([0; 4]);
    }
    let whole = survey(&wall).complete();
    let mean = |ring: std::ops::Range<i32>| {
        let of: Vec<f64> = whole
            .enumerate_pixels()
            .filter(|(x, y, _)| ring.contains(&(from_middle(*x, *y) as i32)))
            .map(|(_, _, p)| f64::from(p.0[0]))
            .collect();
        of.iter().sum::<f64>() / of.len() as f64
    };
    let (inside, beside) = (mean(9..13), mean(15..19));
    assert!((beside - 110.0).abs() < 12.0, "the shadow that was seen stays: {beside}");
    assert!((inside - beside).abs() < 14.0, "and goes on: {inside} beside {beside}");
    assert!((mean(60..90) - 180.0).abs() < 4.0);
}

/// A plain wall that was seen as a narrow strip, with a faint crack down the strip.
#[test]
fn a_faint_line_on_paint_is_not_repeated_over_the_wall() {
    let mut random = Random::new(11);
    let mut grain = || (random.unit() + random.unit() - 1.0) * 0.8;
    let texture = RgbaImage::from_fn(500, 400, |x, _| {
        let line = if (56..59).contains(&x) { -2.0 } else { 0.0 };
        let level = (200.0 + line + grain()).round() as u8;
        Rgba([level, level, level, if (40..76).contains(&x) { 255 } else { 0 }])
    });
    let survey = Survey::of(&texture, &Fineness::full(500, 400), 160.0, Grain::Fine, 5).unwrap();
    let painted = survey.look.paint(500, 400);
    let column = |x: u32| (0..400).map(|y| f32::from(painted.get_pixel(x, y).0[0])).sum::<f32>() / 400.0;
    let columns: Vec<f32> = (0..500).map(column).collect();
    let usual = columns.iter().sum::<f32>() / 500.0;
    let worst = columns.iter().map(|c| (c - usual).abs()).fold(0.0, f32::max);
    assert!(worst < 0.6, "no column stands out of its wall: {worst}");
}

#[test]
fn a_patch_of_sun_stays_where_it_is_and_is_laid_nowhere_else() {
    let sun = |x: u32, y: u32| (120..160).contains(&x) && (200..260).contains(&y);
    let mut texture = RgbaImage::from_fn(600, 400, |x, y| {
        let grain = (hash(u64::from(y) << 32 | u64::from(x)) % 15) as f32 - 7.0;
        opaque(if sun(x, y) { [250.0, 248.0, 240.0] } else { [92.0 + grain, 90.0 + grain, 84.0 + grain] })
    });
    for (_, _, p) in texture.enumerate_pixels_mut().filter(|(x, _, _)| *x >= 300) {
        p.0[3] = 0;
    }
    let survey = survey(&texture);
    let whole = survey.complete();
    assert!(whole.get_pixel(140, 230).0[0] > 230);
    let brightest = whole.enumerate_pixels().filter(|(x, _, _)| *x > 330).map(|(_, _, p)| p.0[0]).max().unwrap();
    assert!(brightest < 130, "{brightest}");
    // White tiles are no sun.
    let (tiled, taken) = (tiles(600, 400), |t: &RgbaImage| sunlit(t, 100.0));
    assert!(taken(&tiled).is_none() && taken(&texture).is_some());
}
