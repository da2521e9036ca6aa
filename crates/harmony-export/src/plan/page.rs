//! Sheets: A3 across, frame, title, list of things, scale bar.

use glam::DVec2;

use super::drawing::{Anchor, Drawing, Layer, Shape};
use super::schedule::Row;
use crate::World;

/// A3 across, millimetres.
pub(crate) const PAPER_MM: DVec2 = DVec2::new(420.0, 297.0);
/// Free edge, millimetres.
pub(crate) const EDGE_MM: f64 = 10.0;
/// Width of the column with list and title, millimetres.
pub(crate) const COLUMN_MM: f64 = 112.0;
/// Height of the title, millimetres.
pub(crate) const TITLE_MM: f64 = 46.0;
/// Scales that drawings are made at.
const SCALES: [f64; 11] = [10.0, 20.0, 25.0, 30.0, 40.0, 50.0, 75.0, 100.0, 200.0, 500.0, 1000.0];

/// The largest scale at which something of so many metres fits so many millimetres.
pub(crate) fn scale_for(size: DVec2, room_mm: DVec2) -> f64 {
    let fits = |n: &&f64| (size * 1000.0 / **n).cmple(room_mm).all();
    SCALES.iter().find(fits).copied().unwrap_or(SCALES[SCALES.len() - 1])
}

/// An empty sheet; `origin` is the drawing's place of its lower left corner.
pub(crate) fn sheet(title: &str, scale: f64, origin: DVec2) -> Drawing {
    let high = origin + PAPER_MM / 1000.0 * scale;
    let mut drawing = Drawing { title: title.to_owned(), scale, sheet: [origin, high], marks: Vec::new() };
    let (a, b) = (at(&drawing, EDGE_MM, EDGE_MM), at(&drawing, PAPER_MM.x - EDGE_MM, PAPER_MM.y - EDGE_MM));
    let frame = [a, DVec2::new(b.x, a.y), b, DVec2::new(a.x, b.y)];
    drawing.closed(Layer::Sheet, &frame).width_mm = Some(0.5);
    drawing
}

/// A place on the paper, millimetres from its lower left corner.
pub(crate) fn at(drawing: &Drawing, x_mm: f64, y_mm: f64) -> DVec2 {
    drawing.sheet[0] + DVec2::new(x_mm, y_mm) / 1000.0 * drawing.scale
}

/// The title in the lower right corner.
pub(crate) fn title(drawing: &mut Drawing, world: &World, what: &str, notes: &[String]) {
    let (left, right) = (PAPER_MM.x - EDGE_MM - COLUMN_MM, PAPER_MM.x - EDGE_MM);
    let (low, high) = (EDGE_MM, EDGE_MM + TITLE_MM);
    let corner = |d: &Drawing, x: f64, y: f64| at(d, x, y);
    let frame = [
        corner(drawing, left, low),
        corner(drawing, right, low),
        corner(drawing, right, high),
        corner(drawing, left, high),
    ];
    drawing.add(Layer::Sheet, Shape::Area { points: frame.to_vec(), fill: "#ffffff" });
    drawing.closed(Layer::Sheet, &frame).width_mm = Some(0.35);
    let room = world.scene.room.room_type.replace('_', " ");
    let mut y = high - 6.0;
    let mut row = |drawing: &mut Drawing, size: f64, text: &str| {
        let p = at(drawing, left + 3.0, y);
        drawing.text(Layer::Sheet, p, size, Anchor::Left, text);
        y -= size + 2.2;
    };
    row(drawing, 4.0, &format!("{what}: {room}"));
    let e = world.scene.room.extents;
    row(drawing, 2.4, &format!("Scale 1:{:.0} (A3), dimensions in metres", drawing.scale));
    row(
        drawing,
        2.4,
        &format!(
            "Room {:.2} x {:.2} m, height {:.2} m, {:.1} m2",
            e.width,
            e.depth,
            e.height,
            world.scene.room.floor_area()
        ),
    );
    for note in notes.iter().take(4) {
        row(drawing, 2.0, note);
    }
    row(drawing, 1.8, &format!("From one photograph; {}", world.scene.generator.chars().take(60).collect::<String>()));
}

/// The list of things above the title; those that don't fit are counted.
pub(crate) fn list(drawing: &mut Drawing, rows: &[Row]) {
    let left = PAPER_MM.x - EDGE_MM - COLUMN_MM;
    let right = PAPER_MM.x - EDGE_MM;
    let (top, bottom) = (PAPER_MM.y - EDGE_MM, EDGE_MM + TITLE_MM);
    let fence = [at(drawing, left, top), at(drawing, left, bottom)];
    drawing.line(Layer::Sheet, &fence).width_mm = Some(0.35);
    let height = ((top - bottom - 12.0) / (rows.len() as f64 + 1.0)).clamp(3.2, 5.2);
    let size = (height * 0.46).min(2.2);
    let columns = [left + 7.0, left + 10.0, left + 84.0, left + 95.0, right - 2.0];
    let mut y = top - 6.0;
    let write = |drawing: &mut Drawing, x: f64, y: f64, anchor: Anchor, text: String| {
        let p = at(drawing, x, y);
        drawing.text(Layer::Sheet, p, size, anchor, text);
    };
    for (k, (text, anchor)) in [
        ("No.", Anchor::Right),
        ("Object", Anchor::Left),
        ("W x D x H, m", Anchor::Right),
        ("+- m", Anchor::Right),
        ("conf.", Anchor::Right),
    ]
    .into_iter()
    .enumerate()
    {
        write(drawing, columns[k], y, anchor, text.to_owned());
    }
    y -= height * 0.6;
    let rule = [at(drawing, left, y), at(drawing, right, y)];
    drawing.line(Layer::Sheet, &rule);
    y -= height * 0.6;
    let fit = ((y - bottom - 2.0) / height).max(0.0) as usize + 1;
    for row in rows.iter().take(if rows.len() > fit { fit.saturating_sub(1) } else { fit }) {
        write(drawing, columns[0], y, Anchor::Right, row.number.to_string());
        write(drawing, columns[1], y, Anchor::Left, shortened(&row.label, 34));
        let s = row.size;
        write(drawing, columns[2], y, Anchor::Right, format!("{:.2} x {:.2} x {:.2}", s.width, s.depth, s.height));
        write(drawing, columns[3], y, Anchor::Right, row.position_pm.map_or("-".to_owned(), |v| format!("{v:.2}")));
        write(drawing, columns[4], y, Anchor::Right, format!("{:.0} %", row.confidence * 100.0));
        y -= height;
    }
    if rows.len() > fit {
        write(drawing, columns[1], y, Anchor::Left, format!("and {} more: furniture.csv", rows.len() + 1 - fit));
    }
}

fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        text.to_owned()
    } else {
        text.chars().take(most - 2).chain("..".chars()).collect()
    }
}

/// A scale bar, from a place to the right.
pub(crate) fn scale_bar(drawing: &mut Drawing, from: DVec2) {
    let unit =
        [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0].into_iter().find(|u| u * 1000.0 / drawing.scale >= 12.0).unwrap_or(20.0);
    let high = drawing.mm(1.6);
    for k in 0..4 {
        let a = from + DVec2::new(unit * f64::from(k), 0.0);
        let points = vec![a, a + DVec2::new(unit, 0.0), a + DVec2::new(unit, high), a + DVec2::new(0.0, high)];
        if k % 2 == 0 {
            drawing.add(Layer::Sheet, Shape::Area { points: points.clone(), fill: "#111111" });
        }
        drawing.closed(Layer::Sheet, &points);
    }
    for k in 0..=4 {
        let p = from + DVec2::new(unit * f64::from(k), high + drawing.mm(2.2));
        let text = crate::text::num(unit * f64::from(k), 1);
        drawing.text(Layer::Sheet, p, 2.0, Anchor::Middle, if k == 4 { format!("{text} m") } else { text });
    }
}
