//! Draws a small empty room with three blocks in it from the standard cameras: `room_views [FOLDER]`.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DMat3, DVec3, Vec2, Vec3};
use harmony_mesh::{Group, Material, Mesh, ShellOptions, room_shell_with};
use harmony_render::{
    Instance, Lighting, RenderOptions, Renderer, RoomView, canonical_camera, mesh_view_camera, orbit_cameras,
};
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Opening, OpeningKind, Room, Surface, Wall};
use image::{Rgba, RgbaImage};

fn room() -> Room {
    let opening = |kind, wall, u, y| Opening { kind, wall, u, y, inset: 0.0, rise: 0.0, object: None };
    Room {
        room_type: "living_room".into(),
        extents: Extents { width: 4.5, height: 2.6, depth: 5.5 },
        shape: harmony_scene::RoomShape::default(),
        seen: vec![],
        openings: vec![
            opening(OpeningKind::Window, Wall::Back, [1.2, 2.8], [0.9, 2.1]),
            opening(OpeningKind::Door, Wall::Left, [3.6, 4.5], [0.0, 2.05]),
            opening(OpeningKind::Window, Wall::Right, [1.0, 2.0], [1.0, 2.0]),
        ],
        floor_texture: None,
        wall_texture: None,
    }
}

/// A grid whose red and green grow along u and v, with a white mark at (0, 0).
fn chart(surface: Surface) -> Option<Arc<RgbaImage>> {
    let blue = Surface::ALL.iter().position(|s| *s == surface)? as u8 * 40;
    Some(Arc::new(RgbaImage::from_fn(512, 512, |x, y| {
        let line = x % 64 < 3 || y % 64 < 3;
        let mark = x < 48 && y < 48;
        let c = if mark { [255; 3] } else { [(x / 2) as u8, (y / 2) as u8, blue] };
        let [r, g, b] = c.map(|v| if line { v / 2 } else { v });
        Rgba([r, g, b, 255])
    })))
}

fn block(size: Vec3, color: [f32; 3]) -> Mesh {
    let mut mesh = Mesh { materials: vec![Material::plain("block", color)], ..Mesh::default() };
    let mut triangles = Vec::new();
    for (axis, side) in (0..3).flat_map(|a| [(a, -1.0), (a, 1.0)]) {
        let mut normal = Vec3::ZERO;
        normal[axis] = side;
        let (mut u, mut v) = (Vec3::ZERO, Vec3::ZERO);
        u[(axis + 1) % 3] = side;
        v[(axis + 2) % 3] = 1.0;
        let first = mesh.positions.len() as u32;
        for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let corner = (normal + u * a + v * b) / 2.0;
            mesh.positions.push((corner + Vec3::Y / 2.0) * size);
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2::new(a, b));
        }
        triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    mesh.groups = vec![Group { material: 0, triangles }];
    mesh
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "out".into()));
    std::fs::create_dir_all(&folder)?;
    let room = room();
    let size = ImageSize::new(800, 600);
    let lens = Intrinsics::from_horizontal_fov(size, 1.2);
    let photo = Camera::looking(size, lens, DVec3::new(3.6, 1.6, 5.2), DVec3::new(-0.35, -0.2, -1.0));
    let blocks = [
        (block(Vec3::new(1.8, 0.8, 0.9), [0.5, 0.1, 0.1]), DVec3::new(1.6, 0.0, 0.6), 0.0),
        (block(Vec3::new(0.6, 1.8, 0.4), [0.2, 0.3, 0.05]), DVec3::new(4.1, 0.0, 2.2), 1.5),
        (block(Vec3::new(1.0, 0.4, 0.6), [0.1, 0.15, 0.4]), DVec3::new(2.0, 0.0, 2.4), 0.4),
    ];
    let renderer = Renderer::new();
    let options = RenderOptions {
        lighting: Lighting::HeadLight,
        multisample: true,
        background: [235, 235, 235, 255],
        ..RenderOptions::default()
    };
    let draw = |name: &str, view: &RoomView| {
        let shell_options = ShellOptions { omit: view.omit.clone(), ..ShellOptions::default() };
        let shell = room_shell_with(&room, &chart, &shell_options);
        let mut instances = vec![Instance::in_room(&shell, 1)];
        for (i, (mesh, at, yaw)) in blocks.iter().enumerate() {
            let linear = DMat3::from_rotation_y(*yaw);
            instances.push(Instance { mesh, linear, translation: *at, id: i as u32 + 2 });
        }
        renderer.render(&view.camera, &instances, &options).color.save(folder.join(name))
    };
    draw("photo.png", &RoomView { camera: photo, omit: vec![] })?;
    draw("canonical.png", &canonical_camera(&room, size, &photo, &[]))?;
    for (i, view) in orbit_cameras(&room, ImageSize::new(400, 300), 4).iter().enumerate() {
        draw(&format!("orbit_{i}.png"), view)?;
    }
    let mesh = &blocks[0].0;
    if let Some(bounds) = mesh.bounds() {
        for k in 0..4 {
            let camera = mesh_view_camera(&bounds, k, ImageSize::new(256, 256));
            let frame = renderer.render(&camera, &[Instance::in_room(mesh, 1)], &options);
            frame.color.save(folder.join(format!("mesh_{k}.png")))?;
        }
    }
    Ok(())
}
