//! Masks as other programs write them.

use std::collections::BTreeSet;

use image::{ImageFormat, Luma, Rgb, RgbImage, Rgba};

use harmony_testing::shared;

use super::*;

const SIZE: ImageSize = ImageSize { width: 320, height: 240 };

/// Three objects: a disc, a box that the disc overlaps, and a thin pole.
fn truth() -> Vec<([u8; 3], Mask)> {
    let disc = Mask::from_fn(SIZE, |x, y| (x as i32 - 90).pow(2) + (y as i32 - 100).pow(2) < 60 * 60);
    let board = Mask::from_fn(SIZE, |x, y| (60..300).contains(&x) && (120..200).contains(&y)).minus(&disc);
    let pole = Mask::from_fn(SIZE, |x, y| (250..254).contains(&x) && y < 100);
    vec![([255, 0, 0], disc), ([0, 128, 0], board), ([255, 255, 0], pole)]
}

fn painted() -> RgbImage {
    let truth = truth();
    RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| {
        let hit = truth.iter().find(|(_, m)| m.get(x.into(), y.into()));
        Rgb(hit.map_or([0; 3], |(c, _)| *c))
    })
}

fn write(folder: &Path, name: &str, image: &DynamicImage) -> PathBuf {
    let path = folder.join(name);
    image.save(&path).unwrap();
    path
}

#[test]
fn a_clean_colour_image_gives_exact_masks() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "seg.png", &painted().into());
    std::fs::write(folder.path().join("labels.json"), r##"{"#ff0000": "Round Table", "255,255,0": null}"##).unwrap();
    let found = load_masks(&path, SIZE).unwrap();
    assert_eq!(found.masks.len(), 2, "the pole is said to be no object");
    for m in &found.masks {
        let (_, truth) = truth().into_iter().find(|(c, _)| Some(*c) == m.color).unwrap();
        assert_eq!(m.mask, truth);
    }
    assert_eq!(found.masks[0].label.as_deref(), Some("round table"));
    assert_eq!(found.masks[0].name, "color_ff0000");
    // The same at twice the photo's resolution.
    let small = load_masks(&path, ImageSize::new(160, 120)).unwrap();
    assert_eq!(small.masks[0].mask.size(), ImageSize::new(160, 120));
    assert!(small.notes.iter().any(|n| n.contains("resized")));
    assert!(matches!(load_masks(&path, ImageSize::new(240, 320)), Err(MaskError::Size { .. })));
}

#[test]
fn jpeg_noise_and_soft_edges_do_not_make_objects() {
    let folder = tempfile::tempdir().unwrap();
    let clean = painted();
    let soft = image::imageops::blur(&clean, 1.2);
    for (name, image, quality) in [("seg.jpg", &clean, 80), ("noisy.jpg", &clean, 40), ("soft.png", &soft, 0)] {
        let path = folder.path().join(name);
        if quality > 0 {
            std::fs::write(&path, crate::picture::rgb_jpeg(image, quality).unwrap()).unwrap();
        } else {
            image.save_with_format(&path, ImageFormat::Png).unwrap();
        }
        let found = load_masks(&path, SIZE).unwrap();
        let big: Vec<_> = truth().into_iter().take(2).collect();
        assert!((2..=3).contains(&found.masks.len()), "{name}: {} masks", found.masks.len());
        for (color, truth) in big {
            let best = found.masks.iter().map(|m| m.mask.iou(&truth)).fold(0.0, f64::max);
            assert!(best >= 0.97, "{name}: {color:?} has IoU {best:.3}");
        }
        assert!(found.notes.iter().any(|n| n.contains("smeared")));
    }
}

#[test]
fn a_photo_is_not_taken_for_masks() {
    let folder = tempfile::tempdir().unwrap();
    let mut state = 1_u32;
    let noise = RgbImage::from_fn(SIZE.width, SIZE.height, |_, _| {
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        Rgb([next(), next(), next()])
    });
    let path = write(folder.path(), "photo.png", &noise.into());
    let error = load_masks(&path, SIZE).unwrap_err();
    assert!(matches!(error, MaskError::NotFlat { .. }), "{error}");
    assert!(error.hint().is_some());
    for photo in ["photos/bedroom_07.png", "gt/study_01/photo.jpg", "photos/dining_set_01.jpg"] {
        let Some(photo) = shared(photo) else { continue };
        let (width, height) = image::image_dimensions(&photo).unwrap();
        let found = load_masks(&photo, ImageSize::new(width, height));
        assert!(matches!(found, Err(MaskError::NotFlat { .. })), "{}", photo.display());
    }
    let black = write(folder.path(), "black.png", &RgbImage::new(SIZE.width, SIZE.height).into());
    assert!(matches!(load_masks(&black, SIZE), Err(MaskError::None { .. })));
}

#[test]
fn id_images_give_one_mask_a_value() {
    let folder = tempfile::tempdir().unwrap();
    let truth = truth();
    let value =
        |x: u32, y: u32| truth.iter().position(|(_, m)| m.get(x.into(), y.into())).map_or(0, |k| [3, 11, 12][k]);
    let ids8 = image::GrayImage::from_fn(SIZE.width, SIZE.height, |x, y| Luma([value(x, y)]));
    let ids16 = image::ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(SIZE.width, SIZE.height, |x, y| {
        Luma([u16::from(value(x, y)) * 300])
    });
    let paths = [
        (write(folder.path(), "ids8.png", &ids8.into()), ["id_12", "id_3", "id_11"]),
        (write(folder.path(), "ids16.png", &ids16.into()), ["id_3600", "id_900", "id_3300"]),
    ];
    std::fs::write(folder.path().join("ids8.json"), r#"[{"id": 11, "label": "bench"}]"#).unwrap();
    for (path, names) in paths {
        let found = load_masks(&path, SIZE).unwrap();
        assert_eq!(found.masks.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(), names);
        assert_eq!(found.masks[1].mask, truth[0].1);
        assert_eq!(found.masks[2].mask, truth[1].1);
    }
    let labelled = load_masks(&folder.path().join("ids8.png"), SIZE).unwrap();
    assert_eq!(labelled.masks[2].label.as_deref(), Some("bench"));
}

#[test]
fn folders_hold_one_mask_a_file_whatever_else_lies_there() {
    let folder = tempfile::tempdir().unwrap();
    let truth = truth();
    let bw = |m: &Mask| {
        image::GrayImage::from_fn(SIZE.width, SIZE.height, |x, y| Luma([u8::from(m.get(x.into(), y.into())) * 255]))
    };
    write(folder.path(), "coffee_table_10.png", &bw(&truth[1].1).into());
    write(folder.path(), "coffee_table_2.jpg", &bw(&truth[0].1).into());
    let cut_out = RgbaImage::from_fn(SIZE.width, SIZE.height, |x, y| {
        Rgba([
            (x % 256) as u8,
            (y % 256) as u8,
            (x * y % 256) as u8,
            u8::from(truth[2].1.get(x.into(), y.into())) * 255,
        ])
    });
    write(folder.path(), "7.png", &cut_out.into());
    let busy = RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| Rgb([(x % 256) as u8, (y % 256) as u8, 99]));
    write(folder.path(), "image.png", &busy.into());
    write(folder.path(), "other_size.png", &image::GrayImage::new(10, 90).into());
    std::fs::write(folder.path().join("broken.png"), b"not a picture").unwrap();
    std::fs::write(folder.path().join("notes.txt"), b"hello").unwrap();
    std::fs::write(folder.path().join("labels.json"), r#"{"7": "floor lamp"}"#).unwrap();
    let found = load_masks(folder.path(), SIZE).unwrap();
    let names: Vec<_> = found.masks.iter().map(|m| (m.name.as_str(), m.label.as_deref().unwrap())).collect();
    assert_eq!(names, [("7", "floor lamp"), ("coffee_table_2", "coffee table"), ("coffee_table_10", "coffee table")]);
    assert!(found.masks.iter().find(|m| m.name == "coffee_table_2").unwrap().mask.iou(&truth[0].1) >= 0.98);
    assert_eq!(found.masks.iter().find(|m| m.name == "7").unwrap().mask, truth[2].1);
    for left_out in ["image", "other_size", "broken"] {
        assert!(found.notes.iter().any(|n| n.starts_with(left_out)), "{left_out}: {:?}", found.notes);
    }
    let empty = tempfile::tempdir().unwrap();
    assert!(matches!(load_masks(empty.path(), SIZE), Err(MaskError::None { .. })));
}

#[test]
fn file_names_sort_by_their_numbers() {
    let mut names = vec!["10.png", "2.png", "chair_10", "chair_9", "1.png", "Chair_11"];
    names.sort_by_key(|n| natural(n));
    assert_eq!(names, ["1.png", "2.png", "10.png", "chair_9", "chair_10", "Chair_11"]);
}

#[test]
fn one_bit_masks_survive_a_round_trip_at_any_width() {
    let folder = tempfile::tempdir().unwrap();
    for width in [1, 7, 8, 9, 31, 64] {
        let mask = Mask::from_fn(ImageSize::new(width, 5), |x, y| (x * 7 + y * 3) % 4 == 0);
        let path = folder.path().join("m.png");
        save_mask(&path, &mask).unwrap();
        assert_eq!(load_mask(&path).unwrap(), mask);
        assert_eq!(std::fs::read(&path).unwrap()[24], 1, "bit depth in the PNG header");
    }
}

#[test]
fn index_colours_are_distinct_and_far_from_black() {
    let colors: BTreeSet<[u8; 3]> = (0..2000).map(index_color).collect();
    assert_eq!(colors.len(), 2000);
    for i in 0..2000 {
        let c = index_color(i);
        let (high, low) = (c.iter().max().unwrap(), c.iter().min().unwrap());
        assert!(high - low >= 60 && *high >= 130, "{i}: {c:?}");
    }
    for i in 10..60 {
        let (a, b) = (index_color(i), index_color(i + 1));
        assert!(a.iter().zip(b).any(|(a, b)| a.abs_diff(b) >= 60), "{a:?} and {b:?} are neighbours");
    }
}

#[test]
fn segmentation_files_are_read_back_as_masks_with_labels() {
    use harmony_scene::{
        Confidence, Level, MaterialCategory, ObjectId, Physical, Pose, Relations, SceneObject, Size, Support,
        SurfaceMaterial, Vec3,
    };
    let object = |id: &str, index: u32| SceneObject {
        id: ObjectId::new(id).unwrap(),
        index,
        level: Level::Furniture,
        label: id.trim_end_matches("_01").to_owned(),
        description: String::new(),
        source_phrase: "a thing".to_owned(),
        pose: Pose::new(Vec3::ZERO, 0.0, 1.0),
        size: Size { width: 1.0, height: 1.0, depth: 1.0 },
        support: Support::Floor,
        relations: Relations::default(),
        material: SurfaceMaterial {
            category: MaterialCategory::Wood,
            pbr: MaterialCategory::Wood.defaults(),
            physical: Physical { weight_kg: 1.0, thickness_m: 0.01, elasticity: 0.0, rigid: None },
        },
        mesh: String::new(),
        mask: Some(format!("3_furniture/masks/{id}.png")),
        seen_box: None,
        mesh_source: String::new(),
        confidence: Confidence::default(),
    };
    let (table, bench) = (object("table_01", 10), object("bench_01", 11));
    let truth = truth();
    let folder = tempfile::tempdir().unwrap();
    let segments = [Segment { object: &bench, mask: &truth[1].1 }, Segment { object: &table, mask: &truth[0].1 }];
    save_segmentation(folder.path(), SIZE, &segments).unwrap();
    let first = std::fs::read(folder.path().join("segmentation.png")).unwrap();
    let found = load_masks(&folder.path().join("segmentation.png"), SIZE).unwrap();
    for m in &found.masks {
        let expected = if m.label.as_deref() == Some("table") { &truth[0].1 } else { &truth[1].1 };
        assert_eq!(&m.mask, expected);
    }
    assert_eq!(found.masks.len(), 2);
    save_segmentation(folder.path(), SIZE, &segments).unwrap();
    assert_eq!(first, std::fs::read(folder.path().join("segmentation.png")).unwrap());
    let file: SegmentationFile = crate::read_json(&folder.path().join("segmentation.json")).unwrap();
    assert_eq!(file.objects[1].stage, "furniture");
    assert_eq!(file.objects[1].pixels, truth[0].1.count());
}

#[test]
fn masks_of_other_projects_load() {
    // Object counts: by looking at the files; colours and areas by counting them with another program.
    for (folder, count, red) in [
        ("masks/midi_3dfront_bedroom", 4, 70_273),
        ("masks/midi_realistic_00", 5, 30_084),
        ("masks/midi_breakfast_room", 5, 156_801),
        ("masks/scenegen_00001", 9, 61_855),
        ("masks/scenegen_00011", 5, 20_919),
    ] {
        let Some(folder) = shared(folder) else { return };
        let file = ["seg.png", "rgb_mask.png"].map(|n| folder.join(n)).into_iter().find(|p| p.exists()).unwrap();
        let (width, height) = image::image_dimensions(&file).unwrap();
        let found = load_masks(&file, ImageSize::new(width, height)).unwrap();
        assert_eq!(found.masks.len(), count, "{}", file.display());
        let mask = found.masks.iter().find(|m| m.color == Some([255, 0, 0])).unwrap();
        assert_eq!(mask.mask.count(), red);
    }
    let Some(folder) = shared("masks/sam3d_office_programmers") else { return };
    let found = load_masks(&folder, ImageSize::new(1280, 720)).unwrap();
    assert_eq!(found.masks.len(), 18, "{:?}", found.notes);
    assert_eq!(found.masks[2].name, "2");
    assert_eq!(found.masks[2].mask.count(), 14_319);
    let Some(ids) = shared("gt/bedroom_01/instances.png") else { return };
    let found = load_masks(&ids, ImageSize::new(960, 720)).unwrap();
    assert!(found.masks.iter().any(|m| m.name == "id_10"));
}
