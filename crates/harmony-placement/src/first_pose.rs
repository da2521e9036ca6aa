//! First poses: from relations, prior size and the mask's rays to one or several hypotheses. Paper Sec. 3.3, App. C.
//!
//! Where the paper takes one first pose from the VLM, several are made here and measured; what the relations say
//! comes first and what contradicts them has a price.

use harmony_scene::{Level, PlacementType, Pose, Vec2, Vec3, Wall};

use crate::anchoring::{Anchoring, Frame, YawRule, prior_scale, size_of};
use crate::cost::angle_between;
use crate::formulas::median;
use crate::view::View;
use crate::{Item, PartialScene, PlacementSettings, YawHint, first_on_host, first_on_wall, steps};

/// Price of standing free although a wall was said to be behind, or of standing on the floor for want of a host.
pub(crate) const AGAINST_RELATION: f64 = 0.12;

/// Price of a front that is a quarter turn or more from where it was said to be.
const WRONG_TURN: f64 = 0.1;
/// Times this for half a turn: outlines hardly tell it, so that noise would.
const HALF_TURN: f64 = 2.0;

/// Agreement with its mask from which the size of a member of a set says more than the one that was named.
const SURE_IOU: f64 = 0.6;

/// Expected error of a yaw that follows from what an object faces, radians.
const FACING_SIGMA: f64 = 0.35;

/// A turned front that is as near to what the object is said to face, radians, costs nothing.
const FACING_AGREES: f64 = 0.6;

/// Expected error of a given coarse yaw (one of four panels), radians.
const HINT_SIGMA: f64 = 0.4;

/// The same for what stands on something, and along its edge more often than not.
const ALIGNED_SIGMA: f64 = 0.25;

/// Expected error of the yaw of furniture that stands free although a wall was said to be behind it, radians.
const WALL_SIGMA: f64 = 0.15;

/// Expected error of the yaw of furniture at a wall that is not seen, radians.
const LOOSE_SIGMA: f64 = 0.05;

/// Expected error of a rug's alignment with the room, radians.
const RUG_SIGMA: f64 = 0.05;

/// How far a coarse yaw may be from the room's axes for these to be tried, radians.
const ALONG_THE_ROOM: f64 = 0.45;

/// A pose to start from.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis<'a> {
    /// How the object is held in it.
    pub(crate) frame: Frame<'a>,
    /// The pose, settled.
    pub(crate) pose: Pose,
    /// Cost on top of what is measured, for contradicting the relations.
    pub(crate) price: f64,
}

/// A rule, and, at a price, those that hold if the front was named wrongly by quarter turns.
pub(crate) fn quarter_turns(rule: YawRule) -> Vec<(YawRule, f64)> {
    let mut out = vec![(rule, 0.0)];
    if let YawRule::About { yaw, sigma } = rule {
        let turned = |k: f64| YawRule::About { yaw: yaw + k * std::f64::consts::FRAC_PI_2, sigma };
        out.extend([(1.0, 1.0), (2.0, HALF_TURN), (3.0, 1.0)].map(|(k, times)| (turned(k), times * WRONG_TURN)));
    }
    out
}

/// What all hypotheses of one object are made from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Starter<'a, 'v> {
    pub(crate) scene: &'a PartialScene,
    pub(crate) item: &'a Item,
    pub(crate) view: &'v View,
    pub(crate) settings: &'a PlacementSettings,
}

impl<'a> Starter<'a, '_> {
    pub(crate) fn frame(&self, anchoring: Anchoring, yaw: YawRule) -> Frame<'a> {
        Frame {
            scene: self.scene,
            item: self.item,
            anchoring,
            yaw,
            wall_gap: self.settings.wall_gap,
            fixed_size: false,
        }
    }

    /// The object in its prior size at a place; as large as the member of its set that the photo shows best, where one
    /// is placed already.
    pub(crate) fn sized(&self, position: Vec3, yaw: f64) -> Pose {
        let twin = self.twin().map_or(self.item.size, crate::Placed::size);
        let (scale, stretch) = prior_scale(self.item, twin);
        Pose { position, yaw, scale, stretch }
    }

    fn twin(&self) -> Option<&crate::Placed> {
        let set = self.item.relations.matched_set.as_ref().filter(|_| self.settings.groups)?;
        let iou = |p: &crate::Placed| p.evidence.silhouette_iou.unwrap_or(0.0);
        let members = self.scene.placed.iter().filter(|p| {
            p.item.relations.matched_set.as_ref() == Some(set)
                && p.item.level == self.item.level
                && p.item.id != self.item.id
        });
        members.filter(|p| iou(p) >= SURE_IOU).max_by(|a, b| iou(a).total_cmp(&iou(b)))
    }

    pub(crate) fn settled(&self, frame: Frame<'a>, position: Vec3, price: f64) -> Hypothesis<'a> {
        Hypothesis { frame, pose: frame.settle(&self.sized(position, frame.yaw.start())), price }
    }

    fn dense(&self) -> bool {
        self.settings.point_map && self.scene.points.as_ref().is_some_and(crate::RoomPoints::is_dense)
    }

    /// All hypotheses of the object, never none.
    pub(crate) fn all(&self) -> Vec<Hypothesis<'a>> {
        let on_floor = self.item.placement.placement_type == PlacementType::OnFloor;
        let mut out = match self.item.level {
            Level::Wall => first_on_wall::hypotheses(self),
            Level::Ceiling => self.under_ceiling(),
            Level::Decoration if !on_floor => first_on_host::hypotheses(self),
            Level::Furniture if self.settings.relations && self.item.relations.on_top_of.is_some() => {
                first_on_host::hypotheses(self)
            }
            Level::Furniture | Level::Decoration => Vec::new(),
        };
        if out.is_empty() {
            let expects_host = self.item.level == Level::Decoration && !on_floor;
            out = self.on_floor(if expects_host { AGAINST_RELATION } else { 0.0 });
        }
        out
    }

    /// Yaws to try for an object that stands at a place.
    pub(crate) fn yaws(&self, position: Vec3, base: f64) -> Vec<YawRule> {
        match self.item.yaw {
            YawHint::Fixed(yaw) if yaw.is_finite() => return vec![YawRule::Fixed(yaw)],
            YawHint::About(yaw) if yaw.is_finite() => {
                let sigma = if self.item.level == Level::Decoration { ALIGNED_SIGMA } else { HINT_SIGMA };
                return vec![YawRule::About { yaw, sigma }];
            }
            _ => {}
        }
        if let Some(target) = self.target()
            && let Some(start) = self.faced(position)
        {
            let turned = |by: f64| YawRule::Facing { target, start: start + by, sigma: FACING_SIGMA };
            return [0.0, -1.5, 1.5].map(|k| turned(k * FACING_SIGMA)).to_vec();
        }
        let quarter = std::f64::consts::FRAC_PI_2;
        if self.item.traits.flat {
            return vec![
                YawRule::About { yaw: base, sigma: RUG_SIGMA },
                YawRule::About { yaw: base + quarter, sigma: RUG_SIGMA },
            ];
        }
        // The 90 degree grid first, the diagonals after it.
        [0.0, 1.0, 2.0, 3.0, 0.5, 1.5, 2.5, 3.5].map(|k| YawRule::Free(base + k * quarter)).to_vec()
    }

    /// What the object is said to face, where that is placed.
    fn target(&self) -> Option<usize> {
        let id = self.item.relations.facing_toward.as_ref().filter(|_| self.settings.relations)?;
        self.scene.position(id).filter(|_| *id != self.item.id)
    }

    /// The yaw that this asks for at a place.
    fn faced(&self, position: Vec3) -> Option<f64> {
        facing(position, &self.scene.placed[self.target()?])
    }

    fn on_floor(&self, price: f64) -> Vec<Hypothesis<'a>> {
        let mut out = Vec::new();
        let wall = if self.settings.relations { self.item.relations.wall_affinity.wall() } else { None };
        if let Some(wall) = wall.filter(|w| self.scene.is_loose(*w)) {
            // The wall is not seen: the object shows where it is, and it is turned as if it stood there.
            let frame = self.frame(Anchoring::Floor, YawRule::About { yaw: wall.yaw(), sigma: LOOSE_SIGMA });
            out.extend(self.floor_positions(&frame).into_iter().map(|p| self.settled(frame, p, price)));
            out.extend(self.elsewhere(wall, price + AGAINST_RELATION));
            return out;
        }
        if let Some(wall) = wall {
            let frame = self.frame(Anchoring::AgainstWall(wall), YawRule::Fixed(wall.yaw()));
            for position in self.wall_positions(&frame, wall) {
                out.push(self.settled(frame, position, price));
            }
            let about = YawRule::About { yaw: wall.yaw(), sigma: WALL_SIGMA };
            let frame = self.frame(Anchoring::Floor, about);
            // The less of the object's outline is seen, the more the relation counts.
            let hidden = self.view.free.iter().filter(|f| !**f).count() as f64;
            for position in self.floor_positions(&frame) {
                out.push(self.settled(frame, position, price + AGAINST_RELATION * (1.0 + hidden)));
            }
            out.extend(self.elsewhere(wall, price + AGAINST_RELATION * (1.0 + hidden)));
            out.extend(self.turned_at_wall(wall, price + AGAINST_RELATION * (1.0 + hidden)));
            return out;
        }
        let rough = self.frame(Anchoring::Floor, YawRule::Fixed(0.0));
        for around in self.floor_positions(&rough) {
            for yaw in self.yaws(around, 0.0) {
                let frame = self.frame(Anchoring::Floor, yaw);
                if let YawRule::About { yaw, sigma } = yaw {
                    for turned in [yaw - 1.5 * sigma, yaw + 1.5 * sigma] {
                        let pose = frame.settle(&self.sized(around, turned));
                        out.push(Hypothesis { frame, pose, price });
                    }
                }
                let faced = self.faced(around);
                for (yaw, turn_price) in quarter_turns(yaw) {
                    // Two answers that contradict one another: neither costs more.
                    let agrees = faced.is_some_and(|faced| angle_between(yaw.start(), faced).abs() < FACING_AGREES);
                    let turn_price = if agrees { 0.0 } else { turn_price };
                    out.push(self.settled(self.frame(Anchoring::Floor, yaw), around, price + turn_price));
                }
                if let Some(along) = along_the_room(yaw) {
                    out.push(self.settled(self.frame(Anchoring::Floor, YawRule::Fixed(along)), around, price));
                }
            }
        }
        out
    }

    /// At a wall, for the case that not the wall but the front was named wrongly: another side is at the wall. What
    /// has no front is alike from before and behind.
    fn turned_at_wall(&self, wall: Wall, price: f64) -> Vec<Hypothesis<'a>> {
        let turns = if self.item.traits.has_front { 3 } else { 1 };
        let about = YawRule::About { yaw: wall.yaw(), sigma: WALL_SIGMA };
        let mut out = Vec::new();
        for (rule, turn_price) in quarter_turns(about).into_iter().skip(1).take(turns) {
            let frame = self.frame(Anchoring::Floor, rule);
            // A quarter turn is what `price` is for.
            let price = price + turn_price - WRONG_TURN;
            out.extend(self.floor_positions(&frame).into_iter().map(|p| self.settled(frame, p, price)));
        }
        out
    }

    /// Poses for the case that the relation is wrong: against another wall, or turned as the given front says.
    fn elsewhere(&self, said: Wall, price: f64) -> Vec<Hypothesis<'a>> {
        let mut out = Vec::new();
        for wall in Wall::ALL.into_iter().filter(|w| *w != said && !self.scene.is_loose(*w)) {
            let frame = self.frame(Anchoring::AgainstWall(wall), YawRule::Fixed(wall.yaw()));
            // The wall that the given front speaks for costs no more than standing free.
            let agrees = matches!(self.item.yaw, YawHint::About(yaw) if angle_between(yaw, wall.yaw()).abs() < 0.6);
            let price = if agrees { price } else { price + 0.5 * AGAINST_RELATION };
            out.extend(self.floor_positions(&frame).into_iter().map(|p| self.settled(frame, p, price)));
        }
        if let YawHint::About(yaw) = self.item.yaw
            && angle_between(yaw, said.yaw()).abs() > 0.6
        {
            let frame = self.frame(Anchoring::Floor, YawRule::About { yaw, sigma: HINT_SIGMA });
            out.extend(self.floor_positions(&frame).into_iter().map(|p| self.settled(frame, p, price)));
        }
        out
    }

    /// Places along a wall: where the mask's centre is seen at the object's own distance to the wall.
    fn wall_positions(&self, frame: &Frame, wall: Wall) -> Vec<Vec3> {
        let e = &self.scene.room.extents;
        let size = size_of(self.item, &self.sized(Vec3::ZERO, wall.yaw()));
        let away = size.z / 2.0 + self.settings.wall_gap;
        let ray = self.scene.camera.ray(self.view.mask_box.centre());
        let towards = -ray.direction.dot(wall.normal());
        let mut out = Vec::new();
        if towards > 0.05 {
            let k = (wall.distance(e, ray.origin) - away) / towards;
            if k.is_finite() && k > 0.0 {
                out.push(ray.at(k));
            }
        }
        out.extend(self.floor_positions(frame));
        out
    }

    /// Places on the floor for the base centre, by contact, by points, by apparent size.
    fn floor_positions(&self, frame: &Frame) -> Vec<Vec3> {
        let mut out = Vec::new();
        let pose = self.sized(Vec3::ZERO, frame.yaw.start());
        out.extend(self.by_points(&pose));
        out.extend(self.by_contact(frame, &pose, 0.0, 3));
        out.extend(self.by_top(frame, &pose, 0.0));
        out.extend(self.by_size(&pose));
        out.extend(self.by_far_edge(&pose));
        if !self.dense() && !self.view.free[3] {
            out.extend(self.along_the_ray());
        }
        let beyond: Vec<Vec3> = out.iter().filter_map(|at| self.beyond_the_cut(&pose, *at)).collect();
        out.extend(beyond);
        if out.is_empty() {
            let e = &self.scene.room.extents;
            out.push(Vec3::new(e.width / 2.0, 0.0, e.depth / 2.0));
        }
        out
    }

    /// Base centre where the object's top, at its prior height above a plane, is seen in the mask's highest row.
    pub(crate) fn by_top(&self, frame: &Frame, pose: &Pose, base: f64) -> Option<Vec3> {
        let height = base + size_of(self.item, pose).y;
        let eye = self.scene.camera.centre().y;
        // Near eye level the ray runs along the plane.
        if !self.view.free[1] || (height - eye).abs() < 0.15 {
            return None;
        }
        let b = &self.view.mask_box;
        let hit = steps::plane_hit(frame, Vec2::new(b.centre().x, b.y0), height)?;
        let away = level_direction(hit - self.scene.camera.centre())?;
        // Above eye level the near edge of the top is the highest seen, below it the far one.
        let half = self.half_along(pose, away) * if height > eye { 1.0 } else { -1.0 };
        let centre = hit + away * half;
        Some(Vec3::new(centre.x, base, centre.z))
    }

    /// Places at several distances in the direction of the mask: when nothing else tells how far it is.
    fn along_the_ray(&self) -> Vec<Vec3> {
        let e = &self.scene.room.extents;
        let ray = self.scene.camera.ray(self.view.mask_box.centre());
        let Some(away) = level_direction(ray.direction) else { return Vec::new() };
        let level = harmony_scene::Ray { origin: ray.origin, direction: away };
        let Some((_, end)) = e.exit(&level) else { return Vec::new() };
        [0.3, 0.5, 0.7, 0.9].map(|t| ray.origin + (end - ray.origin) * t).to_vec()
    }

    /// Half of an object's extent along a horizontal direction.
    fn half_along(&self, pose: &Pose, direction: Vec3) -> f64 {
        let size = size_of(self.item, pose);
        let turned = Pose { position: Vec3::ZERO, scale: 1.0, stretch: Vec3::ONE, ..*pose }.linear();
        (turned * Vec3::X).dot(direction).abs() * size.x / 2.0 + (turned * Vec3::Z).dot(direction).abs() * size.z / 2.0
    }

    /// Base centre behind the contact of the mask's lowest (edge 3) or highest (edge 1) row with a level plane.
    pub(crate) fn by_contact(&self, frame: &Frame, pose: &Pose, height: f64, edge: usize) -> Option<Vec3> {
        if !self.view.free[edge] {
            return None;
        }
        let b = &self.view.mask_box;
        let pixel = Vec2::new(b.centre().x, if edge == 3 { b.y1 } else { b.y0 });
        let hit = steps::plane_hit(frame, pixel, height)?;
        let away = level_direction(hit - self.scene.camera.centre())?;
        Some(hit + away * self.half_along(pose, away))
    }

    /// The masked points, their middle, and the level direction to it; `None` without a dense map.
    fn middle_of_points(&self) -> Option<(Vec<Vec3>, Vec3, Vec3)> {
        let points = if self.dense() { self.view.masked_points() } else { return None };
        if points.len() < 8 {
            return None;
        }
        let of = |i: usize| median(&mut points.iter().map(|p| p[i]).collect::<Vec<_>>());
        let centre = Vec3::new(of(0), of(1), of(2));
        let away = level_direction(centre - self.scene.camera.centre())?;
        Some((points, centre, away))
    }

    /// Centre of the masked points, pushed back by what is hidden behind the front.
    pub(crate) fn by_points(&self, pose: &Pose) -> Option<Vec3> {
        let (_, centre, away) = self.middle_of_points()?;
        Some(centre + away * self.half_along(pose, away) * 0.5)
    }

    /// A place moved across the image so that the side that is seen fits the mask: what the image border or another
    /// object cuts on one side goes on beyond the cut.
    fn beyond_the_cut(&self, pose: &Pose, at: Vec3) -> Option<Vec3> {
        let (camera, b) = (&self.scene.camera, &self.view.mask_box);
        let (edge, side) = match (self.view.free[0], self.view.free[2]) {
            (true, false) => (b.x0, 1.0),
            (false, true) => (b.x1, -1.0),
            _ => return None,
        };
        let right = level_direction(camera.right())?;
        let seen = camera.unproject(Vec2::new(edge, b.centre().y), camera.depth(at).max(0.3));
        Some(at + right * ((seen - at).dot(right) + side * self.half_along(pose, right)))
    }

    /// Base centre before the farthest of the masked points, where the near end is cut.
    fn by_far_edge(&self, pose: &Pose) -> Option<Vec3> {
        if self.view.free[3] {
            return None;
        }
        let (points, middle, away) = self.middle_of_points()?;
        let centre = middle.with_y(0.0);
        let mut far: Vec<f64> = points.iter().map(|p| (*p - centre).dot(away)).collect();
        far.sort_by(f64::total_cmp);
        let end = far[far.len() * 19 / 20];
        Some(centre + away * (end - self.half_along(pose, away)))
    }

    /// Where the object has its prior size in the mask.
    pub(crate) fn by_size(&self, pose: &Pose) -> Option<Vec3> {
        let camera = &self.scene.camera;
        let (b, free, k) = (&self.view.mask_box, self.view.free, camera.intrinsics);
        let size = size_of(self.item, pose);
        let right = level_direction(camera.right())?;
        let depth = if free[1] && free[3] && !self.item.traits.flat && b.height() > 1.0 {
            k.fy * size.y / b.height()
        } else if free[0] && free[2] && b.width() > 1.0 {
            k.fx * 2.0 * self.half_along(pose, right) / b.width()
        } else {
            return None;
        };
        let point = camera.unproject(b.centre(), depth.clamp(0.3, 30.0));
        Some(point - Vec3::Y * size.y / 2.0)
    }

    /// Under the ceiling: by the ray to the ceiling, by points, by size; the room's centre as the last resort.
    fn under_ceiling(&self) -> Vec<Hypothesis<'a>> {
        let e = self.scene.room.extents;
        let rules = match self.item.yaw {
            YawHint::Fixed(yaw) if yaw.is_finite() => vec![YawRule::Fixed(yaw)],
            YawHint::About(yaw) if yaw.is_finite() => vec![YawRule::About { yaw, sigma: HINT_SIGMA }],
            _ => vec![YawRule::Free(0.0)],
        };
        let mut out = Vec::new();
        for rule in rules {
            let frame = self.frame(Anchoring::Ceiling, rule);
            let pose = self.sized(Vec3::ZERO, rule.start());
            let positions = [
                self.by_points(&pose),
                self.by_contact(&frame, &pose, e.height, 1),
                self.by_size(&pose),
                Some(Vec3::new(e.width / 2.0, 0.0, e.depth / 2.0)),
            ];
            out.extend(positions.into_iter().flatten().map(|p| self.settled(frame, p, 0.0)));
        }
        out
    }
}

/// The horizontal unit vector along a direction.
pub(crate) fn level_direction(v: Vec3) -> Option<Vec3> {
    Vec3::new(v.x, 0.0, v.z).try_normalize()
}

/// The yaw along the room's axes near a roughly known one: most of what stands in a room is parallel to its walls.
fn along_the_room(rule: YawRule) -> Option<f64> {
    let YawRule::About { yaw, .. } = rule else { return None };
    let quarter = std::f64::consts::FRAC_PI_2;
    let along = (yaw / quarter).round() * quarter;
    ((yaw - along).abs() < ALONG_THE_ROOM).then_some(along)
}

/// Yaw with which an object at a place faces a placed one: towards the nearest point of its footprint's box.
///
/// A chair beside a long table looks straight at the edge, not at the table's centre.
pub(crate) fn facing(from: Vec3, target: &crate::Placed) -> Option<f64> {
    let half = target.size().as_vec() / 2.0;
    let (sin, cos) = target.pose.yaw.sin_cos();
    let d = from - target.pose.position;
    let local = Vec3::new(d.x * cos - d.z * sin, 0.0, d.x * sin + d.z * cos);
    let nearest = Vec3::new(local.x.clamp(-half.x, half.x), 0.0, local.z.clamp(-half.z, half.z));
    let outside = nearest - local;
    // Inside the footprint (a tucked chair that is still misplaced) the centre has to do.
    let towards = if outside.length() > 0.02 { outside } else { -local };
    let room = Vec3::new(towards.x * cos + towards.z * sin, 0.0, -towards.x * sin + towards.z * cos);
    let room = level_direction(room)?;
    Some(room.x.atan2(room.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_nearly_along_the_room_is_tried_along_it() {
        let about = |yaw: f64| along_the_room(YawRule::About { yaw, sigma: HINT_SIGMA });
        let half_turn = std::f64::consts::PI;
        assert_eq!(about(0.3), Some(0.0));
        assert_eq!(about(half_turn - 0.4), Some(half_turn));
        assert_eq!(about(0.7), None);
        assert_eq!(along_the_room(YawRule::Free(0.1)), None);
    }
}
