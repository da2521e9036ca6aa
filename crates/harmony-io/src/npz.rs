//! NumPy's `.npy` and `.npz` files, within limits.
//!
//! Format: NumPy enhancement proposal 1 (format version 1.0 to 3.0). Only plain arrays of numbers, truth values and
//! fixed-width text are read; pickled objects are refused.

use std::collections::BTreeMap;
use std::io::{Cursor, Read, Write};
use std::path::Path;

use crate::atomic::{FileError, read_bounded, write_atomic};

/// Largest file that is read, bytes.
pub const MAX_FILE_BYTES: u64 = 1 << 30;
/// Most elements of one array.
pub const MAX_ELEMENTS: usize = 64_000_000;
/// Longest header that is read, bytes.
const MAX_HEADER: usize = 65_536;

/// An array in C order (the last index runs fastest), whatever order the file has.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Array {
    /// Length along each axis; empty for a single number.
    pub shape: Vec<usize>,
    /// Values; every number type that is read fits.
    pub values: Vec<f64>,
    /// Whether the file's type is an integer type.
    pub integer: bool,
    /// The text, when the array is text (then `values` is empty).
    pub text: Option<String>,
}

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NpzError {
    /// The file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// Not a zip archive, or a broken one.
    #[error("not a readable .npz archive: {0}")]
    Archive(#[from] zip::result::ZipError),
    /// The array's header is broken.
    #[error("array {name}: the .npy header is broken ({what})")]
    Header {
        /// Array.
        name: String,
        /// What is missing or wrong.
        what: &'static str,
    },
    /// The element type is not read.
    #[error("array {name}: elements of type {descr} are not read")]
    Type {
        /// Array.
        name: String,
        /// NumPy's type code.
        descr: String,
    },
    /// The array is larger than what is read.
    #[error("array {name}: more than {limit} elements")]
    TooLarge {
        /// Array.
        name: String,
        /// Most elements.
        limit: usize,
    },
    /// The data ends early.
    #[error("array {name}: {found} bytes of data, {needed} are needed")]
    Short {
        /// Array.
        name: String,
        /// Bytes there.
        found: usize,
        /// Bytes needed.
        needed: usize,
    },
}

impl Array {
    /// A float array.
    pub fn new(shape: Vec<usize>, values: Vec<f64>) -> Self {
        Self { shape, values, integer: false, text: None }
    }

    /// The array without axes of length 1 at the front, down to `rank` axes at the fewest.
    #[must_use]
    pub fn squeezed_to(mut self, rank: usize) -> Self {
        while self.shape.len() > rank && self.shape.first() == Some(&1) {
            self.shape.remove(0);
        }
        self
    }

    /// The `index`-th part along the first axis.
    pub fn part(&self, index: usize) -> Option<Self> {
        let (count, rest) = self.shape.split_first()?;
        if index >= *count {
            return None;
        }
        let n: usize = rest.iter().product();
        let values = self.values.get(index * n..(index + 1) * n)?.to_vec();
        Some(Self { shape: rest.to_vec(), values, integer: self.integer, text: None })
    }
}

/// Names of the arrays in an archive, sorted, with their uncompressed sizes in bytes.
///
/// # Errors
/// [`NpzError`].
pub fn list_npz(bytes: &[u8]) -> Result<BTreeMap<String, u64>, NpzError> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes))?;
    let mut names = BTreeMap::new();
    for i in 0..archive.len() {
        let file = archive.by_index_raw(i)?;
        if let Some(name) = file.name().strip_suffix(".npy") {
            names.insert(name.to_owned(), file.size());
        }
    }
    Ok(names)
}

/// Reads the arrays of an archive whose names pass `wanted`.
///
/// # Errors
/// [`NpzError`].
pub fn parse_npz(bytes: &[u8], wanted: impl Fn(&str) -> bool) -> Result<BTreeMap<String, Array>, NpzError> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes))?;
    let mut arrays = BTreeMap::new();
    for i in 0..archive.len() {
        let file = archive.by_index(i)?;
        let Some(name) = file.name().strip_suffix(".npy").map(str::to_owned) else { continue };
        if wanted(&name) {
            // The size in the archive may lie, so the reader is bounded by what the largest array can need.
            let limit = (MAX_ELEMENTS * 8 + MAX_HEADER) as u64;
            let mut data = Vec::new();
            file.take(limit).read_to_end(&mut data).map_err(zip::result::ZipError::Io)?;
            let array = parse_npy(&name, &data)?;
            arrays.insert(name, array);
        }
    }
    Ok(arrays)
}

/// Reads the arrays of a `.npz` file.
///
/// # Errors
/// [`NpzError`].
pub fn read_npz(path: &Path) -> Result<BTreeMap<String, Array>, NpzError> {
    parse_npz(&read_bounded(path, MAX_FILE_BYTES)?, |_| true)
}

/// Parses one `.npy` file; `name` is used in errors.
///
/// # Errors
/// [`NpzError`].
pub fn parse_npy(name: &str, bytes: &[u8]) -> Result<Array, NpzError> {
    let bad = |what| NpzError::Header { name: name.to_owned(), what };
    if !bytes.starts_with(b"\x93NUMPY") || bytes.len() < 12 {
        return Err(bad("no magic number"));
    }
    let (start, length) = if bytes[6] == 1 {
        (10, usize::from(u16::from_le_bytes([bytes[8], bytes[9]])))
    } else {
        (12, u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]) as usize)
    };
    if length > MAX_HEADER {
        return Err(bad("too long"));
    }
    let header = bytes.get(start..start + length).ok_or_else(|| bad("cut off"))?;
    let header = std::str::from_utf8(header).map_err(|_| bad("not text"))?;
    let descr = quoted_after(header, "descr").ok_or_else(|| bad("no plain descr"))?;
    let fortran = match word_after(header, "fortran_order") {
        Some(w) if w.starts_with("True") => true,
        Some(w) if w.starts_with("False") => false,
        _ => return Err(bad("no fortran_order")),
    };
    let shape = shape_after(header).ok_or_else(|| bad("no shape"))?;
    let count = shape
        .iter()
        .try_fold(1_usize, |n, k| n.checked_mul(*k))
        .filter(|n| *n <= MAX_ELEMENTS)
        .ok_or_else(|| NpzError::TooLarge { name: name.to_owned(), limit: MAX_ELEMENTS })?;
    let data = &bytes[start + length..];
    let unknown = || NpzError::Type { name: name.to_owned(), descr: descr.to_owned() };
    let (order, code) = descr.split_at_checked(1).ok_or_else(unknown)?;
    let big = match order {
        "<" | "|" => false,
        "=" => cfg!(target_endian = "big"),
        ">" => true,
        _ => return Err(unknown()),
    };
    let short = |needed| NpzError::Short { name: name.to_owned(), found: data.len(), needed };
    if let Some(width) = code.strip_prefix('U').and_then(|w| w.parse::<usize>().ok()) {
        let needed = count.checked_mul(width).and_then(|n| n.checked_mul(4)).ok_or_else(unknown)?;
        let data = data.get(..needed).ok_or_else(|| short(needed))?;
        let text = data
            .chunks_exact(4)
            .map(|c| [c[0], c[1], c[2], c[3]])
            .map(|c| if big { u32::from_be_bytes(c) } else { u32::from_le_bytes(c) })
            .take_while(|c| *c != 0)
            .filter_map(char::from_u32)
            .collect();
        return Ok(Array { shape, values: Vec::new(), integer: false, text: Some(text) });
    }
    let kind = number_kind(code).ok_or_else(unknown)?;
    let needed = count.checked_mul(kind.width()).ok_or_else(unknown)?;
    let data = data.get(..needed).ok_or_else(|| short(needed))?;
    let mut values: Vec<f64> = data
        .chunks_exact(kind.width())
        .map(|chunk| {
            let mut le = [0_u8; 8];
            le[..chunk.len()].copy_from_slice(chunk);
            if big {
                le[..chunk.len()].reverse();
            }
            kind.value(le)
        })
        .collect();
    if fortran && shape.len() > 1 {
        values = c_order(&shape, &values);
    }
    Ok(Array { shape, values, integer: !matches!(kind, Kind::F2 | Kind::F4 | Kind::F8), text: None })
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    F2,
    F4,
    F8,
    I1,
    I2,
    I4,
    I8,
    U1,
    U2,
    U4,
    U8,
}

fn number_kind(code: &str) -> Option<Kind> {
    Some(match code {
        "f2" => Kind::F2,
        "f4" => Kind::F4,
        "f8" => Kind::F8,
        "i1" => Kind::I1,
        "i2" => Kind::I2,
        "i4" => Kind::I4,
        "i8" => Kind::I8,
        "u1" | "b1" => Kind::U1,
        "u2" => Kind::U2,
        "u4" => Kind::U4,
        "u8" => Kind::U8,
        _ => return None,
    })
}

impl Kind {
    fn width(self) -> usize {
        match self {
            Self::I1 | Self::U1 => 1,
            Self::F2 | Self::I2 | Self::U2 => 2,
            Self::F4 | Self::I4 | Self::U4 => 4,
            Self::F8 | Self::I8 | Self::U8 => 8,
        }
    }

    fn value(self, le: [u8; 8]) -> f64 {
        let [a, b, c, d, ..] = le;
        match self {
            Self::F2 => half(u16::from_le_bytes([a, b])),
            Self::F4 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F8 => f64::from_le_bytes(le),
            Self::I1 => f64::from(a as i8),
            Self::I2 => f64::from(i16::from_le_bytes([a, b])),
            Self::I4 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::I8 => i64::from_le_bytes(le) as f64,
            Self::U1 => f64::from(a),
            Self::U2 => f64::from(u16::from_le_bytes([a, b])),
            Self::U4 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::U8 => u64::from_le_bytes(le) as f64,
        }
    }
}

/// IEEE 754 half precision.
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let exponent = i32::from(bits >> 10 & 0x1f);
    let fraction = f64::from(bits & 0x3ff) / 1024.0;
    sign * match exponent {
        0 => fraction * 2.0_f64.powi(-14),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        e => (1.0 + fraction) * 2.0_f64.powi(e - 15),
    }
}

fn after<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let at = header.find(&format!("'{key}'")).or_else(|| header.find(&format!("\"{key}\"")))?;
    header[at + key.len() + 2..].trim_start().strip_prefix(':').map(str::trim_start)
}

fn word_after<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    after(header, key)
}

fn quoted_after<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let rest = after(header, key)?;
    let quote = rest.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    rest[1..].split(quote).next()
}

fn shape_after(header: &str) -> Option<Vec<usize>> {
    let inner = after(header, "shape")?.strip_prefix('(')?.split(')').next()?;
    let parts = inner.split(',').map(str::trim).filter(|p| !p.is_empty());
    let shape: Option<Vec<usize>> = parts.map(|p| p.trim_end_matches('L').parse().ok()).collect();
    shape.filter(|s| s.len() <= 8)
}

/// From Fortran order (the first index runs fastest).
fn c_order(shape: &[usize], values: &[f64]) -> Vec<f64> {
    let mut stride = vec![1; shape.len()];
    for axis in 1..shape.len() {
        stride[axis] = stride[axis - 1] * shape[axis - 1];
    }
    let mut index = vec![0; shape.len()];
    let mut out = Vec::with_capacity(values.len());
    for _ in 0..values.len() {
        out.push(values[index.iter().zip(&stride).map(|(i, s)| i * s).sum::<usize>()]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            if index[axis] < shape[axis] {
                break;
            }
            index[axis] = 0;
        }
    }
    out
}

/// An array to be written.
#[derive(Debug, Clone)]
pub struct NpyEntry {
    name: String,
    header: String,
    data: Vec<u8>,
}

impl NpyEntry {
    fn with(name: &str, descr: &str, shape: &[usize], data: Vec<u8>) -> Self {
        let dims = match shape {
            [one] => format!("{one},"),
            all => all.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
        };
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({dims}), }}");
        Self { name: name.to_owned(), header, data }
    }

    /// 32-bit floats.
    pub fn f32(name: &str, shape: &[usize], values: impl IntoIterator<Item = f32>) -> Self {
        Self::with(name, "<f4", shape, values.into_iter().flat_map(f32::to_le_bytes).collect())
    }

    /// 64-bit floats.
    pub fn f64(name: &str, shape: &[usize], values: impl IntoIterator<Item = f64>) -> Self {
        Self::with(name, "<f8", shape, values.into_iter().flat_map(f64::to_le_bytes).collect())
    }

    /// One piece of text.
    pub fn text(name: &str, text: &str) -> Self {
        let data = text.chars().flat_map(|c| u32::from(c).to_le_bytes()).collect();
        Self::with(name, &format!("<U{}", text.chars().count().max(1)), &[], data)
    }

    fn bytes(&self) -> Vec<u8> {
        // The header is padded with blanks so that the data starts at a multiple of 64 bytes.
        let padded = (10 + self.header.len() + 1).div_ceil(64) * 64 - 10;
        let mut out = b"\x93NUMPY\x01\0".to_vec();
        out.extend((padded as u16).to_le_bytes());
        out.extend(self.header.as_bytes());
        out.resize(10 + padded - 1, b' ');
        out.push(b'\n');
        out.extend(&self.data);
        out
    }
}

/// Bytes of a compressed `.npz`; the same arrays give the same bytes.
///
/// # Errors
/// [`NpzError::Archive`].
pub fn npz_bytes(entries: &[NpyEntry]) -> Result<Vec<u8>, NpzError> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::FileOptions::default()
        .compression_method(zip::CompressionMethod::Deflated)
        // Depths are noise in most of their bits: trying harder gains less than one percent.
        .compression_level(Some(1))
        .last_modified_time(zip::DateTime::default());
    for entry in entries {
        archive.start_file(format!("{}.npy", entry.name), options)?;
        archive.write_all(&entry.bytes()).map_err(zip::result::ZipError::Io)?;
    }
    Ok(archive.finish()?.into_inner())
}

/// Writes a `.npz` file, atomically.
///
/// # Errors
/// [`NpzError`].
pub fn write_npz(path: &Path, entries: &[NpyEntry]) -> Result<(), NpzError> {
    Ok(write_atomic(path, &npz_bytes(entries)?)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        let mut out = b"\x93NUMPY\x01\0".to_vec();
        out.extend((header.len() as u16).to_le_bytes());
        out.extend(header.as_bytes());
        out.extend(data);
        out
    }

    #[test]
    fn number_types_and_orders_are_read() {
        // 2 x 3 in Fortran order, big-endian 16-bit: columns first.
        let data: Vec<u8> = [1_u16, 4, 2, 5, 3, 6].iter().flat_map(|v| v.to_be_bytes()).collect();
        let array =
            parse_npy("a", &npy("{'descr': '>u2', 'fortran_order': True, 'shape': (2, 3), }\n", &data)).unwrap();
        assert_eq!(array.values, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert!(array.integer);
        assert_eq!(array.part(1).unwrap().values, [4.0, 5.0, 6.0]);
        assert_eq!(array.part(2), None);
        // Half precision: 1.5, -2, the smallest subnormal, infinity (bit patterns from IEEE 754).
        let data: Vec<u8> = [0x3e00_u16, 0xc000, 0x0001, 0x7c00].iter().flat_map(|v| v.to_le_bytes()).collect();
        let array = parse_npy("h", &npy("{'descr': '<f2', 'fortran_order': False, 'shape': (4,), }", &data)).unwrap();
        assert_eq!(array.values, [1.5, -2.0, 5.960_464_477_539_063e-8, f64::INFINITY]);
    }

    #[test]
    fn hostile_arrays_are_refused_before_memory_is_taken() {
        let refused = [
            "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 99999999999, 9), }",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (60000000,), }",
            "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
            "{'descr': '', 'fortran_order': False, 'shape': (1,), }",
            "{'descr': '<U99999999999999999', 'fortran_order': False, 'shape': (), }",
            "{'descr': 'é', 'fortran_order': False, 'shape': (1,), }",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
            "{'descr': '<f8', 'shape': (1,), }",
            "((((((((((((((((((((((((((((((((((((((((((((((((((((",
        ];
        for header in refused {
            assert!(parse_npy("x", &npy(header, &[0; 16])).is_err(), "{header}");
        }
        assert!(parse_npy("x", b"\x93NUMPY\x01\0\xff\xff{").is_err());
        assert!(parse_npz(b"PK\x03\x04 not really", |_| true).is_err());
    }

    #[test]
    fn what_is_written_is_read_and_always_the_same() {
        let entries = [
            NpyEntry::f32("points", &[1, 2, 2], [1.0, f32::NAN, -3.5, 4.0]),
            NpyEntry::f64("k", &[], [0.5]),
            NpyEntry::text("kind", "relative"),
        ];
        let bytes = npz_bytes(&entries).unwrap();
        assert_eq!(bytes, npz_bytes(&entries).unwrap());
        let arrays = parse_npz(&bytes, |_| true).unwrap();
        assert_eq!(arrays["kind"].text.as_deref(), Some("relative"));
        assert_eq!(arrays["k"].values, [0.5]);
        assert_eq!(arrays["points"].shape, [1, 2, 2]);
        assert!(arrays["points"].values[1].is_nan());
        assert_eq!(arrays["points"].values[2], -3.5);
        assert_eq!(list_npz(&bytes).unwrap().len(), 3);
    }
}
