//! What a pass draws, made ready: transforms, triangle runs and materials.

use std::sync::Arc;

use glam::{DMat3, DVec3, Mat3, Vec2, Vec3};
use harmony_mesh::{Material, Mesh};
use harmony_scene::Camera;

use crate::glass::{Pane, SOLID, opacity};
use crate::mips::{MipCache, Pyramid};
use crate::{Instance, Window};

/// The camera in the form that the inner loops use.
///
/// Raster coordinates put pixel centres on whole numbers: they are image coordinates less one half.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub(crate) fx: f64,
    pub(crate) fy: f64,
    /// Principal point in raster coordinates.
    pub(crate) cx: f64,
    pub(crate) cy: f64,
    pub(crate) near: f64,
    pub(crate) window: Window,
}

/// One instance in the camera's frame.
pub(crate) struct Placed<'a> {
    pub(crate) mesh: &'a Mesh,
    /// `camera_from_object`.
    pub(crate) linear: DMat3,
    pub(crate) translation: DVec3,
    /// `linear` and `translation` in single precision.
    pub(crate) linear_f32: Mat3,
    pub(crate) translation_f32: Vec3,
    /// Maps normals into the camera frame (not normalised); zero when the transform is singular.
    pub(crate) normal: Mat3,
    /// Where its vertices begin in the projected buffer.
    pub(crate) first_vertex: usize,
    pub(crate) id: u32,
}

/// Which windings are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Faces {
    /// Counter-clockwise in the image as seen (y down), so front faces of an unmirrored instance.
    Front,
    /// The other winding: front faces of a mirrored instance.
    Mirrored,
    /// Both.
    Both,
}

/// A stretch of triangles with one instance and one material.
pub(crate) struct Run<'a> {
    /// Number of its first triangle in the whole pass.
    pub(crate) first: u32,
    /// Index into [`Draw::placed`].
    pub(crate) placed: usize,
    pub(crate) triangles: &'a [[u32; 3]],
    pub(crate) faces: Faces,
    pub(crate) base_color: [f32; 4],
    pub(crate) emissive: [f32; 3],
    /// Of the texture, else of the tile.
    pub(crate) texture: Option<Arc<Pyramid>>,
    /// Tiles a metre, where the texture is a tile laid by metric texture coordinates.
    pub(crate) tiling: Option<Vec2>,
    /// Whether each pixel's alpha decides if it is drawn.
    pub(crate) cut_out: bool,
    /// How light passes, for a see-through surface.
    pub(crate) glass: Option<Pane>,
}

/// Everything one pass draws.
pub(crate) struct Draw<'a> {
    pub(crate) view: View,
    pub(crate) placed: Vec<Placed<'a>>,
    pub(crate) runs: Vec<Run<'a>>,
    /// Number of vertices over all instances.
    pub(crate) vertices: usize,
    /// Number of triangles over all runs.
    pub(crate) triangles: u32,
    /// Triangles from this number on are see-through; they come last.
    pub(crate) opaque: u32,
}

/// The vertices of one triangle, in the object's frame.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Vertices {
    pub(crate) numbers: [usize; 3],
    pub(crate) positions: [Vec3; 3],
    pub(crate) uvs: [Vec2; 3],
}

/// Texels whose alpha is below this are holes of a surface that is not see-through.
pub(crate) const ALPHA_CUT: f32 = 0.5;

/// Materials whose alpha is below this are not drawn.
const INVISIBLE: f32 = 0.004;

/// Nearest near plane, metres: keeps reciprocal depths in range.
const MIN_NEAR: f64 = 1e-4;

impl<'a> Draw<'a> {
    /// Collects what can be drawn; instances with transforms that are not finite are left out.
    pub(crate) fn new(
        camera: &Camera,
        instances: &[Instance<'a>],
        near: f64,
        window: Window,
        textures: &MipCache,
    ) -> Self {
        let k = &camera.intrinsics;
        let view = View {
            fx: k.fx,
            fy: k.fy,
            cx: k.cx - 0.5,
            cy: k.cy - 0.5,
            near: if near.is_finite() { near.max(MIN_NEAR) } else { MIN_NEAR },
            window,
        };
        let mut draw = Self { view, placed: Vec::new(), runs: Vec::new(), vertices: 0, triangles: 0, opaque: 0 };
        let lens_ok = [k.fx, k.fy, k.cx, k.cy].iter().all(|v| v.is_finite()) && k.fx != 0.0 && k.fy != 0.0;
        if lens_ok && !window.is_empty() {
            let mut clear = Vec::new();
            for instance in instances {
                draw.add(camera, instance, textures, &mut clear);
            }
            draw.opaque = draw.triangles;
            for run in clear {
                draw.push(run);
            }
        }
        draw
    }

    /// Appends a run, unless there are too many triangles for their numbers.
    fn push(&mut self, run: Run<'a>) {
        let count = u32::try_from(run.triangles.len()).ok();
        let Some(after) = count.and_then(|n| self.triangles.checked_add(n)) else { return };
        self.runs.push(Run { first: self.triangles, ..run });
        self.triangles = after;
    }

    fn add(&mut self, camera: &Camera, instance: &Instance<'a>, textures: &MipCache, clear: &mut Vec<Run<'a>>) {
        let linear = camera.rotation * instance.linear;
        let translation = camera.to_camera(instance.translation);
        if !linear.is_finite() || !translation.is_finite() {
            return;
        }
        let mesh = instance.mesh;
        let mirrored = linear.determinant() < 0.0;
        let placed = self.placed.len();
        let before = self.runs.len() + clear.len();
        for group in &mesh.groups {
            let material = mesh.materials.get(group.material);
            let alpha = material.map_or(1.0, |m| m.base_color[3]);
            // NaN is drawn: it is not known to be transparent.
            if group.triangles.is_empty() || alpha < INVISIBLE {
                continue;
            }
            let own = material.and_then(|m| m.texture.as_ref());
            let tile = material.and_then(|m| m.tile.as_ref()).filter(|t| {
                own.is_none() && mesh.metric_uvs.len() == mesh.positions.len() && t.size.iter().all(|s| *s > 1e-6)
            });
            let texture = own.or(tile.map(|t| &t.color)).map(|t| textures.get(t));
            let glass = material.filter(|m| opacity(m) < SOLID).map(Pane::new);
            let cuts = |t: &Arc<Pyramid>| glass.is_none() && alpha * f32::from(t.min_alpha) / 255.0 < ALPHA_CUT;
            let run = Run {
                first: 0,
                placed,
                triangles: &group.triangles,
                faces: match (material.is_some_and(|m| m.double_sided), mirrored) {
                    (true, _) => Faces::Both,
                    (false, false) => Faces::Front,
                    (false, true) => Faces::Mirrored,
                },
                base_color: material.map_or([1.0; 4], |m| m.base_color),
                emissive: material.map_or([0.0; 3], emitted),
                cut_out: texture.as_ref().is_some_and(cuts),
                texture,
                tiling: tile.map(|t| Vec2::from_array(t.size).recip()),
                glass,
            };
            if run.glass.is_some() {
                clear.push(run);
            } else {
                self.push(run);
            }
        }
        if self.runs.len() + clear.len() == before {
            return;
        }
        // The cofactor matrix: the inverse transpose times the determinant, defined for singular matrices too.
        let (a, b, c) = (linear.x_axis, linear.y_axis, linear.z_axis);
        let sign = if mirrored { -1.0 } else { 1.0 };
        let cofactors = DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b)) * sign;
        self.placed.push(Placed {
            mesh,
            linear,
            translation,
            linear_f32: linear.as_mat3(),
            translation_f32: translation.as_vec3(),
            normal: cofactors.as_mat3(),
            first_vertex: self.vertices,
            id: instance.id,
        });
        self.vertices += mesh.positions.len();
    }

    /// What the mesh says about a triangle's vertices; texture coordinates are 0 where the mesh has none.
    #[inline]
    pub(crate) fn vertices(&self, numbers: [usize; 3], run: usize) -> Vertices {
        let run = &self.runs[run];
        let mesh = self.placed[run.placed].mesh;
        let [a, b, c] = numbers;
        let p = &mesh.positions;
        let uvs = if let Some(tiles) = run.tiling {
            let uv = |i: usize| mesh.metric_uvs.get(i).map_or(Vec2::ZERO, |m| *m * tiles);
            // Whole tiles are taken off, so that far from the origin no digits are lost.
            let whole = uv(a).floor();
            [uv(a) - whole, uv(b) - whole, uv(c) - whole]
        } else {
            let uv = |i: usize| mesh.uvs.get(i).copied().unwrap_or(Vec2::ZERO);
            [uv(a), uv(b), uv(c)]
        };
        Vertices { numbers, positions: [p[a], p[b], p[c]], uvs }
    }

    /// The run that a triangle number belongs to; `hint` is the run of the last question.
    #[inline]
    pub(crate) fn run_of(&self, triangle: u32, hint: usize) -> usize {
        if let Some(run) = self.runs.get(hint)
            && triangle.wrapping_sub(run.first) < run.triangles.len() as u32
        {
            return hint;
        }
        self.runs.partition_point(|r| r.first <= triangle).saturating_sub(1)
    }

    /// Vertex numbers of a triangle that was drawn.
    #[inline]
    pub(crate) fn corners(&self, triangle: u32, run: usize) -> [usize; 3] {
        let run = &self.runs[run];
        let [a, b, c] = run.triangles[(triangle - run.first) as usize];
        [a as usize, b as usize, c as usize]
    }
}

impl Draw<'_> {
    /// `[a, b, c]` with reciprocal depth = `a x + b y + c` in raster coordinates on a triangle's plane; not finite
    /// for a plane through the camera's centre.
    pub(crate) fn inverse_depth_plane(&self, triangle: u32, run: usize) -> [f64; 3] {
        let corners = self.corners(triangle, run);
        let placed = &self.placed[self.runs[run].placed];
        let positions = &placed.mesh.positions;
        let place = |i: usize| placed.linear * positions[i].as_dvec3() + placed.translation;
        let (p0, p1, p2) = (place(corners[0]), place(corners[1]), place(corners[2]));
        // n . p = n . p0 on the plane, and p = z d with d = ((x - cx) / fx, (y - cy) / fy, 1).
        let n = (p1 - p0).cross(p2 - p0);
        let n = n / n.dot(p0);
        let (a, b) = (n.x / self.view.fx, n.y / self.view.fy);
        [a, b, n.z - a * self.view.cx - b * self.view.cy]
    }
}

fn emitted(material: &Material) -> [f32; 3] {
    material.emissive.map(|e| if e.is_finite() { e } else { 0.0 })
}
