//! Finds the camera and the room box of photos from their lines alone, and draws them: segments coloured by room
//! axis (x red, y green, z blue), box edges in yellow.
//!
//! ```sh
//! cargo run --release -p harmony-geometry --example room_boxes -- out_folder photo.jpg ...
//! ```

mod drawing;

use std::path::{Path, PathBuf};

use harmony_geometry::{GrayImage, LayoutPrior, estimate_room_box, estimate_view};
use harmony_scene::ImageSize;

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
            drawing::line(&mut picture, s.start * k, s.end * k, colour);
        }
        drawing::room(&mut picture, &room.camera, &room.extents, [255, 230, 0]);
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
