//! Textures as lossy WebP (EXT_texture_webp), where that is smaller.

use rayon::prelude::*;
use serde_json::json;

use super::container::Parts;
use crate::ExportError;

/// Quality of colour textures.
const QUALITY: f32 = 85.0;

/// Encodes all images anew; a reader must know the extension then.
pub(super) fn to_webp(parts: &mut Parts) -> Result<(), ExportError> {
    let images: Vec<(usize, usize)> = parts.doc["images"]
        .as_array()
        .into_iter()
        .flatten()
        .enumerate()
        .filter_map(|(i, image)| Some((i, image["bufferView"].as_u64()? as usize)))
        .collect();
    let made: Vec<(usize, usize, Vec<u8>)> = images
        .into_par_iter()
        .map(|(image, view)| {
            let fail =
                |reason: String| ExportError::Encode { name: format!("texture_{image}"), format: "WebP", reason };
            let pixels = harmony_io::picture::decode(&parts.views[view]).map_err(|e| fail(e.to_string()))?;
            let (w, h) = (pixels.width(), pixels.height());
            let encoded = if pixels.color().has_alpha() {
                webp::Encoder::from_rgba(&pixels.into_rgba8(), w, h).encode(QUALITY)[..].to_vec()
            } else {
                webp::Encoder::from_rgb(&pixels.into_rgb8(), w, h).encode(QUALITY)[..].to_vec()
            };
            Ok((image, view, encoded))
        })
        .collect::<Result<_, ExportError>>()?;
    let mut changed = std::collections::BTreeSet::new();
    for (image, view, bytes) in made {
        if bytes.is_empty() || bytes.len() >= parts.views[view].len() {
            continue;
        }
        parts.views[view] = bytes;
        parts.doc["images"][image]["mimeType"] = json!("image/webp");
        changed.insert(image as u64);
    }
    if changed.is_empty() {
        return Ok(());
    }
    for texture in parts.doc.get_mut("textures").and_then(serde_json::Value::as_array_mut).into_iter().flatten() {
        let Some(source) = texture["source"].as_u64().filter(|s| changed.contains(s)) else { continue };
        if let Some(texture) = texture.as_object_mut() {
            texture.remove("source");
        }
        texture["extensions"]["EXT_texture_webp"] = json!({ "source": source });
    }
    parts.uses("EXT_texture_webp", true);
    Ok(())
}
