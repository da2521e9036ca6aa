//! Writes pictures of what this crate does to a photo, to be looked at: `pictures <gt scene folder> <out folder>`.

#![allow(clippy::print_stdout)] // its output is its purpose

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use harmony_imaging::inpaint::{FillSettings, Sources, fill};
use harmony_imaging::rectify::{SurfaceRect, min_area_quad, rectify_quad, surface_texture};
use harmony_imaging::regions::{RegionSettings, propose_regions, surface_labels};
use harmony_imaging::sheet::{self, Cell, LabelledBox};
use harmony_imaging::tile::{TextureSettings, complete_surface};
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Mask, Mat3, Surface, Vec3};

fn camera(value: &serde_json::Value) -> Option<Camera> {
    let number = |v: &serde_json::Value| v.as_f64();
    let row = |v: &serde_json::Value| Some(Vec3::new(number(&v[0])?, number(&v[1])?, number(&v[2])?));
    let size = ImageSize::new(value["width"].as_u64()? as u32, value["height"].as_u64()? as u32);
    let k = &value["K"];
    let r = &value["R"];
    Some(Camera {
        size,
        intrinsics: Intrinsics {
            fx: number(&k[0][0])?,
            fy: number(&k[1][1])?,
            cx: number(&k[0][2])?,
            cy: number(&k[1][2])?,
        },
        rotation: Mat3::from_cols(row(&r[0])?, row(&r[1])?, row(&r[2])?).transpose(),
        translation: row(&value["t"])?,
    })
}

fn json(path: &Path) -> Result<serde_json::Value, Box<dyn Error>> {
    Ok(serde_json::from_slice(&std::fs::read(path)?)?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().ok_or("which scene?")?;
    let out = arguments.next().ok_or("which folder to write to?")?;
    let (scene, out) = (Path::new(&scene), Path::new(&out));
    let photo = image::open(scene.join("photo.jpg"))?.to_rgb8();
    let ids = image::open(scene.join("instances.png"))?.to_luma8();
    let room = json(&scene.join("room.json"))?;
    let camera = camera(&json(&scene.join("camera.json"))?).ok_or("no camera")?;
    let side = |key: &str| room[key].as_f64().unwrap_or(3.0);
    let extents = Extents { width: side("W"), height: side("H"), depth: side("D") };
    let size = ImageSize::new(photo.width(), photo.height());
    let name = scene.file_name().and_then(|n| n.to_str()).unwrap_or("scene");
    let save = |stem: &str| out.join(format!("{name}_{stem}.png"));

    sheet::grid_overlay(&photo, 100).picture.save(save("grid"))?;

    let labels = surface_labels(&camera, &extents.into());
    let started = Instant::now();
    let regions = propose_regions(&photo, &labels, &RegionSettings::default());
    println!("{} regions in {:.1?}", regions.len(), started.elapsed());
    let boxes: Vec<LabelledBox> = regions
        .iter()
        .enumerate()
        .map(|(i, r)| LabelledBox {
            bounds: r.bounds,
            label: format!("{i} {:.2}", r.objectness),
            color: sheet::palette(i),
        })
        .collect();
    sheet::draw_boxes(&photo, &boxes).save(save("regions"))?;
    let crops: Vec<_> = regions.iter().filter_map(|r| sheet::crop_rgba(&photo, &r.mask, 0.05)).collect();
    let cells: Vec<Cell<'_>> = crops
        .iter()
        .zip(&regions)
        .map(|((image, _), r)| Cell { label: format!("{:.2} {:?}", r.objectness, r.surface), image })
        .collect();
    sheet::contact_sheet(&cells, 6, 200).save(save("sheet"))?;

    let objects = Mask::from_fn(size, |x, y| ids.get_pixel(x, y).0[0] >= 8);
    let hole = objects.dilated(5);
    let started = Instant::now();
    let empty = fill(&photo, &hole, Sources::SameLabel(&labels), &FillSettings::default());
    println!("hole of {:.0} % filled in {:.1?}", 100.0 * hole.count() as f64 / size.pixels() as f64, started.elapsed());
    empty.save(save("filled"))?;
    fill(&photo, &hole, Sources::Anywhere, &FillSettings::default()).save(save("filled_anywhere"))?;

    let bare = Mask::from_fn(size, |x, y| ids.get_pixel(x, y).0[0] < 7);
    for surface in [Surface::Floor, Surface::Ceiling, Surface::Back, Surface::Left, Surface::Right] {
        let own = labels.iter().map(|l| *l == harmony_imaging::regions::surface_id(surface));
        let mut visible = bare.dilated(-3);
        for (bit, own) in visible.bits_mut().iter_mut().zip(own) {
            *bit &= own;
        }
        let rect = SurfaceRect::whole(surface, &extents);
        let started = Instant::now();
        let texture = surface_texture(&photo, &camera, &extents.into(), &rect, 150.0, &visible);
        let rectified = started.elapsed();
        let started = Instant::now();
        let whole = complete_surface(&texture, &TextureSettings::default());
        println!("{}: rectified in {rectified:.1?}, completed in {:.1?}", surface.name(), started.elapsed());
        let cells =
            [Cell { label: "observed".into(), image: &texture }, Cell { label: "completed".into(), image: &whole }];
        sheet::contact_sheet(&cells, 2, 560).save(save(surface.name()))?;
    }

    let list = json(&scene.join("objects.json"))?;
    let mut rectified = Vec::new();
    let mut with_quads = photo.clone();
    for object in list["objects"].as_array().into_iter().flatten() {
        let label = object["label"].as_str().unwrap_or("");
        if !["window", "painting", "door", "clock", "wall shelf", "monitor"].contains(&label) {
            continue;
        }
        let index = object["index"].as_u64().unwrap_or(0) as u8;
        let mask = Mask::from_fn(size, |x, y| ids.get_pixel(x, y).0[0] == index);
        if let Some(quad) = min_area_quad(&mask) {
            let points = quad.map(|p| [p.x, p.y]);
            with_quads = sheet::draw_polyline(&with_quads, &points, sheet::LineEnds::Closed, [255, 0, 255], 2.0);
            rectified.push((label.to_owned(), rectify_quad(&photo, quad, ImageSize::new(300, 240))));
        }
    }
    with_quads.save(save("quads"))?;
    let cells: Vec<Cell<'_>> = rectified.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
    sheet::contact_sheet(&cells, 3, 300).save(save("rectified"))?;
    Ok(())
}
