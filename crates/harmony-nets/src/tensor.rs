//! Element types, and tensors in host memory.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use half::{bf16, f16};

/// Element type of a tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names are the types")]
pub enum DType {
    F64,
    F32,
    F16,
    BF16,
    I64,
    I32,
    I16,
    I8,
    U8,
    Bool,
}

impl DType {
    /// Bytes an element.
    pub fn size(self) -> usize {
        match self {
            Self::F64 | Self::I64 => 8,
            Self::F32 | Self::I32 => 4,
            Self::F16 | Self::BF16 | Self::I16 => 2,
            Self::I8 | Self::U8 | Self::Bool => 1,
        }
    }

    /// Whether networks can compute with it.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F64 | Self::F32 | Self::F16 | Self::BF16)
    }
}

/// Bytes that stay where they are: a memory-mapped file or a vector.
pub trait ByteSource: Send + Sync {
    /// All bytes.
    fn bytes(&self) -> &[u8];
}

impl ByteSource for Vec<u8> {
    fn bytes(&self) -> &[u8] {
        self
    }
}

impl ByteSource for Vec<f32> {
    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(self)
    }
}

impl ByteSource for memmap2::Mmap {
    fn bytes(&self) -> &[u8] {
        self
    }
}

/// A tensor in host memory: row-major, contiguous, little-endian; cheap to clone.
///
/// Weights are lent as these straight from the memory-mapped file, so that a backend may use the bytes in place.
#[derive(Clone)]
pub struct HostTensor {
    shape: Vec<usize>,
    dtype: DType,
    source: Arc<dyn ByteSource>,
    range: Range<usize>,
}

impl fmt::Debug for HostTensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "HostTensor({:?}, {:?})", self.dtype, self.shape)
    }
}

impl HostTensor {
    /// A tensor over `range` of `source`; `None` when the range is outside it or is not what the shape needs.
    pub fn new(source: Arc<dyn ByteSource>, range: Range<usize>, shape: Vec<usize>, dtype: DType) -> Option<Self> {
        let count = shape.iter().try_fold(1usize, |n, d| n.checked_mul(*d))?;
        let fits = range.start <= range.end && range.end <= source.bytes().len();
        (fits && count.checked_mul(dtype.size())? == range.len()).then_some(Self { shape, dtype, source, range })
    }

    /// A tensor of f32.
    ///
    /// # Panics
    /// When `data` has not one value an element.
    pub fn from_f32(shape: &[usize], data: Vec<f32>) -> Self {
        assert_eq!(shape.iter().product::<usize>(), data.len(), "one value an element");
        let range = 0..data.len() * 4;
        Self { shape: shape.to_vec(), dtype: DType::F32, source: Arc::new(data), range }
    }

    /// Its shape.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Its element type.
    pub fn dtype(&self) -> DType {
        self.dtype
    }

    /// Number of elements.
    pub fn count(&self) -> usize {
        self.shape.iter().product()
    }

    /// Its bytes, row-major and little-endian.
    pub fn bytes(&self) -> &[u8] {
        &self.source.bytes()[self.range.clone()]
    }

    /// Its values in place, when they are aligned f32 on a little-endian machine.
    pub fn as_f32(&self) -> Option<&[f32]> {
        if self.dtype != DType::F32 || cfg!(target_endian = "big") {
            return None;
        }
        bytemuck::try_cast_slice(self.bytes()).ok()
    }

    /// Its values as f32, converted where need be.
    pub fn to_f32(&self) -> Vec<f32> {
        fn each<const N: usize>(bytes: &[u8], f: impl Fn([u8; N]) -> f32) -> Vec<f32> {
            bytes.as_chunks::<N>().0.iter().map(|b| f(*b)).collect()
        }
        let bytes = self.bytes();
        match self.dtype {
            DType::F64 => each(bytes, |b| f64::from_le_bytes(b) as f32),
            DType::F32 => each(bytes, f32::from_le_bytes),
            DType::F16 => each(bytes, |b| f16::from_le_bytes(b).to_f32()),
            DType::BF16 => each(bytes, |b| bf16::from_le_bytes(b).to_f32()),
            DType::I64 => each(bytes, |b| i64::from_le_bytes(b) as f32),
            DType::I32 => each(bytes, |b| i32::from_le_bytes(b) as f32),
            DType::I16 => each(bytes, |b| f32::from(i16::from_le_bytes(b))),
            DType::I8 => each(bytes, |[b]| f32::from(b.cast_signed())),
            DType::U8 => each(bytes, |[b]| f32::from(b)),
            DType::Bool => each(bytes, |[b]| f32::from(u8::from(b != 0))),
        }
    }

    /// The same elements under another shape; `None` when the number of elements differs.
    #[must_use]
    pub fn reshaped(&self, shape: &[usize]) -> Option<Self> {
        (shape.iter().product::<usize>() == self.count()).then(|| Self { shape: shape.to_vec(), ..self.clone() })
    }
}
