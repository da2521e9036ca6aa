//! This program alone: what it can do without any model, said plainly.
//!
//! | role | method |
//! |---|---|
//! | `VisionLanguage` | rules over the fields of a question and the pixels of its pictures |
//! | `ImageEditor` | exemplar fill; symmetry for what is hidden of an object |
//! | `MeshGenerator` | part models: the one that came with the request, else a template |
//! | `GeometryEstimator` | no depth: vanishing points, as evidence for the room box |
//! | `Detector` | regions that differ from their surroundings, matched by place and shape |
//! | `Segmenter` | graph cut |
//! | `LitRenderer` | Blender Cycles if it is here; else none, and the flat render stands in |

mod answers;
mod detector;
mod editor;
mod geometry;
mod language;
mod lit;
mod mesh;
mod segmenter;

use std::sync::Arc;

use harmony_calls::Cast;
use harmony_roles::{PlayerCard, RoleError};

pub use detector::{BoxesWithLists, RegionDetector};
pub use editor::ExemplarEditor;
pub use geometry::VanishingPoints;
pub use language::Rules;
pub use lit::{CyclesLit, NoLit, forget_path_tracer, path_tracer};
pub use mesh::PartModels;
pub use segmenter::GraphCut;

/// Name of all of these players.
pub(crate) const OFFLINE: &str = "offline";

/// The cast that is always there. Looks for Blender once a process, which may take a second.
pub fn offline_cast() -> Cast {
    match path_tracer() {
        Some(cycles) => Cast { lit_renderer: Arc::new(cycles), ..flat_cast() },
        None => flat_cast(),
    }
}

/// The same without a path tracer, for runs that draw flat only: no program is looked for.
pub fn flat_cast() -> Cast {
    Cast {
        vision_language: Arc::new(Rules),
        image_editor: Arc::new(ExemplarEditor),
        mesh_generator: Arc::new(PartModels),
        geometry_estimator: Arc::new(VanishingPoints),
        detector: Arc::new(RegionDetector),
        segmenter: Arc::new(GraphCut::default()),
        lit_renderer: Arc::new(NoLit),
    }
}

fn card(model: &str) -> PlayerCard {
    PlayerCard { player: OFFLINE.to_owned(), model: model.to_owned(), offline: true, concurrency: 0 }
}

fn not_capable(reason: impl Into<String>) -> RoleError {
    RoleError::NotCapable { player: OFFLINE.to_owned(), reason: reason.into() }
}

/// Runs what computes beside the asynchronous work.
async fn computed<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, RoleError> {
    tokio::task::spawn_blocking(work).await.map_err(|error| not_capable(format!("the computation broke off: {error}")))
}
