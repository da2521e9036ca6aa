//! An image editor behind one of the wire formats.

use async_trait::async_trait;
use harmony_io::picture::{decode, rgb_png, rgba_png};
use harmony_roles::{EditKind, EditRequest, EditedImage, ImageEditor, PlayerCard, RoleError};
use harmony_scene::{ImageSize, Mask, PixelBox};
use image::imageops::{crop_imm, overlay};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::Value;
use tokio::sync::OnceCell;

use super::cutout::cut_out;
use super::frame::{self, Around, Canvas, Sizes};
use super::wire::{self, EditSettings, SentEdit};
use crate::check::{Check, Checked};
use crate::http::{Http, HttpRequest, Received, Service, ServiceOptions};
use crate::vlm::wire::{Trouble, gemini};
use crate::work::computed;

/// Plain grey behind a cut-out object.
const PLAIN: [u8; 3] = [128; 3];

/// Room left around the visible part of an object for what is hidden, as a fraction of its box.
const MARGIN: f64 = 0.35;

/// Which format is spoken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EditorFormat {
    /// Gemini's image models.
    Gemini,
    /// OpenAI's `images/edits`.
    OpenAi,
    /// `images/edits` of a local server.
    Local,
}

/// How an editor is set up.
#[derive(Debug, Clone)]
pub struct EditorOptions {
    /// Where and how.
    pub service: ServiceOptions,
    /// Format.
    pub format: EditorFormat,
    /// The model and what is set for it.
    pub settings: EditSettings,
    /// How many calls may run at once; 0 = no limit.
    pub concurrency: usize,
}

/// An image editor.
#[derive(Debug)]
pub struct EditorPlayer {
    service: Service,
    format: EditorFormat,
    settings: EditSettings,
    concurrency: usize,
    /// Whether a local server is stable-diffusion.cpp's.
    sd_server: OnceCell<bool>,
}

/// A request, ready to be sent, and what is needed to read the answer.
struct Prepared {
    sent: SentEdit,
    canvas: Canvas,
    /// Place of the crop in the picture: left, top.
    corner: (u32, u32),
}

impl EditorPlayer {
    /// Sets it up; nothing is sent yet.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn new(http: &Http, options: EditorOptions) -> Result<Self, RoleError> {
        let service = Service::new(http, options.service)?;
        if options.settings.model.trim().is_empty() && options.format != EditorFormat::Local {
            return Err(service.not_set_up("no model is named", "set `model` in its section of harmony.toml"));
        }
        Ok(Self {
            service,
            format: options.format,
            settings: options.settings,
            concurrency: options.concurrency,
            sd_server: OnceCell::new(),
        })
    }

    /// Asks a local server which one it is. One that has no list of models is none that is known.
    async fn find_out(&self) -> Result<bool, RoleError> {
        let answer = self.service.send(&HttpRequest::get("/models")).await?;
        Ok(wire::is_sd_server(&serde_json::from_slice(&answer.body).unwrap_or(Value::Null)))
    }

    /// The service, for whoever needs its key hidden.
    pub fn service(&self) -> &Service {
        &self.service
    }

    fn sizes(&self) -> Sizes {
        match self.format {
            EditorFormat::Gemini => frame::GEMINI,
            EditorFormat::OpenAi if self.settings.model.starts_with("gpt-image-2") => frame::GPT_IMAGE_2,
            EditorFormat::OpenAi => frame::GPT_IMAGE_1,
            EditorFormat::Local => frame::LOCAL,
        }
    }

    fn unusable(&self, complaint: String) -> RoleError {
        self.service.unusable(complaint, "")
    }

    async fn received(&self, sent: &SentEdit) -> Result<Received<wire::ReceivedEdit>, RoleError> {
        let request = match self.format {
            EditorFormat::Gemini => {
                HttpRequest::post_json(&gemini::path(&self.settings.model), &wire::gemini_body(sent, &self.settings))
            }
            EditorFormat::OpenAi => HttpRequest::post_form(wire::EDITS_PATH, &wire::openai_form(sent, &self.settings)),
            EditorFormat::Local => {
                let sd_server = *self.sd_server.get_or_try_init(|| self.find_out()).await?;
                HttpRequest::post_form(wire::EDITS_PATH, &wire::local_form(sent, &self.settings, sd_server))
            }
        };
        let Received { value: body, closed_for }: Received<Value> = self.service.call_json(&request).await?;
        let read = match self.format {
            EditorFormat::Gemini => wire::read_gemini(&body),
            EditorFormat::OpenAi | EditorFormat::Local => wire::read_edits(&body),
        };
        let received = read.map_err(|trouble| match trouble {
            Trouble::Refused(reason) => self.service.refused(&reason),
            Trouble::Failed(reason) => self.service.unavailable(reason),
            Trouble::CutOff(reason) | Trouble::NotUnderstood(reason) => {
                self.service.unusable(reason, &without_files(&body))
            }
        })?;
        Ok(Received { value: received, closed_for })
    }
}

/// The body of an answer without its long texts: what is in it, not the files.
fn without_files(body: &Value) -> String {
    fn shorten(value: &mut Value) {
        match value {
            Value::String(text) if text.len() > 300 => *value = Value::String(format!("({} characters)", text.len())),
            Value::Array(items) => items.iter_mut().for_each(shorten),
            Value::Object(map) => map.values_mut().for_each(shorten),
            _ => {}
        }
    }
    let mut body = body.clone();
    shorten(&mut body);
    body.to_string()
}

/// What is sent for a request.
fn prepare(request: &EditRequest, sizes: Sizes, with_context: bool) -> Result<Prepared, String> {
    let image = &*request.image;
    let size = ImageSize::new(image.width(), image.height());
    let object = request.object.as_deref().filter(|_| request.kind == EditKind::Amodal);
    let bounds = object.and_then(Mask::bounds);
    let place = match bounds {
        Some(bounds) => bounds.padded(MARGIN, size).clamped(size),
        None => PixelBox { x0: 0.0, y0: 0.0, x1: f64::from(size.width), y1: f64::from(size.height) },
    };
    let (left, top) = (place.x0.floor() as u32, place.y0.floor() as u32);
    let (width, height) = (place.x1.ceil() as u32 - left, place.y1.ceil() as u32 - top);
    if width == 0 || height == 0 {
        return Err("the picture has no pixels".to_owned());
    }
    let crop = crop_imm(image, left, top, width, height).to_image();
    let canvas = Canvas::new(ImageSize::new(width, height), sizes);
    let file = |image: &RgbImage| rgb_png(image).map_err(|error| error.to_string());
    let mut images = Vec::new();
    let prompt = match object {
        Some(object) if bounds.is_some() => {
            let alone = RgbImage::from_fn(width, height, |x, y| {
                let seen = object.get(i64::from(x + left), i64::from(y + top));
                if seen { *crop.get_pixel(x, y) } else { Rgb(PLAIN) }
            });
            images.push(file(&canvas.lay(&alone, Around::Plain(PLAIN)))?);
            let context = if with_context {
                images.push(file(&canvas.lay(&crop, Around::Border))?);
                " The second image shows the same region of the photo, for context only."
            } else {
                ""
            };
            format!(
                "The first image shows the visible part of one object of a photo, all else is plain grey.{context} {} \
                 Keep place, scale and view of the first image. The background is plain grey (#808080) everywhere: no \
                 floor, no shadow, no other thing.",
                request.instruction
            )
        }
        _ => {
            images.push(file(&canvas.lay(&crop, Around::Border))?);
            format!("{} Keep the framing exactly: nothing that stays may move.", request.instruction)
        }
    };
    let mask = match (&request.mask, request.kind) {
        (Some(mask), EditKind::EmptyRoom | EditKind::Surface) => {
            let laid = canvas.lay_mask(&mask.resized(size));
            let picture = RgbaImage::from_fn(canvas.size.width, canvas.size.height, |x, y| {
                Rgba([0, 0, 0, if laid.get(i64::from(x), i64::from(y)) { 0 } else { 255 }])
            });
            Some(rgba_png(&picture).map_err(|error| error.to_string())?)
        }
        _ => None,
    };
    let sent = SentEdit { prompt, images, mask, size: (canvas.size.width, canvas.size.height), shape: canvas.shape };
    Ok(Prepared { sent, canvas, corner: (left, top) })
}

/// The edited image in the frame of the request's picture.
fn finish(request: &EditRequest, prepared: &Prepared, bytes: &[u8]) -> Result<RgbaImage, String> {
    let edited = decode(bytes).map_err(|error| error.to_string())?.to_rgba8();
    let mut crop = prepared.canvas.bring_back(&edited)?;
    let image = &*request.image;
    let size = ImageSize::new(image.width(), image.height());
    let (left, top) = prepared.corner;
    let may_change = request.mask.as_deref().map(|mask| mask.resized(size));
    let keeps =
        |x: u32, y: u32| may_change.as_ref().is_some_and(|mask| !mask.get(i64::from(x + left), i64::from(y + top)));
    match request.kind {
        EditKind::Surface => Ok(crop),
        EditKind::EmptyRoom => {
            for (x, y, pixel) in crop.enumerate_pixels_mut() {
                let [r, g, b] = if keeps(x, y) {
                    image.get_pixel(x + left, y + top).0
                } else {
                    [pixel.0[0], pixel.0[1], pixel.0[2]]
                };
                *pixel = Rgba([r, g, b, 255]);
            }
            Ok(crop)
        }
        EditKind::Amodal => {
            cut_out(&mut crop)?;
            if may_change.is_some() {
                // What may not change is the object as it is seen, and the background where it is not seen.
                let object = request.object.as_deref();
                for (x, y, pixel) in crop.enumerate_pixels_mut().filter(|(x, y, _)| keeps(*x, *y)) {
                    let [r, g, b] = image.get_pixel(x + left, y + top).0;
                    let seen = object.is_some_and(|object| object.get(i64::from(x + left), i64::from(y + top)));
                    *pixel = Rgba([r, g, b, if seen { 255 } else { 0 }]);
                }
            }
            crop.pixels_mut().filter(|p| p.0[3] == 0).for_each(|p| *p = Rgba([PLAIN[0], PLAIN[1], PLAIN[2], 0]));
            let mut whole = RgbaImage::from_pixel(size.width, size.height, Rgba([PLAIN[0], PLAIN[1], PLAIN[2], 0]));
            overlay(&mut whole, &crop, i64::from(left), i64::from(top));
            Ok(whole)
        }
    }
}

#[async_trait]
impl ImageEditor for EditorPlayer {
    fn card(&self) -> PlayerCard {
        let model = if self.settings.model.is_empty() { "as served" } else { &self.settings.model };
        PlayerCard {
            player: self.service.player().to_owned(),
            model: model.to_owned(),
            offline: false,
            concurrency: self.concurrency,
        }
    }

    async fn edit(&self, request: &EditRequest) -> Result<EditedImage, RoleError> {
        let (sizes, with_context) = (self.sizes(), self.format != EditorFormat::Local);
        let player = self.service.player();
        let prepared = {
            let request = request.clone();
            computed(player, move || prepare(&request, sizes, with_context)).await?
        };
        let prepared = prepared.map_err(|reason| RoleError::NotCapable { player: player.to_owned(), reason })?;
        let Received { value: received, closed_for } = self.received(&prepared.sent).await?;
        let usage = received.tokens.usage(closed_for);
        tracing::debug!(player = self.service.player(), bytes = received.bytes.len(), "edited");
        let request = request.clone();
        let image = computed(player, move || finish(&request, &prepared, &received.bytes)).await?;
        let image = image.map_err(|complaint| self.unusable(complaint))?;
        Ok(EditedImage { image, usage })
    }
}

#[async_trait]
impl Check for EditorPlayer {
    async fn check(&self, paid: bool) -> Result<Checked, RoleError> {
        let path = match self.format {
            EditorFormat::Gemini | EditorFormat::OpenAi => format!("/models/{}", self.settings.model),
            EditorFormat::Local => "/models".to_owned(),
        };
        self.service.call(&HttpRequest::get(&path)).await?;
        if !paid {
            return Ok(Checked { detail: format!("{} is there", self.card().model), usage: None });
        }
        let image =
            RgbImage::from_fn(
                512,
                384,
                |x, y| if y > 250 { Rgb([150, 110, 80]) } else { Rgb([200, 200, (x / 8) as u8]) },
            );
        let request = EditRequest {
            name: "doctor/check".to_owned(),
            kind: EditKind::EmptyRoom,
            image: std::sync::Arc::new(image),
            mask: None,
            object: None,
            instruction: "Put a red ball on the brown floor.".to_owned(),
        };
        let edited = self.edit(&request).await?;
        Ok(Checked { detail: format!("{} edits pictures", self.card().model), usage: Some(edited.usage) })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    fn photo() -> RgbImage {
        RgbImage::from_fn(320, 240, |x, y| Rgb([(x % 256) as u8, (y % 256) as u8, 60]))
    }

    fn request(kind: EditKind, mask: Option<Mask>, object: Option<Mask>) -> EditRequest {
        EditRequest {
            name: "1_layout/empty_room".into(),
            kind,
            image: Arc::new(photo()),
            mask: mask.map(Arc::new),
            object: object.map(Arc::new),
            instruction: "Do it.".into(),
        }
    }

    #[test]
    fn outside_of_the_mask_the_photo_is_put_back() {
        let size = ImageSize::new(320, 240);
        let mask = Mask::from_fn(size, |x, _| x >= 160);
        let request = request(EditKind::EmptyRoom, Some(mask.clone()), None);
        let prepared = prepare(&request, frame::GEMINI, true).unwrap();
        assert!(prepared.sent.mask.is_some());
        // An editor that paints everything white.
        let white = rgb_png(&RgbImage::from_pixel(1184, 864, Rgb([255; 3]))).unwrap();
        let back = finish(&request, &prepared, &white).unwrap();
        assert_eq!(back.dimensions(), (320, 240));
        for (x, y, pixel) in back.enumerate_pixels() {
            let want = if mask.get(i64::from(x), i64::from(y)) { [255; 3] } else { request.image.get_pixel(x, y).0 };
            assert_eq!(pixel.0, [want[0], want[1], want[2], 255], "{x} {y}");
        }
    }

    #[test]
    fn a_completed_object_lies_where_it_is_seen() {
        let size = ImageSize::new(320, 240);
        let object = Mask::from_fn(size, |x, y| (200..260).contains(&x) && (100..160).contains(&y));
        let request = request(EditKind::Amodal, None, Some(object.clone()));
        let prepared = prepare(&request, frame::GPT_IMAGE_1, true).unwrap();
        assert_eq!(prepared.sent.images.len(), 2);
        // An editor that leaves the first image as it is, but for its size.
        let sent = decode(&prepared.sent.images[0]).unwrap().to_rgb8();
        let back = finish(&request, &prepared, &rgb_png(&sent).unwrap()).unwrap();
        assert_eq!(back.dimensions(), (320, 240));
        let found = Mask::from_fn(size, |x, y| back.get_pixel(x, y).0[3] > 0);
        assert!(found.iou(&object) > 0.93, "{}", found.iou(&object));
        assert_eq!(back.get_pixel(0, 0).0, [128, 128, 128, 0]);
        let (a, b) = (back.get_pixel(230, 130).0, request.image.get_pixel(230, 130).0);
        assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 6), "{a:?} {b:?}");
    }

    #[test]
    fn what_is_no_image_or_has_another_shape_is_refused() {
        let request = request(EditKind::EmptyRoom, None, None);
        let prepared = prepare(&request, frame::GEMINI, true).unwrap();
        assert!(finish(&request, &prepared, b"{\"error\": \"no\"}").unwrap_err().contains("not a readable image"));
        let square = rgb_png(&RgbImage::new(64, 64)).unwrap();
        assert!(finish(&request, &prepared, &square).unwrap_err().contains("another shape"));
    }
}
