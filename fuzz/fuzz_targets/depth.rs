//! Sensor depth: 16-bit PNG and PGM.
#![no_main]

use harmony_fuzz::put;
use harmony_io::{PointMapOptions, load_point_map, parse_intrinsics};
use harmony_scene::ImageSize;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((head, image)) = data.split_first() else { return };
    let (text, image) = image.split_at(image.len().min(usize::from(head % 32)));
    let mut options = PointMapOptions::new(ImageSize::new(64, 48));
    options.intrinsics = parse_intrinsics(&String::from_utf8_lossy(text))
        .or_else(|_| parse_intrinsics("50,50,32,24"))
        .ok();
    options.depth_scale = Some([1000.0, 5000.0, 1e-300, 1e300][usize::from(head >> 6)]);
    let name = if image.starts_with(b"P") { "depth.pgm" } else { "depth.png" };
    if let Ok(map) = load_point_map(&put(name, image), &options) {
        assert!(map.size.pixels() <= 160_000_000);
    }
});
