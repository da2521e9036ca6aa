//! What of a run folder is path-traced: the scene under even light, and the factors that were fitted to it.

use std::path::{Path, PathBuf};

use harmony_scene::AlbedoField;

use crate::atomic::read_json;

/// The GLB that the run's light was fitted to, without the photo's light in faces and vertices; the scene's own file
/// where the run has no light. Whoever path-traces a run takes this one: with [`albedo_field`] the other is lit twice.
pub fn scene_for_light(run: &Path) -> PathBuf {
    let fitted = run.join("6_lighting/scene_for_light.glb");
    if fitted.is_file() { fitted } else { run.join("scene_full.glb") }
}

/// The run's reflectance factors; `None` when it has none.
pub fn albedo_field(run: &Path) -> Option<AlbedoField> {
    read_json(&run.join("6_lighting/albedo.json")).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_light_was_fitted_to_goes_before_the_scene_that_shows_the_photos_light() {
        let run = tempfile::tempdir().unwrap();
        std::fs::write(run.path().join("scene_full.glb"), b"as the photo shows it").unwrap();
        assert_eq!(scene_for_light(run.path()), run.path().join("scene_full.glb"));
        std::fs::create_dir(run.path().join("6_lighting")).unwrap();
        std::fs::write(run.path().join("6_lighting/scene_for_light.glb"), b"even").unwrap();
        assert_eq!(scene_for_light(run.path()), run.path().join("6_lighting/scene_for_light.glb"));
    }
}
