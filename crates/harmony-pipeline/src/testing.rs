//! A small scene of boxes, and what a phase needs to run offline, for the tests of this crate.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use glam::DVec3;
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls};
use harmony_mesh::{Group, Material, Mesh};
use harmony_placement::{Evidence, Item, PartialScene, Placed, Shape, Traits, YawHint};
use harmony_players::offline_cast;
use harmony_prompts::LayoutAnswer;
use harmony_render::{Instance, RenderOptions, render_depth_ids};
use harmony_roles::Detection;
use harmony_scene::{
    Camera, Extents, ImageSize, Intrinsics, Level, Mask, ObjectId, PixelBox, Placement, Pose, Relations, Room, Size,
    Support,
};
use image::{Rgb, RgbImage};
use serde_json::Value;

use crate::ctx::{PhaseCtx, Warnings};
use crate::progress::{ProgressEvent, ProgressSink};
use crate::state::{Layout, Look, Model, Object, SceneState, ToldLight};
use crate::views::Gallery;
use crate::{Phase, Settings};

/// A run folder, the offline players, and all that is told.
pub struct Desk {
    /// The run folder.
    pub run: tempfile::TempDir,
    /// Calls, recorded in the run folder.
    pub calls: Calls,
    /// Settings.
    pub settings: Settings,
    /// Warnings.
    pub warnings: Warnings,
    /// Progress, in order.
    pub events: Arc<Mutex<Vec<ProgressEvent>>>,
    /// Collects them.
    pub progress: ProgressSink,
}

impl Desk {
    /// An empty run folder.
    pub fn new() -> Self {
        Self::at(tempfile::tempdir().unwrap())
    }

    /// The program started again on a run folder.
    pub fn at(run: tempfile::TempDir) -> Self {
        let book = Arc::new(CallBook::open(run.path(), BookOptions::default()).unwrap());
        let events: Arc<Mutex<Vec<ProgressEvent>>> = Arc::default();
        let all = Arc::clone(&events);
        Self {
            run,
            calls: Calls::new(book, offline_cast(), offline_cast(), CallOptions::default()),
            settings: Settings::default(),
            warnings: Warnings::default(),
            events,
            progress: Arc::new(move |event| all.lock().unwrap().push(event)),
        }
    }

    /// What a phase is given; there is no path tracer.
    pub fn ctx(&self, phase: Phase) -> PhaseCtx<'_> {
        PhaseCtx {
            run: self.run.path(),
            phase,
            within: None,
            calls: &self.calls,
            path_tracer: false,
            settings: &self.settings,
            warnings: &self.warnings,
            progress: &self.progress,
        }
    }

    /// A JSON file of the run folder.
    pub fn json(&self, path: &str) -> Value {
        serde_json::from_slice(&std::fs::read(self.run.path().join(path)).unwrap()).unwrap()
    }
}

/// A photo of a back wall and a floor, 256 pixels wide.
pub fn photo() -> harmony_io::Photo {
    let image = RgbImage::from_fn(256, 192, |_, y| if y < 110 { Rgb([220, 215, 205]) } else { Rgb([120, 90, 70]) });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    harmony_io::Photo {
        image,
        bytes: bytes.into_inner(),
        extension: "png",
        original_size: ImageSize::new(256, 192),
        orientation: 1,
        focal_px: None,
        focal_source: None,
        warnings: Vec::new(),
    }
}

/// An empty room of 4 x 2.5 x 5 metres in a grey photo.
pub fn empty_room() -> SceneState {
    let size = ImageSize::new(320, 240);
    let camera = Camera::looking(
        size,
        Intrinsics::from_horizontal_fov(size, 1.25),
        DVec3::new(2.2, 1.5, 4.8),
        DVec3::new(-0.05, -0.2, -1.0),
    );
    let room = Room {
        room_type: "test".to_owned(),
        extents: Extents { width: 4.0, height: 2.5, depth: 5.0 },
        shape: harmony_scene::RoomShape::default(),
        seen: Vec::new(),
        openings: Vec::new(),
        floor_texture: None,
        wall_texture: None,
    };
    SceneState {
        photo: Arc::new(RgbImage::from_pixel(size.width, size.height, Rgb([128; 3]))),
        photo_frame: Arc::new(Mask::empty(size)),
        layout: Layout {
            answer: LayoutAnswer { walls: Vec::new(), ..LayoutAnswer::example() },
            evidence: Value::Null,
            method: "made up".to_owned(),
            confidence: Some(1.0),
            because: String::new(),
        },
        partial: PartialScene::new(room, camera, None, None),
        objects: BTreeMap::new(),
        surfaces: BTreeMap::new(),
        edited: crate::steps::surfaces::EditedRoom::default(),
        even_surfaces: BTreeMap::new(),
        roughness: BTreeMap::new(),
        beyond: Vec::new(),
        refused: Vec::new(),
        trims: harmony_mesh::Trims::default(),
        features: Vec::new(),
        rejected: Vec::new(),
        left: Vec::new(),
        looks: Vec::new(),
        summaries: Vec::new(),
        lighting: None,
        told_light: ToldLight::default(),
        unseen_openings: Vec::new(),
        next_index: 10,
        drawn: Gallery::default(),
    }
}

/// A closed box: bottom at y = 0, centred in x and z.
fn box_mesh(size: DVec3) -> Mesh {
    let h = (size / 2.0).as_vec3();
    let mut mesh = Mesh { materials: vec![Material::plain("box", [0.5; 3])], ..Mesh::default() };
    for i in 0..8_u32 {
        let pick = |bit: u32, v: f32| if i & bit == 0 { -v } else { v };
        mesh.positions.push(glam::Vec3::new(pick(1, h.x), pick(2, h.y) + h.y, pick(4, h.z)));
        mesh.uvs.push(glam::Vec2::ZERO);
    }
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|q: &[u32; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    mesh.groups.push(Group { material: 0, triangles });
    mesh.recompute_normals();
    mesh
}

/// Adds a box that stands where it is seen, alone in the picture; the name's number makes its label.
pub fn add(state: &mut SceneState, name: &str, level: Level, size: DVec3, at: DVec3, on: Support) -> ObjectId {
    let id = ObjectId::new(name).unwrap();
    let label = name.rsplit_once('_').map_or(name, |(label, _)| label).replace('_', " ");
    let mesh = Arc::new(box_mesh(size));
    let shape = Arc::new(Shape::from_parts(Arc::clone(&mesh), None, size.max_element()));
    let pose = Pose::new(at, 0.0, 1.0);
    let index = state.next_index;
    state.next_index += 1;
    let seen =
        render_depth_ids(&state.partial.camera, &[Instance::posed(&mesh, &pose, index)], &RenderOptions::default());
    let camera = state.partial.camera.size;
    let mask = Mask::from_fn(camera, |x, y| seen.ids[(y * camera.width + x) as usize] == index);
    let bounds = mask.bounds().unwrap_or(PixelBox { x0: 0.0, y0: 0.0, x1: 1.0, y1: 1.0 });
    let detection = Detection { label: label.clone(), phrase: label.clone(), bounds, score: None, outline: None };
    let mut object = Object::found(id.clone(), level, detection, mask);
    object.index = index;
    object.model = Some(Model {
        mesh,
        shape: Arc::clone(&shape),
        part_model: None,
        program: None,
        plain_slots: Vec::new(),
        said_slots: Vec::new(),
        bulb: None,
        moves: false,
        source: "a box".to_owned(),
        material: harmony_lighting::material_for(&label, Size::from_vec(size), None).0,
    });
    object.look = Look::default();
    let item = Item {
        id: id.clone(),
        index,
        level,
        label,
        shape,
        size: Size::from_vec(size),
        mask: Arc::clone(&object.mask),
        relations: Relations::default(),
        placement: Placement::default(),
        host_candidates: Vec::new(),
        traits: Traits::default(),
        yaw: YawHint::Unknown,
        detection: None,
    };
    let evidence = Evidence { silhouette_iou: Some(0.9), ..Evidence::default() };
    state.partial.placed.push(Placed { item: Arc::new(item), pose, support: on, evidence });
    state.objects.insert(id.clone(), object);
    id
}

/// Changes what is said of a placed object.
pub fn said(state: &mut SceneState, id: &ObjectId, change: impl Fn(&mut Item)) {
    let i = state.partial.position(id).unwrap();
    let mut item = (*state.partial.placed[i].item).clone();
    change(&mut item);
    state.partial.placed[i].item = Arc::new(item);
}
