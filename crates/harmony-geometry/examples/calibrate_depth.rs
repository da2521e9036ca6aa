//! Calibrates the camera of a depth image and draws the room box over the colour image.
//!
//! ```sh
//! cargo run --release -p harmony-geometry --example calibrate_depth -- \
//!     out.png colour.png depth.png fx fy cx cy units_per_metre
//! ```
//!
//! Intrinsics are in pixels of the depth image, with the centre of the top-left pixel at (0.5, 0.5).

mod drawing;

use harmony_geometry::{CalibrationSettings, LayoutPrior, calibrate};
use harmony_scene::{ImageSize, Intrinsics, PointMap, PointMapKind};

#[expect(clippy::print_stdout, reason = "an example")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [out, colour, depth, numbers @ ..] = arguments.as_slice() else {
        return Err("see the head of the file".into());
    };
    let numbers: Vec<f64> = numbers.iter().map(|n| n.parse()).collect::<Result<_, _>>()?;
    let [fx, fy, cx, cy, unit] = numbers[..] else { return Err("five numbers: fx fy cx cy units_per_metre".into()) };

    let depth = image::open(depth)?.into_luma16();
    let size = ImageSize::new(depth.width(), depth.height());
    let metres: Vec<f32> =
        depth.as_raw().iter().map(|v| if *v == u16::MAX { 0.0 } else { f32::from(*v) / unit as f32 }).collect();
    let map = PointMap::from_depth(PointMapKind::Metric, size, Intrinsics { fx, fy, cx, cy }, &metres);
    let start = std::time::Instant::now();
    let found = calibrate(&map, &LayoutPrior::unknown(size), &CalibrationSettings::default())?;
    println!("{colour}: {:?}", start.elapsed());
    println!(
        "  box {:.2}, camera {:.2}, forward {:.2}, seen {:?}, anchor {:?} {:?}",
        found.extents.as_vec(),
        found.camera.centre(),
        found.camera.forward(),
        found.seen,
        found.evidence.anchor_kind,
        found.evidence.anchor_px,
    );
    println!(
        "  {:?}, axes within {:.1} deg, support {:.2}, height ratio {:?}, {:?}",
        found.evidence.method,
        found.evidence.axis_agreement_deg,
        found.evidence.axis_support,
        found.evidence.height_ratio,
        found.evidence.fallbacks,
    );
    for p in &found.evidence.planes {
        println!(
            "    {:?}: measured {}, {:.2} m away, rms {:.3} m, share {:.3}",
            p.surface, p.measured, p.distance_m, p.rms_m, p.share
        );
    }
    let mut picture = image::open(colour)?.into_rgb8();
    let camera = found.camera.resized(ImageSize::new(picture.width(), picture.height()));
    drawing::room(&mut picture, &camera, &found.extents, [255, 230, 0]);
    picture.save(out)?;
    Ok(())
}
