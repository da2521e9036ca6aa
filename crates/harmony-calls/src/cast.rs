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

impl Cast {
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
