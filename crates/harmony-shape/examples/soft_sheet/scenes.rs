//! The scenes.

use glam::{DAffine3, DMat3, DVec2, DVec3};
use harmony_shape::Piece;
use harmony_shape::soft::{
    DrapeSpec, FringeSpec, HangSpec, PillowSpec, PlantSpec, TuftSpec, braid, cushion, drape, folded, fringe, fringe_on,
    fuzz, hang, leaf, pillow, plant, quilt, roll, slump, tuft, wicker, wire_net,
};
use harmony_shape::tree::{Face, FringeKind, FuzzKind, HangTop, Outline, PlantKind};

use crate::{Part, Scene};

const LINEN: [f64; 3] = [0.72, 0.70, 0.66];
const LILAC: [f64; 3] = [0.55, 0.48, 0.62];
const RUST: [f64; 3] = [0.50, 0.20, 0.08];
const WOOD: [f64; 3] = [0.35, 0.22, 0.12];

/// A scene's name and what makes it.
type Named = (&'static str, fn() -> Scene);

/// All scenes by name.
pub const ALL: &[Named] = &[
    ("bed", bed),
    ("duvet", duvet),
    ("throw", throw),
    ("sheet", sheet),
    ("pillows", pillows),
    ("cushion", cushions),
    ("linen", linen),
    ("tuft", tufts),
    ("hang", curtains),
    ("plants", plants),
    ("plants2", plants2),
    ("leaves", leaves),
    ("yarn", yarn),
    ("fuzz", hairy),
];

fn part(piece: Piece, color: [f64; 3]) -> Part {
    Part { piece, color }
}

/// A box by its corners.
fn block(lo: [f64; 3], hi: [f64; 3]) -> Piece {
    let (lo, hi) = (DVec3::from_array(lo), DVec3::from_array(hi));
    let mut p = Piece { closed: true, ..Piece::default() };
    for (axis, sign) in (0..3).flat_map(|a| [(a, -1.0), (a, 1.0)]) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let base = p.positions.len() as u32;
        for (a, b) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            let mut c = if sign > 0.0 { hi } else { lo };
            c[u] = lo[u] + (hi[u] - lo[u]) * a;
            c[v] = lo[v] + (hi[v] - lo[v]) * b;
            let mut n = DVec3::ZERO;
            n[axis] = sign;
            p.positions.push(c);
            p.normals.push(n);
            p.uvs.push(DVec2::new(a, b));
        }
        let quad = if sign > 0.0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
        p.triangles.extend(quad.map(|t| t.map(|i| i + base)));
    }
    p
}

fn moved(piece: Piece, at: [f64; 3], lean_deg: f64) -> Piece {
    let map = DAffine3::from_mat3_translation(DMat3::from_rotation_x(lean_deg.to_radians()), DVec3::from_array(at));
    piece.transformed(&map)
}

fn mattress() -> Piece {
    block([-0.8, 0.25, 0.0], [0.8, 0.5, 2.0])
}

fn cover() -> DrapeSpec {
    DrapeSpec {
        size: [2.1, 1.7],
        at: [0.0, 1.25],
        turn_deg: 0.0,
        rumple: 0.5,
        thick: 0.03,
        fold: 0.35,
        stiff: 0.2,
        seed: 21,
    }
}

fn bed() -> Scene {
    let (mattress, frame) = (mattress(), block([-0.85, 0.05, -0.02], [0.85, 0.3, 2.05]));
    let heads: Vec<Piece> = [(-0.38, 1), (0.38, 2)]
        .map(|(x, seed)| {
            let spec = PillowSpec { size: [0.68, 0.46, 0.17], wrinkle: 0.5, piping: 0.0, ears: 0.3, dent: 0.3, seed };
            moved(pillow(&spec), [x, 0.68, 0.16], 55.0)
        })
        .into();
    let duvet = drape(&cover(), &[&mattress, &frame, &heads[0], &heads[1]]).expect("a duvet");
    let over = DrapeSpec {
        size: [1.9, 0.75],
        at: [0.0, 1.65],
        turn_deg: 6.0,
        rumple: 0.3,
        thick: 0.006,
        fold: 0.0,
        seed: 3,
        ..cover()
    };
    let blanket = drape(&over, &[&mattress, &frame, &duvet.piece]).expect("a throw");
    let below = [&mattress, &frame, &duvet.piece];
    let fringes: Vec<Piece> = [&blanket.hems.left, &blanket.hems.right, &blanket.hems.foot]
        .iter()
        .map(|hem| {
            let spec = FringeSpec { kind: FringeKind::Tassel, length: 0.13, spacing: 0.075, jitter: 0.4, seed: 5 };
            fringe_on(hem, false, &spec, &below, Some(DVec3::new(0.0, 0.5, 1.65)))
        })
        .collect();
    let mut parts = vec![part(mattress, LINEN), part(frame, WOOD), part(duvet.piece, LILAC), part(blanket.piece, RUST)];
    parts.extend(fringes.into_iter().map(|p| part(p, [0.55, 0.12, 0.12])));
    parts.extend(heads.into_iter().map(|p| part(p, LINEN)));
    Scene { parts, view: [35.0, 28.0], floor: true }
}

fn duvet() -> Scene {
    let mattress = mattress();
    let cover = DrapeSpec { rumple: 0.7, seed: 8, ..cover() };
    let duvet = drape(&cover, &[&mattress]).expect("a duvet");
    let thin = DrapeSpec { thick: 0.004, size: [2.1, 2.0], fold: 0.0, rumple: 0.8, at: [2.4, 1.1], ..cover };
    let other = moved(mattress.clone(), [2.4, 0.0, 0.0], 0.0);
    let sheet = drape(&thin, &[&other]).expect("a sheet");
    let parts = vec![part(mattress, LINEN), part(duvet.piece, LILAC), part(other, LINEN), part(sheet.piece, RUST)];
    Scene { parts, view: [10.0, 35.0], floor: true }
}

fn throw() -> Scene {
    let (seat, back) = (block([-0.8, 0.0, -0.3], [0.8, 0.42, 0.45]), block([-0.8, 0.0, -0.5], [0.8, 0.85, -0.28]));
    let spec = DrapeSpec {
        size: [1.0, 1.5],
        at: [0.2, 0.1],
        turn_deg: 12.0,
        rumple: 0.4,
        thick: 0.006,
        fold: 0.0,
        stiff: 0.1,
        seed: 4,
    };
    let cloth = drape(&spec, &[&seat, &back]).expect("a throw");
    Scene {
        parts: vec![part(seat, LINEN), part(back, LINEN), part(cloth.piece, RUST)],
        view: [30.0, 25.0],
        floor: true,
    }
}

fn sheet() -> Scene {
    let table = block([-0.6, 0.0, -0.4], [0.6, 0.7, 0.4]);
    let spec = DrapeSpec {
        size: [1.8, 1.4],
        at: [0.0, 0.0],
        turn_deg: 0.0,
        rumple: 0.0,
        thick: 0.003,
        fold: 0.0,
        stiff: 0.0,
        seed: 4,
    };
    let cloth = drape(&spec, &[&table]).expect("a table cloth");
    Scene { parts: vec![part(table, WOOD), part(cloth.piece, LINEN)], view: [30.0, 25.0], floor: true }
}

fn pillows() -> Scene {
    let spec = PillowSpec { size: [0.48, 0.48, 0.16], wrinkle: 0.5, piping: 0.0, ears: 0.6, dent: 0.0, seed: 1 };
    let some = [
        (spec, LILAC),
        (PillowSpec { dent: 0.8, seed: 2, ..spec }, RUST),
        (PillowSpec { piping: 0.006, ears: 0.2, wrinkle: 0.1, seed: 3, ..spec }, LINEN),
        (PillowSpec { size: [0.68, 0.46, 0.17], wrinkle: 1.0, ears: 0.2, seed: 4, ..spec }, LINEN),
    ];
    let parts =
        some.iter().enumerate().map(|(k, (s, c))| part(moved(pillow(s), [k as f64 * 0.62, 0.24, 0.0], 75.0), *c));
    let mut parts: Vec<Part> = parts.collect();
    parts.push(part(moved(pillow(&spec), [0.5, 0.0, 0.6], 0.0), LINEN));
    Scene { parts, view: [10.0, 18.0], floor: true }
}

fn cushions() -> Scene {
    let mut parts = vec![part(cushion([0.7, 0.16, 0.6], 0.03, 0.0, 0.005, 0.03), LILAC)];
    parts.push(part(moved(cushion([0.7, 0.2, 0.6], 0.04, 0.03, 0.0, 0.05), [0.8, 0.0, 0.0], 0.0), LINEN));
    let bag = cushion([0.7, 0.6, 0.7], 0.1, 0.0, 0.0, 0.29);
    parts.push(part(moved(slump(&bag, 0.8), [1.8, 0.0, 0.0], 0.0), RUST));
    Scene { parts, view: [20.0, 28.0], floor: true }
}

fn linen() -> Scene {
    let mut parts = vec![
        part(roll(0.4, 0.06, 4.0, 0.010), LINEN),
        part(moved(folded([0.4, 0.28], 4, 0.022, 3), [0.5, 0.0, 0.0], 0.0), LILAC),
    ];
    parts.push(part(moved(folded([0.4, 0.28], 8, 0.006, 4), [1.0, 0.0, 0.0], 0.0), RUST));
    Scene { parts, view: [35.0, 22.0], floor: true }
}

fn tufts() -> Scene {
    let board = cushion([1.5, 0.7, 0.11], 0.0, 0.0, 0.0, 0.03);
    let t = tuft(&board, Face::Front, &TuftSpec { rows: 4, cols: 8, depth: 0.035, diamond: true, button: 0.012 });
    let mut parts = vec![part(t.piece, LILAC), part(t.buttons, LILAC)];
    let t = tuft(&board, Face::Front, &TuftSpec { rows: 3, cols: 6, depth: 0.025, diamond: false, button: 0.014 });
    parts.push(part(moved(t.piece, [0.0, 0.8, 0.0], 0.0), RUST));
    parts.push(part(moved(t.buttons, [0.0, 0.8, 0.0], 0.0), RUST));
    let seat = cushion([0.7, 0.16, 0.7], 0.02, 0.0, 0.0, 0.04);
    parts.push(part(moved(quilt(&seat, Face::Top, 0.14, 0.018, "diamond"), [-0.4, 0.0, 0.7], 0.0), LINEN));
    parts.push(part(moved(quilt(&seat, Face::Top, 0.12, 0.018, "channel"), [0.4, 0.0, 0.7], 0.0), LINEN));
    Scene { parts, view: [15.0, 25.0], floor: true }
}

fn curtains() -> Scene {
    let mut parts = Vec::new();
    let kinds =
        [(HangTop::Rings, 0.0, 9), (HangTop::Pleats, 0.0, 8), (HangTop::Rod, 0.0, 8), (HangTop::Pleats, 0.4, 8)];
    for (k, (top, tie, folds)) in kinds.into_iter().enumerate() {
        let c = hang(&HangSpec { size: [1.1, 2.4], folds, gather: 1.9, top, tie, seed: k as u32 });
        parts.push(part(moved(c.piece, [k as f64 * 1.25, 0.02, 0.0], 0.0), [LINEN, LILAC, RUST, LINEN][k]));
        parts.push(part(moved(c.fittings, [k as f64 * 1.25, 0.02, 0.0], 0.0), WOOD));
    }
    Scene { parts, view: [18.0, 6.0], floor: true }
}

const GREEN: [f64; 3] = [0.10, 0.26, 0.06];

fn row(kinds: &[(PlantKind, f64, f64)]) -> Scene {
    let mut parts = Vec::new();
    let mut x = 0.0;
    for (k, (kind, height, spread)) in kinds.iter().enumerate() {
        let p = plant(&PlantSpec { kind: *kind, height: *height, spread: *spread, count: 0, seed: k as u32 + 1 }, None);
        x += spread * 0.55;
        let at = [x, if *kind == PlantKind::Vine { 0.75 } else { 0.02 }, 0.0];
        x += spread * 0.55;
        let stem = if *kind == PlantKind::Tree { WOOD } else { [0.20, 0.24, 0.08] };
        for (piece, color) in [(p.leaves, GREEN), (p.stems, stem), (p.flowers, [0.75, 0.25, 0.30])] {
            if !piece.triangles.is_empty() {
                parts.push(part(moved(piece, at, 0.0), color));
            }
        }
    }
    Scene { parts, view: [10.0, 14.0], floor: true }
}

fn plants() -> Scene {
    row(&[
        (PlantKind::Bush, 0.6, 0.55),
        (PlantKind::Rosette, 0.5, 0.7),
        (PlantKind::Fern, 0.45, 0.8),
        (PlantKind::Vine, 0.8, 0.45),
    ])
}

fn plants2() -> Scene {
    row(&[
        (PlantKind::Succulent, 0.14, 0.26),
        (PlantKind::Palm, 1.1, 0.9),
        (PlantKind::Grass, 0.6, 0.5),
        (PlantKind::Flowers, 0.5, 0.4),
        (PlantKind::Tree, 1.3, 0.8),
    ])
}

fn leaves() -> Scene {
    let shapes = ["oval", "lance", "heart", "round", "lobed", "blade"];
    let parts = shapes.iter().enumerate().map(|(k, s)| {
        let l = leaf([0.3, if *s == "blade" { 0.04 } else { 0.16 }], s, 20.0, 40.0);
        part(moved(l, [k as f64 * 0.2, 0.15, 0.0], 0.0), GREEN)
    });
    Scene { parts: parts.collect(), view: [10.0, 50.0], floor: true }
}

fn yarn() -> Scene {
    let mut parts = Vec::new();
    let edge = [DVec3::new(-0.3, 0.3, 0.0), DVec3::new(0.3, 0.3, 0.0)];
    let kinds =
        [(FringeKind::Thread, 0.006), (FringeKind::Tassel, 0.05), (FringeKind::Pompom, 0.06), (FringeKind::Lace, 0.03)];
    for (k, (kind, spacing)) in kinds.into_iter().enumerate() {
        let spec = FringeSpec {
            kind,
            length: if kind == FringeKind::Lace { 0.03 } else { 0.1 },
            spacing,
            jitter: 0.3,
            seed: 1,
        };
        let at = [(k % 2) as f64 * 0.65, 0.2 * (k / 2) as f64, 0.0];
        parts.push(part(moved(fringe(&edge, false, &spec), at, 0.0), [LINEN, RUST, LILAC, LINEN][k]));
    }
    let line: Vec<DVec3> =
        (0..30).map(|k| DVec3::new(f64::from(k) * 0.02 - 0.3, 0.1 + 0.02 * (f64::from(k) * 0.3).sin(), 0.1)).collect();
    parts.push(part(braid(&line, false, 0.012, 3, 0.05), RUST));
    let circle = |r: f64| {
        (0..40)
            .map(|k| {
                let a = f64::from(k) * 0.157_08;
                [r * a.cos(), r * a.sin()]
            })
            .collect::<Vec<_>>()
    };
    let disc = Outline { points: circle(0.15), holes: vec![circle(0.05)], islands: Vec::new() };
    parts.push(part(moved(wire_net(&disc, 0.02, 0.001), [0.45, 0.16, 0.15], 0.0), WOOD));
    parts.push(part(
        moved(wicker(&cushion([0.3, 0.2, 0.25], 0.0, 0.0, 0.0, 0.04), 0.014, 0.0035), [0.85, 0.0, 0.15], 0.0),
        [0.55, 0.38, 0.18],
    ));
    Scene { parts, view: [12.0, 18.0], floor: true }
}

fn hairy() -> Scene {
    let mut parts = Vec::new();
    let kinds = [(FuzzKind::Pile, 0.03), (FuzzKind::Terry, 0.008), (FuzzKind::Boucle, 0.012), (FuzzKind::Fur, 0.05)];
    for (k, (kind, length)) in kinds.into_iter().enumerate() {
        let seat = cushion([0.4, 0.12, 0.4], 0.02, 0.0, 0.0, 0.05);
        let at = [k as f64 * 0.5, 0.0, 0.0];
        parts.push(part(moved(fuzz(&seat, kind, length, 1.0, 4), at, 0.0), LINEN));
        parts.push(part(moved(seat, at, 0.0), LINEN));
    }
    Scene { parts, view: [12.0, 30.0], floor: true }
}
