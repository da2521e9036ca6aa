//! Faces drawn in by buttons and seams.

use glam::{DVec2, DVec3};

use super::grid::ball;
use super::noise::{noise2, smoothstep};
use super::refine::{deform, refine};
use crate::Piece;
use crate::tree::Face;

/// Most triangles of a tufted or quilted piece beyond what it had.
const MAX_TRIANGLES: usize = 48_000;

/// Arguments of [`tuft`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TuftSpec {
    /// Rows of buttons.
    pub rows: u32,
    /// Buttons a row.
    pub cols: u32,
    /// Depth of the buttons below the face.
    pub depth: f64,
    /// Every other row shifted by half.
    pub diamond: bool,
    /// Radius of a button, 0: none.
    pub button: f64,
}

/// A tufted piece.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tufted {
    /// The piece with its drawn-in face.
    pub piece: Piece,
    /// The buttons (the same material as the piece unless told otherwise).
    pub buttons: Piece,
}

/// A side of a piece: coordinates across, up and out of it.
struct Side {
    out: DVec3,
    across: DVec3,
    up: DVec3,
    /// Least and greatest coordinate across and up.
    lo: DVec2,
    hi: DVec2,
    /// Coordinate of the side, and how deep the piece is behind it.
    level: f64,
    deep: f64,
}

impl Side {
    fn of(piece: &Piece, face: Face) -> Option<Self> {
        let (lo, hi) = piece.bounds()?;
        let (out, across, up) = match face {
            Face::Front => (DVec3::Z, DVec3::X, DVec3::Y),
            Face::Back => (DVec3::NEG_Z, DVec3::NEG_X, DVec3::Y),
            Face::Right => (DVec3::X, DVec3::NEG_Z, DVec3::Y),
            Face::Left => (DVec3::NEG_X, DVec3::Z, DVec3::Y),
            Face::Top => (DVec3::Y, DVec3::X, DVec3::NEG_Z),
            Face::Bottom => (DVec3::NEG_Y, DVec3::X, DVec3::Z),
        };
        let span = |axis: DVec3| {
            let (a, b) = (lo.dot(axis), hi.dot(axis));
            (a.min(b), a.max(b))
        };
        let ((x0, x1), (y0, y1), (z0, z1)) = (span(across), span(up), span(out));
        Some(Self { out, across, up, lo: DVec2::new(x0, y0), hi: DVec2::new(x1, y1), level: z1, deep: z1 - z0 })
    }

    fn flat(&self, p: DVec3) -> DVec2 {
        DVec2::new(p.dot(self.across), p.dot(self.up))
    }

    /// Share of the drawing-in at a depth: all of it at the side, none behind the middle of the piece.
    fn share(&self, p: DVec3) -> f64 {
        smoothstep(0.35, 0.7, 1.0 - (self.level - p.dot(self.out)) / self.deep)
    }

    /// Refines the side and pushes it in by `depth(flat)`, fading towards its border.
    fn push_in(&self, child: &Piece, limit: f64, depth: impl Fn(DVec2) -> f64) -> Piece {
        let size = self.hi - self.lo;
        let limit = limit.max((size.x * size.y * 3.0 / MAX_TRIANGLES as f64).sqrt());
        let most = child.triangles.len() + MAX_TRIANGLES * 2;
        let mut piece = refine(child, limit, most, |p| self.share(p) > 0.5);
        deform(&mut piece, |p| {
            let share = self.share(p);
            if share == 0.0 {
                return p;
            }
            let f = self.flat(p);
            let border = (f - self.lo).min(self.hi - f).min_element();
            let fade = smoothstep(0.0, 0.12 * size.min_element().min(0.4), border);
            p - self.out * (depth(f) * share * fade)
        });
        piece
    }
}

/// Draws buttons into a side of an upholstered piece.
///
/// Between the buttons the face stays full; with `diamond` pleats run from button to button (deep buttoning).
pub fn tuft(child: &Piece, face: Face, spec: &TuftSpec) -> Tufted {
    let Some(side) = Side::of(child, face) else {
        return Tufted { piece: child.clone(), buttons: Piece::default() };
    };
    let (rows, cols) = (spec.rows.clamp(1, 40), spec.cols.clamp(1, 60));
    let size = side.hi - side.lo;
    let pitch = size / DVec2::new(f64::from(cols), f64::from(rows));
    let depth = spec.depth.clamp(0.0, side.deep * 0.6);
    // Lattice coordinates: buttons at whole numbers, odd rows at halves when shifted.
    let shift = |row: f64| if spec.diamond && row.rem_euclid(2.0) >= 1.0 { 0.5 } else { 0.0 };
    let lattice = |f: DVec2| (f - side.lo) / pitch - DVec2::splat(0.5);
    let shape = |f: DVec2| {
        let q = lattice(f);
        // Distance to the nearest button, metres.
        let mut near = f64::MAX;
        for row in [q.y.floor(), q.y.floor() + 1.0] {
            let row = row.clamp(0.0, f64::from(rows) - 1.0);
            let s = shift(row);
            let last = if s > 0.0 { f64::from(cols) - 2.0 } else { f64::from(cols) - 1.0 };
            let col = (q.x - s).round().clamp(0.0, last.max(0.0));
            near = near.min(((q - DVec2::new(col + s, row)) * pitch).length());
        }
        let reach = 0.5 * pitch.min_element() * if spec.diamond { 1.15 } else { 1.0 };
        let funnel = (1.0 - near / reach).clamp(0.0, 1.0);
        // A steep pit with soft shoulders.
        let pit = 0.62 * funnel * funnel + 0.38 * libm::exp(-(near / (0.16 * reach)).powi(2));
        let pleat = if spec.diamond {
            // Pleats join a button with the two nearest of the next row: lines q.x +- q.y / 2 = whole.
            let off = |v: f64| (v - v.round()).abs();
            let parity = |sign: f64| off(q.x + sign * q.y * 0.5);
            let metres = pitch.x / (1.0 + (0.5 * pitch.x / pitch.y).powi(2)).sqrt();
            let e = parity(1.0).min(parity(-1.0)) * metres;
            // Outside the outermost rows the pleats run straight to the border and fade.
            let beyond = (-q.y).max(q.y - (f64::from(rows) - 1.0)).max(0.0);
            0.45 * (1.0 - (e / (0.50 * reach)).min(1.0).sqrt()) * (1.0 - smoothstep(0.1, 0.5, beyond))
        } else {
            // Cloth strains between neighbours in a row and a column, only a little.
            let e = ((q.x - q.x.round()) * pitch.x).abs().min(((q.y - q.y.round()) * pitch.y).abs());
            0.10 * libm::exp(-(e / (0.25 * reach)).powi(2))
        };
        depth * (pit + pleat * (1.0 - pit))
    };
    let piece = side.push_in(child, 0.008_f64.max(0.05 * pitch.min_element()), shape);
    let mut buttons = Piece { closed: true, ..Piece::default() };
    if spec.button > 0.0 {
        for row in 0..rows {
            let s = shift(f64::from(row));
            let in_row = if s > 0.0 { cols - 1 } else { cols };
            for col in 0..in_row {
                let f = side.lo + (DVec2::new(f64::from(col) + s, f64::from(row)) + DVec2::splat(0.5)) * pitch;
                let level = surface(&piece, &side, f).unwrap_or(side.level - depth);
                let at = side.across * f.x + side.up * f.y + side.out * (level + 0.15 * spec.button);
                let r = DVec3::new(spec.button, spec.button * 0.55, spec.button);
                ball(&mut buttons, at, side.across, side.out, r, 6, 12);
            }
        }
    }
    Tufted { piece, buttons }
}

/// Coordinate out of the side of the piece's surface at a place, from the nearest vertices.
fn surface(piece: &Piece, side: &Side, f: DVec2) -> Option<f64> {
    let near = piece.positions.iter().filter(|p| side.share(**p) > 0.3);
    near.map(|p| (side.flat(*p).distance_squared(f), p.dot(side.out)))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, level)| level)
}

/// Stitches cells into a side of an upholstered piece. `pattern`: `box`, `diamond` or `channel` (seams upright or away).
pub fn quilt(child: &Piece, face: Face, cell: f64, depth: f64, pattern: &str) -> Piece {
    let Some(side) = Side::of(child, face) else { return child.clone() };
    let size = side.hi - side.lo;
    let cell = cell.clamp(0.02, size.max_element().max(0.02));
    let depth = depth.clamp(0.0, side.deep * 0.5);
    let counts = (size / cell).round().max(DVec2::ONE);
    let pitch = size / counts;
    let fold = |v: f64| (v - v.round()).abs();
    side.push_in(child, 0.009_f64.max(0.07 * cell), |f| {
        let q = (f - side.lo) / pitch;
        // Distance to the nearest seam in cells, 0 to 1/2.
        let e = match pattern {
            "channel" => fold(q.x),
            "diamond" => fold((q.x + q.y) * 0.5 + 0.5).min(fold((q.x - q.y) * 0.5 + 0.5)) * std::f64::consts::SQRT_2,
            _ => fold(q.x).min(fold(q.y)),
        };
        // Filled cells are round: steep at the seam, flat in the middle; stitches pucker the cloth beside it.
        let t = (e * 2.0).min(1.0);
        let full = (1.0 - (1.0 - t) * (1.0 - t)).max(0.0).sqrt();
        let pucker =
            0.18 * noise2(f.x / 0.018, f.y / 0.018, 8) * (1.0 - smoothstep(0.05, 0.5, t)) * smoothstep(0.0, 0.1, t);
        depth * (1.0 - full + pucker)
    })
}

#[cfg(test)]
mod tests {
    use super::super::cushion;
    use super::super::grid::testing::{open_edges, sound};
    use super::*;

    fn board() -> Piece {
        cushion([1.2, 0.6, 0.12], 0.0, 0.0, 0.0, 0.03)
    }

    fn front(p: &Piece, x: f64, y: f64) -> f64 {
        let near = p.positions.iter().filter(|p| p.z > 0.0 && (p.x - x).abs() < 0.015 && (p.y - y).abs() < 0.015);
        near.map(|p| p.z).fold(f64::MAX, f64::min)
    }

    #[test]
    fn buttons_are_drawn_in_and_the_cells_between_stay_full() {
        let board = board();
        let spec = TuftSpec { rows: 3, cols: 6, depth: 0.03, diamond: true, button: 0.012 };
        let t = tuft(&board, Face::Front, &spec);
        sound(&t.piece);
        sound(&t.buttons);
        assert_eq!(open_edges(&t.piece), 0);
        // 6 + 5 + 6 buttons of one size.
        assert_eq!(t.buttons.triangles.len() % 17, 0);
        // A button of the middle row: half a pitch (0.2 m) from the sides, shifted by half.
        let (pit, full) = (front(&t.piece, 0.0, 0.3), front(&t.piece, 0.1, 0.3));
        let was = front(&board, 0.0, 0.3);
        assert!(was - pit > 0.024, "{was} to {pit}");
        assert!(full - pit > 0.015, "{full} over {pit}");
        let (_, hi) = t.piece.bounds().unwrap();
        assert!(hi.z <= board.bounds().unwrap().1.z + 1e-9);
        assert!(t.piece.triangles.len() < board.triangles.len() + 2 * MAX_TRIANGLES);
    }

    #[test]
    fn the_back_stays_as_it_was_and_seams_are_deep() {
        let board = board();
        let q = quilt(&board, Face::Front, 0.2, 0.02, "box");
        sound(&q);
        let (lo, _) = q.bounds().unwrap();
        assert!((lo.z - board.bounds().unwrap().0.z).abs() < 1e-9);
        // Six columns of 0.2: seams at x = 0, cells' middles at x = 0.1.
        assert!(front(&q, 0.1, 0.3) - front(&q, 0.0, 0.3) > 0.012);
        for pattern in ["diamond", "channel"] {
            sound(&quilt(&board, Face::Front, 0.15, 0.02, pattern));
        }
        sound(&tuft(&board, Face::Top, &TuftSpec { rows: 1, cols: 4, depth: 0.02, diamond: false, button: 0.0 }).piece);
    }
}
