//! What cuts into what, and what hangs in the air.

use glam::{DMat3, DVec3};
use harmony_mesh::{Bounds, Bvh, Mesh};
use harmony_scene::{Support, Wall};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::objects::ObjectScore;
use super::prediction::Prediction;
use crate::metrics::sample::{Seed, sample_surface};
use crate::metrics::soup::soup_of;
use crate::truth::{TruthObject, TruthRoom};

/// Penetration that counts, metres.
const DEEP: f64 = 0.01;
/// Gap that counts, metres.
const GAP: f64 = 0.005;
/// Surface points an object is probed with.
const PROBES: usize = 1500;

/// Two objects in each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairScore {
    /// Ids in the run.
    pub pair: [String; 2],
    /// Deepest point, metres.
    pub depth_m: f64,
    /// Shared volume, litres.
    pub volume_l: f64,
}

/// A mesh in the room that can be probed.
pub struct Solid {
    bvh: Bvh,
    bounds: Bounds,
    points: Vec<DVec3>,
    lowest: Vec<DVec3>,
}

/// Area-uniform points on a mesh; none where it has no surface.
pub fn surface_points(mesh: &Mesh, count: usize, seed: u64) -> Vec<DVec3> {
    let seed = Seed { seed, draw: 0 };
    sample_surface(&soup_of(mesh, |p| p), count, seed).map_or_else(|_| Vec::new(), |s| s.points)
}

impl Solid {
    /// A mesh whose positions are in the room frame.
    pub fn new(mesh: &Mesh) -> Option<Self> {
        let bounds = mesh.bounds()?;
        let mut lowest: Vec<DVec3> =
            mesh.positions.iter().map(|p| p.as_dvec3()).filter(|p| p.y < bounds.min.y + 0.01).collect();
        let step = lowest.len().div_ceil(200).max(1);
        lowest = lowest.into_iter().step_by(step).collect();
        Some(Self { bvh: Bvh::new(mesh), bounds, points: surface_points(mesh, PROBES, 11), lowest })
    }

    /// Whether a point is inside, by the parity of crossings along three rays, two of which must agree.
    fn contains(&self, p: DVec3) -> bool {
        let directions = [DVec3::new(0.31, 0.9, 0.17), DVec3::new(-0.83, 0.21, 0.47), DVec3::new(0.13, -0.37, -0.91)];
        let odd = directions.iter().filter(|d| self.crossings(p, d.normalize()) % 2 == 1).count();
        odd >= 2
    }

    fn crossings(&self, mut origin: DVec3, direction: DVec3) -> usize {
        let mut count = 0;
        while let Some(hit) = self.bvh.raycast(origin, direction, 100.0) {
            count += 1;
            if count > 200 {
                break;
            }
            origin += direction * (hit.distance + 1e-5);
        }
        count
    }

    /// Deepest of this solid's probes inside another.
    fn depth_in(&self, other: &Self) -> f64 {
        let (low, high) = (other.bounds.min, other.bounds.max);
        self.points
            .iter()
            .filter(|p| p.cmpgt(low).all() && p.cmplt(high).all())
            .filter(|p| other.contains(**p))
            .filter_map(|p| Some(other.bvh.closest_point(*p)?.distance))
            .fold(0.0, f64::max)
    }

    fn may_touch(&self, other: &Self) -> bool {
        self.bounds.min.cmplt(other.bounds.max - 1e-3).all() && other.bounds.min.cmplt(self.bounds.max - 1e-3).all()
    }

    /// How deep two solids are in each other, metres; no deeper than their boxes, whose overlap along an axis is a way out
    /// (of a sofa that is open below, the floor's rug is nowhere near a surface).
    pub fn penetration(&self, other: &Self) -> f64 {
        if !self.may_touch(other) {
            return 0.0;
        }
        let overlap = self.bounds.max.min(other.bounds.max) - self.bounds.min.max(other.bounds.min);
        self.depth_in(other).max(other.depth_in(self)).min(overlap.min_element())
    }

    /// Volume shared with another, cubic metres, on a grid of 14 cells a side of the shared box.
    fn shared_volume(&self, other: &Self) -> f64 {
        const N: usize = 14;
        let (low, high) = (self.bounds.min.max(other.bounds.min), self.bounds.max.min(other.bounds.max));
        let cell = (high - low) / N as f64;
        let mut inside = 0;
        for i in 0..N * N * N {
            let at = DVec3::new((i % N) as f64, (i / N % N) as f64, (i / N / N) as f64) + 0.5;
            let p = low + at * cell;
            inside += usize::from(self.contains(p) && other.contains(p));
        }
        inside as f64 * cell.x * cell.y * cell.z
    }

    /// Gap between the lowest points and the surface of a host below them, metres; `None` when there is none below.
    fn gap_above(&self, host: &Self) -> Option<f64> {
        const ABOVE: f64 = 0.03;
        self.lowest
            .iter()
            .filter_map(|p| {
                let hit = host.bvh.raycast(*p + DVec3::Y * ABOVE, DVec3::NEG_Y, 3.0)?;
                Some(hit.distance - ABOVE)
            })
            .min_by(f64::total_cmp)
    }
}

fn in_room(t: &TruthObject) -> Mesh {
    let mut mesh = (*t.mesh).clone();
    let turn = DMat3::from_rotation_y(t.yaw);
    mesh.map(|p| t.point(p.as_dvec3()).as_vec3(), |n| (turn * n.as_dvec3()).as_vec3());
    mesh
}

/// Pairs and floating objects of a run that the truth doesn't have.
pub fn faults(truth: &TruthRoom, run: &Prediction, scores: &[ObjectScore]) -> (Vec<PairScore>, Vec<(String, f64)>) {
    let solids: Vec<Option<Solid>> = run.objects.par_iter().map(|o| Solid::new(&o.mesh)).collect();
    let true_solid = |id: &Option<String>| id.as_ref().and_then(|id| Solid::new(&in_room(truth.find(id)?)));
    let true_solids: Vec<Option<Solid>> = scores.par_iter().map(|s| true_solid(&s.truth)).collect();
    let pairs: Vec<(usize, usize)> =
        (0..solids.len()).flat_map(|i| (i + 1..solids.len()).map(move |j| (i, j))).collect();
    let penetrating = pairs
        .into_par_iter()
        .filter_map(|(i, j)| {
            let (a, b) = (solids[i].as_ref()?, solids[j].as_ref()?);
            let depth = a.penetration(b);
            if depth <= DEEP {
                return None;
            }
            if let (Some(a), Some(b)) = (&true_solids[i], &true_solids[j])
                && a.penetration(b) > DEEP
            {
                return None;
            }
            let pair = [i, j].map(|k| run.objects[k].object.id.to_string());
            Some(PairScore { pair, depth_m: depth, volume_l: 1000.0 * a.shared_volume(b) })
        })
        .collect();
    let mut floating = Vec::new();
    for (i, o) in run.objects.iter().enumerate() {
        let Some(solid) = &solids[i] else { continue };
        let host = |id: &str| run.objects.iter().position(|h| h.object.id.as_str() == id);
        let gap = match &o.object.support {
            Support::Floor => solid.bounds.min.y,
            Support::Block { .. } | Support::Niche { .. } => {
                let top = o.object.support.ledge().and_then(|ledge| run.room.ledge_top(ledge));
                solid.bounds.min.y - top.map_or(0.0, |top| top.height)
            }
            Support::Ceiling => run.room.extents.height - solid.bounds.max.y,
            Support::Wall { wall } => wall_gap(*wall, run, solid),
            Support::Object { id } => match host(id.as_str()).and_then(|h| solids[h].as_ref()) {
                Some(host) => solid.gap_above(host).unwrap_or(solid.bounds.min.y),
                None => solid.bounds.min.y,
            },
        };
        let true_gap = scores[i].truth.as_ref().and_then(|t| true_gap(truth, truth.find(t)?)).unwrap_or(0.0);
        if gap > GAP.max(true_gap + 0.002) {
            floating.push((o.object.id.to_string(), gap));
        }
    }
    (penetrating, floating)
}

fn wall_gap(wall: Wall, run: &Prediction, solid: &Solid) -> f64 {
    let (low, high) = (solid.bounds.min - run.corner, solid.bounds.max - run.corner);
    let (room, e) = (&run.room, &run.room.extents);
    let plane = room.plane_behind(wall, (low + high) / 2.0);
    plane.distance(e, low).min(plane.distance(e, high))
}

fn true_gap(truth: &TruthRoom, t: &TruthObject) -> Option<f64> {
    let solid = Solid::new(&in_room(t))?;
    Some(match &t.support {
        Support::Floor => solid.bounds.min.y,
        Support::Ceiling => truth.extents.height - solid.bounds.max.y,
        Support::Wall { .. } | Support::Block { .. } | Support::Niche { .. } => 0.0,
        Support::Object { id } => solid.gap_above(&Solid::new(&in_room(truth.find(id.as_str())?))?)?,
    })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use harmony_mesh::{Group, Material};

    use super::*;

    /// A box, without its bottom if it is open; lengths in metres.
    fn made(low: Vec3, high: Vec3, open: bool) -> Solid {
        let mut mesh = Mesh { materials: vec![Material::plain("box", [0.5; 3])], ..Mesh::default() };
        for i in 0..8 {
            let pick = |bit: i32, low: f32, high: f32| if i & bit == 0 { low } else { high };
            mesh.positions.push(Vec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z)));
            mesh.uvs.push(glam::Vec2::ZERO);
        }
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4]];
        let quads = if open { &quads[..5] } else { &quads[..] };
        let triangles = quads.iter().flat_map(|q: &[u32; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        mesh.groups.push(Group { material: 0, triangles });
        mesh.recompute_normals();
        Solid::new(&mesh).unwrap()
    }

    #[test]
    fn solids_are_no_deeper_in_each_other_than_the_way_out() {
        let rug = made(Vec3::new(-1.0, 0.0, -1.0), Vec3::new(1.0, 0.008, 1.0), false);
        for open in [false, true] {
            let sofa = made(Vec3::new(-0.8, 0.0, -0.4), Vec3::new(0.8, 0.5, 0.4), open);
            assert!(sofa.penetration(&rug) <= 0.008 + 1e-6 && rug.penetration(&sofa) <= 0.008 + 1e-6);
        }
        let (left, right) = (Vec3::new(-1.0, 0.0, 0.0), Vec3::new(-0.03, 0.0, 0.0));
        let [a, b] = [left, right].map(|low| made(low, low + Vec3::ONE, false));
        let depth = a.penetration(&b);
        assert!(depth > 0.02 && depth <= 0.03 + 1e-6, "{depth}");
    }
}
