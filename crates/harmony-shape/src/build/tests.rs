use glam::{DVec2, DVec3};

use super::*;
use crate::material::{MaterialSpec, PhotoMap};
use crate::tree::{
    Boolean, Curve, Face, FuzzKind, JointKind, Kind, MAX_TRIANGLES, Node, NodeId, Section, ShapeTree, TreeError,
};

#[derive(Default)]
struct Maker {
    tree: ShapeTree,
}

impl Maker {
    fn material(&mut self, name: &str) -> u32 {
        let json = serde_json::json!({ "name": name, "color": "#806040" });
        self.tree.materials.push(serde_json::from_value::<MaterialSpec>(json).unwrap());
        self.tree.materials.len() as u32 - 1
    }

    fn node(&mut self, name: &str, material: Option<u32>, kind: Kind) -> NodeId {
        let line = self.tree.nodes.len() as u32 + 1;
        let name = (!name.is_empty()).then(|| name.to_owned());
        self.tree.nodes.push(Node { kind, name, material, line });
        NodeId(line - 1)
    }

    fn cube(&mut self, name: &str, material: Option<u32>, size: [f64; 3]) -> NodeId {
        let kind = Kind::Box { size, bevel: 0.0, segments: 2, taper: [1.0; 2], shear: [0.0; 2] };
        self.node(name, material, kind)
    }

    fn at(&mut self, child: NodeId, to: [f64; 3]) -> NodeId {
        let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], to];
        self.node("", None, Kind::Placed { child, columns })
    }

    fn group(&mut self, name: &str, children: Vec<NodeId>) -> NodeId {
        self.node(name, None, Kind::Group { children })
    }

    fn build(&self) -> BuiltShape {
        let shape = self.tree.build(&BuildContext::default()).unwrap();
        shape.mesh.check().unwrap();
        assert_eq!(shape.mesh.metric_uvs.len(), shape.mesh.positions.len());
        assert!(shape.mesh.uvs.iter().all(|u| u.min_element() >= 0.0 && u.max_element() <= 1.0));
        shape
    }
}

/// A table with a drawer: 4 legs as copies, a top, a lamp's light.
fn table() -> Maker {
    let mut m = Maker::default();
    let (oak, steel) = (m.material("oak"), m.material("steel"));
    let top = m.cube("top", Some(oak), [1.2, 0.04, 0.8]);
    let top = m.at(top, [0.0, 0.7, 0.0]);
    let leg = m.cube("leg", Some(steel), [0.05, 0.7, 0.05]);
    let places = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, z)| [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.55 * x, 0.0, 0.35 * z]]);
    let legs = m.node("legs", None, Kind::Copies { child: leg, places: places.to_vec() });
    let drawer = m.cube("drawer", Some(oak), [0.4, 0.1, 0.6]);
    let drawer = m.at(drawer, [0.0, 0.6, 0.05]);
    let kind = Kind::Joint {
        child: drawer,
        joint: JointKind::Slide,
        axis: [0.0, 0.0, 2.0],
        pivot: [0.0; 3],
        range: [0.0, 0.4],
    };
    let drawer = m.node("", None, kind);
    m.group("table", vec![top, legs, drawer]);
    m
}

#[test]
fn a_table_is_canonical_with_groups_names_joints_and_hulls() {
    let shape = table().build();
    let b = shape.mesh.bounds().unwrap();
    assert!(
        (b.min - DVec3::new(-0.6, 0.0, -0.4)).length() < 1e-6 && (b.max - DVec3::new(0.6, 0.74, 0.4)).length() < 1e-6
    );
    assert_eq!(shape.slots, ["oak", "steel"]);
    assert_eq!(shape.mesh.groups.len(), 2);
    let names: Vec<&str> = shape.parts.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["top", "legs/leg", "drawer"]);
    assert_eq!((shape.parts[1].instances, shape.parts[1].triangles), (4, 48));
    assert_eq!(shape.convex.len(), 6);
    let joint = &shape.joints[0];
    assert_eq!((joint.parts.as_slice(), joint.axis), (&[2][..], DVec3::Z));
    assert_eq!(joint.boxes, [[shape.parts[2].low, shape.parts[2].high]]);
    let mut wide = shape.clone();
    wide.fit_to(DVec3::new(2.4, 0.74, 0.8));
    assert!((wide.joints[0].boxes[0][1].x - 2.0 * joint.boxes[0][1].x).abs() < 1e-6);
    // a face's length in texture metres is its length
    for t in shape.mesh.triangles() {
        let [a, b, _] = t.map(|i| i as usize);
        let (p, q) = (shape.mesh.positions[a], shape.mesh.positions[b]);
        let uv = shape.mesh.metric_uvs[a].distance(shape.mesh.metric_uvs[b]);
        assert!((p.distance(q) - uv).abs() < 1e-4);
    }
    assert!(lazy_signs(&shape, Some(DVec3::new(1.2, 0.74, 0.8))).is_empty(), "{:?}", lazy_signs(&shape, None));
}

#[test]
fn a_rug_that_was_made_too_high_keeps_its_width() {
    let mut m = Maker::default();
    let pile = m.material("pile");
    m.cube("rug", Some(pile), [2.2, 0.05, 3.5]);
    let mut shape = m.build();
    let fit = shape.fit_to(DVec3::new(2.0, 0.01, 3.4));
    assert!(!fit.uniform && (shape.size() - DVec3::new(2.0, 0.01, 3.4)).length() < 1e-4, "{:?}", shape.size());
}

#[test]
fn a_sheet_shows_its_upper_side_and_its_front_however_its_grid_winds() {
    // Points of a row go along the first axis, rows along the second.
    let sheet = |u: DVec3, v: DVec3, place: [[f64; 3]; 4]| {
        let mut m = Maker::default();
        let points = (0..12).map(|k| (u * f64::from(k % 4) + v * f64::from(k / 4)).to_array()).collect();
        let child = m.node("sheet", None, Kind::Surf { points, nu: 4, thick: 0.0, closed_u: false });
        m.node("", None, Kind::Placed { child, columns: place });
        let mesh = m.build().mesh;
        let mut sum = glam::Vec3::ZERO;
        for [a, b, c] in mesh.triangles() {
            let [a, b, c] = [a, b, c].map(|i| mesh.positions[i as usize]);
            sum += (b - a).cross(c - a);
        }
        let normal: glam::Vec3 = mesh.normals.iter().sum();
        assert!(sum.normalize().dot(normal.normalize()) > 0.999, "triangles and normals agree");
        sum.normalize()
    };
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let plain = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]];
    let mirrored = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]];
    for place in [plain, mirrored] {
        for (u, v, shown) in [(x, z, y), (z, x, y), (x, y, z), (y, x, z)] {
            assert!(sheet(u, v, place).as_dvec3().dot(shown) > 0.999, "{u} {v}");
        }
    }
}

#[test]
fn no_two_parts_with_faces_in_one_plane_stand_out_alike() {
    // Three that share planes, told in an order in which the last takes the first one's step when it is raised once.
    let pairs = [(0, 1), (0, 2), (1, 2), (2, 3)].into_iter().collect();
    let by = report::nudges(5, &pairs);
    assert!(pairs.iter().all(|(a, b)| (by[*a] - by[*b]).abs() > 1e-5), "{by:?}");
    assert_eq!((by[0], by[4]), (0.0, 0.0), "who shares with none before it stays");
    // Two boxes with their fronts in one plane.
    let mut m = Maker::default();
    let a = m.cube("rail", None, [1.0, 0.1, 0.1]);
    let b = m.cube("stile", None, [0.1, 1.0, 0.1]);
    m.group("", vec![a, b]);
    let shape = m.build();
    let fronts: Vec<f32> = shape.mesh.positions.iter().map(|p| p.z).filter(|z| *z > 0.04).collect();
    let (low, high) = fronts.iter().fold((f32::MAX, 0.0_f32), |(l, h), z| (l.min(*z), h.max(*z)));
    assert!((1e-5..5e-4).contains(&(high - low)), "{low} {high}");
}

#[test]
fn a_shape_of_thousands_of_charts_is_built() {
    // Each cube has six: copies share their places then.
    let mut m = Maker::default();
    let oak = m.material("oak");
    let cube = m.cube("cube", Some(oak), [0.01; 3]);
    let places = (0..900).map(|i| [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.02 * f64::from(i), 0.0, 0.0]]);
    let places = places.collect();
    m.node("row", None, Kind::Copies { child: cube, places });
    assert_eq!(m.build().mesh.triangle_count(), 900 * 12);
}

#[test]
fn charts_do_not_overlap_in_the_atlas() {
    let shape = table().build();
    let mut cells = vec![0_u32; 256 * 256];
    for (k, t) in shape.mesh.triangles().enumerate() {
        let [a, b, c] = t.map(|i| shape.mesh.uvs[i as usize].as_dvec2() * 256.0);
        let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
        for y in lo.y.floor() as usize..=(hi.y.ceil() as usize).min(255) {
            for x in lo.x.floor() as usize..=(hi.x.ceil() as usize).min(255) {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let sides = [(a, b), (b, c), (c, a)].map(|(p0, p1)| (p1 - p0).perp_dot(p - p0));
                let strictly = sides.iter().all(|s| *s > 1e-9) || sides.iter().all(|s| *s < -1e-9);
                let cell = &mut cells[y * 256 + x];
                assert!(!strictly || *cell == 0, "two triangles on one texel");
                if strictly {
                    *cell = k as u32 + 1;
                }
            }
        }
    }
}

#[test]
fn materials_are_inherited_and_paint_wins_on_its_side() {
    let mut m = Maker::default();
    let (red, blue) = (m.material("red"), m.material("blue"));
    let plain = m.cube("", None, [1.0; 3]);
    let painted = m.node("box", None, Kind::Paint { child: plain, face: Face::Front, with: blue });
    m.node("all", Some(red), Kind::Group { children: vec![painted] });
    let shape = m.build();
    assert_eq!(shape.slots, ["red", "blue"]);
    assert_eq!(shape.mesh.groups.iter().map(|g| g.triangles.len()).collect::<Vec<_>>(), [10, 2]);
    for i in shape.mesh.groups[1].triangles.iter().flatten() {
        assert!((shape.mesh.positions[*i as usize].z - 0.5).abs() < 1e-6);
    }
}

#[test]
fn things_stand_on_and_against_others() {
    let mut m = Maker::default();
    let floor = m.cube("floor", None, [2.0, 0.2, 2.0]);
    let item = m.cube("item", None, [0.2, 0.3, 0.2]);
    let on = m.node("", None, Kind::On { child: item, other: floor, u: 0.75, v: 0.25 });
    let beside = m.node("beside", None, Kind::Against { child: item, other: floor, side: Face::Right });
    m.group("", vec![floor, on, beside]);
    let shape = m.build();
    let part = |n: &str| shape.parts.iter().find(|p| p.name == n).unwrap();
    let item = part("item");
    let tree = |p: DVec3| p - shape.origin;
    assert!(tree(item.low).distance(DVec3::new(0.4, 0.2, -0.6)) < 1e-6, "{}", tree(item.low));
    assert!((tree(part("beside/item").low).x - 1.0).abs() < 1e-6);
}

#[test]
fn stacks_rise_and_scattered_things_keep_apart() {
    let mut m = Maker::default();
    let book = m.cube("book", None, [0.2, 0.03, 0.15]);
    m.node("stack", None, Kind::Stack { children: vec![book; 5], gap: 0.0, jitter: 0.0, seed: 1 });
    assert!((m.build().size().y - 0.15).abs() < 1e-6);
    let mut m = Maker::default();
    let floor = m.cube("floor", None, [1.0, 0.1, 1.0]);
    let ball = m.node("ball", None, Kind::Sphere { radii: [0.03; 3] });
    let balls = m.node("", None, Kind::Scatter { children: vec![ball], on: floor, count: 30, gap: 0.02, seed: 7 });
    m.group("", vec![floor, balls]);
    let a = m.tree.build(&BuildContext::default()).unwrap();
    let balls = a.parts.iter().find(|p| p.name == "ball").unwrap();
    assert_eq!(balls.instances, 30);
    assert!((balls.low.y - 0.1).abs() < 1e-4 && balls.gap == 0.0);
    let b = m.tree.build(&BuildContext::default()).unwrap();
    assert_eq!(a.mesh.positions, b.mesh.positions);
    assert_eq!(a.mesh.uvs, b.mesh.uvs);
}

#[test]
fn a_decal_lies_on_its_side_with_its_own_size() {
    let mut m = Maker::default();
    let (wall, print) = (m.material("wall"), m.material("print"));
    let child = m.cube("board", Some(wall), [1.0, 0.8, 0.1]);
    m.node("", None, Kind::Decal { child, face: Face::Front, with: print, at: [0.5, 0.75], size: [0.4, 0.2] });
    let shape = m.build();
    let print = &shape.mesh.groups[1];
    assert_eq!(print.triangles.len(), 2);
    for i in print.triangles.iter().flatten().map(|i| *i as usize) {
        let p = shape.mesh.positions[i].as_dvec3();
        assert!(p.z > 0.05 && p.z < 0.051);
        // (0, 0) at the top left, v downwards
        let uv = shape.mesh.metric_uvs[i].as_dvec2();
        assert!(uv.distance(DVec2::new(p.x + 0.2, 0.7 - p.y)) < 1e-3, "{uv} at {p}");
    }
}

#[test]
fn a_piece_of_the_photo_of_a_sides_size_lies_on_it_once() {
    let front = |size: [f64; 2]| {
        let mut m = Maker::default();
        let print = m.material("print");
        m.tree.materials[print as usize].photo = Some(PhotoMap { quad: [[0.0; 2]; 4], size, delit: true });
        m.cube("cushion", Some(print), [0.6, 0.4, 0.1]);
        let mesh = m.build().mesh;
        let on_front = |i: &usize| mesh.positions[*i].z > 0.049 && mesh.normals[*i].z > 0.9;
        let at = (0..mesh.positions.len()).filter(on_front).map(|i| (mesh.positions[i], mesh.metric_uvs[i]));
        at.map(|(p, uv)| (p.as_dvec3(), uv.as_dvec2() / DVec2::from_array(size))).collect::<Vec<_>>()
    };
    // From one border to the other: of the side's size, and of nearly that.
    for size in [[0.6, 0.4], [0.5, 0.45]] {
        for (p, uv) in front(size) {
            let whole = DVec2::new(p.x / 0.6 + 0.5, 1.0 - p.y / 0.4);
            assert!(uv.distance(whole) < 1e-5, "{uv} for {whole}");
        }
    }
    // Of a larger one the middle is shown; a smaller one is repeated at its own size.
    assert!(front([1.2, 0.8]).iter().all(|(_, uv)| (*uv - 0.5).abs().max_element() < 0.2501));
    let repeats = front([0.2, 0.2]).iter().map(|(_, uv)| uv.x).fold(0.0, f64::max);
    assert!((repeats - 3.0).abs() < 1e-5, "{repeats}");
}

#[test]
fn a_turned_wall_that_is_open_shows_its_outside_however_broad_its_foot_is() {
    // A table's edge: more of it faces down than outwards.
    let profile = vec![[0.44, 0.966], [0.496, 0.966], [0.5, 0.972], [0.5, 0.987], [0.498, 0.989]];
    let mut m = Maker::default();
    let turned = Kind::Lathe { profile, smooth_deg: 30.0, wall: 0.0, oval: 1.0, lobes: 0, lobe_depth: 0.0 };
    m.node("edge", None, turned);
    let mesh = m.build().mesh;
    let at = |v: u32| mesh.positions[v as usize].as_dvec3();
    let (mut out, mut down) = (0, 0);
    for [a, b, c] in mesh.triangles().map(|t| t.map(at)) {
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let middle = (a + b + c) / 3.0;
        assert!(normal.x * middle.x + normal.z * middle.z > -1e-3 && normal.y < 0.9, "{normal} at {middle}");
        out += usize::from(normal.y.abs() < 0.2);
        down += usize::from(normal.y < -0.9);
    }
    assert!(out > 0 && down > 0, "{out} {down}");
}

#[test]
fn booleans_shells_and_blends_work_in_trees() {
    let mut m = Maker::default();
    let a = m.cube("wall", None, [1.0, 1.0, 0.2]);
    let b = m.cube("", None, [0.4, 0.5, 1.0]);
    let b = m.at(b, [0.0, 0.25, 0.0]);
    m.node("", None, Kind::Boolean { op: Boolean::Cut, a, b });
    let shape = m.build();
    let piece = crate::Piece {
        positions: shape.mesh.positions.iter().map(|p| p.as_dvec3()).collect(),
        triangles: shape.mesh.triangles().collect(),
        ..crate::Piece::default()
    };
    assert!((piece.volume() - (0.2 - 0.4 * 0.5 * 0.2)).abs() < 1e-5);
    let mut m = Maker::default();
    let a =
        m.node("crate", None, Kind::Box { size: [0.4; 3], bevel: 0.01, segments: 4, taper: [1.0; 2], shear: [0.0; 2] });
    m.node("", None, Kind::Shell { child: a, wall: 0.02, open: Some(Face::Top) });
    // bottom and four sides leave the inside free
    assert_eq!(m.build().convex.len(), 5);
    let mut m = Maker::default();
    let ball = m.node("ball", None, Kind::Sphere { radii: [0.2; 3] });
    let curve = Curve { points: vec![[0.0, 0.2, 0.0], [0.5, 0.3, 0.0]], closed: false };
    let section = Section::Round(0.06);
    let kind = Kind::Sweep { curve, section, taper: 0.6, twist_deg: 0.0, rings: [0.0; 2], round_caps: true };
    let arm = m.node("arm", None, kind);
    m.node("", None, Kind::Blend { children: vec![ball, arm], radius: 0.08 });
    let size = m.build().size();
    assert!((size.y - 0.4).abs() < 0.02 && size.x > 0.7, "{size}");
}

#[test]
fn templates_and_part_models_come_with_their_looks() {
    let mut m = Maker::default();
    let kind = Kind::Template { template: "chair".into(), size: [0.5, 0.9, 0.5], params: serde_json::Value::Null };
    m.node("", None, kind);
    let shape = m.build();
    assert!(shape.size().distance(DVec3::new(0.5, 0.9, 0.5)) < 1e-3);
    assert!(!shape.slots.is_empty() && !shape.convex.is_empty());
    let bad = Kind::Template { template: "spaceship".into(), size: [1.0; 3], params: serde_json::Value::Null };
    let mut m = Maker::default();
    m.node("", None, bad);
    assert!(m.tree.build(&BuildContext::default()).unwrap_err().to_string().contains("line 1: there is no template"));
}

#[test]
fn what_is_wrong_is_told_with_its_line() {
    let fails = |m: &Maker| m.tree.build(&BuildContext::default()).unwrap_err();
    assert_eq!(fails(&Maker::default()), TreeError::Empty);
    let mut m = Maker::default();
    m.cube("", None, [1.0, f64::NAN, 1.0]);
    assert!(matches!(fails(&m), TreeError::Number { line: 1, .. }));
    let mut m = Maker::default();
    m.cube("", Some(3), [1.0; 3]);
    assert_eq!(fails(&m), TreeError::Material { material: 3, line: 1 });
    let mut m = Maker::default();
    m.group("", vec![NodeId(0)]);
    assert_eq!(fails(&m), TreeError::Order { node: 0, child: 0, line: 1 });
    // a cut of something open names the part
    let mut m = Maker::default();
    let curtain = Kind::Surf {
        points: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]],
        nu: 2,
        thick: 0.0,
        closed_u: false,
    };
    let a = m.node("curtain", None, curtain);
    let b = m.cube("", None, [1.0; 3]);
    m.node("", None, Kind::Boolean { op: Boolean::Cut, a, b });
    let e = fails(&m);
    assert_eq!(e.line(), 3);
    assert!(e.to_string().contains("curtain"), "{e}");
}

#[test]
fn bombs_are_refused_before_they_are_built() {
    let mut m = Maker::default();
    let mut child = m.cube("", None, [1.0; 3]);
    let places = vec![[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]]; 100];
    for _ in 0..6 {
        child = m.node("", None, Kind::Copies { child, places: places.clone() });
    }
    assert!(matches!(m.tree.check(), Err(TreeError::TooMany { count, .. }) if count >= 100_000));
    let mut m = Maker::default();
    let curve = Curve { points: (0..2000).map(|k| [f64::from(k) * 0.01, 0.0, 0.0]).collect(), closed: false };
    let kind = Kind::Sweep {
        curve,
        section: Section::Round(0.5),
        taper: 1.0,
        twist_deg: 0.0,
        rings: [0.0; 2],
        round_caps: false,
    };
    let pipe = m.node("pipe", None, kind);
    m.node("", None, Kind::Copies { child: pipe, places: places[..20].to_vec() });
    let e = m.tree.check().unwrap_err();
    assert!(e.to_string().contains(&MAX_TRIANGLES.to_string()) && e.line() == 1, "{e}");
}

#[test]
fn hovering_flickering_and_size_are_told() {
    let mut m = Maker::default();
    let a = m.cube("low", None, [1.0, 0.5, 1.0]);
    let b = m.cube("high", None, [0.2, 0.2, 0.2]);
    let b = m.at(b, [0.0, 0.6, 0.0]);
    let c = m.cube("skin", None, [0.5, 0.5, 1.0]);
    m.group("", vec![a, b, c]);
    let shape = m.build();
    let signs = lazy_signs(&shape, Some(DVec3::new(2.0, 0.8, 1.0))).join("; ");
    assert!(signs.contains("high (line 2) by 100 mm"), "{signs}");
    assert!(signs.contains("low and skin"), "{signs}");
    assert!(signs.contains("1.00 m wide, 2.00 m were wanted") && !signs.contains("deep"), "{signs}");
}

#[test]
fn fitting_stretches_a_little_and_scales_much() {
    let mut shape = table().build();
    let fit = shape.fit_to(DVec3::new(1.26, 0.74, 0.8));
    assert!(!fit.uniform && (shape.size() - DVec3::new(1.26, 0.74, 0.8)).length() < 1e-5);
    let fit = shape.fit_to(DVec3::new(2.52, 1.48, 1.6));
    assert!(fit.uniform && (fit.scale - DVec3::splat(2.0)).length() < 1e-5);
}

#[test]
fn a_hundred_nodes_take_little_time() {
    let mut m = Maker::default();
    let steel = m.material("steel");
    let mut all = Vec::new();
    for k in 0..100 {
        let kind = Kind::Box { size: [0.1, 0.2, 0.1], bevel: 0.004, segments: 2, taper: [1.0; 2], shear: [0.0; 2] };
        let b = m.node("bar", Some(steel), kind);
        all.push(m.at(b, [f64::from(k) * 0.1, 0.0, 0.0]));
    }
    m.group("", all);
    let start = std::time::Instant::now();
    m.build();
    // generous: shared machines and slow builds
    assert!(start.elapsed().as_secs_f64() < 2.0, "{:?}", start.elapsed());
}

#[test]
fn what_has_hairs_is_told_whatever_its_parts_are_called() {
    let mut m = Maker::default();
    let (fur, oak) = (m.material("fur"), m.material("oak"));
    let seat = m.cube("seat", Some(fur), [0.4, 0.1, 0.4]);
    let fuzz = FuzzKind::Fur;
    let seat = m.node("seat", Some(fur), Kind::Fuzz { child: seat, fuzz, length: 0.03, density: 0.2, seed: 1 });
    let legs = m.cube("hairs", Some(oak), [0.4, 0.1, 0.4]);
    let legs = m.at(legs, [0.0, -0.1, 0.0]);
    m.group("stools", vec![seat, legs]);
    let hairy: Vec<(String, bool)> =
        m.build().mesh.materials.iter().map(|material| (material.name.clone(), material.hairy)).collect();
    assert_eq!(hairy, [("fur".to_owned(), true), ("oak".to_owned(), false)]);
}
