//! Draws every template in a three-quarter view: `cargo run -p harmony-render --example contact_sheet -- sheet.png`.
//!
//! Further arguments choose categories and options: `sheet.png chair,sofa '{"back":"ladder"}'`.

use std::error::Error;

use glam::{DMat3, DVec3};
use harmony_mesh::{TemplateParams, template};
use harmony_render::{Instance, Lighting, RenderOptions, render};
use harmony_scene::{Camera, ImageSize, Intrinsics, Size};
use image::{Rgb, RgbImage};

const TILE: u32 = 260;
const COLUMNS: u32 = 10;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("usage: contact_sheet SHEET.png [CATEGORY,...] [OPTIONS]")?;
    let chosen: Vec<String> = match args.next() {
        Some(list) if !list.is_empty() => list.split(',').map(str::to_owned).collect(),
        _ => harmony_catalogue::templates().map(str::to_owned).collect(),
    };
    let params: Vec<TemplateParams> =
        args.map(|text| serde_json::from_str(&text)).collect::<Result<_, serde_json::Error>>()?;
    let params = if params.is_empty() { vec![TemplateParams::default()] } else { params };
    let columns = COLUMNS.min((chosen.len() * params.len()) as u32);
    let rows = ((chosen.len() * params.len()) as u32).div_ceil(columns);
    let mut sheet = RgbImage::from_pixel(columns * TILE, rows * TILE, Rgb([236, 236, 232]));
    let mut tile = 0;
    for name in &chosen {
        for p in &params {
            let size = harmony_catalogue::default_size(name);
            draw(&mut sheet, (tile % columns * TILE, tile / columns * TILE), name, p, size)?;
            tile += 1;
        }
    }
    sheet.save(path)?;
    Ok(())
}

fn draw(
    sheet: &mut RgbImage,
    (x0, y0): (u32, u32),
    name: &str,
    p: &TemplateParams,
    size: Size,
) -> Result<(), Box<dyn Error>> {
    let built = template(name, p, size).build(size)?;
    let image = ImageSize::new(TILE, TILE);
    let radius = size.as_vec().length() / 2.0;
    let centre = DVec3::new(0.0, size.height / 2.0, 0.0);
    let from = DVec3::new(0.62, 0.42, 1.0).normalize() * radius * 4.2;
    let camera = Camera::looking(image, Intrinsics::from_horizontal_fov(image, 0.5), centre + from, -from);
    let options = RenderOptions {
        lighting: Lighting::HeadLight,
        multisample: true,
        background: [236, 236, 232, 255],
        near: radius * 0.1,
        ..RenderOptions::default()
    };
    let instance = Instance { mesh: &built.mesh, linear: DMat3::IDENTITY, translation: DVec3::ZERO, id: 1 };
    let frame = render(&camera, &[instance], &options);
    for (x, y, pixel) in frame.color.enumerate_pixels() {
        sheet.put_pixel(x0 + x, y0 + y, Rgb([pixel[0], pixel[1], pixel[2]]));
    }
    Ok(())
}
