//! Boxes with rounded edges.

use std::f64::consts::FRAC_PI_4;

use glam::{DVec2, DVec3};

use super::collect::Collector;
use crate::Piece;

/// A box, standing on y = 0: edges rounded by `bevel` in about `segments` steps, the top `taper` times as wide and deep
/// as the bottom and moved by `shear`. Each side with its half of the roundings is one chart.
pub fn rounded_box(size: DVec3, bevel: f64, segments: u32, taper: DVec2, shear: DVec2) -> Piece {
    let half = size / 2.0;
    let narrow = half.min_element() * taper.min_element().clamp(0.05, 1.0);
    let bevel = bevel.clamp(0.0, narrow * 0.999);
    let steps = if bevel > 1e-5 { segments.clamp(1, 8).div_ceil(2) as usize } else { 0 };
    let bevel = if steps == 0 { 0.0 } else { bevel };
    // lines across a side: which half of it they belong to, and how far round the edge they lie
    let turn = |k: usize| FRAC_PI_4 * k as f64 / steps.max(1) as f64;
    let lines: Vec<(f64, f64)> =
        (0..=steps).map(|k| (-1.0, turn(k) - turn(steps))).chain((0..=steps).map(|k| (1.0, turn(k)))).collect();
    let lines: Vec<(f64, f64)> = if steps == 0 { vec![(-1.0, 0.0), (1.0, 0.0)] } else { lines };
    let mut out = Collector::new();
    let sides = [
        [DVec3::X, DVec3::Y, DVec3::Z],
        [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z],
        [DVec3::NEG_Z, DVec3::Y, DVec3::X],
        [DVec3::Z, DVec3::Y, DVec3::NEG_X],
        [DVec3::X, DVec3::NEG_Z, DVec3::Y],
        [DVec3::X, DVec3::Z, DVec3::NEG_Y],
    ];
    for [right, up, out_dir] in sides {
        let extent = |axis: DVec3| (half * axis).length();
        let (hr, hu, ho) = (extent(right), extent(up), extent(out_dir));
        let group = out.group();
        out.grid(group, lines.len() - 1, lines.len() - 1, |i, j| {
            let ((si, ai), (sj, aj)) = (lines[i], lines[j]);
            let flat = right * (si * (hr - bevel)) + up * (sj * (hu - bevel)) + out_dir * (ho - bevel);
            let normal = (right * libm::tan(ai) + up * libm::tan(aj) + out_dir).normalize_or(out_dir);
            let p = flat + normal * bevel + DVec3::Y * half.y;
            let uv = DVec2::new(si * (hr - bevel) + bevel * ai, sj * (hu - bevel) + bevel * aj);
            leaning(p, normal, uv, [right, up, out_dir], size, taper, shear)
        });
    }
    out.finish()
}

/// Applies taper and shear to a point, its normal and its place on the side (about the side's middle, v up); returns
/// the place with (0, 0) at the top left.
fn leaning(
    p: DVec3,
    n: DVec3,
    uv: DVec2,
    [right, up, out]: [DVec3; 3],
    size: DVec3,
    taper: DVec2,
    shear: DVec2,
) -> (DVec3, DVec3, DVec2) {
    let t = p.y / size.y.max(1e-9);
    let scale = DVec2::ONE + (taper - DVec2::ONE) * t;
    let lean = (DVec2::new(p.x, p.z) * (taper - DVec2::ONE) + shear) / size.y.max(1e-9);
    let moved = DVec3::new(p.x * scale.x + shear.x * t, p.y, p.z * scale.y + shear.y * t);
    let s = scale.max(DVec2::splat(1e-3));
    let (nx, nz) = (n.x / s.x, n.z / s.y);
    let normal = DVec3::new(nx, n.y - lean.x * nx - lean.y * nz, nz).normalize_or(n);
    let along = |axis: DVec3, v: DVec2| v.x * axis.x + v.y * axis.z;
    let extent = |axis: DVec3| (size * axis).length();
    let stretch = |axis: DVec3| if axis.x.abs() > 0.5 { scale.x } else { scale.y };
    let (u, v) = if out.y.abs() > 0.5 {
        (uv.x * stretch(right), uv.y * stretch(up))
    } else {
        let slope = along(out, lean);
        (uv.x * stretch(right) + along(right, shear) * t, uv.y * (1.0 + slope * slope).sqrt())
    };
    (moved, normal, DVec2::new(extent(right) / 2.0 + u, extent(up) / 2.0 - v))
}
