//! A drawing as DXF of release 12, which every CAD program reads: metres, layers, dimensions as dimensions.
//!
//! Each dimension is a DIMENSION entity with a block of its own that holds its lines and its number, as the format asks.
//! Filled areas are left out: their outlines are there.

use std::fmt::Write as _;

use glam::DVec2;

use super::drawing::{Anchor, Drawing, Layer, Shape, dimension_marks};
use crate::text::num;

/// Several drawings beside each other in one file, left to right.
pub(crate) fn dxf(drawing: &Drawing) -> String {
    let mut out = String::new();
    let [low, high] = drawing.sheet;
    pair(&mut out, 0, "SECTION");
    pair(&mut out, 2, "HEADER");
    pair(&mut out, 9, "$ACADVER");
    pair(&mut out, 1, "AC1009");
    for (name, p) in [("$EXTMIN", low), ("$EXTMAX", high)] {
        pair(&mut out, 9, name);
        point(&mut out, 10, p);
    }
    for (name, value) in [("$DIMTXT", 2.2), ("$DIMSCALE", 1.0)] {
        pair(&mut out, 9, name);
        pair(&mut out, 40, &num(if name == "$DIMTXT" { drawing.mm(value) } else { value }, 5));
    }
    pair(&mut out, 0, "ENDSEC");
    tables(&mut out, drawing);
    let mut blocks = String::new();
    let mut entities = String::new();
    let mut dimensions = 0;
    for mark in &drawing.marks {
        let dashed = mark.dashed && !mark.layer.dashed();
        if let Shape::Dimension { a, b, line, text } = &mark.shape {
            let name = format!("*D{dimensions}");
            dimensions += 1;
            pair(&mut blocks, 0, "BLOCK");
            pair(&mut blocks, 8, mark.layer.name());
            pair(&mut blocks, 2, &name);
            pair(&mut blocks, 70, "1");
            point(&mut blocks, 10, DVec2::ZERO);
            pair(&mut blocks, 3, &name);
            let mut middle = line[0];
            for shape in dimension_marks(drawing, *a, *b, *line, text) {
                if let Shape::Text { at, .. } = &shape {
                    middle = *at;
                }
                entity(&mut blocks, mark.layer, dashed, &shape);
            }
            pair(&mut blocks, 0, "ENDBLK");
            pair(&mut blocks, 8, mark.layer.name());
            pair(&mut entities, 0, "DIMENSION");
            pair(&mut entities, 8, mark.layer.name());
            pair(&mut entities, 2, &name);
            point(&mut entities, 10, line[1]);
            point(&mut entities, 11, middle);
            pair(&mut entities, 70, "0");
            pair(&mut entities, 1, text);
            point(&mut entities, 13, *a);
            point(&mut entities, 14, *b);
            let way = line[1] - line[0];
            pair(&mut entities, 50, &num(way.y.atan2(way.x).to_degrees(), 4));
        } else {
            entity(&mut entities, mark.layer, dashed, &mark.shape);
        }
    }
    pair(&mut out, 0, "SECTION");
    pair(&mut out, 2, "BLOCKS");
    out.push_str(&blocks);
    pair(&mut out, 0, "ENDSEC");
    pair(&mut out, 0, "SECTION");
    pair(&mut out, 2, "ENTITIES");
    out.push_str(&entities);
    pair(&mut out, 0, "ENDSEC");
    pair(&mut out, 0, "EOF");
    out
}

fn pair(out: &mut String, code: u32, value: &str) {
    let _ = write!(out, "{code:>3}\r\n{value}\r\n");
}

fn point(out: &mut String, code: u32, p: DVec2) {
    pair(out, code, &num(p.x, 5));
    pair(out, code + 10, &num(p.y, 5));
    pair(out, code + 20, "0.0");
}

fn tables(out: &mut String, drawing: &Drawing) {
    pair(out, 0, "SECTION");
    pair(out, 2, "TABLES");
    pair(out, 0, "TABLE");
    pair(out, 2, "LTYPE");
    pair(out, 70, "2");
    for (name, looks, dashes) in [("CONTINUOUS", "Solid line", &[][..]), ("DASHED", "__ __ __", &[1.8, -1.1][..])] {
        pair(out, 0, "LTYPE");
        pair(out, 2, name);
        pair(out, 70, "0");
        pair(out, 3, looks);
        pair(out, 72, "65");
        pair(out, 73, &dashes.len().to_string());
        pair(out, 40, &num(dashes.iter().map(|d: &f64| drawing.mm(d.abs())).sum(), 5));
        for d in dashes {
            pair(out, 49, &num(drawing.mm(*d), 5));
        }
    }
    pair(out, 0, "ENDTAB");
    pair(out, 0, "TABLE");
    pair(out, 2, "LAYER");
    pair(out, 70, &(Layer::ALL.len() + 1).to_string());
    for (name, color, dashed) in
        std::iter::once(("0", 7, false)).chain(Layer::ALL.into_iter().map(|l| (l.name(), l.color().1, l.dashed())))
    {
        pair(out, 0, "LAYER");
        pair(out, 2, name);
        pair(out, 70, "0");
        pair(out, 62, &color.to_string());
        pair(out, 6, if dashed { "DASHED" } else { "CONTINUOUS" });
    }
    pair(out, 0, "ENDTAB");
    pair(out, 0, "TABLE");
    pair(out, 2, "STYLE");
    pair(out, 70, "1");
    pair(out, 0, "STYLE");
    pair(out, 2, "STANDARD");
    for (code, value) in [(70, "0"), (40, "0.0"), (41, "0.9"), (50, "0.0"), (71, "0"), (42, "0.2"), (3, "txt"), (4, "")]
    {
        pair(out, code, value);
    }
    pair(out, 0, "ENDTAB");
    pair(out, 0, "ENDSEC");
}

fn entity(out: &mut String, layer: Layer, dashed: bool, shape: &Shape) {
    let head = |out: &mut String, kind: &str| {
        pair(out, 0, kind);
        pair(out, 8, layer.name());
        if dashed {
            pair(out, 6, "DASHED");
        }
    };
    match shape {
        Shape::Line { points, closed: false } if points.len() == 2 => {
            head(out, "LINE");
            point(out, 10, points[0]);
            point(out, 11, points[1]);
        }
        Shape::Line { points, closed } => {
            head(out, "POLYLINE");
            pair(out, 66, "1");
            point(out, 10, DVec2::ZERO);
            pair(out, 70, if *closed { "1" } else { "0" });
            for p in points {
                pair(out, 0, "VERTEX");
                pair(out, 8, layer.name());
                point(out, 10, *p);
            }
            pair(out, 0, "SEQEND");
            pair(out, 8, layer.name());
        }
        Shape::Arc { centre, radius, from, to } => {
            head(out, "ARC");
            point(out, 10, *centre);
            pair(out, 40, &num(*radius, 5));
            pair(out, 50, &num(from.to_degrees().rem_euclid(360.0), 4));
            pair(out, 51, &num(to.to_degrees().rem_euclid(360.0), 4));
        }
        Shape::Circle { centre, radius } => {
            head(out, "CIRCLE");
            point(out, 10, *centre);
            pair(out, 40, &num(*radius, 5));
        }
        Shape::Text { at, height, anchor, angle, text } => {
            head(out, "TEXT");
            point(out, 10, *at);
            pair(out, 40, &num(*height, 5));
            // Release 12 has no letters beyond ASCII but by their number.
            let plain: String = text
                .chars()
                .filter(|c| !c.is_control())
                .map(|c| if c.is_ascii() { c.to_string() } else { format!("\\U+{:04X}", u32::from(c)) })
                .collect();
            pair(out, 1, &plain);
            pair(out, 50, &num(angle.to_degrees(), 4));
            pair(out, 7, "STANDARD");
            let across = match anchor {
                Anchor::Left => "0",
                Anchor::Middle => "1",
                Anchor::Right => "2",
            };
            pair(out, 72, across);
            point(out, 11, *at);
            pair(out, 73, "2");
        }
        // Fills are for the page; dimensions are written by their own entity.
        Shape::Area { .. } | Shape::Dimension { .. } => {}
    }
}
