//! Scenes of one and of several photos against the truth, in the first photo's frame.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use harmony_join::{JoinReport, in_place, seen_share};
use harmony_mesh::{Mesh, room_shell};
use harmony_scene::{Camera, Extents, Level, ObjectId, Wall};
use serde::{Deserialize, Serialize};

use super::Taken;
use crate::score::{Prediction, PredictionError, matched, place};
use crate::truth::{FEWEST_PIXELS, TruthObject, TruthRoom};

/// How far an object is off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectError {
    /// Its id in the truth.
    pub truth: String,
    /// Its id in the scene.
    pub id: String,
    /// Level.
    pub level: Level,
    /// In how many photos it was found.
    pub photos: usize,
    /// Distance of its place, metres: raw.
    pub raw_m: f64,
    /// After scaling the scene by the first photo's median ratio of depths.
    pub aligned_m: f64,
    /// Error of its size: the cube root of the volume's ratio less 1.
    pub size: f64,
}

/// A scene, judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// Objects that are in the truth.
    pub objects: Vec<ObjectError>,
    /// Objects that are not, or that are there twice.
    pub false_or_double: Vec<String>,
    /// Joined things whose members are different things in truth.
    pub mixed: Vec<String>,
    /// How many photos are in it.
    pub photos: usize,
    /// Objects of the truth that any of the room's photos shows.
    pub there: usize,
    /// Relative errors of width, height and depth.
    pub extents: [f64; 3],
    /// Share of the true objects' surface that the photos show.
    pub seen_objects: f64,
    /// Share of the true room's surface that they show.
    pub seen_room: f64,
}

/// The truth of all photos, and which object of each run is which.
pub struct Judge<'a> {
    taken: &'a [Taken],
    runs: Vec<Prediction>,
    /// By run, and by the object's id there.
    known: Vec<BTreeMap<ObjectId, String>>,
    /// True objects that some photo shows well enough, by id: mesh in the first frame.
    there: BTreeMap<String, (Level, Arc<Mesh>, DVec3)>,
}

impl<'a> Judge<'a> {
    /// Reads the runs.
    ///
    /// # Errors
    /// A run without a scene.
    pub fn new(taken: &'a [Taken]) -> Result<Self, PredictionError> {
        let mut runs = Vec::new();
        let mut known = Vec::new();
        let mut there = BTreeMap::new();
        for t in taken {
            let run = Prediction::load(&t.run)?;
            let of = matched(&t.truth, &run);
            let named = run
                .objects
                .iter()
                .zip(of)
                .filter_map(|(o, k)| Some((o.object.id.clone(), t.truth.objects[k?].id.clone())));
            known.push(named.collect());
            runs.push(run);
            for o in t.truth.objects.iter().filter(|o| o.visible_pixels >= FEWEST_PIXELS) {
                there.entry(o.id.clone()).or_insert_with(|| (o.level, Arc::new(in_first(t, o)), o.size));
            }
        }
        Ok(Self { taken, runs, known, there })
    }

    /// The first photo's run.
    pub fn single(&self) -> Scene {
        let found = self.runs[0].objects.iter().map(|o| {
            let truth = self.known[0].get(&o.object.id).cloned();
            (o.object.id.clone(), truth, 1)
        });
        self.scene(&self.runs[0], &found.collect::<Vec<_>>(), Vec::new(), &[0])
    }

    /// A joined run of photos.
    ///
    /// # Errors
    /// A folder without a scene.
    pub fn joined(&self, report: &JoinReport, folder: &Path) -> Result<Scene, PredictionError> {
        let run = Prediction::load(folder)?;
        let mut found = Vec::new();
        let mut mixed = Vec::new();
        for thing in &report.things {
            let mut votes: BTreeMap<&str, usize> = BTreeMap::new();
            for (source, object) in &thing.track.members {
                // The objects of a run are read in the order of its scene.
                let run = report.numbers[*source];
                let id = &self.runs[run].objects[*object].object.id;
                if let Some(truth) = self.known[run].get(id) {
                    *votes.entry(truth.as_str()).or_default() += 1;
                }
            }
            if votes.len() > 1 {
                mixed.push(thing.object.id.to_string());
            }
            let most = votes.iter().max_by_key(|(_, n)| **n).map(|(id, _)| (*id).to_owned());
            found.push((thing.object.id.clone(), most, thing.track.members.len()));
        }
        Ok(self.scene(&run, &found, mixed, &report.numbers))
    }

    fn scene(
        &self,
        run: &Prediction,
        found: &[(ObjectId, Option<String>, usize)],
        mixed: Vec<String>,
        photos: &[usize],
    ) -> Scene {
        let first = &self.taken[0].truth;
        let scale = run.depth_ratio(first).unwrap_or(1.0);
        // One rule for one photo and for several: the frames meet where the first photo lets them.
        let walls = &first.walls;
        let mut objects: Vec<ObjectError> = Vec::new();
        let mut false_or_double = Vec::new();
        for (id, truth, count) in found {
            let Some(o) = run.objects.iter().find(|o| o.object.id == *id) else { continue };
            let Some((name, (level, mesh, size))) = truth.as_ref().and_then(|t| Some((t, self.there.get(t)?))) else {
                false_or_double.push(id.to_string());
                continue;
            };
            if objects.iter().any(|o| o.truth == *name) {
                false_or_double.push(id.to_string());
                continue;
            }
            let at = place(o.object.level, &o.mesh, None);
            let goal = place(*level, mesh, None);
            let off = |scale: f64| {
                let mut at = at * scale;
                at.x += shift(walls, &first.extents, run.room.extents.width * scale);
                at.distance(goal)
            };
            let volume = |s: DVec3| (s.x * s.y * s.z).max(1e-9).cbrt();
            objects.push(ObjectError {
                truth: name.clone(),
                id: id.to_string(),
                level: *level,
                photos: *count,
                raw_m: off(1.0),
                aligned_m: off(scale),
                size: volume(o.object.size.as_vec()) / volume(*size) - 1.0,
            });
        }
        let (e, t) = (run.room.extents, first.extents);
        let (seen_objects, seen_room) = self.seen(photos);
        Scene {
            objects,
            false_or_double,
            mixed,
            photos: photos.len(),
            there: self.there.len(),
            extents: [e.width / t.width - 1.0, e.height / t.height - 1.0, e.depth / t.depth - 1.0],
            seen_objects,
            seen_room,
        }
    }

    /// Shares of the true surface, objects and room, that some photos show.
    fn seen(&self, photos: &[usize]) -> (f64, f64) {
        let meshes: Vec<_> = self.there.values().map(|(_, mesh, _)| in_place(mesh)).collect();
        let shell = room_shell(&self.taken[0].truth.room(), &|_| None);
        let cameras: Vec<Camera> = photos
            .iter()
            .map(|k| &self.taken[*k])
            .map(|t| t.turn.inverse().camera(&t.truth.extents, &t.truth.camera))
            .collect();
        let share = seen_share(&meshes, &[in_place(&shell)], &cameras);
        (share.objects, share.room)
    }
}

/// As everywhere in the benchmark: where the first photo shows only the right wall the frames meet there.
fn shift(walls: &[Wall], truth: &Extents, width: f64) -> f64 {
    if walls.contains(&Wall::Right) && !walls.contains(&Wall::Left) { truth.width - width } else { 0.0 }
}

/// A true object's mesh in the first photo's frame.
fn in_first(t: &Taken, o: &TruthObject) -> Mesh {
    let truth: &TruthRoom = &t.truth;
    let back = t.turn.inverse();
    let mut mesh = (*o.mesh).clone();
    mesh.map(|p| back.point(&truth.extents, o.point(p.as_dvec3())).as_vec3(), |n| n);
    mesh
}
