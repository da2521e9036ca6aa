//! The modelling functions: what a program can call.

pub(crate) mod arrays;
pub(crate) mod assembly;
pub(crate) mod lines;
pub(crate) mod materials;
pub(crate) mod maths;
pub(crate) mod parts;
pub(crate) mod planes;
pub(crate) mod room;
pub(crate) mod soft;
pub(crate) mod solids;

use std::sync::LazyLock;

use starlark::environment::GlobalsBuilder;

use crate::call::Function;
use crate::thing::{Kind, Thing};

/// All functions: those of the language's top level first, then those of `math`.
pub(crate) static FUNCTIONS: LazyLock<Vec<Function>> = LazyLock::new(|| {
    let mut all = Vec::new();
    all.extend(lines::functions());
    all.extend(planes::functions());
    all.extend(solids::functions());
    all.extend(soft::functions());
    all.extend(arrays::functions());
    all.extend(assembly::functions());
    all.extend(room::functions());
    all.extend(materials::functions());
    all.extend(materials::patterns());
    all.extend(maths::functions());
    all.extend(maths::math());
    all
});

static PARTS: LazyLock<Vec<Function>> = LazyLock::new(parts::methods);
static CURVES: LazyLock<Vec<Function>> = LazyLock::new(lines::methods);
static OUTLINES: LazyLock<Vec<Function>> = LazyLock::new(planes::methods);
static FRAMES: LazyLock<Vec<Function>> = LazyLock::new(room::methods);
static VECTORS: LazyLock<Vec<Function>> = LazyLock::new(maths::vector_methods);
static DICE: LazyLock<Vec<Function>> = LazyLock::new(maths::dice_methods);

/// Methods of a kind of value.
pub(crate) fn methods(kind: &Kind) -> &'static [Function] {
    match kind {
        Kind::Part(..) => &PARTS,
        Kind::Curve(_) => &CURVES,
        Kind::Outline(_) => &OUTLINES,
        Kind::Frame(_) => &FRAMES,
        Kind::Vector(_) => &VECTORS,
        Kind::Dice(_) => &DICE,
        _ => &[],
    }
}

/// Puts the functions into the globals.
pub(crate) fn register(builder: &mut GlobalsBuilder) {
    let math = |f: &Function| f.signature.starts_with("math.");
    for (i, function) in FUNCTIONS.iter().enumerate().filter(|(_, f)| !math(f)) {
        builder.set(&function.name, Thing::from(Kind::Function(i)));
    }
    builder.namespace("math", |space| {
        for (i, function) in FUNCTIONS.iter().enumerate().filter(|(_, f)| math(f)) {
            space.set(function.name.trim_start_matches("math."), Thing::from(Kind::Function(i)));
        }
        space.set("pi", std::f64::consts::PI);
        space.set("tau", std::f64::consts::TAU);
        space.set("e", std::f64::consts::E);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_is_taken_twice() {
        let mut names: Vec<&str> = FUNCTIONS.iter().map(|f| f.name.as_str()).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
        assert!(count > 100, "{count}");
    }
}
