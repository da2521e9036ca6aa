//! The texels of an unwrap and the surface points under them.

use glam::{DVec2, Vec2, Vec3};
use harmony_mesh::Mesh;

/// A texel of the unwrap that lies on the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Texel {
    /// Row-major index in the texture.
    pub at: usize,
    /// Material index.
    pub slot: usize,
    /// Surface point, canonical frame.
    pub point: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Steps on the surface from one texel to the next, along the texture's x and y.
    pub steps: [Vec3; 2],
    /// Metric texture coordinates, metres; 0 where the mesh has none.
    pub metric: Vec2,
    /// Their change from one texel to the next.
    pub metric_steps: [Vec2; 2],
    /// Which connected piece of the unwrap: its smallest vertex index.
    pub chart: u32,
    /// sRGB, 0 to 255.
    pub color: Option<[f32; 3]>,
    /// How much the colour is to be trusted.
    pub weight: f32,
    /// Taken from the photo at its own place.
    pub direct: bool,
    /// Share of the photo's colour, 0 to 1; the rest is made up. Less than 1 near the mask's border and at grazing view.
    pub share: f32,
}

/// All texels on triangles of the unwrap; slots that keep their colour are left out. Triangles too small to hold the
/// centre of a texel get the texels that they touch, where these are free.
pub(super) fn surface(mesh: &Mesh, side: u32, plain: &[String]) -> Vec<Texel> {
    let mut taken = vec![false; (side * side) as usize];
    let mut texels = Vec::new();
    let charts = charts(mesh);
    for only_touched in [false, true] {
        for group in &mesh.groups {
            if mesh.materials.get(group.material).is_none_or(|m| plain.contains(&m.name)) {
                continue;
            }
            for triangle in &group.triangles {
                let Some(t) = Flat::new(mesh, *triangle, side) else { continue };
                let mut put = |x: u32, y: u32, w: [f32; 3]| {
                    let at = (y * side + x) as usize;
                    if !taken[at] {
                        taken[at] = true;
                        texels.push(t.texel(mesh, &charts, at, group.material, w));
                    }
                };
                if only_touched {
                    t.touched(side, &mut put);
                } else {
                    t.covered(side, &mut put);
                }
            }
        }
    }
    texels
}

/// For each vertex the smallest index of its connected piece.
fn charts(mesh: &Mesh) -> Vec<u32> {
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            let up = parent[parent[i as usize] as usize];
            parent[i as usize] = up;
            i = up;
        }
        i
    }
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    for [a, b, c] in mesh.triangles() {
        for other in [b, c] {
            let (x, y) = (root(&mut parent, a), root(&mut parent, other));
            parent[x.max(y) as usize] = x.min(y);
        }
    }
    (0..parent.len() as u32).map(|i| root(&mut parent, i)).collect()
}

/// A triangle in the texture.
struct Flat {
    corners: [usize; 3],
    uv: [DVec2; 3],
    area: f64,
    steps: [Vec3; 2],
    metric: [Vec2; 3],
    metric_steps: [Vec2; 2],
}

impl Flat {
    fn new(mesh: &Mesh, triangle: [u32; 3], side: u32) -> Option<Self> {
        let corners = triangle.map(|i| i as usize);
        let uv = corners.map(|i| mesh.uvs[i].as_dvec2() * f64::from(side));
        let (e, f) = (uv[1] - uv[0], uv[2] - uv[0]);
        let area = e.perp_dot(f);
        if !(area.abs() > 1e-12 && area.is_finite()) {
            return None;
        }
        let p = corners.map(|i| mesh.positions[i].as_dvec3());
        let (dp, dq) = (p[1] - p[0], p[2] - p[0]);
        let steps = [(dp * f.y - dq * e.y) / area, (dq * e.x - dp * f.x) / area].map(glam::DVec3::as_vec3);
        let metric = corners.map(|i| mesh.metric_uvs.get(i).copied().unwrap_or(Vec2::ZERO));
        let (dm, dn) = ((metric[1] - metric[0]).as_dvec2(), (metric[2] - metric[0]).as_dvec2());
        let metric_steps = [(dm * f.y - dn * e.y) / area, (dn * e.x - dm * f.x) / area].map(DVec2::as_vec2);
        Some(Self { corners, uv, area, steps, metric, metric_steps })
    }

    fn weights(&self, p: DVec2) -> [f64; 3] {
        let w0 = (self.uv[1] - p).perp_dot(self.uv[2] - p) / self.area;
        let w1 = (self.uv[2] - p).perp_dot(self.uv[0] - p) / self.area;
        [w0, w1, 1.0 - w0 - w1]
    }

    /// Texels whose centres lie inside.
    fn covered(&self, side: u32, put: &mut impl FnMut(u32, u32, [f32; 3])) {
        let s = f64::from(side);
        let low = self.uv[0].min(self.uv[1]).min(self.uv[2]).floor().max(DVec2::ZERO);
        let high = self.uv[0].max(self.uv[1]).max(self.uv[2]).ceil().min(DVec2::splat(s));
        for y in low.y as u32..high.y as u32 {
            for x in low.x as u32..high.x as u32 {
                let w = self.weights(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                if w.iter().all(|w| *w >= -1e-6) {
                    put(x, y, w.map(|w| w as f32));
                }
            }
        }
    }

    /// Texels that hold a corner, the middle of an edge, or the middle.
    fn touched(&self, side: u32, put: &mut impl FnMut(u32, u32, [f32; 3])) {
        let (h, t) = (0.5, 1.0 / 3.0);
        for w in [[t, t, t], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [h, h, 0.0], [0.0, h, h], [h, 0.0, h]] {
            let p = self.uv[0] * w[0] + self.uv[1] * w[1] + self.uv[2] * w[2];
            let last = f64::from(side - 1);
            let p = p.floor().clamp(DVec2::ZERO, DVec2::splat(last));
            put(p.x as u32, p.y as u32, w.map(|w| w as f32));
        }
    }

    fn texel(&self, mesh: &Mesh, charts: &[u32], at: usize, slot: usize, w: [f32; 3]) -> Texel {
        let mix = |v: &[Vec3]| v[self.corners[0]] * w[0] + v[self.corners[1]] * w[1] + v[self.corners[2]] * w[2];
        Texel {
            at,
            slot,
            point: mix(&mesh.positions),
            normal: mix(&mesh.normals).normalize_or(Vec3::Y),
            steps: self.steps,
            metric: self.metric[0] * w[0] + self.metric[1] * w[1] + self.metric[2] * w[2],
            metric_steps: self.metric_steps,
            chart: charts[self.corners[0]],
            color: None,
            weight: 0.0,
            direct: false,
            share: 0.0,
        }
    }
}
