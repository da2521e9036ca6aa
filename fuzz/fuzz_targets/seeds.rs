//! Writes the first inputs of each target into `corpus/` and word lists into `dict/`: all made here, none from outside.
//! No target of its own, but built as one: `cargo fuzz run seeds -- -runs=0`.
#![no_main]

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use harmony_fuzz::questions;
use harmony_io::npz::{NpyEntry, npz_bytes};
use harmony_io::{GlbNode, GlbScene, NodeTransform, TextureEncoding, glb_bytes};
use harmony_mesh::{PartModel, TemplateParams, template};
use harmony_scene::{ImageSize, Mask, Size};
use libfuzzer_sys::fuzz_target;
use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::{Value, json};

fn put(target: &str, name: &str, bytes: &[u8]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(folder.join(name), bytes).expect("a file");
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    image.write_to(&mut out, format).expect("an image can be encoded");
    out.into_inner()
}

fn picture(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| Rgb([(x * 7) as u8, (y * 11) as u8, (x * y) as u8]))
}

fn with_byte(first: u8, rest: &[u8]) -> Vec<u8> {
    let mut out = vec![first];
    out.extend(rest);
    out
}

const SIZE: Size = Size { width: 0.5, height: 0.9, depth: 0.5 };

fn answers() {
    for (i, question) in questions().iter().enumerate() {
        let text = question.example.to_string();
        put("answers", &format!("q{i}"), &with_byte(i as u8, text.as_bytes()));
        put("answers", &format!("q{i}_fenced"), &with_byte(i as u8, format!("So:\n```json\n{text}\n```").as_bytes()));
        let wide = text.replace("1.0", "1e308").replace("true", "null");
        put("answers", &format!("q{i}_wide"), &with_byte(i as u8, wide.as_bytes()));
    }
}

fn part_models() {
    let categories = [
        "chair", "sofa", "table", "bed", "wardrobe", "bookshelf", "floor lamp", "pendant lamp", "rug", "plant",
        "curtain", "window", "door", "picture", "mirror", "television", "cushion", "book", "vase", "bottle", "box",
        "refrigerator", "chandelier", "sink", "bathtub", "stairs", "unheard of",
    ];
    for name in categories {
        let model = template(name, &TemplateParams::default(), SIZE);
        let mut bytes = vec![128, 140, 128];
        bytes.extend(serde_json::to_vec(&model).expect("a model"));
        put("part_models", &name.replace(' ', "_"), &bytes);
    }
    let shapes = json!({"slots": [{"name": "a", "color": "#aabbcc"}], "parts": [
        {"shape": "lathe", "slot": "a", "points": [[0.5, 0], [1, 0.5], [0.2, 1]], "hollow": 0.1, "smooth": true},
        {"shape": "tube", "path": [[0, 0, 0], [0.5, 1, 0.5], [1, 0, 1]], "thickness": 0.1, "closed": true},
        {"shape": "extrude", "axis": "z", "points": [[0, 0], [1, 0], [0.5, 1]]},
        {"shape": "leaves", "habit": "palm", "count": 20, "seed": 3},
        {"shape": "cloth", "folds": 6}, {"shape": "back", "bend_deg": 90, "thickness": 0.1},
        {"shape": "group", "mirror": "xz", "parts": [{"shape": "cushion", "puff": 0.5, "turn_deg": [10, 20, 30]}]},
        {"shape": "cylinder", "top": 0.5, "sides": 6, "repeat": [{"axis": "x", "count": 3, "step": 0.2}]}]});
    let mut bytes = vec![0, 255, 128];
    bytes.extend(shapes.to_string().as_bytes());
    put("part_models", "every_shape", &bytes);
}

fn glb(model: &PartModel) -> Vec<u8> {
    let mut mesh = model.build(SIZE).expect("a template builds").mesh;
    let texture = RgbaImage::from_fn(4, 4, |x, y| Rgba([(x * 60) as u8, (y * 60) as u8, 3, 255]));
    mesh.materials[0].texture = Some(Arc::new(texture));
    let node = GlbNode {
        name: "object".into(),
        mesh: Arc::new(mesh),
        transform: NodeTransform::IDENTITY,
        extras: json!({"id": "object"}),
    };
    let scene = GlbScene {
        objects: vec![node],
        shell: Vec::new(),
        camera: None,
        lighting: None,
        extras: Value::Null,
        generator: "seeds".into(),
        textures: TextureEncoding::Compact,
    };
    glb_bytes(&scene).expect("a scene can be written")
}

fn boxes() -> PartModel {
    PartModel::from_json(r#"{"parts":[{"shape":"box","round":0}]}"#).expect("a box")
}

fn point_map() -> Vec<u8> {
    let n = 8 * 6;
    let xyz = (0..n).flat_map(|i| [(i % 8) as f32 * 0.1, (i / 8) as f32 * 0.1, 2.0 + i as f32 * 0.01]);
    npz_bytes(&[
        NpyEntry::f32("world_points", &[6, 8, 3], xyz),
        NpyEntry::f32("confidence", &[6, 8], (0..n).map(|_| 1.0)),
        NpyEntry::f64("intrinsic", &[3, 3], [8.0, 0.0, 4.0, 0.0, 8.0, 3.0, 0.0, 0.0, 1.0]),
        NpyEntry::f64("extrinsic", &[3, 4], [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
        NpyEntry::f64("pixel_centre", &[], [0.5]),
        NpyEntry::text("kind", "relative"),
    ])
    .expect("an archive")
}

fn npz() {
    put("npz", "own.npz", &point_map());
    let depth = npz_bytes(&[
        NpyEntry::f32("depth", &[1, 6, 8], (0..48).map(|i| 1.0 + i as f32 * 0.05)),
        NpyEntry::f64("K", &[3, 3], [8.0, 0.0, 4.0, 0.0, 8.0, 3.0, 0.0, 0.0, 1.0]),
    ]);
    put("npz", "depth.npz", &depth.expect("an archive"));
    for (name, kind, bytes_each) in [("f4", "<f4", 4), ("f8", ">f8", 8), ("u2", "<u2", 2), ("f2", "<f2", 2)] {
        let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': (6, 8), }}");
        let mut npy = b"\x93NUMPY\x01\x00".to_vec();
        npy.extend((header.len() as u16 + 1).to_le_bytes());
        npy.extend(header.as_bytes());
        npy.push(b'\n');
        npy.extend((0..48 * bytes_each).map(|i| (i * 5 % 64) as u8));
        put("npz", &format!("{name}.npy"), &npy);
    }
}

fn images() {
    let rgb = DynamicImage::ImageRgb8(picture(24, 18));
    for (name, format) in [
        ("png", ImageFormat::Png),
        ("jpg", ImageFormat::Jpeg),
        ("webp", ImageFormat::WebP),
        ("bmp", ImageFormat::Bmp),
        ("tif", ImageFormat::Tiff),
        ("ppm", ImageFormat::Pnm),
    ] {
        put("photos", name, &encoded(&rgb, format));
    }
    let deep = DynamicImage::ImageRgb16(rgb.to_rgb16());
    put("photos", "deep.png", &encoded(&deep, ImageFormat::Png));
    put("photos", "alpha.png", &encoded(&DynamicImage::ImageRgba8(rgb.to_rgba8()), ImageFormat::Png));
    put("photos", "grey.png", &encoded(&DynamicImage::ImageLuma8(rgb.to_luma8()), ImageFormat::Png));
    let mut exif = encoded(&rgb, ImageFormat::Jpeg);
    let tiff = b"\xff\xe1\x00\x2eExif\0\0II*\0\x08\0\0\0\x02\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\x69\x87\x04\0\x01\0\0\0\x26\0\0\0\0\0\0\0";
    exif.splice(2..2, tiff.iter().copied());
    put("photos", "exif.jpg", &exif);
    if let Ok(cmyk) = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../crates/harmony-io/tests/data/cmyk.jpg")) {
        put("photos", "cmyk.jpg", &cmyk);
    }
    let depth: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_fn(8, 6, |x, y| Luma([(1500 + 100 * x + 50 * y) as u16]));
    let depth = DynamicImage::ImageLuma16(depth);
    put("depth", "png", &with_byte(0, &encoded(&depth, ImageFormat::Png)));
    put("depth", "pgm", &with_byte(0, &encoded(&depth, ImageFormat::Pnm)));
    let mut lens = b"\x0b5e2,50,3,24".to_vec();
    lens.extend(encoded(&depth, ImageFormat::Png));
    put("depth", "lens", &lens);
    let flat = RgbImage::from_fn(64, 48, |x, y| match (x / 20, y / 20) {
        (1, 1) => Rgb([255, 0, 0]),
        (2, _) => Rgb([0, 0, 255]),
        _ => Rgb([0, 0, 0]),
    });
    let flat = DynamicImage::ImageRgb8(flat);
    let ids = DynamicImage::ImageLuma8(image::GrayImage::from_fn(64, 48, |x, _| Luma([(x / 20) as u8])));
    for (name, labels, image) in [
        ("coded", "", encoded(&flat, ImageFormat::Png)),
        ("named", r##"{"#ff0000": "sofa", "12": null, "chair_01": "chair"}"##, encoded(&flat, ImageFormat::Png)),
        ("ids", r#"{"1": "chair", "2": "table"}"#, encoded(&ids, ImageFormat::Png)),
        ("smeared", "", encoded(&flat, ImageFormat::Jpeg)),
    ] {
        let mut bytes = (labels.len() as u16).to_le_bytes().to_vec();
        bytes.extend(labels.as_bytes());
        bytes.extend(image);
        put("masks", name, &bytes);
    }
}

fn recordings() {
    let mut text = Vec::new();
    let mut section = |name: &str, bytes: &[u8]| {
        text.extend(format!("\n--- {name}\n").as_bytes());
        text.extend(bytes);
    };
    let zeros = "0".repeat(64);
    let answer = json!({"question": zeros, "player": "files", "model": "m"});
    let manifest = json!({"version": 1, "label": "l", "made_by": "m", "license": "CC0-1.0",
        "answers": {"vision_language/3_furniture/list": answer}});
    section("recording.json", manifest.to_string().as_bytes());
    section("vision_language/3_furniture/list/answer.json", br#"{"a": 1}"#);
    let box_ = json!({"x0": 1.0, "y0": 1.0, "x1": 5.0, "y1": 5.0});
    let found = json!({"detections": [{"label": "chair", "phrase": "chair", "box": box_, "score": 0.5, "outline": [[1, 2]]}]});
    section("detector/3_furniture/detect/answer.json", found.to_string().as_bytes());
    section("segmenter/3_furniture/segment/answer.json", br#"{"masks":[{"key":"chair_01","score":0.5}]}"#);
    let mask = Mask::from_fn(ImageSize::new(8, 6), |x, y| x > 2 && y > 2);
    let path = std::env::temp_dir().join(format!("harmony-seed-{}.png", std::process::id()));
    harmony_io::save_mask(&path, &mask).expect("a mask");
    section("segmenter/3_furniture/segment/masks/000.png", &std::fs::read(&path).expect("the mask"));
    let _ = std::fs::remove_file(path);
    section("image_editor/3_furniture/edit/answer.json", br#"{"image":"answer.png"}"#);
    let edited = encoded(&DynamicImage::ImageRgb8(picture(8, 6)), ImageFormat::Png);
    section("image_editor/3_furniture/edit/answer.png", &edited);
    let sheet = json!({"frame": "raw", "source": "s", "notes": [], "part_model": boxes(), "convex": [[[0, 0, 0], [1, 1, 1]]]});
    section("mesh_generator/3_furniture/chair_01/mesh/answer.json", sheet.to_string().as_bytes());
    section("mesh_generator/3_furniture/chair_01/mesh/answer.glb", &glb(&boxes()));
    section("geometry_estimator/1_layout/geometry/answer.json", br#"{"kind":"points"}"#);
    section("geometry_estimator/1_layout/geometry/points.npz", &point_map());
    put("recordings", "recording", &text);
    let run: Vec<u8> = String::from_utf8_lossy(&text)
        .replace("--- recording.json", "--- unused")
        .replace("/answer.json\n", "/record.json\n{}\n--- x/answer.json\n")
        .into_bytes();
    put("recordings", "run", &run);
    put("recordings", "small", &text[..600.min(text.len())]);
}

fn config() {
    let settings = toml::to_string_pretty(&harmony_pipeline::Settings::default()).expect("settings");
    put("config", "default", format!("profile = \"files\"\n[files]\nfolder = \"q\"\ntimeout_minutes = 5.0\n").as_bytes());
    let nested = settings.replace("\n[", "\n[settings.");
    put("config", "settings", format!("[settings]\n{nested}").as_bytes());
}

/// Every key and word of a schema.
fn words(value: &Value, out: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => {
            for (key, inner) in map {
                if key == "properties" {
                    out.extend(inner.as_object().into_iter().flat_map(|m| m.keys().cloned()));
                }
                words(inner, out);
            }
        }
        Value::Array(list) => list.iter().for_each(|v| words(v, out)),
        Value::String(text) if text.len() < 24 && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') => {
            out.insert(text.clone());
        }
        _ => {}
    }
}

fn dictionary(name: &str, words: &BTreeSet<String>) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("dict");
    std::fs::create_dir_all(&folder).expect("a folder");
    let mut text: String = words.iter().map(|w| format!("\"\\\"{w}\\\"\"\n")).collect();
    text.push_str("\"1e308\"\n\"-1e308\"\n\"null\"\n\"1e-308\"\n\"[\"\n\"{\"\n\"0.5\"\n");
    std::fs::write(folder.join(name), text).expect("a word list");
}

fn programs() {
    let examples = harmony_program::GUIDE.split("```python\n").skip(1).filter_map(|rest| rest.split("```").next());
    for (i, source) in examples.enumerate() {
        put("programs", &format!("guide_{i}"), source.as_bytes());
    }
    for (i, signature) in harmony_program::signatures().enumerate() {
        put("programs", &format!("call_{i:03}"), format!("def build(w, h, d):\n    return {signature}\n").as_bytes());
    }
    for (name, source) in [
        ("curve", "def build():\n    c = spline([(0, 0, 0), (0, 1, 0), (1, 1, 0)])\n    return group('a', c = sweep(c, 0.1), b = along(c, sphere(0.1), n = 4))\n"),
        ("surf", "def build():\n    return surf(lambda u, v: vec(u, v, math.sin(u)), 4, 4)\n"),
        ("outline", "def build():\n    return extrude(rect(1, 1, r = 0.1).hole(circle(0.2)).plus(text('Ab', 0.2)), 0.1)\n"),
    ] {
        put("programs", name, source.as_bytes());
    }
}

fn write_all() {
    programs();
    answers();
    part_models();
    put("glb", "box.glb", &glb(&boxes()));
    put("glb", "chair.glb", &glb(&PartModel::example()));
    npz();
    images();
    recordings();
    config();
    let mut all = BTreeSet::new();
    for question in questions() {
        words(&question.schema, &mut all);
    }
    dictionary("answers.dict", &all);
    let of_programs: BTreeSet<String> = harmony_program::signatures()
        .flat_map(|s| s.split(|c: char| !c.is_alphanumeric() && c != '_'))
        .filter(|w| w.len() > 1)
        .map(str::to_owned)
        .collect();
    dictionary("programs.dict", &of_programs);
    let mut of_models = BTreeSet::new();
    let inspect = serde_json::to_value(schemars::schema_for!(PartModel)).expect("a schema");
    words(&inspect, &mut of_models);
    dictionary("part_models.dict", &of_models);
}

fuzz_target!(init: write_all(), |_data: &[u8]| {});
