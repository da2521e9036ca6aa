//! A drawing as SVG, in millimetres of paper.

use std::fmt::Write as _;

use glam::DVec2;

use super::drawing::{Anchor, Drawing, Layer, Mark, Shape, dimension_marks};
use crate::text::{escaped, num};

/// The drawing as a page that prints at its scale.
pub(crate) fn svg(drawing: &Drawing) -> String {
    let [low, high] = drawing.sheet;
    let size = (high - low) * 1000.0 / drawing.scale;
    let mut out = String::new();
    let _ = write!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}mm\" height=\"{h}mm\" viewBox=\"0 0 {w} {h}\" \
         font-family=\"Helvetica, Arial, 'Liberation Sans', sans-serif\" stroke-linecap=\"round\" stroke-linejoin=\"round\">\n\
         <title>{title}</title>\n<rect width=\"{w}\" height=\"{h}\" fill=\"#ffffff\"/>\n",
        w = num(size.x, 3),
        h = num(size.y, 3),
        title = escaped(&drawing.title),
    );
    // One group a run of marks on one layer, so that later marks stay above earlier ones.
    let mut open: Option<Layer> = None;
    for mark in &drawing.marks {
        if open != Some(mark.layer) {
            if open.is_some() {
                out.push_str("</g>\n");
            }
            let (color, _) = mark.layer.color();
            let _ = writeln!(
                out,
                "<g class=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{}\">",
                mark.layer.name().to_lowercase(),
                num(mark.layer.width_mm(), 3)
            );
            open = Some(mark.layer);
        }
        one(&mut out, drawing, mark, &mark.shape);
    }
    if open.is_some() {
        out.push_str("</g>\n");
    }
    out.push_str("</svg>\n");
    out
}

fn one(out: &mut String, drawing: &Drawing, mark: &Mark, shape: &Shape) {
    let [low, high] = drawing.sheet;
    let k = 1000.0 / drawing.scale;
    let at = |p: DVec2| format!("{} {}", num((p.x - low.x) * k, 3), num((high.y - p.y) * k, 3));
    let mut style = String::new();
    if mark.dashed || mark.layer.dashed() {
        style.push_str(" stroke-dasharray=\"1.8 1.1\"");
    }
    if let Some(width) = mark.width_mm {
        let _ = write!(style, " stroke-width=\"{}\"", num(width, 3));
    }
    match shape {
        Shape::Line { points, closed } => {
            let path: Vec<String> = points.iter().map(|p| at(*p)).collect();
            let end = if *closed { "Z" } else { "" };
            let _ = writeln!(out, "<path d=\"M{}{end}\"{style}/>", path.join("L"));
        }
        Shape::Area { points, fill } => {
            let path: Vec<String> = points.iter().map(|p| at(*p)).collect();
            let _ = writeln!(out, "<path d=\"M{}Z\" fill=\"{fill}\" stroke=\"none\"/>", path.join("L"));
        }
        Shape::Arc { centre, radius, from, to } => {
            let end = |angle: f64| *centre + DVec2::new(angle.cos(), angle.sin()) * *radius;
            let large = u8::from((to - from).rem_euclid(std::f64::consts::TAU) > std::f64::consts::PI);
            let r = num(radius * k, 3);
            let _ = writeln!(out, "<path d=\"M{}A{r} {r} 0 {large} 0 {}\"{style}/>", at(end(*from)), at(end(*to)));
        }
        Shape::Circle { centre, radius } => {
            let p = at(*centre);
            let (x, y) = p.split_once(' ').unwrap_or(("0", "0"));
            let _ = writeln!(out, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{}\"{style}/>", num(radius * k, 3));
        }
        Shape::Text { at: place, height, anchor, angle, text } => {
            let anchor = match anchor {
                Anchor::Left => "start",
                Anchor::Middle => "middle",
                Anchor::Right => "end",
            };
            let p = at(*place);
            let (x, y) = p.split_once(' ').unwrap_or(("0", "0"));
            let turn = if *angle == 0.0 {
                String::new()
            } else {
                format!(" transform=\"rotate({} {x} {y})\"", num(-angle.to_degrees(), 3))
            };
            let size = height * k;
            let color = mark.layer.color().0;
            let _ = writeln!(
                out,
                "<text x=\"{x}\" y=\"{y}\" dy=\"{}\" font-size=\"{}\" text-anchor=\"{anchor}\" fill=\"{color}\" stroke=\"none\"{turn}>{}</text>",
                num(size * 0.36, 3),
                num(size, 3),
                escaped(text)
            );
        }
        Shape::Dimension { a, b, line, text } => {
            for shape in dimension_marks(drawing, *a, *b, *line, text) {
                one(out, drawing, mark, &shape);
            }
        }
    }
}
