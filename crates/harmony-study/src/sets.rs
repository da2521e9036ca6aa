//! The pictures of each method.
//!
//! A set is `name=folder`. In the folder (and one level deeper, for `easy/`, `medium/`, `complicated/`) each scene is
//! a run folder, a folder with `render.png`, or a picture named by its scene. Further views are `render_canonical.png`
//! in a run folder, `<view>.png` beside `render.png`, and `<scene>@<view>.png` beside `<scene>.png`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::StudyError;

/// Extensions of pictures, in the order in which they are looked for.
const EXTENSIONS: [&str; 7] = ["png", "jpg", "jpeg", "webp", "bmp", "tif", "tiff"];
/// Most scenes of a set.
const MAX_SCENES: usize = 100_000;

/// Name of the view from the photo's camera.
pub const MAIN_VIEW: &str = "main";

/// Which render of a run is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RunPicture {
    /// In even light: comparable over methods.
    #[default]
    Flat,
    /// Path-traced.
    Lit,
}

/// One method: its name and the pictures of its scenes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Set {
    /// The method's name.
    pub name: String,
    /// Scenes by name.
    pub scenes: BTreeMap<String, SceneFiles>,
}

/// The files of one scene of a set.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SceneFiles {
    /// The photo, where the set has it.
    pub photo: Option<PathBuf>,
    /// Pictures by view; [`MAIN_VIEW`] is always there.
    pub views: BTreeMap<String, PathBuf>,
}

/// Splits `name=folder`.
///
/// # Errors
/// [`StudyError::SetSyntax`] and [`StudyError::Name`].
pub fn parse(text: &str) -> Result<(String, PathBuf), StudyError> {
    let (name, folder) = text.split_once('=').ok_or_else(|| StudyError::SetSyntax(text.to_owned()))?;
    if name.trim().is_empty() || folder.is_empty() || name.len() > 60 || name.chars().any(char::is_control) {
        return Err(StudyError::SetSyntax(text.to_owned()));
    }
    if name.starts_with('(') || name.contains(',') {
        return Err(StudyError::Name {
            what: "the set's name",
            name: name.to_owned(),
            why: "it must not begin with ( or hold a comma",
        });
    }
    Ok((name.trim().to_owned(), PathBuf::from(folder)))
}

/// A scene's name from the name of its file or folder: commas and blanks become `_`, as others do it.
pub fn scene_name(name: &str) -> String {
    name.chars().map(|c| if c == ',' || c.is_whitespace() || c.is_control() { '_' } else { c }).collect()
}

/// Looks for the pictures of a method.
///
/// # Errors
/// An unreadable folder, or one with nothing to show.
pub fn load(name: &str, folder: &Path, picture: RunPicture) -> Result<Set, StudyError> {
    let mut scenes = BTreeMap::new();
    if folder.join("scene.json").is_file() {
        // One run alone.
        scenes.insert(scene_name(&file_name(folder)), scene_folder(folder, picture));
    } else {
        look(folder, "", picture, &mut scenes)?;
    }
    scenes.retain(|_, files: &mut SceneFiles| files.views.contains_key(MAIN_VIEW));
    if scenes.is_empty() {
        return Err(StudyError::EmptySet { name: name.to_owned(), folder: folder.to_owned() });
    }
    Ok(Set { name: name.to_owned(), scenes })
}

/// Photos by scene, from a folder of pictures named by their scenes.
///
/// # Errors
/// An unreadable folder.
pub fn photos(folder: &Path) -> Result<BTreeMap<String, PathBuf>, StudyError> {
    let mut found = BTreeMap::new();
    for path in entries(folder)? {
        if path.is_file() && is_picture(&path) {
            found.insert(scene_name(&stem(&path)), path);
        } else if path.is_dir()
            && let Some(photo) = photo_in(&path)
        {
            found.insert(scene_name(&file_name(&path)), photo);
        }
    }
    Ok(found)
}

fn look(
    folder: &Path,
    prefix: &str,
    picture: RunPicture,
    scenes: &mut BTreeMap<String, SceneFiles>,
) -> Result<(), StudyError> {
    for path in entries(folder)? {
        if scenes.len() >= MAX_SCENES {
            break;
        }
        if path.is_file() && is_picture(&path) {
            let stem = stem(&path);
            let (scene, view) = stem.split_once('@').unwrap_or((&stem, MAIN_VIEW));
            let files = scenes.entry(format!("{prefix}{}", scene_name(scene))).or_default();
            files.views.entry(scene_name(view)).or_insert(path);
        } else if path.is_dir() {
            let name = scene_name(&file_name(&path));
            let files = scene_folder(&path, picture);
            if files.views.is_empty() {
                if prefix.is_empty() {
                    look(&path, &format!("{name}_"), picture, scenes)?;
                }
            } else {
                scenes.insert(format!("{prefix}{name}"), files);
            }
        }
    }
    Ok(())
}

/// A run folder, or a folder with a render.
fn scene_folder(folder: &Path, picture: RunPicture) -> SceneFiles {
    let mut files = SceneFiles { photo: photo_in(folder), views: BTreeMap::new() };
    let order = match picture {
        RunPicture::Flat => ["render_flat", "render", "render_lit"],
        RunPicture::Lit => ["render_lit", "render", "render_flat"],
    };
    if let Some(main) = order.iter().find_map(|stem| with_stem(folder, stem)) {
        files.views.insert(MAIN_VIEW.to_owned(), main);
        let canonical = match picture {
            RunPicture::Flat => ["render_canonical", "canonical"],
            RunPicture::Lit => ["render_lit_canonical", "canonical"],
        };
        if let Some(path) = canonical.iter().find_map(|stem| with_stem(folder, stem)) {
            files.views.insert("canonical".to_owned(), path);
        }
    }
    files
}

fn photo_in(folder: &Path) -> Option<PathBuf> {
    ["input", "photo"].iter().find_map(|stem| with_stem(folder, stem))
}

fn with_stem(folder: &Path, stem: &str) -> Option<PathBuf> {
    EXTENSIONS.iter().map(|e| folder.join(format!("{stem}.{e}"))).find(|p| p.is_file())
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, StudyError> {
    let fail = |source| StudyError::File(harmony_io::FileError::Read { path: folder.to_owned(), source });
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        if !file_name(&path).starts_with('.') {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

fn is_picture(path: &Path) -> bool {
    path.extension().is_some_and(|e| EXTENSIONS.contains(&e.to_string_lossy().to_ascii_lowercase().as_str()))
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}
