//! The interpreter: source and inputs in, shape tree or error out, in this process.

use std::sync::{Arc, LazyLock};
use std::time::Duration;

use harmony_shape::ShapeTree;
use starlark::PrintHandler;
use starlark::codemap::FileSpanRef;
use starlark::docs::{DocItem, DocMember};
use starlark::environment::{Globals, GlobalsBuilder, LibraryExtension, Module};
use starlark::eval::{BeforeStmtFuncDyn, Evaluator};
use starlark::syntax::{AstModule, Dialect, DialectTypes};
use starlark::values::{Heap, Value};

use crate::error::{Complaint, ErrorKind, Failure, ProgramError};
use crate::inputs::{Inputs, Limits};
use crate::prescan::prescan;
use crate::session::Session;
use crate::source::without_imports;
use crate::thing::{self, Kind, Thing};
use crate::{functions, hints};

/// Stack of the thread that parses and runs: the second line behind the prescan.
const STACK: usize = 256 << 20;

static GLOBALS: LazyLock<Globals> = LazyLock::new(|| {
    let extensions =
        [LibraryExtension::StructType, LibraryExtension::Map, LibraryExtension::Filter, LibraryExtension::Print];
    GlobalsBuilder::extended_by(&extensions).with(functions::register).build()
});

/// What is told about the statement that runs.
pub(crate) type Progress = Arc<dyn Fn(u32) + Send + Sync>;

const DIALECT: Dialect = Dialect {
    enable_f_strings: true,
    enable_types: DialectTypes::ParseOnly,
    enable_load: false,
    enable_load_reexport: false,
    ..Dialect::Extended
};

/// Runs a program in this process and gives its tree.
///
/// The interpreter's limits do not hold against hostile programs (one big allocation, one endless operation on big
/// integers): for text of a model use [`crate::run`]. Same source, same inputs: same tree.
///
/// # Errors
/// [`ProgramError`] with line and hint.
pub fn evaluate(source: &str, inputs: &Inputs, limits: &Limits) -> Result<ShapeTree, ProgramError> {
    evaluate_with(source, inputs, limits, None)
}

pub(crate) fn evaluate_with(
    source: &str,
    inputs: &Inputs,
    limits: &Limits,
    progress: Option<Progress>,
) -> Result<ShapeTree, ProgramError> {
    prescan(source)?;
    let text = without_imports(source);
    std::thread::scope(|scope| {
        let work = || interpret(source, text, inputs, limits, progress);
        let thread = std::thread::Builder::new().name("program".to_owned()).stack_size(STACK).spawn_scoped(scope, work);
        match thread.map(std::thread::ScopedJoinHandle::join) {
            Ok(Ok(result)) => result,
            Ok(Err(_)) => Err(ProgramError::new(ErrorKind::Limit, 0, "the program made the interpreter give up")
                .with_hint("it most likely makes a very large list or text")),
            Err(error) => Err(ProgramError::new(ErrorKind::Cage, 0, format!("no thread: {error}"))),
        }
    })
}

/// Only reads a program: prescan and parser, nothing runs.
///
/// # Errors
/// [`ErrorKind::Refused`] or [`ErrorKind::Syntax`].
pub fn check_syntax(source: &str) -> Result<(), ProgramError> {
    prescan(source)?;
    let text = without_imports(source);
    let work = move || parse(source, text).map(|_| ());
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().stack_size(STACK).spawn_scoped(scope, work);
        match thread.map(std::thread::ScopedJoinHandle::join) {
            Ok(Ok(result)) => result,
            _ => Err(ProgramError::new(ErrorKind::Syntax, 0, "the parser gave up")),
        }
    })
}

fn parse(source: &str, text: String) -> Result<AstModule, ProgramError> {
    AstModule::parse("program", text, &DIALECT).map_err(|e| explained(&e, source, true))
}

struct Silent;

impl PrintHandler for Silent {
    fn println(&self, _text: &str) -> starlark::Result<()> {
        Ok(())
    }
}

fn interpret(
    source: &str,
    text: String,
    inputs: &Inputs,
    limits: &Limits,
    progress: Option<Progress>,
) -> Result<ShapeTree, ProgramError> {
    let ast = parse(source, text)?;
    let session = Session::new(inputs.clone(), limits.clone());
    let end = spent() + Duration::from_secs_f64(limits.seconds.clamp(0.01, 3600.0));
    let module = Module::new();
    let mut eval = Evaluator::new(&module);
    eval.extra = Some(&session);
    // Natives hold values while functions of the program run; a heap this small needs no collection.
    eval.disable_gc();
    eval.set_print_handler(&Silent);
    eval.set_max_callstack_size(limits.depth.max(1) as usize)
        .map_err(|e| ProgramError::new(ErrorKind::Cage, 0, e.to_string()))?;
    let guard: Box<dyn BeforeStmtFuncDyn<'_, '_>> =
        Box::new(Guard { statements: 0, most: limits.statements, heap_bytes: limits.heap_bytes, end, progress });
    eval.before_stmt_for_dap(guard.into());
    eval.eval_module(ast, &GLOBALS).map_err(|e| explained(&e, source, false))?;
    let root = build(&mut eval, &module, inputs, source)?;
    session.tree(root).map_err(|c| complained(&c, 0))
}

/// Processor time of this thread so far: beside other work the clock says little of what a program does. On systems that do
/// not tell it, time on the clock.
#[cfg(unix)]
fn spent() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or_default())
}

#[cfg(not(unix))]
fn spent() -> Duration {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed()
}

/// Watches every statement. The interpreter has no limits of its own for what is between two statements (a
/// comprehension, an operation on one huge value): those the child process stops.
struct Guard {
    statements: u64,
    most: u64,
    heap_bytes: u64,
    end: Duration,
    progress: Option<Progress>,
}

impl<'a, 'e: 'a> BeforeStmtFuncDyn<'a, 'e> for Guard {
    fn call<'v>(&mut self, span: FileSpanRef<'_>, eval: &mut Evaluator<'v, 'a, 'e>) -> starlark::Result<()> {
        self.statements += 1;
        if let Some(progress) = &self.progress {
            progress(span.resolve_span().begin.line as u32 + 1);
        }
        let say = |what: &str| {
            let complaint = Complaint::limit(format!("the program uses too much {what}"))
                .with_hint("shorter loops: copies are made by row(), grid(), ring(), along()");
            Err(Failure::Complaint(complaint).into())
        };
        if self.statements > self.most {
            return say("time");
        }
        if eval.heap().allocated_bytes() as u64 > self.heap_bytes {
            return say("memory");
        }
        if self.statements.is_multiple_of(256) && spent() > self.end {
            return say("time");
        }
        Ok(())
    }
}

/// Calls `build` with what it takes, and looks at what it gives.
fn build<'v>(
    eval: &mut Evaluator<'v, '_, '_>,
    module: &'v Module,
    inputs: &Inputs,
    source: &str,
) -> Result<harmony_shape::NodeId, ProgramError> {
    let run = |message: String| ProgramError::new(ErrorKind::Run, 0, message);
    let example = "def build(w, h, d):\n    return group(\"name\", seat = ..., legs = ...)";
    let Some(function) = module.get("build") else {
        return Err(run("the program defines no build".to_owned()).with_hint(example));
    };
    let line = source.lines().position(|l| l.trim_start().starts_with("def build")).map_or(0, |i| i as u32 + 1);
    let DocItem::Member(DocMember::Function(doc)) = function.documentation() else {
        return Err(run("`build` is not a function".to_owned()).with_hint(example));
    };
    let heap = eval.heap();
    let mut given: Vec<(&str, Value<'v>)> = Vec::new();
    let params = doc.params.pos_only.iter().chain(&doc.params.pos_or_named).chain(&doc.params.named_only);
    let size = inputs.size.map(|s| [s.width, s.height, s.depth]);
    for param in params {
        let own = inputs.params.get(&param.name).map(|v| value_of(heap, v, 8));
        let of_size =
            ["w", "h", "d"].iter().position(|n| *n == param.name).and_then(|i| size.map(|s| heap.alloc(s[i])));
        match own.or(of_size) {
            Some(value) => given.push((&param.name, value)),
            None if param.default_value.is_some() => {}
            None => {
                let error = ProgramError::new(
                    ErrorKind::Run,
                    line,
                    format!("build needs `{}`, which nothing gives", param.name),
                );
                return Err(error.with_hint("give it a default; w, h and d come from the object's size"));
            }
        }
    }
    let result = eval.eval_function(function, &[], &given).map_err(|e| explained(&e, source, false))?;
    if let Some(Kind::Part(id, _)) = Thing::from_value(result).map(|t| &t.kind) {
        return Ok(*id);
    }
    let is = thing::word(result);
    let error = ProgramError::new(ErrorKind::Run, line, format!("build gives back {is}, not a part"));
    Err(error.with_hint("end with: return group(\"name\", part = part, ...)"))
}

/// JSON as a value; what is nested deeper than `depth` becomes None.
fn value_of<'v>(heap: &'v Heap, json: &serde_json::Value, depth: u32) -> Value<'v> {
    use serde_json::Value as Json;
    match json {
        Json::Bool(b) => Value::new_bool(*b),
        Json::Number(n) => match (n.as_i64().and_then(|i| i32::try_from(i).ok()), n.as_f64()) {
            (Some(i), _) => heap.alloc(i),
            (_, Some(x)) => heap.alloc(x),
            _ => Value::new_none(),
        },
        Json::String(s) => heap.alloc(s.as_str()),
        Json::Array(list) if depth > 0 => {
            heap.alloc(list.iter().map(|v| value_of(heap, v, depth - 1)).collect::<Vec<_>>())
        }
        Json::Object(map) if depth > 0 => {
            let pairs = map.iter().map(|(k, v)| (heap.alloc(k.as_str()), value_of(heap, v, depth - 1)));
            heap.alloc(starlark::values::dict::AllocDict(pairs.collect::<Vec<_>>()))
        }
        _ => Value::new_none(),
    }
}

fn complained(complaint: &Complaint, line: u32) -> ProgramError {
    let kind = if complaint.limit { ErrorKind::Limit } else { ErrorKind::Run };
    ProgramError { kind, line, message: complaint.message.clone(), hint: complaint.hint.clone() }
}

/// The interpreter's error in our words.
fn explained(error: &starlark::Error, source: &str, syntax: bool) -> ProgramError {
    use starlark::ErrorKind as Engine;
    let line = error.span().map_or(0, |s| s.resolve_span().begin.line as u32 + 1);
    let cause = match error.kind() {
        Engine::Native(e) | Engine::Other(e) => e.downcast_ref::<Complaint>(),
        _ => None,
    };
    let mut out = match cause {
        Some(complaint) => complained(complaint, line),
        None => in_words(error, line, source, syntax),
    };
    // Where it was called, when the fault is in a function of the program.
    let callers = error.call_stack().frames.iter().filter_map(|f| f.location.as_ref());
    let callers: Vec<u32> = callers.map(|l| l.resolve_span().begin.line as u32 + 1).filter(|l| *l != line).collect();
    if let Some(from) = callers.last() {
        out.message = format!("{} (called from line {from})", out.message);
    }
    out
}

fn in_words(error: &starlark::Error, line: u32, source: &str, syntax: bool) -> ProgramError {
    use starlark::ErrorKind as Engine;
    let full = error.without_diagnostic().to_string();
    let first = full.lines().next().unwrap_or_default();
    let message: String =
        first.trim_start_matches("Parse error: ").replace("type `thing`", "this kind").chars().take(300).collect();
    let message = message.replace("`thing`", "`part`");
    let text = (line as usize).checked_sub(1).and_then(|i| source.lines().nth(i)).unwrap_or_default();
    if matches!(error.kind(), Engine::StackOverflow(_)) {
        return ProgramError::new(ErrorKind::Limit, line, "calls are nested too deep").with_hint("use a loop");
    }
    let (kind, hint) = match error.kind() {
        Engine::Parser(_) => (ErrorKind::Syntax, hints::for_syntax(text, &message)),
        _ if syntax => (ErrorKind::Syntax, hints::for_syntax(text, &message)),
        Engine::Fail(_) => (ErrorKind::Run, None),
        _ => (ErrorKind::Run, hints::for_run(&message)),
    };
    let guess = match error.kind() {
        Engine::Scope(_) | Engine::Other(_) if hint.is_none() => missing_name(&message),
        _ => None,
    };
    ProgramError { kind, line, message, hint: hint.map(str::to_owned).or(guess) }
}

/// "Variable `x` not found" with the nearest function of ours and its signature.
fn missing_name(message: &str) -> Option<String> {
    let name = message.strip_prefix("Variable `")?.split('`').next()?;
    let names = functions::FUNCTIONS.iter().map(|f| f.name.as_str());
    let near = crate::names::nearest(name, names)?;
    functions::FUNCTIONS.iter().find(|f| f.name == near).map(|f| f.signature.to_owned())
}
