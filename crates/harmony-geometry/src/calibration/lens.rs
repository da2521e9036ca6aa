//! A given lens: what the photo shows, in the pixels of a camera that has its principal point in the middle of the
//! image and square pixels.
//!
//! The least squares know no other camera. A sensor's map comes with a lens of its own, whose principal point may lie
//! anywhere; pins, lines and hints are moved to where the centred camera would see them, and the solved camera gets the
//! lens back. Pixels are those of the photo. Lenses distort nothing here: pictures are taken as rectified.

use harmony_scene::{Camera, ImageSize, Intrinsics, PointMap, PointMapKind, Vec2};

use crate::room_box::solved::CameraBox;
use crate::{LayoutPrior, LineSegment, ViewEstimate};

/// The lens of a photo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lens {
    /// Size of the photo.
    pub(super) photo: ImageSize,
    /// Of a calibrated sensor, in pixels of the photo; `None`: centred, of a focal length that is looked for.
    given: Option<Intrinsics>,
}

impl Lens {
    /// A metric map is a sensor's, whose lens is known.
    pub(super) fn of(points: &PointMap, photo: ImageSize) -> Self {
        let given = (points.kind == PointMapKind::Metric).then(|| points.intrinsics.resized(points.size, photo));
        Self { photo, given }
    }

    /// One that is centred.
    #[cfg(test)]
    pub(super) fn unknown(photo: ImageSize) -> Self {
        Self { photo, given: None }
    }

    /// Whether it is known.
    pub(super) fn is_given(&self) -> bool {
        self.given.is_some()
    }

    fn middle(&self) -> Vec2 {
        Vec2::new(f64::from(self.photo.width), f64::from(self.photo.height)) / 2.0
    }

    /// Principal point, and how much taller a square pixel is than one of the photo.
    fn centre_and_stretch(&self) -> (Vec2, Vec2) {
        match self.given {
            Some(k) => (Vec2::new(k.cx, k.cy), Vec2::new(1.0, k.fx / k.fy)),
            None => (self.middle(), Vec2::ONE),
        }
    }

    /// A pixel of the photo, relative to the principal point, in square pixels.
    pub(super) fn relative(&self, pixel: Vec2) -> Vec2 {
        let (centre, stretch) = self.centre_and_stretch();
        (pixel - centre) * stretch
    }

    /// The pixel of the photo that is there.
    pub(super) fn pixel(&self, relative: Vec2) -> Vec2 {
        let (centre, stretch) = self.centre_and_stretch();
        relative / stretch + centre
    }

    /// The pixel that the centred camera has where the photo has this one.
    fn centred(&self, pixel: Vec2) -> Vec2 {
        self.relative(pixel) + self.middle()
    }

    /// The view as the centred camera has it: its lines.
    pub(super) fn centred_view(&self, view: &ViewEstimate) -> ViewEstimate {
        if !self.is_given() {
            return view.clone();
        }
        let k = f64::from(self.photo.width.max(1)) / f64::from(view.size.width.max(1));
        let moved = |p: Vec2| self.centred(p * k) / k;
        let segment = |s: &LineSegment| LineSegment { start: moved(s.start), end: moved(s.end), ..*s };
        ViewEstimate { segments: view.segments.iter().map(|(s, axis)| (segment(s), *axis)).collect(), ..view.clone() }
    }

    /// The prior as the centred camera has it: its pins.
    pub(super) fn centred_prior(&self, prior: &LayoutPrior) -> LayoutPrior {
        let mut out = prior.clone();
        if !self.is_given() {
            return out;
        }
        out.pins.edges.iter_mut().flat_map(|e| &mut e.points).for_each(|p| *p = self.centred(*p));
        out.camera.corner_px = out.camera.corner_px.map(|p| self.centred(Vec2::from_array(p)).to_array());
        let height = f64::from(self.photo.height.max(1));
        out.camera.floor_junction_y_frac =
            out.camera.floor_junction_y_frac.map(|row| self.centred(Vec2::new(0.0, row * height)).y / height);
        out
    }

    /// The photo's camera where the centred one was solved.
    pub(super) fn camera(&self, solved: &CameraBox) -> Camera {
        let centred = solved.camera(self.photo);
        Camera { intrinsics: self.given.unwrap_or(centred.intrinsics), ..centred }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_go_to_the_centred_camera_and_back() {
        let photo = ImageSize::new(640, 480);
        let given = Intrinsics { fx: 520.0, fy: 500.0, cx: 330.0, cy: 250.0 };
        let lens = Lens { photo, given: Some(given) };
        let pixel = Vec2::new(400.0, 100.0);
        // The same ray as in the photo.
        let ray = given.direction(pixel);
        let at = lens.relative(pixel) / given.fx;
        assert!((at.x - ray.x).abs() < 1e-12 && (at.y - ray.y).abs() < 1e-12);
        assert!(lens.pixel(lens.relative(pixel)).distance(pixel) < 1e-9);
        let unknown = Lens::unknown(photo);
        assert_eq!(unknown.relative(pixel), Vec2::new(80.0, -140.0));
    }
}
