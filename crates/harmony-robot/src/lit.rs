//! Path-traced frames of a motion, with the scene's own light.
//!
//! The scene is written once more as a GLB file with a node a link of the robot, in the colours of its model; a frame moves
//! nodes ([`harmony_physics::animate::posed_glb`]), and the rest is what frames of earthquakes have
//! ([`harmony_physics::pictures::Lit`]). The camera is that of the even pictures.

use std::sync::Arc;

use glam::{DAffine3, DQuat};
use harmony_export::World;
use harmony_io::{GlbNode, GlbScene, NodeTransform, glb_bytes};
use harmony_mesh::{Material, Mesh};
use harmony_physics::Placed;
use harmony_physics::animate::posed_glb;
use harmony_physics::pictures::{Lit, LitView, Moved};
use harmony_scene::AlbedoField;
use image::RgbImage;

use crate::RobotError;
use crate::motion::Motion;
use crate::pictures::{Drawn, Painter, Seen, meshes};

/// Roughness of a robot's painted and anodised shells, by eye.
const ROUGHNESS: f32 = 0.45;

/// A motion, ready to be path-traced.
pub struct LitMotion<'a> {
    world: &'a World,
    motion: &'a Motion,
    glb: Vec<u8>,
    view: LitView,
    /// Node by node what moves with the object: its name, and where it is in the scene.
    moving: Vec<(String, Placed)>,
    /// Nodes of links, by their numbers.
    links: Vec<(String, usize)>,
}

impl<'a> LitMotion<'a> {
    /// From where a painter of the same motion looks.
    ///
    /// # Errors
    /// A scene that cannot be written as GLB.
    pub fn new(world: &'a World, motion: &'a Motion, painter: &Painter<'_>) -> Result<Self, RobotError> {
        let mut objects: Vec<GlbNode> = Vec::new();
        let mut moving: Vec<(String, Placed)> = Vec::new();
        for Drawn { item, mesh, moves, part } in painter.drawn() {
            let object = &world.items[*item].object;
            let name = part.clone().unwrap_or_else(|| object.id.to_string());
            if *moves {
                moving.push((name.clone(), Placed::of(&object.pose)));
            }
            let transform = NodeTransform::from(&object.pose);
            objects.push(GlbNode { name, mesh: Arc::clone(mesh), transform, extras: serde_json::Value::Null });
        }
        let mut links: Vec<(String, usize)> = Vec::new();
        for (number, (link, seen)) in motion.model.links.iter().zip(meshes(&motion.model)).enumerate() {
            if let Some(mesh) = link_mesh(&seen) {
                let name = format!("robot_{}", link.name);
                links.push((name.clone(), number));
                let (mesh, transform) = (Arc::new(mesh), NodeTransform::IDENTITY);
                objects.push(GlbNode { name, mesh, transform, extras: serde_json::Value::Null });
            }
        }
        let face = |f: &harmony_export::world::Face| GlbNode {
            name: f.name.clone(),
            mesh: Arc::clone(&f.mesh),
            transform: NodeTransform::IDENTITY,
            extras: serde_json::Value::Null,
        };
        let scene = GlbScene {
            objects,
            shell: world.shell.iter().map(face).collect(),
            camera: Some(world.camera),
            ..GlbScene::default()
        };
        let view = LitView {
            camera: painter.camera(),
            hidden: painter.hidden_nodes(),
            true_colors: links.iter().map(|(name, _)| name.clone()).collect(),
        };
        Ok(Self { world, motion, glb: glb_bytes(&scene)?, view, moving, links })
    }

    /// Names of the object's own fields of reflectance for a part of it that moves, too.
    fn albedo(&self, found: Option<&AlbedoField>) -> Option<AlbedoField> {
        let mut field = found?.clone();
        for (name, _) in &self.moving {
            let owner = self.world.items.iter().find(|i| i.opens.iter().any(|o| o.name == *name));
            let Some(owner) = owner.map(harmony_export::world::Item::name) else { continue };
            let own: Vec<(String, harmony_scene::AlbedoCells)> = field
                .nodes
                .iter()
                .filter_map(|(node, cells)| Some((format!("{name}{}", of_node(node, owner)?), cells.clone())))
                .collect();
            field.nodes.extend(own);
        }
        Some(field)
    }

    /// One frame.
    ///
    /// # Errors
    /// What Blender says.
    pub fn frame(&self, lit: &Lit<'_>, number: usize) -> Result<RgbImage, RobotError> {
        let frame = &self.motion.frames[number];
        let places = self.motion.model.places(&frame.posture);
        let moved: Vec<Moved<'_>> = self
            .moving
            .iter()
            .map(|(id, first)| Moved { id, first: *first, now: placed(&(frame.moved * affine(first))) })
            .collect();
        let mut nodes: Vec<(&str, Placed)> = moved.iter().map(|m| (m.id, m.now)).collect();
        nodes.extend(self.links.iter().map(|(name, link)| (name.as_str(), placed(&places[*link]))));
        let glb = posed_glb(&self.glb, &nodes).map_err(harmony_physics::pictures::PictureError::from)?;
        let lit = Lit {
            renderer: lit.renderer,
            scene: lit.scene,
            albedo: self.albedo(lit.albedo.as_ref()),
            samples: lit.samples,
            kept: lit.kept.clone(),
        };
        Ok(lit.picture(&glb, &moved, &self.view)?)
    }
}

/// What follows the name of a node: "" for the node itself, "/material" for one material of it.
fn of_node<'a>(node: &'a str, name: &str) -> Option<&'a str> {
    node.strip_prefix(name).filter(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// All that is seen of a link, its frame, a material a colour.
fn link_mesh(seen: &[Seen]) -> Option<Mesh> {
    let mut out: Option<Mesh> = None;
    for Seen { link_from_mesh, mesh, color } in seen {
        let mut own = (**mesh).clone();
        let turn = DQuat::from_mat3(&link_from_mesh.matrix3).as_quat();
        own.map(|p| link_from_mesh.transform_point3(p.as_dvec3()).as_vec3(), |n| turn * n);
        let name = format!("robot_{:02x}{:02x}{:02x}", byte(color[0]), byte(color[1]), byte(color[2]));
        own.materials =
            vec![Material { roughness: ROUGHNESS, ..Material::plain(&name, color.map(|c| c.clamp(0.02, 0.9))) }];
        own.colors.clear();
        for group in &mut own.groups {
            group.material = 0;
        }
        match &mut out {
            Some(all) => all.append(&own),
            None => out = Some(own),
        }
    }
    out
}

fn byte(value: f32) -> u8 {
    (255.0 * value.clamp(0.0, 1.0)).round() as u8
}

fn affine(place: &Placed) -> DAffine3 {
    DAffine3::from_rotation_translation(DQuat::from_array(place.rotation), place.position)
}

fn placed(place: &DAffine3) -> Placed {
    Placed { position: place.translation, rotation: DQuat::from_mat3(&place.matrix3).normalize().to_array() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_and_their_materials_are_told_from_nodes_of_like_names() {
        assert_eq!(of_node("cabinet_01", "cabinet_01"), Some(""));
        assert_eq!(of_node("cabinet_01/oak", "cabinet_01"), Some("/oak"));
        assert_eq!(of_node("cabinet_011", "cabinet_01"), None);
    }
}
