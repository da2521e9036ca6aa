//! MuJoCo's XML: the whole scene, and one file an object.
//!
//! # Frame and units
//! +Z up, metres, kilograms, radians; quaternions w, x, y, z. A body's frame is the object's body frame.
//!
//! # What is said
//! * Visual geoms (group 2) touch nothing; colliders (group 3) are boxes where a hull is an upright box, meshes else:
//!   MuJoCo collides the convex hull of a mesh, which a hull is.
//! * Mass, centre and inertia are given, never guessed from geoms. Static objects and the room have no joint.
//! * MuJoCo takes the larger friction of a pair. Objects' coefficients are told against wood, so that the room's faces
//!   have next to none of their own, and each object slides on the floor by its own coefficient.
//!
//! # Source
//! MuJoCo's XML reference, version 4.0.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use glam::{DAffine3, DVec3};
use harmony_physics::{Bodies, Body, Hull, Motion};
use harmony_scene::{Light, LightKind, Lighting};

use crate::files::Files;
use crate::moving::{self, PartBody};
use crate::text::{escaped, num, nums};
use crate::world::{Item, Jointed, Piece, Select, identifier, wxyz, z_up, z_up_f32, z_up_rotation};
use crate::{ExportError, World};

/// Friction of the room's faces, far below that of any object.
const ROOM_FRICTION: f64 = 0.05;
/// Torsional and rolling friction (MuJoCo's defaults).
const TURNING: &str = "0.005 0.0001";
/// Hulls whose corners are this near to those of a box are boxes, metres.
const BOX_TOLERANCE: f64 = 1e-4;
/// Pieces of less area are not written: MuJoCo refuses them.
const SMALLEST_AREA: f64 = 1e-7;

/// `mjcf/scene.xml` with its assets, and `mjcf/objects/<id>.xml`.
///
/// # Errors
/// [`ExportError::Texture`].
pub(crate) fn write(world: &World, bodies: &Bodies) -> Result<Files, ExportError> {
    let mut assets = Assets::default();
    let mut files = Files::default();
    let mut room = String::new();
    for face in &world.shell {
        let _ = writeln!(room, "    <body name=\"{}\">", face.name);
        visuals(&mut room, world, &world.face_pieces(face), &face.name, &mut assets);
        if let Some((_, hulls)) = bodies.shell.iter().find(|(name, _)| *name == face.name) {
            colliders(&mut room, hulls, &face.name, ROOM_FRICTION, &mut assets);
        }
        room.push_str("    </body>\n");
    }
    let mut all = String::new();
    for (item, body) in world.items.iter().zip(&bodies.objects) {
        let mut own = Assets::default();
        let alone = object(world, item, body, &mut own, DVec3::ZERO);
        files.text(
            format!("mjcf/objects/{}.xml", item.name()),
            document(item.name(), "../assets", &own, world, &alone, ""),
        );
        own.save(&mut files);
        all.push_str(&object(world, item, body, &mut assets, z_up(item.object.pose.position)));
    }
    let name = identifier(&world.scene.room.room_type);
    let extra = format!(
        "{}{}",
        lights(&world.scene.lighting, moving::still_lights(world, bodies).into_iter(), &DAffine3::IDENTITY),
        camera(world)
    );
    files.text("mjcf/scene.xml", document(&name, "assets", &assets, world, &format!("{room}{all}"), &extra));
    assets.save(&mut files);
    for picture in world.looks.png_files()? {
        files.add(format!("mjcf/assets/{}", picture.name), picture.bytes);
    }
    Ok(files)
}

/// What bodies refer to.
#[derive(Debug, Default)]
struct Assets {
    /// `<mesh .../>` elements.
    meshes: String,
    /// Looks that are used.
    looks: Vec<usize>,
    /// Pairs of bodies that do not collide.
    exclude: String,
    /// Mesh files by their text, so that equal ones are one.
    files: BTreeMap<String, String>,
}

impl Assets {
    fn look(&mut self, look: usize) {
        if !self.looks.contains(&look) {
            self.looks.push(look);
        }
    }

    /// The name of a mesh asset for an OBJ text.
    fn mesh(&mut self, name: &str, text: String) -> String {
        if let Some(known) = self.files.get(&text) {
            return known.clone();
        }
        let _ = writeln!(self.meshes, "    <mesh name=\"{name}\" file=\"{name}.obj\" inertia=\"shell\"/>");
        self.files.insert(text, name.to_owned());
        name.to_owned()
    }

    fn save(self, files: &mut Files) {
        for (text, name) in self.files {
            files.text(format!("mjcf/assets/{name}.obj"), text);
        }
    }
}

fn document(name: &str, folder: &str, assets: &Assets, world: &World, bodies: &str, extra: &str) -> String {
    let mut out = format!(
        "<mujoco model=\"{name}\">\n  <!-- HARMONY scene: metres, +Z up -->\n  \
         <compiler angle=\"radian\" meshdir=\"{folder}\" texturedir=\"{folder}\" inertiafromgeom=\"false\"/>\n  \
         <option timestep=\"0.002\" gravity=\"0 0 -9.81\" integrator=\"implicitfast\" cone=\"elliptic\" impratio=\"10\"/>\n  \
         <default>\n    <default class=\"visual\">\n      <geom type=\"mesh\" group=\"2\" contype=\"0\" conaffinity=\"0\"/>\n    </default>\n    \
         <default class=\"collision\">\n      <geom group=\"3\" condim=\"4\"/>\n    </default>\n  </default>\n  <asset>\n"
    );
    let mut pictures: Vec<usize> = Vec::new();
    for look in &assets.looks {
        let look = &world.looks.looks[*look];
        let m = &look.material;
        let rgba = [m.base_color[0].into(), m.base_color[1].into(), m.base_color[2].into(), look.opacity()];
        let mut texture = String::new();
        if let Some(p) = look.color {
            let name = &world.looks.pictures[p].name;
            if !pictures.contains(&p) {
                pictures.push(p);
                let _ = writeln!(out, "    <texture name=\"{name}\" type=\"2d\" file=\"{name}.png\"/>");
            }
            texture = format!(" texture=\"{name}\"");
        }
        let emission = m.emissive.iter().copied().fold(0.0, f32::max).min(1.0);
        let _ = writeln!(
            out,
            "    <material name=\"{}\"{texture} rgba=\"{}\" specular=\"{}\" shininess=\"{}\" reflectance=\"0\" emission=\"{}\"/>",
            look.name,
            nums(&rgba, 4),
            num(0.5 * (1.0 - f64::from(m.roughness)), 4),
            num(1.0 - f64::from(m.roughness), 4),
            num(emission.into(), 4)
        );
    }
    out.push_str(&assets.meshes);
    let _ = write!(out, "  </asset>\n  <worldbody>\n{extra}{bodies}  </worldbody>\n");
    if !assets.exclude.is_empty() {
        let _ = write!(out, "  <contact>\n{}  </contact>\n", assets.exclude);
    }
    out.push_str("</mujoco>\n");
    out
}

fn object(world: &World, item: &Item, body: &Body, assets: &mut Assets, at: DVec3) -> String {
    let name = item.name();
    let mut out = String::new();
    let _ = writeln!(
        out,
        "    <body name=\"{name}\" pos=\"{}\" quat=\"{}\">",
        nums(&at.to_array(), 6),
        nums(&wxyz(z_up_rotation(item.rotation())), 9)
    );
    if body.motion == Motion::Dynamic {
        let _ = writeln!(out, "      <freejoint name=\"{name}_free\"/>");
    }
    // xx yy zz xy xz yz, in the +Z-up body frame.
    let (parts, rest) = moving::parts(item, body);
    let i = z_up_rotation(body.inertia_matrix());
    let full = [i.x_axis.x, i.y_axis.y, i.z_axis.z, i.y_axis.x, i.z_axis.x, i.z_axis.y];
    let _ = writeln!(
        out,
        "      <inertial pos=\"{}\" mass=\"{}\" fullinertia=\"{}\"/>",
        nums(&z_up(body.centre_of_mass).to_array(), 6),
        num(body.mass_kg * rest, 6),
        nums(&full.map(|v| v * rest), 9)
    );
    visuals(&mut out, world, &world.selected_pieces(item, Select::Fixed), name, assets);
    colliders(&mut out, &body.hulls, name, body.friction, assets);
    let room_from_body = DAffine3::from_mat3_translation(item.rotation(), item.object.pose.position);
    out.push_str(&lights(&world.scene.lighting, moving::lights(world, item, body), &room_from_body));
    for part in &parts {
        opening(&mut out, world, item, body, part, assets);
    }
    out.push_str("    </body>\n");
    out
}

/// A part that opens: a body in the object's own frame, with a joint that stands closed at 0.
fn opening(out: &mut String, world: &World, item: &Item, body: &Body, part: &PartBody<'_>, assets: &mut Assets) {
    let name = &part.part.name;
    let _ = writeln!(out, "      <body name=\"{name}\">");
    let (kind, axis, pos) = match part.part.joint {
        Jointed::Hinge { axis, pivot } => ("hinge", axis, pivot),
        Jointed::Slide { axis } => ("slide", axis, DVec3::ZERO),
    };
    let _ = writeln!(
        out,
        "        <joint name=\"{name}_joint\" type=\"{kind}\" axis=\"{}\" pos=\"{}\" limited=\"true\" range=\"{}\" \
         damping=\"{}\" frictionloss=\"{}\" armature=\"0.001\"/>",
        nums(&z_up(axis).to_array(), 6),
        nums(&z_up(pos).to_array(), 6),
        nums(&part.part.range, 5),
        num(0.3 * part.mass_kg, 4),
        num(0.2 * part.mass_kg, 4)
    );
    let i = part.inertia;
    let _ = writeln!(
        out,
        "        <inertial pos=\"{}\" mass=\"{}\" diaginertia=\"{}\"/>",
        nums(&z_up(part.centre).to_array(), 6),
        num(part.mass_kg, 6),
        nums(&[i.x, i.z, i.y], 9)
    );
    visuals(out, world, &world.selected_pieces(item, Select::Part(part.number)), name, assets);
    colliders(out, std::slice::from_ref(&part.hull), name, body.friction, assets);
    out.push_str("      </body>\n");
    let _ = writeln!(assets.exclude, "    <exclude body1=\"{}\" body2=\"{name}\"/>", item.name());
}

fn visuals(out: &mut String, world: &World, pieces: &[Piece], owner: &str, assets: &mut Assets) {
    for (k, piece) in pieces.iter().enumerate() {
        let corner = |i: u32| piece.positions[i as usize].as_dvec3();
        let area: f64 = piece
            .triangles
            .iter()
            .map(|t| (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).length() / 2.0)
            .sum();
        if area < SMALLEST_AREA {
            continue;
        }
        let look = &world.looks.looks[piece.look];
        assets.look(piece.look);
        let mesh = assets.mesh(&format!("{owner}_visual_{k:02}"), obj(piece));
        let _ = writeln!(out, "      <geom class=\"visual\" mesh=\"{mesh}\" material=\"{}\"/>", look.name);
    }
}

fn colliders(out: &mut String, hulls: &[Hull], owner: &str, friction: f64, assets: &mut Assets) {
    for (k, hull) in hulls.iter().enumerate() {
        let friction = format!("{} {TURNING}", num(friction, 4));
        if let Some((centre, half)) = upright_box(hull) {
            let _ = writeln!(
                out,
                "      <geom class=\"collision\" name=\"{owner}_hull_{k:03}\" type=\"box\" pos=\"{}\" size=\"{}\" friction=\"{friction}\"/>",
                nums(&centre.to_array(), 6),
                nums(&half.to_array(), 6)
            );
        } else {
            let name = format!("{owner}_hull_{k:03}");
            let points: Vec<f64> = hull.vertices.iter().flat_map(|v| z_up(*v).to_array()).collect();
            let _ = writeln!(assets.meshes, "    <mesh name=\"{name}\" vertex=\"{}\"/>", nums(&points, 6));
            let _ = writeln!(
                out,
                "      <geom class=\"collision\" name=\"{name}\" type=\"mesh\" mesh=\"{name}\" friction=\"{friction}\"/>"
            );
        }
    }
}

/// Centre and half sides (+Z up) of a hull that is an upright box.
pub(crate) fn upright_box(hull: &Hull) -> Option<(DVec3, DVec3)> {
    let points: Vec<DVec3> = hull.vertices.iter().map(|v| z_up(*v)).collect();
    let (low, high) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let corner = |p: &DVec3| (*p - low).min(high - *p).abs().max_element() < BOX_TOLERANCE;
    let mut seen = [false; 8];
    for p in &points {
        if !corner(p) {
            return None;
        }
        let side = |v: f64, l: f64, h: f64| usize::from(v - l > h - v);
        seen[side(p.x, low.x, high.x) | side(p.y, low.y, high.y) << 1 | side(p.z, low.z, high.z) << 2] = true;
    }
    seen.into_iter().all(|s| s).then(|| ((low + high) / 2.0, (high - low) / 2.0))
}

/// A piece as OBJ in the +Z-up frame.
pub(crate) fn obj(piece: &Piece) -> String {
    let mut out = String::new();
    for p in &piece.positions {
        let _ = writeln!(out, "v {}", nums(&z_up_f32(*p).as_dvec3().to_array(), 6));
    }
    if piece.positions.len() == 3 {
        // MuJoCo wants four vertices.
        let _ = writeln!(
            out,
            "v {}",
            nums(&z_up_f32((piece.positions[0] + piece.positions[1]) / 2.0).as_dvec3().to_array(), 6)
        );
    }
    for uv in &piece.uvs {
        let _ = writeln!(out, "vt {} {}", num(uv.x.into(), 5), num(1.0 - f64::from(uv.y), 5));
    }
    for n in &piece.normals {
        let _ = writeln!(out, "vn {}", nums(&z_up_f32(*n).as_dvec3().to_array(), 4));
    }
    for t in &piece.triangles {
        let [a, b, c] = t.map(|i| i + 1);
        let _ = writeln!(out, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}");
    }
    out
}

/// Lights in a frame of the room.
fn lights<'a>(lighting: &Lighting, some: impl Iterator<Item = &'a Light>, room_from_frame: &DAffine3) -> String {
    let frame_from_room = room_from_frame.inverse();
    let mut out = String::new();
    let total: f64 = lighting.lights.iter().filter(|l| l.on).map(|l| l.intensity.max(0.0)).sum();
    for light in some.filter(|l| l.on) {
        // MuJoCo's light has no watts: shares of the whole, as bright as its renderer likes.
        let share = (light.intensity.max(0.0) / total.max(1e-9)).sqrt() * 0.7;
        let color = light.color.map(|c| c.clamp(0.0, 1.0) * share);
        let (kind, direction) = match &light.kind {
            LightKind::Point { .. } => ("point", DVec3::NEG_Z),
            LightKind::Area { direction, .. } => ("spot", z_up(DVec3::from_array(*direction))),
            LightKind::Sun { direction } => ("directional", z_up(DVec3::from_array(*direction))),
        };
        let direction = (z_up_rotation(frame_from_room.matrix3) * direction).normalize_or(DVec3::NEG_Z);
        let at = frame_from_room.transform_point3(DVec3::from_array(light.position));
        let cutoff = if kind == "spot" { " cutoff=\"80\"" } else { "" };
        let _ = writeln!(
            out,
            "    <light name=\"{}\" type=\"{kind}\" pos=\"{}\" dir=\"{}\" diffuse=\"{}\"{cutoff} castshadow=\"false\"/>",
            escaped(&identifier(&light.id)),
            nums(&z_up(at).to_array(), 4),
            nums(&direction.to_array(), 5),
            nums(&color, 4)
        );
    }
    out
}

fn camera(world: &World) -> String {
    let c = &world.camera;
    let fovy = 2.0 * (f64::from(c.size.height) / 2.0 / c.intrinsics.fy).atan();
    let (x, y) = (z_up(c.right()), z_up(-c.down()));
    format!(
        "    <camera name=\"photo\" pos=\"{}\" xyaxes=\"{} {}\" fovy=\"{}\"/>\n",
        nums(&z_up(c.centre()).to_array(), 6),
        nums(&x.to_array(), 9),
        nums(&y.to_array(), 9),
        // The compiler's angles are radians, the field of view is in degrees all the same.
        num(fovy.to_degrees(), 5)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_told_from_other_hulls() {
        let hull = Hull::cuboid(DVec3::new(0.0, 0.0, 0.0), DVec3::new(1.0, 2.0, 3.0));
        let (centre, half) = upright_box(&hull).unwrap();
        assert!((centre - DVec3::new(0.5, -1.5, 1.0)).length() < 1e-12);
        assert!((half - DVec3::new(0.5, 1.5, 1.0)).length() < 1e-12);
        let mut cut = hull.vertices.clone();
        cut[0] += DVec3::splat(0.1);
        assert!(upright_box(&Hull::of(&cut).unwrap()).is_none());
    }
}
