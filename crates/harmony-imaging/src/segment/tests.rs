use super::*;
use harmony_scene::ImageSize;
use image::Rgb;

/// A red disc on a grey ramp with some grain.
fn disc(width: u32, height: u32, centre: (f64, f64), radius: f64) -> (RgbImage, Mask) {
    let truth = Mask::from_fn(ImageSize::new(width, height), |x, y| {
        (f64::from(x) + 0.5 - centre.0).hypot(f64::from(y) + 0.5 - centre.1) < radius
    });
    let photo = RgbImage::from_fn(width, height, |x, y| {
        let grain = ((x * 31 + y * 17) % 7) as u8;
        let ramp = 90 + (x * 80 / width) as u8;
        if truth.get(i64::from(x), i64::from(y)) { Rgb([170 + grain, 40, 45]) } else { Rgb([ramp + grain, ramp, ramp]) }
    });
    (photo, truth)
}

#[test]
fn a_disc_is_cut_out_of_its_box_at_any_resolution() {
    for k in [1.0, 6.0] {
        let (photo, truth) = disc((160.0 * k) as u32, (120.0 * k) as u32, (80.0 * k, 60.0 * k), 30.0 * k);
        let bounds = PixelBox { x0: 49.0 * k, y0: 31.0 * k, x1: 110.0 * k, y1: 91.0 * k };
        let cut = segment_box(&photo, &SegmentPrompt::from_box(bounds), &SegmentSettings::default());
        assert!(cut.mask.iou(&truth) > 0.97, "{}", cut.mask.iou(&truth));
        assert!(cut.score > 0.95);
    }
}

#[test]
fn a_rough_outline_is_pulled_to_the_edge_and_never_left_far() {
    let (photo, truth) = disc(400, 300, (200.0, 150.0), 80.0);
    let rough: Vec<[f64; 2]> = (0..12)
        .map(|i| {
            let angle = f64::from(i) / 12.0 * std::f64::consts::TAU;
            let r = 82.0 + if i % 2 == 0 { 5.0 } else { -4.0 };
            [200.0 + r * angle.cos(), 150.0 + r * angle.sin()]
        })
        .collect();
    let cut = segment_box(&photo, &SegmentPrompt::from_outline(rough), &SegmentSettings::default());
    assert!(cut.mask.iou(&truth) > 0.97, "{}", cut.mask.iou(&truth));
    // On a flat picture the outline itself is all there is.
    let flat = RgbImage::from_pixel(400, 300, Rgb([128, 128, 128]));
    let square = vec![[100.0, 100.0], [200.0, 100.0], [200.0, 200.0], [100.0, 200.0]];
    let cut = segment_box(&flat, &SegmentPrompt::from_outline(square), &SegmentSettings::default());
    let band = 2.0 * 0.015 * 400.0 + 1.0;
    let b = cut.mask.bounds().unwrap();
    assert!((b.x0 - 100.0).abs() <= band && (b.x1 - 200.0).abs() <= band);
    assert!(cut.mask.count() > 7000);
}

#[test]
fn a_picture_frame_fills_its_box_though_its_colours_are_many() {
    // Quarters in four colours, one of them nearly the wall's.
    let photo = RgbImage::from_fn(240, 180, |x, y| {
        let wall = Rgb([180, 176, 170]);
        if !(60..180).contains(&x) || !(50..130).contains(&y) {
            return wall;
        }
        if !(64..176).contains(&x) || !(54..126).contains(&y) {
            return Rgb([60, 40, 30]);
        }
        match (x < 120, y < 90) {
            (true, true) => Rgb([182, 178, 172]),
            (false, true) => Rgb([60, 120, 200]),
            (true, false) => Rgb([40, 140, 60]),
            (false, false) => Rgb([220, 200, 60]),
        }
    });
    let truth = Mask::from_fn(ImageSize::new(240, 180), |x, y| (60..180).contains(&x) && (50..130).contains(&y));
    let bounds = PixelBox { x0: 58.0, y0: 51.0, x1: 182.0, y1: 129.0 };
    let cut = segment_box(&photo, &SegmentPrompt::from_box(bounds), &SegmentSettings::default());
    assert!(cut.mask.iou(&truth) > 0.95, "{}", cut.mask.iou(&truth));
}

#[test]
fn odd_prompts_give_masks_and_no_panic() {
    let (photo, _) = disc(80, 60, (40.0, 30.0), 15.0);
    let settings = SegmentSettings::default();
    let b = |x0, y0, x1, y1| SegmentPrompt::from_box(PixelBox { x0, y0, x1, y1 });
    for prompt in [
        b(0.0, 0.0, 80.0, 60.0),
        b(-50.0, -50.0, 500.0, 500.0),
        b(10.0, 10.0, 11.0, 11.0),
        b(79.2, 59.2, 80.0, 60.0),
        b(f64::NAN, 0.0, 10.0, 10.0),
        b(30.0, 30.0, 10.0, 10.0),
        b(200.0, 200.0, 300.0, 300.0),
        SegmentPrompt::from_outline(vec![[1.0, 1.0], [2.0, 2.0]]),
        SegmentPrompt::from_outline(vec![]),
        SegmentPrompt::from_outline(vec![[f64::INFINITY, 1.0], [2.0, 2.0], [3.0, 1.0]]),
    ] {
        let cut = segment_box(&photo, &prompt, &settings);
        assert_eq!(cut.mask.size(), ImageSize::new(80, 60));
        assert!((0.0..=1.0).contains(&cut.score));
    }
    let one = RgbImage::from_pixel(1, 1, Rgb([3, 3, 3]));
    assert!(segment_box(&one, &b(0.0, 0.0, 1.0, 1.0), &settings).mask.size().pixels() == 1);
    assert!(segment_box(&RgbImage::new(0, 0), &b(0.0, 0.0, 1.0, 1.0), &settings).mask.count() == 0);
    let flat = RgbImage::from_pixel(90, 70, Rgb([200, 200, 200]));
    let cut = segment_box(&flat, &b(20.0, 20.0, 60.0, 50.0), &settings);
    assert!(cut.mask.count() > 300, "a flat box still gives its middle");
}

#[test]
fn together_each_pixel_has_one_owner_and_the_layer_decides() {
    let (photo, disc_truth) = disc(200, 150, (100.0, 75.0), 40.0);
    let circle = |r: f64| -> Vec<[f64; 2]> {
        (0..24)
            .map(|i| {
                let a = f64::from(i) / 24.0 * std::f64::consts::TAU;
                [100.0 + r * a.cos(), 75.0 + r * a.sin()]
            })
            .collect()
    };
    let table = vec![[20.0, 60.0], [180.0, 60.0], [180.0, 140.0], [20.0, 140.0]];
    let prompts = [SegmentPrompt::from_outline(table), SegmentPrompt::from_outline(circle(40.0))];
    let cut = segment_all(&photo, &prompts, &SegmentSettings::default());
    assert_eq!(cut[0].mask.and(&cut[1].mask).count(), 0);
    assert!(cut[1].mask.iou(&disc_truth) > 0.95);
    let mut layered = prompts.clone();
    layered[0].layer = Some(2);
    layered[1].layer = Some(1);
    let cut = segment_all(&photo, &layered, &SegmentSettings::default());
    assert_eq!(cut[0].mask.and(&cut[1].mask).count(), 0);
    assert!(cut[0].mask.get(100, 90), "the layer in front keeps the shared part");
}

#[test]
fn a_drawn_leg_stays_with_its_seat() {
    // A pale seat on a leg 6 px wide, before a wall that is hardly darker, with some grain.
    let leg = |x: u32, y: u32| (197..203).contains(&x) && (140..260).contains(&y);
    let truth = Mask::from_fn(ImageSize::new(400, 300), |x, y| {
        leg(x, y) || ((100..300).contains(&x) && (60..140).contains(&y))
    });
    let photo = RgbImage::from_fn(400, 300, |x, y| {
        let grain = ((x * 31 + y * 17) % 9) as u8;
        let v = if truth.get(i64::from(x), i64::from(y)) { 200 } else { 188 };
        Rgb([v + grain, v + grain, v])
    });
    // Drawn with errors of up to 2 px.
    let outline = vec![
        [101.0, 61.0],
        [299.0, 58.5],
        [301.0, 141.0],
        [204.0, 141.0],
        [202.0, 259.0],
        [196.0, 261.0],
        [195.5, 139.0],
        [99.0, 138.5],
    ];
    let cut = segment_box(&photo, &SegmentPrompt::from_outline(outline), &SegmentSettings::default());
    let of_leg =
        (0..400 * 300).filter(|i| leg(i % 400, i / 400) && cut.mask.get(i64::from(i % 400), i64::from(i / 400)));
    let share = of_leg.count() as f64 / (6.0 * 120.0);
    assert!(share > 0.85, "{share} of the leg");
    assert!(cut.mask.iou(&truth) > 0.93, "{}", cut.mask.iou(&truth));
}
