//! Who plays: the only place that knows every player.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use harmony_calls::Cast;
use harmony_io::{PointMapOptions, load_masks, load_point_map, points::parse_intrinsics};
use harmony_lighting::CyclesRenderer;
use harmony_players::{FilesEvent, FilesOptions, FilesPlayer, MaskFiles, PointMapFile, offline_cast};
use harmony_scene::ImageSize;

use crate::config::Profile;
use crate::display::hinted;

/// What the cast is made from.
pub struct CastRequest<'a> {
    /// Profile.
    pub profile: Profile,
    /// Size of the photo as loaded.
    pub photo_size: ImageSize,
    /// Point map.
    pub points: Option<&'a Path>,
    /// `fx,fy,cx,cy` of a depth image.
    pub intrinsics: Option<&'a str>,
    /// Depth units a metre.
    pub depth_scale: f64,
    /// Masks.
    pub masks: Option<&'a Path>,
    /// Folder of the files player.
    pub questions: PathBuf,
    /// Its patience, minutes; 0 = for ever.
    pub timeout_minutes: f64,
    /// Whether a path tracer may be used.
    pub path_tracer: bool,
    /// Longest side of the photo the pipeline works with, pixels.
    pub working_px: u32,
    /// Told what a person should know.
    pub tell: Arc<dyn Fn(String) + Send + Sync>,
}

/// A cast, and what the pipeline must know about it.
pub struct Casting {
    /// Who plays.
    pub cast: Cast,
    /// Who stands in.
    pub offline: Cast,
    /// The VLM gives boxes with its lists.
    pub boxes_from_vlm: bool,
    /// There is a path tracer.
    pub path_tracer: bool,
    /// Hash of the files that were given beside the photo.
    pub inputs: String,
    /// What was unusual about them.
    pub notes: Vec<String>,
}

/// Casts every role.
///
/// # Errors
/// A file that was given and cannot be used.
pub fn cast(request: &CastRequest<'_>) -> Result<Casting> {
    let offline = offline_cast();
    let mut cast = offline.clone();
    let mut notes = Vec::new();
    let mut inputs = blake3::Hasher::new();
    let working = request.photo_size.fit_within(request.working_px);
    let mut boxes_from_vlm = false;
    if request.profile == Profile::Files {
        boxes_from_vlm = true;
        cast.vision_language = Arc::new(FilesPlayer::new(files_options(request)));
        (request.tell)(format!("questions will appear in {}", request.questions.display()));
    }
    if let Some(path) = request.points {
        let mut options = PointMapOptions::new(working);
        options.depth_scale = Some(request.depth_scale);
        if let Some(text) = request.intrinsics {
            options.intrinsics = Some(parse_intrinsics(text).map_err(|e| hinted(e.to_string(), e.hint()))?);
        }
        // What cannot be used is told before anything is run.
        load_point_map(path, &options).map_err(|e| hinted(e.to_string(), e.hint()))?;
        inputs.update(&std::fs::read(path).unwrap_or_default());
        inputs.update(request.intrinsics.unwrap_or_default().as_bytes());
        inputs.update(&request.depth_scale.to_le_bytes());
        let player = PointMapFile::new(path.to_owned(), options).map_err(|e| hinted(e.to_string(), e.hint()))?;
        cast.geometry_estimator = Arc::new(player);
    }
    if let Some(path) = request.masks {
        let loaded = load_masks(path, working).map_err(|e| hinted(e.to_string(), e.hint()))?;
        notes.extend(loaded.notes);
        for mask in &loaded.masks {
            inputs.update(mask.name.as_bytes());
            inputs.update(&mask.mask.bits().iter().map(|b| u8::from(*b)).collect::<Vec<_>>());
        }
        let player = Arc::new(MaskFiles::new(loaded.masks));
        if player.have_labels() {
            cast.detector = player.clone();
            boxes_from_vlm = false;
        }
        cast.segmenter = player;
    }
    let path_tracer = request.path_tracer && CyclesRenderer::find().is_some();
    Ok(Casting { cast, offline, boxes_from_vlm, path_tracer, inputs: inputs.finalize().to_hex().to_string(), notes })
}

fn files_options(request: &CastRequest<'_>) -> FilesOptions {
    let tell = Arc::clone(&request.tell);
    let mut options = FilesOptions::new(&request.questions);
    options.patience = (request.timeout_minutes > 0.0).then(|| Duration::from_secs_f64(request.timeout_minutes * 60.0));
    options.on_event = Arc::new(move |event| match event {
        FilesEvent::Waiting { folder, open, answered, .. } => {
            tell(format!("waiting for {}/answer.json ({open} open, {answered} answered)", folder.display()));
        }
        FilesEvent::Complained { folder, complaint, .. } => {
            let first = complaint.lines().next().unwrap_or_default().to_owned();
            tell(format!("{}/answer.json was not accepted: {first} (complaint.md says more)", folder.display()));
        }
        FilesEvent::Accepted { name, .. } => tell(format!("{name}: answer accepted")),
        _ => {}
    });
    options
}
