//! A robot as a tree of links, and where they are.
//!
//! # Frames
//! A **link frame** is that of the model file: metres, +Z up at rest. The **room frame** is +Y up
//! (`docs/conventions.md`); [`room_from_model`] turns the one into the other. Everything that leaves this module is in the
//! room frame.
//!
//! Joints are hinges and slides, one a link at most; a root with a free joint floats.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use harmony_mesh::Mesh;

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Turns, radians.
    Hinge,
    /// Slides, metres.
    Slide,
}

/// A joint between a link and its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Unit axis, link frame.
    pub axis: DVec3,
    /// A point of the axis, link frame.
    pub anchor: DVec3,
    /// Least and largest value.
    pub range: [f64; 2],
    /// The link that it moves.
    pub link: usize,
}

/// What a geom is.
#[derive(Debug, Clone)]
pub enum Form {
    /// Triangles, geom frame.
    Mesh(Arc<Mesh>),
    /// Half sides.
    Box(DVec3),
    /// A cylinder with round ends along Z: radius, half length of the cylinder.
    Capsule(f64, f64),
    /// Radius, half length along Z.
    Cylinder(f64, f64),
    /// Radius.
    Sphere(f64),
}

/// A piece of a link's shape.
#[derive(Debug, Clone)]
pub struct Geom {
    /// Where it is in the link.
    pub link_from_geom: DAffine3,
    /// What it is.
    pub form: Form,
    /// Whether it is seen (and touches nothing) or touches.
    pub visual: bool,
    /// Linear colour.
    pub color: [f32; 3],
}

/// A rigid part.
#[derive(Debug, Clone)]
pub struct Link {
    /// Name.
    pub name: String,
    /// Its parent; always of a lower number.
    pub parent: Option<usize>,
    /// `parent_from_link` with the joint at 0.
    pub parent_from_link: DAffine3,
    /// Its joint.
    pub joint: Option<usize>,
    /// Kilograms.
    pub mass: f64,
    /// Centre of mass, link frame.
    pub centre: DVec3,
    /// About the centre of mass, axes of the link, kg m2.
    pub inertia: DMat3,
    /// Its shape.
    pub geoms: Vec<Geom>,
}

/// A robot.
#[derive(Debug, Clone)]
pub struct Model {
    /// Name in the file.
    pub name: String,
    /// Parents before children; the first is the root.
    pub links: Vec<Link>,
    /// In the order of the links.
    pub joints: Vec<Joint>,
    /// Whether the root is free to move.
    pub floating: bool,
    /// Joint values of the first keyframe of the file, when it has one.
    pub home: Option<Vec<f64>>,
}

/// A robot's configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Posture {
    /// Where the root link is, by the axes of the model: `room_from_root`.
    pub root: DAffine3,
    /// A value a joint.
    pub joints: Vec<f64>,
}

/// Turns +Z up into the room's +Y up: `(x, y, z)` becomes `(x, z, -y)`.
pub fn room_from_model() -> DMat3 {
    DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y)
}

impl Posture {
    /// An upright root at a place of the room whose +X looks along a horizontal direction, all joints at rest.
    pub fn standing(model: &Model, at: DVec3, facing: DVec3) -> Self {
        Self { root: upright(at, facing), joints: model.rest() }
    }
}

/// An upright model frame at a place of the room, its +X along a horizontal direction.
pub fn upright(at: DVec3, facing: DVec3) -> DAffine3 {
    let x = DVec3::new(facing.x, 0.0, facing.z).normalize_or(DVec3::X);
    let z = DVec3::Y;
    DAffine3::from_mat3_translation(DMat3::from_cols(x, z.cross(x), z), at)
}

impl Model {
    /// Joint values of the keyframe, else 0 held to the limits.
    pub fn rest(&self) -> Vec<f64> {
        match &self.home {
            Some(home) if home.len() == self.joints.len() => home.clone(),
            _ => self.joints.iter().map(|j| 0.0_f64.clamp(j.range[0], j.range[1])).collect(),
        }
    }

    /// A link by its name.
    pub fn link(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|l| l.name == name)
    }

    /// A joint by its name.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|j| j.name == name)
    }

    /// Kilograms of all links.
    pub fn mass(&self) -> f64 {
        self.links.iter().map(|l| l.mass).sum()
    }

    /// `room_from_link` of every link (forward kinematics).
    pub fn places(&self, posture: &Posture) -> Vec<DAffine3> {
        let mut out: Vec<DAffine3> = Vec::with_capacity(self.links.len());
        for link in &self.links {
            let base = match link.parent {
                Some(parent) => out[parent] * link.parent_from_link,
                None => posture.root,
            };
            let moved = link.joint.map_or(DAffine3::IDENTITY, |j| self.joints[j].moved(posture.joints[j]));
            out.push(base * moved);
        }
        out
    }

    /// Centre of mass in the room.
    pub fn centre_of_mass(&self, places: &[DAffine3]) -> DVec3 {
        let sum: DVec3 = self.links.iter().zip(places).map(|(l, p)| p.transform_point3(l.centre) * l.mass).sum();
        sum / self.mass().max(1e-9)
    }

    /// Smallest distance of a hinge to its limits as a share of its half range, 0 at a limit, and the joint.
    ///
    /// Slides are left out: open fingers are at their limits.
    pub fn margin(&self, joints: &[f64]) -> (f64, usize) {
        self.joints
            .iter()
            .zip(joints)
            .enumerate()
            .filter(|(_, (j, _))| j.kind == JointKind::Hinge)
            .map(|(k, (j, q))| ((q - j.range[0]).min(j.range[1] - q) / ((j.range[1] - j.range[0]) / 2.0).max(1e-9), k))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((1.0, 0))
    }
}

impl Joint {
    /// What a value of the joint does to its link.
    pub fn moved(&self, value: f64) -> DAffine3 {
        match self.kind {
            JointKind::Slide => DAffine3::from_translation(self.axis * value),
            JointKind::Hinge => {
                let turn = DQuat::from_axis_angle(self.axis, value);
                DAffine3::from_rotation_translation(turn, self.anchor - turn * self.anchor)
            }
        }
    }

    /// A value held to the limits.
    pub fn clamped(&self, value: f64) -> f64 {
        value.clamp(self.range[0], self.range[1])
    }
}

/// Moment axis-angle of a rotation, radians: what turns by it as a vector.
pub fn rotation_vector(rotation: DMat3) -> DVec3 {
    let q = DQuat::from_mat3(&rotation).normalize();
    let q = if q.w < 0.0 { -q } else { q };
    let v = DVec3::new(q.x, q.y, q.z);
    let s = v.length();
    if s < 1e-12 { v * 2.0 } else { v * (2.0 * s.atan2(q.w) / s) }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A planar arm of two hinges about Z with links of 1 m, at rest along +X, with limits.
    pub(crate) fn arm() -> Model {
        let link = |name: &str, parent, x, joint| Link {
            name: name.into(),
            parent,
            parent_from_link: DAffine3::from_translation(DVec3::new(x, 0.0, 0.0)),
            joint,
            mass: 1.0,
            centre: DVec3::new(0.5, 0.0, 0.0),
            inertia: DMat3::IDENTITY * 0.1,
            geoms: vec![],
        };
        let joint = |name: &str, link| Joint {
            name: name.into(),
            kind: JointKind::Hinge,
            axis: DVec3::Z,
            anchor: DVec3::ZERO,
            range: [-2.5, 2.5],
            link,
        };
        Model {
            name: "arm".into(),
            links: vec![
                link("base", None, 0.0, None),
                link("upper", Some(0), 0.0, Some(0)),
                link("lower", Some(1), 1.0, Some(1)),
            ],
            joints: vec![joint("one", 1), joint("two", 2)],
            floating: false,
            home: None,
        }
    }

    #[test]
    fn a_planar_arm_is_where_trigonometry_says() {
        let model = arm();
        let mut posture = Posture { root: DAffine3::IDENTITY, joints: vec![0.3, 0.5] };
        let tip = model.places(&posture)[2].transform_point3(DVec3::X);
        let want = DVec3::new(0.3_f64.cos() + 0.8_f64.cos(), 0.3_f64.sin() + 0.8_f64.sin(), 0.0);
        assert!(tip.distance(want) < 1e-12);
        posture.joints = vec![0.0, 0.0];
        let centre = model.centre_of_mass(&model.places(&posture));
        assert!(centre.distance(DVec3::new((0.5 + 0.5 + 1.5) / 3.0, 0.0, 0.0)) < 1e-12);
        assert!((model.margin(&[2.0, 0.0]).0 - 0.2).abs() < 1e-12);
    }

    #[test]
    fn upright_models_have_their_z_along_the_rooms_y() {
        let room = upright(DVec3::new(1.0, 0.5, 2.0), DVec3::new(0.0, 0.3, -2.0));
        assert!(room.transform_point3(DVec3::Z).distance(DVec3::new(1.0, 1.5, 2.0)) < 1e-12);
        assert!(room.transform_vector3(DVec3::X).distance(DVec3::NEG_Z) < 1e-12);
        assert!((room.matrix3.determinant() - 1.0).abs() < 1e-12);
        assert!((room_from_model() * DVec3::Z).distance(DVec3::Y) < 1e-12);
        let v = DVec3::new(0.3, -0.2, 0.5);
        assert!(rotation_vector(DMat3::from_axis_angle(v.normalize(), v.length())).distance(v) < 1e-9);
    }
}
