//! What a file holds, whatever its format.

use std::collections::BTreeMap;

use glam::DVec3;

/// Something with a name, as it was found.
#[derive(Debug, Clone)]
pub struct Seen {
    /// Origin, metres.
    pub position: Option<DVec3>,
    /// Bounds of what is drawn.
    pub low: DVec3,
    /// The other corner.
    pub high: DVec3,
    /// Triangles that are drawn.
    pub triangles: usize,
    /// Colliders.
    pub hulls: usize,
    /// Bounds of the colliders.
    pub hull_low: DVec3,
    /// The other corner.
    pub hull_high: DVec3,
    /// Mass, kilograms.
    pub mass: Option<f64>,
    /// Friction of its colliders.
    pub friction: Option<f64>,
    /// Whether it can move, where the file says so.
    pub moves: Option<bool>,
    /// Parts of it that open.
    pub parts: usize,
}

impl Default for Seen {
    fn default() -> Self {
        Self {
            position: None,
            low: DVec3::INFINITY,
            high: DVec3::NEG_INFINITY,
            triangles: 0,
            hulls: 0,
            hull_low: DVec3::INFINITY,
            hull_high: DVec3::NEG_INFINITY,
            mass: None,
            friction: None,
            moves: None,
            parts: 0,
        }
    }
}

impl Seen {
    /// Takes a corner of something drawn.
    pub fn visual(&mut self, p: DVec3) {
        (self.low, self.high) = (self.low.min(p), self.high.max(p));
    }

    /// Takes a corner of a collider.
    pub fn collider(&mut self, p: DVec3) {
        (self.hull_low, self.hull_high) = (self.hull_low.min(p), self.hull_high.max(p));
    }
}

/// All that a file holds, in the room frame.
#[derive(Debug, Clone, Default)]
pub struct Inventory {
    /// By name. Names that are no object's are sorted out by the comparison.
    pub objects: BTreeMap<String, Seen>,
    /// Faces of the room.
    pub faces: BTreeMap<String, Seen>,
    /// Names that stand twice.
    pub twice: Vec<String>,
    /// Places of lights, where the format has them.
    pub lights: Option<Vec<DVec3>>,
    /// The camera's place, where the format has one.
    pub camera: Option<DVec3>,
}

impl Inventory {
    /// Adds something by its name.
    pub fn add(&mut self, name: &str, seen: Seen) {
        if self.objects.insert(name.to_owned(), seen).is_some() {
            self.twice.push(name.to_owned());
        }
    }
}

/// A vector of a +Z-up file in the room.
pub(super) fn from_z_up(v: DVec3) -> DVec3 {
    DVec3::new(v.x, v.z, -v.y)
}
