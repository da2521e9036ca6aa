//! The safetensors format: eight bytes of header length, a JSON header, then raw tensors.

use std::collections::BTreeMap;
use std::sync::Arc;

use memmap2::Mmap;
use serde_json::Value;

use super::{Fault, Reader};
use crate::{DType, HostTensor};

/// Longest header that is read; the format's own limit.
const MAX_HEADER: u64 = 100_000_000;

pub(super) fn read(map: &Arc<Mmap>) -> Result<BTreeMap<String, HostTensor>, Fault> {
    let mut reader = Reader::new(map, 0);
    let length = reader.u64()?;
    let foreign = || Fault::malformed("neither safetensors nor a checkpoint of PyTorch");
    if length > MAX_HEADER || map.get(8) != Some(&b'{') {
        return Err(foreign());
    }
    let header = reader.take(length as usize)?;
    let header: Value = serde_json::from_slice(header)
        .map_err(|e| Fault::malformed(format!("the safetensors header is not JSON: {e}")))?;
    let header = header.as_object().ok_or_else(foreign)?;
    let data = reader.at;
    let mut tensors = BTreeMap::new();
    let mut used: Vec<(usize, usize, &str)> = Vec::new();
    for (key, entry) in header.iter().filter(|(key, _)| *key != "__metadata__") {
        let (dtype, shape, start, end) = entry_of(entry)
            .ok_or_else(|| Fault::malformed(format!("tensor {key} has no sound dtype, shape or data_offsets")))?;
        let dtype = dtype_of(dtype)
            .ok_or_else(|| Fault::malformed(format!("tensor {key} has the unsupported type {dtype:.16}")))?;
        let range = data.checked_add(start).zip(data.checked_add(end)).map(|(s, e)| s..e);
        let tensor = range.and_then(|range| HostTensor::new(map.clone(), range, shape.clone(), dtype));
        let tensor = tensor.ok_or_else(|| {
            Fault::malformed(format!(
                "tensor {key} of shape {shape:?} says bytes {start}..{end} of {} (cut off?)",
                map.len() - data
            ))
        })?;
        used.push((start, end, key));
        tensors.insert(key.clone(), tensor);
    }
    used.sort_unstable();
    if let Some(pair) = used.windows(2).find(|pair| pair[1].0 < pair[0].1) {
        return Err(Fault::malformed(format!("tensors {} and {} overlap", pair[0].2, pair[1].2)));
    }
    Ok(tensors)
}

fn entry_of(entry: &Value) -> Option<(&str, Vec<usize>, usize, usize)> {
    let number = |v: &Value| v.as_u64().and_then(|n| usize::try_from(n).ok());
    let shape = entry.get("shape")?.as_array()?.iter().map(number).collect::<Option<Vec<_>>>()?;
    let [start, end] = entry.get("data_offsets")?.as_array()?.as_slice() else { return None };
    Some((entry.get("dtype")?.as_str()?, shape, number(start)?, number(end)?))
}

fn dtype_of(name: &str) -> Option<DType> {
    Some(match name {
        "F64" => DType::F64,
        "F32" => DType::F32,
        "F16" => DType::F16,
        "BF16" => DType::BF16,
        "I64" => DType::I64,
        "I32" => DType::I32,
        "I16" => DType::I16,
        "I8" => DType::I8,
        "U8" => DType::U8,
        "BOOL" => DType::Bool,
        _ => return None,
    })
}
