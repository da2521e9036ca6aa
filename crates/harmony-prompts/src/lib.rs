//! The questions: prompt templates, answer types with their JSON Schemas, and sense checks.
//!
//! One module a question. Each has a `Vars` struct (what the template is filled with), an answer type, an example and
//! a `check`. Templates live in `templates/`, are versioned with the code and snapshot-tested; the paper's own wording
//! is followed where it prints one (`docs/paper-map.md` lists which). Where the paper asks for a bare array the answer
//! is wrapped in an object, for strict schemas demand one.
//!
//! Image positions in answers are relative: 0..1000 across and 0..1000 down, `[x, y]`.

mod inspect;
mod last_look;
mod layout;
mod lighting;
mod list;
mod meshes;
mod programs;
mod question;
mod review;

pub use inspect::{InspectAnswer, InspectVars, InspectedMaterial, InspectedObject, InspectedSize, Occlusion, inspect};
pub use last_look::{
    Difference, DifferenceKind, LastAction, LastActionKind, LastLookAnswer, LastLookVars, MOST_LAST_ACTIONS, last_look,
};
pub use layout::{
    BackWallSide, FloorTexture, LayoutAnswer, LayoutCamera, LayoutOpening, LayoutPart, LayoutPartKind, LayoutPattern,
    LayoutPatternKind, LayoutPin, LayoutRoom, LayoutSurface, LayoutTrim, LayoutTrims, LayoutVars, LayoutWall, PinKind,
    SurfaceName, WallTexture, layout,
};
pub use lighting::{LightingReviewVars, LightsVars, lighting_review, lights};
pub use list::{ListAnswer, ListVars, ListedInstance, ListedItem, list};
pub use meshes::{
    CompletedAnswer, CompletedObject, CompletedVars, FrontPanel, FrontsAnswer, FrontsObject, FrontsVars, completed,
    fronts, orient,
};
pub use programs::{
    LookVerdict, LookedAt, ProgramObject, ProgramsAnswer, ProgramsVars, SecondLookAnswer, programs, second_look,
};
pub use question::{Question, QuestionKind, parse};
pub use review::{ReviewActionAnswer, ReviewActionKind, ReviewAnswer, ReviewVars, review};
