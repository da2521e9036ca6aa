//! The light of a photo: primary rays for normals, then direct light from windows and lamps, sun, and one gather of
//! bounced light, at half size, smoothed along surfaces.

use glam::{DVec2, DVec3, Vec3};
use harmony_mesh::{Bvh, Mesh};
use harmony_render::{Frame, Instance};
use harmony_scene::{Camera, Ray, RoomFaces, Wall};
use image::RgbImage;
use rayon::prelude::*;

use super::develop::{Exposure, develop};
use super::dice::{Dice, hash, hash_unit};

/// A rectangle or a point that shines.
#[derive(Debug, Clone, Copy)]
pub struct RoomLight {
    /// What it is.
    pub kind: LightKind,
    /// Middle of a window, a lamp's place; unused for the sun.
    pub position: DVec3,
    /// Direction that a window faces, or that the sun shines.
    pub normal: DVec3,
    /// Width and height of a window, metres; 0 for the others.
    pub size: [f64; 2],
    /// Linear colour, largest component about 1.
    pub color: Vec3,
    /// Power: watts of windows and lamps, W/m2 of the sun.
    pub power: f64,
    /// Number of the object that it belongs to.
    pub owner: Option<usize>,
}

/// Kinds of [`RoomLight`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightKind {
    /// A rectangle.
    Area,
    /// A lamp.
    Point,
    /// Parallel light through the windows.
    Sun,
}

/// What the light needs to know about the room.
pub(super) struct Lit<'a> {
    pub(super) room: RoomFaces,
    pub(super) lights: &'a [RoomLight],
    /// Linear colours of the shell's faces by id (1 floor to 6 left).
    pub(super) colors: [Vec3; 7],
    /// Everything that is drawn, in room coordinates.
    pub(super) all: &'a Mesh,
    /// What throws shadows: objects without panes and lamps' shades.
    pub(super) blockers: &'a Mesh,
}

/// One shaded point.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Point {
    place: Vec3,
    normal: Vec3,
    light: Vec3,
    /// Gives its own light: taken as it is.
    pub(super) glows: bool,
    /// What of it leaves towards the camera.
    pub(super) gleam: f32,
}

/// Every second pixel is lit.
const STEP: u32 = 2;
/// Rays of the gather.
const GATHER: u32 = 8;
/// Shadow rays a window.
const WINDOW_RAYS: u32 = 3;

/// The photo from the flat colours of `frame`, and how it was exposed; `like` takes the exposure of another one.
pub(super) fn photo(
    dice: &mut Dice,
    camera: &Camera,
    frame: &Frame,
    room: &Lit,
    like: Option<Exposure>,
) -> (RgbImage, Exposure) {
    let (all, blockers) = (Bvh::new(room.all), Bvh::new(room.blockers));
    let glows: Vec<bool> = room
        .all
        .groups
        .iter()
        .flat_map(|g| {
            let glow = room.all.materials[g.material].emissive != [0.0; 3];
            g.triangles.iter().map(move |_| glow)
        })
        .collect();
    let triangles: Vec<[u32; 3]> = room.all.triangles().collect();
    let seed = dice.number();
    let (w, h) = (camera.size.width, camera.size.height);
    let surface = |x: u32, y: u32| -> Point {
        let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let Some(hit) = all.raycast(ray.origin, ray.direction, 100.0) else { return Point::default() };
        let mut normal = smooth_normal(room.all, triangles[hit.triangle], hit.point.as_vec3(), hit.normal.as_vec3());
        if normal.dot(ray.direction.as_vec3()) > 0.0 {
            normal = -normal;
        }
        // Shades are brighter in their middle.
        let gleam = 0.74 + 0.26 * normal.dot(ray.direction.as_vec3()).abs();
        Point { place: hit.point.as_vec3(), normal, light: Vec3::ZERO, glows: glows[hit.triangle], gleam }
    };
    let points: Vec<Point> = (0..w * h).into_par_iter().map(|i| surface(i % w, i / w)).collect();
    let (hw, hh) = (w.div_ceil(STEP), h.div_ceil(STEP));
    let coarse: Vec<Point> = (0..hw * hh)
        .into_par_iter()
        .map(|i| {
            let (x, y) = ((i % hw * STEP).min(w - 1), (i / hw * STEP).min(h - 1));
            let mut p = points[(y * w + x) as usize];
            if !p.glows && p.normal != Vec3::ZERO {
                p.light = arriving(room, &blockers, &p, hash(x, y, seed));
            }
            p
        })
        .collect();
    let mut coarse = coarse;
    for spread in [1, 3, 7] {
        coarse = spread_out(&coarse, [hw, hh], spread);
    }
    let lit: Vec<Vec3> = (0..w * h)
        .into_par_iter()
        .map(|i| smoothed(&coarse, [hw, hh], &points[i as usize], [i % w / STEP, i / w / STEP]))
        .collect();
    develop(dice, frame, &points, &lit, like)
}

fn smooth_normal(mesh: &Mesh, t: [u32; 3], at: Vec3, flat: Vec3) -> Vec3 {
    let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
    let area = |p: Vec3, q: Vec3, r: Vec3| (q - p).cross(r - p).dot(flat);
    let whole = area(a, b, c);
    if whole.abs() < 1e-12 {
        return flat;
    }
    let (u, v) = (area(at, b, c) / whole, area(a, at, c) / whole);
    let [na, nb, nc] = t.map(|i| mesh.normals[i as usize]);
    (na * u + nb * v + nc * (1.0 - u - v)).normalize_or(flat)
}

/// Light that arrives at a point, for a white surface.
fn arriving(room: &Lit, blockers: &Bvh, p: &Point, seed: u32) -> Vec3 {
    let from = (p.place + p.normal * 0.003).as_dvec3();
    let mut sum = Vec3::ZERO;
    for (k, light) in room.lights.iter().enumerate() {
        let rays = if light.kind == LightKind::Area { WINDOW_RAYS } else { 1 };
        for r in 0..rays {
            let jitter = |axis: u32| {
                let cell = if axis == 0 { f64::from(r) / f64::from(rays) } else { 0.0 };
                cell + f64::from(hash_unit(k as u32 * 16 + r, axis, seed))
                    / if axis == 0 { f64::from(rays) } else { 1.0 }
            };
            let (value, target) = unshadowed(room, light, from, p.normal.as_dvec3(), [jitter(0), jitter(1)]);
            if value > 1e-4 {
                let reach = target - from;
                let distance = reach.length();
                let wall = || !room.room.is_box() && behind_a_wall(room, from, reach / distance, distance - 0.02);
                if !blockers.any_hit(from, reach / distance, distance - 0.02) && !wall() {
                    sum += light.color * (value / f64::from(rays)) as f32;
                }
            }
        }
    }
    sum + gathered(room, blockers, p, from, seed) / GATHER as f32
}

/// Whether a ray leaves a room that is no box before its end.
fn behind_a_wall(room: &Lit, origin: DVec3, direction: DVec3, length: f64) -> bool {
    let exit = room.room.exit(&Ray { origin, direction });
    exit.is_some_and(|e| (e.point - origin).length() < length)
}

/// Light of one source without shadows, and where it comes from.
fn unshadowed(room: &Lit, light: &RoomLight, at: DVec3, normal: DVec3, jitter: [f64; 2]) -> (f64, DVec3) {
    match light.kind {
        LightKind::Area => {
            let side = DVec3::Y.cross(light.normal).normalize_or(DVec3::X);
            let up = light.normal.cross(side);
            let q =
                light.position + side * (light.size[0] * (jitter[0] - 0.5)) + up * (light.size[1] * (jitter[1] - 0.5));
            let d = q - at;
            let r2 = d.length_squared().max(0.04);
            let dir = d / r2.sqrt();
            let cosines = normal.dot(dir).max(0.0) * (-light.normal.dot(dir)).max(0.0);
            (light.power * cosines / r2, q)
        }
        LightKind::Point => {
            let spread = DVec3::new(jitter[0] - 0.5, jitter[1] - 0.5, jitter[0] * jitter[1] - 0.25) * 0.12;
            let q = light.position + spread;
            let d = q - at;
            let r2 = d.length_squared().max(0.05);
            (light.power * normal.dot(d / r2.sqrt()).max(0.0) / r2, q)
        }
        LightKind::Sun => {
            let to = -light.normal;
            let spread = DVec3::new(jitter[0] - 0.5, 0.0, jitter[1] - 0.5) * 0.03;
            let ray = Ray { origin: at, direction: (to + spread).normalize_or(to) };
            let cosine = normal.dot(to).max(0.0);
            let through = |q: DVec3| {
                room.lights.iter().any(|l| {
                    let side = DVec3::Y.cross(l.normal).normalize_or(DVec3::X);
                    l.kind == LightKind::Area
                        && l.owner.is_some()
                        && (q - l.position).dot(l.normal).abs() < 0.1
                        && (q - l.position).dot(side).abs() < l.size[0] * 0.47
                        && (q - l.position).y.abs() < l.size[1] * 0.47
                })
            };
            match room.room.exit(&ray).map(|e| e.point) {
                Some(q) if cosine > 0.0 && through(q) => (light.power * cosine, q),
                _ => (0.0, at + to),
            }
        }
    }
}

/// Bounced light from a hemisphere of short rays.
fn gathered(room: &Lit, blockers: &Bvh, p: &Point, from: DVec3, seed: u32) -> Vec3 {
    let n = p.normal.as_dvec3();
    let side = n.any_orthonormal_vector();
    let other = n.cross(side);
    let mut sum = Vec3::ZERO;
    for k in 0..GATHER {
        let a = (f64::from(k) + f64::from(hash_unit(k, 91, seed))) / f64::from(GATHER) * std::f64::consts::TAU;
        let r2 = f64::from(hash_unit(k, 92, seed));
        let r = r2.sqrt();
        let direction = (side * (a.cos() * r) + other * (a.sin() * r) + n * (1.0 - r2).sqrt()).normalize_or(n);
        if let Some(hit) = blockers.raycast(from, direction, 2.5) {
            // An object of middling colour, darker the nearer it is.
            let k = 0.1 + 0.1 * (hit.distance / 2.5) as f32;
            sum += k * ambient(room);
            continue;
        }
        let ray = Ray { origin: from, direction };
        let Some(exit) = room.room.exit(&ray) else {
            sum += ambient(room) * 0.5;
            continue;
        };
        let (q, inner) = (exit.point, exit.normal);
        let face = room.colors[usize::from(super::shell::surface_id(exit.surface))];
        let direct: Vec3 = room
            .lights
            .iter()
            .filter(|l| l.kind != LightKind::Sun)
            .map(|l| l.color * (unshadowed(room, l, q + inner * 0.02, inner, [0.5, 0.5]).0 * 0.7).min(2.5) as f32)
            .sum();
        sum += face * (direct + ambient(room));
    }
    sum
}

/// Light that has bounced many times.
fn ambient(room: &Lit) -> Vec3 {
    let e = room.room.extents();
    let area = 2.0 * (e.width * e.depth + e.height * (e.width + e.depth));
    let power: Vec3 = room.lights.iter().filter(|l| l.kind != LightKind::Sun).map(|l| l.color * l.power as f32).sum();
    power * (3.2 / area) as f32 + Vec3::splat(0.05)
}

/// How much two points are of one surface, 0 to 1.
fn alike(p: &Point, q: &Point) -> f32 {
    if q.glows {
        return 0.0;
    }
    let off = (q.place - p.place).dot(p.normal).abs();
    q.normal.dot(p.normal).max(0.0).powi(8) * (1.0 - off / 0.03).max(0.0)
}

/// One pass of an edge-keeping blur with holes (Dammertz et al., "Edge-avoiding a-trous wavelet transform", 2010),
/// weighted by surfaces and a little by the light itself, so that shadows keep their edges.
fn spread_out(coarse: &[Point], size: [u32; 2], step: i32) -> Vec<Point> {
    let (w, h) = (size[0] as i32, size[1] as i32);
    (0..coarse.len())
        .into_par_iter()
        .map(|i| {
            let p = coarse[i];
            if p.glows || p.normal == Vec3::ZERO {
                return p;
            }
            let (x, y) = (i as i32 % w, i as i32 / w);
            let (mut sum, mut weights) = (p.light, 1.0);
            for dy in -2..=2 {
                for dx in -2..=2 {
                    let (qx, qy) = (x + dx * step, y + dy * step);
                    if (dx, dy) == (0, 0) || qx < 0 || qy < 0 || qx >= w || qy >= h {
                        continue;
                    }
                    let q = &coarse[(qy * w + qx) as usize];
                    let change = (q.light - p.light).length() / (p.light.length() + 0.05);
                    let steep = if step == 1 { 0.6 } else { 3.0 };
                    let weight = alike(&p, q) / (1.0 + steep * change * change * 4.0);
                    sum += q.light * weight;
                    weights += weight;
                }
            }
            Point { light: sum / weights, ..p }
        })
        .collect()
}

/// The mean of the nearest lit points on the same surface.
fn smoothed(coarse: &[Point], size: [u32; 2], p: &Point, at: [u32; 2]) -> Vec3 {
    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
    for dy in -1..=1 {
        for dx in -1..=1 {
            let (x, y) = (at[0] as i32 + dx, at[1] as i32 + dy);
            if x < 0 || y < 0 || x >= size[0] as i32 || y >= size[1] as i32 {
                continue;
            }
            let q = &coarse[(y as u32 * size[0] + x as u32) as usize];
            let weight = alike(p, q);
            sum += q.light * weight;
            weights += weight;
        }
    }
    if weights > 1e-4 {
        sum / weights
    } else {
        coarse[(at[1].min(size[1] - 1) * size[0] + at[0].min(size[0] - 1)) as usize].light
    }
}

/// All instances as one mesh in room coordinates; `keep` says which (instance, material) belong to it.
pub(super) fn merged(instances: &[Instance], keep: impl Fn(&Instance, &harmony_mesh::Material) -> bool) -> Mesh {
    let mut out = Mesh::default();
    for instance in instances {
        let mut mesh = instance.mesh.clone();
        let (linear, shift) = (instance.linear, instance.translation);
        mesh.map(|p| (linear * p.as_dvec3() + shift).as_vec3(), |n| (linear * n.as_dvec3()).as_vec3());
        mesh.groups.retain(|g| keep(instance, &mesh.materials[g.material]));
        out.append(&mesh);
    }
    out
}

/// Lights of the room: windows by day, a soft fill, lit lamps, now and then the sun.
pub(super) fn lights(dice: &mut Dice, plan: &super::layout::Plan) -> Vec<RoomLight> {
    let e = plan.extents;
    let mut out = Vec::new();
    let day = dice.f(0.7, 1.3);
    for hole in plan.holes.iter().filter(|h| !h.door) {
        let (w, h) = (hole.u[1] - hole.u[0], hole.y[1] - hole.y[0]);
        let middle = hole.plane().point(&e, f64::midpoint(hole.u[0], hole.u[1]), f64::midpoint(hole.y[0], hole.y[1]));
        out.push(RoomLight {
            kind: LightKind::Area,
            position: middle + hole.wall.normal() * 0.02,
            normal: hole.wall.normal(),
            size: [w, h],
            color: Vec3::new(0.88, 0.95, 1.0),
            power: w * h * 2.2 * f64::from(day),
            owner: Some(hole.item),
        });
    }
    let windows: Vec<Wall> = plan.holes.iter().filter(|h| !h.door).map(|h| h.wall).collect();
    if let Some(wall) = windows.first()
        && dice.chance(0.35)
    {
        let slant = DVec3::new(dice.range(-0.5, 0.5), -dice.range(0.5, 0.9), dice.range(-0.3, 0.3));
        out.push(RoomLight {
            kind: LightKind::Sun,
            position: DVec3::ZERO,
            normal: (wall.normal() + slant).normalize_or(DVec3::NEG_Y),
            size: [0.0; 2],
            color: Vec3::new(1.0, 0.92, 0.8),
            power: dice.range(1.5, 3.0),
            owner: None,
        });
    }
    // The rest of the room behind the photographer.
    out.push(RoomLight {
        kind: LightKind::Area,
        position: DVec3::new(e.width * dice.range(0.35, 0.65), e.height * 0.7, e.depth - 0.05),
        normal: DVec3::new(0.0, -0.15, -1.0).normalize_or(DVec3::NEG_Z),
        size: [e.width * 0.7, e.height * 0.5],
        color: Vec3::new(1.0, 0.96, 0.9),
        power: e.width * e.depth * if windows.is_empty() { 0.16 } else { 0.09 },
        owner: None,
    });
    for (k, item) in plan.items.iter().enumerate().filter(|(_, i)| i.piece.lit) {
        let [low, high] = item.heights();
        let hung = item.level == super::layout::Level::Ceiling;
        let y = if hung { low - 0.05 } else { high + 0.04 };
        out.push(RoomLight {
            kind: LightKind::Point,
            position: DVec3::new(item.position.x, y, item.position.z),
            normal: DVec3::NEG_Y,
            size: [0.0; 2],
            color: Vec3::new(1.0, 0.82, 0.58),
            power: if hung { dice.range(0.5, 0.9) } else { dice.range(0.1, 0.22) },
            owner: Some(k),
        });
    }
    out
}
