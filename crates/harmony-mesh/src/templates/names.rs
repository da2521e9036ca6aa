//! From the words people use to templates.

use harmony_catalogue::normal;

use super::{BackStyle, LegStyle, PlantHabit, ShadeShape, TemplateParams};

/// The template for a free label such as `leather couch` or `potted plant`; `None` when nothing fits.
pub fn template_name(label: &str) -> Option<&'static str> {
    harmony_catalogue::kind(label)?.template.as_deref()
}

/// Options that the label itself gives (`round`, `two-seater`, `snake plant`), where none are given.
pub(super) fn with_hints(label: &str, params: &TemplateParams) -> TemplateParams {
    let mut p = params.clone();
    let words = format!(" {} ", normal(label));
    let has = |list: &[&str]| list.iter().any(|w| words.contains(&format!(" {w} ")));
    if p.round.is_none() {
        if has(&["round", "circular", "oval"]) {
            p.round = Some(true);
        } else if has(&["square", "rectangular"]) {
            p.round = Some(false);
        }
    }
    if p.seats.is_none() {
        let seats = [
            (&["loveseat", "two seater", "2 seater", "two seat"][..], 2),
            (&["three seater", "3 seater"][..], 3),
            (&["four seater", "4 seater"][..], 4),
        ];
        p.seats = seats.iter().find(|(list, _)| has(list)).map(|(_, n)| *n);
    }
    if p.extra.is_none() && has(&["sectional", "l shaped", "chaise", "corner sofa"]) {
        p.extra = Some(true);
    }
    if p.extra.is_none() && has(&["wall mounted", "wall"]) && has(&["tv", "television"]) {
        p.extra = Some(false);
    }
    if p.back.is_none() {
        p.back = if has(&["tub", "barrel"]) {
            Some(BackStyle::Curved)
        } else if has(&["tufted", "chesterfield", "channelled", "channeled"]) {
            Some(BackStyle::Tufted)
        } else if has(&["upholstered", "padded", "velvet", "leather", "fabric"]) && has(&["chair", "chairs"]) {
            Some(BackStyle::Upholstered)
        } else if has(&["rattan", "cane", "wicker", "mesh"]) && has(&["chair", "chairs"]) {
            Some(BackStyle::Mesh)
        } else {
            None
        };
    }
    if p.habit.is_none() {
        let habits = [
            (&["palm", "fern", "areca"][..], PlantHabit::Palm),
            (&["snake", "sansevieria", "aloe", "grass", "upright"][..], PlantHabit::Upright),
            (&["cactus", "cacti"][..], PlantHabit::Cactus),
            (&["tree", "ficus", "fiddle", "olive", "bonsai"][..], PlantHabit::Tree),
            (&["hanging", "ivy", "pothos", "trailing"][..], PlantHabit::Trailing),
            (&["orchid", "flowering", "rose", "roses", "tulips"][..], PlantHabit::Flowers),
        ];
        p.habit = habits.iter().find(|(list, _)| has(list)).map(|(_, h)| *h);
    }
    if p.shade.is_none() {
        let shades = [
            (&["globe", "sphere", "spherical", "paper lantern"][..], ShadeShape::Globe),
            (&["drum"][..], ShadeShape::Drum),
            (&["dome"][..], ShadeShape::Dome),
            (&["bulb"][..], ShadeShape::Bulb),
        ];
        p.shade = shades.iter().find(|(list, _)| has(list)).map(|(_, s)| *s);
    }
    if p.legs.is_none() {
        let legs = [
            (&["pedestal", "tulip"][..], LegStyle::Pedestal),
            (&["hairpin"][..], LegStyle::Hairpin),
            (&["floating", "mattress", "wall mounted"][..], LegStyle::None),
            (&["poster", "canvas", "unframed"][..], LegStyle::None),
        ];
        p.legs = legs.iter().find(|(list, _)| has(list)).map(|(_, l)| *l);
    }
    if p.filled.is_none() {
        if has(&["empty", "glass door", "french door", "french doors", "glazed", "patio door"]) {
            p.filled = Some(false);
        } else if has(&["fruit", "closed", "flowers", "bouquet"]) {
            p.filled = Some(true);
        }
    }
    p
}
