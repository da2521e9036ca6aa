//! A home as one scene: rooms as groups, walls once, doors once. Key `home.scene`.

mod fitted;
mod items;
mod strays;

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3};
use harmony_export::World;
use harmony_export::world::{Face, Item};
use harmony_io::NodeGroup;
use harmony_scene::{
    Block, Camera, Extents, Light, LightKind, Lighting, Niche, ObjectId, Opening, Room, RoomShape, SCENE_VERSION,
    Scene, SceneCamera, Surface, Wall,
};
use serde_json::json;

use crate::frame::Rect;
use crate::home::{Home, HomeRoom};
use crate::moved::light;
use crate::rooms::{Evidence, RoomRun, flat};
use crate::shell;
use crate::walls::{Free, blocks};

use fitted::{Fitted, OpeningFrom, fitted};
use items::{Part, Rooms, home_id};
pub use strays::find_strays;

/// A home as one scene.
#[derive(Debug, Clone)]
pub struct Merged {
    /// Scene and meshes: a room whose walls between rooms are blocks.
    pub world: World,
    /// Rooms as groups of nodes.
    pub groups: Vec<NodeGroup>,
    /// Where the scene's origin is in the home's frame.
    pub origin: DVec3,
    /// For each room, its objects: id in the home, id in the run.
    pub objects: Vec<Vec<(ObjectId, ObjectId)>>,
    /// For each room, its photo's camera in the scene's frame.
    pub cameras: Vec<Option<Camera>>,
    /// What a view without ceilings leaves out: faces by name, with the side that they are.
    pub sides: Vec<(String, Surface, DVec3)>,
}

/// Puts a home together; what is found on the way is added to its conflicts and notes.
pub fn merge(home: &mut Home) -> Merged {
    let bounds = home.bounds();
    let ground = home.rooms.iter().map(|r| r.solved.place.floor).fold(f64::INFINITY, f64::min);
    let top = home.rooms.iter().map(|r| r.solved.place.floor + r.solved.height).fold(f64::NEG_INFINITY, f64::max);
    let origin = DVec3::new(bounds.min.x, ground, bounds.min.y);
    let extents = Extents { width: bounds.size().x, height: top - ground, depth: bounds.size().y };
    let merged_openings: BTreeSet<(usize, usize)> = home
        .doors
        .iter()
        .flat_map(|d| d.rooms.iter().zip(&d.seen).filter_map(|(r, seen)| Some((*r, seen.as_ref()?.0))))
        .collect();
    let fitted: Vec<Fitted> = (0..home.rooms.len()).map(|k| fitted(home, k, &merged_openings)).collect();
    let mut rooms = Rooms { home, origin, fitted: &fitted, next_index: 10, leaves: BTreeMap::new() };
    rooms.choose_leaves();
    let parts: Vec<Part> = (0..fitted.len()).map(|k| rooms.part(k)).collect();
    let leaves = rooms.leaves;
    let room = whole(home, &fitted, origin, extents, &parts, &leaves);
    let scene = scene(home, room, &parts, origin);
    let mut faces: Vec<Face> = parts.iter().flat_map(|p| p.faces.iter().cloned()).collect();
    let items: Vec<Item> = parts.iter().flat_map(|p| p.items.iter().cloned()).collect();
    let outer = home.outer_wall;
    let grown = Rect { min: DVec2::splat(-outer), max: DVec2::new(extents.width, extents.depth) + outer };
    let free = free(home, origin);
    let tops = blocks(&grown, extents.height, &free, outer);
    let level = tops.iter().filter(|b| b.kind == "wall" && b.max.y >= extents.height - 1e-6).map(|b| (b.min, b.max));
    faces.extend(shell::wall_tops(level));
    let world = World::new(scene, faces, items, Vec::new());
    let groups = home
        .rooms
        .iter()
        .zip(&parts)
        .map(|(room, part)| NodeGroup {
            name: room.name.clone(),
            members: part
                .faces
                .iter()
                .map(|f| f.name.clone())
                .chain(part.items.iter().map(|i| i.object.id.to_string()))
                .collect(),
            extras: json!({
                "room": room.name,
                "photo": room.run.is_some(),
                "walls": { "min": (room.solved.rect.min - flat(origin)), "max": (room.solved.rect.max - flat(origin)) },
                "height": room.solved.height,
            }),
        })
        .collect();
    Merged {
        world,
        groups,
        origin,
        objects: parts.iter().map(|p| p.ids.clone()).collect(),
        cameras: parts.iter().map(|p| p.camera).collect(),
        sides: parts.iter().flat_map(|p| p.sides.clone()).collect(),
    }
}

/// Free space in the scene's frame: rooms and the ways through walls.
fn free(home: &Home, origin: DVec3) -> Vec<Free> {
    let shifted = |r: Rect| Rect { min: r.min - flat(origin), max: r.max - flat(origin) };
    let mut out = Vec::new();
    for room in &home.rooms {
        let floor = room.solved.place.floor - origin.y;
        out.extend(room.free().into_iter().map(|r| Free { rect: shifted(r), y: [floor, floor + room.solved.height] }));
    }
    for door in home.doors.iter().filter(|d| d.rooms.len() == 2) {
        let floors = door.rooms.iter().map(|r| home.rooms[*r].solved.place.floor - origin.y);
        let (low, high) = floors.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), f| (l.min(f), h.max(f)));
        let rect = shifted(door.floor(&home.rooms, home.outer_wall));
        if rect.size().min_element() > 0.0 {
            out.push(Free { rect, y: [low, high + door.top] });
        }
    }
    out
}

/// The home as one room of the vocabulary.
fn whole(
    home: &mut Home,
    fitted: &[Fitted],
    origin: DVec3,
    extents: Extents,
    parts: &[Part],
    leaves: &BTreeMap<usize, (usize, ObjectId)>,
) -> Room {
    let bounds = Rect { min: DVec2::ZERO, max: DVec2::new(extents.width, extents.depth) };
    let mut shape = RoomShape {
        blocks: blocks(&bounds, extents.height, &free(home, origin), home.outer_wall),
        ..RoomShape::default()
    };
    let mut openings = Vec::new();
    for (k, fit) in fitted.iter().enumerate() {
        let room = &home.rooms[k];
        let carried = |p: DVec3| fit.place.point(&fit.room.extents, p) - origin;
        if room.polygon.is_empty() {
            for block in &fit.room.shape.blocks {
                let (a, b) = (carried(block.min), carried(block.max));
                shape.blocks.push(Block { kind: block.kind.clone(), min: a.min(b), max: a.max(b) });
            }
            for niche in &fit.room.shape.niches {
                let (a, b) = (carried(niche.min), carried(niche.max));
                let surface = niche.surface.wall().map_or(niche.surface, |w| fit.place.turn.wall(w).surface());
                shape.niches.push(Niche { surface, min: a.min(b), max: a.max(b), ..niche.clone() });
            }
            if !fit.room.shape.slopes.is_empty() {
                home.notes.push(format!("the slopes of {} are in its faces only, not in what is solid", room.name));
            }
        }
        let rect = room.solved.rect;
        for (opening, from) in fit.room.openings.iter().zip(&fit.from) {
            let side = fit.place.turn.wall(opening.wall);
            let floor = room.solved.place.floor - origin.y;
            let box_side = match side {
                Wall::Left | Wall::Back => 0.0,
                Wall::Right => extents.width,
                Wall::Front => extents.depth,
            };
            let at = rect.side(side) - if matches!(side, Wall::Left | Wall::Right) { origin.x } else { origin.z };
            let ends = opening.u.map(|u| side.coordinates(carried(opening.wall.point(&fit.room.extents, u, 0.0))).x);
            let u = [ends[0].min(ends[1]), ends[0].max(ends[1])];
            let inset = (at - box_side).abs() + opening.inset;
            let y = opening.y.map(|y| y + floor);
            let id = |run_id: &ObjectId| parts[k].ids.iter().find(|(_, own)| own == run_id).map(|(id, _)| id.clone());
            let object = match from {
                OpeningFrom::Run(object) => object.as_ref().and_then(id),
                // The way is free already: one opening says where its leaf hangs.
                OpeningFrom::Door(d) => match leaves.get(d) {
                    Some((r, leaf)) if *r == k => id(leaf),
                    None if home.doors[*d].rooms[0] == k => None,
                    _ => continue,
                },
            };
            openings.push(Opening { kind: opening.kind, wall: side, u, y, inset, rise: opening.rise, object });
        }
    }
    let first = fitted.first().map(|f| &f.room);
    Room {
        room_type: "home".to_owned(),
        extents,
        shape,
        seen: vec![Surface::Floor],
        openings,
        floor_texture: first.and_then(|r| r.floor_texture.clone()),
        wall_texture: first.and_then(|r| r.wall_texture.clone()),
    }
}

/// The scene of all rooms, with the camera of the largest that has a photo.
fn scene(home: &Home, room: Room, parts: &[Part], origin: DVec3) -> Scene {
    let largest = (0..parts.len())
        .filter(|k| parts[*k].camera.is_some())
        .max_by(|a, b| home.rooms[*a].solved.rect.area().total_cmp(&home.rooms[*b].solved.rect.area()));
    let camera = largest.and_then(|k| parts[k].camera).expect("a home has a photo");
    let run = largest.and_then(|k| home.rooms[k].run.as_ref()).map(|(run, _)| run).expect("a home has a photo");
    Scene {
        version: SCENE_VERSION,
        generator: run.world.scene.generator.clone(),
        room,
        camera: SceneCamera::from(&camera),
        objects: parts.iter().flat_map(|p| p.items.iter().map(|i| i.object.clone())).collect(),
        lighting: lighting(home, origin),
        summary: format!(
            "A home of {} rooms: {}.",
            home.rooms.len(),
            home.rooms.iter().map(|r| r.name.as_str()).collect::<Vec<_>>().join(", ")
        ),
        warnings: Vec::new(),
    }
}

/// Lights of all rooms under one exposure and one sun, the strongest.
fn lighting(home: &Home, origin: DVec3) -> Lighting {
    let runs: Vec<(&HomeRoom, &RoomRun, &Evidence)> =
        home.rooms.iter().filter_map(|r| r.run.as_ref().map(|(run, e)| (r, run, e))).collect();
    let of = |run: &RoomRun| run.world.scene.lighting.clone();
    let mut exposures: Vec<f64> = runs.iter().map(|(_, run, _)| of(run).exposure).collect();
    exposures.sort_by(f64::total_cmp);
    let exposure = exposures[exposures.len() / 2];
    let mut lights = Vec::new();
    let mut ambient = 0.0;
    for (room, run, evidence) in &runs {
        let own = of(run);
        let gain = (own.exposure - exposure).exp2();
        ambient += own.ambient_intensity * gain / runs.len() as f64;
        for l in &own.lights {
            let mut moved = light(l, evidence, &room.solved, -origin);
            moved.id = format!("{}_{}", room.name, l.id);
            moved.intensity *= gain;
            moved.object = l.object.as_ref().map(|id| home_id(&room.name, id));
            lights.push(moved);
        }
    }
    let is_sun = |l: &Light| matches!(l.kind, LightKind::Sun { .. });
    let strongest = lights.iter().filter(|l| is_sun(l)).map(|l| l.intensity).fold(0.0, f64::max);
    let mut sun = false;
    lights.retain(|l| !is_sun(l) || (l.intensity >= strongest && !std::mem::replace(&mut sun, true)));
    Lighting { lights, ambient_intensity: ambient, exposure, ..of(runs[0].1) }
}
