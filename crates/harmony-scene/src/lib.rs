//! The vocabulary of HARMONY: what a photo, a room, an object, a light and a scene are.
//!
//! Types only: no files, no rendering, no models. Every other crate speaks in these words.
//! Frames, units and signs are fixed once, in `docs/conventions.md`:
//!
//! * metres, radians; degrees only where the name ends in `_deg`;
//! * the **room frame** is glTF's: +X width, +Y up, +Z from the back wall towards the viewer, the
//!   room fills `[0,W] x [0,H] x [0,D]`;
//! * the **camera** is OpenCV's: x right, y down, z forward, `x_cam = R x_room + t`, and the centre
//!   of the top-left pixel is (0.5, 0.5);
//! * yaw turns about +Y, 0 = front towards +Z, counter-clockwise seen from above.

mod camera;
mod components;
mod ids;
mod light;
mod material;
mod moving;
mod object;
mod points;
mod raster;
mod room;
mod scene;
mod shape;
mod similarity;
mod turn;
mod warning;

pub use camera::{Camera, ImageSize, Intrinsics, Ray};
pub use components::components;
pub use ids::{IdError, ObjectId};
pub use light::{AlbedoCells, AlbedoField, Light, LightKind, Lighting, ViewTransform};
pub use material::{MaterialCategory, PbrFactors, Physical, RigidEstimate, SurfaceMaterial};
pub use moving::{Motion, MovingPart};
pub use object::{
    Confidence, DepthPosition, Level, Placement, PlacementType, Pose, Relations, SceneObject, Size, Support,
    SurfacePosition, WallAffinity, gone_with,
};
pub use points::{PointMap, PointMapKind};
pub use raster::{Mask, PixelBox};
pub use room::{Extents, Opening, OpeningKind, Room, Surface, SurfaceTexture, Wall};
pub use scene::{SCENE_VERSION, Scene, SceneCamera};
pub use shape::{Block, Exit, Ledge, LedgeTop, Niche, RoomFace, RoomFaces, RoomShape, Slope, WallPlane, clipped};
pub use similarity::Similarity;
pub use turn::QuarterTurn;
pub use warning::{Warning, WarningKind};

pub use glam::{DMat3 as Mat3, DVec2 as Vec2, DVec3 as Vec3};
