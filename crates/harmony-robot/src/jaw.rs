//! A hand with two fingers that slide towards each other, found in a robot's model.
//!
//! Nothing is named: the fingers are the two links on slides that hang on one link, the hand; the approach is the way from
//! the hand to the fingers; pads are the boxes of the fingers' collision geoms.

use glam::{DMat3, DVec3};

use crate::RobotError;
use crate::measure::JawSize;
use crate::model::{Form, JointKind, Model};
use crate::shapes::pieces_of;

/// A jaw of a robot.
#[derive(Debug, Clone)]
pub struct Jaw {
    /// The link that carries the fingers.
    pub hand: usize,
    /// The links of the fingers.
    pub fingers: [usize; 2],
    /// Their joints.
    pub joints: [usize; 2],
    /// Unit, hand frame: to where the fingers point.
    pub approach: DVec3,
    /// Unit, hand frame: the first finger opens along it.
    pub closing: DVec3,
    /// Middle between the pads, hand frame.
    pub centre: DVec3,
    /// Its measures.
    pub size: JawSize,
}

impl Jaw {
    /// Finds it.
    ///
    /// # Errors
    /// [`RobotError::NotThisRobot`] for a model without one.
    pub fn of(model: &Model) -> Result<Self, RobotError> {
        let none = |part: &str| RobotError::NotThisRobot {
            model: model.name.clone(),
            part: part.to_owned(),
            robot: "robot with a parallel jaw",
        };
        let slides: Vec<usize> =
            (0..model.joints.len()).filter(|k| model.joints[*k].kind == JointKind::Slide).collect();
        let [a, b] = slides[..] else { return Err(none("pair of sliding fingers")) };
        let fingers = [model.joints[a].link, model.joints[b].link];
        let hand = model.links[fingers[0]].parent.ok_or_else(|| none("hand"))?;
        if model.links[fingers[1]].parent != Some(hand) {
            return Err(none("pair of fingers on one hand"));
        }
        let place = |f: usize| model.links[f].parent_from_link;
        let approach = place(fingers[0]).translation.try_normalize().ok_or_else(|| none("way from hand to fingers"))?;
        let closing = place(fingers[0]).transform_vector3(model.joints[a].axis);
        let far = |link: usize| {
            let pieces = pieces_of(model, link);
            let corners = pieces.iter().flat_map(|h| &h.vertices);
            let place = if link == hand { glam::DAffine3::IDENTITY } else { place(link) };
            corners.map(|v| place.transform_point3(*v).dot(approach)).fold(f64::NEG_INFINITY, f64::max)
        };
        let (tip, palm) = (far(fingers[0]), far(hand));
        // The largest box is the pad.
        let boxes = model.links[fingers[0]].geoms.iter().filter(|g| !g.visual).filter_map(|g| match g.form {
            Form::Box(half) => Some((g.link_from_geom.translation, half)),
            _ => None,
        });
        let volume = |h: &DVec3| h.x * h.y * h.z;
        let (at, half) = boxes
            .max_by(|x, y| volume(&x.1).total_cmp(&volume(&y.1)))
            .ok_or_else(|| none("pads (boxes among the geoms of its fingers)"))?;
        let along = place(fingers[0]).transform_point3(at).dot(approach);
        let across = closing.cross(approach);
        let link_from_hand = DMat3::from_quat(glam::DQuat::from_mat3(&place(fingers[0]).matrix3)).transpose();
        let half_along = |d: DVec3| (link_from_hand * d).abs().dot(half);
        let opening_m = [a, b].iter().map(|k| model.joints[*k].range[1]).sum();
        Ok(Self {
            hand,
            fingers,
            joints: [a, b],
            approach,
            closing,
            centre: approach * along,
            size: JawSize {
                opening_m,
                tip_m: tip - along,
                palm_m: along - palm,
                pad_half_height_m: half_along(approach),
                pad_half_width_m: half_along(across),
            },
        })
    }

    /// `room_from_hand` for fingers that point along `approach` and close along `closing`, at right angles to it.
    pub fn turned(&self, approach: DVec3, closing: DVec3) -> DMat3 {
        let hand = DMat3::from_cols(self.closing, self.approach, self.closing.cross(self.approach));
        let room = DMat3::from_cols(closing, approach, closing.cross(approach));
        room * hand.transpose()
    }

    /// Sets how far each finger is open, metres.
    pub fn open(&self, model: &Model, joints: &mut [f64], each: f64) {
        for k in self.joints {
            joints[k] = model.joints[k].clamped(each);
        }
    }
}
