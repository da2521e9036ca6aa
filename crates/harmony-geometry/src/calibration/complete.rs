//! The faces that the photo doesn't show.
//!
//! Measured faces stay where they are. The others come from the prior's size, but the box always holds the camera and
//! nearly all points; an unmeasured back wall is sought where points are densest near the expected place, for those
//! beyond it may be seen through a door. Coordinates along the Manhattan axes, unit of the map; the scale makes metres
//! of them. What is completed is a guess, and is not among the faces that count as seen.

use harmony_scene::{Mat3, Surface, Vec3};

use super::{Measured, hint};
use crate::LayoutPrior;
use crate::planes::AxisBox;
use crate::room_box::USUAL_CAMERA_HEIGHT;
use crate::stats::percentile_in_place;
use crate::surfels::Surfels;

/// Percent of the points left out at each end when "all points" are to be held.
const STRAY_PERCENT: f64 = 0.5;
/// Least distance of the camera from an unseen side wall and from the wall behind it, metres.
const SIDE_MARGIN: f64 = 0.2;
const FRONT_MARGIN: f64 = 0.3;

/// Relative error of the expected distance to the back wall.
const DISTANCE_ERROR: f64 = 0.2;
/// Largest share of the points that may lie beyond the back wall.
const THROUGH_DOORS: f64 = 0.1;
/// Least share of the points that makes a wall, and the thickness it may have, metres.
const WALL_SHARE: f64 = 0.01;
const WALL_SPREAD: f64 = 0.12;

/// Where the points are along the axes, strays left out; unit of the map.
pub(super) struct PointRange {
    pub low: Vec3,
    pub high: Vec3,
    /// All z, ascending.
    z: Vec<f64>,
}

/// Range of the points along the axes.
pub(super) fn point_range(surfels: &Surfels, r_align: Mat3) -> PointRange {
    let placed: Vec<Vec3> = surfels.cells.iter().map(|s| r_align * s.point).collect();
    let mut z: Vec<f64> = placed.iter().map(|p| p.z).collect();
    z.sort_by(f64::total_cmp);
    let mut range = PointRange { low: Vec3::ZERO, high: Vec3::ZERO, z };
    for axis in 0..3 {
        let mut values: Vec<f64> = placed.iter().map(|p| p[axis]).collect();
        range.low[axis] = percentile_in_place(&mut values, STRAY_PERCENT).unwrap_or(0.0);
        range.high[axis] = percentile_in_place(&mut values, 100.0 - STRAY_PERCENT).unwrap_or(0.0);
    }
    range
}

/// Completes the box: measured faces stay; the others come from the prior's size and hold camera and points.
///
/// All coordinates along the axes, unit of the map; `scale` makes them metres. The second value says what was done.
pub(super) fn complete(
    m: &Measured,
    prior: &LayoutPrior,
    scale: f64,
    camera: Vec3,
    range: &PointRange,
) -> (AxisBox, Vec<String>) {
    let mut notes = Vec::new();
    let metres = |v: f64| v / scale;
    let wanted = prior.extents.as_vec() / scale;

    let (left, right) = side(
        [m.offset(Surface::Left), m.offset(Surface::Right)],
        [range.low.x.min(camera.x - metres(SIDE_MARGIN)), range.high.x.max(camera.x + metres(SIDE_MARGIN))],
        wanted.x,
    );

    let far = hint(prior.camera.dist_to_back_m, 0.2, 40.0)
        .map_or(range.low.z, |d| far_wall(range, camera.z - metres(d), metres(d), metres(WALL_SPREAD)));
    let back = m.offset(Surface::Back).unwrap_or(far);
    let near = range.high.z.max(camera.z + metres(FRONT_MARGIN));
    let front = m.offset(Surface::Front).unwrap_or_else(|| near.max(back + wanted.z));

    let (floor, ceiling) = match (m.offset(Surface::Floor), m.offset(Surface::Ceiling)) {
        (Some(floor), Some(ceiling)) => (floor, ceiling),
        (Some(floor), None) => (floor, (floor + wanted.y).max(range.high.y).max(camera.y + metres(0.1))),
        (None, Some(ceiling)) => (range.low.y.min(ceiling - wanted.y), ceiling),
        (None, None) => {
            let height = hint(prior.camera.height_m, 0.1, 0.98 * prior.extents.height).unwrap_or(USUAL_CAMERA_HEIGHT);
            let floor = range.low.y.min(camera.y - metres(height));
            (floor, (floor + wanted.y).max(range.high.y).max(camera.y + metres(0.1)))
        }
    };
    for surface in [Surface::Floor, Surface::Ceiling, Surface::Back] {
        if m.offset(surface).is_none() {
            notes.push(format!("the {} is not seen: from the prior and the reach of the points", surface.name()));
        }
    }
    if m.offset(Surface::Left).is_none() && m.offset(Surface::Right).is_none() {
        notes.push("no side wall is seen: the prior's width around what is seen".to_owned());
    }
    (AxisBox { low: Vec3::new(left, floor, back), high: Vec3::new(right, ceiling, front) }, notes)
}

/// Where an unmeasured back wall is, given where it is expected at distance `away` from the camera.
///
/// Few points beyond it are seen through a door and do not count; then the wall is where the points are densest near
/// the expected place, in a slice of thickness `spread`. Otherwise the wall is behind all points.
fn far_wall(range: &PointRange, expected: f64, away: f64, spread: f64) -> f64 {
    let z = &range.z;
    let below = |limit: f64| z.partition_point(|v| *v < limit);
    let total = z.len().max(1) as f64;
    let [low, high] = [-1.0, 1.0].map(|sign| expected + sign * DISTANCE_ERROR * away);
    if below(low) as f64 > THROUGH_DOORS * total {
        return range.low.z.min(expected);
    }
    let densest =
        (below(low)..below(high)).map(|i| (below(z[i] + spread) - i, i)).max_by_key(|(n, i)| (*n, z.len() - i));
    match densest {
        Some((n, i)) if n as f64 >= WALL_SHARE * total => z[i..i + n].iter().sum::<f64>() / n as f64,
        _ => expected,
    }
}

/// Both ends of one axis. `hold` is what the box has to hold, `length` what the prior says.
fn side(measured: [Option<f64>; 2], hold: [f64; 2], length: f64) -> (f64, f64) {
    match measured {
        [Some(low), Some(high)] => (low, high),
        [Some(low), None] => (low, hold[1].max(low + length)),
        [None, Some(high)] => (hold[0].min(high - length), high),
        [None, None] => {
            let spare = (length - (hold[1] - hold[0])).max(0.0) / 2.0;
            (hold[0] - spare, hold[1] + spare)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of furniture in front (2 to 5), of a wall at 1 (10 cm thick), and some of a hallway behind it.
    fn range(hallway: usize) -> PointRange {
        let mut z: Vec<f64> = (0..1000).map(|i| 2.0 + 3.0 * f64::from(i) / 1000.0).collect();
        z.extend((0..100).map(|i| 0.95 + 0.1 * f64::from(i) / 100.0));
        z.extend((0..hallway).map(|i| -1.5 + 0.4 * i as f64 / hallway as f64));
        z.sort_by(f64::total_cmp);
        PointRange { low: Vec3::new(0.0, 0.0, z[0]), high: Vec3::ONE, z }
    }

    #[test]
    fn an_expected_back_wall_is_found_before_a_hallway() {
        // Expected at 0.7 from a camera at 6: the wall is at 1.
        assert!((far_wall(&range(60), 0.7, 5.3, WALL_SPREAD) - 1.0).abs() < 0.02);
        // Too much is behind it for a door: the room goes on.
        let deep = range(300);
        assert_eq!(far_wall(&deep, 0.7, 5.3, WALL_SPREAD), deep.low.z);
        // Nothing is where it is expected: the expectation stands.
        assert_eq!(far_wall(&range(0), -0.9, 6.9, WALL_SPREAD), -0.9);
    }
}
