use super::*;

fn centre_hole(size: ImageSize, share: f64) -> Mask {
    let inside = |v: u32, n: u32| (f64::from(v) / f64::from(n) - 0.5).abs() < share / 2.0;
    Mask::from_fn(size, |x, y| inside(x, size.width) && inside(y, size.height))
}

fn largest_error(a: &RgbImage, b: &RgbImage, hole: &Mask) -> (f64, f64) {
    let (mut most, mut sum, mut n) = (0.0_f64, 0.0, 0.0);
    for ((p, q), on) in a.pixels().zip(b.pixels()).zip(hole.bits()) {
        if *on {
            for (x, y) in p.0.iter().zip(q.0) {
                let d = f64::from(x.abs_diff(y));
                most = most.max(d);
                sum += d;
                n += 1.0;
            }
        }
    }
    (most, sum / n)
}

#[test]
fn a_gradient_goes_on_smoothly_and_the_rest_is_untouched() {
    let size = ImageSize::new(200, 160);
    let truth = RgbImage::from_fn(200, 160, |x, y| Rgb([(60 + x / 2) as u8, (100 + y / 3) as u8, 140]));
    let hole = centre_hole(size, 0.5);
    let mut photo = truth.clone();
    for (pixel, on) in photo.pixels_mut().zip(hole.bits()) {
        if *on {
            *pixel = Rgb([255, 0, 0]);
        }
    }
    let filled = fill(&photo, &hole, Sources::Anywhere, &FillSettings::default());
    let (most, mean) = largest_error(&filled, &truth, &hole);
    assert!(most <= 8.0 && mean < 2.5, "{most} {mean}");
    for ((p, q), on) in filled.pixels().zip(photo.pixels()).zip(hole.bits()) {
        assert!(*on || p == q);
    }
    let again = fill(&photo, &hole, Sources::Anywhere, &FillSettings::default());
    assert_eq!(filled, again, "same seed, same picture");
}

#[test]
fn stripes_go_on_through_the_hole() {
    let size = ImageSize::new(192, 192);
    let truth = RgbImage::from_fn(192, 192, |x, _| Rgb(if x / 8 % 2 == 0 { [200, 180, 150] } else { [90, 60, 40] }));
    let hole = centre_hole(size, 0.4);
    let filled = fill(&truth, &hole, Sources::Anywhere, &FillSettings::default());
    let (_, mean) = largest_error(&filled, &truth, &hole);
    assert!(mean < 12.0, "mean error {mean}, against 55 for their average");
}

#[test]
fn each_label_is_filled_from_its_own_pixels() {
    let size = ImageSize::new(160, 120);
    let color = |y: u32| if y < 60 { Rgb([220, 220, 210]) } else { Rgb([100, 70, 40]) };
    let truth = RgbImage::from_fn(160, 120, |_, y| color(y));
    let labels: Vec<u8> = (0..160 * 120).map(|i| u8::from(i / 160 >= 60)).collect();
    let hole = centre_hole(size, 0.6);
    let filled = fill(&truth, &hole, Sources::SameLabel(&labels), &FillSettings::default());
    let (most, _) = largest_error(&filled, &truth, &hole);
    assert!(most <= 4.0, "{most}");
}

#[test]
fn forbidden_sources_do_not_show_up() {
    let size = ImageSize::new(160, 120);
    let photo = RgbImage::from_fn(160, 120, |x, _| if x < 40 { Rgb([10, 200, 10]) } else { Rgb([128, 128, 128]) });
    let grey = Mask::from_fn(size, |x, _| x >= 40);
    let hole = Mask::from_fn(size, |x, y| (40..90).contains(&x) && (30..90).contains(&y));
    let filled = fill(&photo, &hole, Sources::Masked(&grey), &FillSettings::default());
    for (p, on) in filled.pixels().zip(hole.bits()) {
        assert!(!on || p.0 == [128, 128, 128], "{p:?}");
    }
}

#[test]
fn large_photos_and_odd_holes_work() {
    let settings = FillSettings { working_px: 128, ..FillSettings::default() };
    let truth = RgbImage::from_fn(500, 300, |x, y| Rgb([(x / 4) as u8, (y / 2) as u8, 77]));
    let hole = centre_hole(ImageSize::new(500, 300), 0.4);
    let filled = fill(&truth, &hole, Sources::Anywhere, &settings);
    let (most, mean) = largest_error(&filled, &truth, &hole);
    assert!(most < 20.0 && mean < 5.0, "{most} {mean}");
    let whole = Mask::from_fn(ImageSize::new(500, 300), |_, _| true);
    assert_eq!(fill(&truth, &whole, Sources::Anywhere, &settings), truth);
    for (w, h) in [(1, 1), (2, 9), (7, 7), (30, 3)] {
        let photo = RgbImage::from_pixel(w, h, Rgb([50, 60, 70]));
        let hole = Mask::from_fn(ImageSize::new(w, h), |x, y| x == 0 && y == 0);
        let filled = fill(&photo, &hole, Sources::Anywhere, &settings);
        assert_eq!(filled, photo);
    }
    let empty = RgbImage::new(0, 0);
    assert_eq!(fill(&empty, &hole, Sources::Anywhere, &settings), empty);
}
