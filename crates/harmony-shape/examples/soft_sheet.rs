//! Draws soft and grown things into PNG files, to be looked at.
//!
//! `soft_sheet FOLDER [NAME ...]`: one picture a scene, each with a sun, a soft sky and a floor; shadows and the sky's
//! light are traced, so that folds show.

#![allow(clippy::print_stdout, reason = "a command-line program")]

#[path = "soft_sheet/scenes.rs"]
mod scenes;

use std::f64::consts::TAU;
use std::path::Path;
use std::time::Instant;

use glam::{DVec3, Vec2};
use harmony_mesh::{Bvh, Group, Material, Mesh};
use harmony_shape::Piece;
use image::{Rgb, RgbImage};
use rayon::prelude::*;

/// A piece and its linear colour.
pub struct Part {
    /// Shape.
    pub piece: Piece,
    /// Linear RGB.
    pub color: [f64; 3],
}

/// What is drawn.
pub struct Scene {
    /// Parts.
    pub parts: Vec<Part>,
    /// Direction of view as azimuth (0: from the front, 90: from the right) and elevation, degrees.
    pub view: [f64; 2],
    /// Whether the floor is drawn at y = 0.
    pub floor: bool,
}

fn mesh(parts: &[Part]) -> (Mesh, Vec<usize>) {
    let mut mesh = Mesh::default();
    let mut owner = Vec::new();
    for (k, part) in parts.iter().enumerate() {
        let base = mesh.positions.len() as u32;
        mesh.positions.extend(part.piece.positions.iter().map(|p| p.as_vec3()));
        mesh.normals.extend(part.piece.normals.iter().map(|p| p.as_vec3()));
        mesh.uvs.extend(part.piece.uvs.iter().map(|p| p.as_vec2()));
        let triangles: Vec<[u32; 3]> = part.piece.triangles.iter().map(|t| t.map(|i| i + base)).collect();
        owner.extend(std::iter::repeat_n(k, triangles.len()));
        mesh.groups.push(Group { material: 0, triangles });
    }
    mesh.uvs.resize(mesh.positions.len(), Vec2::ZERO);
    mesh.materials.push(Material::plain("part", [0.8; 3]));
    (mesh, owner)
}

/// Evenly spread directions about a normal, cosine-weighted, turned by a number of the pixel.
fn sky(normal: DVec3, k: u32, n: u32, spin: f64) -> DVec3 {
    let a = TAU * (f64::from(k) * 0.618_034 + spin);
    let r = ((f64::from(k) + 0.5) / f64::from(n)).sqrt();
    let side = normal.cross(if normal.x.abs() < 0.7 { DVec3::X } else { DVec3::Y }).normalize();
    let other = normal.cross(side);
    side * (a.cos() * r) + other * (a.sin() * r) + normal * (1.0 - r * r).max(0.0).sqrt()
}

fn draw(scene: &Scene, width: u32, height: u32) -> RgbImage {
    let (mesh, owner) = mesh(&scene.parts);
    let bvh = Bvh::new(&mesh);
    let triangles: Vec<[u32; 3]> = mesh.triangles().collect();
    let b = mesh.bounds().expect("something to draw");
    let centre = b.centre();
    let radius = b.size().length() / 2.0;
    let (az, el) = (scene.view[0].to_radians(), scene.view[1].to_radians());
    let away = DVec3::new(az.sin() * el.cos(), el.sin(), az.cos() * el.cos());
    let half_angle = 0.33_f64;
    let eye = centre + away * (radius / half_angle.sin() * 0.66);
    let right = DVec3::Y.cross(away).normalize();
    let up = away.cross(right);
    let sun = (right * 0.75 + DVec3::Y * 1.0 + DVec3::new(away.x, 0.0, away.z) * 0.35).normalize();
    let zoom = half_angle.tan() / f64::from(height) * 2.0;
    let radiance = |x: f64, y: f64| -> [f64; 3] {
        let direction =
            ((right * (x - f64::from(width) / 2.0) - up * (y - f64::from(height) / 2.0)) * zoom - away).normalize();
        let hit = bvh.raycast(eye, direction, 1e3);
        let ground = if scene.floor && direction.y < 0.0 { -eye.y / direction.y } else { f64::MAX };
        let (point, mut normal, albedo) = match hit {
            Some(h) if h.distance < ground => {
                let t = triangles[h.triangle];
                let [p, q, r] = t.map(|i| mesh.positions[i as usize].as_dvec3());
                let area = (q - p).cross(r - p);
                let weight = |a: DVec3, b: DVec3| (a - h.point).cross(b - h.point).dot(area) / area.length_squared();
                let w = [weight(q, r), weight(r, p), weight(p, q)];
                let n: DVec3 = (0..3).map(|k| mesh.normals[t[k] as usize].as_dvec3() * w[k]).sum();
                // Open sheets are seen from both sides.
                let face = if area.dot(direction) < 0.0 { 1.0 } else { -1.0 };
                (
                    h.point + area.normalize() * (face * 1e-4),
                    n.normalize_or(DVec3::Y) * face,
                    scene.parts[owner[h.triangle]].color,
                )
            }
            _ if ground < 60.0 => (eye + direction * ground + DVec3::Y * 1e-4, DVec3::Y, [0.42, 0.40, 0.38]),
            _ => return [0.62, 0.66, 0.70],
        };
        if normal.dot(direction) > 0.0 {
            normal = (normal - direction * normal.dot(direction) * 1.05).normalize_or(normal);
        }
        let lit = normal.dot(sun).max(0.0);
        let lit = if lit > 0.0 && bvh.any_hit(point, sun, 20.0) { 0.0 } else { lit };
        let spin = ((x * 12.9898 + y * 78.233).sin() * 43_758.545_3).fract();
        let open = (0..16).filter(|k| {
            let d = sky(normal, *k, 16, spin);
            !(bvh.any_hit(point, d, 4.0) || (scene.floor && d.y < 0.0))
        });
        let ambient = 0.08 + 0.55 * open.count() as f64 / 16.0;
        albedo.map(|c| c * (lit * 1.25 + ambient))
    };
    let rows: Vec<Vec<[u8; 3]>> = (0..height)
        .into_par_iter()
        .map(|y| {
            (0..width)
                .map(|x| {
                    let mut sum = [0.0; 3];
                    for (dx, dy) in [(0.25, 0.25), (0.75, 0.75)] {
                        let c = radiance(f64::from(x) + dx, f64::from(y) + dy);
                        (0..3).for_each(|k| sum[k] += c[k] / 2.0);
                    }
                    sum.map(|v| ((v / (1.0 + 0.35 * v) * 1.1).clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0) as u8)
                })
                .collect()
        })
        .collect();
    RgbImage::from_fn(width, height, |x, y| Rgb(rows[y as usize][x as usize]))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1);
    let folder = words.next().ok_or("soft_sheet FOLDER [NAME ...]")?;
    let only: Vec<String> = words.collect();
    std::fs::create_dir_all(&folder)?;
    for (name, make) in scenes::ALL {
        if !only.is_empty() && !only.iter().any(|o| name.starts_with(o.as_str())) {
            continue;
        }
        let start = Instant::now();
        let scene = make();
        let made = start.elapsed();
        let triangles: usize = scene.parts.iter().map(|p| p.piece.triangles.len()).sum();
        let drawing = Instant::now();
        let picture = draw(&scene, 560, 420);
        picture.save(Path::new(&folder).join(format!("{name}.png")))?;
        println!(
            "{name:12} {triangles:7} triangles, made in {:.2} s, drawn in {:.1} s",
            made.as_secs_f64(),
            drawing.elapsed().as_secs_f64()
        );
    }
    Ok(())
}
