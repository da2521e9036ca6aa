//! `docs/paper-map.md` against the code.
//!
//! A row of the map is ``| `key`, `key` | what the paper has | code | test |``. Code and tests are named in backticks:
//! a file or folder below `crates/` (`*` for any run of characters in its name), or an item as `harmony_geometry::pca`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

/// One row of the map.
#[derive(Debug, PartialEq, Eq)]
struct Row<'a> {
    line: usize,
    keys: Vec<&'a str>,
    code: Vec<&'a str>,
    test: Vec<&'a str>,
    open: bool,
}

/// A Rust file of a crate.
struct Source {
    /// Below `crates/`, with `/`.
    path: String,
    text: String,
}

/// What is wrong with the map; empty = nothing.
pub fn check(root: &Path) -> Result<Vec<String>> {
    let map = root.join("docs/paper-map.md");
    let map = fs::read_to_string(&map).with_context(|| map.display().to_string())?;
    let crates = root.join("crates");
    let mut sources = Vec::new();
    collect(&crates, &crates, &mut sources)?;
    Ok(complaints(&rows(&map), &crates, &sources))
}

/// All Rust files, in order.
fn collect(crates: &Path, folder: &Path, sources: &mut Vec<Source>) -> Result<()> {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder)
        .and_then(|entries| entries.map(|entry| entry.map(|entry| entry.path())).collect())
        .with_context(|| folder.display().to_string())?;
    entries.sort();
    for path in entries {
        if path.is_dir() {
            collect(crates, &path, sources)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
            let path = path.strip_prefix(crates)?.to_string_lossy().replace('\\', "/");
            sources.push(Source { path, text });
        }
    }
    Ok(())
}

fn rows(map: &str) -> Vec<Row<'_>> {
    map.lines().enumerate().filter_map(|(i, line)| row(i + 1, line)).collect()
}

/// A row; `None` for any other line.
fn row(line: usize, text: &str) -> Option<Row<'_>> {
    text.strip_prefix("| `")?;
    let cells: Vec<&str> = text.trim_matches('|').split('|').collect();
    let cell = |n: usize| cells.get(n).copied().unwrap_or_default();
    let (code, test) = (cell(2), cell(3));
    Some(Row {
        line,
        keys: backticked(cell(0)).collect(),
        code: backticked(code).filter(|name| name.contains(['/', ':'])).collect(),
        test: backticked(test).filter(|name| name.contains(['/', ':'])).collect(),
        open: [code, test].iter().any(|text| text.split(|c: char| !c.is_alphanumeric()).any(|word| word == "open")),
    })
}

/// What stands between backticks.
fn backticked(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

fn complaints(rows: &[Row<'_>], crates: &Path, sources: &[Source]) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut known: BTreeMap<&str, usize> = BTreeMap::new();
    for row in rows {
        let mut say = |what: String| wrong.push(format!("line {}: {what}", row.line));
        for key in &row.keys {
            if let Some(line) = known.insert(key, row.line) {
                say(format!("`{key}` has a row already, line {line}"));
            }
        }
        for name in row.code.iter().chain(&row.test) {
            if !exists(name, crates, sources) {
                say(format!("`{name}` does not exist"));
            }
        }
        if row.code.is_empty() && !row.open {
            say(format!("`{}` has no code and is not said to be open", row.keys.join("`, `")));
        }
    }
    let prefixes: BTreeSet<&str> =
        known.keys().filter_map(|key| key.split_once('.')).map(|(prefix, _)| prefix).collect();
    let mut quoted: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for source in sources {
        for key in quotes(&source.text, &prefixes) {
            quoted.entry(key).or_default().push(&source.path);
        }
    }
    for (key, files) in &quoted {
        if !known.contains_key(key) {
            wrong.push(format!("`{key}` is quoted in {} and has no row", files.join(", ")));
        }
    }
    for row in rows.iter().filter(|row| !row.open && !row.code.is_empty()) {
        // A template has no doc comment, and an item that is named is found by its name.
        if row.code.iter().any(|name| name.contains("::") || name.contains("/templates/")) {
            continue;
        }
        for key in &row.keys {
            let files = quoted.get(key).map(Vec::as_slice).unwrap_or_default();
            let within = |file: &&str| row.code.iter().any(|name| file.starts_with(name.trim_end_matches('/')));
            if !files.iter().any(within) {
                wrong.push(format!("line {}: no doc comment of {} quotes `{key}`", row.line, row.code.join(", ")));
            }
        }
    }
    wrong
}

/// Whether a file, a folder or an item is there.
fn exists(name: &str, crates: &Path, sources: &[Source]) -> bool {
    if let Some((krate, item)) = name.split_once("::") {
        let folder = format!("{}/src/", krate.replace('_', "-"));
        let item = item.rsplit("::").next().unwrap_or_default();
        return sources.iter().any(|source| source.path.starts_with(&folder) && defines(&source.text, item));
    }
    let path = crates.join(name);
    let Some((before, after)) = path.file_name().and_then(|file| file.to_str()).and_then(|f| f.split_once('*')) else {
        return path.exists();
    };
    let entries = path.parent().and_then(|folder| fs::read_dir(folder).ok());
    entries.into_iter().flatten().flatten().any(|entry| {
        let file = entry.file_name();
        file.to_str().and_then(|file| file.strip_prefix(before)).is_some_and(|rest| rest.ends_with(after))
    })
}

/// Whether a text defines an item of this name.
fn defines(text: &str, item: &str) -> bool {
    let kinds = ["fn", "struct", "enum", "trait", "mod", "type", "const"];
    let words = |line: &str| {
        let mut words = line.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty());
        let kind = words.find(|word| kinds.contains(word));
        kind.is_some() && words.next() == Some(item)
    };
    text.lines().any(|line| !line.trim_start().starts_with("//") && words(line))
}

/// Keys that doc comments quote: `prefix.name` in backticks, with a prefix of the map. Names of files are none.
fn quotes<'a>(text: &'a str, prefixes: &BTreeSet<&str>) -> BTreeSet<&'a str> {
    const FILES: [&str; 8] = ["glb", "jpg", "json", "md", "npz", "png", "rs", "toml"];
    let doc = |line: &'a str| {
        let line = line.trim_start();
        line.strip_prefix("///").or_else(|| line.strip_prefix("//!"))
    };
    let is_key = |name: &&str| {
        name.split_once('.').is_some_and(|(prefix, rest)| {
            prefixes.contains(prefix)
                && !FILES.contains(&rest)
                && rest.starts_with(|c: char| c.is_ascii_lowercase())
                && rest.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
        })
    };
    text.lines().filter_map(doc).flat_map(backticked).filter(is_key).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: &str = "\
# Map
| key | paper | code | test |
|---|---|---|---|
| `cam.pose`, `cam.scale` | the pose | `harmony-a/src/pose.rs` | `harmony-a/tests/it/pose.rs` |
| `cam.corner` | corners | `harmony_a::corner` | unit tests |
| `list.prompt` | prompts | `harmony-a/templates/list_*.md` | snapshot |
| `cam.later` | fine steps | - | open |
";

    /// What is wrong with a map over a small crate.
    fn wrong(map: &str, more: &str) -> Vec<String> {
        let root = tempfile::tempdir().unwrap();
        let write = |path: &str, text: &str| {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        write("docs/paper-map.md", map);
        write(
            "crates/harmony-a/src/pose.rs",
            "/// The pose (keys `cam.pose`,\n/// `cam.scale`), see `cam.png`.\nfn pose() {}\n",
        );
        write("crates/harmony-a/src/corner.rs", &format!("pub(crate) fn corner() {{}}\n// fn elsewhere()\n{more}"));
        write("crates/harmony-a/tests/it/pose.rs", "");
        write("crates/harmony-a/templates/list_wall.md", "");
        check(root.path()).unwrap()
    }

    #[test]
    fn a_map_that_is_true_is_in_order() {
        assert_eq!(wrong(MAP, ""), Vec::<String>::new());
    }

    #[test]
    fn files_tests_items_and_patterns_that_are_gone_are_found() {
        for (from, to) in [
            ("src/pose.rs", "src/gone.rs"),
            ("tests/it/pose.rs", "tests/pose.rs"),
            ("harmony_a::corner", "harmony_a::corne"),
            ("harmony_a::corner", "harmony_a::elsewhere"),
            ("list_*.md", "liste_*.md"),
        ] {
            let found = wrong(&MAP.replace(from, to), "");
            assert!(found.iter().any(|c| c.contains(to) && c.contains("does not exist")), "{to}: {found:?}");
        }
    }

    #[test]
    fn a_row_needs_code_or_the_word_open() {
        let found = wrong(&MAP.replace("| - | open |", "| - | opened later |"), "");
        assert_eq!(found, ["line 7: `cam.later` has no code and is not said to be open"]);
    }

    #[test]
    fn keys_of_code_and_map_are_the_same() {
        let found =
            wrong(MAP, "/// See `cam.unheard`, `other.thing`.\nstruct S;\n// `cam.comment` is no doc comment\n");
        assert_eq!(found, ["`cam.unheard` is quoted in harmony-a/src/corner.rs and has no row"]);
        let found = wrong(&MAP.replace("`cam.scale`", "`cam.skale`"), "");
        assert_eq!(found.len(), 2, "{found:?}");
        let found = wrong(&MAP.replace("harmony_a::corner", "harmony-a/src/corner.rs"), "");
        assert_eq!(found, ["line 5: no doc comment of harmony-a/src/corner.rs quotes `cam.corner`"]);
    }

    #[test]
    fn a_key_has_one_row() {
        let found = wrong(&MAP.replace("`cam.corner`", "`cam.pose`"), "");
        assert!(found.iter().any(|c| c.contains("has a row already, line 4")), "{found:?}");
    }
}
