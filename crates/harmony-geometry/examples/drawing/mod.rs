//! Lines on pictures, for the examples.

use harmony_geometry::RoomEdge;
use harmony_scene::{Camera, Extents, Vec2, Vec3};
use image::{Rgb, RgbImage};

/// A straight line, two pixels wide.
pub fn line(image: &mut RgbImage, a: Vec2, b: Vec2, colour: [u8; 3]) {
    let steps = (a.distance(b).ceil() as usize).clamp(1, 4000);
    for i in 0..=steps {
        let p = a.lerp(b, i as f64 / steps as f64);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)] {
            let (x, y) = (p.x + dx, p.y + dy);
            if x >= 0.0 && y >= 0.0 && x < f64::from(image.width()) && y < f64::from(image.height()) {
                image.put_pixel(x as u32, y as u32, Rgb(colour));
            }
        }
    }
}

fn edge(image: &mut RgbImage, camera: &Camera, from: Vec3, to: Vec3, colour: [u8; 3]) {
    let points: Vec<Option<Vec2>> = (0..=200).map(|i| camera.project(from.lerp(to, f64::from(i) / 200.0))).collect();
    for pair in points.windows(2) {
        if let [Some(a), Some(b)] = pair
            && a.distance(*b) < 200.0
        {
            line(image, *a, *b, colour);
        }
    }
}

/// The eight edges of a room that a photo can show.
pub fn room(image: &mut RgbImage, camera: &Camera, extents: &Extents, colour: [u8; 3]) {
    for which in RoomEdge::ALL {
        let (from, along) = which.line(extents);
        edge(image, camera, from, from + along * along.dot(extents.as_vec()), colour);
    }
}
