//! A finished run as it is read for joining: its scene, its meshes, and what its photo shows of each object.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use harmony_io::{GlbError, LoadedNode, ReadLimits, load_glb};
use harmony_mesh::Mesh;
use harmony_render::{Instance, RenderOptions, render_depth_ids};
use harmony_scene::{Camera, ImageSize, Mask, Opening, Scene, SceneObject, Surface, Wall};
use image::RgbaImage;
use serde_json::Value;

use crate::depth::SeenDepth;

/// Width of the pictures by which what hides what is judged, pixels.
const SMALL: u32 = 320;
/// The pane of a passage is this near to its middle, metres.
const PANE_M: f64 = 0.3;
/// A mask this near to the image's edge is cut by it, pixels.
const EDGE: u32 = 2;

/// A run cannot be read for joining.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// `scene.json`.
    #[error("{folder} holds no scene: {source}", folder = folder.display())]
    Scene {
        /// Run folder.
        folder: PathBuf,
        /// Why.
        source: harmony_io::FileError,
    },
    /// `scene_full.glb`.
    #[error("the meshes of {folder} cannot be read: {source}", folder = folder.display())]
    Meshes {
        /// Run folder.
        folder: PathBuf,
        /// Why.
        source: GlbError,
    },
    /// It was joined itself.
    #[error("{folder} was joined from several runs itself", folder = folder.display())]
    Joined {
        /// Run folder.
        folder: PathBuf,
    },
}

/// A run of one photo.
#[derive(Debug, Clone)]
pub struct Source {
    /// Run folder.
    pub folder: PathBuf,
    /// The folder's name.
    pub name: String,
    /// Its scene, in its own room frame.
    pub scene: Scene,
    /// Its camera, pixels of the photo.
    pub camera: Camera,
    /// What it found.
    pub objects: Vec<SeenObject>,
    /// How far one sees in its photo.
    pub depth: SeenDepth,
    /// Its passages, and what its photo shows through them.
    pub passages: Vec<(Opening, Option<Arc<RgbaImage>>)>,
}

/// An object of a run, and how its photo shows it.
#[derive(Debug, Clone)]
pub struct SeenObject {
    /// As in `scene.json`.
    pub object: SceneObject,
    /// Canonical mesh as the run draws it.
    pub mesh: Arc<Mesh>,
    /// Its kind: a name of the catalogue, else its label.
    pub kind: String,
    /// Share of the image that its mask covers; 0 without a mask.
    pub share: f64,
    /// Share of its own silhouette that other things hide, by the run's own scene.
    pub hidden: f64,
    /// Whether the image's edge cuts its mask.
    pub cut: bool,
    /// Mean colour under its mask, CIE Lab; `None` without a mask or a photo.
    pub lab: Option<[f64; 3]>,
    /// One sigma of its place (metres), turn (radians) and size (relative), by the run's own posterior.
    pub spread: Option<[f64; 3]>,
}

impl SeenObject {
    /// Its footprint's centre in the run's room frame.
    pub fn place(&self) -> DVec3 {
        self.object.pose.position
    }

    /// How well its photo shows it: the share of the image that it fills, less what is hidden or cut off.
    pub fn quality(&self) -> f64 {
        self.share.sqrt() * (1.0 - 0.8 * self.hidden) * if self.cut { 0.5 } else { 1.0 }
    }

    /// Whether two objects may be the same thing by what they are called.
    pub fn same_kind(&self, other: &Self) -> bool {
        self.kind == other.kind && self.object.level == other.object.level
    }
}

/// The kind by which objects of several runs are compared: what draws them, or their name in the catalogue.
pub(crate) fn kind_of(label: &str) -> String {
    harmony_catalogue::kind(label)
        .map_or_else(|| label.to_lowercase(), |kind| kind.template.clone().unwrap_or_else(|| kind.name.clone()))
}

impl Source {
    /// Reads a run folder.
    ///
    /// # Errors
    /// A folder without a scene or meshes, or one that was joined itself.
    pub fn read(folder: &Path) -> Result<Self, SourceError> {
        if folder.join(crate::JOIN_FILE).is_file() {
            return Err(SourceError::Joined { folder: folder.to_owned() });
        }
        let scene: Scene = harmony_io::read_json(&folder.join("scene.json"))
            .map_err(|source| SourceError::Scene { folder: folder.to_owned(), source })?;
        let glb = load_glb(&folder.join("scene_full.glb"), &ReadLimits::default())
            .map_err(|source| SourceError::Meshes { folder: folder.to_owned(), source })?;
        let camera = Camera::from(&scene.camera);
        let small = camera.resized(camera.size.fit_within(SMALL));
        let index = |name: &str| scene.objects.iter().find(|o| o.id.as_str() == name).map_or(1, |o| o.index);
        let instances: Vec<Instance<'_>> = glb
            .nodes
            .iter()
            .map(|node| Instance {
                mesh: &node.mesh,
                linear: DMat3::from_cols_array(&node.transform.matrix3.to_cols_array()),
                translation: DVec3::from_array(node.transform.translation.to_array()),
                id: index(&node.name),
            })
            .collect();
        let options = RenderOptions::default();
        let frame = render_depth_ids(&small, &instances, &options);
        let spreads = spreads(folder);
        let photo = photo(folder, small.size);
        let objects = scene
            .objects
            .iter()
            .filter_map(|object| {
                let node = glb.nodes.iter().position(|n| n.name == object.id.as_str())?;
                let alone = render_depth_ids(&small, &instances[node..=node], &options);
                let whole = alone.depth.iter().filter(|z| **z > 0.0).count();
                let shown = frame.ids.iter().filter(|id| **id == object.index).count();
                let mask = object.mask.as_ref().and_then(|m| harmony_io::load_mask(&folder.join(m)).ok());
                let share = mask.as_ref().map_or(0.0, |m| m.count() as f64 / m.size().pixels().max(1) as f64);
                Some(SeenObject {
                    object: object.clone(),
                    mesh: Arc::clone(&glb.nodes[node].mesh),
                    kind: kind_of(&object.label),
                    share,
                    hidden: 1.0 - (shown as f64 / whole.max(1) as f64).min(1.0),
                    cut: mask.as_ref().is_some_and(|m| m.touches_border(EDGE).contains(&true)),
                    lab: mask.as_ref().zip(photo.as_ref()).and_then(|(mask, photo)| mean_lab(photo, mask)),
                    spread: spreads.get(object.id.as_str()).copied(),
                })
            })
            .collect();
        let depth = SeenDepth::new(folder, &small, &frame.depth);
        let name =
            folder.file_name().map_or_else(|| folder.display().to_string(), |n| n.to_string_lossy().into_owned());
        let passages = passages(&scene, &glb.nodes);
        Ok(Self { folder: folder.to_owned(), name, camera, objects, depth, passages, scene })
    }

    /// Whether a face of its room was measured.
    pub fn saw(&self, surface: Surface) -> bool {
        self.scene.room.seen.contains(&surface)
    }

    /// Whether its photo shows how high the room is.
    pub fn saw_height(&self) -> bool {
        self.saw(Surface::Floor) && self.saw(Surface::Ceiling)
    }

    /// Distance of its camera to a wall as it has it, metres.
    pub fn distance_to(&self, wall: Wall) -> f64 {
        wall.distance(&self.scene.room.extents, self.camera.centre())
    }
}

/// A run's passages with the panes that its file has behind them.
fn passages(scene: &Scene, nodes: &[LoadedNode]) -> Vec<(Opening, Option<Arc<RgbaImage>>)> {
    let panes: Vec<(DVec3, &LoadedNode)> = nodes
        .iter()
        .filter(|n| n.name.starts_with("beyond_") && !n.mesh.positions.is_empty())
        .map(|n| (n.mesh.positions.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / n.mesh.positions.len() as f64, n))
        .collect();
    let of = |o: &Opening| {
        let middle = o.wall.point(&scene.room.extents, f64::midpoint(o.u[0], o.u[1]), f64::midpoint(o.y[0], o.y[1]));
        let near = panes.iter().filter(|(at, _)| at.distance(middle) < PANE_M + o.inset.abs());
        let (_, node) = near.min_by(|a, b| a.0.distance(middle).total_cmp(&b.0.distance(middle)))?;
        node.mesh.materials.first()?.texture.clone()
    };
    scene.room.openings.iter().filter(|o| o.is_passage()).map(|o| (o.clone(), of(o))).collect()
}

/// Sigmas by object, from the levels' `placements.json`; empty where a run has none.
fn spreads(folder: &Path) -> BTreeMap<String, [f64; 3]> {
    let mut out = BTreeMap::new();
    for level in harmony_scene::Level::ALL {
        let path = folder.join(level.folder()).join("placements.json");
        let Ok(file) = harmony_io::read_json::<Value>(&path) else { continue };
        for row in file["objects"].as_array().into_iter().flatten() {
            let spread = &row["evidence"]["spread"];
            let number = |key: &str| spread[key].as_f64();
            if let (Some(id), Some(p), Some(y), Some(s)) =
                (row["id"].as_str(), number("position_m"), number("yaw"), number("size"))
            {
                out.insert(id.to_owned(), [p, y, s]);
            }
        }
    }
    out
}

/// The run's photo, byte for byte as it came: its path.
pub fn photo_file(folder: &Path) -> Option<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.file_stem().is_some_and(|stem| stem == "input"))
        .collect();
    found.sort();
    found.into_iter().next()
}

fn photo(folder: &Path, size: ImageSize) -> Option<image::RgbImage> {
    let photo = harmony_io::load_photo(&photo_file(folder)?).ok()?;
    Some(image::imageops::thumbnail(&photo.image, size.width, size.height))
}

/// Mean colour of the photo under a mask, CIE Lab under D65.
fn mean_lab(photo: &image::RgbImage, mask: &Mask) -> Option<[f64; 3]> {
    let mask = mask.resized(ImageSize::new(photo.width(), photo.height()));
    let mut sum = DVec3::ZERO;
    let mut count = 0.0;
    for (pixel, on) in photo.pixels().zip(mask.bits()) {
        if *on {
            let linear = harmony_imaging::color::linear_from_rgb8(pixel.0);
            sum += DVec3::from_array(linear.map(f64::from));
            count += 1.0;
        }
    }
    (count > 0.0).then(|| lab(sum / count))
}

/// CIE Lab of a linear sRGB colour.
fn lab(linear: DVec3) -> [f64; 3] {
    let xyz = DVec3::new(
        linear.dot(DVec3::new(0.4124, 0.3576, 0.1805)) / 0.9505,
        linear.dot(DVec3::new(0.2126, 0.7152, 0.0722)),
        linear.dot(DVec3::new(0.0193, 0.1192, 0.9505)) / 1.089,
    );
    let f = |t: f64| if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 };
    let (x, y, z) = (f(xyz.x), f(xyz.y), f(xyz.z));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Horizontal part of a point.
pub fn flat(point: DVec3) -> DVec2 {
    DVec2::new(point.x, point.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_one_kind_are_one() {
        assert_eq!(kind_of("couch"), kind_of("sofa"));
        assert_ne!(kind_of("sofa"), kind_of("bed"));
        assert_eq!(kind_of("Zither"), "zither");
    }

    #[test]
    fn lab_of_white_and_of_red() {
        let white = lab(DVec3::ONE);
        assert!((white[0] - 100.0).abs() < 0.1 && white[1].abs() < 0.5 && white[2].abs() < 0.5, "{white:?}");
        // sRGB red by any table: 53, 80, 67.
        let red = lab(DVec3::X);
        assert!((red[0] - 53.2).abs() < 0.5 && (red[1] - 80.1).abs() < 1.0 && (red[2] - 67.2).abs() < 1.0, "{red:?}");
    }
}
