//! Habits of Python that the language lacks, and what to write instead.

/// A line without its strings and comment.
fn bare(line: &str) -> String {
    let mut out = String::new();
    let mut quote = None;
    for c in line.chars() {
        match (quote, c) {
            (None, '#') => break,
            (None, '"' | '\'') => {
                quote = Some(c);
                out.push(c);
            }
            (None, _) => out.push(c),
            (Some(q), _) if q == c => {
                quote = None;
                out.push(c);
            }
            _ => {}
        }
    }
    out
}

fn has_word(text: &str, word: &str) -> bool {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').any(|w| w == word)
}

/// Keywords and what to write instead of them.
const WORDS: [(&str, &str); 16] = [
    ("while", "no `while` here: use `for _ in range(200):` with `break`"),
    ("try", "no `try` here: test with `if` before"),
    ("except", "no `try` here: test with `if` before"),
    ("raise", "no `raise` here: fail(\"why\") ends the program"),
    ("class", "no `class` here: use functions, dicts or struct(a = 1)"),
    ("import", "nothing to import: math is there, chance is rng(seed), nothing else exists"),
    ("from", "nothing to import: math is there, chance is rng(seed), nothing else exists"),
    ("with", "no `with` here: there are no files"),
    ("yield", "no `yield` here: return a list"),
    ("nonlocal", "no `nonlocal` here: return the value, or keep it in a list"),
    ("global", "no `global` here: return the value, or keep it in a list"),
    ("assert", "no `assert` here: `if not ok: fail(\"why\")`"),
    ("del", "no `del` here: dict.pop(key), list.pop(i)"),
    ("is", "no `is` here: use == (also for None)"),
    ("async", "no `async` here"),
    ("match", "no `match` here: use if / elif"),
];

/// A hint for a line that does not parse.
pub(crate) fn for_syntax(line: &str, message: &str) -> Option<&'static str> {
    let text = bare(line);
    if let Some((_, hint)) = WORDS.iter().find(|(word, _)| has_word(&text, word)) {
        return Some(hint);
    }
    if text.contains("**") && !text.contains("**kw") {
        return Some("no `**` here: x * x, or math.pow(x, y)");
    }
    if text.contains(":=") {
        return Some("no `:=` here: assign on a line of its own");
    }
    if text.trim_start().starts_with('@') {
        return Some("no decorators here");
    }
    if chained(&text) {
        return Some("no chained comparison here: `0 < x and x < 2`");
    }
    if line.contains("f\"") || line.contains("f'") {
        return Some("f-strings take plain names only, no {x:.2f} and no {f(x)}: use str(round(x, 2)) and +");
    }
    let assignments = text.replace("==", "").replace("<=", "").replace(">=", "").replace("!=", "");
    if assignments.matches(" = ").count() > 1 && !assignments.contains('(') {
        return Some("one assignment a line: `a = 3`, then `b = a`");
    }
    if text.contains("\"\" \"\"") || text.contains("\"\"\"\"") || text.contains("'' ''") {
        return Some("texts are joined with +");
    }
    if text.contains(", *") && text.contains('=') {
        return Some("no starred assignment here: a, rest = list[0], list[1:]");
    }
    if text.contains('{') && text.contains(',') && !text.contains(':') {
        return Some("no {a, b} sets here: use a list or a dict");
    }
    if message.contains("indentation") {
        return Some("indent blocks by four spaces");
    }
    None
}

/// Whether two comparisons follow one another without `and`, `or` or a bracket between.
fn chained(text: &str) -> bool {
    text.split([',', '(', ')', '[', ']', ':']).any(|piece| {
        piece.split(" and ").flat_map(|p| p.split(" or ")).any(|p| {
            let p = p.replace("<=", "<").replace(">=", "<").replace("==", "<").replace("!=", "<").replace('>', "<");
            p.matches('<').count() > 1
        })
    })
}

/// A hint for what went wrong while running.
pub(crate) fn for_run(message: &str) -> Option<&'static str> {
    const PAIRS: [(&str, &str); 15] = [
        ("`isinstance`", "type(x) == \"int\" tells the type"),
        ("`random`", "chance is rng(seed): r = rng(1); r.uniform(a, b), r.pick(list), r.normal(m, s), r.int(a, b)"),
        ("`np`", "no numpy here: lists, vec(x, y, z), math"),
        ("`numpy`", "no numpy here: lists, vec(x, y, z), math"),
        ("`bpy`", "this is not Blender: call box(), lathe(), sweep(), ... and return group(...)"),
        ("`open`", "there are no files here"),
        ("`eval`", "no eval here"),
        ("`input`", "there is no input here: build(w, h, d) gets what it needs"),
        ("`time`", "there is no clock here"),
        ("`abs`", "abs is math.fabs"),
        ("Bad format", "only %s and %d here: str(round(x, 2))"),
        ("replacement field", "only %s and %d here: str(round(x, 2))"),
        ("format", "only %s and %d here: str(round(x, 2))"),
        ("referenced before assignment", "a name that is assigned in a function is its own: pass it as an argument"),
        ("stack overflow", "calls are nested too deep: use a loop"),
    ];
    let attribute = message.split("has no attribute `").nth(1).and_then(|rest| rest.split('`').next());
    match attribute {
        Some("size" | "top" | "min" | "max" | "centre" | "center") => {
            return Some(
                "of drape, fringe, scatter and against the size is known only when they are meshed: use your own numbers",
            );
        }
        Some("format") => return Some("no format(): str(round(x, 2)), or \"%s\" % x"),
        Some("append") => return Some("lists have append; to put parts together use group(...)"),
        _ => {}
    }
    if let Some((_, hint)) = PAIRS.iter().find(|(key, _)| message.contains(key)) {
        return Some(hint);
    }
    if message.contains("not supported for types `tuple`") || message.contains("not supported for types `list`") {
        return Some("a tuple is no vector: vec(x, y, z) can be added and multiplied");
    }
    if message.contains("not supported for types `string`") {
        return Some("str(x) makes a text of a number");
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hints_meet_the_line_and_not_its_texts() {
        assert!(for_syntax("    while x < 3:", "").unwrap().contains("range"));
        assert!(for_syntax("x = 2 ** 3", "").unwrap().contains("math.pow"));
        assert!(for_syntax("if 0 < x < 2:", "").unwrap().contains("and"));
        assert!(for_syntax("x = f\"{y:.2f}\"", "").unwrap().contains("round"));
        assert!(for_syntax("a = b = 3", "").unwrap().contains("one assignment"));
        assert!(for_syntax("s = {1, 2}", "").unwrap().contains("sets"));
        assert_eq!(for_syntax("x = (\"while\"", ""), None);
        assert_eq!(for_syntax("if a < b and b < c:", ""), None);
    }
}
