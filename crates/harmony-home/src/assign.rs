//! Which run is which room of a given layout, and which of its walls the photo faced.
//!
//! Each run may be each room in four turns; an energy in nats says how badly its sizes, height and doors fit. The
//! assignment of least energy wins; how much the next best one is behind is told.

use serde::Serialize;

use crate::HomeError;
use crate::frame::sides;
use crate::layout::HomeLayout;
use crate::rooms::{Evidence, RoomRun};
use crate::solve::{Joint, RoomIn, Seat, Sigmas, Solved, door_range, unrefined};
use harmony_scene::{OpeningKind, QuarterTurn, Wall};

/// Sizes of a run, relative, where its photo shows both walls.
const SIZE: f64 = 0.05;
/// The same where it does not.
const SIZE_GUESSED: f64 = 0.25;
/// Place of a door along its wall before anything is refined, metres.
const DOOR_M: f64 = 0.25;
/// Most of what one door or size costs, nats: it may be missing or wrong altogether.
const MOST: f64 = 4.0;
/// A window towards another room costs so much, nats.
const INNER_WINDOW: f64 = 3.0;
/// Runs whose scale would have to change by more do not show the room.
const MAX_SCALE: f64 = 0.15;
/// Most runs without a name that are tried in all orders.
const MAX_UNNAMED: usize = 8;

/// How one run was assigned.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Assigned {
    /// Number of the room in the layout.
    pub room: usize,
    /// How its photo is turned.
    pub turn: QuarterTurn,
    /// Its energy, nats.
    pub energy: f64,
    /// How much more the next best turn in the same room costs, nats.
    pub next_turn: f64,
}

/// All runs, and how much more the next best assignment costs, nats; infinite where there is no other.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Assignment {
    /// One a run.
    pub runs: Vec<Assigned>,
    /// The next best one's energy less this one's.
    pub next: f64,
}

/// A bounded quadratic loss, nats.
fn nats(off: f64) -> f64 {
    (0.5 * off * off).min(MOST)
}

/// The energy of a run as a room in a turn.
fn energy(layout: &HomeLayout, run: &RoomRun, evidence: &Evidence, room: usize, turn: QuarterTurn) -> f64 {
    let wanted = &layout.rooms[room];
    let rect = wanted.bounds();
    let e = &evidence.extents;
    let own = sides(turn, e);
    let mut sum = 0.0;
    for (axis, sides) in [(0, [Wall::Left, Wall::Right]), (1, [Wall::Back, Wall::Front])] {
        let seen = sides.iter().all(|s| evidence.sees(turn.inverse().wall(*s).surface()));
        sum += nats((own[axis] / rect.size()[axis]).ln() / if seen { SIZE } else { SIZE_GUESSED });
    }
    if let Some(height) = wanted.height {
        sum += nats((e.height / height).ln() / SIZE);
    }
    let solved = rough(evidence, layout, room, turn);
    let joints = seats_of(layout, room);
    let mut taken = vec![false; evidence.doors.len()];
    for (side, range) in &joints {
        let found = nearest(evidence, &solved, turn, *side, range, &taken);
        match found {
            Some((k, off)) => {
                taken[k] = true;
                sum += nats(off / DOOR_M);
            }
            // A door that the photo should show.
            None if evidence.sees(turn.inverse().wall(*side).surface()) => sum += MOST / 2.0,
            None => {}
        }
    }
    sum += taken.iter().filter(|t| !**t).count() as f64 * MOST;
    let inner = |side: Wall| {
        layout.rooms.iter().enumerate().any(|(k, other)| {
            let gap = (other.bounds().side(side.opposite()) - rect.side(side)) * crate::layout::outward(side);
            let ([a0, a1], [b0, b1]) = (rect.along(side), other.bounds().along(side));
            k != room && (-0.05..0.6).contains(&gap) && a1.min(b1) - a0.max(b0) > 0.5 * (a1 - a0)
        })
    };
    let windows = run.world.scene.room.openings.iter().filter(|o| o.kind == OpeningKind::Window);
    sum + windows.filter(|o| inner(turn.wall(o.wall))).count() as f64 * INNER_WINDOW
}

/// The run in its room, walls on walls.
fn rough(evidence: &Evidence, layout: &HomeLayout, room: usize, turn: QuarterTurn) -> Solved {
    let wanted = &layout.rooms[room];
    let rect = wanted.bounds();
    let one =
        RoomIn { evidence, turn, rect: Some(rect), height: wanted.height, floor: wanted.floor, at: rect.centre() };
    unrefined(&[one])[0]
}

/// A layout's doors in a room: side of the home, range along it.
fn seats_of(layout: &HomeLayout, room: usize) -> Vec<(Wall, [f64; 2])> {
    let doors = (0..layout.doors.len()).filter_map(|k| {
        let side = layout.sides(k).ok()?.into_iter().find(|s| s.room == room)?.side;
        Some((side, range_of(layout, k, side)))
    });
    doors.collect()
}

/// Where a layout's door is along its wall.
fn range_of(layout: &HomeLayout, door: usize, side: Wall) -> [f64; 2] {
    let d = &layout.doors[door];
    let at = if matches!(side, Wall::Left | Wall::Right) { d.at.y } else { d.at.x };
    [at - d.width / 2.0, at + d.width / 2.0]
}

/// The run's door on a side that is nearest to a range, with how far its middle is off.
fn nearest(
    evidence: &Evidence,
    solved: &Solved,
    turn: QuarterTurn,
    side: Wall,
    range: &[f64; 2],
    taken: &[bool],
) -> Option<(usize, f64)> {
    let on = evidence.doors.iter().enumerate().filter(|(k, d)| !taken[*k] && turn.wall(d.wall) == side);
    let off = |k: usize| {
        let own = door_range(evidence, &solved.place, k, side);
        (f64::midpoint(own[0], own[1]) - f64::midpoint(range[0], range[1])).abs()
    };
    on.map(|(k, _)| (k, off(k))).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Assigns runs to rooms.
///
/// # Errors
/// Names that no room has, more runs than rooms, a run that no room's size goes with.
pub fn assign(layout: &HomeLayout, runs: &[RoomRun]) -> Result<Assignment, HomeError> {
    let rooms = layout.rooms.len();
    if runs.len() > rooms {
        return Err(HomeError::Rooms { why: format!("{} runs, but the layout has {rooms} rooms", runs.len()) });
    }
    let unnamed = runs.iter().filter(|r| !r.named).count();
    if unnamed > MAX_UNNAMED {
        let why = format!("{unnamed} runs without a room's name; {MAX_UNNAMED} at most are tried in all rooms");
        return Err(HomeError::Rooms { why });
    }
    let mut costs: Vec<Vec<Option<Cost>>> = Vec::new();
    for run in runs {
        let named = layout.room(&run.name);
        if run.named && named.is_none() {
            let all: Vec<&str> = layout.rooms.iter().map(|r| r.name.as_str()).collect();
            let why = format!("the layout has no room {}; it has {}", run.name, all.join(", "));
            return Err(HomeError::Rooms { why });
        }
        let evidence = run.evidence();
        costs.push(
            (0..rooms)
                .map(|room| {
                    if run.named && named != Some(room) {
                        return None;
                    }
                    let faces = layout.rooms[room].photo_faces;
                    let turns = QuarterTurn::ALL.into_iter().filter(|t| faces.is_none_or(|f| t.wall(Wall::Back) == f));
                    let mut all: Vec<(QuarterTurn, f64)> =
                        turns.map(|t| (t, energy(layout, run, &evidence, room, t))).collect();
                    all.sort_by(|a, b| a.1.total_cmp(&b.1));
                    let next = all.get(1).map_or(f64::INFINITY, |n| n.1 - all[0].1);
                    Some((all[0].0, all[0].1, next))
                })
                .collect(),
        );
    }
    let mut search = Search { costs: &costs, used: vec![false; rooms], chosen: Vec::new(), best: Vec::new() };
    search.step(0.0);
    search.best.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((least, chosen)) = search.best.first() else {
        return Err(HomeError::Rooms { why: "two runs have the name of the same room".to_owned() });
    };
    let next = search.best.get(1).map_or(f64::INFINITY, |n| n.0 - least);
    let assigned: Vec<Assigned> = chosen
        .iter()
        .zip(&costs)
        .map(|(room, costs)| {
            let (turn, energy, next_turn) = costs[*room].expect("only rooms with a cost were chosen");
            Assigned { room: *room, turn, energy, next_turn }
        })
        .collect();
    for (run, a) in runs.iter().zip(&assigned) {
        fits(layout, run, a)?;
    }
    Ok(Assignment { runs: assigned, next })
}

/// The best turn of a run in a room, its energy, and how much more the next best turn costs, nats.
type Cost = (QuarterTurn, f64, f64);

/// All ways to give runs rooms; the two best are kept.
struct Search<'a> {
    costs: &'a [Vec<Option<Cost>>],
    used: Vec<bool>,
    chosen: Vec<usize>,
    best: Vec<(f64, Vec<usize>)>,
}

impl Search<'_> {
    fn step(&mut self, sum: f64) {
        if self.best.len() == 2 && sum >= self.best[1].0 {
            return;
        }
        let Some(costs) = self.costs.get(self.chosen.len()) else {
            self.best.push((sum, self.chosen.clone()));
            self.best.sort_by(|a, b| a.0.total_cmp(&b.0));
            self.best.truncate(2);
            return;
        };
        for (room, cost) in costs.iter().enumerate() {
            if let Some((_, cost, _)) = cost.filter(|_| !self.used[room]) {
                self.used[room] = true;
                self.chosen.push(room);
                self.step(sum + cost);
                self.chosen.pop();
                self.used[room] = false;
            }
        }
    }
}

/// Refuses a run whose measured sizes are far from those of its room.
fn fits(layout: &HomeLayout, run: &RoomRun, assigned: &Assigned) -> Result<(), HomeError> {
    let wanted = &layout.rooms[assigned.room];
    let evidence = run.evidence();
    let (own, size) = (sides(assigned.turn, &evidence.extents), wanted.bounds().size());
    let seen = |sides: [Wall; 2]| sides.iter().all(|s| evidence.sees(assigned.turn.inverse().wall(*s).surface()));
    let mut axes = vec![];
    if seen([Wall::Left, Wall::Right]) {
        axes.push(("width", own.x, size.x));
    }
    if seen([Wall::Back, Wall::Front]) {
        axes.push(("depth", own.y, size.y));
    }
    for (axis, found, length) in axes {
        let factor = length / found;
        if !factor.is_finite() || (factor - 1.0).abs() > MAX_SCALE {
            let run = run.run.display().to_string();
            return Err(HomeError::Scale { run, room: wanted.name.clone(), axis, factor, found, wanted: length });
        }
    }
    Ok(())
}

/// The doors of a layout with what the runs have of each.
pub fn joints(layout: &HomeLayout, rooms: &[Option<(&Evidence, Solved)>]) -> Vec<Joint> {
    let mut taken: Vec<Vec<bool>> =
        rooms.iter().map(|r| vec![false; r.as_ref().map_or(0, |(e, _)| e.doors.len())]).collect();
    let mut out = Vec::new();
    for door in 0..layout.doors.len() {
        let sides = layout.sides(door).unwrap_or_default();
        let Some(first) = sides.first() else { continue };
        let range = range_of(layout, door, first.side);
        let seats = sides.iter().map(|s| {
            let found = rooms[s.room].as_ref().and_then(|(evidence, solved)| {
                let limit = 3.0 * DOOR_M + Sigmas::default().scale * solved.rect.size().max_element();
                nearest(evidence, solved, solved.place.turn, s.side, &range, &taken[s.room]).filter(|f| f.1 < limit)
            });
            if let Some((k, _)) = found {
                taken[s.room][k] = true;
            }
            Seat { room: s.room, door: found.map(|f| f.0), side: s.side }
        });
        let seats = seats.collect();
        out.push(Joint { seats, layout: Some((range, layout.doors[door].height)) });
    }
    out
}
