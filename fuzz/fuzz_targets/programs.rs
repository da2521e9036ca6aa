//! Modelling programs: the prescan and the parser on any bytes; what parses and is short runs with tiny limits.
#![no_main]

use harmony_program::{Inputs, Limits, check_syntax, evaluate};
use harmony_scene::Size;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let source = String::from_utf8_lossy(data);
    if check_syntax(&source).is_err() || source.len() > 4000 {
        return;
    }
    // What only the child process stops would stop the fuzzer: huge numbers and repetition.
    let digits = source.split(|c: char| !c.is_ascii_digit()).map(str::len).max().unwrap_or(0);
    if digits > 3 || source.contains("range") || source.contains("<<") || source.contains("replace") {
        return;
    }
    let limits = Limits { statements: 300, heap_bytes: 16 << 20, seconds: 1.0, cells: 500, ..Limits::default() };
    let inputs = Inputs::object(Size { width: 1.0, height: 0.8, depth: 0.6 });
    match evaluate(&source, &inputs, &limits) {
        Ok(tree) => {
            for (i, node) in tree.nodes.iter().enumerate() {
                assert!(node.kind.references().iter().all(|r| (r.0 as usize) < i), "children stand before parents");
                assert!(node.material.is_none_or(|m| (m as usize) < tree.materials.len()));
            }
            let text = serde_json::to_string(&tree).expect("a tree can be written");
            let back: harmony_shape::ShapeTree = serde_json::from_str(&text).expect("and read");
            assert_eq!(back.nodes.len(), tree.nodes.len());
        }
        Err(error) => {
            assert!(error.line as usize <= source.lines().count() + 1);
            assert_ne!(error.message, "the program made the interpreter give up");
        }
    }
});
