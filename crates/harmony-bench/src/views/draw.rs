//! A run drawn flat from any place.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use harmony_mesh::Mesh;
use harmony_render::{Frame, Instance, RenderOptions, render};
use harmony_scene::Camera;

use crate::score::Prediction;

/// Nearest drawn depth, metres, the judge's.
const NEAR_M: f64 = 0.03;

/// What of a material the flat picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Look {
    /// Base colour alone, everything opaque, nothing emits: what the independent judge draws.
    #[default]
    Judge,
    /// As the flat renderer draws a run's own pictures.
    Viewer,
}

/// The scene of a run with the textures as they are, single-sided materials from their front alone, black where
/// nothing is. Ids count objects from 1; the shell has the largest number.
pub fn flat(run: &Prediction, camera: &Camera, look: Look) -> Frame {
    let dressed = |mesh: &Arc<Mesh>| match look {
        Look::Judge => opaque(mesh),
        Look::Viewer => Arc::clone(mesh),
    };
    let meshes: Vec<(Arc<Mesh>, u32)> = std::iter::once((dressed(&run.shell), u32::MAX))
        .chain(run.objects.iter().zip(1..).map(|(o, id)| (dressed(&o.mesh), id)))
        .collect();
    let instances: Vec<Instance<'_>> = meshes
        .iter()
        .map(|(mesh, id)| Instance { mesh, linear: DMat3::IDENTITY, translation: DVec3::ZERO, id: *id })
        .collect();
    let options =
        RenderOptions { multisample: true, background: [0, 0, 0, 255], near: NEAR_M, ..RenderOptions::default() };
    render(camera, &instances, &options)
}

/// The mesh with base colours alone.
fn opaque(mesh: &Arc<Mesh>) -> Arc<Mesh> {
    let plain = |m: &harmony_mesh::Material| {
        m.base_color[3] >= 1.0
            && m.transmission <= 0.0
            && m.emissive == [0.0; 3]
            && m.texture.as_ref().is_none_or(|t| t.pixels().all(|p| p.0[3] == 255))
    };
    if mesh.materials.iter().all(plain) {
        return Arc::clone(mesh);
    }
    let mut mesh = (**mesh).clone();
    for material in &mut mesh.materials {
        material.base_color[3] = 1.0;
        material.transmission = 0.0;
        material.emissive = [0.0; 3];
        if let Some(texture) = material.texture.as_mut().filter(|t| t.pixels().any(|p| p.0[3] < 255)) {
            for pixel in Arc::make_mut(texture).pixels_mut() {
                pixel.0[3] = 255;
            }
        }
    }
    Arc::new(mesh)
}
