//! Matched sets in the photo's left-to-right order: members exchange places, and what is missing is added with the shape of one
//! that is there. Paper App. C "Matched-group reordering" (key `group.swap`).

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_placement::ReviewAction;
use harmony_prompts::{GroupsQuestion, MatchedSet, MissingMember};
use harmony_roles::{Detection, Picture};
use harmony_scene::{Level, ObjectId, WarningKind};
use serde_json::json;

use super::added::{self, Wanted};
use super::review;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;
use crate::views;

/// Rounds at most: a set that was put in order is shown once more.
const ROUNDS: usize = 3;

/// Asks about the sets of a level and mends their order, until a picture of them shows nothing to swap.
///
/// # Errors
/// Fatal role errors and unwritable files only.
pub async fn order(ctx: &PhaseCtx<'_>, level: Level, state: &mut SceneState) -> Result<(), PhaseError> {
    if !ctx.settings.asked_looks().groups {
        return Ok(());
    }
    let mut rounds = Vec::new();
    for round in 1..=ROUNDS {
        let name = if round == 1 { "groups".to_owned() } else { format!("groups_{round}") };
        let sets = sets(state, level);
        if sets.is_empty() || !ctx.is_looked_at(&name) {
            break;
        }
        ctx.step("order within matched sets");
        let question = GroupsQuestion { sets };
        let pictures = pictures(ctx, state, &question).await?;
        let answer = ctx.ask(&name, question.clone(), pictures).await?;
        let sound = |complaint: Option<String>| {
            complaint.map(|complaint| ctx.warn(WarningKind::AnswerRepaired, None, complaint)).is_none()
        };
        let (mut swaps, mut swapped) = (Vec::new(), false);
        for swap in answer.swaps.iter().filter(|swap| sound(question.swap_complaint(swap))) {
            let (Ok(object), Ok(with)) = (ObjectId::new(&swap.id), ObjectId::new(&swap.with)) else { continue };
            let action = ReviewAction::Swap { object: object.clone(), with };
            let (kept, reason) = review::try_on(ctx, state, action, &object, "A swap within a set").await?;
            swapped |= kept;
            swaps.push(json!({ "asked": swap, "kept": kept, "reason": reason }));
        }
        let missing: Vec<&MissingMember> =
            answer.missing.iter().filter(|missing| sound(question.member_complaint(missing))).collect();
        let missing = missing.into_iter().filter_map(|missing| wanted(state, missing)).collect();
        let added = added::all(&ctx.inside(ctx.phase, &format!("{name}_added")), level, state, missing).await?;
        rounds.push(json!({ "swaps": swaps, "added": added }));
        if !swapped {
            break;
        }
    }
    if rounds.is_empty() { Ok(()) } else { ctx.write_json("groups.json", &rounds) }
}

/// The photo, and the scene with the members of the sets marked.
async fn pictures(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    question: &GroupsQuestion,
) -> Result<Vec<Picture>, PhaseError> {
    let (shown, asked) = (state.clone(), question.sets.clone());
    let pictures = ctx
        .computed(move || {
            let scene = views::marked(&shown, |id| asked.iter().any(|set| set.members.contains(id)));
            [("IMAGE 1: the photo", views::ruled(&shown.photo)), ("IMAGE 2: the reconstruction", views::ruled(&scene))]
                .map(|(caption, image)| Picture { caption: caption.into(), image: Arc::new(image) })
        })
        .await?;
    Ok(pictures.to_vec())
}

/// What is to be added for a member that is missing: the shape and the host of one that is there.
fn wanted(state: &SceneState, missing: &MissingMember) -> Option<Wanted> {
    let like = ObjectId::new(&missing.like).ok()?;
    let object = state.objects.get(&like)?;
    let bounds = views::pixels(state.partial.camera.size, missing.bounds);
    let detection = Detection { bounds, score: None, outline: None, ..object.detection.clone() };
    let host = state.partial.find(&like)?.item.relations.on_top_of.clone();
    Some(Wanted { detection, like: Some(like), host })
}

/// The sets of a level with at least two placed members, each from left to right in the photo.
fn sets(state: &SceneState, level: Level) -> Vec<MatchedSet> {
    let mut sets: BTreeMap<&str, Vec<(f64, &ObjectId)>> = BTreeMap::new();
    for placed in state.partial.placed.iter().filter(|p| p.item.level == level) {
        let name = placed.item.relations.matched_set.as_deref().filter(|name| !name.trim().is_empty());
        let across = state.partial.camera.project(placed.pose.position).map_or(0.0, |p| p.x);
        if let Some(name) = name {
            sets.entry(name).or_default().push((across, &placed.item.id));
        }
    }
    sets.into_iter()
        .filter(|(_, members)| members.len() > 1)
        .map(|(name, mut members)| {
            members.sort_by(|a, b| a.0.total_cmp(&b.0));
            MatchedSet { name: name.to_owned(), members: members.into_iter().map(|(_, id)| id.clone()).collect() }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_scene::Support;

    use super::*;
    use crate::testing::{add, empty_room, said};

    #[test]
    fn sets_are_read_from_left_to_right_and_single_members_are_none() {
        let mut state = empty_room();
        for (name, x, set) in [
            ("chair_01", 3.0, "chairs"),
            ("chair_02", 1.0, "chairs"),
            ("chair_03", 2.0, "chairs"),
            ("stool_01", 2.5, "stools"),
            ("stool_02", 0.5, " "),
        ] {
            let size = DVec3::new(0.4, 0.8, 0.4);
            let id = add(&mut state, name, Level::Furniture, size, DVec3::new(x, 0.0, 1.5), Support::Floor);
            said(&mut state, &id, |item| item.relations.matched_set = Some(set.to_owned()));
        }
        let sets = sets(&state, Level::Furniture);
        assert_eq!(sets.len(), 1);
        let members: Vec<&str> = sets[0].members.iter().map(ObjectId::as_str).collect();
        assert_eq!(members, ["chair_02", "chair_03", "chair_01"]);
    }
}
