//! What goes in and what comes out.

use glam::{DMat3, DVec3};
use harmony_mesh::Mesh;
use harmony_scene::{ImageSize, Mask, Pose};
use image::RgbaImage;

/// A mesh somewhere in the room.
#[derive(Debug, Clone, Copy)]
pub struct Instance<'a> {
    /// The mesh in its own frame.
    pub mesh: &'a Mesh,
    /// `room_from_object` linear part (may stretch and mirror).
    pub linear: DMat3,
    /// `room_from_object` translation.
    pub translation: DVec3,
    /// Written into [`Frame::ids`]; 0 means nothing was drawn.
    pub id: u32,
}

impl<'a> Instance<'a> {
    /// A mesh posed in the room.
    pub fn posed(mesh: &'a Mesh, pose: &Pose, id: u32) -> Self {
        Self { mesh, linear: pose.linear(), translation: pose.position, id }
    }

    /// A mesh that is already in room coordinates.
    pub fn in_room(mesh: &'a Mesh, id: u32) -> Self {
        Self { mesh, linear: DMat3::IDENTITY, translation: DVec3::ZERO, id }
    }
}

/// How surfaces are shaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Lighting {
    /// The texture as it is: flat ambient light, the paper's `pyrender` set-up.
    #[default]
    Unlit,
    /// A white light at the camera: shape can be read from it.
    HeadLight,
}

/// What to draw and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderOptions {
    /// Shading.
    pub lighting: Lighting,
    /// 4x multisampling of the colour (depth and ids stay one sample, at the pixel centre).
    pub multisample: bool,
    /// sRGB colour and alpha where nothing is drawn.
    pub background: [u8; 4],
    /// Nearest drawn depth, metres.
    pub near: f64,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self { lighting: Lighting::Unlit, multisample: false, background: [0, 0, 0, 0], near: 0.05 }
    }
}

/// The result, one value a pixel, row-major.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Image size.
    pub size: ImageSize,
    /// sRGB colour.
    pub color: RgbaImage,
    /// Planar depth in metres; 0 where nothing was drawn.
    pub depth: Vec<f32>,
    /// Id of the nearest instance; 0 where nothing was drawn.
    pub ids: Vec<u32>,
}

impl Frame {
    /// The pixels where an instance is the nearest.
    pub fn mask(&self, id: u32) -> Mask {
        let width = self.size.width as usize;
        Mask::from_fn(self.size, |x, y| self.ids[y as usize * width + x as usize] == id)
    }
}
