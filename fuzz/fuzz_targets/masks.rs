//! Instance masks with their labels.
#![no_main]

use harmony_fuzz::{put, scratch};
use harmony_io::{load_mask, load_masks};
use harmony_scene::ImageSize;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((head, rest)) = data.split_at_checked(2) else { return };
    let cut = usize::from(u16::from_le_bytes([head[0], head[1]])).min(rest.len());
    let (labels, image) = rest.split_at(cut);
    if labels.is_empty() {
        let _ = std::fs::remove_file(scratch().join("masks.json"));
    } else {
        put("masks.json", labels);
    }
    let path = put("masks.png", image);
    if let Ok(loaded) = load_masks(&path, ImageSize::new(64, 48)) {
        for mask in &loaded.masks {
            assert_eq!(mask.mask.size(), ImageSize::new(64, 48));
        }
    }
    let _ = load_mask(&path);
});
