//! Phase 6, materials and light. Paper Sec. 3.4 and App. C "Material and Lighting Estimation".

use std::path::Path;
use std::sync::Arc;

use harmony_lighting::{Judgement, LightingDelta, LightingSpec, assess, judge, lights_from_scene, propose};
use harmony_prompts::{LightingReviewVars, LightsVars, lighting_review, lights};
use harmony_roles::{LitRequest, Picture, RoleError};
use harmony_scene::{Camera, Extents, LightKind, Lighting, WarningKind};
use image::RgbImage;
use serde_json::{Value, json};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::outputs;
use crate::state::SceneState;
use crate::views;

/// Estimates materials and light; renders the lit picture when there is a path tracer.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn run(ctx: &PhaseCtx<'_>, mut state: SceneState) -> Result<(SceneState, Option<RgbImage>), PhaseError> {
    ctx.step("materials and light sources");
    write_materials(ctx, &state)?;
    let objects = outputs::scene_objects(&state);
    let mut lighting = lights_from_scene(&state.partial.room, &objects, |id| state.mesh_of(id).map(|mesh| &**mesh));
    ask_sources(ctx, &state, &mut lighting).await?;
    state.lighting = Some(lighting.clone());
    let lit = if ctx.path_tracer { relight(ctx, &mut state).await? } else { None };
    if !ctx.path_tracer {
        ctx.warn(
            WarningKind::NotAvailable,
            None,
            "render_lit.png is left out and the flat render stands in: the picture was not asked for, or there is no \
             path tracer here (see `harmony doctor`)"
                .into(),
        );
    }
    ctx.write_json("lights.json", state.lighting.as_ref().unwrap_or(&lighting))?;
    Ok((state, lit))
}

fn write_materials(ctx: &PhaseCtx<'_>, state: &SceneState) -> Result<(), PhaseError> {
    let rows: serde_json::Map<String, Value> = state
        .partial
        .placed
        .iter()
        .filter_map(|p| Some((p.item.id.to_string(), json!(state.prepared.get(&p.item.id)?.material))))
        .collect();
    ctx.write_json("materials.json", &rows)
}

async fn ask_sources(ctx: &PhaseCtx<'_>, state: &SceneState, lighting: &mut Lighting) -> Result<(), PhaseError> {
    if lighting.lights.is_empty() {
        return Ok(());
    }
    let sources: Vec<String> = lighting
        .lights
        .iter()
        .map(|l| {
            let kind = match l.kind {
                LightKind::Point { .. } => "lamp",
                LightKind::Area { .. } => "window",
                LightKind::Sun { .. } => "sun",
            };
            format!(
                "- {}: {kind} at ({:.2}, {:.2}, {:.2}), {:.0} W",
                l.id, l.position[0], l.position[1], l.position[2], l.intensity
            )
        })
        .collect();
    let question = lights(&LightsVars { sources });
    let pictures = vec![
        Picture { caption: "IMAGE 1: the photo".into(), image: state.photo.clone() },
        Picture { caption: "IMAGE 2: the flat render".into(), image: views::flat(state) },
    ];
    let facts = json!({
        "lighting": lighting,
        "photo_luminance": mean_luminance(&state.photo),
        "seen": state.partial.placed.iter().filter_map(|p| {
            let bright = mask_luminance(state, &p.item.mask)?;
            Some(json!({ "id": p.item.id, "luminance": bright }))
        }).collect::<Vec<_>>(),
    });
    let spec: LightingSpec = ctx.ask("lights", question, pictures, facts, |_: &LightingSpec| Ok(())).await?;
    for note in spec.apply(lighting) {
        ctx.warn(WarningKind::AnswerRepaired, None, note);
    }
    Ok(())
}

/// The reflective loop on previews, then the final render.
async fn relight(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<Option<RgbImage>, PhaseError> {
    let glb = ctx.file("scene_for_light.glb")?;
    outputs::write_scene_glb(&glb, state, None)?;
    let s = ctx.settings.lighting;
    let mut lighting = state.lighting.clone().unwrap_or(Lighting {
        lights: Vec::new(),
        ambient_color: [1.0; 3],
        ambient_intensity: 0.5,
        exposure: 0.0,
    });
    let room = state.partial.room.extents;
    let size = state.partial.camera.size;
    let preview_camera = state.partial.camera.resized(size.fit_within(s.preview_px));
    let reference = shrunk(&state.photo, &preview_camera);
    let mut rounds = Vec::new();
    let first = render(ctx, "preview_0", &glb, room, preview_camera, &lighting, s.preview_samples).await?;
    let Some(mut preview) = first else { return Ok(None) };
    for round in 1..=s.rounds {
        let before = assess(&reference, &preview, None);
        let measured = propose(&before, &lighting);
        // What can be measured is corrected by measurement; the VLM confirms or refines.
        let delta = ask_delta(ctx, &state.photo, &preview, &lighting, &before, round, &measured).await?;
        if delta.is_converged() {
            rounds.push(json!({ "round": round, "converged": true, "error": before.error }));
            break;
        }
        let mut tried = lighting.clone();
        let notes = delta.apply(&mut tried, &state.partial.room.extents);
        let Some(image) =
            render(ctx, &format!("preview_{round}"), &glb, room, preview_camera, &tried, s.preview_samples).await?
        else {
            break;
        };
        let after = assess(&reference, &image, None);
        let verdict = judge(&before, &after);
        let kept = matches!(verdict, Judgement::Keep);
        rounds.push(json!({
            "round": round, "delta": delta, "notes": notes, "error_before": before.error, "error_after": after.error,
            "stops": after.stops, "warmth": after.warmth, "kept": kept,
        }));
        if let Judgement::Refuse { reason } = verdict {
            ctx.warn(WarningKind::ActionRefused, None, reason);
            break;
        }
        lighting = tried;
        preview = image;
        if after.matches() {
            break;
        }
    }
    ctx.write_json("loop.json", &rounds)?;
    ctx.write_picture("render_preview.png", &preview)?;
    state.lighting = Some(lighting.clone());
    ctx.step("final lit render");
    let camera = state.partial.camera.resized(size.fit_within(s.final_px));
    render(ctx, "final", &glb, room, camera, &lighting, s.final_samples).await
}

async fn ask_delta(
    ctx: &PhaseCtx<'_>,
    photo: &Arc<RgbImage>,
    preview: &RgbImage,
    lighting: &Lighting,
    found: &harmony_lighting::Assessment,
    round: usize,
    measured: &LightingDelta,
) -> Result<LightingDelta, PhaseError> {
    let setup = serde_json::to_string_pretty(lighting).map_err(|e| PhaseError::internal(ctx.phase, &e))?;
    let question = lighting_review(&LightingReviewVars {
        setup,
        measured: format!(
            "the preview is {:+.2} stops brighter than the photo (negative = darker), warmth difference {:+.2} (log2 of red over blue)",
            found.stops, found.warmth
        ),
    });
    let pictures = vec![
        Picture { caption: "IMAGE 1: the photo".into(), image: photo.clone() },
        Picture { caption: "IMAGE 2: the lit preview".into(), image: Arc::new(preview.clone()) },
    ];
    let facts = json!({ "proposed": measured });
    ctx.ask(&format!("review_{round}"), question, pictures, facts, |_: &LightingDelta| Ok(())).await
}

/// A path-traced picture; `None`, with a warning, when the path tracer failed.
async fn render(
    ctx: &PhaseCtx<'_>,
    step: &str,
    glb: &Path,
    room: Extents,
    camera: Camera,
    lighting: &Lighting,
    samples: u32,
) -> Result<Option<RgbImage>, PhaseError> {
    let bytes = harmony_io::read_bounded(glb, 1 << 31)?;
    let request = LitRequest {
        name: ctx.call(step),
        glb: glb.to_owned(),
        glb_hash: blake3::hash(&bytes).to_hex().to_string(),
        camera,
        lighting: lighting.clone(),
        room: Some(room),
        samples,
        denoise: true,
    };
    match ctx.calls.render_lit(&request).await {
        Ok(lit) => Ok(Some(lit.image)),
        Err(error) if error.is_fatal() => Err(error.into()),
        Err(error) => {
            let hint = match &error {
                RoleError::NotSetUp { hint, .. } => format!(" ({hint})"),
                _ => String::new(),
            };
            ctx.warn(WarningKind::NotAvailable, None, format!("the path tracer failed: {error}{hint}"));
            Ok(None)
        }
    }
}

fn shrunk(photo: &RgbImage, camera: &Camera) -> RgbImage {
    image::imageops::resize(photo, camera.size.width, camera.size.height, image::imageops::FilterType::Triangle)
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
