//! A sheet of all patterns, lit from the upper left with their normal maps.
//!
//! `cargo run -p harmony-shape --example materials -- OUT.png [WORD...]`: with words, only patterns whose name has one.

use harmony_shape::material::{MaterialSpec, Pattern, PatternKind as K, bake_tile};
use image::{Rgb, RgbImage};

const CELL: u32 = 320;
const LIGHT: [f64; 3] = [-0.62, 0.48, 0.62];

fn linear(b: u8) -> f64 {
    let c = f64::from(b) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }
}

fn byte(c: f64) -> u8 {
    let c = c.clamp(0.0, 1.0);
    let s = if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * libm::pow(c, 1.0 / 2.4) - 0.055 };
    (s * 255.0).round() as u8
}

/// Name, pattern, slot colour, side of the view in metres.
fn samples() -> Vec<(String, Pattern, &'static str, f64)> {
    let make = |kind, variant: &str| Pattern { variant: variant.to_owned(), ..Pattern::new(kind) };
    let colors = |p: Pattern, c: &[&str]| Pattern { colors: c.iter().map(|c| (*c).to_owned()).collect(), ..p };
    let sized = |p: Pattern, width: f64, length: f64| Pattern { width, length, ..p };
    let mut list: Vec<(String, Pattern, &str, f64)> = Vec::new();
    let mut add = |name: &str, p: Pattern, slot: &'static str, side: f64| list.push((name.to_owned(), p, slot, side));
    add("planks oak", make(K::Planks, ""), "#b08658", 1.6);
    add("planks grey", sized(make(K::Planks, ""), 0.19, 1.5), "#8a8177", 1.6);
    add("planks walnut near", sized(make(K::Planks, ""), 0.12, 0.9), "#6b4a33", 0.6);
    add("herringbone", make(K::Parquet, "herringbone"), "#a87c50", 1.0);
    add("chevron", make(K::Parquet, "chevron"), "#9b7048", 1.2);
    add("basket", make(K::Parquet, "basket"), "#9a6a40", 0.8);
    add("wood oak", make(K::Wood, ""), "#b98a58", 0.8);
    add("wood walnut", make(K::Wood, ""), "#5d4030", 0.6);
    add("wood turned", Pattern { turn_deg: 90.0, ..make(K::Wood, "") }, "#d0b080", 0.8);
    add("tiles", make(K::Tiles, ""), "#d8d4cc", 1.2);
    add("tiles metro", sized(make(K::Tiles, "running"), 0.20, 0.10), "#e8e8e2", 0.8);
    add("tiles diagonal", make(K::Tiles, "diagonal"), "#b8a890", 1.2);
    add("tiles checker", colors(make(K::Tiles, "checkerboard"), &["#e6e2d8", "#24262a", "#8a8680"]), "#888888", 1.2);
    add("tiles hex", make(K::Tiles, "hex"), "#7f95a0", 0.7);
    add("tiles stone", Pattern { amount: 0.9, ..sized(make(K::Tiles, ""), 0.6, 0.6) }, "#a39c92", 1.6);
    add("brick", make(K::Brick, ""), "#9a5440", 1.0);
    add("brick painted", make(K::Brick, "painted"), "#e6e3dc", 1.0);
    add("brick flemish", make(K::Brick, "flemish"), "#8a6a50", 1.0);
    add("brick english", make(K::Brick, "english"), "#7a4a3c", 1.0);
    add("checks", colors(make(K::Checks, ""), &["#e8ded0", "#b0503c"]), "#888888", 0.6);
    add("gingham", colors(sized(make(K::Checks, "gingham"), 0.03, 0.0), &["#f0eee8", "#3c62a0"]), "#888888", 0.3);
    add(
        "stripes",
        colors(sized(make(K::Stripes, ""), 0.08, 0.0), &["#ece4d4", "#4a6a60", "#ece4d4", "#c09a50"]),
        "#888888",
        0.8,
    );
    add("dots", colors(make(K::Dots, ""), &["#f0d8d0", "#b04050"]), "#888888", 0.35);
    add("hearts", colors(make(K::Motif, "heart"), &["#f3ece6", "#c8405a", "#e09ab0"]), "#888888", 0.6);
    add(
        "hearts over weave",
        {
            let mut p = make(K::Over, "");
            p.layers = vec![
                colors(sized(make(K::Motif, "star"), 0.06, 0.0), &["#ffffff", "#d0a030"]),
                colors(make(K::Weave, ""), &["#2c3a58"]),
            ];
            p
        },
        "#888888",
        0.2,
    );
    add("weave", make(K::Weave, ""), "#b9ad9a", 0.03);
    add("linen", Pattern { amount: 0.9, ..sized(make(K::Weave, ""), 0.0016, 0.0) }, "#c9bfa8", 0.12);
    add("denim", colors(make(K::Weave, "twill"), &["#2c3f66", "#b9c0cc"]), "#445566", 0.05);
    add(
        "weave herringbone",
        colors(sized(make(K::Weave, "herringbone"), 0.002, 0.0), &["#5a5650", "#b8b0a4"]),
        "#445566",
        0.10,
    );
    add("knit", make(K::Knit, ""), "#c4a890", 0.05);
    add("knit rib", make(K::Knit, "rib"), "#8a4050", 0.12);
    add("terry", make(K::Terry, ""), "#9ab0b8", 0.06);
    add("boucle", make(K::Boucle, ""), "#e4dccc", 0.12);
    add("pile", make(K::Pile, ""), "#8c7f90", 0.35);
    add("pile loop", make(K::Pile, "loop"), "#9c8a70", 0.15);
    add("shag", make(K::Pile, "shag"), "#d8cdb8", 0.40);
    add("leather", make(K::Leather, ""), "#6a3c26", 0.06);
    add("rattan", make(K::Rattan, ""), "#b88a54", 0.12);
    add("cane", make(K::Rattan, "cane"), "#c8a468", 0.10);
    add("marble", make(K::Marble, ""), "#e4e0da", 1.2);
    add("marble black", make(K::Marble, ""), "#22242a", 1.2);
    add("terrazzo", make(K::Terrazzo, ""), "#c8c2b8", 0.25);
    add("concrete", make(K::Concrete, ""), "#a09c96", 1.6);
    add("concrete board", make(K::Concrete, "board"), "#a8a39a", 1.2);
    add("plaster", make(K::Plaster, ""), "#e0d8c8", 1.2);
    add("stucco", make(K::Plaster, "stucco"), "#d8c8a8", 0.5);
    add("corrugated", make(K::Corrugated, ""), "#9aa2a6", 0.6);
    add("quilt diamond", make(K::Quilting, "diamond"), "#b8a0a8", 0.4);
    add("quilt box", make(K::Quilting, "box"), "#8090a0", 0.4);
    add("quilt channel", make(K::Quilting, "channel"), "#405a50", 0.4);
    add(
        "grime over tiles",
        {
            let mut p = make(K::Over, "");
            p.layers = vec![
                Pattern { amount: 0.6, ..make(K::Grime, "") },
                colors(make(K::Tiles, ""), &["#d8d8d0", "#a0a098"]),
            ];
            p
        },
        "#888888",
        1.2,
    );
    add("ramp", colors(sized(make(K::Ramp, ""), 0.5, 0.5), &["#e8c8b0", "#7a5a90"]), "#888888", 1.0);
    list
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let out = args.next().ok_or("usage: materials OUT.png [WORD...]")?;
    let words: Vec<String> = args.collect();
    let list: Vec<_> =
        samples().into_iter().filter(|s| words.is_empty() || words.iter().any(|w| s.0.contains(w.as_str()))).collect();
    let columns = (list.len() as f64).sqrt().ceil() as u32 + u32::from(list.len() > 20);
    let lines = (list.len() as u32).div_ceil(columns);
    let mut sheet = RgbImage::from_pixel(columns * (CELL + 6), lines * (CELL + 6), Rgb([255; 3]));
    let norm = LIGHT.iter().map(|c| c * c).sum::<f64>().sqrt();
    for (k, (name, map, color, side)) in list.into_iter().enumerate() {
        let spec = MaterialSpec { map: Some(map), ..MaterialSpec::plain(&name, color) };
        let start = std::time::Instant::now();
        let tile = bake_tile(&spec, None);
        eprintln!(
            "{name}: {:.3} x {:.3} m, {} x {} px, {:.0} ms",
            tile.size[0],
            tile.size[1],
            tile.color.width(),
            tile.color.height(),
            start.elapsed().as_secs_f64() * 1e3
        );
        let (x0, y0) = (k as u32 % columns * (CELL + 6), k as u32 / columns * (CELL + 6));
        for y in 0..CELL {
            for x in 0..CELL {
                // Four samples a pixel.
                let mut sum = [0.0; 3];
                for (sx, sy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
                    let m = glam::Vec2::new(
                        ((f64::from(x) + sx) / f64::from(CELL) * side) as f32,
                        ((f64::from(y) + sy) / f64::from(CELL) * side) as f32,
                    );
                    let uv = tile.uv(m);
                    let at = |w: u32, h: u32| {
                        ((uv.x.rem_euclid(1.0) * w as f32) as u32 % w, (uv.y.rem_euclid(1.0) * h as f32) as u32 % h)
                    };
                    let (i, j) = at(tile.color.width(), tile.color.height());
                    let c = tile.color.get_pixel(i, j).0;
                    let n = tile.normal.as_ref().map_or([0.0, 0.0, 1.0], |t| {
                        let (i, j) = at(t.width(), t.height());
                        t.get_pixel(i, j).0.map(|b| f64::from(b) / 127.5 - 1.0)
                    });
                    let light = n.iter().zip(LIGHT).map(|(a, b)| a * b / norm).sum::<f64>().max(0.0);
                    for (t, b) in sum.iter_mut().zip(c) {
                        *t += linear(b) * (0.35 + 0.65 * light / 0.62) / 4.0;
                    }
                }
                sheet.put_pixel(x0 + x, y0 + y, Rgb(sum.map(byte)));
            }
        }
    }
    sheet.save(&out)?;
    Ok(())
}
