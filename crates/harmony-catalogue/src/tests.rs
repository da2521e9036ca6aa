use std::collections::BTreeMap;

use super::*;

fn name(label: &str) -> Option<&'static str> {
    kind(label).map(|k| k.name.as_str())
}

#[test]
fn every_row_is_sound() {
    let file = &CATALOGUE.file;
    let mut meaning: BTreeMap<String, &str> = BTreeMap::new();
    for k in &file.kinds {
        assert_eq!(name(&k.name), Some(k.name.as_str()));
        for word in std::iter::once(&k.name).chain(&k.synonyms).chain(&k.last_words) {
            assert_eq!(name(word), Some(k.name.as_str()), "{word} of {} means something else", k.name);
            assert_eq!(meaning.insert(normal(word), &k.name), None, "{word} stands twice");
        }
        for side in k.sides() {
            assert!(0.0 < side.low && side.low < side.usual && side.usual < side.high, "{}: {side:?}", k.name);
            assert!((0.01..1.5).contains(&side.sigma()), "{}: {side:?}", k.name);
        }
        assert!((1.0..3000.0).contains(&k.box_density()), "{}: {} kg/m3", k.name, k.box_density());
        assert!(k.wall_thickness_m.is_none_or(|t| 0.0 < t && t < 0.2), "{}", k.name);
        assert!(k.heavy_foot.is_none_or(|share| (0.2..=1.0).contains(&share)), "{}", k.name);
        assert!(k.bulb_at.is_none_or(|share| (0.0..=1.0).contains(&share)), "{}", k.name);
        assert!(k.light_slot.is_none() || k.template.is_some(), "{} has a slot of no template", k.name);
        assert!(k.joints.iter().all(|j| !j.part.is_empty()), "{}", k.name);
        let standard = k.standard_height.as_ref().map(|s| file.standard_heights.iter().any(|h| h.name == *s));
        assert_ne!(standard, Some(false), "{} has an unknown standard height", k.name);
        if let Some(template) = &k.template {
            assert!(templates().any(|t| t == template), "{}: there is no kind of template {template}", k.name);
        }
    }
    for height in &file.standard_heights {
        assert!(height.height > 0.0 && (0.0..0.2).contains(&height.sigma), "{height:?}");
    }
    for category in MaterialCategory::ALL {
        let m = material(category);
        assert!(0.0 < m.box_density_kg_m3 && m.box_density_kg_m3 <= m.density_kg_m3, "{m:?}");
        assert!(0.0 < m.friction && m.friction < 1.0 && 0.0 < m.wall_thickness_m, "{m:?}");
        assert!((0.0..=1.0).contains(&m.elasticity), "{m:?}");
    }
    assert_eq!(file.materials.len(), MaterialCategory::ALL.len());
}

#[test]
fn a_field_that_nobody_knows_is_refused() {
    let text = include_str!("catalogue.toml").replacen("mass_kg", "mass_kgs", 1);
    let error = toml::from_str::<entry::File>(&text).unwrap_err().to_string();
    assert!(error.contains("mass_kgs"), "{error}");
}

#[test]
fn labels_find_their_kind() {
    for (label, wanted) in [
        ("leather couch", "sofa"),
        ("TV console", "tv_stand"),
        ("Coffee Table", "coffee_table"),
        ("wooden dining chair", "chair"),
        ("chairs", "chair"),
        ("book shelf", "bookshelf"),
        ("books", "book_stack"),
        ("bedside table with lamp", "nightstand"),
        ("round dining table", "round_table"),
        ("flat-screen TV", "tv"),
        ("lamp table", "side_table"),
        ("table lamp", "table_lamp"),
        ("vase with flowers", "vase"),
        ("glasses", "cup"),
        ("sliding glass door", "sliding_door"),
        ("French doors", "glass_door"),
        ("glass cabinet door", "cabinet_door"),
        ("folding screen", "folding_screen"),
        ("smoke detector", "smoke_detector"),
        ("string lights", "small_light"),
    ] {
        assert_eq!(name(label), Some(wanted), "{label}");
    }
    // "light" is an adjective before a noun that nobody knows.
    for label in ["quantum flux capacitor", "", "with", "light oak contraption"] {
        assert_eq!(name(label), None, "{label}");
    }
    assert_eq!(kind_at_end("lamp stand").map(|k| &k.name), None);
    for (label, wanted) in [
        ("computer mouse", "computer_mouse"),
        ("telephone", "telephone"),
        ("TV remote", "remote_control"),
        ("window sill", "window_sill"),
        ("white plastic bag", "carrier_bag"),
        ("bag", "suitcase"),
        ("sheet of paper", "paper"),
    ] {
        assert_eq!(name(label), Some(wanted), "{label}");
    }
}

#[test]
fn a_word_before_a_name_that_nobody_knows_gives_no_size_and_opens_no_wall() {
    assert_eq!(opening("white sash window"), Some(OpeningKind::Window));
    assert_eq!(opening("window sill"), None);
    assert_eq!(opening("window contraption"), None);
    let unknown = size_range("quantum flux capacitor");
    assert_eq!(size_range("computer contraption"), unknown);
    assert_ne!(size_range("computer"), unknown);
}

#[test]
fn where_a_thing_is_does_not_say_what_it_is() {
    for (label, wanted) in [
        ("wall cabinet above refrigerator", "kitchen_wall"),
        ("wall cabinet (above the refrigerator)", "kitchen_wall"),
        ("wall_cabinet_above_microwave", "kitchen_wall"),
        ("shelf under window", "wall_shelf"),
        ("table lamp on the nightstand", "table_lamp"),
        ("nightstand next to bed", "nightstand"),
        ("chair at the dining table", "chair"),
        ("chair rail", "moulding"),
        ("white chair rail moulding", "moulding"),
        ("cushion for a sofa", "cushion"),
        ("plant in front of the window", "plant"),
        ("rug beneath the coffee table", "rug"),
        ("desk with monitor on it", "desk"),
        // What stands before names nothing, or belongs to a name.
        ("set of chairs", "chair"),
        ("chest of drawers beside the bed", "dresser"),
        ("stack of books", "book_stack"),
        ("bowl of fruit", "bowl"),
        ("built-in wardrobe", "wardrobe"),
        ("white built in wardrobe", "wardrobe"),
        ("over-the-range microwave", "microwave"),
        ("wall-to-wall carpet", "rug"),
        ("floor to ceiling bookshelf", "bookshelf"),
    ] {
        assert_eq!(name(label), Some(wanted), "{label}");
    }
    assert_eq!(name("contraption above the refrigerator"), Some("fridge"), "the only word that says anything");
    let range = |label| size_range(label).1;
    assert_eq!(range("wall cabinet above refrigerator"), range("wall cabinet"));
    assert_eq!(emission("lamp on the desk"), Some(Emission::Lamp));
    assert_eq!(emission("desk under the lamp"), None);
    assert!(lets_daylight_in("window above the sink") && !lets_daylight_in("shelf under the window"));
    assert!(!is_of_the_room("picture on the wall") && is_of_the_room("panel of the wall"));
    assert!(standard_height("dining table by the window", 0.75).is_some());
}

#[test]
fn labels_that_shine_and_labels_that_do_not() {
    for label in [
        "Table Lamp",
        "floor lamp",
        "pendant light",
        "recessed downlight",
        "chandelier",
        "wall sconce",
        "flush-mount ceiling light",
        "ceiling fan with light",
        "light fixture",
        "string lights",
        "nightlight",
    ] {
        assert_eq!(emission(label), Some(Emission::Lamp), "{label}");
    }
    for label in [
        "light switch",
        "lamp table",
        "light wood cabinet",
        "candle holder",
        "sofa",
        "",
        "skylight",
        "light gray rug",
        "ceiling fan",
        "lightweight chair",
        "folding screen",
        "monitor stand",
        "projector screen",
        "smoke detector",
    ] {
        assert_eq!(emission(label), None, "{label}");
    }
    assert_eq!(emission("flat-screen TV"), Some(Emission::Screen));
    assert_eq!(emission("Fireplace"), Some(Emission::Fire));
    assert_eq!(emission("scented candles"), Some(Emission::Candle));
}

#[test]
fn of_doors_only_glass_ones_let_daylight_in() {
    for label in ["window", "sliding glass door", "French doors", "Patio Door", "glass front door", "skylight"] {
        assert!(lets_daylight_in(label), "{label}");
    }
    for label in ["wooden door", "glass cabinet door", "door", "glass shower door", "french window sill", "glass vase"]
    {
        assert!(!lets_daylight_in(label), "{label}");
    }
}

#[test]
fn parts_of_the_room_are_no_objects() {
    for label in ["wall", "white walls", "Wooden Floor", "skirting boards", "baseboards", "crown molding", "wall 2"] {
        assert!(is_of_the_room(label), "{label}");
    }
    for label in ["wall clock", "floor lamp", "ceiling light", "mushroom", "drywall anchor", ""] {
        assert!(!is_of_the_room(label), "{label}");
    }
}

#[test]
fn tables_to_sit_at_have_a_standard_height_and_low_ones_do_not() {
    assert!(standard_height("dining table", 0.8).is_some_and(|(h, s)| (h - 0.745).abs() < 0.01 && s < 0.05));
    assert!(standard_height("Desk", 0.65).is_some());
    for (label, height) in [("coffee table", 0.7), ("table", 0.42), ("bedside-table", 0.6), ("table lamp", 0.7)] {
        assert!(standard_height(label, height).is_none(), "{label}");
    }
    assert!(standard_height("vegetable", 0.7).is_none());
    // A label that leaves no doubt holds against a height that was named badly.
    assert!(standard_height("dining table", 0.5).is_some() && standard_height("table", 0.5).is_none());
    assert!(standard_height("desk", 0.3).is_none());
    assert!(standard_height("desk", f64::NAN).is_none() && standard_height("desk", 0.0).is_none());
}

#[test]
fn worktops_and_doors_too() {
    assert!(standard_height("kitchen base cabinet", 0.8).is_some());
    assert!(standard_height("sink cabinet", 0.9).is_none());
    assert!(standard_height("door", 1.9).is_some() && standard_height("cabinet door", 1.9).is_none());
}

#[test]
fn labels_have_their_usual_material_and_mass() {
    use MaterialCategory as M;
    for (label, wanted) in [
        ("Grey Sofa", M::Fabric),
        ("leather sofa", M::Leather),
        ("sofa table", M::Wood),
        ("glass coffee table", M::Glass),
        ("floor lamp", M::Metal),
        ("potted plant", M::Other),
        ("bookshelf", M::Wood),
        ("ceramic vase", M::Ceramic),
        ("", M::Other),
    ] {
        assert_eq!(material_category(label), wanted, "{label}");
    }
    let table = |material| box_density("coffee table", material);
    assert!((table(M::Wood) * 1.1 * 0.42 * 0.6 - 20.0).abs() < 1e-9, "that of its kind");
    assert!(table(M::Stone) > 5.0 * table(M::Wood), "of another material");
    assert_eq!(box_density("contraption", M::Metal), material(M::Metal).box_density_kg_m3);
    assert_eq!((wall_thickness("door", M::Wood), wall_thickness("desk", M::Wood)), (0.04, 0.02));
}

#[test]
fn doors_slide_by_their_kind_or_by_what_is_said_of_them() {
    for (label, wanted) in [
        ("sliding glass door", true),
        ("barn door", true),
        ("sliding patio doors", true),
        ("interior door", false),
        ("French doors", false),
        ("chest of drawers", false),
    ] {
        assert_eq!(slides(label), wanted, "{label}");
    }
}

#[test]
fn lamps_hang_over_tables_and_not_over_what_stands_on_them() {
    for (label, wanted) in
        [("round dining table", true), ("coffee table", true), ("table lamp", false), ("tablecloth", false)]
    {
        assert_eq!(has(label, Trait::LitFromAbove), wanted, "{label}");
    }
}
