//! What somebody may have meant.

/// The nearest of some names, when one is near.
pub fn nearest<'a>(word: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let wanted = word.to_ascii_lowercase();
    names
        .into_iter()
        .map(|name| (strsim::damerau_levenshtein(&wanted, &name.to_ascii_lowercase()), name))
        .filter(|(distance, name)| {
            *distance <= 1 + name.len().min(wanted.len()) / 3 || (wanted.len() > 3 && name.starts_with(&wanted))
        })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_of_the_hand_are_near_and_other_words_are_not() {
        assert_eq!(nearest("bevle", ["size", "bevel", "seg"]), Some("bevel"));
        assert_eq!(nearest("segments", ["size", "bevel"]), None);
        assert_eq!(nearest("colour", ["color", "rough"]), Some("color"));
    }
}
