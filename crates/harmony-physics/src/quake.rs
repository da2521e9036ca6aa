//! An earthquake in the room: floor and walls move with the ground, everything else by contact, friction and gravity.
//! Key `physics.earthquake`.
//!
//! Paper: "Furniture and decorations are genuine dynamic bodies, moving only from gravity and friction with each object's own
//! VLM-estimated mass and friction, so a tall bookcase topples while a heavy sofa barely shifts."
//!
//! Trajectories are in the **room's frame**, which moves: what a camera on the wall sees. Add the ground's displacement for
//! the frame that does not move.

use harmony_scene::{Scene, Vec3};
use serde::{Deserialize, Serialize};

use crate::bodies::Bodies;
use crate::ground::{GroundMotion, peak_acceleration};
use crate::matter::Motion;
use crate::settle::places;
use crate::world::{Placed, STEP, World};

/// Frames of the trajectories a second.
pub const FRAMES_PER_SECOND: usize = 30;
/// An up axis that leans more than this has toppled, degrees.
pub const TOPPLED_DEG: f64 = 45.0;
/// An origin that is lower by more than this has fallen, metres.
pub const FALLEN_M: f64 = 0.1;
/// Longest that is simulated, seconds.
pub const LONGEST_SECONDS: f64 = 120.0;

/// What earthquake.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quake {
    /// Modified Mercalli intensity, 1 to 12.
    pub intensity: f64,
    /// How long it shakes, seconds.
    pub seconds: f64,
    /// Of the ground's motion.
    pub seed: u64,
}

/// An earthquake that cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum QuakeError {
    /// Not an intensity.
    #[error("intensity {intensity} is not on the modified Mercalli scale, {low} to {high}")]
    Intensity {
        /// What was asked for.
        intensity: f64,
        /// The lowest.
        low: f64,
        /// The highest.
        high: f64,
    },
    /// Too short or too long.
    #[error("an earthquake of {seconds} s cannot be simulated, 1 to {most} s can")]
    Seconds {
        /// What was asked for.
        seconds: f64,
        /// The longest.
        most: f64,
    },
}

impl Quake {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`QuakeError`].
    pub fn check(&self) -> Result<(), QuakeError> {
        let (low, high) = crate::ground::INTENSITIES;
        if !(low..=high).contains(&self.intensity) {
            return Err(QuakeError::Intensity { intensity: self.intensity, low, high });
        }
        if !(1.0..=LONGEST_SECONDS).contains(&self.seconds) {
            return Err(QuakeError::Seconds { seconds: self.seconds, most: LONGEST_SECONDS });
        }
        Ok(())
    }
}

/// Where an object was over time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    /// Which.
    pub id: String,
    /// Whether it moves by itself.
    pub motion: Motion,
    /// Mass, kilograms.
    pub mass_kg: f64,
    /// Friction against dry wood.
    pub friction: f64,
    /// Farthest from its place at any time, room frame, metres.
    pub farthest_m: f64,
    /// Distance from its place at the end, room frame, metres.
    pub moved_m: f64,
    /// Tilt at the end, degrees.
    pub tilt_deg: f64,
    /// Whether it lies at the end.
    pub toppled: bool,
    /// Whether it is lower at the end.
    pub fallen: bool,
    /// Places of its origin, room frame, metres; one a frame, none for what does not move by itself.
    pub positions: Vec<[f64; 3]>,
    /// Rotations x, y, z, w likewise.
    pub rotations: Vec<[f64; 4]>,
}

impl Trajectory {
    /// Where it is at a frame; `None` for what does not move by itself.
    pub fn at(&self, frame: usize) -> Option<Placed> {
        let position = self.positions.get(frame)?;
        Some(Placed { position: Vec3::from_array(*position), rotation: *self.rotations.get(frame)? })
    }
}

/// An earthquake as it went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shaken {
    /// What was asked for.
    pub quake: Quake,
    /// Peak ground acceleration, m/s2.
    pub peak_acceleration: f64,
    /// Frames a second; the first is before the first step.
    pub frames_per_second: usize,
    /// Displacement of the ground at each frame, metres.
    pub ground: Vec<[f64; 3]>,
    /// In the scene's order.
    pub objects: Vec<Trajectory>,
}

impl Shaken {
    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.ground.len()
    }
}

/// Shakes a scene.
///
/// # Errors
/// [`QuakeError`].
pub fn shake(scene: &Scene, bodies: &Bodies, quake: &Quake) -> Result<Shaken, QuakeError> {
    quake.check()?;
    let start = places(scene);
    let motion = GroundMotion::new(quake.intensity, quake.seconds, quake.seed);
    let mut world = World::new(bodies, &start, true);
    let per_frame = (1.0 / (STEP * FRAMES_PER_SECOND as f64)).round() as usize;
    let frames = (quake.seconds * FRAMES_PER_SECOND as f64).round() as usize + 1;
    let mut ground = Vec::with_capacity(frames);
    let mut tracks: Vec<Vec<Placed>> = vec![Vec::with_capacity(frames); start.len()];
    let mut step = 0_u64;
    let mut displacement = Vec3::ZERO;
    for frame in 0..frames {
        if frame > 0 {
            for _ in 0..per_frame {
                step += 1;
                displacement = motion.at(step as f64 * STEP).displacement;
                world.step(Some(displacement));
            }
        }
        ground.push(rounded(displacement));
        for (k, track) in tracks.iter_mut().enumerate() {
            let place = if frame == 0 { start[k] } else { world.place(k) };
            let room =
                Placed { position: place.position - if frame == 0 { Vec3::ZERO } else { displacement }, ..place };
            // What is no longer a number (a solver's failure) stays where it last was.
            let sound = room.position.is_finite() && room.rotation.iter().all(|v| v.is_finite());
            track.push(if sound { room } else { track.last().copied().unwrap_or(start[k]) });
        }
    }
    let objects = bodies.objects.iter().zip(&tracks).map(|(body, track)| trajectory(body, track)).collect();
    Ok(Shaken {
        quake: *quake,
        peak_acceleration: peak_acceleration(quake.intensity),
        frames_per_second: FRAMES_PER_SECOND,
        ground,
        objects,
    })
}

fn trajectory(body: &crate::Body, track: &[Placed]) -> Trajectory {
    let (first, last) = (track[0], track[track.len() - 1]);
    let moves = body.motion == Motion::Dynamic;
    let away = |p: &Placed| p.position.distance(first.position);
    let tilt_deg = last.tilt().to_degrees();
    Trajectory {
        id: body.id.clone(),
        motion: body.motion,
        mass_kg: body.mass_kg,
        friction: body.friction,
        farthest_m: if moves { track.iter().map(away).fold(0.0, f64::max) } else { 0.0 },
        moved_m: if moves { away(&last) } else { 0.0 },
        tilt_deg,
        toppled: moves && tilt_deg > TOPPLED_DEG,
        fallen: moves && first.position.y - last.position.y > FALLEN_M,
        positions: if moves { track.iter().map(|p| rounded(p.position)).collect() } else { Vec::new() },
        rotations: if moves { continuous(track) } else { Vec::new() },
    }
}

/// Rotations as players of animations want them: the shorter way from each to the next.
fn continuous(track: &[Placed]) -> Vec<[f64; 4]> {
    let mut out: Vec<[f64; 4]> = Vec::with_capacity(track.len());
    for place in track {
        let mut q = place.rotation;
        if let Some(before) = out.last() {
            let dot: f64 = before.iter().zip(&q).map(|(a, b)| a * b).sum();
            if dot < 0.0 {
                q = q.map(|v| -v);
            }
        }
        out.push(q.map(|v| (v * 1e7).round() / 1e7));
    }
    out
}

/// To the hundredth of a millimetre.
fn rounded(v: Vec3) -> [f64; 3] {
    v.to_array().map(|x| (x * 1e5).round() / 1e5 + 0.0)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use harmony_mesh::Mesh;
    use harmony_scene::{ObjectId, SceneObject, Support};

    use super::*;
    use crate::bodies::{BodySettings, bodies};
    use crate::testing::{cuboid, scene};

    fn shaken(things: Vec<(SceneObject, Arc<Mesh>)>, intensity: f64, seconds: f64) -> Shaken {
        let meshes: BTreeMap<ObjectId, Arc<Mesh>> = things.iter().map(|(o, m)| (o.id.clone(), Arc::clone(m))).collect();
        let scene = scene(things.into_iter().map(|(o, _)| o).collect());
        let bodies = bodies(&scene, &meshes, &BodySettings::default()).unwrap();
        shake(&scene, &bodies, &Quake { intensity, seconds, seed: 5 }).unwrap()
    }

    fn tall_and_flat() -> Vec<(SceneObject, Arc<Mesh>)> {
        vec![
            cuboid("shelf_01", "bookshelf", Vec3::new(0.8, 2.0, 0.25), Vec3::new(1.2, 0.0, 2.0), Support::Floor),
            cuboid("sofa_01", "sofa", Vec3::new(2.0, 0.7, 0.9), Vec3::new(3.5, 0.0, 2.0), Support::Floor),
        ]
    }

    #[test]
    fn tall_things_topple_and_flat_ones_stand() {
        // A block tips when the acceleration exceeds g times its depth over its height: 0.125 g for the shelf, 1.3 g for
        // the sofa, which slides instead; at intensity 9 the ground has 0.8 g.
        let found = shaken(tall_and_flat(), 9.0, 8.0);
        let [shelf, sofa] = &found.objects[..] else { panic!() };
        assert!(shelf.toppled, "{} degrees", shelf.tilt_deg);
        assert!(!sofa.toppled && sofa.tilt_deg < 3.0 && !sofa.fallen, "{} degrees", sofa.tilt_deg);
        assert!(sofa.farthest_m > 0.01, "it slides: {}", sofa.farthest_m);
        assert_eq!(found.frames(), 241);
        assert_eq!(shelf.positions.len(), 241);
    }

    #[test]
    fn a_weak_one_moves_nothing() {
        let found = shaken(tall_and_flat(), 3.0, 4.0);
        assert!(
            found.objects.iter().all(|o| o.farthest_m < 0.005 && o.tilt_deg < 0.5),
            "{:?}",
            found.objects.iter().map(|o| (o.farthest_m, o.tilt_deg)).collect::<Vec<_>>()
        );
    }

    #[test]
    fn what_does_not_move_has_no_trajectory_and_seeds_repeat() {
        let mut things = tall_and_flat();
        let (mut rug, mesh) =
            cuboid("rug_01", "rug", Vec3::new(2.0, 0.01, 1.0), Vec3::new(2.0, 0.0, 1.0), Support::Floor);
        rug.label = "rug".into();
        things.push((rug, mesh));
        let a = shaken(things.clone(), 8.0, 3.0);
        assert!(
            a.objects[2].motion == Motion::Static && a.objects[2].positions.is_empty() && a.objects[2].at(0).is_none()
        );
        assert_eq!(serde_json::to_string(&a).unwrap(), serde_json::to_string(&shaken(things, 8.0, 3.0)).unwrap());
    }

    #[test]
    fn impossible_earthquakes_are_refused() {
        let bad = |intensity, seconds| Quake { intensity, seconds, seed: 0 }.check().unwrap_err().to_string();
        assert!(bad(13.0, 10.0).contains("Mercalli") && bad(f64::NAN, 10.0).contains("Mercalli"));
        assert!(bad(8.0, 0.0).contains("0 s") && bad(8.0, 1e9).contains("120"));
        assert!(Quake { intensity: 8.0, seconds: 10.0, seed: 0 }.check().is_ok());
    }
}
