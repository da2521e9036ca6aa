//! What a model is told about the language.

/// The guide for whoever writes programs: frame, rules, functions, two examples. About 2000 tokens.
pub const GUIDE: &str = include_str!("program_guide.md");

/// Every function as it is called, in the order of the table.
pub fn signatures() -> impl Iterator<Item = &'static str> {
    crate::functions::FUNCTIONS.iter().map(|f| f.signature)
}
