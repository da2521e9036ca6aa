//! Heights that furniture has because people sit at it, stand at it and walk through it.
//!
//! A photo without a metric reference leaves the scene's scale to the sizes that a model names, each off by a tenth and
//! more. Some kinds of things are made to a standard, within a few percent all over the world: they hold the scale
//! better than any guess. Sources: EN 527-1 (desks, 740 mm +- 20 mm), EN 1116 with the usual worktop of 900 mm, DIN 18101
//! and the 80 inch leaf (doors, with their frame about 2.05 m); beyond the paper.

/// A kind with a standard height.
struct Kind {
    /// A label that ends in one of these is of the kind, whatever height was named within reason.
    names: &'static [&'static str],
    /// ... in one of these only with a height near the standard.
    vague: &'static [&'static str],
    /// A label with one of these words is not.
    but_not: &'static [&'static str],
    height: f64,
    sigma: f64,
}

const KINDS: [Kind; 3] = [
    Kind {
        names: &["desk", "dining table", "kitchen table"],
        vague: &["table"],
        but_not: &[
            "accent",
            "adjustable",
            "bar",
            "bedside",
            "cocktail",
            "coffee",
            "console",
            "dressing",
            "end",
            "high",
            "lamp",
            "low",
            "night",
            "nest",
            "nesting",
            "occasional",
            "pool",
            "reception",
            "side",
            "sofa",
            "standing",
            "tea",
        ],
        height: 0.745,
        sigma: 0.03,
    },
    Kind {
        names: &["base cabinet", "lower cabinet", "base unit", "kitchen counter", "countertop", "kitchen island"],
        vague: &["kitchen cabinet"],
        but_not: &["bar", "bathroom", "sink", "tall", "upper", "wall"],
        height: 0.90,
        sigma: 0.04,
    },
    Kind {
        names: &["door"],
        vague: &[],
        but_not: &[
            "balcony", "barn", "cabinet", "closet", "french", "garage", "patio", "sliding", "terrace", "wardrobe",
        ],
        height: 2.06,
        sigma: 0.04,
    },
];

/// A named height farther from the standard than this is that of another kind of thing (logarithm), of a coffee table, of
/// a cabinet on the wall, where the label leaves it open; and where it does not, of a toy's, or of a part that is seen.
const FARTHEST: f64 = 0.3;
const FARTHEST_OF_NAMED: f64 = 0.6;

/// The height, metres, that an object of this label has by a standard, and one sigma of it, relative; `None` where there
/// is no standard, or the named height (metres) says that this is something else.
pub(crate) fn standard_height(label: &str, named: f64) -> Option<(f64, f64)> {
    let label = label.to_lowercase();
    let has = |word: &&str| label.split(|c: char| !c.is_alphanumeric()).any(|w| w == *word);
    let ends = |name: &&str| {
        let before = label.strip_suffix(*name);
        before.is_some_and(|b| b.is_empty() || b.ends_with(|c: char| !c.is_alphanumeric()))
    };
    let (kind, farthest) = KINDS.iter().filter(|k| !k.but_not.iter().any(has)).find_map(|k| {
        let of_name = k.names.iter().any(ends).then_some((k, FARTHEST_OF_NAMED));
        of_name.or_else(|| k.vague.iter().any(ends).then_some((k, FARTHEST)))
    })?;
    let off = (named / kind.height).ln();
    (off.is_finite() && off.abs() <= farthest).then_some((kind.height, kind.sigma))
}

#[cfg(test)]
mod tests {
    use super::standard_height;

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
}
