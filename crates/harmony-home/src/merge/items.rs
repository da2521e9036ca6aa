//! A room's part of the scene: faces, objects, camera; and which leaf of a door stays.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_export::world::{Face, Item};
use harmony_scene::{Camera, Level, ObjectId, Pose, SceneObject, Support, Surface, Wall, WallAffinity};

use super::fitted::Fitted;
use crate::frame::Place;
use crate::home::{Conflict, Home, HomeRoom};
use crate::layout::DoorKind;
use crate::moved::{camera, poses, scaled};
use crate::rooms::{Evidence, RoomRun, flat};
use crate::shell;

/// Objects that stand this far out of their room are moved in, metres; farther ones are only told of.
const MOVED_IN_M: f64 = 0.4;
/// Reaching out by less is not told, metres.
const OUT_M: f64 = 0.03;
/// A leaf is stretched into its doorway by so much at most, relative.
const LEAF_STRETCH: f64 = 0.25;

/// The id of a run's object in the home.
pub(super) fn home_id(room: &str, id: &ObjectId) -> ObjectId {
    let full = format!("{room}_{id}");
    ObjectId::new(&full).unwrap_or_else(|_| {
        let short: String = full.chars().take(64).collect();
        ObjectId::new(short.trim_end_matches('_')).expect("rooms' names begin with a letter")
    })
}

/// The wall of an affinity in the home.
fn turned(affinity: WallAffinity, place: &Place) -> WallAffinity {
    affinity.wall().map_or(affinity, |w| place.turn.wall(w).into())
}

/// One room's part of the scene.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub(super) faces: Vec<Face>,
    pub(super) items: Vec<Item>,
    pub(super) ids: Vec<(ObjectId, ObjectId)>,
    pub(super) camera: Option<Camera>,
    pub(super) sides: Vec<(String, Surface, DVec3)>,
}

/// All rooms on their way into the scene.
pub(super) struct Rooms<'a> {
    pub(super) home: &'a mut Home,
    pub(super) origin: DVec3,
    pub(super) fitted: &'a [Fitted],
    /// What the next object has in id images.
    pub(super) next_index: u32,
    /// By door: the room whose leaf stays, and the leaf's id in the run.
    pub(super) leaves: BTreeMap<usize, (usize, ObjectId)>,
}

impl Rooms<'_> {
    /// The object that fills a run's opening.
    fn leaf(&self, room: usize, opening: usize) -> Option<(usize, f64)> {
        let (run, _) = self.home.rooms[room].run.as_ref()?;
        let id = run.world.scene.room.openings.get(opening)?.object.as_ref()?;
        let k = run.world.items.iter().position(|i| i.object.id == *id)?;
        Some((k, run.world.items[k].object.confidence.overall))
    }

    /// Of a door's two leaves the one that its photo shows better stays.
    pub(super) fn choose_leaves(&mut self) {
        for d in 0..self.home.doors.len() {
            let door = &self.home.doors[d];
            let found: Vec<(usize, usize, f64)> = door
                .rooms
                .iter()
                .zip(&door.seen)
                .filter_map(|(room, seen)| {
                    let (item, confidence) = self.leaf(*room, seen.as_ref()?.0)?;
                    Some((*room, item, confidence))
                })
                .collect();
            let name = |r: usize| self.home.rooms[r].name.clone();
            if door.kind == DoorKind::Opening {
                let dropped: Vec<String> = found.iter().map(|(r, ..)| name(*r)).collect();
                if !dropped.is_empty() {
                    let text =
                        format!("the layout has an opening where the photo of {} has a door", dropped.join(", "));
                    self.home.notes.push(text);
                }
                continue;
            }
            let Some(best) = found.iter().max_by(|a, b| a.2.total_cmp(&b.2)) else { continue };
            if found.len() == 2 {
                let other = found.iter().find(|f| f.0 != best.0).map_or_else(String::new, |f| name(f.0));
                let text = format!("one door, seen twice: the leaf of {} stays, that of {other} is gone", name(best.0));
                self.home.notes.push(text);
            }
            if let Some((run, _)) = &self.home.rooms[best.0].run {
                self.leaves.insert(d, (best.0, run.world.items[best.1].object.id.clone()));
            }
        }
    }

    /// Objects of a room that are leaves of the home's doors: by number, the door, and whether it stays.
    fn leaves_of(&self, room: usize) -> BTreeMap<usize, (usize, bool)> {
        let mut out = BTreeMap::new();
        for (d, door) in self.home.doors.iter().enumerate() {
            for (r, seen) in door.rooms.iter().zip(&door.seen).filter(|(r, _)| **r == room) {
                if let Some((item, _)) = seen.as_ref().and_then(|s| self.leaf(*r, s.0)) {
                    out.insert(item, (d, self.leaves.get(&d).is_some_and(|l| l.0 == room)));
                }
            }
        }
        out
    }

    pub(super) fn part(&mut self, index: usize) -> Part {
        let fit = &self.fitted[index];
        let origin = self.origin;
        let room = self.home.rooms[index].clone();
        let place = Place { at: fit.place.at - flat(origin), floor: fit.place.floor - origin.y, ..fit.place };
        let own: &[Face] = room.run.as_ref().map_or(&[], |(run, _)| &run.world.shell);
        let thickest = self
            .home
            .doors
            .iter()
            .filter(|d| d.rooms.contains(&index))
            .map(|d| {
                let [a, b] = d.faces(&self.home.rooms, self.home.outer_wall);
                (a - b).abs()
            })
            .fold(0.0, f64::max);
        let faces = shell::faces(&format!("{}_", room.name), &fit.room, &place, own, thickest / 2.0);
        let sides = Surface::ALL
            .into_iter()
            .map(|s| {
                let side = s.wall().map_or(s, |w| fit.place.turn.wall(w).surface());
                let at = place.point(&fit.room.extents, s.point(&fit.room.extents, s.size(&fit.room.extents) / 2.0));
                (format!("{}_{}", room.name, harmony_mesh::shell_material_name(s)), side, at)
            })
            .collect();
        let Some((run, evidence)) = &room.run else {
            return Part { faces, items: Vec::new(), ids: Vec::new(), camera: None, sides };
        };
        let camera = camera(&run.world.camera, evidence, &room.solved);
        let camera = Camera { translation: camera.translation + camera.rotation * origin, ..camera };
        let (items, ids) = self.items(index, &room, run, evidence);
        Part { faces, items, ids, camera: Some(camera), sides }
    }

    fn items(
        &mut self,
        index: usize,
        room: &HomeRoom,
        run: &RoomRun,
        evidence: &Evidence,
    ) -> (Vec<Item>, Vec<(ObjectId, ObjectId)>) {
        let place = &room.solved.place;
        let objects: Vec<SceneObject> = run.world.items.iter().map(|i| i.object.clone()).collect();
        let mut poses = poses(&objects, evidence, &room.solved);
        self.move_in(room, &run.world.items, &mut poses);
        let leaves = self.leaves_of(index);
        let mut gone = BTreeSet::new();
        let (mut items, mut ids) = (Vec::new(), Vec::new());
        for (k, (item, mut pose)) in run.world.items.iter().zip(poses).enumerate() {
            if let Some((d, stays)) = leaves.get(&k) {
                if !stays {
                    gone.insert(item.object.id.clone());
                    continue;
                }
                let door = &self.home.doors[*d];
                let (width, middle) = (door.range[1] - door.range[0], f64::midpoint(door.range[0], door.range[1]));
                let wide = width / (item.object.size.width * place.scale);
                let tall = door.top / (item.object.size.height * place.scale);
                for (axis, k) in [(0, wide), (1, tall)] {
                    if (k - 1.0).abs() < LEAF_STRETCH {
                        pose.stretch[axis] *= k;
                    }
                }
                pose.position.y = place.floor;
                if matches!(door.side, Wall::Left | Wall::Right) {
                    pose.position.z = middle;
                } else {
                    pose.position.x = middle;
                }
            }
            pose.position -= self.origin;
            let id = home_id(&room.name, &item.object.id);
            let object = self.object(item, id.clone(), pose, room);
            ids.push((id, item.object.id.clone()));
            items.push(item.with(object, Arc::clone(&item.mesh)));
        }
        for item in &mut items {
            if let Support::Object { id } = &item.object.support
                && gone.iter().any(|g| home_id(&room.name, g) == *id)
            {
                item.object.support = Support::Floor;
            }
        }
        (items, ids)
    }

    /// Furniture that reaches out of the room goes in, with what is on it.
    fn move_in(&mut self, room: &HomeRoom, items: &[Item], poses: &mut [Pose]) {
        let rect = room.solved.rect;
        for k in 0..items.len() {
            let object = &items[k].object;
            if object.level != Level::Furniture && object.support != Support::Floor {
                continue;
            }
            let Some(bounds) = items[k].mesh.bounds() else { continue };
            let corners = [0.0, 1.0].into_iter().flat_map(|a| [0.0, 1.0].map(|b| (a, b)));
            let corners: Vec<DVec2> = corners
                .map(|(a, b)| flat(poses[k].point(bounds.min + (bounds.max - bounds.min) * DVec3::new(a, 0.0, b))))
                .collect();
            let low = corners.iter().copied().fold(DVec2::INFINITY, DVec2::min);
            let high = corners.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
            let inward = (rect.min - low).max(DVec2::ZERO) - (high - rect.max).max(DVec2::ZERO);
            let out = inward.abs().max_element();
            if out <= OUT_M {
                continue;
            }
            let id = home_id(&room.name, &object.id);
            if out > MOVED_IN_M || (high - low).cmpgt(rect.size()).any() {
                self.home.conflicts.push(Conflict::Outside { object: id.to_string(), centimetres: out * 100.0 });
                continue;
            }
            self.home.notes.push(format!("{id} was moved in by {:.0} cm: its room is smaller there", out * 100.0));
            let own = object.id.clone();
            let with: Vec<usize> = (0..items.len()).filter(|j| *j == k || rests_on(items, *j, &own)).collect();
            for j in with {
                poses[j].position += DVec3::new(inward.x, 0.0, inward.y);
            }
        }
    }

    fn object(&mut self, item: &Item, id: ObjectId, pose: Pose, room: &HomeRoom) -> SceneObject {
        let place = &room.solved.place;
        let o = &item.object;
        let renamed = |id: &Option<ObjectId>| id.as_ref().map(|id| home_id(&room.name, id));
        let named = |group: &Option<String>| group.as_ref().map(|g| format!("{}_{g}", room.name));
        let mut relations = o.relations.clone();
        relations.wall_affinity = turned(relations.wall_affinity, place);
        relations.on_top_of = renamed(&o.relations.on_top_of);
        relations.in_front_of = renamed(&o.relations.in_front_of);
        relations.behind = renamed(&o.relations.behind);
        relations.facing_toward = renamed(&o.relations.facing_toward);
        relations.group = named(&o.relations.group);
        relations.matched_set = named(&o.relations.matched_set);
        relations.joined_row = named(&o.relations.joined_row);
        let support = match &o.support {
            Support::Wall { wall } => Support::Wall { wall: place.turn.wall(*wall) },
            Support::Object { id } => Support::Object { id: home_id(&room.name, id) },
            other => other.clone(),
        };
        let index = self.next_index;
        self.next_index += 1;
        SceneObject {
            id,
            index,
            pose,
            size: scaled(o.size, place.scale),
            support,
            relations,
            mesh: "home.glb".to_owned(),
            mask: None,
            seen_box: None,
            ..o.clone()
        }
    }
}

/// Whether an object rests on another, directly or not.
fn rests_on(items: &[Item], k: usize, host: &ObjectId) -> bool {
    let mut at = k;
    for _ in 0..items.len() {
        let Support::Object { id } = &items[at].object.support else { return false };
        if id == host {
            return true;
        }
        let Some(next) = items.iter().position(|i| i.object.id == *id) else { return false };
        at = next;
    }
    false
}
