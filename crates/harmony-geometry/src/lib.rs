//! The paper's layout and camera mathematics, and what this project adds to it.
//!
//! * [`calibrate`]: point map -> Manhattan frame -> planes -> deepest corner -> one similarity -> camera
//!   (paper Sec. 3.1, App. B.2, Algorithm 1);
//! * [`estimate_view`]: one photo without depth -> line segments -> vanishing points -> focal length and rotation;
//! * [`estimate_room_box`], [`solve_from_pins`]: view + prior (+ pinned room edges) -> camera and box in metres;
//! * [`measure_shape`]: blocks, niches and slopes of rooms that are not boxes;
//! * [`measure_openings`], [`rise_of`]: openings that were outlined, rounded tops;
//! * small tools: PCA, de-tilt, robust means, Levenberg-Marquardt.
//!
//! Nothing here knows that models exist: what a model said arrives as a [`LayoutPrior`].
//! Frames, units and signs are those of `harmony_scene`.

pub mod align;
mod calibration;
mod image;
pub mod least_squares;
mod lines;
pub mod manhattan;
mod pca;
pub mod planes;
mod prior;
mod room_box;
mod room_openings;
mod room_shape;
mod stats;
pub mod surfels;
mod vanishing;

pub use calibration::{
    AnchorKind, Calibration, CalibrationError, CalibrationEvidence, CalibrationMethod, CalibrationSettings,
    JointEvidence, PlaneEvidence, RIGHT_POSITION_M, RIGHT_ROTATION_DEG, RoomPosterior, calibrate, calibrate_with_photo,
    room_from_unknowns, room_unknowns,
};
pub use image::{GrayImage, ImageError};
pub use lines::{LineSegment, detect_segments};
pub use pca::{Axes, detilt, pca};
pub use prior::{CameraHints, LayoutPins, LayoutPrior, PinnedEdge, RoomEdge, WallSide};
pub use room_box::{RoomBox, RoomBoxEvidence, RoomBoxMethod, SolveError, estimate_room_box, solve_from_pins};
pub use room_openings::{OpeningHint, measure_openings, rise_of};
pub use room_shape::{MapInRoom, MeasuredShape, ShapeHint, ShapeKind, measure_shape};
pub use stats::{MAD_TO_SIGMA, median, median_absolute_deviation, percentile, robust_mean_scalar};
pub use vanishing::{
    FocalPrior, FocalSource, ViewEstimate, camera_rotation, estimate_view, estimate_view_from_segments,
};
