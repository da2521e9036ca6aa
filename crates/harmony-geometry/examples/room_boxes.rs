//! Finds the camera and the room box of photos from their lines alone, and draws them: segments coloured by room
//! axis (x red, y green, z blue), box edges in yellow.
//!
//! ```sh
//! cargo run --release -p harmony-geometry --example room_boxes -- out_folder photo.jpg ...
//! ```

use std::path::{Path, PathBuf};

use harmony_geometry::{GrayImage, LayoutPrior, RoomEdge, estimate_room_box, estimate_view};
use harmony_scene::{Camera, ImageSize, Vec2, Vec3};
use image::{Rgb, RgbImage};

fn line(image: &mut RgbImage, a: Vec2, b: Vec2, colour: [u8; 3]) {
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
        if let [Some(a), Some(b)] = pair {
            if a.distance(*b) < 200.0 {
                line(image, *a, *b, colour);
            }
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let out = arguments.next().ok_or("first argument: a folder for the pictures")?;
    std::fs::create_dir_all(&out)?;
    for path in arguments {
        let photo = image::open(&path)?.into_rgb8();
        let size = ImageSize::new(photo.width(), photo.height()).fit_within(640);
        let gray = GrayImage::from_rgb8(ImageSize::new(photo.width(), photo.height()), photo.as_raw())?.fit_within(960);
        let view = estimate_view(&gray, None);
        let prior = LayoutPrior::unknown(size);
        let room = estimate_room_box(&gray, &view, &prior);
        let mut picture = image::imageops::thumbnail(&photo, size.width, size.height);
        let k = f64::from(size.width) / f64::from(gray.size().width);
        for (s, axis) in &view.segments {
            let colour = match axis {
                Some(0) => [255, 60, 60],
                Some(1) => [60, 255, 60],
                Some(_) => [80, 80, 255],
                None => continue,
            };
            line(&mut picture, s.start * k, s.end * k, colour);
        }
        let e = room.extents;
        for which in RoomEdge::ALL {
            let (from, along) = which.line(&e);
            edge(&mut picture, &room.camera, from, from + along * along.dot(e.as_vec()), [255, 230, 0]);
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        picture.save(out.join(format!("{stem}.png")))?;
        summary(&path, &view, &room);
    }
    Ok(())
}

#[expect(clippy::print_stdout, reason = "an example")]
fn summary(path: &Path, view: &harmony_geometry::ViewEstimate, room: &harmony_geometry::RoomBox) {
    println!(
        "{}: yaw {:.1} tilt {:.1} roll {:.1} deg, focal {:.2} of the width ({:?}, sigma {:.2}), view {:.2}; box {:.2}, camera at {:.2}, support {:.2}, confidence {:.2}, {:?}",
        path.display(),
        view.yaw_deg(),
        view.tilt_deg(),
        view.roll().to_degrees(),
        view.intrinsics.fx / f64::from(view.size.width),
        view.focal,
        view.focal_sigma,
        view.confidence,
        room.extents.as_vec(),
        room.camera.centre(),
        room.evidence.edge_support,
        room.confidence,
        room.evidence.fallbacks,
    );
}
