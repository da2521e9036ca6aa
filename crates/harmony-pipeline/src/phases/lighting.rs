//! Phase 6, materials and light. Paper Sec. 3.4 and App. C "Material and Lighting Estimation".

use harmony_lighting::{Emitter, lights_from_scene};
use harmony_prompts::{LightsQuestion, SeenObject};
use harmony_roles::Picture;
use harmony_scene::{Light, Lighting, ObjectId, SceneObject, WarningKind};
use image::RgbImage;
use serde_json::{Value, json};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::looks::{LookKind, SceneBefore};
use crate::outputs;
use crate::relight::{LitPictures, finish, relight};
use crate::state::{SceneState, ToldLight};
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
    state.told_light = ask_sources(ctx, &state, &mut lighting).await?;
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
    let before = SceneBefore::of(&state);
    let looked = last_look::until_settled(ctx, &mut state, lit).await?;
    before.came(ctx, LookKind::LastLook, &mut state);
    let lit = match looked {
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

/// Asks which sources emit, and sets them; what was said of the light that comes in.
async fn ask_sources(ctx: &PhaseCtx<'_>, state: &SceneState, lighting: &mut Lighting) -> Result<ToldLight, PhaseError> {
    if lighting.lights.is_empty() && !ctx.is_looked_at("lights") {
        return Ok(ToldLight::default());
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
    let sun = spec.sun.filter(|sun| !sun.patches.is_empty());
    let direct_sun = if sun.is_some() { Some(true) } else { spec.direct_sun };
    Ok(ToldLight { direct_sun, unseen_daylight: spec.unseen_daylight, sun })
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

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_roles::Role;
    use harmony_scene::{Level, Support};

    use super::*;
    use crate::Phase;
    use crate::testing::{Desk, add, empty_room};

    /// A room with a lamp and a screen.
    fn lit_room() -> SceneState {
        let mut state = empty_room();
        let floor = DVec3::new(1.2, 0.0, 1.5);
        add(&mut state, "floor_lamp_01", Level::Furniture, DVec3::new(0.3, 1.6, 0.3), floor, Support::Floor);
        let desk = DVec3::new(2.6, 0.0, 1.5);
        add(&mut state, "monitor_01", Level::Furniture, DVec3::new(0.6, 0.4, 0.1), desk, Support::Floor);
        state
    }

    #[tokio::test]
    async fn lamps_become_lights_and_the_missing_path_tracer_is_told_of() {
        let desk = Desk::new();
        let ctx = desk.ctx(Phase::Lighting);
        let (state, lit) = run(&ctx, lit_room()).await.unwrap();
        assert!(lit.is_none(), "nobody traces");
        let lights = state.lighting.unwrap().lights;
        let of = |id: &str| lights.iter().any(|l| l.object.as_ref().is_some_and(|o| o.as_str() == id));
        assert!(of("floor_lamp_01"), "{lights:?}");
        let told = desk.warnings.sorted();
        assert!(told.iter().any(|w| w.kind == WarningKind::NotAvailable && w.message.contains("render_lit.png")));
        let folder = Phase::Lighting.folder();
        let written = desk.json(&format!("{folder}/lights.json"));
        assert_eq!(written["lights"].as_array().unwrap().len(), lights.len());
        let materials = desk.json(&format!("{folder}/materials.json"));
        assert!(materials["floor_lamp_01"].is_object() && materials["monitor_01"].is_object(), "{materials}");
        let name = harmony_calls::CallName::new(&ctx.call("lights")).unwrap();
        assert!(desk.calls.book().record(Role::VisionLanguage, &name).is_some(), "somebody was asked about them");
    }

    #[tokio::test]
    async fn nobody_is_asked_about_light_in_a_room_without_any() {
        let desk = Desk::new();
        let ctx = desk.ctx(Phase::Lighting);
        let state = empty_room();
        let mut lighting = lights_from_scene(&state.partial.room, &[], |_| unreachable!("no object"));
        lighting.lights.clear();
        ask_sources(&ctx, &state, &mut lighting).await.unwrap();
        assert_eq!(desk.calls.counts().asked, 0);
    }

    #[test]
    fn screens_are_no_windows() {
        let mut state = lit_room();
        let at = DVec3::new(2.0, 1.0, 0.1);
        add(&mut state, "window_01", Level::Wall, DVec3::new(0.6, 0.4, 0.1), at, Support::Floor);
        let objects = outputs::scene_objects(&state);
        let emitter = |id: &ObjectId| Emitter { mesh: state.mesh_of(id).map(|mesh| &**mesh), bulb: None };
        let all = lights_from_scene(&state.partial.room, &objects, emitter).lights;
        let light = |id: &str| Light { object: ObjectId::new(id).ok(), ..all[0].clone() };
        assert!(is_no_window(&objects, &light("monitor_01")) && !is_no_window(&objects, &light("window_01")));
    }

    #[test]
    fn luminance_is_linear_light_of_the_pixels_in_question() {
        let mut state = empty_room();
        let mut photo = RgbImage::from_pixel(320, 240, image::Rgb([0; 3]));
        for (x, _, p) in photo.enumerate_pixels_mut() {
            p.0 = if x < 80 { [255; 3] } else { [0; 3] };
        }
        state.photo = std::sync::Arc::new(photo);
        assert!((mean_luminance(&state.photo) - 0.25).abs() < 1e-6);
        let size = harmony_scene::ImageSize::new(320, 240);
        let white = harmony_scene::Mask::from_fn(size, |x, _| x < 80);
        assert!((mask_luminance(&state, &white).unwrap() - 1.0).abs() < 1e-6);
        assert_eq!(mask_luminance(&state, &harmony_scene::Mask::empty(size)), None);
    }
}
