//! FRONT3D, the list of 3D-FRONT renders that Gen3DSR published: truth as one PLY a scene, in the camera's frame.
//!
//! | file | what it is |
//! |---|---|
//! | `sceneobjgt/sceneobjgt_<id>.ply` | all objects of a scene, OpenCV camera axes, metres |
//! | `annotation/annotation_00<id>.json` | `camera_intrinsics`, for pictures of 1296 x 968 |
//! | `rgb/rgb_00<id>.jpeg` | the photo |
//!
//! The background depth (`bgdepth/*.npy`) has half the pictures' size while the published script unprojects it with the
//! full camera: its background truth is wrong there, and only objects are compared here. The objects of a scene are one
//! mesh, so that they cannot be compared one by one.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use harmony_io::read_bounded;
use harmony_scene::{Camera, ImageSize, Intrinsics};
use serde_json::Value;

use super::front::FrontError;
use super::truth::{TruthPiece, TruthSurfaces};
use crate::ply::parse_ply;

/// Size of the list's pictures.
const SIZE: ImageSize = ImageSize { width: 1296, height: 968 };
/// Largest PLY file, bytes.
const MAX_PLY: u64 = 2 << 30;

fn files(folder: &Path) -> Vec<PathBuf> {
    let inside = |p: &Path| -> Vec<PathBuf> {
        let mut all: Vec<PathBuf> =
            std::fs::read_dir(p).into_iter().flatten().filter_map(Result::ok).map(|e| e.path()).collect();
        all.sort();
        all
    };
    let top = inside(folder);
    let below: Vec<PathBuf> = top.iter().filter(|p| p.is_dir()).flat_map(|p| inside(p)).collect();
    top.into_iter().chain(below).filter(|p| p.is_file()).collect()
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

/// Ids of the scenes, `sceneobjgt_<id>.ply`; none in another folder.
///
/// # Errors
/// A file `scene_ids` that names a scene without truth.
pub fn list_of(folder: &Path) -> Result<Vec<String>, FrontError> {
    let all = files(folder);
    let mut ids: Vec<String> = all
        .iter()
        .filter(|p| p.extension().is_some_and(|e| e == "ply"))
        .filter_map(|p| stem(p).strip_prefix("sceneobjgt_").map(str::to_owned))
        .collect();
    ids.sort();
    let wanted = all.iter().find(|p| stem(p) == "scene_ids");
    if let (Some(path), false) = (wanted, ids.is_empty()) {
        let bytes = read_bounded(path, 1 << 24)?;
        let text = String::from_utf8_lossy(&bytes);
        let named: Vec<&str> =
            text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').filter(|w| number(w).is_some()).collect();
        let same = |a: &str, b: &str| number(a) == number(b);
        if let Some(missing) = named.iter().find(|n| !ids.iter().any(|id| same(id, n))) {
            let reason = format!("{} names the scene {missing}, which has no sceneobjgt_*.ply", path.display());
            return Err(FrontError::Content { path: folder.to_owned(), reason });
        }
        ids.retain(|id| named.is_empty() || named.iter().any(|n| same(id, n)));
    }
    Ok(ids)
}

/// The number at the end of a name: `rgb_0017`, `0017` and `17` are one scene.
pub fn number(name: &str) -> Option<u64> {
    let digits = name.len() - name.bytes().rev().take_while(u8::is_ascii_digit).count();
    name[digits..].parse().ok()
}

/// One scene of the list.
pub fn scene_of(folder: &Path, id: &str) -> Result<TruthSurfaces, FrontError> {
    let all = files(folder);
    let of = |prefix: &str, extensions: &[&str]| {
        all.iter()
            .find(|p| {
                let extension = p.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
                stem(p).starts_with(prefix)
                    && extensions.contains(&extension.as_str())
                    && number(&stem(p)) == number(id)
            })
            .cloned()
    };
    let missing =
        |reason: &str| FrontError::Content { path: folder.to_owned(), reason: format!("scene {id}: {reason}") };
    let path = of("sceneobjgt_", &["ply"]).ok_or_else(|| missing("no sceneobjgt_*.ply"))?;
    let ply = parse_ply(&read_bounded(&path, MAX_PLY)?);
    let ply = ply.map_err(|e| FrontError::Content { path: path.clone(), reason: e.to_string() })?;
    let annotation = of("annotation_", &["json"]).ok_or_else(|| missing("no annotation_*.json"))?;
    let value: Value = harmony_io::read_json(&annotation)?;
    let k = super::front::matrix(&value["camera_intrinsics"]);
    let k = k.ok_or_else(|| FrontError::Content {
        path: annotation,
        reason: "camera_intrinsics is no 3 x 3 matrix".into(),
    })?;
    let photo = of("rgb_", &["jpeg", "jpg", "png"]);
    let size = photo.as_ref().and_then(|p| image::image_dimensions(p).ok()).map_or(SIZE, |(w, h)| ImageSize::new(w, h));
    let camera = Camera {
        size,
        intrinsics: Intrinsics { fx: k.x_axis.x, fy: k.y_axis.y, cx: k.z_axis.x, cy: k.z_axis.y },
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let vertices: Vec<DVec3> = ply.positions.iter().map(|p| p.as_dvec3()).filter(|p| p.is_finite()).collect();
    let triangles = ply.triangles.iter().map(|t| t.map(|i| ply.positions[i as usize].as_dvec3())).collect();
    let piece = TruthPiece { id: "objects".to_owned(), furniture: true, triangles, vertices };
    Ok(TruthSurfaces {
        name: format!("rgb_{id}"),
        camera,
        pieces: vec![piece],
        whole_room: false,
        separate: false,
        photo,
        notes: Vec::new(),
    })
}
