//! What whoever wrote a program is told.

use harmony_program::{ErrorKind, Inputs, Limits, evaluate};

use super::{fails, returning};

/// Source, line, words of the message, words of the hint.
fn told(source: &str, line: u32, message: &str, hint: &str) {
    let error = fails(source);
    assert!(error.line == line && error.message.contains(message), "{source}\n{error:?}");
    assert!(error.hint.as_deref().unwrap_or_default().contains(hint), "{source}\n{error:?}");
}

#[test]
fn habits_of_python_get_a_hint() {
    told("def build(w):\n    i = 0\n    while i < 3:\n        i += 1\n", 3, "while", "range(200)");
    told("def build(w):\n    a = 2 ** 3\n", 2, "", "math.pow");
    told("def build(w):\n    if 0 < w < 2:\n        pass\n", 2, "", "and");
    told("try:\n    x = 1\nexcept:\n    x = 2\n", 1, "", "no `try`");
    told("class A:\n    x = 1\n", 1, "", "no `class`");
    told("import os\ndef build():\n    return 1\n", 1, "", "nothing to import");
    told("def build(w):\n    with open('x') as f:\n        pass\n", 2, "", "no files");
    told("def build(w):\n    s = f'{w:.2f}'\n    return s\n", 2, "", "round");
    told("def build(w):\n    a = b = 3\n", 2, "", "one assignment");
    told("def build(w):\n    assert w > 0\n", 2, "", "fail");
    told("def build(w):\n    s = {1, 2}\n", 2, "", "sets");
    told("def build(w):\n    return isinstance(w, int)\n", 2, "isinstance", "type(x)");
    told("def build(w):\n    return np.array([1])\n", 2, "np", "numpy");
    told("def build(w):\n    x = '{:.2f}'.format(w)\n    return x\n", 2, "", "round");
    told("def build(w):\n    return (1, 2, 3) - (0, 1, 0)\n", 2, "", "vec(");
}

#[test]
fn imports_of_habit_do_no_harm_and_lines_stay() {
    let source = "import math\nfrom math import *\nimport random\ndef build(w):\n    return box((w, math.sqrt(4), 1), bevle = 1)\n";
    told(source, 5, "did you mean `bevel`", "box(size, bevel=0");
}

#[test]
fn arguments_are_told_by_name_with_what_is_allowed() {
    told(&returning("box((1, 2))"), 2, "`size` is a tuple of 2", "box(size");
    told(&returning("box()"), 2, "needs `size`", "box(size");
    told(&returning("box((1, 1, 0))"), 2, "`size`", "");
    told(&returning("box((1, 1, 1e9))"), 2, "`size`", "");
    told(&returning("sphere('big')"), 2, "\"big\"", "sphere(r");
    told(&returning("plant('bsh', 1, 1)"), 2, "did you mean \"bush\"", "");
    told(&returning("box((1, 1, 1), mat = 'redd')"), 2, "colour", "");
    told(&returning("lathe([(-1, 0), (1, 1)])"), 2, "radius -1", "radius");
    told(&returning("mesh([(0, 0, 0)], [(0, 1, 2)])"), 2, "point 1 of 1", "from 0");
    told(&returning("box((1, 1, 1)) + box((1, 1, 1))"), 2, "part + part", "group()");
    told(&returning("group('x')"), 2, "without parts", "group(");
    told(&returning("cylindre(1, 2)"), 2, "cylindre", "cylinder");
    told(&returning("pixel(1, 2, on = 3)"), 2, "camera", "metres");
    told(&returning("wall('left')"), 2, "room", "origin");
    told(&returning("math.sqrt(-1)"), 2, "from 0", "math.sqrt");
}

#[test]
fn only_closed_solids_are_cut_and_the_open_one_is_named() {
    let source = "def build():\n    c = hang(1, 2, name = 'curtain')\n    b = box((1, 1, 1))\n    return cut(b, c)\n";
    told(source, 4, "`curtain` of line 2", "cushion");
    told(&returning("tuft(sphere(0.3))"), 2, "cushion", "tuft(cushion");
}

#[test]
fn a_size_that_nobody_knows_yet_is_told_so() {
    told(&returning("drape(1, 1, box((1, 1, 1))).size"), 2, "size", "meshed");
}

#[test]
fn a_fault_in_a_function_names_its_caller() {
    let source = "def leg(x):\n    return box((x, 1))\n\ndef build():\n    return leg(1)\n";
    let error = fails(source);
    assert_eq!(error.line, 2);
    assert!(error.message.contains("called from line 5"), "{error}");
    assert!(error.explain(source).contains("\n    return box((x, 1))\nhint: box(size"), "{}", error.explain(source));
}

#[test]
fn build_must_be_there_take_what_is_given_and_give_a_part() {
    told("x = 1\n", 0, "no build", "def build");
    told("build = 3\n", 0, "not a function", "def build");
    told("def build(w, reach):\n    return box((w, w, w))\n", 1, "`reach`", "default");
    told("def build():\n    return 3\n", 1, "int", "group(");
    told("def build():\n    box((1, 1, 1))\n", 1, "None", "group(");
    told("def build():\n    fail('no room for it')\n", 2, "no room for it", "");
}

#[test]
fn a_loop_that_is_too_long_says_so() {
    let limits = Limits { statements: 10_000, ..Limits::default() };
    // `pass` is no statement to the interpreter: a loop of nothing else is ended by the child's clock.
    let source = "def build():\n    for i in range(1000000):\n        x = i\n    return box((1, 1, 1))\n";
    let error = evaluate(source, &Inputs::default(), &limits).unwrap_err();
    assert_eq!((error.kind, error.line), (ErrorKind::Limit, 3), "{error:?}");
}
