//! Convex parts in the room: do they meet, and how far must one go in a direction until they don't.
//!
//! Along a direction the displacements at which two convex parts meet are one interval, found by casting one against
//! the other from outside on both sides (parry); those of two objects are the union over their pairs of parts. Room
//! frame, metres; parts go to `f32` about their own centres. What is concave is as good as its parts: a hollow that
//! they fill is solid. Depths are the shortest way out along sixteen level directions, up and down, not along any.

use std::sync::{Arc, LazyLock, OnceLock};

use harmony_scene::{Pose as RoomPose, Vec3};
use parry3d::math::{Pose, Vector};
use parry3d::query::{PointQuery as _, ShapeCastOptions, cast_shapes, intersection_test};
use parry3d::shape::ConvexPolyhedron;

use crate::Item;
use crate::scene::attachment::reach;

/// Parts thinner than this are thickened, so that they have a hull, metres.
const THINNEST: f64 = 1e-3;

/// Room positions go to f32 relative to the pair's middle: this covers the rounding, metres.
const ROUNDING: f64 = 1e-4;

/// How far a guest may be below the top of what carries it, metres.
const SUNK: f64 = 0.03;

/// Axes along which the extents of a part are known: eight level ones, half of [`level_directions`], and the vertical.
const AXES: usize = 9;

/// One convex part, in room coordinates relative to its own centre.
#[derive(Debug, Clone)]
struct Part {
    hull: ConvexPolyhedron,
    centre: Vec3,
    /// From where to where it reaches along each of [`axes`].
    extents: [[f64; 2]; AXES],
}

/// An object's convex parts in the room. Hulls are built when they are first needed: most objects are never near.
#[derive(Debug, Clone)]
pub(crate) struct Solid {
    item: Arc<Item>,
    pose: RoomPose,
    parts: OnceLock<Vec<Part>>,
    pub(crate) low: Vec3,
    pub(crate) high: Vec3,
}

/// Displacements `t` along a direction at which two things meet.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Interval {
    from: f64,
    to: f64,
}

impl Interval {
    /// Whether it begins at a displacement or before, and ends after it.
    fn holds(&self, t: f64) -> bool {
        self.from <= t + 1e-9 && self.to > t
    }
}

fn vector(v: Vec3) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    points.iter().fold((Vec3::MAX, Vec3::MIN), |(l, h), p| (l.min(*p), h.max(*p)))
}

fn part(points: &[Vec3]) -> Option<Part> {
    let (low, high) = bounds(points);
    let centre = (low + high) / 2.0;
    let extents = axes().map(|axis| {
        let along = points.iter().map(|p| p.dot(axis));
        along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    });
    let relative: Vec<Vector> = points.iter().map(|p| vector(*p - centre)).collect();
    let hull = ConvexPolyhedron::from_convex_hull(&relative).or_else(|| {
        // Coplanar points have no hull: give them some thickness in every direction.
        let thick: Vec<Vector> = points
            .iter()
            .flat_map(|p| [Vec3::splat(-THINNEST), Vec3::splat(THINNEST)].map(|d| *p + d))
            .flat_map(|p| [p, p + Vec3::X * THINNEST, p + Vec3::Z * THINNEST])
            .map(|p| vector(p - centre))
            .collect();
        ConvexPolyhedron::from_convex_hull(&thick)
    })?;
    Some(Part { hull, centre, extents })
}

impl Solid {
    /// The parts of an object in a pose. Parts without volume are left out.
    pub(crate) fn new(item: &Arc<Item>, pose: &RoomPose) -> Self {
        let (low, high) = reach(item, pose);
        let (low, high) = (low + pose.position, high + pose.position);
        Self { item: Arc::clone(item), pose: *pose, parts: OnceLock::new(), low, high }
    }

    fn parts(&self) -> &[Part] {
        self.parts.get_or_init(|| {
            let room = |hull: &Vec<Vec3>| hull.iter().map(|p| self.pose.point(*p)).collect::<Vec<_>>();
            self.item.shape.hulls().iter().filter_map(|h| part(&room(h))).collect()
        })
    }

    /// The same parts elsewhere.
    pub(crate) fn moved(&self, by: Vec3) -> Self {
        let mut out = self.clone();
        out.pose.position += by;
        for p in out.parts.get_mut().into_iter().flatten() {
            p.centre += by;
            for ([low, high], axis) in p.extents.iter_mut().zip(axes()) {
                let along = axis.dot(by);
                (*low, *high) = (*low + along, *high + along);
            }
        }
        out.low += by;
        out.high += by;
        out
    }

    /// The shortest displacement of this solid along a unit direction after which it does not meet another one, metres: 0 when
    /// they are apart already; `None` when it is `limit` or longer.
    ///
    /// Parts meet within the interval in which their extents do, so that a pair is cast only once the way has come there.
    pub(crate) fn way_out(&self, other: &Self, direction: Vec3, limit: f64) -> Option<f64> {
        self.way_out_of(other, &other.all_parts(), direction, limit)
    }

    /// The same out of the parts of a host that are beside what stands in it ([`Solid::parts_beside`]), for each direction in which
    /// there is a way so short: the displacements.
    pub(crate) fn ways_beside(&self, host: &Self, directions: &[Vec3], limit: f64) -> Vec<Vec3> {
        let parts = host.parts_beside(self);
        directions.iter().filter_map(|d| Some(*d * self.way_out_of(host, &parts, *d, limit)?)).collect()
    }

    fn way_out_of(&self, other: &Self, parts: &[&Part], direction: Vec3, limit: f64) -> Option<f64> {
        if boxes_meet(self.low, self.high, other.low, other.high, direction).is_none_or(|boxes| !boxes.holds(0.0)) {
            return (limit > 0.0).then_some(0.0);
        }
        let pairs = self.parts().iter().flat_map(|a| parts.iter().map(move |b| (a, *b)));
        let mut waiting: Vec<Pair<'_>> = pairs
            .filter_map(|(a, b)| {
                let meet = extents_meet(a, b, direction).filter(|meet| meet.to > 0.0)?;
                Some(Pair { parts: Some((a, b)), meet })
            })
            .collect();
        let mut t = 0.0;
        loop {
            let before = t;
            waiting.retain_mut(|pair| {
                if pair.meet.to > t
                    && pair.meet.holds(t)
                    && let Some((a, b)) = pair.parts.take()
                {
                    pair.meet = meeting(a, b, direction, &pair.meet).unwrap_or(Interval { from: t, to: t });
                }
                if pair.parts.is_none() && pair.meet.holds(t) {
                    t = pair.meet.to;
                }
                pair.meet.to > t
            });
            if t >= limit {
                return None;
            }
            if t <= before {
                return Some(t);
            }
        }
    }

    /// Whether any part of this solid meets one of the other's where they are.
    fn touches(&self, parts: &[&Part]) -> bool {
        let mut pairs = self.parts().iter().flat_map(|a| parts.iter().map(move |b| (a, *b)));
        pairs.any(|(a, b)| {
            let near = a.extents.iter().zip(&b.extents).all(|(a, b)| a[0] <= b[1] && b[0] <= a[1]);
            let at = Pose::from_translation(vector(b.centre - a.centre));
            near && intersection_test(&Pose::IDENTITY, &a.hull, &at, &b.hull).is_ok_and(|met| met.intersecting)
        })
    }

    fn all_parts(&self) -> Vec<&Part> {
        self.parts().iter().collect()
    }

    /// The parts that are beside a guest, as back and sides of a bookcase are beside its books: not what carries it, nor what
    /// has the guest's middle in it, for that part fills a hollow.
    fn parts_beside(&self, guest: &Self) -> Vec<&Part> {
        let up = AXES - 1;
        let carries = |p: &Part| p.extents[up][1] <= guest.low.y + SUNK;
        let fills = |p: &Part| guest.parts().iter().any(|g| holds(p, g.centre));
        self.parts().iter().filter(|p| !carries(p) && !fills(p)).collect()
    }

    /// Whether the solids' boxes come nearer than `margin`.
    pub(crate) fn near(&self, other: &Self, margin: f64) -> bool {
        self.low.cmple(other.high + margin).all() && other.low.cmple(self.high + margin).all()
    }

    /// How deep two solids are in one another: the shortest way out along any of the given directions, 0 if apart.
    pub(crate) fn penetration(&self, other: &Self, directions: &[Vec3]) -> f64 {
        if self.near(other, 0.0) { self.penetration_of(other, &other.all_parts(), directions) } else { 0.0 }
    }

    /// How deep what stands in a host is in the parts beside it.
    pub(crate) fn penetration_beside(&self, host: &Self, directions: &[Vec3]) -> f64 {
        if self.near(host, 0.0) { self.penetration_of(host, &host.parts_beside(self), directions) } else { 0.0 }
    }

    fn penetration_of(&self, other: &Self, parts: &[&Part], directions: &[Vec3]) -> f64 {
        if !self.touches(parts) {
            return 0.0;
        }
        let way = |d: Vec3, limit: f64| self.way_out_of(other, parts, d, limit);
        let shortest = directions.iter().fold(f64::INFINITY, |best, d| way(*d, best).unwrap_or(best));
        if shortest.is_finite() { shortest } else { 0.0 }
    }
}

/// Whether a point is in a part.
fn holds(part: &Part, point: Vec3) -> bool {
    part.hull.contains_local_point(vector(point - part.centre))
}

/// Two parts that meet at some displacements: at most within those of their extents while the parts are still there,
/// then exactly.
struct Pair<'a> {
    parts: Option<(&'a Part, &'a Part)>,
    meet: Interval,
}

/// Displacements along a direction at which two boxes overlap.
fn boxes_meet(low_a: Vec3, high_a: Vec3, low_b: Vec3, high_b: Vec3, d: Vec3) -> Option<Interval> {
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for i in 0..3 {
        let (near, far) = (low_b[i] - high_a[i], high_b[i] - low_a[i]);
        if d[i].abs() < 1e-9 {
            if near >= 0.0 || far <= 0.0 {
                return None;
            }
            continue;
        }
        let (a, b) = (near / d[i], far / d[i]);
        from = from.max(a.min(b));
        to = to.min(a.max(b));
    }
    (from < to && from.is_finite() && to.is_finite()).then_some(Interval { from, to })
}

/// Displacements of one part along a direction at which the extents of two overlap on every axis.
fn extents_meet(a: &Part, b: &Part, d: Vec3) -> Option<Interval> {
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for ((axis, a), b) in axes().into_iter().zip(&a.extents).zip(&b.extents) {
        let (near, far, along) = (b[0] - a[1], b[1] - a[0], axis.dot(d));
        if along.abs() < 1e-9 {
            if near >= 0.0 || far <= 0.0 {
                return None;
            }
            continue;
        }
        let (p, q) = (near / along, far / along);
        from = from.max(p.min(q));
        to = to.min(p.max(q));
    }
    (from < to && from.is_finite() && to.is_finite()).then_some(Interval { from, to })
}

/// Displacements of one part along a direction at which it meets another: an interval, both being convex, within that of
/// their extents.
fn meeting(a: &Part, b: &Part, d: Vec3, within: &Interval) -> Option<Interval> {
    let length = within.to - within.from + 0.02;
    let target = Pose::from_translation(vector(b.centre - a.centre));
    // From outside on either side until the first touch.
    let touch = |start: f64, towards: f64| -> Option<f64> {
        let from = Pose::from_translation(vector(d * start));
        let options = ShapeCastOptions::with_max_time_of_impact(length as f32);
        let hit = cast_shapes(&from, vector(d * towards), &a.hull, &target, Vector::ZERO, &b.hull, options).ok()??;
        Some(start + towards * f64::from(hit.time_of_impact))
    };
    let to = touch(within.to + 0.01, -1.0)?;
    let from = touch(within.from - 0.01, 1.0)?;
    (to > from + ROUNDING).then_some(Interval { from, to })
}

/// Axes of the extents of parts.
fn axes() -> [Vec3; AXES] {
    static ALL: LazyLock<[Vec3; AXES]> = LazyLock::new(|| {
        let level = level_directions();
        std::array::from_fn(|k| if k + 1 < AXES { level[k] } else { Vec3::Y })
    });
    *ALL
}

/// Unit directions: level ones all around, then up and down.
pub(crate) fn directions_around() -> Vec<Vec3> {
    let mut out = level_directions();
    out.extend([Vec3::Y, Vec3::NEG_Y]);
    out
}

/// Sixteen level unit directions.
pub(crate) fn level_directions() -> Vec<Vec3> {
    (0..16).map(|i| Vec3::new(1.0, 0.0, 0.0).rotate_y(f64::from(i) * std::f64::consts::TAU / 16.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;
    use crate::testing::{boxed, empty_room, of_boxes};
    use proptest::prelude::*;

    #[test]
    fn two_boxes_meet_over_the_sum_of_their_widths() {
        let scene = empty_room();
        let item = Arc::new(boxed(&scene, Vec3::new(0.6, 0.5, 0.4), Vec3::new(2.0, 0.0, 2.0), 0.0));
        let a = Solid::new(&item, &RoomPose::new(Vec3::new(2.0, 0.0, 2.0), 0.0, 1.0));
        let b = Solid::new(&item, &RoomPose::new(Vec3::new(2.2, 0.1, 2.1), 0.0, 1.0));
        let [left, right] = [Vec3::NEG_X, Vec3::X].map(|d| a.way_out(&b, d, f64::INFINITY).unwrap());
        assert!((left - 0.4).abs() <= 1e-3 && (right - 0.8).abs() <= 1e-3, "{left} {right}");
        assert_eq!(a.way_out(&b, Vec3::X, 0.7), None, "longer than was asked for");
        let depth = a.penetration(&b, &directions_around());
        assert!((depth - 0.3).abs() <= 1e-3, "0.3 along -z is the shortest way, got {depth}");
        let away = a.moved(Vec3::new(1.5, 0.0, 0.0));
        assert_eq!(away.penetration(&b, &directions_around()), 0.0);
    }

    #[test]
    fn a_gap_between_obstacles_is_a_way_out() {
        let scene = empty_room();
        // A post against walls at these places along x.
        let way = |walls: &[[f64; 2]]| {
            let solid = |shape: Shape| {
                let mut item = boxed(&scene, Vec3::ONE, Vec3::ZERO, 0.0);
                item.shape = Arc::new(shape);
                Solid::new(&Arc::new(item), &RoomPose::new(Vec3::new(2.0, 0.0, 2.0), 0.0, 1.0))
            };
            let wall = |[from, to]: &[f64; 2]| (Vec3::new(to - from, 1.0, 1.0), Vec3::X * (from + to) / 2.0);
            let post = solid(of_boxes(&[wall(&[-0.1, 0.1])]));
            let walls = solid(of_boxes(&walls.iter().map(wall).collect::<Vec<_>>()));
            post.way_out(&walls, Vec3::X, f64::INFINITY).unwrap()
        };
        let near = |a: f64, b: f64| (a - b).abs() < 1e-3;
        assert!(near(way(&[[-0.4, 0.0], [0.3, 0.5]]), 0.1), "the gap is as wide as the post");
        assert!(near(way(&[[0.3, 0.5]]), 0.0));
        assert!(near(way(&[[0.15, 0.5], [-0.9, 0.1]]), 0.6), "too narrow a gap is none");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn after_the_way_out_turned_boxes_are_apart_and_a_little_before_they_are_not(
            x in -0.3_f64..0.3, z in -0.3_f64..0.3, yaw_a in 0.0_f64..3.1, yaw_b in 0.0_f64..3.1, k in 0_usize..16,
        ) {
            let scene = empty_room();
            let item = Arc::new(boxed(&scene, Vec3::new(0.8, 0.5, 0.4), Vec3::new(2.0, 0.0, 2.0), 0.0));
            let a = Solid::new(&item, &RoomPose::new(Vec3::new(2.0 + x, 0.0, 2.0 + z), yaw_a, 1.0));
            let b = Solid::new(&item, &RoomPose::new(Vec3::new(2.0, 0.0, 2.0), yaw_b, 1.0));
            let all = directions_around();
            prop_assert!(a.penetration(&b, &all) > 0.0);
            let d = level_directions()[k];
            let t = a.way_out(&b, d, f64::INFINITY).unwrap();
            prop_assert!(t > 0.0);
            prop_assert!(a.moved(d * (t + 2e-3)).penetration(&b, &all) <= 1e-3);
            prop_assert!(a.moved(d * (t - 5e-3)).penetration(&b, &all) > 0.0);
        }
    }
}
