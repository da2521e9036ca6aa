//! Rooms of 3D-FRONT with the models of 3D-FUTURE, for those who hold the data.
//!
//! A room is described by a file `front3d.json`:
//!
//! ```json
//! {"house": "3D-FRONT/0a8d471a.json", "future": "3D-FUTURE-model", "room": "LivingDiningRoom-4017",
//!  "mirror": "blenderproc", "photo": "rgb_0017.jpeg",
//!  "camera": {"width": 1296, "height": 968, "K": [[..], [..], [..]], "R": [[..], [..], [..]], "t": [..]}}
//! ```
//!
//! Paths are relative to the file. `room` is an `instanceid`, or a `type` that only one room has. The camera
//! (`x_cam = R x + t`, OpenCV axes) is posed in the house's frame after the mirror: +Y up, metres.
//!
//! # Reading of the house
//! A piece of furniture is `R(rot) (v * scale) + pos` with `rot` a quaternion x, y, z, w; a piece counts when the house
//! calls it valid and its scales are within 1e-5 and 5; a room with fewer than two pieces is refused (as in the data set
//! that ATISS prepares). Models that are not there are told and left out.
//!
//! # Mirror
//! The usual renderer (BlenderProc) draws the house mirrored (z negated), each piece unmirrored in itself. Truth must go
//! the way of the pictures: `"mirror": "blenderproc"` does that, `"none"` (the default) leaves the house as it is. With
//! `M` the mirror of z, a piece's turn is `M R N`, `N` the mirror of x: what reading the quaternion as w, x, y, z and
//! turning by -90 degrees about Blender's x amounts to.

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use harmony_io::{FileError, read_bounded};
use harmony_players::given::obj::read_obj;
use harmony_scene::{Camera, ImageSize, Intrinsics};
use serde::Deserialize;
use serde_json::Value;

use super::truth::{TruthPiece, TruthSurfaces};
use crate::metrics::soup::soup_of;

/// Largest model, bytes.
const MAX_OBJ: u64 = 1 << 30;
/// Scales beyond these are broken entries.
const SCALES: std::ops::RangeInclusive<f64> = 1e-5..=5.0;
/// Fewest pieces of a room.
const FEWEST: usize = 2;
/// Super-categories that do not stand on the floor.
const NOT_ON_THE_FLOOR: [&str; 2] = ["Lighting", "Others"];

/// 3D-FRONT data that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FrontError {
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// Its content.
    #[error("{path}: {reason}")]
    Content {
        /// Which file or folder.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// No such room.
    #[error("{path} has no room {room:?}; it has {}", .rooms.join(", "))]
    Room {
        /// The house.
        path: PathBuf,
        /// What was asked for.
        room: String,
        /// What there is.
        rooms: Vec<String>,
    },
}

impl FrontError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::Content { .. } => Some("docs/evaluation.md has the layout that is read"),
            Self::Room { .. } => Some("name its instanceid in front3d.json"),
        }
    }
}

/// Which way the pictures were drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mirror {
    /// As the house is.
    None,
    /// z negated, each piece unmirrored in itself.
    BlenderProc,
}

impl Mirror {
    /// The turn of a piece whose turn in the house is `turn`.
    pub fn turn(self, turn: DMat3) -> DMat3 {
        match self {
            Self::None => turn,
            Self::BlenderProc => {
                DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0))
                    * turn
                    * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))
            }
        }
    }

    /// The place of a point of the house.
    pub fn place(self, p: DVec3) -> DVec3 {
        match self {
            Self::None => p,
            Self::BlenderProc => DVec3::new(p.x, p.y, -p.z),
        }
    }
}

fn vector(v: &Value) -> Option<DVec3> {
    let v = DVec3::new(v.get(0)?.as_f64()?, v.get(1)?.as_f64()?, v.get(2)?.as_f64()?);
    v.is_finite().then_some(v)
}

/// A 3 x 3 matrix by rows.
pub fn matrix(v: &Value) -> Option<DMat3> {
    Some(DMat3::from_cols(vector(v.get(0)?)?, vector(v.get(1)?)?, vector(v.get(2)?)?).transpose())
}

/// Reads a described room.
pub fn front_room(file: &Path) -> Result<TruthSurfaces, FrontError> {
    let bad = |reason: String| FrontError::Content { path: file.to_owned(), reason };
    let about: Value = harmony_io::read_json(file)?;
    let base = file.parent().unwrap_or(Path::new(""));
    let path = |key: &str| about[key].as_str().map(|p| base.join(p));
    let house_file = path("house").ok_or_else(|| bad("`house` is missing".into()))?;
    let future = path("future").ok_or_else(|| bad("`future` is missing".into()))?;
    let mirror: Mirror = match &about["mirror"] {
        Value::Null => Mirror::None,
        text => Mirror::deserialize(text).map_err(|_| bad("`mirror` is \"none\" or \"blenderproc\"".into()))?,
    };
    let camera = camera(&about["camera"]).ok_or_else(|| bad("`camera` has no width, height, K, R, t".into()))?;
    let house: Value = harmony_io::read_json(&house_file)?;
    let rooms = house["scene"]["room"].as_array().ok_or_else(|| FrontError::Content {
        path: house_file.clone(),
        reason: "this is no house of 3D-FRONT: scene.room is missing".into(),
    })?;
    let wanted = about["room"].as_str().unwrap_or_default();
    let id = |r: &Value| r["instanceid"].as_str().unwrap_or_default().to_owned();
    let of_type: Vec<&Value> = rooms.iter().filter(|r| r["type"].as_str() == Some(wanted)).collect();
    let exact = rooms.iter().find(|r| !wanted.is_empty() && id(r) == wanted);
    let only = if wanted.is_empty() && rooms.len() == 1 { rooms.first() } else { None };
    let room = exact.or_else(|| (of_type.len() == 1).then(|| of_type[0])).or(only);
    let room = room.ok_or_else(|| FrontError::Room {
        path: house_file.clone(),
        room: wanted.to_owned(),
        rooms: rooms.iter().map(id).collect(),
    })?;
    let mut notes = Vec::new();
    let mut pieces = Vec::new();
    let listed = house["furniture"].as_array().map_or(&[][..], Vec::as_slice);
    for child in room["children"].as_array().into_iter().flatten() {
        let Some(entry) = listed.iter().find(|f| f["uid"].is_string() && f["uid"] == child["ref"]) else { continue };
        if entry["valid"].as_bool() != Some(true) {
            continue;
        }
        let jid = child["replace_jid"].as_str().or(entry["jid"].as_str()).unwrap_or_default();
        let name = child["instanceid"].as_str().unwrap_or(jid).to_owned();
        let place = vector(&child["pos"]).zip(vector(&child["scale"])).zip(quaternion(&child["rot"]));
        let Some(((pos, scale), rot)) = place.filter(|((_, s), _)| s.to_array().iter().all(|v| SCALES.contains(v)))
        else {
            notes.push(format!("{name}: left out, its place or scale is broken"));
            continue;
        };
        // A jid is a folder's name and nothing else.
        let plain = !jid.is_empty() && jid.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        let model = if plain { model(&future.join(jid)) } else { Err("its model has no name".to_owned()) };
        let mesh = match model {
            Ok(mesh) => mesh,
            Err(reason) => {
                notes.push(format!("{name}: left out, {reason}"));
                continue;
            }
        };
        let turn = mirror.turn(DMat3::from_quat(rot));
        let world = |v: DVec3| camera.to_camera(turn * (v * scale) + mirror.place(pos));
        let super_category = category(&future.join(jid)).or_else(|| entry["category"].as_str().map(str::to_owned));
        let furniture = !super_category.is_some_and(|c| NOT_ON_THE_FLOOR.contains(&c.as_str()));
        pieces.push(TruthPiece {
            id: name,
            furniture,
            triangles: soup_of(&mesh, world),
            vertices: mesh.positions.iter().map(|p| world(p.as_dvec3())).collect(),
        });
    }
    if pieces.len() < FEWEST {
        let reason = format!("the room has {} usable pieces, fewer than {FEWEST}: {}", pieces.len(), notes.join("; "));
        return Err(FrontError::Content { path: house_file, reason });
    }
    let name = file.parent().and_then(Path::file_name).map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    Ok(TruthSurfaces {
        name,
        camera,
        pieces,
        whole_room: true,
        separate: true,
        photo: path("photo").filter(|p| p.is_file()),
        notes,
    })
}

fn quaternion(v: &Value) -> Option<DQuat> {
    let part = |i: usize| v.get(i)?.as_f64();
    let q = DQuat::from_xyzw(part(0)?, part(1)?, part(2)?, part(3)?);
    (q.is_finite() && q.length() > 1e-6).then(|| q.normalize())
}

fn camera(v: &Value) -> Option<Camera> {
    let side = |key: &str| v[key].as_f64().filter(|s| (1.0..=32_768.0).contains(s)).map(|s| s as u32);
    let k = matrix(&v["K"])?;
    Some(Camera {
        size: ImageSize::new(side("width")?, side("height")?),
        intrinsics: Intrinsics { fx: k.x_axis.x, fy: k.y_axis.y, cx: k.z_axis.x, cy: k.z_axis.y },
        rotation: matrix(&v["R"])?,
        translation: vector(&v["t"])?,
    })
}

/// The model of a folder of 3D-FUTURE; its colours are not needed for distances.
fn model(folder: &Path) -> Result<harmony_mesh::Mesh, String> {
    let file = ["raw_model.obj", "raw_model_tri.obj", "normalized_model.obj"].map(|n| folder.join(n));
    let file =
        file.into_iter().find(|f| f.is_file()).ok_or_else(|| format!("no raw_model.obj in {}", folder.display()))?;
    let bytes = read_bounded(&file, MAX_OBJ).map_err(|e| e.to_string())?;
    let mesh = read_obj(&String::from_utf8_lossy(&bytes), &mut |_| None)?;
    if mesh.positions.iter().any(|p| !p.is_finite()) {
        return Err(format!("{} has vertices that are not finite", file.display()));
    }
    Ok(mesh)
}

fn category(folder: &Path) -> Option<String> {
    let value: Value = harmony_io::read_json(&folder.join("model_info.json")).ok()?;
    value["super-category"].as_str().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What BlenderProc does, step by step: quaternion as w, x, y, z; -90 degrees about Blender's x; position x, z, y.
    #[test]
    fn the_mirror_is_that_of_the_usual_renderer() {
        let gltf_from_blender = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        for angle in [0.0, 0.3, -1.1, 2.0, std::f64::consts::PI] {
            let (s, c) = (angle / 2.0_f64).sin_cos();
            let json = [0.0, s, 0.0, c];
            let read_wrongly = DQuat::from_xyzw(json[1], json[2], json[3], json[0]);
            let blender =
                DMat3::from_rotation_x(-std::f64::consts::FRAC_PI_2) * DMat3::from_quat(read_wrongly.normalize());
            let theirs = gltf_from_blender * blender;
            let ours = Mirror::BlenderProc.turn(DMat3::from_quat(DQuat::from_array(json)));
            assert!((theirs - ours).to_cols_array().iter().all(|v| v.abs() < 1e-12), "{angle}: {theirs} {ours}");
            assert!((ours.determinant() - 1.0).abs() < 1e-12, "each piece keeps its handedness");
            let p = DVec3::new(1.0, 2.0, 3.0);
            assert_eq!(Mirror::BlenderProc.place(p), gltf_from_blender * DVec3::new(p.x, p.z, p.y));
        }
    }
}
