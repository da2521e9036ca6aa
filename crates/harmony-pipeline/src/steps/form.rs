//! Shapes follow silhouette and depth: where a point map is good, seats, arms, backs and tops go where it has them.
//!
//! At the end, on what is placed: what made a shape (a program, a part model, a generator) is not asked again; its mesh is
//! bent (`harmony_placement::fit_form`), and how is written beside it. What moves on joints stays as it is: its parts are
//! known by their boxes.

use harmony_placement::{RoomPoints, bend_in, fit_form};
use serde_json::json;

use crate::Phase;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;

/// Bends what is placed, where that explains the photo better.
///
/// # Errors
/// Unwritable files.
pub async fn follow_depth(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    if !state.partial.points.as_ref().is_some_and(RoomPoints::is_dense) {
        return Ok(());
    }
    let ids: Vec<_> = state.partial.placed.iter().map(|p| (p.item.id.clone(), p.item.level)).collect();
    let mut bent = 0;
    for (id, level) in ids {
        if state.objects.get(&id).and_then(|o| o.model.as_ref()).is_some_and(|model| model.moves) {
            continue;
        }
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
        state.forget_look(&id);
        if let Some(model) = state.objects.get_mut(&id).and_then(|o| o.model.as_mut()) {
            model.mesh = fitted.shape.mesh().clone();
            model.shape = fitted.shape.clone();
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
