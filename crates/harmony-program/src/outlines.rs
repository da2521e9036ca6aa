//! Outlines: their union, difference and offset, exact on integers (crate `i_overlay`), and letters from strokes.

use glam::DVec2;
use harmony_shape::tree::Outline;
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::float::single::SingleFloatOverlay;

type Loop = Vec<[f64; 2]>;

/// Twice the signed area of a loop, positive anticlockwise.
pub(crate) fn area2(points: &[[f64; 2]]) -> f64 {
    let n = points.len();
    (0..n).map(|i| points[i][0] * points[(i + 1) % n][1] - points[(i + 1) % n][0] * points[i][1]).sum()
}

/// A loop turned anticlockwise.
pub(crate) fn anticlockwise(mut points: Loop) -> Loop {
    if area2(&points) < 0.0 {
        points.reverse();
    }
    points
}

fn collect(outline: &Outline, loops: &mut Vec<Loop>) {
    // Outer loops anticlockwise and holes clockwise: with the non-zero rule holes stay holes.
    loops.push(anticlockwise(outline.points.clone()));
    for hole in &outline.holes {
        let mut hole = anticlockwise(hole.clone());
        hole.reverse();
        loops.push(hole);
    }
    for island in &outline.islands {
        collect(island, loops);
    }
}

fn loops_of(outline: &Outline) -> Vec<Loop> {
    let mut loops = Vec::new();
    collect(outline, &mut loops);
    loops
}

fn from_shapes(shapes: Vec<Vec<Loop>>) -> Option<Outline> {
    let mut parts: Vec<Outline> = shapes
        .into_iter()
        .filter_map(|shape| {
            let mut loops = shape.into_iter().filter(|l| l.len() >= 3 && area2(l).abs() > 1e-12);
            let points = anticlockwise(loops.next()?);
            let holes = loops
                .map(|hole| {
                    let mut hole = anticlockwise(hole);
                    hole.reverse();
                    hole
                })
                .collect();
            Some(Outline { points, holes, islands: Vec::new() })
        })
        .collect();
    // Largest first, so that the outline's own loop is its main one; ties keep their order.
    parts.sort_by(|a, b| area2(&b.points).abs().total_cmp(&area2(&a.points).abs()));
    let mut parts = parts.into_iter();
    let mut first = parts.next()?;
    first.islands = parts.collect();
    Some(first)
}

/// What two outlines have together.
pub(crate) fn union(a: &Outline, b: &Outline) -> Option<Outline> {
    from_shapes(loops_of(a).overlay(&loops_of(b), OverlayRule::Union, FillRule::NonZero))
}

/// The first without the second; none when nothing is left.
pub(crate) fn difference(a: &Outline, b: &Outline) -> Option<Outline> {
    from_shapes(loops_of(a).overlay(&loops_of(b), OverlayRule::Difference, FillRule::NonZero))
}

/// A stroke of a pen with a round tip.
fn capsule(a: DVec2, b: DVec2, radius: f64) -> Loop {
    const STEPS: usize = 6;
    let along = (b - a).try_normalize().unwrap_or(DVec2::X);
    let across = DVec2::new(-along.y, along.x);
    let cap = |centre: DVec2, from: DVec2, to: DVec2| {
        (0..=STEPS).map(move |i| {
            let angle = std::f64::consts::PI * i as f64 / STEPS as f64;
            (centre + from * (radius * libm::cos(angle)) + to * (radius * libm::sin(angle))).to_array()
        })
    };
    cap(b, -across, along).chain(cap(a, across, -along)).collect()
}

/// Strokes of a pen with a round tip, as one outline with islands.
pub(crate) fn stroked(lines: &[Vec<DVec2>], radius: f64) -> Option<Outline> {
    let capsules: Vec<Loop> = lines.iter().flat_map(|l| l.windows(2)).map(|w| capsule(w[0], w[1], radius)).collect();
    let nothing: Vec<Loop> = Vec::new();
    from_shapes(capsules.overlay(&nothing, OverlayRule::Subject, FillRule::NonZero))
}

/// An outline grown (or shrunk, for a negative distance), corners rounded where it grows.
pub(crate) fn offset(outline: &Outline, distance: f64) -> Option<Outline> {
    let loops = loops_of(outline);
    let edges: Vec<Vec<DVec2>> =
        loops.iter().map(|l| l.iter().chain(l.first()).copied().map(DVec2::from).collect::<Vec<_>>()).collect();
    let rim: Vec<Loop> = edges.iter().flat_map(|l| l.windows(2)).map(|w| capsule(w[0], w[1], distance.abs())).collect();
    let rule = if distance >= 0.0 { OverlayRule::Union } else { OverlayRule::Difference };
    from_shapes(loops.overlay(&rim, rule, FillRule::NonZero))
}

/// A closed or open line with its corners cut twice (Chaikin), so that it looks drawn by hand and not by ruler.
fn rounded(points: &[DVec2]) -> Vec<DVec2> {
    let closed = points.len() > 3 && points[0] == points[points.len() - 1];
    let mut line = points.to_vec();
    for _ in 0..2 {
        let mut next = Vec::with_capacity(2 * line.len());
        if !closed {
            next.push(line[0]);
        }
        for w in line.windows(2) {
            next.push(w[0] * 0.75 + w[1] * 0.25);
            next.push(w[0] * 0.25 + w[1] * 0.75);
        }
        if closed {
            next.push(next[0]);
        } else {
            next.push(line[line.len() - 1]);
        }
        line = next;
    }
    line
}

/// A text as strokes of a pen: capitals `size` high, the baseline at y = 0, centred in x.
///
/// Letters are our own, drawn on a grid of 6 by 8 with a descender of 3; accents are left out and what is unknown is a
/// box. Returns none when there is nothing to draw.
pub(crate) fn text(text: &str, size: f64, weight: f64) -> Option<Outline> {
    let unit = size / 8.0;
    let mut lines = Vec::new();
    let mut x = 0.0;
    for c in text.chars() {
        let (width, strokes) = crate::letters::glyph(c);
        for stroke in strokes {
            let points: Vec<DVec2> = stroke.points.iter().map(|p| (*p + DVec2::new(x, 0.0)) * unit).collect();
            lines.push(if stroke.round { rounded(&points) } else { points });
        }
        x += width + 1.8;
    }
    let middle = DVec2::new((x - 1.8).max(0.0) / 2.0 * unit, 0.0);
    for line in &mut lines {
        for p in line {
            *p -= middle;
        }
    }
    stroked(&lines, size * weight / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(side: f64) -> Outline {
        let h = side / 2.0;
        Outline { points: vec![[-h, -h], [h, -h], [h, h], [-h, h]], ..Outline::default() }
    }

    fn area(o: &Outline) -> f64 {
        let holes: f64 = o.holes.iter().map(|h| area2(h).abs() / 2.0).sum();
        area2(&o.points).abs() / 2.0 - holes + o.islands.iter().map(area).sum::<f64>()
    }

    #[test]
    fn union_difference_and_offset_have_the_areas_of_reason() {
        let (big, small) = (square(2.0), square(1.0));
        assert!((area(&difference(&big, &small).unwrap()) - 3.0).abs() <= 1e-6);
        assert_eq!(difference(&big, &small).unwrap().holes.len(), 1);
        assert!((area(&union(&big, &small).unwrap()) - 4.0).abs() <= 1e-6);
        assert!(difference(&small, &big).is_none());
        // Shrunk squares stay square; grown ones get round corners: area = 4 + 4 * 2 * d + pi d^2 (12-gon a bit less).
        assert!((area(&offset(&big, -0.25).unwrap()) - 2.25).abs() <= 1e-6);
        let grown = area(&offset(&big, 0.25).unwrap());
        assert!((grown - (4.0 + 2.0 + std::f64::consts::PI * 0.0625)).abs() <= 0.01, "{grown}");
        // A ring shrinks from both sides.
        let ring = offset(&difference(&big, &small).unwrap(), -0.1).unwrap();
        assert!((area(&ring) - (1.8 * 1.8 - (1.0 + 0.4 + std::f64::consts::PI * 0.01))).abs() <= 0.01);
    }

    #[test]
    fn letters_have_the_holes_and_islands_of_letters() {
        let o = text("O", 0.1, 0.16).unwrap();
        assert_eq!((o.holes.len(), o.islands.len()), (1, 0));
        let i = text("i", 0.1, 0.16).unwrap();
        assert_eq!((i.holes.len(), i.islands.len()), (0, 1));
        let b = text("B", 0.1, 0.16).unwrap();
        assert_eq!((b.holes.len(), b.islands.len()), (2, 0));
        assert!(text("  ", 0.1, 0.16).is_none());
        let [min, max] = crate::bounds::of_outline(&text("HELLO", 0.1, 0.16).unwrap()).unwrap();
        assert!((max[1] - 0.108).abs() <= 1e-3 && (min[1] + 0.008).abs() <= 1e-3, "{min:?} {max:?}");
        assert!((max[0] + min[0]).abs() <= 1e-3, "centred");
    }
}
