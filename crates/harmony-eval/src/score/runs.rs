//! Sets of finished runs: a run folder, a folder of them, a pattern, a list file, or a folder of pictures.
//!
//! A run folder of ours and what `harmony eval rival` leaves have the same three files: `input.*`, `render_flat.png`
//! and, where it was made, `render_lit.png`. A folder that only holds pictures is a set, too, when photos are named
//! beside it: each picture is the flat render of the scene of its name.
//!
//! Scenes of two sets belong together by name; where names differ, by their photo, byte for byte.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use harmony_io::read_bounded;
use harmony_scene::SCENE_VERSION;
use serde_json::Value;

/// Extensions of pictures.
const PICTURES: [&str; 8] = ["png", "jpg", "jpeg", "webp", "bmp", "tif", "tiff", "ppm"];
/// Largest list file, bytes.
const MAX_LIST_BYTES: u64 = 64 << 20;
/// Largest photo that is hashed, bytes.
const MAX_PHOTO_BYTES: u64 = 512 << 20;

/// A set cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunsError {
    /// Nothing of that name.
    #[error("there is no {path}")]
    Missing {
        /// What was named.
        path: PathBuf,
    },
    /// A folder or file cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Nothing in it is a run.
    #[error("no run is in {path}")]
    Empty {
        /// Which folder, pattern or list.
        path: PathBuf,
    },
    /// A pattern cannot be read.
    #[error("{pattern:?} is no pattern: {reason}")]
    Pattern {
        /// The pattern.
        pattern: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A line of a list cannot be used.
    #[error("line {line} of {path}: {reason}")]
    List {
        /// The list.
        path: PathBuf,
        /// Which line, from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// Two runs of one name.
    #[error("two scenes are named {name}: {first} and {second}")]
    Twice {
        /// The name.
        name: String,
        /// One.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// Runs of several versions of the program.
    #[error("runs of several programs in one set: {first} was made by {first_by}, {second} by {second_by}")]
    Mixed {
        /// A run.
        first: PathBuf,
        /// What made it.
        first_by: String,
        /// Another.
        second: PathBuf,
        /// What made that.
        second_by: String,
    },
    /// A scene of a format of later times.
    #[error("{path} has scene.json of version {found}, this program reads {}", SCENE_VERSION)]
    Version {
        /// The run.
        path: PathBuf,
        /// Its version.
        found: u64,
    },
}

impl RunsError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        Some(match self {
            Self::Missing { .. } | Self::Read { .. } => "check the path; it is relative to the current folder",
            Self::Empty { .. } => {
                "name run folders of `harmony reconstruct`, a folder of such, or pictures together with --photos FOLDER"
            }
            Self::Pattern { .. } => "patterns are as in a shell: * for any letters, ? for one, [ab] for a choice",
            Self::List { .. } => "a list has one run folder a line, or NAME,FOLDER; # begins a remark",
            Self::Twice { .. } => "put them into two sets, or give them names in a list: NAME,FOLDER",
            Self::Mixed { .. } => "evaluate them as two sets with --against, or pass --mixed to take them as one",
            Self::Version { .. } => "use the program that made it, or run the photo again",
        })
    }
}

/// A scene of a set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunEntry {
    /// Name: the folder's, or that of the list.
    pub name: String,
    /// Folder of the run, or the picture.
    pub path: PathBuf,
    /// The photo, where there is one.
    pub photo: Option<PathBuf>,
    /// Flat render.
    pub flat: Option<PathBuf>,
    /// Lit render.
    pub lit: Option<PathBuf>,
    /// Why there is no flat render, when there is none.
    pub failure: Option<String>,
    /// What made it.
    pub generator: Option<String>,
    /// Whether the background was lent (`rival.json`): marked with a star.
    pub starred: bool,
    /// How many things its scene has, where that is told (`scene.json`, or the parts of `rival.json`).
    pub objects: Option<usize>,
}

/// Scenes by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunSet {
    /// Name of the set.
    pub name: String,
    /// Scenes, sorted by name.
    pub runs: Vec<RunEntry>,
}

/// How sets are read.
#[derive(Debug, Clone, Default)]
pub struct SetOptions {
    /// Photos for scenes that have none of their own, by name.
    pub photos: Option<PathBuf>,
    /// Take runs of several versions as one set.
    pub mixed: bool,
}

/// Reads a set: each of `sources` is a run folder, a folder of runs, a pattern, a list or a folder of pictures.
///
/// # Errors
/// [`RunsError`].
pub fn find_set(name: &str, sources: &[String], options: &SetOptions) -> Result<RunSet, RunsError> {
    let photos = options.photos.as_deref().map(photos_in).transpose()?.unwrap_or_default();
    let mut runs: BTreeMap<String, RunEntry> = BTreeMap::new();
    for source in sources {
        for (scene, path) in expand(source, !photos.is_empty())? {
            let entry = entry(&scene, &path, &photos)?;
            if let Some(first) = runs.get(&scene).filter(|first| first.path != entry.path) {
                return Err(RunsError::Twice { name: scene, first: first.path.clone(), second: entry.path });
            }
            runs.insert(scene, entry);
        }
    }
    let runs: Vec<RunEntry> = runs.into_values().collect();
    if !options.mixed {
        one_version(&runs)?;
    }
    Ok(RunSet { name: name.to_owned(), runs })
}

fn one_version(runs: &[RunEntry]) -> Result<(), RunsError> {
    let mut known = runs.iter().filter_map(|r| Some((r, r.generator.as_ref()?)));
    let Some((first, first_by)) = known.next() else { return Ok(()) };
    match known.find(|(_, by)| *by != first_by) {
        None => Ok(()),
        Some((second, by)) => Err(RunsError::Mixed {
            first: first.path.clone(),
            first_by: first_by.clone(),
            second: second.path.clone(),
            second_by: by.clone(),
        }),
    }
}

/// The name of a scene as the paper's release makes it of a file's or folder's name.
fn scene_name(path: &Path) -> String {
    let stem = if path.is_dir() { path.file_name() } else { path.file_stem() };
    stem.map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().replace([',', ' '], "_"))
}

fn is_picture(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    extension.is_some_and(|e| PICTURES.contains(&e.as_str())) && path.is_file()
}

/// A finished or begun run, or what a rival's loader left.
fn is_run(folder: &Path) -> bool {
    ["run.json", "scene.json", "rival.json"].iter().any(|f| folder.join(f).is_file()) || input_of(folder).is_some()
}

/// The photo of a run folder.
fn input_of(folder: &Path) -> Option<PathBuf> {
    PICTURES.iter().map(|e| folder.join(format!("input.{e}"))).find(|p| p.is_file())
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, RunsError> {
    let read = |source| RunsError::Read { path: folder.to_owned(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        found.push(entry.map_err(read)?.path());
    }
    found.sort();
    Ok(found)
}

fn photos_in(folder: &Path) -> Result<BTreeMap<String, PathBuf>, RunsError> {
    if !folder.is_dir() {
        return Err(RunsError::Missing { path: folder.to_owned() });
    }
    let mut photos = BTreeMap::new();
    for path in entries(folder)?.into_iter().filter(|p| is_picture(p)) {
        let name = scene_name(&path);
        if let Some(first) = photos.insert(name.clone(), path.clone()) {
            return Err(RunsError::Twice { name, first, second: path });
        }
    }
    if photos.is_empty() {
        return Err(RunsError::Empty { path: folder.to_owned() });
    }
    Ok(photos)
}

/// Names and folders (or pictures) of a source.
fn expand(source: &str, pictures: bool) -> Result<Vec<(String, PathBuf)>, RunsError> {
    let path = PathBuf::from(source);
    let named = |path: PathBuf| (scene_name(&path), path);
    if path.is_dir() {
        if is_run(&path) {
            return Ok(vec![(scene_name(&absolute(&path)), path)]);
        }
        let inside = entries(&path)?;
        let mut found: Vec<_> = inside.iter().filter(|p| p.is_dir() && is_run(p)).cloned().map(named).collect();
        if found.is_empty() && pictures {
            found = inside.into_iter().filter(|p| is_picture(p)).map(named).collect();
        }
        return if found.is_empty() { Err(RunsError::Empty { path }) } else { Ok(found) };
    }
    if path.is_file() {
        return if is_picture(&path) { Ok(vec![named(path)]) } else { list(&path) };
    }
    if !source.contains(['*', '?', '[']) {
        return Err(RunsError::Missing { path });
    }
    let bad = |reason: String| RunsError::Pattern { pattern: source.to_owned(), reason };
    let mut found = Vec::new();
    for path in glob::glob(source).map_err(|e| bad(e.to_string()))? {
        let path = path.map_err(|e| RunsError::Read { path: e.path().to_owned(), source: e.into() })?;
        if (path.is_dir() && is_run(&path)) || (pictures && is_picture(&path)) {
            found.push(named(path));
        }
    }
    found.sort();
    if found.is_empty() { Err(RunsError::Empty { path }) } else { Ok(found) }
}

/// `.` has no name of its own.
fn absolute(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned())
}

/// A list: a run folder a line, or `NAME,FOLDER`; folders are relative to the list's.
fn list(path: &Path) -> Result<Vec<(String, PathBuf)>, RunsError> {
    let read = |e: harmony_io::FileError| {
        let source = std::io::Error::other(e.to_string());
        RunsError::Read { path: path.to_owned(), source }
    };
    let bytes = read_bounded(path, MAX_LIST_BYTES).map_err(read)?;
    let bad = |line: usize, reason: String| RunsError::List { path: path.to_owned(), line, reason };
    let text = std::str::from_utf8(&bytes).map_err(|e| {
        let line = bytes[..e.valid_up_to()].split(|b| *b == b'\n').count();
        bad(line, "this is no text".to_owned())
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut found = Vec::new();
    for (number, line) in text.lines().enumerate().map(|(i, l)| (i + 1, l.trim())) {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let (name, run) = match fields[..] {
            [run] => (None, run),
            ["scene", "run" | "folder" | "path"] if found.is_empty() => continue,
            [name, run] if !name.is_empty() && !run.is_empty() => (Some(name), run),
            _ => return Err(bad(number, format!("{} fields where NAME,FOLDER is wanted: {line:?}", fields.len()))),
        };
        let run = folder.join(run);
        if !run.exists() {
            return Err(bad(number, format!("there is no {}", run.display())));
        }
        found.push((name.map_or_else(|| scene_name(&run), |n| n.replace(' ', "_")), run));
    }
    if found.is_empty() { Err(RunsError::Empty { path: path.to_owned() }) } else { Ok(found) }
}

fn entry(name: &str, path: &Path, photos: &BTreeMap<String, PathBuf>) -> Result<RunEntry, RunsError> {
    if path.is_file() {
        return Ok(RunEntry {
            name: name.to_owned(),
            path: path.to_owned(),
            photo: photos.get(name).cloned(),
            flat: Some(path.to_owned()),
            lit: None,
            failure: None,
            generator: None,
            starred: false,
            objects: None,
        });
    }
    let json = |file: &str| harmony_io::read_json::<Value>(&path.join(file)).ok();
    let scene = json("scene.json");
    let version = scene.as_ref().and_then(|s| s["version"].as_u64());
    if let Some(found) = version.filter(|v| *v != u64::from(SCENE_VERSION)) {
        return Err(RunsError::Version { path: path.to_owned(), found });
    }
    let rival = json("rival.json");
    let about = [&scene, &rival];
    let generator = about.into_iter().flatten().find_map(|v| v["generator"].as_str().map(str::to_owned));
    let there = |file: &str| Some(path.join(file)).filter(|p| p.is_file());
    let listed = scene.as_ref().and_then(|s| s["objects"].as_array()).map(Vec::len);
    let parts = rival.as_ref().and_then(|r| r["parts"].as_array());
    let parts = parts.map(|all| all.iter().filter(|part| part[1].as_str() == Some("object")).count());
    let flat = there("render_flat.png");
    let lit = there("render_lit.png");
    let failure = (flat.is_none() && lit.is_none()).then(|| why(path));
    Ok(RunEntry {
        name: name.to_owned(),
        path: path.to_owned(),
        photo: input_of(path).or_else(|| photos.get(name).cloned()),
        flat,
        lit,
        failure,
        generator,
        starred: rival.is_some_and(|r| r["background_lent"].as_bool() == Some(true)),
        objects: listed.or(parts),
    })
}

/// Why a run has no render, from its own account.
fn why(folder: &Path) -> String {
    let run = harmony_io::read_json::<Value>(&folder.join("run.json")).ok();
    let phases = run.as_ref().and_then(|r| r["phases"].as_object());
    let failed = phases.into_iter().flatten().find(|(_, phase)| phase["state"] == "failed");
    match failed {
        Some((phase, about)) => format!("{phase} failed: {}", about["outcome"].as_str().unwrap_or("no reason given")),
        None => "no render_flat.png".to_owned(),
    }
}

impl RunEntry {
    /// Hash of the photo's bytes, where it can be read.
    pub fn photo_hash(&self) -> Option<String> {
        let bytes = read_bounded(self.photo.as_deref()?, MAX_PHOTO_BYTES).ok()?;
        Some(blake3::hash(&bytes).to_hex().to_string())
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn run(folder: &Path, name: &str, generator: &str) {
        let run = folder.join(name);
        fs::create_dir_all(&run).unwrap();
        fs::write(run.join("scene.json"), format!("{{\"version\":1,\"generator\":{generator:?}}}")).unwrap();
        fs::write(run.join("input.jpg"), name).unwrap();
        fs::write(run.join("render_flat.png"), "").unwrap();
    }

    fn names(set: &RunSet) -> Vec<&str> {
        set.runs.iter().map(|r| r.name.as_str()).collect()
    }

    fn find(sources: &[String]) -> Result<RunSet, RunsError> {
        find_set("ours", sources, &SetOptions::default())
    }

    #[test]
    fn folders_patterns_and_lists_give_the_same_set() {
        let folder = tempfile::tempdir().unwrap();
        let f = folder.path();
        for name in ["bedroom, blue", "kitchen_1", "kitchen_2"] {
            run(f, name, "HARMONY 1");
        }
        fs::create_dir(f.join("notes")).unwrap();
        let text = |p: &Path| p.to_string_lossy().into_owned();
        let all = find(&[text(f)]).unwrap();
        assert_eq!(names(&all), ["bedroom__blue", "kitchen_1", "kitchen_2"]);
        assert_eq!(names(&find(&[text(&f.join("kitchen_?"))]).unwrap()), ["kitchen_1", "kitchen_2"]);
        assert_eq!(
            names(&find(&[text(&f.join("kitchen_1")), text(&f.join("k*"))]).unwrap()),
            ["kitchen_1", "kitchen_2"]
        );
        fs::write(f.join("list.txt"), "scene,run\n# mine\nfirst,kitchen_1\n\nkitchen_2\n").unwrap();
        assert_eq!(names(&find(&[text(&f.join("list.txt"))]).unwrap()), ["first", "kitchen_2"]);
    }

    #[test]
    fn what_cannot_be_used_is_named_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let f = folder.path();
        let text = |p: &Path| p.to_string_lossy().into_owned();
        let error = |sources: &[String]| {
            let error = find(sources).unwrap_err();
            assert!(error.hint().is_some());
            error.to_string()
        };
        assert!(error(&[text(&f.join("nowhere"))]).contains("nowhere"));
        assert!(error(&[text(f)]).contains("no run"));
        assert!(error(&[text(&f.join("a***"))]).contains("no pattern"));
        run(f, "a", "HARMONY 1");
        fs::write(f.join("list.csv"), "a,b,c\n").unwrap();
        assert!(error(&[text(&f.join("list.csv"))]).contains("line 1"));
        fs::write(f.join("list.csv"), "a\nsecond,\n").unwrap();
        assert!(error(&[text(&f.join("list.csv"))]).contains("line 2"));
        fs::write(f.join("list.csv"), "a\nb\n").unwrap();
        assert!(error(&[text(&f.join("list.csv"))]).contains("line 2"));
        fs::write(f.join("list.csv"), b"a\n\xff\xfe").unwrap();
        assert!(error(&[text(&f.join("list.csv"))]).contains("line 2"));
        run(&f.join("other"), "a", "HARMONY 1");
        assert!(error(&[text(&f.join("a")), text(&f.join("other/a"))]).contains("two scenes"));
        run(f, "b", "HARMONY 2");
        assert!(error(&[text(f)]).contains("HARMONY 2"));
        let mixed = SetOptions { mixed: true, ..SetOptions::default() };
        assert_eq!(find_set("ours", &[text(f)], &mixed).unwrap().runs.len(), 2);
        fs::write(f.join("b/scene.json"), "{\"version\":7}").unwrap();
        assert!(error(&[text(f)]).contains("version 7"));
    }

    #[test]
    fn pictures_alone_are_a_set_when_photos_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let (renders, photos) = (folder.path().join("renders"), folder.path().join("photos"));
        for place in [&renders, &photos] {
            fs::create_dir(place).unwrap();
        }
        fs::write(renders.join("room 1.png"), "").unwrap();
        fs::write(renders.join("room 2.png"), "").unwrap();
        fs::write(photos.join("room_1.jpg"), "").unwrap();
        let sources = [renders.to_string_lossy().into_owned()];
        assert!(matches!(find(&sources), Err(RunsError::Empty { .. })));
        let options = SetOptions { photos: Some(photos), mixed: false };
        let set = find_set("x", &sources, &options).unwrap();
        assert_eq!(names(&set), ["room_1", "room_2"]);
        assert!(set.runs[0].photo.is_some() && set.runs[1].photo.is_none());
    }

    #[test]
    fn a_failed_run_says_which_phase_failed() {
        let folder = tempfile::tempdir().unwrap();
        let f = folder.path().join("a");
        fs::create_dir(&f).unwrap();
        let about = r#"{"phases":{"1_layout":{"state":"done"},"2_wall":{"state":"failed","outcome":"no answer"}}}"#;
        fs::write(f.join("run.json"), about).unwrap();
        let set = find(&[f.to_string_lossy().into_owned()]).unwrap();
        assert_eq!(set.runs[0].failure.as_deref(), Some("2_wall failed: no answer"));
    }
}
