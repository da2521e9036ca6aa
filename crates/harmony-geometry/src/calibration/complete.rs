//! The faces that the photo doesn't show.

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

/// Where the points are along the axes, strays left out; unit of the map.
pub(super) struct PointRange {
    pub low: Vec3,
    pub high: Vec3,
}

/// Range of the points along the axes.
pub(super) fn point_range(surfels: &Surfels, r_align: Mat3) -> PointRange {
    let mut range = PointRange { low: Vec3::ZERO, high: Vec3::ZERO };
    let placed: Vec<Vec3> = surfels.cells.iter().map(|s| r_align * s.point).collect();
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

    let far =
        hint(prior.camera.dist_to_back_m, 0.2, 40.0).map_or(range.low.z, |d| range.low.z.min(camera.z - metres(d)));
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
