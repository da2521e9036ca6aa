//! Orientation and focal length from EXIF.

use std::io::Cursor;

use exif::{Exif, In, Tag, Value};
use harmony_scene::ImageSize;

/// Diagonal of a 36 x 24 mm frame, to which "35 mm equivalent" refers (CIPA DCG-001), millimetres.
const FULL_FRAME_DIAGONAL_MM: f64 = 43.266_615;
/// Horizontal fields of view outside this range are taken for wrong data, degrees.
const PLAUSIBLE_FOV_DEG: std::ops::RangeInclusive<f64> = 12.0..=135.0;
/// A photo whose shape differs by more than this from what EXIF says was cropped afterwards.
const MAX_ASPECT_CHANGE: f64 = 0.02;

/// What EXIF says.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct ExifFacts {
    /// 1 to 8.
    pub orientation: u8,
    equivalent_mm: Option<f64>,
    focal_mm: Option<f64>,
    /// Sensor pixels a millimetre, along x.
    sensor_px_per_mm: Option<f64>,
    /// Size the camera wrote, before turning.
    written: Option<(f64, f64)>,
}

/// A focal length and where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Focal {
    /// Pixels of the upright original.
    pub pixels: f64,
    pub source: String,
}

/// Reads EXIF; files without, and files with nonsense, give nothing.
pub(super) fn read(bytes: &[u8]) -> ExifFacts {
    let mut reader = exif::Reader::new();
    reader.continue_on_error(true);
    let found = match reader.read_from_container(&mut Cursor::new(bytes)) {
        Ok(exif) => Some(exif),
        Err(error) => error.distill_partial_result(|_| {}).ok(),
    };
    found.map_or_else(|| ExifFacts { orientation: 1, ..ExifFacts::default() }, |exif| facts(&exif))
}

fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    let field = exif.get_field(tag, In::PRIMARY)?;
    let value = match &field.value {
        Value::Rational(v) => v.first()?.to_f64(),
        Value::SRational(v) => v.first()?.to_f64(),
        Value::Float(v) => f64::from(*v.first()?),
        Value::Double(v) => *v.first()?,
        other => f64::from(other.get_uint(0)?),
    };
    (value.is_finite() && value > 0.0).then_some(value)
}

fn facts(exif: &Exif) -> ExifFacts {
    let unit_mm = match number(exif, Tag::FocalPlaneResolutionUnit).map(|u| u as u32) {
        Some(3) => 10.0,
        Some(4) => 1.0,
        Some(5) => 0.001,
        _ => 25.4,
    };
    let orientation = exif.get_field(Tag::Orientation, In::PRIMARY).and_then(|f| f.value.get_uint(0)).unwrap_or(1);
    ExifFacts {
        orientation: if (1..=8).contains(&orientation) { orientation as u8 } else { 1 },
        equivalent_mm: number(exif, Tag::FocalLengthIn35mmFilm),
        focal_mm: number(exif, Tag::FocalLength),
        sensor_px_per_mm: number(exif, Tag::FocalPlaneXResolution).map(|r| r / unit_mm),
        written: number(exif, Tag::PixelXDimension).zip(number(exif, Tag::PixelYDimension)),
    }
}

impl ExifFacts {
    /// Focal length in pixels of the upright original of this size, if it follows and is plausible.
    ///
    /// The 35 mm equivalent is read by diagonals, so that it holds for every sensor shape. `note` is told about values
    /// that are not used.
    pub fn focal_px(&self, size: ImageSize, note: &mut dyn FnMut(String)) -> Option<Focal> {
        let turned = self.orientation >= 5;
        let (width, height) = (f64::from(size.width), f64::from(size.height));
        let (stored_w, stored_h) = if turned { (height, width) } else { (width, height) };
        let written = self.written.unwrap_or((stored_w, stored_h));
        let (w, h) = written;
        let aspect_change = ((w / h) / (stored_w / stored_h)).ln().abs();
        let shape_kept = aspect_change <= MAX_ASPECT_CHANGE;
        let candidate = if let Some(mm) = self.equivalent_mm {
            let pixels = mm / FULL_FRAME_DIAGONAL_MM * stored_w.hypot(stored_h);
            Some(Focal { pixels, source: format!("EXIF: {mm} mm as of 35 mm film") })
        } else if let (Some(mm), Some(density)) = (self.focal_mm, self.sensor_px_per_mm) {
            let pixels = mm * density * stored_w / w;
            Some(Focal { pixels, source: format!("EXIF: {mm:.2} mm at {density:.1} sensor pixels per mm") })
        } else {
            None
        }?;
        if !shape_kept {
            note(format!(
                "EXIF speaks of {w:.0} x {h:.0} pixels, the photo was cropped since: its focal length is not used"
            ));
            return None;
        }
        let fov_deg = 2.0 * (width / 2.0 / candidate.pixels).atan().to_degrees();
        if !PLAUSIBLE_FOV_DEG.contains(&fov_deg) {
            note(format!(
                "the focal length in EXIF would mean a field of view of {fov_deg:.0} degrees and is not used"
            ));
            return None;
        }
        Some(candidate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts() -> ExifFacts {
        ExifFacts { orientation: 1, ..ExifFacts::default() }
    }

    #[test]
    fn a_full_frame_sensor_gives_the_focal_length_by_its_width_too() {
        // 3:2 at 28 mm equivalent: the horizontal field of view of a 28 mm lens on 36 mm is 65.47 degrees.
        let exif = ExifFacts { equivalent_mm: Some(28.0), ..facts() };
        let focal = exif.focal_px(ImageSize::new(6000, 4000), &mut |_| {}).unwrap();
        let fov = 2.0 * (3000.0 / focal.pixels).atan().to_degrees();
        assert!((fov - 65.47).abs() <= 0.01, "{fov}");
    }

    #[test]
    fn turned_photos_keep_their_focal_length() {
        let lying = ExifFacts { equivalent_mm: Some(26.0), written: Some((4032.0, 3024.0)), ..facts() };
        let standing = ExifFacts { orientation: 6, ..lying.clone() };
        let a = lying.focal_px(ImageSize::new(4032, 3024), &mut |_| {}).unwrap();
        let b = standing.focal_px(ImageSize::new(3024, 4032), &mut |_| {}).unwrap();
        assert!((a.pixels - b.pixels).abs() <= 1e-9);
    }

    #[test]
    fn sensor_resolution_is_used_and_scaled_with_the_photo() {
        // 24 mm on a sensor with 250 px per mm, photo halved since.
        let exif = ExifFacts {
            focal_mm: Some(24.0),
            sensor_px_per_mm: Some(250.0),
            written: Some((9000.0, 6000.0)),
            ..facts()
        };
        let focal = exif.focal_px(ImageSize::new(4500, 3000), &mut |_| {}).unwrap();
        assert!((focal.pixels - 3000.0).abs() <= 1e-9);
    }

    #[test]
    fn cropped_and_absurd_values_are_told_and_not_used() {
        let mut told = Vec::new();
        let cropped = ExifFacts { equivalent_mm: Some(26.0), written: Some((4000.0, 3000.0)), ..facts() };
        assert_eq!(cropped.focal_px(ImageSize::new(2000, 2000), &mut |t| told.push(t)), None);
        let absurd = ExifFacts { equivalent_mm: Some(2.0), ..facts() };
        assert_eq!(absurd.focal_px(ImageSize::new(2000, 1500), &mut |t| told.push(t)), None);
        assert_eq!(told.len(), 2);
    }
}
