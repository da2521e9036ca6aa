use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::*;
use crate::Piece;
use crate::tree::{Axis, Boolean, Curve, Face, LoftSection, Outline, Section};

/// Closed, wound outwards, unit normals that agree with the faces, finite texture coordinates.
fn sound(piece: &Piece) {
    assert!(piece.is_watertight(), "open edges");
    assert!(piece.closed && piece.volume() > 0.0);
    agreeing(piece);
}

fn agreeing(piece: &Piece) {
    assert_eq!(piece.positions.len(), piece.normals.len());
    assert_eq!(piece.positions.len(), piece.uvs.len());
    assert!(piece.uvs.iter().all(|u| u.is_finite()));
    assert!(piece.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-6));
    let mut worst = 1.0_f64;
    for t in &piece.triangles {
        let [a, b, c] = t.map(|i| piece.positions[i as usize]);
        let cross = (b - a).cross(c - a);
        if cross.length() > 1e-9 {
            let n = cross.normalize();
            for i in t {
                worst = worst.min(n.dot(piece.normals[*i as usize]));
            }
        }
    }
    assert!(worst > 0.3, "a normal is off its face: {worst}");
}

/// Smallest and largest length on the surface for one metre of texture, over all triangles that are not slivers,
/// weighted out: the shares of area whose scale is off by more than `tolerance`.
fn scale_off(piece: &Piece, tolerance: f64) -> f64 {
    let mut off = 0.0;
    let mut all = 0.0;
    for t in &piece.triangles {
        let [a, b, c] = t.map(|i| piece.positions[i as usize]);
        let [p, q, r] = t.map(|i| piece.uvs[i as usize]);
        let (e, f) = (q - p, r - p);
        let det = e.perp_dot(f);
        let area = (b - a).cross(c - a).length() / 2.0;
        all += area;
        if det.abs() < 1e-14 {
            off += area;
            continue;
        }
        let du = ((b - a) * f.y - (c - a) * e.y) / det;
        let dv = ((c - a) * e.x - (b - a) * f.x) / det;
        if (du.length() - 1.0).abs() > tolerance || (dv.length() - 1.0).abs() > tolerance {
            off += area;
        }
    }
    off / all
}

fn near(value: f64, wanted: f64, share: f64) {
    assert!((value / wanted - 1.0).abs() < share, "{value} instead of {wanted}");
}

#[test]
fn a_plain_box_has_its_volume_area_and_size() {
    let b = rounded_box(DVec3::new(2.0, 0.5, 1.0), 0.0, 2, DVec2::ONE, DVec2::ZERO);
    sound(&b);
    assert!((b.volume() - 1.0).abs() < 1e-12);
    assert!((b.area() - 2.0 * (2.0 * 0.5 + 2.0 * 1.0 + 0.5 * 1.0)).abs() < 1e-12);
    assert_eq!(b.triangles.len(), 12);
    let (lo, hi) = b.bounds().unwrap();
    assert_eq!((lo, hi), (DVec3::new(-1.0, 0.0, -0.5), DVec3::new(1.0, 0.5, 0.5)));
    assert!(scale_off(&b, 1e-9) == 0.0);
    // a picture fits: the front's top left corner is (0, 0), its bottom right one (2, 0.5)
    for (p, (n, uv)) in b.positions.iter().zip(b.normals.iter().zip(&b.uvs)) {
        if n.z > 0.9 {
            assert!(uv.distance(DVec2::new(p.x + 1.0, 0.5 - p.y)) < 1e-12);
        }
    }
}

#[test]
fn a_rounded_box_loses_what_its_edges_lose() {
    let (w, h, d, r) = (0.6, 0.4, 0.5, 0.1);
    let b = rounded_box(DVec3::new(w, h, d), r, 8, DVec2::ONE, DVec2::ZERO);
    sound(&b);
    // inner box, slabs, quarter cylinders, one ball
    let (a, e, c) = (w - 2.0 * r, h - 2.0 * r, d - 2.0 * r);
    let volume = a * e * c + 2.0 * r * (a * e + e * c + a * c) + PI * r * r * (a + e + c) + 4.0 / 3.0 * PI * r * r * r;
    let area = 2.0 * (a * e + e * c + a * c) + TAU * r * (a + e + c) + 4.0 * PI * r * r;
    near(b.volume(), volume, 0.01);
    near(b.area(), area, 0.01);
    assert!(scale_off(&b, 0.05) < 0.12, "only the corners are off");
}

#[test]
fn a_tapered_box_is_a_frustum() {
    let b = rounded_box(DVec3::new(1.0, 2.0, 1.0), 0.0, 1, DVec2::new(0.5, 0.5), DVec2::new(0.3, 0.0));
    sound(&b);
    near(b.volume(), 2.0 / 3.0 * (1.0 + 0.25 + 0.5), 1e-9);
    // sheared sides keep their heights, their u runs level
    assert!(scale_off(&b, 0.45) < 0.01);
    let pyramid = rounded_box(DVec3::ONE, 0.0, 1, DVec2::ZERO, DVec2::ZERO);
    sound(&pyramid);
    near(pyramid.volume(), 1.0 / 3.0, 1e-9);
}

#[test]
fn cylinders_cones_prisms_and_pipes() {
    let c = cylinder(0.3, 0.8, 0.3, 0.0, 0, 0.0).unwrap();
    sound(&c);
    near(c.volume(), PI * 0.09 * 0.8, 0.01);
    near(c.area(), TAU * 0.3 * 0.8 + TAU * 0.09, 0.01);
    assert!(scale_off(&c, 0.02) < 1e-9);
    let cone = cylinder(0.3, 0.8, 0.0, 0.0, 0, 0.0).unwrap();
    sound(&cone);
    near(cone.volume(), PI * 0.09 * 0.8 / 3.0, 0.01);
    let hexagon = cylinder(0.3, 0.8, 0.3, 0.004, 6, 0.0).unwrap();
    sound(&hexagon);
    near(hexagon.volume(), 1.5 * 3.0_f64.sqrt() * 0.09 * 0.8, 0.01);
    // a flat side faces the front
    let (_, hi) = hexagon.bounds().unwrap();
    near(hi.z, 0.3 * 3.0_f64.sqrt() / 2.0, 0.01);
    let pipe = cylinder(0.3, 0.8, 0.3, 0.0, 0, 0.02).unwrap();
    sound(&pipe);
    near(pipe.volume(), PI * (0.09 - 0.28 * 0.28) * 0.8, 0.01);
}

#[test]
fn a_ball_is_round() {
    let s = sphere(DVec3::splat(0.5));
    sound(&s);
    near(s.volume(), 4.0 / 3.0 * PI * 0.125, 0.015);
    near(s.area(), PI, 0.015);
    assert!(scale_off(&s, 0.45) < 0.01);
    let e = sphere(DVec3::new(0.4, 0.2, 0.3));
    sound(&e);
    near(e.volume(), 4.0 / 3.0 * PI * 0.024, 0.02);
    let (lo, hi) = e.bounds().unwrap();
    assert!(lo.y.abs() < 1e-9 && (hi.y - 0.4).abs() < 1e-9);
}

#[test]
fn a_lathe_goes_either_way_and_takes_walls() {
    let up = [[0.0, 0.0], [0.1, 0.0], [0.15, 0.2], [0.05, 0.3], [0.0, 0.3]];
    let mut down = up;
    down.reverse();
    let frusta = |r0: f64, r1: f64, h: f64| PI * h / 3.0 * (r0 * r0 + r0 * r1 + r1 * r1);
    let volume = frusta(0.1, 0.15, 0.2) + frusta(0.15, 0.05, 0.1);
    for profile in [up, down] {
        let l = lathe(&Lathe::of(&profile)).unwrap();
        sound(&l);
        near(l.volume(), volume, 0.02);
    }
    // a vase: closed below, open above, 5 mm thick
    let vase = [[0.0, 0.0], [0.08, 0.0], [0.08, 0.3]];
    let v = lathe(&Lathe { wall: 0.005, ..Lathe::of(&vase) }).unwrap();
    sound(&v);
    near(v.volume(), PI * (0.0064 * 0.3 - 0.075 * 0.075 * 0.295), 0.03);
    // a shade, open at both ends; without a wall it is a sheet
    let shade = [[0.15, 0.0], [0.1, 0.2]];
    sound(&lathe(&Lathe { wall: 0.002, ..Lathe::of(&shade) }).unwrap());
    let sheet = lathe(&Lathe::of(&shade)).unwrap();
    assert!(!sheet.closed);
    agreeing(&sheet);
    let closed_above = [[0.15, 0.0], [0.1, 0.2], [0.0, 0.22]];
    sound(&lathe(&Lathe { wall: 0.003, ..Lathe::of(&closed_above) }).unwrap());
    let lobes = lathe(&Lathe { lobes: 5, lobe_depth: 0.2, oval: 0.7, ..Lathe::of(&up) }).unwrap();
    sound(&lobes);
    assert!(lobes.volume() < 0.7 * volume);
}

fn square(w: f64) -> Vec<[f64; 2]> {
    let h = w / 2.0;
    vec![[-h, -h], [h, -h], [h, h], [-h, h]]
}

fn frame() -> Outline {
    // the hole goes round the wrong way: it is turned
    Outline { points: square(1.0), holes: vec![square(0.6)], islands: Vec::new() }
}

#[test]
fn extrusions_keep_holes_and_axes() {
    let o = frame();
    let plain = Extrusion { outline: &o, depth: 0.4, axis: Axis::Z, bevel: 0.0, bend_deg: 0.0, twist_deg: 0.0 };
    let e = extrude(&plain).unwrap();
    sound(&e);
    near(e.volume(), (1.0 - 0.36) * 0.4, 1e-9);
    near(e.area(), 2.0 * 0.64 + 0.4 * (4.0 + 2.4), 1e-9);
    assert!(scale_off(&e, 1e-6) < 1e-9);
    let bevelled = extrude(&Extrusion { bevel: 0.02, ..plain }).unwrap();
    sound(&bevelled);
    assert!(bevelled.volume() < e.volume() && bevelled.volume() > 0.97 * e.volume());
    for axis in [Axis::X, Axis::Y] {
        let turned = extrude(&Extrusion { axis, ..plain }).unwrap();
        sound(&turned);
        near(turned.volume(), e.volume(), 1e-9);
    }
    let off = Outline { points: vec![[0.1, 0.2], [0.4, 0.2], [0.4, 0.9], [0.1, 0.9]], ..Outline::default() };
    let x = extrude(&Extrusion { outline: &off, axis: Axis::X, ..plain }).unwrap();
    let (lo, hi) = x.bounds().unwrap();
    assert!(lo.distance(DVec3::new(-0.2, 0.2, -0.4)) < 1e-9 && hi.distance(DVec3::new(0.2, 0.9, -0.1)) < 1e-9);
    let y = extrude(&Extrusion { outline: &off, axis: Axis::Y, ..plain }).unwrap();
    let (lo, hi) = y.bounds().unwrap();
    assert!(lo.distance(DVec3::new(0.1, 0.0, -0.9)) < 1e-9 && hi.distance(DVec3::new(0.4, 0.4, -0.2)) < 1e-9);
}

#[test]
fn bends_and_twists_keep_the_volume_of_a_centred_outline() {
    let o = Outline { points: square(0.1), ..Outline::default() };
    let e = Extrusion { outline: &o, depth: 1.0, axis: Axis::X, bevel: 0.005, bend_deg: 90.0, twist_deg: 0.0 };
    let bent = extrude(&e).unwrap();
    sound(&bent);
    // Pappus: the middle of the section travels one metre
    near(bent.volume(), 0.01, 0.02);
    let (_, hi) = bent.bounds().unwrap();
    assert!(hi.y > 0.15, "towards +y: {hi}");
    let up = extrude(&Extrusion { axis: Axis::Y, ..e }).unwrap();
    sound(&up);
    let (lo, hi) = up.bounds().unwrap();
    assert!(hi.z > 0.5 && lo.y > -0.05, "towards +z, standing: {lo} {hi}");
    let twisted = extrude(&Extrusion { bend_deg: 0.0, twist_deg: 180.0, ..e }).unwrap();
    sound(&twisted);
    // flat triangles between the turned rows lie inside the ruled sides
    near(twisted.volume(), 0.01, 0.04);
}

fn ring(radius: f64, n: usize) -> Curve {
    let points = (0..n)
        .map(|k| {
            let (s, c) = math::sin_cos(TAU * k as f64 / n as f64);
            [radius * c, 0.0, radius * s]
        })
        .collect();
    Curve { points, closed: true }
}

fn plain_sweep<'a>(curve: &'a Curve, section: &'a Section) -> Sweep<'a> {
    Sweep { curve, section, taper: 1.0, twist_deg: 0.0, rings: [0.0; 2], round_caps: false }
}

#[test]
fn a_swept_circle_is_a_torus() {
    let (curve, section) = (ring(0.5, 96), Section::Round(0.1));
    let t = sweep(&plain_sweep(&curve, &section)).unwrap();
    sound(&t);
    near(t.volume(), 2.0 * PI * PI * 0.5 * 0.01, 0.03);
    near(t.area(), 4.0 * PI * PI * 0.5 * 0.1, 0.03);
    assert!(scale_off(&t, 0.25) < 0.05, "inner side shorter, outer side longer by a fifth");
}

#[test]
fn straight_sweeps_have_closed_ends() {
    let curve = Curve { points: vec![[0.0; 3], [0.0, 1.0, 0.0]], closed: false };
    let section = Section::Round(0.05);
    let flat = sweep(&plain_sweep(&curve, &section)).unwrap();
    sound(&flat);
    near(flat.volume(), PI * 0.0025, 0.03);
    let round = sweep(&Sweep { round_caps: true, ..plain_sweep(&curve, &section) }).unwrap();
    sound(&round);
    near(round.volume(), PI * 0.0025 + 4.0 / 3.0 * PI * 0.000_125, 0.05);
    let (lo, hi) = round.bounds().unwrap();
    assert!((lo.y + 0.05).abs() < 1e-9 && (hi.y - 1.05).abs() < 1e-9);
    let cone = sweep(&Sweep { taper: 0.5, ..plain_sweep(&curve, &section) }).unwrap();
    sound(&cone);
    near(cone.volume(), PI * 0.0025 / 3.0 * (1.0 + 0.25 + 0.5), 0.03);
    let hose = sweep(&Sweep { rings: [0.05, 0.01], ..plain_sweep(&curve, &section) }).unwrap();
    sound(&hose);
    assert!(hose.volume() < flat.volume());
}

#[test]
fn corners_are_mitred_and_profiles_stay_upright() {
    // a picture frame: a square path of 1 x 1 m, section 4 x 2 cm, in the xy plane
    let path = square(1.0).iter().map(|[x, y]| [*x, *y, 0.0]).collect();
    let curve = Curve { points: path, closed: true };
    let section = Section::Outline(Outline {
        points: vec![[-0.02, -0.01], [0.02, -0.01], [0.02, 0.01], [-0.02, 0.01]],
        ..Outline::default()
    });
    let f = sweep(&plain_sweep(&curve, &section)).unwrap();
    sound(&f);
    // mitred: the middle line's length times the section
    near(f.volume(), 4.0 * 0.04 * 0.02, 1e-6);
    let (lo, hi) = f.bounds().unwrap();
    let size = hi - lo;
    assert!((size.x - size.y).abs() < 1e-9 && size.x > 1.019, "{size}");
    // along +z x is to the right seen from behind and y up
    let along = Curve { points: vec![[0.0; 3], [0.0, 0.0, 1.0]], closed: false };
    let high = Section::Outline(Outline {
        points: vec![[0.0, 0.0], [0.1, 0.0], [0.1, 0.3], [0.0, 0.3]],
        ..Outline::default()
    });
    let (lo, hi) = sweep(&plain_sweep(&along, &high)).unwrap().bounds().unwrap();
    assert!(lo.distance(DVec3::ZERO) < 1e-9 && hi.distance(DVec3::new(0.1, 0.3, 1.0)) < 1e-9, "{lo} {hi}");
}

#[test]
fn tight_bends_shrink_the_tube() {
    let curve = Curve {
        points: (0..=24)
            .map(|k| {
                let (s, c) = math::sin_cos(PI * f64::from(k) / 24.0);
                [0.03 * c, 0.03 * s, 0.0]
            })
            .collect(),
        closed: false,
    };
    let t = sweep(&plain_sweep(&curve, &Section::Round(0.06))).unwrap();
    sound(&t);
    let (_, hi) = t.bounds().unwrap();
    assert!(hi.y < 0.08, "{hi}");
}

#[test]
fn lofts_join_different_outlines() {
    let at = |y: f64, w: f64| LoftSection {
        outline: Outline { points: square(w), ..Outline::default() },
        at: [0.0, y, 0.0],
        turn_deg: [0.0; 3],
    };
    let prism = loft(&[at(0.0, 0.4), at(1.0, 0.4)], false).unwrap();
    sound(&prism);
    near(prism.volume(), 0.16, 1e-9);
    let frustum = loft(&[at(1.0, 0.2), at(0.0, 0.4)], false).unwrap();
    sound(&frustum);
    near(frustum.volume(), (0.16 + 0.04 + 0.08) / 3.0, 1e-9);
    let circle: Vec<[f64; 2]> = (0..40)
        .map(|k| {
            let (s, c) = math::sin_cos(TAU * f64::from(k) / 40.0);
            [0.2 * c, 0.2 * s]
        })
        .collect();
    let round = LoftSection { outline: Outline { points: circle, ..Outline::default() }, ..at(1.0, 1.0) };
    let mixed = loft(&[at(0.0, 0.4), round], false).unwrap();
    sound(&mixed);
    assert!(mixed.volume() > PI * 0.04 * 0.97 && mixed.volume() < 0.16);
}

#[test]
fn sheets_and_grids_have_their_thickness() {
    let profile = [[0.0, 0.0], [0.5, 0.0], [0.5, 0.3]];
    for axis in [Axis::X, Axis::Y, Axis::Z] {
        let s = bent_sheet(&BentSheet { profile: &profile, width: 0.4, thick: 0.01, smooth: false, axis }).unwrap();
        sound(&s);
        near(s.volume(), 0.8 * 0.4 * 0.01, 1e-6);
    }
    let at = |i: usize, j: usize| [i as f64 * 0.1, 0.02 * ((i + j) % 2) as f64, -(j as f64) * 0.1];
    let points: Vec<[f64; 3]> = (0..6).flat_map(|j| (0..5).map(move |i| at(i, j))).collect();
    let open = surf(&points, 5, 0.0, false).unwrap();
    assert!(!open.closed);
    agreeing(&open);
    sound(&surf(&points, 5, 0.01, false).unwrap());
    let tube: Vec<[f64; 3]> = (0..4)
        .flat_map(|j| {
            (0..16).map(move |i| {
                let (s, c) = math::sin_cos(TAU * f64::from(i) / 16.0);
                [0.2 * c, 0.1 * f64::from(j), 0.2 * s]
            })
        })
        .collect();
    let t = surf(&tube, 16, 0.01, true).unwrap();
    sound(&t);
    near(t.volume(), TAU * 0.2 * 0.3 * 0.01, 0.04);
    assert!(surf(&points, 7, 0.0, false).unwrap_err().contains("rows of 7"));
}

#[test]
fn plain_meshes_are_checked() {
    let points = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.5, 1.0, 0.5]];
    let faces = vec![vec![0, 1, 2, 3], vec![0, 4, 1], vec![1, 4, 2], vec![2, 4, 3], vec![3, 4, 0]];
    let m = mesh(&points, &faces).unwrap();
    sound(&m);
    near(m.volume(), 1.0 / 3.0, 1e-9);
    assert!(mesh(&points, &[vec![0, 1, 9]]).unwrap_err().contains("point 9"));
    assert!(mesh(&points, &[vec![0, 1]]).unwrap_err().contains("2 corners"));
}

fn cube(size: f64, at: DVec3) -> Piece {
    let mut b = rounded_box(DVec3::splat(size), 0.0, 1, DVec2::ONE, DVec2::ZERO);
    for p in &mut b.positions {
        *p += at - DVec3::Y * (size / 2.0);
    }
    b
}

#[test]
fn booleans_have_the_volumes_of_sets() {
    let a = cube(1.0, DVec3::ZERO);
    let b = cube(1.0, DVec3::new(0.4, 0.3, 0.2));
    let shared = 0.6 * 0.7 * 0.8;
    for (op, volume) in [(Boolean::Cut, 1.0 - shared), (Boolean::Join, 2.0 - shared), (Boolean::Common, shared)] {
        let r = boolean(op, &a, &b).unwrap();
        sound(&r);
        assert!((r.volume() - volume).abs() < 1e-9, "{op:?}: {} instead of {volume}", r.volume());
        assert!(scale_off(&r, 1e-6) < 1e-9, "texture coordinates are carried through");
    }
}

#[test]
fn holes_through_and_faces_in_one_plane() {
    let a = cube(1.0, DVec3::ZERO);
    let mut drill = cylinder(0.2, 1.6, 0.2, 0.0, 0, 0.0).unwrap();
    let disc = drill.volume() / 1.6;
    for p in &mut drill.positions {
        p.y -= 0.8;
    }
    let r = boolean(Boolean::Cut, &a, &drill).unwrap();
    sound(&r);
    assert!((r.volume() - (1.0 - disc)).abs() < 1e-9);
    // flush: the drill ends exactly in the face it leaves by
    for p in &mut drill.positions {
        p.y = p.y.clamp(-0.5, 0.5);
    }
    let r = boolean(Boolean::Cut, &a, &drill).unwrap();
    sound(&r);
    assert!((r.volume() - (1.0 - disc)).abs() < 1e-9, "{}", r.volume());
    // side by side with a common face
    let beside = boolean(Boolean::Join, &a, &cube(1.0, DVec3::X)).unwrap();
    sound(&beside);
    assert!((beside.volume() - 2.0).abs() < 1e-9 && (beside.area() - 10.0).abs() < 1e-9);
    // the same twice, and a thing from itself
    assert!((boolean(Boolean::Join, &a, &a).unwrap().volume() - 1.0).abs() < 1e-9);
    assert!(boolean(Boolean::Cut, &a, &a).unwrap().triangles.is_empty());
    // wholly inside
    let inner = cube(0.5, DVec3::ZERO);
    near(boolean(Boolean::Cut, &a, &inner).unwrap().volume(), 1.0 - 0.125, 1e-9);
    near(boolean(Boolean::Common, &a, &inner).unwrap().volume(), 0.125, 1e-9);
}

#[test]
fn round_things_cut_round_things() {
    let a = sphere(DVec3::splat(0.5));
    let mut b = sphere(DVec3::splat(0.4));
    for p in &mut b.positions {
        *p += DVec3::new(0.35, 0.25, 0.11);
    }
    let (cut, common) = (boolean(Boolean::Cut, &a, &b).unwrap(), boolean(Boolean::Common, &a, &b).unwrap());
    let join = boolean(Boolean::Join, &a, &b).unwrap();
    assert!((cut.volume() + common.volume() - a.volume()).abs() < 1e-6);
    assert!((join.volume() - (a.volume() + b.volume() - common.volume())).abs() < 1e-6);
    assert!(cut.is_watertight() && common.is_watertight() && join.is_watertight());
    assert!(boolean(Boolean::Cut, &a, &Piece { closed: false, ..b }).unwrap_err().contains("closed"));
}

#[test]
fn hollow_things_keep_their_walls() {
    let a = cube(1.0, DVec3::new(0.0, 0.5, 0.0));
    let open = hollow(&a, 0.1, Some(Face::Top)).unwrap();
    sound(&open);
    near(open.volume(), 1.0 - 0.8 * 0.8 * 0.9, 1e-6);
    let shut = hollow(&a, 0.1, None).unwrap();
    near(shut.volume(), 1.0 - 0.512, 1e-9);
    assert!(hollow(&a, 0.6, None).unwrap_err().contains("0.6"));
}

#[test]
fn blends_round_their_joints() {
    let ball = |x: f64, r: f64| Blob {
        field: Field::Ellipsoid(DVec3::splat(r)).moved(&glam::DAffine3::from_translation(DVec3::X * x)),
        lo: DVec3::new(x - r, -r, -r),
        hi: DVec3::new(x + r, r, r),
    };
    let one = blend(&[ball(0.0, 0.5)], 0.0).unwrap();
    sound(&one);
    near(one.volume(), 4.0 / 3.0 * PI * 0.125, 0.02);
    let two = [ball(-0.3, 0.4), ball(0.3, 0.4)];
    let (sharp, soft) = (blend(&two, 0.0).unwrap(), blend(&two, 0.3).unwrap());
    sound(&soft);
    // two balls less their lens
    let (r, d) = (0.4_f64, 0.6);
    let lens = PI * (2.0 * r - d) * (2.0 * r - d) * (d * d + 4.0 * d * r) / (12.0 * d);
    near(sharp.volume(), 2.0 * 4.0 / 3.0 * PI * r * r * r - lens, 0.02);
    assert!(soft.volume() > 1.02 * sharp.volume());
}

#[test]
fn the_same_numbers_give_the_same_bits() {
    let make = || {
        let a = sphere(DVec3::new(0.5, 0.4, 0.3));
        let b = cylinder(0.2, 1.0, 0.1, 0.01, 0, 0.0).unwrap();
        let curve = ring(0.4, 20);
        vec![
            boolean(Boolean::Cut, &a, &b).unwrap(),
            sweep(&plain_sweep(&curve, &Section::Round(0.03))).unwrap(),
            rounded_box(DVec3::ONE, 0.05, 4, DVec2::ONE, DVec2::ZERO),
        ]
    };
    assert_eq!(make(), make());
}
