//! The photo's light on the finished scene: measured, fitted, looked at, rendered. Paper Sec. 3.4, decision 0007;
//! keys `light.loop`, `light.fit`.
//!
//! One render with light groups says what each light gives; lights, exposure and view transform are fitted to the
//! photo on it; base colours become reflectances by the ratio of photo to render; previews measure what is left. Then
//! the model looks (the paper's reflective loop): what it changes is rendered, measured, and kept or refused.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use harmony_imaging::color::rgb8_from_linear;
use harmony_lighting::{
    Assessment, Comparison, FieldNode, FitOptions, Judgement, LightPass, LightingDelta, LinearImage, Measured,
    PictureError, SceneFit, ViewTable, assess, bounce_response, design_of, display_linear, fit_scene, is_cove,
    is_found_sun, is_passage_light, is_unseen_window, judge, neutral_field, picture_error, propose, unseen_windows,
    updated_field,
};
use harmony_mesh::{Bounds, Material, Mesh};
use harmony_prompts::LightingReviewQuestion;
use harmony_render::OUTSIDE;
use harmony_roles::{LightMeasurement, LitImage, LitKind, LitRequest, Picture, RoleError};
use harmony_scene::{
    AlbedoField, Camera, ImageSize, Light, LightKind, Lighting, Mask, ObjectId, ViewTransform, WarningKind,
};
use image::RgbImage;
use image::imageops::{FilterType, resize};
use serde_json::{Value, json};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::outputs;
use crate::settings::LightingSettings;
use crate::state::SceneState;
use crate::steps::last_look::mean_linear;
use crate::steps::sun::Sun;
use crate::steps::surfaces;
use crate::views;

/// Median differences of luminance (stops) and colour at which previews stop measuring.
const GOOD_STOPS: f64 = 0.1;
const GOOD_CHROMA: f64 = 0.02;
/// Windows that the photo does not show are believed when the light with them is this much nearer to it, as a ratio ...
const UNSEEN_GAIN: f64 = 0.95;
/// ... each with at least this share of its assumed power.
const UNSEEN_LEAST: f64 = 0.1;
/// Diffuse reflectance below which a pixel is metal, glass or a picture of light.
const MIN_ALBEDO: f32 = 0.003;
/// One below which it tells the lights nothing: gloss is most of what is seen there.
const MIN_TELLING: f32 = 0.02;
/// The scene's file for the path tracer.
const SCENE: &str = "scene_for_light.glb";
/// Size of the flat canonical view, whose frame the lit one has.
const CANONICAL: ImageSize = ImageSize { width: 1280, height: 960 };

/// A scene whose light was fitted.
#[derive(Debug, Clone)]
pub struct Lit {
    /// The last preview from the photo's camera.
    preview: RgbImage,
    /// What the colours are lit with.
    field: Arc<AlbedoField>,
}

/// The path-traced pictures of a scene.
#[derive(Debug, Clone)]
pub struct LitPictures {
    /// From the photo's camera.
    pub photo_view: RgbImage,
    /// From outside, as the flat canonical view.
    pub canonical: Option<RgbImage>,
}

/// Everything that stays the same from render to render.
struct Stage<'a, 'c> {
    ctx: &'a PhaseCtx<'c>,
    state: &'a SceneState,
    glb: PathBuf,
    glb_hash: String,
    nodes: Vec<FieldNode>,
    s: LightingSettings,
}

/// Fits the light, and lets the model confirm it where it is `asked`; the lighting of the state becomes the fitted one.
/// `None`, with a warning, when the path tracer failed.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn relight(ctx: &PhaseCtx<'_>, state: &mut SceneState, asked: bool) -> Result<Option<Lit>, PhaseError> {
    let Some(mut lighting) = state.lighting.clone() else { return Ok(None) };
    lighting.lights.retain(|light| !is_unseen_window(light) && !is_found_sun(light));
    let sun = sun_of(ctx, state, &lighting).await?;
    state.unseen_openings = sun.as_ref().map(|sun| sun.openings.clone()).unwrap_or_default();
    surfaces::keep_walls_open(state);
    outputs::write_scene_glb(&ctx.file(SCENE)?, state, None)?;
    lighting.lights.extend(daylight_elsewhere(state));
    lighting.lights.extend(sun.map(|sun| sun.light));
    lighting.lights = with_shades(ctx, state, lighting.lights).await?;
    let stage = Stage::new(ctx, state, field_nodes(state))?;
    ctx.step("measuring each light");
    let Some(light) = stage.measure(&lighting).await? else { return Ok(None) };
    let mut look = stage.fit(light, &mut lighting).await?;
    if !state.unseen_openings.is_empty() {
        let message = if lighting.lights.iter().any(is_found_sun) {
            "sun comes in through openings that the photo does not show; they stand where its patches tell"
        } else {
            "the patches of sun that were told are not explained by a sun; their openings stay in the wall all the same"
        };
        ctx.warn(WarningKind::Fallback, None, message.to_owned());
    }
    let Some(mut preview) = stage.settle(&mut look, &lighting).await? else { return Ok(None) };
    if asked {
        let Some(larger) = stage.preview("preview", &look.field, &lighting).await? else { return Ok(None) };
        preview = larger;
        stage.confirm(&mut look, &mut lighting, &mut preview).await?;
    }
    ctx.write_json("loop.json", &look.rounds)?;
    ctx.write_json("albedo.json", &*look.field)?;
    ctx.write_picture("render_preview.png", &preview)?;
    state.lighting = Some(lighting);
    Ok(Some(Lit { preview, field: look.field }))
}

/// Windows that the photo may be lit by without showing them; none where who looked says that no daylight comes from there.
fn daylight_elsewhere(state: &SceneState) -> Vec<Light> {
    if state.told_light.unseen_daylight == Some(false) {
        return Vec::new();
    }
    let hanging: Vec<Bounds> =
        state.partial.placed.iter().filter(|p| p.item.traits.hangs).map(views::bounds_of).collect();
    unseen_windows(&state.partial.room, &state.partial.camera, &hanging)
}

/// The pictures of a lit scene that a question shows: small, and quickly made.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn shown(ctx: &PhaseCtx<'_>, state: &SceneState, lit: &Lit) -> Result<LitPictures, PhaseError> {
    let Some(lighting) = &state.lighting else {
        return Ok(LitPictures { photo_view: lit.preview.clone(), canonical: None });
    };
    let stage = Stage::new(ctx, state, Vec::new())?;
    let (w, h) = lit.preview.dimensions();
    let larger = if w.max(h) < stage.s.preview_px { stage.preview("shown", &lit.field, lighting).await? } else { None };
    let canonical =
        stage.canonical("shown_canonical", lighting, &lit.field, stage.s.preview_px, stage.s.preview_samples).await?;
    Ok(LitPictures { photo_view: larger.unwrap_or_else(|| lit.preview.clone()), canonical })
}

/// The finished pictures of a lit scene; the last preview stands in where the path tracer fails.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn finish(ctx: &PhaseCtx<'_>, state: &SceneState, lit: Lit) -> Result<LitPictures, PhaseError> {
    let Some(lighting) = &state.lighting else {
        return Ok(LitPictures { photo_view: lit.preview, canonical: None });
    };
    let stage = Stage::new(ctx, state, Vec::new())?;
    ctx.step("final lit render");
    let camera = state.partial.camera;
    let camera = camera.resized(camera.size.fit_within(stage.s.final_px));
    let photo_view = stage.picture("final", camera, lighting, &lit.field, stage.s.final_samples).await?;
    ctx.step("lit canonical view");
    let canonical =
        stage.canonical("canonical", lighting, &lit.field, stage.s.canonical_px, stage.s.canonical_samples).await?;
    Ok(LitPictures { photo_view: photo_view.unwrap_or(lit.preview), canonical })
}

/// The sun that the photo speaks for; whether it stays is for the fit to say.
async fn sun_of(ctx: &PhaseCtx<'_>, state: &SceneState, lighting: &Lighting) -> Result<Option<Sun>, PhaseError> {
    let (state, lighting) = (state.clone(), lighting.clone());
    let found = ctx.computed(move || crate::steps::sun::found(&state, &lighting)).await?;
    ctx.write_json("sun.json", &found)?;
    Ok(found)
}

/// The lights with what the photo shows of their shades.
async fn with_shades(ctx: &PhaseCtx<'_>, state: &SceneState, mut lights: Vec<Light>) -> Result<Vec<Light>, PhaseError> {
    let state = state.clone();
    ctx.computed(move || {
        crate::steps::shades::measure(&state, &mut lights);
        lights
    })
    .await
}

/// Renders a lit scene again with another light and keeps it, unless it then agrees less with the photo; the reason
/// is told either way. `None` when the path tracer failed.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn retouch(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    tried: Lighting,
    before: &Lit,
) -> Result<Option<(Judgement, Lit)>, PhaseError> {
    let stage = Stage::new(ctx, state, Vec::new())?;
    let (w, h) = before.preview.dimensions();
    let camera = state.partial.camera.resized(ImageSize::new(w, h));
    let samples = stage.s.preview_samples;
    let Some(preview) = stage.picture("retouched", camera, &tried, &before.field, samples).await? else {
        return Ok(None);
    };
    let reference = resize(&*state.photo, w, h, FilterType::Triangle);
    let verdict = judge(&assess(&reference, &before.preview, None), &assess(&reference, &preview, None));
    if verdict != Judgement::Keep {
        return Ok(Some((verdict, before.clone())));
    }
    state.lighting = Some(tried);
    Ok(Some((verdict, Lit { preview, field: Arc::clone(&before.field) })))
}

/// The nodes of the scene's GLB: the room's faces, then the objects, by material where they have several.
fn field_nodes(state: &SceneState) -> Vec<FieldNode> {
    let shell = views::shell(state, Vec::new());
    let faces = shell.groups.iter().filter(|g| !g.triangles.is_empty()).map(|g| {
        let name = shell.materials[g.material].name.clone();
        let kind = match name.as_str() {
            "floor" => "floor",
            "ceiling" => "ceiling",
            _ => "wall",
        };
        let is_even = state.even_surfaces.keys().any(|s| name.strip_prefix("wall_").unwrap_or(&name) == s.name());
        // What programs built into the room was said, as programs of objects say it.
        if state.features.iter().any(|f| f.said.contains(&name)) {
            let paint = Some(paint_of(&shell.materials[g.material]));
            let is_glossy = shell.materials[g.material].shines();
            return FieldNode { is_even: true, paint, is_glossy, ..FieldNode::new(&name, "object") };
        }
        FieldNode { name, kind, is_even, paint: None, is_glossy: false }
    });
    let objects = state.partial.placed.iter().filter_map(|p| {
        let said = state.objects.get(&p.item.id)?.model.as_ref().map_or(&[][..], |model| &model.said_slots);
        Some((p.item.id.as_str(), state.mesh_of(&p.item.id)?, said))
    });
    faces.chain(objects.flat_map(|(id, mesh, said)| parts(id, mesh, said))).collect()
}

/// An object, or each of its materials that is drawn; what was `said` of one has no light in it.
fn parts(id: &str, mesh: &Mesh, said: &[String]) -> Vec<FieldNode> {
    let drawn = mesh.groups.iter().filter(|g| !g.triangles.is_empty());
    let mut names: Vec<&str> = drawn.filter_map(|g| Some(mesh.materials.get(g.material)?.name.as_str())).collect();
    names.sort_unstable();
    names.dedup();
    let is_said = |name: &str| said.iter().any(|slot| slot == name);
    let paint = |name: &str| {
        let material = mesh.materials.iter().find(|m| m.name == name).filter(|_| is_said(name))?;
        Some(paint_of(material))
    };
    if names.len() < 2 || names.contains(&"") {
        let is_even = !names.is_empty() && names.iter().all(|name| is_said(name));
        let paint = names.first().filter(|_| is_even && names.len() == 1).and_then(|name| paint(name));
        let is_glossy = is_even && mesh.materials.iter().any(Material::shines);
        return vec![FieldNode { is_even, paint, is_glossy, ..FieldNode::new(id, "object") }];
    }
    let part = |name: &str| {
        let is_glossy = is_said(name) && mesh.materials.iter().any(|m| m.name == name && m.shines());
        FieldNode { is_even: is_said(name), paint: paint(name), is_glossy, ..FieldNode::part(id, name, "object") }
    };
    names.into_iter().map(part).collect()
}

/// A material's name and mean colour in steps that nobody sees.
fn paint_of(material: &Material) -> String {
    let shown = material.tile.as_ref().map_or([1.0; 3], |tile| mean_linear(&tile.color));
    let rgb = rgb8_from_linear([0, 1, 2].map(|c| material.base_color[c] * shown[c]));
    let [r, g, b] = rgb.map(|v| v / PAINT_STEP);
    format!("{} {r} {g} {b}", material.name)
}

/// Step of an sRGB channel below which two said colours are one.
const PAINT_STEP: u8 = 24;

/// What has been found about the photo's light.
struct Look {
    view: ViewTable,
    /// The photo at the measurement's size: as it is, and its light after exposure, as the view takes it.
    photo: RgbImage,
    light: LinearImage,
    ids: Vec<u32>,
    /// How much each pixel counts: 0 where photo and scene show different things, and where the scene shines itself.
    weights: Vec<f32>,
    /// The same for the reflectances, black things with them.
    of_field: Vec<f32>,
    field: Arc<AlbedoField>,
    /// The field before and the render under it; by how much more than the reflectances the room's light changes.
    last: Option<(Arc<AlbedoField>, LinearImage)>,
    response: [f32; 3],
    rounds: Vec<Value>,
}

impl Look {
    /// Median difference of a render from the photo, at the measurement's size.
    fn error(&self, render: &RgbImage) -> PictureError {
        let (w, h) = self.photo.dimensions();
        let small = resize(render, w, h, FilterType::Triangle);
        picture_error(&display_linear(&self.photo), &display_linear(&small), &self.weights)
    }

    /// Takes the field that a render under the present one asks for, and remembers both.
    fn update_field(&mut self, nodes: &[FieldNode], render: LinearImage) {
        if let Some((field, before)) = &self.last {
            let counted = (&self.ids[..], &self.of_field[..]);
            self.response = bounce_response(self.response, [field, &self.field], [before, &render], nodes, counted);
        }
        let seen = Comparison { photo: &self.light, render: &render, ids: &self.ids, weights: &self.of_field };
        let next = Arc::new(updated_field(&self.field, nodes, &seen, self.response));
        self.last = Some((std::mem::replace(&mut self.field, next), render));
    }
}

impl<'a, 'c> Stage<'a, 'c> {
    /// For the scene as it was written for the light.
    fn new(ctx: &'a PhaseCtx<'c>, state: &'a SceneState, nodes: Vec<FieldNode>) -> Result<Self, PhaseError> {
        let glb = ctx.file(SCENE)?;
        let glb_hash = blake3::hash(&harmony_io::read_bounded(&glb, 1 << 31)?).to_hex().to_string();
        Ok(Self { ctx, state, glb, glb_hash, nodes, s: ctx.settings.lighting })
    }

    fn request(&self, step: &str, camera: Camera, lighting: &Lighting, samples: u32) -> LitRequest {
        LitRequest {
            name: self.ctx.call(step),
            glb: self.glb.clone(),
            glb_hash: self.glb_hash.clone(),
            camera,
            lighting: lighting.clone(),
            room: Some(self.state.partial.room.extents),
            samples,
            denoise: true,
            albedo: None,
            hidden_nodes: Vec::new(),
            background: None,
            kind: LitKind::Picture,
        }
    }

    async fn measure(&self, lighting: &Lighting) -> Result<Option<Arc<LightMeasurement>>, PhaseError> {
        let camera = self.state.partial.camera;
        let small = camera.resized(camera.size.fit_within(self.s.fit_px));
        let mut request = self.request("lights_measured", small, lighting, self.s.fit_samples);
        request.denoise = false;
        request.kind = LitKind::Measurement {
            nodes: self.nodes.iter().map(|n| n.name.clone()).collect(),
            views: ViewTransform::ALL.to_vec(),
        };
        Ok(render(self.ctx, &request).await?.and_then(|lit| lit.measured))
    }

    /// Whether an object is one of the room's openings: what shines there is daylight.
    fn is_opening(&self, object: Option<&ObjectId>) -> bool {
        object.is_some() && self.state.partial.room.openings.iter().any(|opening| opening.object.as_ref() == object)
    }

    /// Fits lights, exposure and view, and the first reflectances.
    async fn fit(&self, found: Arc<LightMeasurement>, lighting: &mut Lighting) -> Result<Look, PhaseError> {
        let size = found.size;
        let photo = resize(&*self.state.photo, size.width, size.height, FilterType::Triangle);
        let of_field = self.weights(&found, size);
        let telling = |(weight, albedo): (&f32, &[f32; 3])| {
            if albedo.iter().any(|a| *a > MIN_TELLING) { *weight } else { 0.0 }
        };
        let weights: Vec<f32> = of_field.iter().zip(&found.albedo).map(telling).collect();
        let measured = measured_from(&found, |id| {
            let light = lighting.lights.iter().find(|light| light.id == id);
            let is_area = |light: &Light| matches!(light.kind, LightKind::Area { .. });
            let comes_in = |light: &Light| light.object.is_none() && is_area(light) && !is_cove(light);
            light.is_some_and(|light| comes_in(light) || self.is_opening(light.object.as_ref()))
        });
        let unseen: Vec<String> =
            lighting.lights.iter().filter(|light| is_unseen_window(light)).map(|light| light.id.clone()).collect();
        // Light that comes from nowhere is no room's: where the photo shows no source, or who looked says that there is one
        // outside it, that need only not be worse.
        let is_lit = lighting.lights.iter().any(|light| light.on && !unseen.contains(&light.id));
        let is_told = self.state.told_light.unseen_daylight == Some(true);
        let least_gain = if is_lit && !is_told { UNSEEN_GAIN } else { 1.0 };
        let twins = twins_of(lighting);
        let of_twins = twins.clone();
        let (fitted, measured, weights, photo, errors) = self
            .ctx
            .computed(move || {
                let twins = of_twins;
                let fit = |measured: &Measured| {
                    let mut fitted = fit_scene(&measured.grouped(&twins), &photo, &weights, &FitOptions::default())?;
                    let all: Vec<String> = measured.lights.iter().filter_map(|pass| pass.light.clone()).collect();
                    fitted.ungroup(&all, &twins);
                    Ok::<_, harmony_lighting::fit::FitError>(fitted)
                };
                let shown = measured.without(|id| unseen.iter().any(|unseen| unseen == id));
                let (without, with) = (fit(&shown), fit(&measured));
                let believed = with.as_ref().is_ok_and(|with| {
                    without.as_ref().is_ok_and(|shown| with.error.total() < least_gain * shown.error.total())
                });
                let errors = [&without, &with].map(|fit| fit.as_ref().ok().map(|fit| fit.error));
                let (fitted, measured) = if believed { (with, measured) } else { (without, shown) };
                (fitted, measured, weights, photo, errors)
            })
            .await?;
        let ids = measured.ids.clone();
        // One that is not in the fit has level 0.
        let level = |id: &str| fitted.as_ref().map_or(0.0, |fitted| fitted.level(id));
        lighting.lights.retain(|light| {
            let assumed = is_unseen_window(light) || is_found_sun(light) || is_passage_light(light);
            !assumed || level(&light.id) >= UNSEEN_LEAST
        });
        for light in lighting.lights.iter().filter(|light| is_unseen_window(light)) {
            let message = format!(
                "{}: light of a window that the photo does not show; its place and size are assumed, its strength is fitted",
                light.id
            );
            self.ctx.warn(WarningKind::Fallback, None, message);
        }
        let neutral = neutral_field(&self.state.partial.camera);
        let Ok(fitted) = fitted.inspect_err(|e| {
            self.ctx.warn(WarningKind::NotAvailable, None, format!("the light is as it was assumed: {e}"));
        }) else {
            let view = ViewTable::standard();
            let light = view.to_linear(&photo);
            return Ok(Look {
                view,
                photo,
                light,
                ids,
                weights,
                of_field,
                field: Arc::new(neutral),
                last: None,
                response: [1.0; 3],
                rounds: Vec::new(),
            });
        };
        let notes = fitted.apply(lighting, &crate::phases::lighting::sources(self.state));
        self.ctx.write_json("fit.json", &fit_json(&fitted, lighting, &notes, errors))?;
        let predicted = fitted.predicted(&measured.grouped(&twins));
        let mut look = Look {
            view: fitted.view.clone(),
            photo,
            light: fitted.photo.clone(),
            ids,
            weights,
            of_field,
            field: Arc::new(neutral),
            last: None,
            response: [1.0; 3],
            rounds: vec![json!({ "step": "fit", "view": fitted.view.view, "error": fitted.error })],
        };
        look.update_field(&self.nodes, predicted);
        Ok(look)
    }

    /// What counts: pixels where the scene has what the photo has, and that show light on a surface, not light itself.
    fn weights(&self, found: &LightMeasurement, size: ImageSize) -> Vec<f32> {
        let all = self.state.all_objects().or(&self.state.photo_frame).resized(size);
        let masks: Vec<Option<Mask>> = self
            .nodes
            .iter()
            .map(|node| {
                let object = self.state.objects.values().find(|object| object.id.as_str() == node.node());
                object.map(|object| object.mask.resized(size))
            })
            .collect();
        let weight = |(i, id): (usize, &u32)| {
            let mask = masks.get((*id as usize).checked_sub(1)?)?;
            let seen = mask.as_ref().map_or(!all.bits()[i], |mask| mask.bits()[i]);
            let lit = found.albedo.get(i)?.iter().any(|a| *a > MIN_ALBEDO);
            Some(f32::from(u8::from(seen && lit)))
        };
        found.nodes.iter().enumerate().map(|at| weight(at).unwrap_or(0.0)).collect()
    }

    async fn picture(
        &self,
        step: &str,
        camera: Camera,
        lighting: &Lighting,
        field: &Arc<AlbedoField>,
        samples: u32,
    ) -> Result<Option<RgbImage>, PhaseError> {
        let mut request = self.request(step, camera, lighting, samples);
        request.albedo = Some(Arc::clone(field));
        Ok(render(self.ctx, &request).await?.map(|lit| lit.image))
    }

    /// A picture for eyes.
    async fn preview(
        &self,
        step: &str,
        field: &Arc<AlbedoField>,
        lighting: &Lighting,
    ) -> Result<Option<RgbImage>, PhaseError> {
        let camera = self.state.partial.camera;
        let camera = camera.resized(camera.size.fit_within(self.s.preview_px));
        self.picture(step, camera, lighting, field, self.s.preview_samples).await
    }

    /// A picture for the fit, which compares means of cells.
    async fn sample(&self, step: &str, look: &Look, lighting: &Lighting) -> Result<Option<RgbImage>, PhaseError> {
        let camera = self.state.partial.camera;
        let camera = camera.resized(camera.size.fit_within(self.s.measured_px));
        self.picture(step, camera, lighting, &look.field, self.s.preview_samples).await
    }

    /// Measures previews and mends reflectances until the picture matches; the last preview.
    async fn settle(&self, look: &mut Look, lighting: &Lighting) -> Result<Option<RgbImage>, PhaseError> {
        self.ctx.step("lit preview");
        let Some(mut preview) = self.sample("preview_0", look, lighting).await? else { return Ok(None) };
        let mut error = look.error(&preview);
        look.rounds.push(json!({ "step": "preview_0", "error": error }));
        let mut best = (Arc::clone(&look.field), preview.clone(), error);
        for round in 1..=self.s.measured_rounds {
            if error.stops <= GOOD_STOPS && error.chroma <= GOOD_CHROMA {
                break;
            }
            let (w, h) = look.photo.dimensions();
            look.update_field(&self.nodes, look.view.to_linear(&resize(&preview, w, h, FilterType::Triangle)));
            let step = format!("preview_{round}");
            let Some(image) = self.sample(&step, look, lighting).await? else { break };
            (error, preview) = (look.error(&image), image);
            // A step too far tells how far the next one may be.
            let kept = error.total() < best.2.total();
            look.rounds.push(json!({ "step": step, "error": error, "kept": kept, "response": look.response }));
            if kept {
                best = (Arc::clone(&look.field), preview.clone(), error);
            }
        }
        look.field = best.0;
        Ok(Some(best.1))
    }

    /// The paper's reflective loop: the model confirms, or changes what measurement does not decide.
    async fn confirm(
        &self,
        look: &mut Look,
        lighting: &mut Lighting,
        preview: &mut RgbImage,
    ) -> Result<(), PhaseError> {
        let reference = resize(&*self.state.photo, preview.width(), preview.height(), FilterType::Triangle);
        for round in 1..=self.s.rounds {
            let before = assess(&reference, preview, None);
            let measured = propose(&before, lighting);
            let mut delta = self.ask_delta(preview, lighting, &before, round, &measured).await?;
            if before.matches() {
                // Brightness is settled by measurement; lamps, colours and switches are the model's to say.
                delta.global_intensity_mult = None;
            } else if delta.is_converged() {
                // What is measured to be off is tried, whoever is content with it.
                delta = measured;
            }
            if delta.is_converged() {
                look.rounds
                    .push(json!({ "step": format!("review_{round}"), "converged": true, "error": before.error }));
                break;
            }
            let mut tried = lighting.clone();
            let notes = delta.apply(&mut tried, &self.state.partial.room.extents);
            let step = format!("preview_review_{round}");
            let Some(image) = self.preview(&step, &look.field, &tried).await? else { break };
            let after = assess(&reference, &image, None);
            let verdict = judge(&before, &after);
            look.rounds.push(json!({
                "step": format!("review_{round}"), "delta": delta, "notes": notes, "error_before": before.error,
                "error_after": after.error, "kept": verdict == Judgement::Keep,
            }));
            if let Judgement::Refuse { reason } = verdict {
                self.ctx.warn(WarningKind::ActionRefused, None, reason);
                break;
            }
            (*lighting, *preview) = (tried, image);
        }
        Ok(())
    }

    async fn ask_delta(
        &self,
        preview: &RgbImage,
        lighting: &Lighting,
        found: &Assessment,
        round: usize,
        measured: &LightingDelta,
    ) -> Result<LightingDelta, PhaseError> {
        let question = LightingReviewQuestion {
            lighting: lighting.clone(),
            stops: found.stops,
            warmth: found.warmth,
            proposed: measured.clone(),
        };
        let pictures = vec![
            Picture { caption: "IMAGE 1: the photo".into(), image: self.state.photo.clone() },
            Picture { caption: "IMAGE 2: the lit preview".into(), image: Arc::new(preview.clone()) },
        ];
        self.ctx.ask(&format!("review_{round}"), question, pictures).await
    }

    /// The lit canonical view; near walls and ceiling are left out for the eye but bounce light.
    async fn canonical(
        &self,
        step: &str,
        lighting: &Lighting,
        field: &Arc<AlbedoField>,
        longest: u32,
        samples: u32,
    ) -> Result<Option<RgbImage>, PhaseError> {
        if self.s.canonical_px == 0 {
            return Ok(None);
        }
        let size = CANONICAL.fit_within(longest);
        let view = views::canonical(self.state, size);
        let mut request = self.request(step, view.camera, lighting, samples);
        request.albedo = Some(Arc::clone(field));
        let built = self.state.features.iter().flat_map(|f| &f.mesh.materials).map(|m| m.name.as_str());
        let gone = views::gone(self.state, &view.omit);
        request.hidden_nodes = views::hidden_nodes(&view.omit, &gone, built);
        request.background = Some([0, 1, 2].map(|c| f64::from(OUTSIDE[c]) / 255.0));
        Ok(render(self.ctx, &request).await?.map(|lit| lit.image))
    }
}

/// What a lamp shares with others of its label, for lamps that shine: their gains are one.
fn twins_of(lighting: &Lighting) -> impl Fn(&str) -> Option<String> + Clone + Send + 'static {
    let lamps: BTreeMap<String, String> = lighting
        .lights
        .iter()
        .filter(|light| light.on && matches!(light.kind, LightKind::Point { .. }))
        .filter_map(|light| Some((light.id.clone(), design_of(light.object.as_ref()?.as_str()).to_owned())))
        .collect();
    move |light| lamps.get(light).cloned()
}

fn measured_from(found: &LightMeasurement, is_daylight: impl Fn(&str) -> bool) -> Measured {
    let image = |rgb: &Vec<[f32; 3]>| LinearImage { size: found.size, rgb: rgb.clone() };
    Measured {
        lights: found
            .lights
            .iter()
            .map(|(id, rgb)| LightPass {
                light: id.clone(),
                is_daylight: id.as_deref().is_some_and(&is_daylight),
                image: image(rgb),
            })
            .collect(),
        albedo: image(&found.albedo),
        ids: found.nodes.clone(),
        views: found.views.iter().filter_map(|(view, rgb)| ViewTable::new(*view, rgb.clone())).collect(),
    }
}

/// `errors`: without windows that the photo does not show, and with them.
fn fit_json(fitted: &SceneFit, lighting: &Lighting, notes: &[String], errors: [Option<PictureError>; 2]) -> Value {
    let lights: BTreeMap<&str, [f64; 3]> =
        fitted.fit.lights.iter().map(|id| id.as_deref().unwrap_or("ambient")).zip(fitted.fit.gains.clone()).collect();
    json!({
        "view": fitted.view.view, "exposure": lighting.exposure, "candidates": fitted.candidates,
        "gains": lights, "common_gain": fitted.fit.common_gain, "coverage": fitted.fit.coverage,
        "error_without_unseen_windows": errors[0], "error_with_unseen_windows": errors[1],
        "residual_before": fitted.fit.residual_before, "residual_after": fitted.fit.residual_after, "notes": notes,
    })
}

/// A path-traced answer; `None`, with a warning, when the path tracer failed.
async fn render(ctx: &PhaseCtx<'_>, request: &LitRequest) -> Result<Option<LitImage>, PhaseError> {
    match ctx.calls.render_lit(request).await {
        Ok(lit) => Ok(Some(lit)),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::empty_room;

    #[test]
    fn no_window_is_assumed_where_who_looked_says_that_no_daylight_comes_in() {
        let mut state = empty_room();
        assert!(!daylight_elsewhere(&state).is_empty());
        state.told_light.unseen_daylight = Some(true);
        assert!(!daylight_elsewhere(&state).is_empty());
        state.told_light.unseen_daylight = Some(false);
        assert!(daylight_elsewhere(&state).is_empty());
    }
}
