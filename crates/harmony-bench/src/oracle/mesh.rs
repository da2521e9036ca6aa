//! Meshes as an image-to-3D model gives them: in its own scale and turn, a little tilted, the unseen side made up.

use std::sync::Arc;

use async_trait::async_trait;
use glam::{DMat3, DVec3};
use harmony_mesh::Mesh;
use harmony_roles::{GeneratedMesh, MeshFrame, MeshGenerator, MeshRequest, PlayerCard, RoleError, Usage};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::degrade::degraded;
use super::paint::{Unseen, painted};
use super::{Meshes, Oracle, card, normal};
use crate::truth::TruthObject;

/// Longest side of a generated mesh, generator's units: models fill a cube of side 2 nearly.
const GENERATED_SIZE: f64 = 1.9;

#[async_trait]
impl MeshGenerator for Oracle {
    fn card(&self) -> PlayerCard {
        card("meshes")
    }

    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        let id = request.name.split('/').nth(1).unwrap_or_default();
        let object = self.recall(id).ok_or_else(|| RoleError::NotCapable {
            player: "oracle".to_owned(),
            reason: format!("{id} is no object of the room"),
        })?;
        let mesh = self.spent.measured(|| self.generated(&self.room.objects[object]));
        Ok(GeneratedMesh {
            mesh: Arc::new(mesh),
            convex: None,
            frame: MeshFrame::Raw,
            part_model: None,
            source: "oracle mesh".to_owned(),
            notes: Vec::new(),
            usage: Usage::default(),
        })
    }
}

/// What equal objects share.
fn kind(object: &TruthObject) -> String {
    format!("{} {} {:.2} {:.2}", object.label, object.model, object.size.x, object.size.y)
}

impl Oracle {
    /// Quarter turns of an object's generated mesh about up: its front is at `quarters * 90` degrees from +Z.
    pub(super) fn quarters(&self, object: &TruthObject) -> u32 {
        self.draws.rng(&format!("quarters {}", kind(object))).random_range(0..4)
    }

    /// An object as the generator gives it, in the generator's frame and unit. Grey meshes have the vertices of the
    /// truth in order, unless [`Oracle::with_faces`] wants others; painted ones have three for each triangle.
    pub fn generated(&self, object: &TruthObject) -> Mesh {
        let mut mesh = match (self.faces, &self.photo, self.meshes) {
            (Some(faces), ..) => super::dense::densified(&object.mesh, faces),
            (None, Some(photo), Meshes::Truth) => painted(&self.room, photo, object, Unseen::Mean),
            (None, Some(photo), Meshes::Degraded) => {
                let mesh = painted(&self.room, photo, object, Unseen::Front);
                let mut rng = self.draws.rng(&format!("degraded {}", kind(object)));
                degraded(&mesh, self.towards_camera(object), &mut rng)
            }
            _ => (*object.mesh).clone(),
        };
        // Equal models have equal tilts and scales, as one generated mesh copied: a set stays a set.
        let mut rng = self.draws.rng(&format!("mesh {}", kind(object)));
        self.make_up_back(object, &mut mesh, &mut rng);
        let tilt = self.noise.tilt_deg.to_radians() * rng.random::<f64>();
        let about = rng.random::<f64>() * std::f64::consts::TAU;
        let tilt = DMat3::from_axis_angle(DVec3::new(about.cos(), 0.0, about.sin()), tilt);
        let turn = DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2 * f64::from(self.quarters(object)));
        let scale = GENERATED_SIZE / object.size.max_element().max(1e-6) * (0.9 + 0.2 * rng.random::<f64>());
        let centre = DVec3::new(0.0, object.size.y / 2.0, 0.0);
        let linear = (tilt * turn * scale).as_mat3();
        let normal_of = (tilt * turn).as_mat3();
        mesh.map(|p| linear * (p - centre.as_vec3()), |n| normal_of * n);
        if self.faces.is_some() {
            super::dense::textured(&mut mesh, &mut rng);
        }
        mesh
    }

    /// Direction from an object's middle to the camera, in its canonical frame.
    fn towards_camera(&self, object: &TruthObject) -> DVec3 {
        let centre = DVec3::new(0.0, object.size.y / 2.0, 0.0);
        let camera = DMat3::from_rotation_y(-object.yaw) * (self.room.camera.centre() - object.position) - centre;
        camera.try_normalize().unwrap_or(DVec3::Z)
    }

    /// Displaces what the camera does not see by a smooth random field.
    fn make_up_back(&self, object: &TruthObject, mesh: &mut Mesh, rng: &mut ChaCha8Rng) {
        if self.noise.back_side <= 0.0 {
            return;
        }
        let centre = DVec3::new(0.0, object.size.y / 2.0, 0.0);
        let towards = self.towards_camera(object);
        let waves: Vec<(DVec3, DVec3, f64)> = (0..6)
            .map(|_| {
                let k = DVec3::new(normal(rng), normal(rng), normal(rng)) * 5.0;
                let d = DVec3::new(normal(rng), normal(rng), normal(rng));
                (k, d, rng.random::<f64>() * std::f64::consts::TAU)
            })
            .collect();
        let (size, amount) = (object.size.max(DVec3::splat(1e-3)), self.noise.back_side);
        mesh.map(
            |p| {
                let p = p.as_dvec3();
                let unit = (p - centre) / size;
                // 0 on the side of the camera, growing to 1 on the far side.
                let hidden = (-(unit * size).dot(towards) / (0.5 * size.length())).clamp(0.0, 1.0);
                let field: DVec3 =
                    waves.iter().map(|(k, d, phase)| *d * (k.dot(unit) + phase).sin()).sum::<DVec3>() / 6.0_f64.sqrt();
                (p + field * size * amount * hidden).as_vec3()
            },
            |n| n,
        );
        mesh.recompute_normals();
    }
}
