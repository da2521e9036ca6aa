//! Photos for publication: nothing but the picture, chosen regions blurred.
//!
//! A JPEG whose pixels need not change keeps them bit for bit: its metadata (EXIF, XMP, IPTC, comments, embedded
//! previews, whatever a camera appended behind the end) is cut out and the rest copied. Everything else is decoded,
//! turned upright, blurred where asked and encoded anew.

use std::io::Cursor;

use harmony_io::picture::{self, PictureError};
use image::imageops::{self, FilterType};
use image::{DynamicImage, ImageDecoder as _, ImageReader, RgbImage};

/// Quality of photos that are encoded anew.
const QUALITY: u8 = 95;
/// Share by which a region is widened on each side before it is blurred.
const WIDEN: f64 = 0.1;
/// Cells that are left of a blurred region along its longer side: a face in six cells cannot be recognised, nor
/// brought back.
const CELLS: u32 = 6;

/// A photo ready to be published.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// The file.
    pub bytes: Vec<u8>,
    /// `jpg` or `png`.
    pub extension: &'static str,
    /// Whether the pixels are those of the file as it came, bit for bit.
    pub untouched: bool,
}

/// Takes everything out of a photo but the picture, and blurs regions (`x0 y0 x1 y1` in pixels of the upright photo,
/// upper bounds exclusive).
///
/// # Errors
/// Not a readable image.
pub fn export(bytes: &[u8], blur: &[[u32; 4]]) -> Result<Exported, PictureError> {
    let jpeg = bytes.starts_with(b"\xff\xd8\xff");
    let (mut image, turned) = upright(bytes)?;
    if jpeg
        && !turned
        && blur.is_empty()
        && let Some(stripped) = strip_jpeg(bytes)
    {
        return Ok(Exported { bytes: stripped, extension: "jpg", untouched: true });
    }
    for region in blur {
        blur_region(&mut image, *region);
    }
    Ok(if jpeg {
        Exported { bytes: picture::rgb_jpeg(&image, QUALITY)?, extension: "jpg", untouched: false }
    } else {
        Exported { bytes: picture::rgb_png(&image)?, extension: "png", untouched: false }
    })
}

/// Decodes within limits, and turns as EXIF says; whether it turned.
pub(crate) fn upright(bytes: &[u8]) -> Result<(RgbImage, bool), PictureError> {
    // The limits are those of every picture; the second look is for the orientation alone.
    let mut image = picture::decode(bytes)?;
    let orientation = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| PictureError::Decode(e.into()))?
        .into_decoder()
        .and_then(|mut d| d.orientation())
        .unwrap_or(image::metadata::Orientation::NoTransforms);
    image.apply_orientation(orientation);
    Ok((image.to_rgb8(), orientation != image::metadata::Orientation::NoTransforms))
}

/// Blurs a region beyond recovery: a few cells are left of it.
pub fn blur_region(image: &mut RgbImage, [x0, y0, x1, y1]: [u32; 4]) {
    let grow = |a: u32, b: u32, limit: u32| {
        let by = (f64::from(b.saturating_sub(a)) * WIDEN).ceil() as u32;
        (a.saturating_sub(by), b.saturating_add(by).min(limit))
    };
    let (x0, x1) = grow(x0, x1, image.width());
    let (y0, y1) = grow(y0, y1, image.height());
    if x0 >= x1 || y0 >= y1 {
        return;
    }
    let (w, h) = (x1 - x0, y1 - y0);
    let region = DynamicImage::ImageRgb8(imageops::crop_imm(image, x0, y0, w, h).to_image());
    let cells = |side: u32| (CELLS * side).div_ceil(w.max(h)).clamp(1, side);
    let coarse = region.resize_exact(cells(w), cells(h), FilterType::Triangle);
    let smooth = coarse.resize_exact(w, h, FilterType::CatmullRom).to_rgb8();
    imageops::replace(image, &smooth, i64::from(x0), i64::from(y0));
}

/// A JPEG without metadata, up to its end marker; `None` when it is not built as it should be.
fn strip_jpeg(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut out = bytes.get(..2)?.to_vec();
    let mut at = 2;
    loop {
        if *bytes.get(at)? != 0xff {
            return None;
        }
        while *bytes.get(at + 1)? == 0xff {
            at += 1;
        }
        let marker = bytes[at + 1];
        if marker == 0xd9 {
            out.extend_from_slice(&[0xff, 0xd9]);
            return Some(out);
        }
        let length = usize::from(u16::from_be_bytes([*bytes.get(at + 2)?, *bytes.get(at + 3)?]));
        let end = at + 2 + length.max(2);
        let segment = bytes.get(at..end)?;
        if keeps(marker, segment.get(4..)?) {
            out.extend_from_slice(segment);
        }
        at = end;
        if marker == 0xda {
            // Compressed data: up to the next marker that is neither an escaped 0xff nor a restart.
            let begin = at;
            while *bytes.get(at)? != 0xff || matches!(*bytes.get(at + 1)?, 0x00 | 0xd0..=0xd7 | 0xff) {
                at += 1;
            }
            out.extend_from_slice(&bytes[begin..at]);
        }
    }
}

/// Segments that a decoder needs: all but application data and comments; of those the plain JFIF head, colour profiles
/// and Adobe's colour transform.
fn keeps(marker: u8, payload: &[u8]) -> bool {
    match marker {
        0xe0 => payload.starts_with(b"JFIF\0") && payload.len() == 14,
        0xe2 => payload.starts_with(b"ICC_PROFILE\0"),
        0xee => payload.starts_with(b"Adobe"),
        0xe1 | 0xe3..=0xed | 0xef | 0xfe => false,
        _ => true,
    }
}

/// What a file carries beside its picture; empty = nothing. For published photos, JPEG and PNG.
pub fn metadata(bytes: &[u8]) -> Vec<String> {
    let mut found = Vec::new();
    if bytes.starts_with(b"\xff\xd8\xff") {
        match strip_jpeg(bytes) {
            Some(stripped) if stripped.len() == bytes.len() => {}
            Some(stripped) => found.push(format!("{} bytes that are not the picture", bytes.len() - stripped.len())),
            None => found.push("a JPEG that is not built as it should be".to_owned()),
        }
    } else if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        let mut at = 8;
        while let Some(head) = bytes.get(at..at + 8) {
            let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
            let kind = String::from_utf8_lossy(&head[4..8]).into_owned();
            if ["eXIf", "tEXt", "iTXt", "zTXt", "tIME"].contains(&kind.as_str()) {
                found.push(format!("a {kind} chunk"));
            }
            at = at.saturating_add(length).saturating_add(12);
            if kind == "IEND" && at < bytes.len() {
                found.push(format!("{} bytes behind the end", bytes.len() - at));
                break;
            }
        }
    } else {
        found.push("neither JPEG nor PNG".to_owned());
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    /// A photo with a gradient, 40 x 30.
    fn photo() -> RgbImage {
        RgbImage::from_fn(40, 30, |x, y| Rgb([(x * 6) as u8, (y * 8) as u8, 100]))
    }

    /// EXIF with an orientation and a maker's name that must not survive, by the EXIF 2.32 layout.
    fn exif(orientation: u16) -> Vec<u8> {
        let mut tiff = b"MM\0*\0\0\0\x08\0\x02".to_vec();
        tiff.extend([0x01, 0x0f, 0, 2, 0, 0, 0, 8, 0, 0, 0, 38]);
        tiff.extend([0x01, 0x12, 0, 3, 0, 0, 0, 1]);
        tiff.extend(orientation.to_be_bytes());
        tiff.extend([0, 0, 0, 0, 0, 0]);
        tiff.extend(b"Whoever\0");
        [b"Exif\0\0".to_vec(), tiff].concat()
    }

    fn segment(marker: u8, payload: &[u8]) -> Vec<u8> {
        let length = (payload.len() as u16 + 2).to_be_bytes();
        [&[0xff, marker][..], &length, payload].concat()
    }

    fn with_metadata(orientation: u16) -> Vec<u8> {
        let plain = picture::rgb_jpeg(&photo(), 90).unwrap();
        let mut bytes = plain[..2].to_vec();
        bytes.extend(segment(0xe1, &exif(orientation)));
        bytes.extend(segment(0xe1, b"http://ns.adobe.com/xap/1.0/\0<x:xmpmeta>Whoever</x:xmpmeta>"));
        bytes.extend(segment(0xed, b"Photoshop 3.0\0Whoever"));
        bytes.extend(segment(0xfe, b"Whoever was here"));
        bytes.extend(&plain[2..]);
        bytes.extend(b"a short film with Whoever");
        bytes
    }

    fn reads_exif(bytes: &[u8]) -> bool {
        exif::Reader::new().read_from_container(&mut Cursor::new(bytes)).is_ok()
    }

    #[test]
    fn metadata_goes_and_the_pixels_stay() {
        let original = with_metadata(1);
        assert!(reads_exif(&original), "an independent reader finds it before");
        let exported = export(&original, &[]).unwrap();
        assert!(exported.untouched && !reads_exif(&exported.bytes));
        assert!(!exported.bytes.windows(7).any(|w| w == b"Whoever"));
        assert_eq!(picture::decode(&exported.bytes).unwrap(), picture::decode(&original).unwrap());
        assert!(metadata(&exported.bytes).is_empty());
        assert!(!metadata(&original).is_empty());
    }

    #[test]
    fn a_turned_photo_is_published_upright() {
        let exported = export(&with_metadata(6), &[]).unwrap();
        assert!(!exported.untouched && !reads_exif(&exported.bytes));
        let image = picture::decode(&exported.bytes).unwrap().to_rgb8();
        assert_eq!(image.dimensions(), (30, 40));
        // Turned by a quarter clockwise: what was at the bottom left is at the top left.
        let (was, is) = (photo().get_pixel(2, 27).0, image.get_pixel(2, 2).0);
        assert!(was.iter().zip(is).all(|(a, b)| a.abs_diff(b) < 14), "{was:?} {is:?}");
    }

    #[test]
    fn a_blurred_region_cannot_be_told_and_the_rest_stays() {
        // A checkerboard of single pixels: all detail.
        let board = RgbImage::from_fn(60, 60, |x, y| Rgb([if (x + y) % 2 == 0 { 0 } else { 255 }; 3]));
        let bytes = picture::rgb_png(&board).unwrap();
        let exported = export(&bytes, &[[10, 10, 40, 40], [200, 0, 300, 10]]).unwrap();
        assert_eq!(exported.extension, "png");
        let image = picture::decode(&exported.bytes).unwrap().to_rgb8();
        for (x, y, p) in image.enumerate_pixels() {
            let inside = (7..43).contains(&x) && (7..43).contains(&y);
            if inside {
                assert!(p.0[0].abs_diff(127) < 40, "({x}, {y}) {p:?}");
            } else {
                assert_eq!(p, board.get_pixel(x, y));
            }
        }
    }

    #[test]
    fn a_png_loses_its_text() {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
        encoder.set_color(png::ColorType::Rgb);
        encoder.add_text_chunk("Author".to_owned(), "Whoever".to_owned()).unwrap();
        encoder.write_header().unwrap().write_image_data(&[1, 2, 3, 4, 5, 6]).unwrap();
        assert_eq!(metadata(&bytes), ["a tEXt chunk"]);
        let exported = export(&bytes, &[]).unwrap();
        assert!(metadata(&exported.bytes).is_empty());
        assert_eq!(picture::decode(&exported.bytes).unwrap(), picture::decode(&bytes).unwrap());
    }

    #[test]
    fn broken_files_are_errors() {
        let good = with_metadata(1);
        for cut in [0, 1, 3, 20, 60, 200, good.len() / 2] {
            let _ = export(&good[..cut], &[]);
            let _ = metadata(&good[..cut]);
            let _ = strip_jpeg(&good[..cut]);
        }
        assert!(export(b"nothing", &[]).is_err());
    }
}
