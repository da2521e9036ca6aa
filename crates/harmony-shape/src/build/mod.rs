//! From a tree to a mesh.
//!
//! Nodes are meshed level by level in their own frames, each once, however often it is used; groups, places and copies
//! only collect references to pieces. The pieces are joined at the end: one group of triangles a material, an atlas of
//! all charts, the metric texture coordinates beside it.

mod assemble;
mod blobs;
mod charts;
mod decal;
mod expand;
mod lazy;
mod look;
mod place;
mod report;
mod soft;
mod whole;

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use harmony_mesh::{ConvexPart, Material, Mesh};

use crate::Piece;
use crate::material::MaterialSpec;
use crate::soft::Hems;
use crate::tree::{JointKind, LampKind, ShapeTree, TreeError};

pub use lazy::lazy_signs;
pub use look::plain_material;

/// What a build needs to know from outside.
#[derive(Debug, Clone, Copy)]
pub struct BuildContext {
    /// Width, height and depth that the object should have, metres: the size of templates that name none.
    pub size: Option<[f64; 3]>,
    /// How a slot becomes a mesh material.
    pub material: fn(&MaterialSpec) -> Material,
}

impl Default for BuildContext {
    fn default() -> Self {
        Self { size: None, material: plain_material }
    }
}

/// What a tree becomes.
#[derive(Debug, Clone, Default)]
pub struct BuiltShape {
    /// Canonical mesh: metres, +Y up, front +Z, bottom at y = 0, centred in x and z. One group and material a used
    /// slot; `uvs` unwrap every chart to a place of its own, `metric_uvs` are lengths on the surface.
    pub mesh: Mesh,
    /// Convex pieces in the mesh's frame, for collision.
    pub convex: Vec<ConvexPart>,
    /// Slot name of each material.
    pub slots: Vec<String>,
    /// Lights, in the mesh's frame.
    pub lights: Vec<BuiltLight>,
    /// Joints, in the mesh's frame.
    pub joints: Vec<BuiltJoint>,
    /// Places on which other things may stand, in the mesh's frame.
    pub surfaces: Vec<BuiltSurface>,
    /// The named parts, in the order of the tree.
    pub parts: Vec<BuiltPart>,
    /// The tree's origin in the mesh's frame: add it to a point of the program to find the point in the mesh.
    pub origin: DVec3,
    /// Pairs of parts with faces that lay in one plane and look the same way; they stand a hair apart now.
    pub(crate) coplanar: Vec<(String, String)>,
}

/// A light of a shape.
#[derive(Debug, Clone, PartialEq)]
pub struct BuiltLight {
    /// Part it belongs to.
    pub name: String,
    /// Which.
    pub kind: LampKind,
    /// Where, metres.
    pub position: DVec3,
    /// Which way, unit (spot, area).
    pub direction: DVec3,
    /// Luminous flux, lumens.
    pub lumens: f64,
    /// Colour temperature, kelvin.
    pub kelvin: f64,
    /// Radius of the emitter, metres.
    pub radius: f64,
    /// Full angle of a spot, degrees.
    pub cone_deg: f64,
}

/// A joint of a shape.
#[derive(Debug, Clone, PartialEq)]
pub struct BuiltJoint {
    /// Name of what moves.
    pub name: String,
    /// Indices into [`BuiltShape::parts`] of what moves.
    pub parts: Vec<usize>,
    /// How.
    pub kind: JointKind,
    /// Axis, unit.
    pub axis: DVec3,
    /// A point of the axis, metres.
    pub pivot: DVec3,
    /// Least and greatest value: degrees, or metres for a slide.
    pub range: [f64; 2],
    /// Lowest and highest corners of the pieces that move, in the mesh's frame.
    pub boxes: Vec<[DVec3; 2]>,
}

/// A place on which things may stand.
#[derive(Debug, Clone, PartialEq)]
pub struct BuiltSurface {
    /// Its name.
    pub name: String,
    /// Middle, metres.
    pub at: DVec3,
    /// Half its width as a vector.
    pub half_width: DVec3,
    /// Half its depth as a vector.
    pub half_depth: DVec3,
}

/// A part, for reports: all instances of one name.
#[derive(Debug, Clone, PartialEq)]
pub struct BuiltPart {
    /// Names of the nodes from the root down, joined by `/`.
    pub name: String,
    /// Line of the program, 0 when there is none.
    pub line: u32,
    /// Lowest corner, metres.
    pub low: DVec3,
    /// Highest corner, metres.
    pub high: DVec3,
    /// Triangles.
    pub triangles: usize,
    /// How many pieces go by this name.
    pub instances: usize,
    /// Largest distance of one of its pieces to whatever is next to it, by their boxes, metres; 0 when all touch something.
    pub gap: f64,
}

/// What [`BuiltShape::fit_to`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Factor along each axis.
    pub scale: DVec3,
    /// Factor on lengths along its surface: the mean of the axes that are not thin.
    pub length: f64,
    /// Whether all axes were scaled alike, because the proportions were too far off.
    pub uniform: bool,
}

/// How a part looks.
#[derive(Debug, Clone)]
pub(crate) enum Look {
    /// A material of the tree.
    Slot(u32),
    /// The same on a decal: a piece of the photo begins where its texture coordinates do.
    Decal(u32),
    /// One that came with a template or part model.
    Own(Arc<Material>),
}

/// A piece in its place.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub piece: Arc<Piece>,
    pub place: DAffine3,
    pub look: Option<Look>,
    /// Material of each triangle where it is another one (`u32::MAX`: the part's).
    pub paint: Option<Arc<Vec<u32>>>,
    pub name: Arc<str>,
    pub line: u32,
    /// Convex pieces in the piece's coordinates; `None`: the piece's hull.
    pub hulls: Option<Arc<Vec<Vec<DVec3>>>>,
    /// Whether they are hairs on another part.
    pub hairy: bool,
}

/// A joint with the run of parts that it moves.
#[derive(Debug, Clone)]
pub(crate) struct JointAt {
    pub joint: BuiltJoint,
    pub first: usize,
    pub count: usize,
}

/// A node, meshed in its own frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Built {
    pub parts: Vec<Part>,
    pub lights: Vec<BuiltLight>,
    pub joints: Vec<JointAt>,
    pub surfaces: Vec<BuiltSurface>,
    pub hems: Option<Hems>,
}

impl Built {
    /// Of one piece.
    pub fn of(piece: Piece, line: u32) -> Self {
        Self { parts: vec![Part::of(piece, line)], ..Self::default() }
    }

    /// Adds another one, moved.
    pub fn add(&mut self, other: &Self, map: &DAffine3) {
        let base = self.parts.len();
        self.parts.extend(other.parts.iter().map(|p| Part { place: *map * p.place, ..p.clone() }));
        let scale = libm::cbrt(map.matrix3.determinant().abs());
        let turned = |v: DVec3| map.transform_vector3(v).normalize_or(DVec3::Y);
        self.lights.extend(other.lights.iter().map(|l| BuiltLight {
            position: map.transform_point3(l.position),
            direction: turned(l.direction),
            radius: l.radius * scale,
            ..l.clone()
        }));
        self.joints.extend(other.joints.iter().map(|j| {
            let slide = if j.joint.kind == JointKind::Slide { scale } else { 1.0 };
            let joint = BuiltJoint {
                axis: turned(j.joint.axis),
                pivot: map.transform_point3(j.joint.pivot),
                range: j.joint.range.map(|v| v * slide),
                ..j.joint.clone()
            };
            JointAt { joint, first: base + j.first, count: j.count }
        }));
        self.surfaces.extend(other.surfaces.iter().map(|s| BuiltSurface {
            at: map.transform_point3(s.at),
            half_width: map.transform_vector3(s.half_width),
            half_depth: map.transform_vector3(s.half_depth),
            ..s.clone()
        }));
    }

    /// Lowest and highest corner of all parts.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        self.parts.iter().filter_map(Part::bounds).reduce(|(al, ah), (bl, bh)| (al.min(bl), ah.max(bh)))
    }
}

impl Part {
    pub fn of(piece: Piece, line: u32) -> Self {
        Self {
            piece: Arc::new(piece),
            place: DAffine3::IDENTITY,
            look: None,
            paint: None,
            name: Arc::from(""),
            line,
            hulls: None,
            hairy: false,
        }
    }

    /// The piece where it stands.
    pub fn placed(&self) -> Piece {
        if self.place == DAffine3::IDENTITY {
            (*self.piece).clone()
        } else {
            (*self.piece).clone().transformed(&self.place)
        }
    }

    /// Lowest and highest corner where it stands.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let mut points = self.piece.positions.iter().map(|p| self.place.transform_point3(*p));
        let first = points.next()?;
        Some(points.fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p))))
    }
}

impl ShapeTree {
    /// Meshes the tree.
    ///
    /// # Errors
    /// What [`ShapeTree::check`] finds, or the first node that cannot be meshed, with its line and what would do.
    pub fn build(&self, ctx: &BuildContext) -> Result<BuiltShape, TreeError> {
        self.check()?;
        let root = expand::expand(self, ctx)?;
        assemble::assemble(self, ctx, &root)
    }
}

#[cfg(test)]
mod tests;
