//! The cast: who plays each role.

use std::sync::Arc;

use harmony_roles::{
    Detector, GeometryEstimator, ImageEditor, LitRenderer, MeshGenerator, PlayerCard, Role, Segmenter, VisionLanguage,
};

/// One player a role.
#[derive(Clone)]
#[expect(missing_docs, reason = "one field a role")]
pub struct Cast {
    pub vision_language: Arc<dyn VisionLanguage>,
    pub image_editor: Arc<dyn ImageEditor>,
    pub mesh_generator: Arc<dyn MeshGenerator>,
    pub geometry_estimator: Arc<dyn GeometryEstimator>,
    pub detector: Arc<dyn Detector>,
    pub segmenter: Arc<dyn Segmenter>,
    pub lit_renderer: Arc<dyn LitRenderer>,
}

/// What the players of a cast can do; the pipeline asks this, never who they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts")]
pub struct Capabilities {
    /// The language model looks at pictures ([`VisionLanguage::sees`]).
    pub sees: bool,
    /// The image editor draws what is hidden ([`ImageEditor::draws`]).
    pub draws: bool,
    /// The mesh generator makes shapes of its own ([`MeshGenerator::makes_shapes`]).
    pub makes_shapes: bool,
    /// The detector gives boxes ([`Detector::gives_boxes`]).
    pub gives_boxes: bool,
    /// The detector knows what it boxes ([`Detector::recognises`]).
    pub recognises: bool,
    /// The renderer path-traces ([`LitRenderer::traces`]).
    pub traces: bool,
}

impl Cast {
    /// What the players can do.
    pub fn can(&self) -> Capabilities {
        Capabilities {
            sees: self.vision_language.sees(),
            draws: self.image_editor.draws(),
            makes_shapes: self.mesh_generator.makes_shapes(),
            gives_boxes: self.detector.gives_boxes(),
            recognises: self.detector.recognises(),
            traces: self.lit_renderer.traces(),
        }
    }

    /// Who plays a role.
    pub fn card(&self, role: Role) -> PlayerCard {
        match role {
            Role::VisionLanguage => self.vision_language.card(),
            Role::ImageEditor => self.image_editor.card(),
            Role::MeshGenerator => self.mesh_generator.card(),
            Role::GeometryEstimator => self.geometry_estimator.card(),
            Role::Detector => self.detector.card(),
            Role::Segmenter => self.segmenter.card(),
            Role::LitRenderer => self.lit_renderer.card(),
        }
    }

    /// Everybody, in the order of [`Role::ALL`].
    pub fn cards(&self) -> Vec<(Role, PlayerCard)> {
        Role::ALL.iter().map(|role| (*role, self.card(*role))).collect()
    }
}

impl std::fmt::Debug for Cast {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_map().entries(self.cards().into_iter().map(|(role, card)| (role.folder(), card.player))).finish()
    }
}
