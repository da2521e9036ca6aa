//! How far off answers are, by rooms whose truth is known: an estimate of the sigmas and probabilities of
//! [`harmony_placement::Noise`].
//!
//! The answers are those that a run keeps in `calls/`; which object of the truth one speaks of, the judgement of the
//! finished run says. So any run of a known room will do: the oracle's (then the oracle's own noise comes back), or a
//! recording of a model that looked. What a run decides itself (outlines, contact) is not estimated here.
//!
//! Spreads are robust: 1.4826 times the median absolute deviation. Of a probability the estimate is `(wrong + 1) / (n + 2)`,
//! so that it is never 0.

use std::path::Path;

use harmony_geometry::{median, median_absolute_deviation};
use harmony_placement::Noise;
use harmony_prompts::{InspectAnswer, InspectedObject, LayoutAnswer};
use harmony_scene::{Level, Support, Wall, WallAffinity};

use crate::score::{ObjectScore, Prediction, ScoreOptions, score};
use crate::truth::{TruthObject, TruthRoom};

/// Fewer measurements than this are shown, but not proposed.
pub const ENOUGH: usize = 20;

/// One number of [`Noise`].
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Fitted {
    /// Its key below `placement.noise`.
    pub name: &'static str,
    /// What is in use.
    pub used: f64,
    /// What was found; `None` without a measurement.
    pub found: Option<f64>,
    /// Measurements.
    pub count: usize,
    /// What was measured.
    pub about: &'static str,
}

/// What runs say, one entry a measurement.
#[derive(Debug, Default)]
pub struct Measured {
    /// ln(named / true) of sides, by run.
    sizes: Vec<Vec<f64>>,
    /// ln(told / true) of the room's height.
    heights: Vec<f64>,
    /// Named turn minus true turn within half a quarter, radians.
    turns: Vec<f64>,
    /// Whether the named front is another side.
    wrong_turn: Vec<bool>,
    /// Whether the wall behind something on the floor is another one, of those that have a wall in both.
    wrong_wall: Vec<bool>,
    /// Whether something hangs on another wall.
    wrong_hung: Vec<bool>,
    /// Whether something stands on another host.
    wrong_host: Vec<bool>,
    /// Answers that belong to no object of the truth, or could not be read.
    unmatched: usize,
}

impl Measured {
    /// Adds a finished run of a room.
    ///
    /// # Errors
    /// A run without a scene.
    pub fn add(&mut self, truth: &TruthRoom, run: &Path) -> Result<(), crate::score::PredictionError> {
        let prediction = Prediction::load(run)?;
        let judged = score(truth, &prediction, ScoreOptions { align_scale: true, points: 0 });
        let answers = run.join("calls/vision_language");
        if let Some(layout) = read::<LayoutAnswer>(&answers.join("1_layout/layout/answer.json")) {
            self.heights.push((layout.room.ceiling_height_m / truth.extents.height).ln());
        }
        let mut sides = Vec::new();
        for said in inspected(&answers) {
            match truth_of(&judged.objects, truth, &said.id) {
                Some((scored, object)) => self.object(truth, &judged.objects, scored, object, &said, &mut sides),
                None => self.unmatched += 1,
            }
        }
        self.sizes.push(sides);
        Ok(())
    }

    fn object(
        &mut self,
        truth: &TruthRoom,
        all: &[ObjectScore],
        scored: &ObjectScore,
        object: &TruthObject,
        said: &InspectedObject,
        sides: &mut Vec<f64>,
    ) {
        let named = [said.size_m.width, said.size_m.height, said.size_m.depth];
        let thin = object.size.min_element() < 0.1 * object.size.max_element();
        for (named, real) in named.into_iter().zip(object.size.to_array()) {
            // The thickness of a picture is named by habit, and counts for nothing.
            let counts = !(thin && real == object.size.min_element());
            if counts && named > 0.0 && real > 0.0 {
                sides.push((named / real).ln());
            }
        }
        if scored.has_front
            && let Some(front) = said.front_deg
        {
            let off = turn_between(front.to_radians(), object.yaw);
            let other = off.abs() > std::f64::consts::FRAC_PI_4;
            self.wrong_turn.push(other);
            if !other {
                self.turns.push(off);
            }
        }
        match (object.level, &object.support) {
            (Level::Furniture, _) => {
                if let (Some(named), Some(real)) = (wall(said.wall_affinity), object.wall) {
                    self.wrong_wall.push(named != real);
                }
            }
            (Level::Wall, Support::Wall { wall }) => {
                if let Some(named) = said.wall {
                    self.wrong_hung.push(named != *wall);
                }
            }
            (Level::Decoration, Support::Object { id }) => {
                if let Some(host) = &said.on_top_of
                    && let Some((_, named)) = truth_of(all, truth, host)
                {
                    self.wrong_host.push(named.id != id.as_str());
                }
            }
            _ => {}
        }
    }

    /// Answers that belong to no object of the truth.
    pub fn unmatched(&self) -> usize {
        self.unmatched
    }

    /// What is in use beside what was found.
    pub fn fitted(&self, used: &Noise) -> Vec<Fitted> {
        let own: Vec<f64> = self.sizes.iter().filter_map(|v| median(v)).collect();
        let within: Vec<f64> = self
            .sizes
            .iter()
            .filter_map(|v| Some((v, median(v)?)))
            .flat_map(|(v, m)| v.iter().map(move |x| x - m))
            .collect();
        let line = |name, used, (found, count), about| Fitted { name, used, found, count, about };
        vec![
            line("size", used.size, spread(&within), "sides of objects, without what a run's sizes have in common"),
            line("size_common", used.size_common, spread(&own), "what a run's sizes have in common, one a run"),
            line("height", used.height, spread(&self.heights), "the room's height as it was told, one a run"),
            line("yaw_panel", used.yaw_panel, spread(&self.turns), "fronts on the right side, radians"),
            line("wrong_turn", used.wrong_turn, share(&self.wrong_turn), "fronts on another side"),
            line("wrong_wall", used.wrong_wall, share(&self.wrong_wall), "walls behind furniture"),
            line("wrong_hung", used.wrong_hung, share(&self.wrong_hung), "walls on which something hangs"),
            line("wrong_host", used.wrong_host, share(&self.wrong_host), "hosts of decorations"),
        ]
    }
}

/// The lines as a table, and which of them may be believed.
pub fn table(fitted: &[Fitted]) -> String {
    use std::fmt::Write as _;
    let mut out = format!("{:<12} {:>8} {:>8} {:>6}  measured on\n", "noise", "in use", "found", "n");
    for f in fitted {
        let found = f.found.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
        let few = if f.count < ENOUGH { " (too few to be proposed)" } else { "" };
        let _ = writeln!(out, "{:<12} {:>8.4} {found:>8} {:>6}  {}{few}", f.name, f.used, f.count, f.about);
    }
    out
}

/// The lines with enough measurements as a part of `harmony.toml`.
pub fn toml(fitted: &[Fitted]) -> String {
    use std::fmt::Write as _;
    let mut out =
        "# By `harmony bench fit`: what answers were off by on rooms with known truth.\n[placement.noise]\n".to_owned();
    for f in fitted.iter().filter(|f| f.count >= ENOUGH) {
        if let Some(found) = f.found {
            let _ = writeln!(out, "{} = {found:.4} # {} measurements: {}", f.name, f.count, f.about);
        }
    }
    out
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Option<T> {
    serde_json::from_slice(&std::fs::read(path).ok()?).ok()
}

/// All objects that were inspected, in the order of levels and parts.
fn inspected(answers: &Path) -> Vec<InspectedObject> {
    let folders = |path: &Path| {
        let mut all: Vec<_> = std::fs::read_dir(path).into_iter().flatten().flatten().map(|e| e.path()).collect();
        all.sort();
        all
    };
    folders(answers)
        .iter()
        .flat_map(|level| folders(level))
        .filter(|call| call.file_name().is_some_and(|n| n.to_string_lossy().starts_with("inspect")))
        .filter_map(|call| read::<InspectAnswer>(&call.join("answer.json")))
        .flat_map(|answer| answer.objects)
        .filter(|o| o.keep)
        .collect()
}

/// The object of the truth that an object of the run is.
fn truth_of<'a>(
    scores: &'a [ObjectScore],
    truth: &'a TruthRoom,
    id: &str,
) -> Option<(&'a ObjectScore, &'a TruthObject)> {
    let scored = scores.iter().find(|o| o.id == id)?;
    let real = scored.truth.as_deref()?;
    Some((scored, truth.objects.iter().find(|o| o.id == real)?))
}

fn wall(affinity: WallAffinity) -> Option<Wall> {
    match affinity {
        WallAffinity::Back => Some(Wall::Back),
        WallAffinity::Left => Some(Wall::Left),
        WallAffinity::Right => Some(Wall::Right),
        WallAffinity::Front => Some(Wall::Front),
        WallAffinity::Centre => None,
    }
}

/// Turn from `b` to `a`, -pi to pi.
fn turn_between(a: f64, b: f64) -> f64 {
    let d = a - b;
    d.sin().atan2(d.cos())
}

fn spread(values: &[f64]) -> (Option<f64>, usize) {
    let found = (values.len() > 1).then(|| median_absolute_deviation(values)).flatten().map(|(_, mad)| 1.4826 * mad);
    (found, values.len())
}

fn share(wrong: &[bool]) -> (Option<f64>, usize) {
    let n = wrong.len();
    let found = (n > 0).then(|| (wrong.iter().filter(|w| **w).count() + 1) as f64 / (n + 2) as f64);
    (found, n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_and_shares_of_known_numbers_come_back() {
        // Two runs whose sizes are 10 % too large and too small, each side off by a tenth more or less.
        let sides = |own: f64| (0..40).map(|k| own + if k % 2 == 0 { 0.1 } else { -0.1 }).collect::<Vec<_>>();
        let measured = Measured {
            sizes: vec![sides(0.1), sides(-0.1)],
            wrong_host: (0..98).map(|k| k < 9).collect(),
            ..Measured::default()
        };
        let fitted = measured.fitted(&Noise::default());
        let of = |name: &str| fitted.iter().find(|f| f.name == name).unwrap();
        assert!((of("size").found.unwrap() - 0.14826).abs() < 1e-9 && of("size").count == 80);
        assert!((of("size_common").found.unwrap() - 0.14826).abs() < 1e-9 && of("size_common").count == 2);
        assert!((of("wrong_host").found.unwrap() - 0.1).abs() < 1e-12);
        assert_eq!((of("height").found, of("height").count), (None, 0));
        let proposed = toml(&fitted);
        assert!(proposed.contains("size = 0.1483") && proposed.contains("wrong_host = 0.1000"));
        assert!(!proposed.contains("size_common"), "two runs are too few: {proposed}");
        assert!(table(&fitted).contains("too few"));
    }

    #[test]
    fn turns_are_the_shorter_way() {
        assert!((turn_between(3.1, -3.1) - (6.2 - std::f64::consts::TAU)).abs() < 1e-12);
        assert!((turn_between(0.3, 0.1) - 0.2).abs() < 1e-12);
    }
}
