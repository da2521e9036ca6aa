//! What tests share: where the test material is, a skip that is told of, and a run folder. Only ever a dev-dependency.
//!
//! A test that cannot run here (no test material, no Blender, no strace) calls [`skip`] and returns. Cargo shows it as
//! passed all the same, so that each skip is also a line in the file that `HARMONY_SKIPS` names; `test.sh` counts and
//! lists them at its end.
#![expect(clippy::print_stderr, reason = "a skip is said where the test's other words are")]

pub mod run;

use std::fmt::Display;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Says that the running test is skipped: `skipped: CRATE TEST: REASON`, on standard error and as a line of the file
/// that `HARMONY_SKIPS` names.
///
/// # Panics
/// When that file cannot be written: a skip that is lost would look like a test that ran.
pub fn skip(reason: impl Display) {
    let krate = std::env::var("CARGO_PKG_NAME").unwrap_or_default();
    // The test harness names its threads after the tests.
    let line = line(&krate, std::thread::current().name().unwrap_or_default(), &reason.to_string());
    eprint!("{line}");
    if let Some(file) = std::env::var_os("HARMONY_SKIPS").filter(|file| !file.is_empty()) {
        append(Path::new(&file), &line);
    }
}

fn line(krate: &str, test: &str, reason: &str) -> String {
    format!("skipped: {krate} {test}: {}\n", reason.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Tests run beside each other in processes of their own: one write a line keeps lines whole.
fn append(file: &Path, line: &str) {
    let opened = OpenOptions::new().create(true).append(true).open(file);
    let written = opened.and_then(|mut file| file.write_all(line.as_bytes()));
    written.unwrap_or_else(|error| panic!("cannot write {}: {error}", file.display()));
}

/// Folder of the checkout whose tests run: cargo tells it at run time. What was compiled in may be another checkout's,
/// where several share a build folder.
///
/// # Panics
/// When the tested crate lies in no workspace.
pub fn root() -> PathBuf {
    let tested = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
    let found = Path::new(&tested).ancestors().find(|folder| folder.join("Cargo.lock").is_file());
    found.unwrap_or_else(|| panic!("{} lies in no workspace", Path::new(&tested).display())).to_owned()
}

/// Something in the shared test material, by its path there (`""` = the whole folder); `None`, and a skip, when it is
/// not there. `HARMONY_SHARED` names the folder; default is `../shared` beside the checkout.
pub fn shared(path: &str) -> Option<PathBuf> {
    // An absolute path stays what it is.
    let folder = root().join(std::env::var_os("HARMONY_SHARED").unwrap_or_else(|| "../shared".into()));
    let found = if path.is_empty() { folder } else { folder.join(path) };
    if found.exists() {
        return Some(found);
    }
    skip(format_args!("{} is not there (HARMONY_SHARED names the test material)", found.display()));
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skips_are_one_line_each_and_none_is_lost() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("skips");
        let word = "a reason\n  of two lines ".repeat(100);
        std::thread::scope(|scope| {
            for test in ["one", "two", "three", "four"] {
                let (file, word) = (&file, &word);
                scope.spawn(move || (0..50).for_each(|_| append(file, &line("some-crate", test, word))));
            }
        });
        let text = std::fs::read_to_string(&file).unwrap();
        assert_eq!(text.lines().count(), 200);
        assert!(text.lines().all(|l| l.starts_with("skipped: some-crate ") && l.ends_with("a reason of two lines")));
    }

    #[test]
    #[should_panic(expected = "cannot write")]
    fn a_skip_that_cannot_be_written_fails_the_test() {
        append(Path::new("/nowhere/at/all"), "skipped\n");
    }

    #[test]
    fn this_checkout_is_found() {
        assert!(root().join("test.sh").is_file());
    }
}
