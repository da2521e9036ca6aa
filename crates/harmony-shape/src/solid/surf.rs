//! Grids of points and plain meshes.

use glam::{DVec2, DVec3};

use super::collect::Collector;
use super::math::cumulative;
use super::project::box_projected;
use crate::Piece;

/// Faces of a plain mesh that meet flatter than this are smooth: cosine.
const SMOOTH_COS: f64 = 0.77;

/// A grid of points, `nu` a row, as a sheet: with a thickness closed, without one seen from both sides.
///
/// # Errors
/// When the points do not fill the rows.
pub fn surf(points: &[[f64; 3]], nu: usize, thick: f64, closed_u: bool) -> Result<Piece, String> {
    if nu < 2 || points.len() < 2 * nu || !points.len().is_multiple_of(nu) {
        return Err(format!(
            "a grid of {} points cannot have rows of {nu}; it needs at least two full rows of at least two",
            points.len()
        ));
    }
    let nv = points.len() / nu;
    let columns = if closed_u { nu + 1 } else { nu };
    let at = |i: usize, j: usize| DVec3::from_array(points[j * nu + i % nu]);
    let normals = grid_normals(nu, nv, closed_u, at);
    let us =
        cumulative((0..columns - 1).map(|i| (0..nv).map(|j| at(i, j).distance(at(i + 1, j))).sum::<f64>() / nv as f64));
    let vs = cumulative((0..nv - 1).map(|j| (0..nu).map(|i| at(i, j).distance(at(i, j + 1))).sum::<f64>() / nu as f64));
    let uv = |i: usize, j: usize| DVec2::new(us[i], vs[j]);
    let mut out = Collector::new();
    if thick <= 0.0 {
        let group = out.group();
        out.grid(group, columns - 1, nv - 1, |i, j| (at(i, j), normals[j * nu + i % nu], uv(i, j)));
        return Ok(out.finish());
    }
    let side = |i: usize, j: usize, s: f64| at(i, j) + normals[j * nu + i % nu] * (thick / 2.0 * s);
    let group = out.group();
    out.grid(group, columns - 1, nv - 1, |i, j| (side(i, j, 1.0), normals[j * nu + i % nu], uv(i, j)));
    out.grid(group, nv - 1, columns - 1, |j, i| {
        (side(i, j, -1.0), -normals[j * nu + i % nu], DVec2::new(-us[i], vs[j]))
    });
    // the edges, each with normals of its own
    let group = out.group();
    for (j, first) in [(0, true), (nv - 1, false)] {
        let low = if first { -1.0 } else { 1.0 };
        out.grid(group, columns - 1, 1, |i, k| {
            let s = if k == 0 { low } else { -low };
            (side(i, j, s), DVec3::ZERO, DVec2::new(us[i], thick * k as f64))
        });
    }
    if !closed_u {
        for (i, first) in [(0, true), (nu - 1, false)] {
            let low = if first { 1.0 } else { -1.0 };
            let group = out.group();
            out.grid(group, nv - 1, 1, |j, k| {
                let s = if k == 0 { low } else { -low };
                (side(i, j, s), DVec3::ZERO, DVec2::new(vs[j], thick * k as f64))
            });
        }
    }
    Ok(out.finish())
}

fn grid_normals(nu: usize, nv: usize, closed: bool, at: impl Fn(usize, usize) -> DVec3) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(nu * nv);
    for j in 0..nv {
        for i in 0..nu {
            let (i0, i1) =
                if closed { ((i + nu - 1) % nu, (i + 1) % nu) } else { (i.saturating_sub(1), (i + 1).min(nu - 1)) };
            let (j0, j1) = (j.saturating_sub(1), (j + 1).min(nv - 1));
            let mut u = at(i1, j) - at(i0, j);
            let v = at(i, j1) - at(i, j0);
            if u.length_squared() < 1e-18 {
                // a pole: the row next to it tells
                let near = if j == 0 { 1 } else { j - 1 };
                u = at(i1, near) - at(i0, near);
            }
            out.push(u.cross(v).normalize_or(DVec3::Y));
        }
    }
    out
}

/// Points and polygons as they are; faces that meet at a flat angle are smooth. Texture coordinates by box projection.
///
/// # Errors
/// When a face has fewer than three corners or names a point that does not exist.
pub fn mesh(points: &[[f64; 3]], faces: &[Vec<u32>]) -> Result<Piece, String> {
    let at = |i: u32| DVec3::from_array(points[i as usize]);
    let mut piece = Piece::default();
    for face in faces {
        if face.len() < 3 {
            return Err(format!("a face has {} corners; it needs at least 3", face.len()));
        }
        if let Some(i) = face.iter().find(|i| **i as usize >= points.len()) {
            return Err(format!("a face names point {i}, but there are {}", points.len()));
        }
        let n = face.len();
        let normal: DVec3 = (1..n - 1).map(|k| (at(face[k]) - at(face[0])).cross(at(face[k + 1]) - at(face[0]))).sum();
        let normal = normal.normalize_or(DVec3::Y);
        let base = piece.positions.len() as u32;
        piece.positions.extend(face.iter().map(|i| at(*i)));
        piece.normals.extend(face.iter().map(|_| normal));
        piece.uvs.extend(face.iter().map(|_| DVec2::ZERO));
        if n <= 4 {
            piece.triangles.extend((1..n as u32 - 1).map(|k| [base, base + k, base + k + 1]));
        } else {
            let (x, y) = super::math::frame(normal);
            let flat: Vec<DVec2> = face.iter().map(|i| DVec2::new(at(*i).dot(x), at(*i).dot(y))).collect();
            piece.triangles.extend(super::outline::triangles(&[flat]).iter().map(|t| t.map(|i| i + base)));
        }
    }
    smoothed(&mut piece);
    let mut piece = box_projected(&piece);
    piece.closed = piece.is_watertight();
    Ok(if piece.closed && piece.volume() < 0.0 { piece.flipped() } else { piece })
}

/// Each corner's normal: the sum of those of its place that differ little from its own.
fn smoothed(piece: &mut Piece) {
    let weld = piece.welded();
    let mut around: Vec<Vec<DVec3>> = vec![Vec::new(); piece.positions.len()];
    for (i, n) in piece.normals.iter().enumerate() {
        around[weld[i] as usize].push(*n);
    }
    let smooth: Vec<DVec3> = piece
        .normals
        .iter()
        .enumerate()
        .map(|(i, n)| {
            let sum: DVec3 = around[weld[i] as usize].iter().filter(|m| m.dot(*n) > SMOOTH_COS).sum();
            sum.normalize_or(*n)
        })
        .collect();
    piece.normals = smooth;
}
