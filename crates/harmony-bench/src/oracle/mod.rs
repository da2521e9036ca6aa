//! Oracle players: every role answered from a room's truth, with noise of our choice.
//!
//! They see only what the real players see (the request) and recognise objects by box and label, so that a fault of
//! the pipeline's bookkeeping shows. What they say is the truth plus [`Noise`], drawn by seed, room and purpose.
//! Beyond the list, the assumptions about a language model at level `real` are: pins 1 % of the image off,
//! room width and depth 10 % off, camera hints 8 % off, directions of fronts 10 degrees off and rounded to 15,
//! and a review that notices 70 % of gross faults and raises a false alarm for 3 % of the objects.

mod atlas;
mod degrade;
mod dense;
mod faults;
mod language;
mod lights;
mod looks;
mod mesh;
mod noise;
mod paint;
mod review;
mod vision;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use harmony_calls::Cast;
use harmony_roles::{GeometryEstimator, MeshGenerator, PlayerCard};
use harmony_scene::{ImageSize, Level, PixelBox};
use rand_chacha::ChaCha8Rng;

pub use faults::Faults;
pub use noise::{Draws, Fault, Noise, NoiseLevel, normal, smooth_field};

use crate::spent::{Meter, Seconds};
use crate::truth::{FEWEST_PIXELS, TruthLight, TruthRoom};

/// Other names for a kind of object.
const SYNONYMS: [(&str, &str); 24] = [
    ("sofa", "couch"),
    ("armchair", "easy chair"),
    ("rug", "carpet"),
    ("curtains", "drapes"),
    ("painting", "wall picture"),
    ("pendant lamp", "hanging lamp"),
    ("table lamp", "bedside lamp"),
    ("bookcase", "bookshelf"),
    ("potted plant", "houseplant"),
    ("mug", "cup"),
    ("nightstand", "bedside table"),
    ("coffee table", "low table"),
    ("side table", "end table"),
    ("sideboard", "buffet cabinet"),
    ("clock", "wall clock"),
    ("waste bin", "trash can"),
    ("office chair", "desk chair"),
    ("dining table", "table"),
    ("monitor", "computer screen"),
    ("refrigerator", "fridge"),
    ("base cabinet", "kitchen cabinet"),
    ("desk", "writing desk"),
    ("photo frame", "picture frame"),
    ("books", "stack of books"),
];

/// What plays the mesh generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Meshes {
    /// The true meshes, painted with what the photo shows of them, the rest in their mean colour.
    #[default]
    Truth,
    /// Part models with paint from the photo, as a user without a generator has them: this program's own player.
    Part,
    /// The true meshes as a generator leaves them at its worse: tilted, thin parts thick, the front on the back, bits
    /// in the air.
    Degraded,
    /// The true meshes in grey, as before appearance was measured.
    Grey,
}

impl Meshes {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Truth, Self::Part, Self::Degraded, Self::Grey];

    /// In a word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Truth => "truth",
            Self::Part => "part",
            Self::Degraded => "degraded",
            Self::Grey => "grey",
        }
    }
}

impl std::str::FromStr for Meshes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = || Self::ALL.map(Self::name).join(", ");
        Self::ALL.into_iter().find(|m| m.name() == text).ok_or_else(|| format!("meshes are {}", names()))
    }
}

/// The oracle of one room.
#[derive(Debug)]
pub struct Oracle {
    room: TruthRoom,
    noise: Noise,
    draws: Draws,
    /// The room's height is told exactly whatever the noise.
    exact_height: bool,
    /// Boxes of the objects of the room at the truth's resolution, by position in `room.objects`.
    boxes: Vec<Option<PixelBox>>,
    /// Ids of the run and what they are, learned when the candidates are shown.
    known: Mutex<BTreeMap<String, usize>>,
    /// Generated meshes have so many faces and a texture; else those of the truth and none.
    faces: Option<usize>,
    /// What the meshes are made of.
    meshes: Meshes,
    /// The photo, where meshes are painted with it.
    photo: Option<Arc<image::RgbImage>>,
    /// Its lights.
    lights: Vec<TruthLight>,
    /// What its answers have cost.
    spent: Meter,
    /// What there was for second looks to find.
    faults: Mutex<Faults>,
}

impl Oracle {
    /// An oracle for a room. Equal seeds give equal answers.
    pub fn new(room: TruthRoom, noise: Noise, seed: u64, exact_height: bool) -> Self {
        let boxes = room.objects.iter().map(|o| o.bounds(&room)).collect();
        let draws = Draws::new(seed, &room.name);
        let lights = crate::truth::lights_of(&room.folder);
        Self {
            room,
            noise,
            draws,
            exact_height,
            boxes,
            known: Mutex::default(),
            faces: None,
            meshes: Meshes::Grey,
            photo: None,
            lights,
            spent: Meter::default(),
            faults: Mutex::default(),
        }
    }

    /// The same with other meshes; [`Meshes::Truth`] and [`Meshes::Degraded`] are painted with `photo`.
    #[must_use]
    pub fn with_meshes(self, meshes: Meshes, photo: Arc<image::RgbImage>) -> Self {
        Self { meshes, photo: Some(photo), ..self }
    }

    /// The same with generated meshes of so many faces, textured.
    #[must_use]
    pub fn with_faces(self, faces: usize) -> Self {
        Self { faces: Some(faces), ..self }
    }

    /// What its answers have cost so far.
    pub fn spent(&self) -> Seconds {
        self.spent.total()
    }

    /// What there was for second looks to find so far, and what of it was found.
    pub fn faults(&self) -> Faults {
        self.faults.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The whole cast; the roles that an oracle cannot play better are this program's own.
    pub fn cast(self: &Arc<Self>, offline: &Cast) -> Cast {
        let player: Arc<Self> = Arc::clone(self);
        let mesh_generator: Arc<dyn MeshGenerator> = match self.meshes {
            Meshes::Part => Arc::clone(&offline.mesh_generator),
            _ => player.clone(),
        };
        let geometry_estimator: Arc<dyn GeometryEstimator> =
            if self.noise.photo_alone { Arc::clone(&offline.geometry_estimator) } else { player.clone() };
        Cast {
            vision_language: player.clone(),
            mesh_generator,
            geometry_estimator,
            detector: player.clone(),
            segmenter: player,
            ..offline.clone()
        }
    }

    /// An object's box, some times as far off as a detector's, in pixels of the truth; `None` where it is not seen.
    fn box_off(&self, object: usize, times: f64, rng: &mut ChaCha8Rng) -> Option<PixelBox> {
        let b = self.boxes[object]?;
        let mut off = |side: f64| times * self.noise.boxes * side * normal(rng).clamp(-2.5, 2.5);
        let (w, h) = (b.width(), b.height());
        Some(PixelBox { x0: b.x0 + off(w), y0: b.y0 + off(h), x1: b.x1 + off(w), y1: b.y1 + off(h) })
    }

    /// The object that a box with a label means: the best overlap among objects of that name, else among all.
    fn recognise(&self, level: Option<Level>, label: &str, bounds: &PixelBox, image: ImageSize) -> Option<usize> {
        let kx = f64::from(self.room.camera.size.width) / f64::from(image.width);
        let ky = f64::from(self.room.camera.size.height) / f64::from(image.height);
        let b = PixelBox { x0: bounds.x0 * kx, y0: bounds.y0 * ky, x1: bounds.x1 * kx, y1: bounds.y1 * ky };
        let mut best: Option<(f64, usize)> = None;
        for (i, object) in self.room.objects.iter().enumerate() {
            if level.is_some_and(|l| l != object.level) {
                continue;
            }
            let Some(own) = &self.boxes[i] else { continue };
            let named = same_kind(&object.label, label);
            let score = own.iou(&b) + if named { 1.0 } else { 0.0 };
            if own.iou(&b) > 0.1 && best.is_none_or(|(s, _)| score > s) {
                best = Some((score, i));
            }
        }
        best.map(|(_, i)| i)
    }

    fn remember(&self, id: &str, object: usize) {
        self.known.lock().unwrap_or_else(PoisonError::into_inner).insert(id.to_owned(), object);
    }

    fn recall(&self, id: &str) -> Option<usize> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner).get(id).copied()
    }

    /// Id in the run of an object of the truth.
    fn id_of(&self, truth: &str) -> Option<String> {
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.iter().find(|(_, i)| self.room.objects[**i].id == truth).map(|(id, _)| id.clone())
    }

    /// Whether lists and detector pass over an object that the photo shows.
    fn overlooks(&self, id: &str) -> bool {
        self.draws.happens(&format!("overlooked {id}"), self.noise.overlooked)
    }

    /// Objects of a level that are seen and not missed.
    fn seen(&self, level: Level) -> impl Iterator<Item = usize> + '_ {
        (0..self.room.objects.len())
            .filter(move |i| self.room.objects[*i].level == level)
            .filter(|i| self.room.objects[*i].visible_pixels >= FEWEST_PIXELS)
    }
}

fn card(model: &str) -> PlayerCard {
    PlayerCard { player: "oracle".to_owned(), model: model.to_owned(), offline: false, concurrency: 0 }
}

/// The other name of a kind, if there is one.
fn synonym(label: &str) -> Option<&'static str> {
    SYNONYMS.iter().find(|(name, _)| *name == label).map(|(_, other)| *other)
}

/// Whether two names mean one kind.
pub fn same_kind(truth: &str, said: &str) -> bool {
    let said = said.trim().to_lowercase();
    truth == said || synonym(truth) == Some(said.as_str())
}

#[cfg(test)]
mod tests {
    #[test]
    fn another_name_is_one_of_the_same_kind() {
        for (name, other) in super::SYNONYMS {
            let kind = |label| harmony_catalogue::kind(label).map(|k| k.template.as_deref());
            assert!(kind(name).is_some() && kind(name) == kind(other), "{name}, {other}");
        }
    }
}
