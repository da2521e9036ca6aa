//! URDF: one folder an object, with its meshes beside it.
//!
//! +Z up, metres; a link in the object's body frame (its front at -Y), visual and collision meshes as OBJ, mass, centre
//! and inertia. A part that opens is a link of its own on a revolute or prismatic joint with limits, closed at 0; its frame
//! has its origin on the axis. URDF has no friction: `<contact>` as other programs extend it says it. Meshes lie beside the URDF, for
//! some readers leave folders out of their names.

use std::fmt::Write as _;

use glam::{DMat3, DVec3};
use harmony_physics::{Bodies, Body, Hull};

use crate::files::Files;
use crate::text::{escaped, num, nums};
use crate::world::{Item, Jointed, Piece, Select, z_up, z_up_rotation};
use crate::{ExportError, World, mjcf, moving};

/// `urdf/<id>/<id>.urdf` and its meshes.
///
/// # Errors
/// [`ExportError::Texture`].
pub(crate) fn write(world: &World, bodies: &Bodies) -> Result<Files, ExportError> {
    let mut files = Files::default();
    for (item, body) in world.items.iter().zip(&bodies.objects) {
        object(world, item, body, &mut files)?;
    }
    Ok(files)
}

fn object(world: &World, item: &Item, body: &Body, files: &mut Files) -> Result<(), ExportError> {
    let name = item.name();
    let mut out = format!(
        "<?xml version=\"1.0\"?>\n<!-- HARMONY object: metres, +Z up; {} -->\n<robot name=\"{name}\">\n",
        escaped(&item.object.label.replace("--", "-"))
    );
    let (parts, rest) = moving::parts(item, body);
    let fixed = Link {
        name,
        origin: DVec3::ZERO,
        mass_kg: body.mass_kg * rest,
        centre: body.centre_of_mass,
        inertia: body.inertia_matrix() * rest,
        hulls: &body.hulls,
    };
    link(&mut out, world, &world.selected_pieces(item, Select::Fixed), &fixed, name, body, files)?;
    for part in &parts {
        let (kind, axis, origin) = match part.part.joint {
            Jointed::Hinge { axis, pivot } => ("revolute", axis, pivot),
            Jointed::Slide { axis } => ("prismatic", axis, DVec3::ZERO),
        };
        let of_part = Link {
            name: &part.part.name,
            origin,
            mass_kg: part.mass_kg,
            centre: part.centre,
            inertia: DMat3::from_diagonal(part.inertia),
            hulls: std::slice::from_ref(&part.hull),
        };
        link(&mut out, world, &world.selected_pieces(item, Select::Part(part.number)), &of_part, name, body, files)?;
        // Effort and speed are required; both are far above what a hand does.
        let _ = write!(
            out,
            "  <joint name=\"{}_joint\" type=\"{kind}\">\n    <parent link=\"{name}\"/>\n    <child link=\"{}\"/>\n    \
             <origin xyz=\"{}\" rpy=\"0 0 0\"/>\n    <axis xyz=\"{}\"/>\n    \
             <limit lower=\"{}\" upper=\"{}\" effort=\"100\" velocity=\"5\"/>\n    \
             <dynamics damping=\"{}\" friction=\"{}\"/>\n  </joint>\n",
            part.part.name,
            part.part.name,
            nums(&z_up(origin).to_array(), 6),
            nums(&z_up(axis).to_array(), 6),
            num(part.part.range[0], 5),
            num(part.part.range[1], 5),
            num(0.3 * part.mass_kg, 4),
            num(0.2 * part.mass_kg, 4)
        );
    }
    out.push_str("</robot>\n");
    files.text(format!("urdf/{name}/{name}.urdf"), out);
    Ok(())
}

/// A link of an object; all in the object's body frame.
struct Link<'a> {
    name: &'a str,
    /// Origin of its frame.
    origin: DVec3,
    mass_kg: f64,
    centre: DVec3,
    inertia: DMat3,
    hulls: &'a [Hull],
}

fn link(
    out: &mut String,
    world: &World,
    pieces: &[Piece],
    link: &Link<'_>,
    object: &str,
    body: &Body,
    files: &mut Files,
) -> Result<(), ExportError> {
    let (name, folder) = (link.name, format!("urdf/{object}"));
    let i = z_up_rotation(link.inertia);
    let _ = writeln!(
        out,
        "  <link name=\"{name}\">\n    <inertial>\n      <origin xyz=\"{}\" rpy=\"0 0 0\"/>\n      <mass value=\"{}\"/>\n      \
         <inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/>\n    </inertial>",
        nums(&z_up(link.centre - link.origin).to_array(), 6),
        num(link.mass_kg, 6),
        num(i.x_axis.x, 9),
        num(i.y_axis.x, 9),
        num(i.z_axis.x, 9),
        num(i.y_axis.y, 9),
        num(i.z_axis.y, 9),
        num(i.z_axis.z, 9),
    );
    // Meshes are in the body frame; the link's may have another origin.
    let back = nums(&z_up(-link.origin).to_array(), 6);
    for (k, piece) in pieces.iter().enumerate() {
        let look = &world.looks.looks[piece.look];
        let m = &look.material;
        let file = format!("{name}_visual_{k:02}");
        let rgba = [m.base_color[0].into(), m.base_color[1].into(), m.base_color[2].into(), look.opacity()];
        let mut obj = format!("mtllib {file}.mtl\nusemtl {}\n", look.name);
        obj.push_str(&mjcf::obj(piece));
        let mut mtl = format!("newmtl {}\nKd {}\nd {}\n", look.name, nums(&rgba[..3], 4), num(look.opacity(), 4));
        let mut texture = String::new();
        if let Some(color) = look.color {
            let picture = world.looks.pictures[color].png()?;
            let _ = writeln!(mtl, "map_Kd {}", picture.name);
            texture = format!("<texture filename=\"{}\"/>", picture.name);
            files.add(format!("{folder}/{}", picture.name), picture.bytes);
        }
        let _ = writeln!(
            out,
            "    <visual name=\"{name}_visual_{k:02}\">\n      <origin xyz=\"{back}\" rpy=\"0 0 0\"/>\n      \
             <geometry><mesh filename=\"{file}.obj\"/></geometry>\n      \
             <material name=\"{}\"><color rgba=\"{}\"/>{texture}</material>\n    </visual>",
            look.name,
            nums(&rgba, 4)
        );
        files.text(format!("{folder}/{file}.obj"), obj);
        files.text(format!("{folder}/{file}.mtl"), mtl);
    }
    for (k, hull) in link.hulls.iter().enumerate() {
        if let Some((centre, half)) = mjcf::upright_box(hull) {
            let _ = writeln!(
                out,
                "    <collision name=\"{name}_hull_{k:03}\">\n      <origin xyz=\"{}\" rpy=\"0 0 0\"/>\n      \
                 <geometry><box size=\"{}\"/></geometry>\n    </collision>",
                nums(&(centre - z_up(link.origin)).to_array(), 6),
                nums(&(half * 2.0).to_array(), 6)
            );
        } else {
            let file = format!("{name}_hull_{k:03}.obj");
            let _ = writeln!(
                out,
                "    <collision name=\"{name}_hull_{k:03}\">\n      <origin xyz=\"{back}\" rpy=\"0 0 0\"/>\n      \
                 <geometry><mesh filename=\"{file}\"/></geometry>\n    </collision>"
            );
            files.text(format!("{folder}/{file}"), hull_obj(hull));
        }
    }
    let _ = write!(
        out,
        "    <contact>\n      <lateral_friction value=\"{}\"/>\n      <restitution value=\"{}\"/>\n    </contact>\n  </link>\n",
        num(body.friction, 4),
        num(body.restitution, 4)
    );
    Ok(())
}

fn hull_obj(hull: &Hull) -> String {
    let mut out = String::new();
    for v in &hull.vertices {
        let _ = writeln!(out, "v {}", nums(&z_up(*v).to_array(), 6));
    }
    for [a, b, c] in &hull.faces {
        let _ = writeln!(out, "f {} {} {}", a + 1, b + 1, c + 1);
    }
    out
}
