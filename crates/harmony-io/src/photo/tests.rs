//! Photos as cameras, phones, print shops and broken downloads make them.

use image::{ExtendedColorType, ImageEncoder, Rgb, Rgba, RgbaImage};

use super::*;

/// A picture with a gradient and four corners that can be told apart.
fn corners(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| match (x * 2 < width, y * 2 < height) {
        (true, true) => Rgb([220, 30, 30]),
        (false, true) => Rgb([30, 200, 30]),
        (true, false) => Rgb([30, 30, 210]),
        (false, false) => Rgb([230, 230, 40]),
    })
}

fn encode(image: &DynamicImage, format: image::ImageFormat) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    image.write_to(&mut out, format).unwrap();
    out.into_inner()
}

/// A JPEG with an EXIF block (little-endian TIFF) that holds the given (tag, value) shorts; ExifIFD entries separately.
fn jpeg_with_exif(image: &RgbImage, primary: &[(u16, u16)], exif: &[(u16, u16)]) -> Vec<u8> {
    let mut tiff = b"II*\0\x08\0\0\0".to_vec();
    let entry = |out: &mut Vec<u8>, tag: u16, kind: u16, value: u32| {
        out.extend(tag.to_le_bytes());
        out.extend(kind.to_le_bytes());
        out.extend(1_u32.to_le_bytes());
        out.extend(value.to_le_bytes());
    };
    let count = primary.len() as u16 + 1;
    tiff.extend(count.to_le_bytes());
    for (tag, value) in primary {
        entry(&mut tiff, *tag, 3, u32::from(*value));
    }
    let exif_at = 8 + 2 + 12 * u32::from(count) + 4;
    entry(&mut tiff, 0x8769, 4, exif_at);
    tiff.extend(0_u32.to_le_bytes());
    tiff.extend((exif.len() as u16).to_le_bytes());
    for (tag, value) in exif {
        entry(&mut tiff, *tag, 3, u32::from(*value));
    }
    tiff.extend(0_u32.to_le_bytes());
    let plain = encode(&DynamicImage::ImageRgb8(image.clone()), image::ImageFormat::Jpeg);
    let mut out = plain[..2].to_vec();
    out.extend([0xff, 0xe1]);
    out.extend(((tiff.len() + 8) as u16).to_be_bytes());
    out.extend(b"Exif\0\0");
    out.extend(tiff);
    out.extend(&plain[2..]);
    out
}

fn messages(photo: &Photo) -> String {
    photo.warnings.iter().map(|w| w.message.as_str()).collect::<Vec<_>>().join(" | ")
}

#[test]
fn every_orientation_comes_upright() {
    // How each orientation stores an upright picture, from the EXIF standard: (row 0, column 0) of the file is ...
    let upright = DynamicImage::ImageRgb8(corners(96, 64));
    let stored = |o: u8| match o {
        1 => upright.clone(),
        2 => upright.fliph(),
        3 => upright.rotate180(),
        4 => upright.flipv(),
        5 => upright.rotate90().fliph(),
        6 => upright.rotate270(),
        7 => upright.rotate270().fliph(),
        _ => upright.rotate90(),
    };
    for orientation in 1..=8_u8 {
        let bytes = jpeg_with_exif(&stored(orientation).to_rgb8(), &[(0x0112, u16::from(orientation))], &[]);
        let photo = photo_from_bytes(bytes).unwrap();
        assert_eq!(photo.size(), ImageSize::new(96, 64), "orientation {orientation}");
        assert_eq!(photo.orientation, orientation);
        for (x, y) in [(8, 8), (88, 8), (8, 56), (88, 56)] {
            let (got, want) = (photo.image.get_pixel(x, y).0, corners(96, 64).get_pixel(x, y).0);
            let far = got.iter().zip(want).map(|(a, b)| a.abs_diff(b)).max().unwrap();
            assert!(far <= 12, "orientation {orientation} at {x},{y}: {got:?} for {want:?}");
        }
        assert_eq!(messages(&photo).contains("turned upright"), orientation != 1);
    }
}

#[test]
fn the_focal_length_is_read_and_scaled_with_the_working_image() {
    let exif = [(0xa405, 35), (0xa002, 5120), (0xa003, 3840)];
    let photo = photo_from_bytes(jpeg_with_exif(&corners(5120, 3840), &[], &exif)).unwrap();
    assert_eq!(photo.size(), ImageSize::new(4096, 3072));
    assert_eq!(photo.original_size, ImageSize::new(5120, 3840));
    // 35 mm against the 43.27 mm diagonal, on a diagonal of 5120 px (4096 x 3072).
    let expected = 35.0 / (36.0_f64.hypot(24.0)) * 5120.0;
    assert!((photo.focal_px.unwrap() - expected).abs() <= 1e-3 * expected);
    assert!(messages(&photo).contains("4096 x 3072"));
    assert!(photo_from_bytes(encode(&corners(64, 64).into(), image::ImageFormat::Png)).unwrap().focal_px.is_none());
}

#[test]
fn a_cmyk_jpeg_from_a_print_program_is_converted() {
    // Made by another program: left quarter white, right quarter black, between them red over blue.
    let photo = photo_from_bytes(include_bytes!("../../tests/data/cmyk.jpg").to_vec()).unwrap();
    assert!(messages(&photo).contains("CMYK"));
    for (x, y, want) in [(6, 20, [255, 255, 255]), (58, 20, [0, 0, 0]), (30, 8, [200, 40, 40]), (30, 40, [30, 60, 200])]
    {
        let got = photo.image.get_pixel(x, y).0;
        let far = got.iter().zip(want).map(|(a, b): (&u8, u8)| a.abs_diff(b)).max().unwrap();
        assert!(far <= 16, "at {x},{y}: {got:?} for {want:?}");
    }
}

#[test]
fn unusual_pixels_are_converted_and_told() {
    let rgba = RgbaImage::from_fn(64, 64, |x, _| if x < 32 { Rgba([0, 0, 0, 0]) } else { Rgba([10, 200, 30, 255]) });
    let photo = photo_from_bytes(encode(&rgba.into(), image::ImageFormat::Png)).unwrap();
    assert_eq!(photo.image.get_pixel(3, 3).0, [255, 255, 255]);
    assert_eq!(photo.image.get_pixel(40, 3).0, [10, 200, 30]);
    assert!(messages(&photo).contains("50.0 % of the photo is transparent"));

    let deep = DynamicImage::ImageRgb8(corners(64, 64)).to_rgb16();
    let photo = photo_from_bytes(encode(&deep.into(), image::ImageFormat::Png)).unwrap();
    assert!(messages(&photo).contains("16 bits"));
    assert_eq!(photo.image, corners(64, 64));

    let grey = DynamicImage::ImageRgb8(corners(64, 64)).to_luma8();
    assert!(messages(&photo_from_bytes(encode(&grey.into(), image::ImageFormat::Jpeg)).unwrap()).contains("greyscale"));

    let wide = photo_from_bytes(encode(&corners(1200, 300).into(), image::ImageFormat::Png)).unwrap();
    assert!(messages(&wide).contains("panorama"));
    let blank = RgbImage::from_pixel(640, 480, Rgb([128, 128, 128]));
    assert!(
        messages(&photo_from_bytes(encode(&blank.into(), image::ImageFormat::Png)).unwrap())
            .contains("one even colour")
    );
}

#[test]
fn all_formats_are_told_apart_by_content() {
    use image::ImageFormat::{Bmp, Jpeg, Png, Pnm, Tiff, WebP};
    for (format, extension) in [(Bmp, "bmp"), (Jpeg, "jpg"), (Png, "png"), (Pnm, "pnm"), (Tiff, "tif"), (WebP, "webp")]
    {
        let photo = photo_from_bytes(encode(&corners(640, 480).into(), format)).unwrap();
        assert_eq!(photo.extension, extension);
        assert_eq!(photo.size(), ImageSize::new(640, 480));
        assert!(photo.warnings.is_empty(), "{extension}: {}", messages(&photo));
    }
}

#[test]
fn what_is_no_photo_is_refused_with_a_hint() {
    type Check = fn(&PhotoError) -> bool;
    let cases: [(&str, Vec<u8>, Check); 8] = [
        ("empty", Vec::new(), |e| matches!(e, PhotoError::Empty)),
        ("text", b"hello world, I am a photo".to_vec(), |e| matches!(e, PhotoError::UnknownFormat { .. })),
        ("heic", b"\0\0\0\x18ftypheic\0\0\0\0".to_vec(), |e| {
            matches!(e, PhotoError::UnsupportedFormat { format: "HEIC" })
        }),
        ("gif", b"GIF89a\x01\0\x01\0".to_vec(), |e| matches!(e, PhotoError::UnsupportedFormat { format: "GIF" })),
        ("png head", b"\x89PNG\r\n\x1a\n".to_vec(), |e| matches!(e, PhotoError::Damaged { .. })),
        ("jpeg head", b"\xff\xd8\xff\xe0".to_vec(), |e| matches!(e, PhotoError::Truncated { .. })),
        ("1 x 1", encode(&corners(1, 1).into(), image::ImageFormat::Png), |e| matches!(e, PhotoError::TooSmall { .. })),
        ("bmp head", [b"BM".as_slice(), &[0; 40]].concat(), |e| matches!(e, PhotoError::Damaged { .. })),
    ];
    for (name, bytes, check) in cases {
        let error = photo_from_bytes(bytes).unwrap_err();
        assert!(check(&error), "{name}: {error:?}");
        assert!(error.hint().is_some(), "{name}");
    }
}

#[test]
fn cut_off_files_are_refused_in_every_format() {
    use image::ImageFormat::{Bmp, Jpeg, Png, Pnm, Tiff, WebP};
    for format in [Bmp, Jpeg, Png, Pnm, Tiff, WebP] {
        let bytes = encode(&corners(640, 480).into(), format);
        for share in [0.2, 0.6, 0.95] {
            let cut = bytes[..(bytes.len() as f64 * share) as usize].to_vec();
            let result = photo_from_bytes(cut);
            assert!(result.is_err(), "{format:?} cut to {share}");
        }
    }
}

#[test]
fn a_huge_size_in_the_header_takes_no_memory() {
    // A PNG that claims 60000 x 60000 pixels in 60 bytes, and one of zero columns.
    let claim = |width: u32, height: u32| {
        let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
        bytes.extend(width.to_be_bytes());
        bytes.extend(height.to_be_bytes());
        bytes.extend([8, 2, 0, 0, 0]);
        let crc = bytes[12..].iter().fold(u32::MAX, |crc, b| {
            (0..8).fold(crc ^ u32::from(*b), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 })
        });
        bytes.extend((!crc).to_be_bytes());
        bytes.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e\0\0\0\0IEND\xae\x42\x60\x82");
        bytes
    };
    let error = photo_from_bytes(claim(60_000, 60_000)).unwrap_err();
    assert!(matches!(error, PhotoError::TooLarge { width: 60_000, height: 60_000, .. }), "{error:?}");
    let error = photo_from_bytes(claim(0, 600)).unwrap_err();
    assert!(error.hint().is_some(), "{error:?}");
}

#[test]
fn flipped_bytes_never_panic() {
    use rand_like::Lcg;
    let mut rng = Lcg(7);
    for format in
        [image::ImageFormat::Jpeg, image::ImageFormat::Png, image::ImageFormat::WebP, image::ImageFormat::Tiff]
    {
        let bytes = if format == image::ImageFormat::Jpeg {
            jpeg_with_exif(&corners(48, 40), &[(0x0112, 6)], &[(0xa405, 35)])
        } else {
            encode(&corners(48, 40).into(), format)
        };
        for _ in 0..150 {
            let mut broken = bytes.clone();
            for _ in 0..4 {
                let at = rng.next() as usize % broken.len();
                broken[at] = rng.next() as u8;
            }
            let _ = photo_from_bytes(broken);
        }
    }
}

#[test]
fn a_16_bit_grey_tiff_passes() {
    let mut out = Cursor::new(Vec::new());
    let data: Vec<u8> = (0..64 * 64_u32).flat_map(|i| ((i * 16) as u16).to_ne_bytes()).collect();
    image::codecs::tiff::TiffEncoder::new(&mut out).write_image(&data, 64, 64, ExtendedColorType::L16).unwrap();
    let photo = photo_from_bytes(out.into_inner()).unwrap();
    assert!(messages(&photo).contains("16 bits") && messages(&photo).contains("greyscale"));
}

/// A tiny reproducible generator, so that the test needs no crate for it.
mod rand_like {
    pub struct Lcg(pub u64);

    impl Lcg {
        pub fn next(&mut self) -> u32 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 33) as u32
        }
    }
}
