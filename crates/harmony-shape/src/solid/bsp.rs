//! Convex polygons cut by planes, and a small binary space partition of a patch of surface.

use glam::DVec3;

/// Distance under which a point counts as on a plane, metres.
pub(super) const ON: f64 = 1e-7;
/// Polygons tried as the next plane.
const TRIED: usize = 6;

/// `normal . p = offset`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    pub normal: DVec3,
    pub offset: f64,
}

impl Plane {
    /// Of three points; `None` when they lie on a line.
    pub fn of(p: &[DVec3]) -> Option<Self> {
        let normal = (p[1] - p[0]).cross(p[2] - p[0]);
        let longest = (p[1] - p[0]).length_squared().max((p[2] - p[0]).length_squared());
        if normal.length() < 1e-9 * longest.max(1e-18) {
            return None;
        }
        let normal = normal.try_normalize()?;
        Some(Self { normal, offset: normal.dot(p[0]) })
    }

    fn side(&self, p: DVec3) -> f64 {
        self.normal.dot(p) - self.offset
    }

    /// Parts of a convex polygon in front and behind.
    pub fn split(&self, polygon: &[DVec3]) -> Sides {
        let side: Vec<f64> = polygon.iter().map(|p| self.side(*p)).collect();
        let (front, back) = (side.iter().any(|s| *s > ON), side.iter().any(|s| *s < -ON));
        match (front, back) {
            (false, false) => Sides::On,
            (true, false) => Sides::Front,
            (false, true) => Sides::Back,
            (true, true) => {
                let (mut f, mut b) = (Vec::new(), Vec::new());
                for i in 0..polygon.len() {
                    let j = (i + 1) % polygon.len();
                    let (p, q, sp, sq) = (polygon[i], polygon[j], side[i], side[j]);
                    if sp >= -ON {
                        f.push(p);
                    }
                    if sp <= ON {
                        b.push(p);
                    }
                    if (sp > ON && sq < -ON) || (sp < -ON && sq > ON) {
                        // from the same end whichever way the edge is walked: both faces get the same point
                        let m = if sp > sq { p.lerp(q, sp / (sp - sq)) } else { q.lerp(p, sq / (sq - sp)) };
                        f.push(m);
                        b.push(m);
                    }
                }
                Sides::Both(f, b)
            }
        }
    }
}

/// Where a polygon lies.
pub(super) enum Sides {
    On,
    Front,
    Back,
    Both(Vec<DVec3>, Vec<DVec3>),
}

/// A patch of a closed surface as a tree of planes.
pub(super) struct Tree {
    nodes: Vec<Node>,
}

struct Node {
    plane: Plane,
    front: Option<usize>,
    back: Option<usize>,
}

/// What is kept of a polygon.
#[derive(Debug, Clone, Copy)]
pub(super) struct Keep {
    /// What lies outside; else what lies inside.
    pub outside: bool,
    /// What lies on the surface and faces as it does.
    pub same: bool,
    /// What lies on the surface and faces against it.
    pub opposite: bool,
}

impl Tree {
    /// Of convex polygons; `None` when none of them has an area.
    pub fn of(polygons: Vec<Vec<DVec3>>) -> Option<Self> {
        let mut tree = Self { nodes: Vec::new() };
        tree.grow(polygons)?;
        Some(tree)
    }

    fn grow(&mut self, polygons: Vec<Vec<DVec3>>) -> Option<usize> {
        let step = (polygons.len() / TRIED).max(1);
        let plane = polygons
            .iter()
            .step_by(step)
            .take(TRIED)
            .filter_map(|p| plane_of(p))
            .map(|plane| (cost(&plane, &polygons), plane))
            .min_by(|a, b| a.0.cmp(&b.0))
            .map(|(_, plane)| plane)
            .or_else(|| polygons.iter().find_map(|p| plane_of(p)))?;
        let (mut front, mut back) = (Vec::new(), Vec::new());
        for polygon in polygons {
            match plane.split(&polygon) {
                Sides::On => {}
                Sides::Front => front.push(polygon),
                Sides::Back => back.push(polygon),
                Sides::Both(f, b) => {
                    front.push(f);
                    back.push(b);
                }
            }
        }
        let at = self.nodes.len();
        self.nodes.push(Node { plane, front: None, back: None });
        let front = self.grow(front);
        let back = self.grow(back);
        self.nodes[at].front = front;
        self.nodes[at].back = back;
        Some(at)
    }

    /// The parts of a convex polygon that are kept, undivided where all of it is; `normal` is the polygon's.
    pub fn clip(&self, polygon: Vec<DVec3>, normal: DVec3, keep: Keep) -> Vec<Vec<DVec3>> {
        let mut out = Vec::new();
        self.clip_at(Some(0), true, polygon, normal, keep, &mut out);
        out
    }

    /// Adds what is kept; tells whether that was all of the polygon.
    fn clip_at(
        &self,
        node: Option<usize>,
        outside: bool,
        polygon: Vec<DVec3>,
        normal: DVec3,
        keep: Keep,
        out: &mut Vec<Vec<DVec3>>,
    ) -> bool {
        let Some(node) = node.map(|n| &self.nodes[n]) else {
            if outside == keep.outside {
                out.push(polygon);
                return true;
            }
            return false;
        };
        match node.plane.split(&polygon) {
            Sides::On => {
                let kept = if node.plane.normal.dot(normal) > 0.0 { keep.same } else { keep.opposite };
                let front = kept == keep.outside;
                self.clip_at(if front { node.front } else { node.back }, front, polygon, normal, keep, out)
            }
            Sides::Front => self.clip_at(node.front, true, polygon, normal, keep, out),
            Sides::Back => self.clip_at(node.back, false, polygon, normal, keep, out),
            Sides::Both(f, b) => {
                let before = out.len();
                let all_front = self.clip_at(node.front, true, f, normal, keep, out);
                let all_back = self.clip_at(node.back, false, b, normal, keep, out);
                if all_front && all_back {
                    out.truncate(before);
                    out.push(polygon);
                    return true;
                }
                false
            }
        }
    }
}

fn plane_of(polygon: &[DVec3]) -> Option<Plane> {
    (2..polygon.len()).find_map(|k| Plane::of(&[polygon[0], polygon[k - 1], polygon[k]]))
}

/// Cut polygons cost most, then an uneven split.
fn cost(plane: &Plane, polygons: &[Vec<DVec3>]) -> usize {
    let (mut front, mut back, mut cut) = (0_usize, 0_usize, 0_usize);
    for polygon in polygons.iter().step_by((polygons.len() / 60).max(1)) {
        let f = polygon.iter().any(|p| plane.side(*p) > ON);
        let b = polygon.iter().any(|p| plane.side(*p) < -ON);
        match (f, b) {
            (true, true) => cut += 1,
            (true, false) => front += 1,
            (false, true) => back += 1,
            (false, false) => {}
        }
    }
    cut * 8 + front.abs_diff(back)
}

/// The part of a convex polygon within a box; empty when it lies outside.
pub(super) fn within(polygon: &[DVec3], lo: DVec3, hi: DVec3) -> Vec<DVec3> {
    let mut rest = polygon.to_vec();
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        for (normal, offset) in [(axis, axis.dot(hi)), (-axis, -axis.dot(lo))] {
            match (Plane { normal, offset }).split(&rest) {
                Sides::On | Sides::Back => {}
                Sides::Front => return Vec::new(),
                Sides::Both(_, b) => rest = b,
            }
        }
    }
    rest
}
