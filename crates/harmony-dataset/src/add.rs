//! A finished run becomes a scene of the data set.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use harmony_io::{SegmentationFile, read_bounded, read_json, write_atomic, write_json};
use harmony_scene::Scene;
use serde_json::Value;

use crate::DatasetError;
use crate::config::Config;
use crate::layout::{self, SceneId, Split};
use crate::records::Provenance;
use crate::sources::{self, Source, YesNo};

/// Largest file that is taken from a run, bytes.
const MAX_FILE: u64 = 1 << 30;

/// Where a photo is from.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[expect(missing_docs, reason = "the columns of sources.csv, see `Source`")]
pub struct Origin {
    pub source: String,
    pub source_id: String,
    pub source_url: String,
    pub author: String,
    pub licence: String,
    pub licence_url: String,
    pub retrieved_at: String,
    /// Where unset, what the licence says; an unknown licence: no.
    pub redistributable: Option<bool>,
    pub blur: String,
    pub faces: String,
    pub note: String,
}

/// Adds a run.
///
/// # Errors
/// No data set, no finished run, a photo that is there already; nothing is changed then.
pub fn add(
    root: &Path,
    run: &Path,
    split: Split,
    room_type: Option<&str>,
    origin: &Origin,
) -> Result<SceneId, DatasetError> {
    Config::load(root)?;
    let mut rows = sources::load(root)?;
    sources::parse_boxes(&origin.blur)?;
    let scene: Scene = match run.join(layout::SCENE_JSON) {
        path if path.is_file() => read_json(&path)?,
        _ => return Err(DatasetError::NoRun { folder: run.to_owned(), missing: layout::SCENE_JSON }),
    };
    let photo_path =
        input_of(run).ok_or_else(|| DatasetError::NoRun { folder: run.to_owned(), missing: "input.jpg" })?;
    let photo = read_bounded(&photo_path, MAX_FILE)?;
    let hash = layout::sha256(&photo);
    if let Some(row) = rows.iter().find(|r| r.sha256 == hash) {
        return Err(DatasetError::Doubled { scene: row.id().path(), hash });
    }
    let room = layout::room_slug(room_type.unwrap_or(&scene.room.room_type))?;
    let id = next(root, &rows, split, &room)?;
    let files = files(run, &scene, &photo_path, photo)?;
    let folder = root.join(id.path());
    write_scene(&folder, &files)?;
    let licence = crate::licences::find(&origin.licence);
    let may = origin.redistributable.unwrap_or_else(|| licence.is_some_and(|l| l.redistributable));
    rows.push(Source {
        split,
        name: id.name.clone(),
        source: origin.source.clone(),
        source_id: origin.source_id.clone(),
        source_url: origin.source_url.clone(),
        author: origin.author.clone(),
        licence: licence.map_or_else(|| origin.licence.clone(), |l| l.id.to_owned()),
        licence_url: origin.licence_url.clone(),
        retrieved_at: origin.retrieved_at.clone(),
        width: scene.camera.size.width,
        height: scene.camera.size.height,
        sha256: hash,
        redistributable: if may { YesNo::Yes } else { YesNo::No },
        blur: origin.blur.clone(),
        faces: origin.faces.clone(),
        note: origin.note.clone(),
    });
    if let Err(error) = sources::save(root, &rows) {
        let _ = std::fs::remove_dir_all(&folder);
        return Err(error);
    }
    Ok(id)
}

fn input_of(run: &Path) -> Option<PathBuf> {
    layout::PHOTO_EXTENSIONS.iter().map(|e| run.join(format!("input.{e}"))).find(|p| p.is_file())
}

/// The next free number of this room type.
fn next(root: &Path, rows: &[Source], split: Split, room: &str) -> Result<SceneId, DatasetError> {
    let there = layout::scenes(root)?;
    let listed = rows.iter().map(Source::id);
    let last = there
        .into_iter()
        .chain(listed)
        .filter(|id| id.split == split && id.room_type() == room)
        .filter_map(|id| layout::parse_name(&id.name).map(|(_, n)| n))
        .max()
        .unwrap_or(0);
    if last >= 9999 {
        return Err(DatasetError::Value { what: "the room type", value: room.to_owned(), why: "it has 9999 scenes" });
    }
    Ok(SceneId { split, name: format!("{room}_{:02}", last + 1) })
}

/// Name in the scene's folder and content of everything that is taken from a run.
fn files(run: &Path, scene: &Scene, photo_path: &Path, photo: Vec<u8>) -> Result<Vec<(String, Vec<u8>)>, DatasetError> {
    let extension = photo_path.extension().map_or_else(String::new, |e| e.to_string_lossy().into_owned());
    let mut files = vec![(format!("photo.{extension}"), photo)];
    let take = |from: &str| read_bounded(&run.join(from), MAX_FILE);
    let lit = run.join("render_lit.png").is_file();
    let needed: [(&str, &'static str); 6] = [
        (layout::SCENE_JSON, layout::SCENE_JSON),
        ("scene_full.glb", layout::SCENE_GLB),
        (if lit { "render_lit.png" } else { "render_flat.png" }, layout::RENDER),
        (layout::CAMERA, layout::CAMERA),
        (layout::SEGMENTATION_PNG, layout::SEGMENTATION_PNG),
        (layout::OBJECTS, layout::OBJECTS),
    ];
    for (from, to) in needed {
        if !run.join(from).is_file() {
            return Err(DatasetError::NoRun { folder: run.to_owned(), missing: to });
        }
        files.push((to.to_owned(), take(from)?));
    }
    let canonical = ["render_lit_canonical.png", "render_canonical.png"].into_iter().find(|f| run.join(f).is_file());
    for (from, to) in [(Some("render_flat.png"), layout::RENDER_FLAT), (canonical, layout::CANONICAL)] {
        if let Some(from) = from.filter(|f| run.join(f).is_file()) {
            files.push((to.to_owned(), take(from)?));
        }
    }
    let segmentation = run.join(layout::SEGMENTATION_JSON);
    if !segmentation.is_file() {
        return Err(DatasetError::NoRun { folder: run.to_owned(), missing: layout::SEGMENTATION_JSON });
    }
    let mut segments: SegmentationFile = read_json(&segmentation)?;
    for entry in &mut segments.objects {
        let Some(from) = entry.mask.take() else { continue };
        // A file of the run, and nothing outside of it.
        let inside = Path::new(&from).components().all(|c| matches!(c, std::path::Component::Normal(_)));
        if inside && run.join(&from).is_file() {
            let to = format!("{}/{}.png", layout::MASKS, entry.id);
            files.push((to.clone(), take(&from)?));
            entry.mask = Some(to);
        }
    }
    let json = |value: Value| harmony_io::atomic::json_text(&value).unwrap_or_default().into_bytes();
    let value = |v: Result<Value, serde_json::Error>| v.unwrap_or(Value::Null);
    files.push((layout::SEGMENTATION_JSON.to_owned(), json(value(serde_json::to_value(&segments)))));
    let provenance = provenance(run, scene, lit);
    files.push((layout::PROVENANCE.to_owned(), json(value(serde_json::to_value(&provenance)))));
    Ok(files)
}

/// Who made what, from `run.json` and the objects.
fn provenance(run: &Path, scene: &Scene, lit: bool) -> Provenance {
    let file: Value = read_json(&run.join("run.json")).unwrap_or(Value::Null);
    let text = |v: &Value| v.as_str().unwrap_or_default().to_owned();
    let mut cast = BTreeMap::new();
    for entry in file["cast"].as_array().into_iter().flatten() {
        cast.insert(text(&entry[0]), [text(&entry[1]["player"]), text(&entry[1]["model"])]);
    }
    let mut mesh_sources = BTreeMap::new();
    for object in &scene.objects {
        *mesh_sources.entry(object.mesh_source.clone()).or_insert(0) += 1;
    }
    Provenance {
        generator: scene.generator.clone(),
        profile: text(&file["profile"]),
        cast,
        mesh_sources,
        render: if lit { "path-traced" } else { "even light" }.to_owned(),
    }
}

/// Writes a folder whole: under another name first.
fn write_scene(folder: &Path, files: &[(String, Vec<u8>)]) -> Result<(), DatasetError> {
    write_folder(folder, |temporary| {
        files.iter().try_for_each(|(name, bytes)| Ok(write_atomic(&temporary.join(name), bytes)?))
    })
}

/// Fills a folder under a temporary name beside its own and renames it; a failure leaves nothing.
pub(crate) fn write_folder(
    folder: &Path,
    fill: impl FnOnce(&Path) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    if folder.exists() {
        return Err(DatasetError::Exists(folder.to_owned()));
    }
    let name = folder.file_name().map_or_else(|| "folder".into(), |n| n.to_string_lossy().into_owned());
    let temporary = folder.with_file_name(format!(".{name}.{}.0.tmp", std::process::id()));
    let _ = std::fs::remove_dir_all(&temporary);
    let done = std::fs::create_dir_all(&temporary)
        .map_err(|e| DatasetError::write(&temporary, e))
        .and_then(|()| fill(&temporary))
        .and_then(|()| std::fs::rename(&temporary, folder).map_err(|e| DatasetError::write(folder, e)));
    if done.is_err() {
        let _ = std::fs::remove_dir_all(&temporary);
    }
    done
}

/// Makes an empty data set in a folder that does not exist or is empty.
///
/// # Errors
/// A folder with something in it.
pub fn init(root: &Path, config: &Config) -> Result<(), DatasetError> {
    let used = std::fs::read_dir(root).is_ok_and(|mut entries| entries.next().is_some());
    if used || root.is_file() {
        return Err(DatasetError::Exists(root.to_owned()));
    }
    sources::save(root, &[])?;
    config.save(root)?;
    // What was written is read: a name that cannot be used shows now.
    if let Err(error) = Config::load(root) {
        let _ = std::fs::remove_file(root.join(layout::SOURCES));
        let _ = std::fs::remove_file(root.join(layout::DATASET));
        return Err(error);
    }
    Ok(())
}

/// Writes JSON into a folder.
pub(crate) fn put_json(folder: &Path, name: &str, value: &Value) -> Result<(), DatasetError> {
    Ok(write_json(&folder.join(name), value)?)
}
