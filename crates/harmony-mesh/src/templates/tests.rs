use std::collections::BTreeMap;

use harmony_catalogue::{kind, kinds};
use proptest::prelude::*;

use super::*;

fn params(bits: u64) -> TemplateParams {
    let pick = |k: u32, n: u64| (bits >> k) % n;
    let some = |k: u32| (bits >> k) & 1 == 1;
    let word = |k: u32, words: &[&str]| words[(pick(k, words.len() as u64)) as usize].to_owned();
    let value = serde_json::json!({
        "seats": if some(1) { Some(pick(2, 9)) } else { None },
        "legs": if some(3) { Some(word(4, LegStyle::WORDS)) } else { None },
        "arms": if some(7) { Some(word(8, ArmStyle::WORDS)) } else { None },
        "back": if some(11) { Some(word(12, BackStyle::WORDS)) } else { None },
        "doors": if some(15) { Some(pick(16, 12)) } else { None },
        "drawers": if some(19) { Some(pick(20, 12)) } else { None },
        "shelves": if some(23) { Some(pick(24, 12)) } else { None },
        "panes": if some(27) { Some([pick(28, 9), pick(31, 9)]) } else { None },
        "shade": if some(34) { Some(word(35, ShadeShape::WORDS)) } else { None },
        "habit": if some(38) { Some(word(39, PlantHabit::WORDS)) } else { None },
        "cushions": if some(42) { Some(pick(43, 14)) } else { None },
        "round": if some(47) { Some(some(48)) } else { None },
        "filled": if some(49) { Some(some(50)) } else { None },
        "extra": if some(51) { Some(some(52)) } else { None },
    });
    let (params, notes) = TemplateParams::from_value(&value);
    assert!(notes.is_empty(), "{notes:?}");
    params
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_template_builds_a_closed_mesh_of_the_size_asked(
        which in 0..kinds().len(), bits in any::<u64>(), t in prop::array::uniform3(0.0..1.0_f64),
    ) {
        let c = &kinds()[which];
        let sides = c.sides();
        let side = |k: usize| sides[k].low * (sides[k].high / sides[k].low).powf(t[k]);
        let size = Size { width: side(0), height: side(1), depth: side(2) };
        let model = template(&c.name, &params(bits), size);
        let built = model.build(size);
        prop_assert!(built.is_ok(), "{} {size:?}: {}", c.name, built.unwrap_err());
        let built = built.unwrap();
        built.mesh.check().unwrap();
        let bounds = built.mesh.bounds().unwrap();
        let off = (bounds.size() - size.as_vec()).abs().max_element();
        prop_assert!(off <= 1e-5 * size.as_vec().max_element(), "{}: {off}", c.name);
        let n = built.mesh.triangle_count();
        prop_assert!(n <= 16_000, "{}: {n} triangles", c.name);
        for (slot, solid) in crate::part_model::solids_for_tests(&model, size.as_vec()) {
            let mut edges: BTreeMap<(u32, u32), i32> = BTreeMap::new();
            for tri in solid.triangles() {
                for k in 0..3 {
                    let (a, b) = (tri[k], tri[(k + 1) % 3]);
                    *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
                }
            }
            prop_assert!(edges.values().all(|n| *n == 0), "{} {slot} is open", c.name);
            prop_assert!(solid.volume() > 0.0, "{} {slot} is inside out: {}", c.name, solid.volume());
        }
    }

    #[test]
    fn hostile_part_models_never_panic(text in "\\PC{0,200}", noise in prop::collection::vec(-1e6..1e6_f64, 12)) {
        let _ = PartModel::from_json(&text);
        let json = serde_json::json!({"parts": [
            {"shape": "lathe", "points": [[noise[0], noise[1]], [noise[2], noise[3]], [noise[4], 0.5]], "hollow": noise[5]},
            {"shape": "tube", "path": [[noise[6], 0.0, 1.0], [0.0, noise[7], 0.0], [0.0, noise[7], 0.0]], "thickness": noise[8]},
            {"shape": "back", "bend_deg": noise[9] / 1e4, "from": [0, 0, 0], "to": [1, noise[10] / 1e5, 1]},
            {"shape": "extrude", "points": [[noise[0], 0], [1, noise[1]], [0.2, 0.9], [noise[11], 0.4]]},
        ]});
        if let Ok(model) = PartModel::from_value(&json) {
            let _ = model.build(Size { width: 1.0, height: 0.5, depth: 2.0 });
        }
        let (_, notes) = TemplateParams::from_value(&serde_json::json!({"seats": noise[0], "legs": text, "panes": text}));
        let _ = notes;
    }
}

#[test]
fn labels_find_their_template() {
    let cases = [
        ("leather couch", "sofa"),
        ("TV console", "tv_stand"),
        ("potted plant", "plant"),
        ("Coffee Table", "coffee_table"),
        ("wooden dining chair", "chair"),
        ("chairs", "chair"),
        ("book shelf", "bookshelf"),
        ("books", "book_stack"),
        ("bedside lamp", "table_lamp"),
        ("bedside table with lamp", "nightstand"),
        ("framed abstract painting", "painting"),
        ("hanging pendant light", "pendant"),
        ("flat-screen TV", "tv"),
        ("grey rug", "rug"),
        ("throw pillows", "cushion"),
        ("round dining table", "round_table"),
        ("white sheer curtains", "curtain"),
        ("table lamp", "table_lamp"),
        ("lamp table", "side_table"),
        ("upper cabinet", "kitchen_wall"),
        ("vase with flowers", "vase"),
        ("floor mirror", "mirror"),
        ("glasses", "cup"),
        ("kitchen island", "kitchen_base"),
    ];
    for (label, name) in cases {
        assert_eq!(template_name(label), Some(name), "{label}");
    }
    assert_eq!(template_name("quantum flux capacitor"), None);
    assert_eq!(template_name(""), None);
}

#[test]
fn every_template_builds_at_its_usual_size_and_has_its_light() {
    for c in kinds() {
        let model = template(&c.name, &TemplateParams::default(), c.usual_size());
        model.check().unwrap();
        if let Some(slot) = &c.light_slot {
            assert!(model.slot(slot).is_some(), "{} shines with {slot}", c.name);
        }
    }
    for name in harmony_catalogue::templates() {
        assert_eq!(kind(name).and_then(|k| k.template.as_deref()), Some(name));
    }
}

#[test]
fn colours_and_unknown_options() {
    let value = serde_json::json!({"colors": {"body": "#102030"}, "wings": 3, "legs": "antigravity", "seats": "2"});
    let (p, notes) = TemplateParams::from_value(&value);
    assert_eq!(notes.len(), 2, "{notes:?}");
    assert_eq!(p.seats, Some(2));
    let model = template("sofa", &p, Size { width: 2.0, height: 0.9, depth: 0.9 });
    assert_eq!(model.slot("body").unwrap().color, "#102030");
    let round: TemplateParams = serde_json::from_value(serde_json::to_value(&p).unwrap()).unwrap();
    assert_eq!(round, p);
}
