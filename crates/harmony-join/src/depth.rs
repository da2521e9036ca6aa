//! How far one sees in a run's photo: by its point map where it has one, else by its scene.

use std::path::Path;

use glam::{DVec2, DVec3};
use harmony_io::points::{PointMapOptions, load_point_map};
use harmony_scene::{Camera, PointMapKind};

/// What lies this much farther than a place (a share, and metres) is behind it, and what is so much nearer hides it.
const BEHIND: (f64, f64) = (0.08, 0.15);

/// What a photo says of a place in the room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sight {
    /// It is outside the picture.
    Outside,
    /// Something nearer hides it.
    Hidden,
    /// A surface is about there.
    There,
    /// One sees past it.
    Past,
}

/// Planar depths of a small picture from a run's camera.
#[derive(Debug, Clone)]
pub struct SeenDepth {
    /// The camera, pixels of the small picture.
    pub camera: Camera,
    /// Metres, row-major; 0 where nothing is known.
    pub depth: Vec<f32>,
    /// Whether a point map says so; else the run's own scene does, which lacks what the run did not find.
    pub measured: bool,
}

impl SeenDepth {
    /// From a run folder and what its scene shows.
    pub fn new(folder: &Path, camera: &Camera, drawn: &[f32]) -> Self {
        let measured = of_map(folder, camera, drawn);
        Self { camera: *camera, measured: measured.is_some(), depth: measured.unwrap_or_else(|| drawn.to_vec()) }
    }

    /// What the photo says of a point in the run's room frame.
    pub fn sight(&self, point: DVec3) -> Sight {
        let Some(pixel) = self.camera.project(point).filter(|p| self.camera.contains(*p)) else {
            return Sight::Outside;
        };
        let at = pixel.y as usize * self.camera.size.width as usize + pixel.x as usize;
        let (seen, own) = (f64::from(self.depth[at]), self.camera.depth(point));
        let slack = BEHIND.0 * own + BEHIND.1;
        if seen <= 0.0 {
            Sight::Outside
        } else if seen > own + slack {
            Sight::Past
        } else if seen < own - slack {
            Sight::Hidden
        } else {
            Sight::There
        }
    }
}

/// The run's point map as planar depths in metres: at the scale at which the scene and the map agree in the middle.
fn of_map(folder: &Path, camera: &Camera, drawn: &[f32]) -> Option<Vec<f32>> {
    let map = load_point_map(&folder.join("1_layout/points.npz"), &PointMapOptions::new(camera.size)).ok()?;
    if map.kind == PointMapKind::RoomBox {
        return None;
    }
    let size = camera.size;
    let step = DVec2::new(
        f64::from(map.size.width) / f64::from(size.width),
        f64::from(map.size.height) / f64::from(size.height),
    );
    let mut depth = Vec::with_capacity(size.pixels());
    for y in 0..size.height {
        for x in 0..size.width {
            let at = (DVec2::new(f64::from(x), f64::from(y)) + 0.5) * step;
            let point = map.at(at.x as u32, at.y as u32);
            depth.push(point.map_or(0.0, |p| (map.rotation * p + map.translation).z.max(0.0)));
        }
    }
    let both = drawn.iter().zip(&depth).filter(|(d, m)| **d > 0.0 && **m > 0.0);
    let mut ratios: Vec<f64> = both.map(|(d, m)| f64::from(*d) / m).collect();
    if ratios.len() < size.pixels() / 4 {
        return None;
    }
    let middle = ratios.len() / 2;
    let (_, scale, _) = ratios.select_nth_unstable_by(middle, f64::total_cmp);
    let scale = *scale;
    Some(depth.into_iter().map(|m| (m * scale) as f32).collect())
}

#[cfg(test)]
mod tests {
    use harmony_scene::{ImageSize, Intrinsics};

    use super::*;

    #[test]
    fn one_sees_past_there_or_not_at_all() {
        let size = ImageSize::new(32, 24);
        let lens = Intrinsics::from_horizontal_fov(size, 1.2);
        let camera = Camera::looking(size, lens, DVec3::new(2.0, 1.5, 5.0), DVec3::NEG_Z);
        // A wall 3 m before the camera.
        let seen = SeenDepth { camera, depth: vec![3.0; size.pixels()], measured: true };
        let at = |z: f64| seen.sight(DVec3::new(2.0, 1.5, z));
        assert_eq!([at(4.0), at(2.0), at(1.0), at(6.0)], [Sight::Past, Sight::There, Sight::Hidden, Sight::Outside]);
    }
}
