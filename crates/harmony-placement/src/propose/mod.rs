//! First poses: from relations, prior size and the mask's rays to one or several hypotheses. Paper Sec. 3.3, App. C.
//!
//! Where the paper takes one first pose from the VLM, several are made here and measured; what the relations say
//! comes first and what contradicts them has a price. Key `ceiling.ray`.

mod host;
mod wall;

pub(crate) use wall::between_curtains;

use harmony_scene::{Ledge, Level, PlacementType, Pose, Vec2, Vec3, Wall, WallPlane};

use crate::noise::{Noise, surprise};
use crate::observe::Window;
use crate::scene::attachment::{Attachment, PoseConstraint, YawRule, angle_between, facing, size_of};
use crate::stats::median;
use crate::terms::first_size;
use crate::{Item, PartialScene, PlacementSettings, YawHint};

/// A turned front that is as near to what the object is said to face, or to a wall that it speaks for, radians.
const AGREES: f64 = 0.6;

/// How far a coarse yaw may be from the room's axes for these to be tried, radians.
const ALONG_THE_ROOM: f64 = 0.45;

/// As near to the room's axes a turn was answered along them, radians.
const SQUARE: f64 = 0.02;

/// A pose to start from.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis<'a> {
    /// How the object is held in it.
    pub(crate) constraint: PoseConstraint<'a>,
    /// The pose, settled.
    pub(crate) pose: Pose,
    /// Cost on top of what is measured, for contradicting the relations.
    pub(crate) price: f64,
}

/// What all hypotheses of one object are made from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Proposer<'a, 'v> {
    pub(crate) scene: &'a PartialScene,
    pub(crate) item: &'a Item,
    pub(crate) window: &'v Window,
    pub(crate) settings: &'a PlacementSettings,
}

impl<'a> Proposer<'a, '_> {
    pub(crate) fn constraint(&self, attachment: Attachment, yaw: YawRule) -> PoseConstraint<'a> {
        PoseConstraint::new(self.scene, self.item, attachment, yaw, &self.settings.noise)
    }

    /// The object in its prior size at a place; as large as the member of its set that the photo shows best, where one
    /// is placed already.
    pub(crate) fn sized(&self, position: Vec3, yaw: f64) -> Pose {
        let (scale, stretch) = first_size(self.scene, self.item, self.settings);
        Pose { position, yaw, scale, stretch }
    }

    /// A rule, and, at a price, those that hold if the front was named wrongly by quarter turns.
    pub(crate) fn quarter_turns(&self, rule: YawRule) -> Vec<(YawRule, f64)> {
        let mut out = vec![(rule, 0.0)];
        if let YawRule::About { yaw, sigma } = rule {
            let noise = &self.settings.noise;
            let is_answered = matches!(self.item.yaw, YawHint::About(_));
            let wrong = surprise(if is_answered { noise.wrong_turn } else { noise.wrong_side });
            let turned = |k: f64| YawRule::About { yaw: yaw + k * std::f64::consts::FRAC_PI_2, sigma };
            // Outlines hardly tell half a turn, so that noise would: it takes two wrong quarters.
            out.extend([(1.0, 1.0), (2.0, 2.0), (3.0, 1.0)].map(|(k, times)| (turned(k), times * wrong)));
        }
        out
    }

    pub(crate) fn settled(&self, constraint: PoseConstraint<'a>, position: Vec3, price: f64) -> Hypothesis<'a> {
        Hypothesis { constraint, pose: constraint.settle(&self.sized(position, constraint.yaw.start())), price }
    }

    fn dense(&self) -> bool {
        self.settings.point_map && self.scene.points.as_ref().is_some_and(crate::RoomPoints::is_dense)
    }

    /// All hypotheses of the object, never none.
    pub(crate) fn all(&self) -> Vec<Hypothesis<'a>> {
        let on_floor = self.item.placement.placement_type == PlacementType::OnFloor;
        let mut out = match self.item.level {
            Level::Wall => wall::hypotheses(self),
            Level::Ceiling => self.under_ceiling(),
            Level::Decoration if !on_floor => host::hypotheses(self),
            Level::Furniture if self.settings.relations && self.item.relations.on_top_of.is_some() => {
                host::hypotheses(self)
            }
            Level::Furniture | Level::Decoration => Vec::new(),
        };
        if out.is_empty() {
            let expects_host = self.on_ledge().is_some() || (self.item.level == Level::Decoration && !on_floor);
            out = self.on_floor(if expects_host { surprise(self.settings.noise.wrong_host) } else { 0.0 });
        }
        out.extend(self.on_ledges());
        out
    }

    /// The part of the room on which the object is said to be.
    fn on_ledge(&self) -> Option<Ledge> {
        let said = self.item.relations.on_top_of.as_ref().filter(|_| self.settings.relations)?;
        self.scene.room.ledge_named(said)
    }

    /// On the room's ledges and steps: on the one that was said; at the price of a wrong answer where another thing was, or furniture
    /// of which nothing was said, for it stands on the floor then; at none what must be on something of which nobody said on what.
    /// Where it was not said, only if its foot is seen there.
    fn on_ledges(&self) -> Vec<Hypothesis<'a>> {
        if matches!(self.item.level, Level::Wall | Level::Ceiling) {
            return Vec::new();
        }
        let said = self.on_ledge();
        let is_open = self.item.level == Level::Decoration && self.item.relations.on_top_of.is_none();
        let mut out = Vec::new();
        for (ledge, top) in self.scene.room.ledges() {
            let is_said = said == Some(ledge);
            let price = if is_said || is_open { 0.0 } else { surprise(self.settings.noise.wrong_host) };
            let rough = self.constraint(Attachment::OnLedge(ledge), YawRule::Fixed(0.0));
            let pose = self.sized(Vec3::ZERO, 0.0);
            let seen: Vec<Vec3> =
                [self.by_contact(&rough, &pose, top.height, 3), self.by_top(&rough, &pose, top.height)]
                    .into_iter()
                    .flatten()
                    .chain(self.by_points(&pose))
                    .chain(self.by_size(&pose))
                    .collect();
            // Where it was said, the nearest place on it.
            for at in seen.into_iter().filter(|at| is_said || top.is_under(*at)) {
                for yaw in self.yaws(at, 0.0) {
                    let constraint = self.constraint(Attachment::OnLedge(ledge), yaw);
                    out.push(self.settled(constraint, at, price));
                }
            }
        }
        out
    }

    /// Poses on other hosts than the given one.
    pub(crate) fn on_other_hosts(&self) -> Vec<Hypothesis<'a>> {
        host::on_other_hosts(self)
    }

    /// Yaws to try for an object that stands at a place.
    pub(crate) fn yaws(&self, position: Vec3, base: f64) -> Vec<YawRule> {
        let noise = &self.settings.noise;
        if let YawHint::About(yaw) = self.item.yaw
            && yaw.is_finite()
        {
            let sigma = answered_yaw(self.item, yaw, noise);
            return vec![YawRule::About { yaw, sigma }];
        }
        if let Some(target) = self.target()
            && let Some(start) = self.faced(position)
        {
            let turned = |by: f64| YawRule::Facing { target, start: start + by, sigma: noise.yaw_facing };
            return [0.0, -1.5, 1.5].map(|k| turned(k * noise.yaw_facing)).to_vec();
        }
        let quarter = std::f64::consts::FRAC_PI_2;
        if self.item.traits.flat {
            return vec![
                YawRule::About { yaw: base, sigma: noise.yaw_square },
                YawRule::About { yaw: base + quarter, sigma: noise.yaw_square },
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
        let noise = &self.settings.noise;
        let against = price + surprise(noise.wrong_wall);
        let mut out = Vec::new();
        let wall = if self.settings.relations { self.item.relations.wall_affinity.wall() } else { None };
        if let Some(wall) = wall.filter(|w| self.scene.is_loose(*w)) {
            // The wall is not seen: the object shows where it is, and it is turned as if it stood there.
            let constraint =
                self.constraint(Attachment::Floor, YawRule::About { yaw: wall.yaw(), sigma: noise.yaw_square });
            out.extend(self.floor_positions(&constraint).into_iter().map(|p| self.settled(constraint, p, price)));
            out.extend(self.elsewhere(wall, against));
            return out;
        }
        if let Some(wall) = wall {
            for plane in self.scene.room.standing_planes(wall) {
                let constraint = self.constraint(Attachment::AgainstWall(plane), YawRule::Fixed(wall.yaw()));
                for position in self.wall_positions(&constraint, plane) {
                    out.push(self.settled(constraint, position, price));
                }
            }
            let about = YawRule::About { yaw: wall.yaw(), sigma: self.settings.noise.yaw_along };
            let constraint = self.constraint(Attachment::Floor, about);
            for position in self.floor_positions(&constraint) {
                out.push(self.settled(constraint, position, against));
            }
            out.extend(self.elsewhere(wall, against));
            out.extend(self.turned_at_wall(wall, price));
            return out;
        }
        let rough = self.constraint(Attachment::Floor, YawRule::Fixed(0.0));
        for around in self.floor_positions(&rough) {
            for yaw in self.yaws(around, 0.0) {
                let constraint = self.constraint(Attachment::Floor, yaw);
                if let YawRule::About { yaw, sigma } = yaw {
                    for turned in [yaw - 1.5 * sigma, yaw + 1.5 * sigma] {
                        let pose = constraint.settle(&self.sized(around, turned));
                        out.push(Hypothesis { constraint, pose, price });
                    }
                }
                let faced = self.faced(around);
                for (yaw, turn_price) in self.quarter_turns(yaw) {
                    let agrees = faced.is_some_and(|faced| angle_between(yaw.start(), faced).abs() < AGREES);
                    let (yaw, turn_price) = match (turn_price > 0.0, agrees, self.target()) {
                        // Two answers that contradict one another: neither costs more. Which way it would face is asked
                        // where it comes to stand, not where the search began.
                        (true, true, Some(target)) => {
                            (YawRule::Facing { target, start: yaw.start(), sigma: noise.yaw_facing }, 0.0)
                        }
                        _ => (yaw, turn_price),
                    };
                    out.push(self.settled(self.constraint(Attachment::Floor, yaw), around, price + turn_price));
                }
                if let Some(along) = along_the_room(yaw) {
                    out.push(self.settled(self.constraint(Attachment::Floor, YawRule::Fixed(along)), around, price));
                }
            }
        }
        out
    }

    /// At a wall, for the case that not the wall but the front was named wrongly: another side is at the wall. What
    /// has no front is alike from before and behind.
    fn turned_at_wall(&self, wall: Wall, price: f64) -> Vec<Hypothesis<'a>> {
        let turns = if self.item.traits.has_front { 3 } else { 1 };
        let about = YawRule::About { yaw: wall.yaw(), sigma: self.settings.noise.yaw_along };
        let mut out = Vec::new();
        for (rule, turn_price) in self.quarter_turns(about).into_iter().skip(1).take(turns) {
            let constraint = self.constraint(Attachment::Floor, rule);
            // The wall was named rightly: only the turn was not.
            let price = price + turn_price;
            out.extend(self.floor_positions(&constraint).into_iter().map(|p| self.settled(constraint, p, price)));
        }
        out
    }

    /// Poses for the case that the relation is wrong: against another wall, or turned as the given front says.
    fn elsewhere(&self, said: Wall, price: f64) -> Vec<Hypothesis<'a>> {
        let mut out = Vec::new();
        let others = Wall::ALL.into_iter().filter(|w| *w != said && !self.scene.is_loose(*w));
        for wall in others.flat_map(|w| self.scene.room.standing_planes(w)) {
            let constraint = self.constraint(Attachment::AgainstWall(wall), YawRule::Fixed(wall.yaw()));
            // The wall that the given front speaks for costs no more than standing free.
            let agrees = matches!(self.item.yaw, YawHint::About(yaw) if angle_between(yaw, wall.yaw()).abs() < AGREES);
            let price = if agrees { price } else { price + 0.5 * surprise(self.settings.noise.wrong_wall) };
            out.extend(self.floor_positions(&constraint).into_iter().map(|p| self.settled(constraint, p, price)));
        }
        if let YawHint::About(yaw) = self.item.yaw
            && angle_between(yaw, said.yaw()).abs() > self.settings.noise.yaw_along
        {
            let constraint =
                self.constraint(Attachment::Floor, YawRule::About { yaw, sigma: self.settings.noise.yaw_panel });
            out.extend(self.floor_positions(&constraint).into_iter().map(|p| self.settled(constraint, p, price)));
        }
        out
    }

    /// Places along a wall: where the mask's centre is seen at the object's own distance to the wall.
    fn wall_positions(&self, constraint: &PoseConstraint, wall: WallPlane) -> Vec<Vec3> {
        let e = &self.scene.room.extents;
        let size = size_of(self.item, &self.sized(Vec3::ZERO, wall.yaw()));
        let away = size.z / 2.0 + self.settings.noise.wall_clearance;
        let ray = self.scene.camera.ray(self.window.mask_box.centre());
        let towards = -ray.direction.dot(wall.normal());
        let mut out = Vec::new();
        if towards > 0.05 {
            let k = (wall.distance(e, ray.origin) - away) / towards;
            if k.is_finite() && k > 0.0 {
                out.push(ray.at(k));
            }
        }
        out.extend(self.floor_positions(constraint));
        out
    }

    /// Places on the floor for the base centre, by contact, by points, by apparent size.
    fn floor_positions(&self, constraint: &PoseConstraint) -> Vec<Vec3> {
        let mut out = Vec::new();
        let pose = self.sized(Vec3::ZERO, constraint.yaw.start());
        out.extend(self.by_points(&pose));
        out.extend(self.by_contact(constraint, &pose, 0.0, 3));
        out.extend(self.by_top(constraint, &pose, 0.0));
        out.extend(self.by_size(&pose));
        out.extend(self.by_far_edge(&pose));
        if !self.dense() && !self.window.free[3] {
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
    pub(crate) fn by_top(&self, constraint: &PoseConstraint, pose: &Pose, base: f64) -> Option<Vec3> {
        let height = base + size_of(self.item, pose).y;
        let eye = self.scene.camera.centre().y;
        // Near eye level the ray runs along the plane.
        if !self.window.free[1] || (height - eye).abs() < 0.15 {
            return None;
        }
        let b = &self.window.mask_box;
        let hit = constraint.plane_hit(Vec2::new(b.centre().x, b.y0), height)?;
        let away = level_direction(hit - self.scene.camera.centre())?;
        // Above eye level the near edge of the top is the highest seen, below it the far one.
        let half = self.half_along(pose, away) * if height > eye { 1.0 } else { -1.0 };
        let centre = hit + away * half;
        Some(Vec3::new(centre.x, base, centre.z))
    }

    /// Places at several distances in the direction of the mask: when nothing else tells how far it is.
    fn along_the_ray(&self) -> Vec<Vec3> {
        let ray = self.scene.camera.ray(self.window.mask_box.centre());
        let Some(away) = level_direction(ray.direction) else { return Vec::new() };
        let level = harmony_scene::Ray { origin: ray.origin, direction: away };
        let Some(end) = self.scene.room.faces().exit(&level).map(|exit| exit.point) else { return Vec::new() };
        [0.3, 0.5, 0.7, 0.9].map(|t| ray.origin + (end - ray.origin) * t).to_vec()
    }

    /// Half of an object's extent along a horizontal direction.
    fn half_along(&self, pose: &Pose, direction: Vec3) -> f64 {
        let size = size_of(self.item, pose);
        let turned = Pose { position: Vec3::ZERO, scale: 1.0, stretch: Vec3::ONE, ..*pose }.linear();
        (turned * Vec3::X).dot(direction).abs() * size.x / 2.0 + (turned * Vec3::Z).dot(direction).abs() * size.z / 2.0
    }

    /// Base centre behind the contact of the mask's lowest (edge 3) or highest (edge 1) row with a level plane.
    pub(crate) fn by_contact(
        &self,
        constraint: &PoseConstraint,
        pose: &Pose,
        height: f64,
        edge: usize,
    ) -> Option<Vec3> {
        if !self.window.free[edge] {
            return None;
        }
        let b = &self.window.mask_box;
        let pixel = Vec2::new(b.centre().x, if edge == 3 { b.y1 } else { b.y0 });
        let hit = constraint.plane_hit(pixel, height)?;
        let away = level_direction(hit - self.scene.camera.centre())?;
        Some(hit + away * self.half_along(pose, away))
    }

    /// The masked points, their middle, and the level direction to it; `None` without a dense map.
    fn middle_of_points(&self) -> Option<(Vec<Vec3>, Vec3, Vec3)> {
        let points = if self.dense() { self.window.masked_points() } else { return None };
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
        let (camera, b) = (&self.scene.camera, &self.window.mask_box);
        let (edge, side) = match (self.window.free[0], self.window.free[2]) {
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
        if self.window.free[3] {
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
        let (b, free, k) = (&self.window.mask_box, self.window.free, camera.intrinsics);
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
            YawHint::About(yaw) if yaw.is_finite() => {
                vec![YawRule::About { yaw, sigma: self.settings.noise.yaw_panel }]
            }
            _ => vec![YawRule::Free(0.0)],
        };
        let mut out = Vec::new();
        for rule in rules {
            let constraint = self.constraint(Attachment::Ceiling, rule);
            let pose = self.sized(Vec3::ZERO, rule.start());
            let positions = [
                self.by_points(&pose),
                self.by_contact(&constraint, &pose, e.height, 1),
                self.by_size(&pose),
                Some(Vec3::new(e.width / 2.0, 0.0, e.depth / 2.0)),
            ];
            out.extend(positions.into_iter().flatten().map(|p| self.settled(constraint, p, 0.0)));
        }
        out
    }
}

/// One sigma of an answered turn, radians. What stands on something stands along its edge more often than not; a rug of
/// which a turn along the room was answered lies square in it, for one that lies aslant is answered so.
pub(crate) fn answered_yaw(item: &Item, yaw: f64, noise: &Noise) -> f64 {
    let quarter = std::f64::consts::FRAC_PI_2;
    let is_square = (yaw - (yaw / quarter).round() * quarter).abs() < SQUARE;
    match item.level {
        Level::Decoration => noise.yaw_along,
        _ if item.traits.flat && is_square => noise.yaw_square,
        _ => noise.yaw_panel,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_nearly_along_the_room_is_tried_along_it() {
        let about = |yaw: f64| along_the_room(YawRule::About { yaw, sigma: 0.4 });
        let half_turn = std::f64::consts::PI;
        assert_eq!(about(0.3), Some(0.0));
        assert_eq!(about(half_turn - 0.4), Some(half_turn));
        assert_eq!(about(0.7), None);
        assert_eq!(along_the_room(YawRule::Free(0.1)), None);
    }
}
