//! Times the rasteriser on a procedural scene, and writes that scene for a peer renderer to draw.
//!
//! `bench_scene [--out FOLDER] [--objects 40] [--triangles 3000000] [--rounds 9] [--width 1024] [--height 768]
//! [--only NAME]`
//!
//! The scene depends on the arguments alone. With `--out` the folder receives raw little-endian arrays (positions,
//! normals, texture coordinates, indices), textures as PNG, `scene.txt`, and our own depth and ids for comparison.
//! Lines `name min median cpu` in seconds go to standard output; `cpu` is the mean processor time of a frame over all
//! threads (0 where the system does not tell), which other programs on the machine disturb less.

#![allow(clippy::print_stdout, reason = "a command-line program")]

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::{DMat3, DVec3, Vec2, Vec3};
use harmony_mesh::{Group, Material, Mesh};
use harmony_render::{Instance, Lighting, RenderOptions, Renderer, projected_window};
use harmony_scene::{Camera, ImageSize, Intrinsics};
use image::{Rgba, RgbaImage};

/// Numbers in 0..1 from a fixed linear congruential generator.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

struct Arguments {
    out: Option<String>,
    objects: usize,
    triangles: usize,
    rounds: usize,
    width: u32,
    height: u32,
    only: Option<String>,
}

fn arguments() -> Result<Arguments, String> {
    let mut a =
        Arguments { out: None, objects: 40, triangles: 3_000_000, rounds: 9, width: 1024, height: 768, only: None };
    let mut words = std::env::args().skip(1);
    while let Some(name) = words.next() {
        let value = words.next().ok_or_else(|| format!("{name} needs a value"))?;
        let number = || value.parse::<usize>().map_err(|e| format!("{name} {value}: {e}"));
        match name.as_str() {
            "--out" => a.out = Some(value),
            "--only" => a.only = Some(value),
            "--objects" => a.objects = number()?.max(1),
            "--triangles" => a.triangles = number()?,
            "--rounds" => a.rounds = number()?.max(1),
            "--width" => a.width = number()?.clamp(1, 8192) as u32,
            "--height" => a.height = number()?.clamp(1, 8192) as u32,
            _ => return Err(format!("unknown argument {name}")),
        }
    }
    Ok(a)
}

/// A closed surface around the y axis: a superellipsoid (ball to box) with bumps, standing on y = 0.
fn lump(r: &mut Numbers, triangles: usize) -> Mesh {
    let up = ((triangles as f64 / 4.0).sqrt() as usize).max(4);
    let around = (triangles / (2 * up)).max(3);
    let roundness = 0.25 + 0.75 * r.next();
    let half = DVec3::new(0.25 + 0.3 * r.next(), 0.3 + 0.5 * r.next(), 0.25 + 0.3 * r.next());
    let (bumps_a, bumps_b, height) = ((3.0 + 9.0 * r.next()).floor(), 3.0 + 9.0 * r.next(), 0.08 * r.next());
    let power = |v: f64| v.signum() * v.abs().powf(roundness);
    let mut mesh = Mesh::default();
    for j in 0..=up {
        for i in 0..=around {
            let (u, v) = (i as f64 / around as f64, j as f64 / up as f64);
            let (a, b) = (u * TAU, v * PI);
            let p = DVec3::new(power(b.sin()) * power(a.sin()), power(b.cos()), power(b.sin()) * power(a.cos()));
            let bump = 1.0 + height * (bumps_a * a).sin() * (bumps_b * b).sin();
            mesh.positions.push((p * bump * half + DVec3::new(0.0, half.y, 0.0)).as_vec3());
            mesh.uvs.push(Vec2::new(u as f32, v as f32));
        }
    }
    let row = around as u32 + 1;
    let mut list = Vec::with_capacity(2 * up * around);
    for j in 0..up as u32 {
        for i in 0..around as u32 {
            let a = j * row + i;
            list.extend([[a, a + row, a + row + 1], [a, a + row + 1, a + 1]]);
        }
    }
    mesh.groups = vec![Group { material: 0, triangles: list }];
    let mut material = Material::plain("lump", [1.0; 3]);
    material.texture = Some(Arc::new(texture(r)));
    mesh.materials = vec![material];
    mesh.recompute_normals();
    mesh
}

/// A checkerboard with noise, 1024 by 1024.
fn texture(r: &mut Numbers) -> RgbaImage {
    let colors: [[f64; 3]; 2] = std::array::from_fn(|_| std::array::from_fn(|_| 40.0 + 200.0 * r.next()));
    RgbaImage::from_fn(1024, 1024, |x, y| {
        let c = colors[((x / 64 + y / 64) % 2) as usize];
        let noise = 20.0 * (r.next() - 0.5);
        let [red, green, blue] = c.map(|v| (v + noise).clamp(0.0, 255.0) as u8);
        Rgba([red, green, blue, 255])
    })
}

struct Placed {
    mesh: Mesh,
    linear: DMat3,
    translation: DVec3,
}

fn scene(a: &Arguments) -> (Vec<Placed>, Camera) {
    let mut r = Numbers(2026);
    let columns = (a.objects as f64 * 1.6).sqrt().ceil() as usize;
    let objects: Vec<Placed> = (0..a.objects)
        .map(|i| {
            let mesh = lump(&mut r, a.triangles / a.objects);
            let (column, row) = (i % columns, i / columns);
            let at = DVec3::new(column as f64 * 0.9 + 0.3 * r.next(), 0.0, -(row as f64) * 0.9 + 0.3 * r.next());
            Placed { mesh, linear: DMat3::from_rotation_y(TAU * r.next()), translation: at }
        })
        .collect();
    let size = ImageSize::new(a.width, a.height);
    let lens = Intrinsics::from_horizontal_fov(size, 1.15);
    let middle = (columns - 1) as f64 * 0.45 + 0.15;
    let eye = DVec3::new(middle, 3.6, 3.6);
    let camera = Camera::looking(size, lens, eye, DVec3::new(middle, 0.0, -1.5) - eye);
    (objects, camera)
}

/// Processor time of this process so far, seconds, where Linux tells it.
fn processor_time() -> Option<f64> {
    /// Clock ticks a second in `/proc`; the same on every Linux of today.
    const TICKS: f64 = 100.0;
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / TICKS)
}

fn time(a: &Arguments, name: &str, rounds: usize, mut f: impl FnMut()) {
    if a.only.as_ref().is_some_and(|only| only != name) {
        return;
    }
    let before = processor_time();
    let mut seconds: Vec<f64> = (0..rounds)
        .map(|_| {
            let start = Instant::now();
            f();
            start.elapsed().as_secs_f64()
        })
        .collect();
    let spent = before.zip(processor_time()).map_or(0.0, |(b, a)| (a - b) / rounds as f64);
    seconds.sort_by(f64::total_cmp);
    println!("{name} {:.4} {:.4} {spent:.4}", seconds[0], seconds[rounds / 2]);
}

fn write_vectors(path: &Path, vectors: impl Iterator<Item = f32>) -> std::io::Result<()> {
    fs::write(path, vectors.flat_map(f32::to_le_bytes).collect::<Vec<u8>>())
}

fn write_scene(folder: &Path, objects: &[Placed], camera: &Camera) -> Result<(), Box<dyn std::error::Error>> {
    fs::create_dir_all(folder)?;
    let k = &camera.intrinsics;
    let mut text = format!("{} {} {} {} {} {}\n", camera.size.width, camera.size.height, k.fx, k.fy, k.cx, k.cy);
    // room_from_camera in OpenCV axes, column-major 3 x 3, then the centre.
    let (rotation, centre) = (camera.rotation.transpose(), camera.centre());
    writeln!(text, "{}", numbers(rotation.to_cols_array().iter().chain(&centre.to_array())))?;
    for (i, o) in objects.iter().enumerate() {
        let flat = |v: &[Vec3]| v.iter().flat_map(Vec3::to_array).collect::<Vec<f32>>();
        write_vectors(&folder.join(format!("{i}.positions")), flat(&o.mesh.positions).into_iter())?;
        write_vectors(&folder.join(format!("{i}.normals")), flat(&o.mesh.normals).into_iter())?;
        write_vectors(&folder.join(format!("{i}.uvs")), o.mesh.uvs.iter().flat_map(Vec2::to_array))?;
        let indices: Vec<u8> = o.mesh.triangles().flatten().flat_map(u32::to_le_bytes).collect();
        fs::write(folder.join(format!("{i}.indices")), indices)?;
        if let Some(texture) = &o.mesh.materials[0].texture {
            texture.save(folder.join(format!("{i}.png")))?;
        }
        writeln!(text, "{}", numbers(o.linear.to_cols_array().iter().chain(&o.translation.to_array())))?;
    }
    fs::write(folder.join("scene.txt"), text)?;
    Ok(())
}

fn numbers<'a>(values: impl Iterator<Item = &'a f64>) -> String {
    values.map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let a = arguments()?;
    let (objects, camera) = scene(&a);
    let instances: Vec<Instance> = objects
        .iter()
        .enumerate()
        .map(|(i, o)| Instance { mesh: &o.mesh, linear: o.linear, translation: o.translation, id: i as u32 + 1 })
        .collect();
    println!("triangles {}", objects.iter().map(|o| o.mesh.triangle_count()).sum::<usize>());
    println!("threads {}", rayon::current_num_threads());
    let options = RenderOptions::default();
    let lit = RenderOptions { lighting: Lighting::HeadLight, ..options };
    let smooth = RenderOptions { multisample: true, ..options };

    time(&a, "cold_color_depth_ids", 1, || drop(Renderer::new().render(&camera, &instances, &options)));
    let renderer = Renderer::new();
    let frame = renderer.render(&camera, &instances, &options);
    time(&a, "color_depth_ids", a.rounds, || drop(renderer.render(&camera, &instances, &options)));
    time(&a, "lit_color_depth_ids", a.rounds, || drop(renderer.render(&camera, &instances, &lit)));
    time(&a, "multisampled_color_depth_ids", a.rounds, || drop(renderer.render(&camera, &instances, &smooth)));
    time(&a, "depth_ids", a.rounds, || drop(renderer.render_depth_ids(&camera, &instances, &options)));
    // The placement loop's step: one object alone in its own window.
    let one = &instances[a.objects / 2];
    if let Some(window) = projected_window(&camera, one, options.near) {
        println!("window {} {}", window.width().ceil(), window.height().ceil());
        time(&a, "one_object_window_depth_ids", 20 * a.rounds, || {
            drop(renderer.render_depth_ids_window(&camera, std::slice::from_ref(one), &options, window));
        });
    }
    if let Some(out) = &a.out {
        let folder = Path::new(out);
        write_scene(folder, &objects, &camera)?;
        frame.color.save(folder.join("ours.png"))?;
        renderer.render(&camera, &instances, &lit).color.save(folder.join("ours_lit.png"))?;
        renderer.render(&camera, &instances, &smooth).color.save(folder.join("ours_4x.png"))?;
        write_vectors(&folder.join("ours.depth"), frame.depth.iter().copied())?;
        fs::write(folder.join("ours.ids"), frame.ids.iter().flat_map(|i| i.to_le_bytes()).collect::<Vec<u8>>())?;
    }
    Ok(())
}
