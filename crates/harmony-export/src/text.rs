//! Small pieces of text that several formats share.

/// A number with at most so many decimals, without needless zeros and without a negative zero.
pub(crate) fn num(value: f64, decimals: usize) -> String {
    let mut text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
    }
    if text == "-0" { "0".to_owned() } else { text }
}

/// Numbers with blanks between.
pub(crate) fn nums(values: &[f64], decimals: usize) -> String {
    values.iter().map(|v| num(*v, decimals)).collect::<Vec<_>>().join(" ")
}

/// Text inside XML, also inside attributes; characters that XML cannot hold are left out.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&apos;"),
            '\t' | '\n' | '\r' => out.push(' '),
            c if c < ' ' || c == '\u{fffe}' || c == '\u{ffff}' => {}
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_text_is_safe() {
        assert_eq!(num(1.5, 5), "1.5");
        assert_eq!(num(-1e-9, 4), "0");
        assert_eq!(num(120.0, 2), "120");
        assert_eq!(num(0.123_456_7, 4), "0.1235");
        assert_eq!(escaped("a<b & \"c\"\u{1}"), "a&lt;b &amp; &quot;c&quot;");
    }
}
