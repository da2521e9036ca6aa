//! Objects one by one, as SAM 3D Objects reports them: ADD-S, 3D IoU, rotation error.
//!
//! Both sides are in the frame of their camera, metres, and are not registered.
//!
//! | figure | is |
//! |---|---|
//! | ADD-S | mean distance from a point of the found object to the nearest of the true one (S. Hinterstoisser et al., 2012); "within 0.1": less than a tenth of the true object's diameter |
//! | 3D IoU | of boxes that stand upright in the run's room, each turned to its own least footprint |
//! | rotation | the turn that rigid ICP finds between the found object and the true one, centres together first, degrees |
//!
//! # Matching
//! The truth has no names in common with a run. Pairs are made one to one by the least ADD-S plus distance of centres, as
//! long as the centres are nearer than the true object's diameter. What is not matched counts as missed.
//!
//! # Limits
//! ICP finds the nearest minimum: a chair turned by 180 degrees may count as right where its form is nearly symmetric.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::truth::{RunSurfaces, TruthSurfaces};
use crate::metrics::icp::{IcpOptions, rigid_icp};
use crate::metrics::nearest::NearestIndex;
use crate::metrics::sample::{Seed, sample_surface};
use crate::metrics::soup::Triangle;

/// Sampled of an object.
const POINTS: usize = 2000;
/// ICP of a single object: rounds, tolerance in metres.
const ICP: IcpOptions = IcpOptions { max_iterations: 30, tolerance: 1e-6 };

/// A true object and what was found of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PieceScore {
    /// Name of the truth.
    pub truth: String,
    /// The true object.
    pub id: String,
    /// Its diameter, metres.
    pub diameter_m: f64,
    /// The run's object; `None` when it was missed.
    pub found: Option<String>,
    /// ADD-S, metres.
    pub add_s_m: Option<f64>,
    /// 3D IoU; 0 for what was missed.
    pub iou: f64,
    /// Rotation error, degrees.
    pub rotation_deg: Option<f64>,
}

impl PieceScore {
    /// Whether ADD-S is within a tenth of the diameter.
    pub fn within_tenth(&self) -> bool {
        self.add_s_m.is_some_and(|a| a < 0.1 * self.diameter_m)
    }
}

struct Sampled {
    points: Vec<DVec3>,
    centre: DVec3,
    diameter: f64,
}

fn points(soup: &[Triangle], draw: u32, seed: u64) -> Option<Sampled> {
    let points = sample_surface(soup, POINTS, Seed { seed, draw }).ok()?.points;
    let (low, high) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    Some(Sampled { centre: (low + high) / 2.0, diameter: (high - low).length(), points })
}

/// Scores every true object; nothing for a truth whose objects are not apart.
pub fn pieces(truth: &TruthSurfaces, run: &RunSurfaces, seed: u64) -> Vec<PieceScore> {
    if !truth.separate {
        return Vec::new();
    }
    let real: Vec<Option<Sampled>> =
        truth.pieces.iter().zip(0..).map(|(p, i)| points(&p.triangles, 2 * i, seed)).collect();
    let found: Vec<Option<Sampled>> = run
        .pieces
        .iter()
        .zip(0..)
        .map(|(p, i)| {
            let soup: Vec<Triangle> = p.triangles.iter().map(|t| t.map(|q| run.camera.to_camera(q))).collect();
            points(&soup, 2 * i + 1, seed)
        })
        .collect();
    let mut pairs: Vec<(f64, f64, usize, usize)> = Vec::new();
    for (t, own) in real.iter().enumerate() {
        let Some((own, index)) = own.as_ref().and_then(|o| Some((o, NearestIndex::build(&o.points).ok()?))) else {
            continue;
        };
        for (r, other) in found.iter().enumerate() {
            let Some(other) = other.as_ref().filter(|o| o.centre.distance(own.centre) < own.diameter) else { continue };
            let Ok(distances) = index.distances(&other.points) else { continue };
            let add_s = distances.iter().sum::<f64>() / distances.len() as f64;
            pairs.push((add_s + other.centre.distance(own.centre), add_s, t, r));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.2, a.3).cmp(&(b.2, b.3))));
    let mut of_truth: Vec<Option<(f64, usize)>> = vec![None; real.len()];
    let mut taken = vec![false; found.len()];
    for (_, add_s, t, r) in pairs {
        if of_truth[t].is_none() && !taken[r] {
            (of_truth[t], taken[r]) = (Some((add_s, r)), true);
        }
    }
    let upright = |p: &DVec3| run.camera.rotation.transpose() * *p;
    truth
        .pieces
        .iter()
        .enumerate()
        .filter_map(|(t, piece)| {
            let own = real[t].as_ref()?;
            let pair = of_truth[t].and_then(|(add_s, r)| Some((add_s, r, found[r].as_ref()?)));
            let iou = pair.map_or(0.0, |(_, _, other)| {
                let stand = |p: &Sampled| Upright::around(&p.points.iter().map(upright).collect::<Vec<_>>());
                stand(own).iou(&stand(other))
            });
            Some(PieceScore {
                truth: truth.name.clone(),
                id: piece.id.clone(),
                diameter_m: own.diameter,
                found: pair.map(|(_, r, _)| run.pieces[r].id.clone()),
                add_s_m: pair.map(|p| p.0),
                iou,
                rotation_deg: pair.and_then(|(_, _, other)| rotation(other, own)),
            })
        })
        .collect()
}

fn rotation(found: &Sampled, own: &Sampled) -> Option<f64> {
    let moved: Vec<DVec3> = found.points.iter().map(|p| *p - found.centre).collect();
    let target: Vec<DVec3> = own.points.iter().map(|p| *p - own.centre).collect();
    let r = rigid_icp(&moved, &target, &ICP).ok()?.target_from_source.rotation;
    let cos = ((r.x_axis.x + r.y_axis.y + r.z_axis.z - 1.0) / 2.0).clamp(-1.0, 1.0);
    Some(cos.acos().to_degrees())
}

/// A box that stands upright (+Y) on its least footprint.
struct Upright {
    /// Corners of the footprint (x, z), counter-clockwise.
    footprint: [DVec2; 4],
    low: f64,
    high: f64,
}

impl Upright {
    /// The rectangle of least area has a side along a side of the convex hull (H. Freeman, R. Shapira, 1975).
    fn around(points: &[DVec3]) -> Self {
        let flat: Vec<DVec2> = points.iter().map(|p| DVec2::new(p.x, p.z)).collect();
        let hull = hull(flat);
        let mut best = (f64::INFINITY, [DVec2::ZERO; 4]);
        for i in 0..hull.len() {
            let Some(u) = (hull[(i + 1) % hull.len()] - hull[i]).try_normalize() else { continue };
            let v = u.perp();
            let (low, high) = hull.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(l, h), p| {
                let q = DVec2::new(p.dot(u), p.dot(v));
                (l.min(q), h.max(q))
            });
            let area = (high.x - low.x) * (high.y - low.y);
            if area < best.0 {
                let at = |x: f64, y: f64| u * x + v * y;
                best = (area, [at(low.x, low.y), at(high.x, low.y), at(high.x, high.y), at(low.x, high.y)]);
            }
        }
        let heights = points.iter().map(|p| p.y);
        Self {
            footprint: best.1,
            low: heights.clone().fold(f64::INFINITY, f64::min),
            high: heights.fold(f64::NEG_INFINITY, f64::max),
        }
    }

    fn volume(&self) -> f64 {
        area(&self.footprint) * (self.high - self.low)
    }

    fn iou(&self, other: &Self) -> f64 {
        let mut polygon = self.footprint.to_vec();
        for i in 0..4 {
            polygon = cut(&polygon, other.footprint[i], other.footprint[(i + 1) % 4]);
        }
        let height = (self.high.min(other.high) - self.low.max(other.low)).max(0.0);
        let both = area(&polygon) * height;
        let all = self.volume() + other.volume() - both;
        if all > 0.0 { both / all } else { 0.0 }
    }
}

/// Area of a counter-clockwise polygon.
fn area(polygon: &[DVec2]) -> f64 {
    let n = polygon.len();
    (0..n).map(|i| polygon[i].perp_dot(polygon[(i + 1) % n])).sum::<f64>() / 2.0
}

/// The part of a polygon that lies left of a line.
fn cut(polygon: &[DVec2], from: DVec2, to: DVec2) -> Vec<DVec2> {
    let side = |p: DVec2| (to - from).perp_dot(p - from);
    let mut out = Vec::new();
    for i in 0..polygon.len() {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        let (sa, sb) = (side(a), side(b));
        if sa >= 0.0 {
            out.push(a);
        }
        if (sa >= 0.0) != (sb >= 0.0) {
            out.push(a + (b - a) * (sa / (sa - sb)));
        }
    }
    out
}

/// Convex hull, counter-clockwise (A. M. Andrew's monotone chain, 1979).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut out: Vec<DVec2> = Vec::new();
    for half in 0..2 {
        let begin = out.len();
        let pass: Vec<DVec2> = if half == 0 { points.clone() } else { points.iter().rev().copied().collect() };
        for p in pass {
            while out.len() >= begin + 2
                && (out[out.len() - 1] - out[out.len() - 2]).perp_dot(p - out[out.len() - 1]) <= 0.0
            {
                out.pop();
            }
            out.push(p);
        }
        out.pop();
    }
    out
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Camera, ImageSize, Intrinsics};

    use super::super::truth::{RunPiece, TruthPiece};
    use super::*;

    /// A slab with a block at one end: an L from the side, so that it has a front.
    fn sofa(at: DVec3, yaw: f64) -> Vec<Triangle> {
        let mut out = Vec::new();
        for (min, max) in [
            ([-1.0, 0.0, -0.4], [1.0, 0.4, 0.4]),
            ([-1.0, 0.4, -0.4], [1.0, 0.9, -0.2]),
            ([0.7, 0.4, -0.4], [1.0, 0.6, 0.4]),
        ] {
            let corner = |i: usize| DVec3::from_array([0, 1, 2].map(|k| if i >> k & 1 == 1 { max[k] } else { min[k] }));
            for f in [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]] {
                let turn = glam::DMat3::from_rotation_y(yaw);
                out.extend([[f[0], f[1], f[2]], [f[0], f[2], f[3]]].map(|t| t.map(|i| turn * corner(i) + at)));
            }
        }
        out
    }

    fn case(found: Vec<(DVec3, f64)>) -> Vec<PieceScore> {
        let size = ImageSize::new(100, 80);
        let lens = Intrinsics::from_horizontal_fov(size, 1.0);
        let camera = Camera::looking(size, lens, DVec3::new(2.0, 1.5, 6.0), DVec3::new(0.2, -0.3, -1.0));
        let real = [(DVec3::new(2.0, 0.0, 1.0), 0.4), (DVec3::new(2.5, 0.0, 3.5), -0.2)];
        let truth = TruthSurfaces {
            name: "t".into(),
            camera,
            pieces: real
                .iter()
                .enumerate()
                .map(|(i, (at, yaw))| TruthPiece {
                    id: format!("sofa_{i}"),
                    furniture: true,
                    triangles: sofa(*at, *yaw).iter().map(|t| t.map(|p| camera.to_camera(p))).collect(),
                    vertices: Vec::new(),
                })
                .collect(),
            whole_room: true,
            separate: true,
            photo: None,
            notes: Vec::new(),
        };
        let pieces = found
            .into_iter()
            .enumerate()
            .map(|(i, (at, yaw))| RunPiece { id: format!("found_{i}"), furniture: true, triangles: sofa(at, yaw) })
            .collect();
        super::pieces(&truth, &RunSurfaces { camera, pieces }, 1)
    }

    #[test]
    fn known_errors_are_measured() {
        // The second stands as it is, the first 0.3 m to the side (its own x) and turned by 6 degrees.
        let side = glam::DMat3::from_rotation_y(0.4) * DVec3::X * 0.3;
        let scores = case(vec![
            (DVec3::new(2.5, 0.0, 3.5), -0.2),
            (DVec3::new(2.0, 0.0, 1.0) + side, 0.4 + 6.0_f64.to_radians()),
        ]);
        let (first, second) = (&scores[0], &scores[1]);
        assert_eq!((first.found.as_deref(), second.found.as_deref()), (Some("found_1"), Some("found_0")));
        assert!(
            // What is left is the distance of the sampled points.
            second.add_s_m.unwrap() < 0.045 && second.within_tenth() && second.rotation_deg.unwrap() < 1.0,
            "{second:?}"
        );
        assert!(second.iou > 0.95, "{second:?}");
        assert!((first.rotation_deg.unwrap() - 6.0).abs() < 1.0, "{first:?}");
        // A shift of 0.3 of 2 m along the side alone leaves 1.7 / 2.3; the turn takes a bit more.
        assert!(first.iou < 1.7 / 2.3 && first.iou > 0.55, "{first:?}");
        // Its box is along the camera's axes: it holds two points as far apart as the sofa's own corners, and no side of it is
        // longer than that.
        let own = (2.0_f64.powi(2) + 0.8_f64.powi(2) + 0.9_f64.powi(2)).sqrt();
        assert!(first.diameter_m > 0.97 * own && first.diameter_m <= 3.0_f64.sqrt() * own, "{first:?}");
    }

    #[test]
    fn what_is_missed_is_missed() {
        let scores = case(vec![(DVec3::new(2.5, 0.0, 3.5), -0.2)]);
        assert_eq!(scores.iter().map(|s| s.found.is_some()).collect::<Vec<_>>(), [false, true]);
        assert_eq!((scores[0].iou, scores[0].add_s_m, scores[0].within_tenth()), (0.0, None, false));
    }

    #[test]
    fn boxes_overlap_as_they_do() {
        let cube = |x: f64, yaw: f64| {
            let turn = glam::DMat3::from_rotation_y(yaw);
            let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)) - 0.5;
            Upright::around(&(0..8).map(|i| turn * corner(i) + DVec3::X * x).collect::<Vec<_>>())
        };
        assert!((cube(0.0, 0.0).iou(&cube(0.5, 0.0)) - 1.0 / 3.0).abs() < 1e-9);
        assert!((cube(0.0, 0.3).iou(&cube(0.0, 0.3)) - 1.0).abs() < 1e-9);
        // Two unit squares turned by 45 degrees share a regular octagon of area 2 (sqrt 2 - 1).
        let octagon = 2.0 * (2.0_f64.sqrt() - 1.0);
        let turned = cube(0.0, 0.0).iou(&cube(0.0, std::f64::consts::FRAC_PI_4));
        assert!((turned - octagon / (2.0 - octagon)).abs() < 1e-9, "{turned}");
        assert_eq!(cube(0.0, 0.0).iou(&cube(3.0, 0.0)), 0.0);
    }
}
