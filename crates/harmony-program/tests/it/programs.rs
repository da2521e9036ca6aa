//! Five programs of the kinds that models write, and what their trees must be.

use harmony_program::{Inputs, Limits, Surface, evaluate, run};
use harmony_scene::{Size, Vec2, Vec3};
use harmony_shape::{Kind, ShapeTree};

use super::{ROOM, camera, child, leaf, named, root, sound};

const BED: &str = include_str!("../../programs/bed.star");
const LIGHTS: &str = include_str!("../../programs/string_lights.star");
const SHELF: &str = include_str!("../../programs/acrylic_shelf.star");
const LAMP: &str = include_str!("../../programs/reading_lamp.star");
const CEILING: &str = include_str!("../../programs/corrugated_ceiling.star");

fn all() -> [(&'static str, Inputs); 5] {
    let bed = Inputs::object(Size { width: 1.8, height: 1.3, depth: 2.2 });
    let ceiling = Inputs::feature(ROOM, Some(camera())).in_frame(Surface::Ceiling);
    [
        (BED, bed),
        (LIGHTS, Inputs::feature(ROOM, Some(camera()))),
        (SHELF, Inputs::default().with("n", 4)),
        (LAMP, Inputs::default()),
        (CEILING, ceiling),
    ]
}

fn built(index: usize) -> ShapeTree {
    let (source, inputs) = &all()[index];
    let tree = evaluate(source, inputs, &Limits::default()).unwrap_or_else(|e| panic!("{}", e.explain(source)));
    sound(&tree);
    tree
}

#[test]
fn the_bed_has_its_cloth_in_layers_and_four_legs() {
    let tree = built(0);
    assert_eq!(root(&tree).name.as_deref(), Some("bed"));
    let Kind::Copies { places, .. } = &named(&tree, "legs").kind else { panic!("legs are copies") };
    let mut feet: Vec<[f64; 2]> = places.iter().map(|p| [p[0][0], p[2][2]]).collect();
    feet.sort_by(|a, b| a.partial_cmp(b).unwrap());
    assert_eq!(feet, [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]], "mirrored in x and z");
    let Kind::Drape { over, size, .. } = &named(&tree, "throw").kind else { panic!("the throw is draped") };
    assert_eq!(over.len(), 7, "frame, mattress, four pillows, duvet");
    assert!((size[0] - 2.2).abs() <= 1e-12, "w + 0.4 of the given width");
    assert!(matches!(named(&tree, "tassels").kind, Kind::Fringe { .. }));
    assert!(matches!(leaf(&tree, named(&tree, "headboard")).kind, Kind::Tuft { rows: 4, cols: 9, .. }));
    let names: Vec<&str> = tree.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names.len(), 4, "{names:?}");
}

#[test]
fn cords_hang_from_where_the_photo_shows_their_hooks() {
    let tree = built(1);
    let Kind::Sweep { curve, .. } = &named(&tree, "cord").kind else { panic!("a cord is swept") };
    let camera = camera();
    let wanted = [Vec2::new(180.0, 300.0), Vec2::new(840.0, 250.0)];
    for (p, wanted) in [curve.points.first(), curve.points.last()].into_iter().zip(wanted) {
        let point = Vec3::from(*p.unwrap());
        let seen = camera.project(point).unwrap() / Vec2::new(1.2, 0.9);
        assert!((seen - wanted).length() <= 1e-6, "{seen}");
    }
    // 3 cm in front of the left wall.
    assert!((curve.points[0][0] - 0.03).abs() <= 1e-9);
    let Kind::Copies { places, .. } = &named(&tree, "bulbs").kind else { panic!("bulbs are copies") };
    assert!(places.len() >= 8, "{}", places.len());
    assert!(places.iter().all(|p| (p[1][1] - 1.0).abs() <= 1e-12), "they hang upright");
}

#[test]
fn the_shelf_takes_its_parameter_and_stands() {
    let tree = built(2);
    let Kind::Group { children } = &named(&tree, "cubes").kind else { panic!("a list is a group") };
    assert_eq!(children.len(), 4);
    let each = (1.3 - 3.0 * 0.008) / 4.0;
    let Kind::Extrude { outline, .. } = &leaf(&tree, &tree.nodes[children[0].0 as usize]).kind else { panic!() };
    let low = outline.points.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    let high = outline.points.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
    assert!(low.abs() <= 1e-6 && (high - each).abs() <= 1e-6, "{low} {high}");
    assert_eq!(outline.holes.len(), 1);
    let surfaces = tree.nodes.iter().filter(|n| matches!(n.kind, Kind::Surface { .. })).count();
    assert_eq!(surfaces, 4);
}

#[test]
fn the_lamps_head_sits_on_the_tip_of_its_neck() {
    let tree = built(3);
    let Kind::Sweep { curve, rings, .. } = &named(&tree, "neck").kind else { panic!() };
    assert_eq!(*rings, [0.0035, 0.001]);
    let joint = tree.nodes.iter().find(|n| matches!(n.kind, Kind::Joint { .. })).unwrap();
    assert_eq!(joint.name.as_deref(), Some("head"));
    let Kind::Joint { pivot, child, .. } = &joint.kind else { panic!() };
    let tip = Vec3::from(*curve.points.last().unwrap());
    assert!((Vec3::from(*pivot) - tip).length() <= 1e-9);
    assert!((tip - Vec3::new(0.0, 0.46 * 0.86, 0.2)).length() <= 1e-9);
    let Kind::Placed { columns, .. } = &tree.nodes[child.0 as usize].kind else { panic!() };
    let last = curve.points.len() - 1;
    let along = (tip - Vec3::from(curve.points[last - 1])).normalize();
    // A tree's points are rounded to the nanometre, and the neck's last two are 4 mm apart.
    assert!((Vec3::from(columns[1]) - along).length() <= 1e-6, "its y looks along the neck: {columns:?}, {along}");
}

#[test]
fn the_ceilings_sheet_covers_the_ceiling() {
    let tree = built(4);
    let Kind::Placed { columns, child } = &named(&tree, "sheet").kind else { panic!() };
    let Kind::BentSheet { profile, width, .. } = &tree.nodes[child.0 as usize].kind else { panic!() };
    assert_eq!(*width, ROOM.width);
    // The sheet's own points are (x, y, z) with (z, y) the profile; its corners in (u, v, out):
    let at = |x: f64, p: &[f64; 2]| {
        let [a, b, c, o] = columns.map(Vec3::from);
        a * x + b * p[1] + c * p[0] + o
    };
    let (first, last) = (at(-2.0, &profile[0]), at(2.0, profile.last().unwrap()));
    assert!((first.truncate() - Vec2::ZERO).length() <= 1e-9, "{first}");
    assert!((last.truncate() - Vec2::new(4.0, 4.5)).length() <= 1e-9, "{last}");
    assert!(
        profile.iter().all(|p| {
            let z = at(0.0, p).z;
            (-1e-9..=0.034 + 1e-9).contains(&z)
        }),
        "below the ceiling"
    );
}

#[test]
fn the_cage_gives_the_same_bytes_as_this_process_every_time() {
    for (source, inputs) in all() {
        let here = serde_json::to_vec(&evaluate(source, &inputs, &Limits::default()).unwrap()).unwrap();
        let again = serde_json::to_vec(&evaluate(source, &inputs, &Limits::default()).unwrap()).unwrap();
        let there = serde_json::to_vec(&run(source, &inputs, &Limits::default(), &child()).unwrap()).unwrap();
        assert!(here == again && here == there);
    }
}
