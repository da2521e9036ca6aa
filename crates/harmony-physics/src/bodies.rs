//! Every object of a scene as a rigid body.
//!
//! # Frames
//! Hulls, centre of mass and inertia are in the **object frame**: the canonical mesh after scale and stretch, metres, +Y up,
//! bottom centre at the origin; `room = position + Ry(yaw) * p` with the pose of `scene.json`. Hulls of the shell are in the
//! room frame.
//!
//! Meshes that are equal share one decomposition (key: a hash of their triangles); it is made at the size of the largest
//! instance, so that the fit holds for all. With [`BodySettings::cache`] decompositions are kept on disk.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use harmony_mesh::{Mesh, simple_form};
use harmony_scene::{Mat3, ObjectId, Scene, SceneObject, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::decompose::{Decomposition, Fit, decompose};
use crate::hull::{Hull, Moments};
use crate::matter::{self, Motion};
use crate::shell::shell;

/// Raised when decompositions of before are no longer what would be made.
const CACHE_VERSION: u32 = 4;

/// A rigid body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// The object.
    pub id: String,
    /// Whether it moves.
    pub motion: Motion,
    /// Convex colliders, object frame, metres; none of what gives way (rugs).
    pub hulls: Vec<Hull>,
    /// Mass, kilograms.
    pub mass_kg: f64,
    /// Coefficient of friction against dry wood.
    pub friction: f64,
    /// Coefficient of restitution, 0 to 1.
    pub restitution: f64,
    /// Object frame, metres.
    pub centre_of_mass: Vec3,
    /// About the centre of mass, axes of the object frame, kg m2; rows.
    pub inertia: [[f64; 3]; 3],
    /// Distance between colliders and mesh at the 95th percentile, the larger of both ways, metres.
    pub fit_m: f64,
    /// What was assumed or could not be had.
    pub notes: Vec<String>,
}

/// All bodies of a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bodies {
    /// One an object, in the scene's order.
    pub objects: Vec<Body>,
    /// Node name of the face and its colliders, room frame.
    pub shell: Vec<(String, Vec<Hull>)>,
}

/// How bodies are made.
#[derive(Debug, Clone, Default)]
pub struct BodySettings {
    /// Folder in which decompositions are kept by the hash of their mesh; `None` keeps none.
    pub cache: Option<PathBuf>,
}

/// An object that cannot become a body.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BodyError {
    /// There is no mesh of it.
    #[error("{object} has no mesh")]
    NoMesh {
        /// Which.
        object: String,
    },
    /// Its mesh has no triangle with finite corners and an extent.
    #[error("the mesh of {object} has no usable triangle")]
    EmptyMesh {
        /// Which.
        object: String,
    },
    /// Its pose is not finite, or its scale not positive.
    #[error("the pose of {object} cannot be used: scale {scale}, position {position}")]
    Pose {
        /// Which.
        object: String,
        /// Metres by axis per canonical unit.
        scale: Vec3,
        /// Room position.
        position: Vec3,
    },
}

impl BodyError {
    /// What a person can do about it.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::NoMesh { .. } => "scene.json and scene_full.glb must come from the same run; run reconstruct again",
            Self::EmptyMesh { .. } => "look at the object's mesh file; a mesh without area cannot collide",
            Self::Pose { .. } => "correct the object's pose in scene.json",
        }
    }
}

/// What the decompositions of equal meshes share.
#[derive(Debug)]
struct Form {
    /// Hash of the triangles.
    hash: String,
    /// Metres by axis per canonical unit at which it is decomposed.
    scale: Vec3,
    mesh: Arc<Mesh>,
}

/// Makes the bodies of a scene from the canonical meshes of its objects.
///
/// # Errors
/// [`BodyError`], naming the first object that cannot become a body.
pub fn bodies(
    scene: &Scene,
    meshes: &BTreeMap<ObjectId, Arc<Mesh>>,
    settings: &BodySettings,
) -> Result<Bodies, BodyError> {
    let mut forms: Vec<Form> = Vec::new();
    let mut form_of: Vec<usize> = Vec::new();
    for object in &scene.objects {
        let name = || object.id.to_string();
        let scale = object.pose.stretch * object.pose.scale;
        let position = object.pose.position;
        if !(scale.is_finite() && scale.min_element() > 1e-9 && position.is_finite() && object.pose.yaw.is_finite()) {
            return Err(BodyError::Pose { object: name(), scale, position });
        }
        let mesh = meshes.get(&object.id).ok_or_else(|| BodyError::NoMesh { object: name() })?;
        let hash = mesh_hash(mesh);
        if let Some(found) = forms.iter().position(|f| f.hash == hash) {
            forms[found].scale = forms[found].scale.max(scale);
            form_of.push(found);
        } else {
            forms.push(Form { hash, scale, mesh: Arc::clone(mesh) });
            form_of.push(forms.len() - 1);
        }
    }
    let made: Vec<Option<Decomposition>> = forms.par_iter().map(|form| form.decomposed(settings)).collect();
    let mut objects = Vec::with_capacity(scene.objects.len());
    for (object, form) in scene.objects.iter().zip(form_of) {
        let Some(found) = made[form].as_ref().filter(|d| !d.hulls.is_empty()) else {
            return Err(BodyError::EmptyMesh { object: object.id.to_string() });
        };
        let factor = object.pose.stretch * object.pose.scale / forms[form].scale;
        objects.push(body(object, found, factor));
    }
    Ok(Bodies { objects, shell: shell(&scene.room) })
}

/// One object as a body; `factor` scales the decomposition to it.
fn body(object: &SceneObject, made: &Decomposition, factor: Vec3) -> Body {
    let hulls: Vec<Hull> = made.hulls.iter().map(|h| h.scaled(factor)).collect();
    let mut notes = Vec::new();
    let mut fit_m = made.fit.worst() * factor.max_element();
    if made.fit.worst() > made.allowed {
        notes.push(format!(
            "colliders are {:.1} cm off the mesh at the 95th percentile, {:.1} cm are allowed",
            100.0 * fit_m,
            100.0 * made.allowed * factor.max_element()
        ));
    }
    if made.thickened > 0 {
        notes.push(format!("{} of {} hulls got a thickness", made.thickened, hulls.len()));
    }
    let solid: f64 = hulls.iter().map(|h| h.moments().mass).sum();
    let (mass_kg, of_mass) = matter::mass(object, solid);
    notes.extend(of_mass);
    let (friction, of_friction) = matter::friction(object);
    notes.extend(of_friction);
    let foot = matter::heavy_foot(object);
    if let Some(share) = foot {
        notes.push(format!("{:.0} % of the mass is taken to be in the lowest fifth", 100.0 * share));
    }
    let moments = moments(&hulls, mass_kg, foot);
    let i = moments.inertia.transpose();
    let gives_way = matter::gives_way(object);
    if gives_way {
        fit_m = 0.0;
        notes.push("it gives way: what stands on it stands on the floor through it, nothing touches it".to_owned());
    }
    Body {
        id: object.id.to_string(),
        motion: matter::motion(object),
        hulls: if gives_way { Vec::new() } else { hulls },
        mass_kg,
        friction,
        restitution: matter::restitution(object),
        centre_of_mass: moments.centre,
        inertia: [i.x_axis.to_array(), i.y_axis.to_array(), i.z_axis.to_array()],
        fit_m,
        notes,
    }
}

/// Moments of hulls that weigh `mass` together: even density, or with a share of the mass in the lowest fifth.
fn moments(hulls: &[Hull], mass: f64, foot: Option<f64>) -> Moments {
    let all: Vec<Moments> = hulls.iter().map(Hull::moments).collect();
    let whole = all.iter().fold(Moments::NONE, |a, m| a.and(*m));
    let even = whole.times(mass / whole.mass.max(1e-12));
    let Some(share) = foot else { return even };
    let (low, high) = crate::surface::bounds(hulls.iter().flat_map(|h| &h.vertices));
    let line = low.y + 0.2 * (high.y - low.y);
    // The foot: what of each hull is below the line.
    let below = hulls
        .iter()
        .filter_map(|h| {
            let points: Vec<Vec3> = h
                .faces
                .iter()
                .flat_map(|f| {
                    let t = h.corners(*f);
                    (0..3).flat_map(move |k| {
                        let (a, b) = (t[k], t[(k + 1) % 3]);
                        let (da, db) = (a.y - line, b.y - line);
                        let crossing = ((da < 0.0) != (db < 0.0)).then(|| a + (b - a) * (da / (da - db)));
                        [(da <= 0.0).then_some(a), crossing].into_iter().flatten()
                    })
                })
                .collect();
            Hull::of(&points)
        })
        .fold(Moments::NONE, |a, h| a.and(h.moments()));
    if below.mass <= 0.0 {
        return even;
    }
    below.times(share * mass / below.mass).and(even.times(1.0 - share))
}

impl Form {
    /// Its triangles in metres; those of a large mesh in a simpler form.
    fn triangles(&self) -> Vec<[Vec3; 3]> {
        let mesh = simple_form(&self.mesh);
        let corner = |i: u32| {
            mesh.positions
                .get(i as usize)
                .map(|p| p.as_dvec3() * self.scale)
                .filter(|p| p.is_finite() && p.abs().max_element() < 1e4)
        };
        mesh.triangles().filter_map(|t| Some([corner(t[0])?, corner(t[1])?, corner(t[2])?])).collect()
    }

    fn decomposed(&self, settings: &BodySettings) -> Option<Decomposition> {
        let file = settings.cache.as_ref().map(|folder| folder.join(format!("{}.json", &self.hash[..32])));
        if let Some(kept) = file.as_ref().and_then(|f| harmony_io::read_json::<Kept>(f).ok())
            && let Some(found) = kept.of(&self.hash, self.scale)
        {
            return Some(found);
        }
        let triangles = self.triangles();
        if triangles.is_empty() {
            return None;
        }
        let made = decompose(triangles);
        if let Some(file) = file {
            // A cache that cannot be written costs time, not the result.
            let _ = harmony_io::write_json(&file, &Kept::new(&self.hash, self.scale, &made));
        }
        Some(made)
    }
}

/// A decomposition on disk.
#[derive(Debug, Serialize, Deserialize)]
struct Kept {
    version: u32,
    mesh: String,
    scale: Vec3,
    visual_to_collider_m: f64,
    collider_to_visual_m: f64,
    allowed_m: f64,
    thickened: usize,
    hulls: Vec<Hull>,
}

impl Kept {
    fn new(hash: &str, scale: Vec3, made: &Decomposition) -> Self {
        Self {
            version: CACHE_VERSION,
            mesh: hash.to_owned(),
            scale,
            visual_to_collider_m: made.fit.visual_to_collider,
            collider_to_visual_m: made.fit.collider_to_visual,
            allowed_m: made.allowed,
            thickened: made.thickened,
            hulls: made.hulls.clone(),
        }
    }

    /// What is in it, when it is of this mesh at this size and sound.
    fn of(self, hash: &str, scale: Vec3) -> Option<Decomposition> {
        let same = self.version == CACHE_VERSION && self.mesh == hash && self.scale == scale;
        let sound = || self.hulls.iter().all(|h| h.vertices.iter().all(|v| v.is_finite()) && h.is_sound());
        (same && sound()).then_some(Decomposition {
            fit: Fit { visual_to_collider: self.visual_to_collider_m, collider_to_visual: self.collider_to_visual_m },
            allowed: self.allowed_m,
            thickened: self.thickened,
            hulls: self.hulls,
        })
    }
}

fn mesh_hash(mesh: &Mesh) -> String {
    let mut hasher = blake3::Hasher::new();
    for p in &mesh.positions {
        for v in p.to_array() {
            hasher.update(&v.to_le_bytes());
        }
    }
    for i in mesh.triangles().flatten() {
        hasher.update(&i.to_le_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

impl Body {
    /// Inertia as a matrix.
    pub fn inertia_matrix(&self) -> Mat3 {
        let r = self.inertia.map(Vec3::from_array);
        Mat3::from_cols(r[0], r[1], r[2]).transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{cuboid_mesh, object, scene};
    use harmony_scene::{Level, Pose, Support};

    fn crate_object(id: &str, scale: f64) -> SceneObject {
        let mut o = object(id, "box", Level::Furniture, Support::Floor);
        o.pose = Pose::new(Vec3::new(1.0, 0.0, 1.0), 0.3, scale);
        o
    }

    #[test]
    fn equal_meshes_share_hulls_at_their_own_size() {
        let mesh = Arc::new(cuboid_mesh(Vec3::new(1.0, 2.0, 0.5)));
        let scene = scene(vec![crate_object("box_01", 0.2), crate_object("box_02", 0.4)]);
        let meshes = scene.objects.iter().map(|o| (o.id.clone(), Arc::clone(&mesh))).collect();
        let made = bodies(&scene, &meshes, &BodySettings::default()).unwrap();
        for (body, scale) in made.objects.iter().zip([0.2, 0.4]) {
            assert_eq!(body.hulls.len(), 1);
            let (low, high) = body.hulls[0].bounds();
            assert!((high - low - Vec3::new(1.0, 2.0, 0.5) * scale).abs().max_element() < 1e-6);
            assert!(low.y.abs() < 1e-6, "bottom at the origin");
            assert!(body.centre_of_mass.distance(Vec3::new(0.0, scale, 0.0)) < 1e-6);
            let want = body.mass_kg / 12.0 * (4.0 + 0.25) * scale * scale;
            assert!((body.inertia[0][0] - want).abs() < 1e-4 * want);
            assert!(body.fit_m < 1e-5);
        }
        assert_eq!(made.shell.len(), 6);
    }

    #[test]
    fn a_cache_gives_the_same_bodies_and_a_broken_one_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let settings = BodySettings { cache: Some(folder.path().to_owned()) };
        let mesh = Arc::new(cuboid_mesh(Vec3::new(1.0, 2.0, 0.5)));
        let scene = scene(vec![crate_object("box_01", 0.2)]);
        let meshes = scene.objects.iter().map(|o| (o.id.clone(), Arc::clone(&mesh))).collect();
        let first = bodies(&scene, &meshes, &settings).unwrap();
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        assert_eq!(bodies(&scene, &meshes, &settings).unwrap(), first);
        std::fs::write(&file, "{}").unwrap();
        assert_eq!(bodies(&scene, &meshes, &settings).unwrap(), first);
    }

    #[test]
    fn what_cannot_be_a_body_is_named() {
        let mesh = Arc::new(cuboid_mesh(Vec3::ONE));
        let mut bad = scene(vec![crate_object("box_01", 0.2)]);
        let none = BTreeMap::new();
        let said = |s: &Scene, m: &BTreeMap<ObjectId, Arc<Mesh>>| bodies(s, m, &BodySettings::default()).unwrap_err();
        assert!(matches!(said(&bad, &none), BodyError::NoMesh { object } if object == "box_01"));
        let id = bad.objects[0].id.clone();
        let empty = BTreeMap::from([(id.clone(), Arc::new(Mesh::default()))]);
        assert!(matches!(said(&bad, &empty), BodyError::EmptyMesh { .. }));
        bad.objects[0].pose.scale = f64::NAN;
        assert!(matches!(said(&bad, &BTreeMap::from([(id, mesh)])), BodyError::Pose { .. }));
    }

    #[test]
    fn a_heavy_foot_lowers_the_centre_of_mass() {
        let pole = [Hull::cuboid(Vec3::new(-0.1, 0.0, -0.1), Vec3::new(0.1, 1.0, 0.1))];
        let even = moments(&pole, 10.0, None);
        let low = moments(&pole, 10.0, Some(0.8));
        assert!((even.centre.y - 0.5).abs() < 1e-9 && (even.mass - 10.0).abs() < 1e-9);
        assert!((low.centre.y - (0.8 * 0.1 + 0.2 * 0.5)).abs() < 1e-6 && (low.mass - 10.0).abs() < 1e-6);
    }
}
