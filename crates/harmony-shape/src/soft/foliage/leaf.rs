//! One leaf.

use std::f64::consts::PI;

use glam::{DAffine3, DMat3, DVec2, DVec3};

use super::super::grid::{grid_triangles, smooth_normals};
use super::super::noise::smoothstep;
use crate::Piece;

/// Outlines of leaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outline {
    Oval,
    Lance,
    Heart,
    Round,
    Lobed,
    Blade,
}

impl Outline {
    /// Half the width at a fraction of the length, greatest value about 1.
    fn half(self, t: f64) -> f64 {
        let sin = |v: f64| libm::sin(PI * v.clamp(0.0, 1.0));
        match self {
            Self::Oval => libm::pow(sin(libm::pow(t, 0.9)), 0.75),
            Self::Lance => libm::pow(sin(libm::pow(t, 0.65)), 1.1),
            Self::Heart => libm::pow(sin(libm::pow(t, 0.52)), 0.8),
            Self::Round => (1.0 - (2.0 * t - 1.0).powi(2)).max(0.0).sqrt(),
            // Deep cuts between ribs, as in a split-leaf philodendron.
            Self::Lobed => {
                let whole = libm::pow(sin(libm::pow(t, 0.6)), 0.7);
                let rib = 0.5 + 0.5 * libm::cos(2.0 * PI * 5.0 * t);
                whole * (0.50 + 0.50 * smoothstep(0.15, 0.6, rib))
            }
            Self::Blade => smoothstep(0.0, 0.06, t) * libm::pow(1.0 - t, 0.45) * (0.75 + 0.25 * sin(libm::pow(t, 0.7))),
        }
    }
}

/// A leaf to be meshed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Form {
    pub length: f64,
    pub width: f64,
    pub outline: Outline,
    /// Fold of the halves along the midrib, radians.
    pub fold: f64,
    /// Bend of the tip down over the whole length, radians.
    pub curl: f64,
    /// Turn of the tip about the midrib, radians.
    pub twist: f64,
    /// Waves of the rim relative to the width.
    pub ripple: f64,
    /// Rows along and columns across.
    pub rows: u32,
    /// Columns across, at least two, even.
    pub cols: u32,
}

impl Form {
    /// An open sheet from the origin along +z, upper side +y.
    pub fn mesh(&self) -> Piece {
        let (rows, cols) = (self.rows.max(2), (self.cols.max(2) / 2) * 2);
        let mut piece = Piece::default();
        let mut at = DVec3::ZERO;
        // The base of a heart lies behind the stalk.
        if self.outline == Outline::Heart {
            at.z = -0.10 * self.length;
        }
        let peak = (0..=64).map(|k| self.outline.half(f64::from(k) / 64.0)).fold(0.1, f64::max);
        let step = self.length / f64::from(rows);
        for j in 0..=rows {
            let t = f64::from(j) / f64::from(rows);
            let down = self.curl * t;
            let (s, c) = libm::sincos(down);
            let (forward, up) = (DVec3::new(0.0, -s, c), DVec3::new(0.0, c, s));
            if j > 0 {
                let (s, c) = libm::sincos(self.curl * (t - 0.5 / f64::from(rows)));
                at += DVec3::new(0.0, -s, c) * step;
            }
            let (ts, tc) = libm::sincos(self.twist * t);
            let (right, up) = (DVec3::X * tc + up * ts, up * tc - DVec3::X * ts);
            let half = (self.width / 2.0 * self.outline.half(t) / peak).max(0.012 * self.width);
            for i in 0..=cols {
                let v = 2.0 * f64::from(i) / f64::from(cols) - 1.0;
                // The fold is less sharp at the tip; a leaf is cupped beside its midrib.
                let fold = self.fold * (1.0 - 0.4 * t);
                let (fs, fc) = libm::sincos(fold);
                let wave = self.ripple * self.width * v.abs() * v.abs() * libm::sin(t * 19.0 + v * 1.3);
                let back = if self.outline == Outline::Heart { 0.25 * (1.0 - t) * v.abs() * half } else { 0.0 };
                let cup = -0.10 * half * (2.0 * v.abs() - 1.0).powi(2) * fs.abs();
                let p = at + right * (half * v * fc) + up * (half * v.abs() * fs + wave + cup) - forward * back;
                piece.positions.push(p);
                piece.uvs.push(DVec2::new(half * v + self.width / 2.0, t * self.length));
            }
        }
        grid_triangles(cols + 1, rows + 1, 0, &mut piece.triangles);
        for t in &mut piece.triangles {
            t.swap(1, 2);
        }
        smooth_normals(&mut piece);
        piece
    }
}

/// One leaf from the origin along +z, its upper side +y: an open sheet, to be drawn from both sides.
///
/// `size`: length and width. `shape`: `oval`, `lance`, `heart`, `round`, `lobed`, `blade`; anything else is `oval`.
/// `fold_deg` folds the halves up along the midrib, `curl_deg` bends the tip down over the whole length.
pub fn leaf(size: [f64; 2], shape: &str, fold_deg: f64, curl_deg: f64) -> Piece {
    let outline = match shape {
        "lance" => Outline::Lance,
        "heart" => Outline::Heart,
        "round" => Outline::Round,
        "lobed" => Outline::Lobed,
        "blade" => Outline::Blade,
        _ => Outline::Oval,
    };
    let form = Form {
        length: size[0].clamp(0.002, 4.0),
        width: size[1].clamp(0.001, 4.0),
        outline,
        fold: fold_deg.clamp(-85.0, 85.0).to_radians(),
        curl: curl_deg.clamp(-300.0, 300.0).to_radians(),
        twist: 0.0,
        ripple: 0.02,
        rows: if outline == Outline::Lobed { 40 } else { 14 },
        cols: 6,
    };
    form.mesh()
}

/// Adds a copy of a leaf at a place, along `forward`, its upper side as near `up` as can be.
pub(super) fn place(into: &mut Piece, leaf: &Piece, at: DVec3, forward: DVec3, up: DVec3, scale: f64) {
    let z = forward.normalize_or(DVec3::Z);
    let x = up.cross(z).try_normalize().unwrap_or_else(|| super::super::grid::square_to(z));
    let y = z.cross(x);
    let map = DAffine3::from_mat3_translation(DMat3::from_cols(x * scale, y * scale, z * scale), at);
    into.append(&leaf.clone().transformed(&map));
}
