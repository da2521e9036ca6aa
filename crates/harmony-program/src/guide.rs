//! What a model is told about the language.

/// The guide for whoever writes programs: frame, rules, functions, two examples. About 2000 tokens.
pub const GUIDE: &str = include_str!("program_guide.md");

/// Every function as it is called, in the order of the table.
pub fn signatures() -> impl Iterator<Item = &'static str> {
    crate::functions::FUNCTIONS.iter().map(|f| f.signature)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Inputs, Limits, evaluate};

    fn examples() -> Vec<&'static str> {
        GUIDE.split("```python\n").skip(1).filter_map(|rest| rest.split("```").next()).collect()
    }

    #[test]
    fn its_examples_run_at_several_sizes() {
        assert_eq!(examples().len(), 2);
        for source in examples() {
            for (width, height, depth) in [(0.45, 0.85, 0.5), (1.9, 0.8, 0.9)] {
                let size = harmony_scene::Size { width, height, depth };
                let tree = evaluate(source, &Inputs::object(size), &Limits::default());
                let tree = tree.unwrap_or_else(|e| panic!("{}", e.explain(source)));
                assert!(tree.nodes.len() > 8 && tree.materials.len() == 2);
            }
        }
    }

    /// For features of a room, which no question asks for yet.
    const OF_FEATURES: [&str; 4] = ["wall", "floor", "ceiling", "pixel"];

    #[test]
    fn it_names_every_function_and_none_that_does_not_exist() {
        let (prose, _) = GUIDE.split_once("```python").unwrap();
        let words: std::collections::BTreeSet<&str> = prose.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
        for function in crate::functions::FUNCTIONS.iter() {
            let name = function.name.as_str();
            if !name.starts_with("math.") && !["vec", "pow", "hypot"].contains(&name) && !OF_FEATURES.contains(&name) {
                assert!(words.contains(name), "the guide does not name {name}");
            }
        }
        let known: Vec<&str> = crate::functions::FUNCTIONS.iter().map(|f| f.name.as_str()).collect();
        for (at, _) in prose.match_indices('(') {
            let before = &prose[..at];
            let word = before.rsplit(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap();
            let method = before[..before.len() - word.len()].ends_with('.');
            if !word.is_empty() && !method && word != "build" {
                assert!(known.contains(&word), "{word} of the guide does not exist");
            }
        }
    }

    #[test]
    fn it_is_short() {
        // About four letters a token.
        assert!(GUIDE.len() < 9500, "{}", GUIDE.len());
    }
}
