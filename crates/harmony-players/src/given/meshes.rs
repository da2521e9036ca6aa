//! A folder of GLB files as a mesh generator.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use async_trait::async_trait;
use harmony_calls::CallName;
use harmony_io::ReadLimits;
use harmony_roles::{GeneratedMesh, MeshFrame, MeshGenerator, MeshRequest, PlayerCard, RoleError, Usage};
use harmony_scene::ObjectId;

use crate::check::{Check, Checked};

/// Meshes that were made before: `chair_02.glb` for the object of that id, `chair.glb` for any object whose label that
/// is. They are taken as generators leave them: to be de-tilted, turned and scaled.
#[derive(Debug, Clone)]
pub struct MeshFolder {
    folder: PathBuf,
    digest: String,
}

impl MeshFolder {
    /// Opens a folder.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`] when it can't be listed.
    pub fn new(folder: PathBuf) -> Result<Self, RoleError> {
        let files = glb_files(&folder).map_err(|error| not_set_up(error.to_string()))?;
        let mut hasher = harmony_calls::KeyHasher::new(harmony_roles::Role::MeshGenerator);
        for (file, bytes) in files {
            hasher.text("file", &file);
            hasher.text("bytes", &bytes.to_string());
        }
        let digest = hasher.finish().0.chars().take(16).collect();
        Ok(Self { folder, digest })
    }

    /// The file for an object: only names that are object ids are looked for, whatever the request says.
    fn file_for(&self, request: &MeshRequest) -> Option<PathBuf> {
        let by_id = CallName::new(&request.name).ok().and_then(|name| name.object());
        let label = ObjectId::numbered(&request.label, 1);
        let stem = label.as_str().rsplit_once('_').map(|(stem, _)| stem.to_owned());
        let names = by_id.map(|id| id.to_string()).into_iter().chain(stem);
        names.map(|name| self.folder.join(format!("{name}.glb"))).find(|path| path.is_file())
    }
}

fn not_set_up(reason: String) -> RoleError {
    let hint = "check the path of the folder with the GLB files".to_owned();
    RoleError::NotSetUp { player: "mesh folder".to_owned(), reason, hint }
}

#[async_trait]
impl Check for MeshFolder {
    /// A folder without a file is most likely another one than was meant.
    async fn check(&self, _paid: bool) -> Result<Checked, RoleError> {
        let count = glb_files(&self.folder).map_err(|error| not_set_up(error.to_string()))?.len();
        if count == 0 {
            return Err(not_set_up(format!("there is no GLB file in {}", self.folder.display())));
        }
        Ok(Checked { detail: format!("{count} GLB files"), usage: None })
    }
}

/// Names and sizes of the GLB files of a folder, in order.
fn glb_files(folder: &Path) -> std::io::Result<Vec<(String, u64)>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if Path::new(&name).extension().is_some_and(|e| e.eq_ignore_ascii_case("glb")) {
            files.push((name, entry.metadata()?.len()));
        }
    }
    files.sort();
    Ok(files)
}

#[async_trait]
impl MeshGenerator for MeshFolder {
    fn card(&self) -> PlayerCard {
        let model = format!("GLB files {}", self.digest);
        // Not `offline`: there may be no file for an object, and then the offline player makes the mesh.
        PlayerCard { player: "mesh folder".to_owned(), model, offline: false, concurrency: 0 }
    }

    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        let Some(path) = self.file_for(request) else {
            return Err(RoleError::NotCapable {
                player: "mesh folder".to_owned(),
                reason: format!("there is no file for {}", request.label),
            });
        };
        let file = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let loaded = tokio::task::spawn_blocking(move || harmony_io::load_mesh_glb(&path, &ReadLimits::default()));
        let mesh = match loaded.await {
            Ok(Ok(mesh)) => mesh,
            Ok(Err(error)) => {
                return Err(RoleError::UnusableAnswer {
                    player: "mesh folder".to_owned(),
                    complaint: format!("{file}: {error}"),
                    raw: String::new(),
                });
            }
            Err(error) => {
                return Err(RoleError::Io { player: "mesh folder".to_owned(), source: std::io::Error::other(error) });
            }
        };
        Ok(GeneratedMesh {
            mesh: Arc::new(mesh),
            convex: None,
            frame: MeshFrame::Raw,
            part_model: None,
            source: file,
            notes: vec![],
            usage: Usage::default(),
        })
    }
}
