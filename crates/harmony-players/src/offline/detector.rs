//! Rules over regions as a detector.

use async_trait::async_trait;
use harmony_catalogue::Kind;
use harmony_imaging::outline::trace_outline;
use harmony_imaging::regions::{Region, RegionSettings, propose_regions};
use harmony_roles::{DetectRequest, Detection, Detections, Detector, PhraseRequest, PlayerCard, RoleError};
use harmony_scene::Level;

/// Least agreement of a region with a phrase, 0 to 1.
const MIN_AGREEMENT: f64 = 0.2;

/// Error of outlines, as a fraction of the photo's longer side.
const OUTLINE_ERROR: f64 = 0.003;

/// Proposes regions that differ from their surroundings and gives them to the phrases by level, place in the photo
/// and proportions. It does not know what it sees, so it finds little and gives no scores.
#[derive(Debug, Clone, Copy)]
pub struct RegionDetector;

#[async_trait]
impl Detector for RegionDetector {
    fn card(&self) -> PlayerCard {
        super::card("regions 1")
    }

    fn recognises(&self) -> bool {
        false
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        let request = request.clone();
        super::computed(move || {
            let regions = propose_regions(&request.image, &[], &RegionSettings::default());
            let height = f64::from(request.image.height());
            let longest = f64::from(request.image.width().max(request.image.height()));
            assign(&request.phrases, &regions, request.level, height, longest * OUTLINE_ERROR)
        })
        .await
    }
}

/// No detector: boxes come with the language model's lists. Who asks for some all the same gets regions.
#[derive(Debug, Clone, Copy)]
pub struct BoxesWithLists;

#[async_trait]
impl Detector for BoxesWithLists {
    fn card(&self) -> PlayerCard {
        RegionDetector.card()
    }

    fn gives_boxes(&self) -> bool {
        false
    }

    fn recognises(&self) -> bool {
        false
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        RegionDetector.detect(request).await
    }
}

fn assign(phrases: &[PhraseRequest], regions: &[Region], level: Level, height: f64, tolerance: f64) -> Detections {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (p, phrase) in phrases.iter().enumerate() {
        let kind = harmony_catalogue::kind(&phrase.label);
        for (r, region) in regions.iter().enumerate() {
            let agreement = region.objectness * place(region, level, height) * proportions(region, kind);
            if agreement >= MIN_AGREEMENT {
                pairs.push((agreement, p, r));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let mut left: Vec<usize> = phrases.iter().map(|phrase| phrase.count.clamp(1, 50)).collect();
    let mut used = vec![false; regions.len()];
    let mut found: Vec<(usize, Detection)> = Vec::new();
    for (_, p, r) in pairs {
        if used[r] || left[p] == 0 {
            continue;
        }
        used[r] = true;
        left[p] -= 1;
        let outline = Some(trace_outline(&regions[r].mask, tolerance)).filter(|outline| outline.len() >= 3);
        let (label, phrase) = (phrases[p].label.clone(), phrases[p].phrase.clone());
        found.push((p, Detection { label, phrase, bounds: regions[r].bounds, score: None, outline }));
    }
    // By phrase; best first within one, as they were found.
    found.sort_by_key(|(p, _)| *p);
    let detections = found.into_iter().map(|(_, detection)| detection).collect();
    Detections { detections, ..Detections::default() }
}

/// Whether a region lies where things of a level are seen: 0 to 1.
fn place(region: &Region, level: Level, height: f64) -> f64 {
    let (top, bottom) = (region.bounds.y0 / height.max(1.0), region.bounds.y1 / height.max(1.0));
    match level {
        Level::Ceiling => 1.0 - (f64::midpoint(top, bottom) / 0.4).min(1.0),
        Level::Furniture => ((bottom - 0.35) / 0.3).clamp(0.0, 1.0),
        Level::Wall => ((0.85 - bottom) / 0.2).clamp(0.2, 1.0),
        Level::Decoration => {
            // Small things.
            ((0.06 - region.area) / 0.04).clamp(0.0, 1.0)
        }
    }
}

/// How well a region's proportions go with what a kind's front or side would show: 0.3 to 1.
fn proportions(region: &Region, kind: Option<&Kind>) -> f64 {
    let Some(kind) = kind else { return 0.7 };
    let seen = (region.bounds.width() / region.bounds.height().max(1.0)).max(1e-3).ln();
    let [width, tall, deep] = kind.sides().map(|side| side.usual);
    let (narrow, wide) = (width.min(deep) / tall.max(1e-3), (width * width + deep * deep).sqrt() / tall.max(1e-3));
    let (narrow, wide) = (narrow.max(1e-3).ln(), wide.max(1e-3).ln());
    let off = (narrow - seen).max(seen - wide).max(0.0);
    (1.0 - off).clamp(0.3, 1.0)
}
