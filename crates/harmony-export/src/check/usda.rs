//! The text form of USD as prims with attributes: what this program writes, and a good part of what others do.
//!
//! Numbers of arrays and tuples are flattened; metadata of attributes, variants and relocations are passed over.

use std::collections::BTreeMap;

/// Deepest nesting that is read.
const DEEPEST: usize = 64;

/// A value.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    /// Numbers, flattened; also a single one, and booleans as 0 and 1.
    Numbers(Vec<f64>),
    /// Texts, paths and names.
    Texts(Vec<String>),
}

/// A prim.
#[derive(Debug, Clone, Default)]
pub(super) struct Prim {
    pub kind: String,
    pub name: String,
    pub metadata: BTreeMap<String, Value>,
    pub attributes: BTreeMap<String, Value>,
    pub children: Vec<Prim>,
}

impl Prim {
    pub fn numbers(&self, name: &str) -> Option<&[f64]> {
        match self.attributes.get(name) {
            Some(Value::Numbers(n)) => Some(n),
            _ => None,
        }
    }

    pub fn number(&self, name: &str) -> Option<f64> {
        self.numbers(name).and_then(|n| n.first().copied())
    }

    pub fn text(&self, name: &str) -> Option<&str> {
        match self.attributes.get(name) {
            Some(Value::Texts(t)) => t.first().map(String::as_str),
            _ => None,
        }
    }

    pub fn child(&self, name: &str) -> Option<&Prim> {
        self.children.iter().find(|c| c.name == name)
    }

    pub fn applies(&self, schema: &str) -> bool {
        matches!(self.metadata.get("apiSchemas"), Some(Value::Texts(t)) if t.iter().any(|s| s == schema))
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Token<'a> {
    Word(&'a str),
    Text(&'a str),
    Mark(char),
    Line,
    End,
}

struct Reader<'a> {
    text: &'a str,
    at: usize,
}

type Read<T> = Result<T, String>;

impl<'a> Reader<'a> {
    fn next(&mut self) -> Read<Token<'a>> {
        let bytes = self.text.as_bytes();
        while let Some(b) = bytes.get(self.at) {
            match b {
                b'\n' => {
                    self.at += 1;
                    return Ok(Token::Line);
                }
                b' ' | b'\t' | b'\r' | b';' => self.at += 1,
                b'#' => {
                    while bytes.get(self.at).is_some_and(|b| *b != b'\n') {
                        self.at += 1;
                    }
                }
                b'"' => return self.until(b'"').map(Token::Text),
                b'@' => return self.until(b'@').map(Token::Text),
                b'<' => return self.until(b'>').map(Token::Text),
                b'(' | b')' | b'[' | b']' | b'{' | b'}' | b'=' | b',' => {
                    self.at += 1;
                    return Ok(Token::Mark(char::from(*b)));
                }
                _ => {
                    let start = self.at;
                    while bytes.get(self.at).is_some_and(|b| !b" \t\r\n;()[]{}=,\"@<".contains(b)) {
                        self.at += 1;
                    }
                    // The type of an array is one word: `point3f[]`.
                    if self.text[self.at..].starts_with("[]") {
                        self.at += 2;
                    }
                    return Ok(Token::Word(&self.text[start..self.at]));
                }
            }
        }
        Ok(Token::End)
    }

    fn until(&mut self, end: u8) -> Read<&'a str> {
        let bytes = self.text.as_bytes();
        let start = self.at + 1;
        let mut at = start;
        while let Some(b) = bytes.get(at) {
            if *b == b'\\' && end == b'"' {
                at += 2;
            } else if *b == end {
                self.at = at + 1;
                return Ok(&self.text[start..at]);
            } else {
                at += 1;
            }
        }
        Err(format!("a text that begins at byte {start} does not end"))
    }

    fn peek(&mut self) -> Read<Token<'a>> {
        let at = self.at;
        let token = self.next();
        self.at = at;
        token
    }

    fn skip_lines(&mut self) -> Read<()> {
        while self.peek()? == Token::Line {
            self.next()?;
        }
        Ok(())
    }

    /// Statements until a closing mark.
    fn body(&mut self, prim: &mut Prim, end: char, depth: usize) -> Read<()> {
        if depth > DEEPEST {
            return Err(format!("nested more than {DEEPEST} deep"));
        }
        let mut words: Vec<&str> = Vec::new();
        loop {
            match self.next()? {
                Token::Mark(m) if m == end => return Ok(()),
                Token::End if end == '\0' => return Ok(()),
                Token::End => return Err("the layer ends early".to_owned()),
                Token::Line => words.clear(),
                Token::Word(w) => words.push(w),
                Token::Text(name) if matches!(words.first(), Some(&("def" | "over" | "class"))) => {
                    let mut child = Prim {
                        kind: words.get(1).copied().unwrap_or("").to_owned(),
                        name: name.to_owned(),
                        ..Prim::default()
                    };
                    self.skip_lines()?;
                    if self.peek()? == Token::Mark('(') {
                        self.next()?;
                        let mut meta = Prim::default();
                        self.body(&mut meta, ')', depth + 1)?;
                        child.metadata = meta.attributes;
                        self.skip_lines()?;
                    }
                    if self.next()? != Token::Mark('{') {
                        return Err(format!("prim {name} has no body"));
                    }
                    self.body(&mut child, '}', depth + 1)?;
                    prim.children.push(child);
                    words.clear();
                }
                Token::Mark('=') => {
                    let name = words.last().copied().unwrap_or("").to_owned();
                    if let Some(value) = self.value(depth + 1)? {
                        prim.attributes.insert(name, value);
                    }
                    words.clear();
                    if self.peek()? == Token::Mark('(') {
                        self.next()?;
                        self.body(&mut Prim::default(), ')', depth + 1)?;
                    }
                }
                // A text alone is a comment of the layer.
                Token::Text(_) | Token::Mark(',') => {}
                Token::Mark(m) => return Err(format!("{m:?} is not expected at byte {}", self.at)),
            }
        }
    }

    fn value(&mut self, depth: usize) -> Read<Option<Value>> {
        let one = |w: &str| match w {
            "true" => Some(1.0),
            "false" => Some(0.0),
            w => w.parse::<f64>().ok(),
        };
        match self.next()? {
            Token::Word(w) => {
                Ok(Some(one(w).map_or_else(|| Value::Texts(vec![w.to_owned()]), |n| Value::Numbers(vec![n]))))
            }
            Token::Text(t) => Ok(Some(Value::Texts(vec![t.to_owned()]))),
            Token::Mark('{') => {
                self.body(&mut Prim::default(), '}', depth + 1)?;
                Ok(None)
            }
            Token::Mark('[' | '(') => {
                let (mut numbers, mut texts, mut open) = (Vec::new(), Vec::new(), 1);
                while open > 0 {
                    match self.next()? {
                        Token::Mark('[' | '(') => open += 1,
                        Token::Mark(']' | ')') => open -= 1,
                        Token::Mark(',') | Token::Line => {}
                        Token::Word(w) => match one(w) {
                            Some(n) => numbers.push(n),
                            None => texts.push(w.to_owned()),
                        },
                        Token::Text(t) => texts.push(t.to_owned()),
                        t => return Err(format!("{t:?} is not expected in a value")),
                    }
                }
                Ok(Some(if texts.is_empty() { Value::Numbers(numbers) } else { Value::Texts(texts) }))
            }
            t => Err(format!("{t:?} is no value")),
        }
    }
}

/// Reads a layer: a prim without a name that holds the layer's prims; its metadata are the layer's.
pub(super) fn read(text: &str) -> Read<Prim> {
    if !text.starts_with("#usda") {
        return Err("this is no USD text".to_owned());
    }
    let mut reader = Reader { text, at: 0 };
    let mut layer = Prim::default();
    reader.skip_lines()?;
    if reader.peek()? == Token::Mark('(') {
        reader.next()?;
        let mut meta = Prim::default();
        reader.body(&mut meta, ')', 0)?;
        layer.metadata = meta.attributes;
    }
    reader.body(&mut layer, '\0', 0)?;
    Ok(layer)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_layer_by_hand_is_understood() {
        let text = r#"#usda 1.0
(
    "A note"
    defaultPrim = "World"
    upAxis = "Z"
)

def Xform "World" (
    kind = "assembly"
    prepend apiSchemas = ["A", "B"]
    customData = {
        string label = "a {b}"
    }
)
{
    token outputs:surface
    double3 xformOp:translate = (1, 2.5, -3e-1)
    point3f[] points = [(0, 0, 0), (1, 0, 0)] (
        interpolation = "vertex"
    )
    rel material:binding = </World/Looks/x>
    def Mesh "m"
    {
        int[] n = [1,
            2]
    }
}
"#;
        let layer = read(text).unwrap();
        assert_eq!(layer.metadata["upAxis"], Value::Texts(vec!["Z".to_owned()]));
        let world = layer.child("World").unwrap();
        assert_eq!(world.numbers("xformOp:translate").unwrap(), [1.0, 2.5, -0.3]);
        assert_eq!(world.numbers("points").unwrap().len(), 6);
        assert!(world.applies("B") && !world.applies("C"));
        assert_eq!(world.text("material:binding"), Some("/World/Looks/x"));
        assert_eq!(world.child("m").unwrap().numbers("n").unwrap(), [1.0, 2.0]);
        assert_eq!(world.kind, "Xform");
    }

    #[test]
    fn deep_nesting_is_an_error() {
        let text = format!("#usda 1.0\n{}", "def A \"a\" {\n".repeat(10_000));
        assert!(read(&text).unwrap_err().contains("deep"));
    }

    proptest! {
        #[test]
        fn no_text_makes_the_reader_panic(text in "[ -~\n\u{e4}]{0,200}") {
            let _ = read(&format!("#usda 1.0\n{text}"));
        }
    }
}
