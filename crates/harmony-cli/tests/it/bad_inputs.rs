//! Input that is not good: each gets a result or a clear error with a hint, never a panic, never a file elsewhere.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::drawn::{empty_room, encoded, no_floor, one_wall, outdoors};
use crate::common::{self, harmony, program, said};
use image::{DynamicImage, GrayImage, ImageFormat, Luma, Rgb, RgbImage, Rgba};
use serde_json::Value;

/// A folder of its own for one case: the photo, the settings, the run three levels down.
struct Place {
    folder: tempfile::TempDir,
    before: Vec<PathBuf>,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("a/b")).unwrap();
        let settings = "[settings]\nworking_px = 256\nsurface_px_per_m = 20.0\n";
        fs::write(folder.path().join("settings.toml"), settings).unwrap();
        Self { folder, before: Vec::new() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn put(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }

    fn run(&self) -> PathBuf {
        self.path("a/b/run")
    }

    /// `harmony reconstruct` with further arguments.
    fn reconstruct(&mut self, photo: &Path, more: &[&str]) -> Output {
        self.before = self.outside();
        let output = program()
            .args(["reconstruct", "--no-lit"])
            .arg(photo)
            .arg("--out")
            .arg(self.run())
            .arg("--config")
            .arg(self.path("settings.toml"))
            .args(more)
            .output()
            .unwrap();
        self.judge(&output);
        output
    }

    /// Every file that is not of the run.
    fn outside(&self) -> Vec<PathBuf> {
        common::files(self.folder.path()).into_keys().filter(|path| !path.starts_with("a/b/run")).collect()
    }

    /// What holds however a run ended.
    fn judge(&self, output: &Output) {
        let said = said(output);
        assert!(!said.contains("panicked"), "{said}");
        let code = output.status.code();
        assert!(matches!(code, Some(0 | 1 | 3)), "exit {code:?}: {said}");
        if code != Some(0) {
            assert!(said.contains("error: "), "{said}");
        }
        assert_eq!(self.outside(), self.before, "files outside of the run folder");
    }

    fn json(&self, file: &str) -> Value {
        serde_json::from_slice(&fs::read(self.run().join(file)).unwrap()).unwrap()
    }

    /// The run is complete and says this about its input.
    fn complete(&self, output: &Output, warning: &str) {
        assert_eq!(output.status.code(), Some(0), "{}", said(output));
        for file in ["scene.json", "scene_full.glb", "render_flat.png", "segmentation.png", "report.html"] {
            assert!(self.run().join(file).is_file(), "{file} is missing");
        }
        let scene = self.json("scene.json");
        let room = &scene["room"]["extents"];
        for side in ["width", "height", "depth"] {
            let metres = room[side].as_f64().unwrap();
            assert!((0.8..=40.0).contains(&metres), "{side} of the room is {metres}");
        }
        let warnings = scene["warnings"].to_string();
        assert!(warnings.contains(warning), "{warning:?} is not among {warnings}");
    }
}

/// The error names what is wrong, and what to do.
fn refused(output: &Output, what: &str) {
    let said = said(output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("error: ") && said.contains("hint: ") && said.contains(what), "{what:?}: {said}");
}

fn png(image: RgbImage) -> Vec<u8> {
    encoded(&DynamicImage::ImageRgb8(image), ImageFormat::Png)
}

#[test]
fn what_is_no_whole_image_is_refused_with_a_hint() {
    let whole = png(empty_room(64, 48));
    let jpeg = encoded(&DynamicImage::ImageRgb8(empty_room(64, 48)), ImageFormat::Jpeg);
    let cases: [(&str, &[u8], &str); 6] = [
        ("text.jpg", b"this is no photo, whatever its name says", "not an image"),
        ("empty.png", b"", "empty"),
        ("cut.png", &whole[..whole.len() / 2], "damaged"),
        ("cut.jpg", &jpeg[..jpeg.len() / 2], "cut off"),
        ("head.png", &whole[..8], "damaged"),
        ("page.pdf", b"%PDF-1.7\n", "not"),
    ];
    for (name, bytes, what) in cases {
        let mut place = Place::new();
        let photo = place.put(name, bytes);
        let output = place.reconstruct(&photo, &[]);
        refused(&output, what);
        assert!(!place.run().exists(), "{name}: nothing was run");
    }
    let mut place = Place::new();
    let folder = place.path("a");
    refused(&place.reconstruct(&folder, &[]), "cannot read");
    let absent = place.path("no.jpg");
    refused(&place.reconstruct(&absent, &[]), "no.jpg");
    let small = place.put("small.png", png(empty_room(12, 9)));
    refused(&place.reconstruct(&small, &[]), "too few");
    // A header of 60 000 x 60 000 pixels: refused before memory is taken.
    let mut large = whole.clone();
    large[16..20].copy_from_slice(&60_000_u32.to_be_bytes());
    large[20..24].copy_from_slice(&60_000_u32.to_be_bytes());
    let crc = crc32(&large[12..29]);
    large[29..33].copy_from_slice(&crc.to_be_bytes());
    let large = place.put("large.png", &large);
    refused(&place.reconstruct(&large, &[]), "60000 x 60000");
}

/// CRC of PNG chunks.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 })
    })
}

#[test]
fn unusual_pixels_and_sizes_are_worked_with_and_told() {
    let room = || DynamicImage::ImageRgb8(empty_room(320, 240));
    let deep = encoded(&DynamicImage::ImageRgb16(room().to_rgb16()), ImageFormat::Png);
    let clear = image::RgbaImage::from_fn(320, 240, |x, y| {
        let p = room_pixel(x, y);
        Rgba([p[0], p[1], p[2], if y < 60 { 0 } else { 255 }])
    });
    let clear = encoded(&DynamicImage::ImageRgba8(clear), ImageFormat::Png);
    let grey = encoded(&DynamicImage::ImageLuma8(room().to_luma8()), ImageFormat::Png);
    let cmyk = fs::read(common::root().join("crates/harmony-io/tests/data/cmyk.jpg")).unwrap();
    let turned = with_orientation(&encoded(&room().rotate270(), ImageFormat::Jpeg), 6);
    let cases = [
        ("deep.png", deep, "16 bits"),
        ("clear.png", clear, "transparent"),
        ("grey.png", grey, "greyscale"),
        ("cmyk.jpg", cmyk, "CMYK"),
        ("turned.jpg", turned, "turned upright"),
        ("small.png", png(empty_room(200, 200)), "small"),
        ("panorama.png", png(empty_room(960, 240)), "panorama"),
    ];
    for (name, bytes, warning) in cases {
        let mut place = Place::new();
        let photo = place.put(name, &bytes);
        let output = place.reconstruct(&photo, &["--until", "wall"]);
        place.complete(&output, warning);
        let copy = format!("input.{}", photo.extension().unwrap().display());
        assert_eq!(fs::read(place.run().join(copy)).unwrap(), bytes, "{name}: the photo is kept as it is");
        if name == "turned.jpg" {
            let size = &place.json("camera.json");
            assert_eq!((size["width"].as_u64(), size["height"].as_u64()), (Some(320), Some(240)));
        }
    }
}

fn room_pixel(x: u32, y: u32) -> [u8; 3] {
    static ROOM: std::sync::OnceLock<RgbImage> = std::sync::OnceLock::new();
    ROOM.get_or_init(|| empty_room(320, 240)).get_pixel(x, y).0
}

/// A JPEG with an EXIF orientation.
fn with_orientation(jpeg: &[u8], orientation: u8) -> Vec<u8> {
    let mut out = jpeg[..2].to_vec();
    out.extend(b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0");
    out.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    out.extend(&jpeg[2..]);
    out
}

#[test]
#[cfg(target_os = "linux")]
fn a_hundred_megapixels_take_less_than_two_gibibytes() {
    let mut place = Place::new();
    let large = RgbImage::from_fn(11_600, 8_700, |x, y| Rgb([(x / 50) as u8, (y / 40) as u8, 120]));
    let photo = place.put("large.jpg", encoded(&DynamicImage::ImageRgb8(large), ImageFormat::Jpeg));
    place.before = place.outside();
    // Address space is more than memory: stacks of threads count in full.
    let script = "ulimit -v 2621440; exec \"$0\" reconstruct \"$1\" --out \"$2\" --config \"$3\" --no-lit --until wall";
    let clock = std::time::Instant::now();
    let output = std::process::Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_harmony")])
        .arg(&photo)
        .arg(place.run())
        .arg(place.path("settings.toml"))
        .env("TOKIO_WORKER_THREADS", "4")
        .output()
        .unwrap();
    place.judge(&output);
    place.complete(&output, "11600 x 8700");
    assert!(clock.elapsed().as_secs() < 120, "{:?}", clock.elapsed());
}

#[test]
fn pictures_that_are_no_furnished_rooms_give_a_scene_that_is_frank() {
    let flat = RgbImage::from_pixel(320, 240, Rgb([128, 128, 128]));
    let cases = [
        ("outdoors", outdoors(320, 240), "guess"),
        ("no_floor", no_floor(320, 240), ""),
        ("one_wall", one_wall(320, 240), ""),
        ("empty", empty_room(320, 240), ""),
        ("flat", flat, "one even colour"),
    ];
    for (name, image, warning) in cases {
        let mut place = Place::new();
        let photo = place.put(&format!("{name}.png"), png(image));
        let output = place.reconstruct(&photo, &[]);
        place.complete(&output, warning);
        let camera = place.json("camera.json");
        let confidence = camera["confidence"].as_f64().unwrap();
        assert!((0.0..=1.0).contains(&confidence), "{name}: {confidence}");
        if name != "empty" {
            assert!(confidence <= 0.6, "{name}: the room is said to be known with confidence {confidence}");
        }
        assert!(!camera["because"].to_string().is_empty());
    }
}

#[test]
fn point_maps_and_masks_that_cannot_be_used_are_refused_with_a_hint() {
    let depth = image::ImageBuffer::from_fn(32, 24, |x, y| Luma([(1000 + x * 20 + y * 10) as u16]));
    let depth = encoded(&DynamicImage::ImageLuma16(depth), ImageFormat::Png);
    let tall = image::ImageBuffer::from_fn(24, 99, |_, _| Luma([2000_u16]));
    let tall = encoded(&DynamicImage::ImageLuma16(tall), ImageFormat::Png);
    let zeros = image::ImageBuffer::from_fn(32, 24, |_, _| Luma([0_u16]));
    let zeros = encoded(&DynamicImage::ImageLuma16(zeros), ImageFormat::Png);
    let flat = |width, height| {
        let image = RgbImage::from_fn(width, height, |x, y| {
            if x > width / 2 && y > height / 2 { Rgb([255, 0, 0]) } else { Rgb([0, 0, 0]) }
        });
        png(image)
    };
    let lens = ["--intrinsics", "200,200,128,96"];
    let points: [(&str, &[u8], &[&str]); 8] = [
        ("garbage.npz", b"PK\x03\x04 and then nothing of the kind", &[]),
        ("garbage.npy", b"\x93NUMPY\x01\x00\xff\xff{'descr': '<f4'", &[]),
        ("garbage.txt", b"1 2 3", &[]),
        ("cut.png", &depth[..depth.len() - 20], &lens),
        ("no_lens.png", &depth, &[]),
        ("odd_lens.png", &depth, &["--intrinsics", "0,nan,1e308,-5"]),
        ("tall.png", &tall, &lens),
        ("zeros.png", &zeros, &lens),
    ];
    for (name, bytes, more) in points {
        let mut place = Place::new();
        let photo = place.put("photo.png", png(empty_room(320, 240)));
        let file = place.put(name, bytes);
        let mut args = vec!["--until", "layout", "--points", file.to_str().unwrap()];
        args.extend(more);
        let output = place.reconstruct(&photo, &args);
        assert_eq!(output.status.code(), Some(1), "{name}: {}", said(&output));
        assert!(said(&output).contains("hint: "), "{name}: {}", said(&output));
    }
    let smooth = png(RgbImage::from_fn(320, 240, |x, y| Rgb([x as u8, y as u8, (x * y) as u8])));
    let masks: [(&str, &[u8]); 5] = [
        ("garbage.png", b"\x89PNG\r\n\x1a\nno"),
        ("cut.png", &flat(320, 240)[..100]),
        ("tall.png", &flat(100, 300)),
        ("photo.png", &smooth),
        ("nothing.png", &encoded(&DynamicImage::ImageLuma8(GrayImage::new(320, 240)), ImageFormat::Png)),
    ];
    for (name, bytes) in masks {
        let mut place = Place::new();
        let photo = place.put("room.png", png(empty_room(320, 240)));
        let file = place.put(name, bytes);
        let output = place.reconstruct(&photo, &["--until", "layout", "--masks", file.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(1), "{name}: {}", said(&output));
        assert!(said(&output).contains("hint: "), "{name}: {}", said(&output));
    }
    let mut place = Place::new();
    let photo = place.put("room.png", png(empty_room(320, 240)));
    let folder = place.path("no_masks");
    fs::create_dir(&folder).unwrap();
    refused(&place.reconstruct(&photo, &["--masks", folder.to_str().unwrap()]), "no_masks");
}

#[test]
fn masks_of_another_size_and_with_hostile_labels_stay_in_the_run_folder() {
    let mut place = Place::new();
    let photo = place.put("room.png", png(empty_room(320, 240)));
    let masks = RgbImage::from_fn(640, 480, |x, y| match (x / 160, y / 160) {
        (1, 1) => Rgb([255, 0, 0]),
        (2, 2) => Rgb([0, 0, 255]),
        (0, 1) => Rgb([0, 255, 0]),
        _ => Rgb([0, 0, 0]),
    });
    let file = place.put("masks.png", png(masks));
    let long = "x".repeat(100_000);
    let labels =
        format!(r##"{{"#ff0000": "../../../evil", "#0000ff": "\u0000/etc/passwd\n<script>", "#00ff00": "{long}"}}"##);
    place.put("masks.json", labels);
    let output = place.reconstruct(&photo, &["--masks", file.to_str().unwrap()]);
    place.complete(&output, "");
    ids_are_plain(&place);
}

/// No id of the scene is more than a plain name, and the report shows no markup of a label.
fn ids_are_plain(place: &Place) {
    let scene = place.json("scene.json");
    for object in scene["objects"].as_array().unwrap() {
        let id = object["id"].as_str().unwrap();
        assert!(
            id.len() <= 80 && id.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_'),
            "{id}"
        );
        for number in object["size"].as_object().unwrap().values().chain(object["pose"]["position"].as_array().unwrap())
        {
            assert!(number.as_f64().is_some_and(|v| v.is_finite() && v.abs() < 100.0), "{id}: {number}");
        }
    }
    let page = fs::read_to_string(place.run().join("report.html")).unwrap();
    assert!(!page.contains("<script>alert"), "a label came into the report as markup");
}

#[test]
fn a_run_folder_that_cannot_be_written_is_named_with_a_hint() {
    let mut place = Place::new();
    let photo = place.put("room.png", png(empty_room(320, 240)));
    // A file where a folder is needed: root is refused as everybody is.
    let run = place.run();
    fs::write(&run, "in the way").unwrap();
    let output = place.reconstruct(&photo, &["--until", "layout"]);
    refused(&output, "run");
    fs::remove_file(&run).unwrap();
    for inner in ["calls", "1_layout", "scene.json/x", "run.json/x"] {
        fs::create_dir_all(&run).unwrap();
        let blocked = run.join(inner);
        fs::create_dir_all(blocked.parent().unwrap()).unwrap();
        fs::write(&blocked, "in the way").unwrap();
        let output = place.reconstruct(&photo, &["--until", "layout"]);
        let code = output.status.code().unwrap();
        assert!(code == 1 || code == 3, "{inner}: {code}");
        assert!(said(&output).contains("hint: "), "{inner}: {}", said(&output));
        assert_eq!(fs::read(&blocked).unwrap(), b"in the way", "{inner}: nothing of somebody else's is removed");
        fs::remove_dir_all(&run).unwrap();
    }
    let output = harmony(&["show", place.path("a").to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("is it a run folder"), "{}", said(&output));
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_ends_with_a_hint_and_the_same_command_goes_on_when_there_is_room_again() {
    let mut place = Place::new();
    let photo = place.put("room.png", png(empty_room(320, 240)));
    fs::create_dir(place.path("disk")).unwrap();
    place.before = place.outside();
    // A disk of its own in a name space of its own; gone when the shell ends.
    let script = r#"
mount -t tmpfs -o size="$4" tmpfs "$1" || exit 77
run() { "$0" reconstruct "$2" --out "$1/run" --config "$3" --no-lit --until wall; }
run "$@"; echo "first $?"
mount -o remount,size=100m "$1" || exit 77
find "$1/run" -type f -name '*.tmp' | while read -r litter; do echo "litter $litter"; done
run "$@"; echo "second $?"
"#;
    for size in ["8k", "100k", "400k"] {
        let output = std::process::Command::new("unshare")
            .args(["--mount", "--map-root-user", "sh", "-c", script, env!("CARGO_BIN_EXE_harmony")])
            .arg(place.path("disk"))
            .arg(&photo)
            .arg(place.path("settings.toml"))
            .arg(size)
            .output();
        let Some(output) = output.ok().filter(|o| String::from_utf8_lossy(&o.stdout).contains("first")) else {
            return harmony_testing::skip("no disk of its own can be made here");
        };
        let (out, err) = (String::from_utf8_lossy(&output.stdout).into_owned(), said(&output));
        assert!(!err.contains("panicked"), "{size}: {err}");
        assert!(out.contains("first 3") || out.contains("first 1"), "{size}: {out}{err}");
        assert!(err.contains("the disk is full"), "{size}: {out}{err}");
        assert!(!out.contains("litter"), "{size}: {out}");
        assert!(out.contains("second 0"), "{size}: {out}{err}");
        assert_eq!(place.outside(), place.before);
    }
}

#[test]
#[cfg(unix)]
fn a_limit_on_file_sizes_is_an_error_and_not_a_death() {
    let mut place = Place::new();
    let photo = place.put("room.png", png(empty_room(320, 240)));
    place.before = place.outside();
    let script = "trap '' XFSZ; ulimit -f 16; exec \"$0\" reconstruct \"$1\" --out \"$2\" --config \"$3\" --no-lit";
    let output = std::process::Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_harmony")])
        .arg(&photo)
        .arg(place.run())
        .arg(place.path("settings.toml"))
        .output()
        .unwrap();
    place.judge(&output);
    assert_eq!(output.status.code(), Some(3), "{}", said(&output));
}
