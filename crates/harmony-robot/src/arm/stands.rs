//! Where the base of an arm stands, and on how high a column.

use glam::{DAffine3, DVec3};
use harmony_physics::Hull;

use super::carry::{Hand, Hold, Way};
use super::frames::ABOVE_M;
use crate::model::{Form, Geom, Model, Posture, upright};
use crate::room::{Shapes, Surroundings};

/// From the pads back to the wrist, roughly, metres.
const WRIST_M: f64 = 0.2;
/// Half the side of the column, metres.
const COLUMN_M: f64 = 0.12;
/// Heights of columns that are tried, metres.
const COLUMNS: [f64; 10] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];

/// A place of the arm's base and how the hand is turned.
#[derive(Clone)]
pub(super) struct Stand {
    pub(super) root: DAffine3,
    pub(super) column: f64,
    pub(super) closing: DVec3,
    margin: f64,
    /// Postures above the object, at it, midway and at the end.
    pub(super) keys: Vec<Posture>,
}

/// Places from which the key poses are reached, best first.
pub(super) fn stands(room: &Surroundings, hand: &Hand<'_>, hold: &Hold, way: &Way) -> Result<Vec<Stand>, String> {
    // The wrist midway.
    let middle = way.at(0.5).transform_point3(hold.centre - hold.approach * WRIST_M);
    let mut out: Vec<Stand> = Vec::new();
    let e = &room.extents;
    let mut looked = 0;
    let columns = Shapes::new(&[vec![Hull::cuboid(DVec3::new(-0.16, -0.10, 0.05), DVec3::new(0.09, 0.10, 0.3))]]);
    for angle in (0..16).map(|k| std::f64::consts::TAU * f64::from(k) / 16.0) {
        for distance in [0.35, 0.45, 0.55, 0.65, 0.72] {
            let out_there = DVec3::new(angle.cos(), 0.0, angle.sin()) * distance;
            for column in COLUMNS {
                let at = DVec3::new(middle.x, column, middle.z) + out_there;
                let inside = at.x > 0.2 && at.z > 0.2 && at.x < e.width - 0.2 && at.z < e.depth - 0.2;
                // From the shoulder to the wrist, roughly, and neither far above nor below.
                let up = middle.y - (column + 0.33);
                if !inside || !(-0.55..=0.55).contains(&up) {
                    continue;
                }
                let root = upright(at, -out_there);
                let place = [root];
                let free = |s: &Shapes| room.nearest(s, &place, None, 0.01, &|_, _| true).is_none();
                if !free(&columns) || !column_is_free(room, at, column) {
                    continue;
                }
                looked += 1;
                out.extend(stand(hand, hold, way, root, column));
            }
        }
    }
    if out.is_empty() {
        return Err(format!(
            "the arm reaches the hand's way at {:.2} m height, {:.2} m long, from none of {looked} free places within 0.72 m",
            hold.centre.y,
            way.length(hold.centre)
        ));
    }
    out.sort_by(|a, b| b.margin.total_cmp(&a.margin));
    Ok(out)
}

fn column_is_free(room: &Surroundings, at: DVec3, column: f64) -> bool {
    if column <= 0.0 {
        return true;
    }
    let shape = Hull::cuboid(DVec3::new(-COLUMN_M, 0.02, -COLUMN_M), DVec3::new(COLUMN_M, column, COLUMN_M));
    let place = [DAffine3::from_translation(DVec3::new(at.x, 0.0, at.z))];
    room.nearest(&Shapes::new(&[vec![shape]]), &place, None, 0.01, &|_, _| true).is_none()
}

/// A place, when all key poses are reached from it.
fn stand(hand: &Hand<'_>, hold: &Hold, way: &Way, root: DAffine3, column: f64) -> Option<Stand> {
    let mut best: Option<Stand> = None;
    for closing in [hold.closing, -hold.closing] {
        let mut posture = Posture { root, joints: hand.model.rest() };
        let mut margin = f64::INFINITY;
        let mut made: Vec<Posture> = Vec::new();
        let turn = hand.jaw.turned(hold.approach, closing);
        let before = hold.centre - hold.approach * ABOVE_M;
        let keys = [(before, 0.0), (hold.centre, 0.0), (hold.centre, 0.5), (hold.centre, 1.0)];
        for (point, share) in keys {
            let moved = way.at(share);
            let found = hand.at(&posture, moved.transform_point3(point), moved.matrix3 * turn, 60);
            if found.error > 1e-4 {
                margin = f64::NEG_INFINITY;
                break;
            }
            posture = found.posture;
            made.push(posture.clone());
            margin = margin.min(hand.model.margin(&posture.joints).0);
        }
        if made.len() == keys.len() && margin > 0.02 && best.as_ref().is_none_or(|b| margin > b.margin) {
            best = Some(Stand { root, column, closing, margin, keys: made });
        }
    }
    best
}

/// Puts a column under the root link.
pub(super) fn stand_on(model: &mut Model, column: f64) {
    if column <= 0.0 {
        return;
    }
    for visual in [true, false] {
        model.links[0].geoms.push(Geom {
            link_from_geom: DAffine3::from_translation(DVec3::NEG_Z * column / 2.0),
            form: Form::Box(DVec3::new(COLUMN_M, COLUMN_M, column / 2.0)),
            visual,
            color: [0.25, 0.27, 0.3],
        });
    }
}

/// Convex pieces of all links with the column's among those of the root link.
pub(super) fn with_column(own: &[Vec<Hull>], column: f64) -> Vec<Vec<Hull>> {
    let mut out = own.to_vec();
    if column > 0.0 {
        out[0].push(Hull::cuboid(DVec3::new(-COLUMN_M, -COLUMN_M, -column), DVec3::new(COLUMN_M, COLUMN_M, 0.0)));
    }
    out
}
