//! The set's folder: photos in, run folders out.
//!
//! | file | what it is |
//! |---|---|
//! | `batch.json` | what the set is: its name in the queue, where that is (without a password), the program's arguments |
//! | `harmony.toml` | the configuration, the same for all workers |
//! | `photos/<scene>.<ext>` | the photos, byte for byte |
//! | `scenes/<scene>/` | run folders (`docs/run-folder.md`) |
//! | `logs/<scene>.log` | what the scene's program said, all its turns |
//! | `thumbs/<scene>.jpg` | small pictures for the page |
//! | `queue.sqlite` | the queue, where no other is named |
//! | `status.html`, `status.json`, `scenes.csv` | written by `harmony batch` at its end and by `harmony batch status` |
//!
//! Everything is checked before anything is written; what is there is never overwritten by another set.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::BatchError;
use crate::queue::{NewJob, QueueAddress};

/// Version of `batch.json`.
const VERSION: u32 = 1;

/// Name of the embedded queue.
const QUEUE_FILE: &str = "queue.sqlite";

/// Endings of photos in a folder.
const ENDINGS: [&str; 11] = ["jpg", "jpeg", "png", "webp", "bmp", "tif", "tiff", "pnm", "ppm", "pgm", "pbm"];

/// Largest list.
const MAX_LIST_BYTES: u64 = 256 << 20;

/// Longest name of a scene.
const MAX_NAME: usize = 80;

/// `batch.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct About {
    version: u32,
    /// Name in the queue.
    name: String,
    /// Where the queue is; `queue.sqlite` is the one in this folder.
    queue: String,
    /// Arguments of the program.
    args: Vec<String>,
    /// What made it.
    generator: String,
}

/// What to queue.
#[derive(Debug, Clone, PartialEq)]
pub struct Submission {
    /// A folder of photos, or a list: one path a line, relative to the list, `#` begins a comment; a tabulator and a
    /// number after the path is the scene's priority.
    pub from: PathBuf,
    /// Priority of scenes without one of their own.
    pub priority: i64,
}

impl Submission {
    /// How many photos there are, all of them there.
    ///
    /// # Errors
    /// [`BatchError::Photos`].
    pub fn check(&self) -> Result<usize, BatchError> {
        Ok(photos(self)?.len())
    }
}

/// What was queued.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Submitted {
    /// Jobs for the queue; some may be there already.
    pub jobs: Vec<NewJob>,
    /// Photos whose content is in the set already, or twice in what was given.
    pub twice: usize,
}

/// A set's folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SetFolder {
    path: PathBuf,
    about: About,
}

/// A photo that was found.
struct Found {
    path: PathBuf,
    priority: i64,
}

impl SetFolder {
    /// Makes a set's folder, or finds the one that is there when it is the same set: same arguments, same configuration,
    /// same queue.
    ///
    /// # Errors
    /// [`BatchError::Set`] when the folder is something else, another set, or cannot be written.
    pub fn make(
        path: &Path,
        queue: Option<&QueueAddress>,
        args: &[String],
        config: &str,
        generator: &str,
    ) -> Result<Self, BatchError> {
        let refused = |reason: String, hint| BatchError::Set { path: path.to_owned(), reason, hint };
        let unusable = |e: &io::Error| {
            let hint = harmony_io::atomic::io_hint(e).unwrap_or("choose another folder with --out");
            BatchError::Set { path: path.to_owned(), reason: e.to_string(), hint }
        };
        let asked = queue.map_or_else(|| QUEUE_FILE.to_owned(), QueueAddress::shown);
        if path.join("batch.json").exists() {
            let there = Self::open(path)?;
            if there.about.args != args {
                let (has, given) = (there.about.args.join(" "), args.join(" "));
                return Err(refused(
                    format!("it was begun with other arguments: {has}, not {given}"),
                    "one set, one way of making scenes: use the same arguments, or another --out",
                ));
            }
            let had = fs::read_to_string(path.join("harmony.toml")).map_err(|e| unusable(&e))?;
            if had != config {
                return Err(refused(
                    "it was begun with another configuration".to_owned(),
                    "give SET/harmony.toml with --config, or use another --out",
                ));
            }
            if queue.is_some() && there.about.queue != asked {
                return Err(refused(
                    format!("its queue is {}, not {asked}", there.about.queue),
                    "leave --queue out, or use another --out",
                ));
            }
            // Whoever cannot write here would fail at each scene.
            tempfile_in(path).map_err(|e| unusable(&e))?;
            return Ok(there);
        }
        let mut entries = match fs::read_dir(path) {
            Ok(entries) => entries,
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                fs::create_dir_all(path).map_err(|e| unusable(&e))?;
                fs::read_dir(path).map_err(|e| unusable(&e))?
            }
            Err(e) => return Err(unusable(&e)),
        };
        if entries.next().is_some() {
            return Err(refused(
                "it is not empty, and no set".to_owned(),
                "nothing was changed; choose a new or empty folder with --out",
            ));
        }
        tempfile_in(path).map_err(|e| unusable(&e))?;
        let about = About {
            version: VERSION,
            name: format!("{:016x}", rand::random::<u64>()),
            queue: asked,
            args: args.to_vec(),
            generator: generator.to_owned(),
        };
        harmony_io::write_durable(&path.join("harmony.toml"), config.as_bytes())?;
        harmony_io::write_json(&path.join("batch.json"), &about)?;
        Ok(Self { path: path.to_owned(), about })
    }

    /// Opens a set's folder.
    ///
    /// # Errors
    /// [`BatchError::Set`].
    pub fn open(path: &Path) -> Result<Self, BatchError> {
        let refused = |reason: String, hint| BatchError::Set { path: path.to_owned(), reason, hint };
        let file = path.join("batch.json");
        if !file.is_file() {
            return Err(refused(
                "there is no batch.json in it".to_owned(),
                "`harmony batch PHOTOS --out SET` makes a set",
            ));
        }
        let about: About = harmony_io::read_json(&file)?;
        if about.version != VERSION {
            return Err(refused(
                format!("its batch.json is of version {}, this program's of version {VERSION}", about.version),
                "use the version of HARMONY that made it",
            ));
        }
        Ok(Self { path: path.to_owned(), about })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its name in the queue.
    pub fn name(&self) -> &str {
        &self.about.name
    }

    /// The program's arguments.
    pub fn args(&self) -> &[String] {
        &self.about.args
    }

    /// Its queue; an address with a password may be given instead of the one that was written without.
    ///
    /// # Errors
    /// [`BatchError::Address`].
    pub fn queue(&self, given: Option<&str>) -> Result<QueueAddress, BatchError> {
        if let Some(given) = given {
            return QueueAddress::parse(given);
        }
        if self.about.queue == QUEUE_FILE {
            let path = std::path::absolute(self.path.join(QUEUE_FILE)).unwrap_or_else(|_| self.path.join(QUEUE_FILE));
            return Ok(QueueAddress::File(path));
        }
        QueueAddress::parse(&self.about.queue)
    }

    /// Finds photos, names their scenes, copies them into the set. `known`: scenes of the set with the hashes of their
    /// photos.
    ///
    /// # Errors
    /// [`BatchError::Photos`] when one is missing or none is there; then nothing was written.
    pub fn take_photos(&self, what: &Submission, known: &BTreeMap<String, String>) -> Result<Submitted, BatchError> {
        let found = photos(what)?;
        let mut names = known.clone();
        let mut hashes: BTreeSet<String> = known.values().cloned().collect();
        let mut submitted = Submitted::default();
        let mut copies = Vec::new();
        for photo in found {
            let hash = hash_of(&photo.path)?;
            if !hashes.insert(hash.clone()) {
                submitted.twice += 1;
                continue;
            }
            let scene = free_name(&photo.path, &hash, &names);
            let ending = photo.path.extension().and_then(|e| e.to_str()).unwrap_or("jpg").to_ascii_lowercase();
            let relative = format!("photos/{scene}.{ending}");
            copies.push((photo.path, self.path.join(&relative)));
            names.insert(scene.clone(), hash.clone());
            submitted.jobs.push(NewJob { scene, photo: relative, hash, priority: photo.priority });
        }
        for (from, to) in copies {
            copy_whole(&from, &to)?;
        }
        Ok(submitted)
    }

    /// Run folder of a scene.
    pub fn run(&self, scene: &str) -> PathBuf {
        self.path.join("scenes").join(scene)
    }

    /// What a scene's program said.
    pub fn log(&self, scene: &str) -> PathBuf {
        self.path.join("logs").join(format!("{scene}.log"))
    }

    /// A scene's small picture.
    pub fn thumb(&self, scene: &str) -> PathBuf {
        self.path.join("thumbs").join(format!("{scene}.jpg"))
    }

    /// Whether this is the set of that name: a worker that sees another folder under the same path must not work in it.
    pub fn is(&self, name: &str) -> bool {
        self.about.name == name
    }
}

/// Whether files can be made in a folder.
fn tempfile_in(folder: &Path) -> io::Result<()> {
    let probe = folder.join(format!(".probe.{}.0.tmp", std::process::id()));
    File::create(&probe)?;
    fs::remove_file(&probe)
}

/// The photos of a folder or list, all of them there.
fn photos(what: &Submission) -> Result<Vec<Found>, BatchError> {
    let from = &what.from;
    let refused = |reason: String, hint| BatchError::Photos { path: from.clone(), reason, hint };
    let is_photo = |path: &Path| {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        ENDINGS.contains(&ending.as_str())
    };
    let meta =
        fs::metadata(from).map_err(|e| refused(e.to_string(), "give a folder of photos, or a list of their paths"))?;
    let mut found = Vec::new();
    if meta.is_dir() {
        let entries = fs::read_dir(from).map_err(|e| refused(e.to_string(), "check who may read it"))?;
        for entry in entries {
            let path = entry.map_err(|e| refused(e.to_string(), "check who may read it"))?.path();
            if is_photo(&path) && path.is_file() {
                found.push(Found { path, priority: what.priority });
            }
        }
        found.sort_by(|a, b| a.path.cmp(&b.path));
    } else if is_photo(from) {
        found.push(Found { path: from.clone(), priority: what.priority });
    } else {
        let bytes = harmony_io::read_bounded(from, MAX_LIST_BYTES)?;
        let text = String::from_utf8(bytes)
            .map_err(|_| refused("it is not text".to_owned(), "a list has one path a line, in UTF-8"))?;
        let beside = from.parent().unwrap_or_else(|| Path::new(""));
        for (n, line) in text.lines().enumerate() {
            let line = line.trim_end_matches('\r');
            if line.trim().is_empty() || line.starts_with('#') {
                continue;
            }
            let (path, priority) = line.split_once('\t').map_or((line, None), |(path, number)| (path, Some(number)));
            let priority = match priority.map(|number| number.trim().parse::<i64>()) {
                None => what.priority,
                Some(Ok(number)) => number,
                Some(Err(_)) => {
                    let reason = format!("line {}: the priority after the tabulator is no whole number", n + 1);
                    return Err(refused(reason, "a line is a path, or a path, a tabulator and a number"));
                }
            };
            found.push(Found { path: beside.join(path), priority });
        }
    }
    let missing: Vec<&Path> = found.iter().map(|f| f.path.as_path()).filter(|path| !path.is_file()).collect();
    if !missing.is_empty() {
        let named: Vec<String> = missing.iter().take(5).map(|path| path.display().to_string()).collect();
        let more = if missing.len() > 5 { format!(" and {} more", missing.len() - 5) } else { String::new() };
        return Err(refused(
            format!("{} of {} photos are not there: {}{more}", missing.len(), found.len(), named.join(", ")),
            "nothing was queued; paths in a list are relative to the list",
        ));
    }
    if found.is_empty() {
        return Err(refused(
            "no photo in it".to_owned(),
            "photos end in .jpg, .png, .webp, .bmp, .tiff or .pnm; folders inside are not looked into",
        ));
    }
    Ok(found)
}

fn hash_of(path: &Path) -> Result<String, BatchError> {
    let refused = |e: &io::Error| BatchError::Photos {
        path: path.to_owned(),
        reason: e.to_string(),
        hint: "check who may read it; nothing was queued",
    };
    let mut file = File::open(path).map_err(|e| refused(&e))?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(hasher.finalize().to_hex().to_string()),
            Ok(n) => hasher.update(&buffer[..n]),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
            Err(e) => return Err(refused(&e)),
        };
    }
}

/// A name for a photo's scene that no other photo has.
fn free_name(path: &Path, hash: &str, taken: &BTreeMap<String, String>) -> String {
    let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
    let plain: String = stem
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' })
        .take(MAX_NAME)
        .collect();
    let plain = plain.trim_matches('_');
    let plain = if plain.is_empty() { "photo" } else { plain };
    let mut name = plain.to_owned();
    // Longer parts of the hash until it is free; the whole hash is another photo's only when the content is the same.
    let mut length = 6;
    while taken.contains_key(&name) {
        name = format!("{plain}_{}", &hash[..length.min(hash.len())]);
        length += 6;
    }
    name
}

/// Copies a file under a temporary name and renames it.
fn copy_whole(from: &Path, to: &Path) -> Result<(), BatchError> {
    let fail = |source| harmony_io::FileError::Write { path: to.to_owned(), source };
    let folder = to.parent().unwrap_or_else(|| Path::new("."));
    fs::create_dir_all(folder).map_err(fail)?;
    let name = to.file_name().unwrap_or_default().to_string_lossy();
    let temporary = folder.join(format!(".{name}.{}.0.tmp", std::process::id()));
    let copied = fs::copy(from, &temporary).and_then(|_| fs::rename(&temporary, to));
    copied.map_err(|source| {
        let _ = fs::remove_file(&temporary);
        fail(source).into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(folder: &Path, name: &str, bytes: &str) {
        fs::create_dir_all(folder.join(name).parent().unwrap()).unwrap();
        fs::write(folder.join(name), bytes).unwrap();
    }

    fn make(path: &Path, args: &[&str]) -> Result<SetFolder, BatchError> {
        let args: Vec<String> = args.iter().map(|a| (*a).to_owned()).collect();
        SetFolder::make(path, None, &args, "# none\n", "test")
    }

    #[test]
    fn a_second_submission_adds_and_equal_photos_are_one_scene() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        for (name, bytes) in [
            ("in/A room.JPG", "one"),
            ("in/b.png", "two"),
            ("in/notes.txt", "x"),
            ("more/a room.png", "three"),
            ("more/c.png", "two"),
        ] {
            put(root, name, bytes);
        }
        let set = make(&root.join("set"), &["x"]).unwrap();
        let first = Submission { from: root.join("in"), priority: 0 };
        let submitted = set.take_photos(&first, &BTreeMap::new()).unwrap();
        let names: Vec<&str> = submitted.jobs.iter().map(|j| j.scene.as_str()).collect();
        assert_eq!(names, ["a_room", "b"]);
        let known: BTreeMap<String, String> =
            submitted.jobs.iter().map(|j| (j.scene.clone(), j.hash.clone())).collect();
        assert_eq!(fs::read_to_string(root.join("set").join(&submitted.jobs[0].photo)).unwrap(), "one");

        let again = make(&root.join("set"), &["x"]).unwrap();
        assert_eq!(again.name(), set.name());
        put(root, "list", "# more\nmore/a room.png\t7\nmore/c.png\n\n");
        let second = Submission { from: root.join("list"), priority: 2 };
        let submitted = again.take_photos(&second, &known).unwrap();
        assert_eq!(submitted.twice, 1);
        assert_eq!(submitted.jobs.len(), 1);
        assert!(submitted.jobs[0].scene.starts_with("a_room_") && submitted.jobs[0].priority == 7);
        assert_eq!(fs::read_to_string(root.join("set/photos/a_room.jpg")).unwrap(), "one", "the first is as it was");
    }

    #[test]
    fn what_cannot_be_taken_is_refused_and_nothing_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        put(root, "a.png", "one");
        put(root, "list", "a.png\nb.png\nc.png\n");
        put(root, "priorities", "a.png\thigh\n");
        put(root, "latin", "");
        fs::write(root.join("latin"), b"caf\xe9.png\n").unwrap();
        fs::create_dir(root.join("empty")).unwrap();
        let set = make(&root.join("set"), &[]).unwrap();
        for (from, said) in [
            ("list", "2 of 3 photos are not there"),
            ("priorities", "line 1"),
            ("latin", "not text"),
            ("empty", "no photo"),
            ("nowhere", "No such file"),
        ] {
            let what = Submission { from: root.join(from), priority: 0 };
            let error = set.take_photos(&what, &BTreeMap::new()).unwrap_err();
            assert!(error.to_string().contains(said) && error.hint().is_some(), "{from}: {error}");
        }
        assert!(!root.join("set/photos").exists());
    }

    #[test]
    fn a_folder_that_is_no_set_or_another_set_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        put(root, "mine/thesis.txt", "x");
        let error = make(&root.join("mine"), &[]).unwrap_err();
        assert!(error.to_string().contains("not empty"), "{error}");
        assert_eq!(fs::read_dir(root.join("mine")).unwrap().count(), 1);

        make(&root.join("set"), &["a"]).unwrap();
        let before = fs::read(root.join("set/batch.json")).unwrap();
        let error = make(&root.join("set"), &["b"]).unwrap_err();
        assert!(error.to_string().contains("other arguments"), "{error}");
        let other = SetFolder::make(&root.join("set"), None, &["a".to_owned()], "[budget]\n", "test").unwrap_err();
        assert!(other.to_string().contains("configuration"), "{other}");
        let queue = QueueAddress::Postgres("postgres://u:secret@h/d".to_owned());
        let other =
            SetFolder::make(&root.join("set"), Some(&queue), &["a".to_owned()], "# none\n", "test").unwrap_err();
        assert!(other.to_string().contains("its queue is") && !other.to_string().contains("secret"), "{other}");
        assert_eq!(fs::read(root.join("set/batch.json")).unwrap(), before);

        put(root, "later/batch.json", r#"{"version": 9, "name": "x", "queue": "q", "args": [], "generator": ""}"#);
        assert!(SetFolder::open(&root.join("later")).unwrap_err().to_string().contains("version 9"));
        put(root, "file", "x");
        assert!(make(&root.join("file"), &[]).unwrap_err().hint().is_some());
    }
}
