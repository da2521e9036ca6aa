//! A room with known truth: the folder format of the photo-like rooms and of the generated ones.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use harmony_mesh::{Group, Material, Mesh};
use harmony_scene::{
    Camera, Extents, ImageSize, Intrinsics, Level, Mask, ObjectId, Opening, OpeningKind, PixelBox, Room, RoomShape,
    Support, Wall,
};
use serde_json::Value;

mod shape;

/// Objects with fewer visible pixels are neither asked for nor counted in the recall.
pub const FEWEST_PIXELS: u64 = 50;

/// A truth folder cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TruthError {
    /// A file is missing or unreadable.
    #[error("{path} cannot be read: {source}", path = path.display())]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file is not what it should be.
    #[error("{path}: {reason}", path = path.display())]
    Format {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

impl TruthError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        Some(
            "a truth folder holds photo.jpg, camera.json, room.json, objects.json, depth.png, instances.png, meshes.npz",
        )
    }
}

/// An object as it is.
#[derive(Debug, Clone)]
pub struct TruthObject {
    /// Its id in the truth.
    pub id: String,
    /// Value in the id image.
    pub index: u32,
    /// Level.
    pub level: Level,
    /// Category, lower case.
    pub label: String,
    /// Bottom centre of the mesh's box, room frame, metres.
    pub position: DVec3,
    /// Yaw, radians.
    pub yaw: f64,
    /// Size before rotation, metres.
    pub size: DVec3,
    /// What carries it.
    pub support: Support,
    /// Wall its back is turned to.
    pub wall: Option<Wall>,
    /// Id of the object that it faces.
    pub facing: Option<String>,
    /// It faces the room at large.
    pub faces_room: bool,
    /// Functional group or set.
    pub group: Option<String>,
    /// Model it was made from: equal models are one matched set.
    pub model: String,
    /// Pixels of the photo that show it.
    pub visible_pixels: u64,
    /// Share hidden by others.
    pub occluded: f64,
    /// Share outside the image.
    pub truncated: f64,
    /// Objects whose boxes may overlap its own.
    pub may_overlap: Vec<String>,
    /// Canonical mesh: bottom at y = 0, centred, front +Z, metres.
    pub mesh: Arc<Mesh>,
}

/// A room.
#[derive(Debug, Clone)]
pub struct TruthRoom {
    /// Folder name.
    pub name: String,
    /// Folder.
    pub folder: PathBuf,
    /// Camera.
    pub camera: Camera,
    /// Size.
    pub extents: Extents,
    /// What makes it other than a box.
    pub shape: RoomShape,
    /// Where the frame begins in that of the files: behind thick walls these begin at the box's own corner.
    pub origin: DVec3,
    /// Walls in view.
    pub walls: Vec<Wall>,
    /// Doors and windows.
    pub openings: Vec<Opening>,
    /// Objects with at least one visible pixel.
    pub objects: Vec<TruthObject>,
    /// Id image, row-major.
    pub ids: Vec<u8>,
    /// Planar depth, metres, 0 = nothing.
    pub depth: Vec<f32>,
}

#[expect(clippy::needless_pass_by_value, reason = "errors and texts alike")]
fn bad(path: &Path, reason: impl ToString) -> TruthError {
    TruthError::Format { path: path.to_owned(), reason: reason.to_string() }
}

fn json(path: &Path) -> Result<Value, TruthError> {
    let bytes = std::fs::read(path).map_err(|source| TruthError::Read { path: path.to_owned(), source })?;
    serde_json::from_slice(&bytes).map_err(|e| bad(path, e))
}

fn number(path: &Path, v: &Value, key: &str) -> Result<f64, TruthError> {
    v[key].as_f64().ok_or_else(|| bad(path, format!("{key} is missing or no number")))
}

fn vec3(v: &Value) -> Option<DVec3> {
    Some(DVec3::new(v.get(0)?.as_f64()?, v.get(1)?.as_f64()?, v.get(2)?.as_f64()?))
}

fn mat3(v: &Value) -> Option<DMat3> {
    Some(DMat3::from_cols(vec3(v.get(0)?)?, vec3(v.get(1)?)?, vec3(v.get(2)?)?).transpose())
}

/// Place of a niche in the room's shape by its name: `niche_01`.
fn niche_named(name: &str) -> Option<usize> {
    name.strip_prefix("niche_")?.parse::<usize>().ok()?.checked_sub(1)
}

/// A wall by its name in the truth.
pub fn wall_named(text: &str) -> Option<Wall> {
    match text {
        "back" => Some(Wall::Back),
        "left" => Some(Wall::Left),
        "right" => Some(Wall::Right),
        "front" => Some(Wall::Front),
        _ => None,
    }
}

/// The camera of a `camera.json`, in a frame that begins at `origin` in the file's.
fn camera(path: &Path, origin: DVec3) -> Result<Camera, TruthError> {
    let c = json(path)?;
    let k = mat3(&c["K"]).ok_or_else(|| bad(path, "K is no 3 x 3 matrix"))?;
    let rotation = mat3(&c["R"]).ok_or_else(|| bad(path, "R is no 3 x 3 matrix"))?;
    let translation = vec3(&c["t"]).ok_or_else(|| bad(path, "t is no vector"))?;
    Ok(Camera {
        size: ImageSize::new(number(path, &c, "width")? as u32, number(path, &c, "height")? as u32),
        intrinsics: Intrinsics { fx: k.x_axis.x, fy: k.y_axis.y, cx: k.z_axis.x, cy: k.z_axis.y },
        rotation,
        translation: translation + rotation * origin,
    })
}

/// The ids and the planar depths, metres, of a folder's `instances.png` and `depth.png`.
fn buffers(folder: &Path, size: ImageSize) -> Result<(Vec<u8>, Vec<f32>), TruthError> {
    let path = folder.join("instances.png");
    let ids = image::open(&path).map_err(|e| bad(&path, e))?.into_luma8();
    let path = folder.join("depth.png");
    let depth = image::open(&path).map_err(|e| bad(&path, e))?.into_luma16();
    for (name, found) in [("instances.png", ids.dimensions()), ("depth.png", depth.dimensions())] {
        if found != (size.width, size.height) {
            return Err(bad(
                &folder.join(name),
                format!("{found:?} pixels, the camera has {} x {}", size.width, size.height),
            ));
        }
    }
    Ok((ids.into_raw(), depth.into_raw().into_iter().map(|mm| f32::from(mm) / 1000.0).collect()))
}

/// The room from a place where the photo was not taken. For judging alone, never an input.
#[derive(Debug, Clone)]
pub struct TruthView {
    /// Folder name.
    pub name: String,
    /// Folder.
    pub folder: PathBuf,
    /// Camera, in the room's frame.
    pub camera: Camera,
    /// Id image, row-major, values as in the photo's.
    pub ids: Vec<u8>,
    /// Planar depth, metres, 0 = nothing.
    pub depth: Vec<f32>,
}

impl TruthView {
    /// Loads a view of a room whose frame begins at `origin` in that of the files ([`TruthRoom::origin`]).
    ///
    /// # Errors
    /// A file that is missing or not in the format.
    pub fn load(folder: &Path, origin: DVec3) -> Result<Self, TruthError> {
        let camera = camera(&folder.join("camera.json"), origin)?;
        let (ids, depth) = buffers(folder, camera.size)?;
        let name = folder.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        Ok(Self { name, folder: folder.to_owned(), camera, ids, depth })
    }

    /// What it looks like from there.
    pub fn photo(&self) -> PathBuf {
        self.folder.join("photo.jpg")
    }
}

impl TruthRoom {
    /// The views of the room's folder `views`, by name; none where there is no such folder.
    ///
    /// # Errors
    /// A view that cannot be read.
    pub fn views(&self) -> Result<Vec<TruthView>, TruthError> {
        let folder = self.folder.join("views");
        if !folder.is_dir() {
            return Ok(Vec::new());
        }
        let entries = std::fs::read_dir(&folder).map_err(|source| TruthError::Read { path: folder, source })?;
        let mut folders: Vec<PathBuf> =
            entries.filter_map(Result::ok).map(|e| e.path()).filter(|p| p.join("camera.json").is_file()).collect();
        folders.sort();
        folders.iter().map(|f| TruthView::load(f, self.origin)).collect()
    }

    /// Loads a room.
    ///
    /// # Errors
    /// A file that is missing or not in the format.
    pub fn load(folder: &Path) -> Result<Self, TruthError> {
        let path = folder.join("room.json");
        let r = json(&path)?;
        let whole =
            Extents { width: number(&path, &r, "W")?, height: number(&path, &r, "H")?, depth: number(&path, &r, "D")? };
        let list = |v: &Value| v.as_array().cloned().unwrap_or_default();
        let (shape, extents, origin) = shape::read(&r, whole);
        let camera = camera(&folder.join("camera.json"), origin)?;
        let mut walls: Vec<Wall> = list(&r["walls_visible"]).iter().filter_map(|w| wall_named(w.as_str()?)).collect();
        let openings = list(&r["openings"]).iter().filter_map(|o| opening(o, &whole, &extents, origin)).collect();
        let path = folder.join("objects.json");
        let described = json(&path)?;
        let meshes = meshes(&folder.join("meshes.npz"))?;
        let mut objects = Vec::new();
        for o in list(&described["objects"]) {
            if o["visible_pixels"].as_u64().unwrap_or(0) == 0 {
                continue;
            }
            let id = o["id"].as_str().unwrap_or_default();
            let Some((v, f)) = meshes.get(id) else { continue };
            let mut found = object(&o, v, f).ok_or_else(|| bad(&path, format!("{id} is incomplete")))?;
            found.position -= origin;
            objects.push(found);
        }
        let (ids, depth) = buffers(folder, camera.size)?;
        if !shape.is_box() {
            let shown = shape::box_walls_shown(&camera, &extents, &ids, &depth);
            walls.retain(|wall| shown.contains(wall));
        }
        Ok(Self {
            name: folder.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
            folder: folder.to_owned(),
            camera,
            extents,
            shape,
            origin,
            walls,
            openings,
            objects,
            ids,
            depth,
        })
    }

    /// The photo.
    pub fn photo(&self) -> PathBuf {
        self.folder.join("photo.jpg")
    }

    /// The empty room.
    pub fn room(&self) -> Room {
        Room {
            room_type: String::new(),
            extents: self.extents,
            shape: self.shape.clone(),
            seen: Vec::new(),
            openings: self.openings.clone(),
            floor_texture: None,
            wall_texture: None,
        }
    }

    /// Pixels that show an object.
    pub fn mask(&self, index: u32) -> Mask {
        let w = self.camera.size.width as usize;
        Mask::from_fn(self.camera.size, |x, y| u32::from(self.ids[y as usize * w + x as usize]) == index)
    }

    /// Objects that can be seen well enough to be asked for.
    pub fn visible(&self) -> impl Iterator<Item = &TruthObject> {
        self.objects.iter().filter(|o| o.visible_pixels >= FEWEST_PIXELS)
    }

    /// An object by its id.
    pub fn find(&self, id: &str) -> Option<&TruthObject> {
        self.objects.iter().find(|o| o.id == id)
    }

    /// The back floor corner seen by the camera, farthest first, with its pixel: where the room frame is anchored.
    pub fn seen_corner(&self) -> Option<(Wall, DVec2)> {
        [(Wall::Left, DVec3::ZERO), (Wall::Right, DVec3::new(self.extents.width, 0.0, 0.0))]
            .into_iter()
            .filter_map(|(wall, at)| {
                let pixel = self.camera.project(at)?;
                let middle = self.extents.as_vec() / 2.0;
                if !self.room().is_free(at + (middle - at).normalize() * 0.05) {
                    return None;
                }
                self.camera.contains(pixel).then_some((wall, pixel, self.camera.depth(at)))
            })
            .max_by(|a, b| a.2.total_cmp(&b.2))
            .map(|(wall, pixel, _)| (wall, pixel))
    }
}

impl TruthObject {
    /// A canonical point in the room.
    pub fn point(&self, canonical: DVec3) -> DVec3 {
        self.position + DMat3::from_rotation_y(self.yaw) * canonical
    }

    /// Whether its yaw means something: it stands at a wall, faces something, or is of a kind with a front.
    pub fn has_front(&self) -> bool {
        self.facing.is_some() || self.wall.is_some() || harmony_catalogue::has_front(&self.label)
    }

    /// The box of some pixels, if any.
    pub fn bounds(&self, room: &TruthRoom) -> Option<PixelBox> {
        room.mask(self.index).bounds()
    }
}

fn opening(v: &Value, whole: &Extents, within: &Extents, origin: DVec3) -> Option<Opening> {
    let kind = match v["kind"].as_str()? {
        // One without an object.
        "door" | "passage" => OpeningKind::Door,
        "window" => OpeningKind::Window,
        _ => return None,
    };
    let n = |k: &str| v[k].as_f64();
    let wall = wall_named(v["wall"].as_str()?)?;
    // On a block's face the file gives the plane; else the opening is in the file's box, perhaps at a niche's bottom.
    let along = wall.coordinates(origin).x;
    let plane = n("plane").map_or_else(|| wall.point(whole, 0.0, 0.0), |at| wall.normal().abs() * at);
    Some(Opening {
        kind,
        wall,
        u: [n("u0")? - along, n("u1")? - along],
        y: [n("y0")?, n("y1")?],
        inset: wall.distance(within, plane - origin),
        rise: n("rise").unwrap_or(0.0),
        object: v["object"].as_str().and_then(|s| ObjectId::new(s).ok()),
    })
}

fn object(o: &Value, v: &[[f32; 3]], f: &[[u32; 3]]) -> Option<TruthObject> {
    let yaw = o["yaw_deg"].as_f64()?.to_radians();
    let mut mesh = Mesh {
        positions: v.iter().map(|p| glam::Vec3::from(*p)).collect(),
        uvs: vec![glam::Vec2::ZERO; v.len()],
        groups: vec![Group { material: 0, triangles: f.to_vec() }],
        materials: vec![Material::plain("grey", [0.5; 3])],
        normals: Vec::new(),
        metric_uvs: Vec::new(),
        colors: Vec::new(),
    };
    let bounds = mesh.bounds()?;
    let origin = DVec3::new(bounds.centre().x, bounds.min.y, bounds.centre().z);
    for p in &mut mesh.positions {
        *p -= origin.as_vec3();
    }
    mesh.recompute_normals();
    let text = |k: &str| o[k].as_str().map(str::to_owned);
    let support = match o["support"].as_str()? {
        "floor" => Support::Floor,
        "ceiling" => Support::Ceiling,
        other => match other.strip_prefix("wall_").and_then(wall_named) {
            Some(wall) => Support::Wall { wall },
            None => match niche_named(other) {
                Some(niche) => Support::Niche { niche },
                None => Support::Object { id: ObjectId::new(other).ok()? },
            },
        },
    };
    let facing = text("facing").filter(|f| f != "room");
    Some(TruthObject {
        id: text("id")?,
        index: o["index"].as_u64()? as u32,
        level: match o["level"].as_str()? {
            "wall" => Level::Wall,
            "ceiling" => Level::Ceiling,
            "decoration" => Level::Decoration,
            _ => Level::Furniture,
        },
        label: text("label")?.to_lowercase(),
        position: vec3(&o["position"])? + DMat3::from_rotation_y(yaw) * origin,
        yaw,
        size: bounds.size(),
        support,
        wall: o["wall_affinity"].as_str().and_then(wall_named),
        faces_room: o["facing"].as_str() == Some("room"),
        facing,
        group: text("group"),
        model: text("model").unwrap_or_default(),
        visible_pixels: o["visible_pixels"].as_u64()?,
        occluded: o["occluded_fraction"].as_f64().unwrap_or(0.0),
        truncated: o["truncated_fraction"].as_f64().unwrap_or(0.0),
        may_overlap: o["boxes_may_overlap"]
            .as_array()
            .map(|a| a.iter().filter_map(|v| v.as_str().map(str::to_owned)).collect())
            .unwrap_or_default(),
        mesh: Arc::new(mesh),
    })
}

type Arrays = BTreeMap<String, (Vec<[f32; 3]>, Vec<[u32; 3]>)>;

fn meshes(path: &Path) -> Result<Arrays, TruthError> {
    let arrays = harmony_io::npz::read_npz(path).map_err(|e| bad(path, e))?;
    let mut out = Arrays::new();
    for (name, vertices) in &arrays {
        let Some(id) = name.strip_suffix("/v") else { continue };
        let Some(faces) = arrays.get(&format!("{id}/f")) else { continue };
        let v: Vec<[f32; 3]> =
            vertices.values.chunks_exact(3).map(|c| [c[0] as f32, c[1] as f32, c[2] as f32]).collect();
        let f: Vec<[u32; 3]> = faces.values.chunks_exact(3).map(|c| [c[0] as u32, c[1] as u32, c[2] as u32]).collect();
        if f.iter().flatten().any(|i| *i as usize >= v.len()) {
            return Err(bad(path, format!("{id} has a triangle with an unknown vertex")));
        }
        out.insert(id.to_owned(), (v, f));
    }
    Ok(out)
}

/// Kinds of [`TruthLight`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TruthLightKind {
    /// A rectangle.
    Area,
    /// A bulb.
    Point,
    /// The sun.
    Sun,
}

/// A light of the room.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthLight {
    /// What it is.
    pub kind: TruthLightKind,
    /// Room frame, metres; zero for the sun.
    pub position: DVec3,
    /// Watts; W/m2 for the sun.
    pub power: f64,
    /// Linear RGB.
    pub color: DVec3,
    /// The object that it belongs to; `None` for the fill behind the camera and the sun.
    pub owner: Option<String>,
}

/// The lights of a room's `room.json`; none where there is no such file or list.
pub fn lights_of(folder: &Path) -> Vec<TruthLight> {
    let Ok(room) = json(&folder.join("room.json")) else { return Vec::new() };
    let one = |l: &Value| {
        let (kind, power) = match l["type"].as_str()? {
            "area" => (TruthLightKind::Area, "watts"),
            "point" => (TruthLightKind::Point, "watts"),
            "sun" => (TruthLightKind::Sun, "strength"),
            _ => return None,
        };
        Some(TruthLight {
            kind,
            position: vec3(&l["position"]).unwrap_or(DVec3::ZERO),
            power: l[power].as_f64()?,
            color: vec3(&l["color"]).unwrap_or(DVec3::ONE),
            owner: l["owner"].as_str().map(str::to_owned),
        })
    };
    room["lights"].as_array().into_iter().flatten().filter_map(one).collect()
}

/// All truth rooms of a folder (or the folder itself, when it is one), sorted by name.
///
/// # Errors
/// An unreadable folder, or one that holds no room.
pub fn rooms_in(folder: &Path) -> Result<Vec<PathBuf>, TruthError> {
    if folder.join("objects.json").is_file() {
        return Ok(vec![folder.to_owned()]);
    }
    let entries = std::fs::read_dir(folder).map_err(|source| TruthError::Read { path: folder.to_owned(), source })?;
    let mut rooms: Vec<PathBuf> =
        entries.filter_map(Result::ok).map(|e| e.path()).filter(|p| p.join("objects.json").is_file()).collect();
    rooms.sort();
    if rooms.is_empty() {
        return Err(bad(folder, "no room with truth is in it"));
    }
    Ok(rooms)
}
