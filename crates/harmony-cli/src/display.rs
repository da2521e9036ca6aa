//! What a person sees: progress, errors with hints, logs.

use std::io::{IsTerminal, Write};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use harmony_calls::{CallEvent, CallEventKind};
use harmony_pipeline::{ProgressEvent, ProgressSink};
use indicatif::{ProgressBar, ProgressStyle};

/// Writes a line to stdout; a reader that has gone away (`harmony show run | head -1`) is no error.
///
/// # Errors
/// Whatever else stdout cannot take, a full disk behind a redirection among it.
pub fn write_line(line: std::fmt::Arguments<'_>) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{line}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(hinted(format!("cannot write the output: {error}"), harmony_io::atomic::io_hint(&error)))
        }
        _ => Ok(()),
    }
}

/// Writes a line to stderr; when that fails there is nobody to tell.
pub fn write_note(line: std::fmt::Arguments<'_>) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// `println!` that returns an error instead of panicking.
#[macro_export]
macro_rules! say {
    ($($text:tt)*) => { $crate::display::write_line(format_args!($($text)*)) };
}

/// `eprintln!` that never panics.
#[macro_export]
macro_rules! tell {
    ($($text:tt)*) => { $crate::display::write_note(format_args!($($text)*)) };
}

/// An error with something to do about it.
#[derive(Debug)]
pub struct Hinted {
    /// What went wrong.
    pub message: String,
    /// What to do.
    pub hint: String,
}

impl std::fmt::Display for Hinted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Hinted {}

/// An error with a hint where there is one.
pub fn hinted(message: String, hint: Option<impl Into<String>>) -> anyhow::Error {
    match hint {
        Some(hint) => anyhow::Error::new(Hinted { message, hint: hint.into() }),
        None => anyhow::anyhow!(message),
    }
}

/// Prints an error, its causes and its hint.
pub fn print_error(error: &anyhow::Error) {
    tell!("error: {error}");
    let mut last = error.to_string();
    for cause in error.chain().skip(1) {
        let text = cause.to_string();
        if !last.contains(&text) {
            tell!("  because: {text}");
        }
        last = text;
    }
    if let Some(hinted) = error.chain().find_map(|e| e.downcast_ref::<Hinted>()) {
        tell!("hint: {}", hinted.hint);
    }
}

/// Logs go to stderr; `RUST_LOG` overrides `-v`.
pub fn log_to_stderr(verbose: u8) {
    let level = match verbose {
        0 => "error",
        1 => "info",
        _ => "debug",
    };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new(format!("{level},wgpu=error")));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .without_time()
        .log_internal_errors(false)
        .init();
}

/// Waits for a rate limit that are worth a line of their own.
const TELLING_WAIT: Duration = Duration::from_secs(10);

/// A line that moves on a terminal, plain lines elsewhere.
pub struct Display {
    bar: Option<ProgressBar>,
    /// What the run does, and what its calls do.
    shown: Mutex<(String, String)>,
}

impl Display {
    /// Starts.
    #[must_use]
    pub fn new() -> Arc<Self> {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new_spinner();
            if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed:>4} {msg}") {
                bar.set_style(style);
            }
            bar.enable_steady_tick(Duration::from_millis(120));
            bar
        });
        Arc::new(Self { bar, shown: Mutex::default() })
    }

    fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.println(text),
            None => tell!("{text}"),
        }
    }

    fn now(&self, text: String) {
        self.show(|shown| shown.0 = text);
    }

    /// What is under way, in one line.
    pub fn calls(&self, line: String) {
        self.show(|shown| shown.1 = line);
    }

    fn show(&self, change: impl FnOnce(&mut (String, String))) {
        let Some(bar) = &self.bar else { return };
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut shown);
        let (step, calls) = &*shown;
        bar.set_message(if calls.is_empty() { step.clone() } else { format!("{step} | {calls}") });
    }

    /// Ends.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    /// A sink for the pipeline.
    pub fn sink(self: &Arc<Self>) -> ProgressSink {
        let display = Arc::clone(self);
        Arc::new(move |event| match event {
            ProgressEvent::PhaseStarted { phase } => display.now(phase),
            ProgressEvent::Step { phase, text } => {
                if display.bar.is_none() {
                    display.say(&format!("{phase}: {text}"));
                }
                display.now(format!("{phase}: {text}"));
            }
            ProgressEvent::PhaseDone { phase, seconds, .. } => display.say(&format!("{phase}: done in {seconds:.1} s")),
            ProgressEvent::PhaseFailed { phase, reason } => display.say(&format!("{phase}: FAILED: {reason}")),
            _ => {}
        })
    }

    /// A sink for calls.
    pub fn call_sink(self: &Arc<Self>) -> Arc<dyn Fn(CallEvent) + Send + Sync> {
        let display = Arc::clone(self);
        Arc::new(move |event: CallEvent| match event.kind {
            CallEventKind::AskedAgain { player, complaint } => {
                let first = complaint.lines().next().unwrap_or_default().to_owned();
                display.say(&format!("{}: {player} is asked again: {first}", event.name));
            }
            CallEventKind::Retried { player, reason, wait } => {
                let first = reason.lines().next().unwrap_or_default().to_owned();
                display.say(&format!(
                    "{}: {player} is tried again in {:.0} s: {first}",
                    event.name,
                    wait.as_secs_f64()
                ));
            }
            CallEventKind::RateLimited { player, wait } if wait >= TELLING_WAIT => {
                display.say(&format!("{}: waits {:.0} s for {player}'s rate limit", event.name, wait.as_secs_f64()));
            }
            CallEventKind::Replaced { reason } => {
                display.say(&format!("{}: this program stands in: {reason}", event.name));
            }
            _ => {}
        })
    }

    /// A line from the files player.
    pub fn line_sink(self: &Arc<Self>) -> Arc<dyn Fn(String) + Send + Sync> {
        let display = Arc::clone(self);
        Arc::new(move |line: String| display.say(&line))
    }
}
