//! From the words people use to kinds.

use std::collections::HashMap;

use crate::Kind;

/// More of a label than this says nothing about its kind, characters.
const LONGEST: usize = 200;

/// What follows one of these says where a thing is, or what it belongs to or is for: `cabinet above the fridge`.
const PREPOSITIONS: [&str; 22] = [
    "above",
    "against",
    "around",
    "at",
    "behind",
    "below",
    "beneath",
    "beside",
    "between",
    "by",
    "for",
    "from",
    "in",
    "inside",
    "near",
    "next",
    "of",
    "on",
    "over",
    "to",
    "under",
    "underneath",
];

/// Lower case, single spaces, only letters and digits.
pub fn normal(label: &str) -> String {
    words(label).join(" ")
}

/// The words of a label in lower case, letters and digits only.
pub fn words(label: &str) -> Vec<String> {
    let text: String =
        label.chars().take(LONGEST).map(|c| if c.is_alphanumeric() { c.to_ascii_lowercase() } else { ' ' }).collect();
    text.split_whitespace().map(str::to_owned).collect()
}

/// Number of the words before the first preposition that stands by itself: not that of `built-in`, nor the first word.
fn head(label: &str) -> usize {
    let mut count = 0;
    for chunk in label.split(|c: char| c.is_whitespace() || matches!(c, '_' | ',' | '(' | ')' | '/')) {
        let own = words(chunk);
        if count > 0 && matches!(own.as_slice(), [word] if PREPOSITIONS.contains(&word.as_str())) {
            break;
        }
        count += own.len();
    }
    count
}

/// The words of a label that name the thing: those before a `with`, and before where the thing is.
pub(crate) fn head_words(label: &str) -> Vec<String> {
    let mut words = words(label);
    words.truncate(head(label));
    let with = words.iter().skip(1).position(|word| word == "with").map_or(words.len(), |i| i + 1);
    words.truncate(with);
    words
}

/// Whether a normal label ends in a phrase as whole words.
pub(crate) fn ends_in(label: &str, phrase: &str) -> bool {
    label.strip_suffix(phrase).is_some_and(|before| before.is_empty() || before.ends_with(' '))
}

/// Names, synonyms and last words of all kinds, in the singular and plural.
#[derive(Debug)]
pub(crate) struct Forms {
    forms: HashMap<String, Form>,
    most_words: usize,
}

#[derive(Debug, Clone, Copy)]
struct Form {
    /// Length of the name or synonym without its ending.
    length: usize,
    /// Index of its kind.
    kind: usize,
    only_at_end: bool,
}

/// What a label names.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// Index of the kind.
    pub(crate) kind: usize,
    /// Whether its name ends the label.
    pub(crate) at_end: bool,
}

impl Forms {
    pub(crate) fn of(kinds: &[Kind]) -> Self {
        let mut forms: HashMap<String, Form> = HashMap::new();
        for (i, kind) in kinds.iter().enumerate() {
            let anywhere = std::iter::once(&kind.name).chain(&kind.synonyms).map(|word| (word, false));
            for (word, only_at_end) in anywhere.chain(kind.last_words.iter().map(|word| (word, true))) {
                let word = normal(word);
                let form = Form { length: word.len(), kind: i, only_at_end };
                for ending in ["", "s", "es"] {
                    let known = forms.entry(format!("{word}{ending}")).or_insert(form);
                    // `books` by itself before the plural of `book`.
                    if form.length > known.length {
                        *known = form;
                    }
                }
            }
        }
        let most_words = forms.keys().map(|form| form.split(' ').count()).max().unwrap_or(0);
        Self { forms, most_words }
    }

    /// The kind that a label names; see [`crate::kind`].
    pub(crate) fn find(&self, label: &str) -> Option<Found> {
        let words = words(label);
        let with = words.iter().skip(1).position(|word| word == "with").map_or(words.len(), |i| i + 1);
        let words = &words[..with];
        let head = head(label).min(with);
        // `set of chairs`, `built in wardrobe`: the head names no kind, and what follows does.
        self.best(words, head).or_else(|| self.best(words, words.len()))
    }

    /// The best of the names that begin among the first `head` words: `chest of drawers` does.
    fn best(&self, words: &[String], head: usize) -> Option<Found> {
        let mut best: Option<((bool, usize, usize), Found)> = None;
        for end in 1..=words.len() {
            for start in end.saturating_sub(self.most_words)..end.min(head) {
                let Some(form) = self.forms.get(&words[start..end].join(" ")) else { continue };
                let at_end = end >= head;
                if form.only_at_end && !at_end {
                    continue;
                }
                let rank = (at_end, form.length, end);
                if best.is_none_or(|(r, _)| rank > r) {
                    best = Some((rank, Found { kind: form.kind, at_end }));
                }
            }
        }
        best.map(|(_, found)| found)
    }
}
