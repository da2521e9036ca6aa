//! NumPy archives and arrays, raw and as point maps.
#![no_main]

use harmony_fuzz::put;
use harmony_io::npz::{list_npz, parse_npy, parse_npz};
use harmony_io::{PointMapOptions, load_point_map};
use harmony_scene::ImageSize;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let options = PointMapOptions::new(ImageSize::new(64, 48));
    if data.starts_with(b"\x93NUMPY") {
        let _ = parse_npy("points", data);
        let _ = load_point_map(&put("points.npy", data), &options);
    } else {
        let _ = list_npz(data);
        let _ = parse_npz(data, |_| true);
        let _ = load_point_map(&put("points.npz", data), &options);
    }
});
