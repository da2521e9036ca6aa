//! What goes in and what comes out.

use glam::{DMat3, DVec3};
use harmony_mesh::Mesh;
use harmony_scene::{ImageSize, Mask, PixelBox, Pose};
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

/// What depth and ids say of see-through surfaces ([`crate::opacity`] below [`crate::SOLID`]). Colour always shows what is
/// behind them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Glass {
    /// They are surfaces like all others: what is nearest counts.
    #[default]
    Solid,
    /// What is seen through them counts, unless that is nothing or the instance `backdrop` (the room): there the glass
    /// keeps its pixel, so that it has a silhouette of its own and hides nothing.
    Clear {
        /// Id of the instance that counts as nothing behind glass; 0 for none.
        backdrop: u32,
    },
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
    /// What depth and ids say of see-through surfaces.
    pub glass: Glass,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            lighting: Lighting::Unlit,
            multisample: false,
            background: [0, 0, 0, 0],
            near: 0.05,
            glass: Glass::Solid,
        }
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

impl Frame {
    /// Draws a piece over this frame: where the piece is nearer (or nothing was drawn here), it replaces the pixel.
    ///
    /// Equal depths keep what was there, as instance order does within one pass. The piece's colour must not be
    /// multisampled against another background than this frame's, or its edge shows that background.
    ///
    /// # Panics
    /// When the piece was rendered for another image size.
    pub fn overlay(&mut self, piece: &WindowFrame) {
        assert_eq!(self.size, piece.window.image, "frame and piece belong to one image size");
        let row = self.size.width as usize;
        for (y, x, i) in piece.window.indices() {
            let z = piece.frame.depth[i];
            let j = y as usize * row + x as usize;
            if nearer(z, self.depth[j]) {
                self.depth[j] = z;
                self.ids[j] = piece.frame.ids[i];
                let (px, py) = (x - piece.window.x0, y - piece.window.y0);
                self.color.put_pixel(x, y, *piece.frame.color.get_pixel(px, py));
            }
        }
    }

    /// Depth and ids alone.
    pub fn depth_ids(&self) -> DepthFrame {
        DepthFrame { window: Window::full(self.size), depth: self.depth.clone(), ids: self.ids.clone() }
    }
}

/// Whether a drawn depth `z` comes before what is there (0 = nothing, on either side).
fn nearer(z: f32, there: f32) -> bool {
    z > 0.0 && (there == 0.0 || z < there)
}

/// A rectangle of whole pixels inside an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// The whole image, the camera's size.
    pub image: ImageSize,
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// Columns and rows of the window.
    pub size: ImageSize,
}

impl Window {
    /// The whole image.
    pub fn full(image: ImageSize) -> Self {
        Self { image, x0: 0, y0: 0, size: image }
    }

    /// The pixels that a box touches, cut to the image; of zero size when it touches none.
    pub fn covering(image: ImageSize, b: &PixelBox) -> Self {
        // `as` saturates and takes NaN to 0, so any box is safe.
        let x0 = (b.x0.floor().max(0.0) as u32).min(image.width);
        let y0 = (b.y0.floor().max(0.0) as u32).min(image.height);
        let x1 = (b.x1.ceil().max(0.0) as u32).min(image.width);
        let y1 = (b.y1.ceil().max(0.0) as u32).min(image.height);
        Self { image, x0, y0, size: ImageSize::new(x1.saturating_sub(x0), y1.saturating_sub(y0)) }
    }

    /// Whether it holds no pixel.
    pub fn is_empty(&self) -> bool {
        self.size.pixels() == 0
    }

    /// The window as a box.
    pub fn pixel_box(&self) -> PixelBox {
        PixelBox {
            x0: self.x0.into(),
            y0: self.y0.into(),
            x1: f64::from(self.x0) + f64::from(self.size.width),
            y1: f64::from(self.y0) + f64::from(self.size.height),
        }
    }

    /// (row, column, index in the window's buffers) of every pixel, row and column in the image.
    pub fn indices(&self) -> impl Iterator<Item = (u32, u32, usize)> + use<> {
        let Self { x0, y0, size, .. } = *self;
        (0..size.height)
            .flat_map(move |y| (0..size.width).map(move |x| (y0 + y, x0 + x, (y * size.width + x) as usize)))
    }

    /// The full-image mask of the window's pixels for which `f(index in the window's buffers)` holds.
    pub fn mask(&self, mut f: impl FnMut(usize) -> bool) -> Mask {
        let mut mask = Mask::empty(self.image);
        for (y, x, i) in self.indices() {
            if f(i) {
                mask.set(x, y, true);
            }
        }
        mask
    }
}

/// A frame of a part of the image; `frame.size` is the window's size.
#[derive(Debug, Clone)]
pub struct WindowFrame {
    /// Where in the image.
    pub window: Window,
    /// The pixels of the window.
    pub frame: Frame,
}

/// Depth and ids without colour, of the whole image or a window of it.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthFrame {
    /// Where in the image.
    pub window: Window,
    /// Planar depth in metres; 0 where nothing was drawn.
    pub depth: Vec<f32>,
    /// Id of the nearest instance; 0 where nothing was drawn.
    pub ids: Vec<u32>,
}

impl DepthFrame {
    /// Full-image mask of the pixels where an instance is the nearest.
    pub fn mask(&self, id: u32) -> Mask {
        self.window.mask(|i| self.ids[i] == id)
    }

    /// Full-image mask of everything that was drawn: an object's silhouette when it was rendered alone.
    pub fn silhouette(&self) -> Mask {
        self.window.mask(|i| self.depth[i] > 0.0)
    }

    /// Full-image mask of the pixels where this (an object rendered alone) is nearer than the rendered scene.
    ///
    /// `scene_depth` is the whole image, row-major, 0 where nothing is.
    ///
    /// # Panics
    /// When `scene_depth` has not one value a pixel of the image.
    pub fn visible_against(&self, scene_depth: &[f32]) -> Mask {
        assert_eq!(scene_depth.len(), self.window.image.pixels(), "one depth a pixel");
        let row = self.window.image.width as usize;
        let mut mask = Mask::empty(self.window.image);
        for (y, x, i) in self.window.indices() {
            if nearer(self.depth[i], scene_depth[y as usize * row + x as usize]) {
                mask.set(x, y, true);
            }
        }
        mask
    }

    /// Draws a piece over this frame; see [`Frame::overlay`]. Pixels of the piece outside this window are left out.
    ///
    /// # Panics
    /// When the piece was rendered for another image size.
    pub fn overlay(&mut self, piece: &Self) {
        assert_eq!(self.window.image, piece.window.image, "frame and piece belong to one image size");
        let w = self.window;
        for (y, x, i) in piece.window.indices() {
            let (Some(dx), Some(dy)) = (x.checked_sub(w.x0), y.checked_sub(w.y0)) else { continue };
            if dx >= w.size.width || dy >= w.size.height {
                continue;
            }
            let j = (dy * w.size.width + dx) as usize;
            if nearer(piece.depth[i], self.depth[j]) {
                self.depth[j] = piece.depth[i];
                self.ids[j] = piece.ids[i];
            }
        }
    }
}
