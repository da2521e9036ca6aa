//! From runs to a home: by a layout, or by the rooms' own doors.

use crate::HomeError;
use crate::assign::{Assignment, assign, joints};
use crate::frame::Place;
use crate::home::{Home, HomeDoor, HomeRoom};
use crate::layout::{DoorKind, HomeLayout, USUAL_DOOR_M, USUAL_WALL_M};
use crate::matching::{self, Ranking, match_rooms};
use crate::rooms::{Evidence, RoomRun, make_names_unique};
use crate::solve::{Joint, Problem, RoomIn, Seat, Sigmas, Solved, door_range, unrefined};
use harmony_scene::{QuarterTurn, Wall};

/// Height of rooms of which nothing says it, metres.
const USUAL_ROOM_M: f64 = 2.5;

/// How the rooms found their places.
#[derive(Debug, Clone, PartialEq)]
pub enum How {
    /// On a layout.
    Layout(Assignment),
    /// By their doors.
    Doors(Ranking),
}

/// A home with how it came about.
#[derive(Debug, Clone)]
pub struct Built {
    /// The home, with conflicts between rooms and doors.
    pub home: Home,
    /// How the rooms found their places.
    pub how: How,
    /// Half the chi-square of walls, doors and heights before and after refinement.
    pub cost: [f64; 2],
}

/// Builds a home.
///
/// # Errors
/// Runs that do not go together with the layout, or rooms that nothing joins.
pub fn build(layout: Option<&HomeLayout>, runs: Vec<RoomRun>) -> Result<Built, HomeError> {
    if runs.is_empty() {
        return Err(HomeError::Rooms { why: "no run is named".to_owned() });
    }
    let mut built = match layout {
        Some(layout) => on_layout(layout, runs)?,
        None => by_doors(runs)?,
    };
    built.home.find_conflicts();
    crate::merge::find_strays(&mut built.home);
    Ok(built)
}

/// How far a run's door is off its place in the home along the wall, metres.
fn off(evidence: &Evidence, place: &Place, door: usize, side: Wall, range: &[f64; 2]) -> f64 {
    let own = door_range(evidence, place, door, side);
    f64::midpoint(own[0], own[1]) - f64::midpoint(range[0], range[1])
}

fn on_layout(layout: &HomeLayout, runs: Vec<RoomRun>) -> Result<Built, HomeError> {
    let assignment = assign(layout, &runs)?;
    let mut of_room: Vec<Option<(RoomRun, Evidence, QuarterTurn)>> = vec![None; layout.rooms.len()];
    for (run, assigned) in runs.into_iter().zip(&assignment.runs) {
        let evidence = run.evidence();
        of_room[assigned.room] = Some((run, evidence, assigned.turn));
    }
    let with: Vec<usize> = (0..of_room.len()).filter(|k| of_room[*k].is_some()).collect();
    let rooms: Vec<RoomIn<'_>> = with
        .iter()
        .filter_map(|k| {
            let (_, evidence, turn) = of_room[*k].as_ref()?;
            let wanted = &layout.rooms[*k];
            let rect = wanted.bounds();
            Some(RoomIn {
                evidence,
                turn: *turn,
                rect: Some(rect),
                height: wanted.height,
                floor: wanted.floor,
                at: rect.centre(),
            })
        })
        .collect();
    let before = unrefined(&rooms);
    let at = |room: usize| with.iter().position(|k| *k == room);
    let known: Vec<Option<(&Evidence, Solved)>> =
        (0..of_room.len()).map(|k| at(k).map(|i| (rooms[i].evidence, before[i]))).collect();
    let all = joints(layout, &known);
    let inner = |joint: &Joint| Joint {
        seats: joint.seats.iter().filter_map(|s| Some(Seat { room: at(s.room)?, ..*s })).collect(),
        layout: joint.layout,
    };
    let problem = Problem {
        joints: all.iter().map(inner).collect(),
        walls: Vec::new(),
        sigmas: Sigmas::default(),
        rooms: rooms.clone(),
    };
    let solution = problem.solve();
    let cost = [problem.unrefined_cost(), solution.cost];
    let heights: Vec<f64> = solution.rooms.iter().map(|r| r.height).collect();
    let usual = if heights.is_empty() { USUAL_ROOM_M } else { heights.iter().sum::<f64>() / heights.len() as f64 };
    let doors = all
        .iter()
        .enumerate()
        .map(|(k, joint)| {
            let range = joint.layout.map(|(range, _)| range).expect("doors of a layout have a place");
            let of = |seat: &Seat, rooms_at: &[Solved]| {
                let i = at(seat.room)?;
                Some(off(rooms[i].evidence, &rooms_at[i].place, seat.door?, seat.side, &range))
            };
            let tops = joint.seats.iter().filter_map(|s| {
                let i = at(s.room)?;
                Some(rooms[i].evidence.doors[s.door?].top * solution.rooms[i].place.scale)
            });
            let tops: Vec<f64> = tops.collect();
            let seen_top = (!tops.is_empty()).then(|| tops.iter().sum::<f64>() / tops.len() as f64);
            HomeDoor {
                rooms: joint.seats.iter().map(|s| s.room).collect(),
                side: joint.seats[0].side,
                range,
                top: layout.doors[k].height.or(seen_top).unwrap_or(USUAL_DOOR_M),
                kind: layout.doors[k].kind,
                seen: joint
                    .seats
                    .iter()
                    .map(|s| {
                        let opening = rooms[at(s.room)?].evidence.doors[s.door?].opening;
                        Some((opening, of(s, &solution.rooms)?))
                    })
                    .collect(),
                before: joint.seats.iter().map(|s| of(s, &before)).collect(),
            }
        })
        .collect();
    let places: Vec<Option<(Solved, Solved)>> =
        (0..of_room.len()).map(|k| at(k).map(|i| (solution.rooms[i], before[i]))).collect();
    drop(problem);
    let home_rooms = of_room.into_iter().zip(places).zip(&layout.rooms).map(|((run, places), wanted)| {
        let rect = wanted.bounds();
        let empty = Solved {
            place: Place { turn: QuarterTurn::default(), yaw: 0.0, scale: 1.0, at: rect.centre(), floor: wanted.floor },
            rect,
            height: wanted.height.unwrap_or(usual),
        };
        let (solved, before) = places.unwrap_or((empty, empty));
        HomeRoom {
            name: wanted.name.clone(),
            run: run.map(|(run, evidence, _)| (run, evidence)),
            polygon: wanted.polygon.clone(),
            solved,
            before,
        }
    });
    let home = Home {
        rooms: home_rooms.collect(),
        doors,
        outer_wall: layout.outer_wall(),
        conflicts: Vec::new(),
        notes: Vec::new(),
    };
    Ok(Built { home, how: How::Layout(assignment), cost })
}

fn by_doors(mut runs: Vec<RoomRun>) -> Result<Built, HomeError> {
    make_names_unique(&mut runs);
    let (matched, ranking) = match_rooms(&runs)?;
    let evidence: Vec<Evidence> = runs.iter().map(RoomRun::evidence).collect();
    let problem = matching::problem(&evidence, &matched.turns, &matched.at, &matched.pairs);
    let before = unrefined(&problem.rooms);
    let cost = [problem.unrefined_cost(), matched.solution.cost];
    let solved = &matched.solution.rooms;
    let doors = matched
        .pairs
        .iter()
        .map(|pair| {
            let [(a, i), (b, j)] = *pair;
            let side = matched.turns[a].wall(evidence[a].doors[i].wall);
            let seats = [(a, i, side), (b, j, side.opposite())];
            let range = |rooms: &[Solved]| {
                let both = seats.map(|(r, d, s)| door_range(&evidence[r], &rooms[r].place, d, s));
                [f64::midpoint(both[0][0], both[1][0]), f64::midpoint(both[0][1], both[1][1])]
            };
            let (now, then) = (range(solved), range(&before));
            let top = |r: usize, d: usize| evidence[r].doors[d].top * solved[r].place.scale;
            HomeDoor {
                rooms: vec![a, b],
                side,
                range: now,
                top: f64::midpoint(top(a, i), top(b, j)),
                kind: DoorKind::Door,
                seen: seats
                    .iter()
                    .map(|(r, d, s)| {
                        Some((evidence[*r].doors[*d].opening, off(&evidence[*r], &solved[*r].place, *d, *s, &now)))
                    })
                    .collect(),
                before: seats
                    .iter()
                    .map(|(r, d, s)| Some(off(&evidence[*r], &before[*r].place, *d, *s, &then)))
                    .collect(),
            }
        })
        .collect();
    let places: Vec<(Solved, Solved)> = solved.iter().copied().zip(before).collect();
    let rooms = runs.into_iter().zip(evidence).zip(places).map(|((run, evidence), (solved, before))| HomeRoom {
        name: run.name.clone(),
        run: Some((run, evidence)),
        polygon: Vec::new(),
        solved,
        before,
    });
    let mut notes = Vec::new();
    if ranking.next < matching::SURE_NATS {
        notes.push(format!(
            "another layout fits nearly as well ({:.1} nats behind): {}; a floor plan given with --layout decides",
            ranking.next,
            ranking.next_doors.join(", ")
        ));
    }
    let home = Home { rooms: rooms.collect(), doors, outer_wall: USUAL_WALL_M, conflicts: Vec::new(), notes };
    Ok(Built { home, how: How::Doors(ranking), cost })
}
