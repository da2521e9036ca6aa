//! Which crate uses which, against `layers.toml`, and the table of crates in `ARCHITECTURE.md`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use serde::Deserialize;
use toml::{Table, Value};

/// `layers.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Layers {
    /// By crate, which others it uses.
    uses: BTreeMap<String, BTreeSet<String>>,
    /// What must not reach what.
    #[serde(default)]
    apart: Vec<Apart>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Apart {
    crates: Vec<String>,
    from: Vec<String>,
}

/// What is wrong with the layers; empty = nothing.
pub fn check(root: &Path) -> Result<Vec<String>> {
    let layers: Layers = toml::from_str(&read(&root.join("xtask/layers.toml"))?).context("xtask/layers.toml")?;
    let used = workspace(root)?;
    let mut wrong = compared(&layers, &used);
    wrong.extend(table(&read(&root.join("ARCHITECTURE.md"))?, &used));
    Ok(wrong)
}

fn read(path: &Path) -> Result<String> {
    fs::read_to_string(path).with_context(|| path.display().to_string())
}

/// By crate of the workspace, which others of it are its normal and build dependencies.
fn workspace(root: &Path) -> Result<BTreeMap<String, BTreeSet<String>>> {
    let folders = fs::read_dir(root.join("crates")).context("crates")?;
    let mut folders: Vec<PathBuf> = folders.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>()?;
    folders.push(root.join("xtask"));
    let mut manifests = BTreeMap::new();
    for folder in folders.iter().filter(|folder| folder.join("Cargo.toml").is_file()) {
        let path = folder.join("Cargo.toml");
        let manifest: Table = toml::from_str(&read(&path)?).with_context(|| path.display().to_string())?;
        let name = manifest.get("package").and_then(|package| package.get("name")).and_then(Value::as_str);
        let name = name.with_context(|| format!("no name: {}", path.display()))?.to_owned();
        manifests.insert(name, manifest);
    }
    let own: BTreeSet<String> = manifests.keys().cloned().collect();
    Ok(manifests
        .into_iter()
        .map(|(name, manifest)| (name, dependencies(&manifest).filter(|used| own.contains(used)).collect()))
        .collect())
}

/// Names of normal and build dependencies, those of single targets among them.
fn dependencies(manifest: &Table) -> impl Iterator<Item = String> {
    let targets = manifest.get("target").and_then(Value::as_table).into_iter().flat_map(Table::values);
    let places = targets.filter_map(Value::as_table).chain([manifest]);
    let tables = places.flat_map(|place| ["dependencies", "build-dependencies"].map(|kind| place.get(kind)));
    let entries = tables.flatten().filter_map(Value::as_table).flatten();
    // A dependency may go by another name here.
    entries.map(|(name, how)| how.get("package").and_then(Value::as_str).unwrap_or(name).to_owned())
}

fn compared(layers: &Layers, used: &BTreeMap<String, BTreeSet<String>>) -> Vec<String> {
    let mut wrong = Vec::new();
    for (name, uses) in used {
        let Some(allowed) = layers.uses.get(name) else {
            wrong.push(format!("{name} has no row in xtask/layers.toml"));
            continue;
        };
        wrong.extend(uses.difference(allowed).map(|other| format!("{name} uses {other}, which it may not")));
        let unused = allowed.difference(uses);
        wrong.extend(unused.map(|other| format!("{name} does not use {other}: xtask/layers.toml says too much")));
    }
    let gone = layers.uses.keys().filter(|name| !used.contains_key(*name));
    wrong.extend(gone.map(|name| format!("xtask/layers.toml has a row for {name}, which is no crate")));
    for apart in &layers.apart {
        for name in &apart.crates {
            let reached = reached(name, used);
            let met = apart.from.iter().filter(|other| reached.contains(other.as_str()));
            wrong.extend(met.map(|other| format!("{name} reaches {other}, from which it is kept apart")));
        }
    }
    wrong
}

/// All that a crate uses, by whatever way.
fn reached<'a>(name: &'a str, used: &'a BTreeMap<String, BTreeSet<String>>) -> BTreeSet<&'a str> {
    let mut found = BTreeSet::new();
    let mut next = vec![name];
    while let Some(name) = next.pop() {
        next.extend(used.get(name).into_iter().flatten().map(String::as_str).filter(|other| found.insert(*other)));
    }
    found
}

/// Whether the table of crates has a row for every crate, and for nothing else.
fn table(page: &str, used: &BTreeMap<String, BTreeSet<String>>) -> Vec<String> {
    let lines = page.lines().skip_while(|line| !line.starts_with("## Crates")).skip(1);
    let section = lines.take_while(|line| !line.starts_with("## "));
    let rows: BTreeSet<&str> =
        section.filter_map(|line| line.strip_prefix("| `")?.split_once('`')).map(|(name, _)| name).collect();
    let missing = used.keys().filter(|name| !rows.contains(name.as_str()));
    let mut wrong: Vec<String> = missing.map(|name| format!("ARCHITECTURE.md has no row for {name}")).collect();
    let gone = rows.iter().filter(|name| !used.contains_key(**name));
    wrong.extend(gone.map(|name| format!("ARCHITECTURE.md has a row for {name}, which is no crate")));
    wrong
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYERS: &str = "\
[uses]
a = []
b = [\"a\"]
c = [\"b\"]
xtask = []
[[apart]]
crates = [\"a\"]
from = [\"c\"]
";
    const PAGE: &str =
        "# A\n| `old` |\n## Crates\n| `a` | x |\n| `b` | x |\n| `c` | x |\n| `xtask` | x |\n## Z\n| `d` |\n";

    /// What is wrong with a small workspace: crates by name and what follows their package table.
    fn wrong(layers: &str, page: &str, crates: &[(&str, &str)]) -> Vec<String> {
        let root = tempfile::tempdir().unwrap();
        let write = |path: String, text: &str| {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        write("xtask/layers.toml".into(), layers);
        write("xtask/Cargo.toml".into(), "[package]\nname = \"xtask\"\n");
        write("ARCHITECTURE.md".into(), page);
        for (name, rest) in crates {
            write(format!("crates/{name}/Cargo.toml"), &format!("[package]\nname = \"{name}\"\n{rest}"));
        }
        check(root.path()).unwrap()
    }

    const GOOD: [(&str, &str); 3] = [
        ("a", "[dependencies]\nserde = \"1\"\n[dev-dependencies]\nc.workspace = true\n"),
        ("b", "[target.'cfg(unix)'.dependencies]\na.workspace = true\n"),
        ("c", "[build-dependencies]\nother = { package = \"b\", path = \"../b\" }\n"),
    ];

    #[test]
    fn a_workspace_as_it_is_laid_down_is_in_order_and_tests_may_use_any_crate() {
        assert_eq!(wrong(LAYERS, PAGE, &GOOD), Vec::<String>::new());
    }

    #[test]
    fn what_is_used_and_not_allowed_or_allowed_and_not_used_is_found() {
        let mut crates = GOOD;
        crates[2].1 = "[dependencies]\na.workspace = true\n";
        assert_eq!(
            wrong(LAYERS, PAGE, &crates),
            ["c uses a, which it may not", "c does not use b: xtask/layers.toml says too much"]
        );
    }

    #[test]
    fn what_is_kept_apart_is_not_reached_by_a_detour_either() {
        let layers = LAYERS.replace("[\"a\"]\nfrom = [\"c\"]", "[\"c\"]\nfrom = [\"a\"]");
        assert_eq!(wrong(&layers, PAGE, &GOOD), ["c reaches a, from which it is kept apart"]);
    }

    #[test]
    fn every_crate_has_a_row_in_both_tables_and_no_other_has() {
        let found = wrong(&LAYERS.replace("c = [\"b\"]", "gone = []"), &PAGE.replace("`b`", "`bee`"), &GOOD);
        assert_eq!(
            found,
            [
                "c has no row in xtask/layers.toml",
                "xtask/layers.toml has a row for gone, which is no crate",
                "ARCHITECTURE.md has no row for b",
                "ARCHITECTURE.md has a row for bee, which is no crate",
            ]
        );
    }

    #[test]
    fn a_table_that_is_misspelt_is_an_error() {
        assert!(toml::from_str::<Layers>("[usse]\n").is_err());
    }
}
