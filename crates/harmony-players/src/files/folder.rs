//! The folder of one question.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::{fs, io};

use harmony_calls::{KeyHasher, MAX_ANSWER_BYTES, pixel_hash};
use harmony_io::atomic::{FileError, json_text, read_bounded, read_json, write_atomic};
use harmony_io::picture::{PictureError, rgb_png};
use harmony_roles::{Role, VlmRequest};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{Look, judge, schema_words};

/// A question's folder can't be used.
#[derive(Debug, thiserror::Error)]
pub(super) enum QuestionError {
    /// A file can't be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// An image can't be written.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// A folder can't be listed or made.
    #[error("cannot {action}: {source}: {path}")]
    Io { action: &'static str, source: io::Error, path: PathBuf },
}

/// `question.json`: which question the folder asks.
#[derive(Serialize, Deserialize)]
struct About {
    name: String,
    key: String,
}

/// A question's folder.
#[derive(Debug)]
pub(super) struct Question {
    folder: PathBuf,
}

/// Numbers are given to one question at a time.
static NUMBERING: Mutex<()> = Mutex::new(());

impl Question {
    /// The folder of a question: the one that asks this already, or a new one.
    pub fn open(root: &Path, request: &VlmRequest) -> Result<Self, QuestionError> {
        let _one_at_a_time = NUMBERING.lock().unwrap_or_else(PoisonError::into_inner);
        let key = key_of(request);
        let mut last = 0;
        for (number, folder) in numbered(root)? {
            last = last.max(number);
            let about = read_json::<About>(&folder.join("question.json"));
            if about.is_ok_and(|about| about.name == request.name && about.key == key) {
                return Ok(Self { folder });
            }
        }
        let slug = slug(&request.name.replace('/', "__"), 80);
        let folder = root.join(format!("{:03}_{slug}", last + 1));
        let temporary = root.join(format!(".new_{:03}", last + 1));
        if temporary.exists() {
            fs::remove_dir_all(&temporary).map_err(failed("remove", &temporary))?;
        }
        write_question(&temporary, last + 1, request, key)?;
        write_atomic(&root.join("README.md"), include_str!("readme.md").as_bytes())?;
        fs::rename(&temporary, &folder).map_err(failed("rename", &temporary))?;
        Ok(Self { folder })
    }

    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What there is to see; an answer whose hash is `judged` is nothing new.
    pub fn look(&self, judged: Option<&str>, schema: &Value) -> Result<Look, QuestionError> {
        let bytes = match read_bounded(&self.folder.join("answer.json"), MAX_ANSWER_BYTES as u64) {
            Ok(bytes) => bytes,
            Err(FileError::Read { source, .. }) if source.kind() == io::ErrorKind::NotFound => {
                return Ok(self.passed().map_or(Look::Nothing, Look::Passed));
            }
            Err(FileError::TooLarge { bytes, limit, .. }) => {
                let hash = format!("too large {bytes}");
                let complaint = format!("the answer has {bytes} bytes; at most {limit} are read");
                return Ok(if judged == Some(&hash) { Look::Nothing } else { Look::Complaint(complaint, hash) });
            }
            Err(error) => return Err(error.into()),
        };
        let hash = hash_of(&bytes);
        if judged == Some(&hash) {
            return Ok(self.passed().map_or(Look::Nothing, Look::Passed));
        }
        Ok(judge(&String::from_utf8_lossy(&bytes), hash, schema))
    }

    /// The words of whoever passes, when there is a file `pass`.
    fn passed(&self) -> Option<String> {
        let bytes = read_bounded(&self.folder.join("pass"), 4096).ok()?;
        let words = String::from_utf8_lossy(&bytes).trim().to_owned();
        Some(if words.is_empty() { "passed without a reason".to_owned() } else { words })
    }

    /// Says what is wrong with the answer.
    pub fn complain(&self, complaint: &str) -> Result<(), QuestionError> {
        let text = format!(
            "# The answer can't be accepted yet\n\n{complaint}\n\nCorrect it and write `answer.json` again, in full.\n"
        );
        self.remove("accepted")?;
        Ok(write_atomic(&self.folder.join("complaint.md"), text.as_bytes())?)
    }

    /// Takes back the acceptance of an answer that turned out to make no sense; returns the hash of that answer.
    pub fn reopen(&self, complaint: &str) -> Result<Option<String>, QuestionError> {
        self.complain(complaint)?;
        let bytes = read_bounded(&self.folder.join("answer.json"), MAX_ANSWER_BYTES as u64);
        Ok(bytes.ok().map(|bytes| hash_of(&bytes)))
    }

    /// Says that the answer has the right form; what it says is for whoever asked to judge.
    pub fn accept(&self, name: &str) -> Result<(), QuestionError> {
        self.remove("complaint.md")?;
        let phase = name.split('/').next().unwrap_or(name);
        let text = format!(
            "The form of the answer is right, and it was taken.\n\nIt is tried next. If something in it does not work, this \
             file gives way to complaint.md, and the\nquestion waits again. What was kept and what was refused, with the \
             reasons, stands in the run folder:\nreport.html and the JSON files of {phase}/.\n"
        );
        Ok(write_atomic(&self.folder.join("accepted"), text.as_bytes())?)
    }

    fn remove(&self, file: &str) -> Result<(), QuestionError> {
        let path = self.folder.join(file);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(failed("remove", &path)(error)),
            _ => Ok(()),
        }
    }
}

fn failed(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> QuestionError {
    let path = path.to_owned();
    move |source| QuestionError::Io { action, source, path }
}

fn hash_of(bytes: &[u8]) -> String {
    pixel_hash(0, 0, bytes)
}

/// What makes a question the same question; a complaint about an earlier answer does not change it.
fn key_of(request: &VlmRequest) -> String {
    let mut hasher = KeyHasher::new(Role::VisionLanguage);
    hasher.text("name", &request.name);
    hasher.text("prompt", request.split_complaint().0);
    hasher.json("schema", &request.schema);
    for picture in &request.pictures {
        hasher.text("caption", &picture.caption);
        let (width, height) = picture.image.dimensions();
        hasher.pixels("picture", &pixel_hash(width, height, picture.image.as_raw()));
    }
    hasher.finish().0
}

/// Question folders with their numbers, in order.
fn numbered(root: &Path) -> Result<Vec<(u32, PathBuf)>, QuestionError> {
    let listing = match fs::read_dir(root) {
        Ok(listing) => listing,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(failed("list", root)(error)),
    };
    let mut folders = Vec::new();
    for entry in listing {
        let path = entry.map_err(failed("list", root))?.path();
        let number = path
            .file_name()
            .and_then(|name| name.to_str())
            .and_then(|name| name.split('_').next())
            .and_then(|number| number.parse::<u32>().ok());
        if let Some(number) = number.filter(|_| path.is_dir()) {
            folders.push((number, path));
        }
    }
    folders.sort();
    Ok(folders)
}

/// Letters, digits and underscores of a text, so that it can be part of a file name.
fn slug(text: &str, limit: usize) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
    text.chars().map(plain).take(limit).collect()
}

/// Words of a caption without its `IMAGE 1:`.
fn image_file(i: usize, caption: &str) -> String {
    let words = caption.split_once(':').map_or(caption, |(_, words)| words);
    let slug = slug(words.trim(), 40);
    let slug: Vec<&str> = slug.split('_').filter(|part| !part.is_empty()).collect();
    format!("image_{}_{}.png", i + 1, slug.join("_")).replace("_.png", ".png")
}

fn write_question(folder: &Path, number: u32, request: &VlmRequest, key: String) -> Result<(), QuestionError> {
    let mut images = String::new();
    for (i, picture) in request.pictures.iter().enumerate() {
        let file = image_file(i, &picture.caption);
        write_atomic(&folder.join(&file), &rgb_png(&picture.image)?)?;
        let (width, height) = picture.image.dimensions();
        let caption = &picture.caption;
        let _ = write!(images, "### {caption}\n\n{width} x {height} pixels\n\n![{file}]({file})\n\n");
    }
    let json = |file: &str, value: &Value| -> Result<(), QuestionError> {
        let path = folder.join(file);
        let text = json_text(value).map_err(|source| FileError::Encode { path: path.clone(), source })?;
        Ok(write_atomic(&path, text.as_bytes())?)
    };
    json("schema.json", &request.schema)?;
    json("example.json", &request.example)?;
    let text = include_str!("prompt.md")
        .replace("{number}", &number.to_string())
        .replace("{name}", &request.name)
        .replace("{form}", schema_words::in_words(&request.schema).trim_end())
        .replace("{images}", if images.is_empty() { "(none)\n" } else { &images })
        // Last, so that nothing in the question's own words is taken for a place to fill.
        .replace("{question}", request.split_complaint().0.trim_end());
    write_atomic(&folder.join("prompt.md"), text.as_bytes())?;
    let about = About { name: request.name.clone(), key };
    harmony_io::write_json(&folder.join("question.json"), &about)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_hold_nothing_but_plain_characters() {
        assert_eq!(image_file(0, "IMAGE 1: the photo"), "image_1_the_photo.png");
        assert_eq!(image_file(1, "../../etc/passwd"), "image_2_etc_passwd.png");
        assert_eq!(image_file(2, "IMAGE 3:"), "image_3.png");
        assert_eq!(slug("3_furniture__Sofa é/..", 80), "3_furniture__sofa_____");
    }
}
