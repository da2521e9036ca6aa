//! Charts of a piece: what is unwrapped as one.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use crate::Piece;
use crate::piece::weld_key;

/// A chart is cut in pieces when it is longer than this many times its width.
const MAX_ASPECT: f64 = 4.0;
/// Most pieces of one chart.
const MAX_PIECES: usize = 6;

/// Triangles that hang together in texture coordinates.
#[derive(Debug, Clone)]
pub(super) struct Chart {
    pub triangles: Vec<u32>,
    /// Lowest corner in texture coordinates.
    pub lo: DVec2,
    /// Highest corner.
    pub hi: DVec2,
    /// Whether v runs upwards as seen from outside (images would be mirrored).
    pub mirrored: bool,
    /// Whether v rather than u runs along the longest side of the piece.
    pub upright: bool,
}

impl Chart {
    /// Texture coordinates as they are drawn: v downwards as seen from outside, u along the grain where that is asked for.
    pub fn metric(&self, uv: DVec2, along_grain: bool) -> DVec2 {
        let v = if self.mirrored { self.lo.y + self.hi.y - uv.y } else { uv.y };
        if along_grain && self.upright { DVec2::new(v, -uv.x) } else { DVec2::new(uv.x, v) }
    }
}

/// Chart over piece of the photo up to which the piece is laid once; and from whose inverse on it fills the chart.
const ONCE: f64 = 1.35;

impl Chart {
    /// How texture coordinates in metres are moved and scaled so that a piece of the photo of about the chart's size lies on
    /// it once, in its middle; a smaller piece is repeated from where coordinates begin. `size`: the piece's, metres;
    /// `stretch`: metres of a texture coordinate.
    pub fn once(&self, size: DVec2, stretch: f64) -> (DVec2, DVec2) {
        let (extent, middle) = ((self.hi - self.lo) * stretch, (self.hi + self.lo) / 2.0 * stretch);
        let share = extent / size;
        if !(share.is_finite() && share.max_element() <= ONCE) {
            return (DVec2::ONE, DVec2::ZERO);
        }
        let scale = if share.min_element() >= 1.0 / ONCE { 1.0 / share } else { DVec2::ONE };
        (scale, size / 2.0 - middle * scale)
    }
}

/// The charts of a piece in the order of their first triangles.
pub(super) fn charts(piece: &Piece) -> Vec<Chart> {
    let mut first: HashMap<([i64; 3], [i64; 2]), u32> = HashMap::with_capacity(piece.positions.len());
    let place: Vec<u32> = (0..piece.positions.len())
        .map(|i| {
            let uv = [piece.uvs[i].x, piece.uvs[i].y].map(|v| (v * 1e5 + 0.37).floor() as i64);
            *first.entry((weld_key(piece.positions[i]), uv)).or_insert(i as u32)
        })
        .collect();
    // across an edge, and not folded over it
    let mut parent: Vec<u32> = (0..piece.triangles.len() as u32).collect();
    let mut across: HashMap<(u32, u32, bool), u32> = HashMap::with_capacity(piece.triangles.len() * 2);
    for (i, t) in piece.triangles.iter().enumerate() {
        let [a, b, c] = t.map(|v| piece.uvs[v as usize]);
        let mirrored = (b - a).perp_dot(c - a) > 0.0;
        for k in 0..3 {
            let (p, q) = (place[t[k] as usize], place[t[(k + 1) % 3] as usize]);
            let other = *across.entry((p.min(q), p.max(q), mirrored)).or_insert(i as u32);
            let (a, b) = (root(&mut parent, i as u32), root(&mut parent, other));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut index: HashMap<u32, usize> = HashMap::new();
    let mut lists: Vec<Vec<u32>> = Vec::new();
    for i in 0..piece.triangles.len() as u32 {
        let r = root(&mut parent, i);
        let at = *index.entry(r).or_insert_with(|| {
            lists.push(Vec::new());
            lists.len() - 1
        });
        lists[at].push(i);
    }
    let long = longest_axis(piece);
    lists.into_iter().flat_map(|list| cut(piece, list)).map(|list| chart(piece, list, long)).collect()
}

fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        parent[i as usize] = parent[parent[i as usize] as usize];
        i = parent[i as usize];
    }
    i
}

/// The axis along which a piece is clearly longest; x when there is none.
fn longest_axis(piece: &Piece) -> DVec3 {
    let Some((lo, hi)) = piece.bounds() else { return DVec3::X };
    let size = hi - lo;
    if size.y > 1.1 * size.x && size.y >= size.z {
        DVec3::Y
    } else if size.z > 1.1 * size.x {
        DVec3::Z
    } else {
        DVec3::X
    }
}

fn span(piece: &Piece, list: &[u32]) -> (DVec2, DVec2) {
    list.iter()
        .flat_map(|t| piece.triangles[*t as usize])
        .map(|i| piece.uvs[i as usize])
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)))
}

/// Long charts in pieces, so that they pack well.
fn cut(piece: &Piece, list: Vec<u32>) -> Vec<Vec<u32>> {
    let (lo, hi) = span(piece, &list);
    let size = hi - lo;
    let upright = size.y > size.x;
    let aspect = size.max_element() / size.min_element().max(1e-6);
    let pieces = ((aspect / MAX_ASPECT).ceil() as usize).clamp(1, MAX_PIECES);
    if pieces == 1 || list.len() < 2 * pieces {
        return vec![list];
    }
    let middle = |t: u32| {
        let sum: DVec2 = piece.triangles[t as usize].iter().map(|i| piece.uvs[*i as usize]).sum::<DVec2>() / 3.0 - lo;
        if upright { sum.y / size.y } else { sum.x / size.x }
    };
    let longest = list
        .iter()
        .map(|t| {
            let p = piece.triangles[*t as usize].map(|i| piece.uvs[i as usize]);
            let extent = p[0].max(p[1]).max(p[2]) - p[0].min(p[1]).min(p[2]);
            if upright { extent.y / size.y } else { extent.x / size.x }
        })
        .fold(0.0, f64::max);
    if longest > 0.7 {
        return vec![list]; // nothing gained: one triangle is most of the length
    }
    let mut out = vec![Vec::new(); pieces];
    for t in list {
        let k = ((middle(t) * pieces as f64) as usize).min(pieces - 1);
        out[k].push(t);
    }
    out.retain(|l| !l.is_empty());
    out
}

fn chart(piece: &Piece, triangles: Vec<u32>, long: DVec3) -> Chart {
    let (lo, hi) = span(piece, &triangles);
    let mut signed = 0.0;
    let (mut along_u, mut along_v) = (0.0, 0.0);
    for t in &triangles {
        let t = piece.triangles[*t as usize];
        let [a, b, c] = t.map(|i| piece.uvs[i as usize]);
        let [p, q, r] = t.map(|i| piece.positions[i as usize].dot(long));
        let (e, f) = (b - a, c - a);
        signed += e.perp_dot(f);
        // gradient of the place along the longest side, times the area
        along_u += ((q - p) * f.y - (r - p) * e.y).abs();
        along_v += ((r - p) * e.x - (q - p) * f.x).abs();
    }
    Chart { triangles, lo, hi, mirrored: signed > 0.0, upright: along_v > 1.2 * along_u }
}
