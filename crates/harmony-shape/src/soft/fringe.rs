//! Threads, tassels and pompoms along an edge.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::collider::Collider;
use super::grid::{along, ball, lengths, push, square_to, tube, turn};
use super::noise::{Dice, noise3};
use crate::Piece;
use crate::tree::FringeKind;

/// Most triangles of a fringe.
const MAX_TRIANGLES: f64 = 60_000.0;

/// Arguments of [`fringe`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FringeSpec {
    /// Which.
    pub kind: FringeKind,
    /// Length.
    pub length: f64,
    /// Distance between them.
    pub spacing: f64,
    /// 0 to 1.
    pub jitter: f64,
    /// Seed.
    pub seed: u32,
}

/// A fringe that hangs down (-y) from a polyline; `closed` joins its end to its start.
///
/// The floor at `y = 0` bears what reaches it. For the hem of a cloth that lies on something use [`fringe_on`].
pub fn fringe(edge: &[DVec3], closed: bool, spec: &FringeSpec) -> Piece {
    fringe_on(edge, closed, spec, &[], None)
}

/// A fringe that hangs down from a polyline where it is free, and lies on what is below where it is not.
///
/// `below` is everything that bears it. `middle` is a point on the cloth's side of the edge (the middle of the cloth):
/// what lies points away from it.
pub fn fringe_on(edge: &[DVec3], closed: bool, spec: &FringeSpec, below: &[&Piece], middle: Option<DVec3>) -> Piece {
    let mut piece = Piece { closed: true, ..Piece::default() };
    if edge.len() < 2 {
        return piece;
    }
    let length = spec.length.clamp(0.002, 2.0);
    let mut edge = edge.to_vec();
    if closed {
        edge.push(edge[0]);
    }
    let lengths = lengths(&edge);
    let whole = lengths[lengths.len() - 1];
    if whole < 1e-4 {
        return piece;
    }
    let (lo, hi) = edge.iter().fold((edge[0], edge[0]), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
    let margin = length + 0.05;
    let collider = Collider::new(below, [lo.x - margin, lo.z - margin], [hi.x + margin, hi.z + margin]);
    let each = match spec.kind {
        FringeKind::Thread => 30.0,
        FringeKind::Tassel => 260.0,
        FringeKind::Pompom => 420.0,
        FringeKind::Lace => 120.0,
    };
    let spacing = spec.spacing.max(0.002).max(whole * each / MAX_TRIANGLES);
    let n = if closed { (whole / spacing).round().max(1.0) } else { (whole / spacing).floor() + 1.0 } as usize;
    let pitch = if closed { whole / n as f64 } else { spacing };
    let first = if closed { 0.0 } else { (whole - pitch * (n - 1) as f64) / 2.0 };
    let mut dice = Dice::new(spec.seed, 71);
    let jitter = spec.jitter.clamp(0.0, 1.0);
    for k in 0..n {
        let s = (first + pitch * (k as f64 + 0.3 * jitter * dice.bell())).clamp(0.0, whole);
        let (at, tangent) = along(&edge, &lengths, s);
        let mut out = DVec3::new(tangent.z, 0.0, -tangent.x).normalize_or(DVec3::Z);
        if middle.is_some_and(|m| (at - m).dot(out) < 0.0) {
            out = -out;
        }
        let fall = Fall { collider: &collider, tangent, out, free: below.is_empty() };
        let long = length * (1.0 + 0.12 * jitter * dice.bell());
        match spec.kind {
            FringeKind::Thread => threads(&mut piece, &fall, at, long, pitch, jitter, &mut dice),
            FringeKind::Tassel => tassel(&mut piece, &fall, at, long, pitch, jitter, &mut dice),
            FringeKind::Pompom => {
                pompom(&mut piece, &fall, at, long, pitch, spec.seed.wrapping_add(k as u32), &mut dice);
            }
            FringeKind::Lace => scallop(&mut piece, &fall, at, long, pitch),
        }
    }
    piece
}

/// How something falls from a place of the edge.
struct Fall<'a> {
    collider: &'a Collider,
    tangent: DVec3,
    out: DVec3,
    /// Nothing but the floor is below.
    free: bool,
}

impl Fall<'_> {
    /// The path of a thread of radius `r` that begins at `from` and leans by a vector: `steps` steps to `length`.
    fn path(&self, from: DVec3, lean: DVec3, length: f64, r: f64, steps: usize) -> Vec<DVec3> {
        let step = length / steps as f64;
        let mut at = from;
        let mut path = vec![from];
        for _ in 0..steps {
            let down = (DVec3::NEG_Y + lean).normalize_or(DVec3::NEG_Y);
            let mut next = at + down * step;
            if self.blocked(next, r) {
                // It lies: away from the cloth, along the surface, sliding off where it can.
                next = at + (self.out + lean + DVec3::NEG_Y * 0.35).normalize_or(self.out) * step;
                for _ in 0..3 {
                    next = self.lifted(next, r);
                }
                next = at + (next - at).normalize_or(self.out) * step;
                next = self.lifted(next, r);
            }
            path.push(next);
            at = next;
        }
        path
    }

    fn blocked(&self, p: DVec3, r: f64) -> bool {
        p.y < r || (!self.free && f64::from(self.collider.sample(p.as_vec3()).0) < r)
    }

    fn lifted(&self, p: DVec3, r: f64) -> DVec3 {
        let mut p = p;
        if !self.free {
            let (d, g) = self.collider.sample(p.as_vec3());
            if f64::from(d) < r {
                p += g.as_dvec3().normalize_or(DVec3::Y) * (r - f64::from(d)).min(0.03);
            }
        }
        p.y = p.y.max(r);
        p
    }
}

/// A pair of thin strands.
fn threads(piece: &mut Piece, fall: &Fall, at: DVec3, length: f64, pitch: f64, jitter: f64, dice: &mut Dice) {
    let r = (0.28 * pitch).clamp(0.0005, 0.0022);
    let lean = fall.tangent * (0.25 * jitter * dice.bell()) + fall.out * (0.15 * jitter * dice.bell());
    let path = fall.path(at, lean, length, r, 4);
    tube(piece, &path, &[r, r, r * 0.9, r * 0.8, r * 0.35], 3, false);
}

/// A head, a neck band and a skirt of strands.
fn tassel(piece: &mut Piece, fall: &Fall, at: DVec3, length: f64, pitch: f64, jitter: f64, dice: &mut Dice) {
    let wide = (0.105 * length).min(0.42 * pitch).max(0.0015);
    let lean = fall.tangent * (0.13 * jitter * dice.bell()) + fall.out * (0.10 * jitter * dice.bell());
    let path = fall.path(at, lean, length, wide, 8);
    let lengths = lengths(&path);
    let place = |t: f64| along(&path, &lengths, t * length);
    // A short cord from the edge.
    let (cord_end, d) = place(0.10);
    tube(piece, &[at, cord_end], &[wide * 0.22, wide * 0.22], 4, false);
    let side = square_to(d);
    let (head, d) = place(0.17);
    ball(piece, head, side, -d, DVec3::new(wide * 0.92, 0.085 * length, wide * 0.92), 5, 7);
    let (neck, d) = place(0.255);
    let ring: Vec<DVec3> = (0..7).map(|k| neck + turn(side, d, TAU * f64::from(k) / 7.0) * (wide * 0.52)).collect();
    tube(piece, &ring, &[wide * 0.22], 3, true);
    // The skirt: a core and strands around it that flare, bow and end unevenly.
    let core: Vec<DVec3> = [0.25, 0.45, 0.75, 0.93].map(|t| place(t).0).into();
    tube(piece, &core, &[wide * 0.5, wide * 0.85, wide * 0.95, wide * 0.75], 6, false);
    let strands = 12;
    for k in 0..strands {
        let angle = TAU * (f64::from(k) + 0.4 * dice.bell()) / f64::from(strands);
        let end = 1.0 + 0.08 * dice.bell();
        let flare = 1.18 + 0.25 * dice.bell();
        let strand: Vec<DVec3> = [(0.26, 0.5), (0.55, 0.98), (end, flare)]
            .into_iter()
            .map(|(t, out)| {
                let (p, d) = place(t);
                let beyond = if t > 1.0 { d * ((t - 1.0) * length) } else { DVec3::ZERO };
                let off = turn(square_to(d), d, angle) * (wide * out);
                let p = p + off + beyond;
                DVec3::new(p.x, p.y.max(0.25 * wide), p.z)
            })
            .collect();
        let r = wide * 0.24;
        tube(piece, &strand, &[r * 0.8, r, r * 0.55], 3, false);
    }
}

/// A ball of cut yarn on a cord.
fn pompom(piece: &mut Piece, fall: &Fall, at: DVec3, length: f64, pitch: f64, seed: u32, dice: &mut Dice) {
    let r = (0.45 * length).min(0.48 * pitch).max(0.002);
    let path = fall.path(at, fall.tangent * (0.08 * dice.bell()), length, r * 0.9, 4);
    let end = path[path.len() - 1];
    let up = (at - end).normalize_or(DVec3::Y);
    let centre = end + up * r;
    tube(piece, &[at, centre + up * (0.6 * r)], &[r * 0.09, r * 0.09], 4, false);
    let from = piece.positions.len();
    ball(piece, centre, square_to(up), up, DVec3::splat(r * 0.86), 7, 12);
    for p in &mut piece.positions[from..] {
        let d = (*p - centre).normalize_or(DVec3::Y);
        *p += d * (0.12 * r * noise3(d * 4.0, seed));
    }
    for _ in 0..60 {
        let z = dice.range(-1.0, 1.0);
        let (s, c) = libm::sincos(TAU * dice.unit());
        let flat = (1.0 - z * z).sqrt();
        let d = DVec3::new(flat * c, z, flat * s);
        spike(piece, centre + d * (0.8 * r), d, r * (0.22 + 0.14 * dice.unit()), r * 0.10);
    }
}

/// A three-sided point, its base open inside what it stands on.
pub(super) fn spike(piece: &mut Piece, at: DVec3, direction: DVec3, length: f64, radius: f64) {
    let side = square_to(direction);
    let tip = at + direction * length;
    let base: Vec<DVec3> = (0..3).map(|k| at + turn(side, direction, TAU * f64::from(k) / 3.0) * radius).collect();
    let foot = push(piece, at, direction, DVec2::ZERO);
    let top = push(piece, tip, direction, DVec2::new(0.0, length));
    let first = piece.positions.len() as u32;
    for p in &base {
        let n = ((*p - at) / radius + direction * 0.8).normalize_or(direction);
        push(piece, *p, n, DVec2::new(radius, 0.0));
    }
    for k in 0..3 {
        let (a, b) = (first + k, first + (k + 1) % 3);
        piece.triangles.extend([[a, b, top], [b, a, foot]]);
    }
}

/// One scallop of a lace edge: a fan of loops under a band.
fn scallop(piece: &mut Piece, fall: &Fall, at: DVec3, length: f64, pitch: f64) {
    let r = (0.035 * pitch).clamp(0.0004, 0.0018);
    let down = fall.path(at, DVec3::ZERO, length, r, 3);
    let d = (down[3] - at).normalize_or(DVec3::NEG_Y);
    let half = pitch / 2.0;
    let arc = |rise: f64, wide: f64, points: u32| -> Vec<DVec3> {
        (0..=points)
            .map(|k| {
                let (s, c) = libm::sincos(PI * f64::from(k) / f64::from(points));
                let p = at - fall.tangent * (wide * c) + d * (rise * s);
                DVec3::new(p.x, p.y.max(r), p.z)
            })
            .collect()
    };
    tube(piece, &arc(length, half, 8), &[r], 3, false);
    tube(piece, &arc(length * 0.62, half * 0.62, 6), &[r], 3, false);
    tube(piece, &arc(length * 0.30, half * 0.3, 4), &[r], 3, false);
    let (from, to) = (at - fall.tangent * half, at + fall.tangent * half);
    tube(piece, &[from, at, to], &[r * 1.5], 4, false);
    for k in 1..6 {
        let (s, c) = libm::sincos(PI * f64::from(k) / 6.0);
        let p = at - fall.tangent * (half * c) + d * (length * s);
        tube(piece, &[at, DVec3::new(p.x, p.y.max(r), p.z)], &[r * 0.7], 3, false);
    }
}

#[cfg(test)]
mod tests {
    use super::super::collider::tests::block;
    use super::super::grid::testing::sound;
    use super::*;

    fn spec(kind: FringeKind) -> FringeSpec {
        FringeSpec { kind, length: 0.12, spacing: 0.06, jitter: 0.3, seed: 2 }
    }

    #[test]
    fn fringes_hang_their_length_below_the_edge() {
        let edge = [DVec3::new(-0.5, 1.0, 0.0), DVec3::new(0.5, 1.0, 0.0)];
        for kind in [FringeKind::Thread, FringeKind::Tassel, FringeKind::Pompom, FringeKind::Lace] {
            let p = fringe(&edge, false, &spec(kind));
            sound(&p);
            let (lo, hi) = p.bounds().unwrap();
            assert!((0.85..0.90).contains(&lo.y) && hi.y < 1.03, "{kind:?}: {lo} {hi}");
            assert!(lo.x > -0.56 && hi.x < 0.56);
            // 17 of them.
            assert!(p.triangles.len() < 17 * 560, "{kind:?}: {}", p.triangles.len());
            assert_eq!(p, fringe(&edge, false, &spec(kind)));
        }
        let tassel = fringe(&edge, false, &spec(FringeKind::Tassel)).triangles.len() / 17;
        assert!((200..420).contains(&tassel), "{tassel}");
    }

    #[test]
    fn on_a_bed_it_lies_and_points_away_from_the_cloth() {
        let bed = block(DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 0.5, 1.0));
        let edge = [DVec3::new(-0.5, 0.505, 0.2), DVec3::new(0.5, 0.505, 0.2)];
        let p = fringe_on(&edge, false, &spec(FringeKind::Tassel), &[&bed], Some(DVec3::new(0.0, 0.5, -0.3)));
        let (lo, hi) = p.bounds().unwrap();
        assert!(lo.y > 0.48 && hi.z > 0.29 && lo.z > 0.15, "{lo} {hi}");
        // Over the edge of the bed it hangs.
        let edge = [DVec3::new(-0.5, 0.505, 1.02), DVec3::new(0.5, 0.505, 1.02)];
        let p = fringe_on(&edge, false, &spec(FringeKind::Thread), &[&bed], Some(DVec3::ZERO));
        assert!(p.bounds().unwrap().0.y < 0.41);
    }

    #[test]
    fn the_floor_bears_it_and_many_are_thinned() {
        let edge = [DVec3::new(-0.5, 0.03, 0.0), DVec3::new(0.5, 0.03, 0.0)];
        let p = fringe(&edge, false, &spec(FringeKind::Tassel));
        assert!(p.bounds().unwrap().0.y >= -0.002, "{:?}", p.bounds());
        let long = [DVec3::Y, DVec3::new(60.0, 1.0, 0.0)];
        let p = fringe(&long, false, &FringeSpec { spacing: 0.001, ..spec(FringeKind::Tassel) });
        assert!(p.triangles.len() < 100_000, "{}", p.triangles.len());
    }
}
