//! The questions: prompt templates, answer types with their JSON Schemas, and sense checks.
//!
//! One module a question. Each has a struct with all that is asked about, an answer type, and [`Ask`]: the text, an
//! example and a check. [`Question`] is any of them: players that look are shown what it renders, players that compute
//! read its fields. Templates live in `templates/`, are versioned with the code and snapshot-tested; the paper's own wording
//! is followed where it prints one (`docs/paper-map.md` lists which). Where the paper asks for a bare array the answer
//! is wrapped in an object, for strict schemas demand one.
//!
//! Image positions in answers are relative: 0..1000 across and 0..1000 down, `[x, y]`.

mod counts;
mod groups;
mod hosts;
mod inspect;
mod last_look;
mod layout;
mod lighting;
mod list;
mod meshes;
mod missing;
mod physical;
mod programs;
mod question;
mod reorder;
mod review;
mod sizes;
mod subjects;
mod turns;

pub use counts::{CountedKind, CountsAnswer, CountsQuestion, MissingInstance};
pub use groups::{GroupSwap, GroupsAnswer, GroupsQuestion, MatchedSet, MissingMember};
pub use hosts::{HostedObject, HostsAnswer, HostsObject, HostsQuestion};
pub use inspect::{
    InspectAnswer, InspectCandidate, InspectQuestion, InspectedMaterial, InspectedObject, InspectedSize, Occlusion,
    WallReach,
};
pub use last_look::{
    AMBIENT, AddedObject, Difference, DifferenceKind, LastAction, LastActionKind, LastLookAnswer, LastLookQuestion,
    ListedLight, MAX_LAST_ACTIONS, PaintedObject,
};
pub use layout::{
    BackWallSide, Finish, FloorTexture, KnownDepth, LayoutAnswer, LayoutCamera, LayoutFeature, LayoutFeatureKind,
    LayoutOpening, LayoutOpeningKind, LayoutPart, LayoutPartKind, LayoutPattern, LayoutPatternKind, LayoutPin,
    LayoutQuestion, LayoutReach, LayoutRoom, LayoutSurface, LayoutTrim, LayoutTrims, LayoutWall, PinKind, SurfaceName,
    UnaidedRoom, WallTexture,
};
pub use lighting::{LightingReviewQuestion, LightsQuestion, SeenObject};
pub use list::{ListAnswer, ListQuestion, ListedInstance, ListedItem, RoomView};
pub use meshes::{
    CompletedAnswer, CompletedObject, CompletedQuestion, FrontPanel, FrontsAnswer, FrontsObject, FrontsQuestion,
    OrientQuestion,
};
pub use missing::{MissingAnswer, MissingDecoration, MissingQuestion, PresentDecoration};
pub use physical::{PhysicalAnswer, PhysicalItem, PhysicalLabel, PhysicalQuestion};
pub use programs::{
    LookVerdict, LookedAt, ModelledObject, ProgramObject, ProgramsAnswer, ProgramsQuestion, RoomFeature,
    SecondLookAnswer, SecondLookQuestion, ShownProgram, ToModel, WithoutProgram,
};
pub use question::{Ask, Question};
pub use reorder::{ReorderAnswer, ReorderHost, ReorderQuestion, ReorderSize};
pub use review::{ReviewActionAnswer, ReviewActionKind, ReviewAnswer, ReviewQuestion};
pub use sizes::{DoubtedSize, SizesAnswer, SizesObject, SizesQuestion};
pub use subjects::{FoundObject, KnownObject, NamedObject, PlacedObject, RoomSummary};
pub use turns::{TurnPanel, TurnedObject, TurnsAnswer, TurnsObject, TurnsQuestion};
