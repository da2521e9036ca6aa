//! Point maps and depth images.
//!
//! | file | read as |
//! |---|---|
//! | `.npz` with points (H, W, 3) | point map: our own `points.npz`, VGGT's predictions, and their like |
//! | `.npz` with depth (H, W) and intrinsics | planar depth |
//! | `.npy` of shape (H, W, 3) or (H, W) | point map in the camera's frame, or planar depth |
//! | 16-bit `.png`, `.pgm` | planar depth of a sensor; 0 and 65535 = none |

mod archive;
mod fit;

use std::path::{Path, PathBuf};

use harmony_scene::{ImageSize, Intrinsics, PointMap, PointMapKind};

use crate::atomic::{FileError, read_bounded};
use crate::npz::{self, NpyEntry, NpzError};
use crate::picture::{self, PictureError};

/// Depth units a metre when an integer depth image says nothing else (millimetres).
pub const DEFAULT_DEPTH_SCALE: f64 = 1000.0;

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
    /// The arrays cannot be read.
    #[error(transparent)]
    Npz(#[from] NpzError),
    /// The depth image cannot be decoded.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The file name's extension is not one of those read.
    #[error("point maps are .npz or .npy, depth images .png or .pgm: {path}")]
    UnknownFormat {
        /// Which file.
        path: PathBuf,
    },
    /// The image holds colours or 8 bits.
    #[error("a depth image has one channel of 16 bits, this one is {found}")]
    NotDepth {
        /// What it is.
        found: &'static str,
    },
    /// Neither points nor depth in the archive.
    #[error("neither points (H, W, 3) nor depth (H, W) are among the arrays: {names}")]
    NoPoints {
        /// What is there.
        names: String,
    },
    /// An array has another shape than expected.
    #[error("array {name} has the shape {shape:?}, expected {expected}")]
    Shape {
        /// Array.
        name: String,
        /// Its shape.
        shape: Vec<usize>,
        /// In words.
        expected: &'static str,
    },
    /// The frame asked for is not there.
    #[error("there are {count} frames, frame {frame} was asked for")]
    NoSuchFrame {
        /// Asked for (from 0).
        frame: usize,
        /// Number of frames.
        count: usize,
    },
    /// The lens is not known.
    #[error("the intrinsics of the depth image are not known")]
    NoIntrinsics,
    /// The text is not four numbers.
    #[error("intrinsics are given as fx,fy,cx,cy in pixels, got {text:?}")]
    BadIntrinsics {
        /// What was given, shortened.
        text: String,
    },
    /// The intrinsics are not those of a lens.
    #[error("these intrinsics are not plausible: {intrinsics:?}")]
    Implausible {
        /// The numbers.
        intrinsics: Intrinsics,
    },
    /// The depth scale is not a positive number.
    #[error("the depth scale must be a positive number, got {scale}")]
    DepthScale {
        /// Given.
        scale: f64,
    },
    /// The extrinsic matrix is not a rigid motion.
    #[error("the camera's rotation in the file is no rotation (error {error:.3})")]
    NotRigid {
        /// Largest deviation of R^T R from the identity.
        error: f64,
    },
    /// Points and camera do not belong together.
    #[error("the points do not project back to their pixels: median error {median_px:.1} px of {width} px width")]
    Inconsistent {
        /// Median reprojection error, pixels of the map.
        median_px: f64,
        /// Width of the map.
        width: u32,
    },
    /// Hardly any pixel has a point.
    #[error("only {valid} of {count} pixels have a point")]
    TooFew {
        /// Finite points in front of the camera.
        valid: usize,
        /// Pixels.
        count: usize,
    },
    /// The map's shape does not fit the photo's.
    #[error("the map has {map_width} x {map_height} pixels, the photo {photo_width} x {photo_height}")]
    Aspect {
        /// Map columns.
        map_width: u32,
        /// Map rows.
        map_height: u32,
        /// Photo columns.
        photo_width: u32,
        /// Photo rows.
        photo_height: u32,
    },
}

impl PointsError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::Picture(e) => e.hint(),
            Self::Npz(_) => Some("write it with numpy.savez from plain float arrays"),
            Self::UnknownFormat { .. } => Some("give the file the extension of its content, or convert it"),
            Self::NotDepth { .. } => Some("save depth as 16-bit greyscale PNG or PGM, for example in millimetres"),
            Self::NoPoints { .. } | Self::Shape { .. } => Some(
                "the arrays are described in docs/run-folder.md under points.npz: world_points, confidence, intrinsic, extrinsic",
            ),
            Self::NoSuchFrame { .. } => Some("frames count from 0"),
            Self::NoIntrinsics | Self::BadIntrinsics { .. } | Self::Implausible { .. } => {
                Some("give the lens of the photo as fx,fy,cx,cy in pixels, for example 518.9,519.5,325.6,253.7")
            }
            Self::DepthScale { .. } => Some("1000 for millimetres, 5000 for TUM"),
            Self::NotRigid { .. } => Some("extrinsic is [R | t] with x_cam = R x + t"),
            Self::Inconsistent { .. } => Some(
                "check that extrinsic is camera_from_world (not its inverse), that intrinsic is in pixels of the map, and the frame",
            ),
            Self::TooFew { .. } => Some("check the depth scale and that the file belongs to the photo"),
            Self::Aspect { .. } => Some(
                "state how the map covers the photo (stretched, padded or cropped), or check that they belong together",
            ),
        }
    }
}

/// Reads a point map or a depth image.
///
/// The result covers the whole photo (each axis by its own factor), points to the side of the camera and behind it are
/// taken out, and what the file says about the camera is checked against the points.
///
/// # Errors
/// [`PointsError`], each with a [`PointsError::hint`] where there is something to do.
pub fn load_point_map(path: &Path, options: &PointMapOptions) -> Result<PointMap, PointsError> {
    if let Some(scale) = options.depth_scale
        && !(scale.is_finite() && scale > 0.0)
    {
        return Err(PointsError::DepthScale { scale });
    }
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let map = match extension.as_str() {
        "npz" => {
            archive::from_arrays(&npz::parse_npz(&read_bounded(path, npz::MAX_FILE_BYTES)?, archive::known)?, options)
        }
        "npy" => {
            let array = npz::parse_npy("depth", &read_bounded(path, npz::MAX_FILE_BYTES)?)?;
            let name = if array.shape.last() == Some(&3) { "world_points" } else { "depth" };
            archive::from_arrays(&[(name.to_owned(), array)].into(), options)
        }
        "png" | "pgm" | "tif" | "tiff" => depth_image(path, options),
        _ => return Err(PointsError::UnknownFormat { path: path.to_owned() }),
    }?;
    let map = fit::cover_photo(map, options)?;
    checked(map)
}

/// Parses `fx,fy,cx,cy`.
///
/// # Errors
/// [`PointsError::BadIntrinsics`] or [`PointsError::Implausible`].
pub fn parse_intrinsics(text: &str) -> Result<Intrinsics, PointsError> {
    let bad = || PointsError::BadIntrinsics { text: text.chars().take(80).collect() };
    let numbers: Vec<f64> = text
        .split([',', ' ', ';'])
        .filter(|p| !p.is_empty())
        .map(str::parse)
        .collect::<Result<_, _>>()
        .map_err(|_| bad())?;
    let [fx, fy, cx, cy] = numbers.try_into().map_err(|_| bad())?;
    plausible(Intrinsics { fx, fy, cx, cy })
}

fn plausible(k: Intrinsics) -> Result<Intrinsics, PointsError> {
    let ok = [k.fx, k.fy, k.cx, k.cy].iter().all(|v| v.is_finite())
        && k.fx > 0.0
        && k.fy > 0.0
        && (0.25..=4.0).contains(&(k.fx / k.fy));
    if ok { Ok(k) } else { Err(PointsError::Implausible { intrinsics: k }) }
}

/// Intrinsics with pixel centres at one half.
fn half_centred(k: Intrinsics, centres: PixelCentres) -> Intrinsics {
    match centres {
        PixelCentres::Half => k,
        PixelCentres::Integer => Intrinsics { cx: k.cx + 0.5, cy: k.cy + 0.5, ..k },
    }
}

fn depth_image(path: &Path, options: &PointMapOptions) -> Result<PointMap, PointsError> {
    use image::DynamicImage as D;
    let picture = picture::read(path)?;
    let D::ImageLuma16(depth) = picture else {
        let found = match picture {
            D::ImageLuma8(_) | D::ImageLumaA8(_) => "grey with 8 bits",
            _ => "a colour image",
        };
        return Err(PointsError::NotDepth { found });
    };
    let size = ImageSize::new(depth.width(), depth.height());
    let scale = options.depth_scale.unwrap_or(DEFAULT_DEPTH_SCALE);
    let metres: Vec<f32> = depth
        .as_raw()
        .iter()
        .map(|d| if matches!(*d, 0 | u16::MAX) { 0.0 } else { (f64::from(*d) / scale) as f32 })
        .collect();
    let given = options.intrinsics.ok_or(PointsError::NoIntrinsics)?;
    let k = fit::given_for_map(plausible(half_centred(given, options.pixel_centres))?, size, options)?;
    Ok(PointMap::from_depth(options.kind.unwrap_or(PointMapKind::Metric), size, k, &metres))
}

/// Takes out impossible points, and refuses maps that contradict themselves.
fn checked(mut map: PointMap) -> Result<PointMap, PointsError> {
    let mut errors = Vec::new();
    let mut valid = 0;
    let count = map.size.pixels();
    let step = (count / 20_000).max(1);
    for i in 0..count {
        let p = map.rotation * map.xyz[i].as_dvec3() + map.translation;
        if !(p.is_finite() && p.z > 1e-6 && map.confidence[i] > 0.0) {
            map.xyz[i] = glam::Vec3::NAN;
            map.confidence[i] = 0.0;
            continue;
        }
        if valid % step == 0 {
            let k = &map.intrinsics;
            let (x, y) = (i as u32 % map.size.width, i as u32 / map.size.width);
            let du = k.fx * p.x / p.z + k.cx - f64::from(x) - 0.5;
            let dv = k.fy * p.y / p.z + k.cy - f64::from(y) - 0.5;
            errors.push(du.hypot(dv));
        }
        valid += 1;
    }
    if valid * 100 < count || valid < 16 {
        return Err(PointsError::TooFew { valid, count });
    }
    errors.sort_by(f64::total_cmp);
    let median_px = errors[errors.len() / 2];
    if median_px > 0.05 * f64::from(map.size.width) {
        return Err(PointsError::Inconsistent { median_px, width: map.size.width });
    }
    Ok(map)
}

/// Writes `points.npz`: `world_points`, `confidence`, `intrinsic`, `extrinsic`, `pixel_centre` and `kind`.
///
/// # Errors
/// [`PointsError::File`], [`PointsError::Npz`].
pub fn save_point_map(path: &Path, map: &PointMap) -> Result<(), PointsError> {
    let (h, w) = (map.size.height as usize, map.size.width as usize);
    let k = map.intrinsics;
    let rows = map.rotation.transpose();
    let extrinsic =
        [(rows.x_axis, map.translation.x), (rows.y_axis, map.translation.y), (rows.z_axis, map.translation.z)];
    let kind = match map.kind {
        PointMapKind::Relative => "relative",
        PointMapKind::Metric => "metric",
        PointMapKind::RoomBox => "room_box",
    };
    let entries = [
        NpyEntry::f32("world_points", &[h, w, 3], map.xyz.iter().flat_map(glam::Vec3::to_array)),
        NpyEntry::f32("confidence", &[h, w], map.confidence.iter().copied()),
        NpyEntry::f64("intrinsic", &[3, 3], [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0]),
        NpyEntry::f64("extrinsic", &[3, 4], extrinsic.into_iter().flat_map(|(r, t)| [r.x, r.y, r.z, t])),
        NpyEntry::f64("pixel_centre", &[], [0.5]),
        NpyEntry::text("kind", kind),
    ];
    Ok(npz::write_npz(path, &entries)?)
}

#[cfg(test)]
mod tests;
