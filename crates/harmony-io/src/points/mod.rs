//! Point maps and depth images.

use std::path::{Path, PathBuf};

use harmony_scene::{ImageSize, Intrinsics, PointMap, PointMapKind};

use crate::atomic::FileError;

/// Where the estimator puts pixel centres in the intrinsics it gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelCentres {
    /// The centre of the top-left pixel is (0.5, 0.5), as everywhere here.
    #[default]
    Half,
    /// The centre of the top-left pixel is (0, 0) (VGGT, Kinect calibrations): 0.5 is added to cx and cy.
    Integer,
}

/// How a map's grid covers the photo.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MapFit {
    /// Stretched when the shapes agree within 6 %, padded when the map is square and the photo is wide; else an error.
    #[default]
    Auto,
    /// The map covers the whole photo, each axis scaled by its own factor.
    Stretched,
    /// The photo was fitted into the map's grid and padded on two sides (VGGT "pad"): the padding is cut off.
    Padded,
    /// The map covers a centred part of the photo at full width (VGGT "crop"): the rest gets no points.
    Cropped,
}

/// What is known beside the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointMapOptions {
    /// Size of the photo the map belongs to.
    pub photo_size: ImageSize,
    /// Intrinsics in pixels of the photo; they win over those in the file.
    pub intrinsics: Option<Intrinsics>,
    /// Depth units a metre (1000 = millimetres, 5000 = TUM); `None` = 1000 for integer depth, 1 for float.
    pub depth_scale: Option<f64>,
    /// Convention of the intrinsics, whether given or in the file; our own files say it themselves.
    pub pixel_centres: PixelCentres,
    /// Which frame of a file with several.
    pub frame: usize,
    /// How the grid covers the photo.
    pub fit: MapFit,
    /// What the points mean; `None` = as the file says, else relative for point maps and metric for integer depth.
    pub kind: Option<PointMapKind>,
}

impl PointMapOptions {
    /// Nothing known but the photo's size.
    pub fn new(photo_size: ImageSize) -> Self {
        Self {
            photo_size,
            intrinsics: None,
            depth_scale: None,
            pixel_centres: PixelCentres::Half,
            frame: 0,
            fit: MapFit::Auto,
            kind: None,
        }
    }
}

/// A point map cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PointsError {
    /// The file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file name's extension is not one of those read.
    #[error("point maps are .npz, depth images .png or .pgm: {path}")]
    UnknownFormat {
        /// Which file.
        path: PathBuf,
    },
}

/// Reads a point map or a depth image.
///
/// # Errors
/// [`PointsError`].
pub fn load_point_map(path: &Path, options: &PointMapOptions) -> Result<PointMap, PointsError> {
    let _ = options;
    Err(PointsError::UnknownFormat { path: path.to_owned() })
}

/// Writes `points.npz`.
///
/// # Errors
/// [`PointsError::File`].
pub fn save_point_map(path: &Path, map: &PointMap) -> Result<(), PointsError> {
    let _ = map;
    Err(PointsError::UnknownFormat { path: path.to_owned() })
}

/// Parses `fx,fy,cx,cy`.
///
/// # Errors
/// [`PointsError`].
pub fn parse_intrinsics(text: &str) -> Result<Intrinsics, PointsError> {
    Err(PointsError::UnknownFormat { path: text.into() })
}
