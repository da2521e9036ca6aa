//! The scene as far as it is built.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_scene::{
    Camera, Confidence, ImageSize, Mask, ObjectId, PointMap, PointMapKind, Pose, Room, Similarity, Size, Support, Vec2,
    Vec3, Wall,
};

use harmony_geometry::RoomPosterior;

pub(crate) mod attachment;
pub(crate) mod evidence;
pub(crate) mod item;
pub(crate) mod shape;
pub(crate) mod subtree;
pub(crate) mod support;

pub(crate) use evidence::TRUSTED_IOU;
pub use evidence::{Energy, Evidence, Spread};
pub use item::{Item, Traits, YawHint};
pub use shape::Shape;

/// Room left between an object and a loose wall, metres.
const LOOSE_GAP: f64 = 0.01;

/// The point map in the room frame.
#[derive(Debug, Clone)]
pub struct RoomPoints {
    /// What the points mean.
    pub kind: PointMapKind,
    /// Grid size; covers the whole image, at any resolution.
    pub size: ImageSize,
    /// Room positions, metres; NaN where there is none.
    pub xyz: Vec<Vec3>,
    /// Confidence, 0 = none.
    pub confidence: Vec<f32>,
}

impl RoomPoints {
    /// Carries a point map into the room.
    pub fn new(map: &PointMap, room_from_points: &Similarity) -> Self {
        let xyz = map
            .xyz
            .iter()
            .map(|p| if p.is_finite() { room_from_points.point(p.as_dvec3()) } else { Vec3::NAN })
            .collect();
        Self { kind: map.kind, size: map.size, xyz, confidence: map.confidence.clone() }
    }

    /// The point seen at a position in an image of the photo, if there is one.
    pub(crate) fn at(&self, image: ImageSize, pixel: Vec2) -> Option<Vec3> {
        let (w, h) = (self.size.width, self.size.height);
        let x = (pixel.x * f64::from(w) / f64::from(image.width)) as usize;
        let y = (pixel.y * f64::from(h) / f64::from(image.height)) as usize;
        let i = y.min(h.saturating_sub(1) as usize) * w as usize + x.min(w.saturating_sub(1) as usize);
        let (point, confidence) = (self.xyz.get(i)?, self.confidence.get(i)?);
        (*confidence > 0.0 && point.is_finite()).then_some(*point)
    }

    /// Whether objects have depths of their own.
    pub fn is_dense(&self) -> bool {
        !matches!(self.kind, PointMapKind::RoomBox)
    }
}

/// An object with its pose.
#[derive(Debug, Clone)]
pub struct Placed {
    /// The object.
    pub item: Arc<Item>,
    /// Pose of its canonical mesh.
    pub pose: Pose,
    /// What carries it.
    pub support: Support,
    /// What speaks for the pose.
    pub evidence: Evidence,
}

impl Placed {
    /// Size in the room before rotation, metres.
    pub fn size(&self) -> Size {
        Size::from_vec(self.item.shape.bounds().size() * self.pose.scale * self.pose.stretch)
    }

    /// Confidence from the evidence.
    pub fn confidence(&self) -> Confidence {
        self.evidence.confidence(self.item.detection)
    }
}

/// Room, camera, point map, and the objects placed so far.
#[derive(Debug, Clone)]
pub struct PartialScene {
    /// The room.
    pub room: Room,
    /// The photo's camera at working resolution; masks have its size.
    pub camera: Camera,
    /// The point map, if there is one.
    pub points: Option<RoomPoints>,
    /// Deepest floor corner, the anchor of the traversal (room frame).
    pub anchor: Vec3,
    /// Objects in placement order.
    pub placed: Vec<Placed>,
    /// How surely camera, room and scale are known, when a point map was calibrated.
    pub posterior: Option<RoomPosterior>,
    /// Pixels that are nobody's and may hide anybody: a person, a watermark, an undistorted picture's empty frame.
    pub nobodys: Option<Arc<Mask>>,
    /// How far [`PartialScene::fit_loose_walls`] has moved each wall out, metres (inward: negative).
    grown: BTreeMap<Wall, f64>,
}

impl PartialScene {
    /// An empty room. `anchor` is the deepest floor corner; without one, the corner farthest along the view is taken.
    pub fn new(room: Room, camera: Camera, points: Option<RoomPoints>, anchor: Option<Vec3>) -> Self {
        let e = room.extents;
        let deepest = [Vec3::ZERO, Vec3::new(e.width, 0.0, 0.0)]
            .into_iter()
            .max_by(|a, b| camera.depth(*a).total_cmp(&camera.depth(*b)))
            .unwrap_or(Vec3::ZERO);
        Self {
            room,
            camera,
            points,
            anchor: anchor.unwrap_or(deepest),
            placed: Vec::new(),
            posterior: None,
            nobodys: None,
            grown: BTreeMap::new(),
        }
    }

    /// Whether a wall is where a guess put it: the room says which faces were seen, and this one was not.
    ///
    /// Objects may stand beyond a loose wall; [`PartialScene::fit_loose_walls`] then moves it. A room that says of no
    /// face that it was seen has no loose walls, and the back wall, which the room frame hangs on, is never loose.
    pub fn is_loose(&self, wall: Wall) -> bool {
        wall != Wall::Back && !self.room.seen.is_empty() && !self.room.seen.contains(&wall.surface())
    }

    /// Moves the loose walls: out to hold everything that was placed, to the backs of what is said to stand at them, and
    /// back to where they were guessed as far as they are not needed farther out any more: an object's first length may
    /// have been too large. Returns the shift along x of everything, metres: not 0 when the left wall, the frame's origin, has moved.
    pub fn fit_loose_walls(&mut self) -> f64 {
        let mut shift = 0.0;
        for wall in [Wall::Right, Wall::Front, Wall::Left] {
            if !self.is_loose(wall) {
                continue;
            }
            let by = self.loose_wall_moves_out(wall);
            if by.abs() < 1e-6 {
                continue;
            }
            for p in &mut self.placed {
                if matches!(&p.support, Support::Wall { wall: w } if *w == wall) {
                    p.pose.position -= wall.normal() * by;
                }
            }
            *self.grown.entry(wall).or_default() += by;
            let old = self.room.extents;
            match wall {
                Wall::Front => self.room.extents.depth += by,
                Wall::Right | Wall::Left => self.room.extents.width += by,
                Wall::Back => {}
            }
            let left = if wall == Wall::Left { by } else { 0.0 };
            self.room.shape.fitted(&old, &self.room.extents, left);
            if wall == Wall::Left {
                shift = by;
                self.shift(Vec3::X * by);
            }
        }
        shift
    }

    /// How far a loose wall goes outward, metres (inward: negative).
    fn loose_wall_moves_out(&self, wall: Wall) -> f64 {
        let e = self.room.extents;
        let inward = |p: Vec3| wall.distance(&e, p);
        let own = |p: &Placed| !matches!(&p.support, Support::Wall { wall: w } if *w == wall);
        let nearest = |p: &Placed| {
            let (low, high) = crate::scene::attachment::reach(&p.item, &p.pose);
            inward(p.pose.position + low).min(inward(p.pose.position + high))
        };
        let least = self.placed.iter().filter(|p| own(p)).map(nearest).fold(f64::INFINITY, f64::min);
        let at_wall = self
            .placed
            .iter()
            .filter(|p| p.support == Support::Floor && p.item.relations.wall_affinity.wall() == Some(wall))
            .map(nearest)
            .fold(f64::INFINITY, f64::min);
        let back = self.grown.get(&wall).map_or(0.0, |grown| grown.max(0.0));
        // Points and camera stay inside.
        let seen = self.points.as_ref().filter(|p| p.is_dense()).map_or(back, |points| {
            let mut far: Vec<f64> = points.xyz.iter().filter(|p| p.is_finite()).map(|p| inward(*p)).collect();
            let k = far.len() / 200;
            if far.is_empty() { 0.0 } else { *far.select_nth_unstable_by(k, f64::total_cmp).1 }
        });
        let bound = seen.min(inward(self.camera.centre()) - 0.2).min(least - LOOSE_GAP);
        if at_wall.is_finite() { -bound.min(at_wall - LOOSE_GAP) } else { -bound.min(back) }
    }

    /// Moves everything: camera, points, objects, anchor. The room's extents stay.
    fn shift(&mut self, by: Vec3) {
        self.camera.translation -= self.camera.rotation * by;
        self.anchor += by;
        for p in &mut self.placed {
            p.pose.position += by;
        }
        for p in self.points.iter_mut().flat_map(|p| &mut p.xyz) {
            *p += by;
        }
    }

    /// Planar depth of the map at a pixel of the image, metres; `None` where objects have none of their own.
    pub(crate) fn depth_at(&self, x: i64, y: i64) -> Option<f64> {
        let size = self.camera.size;
        let inside = x >= 0 && y >= 0 && x < i64::from(size.width) && y < i64::from(size.height);
        let points = self.points.as_ref().filter(|p| inside && p.is_dense())?;
        let depth = self.camera.depth(points.at(size, Vec2::new(x as f64 + 0.5, y as f64 + 0.5))?);
        (depth > 0.0).then_some(depth)
    }

    /// The placed object with this id.
    pub fn find(&self, id: &ObjectId) -> Option<&Placed> {
        self.placed.iter().find(|p| p.item.id == *id)
    }

    /// Its position in [`PartialScene::placed`].
    pub fn position(&self, id: &ObjectId) -> Option<usize> {
        self.placed.iter().position(|p| p.item.id == *id)
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::Surface;

    use super::*;
    use crate::testing::{boxed, empty_room};

    #[test]
    fn walls_that_nobody_saw_follow_what_stands_beyond_them_and_no_picture_changes() {
        let mut scene = empty_room();
        scene.room.seen = vec![Surface::Floor, Surface::Back];
        let width = scene.room.extents.width;
        for (k, x) in [-0.4, width + 0.5].into_iter().enumerate() {
            let mut item = boxed(&scene, Vec3::new(0.6, 0.8, 0.6), Vec3::new(1.5, 0.0, 1.5), 0.0);
            item.id = ObjectId::numbered("box", k);
            let pose = Pose::new(Vec3::new(x, 0.0, 1.5), 0.0, 1.0);
            scene.placed.push(Placed {
                item: Arc::new(item),
                pose,
                support: Support::Floor,
                evidence: Evidence::default(),
            });
        }
        let before: Vec<_> = scene.placed.iter().map(|p| scene.camera.project(p.pose.position)).collect();
        let shift = scene.fit_loose_walls();
        assert!((shift - (0.7 + LOOSE_GAP)).abs() < 1e-6, "{shift}");
        assert!((scene.room.extents.width - (width + 1.5 + 2.0 * LOOSE_GAP)).abs() < 1e-6);
        for (p, before) in scene.placed.iter().zip(before) {
            let now = scene.camera.project(p.pose.position);
            assert!(now.zip(before).is_none_or(|(a, b)| a.distance(b) < 1e-6));
        }
        // What needs less room gives it back, and no more than was taken.
        let (from, to) = (scene.room.extents.width, scene.placed[0].pose.position.x);
        scene.placed[0].pose.position.x += 0.3;
        assert!((scene.fit_loose_walls() + 0.3).abs() < 1e-6);
        assert!((scene.room.extents.width - (from - 0.3)).abs() < 1e-6);
        assert!((scene.placed[0].pose.position.x - to).abs() < 1e-6, "it is as far from its wall as it was");
        for p in &mut scene.placed {
            p.pose.position.x = 2.0;
        }
        scene.fit_loose_walls();
        assert!((scene.room.extents.width - width).abs() < 1e-6, "{}", scene.room.extents.width);
        assert_eq!(scene.fit_loose_walls(), 0.0);
        // Walls that were seen stay where they are.
        scene.room.seen = Surface::ALL.to_vec();
        scene.placed[0].pose.position.x = -1.0;
        assert_eq!(scene.fit_loose_walls(), 0.0);
    }
}
