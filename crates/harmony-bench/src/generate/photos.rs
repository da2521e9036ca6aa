//! One room photographed from several places, each photo with the truth in its own frame: the wall that it faces is the
//! back wall there.
//!
//! The first photo is the one of [`super::generate`]. Each further one faces another wall, and is taken as the first is: the best of some cameras near the wall behind it. What there is in the room, its names and
//! its light are the same in all.

use std::collections::BTreeSet;

use harmony_mesh::Mesh;
use harmony_scene::{QuarterTurn, Surface, Wall};

use super::dice::Dice;
use super::form::Form;
use super::layout::Plan;
use super::shell::surface_id;
use super::truth::SurfacePoints;
use super::{Draft, GeneratedObject, GeneratedRoom, GeneratorSettings, view};

/// Most photos of one room: each faces its own wall.
pub const MAX_PHOTOS: usize = 4;
/// Random numbers of further photos have a stream of their own.
const STREAM: u64 = 79;
/// Times that a dozen cameras are tried before a wall.
const PLACES: usize = 6;

/// A photo of a room.
#[derive(Debug, Clone)]
pub struct RoomPhoto {
    /// The room in the photo's frame: names of walls, places and turns are those of a room whose back wall the photo
    /// faces.
    pub room: GeneratedRoom,
    /// Carries the first photo's frame into this one's.
    pub turn: QuarterTurn,
}

/// The room of a seed from `count` places (1 to [`MAX_PHOTOS`]), without views for judging. Each further photo is, of
/// those before the walls that are left, the one that shows most of what the photos before it show: whoever takes photos
/// to be joined lets them overlap. The rooms are boxes. Fewer come back when furniture leaves no place for a camera before a wall.
pub fn photographed(seed: u64, settings: &GeneratorSettings, count: usize) -> Vec<RoomPhoto> {
    // A room that is no box is not turned.
    let settings = GeneratorSettings { views: false, shapes: Vec::new(), ..settings.clone() };
    let draft = super::draft(seed, &settings);
    let mut dice = Dice::new(seed, STREAM);
    let instances = view::instances(&draft.shell, &draft.plan);
    let mut shown = view::shown(&draft.view.camera, &instances);
    let mut left: Vec<(QuarterTurn, view::View, BTreeSet<u32>)> = Vec::new();
    for turn in &QuarterTurn::ALL[1..] {
        let found = (0..PLACES).find_map(|_| before_a_wall(&mut dice, &draft, *turn));
        left.extend(found.map(|view| (*turn, view, view::shown(&view.camera, &instances))));
    }
    let mut chosen = vec![(QuarterTurn::ALL[0], draft.view)];
    while chosen.len() < count && !left.is_empty() {
        let common = |k: &usize| left[*k].2.intersection(&shown).count();
        let most = (0..left.len()).rev().max_by_key(common).unwrap_or(0);
        let (turn, view, more) = left.remove(most);
        chosen.push((turn, view));
        shown.extend(more);
    }
    let taken = chosen.into_iter().enumerate().map(|(k, (turn, view))| {
        let mut room = Draft { view, ..draft.clone() }.finish(seed, &settings).turned(turn);
        room.name = format!("{}_photo_{}", room.name, k + 1);
        RoomPhoto { room, turn }
    });
    taken.collect()
}

/// A camera as the first photo's, in a room turned so that another wall is its back; in the frame of the draft.
fn before_a_wall(dice: &mut Dice, draft: &Draft, turn: QuarterTurn) -> Option<view::View> {
    let extents = draft.plan.extents;
    let mut plan = Plan::new(turn.extents(&extents), Form::default());
    plan.items.clone_from(&draft.plan.items);
    for item in &mut plan.items {
        item.position = turn.point(&extents, item.position);
        item.yaw = turn.yaw(item.yaw);
    }
    let mut shell = draft.shell.clone();
    let (rotation, origin) = (turn.rotation(), turn.origin(&extents));
    for (_, mesh) in &mut shell {
        mesh.map(|p| (rotation * p.as_dvec3() + origin).as_vec3(), |n| (rotation * n.as_dvec3()).as_vec3());
    }
    let mut found = view::choose(dice, &plan, draft.view.camera.size, &view::instances(&shell, &plan), false)?;
    found.camera = turn.inverse().camera(&plan.extents, &found.camera);
    Some(found)
}

impl GeneratedRoom {
    /// The same room and photo in the frame with another wall as its back.
    #[must_use]
    fn turned(mut self, turn: QuarterTurn) -> Self {
        let from = self.extents;
        let rotation = turn.rotation();
        self.extents = turn.extents(&from);
        self.camera = turn.camera(&from, &self.camera);
        let forward = self.camera.forward();
        self.camera_yaw = (-forward.x).atan2(-forward.z);
        for object in &mut self.objects {
            turn_object(object, turn, |p| turn.point(&from, p));
        }
        for opening in &mut self.openings {
            opening.u = turn.span(&from, opening.wall, opening.u);
            opening.wall = turn.wall(opening.wall);
        }
        for light in &mut self.lights {
            light.position = turn.point(&from, light.position);
            light.normal = rotation * light.normal;
        }
        let mut renamed: Vec<u8> = (0..=u8::MAX).collect();
        for surface in Surface::ALL {
            renamed[usize::from(surface_id(surface))] = surface_id(turn.surface(surface));
        }
        self.ids.iter_mut().for_each(|id| *id = renamed[usize::from(*id)]);
        let carried = |points: &mut SurfacePoints| {
            points.xyz.iter_mut().for_each(|p| *p = turn.point(&from, p.as_dvec3()).as_vec3());
            points.id.iter_mut().filter(|id| **id < 10).for_each(|id| *id = u16::from(renamed[usize::from(*id)]));
        };
        carried(&mut self.points);
        carried(&mut self.shell_points);
        let mut solids = Mesh::default();
        for object in &self.objects {
            let mut mesh = (*object.mesh).clone();
            mesh.map(|p| object.to_room(p.as_dvec3()).as_vec3(), |n| n);
            solids.append(&mesh);
        }
        self.corners = super::truth::corners(&self.camera, &self.extents, &solids);
        self
    }
}

fn turn_object(object: &mut GeneratedObject, turn: QuarterTurn, point: impl Fn(glam::DVec3) -> glam::DVec3) {
    object.position = point(object.position);
    object.yaw = turn.yaw(object.yaw);
    let (a, b) = (point(object.aabb.min), point(object.aabb.max));
    (object.aabb.min, object.aabb.max) = (a.min(b), a.max(b));
    object.wall = object.wall.map(|wall| turn.wall(wall));
    let named = |w: &&Wall| object.support == format!("wall_{}", w.surface().name());
    if let Some(wall) = Wall::ALL.iter().find(named) {
        object.support = format!("wall_{}", turn.wall(*wall).surface().name());
    }
}
