//! Textures from the photo: part models get their colours from the object's own pixels (DESIGN section 7).

use std::sync::Arc;

use harmony_catalogue::Trait;
use harmony_mesh::Material;
use harmony_render::{BakeOptions, SOLID, bake_texture, opacity};
use harmony_scene::{Level, ObjectId, WarningKind};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Object, SceneState};
use crate::views;

/// Linear brightness up to which glass is black.
const BLACK: f32 = 0.06;

/// Textures the objects of one level that have none yet.
///
/// # Errors
/// None of its own; the type is that of the steps.
pub async fn level(ctx: &PhaseCtx<'_>, state: &mut SceneState, level: Level) -> Result<(), PhaseError> {
    let ids: Vec<ObjectId> = state
        .partial
        .placed
        .iter()
        .filter(|p| p.item.level == level && state.objects.get(&p.item.id).is_some_and(|o| o.look.textured.is_none()))
        .map(|p| p.item.id.clone())
        .collect();
    bake(ctx, state, ids).await
}

/// Textures every object anew: masks of later levels have taken pixels away from earlier ones.
///
/// # Errors
/// None of its own; the type is that of the steps.
pub async fn everything(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    let ids = state.partial.placed.iter().map(|p| p.item.id.clone()).collect();
    bake(ctx, state, ids).await
}

/// Textures some objects anew.
///
/// # Errors
/// None of its own; the type is that of the steps.
pub async fn only(ctx: &PhaseCtx<'_>, state: &mut SceneState, ids: Vec<ObjectId>) -> Result<(), PhaseError> {
    bake(ctx, state, ids).await
}

async fn bake(ctx: &PhaseCtx<'_>, state: &mut SceneState, ids: Vec<ObjectId>) -> Result<(), PhaseError> {
    let camera = state.partial.camera;
    let modelled = |id: &ObjectId| state.objects.get(id).is_some_and(Object::is_modelled);
    if !ids.iter().any(modelled) {
        return Ok(());
    }
    let shown = views::ids(state);
    let mut jobs = Vec::new();
    for id in ids {
        let object = state.objects.get(&id).filter(|object| object.is_modelled());
        let (Some(placed), Some(model), Some(visible)) =
            (state.partial.find(&id), object.and_then(|o| o.model.as_ref()), state.visible_mask(&id, &shown))
        else {
            continue;
        };
        let at_wall = placed.item.level == Level::Wall;
        // What is seen through glass is not its paint, but for the view out of a window.
        let clear = model.mesh.materials.iter().filter(|m| !at_wall && is_clear(m)).map(|m| m.name.clone());
        let options = BakeOptions {
            plain_slots: model.plain_slots.iter().cloned().chain(clear).collect(),
            trusted: at_wall && harmony_catalogue::has(&placed.item.label, Trait::Planar),
            ..BakeOptions::default()
        };
        if model.mesh.materials.iter().all(|m| options.plain_slots.contains(&m.name)) {
            // Nothing of it takes the photo's pixels.
            let mesh = model.mesh.clone();
            state.set_textured(&id, mesh);
            continue;
        }
        jobs.push((id, model.mesh.clone(), placed.pose, visible, options));
    }
    let photo = state.photo.clone();
    let baked = tokio::task::spawn_blocking(move || {
        use rayon::prelude::*;
        jobs.into_par_iter()
            .map(|(id, mesh, pose, visible, options)| {
                let baked = bake_texture(&mesh, &pose, &camera, &photo, &visible, &options);
                (id, baked)
            })
            .collect::<Vec<_>>()
    })
    .await
    .map_err(|e| PhaseError::internal(ctx.phase, &e))?;
    for (id, baked) in baked {
        if baked.observed < 0.02 {
            ctx.warn(
                WarningKind::LowConfidence,
                Some(id.clone()),
                "hardly any of its surface is seen: the texture is mostly made up".to_owned(),
            );
        }
        let mut mesh = baked.mesh;
        // A pane that shows the photo's view is not clear any more, nor is a screen.
        for material in mesh.materials.iter_mut().filter(|m| m.texture.is_some()) {
            material.transmission = 0.0;
        }
        state.set_textured(&id, Arc::new(mesh));
    }
    Ok(())
}

/// Whether one sees through a material: black glass (a screen) lets nothing pass.
fn is_clear(material: &Material) -> bool {
    let [r, g, b, _] = material.base_color;
    opacity(material) < SOLID && r.max(g).max(b) > BLACK
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bottles_are_clear_and_screens_are_not() {
        let glass = |rgb: [f32; 3]| Material { transmission: 0.9, ..Material::plain("glass", rgb) };
        assert!(is_clear(&glass([0.9, 0.95, 0.9])));
        assert!(is_clear(&glass([0.02, 0.2, 0.05])), "a green bottle");
        assert!(!is_clear(&glass([0.01, 0.01, 0.02])));
        assert!(!is_clear(&Material::plain("wood", [0.5, 0.3, 0.1])));
    }
}
