//! Inverse kinematics: damped least squares with strict priorities.
//!
//! # Idea
//! Goals of a lower level never disturb those of a higher one: each level is solved in what the levels above leave free
//! (Siciliano and Slotine 1991, "A general framework for managing multiple tasks in highly redundant robotic systems"),
//! with damping near singular postures (Nakamura and Hanafusa 1986; Wampler 1986) that fades with what is left of the error
//! (Sugihara 2011, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method"): a goal that can be reached
//! is reached as fast where the posture is nearly singular, as two flat feet on legs with one ankle joint are. A joint at its limit that would leave it
//! is locked and the step solved again, so that limits hold in every posture that comes out.
//!
//! # Frames
//! Goals are in the room; unknowns are the six of a floating root (translation, then turn about the room's axes at the
//! root's origin) and one a joint.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

use crate::model::{JointKind, Model, Posture, rotation_vector};

/// What is wanted of a link.
#[derive(Debug, Clone)]
pub enum Goal {
    /// A point of a link is somewhere.
    Point {
        /// The link.
        link: usize,
        /// Link frame.
        point: DVec3,
        /// Room.
        target: DVec3,
    },
    /// A link is turned as `room_from_link`.
    Turn {
        /// The link.
        link: usize,
        /// Room.
        target: DMat3,
    },
    /// A direction of a link points along one of the room; turning about it is free.
    Along {
        /// The link.
        link: usize,
        /// Unit, link frame.
        axis: DVec3,
        /// Unit, room.
        target: DVec3,
    },
    /// The centre of mass is above a point of the floor (x and z of the target).
    CentreOfMass {
        /// Room.
        target: DVec3,
    },
    /// Joints are near these values, as far as nothing else is asked; the level does not matter.
    Joints {
        /// One a joint.
        target: Vec<f64>,
    },
}

/// A goal with its level.
#[derive(Debug, Clone)]
pub struct Task {
    /// What is wanted.
    pub goal: Goal,
    /// 0 is served first.
    pub level: usize,
    /// Weight of x, y and z; what is 0 is not asked for. It says nothing for joints.
    pub weight: DVec3,
}

impl Task {
    /// All of a goal.
    pub fn new(level: usize, goal: Goal) -> Self {
        Self { goal, level, weight: DVec3::ONE }
    }

    /// A goal in some directions of the room.
    pub fn weighted(level: usize, goal: Goal, weight: DVec3) -> Self {
        Self { goal, level, weight }
    }
}

/// How a posture is sought.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Most steps.
    pub steps: usize,
    /// Goals of levels below this must be reached.
    pub must: usize,
    /// Within this, metres and radians.
    pub tolerance: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { steps: 120, must: 1, tolerance: 1e-4 }
    }
}

/// What came of it.
#[derive(Debug, Clone)]
pub struct Found {
    /// The posture.
    pub posture: Posture,
    /// Largest error of the goals that must be reached, metres or radians.
    pub error: f64,
    /// Steps that were made.
    pub steps: usize,
}

impl Found {
    /// Whether all that must be reached is.
    pub fn reached(&self, settings: &Settings) -> bool {
        self.error <= settings.tolerance
    }
}

/// Most damping of the pseudo-inverse.
const DAMPING: f64 = 0.02;
/// Singular values below this leave their direction to the next level.
const SMALL: f64 = 1e-3;
/// Longest step of an unknown, radians or metres.
const LONGEST: f64 = 0.25;
/// Share of the way to the easy posture that a step goes.
const EASE: f64 = 0.3;
/// Steps smaller than this end the search.
const STILL: f64 = 1e-7;
/// The same once all that must be reached is.
const SETTLED: f64 = 2e-4;

/// Seeks a posture from a first one.
pub fn solve(model: &Model, start: &Posture, tasks: &[Task], settings: &Settings) -> Found {
    let mut posture = start.clone();
    for (joint, value) in model.joints.iter().zip(&mut posture.joints) {
        *value = joint.clamped(*value);
    }
    let levels = tasks.iter().map(|t| t.level).max().map_or(0, |l| l + 1);
    let chains = Chains::of(model);
    let mut best = Found { error: f64::INFINITY, posture: posture.clone(), steps: 0 };
    for step in 0..=settings.steps {
        let rows = Rows::new(model, &chains, &posture, tasks, levels);
        let error = rows.worst(settings.must);
        if error < best.error || error <= settings.tolerance {
            best = Found { posture: posture.clone(), error, steps: step };
        }
        if step == settings.steps {
            break;
        }
        // What is only wished for must not keep the rest from its goal.
        let strict = error > settings.tolerance && step >= settings.steps / 2;
        let rows = if strict { rows.without_wishes(settings.must) } else { rows };
        let change = rows.change(model, &posture);
        let largest = change.amax();
        if largest < if error <= settings.tolerance { SETTLED } else { STILL } {
            break;
        }
        apply(model, &mut posture, &(change * (LONGEST / largest).min(1.0)));
    }
    best
}

/// Moves a posture by a step of the unknowns.
fn apply(model: &Model, posture: &mut Posture, change: &DVector<f64>) {
    let free = first_joint(model);
    if free > 0 {
        let v = |k: usize| DVec3::new(change[k], change[k + 1], change[k + 2]);
        let turn = v(3);
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(turn));
        // Orthonormal again, so that a thousand steps leave a rotation.
        let turned = DQuat::from_mat3(&(turn * posture.root.matrix3)).normalize();
        posture.root = DAffine3::from_rotation_translation(turned, posture.root.translation + v(0));
    }
    for (k, (joint, value)) in model.joints.iter().zip(&mut posture.joints).enumerate() {
        *value = joint.clamped(*value + change[free + k]);
    }
}

fn first_joint(model: &Model) -> usize {
    if model.floating { 6 } else { 0 }
}

/// What hangs on what, looked up once for all steps of a search.
struct Chains {
    /// By link: the joints that move it.
    joints: Vec<Vec<usize>>,
    /// Kilograms of all links.
    mass: f64,
}

impl Chains {
    fn of(model: &Model) -> Self {
        let mut joints: Vec<Vec<usize>> = Vec::with_capacity(model.links.len());
        for link in &model.links {
            let mut own = link.parent.map_or_else(Vec::new, |p| joints[p].clone());
            own.extend(link.joint);
            joints.push(own);
        }
        Self { joints, mass: model.mass().max(1e-9) }
    }
}

/// Jacobian and error of every level.
struct Rows {
    levels: Vec<(DMatrix<f64>, DVector<f64>)>,
    /// Change of all unknowns that an easy posture asks for, below all levels.
    wish: Option<DVector<f64>>,
}

impl Rows {
    fn new(model: &Model, chains: &Chains, posture: &Posture, tasks: &[Task], levels: usize) -> Self {
        let places = model.places(posture);
        let unknowns = first_joint(model) + model.joints.len();
        let levels = (0..levels)
            .map(|level| {
                let mut jacobian: Vec<f64> = Vec::new();
                let mut error: Vec<f64> = Vec::new();
                for task in tasks.iter().filter(|t| t.level == level) {
                    rows(model, chains, posture, &places, task, &mut jacobian, &mut error);
                }
                let n = error.len();
                (DMatrix::from_row_iterator(n, unknowns, jacobian), DVector::from_vec(error))
            })
            .collect();
        let wish = tasks.iter().find_map(|t| match &t.goal {
            Goal::Joints { target } => {
                let mut wish = DVector::zeros(unknowns);
                for (k, (want, value)) in target.iter().zip(&posture.joints).enumerate() {
                    wish[first_joint(model) + k] = want - value;
                }
                Some(wish)
            }
            _ => None,
        });
        Self { levels, wish }
    }

    /// Largest error below a level.
    fn worst(&self, must: usize) -> f64 {
        self.levels.iter().take(must).filter(|(_, e)| !e.is_empty()).map(|(_, e)| e.amax()).fold(0.0, f64::max)
    }

    /// Only what must be reached.
    fn without_wishes(mut self, must: usize) -> Self {
        self.levels.truncate(must);
        self.wish = None;
        self
    }

    /// The step of all unknowns.
    fn change(&self, model: &Model, posture: &Posture) -> DVector<f64> {
        let free = first_joint(model);
        let unknowns = free + model.joints.len();
        let mut locked = vec![false; unknowns];
        loop {
            let change = self.step(&locked, unknowns);
            let mut any = false;
            for (k, (joint, value)) in model.joints.iter().zip(&posture.joints).enumerate() {
                let d = change[free + k];
                let leaves = (*value <= joint.range[0] && d < -STILL) || (*value >= joint.range[1] && d > STILL);
                if leaves && !locked[free + k] {
                    locked[free + k] = true;
                    any = true;
                }
            }
            if !any {
                return change;
            }
        }
    }

    fn step(&self, locked: &[bool], unknowns: usize) -> DVector<f64> {
        let mut change = DVector::zeros(unknowns);
        // Orthonormal directions that the levels above have taken.
        let mut taken: Vec<DVector<f64>> = Vec::new();
        for (jacobian, error) in &self.levels {
            if error.is_empty() {
                continue;
            }
            let mut reduced = jacobian.clone();
            for (k, _) in locked.iter().enumerate().filter(|(_, l)| **l) {
                reduced.column_mut(k).fill(0.0);
            }
            for direction in &taken {
                let along = &reduced * direction;
                reduced.ger(-1.0, &along, direction, 1.0);
            }
            let left = error - jacobian * &change;
            // Singular values and vectors by the eigenvectors of the small square J J^T: a level has few rows.
            let eigen = SymmetricEigen::new(&reduced * reduced.transpose());
            let damping = (left.norm_squared() / 2.0).min(DAMPING * DAMPING);
            for (k, squared) in eigen.eigenvalues.iter().enumerate() {
                let s = squared.max(0.0).sqrt();
                if s <= SMALL {
                    continue;
                }
                let u = eigen.eigenvectors.column(k);
                let v = reduced.tr_mul(&u) / s;
                let along = u.dot(&left) * s / (s * s + damping * damping_share(s));
                change.axpy(along, &v, 1.0);
                taken.push(v);
            }
        }
        // What nothing else asks for goes to the easy posture: its Jacobian is the identity, and its answer in what is left
        // free is the projection.
        if let Some(wish) = &self.wish {
            let mut left = (wish - &change) * EASE;
            for (k, _) in locked.iter().enumerate().filter(|(_, l)| **l) {
                left[k] = 0.0;
            }
            for direction in &taken {
                left.axpy(-direction.dot(&left), direction, 1.0);
            }
            change += left;
        }
        change
    }
}

/// Damping grows as a singular value falls below 0.1: well-posed directions converge as fast as without.
fn damping_share(singular: f64) -> f64 {
    (1.0 - (singular / 0.1).min(1.0)).max(1e-6)
}

/// Rows of one task.
fn rows(
    model: &Model,
    chains: &Chains,
    posture: &Posture,
    places: &[DAffine3],
    task: &Task,
    jacobian: &mut Vec<f64>,
    error: &mut Vec<f64>,
) {
    let mut take = |miss: DVec3, columns: &[DVec3]| {
        for axis in 0..3 {
            let w = task.weight[axis];
            if w != 0.0 {
                error.push(w * miss[axis]);
                jacobian.extend(columns.iter().map(|c| w * c[axis]));
            }
        }
    };
    match &task.goal {
        Goal::Point { link, point, target } => {
            let at = places[*link].transform_point3(*point);
            take(*target - at, &linear(model, &chains.joints[*link], posture, places, at));
        }
        Goal::Turn { link, target } => {
            let miss = rotation_vector(*target * places[*link].matrix3.transpose());
            take(miss, &angular(model, &chains.joints[*link], places));
        }
        Goal::Along { link, axis, target } => {
            let now = places[*link].transform_vector3(*axis);
            let cross = now.cross(*target);
            let angle = cross.length().atan2(now.dot(*target));
            // Opposite directions: any turn out of there.
            let way = cross.try_normalize().unwrap_or_else(|| now.any_orthonormal_vector());
            // Only the part across the direction counts.
            let mut columns = angular(model, &chains.joints[*link], places);
            for w in &mut columns {
                *w -= now * w.dot(now);
            }
            take(way * angle, &columns);
        }
        Goal::CentreOfMass { target } => {
            let miss = *target - model.centre_of_mass(places);
            let columns = centre_of_mass(model, chains, posture, places);
            for axis in [0, 2] {
                error.push(task.weight[axis] * miss[axis]);
                jacobian.extend(columns.iter().map(|c| task.weight[axis] * c[axis]));
            }
        }
        // Below all levels: see [`Rows::step`].
        Goal::Joints { .. } => {}
    }
}

/// How a point at a place moves with a joint.
fn moved(model: &Model, joint: usize, places: &[DAffine3], at: DVec3) -> DVec3 {
    let joint = &model.joints[joint];
    let place = places[joint.link];
    let axis = place.transform_vector3(joint.axis);
    match joint.kind {
        JointKind::Slide => axis,
        JointKind::Hinge => axis.cross(at - place.transform_point3(joint.anchor)),
    }
}

/// How what hangs on a floating root moves with it: nothing for one that stands.
fn with_root(model: &Model, posture: &Posture, at: DVec3) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(6 + model.joints.len());
    if model.floating {
        out.extend([DVec3::X, DVec3::Y, DVec3::Z]);
        out.extend([DVec3::X, DVec3::Y, DVec3::Z].map(|a| a.cross(at - posture.root.translation)));
    }
    out
}

/// How a point of a link that these joints move moves with each unknown.
fn linear(model: &Model, joints: &[usize], posture: &Posture, places: &[DAffine3], at: DVec3) -> Vec<DVec3> {
    let mut out = with_root(model, posture, at);
    let free = out.len();
    out.resize(free + model.joints.len(), DVec3::ZERO);
    for k in joints {
        out[free + k] = moved(model, *k, places, at);
    }
    out
}

/// How the centre of mass moves with each unknown: a joint moves that of all that hangs on it.
fn centre_of_mass(model: &Model, chains: &Chains, posture: &Posture, places: &[DAffine3]) -> Vec<DVec3> {
    // By joint: mass, and mass times place, of what it moves.
    let mut hanging = vec![(0.0, DVec3::ZERO); model.joints.len()];
    let mut all = DVec3::ZERO;
    for (k, link) in model.links.iter().enumerate().filter(|(_, l)| l.mass > 0.0) {
        let moment = places[k].transform_point3(link.centre) * link.mass;
        all += moment;
        for joint in &chains.joints[k] {
            hanging[*joint].0 += link.mass;
            hanging[*joint].1 += moment;
        }
    }
    let mut out = with_root(model, posture, all / chains.mass);
    out.extend(hanging.iter().enumerate().map(|(k, (mass, moment))| {
        if *mass > 0.0 { moved(model, k, places, *moment / *mass) * (*mass / chains.mass) } else { DVec3::ZERO }
    }));
    out
}

/// How a link that these joints move turns with each unknown.
fn angular(model: &Model, joints: &[usize], places: &[DAffine3]) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(6 + model.joints.len());
    if model.floating {
        out.extend([DVec3::ZERO; 3]);
        out.extend([DVec3::X, DVec3::Y, DVec3::Z]);
    }
    let free = out.len();
    out.resize(free + model.joints.len(), DVec3::ZERO);
    for k in joints.iter().filter(|k| model.joints[**k].kind == JointKind::Hinge) {
        let joint = &model.joints[*k];
        out[free + k] = places[joint.link].transform_vector3(joint.axis);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::tests::arm;

    fn start() -> Posture {
        Posture { root: DAffine3::IDENTITY, joints: vec![0.2, 0.4] }
    }

    fn tip(target: DVec3, level: usize) -> Task {
        Task::weighted(level, Goal::Point { link: 2, point: DVec3::X, target }, DVec3::new(1.0, 1.0, 0.0))
    }

    /// Nearly straight, a hand's goal on the line of the arm moves the joints by the root of its way: with constant damping
    /// that took hundreds of steps, and what stood on such a goal (a humanoid's feet) was never met.
    #[test]
    fn a_goal_near_a_straight_arm_is_reached_in_few_steps() {
        let model = arm();
        let start = Posture { root: DAffine3::IDENTITY, joints: vec![0.002, -0.004] };
        let target = DVec3::X * 1.9999;
        let found = solve(&model, &start, &[tip(target, 0)], &Settings { steps: 40, must: 1, tolerance: 1e-8 });
        assert!(found.error < 1e-8 && found.steps < 25, "{} after {}", found.error, found.steps);
    }

    #[test]
    fn jacobians_are_those_of_finite_differences() {
        let mut model = arm();
        model.floating = true;
        let turn = DQuat::from_rotation_x(0.4) * DQuat::from_rotation_z(-0.7);
        let posture = Posture {
            root: DAffine3::from_rotation_translation(turn, DVec3::new(0.3, -0.2, 0.9)),
            joints: vec![0.3, -0.8],
        };
        let goals = [
            Goal::Point { link: 2, point: DVec3::new(0.7, 0.1, 0.2), target: DVec3::new(1.0, 0.5, 0.2) },
            Goal::CentreOfMass { target: DVec3::new(0.4, 0.0, 0.1) },
        ];
        for goal in goals {
            let task = [Task::new(0, goal)];
            let base = Rows::new(&model, &Chains::of(&model), &posture, &task, 1);
            let (jacobian, error) = &base.levels[0];
            for k in 0..8 {
                let mut step = DVector::zeros(8);
                step[k] = 1e-6;
                let mut moved = posture.clone();
                apply(&model, &mut moved, &step);
                let after = &Rows::new(&model, &Chains::of(&model), &moved, &task, 1).levels[0].1;
                for r in 0..error.len() {
                    let slope = (error[r] - after[r]) / 1e-6;
                    assert!((slope - jacobian[(r, k)]).abs() < 1e-5, "{:?} {r} {k}: {slope}", task[0].goal);
                }
            }
        }
    }

    #[test]
    fn a_reachable_point_is_reached_and_an_unreachable_one_told() {
        let model = arm();
        let settings = Settings::default();
        let found = solve(&model, &start(), &[tip(DVec3::new(0.6, 1.1, 0.0), 0)], &settings);
        assert!(found.reached(&settings) && found.steps < 40, "{found:?}");
        let found = solve(&model, &start(), &[tip(DVec3::new(3.0, 0.0, 0.0), 0)], &settings);
        assert!((found.error - 1.0).abs() < 0.02, "the arm is 2 m long: {}", found.error);
    }

    #[test]
    fn limits_hold_and_the_rest_of_the_arm_does_what_it_can() {
        let mut model = arm();
        model.joints[0].range = [-0.1, 0.1];
        let found = solve(&model, &start(), &[tip(DVec3::new(0.0, 1.5, 0.0), 0)], &Settings::default());
        let q = &found.posture.joints;
        assert!(q[0] <= 0.1 && q[1] <= 2.5, "{q:?}");
        // The nearest with the shoulder at 0.1: the forearm points at the target from the elbow.
        let elbow = DVec3::new(0.1_f64.cos(), 0.1_f64.sin(), 0.0);
        let want = (DVec3::new(0.0, 1.5, 0.0) - elbow).normalize();
        let have = DVec3::new((q[0] + q[1]).cos(), (q[0] + q[1]).sin(), 0.0);
        assert!(have.dot(want) > 0.99, "{have} {want}");
    }

    #[test]
    fn a_lower_level_never_disturbs_a_higher_one() {
        let model = arm();
        let reach = tip(DVec3::new(0.6, 1.1, 0.0), 0);
        let pull = Task::new(1, Goal::Joints { target: vec![-2.0, -2.0] });
        let found = solve(&model, &start(), &[reach, pull], &Settings::default());
        assert!(found.error < 1e-4, "{}", found.error);
        // Alone in its plane: x by the first level, and y as near as the second can.
        let x =
            Task::weighted(0, Goal::Point { link: 2, point: DVec3::X, target: DVec3::new(1.2, 0.0, 0.0) }, DVec3::X);
        let y =
            Task::weighted(1, Goal::Point { link: 2, point: DVec3::X, target: DVec3::new(0.0, 5.0, 0.0) }, DVec3::Y);
        let found = solve(&model, &start(), &[x, y], &Settings { steps: 300, ..Settings::default() });
        let at = model.places(&found.posture)[2].transform_point3(DVec3::X);
        assert!((at.x - 1.2).abs() < 1e-3 && (at.y - 1.6).abs() < 0.02, "{at}: the circle of 2 m at x = 1.2");
    }
}
