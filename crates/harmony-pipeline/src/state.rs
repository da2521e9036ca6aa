//! What grows from phase to phase.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_catalogue::Trait;
use harmony_mesh::{Mesh, PartModel, Trims};
use harmony_placement::{PartialScene, Shape};
use harmony_prompts::{InspectedObject, LayoutAnswer};
use harmony_roles::Detection;
use harmony_scene::{Camera, Level, Lighting, Mask, ObjectId, PointMap, Similarity, Surface, SurfaceMaterial};
use image::{RgbImage, RgbaImage};
use serde_json::Value;

use crate::steps::programs::Program;
use crate::views::Gallery;

/// An object that was found, before it has a mesh.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Id, given by label and position in the photo.
    pub id: ObjectId,
    /// Level it was looked for on.
    pub level: Level,
    /// Detection it comes from.
    pub detection: Detection,
    /// Visible pixels at working size.
    pub mask: Mask,
    /// Segmenter's own score.
    pub mask_score: Option<f64>,
    /// Host that the list named, for decorations.
    pub host_hint: Option<ObjectId>,
}

/// A candidate with everything placement needs.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The candidate.
    pub candidate: Candidate,
    /// What was said about it.
    pub inspected: InspectedObject,
    /// Canonical mesh; part models in metres of their expected size.
    pub mesh: Arc<Mesh>,
    /// The same with its convex parts, for placement.
    pub shape: Arc<Shape>,
    /// Part model it was built from.
    pub part_model: Option<PartModel>,
    /// Program that it was built by.
    pub program: Option<Arc<Program>>,
    /// Slots that keep their look whatever the photo shows.
    pub plain_slots: Vec<String>,
    /// Those of them whose colour was said, not cut from the photo: they are lit as the photo has it.
    pub said_slots: Vec<String>,
    /// Who made the mesh, in words.
    pub mesh_source: String,
    /// Material.
    pub material: SurfaceMaterial,
    /// Value in the id image and in `segmentation.png`.
    pub index: u32,
}

impl Prepared {
    /// Whether its mesh was modelled here, by a template, a part model or a program: it may be given other proportions,
    /// and the photo's pixels are its paint.
    pub fn is_modelled(&self) -> bool {
        self.part_model.is_some() || self.program.is_some()
    }
}

/// Room, camera and what they were found by.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Layout answer (the offline player's when the VLM had none).
    pub answer: LayoutAnswer,
    /// Camera at working size.
    pub camera: Camera,
    /// Dense point map and its way into the room, when there is one.
    pub points: Option<(Arc<PointMap>, Similarity)>,
    /// How room and camera were found: method, residuals, fallbacks, for `camera.json` and the report.
    pub evidence: Value,
    /// Method in words.
    pub method: String,
    /// 0 to 1.
    pub confidence: f64,
    /// What speaks for and against it, in words.
    pub because: String,
}

/// Everything a phase hands to the next.
#[derive(Debug, Clone)]
pub struct SceneState {
    /// The photo at working size.
    pub photo: Arc<RgbImage>,
    /// The white or black frame that undistorted pictures have: nobody's pixels.
    pub photo_frame: Arc<Mask>,
    /// Layout and camera.
    pub layout: Layout,
    /// Room, camera, points and placed objects.
    pub partial: PartialScene,
    /// All prepared objects by id, placed or not.
    pub prepared: BTreeMap<ObjectId, Prepared>,
    /// Textured meshes of placed objects, canonical frame.
    pub textured: BTreeMap<ObjectId, Arc<Mesh>>,
    /// The same in the photo's light, for what has colours that were said ([`crate::steps::shading`]); always made from
    /// [`Self::unlit`], never from itself.
    pub lit: BTreeMap<ObjectId, Arc<Mesh>>,
    /// Textures of the room's faces.
    pub surfaces: BTreeMap<Surface, Arc<RgbaImage>>,
    /// Boards along the walls.
    pub trims: Trims,
    /// Pixels of what was found and then left out, by label: not in the scene, and no bare room either.
    pub rejected: Vec<(String, Arc<Mask>)>,
    /// Candidates that are not in the scene: label, phase, reason.
    pub dropped: Vec<(String, String, String)>,
    /// Sentences about the scene, one a level.
    pub summaries: Vec<String>,
    /// Light, after phase 6.
    pub lighting: Option<Lighting>,
    /// Next free object index.
    pub next_index: u32,
    /// The pictures drawn last.
    pub drawn: Gallery,
}

impl SceneState {
    /// Pixels of an object that nothing nearer hides in the photo: its mask without the masks of what lies on it.
    ///
    /// Masks of one segmenter call don't overlap; those of different levels may (a sofa's mask holds its cushions).
    /// Where two overlap, the one that the scene shows there is the nearer one (`shown`: [`crate::views::ids`]);
    /// where it shows neither, the smaller one. A rug is never the nearer one. The photo's empty frame is nobody's.
    pub fn visible_mask(&self, id: &ObjectId, shown: &[u32]) -> Option<Mask> {
        let own = self.prepared.get(id)?;
        let mut mask = own.candidate.mask.minus(&self.photo_frame);
        let area = mask.count();
        let lies_flat = is_flat(&own.inspected.kind);
        let width = mask.size().width as usize;
        let rows = mask.bounds().map_or(0..0, |b| b.y0 as usize * width..b.y1 as usize * width);
        for (other, prepared) in &self.prepared {
            if other == id || self.partial.find(other).is_none() {
                continue;
            }
            // What is placed has a mask of the camera's size.
            let claimed = &prepared.candidate.mask.bits()[rows.clone()];
            if !claimed.contains(&true) {
                continue;
            }
            let later = prepared.candidate.level > own.candidate.level;
            let smaller = prepared.candidate.mask.count() < area;
            // A rug lies under everything, however small its visible part is.
            let nearer = (later || smaller) && !is_flat(&prepared.inspected.kind);
            let seen = &mut mask.bits_mut()[rows.clone()];
            for ((bit, claimed), shown) in seen.iter_mut().zip(claimed).zip(&shown[rows.clone()]) {
                let shows_own = *shown == own.index && !lies_flat;
                *bit &= !(*claimed && !shows_own && (nearer || *shown == prepared.index));
            }
        }
        Some(mask)
    }

    /// The mesh to draw for a placed object.
    pub fn mesh_of(&self, id: &ObjectId) -> Option<&Arc<Mesh>> {
        self.lit.get(id).or_else(|| self.unlit(id))
    }

    /// An object's mesh without the photo's light on it.
    pub fn unlit(&self, id: &ObjectId) -> Option<&Arc<Mesh>> {
        self.textured.get(id).or_else(|| self.prepared.get(id).map(|p| &p.mesh))
    }

    /// Gives an object a textured mesh.
    pub fn set_textured(&mut self, id: ObjectId, mesh: Arc<Mesh>) {
        self.lit.remove(&id);
        self.textured.insert(id, mesh);
    }

    /// Forgets how an object looks, for its shape or place is another one now.
    pub fn forget_look(&mut self, id: &ObjectId) {
        self.lit.remove(id);
        self.textured.remove(id);
    }

    /// Union of all masks of what was found, prepared or left out: everything that is not bare room.
    ///
    /// What was left out because it *is* the room (a wall, a skirting board) stays bare.
    pub fn all_objects(&self) -> Mask {
        let size = self.partial.camera.size;
        let prepared = self.prepared.values().map(|p| &p.candidate.mask);
        let rejected = self
            .rejected
            .iter()
            .filter(|(label, _)| !harmony_catalogue::is_of_the_room(label))
            .map(|(_, mask)| &**mask);
        prepared.chain(rejected).filter(|m| m.size() == size).fold(Mask::empty(size), |all, mask| all.or(mask))
    }

    /// A crop of a candidate for sheets and files: transparent where it is not the object.
    pub fn crop(&self, id: &ObjectId) -> Option<RgbaImage> {
        let prepared = self.prepared.get(id)?;
        harmony_imaging::sheet::crop_rgba(&self.photo, &prepared.candidate.mask, 0.08).map(|(image, _)| image)
    }
}

/// Rugs and mats: they lie under everything.
pub fn is_flat(label: &str) -> bool {
    harmony_catalogue::has(label, Trait::Flat)
}
