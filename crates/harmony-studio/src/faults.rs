//! What goes wrong, and when: drawn by seed from the request's content and how often it came, so that a run's faults
//! do not depend on timing.

use serde::{Deserialize, Serialize};

/// What kind of service is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the roles")]
pub enum Part {
    Language,
    Editor,
    Mesh,
    HostedMesh,
    Detector,
}

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// 429 without a word on how long.
    RateLimited,
    /// 429 that says how long, in the service's way.
    RateLimitedWait,
    /// 429 that asks for an hour.
    RateLimitedLong,
    /// 429 (Gemini: 402) for an account that is used up.
    AccountSpent,
    /// 500.
    ServerError,
    /// 503 (Anthropic: 529).
    Overloaded,
    /// The connection is closed before a byte comes.
    Close,
    /// A reset in the middle of the body.
    Reset,
    /// Nothing comes.
    Silence,
    /// The body stops coming.
    Stall,
    /// The body comes slowly, but it comes.
    Slow,
    /// The connection is closed in the middle of the body.
    CutOff,
    /// The JSON (or file) ends in the middle, the protocol says it is whole.
    CutBody,
    /// A page of HTML with status 200.
    NotJson,
    /// A redirect to another host.
    Redirect,
    /// 200 MB.
    Huge,
    /// The model declines.
    Refusal,
    /// A filter stops question or answer.
    SafetyBlock,
    /// The answer ends at the token limit.
    CutAnswer,
    /// JSON that does not fit the schema that was sent.
    SchemaViolation,
    /// Names in other scripts, with emoji and marks of direction. Nothing is wrong with them.
    UnicodeNames,
    /// An image of another shape.
    WrongSize,
    /// Text where an image should be.
    NotAnImage,
    /// The first half of the GLB file.
    HalfGlb,
    /// A GLB file with five million faces.
    HugeMesh,
    /// Vertices that are no numbers.
    NanMesh,
    /// A GLB file without triangles.
    EmptyMesh,
    /// Boxes outside the picture, inverted, empty.
    BadBoxes,
    /// The first looks at a task fail and its file is cut off at first. Nothing is wrong with the task.
    BrokenLooks,
    /// A task that ends without a result.
    TaskFailed,
    /// A task that is declined for what the picture shows.
    TaskRefused,
    /// A task that is at work for ever.
    TaskStuck,
    /// The link to the file has ended when it is first given; where links end soon, the next look gives another.
    ExpiredLink,
}

use Fault as F;

impl Fault {
    /// All, in the order of tables.
    pub const ALL: [Self; 33] = [
        F::RateLimited,
        F::RateLimitedWait,
        F::RateLimitedLong,
        F::AccountSpent,
        F::ServerError,
        F::Overloaded,
        F::Close,
        F::Reset,
        F::Silence,
        F::Stall,
        F::Slow,
        F::CutOff,
        F::CutBody,
        F::NotJson,
        F::Redirect,
        F::Huge,
        F::Refusal,
        F::SafetyBlock,
        F::CutAnswer,
        F::SchemaViolation,
        F::UnicodeNames,
        F::WrongSize,
        F::NotAnImage,
        F::HalfGlb,
        F::HugeMesh,
        F::NanMesh,
        F::EmptyMesh,
        F::BadBoxes,
        F::BrokenLooks,
        F::TaskFailed,
        F::TaskRefused,
        F::TaskStuck,
        F::ExpiredLink,
    ];

    /// Whether it can befall a service of this part.
    pub fn befalls(self, part: Part) -> bool {
        match self {
            F::Refusal | F::SafetyBlock => matches!(part, Part::Language | Part::Editor),
            F::CutAnswer => matches!(part, Part::Language | Part::Detector),
            F::SchemaViolation | F::UnicodeNames => part == Part::Language,
            F::WrongSize | F::NotAnImage => part == Part::Editor,
            F::HalfGlb | F::HugeMesh | F::NanMesh | F::EmptyMesh => matches!(part, Part::Mesh | Part::HostedMesh),
            F::BrokenLooks | F::TaskFailed | F::TaskRefused | F::TaskStuck | F::ExpiredLink => part == Part::HostedMesh,
            F::BadBoxes => part == Part::Detector,
            F::AccountSpent | F::RateLimitedLong => matches!(part, Part::Language | Part::Editor | Part::HostedMesh),
            _ => true,
        }
    }

    /// How often it is drawn against the others; what takes long comes seldom.
    fn weight(self) -> u32 {
        match self {
            F::HugeMesh => 1,
            F::Huge | F::Silence | F::Stall | F::RateLimitedLong | F::AccountSpent | F::TaskStuck => 4,
            _ => 10,
        }
    }

    /// Whether the answer can be used all the same.
    pub fn is_harmless(self) -> bool {
        matches!(self, F::Slow | F::UnicodeNames | F::BrokenLooks)
    }

    /// Its name in tables.
    pub fn name(self) -> String {
        serde_json::to_value(self).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
    }
}

/// Which faults a run has.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FaultPlan {
    /// Seed.
    pub seed: u64,
    /// Share of requests that go wrong, 0 to 1.
    pub share: f64,
    /// A part that always goes wrong in one way.
    pub always: Option<(Part, Fault)>,
    /// Only these, when any are named.
    pub only: Vec<Fault>,
}

/// A number from 0 to 1 of texts.
pub fn drawn(seed: u64, purpose: &str, content: &[u8]) -> f64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&seed.to_le_bytes());
    hasher.update(purpose.as_bytes());
    hasher.update(content);
    let bytes = hasher.finalize();
    let mut first = [0; 8];
    first.copy_from_slice(&bytes.as_bytes()[..8]);
    (u64::from_le_bytes(first) >> 11) as f64 / (1_u64 << 53) as f64
}

impl FaultPlan {
    /// What befalls a request, by its content and how often it came before.
    pub fn fault(&self, part: Part, content: &[u8], before: usize) -> Option<Fault> {
        if let Some((_, fault)) = self.always.filter(|(p, _)| *p == part) {
            return Some(fault);
        }
        let purpose = format!("{part:?} {before}");
        if drawn(self.seed, &format!("whether {purpose}"), content) >= self.share {
            return None;
        }
        let all: Vec<Fault> = Fault::ALL
            .into_iter()
            .filter(|fault| fault.befalls(part) && (self.only.is_empty() || self.only.contains(fault)))
            .collect();
        let total: u32 = all.iter().map(|fault| fault.weight()).sum();
        let mut at = drawn(self.seed, &format!("which {purpose}"), content) * f64::from(total);
        for fault in all {
            at -= f64::from(fault.weight());
            if at < 0.0 {
                return Some(fault);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_drawn_by_content_alone_and_as_often_as_said() {
        let plan = FaultPlan { seed: 5, share: 0.3, ..FaultPlan::default() };
        let draw = |i: u32| plan.fault(Part::Mesh, &i.to_le_bytes(), 0);
        let first: Vec<Option<Fault>> = (0..4000).map(draw).collect();
        assert_eq!(first, (0..4000).map(draw).collect::<Vec<_>>());
        let hit = first.iter().flatten().count();
        assert!((1100..1300).contains(&hit), "{hit}");
        assert!(first.iter().flatten().all(|fault| fault.befalls(Part::Mesh)));
        let kinds: std::collections::BTreeSet<_> = first.iter().flatten().collect();
        let possible = Fault::ALL.iter().filter(|fault| fault.befalls(Part::Mesh)).count();
        assert_eq!(kinds.len(), possible, "every fault occurs");
    }
}
