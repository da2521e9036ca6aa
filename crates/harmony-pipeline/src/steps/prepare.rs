//! Each object's own chain: complete -> mesh -> de-tilt -> front. Paper Sec. 3.2.
//!
//! Chains are independent and run beside each other; questions about several objects are asked on one sheet.

use std::sync::Arc;

use futures::future::join_all;
use harmony_imaging::sheet::{Cell, contact_sheet, crop_rgba};
use harmony_mesh::{catalogue, convex_parts};
use harmony_prompts::{
    CompletedAnswer, CompletedVars, FrontsAnswer, FrontsVars, InspectedObject, Occlusion, completed, fronts,
};
use harmony_roles::{EditKind, EditRequest, GeneratedMesh, MeshFrame, MeshRequest, Picture};
use harmony_scene::{
    Level, MaterialCategory, ObjectId, PbrFactors, Physical, PlacementType, Size, SurfaceMaterial, WarningKind,
};
use image::RgbaImage;
use serde_json::json;

use super::inspect::Inspection;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Candidate, Prepared, SceneState};
use crate::views;

/// A candidate with its completed picture.
struct Completed {
    candidate: Candidate,
    inspected: InspectedObject,
    image: Arc<RgbaImage>,
}

/// Prepares every kept candidate; those that are not kept, or fail, are dropped with the reason.
///
/// # Errors
/// Fatal role errors only.
pub async fn all(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &mut SceneState,
    candidates: Vec<Candidate>,
    inspection: &Inspection,
) -> Result<Vec<ObjectId>, PhaseError> {
    let mut wanted = Vec::new();
    for candidate in candidates {
        match inspection.objects.get(&candidate.id) {
            Some(object) if object.keep => wanted.push((candidate, object.clone())),
            Some(object) => {
                let reason = if object.reason.is_empty() { "rejected".to_owned() } else { object.reason.clone() };
                state.dropped.push((candidate.id.to_string(), ctx.phase.to_owned(), reason));
            }
            None => {
                ctx.warn(
                    WarningKind::ObjectDropped,
                    Some(candidate.id.clone()),
                    "nothing was said about it".to_owned(),
                );
                state.dropped.push((
                    candidate.id.to_string(),
                    ctx.phase.to_owned(),
                    "nothing was said about it".into(),
                ));
            }
        }
    }
    let completed = complete(ctx, state, wanted).await?;
    let meshes = join_all(completed.iter().map(|c| generate(ctx, level, c))).await;
    let mut raw = Vec::new();
    let mut ready = Vec::new();
    for (completed, mesh) in completed.into_iter().zip(meshes) {
        match mesh? {
            Some(mesh) if mesh.frame == MeshFrame::Raw => raw.push((completed, mesh)),
            Some(mesh) => {
                ready.push((completed, mesh, json!({ "frame": "canonical as made", "front_local_axis": "+z" })));
            }
            None => {
                let id = completed.candidate.id;
                ctx.warn(WarningKind::ObjectDropped, Some(id.clone()), "no mesh could be made of it".to_owned());
                state.dropped.push((id.to_string(), ctx.phase.to_owned(), "no mesh could be made of it".into()));
            }
        }
    }
    ready.extend(canonicalise(ctx, raw).await?);
    ready.sort_by(|a, b| a.0.candidate.id.cmp(&b.0.candidate.id));
    let detilt: serde_json::Map<String, serde_json::Value> =
        ready.iter().map(|(c, _, d)| (c.candidate.id.to_string(), d.clone())).collect();
    ctx.write_json("detilt_results.json", &detilt)?;

    let mut ids = Vec::new();
    for (completed, mesh, _) in ready {
        let prepared = assemble(ctx, state.next_index, completed, mesh)?;
        state.next_index += 1;
        ids.push(prepared.candidate.id.clone());
        state.prepared.insert(prepared.candidate.id.clone(), prepared);
    }
    Ok(ids)
}

/// Amodal completion of what is hidden, inspected, with one more try.
async fn complete(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    wanted: Vec<(Candidate, InspectedObject)>,
) -> Result<Vec<Completed>, PhaseError> {
    // This program's own fill can't invent what is hidden, so for part models the masked crop is enough.
    let editor_draws = !ctx.calls.cast().image_editor.card().offline;
    let mut done = Vec::new();
    for (candidate, inspected) in wanted {
        let Some((crop, _)) = crop_rgba(&state.photo, &candidate.mask, 0.08) else { continue };
        ctx.write_picture_rgba(&format!("crops/{}.png", candidate.id), &crop)?;
        done.push(Completed { candidate, inspected, image: Arc::new(crop) });
    }
    if editor_draws {
        let hidden: Vec<usize> = (0..done.len()).filter(|i| done[*i].inspected.occlusion != Occlusion::None).collect();
        edit_all(ctx, state, &mut done, &hidden, &[]).await?;
        let hints = inspect_completed(ctx, state, &done, &hidden).await?;
        let again: Vec<usize> = hidden.iter().zip(&hints).filter(|(_, h)| h.is_some()).map(|(i, _)| *i).collect();
        let hints: Vec<String> = hints.into_iter().flatten().collect();
        edit_all(ctx, state, &mut done, &again, &hints).await?;
    }
    for c in &done {
        ctx.write_picture_rgba(&format!("completed/{}.png", c.candidate.id), &c.image)?;
    }
    Ok(done)
}

async fn edit_all(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    done: &mut [Completed],
    which: &[usize],
    hints: &[String],
) -> Result<(), PhaseError> {
    let requests: Vec<EditRequest> = which
        .iter()
        .enumerate()
        .map(|(k, i)| {
            let c = &done[*i];
            let hint = hints.get(k).map_or(String::new(), |h| format!(" Hints: {h}."));
            let suffix = if hints.is_empty() { "complete" } else { "complete_again" };
            EditRequest {
                name: ctx.call(&format!("{}/{suffix}", c.candidate.id)),
                kind: EditKind::Amodal,
                image: state.photo.clone(),
                mask: None,
                object: Some(Arc::new(c.candidate.mask.clone())),
                instruction: format!(
                    "Draw the complete {} alone on a plain grey background, as seen from this camera: {}. \
                     Keep the visible parts as they are and complete what other objects hide.{hint}",
                    c.inspected.kind, c.inspected.description
                ),
            }
        })
        .collect();
    let edited = join_all(requests.iter().map(|r| ctx.calls.edit(r))).await;
    for (i, image) in which.iter().zip(edited) {
        done[*i].image = Arc::new(image?.image);
    }
    Ok(())
}

async fn inspect_completed(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    done: &[Completed],
    which: &[usize],
) -> Result<Vec<Option<String>>, PhaseError> {
    if which.is_empty() {
        return Ok(Vec::new());
    }
    let ids: Vec<String> = which.iter().map(|i| done[*i].candidate.id.to_string()).collect();
    let mut pictures: Vec<(String, RgbaImage)> = Vec::new();
    for i in which {
        let c = &done[*i];
        if let Some((crop, _)) = crop_rgba(&state.photo, &c.candidate.mask, 0.1) {
            pictures.push((format!("{} photo", c.candidate.id), crop));
            pictures.push((format!("{} completed", c.candidate.id), (*c.image).clone()));
        }
    }
    let cells: Vec<Cell<'_>> = pictures.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
    let question = completed(&CompletedVars {
        objects: which
            .iter()
            .map(|i| format!("- {}: {}", done[*i].candidate.id, done[*i].inspected.description))
            .collect(),
    });
    let sheet = Picture { caption: "IMAGE 1: the sheet".into(), image: Arc::new(contact_sheet(&cells, 2, 300)) };
    let asked = ids.clone();
    let answer: CompletedAnswer = ctx
        .ask("completed", question, vec![sheet], json!({ "objects": ids }), move |a: &CompletedAnswer| a.check(&asked))
        .await?;
    Ok(ids
        .iter()
        .map(|id| answer.objects.iter().find(|o| o.id == *id).filter(|o| !o.matches).map(|o| o.hint.clone()))
        .collect())
}

async fn generate(ctx: &PhaseCtx<'_>, level: Level, c: &Completed) -> Result<Option<GeneratedMesh>, PhaseError> {
    let size = c.inspected.size_m;
    let request = MeshRequest {
        name: ctx.call(&format!("{}/mesh", c.candidate.id)),
        crop: c.image.clone(),
        label: c.inspected.kind.clone(),
        description: c.inspected.description.clone(),
        level,
        size: Size { width: size.width, height: size.height, depth: size.depth },
        template: c.inspected.template.clone(),
        params: c.inspected.params.clone().unwrap_or_default(),
        part_model: c.inspected.part_model.clone(),
        settings: ctx.settings.mesh,
    };
    match ctx.calls.generate_mesh(&request).await {
        Ok(mesh) => {
            for note in &mesh.notes {
                ctx.warn(WarningKind::AnswerRepaired, Some(c.candidate.id.clone()), note.clone());
            }
            Ok(Some(mesh))
        }
        Err(error) if error.is_fatal() => Err(error.into()),
        Err(error) => {
            ctx.warn(WarningKind::PlayerReplaced, Some(c.candidate.id.clone()), error.to_string());
            Ok(None)
        }
    }
}

/// Sets raw meshes upright (by their faces, or as the paper does by the PCA axis nearest to up) and turns them to the front that the VLM picks.
async fn canonicalise(
    ctx: &PhaseCtx<'_>,
    raw: Vec<(Completed, GeneratedMesh)>,
) -> Result<Vec<(Completed, GeneratedMesh, serde_json::Value)>, PhaseError> {
    if raw.is_empty() {
        return Ok(Vec::new());
    }
    let mut upright = Vec::new();
    for (completed, mut generated) in raw {
        let (mut mesh, _) = harmony_mesh::clean(&generated.mesh, ctx.settings.mesh.faces as usize);
        let turn = if ctx.settings.upright_by_faces {
            Some(harmony_mesh::upright(&mesh).turn)
        } else {
            let vertices: Vec<glam::DVec3> = mesh.positions.iter().map(|p| p.as_dvec3()).collect();
            harmony_geometry::detilt(&vertices)
        };
        harmony_mesh::canonicalise(&mut mesh, turn.unwrap_or(glam::DMat3::IDENTITY));
        generated.mesh = Arc::new(mesh);
        upright.push((completed, generated, turn));
    }
    let ids: Vec<String> = upright.iter().map(|(c, _, _)| c.candidate.id.to_string()).collect();
    let mut pictures: Vec<(String, RgbaImage)> = Vec::new();
    for (c, g, _) in &upright {
        pictures.push((format!("{} photo", c.candidate.id), (*c.image).clone()));
        for (k, letter) in ["A", "B", "C", "D"].iter().enumerate() {
            pictures.push((format!("{} {letter}", c.candidate.id), views::mesh_view(&g.mesh, k, 260)));
        }
    }
    let cells: Vec<Cell<'_>> = pictures.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
    let question = fronts(&FrontsVars {
        objects: upright.iter().map(|(c, _, _)| format!("- {}: {}", c.candidate.id, c.inspected.kind)).collect(),
    });
    let sheet = Picture { caption: "IMAGE 1: the sheet".into(), image: Arc::new(contact_sheet(&cells, 5, 260)) };
    let asked = ids.clone();
    let answer: FrontsAnswer = ctx
        .ask("fronts", question, vec![sheet], json!({ "objects": ids }), move |a: &FrontsAnswer| a.check(&asked))
        .await?;
    let mut done = Vec::new();
    for (c, mut g, turn) in upright {
        let id = c.candidate.id.to_string();
        let panel = answer.objects.iter().find(|o| o.id == id).map(|o| o.front_panel);
        let yaw = panel.map_or(0.0, harmony_prompts::FrontPanel::yaw);
        let mut mesh = (*g.mesh).clone();
        harmony_mesh::canonicalise(&mut mesh, glam::DMat3::from_rotation_y(yaw));
        g.mesh = Arc::new(mesh);
        g.frame = MeshFrame::Canonical;
        let front_before = glam::DMat3::from_rotation_y(-yaw) * glam::DVec3::Z;
        let record = json!({
            "frame": if ctx.settings.upright_by_faces { "set upright by its faces, front by the VLM" } else { "de-tilted by PCA, front by the VLM" },
            "detilt": turn.map(|m| m.to_cols_array_2d()),
            "front_panel": panel,
            "front_local_axis": front_before.round().to_array(),
        });
        done.push((c, g, record));
    }
    Ok(done)
}

/// How far a cushion leans that stands against a back, radians.
const LEAN: f64 = 0.3;

/// Lets a cushion that stands against a back lean: its mesh turns about its lower edge, its size follows.
fn lean(c: &mut Completed, g: &mut GeneratedMesh) {
    let leans = c.inspected.placement_type == PlacementType::AgainstBack
        && harmony_mesh::template_name(&c.inspected.kind) == Some("cushion");
    let size = &mut c.inspected.size_m;
    if !leans || size.depth > 0.7 * size.height {
        return;
    }
    let (sin, cos) = LEAN.sin_cos();
    (size.height, size.depth) = (size.height * cos + size.depth * sin, size.height * sin + size.depth * cos);
    let mut mesh = (*g.mesh).clone();
    harmony_mesh::canonicalise(&mut mesh, glam::DMat3::from_rotation_x(-LEAN));
    g.mesh = Arc::new(mesh);
    g.convex = None;
}

fn assemble(ctx: &PhaseCtx<'_>, index: u32, mut c: Completed, mut g: GeneratedMesh) -> Result<Prepared, PhaseError> {
    lean(&mut c, &mut g);
    let id = c.candidate.id.clone();
    let hulls: Vec<Vec<glam::DVec3>> = g
        .convex
        .clone()
        .unwrap_or_else(|| convex_parts(&g.mesh))
        .into_iter()
        .map(|part| part.points.into_iter().map(glam::Vec3::as_dvec3).collect())
        .collect();
    ctx.write_picture_rgba(&format!("meshes/{id}.png"), &views::mesh_view(&g.mesh, 0, 256))?;
    if let Some(model) = &g.part_model {
        ctx.write_json(&format!("meshes/{id}.part_model.json"), model)?;
    }
    Ok(Prepared {
        material: material_of(&c.inspected),
        candidate: c.candidate,
        inspected: c.inspected,
        mesh: g.mesh.clone(),
        hulls,
        part_model: g.part_model.clone(),
        mesh_source: g.source.clone(),
        index,
    })
}

/// The answer's material, completed and clamped by the category's defaults.
fn material_of(object: &InspectedObject) -> SurfaceMaterial {
    let size = object.size_m;
    let volume = size.width * size.height * size.depth;
    let category: MaterialCategory =
        object.material.as_ref().map_or_else(|| catalogue::default_material(&object.kind), |m| m.material_category);
    let d = category.defaults();
    let m = object.material.as_ref();
    let pbr = category.clamp(PbrFactors {
        roughness: m.and_then(|m| m.roughness).unwrap_or(d.roughness),
        metallic: m.and_then(|m| m.metallic).unwrap_or(d.metallic),
        ior: m.and_then(|m| m.ior).unwrap_or(d.ior),
        transmission: m.and_then(|m| m.transmission).unwrap_or(d.transmission),
    });
    let sound = |v: Option<f64>, low: f64, high: f64| v.filter(|v| v.is_finite()).map(|v| v.clamp(low, high));
    let physical = Physical {
        weight_kg: sound(m.and_then(|m| m.weight_kg), 0.01, 2000.0)
            .unwrap_or((volume * category.box_density()).clamp(0.02, 800.0)),
        thickness_m: sound(m.and_then(|m| m.thickness_m), 0.0005, 2.0).unwrap_or(0.02),
        elasticity: sound(m.and_then(|m| m.elasticity), 0.0, 1.0).unwrap_or(0.1),
    };
    SurfaceMaterial { category, pbr, physical }
}
