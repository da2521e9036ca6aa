//! The finished scene, `scene.json`.

use std::collections::BTreeSet;

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Camera, ImageSize, Intrinsics, Lighting, ObjectId, Pose, Room, SceneObject, Size, Surface, Warning,
    object::gone_with,
};

/// Version of `scene.json`; raised when a reader would have to change.
pub const SCENE_VERSION: u32 = 1;

/// The camera as it is written: rows of R, and what follows from it for readers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SceneCamera {
    /// Image size, pixels.
    pub size: ImageSize,
    /// Pinhole parameters; the centre of the top-left pixel is (0.5, 0.5).
    pub intrinsics: Intrinsics,
    /// Rows of `camera_from_room` R (OpenCV axes).
    pub rotation: [[f64; 3]; 3],
    /// `camera_from_room` t, metres.
    pub translation: [f64; 3],
    /// Centre of projection in the room, metres.
    pub centre: [f64; 3],
}

impl From<&Camera> for SceneCamera {
    fn from(camera: &Camera) -> Self {
        let r = camera.rotation.transpose();
        Self {
            size: camera.size,
            intrinsics: camera.intrinsics,
            rotation: [r.x_axis.to_array(), r.y_axis.to_array(), r.z_axis.to_array()],
            translation: camera.translation.to_array(),
            centre: camera.centre().to_array(),
        }
    }
}

impl From<&SceneCamera> for Camera {
    fn from(camera: &SceneCamera) -> Self {
        let rows = camera.rotation.map(DVec3::from_array);
        Self {
            size: camera.size,
            intrinsics: camera.intrinsics,
            rotation: DMat3::from_cols(rows[0], rows[1], rows[2]).transpose(),
            translation: DVec3::from_array(camera.translation),
        }
    }
}

/// The scene: room, camera, objects, light, and what is to be said about them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scene {
    /// [`SCENE_VERSION`].
    pub version: u32,
    /// What made it, with its version.
    pub generator: String,
    /// The room.
    pub room: Room,
    /// The photo's camera in the room.
    pub camera: SceneCamera,
    /// Objects in placement order.
    pub objects: Vec<SceneObject>,
    /// Light.
    pub lighting: Lighting,
    /// One paragraph about the scene.
    pub summary: String,
    /// Everything that went another way than intended.
    pub warnings: Vec<Warning>,
}

impl Scene {
    /// Where each object stands, and how large it is.
    pub fn stands(&self) -> Vec<(Pose, Size)> {
        self.objects.iter().map(|o| (o.pose, o.size)).collect()
    }

    /// What a view without some of the room's faces leaves out with them ([`gone_with`]).
    pub fn gone_with(&self, omit: &[Surface]) -> BTreeSet<&ObjectId> {
        let held = self.objects.iter().map(|o| (&o.id, &o.support, o.pose.position.y));
        gone_with(omit, self.room.extents.height, held)
    }
}
