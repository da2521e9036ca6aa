//! From the mesh that was made to the object that is placed: upright, front to +Z, convex parts, material.

use std::sync::Arc;

use harmony_catalogue::Trait;
use harmony_imaging::sheet::{Cell, contact_sheet};
use harmony_lighting::{MaterialAnswer, material_for};
use harmony_mesh::{TextureMode, broad_sides, front_by_form, front_by_size};
use harmony_placement::Shape;
use harmony_prompts::{FrontPanel, FrontsQuestion, InspectedObject, InspectedSize, NamedObject};
use harmony_roles::{GeneratedMesh, MeshFrame, Picture};
use harmony_scene::{Level, ObjectId, PlacementType, Size, SurfaceMaterial, WarningKind};
use image::RgbaImage;
use serde_json::{Value, json};

use super::prepare::Completed;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Model, Object};
use crate::views;

/// Side of the pictures of a mesh, pixels.
const VIEW: u32 = 260;

/// A mesh in the canonical frame.
#[derive(Debug, Clone)]
pub struct Canonical {
    /// The mesh.
    pub mesh: GeneratedMesh,
    /// How it came to its frame, for `detilt_results.json`.
    pub record: Value,
    /// It from its front.
    pub view: Arc<RgbaImage>,
}

/// Sets a raw mesh upright (by its faces, or as the paper does by the PCA axis nearest to up) and turns it to the
/// front that the VLM picks, or to the one that its form or its named size shows, where they do ([`front_by_form`],
/// [`broad_sides`], [`front_by_size`]).
///
/// # Errors
/// Fatal role errors only.
pub async fn canonicalise(
    ctx: &PhaseCtx<'_>,
    c: &Completed,
    mut generated: GeneratedMesh,
) -> Result<Canonical, PhaseError> {
    if generated.frame != MeshFrame::Raw {
        let mesh = Arc::clone(&generated.mesh);
        let view = Arc::new(ctx.computed(move || views::mesh_view(&mesh, 0, VIEW)).await?);
        let record = json!({ "frame": "canonical as made", "front_local_axis": "+z" });
        return Ok(Canonical { mesh: generated, record, view });
    }
    let id = c.object.id.to_string();
    let (raw, faces, by_faces) =
        (generated.mesh.clone(), ctx.settings.mesh.faces as usize, ctx.settings.upright_by_faces);
    let (crop, labelled) = (Arc::clone(&c.image), id.clone());
    let back = harmony_catalogue::back(&c.object.said.kind);
    let on_wall = c.object.level == Level::Wall;
    let stands = matches!(c.object.level, Level::Furniture | Level::Decoration) && by_faces;
    let has = |t: Trait| harmony_catalogue::has(&c.object.said.kind, t);
    let carries = stands && has(Trait::Carries) && !has(Trait::Soft);
    let named = c.object.size();
    let (mesh, turn, stand, top, sheet, panels, by_form, among) = ctx
        .computed(move || {
            let (mut mesh, _) = harmony_mesh::clean(&raw, faces);
            let turn = if by_faces {
                Some(harmony_mesh::upright(&mesh).turn)
            } else {
                let vertices: Vec<glam::DVec3> = mesh.positions.iter().map(|p| p.as_dvec3()).collect();
                harmony_geometry::detilt(&vertices)
            };
            harmony_mesh::canonicalise(&mut mesh, turn.unwrap_or(glam::DMat3::IDENTITY));
            let stand = stands.then(|| harmony_mesh::stand(&mut mesh));
            let top = carries.then(|| harmony_mesh::level_top(&mut mesh));
            let mut pictures: Vec<(String, RgbaImage)> = vec![(format!("{labelled} photo"), (*crop).clone())];
            for (k, letter) in ["A", "B", "C", "D"].iter().enumerate() {
                pictures.push((format!("{labelled} {letter}"), views::mesh_view(&mesh, k, VIEW)));
            }
            let cells: Vec<Cell<'_>> =
                pictures.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
            let sheet = contact_sheet(&cells, 5, VIEW);
            let panels: Vec<RgbaImage> = pictures.into_iter().skip(1).map(|(_, view)| view).collect();
            let by_form = back.and_then(|back| front_by_form(&mesh, back));
            let among = if on_wall { broad_sides(&mesh) } else { front_by_size(&mesh, named, back) };
            (mesh, turn, stand, top, sheet, panels, by_form, among)
        })
        .await?;
    let shown = NamedObject { id: id.clone(), about: c.object.said.kind.clone() };
    let question = FrontsQuestion { objects: vec![shown] };
    let sheet = Picture { caption: "IMAGE 1: the sheet".into(), image: Arc::new(sheet) };
    let answer = ctx.ask(&format!("{id}/front"), question, vec![sheet]).await?;
    let answered = answer.objects.iter().find(|o| o.id == id).map(|o| o.front_panel);
    // A panel's turn brings the front to +Z.
    let panel_of = |quarters: u8| FrontPanel::ALL[(4 - usize::from(quarters)) % 4];
    let front = chosen(answered, by_form.map(panel_of), among.map(|sides| sides.map(panel_of)), on_wall);
    if let Some(message) = front.repaired {
        ctx.warn(WarningKind::AnswerRepaired, Some(c.object.id.clone()), message);
    }
    let panel = front.panel;
    let yaw = panel.map_or(0.0, FrontPanel::yaw);
    let mesh = ctx
        .computed(move || {
            let mut mesh = mesh;
            harmony_mesh::canonicalise(&mut mesh, glam::DMat3::from_rotation_y(yaw));
            mesh
        })
        .await?;
    generated.mesh = Arc::new(mesh);
    generated.frame = MeshFrame::Canonical;
    let front_before = glam::DMat3::from_rotation_y(-yaw) * glam::DVec3::Z;
    let upright = if by_faces { "set upright by its faces" } else { "de-tilted by PCA" };
    let record = json!({
        "frame": format!("{upright}, {}", front.basis),
        "stand": stand.map(|s| json!({ "turned_deg": s.turned_deg, "uneven": s.uneven, "stands": s.stands })),
        "top_levelled_by": top,
        "detilt": turn.map(|m| m.to_cols_array_2d()),
        "front_panel_answered": answered,
        "front_panel": panel,
        "front_local_axis": front_before.round().to_array(),
    });
    // The mesh was turned as the panel shows it.
    let view = Arc::new(panels.into_iter().nth(panel.map_or(0, |p| p as usize)).unwrap_or_default());
    Ok(Canonical { mesh: generated, record, view })
}

/// The panel that shows a mesh's front.
#[derive(Debug, PartialEq)]
struct Front {
    panel: Option<FrontPanel>,
    /// What it rests on, in words.
    basis: &'static str,
    /// Why it is not the one that was answered.
    repaired: Option<String>,
}

/// The panel that the form shows; else the answered one, unless the front is `among` two others.
fn chosen(
    answered: Option<FrontPanel>,
    by_form: Option<FrontPanel>,
    among: Option<[FrontPanel; 2]>,
    on_wall: bool,
) -> Front {
    let excluding = |said: FrontPanel| among.filter(|sides| !sides.contains(&said)).map(|sides| sides[0]);
    let (panel, basis, why) = match (by_form, answered.and_then(excluding)) {
        (Some(_), _) => (by_form, "front by its form", "its form shows another side"),
        (None, None) => (answered, "front by the VLM", ""),
        (None, other) if on_wall => {
            (other, "one of its broad sides as front", "what hangs on a wall shows a broad side")
        }
        (None, other) => {
            (other, "front by its named width and depth", "its named width and depth speak for the other two sides")
        }
    };
    let repaired = match (answered, panel) {
        (Some(said), Some(panel)) if said != panel => {
            Some(format!("its front was taken to be in panel {panel:?}, not in {said:?} as answered: {why}"))
        }
        _ => None,
    };
    Front { panel, basis, repaired }
}

/// How far a cushion leans that stands against a back, radians.
const LEAN: f64 = 0.3;

/// Lets a cushion that stands against a back lean: its mesh turns about its lower edge, its size follows. Tells whether
/// it does.
fn lean(c: &mut Completed, g: &mut GeneratedMesh) -> bool {
    let leans = c.object.said.placement_type == PlacementType::AgainstBack
        && harmony_catalogue::has(&c.object.said.kind, Trait::Leans);
    let size = &mut c.object.said.size_m;
    if !leans || size.depth > 0.7 * size.height {
        return false;
    }
    let (sin, cos) = LEAN.sin_cos();
    (size.height, size.depth) = (size.height * cos + size.depth * sin, size.height * sin + size.depth * cos);
    let mut mesh = (*g.mesh).clone();
    harmony_mesh::canonicalise(&mut mesh, glam::DMat3::from_rotation_x(-LEAN));
    g.mesh = Arc::new(mesh);
    g.convex = None;
    true
}

/// A mesh with its convex parts, as placement wants it, for an object of about that size.
pub fn shape_of(g: &GeneratedMesh, size: &InspectedSize) -> Arc<Shape> {
    let longest_m = size.width.max(size.height).max(size.depth);
    Arc::new(Shape::from_parts(Arc::clone(&g.mesh), g.convex.as_deref(), longest_m))
}

/// The object with its model, as placement and report need it. `shape` and `view` are those of the mesh.
///
/// # Errors
/// Unwritable files.
pub async fn assemble(
    ctx: &PhaseCtx<'_>,
    mut c: Completed,
    mut g: GeneratedMesh,
    shape: Arc<Shape>,
    view: Arc<RgbaImage>,
) -> Result<Object, PhaseError> {
    let id = c.object.id.clone();
    let (c, g, shape, view) = ctx
        .computed(move || {
            if lean(&mut c, &mut g) {
                let view = Arc::new(views::mesh_view(&g.mesh, 0, VIEW));
                let shape = shape_of(&g, &c.object.said.size_m);
                return (c, g, shape, view);
            }
            (c, g, shape, view)
        })
        .await?;
    ctx.write_picture_rgba(&format!("meshes/{id}.png"), &view)?;
    if let Some(model) = &g.part_model {
        ctx.write_json(&format!("meshes/{id}.part_model.json"), model)?;
    }
    let (plain_slots, said_slots) = match &g.part_model {
        // What it does not take from the photo has a colour that was said, as a program's.
        Some(model) => {
            let kept = model.slots.iter().filter(|s| s.texture == TextureMode::Plain);
            let plain: Vec<String> = kept.map(|s| s.name.clone()).collect();
            (plain.clone(), plain)
        }
        None => (c.plain_slots, c.said_slots),
    };
    let model = Model {
        plain_slots,
        said_slots,
        bulb: c.bulb,
        moves: c.moves,
        material: material_of(ctx, &id, &c.object.said),
        mesh: g.mesh.clone(),
        shape,
        part_model: g.part_model.clone(),
        program: c.program,
        source: g.source.clone(),
    };
    Ok(Object { model: Some(model), ..c.object })
}

/// The answer's material, completed and clamped by the defaults of its kind (key `material.estimate`); what was out of range
/// is told.
fn material_of(ctx: &PhaseCtx<'_>, id: &ObjectId, object: &InspectedObject) -> SurfaceMaterial {
    let answer = object.material.as_ref().map(|m| MaterialAnswer {
        material_category: Some(m.material_category),
        roughness: m.roughness,
        metallic: m.metallic,
        ior: m.ior,
        transmission: m.transmission,
        weight_kg: m.weight_kg,
        thickness_m: m.thickness_m,
        elasticity: m.elasticity,
    });
    let InspectedSize { width, height, depth } = object.size_m;
    let (material, notes) = material_for(&object.kind, Size { width, height, depth }, answer.as_ref());
    for note in notes {
        ctx.warn(WarningKind::AnswerRepaired, Some(id.clone()), note);
    }
    material
}

#[cfg(test)]
mod tests {
    use super::*;
    use FrontPanel::{A, B, C, D};

    #[test]
    fn form_counts_before_size_and_size_before_the_answer() {
        let panel = |answered, by_form, among| chosen(answered, by_form, among, false).panel;
        assert_eq!(panel(Some(B), Some(D), Some([A, C])), Some(D));
        assert_eq!(panel(Some(B), None, Some([C, A])), Some(C));
        assert_eq!(panel(Some(A), None, Some([C, A])), Some(A));
        assert_eq!(panel(Some(B), None, None), Some(B));
        assert_eq!(panel(None, None, Some([C, A])), None);
        assert_eq!(panel(None, Some(D), None), Some(D));
    }

    #[test]
    fn another_front_than_the_answered_one_is_told_with_its_reason() {
        let told = |by_form, on_wall| chosen(Some(B), by_form, Some([C, A]), on_wall).repaired.unwrap_or_default();
        assert!(told(Some(D), false).ends_with("in panel D, not in B as answered: its form shows another side"));
        assert!(told(None, true).contains("hangs on a wall"));
        assert!(told(None, false).contains("named width and depth"));
        assert_eq!(chosen(Some(C), None, Some([C, A]), false).repaired, None);
    }
}
