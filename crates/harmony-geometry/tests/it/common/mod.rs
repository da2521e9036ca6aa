//! Rooms with known truth, read from the shared test material.

#![allow(dead_code, reason = "every test binary uses its part")]

use std::path::{Path, PathBuf};

use harmony_geometry::GrayImage;
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Mat3, Surface, Vec3};
use harmony_testing::shared;
use serde_json::Value;

/// One room.
pub struct Room {
    pub name: String,
    pub folder: PathBuf,
    pub camera: Camera,
    pub extents: Extents,
    pub walls_visible: Vec<Surface>,
    pub ceiling_visible: bool,
    pub depth_m: Vec<f32>,
}

impl Room {
    /// Depth in metres at image fractions, nearest pixel.
    pub fn depth_at(&self, u: f64, v: f64) -> f64 {
        let s = self.camera.size;
        let x = ((u * f64::from(s.width)) as u32).min(s.width - 1);
        let y = ((v * f64::from(s.height)) as u32).min(s.height - 1);
        f64::from(self.depth_m[(y * s.width + x) as usize])
    }
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn vec3(v: &Value) -> Vec3 {
    Vec3::new(v[0].as_f64().unwrap(), v[1].as_f64().unwrap(), v[2].as_f64().unwrap())
}

/// All rooms; none, and a skip, when the material is absent.
pub fn rooms() -> Vec<Room> {
    let Some(folder) = shared("gt") else { return vec![] };
    let mut folders: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.join("camera.json").is_file())
        .collect();
    folders.sort();
    folders.into_iter().map(read).collect()
}

fn read(folder: PathBuf) -> Room {
    let c = json(&folder.join("camera.json"));
    let r = json(&folder.join("room.json"));
    let size = ImageSize::new(c["width"].as_u64().unwrap() as u32, c["height"].as_u64().unwrap() as u32);
    let k = |i: usize, j: usize| c["K"][i][j].as_f64().unwrap();
    let rotation = Mat3::from_cols(vec3(&c["R"][0]), vec3(&c["R"][1]), vec3(&c["R"][2])).transpose();
    let camera = Camera {
        size,
        intrinsics: Intrinsics { fx: k(0, 0), fy: k(1, 1), cx: k(0, 2), cy: k(1, 2) },
        rotation,
        translation: vec3(&c["t"]),
    };
    let number = |name: &str| r[name].as_f64().unwrap();
    let walls_visible = [("back", Surface::Back), ("left", Surface::Left), ("right", Surface::Right)]
        .into_iter()
        // A sliver of a wall is no wall to measure.
        .filter(|(name, _)| r["wall_pixels"][name].as_u64().unwrap() as usize > size.pixels() / 50)
        .map(|(_, s)| s)
        .collect();
    let depth = image::open(folder.join("depth.png")).unwrap().into_luma16();
    Room {
        name: folder.file_name().unwrap().to_string_lossy().into_owned(),
        camera,
        extents: Extents { width: number("W"), height: number("H"), depth: number("D") },
        walls_visible,
        ceiling_visible: r["ceiling_visible"].as_bool().unwrap(),
        depth_m: depth.as_raw().iter().map(|v| f32::from(*v) / 1000.0).collect(),
        folder,
    }
}

/// A picture as the line detector wants it.
pub fn gray(path: &Path) -> GrayImage {
    let rgb = image::open(path).unwrap().into_rgb8();
    GrayImage::from_rgb8(ImageSize::new(rgb.width(), rgb.height()), rgb.as_raw()).unwrap()
}

/// Angle between two rotations, degrees.
pub fn angle_deg(a: Mat3, b: Mat3) -> f64 {
    let turn = a * b.transpose();
    ((turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees()
}
