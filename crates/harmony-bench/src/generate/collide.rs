//! How far two objects cut into each other, found from points on and in their surfaces.

use glam::{DMat3, DVec3};
use harmony_mesh::{Bounds, Bvh, Mesh};

use super::dice::Dice;

/// A mesh somewhere in the room, made ready for questions.
pub(super) struct Body<'a> {
    mesh: &'a Mesh,
    tree: Bvh,
    room_from_mesh: DMat3,
    position: DVec3,
    bounds: Bounds,
    samples: Vec<DVec3>,
}

impl<'a> Body<'a> {
    /// Prepares a mesh turned by `yaw` and shifted; `density` is points a square metre beside its corners.
    pub(super) fn new(mesh: &'a Mesh, yaw: f64, position: DVec3, density: f64) -> Self {
        let turn = DMat3::from_rotation_y(yaw);
        let mut dice = Dice::new(7, 99);
        let mut samples: Vec<DVec3> = mesh.positions.iter().map(|p| turn * p.as_dvec3() + position).collect();
        for t in mesh.triangles() {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
            let expected = (b - a).cross(c - a).length() / 2.0 * density;
            let count = expected as usize + usize::from(dice.chance(expected.fract()));
            samples.extend((0..count).map(|_| turn * triangle_point(&mut dice, [a, b, c]) + position));
        }
        let lo = samples.iter().fold(DVec3::INFINITY, |m, p| m.min(*p));
        let hi = samples.iter().fold(DVec3::NEG_INFINITY, |m, p| m.max(*p));
        Self {
            mesh,
            tree: Bvh::new(mesh),
            room_from_mesh: turn,
            position,
            bounds: Bounds { min: lo, max: hi },
            samples,
        }
    }

    /// Axis-aligned box in the room.
    pub(super) fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Depth of a room point below the surface; 0 outside.
    fn depth(&self, point: DVec3) -> f64 {
        let p = self.room_from_mesh.transpose() * (point - self.position);
        // Winding number by signed crossings: every part is closed, and parts may cut each other.
        let direction = DVec3::new(0.031, 1.0, 0.017).normalize_or(DVec3::Y);
        let (mut from, mut winding) = (p, 0);
        for _ in 0..64 {
            let Some(hit) = self.tree.raycast(from, direction, 20.0) else { break };
            winding += if hit.normal.dot(direction) > 0.0 { 1 } else { -1 };
            from = hit.point + direction * 1e-6;
        }
        if winding <= 0 { 0.0 } else { self.tree.closest_point(p).map_or(0.0, |h| h.distance) }
    }

    /// The deepest point of the other one's surface inside this one.
    fn deepest(&self, other: &Self, enough: f64) -> f64 {
        let b = self.bounds;
        let mut deepest: f64 = 0.0;
        for p in &other.samples {
            if p.cmpgt(b.min + 1e-3).all() && p.cmplt(b.max - 1e-3).all() {
                deepest = deepest.max(self.depth(*p));
                if deepest > enough {
                    break;
                }
            }
        }
        deepest
    }

    /// How far the two cut into each other, metres; the search ends beyond `enough`.
    pub(super) fn penetration(&self, other: &Self, enough: f64) -> f64 {
        if !self.boxes_meet(other, -1e-3) || self.mesh.positions.is_empty() {
            return 0.0;
        }
        let one = self.deepest(other, enough);
        if one > enough { one } else { one.max(other.deepest(self, enough)) }
    }

    /// Whether the axis-aligned boxes come closer than `gap`.
    pub(super) fn boxes_meet(&self, other: &Self, gap: f64) -> bool {
        let (a, b) = (self.bounds, other.bounds);
        (a.min - gap).cmple(b.max).all() && (b.min - gap).cmple(a.max).all()
    }
}

/// A uniform point of a triangle.
pub(super) fn triangle_point(dice: &mut Dice, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (mut u, mut v) = (dice.unit(), dice.unit());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    a + (b - a) * u + (c - a) * v
}
