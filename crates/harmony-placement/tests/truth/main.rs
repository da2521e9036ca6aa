//! Placement of rooms with known truth: masks, meshes, camera and relations are given, sizes are off by up to 15 %.
//!
//! The table is printed with `--nocapture`. `HARMONY_ROOM` picks one room (`all`: every test on all rooms),
//! `HARMONY_DETAIL=1` lists every object.

#![allow(clippy::print_stdout, clippy::unwrap_used)] // a test that prints a table

mod room;

use std::time::Instant;

use harmony_placement::{LevelReport, PlacementSettings, place_level};
use harmony_scene::{Level, PointMapKind};
use room::{GtRoom, Noise};

/// What was measured on the objects of several rooms.
#[derive(Debug, Default)]
struct Errors {
    position: Vec<f64>,
    size: Vec<f64>,
    yaw_deg: Vec<f64>,
    iou: Vec<f64>,
    /// Spent in placement itself.
    seconds: f64,
}

fn median(values: &[f64]) -> f64 {
    let mut v = values.to_vec();
    v.sort_by(f64::total_cmp);
    v.get(v.len() / 2).copied().unwrap_or(f64::NAN)
}

fn share_above(values: &[f64], limit: f64) -> f64 {
    values.iter().filter(|v| **v > limit).count() as f64 / values.len().max(1) as f64
}

impl Errors {
    fn print(&self, name: &str) {
        let seconds = self.seconds;
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
        println!(
            "{name:<28} n {:>3}  position median {:.3} mean {:.3} >0.2: {:>4.1} %  size median {:.3}  yaw median {:>5.2} mean {:>5.1} >30: {:>4.1} %  IoU {:.3}  {seconds:.1} s",
            self.position.len(),
            median(&self.position),
            mean(&self.position),
            100.0 * share_above(&self.position, 0.2),
            median(&self.size),
            median(&self.yaw_deg),
            mean(&self.yaw_deg),
            100.0 * share_above(&self.yaw_deg, 30.0),
            median(&self.iou),
        );
    }

    fn add(&mut self, other: &Self) {
        self.position.extend(&other.position);
        self.size.extend(&other.size);
        self.yaw_deg.extend(&other.yaw_deg);
        self.iou.extend(&other.iou);
        self.seconds += other.seconds;
    }
}

/// Places one room and compares with the truth.
fn place_room(name: &str, kind: PointMapKind, noise: &Noise, settings: &PlacementSettings) -> Option<Errors> {
    let gt = GtRoom::load(name)?;
    let mut scene = gt.scene(Some(kind), noise);
    let mut errors = Errors::default();
    let detail = std::env::var_os("HARMONY_DETAIL").is_some();
    for level in Level::ALL {
        let items = gt.items(level, noise);
        let count = items.len();
        let begun = Instant::now();
        let report: LevelReport = place_level(&mut scene, items, None, settings);
        errors.seconds += begun.elapsed().as_secs_f64();
        assert_eq!(report.objects.len() + report.dropped.len(), count, "every item is placed or dropped");
        if detail {
            for u in &report.unresolved {
                println!("    unresolved {} {} {:.3}", u.a, u.b, u.penetration);
            }
            for d in &report.dropped {
                println!("    dropped {} {}", d.0, d.1);
            }
        }
    }
    for placed in &scene.placed {
        let Some(truth) = gt.truth(placed.item.id.as_str()) else { continue };
        let e = truth.compare(placed);
        if detail {
            println!(
                "    {:<20} pos {:.3} ({:+.3} {:+.3} {:+.3})  size {:.3}  yaw {:>6.1}{}  IoU {:.3}  depth {:?}  pen {:.3} conf {:.2} on {:?}",
                placed.item.id.as_str(),
                e.offset.length(),
                e.offset.x,
                e.offset.y,
                e.offset.z,
                e.size,
                e.yaw_deg,
                if truth.yaw_counts { " " } else { "*" },
                placed.evidence.silhouette_iou.unwrap_or(f64::NAN),
                placed.evidence.depth_residual_m.map(|d| (d * 1e4).round() / 1e4),
                placed.evidence.penetration_m,
                placed.confidence().overall,
                placed.support,
            );
        }
        errors.position.push(e.offset.length());
        errors.size.push(e.size);
        if truth.yaw_counts {
            errors.yaw_deg.push(e.yaw_deg);
        }
        errors.iou.push(placed.evidence.silhouette_iou.unwrap_or(0.0));
    }
    Some(errors)
}

/// Places all rooms, or the given ones, and prints the table.
fn measure(
    title: &str,
    kind: PointMapKind,
    noise: &Noise,
    settings: &PlacementSettings,
    few: Option<&[&str]>,
) -> Option<Errors> {
    let mut all = Errors::default();
    let only = std::env::var("HARMONY_ROOM").ok();
    for name in room::names()? {
        let wanted = match only.as_deref() {
            Some("all") => true,
            Some(o) => o == name,
            None => few.is_none_or(|f| f.contains(&name.as_str())),
        };
        if !wanted {
            continue;
        }
        let errors = place_room(&name, kind, noise, settings)?;
        errors.print(&format!("  {name}"));
        all.add(&errors);
    }
    all.print(title);
    Some(all)
}

/// Sizes off by up to 15 %, all else exact.
const SIZES: Noise =
    Noise { size: 0.15, mesh: 0.0, may_stretch: false, mask_px: 0.0, pitch: 0.0, focal: 0.0, depth: 0.0, seed: 7 };

/// Nothing exact: meshes of wrong proportions, masks two pixels off, the camera a degree and 3 % off, depths 3 % off.
const EVERYTHING: Noise = Noise { mesh: 0.1, mask_px: 2.0, pitch: 0.014, focal: 0.03, depth: 0.03, ..SIZES };

#[test]
fn rooms_with_a_depth_map_come_out_where_they_are() {
    let settings = PlacementSettings::default();
    let Some(e) = measure("metric depth", PointMapKind::Metric, &SIZES, &settings, HALF) else {
        return;
    };
    assert!(median(&e.position) < 0.02, "median position error {}", median(&e.position));
    assert!(share_above(&e.position, 0.2) < 0.08, "objects more than 20 cm off");
    assert!(median(&e.size) < 0.02, "median size error {}", median(&e.size));
    assert!(median(&e.yaw_deg) < 2.0, "median yaw error {}", median(&e.yaw_deg));
}

#[test]
fn rooms_without_depth_come_out_near_where_they_are() {
    let settings = PlacementSettings::default();
    let Some(e) = measure("room box, no depth", PointMapKind::RoomBox, &SIZES, &settings, HALF) else {
        return;
    };
    assert!(median(&e.position) < 0.03, "median position error {}", median(&e.position));
    assert!(share_above(&e.position, 0.2) < 0.12, "objects more than 20 cm off");
    assert!(median(&e.size) < 0.02, "median size error {}", median(&e.size));
    assert!(median(&e.yaw_deg) < 2.0, "median yaw error {}", median(&e.yaw_deg));
}

/// Rooms for the tests with several sweeps: a minute of the test profile goes far enough.
const FEW: Option<&[&str]> = Some(&["home_office_01", "study_01"]);

/// Rooms for the others: a dense dining set, a cluttered living room, a study full of small things.
const HALF: Option<&[&str]> = Some(&["dining_room_01", "living_room_01", "study_01"]);

#[test]
fn with_everything_a_little_off_objects_are_a_little_off() {
    let settings = PlacementSettings::default();
    let Some(e) = measure("all noisy, depth", PointMapKind::Relative, &EVERYTHING, &settings, FEW) else {
        return;
    };
    assert!(median(&e.position) < 0.15, "median position error {}", median(&e.position));
    let e = measure("all noisy, no depth", PointMapKind::RoomBox, &EVERYTHING, &settings, FEW).unwrap_or_default();
    assert!(median(&e.position) < 0.15, "median position error {}", median(&e.position));
    let parts = Noise { may_stretch: true, ..EVERYTHING };
    let e = measure("all noisy, may stretch", PointMapKind::RoomBox, &parts, &settings, FEW).unwrap_or_default();
    assert!(median(&e.position) < 0.15, "median position error {}", median(&e.position));
}
