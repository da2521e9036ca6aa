//! Hairy surfaces.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::fringe::spike;
use super::grid::{ball, push, square_to, turn};
use super::noise::{Dice, noise3};
use crate::Piece;
use crate::tree::FuzzKind;

/// Most triangles of the hairs.
pub(super) const MAX_TRIANGLES: usize = 60_000;
/// Ends of yarn of a lock of pile, and triangles of one; its length and the half width of an end at its foot against the distance of
/// its neighbours of one colour, and its largest length, metres.
const ENDS: usize = 3;
const END_TRIANGLES: usize = 3;
const LOCK_LENGTH: f64 = 1.3;
const END_WIDTH: f64 = 0.08;
/// How far the outer ends turn from the middle one, radians: one broad lock looks like a leaf.
const SPREAD: f64 = 0.45;
/// How high a lock rises at least, of its length: its shadow is what makes pile dark between its hairs.
const LOCK_RISE: f64 = 0.35;
const MAX_LOCK: f64 = 0.05;
/// Steps that fill a square evenly (Roberts 2018), and how far a hair stands from its place there, of their distance.
const EVEN: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];
const LOOSE: f64 = 0.7;
/// A child that is thinner than this share of its lesser side lies on the floor: nobody sees the pile below it.
const MAT: f64 = 0.2;
/// Half width of a hair against its length, at most: what lies below has the hair's colour, and thick hair looks like dough.
const THIN: f64 = 0.06;

/// The hairs of a piece, without the piece itself; at most 60 000 triangles.
///
/// `length` of the hairs; `density` 0 to 1 of what the kind would have. Where the surface is large there are fewer and
/// thicker hairs, so that it stays covered: pile lies over in locks as long as they are apart, for short thick tufts look
/// like gravel. Fur stays thin, and the piece shows between its hairs.
pub fn fuzz(child: &Piece, kind: FuzzKind, length: f64, density: f64, seed: u32) -> Piece {
    let mut piece = Piece::default();
    let length = length.clamp(0.0005, 0.3);
    let corner = |t: &[u32; 3]| t.map(|i| child.positions[i as usize]);
    let size = child.bounds().map_or(DVec3::ONE, |(low, high)| high - low);
    let is_mat = kind == FuzzKind::Pile && size.y < MAT * size.x.min(size.z);
    let mut sums = Vec::with_capacity(child.triangles.len());
    let mut area = 0.0;
    for t in &child.triangles {
        let [a, b, c] = corner(t);
        let own = (b - a).cross(c - a) / 2.0;
        if !(is_mat && own.y < -0.5 * own.length()) {
            area += own.length();
        }
        sums.push(area);
    }
    if area < 1e-9 {
        return piece;
    }
    // Triangles of one hair, hairs a square metre, width relative to their distance.
    let (cost, many, wide) = match kind {
        FuzzKind::Pile => (6, 60_000.0, 0.55),
        FuzzKind::Terry => (18, 90_000.0, 0.5),
        FuzzKind::Boucle => (36, 14_000.0, 0.62),
        FuzzKind::Fur => (12, 40_000.0, 0.45),
    };
    let count_at = |cost: usize| {
        let count = ((area * many * density.clamp(0.02, 1.0)) as usize).clamp(1, MAX_TRIANGLES / cost);
        (count, (area / count as f64).sqrt())
    };
    let (mut count, mut gap) = count_at(cost);
    let is_sparse = kind == FuzzKind::Pile && gap > length;
    if is_sparse {
        (count, gap) = count_at(ENDS * END_TRIANGLES);
    }
    let mut dice = Dice::new(seed, 81);
    let start = [dice.unit(), dice.unit()];
    for k in 0..count {
        // One in every equal share of the area, and within a large triangle one beside the other: even without a grain, for
        // places by chance come in clumps, which look like stains.
        let s = area * (k as f64 + dice.unit()) / count as f64;
        let index = sums.partition_point(|v| *v < s).min(sums.len() - 1);
        let t = &child.triangles[index];
        let share = (sums[index] - if index > 0 { sums[index - 1] } else { 0.0 }) / area;
        let aside = LOOSE / (share * count as f64).max(1.0).sqrt();
        let [u, v] = [0, 1].map(|i| (start[i] + k as f64 * EVEN[i] + aside * (dice.unit() - 0.5)).rem_euclid(1.0));
        let (u, v) = (u.sqrt() * (1.0 - v), u.sqrt() * v);
        let mix = |f: &dyn Fn(usize) -> DVec3| f(0) * (1.0 - u - v) + f(1) * u + f(2) * v;
        let at = mix(&|i| child.positions[t[i] as usize]);
        let normal = mix(&|i| child.normals[t[i] as usize]).normalize_or(DVec3::Y);
        // Hairs of one patch lie the same way.
        let side = square_to(normal);
        let lay = turn(side, normal, TAU * noise3(at / 0.12, seed) + 0.8 * dice.bell());
        let long = length * (0.75 + 0.5 * dice.unit());
        let r = (gap * wide).min(0.5 * length).max(0.0004);
        match kind {
            FuzzKind::Pile if is_sparse => {
                let long = (LOCK_LENGTH * gap).clamp(length, MAX_LOCK) * (0.75 + 0.5 * dice.unit());
                let height = length.max(LOCK_RISE * long).min(0.6 * long);
                lock(&mut piece, at, normal, lay, [long, height, (END_WIDTH * gap).min(0.1 * long)]);
            }
            FuzzKind::Pile => {
                let from = piece.positions.len();
                let d = (normal + lay * (0.35 * dice.unit())).normalize_or(normal);
                spike(&mut piece, at - d * (0.1 * long), d, long * 1.1, r);
                soften(&mut piece, from, normal);
            }
            FuzzKind::Terry => arch(&mut piece, at, normal, lay, long, r),
            FuzzKind::Boucle => {
                let r = (0.8 * gap).min(length).max(0.0005) * (0.7 + 0.6 * dice.unit());
                let flat = DVec3::new(r, 0.75 * r, r * (0.7 + 0.4 * dice.unit()));
                ball(&mut piece, at + normal * (0.3 * r), lay, normal, flat, 4, 6);
            }
            FuzzKind::Fur => {
                let from = piece.positions.len();
                blade(&mut piece, at, normal, lay, long, r.min(THIN * long) * 0.6);
                soften(&mut piece, from, normal);
            }
        }
    }
    piece
}

/// A lock of pile, `[length, height, half width of an end]`: ends of yarn that rise from one foot, lie over and part.
fn lock(piece: &mut Piece, at: DVec3, normal: DVec3, lay: DVec3, [length, height, half]: [f64; 3]) {
    for end in 0..ENDS {
        let aside = end as f64 - (ENDS - 1) as f64 / 2.0;
        let along = turn(lay, normal, SPREAD * aside);
        let across = normal.cross(along);
        // The outer ones are shorter and lie lower.
        let (length, height) = (length * (1.0 - 0.15 * aside.abs()), height * (1.0 - 0.3 * aside.abs()));
        let base = piece.positions.len() as u32;
        for (i, (out, lift)) in [(-1.0, 0.0), (0.0, 0.7), (1.0, 0.0)].into_iter().enumerate() {
            let n = (normal + across * (0.5 * out) - along * 0.2).normalize_or(normal);
            let foot = at + across * (half * (out + 0.8 * aside)) + normal * (half * lift);
            push(piece, foot, n, DVec2::new(half * i as f64, 0.0));
        }
        let tip = at + along * length + normal * height;
        push(piece, tip, (normal + along * 0.3).normalize_or(normal), DVec2::new(half, length));
        piece.triangles.extend([[0, 3, 1], [1, 3, 2], [2, 3, 0]].map(|t| t.map(|i| base + i)));
    }
}

/// Light falls on hair as on the surface that it stands on, nearly.
fn soften(piece: &mut Piece, from: usize, normal: DVec3) {
    for n in &mut piece.normals[from..] {
        *n = (*n * 0.45 + normal).normalize_or(normal);
    }
}

/// A loop of yarn.
fn arch(piece: &mut Piece, at: DVec3, normal: DVec3, lay: DVec3, height: f64, r: f64) {
    let foot = 0.45 * height;
    let path = [
        at - lay * foot,
        at - lay * (0.7 * foot) + normal * (0.75 * height),
        at + lay * (0.7 * foot) + normal * height,
        at + lay * foot,
    ];
    strand(piece, &path, &[r; 4], normal.cross(lay), normal);
}

/// A hair that rises and lies over.
fn blade(piece: &mut Piece, at: DVec3, normal: DVec3, lay: DVec3, length: f64, r: f64) {
    let path = [at, at + (normal * 0.46 + lay * 0.36) * length, at + (normal * 0.42 + lay * 0.82) * length];
    strand(piece, &path, &[r, 0.8 * r, 0.05 * r], normal.cross(lay), normal);
}

/// A flat strand along a path with a ridge on its outer side; closed around, so that no renderer sees its inside, where
/// the normals would be turned away from the light.
fn strand(piece: &mut Piece, path: &[DVec3], half: &[f64], across: DVec3, normal: DVec3) {
    let base = piece.positions.len() as u32;
    let last = path.len() - 1;
    let mut length = 0.0;
    for (k, p) in path.iter().enumerate() {
        if k > 0 {
            length += p.distance(path[k - 1]);
        }
        let along = (path[(k + 1).min(last)] - path[k.saturating_sub(1)]).normalize_or(normal);
        let ridge = along.cross(across) * 0.5;
        for (i, out) in [-across, ridge, across].into_iter().enumerate() {
            let n = (normal + out * 0.4).normalize_or(normal);
            push(piece, *p + out * half[k], n, DVec2::new(half[k] * i as f64, length));
        }
    }
    for a in (0..last as u32).map(|k| base + 3 * k) {
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            piece.triangles.extend([[a + i, a + 3 + i, a + 3 + j], [a + i, a + 3 + j, a + j]]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cushion;
    use super::super::grid::testing::{sound, volume};
    use super::*;

    #[test]
    fn hairs_cover_the_surface_within_the_cap() {
        let child = cushion([1.2, 0.1, 0.8], 0.0, 0.0, 0.0, 0.02);
        for kind in [FuzzKind::Pile, FuzzKind::Terry, FuzzKind::Boucle, FuzzKind::Fur] {
            let hair = fuzz(&child, kind, 0.015, 1.0, 3);
            sound(&hair);
            assert!(hair.triangles.len() <= MAX_TRIANGLES && hair.triangles.len() > 15_000, "{kind:?}");
            let (lo, hi) = hair.bounds().unwrap();
            assert!(hi.y > 0.103 && hi.y < 0.13, "{kind:?}: {hi}");
            assert!(lo.y > -0.03);
            // Evenly: each quarter of the plan has its share.
            let quarter = hair.positions.iter().filter(|p| p.x > 0.0 && p.z > 0.0).count() as f64;
            let share = quarter / hair.positions.len() as f64;
            assert!((0.23..0.27).contains(&share), "{kind:?}: {share}");
            assert_eq!(hair, fuzz(&child, kind, 0.015, 1.0, 3));
        }
    }

    #[test]
    fn no_hair_is_open_along_its_sides() {
        let child = cushion([0.3, 0.05, 0.3], 0.0, 0.0, 0.0, 0.02);
        for kind in [FuzzKind::Pile, FuzzKind::Terry, FuzzKind::Boucle, FuzzKind::Fur] {
            let hair = fuzz(&child, kind, 0.015, 0.1, 3);
            // Of an open ribbon there is none, of one wound inwards a negative one.
            let volume = volume(&hair);
            assert!(volume > 1.7e-8, "{kind:?}: {volume}");
        }
    }

    #[test]
    fn sparse_pile_lies_over_in_locks_that_reach_one_another() {
        let rug = cushion([3.0, 0.02, 2.5], 0.0, 0.0, 0.0, 0.005);
        let hair = fuzz(&rug, FuzzKind::Pile, 0.007, 0.5, 3);
        sound(&hair);
        assert!(hair.triangles.len() <= MAX_TRIANGLES);
        // Four points an end, three ends a lock: the middle one's foot and tip.
        let length = |lock: &[DVec3]| lock[7].distance((lock[4] + lock[6]) / 2.0);
        let locks: Vec<f64> = hair.positions.chunks(4 * ENDS).map(length).collect();
        let below = hair.positions.iter().filter(|p| p.y < 0.0).count();
        assert!(below * 50 < hair.positions.len(), "nobody sees it below the rug: {below}");
        let apart = ((3.0 * 2.5) / locks.len() as f64).sqrt();
        let mean = locks.iter().sum::<f64>() / locks.len() as f64;
        assert!(mean > 0.9 * apart.min(MAX_LOCK) && mean < 1.4 * apart, "{mean} m, {apart} m apart");
        let volume = volume(&hair);
        assert!(volume > 1.7e-8, "{volume}");
    }

    #[test]
    fn nothing_has_no_hair() {
        assert!(fuzz(&Piece::default(), FuzzKind::Fur, 0.01, 1.0, 1).triangles.is_empty());
    }
}
