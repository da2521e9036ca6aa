//! Which surfaces of a view the room's photo saw.

use glam::DVec2;
use harmony_scene::Mask;

use crate::truth::{TruthRoom, TruthView};

/// Depths that differ less belong to one surface, metres.
const NEAR_M: f64 = 0.03;
/// The same as a share of the depth.
const NEAR_SHARE: f64 = 0.02;
/// Nearer to the photo's camera nothing counts as seen, metres.
const CLOSEST_M: f64 = 0.05;

/// Pixels of a view whose surface the room's photo shows: the true point of each is carried into the photo and must
/// lie at the photo's true depth, within 3 cm or 2 %.
///
/// The rule is the independent judge's, to the pixel: the photo's depth is read without interpolation.
pub fn seen_by_photo(truth: &TruthRoom, view: &TruthView) -> Mask {
    let size = truth.camera.size;
    let width = view.camera.size.width as usize;
    Mask::from_fn(view.camera.size, |x, y| {
        let depth = f64::from(view.depth[y as usize * width + x as usize]);
        if depth <= 0.0 {
            return false;
        }
        let point = view.camera.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5), depth);
        let z = truth.camera.depth(point);
        let Some(pixel) = truth.camera.project(point).filter(|_| z > CLOSEST_M) else { return false };
        // Whole numbers towards zero, as the judge's `astype(int)`.
        let (u, v) = (pixel.x.trunc(), pixel.y.trunc());
        if u < 0.0 || v < 0.0 || u >= f64::from(size.width) || v >= f64::from(size.height) {
            return false;
        }
        let at = f64::from(truth.depth[v as usize * size.width as usize + u as usize]);
        (at - z).abs() < NEAR_M.max(NEAR_SHARE * z)
    })
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use glam::DVec3;
    use harmony_scene::{Camera, Extents, ImageSize, Intrinsics};

    use super::*;

    /// A wall at z = 0 behind a board at z = 1, both facing +Z; cameras look along -Z without tilt.
    ///
    /// The photo's camera stands at x = 0, z = 4, the view's at x = 1, z = 4. The board spans x in [-0.5, 0.5] and all
    /// heights, so that the photo does not see the wall behind it: rays at |slope| < 0.5 / 3.
    fn depths(camera: &Camera) -> Vec<f32> {
        let mut out = Vec::new();
        for y in 0..camera.size.height {
            for x in 0..camera.size.width {
                let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let at_board = camera.unproject(pixel, camera.centre().z - 1.0).x;
                let near = at_board.abs() < 0.5;
                out.push((camera.centre().z - if near { 1.0 } else { 0.0 }) as f32);
            }
        }
        out
    }

    #[test]
    fn what_a_board_hides_from_the_photo_is_not_seen() {
        let size = ImageSize::new(400, 10);
        let camera = |x: f64| {
            let lens = Intrinsics::centred(size, 200.0);
            Camera::looking(size, lens, DVec3::new(x, 1.0, 4.0), DVec3::NEG_Z)
        };
        let (photo, other) = (camera(0.0), camera(1.0));
        let truth = TruthRoom {
            name: String::new(),
            folder: PathBuf::new(),
            camera: photo,
            extents: Extents { width: 4.0, height: 3.0, depth: 5.0 },
            shape: harmony_scene::RoomShape::default(),
            origin: DVec3::ZERO,
            walls: Vec::new(),
            openings: Vec::new(),
            objects: Vec::new(),
            ids: vec![0; size.pixels()],
            depth: depths(&photo),
        };
        let view = TruthView {
            name: String::new(),
            folder: PathBuf::new(),
            camera: other,
            ids: vec![0; size.pixels()],
            depth: depths(&other),
        };
        let seen = seen_by_photo(&truth, &view);
        for x in 0..size.width {
            let slope = (f64::from(x) + 0.5 - 200.0) / 200.0;
            let on_board = (1.0 + 3.0 * slope).abs() < 0.5;
            let wall = 1.0 + 4.0 * slope;
            // The photo sees 4 m to each side at the wall; behind the board |x| < 4 * 0.5 / 3.
            let expected = on_board || (wall.abs() > 2.0 / 3.0 && wall < 4.0 && wall > -4.0);
            // A pixel at an edge may fall to either side.
            let edge = [(1.0 + 3.0 * slope).abs() - 0.5, wall.abs() - 2.0 / 3.0, wall.abs() - 4.0];
            if edge.iter().all(|e| e.abs() > 0.03) {
                assert_eq!(seen.get(i64::from(x), 5), expected, "column {x}, wall at {wall:.2}");
            }
        }
        assert!(seen.count() > 1000 && seen.count() < 4000 - 500);
    }
}
