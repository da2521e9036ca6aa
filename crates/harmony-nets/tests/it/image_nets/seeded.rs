//! Values that Rust and `tests/parity/seeded.py` make alike.

use image::RgbImage;

/// Values in -1..1 from a key.
pub fn uniform(key: &str, count: usize) -> Vec<f32> {
    let seed = key.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
    let value = |i: u64| {
        let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15u64.wrapping_mul(i + 1));
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    };
    (0..count as u64).map(value).collect()
}

/// A smooth picture, as `photo` of the scripts.
pub fn photo(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let (x, y) = (u64::from(x), u64::from(y));
        let values = [(x * x * 3 + y * 5) / 7, (x * 2 + y * y) / 5, x * y / 11];
        image::Rgb(values.map(|v| (v % 256) as u8))
    })
}
