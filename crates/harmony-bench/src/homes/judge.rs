//! A built home against its truth, in the home's frame.

use glam::{DMat3, DVec2, DVec3};
use harmony_home::build::{Built, How, build};
use harmony_home::frame::{Place, sides};
use harmony_home::layout::HomeLayout;
use harmony_home::merge::merge;
use harmony_home::moved::poses;
use harmony_home::rooms::RoomRun;
use harmony_mesh::Mesh;
use harmony_scene::{Extents, Level, OpeningKind, Pose, QuarterTurn, SceneObject, Wall};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::Path;

use super::bench::{HomesError, run_of};
use super::{PlacedBy, TruthHome};
use crate::score::{Prediction, ScoreOptions, score};
use crate::summary::quantile;
use crate::truth::TruthRoom;

/// What was measured on one home.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HomeScore {
    /// Its name.
    pub home: String,
    /// By which its rooms found their places.
    pub by: PlacedBy,
    /// Rooms, and those that are where they belong.
    pub rooms: [usize; 2],
    /// Doors of the truth, and those that the home joins as there.
    pub doors: [usize; 2],
    /// How much the next best layout or assignment costs, nats; none where there is no other.
    pub next: Option<f64>,
    /// Errors of objects' positions before and after all rooms were refined together, metres.
    pub objects: [Vec<f64>; 2],
    /// Errors of doors along their walls: where the photos have them against where they are, before and after, metres.
    pub doors_m: [Vec<f64>; 2],
    /// What the home says that does not fit.
    pub conflicts: usize,
    /// Why there is no result, when there is none.
    pub failure: Option<String>,
}

/// The middle of an object's box: at its bottom, for things on walls its centre.
fn middle(level: Level, mesh: &Mesh, pose: &Pose) -> DVec3 {
    let points = mesh.positions.iter().map(|p| pose.point(p.as_dvec3()));
    let (low, high) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let centre = (low + high) / 2.0;
    if level == Level::Wall { centre } else { centre.with_y(low.y) }
}

/// Rooms of the truth in its home.
fn true_place(home: &TruthHome, room: usize) -> (Place, Extents) {
    let wanted = &home.layout.rooms[room];
    let (rect, turn) = (wanted.bounds(), home.turns[room]);
    let height = wanted.height.unwrap_or(2.5);
    let size = sides(turn, &Extents { width: rect.size().x, height, depth: rect.size().y });
    let place = Place { turn, yaw: 0.0, scale: 1.0, at: rect.centre(), floor: wanted.floor };
    (place, Extents { width: size.x, height, depth: size.y })
}

/// Found and true positions, before and after.
struct Found {
    truth: DVec3,
    places: [DVec3; 2],
}

/// Builds a home of reconstructed rooms and compares it with its truth.
///
/// # Errors
/// Rooms that cannot be read. A home that cannot be built is no error: its score says so.
pub fn judge(
    folder: &Path,
    truth: &TruthHome,
    seed: u64,
    by: PlacedBy,
) -> Result<(HomeScore, Option<Built>), HomesError> {
    let mut runs = Vec::new();
    let mut rooms = Vec::new();
    for room in &truth.rooms {
        let run = run_of(folder, room, seed);
        let room = TruthRoom::load(room).map_err(crate::run::BenchError::from)?;
        // Not a name: which run is which room is to be found out.
        runs.push(RoomRun::read(&run.display().to_string())?);
        rooms.push((room, run));
    }
    let layout: Option<&HomeLayout> = (by == PlacedBy::Layout).then_some(&truth.layout);
    let folders: Vec<_> = runs.iter().map(|r| r.run.clone()).collect();
    let blank = HomeScore {
        home: truth.name.clone(),
        by,
        rooms: [rooms.len(), 0],
        doors: [truth.layout.doors.len(), 0],
        next: None,
        objects: [Vec::new(), Vec::new()],
        doors_m: [Vec::new(), Vec::new()],
        conflicts: 0,
        failure: None,
    };
    let built = match build(layout, runs) {
        Ok(built) => built,
        Err(error) => return Ok((HomeScore { failure: Some(error.to_string()), ..blank }, None)),
    };
    let next = match &built.how {
        How::Layout(a) => a.next.min(a.runs.iter().map(|r| r.next_turn).fold(f64::INFINITY, f64::min)),
        How::Doors(r) => r.next,
    };
    // Rooms of the home in the order of the truth.
    let order: Vec<Option<usize>> = folders
        .iter()
        .map(|f| built.home.rooms.iter().position(|r| r.run.as_ref().is_some_and(|(run, _)| run.run == *f)))
        .collect();
    let turn = |k: usize| order[k].map(|r| built.home.rooms[r].solved.place.turn);
    // A home joined by its doors is turned as its first room's photo is.
    let whole = match (by, turn(0)) {
        (PlacedBy::Doors, Some(own)) => QuarterTurn::bringing(own.wall(Wall::Back), truth.turns[0].wall(Wall::Back)),
        _ => QuarterTurn::default(),
    };
    let same_turn = |k: usize| turn(k).is_some_and(|t| (u8::from(t) + u8::from(whole)) % 4 == u8::from(truth.turns[k]));
    let right: Vec<bool> =
        (0..rooms.len()).map(|k| same_turn(k) && (by == PlacedBy::Doors || order[k] == Some(k))).collect();
    let pairs = |home: &harmony_home::home::Home| -> Vec<[usize; 2]> {
        let back = |r: usize| order.iter().position(|o| *o == Some(r)).unwrap_or(r);
        let of = |d: &harmony_home::home::HomeDoor| (d.rooms.len() == 2).then(|| [back(d.rooms[0]), back(d.rooms[1])]);
        home.doors.iter().filter_map(of).map(|[a, b]| [a.min(b), a.max(b)]).collect()
    };
    let mut joined = pairs(&built.home);
    let met = truth.layout.doors.iter().filter(|d| {
        let wanted: Vec<usize> = d.rooms.iter().filter_map(|n| truth.layout.room(n)).collect();
        let at =
            joined.iter().position(|p| wanted.len() == 2 && *p == [wanted[0].min(wanted[1]), wanted[0].max(wanted[1])]);
        at.map(|k| joined.remove(k)).is_some()
    });
    let doors_right = met.count();
    let found = found(truth, &rooms, &order, &built)?;
    let rotation = DMat3::from_rotation_y(whole.angle());
    let shift = |which: usize| {
        if by == PlacedBy::Layout || found.is_empty() {
            return DVec3::ZERO;
        }
        let median = |axis: usize| {
            quantile(&found.iter().map(|f| f.truth[axis] - (rotation * f.places[which])[axis]).collect::<Vec<_>>(), 0.5)
        };
        DVec3::new(median(0), 0.0, median(2))
    };
    let errors = [0, 1].map(|which| {
        let by = shift(which);
        found.iter().map(|f| (rotation * f.places[which] + by - f.truth).length()).collect::<Vec<f64>>()
    });
    let doors_m = doors(truth, &built, by, rotation, [shift(0), shift(1)], &order);
    let score = HomeScore {
        rooms: [rooms.len(), right.iter().filter(|r| **r).count()],
        doors: [truth.layout.doors.len(), doors_right],
        next: next.is_finite().then_some(next),
        objects: errors,
        doors_m,
        conflicts: built.home.conflicts.len(),
        ..blank
    };
    Ok((score, Some(built)))
}

/// Objects with a counterpart in the truth.
fn found(
    truth: &TruthHome,
    rooms: &[(TruthRoom, std::path::PathBuf)],
    order: &[Option<usize>],
    built: &Built,
) -> Result<Vec<Found>, HomesError> {
    // What merging finds is told by whoever writes the home.
    let merged = merge(&mut built.home.clone());
    let mut out = Vec::new();
    for (k, (room, run)) in rooms.iter().enumerate() {
        let Some(index) = order[k] else { continue };
        let Some((own, evidence)) = built.home.rooms[index].run.clone() else { continue };
        let why = |e: crate::score::PredictionError| {
            HomesError::Home(harmony_home::HomeError::Rooms { why: format!("{}: {e}", run.display()) })
        };
        let prediction = Prediction::load(run).map_err(why)?;
        let scores = score(room, &prediction, ScoreOptions { align_scale: false, points: 0 });
        let objects: Vec<SceneObject> = own.world.items.iter().map(|i| i.object.clone()).collect();
        let before = poses(&objects, &evidence, &built.home.rooms[index].before);
        let (place, extents) = true_place(truth, k);
        for s in scores.matched() {
            let Some(t) = s.truth.as_ref().and_then(|id| room.find(id)) else { continue };
            let Some(n) = own.world.items.iter().position(|i| i.object.id.as_str() == s.id) else { continue };
            // Of a door seen from two rooms one leaf is left: doors have figures of their own.
            let Some((id, _)) = merged.objects[index].iter().find(|(_, of)| of.as_str() == s.id) else { continue };
            if harmony_catalogue::opening(&t.label) == Some(OpeningKind::Door) {
                continue;
            }
            let item = merged.world.items.iter().find(|i| i.object.id == *id).expect("merged objects are in the scene");
            let pose = Pose { position: t.position, yaw: t.yaw, scale: 1.0, stretch: DVec3::ONE };
            let centre = middle(t.level, &t.mesh, &pose);
            out.push(Found {
                truth: place.point(&extents, centre),
                places: [
                    middle(s.level, &own.world.items[n].mesh, &before[n]),
                    middle(s.level, &item.mesh, &item.object.pose) + merged.origin,
                ],
            });
        }
    }
    Ok(out)
}

/// How far doors are off: on a layout each photo's door from where it is; joined by doors the joined one from its place.
fn doors(
    truth: &TruthHome,
    built: &Built,
    by: PlacedBy,
    rotation: DMat3,
    shift: [DVec3; 2],
    order: &[Option<usize>],
) -> [Vec<f64>; 2] {
    let home = &built.home;
    if by == PlacedBy::Layout {
        let after = home.doors.iter().flat_map(|d| d.seen.iter().flatten().map(|(_, off)| off.abs())).collect();
        let before = home.doors.iter().flat_map(|d| d.before.iter().flatten().map(|off| off.abs())).collect();
        return [before, after];
    }
    let back = |r: usize| order.iter().position(|o| *o == Some(r)).unwrap_or(r);
    [0, 1].map(|which| {
        let mut rooms = home.rooms.clone();
        if which == 0 {
            for room in &mut rooms {
                room.solved = room.before;
            }
        }
        let errors = home.doors.iter().filter_map(|door| {
            let names: Vec<&str> = door.rooms.iter().map(|r| truth.layout.rooms[back(*r)].name.as_str()).collect();
            let mut door = door.clone();
            if which == 0 {
                let ends = door.rooms.iter().zip(&door.seen).filter_map(|(r, seen)| {
                    let (_, evidence) = rooms[*r].run.as_ref()?;
                    let k = evidence.doors.iter().position(|d| Some(d.opening) == seen.map(|s| s.0))?;
                    let side = rooms[*r].solved.place.turn.wall(evidence.doors[k].wall);
                    Some(harmony_home::solve::door_range(evidence, &rooms[*r].solved.place, k, side))
                });
                let ends: Vec<[f64; 2]> = ends.collect();
                let n = ends.len().max(1) as f64;
                door.range = [0, 1].map(|i| ends.iter().map(|e| e[i]).sum::<f64>() / n);
            }
            let middle = door.floor(&rooms, home.outer_wall).centre();
            let own = rotation * DVec3::new(middle.x, 0.0, middle.y) + shift[which];
            let own = DVec2::new(own.x, own.z);
            let same = |d: &&harmony_home::layout::LayoutDoor| {
                d.rooms.len() == names.len() && d.rooms.iter().all(|n| names.contains(&n.as_str()))
            };
            let errors = truth.layout.doors.iter().filter(same).map(|d| (d.at - own).length());
            errors.min_by(f64::total_cmp)
        });
        errors.collect()
    })
}

/// The table of several homes.
pub fn table(scores: &[HomeScore]) -> String {
    let mut out = String::from(
        "placed by | homes | built | rooms right | doors right | objects | median before, cm | median, cm | p90 before, cm | p90, cm | doors median before, cm | doors median, cm | doors p90, cm\n",
    );
    for by in [PlacedBy::Layout, PlacedBy::Doors] {
        let own: Vec<&HomeScore> = scores.iter().filter(|s| s.by == by).collect();
        if own.is_empty() {
            continue;
        }
        let built: Vec<&&HomeScore> = own.iter().filter(|s| s.failure.is_none()).collect();
        let whole = |s: &&&&HomeScore| s.rooms[0] == s.rooms[1] && s.doors[0] == s.doors[1];
        // Where rooms are joined wrongly, distances say nothing.
        let judged: Vec<&&&HomeScore> = built.iter().filter(|s| by == PlacedBy::Layout || whole(s)).collect();
        let all = |f: &dyn Fn(&HomeScore) -> &Vec<f64>| judged.iter().flat_map(|s| f(s).clone()).collect::<Vec<f64>>();
        let sum = |f: &dyn Fn(&HomeScore) -> usize| own.iter().map(|s| f(s)).sum::<usize>();
        let cm = |values: &[f64], q: f64| format!("{:.1}", quantile(values, q) * 100.0);
        let (before, after) = (all(&|s| &s.objects[0]), all(&|s| &s.objects[1]));
        let (doors_before, doors_after) = (all(&|s| &s.doors_m[0]), all(&|s| &s.doors_m[1]));
        let _ = writeln!(
            out,
            "{} | {} | {} ({} judged) | {} of {} | {} of {} | {} | {} | {} | {} | {} | {} | {} | {}",
            by.name(),
            own.len(),
            built.len(),
            judged.len(),
            sum(&|s| s.rooms[1]),
            sum(&|s| s.rooms[0]),
            sum(&|s| s.doors[1]),
            sum(&|s| s.doors[0]),
            after.len(),
            cm(&before, 0.5),
            cm(&after, 0.5),
            cm(&before, 0.9),
            cm(&after, 0.9),
            cm(&doors_before, 0.5),
            cm(&doors_after, 0.5),
            cm(&doors_after, 0.9),
        );
    }
    out
}
