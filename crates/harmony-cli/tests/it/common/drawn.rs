//! Pictures drawn here: rooms, and what is none.
#![allow(clippy::cast_possible_wrap, clippy::many_single_char_names, reason = "pixels and formulas")]

use std::io::Cursor;

use image::{DynamicImage, ImageFormat, Rgb, RgbImage};

/// A picture in a format's bytes.
pub fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    image.write_to(&mut out, format).unwrap();
    out.into_inner()
}

/// A little noise that is the same every time, -8 to 8.
fn grain(x: u32, y: u32) -> i32 {
    let mut h = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2c1b_3c6d);
    ((h >> 16) % 17) as i32 - 8
}

fn shade(color: [i32; 3], x: u32, y: u32) -> Rgb<u8> {
    let g = grain(x, y);
    Rgb(color.map(|c| (c + g).clamp(0, 255) as u8))
}

/// An empty room seen from its middle: back wall, side walls, floor with boards, ceiling.
pub fn empty_room(width: u32, height: u32) -> RgbImage {
    let (w, h) = (f64::from(width), f64::from(height));
    RgbImage::from_fn(width, height, |x, y| {
        let (u, v) = ((f64::from(x) + 0.5) / w * 2.0 - 1.0, (f64::from(y) + 0.5) / h * 2.0 - 1.0);
        // The back wall spans half the picture; everything else runs to the centre.
        let (a, b) = (u.abs() / 0.5, v.abs() / 0.45);
        let color = if a <= 1.0 && b <= 1.0 {
            [205, 198, 186]
        } else if a > b {
            if u < 0.0 { [180, 174, 163] } else { [192, 186, 175] }
        } else if v < 0.0 {
            [235, 234, 230]
        } else {
            let board = (u / v * 6.0).floor() as i32;
            if board.rem_euclid(2) == 0 { [140, 100, 62] } else { [128, 90, 55] }
        };
        shade(color, x, y)
    })
}

/// Sky, hills and grass.
pub fn outdoors(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let hill = f64::from(height) * (0.5 + 0.06 * (f64::from(x) / f64::from(width) * 9.0).sin());
        let (depth, y_) = (f64::from(y), f64::from(y) / f64::from(height));
        let color = if depth < hill {
            [(120.0 + 90.0 * y_) as i32, (165.0 + 60.0 * y_) as i32, 235]
        } else {
            [60 + grain(x / 2, y) * 3, 120 + grain(x, y / 2) * 4, 45]
        };
        shade(color, x, y)
    })
}

/// A shelf seen from so near that no floor is in the picture.
pub fn no_floor(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let board = y % (height / 4) < height / 40;
        let book = (x * 37 / width * 53) % 200;
        let color = if board { [90, 60, 35] } else { [60 + book as i32 / 2, 40 + (book as i32 * 7) % 120, 80] };
        shade(color, x, y)
    })
}

/// One wall, squarely, with its skirting and a strip of floor.
pub fn one_wall(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let v = f64::from(y) / f64::from(height);
        let color = match v {
            v if v < 0.80 => [214, 206, 190],
            v if v < 0.83 => [245, 245, 240],
            _ => [120, 84, 50],
        };
        shade(color, x, y)
    })
}
