//! Whether actions have come about: a support may hold an object where an action would not have it.

use std::collections::BTreeMap;

use harmony_scene::{ObjectId, Support, Vec3};

use super::ReviewAction;
use crate::scene::attachment::angle_between;
use crate::{PartialScene, Placed};

/// Share of what was asked for that must have come about.
const CAME_ABOUT: f64 = 0.5;
/// What is asked for in smaller steps than these need not be seen: metres, radians, logarithm of a side.
const HARDLY: [f64; 3] = [0.01, 0.02, 0.02];

/// All that actions ask of one object.
#[derive(Debug, Clone, Default)]
struct Asked {
    by: Vec3,
    turn: f64,
    ln_factor: Vec3,
    host: Option<ObjectId>,
    /// A swap or another host puts it somewhere else by itself.
    relocated: bool,
}

/// What the actions ask for and the scene after them does not show, in words.
pub(super) fn missed(before: &PartialScene, after: &PartialScene, actions: &[ReviewAction]) -> Option<String> {
    let mut asked: BTreeMap<&ObjectId, Asked> = BTreeMap::new();
    for action in actions {
        match action {
            ReviewAction::Move { object, by_m } => asked.entry(object).or_default().by += Vec3::from_array(*by_m),
            ReviewAction::Rotate { object, by_deg } => asked.entry(object).or_default().turn += by_deg.to_radians(),
            ReviewAction::Rescale { object, factor } => {
                asked.entry(object).or_default().ln_factor += Vec3::from_array(factor.map(f64::ln));
            }
            ReviewAction::Rehost { object, host } => {
                let of = asked.entry(object).or_default();
                (of.host, of.relocated) = (Some(host.clone()), true);
            }
            ReviewAction::Swap { object, with } => {
                for id in [object, with] {
                    asked.entry(id).or_default().relocated = true;
                }
            }
            ReviewAction::Equalize { .. } | ReviewAction::Add { .. } | ReviewAction::Remove { .. } => {}
        }
    }
    asked.iter().find_map(|(id, asked)| of_one(id, asked, before.find(id)?, after.find(id)?))
}

fn of_one(id: &ObjectId, asked: &Asked, old: &Placed, new: &Placed) -> Option<String> {
    if let Some(host) = &asked.host
        && !matches!(&new.support, Support::Object { id } if id == host)
    {
        return Some(format!("{id} finds no place on {host}"));
    }
    let grown = (new.size().as_vec() / old.size().as_vec()).map(f64::ln);
    let off = (asked.ln_factor - grown).abs().max_element();
    if asked.ln_factor != Vec3::ZERO && off > HARDLY[2].max(CAME_ABOUT * asked.ln_factor.abs().max_element()) {
        return Some(format!("{id} would not take the size that was asked for"));
    }
    if asked.relocated {
        return None;
    }
    let far = asked.by.length();
    let along = (new.pose.position - old.pose.position).dot(asked.by) / far.max(1e-9);
    if far > HARDLY[0] && along < CAME_ABOUT * far {
        return Some(format!("{id} is held by {}: of {far:.2} m it would go {along:.2} m", holder(new)));
    }
    // What hangs on a wall is turned as the wall is, which is near enough.
    let wanted = old.pose.yaw + asked.turn;
    let (missing, whole) = (angle_between(new.pose.yaw, wanted).abs(), angle_between(wanted, old.pose.yaw).abs());
    (whole > HARDLY[1] && missing > CAME_ABOUT * whole).then(|| {
        let missing = missing.to_degrees();
        format!("{id} is held by {}: {missing:.0} degrees of the turn would be missing", holder(new))
    })
}

/// What holds an object where it is, in words that a reviewer can act on.
fn holder(placed: &Placed) -> String {
    match (&placed.support, placed.item.relations.wall_affinity.wall()) {
        (Support::Object { id }, _) => format!("{id}, on which it stands (rehost puts it elsewhere)"),
        (Support::Wall { wall }, _) => format!("the {} wall, on which it hangs", wall.surface().name()),
        (Support::Ceiling, _) => "the ceiling, from which it hangs".to_owned(),
        (Support::Floor, Some(wall)) => {
            format!("the floor, the {} wall behind it, or its neighbours", wall.surface().name())
        }
        (Support::Floor, None) => "the floor or its neighbours".to_owned(),
    }
}
