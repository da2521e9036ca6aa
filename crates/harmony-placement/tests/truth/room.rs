//! Reads a room with known truth and turns it into what placement is given.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use harmony_catalogue::Trait;
use harmony_mesh::{Group, Material, Mesh, convex_parts};
use harmony_placement::{Item, PartialScene, Placed, RoomPoints, Shape, Traits, YawHint};
use harmony_scene::{
    Camera, Extents, ImageSize, Intrinsics, Level, Mask, Mat3, ObjectId, Placement, PointMap, PointMapKind, Relations,
    Room, Similarity, Size, Vec2, Vec3, WallAffinity,
};
use serde_json::Value;

/// Thickness of a planar item's mesh, as the pipeline makes slabs, metres.
const SLAB: f64 = 0.03;

/// Objects with fewer visible pixels are not asked for.
const FEWEST_PIXELS: u64 = 200;

/// How far what is given is off.
#[derive(Debug, Clone, Copy, Default)]
pub struct Noise {
    /// Largest relative error of a side of the prior size.
    pub size: f64,
    /// Largest relative error of a side of the mesh: its proportions are wrong.
    pub mesh: f64,
    /// Whether placement may correct proportions.
    pub may_stretch: bool,
    /// Masks are grown or shrunk by up to this many pixels.
    pub mask_px: f64,
    /// Pitch error of the camera, radians.
    pub pitch: f64,
    /// Relative error of its focal length.
    pub focal: f64,
    /// Relative error of the depths.
    pub depth: f64,
    /// Seed.
    pub seed: u64,
}

/// An object as it is.
pub struct Truth {
    id: String,
    index: u32,
    level: Level,
    label: String,
    /// Bottom centre.
    position: Vec3,
    yaw: f64,
    size: Vec3,
    relations: Relations,
    planar: bool,
    /// Whether the yaw of this object means something.
    pub yaw_counts: bool,
    mesh: Arc<Mesh>,
}

/// Difference of a placed object to the truth.
pub struct Difference {
    /// Placed minus true bottom centre, metres.
    pub offset: Vec3,
    /// Mean absolute `ln` of the sides' ratios (the two large ones of a slab).
    pub size: f64,
    /// Degrees.
    pub yaw_deg: f64,
}

/// One room.
pub struct GtRoom {
    camera: Camera,
    room: Room,
    objects: Vec<Truth>,
    ids: Vec<u8>,
    depth: Vec<f32>,
}

/// Names of all rooms, sorted; `None` when there are none here.
pub fn names() -> Option<Vec<String>> {
    let mut names: Vec<String> = std::fs::read_dir(harmony_testing::shared("gt")?)
        .ok()?
        .filter_map(Result::ok)
        .filter(|e| e.path().is_dir())
        .map(|e| e.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    (!names.is_empty()).then_some(names)
}

fn json(path: PathBuf) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn vec3(v: &Value) -> Vec3 {
    Vec3::new(v[0].as_f64().unwrap(), v[1].as_f64().unwrap(), v[2].as_f64().unwrap())
}

fn mat3(v: &Value) -> Mat3 {
    Mat3::from_cols(vec3(&v[0]), vec3(&v[1]), vec3(&v[2])).transpose()
}

fn object_id(v: &Value) -> Option<ObjectId> {
    v.as_str().and_then(|s| ObjectId::new(s).ok())
}

fn affinity(v: &Value) -> WallAffinity {
    match v.as_str() {
        Some("back") => WallAffinity::Back,
        Some("left") => WallAffinity::Left,
        Some("right") => WallAffinity::Right,
        Some("front") => WallAffinity::Front,
        _ => WallAffinity::Centre,
    }
}

/// Uniform in [-1, 1] from a seed and a name: the same on every machine.
fn noise(seed: u64, name: &str, salt: u64) -> f64 {
    let mut h = 0xcbf2_9ce4_8422_2325_u64 ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ salt.wrapping_mul(0x2545_f491);
    for b in name.bytes() {
        h = (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3);
    }
    h ^= h >> 29;
    h = h.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h ^= h >> 32;
    (h >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

impl GtRoom {
    /// Loads a room by its folder's name; `None` when it isn't there.
    pub fn load(name: &str) -> Option<Self> {
        let dir = harmony_testing::shared(&format!("gt/{name}"))?;
        let c = json(dir.join("camera.json"));
        let size = ImageSize::new(c["width"].as_u64()? as u32, c["height"].as_u64()? as u32);
        let k = mat3(&c["K"]);
        let camera = Camera {
            size,
            intrinsics: Intrinsics { fx: k.x_axis.x, fy: k.y_axis.y, cx: k.z_axis.x, cy: k.z_axis.y },
            rotation: mat3(&c["R"]),
            translation: vec3(&c["t"]),
        };
        let r = json(dir.join("room.json"));
        let number = |k: &str| r[k].as_f64().unwrap();
        let room = Room {
            room_type: name.to_owned(),
            extents: Extents { width: number("W"), height: number("H"), depth: number("D") },
            shape: harmony_scene::RoomShape::default(),
            seen: Vec::new(),
            openings: Vec::new(),
            floor_texture: None,
            wall_texture: None,
        };
        let meshes = meshes(&dir.join("meshes.npz"));
        let mut objects = Vec::new();
        for o in json(dir.join("objects.json"))["objects"].as_array()? {
            let id = o["id"].as_str()?;
            if o["visible_pixels"].as_u64().unwrap_or(0) < FEWEST_PIXELS {
                continue;
            }
            let Some((v, f)) = meshes.get(id) else { continue };
            objects.push(truth(o, v, f));
        }
        let ids = image::open(dir.join("instances.png")).unwrap().into_luma8().into_raw();
        let depth = image::open(dir.join("depth.png")).unwrap().into_luma16();
        let depth = depth.into_raw().into_iter().map(|mm| f32::from(mm) / 1000.0).collect();
        Some(Self { camera, room, objects, ids, depth })
    }

    /// The empty scene with the point map of a kind.
    pub fn scene(&self, kind: Option<PointMapKind>, noise_of: &Noise) -> PartialScene {
        let mut camera = self.camera;
        camera.intrinsics.fx *= 1.0 + noise_of.focal;
        camera.intrinsics.fy *= 1.0 + noise_of.focal;
        camera.rotation = Mat3::from_rotation_x(noise_of.pitch) * camera.rotation;
        camera.translation = -(camera.rotation * self.camera.centre());
        let points = kind.map(|kind| {
            let depth: Vec<f32> = self.depth.iter().map(|z| z * (1.0 + noise_of.depth) as f32).collect();
            let map = PointMap::from_depth(kind, camera.size, camera.intrinsics, &depth);
            let rotation = camera.rotation.transpose();
            let room_from_points = Similarity { scale: 1.0, rotation, translation: camera.centre() };
            RoomPoints::new(&map, &room_from_points)
        });
        PartialScene::new(self.room.clone(), camera, points, None)
    }

    fn mask(&self, index: u32) -> Mask {
        let w = self.camera.size.width as usize;
        Mask::from_fn(self.camera.size, |x, y| u32::from(self.ids[y as usize * w + x as usize]) == index)
    }

    /// What placement is given for a level.
    pub fn items(&self, level: Level, noise_of: &Noise) -> Vec<Item> {
        self.objects
            .iter()
            .filter(|o| o.level == level)
            .map(|o| {
                let side = |i: usize| 1.0 + noise_of.size * noise(noise_of.seed, &o.id, i as u64);
                let size = o.size * Vec3::new(side(0), side(1), side(2));
                let related = o.relations.facing_toward.is_some() || o.relations.wall_affinity != WallAffinity::Centre;
                let turns = o.yaw_counts && !related;
                // What a model that picks one of four panels can know.
                let quarter = std::f64::consts::FRAC_PI_2;
                let yaw = if turns { YawHint::About((o.yaw / quarter).round() * quarter) } else { YawHint::Unknown };
                let grow = (noise_of.mask_px * noise(noise_of.seed, &o.id, 11)).round() as i32;
                let wrong = |i: u64| 1.0 + noise_of.mesh * noise(noise_of.seed, &o.id, 20 + i);
                let mut mesh = Arc::clone(&o.mesh);
                let by = glam::DVec3::new(wrong(0), wrong(1), wrong(2));
                if noise_of.mesh > 0.0 {
                    Arc::make_mut(&mut mesh).map(|p| p * by.as_vec3(), |n| n / by.as_vec3());
                }
                let scaled = |hull: &Vec<Vec3>| hull.iter().map(|p| *p * by).collect();
                let hulls = o.hulls(&self.room.room_type).iter().map(scaled).collect();
                Item {
                    id: ObjectId::new(&o.id).unwrap(),
                    index: o.index,
                    level: o.level,
                    label: o.label.clone(),
                    shape: Arc::new(Shape::new(Arc::clone(&mesh), hulls)),
                    size: Size::from_vec(size),
                    mask: self.mask(o.index).dilated(grow).into(),
                    relations: o.relations.clone(),
                    placement: Placement::default(),
                    host_candidates: Vec::new(),
                    traits: Traits {
                        flat: o.label == "rug",
                        soft: o.label.contains("teddy"),
                        planar: o.planar,
                        lit_from_above: harmony_catalogue::has(&o.label, Trait::LitFromAbove),
                        hangs: o.level == Level::Ceiling || o.label.contains("curtain"),
                        may_stretch: noise_of.may_stretch,
                        ..Traits::default()
                    },
                    yaw,
                    detection: None,
                }
            })
            .collect()
    }

    /// The truth about an object.
    pub fn truth(&self, id: &str) -> Option<&Truth> {
        self.objects.iter().find(|o| o.id == id)
    }
}

type Hulls = Arc<Vec<Vec<Vec3>>>;

/// Convex parts by room and object: the decomposition takes longer than the placement.
static HULLS: Mutex<BTreeMap<(String, String), Hulls>> = Mutex::new(BTreeMap::new());

impl Truth {
    fn hulls(&self, room: &str) -> Hulls {
        let key = (room.to_owned(), self.id.clone());
        if let Some(known) = HULLS.lock().unwrap().get(&key) {
            return Arc::clone(known);
        }
        let size = self.mesh.bounds().map_or(1.0, |b| b.size().max_element());
        let parts = convex_parts(&self.mesh, size);
        let hulls: Hulls = Arc::new(parts.iter().map(|p| p.points.iter().map(|q| q.as_dvec3()).collect()).collect());
        HULLS.lock().unwrap().insert(key, Arc::clone(&hulls));
        hulls
    }

    /// How a placed object differs.
    pub fn compare(&self, placed: &Placed) -> Difference {
        let sides = placed.size().as_vec() / self.size;
        let counted = if self.planar { 2 } else { 3 };
        let size = (0..counted).map(|i| sides[i].ln().abs()).sum::<f64>() / f64::from(counted as u32);
        let mut offset = placed.pose.position - self.position;
        if self.planar {
            // How deep a window sits in its wall is not what is judged here.
            let normal = Vec3::new(self.yaw.sin(), 0.0, self.yaw.cos());
            offset -= normal * offset.dot(normal);
        }
        let turn = (placed.pose.yaw - self.yaw).rem_euclid(std::f64::consts::TAU);
        let turn = turn.min(std::f64::consts::TAU - turn);
        Difference { offset, size, yaw_deg: turn.to_degrees() }
    }
}

type Arrays = BTreeMap<String, (Vec<[f32; 3]>, Vec<[u32; 3]>)>;

fn meshes(path: &std::path::Path) -> Arrays {
    let mut npz = npyz::npz::NpzArchive::open(path).unwrap();
    let names: Vec<String> = npz.array_names().map(str::to_owned).collect();
    let mut out = Arrays::new();
    for name in names {
        let Some(id) = name.strip_suffix("/v") else { continue };
        let v: Vec<f32> = npz.by_name(&name).unwrap().unwrap().into_vec().unwrap();
        let f: Vec<u32> = npz.by_name(&format!("{id}/f")).unwrap().unwrap().into_vec().unwrap();
        let v = v.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        let f = f.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        out.insert(id.to_owned(), (v, f));
    }
    out
}

/// Reads one object and brings its mesh into the canonical frame (bottom at y = 0, centred).
fn truth(o: &Value, v: &[[f32; 3]], f: &[[u32; 3]]) -> Truth {
    let label = o["label"].as_str().unwrap().to_lowercase();
    let level = match o["level"].as_str().unwrap() {
        "wall" => Level::Wall,
        "ceiling" => Level::Ceiling,
        "decoration" => Level::Decoration,
        _ => Level::Furniture,
    };
    let planar = level == Level::Wall && ["window", "door", "painting", "mirror"].iter().any(|w| label.contains(w));
    let yaw = o["yaw_deg"].as_f64().unwrap().to_radians();
    let mut mesh = Mesh {
        metric_uvs: Vec::new(),
        colors: Vec::new(),
        positions: v.iter().map(|p| glam::Vec3::from(*p)).collect(),
        uvs: vec![Vec2::ZERO.as_vec2(); v.len()],
        groups: vec![Group { material: 0, triangles: f.to_vec() }],
        materials: vec![Material::plain("grey", [0.5; 3])],
        normals: Vec::new(),
    };
    mesh.recompute_normals();
    let b = mesh.bounds().unwrap();
    let origin = Vec3::new(b.centre().x, b.min.y, b.centre().z);
    for p in &mut mesh.positions {
        *p -= origin.as_vec3();
        if planar {
            p.z *= (SLAB / b.size().z) as f32;
        }
    }
    let position = vec3(&o["position"]) + Mat3::from_rotation_y(yaw) * origin;
    let mut size = b.size();
    if planar {
        size.z = SLAB;
    }
    let wall_affinity = affinity(&o["wall_affinity"]);
    let facing_toward = object_id(&o["facing"]).filter(|f| f.as_str() != "room");
    let on_top_of = object_id(&o["support"])
        .filter(|s| s.as_str() != "floor" && s.as_str() != "ceiling" && !s.as_str().starts_with("wall_left"))
        .filter(|s| !["wall_back", "wall_right", "wall_front"].contains(&s.as_str()));
    let has_front = ["monitor", "laptop", "frame", "tv", "coffee"].iter().any(|w| label.contains(w));
    let yaw_counts = facing_toward.is_some()
        || wall_affinity != WallAffinity::Centre
        || has_front
        || ["sofa", "chair", "bed", "desk"].iter().any(|w| label.contains(w));
    // Tables are the same from two sides.
    let yaw_counts = yaw_counts && !label.contains("table");
    Truth {
        id: o["id"].as_str().unwrap().to_owned(),
        index: o["index"].as_u64().unwrap() as u32,
        level,
        label,
        position,
        yaw,
        size,
        relations: Relations {
            wall_affinity,
            on_top_of,
            facing_toward,
            group: o["group"].as_str().map(str::to_owned),
            ..Relations::default()
        },
        planar,
        yaw_counts,
        mesh: Arc::new(mesh),
    }
}
