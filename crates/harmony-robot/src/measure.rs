//! What hands and seats need to know, measured on the reconstructed triangles.
//!
//! # Sections
//! A jaw that comes from above closes along a horizontal direction. What it straddles is the extent of the mesh along that
//! direction inside a window: as wide as the finger pads, as high as the pads (the **thickness** that is gripped), or from
//! the finger tips up to the top of the thing (the **straddle** that must pass between the open fingers, whose middle is over
//! that of what is gripped). Triangles are cut
//! by the window, so that extents are exact.
//!
//! # Seats
//! Rays from above on a grid. The seat is the level that most cells between [`SEAT_M`] have; the backrest is what rises
//! above it, on the side where there is more of it. Nothing is taken from the object's pose but its axes.

use glam::{DVec2, DVec3};
use serde::Serialize;

use crate::room::Thing;

/// Side of a cell of rays, metres.
pub const CELL_M: f64 = 0.02;
/// Between these heights one can sit, metres.
pub const SEAT_M: [f64; 2] = [0.30, 0.60];
/// Cells of a seat are this near to its height, metres.
const LEVEL_M: f64 = 0.04;
/// A backrest is higher than its seat by this, metres.
const BACK_M: f64 = 0.15;
/// Least area of a seat, m2.
const SEAT_M2: f64 = 0.06;
/// Heights of a profile, metres apart.
const STEP_M: f64 = 0.005;
/// Free way between a finger and what it passes, metres.
pub const PASS_M: f64 = 0.002;

/// A jaw that closes in parallel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct JawSize {
    /// Between the open fingers, metres.
    pub opening_m: f64,
    /// From the middle of the pads to the tips, metres.
    pub tip_m: f64,
    /// From the middle of the pads to the palm, metres.
    pub palm_m: f64,
    /// Half the height of the pads, metres.
    pub pad_half_height_m: f64,
    /// Half the width of the pads, metres.
    pub pad_half_width_m: f64,
}

/// The cross-section at a height.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Section {
    /// Of the middle of the pads, metres above the floor.
    pub height_m: f64,
    /// Extent between the pads, metres.
    pub thickness_m: f64,
    /// How far the fingers must be open to pass what is between their tips and the top of the thing, the middle of the
    /// pads over the middle of what they grip, metres.
    pub straddle_m: f64,
    /// Middle of what is gripped along the closing direction, from the window's origin, metres.
    pub middle_m: f64,
}

/// A place where a jaw can hold.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Grasp {
    /// Middle between the pads, room.
    pub centre: DVec3,
    /// Unit, horizontal: the fingers close along it.
    pub closing: DVec3,
    /// The section that was chosen.
    pub section: Section,
    /// Top of the thing at this place, metres.
    pub top_m: f64,
    /// All sections that were looked at, from the top down.
    pub profile: Vec<Section>,
    /// Why this height, with numbers.
    pub because: String,
}

/// Where one looks: along which direction, and how wide.
#[derive(Debug, Clone, Copy)]
pub struct Window {
    /// A point of the floor plan, room.
    pub origin: DVec3,
    /// Unit, horizontal.
    pub along: DVec3,
    /// Unit, horizontal, across.
    pub across: DVec3,
    /// Half width across; infinite for all.
    pub half_width: f64,
    /// What lies before this along the direction is not looked at.
    pub from: f64,
}

impl Window {
    /// Extent along the direction of what is between two heights.
    pub fn extent(&self, thing: &Thing, heights: [f64; 2]) -> Option<[f64; 2]> {
        let mut out = [f64::INFINITY, f64::NEG_INFINITY];
        for t in &thing.triangles {
            // In (along, height, across).
            let local = t.map(|p| {
                let d = p - self.origin;
                DVec3::new(d.dot(self.along), p.y, d.dot(self.across))
            });
            if local.iter().all(|p| p.y < heights[0])
                || local.iter().all(|p| p.y > heights[1])
                || local.iter().all(|p| p.z < -self.half_width)
                || local.iter().all(|p| p.z > self.half_width)
            {
                continue;
            }
            let mut polygon = local.to_vec();
            clip(&mut polygon, |p| p.y - heights[0]);
            clip(&mut polygon, |p| heights[1] - p.y);
            if self.half_width.is_finite() {
                clip(&mut polygon, |p| p.z + self.half_width);
                clip(&mut polygon, |p| self.half_width - p.z);
            }
            clip(&mut polygon, |p| p.x - self.from);
            for p in polygon {
                out = [out[0].min(p.x), out[1].max(p.x)];
            }
        }
        (out[0] <= out[1]).then_some(out)
    }

    /// Highest point in it.
    pub fn top(&self, thing: &Thing) -> Option<f64> {
        let mut top: Option<f64> = None;
        for t in &thing.triangles {
            let mut polygon: Vec<DVec3> = t
                .iter()
                .map(|p| {
                    let d = *p - self.origin;
                    DVec3::new(d.dot(self.along), p.y, d.dot(self.across))
                })
                .collect();
            if self.half_width.is_finite() {
                clip(&mut polygon, |p| p.z + self.half_width);
                clip(&mut polygon, |p| self.half_width - p.z);
            }
            clip(&mut polygon, |p| p.x - self.from);
            top = polygon.iter().map(|p| p.y).chain(top).reduce(f64::max);
        }
        top
    }
}

/// Keeps the part of a polygon where a linear function is not negative (Sutherland and Hodgman 1974).
fn clip(polygon: &mut Vec<DVec3>, side: impl Fn(DVec3) -> f64) {
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for k in 0..polygon.len() {
        let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
        let (da, db) = (side(a), side(b));
        if da >= 0.0 {
            out.push(a);
        }
        if (da < 0.0) != (db < 0.0) {
            out.push(a + (b - a) * (da / (da - db)));
        }
    }
    *polygon = out;
}

/// Looks for the height at which a jaw from above can hold what is in a window; `lowest` is what the finger tips must stay
/// above.
///
/// # Errors
/// Why not, with the measurement and its limit.
pub fn grasp(thing: &Thing, window: &Window, jaw: &JawSize, lowest: f64) -> Result<Grasp, String> {
    let top = window.top(thing).ok_or("nothing of it is there")?;
    let mut profile: Vec<Section> = Vec::new();
    let deepest = (jaw.palm_m - PASS_M).min(top - lowest - jaw.tip_m);
    if deepest < jaw.pad_half_height_m {
        return Err(format!(
            "it rises {:.0} mm above what it rests on, the fingers need {:.0} mm",
            1e3 * (top - lowest),
            1e3 * (jaw.tip_m + jaw.pad_half_height_m)
        ));
    }
    // Half the pads at least have something between them.
    let mut below = jaw.pad_half_height_m;
    // What is below the reach of the fingers is measured too: it says why not lower.
    while below < deepest + 0.1 && top - below > lowest.max(0.05) {
        let h = top - below;
        let pads = window.extent(thing, [h - jaw.pad_half_height_m, h + jaw.pad_half_height_m]);
        let all = window.extent(thing, [h - jaw.tip_m, top]);
        if let (Some(pads), Some(all)) = (pads, all) {
            let middle_m = f64::midpoint(pads[0], pads[1]);
            profile.push(Section {
                height_m: h,
                thickness_m: pads[1] - pads[0],
                straddle_m: 2.0 * (all[1] - middle_m).max(middle_m - all[0]),
                middle_m,
            });
        }
        below += STEP_M;
    }
    let limit = jaw.opening_m - 2.0 * PASS_M;
    let fits = |s: &Section| s.straddle_m <= limit && top - s.height_m <= deepest;
    let Some(section) = profile.iter().rev().find(|s| fits(s)).copied() else {
        let thinnest = profile.iter().map(|s| s.straddle_m).fold(f64::INFINITY, f64::min);
        return Err(format!(
            "it is {:.0} mm across at its thinnest, {:.0} mm pass between the fingers of a jaw of {:.0} mm",
            1e3 * thinnest,
            1e3 * limit,
            1e3 * jaw.opening_m
        ));
    };
    let thicker = profile.iter().find(|s| s.height_m < section.height_m && s.straddle_m > limit);
    let because = match thicker {
        Some(t) => format!(
            "at {:.3} m it is {:.0} mm thick, within the {:.0} mm jaw; {:.0} mm lower the fingers would have to straddle {:.0} mm",
            section.height_m,
            1e3 * section.thickness_m,
            1e3 * jaw.opening_m,
            1e3 * (section.height_m - t.height_m),
            1e3 * t.straddle_m
        ),
        None => format!(
            "at {:.3} m it is {:.0} mm thick, within the {:.0} mm jaw; lower the palm would touch the top at {:.3} m, or the \
             tips what is below",
            section.height_m,
            1e3 * section.thickness_m,
            1e3 * jaw.opening_m,
            top
        ),
    };
    let at = window.origin + window.along * section.middle_m;
    let centre = DVec3::new(at.x, section.height_m, at.z);
    Ok(Grasp { centre, closing: window.along, section, top_m: top, profile, because })
}

/// A seat.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Seat {
    /// Middle height of its cells, metres.
    pub height_m: f64,
    /// Middle of its cells, room.
    pub centre: DVec3,
    /// m2.
    pub area_m2: f64,
    /// Middles of its cells (x, z).
    #[serde(skip)]
    pub cells: Vec<DVec2>,
}

/// A chair's directions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chair {
    /// Its seat.
    pub seat: Seat,
    /// Unit, horizontal: from the seat to the backrest.
    pub back: DVec3,
    /// Unit, horizontal: to the left of who sits on it.
    pub left: DVec3,
    /// Top of the backrest, metres.
    pub top_m: f64,
    /// Front edge of the seat, from its middle against `back`, metres.
    pub front_m: f64,
}

/// The middle of the window of heights, `within` up and down, that holds most of some; 0 without any.
pub(crate) fn fullest_height(heights: impl Iterator<Item = f64>, within: f64) -> f64 {
    let mut heights: Vec<f64> = heights.collect();
    heights.sort_by(f64::total_cmp);
    let mut best = (0, 0.0);
    let mut low = 0;
    for high in 0..heights.len() {
        while heights[high] - heights[low] > 2.0 * within {
            low += 1;
        }
        if high + 1 - low > best.0 {
            best = (high + 1 - low, heights[usize::midpoint(low, high)]);
        }
    }
    best.1
}

/// The seat of a thing.
///
/// # Errors
/// Why one cannot sit on it, with the measurement and its limit.
pub fn seat(thing: &Thing) -> Result<Seat, String> {
    let cells = cells(thing);
    let fits = |h: f64| (SEAT_M[0]..=SEAT_M[1]).contains(&h);
    let flat: Vec<(DVec2, f64)> = cells.iter().filter(|c| c.2 && fits(c.1)).map(|c| (c.0, c.1)).collect();
    let height_m = fullest_height(flat.iter().map(|c| c.1), LEVEL_M);
    let seat: Vec<(DVec2, f64)> = flat.into_iter().filter(|c| (c.1 - height_m).abs() <= LEVEL_M).collect();
    let area_m2 = seat.len() as f64 * CELL_M * CELL_M;
    if area_m2 < SEAT_M2 {
        return Err(format!(
            "{area_m2:.2} m2 of it are level between {:.2} and {:.2} m, a seat needs {SEAT_M2} m2",
            SEAT_M[0], SEAT_M[1]
        ));
    }
    let sum: DVec2 = seat.iter().map(|c| c.0).sum();
    let middle = sum / seat.len() as f64;
    Ok(Seat {
        height_m,
        centre: DVec3::new(middle.x, height_m, middle.y),
        area_m2,
        cells: seat.into_iter().map(|c| c.0).collect(),
    })
}

/// Middle (x, z), top height and whether it looks up, of every cell that a thing has something in.
pub fn cells(thing: &Thing) -> Vec<(DVec2, f64, bool)> {
    let size = thing.high - thing.low;
    let (nx, nz) = ((size.x / CELL_M).ceil() as usize, (size.z / CELL_M).ceil() as usize);
    let mut out = Vec::new();
    for i in 0..nx.min(500) {
        for k in 0..nz.min(500) {
            let at = DVec2::new(thing.low.x + (i as f64 + 0.5) * CELL_M, thing.low.z + (k as f64 + 0.5) * CELL_M);
            if let Some((height, up)) = thing.top_at(at.x, at.y, thing.high.y + 0.1) {
                out.push((at, height, up));
            }
        }
    }
    out
}

/// A seat with a backrest.
///
/// # Errors
/// Why it is no such thing, with the measurement and its limit.
pub fn chair(thing: &Thing) -> Result<Chair, String> {
    let seat = seat(thing)?;
    let middle = DVec2::new(seat.centre.x, seat.centre.z);
    let high: Vec<DVec2> =
        cells(thing).into_iter().filter(|c| c.1 > seat.height_m + BACK_M).map(|c| c.0 - middle).collect();
    let sum: DVec2 = high.iter().copied().sum();
    let mean = sum / high.len().max(1) as f64;
    if high.is_empty() || mean.length() < 0.05 {
        return Err(format!(
            "nothing rises {BACK_M} m above its seat at {:.2} m on one side: there is no backrest",
            seat.height_m
        ));
    }
    // Along one of its own axes: a scan of cells is not exact enough for a direction of its own.
    let axes = (0..4).map(|k| {
        let a = thing.yaw + f64::from(k) * std::f64::consts::FRAC_PI_2;
        DVec2::new(a.sin(), a.cos())
    });
    let along = axes.max_by(|a, b| a.dot(mean).total_cmp(&b.dot(mean))).unwrap_or(DVec2::NEG_Y);
    let back = DVec3::new(along.x, 0.0, along.y);
    let front_m = seat.cells.iter().map(|c| -(*c - middle).dot(along)).fold(0.0, f64::max) + CELL_M / 2.0;
    // Who sits looks along -back; their left is up x forward.
    let left = DVec3::Y.cross(-back);
    Ok(Chair { seat, back, left, top_m: thing.high.y, front_m })
}

impl Chair {
    /// A window on the backrest at an offset to the left, as wide as a jaw's pads.
    pub fn backrest(&self, left: f64, half_width: f64) -> Window {
        Window {
            origin: self.seat.centre + self.left * left,
            along: self.back,
            across: self.left,
            half_width,
            from: 0.0,
        }
    }

    /// Where a jaw from above can hold the backrest, nearest to its middle.
    ///
    /// # Errors
    /// Why not, at the middle.
    pub fn grasp(&self, thing: &Thing, jaw: &JawSize) -> Result<Grasp, String> {
        let mut first = None;
        for k in 0..12 {
            let offset = f64::from((k + 1) / 2) * if k % 2 == 0 { 0.02 } else { -0.02 };
            let window = self.backrest(offset, jaw.pad_half_width_m);
            let high = window.top(thing).unwrap_or(0.0);
            if high < self.seat.height_m + BACK_M {
                continue;
            }
            match grasp(thing, &window, jaw, self.seat.height_m) {
                Ok(found) => return Ok(found),
                Err(why) => first = first.or(Some(why)),
            }
        }
        Err(first.unwrap_or_else(|| "there is no backrest above the middle of the seat".to_owned()))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::room::tests::thing;

    pub(crate) const JAW: JawSize =
        JawSize { opening_m: 0.08, tip_m: 0.0095, palm_m: 0.037, pad_half_height_m: 0.0085, pad_half_width_m: 0.0085 };

    /// A chair that faces +Z: legs, seat, and a back that gets thicker by steps from its top at 0.9 m down.
    pub(crate) fn stepped_chair() -> Thing {
        thing(
            "chair_01",
            "chair",
            &[
                ([1.0, 0.0, 1.0], [1.05, 0.42, 1.05]),
                ([1.4, 0.0, 1.4], [1.45, 0.42, 1.45]),
                ([1.0, 0.42, 1.0], [1.45, 0.46, 1.45]),
                ([1.0, 0.46, 0.96], [1.45, 0.87, 1.05]),
                ([1.0, 0.87, 0.98], [1.45, 0.90, 1.03]),
            ],
        )
    }

    #[test]
    fn a_seat_and_its_back_are_found_by_rays() {
        let chair = chair(&stepped_chair()).unwrap();
        assert!((chair.seat.height_m - 0.46).abs() < 1e-6);
        assert!(chair.back.distance(DVec3::NEG_Z) < 1e-9, "{}", chair.back);
        assert!(chair.left.distance(DVec3::X) < 1e-9, "{}", chair.left);
        assert!((chair.seat.area_m2 - 0.45 * 0.40).abs() < 0.02, "{}", chair.seat.area_m2);
        assert!((chair.front_m - 0.2).abs() < 0.02, "{}", chair.front_m);
        let stool = thing("stool_01", "stool", &[([1.0, 0.0, 1.0], [1.4, 0.46, 1.4])]);
        assert!(super::chair(&stool).unwrap_err().contains("no backrest"));
        let table = thing("table_01", "table", &[([1.0, 0.0, 1.0], [2.4, 0.74, 1.8])]);
        assert!(seat(&table).unwrap_err().contains("0.00 m2"));
    }

    #[test]
    fn the_height_is_where_the_back_is_thin_enough_and_the_reason_has_the_numbers() {
        let thing = stepped_chair();
        let chair = chair(&thing).unwrap();
        let found = chair.grasp(&thing, &JAW).unwrap();
        // 50 mm above 0.87, 90 mm below: the tips stay above 0.87.
        assert!(found.section.height_m >= 0.87 + JAW.tip_m - 1e-6 && found.section.height_m < 0.9, "{found:?}");
        assert!((found.section.thickness_m - 0.05).abs() < 1e-6);
        assert!((found.centre.z - 1.005).abs() < 1e-6, "midway: {}", found.centre);
        assert!(found.because.contains("50 mm thick") && found.because.contains("straddle 90 mm"), "{}", found.because);
        let narrow = JawSize { opening_m: 0.04, ..JAW };
        let said = chair.grasp(&thing, &narrow).unwrap_err();
        assert!(said.contains("50 mm across") && said.contains("36 mm pass"), "{said}");
    }
}
