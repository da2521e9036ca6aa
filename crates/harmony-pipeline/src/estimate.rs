//! What a run would take before it is made: calls by role, money, minutes. An estimate, and it says from what.

use std::collections::BTreeMap;
use std::path::Path;

use harmony_calls::{CallSummary, Cast, Prices, Source};
use harmony_prompts::InspectAnswer;
use harmony_roles::{PlayerCard, Role, Usage};
use harmony_scene::Level;
use serde::Serialize;

use crate::settings::ProgramSettings;
use crate::steps::inspect;

/// Objects of a typical room: the means of the rooms whose recordings are in `examples/` (six photos of living rooms,
/// bedrooms, a dining room and an office), rounded.
const TYPICAL: [f64; 4] = [3.0, 7.0, 0.0, 6.0];

/// Share of the objects of each level that others hide in part, in the same recordings.
const HIDDEN: [f64; 4] = [0.15, 0.6, 0.0, 0.05];

/// Share of completed pictures that are drawn a second time.
const DRAWN_AGAIN: f64 = 0.25;

/// How many objects there are and what has to be done with them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inventory {
    /// Objects by level, in placement order.
    pub objects: [f64; 4],
    /// Of these, partly hidden: they are completed.
    pub hidden: [f64; 4],
    /// Different ones among them: identical objects are completed and meshed once.
    pub different: [f64; 4],
    /// Where these numbers come from, in words.
    pub source: String,
}

impl Inventory {
    /// The typical room, or one with so many objects in its proportions.
    pub fn typical(objects: Option<usize>) -> Self {
        let total: f64 = TYPICAL.iter().sum();
        let factor = objects.map_or(1.0, |n| n as f64 / total);
        let counts = TYPICAL.map(|n| n * factor);
        let hidden = [0, 1, 2, 3].map(|i| counts[i] * HIDDEN[i]);
        let source = match objects {
            None => format!("a typical room of {total:.0} objects (mean of six recorded rooms)"),
            Some(n) => format!("{n} objects in the proportions of six recorded rooms"),
        };
        Self { objects: counts, hidden, different: counts, source }
    }

    /// What the inspections of a run folder kept; `None` when it has none.
    pub fn of_run(run: &Path) -> Option<Self> {
        let folder = run.join("calls").join(Role::VisionLanguage.folder());
        let (mut objects, mut hidden, mut different) = ([0.0; 4], [0.0; 4], [0.0; 4]);
        let mut levels = Vec::new();
        for (i, level) in Level::ALL.into_iter().enumerate() {
            let answers: Vec<InspectAnswer> = (1..=20)
                .map(|part| if part == 1 { "inspect".to_owned() } else { format!("inspect_{part}") })
                .map_while(|name| {
                    harmony_io::read_json(&folder.join(level.folder()).join(name).join("answer.json")).ok()
                })
                .collect();
            if answers.is_empty() {
                continue;
            }
            levels.push(level.stage());
            let kept: Vec<_> = answers.into_iter().flat_map(|a| a.objects).filter(|o| o.keep).collect();
            let sets: std::collections::BTreeSet<String> =
                kept.iter().map(|o| o.matched_set.clone().unwrap_or_else(|| format!("\n{}", o.id))).collect();
            objects[i] = kept.len() as f64;
            different[i] = sets.len() as f64;
            hidden[i] = kept.iter().filter(|o| o.occlusion != harmony_prompts::Occlusion::None).count() as f64;
        }
        if levels.is_empty() {
            return None;
        }
        let source = format!("the inspections in this run folder ({})", levels.join(", "));
        Some(Self { objects, hidden, different, source })
    }

    fn total(values: [f64; 4]) -> f64 {
        values.iter().sum()
    }
}

/// What one role is expected to do.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RoleEstimate {
    /// Role.
    pub role: Role,
    /// Who plays.
    pub card: PlayerCard,
    /// Calls.
    pub calls: f64,
    /// Input and output tokens.
    pub tokens: (f64, f64),
    /// US dollars; `None` when the price is not known. Zero for this program's own work.
    pub usd: Option<f64>,
    /// Seconds of one call.
    pub seconds_each: f64,
    /// Whether that was measured in this run folder.
    pub measured: bool,
}

/// The whole estimate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// What there is to do.
    pub inventory: Inventory,
    /// By role.
    pub roles: Vec<RoleEstimate>,
    /// Date of the prices.
    pub prices_date: String,
    /// Sum of the known costs, US dollars.
    pub usd: f64,
    /// Roles whose price is not known.
    pub unpriced: Vec<Role>,
    /// At least so long: the larger of the longest chain and the busiest player's work over its places, minutes.
    pub minutes_at_least: f64,
    /// One call after another, minutes.
    pub minutes_in_a_row: f64,
}

/// Seconds of a call of players outside, where nothing was measured: a reasoning model's answer, an image, a mesh on
/// one card (the latencies of `docs/performance.md`, "The wall clock").
fn usual_seconds(role: Role, card: &PlayerCard) -> f64 {
    if card.offline {
        return 0.0;
    }
    match role {
        Role::VisionLanguage => 8.0,
        Role::ImageEditor => 12.0,
        Role::MeshGenerator => 45.0,
        Role::GeometryEstimator => 5.0,
        Role::Detector | Role::Segmenter => 3.0,
        Role::LitRenderer => 30.0,
    }
}

/// Tokens of a question: prompt and pictures in, answer out. Prompts have 2 to 6 kB and pictures about a megapixel at
/// about a token for 750 pixels; an answer has some 120 tokens an object.
const QUESTION_IN: f64 = 4500.0;
const QUESTION_OUT: f64 = 300.0;
const OBJECT_OUT: f64 = 120.0;
/// Faces of a room that an image editor completes: the floor and the walls that a photo shows.
const FACES_COMPLETED: f64 = 3.0;
/// A program has some 40 lines; the guide that goes with the question is English with code.
const PROGRAM_OUT: f64 = 700.0;
const BYTES_A_TOKEN: f64 = 3.7;

/// Estimates a run. `log` holds calls that were made already (their times count more than the usual ones).
pub fn estimate(inventory: Inventory, cast: &Cast, lit: bool, prices: &Prices, log: &[CallSummary]) -> Estimate {
    let can = cast.can();
    let levels = 4.0;
    let busy = inventory.objects.iter().filter(|n| **n > 0.0).count() as f64;
    let all = Inventory::total(inventory.objects);
    let different = Inventory::total(inventory.different);
    // Of identical objects the one seen best is drawn.
    let drawn = if can.draws { Inventory::total(inventory.hidden).min(different) } else { 0.0 };
    let meshes = if can.makes_shapes { different } else { all };
    let fronts = if can.makes_shapes { different } else { 0.0 };
    let lit_rounds = if lit { 1.0 } else { 0.0 };
    // Programs, and second looks at what they made, where a model that sees writes shapes and no generator makes them.
    let looks = !cast.card(Role::VisionLanguage).offline;
    let settings = ProgramSettings::default();
    let written = if looks && !can.makes_shapes { all } else { 0.0 };
    let batches = |of: usize| inventory.objects.iter().map(|n| (n / of as f64).ceil()).sum::<f64>();
    let inspections = batches(inspect::CANDIDATES_PER_QUESTION);
    let programs = if written > 0.0 { batches(settings.objects_per_question) } else { 0.0 };
    let second_looks = if written > 0.0 { busy } else { 0.0 };
    let at_the_end = if looks { 2.0 } else { 0.0 };
    // layout; list; inspect; review; orient; lights and the rounds of light; checks of pictures and fronts; programs and
    // second looks; counts and the last look.
    let questions = 1.0 + levels + inspections + busy + 1.0 + 1.0 + lit_rounds + drawn + fronts;
    let questions = questions + programs + second_looks + at_the_end;
    let guide = harmony_program::GUIDE.len() as f64 / BYTES_A_TOKEN;
    let edits = if can.draws { drawn * (1.0 + DRAWN_AGAIN) + 1.0 + FACES_COMPLETED } else { 0.0 };
    let calls = |role: Role| match role {
        Role::VisionLanguage => questions,
        Role::ImageEditor => edits,
        Role::MeshGenerator => meshes,
        Role::GeometryEstimator => 1.0,
        Role::Detector => levels,
        Role::Segmenter => busy,
        Role::LitRenderer => {
            if lit {
                // Measurement, previews, final and canonical view.
                5.0 + lit_rounds
            } else {
                0.0
            }
        }
    };
    let measured = measured_seconds(log);
    let mut roles = Vec::new();
    for role in Role::ALL {
        let card = cast.card(role);
        let calls = calls(role);
        if calls <= 0.0 {
            continue;
        }
        let tokens = match role {
            Role::VisionLanguage => (
                QUESTION_IN * questions + guide * (programs + second_looks),
                QUESTION_OUT * questions + OBJECT_OUT * 2.0 * all + PROGRAM_OUT * written,
            ),
            _ => (0.0, 0.0),
        };
        let each = Usage {
            input_tokens: (tokens.0 / calls) as u64,
            output_tokens: (tokens.1 / calls) as u64,
            ..Usage::default()
        };
        let usd = if card.offline { Some(0.0) } else { prices.cost(role, &card, each).map(|one| one * calls) };
        let (seconds_each, known) = match measured.get(&role) {
            Some(seconds) if !card.offline => (*seconds, true),
            _ => (usual_seconds(role, &card), false),
        };
        roles.push(RoleEstimate { role, card, calls, tokens, usd, seconds_each, measured: known });
    }
    let seconds = |role: Role| roles.iter().find(|r| r.role == role).map_or(0.0, |r| r.seconds_each);
    let work = roles.iter().map(|r| r.calls * r.seconds_each / r.card.concurrency.max(1) as f64);
    // A role without a limit of its own is never the busiest.
    let busiest =
        work.zip(&roles).filter(|(_, r)| r.card.concurrency > 0).map(|(seconds, _)| seconds).fold(0.0, f64::max);
    let question = seconds(Role::VisionLanguage);
    let find = question + seconds(Role::Detector) + seconds(Role::Segmenter);
    let object = if can.draws && drawn > 0.0 { seconds(Role::ImageEditor) + question } else { 0.0 }
        + seconds(Role::MeshGenerator)
        + if can.makes_shapes { question } else { 0.0 };
    // Decorations wait for the furniture; without players outside every level waits for the one before.
    let rounds = if can.draws || can.makes_shapes { busy.min(2.0) } else { busy };
    let chain = seconds(Role::GeometryEstimator)
        + question
        + rounds * (find + question + object + question)
        + 2.0 * question
        + seconds(Role::LitRenderer) * calls(Role::LitRenderer);
    let in_a_row: f64 = roles.iter().map(|r| r.calls * r.seconds_each).sum();
    Estimate {
        prices_date: prices.date.clone(),
        usd: roles.iter().filter_map(|r| r.usd).sum(),
        unpriced: roles.iter().filter(|r| r.usd.is_none()).map(|r| r.role).collect(),
        minutes_at_least: chain.max(busiest) / 60.0,
        minutes_in_a_row: in_a_row / 60.0,
        inventory,
        roles,
    }
}

/// Mean time of the calls that somebody outside answered.
fn measured_seconds(log: &[CallSummary]) -> BTreeMap<Role, f64> {
    let mut sums: BTreeMap<Role, (f64, f64)> = BTreeMap::new();
    for call in log.iter().filter(|c| !c.offline && c.source == Source::Player) {
        let entry = sums.entry(call.role).or_default();
        *entry = (entry.0 + call.timing.latency_ms as f64 / 1000.0, entry.1 + 1.0);
    }
    sums.into_iter().map(|(role, (sum, n))| (role, sum / n)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_typical_room_scales_with_the_number_of_objects() {
        let room = Inventory::typical(Some(32));
        assert!((Inventory::total(room.objects) - 32.0).abs() < 1e-9);
        assert!(room.source.contains("32"));
        assert!((Inventory::total(Inventory::typical(None).objects) - 16.0).abs() < 1e-9);
    }

    #[test]
    fn a_run_folder_tells_its_own_inventory() {
        let run = tempfile::tempdir().unwrap();
        assert_eq!(Inventory::of_run(run.path()), None);
        let folder = run.path().join("calls/vision_language/3_furniture/inspect");
        std::fs::create_dir_all(&folder).unwrap();
        let mut answer = InspectAnswer::example();
        for i in 2..5 {
            let mut chair = answer.objects[0].clone();
            chair.id = format!("chair_{i:02}");
            chair.matched_set = Some("chairs".into());
            chair.occlusion = harmony_prompts::Occlusion::None;
            answer.objects.push(chair);
        }
        harmony_io::write_json(&folder.join("answer.json"), &answer).unwrap();
        let room = Inventory::of_run(run.path()).unwrap();
        assert_eq!(room.objects, [0.0, 4.0, 0.0, 0.0], "one of five is not kept");
        assert_eq!(room.different, [0.0, 2.0, 0.0, 0.0], "three chairs are one set");
        assert_eq!(room.hidden, [0.0, 1.0, 0.0, 0.0]);
    }
}
