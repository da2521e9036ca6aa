//! The eight steps, frame by frame.

use glam::{DAffine3, DVec3};

use super::body::{Stance, mix, strides};
use super::poses::{Plan, Want};
use super::{DEEP_M, Desk, FRAMES, HANDS_M, PASS_M, STEPS};
use crate::ik::Found;
use crate::model::{Posture, upright};
use crate::motion::{Done, Frame, smooth};
use crate::room::Other;

/// And this much higher from the side of the chair on, where knees must not reach the desk.
const RISE_M: f64 = 0.03;
/// Farthest that an idle joint moves in a frame, radians.
const EASE_RAD: f64 = 0.06;
/// Elbows of who sits: the forearms are above the seat and its arms, radians.
const LAP_RAD: f64 = 0.35;

impl Plan<'_> {
    fn put(&mut self, step: usize, want: &Want, moved: f64, touching: &[usize], held: bool) -> Result<(), String> {
        let start =
            self.frames.last().map(|f| &f.posture).or(self.first.as_ref()).ok_or("no posture to begin with")?.clone();
        // Joints that nothing asks for go to the easy posture by a little a frame.
        let near = |(easy, now): (&f64, &f64)| now + (easy - now).clamp(-EASE_RAD, EASE_RAD);
        let easy: Vec<f64> = self.easy.iter().zip(&start.joints).map(near).collect();
        let found = self.solve_near(&start, want, &easy);
        if found.error > 1e-3 {
            return Err(format!(
                "in step {} (\"{}\") the robot misses its goal by {:.1} mm",
                step + 1,
                STEPS[step],
                1e3 * found.error
            ));
        }
        let moved = DAffine3::from_translation(self.chair.back * moved);
        self.frames.push(Frame {
            step,
            posture: found.posture,
            moved,
            opened: 0.0,
            error: found.error,
            touching: touching.to_vec(),
            held,
        });
        Ok(())
    }

    /// Shuffles from where the feet are along stances; `hands` are taken along when the chair is drawn.
    fn shuffle(
        &mut self,
        step: usize,
        frames: usize,
        way: &[Stance],
        drawn: Option<([DVec3; 2], f64)>,
    ) -> Result<(), String> {
        let from = Stance {
            at: (self.feet[0].at + self.feet[1].at) / 2.0,
            facing: (self.feet[0].facing + self.feet[1].facing).normalize_or(self.front),
        };
        let mut all = vec![from];
        all.extend_from_slice(way);
        let strides = strides(&all);
        for k in 0..frames {
            let t = (k + 1) as f64 / frames as f64 * (strides.len() - 1) as f64;
            let n = (t.floor() as usize).min(strides.len() - 2);
            let part = t - n as f64;
            let between = |p: f64| mix(&strides[n], &strides[n + 1], smooth(p));
            let body = mix(&strides[n], &strides[n + 1], part);
            // Forwards the left foot goes in the first half of a stride and the right in the second; sideways and in turns
            // both go with the body, for they must stay as far apart as the hips.
            let foot = |p: f64| {
                let ahead = (between(p.clamp(0.0, 1.0)).at - body.at).dot(body.facing);
                Stance { at: body.at + body.facing * ahead, facing: body.facing }
            };
            self.feet = [foot(2.0 * part), foot(2.0 * part - 1.0)];
            if step == 3 {
                self.rise = RISE_M * smooth((k + 1) as f64 / frames as f64);
            }
            let mut want = self.upright_at(&body);
            let mut moved = self.frames.last().map_or(0.0, |f| f.moved.translation.dot(self.chair.back));
            let mut touching: Vec<usize> = Vec::new();
            if let Some((hands, height)) = drawn {
                moved = (body.at - from.at).dot(self.chair.back);
                want.hands = Some(hands.map(|h| h + self.chair.back * moved));
                want.pelvis.y = height;
                want.level = 3;
                touching = self.body.hands.to_vec();
            }
            let held = k + 1 == frames;
            want.balance = drawn.is_some();
            self.put(step, &want, moved, &touching, held)?;
        }
        Ok(())
    }

    /// Steps 3 to 8 after [`Self::reach_and_draw`]: around the chair on one side, turned by a share while crossing.
    pub(super) fn go_around_and_sit(
        &mut self,
        desk: &Desk,
        (hands, drawn): &([DVec3; 2], Stance),
        side: f64,
        turn: f64,
    ) -> Result<Done, String> {
        // 3: release and stand.
        let last = self.frames.last().map(|f| f.posture.clone()).ok_or("no frame")?;
        // Where an upright pelvis has its hip axes where those of the leaning one are: from there it goes on without a jump.
        let hip = self.hip_axes();
        let pelvis = last.root.transform_point3(hip) - upright(DVec3::ZERO, drawn.facing).matrix3 * hip;
        let beside = {
            let places = self.model.places(&self.solve(&last, &self.upright_at(drawn)).posture);
            self.body.hands.map(|h| places[h].transform_point3(self.body.palm))
        };
        for k in 0..FRAMES[2] {
            let part = smooth((k + 1) as f64 / FRAMES[2] as f64);
            let mut want = self.upright_at(drawn);
            want.pelvis = pelvis.lerp(want.pelvis, part);
            // Up first, then back behind the backrest, then down beside the body.
            let t = (k + 1) as f64 / FRAMES[2] as f64;
            let (up, back, down) = (smooth(t / 0.3), smooth((t - 0.2) / 0.4), smooth((t - 0.55) / 0.45));
            want.hands = Some(std::array::from_fn(|i| {
                let free = hands[i] + self.chair.back * (self.draw + 0.22 * back) + DVec3::Y * 0.15 * up;
                free.lerp(beside[i], down)
            }));
            want.passing = true;
            self.put(2, &want, self.draw, &[], k + 1 == FRAMES[2])?;
        }
        // 4 to 6: around it, across, and turned to the desk.
        let thing = &self.room.things[self.object];
        let corners = [thing.low.x, thing.high.x]
            .into_iter()
            .flat_map(|x| [thing.low.z, thing.high.z].map(|z| DVec3::new(x, 0.0, z)));
        let from = self.chair.seat.centre;
        let half = corners.clone().map(|c| ((c - from).dot(self.chair.left) * side).max(0.0)).fold(0.0, f64::max);
        let own = self.body.hip.y.abs() + self.body.foot_half + 0.03;
        let aside = side * (half + own + 0.05);
        let behind = (drawn.at - self.spot(0.0, 0.0)).dot(self.front);
        // The heels are free of the seat's front.
        let ahead = self.chair.front_m + PASS_M - self.body.foot[0];
        let across = -self.chair.left * side;
        let turned = (self.front * (1.0 - turn) + across * turn).normalize_or(self.front);
        let along = |f: f64, l: f64, facing| Stance { at: self.spot(f, l), facing };
        let way = [along(behind, aside, self.front), along(ahead, aside, self.front), along(ahead, aside, turned)];
        let (cross, seat) = (along(ahead, 0.0, turned), along(ahead, 0.0, self.front));
        self.shuffle(3, FRAMES[3], &way, None)?;
        self.shuffle(4, FRAMES[4], &[cross], None)?;
        self.shuffle(5, FRAMES[5], &[seat], None)?;
        self.steady()?;
        self.clear(0..6)?;
        self.met()?;
        let (sitting, depth) = self.sit_down(desk, &seat)?;
        self.finish(desk, &sitting, depth, turn)
    }

    /// Steps 1 and 2: where to stand, the hands on the backrest, and the chair drawn; the first place from which the way
    /// back is free, too.
    pub(super) fn reach_and_draw(&mut self) -> Result<([DVec3; 2], Stance), String> {
        let top_at = self.chair.seat.centre;
        let tops = self
            .tops(self.object, DVec3::new(top_at.x, 0.0, top_at.z), self.chair.back, self.chair.left, 0.01)
            .ok_or("there is no backrest 0.14 m to the left and right of its middle")?;
        let rear = tops.iter().map(|t| (*t - top_at).dot(self.chair.back)).fold(0.0, f64::max);
        let high = tops[0].y.max(tops[1].y);
        // The robot faces the chair's back: its left is the sitter's left.
        let (mut why, mut least) = (String::new(), f64::INFINITY);
        for away in [0.36, 0.32, 0.40, 0.44, 0.48, 0.28] {
            for crouch in [0.10, 0.16, 0.22, 0.05] {
                let p = top_at + self.chair.back * (rear + away);
                let stance = Stance { at: DVec3::new(p.x, 0.0, p.z), facing: self.front };
                self.feet = [stance; 2];
                let mut want = self.upright_at(&stance);
                let standing = want.pelvis;
                let first = Posture { root: upright(standing, self.front), joints: self.easy.clone() };
                let stood = self.solve(&first, &want);
                want.pelvis.y -= crouch;
                want.level = 3;
                want.balance = true;
                want.hands = Some(tops.map(|t| t + DVec3::Y * self.body.radius));
                let (want, found) = self.lay(&stood.posture, &want, self.object, 0.0);
                let gaps = self.body.hands.map(|h| self.gap(&found.posture, &[h], self.object, 0.0));
                let rest = |l: usize, o: Other| match o {
                    Other::Thing(k) => k != self.object || !self.body.hands.contains(&l),
                    Other::Face(name) => name != "floor" || !self.body.feet.contains(&l),
                };
                let near = self.room.nearest(self.shapes, &self.model.places(&found.posture), None, 0.1, &rest);
                let clear = near.map_or(0.1, |n| n.distance);
                if found.error > 1e-4 || gaps.iter().any(|g| g.abs() > HANDS_M) || clear < 0.0 {
                    // The one that came nearest to being possible speaks.
                    let short = found.error.max(-clear).max(gaps[0].abs() - HANDS_M);
                    if short < least {
                        least = short;
                        let near = near.map_or_else(String::new, |n| {
                            format!(
                                "; {:.0} mm from {} to {}",
                                1e3 * n.distance,
                                self.model.links[n.link].name,
                                self.room.name(n.other)
                            )
                        });
                        why = format!(
                            "with the feet {away:.2} m behind its backrest the hands miss its top at {high:.2} m by {:.0} mm{near}",
                            1e3 * (found.error + gaps[0].abs().max(gaps[1].abs()))
                        );
                    }
                    continue;
                }
                let (Some(hands), crouched) = (want.hands, found.posture.root.translation.y) else { continue };
                // From standing to there, the hands from above.
                let easy_hands = {
                    let places = self.model.places(&stood.posture);
                    self.body.hands.map(|h| places[h].transform_point3(self.body.palm))
                };
                self.first = Some(stood.posture);
                let mut reached = Ok(());
                for k in 0..FRAMES[0] {
                    let t = k as f64 / (FRAMES[0] - 1) as f64;
                    let (down, over) = (smooth((t - 0.5) * 2.0), smooth(t * 2.0));
                    let mut want = want.clone();
                    want.pelvis = standing.lerp(want.pelvis, smooth(t));
                    let above = |h: DVec3| h + DVec3::Y * 0.10 + self.chair.back * 0.02;
                    let at: [DVec3; 2] =
                        std::array::from_fn(|i| easy_hands[i].lerp(above(hands[i]), over).lerp(hands[i], down));
                    want.hands = Some(at);
                    let last = k + 1 == FRAMES[0];
                    want.passing = !last;
                    let touching = if last { self.body.hands.to_vec() } else { vec![] };
                    reached = reached.and_then(|()| self.put(0, &want, 0.0, &touching, last || k == 0));
                }
                let drawn = Stance { at: stance.at + self.chair.back * self.draw, ..stance };
                let all = reached
                    .and_then(|()| self.shuffle(1, FRAMES[1], &[drawn], Some((hands, crouched))))
                    .and_then(|()| self.steady())
                    .and_then(|()| self.in_touch())
                    .and_then(|()| self.clear(0..2))
                    .and_then(|()| self.met());
                match all {
                    Ok(()) => return Ok((hands, drawn)),
                    // It came further than those that do not reach the backrest: it speaks.
                    Err(e) => (why, least) = (e, f64::NEG_INFINITY),
                }
                self.frames.clear();
            }
        }
        Err(why)
    }

    /// Steps 7: how deep on the seat, and the postures down to it.
    fn sit_down(&mut self, desk: &Desk, seat: &Stance) -> Result<(Posture, f64), String> {
        let stood = self.frames.last().map(|f| f.posture.clone()).ok_or("no frame")?;
        for name in ["left_elbow", "right_elbow"] {
            if let Some(k) = self.model.joint(name) {
                self.easy[k] = LAP_RAD;
            }
        }
        let standing = self.upright_at(seat).pelvis;
        let mut why = String::new();
        for depth in [0.24, 0.20, 0.16, 0.12, 0.09] {
            // The hip axes are this far behind the front edge of the seat.
            let on = self.spot(self.chair.front_m - depth, 0.0) - self.front * self.body.hip.x;
            let (mut low, mut high) =
                (self.chair.seat.height_m - self.body.hip.z - 0.05, self.chair.seat.height_m - self.body.hip.z + 0.25);
            let mut found: Option<Found> = None;
            let mut from = stood.clone();
            // Part of the way first: a seat is far from standing.
            for part in [0.3, 0.6, 0.85] {
                let mut want = self.upright_at(seat);
                want.pelvis = standing.lerp(DVec3::new(on.x, high, on.z), part);
                from = self.solve(&from, &want).posture;
            }
            for _ in 0..14 {
                let y = f64::midpoint(low, high);
                let mut want = self.upright_at(seat);
                want.pelvis = DVec3::new(on.x, y, on.z);
                let tried = self.solve(&from, &want);
                if self.gap(&tried.posture, &self.body.seated, self.object, self.draw) > 5e-4 {
                    high = y;
                } else {
                    low = y;
                }
                if tried.error < 1e-4 {
                    from = tried.posture.clone();
                }
                found = Some(tried);
            }
            let Some(found) = found.filter(|f| f.error < 1e-4) else {
                why =
                    format!("with the hips {depth:.2} m behind the front of the seat the feet do not reach the floor");
                continue;
            };
            let gap = self.gap(&found.posture, &self.body.thighs, self.object, self.draw);
            if gap > DEEP_M {
                why = format!(
                    "with the hips {depth:.2} m behind the front of the seat at {:.2} m the thighs are {:.0} mm above it",
                    self.chair.seat.height_m,
                    1e3 * gap
                );
                continue;
            }
            let target = DVec3::new(on.x, high, on.z);
            if let Err(e) = self.desk_hands(desk, &found.posture, target, seat) {
                why = e;
                continue;
            }
            for k in 0..FRAMES[6] {
                let t = (k + 1) as f64 / FRAMES[6] as f64;
                let mut want = self.upright_at(seat);
                // Back first, then down.
                let (out, down) = (smooth((1.25 * t).min(1.0)), smooth(t));
                want.pelvis = DVec3::new(
                    standing.x + (target.x - standing.x) * out,
                    standing.y + (target.y - standing.y) * down,
                    standing.z + (target.z - standing.z) * out,
                );
                want.lean = 0.35 * (std::f64::consts::PI * t).sin();
                self.put(6, &want, self.draw, &[], k + 1 == FRAMES[6])?;
            }
            let last = self.frames.last().map(|f| f.posture.clone()).ok_or("no frame")?;
            return Ok((last, depth));
        }
        Err(why)
    }

    fn finish(&mut self, desk: &Desk, sitting: &Posture, depth: f64, turn: f64) -> Result<Done, String> {
        let seat = self.feet[0];
        let places = self.model.places(sitting);
        let start_hands = self.body.hands.map(|h| places[h].transform_point3(self.body.palm));
        let pelvis = {
            let hip = DVec3::new(self.body.hip.x, 0.0, self.body.hip.z);
            sitting.root.transform_point3(hip) - upright(DVec3::ZERO, self.front).matrix3 * hip
        };
        let (want, _) = self.desk_hands(desk, sitting, pelvis, &seat)?;
        let goal = want.hands.ok_or("no hands")?;
        for k in 0..FRAMES[7] {
            let t = (k + 1) as f64 / FRAMES[7] as f64;
            let (over, down) = (smooth((1.5 * t).min(1.0)), smooth((t - 0.6) / 0.4));
            let mut want = want.clone();
            want.hands = Some(std::array::from_fn(|i| {
                let above = goal[i] + DVec3::Y * 0.08;
                start_hands[i].lerp(above, over).lerp(goal[i], down)
            }));
            want.lean *= smooth(t);
            want.passing = k + 1 < FRAMES[7];
            self.put(7, &want, self.draw, &[], k + 1 == FRAMES[7])?;
        }
        self.steady()?;
        self.clear(0..8)?;
        self.measured(desk, depth, turn)
    }
}
