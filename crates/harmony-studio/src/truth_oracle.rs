//! What the studio knows: the truth of one room, and how each service would answer from it.
//!
//! The oracle of `harmony-bench` gives the answers. What it is asked comes from the wire alone:
//!
//! | to be known | how |
//! |---|---|
//! | kind of a question, level, ids, places | the prompt's text ([`crate::reading`]) |
//! | level of a detection | the phrases: they are those of a list that the studio gave before |
//! | object of a completion or a mesh | its picture, compared with every object of the truth ([`TruthOracle::recognise`]) |
//! | which pixels to empty | the photo's place in the canvas, and the truth's id image |

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec2;
use harmony_bench::oracle::{Noise, Oracle};
use harmony_bench::truth::{TruthObject, TruthRoom};
use harmony_lighting::{LightingDelta, LightingSpec, LightingVerdict};
use harmony_mesh::Mesh;
use harmony_prompts::Question;
use harmony_roles::{DetectRequest, Detection, Detector as _, PhraseRequest};
use harmony_scene::{ImageSize, Level, Mask};
use image::imageops::{FilterType, crop_imm, resize};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::{Value, json};

use crate::reading::Asked;

/// Side of the pictures that objects are recognised by, pixels.
const THUMB: u32 = 32;

/// First id of an object in the truth's id image; below are the room's own faces.
const FIRST_OBJECT: u8 = 10;
/// What is not known of a face that is to be completed.
const UNKNOWN: [u8; 3] = [128; 3];

/// The truth of a room, and who answers from it.
pub struct TruthOracle {
    room: TruthRoom,
    photo: RgbImage,
    /// Answers from the truth.
    pub oracle: Arc<Oracle>,
    thumbs: Vec<Option<Thumb>>,
    /// Phrases of the lists that were given, and their level.
    lists: Mutex<Vec<(BTreeSet<String>, Level)>>,
}

/// How an object looks in the photo, whatever its size.
struct Thumb {
    pixels: RgbaImage,
    /// Width to height.
    aspect: f64,
}

impl Thumb {
    fn of(image: &RgbaImage) -> Option<Self> {
        let (mut x0, mut y0, mut x1, mut y1) = (u32::MAX, u32::MAX, 0, 0);
        for (x, y, _) in image.enumerate_pixels().filter(|(_, _, p)| p.0[3] >= 128) {
            (x0, y0, x1, y1) = (x0.min(x), y0.min(y), x1.max(x + 1), y1.max(y + 1));
        }
        if x0 >= x1 {
            return None;
        }
        let object = crop_imm(image, x0, y0, x1 - x0, y1 - y0).to_image();
        let aspect = f64::from(object.width()) / f64::from(object.height());
        Some(Self { pixels: resize(&object, THUMB, THUMB, FilterType::Triangle), aspect })
    }

    /// How different two are; 0 = the same.
    fn difference(&self, other: &Self) -> f64 {
        let mut sum = 0.0;
        for (a, b) in self.pixels.pixels().zip(other.pixels.pixels()) {
            let shape = f64::from(a.0[3].abs_diff(b.0[3])) / 255.0;
            let shared = f64::from(a.0[3].min(b.0[3])) / 255.0;
            let color: f64 = (0..3).map(|c| f64::from(a.0[c].abs_diff(b.0[c])) / 255.0).sum();
            sum += shape + shared * color;
        }
        sum / f64::from(THUMB * THUMB) + (self.aspect / other.aspect).ln().abs()
    }
}

/// A box that a detector gives.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The phrase that was asked for.
    pub phrase: String,
    /// Left, top, right, bottom as fractions of the picture.
    pub bounds: [f64; 4],
    /// Score, for services that give one.
    pub score: f64,
}

impl TruthOracle {
    /// Takes a room; equal noise and seeds give equal answers.
    ///
    /// # Errors
    /// A photo that cannot be read.
    pub fn new(room: TruthRoom, noise: Noise, seed: u64, exact_height: bool) -> anyhow::Result<Self> {
        let photo = image::open(room.photo())?.to_rgb8();
        let oracle = Arc::new(Oracle::new(room.clone(), noise, seed, exact_height));
        let alone = |object: &TruthObject| {
            let mask = room.mask(object.index);
            Thumb::of(&RgbaImage::from_fn(photo.width(), photo.height(), |x, y| {
                let Rgb([r, g, b]) = *photo.get_pixel(x, y);
                Rgba([r, g, b, if mask.get(i64::from(x), i64::from(y)) { 255 } else { 0 }])
            }))
        };
        let thumbs = room.objects.iter().map(alone).collect();
        Ok(Self { thumbs, photo, oracle, room, lists: Mutex::default() })
    }

    /// The room.
    pub fn room(&self) -> &TruthRoom {
        &self.room
    }

    /// Answers a question, in the form of the program's own schemas.
    ///
    /// # Errors
    /// In words, for what is no question of the program.
    pub async fn answer(&self, asked: &Asked) -> Result<Value, String> {
        match asked {
            Asked::Colour => Ok(json!({"color": "red"})),
            Asked::Question(question) => self.question(question),
            Asked::Boxes { key, phrases, pixels } => {
                let names: Vec<String> = phrases.iter().map(|(_, phrase)| phrase.clone()).collect();
                let boxes: Vec<Value> = self
                    .boxes(&names)
                    .await
                    .into_iter()
                    .map(|found| {
                        let label = phrases.iter().find(|(_, phrase)| *phrase == found.phrase);
                        let size = pixels.unwrap_or(ImageSize::new(1000, 1000));
                        let [x0, y0, x1, y1] = scaled(found.bounds, size);
                        let numbers = if *key == "box_2d" { [y0, x0, y1, x1] } else { [x0, y0, x1, y1] };
                        json!({"label": label.map_or("", |(label, _)| label), *key: numbers})
                    })
                    .collect();
                Ok(json!({"boxes": boxes}))
            }
        }
    }

    /// Answers a question of the program.
    ///
    /// # Errors
    /// In words, for one that the truth does not answer.
    pub fn question(&self, question: &Question) -> Result<Value, String> {
        let value = match question {
            // The studio drew it itself: it shows the object.
            Question::Completed(_) => question.without_looking(),
            // The truth says nothing of light: everything stays as it is listed.
            Question::Lights(_) => {
                Some(json!(LightingSpec { summary: "As listed.".into(), ..LightingSpec::default() }))
            }
            Question::LightingReview(_) => {
                Some(json!(LightingDelta { verdict: LightingVerdict::Converged, ..LightingDelta::default() }))
            }
            _ => self.oracle.answer(question),
        };
        let value = value.ok_or("the truth does not answer this question")?;
        if let Question::List(list) = question {
            self.remember_list(list.level, &value);
        }
        Ok(value)
    }

    fn remember_list(&self, level: Level, list: &Value) {
        let items = list["items"].as_array().into_iter().flatten();
        let phrases = items.filter_map(|item| item["gdino"].as_str()).map(str::to_lowercase).collect();
        self.lists.lock().unwrap_or_else(PoisonError::into_inner).push((phrases, level));
    }

    /// Boxes for phrases.
    pub async fn boxes(&self, phrases: &[String]) -> Vec<Found> {
        let asked: BTreeSet<String> = phrases.iter().map(|phrase| phrase.to_lowercase()).collect();
        let levels = {
            let lists = self.lists.lock().unwrap_or_else(PoisonError::into_inner);
            let known = lists.iter().rev().find(|(list, _)| *list == asked);
            known.map_or_else(|| Level::ALL.to_vec(), |(_, level)| vec![*level])
        };
        let size = self.room.camera.size;
        let mut all = Vec::new();
        for level in levels {
            let request = DetectRequest {
                name: String::new(),
                image: Arc::new(RgbImage::new(size.width, size.height)),
                level,
                phrases: phrases
                    .iter()
                    .map(|phrase| PhraseRequest { label: phrase.clone(), phrase: phrase.clone(), count: 0 })
                    .collect(),
            };
            let Ok(found) = self.oracle.detect(&request).await else { continue };
            all.extend(found.detections.into_iter().map(|Detection { phrase, bounds: b, score, .. }| {
                let (w, h) = (f64::from(size.width), f64::from(size.height));
                Found { phrase, bounds: [b.x0 / w, b.y0 / h, b.x1 / w, b.y1 / h], score: score.unwrap_or(0.5) }
            }));
        }
        all
    }

    /// The object that a picture shows alone: the one whose look in the photo differs least, if one comes near.
    pub fn recognise(&self, picture: &RgbaImage) -> Option<&TruthObject> {
        let seen = Thumb::of(picture)?;
        let each = self.thumbs.iter().zip(&self.room.objects);
        let each = each.filter_map(|(thumb, object)| Some((thumb.as_ref()?.difference(&seen), object)));
        each.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(difference, _)| *difference < 1.0).map(|(_, object)| object)
    }

    /// The mesh that a generator makes of a picture of one object.
    ///
    /// # Errors
    /// In words, when the picture shows no object of the room.
    pub fn mesh(&self, picture: &RgbaImage) -> Result<Mesh, String> {
        if let Some(object) = self.recognise(picture) {
            return Ok(self.oracle.generated(object));
        }
        Err("input image is empty".to_owned())
    }

    /// What an editor makes of its images.
    ///
    /// A completion comes back as the visible part that was sent: what is hidden is not invented, for the meshes do not
    /// depend on it. Of a photo, all objects are painted over with the mean colour of the wall, floor or ceiling behind.
    ///
    /// # Errors
    /// In words, for an instruction that is not understood.
    pub fn edited(&self, prompt: &str, images: &[RgbImage]) -> Result<RgbImage, String> {
        let first = images.first().ok_or("there is no image")?;
        if prompt.contains("Draw the complete") {
            return Ok(first.clone());
        }
        if prompt.contains("Remove all furniture") {
            return Ok(self.emptied(first));
        }
        if prompt.contains("Fill all the grey") {
            return Ok(filled(first));
        }
        if prompt.contains("red ball") {
            return Ok(first.clone());
        }
        Err("the instruction is not understood".to_owned())
    }

    /// The photo, laid in a canvas of another shape, without its objects.
    fn emptied(&self, canvas: &RgbImage) -> RgbImage {
        let size = self.room.camera.size;
        let (w, h) = (f64::from(size.width), f64::from(size.height));
        let (cw, ch) = (f64::from(canvas.width()), f64::from(canvas.height()));
        let scale = (cw / w).min(ch / h);
        let colors = self.surface_colors();
        RgbImage::from_fn(canvas.width(), canvas.height(), |x, y| {
            let at = |v: u32, canvas: f64, own: f64| {
                ((f64::from(v) + 0.5 - (canvas - own * scale) / 2.0) / scale).clamp(0.0, own - 1.0)
            };
            let (px, py) = (at(x, cw, w), at(y, ch, h));
            let id = self.room.ids[py as usize * size.width as usize + px as usize];
            if id < FIRST_OBJECT {
                return *canvas.get_pixel(x, y);
            }
            let behind = self.room.extents.exit(&self.room.camera.ray(DVec2::new(px, py)));
            behind.map_or(Rgb([128; 3]), |(surface, _)| colors[surface as usize % colors.len()])
        })
    }

    /// Mean colours of the faces where they are seen, in the order of their ids here.
    fn surface_colors(&self) -> Vec<Rgb<u8>> {
        let size = self.room.camera.size;
        let mut sums = [([0_u64; 3], 0_u64); 6];
        for (x, y, pixel) in self.photo.enumerate_pixels().step_by(7) {
            if self.room.ids[y as usize * size.width as usize + x as usize] >= FIRST_OBJECT {
                continue;
            }
            let ray = self.room.camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let Some((surface, _)) = self.room.extents.exit(&ray) else { continue };
            let (sum, count) = &mut sums[surface as usize % 6];
            (0..3).for_each(|c| sum[c] += u64::from(pixel.0[c]));
            *count += 1;
        }
        sums.map(|(sum, count)| Rgb(sum.map(|s| s.checked_div(count).map_or(160, |v| v as u8)))).to_vec()
    }

    /// Mask of an object of the truth in a picture of a size.
    pub fn mask(&self, object: &TruthObject, size: ImageSize) -> Mask {
        self.room.mask(object.index).resized(size)
    }
}

/// Fractions as whole numbers of a size.
pub fn scaled(bounds: [f64; 4], size: ImageSize) -> [f64; 4] {
    let (w, h) = (f64::from(size.width), f64::from(size.height));
    [bounds[0] * w, bounds[1] * h, bounds[2] * w, bounds[3] * h].map(f64::round)
}

/// A face of which the grey is not known, the rest of it in the middle of what is.
fn filled(face: &RgbImage) -> RgbImage {
    let known: Vec<[u8; 3]> = face.pixels().map(|p| p.0).filter(|p| *p != UNKNOWN).collect();
    let middle = |c: usize| {
        let mut values: Vec<u8> = known.iter().map(|p| p[c]).collect();
        values.sort_unstable();
        values.get(values.len() / 2).copied().unwrap_or(UNKNOWN[c])
    };
    let color = image::Rgb([middle(0), middle(1), middle(2)]);
    RgbImage::from_fn(face.width(), face.height(), |x, y| {
        if face.get_pixel(x, y).0 == UNKNOWN { color } else { *face.get_pixel(x, y) }
    })
}
