//! Textures from the photo: part models get their colours from the object's own pixels.

use std::sync::Arc;

use harmony_catalogue::Trait;
use harmony_mesh::{Material, Mesh};
use harmony_render::{BakeOptions, Instance, RenderOptions, SOLID, bake_texture, opacity, render_depth_ids};
use harmony_scene::{Level, Mask, ObjectId, OpeningKind, WarningKind};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Model, Object, SceneState};
use crate::views;

/// Linear brightness up to which glass is black.
const BLACK: f32 = 0.06;

/// A slot of which a smaller share of its pixels is surrounded by its own is seen as an edge.
const THIN: f64 = 0.35;

/// Textures what has no texture, on whatever level: another host, turn or place in a set makes objects of earlier levels bare
/// as well, and who reviews should see them in their colours.
///
/// # Errors
/// None of its own; the type is that of the steps.
pub async fn bare(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    let ids = untextured(state);
    bake(ctx, state, ids).await
}

/// Placed objects without texture.
fn untextured(state: &SceneState) -> Vec<ObjectId> {
    let bare = |id: &ObjectId| state.objects.get(id).is_some_and(|o| o.look.textured.is_none());
    state.partial.placed.iter().map(|p| p.item.id.clone()).filter(bare).collect()
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
    for id in &ids {
        let thin = thin_slots(state, id, &shown);
        if let Some(model) = state.objects.get_mut(id).and_then(|object| object.model.as_mut()) {
            for slot in thin {
                for slots in [&mut model.plain_slots, &mut model.said_slots] {
                    if !slots.contains(&slot) {
                        slots.push(slot.clone());
                    }
                }
            }
        }
    }
    for id in ids {
        let object = state.objects.get(&id).filter(|object| object.is_modelled());
        let (Some(placed), Some(model), Some(visible)) =
            (state.partial.find(&id), object.and_then(|o| o.model.as_ref()), state.visible_mask(&id, &shown))
        else {
            continue;
        };
        let at_wall = placed.item.level == Level::Wall;
        let options = BakeOptions {
            plain_slots: plain_slots(model, &placed.item.label, at_wall),
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

/// Slots of a template or part model whose colour was said and of which the photo shows hardly more than edges, as of a picture's frame
/// two pixels wide: its neighbours' colours are mixed into what is seen of it, and the said colour is nearer to the truth.
fn thin_slots(state: &SceneState, id: &ObjectId, shown: &[u32]) -> Vec<String> {
    let found = || {
        let object = state.objects.get(id)?;
        let model = object.model.as_ref().filter(|m| m.program.is_none())?;
        let colors = object.said.params.as_ref().map_or(&[][..], |params| &params.colors);
        let named = |name: &str| object.said.part_model.is_some() || colors.iter().any(|c| c.slot == name);
        if !model.mesh.materials.iter().any(|m| named(&m.name)) {
            return None;
        }
        let (placed, visible) = (state.partial.find(id)?, state.visible_mask(id, shown)?);
        let parts: Vec<Mesh> =
            model.mesh.groups.iter().map(|g| Mesh { groups: vec![g.clone()], ..(*model.mesh).clone() }).collect();
        let instances: Vec<Instance<'_>> =
            parts.iter().enumerate().map(|(k, part)| Instance::posed(part, &placed.pose, k as u32 + 1)).collect();
        let frame = render_depth_ids(&state.partial.camera, &instances, &RenderOptions::default());
        let width = state.partial.camera.size.width;
        let seen_of = |material: usize| {
            Mask::from_fn(state.partial.camera.size, |x, y| {
                let part = frame.ids[(y * width + x) as usize] as usize;
                let of_slot = part > 0 && model.mesh.groups.get(part - 1).is_some_and(|g| g.material == material);
                of_slot && visible.get(i64::from(x), i64::from(y))
            })
        };
        let materials = model.mesh.materials.iter().enumerate().filter(|(_, m)| named(&m.name));
        let thin = materials.filter(|(k, _)| {
            let seen = seen_of(*k);
            (seen.dilated(-1).count() as f64) < THIN * seen.count() as f64
        });
        Some(thin.map(|(_, m)| m.name.clone()).collect())
    };
    found().unwrap_or_default()
}

/// Slots that keep their look whatever the photo shows.
///
/// What is seen through glass is not its paint, but for the view out of a window: a window's pane shows it, whoever made it.
/// A looking-glass shows what the photo shows in it; whoever traces paths takes that off again.
fn plain_slots(model: &Model, label: &str, at_wall: bool) -> Vec<String> {
    let is_window = at_wall && harmony_catalogue::opening(label) == Some(OpeningKind::Window);
    let is_pane = |m: &Material| harmony_lighting::sources::is_pane_name(&m.name) && is_clear(m);
    let is_plain = |(k, m): (usize, &Material)| {
        let said = model.plain_slots.contains(&m.name);
        let shows = model.mesh.is_looking_glass(k) || (is_window && is_pane(m));
        ((said && !shows) || (!at_wall && is_clear(m))).then(|| m.name.clone())
    };
    model.mesh.materials.iter().enumerate().filter_map(is_plain).collect()
}

/// Whether one sees through a material: black glass (a screen) lets nothing pass.
fn is_clear(material: &Material) -> bool {
    let [r, g, b, _] = material.base_color;
    opacity(material) < SOLID && r.max(g).max(b) > BLACK
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_mesh::{SlotColor, TemplateParams};
    use harmony_scene::Support;

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn a_slot_that_is_all_edge_keeps_its_said_colour() {
        let thin_of = |size: DVec3| {
            let mut state = empty_room();
            let id = add(&mut state, "box_01", Level::Furniture, size, DVec3::new(2.0, 0.0, 1.0), Support::Floor);
            let params = TemplateParams {
                colors: vec![SlotColor { slot: "box".to_owned(), hex: "#403020".to_owned() }],
                ..TemplateParams::default()
            };
            state.objects.get_mut(&id).unwrap().said.params = Some(params);
            let shown = views::ids(&state);
            thin_slots(&state, &id, &shown)
        };
        assert!(thin_of(DVec3::splat(0.8)).is_empty());
        assert_eq!(thin_of(DVec3::new(0.01, 0.9, 0.01)), ["box"]);
    }

    #[test]
    fn what_moved_is_bare_whatever_its_level() {
        let mut state = empty_room();
        let size = DVec3::splat(0.5);
        let sofa = add(&mut state, "sofa_01", Level::Furniture, size, DVec3::new(1.0, 0.0, 1.0), Support::Floor);
        let vase = add(&mut state, "vase_01", Level::Decoration, size, DVec3::new(3.0, 0.0, 1.0), Support::Floor);
        for id in [&sofa, &vase] {
            let mesh = Arc::clone(state.mesh_of(id).unwrap());
            state.set_textured(id, mesh);
        }
        state.forget_look(&sofa);
        assert_eq!(untextured(&state), [sofa]);
    }

    #[test]
    fn a_looking_glass_and_a_windows_pane_take_the_photo_and_a_bottle_does_not() {
        let mut state = empty_room();
        let at = DVec3::new(2.0, 0.0, 1.0);
        let id = add(&mut state, "box_01", Level::Wall, DVec3::new(1.0, 1.0, 0.01), at, Support::Floor);
        let mut model = state.objects[&id].model.clone().unwrap();
        let mut plain_of = |material: Material, label: &str, at_wall: bool| {
            model.plain_slots = vec![material.name.clone()];
            Arc::make_mut(&mut model.mesh).materials[0] = material;
            plain_slots(&model, label, at_wall).len()
        };
        let mirror = Material { metallic: 1.0, roughness: 0.03, ..Material::plain("glass", [0.9; 3]) };
        let clear = Material { transmission: 0.9, ..Material::plain("glass", [0.9; 3]) };
        assert_eq!(plain_of(mirror, "mirror", true), 0);
        assert_eq!(plain_of(clear.clone(), "window", true), 0);
        assert_eq!(plain_of(clear.clone(), "bottle", false), 1);
        assert_eq!(plain_of(clear, "display cabinet", true), 1, "no window");
        assert_eq!(plain_of(Material::plain("frame", [0.5; 3]), "window", true), 1);
    }

    #[test]
    fn bottles_are_clear_and_screens_are_not() {
        let glass = |rgb: [f32; 3]| Material { transmission: 0.9, ..Material::plain("glass", rgb) };
        assert!(is_clear(&glass([0.9, 0.95, 0.9])));
        assert!(is_clear(&glass([0.02, 0.2, 0.05])), "a green bottle");
        assert!(!is_clear(&glass([0.01, 0.01, 0.02])));
        assert!(!is_clear(&Material::plain("wood", [0.5, 0.3, 0.1])));
    }
}
