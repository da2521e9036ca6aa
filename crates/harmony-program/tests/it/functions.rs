//! What single functions make.

use harmony_program::signatures;
use harmony_scene::Vec3;
use harmony_shape::tree::Along;
use harmony_shape::{Kind, Node, ShapeTree};

use super::{returning, root, sound, tree};

fn placed(tree: &ShapeTree, node: &Node) -> [Vec3; 4] {
    let Kind::Placed { columns, .. } = &node.kind else { panic!("{node:?} of {}", tree.nodes.len()) };
    columns.map(Vec3::from)
}

fn close(a: Vec3, b: [f64; 3]) {
    assert!((a - Vec3::from(b)).length() <= 1e-9, "{a} {b:?}");
}

/// What a program computes, read off the size of a box: (x, y, z).
fn computed(statements: &str, expression: &str) -> [f64; 3] {
    let body: Vec<String> = statements.lines().map(|l| format!("    {l}\n")).collect();
    let body = body.concat();
    let source =
        format!("def build(w, h, d):\n{body}    v = {expression}\n    return box((1, 1, 1)).at(v[0], v[1], v[2])\n");
    let t = tree(&source);
    placed(&t, root(&t))[3].to_array()
}

#[test]
fn moves_are_one_placement_in_the_order_they_are_written() {
    let t = tree(&returning("box((1, 1, 1)).at(1, 0, 0).turn(y = 90).at(0, 2, 0).scale(2)"));
    assert_eq!(t.nodes.len(), 2);
    // (1, 0, 0) turned by 90 about y is (0, 0, -1), moved to (0, 2, -1), scaled to (0, 4, -2).
    let [x, _, z, at] = placed(&t, root(&t));
    close(at, [0.0, 4.0, -2.0]);
    close(x, [0.0, 0.0, -2.0]);
    close(z, [2.0, 0.0, 0.0]);
}

#[test]
fn vectors_are_counted_with() {
    assert_eq!(computed("", "vec(1, 2, 3) + (1, 0, 0)"), [2.0, 2.0, 3.0]);
    assert_eq!(computed("", "(1, 0, 0) + vec(1, 2, 3) * 2"), [3.0, 4.0, 6.0]);
    assert_eq!(computed("", "2 * vec(1, 2, 3) - vec(1, 1, 1) / 2"), [1.5, 3.5, 5.5]);
    assert_eq!(computed("", "-vec(1, 0, 0).cross((0, 1, 0))"), [0.0, 0.0, -1.0]);
    assert_eq!(
        computed("x, y, z = vec(3, 4, 0)", "(x, vec(3, 4, 0).len, vec(3, 4, 0).dot((1, 1, 1)))"),
        [3.0, 5.0, 7.0]
    );
    assert_eq!(computed("", "lerp((0, 0, 0), (2, 4, 6), 0.5)"), [1.0, 2.0, 3.0]);
    assert_eq!(computed("", "sum([(1, 2, 3), vec(1, 1, 1)])"), [2.0, 3.0, 4.0]);
    assert_eq!(computed("", "(sum([1, 2.5]), round(2.6), round(1.23456, 2))"), [3.5, 3.0, 1.23]);
    assert_eq!(computed("s = seq(0, 1, 0.25)", "(len(s), s[-1], math.floor(-0.5))"), [4.0, 0.75, -1.0]);
    assert_eq!(computed("", "(math.degrees(math.pi) / 2, math.pow(2, 10) / 1024, math.hypot(3, 4))"), [90.0, 1.0, 5.0]);
}

#[test]
fn a_pattern_is_shifted_to_the_right_and_up_whatever_its_turn() {
    let offset = |turn: u32| {
        let map = format!("stripes(0.1, turn = {turn}, at = (0.03, 0.02))");
        let t = tree(&returning(&format!("box((1, 1, 1), mat = mat(\"m\", map = {map}))")));
        t.materials.iter().find_map(|m| m.map.as_ref()).unwrap().offset
    };
    // Its v is down; turned by 90 its u is down and its v to the left.
    for (turn, wanted) in [(0, [0.03, -0.02]), (90, [-0.02, -0.03]), (180, [-0.03, 0.02])] {
        let found = offset(turn);
        assert!(found.iter().zip(wanted).all(|(f, w)| (f - w).abs() < 1e-12), "{turn}: {found:?}");
    }
}

#[test]
fn curves_are_measured() {
    assert_eq!(
        computed("c = line([(0, 0, 0), (3, 0, 0), (3, 4, 0)])", "(c.len, c.at(1).y, c.at(3 / 7).x)"),
        [7.0, 4.0, 3.0]
    );
    assert_eq!(computed("c = line([(0, 0, 0), (3, 0, 0)])", "c.tangent(0.5)"), [1.0, 0.0, 0.0]);
    assert_eq!(
        computed("c = line([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)], closed = True)", "(c.len, 0, 0)"),
        [4.0, 0.0, 0.0]
    );
}

#[test]
fn sizes_of_parts_are_known_where_they_can_be() {
    assert_eq!(computed("b = box((2, 3, 4)).at(0, 1, 0)", "(b.size.x, b.top, b.min.y)"), [2.0, 4.0, 1.0]);
    assert_eq!(computed("b = row(sphere(0.5), 3, step = 2)", "b.size"), [5.0, 1.0, 1.0]);
    assert_eq!(computed("b = cushion((1, 0.2, 1)).on(box((2, 1, 2)))", "(b.top, 0, 0)"), [1.2, 0.0, 0.0]);
    assert_eq!(computed("b = stack([box((1, 1, 1)), box((2, 1, 1))])", "b.size"), [2.0, 2.0, 1.0]);
}

#[test]
fn copies_stand_where_they_should() {
    let places = |expression: &str| -> Vec<Vec3> {
        let t = tree(&returning(expression));
        let Kind::Copies { places, .. } = &root(&t).kind else { panic!("{:?}", root(&t)) };
        places.iter().map(|p| Vec3::from(p[3])).collect()
    };
    assert_eq!(places("row(box((1, 1, 1)), 3)"), [Vec3::ZERO, Vec3::X, Vec3::X * 2.0]);
    assert_eq!(places("row(box((1, 1, 1)), 3, to = (0, 4, 0))")[1], Vec3::Y * 2.0);
    let grid = places("grid(box((1, 1, 1)), (2, 2, 1), (4, 3, 0))");
    assert_eq!(
        grid,
        [Vec3::new(-2.0, 0.0, 0.0), Vec3::new(2.0, 0.0, 0.0), Vec3::new(-2.0, 3.0, 0.0), Vec3::new(2.0, 3.0, 0.0)]
    );
    let ring = places("ring(box((1, 1, 1)), 4, 2)");
    close(ring[1], [2.0, 0.0, 0.0]);
    close(ring[2], [0.0, 0.0, -2.0]);
    let along = places("along(line([(0, 0, 0), (1, 0, 0)]), sphere(0.1), n = 3)");
    assert_eq!(along, [Vec3::ZERO, Vec3::X * 0.5, Vec3::X]);
    assert_eq!(places("along(line([(0, 0, 0), (1, 0, 0)]), sphere(0.1), spacing = 0.3)").len(), 4);
    assert_eq!(places("mirror(box((1, 1, 1)), 'x', about = (1, 0, 0))")[1], Vec3::X * 2.0);
}

#[test]
fn a_function_of_the_program_makes_a_surface() {
    let t = tree(&returning("surf(lambda u, v: (u * 2, v, 0), nu = 3, nv = 2)"));
    let Kind::Surf { points, nu, .. } = &root(&t).kind else { panic!() };
    assert_eq!(*nu, 3);
    assert_eq!(
        points[..],
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [2.0, 1.0, 0.0]]
    );
    let t = tree(&returning("surf(lambda u, v: (u, v, 0), nu = 4, nv = 2, closed_u = True)"));
    let Kind::Surf { points, .. } = &root(&t).kind else { panic!() };
    assert_eq!(points[3][0], 0.75, "a closed row does not repeat its start");
}

#[test]
fn names_come_from_groups_and_a_part_in_two_groups_keeps_the_first() {
    let t = tree(
        "def build():\n    a = box((1, 1, 1))\n    b = group('left', foot = a)\n    return group('all', one = b, other = group('right', leg = a))\n",
    );
    let names: Vec<_> = t.nodes.iter().map(|n| n.name.as_deref().unwrap_or("-")).collect();
    assert_eq!(names, ["foot", "left", "leg", "right", "one", "other", "all"]);
    let lines: Vec<u32> = t.nodes.iter().map(|n| n.line).collect();
    assert_eq!(lines, [2, 3, 4, 4, 4, 4, 4]);
}

#[test]
fn what_is_made_and_not_used_is_not_in_the_tree() {
    let t = tree(
        "def build():\n    red = mat('red', '#f00')\n    x = sphere(1, mat = red)\n    blue = mat('blue', (0, 0, 255))\n    return box((1, 1, 1), mat = blue)\n",
    );
    assert_eq!(t.nodes.len(), 1);
    assert_eq!(t.materials.len(), 1);
    assert_eq!((t.materials[0].name.as_str(), t.materials[0].color.as_str()), ("blue", "#0000ff"));
    assert_eq!(root(&t).material, Some(0));
}

#[test]
fn a_hem_goes_to_a_fringe_and_materials_of_all_kinds_are_taken() {
    let t = tree(
        "def build():\n    c = hang(1, 2)\n    f = fringe(c.hem('foot'), 'pompom')\n    b = box((1, 1, 1), mat = checks(0.1, colors = ['#fff', '#000']))\n    p = decal(b, 'front', photo([100, 100, 300, 300], (0.4, 0.3)))\n    return group('x', c = c, f = f, p = p.paint('top', '#123456'))\n",
    );
    sound(&t);
    let hem = t.nodes.iter().find_map(|n| match &n.kind {
        Kind::Fringe { along: Along::Hem { of, side }, .. } => Some((*of, side.clone())),
        _ => None,
    });
    let (of, side) = hem.unwrap();
    assert!(matches!(t.nodes[of.0 as usize].kind, Kind::Hang { .. }));
    assert_eq!(side, "foot");
    assert_eq!(t.materials.len(), 3);
    let Kind::Decal { size, .. } = t.nodes.iter().map(|n| &n.kind).find(|k| matches!(k, Kind::Decal { .. })).unwrap()
    else {
        panic!()
    };
    assert_eq!(*size, [0.4, 0.3], "as large as the piece");
}

#[test]
fn every_function_can_be_called_as_the_guide_shows_it() {
    let calls = [
        "lathe([(0, 0), (1, 0), (1, 1)], lobes = (5, 0.1))",
        "extrude(heart(0.3), 0.02, bevel = 0.002)",
        "extrude(text('Hi!', 0.1), 0.01)",
        "extrude(ngon(5, 0.1, star = 0.05).plus(circle(0.05)), 0.01, axis = 'y')",
        "extrude(polygon([(0, 0), (1, 0), (0, 1)], smooth = True).offset(0.02).minus(rect(0.1, 0.1)), 0.1)",
        "sweep(helix(0.1, 0.02, 5), 0.004)",
        "sweep(arc((0, 0, 0), 1, 0, 180, 'z'), rect(0.02, 0.05), caps = 'flat')",
        "loft([(circle(0.1), 0), (rect(0.2, 0.2), 0.3), (circle(0.05), (0, 0.5, 0), (0, 0, 10))])",
        "bent_sheet([(0, 0), (0.1, 0.05), (0.2, 0)], 1)",
        "mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])",
        "blend([sphere(0.1), sphere(0.1).at(0.1, 0, 0)], 0.03)",
        "cut(box((1, 1, 1)), sphere(0.3))",
        "join(box((1, 1, 1)), sphere(0.3))",
        "common(box((1, 1, 1)), sphere(0.3))",
        "shell(box((1, 1, 1)), 0.02)",
        "pillow(0.5, 0.5, 0.15)",
        "quilt(cushion((1, 0.2, 1)), 0.1)",
        "slump(sphere(0.5), 0.4)",
        "slump(sphere(0.5), 0.4, onto = box((1, 1, 1)))",
        "roll(0.4, 0.06)",
        "folded(0.4, 0.3)",
        "fringe(line([(0, 1, 0), (1, 1, 0)]))",
        "fuzz(box((1, 0.02, 1)), kind = 'fur')",
        "braid(line([(0, 0, 0), (0, 1, 0)]), 0.02)",
        "wicker(cylinder(0.2, 0.3))",
        "mesh_wire(circle(0.3))",
        "leaf(0.1, 0.04)",
        "plant('fern', 0.5, 0.6, leaf = leaf(0.1, 0.02), flower = '#ff0000')",
        "scatter([sphere(0.02)], box((1, 1, 1)), 10)",
        "jitter(row(box((0.1, 0.1, 0.1)), 4), move = 0.01, turn = 5)",
        "books(12, lean = 8)",
        "joint(box((1, 1, 1)), 'slide', axis = 'z', range = (0, 0.4))",
        "light('area', 500)",
        "surface('top', (1, 1), at = (0, 1, 0))",
        "template('armchair', legs = 'turned')",
        "framed(1, 2, panes = (2, 3), fill = '#ffffff')",
        "box((1, 1, 1), mat = mat('a', map = over(grime(0.2), planks(), mask = 0.3), emit = 3))",
        "box((1, 1, 1), mat = tint(motif(heart(0.1), 0.2), '#ff8080'))",
        "box((1, 1, 1), mat = ramp('#fff', '#000'))",
        "sphere((0.1, 0.2, 0.3)).aim('y', (1, 0, 0)).against(box((1, 1, 1)), 'left')",
        "box((noise((1, 2, 3.5)) + 2, clamp(3), rng(4).int(1, 2)))",
        "box((rng(1).uniform(1, 2), abs(rng(1).normal(0, 0.1)) + 1, rng(2).pick([1, 2])))",
        "sweep(catenary((0, 1, 0), (1, 1, 0), sag = 0.2).offset(0.1).move(0, 1, 0).reversed(), 0.01)",
    ];
    for call in calls {
        sound(&tree(&returning(call)));
    }
    let patterns: Vec<&str> = signatures().filter(|s| s.contains("colors=None") && !s.starts_with("motif")).collect();
    assert_eq!(patterns.len(), 22);
    for pattern in patterns {
        let name = pattern.split('(').next().unwrap();
        let t = tree(&returning(&format!("box((1, 1, 1), mat = mat('a', map = {name}()))")));
        assert_eq!(t.materials[0].map.as_ref().unwrap().colors.len(), 0);
    }
}

#[test]
fn materials_that_were_named_alike_or_not_at_all_are_told_apart() {
    let t = tree(
        "def build():\n    b = box((1, 1, 1), mat = mat(name = 'oak', color = '#aa7744'))\n    b = decal(b, 'front', photo([100, 100, 300, 300], (0.4, 0.3)))\n    b = decal(b, 'left', photo([500, 100, 700, 300], (0.4, 0.3)))\n    c = box((2, 1, 1), mat = mat(name = 'oak', color = '#332211'))\n    d = box((3, 1, 1), mat = mat(name = 'oak', color = '#aa7744'))\n    return group('x', b = b, c = c, d = d)\n",
    );
    let names: Vec<&str> = t.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names.len(), 4, "the same oak is one material: {names:?}");
    assert_eq!(names.iter().collect::<std::collections::BTreeSet<_>>().len(), 4, "{names:?}");
    let pieces: Vec<_> = t.materials.iter().filter_map(|m| m.photo.as_ref().map(|p| p.quad[0])).collect();
    assert_eq!(pieces, [[100.0, 100.0], [500.0, 100.0]]);
}
