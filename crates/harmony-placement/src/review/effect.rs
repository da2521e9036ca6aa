//! Whether actions have come about: a support may hold an object where an action would not have it.

use std::collections::BTreeMap;

use harmony_scene::{Ledge, ObjectId, Support, Vec3};

use super::{ReviewAction, members_of_set};
use crate::scene::attachment::angle_between;
use crate::{PartialScene, Placed};

/// Share of what was asked for that must have come about.
const CAME_ABOUT: f64 = 0.5;
/// How far beside the place that was asked for something may land, beside that share of the way, metres.
const ASIDE: f64 = 0.1;
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

/// What the actions ask for and the scene after them does not show, in words. `added`: the new objects, each with the one that
/// it is a copy of, in the order of the actions that added them.
///
/// What is to go is gone and a set is of one size whatever its supports do: of these there is nothing to check but that a set
/// was not of one size already.
pub(super) fn missed(
    before: &PartialScene,
    after: &PartialScene,
    actions: &[ReviewAction],
    added: &[(ObjectId, ObjectId)],
) -> Option<String> {
    let mut asked: BTreeMap<&ObjectId, Asked> = BTreeMap::new();
    let mut copies = added.iter();
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
                for (id, other) in [(object, with), (with, object)] {
                    asked.entry(id).or_default().relocated = true;
                    if let Some(stays) = stayed(id, before.find(id)?, after.find(id)?, before.find(other)?) {
                        return Some(stays);
                    }
                }
            }
            ReviewAction::Equalize { object } => {
                if let Some(same) = of_one_size(before, object) {
                    return Some(same);
                }
            }
            ReviewAction::Add { at_m, yaw_deg, .. } => {
                let (id, like) = copies.next()?;
                let (old, new) = (before.find(like)?, after.find(id)?);
                let by = Vec3::from_array(*at_m) - old.pose.position;
                let asked = Asked { by, turn: yaw_deg.to_radians() - old.pose.yaw, ..Asked::default() };
                if let Some(elsewhere) = of_one(id, &asked, old, new) {
                    return Some(elsewhere);
                }
            }
            ReviewAction::Remove { .. } => {}
        }
    }
    asked.iter().find_map(|(id, asked)| of_one(id, asked, before.find(id)?, after.find(id)?))
}

/// Whether one of two that were to exchange their places is still nearer to its own.
fn stayed(id: &ObjectId, old: &Placed, new: &Placed, other: &Placed) -> Option<String> {
    let far = |place: &Placed| new.pose.position.distance(place.pose.position);
    let apart = old.pose.position.distance(other.pose.position);
    (apart > HARDLY[0] && far(old) < far(other))
        .then(|| format!("{id} would stay near its place, for what is seen of {} is there", other.item.id))
}

/// Whether all members of an object's matched set have one size already.
fn of_one_size(scene: &PartialScene, object: &ObjectId) -> Option<String> {
    let members = members_of_set(scene, object)?;
    let sizes: Vec<Vec3> = members.iter().map(|k| scene.placed[*k].size().as_vec().map(f64::ln)).collect();
    let alike = sizes.iter().all(|size| (*size - sizes[0]).abs().max_element() <= HARDLY[2]);
    alike.then(|| format!("the set of {object} is of one size already"))
}

fn stands_on(support: &Support, host: &ObjectId) -> bool {
    match support {
        Support::Object { id } => id == host,
        support => support.ledge().is_some_and(|ledge| ledge.id() == *host),
    }
}

fn of_one(id: &ObjectId, asked: &Asked, old: &Placed, new: &Placed) -> Option<String> {
    if let Some(host) = &asked.host
        && !stands_on(&new.support, host)
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
    let beside = (new.pose.position - old.pose.position - asked.by).with_y(0.0).length();
    if far > HARDLY[0] && beside > ASIDE + CAME_ABOUT * far {
        return Some(format!(
            "{id} would land {beside:.2} m beside the place that was asked for: something stands there"
        ));
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
        (Support::Block { block }, _) => format!("{}, on which it stands", Ledge::Block(*block).id()),
        (Support::Niche { niche }, _) => format!("{}, in which it stands", Ledge::Niche(*niche).id()),
        (Support::Ceiling, _) => "the ceiling, from which it hangs".to_owned(),
        (Support::Floor, Some(wall)) => {
            format!("the floor, the {} wall behind it, or its neighbours", wall.surface().name())
        }
        (Support::Floor, None) => "the floor or its neighbours".to_owned(),
    }
}
