//! A floor plan from a seed: a rectangle cut into rooms, doors between neighbours, and where each photo was taken.

use glam::DVec2;
use harmony_home::frame::{Rect, in_room, sides};
use harmony_home::layout::{DoorKind, HomeLayout, LAYOUT_VERSION, LayoutDoor, LayoutRoom, Unit};
use harmony_scene::{Extents, QuarterTurn, Wall};

use crate::generate::{FixedDoor, FixedRoom, RoomKind};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Shortest and longest sides of rooms, metres.
const SIDES: [f64; 2] = [2.9, 5.6];
/// Floor plans tried until one has rooms of such sides.
const TRIES: usize = 400;
/// Least free wall on both sides of a door, metres.
const BESIDE: f64 = 0.12;

/// A room of a floor plan.
#[derive(Debug, Clone)]
pub struct PlannedRoom {
    /// Its name.
    pub name: String,
    /// What it is for.
    pub kind: RoomKind,
    /// How its photo is turned in the home.
    pub turn: QuarterTurn,
    /// What the home asks of it, in its own frame.
    pub fixed: FixedRoom,
}

/// A floor plan: the layout, and what its photos show of it.
#[derive(Debug, Clone)]
pub struct HomePlan {
    /// `home_000007`.
    pub name: String,
    /// As a user would give it.
    pub layout: HomeLayout,
    /// Rooms in the order of the layout.
    pub rooms: Vec<PlannedRoom>,
}

/// Two rooms with a wall in common.
#[derive(Debug, Clone, Copy)]
struct Shared {
    rooms: [usize; 2],
    /// Of the first.
    side: Wall,
    /// What of the wall both have, along it.
    along: [f64; 2],
}

struct Dice(ChaCha8Rng);

impl Dice {
    fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    fn int(&mut self, low: usize, high: usize) -> usize {
        self.0.random_range(low..=high)
    }

    fn round(&mut self, low: f64, high: f64) -> f64 {
        (self.range(low, high) * 100.0).round() / 100.0
    }
}

/// Makes the floor plan of a seed, with 2 to 5 rooms; `rooms` asks for so many.
pub fn plan(seed: u64, rooms: Option<usize>) -> HomePlan {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(seed ^ 0x686f_6d65));
    let count = rooms.map_or_else(|| dice.int(2, 5), |n| n.clamp(2, 5));
    let wall = [0.1, 0.12, 0.15, 0.2][dice.int(0, 3)];
    let mut found = None;
    for _ in 0..TRIES {
        let rects = cut(&mut dice, count, wall);
        let shared = shared(&rects, wall);
        let sides = rects.iter().flat_map(|r| r.size().to_array());
        if !sides.into_iter().all(|s| (SIDES[0]..=SIDES[1]).contains(&s)) {
            continue;
        }
        if let Some(tree) = tree(&mut dice, count, &shared) {
            found = Some((rects, tree));
            break;
        }
    }
    let (rects, tree) = found.unwrap_or_else(|| row(count, wall));
    furnished(seed, &mut dice, &rects, &tree, wall)
}

/// Rooms in a row, should no cut succeed.
fn row(count: usize, wall: f64) -> (Vec<Rect>, Vec<Shared>) {
    let at = |k: usize| DVec2::new(k as f64 * (4.0 + wall), 0.0);
    let rects: Vec<Rect> = (0..count).map(|k| Rect { min: at(k), max: at(k) + DVec2::splat(4.0) }).collect();
    let all = shared(&rects, wall);
    (rects, all)
}

/// A rectangle cut into so many rooms, with walls between them.
fn cut(dice: &mut Dice, count: usize, wall: f64) -> Vec<Rect> {
    let area = count as f64 * dice.range(13.0, 19.0);
    let shape = dice.range(0.7, 1.5);
    let size = DVec2::new((area * shape).sqrt(), (area / shape).sqrt());
    let round = |v: DVec2| (v * 100.0).round() / 100.0;
    let mut rects = vec![(Rect { min: DVec2::ZERO, max: round(size) }, count)];
    let mut done = Vec::new();
    while let Some((rect, n)) = rects.pop() {
        if n == 1 {
            done.push(rect);
            continue;
        }
        let first = dice.int(1, n - 1);
        let size = rect.size();
        let axis = usize::from(size.y > size.x);
        let share = first as f64 / n as f64 * dice.range(0.85, 1.15);
        let at = ((rect.min[axis] + size[axis] * share.clamp(0.25, 0.75)) * 100.0).round() / 100.0;
        let (mut low, mut high) = (rect, rect);
        low.max[axis] = at;
        high.min[axis] = at + wall;
        rects.push((low, first));
        rects.push((high, n - first));
    }
    done.sort_by(|a, b| a.min.y.total_cmp(&b.min.y).then(a.min.x.total_cmp(&b.min.x)));
    done
}

/// Walls between two rooms that have room for a door.
fn shared(rects: &[Rect], wall: f64) -> Vec<Shared> {
    let mut out = Vec::new();
    for (i, a) in rects.iter().enumerate() {
        for (j, b) in rects.iter().enumerate().skip(i + 1) {
            for side in Wall::ALL {
                let gap = (b.side(side.opposite()) - a.side(side)).abs();
                let ([a0, a1], [b0, b1]) = (a.along(side), b.along(side));
                let along = [a0.max(b0), a1.min(b1)];
                let faces = matches!(side, Wall::Right | Wall::Front) == (b.side(side.opposite()) > a.side(side));
                if (gap - wall).abs() < 1e-6 && faces && along[1] - along[0] > 1.6 {
                    out.push(Shared { rooms: [i, j], side, along });
                }
            }
        }
    }
    out
}

/// Walls that join all rooms, and now and then one more; `None` when rooms have no neighbour or sides of no room.
fn tree(dice: &mut Dice, count: usize, shared: &[Shared]) -> Option<Vec<Shared>> {
    let mut order: Vec<usize> = (0..shared.len()).collect();
    for k in (1..order.len()).rev() {
        order.swap(k, dice.int(0, k));
    }
    let mut group: Vec<usize> = (0..count).collect();
    let mut out = Vec::new();
    let more = dice.range(0.0, 1.0) < 0.3;
    let mut spare = None;
    for k in order {
        let [a, b] = shared[k].rooms.map(|r| group[r]);
        if a == b {
            spare = Some(shared[k]);
            continue;
        }
        group.iter_mut().filter(|g| **g == b).for_each(|g| *g = a);
        out.push(shared[k]);
    }
    out.extend(spare.filter(|_| more));
    (out.len() + 1 >= count && group.iter().all(|g| *g == group[0])).then_some(out)
}

/// How well a door is seen in a room's photo, from its wall and its middle along it.
fn seen(wall: Wall, u: f64, e: &Extents) -> f64 {
    match wall {
        Wall::Back => 2.0,
        Wall::Front => -3.0,
        // Side walls are in view in their far part.
        Wall::Left | Wall::Right => 1.5 - 2.0 * (u / e.depth - 0.4).max(0.0),
    }
}

fn furnished(seed: u64, dice: &mut Dice, rects: &[Rect], tree: &[Shared], wall: f64) -> HomePlan {
    let height = dice.round(2.35, 2.9);
    let extents = |rect: &Rect, turn: QuarterTurn| {
        let s = sides(turn, &Extents { width: rect.size().x, height, depth: rect.size().y });
        Extents { width: s.x, height, depth: s.y }
    };
    // A photo from where most doors are in view.
    let turns: Vec<QuarterTurn> = (0..rects.len())
        .map(|r| {
            let worth = |turn: &QuarterTurn| {
                let sides = tree.iter().filter(|s| s.rooms.contains(&r));
                sides
                    .map(|s| {
                        let side = if s.rooms[0] == r { s.side } else { s.side.opposite() };
                        let (w, u) = in_room(&rects[r], *turn, side, f64::midpoint(s.along[0], s.along[1]));
                        seen(w, u, &extents(&rects[r], *turn))
                    })
                    .sum::<f64>()
            };
            let jitter: Vec<f64> = QuarterTurn::ALL.iter().map(|_| dice.range(0.0, 0.5)).collect();
            let value = |k: usize| worth(&QuarterTurn::ALL[k]) + jitter[k];
            QuarterTurn::ALL[(0..4).max_by(|a, b| value(*a).total_cmp(&value(*b))).unwrap_or(0)]
        })
        .collect();
    let kinds: Vec<RoomKind> = rects.iter().map(|r| kind(dice, r)).collect();
    let names = names(&kinds);
    let mut doors = Vec::new();
    let mut fixed: Vec<Vec<FixedDoor>> = vec![Vec::new(); rects.len()];
    for s in tree {
        let (width, tall) = (dice.round(0.82, 0.95), dice.round(2.0, 2.1));
        let [low, high] = [s.along[0] + width / 2.0 + BESIDE, s.along[1] - width / 2.0 - BESIDE];
        let places: Vec<f64> = (0..12).map(|_| dice.round(low, high)).collect();
        let worth = |at: &f64| {
            let of = |r: usize, side: Wall| {
                let (w, u) = in_room(&rects[r], turns[r], side, *at);
                seen(w, u, &extents(&rects[r], turns[r]))
            };
            of(s.rooms[0], s.side) + of(s.rooms[1], s.side.opposite())
        };
        let clear = |at: &f64| {
            let of = |r: usize, side: Wall| {
                let (w, u) = in_room(&rects[r], turns[r], side, *at);
                fixed[r].iter().all(|d| d.wall != w || (d.u - u).abs() > 1.2)
            };
            of(s.rooms[0], s.side) && of(s.rooms[1], s.side.opposite())
        };
        let best = places.iter().copied().filter(clear).max_by(|a, b| worth(a).total_cmp(&worth(b)));
        let at = best.unwrap_or(places[0]);
        for (r, side) in [(s.rooms[0], s.side), (s.rooms[1], s.side.opposite())] {
            let (wall, u) = in_room(&rects[r], turns[r], side, at);
            fixed[r].push(FixedDoor { wall, u, width, height: tall });
        }
        let out = f64::midpoint(rects[s.rooms[0]].side(s.side), rects[s.rooms[1]].side(s.side.opposite()));
        let at = if matches!(s.side, Wall::Left | Wall::Right) { DVec2::new(out, at) } else { DVec2::new(at, out) };
        let rooms = s.rooms.map(|r| names[r].clone()).to_vec();
        doors.push(LayoutDoor { rooms, at, width, height: Some(tall), kind: DoorKind::Door });
    }
    let all = rects.iter().skip(1).fold(rects[0], |a, b| a.around(b));
    let rooms = (0..rects.len()).map(|r| {
        let outside = Wall::ALL.into_iter().filter(|w| {
            let side = turns[r].wall(*w);
            *w != Wall::Front && (all.side(side) - rects[r].side(side)).abs() < 1e-9
        });
        PlannedRoom {
            name: names[r].clone(),
            kind: kinds[r],
            turn: turns[r],
            fixed: FixedRoom {
                extents: extents(&rects[r], turns[r]),
                doors: fixed[r].clone(),
                outside: outside.collect(),
            },
        }
    });
    let layout = HomeLayout {
        version: LAYOUT_VERSION,
        unit: Unit::Metre,
        wall_thickness: Some(wall),
        rooms: (0..rects.len())
            .map(|r| LayoutRoom {
                name: names[r].clone(),
                rectangle: Some(rects[r]),
                polygon: Vec::new(),
                height: Some(height),
                floor: 0.0,
                photo_faces: None,
            })
            .collect(),
        doors,
    };
    HomePlan { name: format!("home_{seed:06}"), rooms: rooms.collect(), layout }
}

/// A use that a room of this size may have.
fn kind(dice: &mut Dice, rect: &Rect) -> RoomKind {
    let small = rect.size().min_element();
    let fits: Vec<RoomKind> = match small {
        s if s < 3.2 => vec![RoomKind::Kitchen, RoomKind::HomeOffice, RoomKind::Study, RoomKind::Bathroom],
        s if s < 3.8 => vec![RoomKind::Bedroom, RoomKind::Kitchen, RoomKind::HomeOffice, RoomKind::KidsRoom],
        _ => vec![RoomKind::LivingRoom, RoomKind::Bedroom, RoomKind::DiningRoom],
    };
    fits[dice.int(0, fits.len() - 1)]
}

fn names(kinds: &[RoomKind]) -> Vec<String> {
    let name = |kind: &RoomKind| match kind {
        RoomKind::Bedroom => "bedroom",
        RoomKind::LivingRoom => "living_room",
        RoomKind::DiningRoom => "dining_room",
        RoomKind::HomeOffice => "home_office",
        RoomKind::Kitchen => "kitchen",
        RoomKind::Study => "study",
        RoomKind::Bathroom => "bathroom",
        RoomKind::KidsRoom => "kids_room",
    };
    (0..kinds.len())
        .map(|k| {
            let before = kinds[..k].iter().filter(|o| **o == kinds[k]).count();
            if before == 0 { name(&kinds[k]).to_owned() } else { format!("{}_{}", name(&kinds[k]), before + 1) }
        })
        .collect()
}
