//! Shapes follow what they stand among: cloth lies on what carries it (`harmony_placement::drape`), and where a point map is
//! good, seats, arms, backs and tops go where silhouette and depth have them (`harmony_placement::fit_form`).
//!
//! At the end, on what is placed: what made a shape (a program, a part model, a generator) is not asked again; its mesh is
//! bent, and how is written beside it. What moves on joints stays as it is: its parts are known by their boxes.

use std::sync::Arc;

use harmony_placement::{RoomPoints, Shape, bend_in, drape, drape_in, fit_form};
use harmony_scene::{Level, ObjectId, Support};
use serde_json::json;

use crate::Phase;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;

/// Lays cloth on what carries it: all, or an object and what lies on it. What was laid.
///
/// # Errors
/// Unwritable files.
pub async fn lie_on_hosts(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    only: Option<&ObjectId>,
) -> Result<Vec<ObjectId>, PhaseError> {
    let concerns = |id: &ObjectId| {
        let on =
            |host: &ObjectId| state.partial.find(id).is_some_and(|p| p.support == Support::Object { id: host.clone() });
        only.is_none_or(|only| only == id || on(only))
    };
    let concerned: Vec<_> = still(state).into_iter().filter(|(id, _)| concerns(id)).collect();
    let mut laid = Vec::new();
    for (id, level) in concerned {
        let (scene, settings, wanted) = (state.partial.clone(), ctx.settings.placement.clone(), id.clone());
        let draped = ctx
            .computed(move || {
                let draped = drape(&scene, &wanted)?;
                let scene = drape_in(&scene, &wanted, &draped.shape, &settings)?;
                Some((draped, scene))
            })
            .await?;
        let Some((draped, scene)) = draped else { continue };
        state.partial = scene;
        take_shape(state, &id, &draped.shape);
        let file = json!({ "over": draped.host, "farthest_m": (draped.farthest_m * 1e3).round() / 1e3 });
        ctx.write_json_in(Phase::Objects(level), &format!("meshes/{id}.drape.json"), &file)?;
        laid.push(id);
    }
    if !laid.is_empty() {
        ctx.step(&format!("{} cloths laid on what carries them", laid.len()));
    }
    Ok(laid)
}

/// What is placed and moves on no joints.
fn still(state: &SceneState) -> Vec<(ObjectId, Level)> {
    let moves = |id: &ObjectId| state.objects.get(id).and_then(|o| o.model.as_ref()).is_some_and(|model| model.moves);
    let placed = state.partial.placed.iter().map(|p| (p.item.id.clone(), p.item.level));
    placed.filter(|(id, _)| !moves(id)).collect()
}

fn take_shape(state: &mut SceneState, id: &ObjectId, shape: &Arc<Shape>) {
    state.forget_look(id);
    if let Some(model) = state.objects.get_mut(id).and_then(|o| o.model.as_mut()) {
        model.mesh = Arc::clone(shape.mesh());
        model.shape = Arc::clone(shape);
    }
}

/// Bends what is placed, where that explains the photo better.
///
/// # Errors
/// Unwritable files.
pub async fn follow_depth(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    if !state.partial.points.as_ref().is_some_and(RoomPoints::is_dense) {
        return Ok(());
    }
    let mut bent = 0;
    for (id, level) in still(state) {
        let (scene, settings, wanted) = (state.partial.clone(), ctx.settings.placement.clone(), id.clone());
        let fitted = ctx
            .computed(move || {
                let fitted = fit_form(&scene, &wanted, &settings)?;
                let scene = bend_in(&scene, &wanted, &fitted, &settings)?;
                Some((fitted, scene))
            })
            .await?;
        let Some((fitted, scene)) = fitted else { continue };
        state.partial = scene;
        take_shape(state, &id, &fitted.shape);
        if let Some(model) = state.objects.get_mut(&id).and_then(|o| o.model.as_mut()) {
            model.bulb = model.bulb.map(|at| fitted.bend.at(at));
        }
        let [x, y, z] = &fitted.bend.axes;
        let file = json!({ "x": x, "y": y, "z": z, "gained_nats": (fitted.gained * 100.0).round() / 100.0 });
        ctx.write_json_in(Phase::Objects(level), &format!("meshes/{id}.bend.json"), &file)?;
        bent += 1;
    }
    if bent > 0 {
        ctx.step(&format!("{bent} shapes follow the depth of the photo"));
    }
    Ok(())
}
