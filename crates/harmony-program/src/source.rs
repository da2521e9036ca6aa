//! The source as the parser gets it: imports that need not be there are taken out, lines keep their numbers.

/// Modules whose import is a habit and does no harm: what of them exists is there anyway.
const KNOWN: [&str; 4] = ["math", "random", "typing", "__future__"];

/// Blanks lines such as `import math` and `from math import *`, and joins nothing: line numbers stay.
pub fn without_imports(source: &str) -> String {
    let mut out = String::with_capacity(source.len());
    for line in source.split_inclusive('\n') {
        let text = line.trim();
        let text = text.split('#').next().unwrap_or(text).trim_end().trim_end_matches(';');
        let named = |m: &str| KNOWN.contains(&m.trim());
        let drop = match (text.strip_prefix("import "), text.strip_prefix("from ")) {
            (Some(rest), _) => rest.split(',').all(named),
            (_, Some(rest)) => rest.split_once(" import ").is_some_and(|(module, _)| named(module)),
            _ => false,
        };
        if drop {
            // Inside a block a statement has to stay.
            let indent: String = line.chars().take_while(|c| matches!(c, ' ' | '\t')).collect();
            if !indent.is_empty() {
                out.push_str(&indent);
                out.push_str("pass");
            }
            if line.ends_with('\n') {
                out.push('\n');
            }
        } else {
            out.push_str(line);
        }
    }
    out.replace("\r\n", "\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imports_go_and_lines_stay() {
        let source = "import math\nfrom math import *  # all\nimport math, random\nimport os\ndef f():\n    import math\n    return 1\n";
        let out = without_imports(source);
        assert_eq!(out, "\n\n\nimport os\ndef f():\n    pass\n    return 1\n");
    }
}
