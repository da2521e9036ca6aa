//! The pinhole camera in the room.

use glam::{DMat3, DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Width and height of an image, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
pub struct ImageSize {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl ImageSize {
    /// A size from columns and rows.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Number of pixels.
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The same shape, scaled down so that the longer side is at most `longest` pixels.
    #[must_use]
    pub fn fit_within(self, longest: u32) -> Self {
        let long = self.width.max(self.height);
        if long <= longest {
            return self;
        }
        let k = f64::from(longest) / f64::from(long);
        Self {
            width: ((f64::from(self.width) * k).round() as u32).max(1),
            height: ((f64::from(self.height) * k).round() as u32).max(1),
        }
    }
}

/// Pinhole intrinsics in pixels of a stated image size; the centre of the top-left pixel is (0.5, 0.5).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Intrinsics {
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels.
    pub cx: f64,
    /// Principal point y, pixels.
    pub cy: f64,
}

impl Intrinsics {
    /// Square pixels and a centred principal point, from a horizontal field of view in radians.
    pub fn from_horizontal_fov(size: ImageSize, hfov: f64) -> Self {
        let f = f64::from(size.width) / 2.0 / (hfov / 2.0).tan();
        Self::centred(size, f)
    }

    /// Square pixels and a centred principal point, from a focal length in pixels.
    pub fn centred(size: ImageSize, focal_px: f64) -> Self {
        Self { fx: focal_px, fy: focal_px, cx: f64::from(size.width) / 2.0, cy: f64::from(size.height) / 2.0 }
    }

    /// The same lens seen on an image resized from `from` to `to` (each axis by its own factor).
    #[must_use]
    pub fn resized(self, from: ImageSize, to: ImageSize) -> Self {
        let kx = f64::from(to.width) / f64::from(from.width);
        let ky = f64::from(to.height) / f64::from(from.height);
        Self { fx: self.fx * kx, fy: self.fy * ky, cx: self.cx * kx, cy: self.cy * ky }
    }

    /// Direction in the camera frame (z = 1, not normalised) through a pixel position.
    pub fn direction(&self, pixel: DVec2) -> DVec3 {
        DVec3::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy, 1.0)
    }
}

/// A half line: `origin + k * direction`, k >= 0; `direction` is a unit vector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Start.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

impl Ray {
    /// The point at distance `k`.
    pub fn at(&self, k: f64) -> DVec3 {
        self.origin + self.direction * k
    }
}

/// A pinhole camera posed in the room: `x_cam = rotation * x_room + translation` (OpenCV axes).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// The image the intrinsics speak about.
    pub size: ImageSize,
    /// Pinhole parameters, pixels of `size`.
    pub intrinsics: Intrinsics,
    /// `camera_from_room` rotation R.
    pub rotation: DMat3,
    /// `camera_from_room` translation t, metres.
    pub translation: DVec3,
}

impl Camera {
    /// A camera at `centre` looking along `forward` without roll (`up` is the room's +Y).
    ///
    /// A `forward` parallel to +Y is taken as looking along -Z with that tilt.
    pub fn looking(size: ImageSize, intrinsics: Intrinsics, centre: DVec3, forward: DVec3) -> Self {
        let z = forward.try_normalize().unwrap_or(DVec3::NEG_Z);
        let x = z.cross(DVec3::Y).try_normalize().unwrap_or(DVec3::X);
        let y = z.cross(x);
        let rotation = DMat3::from_cols(x, y, z).transpose();
        Self { size, intrinsics, rotation, translation: -(rotation * centre) }
    }

    /// Centre of projection in the room, `c = -R^T t`.
    pub fn centre(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// Viewing direction in the room (unit).
    pub fn forward(&self) -> DVec3 {
        self.rotation.transpose() * DVec3::Z
    }

    /// The image's x axis in the room (unit), the paper's `r`.
    pub fn right(&self) -> DVec3 {
        self.rotation.transpose() * DVec3::X
    }

    /// The image's y axis in the room (unit, downwards).
    pub fn down(&self) -> DVec3 {
        self.rotation.transpose() * DVec3::Y
    }

    /// A room point in the camera frame.
    pub fn to_camera(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// A camera-frame point in the room.
    pub fn to_room(&self, point: DVec3) -> DVec3 {
        self.rotation.transpose() * (point - self.translation)
    }

    /// Planar depth (along the optical axis) of a room point; negative behind the camera.
    pub fn depth(&self, point: DVec3) -> f64 {
        self.to_camera(point).z
    }

    /// Pixel position of a room point, or `None` when it is not in front of the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let p = self.to_camera(point);
        (p.z > 1e-6).then(|| {
            let k = &self.intrinsics;
            DVec2::new(k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy)
        })
    }

    /// The room ray through a pixel position.
    pub fn ray(&self, pixel: DVec2) -> Ray {
        let direction = self.rotation.transpose() * self.intrinsics.direction(pixel);
        Ray { origin: self.centre(), direction: direction.normalize_or(self.forward()) }
    }

    /// The room point seen at a pixel with a planar depth.
    pub fn unproject(&self, pixel: DVec2, depth: f64) -> DVec3 {
        self.to_room(self.intrinsics.direction(pixel) * depth)
    }

    /// The same camera for a resized image.
    #[must_use]
    pub fn resized(&self, to: ImageSize) -> Self {
        Self { size: to, intrinsics: self.intrinsics.resized(self.size, to), ..*self }
    }

    /// Whether a pixel position lies in the image.
    pub fn contains(&self, pixel: DVec2) -> bool {
        pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x < f64::from(self.size.width)
            && pixel.y < f64::from(self.size.height)
    }

    /// Horizontal field of view, radians.
    pub fn horizontal_fov(&self) -> f64 {
        2.0 * (f64::from(self.size.width) / 2.0 / self.intrinsics.fx).atan()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_projected_point_comes_back_through_its_depth() {
        let size = ImageSize::new(640, 480);
        let camera = Camera::looking(
            size,
            Intrinsics::from_horizontal_fov(size, 1.2),
            DVec3::new(1.0, 1.6, 4.0),
            DVec3::new(0.2, -0.1, -1.0),
        );
        let point = DVec3::new(1.5, 0.4, 0.8);
        let pixel = camera.project(point).unwrap();
        let back = camera.unproject(pixel, camera.depth(point));
        assert!((back - point).length() <= 1e-12);
        assert!((camera.centre() - DVec3::new(1.0, 1.6, 4.0)).length() <= 1e-12);
        assert!(camera.right().y.abs() <= 1e-12, "no roll");
        assert!(camera.down().y < 0.0, "image y points down");
    }
}
