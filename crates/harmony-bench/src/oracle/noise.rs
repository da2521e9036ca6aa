//! How far the oracle's answers are off.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Named levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseLevel {
    /// Every answer is the truth; only the point map's scale and frame are unknown.
    Clean,
    /// As good as today's models.
    Real,
    /// About two to three times worse.
    Harsh,
}

impl std::str::FromStr for NoiseLevel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "clean" => Ok(Self::Clean),
            "real" => Ok(Self::Real),
            "harsh" => Ok(Self::Harsh),
            _ => Err(format!("noise {text:?} is unknown; levels are clean, real, harsh")),
        }
    }
}

/// Sizes of all errors. One sigma where an error is random and unbounded, a probability where it is a mistake.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Point map: smooth multiplicative depth error, rms.
    pub depth_smooth: f64,
    /// Its correlation length, share of the image's longer side.
    pub depth_length: f64,
    /// Independent multiplicative error of each pixel, rms.
    pub depth_pixel: f64,
    /// Width of the band along depth edges in which depths bleed into one another, point-map pixels.
    pub depth_bleed: f64,
    /// Focal length, relative.
    pub focal: f64,
    /// Edges of a box, share of its size.
    pub boxes: f64,
    /// Ragged border of a mask, pixels at most.
    pub mask_px: f64,
    /// Share of a mask's area in holes.
    pub holes: f64,
    /// Objects merged with a neighbour, and as many missed: half of this each.
    pub merged_or_missed: f64,
    /// Objects that neither list nor detector has, share of them: what second looks are for.
    #[serde(default)]
    pub overlooked: f64,
    /// Matched sets of which two members, seen one for the other, have each other's shape, size and front.
    #[serde(default)]
    pub swapped: f64,
    /// Levels whose placement order is at random.
    #[serde(default)]
    pub disordered: f64,
    /// Sizes named by the language model, relative, each side; part of it common to all three.
    pub size: f64,
    /// Height of the room, relative.
    pub height: f64,
    /// Width and depth of the room, relative.
    pub extent: f64,
    /// Pinned points of the layout answer, share of the image's longer side.
    pub pins: f64,
    /// Features of the room's shape that the layout answer does not tell of, share of them.
    #[serde(default)]
    pub features_untold: f64,
    /// There is no point map: calibration has the layout answer and the photo's lines, as without VGGT's weights.
    #[serde(default)]
    pub photo_alone: bool,
    /// Camera hints: height relative, tilt and yaw in units of 50 degrees.
    pub hints: f64,
    /// Directions of fronts, degrees, beside wrong quarter turns.
    pub front_deg: f64,
    /// Wrong quarter turns.
    pub turns: f64,
    /// Wrong relations or hosts.
    pub relations: f64,
    /// Kinds named by a synonym.
    pub synonyms: f64,
    /// Kinds listed twice, by two names.
    pub duplicates: f64,
    /// Tilt of generated meshes at most, degrees.
    pub tilt_deg: f64,
    /// Displacement of a generated mesh's unseen side, share of its size.
    pub back_side: f64,
    /// In a review: share of visible faults that are noticed; the rest passes.
    pub noticed: f64,
    /// In a review: proposals where nothing is wrong, share of objects.
    pub false_alarms: f64,
}

/// A mistake of the first answers that a second look is there for, made as often as one likes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    kind: FaultKind,
    share: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FaultKind {
    Overlooked,
    Relations,
    Turns,
    Swapped,
    Disordered,
}

impl FaultKind {
    const ALL: [(Self, &str); 5] = [
        (Self::Overlooked, "overlooked"),
        (Self::Relations, "relations"),
        (Self::Turns, "turns"),
        (Self::Swapped, "swapped"),
        (Self::Disordered, "disordered"),
    ];
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = FaultKind::ALL.iter().find(|(kind, _)| *kind == self.kind).map_or("", |(_, name)| name);
        write!(f, "{name}={}", self.share)
    }
}

impl std::str::FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = FaultKind::ALL.map(|(_, name)| name).join(", ");
        let known = |name: &str| FaultKind::ALL.iter().find(|(_, n)| *n == name).map(|(kind, _)| *kind);
        let parsed = text.split_once('=').and_then(|(name, share)| Some((known(name)?, share.parse::<f64>().ok()?)));
        match parsed {
            Some((kind, share)) if (0.0..=1.0).contains(&share) => Ok(Self { kind, share }),
            _ => Err(format!("give one of {names} and a share of 0 to 1, such as overlooked=0.1")),
        }
    }
}

impl Noise {
    /// The same with a fault made more or less often.
    #[must_use]
    pub fn with(mut self, fault: Fault) -> Self {
        let share = match fault.kind {
            FaultKind::Overlooked => &mut self.overlooked,
            FaultKind::Relations => &mut self.relations,
            FaultKind::Turns => &mut self.turns,
            FaultKind::Swapped => &mut self.swapped,
            FaultKind::Disordered => &mut self.disordered,
        };
        *share = fault.share;
        self
    }
}

impl NoiseLevel {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clean => "clean",
            Self::Real => "real",
            Self::Harsh => "harsh",
        }
    }

    /// Its errors.
    pub fn noise(self) -> Noise {
        let real = Noise {
            depth_smooth: 0.03,
            depth_length: 0.1,
            depth_pixel: 0.01,
            depth_bleed: 1.5,
            focal: 0.02,
            boxes: 0.02,
            mask_px: 2.0,
            holes: 0.01,
            merged_or_missed: 0.03,
            overlooked: 0.0,
            swapped: 0.0,
            disordered: 0.0,
            size: 0.15,
            height: 0.04,
            extent: 0.1,
            pins: 0.01,
            features_untold: 0.0,
            photo_alone: false,
            hints: 0.08,
            front_deg: 10.0,
            turns: 0.05,
            relations: 0.05,
            synonyms: 0.1,
            duplicates: 0.05,
            tilt_deg: 8.0,
            back_side: 0.04,
            noticed: 0.7,
            false_alarms: 0.03,
        };
        match self {
            Self::Real => real,
            Self::Clean => Noise {
                depth_smooth: 0.0,
                depth_pixel: 0.0,
                depth_bleed: 0.0,
                focal: 0.0,
                boxes: 0.0,
                mask_px: 0.0,
                holes: 0.0,
                merged_or_missed: 0.0,
                size: 0.0,
                height: 0.0,
                extent: 0.0,
                pins: 0.0,
                hints: 0.0,
                front_deg: 0.0,
                turns: 0.0,
                relations: 0.0,
                synonyms: 0.0,
                duplicates: 0.0,
                tilt_deg: 0.0,
                back_side: 0.0,
                noticed: 1.0,
                false_alarms: 0.0,
                ..real
            },
            Self::Harsh => Noise {
                depth_smooth: 0.08,
                depth_pixel: 0.03,
                depth_bleed: 3.0,
                focal: 0.06,
                boxes: 0.06,
                mask_px: 5.0,
                holes: 0.04,
                merged_or_missed: 0.1,
                size: 0.3,
                height: 0.1,
                extent: 0.2,
                pins: 0.03,
                hints: 0.2,
                front_deg: 20.0,
                turns: 0.15,
                relations: 0.15,
                synonyms: 0.25,
                duplicates: 0.15,
                tilt_deg: 15.0,
                back_side: 0.1,
                noticed: 0.5,
                false_alarms: 0.1,
                ..real
            },
        }
    }
}

/// Random numbers that depend on what they are for, not on the order in which they are drawn.
#[derive(Debug, Clone)]
pub struct Draws {
    seed: u64,
    room: String,
}

impl Draws {
    /// Draws for one room.
    pub fn new(seed: u64, room: &str) -> Self {
        Self { seed, room: room.to_owned() }
    }

    /// A generator for one purpose.
    pub fn rng(&self, purpose: &str) -> ChaCha8Rng {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.seed.to_le_bytes());
        hasher.update(self.room.as_bytes());
        hasher.update(&[0]);
        hasher.update(purpose.as_bytes());
        ChaCha8Rng::from_seed(*hasher.finalize().as_bytes())
    }

    /// One normal number for a purpose.
    pub fn normal(&self, purpose: &str) -> f64 {
        normal(&mut self.rng(purpose))
    }

    /// Whether something of a probability happens.
    pub fn happens(&self, purpose: &str, probability: f64) -> bool {
        self.rng(purpose).random::<f64>() < probability
    }
}

/// A standard normal number (Box and Muller).
pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let a: f64 = 1.0 - rng.random::<f64>();
    let b: f64 = rng.random::<f64>();
    (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// A smooth random field on a grid: unit variance; its correlation falls to about 1/e at `length` cells.
///
/// White noise on a lattice a little finer than that, interpolated by cubic B-splines and normalised.
pub fn smooth_field(rng: &mut ChaCha8Rng, width: usize, height: usize, length: f64) -> Vec<f32> {
    let cell = (length / 1.1).max(1.0);
    let (columns, rows) = ((width as f64 / cell) as usize + 4, (height as f64 / cell) as usize + 4);
    let lattice: Vec<f64> = (0..columns * rows).map(|_| normal(rng)).collect();
    let spline = |t: f64| {
        let u = 1.0 - t;
        [
            u * u * u / 6.0,
            (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
            (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0,
            t * t * t / 6.0,
        ]
    };
    let mut out = Vec::with_capacity(width * height);
    for y in 0..height {
        let gy = y as f64 / cell;
        let wy = spline(gy.fract());
        for x in 0..width {
            let gx = x as f64 / cell;
            let wx = spline(gx.fract());
            let mut v = 0.0;
            for (j, b) in wy.iter().enumerate() {
                for (i, a) in wx.iter().enumerate() {
                    v += a * b * lattice[(gy as usize + j) * columns + gx as usize + i];
                }
            }
            out.push(v);
        }
    }
    let rms = (out.iter().map(|v| v * v).sum::<f64>() / out.len().max(1) as f64).sqrt().max(1e-9);
    out.into_iter().map(|v| (v / rms) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_has_unit_variance_and_falls_off_over_its_length() {
        let draws = Draws::new(3, "room");
        let (w, h) = (400, 300);
        let field = smooth_field(&mut draws.rng("field"), w, h, 40.0);
        let mean_product = |shift: usize| {
            let mut sum = 0.0;
            let mut n = 0.0;
            for y in 0..h {
                for x in 0..w - shift {
                    sum += f64::from(field[y * w + x] * field[y * w + x + shift]);
                    n += 1.0;
                }
            }
            sum / n
        };
        assert!((mean_product(0) - 1.0).abs() < 1e-3);
        assert!(mean_product(5) > 0.9, "{}", mean_product(5));
        let far = mean_product(40);
        assert!((0.2..0.55).contains(&far), "{far}");
        assert!(mean_product(120).abs() < 0.3);
    }

    #[test]
    fn a_fault_is_read_from_its_name_and_share() {
        let fault: Fault = "swapped=0.25".parse().unwrap();
        assert_eq!(NoiseLevel::Real.noise().with(fault).swapped, 0.25);
        assert_eq!(fault.to_string(), "swapped=0.25");
        for wrong in ["swapped", "swapped=2", "moon=0.1", "=0.1"] {
            assert!(wrong.parse::<Fault>().unwrap_err().contains("overlooked"), "{wrong}");
        }
    }

    #[test]
    fn draws_depend_on_seed_room_and_purpose_alone() {
        let a = Draws::new(1, "a").normal("x");
        assert_eq!(a, Draws::new(1, "a").normal("x"));
        assert_ne!(a, Draws::new(2, "a").normal("x"));
        assert_ne!(a, Draws::new(1, "b").normal("x"));
        assert_ne!(a, Draws::new(1, "a").normal("y"));
    }
}
