//! Completes the faces of a run: `faces RUN/1_layout/textures/seen OUT PX_PER_M`.

#![expect(clippy::print_stdout, reason = "a program")]

use std::path::Path;

use harmony_imaging::tile::{Fineness, Grain, Survey};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [seen, out, px_per_m] = args.as_slice() else { return Err("faces SEEN OUT PX_PER_M".into()) };
    std::fs::create_dir_all(out)?;
    for name in ["floor", "ceiling", "back", "left", "right", "front"] {
        let texture = image::open(Path::new(seen).join(format!("{name}.png")))?.to_rgba8();
        let fineness = Fineness::full(texture.width() as usize, texture.height() as usize);
        let grain = if name == "floor" { Grain::Coarse } else { Grain::Fine };
        let Some(survey) = Survey::of(&texture, &fineness, px_per_m.parse()?, grain, 1) else { continue };
        println!(
            "{name}: {:.2} m2 seen, colour {:?}, periods {:?}",
            survey.seen_area,
            survey.look.color.map(f32::round),
            survey.look.periods()
        );
        survey.complete().save(Path::new(out).join(format!("{name}.png")))?;
        survey.look.paint(400, 300).save(Path::new(out).join(format!("{name}_look.png")))?;
    }
    Ok(())
}
