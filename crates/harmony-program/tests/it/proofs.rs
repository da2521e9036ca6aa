//! Whatever bytes come: an answer, no panic.

use harmony_program::{Inputs, Limits, check_syntax, evaluate};
use proptest::prelude::*;

fn small() -> Limits {
    Limits { statements: 5000, heap_bytes: 32 << 20, seconds: 1.0, ..Limits::default() }
}

/// Pieces of programs, put together without sense.
fn pieces() -> impl Strategy<Value = String> {
    let words = prop::sample::select(vec![
        "def build(w, h, d):\n    ",
        "return ",
        "box",
        "group",
        "(",
        ")",
        "[",
        "]",
        "{",
        "}",
        ",",
        ":",
        "\n",
        "\n    ",
        "w",
        "1",
        "0.5",
        "'a'",
        "\"",
        "'",
        "+",
        "-",
        "*",
        "/",
        "**",
        "=",
        "==",
        "<",
        "lambda x: ",
        "for i in range(3):",
        "if ",
        "else",
        "not ",
        ".at",
        ".size",
        "row",
        "mat",
        "sphere(1)",
        "spline",
        "line",
        "extrude(circle(1), 1)",
        "\\",
        "#",
        "f'{w}'",
        "while",
        "import math\n",
        "é",
        "\t",
        "None",
        "True",
        "surf(lambda u, v: (u, v, 0), 3, 3)",
        "vec(1, 2, 3)",
    ]);
    prop::collection::vec(words, 0..60).prop_map(|w| w.concat())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_never_panic_the_parser(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let _ = check_syntax(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn random_pieces_never_panic_and_errors_name_a_line_of_the_program(source in pieces()) {
        match evaluate(&source, &Inputs::default().with("w", 1.0).with("h", 1).with("d", 1), &small()) {
            Ok(tree) => prop_assert!(!tree.nodes.is_empty()),
            Err(error) => {
                prop_assert!(error.message != "the program made the interpreter give up", "{source}");
                prop_assert!(error.line as usize <= source.lines().count() + 1, "{error:?} of\n{source}");
            }
        }
    }
}
