//! Objects of a run against those of the truth.

use glam::{DMat3, DVec3};
use harmony_mesh::{Bvh, Mesh};
use harmony_scene::{Level, Mask, Support};
use serde::{Deserialize, Serialize};

use super::prediction::{PredictedObject, Prediction};
use crate::truth::{FEWEST_PIXELS, TruthObject, TruthRoom};

/// Masks that share less are not one object.
const LEAST_IOU: f64 = 0.3;

/// A turned mesh that lies nearer to itself than this (share of its diagonal, in the mean) is the same.
const SAME: f64 = 0.012;

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
    /// Smallest turn that makes the yaw right, degrees; symmetries of the object count as right.
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
        let yaw = turn(t, o.object.pose.yaw - t.yaw);
        scores.push(ObjectScore {
            truth: Some(t.id.clone()),
            offset: offset.to_array(),
            position_m: offset.length(),
            yaw_deg: yaw.unwrap_or(0.0),
            has_front: t.level != Level::Wall && t.has_front() && yaw.is_some(),
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
fn matched(truth: &TruthRoom, run: &Prediction) -> Vec<Option<usize>> {
    let masks: Vec<Mask> = truth.objects.iter().map(|o| truth.mask(o.index)).collect();
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (i, o) in run.objects.iter().enumerate() {
        let Some(mask) = &o.mask else { continue };
        for (t, own) in masks.iter().enumerate() {
            let iou = if mask.size() == own.size() { mask.iou(own) } else { 0.0 };
            if iou >= LEAST_IOU {
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
fn place(level: Level, mesh: &Mesh, truth: Option<&TruthObject>) -> DVec3 {
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

/// Smallest turn between two yaws under the object's symmetries, degrees; `None` for what is round.
fn turn(t: &TruthObject, difference: f64) -> Option<f64> {
    let bvh = Bvh::new(&t.mesh);
    let diagonal = t.size.length().max(1e-6);
    let samples: Vec<DVec3> = crate::score::contact::surface_points(&t.mesh, 400, 5);
    let same = |deg: f64| {
        let turn = DMat3::from_rotation_y(deg.to_radians());
        let far = samples.iter().filter_map(|p| Some(bvh.closest_point(turn * *p)?.distance)).sum::<f64>();
        far / samples.len().max(1) as f64 <= SAME * diagonal
    };
    let wrapped = |deg: f64| {
        let d = deg.rem_euclid(360.0);
        d.min(360.0 - d)
    };
    let difference = difference.to_degrees();
    if same(45.0) && same(20.0) {
        return None;
    }
    let mut best = wrapped(difference);
    for symmetry in [90.0, 180.0, 270.0] {
        if same(symmetry) {
            best = best.min(wrapped(difference - symmetry));
        }
    }
    Some(best)
}
