//! Photos: every format, EXIF included.
#![no_main]

use harmony_io::photo_from_bytes;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(photo) = photo_from_bytes(data.to_vec()) {
        let size = photo.size();
        assert!(size.width.max(size.height) <= harmony_io::photo::MAX_WORKING_SIDE && size.pixels() > 0);
        assert!(photo.focal_px.is_none_or(|f| f.is_finite() && f > 0.0));
    }
});
