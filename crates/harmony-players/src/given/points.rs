//! A point-map file as a geometry estimator.

use std::path::PathBuf;

use async_trait::async_trait;
use harmony_io::PointMapOptions;
use harmony_roles::{GeometryAnswer, GeometryEstimator, GeometryRequest, PlayerCard, RoleError};

/// Points that were computed or measured before.
#[derive(Debug, Clone)]
pub struct PointMapFile {
    path: PathBuf,
    options: PointMapOptions,
    digest: String,
}

impl PointMapFile {
    /// A file, and what is known about it beside what it says. It is read when it is asked for.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`] when the file can't be read.
    pub fn new(path: PathBuf, options: PointMapOptions) -> Result<Self, RoleError> {
        let bytes = std::fs::read(&path).map_err(|error| not_usable(&error.to_string()))?;
        let options_text = format!("{options:?}");
        let mut hasher = harmony_calls::KeyHasher::new(harmony_roles::Role::GeometryEstimator);
        hasher.bytes("file", &bytes);
        hasher.text("options", &options_text);
        let digest = hasher.finish().0.chars().take(16).collect();
        Ok(Self { path, options, digest })
    }
}

fn not_usable(reason: &str) -> RoleError {
    RoleError::NotSetUp {
        player: "point-map file".to_owned(),
        reason: reason.to_owned(),
        hint: "check the path of the point map, or leave it out to do without depth".to_owned(),
    }
}

#[async_trait]
impl GeometryEstimator for PointMapFile {
    fn card(&self) -> PlayerCard {
        // The content is part of the name: another file is another player.
        PlayerCard { player: "point-map file".to_owned(), model: self.digest.clone(), offline: true, concurrency: 0 }
    }

    async fn estimate(&self, _request: &GeometryRequest) -> Result<GeometryAnswer, RoleError> {
        let (path, options) = (self.path.clone(), self.options);
        let loaded = tokio::task::spawn_blocking(move || harmony_io::load_point_map(&path, &options)).await;
        match loaded {
            Ok(Ok(map)) => Ok(GeometryAnswer::Points(std::sync::Arc::new(map))),
            Ok(Err(error)) => Err(not_usable(&error.to_string())),
            Err(error) => {
                Err(RoleError::Io { player: "point-map file".to_owned(), source: std::io::Error::other(error) })
            }
        }
    }
}
