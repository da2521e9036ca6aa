//! Wavefront OBJ with its MTL and textures, for programs that read nothing else.
//!
//! Metres, +Y up, one `o` an object with its id, room coordinates. MTL has Phong terms and the PBR terms that many programs
//! read (`Pr`, `Pm`, `norm`, `map_Pr`); lights and camera have no place in the format and are left out.

use std::fmt::Write as _;

use glam::{DMat3, DVec3};

use crate::files::Files;
use crate::text::{num, nums};
use crate::world::{Looks, Piece};
use crate::{ExportError, World};

/// The scene.
///
/// # Errors
/// [`ExportError::Texture`].
pub(crate) fn write(world: &World) -> Result<Files, ExportError> {
    let mut out = String::from("# HARMONY scene: metres, +Y up, room coordinates\nmtllib scene.mtl\n");
    let mut count = 0;
    for face in &world.shell {
        object(&mut out, &face.name, &world.face_pieces(face), &world.looks, DMat3::IDENTITY, DVec3::ZERO, &mut count);
    }
    for item in &world.items {
        let pieces = world.body_pieces(item);
        object(&mut out, item.name(), &pieces, &world.looks, item.rotation(), item.object.pose.position, &mut count);
    }
    let mut files = Files::default();
    files.text("obj/scene.obj", out);
    files.text("obj/scene.mtl", mtl(&world.looks));
    for picture in world.looks.small_files()? {
        files.add(format!("obj/textures/{}", picture.name), picture.bytes);
    }
    Ok(files)
}

fn object(
    out: &mut String,
    name: &str,
    pieces: &[Piece],
    looks: &Looks,
    rotation: DMat3,
    position: DVec3,
    count: &mut usize,
) {
    let _ = writeln!(out, "o {name}");
    for piece in pieces {
        for p in &piece.positions {
            let p = rotation * p.as_dvec3() + position;
            let _ = writeln!(out, "v {}", nums(&p.to_array(), 5));
        }
        for uv in &piece.uvs {
            let _ = writeln!(out, "vt {} {}", num(uv.x.into(), 5), num(1.0 - f64::from(uv.y), 5));
        }
        for n in &piece.normals {
            let _ = writeln!(out, "vn {}", nums(&(rotation * n.as_dvec3()).to_array(), 4));
        }
        let _ = writeln!(out, "usemtl {}", looks.looks[piece.look].name);
        for t in &piece.triangles {
            let [a, b, c] = t.map(|i| *count + i as usize + 1);
            let _ = writeln!(out, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}");
        }
        *count += piece.positions.len();
    }
}

fn mtl(looks: &Looks) -> String {
    let mut out = String::from("# HARMONY materials\n");
    for look in &looks.looks {
        let m = &look.material;
        let color = [m.base_color[0], m.base_color[1], m.base_color[2]].map(f64::from);
        let _ = writeln!(out, "newmtl {}\nKd {}", look.name, nums(&color, 5));
        let _ = writeln!(out, "Ks 0.04 0.04 0.04\nNs {}", num(shininess(f64::from(m.roughness)), 2));
        let _ = writeln!(out, "Ni {}\nd {}", num(m.ior.into(), 4), num(look.opacity(), 4));
        let _ = writeln!(out, "Pr {}\nPm {}", num(m.roughness.into(), 4), num(m.metallic.into(), 4));
        if m.emissive.iter().any(|e| *e > 0.0) {
            let _ = writeln!(out, "Ke {}", nums(&m.emissive.map(f64::from), 5));
        }
        let file = |p: usize| looks.pictures[p].small_name();
        if let Some(color) = look.color {
            let _ = writeln!(out, "map_Kd textures/{}", file(color));
            if looks.pictures[color].alpha {
                let _ = writeln!(out, "map_d -imfchan m textures/{}", file(color));
            }
        }
        if let Some(normal) = look.normal {
            let _ = writeln!(out, "norm textures/{}", file(normal));
        }
        let _ = writeln!(out, "illum {}\n", if look.opacity() < 1.0 { 4 } else { 2 });
    }
    out
}

/// Blinn-Phong exponent of a perceptual roughness (alpha is its square).
fn shininess(roughness: f64) -> f64 {
    let alpha = (roughness * roughness).max(0.01);
    (2.0 / (alpha * alpha) - 2.0).clamp(1.0, 1000.0)
}
