//! A program that is killed, wherever it stands, loses nothing but the call in flight.
#![cfg(unix)]

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use crate::common::{self, assert_same, program, root, timeless};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Small pictures: the same calls and files as with large ones, in a third of the time.
const SETTINGS: &str = "[settings]\nworking_px = 256\nsurface_px_per_m = 20.0\n";

/// Longest patience with anything.
const PATIENCE: Duration = Duration::from_mins(5);

/// Role and name of a call, and what would change if its record were written again: file number and times.
type Records = BTreeMap<(String, String), (u64, Vec<u8>)>;

/// One and the same command, started again and again.
struct Job {
    run: PathBuf,
    config: PathBuf,
    log: PathBuf,
}

impl Job {
    fn new(folder: &Path, name: &str) -> Self {
        let config = folder.join("settings.toml");
        fs::write(&config, SETTINGS).unwrap();
        Self { run: folder.join(name), config, log: folder.join(format!("{name}.log")) }
    }

    fn start(&self) -> Child {
        program()
            .args(["reconstruct", "examples/home_office.jpg", "--no-lit"])
            .args(["--replay", "examples/home_office_recording"])
            .arg("--config")
            .arg(&self.config)
            .arg("--out")
            .arg(&self.run)
            .env("RUST_LOG", "harmony_calls=debug")
            .stdout(Stdio::null())
            .stderr(File::create(&self.log).unwrap())
            .spawn()
            .unwrap()
    }

    /// Runs to the end.
    fn finish(&self) {
        let status = self.start().wait().unwrap();
        assert!(status.success(), "{status}: {}", self.said());
    }

    fn said(&self) -> String {
        fs::read_to_string(&self.log).unwrap()
    }

    /// Role and name of every call that the last start made: to a player, or to the recording.
    fn asked(&self) -> BTreeSet<(String, String)> {
        let said = self.said();
        let field = |line: &str, name: &str| {
            let rest = line.split_once(&format!("{name}="))?.1;
            Some(rest.split_whitespace().next()?.trim_matches('"').to_owned())
        };
        said.lines()
            .filter(|line| line.contains("asked role="))
            .map(|line| (field(line, "role").unwrap(), field(line, "call").unwrap()))
            .collect()
    }

    /// Every record there is: role and name, and what would change if it were written again.
    fn records(&self) -> Records {
        let calls = self.run.join("calls");
        let mut found = BTreeMap::new();
        let mut folders = vec![calls.clone()];
        while let Some(folder) = folders.pop() {
            let record = folder.join("record.json");
            if record.is_file() {
                let relative = folder.strip_prefix(&calls).unwrap().to_str().unwrap().to_owned();
                let (role, name) = relative.split_once('/').unwrap();
                let node = fs::metadata(&record).unwrap().ino();
                let time = fs::read(folder.join("timing.json")).unwrap();
                found.insert((role.to_owned(), name.to_owned()), (node, time));
                continue;
            }
            for entry in fs::read_dir(&folder).into_iter().flatten().map(|e| e.unwrap()) {
                if entry.file_type().unwrap().is_dir() && !entry.file_name().to_str().unwrap().starts_with('.') {
                    folders.push(entry.path());
                }
            }
        }
        found
    }
}

/// When to kill.
#[derive(Debug, Clone, Copy)]
enum Moment {
    /// So long after so many lines of progress: a moment of the run itself, however busy the machine is.
    After(usize, Duration),
    /// As soon as there are so many records.
    Records(usize),
}

/// Starts the job and kills it at its moment; `false` when it had ended before.
fn kill(job: &Job, moment: Moment) -> bool {
    let mut child = job.start();
    let clock = Instant::now();
    let mut reached = None;
    loop {
        let due = match moment {
            Moment::After(lines, time) => {
                if reached.is_none() && progress(&job.said()) >= lines {
                    reached = Some(Instant::now());
                }
                reached.is_some_and(|at| at.elapsed() >= time)
            }
            Moment::Records(wanted) => job.records().len() >= wanted,
        };
        if due || child.try_wait().unwrap().is_some() || clock.elapsed() > PATIENCE {
            break;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    let status: ExitStatus = child.wait().unwrap();
    if status.signal() == Some(9) {
        return true;
    }
    assert!(status.success(), "{status}: {}", job.said());
    false
}

/// Lines that tell a step or the end of a phase; a run that goes on tells the same ones again.
fn progress(said: &str) -> usize {
    said.lines().filter(|line| line.as_bytes().get(1) == Some(&b'_') && line.contains(": ")).count()
}

/// Runs to the end; when each line of progress came, and when it was over.
fn timeline(job: &Job) -> Vec<Duration> {
    let mut child = job.start();
    let clock = Instant::now();
    let mut times = vec![Duration::ZERO];
    let status = loop {
        let lines = progress(&job.said());
        while times.len() <= lines {
            times.push(clock.elapsed());
        }
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    assert!(status.success(), "{status}: {}", job.said());
    times.push(clock.elapsed());
    times
}

/// A moment of a timeline as a line of progress and a time after it.
fn moment_at(timeline: &[Duration], time: Duration) -> Moment {
    let lines = timeline.iter().rposition(|line| *line <= time).unwrap_or(0).min(timeline.len() - 2);
    Moment::After(lines, time.saturating_sub(timeline[lines]))
}

/// What a killed program leaves is whole: every file that is not marked as temporary can be read.
fn assert_whole(run: &Path) {
    for (path, bytes) in common::files(run) {
        let temporary = path.components().any(|part| {
            let part = part.as_os_str().to_str().unwrap();
            part == ".tmp" || (part.starts_with('.') && part.rsplit('.').next() == Some("tmp"))
        });
        if temporary {
            continue;
        }
        let whole = match path.extension().and_then(|e| e.to_str()) {
            Some("json") => serde_json::from_slice::<serde_json::Value>(&bytes).is_ok(),
            Some("png") => bytes.ends_with(b"IEND\xaeB`\x82"),
            Some("glb") => bytes.len() >= 12 && bytes[8..12] == (bytes.len() as u32).to_le_bytes(),
            Some("html") => bytes.trim_ascii_end().ends_with(b"</html>"),
            _ => true,
        };
        assert!(whole, "{} is not whole after a kill", path.display());
    }
}

#[test]
fn killed_at_20_random_moments_a_run_ends_in_the_same_bytes_and_no_call_is_made_twice() {
    let folder = tempfile::tempdir().unwrap();
    let undisturbed = Job::new(folder.path(), "undisturbed");
    let timeline = timeline(&undisturbed);
    let whole_run = *timeline.last().unwrap();
    let wanted = timeless(&undisturbed.run);
    let calls = undisturbed.records().len();
    assert_eq!(undisturbed.asked().len(), calls, "every call of an undisturbed run is logged and recorded");

    // 20 moments: one in each sixteenth of the run, and four right after a record appeared.
    let seed = 20;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut moments = Vec::new();
    for i in 0..16 {
        let time = whole_run.mul_f64((f64::from(i) + random.random_range(0.0..1.0)) / 16.0);
        moments.push(moment_at(&timeline, time));
    }
    for i in 0..4 {
        moments.push(Moment::Records(1 + i * calls / 4 + random.random_range(0..calls / 4)));
    }
    for i in (1..moments.len()).rev() {
        moments.swap(i, random.random_range(0..=i));
    }

    let mut folders = (1..).map(|number| Job::new(folder.path(), &format!("run_{number}")));
    let mut job = folders.next().unwrap();
    let mut recorded = BTreeMap::new();
    let mut kills_here = 0;
    for moment in moments {
        let mut moment = match moment {
            Moment::Records(wanted) if wanted <= recorded.len() && recorded.len() < calls => {
                Moment::Records(recorded.len() + 1)
            }
            Moment::Records(_) if recorded.len() == calls => {
                moment_at(&timeline, whole_run.mul_f64(random.random_range(0.0..0.5)))
            }
            other => other,
        };
        // When the machine is less busy now, a run may end before its last moments: it is judged, and a fresh one killed.
        while !kill(&job, moment) {
            judge(&job, &recorded, calls, &wanted);
            (job, recorded, kills_here) = (folders.next().unwrap(), BTreeMap::new(), 0);
            if let Moment::After(_, time) = &mut moment {
                *time = time.mul_f64(0.7);
            }
        }
        assert_whole(&job.run);
        recorded = check_calls(&job, &recorded, &format!("killed at {moment:?}"));
        kills_here += 1;
        if kills_here == 7 {
            job.finish();
            judge(&job, &recorded, calls, &wanted);
            (job, recorded, kills_here) = (folders.next().unwrap(), BTreeMap::new(), 0);
        }
    }
    job.finish();
    judge(&job, &recorded, calls, &wanted);
}

/// A run that has ended is as it must be.
fn judge(job: &Job, recorded: &Records, calls: usize, wanted: &BTreeMap<PathBuf, Vec<u8>>) {
    let when = format!("the end of {}", job.run.file_name().unwrap().display());
    assert_eq!(check_calls(job, recorded, &when).len(), calls, "{when}");
    assert_same(&timeless(&job.run), wanted, &when);
}

/// Nothing that was recorded before the last start was asked or written again by it; returns the records of now.
fn check_calls(job: &Job, before: &Records, when: &str) -> Records {
    let asked = job.asked();
    let again: Vec<_> = before.keys().filter(|call| asked.contains(*call)).collect();
    assert!(again.is_empty(), "{when}: asked again: {again:?}");
    let now = job.records();
    let changed: Vec<_> = before.iter().filter(|(call, mark)| now.get(*call) != Some(mark)).map(|(c, _)| c).collect();
    assert!(changed.is_empty(), "{when}: records gone or written again: {changed:?}");
    now
}

#[test]
fn a_person_is_asked_no_question_twice_however_often_the_program_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("settings.toml");
    let questions = folder.path().join("questions");
    fs::write(&config, format!("{SETTINGS}[files]\nfolder = {:?}\n", questions.to_str().unwrap())).unwrap();
    let run = folder.path().join("run");
    let start = || {
        program()
            .args(["reconstruct", "examples/home_office.jpg", "--no-lit", "--profile", "files", "--until", "wall"])
            .arg("--config")
            .arg(&config)
            .arg("--out")
            .arg(&run)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    };
    let mut answered: Vec<String> = Vec::new();
    loop {
        // Whoever answers tidies up: nothing but the records knows of earlier questions.
        let _ = fs::remove_dir_all(&questions);
        let mut child = start();
        let clock = Instant::now();
        let question = loop {
            if let Some(status) = child.try_wait().unwrap() {
                assert!(status.success(), "{status}");
                break None;
            }
            let open = fs::read_dir(&questions).into_iter().flatten().map(|e| e.unwrap().path()).find(|p| {
                p.is_dir() && p.file_name().unwrap().to_str().unwrap().starts_with(|c: char| c.is_ascii_digit())
            });
            if let Some(open) = open {
                break Some(open);
            }
            assert!(clock.elapsed() < PATIENCE, "no question came");
            std::thread::sleep(Duration::from_millis(5));
        };
        let Some(question) = question else { break };
        let about: serde_json::Value =
            serde_json::from_slice(&fs::read(question.join("question.json")).unwrap()).unwrap();
        let name = about["name"].as_str().unwrap().to_owned();
        assert!(!answered.contains(&name), "{name} was asked again");
        let recorded = root().join("examples/home_office_recording/vision_language").join(&name).join("answer.json");
        fs::copy(&recorded, question.join("answer.new")).unwrap();
        fs::rename(question.join("answer.new"), question.join("answer.json")).unwrap();
        let record = run.join("calls/vision_language").join(&name).join("record.json");
        while !record.is_file() {
            assert!(clock.elapsed() < PATIENCE, "the answer to {name} was not recorded");
            assert!(child.try_wait().unwrap().is_none(), "the program ended over {name}");
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        answered.push(name);
    }
    let wall = ["list", "inspect", "programs", "review_1", "second_look_1"].map(|step| format!("2_wall/{step}"));
    assert_eq!(answered[0], "1_layout/layout");
    assert_eq!(answered[1..], wall);
}

#[test]
fn one_program_at_a_time_and_a_killed_one_is_not_in_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let command = |profile: &str| {
        let mut command = program();
        command
            .args(["reconstruct", "examples/home_office.jpg", "--no-lit", "--until", "layout", "--profile", profile])
            .arg("--out")
            .arg(&run);
        command
    };
    // Waits for an answer, for ever.
    let mut first = command("files").stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let clock = Instant::now();
    while !run.join("questions/001_1_layout__layout").is_dir() {
        assert!(clock.elapsed() < PATIENCE && first.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(10));
    }
    let before = common::files(&run);
    let second = command("offline").output().unwrap();
    let said = common::said(&second);
    assert_eq!(second.status.code(), Some(1), "{said}");
    assert!(said.contains("another harmony is at work") && said.contains("hint: "), "{said}");
    assert_same(&common::files(&run), &before, "the second program wrote");

    first.kill().unwrap();
    first.wait().unwrap();
    fs::write(run.join(".scene.json.1.1.tmp"), "half").unwrap();
    let third = command("offline").output().unwrap();
    assert!(third.status.success(), "{}", common::said(&third));
    assert!(!run.join(".scene.json.1.1.tmp").exists(), "what a killed program left half-written is removed");
}

#[test]
fn a_reader_that_goes_away_is_no_error_and_a_full_disk_behind_a_redirection_is_one() {
    for args in [&["schema", "scene"][..], &["doctor"], &["doctor", "--json"]] {
        let mut child = program().args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{args:?}: {}", common::said(&output));
        assert!(output.stderr.is_empty(), "{args:?}: {}", common::said(&output));
    }
    // Nobody listens to errors either.
    let mut child = program().args(["show", "no/such/run"]).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stderr.take());
    assert_eq!(child.wait().unwrap().code(), Some(1));

    if let Ok(full) = File::options().write(true).open("/dev/full") {
        let output = program().args(["schema", "scene"]).stdout(full).output().unwrap();
        assert_eq!(output.status.code(), Some(1));
        assert!(common::said(&output).contains("the disk is full"), "{}", common::said(&output));
    }
}
