//! Point maps from named arrays.

use std::collections::BTreeMap;

use glam::{DMat3, DVec2, DVec3, Vec3};
use harmony_scene::{ImageSize, Intrinsics, PointMap, PointMapKind};

use super::{DEFAULT_DEPTH_SCALE, PixelCentres, PointMapOptions, PointsError, fit, half_centred, plausible};
use crate::npz::Array;

/// Names under which estimators store their arrays, the first that is there is taken.
const POINTS: [&str; 7] =
    ["world_points", "points", "pts3d", "point_map", "xyz", "local_points", "world_points_from_depth"];
const DEPTH: [&str; 4] = ["depth", "depths", "depth_map", "depth_metric"];
const CONFIDENCE: [&str; 5] = ["confidence", "world_points_conf", "conf", "depth_conf", "mask"];
const INTRINSIC: [&str; 4] = ["intrinsic", "intrinsics", "K", "camera_matrix"];
/// `camera_from_world` [R | t].
const EXTRINSIC: [&str; 3] = ["extrinsic", "extrinsics", "camera_from_world"];
/// `world_from_camera` [R | t].
const POSE: [&str; 5] = ["pose", "poses", "camera_pose", "camera_poses", "world_from_camera"];

/// Whether an array is of interest.
pub(super) fn known(name: &str) -> bool {
    [&POINTS[..], &DEPTH, &CONFIDENCE, &INTRINSIC, &EXTRINSIC, &POSE, &["kind", "pixel_centre"]]
        .concat()
        .contains(&name)
}

/// The arrays of one frame.
struct Frames<'a> {
    arrays: &'a BTreeMap<String, Array>,
    frame: usize,
}

impl Frames<'_> {
    /// The first of the named arrays that is there, cut down to `rank` axes.
    fn get(&self, names: &[&str], rank: usize) -> Result<Option<(String, Array)>, PointsError> {
        let Some((name, array)) = names.iter().find_map(|n| self.arrays.get(*n).map(|a| (*n, a))) else {
            return Ok(None);
        };
        // A depth map may carry a last axis of length 1.
        let mut array = array.clone();
        if rank == 2 && array.shape.len() > 2 && array.shape.last() == Some(&1) {
            array.shape.pop();
        }
        let mut array = array.squeezed_to(rank);
        while array.shape.len() > rank {
            // Two leading axes (batch, frame) of which the first was 1 are one by now; more are not ours.
            let count = array.shape[0];
            if array.shape.len() > rank + 1 {
                return Err(PointsError::Shape {
                    name: name.to_owned(),
                    shape: array.shape,
                    expected: "one frame axis",
                });
            }
            array = array.part(self.frame).ok_or(PointsError::NoSuchFrame { frame: self.frame, count })?;
        }
        Ok(Some((name.to_owned(), array)))
    }
}

/// Builds the map on the file's own grid.
pub(super) fn from_arrays(
    arrays: &BTreeMap<String, Array>,
    options: &PointMapOptions,
) -> Result<PointMap, PointsError> {
    let frames = Frames { arrays, frame: options.frame };
    let ours = arrays.get("pixel_centre").and_then(|a| a.values.first()).is_some_and(|v| *v == 0.5);
    let centres = if ours { PixelCentres::Half } else { options.pixel_centres };
    let kind = arrays.get("kind").and_then(|a| a.text.as_deref()).and_then(|text| match text {
        "relative" => Some(PointMapKind::Relative),
        "metric" => Some(PointMapKind::Metric),
        "room_box" => Some(PointMapKind::RoomBox),
        _ => None,
    });
    let points = frames.get(&POINTS, 3)?;
    let depth = if points.is_some() { None } else { frames.get(&DEPTH, 2)? };
    let Some((name, grid)) = points.as_ref().or(depth.as_ref()) else {
        return Err(PointsError::NoPoints { names: arrays.keys().cloned().collect::<Vec<_>>().join(", ") });
    };
    let good = if points.is_some() { grid.shape.len() == 3 && grid.shape[2] == 3 } else { grid.shape.len() == 2 };
    if !good || grid.shape[0] < 4 || grid.shape[1] < 4 || grid.shape[..2].iter().any(|n| *n > 65_535) {
        let expected = if points.is_some() { "(H, W, 3)" } else { "(H, W)" };
        return Err(PointsError::Shape { name: name.clone(), shape: grid.shape.clone(), expected });
    }
    let size = ImageSize::new(grid.shape[1] as u32, grid.shape[0] as u32);
    let (rotation, translation) = match points {
        // `local_points` are in the camera's frame whatever poses stand beside them.
        Some((ref n, _)) if n == "local_points" => (DMat3::IDENTITY, DVec3::ZERO),
        _ => extrinsic(&frames)?,
    };
    let given = options
        .intrinsics
        .map(|k| fit::given_for_map(half_centred(k, options.pixel_centres), size, options))
        .transpose()?;
    let in_file = intrinsic(&frames, size)?.map(|k| half_centred(k, centres));
    let confidence = confidence(&frames, size)?;

    let mut map = if let Some((_, points)) = &points {
        let xyz: Vec<Vec3> = points.values.chunks_exact(3).map(|p| DVec3::new(p[0], p[1], p[2]).as_vec3()).collect();
        let k = match given.or(in_file) {
            Some(k) => plausible(k)?,
            None => fitted(&xyz, size, rotation, translation)?,
        };
        PointMap {
            kind: options.kind.or(kind).unwrap_or(PointMapKind::Relative),
            size,
            confidence: vec![1.0; xyz.len()],
            xyz,
            intrinsics: k,
            rotation,
            translation,
        }
    } else {
        let k = plausible(given.or(in_file).ok_or(PointsError::NoIntrinsics)?)?;
        let scale = options.depth_scale.unwrap_or(if grid.integer { DEFAULT_DEPTH_SCALE } else { 1.0 });
        let none = |z: f64| grid.integer && z == 65_535.0;
        let z: Vec<f32> = grid.values.iter().map(|z| if none(*z) { 0.0 } else { (z / scale) as f32 }).collect();
        let by_type = if grid.integer { PointMapKind::Metric } else { PointMapKind::Relative };
        let mut map = PointMap::from_depth(options.kind.or(kind).unwrap_or(by_type), size, k, &z);
        let back = rotation.transpose();
        for p in &mut map.xyz {
            *p = (back * (p.as_dvec3() - translation)).as_vec3();
        }
        PointMap { rotation, translation, ..map }
    };
    if let Some(confidence) = confidence {
        for (to, from) in map.confidence.iter_mut().zip(&confidence.values) {
            *to *= if from.is_finite() { from.max(0.0) as f32 } else { 0.0 };
        }
    }
    Ok(map)
}

fn confidence(frames: &Frames<'_>, size: ImageSize) -> Result<Option<Array>, PointsError> {
    let Some((name, array)) = frames.get(&CONFIDENCE, 2)? else { return Ok(None) };
    if array.values.len() != size.pixels() {
        return Err(PointsError::Shape { name, shape: array.shape, expected: "one value a pixel" });
    }
    Ok(Some(array))
}

fn intrinsic(frames: &Frames<'_>, size: ImageSize) -> Result<Option<Intrinsics>, PointsError> {
    let Some((name, array)) = frames.get(&INTRINSIC, 2)? else { return Ok(None) };
    if array.values.len() != 9 {
        return Err(PointsError::Shape { name, shape: array.shape, expected: "(3, 3)" });
    }
    let v = &array.values;
    let k = Intrinsics { fx: v[0], fy: v[4], cx: v[2], cy: v[5] };
    // MoGe and its like divide by the image size.
    let normalised = k.fx < 10.0 && k.fy < 10.0 && k.cx <= 1.0 && k.cy <= 1.0;
    let (w, h) = if normalised { (f64::from(size.width), f64::from(size.height)) } else { (1.0, 1.0) };
    Ok(Some(Intrinsics { fx: k.fx * w, fy: k.fy * h, cx: k.cx * w, cy: k.cy * h }))
}

/// `camera_from_points`.
fn extrinsic(frames: &Frames<'_>) -> Result<(DMat3, DVec3), PointsError> {
    let (found, inverse) = match frames.get(&EXTRINSIC, 2)? {
        Some(found) => (Some(found), false),
        None => (frames.get(&POSE, 2)?, true),
    };
    let Some((name, array)) = found else { return Ok((DMat3::IDENTITY, DVec3::ZERO)) };
    if !matches!(array.values.len(), 12 | 16) || array.shape.last() != Some(&4) {
        return Err(PointsError::Shape { name, shape: array.shape, expected: "(3, 4)" });
    }
    let v = &array.values;
    let row = |r: usize| DVec3::new(v[4 * r], v[4 * r + 1], v[4 * r + 2]);
    let rotation = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    let translation = DVec3::new(v[3], v[7], v[11]);
    let off = (rotation.transpose() * rotation - DMat3::IDENTITY).to_cols_array();
    let error = off.iter().map(|e| e.abs()).fold(0.0, |a: f64, b| if b.is_nan() { f64::INFINITY } else { a.max(b) });
    let proper = rotation.determinant() > 0.0;
    if !(error <= 0.02 && proper && translation.is_finite()) {
        return Err(PointsError::NotRigid { error: if proper { error } else { 2.0 } });
    }
    if inverse {
        let back = rotation.transpose();
        return Ok((back, -(back * translation)));
    }
    Ok((rotation, translation))
}

/// Intrinsics from the points themselves: `u = fx x/z + cx` and `v = fy y/z + cy`, by least squares, twice, the second
/// time without the tenth that fits worst.
fn fitted(xyz: &[Vec3], size: ImageSize, rotation: DMat3, translation: DVec3) -> Result<Intrinsics, PointsError> {
    let mut pairs: Vec<(DVec2, DVec2)> = Vec::new();
    for (i, p) in xyz.iter().enumerate() {
        let p = rotation * p.as_dvec3() + translation;
        if p.is_finite() && p.z > 1e-6 {
            let pixel = DVec2::new(f64::from(i as u32 % size.width) + 0.5, f64::from(i as u32 / size.width) + 0.5);
            pairs.push((DVec2::new(p.x / p.z, p.y / p.z), pixel));
        }
    }
    if pairs.len() < 16 {
        return Err(PointsError::TooFew { valid: pairs.len(), count: xyz.len() });
    }
    let line = |pairs: &[(DVec2, DVec2)], axis: usize| {
        let n = pairs.len() as f64;
        let (sx, sy) = pairs.iter().fold((0.0, 0.0), |(a, b), (p, q)| (a + p[axis], b + q[axis]));
        let (mx, my) = (sx / n, sy / n);
        let (xx, xy) = pairs.iter().fold((0.0, 0.0), |(a, b), (p, q)| {
            let d = p[axis] - mx;
            (a + d * d, b + d * (q[axis] - my))
        });
        let f = if xx > 0.0 { xy / xx } else { f64::NAN };
        (f, my - f * mx)
    };
    let solve = |pairs: &[(DVec2, DVec2)]| {
        let ((fx, cx), (fy, cy)) = (line(pairs, 0), line(pairs, 1));
        Intrinsics { fx, fy, cx, cy }
    };
    let error = |k: &Intrinsics, (p, q): &(DVec2, DVec2)| (k.fx * p.x + k.cx - q.x).hypot(k.fy * p.y + k.cy - q.y);
    let first = plausible(solve(&pairs))?;
    pairs.sort_by(|a, b| error(&first, a).total_cmp(&error(&first, b)));
    pairs.truncate((pairs.len() * 9 / 10).max(16));
    plausible(solve(&pairs))
}
