//! How each role's requests and answers become files, and what an answer must be to be taken.

mod measurement;
mod pictures;
mod shapes;
mod texts;

use std::future::Future;
use std::path::Path;

use harmony_roles::{PlayerCard, Role, RoleError, Usage};
use image::{RgbImage, RgbaImage};
use serde_json::{Value, json};

use crate::ContentKey;
use crate::book::{BookError, RecordWriter};
use crate::key::{KeyHasher, pixel_hash};

/// A request that can be asked, recorded and read back.
pub(crate) trait Recordable: Clone + Send + Sync + 'static {
    /// What comes back.
    type Answer: Clone + Send + Sync + 'static;
    /// Who answers: the role's trait object.
    type Player: ?Sized + Send + Sync + 'static;
    /// The role.
    const ROLE: Role;

    /// Call name, unchecked.
    fn name(&self) -> &str;
    /// Who is playing.
    fn card(player: &Self::Player) -> PlayerCard;
    /// Whether it answers in its own time, as a person does.
    fn in_own_time(_player: &Self::Player) -> bool {
        false
    }
    /// Asks the player once.
    fn play(&self, player: &Self::Player) -> impl Future<Output = Result<Self::Answer, RoleError>> + Send;
    /// Adds everything that the answer may depend on.
    fn hash(&self, hasher: &mut KeyHasher);
    /// What reaches this player, where that is less than the request: calls with one key are the same work, paid once.
    /// `None` = every call is work of its own.
    fn work(&self, _player: &Self::Player) -> Option<ContentKey> {
        None
    }
    /// Writes the request's files; `offline` calls are not worth their images.
    fn write_request(&self, out: &RecordWriter<'_>, offline: bool) -> Result<(), BookError>;
    /// Writes the answer's files, always with an `answer.json`.
    fn write_answer(&self, answer: &Self::Answer, out: &RecordWriter<'_>) -> Result<(), BookError>;
    /// Reads the answer's files.
    fn read_answer(&self, folder: &Path) -> Result<Self::Answer, String>;
    /// Whether an answer can be used at all: fits the schema, finite, of the right size.
    fn check(&self, answer: &Self::Answer) -> Result<(), String>;
    /// Tokens and cost.
    fn usage(_answer: &Self::Answer) -> Usage {
        Usage::default()
    }
    /// The answer as text, to be shown with a complaint about it.
    fn raw(_answer: &Self::Answer) -> String {
        String::new()
    }
    /// The request with a complaint about the previous answer; the same request for roles that take none.
    fn again(&self, _complaint: &str, _raw: &str) -> Self {
        self.clone()
    }
}

/// Hash of an RGB image's pixels.
pub(crate) fn rgb_hash(image: &RgbImage) -> String {
    pixel_hash(image.width(), image.height(), image.as_raw())
}

/// Hash of an RGBA image's pixels.
pub(crate) fn rgba_hash(image: &RgbaImage) -> String {
    pixel_hash(image.width(), image.height(), image.as_raw())
}

/// What `request.json` says about an image, and the image itself beside it unless the call is an offline one.
fn show_rgb(
    out: &RecordWriter<'_>,
    file: &str,
    image: &RgbImage,
    caption: &str,
    offline: bool,
) -> Result<Value, BookError> {
    let hash = rgb_hash(image);
    if !offline {
        out.image(file, &hash, || harmony_io::picture::rgb_png(image).map_err(|error| error.to_string()))?;
    }
    Ok(json!({"caption": caption, "width": image.width(), "height": image.height(), "blake3": hash}))
}

/// As [`show_rgb`].
fn show_rgba(
    out: &RecordWriter<'_>,
    file: &str,
    image: &RgbaImage,
    caption: &str,
    offline: bool,
) -> Result<Value, BookError> {
    let hash = rgba_hash(image);
    if !offline {
        out.image(file, &hash, || harmony_io::picture::rgba_png(image).map_err(|error| error.to_string()))?;
    }
    Ok(json!({"caption": caption, "width": image.width(), "height": image.height(), "blake3": hash}))
}

/// Turns another crate's write error into the book's.
fn write_failed(out: &RecordWriter<'_>, file: &str, error: &dyn std::fmt::Display) -> BookError {
    BookError::Write { reason: error.to_string(), path: out.folder().join(file) }
}
