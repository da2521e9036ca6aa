//! The folder of a home.
//!
//! `scene.json` and `scene_full.glb` are those of a run whose room is the whole home, so that every command that reads runs
//! reads homes.

use std::path::Path;

use glam::DVec3;
use harmony_export::World;
use harmony_io::glb::AMBIENT_GLOW;
use harmony_io::{GlbNode, GlbScene, NodeTransform, TextureEncoding, glb_bytes_grouped, write_atomic, write_json};
use harmony_scene::{ImageSize, SceneCamera, Wall};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::HomeError;
use crate::adapt::Adapted;
use crate::build::{Built, How};
use crate::frame::Rect;
use crate::home::{Conflict, Home, HomeDoor};
use crate::layout::{HomeLayout, LAYOUT_VERSION, LayoutDoor, LayoutRoom, Unit};
use crate::merge::{Merged, merge};
use crate::solve::Solved;
use crate::{drawing, picture};

/// Size of the canonical view, pixels.
const VIEW: [u32; 2] = [1600, 1200];

/// A room in `home.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RoomEntry {
    /// Name, that of its group in `home.glb`.
    pub name: String,
    /// Its run folder; none for a room without a photo.
    pub run: Option<String>,
    /// The side of the home that the photo's back wall is.
    pub photo_faces: Option<Wall>,
    /// Where it is, layout frame.
    pub solved: Solved,
    /// Where it was before all rooms were refined together.
    pub before: Solved,
    /// The photo's camera, scene frame.
    pub camera: Option<SceneCamera>,
    /// Its objects.
    pub objects: Vec<ObjectEntry>,
}

/// An object in `home.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectEntry {
    /// Id in the home.
    pub id: String,
    /// Id in its run.
    pub of: String,
}

/// `home.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HomeFile {
    /// Version of this file.
    pub version: u32,
    /// Where the scene's origin is in the layout's frame, metres.
    pub origin: DVec3,
    /// Rooms.
    pub rooms: Vec<RoomEntry>,
    /// Doors; rooms by number.
    pub doors: Vec<HomeDoor>,
    /// How the rooms found their places: by which, and how sure that is.
    pub placed: Value,
    /// Half the chi-square before and after refinement.
    pub cost: [f64; 2],
    /// What does not fit.
    pub conflicts: Vec<Conflict>,
    /// What else is to be said.
    pub notes: Vec<String>,
}

/// Writes a home's folder, which must not exist.
///
/// # Errors
/// A folder that is there or cannot be written.
pub fn write(mut built: Built, out: &Path) -> Result<HomeFile, HomeError> {
    if out.exists() {
        return Err(HomeError::Exists { path: out.to_owned() });
    }
    let merged = merge(&mut built.home);
    let file = described(&built, &merged);
    write_json(&out.join("layout.json"), &layout(&built.home))?;
    write_json(&out.join("scene.json"), &merged.world.scene)?;
    let bytes = glb_bytes_grouped(&glb(&merged.world), &merged.groups)?;
    write_atomic(&out.join("home.glb"), &bytes)?;
    if std::fs::hard_link(out.join("home.glb"), out.join("scene_full.glb")).is_err() {
        write_atomic(&out.join("scene_full.glb"), &bytes)?;
    }
    write_atomic(&out.join("plan.svg"), drawing::plan_svg(&built.home, &merged).as_bytes())?;
    let view = picture::canonical(&merged, ImageSize::new(VIEW[0], VIEW[1]));
    harmony_io::picture::write_rgb_png(&out.join("render_canonical.png"), &view)?;
    write_json(&out.join("home.json"), &file)?;
    Ok(file)
}

fn described(built: &Built, merged: &Merged) -> HomeFile {
    let home = &built.home;
    let rooms = home.rooms.iter().enumerate().map(|(k, room)| RoomEntry {
        name: room.name.clone(),
        run: room.run.as_ref().map(|(run, _)| run.run.display().to_string()),
        photo_faces: room.run.as_ref().map(|_| room.solved.place.turn.wall(Wall::Back)),
        solved: room.solved,
        before: room.before,
        camera: merged.cameras[k].as_ref().map(SceneCamera::from),
        objects: merged.objects[k]
            .iter()
            .map(|(id, of)| ObjectEntry { id: id.to_string(), of: of.to_string() })
            .collect(),
    });
    // JSON has no infinity: where there is no other layout, nothing stands.
    let finite = |v: f64| v.is_finite().then_some(v);
    let placed = match &built.how {
        How::Layout(a) => json!({
            "by": "layout",
            "next_assignment_nats": finite(a.next),
            "runs": a.runs.iter().map(|r| json!({
                "room": home.rooms[r.room].name, "energy_nats": r.energy, "next_turn_nats": finite(r.next_turn),
            })).collect::<Vec<_>>(),
        }),
        How::Doors(r) => json!({
            "by": "doors", "energy_nats": r.energy, "next_layout_nats": finite(r.next), "next_layout_doors": r.next_doors,
        }),
    };
    HomeFile {
        version: 1,
        origin: merged.origin,
        rooms: rooms.collect(),
        doors: home.doors.clone(),
        placed,
        cost: built.cost,
        conflicts: home.conflicts.clone(),
        notes: home.notes.clone(),
    }
}

/// The layout that a home has, as one could give it.
pub fn layout(home: &Home) -> HomeLayout {
    let rooms = home.rooms.iter().map(|room| LayoutRoom {
        name: room.name.clone(),
        rectangle: room.polygon.is_empty().then_some(room.solved.rect),
        polygon: room.polygon.clone(),
        height: Some(room.solved.height),
        floor: room.solved.place.floor,
        photo_faces: room.run.as_ref().map(|_| room.solved.place.turn.wall(Wall::Back)),
    });
    let doors = home.doors.iter().map(|door| {
        let floor: Rect = door.floor(&home.rooms, home.outer_wall);
        LayoutDoor {
            rooms: door.rooms.iter().map(|r| home.rooms[*r].name.clone()).collect(),
            at: floor.centre(),
            width: door.range[1] - door.range[0],
            height: Some(door.top),
            kind: door.kind,
        }
    });
    HomeLayout {
        version: LAYOUT_VERSION,
        unit: Unit::Metre,
        wall_thickness: Some(home.outer_wall),
        rooms: rooms.collect(),
        doors: doors.collect(),
    }
}

fn glb(world: &World) -> GlbScene<'_> {
    let objects = world.items.iter().map(|item| {
        let o = &item.object;
        GlbNode {
            name: item.name().to_owned(),
            mesh: std::sync::Arc::clone(&item.mesh),
            transform: NodeTransform::from(&o.pose),
            extras: json!({
                "id": o.id, "label": o.label, "level": o.level, "description": o.description, "size_m": o.size,
                "support": o.support, "relations": o.relations, "material": o.material, "confidence": o.confidence,
                "mesh_source": o.mesh_source, "index": o.index,
            }),
        }
    });
    let shell = world.shell.iter().map(|face| GlbNode {
        name: face.name.clone(),
        mesh: std::sync::Arc::clone(&face.mesh),
        transform: NodeTransform::IDENTITY,
        extras: json!({ "surface": face.name }),
    });
    GlbScene {
        objects: objects.collect(),
        shell: shell.collect(),
        camera: Some(world.camera),
        lighting: Some(&world.scene.lighting),
        glow: AMBIENT_GLOW,
        extras: json!({
            "generator": world.scene.generator,
            "room": world.scene.room,
            "frame": "right-handed, +X right and +Z down on the plan, +Y up, metres",
        }),
        generator: world.scene.generator.clone(),
        textures: TextureEncoding::Compact,
    }
}

/// Writes an adapted room's folder, which must not exist: a scene that every command that reads runs reads, and
/// `adapt.json`.
///
/// # Errors
/// A folder that is there or cannot be written.
pub fn write_adapted(world: &World, report: &Adapted, out: &Path) -> Result<(), HomeError> {
    if out.exists() {
        return Err(HomeError::Exists { path: out.to_owned() });
    }
    write_json(&out.join("scene.json"), &world.scene)?;
    write_atomic(&out.join("scene_full.glb"), &glb_bytes_grouped(&glb(world), &[])?)?;
    harmony_io::picture::write_rgb_png(&out.join("render_canonical.png"), &picture::of_room(world))?;
    Ok(write_json(&out.join("adapt.json"), report)?)
}
