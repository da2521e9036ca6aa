//! Weights by hash, as the Python scripts beside the parity arrays make them, and the comparison of outputs.
#![allow(clippy::unwrap_used, reason = "tests")]
#![allow(dead_code, reason = "each test uses its part")]

use std::io::Write;
use std::path::Path;

use serde_json::{Map, Value, json};

const SEED: u32 = 2026;

/// CRC-32 (IEEE), bit by bit.
pub fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    })
}

/// `u` in -1..1 by a hash of key and index; see `make_vggt.py`.
pub fn uniform(key: &str, count: usize) -> Vec<f32> {
    let base = crc32(key.as_bytes()) ^ SEED;
    (0..count as u32)
        .map(|i| {
            let mut x = i.wrapping_mul(2_654_435_761).wrapping_add(base);
            x ^= x >> 16;
            x = x.wrapping_mul(0x7feb_352d);
            x ^= x >> 15;
            x = x.wrapping_mul(0x846c_a68b);
            x ^= x >> 16;
            (x >> 8) as f32 * 2f32.powi(-23) - 1.0
        })
        .collect()
}

fn value(key: &str, shape: &[usize]) -> Vec<f32> {
    let mut u = uniform(key, shape.iter().product());
    let (offset, factor) = if key.ends_with("gamma") {
        (0.2, 0.1)
    } else if key.ends_with("bias") {
        (0.0, 0.1)
    } else if key.ends_with("weight") && shape.len() == 1 {
        (1.0, 0.2)
    } else if key.ends_with("weight") {
        let transposed = key.contains(".resize_layers.0.") || key.contains(".resize_layers.1.");
        let inputs: usize = if transposed { shape[0] } else { shape[1..].iter().product() };
        (0.0, (3.0 / inputs as f64).sqrt() as f32)
    } else {
        (0.0, 0.5)
    };
    for v in &mut u {
        *v = offset + factor * *v;
    }
    u
}

/// A safetensors file of the tensors whose keys and shapes stand in a JSON file, filled by hash.
pub fn hashed_weights(keys: &Path) -> tempfile::NamedTempFile {
    let keys: Map<String, Value> = serde_json::from_slice(&std::fs::read(keys).unwrap()).unwrap();
    let (mut header, mut data) = (Map::new(), Vec::<u8>::new());
    for (key, shape) in &keys {
        let sizes: Vec<usize> = shape.as_array().unwrap().iter().map(|d| d.as_u64().unwrap() as usize).collect();
        let start = data.len();
        data.extend(value(key, &sizes).iter().flat_map(|v| v.to_le_bytes()));
        header.insert(key.clone(), json!({"dtype": "F32", "shape": shape, "data_offsets": [start, data.len()]}));
    }
    let header = serde_json::to_vec(&header).unwrap();
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(&(header.len() as u64).to_le_bytes()).unwrap();
    file.write_all(&header).unwrap();
    file.write_all(&data).unwrap();
    file
}

/// The worst element's difference, relative to itself or, for small elements, to the root mean square of all.
pub fn compare(wanted: &[f32], found: &[f32]) -> f64 {
    assert_eq!(wanted.len(), found.len());
    let rms = (wanted.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / wanted.len() as f64).sqrt();
    let error = |(w, f): (&f32, &f32)| f64::from(w - f).abs() / f64::from(w.abs()).max(rms);
    // NaN is the worst of all.
    wanted.iter().zip(found).map(error).fold(0.0, |a, b| if b <= a { a } else { b })
}
