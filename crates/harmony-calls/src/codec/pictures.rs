//! Masks, edited images and path-traced images.

use std::path::Path;
use std::sync::Arc;

use harmony_roles::{
    EditKind, EditRequest, EditedImage, ImageEditor, LitImage, LitKind, LitRenderer, LitRequest, PlayerCard, Role,
    RoleError, SegmentRequest, SegmentedMask, Segmenter, Usage,
};
use harmony_scene::{ImageSize, SceneCamera};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Recordable, measurement, rgb_hash, show_rgb, write_failed};
use crate::book::{BookError, RecordWriter, read_json};
use crate::key::KeyHasher;

/// `answer.json` of a segmenter.
#[derive(Serialize, Deserialize)]
struct MaskList {
    masks: Vec<MaskEntry>,
}

/// One mask: its file in `masks/` is numbered, for keys and labels are words of a model.
#[derive(Serialize, Deserialize)]
struct MaskEntry {
    key: String,
    score: Option<f64>,
}

fn mask_file(i: usize) -> String {
    format!("masks/{i:03}.png")
}

impl Recordable for SegmentRequest {
    type Answer = Vec<SegmentedMask>;
    type Player = dyn Segmenter;
    const ROLE: Role = Role::Segmenter;

    fn name(&self) -> &str {
        &self.name
    }

    fn card(player: &Self::Player) -> PlayerCard {
        player.card()
    }

    async fn play(&self, player: &Self::Player) -> Result<Self::Answer, RoleError> {
        player.segment(self).await
    }

    fn hash(&self, hasher: &mut KeyHasher) {
        hasher.pixels("image", &rgb_hash(&self.image));
        hasher.json("prompts", &prompts(self));
    }

    fn write_request(&self, out: &RecordWriter<'_>, offline: bool) -> Result<(), BookError> {
        let image = show_rgb(out, "image_1.png", &self.image, "the photo", offline)?;
        out.json("request.json", &json!({"images": [image], "prompts": prompts(self)}))
    }

    fn write_answer(&self, answer: &Self::Answer, out: &RecordWriter<'_>) -> Result<(), BookError> {
        let mut masks = Vec::new();
        for (i, (one, prompt)) in answer.iter().zip(&self.prompts).enumerate() {
            let file = mask_file(i);
            let path = out.folder().join(&file);
            harmony_io::save_mask(&path, &one.mask).map_err(|error| write_failed(out, &file, &error))?;
            masks.push(MaskEntry { key: prompt.key.clone(), score: one.score });
        }
        out.json("answer.json", &MaskList { masks })
    }

    fn read_answer(&self, folder: &Path) -> Result<Self::Answer, String> {
        let list: MaskList = read_json(&folder.join("answer.json"))?;
        if list.masks.len() != self.prompts.len() {
            return Err(format!("{} masks for {} prompts", list.masks.len(), self.prompts.len()));
        }
        list.masks
            .into_iter()
            .enumerate()
            .map(|(i, entry)| {
                let mask = harmony_io::load_mask(&folder.join(mask_file(i))).map_err(|error| error.to_string())?;
                Ok(SegmentedMask { mask, score: entry.score })
            })
            .collect()
    }

    fn check(&self, answer: &Self::Answer) -> Result<(), String> {
        if answer.len() != self.prompts.len() {
            return Err(format!("{} masks for {} prompts", answer.len(), self.prompts.len()));
        }
        let size = ImageSize::new(self.image.width(), self.image.height());
        for (one, prompt) in answer.iter().zip(&self.prompts) {
            if one.mask.size() != size {
                return Err(format!("the mask of {:?} is {:?}, the photo {size:?}", prompt.key, one.mask.size()));
            }
            if one.score.is_some_and(|s| !s.is_finite()) {
                return Err(format!("the score of {:?} is not a number", prompt.key));
            }
        }
        Ok(())
    }
}

fn prompts(request: &SegmentRequest) -> Value {
    let one = |p: &harmony_roles::SegmentPrompt| json!({"key": p.key, "label": p.label, "box": p.bounds, "outline": p.outline});
    Value::Array(request.prompts.iter().map(one).collect())
}

fn edit_kind(kind: EditKind) -> &'static str {
    match kind {
        EditKind::EmptyRoom => "empty_room",
        EditKind::Amodal => "amodal",
        EditKind::Surface => "surface",
    }
}

impl Recordable for EditRequest {
    type Answer = EditedImage;
    type Player = dyn ImageEditor;
    const ROLE: Role = Role::ImageEditor;

    fn name(&self) -> &str {
        &self.name
    }

    fn card(player: &Self::Player) -> PlayerCard {
        player.card()
    }

    async fn play(&self, player: &Self::Player) -> Result<EditedImage, RoleError> {
        player.edit(self).await
    }

    fn hash(&self, hasher: &mut KeyHasher) {
        hasher.text("kind", edit_kind(self.kind));
        hasher.pixels("image", &rgb_hash(&self.image));
        hasher.mask("mask", self.mask.as_deref());
        hasher.mask("object", self.object.as_deref());
        hasher.text("instruction", &self.instruction);
    }

    fn write_request(&self, out: &RecordWriter<'_>, offline: bool) -> Result<(), BookError> {
        let image = show_rgb(out, "image_1.png", &self.image, "the image to change", offline)?;
        for (file, mask) in [("images/mask.png", &self.mask), ("images/object.png", &self.object)] {
            if let (Some(mask), false) = (mask, offline) {
                harmony_io::save_mask(&out.folder().join(file), mask)
                    .map_err(|error| write_failed(out, file, &error))?;
            }
        }
        out.text("prompt.md", &self.instruction)?;
        out.json("request.json", &json!({"kind": edit_kind(self.kind), "images": [image]}))
    }

    fn write_answer(&self, answer: &EditedImage, out: &RecordWriter<'_>) -> Result<(), BookError> {
        let png = harmony_io::picture::rgba_png(&answer.image).map_err(|e| write_failed(out, "answer.png", &e))?;
        out.bytes("answer.png", &png)?;
        out.json("answer.json", &json!({"image": "answer.png"}))
    }

    fn read_answer(&self, folder: &Path) -> Result<EditedImage, String> {
        let image = harmony_io::picture::read(&folder.join("answer.png")).map_err(|error| error.to_string())?;
        Ok(EditedImage { image: image.into_rgba8(), usage: Usage::default() })
    }

    fn check(&self, answer: &EditedImage) -> Result<(), String> {
        same_size("the edited image", answer.image.dimensions(), self.image.dimensions())
    }

    fn usage(answer: &EditedImage) -> Usage {
        answer.usage
    }
}

impl Recordable for LitRequest {
    type Answer = LitImage;
    type Player = dyn LitRenderer;
    const ROLE: Role = Role::LitRenderer;

    fn name(&self) -> &str {
        &self.name
    }

    fn card(player: &Self::Player) -> PlayerCard {
        player.card()
    }

    async fn play(&self, player: &Self::Player) -> Result<LitImage, RoleError> {
        player.render(self).await
    }

    fn hash(&self, hasher: &mut KeyHasher) {
        hasher.json("request", &lit_parameters(self));
    }

    fn write_request(&self, out: &RecordWriter<'_>, _offline: bool) -> Result<(), BookError> {
        out.json("request.json", &lit_parameters(self))
    }

    fn write_answer(&self, answer: &LitImage, out: &RecordWriter<'_>) -> Result<(), BookError> {
        let png = harmony_io::picture::rgb_png(&answer.image).map_err(|e| write_failed(out, "answer.png", &e))?;
        out.bytes("answer.png", &png)?;
        let Some(measured) = &answer.measured else { return out.json("answer.json", &json!({"image": "answer.png"})) };
        let npz = measurement::to_npz(measured).map_err(|e| write_failed(out, measurement::FILE, &e))?;
        out.bytes(measurement::FILE, &npz)?;
        out.json("answer.json", &json!({"image": "answer.png", "measured": measurement::sheet(measured)}))
    }

    fn read_answer(&self, folder: &Path) -> Result<LitImage, String> {
        let image = harmony_io::picture::read(&folder.join("answer.png")).map_err(|error| error.to_string())?;
        let measured = match self.kind {
            LitKind::Picture => None,
            LitKind::Measurement { .. } => Some(Arc::new(measurement::read(folder)?)),
        };
        Ok(LitImage { image: image.into_rgb8(), measured })
    }

    fn check(&self, answer: &LitImage) -> Result<(), String> {
        let size = self.camera.size;
        same_size("the rendered image", answer.image.dimensions(), (size.width, size.height))?;
        match (&self.kind, &answer.measured) {
            (LitKind::Picture, _) => Ok(()),
            (LitKind::Measurement { .. }, None) => Err("nothing was measured".to_owned()),
            (LitKind::Measurement { nodes, views }, Some(measured)) => {
                measurement::check(measured, size, nodes.len(), views)
            }
        }
    }
}

/// Everything but the path of the GLB: the same scene elsewhere is the same call, and no path enters a record.
fn lit_parameters(request: &LitRequest) -> Value {
    json!({
        "glb_hash": request.glb_hash,
        "camera": SceneCamera::from(&request.camera),
        "lighting": request.lighting,
        "room": request.room,
        "samples": request.samples,
        "denoise": request.denoise,
        "albedo": request.albedo.as_deref().map(albedo_hash),
        "hidden_nodes": request.hidden_nodes,
        "background": request.background,
        "measure": match &request.kind {
            LitKind::Picture => Value::Null,
            LitKind::Measurement { nodes, views } => json!({"nodes": nodes, "views": views}),
        },
    })
}

/// A field's content, short.
fn albedo_hash(field: &harmony_scene::AlbedoField) -> String {
    let text = serde_json::to_vec(field).unwrap_or_default();
    blake3::hash(&text).to_hex().to_string()
}

fn same_size(what: &str, got: (u32, u32), want: (u32, u32)) -> Result<(), String> {
    if got == want {
        Ok(())
    } else {
        Err(format!("{what} is {} x {} pixels; {} x {} are needed", got.0, got.1, want.0, want.1))
    }
}
