//! What is published.
//! Key `data.release`.
//!
//! A release is a folder of its own, made whole or not at all: the scenes (photos without metadata, faces blurred),
//! lists for training, figures, indices, shards, licence manifest, card, Croissant metadata and the hashes of all.
//! The same working folder gives the same bytes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use harmony_io::{read_bounded, write_atomic};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::add::{put_json, write_folder};
use crate::check::{Report, SUMS, check};
use crate::config::{Config, Folds};
use crate::croissant::Described;
use crate::layout::{self, Split, sha256};
use crate::parquet::Column;
use crate::records::{self, Record};
use crate::sources::{self, YesNo};
use crate::stats::Stats;
use crate::{DatasetError, card, croissant, licences, parquet, photo, shards};

/// Largest file of a scene, bytes.
const MAX_FILE: u64 = 1 << 30;

/// What was released.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Released {
    /// Scenes.
    pub scenes: usize,
    /// Photos that are left out because their licence asks for it.
    pub photos_left_out: usize,
    /// Shards.
    pub shards: usize,
    /// Files.
    pub files: usize,
    /// What the check had to say before.
    pub report: Report,
}

/// Makes a release in a folder that must not exist.
///
/// # Errors
/// [`DatasetError::Faults`] when the check finds any; nothing is written then.
pub fn build(root: &Path, out: &Path) -> Result<Released, DatasetError> {
    let config = Config::load(root)?;
    if out.exists() {
        return Err(DatasetError::Exists(out.to_owned()));
    }
    let report = check(root)?;
    if report.faults() > 0 {
        return Err(DatasetError::Faults(report.faults()));
    }
    let mut records: Vec<Record> =
        sources::load(root)?.iter().map(|row| records::load(root, row)).collect::<Result<_, _>>()?;
    let mut count = 0;
    write_folder(out, |folder| {
        records.par_iter_mut().try_for_each(|record| export(root, folder, record))?;
        config.save(folder)?;
        sources::save(folder, &records.iter().map(|r| r.source.clone()).collect::<Vec<_>>())?;
        let put = |name: &str, bytes: &[u8]| write_atomic(&folder.join(name), bytes).map_err(DatasetError::from);
        for (name, list) in lists(&records, config.folds) {
            put(&format!("splits/{name}.txt"), list.as_bytes())?;
        }
        let stats = Stats::of(&records);
        put("stats.csv", stats.csv().as_bytes())?;
        put("stats.svg", stats.svg().as_bytes())?;
        let (scene_columns, object_columns) = (scene_columns(&records, config.folds), object_columns(&records));
        let index = parquet::table(&scene_columns)?;
        let objects = parquet::table(&object_columns)?;
        put("index.parquet", &index)?;
        put("objects.parquet", &objects)?;
        let (index_hash, objects_hash) = (sha256(&index), sha256(&objects));
        let kind = "application/vnd.apache.parquet";
        let described = |path, bytes: &[u8], sha256| Described { path, kind, sha256, bytes: bytes.len() };
        let metadata = croissant::metadata(
            &config,
            &described("index.parquet", &index, &index_hash),
            &described("objects.parquet", &objects, &objects_hash),
            &scene_columns,
            &object_columns,
        );
        put_json(folder, "croissant.json", &metadata)?;
        put_json(folder, "manifest.json", &manifest(&config, &records))?;
        put("README.md", card::card(&config, &records, &stats).as_bytes())?;
        put("ATTRIBUTION.md", card::attribution(&config, &records).as_bytes())?;
        count = make_shards(folder, &records, config.scenes_per_shard)?;
        put(SUMS, sums(folder)?.as_bytes())
    })?;
    Ok(Released {
        scenes: records.len(),
        photos_left_out: records.iter().filter(|r| r.photo.is_none()).count(),
        shards: count,
        files: files(out).len(),
        report,
    })
}

/// Copies a scene; the photo by the rules of its row. The record's photo becomes the published one.
fn export(root: &Path, out: &Path, record: &mut Record) -> Result<(), DatasetError> {
    let from = root.join(record.id.path());
    let to = out.join(record.id.path());
    let copy = |name: &str| -> Result<(), DatasetError> {
        Ok(write_atomic(&to.join(name), &read_bounded(&from.join(name), MAX_FILE)?)?)
    };
    let mut names: Vec<String> = layout::REQUIRED.iter().map(|n| (*n).to_owned()).collect();
    for optional in [layout::RENDER_FLAT, layout::CANONICAL] {
        if from.join(optional).is_file() {
            names.push(optional.to_owned());
        }
    }
    names.extend(record.segmentation.objects.iter().filter_map(|o| o.mask.clone()));
    names.iter().try_for_each(|name| copy(name))?;
    let photo = record.photo.take();
    if record.source.redistributable == YesNo::Yes
        && let Some(name) = photo
    {
        let path = from.join(name);
        let bytes = read_bounded(&path, MAX_FILE)?;
        let exported =
            photo::export(&bytes, &record.source.boxes()?).map_err(|source| DatasetError::Picture { path, source })?;
        let name = format!("photo.{}", exported.extension);
        write_atomic(&to.join(&name), &exported.bytes)?;
        record.photo = Some(name);
    }
    Ok(())
}

/// The list that a scene is on. By the photo's hash: the same photo is always on the same list, whatever else is added.
fn fold(record: &Record, folds: Folds) -> &'static str {
    let hash = u64::from_str_radix(record.source.sha256.get(..13).unwrap_or("0"), 16).unwrap_or(0);
    let share = hash as f64 / (1_u64 << 52) as f64;
    match share {
        s if s < folds.train => "train",
        s if s < folds.train + folds.val => "val",
        _ => "test",
    }
}

fn lists(records: &[Record], folds: Folds) -> BTreeMap<String, String> {
    let mut lists: BTreeMap<String, String> = ["train", "val", "test", "easy", "medium", "complicated"]
        .iter()
        .map(|n| ((*n).to_owned(), String::new()))
        .collect();
    for record in records {
        for name in [fold(record, folds), record.id.split.name()] {
            let list = lists.entry(name.to_owned()).or_default();
            list.push_str(&record.id.path());
            list.push('\n');
        }
    }
    lists
}

/// Columns of `index.parquet`, one row a scene.
fn scene_columns(records: &[Record], folds: Folds) -> Vec<(&'static str, Column)> {
    let text = |f: &dyn Fn(&Record) -> String| Column::Text(records.iter().map(f).collect());
    let int = |f: &dyn Fn(&Record) -> usize| Column::Int(records.iter().map(|r| f(r) as i64).collect());
    let real = |f: &dyn Fn(&Record) -> f64| Column::Real(records.iter().map(f).collect());
    let stage = |stage: &'static str| move |r: &Record| r.objects.iter().filter(|o| o.stage == stage).count();
    let path = |file: &'static str| move |r: &Record| format!("{}/{file}", r.id.path());
    vec![
        ("scene", text(&|r| r.id.path())),
        ("split", text(&|r| r.id.split.name().to_owned())),
        ("room_type", text(&|r| r.id.room_type().to_owned())),
        ("fold", text(&|r| fold(r, folds).to_owned())),
        ("photo", text(&|r| r.photo.as_ref().map_or_else(String::new, |p| format!("{}/{p}", r.id.path())))),
        ("render", text(&path(layout::RENDER))),
        ("glb", text(&path(layout::SCENE_GLB))),
        ("segmentation", text(&path(layout::SEGMENTATION_PNG))),
        ("width", int(&|r| r.source.width as usize)),
        ("height", int(&|r| r.source.height as usize)),
        ("fx", real(&|r| r.scene.camera.intrinsics.fx)),
        ("fy", real(&|r| r.scene.camera.intrinsics.fy)),
        ("cx", real(&|r| r.scene.camera.intrinsics.cx)),
        ("cy", real(&|r| r.scene.camera.intrinsics.cy)),
        ("room_width_m", real(&|r| r.scene.room.extents.width)),
        ("room_height_m", real(&|r| r.scene.room.extents.height)),
        ("room_depth_m", real(&|r| r.scene.room.extents.depth)),
        ("objects", int(&|r| r.objects.len())),
        ("furniture", int(&stage("furniture"))),
        ("wall_mounted", int(&stage("wall-mounted"))),
        ("ceiling", int(&stage("ceiling"))),
        ("decoration", int(&stage("decoration"))),
        ("physically_lit", Column::Bool(records.iter().map(|r| r.provenance.render == "path-traced").collect())),
        ("redistributable", Column::Bool(records.iter().map(|r| r.source.redistributable == YesNo::Yes).collect())),
        ("source", text(&|r| r.source.source.clone())),
        ("source_url", text(&|r| r.source.source_url.clone())),
        ("author", text(&|r| r.source.author.clone())),
        ("licence", text(&|r| r.source.licence.clone())),
        ("photo_sha256", text(&|r| r.source.sha256.clone())),
        ("generator", text(&|r| r.provenance.generator.clone())),
    ]
}

/// Columns of `objects.parquet`, one row an object.
fn object_columns(records: &[Record]) -> Vec<(&'static str, Column)> {
    let rows: Vec<(&Record, &records::ObjectRow)> =
        records.iter().flat_map(|r| r.objects.iter().map(move |o| (r, o))).collect();
    let text =
        |f: &dyn Fn(&Record, &records::ObjectRow) -> String| Column::Text(rows.iter().map(|(r, o)| f(r, o)).collect());
    let real = |f: &dyn Fn(&records::ObjectRow) -> f64| Column::Real(rows.iter().map(|(_, o)| f(o)).collect());
    let segment =
        |r: &Record, o: &records::ObjectRow| r.segmentation.objects.iter().find(|s| s.id.as_str() == o.id).cloned();
    let or_empty = |value: &Option<String>| value.clone().unwrap_or_default();
    vec![
        ("scene", text(&|r, _| r.id.path())),
        ("id", text(&|_, o| o.id.clone())),
        ("type", text(&|_, o| o.kind.clone())),
        ("stage", text(&|_, o| o.stage.clone())),
        ("phrase", text(&|r, o| segment(r, o).map_or_else(String::new, |s| s.source_phrase))),
        (
            "color",
            text(&|r, o| {
                segment(r, o)
                    .map_or_else(String::new, |s| format!("#{:02x}{:02x}{:02x}", s.color[0], s.color[1], s.color[2]))
            }),
        ),
        ("pixels", Column::Int(rows.iter().map(|(r, o)| segment(r, o).map_or(0, |s| s.pixels as i64)).collect())),
        (
            "mask",
            text(&|r, o| {
                segment(r, o).and_then(|s| s.mask).map_or_else(String::new, |m| format!("{}/{m}", r.id.path()))
            }),
        ),
        ("width_m", real(&|o| o.size_m.width)),
        ("height_m", real(&|o| o.size_m.height)),
        ("depth_m", real(&|o| o.size_m.depth)),
        ("x_m", real(&|o| o.position_m[0])),
        ("y_m", real(&|o| o.position_m[1])),
        ("z_m", real(&|o| o.position_m[2])),
        ("yaw_deg", real(&|o| o.yaw_deg)),
        ("wall_affinity", text(&|_, o| or_empty(&o.wall_affinity))),
        ("facing", text(&|_, o| or_empty(&o.facing))),
        ("in_front_of", text(&|_, o| or_empty(&o.in_front_of))),
        ("behind", text(&|_, o| or_empty(&o.behind))),
        ("on_top_of", text(&|_, o| or_empty(&o.on_top_of))),
        ("grouped_with", text(&|_, o| or_empty(&o.grouped_with))),
    ]
}

/// Licences of photos, meshes, textures and weights.
fn manifest(config: &Config, records: &[Record]) -> Value {
    let scenes: Vec<Value> = records
        .iter()
        .map(|r| {
            let s = &r.source;
            let known = licences::find(&s.licence);
            let url = if s.licence_url.is_empty() { known.map_or("", |l| l.url) } else { &s.licence_url };
            json!({
                "scene": r.id.path(),
                "photo": {
                    "included": r.photo.is_some(), "sha256_of_original": s.sha256, "source": s.source, "url": s.source_url,
                    "author": s.author, "licence": s.licence, "licence_url": url, "retrieved_at": s.retrieved_at,
                    "blurred_regions": s.boxes().map_or(0, |b| b.len()), "looked_for_faces": s.faces,
                },
                // Textures of the scene are cut from the photo and follow its licence, too.
                "textures": { "licence": s.licence, "made_from": "the photo, and whoever is named as image_editor" },
                "meshes": r.provenance.mesh_sources, "players": r.provenance.cast, "generator": r.provenance.generator,
            })
        })
        .collect();
    let splits: BTreeMap<&str, usize> =
        Split::ALL.iter().map(|s| (s.name(), records.iter().filter(|r| r.id.split == *s).count())).collect();
    json!({
        "name": config.name, "version": config.version, "licence": config.licence, "splits": splits,
        "makers": config.makers, "scenes": scenes,
    })
}

/// Shards by split; how many.
fn make_shards(folder: &Path, records: &[Record], size: usize) -> Result<usize, DatasetError> {
    let mut count = 0;
    for split in Split::ALL {
        let of_split: Vec<&Record> = records.iter().filter(|r| r.id.split == split).collect();
        for (n, chunk) in of_split.chunks(size.max(1)).enumerate() {
            let mut members = Vec::new();
            for record in chunk {
                let scene = folder.join(record.id.path());
                for file in files(&scene) {
                    members.push((shards::member(&record.id, &file), read_bounded(&scene.join(&file), MAX_FILE)?));
                }
            }
            write_atomic(&folder.join(format!("shards/{}-{n:06}.tar", split.name())), &shards::shard(&members)?)?;
            count += 1;
        }
    }
    Ok(count)
}

/// `SHA256SUMS`, as `sha256sum --check` reads it.
fn sums(folder: &Path) -> Result<String, DatasetError> {
    let lines: Vec<String> = files(folder)
        .par_iter()
        .map(|path| Ok(format!("{}  {path}\n", sha256(&read_bounded(&folder.join(path), 8 << 30)?))))
        .collect::<Result<_, DatasetError>>()?;
    Ok(lines.concat())
}

/// All files below a folder, sorted, with `/`; hidden ones are left out.
pub fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).into_iter().flatten().flatten() {
            let path = entry.path();
            let hidden = path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
            if hidden {
                continue;
            }
            if path.is_dir() {
                folders.push(path);
            } else if let Ok(relative) = path.strip_prefix(folder) {
                found.push(relative.to_string_lossy().replace('\\', "/"));
            }
        }
    }
    found.sort();
    found
}
