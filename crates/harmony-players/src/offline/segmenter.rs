//! Graph cut as a segmenter.

use async_trait::async_trait;
use harmony_catalogue::Trait;
use harmony_imaging::segment::{SegmentPrompt, SegmentSettings, segment_all};
use harmony_roles::{PlayerCard, RoleError, SegmentRequest, SegmentedMask, Segmenter};

/// Cuts all objects of a photo out together, so that each pixel goes to one of them.
#[derive(Debug, Clone, Default)]
pub struct GraphCut {
    settings: SegmentSettings,
}

impl GraphCut {
    /// With settings of one's own.
    pub fn new(settings: SegmentSettings) -> Self {
        Self { settings }
    }
}

/// What others stand on or hang before never hides them: a rug, a window, a door.
fn layer(label: &str) -> i32 {
    i32::from(!harmony_catalogue::has(label, Trait::Flat) && harmony_catalogue::opening(label).is_none())
}

#[async_trait]
impl Segmenter for GraphCut {
    fn card(&self) -> PlayerCard {
        super::card("graph cut 2")
    }

    async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError> {
        let image = request.image.clone();
        let settings = self.settings.clone();
        let prompts: Vec<SegmentPrompt> = request
            .prompts
            .iter()
            .map(|p| SegmentPrompt {
                outline: p.outline.clone(),
                layer: Some(layer(&p.label)),
                ..SegmentPrompt::from_box(p.bounds)
            })
            .collect();
        super::computed(move || {
            let cut = segment_all(&image, &prompts, &settings);
            cut.into_iter().map(|one| SegmentedMask { mask: one.mask, score: Some(one.score) }).collect()
        })
        .await
    }
}
