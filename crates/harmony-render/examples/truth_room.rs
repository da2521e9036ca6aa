//! Rebuilds a benchmark room from templates at their true poses, textured from its photo, and draws it from the photo's
//! camera and from another one: `cargo run -p harmony-render --example truth_room -- ROOM_FOLDER sheet.png [MODE]`.
//!
//! `MODE` `plain` leaves the templates untextured, `clay` shades their shapes.

use std::error::Error;
use std::path::Path;

use glam::{DMat3, DVec3, Vec2, Vec3};
use harmony_mesh::{Group, Material, Mesh, TemplateParams, linear_rgb, template, template_name};
use harmony_render::{BakeOptions, Instance, Lighting, RenderOptions, bake_texture, render};
use harmony_scene::{Camera, ImageSize, Intrinsics, Mask, Pose, Size};
use image::{Rgb, RgbImage};
use serde_json::Value;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(folder), Some(out)) = (args.next(), args.next()) else {
        return Err("usage: truth_room ROOM_FOLDER SHEET.png [plain|clay]".into());
    };
    let mode = args.next().unwrap_or_default();
    let folder = Path::new(&folder);
    let photo = image::open(folder.join("photo.jpg"))?.to_rgb8();
    let ids = image::open(folder.join("instances.png"))?.to_luma8();
    let camera = read_camera(&read(folder, "camera.json")?).ok_or("camera.json")?;
    let room = read(folder, "room.json")?;
    let mut meshes: Vec<(Mesh, Pose)> = Vec::new();
    for object in read(folder, "objects.json")?["objects"].as_array().ok_or("objects.json")? {
        let Some((mesh, pose, index)) = build(object) else { continue };
        let mask = Mask::from_fn(camera.size, |x, y| ids.get_pixel(x, y)[0] == index);
        if mask.count() < 30 {
            continue;
        }
        if mode.is_empty() {
            let options = BakeOptions { plain_slots: vec!["glass".into()], ..BakeOptions::default() };
            let baked = bake_texture(&mesh, &pose, &camera, &photo, &mask, &options);
            meshes.push((baked.mesh, pose));
        } else {
            meshes.push((mesh, pose));
        }
    }
    let shell = shell(&room).ok_or("room.json")?;
    let lighting = if mode == "clay" { Lighting::HeadLight } else { Lighting::Unlit };
    let options =
        RenderOptions { lighting, multisample: true, background: [200, 205, 210, 255], ..RenderOptions::default() };
    let mut instances = vec![Instance::in_room(&shell, 1)];
    instances.extend(meshes.iter().map(|(mesh, pose)| Instance::posed(mesh, pose, 2)));
    let (w, h) = (camera.size.width, camera.size.height);
    let mut sheet = RgbImage::new(w * 2, h * 2);
    image::imageops::replace(&mut sheet, &photo, 0, 0);
    let turn = |angle: f64, shift: DVec3| {
        let forward = DMat3::from_rotation_y(angle) * camera.forward();
        let forward = DVec3::new(forward.x, forward.y - 0.15, forward.z);
        Camera::looking(camera.size, camera.intrinsics, camera.centre() + shift, forward)
    };
    let e = |k: &str| room[k].as_f64().unwrap_or(3.0);
    let left = DVec3::new(0.35 - camera.centre().x, 0.1, -0.8);
    let right = DVec3::new(e("W") - 0.35 - camera.centre().x, 0.1, -0.8);
    for (view, (x, y)) in [(camera, (w, 0)), (turn(-0.5, left), (0, h)), (turn(0.6, right), (w, h))] {
        let frame = render(&view, &instances, &options);
        for (i, j, p) in frame.color.enumerate_pixels() {
            sheet.put_pixel(x + i, y + j, Rgb([p[0], p[1], p[2]]));
        }
    }
    sheet.save(out)?;
    Ok(())
}

fn read(folder: &Path, name: &str) -> Result<Value, Box<dyn Error>> {
    Ok(serde_json::from_slice(&std::fs::read(folder.join(name))?)?)
}

fn vector(value: &Value) -> Option<DVec3> {
    Some(DVec3::new(value[0].as_f64()?, value[1].as_f64()?, value[2].as_f64()?))
}

fn read_camera(value: &Value) -> Option<Camera> {
    let k = &value["K"];
    let rows = [vector(&value["R"][0])?, vector(&value["R"][1])?, vector(&value["R"][2])?];
    Some(Camera {
        size: ImageSize::new(value["width"].as_u64()? as u32, value["height"].as_u64()? as u32),
        intrinsics: Intrinsics {
            fx: k[0][0].as_f64()?,
            fy: k[1][1].as_f64()?,
            cx: k[0][2].as_f64()?,
            cy: k[1][2].as_f64()?,
        },
        rotation: DMat3::from_cols(rows[0], rows[1], rows[2]).transpose(),
        translation: vector(&value["t"])?,
    })
}

fn build(object: &Value) -> Option<(Mesh, Pose, u8)> {
    let size = Size::from_vec(vector(&object["size_whd"])?);
    let label = object["label"].as_str()?;
    let name = template_name(label).unwrap_or(label);
    let params = TemplateParams::default().with_label(label);
    let built = template(name, &params, size).build(size).ok()?;
    let mut position = vector(&object["position"])?;
    if object["position_is"].as_str() == Some("centre") {
        position.y -= size.height / 2.0;
    }
    let yaw = object["yaw_deg"].as_f64()?.to_radians();
    Some((built.mesh, Pose::new(position, yaw, 1.0), object["index"].as_u64()? as u8))
}

/// Floor and three walls in flat colours.
fn shell(room: &Value) -> Option<Mesh> {
    let (w, h, d) = (room["W"].as_f64()? as f32, room["H"].as_f64()? as f32, room["D"].as_f64()? as f32);
    let quads: [([u8; 3], [[f32; 3]; 4]); 4] = [
        ([176, 150, 120], [[0.0, 0.0, d], [w, 0.0, d], [w, 0.0, 0.0], [0.0, 0.0, 0.0]]),
        ([222, 218, 210], [[0.0, 0.0, 0.0], [w, 0.0, 0.0], [w, h, 0.0], [0.0, h, 0.0]]),
        ([212, 208, 200], [[0.0, 0.0, d], [0.0, 0.0, 0.0], [0.0, h, 0.0], [0.0, h, d]]),
        ([212, 208, 200], [[w, 0.0, 0.0], [w, 0.0, d], [w, h, d], [w, h, 0.0]]),
    ];
    let mut mesh = Mesh::default();
    for (color, corners) in quads {
        let base = mesh.positions.len() as u32;
        mesh.positions.extend(corners.map(Vec3::from_array));
        mesh.normals.extend([Vec3::Y; 4]);
        mesh.uvs.extend([Vec2::ZERO; 4]);
        mesh.materials.push(Material::plain("shell", linear_rgb(color)));
        let triangles = vec![[base, base + 1, base + 2], [base, base + 2, base + 3]];
        mesh.groups.push(Group { material: mesh.materials.len() - 1, triangles });
    }
    mesh.recompute_normals();
    Some(mesh)
}
