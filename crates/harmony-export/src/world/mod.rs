//! The scene in the form that all writers share: one name, one mesh and one place for everything.
//!
//! # Idea
//! Every format gets the same ids, the same metres and the same looks because all are written from one [`World`], which is
//! read from the run folder alone. Writers differ in axes and syntax only.
//!
//! # Frames and units
//! The room frame (`docs/conventions.md`): metres, +Y up. An object's **body frame** has the origin of its pose, its front
//! at +Z, and the scale applied: `room = position + Ry(yaw) * body`. [`z_up`] carries a vector into the frame of programs
//! whose up is +Z: `(x, y, z)` becomes `(x, -z, y)`, a turn, so that hands and windings stay.
//!
//! # Limits
//! Vertex colours are left out everywhere but in GLB: they hold the photo's light, and these formats have lights of their
//! own (`docs/decisions/0028-light-on-what-was-modelled.md`).

mod looks;
mod opens;
mod read;

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, Vec2, Vec3};
use harmony_mesh::{Bounds, Mesh};
use harmony_scene::{Camera, Level, MovingPart, ObjectId, Scene, SceneObject};

pub(crate) use looks::identifier;
pub use looks::{Look, Looks, Picture, PictureFile, PictureKind};
pub use opens::{Jointed, Opens};

/// A scene ready to be written.
#[derive(Debug, Clone)]
pub struct World {
    /// `scene.json`.
    pub scene: Scene,
    /// The photo's camera.
    pub camera: Camera,
    /// Faces of the room in room coordinates: `floor`, `ceiling`, `wall_back`, ..., and boards along them.
    pub shell: Vec<Face>,
    /// Objects, in the order of `scene.json`.
    pub items: Vec<Item>,
    /// Materials and textures of all of them.
    pub looks: Looks,
    /// What was noticed while reading, one sentence each.
    pub notes: Vec<String>,
}

/// One face of the room's shell.
#[derive(Debug, Clone)]
pub struct Face {
    /// Node name.
    pub name: String,
    /// Mesh in room coordinates.
    pub mesh: Arc<Mesh>,
}

/// One object.
#[derive(Debug, Clone)]
pub struct Item {
    /// As in `scene.json`.
    pub object: SceneObject,
    /// Canonical mesh; identical objects share it.
    pub mesh: Arc<Mesh>,
    /// Parts that move, as its program says.
    pub moving: Vec<MovingPart>,
    /// Parts that open.
    pub opens: Vec<Opens>,
    /// Why it stays rigid although things of its kind open.
    pub rigid: Option<String>,
}

/// Triangles of one look, in the frame that they were asked for in.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Index into [`Looks::looks`].
    pub look: usize,
    /// Positions.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, (0, 0) top left as in glTF.
    pub uvs: Vec<Vec2>,
    /// Vertex indices, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A vector of the room (or of a body) for programs whose up is +Z.
pub fn z_up(v: DVec3) -> DVec3 {
    DVec3::new(v.x, -v.z, v.y)
}

/// As [`z_up`], for meshes.
pub fn z_up_f32(v: Vec3) -> Vec3 {
    Vec3::new(v.x, -v.z, v.y)
}

/// A rotation of the room for programs whose up is +Z.
pub fn z_up_rotation(rotation: DMat3) -> DMat3 {
    let turn = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
    turn * rotation * turn.transpose()
}

/// A unit quaternion, w, x, y, z, with w not negative.
pub fn wxyz(rotation: DMat3) -> [f64; 4] {
    let q = DQuat::from_mat3(&rotation).normalize();
    let q = if q.w < 0.0 { -q } else { q };
    [q.w, q.x, q.y, q.z]
}

/// Which triangles of an object are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Select {
    /// All.
    All,
    /// Those that do not open.
    Fixed,
    /// Those of one part that opens.
    Part(usize),
}

impl Item {
    /// An object with its mesh, of which nobody has said what moves.
    pub fn new(object: SceneObject, mesh: Arc<Mesh>) -> Self {
        Self::moving(object, mesh, Vec::new())
    }

    /// An object with its mesh and what moves of it; where nothing was said, its slots and its kind say.
    pub fn moving(object: SceneObject, mesh: Arc<Mesh>, moving: Vec<MovingPart>) -> Self {
        let scale = object.pose.stretch * object.pose.scale;
        let said = opens::said(object.id.as_str(), &mesh, scale, &moving);
        let found =
            if said.is_empty() { opens::opens(object.id.as_str(), &object.label, &mesh, scale) } else { Ok(said) };
        let (opens, rigid) = match found {
            Ok(opens) => (opens, None),
            Err(why) => (Vec::new(), Some(why)),
        };
        Self { object, mesh, moving, opens, rigid }
    }

    /// The same thing with another mesh, or elsewhere.
    #[must_use]
    pub fn with(&self, object: SceneObject, mesh: Arc<Mesh>) -> Self {
        Self::moving(object, mesh, self.moving.clone())
    }

    /// Whether a triangle (by group and number) is selected.
    fn selects(&self, select: Select, group: usize, triangle: usize) -> bool {
        match select {
            Select::All => true,
            Select::Fixed => !self.opens.iter().any(|o| o.moving[group][triangle]),
            Select::Part(k) => self.opens[k].moving[group][triangle],
        }
    }

    /// The canonical mesh of some of its triangles.
    pub fn selected(&self, select: Select) -> Mesh {
        let mut mesh = (*self.mesh).clone();
        for (g, group) in mesh.groups.iter_mut().enumerate() {
            let mut n = 0;
            group.triangles.retain(|_| {
                n += 1;
                self.selects(select, g, n - 1)
            });
        }
        crate::budget::compacted(&mesh)
    }

    /// The canonical mesh with its parts opened by a share of their ranges.
    ///
    /// `share` is held to 0 to 1; an object without parts that open stays as it is.
    pub fn opened(&self, share: f64) -> Mesh {
        let scale = self.scale();
        let mut out = self.selected(Select::Fixed);
        for (k, part) in self.opens.iter().enumerate() {
            let value = part.range[0] + (part.range[1] - part.range[0]) * share.clamp(0.0, 1.0);
            let (turn, shift) = match part.joint {
                Jointed::Hinge { axis, pivot } => {
                    let turn = DMat3::from_axis_angle(axis, value);
                    (turn, pivot - turn * pivot)
                }
                Jointed::Slide { axis } => (DMat3::IDENTITY, axis * value),
            };
            let mut moved = self.selected(Select::Part(k));
            moved.map(
                |p| ((turn * (p.as_dvec3() * scale) + shift) / scale).as_vec3(),
                |n| ((turn * (n.as_dvec3() / scale)) * scale).as_vec3(),
            );
            out.append(&moved);
        }
        out
    }

    /// The id as text.
    pub fn name(&self) -> &str {
        self.object.id.as_str()
    }

    /// Metres per canonical unit, by axis.
    pub fn scale(&self) -> DVec3 {
        self.object.pose.stretch * self.object.pose.scale
    }

    /// `room_from_body`.
    pub fn rotation(&self) -> DMat3 {
        DMat3::from_rotation_y(self.object.pose.yaw)
    }

    /// A canonical point in the body frame.
    pub fn body_point(&self, canonical: Vec3) -> DVec3 {
        self.scale() * canonical.as_dvec3()
    }

    /// A canonical point in the room.
    pub fn room_point(&self, canonical: Vec3) -> DVec3 {
        self.object.pose.point(canonical.as_dvec3())
    }

    /// Bounds in the body frame.
    pub fn body_bounds(&self) -> Bounds {
        bounds_of(self.used().map(|p| self.body_point(p)))
    }

    /// Bounds in the room.
    pub fn room_bounds(&self) -> Bounds {
        bounds_of(self.used().map(|p| self.room_point(p)))
    }

    /// Positions that triangles use.
    fn used(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.mesh.triangles().flatten().filter_map(|i| self.mesh.positions.get(i as usize).copied())
    }
}

/// Bounds of points; a point at the origin when there is none.
pub fn bounds_of(points: impl Iterator<Item = DVec3>) -> Bounds {
    let (min, max) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
    if min.is_finite() { Bounds { min, max } } else { Bounds { min: DVec3::ZERO, max: DVec3::ZERO } }
}

impl World {
    /// An object by its id.
    pub fn item(&self, id: &ObjectId) -> Option<&Item> {
        self.items.iter().find(|item| item.object.id == *id)
    }

    /// Objects of a level.
    pub fn level(&self, level: Level) -> impl Iterator<Item = &Item> {
        self.items.iter().filter(move |item| item.object.level == level)
    }

    /// Triangles of all nodes (instances count each time).
    pub fn triangles(&self) -> usize {
        let shell: usize = self.shell.iter().map(|f| f.mesh.triangle_count()).sum();
        shell + self.items.iter().map(|i| i.mesh.triangle_count()).sum::<usize>()
    }

    /// An object's triangles in its body frame.
    pub fn body_pieces(&self, item: &Item) -> Vec<Piece> {
        self.selected_pieces(item, Select::All)
    }

    /// Some of an object's triangles in its body frame.
    pub fn selected_pieces(&self, item: &Item, select: Select) -> Vec<Piece> {
        self.pieces(&item.mesh, item.scale().as_vec3(), &|g, t| item.selects(select, g, t))
    }

    /// A face's triangles in the room.
    pub fn face_pieces(&self, face: &Face) -> Vec<Piece> {
        self.pieces(&face.mesh, Vec3::ONE, &|_, _| true)
    }

    /// Triangles by look, with vertices of their own; triangles without an area are left out.
    fn pieces(&self, mesh: &Arc<Mesh>, scale: Vec3, takes: &dyn Fn(usize, usize) -> bool) -> Vec<Piece> {
        let mut out: BTreeMap<usize, Piece> = BTreeMap::new();
        for (g, (group, look)) in mesh.groups.iter().zip(self.looks.of_mesh(mesh)).enumerate() {
            let tile = mesh.materials.get(group.material).and_then(|m| looks::tile_of(mesh, m));
            let mut place: BTreeMap<u32, u32> = BTreeMap::new();
            let piece = out.entry(*look).or_insert_with(|| Piece {
                look: *look,
                positions: Vec::new(),
                normals: Vec::new(),
                uvs: Vec::new(),
                triangles: Vec::new(),
            });
            let whole = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
            for (_, t) in group.triangles.iter().enumerate().filter(|(n, t)| whole(t) && takes(g, *n)) {
                let triangle = t.map(|i| {
                    *place.entry(i).or_insert_with(|| {
                        let at = i as usize;
                        piece.positions.push(mesh.positions[at] * scale);
                        piece.normals.push((mesh.normals[at] / scale).normalize_or(Vec3::Y));
                        let uv = tile.map_or(mesh.uvs[at], |tile| tile.uv(mesh.metric_uvs[at]));
                        piece.uvs.push(if uv.is_finite() { uv } else { Vec2::ZERO });
                        piece.positions.len() as u32 - 1
                    })
                });
                piece.triangles.push(triangle);
            }
        }
        out.into_values().filter(|p| !p.triangles.is_empty()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn z_up_is_a_turn_and_rotations_follow_it() {
        let v = DVec3::new(0.3, -1.2, 2.5);
        assert!((z_up(DVec3::X).cross(z_up(DVec3::Y)) - z_up(DVec3::Z)).length() < 1e-12, "the hand stays");
        assert_eq!(z_up(DVec3::Y), DVec3::Z);
        let r = DMat3::from_rotation_y(0.7);
        assert!((z_up(r * v) - z_up_rotation(r) * z_up(v)).length() < 1e-12);
        // A turn about the room's +Y is the same turn about +Z.
        assert!((z_up_rotation(r).x_axis - DMat3::from_rotation_z(0.7).x_axis).length() < 1e-12);
    }
}
