//! Outlines of masks as polygons.

use harmony_scene::Mask;

/// Ways along pixel edges: right, down, left, up.
const STEP: [(i64, i64); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];
/// The pixel ahead of a corner on the left of each way.
const LEFT: [(i64, i64); 4] = [(0, -1), (0, 0), (-1, 0), (-1, -1)];
/// And on its right.
const RIGHT: [(i64, i64); 4] = [(0, 0), (-1, 0), (-1, -1), (0, -1)];

/// The outer outline of the largest connected part of a mask, simplified so that it stays within `tolerance` pixels
/// (Douglas-Peucker); clockwise on the screen, in pixel coordinates (pixel corners). Empty for an empty mask.
pub fn trace_outline(mask: &Mask, tolerance: f64) -> Vec<[f64; 2]> {
    let (w, h) = (mask.size().width as usize, mask.size().height as usize);
    let (labels, counts) = harmony_scene::components(mask.bits(), w, h);
    let Some((largest, n)) = counts.iter().enumerate().max_by_key(|(i, n)| (**n, std::cmp::Reverse(*i))) else {
        return Vec::new();
    };
    if *n == 0 {
        return Vec::new();
    }
    let inside = |x: i64, y: i64| {
        x >= 0 && y >= 0 && x < w as i64 && y < h as i64 && labels[y as usize * w + x as usize] == largest as u32
    };
    let Some(start) = labels.iter().position(|l| *l == largest as u32) else { return Vec::new() };
    let start = ((start % w) as i64, (start / w) as i64);
    // Walk along pixel edges with the set on the right hand.
    let (mut at, mut way) = (start, 0_usize);
    let mut points = Vec::new();
    for _ in 0..4 * (w + 1) * (h + 1) {
        let before = way;
        let left = inside(at.0 + LEFT[way].0, at.1 + LEFT[way].1);
        let right = inside(at.0 + RIGHT[way].0, at.1 + RIGHT[way].1);
        // 4-connected: at a diagonal touch keep to the own pixel.
        way = if !right {
            (way + 1) % 4
        } else if left {
            (way + 3) % 4
        } else {
            way
        };
        if way != before || points.is_empty() {
            points.push([at.0 as f64, at.1 as f64]);
        }
        at = (at.0 + STEP[way].0, at.1 + STEP[way].1);
        if at == start {
            break;
        }
    }
    simplify_closed(&points, tolerance)
}

/// Douglas-Peucker on a closed line, split at its two most distant points (one of them the first).
fn simplify_closed(points: &[[f64; 2]], tolerance: f64) -> Vec<[f64; 2]> {
    if points.len() < 4 {
        return points.to_vec();
    }
    let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let far = (0..points.len())
        .max_by(|a, b| distance(points[*a], points[0]).total_cmp(&distance(points[*b], points[0])))
        .unwrap_or(0);
    let mut keep = vec![false; points.len() + 1];
    keep[0] = true;
    keep[far] = true;
    let mut ring = points.to_vec();
    ring.push(points[0]);
    let mut stack = vec![(0, far), (far, points.len())];
    while let Some((a, b)) = stack.pop() {
        let (pa, pb) = (ring[a], ring[b]);
        let length = distance(pa, pb);
        let mut worst = (0.0, a);
        for (i, p) in ring.iter().enumerate().take(b).skip(a + 1) {
            let d = if length > 0.0 {
                ((pb[0] - pa[0]) * (p[1] - pa[1]) - (pb[1] - pa[1]) * (p[0] - pa[0])).abs() / length
            } else {
                distance(*p, pa)
            };
            if d > worst.0 {
                worst = (d, i);
            }
        }
        if worst.0 > tolerance {
            keep[worst.1] = true;
            stack.push((a, worst.1));
            stack.push((worst.1, b));
        }
    }
    points.iter().zip(&keep).filter(|(_, k)| **k).map(|(p, _)| *p).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polygon::rasterize;
    use harmony_scene::ImageSize;

    #[test]
    fn an_exact_outline_fills_to_the_mask_and_a_square_has_four_corners() {
        let size = ImageSize::new(60, 50);
        let blob = Mask::from_fn(size, |x, y| {
            let (dx, dy) = (f64::from(x) - 30.0, f64::from(y) - 22.0);
            dx * dx / 500.0 + dy * dy / 200.0 + (dx * dy / 400.0) < 1.0
        });
        let filled = rasterize(&trace_outline(&blob, 0.0), 60, 50);
        assert_eq!(filled, blob.bits());
        let square = Mask::from_fn(size, |x, y| (5..20).contains(&x) && (7..30).contains(&y));
        assert_eq!(trace_outline(&square, 0.5), vec![[5.0, 7.0], [20.0, 7.0], [20.0, 30.0], [5.0, 30.0]]);
        assert!(trace_outline(&Mask::empty(size), 1.0).is_empty());
        let full = Mask::from_fn(size, |_, _| true);
        assert_eq!(trace_outline(&full, 0.5).len(), 4);
    }
}
