//! The truth as players inside the process: what a run over HTTP is compared with.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_bench::oracle::Oracle;
use harmony_calls::Cast;
use harmony_players::mesh::finish::{Finish, SourceFrame, finished};
use harmony_roles::{
    EditKind, EditRequest, EditedImage, GeneratedMesh, ImageEditor, MeshGenerator, MeshRequest, PlayerCard, RoleError,
    Usage, VisionLanguage, VlmAnswer, VlmRequest,
};
use harmony_scene::ImageSize;
use image::{DynamicImage, Rgba, RgbaImage};

use crate::glb;
use crate::truth_oracle::TruthOracle;

/// Plays what the oracle does not, and has the oracle answer from the question's own fields, not from its text.
struct Inside(Arc<TruthOracle>);

fn card(model: &str) -> PlayerCard {
    PlayerCard { player: "truth".to_owned(), model: model.to_owned(), offline: false, concurrency: 0 }
}

fn incapable(reason: String) -> RoleError {
    RoleError::NotCapable { player: "truth".to_owned(), reason }
}

#[async_trait]
impl VisionLanguage for Inside {
    fn card(&self) -> PlayerCard {
        card("language")
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        let question = request.question.as_deref().ok_or_else(|| incapable("it is asked in words only".to_owned()))?;
        let value = self.0.question(question).map_err(incapable)?;
        Ok(VlmAnswer { raw: value.to_string(), value, usage: Usage::default() })
    }
}

#[async_trait]
impl ImageEditor for Inside {
    fn card(&self) -> PlayerCard {
        card("pictures")
    }

    async fn edit(&self, request: &EditRequest) -> Result<EditedImage, RoleError> {
        let image = if let (EditKind::Amodal, Some(object)) = (request.kind, &request.object) {
            RgbaImage::from_fn(request.image.width(), request.image.height(), |x, y| {
                let seen = object.get(i64::from(x), i64::from(y));
                let [r, g, b] = request.image.get_pixel(x, y).0;
                if seen { Rgba([r, g, b, 255]) } else { Rgba([128, 128, 128, 0]) }
            })
        } else {
            let edited = self.0.edited(&request.instruction, &[(*request.image).clone()]).map_err(incapable)?;
            let size = ImageSize::new(request.image.width(), request.image.height());
            let mask = request.mask.as_ref().map(|mask| mask.resized(size));
            let mut edited = DynamicImage::ImageRgb8(edited).to_rgba8();
            for (x, y, pixel) in edited.enumerate_pixels_mut() {
                if mask.as_ref().is_some_and(|mask| !mask.get(i64::from(x), i64::from(y))) {
                    let [r, g, b] = request.image.get_pixel(x, y).0;
                    *pixel = Rgba([r, g, b, 255]);
                }
            }
            edited
        };
        Ok(EditedImage { image, usage: Usage::default() })
    }
}

#[async_trait]
impl MeshGenerator for Inside {
    fn card(&self) -> PlayerCard {
        card("meshes")
    }

    /// The oracle's mesh, by the object's id; checked, cleaned and simplified as every generator's is.
    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        let made = self.0.oracle.generate(request).await?;
        let finish = Finish { faces: request.settings.faces as usize, frame: SourceFrame::default(), not_metal: false };
        let (mesh, notes) = finished(&glb::of(&made.mesh), &finish).map_err(incapable)?;
        Ok(GeneratedMesh { mesh: Arc::new(mesh), notes, ..made })
    }
}

/// The truth as a cast: all roles that a room's truth can play.
pub fn inside(truth_oracle: &Arc<TruthOracle>, offline: &Cast) -> Cast {
    let oracle: Arc<Oracle> = Arc::clone(&truth_oracle.oracle);
    let player = Arc::new(Inside(Arc::clone(truth_oracle)));
    Cast {
        vision_language: player.clone(),
        image_editor: player.clone(),
        mesh_generator: player,
        ..oracle.cast(offline)
    }
}
