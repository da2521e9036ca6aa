//! `harmony setup` installs Blender's module: with a Python that is a script, so that nothing is fetched.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::common::said;

/// A Python of version 3.11 that makes environments, installs, and imports bpy where it was installed; it notes what it is
/// asked. A file `fails` beside the notes makes pip fail.
const PYTHON: &str = r#"#!/bin/sh
echo "$(basename "$0") $*" >> "$NOTES/asked"
case "$1 $2" in
  "-c import sys;"*) echo "$VERSION" ;;
  "-m venv") mkdir -p "$3/bin" && cp "$NOTES/python" "$3/bin/python" && touch "$3/pyvenv.cfg" ;;
  "-m pip") if [ -e "$NOTES/fails" ]; then echo "no matching distribution" >&2; exit 1; fi
            [ -e "$NOTES/empty" ] || touch "$(dirname "$0")/bpy.so"; echo "pip says something" ;;
  "-c import bpy"*) if [ -e "$(dirname "$0")/bpy.so" ]; then echo "Blender 5.0.1"; else
            echo "ImportError: libXi.so.6: cannot open shared object file" >&2; exit 1; fi ;;
  *) exit 2 ;;
esac
"#;

struct Machine {
    folder: tempfile::TempDir,
    version: &'static str,
}

impl Machine {
    /// With a Python of this version, or with none.
    fn new(version: &'static str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("bin")).unwrap();
        // What the script itself needs, and nothing else of this machine.
        for tool in ["basename", "dirname", "mkdir", "cp", "touch", "sh"] {
            let found = ["/usr/bin", "/bin"].map(|place| Path::new(place).join(tool));
            std::os::unix::fs::symlink(found.iter().find(|path| path.exists()).unwrap(), at("bin").join(tool)).unwrap();
        }
        if !version.is_empty() {
            for python in [at("python"), at("bin").join("python3")] {
                std::fs::write(&python, PYTHON).unwrap();
                std::fs::set_permissions(&python, std::fs::Permissions::from_mode(0o755)).unwrap();
            }
        }
        Self { folder, version }
    }

    fn command(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        command.current_dir(self.folder.path()).env("PATH", self.folder.path().join("bin")).env("NO_COLOR", "1");
        command.env("NOTES", self.folder.path()).env("VERSION", self.version).env_remove("RUST_LOG");
        command.env("HARMONY_CACHE", self.folder.path().join("cache")).env_remove("HARMONY_BPY_PYTHON");
        command.env("HARMONY_MODELS", self.folder.path().join("no-models"));
        for (variable, ..) in harmony_cli::survey::KEYS {
            command.env_remove(variable);
        }
        command
    }

    fn setup(&self, words: &[&str]) -> Output {
        let mut command = self.command(Path::new(env!("CARGO_BIN_EXE_harmony")));
        command.args(["setup", "--no-ports"]).args(words).stdin(Stdio::null()).output().unwrap()
    }

    /// The same on a terminal, where somebody types.
    fn typed(&self, keys: &str) -> Option<String> {
        let script = ["/usr/bin/script", "/bin/script"].into_iter().map(Path::new).find(|path| path.exists())?;
        let line = format!("{} setup --no-ports", env!("CARGO_BIN_EXE_harmony"));
        let mut command = self.command(script);
        command.args(["-qec", &line, "/dev/null"]).env("SHELL", "/bin/sh").stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        std::io::Write::write_all(child.stdin.as_mut().unwrap(), keys.as_bytes()).unwrap();
        let output = child.wait_with_output().unwrap();
        Some(String::from_utf8_lossy(&output.stdout).replace('\r', ""))
    }

    fn asked(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("asked")).unwrap_or_default()
    }

    /// What lies in the cache.
    fn cache(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path().join("cache")).into_iter().flatten();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    fn touch(&self, name: &str) {
        std::fs::write(self.folder.path().join(name), "").unwrap();
    }
}

#[test]
fn the_module_is_installed_when_it_is_asked_for_and_found_at_once() {
    let machine = Machine::new("3.11");
    let shown = machine.setup(&["--yes", "--blender", "--show"]);
    assert!(said(&shown).contains("-m pip install --disable-pip-version-check bpy==5.0.1"), "{}", said(&shown));
    assert!(!machine.asked().contains("venv"), "nothing is done: {}", machine.asked());

    let output = machine.setup(&["--yes", "--blender"]);
    let (text, log) = (String::from_utf8_lossy(&output.stdout).into_owned(), said(&output));
    assert_eq!(output.status.code(), Some(0), "{text}{log}");
    for word in ["370 MB", "GPL-3.0", "+ python3 -m venv", "pip says something", "Blender 5.0.1 is installed"] {
        assert!(log.contains(word), "{word}: {log}");
    }
    let terms = log.find("GPL-3.0").unwrap();
    assert!(terms < log.find("+ python3").unwrap(), "said before it is done");
    assert_eq!(machine.cache(), ["bpy"]);
    // The players are tried with it.
    assert!(text.contains("cycles"), "{text}");

    let again = machine.setup(&["--yes", "--blender"]);
    assert!(String::from_utf8_lossy(&again.stdout).contains("nothing to install"), "{}", said(&again));
    assert_eq!(machine.asked().matches("-m pip").count(), 1, "{}", machine.asked());
}

#[test]
fn without_the_word_nothing_is_installed_where_nobody_can_be_asked() {
    let machine = Machine::new("3.11");
    let output = machine.setup(&["--yes"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert!(!machine.asked().contains("venv"), "{}", machine.asked());
    assert!(String::from_utf8_lossy(&output.stdout).contains("`harmony setup --blender` installs"));
}

#[test]
fn on_a_terminal_it_is_asked_and_enter_says_no() {
    // Who looks, who draws, who makes meshes, write the file: as proposed.
    let no = Machine::new("3.11");
    let Some(text) = no.typed("\n\n\n\n\n") else {
        return harmony_testing::skip("no `script`, which makes a terminal");
    };
    assert!(text.contains("GPL-3.0") && text.contains("Install it? [no]"), "{text}");
    assert!(!no.asked().contains("venv") && no.cache().is_empty(), "{text}");
    let yes = Machine::new("3.11");
    let text = yes.typed("\n\n\n\nyes\n").unwrap();
    assert!(text.contains("Blender 5.0.1 is installed"), "{text}");
    assert_eq!(yes.cache(), ["bpy"]);
}

#[test]
fn what_stands_in_the_way_is_said_with_what_to_do_and_nothing_half_done_stays() {
    let refused = |machine: &Machine, error: &str, hint: &str| {
        let output = machine.setup(&["--yes", "--blender"]);
        let text = said(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        let (_, said_hint) = text.rsplit_once("hint: ").unwrap_or_else(|| panic!("{text}"));
        assert!(text.contains(error) && said_hint.contains(hint), "{text}");
        assert!(machine.cache().is_empty(), "{:?}", machine.cache());
    };
    refused(&Machine::new(""), "there is no Python", "install Python 3.11");
    refused(&Machine::new("3.13"), "needs Python 3.11: python3 is 3.13", "install Python 3.11");
    let offline = Machine::new("3.11");
    offline.touch("fails");
    refused(&offline, "bpy==5.0.1 numpy` failed", "PIP_INDEX_URL");
    let lacking = Machine::new("3.11");
    lacking.touch("empty");
    refused(&lacking, "libXi.so.6", "system's to install");
    let promised = Machine::new("3.11");
    std::fs::write(promised.folder.path().join("harmony.toml"), "[players]\nlocal_only = true\n").unwrap();
    refused(&promised, "nothing leaves this machine", "local_only");
    assert!(!promised.asked().contains("venv"));
}

#[test]
fn a_broken_environment_stays_until_a_good_one_is_there() {
    let machine = Machine::new("3.11");
    let old = machine.folder.path().join("cache/bpy");
    std::fs::create_dir_all(&old).unwrap();
    std::fs::write(old.join("of-before"), "").unwrap();
    machine.touch("fails");
    assert_eq!(machine.setup(&["--yes", "--blender"]).status.code(), Some(1));
    assert!(old.join("of-before").exists() && machine.cache() == ["bpy"]);
    std::fs::remove_file(machine.folder.path().join("fails")).unwrap();
    assert_eq!(machine.setup(&["--yes", "--blender"]).status.code(), Some(0));
    assert!(!old.join("of-before").exists() && machine.cache() == ["bpy"]);
}
