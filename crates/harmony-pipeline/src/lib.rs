//! The six phases, from a photo to a finished scene.
//!
//! A phase takes values and returns values ([`SceneState`]); what it asks of models goes through
//! [`harmony_calls::Calls`], whose records are the only memory of a run: running again recomputes what this program
//! computes, asks nobody twice, and ends in the same bytes (`docs/decisions/0002-records-are-the-state.md`).
//!
//! Start reading at [`run`].

mod before;
mod ctx;
mod estimate;
mod filter;
mod graph;
mod looks;
pub mod outputs;
mod phase;
mod phases;
mod progress;
mod relight;
mod run;
mod run_file;
mod run_folder;
mod settings;
mod state;
mod steps;
#[cfg(test)]
mod testing;
pub mod views;

pub use ctx::{PhaseCtx, PhaseError, Warnings};
pub use estimate::{Estimate, Inventory, RoleEstimate, estimate};
pub use filter::{Dropped, Filtered, filter_boxes, filter_masks};
pub use harmony_viewer::PlausibilityRow;
pub use looks::{Came, LookKind, Moved};
pub use outputs::GENERATOR;
pub use phase::Phase;
pub use phases::layout::layout_prior;
pub use progress::{ProgressEvent, ProgressSink};
pub use run::{Failure, RunError, RunOutcome, RunRequest, run};
pub use run_file::{JoinedRun, PhaseEntry, PhaseState, PhaseTime, RunFile, hash_files};
pub use run_folder::{LOCK_FILE, RunFolder, RunFolderError};
pub use settings::{FilterSettings, LightingSettings, LookSettings, ProgramSettings, Questions, Settings};
pub use state::{DropReason, Layout, Left, Look, Model, Object, SceneState};
pub use steps::programs::{Built, Program, built as program_mesh};
pub use steps::surfaces::{Beyond, panes};
