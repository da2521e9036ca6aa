//! The scene in the simulator: rapier's world with the room, what is fixed to it, and what moves.
//!
//! The room's frame is the simulator's: metres, +Y up, gravity along -Y. Everything that does not move belongs to one body,
//! which is fixed, or moved with the ground. Sleeping is off: what creeps is seen to creep.
//!
//! Steps are [`STEP`] seconds. Contacts are the soft ones of rapier with a low speed of correction, so that colliders that
//! begin inside each other are pushed apart gently instead of thrown. Pair friction and restitution are the mean of both.

use harmony_scene::{Pose, Vec3};
use rapier3d::dynamics::FrictionModel;
use rapier3d::math::{Matrix, Pose as RapierPose, Rotation, Vector};
use rapier3d::prelude::{
    ColliderBuilder, MassProperties, NarrowPhase, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle, SharedShape,
};

use crate::bodies::{Bodies, Body};
use crate::contact::WholeFaces;
use crate::hull::Hull;
use crate::matter::Motion;

/// Length of a step, seconds.
pub const STEP: f64 = 1.0 / 480.0;
/// Gravity, m/s2.
pub const GRAVITY: f64 = 9.81;
/// Friction of the room's faces against dry wood.
const ROOM_FRICTION: f64 = 0.5;
/// Fastest correction of colliders inside each other, m/s.
const CORRECTION: f32 = 0.5;
/// Damping of rotations in a room that stands still, 1/s. Rolling and spinning meet no resistance in the solver: small
/// things on flat bases rock themselves up over seconds. What falls over still does.
const ROLLING: f32 = 2.0;
/// Solver iterations a step.
const ITERATIONS: usize = 8;

/// Where a body is: rotation as a unit quaternion x, y, z, w, and the place of its object frame's origin.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Placed {
    /// Metres.
    pub position: Vec3,
    /// x, y, z, w.
    pub rotation: [f64; 4],
}

impl Placed {
    /// A pose of the scene.
    pub fn of(pose: &Pose) -> Self {
        let half = pose.yaw / 2.0;
        Self { position: pose.position, rotation: [0.0, libm::sin(half), 0.0, libm::cos(half)] }
    }

    /// A vector of the object frame in the room.
    pub fn turned(&self, v: Vec3) -> Vec3 {
        let [x, y, z, w] = self.rotation;
        let q = Vec3::new(x, y, z);
        v + q.cross(q.cross(v) + v * w) * 2.0
    }

    /// A point of the object frame in the room.
    pub fn point(&self, p: Vec3) -> Vec3 {
        self.position + self.turned(p)
    }

    /// Angle between the object's up and the room's, radians.
    pub fn tilt(&self) -> f64 {
        let up = self.turned(Vec3::Y).normalize_or(Vec3::Y);
        // Exact for small angles, unlike the arc cosine.
        up.x.hypot(up.z).atan2(up.y)
    }

    /// Turn about +Y of the object's front, radians.
    pub fn yaw(&self) -> f64 {
        let front = self.turned(Vec3::Z);
        front.x.atan2(front.z)
    }

    fn to_rapier(self) -> RapierPose {
        let [x, y, z, w] = self.rotation.map(|v| v as f32);
        RapierPose::from_parts(vector(self.position), Rotation::from_xyzw(x, y, z, w))
    }

    fn from_rapier(pose: &RapierPose) -> Self {
        let (t, r) = (pose.translation, pose.rotation);
        Self {
            position: Vec3::new(t.x.into(), t.y.into(), t.z.into()),
            rotation: [r.x.into(), r.y.into(), r.z.into(), r.w.into()],
        }
    }
}

pub(crate) fn vector(v: Vec3) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

/// A convex shape of a hull, in its frame.
pub(crate) fn shape(hull: &Hull) -> Option<SharedShape> {
    let points: Vec<Vector> = hull.vertices.iter().map(|v| vector(*v)).collect();
    SharedShape::convex_mesh(points.clone(), &hull.faces).or_else(|| SharedShape::convex_hull(&points))
}

/// What touches what: an object by its number, or the room by the number of its face.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Touched {
    /// In the scene's order.
    Object(usize),
    /// In the order of the shell.
    Face(usize),
}

/// A running simulation.
pub(crate) struct World {
    physics: PhysicsWorld,
    room: RigidBodyHandle,
    objects: Vec<Option<RigidBodyHandle>>,
    still: Vec<Placed>,
}

impl World {
    /// Bodies at their places; `moving_room` when the ground will move.
    pub(crate) fn new(bodies: &Bodies, places: &[Placed], moving_room: bool) -> Self {
        let mut physics = PhysicsWorld::new();
        physics.narrow_phase = NarrowPhase::with_query_dispatcher(WholeFaces);
        physics.gravity = Vector::new(0.0, -GRAVITY as f32, 0.0);
        let p = &mut physics.integration_parameters;
        p.dt = STEP as f32;
        p.min_ccd_dt = STEP as f32 / 100.0;
        p.num_solver_iterations = ITERATIONS;
        p.normalized_allowed_linear_error = 0.0005;
        p.normalized_max_corrective_velocity = CORRECTION;
        p.normalized_prediction_distance = 0.005;
        // The default model; with the exact cone small things on flat bases rock themselves up.
        p.friction_model = FrictionModel::Simplified;
        // Without it what stands on something that moves creeps.
        p.friction_in_bias_pass = true;
        // Recycled contacts are stale by centimetres: too much for a cup.
        p.contact_recycling = false;
        let room = if moving_room { RigidBodyBuilder::kinematic_position_based() } else { RigidBodyBuilder::fixed() };
        let room = physics.insert_body(room.can_sleep(false));
        for (number, (_, hulls)) in bodies.shell.iter().enumerate() {
            for shape in hulls.iter().filter_map(shape) {
                let collider = ColliderBuilder::new(shape)
                    .friction(ROOM_FRICTION as f32)
                    .restitution(0.0)
                    .density(0.0)
                    .user_data(code(Touched::Face(number)));
                physics.insert_collider(collider, Some(room));
            }
        }
        let mut objects = Vec::with_capacity(bodies.objects.len());
        for (number, (body, place)) in bodies.objects.iter().zip(places).enumerate() {
            let Some(collider) = collider(body) else {
                objects.push(None);
                continue;
            };
            let collider = collider.user_data(code(Touched::Object(number)));
            if body.motion == Motion::Static {
                physics.insert_collider(collider.position(place.to_rapier()), Some(room));
                objects.push(None);
            } else {
                let rigid = RigidBodyBuilder::dynamic()
                    .pose(place.to_rapier())
                    .additional_mass_properties(mass_properties(body))
                    .can_sleep(false)
                    .angular_damping(if moving_room { 0.0 } else { ROLLING })
                    .ccd_enabled(true);
                let handle = physics.insert_body(rigid);
                physics.insert_collider(collider, Some(handle));
                objects.push(Some(handle));
            }
        }
        Self { physics, room, objects, still: places.to_vec() }
    }

    /// One step; the room is at `displacement` at its end.
    pub(crate) fn step(&mut self, displacement: Option<Vec3>) {
        if let (Some(at), Some(room)) = (displacement, self.physics.bodies.get_mut(self.room)) {
            room.set_next_kinematic_translation(vector(at));
        }
        self.physics.step();
    }

    /// Where an object is now, in the frame that does not move.
    pub(crate) fn place(&self, object: usize) -> Placed {
        let still = self.still[object];
        if let Some(body) = self.objects[object].and_then(|h| self.physics.bodies.get(h)) {
            return Placed::from_rapier(body.position());
        }
        let moved = self.physics.bodies.get(self.room).map_or(Vec3::ZERO, |room| {
            let t = room.translation();
            Vec3::new(t.x.into(), t.y.into(), t.z.into())
        });
        Placed { position: still.position + moved, ..still }
    }

    /// Speed of an object's centre of mass, m/s; 0 for what does not move by itself.
    pub(crate) fn speed(&self, object: usize) -> f64 {
        let body = self.objects[object].and_then(|h| self.physics.bodies.get(h));
        body.map_or(0.0, |b| f64::from(b.linvel().length()))
    }

    /// Pairs that touch now (closer than `near` metres), each once, in order.
    pub(crate) fn contacts(&self, near: f32) -> Vec<(Touched, Touched)> {
        let mut out = Vec::new();
        for pair in self.physics.contact_pairs() {
            let (Some(a), Some(b)) =
                (self.physics.colliders.get(pair.collider1), self.physics.colliders.get(pair.collider2))
            else {
                continue;
            };
            let touching = pair.manifolds().iter().flat_map(|m| &m.points).any(|p| p.dist < near);
            if touching {
                let (a, b) = (touched(a.user_data), touched(b.user_data));
                out.push((a.min(b), a.max(b)));
            }
        }
        out.sort_unstable();
        out.dedup();
        out
    }
}

fn code(what: Touched) -> u128 {
    match what {
        Touched::Object(k) => k as u128,
        Touched::Face(k) => (1 << 64) | k as u128,
    }
}

fn touched(code: u128) -> Touched {
    let low = (code & u128::from(u64::MAX)) as usize;
    if code >> 64 == 0 { Touched::Object(low) } else { Touched::Face(low) }
}

fn collider(body: &Body) -> Option<ColliderBuilder> {
    let mut shapes: Vec<(RapierPose, SharedShape)> =
        body.hulls.iter().filter_map(shape).map(|s| (RapierPose::identity(), s)).collect();
    let shape = if shapes.len() == 1 { shapes.remove(0).1 } else { SharedShape::compound(shapes_or_none(shapes)?) };
    Some(ColliderBuilder::new(shape).density(0.0).friction(body.friction as f32).restitution(body.restitution as f32))
}

fn shapes_or_none(shapes: Vec<(RapierPose, SharedShape)>) -> Option<Vec<(RapierPose, SharedShape)>> {
    (!shapes.is_empty()).then_some(shapes)
}

fn mass_properties(body: &Body) -> MassProperties {
    let m = body.inertia_matrix();
    let inertia = Matrix::from_cols(vector(m.x_axis), vector(m.y_axis), vector(m.z_axis));
    MassProperties::with_inertia_matrix(vector(body.centre_of_mass), body.mass_kg as f32, inertia)
}
