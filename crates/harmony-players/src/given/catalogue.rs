//! A catalogue of models by category and size as a mesh generator.
//!
//! Two kinds are read:
//!
//! * a folder with an `index.json`: `{"models": [{"file": "sofa.glb", "category": "sofa", "width": 2.0, "height": 0.8,
//!   "depth": 0.9, "up": "+y", "front": "+z"}]}`; sizes in metres, `category` may name several, separated by commas;
//! * a furniture library of Sweet Home 3D (`.sh3f`): a ZIP file with `PluginFurnitureCatalog.properties` and OBJ models.
//!
//! The model of the best category that comes nearest in size is taken. It keeps its proportions: it is scaled as a
//! whole to the size that was asked for.

use std::collections::BTreeMap;
use std::io::{Cursor, Read as _};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use async_trait::async_trait;
use glam::{DMat3, DVec3};
use harmony_io::{ReadLimits, read_bounded};
use harmony_mesh::{Mesh, canonicalise, clean};
use harmony_roles::{GeneratedMesh, MeshFrame, MeshGenerator, MeshRequest, PlayerCard, RoleError, Usage};
use harmony_scene::Size;
use serde::Deserialize;
use zip::ZipArchive;

use super::obj::read_obj;
use crate::check::{Check, Checked};
use crate::mesh::finish::{AxisName, SourceFrame};
use crate::work::computed;

/// Name of this player.
const PLAYER: &str = "catalogue";

/// Largest library or model file, bytes.
const MAX_BYTES: u64 = 512 << 20;

/// Largest file inside a library, bytes.
const MAX_ENTRY_BYTES: u64 = 128 << 20;

/// Least agreement of a category with a label, 0 to 1.
const MIN_AGREEMENT: f64 = 0.5;

/// A model of the catalogue.
#[derive(Debug, Clone, PartialEq)]
struct Entry {
    file: String,
    /// What it is called and filed under, in small letters.
    names: Vec<String>,
    /// Metres.
    size: Size,
    /// Takes the file's frame to +Y up, front +Z.
    turn: DMat3,
    /// Who made it and under what licence, when it is said.
    credit: Option<String>,
}

/// A catalogue.
#[derive(Debug, Clone)]
pub struct Catalogue {
    source: Source,
    entries: Vec<Entry>,
    digest: String,
}

#[derive(Debug, Clone)]
enum Source {
    Folder(PathBuf),
    Library(Arc<Vec<u8>>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Index {
    models: Vec<IndexEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct IndexEntry {
    file: String,
    category: String,
    width: f64,
    height: f64,
    depth: f64,
    up: Option<AxisName>,
    front: Option<AxisName>,
    credit: Option<String>,
}

impl Catalogue {
    /// Opens a folder with an `index.json`, or a library of Sweet Home 3D.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`] when it can't be read or holds no model.
    pub fn open(path: &Path) -> Result<Self, RoleError> {
        let wrong = |reason: String| RoleError::NotSetUp {
            player: PLAYER.to_owned(),
            reason: format!("{reason}: {}", path.display()),
            hint: "give a folder with an index.json, or a .sh3f library of Sweet Home 3D (docs/players.md)".to_owned(),
        };
        let read = |path: &Path| read_bounded(path, MAX_BYTES).map_err(|error| wrong(error.to_string()));
        let (source, bytes, entries) = if path.is_dir() {
            let bytes = read(&path.join("index.json"))?;
            let entries = index_entries(&bytes).map_err(|reason| wrong(format!("index.json: {reason}")))?;
            (Source::Folder(path.to_owned()), bytes, entries)
        } else {
            let bytes = Arc::new(read(path)?);
            let entries = library_entries(&bytes).map_err(wrong)?;
            (Source::Library(Arc::clone(&bytes)), bytes.to_vec(), entries)
        };
        if entries.is_empty() {
            return Err(wrong("there is no model in it".to_owned()));
        }
        let digest = blake3::hash(&bytes).to_hex()[..16].to_owned();
        Ok(Self { source, entries, digest })
    }

    /// Number of models.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there is none; never so for a catalogue that could be opened.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The model that fits a label and a size best.
    fn best(&self, label: &str, size: Size) -> Option<&Entry> {
        let rated = self.entries.iter().map(|entry| {
            let agreement = entry.names.iter().map(|name| agreement(label, name)).fold(0.0, f64::max);
            (entry, agreement, misfit(entry.size, size))
        });
        // A category that fits better wins over a size that does; words are few, so equal agreements are the rule.
        rated
            .filter(|(_, agreement, _)| *agreement >= MIN_AGREEMENT)
            .min_by(|a, b| b.1.total_cmp(&a.1).then(a.2.total_cmp(&b.2)))
            .map(|(entry, _, _)| entry)
    }

    fn mesh(&self, entry: &Entry) -> Result<Mesh, String> {
        match &self.source {
            Source::Folder(folder) => {
                harmony_io::load_mesh_glb(&folder.join(&entry.file), &ReadLimits::default()).map_err(|e| e.to_string())
            }
            Source::Library(bytes) => {
                let mut zip = ZipArchive::new(Cursor::new(bytes.as_slice())).map_err(|e| e.to_string())?;
                let text = zip_entry(&mut zip, &entry.file)?;
                let folder = entry.file.rsplit_once('/').map_or("", |(folder, _)| folder).to_owned();
                let mut load = |name: &str| {
                    let name = name.replace('\\', "/");
                    // Textures are named by foreign paths at times: then the file of that name beside the model.
                    let last = name.rsplit('/').next().unwrap_or_default();
                    [name.as_str(), last]
                        .iter()
                        .find_map(|n| zip_entry(&mut zip, format!("{folder}/{n}").trim_start_matches('/')).ok())
                };
                read_obj(&String::from_utf8_lossy(&text), &mut load)
            }
        }
    }

    /// The mesh for a request.
    fn make(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        let Some(entry) = self.best(&request.label, request.size) else {
            return Err(RoleError::NotCapable {
                player: PLAYER.to_owned(),
                reason: format!("there is no model for {:?}", request.label),
            });
        };
        let unusable = |complaint: String| RoleError::UnusableAnswer {
            player: PLAYER.to_owned(),
            complaint: format!("{}: {complaint}", entry.file),
            raw: String::new(),
        };
        let mesh = self.mesh(entry).map_err(unusable)?;
        let (mut mesh, _) = clean(&mesh, request.settings.faces as usize);
        mesh.check().map_err(|error| unusable(error.to_string()))?;
        canonicalise(&mut mesh, entry.turn);
        let own = mesh.bounds().map_or(DVec3::ONE, |bounds| bounds.size());
        let want = DVec3::new(request.size.width, request.size.height, request.size.depth);
        let scale = uniform_scale(own, want) as f32;
        mesh.map(|p| p * scale, |n| n);
        let mut notes = vec![format!("the catalogue's {} stands for {}", entry.names.join(" / "), request.label)];
        notes.extend(entry.credit.as_ref().map(|credit| format!("model by {credit}")));
        Ok(GeneratedMesh {
            mesh: Arc::new(mesh),
            convex: None,
            frame: MeshFrame::Canonical,
            part_model: None,
            source: format!("catalogue {}", entry.file),
            notes,
            usage: Usage::default(),
        })
    }
}

/// The one scale that brings a box nearest to another, in the mean of the logarithms of its sides. Flat sides (a rug's
/// height) say nothing about the scale.
fn uniform_scale(own: DVec3, want: DVec3) -> f64 {
    let least = 0.05 * own.max_element();
    let ratios = own.to_array().into_iter().zip(want.to_array()).filter(|(o, w)| *o > least && *w > 0.0);
    let (sum, count) = ratios.fold((0.0, 0.0), |(sum, n), (o, w)| (sum + (w / o).ln(), n + 1.0));
    if count > 0.0 { (sum / count).exp() } else { 1.0 }
}

/// How far two sizes are from each other: sum of the logarithms of the ratios of their sides.
fn misfit(a: Size, b: Size) -> f64 {
    let ratio = |x: f64, y: f64| (x.max(1e-3) / y.max(1e-3)).ln().abs();
    ratio(a.width, b.width) + ratio(a.height, b.height) + ratio(a.depth, b.depth)
}

/// How well a category fits a label, 0 to 1: the same words, or the last word (the noun) among them.
fn agreement(label: &str, name: &str) -> f64 {
    let words = |text: &str| -> Vec<String> {
        text.to_lowercase()
            .split(|c: char| !c.is_alphanumeric())
            .filter(|word| !word.is_empty())
            .map(|word| word.strip_suffix('s').filter(|w| w.len() > 2).unwrap_or(word).to_owned())
            .collect()
    };
    let (label, name) = (words(label), words(name));
    if label.is_empty() || name.is_empty() {
        return 0.0;
    }
    if label == name {
        return 1.0;
    }
    let shared = label.iter().filter(|word| name.contains(word)).count() as f64;
    let nouns = label.last() == name.last();
    if nouns { 0.6 + 0.3 * shared / label.len().max(name.len()) as f64 } else { 0.0 }
}

fn index_entries(bytes: &[u8]) -> Result<Vec<Entry>, String> {
    let index: Index = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
    let entry = |model: IndexEntry| {
        let plain = Path::new(&model.file).components().all(|part| matches!(part, Component::Normal(_)));
        if !plain || model.file.is_empty() {
            return Err(format!("{:?} is no file below the folder", model.file));
        }
        let usual = SourceFrame::default();
        let frame = SourceFrame { up: model.up.unwrap_or(usual.up), front: model.front.unwrap_or(usual.front) };
        let size =
            checked_size([model.width, model.height, model.depth]).map_err(|e| format!("{}: {e}", model.file))?;
        let names = model.category.split(',').map(|name| name.trim().to_lowercase()).collect();
        let turn = frame.canonical_from_source().map_err(|e| format!("{}: {e}", model.file))?;
        Ok(Entry { file: model.file, names, size, turn, credit: model.credit })
    };
    index.models.into_iter().map(entry).collect()
}

fn checked_size([width, height, depth]: [f64; 3]) -> Result<Size, String> {
    if [width, height, depth].iter().all(|side| *side > 0.0 && *side < 100.0) {
        Ok(Size { width, height, depth })
    } else {
        Err(format!("a size of {width} x {height} x {depth} m is none"))
    }
}

fn zip_entry(zip: &mut ZipArchive<Cursor<&[u8]>>, name: &str) -> Result<Vec<u8>, String> {
    let file = zip.by_name(name).map_err(|error| format!("{name}: {error}"))?;
    if file.size() > MAX_ENTRY_BYTES {
        return Err(format!("{name} has {} bytes; at most {MAX_ENTRY_BYTES} are read", file.size()));
    }
    let mut bytes = Vec::new();
    // What the directory says about the size need not be true.
    file.take(MAX_ENTRY_BYTES).read_to_end(&mut bytes).map_err(|error| format!("{name}: {error}"))?;
    Ok(bytes)
}

/// The models of a library whose geometry is an OBJ file with a size.
fn library_entries(bytes: &[u8]) -> Result<Vec<Entry>, String> {
    let mut zip = ZipArchive::new(Cursor::new(bytes)).map_err(|error| format!("not a library: {error}"))?;
    let properties = properties(&zip_entry(&mut zip, "PluginFurnitureCatalog.properties")?);
    let mut entries = Vec::new();
    for number in 1.. {
        let get = |key: &str| properties.get(&format!("{key}#{number}")).map(String::as_str);
        let Some(name) = get("name") else { break };
        let Some(model) = get("model").map(|path| path.trim_start_matches('/')) else { continue };
        if !model.to_lowercase().ends_with(".obj") {
            continue;
        }
        // Sizes are in centimetres; width is across, depth is front to back, as with us.
        let side = |key: &str| get(key).and_then(|text| text.trim().parse::<f64>().ok()).map_or(0.0, |cm| cm / 100.0);
        let Ok(size) = checked_size([side("width"), side("height"), side("depth")]) else { continue };
        let names = [Some(name), get("category")].into_iter().flatten().map(str::to_lowercase).collect();
        let turn = get("modelRotation").and_then(rotation).unwrap_or(DMat3::IDENTITY);
        let credit = match (get("creator"), get("license")) {
            (Some(creator), Some(licence)) => Some(format!("{creator}, {licence}")),
            (creator, licence) => creator.or(licence).map(str::to_owned),
        };
        entries.push(Entry { file: model.to_owned(), names, size, turn, credit });
    }
    Ok(entries)
}

/// Nine numbers, row by row.
fn rotation(text: &str) -> Option<DMat3> {
    let numbers: Vec<f64> = text.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    let rows: [f64; 9] = numbers.try_into().ok()?;
    let matrix = DMat3::from_cols_array(&rows).transpose();
    (matrix.is_finite() && (matrix.determinant() - 1.0).abs() < 1e-3).then_some(matrix)
}

/// Java's properties: Latin-1, `key=value` or `key: value`, `\` at the end of a line goes on, `\uXXXX`.
fn properties(bytes: &[u8]) -> BTreeMap<String, String> {
    let text: String = bytes.iter().map(|b| char::from(*b)).collect();
    let mut lines: Vec<String> = Vec::new();
    let mut open = false;
    for line in text.lines() {
        let line = line.trim_start();
        if !open && (line.is_empty() || line.starts_with(['#', '!'])) {
            continue;
        }
        let backslashes = line.chars().rev().take_while(|c| *c == '\\').count();
        let goes_on = backslashes % 2 == 1;
        let part = if goes_on { &line[..line.len() - 1] } else { line };
        match lines.last_mut().filter(|_| open) {
            Some(last) => last.push_str(part),
            None => lines.push(part.to_owned()),
        }
        open = goes_on;
    }
    let split = |line: &String| {
        let mut escaped = false;
        let at = line.find(|c: char| {
            let ends = !escaped && (c == '=' || c == ':');
            escaped = !escaped && c == '\\';
            ends
        })?;
        Some((unescaped(line[..at].trim()), unescaped(line[at + 1..].trim())))
    };
    lines.iter().filter_map(split).collect()
}

fn unescaped(text: &str) -> String {
    let mut out = String::new();
    let mut chars = text.chars();
    while let Some(c) = chars.next() {
        if c != '\\' {
            out.push(c);
            continue;
        }
        match chars.next() {
            Some('u') => {
                let code: String = chars.by_ref().take(4).collect();
                out.extend(u32::from_str_radix(&code, 16).ok().and_then(char::from_u32));
            }
            Some('n' | 't' | 'r') => out.push(' '),
            Some(other) => out.push(other),
            None => {}
        }
    }
    out
}

#[async_trait]
impl MeshGenerator for Catalogue {
    fn card(&self) -> PlayerCard {
        let model = format!("{} models, {}", self.entries.len(), self.digest);
        // Not `offline`: there may be no model for an object, and then the offline player makes the mesh.
        PlayerCard { player: PLAYER.to_owned(), model, offline: false, concurrency: 0 }
    }

    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        let (this, request) = (self.clone(), request.clone());
        computed(PLAYER, move || this.make(&request)).await?
    }
}

#[async_trait]
impl Check for Catalogue {
    async fn check(&self, _paid: bool) -> Result<Checked, RoleError> {
        // It was read when it was opened.
        Ok(Checked { detail: format!("{} models", self.entries.len()), usage: None })
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::io::Write as _;

    use super::*;
    use harmony_mesh::{TemplateParams, template};
    use harmony_roles::MeshSettings;
    use harmony_scene::Level;
    use image::RgbaImage;

    fn request(label: &str, size: [f64; 3]) -> MeshRequest {
        MeshRequest {
            name: "3_furniture/x_01/mesh".into(),
            crop: Arc::new(RgbaImage::new(1, 1)),
            label: label.into(),
            description: String::new(),
            level: Level::Furniture,
            size: Size { width: size[0], height: size[1], depth: size[2] },
            template: None,
            params: TemplateParams::default(),
            part_model: None,
            settings: MeshSettings::default(),
        }
    }

    #[tokio::test]
    async fn the_right_kind_in_the_nearest_size_is_taken_from_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let mut models = Vec::new();
        for (file, kind, width) in [("a.glb", "sofa", 1.4), ("b.glb", "sofa", 2.2), ("c.glb", "dining table", 2.2)] {
            let size = Size { width, height: 0.8, depth: 0.9 };
            let mesh = template(kind, &TemplateParams::default(), size).build(size).unwrap().mesh;
            harmony_io::write_mesh_glb(&folder.path().join(file), "m", Arc::new(mesh), serde_json::Value::Null)
                .unwrap();
            models
                .push(serde_json::json!({"file": file, "category": kind, "width": width, "height": 0.8, "depth": 0.9}));
        }
        let index = serde_json::json!({"models": models}).to_string();
        std::fs::write(folder.path().join("index.json"), index).unwrap();
        let catalogue = Catalogue::open(folder.path()).unwrap();
        let made = catalogue.generate(&request("leather sofa", [2.4, 0.85, 0.95])).await.unwrap();
        assert_eq!((made.source.as_str(), made.frame), ("catalogue b.glb", MeshFrame::Canonical));
        let bounds = made.mesh.bounds().unwrap();
        assert!((bounds.size().x - 2.37).abs() < 0.1 && bounds.min.y.abs() < 1e-5, "{bounds:?}");
        let error = catalogue.generate(&request("aquarium", [1.0; 3])).await.unwrap_err();
        assert!(matches!(error, RoleError::NotCapable { .. }));
        assert!(
            matches!(catalogue.generate(&request("sofa table", [1.0; 3])).await, Ok(m) if m.source.contains("c.glb"))
        );
    }

    #[tokio::test]
    async fn a_furniture_library_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("test.sh3f");
        let mut zip = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
        let options = zip::write::FileOptions::default();
        let mut put = |name: &str, bytes: &[u8]| {
            zip.start_file(name, options).unwrap();
            zip.write_all(bytes).unwrap();
        };
        // A box 1 x 2 x 0.5 in the file, lying on its back: the rotation sets it up.
        put(
            "PluginFurnitureCatalog.properties",
            b"# a test\nname#1=Armoire \\u00e0 glace\ncategory#1=Wardrobes\nmodel#1=/models/box.obj\nwidth#1=100\n\
              depth#1=50\nheight#1=200\nmodelRotation#1=1 0 0 \\\n 0 0 -1 0 1 0\ncreator#1=Somebody\nlicense#1=CC0\n\
              name#2=Lamp\nmodel#2=lamp.dae\nwidth#2=1\ndepth#2=1\nheight#2=1\n",
        );
        let mut obj = String::from("mtllib box.mtl\nusemtl wood\n");
        for (x, y, z) in [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)] {
            writeln!(obj, "v {x} {} {}", f64::from(y) * 0.5, f64::from(z) * -2.0).unwrap();
        }
        obj.push_str("f 1 2 3 4\nf 8 7 6 5\nf 5 6 2 1\nf 6 7 3 2\nf 7 8 4 3\nf 8 5 1 4\n");
        put("models/box.obj", obj.as_bytes());
        put("models/box.mtl", b"newmtl wood\nKd 0.5 0.3 0.1\n");
        zip.finish().unwrap();
        drop(zip);
        let catalogue = Catalogue::open(&path).unwrap();
        assert_eq!(catalogue.len(), 1, "what is no OBJ model is left out");
        assert_eq!(catalogue.entries[0].names, ["armoire à glace", "wardrobes"]);
        let made = catalogue.generate(&request("wardrobe", [1.0, 2.0, 0.5])).await.unwrap();
        let size = made.mesh.bounds().unwrap().size();
        assert!((size - DVec3::new(1.0, 2.0, 0.5)).length() < 1e-3, "{size:?}");
        assert!(made.notes.iter().any(|note| note.contains("Somebody, CC0")), "{:?}", made.notes);
    }

    #[test]
    fn what_is_no_catalogue_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Catalogue::open(folder.path()).is_err());
        let write = |text: &str| std::fs::write(folder.path().join("index.json"), text).unwrap();
        for text in [
            r#"{"models": []}"#,
            r#"{"models": [{"file": "../a.glb", "category": "x", "width": 1, "height": 1, "depth": 1}]}"#,
            r#"{"models": [{"file": "a.glb", "category": "x", "width": 0, "height": 1, "depth": 1}]}"#,
            "[]",
        ] {
            write(text);
            assert!(Catalogue::open(folder.path()).is_err(), "{text}");
        }
        let file = folder.path().join("x.sh3f");
        std::fs::write(&file, b"not a zip").unwrap();
        assert!(Catalogue::open(&file).is_err());
    }
}
