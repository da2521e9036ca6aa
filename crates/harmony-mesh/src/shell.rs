//! The empty room as a mesh: floor, ceiling and walls that face inward, with the openings cut out.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use glam::{DVec2, DVec3, Vec2};
use harmony_scene::{Block, Extents, Opening, OpeningKind, Room, RoomFace, Surface, WallPlane, clipped};
use image::RgbaImage;

pub use trim::{TRIMS, Trim, Trims};

use crate::{Group, Material, Mesh};

mod trim;

/// What to leave out of the shell, and how deep its openings are.
#[derive(Debug, Clone, PartialEq)]
pub struct ShellOptions {
    /// Faces that are not made.
    pub omit: Vec<Surface>,
    /// Depth of the jambs around openings, outward, metres.
    pub reveal: f64,
    /// The same of doors, where it is another: half a wall's thickness where the room behind has the other half.
    pub door_reveal: Option<f64>,
    /// Linear colour of faces without a texture.
    pub plain: [f32; 3],
    /// Perceptual roughness of faces that shine otherwise than paint does.
    pub roughness: BTreeMap<Surface, f32>,
    /// Skirting, cornice and casings, with groups and materials of their own after those of the faces.
    pub trims: Trims,
}

impl Default for ShellOptions {
    fn default() -> Self {
        Self {
            omit: Vec::new(),
            reveal: 0.1,
            door_reveal: None,
            plain: [0.6, 0.58, 0.55],
            roughness: BTreeMap::new(),
            trims: Trims::default(),
        }
    }
}

/// Material and group name of a face: `floor`, `ceiling`, `wall_back`, `wall_left`, ...
pub fn shell_material_name(surface: Surface) -> &'static str {
    match surface {
        Surface::Floor => "floor",
        Surface::Ceiling => "ceiling",
        Surface::Back => "wall_back",
        Surface::Left => "wall_left",
        Surface::Right => "wall_right",
        Surface::Front => "wall_front",
    }
}

/// The room's shell in room coordinates, one group and material a face, single-sided, normals inward.
///
/// Texture coordinates cover each whole face of the box: on walls u runs with [`Surface::point`]'s u and v = 0 is the
/// top; on floor and ceiling u runs along x and v along z. Faces of blocks and niches have those of the place that lies
/// before them on their surface. The reveals of a wall's openings belong to its group, thresholds on the floor to the floor's.
pub fn room_shell(room: &Room, textures: &dyn Fn(Surface) -> Option<Arc<RgbaImage>>) -> Mesh {
    room_shell_with(room, textures, &ShellOptions::default())
}

/// [`room_shell`] with faces left out.
pub fn room_shell_with(
    room: &Room,
    textures: &dyn Fn(Surface) -> Option<Arc<RgbaImage>>,
    options: &ShellOptions,
) -> Mesh {
    let mut mesh = Mesh::default();
    let faces = room.all_faces();
    for surface in Surface::ALL.into_iter().filter(|s| !options.omit.contains(s)) {
        let texture = textures(surface);
        let color = if texture.is_some() { [1.0; 3] } else { options.plain };
        let mut material = Material::plain(shell_material_name(surface), color);
        material.texture = texture;
        material.roughness = options.roughness.get(&surface).copied().unwrap_or(material.roughness);
        let mut sheet = Sheet::new(surface, &room.extents, &mut mesh);
        for face in faces.iter().filter(|f| f.surface == surface && sides(room, f).is_none() && hung(room, f).is_none())
        {
            let holes = holes(room, face);
            sheet.face(face, &holes);
        }
        for corners in room.shape.blocks.iter().filter_map(|b| behind_hung(room, b, surface)) {
            sheet.polygon(&corners, surface.normal());
        }
        let depth =
            |hole: &Opening| options.door_reveal.filter(|_| hole.kind == OpeningKind::Door).unwrap_or(options.reveal);
        for hole in all_holes(room, surface) {
            sheet.reveals(&hole, depth(&hole), Side::Wall);
        }
        if surface == Surface::Floor {
            let walls = Surface::ALL.into_iter().filter(|s| !options.omit.contains(s));
            for hole in walls.flat_map(|wall| all_holes(room, wall)) {
                sheet.reveals(&hole, depth(&hole), Side::Threshold);
            }
        }
        let triangles = sheet.triangles;
        mesh.groups.push(Group { material: mesh.materials.len(), triangles });
        mesh.materials.push(material);
    }
    if !options.omit.contains(&Surface::Ceiling) {
        hung_blocks(&mut mesh, room, &faces, textures, options);
    }
    for (k, niche) in room.shape.niches.iter().enumerate() {
        let Some(color) = niche.sides.filter(|_| !options.omit.contains(&niche.surface)) else { continue };
        let mut sheet = Sheet::new(niche.surface, &room.extents, &mut mesh);
        for face in faces.iter().filter(|f| f.side_of == Some(k)) {
            sheet.polygon(&face.polygon, face.normal);
        }
        let triangles = sheet.triangles;
        mesh.groups.push(Group { material: mesh.materials.len(), triangles });
        mesh.materials.push(Material::plain(&niche_name(niche.surface, k), color));
    }
    coves(&mut mesh, room, &options.omit);
    caps(&mut mesh, room, options);
    trim::add(&mut mesh, room, &options.trims, &options.omit);
    mesh
}

/// Material and group name of a niche's sides: `wall_left_niche_01`, `ceiling_niche_02`.
fn niche_name(surface: Surface, niche: usize) -> String {
    format!("{}_niche_{:02}", shell_material_name(surface), niche + 1)
}

/// Material name, and id of the light, of the strip in a niche that glows: `ceiling_niche_02_glow`.
pub fn cove_name(surface: Surface, niche: usize) -> String {
    format!("{}_glow", niche_name(surface, niche))
}

/// Whether a name is one of [`cove_name`].
pub fn is_cove_name(name: &str) -> bool {
    let of_a_niche = |s: Surface| name.strip_prefix(shell_material_name(s)).is_some_and(|n| n.starts_with("_niche_"));
    name.ends_with("_glow") && Surface::ALL.into_iter().any(of_a_niche)
}

/// Whether a piece of the shell goes when faces (by their names) are left out: it is one of them, a side or the strip
/// of one of their niches, or of a block that hangs from it.
pub fn is_left_out(name: &str, faces: &[impl AsRef<str>]) -> bool {
    let part = |rest: &str| rest.is_empty() || rest.starts_with("_niche_") || rest.starts_with("_block_");
    let of = |face: &str| name.strip_prefix(face).is_some_and(part);
    faces.iter().any(|face| of(face.as_ref()))
}

/// A cove's strip: how far it lies behind the niche's side, its width and its height, metres.
const STRIP: (f64, f64, f64) = (0.08, 0.02, 0.008);

/// Strips of light on the lower sides of niches that glow, along all four edges.
fn coves(mesh: &mut Mesh, room: &Room, omit: &[Surface]) {
    for (k, niche) in room.shape.niches.iter().enumerate() {
        let Some(color) = niche.glow.filter(|_| !omit.contains(&niche.surface)) else { continue };
        let (low, high) =
            (niche.min + DVec3::new(STRIP.0, 0.0, STRIP.0), niche.max - DVec3::new(STRIP.0, 0.0, STRIP.0));
        let (y, w) = ([niche.min.y + 1e-3, niche.min.y + STRIP.2], STRIP.1);
        let mut sheet = Sheet::new(niche.surface, &room.extents, mesh);
        for (x, z) in [
            ([low.x, high.x], [low.z, low.z + w]),
            ([low.x, high.x], [high.z - w, high.z]),
            ([low.x, low.x + w], [low.z + w, high.z - w]),
            ([high.x - w, high.x], [low.z + w, high.z - w]),
        ] {
            sheet.cuboid(x, y, z);
        }
        let triangles = sheet.triangles;
        let mut material = Material::plain(&cove_name(niche.surface, k), color);
        material.emissive = color;
        mesh.groups.push(Group { material: mesh.materials.len(), triangles });
        mesh.materials.push(material);
    }
}

/// The block that hangs from the ceiling and that a face is of.
fn hung(room: &Room, face: &RoomFace) -> Option<usize> {
    room.shape.blocks.iter().position(|b| b.hangs(&room.extents) && b.has(face))
}

/// The part of a wall that a block hides which hangs from the ceiling, for views without both: else the wall has a notch.
fn behind_hung(room: &Room, block: &Block, surface: Surface) -> Option<[DVec3; 4]> {
    let (e, wall) = (&room.extents, surface.wall()?);
    let ends = [block.min.max(DVec3::ZERO), block.max.min(e.as_vec())];
    let touches = ends.iter().any(|p| wall.distance(e, *p) < 1e-6);
    let [a, b] = ends.map(|p| wall.coordinates(p));
    let at = |u: f64, y: f64| wall.point(e, u, y);
    (touches && block.hangs(e)).then(|| [at(a.x, a.y), at(b.x, a.y), at(b.x, b.y), at(a.x, b.y)])
}

/// Blocks that hang from the ceiling, which go with it: `ceiling_block_01_wall_left`, one group for each face of the box
/// whose material they have.
fn hung_blocks(
    mesh: &mut Mesh,
    room: &Room,
    faces: &[RoomFace],
    textures: &dyn Fn(Surface) -> Option<Arc<RgbaImage>>,
    options: &ShellOptions,
) {
    let shown = || Surface::ALL.into_iter().filter(|s| !options.omit.contains(s));
    for (k, surface) in (0..room.shape.blocks.len()).flat_map(|k| shown().map(move |surface| (k, surface))) {
        let own = |f: &&RoomFace| f.surface == surface && sides(room, f).is_none() && hung(room, f) == Some(k);
        let mut sheet = Sheet::new(surface, &room.extents, mesh);
        for face in faces.iter().filter(own) {
            sheet.face(face, &holes(room, face));
        }
        let triangles = sheet.triangles;
        if triangles.is_empty() {
            continue;
        }
        let texture = textures(surface);
        let color = if texture.is_some() { [1.0; 3] } else { options.plain };
        let mut material =
            Material::plain(&format!("ceiling_block_{:02}_{}", k + 1, shell_material_name(surface)), color);
        material.texture = texture;
        mesh.groups.push(Group { material: mesh.materials.len(), triangles });
        mesh.materials.push(material);
    }
}

/// How far below the ceiling a block's cap lies, metres: nobody in the room sees it there.
const BELOW_CEILING: f64 = 1e-3;

/// Upper sides of blocks that reach the ceiling, for views from above without it: else one looks into a hollow block.
fn caps(mesh: &mut Mesh, room: &Room, options: &ShellOptions) {
    let height = room.extents.height;
    let no_ceiling = options.omit.contains(&Surface::Ceiling);
    let reaches = |b: &Block| b.max.y > height - BELOW_CEILING && !(no_ceiling && b.hangs(&room.extents));
    for (k, block) in room.shape.blocks.iter().enumerate().filter(|(_, b)| reaches(b)) {
        let y = height - BELOW_CEILING;
        let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| {
            let side = [block.min, block.max];
            DVec3::new(side[i].x, y, side[j].z)
        });
        let mut sheet = Sheet::new(Surface::Floor, &room.extents, mesh);
        sheet.polygon(&corners, DVec3::Y);
        let triangles = sheet.triangles;
        mesh.groups.push(Group { material: mesh.materials.len(), triangles });
        let of = if block.hangs(&room.extents) { "ceiling_" } else { "" };
        mesh.materials.push(Material::plain(&format!("{of}block_{:02}_top", k + 1), options.plain));
    }
}

/// The colour of a niche's side that has one of its own.
fn sides(room: &Room, face: &RoomFace) -> Option<[f32; 3]> {
    room.shape.niches.get(face.side_of?)?.sides
}

/// A rectangle on a face, in face coordinates, metres.
#[derive(Debug, Clone, Copy)]
struct Rect {
    min: DVec2,
    max: DVec2,
}

impl Rect {
    fn of(hole: &Opening) -> Self {
        Self { min: DVec2::new(hole.u[0], hole.y[0]), max: DVec2::new(hole.u[1], hole.y[1]) }
    }

    fn contains(&self, p: DVec2) -> bool {
        p.cmpgt(self.min).all() && p.cmplt(self.max).all()
    }
}

/// Openings this near to a plane are cut into it, metres.
const SAME_PLANE: f64 = 0.01;

/// The openings of a wall, cut to the wall; those without area are left out.
fn all_holes(room: &Room, surface: Surface) -> Vec<Opening> {
    let size = surface.size(&room.extents);
    let own = room.openings.iter().filter(|o| o.wall.surface() == surface);
    own.filter(|o| o.u.iter().chain(&o.y).all(|v| v.is_finite()))
        .map(|o| {
            let (u, y) = ([o.u[0].max(0.0), o.u[1].min(size.x)], [o.y[0].max(0.0), o.y[1].min(size.y)]);
            Opening { u, y, ..o.clone() }
        })
        .filter(|o| (o.u[1] - o.u[0]).min(o.y[1] - o.y[0]) > 1e-6)
        .collect()
}

/// The openings that are cut into a face.
fn holes(room: &Room, face: &RoomFace) -> Vec<Opening> {
    let Some(plane) = face.plane(&room.extents) else { return Vec::new() };
    let mut all = all_holes(room, plane.wall.surface());
    all.retain(|o| o.wall == plane.wall && (o.inset - plane.inset).abs() < SAME_PLANE);
    all
}

/// What a side of a hole goes on with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    /// The wall.
    Wall,
    /// The floor.
    Threshold,
}

/// A hole whose lower edge is this near to the floor is a way, metres.
const ON_FLOOR: f64 = 0.01;

/// The faces of one surface while their triangles are made.
struct Sheet<'a> {
    surface: Surface,
    extents: &'a Extents,
    mesh: &'a mut Mesh,
    triangles: Vec<[u32; 3]>,
    /// Vertices by place and normal: faces of one plane share theirs.
    welded: HashMap<[i64; 6], u32>,
}

impl<'a> Sheet<'a> {
    fn new(surface: Surface, extents: &'a Extents, mesh: &'a mut Mesh) -> Self {
        Self { surface, extents, mesh, triangles: Vec::new(), welded: HashMap::new() }
    }

    /// A face: cells along the edges of its holes, without those inside a hole, and what a rounded top leaves of its own.
    ///
    /// Neighbouring cells share their vertices, so a face has no T-junctions.
    fn face(&mut self, face: &RoomFace, openings: &[Opening]) {
        let holes: Vec<Rect> = openings.iter().map(Rect::of).collect();
        let Some(plane) = face.plane(self.extents).filter(|_| !holes.is_empty()) else {
            self.polygon(&face.polygon, face.normal);
            return;
        };
        let wall = plane.wall;
        let corners = face.polygon.iter().map(|p| wall.coordinates(*p));
        let (low, high) = corners.fold((DVec2::MAX, DVec2::MIN), |(l, h), c| (l.min(c), h.max(c)));
        let lines = |axis: usize| {
            let inside = |at: &f64| *at > low[axis] && *at < high[axis];
            let mut at = vec![low[axis], high[axis]];
            at.extend(holes.iter().flat_map(|h| [h.min[axis], h.max[axis]]).filter(inside));
            // An arch touches its rectangle at the top's middle and at its springing.
            let arches = openings.iter().filter(|o| o.rounded() > 0.0);
            let touches = |o: &Opening| if axis == 0 { f64::midpoint(o.u[0], o.u[1]) } else { o.y[1] - o.rounded() };
            at.extend(arches.map(touches).filter(inside));
            at.sort_by(f64::total_cmp);
            at.dedup();
            at
        };
        let (us, vs) = (lines(0), lines(1));
        for v in vs.windows(2) {
            for u in us.windows(2) {
                let (min, max) = (DVec2::new(u[0], v[0]), DVec2::new(u[1], v[1]));
                if holes.iter().any(|h| h.contains((min + max) / 2.0)) {
                    continue;
                }
                let cell = clipped(&face.polygon, |p| wall.coordinates(p).x - min.x);
                let cell = clipped(&cell, |p| max.x - wall.coordinates(p).x);
                let cell = clipped(&cell, |p| p.y - min.y);
                let cell = clipped(&cell, |p| max.y - p.y);
                self.polygon(&cell, face.normal);
            }
        }
        for opening in openings.iter().filter(|o| o.rounded() > 0.0) {
            self.spandrels(face, plane, &opening.top());
        }
    }

    /// The wall between an arch and the corners of its rectangle, as fans around these.
    fn spandrels(&mut self, face: &RoomFace, plane: WallPlane, arc: &[DVec2]) {
        let high = arc[arc.len() / 2];
        let halves = [(arc[0].x, &arc[..=arc.len() / 2]), (arc[arc.len() - 1].x, &arc[arc.len() / 2..])];
        for (u, half) in halves {
            let corner = plane.point(self.extents, u, high.y);
            for pair in half.windows(2) {
                let mut part = vec![corner];
                part.extend(pair.iter().map(|p| plane.point(self.extents, p.x, p.y)));
                // Only what lies on this face: an opening may go on over several.
                let u = |p: DVec3| plane.coordinates(p).x;
                let ends = face.polygon.iter().map(|p| u(*p));
                let (low, top) = ends.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
                let part = clipped(&part, |p| u(p) - low);
                let part = clipped(&part, |p| top - u(p));
                self.polygon(&part, face.normal);
            }
        }
    }

    /// The sides of a hole that go on with the wall, or with the floor, from the face outward.
    fn reveals(&mut self, hole: &Opening, depth: f64, wanted: Side) {
        let plane = WallPlane { wall: hole.wall, inset: hole.inset };
        // NaN makes no reveals either.
        if depth.is_nan() || depth <= 0.0 {
            return;
        }
        let outward = -plane.normal() * depth;
        let outline = hole.outline();
        let at = |p: DVec2| plane.point(self.extents, p.x, p.y);
        let side_of = |i: usize| {
            let next = outline[(i + 1) % outline.len()];
            if outline[i].y.max(next.y) < ON_FLOOR { Side::Threshold } else { Side::Wall }
        };
        let sides: Vec<([DVec3; 4], DVec3)> = (0..outline.len())
            .filter(|i| side_of(*i) == wanted)
            .map(|i| {
                let (a, b) = (at(outline[i]), at(outline[(i + 1) % outline.len()]));
                // The outline runs round the hole with that on its left, seen with u to the right.
                let along = at(DVec2::X) - at(DVec2::ZERO);
                let turned = along.cross(DVec3::Y).dot(plane.normal());
                let side = plane.normal().cross(b - a) * turned.signum();
                ([a, b, b + outward, a + outward], side.normalize_or(DVec3::Y))
            })
            .collect();
        for (side, normal) in sides {
            self.polygon(&side, normal);
        }
    }

    fn vertex(&mut self, at: DVec3, normal: DVec3) -> u32 {
        let key = |v: DVec3| (v * 1e6).round().to_array().map(|c| c as i64);
        let ([x, y, z], [a, b, c]) = (key(at), key(normal));
        let (mesh, surface, extents) = (&mut *self.mesh, self.surface, self.extents);
        *self.welded.entry([x, y, z, a, b, c]).or_insert_with(|| {
            let share = (surface.coordinates(at) / surface.size(extents)).clamp(DVec2::ZERO, DVec2::ONE).as_vec2();
            let uv = if surface.wall().is_some() { Vec2::new(share.x, 1.0 - share.y) } else { share };
            mesh.positions.push(at.as_vec3());
            mesh.normals.push(normal.as_vec3());
            mesh.uvs.push(uv);
            mesh.positions.len() as u32 - 1
        })
    }

    /// A box, its sides outward.
    fn cuboid(&mut self, x: [f64; 2], y: [f64; 2], z: [f64; 2]) {
        let at = |i: usize, j: usize, k: usize| DVec3::new(x[i], y[j], z[k]);
        for (side, normal) in [
            ([at(0, 0, 0), at(0, 1, 0), at(0, 1, 1), at(0, 0, 1)], DVec3::NEG_X),
            ([at(1, 0, 0), at(1, 1, 0), at(1, 1, 1), at(1, 0, 1)], DVec3::X),
            ([at(0, 0, 0), at(1, 0, 0), at(1, 0, 1), at(0, 0, 1)], DVec3::NEG_Y),
            ([at(0, 1, 0), at(1, 1, 0), at(1, 1, 1), at(0, 1, 1)], DVec3::Y),
            ([at(0, 0, 0), at(1, 0, 0), at(1, 1, 0), at(0, 1, 0)], DVec3::NEG_Z),
            ([at(0, 0, 1), at(1, 0, 1), at(1, 1, 1), at(0, 1, 1)], DVec3::Z),
        ] {
            self.polygon(&side, normal);
        }
    }

    /// A convex polygon as a fan, wound so that its normal agrees with the one given.
    fn polygon(&mut self, corners: &[DVec3], normal: DVec3) {
        if corners.len() < 3 {
            return;
        }
        let turned: DVec3 =
            (1..corners.len() - 1).map(|i| (corners[i] - corners[0]).cross(corners[i + 1] - corners[0])).sum();
        let agrees = turned.dot(normal) >= 0.0;
        let ids: Vec<u32> = corners.iter().map(|p| self.vertex(*p, normal)).collect();
        for i in 1..ids.len() - 1 {
            let (b, c) = if agrees { (ids[i], ids[i + 1]) } else { (ids[i + 1], ids[i]) };
            self.triangles.push([ids[0], b, c]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bvh;
    use harmony_scene::{Opening, OpeningKind, Wall};

    fn room() -> Room {
        let opening = |kind, wall, u, y| Opening { kind, wall, u, y, inset: 0.0, rise: 0.0, object: None };
        Room {
            room_type: "bedroom".into(),
            extents: Extents { width: 4.0, height: 2.5, depth: 5.0 },
            shape: harmony_scene::RoomShape::default(),
            seen: vec![],
            openings: vec![
                opening(OpeningKind::Window, Wall::Back, [1.0, 2.0], [0.9, 2.0]),
                opening(OpeningKind::Window, Wall::Back, [2.5, 3.5], [1.1, 2.2]),
                opening(OpeningKind::Door, Wall::Left, [3.0, 3.9], [0.0, 2.0]),
                opening(OpeningKind::Window, Wall::Right, [-1.0, 0.5], [1.0, f64::NAN]),
            ],
            floor_texture: None,
            wall_texture: None,
        }
    }

    fn area(mesh: &Mesh, group: &Group, keep: impl Fn(DVec3) -> bool) -> f64 {
        group
            .triangles
            .iter()
            .map(|t| t.map(|i| mesh.positions[i as usize].as_dvec3()))
            .filter(|[a, b, c]| keep((*b - *a).cross(*c - *a)))
            .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
            .sum()
    }

    #[test]
    fn a_face_shines_as_was_said_and_the_others_as_paint() {
        let roughness = BTreeMap::from([(Surface::Floor, 0.2)]);
        let mesh = room_shell_with(&room(), &|_| None, &ShellOptions { roughness, ..ShellOptions::default() });
        let of = |name: &str| mesh.materials.iter().find(|m| m.name == name).unwrap().roughness;
        assert_eq!((of("floor"), of("wall_back")), (0.2, Material::plain("", [0.5; 3]).roughness));
    }

    #[test]
    fn walls_have_the_area_of_the_face_less_its_openings_and_normals_point_in() {
        let room = room();
        let mesh = room_shell(&room, &|_| None);
        mesh.check().unwrap();
        let names: Vec<&str> = mesh.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["floor", "ceiling", "wall_back", "wall_left", "wall_right", "wall_front"]);
        // The threshold of the door, 0.9 m wide, is the floor's.
        let holes = [-0.9 * ShellOptions::default().reveal, 0.0, 1.1 + 1.1, 1.8, 0.0, 0.0];
        for ((surface, group), hole) in Surface::ALL.into_iter().zip(&mesh.groups).zip(holes) {
            let size = surface.size(&room.extents);
            let inward = |n: DVec3| n.normalize().dot(surface.normal()) > 0.999;
            let got = area(&mesh, group, inward);
            assert!((got - (size.x * size.y - hole)).abs() <= 1e-5, "{surface:?}: {got}");
            let against = area(&mesh, group, |n| n.dot(surface.normal()) < -1e-6);
            assert!(against == 0.0, "{surface:?} has triangles that face out");
        }
        for (i, t) in mesh.triangles().enumerate() {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            assert!((b - a).cross(c - a).dot(mesh.normals[t[0] as usize]) > 0.0, "winding of triangle {i}");
        }
    }

    #[test]
    fn rays_leave_through_the_openings_only_and_texture_coordinates_follow_the_face() {
        let room = room();
        let mesh = room_shell(&room, &|_| None);
        let bvh = Bvh::new(&mesh);
        let eye = DVec3::new(1.5, 1.4, 3.0);
        assert!(!bvh.any_hit(eye, DVec3::new(1.5, 1.5, 0.0) - eye, 100.0), "through the window");
        assert!(!bvh.any_hit(eye, DVec3::new(0.0, 1.0, 3.4) - eye, 100.0), "through the door");
        let triangles: Vec<[u32; 3]> = mesh.triangles().collect();
        let top_left = DVec3::new(0.02, 2.48, 0.0);
        let hit = bvh.raycast(eye, top_left - eye, 100.0).unwrap();
        assert!((hit.point - top_left).length() < 1e-6);
        let near_corner =
            triangles[hit.triangle].iter().map(|i| mesh.uvs[*i as usize]).any(|uv| uv == Vec2::new(0.0, 0.0));
        assert!(near_corner, "the top left of the back wall has uv (0, 0)");
        let jamb = bvh.raycast(DVec3::new(1.5, 1.4, -0.05), DVec3::X, 10.0).unwrap();
        assert!((jamb.distance - 0.5).abs() < 1e-6 && jamb.normal.x < -0.99, "the reveal faces into the opening");
    }

    #[test]
    fn an_arch_is_open_below_its_curve_and_wall_above_it() {
        let mut room = room();
        let (half, y1) = (0.6, 2.2);
        let arched = |wall, u: f64, rise| Opening {
            kind: OpeningKind::Door,
            wall,
            u: [u - half, u + half],
            y: [0.0, y1],
            inset: 0.0,
            rise,
            object: None,
        };
        for wall in Wall::ALL {
            for rise in [0.6, 0.25, 5.0] {
                room.openings = vec![arched(wall, 1.5, rise)];
                let mesh = room_shell(&room, &|_| None);
                mesh.check().unwrap();
                let bvh = Bvh::new(&mesh);
                let eye = DVec3::new(2.0, 1.2, 2.5);
                let passes = |u: f64, y: f64| {
                    let way = wall.point(&room.extents, u, y) - eye;
                    !bvh.any_hit(eye, way, way.length() + 1e-3)
                };
                // A circle through both springings and the top.
                let rise = rise.min(half);
                let radius = (half * half + rise * rise) / (2.0 * rise);
                for u in [-0.55, -0.3, 0.0, 0.2, 0.5_f64] {
                    let top = y1 - radius + (radius * radius - u * u).sqrt();
                    assert!(passes(1.5 + u, top - 0.03), "{wall:?} {rise} {u}: open under {top}");
                    assert!(!passes(1.5 + u, top + 0.03), "{wall:?} {rise} {u}: wall over {top}");
                }
                assert!(!passes(1.5, y1 + 0.02) && !passes(1.5 + half + 0.02, 1.0) && passes(1.5, 0.02));
                // Every reveal looks into the hole.
                let middle = wall.point(&room.extents, 1.45, 1.0) - wall.normal() * 0.05;
                for direction in [DVec3::Y, DVec3::NEG_Y, wall.normal().cross(DVec3::Y), DVec3::Y.cross(wall.normal())]
                {
                    let hit = bvh.raycast(middle, direction, 3.0).unwrap();
                    assert!(hit.normal.dot(direction) < -0.9, "{wall:?} {direction}: {}", hit.normal);
                }
            }
        }
    }

    #[test]
    fn a_block_under_the_ceiling_is_closed_above_and_one_below_it_has_its_own_top() {
        let mut room = room();
        let height = room.extents.height;
        let block = |x: f64, top: f64| Block {
            kind: "pier".to_owned(),
            min: DVec3::new(x, 0.0, 2.0),
            max: DVec3::new(x + 0.5, top, 2.4),
        };
        room.shape.blocks = vec![block(0.5, height), block(1.5, 1.0)];
        // A beam goes with the ceiling, with all its sides.
        let beam =
            Block { min: DVec3::new(0.0, height - 0.3, 3.0), max: DVec3::new(4.0, height, 3.3), ..block(0.0, height) };
        room.shape.blocks.push(beam);
        let options = ShellOptions { omit: vec![Surface::Ceiling], ..ShellOptions::default() };
        let whole = room_shell_with(&room, &|_| None, &ShellOptions::default());
        for part in ["ceiling_block_03_ceiling", "ceiling_block_03_top"] {
            assert!(whole.materials.iter().any(|m| m.name == part) && is_left_out(part, &["ceiling"]), "{part}");
        }
        let mesh = room_shell_with(&room, &|_| None, &options);
        assert!(mesh.materials.iter().any(|m| m.name == "block_01_top"));
        assert!(mesh.materials.iter().all(|m| m.name != "block_02_top"));
        let below = Bvh::new(&mesh).raycast(DVec3::new(2.5, height + 1.0, 3.15), DVec3::NEG_Y, 9.0).unwrap();
        assert!((below.distance - height - 1.0).abs() < 1e-6, "the floor is seen through where the beam was");
        let along = |mesh: &Mesh| {
            let from = DVec3::new(2.5, height - 0.15, 4.5);
            Bvh::new(mesh).raycast(from, DVec3::NEG_Z, 9.0).unwrap().distance
        };
        assert!((along(&whole) - 1.2).abs() < 1e-6 && (along(&mesh) - 4.5).abs() < 1e-6, "its sides go, too");
        let bvh = Bvh::new(&mesh);
        let hit = bvh
            .raycast(DVec3::new(2.0, height - 0.15, 3.15), DVec3::NEG_X, 9.0)
            .expect("the wall goes on where the beam was");
        assert!((hit.distance - 2.0).abs() < 1e-6 && hit.normal.x > 0.9);
        let from_above = |x: f64| bvh.raycast(DVec3::new(x, height + 1.0, 2.2), DVec3::NEG_Y, 9.0).unwrap();
        for (x, top) in [(0.75, height), (1.75, 1.0)] {
            let hit = from_above(x);
            assert!((height + 1.0 - hit.distance - top).abs() < 2e-3 && hit.normal.y > 0.9, "{x}: {hit:?}");
        }
    }

    #[test]
    fn a_cove_lights_its_tray_and_is_not_seen_from_below() {
        let mut room = room();
        let niche = |glow, min: [f64; 3], max: [f64; 3]| harmony_scene::Niche {
            kind: "tray".to_owned(),
            surface: Surface::Ceiling,
            sides: Some([0.5; 3]),
            glow,
            min: min.into(),
            max: max.into(),
        };
        room.shape.niches = vec![
            niche(None, [0.85, 2.5, 0.85], [3.15, 2.55, 4.15]),
            niche(Some([1.0, 0.8, 0.6]), [0.7, 2.55, 0.7], [3.3, 2.7, 4.3]),
        ];
        let mesh = room_shell(&room, &|_| None);
        mesh.check().unwrap();
        let cove = mesh.materials.iter().position(|m| m.name == cove_name(Surface::Ceiling, 1)).unwrap();
        assert_eq!(mesh.materials[cove].emissive, [1.0, 0.8, 0.6]);
        assert!(mesh.materials.iter().any(|m| m.name == "ceiling_niche_01"));
        let group = mesh.groups.iter().find(|g| g.material == cove).unwrap();
        let strips: Vec<[u32; 3]> = mesh.triangles().collect();
        let bvh = Bvh::new(&mesh);
        let places = || group.triangles.iter().flatten().map(|i| mesh.positions[*i as usize].as_dvec3());
        let eye = DVec3::new(1.2, 1.4, 2.8);
        for at in places() {
            assert!(room.is_free(at + DVec3::Y * 1e-4), "{at} lies in the tray");
            let hit = bvh.raycast(eye, at - eye, 100.0).unwrap();
            let own = group.triangles.contains(&strips[hit.triangle]);
            assert!(!own && hit.point.distance(at) > 0.005, "{at} is seen from {eye}");
        }
        // It shines up to the field.
        let top = bvh.raycast(DVec3::new(0.73, 2.56, 2.0), DVec3::new(0.5, 1.0, 0.0), 1.0).unwrap();
        assert!((top.point.y - 2.7).abs() < 1e-6);
        assert!(is_cove_name(&cove_name(Surface::Ceiling, 1)) && !is_cove_name("ceiling_cove_01_glow"));
        for (name, face) in
            [("ceiling_niche_02_glow", "ceiling"), ("ceiling", "ceiling"), ("wall_left_niche_01", "wall_left")]
        {
            assert!(is_left_out(name, &[face]));
        }
        assert!(!is_left_out("ceiling_lamp_01", &["ceiling"]) && !is_left_out("wall_left_niche_01", &["wall_right"]));
        let without = ShellOptions { omit: vec![Surface::Ceiling], ..ShellOptions::default() };
        let mesh = room_shell_with(&room, &|_| None, &without);
        assert!(mesh.materials.iter().all(|m| m.name != cove_name(Surface::Ceiling, 1)));
    }

    #[test]
    fn faces_can_be_left_out() {
        let options = ShellOptions { omit: vec![Surface::Ceiling, Surface::Front], ..ShellOptions::default() };
        let mesh = room_shell_with(&room(), &|_| Some(Arc::new(RgbaImage::new(2, 2))), &options);
        let names: Vec<&str> = mesh.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["floor", "wall_back", "wall_left", "wall_right"]);
        assert!(mesh.materials.iter().all(|m| m.texture.is_some() && !m.double_sided));
    }
}
