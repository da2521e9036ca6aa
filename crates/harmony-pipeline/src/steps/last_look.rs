//! The last look: photo, lit render, canonical view and two inner views side by side; what still differs is named, and
//! typed actions are tried, measured against the photo, and kept or refused with the reason.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_lighting::Judgement;
use harmony_mesh::{Mesh, linear_rgb, parse_color};
use harmony_placement::ReviewAction;
use harmony_program::GUIDE;
use harmony_prompts::{
    AMBIENT, LastAction, LastActionKind, LastLookAnswer, LastLookQuestion, ListedLight, PaintedObject,
};
use harmony_roles::Picture;
use harmony_scene::{ImageSize, Lighting, ObjectId, Size, Surface, WarningKind};
use harmony_shape::material::kelvin_to_rgb;
use image::{RgbImage, RgbaImage};
use serde_json::json;

use super::added::{self, Wanted};
use super::programs::{self, Program};
use super::second_look::Tried;
use super::{review, second_look, surfaces};
use crate::Phase;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::relight::{self, Lit, LitPictures, relight, retouch};
use crate::state::{Look, SceneState};
use crate::views;

/// Size of the views that are no photo's.
const VIEW: ImageSize = ImageSize { width: 800, height: 600 };

/// Last looks until nothing is asked for or kept, or the rounds are used up; the light of the scene as it is then.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn until_settled(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    mut lit: Option<Lit>,
) -> Result<Option<Lit>, PhaseError> {
    let mut tried = state.refused.clone();
    for round in 1..=ctx.settings.lighting.last_looks {
        let name = format!("last_look_{round}");
        if !ctx.is_looked_at(&name) || state.partial.placed.is_empty() {
            break;
        }
        ctx.step(&format!("last look {round}"));
        let answer = ask(ctx, state, lit.as_ref(), &name, std::mem::take(&mut tried)).await?;
        let mut results = Vec::new();
        let mut changed = false;
        let listed = state.lighting.clone();
        let mut relit = Vec::new();
        let (added, others): (Vec<_>, Vec<_>) =
            answer.actions.iter().partition(|action| action.action == LastActionKind::Add);
        let (joined, others) = joined(others);
        let mut singly = others;
        for group in joined {
            match try_joined(ctx, state, &group).await? {
                Some(reason) => {
                    changed = true;
                    tried.push(in_words(&group, true, &reason));
                    results.push(json!({ "asked": group, "kept": true, "reason": reason }));
                }
                None => singly.extend(group),
            }
        }
        for action in singly {
            match try_action(ctx, state, action).await? {
                Some((kept, reason)) => {
                    changed |= kept;
                    tried.push(in_words(&[action], kept, &reason));
                    results.push(json!({ "asked": action, "kept": kept, "reason": reason }));
                }
                None => relit.push(action),
            }
        }
        for (action, kept, reason) in add(ctx, state, &added, &name).await? {
            changed |= kept;
            tried.push(in_words(&[action], kept, &reason));
            results.push(json!({ "asked": action, "kept": kept, "reason": reason }));
        }
        if changed {
            // Before it is lit: a new shape has the colours that were said, not yet those of the photo.
            super::shading::everything(ctx, state).await?;
        }
        if changed && lit.is_some() {
            let after = format!("after_{name}");
            lit = relight(&ctx.inside(ctx.phase, &after), state, false).await?.or(lit);
        }
        if let (Some(before), Some(mut other), Some(listed), false) =
            (&lit, state.lighting.clone(), listed, relit.is_empty())
        {
            as_listed(&mut other, &listed, &relit);
            for action in &relit {
                dim(&mut other, action);
            }
            let outcome = retouch(ctx, state, other, before).await?;
            let kept = matches!(&outcome, Some((Judgement::Keep, _)));
            let reason = match &outcome {
                Some((Judgement::Refuse { reason }, _)) => reason.clone(),
                Some(_) => "it agrees no less with the photo".to_owned(),
                None => "the path tracer failed".to_owned(),
            };
            if !kept {
                ctx.warn(WarningKind::ActionRefused, None, format!("another light was proposed and refused: {reason}"));
            }
            tried.push(in_words(&relit, kept, &reason));
            results.push(json!({ "asked": relit, "kept": kept, "reason": reason }));
            changed |= kept;
            if let Some((_, after)) = outcome {
                lit = Some(after);
            }
        }
        ctx.write_json(&format!("{name}.json"), &json!({ "differences": answer.differences, "tried": results }))?;
        if answer.converged || !changed {
            break;
        }
    }
    Ok(lit)
}

/// Actions that were tried together, and what came of them, for the next round's question.
fn in_words(actions: &[&LastAction], kept: bool, reason: &str) -> String {
    let asked = actions.iter().map(|a| {
        let mut words = format!("{} {}", json!(a.action).as_str().unwrap_or_default(), a.id).trim_end().to_owned();
        words.extend(a.add.iter().map(|add| format!(" a {}", add.label)));
        words.extend(a.slot.iter().map(|slot| format!(" {slot}")));
        words.extend(a.delta_m.iter().map(|[x, y, z]| format!(" by ({x:.2}, {y:.2}, {z:.2}) m")));
        words.extend(a.angle_deg.iter().map(|deg| format!(" by {deg:.0} degrees")));
        words.extend(a.factor.iter().map(|factor| format!(" by the factor {factor:.2}")));
        words.extend(a.color_hex.iter().map(|color| format!(" to {color}")));
        words.extend(a.kelvin.iter().map(|kelvin| format!(" to {kelvin:.0} K")));
        words
    });
    let came = if kept { "kept" } else { "refused" };
    format!("- {}: {came}, {reason}", asked.collect::<Vec<_>>().join(" and "))
}

/// Adds what the photo shows and the scene lacks, with the lights that it brings; each action with whether something of
/// it stands now, and why not.
async fn add<'a>(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    actions: &[&'a LastAction],
    name: &str,
) -> Result<Vec<(&'a LastAction, bool, String)>, PhaseError> {
    let mut told = Vec::new();
    for (action, added) in actions.iter().filter_map(|action| Some((*action, action.add.as_ref()?))) {
        let wanted = Wanted::named(state, &added.label, added.bounds, added.like.as_ref(), added.host.as_ref());
        let look = format!("{name}_add_{}", told.len() + 1);
        let left = state.left.len();
        let ids = added::all(&ctx.inside(Phase::Objects(added.level), &look), added.level, state, vec![wanted]).await?;
        shine(state, &ids);
        told.push(if let Some(id) = ids.first() {
            (action, true, format!("it stands as {id}"))
        } else {
            let why = state.left.get(left).map_or_else(
                || "what is in that place stands in the scene already, or hardly a pixel of it is seen".to_owned(),
                |left| left.reason.to_string(),
            );
            (action, false, why)
        });
    }
    if told.iter().any(|(_, kept, _)| *kept) {
        surfaces::keep_walls_open(state);
    }
    Ok(told)
}

/// The lights of objects that have come, at their typical powers.
fn shine(state: &mut SceneState, ids: &[ObjectId]) {
    if ids.is_empty() {
        return;
    }
    let all = crate::phases::lighting::sources(state);
    let of_new = all.lights.into_iter().filter(|light| light.object.as_ref().is_some_and(|id| ids.contains(id)));
    if let Some(lighting) = &mut state.lighting {
        lighting.lights.extend(of_new);
    }
}

/// Factors are of the powers that the question listed: lights that actions name have those again where a fit has come in
/// between, as bright in the picture as they were then.
fn as_listed(lighting: &mut Lighting, listed: &Lighting, actions: &[&LastAction]) {
    let of_light = |id: &str| actions.iter().any(|a| a.action == LastActionKind::Light && a.id == id);
    let exposed = (listed.exposure - lighting.exposure).exp2();
    if of_light(AMBIENT) {
        lighting.ambient_intensity = exposed * listed.ambient_intensity;
    }
    for light in lighting.lights.iter_mut().filter(|light| of_light(&light.id)) {
        if let Some(then) = listed.lights.iter().find(|then| then.id == light.id) {
            light.intensity = exposed * then.intensity;
        }
    }
}

/// What an action wishes of the light.
fn dim(lighting: &mut Lighting, action: &LastAction) {
    let factor = action.factor.unwrap_or(1.0);
    if action.action == LastActionKind::Exposure {
        lighting.exposure += factor.log2();
    }
    if action.action == LastActionKind::Light && action.id == AMBIENT {
        lighting.ambient_intensity *= factor;
    }
    for light in lighting.lights.iter_mut().filter(|l| action.action == LastActionKind::Light && l.id == action.id) {
        light.intensity *= factor;
        light.on = light.on || factor > 1.0;
        if let Some(kelvin) = action.kelvin {
            let rgb = kelvin_to_rgb(kelvin);
            let most = rgb.into_iter().fold(1e-6, f64::max);
            light.color = rgb.map(|c| c / most);
        }
    }
}

async fn ask(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    lit: Option<&Lit>,
    name: &str,
    tried: Vec<String>,
) -> Result<LastLookAnswer, PhaseError> {
    let objects = state.partial.placed.iter().map(|p| PaintedObject {
        object: views::placed_object(p),
        slots: state.mesh_of(&p.item.id).iter().flat_map(|m| &m.materials).map(|m| m.name.clone()).collect(),
    });
    let question = LastLookQuestion {
        room: views::room_summary(state),
        objects: objects.collect(),
        lights: state.lighting.iter().flat_map(|l| &l.lights).cloned().map(ListedLight).collect(),
        ambient: state.lighting.as_ref().map_or(0.0, |l| l.ambient_intensity),
        findings: findings(state, lit.is_some()),
        tried,
        guide: GUIDE.to_owned(),
    };
    let lit = match lit {
        Some(lit) => Some(relight::shown(ctx, state, lit).await?),
        None => None,
    };
    let shown = state.clone();
    let pictures = ctx.computed(move || pictures(&shown, lit)).await?;
    let sizes: BTreeMap<String, Size> =
        state.partial.placed.iter().map(|p| (p.item.id.to_string(), p.size())).collect();
    let photo = Arc::clone(&state.photo);
    ctx.ask_and_try(name, question, pictures, move |answer: &LastLookAnswer| {
        for action in &answer.actions {
            let (Some(source), Some(size)) = (&action.program, sizes.get(&action.id)) else { continue };
            let program = Program { source: source.clone(), params: action.params.clone() };
            programs::built(&program, *size, &photo).map_err(|error| format!("program of {}: {error}", action.id))?;
        }
        Ok(())
    })
    .await
}

/// What geometry and colour complain about.
fn findings(state: &SceneState, lit: bool) -> Vec<String> {
    let mut lines: Vec<String> = state
        .partial
        .placed
        .iter()
        .filter_map(|p| {
            let iou = p.evidence.silhouette_iou.filter(|iou| *iou < 0.6)?;
            Some(format!("- {}: outline agreement {iou:.2}", p.item.id))
        })
        .collect();
    if !lit {
        lines.push("- there is no path tracer here: IMAGE 2 is unlit".to_owned());
    }
    lines
}

fn pictures(state: &SceneState, lit: Option<LitPictures>) -> Vec<Picture> {
    let flat = views::flat(state);
    let (photo_view, canonical) = lit.map_or((None, None), |l| (Some(Arc::new(l.photo_view)), l.canonical));
    let canonical = canonical.unwrap_or_else(|| {
        let view = views::canonical(state, VIEW);
        views::scene_from(state, &view.camera, view.omit)
    });
    let mut pictures = vec![
        Picture { caption: "IMAGE 1: the photo".into(), image: state.photo.clone() },
        Picture { caption: "IMAGE 2: the scene in its light".into(), image: photo_view.unwrap_or(flat) },
        Picture { caption: "IMAGE 3: the scene from outside above".into(), image: Arc::new(canonical) },
    ];
    for (i, view) in inner_views(state).into_iter().enumerate() {
        pictures.push(Picture {
            caption: format!("IMAGE {}: the scene from inside the room, unlit", i + 4),
            image: Arc::new(views::scene_from(state, &view, Vec::new())),
        });
    }
    pictures
}

/// Two cameras inside the room where the photo was not taken: at its height on the other side, and from under the
/// ceiling behind it.
pub fn inner_views(state: &SceneState) -> Vec<harmony_scene::Camera> {
    views::inner_cameras(&state.partial.room, &state.partial.camera, VIEW)
}

/// A change of colour may raise the mean squared difference to the photo by this share, and by this much: what it was
/// made for may be where the photo does not look.
const WORSE_SHARE: f64 = 1.05;
/// See [`WORSE_SHARE`].
const WORSE: f64 = 2e-4;
/// Fewer visible pixels than this say nothing.
const FEW_PIXELS: usize = 40;
/// Factors on a colour channel are kept within this and its inverse.
const LARGEST_FACTOR: f32 = 6.0;

/// Moves, turns and sizes of one object belong together: farther and larger is one correction, of which each half alone looks
/// worse. Those of which an object has several, and all other actions.
fn joined(actions: Vec<&LastAction>) -> (Vec<Vec<&LastAction>>, Vec<&LastAction>) {
    use LastActionKind::{Move, Rescale, Rotate};
    let mut of_one: Vec<Vec<&LastAction>> = Vec::new();
    let mut others = Vec::new();
    for action in actions {
        if !matches!(action.action, Move | Rotate | Rescale) {
            others.push(action);
            continue;
        }
        match of_one.iter_mut().find(|group| group[0].id == action.id) {
            Some(group) => group.push(action),
            None => of_one.push(vec![action]),
        }
    }
    let (several, single): (Vec<_>, Vec<_>) = of_one.into_iter().partition(|group| group.len() > 1);
    others.extend(single.into_iter().flatten());
    (several, others)
}

/// Tries actions on one object together; why they stay, or `None` where they do not.
async fn try_joined(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    group: &[&LastAction],
) -> Result<Option<String>, PhaseError> {
    let Some(id) = group.first().and_then(|action| ObjectId::new(&action.id).ok()) else { return Ok(None) };
    let Some(actions) = group.iter().map(|action| pose_action(action, &id)).collect::<Option<Vec<_>>>() else {
        return Ok(None);
    };
    let (kept, reason, _) = review::try_quietly(ctx, state, actions).await?;
    if kept {
        super::texture::only(ctx, state, vec![id]).await?;
    }
    Ok(kept.then_some(reason))
}

/// An action on an object's place, turn, size or being there, as a review's; `None` for all others, and where it says too little.
fn pose_action(action: &LastAction, object: &ObjectId) -> Option<ReviewAction> {
    let object = object.clone();
    match action.action {
        LastActionKind::Move => Some(ReviewAction::Move { object, by_m: action.delta_m? }),
        LastActionKind::Rotate => Some(ReviewAction::Rotate { object, by_deg: action.angle_deg? }),
        LastActionKind::Rescale => Some(ReviewAction::Rescale { object, factor: [action.factor?; 3] }),
        LastActionKind::Remove => Some(ReviewAction::Remove { object }),
        _ => None,
    }
}

/// Tries an action on objects or room surfaces; tells whether it stays, and why.
///
/// Actions on light and what is to be added are the caller's: they give `None`.
///
/// # Errors
/// Unwritable files and computations that broke.
async fn try_action(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    action: &LastAction,
) -> Result<Option<(bool, String)>, PhaseError> {
    let told = |kept: bool, reason: String| Some((kept, reason));
    let object = ObjectId::new(&action.id).ok();
    Ok(match (action.action, object) {
        (LastActionKind::Light | LastActionKind::Exposure | LastActionKind::Add, _) => None,
        (LastActionKind::Surface, _) => {
            let (kept, reason) = recolor_surface(state, action);
            told(kept, reason)
        }
        (_, None) => told(false, format!("{:?} is no id", action.id)),
        (LastActionKind::Reshape, Some(id)) => {
            let Some(source) = action.program.clone() else { return Ok(told(false, "there is no program".into())) };
            let program = Program { source, params: action.params.clone() };
            match second_look::try_program(ctx, state, &id, program).await? {
                Ok(Tried { verdict, .. }) => {
                    if verdict.kept {
                        let mut changed = super::form::lie_on_hosts(ctx, state, Some(&id)).await?;
                        changed.retain(|other| *other != id);
                        changed.push(id);
                        super::texture::only(ctx, state, changed).await?;
                    }
                    told(verdict.kept, verdict.reason)
                }
                Err(reason) => told(false, reason),
            }
        }
        (LastActionKind::Recolor, Some(id)) => {
            let (kept, reason) = recolor_object(state, &id, action);
            told(kept, reason)
        }
        (kind, Some(id)) => {
            let Some(wanted) = pose_action(action, &id) else { return Ok(told(false, "it says too little".into())) };
            let (kept, reason) = review::try_on(ctx, state, wanted, &id, &format!("{kind:?}")).await?;
            if kept && state.partial.find(&id).is_some() {
                super::texture::only(ctx, state, vec![id]).await?;
            }
            told(kept, reason)
        }
    })
}

/// Gives an object's slot another mean colour, if the flat render does not differ more from the photo then.
fn recolor_object(state: &mut SceneState, id: &ObjectId, action: &LastAction) -> (bool, String) {
    let Some(rgb) = action.color_hex.as_deref().and_then(parse_color) else {
        return (false, "there is no colour".to_owned());
    };
    let Some(mesh) = state.mesh_of(id) else { return (false, format!("there is no object {id}")) };
    let Some((slot, factor)) = recoloring(mesh, action.slot.as_deref(), linear_rgb(rgb)) else {
        let slots: Vec<&str> = mesh.materials.iter().map(|m| m.name.as_str()).collect();
        let wanted = action.slot.as_deref().unwrap_or("of one colour");
        return (false, format!("it has no slot {wanted}; its slots are {}", slots.join(", ")));
    };
    let index = state.partial.find(id).map_or(0, |p| p.item.index);
    let before = difference(state, |own| own == index);
    let mut tried = state.clone();
    // As it is shown, and below the photo's light, which is laid on anew afterwards.
    let textured = state.unlit(id).map(|mesh| Arc::new(recolored(mesh, slot, factor)));
    if let Some(object) = tried.objects.get_mut(id) {
        let lit = object.look.lit.as_ref().map(|mesh| Arc::new(recolored(mesh, slot, factor)));
        object.look = Look { textured, lit };
    }
    let (kept, reason) = weighed(before, difference(&tried, |own| own == index));
    if kept {
        *state = tried;
    }
    (kept, reason)
}

/// Gives a room surface another mean colour, as [`recolor_object`].
fn recolor_surface(state: &mut SceneState, action: &LastAction) -> (bool, String) {
    let name = action.id.trim_start_matches("wall_");
    let surface = Surface::ALL.into_iter().find(|s| s.name() == name);
    let Some((surface, old)) = surface.and_then(|s| Some((s, state.surfaces.get(&s)?.clone()))) else {
        return (false, format!("there is no surface {:?}", action.id));
    };
    let Some(rgb) = action.color_hex.as_deref().and_then(parse_color) else {
        return (false, "there is no colour".to_owned());
    };
    let factor = factors(mean_linear(&old), linear_rgb(rgb));
    let recolored = |old: &RgbaImage| {
        Arc::new(RgbaImage::from_fn(old.width(), old.height(), |x, y| {
            let [r, g, b, a] = old.get_pixel(x, y).0;
            let [r, g, b] = scaled([r, g, b], factor);
            image::Rgba([r, g, b, a])
        }))
    };
    let before = difference(state, |own| own == 0);
    state.surfaces.insert(surface, recolored(&old));
    let (kept, reason) = weighed(before, difference(state, |own| own == 0));
    if !kept {
        state.surfaces.insert(surface, old);
    } else if let Some(even) = state.even_surfaces.get_mut(&surface) {
        *even = recolored(even);
    }
    (kept, reason)
}

/// A slot (the largest one when none is named) and the factors by which its mean colour becomes another one; `None` when
/// there is no such slot.
fn recoloring(mesh: &Mesh, slot: Option<&str>, rgb: [f32; 3]) -> Option<(usize, [f32; 3])> {
    let largest = || mesh.groups.iter().max_by_key(|g| g.triangles.len()).map(|g| g.material);
    let which = match slot {
        Some(name) => mesh.materials.iter().position(|m| m.name == name)?,
        None => largest()?,
    };
    let material = &mesh.materials[which];
    let image = material.texture.as_ref().or(material.tile.as_ref().map(|t| &t.color));
    let shown = image.map_or([1.0; 3], |image| mean_linear(image));
    let light = light_on(mesh, which);
    let now = [0, 1, 2].map(|k| material.base_color[k] * shown[k] * light[k]);
    Some((which, factors(now, rgb)))
}

fn recolored(mesh: &Mesh, slot: usize, factor: [f32; 3]) -> Mesh {
    let mut mesh = mesh.clone();
    for (channel, f) in mesh.materials[slot].base_color.iter_mut().zip(factor) {
        *channel = (*channel * f).max(0.0);
    }
    mesh
}

/// Mean of the vertices' colours of a slot.
fn light_on(mesh: &Mesh, slot: usize) -> [f32; 3] {
    let of_slot = mesh.groups.iter().filter(|g| g.material == slot).flat_map(|g| g.triangles.iter().flatten());
    let colors: Vec<[f32; 3]> = of_slot.filter_map(|i| mesh.colors.get(*i as usize)).copied().collect();
    if colors.is_empty() {
        return [1.0; 3];
    }
    [0, 1, 2].map(|k| colors.iter().map(|c| c[k]).sum::<f32>() / colors.len() as f32)
}

fn factors(now: [f32; 3], wanted: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|k| (wanted[k] / now[k].max(1e-4)).clamp(1.0 / LARGEST_FACTOR, LARGEST_FACTOR))
}

fn scaled(rgb: [u8; 3], factor: [f32; 3]) -> [u8; 3] {
    let linear = harmony_imaging::color::linear_from_rgb8(rgb);
    harmony_imaging::color::rgb8_from_linear([0, 1, 2].map(|k| (linear[k] * factor[k]).min(1.0)))
}

/// Mean linear colour of a picture.
pub fn mean_linear(image: &RgbaImage) -> [f32; 3] {
    let mut sum = [0.0_f64; 3];
    let n = (f64::from(image.width()) * f64::from(image.height())).max(1.0);
    for p in image.pixels() {
        let [r, g, b, _] = p.0;
        for (s, v) in sum.iter_mut().zip(harmony_imaging::color::linear_from_rgb8([r, g, b])) {
            *s += f64::from(v);
        }
    }
    sum.map(|s| (s / n) as f32)
}

/// Mean squared difference of flat render and photo over the pixels whose nearest object `counts`; `None` when there
/// are hardly any.
fn difference(state: &SceneState, counts: impl Fn(u32) -> bool) -> Option<f64> {
    let drawn = views::drawn(state);
    squared(&drawn.flat, &state.photo, &drawn.ids, counts)
}

fn squared(a: &RgbImage, b: &RgbImage, ids: &[u32], counts: impl Fn(u32) -> bool) -> Option<f64> {
    let (mut sum, mut n) = (0.0, 0_usize);
    for ((p, q), id) in a.pixels().zip(b.pixels()).zip(ids) {
        if counts(*id) {
            n += 1;
            let d = p.0.iter().zip(q.0).map(|(x, y)| (f64::from(*x) - f64::from(y)) / 255.0);
            sum += d.map(|d| d * d).sum::<f64>() / 3.0;
        }
    }
    (n >= FEW_PIXELS).then(|| sum / n as f64)
}

fn weighed(before: Option<f64>, after: Option<f64>) -> (bool, String) {
    match (before, after) {
        (Some(before), Some(after)) if after > before * WORSE_SHARE + WORSE => {
            (false, format!("its difference to the photo would grow from {before:.4} to {after:.4}"))
        }
        (Some(before), Some(after)) => (true, format!("difference to the photo {before:.4} -> {after:.4}")),
        _ => (true, "the photo hardly shows it".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use harmony_mesh::{Group, Material};
    use harmony_scene::{Light, LightKind, ViewTransform};

    use super::*;

    fn two_slots() -> Mesh {
        let mut mesh = Mesh {
            materials: vec![Material::plain("seat", [0.2, 0.4, 0.1]), Material::plain("legs", [0.5; 3])],
            ..Mesh::default()
        };
        mesh.groups.push(Group { material: 0, triangles: vec![[0, 1, 2], [0, 2, 3]] });
        mesh.groups.push(Group { material: 1, triangles: vec![[0, 1, 2]] });
        mesh
    }

    #[test]
    fn a_factor_is_of_the_power_that_was_listed() {
        let lamp = |intensity| Light {
            id: "lamp_01".into(),
            kind: LightKind::Point { radius_m: 0.03 },
            position: [1.0; 3],
            color: [1.0; 3],
            intensity,
            on: true,
            object: None,
            shade: None,
        };
        let lit = |intensity, ambient_intensity, exposure| Lighting {
            lights: vec![lamp(intensity)],
            ambient_color: [1.0; 3],
            ambient_intensity,
            exposure,
            view: ViewTransform::Standard,
        };
        // A fit has come in between: another lamp, and twice the exposure.
        let (listed, mut now) = (lit(10.0, 0.05, 1.0), lit(4.0, 0.02, 2.0));
        let action: LastAction =
            serde_json::from_value(json!({ "action": "light", "id": "lamp_01", "factor": 1.5 })).unwrap();
        as_listed(&mut now, &listed, &[&action]);
        dim(&mut now, &action);
        assert!((now.lights[0].intensity - 7.5).abs() < 1e-9, "15 W at the exposure that was shown: {now:?}");
        assert!((now.ambient_intensity - 0.02).abs() < 1e-9, "nobody asked for another");
    }

    #[test]
    fn a_slot_takes_the_colour_and_the_others_keep_theirs() {
        let mesh = two_slots();
        let named = |slot, rgb| recoloring(&mesh, slot, rgb).map(|(slot, factor)| recolored(&mesh, slot, factor));
        let changed = named(Some("legs"), [0.25, 0.5, 1.0]).unwrap();
        assert_eq!(changed.materials[0].base_color, mesh.materials[0].base_color);
        for (channel, wanted) in changed.materials[1].base_color.iter().zip([0.25, 0.5, 1.0]) {
            assert!((channel - wanted).abs() < 1e-5);
        }
        assert_eq!(named(None, [0.1; 3]).unwrap().materials[1].base_color, mesh.materials[1].base_color);
        assert!(named(Some("shade"), [0.1; 3]).is_none());
    }

    #[test]
    fn a_textured_slot_gets_the_colour_in_the_mean() {
        let mut mesh = two_slots();
        let image =
            RgbaImage::from_fn(2, 1, |x, _| image::Rgba(if x == 0 { [0, 0, 0, 255] } else { [255, 255, 255, 255] }));
        mesh.materials[0].texture = Some(Arc::new(image));
        mesh.materials[0].base_color = [1.0; 4];
        // The texture's mean is half of white in linear light, so that a quarter needs a factor of one half.
        let (slot, factor) = recoloring(&mesh, Some("seat"), [0.25; 3]).unwrap();
        let changed = recolored(&mesh, slot, factor);
        assert!((changed.materials[0].base_color[0] - 0.5).abs() < 1e-3);
    }

    #[test]
    fn actions_are_told_with_their_numbers_and_what_came_of_them() {
        let mut shade = LastAction::about(LastActionKind::Recolor, "lamp_01");
        (shade.slot, shade.color_hex) = (Some("shade".into()), Some("#e0d0b0".into()));
        assert_eq!(in_words(&[&shade], true, "it fits"), "- recolor lamp_01 shade to #e0d0b0: kept, it fits");
        let mut lamp = LastAction::about(LastActionKind::Light, "lamp_01");
        (lamp.factor, lamp.kelvin) = (Some(1.5), Some(2700.0));
        let mut all = LastAction::about(LastActionKind::Exposure, "");
        all.factor = Some(0.5);
        assert_eq!(
            in_words(&[&lamp, &all], false, "it is too dark"),
            "- light lamp_01 by the factor 1.50 to 2700 K and exposure by the factor 0.50: refused, it is too dark"
        );
    }

    #[test]
    fn a_colour_that_differs_more_from_the_photo_is_refused() {
        assert!(!weighed(Some(0.010), Some(0.012)).0);
        assert!(weighed(Some(0.010), Some(0.009)).0);
        assert!(weighed(None, None).0);
    }
}
