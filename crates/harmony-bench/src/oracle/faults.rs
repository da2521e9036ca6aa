//! What there was for second looks to find, and what of it they found: whether that mended anything is for the scene to tell.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::PoisonError;

use harmony_pipeline::LookKind;
use serde::{Deserialize, Serialize};

use super::Oracle;

/// File in a run folder that keeps them.
const FILE: &str = "faults.json";

/// Faults by the look that is there for them, each in words and once.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Faults(BTreeMap<LookKind, OfLook>);

#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
struct OfLook {
    there: BTreeSet<String>,
    found: BTreeSet<String>,
}

impl Faults {
    /// How many faults a look was shown, and how many of them it named.
    pub fn of(&self, look: LookKind) -> [usize; 2] {
        self.0.get(&look).map_or([0, 0], |faults| [faults.there.len(), faults.found.len()])
    }

    /// Writes them into a run folder.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn write(&self, run: &Path) -> Result<(), String> {
        harmony_io::atomic::write_json(&run.join(FILE), self).map_err(|e| e.to_string())
    }

    /// Those of a run folder; none where nobody counted.
    pub fn read(run: &Path) -> Self {
        harmony_io::read_json(&run.join(FILE)).unwrap_or_default()
    }
}

impl Oracle {
    /// A fault that a look is shown: whether it is noticed.
    pub(super) fn finds(&self, look: LookKind, fault: &str) -> bool {
        let found = self.draws.happens(fault, self.noise.noticed);
        self.shown(look, fault, found);
        found
    }

    /// A fault that a look is shown, and whether it is noticed.
    pub(super) fn shown(&self, look: LookKind, fault: &str, found: bool) {
        let mut faults = self.faults.lock().unwrap_or_else(PoisonError::into_inner);
        let of_look = faults.0.entry(look).or_default();
        of_look.there.insert(fault.to_owned());
        if found {
            of_look.found.insert(fault.to_owned());
        }
    }
}
