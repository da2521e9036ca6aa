//! Files: photos in, point maps and masks in and out, GLB in and out, atomic writes.
//!
//! Whatever is read here is untrusted: sizes are bounded before memory is taken, and every failure is an error with
//! the numbers that failed, the path, and (where one exists) a hint for the person at the keyboard.
//!
//! | module | holds |
//! |---|---|
//! | [`atomic`] | bytes and JSON written under a temporary name, then renamed |
//! | [`picture`] | PNG and JPEG, encoded and decoded within limits |
//! | [`photo`] | the photo: upright sRGB, EXIF focal length, what was unusual about it |
//! | [`points`] | point maps (`.npz`) and depth images (PNG, PGM) |
//! | [`npz`] | NumPy arrays in and out |
//! | [`masks`] | instance masks of others, our own one-bit masks, `segmentation.png` |
//! | [`glb`] | the scene as a GLB file, and GLB files of others as meshes |
//! | [`lit`] | what of a run folder is path-traced |

pub mod atomic;
pub mod glb;
pub mod lit;
pub mod masks;
pub mod npz;
pub mod photo;
pub mod picture;
pub mod points;

pub use atomic::{FileError, read_bounded, read_json, write_atomic, write_durable, write_json};
pub use glb::{
    GlbError, GlbNode, GlbScene, LoadedGlb, LoadedNode, NodeGroup, NodeTransform, ReadLimits, TextureEncoding,
    glb_bytes, glb_bytes_grouped, load_glb, load_mesh_glb, punctual_intensity, read_glb, write_glb, write_mesh_glb,
};
pub use lit::{albedo_field, scene_for_light};
pub use masks::{
    LoadedMask, LoadedMasks, MaskError, Segment, SegmentEntry, SegmentationFile, index_color, load_mask, load_masks,
    save_mask, save_segmentation,
};
pub use photo::{Photo, PhotoError, load_photo, photo_from_bytes};
pub use points::{
    MapFit, PixelCentres, PointMapOptions, PointsError, load_point_map, parse_intrinsics, save_point_map,
};
