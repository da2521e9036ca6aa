//! Pictures of the run folder as data addresses.

use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use harmony_io::picture;
use image::DynamicImage;

/// Longest side of the large pictures, pixels.
pub(crate) const LARGE: u32 = 1600;
/// Longest side of crops and mesh views, pixels.
pub(crate) const SMALL: u32 = 360;
/// JPEG quality of embedded pictures.
const QUALITY: u8 = 86;

/// A picture in the page.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    /// `data:` address.
    pub src: String,
    /// Columns of the embedded picture.
    pub width: u32,
    /// Rows of the embedded picture.
    pub height: u32,
}

impl Picture {
    /// Scales down and encodes.
    pub(crate) fn new(image: DynamicImage, longest: u32) -> Option<Self> {
        let size = harmony_scene::ImageSize::new(image.width(), image.height()).fit_within(longest);
        let image = if size.width < image.width() { image.thumbnail_exact(size.width, size.height) } else { image };
        let rgba = image.to_rgba8();
        let opaque = rgba.pixels().all(|p| p.0[3] == 255);
        let (bytes, mime) = if opaque {
            (picture::rgb_jpeg(&image.into_rgb8(), QUALITY).ok()?, "image/jpeg")
        } else {
            (picture::rgba_png(&rgba).ok()?, "image/png")
        };
        let src = format!("data:{mime};base64,{}", STANDARD.encode(bytes));
        Some(Self { src, width: rgba.width(), height: rgba.height() })
    }

    /// Reads one file of the run folder; `None` when it is not there or not a picture.
    pub(crate) fn read(run: &Path, relative: &str, longest: u32) -> Option<Self> {
        Self::new(picture::read(&inside(run, relative)?).ok()?, longest)
    }

    /// The photo, upright.
    pub(crate) fn photo(run: &Path) -> Option<Self> {
        ["jpg", "png", "webp", "tif", "bmp", "pnm", "jpeg", "tiff"]
            .iter()
            .map(|e| run.join(format!("input.{e}")))
            .find(|p| p.is_file())
            .and_then(|p| harmony_io::load_photo(&p).ok())
            .and_then(|photo| Self::new(DynamicImage::ImageRgb8(photo.image), LARGE))
    }
}

/// A relative path in the run folder; `None` when it would leave it.
pub(crate) fn inside(run: &Path, relative: &str) -> Option<PathBuf> {
    let path = Path::new(relative);
    let plain = !relative.is_empty() && path.components().all(|c| matches!(c, Component::Normal(_)));
    let full = run.join(path);
    (plain && full.is_file()).then_some(full)
}

/// Bytes as base64.
pub(crate) fn base64(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_that_leave_the_run_folder_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        std::fs::create_dir_all(run.join("a")).unwrap();
        std::fs::write(folder.path().join("secret.png"), b"x").unwrap();
        std::fs::write(run.join("a/x.png"), b"x").unwrap();
        assert!(inside(&run, "a/x.png").is_some());
        let absolute = folder.path().join("secret.png");
        for bad in ["", "../secret.png", "a/../../secret.png", "a", "none.png", &absolute.to_string_lossy()] {
            assert!(inside(&run, bad).is_none(), "{bad}");
        }
        assert!(Picture::read(&run, "a/x.png", 10).is_none(), "not a picture");
    }

    #[test]
    fn pictures_are_scaled_down_never_up() {
        let small = Picture::new(DynamicImage::new_rgb8(20, 10), SMALL).unwrap();
        assert_eq!((small.width, small.height), (20, 10));
        assert!(small.src.starts_with("data:image/jpeg;base64,"));
        let large = Picture::new(DynamicImage::new_rgba8(4000, 1000), LARGE).unwrap();
        assert_eq!((large.width, large.height), (1600, 400));
        assert!(large.src.starts_with("data:image/png;base64,"));
    }
}
