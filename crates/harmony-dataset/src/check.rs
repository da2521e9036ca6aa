//! What is missing, wrong or not licensed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::{DMat3, DVec3};
use harmony_io::{ReadLimits, load_glb, load_mask, picture, read_bounded, read_json};
use harmony_scene::ImageSize;
use rayon::prelude::*;
use serde::Serialize;

use crate::config::Config;
use crate::layout::{self, SceneId};
use crate::licences;
use crate::records::{self, CameraFile, Record};
use crate::sources::{self, Source, YesNo};
use crate::{DatasetError, photo};

/// Name of the list of hashes of a release.
pub const SUMS: &str = "SHA256SUMS";

/// What a fault is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Something is not there.
    Missing,
    /// Something contradicts itself, or another file.
    Wrong,
    /// Something may not be published, or nobody knows whether it may.
    Licence,
}

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Forbids a release.
    Fault,
    /// To be known.
    Warning,
}

/// One finding.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Finding {
    /// Scene; empty = the data set.
    pub scene: String,
    /// How bad.
    pub severity: Severity,
    /// About what.
    pub kind: Kind,
    /// In words.
    pub what: String,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Report {
    /// Scenes looked at.
    pub scenes: usize,
    /// Findings by scene, faults first.
    pub findings: Vec<Finding>,
}

impl Report {
    /// Findings that forbid a release.
    pub fn faults(&self) -> usize {
        self.findings.iter().filter(|f| f.severity == Severity::Fault).count()
    }
}

/// Collects findings of one scene.
struct Notes {
    scene: String,
    findings: Vec<Finding>,
}

impl Notes {
    fn add(&mut self, severity: Severity, kind: Kind, what: impl Into<String>) {
        self.findings.push(Finding { scene: self.scene.clone(), severity, kind, what: what.into() });
    }

    fn missing(&mut self, what: impl Into<String>) {
        self.add(Severity::Fault, Kind::Missing, what);
    }

    fn wrong(&mut self, what: impl Into<String>) {
        self.add(Severity::Fault, Kind::Wrong, what);
    }

    fn licence(&mut self, what: impl Into<String>) {
        self.add(Severity::Fault, Kind::Licence, what);
    }
}

/// Checks a working folder or a release (which has [`SUMS`]).
///
/// # Errors
/// No data set, or a list of sources that cannot be read at all.
pub fn check(root: &Path) -> Result<Report, DatasetError> {
    let config = Config::load(root)?;
    let rows = sources::load(root)?;
    let released = root.join(SUMS).is_file();
    let scenes = layout::scenes(root)?;
    let by_id: BTreeMap<SceneId, &Source> = rows.iter().map(|r| (r.id(), r)).collect();
    let mut findings: Vec<Finding> = scenes
        .par_iter()
        .map(|id| {
            let mut notes = Notes { scene: id.path(), findings: Vec::new() };
            scene(root, id, by_id.get(id).copied(), &config, released, &mut notes);
            notes.findings
        })
        .flatten()
        .collect();
    let there: BTreeSet<&SceneId> = scenes.iter().collect();
    for row in rows.iter().filter(|r| !there.contains(&r.id())) {
        let mut notes = Notes { scene: row.id().path(), findings: Vec::new() };
        notes.missing("sources.csv lists it, its folder is not there");
        findings.extend(notes.findings);
    }
    whole(root, &config, &rows, released, &mut findings);
    findings.sort();
    Ok(Report { scenes: scenes.len(), findings })
}

/// What concerns the data set and not one scene.
fn whole(root: &Path, config: &Config, rows: &[Source], released: bool, findings: &mut Vec<Finding>) {
    let mut notes = Notes { scene: String::new(), findings: Vec::new() };
    let mut hashes: BTreeMap<&str, String> = BTreeMap::new();
    for row in rows.iter().filter(|r| !r.sha256.is_empty()) {
        if let Some(other) = hashes.insert(&row.sha256, row.id().path()) {
            notes.wrong(format!("{other} and {} have the same photo", row.id().path()));
        }
    }
    if rows.is_empty() {
        notes.missing("it has no scene");
    }
    for (what, value) in [("a description", &config.description), ("an address", &config.url)] {
        if value.trim().is_empty() {
            notes.add(Severity::Warning, Kind::Missing, format!("dataset.json lacks {what}"));
        }
    }
    if config.creators.is_empty() {
        notes.add(Severity::Warning, Kind::Missing, "dataset.json names no creators");
    }
    if licences::find(&config.licence).is_none() {
        notes.add(Severity::Warning, Kind::Licence, format!("the licence {:?} is not a known one", config.licence));
    }
    if released {
        sums(root, &mut notes);
    }
    findings.extend(notes.findings);
}

/// Every file of a release has the hash that it had.
fn sums(root: &Path, notes: &mut Notes) {
    let text = match read_bounded(&root.join(SUMS), 1 << 30) {
        Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
        Err(error) => return notes.missing(error.to_string()),
    };
    let mut listed = BTreeSet::new();
    let lines: Vec<(&str, &str)> = text.lines().filter_map(|l| l.split_once("  ")).collect();
    let wrong: Vec<String> = lines
        .par_iter()
        .filter_map(|(hash, path)| {
            let plain = Path::new(path).components().all(|c| matches!(c, std::path::Component::Normal(_)));
            if !plain {
                return Some(format!("{SUMS} lists {path:?}, which is outside"));
            }
            match read_bounded(&root.join(path), 8 << 30) {
                Ok(bytes) if layout::sha256(&bytes) == *hash => None,
                Ok(_) => Some(format!("{path} is not the file that was released")),
                Err(error) => Some(error.to_string()),
            }
        })
        .collect();
    for what in wrong {
        notes.wrong(what);
    }
    listed.extend(lines.iter().map(|(_, path)| (*path).to_owned()));
    for path in crate::release::files(root) {
        if path != SUMS && !listed.contains(&path) {
            notes.wrong(format!("{path} is not part of the release"));
        }
    }
}

fn scene(root: &Path, id: &SceneId, row: Option<&Source>, config: &Config, released: bool, notes: &mut Notes) {
    let folder = root.join(id.path());
    if layout::parse_name(&id.name).is_none() {
        notes.wrong("a scene's folder is named <room_type>_NN");
    }
    let before = notes.findings.len();
    for file in layout::REQUIRED {
        if !folder.join(file).is_file() {
            notes.missing(format!("{file} is not there"));
        }
    }
    let complete = notes.findings.len() == before;
    let Some(row) = row else {
        notes.licence("sources.csv has no row for it: nobody knows whether the photo may be published");
        return;
    };
    let size = photo_of(&folder, row, released, notes);
    licence(row, config, notes);
    if row.redistributable == YesNo::Yes && !row.is_looked_at() {
        let what = "nobody looked for faces in the photo, which is published: `harmony dataset faces`, or look and say so in \
                    the column faces of sources.csv";
        notes.add(Severity::Warning, Kind::Missing, what);
    }
    if !complete {
        return;
    }
    match records::load(root, row) {
        Ok(record) => {
            contents(&folder, &record, size, notes);
            makers(&record, config, notes);
        }
        Err(error) => notes.wrong(error.to_string()),
    }
}

/// The photo's file; its size in pixels as people see it.
fn photo_of(folder: &Path, row: &Source, released: bool, notes: &mut Notes) -> Option<ImageSize> {
    let listed = Some(ImageSize::new(row.width, row.height));
    let Some(path) = layout::photo_of(folder) else {
        if !(released && row.redistributable == YesNo::No) {
            notes.missing("photo.jpg (or .png, ...) is not there");
        }
        return listed;
    };
    if released && row.redistributable == YesNo::No {
        notes.licence("the photo may not be published and is there");
    }
    let bytes = match read_bounded(&path, picture::MAX_IMAGE_BYTES) {
        Ok(bytes) => bytes,
        Err(error) => {
            notes.wrong(error.to_string());
            return listed;
        }
    };
    if released {
        for what in photo::metadata(&bytes) {
            notes.wrong(format!("the photo carries {what}"));
        }
    } else if layout::sha256(&bytes) != row.sha256 {
        notes.wrong("the photo is not the one whose hash sources.csv has");
    }
    match photo::export(&bytes, &[]).and_then(|e| picture::decode(&e.bytes)) {
        Ok(image) => {
            if (image.width(), image.height()) != (row.width, row.height) {
                notes.wrong(format!(
                    "the photo has {} x {} pixels, sources.csv says {} x {}",
                    image.width(),
                    image.height(),
                    row.width,
                    row.height
                ));
            }
            for b in row.boxes().unwrap_or_default() {
                if b[2] > image.width() || b[3] > image.height() {
                    notes.wrong(format!("the region {b:?} to blur reaches beyond the photo"));
                }
            }
        }
        Err(error) => notes.wrong(format!("the photo cannot be read: {error}")),
    }
    if let Err(error) = row.boxes() {
        notes.wrong(error.to_string());
    }
    listed
}

fn licence(row: &Source, config: &Config, notes: &mut Notes) {
    if row.licence.trim().is_empty() {
        return notes.licence("sources.csv names no licence of the photo");
    }
    let own = row.source.eq_ignore_ascii_case("own");
    let url = row.source_url.trim();
    if url.is_empty() && !own {
        notes.licence("sources.csv has no address of the photo");
    } else if !url.is_empty() && !["https://", "http://"].iter().any(|scheme| url.starts_with(scheme)) {
        notes.licence(format!("{url:?} is no web address"));
    }
    if !is_day(&row.retrieved_at) {
        let what = "sources.csv does not say on which day (YYYY-MM-DD) the photo was fetched";
        notes.add(Severity::Warning, Kind::Licence, what);
    }
    let Some(known) = licences::find(&row.licence) else {
        if row.licence_url.trim().is_empty() {
            notes.licence(format!("{:?} is no known licence and has no address where it could be read", row.licence));
        } else if row.redistributable == YesNo::Yes {
            let what = format!("{:?} is no known licence; redistributable = yes is taken on trust", row.licence);
            notes.add(Severity::Warning, Kind::Licence, what);
        }
        return;
    };
    if row.redistributable == YesNo::Yes && !known.redistributable {
        notes.licence(format!("{} does not let the photo be published, sources.csv says yes", known.id));
    }
    if known.attribution && row.author.trim().is_empty() {
        notes.licence(format!("{} asks for the author's name, sources.csv has none", known.id));
    }
    if row.redistributable == YesNo::Yes && !known.derivatives {
        notes.licence(format!("{} forbids changed copies: textures of the scene are cut from the photo", known.id));
    }
    if row.redistributable == YesNo::Yes
        && let Some(why) = licences::conflict(known, &config.licence)
    {
        notes.licence(format!("{} does not go into a data set under {}: {why}", known.id, config.licence));
    }
}

fn is_day(text: &str) -> bool {
    let b = text.as_bytes();
    let digits = |range: std::ops::Range<usize>| b[range].iter().all(u8::is_ascii_digit);
    b.len() == 10 && b[4] == b'-' && b[7] == b'-' && digits(0..4) && digits(5..7) && digits(8..10)
}

/// Everybody whose work is in the scene has a licence that lets it be published.
fn makers(record: &Record, config: &Config, notes: &mut Notes) {
    for maker in record.provenance.makers() {
        match config.makers.get(&maker) {
            Some(known) if !known.redistributable => {
                notes.licence(format!("what {maker} made may not be published (dataset.json, makers)"));
            }
            Some(known) if known.licence.trim().is_empty() => {
                notes.licence(format!("dataset.json names no licence of what {maker} made"));
            }
            Some(_) => {}
            None => {
                notes.licence(format!("dataset.json (makers) does not say what may be done with what {maker} made"));
            }
        }
    }
}

fn contents(folder: &Path, record: &Record, size: Option<ImageSize>, notes: &mut Notes) {
    if record.provenance.render != "path-traced" {
        let what = "render.png is not physically lit: the run had no path tracer";
        notes.add(Severity::Warning, Kind::Missing, what);
    }
    segmentation(folder, record, size, notes);
    objects(record, notes);
    match read_json::<CameraFile>(&folder.join(layout::CAMERA)) {
        Ok(camera) => camera_holds(&camera, size, notes),
        Err(error) => notes.wrong(error.to_string()),
    }
    match picture::read(&folder.join(layout::RENDER)) {
        Ok(render) => {
            if let Some(size) = size {
                let ratio = |w: u32, h: u32| f64::from(w) / f64::from(h.max(1));
                let off = (ratio(render.width(), render.height()) / ratio(size.width, size.height)).ln().abs();
                if off > 0.02 {
                    notes.wrong(format!(
                        "render.png ({} x {}) is of another shape than the photo",
                        render.width(),
                        render.height()
                    ));
                }
            }
        }
        Err(error) => notes.wrong(format!("render.png: {error}")),
    }
    match load_glb(&folder.join(layout::SCENE_GLB), &ReadLimits::default()) {
        Ok(glb) => {
            let nodes: BTreeSet<&str> = glb.nodes.iter().map(|n| n.name.as_str()).collect();
            let absent: Vec<&str> =
                record.objects.iter().map(|o| o.id.as_str()).filter(|id| !nodes.contains(id)).collect();
            if !absent.is_empty() {
                notes.wrong(format!("scene.glb has no node for {}", absent.join(", ")));
            }
        }
        Err(error) => notes.wrong(format!("scene.glb: {error}")),
    }
}

/// Colour map and JSON say the same; masks are there.
fn segmentation(folder: &Path, record: &Record, size: Option<ImageSize>, notes: &mut Notes) {
    let file = &record.segmentation;
    if size.is_some_and(|s| s != file.size) {
        notes.wrong("segmentation.json has another size than the photo");
    }
    let image = match picture::read(&folder.join(layout::SEGMENTATION_PNG)) {
        Ok(image) => image.to_rgb8(),
        Err(error) => return notes.wrong(format!("segmentation.png: {error}")),
    };
    if (image.width(), image.height()) != (file.size.width, file.size.height) {
        notes.wrong("segmentation.png has another size than segmentation.json says");
    }
    let mut counts: BTreeMap<[u8; 3], usize> = BTreeMap::new();
    for pixel in image.pixels() {
        *counts.entry(pixel.0).or_default() += 1;
        if counts.len() > 20_000 {
            return notes.wrong("segmentation.png is no map of flat colours");
        }
    }
    counts.remove(&file.background);
    let mut colors = BTreeSet::new();
    for entry in &file.objects {
        if !colors.insert(entry.color) {
            notes.wrong(format!("{} has the colour of another object", entry.id));
        }
        let there = counts.get(&entry.color).copied().unwrap_or(0);
        if there != entry.pixels {
            notes.wrong(format!(
                "{} has {there} pixels in segmentation.png, {} in segmentation.json",
                entry.id, entry.pixels
            ));
        }
        if !["furniture", "wall-mounted", "ceiling", "decoration"].contains(&entry.stage.as_str()) {
            notes.wrong(format!("{} has the unknown stage {:?}", entry.id, entry.stage));
        }
        match &entry.mask {
            None => notes.add(Severity::Warning, Kind::Missing, format!("{} has no mask file", entry.id)),
            Some(mask) => match load_mask(&folder.join(mask)) {
                Ok(mask) if mask.size() == file.size => {}
                Ok(_) => notes.wrong(format!("the mask of {} has another size than the photo", entry.id)),
                Err(error) => notes.wrong(format!("the mask of {}: {error}", entry.id)),
            },
        }
    }
    let strangers: usize = counts.iter().filter(|(c, _)| !colors.contains(*c)).map(|(_, n)| n).sum();
    if strangers > 0 {
        notes.wrong(format!("segmentation.png has {strangers} pixels of colours that segmentation.json does not name"));
    }
}

/// Objects of all three files agree, relations lead somewhere.
fn objects(record: &Record, notes: &mut Notes) {
    let ids: BTreeSet<&str> = record.objects.iter().map(|o| o.id.as_str()).collect();
    if ids.len() != record.objects.len() {
        notes.wrong("objects.json has an id twice");
    }
    let scene: BTreeSet<&str> = record.scene.objects.iter().map(|o| o.id.as_str()).collect();
    if ids != scene {
        notes.wrong("objects.json and scene.json name other objects");
    }
    for entry in record.segmentation.objects.iter().filter(|e| !ids.contains(e.id.as_str())) {
        notes.wrong(format!("segmentation.json names {}, objects.json does not", entry.id));
    }
    for o in &record.objects {
        let s = o.size_m;
        if ![s.width, s.height, s.depth].iter().all(|v| v.is_finite() && *v > 0.0)
            || !o.position_m.iter().all(|v| v.is_finite())
        {
            notes.wrong(format!("{} has no size or no place", o.id));
        }
        let affinity = o.wall_affinity.as_deref().unwrap_or("centre");
        if !["back", "left", "right", "front", "centre"].contains(&affinity) {
            notes.wrong(format!("{} belongs to the unknown wall {affinity:?}", o.id));
        }
        for (what, target) in [
            ("faces", &o.facing),
            ("is in front of", &o.in_front_of),
            ("is behind", &o.behind),
            ("stands on", &o.on_top_of),
        ] {
            if let Some(target) = target.as_ref().filter(|t| !ids.contains(t.as_str())) {
                notes.wrong(format!("{} {what} {target}, which is not there", o.id));
            }
        }
    }
}

fn camera_holds(camera: &CameraFile, size: Option<ImageSize>, notes: &mut Notes) {
    if size.is_some_and(|s| (s.width, s.height) != (camera.width, camera.height)) {
        notes.wrong("camera.json has another size than the photo");
    }
    let r = camera.R;
    let m = DMat3::from_cols(DVec3::from_array(r[0]), DVec3::from_array(r[1]), DVec3::from_array(r[2]));
    let identity = m * m.transpose();
    let off = (identity - DMat3::IDENTITY).to_cols_array().into_iter().fold(0.0, |w: f64, v| w.max(v.abs()));
    let rotation = off <= 1e-6 && (m.determinant() - 1.0).abs() <= 1e-6;
    let lens = camera.K[0][0] > 0.0 && camera.K[1][1] > 0.0 && camera.K[2] == [0.0, 0.0, 1.0];
    if !rotation || !lens || !camera.t.iter().all(|v| v.is_finite()) {
        notes.wrong("camera.json holds no camera: R must be a rotation, fx and fy positive");
    }
}
