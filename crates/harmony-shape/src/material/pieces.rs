//! How a surface is divided into planks, tiles and bricks, whole repeats to the tile.
//!
//! Each layout gives for a place the piece it lies in: an id that holds over the tile's border, coordinates within the
//! piece (x along it, from its centre) and its half size. What is drawn on a piece is a function of these alone, so that
//! nothing has to be periodic but the layout.

use super::noise::{hash, unit};
use super::space::Space;

/// The piece at a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    /// Hash of the piece.
    pub id: u64,
    /// Along the piece from its centre, metres.
    pub x: f64,
    /// Across the piece from its centre, metres.
    pub y: f64,
    /// Half length and half width, metres.
    pub half: [f64; 2],
    /// Distance to the nearest edge, metres.
    pub edge: f64,
    /// Row and column sum, for two-coloured layouts.
    pub parity: i64,
}

impl Piece {
    fn rect(id: u64, x: f64, y: f64, half: [f64; 2], parity: i64) -> Self {
        Self { id, x, y, half, edge: (half[0] - x.abs()).min(half[1] - y.abs()), parity }
    }
}

/// A division of the surface.
pub(super) type Layout = Box<dyn Fn(f64, f64) -> Piece + Send + Sync>;

/// Least distance of end joints in neighbouring rows, metres.
const MIN_STAGGER: f64 = 0.30;
/// Draws for the shift of a row.
const STAGGER_DRAWS: u64 = 24;

/// Rows of boards along u with random lengths and stagger; `spread` 0 (all alike) to 1.
pub(super) fn planks(space: &Space, width: f64, length: f64, spread: f64) -> Layout {
    let (rows, w) = space.down(width, 1);
    let (count, _) = space.across(length);
    let total = space.w;
    let wrap = |d: f64| {
        let d = d.rem_euclid(total);
        d.min(total - d)
    };
    let mut joints: Vec<Vec<f64>> = Vec::new();
    for r in 0..rows {
        let lengths: Vec<f64> =
            (0..count).map(|k| 1.0 + spread * (unit(hash(space.seed, r, k), 1) * 2.0 - 1.0) * 0.6).collect();
        let sum: f64 = lengths.iter().sum();
        let mut at = 0.0;
        let plain: Vec<f64> = lengths
            .iter()
            .map(|l| {
                at += l / sum * total;
                at
            })
            .collect();
        // The next row above, and the first one for the last.
        let beside: Vec<f64> = joints
            .last()
            .into_iter()
            .chain((r == rows - 1).then(|| joints.first()).flatten())
            .flatten()
            .copied()
            .collect();
        let mut best = (f64::NEG_INFINITY, 0.0);
        for draw in 0..STAGGER_DRAWS {
            let shift = unit(hash(space.seed, r, 99), draw) * total;
            let least = plain
                .iter()
                .flat_map(|j| beside.iter().map(move |b| (j, b)))
                .map(|(j, b)| wrap(j + shift - b))
                .fold(f64::INFINITY, f64::min);
            if least > best.0 {
                best = (least, shift);
            }
            if least >= MIN_STAGGER {
                break;
            }
        }
        let mut row: Vec<f64> = plain.into_iter().map(|j| (j + best.1).rem_euclid(total)).collect();
        row.sort_by(f64::total_cmp);
        joints.push(row);
    }
    let seed = space.seed;
    Box::new(move |u, v| {
        let j = (v / w).floor();
        let row = (j as i64).rem_euclid(rows);
        let line = &joints[row as usize];
        let u = u.rem_euclid(total);
        let k = line.partition_point(|x| *x <= u);
        // Before the first joint lies the piece that began at the last one.
        let start = if k == 0 { line[line.len() - 1] - total } else { line[k - 1] };
        let end = if k == line.len() { line[0] + total } else { line[k] };
        let id = hash(seed, row, (k % line.len()) as i64);
        let half = [(end - start) / 2.0, w / 2.0];
        Piece::rect(id, u - f64::midpoint(start, end), v - (j + 0.5) * w, half, row + k as i64)
    })
}

/// Rows of equal pieces of `length` by `width`; each row is shifted by `shift` of a piece against the last.
pub(super) fn rows(space: &Space, length: f64, width: f64, shift: f64) -> Layout {
    let step = if shift == 0.0 { 1 } else { (1.0 / shift).round() as i64 };
    let (nv, h) = space.down(width, step);
    let (nu, w) = space.across(length);
    let seed = space.seed;
    Box::new(move |u, v| {
        let j = (v / h).floor();
        let u = u - w * (j * shift - (j * shift).floor());
        let i = (u / w).floor();
        let id = hash(seed, (i as i64).rem_euclid(nu), (j as i64).rem_euclid(nv));
        Piece::rect(
            id,
            u - (i + 0.5) * w,
            v - (j + 0.5) * h,
            [w / 2.0, h / 2.0],
            (i as i64).rem_euclid(nu) + (j as i64).rem_euclid(nv),
        )
    })
}

/// Bricks: courses of stretchers and headers. `flemish`: both in every course; else English: whole courses in turn.
pub(super) fn bonded(space: &Space, length: f64, height: f64, flemish: bool) -> Layout {
    let (nv, h) = space.down(height, 2);
    let seed = space.seed;
    if flemish {
        // A stretcher and a header: three half bricks, the next course moved by three quarters of a brick.
        let (nu, unit_w) = space.across(length * 1.5);
        let half_w = unit_w / 3.0;
        return Box::new(move |u, v| {
            let j = (v / h).floor();
            let row = (j as i64).rem_euclid(nv);
            let u = u - if row % 2 == 0 { 0.0 } else { 1.5 * half_w };
            let i = (u / unit_w).floor();
            let x = u - i * unit_w;
            let header = x >= 2.0 * half_w;
            let (centre, half) = if header { (2.5 * half_w, half_w / 2.0) } else { (half_w, half_w) };
            let id = hash(seed, 2 * (i as i64).rem_euclid(nu) + i64::from(header), row);
            Piece::rect(id, x - centre, v - (j + 0.5) * h, [half, h / 2.0], row)
        });
    }
    let (nu, w) = space.across(length);
    Box::new(move |u, v| {
        let j = (v / h).floor();
        let row = (j as i64).rem_euclid(nv);
        let (w, n, off) = if row % 2 == 0 { (w, nu, 0.0) } else { (w / 2.0, 2 * nu, w / 4.0) };
        let u = u - off;
        let i = (u / w).floor();
        let id = hash(seed, (i as i64).rem_euclid(n), row);
        Piece::rect(id, u - (i + 0.5) * w, v - (j + 0.5) * h, [w / 2.0, h / 2.0], row)
    })
}

/// Squares standing on a corner, `width` from edge to edge.
pub(super) fn diagonal(space: &Space, width: f64) -> Layout {
    let root = std::f64::consts::SQRT_2;
    let (nu, a) = space.across(width * root);
    let (nv, b) = space.down(width * root, 1);
    let (sa, sb) = (1.0 / a, 1.0 / b);
    let seed = space.seed;
    Box::new(move |u, v| {
        let (p, q) = (u * sa + v * sb, v * sb - u * sa);
        let (i, j) = (p.floor() as i64, q.floor() as i64);
        // The square's centre in half diagonals is (i - j, i + j + 1).
        let id = hash(seed, (i - j).rem_euclid(2 * nu), (i + j + 1).rem_euclid(2 * nv));
        let side = a / root;
        let (x, y) = ((p - i as f64 - 0.5) * side, (q - j as f64 - 0.5) * side);
        Piece::rect(id, x, y, [side / 2.0; 2], i.rem_euclid(2) + j.rem_euclid(2))
    })
}

/// Hexagons, `width` from flat to flat along u.
pub(super) fn hexagons(space: &Space, width: f64) -> Layout {
    let (nu, w) = space.across(width);
    let (nv, h) = space.down(width * 0.866_025_403_784_438_6, 2);
    let seed = space.seed;
    Box::new(move |u, v| {
        let centre = |i: i64, j: i64| ((i as f64 + if j.rem_euclid(2) == 0 { 0.0 } else { 0.5 }) * w, j as f64 * h);
        let (i0, j0) = ((u / w).floor() as i64, (v / h).floor() as i64);
        let mut best = (f64::INFINITY, 0, 0);
        for j in j0..=j0 + 1 {
            for i in i0 - 1..=i0 + 1 {
                let c = centre(i, j);
                let d = (u - c.0) * (u - c.0) + (v - c.1) * (v - c.1);
                if d < best.0 {
                    best = (d, i, j);
                }
            }
        }
        let (_, i, j) = best;
        let c = centre(i, j);
        let (x, y) = (u - c.0, v - c.1);
        // Distance to the nearest of the three pairs of sides.
        let across = x.abs().max((x * 0.5).abs() + (y * 0.866_025_403_784_438_6).abs());
        let id = hash(seed, i.rem_euclid(nu), j.rem_euclid(nv));
        Piece { id, x, y, half: [w / 2.0; 2], edge: w / 2.0 - across, parity: i + 2 * j }
    })
}

/// Herringbone with its points along v: blocks of `count` squares.
///
/// On the squares' own lattice (i, j), turned by 45 degrees against the tile, `t = (i - j) mod 2 count` says it all: the
/// first `count` values are a block along i, the others one along j. Steps of (1, 1) and (count, -count) repeat it.
pub(super) fn herringbone(space: &Space, width: f64, count: i64) -> Layout {
    let root = std::f64::consts::SQRT_2;
    let (nu, a) = space.across(width * root * count as f64);
    let (nv, b) = space.down(width * root, 1);
    let (sa, sb) = (count as f64 / a, 1.0 / b);
    let seed = space.seed;
    Box::new(move |u, v| {
        // u grows with i - j, v with i + j.
        let (p, q) = (u * sa + v * sb, v * sb - u * sa);
        let (i, j) = (p.floor() as i64, q.floor() as i64);
        let t = (i - j).rem_euclid(2 * count);
        let upright = t >= count;
        // The block's first square.
        let (i0, j0) = if upright { (i, j + (t - count)) } else { (i - t, j) };
        let s = b / root;
        let n = count as f64;
        let (x, y) = if upright {
            // Squares j0, j0 - 1, ... j0 - count + 1.
            (q - (j0 as f64 + 1.0 - n / 2.0), p - (i0 as f64 + 0.5))
        } else {
            (p - (i0 as f64 + n / 2.0), q - (j0 as f64 + 0.5))
        };
        let id = hash(seed ^ u64::from(upright), (i0 - j0).rem_euclid(2 * count * nu), (i0 + j0).rem_euclid(2 * nv));
        Piece::rect(id, x * s, y * s, [n * s / 2.0, s / 2.0], i64::from(upright))
    })
}

/// Chevron (Hungarian point): columns of boards cut at 45 degrees; `length` is a board's middle line.
pub(super) fn chevron(space: &Space, width: f64, length: f64) -> Layout {
    let root = std::f64::consts::SQRT_2;
    // Two columns a repeat.
    let (nu, pair) = space.across(length * root);
    let (nv, rise) = space.down(width * root, 1);
    let column = pair / 2.0;
    let seed = space.seed;
    Box::new(move |u, v| {
        let c = (u / column).floor() as i64;
        let x = u - c as f64 * column;
        let down = c.rem_euclid(2) == 0;
        let lean = if down { x } else { column - x };
        let s = v - lean;
        let k = (s / rise).floor();
        let id = hash(seed, c.rem_euclid(2 * nu), (k as i64).rem_euclid(nv));
        let across = (s - (k + 0.5) * rise) / root;
        let along = (x - column / 2.0) * root + if down { across } else { -across };
        let half = [column * root / 2.0, rise / root / 2.0];
        let edge = (half[1] - across.abs()).min(x.min(column - x));
        Piece { id, x: along, y: across, half, edge, parity: c }
    })
}

/// Basket weave: squares of `count` boards, along u and along v in turn.
pub(super) fn basket(space: &Space, width: f64, count: i64) -> Layout {
    let side = width * count as f64;
    let (nu, a) = space.across(2.0 * side);
    let (nv, b) = space.down(2.0 * side, 1);
    let (a, b) = (a / 2.0, b / 2.0);
    let seed = space.seed;
    Box::new(move |u, v| {
        let (i, j) = ((u / a).floor() as i64, (v / b).floor() as i64);
        let upright = (i + j).rem_euclid(2) == 1;
        let (x, y) = (u - (i as f64 + 0.5) * a, v - (j as f64 + 0.5) * b);
        let (along, across, la, lb) = if upright { (y, x, b, a) } else { (x, y, a, b) };
        let w = lb / count as f64;
        let k = ((across + lb / 2.0) / w).floor().clamp(0.0, count as f64 - 1.0);
        let id = hash(seed ^ k as u64, i.rem_euclid(2 * nu), j.rem_euclid(2 * nv));
        Piece::rect(id, along, across + lb / 2.0 - (k + 0.5) * w, [la / 2.0, w / 2.0], i + j)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn area_by_piece(space: &Space, layout: &Layout) -> BTreeMap<u64, f64> {
        let (nu, nv) = (700, 700);
        let mut areas = BTreeMap::new();
        for j in 0..nv {
            for i in 0..nu {
                let (u, v) = ((i as f64 + 0.37) / nu as f64 * space.w, (j as f64 + 0.41) / nv as f64 * space.h);
                let p = layout(u, v);
                assert!(p.edge >= -1e-9, "inside its piece");
                let q = layout(u + space.w, v - space.h);
                assert_eq!(p.id, q.id, "the same piece one tile on");
                assert!((p.x - q.x).abs() <= 1e-9 && (p.y - q.y).abs() <= 1e-9);
                *areas.entry(p.id).or_insert(0.0) += space.w * space.h / (nu * nv) as f64;
            }
        }
        areas
    }

    #[test]
    fn pieces_fill_the_tile_and_have_the_size_they_are_given() {
        let root = std::f64::consts::SQRT_2;
        let space = |w: f64, h: f64| Space { w, h, px: 0.002, seed: 3, slot: [0.5; 3] };
        // Layout, and area and number of its pieces by arithmetic.
        let s = space(0.07 * 5.0 * root * 2.0, 0.07 * root * 4.0);
        let cases: Vec<(Space, Layout, f64, usize)> = vec![
            (s, herringbone(&s, 0.07, 5), 0.07 * 0.35, 2 * 4 * 2),
            {
                let s = space(0.5 * root * 2.0, 0.09 * root * 5.0);
                (s, chevron(&s, 0.09, 0.5), 0.5 / root * 0.09 * root, 4 * 5)
            },
            {
                let s = space(0.8, 0.8);
                (s, basket(&s, 0.05, 4), 0.05 * 0.2, 16 * 4)
            },
            {
                let s = space(0.9, 0.6);
                (s, rows(&s, 0.3, 0.1, 0.5), 0.03, 18)
            },
            {
                let s = space(0.9, 0.6);
                (s, diagonal(&s, 0.3 / root), 0.045, 12)
            },
            {
                let s = space(0.6, 0.2 * 0.75_f64.sqrt() * 4.0);
                (s, hexagons(&s, 0.2), 0.04 * 0.75_f64.sqrt(), 12)
            },
        ];
        for (k, (space, layout, area, count)) in cases.iter().enumerate() {
            let areas = area_by_piece(space, layout);
            assert_eq!(areas.len(), *count, "case {k}");
            for a in areas.values() {
                assert!((a / area - 1.0).abs() <= 0.06, "case {k}: {a} m2, not {area}");
            }
        }
    }

    #[test]
    fn planks_are_staggered_and_differ_in_length() {
        let s = Space { w: 3.6, h: 1.2, px: 0.003, seed: 8, slot: [0.5; 3] };
        let layout = planks(&s, 0.12, 1.2, 0.6);
        let areas = area_by_piece(&s, &layout);
        assert_eq!(areas.len(), 30, "three a row, ten rows");
        let (least, most) = areas.values().fold((9.0_f64, 0.0_f64), |(a, b), x| (a.min(*x), b.max(*x)));
        assert!(most / least >= 1.3, "{least} {most}");
        // End joints: where the piece changes along a row.
        let joints: Vec<Vec<f64>> = (0..10)
            .map(|r| {
                let id = |k: i32| layout(f64::from(k) * 1e-3, (f64::from(r) + 0.5) * 0.12).id;
                (0..3600).filter(|k| id(*k) != id(k + 1)).map(|k| f64::from(k) * 1e-3).collect()
            })
            .collect();
        for r in 0..10 {
            for a in &joints[r] {
                for b in &joints[(r + 1) % 10] {
                    let d = (a - b).abs();
                    assert!(d.min(3.6 - d) >= 0.1, "row {r}: {a} and {b}");
                }
            }
        }
    }
}
