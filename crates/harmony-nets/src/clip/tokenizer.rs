//! CLIP's tokenizer: byte-level byte-pair encoding with an end-of-word mark. The vocabulary is a file of the model's
//! folder: `vocab.json` with `merges.txt`, or `tokenizer.json`.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use regex::Regex;
use serde::Deserialize;
use unicode_normalization::UnicodeNormalization;

/// Ends the last piece of a word.
const WORD_END: &str = "</w>";
const START: &str = "<|startoftext|>";
const END: &str = "<|endoftext|>";

/// Contractions, words, single digits, runs of other signs; white space only parts.
const PIECES: &str = r"'s|'t|'re|'ve|'m|'ll|'d|[\p{L}]+|[\p{N}]|[^\s\p{L}\p{N}]+";

/// Why a vocabulary cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TokenizerError {
    /// A file that is not there or not readable.
    #[error("cannot read the vocabulary: {source}: {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// A file that is not what it should be.
    #[error("not a vocabulary of CLIP: {reason}: {}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// Text to token ids.
#[derive(Debug, Clone)]
pub struct Tokenizer {
    ids: HashMap<String, u32>,
    /// Rank of each pair that may be joined; lower goes first.
    ranks: HashMap<(String, String), usize>,
    pieces: Regex,
    start: u32,
    end: u32,
}

#[derive(Deserialize)]
struct TokenizerFile {
    model: Model,
    #[serde(default)]
    added_tokens: Vec<AddedToken>,
}

#[derive(Deserialize)]
struct Model {
    vocab: HashMap<String, u32>,
    merges: Vec<Merge>,
}

/// Older files join the two parts by a space.
#[derive(Deserialize)]
#[serde(untagged)]
enum Merge {
    Pair(String, String),
    Line(String),
}

#[derive(Deserialize)]
struct AddedToken {
    id: u32,
    content: String,
}

impl Tokenizer {
    /// Reads the vocabulary in a model's folder.
    ///
    /// # Errors
    /// [`TokenizerError`] names the file and what is wrong with it.
    pub fn open(folder: &Path) -> Result<Self, TokenizerError> {
        let (vocab, merges) = (folder.join("vocab.json"), folder.join("merges.txt"));
        if vocab.exists() || merges.exists() {
            let ids = serde_json::from_str(&read(&vocab)?).map_err(|e| malformed(&vocab, e))?;
            let text = read(&merges)?;
            // The first line is a comment with the version; sections after the merges do not exist.
            let lines = text.lines().filter(|line| !line.starts_with("#version") && !line.trim().is_empty());
            let pairs = lines.map(|line| pair(line, &merges)).collect::<Result<_, _>>()?;
            return Self::new(ids, pairs, &vocab);
        }
        let path = folder.join("tokenizer.json");
        let file: TokenizerFile = serde_json::from_str(&read(&path)?).map_err(|e| malformed(&path, e))?;
        let mut ids = file.model.vocab;
        ids.extend(file.added_tokens.into_iter().map(|t| (t.content, t.id)));
        let pairs = file.model.merges.into_iter().map(|merge| match merge {
            Merge::Pair(a, b) => Ok((a, b)),
            Merge::Line(line) => pair(&line, &path),
        });
        Self::new(ids, pairs.collect::<Result<_, _>>()?, &path)
    }

    fn new(ids: HashMap<String, u32>, merges: Vec<(String, String)>, path: &Path) -> Result<Self, TokenizerError> {
        let mark = |mark: &str| ids.get(mark).copied().ok_or_else(|| malformed(path, format!("no token {mark}")));
        let (start, end) = (mark(START)?, mark(END)?);
        let letter = |b: u8| letter_of(b).to_string();
        if let Some(lost) = (0..=u8::MAX).find(|b| !ids.contains_key(&letter(*b))) {
            return Err(malformed(path, format!("no token for byte {lost}")));
        }
        if let Some((a, b)) = merges.iter().find(|(a, b)| !ids.contains_key(&format!("{a}{b}"))) {
            return Err(malformed(path, format!("{a:?} and {b:?} are joined to a token that is not there")));
        }
        let ranks = merges.into_iter().enumerate().map(|(rank, pair)| (pair, rank)).collect();
        let pieces = Regex::new(PIECES).map_err(|e| malformed(path, e))?;
        Ok(Self { ids, ranks, pieces, start, end })
    }

    /// Token ids with the start and end marks, at most `most` of them (two at least).
    ///
    /// Text that looks like a mark is text here, not a mark: sentences come from outside.
    pub fn encode(&self, text: &str, most: usize) -> Vec<u32> {
        let clean: String = text.nfc().flat_map(char::to_lowercase).collect();
        let mut ids = vec![self.start];
        for piece in self.pieces.find_iter(&clean) {
            self.push_piece(piece.as_str(), &mut ids);
        }
        ids.truncate(most.max(2) - 1);
        ids.push(self.end);
        ids
    }

    fn push_piece(&self, piece: &str, ids: &mut Vec<u32>) {
        let mut parts: Vec<String> = piece.bytes().map(|b| letter_of(b).to_string()).collect();
        if let Some(last) = parts.last_mut() {
            last.push_str(WORD_END);
        }
        // Joins the pair of lowest rank, wherever it stands first, until none is left.
        loop {
            let rank = |i: usize| self.ranks.get(&(parts[i].clone(), parts[i + 1].clone())).copied();
            let best = (0..parts.len().saturating_sub(1)).filter_map(|i| Some((rank(i)?, i))).min();
            let Some((_, i)) = best else { break };
            let right = parts.remove(i + 1);
            parts[i].push_str(&right);
        }
        // What is not in the vocabulary (a byte at a word's end of a curtailed one) is the end mark, as upstream.
        ids.extend(parts.iter().map(|part| self.ids.get(part).copied().unwrap_or(self.end)));
    }
}

/// The printable letter that stands for a byte (GPT-2's table): itself where it is printable Latin-1, else counted from
/// U+0100 on.
fn letter_of(byte: u8) -> char {
    let printable = |b: u8| matches!(b, b'!'..=b'~' | 0xa1..=0xac | 0xae..=0xff);
    if printable(byte) {
        return char::from(byte);
    }
    let before = (0..byte).filter(|b| !printable(*b)).count() as u32;
    char::from_u32(256 + before).unwrap_or('\u{fffd}')
}

fn read(path: &Path) -> Result<String, TokenizerError> {
    std::fs::read_to_string(path).map_err(|source| TokenizerError::Io { path: path.to_owned(), source })
}

fn malformed(path: &Path, reason: impl std::fmt::Display) -> TokenizerError {
    TokenizerError::Malformed { path: path.to_owned(), reason: reason.to_string() }
}

fn pair(line: &str, path: &Path) -> Result<(String, String), TokenizerError> {
    let (a, b) = line.trim_end().split_once(' ').ok_or_else(|| malformed(path, format!("not a pair: {line:?}")))?;
    Ok((a.to_owned(), b.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_have_the_letters_of_the_table() {
        // From GPT-2's published table.
        for (byte, letter) in
            [(0u8, 'Ā'), (b' ', 'Ġ'), (b'!', '!'), (b'~', '~'), (0x7f, 'ġ'), (0xa0, 'ł'), (0xad, 'Ń'), (0xff, 'ÿ')]
        {
            assert_eq!(letter_of(byte), letter, "{byte}");
        }
        let all: std::collections::BTreeSet<char> = (0..=255).map(letter_of).collect();
        assert_eq!(all.len(), 256);
    }
}
