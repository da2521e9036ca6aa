//! URDF: one folder an object, with its meshes beside it.
//!
//! +Z up, metres; one link in the object's body frame (its front at -Y), visual and collision meshes as OBJ, mass, centre
//! and inertia. URDF has no friction: `<contact>` as other programs extend it says it. Meshes lie beside the URDF, for
//! some readers leave folders out of their names.

use std::fmt::Write as _;

use harmony_physics::{Bodies, Body, Hull};

use crate::files::Files;
use crate::text::{escaped, num, nums};
use crate::world::{Item, z_up, z_up_rotation};
use crate::{ExportError, World, mjcf};

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
    let folder = format!("urdf/{name}");
    let mut out = format!(
        "<?xml version=\"1.0\"?>\n<!-- HARMONY object: metres, +Z up; {} -->\n<robot name=\"{name}\">\n  <link name=\"{name}\">\n",
        escaped(&item.object.label.replace("--", "-"))
    );
    let i = z_up_rotation(body.inertia_matrix());
    let _ = writeln!(
        out,
        "    <inertial>\n      <origin xyz=\"{}\" rpy=\"0 0 0\"/>\n      <mass value=\"{}\"/>\n      \
         <inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/>\n    </inertial>",
        nums(&z_up(body.centre_of_mass).to_array(), 6),
        num(body.mass_kg, 6),
        num(i.x_axis.x, 9),
        num(i.y_axis.x, 9),
        num(i.z_axis.x, 9),
        num(i.y_axis.y, 9),
        num(i.z_axis.y, 9),
        num(i.z_axis.z, 9),
    );
    for (k, piece) in world.body_pieces(item).iter().enumerate() {
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
            "    <visual name=\"visual_{k:02}\">\n      <geometry><mesh filename=\"{file}.obj\"/></geometry>\n      \
             <material name=\"{}\"><color rgba=\"{}\"/>{texture}</material>\n    </visual>",
            look.name,
            nums(&rgba, 4)
        );
        files.text(format!("{folder}/{file}.obj"), obj);
        files.text(format!("{folder}/{file}.mtl"), mtl);
    }
    for (k, hull) in body.hulls.iter().enumerate() {
        if let Some((centre, half)) = mjcf::upright_box(hull) {
            let _ = writeln!(
                out,
                "    <collision name=\"hull_{k:03}\">\n      <origin xyz=\"{}\" rpy=\"0 0 0\"/>\n      \
                 <geometry><box size=\"{}\"/></geometry>\n    </collision>",
                nums(&centre.to_array(), 6),
                nums(&(half * 2.0).to_array(), 6)
            );
        } else {
            let file = format!("{name}_hull_{k:03}.obj");
            let _ = writeln!(
                out,
                "    <collision name=\"hull_{k:03}\">\n      <geometry><mesh filename=\"{file}\"/></geometry>\n    </collision>"
            );
            files.text(format!("{folder}/{file}"), hull_obj(hull));
        }
    }
    let _ = write!(
        out,
        "    <contact>\n      <lateral_friction value=\"{}\"/>\n      <restitution value=\"{}\"/>\n    </contact>\n  </link>\n</robot>\n",
        num(body.friction, 4),
        num(body.restitution, 4)
    );
    files.text(format!("{folder}/{name}.urdf"), out);
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
