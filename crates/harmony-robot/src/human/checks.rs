//! What holds of the frames: goals met, nothing met, balance.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;

use super::body::{Body, fastest};
use super::poses::Plan;
use super::{DEEP_M, Desk, HANDS_M, PASS_M, STEPS};
use crate::motion::{Done, Evidence, FRAMES_PER_SECOND, Frame, MISSED, Motion, evidence};
use crate::room::Other;

impl Plan<'_> {
    /// Whether frames so far meet their goals, else how far the worst is off.
    pub(super) fn met(&self) -> Result<(), String> {
        let worst = self.frames.iter().enumerate().max_by(|a, b| a.1.error.total_cmp(&b.1.error));
        match worst.filter(|(_, f)| f.error > MISSED) {
            None => Ok(()),
            Some((number, frame)) => Err(format!(
                "in step {} (\"{}\") the robot misses its goal by {:.1} mm (frame {number})",
                frame.step + 1,
                STEPS[frame.step],
                1e3 * frame.error
            )),
        }
    }

    /// Whether no joint turns faster between frames so far than it can, else which does.
    pub(super) fn steady(&self) -> Result<(), String> {
        for (number, pair) in self.frames.windows(2).enumerate() {
            let (from, to) = (&pair[0].posture.joints, &pair[1].posture.joints);
            for (joint, turned) in self.model.joints.iter().zip(from.iter().zip(to).map(|(a, b)| (a - b).abs())) {
                let most = fastest(&joint.name) / f64::from(FRAMES_PER_SECOND);
                if turned > most {
                    return Err(format!(
                        "in step {} (\"{}\") {} would turn {turned:.2} rad in a frame, {most:.2} are possible (frame {})",
                        pair[1].step + 1,
                        STEPS[pair[1].step],
                        joint.name,
                        number + 1
                    ));
                }
            }
        }
        Ok(())
    }

    /// Whether the hands stay at the backrest in all frames so far in which they are meant to.
    pub(super) fn in_touch(&self) -> Result<(), String> {
        for (number, frame) in self.frames.iter().enumerate() {
            let moved = frame.moved.translation.dot(self.chair.back);
            for link in &frame.touching {
                let gap = self.gap(&frame.posture, &[*link], self.object, moved);
                if gap.abs() > HANDS_M {
                    return Err(format!(
                        "in step {} (\"{}\") {} leaves the backrest by {:.0} mm (frame {number})",
                        frame.step + 1,
                        STEPS[frame.step],
                        self.model.links[*link].name,
                        1e3 * gap
                    ));
                }
            }
        }
        Ok(())
    }

    /// Whether frames so far are free, else which is not.
    pub(super) fn clear(&self, steps: std::ops::Range<usize>) -> Result<(), String> {
        for (number, frame) in self.frames.iter().enumerate().filter(|(_, f)| steps.contains(&f.step)) {
            let looks = |l: usize, o: Other| !self.bears(frame, l, o) && !self.touches(frame, l, o);
            let moved = Some((self.object, frame.moved));
            let places = self.model.places(&frame.posture);
            if let Some(near) = self.room.nearest(self.shapes, &places, moved, 0.0, &looks)
                && near.distance < -DEEP_M
            {
                return Err(format!(
                    "in step {} (\"{}\") {} is {:.0} mm in {} (frame {number})",
                    frame.step + 1,
                    STEPS[frame.step],
                    self.model.links[near.link].name,
                    -1e3 * near.distance,
                    self.room.name(near.other)
                ));
            }
        }
        Ok(())
    }

    pub(super) fn touches(&self, frame: &Frame, link: usize, other: Other) -> bool {
        other == Other::Thing(self.object) && frame.touching.contains(&link)
    }

    /// What bears the robot: the floor its feet, the seat what sits on it.
    pub(super) fn bears(&self, frame: &Frame, link: usize, other: Other) -> bool {
        bears(self.body, self.object, frame, link, other)
    }

    /// The whole motion, measured.
    pub(super) fn measured(&mut self, desk: &Desk, depth: f64, turn: f64) -> Result<Done, String> {
        let last = self.frames.last().map(|f| f.posture.clone()).ok_or("no frame")?;
        let on_desk = self.body.hands.map(|h| self.gap(&last, &[h], desk.thing, self.draw));
        let thighs = self.body.thighs.map(|t| self.gap(&last, &[t], self.object, self.draw));
        let motion = Motion {
            model: self.whole.clone(),
            task: "sit".to_owned(),
            object: self.object,
            steps: STEPS.to_vec(),
            frames: std::mem::take(&mut self.frames),
            column_m: 0.0,
        };
        let bears = |f: &Frame, l: usize, o: Other| {
            bears(self.body, self.object, f, l, o)
                || o == Other::Thing(desk.thing) && f.step == 7 && f.held && self.body.hands.contains(&l)
        };
        let found: Evidence = evidence(self.room, self.shapes, &motion, &bears);
        if found.smallest_clearance_m < -DEEP_M {
            return Err(format!("{} are {:.0} mm in each other", found.nearest, -1e3 * found.smallest_clearance_m));
        }
        let (off_floor, deepest_seat) = self.floor_and_seat(&motion);
        let measured = BTreeMap::from([
            ("drawn_m".to_owned(), self.draw),
            ("seat_height_m".to_owned(), self.chair.seat.height_m),
            ("hips_behind_seat_front_m".to_owned(), depth),
            ("backrest_top_m".to_owned(), self.chair.top_m),
            ("hands_to_backrest_m".to_owned(), found.largest_gap_m.max(found.deepest_touch_m)),
            ("hands_to_desk_m".to_owned(), on_desk[0].abs().max(on_desk[1].abs())),
            ("thighs_to_seat_m".to_owned(), thighs[0].abs().max(thighs[1].abs())),
            ("deepest_in_seat_m".to_owned(), deepest_seat),
            ("feet_off_floor_m".to_owned(), off_floor),
            ("balance_margin_m".to_owned(), self.balance(&motion)),
            ("turned_while_crossing_rad".to_owned(), turn * std::f64::consts::FRAC_PI_2),
        ]);
        let because = vec![
            format!(
                "the chair is drawn {:.2} m: the feet are {:.2} m long and need {PASS_M} m before and behind them between the \
                 front of the seat and {}",
                self.draw,
                self.body.foot[1] - self.body.foot[0],
                self.room.things[desk.thing].id
            ),
            format!("the seat is at {:.3} m, {:.2} m2 of it level", self.chair.seat.height_m, self.chair.seat.area_m2),
            "the feet slide on the floor one after the other and are as far apart as the hips: the ankles have one joint".to_owned(),
        ];
        Ok(Done { motion, shapes: Arc::clone(self.shapes), evidence: found, measured, because })
    }

    /// Farthest that a sole is from the floor, and deepest that what sits is in the seat.
    fn floor_and_seat(&self, motion: &Motion) -> (f64, f64) {
        let (mut floor, mut seat) = (0.0_f64, 0.0_f64);
        for frame in &motion.frames {
            let places = self.model.places(&frame.posture);
            for foot in self.body.feet {
                let low = self.shapes.corners(foot, &places[foot]).map(|p| p.y).fold(f64::INFINITY, f64::min);
                floor = floor.max(low.abs());
            }
            if frame.step >= 6 {
                seat = seat.max(-self.gap(&frame.posture, &self.body.seated, self.object, self.draw));
            }
        }
        (floor, seat)
    }

    /// Smallest distance of the centre of mass to the edge of what bears the robot, in poses that are held.
    fn balance(&self, motion: &Motion) -> f64 {
        let mut least = f64::INFINITY;
        for frame in motion.frames.iter().filter(|f| f.held) {
            let places = self.model.places(&frame.posture);
            let mut points: Vec<DVec3> = Vec::new();
            for foot in self.body.feet {
                points.extend(self.shapes.corners(foot, &places[foot]).filter(|p| p.y < 0.01));
            }
            if frame.step >= 6 {
                // What lies on the seat.
                let top = self.chair.seat.height_m + 0.03;
                for link in &self.body.seated {
                    points.extend(self.shapes.corners(*link, &places[*link]).filter(|p| p.y < top && p.y > 0.3));
                }
            }
            least = least.min(inside(&points, self.model.centre_of_mass(&places)));
        }
        least
    }
}

fn bears(body: &Body, object: usize, frame: &Frame, link: usize, other: Other) -> bool {
    match other {
        Other::Face(name) => name == "floor" && body.feet.contains(&link),
        Other::Thing(k) => k == object && frame.step >= 6 && body.seated.contains(&link),
    }
}

/// How far a point is inside the convex outline of points on the floor, metres; below 0 outside.
fn inside(points: &[DVec3], p: DVec3) -> f64 {
    // The outline's supporting lines in 72 directions: a margin that is at most a part in a thousand too large.
    (0..72)
        .map(|k| {
            let a = std::f64::consts::TAU * f64::from(k) / 72.0;
            let d = DVec3::new(a.cos(), 0.0, a.sin());
            points.iter().map(|q| (*q - p).dot(d)).fold(f64::NEG_INFINITY, f64::max)
        })
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balance_is_how_far_inside_the_feet_the_mass_is() {
        let square = [DVec3::ZERO, DVec3::X, DVec3::Z, DVec3::new(1.0, 0.0, 1.0)];
        assert!((inside(&square, DVec3::new(0.3, 1.0, 0.5)) - 0.3).abs() < 1e-9);
        assert!(inside(&square, DVec3::new(-0.2, 1.0, 0.5)) < -0.19);
    }
}
