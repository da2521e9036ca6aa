//! What is true of a finished room: visibility, truncation, surface points.

use glam::{DVec3, Vec3};
use harmony_mesh::{Bvh, Mesh};
use harmony_render::{Frame, Instance, RenderOptions, Renderer, projected_window};
use harmony_scene::{Camera, Extents, Surface};
use rayon::prelude::*;

use super::collide::triangle_point;
use super::dice::Dice;
use super::layout::Plan;
use super::shell::{face_id, surface_id};

/// How much of an object is in the photo.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub(super) visible_pixels: usize,
    pub(super) occluded_fraction: Option<f64>,
    pub(super) truncated_fraction: f64,
}

/// Surface points that decide how much of an object is outside the image.
const TRUNCATION_POINTS: usize = 2500;

/// Measures every object of `instances` with an id from 10 on.
pub(super) fn seen(camera: &Camera, instances: &[Instance], frame: &Frame) -> Vec<Seen> {
    let mut counts = vec![0_usize; instances.len() + 16];
    frame.ids.iter().for_each(|id| counts[*id as usize] += 1);
    let renderer = Renderer::new();
    instances
        .par_iter()
        .filter(|i| i.id >= 10)
        .map(|instance| {
            let options = RenderOptions::default();
            let alone = projected_window(camera, instance, options.near).map_or(0, |window| {
                let single = [*instance];
                let piece = renderer.render_depth_ids_window(camera, &single, &options, window);
                piece.depth.iter().filter(|z| **z > 0.0).count()
            });
            let visible = counts[instance.id as usize];
            let mut dice = Dice::new(u64::from(instance.id), 50);
            let points = sample(&mut dice, instance.mesh, TRUNCATION_POINTS);
            let outside = points.iter().filter(|p| {
                let room = instance.linear * p.as_dvec3() + instance.translation;
                !camera.project(room).is_some_and(|pixel| camera.contains(pixel))
            });
            Seen {
                visible_pixels: visible,
                occluded_fraction: (alone > 0).then(|| 1.0 - visible as f64 / alone.max(visible) as f64),
                truncated_fraction: outside.count() as f64 / points.len().max(1) as f64,
            }
        })
        .collect()
}

/// `count` points spread evenly over a mesh's area, in its frame.
pub(super) fn sample(dice: &mut Dice, mesh: &Mesh, count: usize) -> Vec<Vec3> {
    let corners = |t: [u32; 3]| t.map(|i| mesh.positions[i as usize].as_dvec3());
    let mut sums = Vec::new();
    let mut total = 0.0;
    let triangles: Vec<[u32; 3]> = mesh.triangles().collect();
    for t in &triangles {
        let [a, b, c] = corners(*t);
        total += (b - a).cross(c - a).length() / 2.0;
        sums.push(total);
    }
    if total <= 0.0 {
        return Vec::new();
    }
    (0..count)
        .map(|k| {
            let at = (k as f64 + dice.unit()) / count as f64 * total;
            let t = sums.partition_point(|s| *s < at).min(triangles.len() - 1);
            triangle_point(dice, corners(triangles[t])).as_vec3()
        })
        .collect()
}

/// Area of a mesh.
pub(super) fn area(mesh: &Mesh) -> f64 {
    mesh.triangles()
        .map(|t| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
            (b - a).cross(c - a).length() / 2.0
        })
        .sum()
}

/// Points with the id of what they lie on.
#[derive(Debug, Clone, Default)]
pub struct SurfacePoints {
    /// Room frame, metres, rounded to 2^-12 m.
    pub xyz: Vec<Vec3>,
    /// Ids as in `instances.png`.
    pub id: Vec<u16>,
}

impl SurfacePoints {
    fn push(&mut self, p: DVec3, id: u16) {
        self.xyz.push(((p * 4096.0).round() / 4096.0).as_vec3());
        self.id.push(id);
    }
}

/// `count` points over the visible objects, as many a square metre on each.
pub(super) fn object_points(dice: &mut Dice, instances: &[Instance], seen: &[Seen], count: usize) -> SurfacePoints {
    let objects: Vec<&Instance> = instances.iter().filter(|i| i.id >= 10).collect();
    let areas: Vec<f64> =
        objects.iter().zip(seen).map(|(i, s)| if s.visible_pixels > 0 { area(i.mesh) } else { 0.0 }).collect();
    let total: f64 = areas.iter().sum::<f64>().max(1e-9);
    let mut out = SurfacePoints::default();
    let (mut done, mut sum) = (0, 0.0);
    for (instance, own) in objects.iter().zip(&areas) {
        sum += own;
        let until = (sum / total * count as f64).round() as usize;
        for p in sample(dice, instance.mesh, until - done) {
            out.push(instance.linear * p.as_dvec3() + instance.translation, instance.id as u16);
        }
        done = until;
    }
    out
}

/// `count` points over the shell without its openings.
pub(super) fn shell_points(dice: &mut Dice, plan: &Plan, count: usize) -> SurfacePoints {
    if !plan.form.shape.is_box() {
        return face_points(dice, plan, count);
    }
    let e = plan.extents;
    let total: f64 = Surface::ALL.iter().map(|s| s.size(&e).x * s.size(&e).y).sum();
    let mut out = SurfacePoints::default();
    while out.xyz.len() < count {
        let mut at = dice.range(0.0, total);
        let mut face = Surface::Floor;
        for surface in Surface::ALL {
            let area = surface.size(&e).x * surface.size(&e).y;
            face = surface;
            if at < area {
                break;
            }
            at -= area;
        }
        let uv = face.size(&e) * glam::DVec2::new(dice.unit(), dice.unit());
        let hole = plan.holes.iter().any(|h| {
            !h.door
                && Some(h.wall) == face.wall()
                && (h.u[0]..h.u[1]).contains(&uv.x)
                && (h.y[0]..h.y[1]).contains(&uv.y)
        });
        if !hole {
            out.push(face.point(&e, uv), u16::from(surface_id(face)));
        }
    }
    out
}

/// The same over the faces of a room that is no box.
fn face_points(dice: &mut Dice, plan: &Plan, count: usize) -> SurfacePoints {
    let faces = plan.room.all_faces();
    let triangles: Vec<([DVec3; 3], usize)> = faces
        .iter()
        .enumerate()
        .flat_map(|(k, f)| {
            (1..f.polygon.len().saturating_sub(1)).map(move |i| ([f.polygon[0], f.polygon[i], f.polygon[i + 1]], k))
        })
        .collect();
    let mut total = 0.0;
    let sums: Vec<f64> = triangles
        .iter()
        .map(|([a, b, c], _)| {
            total += (*b - *a).cross(*c - *a).length() / 2.0;
            total
        })
        .collect();
    let mut out = SurfacePoints::default();
    while out.xyz.len() < count {
        let at = dice.range(0.0, total);
        let (corners, k) = triangles[sums.partition_point(|s| *s < at).min(triangles.len() - 1)];
        let p = triangle_point(dice, corners);
        let plane = faces[k].plane(&plan.extents);
        let hole = plan.holes.iter().any(|h| {
            let uv = h.wall.coordinates(p);
            let own = plane.is_some_and(|p| p.wall == h.wall && (p.inset - h.inset).abs() < 1e-6);
            !h.door && own && (h.u[0]..h.u[1]).contains(&uv.x) && (h.y[0]..h.y[1]).contains(&uv.y)
        });
        if !hole {
            out.push(p, u16::from(face_id(&faces[k])));
        }
    }
    out
}

/// A back corner of the floor in the image.
#[derive(Debug, Clone, Copy)]
pub struct FloorCorner {
    /// `back_left` or `back_right`.
    pub name: &'static str,
    /// Whether it is inside the image.
    pub in_image: bool,
    /// Whether no object hides it.
    pub unoccluded: bool,
    /// Its place, when it is before the camera.
    pub pixel: Option<[f64; 2]>,
}

/// Both back corners; `blockers` are the objects in room coordinates.
pub(super) fn corners(camera: &Camera, extents: &Extents, blockers: &Mesh) -> [FloorCorner; 2] {
    let tree = Bvh::new(blockers);
    let eye = camera.centre();
    [("back_left", 0.0), ("back_right", extents.width)].map(|(name, x)| {
        let corner = DVec3::new(x, 0.0, 0.0);
        let pixel = camera.project(corner);
        let in_image = pixel.is_some_and(|p| camera.contains(p));
        let way = corner - eye;
        let hidden = tree.any_hit(eye, way, way.length() - 0.02);
        FloorCorner { name, in_image, unoccluded: in_image && !hidden, pixel: pixel.map(|p| [p.x, p.y]) }
    })
}
