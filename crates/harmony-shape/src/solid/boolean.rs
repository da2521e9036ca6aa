//! Boolean operations on closed pieces, and hollowing.

use std::collections::BTreeMap;

use glam::{DAffine3, DVec2, DVec3};

use super::bsp::{Keep, Tree, within};
use super::collect::merged;
use crate::Piece;
use crate::piece::weld_key;
use crate::tree::{Boolean, Face};

/// Largest product of triangle counts.
const MAX_PAIRS: usize = 60_000_000;
/// Corners this near to an edge lie on it, metres.
const NEAR: f64 = 2e-6;

/// A triangle of an operand and its box.
struct Facet {
    corners: [u32; 3],
    p: [DVec3; 3],
    normal: DVec3,
    lo: DVec3,
    hi: DVec3,
}

/// A part of a triangle that is kept.
struct Fragment {
    polygon: Vec<DVec3>,
    facet: usize,
}

/// Boolean operation on two closed pieces. Each triangle that meets the other surface is clipped by a plane tree of the
/// other's triangles around it, the others are told apart by a ray; corners are then joined so that the result is
/// watertight. Normals and texture coordinates are carried through: a cut shows the second piece's, turned over. May be
/// empty.
///
/// # Errors
/// When a piece is not closed or both are too fine.
pub fn boolean(op: Boolean, a: &Piece, b: &Piece) -> Result<Piece, String> {
    if !(a.closed && b.closed) {
        return Err("boolean operations need closed solids; give it a wall or a thickness first".into());
    }
    if a.triangles.len().saturating_mul(b.triangles.len()) > MAX_PAIRS {
        return Err(format!(
            "solids of {} and {} triangles are too fine for a boolean operation; simpler ones would do",
            a.triangles.len(),
            b.triangles.len()
        ));
    }
    if apart(a, b) {
        return Ok(match op {
            Boolean::Cut => a.clone(),
            Boolean::Common => Piece::default(),
            Boolean::Join => {
                let mut both = a.clone();
                both.append(b);
                both
            }
        });
    }
    let (fa, fb) = (facets(a), facets(b));
    let (keep_a, keep_b) = match op {
        Boolean::Cut => {
            (Keep { outside: true, same: false, opposite: true }, Keep { outside: false, same: false, opposite: false })
        }
        Boolean::Join => {
            (Keep { outside: true, same: true, opposite: false }, Keep { outside: true, same: false, opposite: false })
        }
        Boolean::Common => (
            Keep { outside: false, same: true, opposite: false },
            Keep { outside: false, same: false, opposite: false },
        ),
    };
    let mut parts = [clipped(&fa, &fb, keep_a), clipped(&fb, &fa, keep_b)];
    join_corners(&mut parts);
    let mut out = Piece::default();
    emit(&mut out, a, &fa, &parts[0], false);
    emit(&mut out, b, &fb, &parts[1], op == Boolean::Cut);
    let mut out = merged(&out);
    out.closed = !out.triangles.is_empty();
    Ok(out)
}

fn apart(a: &Piece, b: &Piece) -> bool {
    match (a.bounds(), b.bounds()) {
        (Some((al, ah)), Some((bl, bh))) => al.cmpgt(bh).any() || bl.cmpgt(ah).any(),
        _ => true,
    }
}

fn facets(piece: &Piece) -> Vec<Facet> {
    let weld = piece.welded();
    piece
        .triangles
        .iter()
        .filter_map(|t| {
            let p = t.map(|i| piece.positions[weld[i as usize] as usize]);
            let normal = (p[1] - p[0]).cross(p[2] - p[0]).try_normalize()?;
            let (lo, hi) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
            Some(Facet { corners: *t, p, normal, lo, hi })
        })
        .collect()
}

fn clipped(own: &[Facet], other: &[Facet], keep: Keep) -> Vec<Fragment> {
    let lo = other.iter().fold(DVec3::INFINITY, |a, f| a.min(f.lo));
    let hi = other.iter().fold(DVec3::NEG_INFINITY, |a, f| a.max(f.hi));
    let margin = DVec3::splat(1e-5);
    let mut out = Vec::new();
    for (facet, f) in own.iter().enumerate() {
        let whole = || Fragment { polygon: f.p.to_vec(), facet };
        if f.lo.cmpgt(hi).any() || lo.cmpgt(f.hi).any() {
            if keep.outside {
                out.push(whole());
            }
            continue;
        }
        let (box_lo, box_hi) = (f.lo - margin, f.hi + margin);
        let near: Vec<Vec<DVec3>> = other
            .iter()
            .filter(|g| !(g.lo.cmpgt(box_hi).any() || box_lo.cmpgt(g.hi).any()))
            .map(|g| within(&g.p, box_lo, box_hi))
            .filter(|p| p.len() > 2)
            .collect();
        if let Some(tree) = Tree::of(near) {
            let kept = tree.clip(f.p.to_vec(), f.normal, keep);
            out.extend(kept.into_iter().map(|polygon| Fragment { polygon, facet }));
        } else if inside((f.p[0] + f.p[1] + f.p[2]) / 3.0, other) != keep.outside {
            out.push(whole());
        }
    }
    out
}

/// Whether a point lies inside a closed surface: parity along a ray in no special direction.
fn inside(p: DVec3, surface: &[Facet]) -> bool {
    let d = DVec3::new(0.573_151, 0.618_034, 0.538_127);
    let mut odd = false;
    for f in surface {
        if f.hi.cmplt(p).any() {
            continue;
        }
        let (e1, e2) = (f.p[1] - f.p[0], f.p[2] - f.p[0]);
        let h = d.cross(e2);
        let det = e1.dot(h);
        if det.abs() < 1e-18 {
            continue;
        }
        let s = p - f.p[0];
        let u = s.dot(h) / det;
        let q = s.cross(e1);
        let v = d.dot(q) / det;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && e2.dot(q) / det > 0.0 {
            odd = !odd;
        }
    }
    odd
}

/// Corners at the same place become one point, and corners that lie on another polygon's edge become corners of it.
fn join_corners(parts: &mut [Vec<Fragment>; 2]) {
    let mut first: BTreeMap<[i64; 3], DVec3> = BTreeMap::new();
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in parts.iter_mut().flatten().flat_map(|f| &mut f.polygon) {
        // the cells next door too: two ways to one point may differ by a rounding
        let key = weld_key(*p);
        let mut found = None;
        'search: for x in -1..=1 {
            for y in -1..=1 {
                for z in -1..=1 {
                    if let Some(q) = first.get(&[key[0] + x, key[1] + y, key[2] + z])
                        && q.distance_squared(*p) < 1e-12
                    {
                        found = Some(*q);
                        break 'search;
                    }
                }
            }
        }
        *p = found.unwrap_or(*p);
        first.entry(weld_key(*p)).or_insert(*p);
        (lo, hi) = (lo.min(*p), hi.max(*p));
    }
    let cell = ((hi - lo).max_element() / 48.0).max(1e-4);
    let key = |p: DVec3| [p.x, p.y, p.z].map(|v| (v / cell).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], Vec<DVec3>> = BTreeMap::new();
    for p in first.values() {
        cells.entry(key(*p)).or_default().push(*p);
    }
    for fragment in parts.iter_mut().flatten() {
        let mut polygon: Vec<DVec3> = Vec::with_capacity(fragment.polygon.len());
        let n = fragment.polygon.len();
        for i in 0..n {
            let (a, b) = (fragment.polygon[i], fragment.polygon[(i + 1) % n]);
            if a == b {
                continue;
            }
            polygon.push(a);
            let d = b - a;
            let length = d.length();
            let (k0, k1) = (key(a.min(b) - DVec3::splat(NEAR)), key(a.max(b) + DVec3::splat(NEAR)));
            let mut on: Vec<(f64, DVec3)> = Vec::new();
            for x in k0[0]..=k1[0] {
                for (_, list) in cells.range([x, k0[1], i64::MIN]..=[x, k1[1], i64::MAX]) {
                    for p in list {
                        let t = (*p - a).dot(d) / length;
                        if t > NEAR && t < length - NEAR && (*p - a - d * (t / length)).length_squared() < NEAR * NEAR {
                            on.push((t, *p));
                        }
                    }
                }
            }
            on.sort_by(|p, q| p.0.total_cmp(&q.0));
            polygon.extend(on.into_iter().map(|(_, p)| p));
        }
        fragment.polygon = polygon;
    }
}

/// Triangles of the kept parts, with normals and texture coordinates of their own triangle.
fn emit(out: &mut Piece, source: &Piece, facets: &[Facet], fragments: &[Fragment], turned: bool) {
    for fragment in fragments {
        let f = &facets[fragment.facet];
        let n = fragment.polygon.len();
        if n < 3 {
            continue;
        }
        let (e1, e2) = (f.p[1] - f.p[0], f.p[2] - f.p[0]);
        let (d11, d12, d22) = (e1.dot(e1), e1.dot(e2), e2.dot(e2));
        let det = (d11 * d22 - d12 * d12).max(1e-30);
        let value = |p: DVec3| {
            let s = p - f.p[0];
            let (s1, s2) = (s.dot(e1), s.dot(e2));
            let v = ((d22 * s1 - d12 * s2) / det).clamp(0.0, 1.0);
            let w = ((d11 * s2 - d12 * s1) / det).clamp(0.0, 1.0);
            let weights = [1.0 - v - w, v, w];
            let mut normal = DVec3::ZERO;
            let mut uv = DVec2::ZERO;
            for (i, k) in f.corners.iter().zip(weights) {
                normal += source.normals[*i as usize] * k;
                uv += source.uvs[*i as usize] * k;
            }
            let normal = normal.normalize_or(f.normal);
            (if turned { -normal } else { normal }, uv)
        };
        let mut vertex = |p: DVec3| {
            let (normal, uv) = value(p);
            out.positions.push(p);
            out.normals.push(normal);
            out.uvs.push(uv);
            out.positions.len() as u32 - 1
        };
        let corners: Vec<u32> = fragment.polygon.iter().map(|p| vertex(*p)).collect();
        let triangles: Vec<[u32; 3]> = if n == 3 {
            vec![[corners[0], corners[1], corners[2]]]
        } else {
            // corners may lie in a row: only a fan about the middle has an area everywhere
            let middle = vertex(fragment.polygon.iter().copied().sum::<DVec3>() / n as f64);
            (0..n).map(|i| [middle, corners[i], corners[(i + 1) % n]]).collect()
        };
        out.triangles.extend(triangles.into_iter().map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }));
    }
}

/// A closed piece made hollow: its copy, smaller by `wall` on every side, is taken out; through the open side where
/// there is one.
///
/// # Errors
/// When the piece is not closed or thinner than two walls.
pub fn hollow(piece: &Piece, wall: f64, open: Option<Face>) -> Result<Piece, String> {
    let Some((lo, hi)) = piece.bounds() else { return Err("nothing to make hollow".into()) };
    let size = hi - lo;
    let (mut inner_lo, mut inner_hi) = (lo + DVec3::splat(wall), hi - DVec3::splat(wall));
    let reach = wall.max(1e-3);
    match open {
        Some(Face::Front) => inner_hi.z = hi.z + reach,
        Some(Face::Back) => inner_lo.z = lo.z - reach,
        Some(Face::Right) => inner_hi.x = hi.x + reach,
        Some(Face::Left) => inner_lo.x = lo.x - reach,
        Some(Face::Top) => inner_hi.y = hi.y + reach,
        Some(Face::Bottom) => inner_lo.y = lo.y - reach,
        None => {}
    }
    let inner_size = inner_hi - inner_lo;
    if inner_size.min_element() <= 1e-4 || wall <= 0.0 {
        return Err(format!(
            "walls of {wall} m do not fit into {:.3} x {:.3} x {:.3} m; less than half of the smallest side would do",
            size.x, size.y, size.z
        ));
    }
    let map = DAffine3::from_translation(inner_lo)
        * DAffine3::from_scale(inner_size / size.max(DVec3::splat(1e-9)))
        * DAffine3::from_translation(-lo);
    let inner = piece.clone().transformed(&map);
    if open.is_some() {
        return boolean(Boolean::Cut, piece, &inner);
    }
    let mut out = piece.clone();
    out.append(&inner.flipped());
    Ok(out)
}
