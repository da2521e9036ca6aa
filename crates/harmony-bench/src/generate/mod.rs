//! Furnished rooms from a seed, in the format of the rooms with known truth.
//!
//! [`generate`] chooses a kind of room, furnishes it by rules (backs to walls, chairs at tables, things on tops),
//! drops whatever would cut into something else, finds a camera from which much is seen, and draws depth, ids and a
//! photo with light from windows and lamps. The same seed gives the same bytes. [`write`] writes the folder.
//!
//! The objects are made of lofts, surfaces of revolution, bent sheets and superellipsoids (`pieces`), never of the
//! part templates of `harmony-mesh`, so that a template fitted to them leaves a residual as it does on real furniture.

mod archive;
mod collide;
mod develop;
mod dice;
mod files;
mod form;
mod furnish;
mod layout;
mod light;
mod outline;
mod paint;
mod photos;
mod pictures;
mod pieces;
mod rooms;
mod shell;
mod solid;
mod truth;
mod view;
mod views;

use std::sync::Arc;

use glam::DVec3;
use harmony_catalogue::Trait;
use harmony_mesh::{Bounds, Mesh};
use harmony_render::{RenderOptions, render};
use harmony_scene::{Camera, Extents, ImageSize, RoomShape, Surface, Wall, WallPlane};
use image::RgbImage;

pub use files::{GenerateError, write};
pub use form::RoomFeature;
pub use layout::Level;
pub use light::{LightKind, RoomLight};
pub use photos::{MAX_PHOTOS, RoomPhoto, photographed};
pub use rooms::RoomKind;
pub use truth::{FloorCorner, SurfacePoints};
pub use views::GeneratedView;

use collide::Body;
use dice::Dice;
use form::Form;
use layout::{Facing, Item, Plan};
use paint::Palette;
use rooms::Decorator;

/// What the generator is asked for.
#[derive(Debug, Clone)]
pub struct GeneratorSettings {
    /// Kinds to choose from.
    pub kinds: Vec<RoomKind>,
    /// Size of the photo; without one 960 x 720, now and then 1024 x 683.
    pub image: Option<ImageSize>,
    /// Fewest objects.
    pub min_objects: usize,
    /// Most objects.
    pub max_objects: usize,
    /// Objects with more than about 500 pixels that the photo must show.
    pub min_seen: usize,
    /// Points on objects in `points.npz`.
    pub points: usize,
    /// Points on the shell in `points.npz`.
    pub shell_points: usize,
    /// Quality of the photo's JPEG, 1 to 100.
    pub jpeg_quality: u8,
    /// Whether the room is shown from two other places, too.
    pub views: bool,
    /// What a home around the room asks of it.
    pub fixed: Option<FixedRoom>,
    /// Features that make rooms other than boxes, to choose from; none makes boxes, as do homes.
    pub shapes: Vec<RoomFeature>,
}

/// A room whose size and doors are given, because it is one of a home.
#[derive(Debug, Clone)]
pub struct FixedRoom {
    /// Its size.
    pub extents: Extents,
    /// Its doors; every one is there, and the photo shows as many as it can.
    pub doors: Vec<FixedDoor>,
    /// Walls that may have windows: those with nothing behind them.
    pub outside: Vec<Wall>,
}

/// A door whose place is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixedDoor {
    /// In which wall.
    pub wall: Wall,
    /// Its middle along the wall, metres.
    pub u: f64,
    /// Its width with its frame, metres.
    pub width: f64,
    /// Its height with its frame, metres.
    pub height: f64,
}

impl Default for GeneratorSettings {
    fn default() -> Self {
        Self {
            kinds: RoomKind::ALL.to_vec(),
            image: None,
            min_objects: 5,
            max_objects: 30,
            min_seen: 5,
            points: 100_000,
            shell_points: 20_000,
            jpeg_quality: 92,
            views: true,
            fixed: None,
            shapes: Vec::new(),
        }
    }
}

/// An object of a room with all that is true of it.
#[derive(Debug, Clone)]
pub struct GeneratedObject {
    /// Name, numbered by label (`chair_02`).
    pub id: String,
    /// Its value in the id image, from 10 on.
    pub index: u8,
    /// Where it belongs.
    pub level: Level,
    /// What it is.
    pub label: &'static str,
    /// Canonical mesh: metres, +Y up, front +Z, origin at the bottom centre (at the centre on the level wall).
    pub mesh: Arc<Mesh>,
    /// Where the canonical origin is in the room.
    pub position: DVec3,
    /// About +Y, radians.
    pub yaw: f64,
    /// Width, height, depth before turning.
    pub size: DVec3,
    /// Axis-aligned box in the room.
    pub aabb: Bounds,
    /// `floor`, `ceiling`, `wall_back`, ..., or an object's name.
    pub support: String,
    /// The wall that its back is to.
    pub wall: Option<Wall>,
    /// Where the plane behind it is when that is not the wall of the box: x of a left or right wall, z of the others.
    pub wall_plane: Option<f64>,
    /// `room` or an object's name.
    pub facing: Option<String>,
    /// The set that it belongs to.
    pub group: Option<&'static str>,
    /// Kind and target: `on_top_of`, `tucked_under`.
    pub relations: Vec<(&'static str, String)>,
    /// Pixels in the id image.
    pub visible_pixels: usize,
    /// Hidden share of its silhouette inside the image; `None` when that is empty.
    pub occluded_fraction: Option<f64>,
    /// Share of its surface outside the image.
    pub truncated_fraction: f64,
    /// Objects whose boxes meet its box though the meshes do not cut each other.
    pub boxes_may_overlap: Vec<String>,
}

impl GeneratedObject {
    /// A point of the canonical frame in the room.
    pub fn to_room(&self, point: DVec3) -> DVec3 {
        layout::turn(self.yaw, point) + self.position
    }

    /// How far the meshes of two objects cut into each other, metres; from the corners and from points at 4,000 a
    /// square metre of both surfaces.
    pub fn penetration(&self, other: &Self) -> f64 {
        let body = |o: &'_ Self| (o.mesh.clone(), o.yaw, o.position);
        let (a, b) = (body(self), body(other));
        Body::new(&a.0, a.1, a.2, 4000.0).penetration(&Body::new(&b.0, b.1, b.2, 4000.0), 1.0)
    }
}

/// A window, a door or a passage in `room.json`.
#[derive(Debug, Clone)]
pub struct GeneratedOpening {
    /// A door or a passage, else a window.
    pub door: bool,
    /// In which wall.
    pub wall: Wall,
    /// Where its plane is when that is not the wall of the box, as [`GeneratedObject::wall_plane`].
    pub plane: Option<f64>,
    /// Along the wall.
    pub u: [f64; 2],
    /// Heights.
    pub y: [f64; 2],
    /// How far its top is rounded, metres.
    pub rise: f64,
    /// The object that fills it; a passage has none.
    pub object: Option<String>,
}

/// A furnished room, its photo and the truth.
#[derive(Debug, Clone)]
pub struct GeneratedRoom {
    /// `generated_000017`.
    pub name: String,
    /// What it is for.
    pub kind: RoomKind,
    /// Size.
    pub extents: Extents,
    /// What makes it other than its box.
    pub shape: RoomShape,
    /// The photo's camera.
    pub camera: Camera,
    /// Left positive, radians.
    pub camera_yaw: f64,
    /// Down positive, radians.
    pub camera_pitch: f64,
    /// Objects in order of their index.
    pub objects: Vec<GeneratedObject>,
    /// Windows and doors.
    pub openings: Vec<GeneratedOpening>,
    /// Lights of the photo.
    pub lights: Vec<RoomLight>,
    /// The back corners of the floor.
    pub corners: [FloorCorner; 2],
    /// Planar depth, metres, row-major; 0 = nothing.
    pub depth: Vec<f32>,
    /// Ids: 1 floor, 2 ceiling, 3 back, 4 right, 5 front, 6 left, 7 skirting, 9 ledges of niches, objects from 10 on.
    pub ids: Vec<u8>,
    /// The photo before JPEG.
    pub photo: RgbImage,
    /// Quality of the JPEG.
    pub jpeg_quality: u8,
    /// The room from where the photo was not taken, for judging alone.
    pub views: Vec<GeneratedView>,
    /// Points on the objects in view.
    pub points: SurfacePoints,
    /// Points on the shell.
    pub shell_points: SurfacePoints,
}

impl GeneratedRoom {
    /// Pixels of a face of the shell.
    pub fn surface_pixels(&self, surface: Surface) -> usize {
        let id = shell::surface_id(surface);
        self.ids.iter().map(|i| usize::from(*i == id)).sum()
    }
}

/// Pieces that cut deeper than this into others are left out, metres.
const MAX_CUT: f64 = 0.002;
/// Layouts tried until one shows enough.
const ATTEMPTS: u64 = 12;

/// Makes the room of a seed.
pub fn generate(seed: u64, settings: &GeneratorSettings) -> GeneratedRoom {
    draft(seed, settings).finish(seed, settings)
}

fn draft(seed: u64, settings: &GeneratorSettings) -> Draft {
    let mut best: Option<(usize, Draft)> = None;
    for attempt in 0..ATTEMPTS {
        let Some(draft) = Draft::new(&mut Dice::new(seed, attempt), settings, [seed, attempt]) else { continue };
        let doors = settings.fixed.as_ref().map_or(0, |f| f.doors.iter().filter(|d| d.wall != Wall::Front).count());
        let enough = draft.view.seen >= settings.min_seen
            && draft.plan.items.len() >= settings.min_objects
            && draft.view.doors >= doors
            && draft.view.features == draft.plan.form.marks.len()
            && (settings.shapes.is_empty() || settings.fixed.is_some() || draft.view.features > 0);
        // A door in view is worth more than any furniture.
        let worth = draft.view.seen + 10 * draft.view.features + if doors > 0 { 100 * draft.view.doors } else { 0 };
        if enough || best.as_ref().is_none_or(|(most, _)| worth > *most) {
            best = Some((worth, draft));
        }
        if enough {
            break;
        }
    }
    best.map_or_else(|| Draft::empty(&mut Dice::new(seed, ATTEMPTS), settings), |(_, draft)| draft)
}

/// A room before its photo.
#[derive(Clone)]
struct Draft {
    kind: RoomKind,
    palette: Palette,
    plan: Plan,
    shell: Vec<(u8, Mesh)>,
    view: view::View,
    dice: Dice,
}

impl Draft {
    fn new(dice: &mut Dice, settings: &GeneratorSettings, [seed, attempt]: [u64; 2]) -> Option<Self> {
        let kind = if settings.kinds.is_empty() { RoomKind::LivingRoom } else { dice.pick(&settings.kinds) };
        let [low, high] = kind.sizes();
        let round = |v: f64| (v * 100.0).round() / 100.0;
        let extents = Extents {
            width: round(dice.range(low, high)),
            height: round(dice.range(2.3, 3.2)),
            depth: round(dice.range(low.max(3.0), high.max(3.6))),
        };
        // Now and then a wide room, of which a long lens sees one wall.
        let wide = dice.chance(0.12) && high > 4.0;
        let extents =
            if wide { Extents { width: high, depth: round(dice.range(3.0, 3.4)), ..extents } } else { extents };
        let fixed = settings.fixed.as_ref();
        let extents = fixed.map_or(extents, |f| f.extents);
        let palette = Palette::new(dice);
        let shapes = if fixed.is_some() { &[][..] } else { &settings.shapes };
        let plan = Plan::new(extents, form::draw(seed, attempt, shapes, &extents));
        let mut decorator = Decorator { dice, palette: &palette, plan, fixed };
        decorator.furnish(kind);
        let mut plan = decorator.plan;
        drop_cutting(&mut plan, settings.max_objects);
        let doors = plan.holes.iter().filter(|h| h.door).count();
        if fixed.is_some_and(|f| doors < f.doors.len()) {
            return None;
        }
        Self::photographed(dice, settings, kind, palette, plan)
    }

    /// A room without furniture, should nothing else come out.
    fn empty(dice: &mut Dice, settings: &GeneratorSettings) -> Self {
        let usual = Extents { width: 4.0, height: 2.6, depth: 4.5 };
        let extents = settings.fixed.as_ref().map_or(usual, |f| f.extents);
        let palette = Palette::new(dice);
        Self::photographed(dice, settings, RoomKind::LivingRoom, palette, Plan::new(extents, Form::default()))
            .expect("nothing is in the way of a camera in an empty room")
    }

    fn photographed(
        dice: &mut Dice,
        settings: &GeneratorSettings,
        kind: RoomKind,
        palette: Palette,
        plan: Plan,
    ) -> Option<Self> {
        let shell = shell::shell(dice, &palette, &plan, kind == RoomKind::Bathroom);
        let usual = if dice.chance(0.25) { ImageSize::new(1024, 683) } else { ImageSize::new(960, 720) };
        let size = settings.image.unwrap_or(usual);
        let view = view::choose(dice, &plan, size, &view::instances(&shell, &plan), settings.fixed.is_some())?;
        Some(Self { kind, palette, plan, shell, view, dice: dice.clone() })
    }

    fn finish(mut self, seed: u64, settings: &GeneratorSettings) -> GeneratedRoom {
        let (plan, camera) = (&self.plan, self.view.camera);
        let dice = &mut self.dice;
        let instances = view::instances(&self.shell, plan);
        let frame = flat(&camera, &instances);
        let lights = light::lights(dice, plan);
        let all = light::merged(&instances, |_, _| true);
        let blockers = light::merged(&instances, |i, m| i.id >= 10 && m.emissive == [0.0; 3]);
        let mut colors = [glam::Vec3::splat(0.6); 7];
        let linear = |c: [u8; 3]| glam::Vec3::from_array(harmony_mesh::linear_rgb(c));
        colors[1] = mean_color(&self.shell[0].1);
        for id in [4, 5, 6] {
            colors[id] = linear(self.palette.walls[0]);
        }
        colors[3] = linear(self.palette.walls[1]);
        let lit = light::Lit { room: plan.room.faces(), lights: &lights, colors, all: &all, blockers: &blockers };
        let (photo, exposure) = light::photo(dice, &camera, &frame, &lit, None);
        let views =
            if settings.views { views::shown(seed, plan, &camera, &instances, &lit, exposure) } else { Vec::new() };
        let seen = truth::seen(&camera, &instances, &frame);
        let is_box = plan.form.shape.is_box();
        let solids = light::merged(&instances, |i, _| i.id >= 10 || !is_box);
        let corners = truth::corners(&camera, &plan.extents, &solids);
        let names = names(plan);
        GeneratedRoom {
            name: format!("generated_{seed:06}"),
            kind: self.kind,
            extents: plan.extents,
            shape: plan.form.shape.clone(),
            camera,
            camera_yaw: self.view.yaw,
            camera_pitch: self.view.pitch,
            objects: objects(plan, &names, &seen),
            openings: openings(plan, &names),
            lights,
            corners,
            depth: frame.depth,
            ids: bytes(&frame.ids),
            photo,
            jpeg_quality: settings.jpeg_quality,
            views,
            points: truth::object_points(dice, &instances, &seen, settings.points),
            shell_points: truth::shell_points(dice, plan, settings.shell_points),
        }
    }
}

/// The room's own colours, before light.
fn flat(camera: &Camera, instances: &[harmony_render::Instance<'_>]) -> harmony_render::Frame {
    let options = RenderOptions { multisample: true, background: [120, 140, 160, 255], ..RenderOptions::default() };
    render(camera, instances, &options)
}

fn bytes(ids: &[u32]) -> Vec<u8> {
    ids.iter().map(|id| u8::try_from(*id).unwrap_or(u8::MAX)).collect()
}

fn mean_color(mesh: &Mesh) -> glam::Vec3 {
    let Some(texture) = mesh.materials.first().and_then(|m| m.texture.as_ref()) else { return glam::Vec3::splat(0.4) };
    let picks: Vec<glam::Vec3> = texture
        .pixels()
        .step_by(997)
        .map(|p| glam::Vec3::from_array(harmony_mesh::linear_rgb([p[0], p[1], p[2]])))
        .collect();
    picks.iter().sum::<glam::Vec3>() / picks.len().max(1) as f32
}

fn is_rug(item: &Item) -> bool {
    harmony_catalogue::has(item.piece.label, Trait::Flat)
}

/// Leaves out what cuts into something placed before it, what stands on nothing any more, and what is too many.
fn drop_cutting(plan: &mut Plan, most: usize) {
    let bodies: Vec<Body> = plan.items.iter().map(|i| Body::new(&i.piece.mesh, i.yaw, i.position, 1200.0)).collect();
    let mut keep: Vec<bool> = Vec::with_capacity(bodies.len());
    for (k, item) in plan.items.iter().enumerate() {
        let hosted = item.host.is_none_or(|h| keep[h]);
        let cuts = (0..k).any(|j| {
            keep[j] && !is_rug(item) && !is_rug(&plan.items[j]) && bodies[k].penetration(&bodies[j], MAX_CUT) > MAX_CUT
        });
        let many = keep.iter().filter(|k| **k).count() >= most;
        keep.push(hosted && !cuts && !many);
    }
    drop(bodies);
    let mut number = vec![None; keep.len()];
    let kept: Vec<usize> = (0..keep.len()).filter(|k| keep[*k]).collect();
    for (new, old) in kept.iter().enumerate() {
        number[*old] = Some(new);
    }
    plan.items = kept
        .iter()
        .map(|k| {
            let mut item = plan.items[*k].clone();
            item.host = item.host.and_then(|h| number[h]);
            item.tucked = item.tucked.and_then(|h| number[h]);
            if let Facing::Object(o) = item.facing {
                item.facing = number[o].map_or(Facing::Nothing, Facing::Object);
            }
            item
        })
        .collect();
    plan.holes.retain(|h| keep[h.item]);
    for hole in &mut plan.holes {
        hole.item = number[hole.item].unwrap_or(0);
    }
}

/// `chair_01`, `chair_02`, ... in order.
fn names(plan: &Plan) -> Vec<String> {
    (0..plan.items.len())
        .map(|k| {
            let label = plan.items[k].piece.label;
            let count = plan.items[..=k].iter().filter(|i| i.piece.label == label).count();
            format!("{}_{count:02}", label.replace(' ', "_"))
        })
        .collect()
}

/// Where a plane before a wall of the box is: x or z.
fn place_of(plane: WallPlane, extents: &Extents) -> Option<f64> {
    let at = plane.point(extents, 0.0, 0.0) * plane.normal().abs();
    (plane.inset.abs() > 1e-6).then_some(at.x + at.z)
}

fn openings(plan: &Plan, names: &[String]) -> Vec<GeneratedOpening> {
    let one = |h: &layout::Hole| GeneratedOpening {
        door: h.door,
        wall: h.wall,
        plane: place_of(h.plane(), &plan.extents),
        u: h.u,
        y: h.y,
        rise: 0.0,
        object: Some(names[h.item].clone()),
    };
    let passage = |o: &harmony_scene::Opening| GeneratedOpening {
        door: true,
        wall: o.wall,
        plane: None,
        u: o.u,
        y: o.y,
        rise: o.rise,
        object: None,
    };
    plan.holes.iter().map(one).chain(plan.form.passages.iter().map(passage)).collect()
}

fn objects(plan: &Plan, names: &[String], seen: &[truth::Seen]) -> Vec<GeneratedObject> {
    let bodies: Vec<Body> = plan.items.iter().map(|i| Body::new(&i.piece.mesh, i.yaw, i.position, 0.0)).collect();
    let one = |k: usize, item: &Item| {
        let meets =
            |j: &usize| *j != k && !is_rug(item) && !is_rug(&plan.items[*j]) && bodies[k].boxes_meet(&bodies[*j], 1e-3);
        let mut overlaps: Vec<String> = (0..bodies.len()).filter(meets).map(|j| names[j].clone()).collect();
        overlaps.sort();
        let mut relations = Vec::new();
        if let Some(host) = item.host {
            relations.push(("on_top_of", names[host].clone()));
        }
        if let Some(table) = item.tucked {
            relations.push(("tucked_under", names[table].clone()));
        }
        let support = match (item.host, item.level, item.wall) {
            (Some(host), ..) => names[host].clone(),
            (None, Level::Ceiling, _) => "ceiling".to_owned(),
            (None, Level::Wall, Some(wall)) => format!("wall_{}", wall.surface().name()),
            _ => "floor".to_owned(),
        };
        GeneratedObject {
            id: names[k].clone(),
            index: u8::try_from(k + 10).unwrap_or(u8::MAX),
            level: item.level,
            label: item.piece.label,
            mesh: Arc::new(item.piece.mesh.clone()),
            position: item.position,
            yaw: item.yaw,
            size: item.piece.size,
            aabb: bodies[k].bounds(),
            support,
            wall: item.wall,
            wall_plane: item.wall.and_then(|wall| place_of(WallPlane { wall, inset: item.inset }, &plan.extents)),
            facing: match item.facing {
                Facing::Nothing => None,
                Facing::Room => Some("room".to_owned()),
                Facing::Object(o) => Some(names[o].clone()),
            },
            group: item.group,
            relations,
            visible_pixels: seen[k].visible_pixels,
            occluded_fraction: seen[k].occluded_fraction,
            truncated_fraction: seen[k].truncated_fraction,
            boxes_may_overlap: overlaps,
        }
    };
    plan.items.iter().enumerate().map(|(k, item)| one(k, item)).collect()
}
