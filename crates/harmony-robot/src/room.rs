//! The scene around a robot: meshes to measure and to keep away from.
//!
//! # Frames
//! The room frame. Every mesh is taken into it once, where `scene.json` has the object; what a robot moves is moved by
//! `room_from_room`, a turn and an offset. Parts that open are things of their own, on the thing that they belong to.
//!
//! # What is in the way
//! The reconstructed triangles themselves, and the room's solids: floor, ceiling and walls with their openings, blocks,
//! niches and slopes. What lies flat under everything (rugs) gives way, as it does in `harmony-physics`.
//!
//! # Distances
//! Between a convex piece of the robot and the triangles: what is apart by parry, what touches by separating axes. Below 0 is how far the piece must move to leave the deepest triangle that it meets: a mesh is a surface, and a
//! piece wholly inside a closed one would meet none. Robots move by small steps, so that they meet the surface first.

use glam::{DAffine3, DQuat, DVec3};
use harmony_catalogue::Trait;
use harmony_export::World;
use harmony_export::world::Select;
use harmony_mesh::{Bvh, Mesh};
use harmony_physics::Hull;
use harmony_scene::{Extents, Room, Support};
use parry3d::bounding_volume::BoundingVolume as _;
use parry3d::math::{Pose, Rotation, Vector};
use parry3d::query;
use parry3d::shape::{ConvexPolyhedron, Shape as _, TriMesh};

use crate::RobotError;
use crate::model::Model;
use crate::separation::Separable;
use crate::shapes::pieces;
use crate::solids::{Solid, solids};

/// Farther apart than this nothing is taken for touching, metres.
const DOUBTFUL_M: f64 = 0.01;
/// Things this near touch, metres.
const SAME_PLACE_M: f32 = 1e-4;

/// An object of the scene.
pub struct Thing {
    /// As in `scene.json`.
    pub id: String,
    /// What it is.
    pub label: String,
    /// What it rests on.
    pub support: Support,
    /// Turn about +Y, radians.
    pub yaw: f64,
    /// Triangles in the room.
    pub triangles: Vec<[DVec3; 3]>,
    /// For rays.
    pub bvh: Bvh,
    /// Smallest corner.
    pub low: DVec3,
    /// Largest corner.
    pub high: DVec3,
    /// Whether it lies flat under everything and gives way.
    pub flat: bool,
    /// Whether it is a part that opens of the thing that it is on.
    pub part: bool,
    mesh: TriMesh,
}

/// What a robot has around it.
pub struct Surroundings {
    /// In the scene's order.
    pub things: Vec<Thing>,
    /// Of the room's box.
    pub extents: Extents,
    solids: Vec<Solid>,
    /// By thing: the thing that it stands on.
    hosts: Vec<Option<usize>>,
}

/// What is near.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Other {
    /// An object by its number.
    Thing(usize),
    /// A face of the room.
    Face(&'static str),
}

/// The nearest of what was looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Near {
    /// Link of the robot.
    pub link: usize,
    /// What it is near to.
    pub other: Other,
    /// Metres; below 0 they are in each other.
    pub distance: f64,
}

impl Piece {
    /// Smallest and largest corner in the room.
    fn bounds(&self, place: &DAffine3) -> (DVec3, DVec3) {
        let corners = self.hull.vertices.iter().map(|v| place.transform_point3(*v));
        corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)))
    }
}

/// Convex pieces of a robot's links, ready for queries.
pub struct Shapes {
    links: Vec<Vec<Piece>>,
}

struct Piece {
    hull: Hull,
    shape: ConvexPolyhedron,
    centre: DVec3,
    radius: f64,
}

impl Shapes {
    /// From the hulls of every link, link frame.
    pub fn new(links: &[Vec<Hull>]) -> Self {
        let piece = |hull: &Hull| {
            let points: Vec<Vector> = hull.vertices.iter().map(|v| vector(*v)).collect();
            let shape = ConvexPolyhedron::from_convex_mesh(points.clone(), &hull.faces)
                .or_else(|| ConvexPolyhedron::from_convex_hull(&points))?;
            let (low, high) = hull.bounds();
            let centre = (low + high) / 2.0;
            let radius = hull.vertices.iter().map(|v| v.distance(centre)).fold(0.0, f64::max);
            Some(Piece { hull: hull.clone(), shape, centre, radius })
        };
        Self { links: links.iter().map(|l| l.iter().filter_map(piece).collect()).collect() }
    }

    /// Of a model, as it is.
    pub fn of(model: &Model) -> Self {
        Self::new(&pieces(model))
    }

    /// Hulls of every link, link frame.
    pub fn hulls(&self) -> Vec<Vec<&Hull>> {
        self.links.iter().map(|l| l.iter().map(|p| &p.hull).collect()).collect()
    }

    /// Corners of a link's pieces in the room.
    pub fn corners<'a>(&'a self, link: usize, place: &'a DAffine3) -> impl Iterator<Item = DVec3> + 'a {
        self.links[link].iter().flat_map(|p| &p.hull.vertices).map(|v| place.transform_point3(*v))
    }
}

fn vector(v: DVec3) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

fn pose(place: &DAffine3) -> Pose {
    let q = DQuat::from_mat3(&place.matrix3).normalize();
    let turn = Rotation::from_xyzw(q.x as f32, q.y as f32, q.z as f32, q.w as f32);
    Pose::from_parts(vector(place.translation), turn)
}

impl Thing {
    /// Triangles, corners and search trees of a mesh that is in the room's frame.
    ///
    /// `None` when it has no triangle with an area.
    pub fn new(id: &str, label: &str, support: Support, yaw: f64, room_mesh: &Mesh) -> Option<Self> {
        let corner = |i: u32| room_mesh.positions[i as usize].as_dvec3();
        let triangles: Vec<[DVec3; 3]> = room_mesh.triangles().map(|t| t.map(corner)).collect();
        let points: Vec<Vector> = room_mesh.positions.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let whole = |t: &[u32; 3]| {
            let [a, b, c] = t.map(corner);
            (b - a).cross(c - a).length() > 1e-12
        };
        let mesh = TriMesh::new(points, room_mesh.triangles().filter(whole).collect()).ok()?;
        let (low, high) =
            triangles.iter().flatten().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        Some(Self {
            id: id.to_owned(),
            label: label.to_owned(),
            support,
            yaw,
            triangles,
            bvh: Bvh::new(room_mesh),
            low,
            high,
            flat: harmony_catalogue::has(label, Trait::Flat),
            part: false,
            mesh,
        })
    }
}

impl Surroundings {
    /// From a scene.
    pub fn new(world: &World) -> Self {
        let things = world.items.iter().flat_map(|item| {
            let o = &item.object;
            let of = |id: &str, support: &Support, mut mesh: Mesh| {
                for p in &mut mesh.positions {
                    *p = item.room_point(*p).as_vec3();
                }
                Thing::new(id, &o.label, support.clone(), o.pose.yaw, &mesh)
            };
            let on = Support::Object { id: o.id.clone() };
            let parts = item.opens.iter().enumerate().filter_map(|(k, part)| {
                Some(Thing { part: true, ..of(&part.name, &on, item.selected(Select::Part(k)))? })
            });
            let mut all = vec![];
            match of(o.id.as_str(), &o.support, item.selected(Select::Fixed)) {
                Some(fixed) => all.extend(std::iter::once(fixed).chain(parts)),
                // All of it opens: it has no parts then.
                None => all.extend(of(o.id.as_str(), &o.support, (*item.mesh).clone())),
            }
            all
        });
        Self::of(things.collect(), &world.scene.room)
    }

    /// From things that are in a room.
    pub fn of(things: Vec<Thing>, room: &Room) -> Self {
        let host = |t: &Thing| match &t.support {
            Support::Object { id } => things.iter().position(|h| h.id == id.as_str()),
            _ => None,
        };
        let hosts = things.iter().map(host).collect();
        Self { things, extents: room.extents, solids: solids(room), hosts }
    }

    /// The number of an object by its id.
    ///
    /// # Errors
    /// [`RobotError::Nothing`].
    pub fn named(&self, id: &str) -> Result<usize, RobotError> {
        let found = self.things.iter().position(|t| t.id == id);
        found.ok_or_else(|| RobotError::Nothing { what: format!("object {id}") })
    }

    /// Name of what is near.
    pub fn name(&self, other: Other) -> String {
        match other {
            Other::Thing(k) => self.things[k].id.clone(),
            Other::Face(name) => format!("the {name}"),
        }
    }

    /// The nearest of all that a robot has around it, within a distance; one object may be moved, with what it carries.
    ///
    /// `looks` says which pairs are looked at.
    pub fn nearest(
        &self,
        shapes: &Shapes,
        places: &[DAffine3],
        moved: Option<(usize, DAffine3)>,
        within: f64,
        looks: &dyn Fn(usize, Other) -> bool,
    ) -> Option<Near> {
        let mut best: Option<Near> = None;
        let undo = moved.map(|(_, m)| m.inverse());
        let rides: Vec<bool> = (0..self.things.len()).map(|k| moved.is_some_and(|m| self.rides(k, m.0))).collect();
        for (link, pieces) in shapes.links.iter().enumerate() {
            let place = &places[link];
            // The link as what has been moved sees it, which then stays where its triangles are.
            let beside = undo.map(|u| u * *place);
            for piece in pieces {
                // Corners only for what the ball does not tell to be far.
                let mut bounds: [Option<(DVec3, DVec3)>; 2] = [None; 2];
                for (k, thing) in self.things.iter().enumerate().filter(|(_, t)| !t.flat) {
                    let from = beside.as_ref().filter(|_| rides[k]).unwrap_or(place);
                    let far = best.map_or(within, |b| b.distance.min(within));
                    let centre = from.transform_point3(piece.centre);
                    let reach = piece.radius + far.max(0.0);
                    if centre.distance_squared(centre.clamp(thing.low, thing.high)) > reach * reach
                        || !looks(link, Other::Thing(k))
                    {
                        continue;
                    }
                    let (low, high) = *bounds[usize::from(rides[k])].get_or_insert_with(|| piece.bounds(from));
                    let apart = (low - thing.high).max(thing.low - high).max(DVec3::ZERO);
                    if apart.length_squared() > far.max(0.0).powi(2) {
                        continue;
                    }
                    if let Some(distance) = thing.distance(piece, from, far)
                        && distance < far
                    {
                        best = Some(Near { link, other: Other::Thing(k), distance });
                    }
                }
                self.faces(piece, place, link, within, looks, &mut best);
            }
        }
        best
    }

    fn faces(
        &self,
        piece: &Piece,
        place: &DAffine3,
        link: usize,
        within: f64,
        looks: &dyn Fn(usize, Other) -> bool,
        best: &mut Option<Near>,
    ) {
        let (centre, at) = (place.transform_point3(piece.centre), pose(place));
        let mut corners: Vec<DVec3> = Vec::new();
        for solid in &self.solids {
            let other = Other::Face(solid.face);
            let far = best.map_or(within, |b| b.distance.min(within));
            if solid.before(centre, piece.radius) >= far || !looks(link, other) {
                continue;
            }
            if corners.is_empty() {
                corners.extend(piece.hull.vertices.iter().map(|v| place.transform_point3(*v)));
            }
            let distance = solid.distance(&corners, &piece.shape, &at);
            if distance < far {
                *best = Some(Near { link, other, distance });
            }
        }
    }

    /// Chairs, by what they are called.
    pub fn chairs(&self) -> Vec<usize> {
        (0..self.things.len()).filter(|k| harmony_catalogue::has(&self.things[*k].label, Trait::Chair)).collect()
    }

    /// What an object is in when it is moved, walls before other objects; what it meets where it stands does not count.
    pub fn met_by(&self, thing: usize, moved: DAffine3) -> Option<Other> {
        let own = &self.things[thing];
        let here = pose(&moved);
        let corner = |v: &Vector| DVec3::new(v.x.into(), v.y.into(), v.z.into());
        let corners: Vec<DVec3> = own.mesh.vertices().iter().map(corner).collect();
        let moved: Vec<DVec3> = corners.iter().map(|c| moved.transform_point3(*c)).collect();
        let (low, high) = moved.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let into = |s: &&Solid| {
            let now = s.distance(&moved, &own.mesh, &here);
            // It comes nearer: what stands at a wall may be drawn along it.
            now <= 0.0 && now < s.distance(&corners, &own.mesh, &Pose::IDENTITY)
        };
        if let Some(solid) = self.solids.iter().filter(|s| s.face != "floor" && s.face != "ceiling").find(into) {
            return Some(Other::Face(solid.face));
        }
        let others = self.things.iter().enumerate().filter(|(k, t)| *k != thing && !t.flat);
        others
            .filter(|(k, _)| !self.rides(*k, thing) && !self.rides(thing, *k))
            .filter(|(_, other)| (low - other.high).max(other.low - high).max_element() <= 0.0)
            .find(|(_, other)| other.meets(own, &here) && !other.touches(own))
            .map(|(k, _)| Other::Thing(k))
    }

    /// Free way from a point along a direction until the room ends, metres; infinite through an opening.
    pub fn free_of_room(&self, from: DVec3, along: DVec3) -> f64 {
        self.solids.iter().filter_map(|s| s.ray(from, along)).fold(f64::INFINITY, f64::min)
    }

    /// Whether a thing is another, or stands on it, directly or by what it stands on.
    pub fn rides(&self, thing: usize, on: usize) -> bool {
        let mut at = thing;
        // No longer chain than there are things, should supports be a ring.
        for _ in 0..=self.things.len() {
            if at == on {
                return true;
            }
            let Some(next) = self.hosts[at] else { return false };
            at = next;
        }
        false
    }
}

impl Thing {
    /// Distance of a convex piece; `None` when it is no nearer than `within`.
    ///
    /// What is apart is found from the nearest of the tree's boxes on, so that few triangles are looked at. Iterations in
    /// single precision take long thin triangles a millimetre off for touching: whatever they do not find apart is looked at
    /// along the axes that can separate it from each triangle.
    fn distance(&self, piece: &Piece, place: &DAffine3, within: f64) -> Option<f64> {
        if within > 0.0 {
            let apart = query::distance(&pose(place), &piece.shape, &Pose::IDENTITY, &self.mesh).ok()?.distance;
            if apart > 0.0 {
                return (f64::from(apart) < within).then_some(apart.into());
            }
        }
        let near = piece.shape.compute_aabb(&pose(place)).loosened(within.clamp(0.0, DOUBTFUL_M) as f32);
        let solid = Separable::new(&piece.hull, place);
        let mut best = within.max(0.0);
        let mut found = None;
        for k in self.mesh.bvh().leaves(|node| node.aabb().intersects(&near)) {
            let corners = self.mesh.triangle(k).vertices().map(|v| DVec3::new(v.x.into(), v.y.into(), v.z.into()));
            if let Some(distance) = solid.separation(corners, best) {
                (best, found) = (distance, Some(distance));
            }
        }
        found
    }

    /// Whether its triangles meet those of another that is moved.
    fn meets(&self, other: &Self, at: &Pose) -> bool {
        query::intersection_test(at, &other.mesh, &Pose::IDENTITY, &self.mesh).is_ok_and(|found| found.intersecting)
    }

    /// Whether it touches another where both stand.
    fn touches(&self, other: &Self) -> bool {
        let here = Pose::IDENTITY;
        query::distance(&here, &other.mesh, &here, &self.mesh).is_ok_and(|d| d.distance <= SAME_PLACE_M)
    }

    /// Height of the highest point below a height at a place, if there is one, and whether it looks up.
    pub fn top_at(&self, x: f64, z: f64, below: f64) -> Option<(f64, bool)> {
        let from = DVec3::new(x, below, z);
        let hit = self.bvh.raycast(from, DVec3::NEG_Y, below + 1.0)?;
        Some((hit.point.y, hit.normal.y.abs() > 0.5))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use harmony_physics::hull::hull_mesh;

    use super::*;

    pub(crate) fn thing(id: &str, label: &str, boxes: &[([f64; 3], [f64; 3])]) -> Thing {
        let hulls: Vec<Hull> = boxes.iter().map(|(l, h)| Hull::cuboid((*l).into(), (*h).into())).collect();
        Thing::new(id, label, Support::Floor, 0.0, &hull_mesh(&hulls, [0.5; 3])).unwrap()
    }

    pub(crate) fn bare() -> Room {
        Room {
            room_type: "study".into(),
            extents: Extents { width: 5.0, height: 2.6, depth: 4.0 },
            shape: harmony_scene::RoomShape::default(),
            seen: vec![],
            openings: vec![],
            floor_texture: None,
            wall_texture: None,
        }
    }

    pub(crate) fn room(things: Vec<Thing>) -> Surroundings {
        Surroundings::of(things, &bare())
    }

    /// An L: the back right corner is a block of 2 x 1.5 m.
    pub(crate) fn l_plan() -> Room {
        let mut room = bare();
        let (min, max) = (DVec3::new(3.0, 0.0, 0.0), DVec3::new(5.0, 2.6, 1.5));
        room.shape.blocks.push(harmony_scene::Block { kind: "corner".into(), min, max });
        room
    }

    fn by(offset: DVec3) -> DAffine3 {
        DAffine3::from_translation(offset)
    }

    fn ball(radius: f64) -> Shapes {
        Shapes::new(&[vec![Hull::cuboid(DVec3::splat(-radius), DVec3::splat(radius))]])
    }

    #[test]
    fn distances_and_depths_are_those_of_boxes() {
        let room = room(vec![thing("table_01", "table", &[([2.0, 0.7, 1.0], [3.0, 0.74, 2.0])])]);
        let shapes = ball(0.05);
        let at = |x: f64, y: f64, z: f64| [DAffine3::from_translation(DVec3::new(x, y, z))];
        let near = |p: &[DAffine3]| room.nearest(&shapes, p, None, 0.5, &|_, _| true).unwrap();
        let above = near(&at(2.5, 0.84, 1.5));
        assert!((above.distance - 0.05).abs() < 1e-5 && above.other == Other::Thing(0), "{above:?}");
        let sunk = near(&at(2.5, 0.78, 1.5));
        assert!((sunk.distance + 0.01).abs() < 1e-4, "{sunk:?}");
        let low = near(&at(4.0, 0.03, 1.5));
        assert!((low.distance + 0.02).abs() < 1e-5 && low.other == Other::Face("floor"), "{low:?}");
        let moved =
            room.nearest(&shapes, &at(2.5, 0.84, 1.5), Some((0, by(DVec3::Y * 0.02))), 0.5, &|_, _| true).unwrap();
        assert!((moved.distance - 0.03).abs() < 1e-5, "{moved:?}");
        assert!(room.nearest(&shapes, &at(1.0, 1.3, 1.5), None, 0.3, &|_, _| true).is_none());
    }

    #[test]
    fn a_chair_that_is_drawn_meets_what_is_behind_it() {
        let chair = thing("chair_01", "chair", &[([1.0, 0.0, 1.0], [1.4, 0.9, 1.4])]);
        let shelf = thing("shelf_01", "bookshelf", &[([1.0, 0.0, 1.7], [1.4, 1.8, 2.0])]);
        let room = room(vec![chair, shelf]);
        assert_eq!(room.met_by(0, by(DVec3::Z * 0.299)), None);
        assert_eq!(room.met_by(0, by(DVec3::Z * 0.301)), Some(Other::Thing(1)));
        assert_eq!(room.met_by(0, by(DVec3::X * -0.999)), None);
        assert_eq!(room.met_by(0, by(DVec3::X * -1.001)), Some(Other::Face("left wall")));
    }

    #[test]
    fn a_link_is_kept_out_of_a_block_and_may_pass_where_the_box_alone_would_stop_it() {
        let room = Surroundings::of(vec![], &l_plan());
        let near = |x: f64, y: f64, z: f64| {
            let place = [DAffine3::from_translation(DVec3::new(x, y, z))];
            room.nearest(&ball(0.05), &place, None, 0.5, &|_, o| o != Other::Face("floor"))
        };
        // Before the block's face, before its edge, and in it; the walls of the box are metres away.
        let face = near(4.0, 1.3, 1.65).unwrap();
        assert!((face.distance - 0.10).abs() < 1e-9, "{face:?}");
        let edge = near(2.8, 1.3, 1.75).unwrap();
        assert!((edge.distance - 0.15_f64.hypot(0.20)).abs() < 1e-5, "{edge:?}");
        let inside = near(4.0, 1.3, 1.3).unwrap();
        assert!((inside.distance + 0.25).abs() < 1e-9, "{inside:?}");
        // A niche in the left wall, 0.3 m deep, and a slope before the front wall.
        let mut shaped = bare();
        let (min, max) = (DVec3::new(-0.3, 0.5, 1.0), DVec3::new(0.0, 1.5, 2.0));
        let surface = harmony_scene::Surface::Left;
        shaped.shape.niches.push(harmony_scene::Niche {
            kind: "niche".into(),
            surface,
            sides: None,
            glow: None,
            min,
            max,
        });
        shaped.shape.slopes.push(harmony_scene::Slope { wall: harmony_scene::Wall::Front, low: 1.6, run: 1.0 });
        let room = Surroundings::of(vec![], &shaped);
        let near = |x: f64, y: f64, z: f64| {
            let place = [DAffine3::from_translation(DVec3::new(x, y, z))];
            room.nearest(&ball(0.05), &place, None, 0.5, &|_, _| true).unwrap().distance
        };
        assert!(
            (near(-0.15, 1.0, 1.5) - 0.10).abs() < 1e-9,
            "in the niche, before its back: {}",
            near(-0.15, 1.0, 1.5)
        );
        assert!(near(-0.15, 0.45, 1.5) < -0.04, "in what is under it");
        assert!(near(2.5, 2.4, 3.7) < 0.0, "above the slope");
        assert!((room.free_of_room(DVec3::new(2.5, 1.0, 3.5), DVec3::Y) - 1.1).abs() < 1e-9);
    }

    #[test]
    fn a_chair_is_not_drawn_into_a_block() {
        let chair = || thing("chair_01", "chair", &[([2.2, 0.0, 0.4], [2.7, 0.9, 0.9])]);
        let drawn = |room: &Room| Surroundings::of(vec![chair()], room).met_by(0, by(DVec3::X * 0.4));
        assert_eq!(drawn(&bare()), None, "nothing near in the box");
        assert_eq!(drawn(&l_plan()), Some(Other::Face("back wall")));
    }
}
