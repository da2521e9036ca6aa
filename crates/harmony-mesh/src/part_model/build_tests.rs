use super::*;

/// Every edge is used once in each direction, and the volume is positive.
pub(crate) fn assert_closed(name: &str, solid: &Solid) {
    let mut edges: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for t in solid.triangles() {
        for k in 0..3 {
            *edges.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
        }
    }
    assert!(!edges.is_empty(), "{name} has no faces");
    for ((a, b), count) in &edges {
        assert_eq!(*count, 1, "{name}: edge {a}-{b} is used {count} times in one direction");
        let back = edges.get(&(*b, *a)).copied().unwrap_or(0);
        let p = solid.points[*a as usize];
        assert_eq!(back, 1, "{name}: edge {a}-{b} at {p} has {back} partners");
    }
    assert!(solid.volume() > 0.0, "{name}: volume {}", solid.volume());
}

fn one(part: &str) -> PartModel {
    PartModel::from_json(&format!(r##"{{"slots":[{{"name":"a","color":"#808080"}}],"parts":[{part}]}}"##)).unwrap()
}

const SHAPES: &[&str] = &[
    r#"{"shape":"box"}"#,
    r#"{"shape":"box","round":0.1}"#,
    r#"{"shape":"box","round":0.5}"#,
    r#"{"shape":"cylinder"}"#,
    r#"{"shape":"cylinder","axis":"x","top":0}"#,
    r#"{"shape":"cylinder","axis":"z","top":0.5,"oval":true,"round":0.2}"#,
    r#"{"shape":"cylinder","hollow":0.1,"top":0.6}"#,
    r#"{"shape":"cylinder","hollow":0.9,"top":0}"#,
    r#"{"shape":"cylinder","sides":4}"#,
    r#"{"shape":"cylinder","sides":6,"top":3}"#,
    r#"{"shape":"sphere"}"#,
    r#"{"shape":"slab"}"#,
    r#"{"shape":"slab","corner":0.5,"round":0.5}"#,
    r#"{"shape":"slab","corner":0,"round":0}"#,
    r#"{"shape":"slab","corner":0.3,"round":0}"#,
    r#"{"shape":"cushion","puff":0.2}"#,
    r#"{"shape":"cushion","puff":0.5}"#,
    r#"{"shape":"cushion","puff":1}"#,
    r#"{"shape":"back"}"#,
    r#"{"shape":"back","bend_deg":180,"round":0,"thickness":0.2}"#,
    r#"{"shape":"back","bend_deg":330,"axis":"x"}"#,
    r#"{"shape":"extrude","points":[[0,0],[1,0],[1,0.3],[0.3,0.3],[0.3,1],[0,1]]}"#,
    r#"{"shape":"extrude","axis":"x","points":[[0,0],[1,0],[1,0.3],[0.3,0.3],[0.3,1],[0,1]]}"#,
    r#"{"shape":"extrude","axis":"y","smooth":true,"points":[[0.5,0],[1,0.5],[0.5,1],[0,0.5]]}"#,
    r#"{"shape":"lathe","points":[[0.5,0],[1,0.3],[0.3,0.8],[0.4,1]]}"#,
    r#"{"shape":"lathe","points":[[0.5,0],[1,0.3],[0.3,0.8],[0.4,1]],"hollow":0.08}"#,
    r#"{"shape":"lathe","points":[[0,0],[1,1]],"smooth":false,"hollow":0.1}"#,
    r#"{"shape":"tube","path":[[0,0,0],[0,1,0],[1,1,1],[1,0,1]]}"#,
    r#"{"shape":"tube","path":[[0,0,0],[0,0,1],[1,0,1],[1,1,0]],"closed":true,"smooth":true}"#,
    r#"{"shape":"leaves"}"#,
    r#"{"shape":"leaves","habit":"palm"}"#,
    r#"{"shape":"leaves","habit":"upright","seed":4}"#,
    r#"{"shape":"leaves","habit":"trailing"}"#,
    r#"{"shape":"leaves","habit":"flowers"}"#,
    r#"{"shape":"cloth","folds":5}"#,
];

#[test]
fn every_shape_is_closed_wound_outwards_and_fills_the_size_asked() {
    for json in SHAPES {
        let model = one(json);
        for size in [[1.0, 1.0, 1.0], [2.0, 0.3, 0.7], [0.02, 1.8, 0.4], [0.6, 0.5, 0.004]] {
            let size = DVec3::from_array(size);
            for (_, solid) in solids(&model, size).unwrap() {
                let blades = json.contains("leaves");
                if blades {
                    // blades may touch each other; each is checked by its own volume
                    assert!(solid.volume() > 0.0, "{json}");
                } else {
                    assert_closed(&format!("{json} {size}"), &solid);
                }
            }
            let built = model.build(Size::from_vec(size)).unwrap();
            built.mesh.check().unwrap();
            let bounds = built.mesh.bounds().unwrap();
            assert!(
                (bounds.size() - size).abs().max_element() <= 1e-5 * size.max_element(),
                "{json} {size}: {bounds:?}"
            );
            assert!(bounds.min.y.abs() <= 1e-6 && bounds.centre().x.abs() <= 1e-5 && bounds.centre().z.abs() <= 1e-5);
        }
    }
}

#[test]
fn foliage_is_closed_blade_by_blade() {
    for habit in ["bushy", "palm", "upright", "trailing", "flowers"] {
        let model = one(&format!(r#"{{"shape":"leaves","habit":"{habit}"}}"#));
        for (_, solid) in solids(&model, DVec3::new(0.6, 0.9, 0.5)).unwrap() {
            let mut edges: BTreeMap<(u32, u32), i32> = BTreeMap::new();
            for t in solid.triangles() {
                for k in 0..3 {
                    let (a, b) = (t[k], t[(k + 1) % 3]);
                    *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
                }
            }
            assert!(edges.values().all(|n| *n == 0), "{habit}");
        }
    }
}

#[test]
fn normals_point_out_of_the_faces_they_belong_to() {
    for json in SHAPES {
        let mesh = one(json).build(Size { width: 0.8, height: 0.9, depth: 0.7 }).unwrap().mesh;
        let (mut agree, mut all) = (0, 0);
        for t in mesh.triangles() {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            let face = (b - a).cross(c - a);
            for i in t {
                let n = mesh.normals[i as usize];
                assert!((n.length() - 1.0).abs() < 1e-3, "{json}: normal {n}");
                all += 1;
                agree += usize::from(n.dot(face) > 0.0);
            }
        }
        assert!(agree * 100 >= all * 98, "{json}: {agree} of {all} corner normals on the outer side");
    }
}

#[test]
fn texture_triangles_of_a_model_do_not_overlap() {
    let mesh = PartModel::example().build(Size { width: 0.45, height: 0.9, depth: 0.5 }).unwrap().mesh;
    let n = 1024_usize;
    let mut owner = vec![u32::MAX; n * n];
    let (mut hit, mut texels) = (0, 0);
    for (id, t) in mesh.triangles().enumerate() {
        let [a, b, c] = t.map(|i| mesh.uvs[i as usize] * n as f32);
        let area = (b - a).perp_dot(c - a);
        let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
        for y in lo.y as usize..=(hi.y as usize).min(n - 1) {
            for x in lo.x as usize..=(hi.x as usize).min(n - 1) {
                let p = glam::Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let w = [(b - a).perp_dot(p - a), (c - b).perp_dot(p - b), (a - c).perp_dot(p - c)];
                if w.iter().all(|w| w * area.signum() > 1e-3) {
                    texels += 1;
                    hit += usize::from(owner[y * n + x] != u32::MAX);
                    owner[y * n + x] = id as u32;
                }
            }
        }
    }
    assert_eq!(hit, 0, "of {texels} texels");
    assert!(texels > n * n / 4, "{texels} texels used");
}

#[test]
fn legs_keep_a_square_section_and_their_place_at_any_size() {
    let model = one(r#"{"shape":"box","from":[0,0,0],"to":[0.1,1,0.1],"mirror":"xz","square":"y"}"#);
    for (w, d) in [(1.0, 1.0), (2.0, 0.8), (0.5, 1.5)] {
        let list = solids(&model, DVec3::new(w, 0.7, d)).unwrap();
        assert_eq!(list.len(), 4);
        let mut centres = Vec::new();
        for (_, s) in &list {
            let lo = s.points.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
            let hi = s.points.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
            let e = hi - lo;
            assert!((e.x - e.z).abs() <= 1e-9 && (e.x - 0.1 * w.min(d)).abs() <= 1e-9, "{e}");
            centres.push(((lo + hi) / 2.0).x);
        }
        let reach = centres.iter().copied().fold(0.0, f64::max);
        assert!((reach - (w / 2.0 - 0.05 * w.min(d))).abs() <= 1e-9, "legs stand at the sides: {reach}");
    }
}

#[test]
fn convex_pieces_lie_in_the_object_and_a_bent_back_leaves_its_hollow_free() {
    for json in SHAPES {
        let size = DVec3::new(0.8, 0.9, 0.7);
        let built = one(json).build(Size::from_vec(size)).unwrap();
        assert!(!built.convex.is_empty(), "{json}");
        for part in &built.convex {
            assert!((4..=crate::MAX_HULL_POINTS).contains(&part.points.len()), "{json}: {}", part.points.len());
            for p in &part.points {
                let p = p.as_dvec3();
                assert!(p.x.abs() <= 0.41 && p.z.abs() <= 0.36 && (-0.01..=0.91).contains(&p.y), "{json}: {p}");
            }
        }
    }
    let tub = one(r#"{"shape":"back","bend_deg":180,"thickness":0.1}"#)
        .build(Size { width: 0.8, height: 0.4, depth: 0.6 })
        .unwrap();
    assert!(tub.convex.len() >= 4);
    for part in &tub.convex {
        // no piece reaches the middle of the hollow
        let hull: Vec<_> = part.points.iter().map(|p| glam::Vec2::new(p.x, p.z)).collect();
        let direction =
            hull.iter().fold(glam::Vec2::ZERO, |a, p| a + *p) / hull.len() as f32 - glam::Vec2::new(0.0, 0.1);
        let near = hull.iter().map(|p| (*p - glam::Vec2::new(0.0, 0.1)).dot(direction.normalize())).fold(9.0, f32::min);
        assert!(near > 0.1, "a piece comes within {near} m of the middle");
    }
}
