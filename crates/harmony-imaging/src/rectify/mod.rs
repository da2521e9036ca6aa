//! Planar things seen head-on: quadrilaterals of a photo, and the faces of the room (key `wall.rectify`).

mod quad;
mod sampling;

use glam::DVec2;
use harmony_scene::{Camera, ImageSize, Mask, Ray, RoomFaces, Surface};
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
    pub fn whole(surface: Surface, extents: &harmony_scene::Extents) -> Self {
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
    let out_size = ImageSize::new(out_size.width.clamp(1, 8192), out_size.height.clamp(1, 8192));
    let Some(photo_from_square) = quad::quad_from_square(quad) else {
        return RgbaImage::new(out_size.width, out_size.height);
    };
    let scale = DVec2::new(f64::from(out_size.width), f64::from(out_size.height));
    sampling::resample(photo, None, out_size, |texel| quad::apply(&photo_from_square, texel / scale))
}

/// The quadrilateral that fits a mask best: top-left, top-right, bottom-right, bottom-left, pixels.
///
/// For windows, doors, paintings and other planar things in perspective. `None` when the mask is empty.
pub fn min_area_quad(mask: &Mask) -> Option<[DVec2; 4]> {
    quad::fit(mask)
}

/// What lies less than this before a point does not hide it, metres.
const HIDDEN: f64 = 0.01;

/// The texture of a room face as the photo shows it; alpha 255 where observed, 0 elsewhere.
///
/// Column 0 is `u = u[0]` and u grows to the right, also on the walls where that mirrors what a viewer inside the room
/// sees (right and front: see [`Surface::point`]). Row 0 is the top of a wall (`v = v[1]`), and `v[0]` (z = 0) on floor
/// and ceiling. `visible` are the photo's pixels that show the bare surface. Where the room has a block, a niche or a
/// slope before the box's face, the texel is that one's, if the camera sees it.
pub fn surface_texture(
    photo: &RgbImage,
    camera: &Camera,
    faces: &RoomFaces,
    rect: &SurfaceRect,
    px_per_m: f64,
    visible: &Mask,
) -> RgbaImage {
    let size = rect.texture_size(px_per_m);
    let visible = crate::fitted(visible, photo);
    let camera = camera.resized(crate::size_of(photo));
    let centre = camera.centre();
    let upright = rect.surface.wall().is_some();
    let (du, dv) = (rect.u[1] - rect.u[0], rect.v[1] - rect.v[0]);
    sampling::resample(photo, Some(&visible), size, |texel| {
        let (s, t) = (texel.x / f64::from(size.width), texel.y / f64::from(size.height));
        let v = if upright { rect.v[1] - t * dv } else { rect.v[0] + t * dv };
        let (point, normal) = faces.point(rect.surface, DVec2::new(rect.u[0] + s * du, v));
        // A face shows its inner side only, and what nothing stands before.
        let towards = point - centre;
        if towards.dot(normal) >= 0.0 {
            return None;
        }
        let hidden = || {
            let ray = Ray { origin: centre, direction: towards.normalize() };
            faces.exit(&ray).is_some_and(|e| e.point.distance(centre) < towards.length() - HIDDEN)
        };
        if !faces.is_box() && hidden() { None } else { camera.project(point) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmony_scene::{Extents, Intrinsics};
    use image::Rgb;

    #[test]
    fn a_perspective_checkerboard_comes_out_regular() {
        let quad = [DVec2::new(60.0, 40.0), DVec2::new(340.0, 90.0), DVec2::new(310.0, 260.0), DVec2::new(40.0, 280.0)];
        let map = quad::quad_from_square(quad).unwrap();
        for (square, corner) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].into_iter().zip(quad) {
            assert!((quad::apply(&map, DVec2::new(square.0, square.1)).unwrap() - corner).length() < 1e-9);
        }
        let square_from_photo = map.inverse();
        let photo = RgbImage::from_fn(400, 300, |x, y| {
            let p = quad::apply(&square_from_photo, DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
            let odd = ((p.x * 8.0).floor() + (p.y * 8.0).floor()).rem_euclid(2.0) > 0.5;
            Rgb(if odd { [255, 255, 255] } else { [0, 0, 0] })
        });
        let flat = rectify_quad(&photo, quad, ImageSize::new(160, 160));
        for (i, j) in (0..8).flat_map(|i| (0..8).map(move |j| (i, j))) {
            let p = flat.get_pixel(i * 20 + 10, j * 20 + 10).0;
            assert_eq!(p, if (i + j) % 2 == 1 { [255; 4] } else { [0, 0, 0, 255] }, "{i} {j}");
        }
        let bow_tie = [quad[0], quad[2], quad[1], quad[3]];
        assert!(rectify_quad(&photo, bow_tie, ImageSize::new(8, 8)).pixels().all(|p| p.0[3] == 0));
        let out = quad.map(|p| p + DVec2::new(300.0, 0.0));
        let partly = rectify_quad(&photo, out, ImageSize::new(40, 40));
        assert_eq!(partly.get_pixel(39, 20).0[3], 0);
        assert_eq!(partly.get_pixel(0, 20).0[3], 255);
    }

    #[test]
    fn the_fitted_quad_finds_the_corners_of_a_perspective_rectangle() {
        let quad =
            [DVec2::new(80.0, 60.0), DVec2::new(330.0, 110.0), DVec2::new(300.0, 250.0), DVec2::new(70.0, 270.0)];
        let points = quad.map(|p| [p.x, p.y]);
        let filled = crate::polygon::rasterize(&points, 400, 300);
        // Rounded off and a bite taken out, as masks are.
        let mask = Mask::from_fn(ImageSize::new(400, 300), |x, y| {
            let bite = (f64::from(x) - 200.0).hypot(f64::from(y) - 265.0) < 25.0;
            filled[(y * 400 + x) as usize] && !bite
        });
        let found = min_area_quad(&mask).unwrap();
        for (a, b) in found.iter().zip(quad) {
            assert!((*a - b).length() < 6.0, "{a} {b}");
        }
        let turned = Mask::from_fn(ImageSize::new(100, 100), |x, y| {
            (f64::from(x) - 49.5).abs() + (f64::from(y) - 49.5).abs() < 30.0
        });
        let found = min_area_quad(&turned).unwrap();
        assert!(found.iter().any(|p| (*p - DVec2::new(50.0, 20.0)).length() < 4.0));
        assert!(min_area_quad(&Mask::empty(ImageSize::new(9, 9))).is_none());
        let dot = Mask::from_fn(ImageSize::new(9, 9), |x, y| x == 4 && y == 4);
        assert!(min_area_quad(&dot).is_some());
        let line = Mask::from_fn(ImageSize::new(50, 50), |x, y| x == y);
        assert!(min_area_quad(&line).is_some());
    }

    #[test]
    fn a_room_face_shows_its_own_coordinates() {
        let extents = Extents { width: 4.0, height: 2.5, depth: 5.0 };
        let size = ImageSize::new(800, 600);
        let centre = glam::DVec3::new(1.8, 1.4, 4.0);
        let camera = Camera::looking(
            size,
            Intrinsics::from_horizontal_fov(size, 1.4),
            centre,
            glam::DVec3::new(-0.2, -0.1, -1.0),
        );
        // A photo that paints each face point with its own (u, v).
        let photo = RgbImage::from_fn(800, 600, |x, y| {
            let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let (surface, point) = extents.exit(&ray).unwrap();
            let uv = surface.coordinates(point);
            Rgb([(uv.x * 50.0).round() as u8, (uv.y * 50.0).round() as u8, crate::regions::surface_id(surface)])
        });
        let all = Mask::from_fn(size, |_, _| true);
        for surface in [Surface::Back, Surface::Left, Surface::Floor] {
            let rect = SurfaceRect::whole(surface, &extents);
            let texture = surface_texture(&photo, &camera, &extents.into(), &rect, 40.0, &all);
            let face = surface.size(&extents);
            assert_eq!(texture.dimensions(), ((face.x * 40.0).round() as u32, (face.y * 40.0).round() as u32));
            let mut seen = 0;
            for (x, y, p) in texture.enumerate_pixels() {
                let (u, v) = ((f64::from(x) + 0.5) / 40.0, (f64::from(y) + 0.5) / 40.0);
                // Along its edges the photo's pixels mix two faces.
                let at_edge = u.min(v).min(face.x - u).min(face.y - v) < 0.15;
                if p.0[3] == 0 || at_edge {
                    continue;
                }
                seen += 1;
                assert_eq!(p.0[2], crate::regions::surface_id(surface));
                let v = if surface == Surface::Floor { v } else { extents.height - v };
                assert!((f64::from(p.0[0]) - u * 50.0).abs() <= 4.0, "{surface:?} {x} {y}");
                assert!((f64::from(p.0[1]) - v * 50.0).abs() <= 4.0, "{surface:?} {x} {y}");
            }
            assert!(seen > 2000, "{surface:?} {seen}");
        }
        let front = SurfaceRect::whole(Surface::Front, &extents);
        let unseen = surface_texture(&photo, &camera, &extents.into(), &front, 20.0, &all);
        assert!(unseen.pixels().all(|p| p.0[3] == 0));
        let nothing = surface_texture(&photo, &camera, &extents.into(), &front, f64::NAN, &Mask::empty(size));
        assert_eq!(nothing.dimensions(), (1, 1));
    }
}
