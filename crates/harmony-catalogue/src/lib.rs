//! What is known beforehand about kinds of things in rooms, and about their materials.
//!
//! The data are `catalogue.toml`, read once; [`Kind`] and [`Material`] document its fields. A label ("grey velvet sofas")
//! finds its kind by [`kind`]; everything else here is a field of what it finds. Why the data are a file:
//! `docs/decisions/0029-catalogue.md`.

mod entry;
mod lookup;

use std::sync::LazyLock;

use harmony_scene::{MaterialCategory, OpeningKind, Size};

pub use entry::{Axis, Back, Emission, Joint, Kind, Material, Motion, Side, StandardHeight, Trait};
pub use lookup::{normal, words};

/// The whole catalogue.
#[derive(Debug)]
struct Catalogue {
    file: entry::File,
    forms: lookup::Forms,
}

#[expect(clippy::expect_used, reason = "a file of the program itself; a test reads it")]
static CATALOGUE: LazyLock<Catalogue> = LazyLock::new(|| {
    let file: entry::File = toml::from_str(include_str!("catalogue.toml")).expect("catalogue.toml is sound");
    let forms = lookup::Forms::of(&file.kinds);
    Catalogue { file, forms }
});

/// All kinds, in the file's order.
pub fn kinds() -> &'static [Kind] {
    &CATALOGUE.file.kinds
}

/// Names of the geometry templates, each once, in the file's order.
pub fn templates() -> impl Iterator<Item = &'static str> {
    kinds().iter().filter(|k| k.template.as_ref() == Some(&k.name)).map(|k| k.name.as_str())
}

/// The kind that a label names, by its name or a synonym; `None` when it names none.
///
/// The longest name or synonym that occurs in the label as whole words wins, one at the end of the label before all
/// others; of equally long ones the one that ends last, for English puts the head of a phrase at its end (`book shelf`,
/// `lamp table`). What follows a `with` does not count, nor what follows another preposition (`cabinet above the fridge`),
/// unless nothing before it names a kind (`set of chairs`). Case, hyphens and plurals don't matter.
pub fn kind(label: &str) -> Option<&'static Kind> {
    CATALOGUE.forms.find(label).map(|found| &kinds()[found.kind])
}

/// The kind of a label that ends in its name, where the thing is left aside: that of `floor lamp` and `lamp on the desk`,
/// not of `lamp stand` or `window seat cover`.
pub fn kind_at_end(label: &str) -> Option<&'static Kind> {
    CATALOGUE.forms.find(label).filter(|found| found.at_end).map(|found| &kinds()[found.kind])
}

/// Usual size of a label's kind, metres; half a metre each way when unknown.
pub fn default_size(label: &str) -> Size {
    kind(label).map_or(Size { width: 0.5, height: 0.5, depth: 0.5 }, Kind::usual_size)
}

/// Smallest and largest plausible size of a label's kind, metres, where it ends in its name: a `computer mouse` has not the
/// size of a computer.
pub fn size_range(label: &str) -> (Size, Size) {
    let cube = |side| Size { width: side, height: side, depth: side };
    kind_at_end(label).map_or((cube(0.002), cube(4.0)), Kind::size_range)
}

/// Whether a label's kind has a trait; what is unknown has none.
pub fn has(label: &str, wanted: Trait) -> bool {
    kind(label).is_some_and(|k| k.has(wanted))
}

/// Whether one side of it is the front; unknown things have one.
pub fn has_front(label: &str) -> bool {
    kind(label).is_none_or(|k| k.has(Trait::Front))
}

/// What the back of a label's kind has that its front has not.
pub fn back(label: &str) -> Option<Back> {
    kind(label).and_then(|k| k.back)
}

/// The opening of the wall that a label's kind fills, where the label ends in its name: a `window seat` fills none.
pub fn opening(label: &str) -> Option<OpeningKind> {
    kind_at_end(label).and_then(|k| k.opening)
}

/// Whether a door slides: its kind does, or its label says so.
pub fn slides(label: &str) -> bool {
    let leaf_slides = |k: &Kind| k.joints.iter().any(|j| j.motion == Motion::Slide);
    kind(label).is_some_and(|k| k.opening == Some(OpeningKind::Door) && leaf_slides(k))
        || words(label).iter().any(|word| word == "sliding")
}

/// The template's slot that shines, for light sources.
pub fn light_slot(label: &str) -> Option<&'static str> {
    kind(label).and_then(|k| k.light_slot.as_deref())
}

/// What light a thing of this label gives: `floor lamp`, `ceiling fan with light`; not `light switch`, `lamp table`.
pub fn emission(label: &str) -> Option<Emission> {
    let own = kind_at_end(label).and_then(|k| k.emits);
    let added = || {
        let label = normal(label);
        let (_, part) = label.split_once(" with ")?;
        kind_at_end(part)?.emits.filter(|e| matches!(e, Emission::Lamp | Emission::Candle))
    };
    own.or_else(added)
}

/// Whether what fills an opening lets daylight in: windows, doors of glass.
pub fn lets_daylight_in(label: &str) -> bool {
    kind_at_end(label).is_some_and(|k| {
        let of_glass = || named_material(label) == Some(MaterialCategory::Glass);
        k.opening.is_some() && (k.has(Trait::Transmits) || of_glass())
    })
}

/// Whether a label names a part of the room itself, numbered or not; its end counts: a wall clock hangs on the wall. So
/// does a `picture on the wall`, which names a kind.
pub fn is_of_the_room(label: &str) -> bool {
    if kind_at_end(label).is_some() {
        return false;
    }
    let label = normal(label.trim_end_matches(|c: char| !c.is_alphabetic()));
    CATALOGUE.file.room_parts.iter().any(|part| {
        let end = label.strip_suffix('s').filter(|l| l.ends_with(part.as_str())).unwrap_or(&label);
        lookup::ends_in(end, part)
    })
}

/// A material's properties.
#[expect(clippy::expect_used, reason = "a test holds that each category has its row")]
pub fn material(category: MaterialCategory) -> &'static Material {
    CATALOGUE.file.materials.iter().find(|m| m.name == category).expect("each category has a row")
}

/// The material that a label names outright: `glass coffee table`, `oak chair`.
pub fn named_material(label: &str) -> Option<MaterialCategory> {
    words(label)
        .iter()
        .find_map(|word| CATALOGUE.file.materials.iter().find(|m| m.words.contains(word)))
        .map(|m| m.name)
}

/// The usual material of a label: the one that it names, else its kind's.
pub fn material_category(label: &str) -> MaterialCategory {
    let of_kind = || kind(label).map_or(MaterialCategory::Other, |k| k.material);
    named_material(label).unwrap_or_else(of_kind)
}

/// Mass of a thing of this label and material over its bounding box, kg/m3. A kind's own where it is known, in the ratio
/// of the materials when it is of another one than usual.
pub fn box_density(label: &str, category: MaterialCategory) -> f64 {
    let own = material(category).box_density_kg_m3;
    kind(label).map_or(own, |k| k.box_density() * own / material(k.material).box_density_kg_m3)
}

/// Usual wall thickness of a thing of this label and material, metres: the kind's own where it has one.
pub fn wall_thickness(label: &str, category: MaterialCategory) -> f64 {
    let own = kind(label).and_then(|k| k.wall_thickness_m);
    own.unwrap_or(material(category).wall_thickness_m)
}

/// A named height farther from the standard than this is that of another kind of thing (logarithm), of a coffee table, of
/// a cabinet on the wall, where the label leaves it open; and where it does not, of a toy's, or of a part that is seen.
const FARTHEST_OF_LIKELY: f64 = 0.3;
const FARTHEST_OF_CERTAIN: f64 = 0.6;

/// The height, metres, that a thing of this label has by a standard, and one sigma of it, relative; `None` where there is
/// no standard, or the named height (metres) says that this is something else.
///
/// A photo without a metric reference leaves the scene's scale to the sizes that a model names, each off by a tenth and
/// more. Things that people sit at, stand at and walk through are made to a standard, within a few percent all over the
/// world: they hold the scale better than any guess. Beyond the paper.
pub fn standard_height(label: &str, named: f64) -> Option<(f64, f64)> {
    let name = kind(label)?.standard_height.as_ref()?;
    let standard = CATALOGUE.file.standard_heights.iter().find(|s| s.name == *name)?;
    if words(label).iter().any(|word| standard.unless.contains(word)) {
        return None;
    }
    let label = lookup::head_words(label).join(" ");
    let ends = |names: &[String]| names.iter().any(|name| lookup::ends_in(&label, name));
    let farthest = if ends(&standard.certain) {
        FARTHEST_OF_CERTAIN
    } else if ends(&standard.likely) {
        FARTHEST_OF_LIKELY
    } else {
        return None;
    };
    let off = (named / standard.height).ln();
    (off.is_finite() && off.abs() <= farthest).then_some((standard.height, standard.sigma))
}

#[cfg(test)]
mod tests;
