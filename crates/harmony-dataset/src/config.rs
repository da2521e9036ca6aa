//! `dataset.json`: what the data set is, and who made its parts.

use std::collections::BTreeMap;
use std::path::Path;

use harmony_io::{read_json, write_json};
use serde::{Deserialize, Serialize};

use crate::DatasetError;
use crate::layout::DATASET;

/// Somebody, or something, whose work is in the scenes: a mesh generator, a network, a library of textures.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Maker {
    /// Licence of what it made, by its SPDX name or in words.
    pub licence: String,
    /// Where that is written.
    pub url: String,
    /// Whether that licence lets its output be published.
    pub redistributable: bool,
    /// Anything else that must be said.
    #[serde(default)]
    pub note: String,
}

/// Shares of the training, validation and test lists; they add to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Folds {
    /// For training.
    pub train: f64,
    /// For choosing.
    pub val: f64,
    /// For testing.
    pub test: f64,
}

impl Default for Folds {
    fn default() -> Self {
        Self { train: 0.8, val: 0.1, test: 0.1 }
    }
}

/// `dataset.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Format of this file.
    pub format: u32,
    /// Name: letters, digits, `-`, `_`, `.`.
    pub name: String,
    /// Version, such as `1.0.0`.
    pub version: String,
    /// One paragraph.
    pub description: String,
    /// Licence of the data set as a whole, by its SPDX name.
    pub licence: String,
    /// Where it is published.
    #[serde(default)]
    pub url: String,
    /// Date of publication, `YYYY-MM-DD`; the program never asks the clock.
    #[serde(default)]
    pub date_published: String,
    /// Authors.
    #[serde(default)]
    pub creators: Vec<String>,
    /// How to cite it.
    #[serde(default)]
    pub cite_as: String,
    /// Shares of the lists for training.
    #[serde(default)]
    pub folds: Folds,
    /// Scenes in a shard.
    #[serde(default = "shard_size")]
    pub scenes_per_shard: usize,
    /// Makers by the names that `provenance.json` of the scenes uses.
    #[serde(default)]
    pub makers: BTreeMap<String, Maker>,
}

fn shard_size() -> usize {
    50
}

/// Version of `dataset.json`.
pub const FORMAT: u32 = 1;

impl Config {
    /// A new data set. What this program makes by itself is known.
    pub fn new(name: &str, licence: &str) -> Self {
        let own = Maker {
            licence: "MIT OR Apache-2.0".to_owned(),
            url: "https://spdx.org/licenses/MIT.html".to_owned(),
            redistributable: true,
            note: "templates and rules of HARMONY itself; the program claims nothing of what it makes".to_owned(),
        };
        let cycles = Maker {
            licence: "GPL-3.0-or-later".to_owned(),
            url: "https://www.blender.org/about/license/".to_owned(),
            redistributable: true,
            note: "the licence is Blender's own; what is rendered with it belongs to who rendered it".to_owned(),
        };
        Self {
            format: FORMAT,
            name: name.to_owned(),
            version: "0.1.0".to_owned(),
            description: String::new(),
            licence: licence.to_owned(),
            url: String::new(),
            date_published: String::new(),
            creators: Vec::new(),
            cite_as: String::new(),
            folds: Folds::default(),
            scenes_per_shard: shard_size(),
            makers: BTreeMap::from([("offline".to_owned(), own), ("cycles".to_owned(), cycles)]),
        }
    }

    /// Reads a working folder's or a release's `dataset.json`.
    ///
    /// # Errors
    /// [`DatasetError::NoDataset`], or a file that is not what it should be.
    pub fn load(root: &Path) -> Result<Self, DatasetError> {
        let path = root.join(DATASET);
        if !path.is_file() {
            return Err(DatasetError::NoDataset(root.to_owned()));
        }
        let config: Self = read_json(&path)?;
        let refuse = |what, value: &str, why| Err(DatasetError::Value { what, value: value.to_owned(), why });
        if config.format != FORMAT {
            return refuse("the format of dataset.json", &config.format.to_string(), "this program reads 1");
        }
        let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.".contains(&b);
        if config.name.is_empty() || config.name.len() > 96 || !config.name.bytes().all(plain) {
            return refuse("the name in dataset.json", &config.name, "letters, digits, -, _ and . are allowed");
        }
        let f = config.folds;
        let shares = [f.train, f.val, f.test];
        if shares.iter().any(|s| !(0.0..=1.0).contains(s)) || (shares.iter().sum::<f64>() - 1.0).abs() > 1e-6 {
            return refuse("the folds in dataset.json", &format!("{shares:?}"), "three shares that add to 1");
        }
        if !(1..=10_000).contains(&config.scenes_per_shard) {
            return refuse("scenes_per_shard", &config.scenes_per_shard.to_string(), "1 to 10000");
        }
        Ok(config)
    }

    /// Writes it.
    ///
    /// # Errors
    /// An unwritable folder.
    pub fn save(&self, root: &Path) -> Result<(), DatasetError> {
        Ok(write_json(&root.join(DATASET), self)?)
    }
}
