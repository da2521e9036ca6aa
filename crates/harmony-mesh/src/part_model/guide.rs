//! What a model is told about the format.

use super::PartModel;

/// One page for prompts: what a part model is, and two short examples.
pub const PART_MODEL_GUIDE: &str = include_str!("guide.md");

pub(super) fn example() -> PartModel {
    serde_json::from_str(include_str!("example_chair.json")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_examples_of_the_guide_build() {
        let size = harmony_scene::Size { width: 1.0, height: 0.8, depth: 0.5 };
        let mut found = 0;
        for piece in PART_MODEL_GUIDE.split("Example,").skip(1) {
            let json = &piece[piece.find('{').unwrap()..=piece.rfind('}').unwrap()];
            let built = PartModel::from_json(json).unwrap().build(size).unwrap();
            assert!(built.mesh.triangle_count() > 100);
            found += 1;
        }
        assert_eq!(found, 2);
        assert!(example().build(size).unwrap().mesh.triangle_count() > 100);
        assert!(PART_MODEL_GUIDE.len() < 4500, "one page: {}", PART_MODEL_GUIDE.len());
    }
}
