//! How far off everything that placement is told can be: one place for every sigma and every probability.
//!
//! A pose has one score, `E = sum rho(r / sigma) - ln p(hypothesis)`, in nats (`terms`). The sigmas here make what
//! is measured comparable: one that is too small lets its term outvote the others. `harmony bench fit` estimates them
//! from rooms with known truth; where a source is given below they come from there, else from such a fit.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Sigmas, probabilities and tolerances. Lengths in metres, angles in radians, relative ones as shares of the value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Noise {
    // What the photo shows.
    /// Error of a mask's outline, pixels of an image 1000 pixels wide.
    pub outline_px: f64,
    /// ... and relative to the object's size in the image: meshes approximate.
    pub outline_relative: f64,
    /// The same factor on both where much of an object is hidden.
    pub outline_hidden: f64,
    /// Sigmas from which a part of an outline counts as another object's (Geman and McClure's scale).
    pub outline_limit: f64,
    /// Independent pieces that the area between mask and silhouette is worth.
    pub area_pieces: f64,
    /// Error of that area, at most so much of the mask's.
    pub area_share: f64,
    /// Weight of what a placed object should hide though the mask shows it: what is placed may itself be off.
    pub order_trust: f64,
    /// Smooth relative error of a point map's depths over a patch (share of the image's width).
    pub depth_patch: [f64; 2],
    /// Relative error of a map that no patch averages out.
    pub depth_floor: f64,
    /// Relative error of a measured (metric) map.
    pub depth_sensor: f64,
    /// A neighbour whose depth is smaller than this share of the own one is nearer.
    pub nearer: f64,
    /// Two surfaces closer than this along the view do not hide each other, metres.
    pub hiding_m: f64,

    // What a model says of sizes.
    /// Relative error of a side of a named size.
    pub size: f64,
    /// ... of the length of a cord: cords are as long as rooms are high.
    pub size_cord: f64,
    /// How many times less is thought of a size that is far outside what its kind has.
    pub size_doubted: f64,
    /// What the errors of all named sizes have in common.
    pub size_common: f64,
    /// Difference of sizes within a matched set.
    pub size_set: f64,

    // What a model says of turns and places.
    /// Turn named as one of four panels, radians.
    pub yaw_panel: f64,
    /// Turn of what faces something.
    pub yaw_facing: f64,
    /// Turn of what stands along something: a wall that is said to be behind it, the host it stands on.
    pub yaw_along: f64,
    /// Turn of what lies or stands square in a room: rugs, furniture at a wall that is not seen.
    pub yaw_square: f64,
    /// Usual gap to a wall (a skirting board) and its sigma, metres.
    pub wall_gap: [f64; 2],
    /// Largest gap of what is said to touch a wall, metres.
    pub wall_gap_most: f64,
    /// Gap left between a wall and what is flush with it, metres.
    pub wall_clearance: f64,
    /// Share of a footprint that may be beside its host.
    pub support: f64,
    /// Gap of what leans against its host's back, metres.
    pub back_gap: f64,
    /// Distance of lamps from the middle of the room or of a table, as a share of the room's shorter side.
    pub lamp_middle: f64,

    // Probabilities that an answer is wrong.
    /// The wall behind an object on the floor.
    pub wrong_wall: f64,
    /// The wall on which an object hangs.
    pub wrong_hung: f64,
    /// The host on which an object stands.
    pub wrong_host: f64,
    /// The front, by a quarter turn (half a turn: the square).
    pub wrong_turn: f64,
    /// A change that a reviewer asks for.
    pub wrong_review: f64,

    // Camera, room and scale.
    /// Angles of the camera, radians: many lines of the photo hold them, better than calibration claims.
    pub rotation: f64,
    /// Focal length, relative: what objects say of it has errors in common (meshes whose fronts are off, depths that bend).
    pub focal: f64,
    /// Height of the room as it was told, relative.
    pub height: f64,
    /// Scale of a scene of which no map was calibrated, relative.
    pub scale_unknown: f64,

    // Contact.
    /// Depth to which rigid things may touch, metres.
    pub contact: f64,
    /// ... and soft ones.
    pub contact_soft: f64,
    /// Longest move that parts two things: share of the larger level side, and metres.
    pub longest_move: [f64; 2],
}

impl Default for Noise {
    fn default() -> Self {
        Self {
            outline_px: 2.5,
            outline_relative: 0.015,
            outline_hidden: 2.0,
            outline_limit: 3.0,
            area_pieces: 2.0,
            area_share: 0.15,
            order_trust: 0.4,
            depth_patch: [0.03, 0.1],
            depth_floor: 0.012,
            depth_sensor: 0.012,
            nearer: 0.955,
            hiding_m: 0.03,
            size: 0.15,
            size_cord: 0.5,
            size_doubted: 2.5,
            size_common: 0.03,
            size_set: 0.01,
            yaw_panel: 0.4,
            yaw_facing: 0.35,
            yaw_along: 0.2,
            yaw_square: 0.05,
            wall_gap: [0.02, 0.02],
            wall_gap_most: 0.15,
            wall_clearance: 0.003,
            support: 0.1,
            back_gap: 0.08,
            lamp_middle: 0.25,
            wrong_wall: 0.03,
            wrong_hung: 0.15,
            wrong_host: 0.03,
            wrong_turn: 0.05,
            wrong_review: 0.12,
            rotation: 0.001,
            focal: 0.01,
            height: 0.04,
            scale_unknown: 0.1,
            contact: 0.002,
            contact_soft: 0.06,
            longest_move: [0.6, 0.16],
        }
    }
}

/// `-ln p`, nats: what a hypothesis of probability `p` costs.
pub(crate) fn surprise(p: f64) -> f64 {
    -p.clamp(1e-6, 1.0).ln()
}
