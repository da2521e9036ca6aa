//! What grows from phase to phase.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_catalogue::Trait;
use harmony_lighting::SunSpec;
use harmony_mesh::{Mesh, PartModel, Trims};
use harmony_placement::{PartialScene, PlacementError, Shape};
use harmony_prompts::{InspectedObject, InspectedSize, LayoutAnswer};
use harmony_roles::Detection;
use harmony_scene::{Level, Lighting, Mask, ObjectId, Opening, Size, Surface, SurfaceMaterial, Vec3};
use image::{RgbImage, RgbaImage};
use serde_json::Value;

use crate::Phase;
use crate::filter::Filtered;
use crate::looks::{Came, LookKind};
use crate::steps::features::Feature;
use crate::steps::programs::Program;
use crate::steps::surfaces::{Beyond, EditedRoom};
use crate::views::Gallery;

/// One thing in the room. It gains fields as it goes: found and masked, inspected, modelled, placed (then
/// [`SceneState::partial`] knows where), textured and lit.
#[derive(Debug, Clone)]
pub struct Object {
    /// Id, given by label and position in the photo.
    pub id: ObjectId,
    /// Level it was looked for on.
    pub level: Level,
    /// Value in the id image and in `segmentation.png`; 0 until it goes to placement.
    pub index: u32,
    /// Detection it comes from.
    pub detection: Detection,
    /// Visible pixels at working size: the same as placement's, which may take stray pieces away.
    pub mask: Arc<Mask>,
    /// Segmenter's own score.
    pub mask_score: Option<f64>,
    /// Host that the list named, for decorations.
    pub host_hint: Option<ObjectId>,
    /// The look that found it; `None` when its level listed or detected it.
    pub found_by: Option<LookKind>,
    /// What was said about it; until it is inspected, what its label alone says.
    pub said: InspectedObject,
    /// Its geometry, once there is some; always there for objects of [`SceneState::objects`].
    pub model: Option<Model>,
    /// How it looks where it is placed.
    pub look: Look,
}

impl Object {
    /// What is known of a thing that nobody has looked at closely.
    pub fn found(id: ObjectId, level: Level, detection: Detection, mask: Mask) -> Self {
        let (low, high) = harmony_catalogue::size_range(&detection.label);
        let size = (low.as_vec() + high.as_vec()) / 2.0;
        let size = InspectedSize { width: size.x, height: size.y, depth: size.z };
        let said = InspectedObject::plain(id.as_str(), &detection.label, size);
        Self {
            id,
            level,
            index: 0,
            detection,
            mask: Arc::new(mask),
            mask_score: None,
            host_hint: None,
            found_by: None,
            said,
            model: None,
            look: Look::default(),
        }
    }

    /// Its size as said, metres.
    pub fn size(&self) -> Size {
        let InspectedSize { width, height, depth } = self.said.size_m;
        Size { width, height, depth }
    }

    /// Whether its mesh was modelled here, by a template, a part model or a program: it may be given other proportions,
    /// and the photo's pixels are its paint.
    pub fn is_modelled(&self) -> bool {
        self.model.as_ref().is_some_and(|model| model.part_model.is_some() || model.program.is_some())
    }

    /// Its program, when it was built by one.
    pub fn program(&self) -> Option<&Arc<Program>> {
        self.model.as_ref()?.program.as_ref()
    }
}

/// Geometry of an object, canonical frame.
#[derive(Debug, Clone)]
pub struct Model {
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
    /// Where its program has its light, in the mesh's frame.
    pub bulb: Option<Vec3>,
    /// Whether parts of it move on joints.
    pub moves: bool,
    /// Who made the mesh, in words.
    pub source: String,
    /// Material.
    pub material: SurfaceMaterial,
}

/// Meshes of a placed object, canonical frame: drawn in place of its model's.
#[derive(Debug, Clone, Default)]
pub struct Look {
    /// With the photo's pixels.
    pub textured: Option<Arc<Mesh>>,
    /// In the photo's light, for what has colours that were said ([`crate::steps::shading`]); always made from the mesh
    /// without that light, never from itself.
    pub lit: Option<Arc<Mesh>>,
}

/// Why something that was looked for is not in the scene.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DropReason {
    /// A filter of detections took it out.
    #[error(transparent)]
    Filtered(#[from] Filtered),
    /// Who inspected it refused it, in these words.
    #[error("{}", if .0.is_empty() { "rejected" } else { .0 })]
    Refused(String),
    /// Who inspected the level left it out of the answer.
    #[error("nothing was said about it")]
    NothingSaid,
    /// An earlier level has it: its pixels are that object's, and so is its kind.
    #[error("it is {0}, which an earlier level has")]
    Known(ObjectId),
    /// Its mask shows nothing.
    #[error("no pixel of it is left")]
    NoPixels,
    /// Nobody could make a mesh.
    #[error("no mesh could be made of it")]
    NoMesh,
    /// Nobody saw it, and it fits badly where it was put; holds the probability that it is right.
    #[error("nobody looked, and it fits badly where it was put ({:.0} % sure): it stays as paint", .0 * 100.0)]
    Doubted(f64),
    /// Nobody saw it, and the point map has it elsewhere than on a face of the room.
    #[error("nobody looked, and the point map has it before the wall it was put on: it stays as a relief")]
    OffItsFace,
    /// It cannot be placed.
    #[error(transparent)]
    Unplaceable(#[from] PlacementError),
}

/// Something that was looked for and is not in the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Left {
    /// Its id, or its label when it had none yet.
    pub name: String,
    /// When it was left out.
    pub phase: Phase,
    /// Why.
    pub reason: DropReason,
}

/// How room and camera were found.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Layout answer (the offline player's when the VLM had none).
    pub answer: LayoutAnswer,
    /// How room and camera were found: method, residuals, fallbacks, for `camera.json` and the report.
    pub evidence: Value,
    /// Method in words.
    pub method: String,
    /// 0 to 1; with a point map the probability that the camera is right ([`harmony_geometry::Calibration::confidence`]),
    /// `None` where nobody knows.
    pub confidence: Option<f64>,
    /// What speaks for and against it, in words.
    pub because: String,
}

/// What was said of the light that comes into a room; where nothing was, measurement decides.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ToldLight {
    /// Whether the sun falls directly on anything.
    pub direct_sun: Option<bool>,
    /// Whether daylight comes in through windows that the photo does not show.
    pub unseen_daylight: Option<bool>,
    /// The sun through openings that the photo does not show.
    pub sun: Option<SunSpec>,
}

/// Everything a phase hands to the next.
#[derive(Debug, Clone)]
pub struct SceneState {
    /// The photo at working size.
    pub photo: Arc<RgbImage>,
    /// Nobody's pixels: the white or black frame that undistorted pictures have, and what the layout answer says is not in
    /// the room (a watermark, a person).
    pub photo_frame: Arc<Mask>,
    /// How room and camera were found.
    pub layout: Layout,
    /// Room, camera, points, and which objects stand where: the only place that knows.
    pub partial: PartialScene,
    /// All modelled objects by id, placed or not.
    pub objects: BTreeMap<ObjectId, Object>,
    /// Textures of the room's faces, in the photo's light.
    pub surfaces: BTreeMap<Surface, Arc<RgbaImage>>,
    /// The same under even light, where there is a path tracer; a face that is not there has the other one.
    pub even_surfaces: BTreeMap<Surface, Arc<RgbaImage>>,
    /// What an image editor has drawn of the room, where one is cast.
    pub edited: EditedRoom,
    /// Perceptual roughness of faces whose shine was said, or is known by their material.
    pub roughness: BTreeMap<Surface, f32>,
    /// What the photo shows through passages.
    pub beyond: Vec<Beyond>,
    /// Boards along the walls.
    pub trims: Trims,
    /// What is built into the room, by programs.
    pub features: Vec<Feature>,
    /// Pixels of what was found and then left out, by label: not in the scene, and no bare room either.
    pub rejected: Vec<(String, Arc<Mask>)>,
    /// What was looked for and is not in the scene.
    pub left: Vec<Left>,
    /// What reviews asked for in vain, one line each: the next level's review and the last look are told.
    pub refused: Vec<String>,
    /// What the looks at what was placed have changed.
    pub looks: Vec<Came>,
    /// Sentences about the scene, one a level.
    pub summaries: Vec<String>,
    /// Light, after phase 6.
    pub lighting: Option<Lighting>,
    /// What who looked says of the light that comes in.
    pub told_light: ToldLight,
    /// Those openings, once they are found.
    pub unseen_openings: Vec<Opening>,
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
        let own = self.objects.get(id)?;
        let mut mask = own.mask.minus(&self.photo_frame);
        let area = mask.count();
        let lies_flat = is_flat(&own.said.kind);
        let width = mask.size().width as usize;
        let rows = mask.bounds().map_or(0..0, |b| b.y0 as usize * width..b.y1 as usize * width);
        for (id, other) in &self.objects {
            if *id == own.id || self.partial.find(id).is_none() {
                continue;
            }
            // What is placed has a mask of the camera's size.
            let claimed = &other.mask.bits()[rows.clone()];
            if !claimed.contains(&true) {
                continue;
            }
            let later = other.level > own.level;
            let smaller = other.mask.count() < area;
            // A rug lies under everything, however small its visible part is.
            let nearer = (later || smaller) && !is_flat(&other.said.kind);
            let seen = &mut mask.bits_mut()[rows.clone()];
            for ((bit, claimed), shown) in seen.iter_mut().zip(claimed).zip(&shown[rows.clone()]) {
                let shows_own = *shown == own.index && !lies_flat;
                *bit &= !(*claimed && !shows_own && (nearer || *shown == other.index));
            }
        }
        Some(mask)
    }

    /// The mesh to draw for a placed object.
    pub fn mesh_of(&self, id: &ObjectId) -> Option<&Arc<Mesh>> {
        self.objects.get(id)?.look.lit.as_ref().or_else(|| self.unlit(id))
    }

    /// An object's mesh without the photo's light on it.
    pub fn unlit(&self, id: &ObjectId) -> Option<&Arc<Mesh>> {
        let object = self.objects.get(id)?;
        object.look.textured.as_ref().or(object.model.as_ref().map(|model| &model.mesh))
    }

    /// Gives an object a textured mesh.
    pub fn set_textured(&mut self, id: &ObjectId, mesh: Arc<Mesh>) {
        if let Some(object) = self.objects.get_mut(id) {
            object.look = Look { textured: Some(mesh), lit: None };
        }
    }

    /// Takes over what placement made of the scene. There is one mask of an object, everywhere: placement may take stray
    /// pieces away, and objects may exchange theirs.
    pub fn take(&mut self, partial: PartialScene) {
        self.partial = partial;
        for placed in &self.partial.placed {
            if let Some(object) = self.objects.get_mut(&placed.item.id) {
                object.mask = Arc::clone(&placed.item.mask);
            }
        }
    }

    /// Forgets how an object looks, for its shape or place is another one now.
    pub fn forget_look(&mut self, id: &ObjectId) {
        if let Some(object) = self.objects.get_mut(id) {
            object.look = Look::default();
        }
    }

    /// Union of all masks of what was found, modelled or left out: everything that is not bare room.
    ///
    /// What was left out because it *is* the room (a wall, a skirting board) stays bare.
    pub fn all_objects(&self) -> Mask {
        let size = self.partial.camera.size;
        let objects = self.objects.values().map(|object| &*object.mask);
        let rejected = self
            .rejected
            .iter()
            .filter(|(label, _)| !harmony_catalogue::is_of_the_room(label))
            .map(|(_, mask)| &**mask);
        objects.chain(rejected).filter(|m| m.size() == size).fold(Mask::empty(size), |all, mask| all.or(mask))
    }

    /// A crop of an object for sheets and files: transparent where it is not the object.
    pub fn crop(&self, id: &ObjectId) -> Option<RgbaImage> {
        let object = self.objects.get(id)?;
        harmony_imaging::sheet::crop_rgba(&self.photo, &object.mask, 0.08).map(|(image, _)| image)
    }
}

/// Rugs and mats: they lie under everything.
pub fn is_flat(label: &str) -> bool {
    harmony_catalogue::has(label, Trait::Flat)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_scene::Support;

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn the_nearer_one_has_the_pixels_that_two_masks_hold() {
        let mut state = empty_room();
        let seat = DVec3::new(1.6, 0.5, 0.8);
        let sofa = add(&mut state, "sofa_01", Level::Furniture, seat, DVec3::new(2.0, 0.0, 1.5), Support::Floor);
        let on = Support::Object { id: sofa.clone() };
        let small = DVec3::new(0.4, 0.3, 0.3);
        let cushion = add(&mut state, "cushion_01", Level::Decoration, small, DVec3::new(2.0, 0.5, 1.5), on);
        // A sofa's mask holds its cushions.
        let whole = state.objects[&sofa].mask.or(&state.objects[&cushion].mask);
        state.objects.get_mut(&sofa).unwrap().mask = Arc::new(whole.clone());
        let shown = crate::views::ids(&state);
        let seen = state.visible_mask(&sofa, &shown).unwrap();
        assert_eq!(seen.and(&state.objects[&cushion].mask).count(), 0);
        assert!(seen.count() > 0 && seen.count() < whole.count());
        assert_eq!(state.visible_mask(&cushion, &shown).unwrap(), *state.objects[&cushion].mask);
    }

    #[test]
    fn masks_that_placement_changed_are_those_of_the_objects() {
        let mut state = empty_room();
        let size = DVec3::new(0.4, 0.8, 0.4);
        let chair = add(&mut state, "chair_01", Level::Furniture, size, DVec3::new(2.0, 0.0, 1.5), Support::Floor);
        let mut partial = state.partial.clone();
        let mut item = (*partial.placed[0].item).clone();
        item.mask = Arc::new(item.mask.dilated(-2));
        partial.placed[0].item = Arc::new(item);
        state.take(partial);
        assert_eq!(state.objects[&chair].mask, state.partial.placed[0].item.mask);
    }

    #[test]
    fn a_look_is_forgotten_and_the_model_shows_again() {
        let mut state = empty_room();
        let size = DVec3::new(0.4, 0.8, 0.4);
        let chair = add(&mut state, "chair_01", Level::Furniture, size, DVec3::new(2.0, 0.0, 1.5), Support::Floor);
        let plain = Arc::clone(state.mesh_of(&chair).unwrap());
        let textured = Arc::new((*plain).clone());
        state.set_textured(&chair, Arc::clone(&textured));
        assert!(Arc::ptr_eq(state.mesh_of(&chair).unwrap(), &textured));
        state.forget_look(&chair);
        assert!(Arc::ptr_eq(state.mesh_of(&chair).unwrap(), &plain));
    }

    #[test]
    fn reasons_read_as_sentences() {
        assert_eq!(DropReason::Refused(String::new()).to_string(), "rejected");
        assert_eq!(DropReason::Refused("a reflection".into()).to_string(), "a reflection");
        let filtered = DropReason::from(Filtered::Covered("lamp".into()));
        assert_eq!(filtered.to_string(), "covered by another lamp");
    }
}
