//! What was found by rule alone, with nobody who looks: where it does not fit, it stays as paint on the room, or as a
//! relief ([`super::relief`]).

use harmony_scene::{Mask, ObjectId, Support, WarningKind};

use crate::ctx::PhaseCtx;
use crate::state::{DropReason, Left, SceneState};
use crate::steps::surfaces;

/// An object of which nobody said what it is stays in the scene from this probability that its pose is right. On six
/// rooms with truth 16 of 24 rectangles above it were a thing of the room, and 2 of 23 below it.
const BELIEVED: f64 = 0.25;
/// An object of which the point map has more than this share before the room's faces is not a thing on one of them.
const OFF_ITS_FACE: f64 = 0.5;

/// Takes doubtful objects of a level out again, when neither a language model nor a detector saw them.
pub fn leave_as_paint(ctx: &PhaseCtx<'_>, state: &mut SceneState, objects: &[ObjectId]) {
    if ctx.can().recognises || ctx.is_looked_at("inspect") {
        return;
    }
    for (id, reason) in doubted(state, objects) {
        ctx.warn(WarningKind::ObjectDropped, Some(id.clone()), reason.to_string());
        state.left.push(Left { name: id.to_string(), phase: ctx.phase, reason });
        // Its pixels are bare room again, so that they are painted where they were seen.
        state.partial.placed.retain(|p| p.item.id != id);
        state.objects.remove(&id);
    }
}

/// Those of the objects that are doubted, and what stands on them.
fn doubted(state: &SceneState, objects: &[ObjectId]) -> Vec<(ObjectId, DropReason)> {
    let mut doubted: Vec<(ObjectId, DropReason)> = Vec::new();
    let standing = surfaces::standing(state);
    loop {
        let is_out = |id: &ObjectId| doubted.iter().any(|(out, _)| out == id);
        let next =
            state.partial.placed.iter().filter(|p| objects.contains(&p.item.id) && !is_out(&p.item.id)).find_map(|p| {
                let confidence = p.confidence().overall;
                let host_is_out = matches!(&p.support, Support::Object { id } if is_out(id));
                let reason = if confidence < BELIEVED || host_is_out {
                    DropReason::Doubted(confidence)
                } else if is_off(&p.item.mask, &standing) {
                    DropReason::OffItsFace
                } else {
                    return None;
                };
                Some((p.item.id.clone(), reason))
            });
        match next {
            Some(one) => doubted.push(one),
            None => return doubted,
        }
    }
}

/// Whether most of an object is what the point map has before the room's faces.
fn is_off(mask: &Mask, standing: &Mask) -> bool {
    mask.and(standing).count() as f64 > OFF_ITS_FACE * mask.count() as f64
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_placement::Spread;
    use harmony_scene::Level;

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn what_fits_badly_is_doubted_and_what_stands_on_it() {
        let mut state = empty_room();
        let size = DVec3::new(0.8, 0.7, 0.8);
        let at = |x: f64, y: f64| DVec3::new(x, y, 1.5);
        let sure = add(&mut state, "table_01", Level::Furniture, size, at(1.0, 0.0), Support::Floor);
        let unsure = add(&mut state, "table_02", Level::Furniture, size, at(3.0, 0.0), Support::Floor);
        let on = Support::Object { id: unsure.clone() };
        let vase = add(&mut state, "vase_01", Level::Furniture, DVec3::splat(0.2), at(3.0, 0.7), on);
        for placed in &mut state.partial.placed {
            let metres = if placed.item.id == unsure { 0.9 } else { 0.02 };
            placed.evidence.spread = Some(Spread { position_m: metres, yaw: 0.02, size: 0.01 });
            placed.evidence.hypothesis = 1.0;
        }
        let out: Vec<ObjectId> =
            doubted(&state, &[vase.clone(), sure, unsure.clone()]).into_iter().map(|(id, _)| id).collect();
        assert_eq!(out, [unsure, vase]);
        assert!(doubted(&state, &[]).is_empty(), "objects of earlier levels stay");
    }
}
