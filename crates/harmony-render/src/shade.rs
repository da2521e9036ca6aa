//! Colour of the visible triangle at a sample: perspective-correct texture lookup and lighting.

use glam::{Vec2, Vec3};

use crate::mips::Pyramid;
use crate::prepare::{Draw, Vertices};
use crate::{Lighting, RenderOptions};

/// A visible triangle in the camera's frame, ready to be met by pixel rays.
///
/// With corner `p0` and edges `e1`, `e2`, the ray `k d` meets it at the barycentric coordinates
/// `u = d.a / d.c`, `v = d.b / d.c`, where `a = e2 x t`, `b = t x e1`, `c = e2 x e1`, `t = -p0`
/// (Moller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997, with `d` factored out).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facet {
    corners: [usize; 3],
    a: Vec3,
    b: Vec3,
    c: Vec3,
    uv: [Vec2; 3],
    /// Pixel to ray: `d = ((x - cx) / fx, (y - cy) / fy, 1)`.
    step: Vec2,
    centre: Vec2,
}

/// Where a ray meets a facet.
#[derive(Debug, Clone, Copy)]
struct Meeting {
    /// Barycentric weights of the corners, none negative.
    weights: [f32; 3],
    uv: Vec2,
    /// Change of `uv` a pixel along x and y.
    uv_dx: Vec2,
    uv_dy: Vec2,
}

impl Facet {
    /// From what [`Draw::vertices`] fetched.
    #[inline]
    pub(crate) fn new(draw: &Draw, vertices: &Vertices, run: usize) -> Self {
        let placed = &draw.placed[draw.runs[run].placed];
        let m = placed.linear_f32;
        let [q0, q1, q2] = vertices.positions;
        let (e1, e2) = (m * (q1 - q0), m * (q2 - q0));
        let t = -(m * q0 + placed.translation_f32);
        Self {
            corners: vertices.numbers,
            a: e2.cross(t),
            b: t.cross(e1),
            c: e2.cross(e1),
            uv: vertices.uvs,
            step: Vec2::new(1.0 / draw.view.fx as f32, 1.0 / draw.view.fy as f32),
            centre: Vec2::new(draw.view.cx as f32, draw.view.cy as f32),
        }
    }

    fn meet(&self, x: f32, y: f32) -> Meeting {
        let d = ((Vec2::new(x, y) - self.centre) * self.step).extend(1.0);
        let inverse = 1.0 / d.dot(self.c);
        let (u, v) = (d.dot(self.a) * inverse, d.dot(self.b) * inverse);
        // Snapping lets a sample lie a little outside: hold it on the triangle, and thereby on its texture island.
        let (mut w1, mut w2) = (u.max(0.0), v.max(0.0));
        let sum = w1 + w2;
        if sum > 1.0 {
            w1 /= sum;
            w2 /= sum;
        }
        let [t0, t1, t2] = self.uv;
        let (along1, along2) = (t1 - t0, t2 - t0);
        // Quotient rule on u = d.a / d.c.
        let slope = |axis: usize| {
            let k = self.step[axis] * inverse;
            along1 * ((self.a[axis] - u * self.c[axis]) * k) + along2 * ((self.b[axis] - v * self.c[axis]) * k)
        };
        Meeting {
            weights: [1.0 - w1 - w2, w1, w2],
            uv: t0 + along1 * w1 + along2 * w2,
            uv_dx: slope(0),
            uv_dy: slope(1),
        }
    }

    /// Alpha of the material at a raster position.
    pub(crate) fn alpha(&self, draw: &Draw, run: usize, x: f32, y: f32) -> f32 {
        let run = &draw.runs[run];
        run.texture.as_ref().map_or(1.0, |t| self.meet(x, y).sample(t, 1)[3]) * run.base_color[3]
    }

    /// Linear colour at a raster position, by at most `probes` probes of the texture: as many as samples of a pixel show
    /// the facet, so that floors seen at a low angle stay sharp and a pixel of many facets costs no more than others.
    pub(crate) fn color(
        &self,
        draw: &Draw,
        run: usize,
        options: &RenderOptions,
        x: f32,
        y: f32,
        probes: u32,
    ) -> [f32; 3] {
        let run = &draw.runs[run];
        let [r, g, b, _] = run.base_color;
        let mut color = [r, g, b];
        let lit = options.lighting == Lighting::HeadLight;
        let colors = &draw.placed[run.placed].mesh.colors;
        if run.texture.is_some() || lit || !colors.is_empty() {
            let meeting = self.meet(x, y);
            if let Some(texture) = &run.texture {
                let t = meeting.sample(texture, probes);
                color = [r * t[0], g * t[1], b * t[2]];
            }
            color = self.tinted(color, colors, &meeting);
            if lit {
                let k = head_light(self.cosine(draw, run.placed, &meeting, x, y));
                color = color.map(|c| c * k);
            }
        }
        glowing(color, run.emissive)
    }

    /// Material colour with alpha, light at the camera counted where asked for, and the cosine between normal and view,
    /// at a raster position: what a see-through surface is made from.
    pub(crate) fn film(&self, draw: &Draw, run: usize, options: &RenderOptions, x: f32, y: f32) -> ([f32; 4], f32) {
        let run = &draw.runs[run];
        let meeting = self.meet(x, y);
        let mut color = run.base_color;
        if let Some(texture) = &run.texture {
            for (c, t) in color.iter_mut().zip(meeting.sample(texture, 1)) {
                *c *= t;
            }
        }
        let cosine = self.cosine(draw, run.placed, &meeting, x, y);
        let [r, g, b, a] = color;
        let [r, g, b] = self.tinted([r, g, b], &draw.placed[run.placed].mesh.colors, &meeting);
        let k = if options.lighting == Lighting::HeadLight { head_light(cosine) } else { 1.0 };
        ([r * k, g * k, b * k, a], cosine)
    }

    /// A colour under the light that the vertices say.
    fn tinted(&self, color: [f32; 3], colors: &[[f32; 3]], meeting: &Meeting) -> [f32; 3] {
        if colors.is_empty() {
            return color;
        }
        let mut light = [0.0; 3];
        for (i, w) in self.corners.iter().zip(meeting.weights) {
            let vertex = colors.get(*i).copied().unwrap_or([1.0; 3]);
            for (l, v) in light.iter_mut().zip(vertex) {
                *l += v * w;
            }
        }
        std::array::from_fn(|k| color[k] * light[k])
    }

    /// Cosine between normal and view, at least 0; 1 where there is no normal.
    fn cosine(&self, draw: &Draw, placed: usize, meeting: &Meeting, x: f32, y: f32) -> f32 {
        let placed = &draw.placed[placed];
        let normals = &placed.mesh.normals;
        let smooth: Vec3 = self
            .corners
            .iter()
            .zip(meeting.weights)
            .map(|(i, w)| normals.get(*i).copied().unwrap_or(Vec3::ZERO) * w)
            .sum();
        let n = (placed.normal * smooth).try_normalize().or_else(|| self.c.try_normalize());
        let d = ((Vec2::new(x, y) - self.centre) * self.step).extend(1.0).normalize_or(Vec3::Z);
        // The absolute value lights back faces of double-sided materials, and bad normals, as their fronts.
        n.map_or(1.0, |n| n.dot(d).abs())
    }
}

/// Light that comes back from a matt surface lit from the camera, with some ambient light.
fn head_light(cosine: f32) -> f32 {
    const AMBIENT: f32 = 0.15;
    AMBIENT + (1.0 - AMBIENT) * cosine
}

/// A colour with emitted light added, held to what a picture can show: light that is too strong for it keeps half of its
/// hue, as bulbs and shades do in photos.
#[inline]
pub(crate) fn glowing(color: [f32; 3], light: [f32; 3]) -> [f32; 3] {
    if light == [0.0; 3] {
        return color;
    }
    let sum: [f32; 3] = std::array::from_fn(|k| color[k] + light[k].max(0.0));
    let most = sum[0].max(sum[1]).max(sum[2]);
    if most <= 1.0 {
        return sum;
    }
    let white = 0.5 * (1.0 - 1.0 / most);
    sum.map(|c| c / most * (1.0 - white) + white)
}

impl Meeting {
    /// Texture at the meeting, by one trilinear probe or by up to `most` along the longer side of the pixel's footprint.
    #[inline]
    fn sample(&self, texture: &Pyramid, most: u32) -> [f32; 4] {
        let (w, h) = texture.size();
        let size = Vec2::new(w, h);
        let (x2, y2) = ((self.uv_dx * size).length_squared(), (self.uv_dy * size).length_squared());
        let (longest, shortest) = (x2.max(y2), x2.min(y2));
        let long = longest > 4.0 * shortest.max(1.0);
        // Twice as long as wide is left to one probe.
        if most <= 1 || !long {
            return texture.sample(self.uv.x, self.uv.y, longest);
        }
        let probes = ((longest / shortest.max(1.0)).sqrt() as u32 + 1).min(most);
        let n = probes as f32;
        let along = if x2 >= y2 { self.uv_dx } else { self.uv_dy };
        let mut sum = [0.0; 4];
        for i in 0..probes {
            let at = self.uv + along * ((i as f32 + 0.5) / n - 0.5);
            let t = texture.sample(at.x, at.y, longest / (n * n));
            for (s, c) in sum.iter_mut().zip(t) {
                *s += c / n;
            }
        }
        sum
    }
}
