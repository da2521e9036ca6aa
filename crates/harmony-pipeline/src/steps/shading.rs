//! The photo's light on boards and on what was modelled by programs, for looks without lamps ([`harmony_render::shade`]).

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_mesh::{Material, Mesh};
use harmony_render::{SOLID, Stands, opacity, shade};
use harmony_scene::{Mask, ObjectId, Pose, Vec3};

use super::{features, grain, surfaces};
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;
use crate::views;

/// Gives boards the photo's light, fits the law of light to what it shows and lights every material whose colour was said.
///
/// # Errors
/// Only that of a computation that broke.
pub async fn everything(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    let bare = state.clone();
    state.trims = ctx.computed(move || surfaces::trims_in_photo(&bare)).await?;
    let any =
        |id: &ObjectId| state.objects.get(id).and_then(|o| o.model.as_ref()).is_some_and(|m| !m.said_slots.is_empty());
    let built = state.features.iter().any(|f| !f.said.is_empty());
    if !built && !state.partial.placed.iter().any(|p| any(&p.item.id)) {
        return Ok(());
    }
    let shown = Arc::new(state.clone());
    let Lit { objects, features } = ctx.computed(move || lit(&shown)).await?;
    for (id, object) in &mut state.objects {
        object.look.lit = objects.get(id).cloned();
    }
    for (feature, lit) in state.features.iter_mut().zip(features) {
        feature.lit = lit;
    }
    Ok(())
}

/// Meshes in the photo's light.
struct Lit {
    objects: BTreeMap<ObjectId, Arc<Mesh>>,
    /// What is built into the room, one by one.
    features: Vec<Option<Arc<Mesh>>>,
}

/// An object as it stands before it is lit.
struct Thing {
    /// `None`: built into the room.
    id: Option<ObjectId>,
    mesh: Arc<Mesh>,
    pose: Pose,
    visible: Option<Mask>,
    plain: Vec<bool>,
}

impl Thing {
    fn stands<'a>(&'a self, mesh: &'a Mesh) -> Stands<'a> {
        Stands { mesh, pose: self.pose, visible: self.visible.as_ref(), plain: &self.plain }
    }
}

fn lit(state: &SceneState) -> Lit {
    let ids = views::ids(state);
    let mut things: Vec<Thing> = state
        .partial
        .placed
        .iter()
        .filter_map(|placed| {
            let id = placed.item.id.clone();
            let mesh = Arc::clone(state.unlit(&id)?);
            let model = state.objects.get(&id)?.model.as_ref()?;
            let plain: Vec<bool> = mesh.materials.iter().map(|m| is_said(&model.said_slots, m)).collect();
            let plain = if plain.contains(&true) { plain } else { Vec::new() };
            let visible = if plain.is_empty() { None } else { state.visible_mask(&id, &ids) };
            Some(Thing { id: Some(id), mesh, pose: placed.pose, visible, plain })
        })
        .collect();
    things.extend(state.features.iter().zip(features::pixels(state)).map(|(feature, visible)| Thing {
        id: None,
        mesh: Arc::clone(&feature.mesh),
        pose: Pose::new(Vec3::ZERO, 0.0, 1.0),
        visible: Some(visible),
        plain: feature.mesh.materials.iter().map(|m| is_said(&feature.said, m)).collect(),
    }));
    let shell = views::shell_alone(state);
    let (camera, photo) = (&state.partial.camera, &*state.photo);
    let as_said: Vec<Stands<'_>> = things.iter().map(|t| t.stands(&t.mesh)).collect();
    let grained = grain::as_seen(&shell, &as_said, camera, photo);
    let stands: Vec<Stands<'_>> =
        things.iter().zip(&grained).map(|(t, grained)| t.stands(grained.as_ref().unwrap_or(&t.mesh))).collect();
    let shaded = shade(&shell, &stands, camera, photo, &state.partial.room.extents);
    let mut meshes = shaded.meshes.into_iter().map(|mesh| mesh.map(Arc::new));
    let objects = things.iter().map_while(|t| t.id.clone()).zip(meshes.by_ref());
    let objects = objects.filter_map(|(id, mesh)| Some((id, mesh?))).collect();
    Lit { objects, features: meshes.collect() }
}

/// Whether a material has a colour that was said and light falls on: not what shines or is seen through.
fn is_said(said: &[String], material: &Material) -> bool {
    said.contains(&material.name)
        && material.texture.is_none()
        && material.emissive.iter().all(|e| *e <= 0.0)
        && opacity(material) >= SOLID
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_scene::{Level, Support};
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn what_was_said_is_lit_as_the_photo_has_it_whoever_built_it() {
        let mut state = empty_room();
        let size = state.photo.dimensions();
        state.photo = Arc::new(RgbImage::from_pixel(size.0, size.1, Rgb([70; 3])));
        let (a, b) = (DVec3::new(1.2, 0.0, 2.0), DVec3::new(2.8, 0.0, 2.0));
        let said = add(&mut state, "cabinet_01", Level::Furniture, DVec3::splat(0.8), a, Support::Floor);
        let painted = add(&mut state, "chest_01", Level::Furniture, DVec3::splat(0.8), b, Support::Floor);
        state.objects.get_mut(&said).unwrap().model.as_mut().unwrap().said_slots = vec!["box".to_owned()];
        let lit = lit(&state).objects;
        assert!(!lit.contains_key(&painted), "the photo's pixels hold its light");
        let mesh = &lit[&said];
        let base = mesh.materials[0].base_color[0];
        let seen: f32 = mesh.colors.iter().map(|c| c[0] * base).sum::<f32>() / mesh.colors.len() as f32;
        // Said 0.5, in the photo 0.061 linear.
        assert!((0.03..0.12).contains(&seen), "{seen}");
    }
}
