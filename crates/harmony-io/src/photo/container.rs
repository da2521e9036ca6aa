//! What kind of image file some bytes are, and whether they are all there.

use image::ImageFormat;

use super::PhotoError;

/// A format that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Format {
    pub kind: ImageFormat,
    pub name: &'static str,
    pub extension: &'static str,
}

/// The format by content; the file's name is never asked.
pub(super) fn sniff(bytes: &[u8]) -> Result<Format, PhotoError> {
    let known = |kind, name, extension| Ok(Format { kind, name, extension });
    let starts = |magic: &[u8]| bytes.starts_with(magic);
    if bytes.is_empty() {
        return Err(PhotoError::Empty);
    }
    if starts(b"\xff\xd8\xff") {
        return known(ImageFormat::Jpeg, "JPEG", "jpg");
    }
    if starts(b"\x89PNG\r\n\x1a\n") {
        return known(ImageFormat::Png, "PNG", "png");
    }
    if starts(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        return known(ImageFormat::WebP, "WebP", "webp");
    }
    if starts(b"II*\0") || starts(b"MM\0*") || starts(b"II+\0") || starts(b"MM\0+") {
        return known(ImageFormat::Tiff, "TIFF", "tif");
    }
    if bytes[0] == b'P'
        && matches!(bytes.get(1), Some(b'1'..=b'7'))
        && bytes.get(2).is_some_and(u8::is_ascii_whitespace)
    {
        return known(ImageFormat::Pnm, "PNM", "pnm");
    }
    if starts(b"BM") && bytes.len() > 26 {
        return known(ImageFormat::Bmp, "BMP", "bmp");
    }
    let unsupported = |format| Err(PhotoError::UnsupportedFormat { format });
    if bytes.get(4..8) == Some(b"ftyp") {
        return match bytes.get(8..12) {
            Some(b"heic" | b"heix" | b"mif1" | b"msf1" | b"heim" | b"heis" | b"hevc") => unsupported("HEIC"),
            Some(b"avif" | b"avis") => unsupported("AVIF"),
            _ => unsupported("video (MP4 family)"),
        };
    }
    for (magic, name) in [
        (&b"GIF8"[..], "GIF"),
        (b"%PDF", "PDF"),
        (b"\0\0\x01\0", "ICO"),
        (b"\x76\x2f\x31\x01", "OpenEXR"),
        (b"#?RADIANCE", "Radiance HDR"),
        (b"8BPS", "Photoshop"),
        (b"\xff\x0a", "JPEG XL"),
        (b"\0\0\0\x0cJXL ", "JPEG XL"),
    ] {
        if starts(magic) {
            return unsupported(name);
        }
    }
    let head: String = bytes.iter().take(12).flat_map(|b| std::ascii::escape_default(*b)).map(char::from).collect();
    Err(PhotoError::UnknownFormat { start: format!("\"{head}\"") })
}

/// Whether a JPEG has its end: decoders fill a missing rest with grey and say nothing.
///
/// Other formats are left to their decoders, which notice.
pub(super) fn is_whole(bytes: &[u8], format: Format) -> bool {
    if format.kind != ImageFormat::Jpeg {
        return true;
    }
    match scan_start(bytes) {
        // Compressed data escapes every 0xff, so that the end marker cannot occur in it by chance. What cameras put
        // behind the end (further pictures, videos) does not matter.
        Some(start) => bytes[start..].windows(2).any(|w| w == [0xff, 0xd9]),
        None => false,
    }
}

/// Number of colour components of a JPEG.
pub(super) fn jpeg_components(bytes: &[u8], format: Format) -> Option<u8> {
    if format.kind != ImageFormat::Jpeg {
        return None;
    }
    segments(bytes)
        .find(|s| matches!(s.marker, 0xc0..=0xcf) && !matches!(s.marker, 0xc4 | 0xc8 | 0xcc))
        .and_then(|s| bytes.get(s.start + 5).copied())
}

struct Segment {
    marker: u8,
    /// Offset of the payload (after the length).
    start: usize,
    end: usize,
}

/// The marker segments before the first scan, its header included.
fn segments(bytes: &[u8]) -> impl Iterator<Item = Segment> + '_ {
    let mut at = 2;
    let mut done = false;
    std::iter::from_fn(move || {
        if done {
            return None;
        }
        while bytes.get(at) == Some(&0xff) && bytes.get(at + 1) == Some(&0xff) {
            at += 1;
        }
        if bytes.get(at) != Some(&0xff) {
            return None;
        }
        let marker = *bytes.get(at + 1)?;
        let length = usize::from(u16::from_be_bytes([*bytes.get(at + 2)?, *bytes.get(at + 3)?]));
        let segment = Segment { marker, start: at + 4, end: at + 2 + length.max(2) };
        done = marker == 0xda;
        at = segment.end;
        Some(segment)
    })
}

fn scan_start(bytes: &[u8]) -> Option<usize> {
    segments(bytes).find(|s| s.marker == 0xda).map(|s| s.end).filter(|end| *end <= bytes.len())
}
