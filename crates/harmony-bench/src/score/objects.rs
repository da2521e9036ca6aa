//! Objects of a run against those of the truth.

use glam::{DMat3, DVec3};
use harmony_mesh::{Bvh, Mesh};
use harmony_scene::{Level, Mask, Support};
use serde::{Deserialize, Serialize};

use super::prediction::{PredictedObject, Prediction};
use crate::truth::{FEWEST_PIXELS, TruthObject, TruthRoom};

/// Masks that share less are not one object.
const MIN_IOU: f64 = 0.3;

/// A turned mesh that lies nearer to itself than this (share of its diagonal, in the mean) is the same.
const SAME: f64 = 0.012;

/// Surface points by which turns are compared.
const SAMPLES: usize = 150;

/// One object of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectScore {
    /// Id in the run.
    pub id: String,
    /// Id in the truth; `None` for what is not there.
    pub truth: Option<String>,
    /// Level.
    pub level: Level,
    /// Found minus true centre of the object's box at its bottom (centre for wall objects), metres.
    pub offset: [f64; 3],
    /// Its length.
    pub position_m: f64,
    /// Turn of the geometry against the true one, degrees; symmetries of the object count as right.
    pub yaw_deg: f64,
    /// Whether it has a front that counts.
    pub has_front: bool,
    /// Mean relative error of its sides (the two large ones of a slab).
    pub size: f64,
    /// Size against the truth, signed, in the mean.
    pub size_bias: f64,
    /// IoU of what is visible of it in the run's render and in the truth.
    pub iou: f64,
    /// Whether what carries it is right.
    pub support_right: bool,
    /// For what stands on a host: error of its position relative to the host, metres.
    pub on_host_m: Option<f64>,
    /// The run's own confidence.
    pub confidence: f64,
    /// Share of the object that the photo hides or cuts.
    pub unseen: f64,
}

/// Scores of all objects of a run, and the truth's objects that it lacks.
pub fn compare(truth: &TruthRoom, run: &Prediction) -> (Vec<ObjectScore>, Vec<String>) {
    let matched = matched(truth, run);
    let (ids, _) = run.render();
    let host_of = |o: &PredictedObject| match &o.object.support {
        Support::Object { id } => run.objects.iter().position(|h| h.object.id == *id),
        _ => None,
    };
    let mut scores = Vec::new();
    for (i, o) in run.objects.iter().enumerate() {
        let blank = ObjectScore {
            id: o.object.id.to_string(),
            truth: None,
            level: o.object.level,
            offset: [0.0; 3],
            position_m: f64::NAN,
            yaw_deg: f64::NAN,
            has_front: false,
            size: f64::NAN,
            size_bias: f64::NAN,
            iou: 0.0,
            support_right: false,
            on_host_m: None,
            confidence: o.object.confidence.overall,
            unseen: 0.0,
        };
        let Some(t) = matched[i].map(|t| &truth.objects[t]) else {
            scores.push(blank);
            continue;
        };
        let offset = place(o.object.level, &o.mesh, None) - place(o.object.level, &t.mesh, Some(t));
        let host = host_of(o);
        let host_truth = host.and_then(|h| matched[h]).map(|h| truth.objects[h].id.as_str());
        let support_right = match (&t.support, &o.object.support) {
            (Support::Object { id }, Support::Object { .. }) => host_truth == Some(id.as_str()),
            // The run may have found niches in another order.
            (Support::Niche { .. }, Support::Niche { .. }) => true,
            (a, b) => a == b,
        };
        let on_host_m = host.filter(|_| support_right).and_then(|h| {
            let true_host = truth.find(host_truth?)?;
            let base = |mesh: &Mesh, t| place(Level::Furniture, mesh, t);
            Some((offset - (base(&run.objects[h].mesh, None) - base(&true_host.mesh, Some(true_host)))).length())
        });
        let sizes = sides(t, o);
        let mask = Mask::from_fn(run.camera.size, |x, y| {
            ids[y as usize * run.camera.size.width as usize + x as usize] == i as u32 + 1
        });
        let counts = t.level != Level::Wall && t.has_front();
        let yaw = if counts { turn(t, &o.mesh) } else { None };
        scores.push(ObjectScore {
            truth: Some(t.id.clone()),
            offset: offset.to_array(),
            position_m: offset.length(),
            yaw_deg: yaw.unwrap_or(0.0),
            has_front: yaw.is_some(),
            size: sizes.iter().map(|r| (r - 1.0).abs()).sum::<f64>() / sizes.len() as f64,
            size_bias: sizes.iter().sum::<f64>() / sizes.len() as f64 - 1.0,
            iou: mask.iou(&truth.mask(t.index)),
            support_right,
            on_host_m,
            unseen: 1.0 - (1.0 - t.occluded) * (1.0 - t.truncated),
            ..blank
        });
    }
    let found: Vec<usize> = matched.iter().flatten().copied().collect();
    let missed = truth
        .objects
        .iter()
        .enumerate()
        .filter(|(i, o)| o.visible_pixels >= FEWEST_PIXELS && !found.contains(i))
        .map(|(_, o)| o.id.clone())
        .collect();
    (scores, missed)
}

/// Which truth each object of the run is: by the overlap of masks, best pairs first, one to one.
pub(crate) fn matched(truth: &TruthRoom, run: &Prediction) -> Vec<Option<usize>> {
    let masks: Vec<Mask> = truth.objects.iter().map(|o| truth.mask(o.index)).collect();
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (i, o) in run.objects.iter().enumerate() {
        let Some(mask) = &o.mask else { continue };
        for (t, own) in masks.iter().enumerate() {
            let iou = if mask.size() == own.size() { mask.iou(own) } else { 0.0 };
            if iou >= MIN_IOU {
                pairs.push((iou, i, t));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut out = vec![None; run.objects.len()];
    for (_, i, t) in pairs {
        if out[i].is_none() && !out.contains(&Some(t)) {
            out[i] = Some(t);
        }
    }
    out
}

/// Centre of a mesh's box in the room: at its bottom, for wall objects in its middle.
pub(crate) fn place(level: Level, mesh: &Mesh, truth: Option<&TruthObject>) -> DVec3 {
    let points = mesh.positions.iter().map(|p| {
        let p = p.as_dvec3();
        truth.map_or(p, |t| t.point(p))
    });
    let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
    for p in points {
        (low, high) = (low.min(p), high.max(p));
    }
    let centre = (low + high) / 2.0;
    if level == Level::Wall { centre } else { DVec3::new(centre.x, low.y, centre.z) }
}

/// Found to true size of the sides that count.
fn sides(t: &TruthObject, o: &PredictedObject) -> Vec<f64> {
    // Sides along the run's own axes of the object.
    let back = DMat3::from_rotation_y(-o.object.pose.yaw);
    let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
    for p in &o.mesh.positions {
        let p = back * p.as_dvec3();
        (low, high) = (low.min(p), high.max(p));
    }
    let ratio = (high - low) / t.size.max(DVec3::splat(1e-4));
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| t.size[*b].total_cmp(&t.size[*a]));
    let flat = t.size.min_element() < 0.08 * t.size.max_element();
    order.into_iter().take(if flat { 2 } else { 3 }).map(|i| ratio[i]).collect()
}

/// Turn about the vertical that brings the run's mesh best onto the true one, degrees; `None` for what is round.
///
/// Both are centred and brought to one size first. It is the geometry that is judged: a generated mesh whose front was
/// named wrongly, but which stands as in the photo, is right. Among turns that fit nearly as well as the best (the
/// object's symmetries) the smallest counts.
pub(super) fn turn(t: &TruthObject, found: &Mesh) -> Option<f64> {
    let true_mesh = {
        let mut m = (*t.mesh).clone();
        m.map(|p| t.point(p.as_dvec3()).as_vec3(), |n| n);
        m
    };
    let unit = |mesh: &Mesh| {
        let b = mesh.bounds()?;
        let base = DVec3::new(b.centre().x, b.min.y, b.centre().z);
        let size = b.size().y.max(1e-3).max(0.1 * b.size().length());
        let mut out = mesh.clone();
        out.map(|p| ((p.as_dvec3() - base) / size).as_vec3(), |n| n);
        Some(out)
    };
    let (a, b) = (unit(found)?, unit(&true_mesh)?);
    let (tree_a, tree_b) = (Bvh::new(&a), Bvh::new(&b));
    let points_a = super::contact::surface_points(&a, SAMPLES, 5);
    let points_b = super::contact::surface_points(&b, SAMPLES, 6);
    let far = |deg: f64| {
        let turn = DMat3::from_rotation_y(deg.to_radians());
        let one: f64 = points_a.iter().filter_map(|p| Some(tree_b.closest_point(turn * *p)?.distance)).sum();
        let other: f64 =
            points_b.iter().filter_map(|p| Some(tree_a.closest_point(turn.transpose() * *p)?.distance)).sum();
        (one + other) / (2 * SAMPLES) as f64
    };
    let steps: Vec<(f64, f64)> = (0..72).map(|k| (5.0 * f64::from(k), far(5.0 * f64::from(k)))).collect();
    let best = steps.iter().map(|s| s.1).fold(f64::INFINITY, f64::min);
    let worst = steps.iter().map(|s| s.1).fold(0.0, f64::max);
    let diagonal = b.bounds()?.size().length();
    if worst - best < SAME * diagonal {
        return None;
    }
    let wrapped = |deg: f64| {
        let d = deg.rem_euclid(360.0);
        d.min(360.0 - d)
    };
    let mut turns: Vec<f64> = Vec::new();
    for (k, (deg, off)) in steps.iter().enumerate() {
        let neighbours = [steps[(k + 71) % 72].1, steps[(k + 1) % 72].1];
        if neighbours.iter().all(|n| off <= n) && *off <= best + 0.25 * SAME * diagonal + 0.1 * best {
            let fine = (-4..=4).map(|i| deg + f64::from(i)).min_by(|a, b| far(*a).total_cmp(&far(*b)));
            turns.push(wrapped(fine.unwrap_or(*deg)));
        }
    }
    turns.into_iter().min_by(f64::total_cmp)
}
