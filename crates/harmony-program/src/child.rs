//! The child process: limits itself, reads a program from standard input, answers on standard output.

use std::io::{Read, Write};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use harmony_shape::ShapeTree;
use serde::{Deserialize, Serialize};

use crate::engine::{Progress, evaluate_with};
use crate::error::{ErrorKind, ProgramError};
use crate::inputs::{Inputs, Limits};

/// The hidden subcommand under which a program of ours is such a child.
pub const CHILD_COMMAND: &str = "__program";

/// What the child is asked.
#[derive(Serialize, Deserialize)]
pub(crate) struct Question {
    pub source: String,
    pub inputs: Inputs,
    pub limits: Limits,
}

/// What it answers.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Answer {
    Tree(ShapeTree),
    Error(ProgramError),
}

/// Longest question, bytes: a program and its parameters.
pub(crate) const MAX_QUESTION: u64 = 4 << 20;

/// What stands before a line number on standard error.
pub(crate) const AT_LINE: &str = "line ";

/// Does what a child does, and ends. Called before anything else of the program that is its own child.
pub fn child_main() -> ExitCode {
    static SEEN: [AtomicU32; 64] = [const { AtomicU32::new(0) }; 64];
    static LAST: AtomicU32 = AtomicU32::new(0);
    // A panic of the interpreter is an answer, not something to print.
    std::panic::set_hook(Box::new(|_| {}));
    let mut text = String::new();
    if std::io::stdin().lock().take(MAX_QUESTION).read_to_string(&mut text).is_err() {
        return ExitCode::from(2);
    }
    let Ok(question) = serde_json::from_str::<Question>(&text) else { return ExitCode::from(2) };
    drop(text);
    if let Err(error) = limit_self(&question.limits) {
        return answer(&Answer::Error(ProgramError::new(
            ErrorKind::Cage,
            0,
            format!("no limits could be set: {error}"),
        )));
    }
    // Each line once when it is first reached: the parent knows where the child was when it fell.
    let progress = |line: u32| {
        LAST.store(line, Ordering::Relaxed);
        let (word, bit) = ((line / 32) as usize % 64, 1_u32 << (line % 32));
        if SEEN[word].fetch_or(bit, Ordering::Relaxed) & bit == 0 {
            tell(line);
        }
    };
    // And the one that takes long, now and then.
    let _ = std::thread::Builder::new().stack_size(256 << 10).spawn(|| {
        let mut told = 0;
        loop {
            std::thread::sleep(std::time::Duration::from_millis(200));
            let line = LAST.load(Ordering::Relaxed);
            if line != told {
                told = line;
                tell(line);
            }
        }
    });
    let progress: Progress = Arc::new(progress);
    let result = evaluate_with(&question.source, &question.inputs, &question.limits, Some(progress));
    answer(&match result {
        Ok(tree) => Answer::Tree(tree),
        Err(mut error) => {
            if error.kind == ErrorKind::Limit && error.line == 0 {
                error.line = LAST.load(Ordering::Relaxed);
            }
            Answer::Error(error)
        }
    })
}

fn tell(line: u32) {
    let _ = std::io::stderr().lock().write_all(format!("{AT_LINE}{line}\n").as_bytes());
}

fn answer(answer: &Answer) -> ExitCode {
    let Ok(bytes) = serde_json::to_vec(answer) else { return ExitCode::from(2) };
    let mut out = std::io::stdout().lock();
    match out.write_all(&bytes).and_then(|()| out.flush()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) => ExitCode::from(2),
    }
}

/// Takes away from this process what a program has no use for. Nothing of it can be got back.
#[cfg(unix)]
fn limit_self(limits: &Limits) -> Result<(), String> {
    use rustix::process::{Resource, Rlimit, setrlimit};
    let set = |resource, most: u64| {
        setrlimit(resource, Rlimit { current: Some(most), maximum: Some(most) })
            .map_err(|e| format!("{resource:?}: {e}"))
    };
    set(Resource::Core, 0)?;
    set(Resource::Fsize, 0)?;
    set(Resource::Nofile, 8)?;
    set(Resource::Cpu, limits.cpu_seconds.max(1))?;
    match set(Resource::As, limits.address_space_bytes) {
        // macOS refuses or ignores it: the parent watches the memory there.
        Err(_) if cfg!(target_os = "macos") => Ok(()),
        other => other,
    }
}

#[cfg(not(unix))]
fn limit_self(_limits: &Limits) -> Result<(), String> {
    Ok(())
}
