//! The six bounding planes along the Manhattan axes (`HistogramFit`, percentile extension, `BoxCorners`).
//!
//! Departures from Algorithm 1, each because our normals are oriented and our planes are judged:
//! * a face takes only the points that face into the room from its side (`normal . inward > tau`), not `|normal . a|`;
//! * the percentile of a noisy plane lies two sigmas outside it, so it says how far outward to look, and the plane is
//!   then set on the outermost density peak it reaches; only without such a peak it is the percentile itself;
//! * a face that hardly a point lies on, or that many points lie beyond, is "not seen";
//! * a plane that is seen only through a hole of a stronger one (the next room's wall through a passage) is not the wall.

use std::collections::HashMap;

use harmony_scene::{Mat3, Surface, Vec3};

use crate::CalibrationSettings;
use crate::manhattan::{ManhattanAxes, biweight, nearest_rotation};
use crate::stats::percentile_in_place;
use crate::surfels::{Surfel, Surfels};

/// Histogram bin, share of the median depth.
const BIN: f64 = 0.008;
/// Half width of a density peak, bins.
const PEAK_BINS: f64 = 3.0;
/// A peak counts when it has this share of the largest one's weight (walls; floor and ceiling: tables and beds hide
/// most of a floor) ...
const PEAK_OF_LARGEST: [f64; 2] = [0.12, 0.06];
/// ... and this share of the weight of all points.
const PEAK_OF_ALL: f64 = 0.004;
/// A stronger peak at most this far inside (share of median depth) is the plane: panes lie behind their wall.
const PANE_DEPTH: f64 = 0.05;
/// A measured face holds at least this share of all points ...
const MIN_SHARE: f64 = 0.008;
/// ... and at most this share of all points lies beyond it ...
const MAX_BEYOND: f64 = 0.06;
/// ... unless it holds this many times as many (open doors, windows, mirrors).
const BEYOND_FACTOR: f64 = 2.0;
/// A wall with more than this times its own weight on other faces behind it is furniture.
const MAX_BEHIND: f64 = 0.35;
/// Slack for "beyond", share of the median depth.
const BEYOND_SLACK: f64 = 0.035;
/// A plane of whose points this share has a nearer plane to the left, to the right and above is seen through its hole.
const FRAMED: f64 = 0.9;
/// Inliers of a face are at most this far off in angle.
const INLIER_COS: f64 = 0.85;

/// One face of the box in the `points` frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacePlane {
    /// Which face.
    pub surface: Surface,
    /// Coordinate along the face's axis, unit of the map.
    pub offset: f64,
    /// The largest density peak (`HistogramFit`).
    pub coarse: f64,
    /// The percentile (`extend`).
    pub extended: f64,
    /// Inliers (surfels).
    pub inliers: usize,
    /// RMS distance of the inliers.
    pub rms: f64,
    /// Share of the weight of all points on it.
    pub share: f64,
    /// Share of the weight of all points beyond it.
    pub beyond: f64,
    /// Share of the weight of all points on other faces beyond it (side and back walls).
    pub behind: f64,
    /// Whether it is a face of the room.
    pub measured: bool,
}

/// Index of a face's axis (0 width, 1 vertical, 2 depth) and the sign of its inward normal.
pub fn axis_of(surface: Surface) -> (usize, f64) {
    match surface {
        Surface::Left => (0, 1.0),
        Surface::Right => (0, -1.0),
        Surface::Floor => (1, 1.0),
        Surface::Ceiling => (1, -1.0),
        Surface::Back => (2, 1.0),
        Surface::Front => (2, -1.0),
    }
}

/// Fits the faces that can be seen (keys `cam.histogram`, `cam.extend`); in the order of [`Surface::ALL`].
///
/// `axes` are oriented; a face without a single facing point is `None`.
pub fn fit_faces(surfels: &Surfels, axes: &ManhattanAxes, settings: &CalibrationSettings) -> [Option<FacePlane>; 6] {
    let all: f64 = surfels.cells.iter().map(|s| s.weight).sum();
    let mut faces = Surface::ALL.map(|surface| fit_face(surfels, axes, settings, surface, all));
    vet_side_walls(surfels, axes, &mut faces);
    faces
}

/// The flank of a cupboard looks like a wall until the back wall, the floor or the ceiling goes on behind it.
///
/// A side wall stays measured only if the weight of other faces' points beyond it is small against its own.
fn vet_side_walls(surfels: &Surfels, axes: &ManhattanAxes, faces: &mut [Option<FacePlane>; 6]) {
    let slack = BEYOND_SLACK * surfels.median_depth;
    let on_face = |s: &Surfel, face: &FacePlane| {
        let (index, sign) = axis_of(face.surface);
        let axis = [axes.width, axes.vertical, axes.depth][index];
        s.normal.dot(axis) * sign > INLIER_COS && (axis.dot(s.point) - face.offset).abs() < 0.5 * slack
    };
    let all: f64 = surfels.cells.iter().map(|s| s.weight).sum();
    for side in [Surface::Left, Surface::Right, Surface::Back] {
        let others: Vec<FacePlane> =
            faces.iter().flatten().filter(|f| f.measured && axis_of(f.surface).0 != axis_of(side).0).copied().collect();
        let Some(face) = faces.iter_mut().flatten().find(|f| f.surface == side && f.measured) else { continue };
        let (index, sign) = axis_of(side);
        let axis = [axes.width, axes.vertical, axes.depth][index];
        let beyond: f64 = surfels
            .oriented()
            .filter(|s| (axis.dot(s.point) - face.offset) * sign < -slack && others.iter().any(|o| on_face(s, o)))
            .map(|s| s.weight)
            .sum();
        face.behind = beyond / all;
        face.measured = face.behind <= MAX_BEHIND * face.share;
    }
}

fn fit_face(
    surfels: &Surfels,
    axes: &ManhattanAxes,
    settings: &CalibrationSettings,
    surface: Surface,
    all: f64,
) -> Option<FacePlane> {
    let (index, sign) = axis_of(surface);
    let inward = [axes.width, axes.vertical, axes.depth][index] * sign;
    // Outward coordinate: the room's inside is on the smaller side, for every face.
    let outward = |s: &Surfel| -inward.dot(s.point);
    let facing: Vec<&Surfel> =
        surfels.oriented().filter(|s| s.normal.dot(inward) > settings.normal_threshold).collect();
    if facing.len() < 12 {
        return None;
    }
    let values: Vec<(f64, f64)> = facing.iter().map(|s| (outward(s), s.weight)).collect();
    let bin = BIN * surfels.median_depth;
    let peaks = density_peaks(&values, bin);
    let largest = peaks.iter().copied().max_by(|a, b| a.weight.total_cmp(&b.weight))?;

    let band = settings.row_band;
    let (p, in_band): (f64, fn(f64, f64) -> bool) = match surface {
        Surface::Floor => (settings.floor_ceiling_percentile, |row, band| row >= 1.0 - band),
        Surface::Ceiling => (settings.floor_ceiling_percentile, |row, band| row <= band),
        _ => (settings.wall_percentile, |_, _| true),
    };
    let mut banded: Vec<f64> = facing.iter().filter(|s| in_band(s.row, band)).map(|s| outward(s)).collect();
    let extended = percentile_in_place(&mut banded, p).unwrap_or(largest.at).max(largest.at);
    // The band may hold no floor at all (a bed fills it): the whole image may reach farther.
    let mut whole: Vec<f64> = facing.iter().map(|s| outward(s)).collect();
    let reach = percentile_in_place(&mut whole, p).unwrap_or(extended).max(extended);

    let counts = |peak: &&Peak| {
        peak.weight >= PEAK_OF_LARGEST[usize::from(index == 1)] * largest.weight
            && peak.weight >= PEAK_OF_ALL * all
            && peak.at <= reach + PEAK_BINS * bin
    };
    let outermost = peaks.iter().filter(counts).max_by(|a, b| a.at.total_cmp(&b.at));
    let start = match outermost {
        Some(outer) => {
            let pane = PANE_DEPTH * surfels.median_depth;
            let outer = if index == 1 { outer } else { nearer_if_framed(outer, &peaks, &facing, (inward, bin)) };
            peaks
                .iter()
                .filter(|k| k.at <= outer.at && outer.at - k.at <= pane)
                .max_by(|a, b| a.weight.total_cmp(&b.weight))
                .map_or(outer.at, |k| k.at)
        }
        None => extended,
    };

    let (offset, inliers, rms, weight) = settle(&facing, inward, start, PEAK_BINS * bin);
    let slack = BEYOND_SLACK * surfels.median_depth;
    let beyond: f64 = surfels.cells.iter().filter(|s| outward(s) > offset + slack).map(|s| s.weight).sum();
    let (share, beyond) = (weight / all, beyond / all);
    let measured = inliers >= 12 && share >= MIN_SHARE && (beyond <= MAX_BEYOND || share >= BEYOND_FACTOR * beyond);
    let at = |u: f64| -u * sign;
    Some(FacePlane {
        surface,
        offset: at(offset),
        coarse: at(largest.at),
        extended: at(extended),
        inliers,
        rms,
        share,
        beyond,
        behind: 0.0,
        measured,
    })
}

/// The strongest peak in front of a wall's outermost one through whose hole that one is seen, else that one.
///
/// Furniture before a wall leaves it open to one side or above; the wall around a passage does not.
fn nearer_if_framed<'a>(
    outer: &'a Peak,
    peaks: &'a [Peak],
    facing: &[&Surfel],
    (inward, bin): (Vec3, f64),
) -> &'a Peak {
    let on = |peak: &Peak| -> Vec<&Surfel> {
        let near = |s: &&&Surfel| {
            s.normal.dot(inward) > INLIER_COS && (-inward.dot(s.point) - peak.at).abs() <= PEAK_BINS * bin
        };
        facing.iter().filter(near).copied().collect()
    };
    let behind = on(outer);
    let nearer = peaks.iter().filter(|k| k.at < outer.at - PEAK_BINS * bin && k.weight > outer.weight);
    nearer.filter(|k| framed(&behind, &on(k)) >= FRAMED).max_by(|a, b| a.weight.total_cmp(&b.weight)).unwrap_or(outer)
}

/// Share of the weight of `inside` that has some of `frame` to its left and right in its row, and above in its column.
fn framed(inside: &[&Surfel], frame: &[&Surfel]) -> f64 {
    // Rows and columns are those of the grid of cells: equal to the bit.
    let mut rows: HashMap<u64, [f64; 2]> = HashMap::new();
    let mut columns: HashMap<u64, f64> = HashMap::new();
    for s in frame {
        let [low, high] = rows.entry(s.row.to_bits()).or_insert([f64::INFINITY, f64::NEG_INFINITY]);
        (*low, *high) = (low.min(s.column), high.max(s.column));
        let top = columns.entry(s.column.to_bits()).or_insert(f64::INFINITY);
        *top = top.min(s.row);
    }
    let within = |s: &&&Surfel| {
        rows.get(&s.row.to_bits()).is_some_and(|[low, high]| *low < s.column && s.column < *high)
            && columns.get(&s.column.to_bits()).is_some_and(|top| *top < s.row)
    };
    let weight = |s: &&Surfel| s.weight;
    let all: f64 = inside.iter().map(weight).sum();
    inside.iter().filter(within).map(weight).sum::<f64>() / all.max(f64::MIN_POSITIVE)
}

/// Weighted mean of the points near `start` under a biweight: offset, count, RMS, weight.
fn settle(facing: &[&Surfel], inward: Vec3, start: f64, band: f64) -> (f64, usize, f64, f64) {
    let mut offset = start;
    let (mut count, mut rms, mut on) = (0, 0.0, 0.0);
    for _ in 0..8 {
        let (mut sum, mut total, mut squares) = (0.0, 0.0, 0.0);
        (count, on) = (0, 0.0);
        for s in facing.iter().filter(|s| s.normal.dot(inward) > INLIER_COS) {
            let off = -inward.dot(s.point) - offset;
            let w = s.weight * biweight(off / band);
            if w > 0.0 {
                sum += w * off;
                squares += w * off * off;
                total += w;
                count += 1;
                on += s.weight;
            }
        }
        if total <= 0.0 {
            break;
        }
        rms = (squares / total).sqrt();
        offset += sum / total;
        if (sum / total).abs() < 1e-6 * band {
            break;
        }
    }
    (offset, count, rms, on)
}

/// Smoothing of the histogram, ninths.
const KERNEL: [f64; 5] = [1.0, 2.0, 3.0, 2.0, 1.0];

#[derive(Debug, Clone, Copy)]
struct Peak {
    at: f64,
    weight: f64,
}

/// Local maxima of the smoothed weight histogram, with the weight within [`PEAK_BINS`] of each.
fn density_peaks(values: &[(f64, f64)], bin: f64) -> Vec<Peak> {
    let low = values.iter().fold(f64::INFINITY, |m, v| m.min(v.0));
    let high = values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(v.0));
    // More than 4000 bins means stray points at infinity; wider bins then do.
    let bin = bin.max((high - low) / 4000.0).max(f64::MIN_POSITIVE);
    let pad = 3usize;
    let bins = ((high - low) / bin) as usize + 1 + 2 * pad;
    let mut histogram = vec![0.0; bins];
    for (v, w) in values {
        // Shared between the two nearest bins, so that a plane on a border isn't torn.
        let x = (v - low) / bin - 0.5 + pad as f64;
        let i = x.floor().max(0.0) as usize;
        let f = x - x.floor();
        histogram[i.min(bins - 1)] += w * (1.0 - f);
        histogram[(i + 1).min(bins - 1)] += w * f;
    }
    let smooth: Vec<f64> = (0..bins)
        .map(|i| {
            let at = |k: usize| (i + k).checked_sub(2).and_then(|j| histogram.get(j)).copied().unwrap_or(0.0);
            KERNEL.iter().enumerate().map(|(k, w)| w * at(k)).sum::<f64>() / 9.0
        })
        .collect();
    let reach = PEAK_BINS as usize;
    (0..bins)
        .filter(|&i| {
            let (from, to) = (i.saturating_sub(2), (i + 3).min(bins));
            smooth[i] > 0.0 && (from..to).all(|j| smooth[j] < smooth[i] || (smooth[j] == smooth[i] && j >= i))
        })
        .map(|i| Peak {
            at: low + (i as f64 + 0.5 - pad as f64) * bin,
            weight: histogram[i.saturating_sub(reach)..(i + reach + 1).min(bins)].iter().sum(),
        })
        .collect()
}

/// Turns the axes so that the points of the measured faces lie flattest (beyond the paper).
///
/// Normals come from neighbouring cells, so smooth errors of the depth bend them; the planes span the whole room
/// and don't. Minimises the summed squared distance to all measured planes over one rotation; the offsets follow.
pub fn polish_axes(surfels: &Surfels, axes: &ManhattanAxes, faces: &[Option<FacePlane>; 6]) -> ManhattanAxes {
    let mut axes = *axes;
    for _ in 0..4 {
        let columns = [axes.width, axes.vertical, axes.depth];
        let mut normal = nalgebra::Matrix3::<f64>::zeros();
        let mut right = nalgebra::Vector3::<f64>::zeros();
        let mut heaviest = 0.0f64;
        for face in faces.iter().flatten().filter(|f| f.measured) {
            let (index, sign) = axis_of(face.surface);
            let axis = columns[index];
            let band = (4.0 * face.rms).max(2.0 * BIN * surfels.median_depth);
            let on: Vec<(&Surfel, f64)> = surfels
                .oriented()
                .filter(|s| s.normal.dot(axis) * sign > INLIER_COS)
                .map(|s| (s, s.weight * biweight((axis.dot(s.point) - face.offset) / band)))
                .filter(|(_, w)| *w > 0.0)
                .collect();
            let total: f64 = on.iter().map(|(_, w)| w).sum();
            if on.len() < 30 {
                continue;
            }
            let centre = on.iter().map(|(s, w)| s.point * *w).sum::<Vec3>() / total;
            for (s, w) in &on {
                let d = s.point - centre;
                // a . d with a turned by omega: (a + omega x a) . d = a . d + omega . (a x d).
                let j = axis.cross(d);
                let j = nalgebra::Vector3::new(j.x, j.y, j.z);
                normal += j * j.transpose() * *w;
                right -= j * (axis.dot(d) * *w);
            }
            heaviest = heaviest.max(normal.trace());
        }
        if heaviest <= 0.0 {
            return axes;
        }
        // A direction that no plane holds (one wall: the turn about its normal) stays as it is.
        let damped = normal + nalgebra::Matrix3::identity() * (1e-3 * heaviest);
        let Some(turn) = damped.lu().solve(&right) else { return axes };
        let omega = Vec3::new(turn[0], turn[1], turn[2]);
        // The normals are known to a few degrees; a larger turn means that the planes were wrong.
        if omega.is_nan() || omega.length() > 5f64.to_radians() {
            return axes;
        }
        let rotation = Mat3::from_quat(glam::DQuat::from_scaled_axis(omega));
        let frame = Mat3::from_cols(rotation * columns[0], rotation * columns[1], rotation * columns[2]);
        let frame = nearest_rotation(frame, frame).unwrap_or(frame);
        axes = ManhattanAxes { width: frame.x_axis, vertical: frame.y_axis, depth: frame.z_axis };
        if omega.length() < 1e-6 {
            break;
        }
    }
    axes
}

/// The box of the six planes: low and high coordinate along width, vertical and depth axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisBox {
    /// Left, floor, back.
    pub low: Vec3,
    /// Right, ceiling, front.
    pub high: Vec3,
}

impl AxisBox {
    /// The four floor corners (`BoxCorners`), axis coordinates: back left, back right, front left, front right.
    pub fn floor_corners(&self) -> [Vec3; 4] {
        let (l, h) = (self.low, self.high);
        [l, Vec3::new(h.x, l.y, l.z), Vec3::new(l.x, l.y, h.z), Vec3::new(h.x, l.y, h.z)]
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::{ImageSize, Intrinsics, PointMap, PointMapKind};

    use super::*;

    /// Where the back wall is found, metres before the camera, in a room 4 m wide whose back wall at 4 m is cut by what
    /// `open` says, with another room's wall at 5.6 m behind it.
    fn back_wall(open: impl Fn(f64, f64) -> bool) -> f64 {
        let size = ImageSize::new(288, 216);
        let intrinsics = Intrinsics { fx: 180.0, fy: 180.0, cx: 144.0, cy: 108.0 };
        let depth: Vec<f32> = (0..size.pixels())
            .map(|i| {
                let pixel =
                    glam::DVec2::new(f64::from(i as u32 % size.width) + 0.5, f64::from(i as u32 / size.width) + 0.5);
                let ray = intrinsics.direction(pixel);
                let floor_or_ceiling = if ray.y > 0.0 { 1.3 / ray.y } else { -1.2 / ray.y };
                let own = (2.0 / ray.x.abs()).min(floor_or_ceiling).min(4.0);
                let through = own == 4.0 && open(4.0 * ray.x, -4.0 * ray.y);
                (if through { floor_or_ceiling.min(5.6) } else { own }) as f32
            })
            .collect();
        let map = PointMap::from_depth(PointMapKind::Metric, size, intrinsics, &depth);
        let axes = ManhattanAxes { width: Vec3::X, vertical: -Vec3::Y, depth: -Vec3::Z };
        let faces = fit_faces(&crate::surfels::surfels(&map), &axes, &CalibrationSettings::default());
        let back = faces.into_iter().flatten().find(|f| f.surface == Surface::Back).unwrap();
        assert!(back.measured);
        -back.offset
    }

    #[test]
    fn the_wall_of_another_room_seen_through_a_passage_is_not_the_back_wall() {
        let found = back_wall(|x, y| (-0.5..0.8).contains(&x) && y < 0.8);
        assert!((found - 4.0).abs() < 0.02, "{found}");
    }

    #[test]
    fn a_wall_beside_what_stands_before_it_is_the_back_wall() {
        // A block or a row of cupboards up to the ceiling takes three fifths of the wall, and leaves one side open.
        let found = back_wall(|x, _| x > 0.4);
        assert!((found - 5.6).abs() < 0.02, "{found}");
    }
}
