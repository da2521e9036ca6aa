//! Texture coordinates by box projection.

use glam::{DVec2, DVec3};

use super::collect::merged;
use crate::Piece;

/// A side keeps a triangle up to this much beyond the diagonal: cosine difference. Without it charts would be frayed
/// where a surface lies at 45 degrees.
const KEEP: f64 = 0.12;

/// The six sides: right, up and outward direction.
const SIDES: [[DVec3; 3]; 6] = [
    [DVec3::NEG_Z, DVec3::Y, DVec3::X],
    [DVec3::Z, DVec3::Y, DVec3::NEG_X],
    [DVec3::X, DVec3::NEG_Z, DVec3::Y],
    [DVec3::X, DVec3::Z, DVec3::NEG_Y],
    [DVec3::X, DVec3::Y, DVec3::Z],
    [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z],
];

/// The piece with texture coordinates projected along the axis that each triangle faces most; lengths are true where a
/// surface faces an axis and up to 1.4 times too short where it lies between two.
pub fn box_projected(piece: &Piece) -> Piece {
    let weld = piece.welded();
    let normals: Vec<DVec3> = piece.corners().map(|[a, b, c]| (b - a).cross(c - a).normalize_or(DVec3::Y)).collect();
    let mut side: Vec<usize> = normals.iter().map(|n| best(*n)).collect();
    // one pass of the neighbours' vote mends frayed borders
    let edges = neighbours(piece, &weld);
    let voted: Vec<usize> = (0..side.len())
        .map(|t| {
            let others = edges[t].map(|o| o.map(|o| side[o]));
            let Some(s) = others[0].or(others[1]) else { return side[t] };
            let same = others.iter().filter(|o| **o == Some(s)).count();
            let near = normals[t].dot(SIDES[s][2]) > normals[t].dot(SIDES[side[t]][2]) - KEEP;
            if same >= 2 && near { s } else { side[t] }
        })
        .collect();
    side = voted;
    let mut out = Piece { closed: piece.closed, outwards: piece.outwards, ..Piece::default() };
    for (t, s) in piece.triangles.iter().zip(&side) {
        let [right, up, _] = SIDES[*s];
        let base = out.positions.len() as u32;
        for i in t {
            let p = piece.positions[*i as usize];
            out.positions.push(p);
            out.normals.push(piece.normals[*i as usize]);
            out.uvs.push(DVec2::new(p.dot(right), -p.dot(up)));
        }
        out.triangles.push([base, base + 1, base + 2]);
    }
    merged(&out)
}

fn best(n: DVec3) -> usize {
    (0..6).fold(0, |b, k| if n.dot(SIDES[k][2]) > n.dot(SIDES[b][2]) + 1e-9 { k } else { b })
}

/// Triangles across each edge.
fn neighbours(piece: &Piece, weld: &[u32]) -> Vec<[Option<usize>; 3]> {
    let mut of: std::collections::HashMap<(u32, u32), usize> = std::collections::HashMap::new();
    let edge = |t: &[u32; 3], k: usize| (weld[t[k] as usize], weld[t[(k + 1) % 3] as usize]);
    for (i, t) in piece.triangles.iter().enumerate() {
        for k in 0..3 {
            of.insert(edge(t, k), i);
        }
    }
    piece
        .triangles
        .iter()
        .map(|t| {
            std::array::from_fn(|k| {
                let (a, b) = edge(t, k);
                of.get(&(b, a)).copied()
            })
        })
        .collect()
}
