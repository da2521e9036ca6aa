//! HTML text. Everything that did not come from this crate's own string literals goes through [`esc`].

use std::fmt::Write;

use harmony_scene::Warning;

/// Text as HTML text or as the value of an attribute in double quotes.
pub(crate) fn esc(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // Control characters have no place in HTML; neither have overrides of the writing direction, which could
            // make a text read as something else.
            '\n' | '\t' => out.push(' '),
            c if c.is_control() => {}
            '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => {}
            c => out.push(c),
        }
    }
    out
}

/// JSON that can stand inside a `<script type="application/json">` element.
pub(crate) fn script_json<T: serde::Serialize>(value: &T) -> Result<String, serde_json::Error> {
    // In JSON these characters occur inside strings only, where the escapes mean the same.
    Ok(serde_json::to_string(value)?
        .replace('<', "\\u003c")
        .replace('>', "\\u003e")
        .replace('&', "\\u0026")
        .replace('\u{2028}', "\\u2028")
        .replace('\u{2029}', "\\u2029"))
}

/// `good`, `fair` or `poor` for a share between 0 and 1.
pub(crate) fn grade(share: f64) -> &'static str {
    match share {
        s if s >= 0.7 => "good",
        s if s >= 0.4 => "fair",
        _ => "poor",
    }
}

/// A bar with a number, for a confidence between 0 and 1.
pub(crate) fn meter(share: Option<f64>, because: &str) -> String {
    let because = if because.is_empty() { String::new() } else { format!(" <small>{}</small>", esc(because)) };
    match share.filter(|s| s.is_finite()) {
        Some(s) => {
            let s = s.clamp(0.0, 1.0);
            format!(
                "<div class=\"{0}\"><div class=\"meter\" role=\"img\" aria-label=\"confidence {1:.0} percent\"><i \
                 style=\"width:{1:.0}%\"></i></div></div><p><b class=\"{0}\">{1:.0} %</b> confidence{2}</p>",
                grade(s),
                s * 100.0,
                because
            )
        }
        None if because.is_empty() => String::new(),
        None => format!("<p>{because}</p>"),
    }
}

/// Rows of a definition list.
#[derive(Default)]
pub(crate) struct Facts(String);

impl Facts {
    pub(crate) fn add(&mut self, name: &str, value: &str) -> &mut Self {
        self.add_noted(name, value, "")
    }

    pub(crate) fn add_noted(&mut self, name: &str, value: &str, note: &str) -> &mut Self {
        if !value.is_empty() {
            let note = if note.is_empty() { String::new() } else { format!(" <small>{}</small>", esc(note)) };
            let _ = write!(self.0, "<dt>{}</dt><dd>{}{note}</dd>", esc(name), esc(value));
        }
        self
    }

    pub(crate) fn add_all(&mut self, facts: &[crate::Fact]) -> &mut Self {
        for f in facts {
            self.add_noted(&f.name, &f.value, &f.note);
        }
        self
    }

    pub(crate) fn html(&self, class: &str) -> String {
        if self.0.is_empty() { String::new() } else { format!("<dl class=\"{class}\">{}</dl>", self.0) }
    }
}

/// A list of warnings.
pub(crate) fn warnings<'a>(list: impl Iterator<Item = &'a Warning>, with_object: bool) -> String {
    let mut items = String::new();
    for w in list {
        let object = match &w.object {
            Some(id) if with_object => format!("<b>{}</b>: ", esc(id.as_str())),
            _ => String::new(),
        };
        let _ = write!(items, "<li>{object}{}</li>", esc(&w.message));
    }
    if items.is_empty() { String::new() } else { format!("<ul class=\"warnings\">{items}</ul>") }
}

/// Seconds as a person says them.
pub(crate) fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 0.0 {
        return String::new();
    }
    match seconds {
        s if s < 10.0 => format!("{s:.1} s"),
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min {:02.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
        s => format!("{:.0} h {:02.0} min", (s / 3600.0).floor(), (s / 60.0 % 60.0).floor()),
    }
}

/// US dollars.
pub(crate) fn dollars(cost: f64) -> String {
    let cost = cost + 0.0; // the sum of nothing is -0
    if cost > 0.0 && cost < 0.095 { format!("${cost:.3}") } else { format!("${cost:.2}") }
}

/// A whole number with thin spaces between thousands.
pub(crate) fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (k, c) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_a_text_can_become_markup() {
        assert_eq!(
            esc("<script>alert(\"1\" & '2')</script>\u{0}\u{202e}"),
            "&lt;script&gt;alert(&quot;1&quot; &amp; &#39;2&#39;)&lt;/script&gt;"
        );
        let json = script_json(&serde_json::json!({ "a": "</script><!--\u{2028}" })).unwrap();
        assert!(!json.contains('<') && !json.contains('>') && !json.contains('\u{2028}'));
        let back: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(back["a"], "</script><!--\u{2028}");
    }

    #[test]
    fn numbers_read_well() {
        assert_eq!(duration(3.12), "3.1 s");
        assert_eq!(duration(125.0), "2 min 05 s");
        assert_eq!(duration(3.0 * 3600.0 + 600.0), "3 h 10 min");
        assert_eq!(duration(f64::NAN), "");
        assert_eq!((dollars(0.0), dollars(0.0123), dollars(1.5)), ("$0.00".into(), "$0.012".into(), "$1.50".into()));
        assert_eq!(dollars(std::iter::empty::<f64>().sum()), "$0.00");
        assert_eq!(grouped(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(grouped(12), "12");
        assert!(meter(Some(f64::NAN), "").is_empty());
        assert!(meter(Some(7.0), "").contains("100 %"));
    }
}
