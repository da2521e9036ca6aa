//! Why a scene failed, so that equal failures of many scenes can be counted and tried again together.

use std::path::Path;

use serde_json::Value;

/// Longest cause, characters.
const MAX_CAUSE: usize = 160;

/// Largest `run.json` and log that are read.
const MAX_BYTES: u64 = 32 << 20;

/// A failure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cause {
    /// Phase folder (`3_furniture`), or `input`, `usage`, `stopped`, `crash`, `time`.
    pub stage: String,
    /// The message without what differs from scene to scene: numbers, paths, what is quoted.
    pub cause: String,
    /// The message.
    pub message: String,
}

impl Cause {
    /// From a message.
    pub fn new(stage: &str, message: &str) -> Self {
        Self { stage: stage.to_owned(), cause: common(message), message: message.to_owned() }
    }

    /// Of a run that ended with a code of its own: the first phase that failed as its `run.json` says, else the last
    /// error that the program told.
    pub fn of_exit(code: i32, run: &Path, said: &str) -> Self {
        let phase = (code == 3).then(|| failed_phase(run)).flatten();
        if let Some((phase, message)) = phase {
            return Self::new(&phase, &message);
        }
        let stage = match code {
            1 => "input",
            2 => "usage",
            3 => "run",
            4 => "stopped",
            _ => "crash",
        };
        let told = said.lines().rev().find_map(|line| line.trim().strip_prefix("error: "));
        let last = || said.lines().rev().find(|line| !line.trim().is_empty());
        let message = told.or_else(last).unwrap_or("it said nothing").trim();
        let message = if told.is_none() { format!("exit code {code}: {message}") } else { message.to_owned() };
        Self::new(stage, &message)
    }
}

/// The first phase of a run that failed, and its reason.
fn failed_phase(run: &Path) -> Option<(String, String)> {
    let bytes = harmony_io::read_bounded(&run.join("run.json"), MAX_BYTES).ok()?;
    let file: Value = serde_json::from_slice(&bytes).ok()?;
    let mut phases: Vec<(&String, &Value)> = file.get("phases")?.as_object()?.iter().collect();
    phases.sort_by_key(|(name, _)| *name);
    let (name, phase) = phases.into_iter().find(|(_, phase)| phase["state"] == "failed")?;
    Some((name.clone(), phase["outcome"].as_str().unwrap_or("it failed").to_owned()))
}

/// US dollars on a run's bill.
pub(crate) fn bill_of(run: &Path) -> Option<f64> {
    let bytes = harmony_io::read_bounded(&run.join("bill.json"), MAX_BYTES).ok()?;
    let bill: Value = serde_json::from_slice(&bytes).ok()?;
    bill["total"]["usage"]["cost_usd"].as_f64().filter(|usd| usd.is_finite())
}

/// A message without what differs from scene to scene.
fn common(message: &str) -> String {
    let mut out = String::new();
    let mut rest = message.lines().next().unwrap_or_default();
    while let Some(first) = rest.chars().next() {
        let begins_word = out.chars().last().is_none_or(|c| !c.is_alphanumeric());
        let taken = if first == '"' {
            let length = rest[1..].find('"').map_or(rest.len(), |end| end + 2);
            out.push_str("\"..\"");
            length
        } else if first == '/' && begins_word {
            out.push_str("..");
            rest.find(|c: char| c.is_whitespace() || c == ',' || c == ':').unwrap_or(rest.len())
        } else if first.is_ascii_digit() {
            out.push('#');
            rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len())
        } else {
            out.push(if first.is_whitespace() { ' ' } else { first });
            first.len_utf8()
        };
        rest = &rest[taken..];
    }
    out.chars().take(MAX_CAUSE).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_failures_of_different_scenes_have_one_cause() {
        let a = Cause::new("input", "cannot read /data/a 1/photo.jpg: 12 of 340 bytes of \"kitchen 3\" are there");
        let b = Cause::new("input", "cannot read /x/y.png: 7 of 9.5 bytes of \"hall\" are there");
        assert_ne!(a.message, b.message);
        // A path with a blank is two words.
        assert_eq!(b.cause, "cannot read ..: # of # bytes of \"..\" are there");
        assert_eq!(a.cause, "cannot read .. #..: # of # bytes of \"..\" are there");
        for odd in ["\"", "/", "é/ü 3\"", "", "a\nb"] {
            assert!(common(odd).chars().count() <= MAX_CAUSE);
        }
        assert!(common(&"é".repeat(10_000)).chars().count() == MAX_CAUSE);
    }

    #[test]
    fn the_first_failed_phase_counts_else_what_the_program_said() {
        let folder = tempfile::tempdir().unwrap();
        let run = r#"{"phases": {"3_furniture": {"state": "failed", "outcome": "no answer to inspect"},
            "1_layout": {"state": "done", "outcome": "x"}, "4_ceiling": {"state": "failed", "outcome": "y"}}}"#;
        std::fs::write(folder.path().join("run.json"), run).unwrap();
        let cause = Cause::of_exit(3, folder.path(), "error: something\n");
        assert_eq!((cause.stage.as_str(), cause.message.as_str()), ("3_furniture", "no answer to inspect"));
        let cause = Cause::of_exit(1, folder.path(), "hello\nerror: not a picture: x\nhint: check\n");
        assert_eq!((cause.stage.as_str(), cause.message.as_str()), ("input", "not a picture: x"));
        std::fs::write(folder.path().join("run.json"), "{").unwrap();
        assert_eq!(Cause::of_exit(3, folder.path(), "").stage, "run");
        assert_eq!(Cause::of_exit(101, folder.path(), "thread panicked\n").message, "exit code 101: thread panicked");
    }

    #[test]
    fn the_bill_is_read_and_what_is_none_is_not() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(bill_of(folder.path()), None);
        std::fs::write(folder.path().join("bill.json"), r#"{"total": {"usage": {"cost_usd": 1.25}}}"#).unwrap();
        assert_eq!(bill_of(folder.path()), Some(1.25));
    }
}
