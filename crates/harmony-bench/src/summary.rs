//! Scores of many rooms in a table: median, 90th percentile, worst, beside the target.
//!
//! Surfaces and pixel loss are means over the rooms, as the published tables have them; a room whose reconstruction is
//! empty has no such score and is left out, as the protocol does (`n` tells).

use std::fmt::Write;

use harmony_scene::Level;
use serde::{Deserialize, Serialize};

use crate::score::{GeometryScore, MidiFigures, ObjectScore, PlanScore, RoomScore, SurfaceScore};
use crate::views::{LitScore, PictureScore, RegionScore, ViewScore};

/// One line of the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// What is measured.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Number of measurements.
    pub count: usize,
    /// Median, or the mean for surfaces and pictures, or the share for a percentage, or the total for a count.
    pub value: f64,
    /// Better quarter, where there is a distribution.
    #[serde(default)]
    pub p25: Option<f64>,
    /// Median, where there is a distribution.
    #[serde(default)]
    pub median: Option<f64>,
    /// Three quarters are at least as good, where there is a distribution.
    #[serde(default)]
    pub p75: Option<f64>,
    /// Nine of ten are at least as good, where there is a distribution.
    pub p90: Option<f64>,
    /// Worst, where there is a distribution.
    pub worst: Option<f64>,
    /// Mean, where there is a distribution.
    #[serde(default)]
    pub mean: Option<f64>,
    /// Target for `value` and for `p90`.
    pub target: [Option<f64>; 2],
    /// Whether more is better.
    pub more_is_better: bool,
    /// What was measured, where there is a distribution; not written.
    #[serde(skip)]
    pub values: Vec<f64>,
}

/// Name of a main figure.
pub const POSITION: &str = "position, furniture + wall + ceiling";
/// Name of a main figure.
pub const POSITION_SMALL: &str = "position, decorations";
/// Name of a main figure.
pub const YAW: &str = "yaw within 10 deg";
/// Name of a main figure.
pub const SIZE: &str = "size";
/// Name of a main figure.
pub const RECALL: &str = "object recall";
/// Name of a main figure.
pub const PENETRATING: &str = "pairs cutting by > 1 cm";
/// Name of a main figure.
pub const F_OBJECTS: &str = "gen3dsr F@0.1, objects (mean)";
/// Name of a main figure.
pub const CHAMFER_OBJECTS: &str = "gen3dsr CD, objects (mean)";
/// Name of a main figure.
pub const PIXEL_LOSS: &str = "pixel loss PL (mean)";
/// N-CLIP.
pub const N_CLIP: &str = "N-CLIP (mean)";
/// LPIPS.
pub const LPIPS: &str = "LPIPS, AlexNet (mean)";

/// Name of a main figure.
pub const HOST: &str = "decorations on the right host";
/// PL of flat pictures from where the photo was not taken, on what the photo saw.
pub const VIEWS_SEEN: &str = "views PL, seen surfaces (mean)";
/// The same on what the photo did not see.
pub const VIEWS_UNSEEN: &str = "views PL, unseen surfaces (mean)";
/// Silhouette IoU from there.
pub const VIEWS_IOU: &str = "views IoU of seen objects (mean)";

/// Questions to the language model, a room's mean over its objects.
pub const QUESTIONS: &str = "questions for each placed object";

/// A figure by its name.
pub fn find<'a>(figures: &'a [Figure], name: &str) -> Option<&'a Figure> {
    figures.iter().find(|f| f.name == name)
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

impl Figure {
    fn new(name: &str, unit: &str, count: usize, value: f64, target: Option<f64>) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            count,
            value,
            p25: None,
            median: None,
            p75: None,
            p90: None,
            worst: None,
            mean: None,
            target: [target, None],
            more_is_better: false,
            values: Vec::new(),
        }
    }

    /// A distribution; its quantiles count from the better end.
    fn distributed(mut self, values: &[f64]) -> Self {
        let at = |q: f64| {
            let from_best = if self.more_is_better { 1.0 - q } else { q };
            Some(quantile(values, from_best))
        };
        [self.p25, self.median, self.p75, self.p90, self.worst] = [0.25, 0.5, 0.75, 0.9, 1.0].map(at);
        let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        self.mean = Some(crate::metrics::two_way::mean(&finite));
        self.count = finite.len();
        self.values = finite;
        self
    }
}

fn spread(name: &str, unit: &str, values: &[f64], target: [Option<f64>; 2]) -> Figure {
    let mut figure = Figure::new(name, unit, values.len(), quantile(values, 0.5), None).distributed(values);
    figure.target = target;
    figure
}

/// The mean over rooms.
fn mean_of(name: &str, unit: &str, values: &[f64], more_is_better: bool, target: Option<f64>) -> Figure {
    let mut figure = Figure::new(name, unit, values.len(), f64::NAN, target);
    figure.more_is_better = more_is_better;
    let mut figure = figure.distributed(values);
    figure.value = figure.mean.unwrap_or(f64::NAN);
    figure
}

fn share(name: &str, right: usize, of: usize, target: Option<f64>) -> Figure {
    let value = if of == 0 { f64::NAN } else { 100.0 * right as f64 / of as f64 };
    Figure { more_is_better: true, ..Figure::new(name, "%", of, value, target) }
}

fn total(name: &str, unit: &str, count: usize, rooms: usize, target: Option<f64>) -> Figure {
    Figure::new(name, unit, rooms, count as f64, target)
}

/// Surfaces and pictures.
fn surfaces(rooms: &[RoomScore]) -> Vec<Figure> {
    type Of = fn(&GeometryScore) -> Option<&SurfaceScore>;
    let scored = || rooms.iter().filter_map(|r| r.geometry.as_ref());
    let mut figures = Vec::new();
    let sets: [(&str, Of, [Option<f64>; 2]); 3] = [
        ("objects", |g| g.objects.as_ref(), [Some(96.0), Some(0.03)]),
        ("with background", |g| g.with_background.as_ref(), [None, None]),
        ("objects, truth whole", |g| g.whole.as_ref(), [None, None]),
    ];
    for (what, of, [f_target, chamfer_target]) in sets {
        for (threshold, target) in [(0.1, f_target), (0.01, None), (0.001, None)] {
            let values: Vec<f64> = scored().filter_map(|g| of(g)?.f(threshold)).collect();
            figures.push(mean_of(&format!("gen3dsr F@{threshold}, {what} (mean)"), "%", &values, true, target));
        }
        let values: Vec<f64> = scored().filter_map(|g| Some(of(g)?.chamfer_m)).collect();
        figures.push(mean_of(&format!("gen3dsr CD, {what} (mean)"), "m", &values, false, chamfer_target));
    }
    let midi = |f: fn(&MidiFigures) -> f64| scored().filter_map(|g| g.midi.as_ref()).map(f).collect::<Vec<f64>>();
    figures.push(mean_of("midi F@0.1, normalised, ICP (mean)", "%", &midi(|m| m.f), true, None));
    figures.push(mean_of("midi CD, normalised, squared (mean)", "", &midi(|m| m.chamfer_squared), false, None));
    let losses: Vec<f64> = rooms.iter().filter_map(|r| r.pixel_loss).collect();
    figures.push(mean_of(PIXEL_LOSS, "", &losses, false, None));
    let clip: Vec<f64> = rooms.iter().filter_map(|r| r.n_clip).collect();
    figures.push(mean_of(N_CLIP, "", &clip, false, None));
    let lpips: Vec<f64> = rooms.iter().filter_map(|r| r.lpips).collect();
    figures.push(mean_of(LPIPS, "", &lpips, false, None));
    figures
}

/// Pictures and outlines from where the photo was not taken, means over views; lit pictures. Nothing where no room has
/// views.
fn from_views(rooms: &[RoomScore]) -> Vec<Figure> {
    type Of = fn(&PictureScore) -> Option<RegionScore>;
    let views: Vec<&ViewScore> = rooms.iter().flat_map(|r| &r.views).collect();
    let mut figures = Vec::new();
    let sets: [(&str, Of, [Option<f64>; 2]); 3] = [
        ("", |p| Some(p.all), [None, None]),
        (", seen surfaces", |p| p.seen, [Some(0.007), Some(0.78)]),
        (", unseen surfaces", |p| p.unseen, [Some(0.02), None]),
    ];
    if !views.is_empty() {
        for (what, of, [pl_target, ssim_target]) in sets {
            let values = |f: fn(RegionScore) -> Option<f64>| -> Vec<f64> {
                views.iter().filter_map(|v| f(of(&v.flat)?)).collect()
            };
            figures.push(mean_of(&format!("views PL{what} (mean)"), "", &values(|r| Some(r.pl)), false, pl_target));
            figures.push(mean_of(&format!("views SSIM{what} (mean)"), "", &values(|r| r.ssim), true, ssim_target));
            figures.push(mean_of(&format!("views LPIPS{what} (mean)"), "", &values(|r| r.lpips), false, None));
        }
        let objects = || views.iter().flat_map(|v| &v.objects);
        let iou: Vec<f64> = objects().map(|o| o.iou).collect();
        figures.push(mean_of(VIEWS_IOU, "", &iou, true, Some(0.8)));
        let apart: Vec<f64> = objects().filter_map(|o| o.depth_m).collect();
        figures.push(spread("views depth of seen objects", "m", &apart, [None, None]));
        let nothing: Vec<f64> = views.iter().map(|v| 100.0 * v.nothing).collect();
        figures.push(mean_of("views pixels with nothing (mean)", "%", &nothing, false, None));
    }
    let in_photo: Vec<&LitScore> = rooms.iter().filter_map(|r| r.lit.as_ref()).collect();
    let in_views: Vec<&LitScore> = views.iter().filter_map(|v| v.lit.as_ref()).collect();
    for (what, scores, stops) in [("photo", in_photo, 0.25), ("views", in_views, 0.5)] {
        if scores.is_empty() {
            continue;
        }
        let values = |f: fn(&LitScore) -> f64| -> Vec<f64> { scores.iter().map(|s| f(s)).collect() };
        figures.push(mean_of(&format!("{what} lit PL (mean)"), "", &values(|s| s.lit.all.pl), false, None));
        let over = values(|s| s.lit.all.pl / s.flat_pl.max(1e-9) - 1.0).into_iter().map(|v| 100.0 * v);
        figures.push(mean_of(
            &format!("{what} lit PL over flat (mean)"),
            "%",
            &over.collect::<Vec<_>>(),
            false,
            Some(15.0),
        ));
        let ssim: Vec<f64> = scores.iter().filter_map(|s| s.lit.all.ssim).collect();
        figures.push(mean_of(&format!("{what} lit SSIM (mean)"), "", &ssim, true, None));
        figures.push(spread(&format!("{what} lit luminance"), "stops", &values(|s| s.stops), [Some(stops), None]));
        figures.push(spread(&format!("{what} lit luminance, bias"), "stops", &values(|s| s.stops_bias), [None, None]));
    }
    figures
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
    let plans = |f: fn(&PlanScore) -> f64| rooms.iter().filter_map(|r| r.plan.as_ref()).map(f).collect::<Vec<_>>();
    let seconds: Vec<f64> = camera(|r| r.seconds).into_iter().filter(|s| *s > 0.0).collect();
    let mut figures = vec![
        spread("camera rotation", "deg", &camera(|r| r.camera.rotation_deg), [Some(0.7), Some(2.0)]),
        spread("camera centre", "m", &camera(|r| r.camera.centre_m), [Some(0.06), None]),
        spread("focal length", "%", &camera(|r| 100.0 * r.camera.focal.abs()), [None, None]),
        spread("room width (both walls seen)", "%", &extent(0), [None, None]),
        spread("room height", "%", &extent(1), [None, None]),
        spread("seen walls off by (median of a room)", "m", &plans(|p| p.median_m), [Some(0.1), None]),
        spread("seen walls off by (90th percentile of a room)", "m", &plans(|p| p.p90_m), [None, None]),
        spread(POSITION, "m", &values(&large, |o| o.position_m), [Some(0.05), Some(0.15)]),
        spread("  furniture", "m", &of_level(Level::Furniture), [None, None]),
        spread("  wall", "m", &of_level(Level::Wall), [None, None]),
        spread("  ceiling", "m", &of_level(Level::Ceiling), [None, None]),
        spread(POSITION_SMALL, "m", &values(&small, |o| o.position_m), [None, None]),
        share(HOST, small.iter().filter(|o| o.support_right).count(), small.len(), Some(97.0)),
        spread("  position on the host", "m", &on_host, [Some(0.05), None]),
        share(YAW, fronted.iter().filter(|o| o.yaw_deg <= 10.0).count(), fronted.len(), Some(95.0)),
        spread(SIZE, "%", &values(&objects, |o| 100.0 * o.size), [Some(4.0), None]),
        share(RECALL, objects.len(), objects.len() + missed, Some(97.0)),
        share("object precision", objects.len(), all, Some(97.0)),
        spread("1 - IoU of visible masks", "", &values(&objects, |o| 1.0 - o.iou), [None, None]),
        share("support right", objects.iter().filter(|o| o.support_right).count(), objects.len(), None),
        share("wall right", walls.iter().filter(|o| o.support_right).count(), walls.len(), None),
        total(PENETRATING, "", rooms.iter().map(|r| r.penetrating.len()).sum(), rooms.len(), Some(0.0)),
        total("floating by > 5 mm", "", rooms.iter().map(|r| r.floating.len()).sum(), rooms.len(), Some(0.0)),
        share(
            "confidence >= 0.9: within 0.15 m, 10 deg, 12 %",
            sure.iter().filter(|o| good(o)).count(),
            sure.len(),
            Some(90.0),
        ),
    ];
    figures.extend(surfaces(rooms));
    figures.extend(from_views(rooms));
    let asked: Vec<f64> = rooms.iter().filter_map(|r| r.questions_per_object).collect();
    figures.push(spread(QUESTIONS, "", &asked, [None, None]));
    figures.push(spread("seconds", "s", &seconds, [None, None]));
    figures
}

/// Within these an object is right: metres, degrees, share of size.
pub const RIGHT: (f64, f64, f64) = (0.15, 10.0, 0.12);

/// Whether an object is within three times the median targets (the 90th percentile of the position).
pub fn good(o: &ObjectScore) -> bool {
    o.truth.is_some() && o.position_m <= RIGHT.0 && o.size <= RIGHT.2 && (!o.has_front || o.yaw_deg <= RIGHT.1)
}

/// A number as tables show it.
pub fn number(v: f64) -> String {
    if v.is_nan() {
        "-".to_owned()
    } else if v.abs() >= 100.0 {
        format!("{v:.0}")
    } else if v != 0.0 && v.abs() < 0.1 {
        format!("{v:.4}")
    } else {
        format!("{v:.3}")
    }
}

/// The targets of a figure as tables show them.
pub fn targets(figure: &Figure) -> String {
    figure.target.iter().flatten().map(|t| format!("{t}")).collect::<Vec<_>>().join(" / ")
}

/// The table for a terminal.
pub fn text_table(figures: &[Figure]) -> String {
    let mut out = String::new();
    for f in figures {
        let optional = |v: Option<f64>| v.map_or_else(String::new, number);
        let verdict = match f.met() {
            Some(true) => "met",
            Some(false) => "NOT met",
            None => "",
        };
        let _ = writeln!(
            out,
            "{:<48} {:>4} {:>9} {:>9} {:>9}  {:<4} {:<12} {verdict}",
            f.name,
            f.count,
            number(f.value),
            optional(f.p90),
            optional(f.worst),
            f.unit,
            targets(f),
        );
    }
    out
}

/// Heading of [`text_table`].
pub const TEXT_HEADING: &str =
    "figure                                              n    median       p90     worst  unit target";
