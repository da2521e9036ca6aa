//! Programs that would harm the machine: each ends in an error, soon, and only in the child.

use std::time::{Duration, Instant};

use harmony_program::{ChildCommand, ErrorKind, Limits, ProgramError, run};

use super::{child, object};

fn tight() -> Limits {
    Limits { cpu_seconds: 2, seconds: 1.5, wall_seconds: 8.0, ..Limits::default() }
}

fn bomb(body: &str) -> ProgramError {
    bomb_within(body, &tight())
}

fn bomb_within(body: &str, limits: &Limits) -> ProgramError {
    let source = format!("def f(x):\n    return f(x)\n\ndef build(w, h, d):\n{body}\n    return box((1, 1, 1))\n");
    let started = Instant::now();
    let error = run(&source, &object(), limits, &child()).expect_err(body);
    assert!(started.elapsed() < Duration::from_secs(10), "{body} took {:?}", started.elapsed());
    assert!(matches!(error.kind, ErrorKind::Limit | ErrorKind::Refused), "{body}: {error:?}");
    error
}

#[test]
fn endless_loops_end() {
    bomb("    for i in range(1000000000):\n        pass");
    bomb("    for i in range(2000000000):\n        for j in range(2000000000):\n            pass");
    bomb("    x = max(range(1000000000))");
    bomb("    x = sorted(range(20000000), key = lambda a: -a)");
    bomb("    x = [i for i in range(1000000000)]");
}

#[test]
fn endless_recursion_ends() {
    bomb("    f(1)");
    bomb("    g = lambda s: s(s)\n    g(g)");
}

#[test]
fn big_allocations_end() {
    let error = bomb("    x = [0] * 2000000000");
    assert_eq!(error.line, 5, "{error:?}");
    bomb("    x = [1]\n    for i in range(40):\n        x = x + x");
    bomb("    x = 'a'\n    for i in range(40):\n        x = x + x");
    bomb("    x = 'x' * 2000000000");
    bomb("    x = 'a' * 1000\n    for i in range(6):\n        x = x.replace('a', 'a' * 1000)");
    bomb("    x = {}\n    for i in range(100000000):\n        x[i] = str(i)");
    bomb("    x = (1, 2) * 900000000");
    bomb("    x = []\n    x.extend(range(2000000000))");
}

#[test]
fn big_numbers_end() {
    let error = bomb("    x = 3\n    for i in range(60):\n        x = x * x");
    assert_eq!(error.kind, ErrorKind::Limit);
    // Refused by the language or stopped by the cage.
    let source = "def build():\n    x = 1 << 2000000000\n    return box((1, 1, 1))\n";
    assert!(run(source, &object(), &tight(), &child()).is_err());
}

#[test]
fn too_many_parts_are_refused_with_the_number() {
    // In the time that programs really have: a slow machine must not get to it first.
    let counted = |body| bomb_within(body, &Limits::default());
    let many = counted("    a = box((1, 1, 1))\n    for i in range(100000):\n        a = box((1, 1, 1), bevel = 0.1)");
    assert!(many.message.contains("20000"), "{many}");
    let copies = counted(
        "    a = row(box((0.01, 0.01, 0.01)), 300)\n    for i in range(9):\n        a = row(a, 300, step = 0.001)",
    );
    assert!(copies.message.contains("copies"), "{copies}");
    let points = counted("    for i in range(100000):\n        c = spline([(j, i % 7, j % 3) for j in range(90)])");
    assert!(points.message.contains("points"), "{points}");
    let cells = counted("    for i in range(9):\n        s = surf(lambda u, v: (u, v, 0), 200, 200)");
    assert!(cells.message.contains("cells"), "{cells}");
    let triangles = counted("    a = tuft(cushion((1, 1, 1)))\n    b = row(a, 5000, step = 0.001)");
    assert!(triangles.message.contains("triangles"), "{triangles}");
    let cloth = counted("    for i in range(50):\n        a = drape(2, 2, box((1, 1, 1)))");
    assert!(cloth.message.contains("cloth"), "{cloth}");
    bomb("    x = seq(0, 1e9, 1e-3)");
    bomb("    x = text('m' * 100000, 0.1)");
}

#[test]
fn deep_sources_are_refused_before_they_are_parsed() {
    for body in [
        format!("    x = {}1{}", "(".repeat(150), ")".repeat(150)),
        format!("    x = {}1{}", "(\n".repeat(1000), ")\n".repeat(900)),
        format!("    x = (1{})", "\n+1".repeat(1900)),
        format!("    x = {}1", "-".repeat(350)),
        format!("    x = ({}1)", "lambda:\n".repeat(1500)),
        format!("    x = [{}]", "1,\n".repeat(3000)),
    ] {
        assert_eq!(bomb(&body).kind, ErrorKind::Refused);
    }
}

#[test]
fn things_that_hold_themselves_end() {
    let source = "def build():\n    x = []\n    x.append(x)\n    return group('a', parts = x)\n";
    assert!(run(source, &object(), &tight(), &child()).is_err());
    let source = "def build():\n    x = {}\n    x['a'] = x\n    return template('chair', size = (1, 1, 1), legs = x)\n";
    assert!(run(source, &object(), &tight(), &child()).is_err());
}

#[test]
fn nothing_of_the_machine_is_there() {
    for body in [
        "open('/etc/passwd')",
        "load('//x', 'y')",
        "print(os.environ)",
        "eval('1')",
        "exec('1')",
        "time()",
        "__import__('os')",
    ] {
        let source = format!("def build():\n    {body}\n    return box((1, 1, 1))\n");
        let error = run(&source, &object(), &tight(), &child()).expect_err(body);
        assert!(matches!(error.kind, ErrorKind::Run | ErrorKind::Syntax), "{error:?}");
    }
}

#[test]
fn a_child_that_is_no_child_is_an_error_and_not_a_hang() {
    let source = "def build():\n    return box((1, 1, 1))\n";
    let missing = ChildCommand { program: "/nowhere/harmony".into(), args: Vec::new() };
    assert_eq!(run(source, &object(), &tight(), &missing).unwrap_err().kind, ErrorKind::Cage);
    #[cfg(unix)]
    {
        let sleeper = ChildCommand { program: "/bin/sleep".into(), args: vec!["60".into()] };
        let short = Limits { wall_seconds: 0.3, ..tight() };
        let started = Instant::now();
        assert_eq!(run(source, &object(), &short, &sleeper).unwrap_err().kind, ErrorKind::Limit);
        assert!(started.elapsed() < Duration::from_secs(3));
        let talker = ChildCommand { program: "/bin/cat".into(), args: vec!["/dev/zero".into()] };
        let few = Limits { output_bytes: 1 << 20, ..tight() };
        assert_eq!(run(source, &object(), &few, &talker).unwrap_err().kind, ErrorKind::Limit);
    }
}
