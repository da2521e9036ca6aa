//! Packs charts into the unit square, all at one scale.

use glam::{DVec2, Vec2Swizzles as _};

/// Gap around each chart, fraction of the square (one texel of a 256-pixel texture on each side).
const GAP: f64 = 1.0 / 256.0;
/// Steps of the search for the scale.
const STEPS: usize = 24;

/// Where a chart went: `uv = offset + scale * (turned ? (v, u) : (u, v))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChartPlace {
    /// Lowest corner in the unit square.
    pub offset: DVec2,
    /// Whether u and v are exchanged.
    pub turned: bool,
}

/// Places rectangles of `sizes` (metres) without overlap; returns the common scale and each place.
pub fn pack_charts(sizes: &[DVec2]) -> (f64, Vec<ChartPlace>) {
    if sizes.is_empty() {
        return (1.0, Vec::new());
    }
    let area: f64 = sizes.iter().map(|s| s.x * s.y).sum();
    let longest = sizes.iter().map(|s| s.max_element()).fold(1e-9, f64::max);
    // the gaps of many charts can fill the square: they shrink then
    let gap = GAP.min(0.25 / (sizes.len() as f64).sqrt());
    let mut low = 0.0;
    let mut high = (1.0 / area.max(1e-18).sqrt()).min((1.0 - 2.0 * gap) / longest);
    let mut best: Option<(f64, Vec<ChartPlace>)> = None;
    for step in 0..STEPS {
        let scale = if step == 0 { high } else { f64::midpoint(low, high) };
        match place(sizes, scale, gap) {
            Some(places) => {
                low = scale;
                best = Some((scale, places));
                if step == 0 {
                    break;
                }
            }
            None => high = scale,
        }
    }
    best.unwrap_or_else(|| {
        // never reached with a gap that fits: everything as points in the middle
        (0.0, vec![ChartPlace { offset: DVec2::splat(0.5), turned: false }; sizes.len()])
    })
}

/// Shelves of upright rectangles, tallest first.
fn place(sizes: &[DVec2], scale: f64, gap: f64) -> Option<Vec<ChartPlace>> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by(|a, b| sizes[*b].max_element().total_cmp(&sizes[*a].max_element()).then(a.cmp(b)));
    let mut places = vec![ChartPlace { offset: DVec2::ZERO, turned: false }; sizes.len()];
    // shelves are kept open: a small chart may still fit at the end of an earlier one
    let mut shelves: Vec<(f64, f64, f64)> = Vec::new();
    let mut top = 0.0;
    for i in order {
        let turned = sizes[i].x > sizes[i].y;
        let s = (if turned { sizes[i].yx() } else { sizes[i] }) * scale + DVec2::splat(2.0 * gap);
        let (w, h) = (s.x, s.y);
        let shelf = shelves.iter_mut().find(|(_, x, height)| *x + w <= 1.0 && h <= *height + 1e-12);
        let at = if let Some((y, x, _)) = shelf {
            let at = DVec2::new(*x, *y);
            *x += w;
            at
        } else {
            if top + h > 1.0 || w > 1.0 {
                return None;
            }
            let at = DVec2::new(0.0, top);
            shelves.push((top, w, h));
            top += h;
            at
        };
        places[i] = ChartPlace { offset: at + DVec2::splat(gap), turned };
    }
    Some(places)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_of_all_shapes_lie_apart_inside_the_square() {
        let mut state = 7_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as f64 / f64::from(1_u32 << 31)
        };
        for count in [1, 2, 7, 60, 700] {
            let sizes: Vec<DVec2> = (0..count).map(|_| DVec2::new(next() + 0.01, next().powi(4) + 0.001)).collect();
            let (scale, places) = pack_charts(&sizes);
            let rects: Vec<(DVec2, DVec2)> = sizes
                .iter()
                .zip(&places)
                .map(|(s, p)| (p.offset, p.offset + (if p.turned { s.yx() } else { *s }) * scale))
                .collect();
            for (i, (a0, a1)) in rects.iter().enumerate() {
                assert!(a0.min_element() >= 0.0 && a1.max_element() <= 1.0, "{count}: {a0} {a1}");
                for (b0, b1) in &rects[..i] {
                    let apart = a1.x <= b0.x || b1.x <= a0.x || a1.y <= b0.y || b1.y <= a0.y;
                    assert!(apart, "{count}: {a0} {a1} meets {b0} {b1}");
                }
            }
            let used: f64 = sizes.iter().map(|s| s.x * s.y).sum::<f64>() * scale * scale;
            assert!(used > if count > 100 { 0.25 } else { 0.0 }, "{count} charts fill {used}");
        }
    }
}
