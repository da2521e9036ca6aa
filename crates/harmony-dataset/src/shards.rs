//! Tar shards as WebDataset reads them: the files of a scene stand together, their names begin with the scene's.
//!
//! Members are `<split>-<scene>.<rest>`; WebDataset takes what is before the first point for the key. Nothing of the
//! machine (times, owners) is written: the same scenes give the same bytes.

use std::path::Path;

use crate::DatasetError;
use crate::layout::SceneId;

/// A member's name in a shard.
pub fn member(id: &SceneId, file: &str) -> String {
    format!("{}-{}.{}", id.split.name(), id.name, file.replace('/', "."))
}

/// The bytes of a shard of these files: name and content.
///
/// # Errors
/// A name that tar cannot hold.
pub fn shard(members: &[(String, Vec<u8>)]) -> Result<Vec<u8>, DatasetError> {
    let refuse =
        |name: &str| DatasetError::Format { what: name.to_owned(), format: "tar", why: "its name is too long" };
    let mut builder = tar::Builder::new(Vec::new());
    for (name, bytes) in members {
        let mut header = tar::Header::new_ustar();
        header.set_path(Path::new(name)).map_err(|_| refuse(name))?;
        header.set_size(bytes.len() as u64);
        header.set_mode(0o644);
        header.set_uid(0);
        header.set_gid(0);
        header.set_mtime(0);
        header.set_cksum();
        builder.append(&header, bytes.as_slice()).map_err(|_| refuse(name))?;
    }
    builder.into_inner().map_err(|_| refuse(""))
}
