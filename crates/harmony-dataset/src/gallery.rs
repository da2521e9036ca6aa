//! Canonical views of many runs, side by side.
//! Key `gallery.canonical`.
//!
//! Paper: appendix "Canonical Views": "a canonical elevated viewpoint rather than the input camera, with the ceiling
//! and near wall removed so the full room layout is visible", so that arrangements can be compared over scenes. Every
//! room is framed by the same rule ([`harmony_render::canonical_camera`]: azimuth of the photo's camera, 36 degrees
//! above the horizon, 40 degrees of view, the room's box fills the frame but for 5 % on each side). Even light is
//! rendered here; path-traced pictures are taken from the runs, which made them by the same rule.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use harmony_imaging::sheet::{Cell, contact_sheet};
use harmony_io::{LoadedGlb, ReadLimits, load_glb, picture, read_json, write_atomic};
use harmony_render::{Instance, OUTSIDE, RenderOptions, RoomView, canonical_camera, orbit_cameras, render};
use harmony_scene::{Camera, ImageSize, Scene};
use image::imageops::FilterType;
use image::{DynamicImage, RgbImage};
use rayon::prelude::*;
use serde::Serialize;

use crate::DatasetError;
use crate::add::{put_json, write_folder};

/// Most runs of a gallery.
const MAX_RUNS: usize = 10_000;
/// Width over height of every picture.
const SHAPE: f64 = 4.0 / 3.0;

/// What to make.
#[derive(Debug, Clone, PartialEq)]
pub struct GalleryOptions {
    /// Columns of a picture, pixels.
    pub width: u32,
    /// Pictures of a turntable; 0 = none.
    pub frames: usize,
    /// Columns of a turntable, pixels.
    pub turntable_width: u32,
    /// Seconds of a turntable's round.
    pub seconds: f64,
    /// Columns of the contact sheets.
    pub columns: u32,
    /// Side of a cell of the contact sheets, pixels.
    pub cell: u32,
}

impl Default for GalleryOptions {
    fn default() -> Self {
        Self { width: 1280, frames: 36, turntable_width: 480, seconds: 6.0, columns: 4, cell: 480 }
    }
}

/// One run in the gallery.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Shown {
    /// Its name in the gallery.
    pub name: String,
    /// Room type.
    pub room_type: String,
    /// Objects.
    pub objects: usize,
    /// Whether there is a path-traced canonical view.
    pub lit: bool,
    /// Why the run could not be shown; empty = it is shown.
    pub failed: String,
}

/// The runs in some folders: a folder that is a run (or a data set's scene), or those one or two levels below it.
///
/// # Errors
/// A folder that cannot be read, or none with a run.
pub fn find_runs(folders: &[PathBuf]) -> Result<Vec<PathBuf>, DatasetError> {
    let mut runs = Vec::new();
    for folder in folders {
        if !folder.is_dir() {
            return Err(DatasetError::read(folder, std::io::Error::from(std::io::ErrorKind::NotFound)));
        }
        let before = runs.len();
        look(folder, 2, &mut runs)?;
        if runs.len() == before {
            return Err(DatasetError::NoRuns(folder.display().to_string()));
        }
    }
    runs.truncate(MAX_RUNS);
    Ok(runs)
}

fn look(folder: &Path, deeper: usize, runs: &mut Vec<PathBuf>) -> Result<(), DatasetError> {
    if glb_of(folder).is_some() && folder.join("scene.json").is_file() {
        runs.push(folder.to_owned());
        return Ok(());
    }
    if deeper == 0 {
        return Ok(());
    }
    let mut inside = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| DatasetError::read(folder, e))? {
        let path = entry.map_err(|e| DatasetError::read(folder, e))?.path();
        if path.is_dir() && !path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.')) {
            inside.push(path);
        }
    }
    inside.sort();
    inside.iter().try_for_each(|path| look(path, deeper - 1, runs))
}

fn glb_of(folder: &Path) -> Option<PathBuf> {
    ["scene_full.glb", "scene.glb"].iter().map(|f| folder.join(f)).find(|p| p.is_file())
}

/// Makes a gallery in a folder that must not exist: pictures, contact sheets, turntables, `index.html`.
///
/// A run that cannot be read is named in the result and on the page; the others are shown.
///
/// # Errors
/// An unwritable folder, or no run that can be shown.
pub fn make(runs: &[PathBuf], out: &Path, options: &GalleryOptions) -> Result<Vec<Shown>, DatasetError> {
    if out.exists() {
        return Err(DatasetError::Exists(out.to_owned()));
    }
    let names = names(runs);
    let mut shown = Vec::new();
    write_folder(out, |folder| {
        for (run, name) in runs.iter().zip(&names) {
            shown.push(one(run, name, folder, options).unwrap_or_else(|error| Shown {
                name: name.clone(),
                room_type: String::new(),
                objects: 0,
                lit: false,
                failed: error.to_string(),
            }));
        }
        if shown.iter().all(|s| !s.failed.is_empty()) {
            let why = shown.first().map_or_else(String::new, |s| format!("{}: {}", s.name, s.failed));
            return Err(DatasetError::NoRuns(why));
        }
        sheets(&shown, folder, options)?;
        put_json(folder, "gallery.json", &serde_json::json!({ "runs": shown }))?;
        Ok(write_atomic(&folder.join("index.html"), page(&shown, options).as_bytes())?)
    })?;
    Ok(shown)
}

/// A name for each run: its folder's, with a number where two are the same.
fn names(runs: &[PathBuf]) -> Vec<String> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    runs.iter()
        .map(|run| {
            let name = run.file_name().map_or_else(|| "run".into(), |n| n.to_string_lossy().into_owned());
            let name: String =
                name.chars().map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect();
            let count = seen.entry(name.clone()).or_insert(0);
            *count += 1;
            if *count == 1 { name } else { format!("{name}~{count}") }
        })
        .collect()
}

/// The pictures of one run.
fn one(run: &Path, name: &str, out: &Path, options: &GalleryOptions) -> Result<Shown, DatasetError> {
    let scene: Scene = read_json(&run.join("scene.json"))?;
    let path = glb_of(run).ok_or_else(|| DatasetError::NoRun { folder: run.to_owned(), missing: "scene_full.glb" })?;
    let glb = load_glb(&path, &ReadLimits::default()).map_err(|source| DatasetError::Glb { path, source })?;
    let e = scene.room.extents;
    if ![e.width, e.height, e.depth].iter().all(|v| v.is_finite() && *v > 0.01 && *v < 1000.0) {
        return Err(DatasetError::Value {
            what: "the room's size",
            value: format!("{e:?}"),
            why: "it must be between 1 cm and 1 km",
        });
    }
    let folder = out.join(name);
    let size = frame(options.width);
    let flat =
        picture_of(&scene, &glb, &canonical_camera(&scene.room, size, &Camera::from(&scene.camera), &scene.stands()));
    let put = |file: &str, image: &RgbImage| {
        let path = folder.join(file);
        picture::write_rgb_png(&path, image).map_err(|source| DatasetError::Picture { path, source })
    };
    put("canonical_flat.png", &flat)?;
    let mut lit = false;
    let lit_path = ["render_lit_canonical.png"].iter().map(|f| run.join(f)).find(|p| p.is_file());
    if let Some(path) = lit_path {
        let image = picture::read(&path).map_err(|source| DatasetError::Picture { path, source })?;
        let shape = f64::from(image.width()) / f64::from(image.height().max(1));
        // Another shape has another framing.
        if (shape / SHAPE - 1.0).abs() < 0.01 {
            let image = image.resize_exact(size.width, size.height, FilterType::CatmullRom).to_rgb8();
            put("canonical_lit.png", &image)?;
            lit = true;
        }
    }
    if options.frames > 0 {
        let frames = turntable(&scene, &glb, options);
        let milliseconds = (options.seconds * 1000.0 / options.frames as f64).round() as u32;
        write_atomic(&folder.join("turntable.webp"), &animated_webp(&frames, milliseconds)?)?;
    }
    Ok(Shown {
        name: name.to_owned(),
        room_type: scene.room.room_type.clone(),
        objects: scene.objects.len(),
        lit,
        failed: String::new(),
    })
}

fn frame(width: u32) -> ImageSize {
    let width = width.clamp(64, 4096);
    ImageSize::new(width, (f64::from(width) / SHAPE).round() as u32)
}

/// The views all around, one round.
fn turntable(scene: &Scene, glb: &LoadedGlb, options: &GalleryOptions) -> Vec<RgbImage> {
    orbit_cameras(&scene.room, frame(options.turntable_width), options.frames)
        .par_iter()
        .map(|view| picture_of(scene, glb, view))
        .collect()
}

/// The scene in even light, without the faces that hide the room and what is fixed to them.
fn picture_of(scene: &Scene, glb: &LoadedGlb, view: &RoomView) -> RgbImage {
    let gone = scene.gone_with(&view.omit);
    let faces: Vec<&str> = view.omit.iter().map(|s| harmony_mesh::shell_material_name(*s)).collect();
    let hidden = |name: &str| harmony_mesh::is_left_out(name, &faces) || gone.iter().any(|id| id.as_str() == name);
    let instances: Vec<Instance<'_>> = glb
        .nodes
        .iter()
        .filter(|node| !hidden(&node.name))
        .map(|node| Instance {
            mesh: &node.mesh,
            linear: DMat3::from_cols_array(&node.transform.matrix3.to_cols_array()),
            translation: DVec3::from_array(node.transform.translation.to_array()),
            id: 0,
        })
        .collect();
    let options = RenderOptions { multisample: true, background: OUTSIDE, ..RenderOptions::default() };
    DynamicImage::ImageRgba8(render(&view.camera, &instances, &options).color).to_rgb8()
}

/// Contact sheets of what is there.
fn sheets(shown: &[Shown], out: &Path, options: &GalleryOptions) -> Result<(), DatasetError> {
    for (sheet, file) in [("sheet_flat.png", "canonical_flat.png"), ("sheet_lit.png", "canonical_lit.png")] {
        let mut pictures = Vec::new();
        for run in shown.iter().filter(|s| s.failed.is_empty()) {
            let path = out.join(&run.name).join(file);
            if path.is_file() {
                let image = picture::read(&path).map_err(|source| DatasetError::Picture { path, source })?;
                let side = options.cell;
                pictures.push((run.name.clone(), image.resize(side, side, FilterType::CatmullRom).to_rgba8()));
            }
        }
        if pictures.is_empty() {
            continue;
        }
        let cells: Vec<Cell<'_>> = pictures.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
        let path = out.join(sheet);
        let image = contact_sheet(&cells, options.columns, options.cell);
        picture::write_rgb_png(&path, &image).map_err(|source| DatasetError::Picture { path, source })?;
    }
    Ok(())
}

/// An endless animated WebP of frames of the same size.
///
/// Container as in the WebP specification: `VP8X` with the animation flag, `ANIM`, and for each picture an `ANMF` with
/// the encoder's own chunk. Frames are lossy (libwebp), each on its own.
///
/// # Errors
/// Frames of other sizes or of more than 16,384 pixels a side; a frame that the encoder does not take.
pub fn animated_webp(frames: &[RgbImage], milliseconds: u32) -> Result<Vec<u8>, DatasetError> {
    let refuse = |why| DatasetError::Format { what: "the turntable".to_owned(), format: "WebP", why };
    let (w, h) = frames.first().map(RgbImage::dimensions).ok_or_else(|| refuse("it has no picture"))?;
    if frames.iter().any(|f| f.dimensions() != (w, h)) || w == 0 || h == 0 || w > 16_383 || h > 16_383 {
        return Err(refuse("its pictures must be of one size below 16384 pixels"));
    }
    let three = |v: u32| [v as u8, (v >> 8) as u8, (v >> 16) as u8];
    let encoded: Vec<Vec<u8>> = frames
        .par_iter()
        .map(|frame| {
            let file = webp::Encoder::from_rgb(frame.as_raw(), w, h).encode(80.0);
            // RIFF, size, WEBP; then the chunks of a still picture.
            file.get(12..).map(<[u8]>::to_vec).filter(|c| c.starts_with(b"VP8 ")).ok_or_else(|| refuse("no VP8 chunk"))
        })
        .collect::<Result<_, _>>()?;
    let mut chunks = b"VP8X\x0a\0\0\0\x02\0\0\0".to_vec();
    chunks.extend(three(w - 1));
    chunks.extend(three(h - 1));
    // Background (not used: pictures fill the frame), no end.
    chunks.extend(b"ANIM\x06\0\0\0\xff\xff\xff\xff\0\0");
    for picture in encoded {
        chunks.extend(b"ANMF");
        chunks.extend((16 + picture.len() as u32).to_le_bytes());
        chunks.extend([0; 6]);
        chunks.extend(three(w - 1));
        chunks.extend(three(h - 1));
        chunks.extend(three(milliseconds.min(0xff_ffff)));
        // Pictures replace, they do not blend.
        chunks.push(0b10);
        chunks.extend(&picture);
        if picture.len() % 2 == 1 {
            chunks.push(0);
        }
    }
    let size = u32::try_from(chunks.len() + 4).map_err(|_| refuse("it is larger than 4 GB"))?;
    Ok([b"RIFF".to_vec(), size.to_le_bytes().to_vec(), b"WEBP".to_vec(), chunks].concat())
}

/// A page of all runs; works from disk, offline.
fn page(shown: &[Shown], options: &GalleryOptions) -> String {
    let esc = |t: &str| t.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;");
    let mut out = "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
        content=\"width=device-width,initial-scale=1\"><title>Gallery</title><style>body{font:16px/1.5 system-ui,sans-serif;\
        margin:1.5rem;background:#fff;color:#1c2026}main{display:grid;grid-template-columns:repeat(auto-fill,minmax(20rem,1fr));\
        gap:1.2rem}figure{margin:0}img{width:100%;display:block;border-radius:6px;aspect-ratio:4/3;background:#ebeef2}\
        figcaption{display:flex;gap:.8rem;flex-wrap:wrap}small{color:#5c6470}</style></head><body><h1>Gallery</h1>\
        <p>Canonical views: ceiling and near walls left out, every room framed by the same rule.</p><main>"
        .to_owned();
    for run in shown.iter().filter(|s| s.failed.is_empty()) {
        let name = esc(&run.name);
        let main = if run.lit { "canonical_lit.png" } else { "canonical_flat.png" };
        let _ = write!(
            out,
            "<figure><a href=\"{name}/{main}\"><img src=\"{name}/{main}\" alt=\"{name}, canonical view\" loading=\"lazy\"></a>\
             <figcaption><b>{name}</b><small>{}, {} objects</small><a href=\"{name}/canonical_flat.png\">even light</a>",
            esc(&run.room_type),
            run.objects
        );
        if run.lit {
            let _ = write!(out, "<a href=\"{name}/canonical_lit.png\">path-traced</a>");
        }
        if options.frames > 0 {
            let _ = write!(out, "<a href=\"{name}/turntable.webp\">turntable</a>");
        }
        out.push_str("</figcaption></figure>");
    }
    out.push_str("</main>");
    let failed: Vec<&Shown> = shown.iter().filter(|s| !s.failed.is_empty()).collect();
    if !failed.is_empty() {
        out.push_str("<h2>Not shown</h2><ul>");
        for run in failed {
            let _ = write!(out, "<li>{}: {}</li>", esc(&run.name), esc(&run.failed));
        }
        out.push_str("</ul>");
    }
    out.push_str("</body></html>\n");
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::AnimationDecoder as _;
    use image::Rgb;

    #[test]
    fn a_turntable_is_read_back_by_another_decoder() {
        let frames: Vec<RgbImage> = (0..5).map(|i| RgbImage::from_pixel(33, 21, Rgb([50 * i as u8, 90, 10]))).collect();
        let bytes = animated_webp(&frames, 120).unwrap();
        let decoder = image::codecs::webp::WebPDecoder::new(std::io::Cursor::new(&bytes)).unwrap();
        assert!(decoder.has_animation());
        let read = decoder.into_frames().collect_frames().unwrap();
        assert_eq!(read.len(), 5);
        for (i, frame) in read.iter().enumerate() {
            assert_eq!(frame.delay().numer_denom_ms(), (120, 1));
            let pixel = frame.buffer().get_pixel(16, 10).0;
            let wanted = [50 * i as u8, 90, 10];
            assert!(pixel.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) < 6), "{pixel:?} {wanted:?}");
        }
        assert!(animated_webp(&[], 10).is_err());
        assert!(animated_webp(&[RgbImage::new(2, 2), RgbImage::new(3, 2)], 10).is_err());
    }

    #[test]
    fn names_are_distinct_and_plain() {
        let runs = ["a/room", "b/room", "c/my room"].map(PathBuf::from);
        assert_eq!(names(&runs), ["room", "room~2", "my_room"]);
    }
}
