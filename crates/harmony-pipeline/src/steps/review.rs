//! The reflective feedback loop. Paper Sec. 3.3 (key `review.loop`): ask, try, measure, keep or refuse, and ask again.
//!
//! What is asked about one object is tried together: an object that is turned wrongly and too small besides agrees with its
//! mask only when both are put right. An action is kept when the evidence does not speak against it *and* the scene then
//! shows what was asked for; `review_<n>.json` has each object as it was and as it is.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use harmony_placement::{ActionError, Placed, ReviewAction, ReviewOutcome, Verdict, apply, collisions, judge};
use harmony_prompts::{ReviewActionAnswer, ReviewActionKind, ReviewAnswer, ReviewQuestion};
use harmony_roles::Picture;
use harmony_scene::{Level, ObjectId, WarningKind};
use serde_json::{Value, json};

use super::{surfaces, texture};
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Look, SceneState};
use crate::views;

/// Outline agreement below which a reviewer is told.
const POOR_IOU: f64 = 0.6;
/// Depth residual from which a reviewer is told, metres; and as a share of the distance from the camera.
const FAR_OFF: (f64, f64) = (0.12, 0.04);
/// Margin around a mask's box in which another is beside it, share of its size; and pairs that are tried together, at most.
const BESIDE: f64 = 0.05;
const MAX_PAIRS: usize = 8;
/// Times that what is refused is tried: again once others were kept.
const PASSES: usize = 2;
/// Penetration from which a reviewer is told, metres.
const DEEP: f64 = 0.02;

/// Reviews a level until nothing is asked for, nothing is kept, or the rounds are used up.
///
/// # Errors
/// Fatal role errors and unwritable files only.
pub async fn until_settled(ctx: &PhaseCtx<'_>, level: Level, state: &mut SceneState) -> Result<(), PhaseError> {
    let earlier = state.refused.clone();
    let mut tried = earlier.clone();
    for round in 1..=ctx.settings.rounds_of_review() {
        let name = format!("review_{round}");
        let empty = state.partial.placed.iter().all(|p| p.item.level != level);
        // The first question is asked of whoever there is, the further ones of who has eyes.
        if empty || (round > 1 && !ctx.is_looked_at(&name)) {
            return Ok(());
        }
        ctx.step(&format!("review {round}"));
        surfaces::keep_walls_open(state);
        let answer = ask(ctx, level, state, &name, std::mem::take(&mut tried)).await?;
        let mut came = Came::default();
        try_all(ctx, state, &grouped(&answer.actions), &mut came).await?;
        let kept = came.kept;
        tried = came.told;
        state.refused = earlier.iter().cloned().chain(came.in_vain).collect();
        ctx.write_json(
            &format!("{name}.json"),
            &json!({ "issues": answer.issues, "converged": answer.converged, "actions": came.records, "kept": kept }),
        )?;
        // What moved is drawn in its colours in the next round.
        texture::bare(ctx, state).await?;
        if answer.converged || kept == 0 {
            return Ok(());
        }
    }
    Ok(())
}

/// What came of a round's actions.
#[derive(Default)]
struct Came {
    kept: usize,
    /// For the next round's question.
    told: Vec<String>,
    /// What was refused to the end, for the questions of later levels.
    in_vain: Vec<String>,
    /// For `review_<n>.json`.
    records: Vec<Value>,
}

/// Tries the groups one after another, refused ones with their neighbours, and what is still refused once more after
/// others were kept: a chair comes to its place when the table has gone to its.
async fn try_all(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    groups: &[Vec<&ReviewActionAnswer>],
    came: &mut Came,
) -> Result<(), PhaseError> {
    let mut waiting: Vec<usize> = (0..groups.len()).collect();
    for pass in 1..=PASSES {
        let before = came.kept;
        let mut refused: Vec<(usize, String, String)> = Vec::new();
        for k in waiting {
            let result = try_together(ctx, state, &groups[k]).await?;
            refused.extend(result.refused.clone().map(|why| (k, why, result.told.clone())));
            if !result.kept && result.refused.is_none() {
                came.in_vain.push(result.told.clone());
            }
            if pass == 1 || result.kept {
                came.takes(result);
            }
        }
        let which: Vec<usize> = refused.iter().map(|(k, ..)| *k).collect();
        for (a, b) in beside_each_other(state, groups, &which) {
            if [a, b].iter().any(|k| refused.iter().all(|(other, ..)| other != k)) {
                continue;
            }
            let both: Vec<&ReviewActionAnswer> = groups[a].iter().chain(&groups[b]).copied().collect();
            let result = try_together(ctx, state, &both).await?;
            if result.kept {
                came.takes(result);
                refused.retain(|(k, ..)| *k != a && *k != b);
            }
        }
        if pass == PASSES || came.kept == before {
            for (k, why, told) in refused {
                came.in_vain.push(told);
                ctx.warn(WarningKind::ActionRefused, ObjectId::new(&groups[k][0].id).ok(), why);
            }
            break;
        }
        waiting = refused.into_iter().map(|(k, ..)| k).collect();
    }
    Ok(())
}

impl Came {
    fn takes(&mut self, tried: Tried) {
        self.kept += usize::from(tried.kept);
        self.told.push(tried.told);
        self.records.push(tried.record);
    }
}

async fn ask(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &SceneState,
    name: &str,
    tried: Vec<String>,
) -> Result<ReviewAnswer, PhaseError> {
    let question = ReviewQuestion {
        level,
        room: views::room_summary(state),
        placed: state.partial.placed.iter().map(views::placed_object).chain(views::ledges(state)).collect(),
        unplaced: state
            .left
            .iter()
            .filter(|left| left.phase == ctx.phase)
            .map(|left| format!("- {}: {}", left.name, left.reason))
            .collect(),
        findings: findings(ctx, level, state),
        tried,
    };
    let shown = state.clone();
    let (reconstruction, both) = ctx
        .computed(move || {
            let drawn = views::drawn(&shown);
            (views::with_room(&shown, Arc::clone(&drawn.flat)), views::blend(&shown, &drawn))
        })
        .await?;
    let pictures = vec![
        Picture { caption: "IMAGE 1: the photo".into(), image: state.photo.clone() },
        Picture { caption: "IMAGE 2: the reconstruction".into(), image: reconstruction },
        Picture { caption: "IMAGE 3: both, with outlines".into(), image: both },
    ];
    ctx.ask(name, question, pictures).await
}

/// What measurements complain about: outlines, depths, things in one another.
fn findings(ctx: &PhaseCtx<'_>, level: Level, state: &SceneState) -> Vec<String> {
    let eye = state.partial.camera.centre();
    let of_level = state.partial.placed.iter().filter(|p| p.item.level == level);
    let mut found: Vec<String> = of_level
        .filter_map(|p| {
            let iou = p.evidence.silhouette_iou?;
            let poor = iou < POOR_IOU && !p.item.traits.heavily_occluded;
            let deep = p.evidence.penetration_m > DEEP;
            let limit = FAR_OFF.0.max(FAR_OFF.1 * p.pose.position.distance(eye));
            let far = p.evidence.depth_residual_m.filter(|d| *d > limit);
            if !(poor || deep || far.is_some()) {
                return None;
            }
            let depth = far.map_or(String::new(), |d| format!(", depth off by {:.0} mm", d * 1000.0));
            let penetration = p.evidence.penetration_m * 1000.0;
            Some(format!("- {}: outline agreement {iou:.2}, penetration {penetration:.0} mm{depth}", p.item.id))
        })
        .collect();
    found.extend(short_sets(level, state));
    let member = |id: &ObjectId| state.partial.find(id).is_some_and(|p| p.item.level == level);
    let pairs =
        collisions(&state.partial, &ctx.settings.placement).into_iter().filter(|c| member(&c.a) || member(&c.b));
    found.extend(
        pairs
            .filter(|c| c.penetration > DEEP)
            .map(|c| format!("- {} and {} are {:.0} mm in one another", c.a, c.b, c.penetration * 1000.0)),
    );
    found
}

/// Matched sets of which fewer members are placed than were counted in the photo.
fn short_sets(level: Level, state: &SceneState) -> Vec<String> {
    let mut sets: BTreeMap<&str, (u32, u32)> = BTreeMap::new();
    for object in state.partial.placed.iter().filter_map(|p| state.objects.get(&p.item.id)) {
        if let Some(set) = object.said.matched_set.as_deref().filter(|_| object.level == level) {
            let (counted, placed) = sets.entry(set).or_default();
            *counted = (*counted).max(object.said.count.unwrap_or(0));
            *placed += 1;
        }
    }
    let short = sets.into_iter().filter(|(_, (counted, placed))| counted > placed);
    short
        .map(|(set, (counted, placed))| format!("- {set}: {counted} were counted in the photo, {placed} are placed"))
        .collect()
}

/// Actions that change one object and nothing else, together; all others alone; in the order of their first ones.
fn grouped(actions: &[ReviewActionAnswer]) -> Vec<Vec<&ReviewActionAnswer>> {
    let of_one = |a: &ReviewActionAnswer| {
        matches!(
            a.action,
            ReviewActionKind::Move | ReviewActionKind::Rotate | ReviewActionKind::Rescale | ReviewActionKind::Rehost
        )
    };
    let mut groups: Vec<Vec<&ReviewActionAnswer>> = Vec::new();
    for action in actions {
        let known = groups.iter_mut().find(|g| of_one(action) && of_one(g[0]) && g[0].id == action.id);
        match known {
            Some(group) => group.push(action),
            None => groups.push(vec![action]),
        }
    }
    for group in &mut groups {
        // A new host decides where the rest is counted from.
        group.sort_by_key(|a| !matches!(a.action, ReviewActionKind::Rehost));
    }
    groups
}

/// Pairs of refused groups that change one object each, where the two are seen side by side: what hides one another is right
/// together or not at all.
fn beside_each_other(
    state: &SceneState,
    groups: &[Vec<&ReviewActionAnswer>],
    refused: &[usize],
) -> Vec<(usize, usize)> {
    let size = state.partial.camera.size;
    let seen_at = |k: usize| {
        let group = &groups[k];
        let changes = group.iter().all(|a| {
            use ReviewActionKind::{Move, Rehost, Rescale, Rotate};
            matches!(a.action, Move | Rotate | Rescale | Rehost)
        });
        let placed = changes.then(|| state.partial.find(&ObjectId::new(&group[0].id).ok()?)).flatten()?;
        Some(placed.item.mask.bounds()?.padded(BESIDE, size))
    };
    let places: Vec<_> = refused.iter().filter_map(|k| Some((*k, seen_at(*k)?))).collect();
    let pairs = places.iter().enumerate().flat_map(|(i, p)| places[i + 1..].iter().map(move |q| (p, q)));
    let touching = pairs.filter(|(p, q)| groups[p.0][0].id != groups[q.0][0].id && p.1.intersection(&q.1).area() > 0.0);
    touching.map(|(p, q)| (p.0, q.0)).take(MAX_PAIRS).collect()
}

/// What came of actions that were tried together.
struct Tried {
    kept: bool,
    /// Why nothing of it was kept, where it was measured.
    refused: Option<String>,
    /// For `review_<n>.json`.
    record: Value,
    /// For the next round's question.
    told: String,
}

impl Tried {
    /// What came of actions that could not be tried together, one by one.
    fn of_each(each: Vec<Self>, reason: &str) -> Self {
        let kept = each.iter().any(|t| t.kept);
        let refused = if kept { None } else { each.iter().find_map(|t| t.refused.clone()) };
        let (records, told): (Vec<Value>, Vec<String>) = each.into_iter().map(|t| (t.record, t.told)).unzip();
        Self {
            kept,
            refused,
            record: json!({ "apart": records, "kept": kept, "reason": reason }),
            told: told.join("\n"),
        }
    }
}

/// Tries actions together, and when that is refused each by itself.
async fn try_together(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    answers: &[&ReviewActionAnswer],
) -> Result<Tried, PhaseError> {
    let mut actions = Vec::new();
    for answer in answers {
        match typed(state, answer) {
            Ok(action) => actions.push(action),
            Err(reason) => return Ok(untried(answers, &reason)),
        }
    }
    let name = answers.iter().map(|a| format!("{:?}", a.action)).collect::<Vec<_>>().join(" + ");
    let before = shown(state, answers);
    let together = attempt(ctx, state, actions.clone()).await?;
    let (verdict, alone) = match together {
        Err(error) if actions.len() < 2 => return Ok(untried(answers, &error.to_string())),
        Err(error) => {
            // One that cannot be tried does not take the others along.
            let mut told = Vec::new();
            for answer in answers {
                told.push(Box::pin(try_together(ctx, state, &[*answer])).await?);
            }
            return Ok(Tried::of_each(told, &error.to_string()));
        }
        Ok(Attempt { verdict, .. }) if !verdict.kept && actions.len() > 1 => {
            let mut kept = Vec::new();
            for (answer, action) in answers.iter().zip(actions) {
                if let Ok(single) = attempt(ctx, state, vec![action]).await?
                    && single.adopted(state)
                {
                    kept.push(format!("{:?}", answer.action));
                }
            }
            (verdict, kept)
        }
        Ok(attempt) => {
            let verdict = attempt.verdict.clone();
            attempt.adopted(state);
            (verdict, Vec::new())
        }
    };
    let kept = verdict.kept || !alone.is_empty();
    let refused = (!kept).then(|| format!("{name} was proposed and refused: {}", verdict.reason));
    if let (false, [_, ..]) = (verdict.kept, alone.as_slice()) {
        // Not tried again: a part of it has come about.
        let message =
            format!("of {name}, which was proposed together, {} alone was kept: {}", alone.join(" + "), verdict.reason);
        ctx.warn(WarningKind::ActionRefused, ObjectId::new(&answers[0].id).ok(), message);
    }
    let came = match (verdict.kept, alone.as_slice()) {
        (true, _) => "kept".to_owned(),
        (false, []) => format!("refused, {}", verdict.reason),
        (false, single) => format!("refused together, {}; kept alone: {}", verdict.reason, single.join(", ")),
    };
    let record = json!({
        "asked": answers, "kept": kept, "kept_alone": alone, "together": verdict,
        "before": before, "after": shown(state, answers),
    });
    let asked: Vec<String> = answers.iter().map(|a| in_words(a)).collect();
    Ok(Tried { kept, refused, record, told: format!("- {}: {came}", asked.join(" and ")) })
}

fn untried(answers: &[&ReviewActionAnswer], reason: &str) -> Tried {
    let asked: Vec<String> = answers.iter().map(|a| in_words(a)).collect();
    let told = format!("- {}: not tried, {reason}", asked.join(" and "));
    Tried { kept: false, refused: None, record: json!({ "asked": answers, "kept": false, "reason": reason }), told }
}

/// An action as it was asked for.
fn in_words(a: &ReviewActionAnswer) -> String {
    let mut words = format!("{} {}", json!(a.action).as_str().unwrap_or_default(), a.id);
    words.extend(a.other.iter().map(|other| format!(" and {other}")));
    words.extend(a.delta_m.iter().map(|[x, y, z]| format!(" by ({x:.2}, {y:.2}, {z:.2}) m")));
    words.extend(a.position_m.iter().map(|[x, y, z]| format!(" at ({x:.2}, {y:.2}, {z:.2}) m")));
    words.extend(a.angle_deg.iter().map(|deg| format!(" by {deg:.0} degrees")));
    words.extend(a.factor.iter().map(|[w, h, d]| format!(" by {w:.2}, {h:.2}, {d:.2}")));
    words
}

/// The objects that actions name, as the scene has them.
fn shown(state: &SceneState, answers: &[&ReviewActionAnswer]) -> Value {
    let named: BTreeSet<&str> =
        answers.iter().flat_map(|a| std::iter::once(&a.id).chain(&a.other)).map(String::as_str).collect();
    let row = |p: &Placed| {
        json!({
            "id": p.item.id, "position": p.pose.position.to_array(), "yaw_deg": p.pose.yaw.to_degrees().rem_euclid(360.0),
            "size": p.size(), "support": p.support,
        })
    };
    state.partial.placed.iter().filter(|p| named.contains(p.item.id.as_str())).map(row).collect()
}

/// Actions that were tried and measured.
struct Attempt {
    outcome: ReviewOutcome,
    verdict: Verdict,
}

impl Attempt {
    /// Takes the scene over if the verdict says so; tells whether it does.
    fn adopted(self, state: &mut SceneState) -> bool {
        if self.verdict.kept {
            let ReviewOutcome { scene, touched, added, .. } = self.outcome;
            for id in &touched {
                state.forget_look(id);
            }
            adopt_copies(state, &scene, &added);
            state.take(scene);
        }
        self.verdict.kept
    }
}

async fn attempt(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    actions: Vec<ReviewAction>,
) -> Result<Result<Attempt, ActionError>, PhaseError> {
    let (partial, settings) = (state.partial.clone(), ctx.settings.placement.clone());
    ctx.computed(move || {
        let outcome = apply(&partial, &actions, &settings)?;
        let verdict = judge(&partial, &outcome, &settings);
        Ok(Attempt { outcome, verdict })
    })
    .await
}

/// Tries an action on an object and keeps it, if the evidence does not speak against it; tells whether it stays and why. One
/// that does not stay is warned of.
///
/// # Errors
/// Only that of a computation that broke.
pub async fn try_on(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    action: ReviewAction,
    object: &ObjectId,
    name: &str,
) -> Result<(bool, String), PhaseError> {
    let (kept, reason, refused) = try_quietly(ctx, state, vec![action]).await?;
    if !kept {
        ctx.warn(WarningKind::ActionRefused, Some(object.clone()), format!("{name} {refused}: {reason}"));
    }
    Ok((kept, reason))
}

/// Tries actions together and keeps them, if the evidence does not speak against it; tells whether they stay, why, and how it is
/// said that they do not.
///
/// # Errors
/// Only that of a computation that broke.
pub async fn try_quietly(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    actions: Vec<ReviewAction>,
) -> Result<(bool, String, &'static str), PhaseError> {
    Ok(match attempt(ctx, state, actions).await? {
        Ok(attempt) => {
            let reason = attempt.verdict.reason.clone();
            (attempt.adopted(state), reason, "was proposed and refused")
        }
        Err(error) => (false, error.to_string(), "cannot be tried"),
    })
}

/// Copies that an action added get an entry among the objects, like the one they copy.
fn adopt_copies(state: &mut SceneState, scene: &harmony_placement::PartialScene, added: &[(ObjectId, ObjectId)]) {
    for (id, like) in added {
        let (Some(placed), Some(original)) = (scene.find(id), state.objects.get(like)) else { continue };
        let mut copy = original.clone();
        copy.id = id.clone();
        copy.mask = Arc::clone(&placed.item.mask);
        copy.mask_score = None;
        copy.index = placed.item.index;
        copy.look = Look::default();
        if let Some(model) = &mut copy.model {
            model.source = format!("copy of {like}: {}", model.source);
        }
        state.next_index = state.next_index.max(copy.index + 1);
        state.objects.insert(id.clone(), copy);
    }
}

/// An answer's action, or why it cannot be tried.
fn typed(state: &SceneState, a: &ReviewActionAnswer) -> Result<ReviewAction, String> {
    let id = |text: &str| ObjectId::new(text).map_err(|_| format!("{text:?} is no id"));
    let object = id(&a.id)?;
    let other = || a.other.as_deref().ok_or("it names no other object".to_owned()).and_then(id);
    let needs = |field: &str| format!("it has no {field}");
    Ok(match a.action {
        ReviewActionKind::Move => ReviewAction::Move { object, by_m: a.delta_m.ok_or_else(|| needs("delta_m"))? },
        ReviewActionKind::Rotate => {
            ReviewAction::Rotate { object, by_deg: a.angle_deg.ok_or_else(|| needs("angle_deg"))? }
        }
        ReviewActionKind::Rescale => ReviewAction::Rescale { object, factor: a.factor.ok_or_else(|| needs("factor"))? },
        ReviewActionKind::Swap => ReviewAction::Swap { object, with: other()? },
        ReviewActionKind::Rehost => ReviewAction::Rehost { object, host: other()? },
        ReviewActionKind::Add => {
            let like =
                state.partial.find(&object).ok_or_else(|| format!("there is no object {object} in the scene"))?;
            let yaw_deg = a.angle_deg.unwrap_or(like.pose.yaw.to_degrees());
            ReviewAction::Add { like: object, at_m: a.position_m.ok_or_else(|| needs("position_m"))?, yaw_deg }
        }
        ReviewActionKind::Remove => ReviewAction::Remove { object },
        ReviewActionKind::EqualizeGroup => ReviewAction::Equalize { object },
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_scene::Support;

    use super::*;
    use crate::testing::{add, empty_room};

    fn action(action: ReviewActionKind, id: &str) -> ReviewActionAnswer {
        ReviewActionAnswer {
            action,
            id: id.to_owned(),
            other: None,
            delta_m: Some([0.1, 0.0, 0.0]),
            position_m: None,
            angle_deg: None,
            factor: None,
            reason: String::new(),
        }
    }

    #[test]
    fn what_changes_one_object_is_tried_together_and_a_new_host_first() {
        use ReviewActionKind::{Add, Move, Rehost, Remove, Rescale, Rotate};
        let all = [
            action(Move, "lamp_01"),
            action(Remove, "lamp_02"),
            action(Rotate, "chair_01"),
            action(Rehost, "lamp_01"),
            action(Add, "chair_01"),
            action(Rescale, "chair_01"),
        ];
        let groups = grouped(&all);
        let told: Vec<Vec<String>> =
            groups.iter().map(|g| g.iter().map(|a| format!("{:?} {}", a.action, a.id)).collect()).collect();
        assert_eq!(
            told,
            [
                vec!["Rehost lamp_01", "Move lamp_01"],
                vec!["Remove lamp_02"],
                vec!["Rotate chair_01", "Rescale chair_01"],
                vec!["Add chair_01"],
            ]
        );
    }

    #[test]
    fn refused_changes_of_things_seen_side_by_side_are_tried_together() {
        use ReviewActionKind::{Move, Remove};
        let mut state = empty_room();
        for (name, x) in [("cushion_01", 1.5), ("cushion_02", 1.7), ("lamp_01", 3.5)] {
            let (size, at) = (DVec3::new(0.4, 0.4, 0.3), DVec3::new(x, 0.0, 1.5));
            add(&mut state, name, Level::Furniture, size, at, Support::Floor);
        }
        let all = [
            action(Move, "cushion_01"),
            action(Move, "lamp_01"),
            action(Move, "cushion_02"),
            action(Remove, "cushion_02"),
            action(Move, "gone_01"),
        ];
        let groups = grouped(&all);
        assert_eq!(beside_each_other(&state, &groups, &[0, 1, 2, 3, 4]), [(0, 2)]);
        assert!(beside_each_other(&state, &groups, &[0, 1]).is_empty(), "the other one was kept");
    }

    #[test]
    fn a_set_that_is_short_of_members_is_told() {
        let mut state = empty_room();
        for (i, count) in [(1, None), (2, Some(3))] {
            let (size, at) = (DVec3::new(0.4, 0.8, 0.4), DVec3::new(f64::from(i), 0.0, 1.5));
            let id = add(&mut state, &format!("chair_0{i}"), Level::Furniture, size, at, Support::Floor);
            let object = state.objects.get_mut(&id).unwrap();
            object.said.matched_set = Some("chairs".to_owned());
            object.said.count = count;
        }
        assert_eq!(short_sets(Level::Furniture, &state), ["- chairs: 3 were counted in the photo, 2 are placed"]);
        assert!(short_sets(Level::Decoration, &state).is_empty());
        state.objects.values_mut().for_each(|object| object.said.count = Some(2));
        assert!(short_sets(Level::Furniture, &state).is_empty());
    }

    #[test]
    fn a_copy_has_the_mesh_of_the_one_it_was_made_from_and_not_its_pixels() {
        let mut state = empty_room();
        let mut last = None;
        // Two of one kind with different meshes: the one that was named is copied.
        for (i, height) in [(1, 0.5), (2, 0.9)] {
            let (size, at) = (DVec3::new(0.4, height, 0.4), DVec3::new(f64::from(i), 0.0, 1.5));
            last = Some(add(&mut state, &format!("chair_0{i}"), Level::Furniture, size, at, Support::Floor));
        }
        let like = last.unwrap();
        let action = ReviewAction::Add { like: like.clone(), at_m: [3.2, 0.0, 1.0], yaw_deg: 0.0 };
        let settings = harmony_placement::PlacementSettings::default();
        let outcome = apply(&state.partial, &[action], &settings).unwrap();
        let (id, of) = outcome.added[0].clone();
        assert_eq!(of, like);
        adopt_copies(&mut state, &outcome.scene, &outcome.added);
        state.take(outcome.scene);
        let (copy, original) = (&state.objects[&id], &state.objects[&like]);
        let mesh = |object: &crate::state::Object| Arc::clone(&object.model.as_ref().unwrap().mesh);
        assert!(Arc::ptr_eq(&mesh(copy), &mesh(original)));
        assert_eq!(copy.mask.count(), 0);
        assert!(state.mesh_of(&id).is_some());
        assert!(copy.index > original.index && state.next_index > copy.index);
    }

    #[test]
    fn actions_are_told_with_their_numbers() {
        assert_eq!(in_words(&action(ReviewActionKind::Move, "lamp_01")), "move lamp_01 by (0.10, 0.00, 0.00) m");
    }
}
