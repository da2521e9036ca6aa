//! Arrays of a GLB file, every range checked before it is used.

use super::GlbError;
use super::document::{Accessor, Document};

/// The document and its binary chunk.
pub(super) struct Source<'a> {
    pub doc: &'a Document,
    pub binary: &'a [u8],
}

fn broken(what: &'static str, index: usize) -> GlbError {
    GlbError::Broken { what, index }
}

fn width(component_type: u32) -> Option<usize> {
    match component_type {
        5120 | 5121 => Some(1),
        5122 | 5123 => Some(2),
        5125 | 5126 => Some(4),
        _ => None,
    }
}

fn components(kind: &str) -> Option<usize> {
    match kind {
        "SCALAR" => Some(1),
        "VEC2" => Some(2),
        "VEC3" => Some(3),
        "VEC4" => Some(4),
        _ => None,
    }
}

/// One component as a number; normalised integers as glTF 3.6.2.2 says.
fn number(bytes: &[u8], component_type: u32, normalized: bool) -> f32 {
    let (value, most) = match component_type {
        5120 => (f32::from(bytes[0] as i8), 127.0),
        5121 => (f32::from(bytes[0]), 255.0),
        5122 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32_767.0),
        5123 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65_535.0),
        5125 => (u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as f32, u32::MAX as f32),
        _ => return f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    };
    if normalized { (value / most).max(-1.0) } else { value }
}

/// The bytes of an accessor's elements.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    element: usize,
}

impl<'a> Source<'a> {
    pub(super) fn view(&self, index: usize) -> Result<&'a [u8], GlbError> {
        let fail = || broken("buffer view", index);
        let view = self.doc.buffer_views.get(index).ok_or_else(fail)?;
        if view.buffer != 0 || self.doc.buffers.first().is_some_and(|b| b.uri.is_some()) {
            return Err(GlbError::Unsupported { what: "buffers outside the GLB file" });
        }
        let start = view.byte_offset.unwrap_or(0);
        let end = start.checked_add(view.byte_length).ok_or_else(fail)?;
        self.binary.get(start..end).ok_or_else(fail)
    }

    fn elements(
        &self,
        index: usize,
        view: usize,
        offset: usize,
        count: usize,
        element: usize,
    ) -> Result<Elements<'a>, GlbError> {
        let fail = || broken("accessor", index);
        let bytes = self.view(view)?;
        let stride = self.doc.buffer_views[view].byte_stride.unwrap_or(element);
        if stride < element {
            return Err(fail());
        }
        let needed = match count {
            0 => 0,
            n => (n - 1).checked_mul(stride).and_then(|b| b.checked_add(element)).ok_or_else(fail)?,
        };
        let bytes = bytes.get(offset..).and_then(|b| b.get(..needed)).ok_or_else(fail)?;
        Ok(Elements { bytes, stride, element })
    }

    fn accessor(&self, index: usize) -> Result<(&'a Accessor, usize, usize), GlbError> {
        let fail = || broken("accessor", index);
        let a = self.doc.accessors.get(index).ok_or_else(fail)?;
        let n = components(&a.kind).ok_or_else(fail)?;
        let w = width(a.component_type).ok_or_else(fail)?;
        Ok((a, n, w))
    }

    /// Number of elements, as stated.
    pub(super) fn count(&self, index: usize) -> Result<usize, GlbError> {
        Ok(self.accessor(index)?.0.count)
    }

    /// Elements of `N` components each (further components are left out, missing ones are an error).
    pub(super) fn floats<const N: usize>(&self, index: usize, limit: usize) -> Result<Vec<[f32; N]>, GlbError> {
        let fail = || broken("accessor", index);
        let (a, n, w) = self.accessor(index)?;
        if n < N {
            return Err(fail());
        }
        if a.count > limit {
            return Err(GlbError::TooLarge { what: "vertices", count: a.count as u64, limit: limit as u64 });
        }
        let read =
            |bytes: &[u8]| std::array::from_fn(|k| number(&bytes[k * w..(k + 1) * w], a.component_type, a.normalized));
        let mut out: Vec<[f32; N]> = match a.buffer_view {
            Some(view) => {
                let e = self.elements(index, view, a.byte_offset.unwrap_or(0), a.count, n * w)?;
                (0..a.count).map(|i| read(&e.bytes[i * e.stride..i * e.stride + e.element])).collect()
            }
            None => vec![[0.0; N]; a.count],
        };
        if let Some(sparse) = &a.sparse {
            let number_at = |path: &str| sparse.pointer(path).and_then(serde_json::Value::as_u64).map(|v| v as usize);
            let count = number_at("/count").ok_or_else(fail)?;
            if count > a.count {
                return Err(fail());
            }
            let kind = number_at("/indices/componentType").ok_or_else(fail)? as u32;
            let index_width = width(kind).filter(|_| kind != 5126).ok_or_else(fail)?;
            let places = self.elements(
                index,
                number_at("/indices/bufferView").ok_or_else(fail)?,
                number_at("/indices/byteOffset").unwrap_or(0),
                count,
                index_width,
            )?;
            let values = self.elements(
                index,
                number_at("/values/bufferView").ok_or_else(fail)?,
                number_at("/values/byteOffset").unwrap_or(0),
                count,
                n * w,
            )?;
            for i in 0..count {
                let place = unsigned(&places.bytes[i * places.stride..], kind) as usize;
                let value = &values.bytes[i * values.stride..i * values.stride + values.element];
                *out.get_mut(place).ok_or_else(fail)? = read(value);
            }
        }
        Ok(out)
    }

    /// Vertex indices.
    pub(super) fn indices(&self, index: usize, limit: usize) -> Result<Vec<u32>, GlbError> {
        let fail = || broken("accessor", index);
        let (a, n, w) = self.accessor(index)?;
        if n != 1 || !matches!(a.component_type, 5121 | 5123 | 5125) || a.sparse.is_some() {
            return Err(fail());
        }
        if a.count > limit {
            return Err(GlbError::TooLarge { what: "vertex indices", count: a.count as u64, limit: limit as u64 });
        }
        let e = self.elements(index, a.buffer_view.ok_or_else(fail)?, a.byte_offset.unwrap_or(0), a.count, w)?;
        Ok((0..a.count).map(|i| unsigned(&e.bytes[i * e.stride..], a.component_type)).collect())
    }
}

fn unsigned(bytes: &[u8], component_type: u32) -> u32 {
    match component_type {
        5121 | 5120 => u32::from(bytes[0]),
        5123 | 5122 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    }
}
