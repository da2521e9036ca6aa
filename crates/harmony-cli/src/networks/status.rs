//! What there is of networks on this machine: devices, weights, expected times; for `harmony doctor`.

use std::path::PathBuf;

use harmony_models::{FileState, Model, ModelError, Store, table};
use serde::Serialize;

/// Devices, weights, expected times.
#[derive(Debug, Serialize)]
pub struct Status {
    /// Why this build has no networks, if it has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absent: Option<&'static str>,
    /// What networks could run on, in the order of trying.
    pub devices: Vec<Device>,
    /// The models folder.
    pub folder: PathBuf,
    /// Models of which there is something.
    pub weights: Vec<Weights>,
    /// What the parts of a run are expected to take on the best device.
    pub expected: Vec<Expected>,
}

/// A device.
#[derive(Debug, Serialize)]
pub struct Device {
    /// Its name and what else is known of it.
    pub name: String,
    /// Operations a second of a matrix product, measured now.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub operations_per_s: Option<f64>,
    /// Why it cannot be used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

/// Weights of a model.
#[derive(Debug, Serialize)]
pub struct Weights {
    /// The model's name.
    pub model: &'static str,
    /// Their state, in words.
    pub state: String,
}

/// An estimate: operations by the speed of products; real times are longer.
#[derive(Debug, Serialize)]
pub struct Expected {
    /// The model's name.
    pub model: &'static str,
    /// What is done.
    pub work: &'static str,
    /// Seconds.
    pub seconds: f64,
    /// Whether its weights are here.
    pub here: bool,
}

impl Status {
    /// For people.
    pub fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> = self.absent.iter().map(|why| (*why).to_owned()).collect();
        lines.extend(self.devices.iter().map(|device| match (&device.problem, device.operations_per_s) {
            (Some(problem), _) => format!("{}: {problem}", device.name),
            (None, Some(speed)) => format!("{}: products at {:.0} GFLOP/s (measured now)", device.name, speed / 1e9),
            (None, None) => device.name.clone(),
        }));
        lines.push(format!("models folder: {}", self.folder.display()));
        lines.extend(self.weights.iter().map(|w| format!("{:<18} {}", w.model, w.state)));
        if self.weights.is_empty() {
            lines.push("no weights there: `harmony models list`, `harmony models pull NAME`".to_owned());
        }
        if !self.expected.is_empty() {
            lines.push(
                "expected times (an ESTIMATE: operations divided by the speed of products above; real ones are longer):"
                    .to_owned(),
            );
        }
        lines.extend(self.expected.iter().map(|e| {
            let mark = if e.here { "" } else { "  (weights not here)" };
            format!("{:<18} {}: {}{mark}", e.model, e.work, seconds(e.seconds))
        }));
        lines
    }
}

fn seconds(s: f64) -> String {
    if s < 1.0 { format!("{:.0} ms", s * 1e3) } else { format!("{s:.1} s") }
}

/// Which models are there.
pub fn weights(store: &Store) -> Vec<Weights> {
    let state = |model: &Model| state_words(store, model).unwrap_or_else(|error| Some(error.to_string()));
    table::MODELS.iter().filter_map(|model| Some(Weights { model: model.id, state: state(model)? })).collect()
}

fn state_words(store: &Store, model: &Model) -> Result<Option<String>, ModelError> {
    let (mut day, mut here, mut bad) = (None, 0, None);
    for file in model.files {
        match store.state(model, file)? {
            FileState::Missing { .. } => {}
            FileState::WrongSize { wanted, found } => {
                (here, bad) = (here + 1, Some(format!("{} has {found} bytes, wanted {wanted}", file.name)));
            }
            FileState::Unchecked => (here, bad) = (here + 1, bad.or_else(|| Some("not checked yet".to_owned()))),
            FileState::Verified(known) => (here, day) = (here + 1, Some(known.day())),
        }
    }
    let licence = if store.check_licence(model).is_err() { ", licence not accepted" } else { "" };
    Ok(match (here, bad, day) {
        (0, ..) => None,
        (n, ..) if n < model.files.len() => Some("in part: harmony models pull".to_owned()),
        (_, Some(bad), _) => Some(format!("{bad}: harmony models verify{licence}")),
        (_, None, day) => Some(format!("verified {}{licence}", day.unwrap_or_default())),
    })
}
