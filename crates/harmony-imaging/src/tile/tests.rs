use super::*;
use crate::noise::hash;

/// Planks along x under a light gradient, with a grain.
fn planks(width: u32, height: u32) -> RgbaImage {
    RgbaImage::from_fn(width, height, |x, y| {
        let plank = y / 12;
        let tone = (hash(u64::from(plank) * 31 + u64::from((x + plank * 37) / 64)) % 24) as f32;
        let gap = if y % 12 == 0 { -40.0 } else { 0.0 };
        let light = x as f32 / width as f32 * 30.0;
        opaque([150.0 + tone + gap + light, 110.0 + tone + gap + light, 70.0 + tone + gap + light])
    })
}

fn hide(texture: &mut RgbaImage, hidden: impl Fn(u32, u32) -> bool) {
    for (x, y, p) in texture.enumerate_pixels_mut() {
        if hidden(x, y) {
            *p = Rgba([255, 0, 255, 0]);
        }
    }
}

fn mean_of(texture: &RgbaImage, inside: impl Fn(u32, u32) -> bool) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut n = 0.0;
    for (x, y, p) in texture.enumerate_pixels() {
        if inside(x, y) {
            for (s, c) in sum.iter_mut().zip(p.0) {
                *s += f64::from(c);
            }
            n += 1.0;
        }
    }
    sum.map(|s: f64| s / n)
}

#[test]
fn planks_go_on_under_the_furniture() {
    let truth = planks(300, 240);
    let hidden = |x: u32, y: u32| (80..220).contains(&x) && (60..200).contains(&y);
    let mut texture = truth.clone();
    hide(&mut texture, hidden);
    let whole = complete_surface(&texture, &TextureSettings::default());
    assert!(whole.pixels().all(|p| p.0[3] == 255));
    // The colour fits, nothing of the hidden colour comes through, and the gaps between planks go on.
    let (a, b) = (mean_of(&truth, hidden), mean_of(&whole, hidden));
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() < 10.0, "{a} {b}");
    }
    let gap = mean_of(&whole, |x, y| hidden(x, y) && y % 12 == 0);
    let wood = mean_of(&whole, |x, y| hidden(x, y) && (4..9).contains(&(y % 12)));
    assert!(wood[1] - gap[1] > 12.0, "gaps {gap:?}, wood {wood:?}");
    for (p, q) in whole.pixels().zip(texture.pixels()) {
        assert!(q.0[3] == 0 || p.0[..3] == q.0[..3]);
    }
}

#[test]
fn a_gradient_does_not_run_away_from_what_was_seen() {
    let mut texture = RgbaImage::from_fn(400, 100, |x, _| opaque([250.0 - x as f32; 3]));
    hide(&mut texture, |x, _| x >= 100);
    let whole = complete_surface(&texture, &TextureSettings::default());
    let far = whole.get_pixel(390, 50).0;
    assert!((f64::from(far[0]) - 200.0).abs() < 12.0, "settles at the median 200, is {far:?}");
    let near = whole.get_pixel(104, 50).0;
    assert!((f64::from(near[0]) - 150.0).abs() < 25.0, "no jump at the edge, is {near:?}");
}

#[test]
fn little_or_nothing_observed_gives_a_plain_surface() {
    let settings = TextureSettings::default();
    let mut texture = RgbaImage::from_pixel(64, 48, Rgba([90, 120, 60, 255]));
    hide(&mut texture, |x, y| x > 8 || y > 8);
    for p in complete_surface(&texture, &settings).pixels() {
        assert!(p.0[0].abs_diff(90) <= 3 && p.0[1].abs_diff(120) <= 3 && p.0[3] == 255);
    }
    let nothing = RgbaImage::new(64, 48);
    assert!(complete_surface(&nothing, &settings).pixels().all(|p| p.0[0].abs_diff(128) <= 3 && p.0[3] == 255));
    assert_eq!(complete_surface(&RgbaImage::new(0, 0), &settings).dimensions(), (0, 0));
}

#[test]
fn a_tile_meets_itself_and_keeps_the_pattern() {
    let texture = planks(420, 300);
    let seen = |x: u32, y: u32| !(x < 90 && y < 120);
    let observed: Vec<bool> = texture.enumerate_pixels().map(|(x, y, _)| seen(x, y)).collect();
    // Without the light of `planks`: a quilt takes colours that light was taken out of.
    let colors: Vec<Color> = texture
        .enumerate_pixels()
        .map(|(x, _, p)| std::array::from_fn(|c| f32::from(p.0[c]) - x as f32 / 420.0 * 30.0))
        .collect();
    let sample = quilt::Sample { width: 420, height: 300, colors: &colors, observed: &observed };
    let tile = quilt::quilt(&sample, 96, 0x5eed).unwrap();
    let tile = RgbaImage::from_fn(96, 96, |x, y| opaque(tile[(y * 96 + x) as usize]));
    let difference = |a: (u32, u32), b: (u32, u32)| -> f64 {
        tile.get_pixel(a.0, a.1).0.iter().zip(tile.get_pixel(b.0, b.1).0).map(|(a, b)| f64::from(a.abs_diff(b))).sum()
    };
    let across = |x: u32| (0..96).map(|y| difference((x, y), ((x + 1) % 96, y))).sum::<f64>() / 96.0;
    let inside = (0..95).map(across).sum::<f64>() / 95.0;
    assert!(across(95) < 3.0 * inside + 6.0, "edge {} against {inside} inside", across(95));
    let mean = mean_of(&tile, |_, _| true);
    let sample = RgbaImage::from_fn(420, 300, |x, y| opaque(colors[(y * 420 + x) as usize]));
    let observed = mean_of(&sample, seen);
    for (a, b) in mean.iter().zip(observed) {
        assert!((a - b).abs() < 10.0);
    }
    // Rows vary (gaps), so the planks are still there.
    let rows: Vec<f64> = (0..96).map(|y| mean_of(&tile, |_, v| v == y)[1]).collect();
    let spread =
        rows.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b)) - rows.iter().fold(f64::INFINITY, |a, b| a.min(*b));
    assert!(spread > 15.0, "{spread}");
}
