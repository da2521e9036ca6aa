//! The nodes.
//!
//! A tree is an arena: a node's children stand before it, so that it cannot hold itself, and what is used twice is
//! stored once. A node holds numbers only; what needs the geometry of other nodes (resting on something, draping over
//! something, the hem of a cloth) names them and is worked out when the tree is meshed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::material::MaterialSpec;

mod check;

pub use check::MAX_TRIANGLES;

/// Index of a node in [`ShapeTree::nodes`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct NodeId(pub u32);

/// What a program yields.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ShapeTree {
    /// Looks.
    pub materials: Vec<MaterialSpec>,
    /// Nodes, children before parents; the last one is the root.
    pub nodes: Vec<Node>,
}

/// One call of a modelling function.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Node {
    /// What it is.
    #[serde(flatten)]
    pub kind: Kind,
    /// Name of the part: `seat`, `door_left`, `bulb`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Index into [`ShapeTree::materials`]; children without one inherit it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<u32>,
    /// Line of the program, 0 when there is none.
    #[serde(default)]
    pub line: u32,
}

/// A polyline in space, closed or not; smooth curves are divided before they come here.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Curve {
    /// Points, metres.
    pub points: Vec<[f64; 3]>,
    /// Joins the end to the start.
    #[serde(default)]
    pub closed: bool,
}

/// A closed outline in a plane with holes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Outline {
    /// Outer loop, counter-clockwise, metres.
    pub points: Vec<[f64; 2]>,
    /// Inner loops.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub holes: Vec<Vec<[f64; 2]>>,
    /// More islands (letters of a text), each with holes of its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub islands: Vec<Outline>,
}

/// An axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names say it")]
pub enum Axis {
    X,
    #[default]
    Y,
    Z,
}

/// A side of a part, in its own frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum Face {
    #[default]
    Front,
    Back,
    Left,
    Right,
    Top,
    Bottom,
}

/// What a sweep carries along its curve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Section {
    /// A circle of this radius.
    Round(f64),
    /// An outline, x to the side and y up where the curve is level.
    Outline(Outline),
}

/// One outline of a loft: moved to `at`, turned by `turn_deg` about x, then y, then z; the outline lies in its xz plane
/// before that, x to the right and y of the outline towards -z.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LoftSection {
    /// The outline; holes are not lofted.
    pub outline: Outline,
    /// Where its origin goes.
    pub at: [f64; 3],
    /// Turn, degrees.
    #[serde(default)]
    pub turn_deg: [f64; 3],
}

/// What a boolean operation keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Boolean {
    /// The first without the second.
    Cut,
    /// Both.
    Join,
    /// What they share.
    Common,
}

/// How a hanging cloth is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum HangTop {
    #[default]
    Rings,
    Pleats,
    Rod,
}

/// What a fringe is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum FringeKind {
    #[default]
    Thread,
    Tassel,
    Pompom,
    Lace,
}

/// What a fuzz is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum FuzzKind {
    #[default]
    Pile,
    Terry,
    Boucle,
    Fur,
}

/// How plants grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum PlantKind {
    #[default]
    Bush,
    Rosette,
    Fern,
    Vine,
    Succulent,
    Palm,
    Grass,
    Flowers,
    Tree,
}

/// How a part may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum JointKind {
    Hinge,
    Slide,
    Ball,
}

/// A lamp's light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum LampKind {
    Point,
    Spot,
    Area,
}

/// Where a cloth's edge is asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Along {
    /// A curve.
    Curve(Curve),
    /// An edge of a draped, hung or bent cloth, by name: `head`, `foot`, `left`, `right`, `all`.
    Hem {
        /// The cloth.
        of: NodeId,
        /// Which edge.
        side: String,
    },
}

/// What a node is. Lengths are metres, angles degrees; every solid stands with its bottom at y = 0 and is centred in x
/// and z unless it says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Kind {
    /// Children together, in their own places.
    Group {
        /// The children.
        children: Vec<NodeId>,
    },
    /// One child moved: `[x axis, y axis, z axis, origin]` columns of the affine map.
    Placed {
        /// What is moved.
        child: NodeId,
        /// Columns.
        columns: [[f64; 3]; 4],
    },
    /// Copies of a child, columns as in `placed`.
    Copies {
        /// What is copied.
        child: NodeId,
        /// Columns of each copy.
        places: Vec<[[f64; 3]; 4]>,
    },
    /// Rests a child on the top of another one at `u`, `v` (0 to 1 across its bounds), keeping its turn.
    On {
        /// What rests.
        child: NodeId,
        /// What it rests on (not drawn by this node).
        other: NodeId,
        /// Left to right.
        u: f64,
        /// Back to front.
        v: f64,
    },
    /// Moves a child until it touches a side of another one.
    Against {
        /// What is moved.
        child: NodeId,
        /// What it touches (not drawn by this node).
        other: NodeId,
        /// Which side of the other one.
        side: Face,
    },
    /// Copies of children spread over the top of another node.
    Scatter {
        /// What is spread, drawn in turn.
        children: Vec<NodeId>,
        /// Where (not drawn by this node).
        on: NodeId,
        /// How many.
        count: u32,
        /// Least distance between them.
        gap: f64,
        /// Seed.
        seed: u32,
    },
    /// Children on top of each other, upwards.
    Stack {
        /// From the bottom.
        children: Vec<NodeId>,
        /// Distance between.
        gap: f64,
        /// Random shift and turn, 0 to 1.
        jitter: f64,
        /// Seed.
        seed: u32,
    },
    /// Box with rounded edges.
    Box {
        /// Width, height, depth.
        size: [f64; 3],
        /// Edge radius.
        bevel: f64,
        /// Steps of the rounding, 1 to 8.
        segments: u32,
        /// Width and depth of the top relative to the bottom.
        taper: [f64; 2],
        /// Shift of the top in x and z.
        shear: [f64; 2],
    },
    /// Cylinder, cone or prism, upright.
    Cylinder {
        /// Radius of the bottom.
        radius: f64,
        /// Height.
        height: f64,
        /// Radius of the top.
        top_radius: f64,
        /// Edge radius.
        bevel: f64,
        /// Number of flat sides, 0 for a round one.
        sides: u32,
        /// Wall thickness; 0: solid. An open pipe otherwise.
        wall: f64,
    },
    /// Ball or ellipsoid, standing on y = 0.
    Sphere {
        /// Radii.
        radii: [f64; 3],
    },
    /// A profile (radius, height) turned about y, as it is (no shift).
    Lathe {
        /// Profile, bottom to top or top to bottom.
        profile: Vec<[f64; 2]>,
        /// Edges flatter than this angle are smooth; 180: all.
        smooth_deg: f64,
        /// Wall thickness; 0: as the profile says.
        wall: f64,
        /// Depth relative to width.
        oval: f64,
        /// Number of lobes around, 0: none.
        lobes: u32,
        /// Depth of the lobes relative to the radius.
        lobe_depth: f64,
    },
    /// An outline pulled along an axis, from 0 to `depth`; the outline keeps its coordinates (z: x, y; x: z to the
    /// right seen from +x as -z .. , y up; y: x, -z).
    Extrude {
        /// The outline.
        outline: Outline,
        /// Length.
        depth: f64,
        /// Along which axis; the result is centred on it (y: from 0 upwards).
        axis: Axis,
        /// Edge radius.
        bevel: f64,
        /// Bend over the whole length, degrees, towards +y (x, z) or +z (y).
        bend_deg: f64,
        /// Twist over the whole length, degrees.
        twist_deg: f64,
    },
    /// A section carried along a curve, in the curve's coordinates.
    Sweep {
        /// Centre line.
        curve: Curve,
        /// What is carried.
        section: Section,
        /// Size at the end relative to the start.
        taper: f64,
        /// Twist over the whole length, degrees.
        twist_deg: f64,
        /// Pitch and depth of rings around a round section, 0: none.
        rings: [f64; 2],
        /// Rounded ends instead of flat ones.
        round_caps: bool,
    },
    /// A skin through outlines.
    Loft {
        /// The outlines in order.
        sections: Vec<LoftSection>,
        /// Joins the last to the first.
        closed: bool,
    },
    /// A profile line with thickness, pulled along x to `width` (centred): corrugation, louvre blade, arch, folded paper.
    BentSheet {
        /// (z, y) points of the profile.
        profile: Vec<[f64; 2]>,
        /// Length along x.
        width: f64,
        /// Thickness.
        thick: f64,
        /// Smooth across the profile's corners.
        smooth: bool,
        /// Axis along which it is pulled (x or z; y: upright).
        axis: Axis,
    },
    /// A grid of points, `nu` a row, in its own coordinates.
    Surf {
        /// Points, row by row.
        points: Vec<[f64; 3]>,
        /// Points a row.
        nu: u32,
        /// Thickness; 0: a sheet seen from both sides.
        thick: f64,
        /// Each row is closed.
        closed_u: bool,
    },
    /// Points and faces as they are.
    Mesh {
        /// Points.
        points: Vec<[f64; 3]>,
        /// Polygons, counter-clockwise from outside.
        faces: Vec<Vec<u32>>,
    },
    /// Smooth union of round solids.
    Blend {
        /// The solids.
        children: Vec<NodeId>,
        /// Width of the smooth joint.
        radius: f64,
    },
    /// Boolean operation on closed solids.
    Boolean {
        /// Which.
        op: Boolean,
        /// First.
        a: NodeId,
        /// Second.
        b: NodeId,
    },
    /// Makes a box-like or turned solid hollow.
    Shell {
        /// The solid.
        child: NodeId,
        /// Wall thickness.
        wall: f64,
        /// Which side is open; none: closed.
        open: Option<Face>,
    },
    /// A pillow: lying flat, standing on y = 0.
    Pillow {
        /// Width, depth, greatest thickness.
        size: [f64; 3],
        /// 0 smooth to 1 crumpled.
        wrinkle: f64,
        /// Radius of the piping, 0: none.
        piping: f64,
        /// How far the corners stand out, 0 to 1.
        ears: f64,
        /// Dent of the middle of the upper edge (a chop), 0 to 1.
        dent: f64,
        /// Seed.
        seed: u32,
    },
    /// An upholstered box.
    Cushion {
        /// Width, height, depth.
        size: [f64; 3],
        /// Height of the crown above the edges, within the height.
        crown: f64,
        /// Sag of the middle.
        sag: f64,
        /// Radius of the piping along the edges, 0: none.
        piping: f64,
        /// Edge radius.
        bevel: f64,
    },
    /// Buttons drawn into a face.
    Tuft {
        /// An upholstered solid.
        child: NodeId,
        /// Which side.
        face: Face,
        /// Rows.
        rows: u32,
        /// Columns.
        cols: u32,
        /// Depth of the buttons.
        depth: f64,
        /// Every other row shifted by half.
        diamond: bool,
        /// Radius of a button, 0: none.
        button: f64,
    },
    /// Stitched cells on a face.
    Quilt {
        /// An upholstered solid.
        child: NodeId,
        /// Which side.
        face: Face,
        /// Size of a cell.
        cell: f64,
        /// Depth of the seams.
        depth: f64,
        /// `box`, `diamond` or `channel`.
        pattern: String,
    },
    /// A cloth that falls over what lies below it.
    Drape {
        /// Width and length of the cloth.
        size: [f64; 2],
        /// What it falls on (not drawn by this node).
        over: Vec<NodeId>,
        /// Middle of the cloth in x and z.
        at: [f64; 2],
        /// Turn about y, degrees.
        turn_deg: f64,
        /// 0 smooth to 1 rumpled.
        rumple: f64,
        /// Thickness.
        thick: f64,
        /// Length of the head end that is folded back, 0: none.
        fold: f64,
        /// 0 limp to 1 stiff.
        stiff: f64,
        /// Seed.
        seed: u32,
    },
    /// A hanging cloth, its top at y = height, centred.
    Hang {
        /// Width and height.
        size: [f64; 2],
        /// Number of folds.
        folds: u32,
        /// Cloth width relative to the width it hangs in.
        gather: f64,
        /// How it is held.
        top: HangTop,
        /// Height of a tie-back as a fraction, 0: none.
        tie: f64,
        /// Seed.
        seed: u32,
    },
    /// A soft thing that gives way: flattened where it stands, bulged around.
    Slump {
        /// The thing.
        child: NodeId,
        /// 0 to 1.
        amount: f64,
    },
    /// A rolled sheet, lying along x.
    Roll {
        /// Length along x.
        width: f64,
        /// Outer radius.
        radius: f64,
        /// Turns that show at the ends.
        turns: f64,
        /// Thickness of the sheet.
        thick: f64,
    },
    /// A folded cloth, a stack of layers with rounded folds.
    Folded {
        /// Width, depth.
        size: [f64; 2],
        /// Number of layers.
        layers: u32,
        /// Thickness of a layer.
        thick: f64,
        /// Seed.
        seed: u32,
    },
    /// Threads, tassels or pompoms along an edge, hanging down.
    Fringe {
        /// Along what.
        along: Along,
        /// Which.
        fringe: FringeKind,
        /// Length.
        length: f64,
        /// Distance between them.
        spacing: f64,
        /// 0 to 1.
        jitter: f64,
        /// Seed.
        seed: u32,
    },
    /// A hairy surface.
    Fuzz {
        /// What is covered (drawn too).
        child: NodeId,
        /// Which.
        fuzz: FuzzKind,
        /// Length of the hairs.
        length: f64,
        /// 0 to 1.
        density: f64,
        /// Seed.
        seed: u32,
    },
    /// Strands plaited along a curve.
    Braid {
        /// Centre line.
        curve: Curve,
        /// Radius of the whole.
        radius: f64,
        /// Strands.
        strands: u32,
        /// Length of a turn.
        pitch: f64,
    },
    /// A child's surface as basket work.
    Wicker {
        /// The form.
        child: NodeId,
        /// Distance of the strands.
        cell: f64,
        /// Radius of the strands.
        radius: f64,
    },
    /// A wire net within an outline, in the xy plane.
    WireNet {
        /// The outline.
        outline: Outline,
        /// Distance of the wires.
        pitch: f64,
        /// Radius of the wires.
        radius: f64,
    },
    /// One leaf, from the origin along +z.
    Leaf {
        /// Length and width.
        size: [f64; 2],
        /// `oval`, `lance`, `heart`, `round`, `lobed`, `blade`.
        shape: String,
        /// Fold along the midrib, degrees.
        fold_deg: f64,
        /// Curl downwards, degrees.
        curl_deg: f64,
    },
    /// A plant without pot, growing from the origin.
    Plant {
        /// How it grows.
        plant: PlantKind,
        /// Height.
        height: f64,
        /// Diameter.
        spread: f64,
        /// Leaves or stems.
        count: u32,
        /// A leaf to use; none: the usual one.
        leaf: Option<NodeId>,
        /// Material of the flowers or fruits, where there are some.
        flower: Option<u32>,
        /// Seed.
        seed: u32,
    },
    /// A part that moves. It is drawn where it is; the joint is carried to exports.
    Joint {
        /// What moves.
        child: NodeId,
        /// How.
        joint: JointKind,
        /// Axis, in the child's frame.
        axis: [f64; 3],
        /// A point of the axis.
        pivot: [f64; 3],
        /// Least and greatest value: degrees, or metres for a slide.
        range: [f64; 2],
    },
    /// Light that comes from here.
    Light {
        /// Which.
        lamp: LampKind,
        /// Luminous flux, lumens.
        lumens: f64,
        /// Colour temperature, kelvin.
        kelvin: f64,
        /// Radius of the emitter.
        radius: f64,
        /// Full angle of a spot, degrees.
        cone_deg: f64,
        /// Where.
        at: [f64; 3],
        /// Which way (spot, area).
        dir: [f64; 3],
    },
    /// A place on which other things may stand.
    Surface {
        /// Width and depth.
        size: [f64; 2],
        /// Its middle.
        at: [f64; 3],
    },
    /// A template of the catalogue at a size, with its parameters.
    Template {
        /// Its name.
        template: String,
        /// Size; none: the object's.
        size: [f64; 3],
        /// Parameters as in `harmony schema part-model`'s catalogue.
        params: serde_json::Value,
    },
    /// A JSON part model at a size.
    PartModel {
        /// The model.
        model: harmony_mesh::PartModel,
        /// Width, height, depth.
        size: [f64; 3],
    },
    /// Paints one side of a child.
    Paint {
        /// The child.
        child: NodeId,
        /// Which side.
        face: Face,
        /// Material of that side.
        with: u32,
    },
    /// A flat piece with a material laid on a side of a child, a hair above it.
    Decal {
        /// The child (drawn too).
        child: NodeId,
        /// Which side.
        face: Face,
        /// Its material.
        with: u32,
        /// Middle of the decal on the side: fractions left to right, bottom to top seen from outside.
        at: [f64; 2],
        /// Width and height.
        size: [f64; 2],
    },
}

/// Most nodes of a tree.
pub const MAX_NODES: usize = 20_000;
/// Most materials of a tree.
pub const MAX_MATERIALS: usize = 128;
/// Most instances once copies are expanded.
pub const MAX_INSTANCES: u64 = 50_000;
/// Most points of curves, outlines, grids and meshes together.
pub const MAX_POINTS: usize = 200_000;
/// Largest coordinate, metres.
pub const MAX_COORDINATE: f64 = 100.0;

/// What is wrong with a tree.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TreeError {
    /// Nothing in it.
    #[error("the tree has no nodes")]
    Empty,
    /// Too much of something.
    #[error("{count} {what}; at most {max} are allowed")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many.
        count: u64,
        /// Most.
        max: u64,
    },
    /// A node refers to one that does not stand before it.
    #[error("line {line}: node {node} refers to node {child}, which does not stand before it")]
    Order {
        /// The node.
        node: u32,
        /// What it refers to.
        child: u32,
        /// Line of the program.
        line: u32,
    },
    /// A node refers to a material that does not exist.
    #[error("line {line}: material {material} does not exist")]
    Material {
        /// The index.
        material: u32,
        /// Line of the program.
        line: u32,
    },
    /// A number that cannot be used.
    #[error("line {line}: {what} is {value}; {allowed}")]
    Number {
        /// Which.
        what: String,
        /// Its value.
        value: f64,
        /// What would do.
        allowed: String,
        /// Line of the program.
        line: u32,
    },
    /// A node that cannot be meshed.
    #[error("line {line}: {message}")]
    Shape {
        /// Why, and what would do.
        message: String,
        /// Line of the program.
        line: u32,
    },
}

impl TreeError {
    /// Line of the program, 0 when none is to blame.
    pub fn line(&self) -> u32 {
        match self {
            Self::Empty | Self::TooMany { .. } => 0,
            Self::Order { line, .. }
            | Self::Material { line, .. }
            | Self::Number { line, .. }
            | Self::Shape { line, .. } => *line,
        }
    }
}

impl Kind {
    /// Nodes that this one refers to, in order.
    pub fn references(&self) -> Vec<NodeId> {
        match self {
            Self::Group { children } | Self::Blend { children, .. } | Self::Stack { children, .. } => children.clone(),
            Self::Placed { child, .. }
            | Self::Copies { child, .. }
            | Self::Shell { child, .. }
            | Self::Tuft { child, .. }
            | Self::Quilt { child, .. }
            | Self::Slump { child, .. }
            | Self::Fuzz { child, .. }
            | Self::Wicker { child, .. }
            | Self::Joint { child, .. }
            | Self::Paint { child, .. }
            | Self::Decal { child, .. } => vec![*child],
            Self::On { child, other, .. } | Self::Against { child, other, .. } => vec![*child, *other],
            Self::Scatter { children, on, .. } => children.iter().copied().chain([*on]).collect(),
            Self::Boolean { a, b, .. } => vec![*a, *b],
            Self::Drape { over, .. } => over.clone(),
            Self::Fringe { along: Along::Hem { of, .. }, .. } => vec![*of],
            Self::Plant { leaf: Some(leaf), .. } => vec![*leaf],
            _ => Vec::new(),
        }
    }
}
