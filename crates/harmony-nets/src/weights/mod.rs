//! Weight files, memory-mapped: safetensors, and checkpoints of PyTorch (`.pt`, `.pth`, `.bin`), told apart by content.
//!
//! Nothing in a file is ever run: the pickle inside a checkpoint is read by an interpreter of our own that knows a few
//! harmless opcodes and names only. Every offset is checked against the file before use.
//!
//! A file that another process changes while it is mapped gives wrong values or ends the program by a signal, as with
//! any memory map; do not write to weights that are in use.

mod pickle;
mod safetensors;
mod torch;
mod zip;

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use memmap2::Mmap;

use crate::{DType, HostTensor, WeightError};

/// The named tensors of one file.
#[derive(Debug, Clone)]
pub struct WeightFile {
    path: PathBuf,
    tensors: BTreeMap<String, HostTensor>,
}

impl WeightFile {
    /// Maps a file and reads its table of contents. Tensors stay in the file until they are used.
    ///
    /// # Errors
    /// [`WeightError::Io`], [`WeightError::Malformed`], [`WeightError::Refused`].
    pub fn open(path: &Path) -> Result<Self, WeightError> {
        let io = |source| WeightError::Io { path: path.to_path_buf(), source };
        let file = File::open(path).map_err(io)?;
        if file.metadata().map_err(io)?.is_dir() {
            return Err(io(std::io::Error::new(std::io::ErrorKind::IsADirectory, "this is a folder")));
        }
        #[expect(unsafe_code, reason = "memory maps")]
        // SAFETY: the map is read-only and only ever seen as bytes; that nobody writes to the file is said above.
        let map = Arc::new(unsafe { Mmap::map(&file) }.map_err(io)?);
        let tensors = Self::parse(&map).map_err(|fault| match fault {
            Fault::Malformed(reason) => WeightError::Malformed { path: path.to_path_buf(), reason },
            Fault::Refused(reason) => WeightError::Refused { path: path.to_path_buf(), reason },
        })?;
        Ok(Self { path: path.to_path_buf(), tensors })
    }

    fn parse(map: &Arc<Mmap>) -> Result<BTreeMap<String, HostTensor>, Fault> {
        if map.len() < 16 {
            return Err(Fault::malformed(format!("only {} bytes long", map.len())));
        }
        if map.starts_with(b"PK\x03\x04") {
            torch::read_zip(map)
        } else if torch::is_legacy(map) {
            torch::read_legacy(map)
        } else {
            safetensors::read(map)
        }
    }

    /// Where it lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// All keys in order.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// A tensor, if the file has it.
    pub fn find(&self, key: &str) -> Option<&HostTensor> {
        self.tensors.get(key)
    }

    /// A tensor of floats that the network needs, with the shape that it needs.
    ///
    /// # Errors
    /// [`WeightError::MissingKey`], [`WeightError::WrongShape`], [`WeightError::WrongType`].
    pub fn get(&self, key: &str, wanted: &[usize]) -> Result<HostTensor, WeightError> {
        let Some(tensor) = self.tensors.get(key) else {
            return Err(WeightError::MissingKey {
                path: self.path.clone(),
                key: key.to_owned(),
                wanted: wanted.to_vec(),
                nearest: self.nearest(key).unwrap_or("none").to_owned(),
            });
        };
        if tensor.shape() != wanted {
            return Err(WeightError::WrongShape {
                path: self.path.clone(),
                key: key.to_owned(),
                wanted: wanted.to_vec(),
                found: tensor.shape().to_vec(),
            });
        }
        self.check_float(key, tensor.dtype())?;
        Ok(tensor.clone())
    }

    fn check_float(&self, key: &str, found: DType) -> Result<(), WeightError> {
        if found.is_float() {
            return Ok(());
        }
        Err(WeightError::WrongType { path: self.path.clone(), key: key.to_owned(), found })
    }

    /// The same tensors seen from below a prefix: `at("model")` finds `model.x` as `x`.
    pub fn at<'a>(&'a self, prefix: &str) -> Weights<'a> {
        Weights { file: self, prefix: prefix.to_owned() }
    }

    /// The key with the longest common end or beginning; what a person would look for.
    fn nearest(&self, key: &str) -> Option<&str> {
        let common = |other: &str| {
            let front = key.bytes().zip(other.bytes()).take_while(|(a, b)| a == b).count();
            let back = key.bytes().rev().zip(other.bytes().rev()).take_while(|(a, b)| a == b).count();
            front.max(back)
        };
        self.keys().max_by_key(|k| common(k)).filter(|k| common(k) > 2)
    }
}

/// A place in a weight file: keys are taken relative to a prefix.
#[derive(Debug, Clone)]
pub struct Weights<'a> {
    file: &'a WeightFile,
    prefix: String,
}

impl Weights<'_> {
    /// One level further down.
    #[must_use]
    pub fn at(&self, name: impl std::fmt::Display) -> Self {
        Self { file: self.file, prefix: self.key(&name.to_string()) }
    }

    /// The full key of a name here.
    pub fn key(&self, name: &str) -> String {
        if self.prefix.is_empty() { name.to_owned() } else { format!("{}.{name}", self.prefix) }
    }

    /// Whether the file has a tensor under this name.
    pub fn has(&self, name: &str) -> bool {
        self.file.find(&self.key(name)).is_some()
    }

    /// A tensor that the network needs; see [`WeightFile::get`].
    ///
    /// # Errors
    /// As [`WeightFile::get`].
    pub fn get(&self, name: &str, wanted: &[usize]) -> Result<HostTensor, WeightError> {
        self.file.get(&self.key(name), wanted)
    }

    /// The shape of a tensor, where a network's size is read from the file.
    ///
    /// # Errors
    /// [`WeightError::MissingKey`] (its wanted shape is empty).
    pub fn shape(&self, name: &str) -> Result<&[usize], WeightError> {
        let key = self.key(name);
        match self.file.find(&key) {
            Some(tensor) => Ok(tensor.shape()),
            None => Err(self.file.get(&key, &[]).err().unwrap_or_else(|| unreachable!("just looked for {key}"))),
        }
    }

    /// How many of `name.0`, `name.1`, ... there are keys below.
    pub fn length(&self, name: &str) -> usize {
        let list = self.key(name);
        (0..100_000).take_while(|i| self.file.any_below(&format!("{list}.{i}."))).count()
    }
}

impl WeightFile {
    fn any_below(&self, prefix: &str) -> bool {
        self.tensors.range(prefix.to_owned()..).next().is_some_and(|(k, _)| k.starts_with(prefix))
    }
}

/// What is wrong with a file, before its path is known.
#[derive(Debug)]
enum Fault {
    Malformed(String),
    Refused(String),
}

impl Fault {
    fn malformed(reason: impl Into<String>) -> Self {
        Self::Malformed(reason.into())
    }
}

/// Bytes read one after the other, never past the end.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], Fault> {
        let end = self.at.checked_add(n).filter(|end| *end <= self.bytes.len());
        let Some(end) = end else {
            let reason = format!("{n} bytes wanted at {}, the end is at {} (cut off?)", self.at, self.bytes.len());
            return Err(Fault::malformed(reason));
        };
        let part = &self.bytes[self.at..end];
        self.at = end;
        Ok(part)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    fn u8(&mut self) -> Result<u8, Fault> {
        Ok(self.array::<1>()?[0])
    }

    fn u16(&mut self) -> Result<u16, Fault> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn u64(&mut self) -> Result<u64, Fault> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn line(&mut self) -> Result<&'a str, Fault> {
        let rest = &self.bytes[self.at..];
        let n = rest.iter().position(|b| *b == b'\n').ok_or_else(|| Fault::malformed("a line without an end"))?;
        let text = self.take(n + 1)?;
        std::str::from_utf8(&text[..n]).map_err(|_| Fault::malformed("a name that is not UTF-8"))
    }
}
