//! Collects grids and triangles into a piece.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use super::math;
use crate::piece::{Piece, weld_key};

/// A piece in the making. Vertices may be given without a normal: they get one from the faces of their smoothing
/// group at their place.
#[derive(Debug, Default)]
pub struct Collector {
    piece: Piece,
    groups: Vec<u32>,
    next: u32,
}

impl Collector {
    /// Empty.
    pub fn new() -> Self {
        Self::default()
    }

    /// A new smoothing group.
    pub fn group(&mut self) -> u32 {
        self.next += 1;
        self.next - 1
    }

    /// A vertex; a zero normal is worked out at the end.
    pub fn vertex(&mut self, group: u32, position: DVec3, normal: DVec3, uv: DVec2) -> u32 {
        self.piece.positions.push(position);
        self.piece.normals.push(normal);
        self.piece.uvs.push(uv);
        self.groups.push(group);
        self.piece.positions.len() as u32 - 1
    }

    /// A triangle, counter-clockwise from outside.
    pub fn triangle(&mut self, t: [u32; 3]) {
        self.piece.triangles.push(t);
    }

    /// A grid of `(nu + 1) x (nv + 1)` vertices `f(i, j) -> (position, normal, uv)`; along u crossed with along v points
    /// outwards.
    pub fn grid(&mut self, group: u32, nu: usize, nv: usize, mut f: impl FnMut(usize, usize) -> (DVec3, DVec3, DVec2)) {
        let base = self.piece.positions.len() as u32;
        for i in 0..=nu {
            for j in 0..=nv {
                let (p, n, uv) = f(i, j);
                self.vertex(group, p, n, uv);
            }
        }
        let row = nv as u32 + 1;
        for i in 0..nu as u32 {
            for j in 0..nv as u32 {
                let a = base + i * row + j;
                let [b, c, d] = [a + row, a + row + 1, a + 1];
                let at = |k: u32| self.piece.positions[k as usize];
                // the shorter diagonal gives the rounder surface
                let short = at(a).distance_squared(at(c)) <= at(b).distance_squared(at(d)) * (1.0 + 1e-9);
                let pair = if short { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
                self.piece.triangles.extend(pair);
            }
        }
    }

    /// The piece: collapsed triangles dropped, normals worked out, equal vertices merged, turned outside out when it
    /// is closed.
    pub fn finish(self) -> Piece {
        let Self { mut piece, groups, .. } = self;
        let weld = piece.welded();
        piece.triangles.retain(|t| {
            let [a, b, c] = t.map(|i| weld[i as usize]);
            a != b && b != c && a != c
        });
        normals(&mut piece, &groups, &weld);
        let mut piece = merged(&piece);
        piece.closed = piece.is_watertight();
        if piece.closed && piece.volume() < 0.0 { piece.flipped() } else { piece }
    }
}

/// Normals where there are none: faces of the same group around the same place, by their angles.
fn normals(piece: &mut Piece, groups: &[u32], weld: &[u32]) {
    if piece.normals.iter().all(|n| *n != DVec3::ZERO) {
        return;
    }
    let mut sums: HashMap<(u32, u32), DVec3> = HashMap::new();
    for t in &piece.triangles {
        let p = t.map(|i| piece.positions[i as usize]);
        let Some(normal) = (p[1] - p[0]).cross(p[2] - p[0]).try_normalize() else { continue };
        for k in 0..3 {
            let e = (p[(k + 1) % 3] - p[k]).normalize_or_zero();
            let f = (p[(k + 2) % 3] - p[k]).normalize_or_zero();
            let i = t[k] as usize;
            *sums.entry((weld[i], groups[i])).or_default() += normal * math::angle(e, f);
        }
    }
    for (i, n) in piece.normals.iter_mut().enumerate() {
        if *n == DVec3::ZERO {
            *n = sums.get(&(weld[i], groups[i])).copied().unwrap_or(DVec3::Y).normalize_or(DVec3::Y);
        }
    }
}

/// Equal vertices as one, unused ones dropped.
pub(super) fn merged(piece: &Piece) -> Piece {
    type Key = ([i64; 3], [i32; 3], [i64; 2]);
    let mut first: HashMap<Key, u32> = HashMap::with_capacity(piece.positions.len());
    let mut out = Piece { closed: piece.closed, outwards: piece.outwards, ..Piece::default() };
    let mut new_of = vec![u32::MAX; piece.positions.len()];
    for t in &piece.triangles {
        let t = t.map(|i| {
            let i = i as usize;
            if new_of[i] == u32::MAX {
                let (p, n, uv) = (piece.positions[i], piece.normals[i], piece.uvs[i]);
                let normal = [n.x, n.y, n.z].map(|v| (v * 1e5 + 0.37).floor() as i32);
                let place = [uv.x, uv.y].map(|v| (v * 1e6 + 0.37).floor() as i64);
                new_of[i] = *first.entry((weld_key(p), normal, place)).or_insert_with(|| {
                    out.positions.push(p);
                    out.normals.push(n);
                    out.uvs.push(uv);
                    out.positions.len() as u32 - 1
                });
            }
            new_of[i]
        });
        out.triangles.push(t);
    }
    out
}
