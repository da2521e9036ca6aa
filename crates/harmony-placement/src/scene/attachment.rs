//! The ways in which an object can be held, and its pose as the few numbers that stay free.
//!
//! The paper projects a refined pose back onto its support (Sec. 3.3, App. C). Here the support is built into the
//! parameters, so that every step and every trial of the optimiser is on the support already.

use glam::Vec3Swizzles as _;
use harmony_scene::{Ledge, Pose, Size, Support, Vec2, Vec3, Wall, WallPlane};

use crate::noise::Noise;
use crate::scene::shape::Hang;
use crate::scene::support::{self, SurfaceQuery};
use crate::{Item, PartialScene, Placed};

/// How far beyond a loose wall an object may be placed, metres.
const BEYOND_LOOSE: f64 = 2.5;

/// How far the front of a window or door stands out from its wall, and at least its casing, metres; the rest of a thick one
/// is in the wall.
const PROUD: f64 = 0.06;
const CASING_PROUD: f64 = 0.02;

/// Places nearer than this are one, metres; turns, radians.
pub(crate) const SAME_PLACE: f64 = 0.01;
pub(crate) const SAME_TURN: f64 = 0.02;

/// Thickness of a rug or mat, at most, metres: what stands on it stands on the floor. A long pile, which is said to be
/// as thick as [`PILE`], stands around it.
const THICKEST_RUG: f64 = 0.008;
const PILE: f64 = 0.02;
const THICKEST_PILE: f64 = 0.04;

/// How an object is held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Attachment {
    /// Anywhere on the floor.
    Floor,
    /// On the floor, its back to a wall.
    AgainstWall(WallPlane),
    /// Fixed flush to a wall.
    OnWall(WallPlane),
    /// Hung so that its top touches the ceiling.
    Ceiling,
    /// On a surface of a placed object.
    OnHost {
        /// Index into the placed objects.
        host: usize,
        /// Height of the surface, metres.
        level: f64,
    },
    /// On a part of the room that is not its floor.
    OnLedge(Ledge),
}

/// What may be said about the yaw while an object is refined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum YawRule {
    /// Given by the wall or by the caller.
    Fixed(f64),
    /// Near this; the deviation has a price.
    About {
        /// Radians.
        yaw: f64,
        /// One sigma, radians.
        sigma: f64,
    },
    /// Towards a placed object, from wherever the object stands; the deviation has a price.
    Facing {
        /// Index into the placed objects.
        target: usize,
        /// Where the search starts, radians.
        start: f64,
        /// One sigma, radians.
        sigma: f64,
    },
    /// Only the image tells.
    Free(f64),
}

impl YawRule {
    /// Where the search starts.
    pub(crate) fn start(self) -> f64 {
        match self {
            Self::Fixed(yaw) | Self::About { yaw, .. } | Self::Facing { start: yaw, .. } | Self::Free(yaw) => yaw,
        }
    }
}

/// Free numbers of a pose: two for the place, yaw, log scale, log stretch.
pub(crate) type Parameters = [f64; 7];

/// A scene, an object and how it is held: turns numbers into poses.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoseConstraint<'a> {
    pub(crate) scene: &'a PartialScene,
    pub(crate) item: &'a Item,
    pub(crate) attachment: Attachment,
    pub(crate) yaw: YawRule,
    pub(crate) noise: &'a Noise,
    /// The size is given; only the place is sought.
    pub(crate) fixed_size: bool,
}

/// Smallest and largest room coordinates of an object's hulls relative to its position, for a pose.
pub(crate) fn reach(item: &Item, pose: &Pose) -> (Vec3, Vec3) {
    let linear = pose.linear();
    let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
    for p in item.shape.hulls().iter().flatten() {
        let q = linear * *p;
        low = low.min(q);
        high = high.max(q);
    }
    (low, high)
}

/// Size of an object in a pose, unrotated, metres.
pub(crate) fn size_of(item: &Item, pose: &Pose) -> Vec3 {
    item.shape.extent() * pose.scale * pose.stretch
}

/// How an object hangs over an edge, if it does: only cloth can.
pub(crate) fn hang_of(item: &Item) -> Option<&Hang> {
    if item.traits.drapes { item.shape.hang() } else { None }
}

/// Height above its lowest points at which an object is carried in a pose, metres: 0 but for what hangs over an edge.
pub(crate) fn sag_of(item: &Item, pose: &Pose) -> f64 {
    hang_of(item).map_or(0.0, |hang| hang.sag * pose.scale * pose.stretch.y)
}

/// Scale and stretch that give an object its prior size: one factor, or one a side where it may be stretched.
pub(crate) fn prior_scale(item: &Item, size: Size) -> (f64, Vec3) {
    let wanted = size.as_vec();
    let extent = item.shape.extent();
    let ratio = Vec3::from_array(std::array::from_fn(|i| {
        let r = wanted[i] / extent[i];
        if r.is_finite() && r > 0.0 { r } else { 0.0 }
    }));
    // Sides that are thin in the mesh or in the answer say little about the size.
    let longest = extent.max_element();
    let (mut log, mut weight) = (0.0, 0.0);
    for i in 0..3 {
        if ratio[i] > 0.0 {
            let w = (extent[i] / longest).clamp(0.05, 1.0);
            log += w * ratio[i].ln();
            weight += w;
        }
    }
    let scale = if weight > 0.0 { (log / weight).exp() } else { 1.0 };
    if !(item.traits.may_stretch || item.traits.planar) {
        return (scale, Vec3::ONE);
    }
    let stretch =
        Vec3::from_array(std::array::from_fn(
            |i| if ratio[i] > 0.0 { (ratio[i] / scale).clamp(0.2, 5.0) } else { 1.0 },
        ));
    (scale, stretch)
}

/// The stretch of an object's height at a scale: a larger rug is no thicker one.
pub(crate) fn height_stretch(item: &Item, scale: f64, stretch: f64) -> f64 {
    let height = item.shape.bounds().size().y * scale * stretch;
    let most = if item.size.height >= PILE { item.size.height.min(THICKEST_PILE) } else { THICKEST_RUG };
    if item.traits.flat { stretch * (most / height.max(1e-6)).min(1.0) } else { stretch }
}

/// How a placed object is held, from its support, its relations and where it stands.
pub(crate) fn attachment_of(scene: &PartialScene, object: usize, noise: &Noise) -> Attachment {
    let placed = &scene.placed[object];
    match &placed.support {
        Support::Wall { wall } => Attachment::OnWall(scene.room.plane_behind(*wall, placed.pose.position)),
        Support::Ceiling => Attachment::Ceiling,
        Support::Object { id } => match scene.position(id) {
            Some(host) if host != object => {
                Attachment::OnHost { host, level: placed.pose.position.y + sag_of(&placed.item, &placed.pose) }
            }
            _ => Attachment::Floor,
        },
        Support::Block { .. } | Support::Niche { .. } => {
            let ledge = placed.support.ledge().filter(|ledge| scene.room.ledge_top(*ledge).is_some());
            ledge.map_or(Attachment::Floor, Attachment::OnLedge)
        }
        Support::Floor => match placed.item.relations.wall_affinity.wall() {
            Some(wall) => {
                let plane = scene.room.plane_behind(wall, placed.pose.position);
                let known = plane.inset != 0.0 || !scene.is_loose(wall);
                if known && at_wall(scene, placed, plane, noise) {
                    Attachment::AgainstWall(plane)
                } else {
                    Attachment::Floor
                }
            }
            None => Attachment::Floor,
        },
    }
}

/// Whether an object stands with its back to a wall.
fn at_wall(scene: &PartialScene, placed: &Placed, wall: WallPlane, noise: &Noise) -> bool {
    let gap = wall.distance(&scene.room.extents, placed.pose.position) - placed.size().depth / 2.0;
    gap < noise.wall_gap_most + SAME_PLACE && angle_between(placed.pose.yaw, wall.yaw()).abs() < SAME_TURN
}

/// Smallest difference of two angles, radians.
pub(crate) fn angle_between(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(std::f64::consts::TAU);
    if d > std::f64::consts::PI { d - std::f64::consts::TAU } else { d }
}

/// Yaw with which an object at a place faces a placed one: towards the nearest point of its footprint's box.
///
/// A chair beside a long table looks straight at the edge, not at the table's centre.
pub(crate) fn facing(from: Vec3, target: &Placed) -> Option<f64> {
    let half = target.size().as_vec() / 2.0;
    let (sin, cos) = target.pose.yaw.sin_cos();
    let d = from - target.pose.position;
    let local = Vec3::new(d.x * cos - d.z * sin, 0.0, d.x * sin + d.z * cos);
    let nearest = Vec3::new(local.x.clamp(-half.x, half.x), 0.0, local.z.clamp(-half.z, half.z));
    let outside = nearest - local;
    // Inside the footprint (a tucked chair that is still misplaced) the centre has to do.
    let towards = if outside.length() > SAME_PLACE { outside } else { -local };
    let room = Vec3::new(towards.x * cos + towards.z * sin, 0.0, -towards.x * sin + towards.z * cos).try_normalize()?;
    Some(room.x.atan2(room.z))
}

impl<'a> PoseConstraint<'a> {
    /// An object that is held in some way.
    pub(crate) fn new(
        scene: &'a PartialScene,
        item: &'a Item,
        attachment: Attachment,
        yaw: YawRule,
        noise: &'a Noise,
    ) -> Self {
        Self { scene, item, attachment, yaw, noise, fixed_size: false }
    }

    /// A placed object as it is held: turn and size are given.
    pub(crate) fn as_placed(scene: &'a PartialScene, object: usize, noise: &'a Noise) -> Self {
        let placed = &scene.placed[object];
        let yaw = YawRule::Fixed(placed.pose.yaw);
        Self { fixed_size: true, ..Self::new(scene, &placed.item, attachment_of(scene, object, noise), yaw, noise) }
    }
}

impl PoseConstraint<'_> {
    /// The nearest pose that is held as it should be.
    pub(crate) fn settle(&self, pose: &Pose) -> Pose {
        self.pose(&self.parameters(pose))
    }

    /// The numbers of a pose (what its holding fixes is dropped).
    pub(crate) fn parameters(&self, pose: &Pose) -> Parameters {
        let e = &self.scene.room.extents;
        let p = pose.position;
        let (a, b) = match self.attachment {
            Attachment::Floor | Attachment::Ceiling | Attachment::OnHost { .. } | Attachment::OnLedge(_) => (p.x, p.z),
            Attachment::AgainstWall(wall) => {
                (wall.coordinates(p).x, wall.distance(e, p) - size_of(self.item, pose).z / 2.0)
            }
            Attachment::OnWall(wall) => (wall.coordinates(p).x, p.y),
        };
        let s = pose.stretch;
        [a, b, pose.yaw, pose.scale.max(1e-9).ln(), s.x.ln(), s.y.ln(), s.z.ln()]
    }

    /// The pose of some numbers: on its support, inside the room.
    pub(crate) fn pose(&self, numbers: &Parameters) -> Pose {
        let e = self.scene.room.extents;
        let yaw = match (self.attachment, self.yaw) {
            (_, YawRule::Fixed(yaw)) => yaw,
            (Attachment::OnWall(wall) | Attachment::AgainstWall(wall), _) => wall.yaw(),
            _ => numbers[2],
        };
        let mut stretch = Vec3::new(numbers[4].exp(), numbers[5].exp(), numbers[6].exp());
        if self.item.traits.as_wide_as_deep {
            let (_, prior) = prior_scale(self.item, self.item.size);
            stretch.z = stretch.x * prior.z / prior.x;
        }
        let scale = numbers[3].exp();
        stretch.y = height_stretch(self.item, scale, stretch.y);
        let mut pose = Pose { position: Vec3::new(numbers[0], 0.0, numbers[1]), yaw, scale, stretch };
        let mut size = size_of(self.item, &pose);
        match self.attachment {
            Attachment::AgainstWall(wall) => {
                let gap = numbers[1].clamp(self.noise.wall_clearance, self.noise.wall_gap_most);
                pose.position = wall.point(&e, numbers[0], 0.0) + wall.normal() * (gap + size.z / 2.0);
            }
            Attachment::OnWall(wall) => {
                let y = self.foot_on_wall(numbers[1], &mut pose, &mut size);
                let away = if self.item.traits.opening {
                    // A curtain must hang free of the window's frame, and hangs along the wall.
                    let setback = self.item.shape.setback() * pose.scale * pose.stretch.z;
                    let curtained = self.is_curtained(wall.wall, numbers[0], size.x);
                    let proud = if curtained { 0.0 } else { PROUD.max(CASING_PROUD + setback) };
                    size.z.min(proud) - size.z / 2.0
                } else {
                    size.z / 2.0
                };
                pose.position = wall.point(&e, numbers[0], y) + wall.normal() * (self.noise.wall_clearance + away);
            }
            Attachment::Ceiling => pose.position.y = self.scene.room.ceiling_over(pose.position) - size.y,
            Attachment::OnLedge(ledge) => {
                if let Some(top) = self.scene.room.ledge_top(ledge) {
                    // Its middle is over the ledge; it may reach out over the edge.
                    pose.position = top.nearest(pose.position);
                    pose.position.y -= sag_of(self.item, &pose);
                }
            }
            Attachment::Floor | Attachment::OnHost { .. } => {}
        }
        let (low, high) = reach(self.item, &pose);
        pose.position = self.inside(pose.position, low, high);
        if self.attachment == Attachment::Floor {
            pose.position += self.out_of_blocks(pose.position + low, pose.position + high);
        }
        if let Attachment::OnHost { host, level } = self.attachment {
            pose.position.y = self.surface(host, level, &pose).map_or(level, |s| s.height) - sag_of(self.item, &pose);
        }
        pose
    }

    /// How high the foot of a thing on a wall is. What was said to reach floor or ceiling ends there, and is as high as that
    /// asks for where its proportions may change; its other end stays.
    fn foot_on_wall(&self, foot: f64, pose: &mut Pose, size: &mut Vec3) -> f64 {
        let (traits, ceiling) = (&self.item.traits, self.scene.room.extents.height);
        let highest = if traits.to_floor { 0.0 } else { (ceiling - size.y).max(0.0) };
        if !traits.may_stretch || traits.opening || !(traits.to_floor || traits.to_ceiling) {
            return foot.clamp(0.0, highest);
        }
        let bottom = if traits.to_floor { 0.0 } else { foot.clamp(0.0, 0.9 * ceiling) };
        let top = if traits.to_ceiling { ceiling } else { (foot + size.y).clamp(0.1 * ceiling, ceiling) };
        pose.stretch.y *= (top - bottom).max(0.05 * ceiling) / size.y.max(1e-6);
        *size = size_of(self.item, pose);
        bottom
    }

    /// The nearest place within the room, or one of its niches, for a box of coordinates relative to it.
    fn inside(&self, at: Vec3, low: Vec3, high: Vec3) -> Vec3 {
        let e = &self.scene.room.extents;
        let clearance = self.noise.wall_clearance;
        // Where a wall is not known, what is seen decides, and the wall follows.
        let beyond = |wall, is_its_own: bool| {
            if is_its_own && self.scene.is_loose(wall) { BEYOND_LOOSE } else { 0.0 }
        };
        // Along one axis: the place, and how far the box is outside there as it is.
        let along = |v: f64, lo: f64, hi: f64, [from, to]: [f64; 2], length: f64, ends: [Wall; 2]| {
            let (least, most) = (
                from - lo + clearance - beyond(ends[0], from == 0.0),
                to - hi - clearance + beyond(ends[1], to == length),
            );
            let place = if least <= most { v.clamp(least, most) } else { f64::midpoint(least, most) };
            (place, (place - v).abs())
        };
        // Wall-held objects keep their distance to the wall; the clamp along the other axis still applies.
        let plane = match self.attachment {
            Attachment::AgainstWall(w) | Attachment::OnWall(w) => Some(w),
            _ => None,
        };
        let fixed_axis = plane.map(|w| w.normal().x.abs() > 0.5);
        let within = |[from, to]: [Vec2; 2]| {
            let (x, off_x) = along(at.x, low.x, high.x, [from.x, to.x], e.width, [Wall::Left, Wall::Right]);
            let (z, off_z) = along(at.z, low.z, high.z, [from.y, to.y], e.depth, [Wall::Back, Wall::Front]);
            let place = match fixed_axis {
                Some(true) => Vec3::new(at.x, at.y, z),
                Some(false) => Vec3::new(x, at.y, at.z),
                None => Vec3::new(x, at.y, z),
            };
            (place, off_x.hypot(off_z))
        };
        let foot = if let Attachment::OnHost { level, .. } = self.attachment { level } else { at.y };
        // What is held by a wall of the box is before it.
        let is_in_box = plane.is_some_and(|w| w.inset >= 0.0);
        let areas = self.scene.room.standing_areas(foot).take(if is_in_box { 1 } else { usize::MAX });
        let places = areas.map(within).min_by(|a, b| a.1.total_cmp(&b.1));
        places.map_or(at, |(place, _)| place)
    }

    /// The shortest level way out of the room's solid blocks for a box of room coordinates.
    fn out_of_blocks(&self, low: Vec3, high: Vec3) -> Vec3 {
        let e = &self.scene.room.extents;
        let mut by = Vec3::ZERO;
        for block in &self.scene.room.shape.blocks {
            let (low, high) = (low + by, high + by);
            if !(low.cmplt(block.max).all() && high.cmpgt(block.min).all()) {
                continue;
            }
            let room = [block.min.x - (high.x - low.x), e.width - block.max.x - (high.x - low.x)];
            let ways = [
                (Vec3::NEG_X * (high.x - block.min.x), room[0]),
                (Vec3::X * (block.max.x - low.x), room[1]),
                (Vec3::NEG_Z * (high.z - block.min.z), block.min.z - (high.z - low.z)),
                (Vec3::Z * (block.max.z - low.z), e.depth - block.max.z - (high.z - low.z)),
            ];
            let way = ways.into_iter().filter(|w| w.1 >= 0.0).min_by(|a, b| a.0.length().total_cmp(&b.0.length()));
            by += way.map_or(Vec3::ZERO, |w| w.0);
        }
        by
    }

    /// Where the ray of a pixel meets a level plane, within reach of the room.
    pub(crate) fn plane_hit(&self, pixel: Vec2, height: f64) -> Option<Vec3> {
        let ray = self.scene.camera.ray(pixel);
        let k = (height - ray.origin.y) / ray.direction.y;
        let reach = 2.0 * self.scene.room.extents.as_vec().length();
        (k.is_finite() && k > 0.05 && k < reach).then(|| ray.at(k))
    }

    /// Whether something hangs before a part of a wall, such as a curtain.
    fn is_curtained(&self, wall: Wall, u: f64, width: f64) -> bool {
        self.scene.placed.iter().any(|p| {
            p.item.traits.hangs
                && p.support == Support::Wall { wall }
                && (wall.coordinates(p.pose.position).x - u).abs() < f64::midpoint(width, p.size().width)
        })
    }

    fn surface(&self, host: usize, level: f64, pose: &Pose) -> Option<support::Surface> {
        let query = SurfaceQuery { level, object_height: size_of(self.item, pose).y, soft: self.item.traits.soft };
        support::surface_under(self.scene.placed.get(host)?, self.item, pose, &query)
    }

    /// Share of an object's footprint that has its host's surface under it; 1 for objects without host.
    pub(crate) fn supported_share(&self, pose: &Pose) -> f64 {
        match self.attachment {
            Attachment::OnHost { host, level } => self.surface(host, level, pose).map_or(0.0, |s| s.share),
            Attachment::OnLedge(ledge) => self.scene.room.ledge_top(ledge).map_or(0.0, |top| {
                let (low, high) = reach(self.item, pose);
                let over = (high + pose.position).xz().min(top.area[1]) - (low + pose.position).xz().max(top.area[0]);
                let (over, whole) = (over.max(Vec2::ZERO), (high - low).xz());
                (over.x * over.y / (whole.x * whole.y).max(1e-9)).min(1.0)
            }),
            _ => 1.0,
        }
    }

    /// Gap between an object's back and its wall, when it is held by one on the floor.
    pub(crate) fn gap(&self, pose: &Pose) -> Option<f64> {
        match self.attachment {
            Attachment::AgainstWall(wall) => {
                Some(wall.distance(&self.scene.room.extents, pose.position) - size_of(self.item, pose).z / 2.0)
            }
            _ => None,
        }
    }

    /// What carries the object, in the scene's words.
    pub(crate) fn support(&self) -> Support {
        match self.attachment {
            Attachment::Floor | Attachment::AgainstWall(_) => Support::Floor,
            Attachment::OnWall(plane) => Support::Wall { wall: plane.wall },
            Attachment::Ceiling => Support::Ceiling,
            Attachment::OnHost { host, .. } => match self.scene.placed.get(host) {
                Some(p) => Support::Object { id: p.item.id.clone() },
                None => Support::Floor,
            },
            Attachment::OnLedge(ledge) => ledge.support(),
        }
    }

    /// Which numbers the optimiser may change, with their first steps.
    pub(crate) fn free_numbers(&self, pose: &Pose) -> Vec<(usize, f64)> {
        let size = size_of(self.item, pose);
        let reach = size.max_element().clamp(0.05, 1.0);
        let mut out = Vec::with_capacity(7);
        match self.attachment {
            Attachment::AgainstWall(_) => out.extend([(0, 0.08 * reach), (1, 0.02)]),
            Attachment::OnWall(_) => out.extend([(0, 0.06 * reach), (1, 0.06 * reach)]),
            _ => out.extend([(0, 0.1 * reach), (1, 0.1 * reach)]),
        }
        let turns = !matches!(self.attachment, Attachment::AgainstWall(_) | Attachment::OnWall(_));
        if turns && !matches!(self.yaw, YawRule::Fixed(_)) {
            out.push((2, 8.0_f64.to_radians()));
        }
        if self.fixed_size {
            return out;
        }
        if self.item.traits.may_stretch || self.item.traits.planar {
            out.extend([(4, 0.06), (5, 0.06)]);
            if !matches!(self.attachment, Attachment::OnWall(_)) && !self.item.traits.as_wide_as_deep {
                out.push((6, 0.06));
            }
        } else {
            out.push((3, 0.06));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{boxed, empty_room};

    #[test]
    fn what_is_as_wide_as_deep_stays_so() {
        let scene = empty_room();
        let mut item = boxed(&scene, Vec3::new(0.8, 0.5, 0.8), Vec3::new(1.5, 0.0, 1.5), 0.0);
        item.traits.may_stretch = true;
        for tied in [false, true] {
            item.traits.as_wide_as_deep = tied;
            let noise = Noise::default();
            let constraint = PoseConstraint::new(&scene, &item, Attachment::Floor, YawRule::Free(0.0), &noise);
            let pose = constraint.pose(&[1.5, 1.5, 0.0, 0.0, 0.2, 0.0, -0.3]);
            let size = size_of(&item, &pose);
            assert_eq!((size.x / size.z - 1.0).abs() < 1e-9, tied);
            assert_eq!(constraint.free_numbers(&pose).iter().any(|(i, _)| *i == 6), !tied);
        }
    }

    #[test]
    fn what_reaches_floor_or_ceiling_ends_there_and_its_other_end_stays() {
        let scene = empty_room();
        let ceiling = scene.room.extents.height;
        let mut item = boxed(&scene, Vec3::new(1.0, 1.2, 0.05), Vec3::new(1.5, 0.0, 1.5), 0.0);
        item.traits.may_stretch = true;
        let noise = Noise::default();
        // Seen from 0.9 to 2.1 m.
        let mut ends = |to_floor: bool, to_ceiling: bool| {
            (item.traits.to_floor, item.traits.to_ceiling) = (to_floor, to_ceiling);
            let on = Attachment::OnWall(harmony_scene::Wall::Back.into());
            let constraint = PoseConstraint::new(&scene, &item, on, YawRule::Fixed(0.0), &noise);
            let pose = constraint.pose(&[1.5, 0.9, 0.0, 0.0, 0.0, 0.0, 0.0]);
            let again = constraint.settle(&pose);
            assert!((again.position - pose.position).length() < 1e-9 && (again.stretch - pose.stretch).length() < 1e-9);
            [pose.position.y, pose.position.y + size_of(&item, &pose).y]
        };
        let near = |a: [f64; 2], b: [f64; 2]| (0..2).all(|k| (a[k] - b[k]).abs() < 1e-6);
        assert!(near(ends(false, false), [0.9, 2.1]));
        assert!(near(ends(true, false), [0.0, 2.1]));
        assert!(near(ends(false, true), [0.9, ceiling]));
        assert!(near(ends(true, true), [0.0, ceiling]));
    }

    #[test]
    fn a_larger_rug_is_no_thicker_one() {
        let scene = empty_room();
        let mut item = boxed(&scene, Vec3::new(2.0, 0.006, 1.5), Vec3::new(2.0, 0.0, 1.5), 0.0);
        let height = |item: &Item, scale| 0.006 * scale * height_stretch(item, scale, 1.0);
        assert!((height(&item, 3.0) - 0.018).abs() < 1e-9);
        item.traits.flat = true;
        assert!((height(&item, 1.1) - 0.0066).abs() < 1e-6);
        assert!((height(&item, 3.0) - THICKEST_RUG).abs() < 1e-6);
        item.size.height = 0.015;
        assert!((height(&item, 3.0) - THICKEST_RUG).abs() < 1e-6, "a short pile is pressed down");
        item.size.height = 0.03;
        assert!((height(&item, 3.0) - 0.018).abs() < 1e-6 && (height(&item, 9.0) - 0.03).abs() < 1e-6);
    }
}
