//! A cast in which nobody answers: whatever is accepted came out of a recording.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_calls::Cast;
use harmony_roles::{
    DetectRequest, Detections, Detector, EditRequest, EditedImage, GeneratedMesh, GeometryAnswer, GeometryEstimator,
    GeometryRequest, ImageEditor, LitImage, LitRenderer, LitRequest, MeshGenerator, MeshRequest, PlayerCard, RoleError,
    SegmentRequest, SegmentedMask, Segmenter, VisionLanguage, VlmAnswer, VlmRequest,
};

/// Refuses everything.
pub struct Nobody;

fn card() -> PlayerCard {
    PlayerCard { player: "nobody".into(), model: "1".into(), offline: true, concurrency: 0 }
}

fn no<T>() -> Result<T, RoleError> {
    Err(RoleError::Refused { player: "nobody".into(), reason: "nobody is there".into() })
}

macro_rules! refuses {
    ($role:ident, $method:ident, $request:ty, $answer:ty) => {
        #[async_trait]
        impl $role for Nobody {
            fn card(&self) -> PlayerCard {
                card()
            }

            async fn $method(&self, _: &$request) -> Result<$answer, RoleError> {
                no()
            }
        }
    };
}

refuses!(VisionLanguage, ask, VlmRequest, VlmAnswer);
refuses!(Detector, detect, DetectRequest, Detections);
refuses!(Segmenter, segment, SegmentRequest, Vec<SegmentedMask>);
refuses!(ImageEditor, edit, EditRequest, EditedImage);
refuses!(MeshGenerator, generate, MeshRequest, GeneratedMesh);
refuses!(GeometryEstimator, estimate, GeometryRequest, GeometryAnswer);
refuses!(LitRenderer, render, LitRequest, LitImage);

/// Nobody in every role.
pub fn cast() -> Cast {
    let nobody = Arc::new(Nobody);
    Cast {
        vision_language: nobody.clone(),
        image_editor: nobody.clone(),
        mesh_generator: nobody.clone(),
        geometry_estimator: nobody.clone(),
        detector: nobody.clone(),
        segmenter: nobody.clone(),
        lit_renderer: nobody,
    }
}
