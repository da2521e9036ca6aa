//! What can be set. `Default` is the paper's value wherever the paper gives one.

use harmony_placement::PlacementSettings;
use harmony_roles::MeshSettings;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Everything a run depends on beside the photo, the cast and the answers. Kept whole in `run.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Longest side of the photo, masks and renders the pipeline works with, pixels (256 to 2048).
    pub working_px: u32,
    /// Closed-form calibration from the point map; off: the layout answer's camera stands ("w/o camera calibration").
    pub camera_calibration: bool,
    /// Generated meshes are set upright by their level and plumb faces; off: by principal axes, as in the paper.
    pub upright_by_faces: bool,
    /// How often the language model is asked.
    pub questions: Questions,
    /// Which of the further questions of `questions = "paper"` are asked.
    pub looks: LookSettings,
    /// Review after each level ("w/o feedback loop" when 0): rounds at most; `questions = "paper"` makes it three.
    pub review_rounds: usize,
    /// Detection filters.
    pub filters: FilterSettings,
    /// Image-to-3D settings.
    pub mesh: MeshSettings,
    /// Modelling programs.
    pub programs: ProgramSettings,
    /// Placement switches.
    pub placement: PlacementSettings,
    /// Lighting.
    pub lighting: LightingSettings,
    /// Texture resolution of room surfaces, pixels a metre.
    pub surface_px_per_m: f64,
}

/// How often the language model is asked beside what every run needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Questions {
    /// One question a step and level: fronts, reviews and second looks once, and once the counts of each kind.
    #[default]
    Few,
    /// As often as the paper asks: decorations of each piece of furniture, hosts, fine turns, order of sets, reviews until
    /// nothing is kept.
    Paper,
}

/// What the language model looks at once more when it is asked as often as the paper asks, `counts` always; each can be left
/// out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[expect(clippy::struct_excessive_bools, reason = "independent switches")]
pub struct LookSettings {
    /// Decorations missing on each piece of furniture.
    pub missing: bool,
    /// Hosts in doubt.
    pub hosts: bool,
    /// Fine turns after the quarter turns, furniture and soft things among them.
    pub turns: bool,
    /// Order and members of matched sets.
    pub groups: bool,
    /// Counts of each kind after the last level.
    pub counts: bool,
    /// Another placement order where things stay in one another.
    pub reorder: bool,
    /// Mass and friction.
    pub physical: bool,
    /// Reviews until nothing more is kept, three rounds at most.
    pub rounds: bool,
}

impl Default for LookSettings {
    fn default() -> Self {
        Self {
            missing: true,
            hosts: true,
            turns: true,
            groups: true,
            counts: true,
            reorder: true,
            physical: true,
            rounds: true,
        }
    }
}

impl LookSettings {
    const NONE: Self = Self {
        missing: false,
        hosts: false,
        turns: false,
        groups: false,
        counts: false,
        reorder: false,
        physical: false,
        rounds: false,
    };
}

/// Rounds of review as the paper's loop goes.
const PAPER_ROUNDS: usize = 3;

impl Settings {
    /// The further questions that are asked: with `questions = "few"` only for the counts, one question a room that finds two
    /// thirds of what lists overlooked (`docs/decisions/0032-second-looks.md`).
    pub fn asked_looks(&self) -> LookSettings {
        match self.questions {
            Questions::Few => LookSettings { counts: self.looks.counts, ..LookSettings::NONE },
            Questions::Paper => self.looks,
        }
    }

    /// Rounds of review at most; none where reviews are switched off.
    pub fn rounds_of_review(&self) -> usize {
        let paper = self.review_rounds > 0 && self.asked_looks().rounds;
        if paper { self.review_rounds.max(PAPER_ROUNDS) } else { self.review_rounds }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            working_px: 1024,
            camera_calibration: true,
            upright_by_faces: true,
            questions: Questions::default(),
            looks: LookSettings::default(),
            review_rounds: 1,
            filters: FilterSettings::default(),
            mesh: MeshSettings::default(),
            programs: ProgramSettings::default(),
            placement: PlacementSettings::default(),
            lighting: LightingSettings::default(),
            surface_px_per_m: 160.0,
        }
    }
}

/// Detection filters (paper App. C, "Containment and fragment removal").
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FilterSettings {
    /// Share of a box that another of equal or higher score must cover to drop it.
    pub box_containment: f64,
    /// IoU at which two masks of one type are one object.
    pub mask_iou: f64,
    /// IoU at which two masks of different types are one object by two names.
    pub same_object_iou: f64,
    /// Share of a mask inside another of its type at which it is a fragment of it.
    pub mask_containment: f64,
    /// Smallest mask kept, share of the image.
    pub min_area: f64,
    /// Most candidates of one level.
    pub max_candidates: usize,
}

impl Default for FilterSettings {
    fn default() -> Self {
        Self {
            box_containment: 0.85,
            mask_iou: 0.7,
            same_object_iou: 0.85,
            mask_containment: 0.9,
            min_area: 0.00005,
            max_candidates: 60,
        }
    }
}

/// Modelling programs, where no generator makes the meshes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ProgramSettings {
    /// Most objects of one level that programs are asked for, the largest in the photo first; 0: templates alone.
    pub most_objects: usize,
    /// Objects in one question.
    pub objects_per_question: usize,
    /// Smallest share of the photo that an object must have to be asked about.
    pub smallest_share: f64,
    /// Second looks at what was modelled, rounds at most.
    pub second_looks: usize,
    /// Objects in one second look.
    pub looks_per_question: usize,
}

impl Default for ProgramSettings {
    fn default() -> Self {
        Self {
            most_objects: 16,
            objects_per_question: 8,
            smallest_share: 0.0008,
            second_looks: 1,
            looks_per_question: 6,
        }
    }
}

/// Relighting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LightingSettings {
    /// Last looks at the whole lit scene, rounds at most.
    pub last_looks: usize,
    /// Rounds of the model's reflective loop at most, after what is measured.
    pub rounds: usize,
    /// Longest side of the per-light images that the light is fitted on, pixels.
    pub fit_px: u32,
    /// Samples a pixel of the per-light images.
    pub fit_samples: u32,
    /// Previews on which reflectances are measured again at most: light bounces otherwise once they have changed.
    pub measured_rounds: usize,
    /// Longest side of those previews, pixels.
    pub measured_px: u32,
    /// Longest side of previews that somebody looks at, pixels.
    pub preview_px: u32,
    /// Samples a pixel of previews.
    pub preview_samples: u32,
    /// Longest side of the final render, pixels.
    pub final_px: u32,
    /// Samples a pixel of the final render.
    pub final_samples: u32,
    /// Longest side of the lit canonical view, pixels; 0 leaves it out.
    pub canonical_px: u32,
    /// Samples a pixel of the lit canonical view.
    pub canonical_samples: u32,
}

impl Default for LightingSettings {
    fn default() -> Self {
        Self {
            last_looks: 1,
            rounds: 1,
            fit_px: 160,
            fit_samples: 64,
            measured_rounds: 2,
            measured_px: 240,
            preview_px: 480,
            preview_samples: 12,
            final_px: 960,
            final_samples: 16,
            canonical_px: 960,
            canonical_samples: 12,
        }
    }
}

impl Settings {
    /// Checks ranges.
    ///
    /// # Errors
    /// A sentence that names the field, its value and the allowed range.
    pub fn check(&self) -> Result<(), String> {
        let range = |name: &str, value: f64, low: f64, high: f64| {
            if value.is_finite() && (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(format!("{name} is {value}; allowed is {low} to {high}"))
            }
        };
        range("working_px", self.working_px.into(), 256.0, 2048.0)?;
        range("review_rounds", self.review_rounds as f64, 0.0, 5.0)?;
        range("surface_px_per_m", self.surface_px_per_m, 10.0, 1000.0)?;
        range("programs.most_objects", self.programs.most_objects as f64, 0.0, 60.0)?;
        range("programs.objects_per_question", self.programs.objects_per_question as f64, 1.0, 24.0)?;
        range("programs.smallest_share", self.programs.smallest_share, 0.0, 1.0)?;
        range("programs.second_looks", self.programs.second_looks as f64, 0.0, 2.0)?;
        range("programs.looks_per_question", self.programs.looks_per_question as f64, 1.0, 24.0)?;
        range("lighting.last_looks", self.lighting.last_looks as f64, 0.0, 3.0)?;
        range("lighting.rounds", self.lighting.rounds as f64, 0.0, 6.0)?;
        range("lighting.measured_rounds", self.lighting.measured_rounds as f64, 0.0, 6.0)?;
        range("lighting.fit_px", self.lighting.fit_px.into(), 32.0, 640.0)?;
        range("lighting.fit_samples", self.lighting.fit_samples.into(), 1.0, 4096.0)?;
        if self.lighting.canonical_px != 0 {
            range("lighting.canonical_px", self.lighting.canonical_px.into(), 64.0, 4096.0)?;
        }
        range("lighting.canonical_samples", self.lighting.canonical_samples.into(), 1.0, 16384.0)?;
        range("lighting.measured_px", self.lighting.measured_px.into(), 64.0, 2048.0)?;
        range("lighting.preview_px", self.lighting.preview_px.into(), 64.0, 2048.0)?;
        range("lighting.final_px", self.lighting.final_px.into(), 64.0, 4096.0)?;
        range("lighting.preview_samples", self.lighting.preview_samples.into(), 1.0, 4096.0)?;
        range("lighting.final_samples", self.lighting.final_samples.into(), 1.0, 16384.0)?;
        range("filters.box_containment", self.filters.box_containment, 0.3, 1.0)?;
        range("filters.mask_iou", self.filters.mask_iou, 0.1, 1.0)?;
        range("filters.same_object_iou", self.filters.same_object_iou, 0.3, 1.0)?;
        range("filters.mask_containment", self.filters.mask_containment, 0.3, 1.0)?;
        range("filters.min_area", self.filters.min_area, 0.0, 0.5)?;
        range("placement.max_rounds", self.placement.max_rounds as f64, 0.0, 100.0)?;
        range("placement.renders_per_object", self.placement.renders_per_object as f64, 0.0, 100_000.0)?;
        range("placement.window_px", self.placement.window_px.into(), 16.0, 2048.0)?;
        range("placement.noise.wall_clearance", self.placement.noise.wall_clearance, 0.0, 1.0)?;
        range("placement.noise.size", self.placement.noise.size, 0.001, 10.0)?;
        range("placement.noise.contact", self.placement.noise.contact, 0.0, 1.0)?;
        range("filters.max_candidates", self.filters.max_candidates as f64, 1.0, 200.0)
    }
}
