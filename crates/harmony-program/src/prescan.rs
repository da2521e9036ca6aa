//! One pass over the bytes of a program before anything parses it.
//!
//! The parser and the compiler of the language recurse, so a few kilobytes of brackets or operators would overflow the
//! native stack. Strings and comments are skipped; long lists of points stay legal, because operators are counted
//! between two commas of one bracket.

use crate::error::{ErrorKind, ProgramError};

/// Longest program, bytes.
pub const MAX_BYTES: usize = 64 * 1024;
/// Most lines.
pub const MAX_LINES: usize = 2000;
/// Longest line, bytes.
pub const MAX_LINE: usize = 400;
/// Deepest nesting of brackets.
pub const MAX_BRACKETS: usize = 60;
/// Deepest indentation, levels of blocks.
pub const MAX_BLOCKS: usize = 40;
/// Most operators, calls and attributes between two commas of one bracket.
pub const MAX_OPERATORS: usize = 120;
/// Most `lambda` between two commas of one bracket.
pub const MAX_LAMBDAS: usize = 8;

/// Words that nest expressions.
const WORDS: [&str; 8] = ["and", "or", "not", "if", "else", "in", "for", "lambda"];

struct Level {
    operators: usize,
    lambdas: usize,
}

impl Level {
    const NEW: Self = Self { operators: 0, lambdas: 0 };
}

struct Scan<'a> {
    bytes: &'a [u8],
    at: usize,
    line: u32,
    levels: Vec<Level>,
    blocks: Vec<usize>,
    /// Whether the byte before (spaces aside) ends a value, so that a bracket after it calls or indexes.
    after_value: bool,
}

fn refused(line: u32, message: String, hint: &str) -> ProgramError {
    ProgramError::new(ErrorKind::Refused, line, message).with_hint(hint)
}

/// Refuses what could harm the parser.
///
/// # Errors
/// [`ErrorKind::Refused`] with the line and the limit.
pub fn prescan(source: &str) -> Result<(), ProgramError> {
    if source.len() > MAX_BYTES {
        let message = format!("the program has {} bytes; at most {MAX_BYTES} are allowed", source.len());
        return Err(refused(0, message, "use loops and functions instead of long lists"));
    }
    for (i, line) in source.split('\n').enumerate() {
        let number = i as u32 + 1;
        if i >= MAX_LINES {
            return Err(refused(number, format!("more than {MAX_LINES} lines"), "use loops and functions"));
        }
        if line.len() > MAX_LINE {
            let message = format!("a line of {} bytes; at most {MAX_LINE} are allowed", line.len());
            return Err(refused(number, message, "break the line inside a bracket"));
        }
    }
    if let Some(at) = source.bytes().position(|b| (b < 32 && !matches!(b, b'\n' | b'\r' | b'\t')) || b == 127) {
        let line = source[..at].matches('\n').count() as u32 + 1;
        return Err(refused(line, "a control character".to_owned(), "plain text only"));
    }
    let mut scan = Scan {
        bytes: source.as_bytes(),
        at: 0,
        line: 1,
        levels: vec![Level::NEW],
        blocks: vec![0],
        after_value: false,
    };
    scan.run()
}

impl Scan<'_> {
    fn run(&mut self) -> Result<(), ProgramError> {
        self.indentation()?;
        while let Some(&byte) = self.bytes.get(self.at) {
            self.at += 1;
            match byte {
                b'\n' => self.newline()?,
                b' ' | b'\t' | b'\r' => {}
                b'\\' if self.bytes.get(self.at) == Some(&b'\n') => {
                    self.at += 1;
                    self.line += 1;
                }
                b'#' => {
                    while self.bytes.get(self.at).is_some_and(|&b| b != b'\n') {
                        self.at += 1;
                    }
                }
                b'"' | b'\'' => {
                    self.string(byte);
                    self.after_value = true;
                }
                b'(' | b'[' | b'{' => self.open()?,
                b')' | b']' | b'}' => {
                    if self.levels.len() > 1 {
                        self.levels.pop();
                    }
                    self.after_value = true;
                }
                b',' | b';' => {
                    *self.level() = Level::NEW;
                    self.after_value = false;
                }
                b'.' if self.bytes.get(self.at).is_some_and(u8::is_ascii_digit) => self.after_value = true,
                b'.' if self.after_value => self.operator()?,
                b'0'..=b'9' => self.number(),
                b'a'..=b'z' | b'A'..=b'Z' | b'_' => self.word()?,
                b'+' | b'-' | b'*' | b'/' | b'%' | b'|' | b'&' | b'^' | b'~' | b'<' | b'>' | b'=' | b'!' => {
                    self.operator()?;
                    self.after_value = false;
                }
                _ => self.after_value = false,
            }
        }
        Ok(())
    }

    fn level(&mut self) -> &mut Level {
        if self.levels.is_empty() {
            self.levels.push(Level::NEW);
        }
        let last = self.levels.len() - 1;
        &mut self.levels[last]
    }

    fn newline(&mut self) -> Result<(), ProgramError> {
        self.line += 1;
        if self.levels.len() == 1 {
            *self.level() = Level::NEW;
            self.after_value = false;
            self.indentation()?;
        }
        Ok(())
    }

    /// Reads the spaces at the start of a line outside brackets.
    fn indentation(&mut self) -> Result<(), ProgramError> {
        let mut width = 0;
        while let Some(&byte) = self.bytes.get(self.at) {
            match byte {
                b' ' => width += 1,
                b'\t' => width += 8,
                b'\n' | b'\r' | b'#' => return Ok(()),
                _ => break,
            }
            self.at += 1;
        }
        while self.blocks.last().is_some_and(|&w| w > width) {
            self.blocks.pop();
        }
        if self.blocks.last().is_none_or(|&w| w < width) {
            self.blocks.push(width);
        }
        if self.blocks.len() > MAX_BLOCKS {
            let message = format!("blocks are nested more than {MAX_BLOCKS} deep");
            return Err(refused(self.line, message, "use functions"));
        }
        Ok(())
    }

    fn open(&mut self) -> Result<(), ProgramError> {
        if self.after_value {
            self.operator()?;
        }
        self.levels.push(Level::NEW);
        self.after_value = false;
        if self.levels.len() > MAX_BRACKETS + 1 {
            let message = format!("brackets are nested more than {MAX_BRACKETS} deep");
            return Err(refused(self.line, message, "give parts of the expression names"));
        }
        Ok(())
    }

    fn operator(&mut self) -> Result<(), ProgramError> {
        self.level().operators += 1;
        if self.level().operators > MAX_OPERATORS {
            let message = format!("more than {MAX_OPERATORS} operators in one expression");
            return Err(refused(self.line, message, "give parts of the expression names, or use sum() over a list"));
        }
        Ok(())
    }

    fn number(&mut self) {
        while self.bytes.get(self.at).is_some_and(|b| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_')) {
            let exponent = matches!(self.bytes[self.at], b'e' | b'E');
            self.at += 1;
            if exponent && matches!(self.bytes.get(self.at), Some(b'+' | b'-')) {
                self.at += 1;
            }
        }
        self.after_value = true;
    }

    fn word(&mut self) -> Result<(), ProgramError> {
        let start = self.at - 1;
        while self.bytes.get(self.at).is_some_and(|b| b.is_ascii_alphanumeric() || *b == b'_') {
            self.at += 1;
        }
        let word = &self.bytes[start..self.at];
        if !WORDS.iter().any(|w| w.as_bytes() == word) {
            self.after_value = true;
            return Ok(());
        }
        self.after_value = false;
        self.operator()?;
        if word == b"lambda" {
            self.level().lambdas += 1;
            if self.level().lambdas > MAX_LAMBDAS {
                let message = format!("more than {MAX_LAMBDAS} lambdas in one expression");
                return Err(refused(self.line, message, "use def"));
            }
        }
        Ok(())
    }

    /// Skips a string; an unended one reaches to the end of the line (of the program for a triple-quoted one), where
    /// the parser complains.
    fn string(&mut self, quote: u8) {
        let triple = self.bytes.get(self.at) == Some(&quote) && self.bytes.get(self.at + 1) == Some(&quote);
        if triple {
            self.at += 2;
        }
        while let Some(&byte) = self.bytes.get(self.at) {
            match byte {
                b'\\' => {
                    if self.bytes.get(self.at + 1) == Some(&b'\n') {
                        self.line += 1;
                    }
                    self.at += 1;
                }
                b'\n' if !triple => return,
                b'\n' => self.line += 1,
                b if b == quote && !triple => {
                    self.at += 1;
                    return;
                }
                b if b == quote && self.bytes[self.at..].starts_with(&[quote, quote, quote]) => {
                    self.at += 3;
                    return;
                }
                _ => {}
            }
            self.at += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused_with(source: &str, words: &str) {
        let error = prescan(source).unwrap_err();
        assert_eq!(error.kind, ErrorKind::Refused);
        assert!(error.message.contains(words), "{} for {words}", error.message);
    }

    #[test]
    fn nesting_that_would_overflow_a_stack_is_refused() {
        refused_with(&format!("x = {}1{}", "(".repeat(61), ")".repeat(61)), "brackets");
        refused_with(&format!("x = (1\n{})", "+1\n".repeat(200)), "operators");
        refused_with(&format!("x = {}1", "-".repeat(200)), "operators");
        refused_with(&format!("x = f{}", "()".repeat(150)), "operators");
        refused_with(&format!("x = (a\n{})", "[0]\n".repeat(150)), "operators");
        refused_with(&format!("x = (1\n{})", "+(1)\n".repeat(200)), "operators");
        refused_with(&format!("x = {}1", "lambda: ".repeat(9)), "lambdas");
        refused_with(&format!("x = {}1", "not ".repeat(90).repeat(2)), "bytes");
        let blocks: String = (0..50).map(|i| " ".repeat(i) + "if 1:\n").collect();
        refused_with(&blocks, "blocks");
        refused_with(&"x\n".repeat(2001), "lines");
        refused_with(&"#".repeat(MAX_BYTES + 1), "bytes");
        refused_with("x = 1\u{0}", "control");
    }

    #[test]
    fn long_lists_and_chains_are_legal() {
        let points: Vec<String> = (0..1500).map(|i| format!("({i} * 0.1 + 1, -{i}.5e-3),\n")).collect();
        prescan(&format!("P = [{}]", points.concat())).unwrap();
        prescan(&format!("x = f(1){}", ".at(1, 2, 3).turn(x = 4)".repeat(15))).unwrap();
        prescan("s = \"((((((\" + '''\n((([[[[''' # ((((\n").unwrap();
        assert_eq!(prescan(&format!("s = '''\n\n'''\nx = {}", "-".repeat(200))).unwrap_err().line, 4);
    }
}
