//! Labels that do not lie on each other.
//!
//! Each label tries places on a grid around its thing and takes the cheapest: near the middle of its thing, clear of
//! other labels and of what must stay readable, across few lines. One that ends up beside its thing gets a leader.

use glam::DVec2;

use super::drawing::{Anchor, Drawing, LETTER, Layer, Shape};
use super::outline::{Loop, Stroke, area, bounds};

/// Height of a tag's number and of a name, millimetres.
const TAG_TEXT_MM: f64 = 1.9;
const NAME_TEXT_MM: f64 = 2.2;
/// Radius of a tag, millimetres.
const TAG_MM: f64 = 2.1;
/// Step and reach of the tried places, millimetres.
const STEP_MM: f64 = 1.5;
const REACH_MM: f64 = 13.0;

/// An upright box.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rect {
    pub low: DVec2,
    pub high: DVec2,
}

impl Rect {
    fn overlap(&self, other: &Self) -> f64 {
        let side = (self.high.min(other.high) - self.low.max(other.low)).max(DVec2::ZERO);
        side.x * side.y
    }

    fn crossed(&self, a: DVec2, b: DVec2) -> bool {
        // Liang and Barsky: the part of the line inside the box.
        let d = b - a;
        let (mut t0, mut t1) = (0.0_f64, 1.0_f64);
        for (p, q) in
            [(-d.x, a.x - self.low.x), (d.x, self.high.x - a.x), (-d.y, a.y - self.low.y), (d.y, self.high.y - a.y)]
        {
            if p.abs() < 1e-12 {
                if q < 0.0 {
                    return false;
                }
            } else if p < 0.0 {
                t0 = t0.max(q / p);
            } else {
                t1 = t1.min(q / p);
            }
        }
        t0 < t1
    }
}

/// What is to be labelled.
#[derive(Debug, Clone)]
pub(crate) struct Wanted<'a> {
    /// Number in its tag.
    pub number: usize,
    /// Name beside the tag, where there is room for it.
    pub name: Option<&'a str>,
    /// Its outline.
    pub outline: &'a [Loop],
}

/// Places and draws labels; `taken` are boxes that stay free, `page` is where labels may be. Returns the labels' boxes.
pub(crate) fn place(
    drawing: &mut Drawing,
    wanted: &[Wanted<'_>],
    lines: &[Stroke],
    taken: &[Rect],
    page: Rect,
) -> Vec<Rect> {
    let mm = |v: f64| v / 1000.0 * drawing.scale;
    let mut placed: Vec<Rect> = Vec::new();
    let mut marks = Vec::new();
    for want in wanted {
        let Some((low, high)) = bounds(want.outline) else { continue };
        let middle = (low + high) / 2.0;
        let wide = |name: &str| mm(TAG_MM * 2.0 + 0.8) + name.chars().count() as f64 * LETTER * mm(NAME_TEXT_MM);
        let named = want.name.filter(|n| wide(n) < (high.x - low.x).max(mm(14.0)) && mm(TAG_MM * 2.0) < high.y - low.y);
        let size = DVec2::new(named.map_or(mm(TAG_MM * 2.0), wide), mm(TAG_MM * 2.0));
        let mut best: Option<(f64, DVec2)> = None;
        let reach = (high - low) / 2.0 + mm(REACH_MM);
        let steps = (reach / mm(STEP_MM)).ceil().min(DVec2::splat(40.0));
        for i in -(steps.x as i32)..=steps.x as i32 {
            for j in -(steps.y as i32)..=steps.y as i32 {
                let at = middle + DVec2::new(f64::from(i), f64::from(j)) * mm(STEP_MM);
                let pad = DVec2::splat(mm(0.5));
                let rect = Rect { low: at - size / 2.0 - pad, high: at + size / 2.0 + pad };
                if rect.low.cmplt(page.low).any() || rect.high.cmpgt(page.high).any() {
                    continue;
                }
                let on_labels: f64 = placed.iter().map(|r| rect.overlap(r)).sum();
                let on_taken: f64 = taken.iter().map(|r| rect.overlap(r)).sum();
                let unit = mm(1.0) * mm(1.0);
                let inside = at.cmpge(low).all() && at.cmple(high).all();
                let crossed = lines
                    .iter()
                    .flat_map(|s| s.points.windows(2).map(move |w| (s.outer, w)))
                    .filter(|(_, w)| rect.crossed(DVec2::from_array(w[0]), DVec2::from_array(w[1])))
                    .map(|(outer, _)| if outer { 1.0 } else { 0.4 })
                    .sum::<f64>();
                // What lies under another thing is not labelled on that.
                let on_other = wanted
                    .iter()
                    .any(|o| o.number != want.number && covers(o.outline, at) && area(o.outline) < area(want.outline));
                let cost = on_labels / unit * 40.0
                    + on_taken / unit * 6.0
                    + (at - middle).length() / mm(1.0) * 0.35
                    + if inside { 0.0 } else { 5.0 }
                    + if on_other { 6.0 } else { 0.0 }
                    + crossed;
                if best.is_none_or(|(c, _)| cost < c - 1e-9) {
                    best = Some((cost, at));
                }
            }
        }
        let Some((_, at)) = best else { continue };
        let pad = DVec2::splat(mm(0.3));
        let rect = Rect { low: at - size / 2.0 - pad, high: at + size / 2.0 + pad };
        if at.cmplt(low).any() || at.cmpgt(high).any() {
            marks.push((Layer::Text, leader(at, mm(TAG_MM), nearest(want.outline, at))));
        }
        let centre = DVec2::new(rect.low.x + mm(TAG_MM) + pad.x, at.y);
        marks.push((Layer::Text, Shape::Area { points: corners(rect), fill: "#ffffff" }));
        marks.push((Layer::Text, Shape::Circle { centre, radius: mm(TAG_MM) }));
        let text =
            |at: DVec2, height: f64, anchor: Anchor, text: String| Shape::Text { at, height, anchor, angle: 0.0, text };
        marks.push((Layer::Text, text(centre, mm(TAG_TEXT_MM), Anchor::Middle, want.number.to_string())));
        if let Some(name) = named {
            let from = centre + DVec2::new(mm(TAG_MM + 0.8), 0.0);
            marks.push((Layer::Text, text(from, mm(NAME_TEXT_MM), Anchor::Left, name.to_owned())));
        }
        placed.push(rect);
    }
    for (layer, shape) in marks {
        drawing.add(layer, shape);
    }
    placed
}

/// Whether an outline covers a place (even-odd).
fn covers(outline: &[Loop], at: DVec2) -> bool {
    let crosses = |a: [f64; 2], b: [f64; 2]| {
        (a[1] > at.y) != (b[1] > at.y) && at.x < (b[0] - a[0]) * (at.y - a[1]) / (b[1] - a[1]) + a[0]
    };
    outline
        .iter()
        .flat_map(|l| (0..l.len()).map(move |i| (l[i], l[(i + 1) % l.len()])))
        .filter(|(a, b)| crosses(*a, *b))
        .count()
        % 2
        == 1
}

fn corners(r: Rect) -> Vec<DVec2> {
    vec![r.low, DVec2::new(r.high.x, r.low.y), r.high, DVec2::new(r.low.x, r.high.y)]
}

fn leader(at: DVec2, radius: f64, to: DVec2) -> Shape {
    let way = (to - at).try_normalize().unwrap_or(DVec2::Y);
    Shape::Line { points: vec![at + way * radius.min((to - at).length()), to], closed: false }
}

/// A point just inside an outline, near a place.
fn nearest(outline: &[Loop], at: DVec2) -> DVec2 {
    let Some((low, high)) = bounds(outline) else { return at };
    let edge = outline
        .iter()
        .flat_map(|l| (0..l.len()).map(move |i| (DVec2::from_array(l[i]), DVec2::from_array(l[(i + 1) % l.len()]))))
        .map(|(a, b)| {
            let t = ((at - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
            a + (b - a) * t
        })
        .min_by(|a, b| a.distance(at).total_cmp(&b.distance(at)))
        .unwrap_or((low + high) / 2.0);
    edge + ((low + high) / 2.0 - edge).clamp_length_max(0.03)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_crowded_things_keep_apart() {
        let mut drawing = Drawing {
            title: String::new(),
            scale: 50.0,
            sheet: [DVec2::ZERO, DVec2::new(5.0, 5.0)],
            marks: Vec::new(),
        };
        // Ten things of 10 cm beside each other: far smaller than their tags on paper.
        let outlines: Vec<Vec<Loop>> = (0..10)
            .map(|i| {
                let x = 2.0 + 0.1 * f64::from(i);
                vec![vec![[x, 2.0], [x + 0.1, 2.0], [x + 0.1, 2.1], [x, 2.1]]]
            })
            .collect();
        let wanted: Vec<Wanted<'_>> =
            outlines.iter().enumerate().map(|(i, o)| Wanted { number: i + 1, name: None, outline: o }).collect();
        let page = Rect { low: DVec2::ZERO, high: DVec2::splat(5.0) };
        let rects = place(&mut drawing, &wanted, &[], &[], page);
        assert_eq!(rects.len(), 10);
        for (i, a) in rects.iter().enumerate() {
            for b in &rects[..i] {
                assert!(a.overlap(b) < 1e-9);
            }
        }
    }

    #[test]
    fn a_line_through_a_box_is_seen() {
        let r = Rect { low: DVec2::ZERO, high: DVec2::ONE };
        assert!(r.crossed(DVec2::new(-1.0, 0.5), DVec2::new(2.0, 0.6)));
        assert!(!r.crossed(DVec2::new(-1.0, 1.5), DVec2::new(2.0, 1.6)));
        assert!(!r.crossed(DVec2::new(-2.0, 0.5), DVec2::new(-1.0, 0.5)));
    }
}
