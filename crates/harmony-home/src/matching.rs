//! Rooms joined by their doors, where no layout says how.
//!
//! # Idea
//! A door seen from one room is a door of another: of the same width and height, in walls that face each other, a wall's
//! thickness apart. A pair of doors places one room beside another, turn included, for rooms have walls along the axes. All
//! ways to join the rooms as a tree are searched with a beam; the best are closed (further doors that meet), refined
//! together ([`crate::solve`]) and ranked by one energy in nats.
//!
//! # Limits
//! Doors alike make layouts alike: how much the next best one costs is told, and below [`SURE_NATS`] nothing but a floor
//! plan decides.

use std::collections::BTreeSet;

use glam::DVec2;
use serde::Serialize;

use crate::HomeError;
use crate::frame::{Rect, sides};
use crate::layout::{USUAL_WALL_M, outward};
use crate::rooms::{Evidence, RoomRun, flat};
use crate::solve::{BackToBack, Joint, Problem, RoomIn, Seat, Sigmas, Solution, anchored, door_range};
use harmony_scene::{OpeningKind, QuarterTurn, Wall};

/// Below this the next best layout is nearly as good, nats.
pub const SURE_NATS: f64 = 2.0;
/// Widths of one door seen from two rooms, relative.
const WIDTH: f64 = 0.05;
/// Heights of one door, relative.
const TOP: f64 = 0.03;
/// A door that meets none: it leads out, or into a room without a photo, nats.
const ALONE: f64 = 3.0;
/// A window into another room, nats.
const INNER_WINDOW: f64 = 3.0;
/// Rooms that share floor, metres: walls that were seen are this sure.
const OVERLAP_M: f64 = 0.1;
/// The same of walls that were not seen, as a share of the room.
const OVERLAP_SHARE: f64 = 0.2;
/// Share of a home's bounding rectangle that is no room.
const WASTE: f64 = 0.25;
/// Layouts kept at every step of the search.
const BEAM: usize = 400;
/// Layouts that are refined.
const REFINED: usize = 16;
/// Most rooms.
pub const MAX_ROOMS: usize = 8;

/// Two doors taken for one: room and number in its evidence, each.
pub type Pair = [(usize, usize); 2];

/// A way to join the rooms, refined.
#[derive(Debug, Clone)]
pub struct Matched {
    /// How each room is turned; the first is not.
    pub turns: Vec<QuarterTurn>,
    /// Where each was before refinement.
    pub at: Vec<DVec2>,
    /// Doors taken for one.
    pub pairs: Vec<Pair>,
    /// The refined rooms.
    pub solution: Solution,
    /// Its energy, nats.
    pub energy: f64,
}

/// What the search says of its choice.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ranking {
    /// Energy of the layout, nats.
    pub energy: f64,
    /// How much more the next best one costs; infinite where there is none.
    pub next: f64,
    /// The doors that the next best one joins, as `room - room`.
    pub next_doors: Vec<String>,
}

#[derive(Debug, Clone)]
struct Tree {
    turns: Vec<Option<QuarterTurn>>,
    at: Vec<DVec2>,
    pairs: Vec<Pair>,
    energy: f64,
}

struct Search<'a> {
    runs: &'a [RoomRun],
    evidence: &'a [Evidence],
}

fn nats(off: f64) -> f64 {
    0.5 * off * off
}

/// The rectangle of a room as its run has it.
fn rect_of(evidence: &Evidence, turn: QuarterTurn, at: DVec2) -> Rect {
    let half = sides(turn, &evidence.extents) / 2.0;
    Rect { min: at - half, max: at + half }
}

impl Search<'_> {
    /// How unlike two doors are.
    fn unlike(&self, pair: &Pair) -> f64 {
        let [a, b] = pair.map(|(room, door)| &self.evidence[room].doors[door]);
        nats((a.width() / b.width()).ln() / (WIDTH * std::f64::consts::SQRT_2)).min(6.0)
            + nats((a.top / b.top).ln() / (TOP * std::f64::consts::SQRT_2)).min(6.0)
    }

    /// What sharing floor costs two rooms.
    fn overlap(&self, rects: [(usize, QuarterTurn, Rect); 2]) -> f64 {
        let [(_, _, a), (_, _, b)] = &rects;
        let Some(met) = a.meet(b) else { return 0.0 };
        let axis = usize::from(met.size().y < met.size().x);
        let sides = if axis == 0 { [Wall::Left, Wall::Right] } else { [Wall::Back, Wall::Front] };
        let mut sigma = OVERLAP_M;
        for (room, turn, rect) in &rects {
            let yields = sides.iter().any(|s| {
                let within =
                    (rect.side(*s) - met.min[axis]).abs() < 1e-9 || (rect.side(*s) - met.max[axis]).abs() < 1e-9;
                within && !self.evidence[*room].sees(turn.inverse().wall(*s).surface())
            });
            if yields {
                sigma = sigma.hypot(OVERLAP_SHARE * rect.size()[axis]);
            }
        }
        nats(met.size()[axis] / sigma)
    }

    fn grown(&self, tree: &Tree) -> Vec<Tree> {
        let mut out = Vec::new();
        let used = |room: usize, door: usize| tree.pairs.iter().flatten().any(|p| *p == (room, door));
        for (a, turn) in tree.turns.iter().enumerate().filter_map(|(a, t)| Some((a, (*t)?))) {
            for (i, door) in self.evidence[a].doors.iter().enumerate().filter(|(i, _)| !used(a, *i)) {
                let side = turn.wall(door.wall);
                let middle = |room: usize, k: usize| {
                    let d = &self.evidence[room].doors[k];
                    d.wall.point(&self.evidence[room].extents, f64::midpoint(d.u[0], d.u[1]), 0.0)
                };
                let zero = anchored(&self.evidence[a], turn, middle(a, i), DVec2::ZERO);
                let way = tree.at[a] - zero + flat(-side.normal()) * USUAL_WALL_M;
                for b in (0..self.evidence.len()).filter(|b| tree.turns[*b].is_none()) {
                    for (j, other) in self.evidence[b].doors.iter().enumerate() {
                        let pair = [(a, i), (b, j)];
                        let turn_b = QuarterTurn::bringing(other.wall, side.opposite());
                        let at = anchored(&self.evidence[b], turn_b, middle(b, j), way);
                        let rect = rect_of(&self.evidence[b], turn_b, at);
                        let placed = tree.turns.iter().enumerate().filter_map(|(c, t)| Some((c, (*t)?)));
                        let overlap: f64 = placed
                            .map(|(c, t)| {
                                self.overlap([(c, t, rect_of(&self.evidence[c], t, tree.at[c])), (b, turn_b, rect)])
                            })
                            .sum();
                        let mut next = tree.clone();
                        next.turns[b] = Some(turn_b);
                        next.at[b] = at;
                        next.pairs.push(pair);
                        next.energy += self.unlike(&pair) + overlap;
                        out.push(next);
                    }
                }
            }
        }
        out
    }

    fn trees(&self) -> Vec<Tree> {
        let count = self.evidence.len();
        let mut turns = vec![None; count];
        turns[0] = Some(QuarterTurn::default());
        let mut beam = vec![Tree { turns, at: vec![DVec2::ZERO; count], pairs: Vec::new(), energy: 0.0 }];
        for _ in 1..count {
            let mut next: Vec<Tree> = beam.iter().flat_map(|t| self.grown(t)).collect();
            next.sort_by(|a, b| a.energy.total_cmp(&b.energy));
            let mut known = BTreeSet::new();
            next.retain(|t| known.insert(key(&t.pairs)));
            next.truncate(BEAM);
            beam = next;
        }
        beam
    }

    /// Doors that meet although the tree does not need them.
    fn closed(&self, tree: &Tree) -> Vec<Pair> {
        let mut pairs = tree.pairs.clone();
        let used = |pairs: &[Pair], p: (usize, usize)| pairs.iter().flatten().any(|q| *q == p);
        let turn = |r: usize| tree.turns[r].unwrap_or_default();
        for a in 0..self.evidence.len() {
            for b in a + 1..self.evidence.len() {
                for i in 0..self.evidence[a].doors.len() {
                    for j in 0..self.evidence[b].doors.len() {
                        let pair = [(a, i), (b, j)];
                        if used(&pairs, (a, i)) || used(&pairs, (b, j)) || self.unlike(&pair) > 6.0 {
                            continue;
                        }
                        let side = turn(a).wall(self.evidence[a].doors[i].wall);
                        if turn(b).wall(self.evidence[b].doors[j].wall) != side.opposite() {
                            continue;
                        }
                        let rooms = [a, b].map(|r| rect_of(&self.evidence[r], turn(r), tree.at[r]));
                        let gap = (rooms[1].side(side.opposite()) - rooms[0].side(side)) * outward(side);
                        let place = |r: usize| crate::frame::Place {
                            turn: turn(r),
                            yaw: 0.0,
                            scale: 1.0,
                            at: tree.at[r],
                            floor: 0.0,
                        };
                        let ranges = [
                            door_range(&self.evidence[a], &place(a), i, side),
                            door_range(&self.evidence[b], &place(b), j, side.opposite()),
                        ];
                        let off = (ranges[0][0] + ranges[0][1] - ranges[1][0] - ranges[1][1]).abs() / 2.0;
                        if (-0.5..0.8).contains(&gap) && off < 0.6 {
                            pairs.push(pair);
                        }
                    }
                }
            }
        }
        pairs
    }

    fn refined(&self, tree: &Tree) -> Matched {
        let turns: Vec<QuarterTurn> = tree.turns.iter().map(|t| t.unwrap_or_default()).collect();
        let pairs = self.closed(tree);
        let (solution, _) = solve(self.evidence, &turns, &tree.at, &pairs);
        let rect = |r: usize| solution.rooms[r].rect;
        let count = self.evidence.len();
        let doors: usize = self.evidence.iter().map(|e| e.doors.len()).sum();
        let mut energy = solution.cost + (doors - 2 * pairs.len()) as f64 * ALONE;
        for a in 0..count {
            for b in a + 1..count {
                energy += self.overlap([(a, turns[a], rect(a)), (b, turns[b], rect(b))]);
            }
            let windows = self.runs[a].world.scene.room.openings.iter().filter(|o| o.kind == OpeningKind::Window);
            for window in windows {
                let side = turns[a].wall(window.wall);
                let e = &self.evidence[a].extents;
                let middle = window.wall.point(e, f64::midpoint(window.u[0], window.u[1]), 0.0);
                let behind =
                    flat(solution.rooms[a].place.point(e, middle)) - flat(side.normal()) * (USUAL_WALL_M + 0.3);
                if (0..count).any(|b| b != a && rect(b).contains(behind, 0.0)) {
                    energy += INNER_WINDOW;
                }
            }
        }
        let all = (1..count).fold(rect(0), |r, k| r.around(&rect(k)));
        let rooms: f64 = (0..count).map(|r| rect(r).grown(USUAL_WALL_M / 2.0).area()).sum();
        energy += nats((1.0 - rooms / all.grown(USUAL_WALL_M / 2.0).area()).max(0.0) / WASTE);
        Matched { turns, at: tree.at.clone(), pairs, solution, energy }
    }
}

/// Joined doors in an order of their own.
fn key(pairs: &[Pair]) -> Vec<Pair> {
    let mut sorted: Vec<Pair> = pairs.iter().map(|[a, b]| if a < b { [*a, *b] } else { [*b, *a] }).collect();
    sorted.sort_unstable();
    sorted
}

/// The problem of rooms joined by doors.
pub(crate) fn problem<'a>(
    evidence: &'a [Evidence],
    turns: &[QuarterTurn],
    at: &[DVec2],
    pairs: &[Pair],
) -> Problem<'a> {
    let rooms = evidence.iter().enumerate().map(|(k, evidence)| RoomIn {
        evidence,
        turn: turns[k],
        rect: None,
        height: None,
        floor: 0.0,
        at: at[k],
    });
    let side = |(room, door): (usize, usize)| turns[room].wall(evidence[room].doors[door].wall);
    let joints = pairs.iter().map(|pair| Joint {
        seats: pair
            .iter()
            .map(|(room, door)| Seat { room: *room, door: Some(*door), side: side((*room, *door)) })
            .collect(),
        layout: None,
    });
    let walls = pairs.iter().map(|[a, b]| BackToBack { rooms: [a.0, b.0], side: side(*a), sure: true });
    Problem { rooms: rooms.collect(), joints: joints.collect(), walls: walls.collect(), sigmas: Sigmas::default() }
}

/// Refines rooms joined by doors: first these alone, then with walls that came to stand back to back.
pub(crate) fn solve(
    evidence: &[Evidence],
    turns: &[QuarterTurn],
    at: &[DVec2],
    pairs: &[Pair],
) -> (Solution, Vec<BackToBack>) {
    let mut problem = problem(evidence, turns, at, pairs);
    let first = problem.solve();
    for a in 0..evidence.len() {
        for b in 0..evidence.len() {
            for side in [Wall::Right, Wall::Front] {
                let (ra, rb) = (&first.rooms[a].rect, &first.rooms[b].rect);
                let known = |w: &BackToBack| {
                    w.rooms == [a, b] && w.side == side || w.rooms == [b, a] && w.side == side.opposite()
                };
                if a == b || problem.walls.iter().any(known) {
                    continue;
                }
                let gap = rb.side(side.opposite()) - ra.side(side);
                let ([a0, a1], [b0, b1]) = (ra.along(side), rb.along(side));
                let common = a1.min(b1) - a0.max(b0);
                let sees = |r: usize, s: Wall| evidence[r].sees(turns[r].inverse().wall(s).surface());
                let near = if sees(a, side) && sees(b, side.opposite()) { 0.25 } else { 0.6 };
                if (gap - USUAL_WALL_M).abs() < near && common > 0.8 {
                    problem.walls.push(BackToBack { rooms: [a, b], side, sure: false });
                }
            }
        }
    }
    let found = problem.solve();
    (found, problem.walls)
}

/// Joins rooms by their doors: the best way, and how it stands to the next best.
///
/// # Errors
/// A room without a door that fits, more rooms than are searched.
pub fn match_rooms(runs: &[RoomRun]) -> Result<(Matched, Ranking), HomeError> {
    if runs.len() > MAX_ROOMS {
        let why = format!("{} rooms; without a layout {MAX_ROOMS} at most are joined", runs.len());
        return Err(HomeError::Rooms { why });
    }
    let evidence: Vec<Evidence> = runs.iter().map(RoomRun::evidence).collect();
    if let Some(k) = evidence.iter().position(|e| e.doors.is_empty()).filter(|_| runs.len() > 1) {
        return Err(HomeError::Apart { room: runs[k].name.clone() });
    }
    let search = Search { runs, evidence: &evidence };
    let trees = search.trees();
    let mut refined: Vec<Matched> = trees.iter().take(REFINED).map(|t| search.refined(t)).collect();
    refined.sort_by(|a, b| a.energy.total_cmp(&b.energy));
    let Some(best) = refined.first().cloned() else {
        return Err(HomeError::Apart { room: runs.last().map_or_else(String::new, |r| r.name.clone()) });
    };
    let other = refined.iter().find(|m| key(&m.pairs) != key(&best.pairs));
    let named = |pair: &Pair| {
        let [a, b] = pair.map(|(r, _)| runs[r].name.as_str());
        format!("{a} - {b}")
    };
    let ranking = Ranking {
        energy: best.energy,
        next: other.map_or(f64::INFINITY, |m| m.energy - best.energy),
        next_doors: other.map(|m| m.pairs.iter().map(named).collect()).unwrap_or_default(),
    };
    Ok((best, ranking))
}
