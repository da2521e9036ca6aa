//! What a run delivers, read from its folder: the files that a user gets, nothing else.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use harmony_io::{ReadLimits, load_glb};
use harmony_mesh::Mesh;
use harmony_pipeline::{Came, RunFile};
use harmony_render::{Instance, RenderOptions, render_depth_ids};
use harmony_scene::{Camera, Extents, Mask, Room, Scene, SceneObject};

use crate::metrics::depth::median_depth_scale;
use crate::oracle::Faults;
use crate::truth::TruthRoom;

/// A run folder holds no scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PredictionError {
    /// `scene.json`.
    #[error(transparent)]
    File(#[from] harmony_io::FileError),
    /// `scene_full.glb`.
    #[error(transparent)]
    Glb(#[from] harmony_io::GlbError),
}

/// An object of a run.
#[derive(Debug, Clone)]
pub struct PredictedObject {
    /// As in `scene.json`.
    pub object: SceneObject,
    /// Its mesh in the room frame.
    pub mesh: Arc<Mesh>,
    /// Pixels it was made from, at the photo's size.
    pub mask: Option<Mask>,
}

/// A run.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Run folder.
    pub folder: PathBuf,
    /// Camera at the photo's size.
    pub camera: Camera,
    /// The empty room, in its own frame.
    pub room: Room,
    /// Where its floor's back left corner is: the origin, until the run is shifted.
    pub corner: DVec3,
    /// Objects.
    pub objects: Vec<PredictedObject>,
    /// The room's shell.
    pub shell: Arc<Mesh>,
    /// What its looks have changed, where it tells.
    pub looks: Vec<Came>,
    /// What there was for them to find.
    pub faults: Faults,
}

impl Prediction {
    /// Reads a run folder.
    ///
    /// # Errors
    /// A run without a scene.
    pub fn load(folder: &Path) -> Result<Self, PredictionError> {
        let scene: Scene = harmony_io::read_json(&folder.join("scene.json"))?;
        let glb = load_glb(&folder.join("scene_full.glb"), &ReadLimits::default())?;
        let camera = Camera::from(&scene.camera);
        let mut shell = Mesh::default();
        let mut meshes = std::collections::BTreeMap::new();
        for node in glb.nodes {
            let linear = node.transform.matrix3;
            let normals = linear.inverse().transpose();
            let mut mesh = (*node.mesh).clone();
            mesh.map(
                |p| node.transform.transform_point3(p.as_dvec3()).as_vec3(),
                |n| (normals * n.as_dvec3()).normalize_or_zero().as_vec3(),
            );
            if scene.objects.iter().any(|o| o.id.as_str() == node.name) {
                meshes.insert(node.name, Arc::new(mesh));
            } else {
                shell.append(&mesh);
            }
        }
        let objects = scene
            .objects
            .into_iter()
            .filter_map(|object| {
                let mesh = meshes.remove(object.id.as_str())?;
                let mask = object.mask.as_ref().and_then(|m| mask(&folder.join(m), &camera));
                Some(PredictedObject { object, mesh, mask })
            })
            .collect();
        Ok(Self {
            folder: folder.to_owned(),
            camera,
            room: scene.room,
            corner: DVec3::ZERO,
            objects,
            shell: Arc::new(shell),
            faults: Faults::read(folder),
            looks: RunFile::read(folder).map(|file| file.looks).unwrap_or_default(),
        })
    }

    /// Scales the whole run about the room's origin.
    pub fn rescale(&mut self, factor: f64) {
        let e = &mut self.room.extents;
        *e = Extents { width: e.width * factor, height: e.height * factor, depth: e.depth * factor };
        self.room.shape.scaled(factor);
        self.camera.translation *= factor;
        self.map(|p| p * factor);
    }

    /// Moves the whole run.
    pub fn shift(&mut self, by: DVec3) {
        // x_cam = R (x - by) + t
        self.camera.translation -= self.camera.rotation * by;
        self.corner += by;
        self.map(|p| p + by);
    }

    fn map(&mut self, f: impl Fn(DVec3) -> DVec3) {
        let moved = |mesh: &Arc<Mesh>| {
            let mut mesh = (**mesh).clone();
            mesh.map(|p| f(p.as_dvec3()).as_vec3(), |n| n);
            Arc::new(mesh)
        };
        for o in &mut self.objects {
            o.mesh = moved(&o.mesh);
        }
        self.shell = moved(&self.shell);
    }

    /// Ids (object position + 1, 0 = room) and depths from the run's own camera.
    pub fn render(&self) -> (Vec<u32>, Vec<f32>) {
        self.render_from(&self.camera)
    }

    /// The same from another camera.
    pub fn render_from(&self, camera: &Camera) -> (Vec<u32>, Vec<f32>) {
        let instance = |mesh, id| Instance { mesh, linear: DMat3::IDENTITY, translation: DVec3::ZERO, id };
        let shell = u32::MAX;
        let mut instances = vec![instance(&*self.shell, shell)];
        for (i, o) in self.objects.iter().enumerate() {
            instances.push(instance(&*o.mesh, i as u32 + 1));
        }
        let frame = render_depth_ids(camera, &instances, &RenderOptions::default());
        (frame.ids.into_iter().map(|id| if id == shell { 0 } else { id }).collect(), frame.depth)
    }

    /// Median ratio of true to predicted depth over all pixels that have both.
    pub fn depth_ratio(&self, truth: &TruthRoom) -> Option<f64> {
        if self.camera.size != truth.camera.size {
            return None;
        }
        let (_, depth) = self.render();
        let everywhere = Mask::from_fn(truth.camera.size, |_, _| true);
        median_depth_scale(&depth, &truth.depth, &everywhere).map(|s| s.factor)
    }
}

fn mask(path: &Path, camera: &Camera) -> Option<Mask> {
    let mask = harmony_io::load_mask(path).ok()?;
    Some(if mask.size() == camera.size { mask } else { mask.resized(camera.size) })
}
