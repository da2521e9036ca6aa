//! Checkpoints of PyTorch: the zip format (since 1.6) and the stream of pickles before it.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use memmap2::Mmap;

use super::pickle::{self, Node, Unpickled, Value};
use super::{Fault, Reader, zip};
use crate::{DType, HostTensor};

/// How deep dicts are looked into for tensors.
const MAX_DEPTH: usize = 8;
/// More tensors than any network has.
const MAX_TENSORS: usize = 1_000_000;
/// The number that a stream of pickles begins with, as pickled (protocol 2, LONG1 of ten bytes).
const LEGACY_MAGIC: [u8; 14] = [0x80, 0x02, 0x8a, 0x0a, 0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];

pub(super) fn is_legacy(bytes: &[u8]) -> bool {
    bytes.starts_with(&LEGACY_MAGIC)
}

/// Where each storage lies in the file.
type Storages = BTreeMap<String, Range<usize>>;

pub(super) fn read_zip(map: &Arc<Mmap>) -> Result<BTreeMap<String, HostTensor>, Fault> {
    let entries = zip::entries(map)?;
    let pickle = entries.iter().find(|(name, _)| name.ends_with("/data.pkl") || *name == "data.pkl");
    let (name, range) = pickle.ok_or_else(|| Fault::malformed("a zip archive without data.pkl"))?;
    let folder = name.strip_suffix("data.pkl").unwrap_or_default();
    if let Some(order) = entries.get(&format!("{folder}byteorder"))
        && &map[order.clone()] != b"little"
    {
        return Err(Fault::malformed("a checkpoint of a big-endian machine"));
    }
    let prefix = format!("{folder}data/");
    let storages = entries
        .iter()
        .filter_map(|(name, range)| Some((name.strip_prefix(&prefix)?.to_owned(), range.clone())))
        .collect();
    let unpickled = pickle::read(&map[range.clone()], 0)?;
    collect(map, &unpickled, &storages)
}

pub(super) fn read_legacy(map: &Arc<Mmap>) -> Result<BTreeMap<String, HostTensor>, Fault> {
    // Magic number, protocol version, facts about the machine, the object, the order of its storages.
    let mut at = 0;
    for _ in 0..3 {
        at = pickle::read(map, at)?.end;
    }
    let object = pickle::read(map, at)?;
    let keys = pickle::read(map, object.end)?;
    let Value::List(list) = keys.root else { return Err(Fault::malformed("no list of storages")) };
    let kinds = storage_kinds(&object);
    let mut reader = Reader::new(map, keys.end);
    let mut storages = Storages::new();
    for key in keys.items(list) {
        let Value::Text(key) = key else { return Err(Fault::malformed("a storage whose key is no text")) };
        let dtype = *kinds.get(&**key).ok_or_else(|| Fault::malformed(format!("nobody uses storage {key:?}")))?;
        let count = usize::try_from(reader.u64()?).ok().and_then(|n| n.checked_mul(dtype.size()));
        let start = reader.at;
        reader.take(count.ok_or_else(|| Fault::malformed(format!("storage {key:?} is too large")))?)?;
        storages.insert(key.to_string(), start..reader.at);
    }
    collect(map, &object, &storages)
}

fn storage_kinds(object: &Unpickled) -> BTreeMap<String, DType> {
    let mut kinds = BTreeMap::new();
    walk(object, &mut |_, arguments| {
        if let Some(Value::Storage { kind, key, .. }) = object.items(arguments).first()
            && let Some(dtype) = dtype_of(kind)
        {
            kinds.insert(key.to_string(), dtype);
        }
        Ok(())
    })
    .ok();
    kinds
}

fn collect(map: &Arc<Mmap>, object: &Unpickled, storages: &Storages) -> Result<BTreeMap<String, HostTensor>, Fault> {
    let mut tensors = BTreeMap::new();
    walk(object, &mut |key, arguments| {
        if tensors.len() >= MAX_TENSORS {
            return Err(Fault::malformed("too many tensors"));
        }
        let tensor = tensor_of(map, object.items(arguments), object, storages)
            .map_err(|reason| Fault::malformed(format!("tensor {key}: {reason}")))?;
        tensors.insert(key, tensor);
        Ok(())
    })?;
    if tensors.is_empty() {
        return Err(Fault::malformed("a checkpoint without tensors"));
    }
    Ok(tensors)
}

/// Visits every tensor below dicts; the keys of nested dicts are joined by dots.
fn walk(object: &Unpickled, visit: &mut dyn FnMut(String, Node) -> Result<(), Fault>) -> Result<(), Fault> {
    let mut open = vec![(String::new(), &object.root, 0usize)];
    let mut seen = 0usize;
    while let Some((key, value, depth)) = open.pop() {
        seen += 1;
        if seen > MAX_TENSORS * 4 {
            return Err(Fault::malformed("dicts that have no end"));
        }
        match value {
            Value::Tensor(arguments) => visit(key, *arguments)?,
            Value::Dict(node) if depth < MAX_DEPTH => {
                for pair in object.items(*node).as_chunks::<2>().0 {
                    let name = match &pair[0] {
                        Value::Text(name) => name.to_string(),
                        Value::Int(i) => i.to_string(),
                        _ => continue,
                    };
                    let full = if key.is_empty() { name } else { format!("{key}.{name}") };
                    open.push((full, &pair[1], depth + 1));
                }
            }
            _ => {}
        }
    }
    Ok(())
}

fn numbers(value: &Value, object: &Unpickled) -> Option<Vec<usize>> {
    let (Value::Tuple(node) | Value::List(node)) = value else { return None };
    object.items(*node).iter().map(|v| if let Value::Int(i) = v { usize::try_from(*i).ok() } else { None }).collect()
}

fn tensor_of(
    map: &Arc<Mmap>,
    arguments: &[Value],
    object: &Unpickled,
    storages: &Storages,
) -> Result<HostTensor, String> {
    let [Value::Storage { kind, key, count }, Value::Int(offset), size, stride, ..] = arguments else {
        return Err("not made of a storage, an offset, a size and strides".into());
    };
    let dtype = dtype_of(kind).ok_or_else(|| format!("unsupported {kind}"))?;
    let (shape, strides) =
        numbers(size, object).zip(numbers(stride, object)).ok_or("size or strides are not numbers")?;
    if shape.len() != strides.len() || shape.len() > 16 {
        return Err(format!("size {shape:?} and strides {strides:?}"));
    }
    let range = storages.get(&**key).ok_or_else(|| format!("its storage {key:?} is not in the file"))?;
    let held = range.len() / dtype.size();
    if usize::try_from(*count).ok().is_none_or(|count| count > held) {
        return Err(format!("its storage {key:?} should hold {count} elements and holds {held} (cut off?)"));
    }
    let offset = usize::try_from(*offset).map_err(|_| format!("offset {offset}"))?;
    let elements = shape.iter().try_fold(1usize, |n, d| n.checked_mul(*d)).ok_or("too many elements")?;
    let reach =
        shape.iter().zip(&strides).try_fold(offset, |at, (d, s)| at.checked_add(d.saturating_sub(1).checked_mul(*s)?));
    if elements > 0 && reach.is_none_or(|reach| reach >= held) {
        return Err(format!(
            "shape {shape:?}, strides {strides:?} from {offset} reach past the {held} elements stored"
        ));
    }
    if elements > held {
        return Err(format!("shape {shape:?} repeats elements, which weights do not"));
    }
    let size = dtype.size();
    if elements == 0 || contiguous(&shape, &strides) {
        let start = range.start + if elements == 0 { 0 } else { offset * size };
        return HostTensor::new(map.clone(), start..start + elements * size, shape, dtype)
            .ok_or_else(|| "outside the file".into());
    }
    let mut bytes = Vec::with_capacity(elements * size);
    let mut index = vec![0usize; shape.len()];
    for _ in 0..elements {
        let at: usize = offset + index.iter().zip(&strides).map(|(i, s)| i * s).sum::<usize>();
        bytes.extend_from_slice(&map[range.start + at * size..][..size]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            if index[axis] < shape[axis] {
                break;
            }
            index[axis] = 0;
        }
    }
    let all = 0..bytes.len();
    HostTensor::new(Arc::new(bytes), all, shape, dtype).ok_or_else(|| "outside the file".into())
}

fn contiguous(shape: &[usize], strides: &[usize]) -> bool {
    let mut wanted = 1;
    shape.iter().zip(strides).rev().all(|(d, s)| {
        let fits = *d == 1 || *s == wanted;
        wanted *= d;
        fits
    })
}

fn dtype_of(kind: &str) -> Option<DType> {
    Some(match kind {
        "torch.DoubleStorage" => DType::F64,
        "torch.FloatStorage" => DType::F32,
        "torch.HalfStorage" => DType::F16,
        "torch.BFloat16Storage" => DType::BF16,
        "torch.LongStorage" => DType::I64,
        "torch.IntStorage" => DType::I32,
        "torch.ShortStorage" => DType::I16,
        "torch.CharStorage" => DType::I8,
        "torch.ByteStorage" => DType::U8,
        "torch.BoolStorage" => DType::Bool,
        _ => return None,
    })
}
