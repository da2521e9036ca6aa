//! Phase 6, materials and light. Paper Sec. 3.4 and App. C "Material and Lighting Estimation".

use harmony_lighting::{Emitter, SunSpec, lights_from_scene};
use harmony_prompts::{LightsQuestion, SeenObject};
use harmony_roles::Picture;
use harmony_scene::{Light, Lighting, ObjectId, SceneObject, WarningKind};
use image::RgbImage;
use serde_json::{Value, json};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::outputs;
use crate::relight::{LitPictures, finish, relight};
use crate::state::SceneState;
use crate::steps::{last_look, physical};
use crate::views;

/// Estimates materials and light; renders the lit picture when there is a path tracer.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn run(ctx: &PhaseCtx<'_>, mut state: SceneState) -> Result<(SceneState, Option<LitPictures>), PhaseError> {
    ctx.step("materials and light sources");
    physical::estimate(ctx, &mut state).await?;
    write_materials(ctx, &state)?;
    let mut lighting = sources(&state);
    state.sun = ask_sources(ctx, &state, &mut lighting).await?;
    state.lighting = Some(lighting.clone());
    let lit = if ctx.path_tracer { relight(ctx, &mut state, true).await? } else { None };
    if !ctx.path_tracer {
        ctx.warn(
            WarningKind::NotAvailable,
            None,
            "render_lit.png is left out and the flat render stands in: the picture was not asked for, or there is no \
             path tracer here (see `harmony doctor`)"
                .into(),
        );
    }
    let lit = match last_look::until_settled(ctx, &mut state, lit).await? {
        Some(lit) => Some(finish(ctx, &state, lit).await?),
        None => None,
    };
    ctx.write_json("lights.json", state.lighting.as_ref().unwrap_or(&lighting))?;
    Ok((state, lit))
}

/// The light sources of a scene, all on, at typical powers.
pub fn sources(state: &SceneState) -> Lighting {
    let emitter = |id: &ObjectId| Emitter {
        mesh: state.mesh_of(id).map(|mesh| &**mesh),
        bulb: state.objects.get(id).and_then(|o| o.model.as_ref()?.bulb),
    };
    lights_from_scene(&state.partial.room, &outputs::scene_objects(state), emitter)
}

fn write_materials(ctx: &PhaseCtx<'_>, state: &SceneState) -> Result<(), PhaseError> {
    let rows: serde_json::Map<String, Value> = state
        .partial
        .placed
        .iter()
        .filter_map(|p| Some((p.item.id.to_string(), json!(state.objects.get(&p.item.id)?.model.as_ref()?.material))))
        .collect();
    ctx.write_json("materials.json", &rows)
}

/// Asks which sources emit, and sets them; what was said of a sun through openings that the photo does not show.
async fn ask_sources(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    lighting: &mut Lighting,
) -> Result<Option<SunSpec>, PhaseError> {
    if lighting.lights.is_empty() && !ctx.is_looked_at("lights") {
        return Ok(None);
    }
    let objects = outputs::scene_objects(state);
    let question = LightsQuestion {
        lighting: lighting.clone(),
        screens: lighting.lights.iter().filter(|l| is_no_window(&objects, l)).map(|l| l.id.clone()).collect(),
        photo_luminance: mean_luminance(&state.photo),
        seen: state
            .partial
            .placed
            .iter()
            .filter_map(|p| {
                let luminance = mask_luminance(state, &p.item.mask)?;
                Some(SeenObject { id: p.item.id.clone(), luminance })
            })
            .collect(),
    };
    let pictures = vec![
        Picture { caption: "IMAGE 1: the photo".into(), image: state.photo.clone() },
        Picture { caption: "IMAGE 2: the flat render".into(), image: views::flat(state) },
    ];
    let spec = ctx.ask("lights", question, pictures).await?;
    for note in spec.apply(lighting) {
        ctx.warn(WarningKind::AnswerRepaired, None, note);
    }
    Ok(spec.sun.filter(|sun| !sun.patches.is_empty()))
}

/// Whether a rectangle of light is that of a screen, a strip, a luminous field or a cove, not of a window.
fn is_no_window(objects: &[SceneObject], light: &Light) -> bool {
    if light.object.is_none() {
        return harmony_lighting::is_cove(light);
    }
    let object = light.object.as_ref().and_then(|id| objects.iter().find(|o| o.id == *id));
    object.is_some_and(|o| harmony_catalogue::opening(&o.label).is_none())
}

fn luminance(p: [u8; 3]) -> f64 {
    let [r, g, b] = harmony_imaging::color::linear_from_rgb8(p).map(f64::from);
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

fn mean_luminance(photo: &RgbImage) -> f64 {
    let n = f64::from(photo.width()) * f64::from(photo.height());
    photo.pixels().map(|p| luminance(p.0)).sum::<f64>() / n.max(1.0)
}

fn mask_luminance(state: &SceneState, mask: &harmony_scene::Mask) -> Option<f64> {
    harmony_imaging::color::median_color(&state.photo, mask).map(luminance)
}
