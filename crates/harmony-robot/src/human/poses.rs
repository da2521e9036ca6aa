//! Postures: what a frame of a humanoid asks for, and the search for it.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::body::{Body, Stance};
use super::{Desk, HANDS_M};
use crate::ik::{Found, Goal, Settings, Task, solve};
use crate::measure::{Chair, Window};
use crate::model::{Model, Posture, upright};
use crate::motion::Frame;
use crate::room::{Other, Shapes, Surroundings};

/// Offsets of the hands from the middle of the chair and the desk that are tried, metres.
const ASIDE_M: [f64; 4] = [0.22, 0.18, 0.27, 0.14];

/// A gap above this is closed in more than one round, metres.
const ROUND_M: f64 = 0.05;

/// The room turned into the chair's: `front` is where one looks who sits on it.
#[derive(Clone)]
pub(super) struct Plan<'a> {
    pub(super) room: &'a Surroundings,
    /// As its file has it.
    pub(super) whole: &'a Model,
    /// As it is moved: see [`super::body::like_a_person`].
    pub(super) model: &'a Model,
    pub(super) shapes: &'a Arc<Shapes>,
    pub(super) body: &'a Body,
    pub(super) object: usize,
    pub(super) chair: Chair,
    pub(super) front: DVec3,
    /// How far the chair is drawn.
    pub(super) draw: f64,
    pub(super) easy: Vec<f64>,
    /// From where the first frame is sought.
    pub(super) first: Option<Posture>,
    pub(super) frames: Vec<Frame>,
    pub(super) feet: [Stance; 2],
    /// How much higher than at first the pelvis is.
    pub(super) rise: f64,
}

/// What is wanted of a frame besides the feet.
#[derive(Clone)]
pub(super) struct Want {
    /// Where the pelvis is.
    pub(super) pelvis: DVec3,
    /// Its level: 1 where it decides, 3 where it follows.
    pub(super) level: usize,
    pub(super) facing: DVec3,
    /// Lean forward, radians.
    pub(super) lean: f64,
    pub(super) hands: Option<[DVec3; 2]>,
    /// Whether the hands are only on their way there.
    pub(super) passing: bool,
    pub(super) balance: bool,
}

impl Plan<'_> {
    /// Middle of the hip axes, the pelvis' frame.
    pub(super) fn hip_axes(&self) -> DVec3 {
        DVec3::new(self.body.hip.x, 0.0, self.body.hip.z)
    }

    /// Where a foot's ankle is.
    pub(super) fn ankle(&self, foot: usize, stance: &Stance) -> DVec3 {
        let side = if foot == 0 { self.body.hip.y.abs() } else { -self.body.hip.y.abs() };
        stance.at + stance.left() * side + DVec3::Y * self.body.sole
    }

    /// A point from the middle of the drawn seat: towards the front, and to the left of who sits.
    pub(super) fn spot(&self, front: f64, left: f64) -> DVec3 {
        let c = self.chair.seat.centre + self.chair.back * self.draw;
        let p = c + self.front * front + self.chair.left * left;
        DVec3::new(p.x, 0.0, p.z)
    }

    pub(super) fn solve(&self, start: &Posture, want: &Want) -> Found {
        self.solve_near(start, want, &self.easy)
    }

    /// With another easy posture.
    pub(super) fn solve_near(&self, start: &Posture, want: &Want, easy: &[f64]) -> Found {
        let mut tasks = Vec::new();
        for (k, link) in self.body.feet.into_iter().enumerate() {
            let stance = &self.feet[k];
            tasks.push(Task::new(0, Goal::Point { link, point: DVec3::ZERO, target: self.ankle(k, stance) }));
            tasks.push(Task::new(0, Goal::Turn { link, target: upright(DVec3::ZERO, stance.facing).matrix3 }));
        }
        // The pelvis is held where its hip axes are: it may lean about them.
        let hip = self.hip_axes();
        let level = upright(DVec3::ZERO, want.facing).matrix3;
        let hips = want.pelvis + level * hip;
        tasks.push(Task::new(want.level, Goal::Point { link: 0, point: hip, target: hips }));
        if let Some(hands) = want.hands {
            for (k, target) in hands.into_iter().enumerate() {
                tasks.push(Task::new(2, Goal::Point { link: self.body.hands[k], point: self.body.palm, target }));
            }
        }
        if want.balance {
            let target = self.middle();
            tasks.push(Task::weighted(3, Goal::CentreOfMass { target }, DVec3::ONE));
        }
        let leaning = level * DMat3::from_rotation_y(want.lean);
        tasks.push(Task::weighted(4, Goal::Turn { link: 0, target: leaning }, DVec3::splat(0.5)));
        tasks.push(Task::new(5, Goal::Joints { target: easy.to_vec() }));
        let must = if want.hands.is_some() && !want.passing { 3 } else { 1 + usize::from(want.level == 1) };
        solve(self.model, start, &tasks, &Settings { steps: 150, must, tolerance: 1e-5 })
    }

    /// Middle of the feet's soles.
    pub(super) fn middle(&self) -> DVec3 {
        let along = f64::midpoint(self.body.foot[0], self.body.foot[1]);
        (0..2).map(|k| self.ankle(k, &self.feet[k]) + self.feet[k].facing * along).sum::<DVec3>() / 2.0
    }

    pub(super) fn upright_at(&self, stance: &Stance) -> Want {
        Want {
            pelvis: stance.at + DVec3::Y * (self.body.standing() + self.rise),
            level: 1,
            facing: stance.facing,
            lean: 0.0,
            hands: None,
            passing: false,
            balance: false,
        }
    }

    /// Distance of one link to a thing where it is in a frame.
    pub(super) fn gap(&self, posture: &Posture, links: &[usize], thing: usize, moved: f64) -> f64 {
        let only = |l: usize, o: Other| links.contains(&l) && o == Other::Thing(thing);
        let moved = Some((self.object, DAffine3::from_translation(self.chair.back * moved)));
        self.room.nearest(self.shapes, &self.model.places(posture), moved, 0.3, &only).map_or(0.3, |n| n.distance)
    }

    /// Targets of both hands, each lowered or raised until its link lies on a thing.
    pub(super) fn lay(&self, start: &Posture, want: &Want, thing: usize, moved: f64) -> (Want, Found) {
        let mut want = want.clone();
        let mut found = self.solve(start, &want);
        for _ in 0..14 {
            // Out of reach by more than a round moves a hand.
            if found.error > ROUND_M {
                break;
            }
            let gaps = self.body.hands.map(|h| self.gap(&found.posture, &[h], thing, moved) - 0.001);
            if let Some(hands) = &mut want.hands {
                for (h, gap) in hands.iter_mut().zip(gaps) {
                    // Not all of it: what is nearest may be the forearm, which a lower hand tilts.
                    h.y -= 0.6 * gap.clamp(-ROUND_M, ROUND_M);
                }
            }
            if gaps.iter().all(|g| g.abs() < 5e-4) {
                break;
            }
            found = self.solve(&found.posture, &want);
        }
        (want, found)
    }

    /// Points on top of a thing for both hands, room, as it stands; the measured top.
    pub(super) fn tops(&self, thing: usize, at: DVec3, along: DVec3, across: DVec3, band: f64) -> Option<[DVec3; 2]> {
        ASIDE_M.into_iter().find_map(|aside| {
            let one = |sign: f64| -> Option<DVec3> {
                let origin = at + across * (sign * aside);
                let window = Window { origin, along, across, half_width: 0.02, from: -0.05 };
                let t = &self.room.things[thing];
                let top = window.top(t)?;
                let [a, b] = window.extent(t, [top - band, top])?;
                let p = origin + along * f64::midpoint(a, b);
                Some(DVec3::new(p.x, top, p.z))
            };
            Some([one(1.0)?, one(-1.0)?])
        })
    }

    /// Postures with both hands on the desk.
    pub(super) fn desk_hands(
        &self,
        desk: &Desk,
        seated: &Posture,
        pelvis: DVec3,
        seat: &Stance,
    ) -> Result<(Want, Found), String> {
        let thing = &self.room.things[desk.thing];
        let mut best: Option<(f64, String)> = None;
        for inward in [0.05, 0.08, 0.11, 0.14] {
            for aside in ASIDE_M {
                let at = |sign: f64| {
                    let p =
                        self.chair.seat.centre + self.front * (desk.edge + inward) + self.chair.left * (sign * aside);
                    DVec3::new(p.x, thing.high.y + self.body.radius, p.z)
                };
                let hands = [at(1.0), at(-1.0)];
                let taken = hands.iter().find_map(|h| {
                    let over = |t: &&crate::room::Thing| {
                        let flat = DVec3::new(h.x, t.low.y, h.z);
                        t.low.y > thing.high.y - 0.05
                            && t.low.y < h.y + 0.1
                            && flat.distance(flat.clamp(t.low, t.high)) < 0.06
                    };
                    self.room.things.iter().find(over)
                });
                if let Some(t) = taken {
                    best = best.or(Some((f64::INFINITY, format!("{} lies where a hand would on {}", t.id, thing.id))));
                    continue;
                }
                let mut want = self.upright_at(seat);
                want.pelvis = pelvis;
                want.lean = 0.1;
                want.hands = Some(hands);
                let (want, found) = self.lay(seated, &want, desk.thing, self.draw);
                let gaps = self.body.hands.map(|h| self.gap(&found.posture, &[h], desk.thing, self.draw));
                if found.error < 1e-4 && gaps.iter().all(|g| g.abs() < HANDS_M) {
                    return Ok((want, found));
                }
                if best.as_ref().is_none_or(|b| found.error < b.0) {
                    best = Some((
                        found.error,
                        format!(
                            "seated, the hands miss {} by {:.0} mm {:.2} m behind its edge",
                            thing.id,
                            1e3 * found.error,
                            inward
                        ),
                    ));
                }
            }
        }
        Err(best.map_or_else(|| "there is no room for the hands on the desk".to_owned(), |b| b.1))
    }
}
