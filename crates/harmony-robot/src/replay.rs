//! A motion as MuJoCo's XML: the scene as `harmony export --to mjcf` writes it, with the robot in it and a keyframe a frame.
//!
//! # Frame and units
//! +Z up, metres, radians, as the scene's file. The robot's root keeps the axes of its model.
//!
//! # What is said
//! * Links have their inertials, their visual meshes (group 2) and the convex pieces that the motion was measured with
//!   (group 3). Pieces touch the scene, not each other: neighbours overlap at their joints.
//! * A keyframe's `qpos` has all joints of the file: objects where the scene has them, the held object where the robot has
//!   brought it, the robot's posture.

use std::fmt::Write as _;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use harmony_export::world::z_up_rotation;
use harmony_mesh::Mesh;
use harmony_physics::Hull;
use roxmltree::{Document, Node};

use crate::RobotError;
use crate::model::{Form, JointKind, Model, room_from_model};
use crate::motion::{FRAMES_PER_SECOND, Motion};
use crate::room::Surroundings;

/// The file, and the meshes beside the scene's (name, binary STL).
pub struct Replay {
    /// XML.
    pub xml: String,
    /// Files below the scene's `assets`.
    pub meshes: Vec<(String, Vec<u8>)>,
}

/// Puts a motion into the scene's XML.
///
/// # Errors
/// [`RobotError::Model`] when the scene's XML is not what the export writes.
pub fn replay(scene: &str, room: &Surroundings, motion: &Motion, pieces: &[Vec<&Hull>]) -> Result<Replay, RobotError> {
    let bad = |why: String| RobotError::Model { path: "mjcf/scene.xml".into(), why };
    let document = Document::parse(scene).map_err(|e| bad(e.to_string()))?;
    let mut rest: Vec<Row> = Vec::new();
    for node in document.descendants().filter(|n| n.has_tag_name("worldbody")) {
        joints(node, &mut rest);
    }
    let mut writer = Writer { assets: String::new(), meshes: vec![] };
    let body = writer.link(&motion.model, 0, motion, pieces);
    let mut keys = String::new();
    for (number, frame) in motion.frames.iter().enumerate() {
        let mut qpos: Vec<f64> = Vec::new();
        for row in &rest {
            let mut values = row.values.clone();
            let thing = room.things.iter().position(|t| t.id == row.body);
            if row.free && thing.is_some_and(|t| room.rides(t, motion.object)) {
                values = carried(&values, &frame.moved);
            } else if !row.free && row.body == room.things[motion.object].id {
                values = vec![frame.opened];
            }
            qpos.extend(values);
        }
        if motion.model.floating {
            let root = in_scene(&frame.posture.root);
            qpos.extend(root.0.to_array());
            qpos.extend(root.1);
        }
        qpos.extend(&frame.posture.joints);
        let time = number as f64 / f64::from(FRAMES_PER_SECOND);
        let _ = writeln!(keys, "    <key name=\"frame_{number:03}\" time=\"{time:.4}\" qpos=\"{}\"/>", numbers(&qpos));
    }
    let insert = |text: String, before: &str, what: &str| -> Result<String, RobotError> {
        let at = text.rfind(before).ok_or_else(|| bad(format!("it has no {before}")))?;
        Ok(format!("{}{what}{}", &text[..at], &text[at..]))
    };
    let xml = insert(scene.to_owned(), "</asset>", &writer.assets)?;
    let xml = insert(xml, "</worldbody>", &body)?;
    let xml = insert(xml, "</mujoco>", &format!("  <keyframe>\n{keys}  </keyframe>\n"))?;
    Ok(Replay { xml, meshes: writer.meshes })
}

/// A joint of the scene's file with its value at rest.
struct Row {
    body: String,
    free: bool,
    values: Vec<f64>,
}

/// Joints in the order in which MuJoCo numbers them: depth first.
fn joints(node: Node<'_, '_>, out: &mut Vec<Row>) {
    let body = node.attribute("name").unwrap_or_default();
    for inner in node.children().filter(Node::is_element) {
        match inner.tag_name().name() {
            "freejoint" => {
                let of = |name: &str, default: &str| -> Vec<f64> {
                    let text = node.attribute(name).unwrap_or(default);
                    text.split_ascii_whitespace().filter_map(|w| w.parse().ok()).collect()
                };
                let values = [of("pos", "0 0 0"), of("quat", "1 0 0 0")].concat();
                out.push(Row { body: body.to_owned(), free: true, values });
            }
            "joint" => out.push(Row { body: body.to_owned(), free: false, values: vec![0.0] }),
            _ => {}
        }
    }
    for inner in node.children().filter(|n| n.has_tag_name("body")) {
        joints(inner, out);
    }
}

/// A free body's place and turn (w, x, y, z) after `room_from_room`.
fn carried(values: &[f64], moved: &DAffine3) -> Vec<f64> {
    let [x, y, z, qw, qx, qy, qz] = values[..] else { return values.to_vec() };
    let at = up(moved.transform_point3(DVec3::new(x, z, -y)));
    let turn = DQuat::from_mat3(&z_up_rotation(moved.matrix3)) * DQuat::from_xyzw(qx, qy, qz, qw);
    let turn = turn.normalize();
    [at.to_array().to_vec(), vec![turn.w, turn.x, turn.y, turn.z]].concat()
}

/// A vector of the room in the scene's file.
fn up(v: DVec3) -> DVec3 {
    DVec3::new(v.x, -v.z, v.y)
}

/// Place and turn (w, x, y, z) in the scene's file of a frame whose axes are those of a model.
fn in_scene(room_from_frame: &DAffine3) -> (DVec3, [f64; 4]) {
    let turn: DMat3 = room_from_model().transpose() * room_from_frame.matrix3;
    (up(room_from_frame.translation), wxyz(turn))
}

fn wxyz(turn: DMat3) -> [f64; 4] {
    let q = DQuat::from_mat3(&turn).normalize();
    [q.w, q.x, q.y, q.z]
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(|v| format!("{v:.7}")).collect::<Vec<_>>().join(" ")
}

struct Writer {
    assets: String,
    meshes: Vec<(String, Vec<u8>)>,
}

impl Writer {
    fn link(&mut self, model: &Model, number: usize, motion: &Motion, pieces: &[Vec<&Hull>]) -> String {
        let link = &model.links[number];
        let name = format!("robot_{}", link.name);
        let place = match (link.parent, motion.frames.first()) {
            (None, Some(frame)) => in_scene(&frame.posture.root),
            _ => (link.parent_from_link.translation, wxyz(link.parent_from_link.matrix3)),
        };
        let mut out = format!(
            "    <body name=\"{name}\" pos=\"{}\" quat=\"{}\">\n",
            numbers(&place.0.to_array()),
            numbers(&place.1)
        );
        if link.parent.is_none() && model.floating {
            let _ = writeln!(out, "      <freejoint name=\"robot_free\"/>");
        }
        if let Some(joint) = link.joint.map(|j| &model.joints[j]) {
            let kind = if joint.kind == JointKind::Hinge { "hinge" } else { "slide" };
            let _ = writeln!(
                out,
                "      <joint name=\"robot_{}\" type=\"{kind}\" axis=\"{}\" pos=\"{}\" limited=\"true\" range=\"{}\" damping=\"1\" armature=\"0.1\"/>",
                joint.name,
                numbers(&joint.axis.to_array()),
                numbers(&joint.anchor.to_array()),
                numbers(&joint.range)
            );
        }
        if link.mass > 0.0 {
            let i = link.inertia;
            let full = [i.x_axis.x, i.y_axis.y, i.z_axis.z, i.y_axis.x, i.z_axis.x, i.z_axis.y];
            let _ = writeln!(
                out,
                "      <inertial pos=\"{}\" mass=\"{:.6}\" fullinertia=\"{}\"/>",
                numbers(&link.centre.to_array()),
                link.mass,
                full.map(|v| format!("{v:.10}")).join(" ")
            );
        }
        for (k, geom) in link.geoms.iter().enumerate().filter(|(_, g)| g.visual) {
            let rgba = geom.color.map(|v| format!("{v:.3}")).join(" ");
            let at = format!(
                "pos=\"{}\" quat=\"{}\"",
                numbers(&geom.link_from_geom.translation.to_array()),
                numbers(&wxyz(geom.link_from_geom.matrix3))
            );
            let form = match &geom.form {
                Form::Mesh(mesh) => {
                    let file = format!("{name}_{k:02}");
                    let _ = writeln!(self.assets, "    <mesh name=\"{file}\" file=\"{file}.stl\" inertia=\"shell\"/>");
                    self.meshes.push((format!("{file}.stl"), stl(mesh)));
                    format!("type=\"mesh\" mesh=\"{file}\"")
                }
                Form::Box(half) => format!("type=\"box\" size=\"{}\"", numbers(&half.to_array())),
                Form::Capsule(r, h) => format!("type=\"capsule\" size=\"{r} {h}\""),
                Form::Cylinder(r, h) => format!("type=\"cylinder\" size=\"{r} {h}\""),
                Form::Sphere(r) => format!("type=\"sphere\" size=\"{r}\""),
            };
            let _ = writeln!(
                out,
                "      <geom {form} {at} rgba=\"{rgba} 1\" group=\"2\" contype=\"0\" conaffinity=\"0\" density=\"0\"/>"
            );
        }
        for (k, hull) in pieces[number].iter().enumerate() {
            let piece = format!("{name}_piece_{k:02}");
            let points: Vec<f64> = hull.vertices.iter().flat_map(DVec3::to_array).collect();
            let _ = writeln!(self.assets, "    <mesh name=\"{piece}\" vertex=\"{}\"/>", numbers(&points));
            let _ = writeln!(
                out,
                "      <geom name=\"{piece}\" type=\"mesh\" mesh=\"{piece}\" group=\"3\" contype=\"2\" conaffinity=\"1\" density=\"0\"/>"
            );
        }
        for child in (0..model.links.len()).filter(|k| model.links[*k].parent == Some(number)) {
            out.push_str(&self.link(model, child, motion, pieces));
        }
        out.push_str("    </body>\n");
        out
    }
}

/// A mesh as binary STL.
fn stl(mesh: &Mesh) -> Vec<u8> {
    let mut out = vec![0_u8; 80];
    out.extend((mesh.triangle_count() as u32).to_le_bytes());
    for t in mesh.triangles() {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        let n = (b - a).cross(c - a).normalize_or_zero();
        for v in [n, a, b, c] {
            for x in v.to_array() {
                out.extend(x.to_le_bytes());
            }
        }
        out.extend([0, 0]);
    }
    out
}
