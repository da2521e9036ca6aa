//! Skins through outlines.

use glam::{DVec2, DVec3};

use super::collect::Collector;
use super::math::{self, turn_deg};
use super::outline::{self, CREASE};
use crate::Piece;
use crate::tree::LoftSection;

/// Most columns around.
const MAX_COLUMNS: usize = 160;
/// Columns by which sections are matched.
const MATCH: usize = 48;

/// A closed skin through outlines in order, their points matched by length and least twist; flat ends unless the last
/// joins the first.
///
/// # Errors
/// With fewer than two sections, or one that spans no area.
pub fn loft(sections: &[LoftSection], closed: bool) -> Result<Piece, String> {
    if sections.len() < 2 {
        return Err("a loft needs at least two sections".into());
    }
    let closed = closed && sections.len() > 2;
    let mut loops: Vec<Vec<DVec2>> = Vec::new();
    for s in sections {
        let islands = outline::islands(&s.outline)?;
        let first = islands.first().and_then(|i| i.loops.first()).ok_or("a section of a loft has no outline")?;
        loops.push(first.clone());
    }
    // the same number of points, corner by corner where that is given
    let same = loops.iter().all(|l| l.len() == loops[0].len());
    let columns: Vec<Vec<DVec2>> = if same { turned_to_match(&loops) } else { resampled(&loops) };
    let n = columns[0].len();
    let place = |k: usize, p: DVec2| {
        let s = &sections[k];
        DVec3::from_array(s.at) + turn_deg(s.turn_deg) * DVec3::new(p.x, 0.0, -p.y)
    };
    let rows: Vec<Vec<DVec3>> =
        columns.iter().enumerate().map(|(k, l)| l.iter().map(|p| place(k, *p)).collect()).collect();
    let sharp_column: Vec<bool> = (0..n).map(|i| columns.iter().all(|l| corner(l, i) > CREASE)).collect();
    let count = rows.len();
    let sharp_row = |k: usize| {
        // a crease where most columns bend sharply
        let (a, b) = (&rows[(k + count - 1) % count], &rows[(k + 1) % count]);
        let bent = (0..n)
            .filter(|i| {
                let (p, q) = ((rows[k][*i] - a[*i]).normalize_or_zero(), (b[*i] - rows[k][*i]).normalize_or_zero());
                math::angle(p, q) > CREASE
            })
            .count();
        2 * bent > n
    };
    let last = if closed { count } else { count - 1 };
    let mut out = Collector::new();
    let start = sharp_column.iter().position(|s| *s).unwrap_or(0);
    let mut breaks: Vec<usize> = (0..=n).filter(|k| *k == 0 || *k == n || sharp_column[(start + k) % n]).collect();
    breaks.dedup();
    let mut row_breaks: Vec<usize> = (0..=last).filter(|k| *k == 0 || *k == last || sharp_row(*k)).collect();
    row_breaks.dedup();
    let around = math::cumulative((0..n).map(|i| {
        let i = (start + i) % n;
        rows.iter().map(|r| r[i].distance(r[(i + 1) % n])).sum::<f64>() / count as f64
    }));
    let along = math::cumulative(
        (0..last).map(|k| (0..n).map(|i| rows[k][i].distance(rows[(k + 1) % count][i])).sum::<f64>() / n as f64),
    );
    let smooth_seam = !sharp_column.iter().any(|s| *s);
    let whole_group = out.group();
    for r in row_breaks.windows(2) {
        for c in breaks.windows(2) {
            let group = if smooth_seam && row_breaks.len() == 2 { whole_group } else { out.group() };
            out.grid(group, c[1] - c[0], r[1] - r[0], |i, j| {
                let (i, j) = (c[0] + i, r[0] + j);
                (rows[j % count][(start + i) % n], DVec3::ZERO, DVec2::new(around[i], along[j]))
            });
        }
    }
    if !closed {
        for (k, end) in [(0, false), (count - 1, true)] {
            let group = out.group();
            let vertices: Vec<u32> = columns[k]
                .iter()
                .enumerate()
                .map(|(i, p)| out.vertex(group, rows[k][i], DVec3::ZERO, DVec2::new(p.x, if end { -p.y } else { p.y })))
                .collect();
            for t in outline::triangles(&[columns[k].clone()]) {
                let [a, b, c] = t.map(|i| vertices[i as usize]);
                out.triangle(if end { [a, b, c] } else { [a, c, b] });
            }
        }
    }
    Ok(out.finish())
}

fn corner(points: &[DVec2], i: usize) -> f64 {
    let n = points.len();
    let (a, b) = (points[i] - points[(i + n - 1) % n], points[(i + 1) % n] - points[i]);
    libm::atan2(a.perp_dot(b), a.dot(b)).abs()
}

/// Sum of squared distances once both loops are centred.
fn mismatch(a: &[DVec2], b: &[DVec2], shift: usize) -> f64 {
    let n = a.len();
    let centre = |l: &[DVec2]| l.iter().copied().sum::<DVec2>() / l.len() as f64;
    let (ca, cb) = (centre(a), centre(b));
    (0..n).map(|i| (a[i] - ca).distance_squared(b[(i + shift) % n] - cb)).sum()
}

fn best_shift(a: &[DVec2], b: &[DVec2]) -> usize {
    let at = |s: usize| mismatch(a, b, s);
    // no shift unless it gains something
    (0..a.len()).fold(0, |best, s| if at(s) < at(best) * 0.98 { s } else { best })
}

fn turned_to_match(loops: &[Vec<DVec2>]) -> Vec<Vec<DVec2>> {
    let mut out = vec![loops[0].clone()];
    for l in &loops[1..] {
        let shift = best_shift(&out[out.len() - 1], l);
        out.push((0..l.len()).map(|i| l[(i + shift) % l.len()]).collect());
    }
    out
}

/// Point of a closed loop at a share of its length, counted from `start`.
fn at_share(points: &[DVec2], lengths: &[f64], share: f64) -> DVec2 {
    let n = points.len();
    let total = lengths[n];
    let s = (share - share.floor()) * total;
    let k = lengths.partition_point(|l| *l <= s).clamp(1, n) - 1;
    let step = (lengths[k + 1] - lengths[k]).max(1e-12);
    points[k].lerp(points[(k + 1) % n], ((s - lengths[k]) / step).clamp(0.0, 1.0))
}

/// All loops at the union of their points' shares of length.
fn resampled(loops: &[Vec<DVec2>]) -> Vec<Vec<DVec2>> {
    let lengths: Vec<Vec<f64>> =
        loops.iter().map(|l| math::cumulative((0..l.len()).map(|i| l[i].distance(l[(i + 1) % l.len()])))).collect();
    let even = |k: usize, start: f64| -> Vec<DVec2> {
        (0..MATCH).map(|i| at_share(&loops[k], &lengths[k], start + i as f64 / MATCH as f64)).collect()
    };
    let mut starts = vec![0.0];
    for k in 1..loops.len() {
        let before = even(k - 1, starts[k - 1]);
        starts.push(best_shift(&before, &even(k, 0.0)) as f64 / MATCH as f64);
    }
    let mut shares: Vec<f64> = Vec::new();
    for (k, l) in loops.iter().enumerate() {
        shares.extend((0..l.len()).map(|i| {
            let share = lengths[k][i] / lengths[k][l.len()] - starts[k];
            share - share.floor()
        }));
    }
    shares.sort_by(f64::total_cmp);
    let mut kept: Vec<f64> = Vec::new();
    for s in shares {
        let gap = 1.0 / (2.0 * MAX_COLUMNS as f64);
        if kept.last().is_none_or(|k| s - k > gap) && kept.len() < MAX_COLUMNS {
            kept.push(s);
        }
    }
    if kept.len() < 8 {
        kept = (0..MATCH).map(|i| i as f64 / MATCH as f64).collect();
    }
    (0..loops.len()).map(|k| kept.iter().map(|s| at_share(&loops[k], &lengths[k], s + starts[k])).collect()).collect()
}
