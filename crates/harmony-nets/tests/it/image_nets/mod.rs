//! What the tests of networks share: seeded weights and pictures (the same as `tests/parity/seeded.py` makes), arrays from
//! PyTorch, comparison.

#![allow(dead_code, unused_imports, reason = "each test uses a part")]

mod seeded;

use std::path::{Path, PathBuf};

use harmony_nets::params::WeightSource;
use harmony_nets::{HostTensor, WeightError, WeightFile};

pub use seeded::{photo, uniform};

/// Weights that are made when they are asked for: by fan-in for matrices and filters, about one for norms.
pub struct Seeded {
    /// In front of every key before it is hashed.
    pub prefix: &'static str,
    /// Factor on matrices and filters, by key.
    pub gain: fn(&str) -> f32,
    /// Keys of positions, tokens and the like: values of up to one half.
    pub small: fn(&str) -> bool,
    /// Keys whose sign is dropped.
    pub positive: fn(&str) -> bool,
    /// Keys of values about one, like those of norms.
    pub about_one: fn(&str) -> bool,
}

impl Default for Seeded {
    fn default() -> Self {
        Self { prefix: "", gain: |_| 1.0, small: |_| false, positive: |_| false, about_one: |_| false }
    }
}

impl WeightSource for Seeded {
    fn tensor(&self, key: &str, shape: &[usize]) -> Result<HostTensor, WeightError> {
        let full = format!("{}{key}", self.prefix);
        let mut values = uniform(&full, shape.iter().product());
        let fan_in: usize = shape.iter().skip(1).product();
        let (centre, spread) = if (self.positive)(key) {
            for v in &mut values {
                *v = v.abs();
            }
            (0.0, 1.0)
        } else if (self.small)(key) {
            (0.0, 0.5)
        } else if shape.len() >= 2 {
            (0.0, (3.0 / fan_in as f64).sqrt() as f32 * (self.gain)(key))
        } else if key.ends_with(".weight") || (self.about_one)(key) {
            (1.0, 0.1)
        } else {
            (0.0, 0.1)
        };
        for v in &mut values {
            *v = centre + spread * *v;
        }
        Ok(HostTensor::from_f32(shape, values))
    }

    fn has(&self, key: &str) -> bool {
        // transformers' layout of CLIP.
        key != "visual.conv1.weight"
    }
}

/// A committed file.
pub fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/parity/data").join(name)
}

/// Arrays from PyTorch.
pub fn arrays(name: &str) -> WeightFile {
    WeightFile::open(&data(name)).expect("a committed file of arrays")
}

/// The values of one of them.
pub fn array(file: &WeightFile, key: &str) -> Vec<f32> {
    file.find(key).unwrap_or_else(|| panic!("no array {key}")).to_f32()
}

/// Largest difference over the largest magnitude that is wanted, with the place of the worst element.
pub fn worst(found: &[f32], wanted: &[f32]) -> (f64, usize) {
    assert_eq!(found.len(), wanted.len(), "numbers of values");
    let scale = wanted.iter().fold(0f64, |m, v| m.max(f64::from(v.abs())));
    let mut worst = (0.0, 0);
    for (i, (f, w)) in found.iter().zip(wanted).enumerate() {
        let off = (f64::from(*f) - f64::from(*w)).abs() / scale;
        // Not-a-number is worse than anything.
        if off.is_nan() || off > worst.0 {
            worst = (off, i);
        }
    }
    worst
}

/// Fails when an element is further off than `limit` of the largest magnitude.
#[track_caller]
pub fn close(what: &str, found: &[f32], wanted: &[f32], limit: f64) {
    let (off, at) = worst(found, wanted);
    assert!(off <= limit, "{what}: element {at} is {} instead of {}, {off:.2e} of the largest", found[at], wanted[at]);
}

/// Writes a safetensors file of zeros.
pub fn write_zeros(path: &Path, tensors: &[(&str, &[usize])]) {
    let mut header = serde_json::Map::new();
    let mut end = 0usize;
    for (key, shape) in tensors {
        let start = end;
        end += 4 * shape.iter().product::<usize>();
        let entry = serde_json::json!({"dtype": "F32", "shape": shape, "data_offsets": [start, end]});
        header.insert((*key).to_owned(), entry);
    }
    let header = serde_json::to_vec(&header).expect("a header");
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header);
    bytes.resize(bytes.len() + end, 0);
    std::fs::write(path, bytes).expect("written");
}
