//! The photo's light on what was modelled by programs, for looks without lamps ([`harmony_render::shade`]).

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_mesh::{Material, Mesh};
use harmony_render::{SOLID, Stands, opacity, shade};
use harmony_scene::{Mask, ObjectId};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Model, SceneState};
use crate::views;

/// Fits the law of light to what the photo shows and lights every material whose colour was said.
///
/// # Errors
/// Only that of a computation that broke.
pub async fn everything(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    let any =
        |id: &ObjectId| state.objects.get(id).and_then(|o| o.model.as_ref()).is_some_and(|m| !m.said_slots.is_empty());
    if !state.partial.placed.iter().any(|p| any(&p.item.id)) {
        return Ok(());
    }
    let shown = Arc::new(state.clone());
    let lit = ctx.computed(move || lit(&shown)).await?;
    for (id, object) in &mut state.objects {
        object.look.lit = lit.get(id).cloned();
    }
    Ok(())
}

fn lit(state: &SceneState) -> BTreeMap<ObjectId, Arc<Mesh>> {
    struct Thing {
        id: ObjectId,
        mesh: Arc<Mesh>,
        pose: harmony_scene::Pose,
        visible: Option<Mask>,
        plain: Vec<bool>,
    }
    let ids = views::ids(state);
    let things: Vec<Thing> = state
        .partial
        .placed
        .iter()
        .filter_map(|placed| {
            let id = placed.item.id.clone();
            let mesh = Arc::clone(state.unlit(&id)?);
            let model = state.objects.get(&id)?.model.as_ref()?;
            let plain: Vec<bool> = mesh.materials.iter().map(|m| is_said(model, m)).collect();
            let plain = if plain.contains(&true) { plain } else { Vec::new() };
            let visible = if plain.is_empty() { None } else { state.visible_mask(&id, &ids) };
            Some(Thing { id, mesh, pose: placed.pose, visible, plain })
        })
        .collect();
    let stands: Vec<Stands<'_>> = things
        .iter()
        .map(|t| Stands { mesh: &t.mesh, pose: t.pose, visible: t.visible.as_ref(), plain: &t.plain })
        .collect();
    let shell = views::shell(state, Vec::new());
    let shaded = shade(&shell, &stands, &state.partial.camera, &state.photo, &state.partial.room.extents);
    let ids = things.iter().map(|t| t.id.clone());
    ids.zip(shaded.meshes).filter_map(|(id, mesh)| Some((id, Arc::new(mesh?)))).collect()
}

/// Whether a material has a colour that was said and light falls on: not what shines or is seen through.
fn is_said(model: &Model, material: &Material) -> bool {
    model.program.is_some()
        && model.said_slots.contains(&material.name)
        && material.texture.is_none()
        && material.emissive.iter().all(|e| *e <= 0.0)
        && opacity(material) >= SOLID
}
