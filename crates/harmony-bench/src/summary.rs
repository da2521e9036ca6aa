//! Scores of many rooms in a table: median, 90th percentile, worst, beside the target.

use harmony_scene::Level;
use serde::{Deserialize, Serialize};

use crate::score::{ObjectScore, RoomScore};

/// One line of the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// What is measured.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Number of measurements.
    pub count: usize,
    /// Median, or the share for a percentage, or the total for a count.
    pub value: f64,
    /// 90th percentile, where there is a distribution.
    pub p90: Option<f64>,
    /// Largest, where there is a distribution.
    pub worst: Option<f64>,
    /// Target for `value` and for `p90`.
    pub target: [Option<f64>; 2],
    /// Whether more is better.
    pub more_is_better: bool,
}

impl Figure {
    /// Whether the targets are met; `None` without a target or a measurement.
    pub fn met(&self) -> Option<bool> {
        if self.count == 0 {
            return None;
        }
        let within = |value: f64, target: f64| {
            if self.more_is_better { value >= target } else { value <= target }
        };
        let first = self.target[0].map(|t| within(self.value, t));
        let second = self.target[1].zip(self.p90).map(|(t, v)| within(v, t));
        match (first, second) {
            (None, None) => None,
            (a, b) => Some(a.unwrap_or(true) && b.unwrap_or(true)),
        }
    }
}

/// Value at a quantile of unsorted numbers (nearest rank); NaN when there are none.
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut v: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    v.sort_by(f64::total_cmp);
    if v.is_empty() {
        return f64::NAN;
    }
    v[((q * v.len() as f64).ceil() as usize).clamp(1, v.len()) - 1]
}

fn spread(name: &str, unit: &str, values: &[f64], target: [Option<f64>; 2]) -> Figure {
    Figure {
        name: name.to_owned(),
        unit: unit.to_owned(),
        count: values.len(),
        value: quantile(values, 0.5),
        p90: Some(quantile(values, 0.9)),
        worst: Some(quantile(values, 1.0)),
        target,
        more_is_better: false,
    }
}

fn share(name: &str, right: usize, of: usize, target: Option<f64>) -> Figure {
    Figure {
        name: name.to_owned(),
        unit: "%".to_owned(),
        count: of,
        value: if of == 0 { f64::NAN } else { 100.0 * right as f64 / of as f64 },
        p90: None,
        worst: None,
        target: [target, None],
        more_is_better: true,
    }
}

fn total(name: &str, unit: &str, count: usize, rooms: usize, target: Option<f64>) -> Figure {
    Figure {
        name: name.to_owned(),
        unit: unit.to_owned(),
        count: rooms,
        value: count as f64,
        p90: None,
        worst: None,
        target: [target, None],
        more_is_better: false,
    }
}

/// The table of some rooms. Targets are those for the photo-like rooms at level `real`.
pub fn summary(rooms: &[RoomScore]) -> Vec<Figure> {
    let camera = |f: fn(&RoomScore) -> f64| rooms.iter().map(f).collect::<Vec<_>>();
    let objects: Vec<&ObjectScore> = rooms.iter().flat_map(|r| &r.objects).filter(|o| o.truth.is_some()).collect();
    let all: usize = rooms.iter().map(|r| r.objects.len()).sum();
    let missed: usize = rooms.iter().map(|r| r.missed.len()).sum();
    let (small, large): (Vec<&ObjectScore>, Vec<&ObjectScore>) =
        objects.iter().copied().partition(|o| o.level == Level::Decoration);
    let values = |of: &[&ObjectScore], f: fn(&ObjectScore) -> f64| of.iter().map(|o| f(o)).collect::<Vec<f64>>();
    let of_level =
        |level: Level| -> Vec<f64> { objects.iter().filter(|o| o.level == level).map(|o| o.position_m).collect() };
    let fronted: Vec<&ObjectScore> = objects.iter().copied().filter(|o| o.has_front).collect();
    let sure: Vec<&ObjectScore> = objects.iter().copied().filter(|o| o.confidence >= 0.9).collect();
    let on_host: Vec<f64> = small.iter().filter_map(|o| o.on_host_m).collect();
    let extent =
        |i: usize| -> Vec<f64> { rooms.iter().filter_map(|r| r.extents[i]).map(|v| 100.0 * v.abs()).collect() };
    let walls: Vec<&ObjectScore> = objects.iter().copied().filter(|o| o.level == Level::Wall).collect();
    vec![
        spread("camera rotation", "deg", &camera(|r| r.camera.rotation_deg), [Some(0.7), Some(2.0)]),
        spread("camera centre", "m", &camera(|r| r.camera.centre_m), [Some(0.06), None]),
        spread("focal length", "%", &camera(|r| 100.0 * r.camera.focal.abs()), [None, None]),
        spread("room width (both walls seen)", "%", &extent(0), [None, None]),
        spread("room height", "%", &extent(1), [None, None]),
        spread(
            "position, furniture + wall + ceiling",
            "m",
            &values(&large, |o| o.position_m),
            [Some(0.05), Some(0.15)],
        ),
        spread("  furniture", "m", &of_level(Level::Furniture), [None, None]),
        spread("  wall", "m", &of_level(Level::Wall), [None, None]),
        spread("  ceiling", "m", &of_level(Level::Ceiling), [None, None]),
        spread("position, decorations", "m", &values(&small, |o| o.position_m), [None, None]),
        share(
            "decorations on the right host",
            small.iter().filter(|o| o.support_right).count(),
            small.len(),
            Some(97.0),
        ),
        spread("  position on the host", "m", &on_host, [Some(0.05), None]),
        share("yaw within 10 deg", fronted.iter().filter(|o| o.yaw_deg <= 10.0).count(), fronted.len(), Some(95.0)),
        spread("size", "%", &values(&objects, |o| 100.0 * o.size), [Some(4.0), None]),
        share("object recall", objects.len(), objects.len() + missed, Some(97.0)),
        share("object precision", objects.len(), all, Some(97.0)),
        spread("1 - IoU of visible masks", "", &values(&objects, |o| 1.0 - o.iou), [None, None]),
        share("support right", objects.iter().filter(|o| o.support_right).count(), objects.len(), None),
        share("wall right", walls.iter().filter(|o| o.support_right).count(), walls.len(), None),
        total("pairs cutting by > 1 cm", "", rooms.iter().map(|r| r.penetrating.len()).sum(), rooms.len(), Some(0.0)),
        total("floating by > 5 mm", "", rooms.iter().map(|r| r.floating.len()).sum(), rooms.len(), Some(0.0)),
        share(
            "confidence >= 0.9: within 0.15 m, 10 deg, 12 %",
            sure.iter().filter(|o| good(o)).count(),
            sure.len(),
            Some(90.0),
        ),
        spread("seconds", "s", &camera(|r| r.seconds), [None, None]),
    ]
}

/// Whether an object is within three times the median targets (the 90th percentile of the position).
pub fn good(o: &ObjectScore) -> bool {
    o.truth.is_some() && o.position_m <= 0.15 && o.size <= 0.12 && (!o.has_front || o.yaw_deg <= 10.0)
}

/// The table for a terminal.
pub fn text_table(figures: &[Figure]) -> String {
    let mut out = String::new();
    for f in figures {
        let number = |v: f64| {
            if v.is_nan() {
                "-".to_owned()
            } else if v.abs() >= 100.0 {
                format!("{v:.0}")
            } else {
                format!("{v:.3}")
            }
        };
        let optional = |v: Option<f64>| v.map_or_else(String::new, number);
        let targets =
            [f.target[0], f.target[1]].iter().flatten().map(|t| format!("{t}")).collect::<Vec<_>>().join(" / ");
        let verdict = match f.met() {
            Some(true) => "met",
            Some(false) => "NOT met",
            None => "",
        };
        out.push_str(&format!(
            "{:<48} {:>4} {:>9} {:>9} {:>9}  {:<4} {:<12} {verdict}\n",
            f.name,
            f.count,
            number(f.value),
            optional(f.p90),
            optional(f.worst),
            f.unit,
            targets,
        ));
    }
    out
}

/// Heading of [`text_table`].
pub const TEXT_HEADING: &str =
    "figure                                              n    median       p90     worst  unit target";
