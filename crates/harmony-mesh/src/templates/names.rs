//! From the words people use to templates.

use std::collections::HashMap;
use std::sync::LazyLock;

use super::{BackStyle, LegStyle, PlantHabit, ShadeShape, TemplateParams};
use crate::catalogue::CATEGORIES;

/// The template for a free label such as `leather couch` or `potted plant`; `None` when nothing fits.
///
/// The longest name or synonym that occurs in the label as whole words wins; of equally long ones the one that
/// ends last, for English puts the head of a phrase at its end (`book shelf`, `lamp table`).
pub fn template_name(label: &str) -> Option<&'static str> {
    let label = normal(label);
    let words: Vec<&str> = label.split(" with ").next().unwrap_or(&label).split(' ').collect();
    let forms = &*FORMS;
    let mut best: Option<((usize, usize), &'static str)> = None;
    for end in 1..=words.len() {
        for start in end.saturating_sub(forms.most_words)..end {
            let Some((length, name)) = forms.names.get(&words[start..end].join(" ")) else { continue };
            // the head of the phrase counts more than a long word inside it
            let rank = (usize::from(end == words.len()) * 1000 + length, end);
            if best.is_none_or(|(r, _)| rank > r) {
                best = Some((rank, name));
            }
        }
    }
    best.map(|(_, name)| name)
}

/// Names and synonyms of all categories, in the singular and plural.
struct Forms {
    /// Length of the longest name or synonym, and the first category that has it.
    names: HashMap<String, (usize, &'static str)>,
    most_words: usize,
}

static FORMS: LazyLock<Forms> = LazyLock::new(|| {
    let mut names = HashMap::new();
    for category in CATEGORIES {
        for word in std::iter::once(&category.name).chain(category.synonyms).map(|word| normal(word)) {
            for ending in ["", "s", "es"] {
                let known = names.entry(format!("{word}{ending}")).or_insert((word.len(), category.name));
                // `books` by itself before the plural of `book`.
                if word.len() > known.0 {
                    *known = (word.len(), category.name);
                }
            }
        }
    }
    let most_words = names.keys().map(|form| form.split(' ').count()).max().unwrap_or(0);
    Forms { names, most_words }
});

/// Lower case, single spaces, only letters and digits.
fn normal(text: &str) -> String {
    let text: String =
        text.chars().take(200).map(|c| if c.is_alphanumeric() { c.to_ascii_lowercase() } else { ' ' }).collect();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
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
