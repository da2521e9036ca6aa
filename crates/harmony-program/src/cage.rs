//! The parent's side of the cage: starts the child, gives it the program, bounds its time and its answer.

use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use harmony_shape::ShapeTree;

use crate::child::{AT_LINE, Answer, CHILD_COMMAND, MAX_QUESTION, Question};
use crate::error::{ErrorKind, ProgramError};
use crate::inputs::{Inputs, Limits};
use crate::prescan::prescan;

/// How the child is started.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChildCommand {
    /// Executable.
    pub program: PathBuf,
    /// Arguments that make it a child.
    pub args: Vec<String>,
}

impl ChildCommand {
    /// This executable with the hidden subcommand [`CHILD_COMMAND`]; its `main` must call [`crate::child_main`] then.
    ///
    /// # Errors
    /// When the system cannot tell where the executable is.
    pub fn this_program() -> std::io::Result<Self> {
        Ok(Self { program: std::env::current_exe()?, args: vec![CHILD_COMMAND.to_owned()] })
    }
}

fn broken(message: String) -> ProgramError {
    ProgramError::new(ErrorKind::Cage, 0, message)
}

/// Runs a program in a child process and gives its tree.
///
/// The child has an empty environment, an empty folder, no files that it could write, and limits of memory and time that
/// the system holds (unix; elsewhere the time on the clock alone, see `docs/decisions/0026-modelling-programs.md`). Its
/// answer is read as data of a stranger.
///
/// # Errors
/// What is wrong with the program ([`ErrorKind::Limit`] when the child had to be stopped or fell), or
/// [`ErrorKind::Cage`] when the child could not be started.
pub fn run(source: &str, inputs: &Inputs, limits: &Limits, child: &ChildCommand) -> Result<ShapeTree, ProgramError> {
    prescan(source)?;
    let question = Question { source: source.to_owned(), inputs: inputs.clone(), limits: limits.clone() };
    let question = serde_json::to_vec(&question).map_err(|e| broken(format!("the inputs cannot be written: {e}")))?;
    if question.len() as u64 >= MAX_QUESTION {
        return Err(broken(format!(
            "source and inputs have {} bytes; at most {MAX_QUESTION} are allowed",
            question.len()
        )));
    }
    let folder = tempfile::tempdir().map_err(|e| broken(format!("no empty folder: {e}")))?;
    let mut command = Command::new(&child.program);
    command.args(&child.args).env_clear().current_dir(folder.path());
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    #[cfg(windows)]
    if let Some(root) = std::env::var_os("SystemRoot") {
        // Without it no process starts there.
        command.env("SystemRoot", root);
    }
    let child = command.spawn().map_err(|e| broken(format!("the child does not start: {e}")))?;
    Watch::new(child, question, limits).wait(limits)
}

/// A pipe that is read to a cap by a thread.
type Reader = std::thread::JoinHandle<Vec<u8>>;

fn reader(pipe: Option<impl Read + Send + 'static>, cap: u64) -> Option<Reader> {
    let mut pipe = pipe?.take(cap + 1);
    Some(std::thread::spawn(move || {
        let mut bytes = Vec::new();
        let _ = pipe.read_to_end(&mut bytes);
        bytes
    }))
}

struct Watch {
    child: Child,
    started: Instant,
    output: Option<Reader>,
    said: Option<Reader>,
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Watch {
    fn new(mut child: Child, question: Vec<u8>, limits: &Limits) -> Self {
        let output = reader(child.stdout.take(), limits.output_bytes);
        // 2000 lines, and five more a second.
        let said = reader(child.stderr.take(), 64 << 10);
        if let Some(mut pipe) = child.stdin.take() {
            std::thread::spawn(move || {
                let _ = pipe.write_all(&question);
            });
        }
        Self { child, started: Instant::now(), output, said }
    }

    fn wait(mut self, limits: &Limits) -> Result<ShapeTree, ProgramError> {
        let end = Duration::from_secs_f64(limits.wall_seconds.clamp(0.05, 3600.0));
        let mut pause = Duration::from_millis(1);
        let mut looked = Instant::now();
        let status = loop {
            match self.child.try_wait() {
                Ok(Some(status)) => break Some(status),
                Ok(None) => {}
                Err(error) => return Err(broken(format!("the child is lost: {error}"))),
            }
            if self.started.elapsed() > end || self.output.as_ref().is_some_and(Reader::is_finished) && !self.answers()
            {
                break None;
            }
            // Where the system does not hold the limit of memory.
            if cfg!(target_os = "macos") && looked.elapsed() > Duration::from_millis(250) {
                looked = Instant::now();
                if resident_bytes(self.child.id()).is_some_and(|b| b > limits.address_space_bytes) {
                    break None;
                }
            }
            std::thread::sleep(pause);
            pause = (pause * 2).min(Duration::from_millis(20));
        };
        let _ = self.child.kill();
        let _ = self.child.wait();
        let output = self.output.take().and_then(|r| r.join().ok()).unwrap_or_default();
        let said = self.said.take().and_then(|r| r.join().ok()).unwrap_or_default();
        read(status, &output, &said, limits)
    }

    /// Whether the child is about to end by itself, a moment after it closed its output.
    fn answers(&mut self) -> bool {
        let end = Instant::now() + Duration::from_secs(1);
        while Instant::now() < end {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        false
    }
}

/// What a child that ended has answered.
fn read(status: Option<ExitStatus>, output: &[u8], said: &[u8], limits: &Limits) -> Result<ShapeTree, ProgramError> {
    let said = String::from_utf8_lossy(said);
    let line = said.lines().rev().find_map(|l| l.strip_prefix(AT_LINE)?.parse().ok()).unwrap_or(0);
    let stopped = |what: &str| {
        let near = if line > 0 { format!(", near line {line}") } else { String::new() };
        ProgramError::new(ErrorKind::Limit, line, format!("{what}{near}"))
            .with_hint("no very long texts, lists or numbers; shorter loops; copies by row(), grid(), ring(), along()")
    };
    if output.len() as u64 > limits.output_bytes {
        return Err(stopped(&format!("the program makes more than {} bytes of parts", limits.output_bytes)));
    }
    match status {
        None => Err(stopped("the program took too much time or memory and was stopped")),
        Some(status) if status.success() => match serde_json::from_slice(output) {
            Ok(Answer::Tree(tree)) => Ok(tree),
            Ok(Answer::Error(error)) => Err(error),
            Err(error) => Err(broken(format!("the child's answer cannot be read: {error}"))),
        },
        Some(status) if status.code() == Some(2) => Err(broken("the child could not read its question".to_owned())),
        Some(_) => Err(stopped("the program used too much memory or time")),
    }
}

/// Resident memory of a process by `ps`, for systems that do not hold a limit of memory.
#[cfg(unix)]
fn resident_bytes(id: u32) -> Option<u64> {
    let shown = Command::new("ps").args(["-o", "rss=", "-p", &id.to_string()]).stderr(Stdio::null()).output().ok()?;
    Some(String::from_utf8_lossy(&shown.stdout).trim().parse::<u64>().ok()? * 1024)
}

#[cfg(not(unix))]
fn resident_bytes(_id: u32) -> Option<u64> {
    None
}
