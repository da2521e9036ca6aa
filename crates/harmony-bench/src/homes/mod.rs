//! Homes with known truth: floor plans from a seed, each room furnished, photographed and reconstructed by the oracle, then
//! built into one home and judged in the home's frame.

mod bench;
mod files;
mod judge;
mod plan;

pub use bench::{HomesError, HomesRequest, folder, reconstruct, run_of};
pub use files::{TruthHome, write};
pub use judge::{HomeScore, judge, table};
pub use plan::{HomePlan, PlannedRoom, plan};

use serde::{Deserialize, Serialize};

/// By which rooms found their places.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlacedBy {
    /// A layout that was given; which run is which of its rooms is found out.
    Layout,
    /// The rooms' doors.
    Doors,
}

impl PlacedBy {
    /// In tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Layout => "layout",
            Self::Doors => "doors",
        }
    }
}
