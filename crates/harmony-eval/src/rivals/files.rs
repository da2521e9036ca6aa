//! Files of a folder by their names, wherever they lie in it.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

/// Deepest folder that is looked into, and most entries that are looked at.
const DEPTH: usize = 5;
const MOST: usize = 50_000;

/// All files below a folder, the shallow ones first, by name in each folder.
pub fn below(folder: &Path) -> Vec<PathBuf> {
    if folder.is_file() {
        return vec![folder.to_owned()];
    }
    let mut open = VecDeque::from([(folder.to_owned(), 0)]);
    let (mut files, mut seen) = (Vec::new(), 0);
    while let Some((folder, depth)) = open.pop_front() {
        let mut inside: Vec<PathBuf> =
            std::fs::read_dir(&folder).into_iter().flatten().filter_map(Result::ok).map(|e| e.path()).collect();
        inside.sort();
        for path in inside {
            seen += 1;
            if seen > MOST {
                return files;
            }
            // Links may lead round in circles.
            let kind = std::fs::symlink_metadata(&path).map(|m| m.file_type());
            match kind {
                Ok(kind) if kind.is_dir() && depth < DEPTH => open.push_back((path, depth + 1)),
                Ok(kind) if !kind.is_dir() && path.is_file() => files.push(path),
                _ => {}
            }
        }
    }
    files
}

/// The first of `names` that is there, the shallowest.
pub fn named(files: &[PathBuf], names: &[&str]) -> Option<PathBuf> {
    names.iter().find_map(|name| files.iter().find(|f| f.file_name().is_some_and(|n| n == *name)).cloned())
}

/// Files with an extension (lower case), in `parent` where one is named.
pub fn with(files: &[PathBuf], extension: &str, parent: Option<&str>) -> Vec<PathBuf> {
    let fits = |path: &&PathBuf| {
        let own = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let folder = path.parent().and_then(Path::file_name).map(|n| n.to_string_lossy().into_owned());
        own.as_deref() == Some(extension) && parent.is_none_or(|p| folder.as_deref() == Some(p))
    };
    files.iter().filter(fits).cloned().collect()
}

/// A file's name without extension.
pub fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}
