//! Motion over the stage: a layer of its own that has `scene.usda` as its sublayer and adds time samples.
//!
//! # What stands where
//! An object that moves gets `xformOp:transform.timeSamples` in place of its translation and turn, a part that opens the
//! same below its object. What is added (a robot's links) stands under `/World/<name>`, one Xform a link, all in the stage's
//! frame. The ground of an earthquake moves `/World` itself.
//!
//! Bodies that have samples are kinematic in this layer: a simulator plays them, and the rest of the scene meets them.
//! Samples are one a frame; players interpolate matrices linearly between them, which shortens what turns between two frames
//! by less than a thousandth at a tenth of a radian.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use harmony_mesh::Mesh;
use harmony_physics::Shaken;

use super::stage::{level_name, matrix};
use super::text::{Text, quoted, tuple};
use crate::World;
use crate::world::{identifier, z_up, z_up_rotation};

/// Where a thing of the scene is, frame by frame.
pub struct Track {
    /// The object.
    pub object: String,
    /// The part of it that moves, by its name; `None` for all of it.
    pub part: Option<String>,
    /// `room_from_room`: what the motion does to where the scene has it.
    pub moved: Vec<DAffine3>,
}

/// A link of a robot.
pub struct AddedLink {
    /// Its name.
    pub name: String,
    /// Meshes in the link's frame with the place of each in it, and their colours (linear).
    pub meshes: Vec<(DAffine3, std::sync::Arc<Mesh>, [f32; 3])>,
    /// `room_from_link`, one a frame.
    pub places: Vec<DAffine3>,
}

/// A motion.
#[derive(Default)]
pub struct Animation {
    /// What is told of it.
    pub title: String,
    /// Frames a second.
    pub frames_per_second: u32,
    /// Things of the scene.
    pub tracks: Vec<Track>,
    /// Name of what is added, and its links.
    pub added: Option<(String, Vec<AddedLink>)>,
    /// Displacement of the room, one a frame; empty where it stands still.
    pub ground: Vec<DVec3>,
}

/// A frame of the room in the stage: axes and place.
fn in_stage(place: &DAffine3) -> String {
    matrix(z_up_rotation(place.matrix3), z_up(place.translation))
}

fn samples(t: &mut Text, frames: impl Iterator<Item = String>) {
    t.line("matrix4d xformOp:transform.timeSamples = {");
    for (k, m) in frames.enumerate() {
        t.line(&format!("    {k}: {m},"));
    }
    t.line("}");
    t.line("uniform token[] xformOpOrder = [\"xformOp:transform\"]");
}

impl Animation {
    /// An earthquake, in the frame that stands still.
    pub fn of_earthquake(world: &World, shaken: &Shaken) -> Self {
        let tracks = shaken.objects.iter().filter(|o| !o.positions.is_empty()).filter_map(|o| {
            let item = world.items.iter().find(|i| i.name() == o.id)?;
            let at_rest = DAffine3::from_mat3_translation(item.rotation(), item.object.pose.position);
            let moved = o.positions.iter().zip(&o.rotations).map(|(p, q)| {
                let turn = DQuat::from_array(*q).normalize();
                DAffine3::from_rotation_translation(turn, DVec3::from_array(*p)) * at_rest.inverse()
            });
            Some(Track { object: o.id.clone(), part: None, moved: moved.collect() })
        });
        Self {
            title: format!("an earthquake of intensity {}", shaken.quake.intensity),
            frames_per_second: shaken.frames_per_second as u32,
            tracks: tracks.collect(),
            added: None,
            ground: shaken.ground.iter().map(|g| DVec3::from_array(*g)).collect(),
        }
    }

    fn frames(&self) -> usize {
        let links = self.added.iter().flat_map(|(_, links)| links).map(|l| l.places.len());
        self.tracks.iter().map(|t| t.moved.len()).chain(links).chain([self.ground.len()]).max().unwrap_or(0)
    }

    /// The layer, to be written beside `scene.usda`.
    pub fn layer(&self, world: &World) -> String {
        let last = self.frames().saturating_sub(1);
        let fps = self.frames_per_second;
        let mut t = Text::new(&format!(
            "(\n    defaultPrim = \"World\"\n    doc = {}\n    endTimeCode = {last}\n    framesPerSecond = {fps}\n    \
             kilogramsPerUnit = 1\n    metersPerUnit = 1\n    startTimeCode = 0\n    subLayers = [\n        \
             @./scene.usda@\n    ]\n    timeCodesPerSecond = {fps}\n    upAxis = \"Z\"\n)\n",
            quoted(&self.title)
        ));
        t.over("World", |t| {
            if !self.ground.is_empty() {
                t.line("double3 xformOp:translate.timeSamples = {");
                for (k, g) in self.ground.iter().enumerate() {
                    t.line(&format!("    {k}: {},", tuple(&z_up(*g).to_array(), 6)));
                }
                t.line("}");
                t.line("uniform token[] xformOpOrder = [\"xformOp:translate\"]");
            }
            let mut levels: BTreeMap<&str, Vec<&Track>> = BTreeMap::new();
            for track in &self.tracks {
                if let Some(item) = world.items.iter().find(|i| i.name() == track.object) {
                    levels.entry(level_name(item.object.level)).or_default().push(track);
                }
            }
            for (level, tracks) in levels {
                t.over(level, |t| tracks.iter().for_each(|track| write_track(t, world, track)));
            }
            if let Some((name, links)) = &self.added {
                robot(t, name, links);
            }
        });
        t.finish()
    }
}

/// Samples of one thing.
fn write_track(t: &mut Text, world: &World, track: &Track) {
    let Some(item) = world.items.iter().find(|i| i.name() == track.object) else { return };
    let room_from_body = DAffine3::from_mat3_translation(item.rotation(), item.object.pose.position);
    let kinematic = "bool physics:kinematicEnabled = 1";
    let body = harmony_physics::matter::motion(&item.object) == harmony_physics::Motion::Dynamic;
    t.over(&track.object, |t| {
        if let Some(part) = &track.part {
            t.over(part, |t| {
                t.line(kinematic);
                let inside = |m: &DAffine3| room_from_body.inverse() * *m * room_from_body;
                samples(t, track.moved.iter().map(|m| in_stage(&inside(m))));
            });
            return;
        }
        samples(t, track.moved.iter().map(|m| in_stage(&(*m * room_from_body))));
        match (item.opens.is_empty(), body) {
            (true, true) => t.line(kinematic),
            (false, true) => t.over("body", |t| t.line(kinematic)),
            _ => {}
        }
    });
}

/// Links of a robot, each with its meshes.
fn robot(t: &mut Text, name: &str, links: &[AddedLink]) {
    t.prim("Xform", &identifier(name), &["kind = \"component\"".to_owned()], |t| {
        for link in links {
            t.prim("Xform", &identifier(&link.name), &[], |t| {
                // A link's frame has its model's axes, +Z up: only the room's side is turned to the stage.
                let stage = |p: &DAffine3| matrix(stage_from_room() * p.matrix3, z_up(p.translation));
                samples(t, link.places.iter().map(stage));
                for (k, (place, mesh, color)) in link.meshes.iter().enumerate() {
                    link_mesh(t, k, place, mesh, *color);
                }
            });
        }
    });
}

fn stage_from_room() -> DMat3 {
    DMat3::from_cols(z_up(DVec3::X), z_up(DVec3::Y), z_up(DVec3::Z))
}

fn link_mesh(t: &mut Text, number: usize, place: &DAffine3, mesh: &Mesh, color: [f32; 3]) {
    t.prim("Mesh", &format!("visual_{number:02}"), &[], |t| {
        let points = || mesh.positions.iter().map(|p| place.transform_point3(p.as_dvec3()).to_array());
        let (low, high) = points().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| {
            (l.min(DVec3::from_array(p)), h.max(DVec3::from_array(p)))
        });
        t.tuples("float3[] extent", [low.to_array(), high.to_array()].into_iter(), 5, "");
        t.whole("int[] faceVertexCounts", mesh.triangles().map(|_| 3));
        t.whole("int[] faceVertexIndices", mesh.triangles().flatten().map(|i| i as usize));
        t.tuples("point3f[] points", points(), 5, "");
        t.line(&format!(
            "color3f[] primvars:displayColor = [{}]",
            tuple(&color.map(|c| f64::from(c.clamp(0.0, 1.0))), 4)
        ));
        t.line("uniform token subdivisionScheme = \"none\"");
    });
}
