//! Tests of leaves and plants.

use super::super::grid::testing::sound;
use super::*;

const KINDS: [PlantKind; 9] = [
    PlantKind::Bush,
    PlantKind::Rosette,
    PlantKind::Fern,
    PlantKind::Vine,
    PlantKind::Succulent,
    PlantKind::Palm,
    PlantKind::Grass,
    PlantKind::Flowers,
    PlantKind::Tree,
];

fn spec(kind: PlantKind) -> PlantSpec {
    PlantSpec { kind, height: 0.6, spread: 0.5, count: 0, seed: 7 }
}

#[test]
fn plants_fill_their_height_and_spread_and_no_more() {
    for kind in KINDS {
        let p = plant(&spec(kind), None);
        sound(&p.leaves);
        let mut all = p.leaves.clone();
        all.append(&p.stems);
        all.append(&p.flowers);
        let (lo, hi) = all.bounds().unwrap();
        let radius = all.positions.iter().map(|p| p.x.hypot(p.z)).fold(0.0, f64::max);
        assert!((radius - 0.25).abs() < 1e-6, "{kind:?}: {radius}");
        if kind == PlantKind::Vine {
            assert!((hi.y - lo.y - 0.6).abs() < 1e-6 && (hi.y - 0.12).abs() < 1e-6, "{lo} {hi}");
        } else {
            assert!((hi.y - 0.6).abs() < 1e-6 && lo.y >= 0.0, "{kind:?}: {lo} {hi}");
        }
        // Full all around: every octant of the plan has its share of leaves.
        let mut octants = [0_usize; 8];
        for p in &p.leaves.positions {
            octants[(libm::atan2(p.x, p.z) / std::f64::consts::FRAC_PI_4 + 8.0) as usize % 8] += 1;
        }
        let least = p.leaves.positions.len() / 40;
        assert!(octants.iter().all(|n| *n > least), "{kind:?}: {octants:?}");
        assert!(all.triangles.len() <= 16_000, "{kind:?}: {} triangles", all.triangles.len());
        assert_eq!(p.flowers.triangles.is_empty(), kind != PlantKind::Flowers);
    }
}

#[test]
fn same_seed_same_plant() {
    for kind in [PlantKind::Bush, PlantKind::Fern] {
        assert_eq!(plant(&spec(kind), None), plant(&spec(kind), None));
        assert_ne!(plant(&spec(kind), None), plant(&PlantSpec { seed: 8, ..spec(kind) }, None));
    }
}

#[test]
fn leaves_have_their_length_and_width_and_bend_as_told() {
    for shape in ["oval", "lance", "heart", "round", "lobed", "blade"] {
        let flat = leaf([0.2, 0.08], shape, 0.0, 0.0);
        sound(&flat);
        let (lo, hi) = flat.bounds().unwrap();
        assert!((hi.z - lo.z - 0.2).abs() < 0.012, "{shape}: {lo} {hi}");
        assert!((0.07..0.082).contains(&(hi.x - lo.x)), "{shape}: {lo} {hi}");
        let up: f64 = flat.normals.iter().map(|n| n.y).sum::<f64>() / flat.normals.len() as f64;
        assert!(up > 0.9, "{shape}: {up}");
    }
    // A quarter turn over 0.2 m: the tip is at radius (1 - cos) below and radius sin ahead; radius = 0.2 / (pi / 2).
    let bent = leaf([0.2, 0.08], "oval", 0.0, 90.0);
    let tip = bent.positions.iter().fold(f64::MAX, |m, p| m.min(p.y));
    assert!((tip + 0.4 / std::f64::consts::PI).abs() < 0.008, "{tip}");
    let folded = leaf([0.2, 0.08], "oval", 45.0, 0.0);
    let (lo, hi) = folded.bounds().unwrap();
    assert!(hi.x - lo.x < 0.065 && hi.y > 0.015);
}

#[test]
fn a_given_leaf_is_used() {
    let own = leaf([0.1, 0.05], "heart", 10.0, 20.0);
    let p = plant(&spec(PlantKind::Bush), Some(&own));
    assert_eq!(p.leaves.triangles.len() % own.triangles.len(), 0);
}
