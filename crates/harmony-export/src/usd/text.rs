//! The text form of USD: prims with metadata and attributes, indented by four blanks.

use std::fmt::Write as _;

use crate::text::num;

/// A layer as it grows.
#[derive(Debug, Default)]
pub(super) struct Text {
    out: String,
    depth: usize,
}

impl Text {
    pub fn new(header: &str) -> Self {
        Self { out: format!("#usda 1.0\n{header}\n"), depth: 0 }
    }

    pub fn line(&mut self, text: &str) {
        for _ in 0..self.depth {
            self.out.push_str("    ");
        }
        self.out.push_str(text);
        self.out.push('\n');
    }

    /// A prim with metadata lines; what `inside` writes is in it.
    pub fn prim(&mut self, kind: &str, name: &str, metadata: &[String], inside: impl FnOnce(&mut Self)) {
        if metadata.is_empty() {
            self.line(&format!("def {kind} \"{name}\""));
        } else {
            self.line(&format!("def {kind} \"{name}\" ("));
            self.depth += 1;
            for m in metadata {
                self.line(m);
            }
            self.depth -= 1;
            self.line(")");
        }
        self.line("{");
        self.depth += 1;
        inside(self);
        self.depth -= 1;
        self.line("}");
    }

    /// A prim of a layer below, of which something is said anew.
    pub fn over(&mut self, name: &str, inside: impl FnOnce(&mut Self)) {
        self.line(&format!("over \"{name}\""));
        self.line("{");
        self.depth += 1;
        inside(self);
        self.depth -= 1;
        self.line("}");
    }

    /// An array attribute whose elements are tuples.
    pub fn tuples<const N: usize>(
        &mut self,
        head: &str,
        values: impl Iterator<Item = [f64; N]>,
        decimals: usize,
        tail: &str,
    ) {
        let mut text = format!("{head} = [");
        for (k, v) in values.enumerate() {
            if k > 0 {
                text.push_str(", ");
            }
            text.push('(');
            for (i, x) in v.iter().enumerate() {
                if i > 0 {
                    text.push_str(", ");
                }
                text.push_str(&num(*x, decimals));
            }
            text.push(')');
        }
        text.push(']');
        text.push_str(tail);
        self.line(&text);
    }

    /// An array of whole numbers.
    pub fn whole(&mut self, head: &str, values: impl Iterator<Item = usize>) {
        let mut text = format!("{head} = [");
        for (k, v) in values.enumerate() {
            if k > 0 {
                text.push_str(", ");
            }
            let _ = write!(text, "{v}");
        }
        text.push(']');
        self.line(&text);
    }

    pub fn finish(self) -> String {
        self.out
    }
}

/// A tuple.
pub(super) fn tuple(values: &[f64], decimals: usize) -> String {
    format!("({})", values.iter().map(|v| num(*v, decimals)).collect::<Vec<_>>().join(", "))
}

/// A text in quotes.
pub(super) fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' | '\r' | '\t' => out.push(' '),
            c if c.is_control() => {}
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

/// Schemas applied to a prim.
pub(super) fn schemas(names: &[&str]) -> String {
    let names: Vec<String> = names.iter().map(|n| format!("\"{n}\"")).collect();
    format!("prepend apiSchemas = [{}]", names.join(", "))
}
