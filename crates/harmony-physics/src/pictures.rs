//! Pictures of an earthquake: frames, a sheet of six, an animation, and the same path-traced where Blender is there.
//!
//! The camera is fixed to the room, as the photo's would be if it hung on the wall. The animation is a GIF: one palette for
//! all frames, and of each frame only the rectangle that changed, so that a still background costs nothing.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use color_quant::NeuQuant;
use harmony_io::LoadedGlb;
use harmony_lighting::{CyclesJob, CyclesRenderer, LitError};
use harmony_mesh::{is_left_out, shell_material_name};
use harmony_render::{Instance, OUTSIDE, RenderOptions, Renderer};
use harmony_scene::{AlbedoField, Camera, Mat3, Scene, Surface, Vec3};
use image::{DynamicImage, Rgb, RgbImage};

use crate::animate::{AnimateError, still_glb};
use crate::quake::Shaken;
use crate::world::Placed;

/// Frames of a sheet.
pub const SHEET_FRAMES: usize = 6;
/// Frames of the animation a second: every second one of the trajectories.
pub const FILM_STEP: usize = 2;
/// White between the pictures of a sheet, pixels.
const GAP_PX: u32 = 6;
/// Farther than this an object has left what the photo says of its colour, metres.
const SAME_PLACE_M: f64 = 0.02;
/// And turned by more than this, radians.
const SAME_TURN_RAD: f64 = 0.03;
/// Colours of the palette; the last index is "as before".
const COLORS: usize = 255;

/// A picture that cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// The animation cannot be encoded.
    #[error("the animation cannot be encoded: {0}")]
    Gif(#[from] gif::EncodingError),
    /// The picture is too large for a GIF, or there is none.
    #[error("{width} x {height} pixels cannot be a GIF")]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The scene's file.
    #[error(transparent)]
    Animate(#[from] AnimateError),
    /// Path tracing.
    #[error(transparent)]
    Lit(#[from] LitError),
    /// Path tracing ended without one.
    #[error("Blender made no picture")]
    None,
    /// Files.
    #[error("could not {what}")]
    Io {
        /// What was tried.
        what: &'static str,
        /// Why not.
        #[source]
        source: std::io::Error,
    },
}

/// Numbers of the evenly spaced frames of a sheet, first and last among them.
pub fn sheet_frames(frames: usize) -> Vec<usize> {
    let last = frames.saturating_sub(1);
    (0..SHEET_FRAMES).map(|k| last * k / (SHEET_FRAMES - 1)).collect()
}

/// Draws frames of one earthquake.
pub struct Painter<'a> {
    glb: &'a LoadedGlb,
    shaken: &'a Shaken,
    camera: Camera,
    hidden: Vec<&'static str>,
    renderer: Renderer,
}

impl<'a> Painter<'a> {
    /// From a camera, some faces of the room left out.
    pub fn new(glb: &'a LoadedGlb, shaken: &'a Shaken, camera: Camera, omit: &[Surface]) -> Self {
        let hidden = omit.iter().map(|s| shell_material_name(*s)).collect();
        Self { glb, shaken, camera, hidden, renderer: Renderer::new() }
    }

    /// One frame in even light.
    pub fn frame(&self, frame: usize) -> RgbImage {
        let instances: Vec<Instance<'_>> = self
            .glb
            .nodes
            .iter()
            .filter(|node| !is_left_out(&node.name, &self.hidden))
            .map(|node| {
                let still = node.transform.matrix3;
                let object = self.shaken.objects.iter().find(|o| o.id == node.name);
                match object.and_then(|o| Some((o.at(0)?, o.at(frame)?))) {
                    Some((first, now)) => {
                        // The scale stays that of the node.
                        let turn = rotation(&now) * rotation(&first).transpose();
                        Instance { mesh: &node.mesh, linear: turn * still, translation: now.position, id: 1 }
                    }
                    None => {
                        Instance { mesh: &node.mesh, linear: still, translation: node.transform.translation, id: 1 }
                    }
                }
            })
            .collect();
        let options = RenderOptions { multisample: true, background: OUTSIDE, ..RenderOptions::default() };
        let drawn = self.renderer.render(&self.camera, &instances, &options);
        DynamicImage::ImageRgba8(drawn.color).to_rgb8()
    }
}

fn rotation(place: &Placed) -> Mat3 {
    Mat3::from_cols(place.turned(Vec3::X), place.turned(Vec3::Y), place.turned(Vec3::Z))
}

/// Pictures of equal size in rows of three, as in the paper's figure.
pub fn sheet(pictures: &[RgbImage]) -> RgbImage {
    let (w, h) = pictures.first().map_or((1, 1), RgbImage::dimensions);
    let columns = 3.min(pictures.len().max(1)) as u32;
    let rows = (pictures.len() as u32).div_ceil(columns).max(1);
    let size = |n: u32, side: u32| n * side + (n - 1) * GAP_PX;
    let mut out = RgbImage::from_pixel(size(columns, w), size(rows, h), Rgb([255; 3]));
    for (k, picture) in pictures.iter().enumerate() {
        let (column, row) = (k as u32 % columns, k as u32 / columns);
        let at = (i64::from(column * (w + GAP_PX)), i64::from(row * (h + GAP_PX)));
        image::imageops::replace(&mut out, picture, at.0, at.1);
    }
    out
}

/// The bytes of an endless GIF.
///
/// # Errors
/// [`PictureError::Size`], [`PictureError::Gif`].
pub fn gif_bytes(frames: &[RgbImage], frames_per_second: f64) -> Result<Vec<u8>, PictureError> {
    let (w, h) = frames.first().map_or((0, 0), RgbImage::dimensions);
    let (Ok(width), Ok(height)) = (u16::try_from(w), u16::try_from(h)) else {
        return Err(PictureError::Size { width: w, height: h });
    };
    if width == 0 || height == 0 {
        return Err(PictureError::Size { width: w, height: h });
    }
    // The palette is learnt from some frames: what moves shows other sides.
    let some = [0, frames.len() / 2, frames.len() - 1];
    let rgba: Vec<u8> = some.iter().flat_map(|k| frames[*k].pixels()).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
    let quant = NeuQuant::new(if rgba.len() < 1 << 20 { 1 } else { 5 }, COLORS, &rgba);
    let mut palette = quant.color_map_rgb();
    palette.resize(3 * COLORS, 0);
    palette.extend([0, 0, 0]);
    let mut table = std::collections::BTreeMap::new();
    let mut index = |p: [u8; 3]| *table.entry(p).or_insert_with(|| quant.index_of(&[p[0], p[1], p[2], 255]) as u8);
    let mut bytes = Vec::new();
    {
        let mut encoder = gif::Encoder::new(&mut bytes, width, height, &palette)?;
        encoder.set_repeat(gif::Repeat::Infinite)?;
        let mut shown: Vec<u8> = Vec::new();
        for (k, frame) in frames.iter().enumerate() {
            let now: Vec<u8> = frame.pixels().map(|p| index(p.0)).collect();
            // Hundredths of a second, rounded so that the sum is right.
            let at = |n: usize| (n as f64 * 100.0 / frames_per_second).round() as u64;
            let delay = (at(k + 1) - at(k)) as u16;
            encoder.write_frame(&changed(&now, &shown, width, height, delay))?;
            shown = now;
        }
    }
    Ok(bytes)
}

/// The rectangle of a frame that differs from what is shown; what is equal inside it is transparent.
fn changed(now: &[u8], shown: &[u8], width: u16, height: u16, delay: u16) -> gif::Frame<'static> {
    let w = usize::from(width);
    let differs = |i: usize| shown.get(i) != Some(&now[i]);
    let (mut left, mut right, mut top, mut bottom) = (w, 0, usize::from(height), 0);
    for i in (0..now.len()).filter(|i| differs(*i)) {
        (left, right) = (left.min(i % w), right.max(i % w + 1));
        (top, bottom) = (top.min(i / w), bottom.max(i / w + 1));
    }
    if left >= right {
        (left, right, top, bottom) = (0, 1, 0, 1);
    }
    let pixel = |i: usize| if differs(i) { now[i] } else { COLORS as u8 };
    let buffer: Vec<u8> = (top..bottom).flat_map(|y| (left..right).map(move |x| y * w + x)).map(pixel).collect();
    gif::Frame {
        delay,
        dispose: gif::DisposalMethod::Keep,
        transparent: Some(COLORS as u8),
        left: left as u16,
        top: top as u16,
        width: (right - left) as u16,
        height: (bottom - top) as u16,
        buffer: buffer.into(),
        ..gif::Frame::default()
    }
}

/// The bytes of an MP4 (H.264) made by ffmpeg; `None` when there is no ffmpeg or it cannot do it.
///
/// # Errors
/// [`PictureError::Io`] for files of our own.
pub fn mp4_bytes(frames: &[RgbImage], frames_per_second: f64) -> Result<Option<Vec<u8>>, PictureError> {
    let io = |what: &'static str| move |source| PictureError::Io { what, source };
    let Some(first) = frames.first() else { return Ok(None) };
    // H.264 halves the colours: even sides only.
    let (w, h) = (first.width() & !1, first.height() & !1);
    if w == 0 || h == 0 {
        return Ok(None);
    }
    let folder = tempfile::tempdir().map_err(io("make a temporary folder for the film"))?;
    let path = folder.path().join("film.mp4");
    let mut command = Command::new("ffmpeg");
    command
        .args(["-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", &format!("{w}x{h}")])
        .args([
            "-r",
            &format!("{frames_per_second}"),
            "-i",
            "-",
            "-c:v",
            "libx264",
            "-pix_fmt",
            "yuv420p",
            "-crf",
            "20",
        ])
        .args(["-movflags", "+faststart", "-bitexact", "-threads", "1"])
        .arg(&path)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let Ok(mut child) = command.spawn() else { return Ok(None) };
    if let Some(mut pipe) = child.stdin.take() {
        for frame in frames {
            let even = image::imageops::crop_imm(frame, 0, 0, w, h).to_image();
            if pipe.write_all(even.as_raw()).is_err() {
                break;
            }
        }
    }
    let done = child.wait().map_err(io("wait for ffmpeg"))?;
    if !done.success() {
        return Ok(None);
    }
    std::fs::read(&path).map(Some).map_err(io("read the film of ffmpeg"))
}

/// What path-traced pictures of a scene in which things have moved share.
pub struct Lit<'a> {
    /// Blender.
    pub renderer: &'a CyclesRenderer,
    /// The scene as it was.
    pub scene: &'a Scene,
    /// What the run found of its reflectances.
    pub albedo: Option<AlbedoField>,
    /// Samples a pixel.
    pub samples: u32,
    /// Where pictures are kept by their content, so that who was interrupted goes on where that was; `None` keeps none.
    pub kept: Option<PathBuf>,
}

/// From where a path-traced picture is taken.
#[derive(Debug, Clone)]
pub struct LitView {
    /// The camera.
    pub camera: Camera,
    /// Nodes that it does not see, though they bounce light.
    pub hidden: Vec<String>,
    /// Nodes whose base colours are reflectances: they come from no photo.
    pub true_colors: Vec<String>,
}

/// An object that is elsewhere than in the scene.
#[derive(Debug, Clone, Copy)]
pub struct Moved<'a> {
    /// Its node.
    pub id: &'a str,
    /// Where the scene has it.
    pub first: Placed,
    /// Where it is.
    pub now: Placed,
}

impl Lit<'_> {
    /// Path-traces a GLB file of the scene, in the room's frame, with the scene's own light.
    ///
    /// An object that has moved takes the mean of its reflectances, for the photo no longer says where which colour is. A
    /// lamp that moves takes its light along.
    ///
    /// # Errors
    /// [`PictureError`].
    pub fn picture(&self, glb: &[u8], moved: &[Moved<'_>], view: &LitView) -> Result<RgbImage, PictureError> {
        let mut lighting = self.scene.lighting.clone();
        let mut albedo = self.albedo.clone();
        for Moved { id, first, now } in moved {
            if first.position.distance(now.position) < SAME_PLACE_M && turned(first, now) < SAME_TURN_RAD {
                continue;
            }
            for (name, cells) in albedo.iter_mut().flat_map(|a| &mut a.nodes) {
                if name.split('/').next() == Some(*id) {
                    cells.factors.clear();
                }
            }
            let turn = rotation(now) * rotation(first).transpose();
            let on = |o: &harmony_scene::ObjectId| o.as_str() == *id;
            for light in lighting.lights.iter_mut().filter(|l| l.object.as_ref().is_some_and(on)) {
                let at = Vec3::from_array(light.position) - first.position;
                light.position = (now.position + turn * at).to_array();
            }
        }
        let kept = self.kept.as_ref().map(|folder| {
            let told = serde_json::json!([lighting, albedo, view.camera, view.hidden, view.true_colors, self.samples]);
            let mut hasher = blake3::Hasher::new();
            hasher.update(told.to_string().as_bytes()).update(glb);
            folder.join(format!("{}.png", hasher.finalize().to_hex()))
        });
        if let Some(picture) = kept.as_ref().and_then(|path| image::open(path).ok()) {
            return Ok(picture.to_rgb8());
        }
        let folder = tempfile::tempdir()
            .map_err(|source| PictureError::Io { what: "make a temporary folder for the render", source })?;
        let path = folder.path().join("scene.glb");
        harmony_io::write_atomic(&path, glb)
            .map_err(|e| PictureError::Io { what: "write the scene of the frame", source: std::io::Error::other(e) })?;
        let mut job = CyclesJob::lit(path, view.camera, lighting);
        job.room = Some(self.scene.room.extents);
        job.samples = self.samples;
        job.albedo = albedo.map(std::sync::Arc::new);
        job.hidden_nodes.clone_from(&view.hidden);
        job.true_colors.clone_from(&view.true_colors);
        let outside = [0, 1, 2].map(|c| f64::from(OUTSIDE[c]) / 255.0);
        job.background = (!view.hidden.is_empty()).then_some(outside);
        let picture = self.renderer.render(&job)?.image.ok_or(PictureError::None)?;
        if let Some(path) = &kept {
            harmony_io::picture::write_rgb_png(path, &picture).map_err(|e| PictureError::Io {
                what: "keep the picture of the frame",
                source: std::io::Error::other(e),
            })?;
        }
        Ok(picture)
    }

    /// One frame of an earthquake; `glb` is the scene's file.
    ///
    /// # Errors
    /// [`PictureError`].
    pub fn frame(&self, glb: &[u8], shaken: &Shaken, frame: usize, camera: Camera) -> Result<RgbImage, PictureError> {
        let moved = shaken.objects.iter().filter_map(|o| Some(Moved { id: &o.id, first: o.at(0)?, now: o.at(frame)? }));
        let view = LitView { camera, hidden: vec![], true_colors: vec![] };
        self.picture(&still_glb(glb, shaken, frame)?, &moved.collect::<Vec<_>>(), &view)
    }
}

/// Angle between two places' turns, radians.
fn turned(first: &Placed, now: &Placed) -> f64 {
    let dot: f64 = first.rotation.iter().zip(now.rotation).map(|(a, b)| a * b).sum();
    2.0 * dot.abs().min(1.0).acos()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot(x: u32) -> RgbImage {
        RgbImage::from_fn(40, 30, |px, py| {
            if px.abs_diff(x) <= 2 && py.abs_diff(5) <= 2 { Rgb([250, 10, 10]) } else { Rgb([20, 40, (px * 5) as u8]) }
        })
    }

    #[test]
    fn six_frames_from_first_to_last() {
        assert_eq!(sheet_frames(301), [0, 60, 120, 180, 240, 300]);
        assert_eq!(sheet_frames(1), [0; 6]);
        let all = sheet(&vec![dot(3); 6]);
        assert_eq!(all.dimensions(), (3 * 40 + 2 * GAP_PX, 2 * 30 + GAP_PX));
        assert_eq!(all.get_pixel(46 + 3, 36 + 5), &Rgb([250, 10, 10]));
    }

    #[test]
    fn a_gif_plays_what_it_was_given() {
        let frames: Vec<RgbImage> = (0..6).map(|k| dot(3 + 4 * k)).collect();
        let bytes = gif_bytes(&frames, 15.0).unwrap();
        assert_eq!(bytes, gif_bytes(&frames, 15.0).unwrap());
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut reader = options.read_info(&bytes[..]).unwrap();
        let mut canvas = vec![[0_u8; 3]; 40 * 30];
        let (mut count, mut time) = (0, 0);
        while let Some(frame) = reader.read_next_frame().unwrap() {
            for (i, p) in frame.buffer.chunks(4).enumerate() {
                let (x, y) = (i % usize::from(frame.width), i / usize::from(frame.width));
                if p[3] > 0 {
                    canvas[(y + usize::from(frame.top)) * 40 + x + usize::from(frame.left)] = [p[0], p[1], p[2]];
                }
            }
            time += u32::from(frame.delay);
            let want = &frames[count];
            let off =
                want.pixels().zip(&canvas).flat_map(|(a, b)| (0..3).map(move |k| a[k].abs_diff(b[k]))).max().unwrap();
            assert!(off < 40, "frame {count} is off by {off}");
            count += 1;
        }
        assert_eq!((count, time), (6, 40), "six frames at 15 a second");
        assert!(matches!(gif_bytes(&[], 15.0), Err(PictureError::Size { .. })));
    }
}
