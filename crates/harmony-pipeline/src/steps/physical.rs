//! Mass and friction of every label, asked once a room (paper, "Physical Simulations"). Key `physics.mass`.
//!
//! What is answered stands beside the material question's weight; `harmony-physics` holds both against the catalogue. It is
//! asked where the paper's number of questions is wanted and somebody looks: recordings without it replay as they are.

use std::sync::Arc;

use harmony_prompts::{PhysicalAnswer, PhysicalLabel, PhysicalQuestion};
use harmony_roles::Picture;
use harmony_scene::{RigidEstimate, SurfaceMaterial};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;

/// Asks, and gives every object of a label what was answered.
///
/// # Errors
/// Fatal role errors only.
pub async fn estimate(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    if !ctx.settings.asked_looks().physical || !ctx.is_looked_at("physical") || state.partial.placed.is_empty() {
        return Ok(());
    }
    ctx.step("mass and friction");
    let mut items: Vec<PhysicalLabel> = Vec::new();
    for placed in &state.partial.placed {
        if !items.iter().any(|i| i.label == placed.item.label) {
            items.push(PhysicalLabel { label: placed.item.label.clone(), size: placed.size() });
        }
    }
    let pictures = vec![Picture { caption: "IMAGE 1: the photo".into(), image: Arc::clone(&state.photo) }];
    let answer = ctx.ask("physical", PhysicalQuestion { items }, pictures).await?;
    for placed in &state.partial.placed {
        let model = state.objects.get_mut(&placed.item.id).and_then(|o| o.model.as_mut());
        if let Some(model) = model {
            apply(&answer, &placed.item.label, &mut model.material);
        }
    }
    Ok(())
}

/// A label's answer; without one the material stays as it is.
fn apply(answer: &PhysicalAnswer, label: &str, material: &mut SurfaceMaterial) {
    if let Some(item) = answer.items.iter().find(|i| i.label == label) {
        material.physical.rigid = Some(RigidEstimate { mass_kg: item.mass_kg, friction: item.friction });
    }
}

#[cfg(test)]
mod tests {
    use harmony_prompts::PhysicalItem;
    use harmony_scene::{MaterialCategory, Physical};

    use super::*;

    #[test]
    fn labels_get_what_was_answered_and_the_rest_keeps_its_weight() {
        let physical = Physical { weight_kg: 20.0, thickness_m: 0.04, elasticity: 0.1, rigid: None };
        let category = MaterialCategory::Wood;
        let mut desk = SurfaceMaterial { category, pbr: category.defaults(), physical };
        let mut vase = desk;
        let item = PhysicalItem { label: "desk".into(), mass_kg: 31.0, friction: 0.45 };
        let answer = PhysicalAnswer { items: vec![item] };
        apply(&answer, "desk", &mut desk);
        apply(&answer, "vase", &mut vase);
        assert_eq!(
            desk.physical,
            Physical { rigid: Some(RigidEstimate { mass_kg: 31.0, friction: 0.45 }), ..physical }
        );
        assert_eq!(vase.physical, physical);
    }
}
