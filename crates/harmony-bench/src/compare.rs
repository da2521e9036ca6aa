//! Two results side by side.

use std::collections::BTreeMap;
use std::fmt::Write;

use crate::run::BenchResult;
use crate::score::{ObjectScore, RoomScore};
use crate::summary::{Figure, find, number, summary};

/// An object's position counts as worse from here on, metres.
pub const WORSE_M: f64 = 0.05;
/// Figures that differ by less than this share count as equal.
const EQUAL: f64 = 1e-6;

/// Whether a change is for the better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Better.
    Better,
    /// Worse.
    Worse,
    /// No difference.
    Equal,
    /// One side has no such figure.
    Unknown,
}

impl Verdict {
    /// In a word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "WORSE",
            Self::Equal => "equal",
            Self::Unknown => "-",
        }
    }
}

/// A figure of both.
#[derive(Debug, Clone, PartialEq)]
pub struct FigureChange {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Before and after.
    pub values: [f64; 2],
    /// 90th percentile before and after, where there is a distribution.
    pub p90: Option<[f64; 2]>,
    /// Of the values.
    pub verdict: Verdict,
}

/// A room of both.
#[derive(Debug, Clone, PartialEq)]
pub struct RoomChange {
    /// Room and seed.
    pub case: String,
    /// Median error of position before and after, metres.
    pub position_m: [f64; 2],
}

/// An object of both, by its id in the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectChange {
    /// Room and seed.
    pub case: String,
    /// Id in the truth.
    pub object: String,
    /// Error of position before and after, metres; NaN after when it is no longer found.
    pub position_m: [f64; 2],
}

/// What differs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Comparison {
    /// All figures.
    pub figures: Vec<FigureChange>,
    /// Rooms that are in both.
    pub rooms: Vec<RoomChange>,
    /// Objects that got worse by more than [`WORSE_M`], or are no longer found, worst first.
    pub worse: Vec<ObjectChange>,
    /// Number of objects that got better by more than [`WORSE_M`], or are found now.
    pub better: usize,
    /// Cases that only one of them has.
    pub unpaired: Vec<String>,
}

/// Compares results: `before` and `after`, metres as delivered, or scale-aligned.
pub fn compare(before: &BenchResult, after: &BenchResult, aligned: bool) -> Comparison {
    let pick = |r: &'_ BenchResult| if aligned { r.aligned.clone() } else { r.raw.clone() };
    let (a, b) = (pick(before), pick(after));
    let mut out = Comparison { figures: figures(&summary(&a), &summary(&b)), ..Comparison::default() };
    // Files of older versions know no seeds.
    let seeds = a.iter().chain(&b).all(|r| r.seed.is_some());
    let (mut first, second) = (by_case(&a, seeds), by_case(&b, seeds));
    for (case, new) in &second {
        let Some(old) = first.remove(case) else {
            out.unpaired.push(case.clone());
            continue;
        };
        out.rooms.push(RoomChange { case: case.clone(), position_m: [old.median_position(), new.median_position()] });
        objects(case, old, new, &mut out);
    }
    out.unpaired.extend(first.into_keys());
    out.worse.sort_by(|a, b| change(b).total_cmp(&change(a)).then_with(|| a.object.cmp(&b.object)));
    out
}

/// How much worse; an object that is lost comes first.
fn change(o: &ObjectChange) -> f64 {
    let difference = o.position_m[1] - o.position_m[0];
    if difference.is_nan() { f64::INFINITY } else { difference }
}

/// Rooms by room and seed; without seeds the n-th run of a room is the n-th.
fn by_case(rooms: &[RoomScore], seeds: bool) -> BTreeMap<String, &RoomScore> {
    let mut out: BTreeMap<String, &RoomScore> = BTreeMap::new();
    for r in rooms {
        let name = if seeds { r.case() } else { r.room.clone() };
        let mut case = name.clone();
        let mut again = 1;
        while out.contains_key(&case) {
            again += 1;
            case = format!("{name} ({again})");
        }
        out.insert(case, r);
    }
    out
}

fn figures(before: &[Figure], after: &[Figure]) -> Vec<FigureChange> {
    let mut out = Vec::new();
    for b in after {
        let Some(a) = find(before, &b.name) else { continue };
        let (old, new) = (a.value, b.value);
        let verdict = if !old.is_finite() || !new.is_finite() {
            Verdict::Unknown
        } else if (new - old).abs() <= EQUAL * old.abs().max(new.abs()) {
            Verdict::Equal
        } else if (new > old) == b.more_is_better {
            Verdict::Better
        } else {
            Verdict::Worse
        };
        out.push(FigureChange {
            name: b.name.clone(),
            unit: b.unit.clone(),
            values: [old, new],
            p90: a.p90.zip(b.p90).map(|(x, y)| [x, y]),
            verdict,
        });
    }
    out
}

fn objects(case: &str, old: &RoomScore, new: &RoomScore, out: &mut Comparison) {
    let of = |room: &'_ RoomScore| -> BTreeMap<String, f64> {
        let known = |o: &ObjectScore| Some((o.truth.clone()?, o.position_m));
        room.objects.iter().filter_map(known).collect()
    };
    let (before, after) = (of(old), of(new));
    for (object, was) in &before {
        let is = after.get(object).copied().unwrap_or(f64::NAN);
        if is.is_nan() || is - was > WORSE_M {
            out.worse.push(ObjectChange { case: case.to_owned(), object: object.clone(), position_m: [*was, is] });
        } else if was - is > WORSE_M {
            out.better += 1;
        }
    }
    out.better += after.keys().filter(|o| !before.contains_key(*o)).count();
}

/// The comparison for a terminal.
pub fn text(c: &Comparison) -> String {
    let mut out = format!(
        "{:<48} {:>9} {:>9} {:>9}  {:<4} {:<7} {:>9} {:>9}\n",
        "figure", "before", "after", "change", "unit", "", "p90", "p90"
    );
    let signed = |v: f64| if v.is_nan() { "-".to_owned() } else { format!("{v:+.3}") };
    for f in &c.figures {
        let [a, b] = f.values;
        let p90 = f.p90.map_or_else(|| [String::new(), String::new()], |p| p.map(number));
        let verdict = f.verdict.name();
        out.push_str(
            format!(
                "{:<48} {:>9} {:>9} {:>9}  {:<4} {verdict:<7} {:>9} {:>9}",
                f.name,
                number(a),
                number(b),
                signed(b - a),
                f.unit,
                p90[0],
                p90[1]
            )
            .trim_end(),
        );
        out.push('\n');
    }
    out.push_str("\nmedian error of position by room, m\n");
    let mut rooms: Vec<&RoomChange> = c.rooms.iter().collect();
    rooms.sort_by(|a, b| (b.position_m[1] - b.position_m[0]).total_cmp(&(a.position_m[1] - a.position_m[0])));
    for r in rooms {
        let [a, b] = r.position_m;
        let _ = writeln!(out, "  {:<28} {:>9} {:>9} {:>9}", r.case, number(a), number(b), signed(b - a));
    }
    let _ = write!(
        out,
        "\n{} objects worse by more than {WORSE_M} m or lost, {} better by as much or found\n",
        c.worse.len(),
        c.better
    );
    for o in &c.worse {
        let [a, b] = o.position_m;
        let after = if b.is_nan() { "lost".to_owned() } else { number(b) };
        let _ = writeln!(out, "  {:<28} {:<24} {:>9} {after:>9}", o.case, o.object, number(a));
    }
    if !c.unpaired.is_empty() {
        let _ = write!(out, "\nonly in one of them: {}\n", c.unpaired.join(", "));
    }
    out
}
