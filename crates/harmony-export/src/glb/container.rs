//! A GLB taken apart into its JSON and the bytes of each buffer view, and put together again.

use harmony_io::GlbError;
use serde_json::{Value, json};

/// JSON and buffer views.
#[derive(Debug)]
pub(super) struct Parts {
    /// The document; offsets of its buffer views are those of `bytes` only after [`Parts::bytes`].
    pub doc: Value,
    /// Bytes of each buffer view.
    pub views: Vec<Vec<u8>>,
    /// Bytes that a second buffer would have without packing (EXT_meshopt_compression's fallback).
    pub fallback: usize,
}

impl Parts {
    /// Of bytes that this program wrote, or that claim to be such.
    pub fn of(bytes: &[u8]) -> Result<Self, GlbError> {
        let word = |at: usize| {
            bytes
                .get(at..at + 4)
                .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize)
                .ok_or(GlbError::Truncated)
        };
        if !bytes.starts_with(b"glTF") {
            return Err(GlbError::NotGlb);
        }
        let text_length = word(12)?;
        let text = bytes.get(20..20 + text_length).ok_or(GlbError::Truncated)?;
        let doc: Value = serde_json::from_slice(text)?;
        let after = 20 + text_length;
        let binary = match word(after) {
            Ok(length) => bytes.get(after + 8..after + 8 + length).ok_or(GlbError::Truncated)?,
            Err(_) => &[],
        };
        let mut views = Vec::new();
        for (index, view) in doc["bufferViews"].as_array().into_iter().flatten().enumerate() {
            let packed = view.pointer("/extensions/EXT_meshopt_compression");
            let place = packed.unwrap_or(view);
            let at = |key: &str| place[key].as_u64().unwrap_or(0) as usize;
            let range = at("byteOffset")..at("byteOffset").saturating_add(at("byteLength"));
            views.push(binary.get(range).ok_or(GlbError::Broken { what: "buffer view", index })?.to_vec());
        }
        Ok(Self { doc, views, fallback: 0 })
    }

    /// Names an extension as used, and as required.
    pub fn uses(&mut self, name: &str, required: bool) {
        for key in if required { &["extensionsUsed", "extensionsRequired"][..] } else { &["extensionsUsed"][..] } {
            if !self.doc[*key].is_array() {
                self.doc[*key] = json!([]);
            }
            if let Some(list) = self.doc[*key].as_array_mut()
                && !list.iter().any(|n| n == name)
            {
                list.push(json!(name));
                list.sort_by(|a, b| a.as_str().cmp(&b.as_str()));
            }
        }
    }

    /// The file.
    pub fn bytes(mut self) -> Result<Vec<u8>, GlbError> {
        let mut binary: Vec<u8> = Vec::new();
        if let Some(views) = self.doc.get_mut("bufferViews").and_then(Value::as_array_mut) {
            for (view, bytes) in views.iter_mut().zip(&self.views) {
                binary.resize(binary.len().next_multiple_of(4), 0);
                let place = match view.pointer_mut("/extensions/EXT_meshopt_compression") {
                    Some(packed) => packed,
                    None => view,
                };
                place["byteOffset"] = json!(binary.len());
                place["byteLength"] = json!(bytes.len());
                binary.extend_from_slice(bytes);
            }
        }
        binary.resize(binary.len().next_multiple_of(4), 0);
        if !binary.is_empty() {
            let mut buffers = vec![json!({ "byteLength": binary.len() })];
            if self.fallback > 0 {
                buffers.push(json!({
                    "byteLength": self.fallback,
                    "extensions": { "EXT_meshopt_compression": { "fallback": true } },
                }));
            }
            self.doc["buffers"] = Value::Array(buffers);
        }
        let mut text = serde_json::to_vec(&self.doc)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + if binary.is_empty() { 0 } else { 8 + binary.len() };
        let too_large = |_| GlbError::TooLarge { what: "bytes", count: total as u64, limit: u32::MAX.into() };
        let total = u32::try_from(total).map_err(too_large)?;
        let mut out = Vec::with_capacity(total as usize);
        out.extend(b"glTF");
        out.extend(2_u32.to_le_bytes());
        out.extend(total.to_le_bytes());
        out.extend((text.len() as u32).to_le_bytes());
        out.extend(b"JSON");
        out.extend(text);
        if !binary.is_empty() {
            out.extend((binary.len() as u32).to_le_bytes());
            out.extend(b"BIN\0");
            out.extend(binary);
        }
        Ok(out)
    }
}
