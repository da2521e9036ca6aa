//! Questions and detections: answers that are JSON.

use std::path::Path;

use harmony_roles::{
    DetectRequest, Detections, Detector, PlayerCard, Role, RoleError, Usage, VisionLanguage, VlmAnswer, VlmRequest,
};
use serde_json::{Value, json};

use super::{Recordable, rgb_hash, show_rgb};
use crate::book::{BookError, RecordWriter, read_json};
use crate::check::schema_complaints;
use crate::key::KeyHasher;

/// Most boxes that a detector may give for one photo.
const MAX_DETECTIONS: usize = 1000;

/// Most points of a rough outline.
const MAX_OUTLINE: usize = 2000;

impl Recordable for VlmRequest {
    type Answer = VlmAnswer;
    type Player = dyn VisionLanguage;
    const ROLE: Role = Role::VisionLanguage;

    fn name(&self) -> &str {
        &self.name
    }

    fn card(player: &Self::Player) -> PlayerCard {
        player.card()
    }

    fn in_own_time(player: &Self::Player) -> bool {
        player.in_own_time()
    }

    async fn play(&self, player: &Self::Player) -> Result<VlmAnswer, RoleError> {
        player.ask(self).await
    }

    fn hash(&self, hasher: &mut KeyHasher) {
        hasher.text("prompt", &self.prompt);
        hasher.json("schema", &self.schema);
        hasher.json("example", &self.example);
        hasher.json("facts", &self.facts());
        for picture in &self.pictures {
            hasher.text("caption", &picture.caption);
            hasher.pixels("picture", &rgb_hash(&picture.image));
        }
    }

    fn write_request(&self, out: &RecordWriter<'_>, offline: bool) -> Result<(), BookError> {
        let mut images = Vec::new();
        for (i, picture) in self.pictures.iter().enumerate() {
            let file = format!("image_{}.png", i + 1);
            images.push(show_rgb(out, &file, &picture.image, &picture.caption, offline)?);
        }
        out.text("prompt.md", &self.prompt)?;
        out.json("request.json", &json!({"images": images, "schema": self.schema, "facts": self.facts()}))
    }

    fn write_answer(&self, answer: &VlmAnswer, out: &RecordWriter<'_>) -> Result<(), BookError> {
        if !answer.raw.is_empty() {
            out.text("raw.txt", &answer.raw)?;
        }
        out.json("answer.json", &answer.value)
    }

    fn read_answer(&self, folder: &Path) -> Result<VlmAnswer, String> {
        let value: Value = read_json(&folder.join("answer.json"))?;
        let raw = harmony_io::read_bounded(&folder.join("raw.txt"), crate::check::MAX_ANSWER_BYTES as u64)
            .map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
            .unwrap_or_default();
        Ok(VlmAnswer { value, raw, usage: Usage::default() })
    }

    fn check(&self, answer: &VlmAnswer) -> Result<(), String> {
        let complaints = schema_complaints(&self.schema, &answer.value);
        if complaints.is_empty() { Ok(()) } else { Err(complaints.join("\n")) }
    }

    fn usage(answer: &VlmAnswer) -> Usage {
        answer.usage
    }

    fn raw(answer: &VlmAnswer) -> String {
        answer.raw.clone()
    }

    fn again(&self, complaint: &str, raw: &str) -> Self {
        self.with_complaint(complaint, raw)
    }
}

impl Recordable for DetectRequest {
    type Answer = Detections;
    type Player = dyn Detector;
    const ROLE: Role = Role::Detector;

    fn name(&self) -> &str {
        &self.name
    }

    fn card(player: &Self::Player) -> PlayerCard {
        player.card()
    }

    async fn play(&self, player: &Self::Player) -> Result<Detections, RoleError> {
        player.detect(self).await
    }

    fn hash(&self, hasher: &mut KeyHasher) {
        hasher.pixels("image", &rgb_hash(&self.image));
        hasher.text("level", self.level.folder());
        hasher.json("phrases", &json!(self.phrases));
    }

    fn write_request(&self, out: &RecordWriter<'_>, offline: bool) -> Result<(), BookError> {
        let image = show_rgb(out, "image_1.png", &self.image, "the photo", offline)?;
        out.json("request.json", &json!({"images": [image], "level": self.level, "phrases": self.phrases}))
    }

    fn write_answer(&self, answer: &Detections, out: &RecordWriter<'_>) -> Result<(), BookError> {
        out.json("answer.json", answer)
    }

    fn read_answer(&self, folder: &Path) -> Result<Detections, String> {
        read_json(&folder.join("answer.json"))
    }

    fn check(&self, answer: &Detections) -> Result<(), String> {
        if answer.detections.len() > MAX_DETECTIONS {
            return Err(format!("{} boxes; at most {MAX_DETECTIONS} are taken", answer.detections.len()));
        }
        let (w, h) = (f64::from(self.image.width()), f64::from(self.image.height()));
        for found in &answer.detections {
            let b = found.bounds;
            // Half an image of slack: a box may be guessed beyond the border, not in another unit.
            let inside = |v: f64, size: f64| v.is_finite() && v >= -0.5 * size && v <= 1.5 * size;
            let ok = inside(b.x0, w) && inside(b.x1, w) && inside(b.y0, h) && inside(b.y1, h);
            if !ok || b.x1 <= b.x0 || b.y1 <= b.y0 {
                return Err(format!("the box {b:?} of {:?} is empty or not in pixels of {w} x {h}", found.label));
            }
            if found.score.is_some_and(|s| !(0.0..=1.0).contains(&s)) {
                return Err(format!("the score {:?} of {:?} is not from 0 to 1", found.score, found.label));
            }
            let outline = found.outline.as_deref().unwrap_or_default();
            if outline.len() > MAX_OUTLINE || outline.iter().flatten().any(|v| !v.is_finite()) {
                return Err(format!("the outline of {:?} is not {MAX_OUTLINE} finite points at most", found.label));
            }
        }
        Ok(())
    }

    fn usage(answer: &Detections) -> Usage {
        answer.usage
    }
}
