//! The triangle mesh that everything here works on.

use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use image::{RgbImage, RgbaImage};

/// A look that repeats over a surface at metric scale. Images wrap around.
///
/// Tangent space is glTF's: x along the images' rows, y up their columns (against v), z out of the surface. With
/// `t = dP/du` and `b = dP/dv` of the texture coordinates, the normal is `n.x t - n.y b + n.z N`, normalised.
#[derive(Debug, Clone)]
pub struct Tile {
    /// Width and height of the images on the surface, metres.
    pub size: [f32; 2],
    /// Turn of the images on the surface, radians, u towards v: 0 for most, see [`Tile::uv`].
    pub turn: f32,
    /// sRGB colour.
    pub color: Arc<RgbaImage>,
    /// Normals, as glTF has them.
    pub normal: Option<Arc<RgbImage>>,
    /// Red: occlusion, green: roughness, blue: metalness; multiplied with the material's factors.
    pub surface: Option<Arc<RgbImage>>,
}

impl Tile {
    /// Texture coordinates of a place on the surface in metres ([`Mesh::metric_uvs`]).
    pub fn uv(&self, metric: Vec2) -> Vec2 {
        let (sin, cos) = (libm::sinf(self.turn), libm::cosf(self.turn));
        let turned = Vec2::new(cos * metric.x + sin * metric.y, cos * metric.y - sin * metric.x);
        turned / Vec2::from_array(self.size).max(Vec2::splat(1e-6))
    }

    /// The place in metres of texture coordinates: the inverse of [`Tile::uv`].
    pub fn metric(&self, uv: Vec2) -> Vec2 {
        let (sin, cos) = (libm::sinf(self.turn), libm::cosf(self.turn));
        let flat = uv * Vec2::from_array(self.size);
        Vec2::new(cos * flat.x - sin * flat.y, sin * flat.x + cos * flat.y)
    }
}

/// How a group of triangles looks.
#[derive(Debug, Clone)]
pub struct Material {
    /// Name; for part models the slot name (`body`, `legs`, `shade`, ...).
    pub name: String,
    /// Linear RGB and alpha, multiplied with the texture.
    pub base_color: [f32; 4],
    /// sRGB colour texture; uv (0, 0) is the image's top-left corner as in glTF; wraps around.
    pub texture: Option<Arc<RgbaImage>>,
    /// Repeating look by [`Mesh::metric_uvs`], drawn where there is no `texture`; multiplied with `base_color`.
    pub tile: Option<Arc<Tile>>,
    /// Cloth sheen, 0 to 1.
    pub sheen: f32,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Metalness.
    pub metallic: f32,
    /// Index of refraction.
    pub ior: f32,
    /// Transmission.
    pub transmission: f32,
    /// Linear RGB of emitted light (0 = none), strength in it.
    pub emissive: [f32; 3],
    /// Whether back faces are drawn.
    pub double_sided: bool,
    /// Whether some of it are hairs, whose faces stand across the surface that light falls on.
    pub hairy: bool,
}

impl Material {
    /// A rough dielectric of one linear colour.
    pub fn plain(name: &str, linear_rgb: [f32; 3]) -> Self {
        Self {
            name: name.to_owned(),
            base_color: [linear_rgb[0], linear_rgb[1], linear_rgb[2], 1.0],
            texture: None,
            tile: None,
            sheen: 0.0,
            roughness: 0.6,
            metallic: 0.0,
            ior: 1.5,
            transmission: 0.0,
            emissive: [0.0; 3],
            double_sided: false,
            hairy: false,
        }
    }

    /// Whether it mirrors bright things around it enough to be seen: leather, lacquer, glazes; not metals, which have no
    /// other colour than what they mirror.
    pub fn shines(&self) -> bool {
        let surface = self.tile.as_ref().and_then(|tile| tile.surface.as_ref());
        let [rough, metal] = surface.map_or([1.0; 2], |image| {
            let mean = |c: usize| image.pixels().map(|p| f32::from(p.0[c])).sum::<f32>() / 255.0;
            [1, 2].map(|c| mean(c) / (image.width() * image.height()).max(1) as f32)
        });
        self.roughness * rough < GLOSSY && self.metallic * metal < 0.5
    }
}

/// Perceptual roughness below which a material shines.
const GLOSSY: f32 = 0.45;

/// Triangles that share a material.
#[derive(Debug, Clone, Default)]
pub struct Group {
    /// Index into [`Mesh::materials`].
    pub material: usize,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A triangle mesh with normals, texture coordinates and materials.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Positions, in the units the caller states (canonical units or metres).
    pub positions: Vec<Vec3>,
    /// Unit normals, one a position.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one a position.
    pub uvs: Vec<Vec2>,
    /// Unwrapped positions in metres, one a position or none at all: what [`Tile`]s are laid by.
    pub metric_uvs: Vec<Vec2>,
    /// Light on the surface where a look without lamps wants it: linear RGB from 0 to 1, one a position or none at all,
    /// multiplied with the material's colour.
    pub colors: Vec<[f32; 3]>,
    /// Triangles by material.
    pub groups: Vec<Group>,
    /// Materials.
    pub materials: Vec<Material>,
}

/// Axis-aligned bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: DVec3,
    /// Largest corner.
    pub max: DVec3,
}

impl Bounds {
    /// Edge lengths.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Centre.
    pub fn centre(&self) -> DVec3 {
        (self.max + self.min) / 2.0
    }
}

/// What is wrong with a mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// No triangles.
    #[error("the mesh has no triangles")]
    Empty,
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is not finite")]
    NotFinite {
        /// First such vertex.
        vertex: usize,
    },
    /// An index points past the vertices.
    #[error("a triangle refers to vertex {index}, but there are {count}")]
    IndexOutOfRange {
        /// The index.
        index: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A group's material does not exist.
    #[error("a group refers to material {material}, but there are {count}")]
    NoSuchMaterial {
        /// The index.
        material: usize,
        /// Number of materials.
        count: usize,
    },
    /// Per-vertex arrays differ in length.
    #[error("{positions} positions, {normals} normals and {uvs} texture coordinates do not match")]
    Lengths {
        /// Number of positions.
        positions: usize,
        /// Number of normals.
        normals: usize,
        /// Number of texture coordinates.
        uvs: usize,
    },
}

/// Metalness and roughness from which a surface shows the room before it rather than itself.
const MIRRORS: (f32, f32) = (0.9, 0.12);
/// Share of a looking-glass's area that lies across one direction; a tap's does not.
const EVEN: f32 = 0.7;

impl Mesh {
    /// Whether a material is a looking-glass: a mirror, and even.
    pub fn is_looking_glass(&self, material: usize) -> bool {
        let mirrors = |m: &Material| m.metallic >= MIRRORS.0 && m.roughness <= MIRRORS.1;
        if !self.materials.get(material).is_some_and(mirrors) {
            return false;
        }
        let triangles = self.groups.iter().filter(|g| g.material == material).flat_map(|g| &g.triangles);
        let corner = |i: u32| self.positions.get(i as usize).copied().unwrap_or_default();
        // Both sides of a sheet lie across one direction.
        let (mut by_axis, mut all) = (Vec3::ZERO, 0.0);
        for [a, b, c] in triangles.map(|t| t.map(corner)) {
            let across = (b - a).cross(c - a);
            by_axis += across.abs();
            all += across.length();
        }
        all > 0.0 && by_axis.max_element() > EVEN * all
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.groups.iter().map(|g| g.triangles.len()).sum()
    }

    /// All triangles, whatever their material.
    pub fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.groups.iter().flat_map(|g| g.triangles.iter().copied())
    }

    /// Bounds of the positions, or `None` without vertices.
    pub fn bounds(&self) -> Option<Bounds> {
        let mut it = self.positions.iter();
        let first = it.next()?.as_dvec3();
        let (min, max) = it.fold((first, first), |(lo, hi), p| (lo.min(p.as_dvec3()), hi.max(p.as_dvec3())));
        Some(Bounds { min, max })
    }

    /// Checks that the mesh can be used.
    ///
    /// # Errors
    /// The first [`MeshError`] found.
    pub fn check(&self) -> Result<(), MeshError> {
        let count = self.positions.len();
        let whole = |n: usize| n == 0 || n == count;
        let optional = whole(self.metric_uvs.len()) && whole(self.colors.len());
        if self.normals.len() != count || self.uvs.len() != count || !optional {
            return Err(MeshError::Lengths { positions: count, normals: self.normals.len(), uvs: self.uvs.len() });
        }
        if self.triangle_count() == 0 {
            return Err(MeshError::Empty);
        }
        if let Some(vertex) = self.positions.iter().position(|p| !p.is_finite()) {
            return Err(MeshError::NotFinite { vertex });
        }
        for group in &self.groups {
            if group.material >= self.materials.len() {
                return Err(MeshError::NoSuchMaterial { material: group.material, count: self.materials.len() });
            }
            if let Some(index) = group.triangles.iter().flatten().find(|i| **i as usize >= count) {
                return Err(MeshError::IndexOutOfRange { index: *index, count });
            }
        }
        Ok(())
    }

    /// Adds another mesh's triangles and materials.
    pub fn append(&mut self, other: &Self) {
        let base = self.positions.len() as u32;
        let materials = self.materials.len();
        if !self.metric_uvs.is_empty() || !other.metric_uvs.is_empty() {
            self.metric_uvs.resize(self.positions.len(), Vec2::ZERO);
            self.metric_uvs.extend_from_slice(&other.metric_uvs);
            self.metric_uvs.resize(self.positions.len() + other.positions.len(), Vec2::ZERO);
        }
        if !self.colors.is_empty() || !other.colors.is_empty() {
            self.colors.resize(self.positions.len(), [1.0; 3]);
            self.colors.extend_from_slice(&other.colors);
            self.colors.resize(self.positions.len() + other.positions.len(), [1.0; 3]);
        }
        self.positions.extend_from_slice(&other.positions);
        self.normals.extend_from_slice(&other.normals);
        self.uvs.extend_from_slice(&other.uvs);
        self.materials.extend(other.materials.iter().cloned());
        self.groups.extend(other.groups.iter().map(|g| Group {
            material: g.material + materials,
            triangles: g.triangles.iter().map(|t| t.map(|i| i + base)).collect(),
        }));
    }

    /// Gives each material the mean of its vertices' [`Mesh::colors`], and drops them.
    pub fn average_colors(&mut self) {
        let colors = std::mem::take(&mut self.colors);
        if colors.len() != self.positions.len() {
            return;
        }
        let mut sums = vec![([0.0_f64; 3], 0_usize); self.materials.len()];
        for group in &self.groups {
            let Some((sum, count)) = sums.get_mut(group.material) else { continue };
            for color in group.triangles.iter().flatten().filter_map(|i| colors.get(*i as usize)) {
                for (s, c) in sum.iter_mut().zip(color) {
                    *s += f64::from(*c);
                }
                *count += 1;
            }
        }
        for (material, (sum, count)) in self.materials.iter_mut().zip(sums).filter(|(_, (_, count))| *count > 0) {
            for (c, s) in material.base_color.iter_mut().zip(sum) {
                *c *= (s / count as f64) as f32;
            }
        }
    }

    /// Cuts triangles at the middle of every edge that is longer than `most` (a length in the mesh's unit after `scale` is
    /// applied to its axes), until none is or `budget` triangles are there: what is known by vertices gets places to be
    /// known at. Neighbours that share the vertices of an edge are cut alike, so that no gap opens.
    pub fn split_long_edges(&mut self, scale: Vec3, most: f32, budget: usize) {
        for _ in 0..8 {
            let long = |p: &[Vec3], a: u32, b: u32| ((p[a as usize] - p[b as usize]) * scale).length() > most;
            let any = self.triangles().any(|[a, b, c]| {
                let p = &self.positions;
                long(p, a, b) || long(p, b, c) || long(p, c, a)
            });
            if !any || self.triangle_count() * 2 > budget {
                return;
            }
            let mut middles = std::collections::BTreeMap::new();
            let mut groups = std::mem::take(&mut self.groups);
            for group in &mut groups {
                let mut out = Vec::with_capacity(group.triangles.len() * 2);
                for [a, b, c] in group.triangles.drain(..) {
                    let mut middle = |i: u32, j: u32| {
                        let cut = long(&self.positions, i, j);
                        cut.then(|| *middles.entry((i.min(j), i.max(j))).or_insert_with(|| self.add_middle(i, j)))
                    };
                    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                    match (ab, bc, ca) {
                        (None, None, None) => out.push([a, b, c]),
                        (Some(m), None, None) => out.extend([[a, m, c], [m, b, c]]),
                        (None, Some(m), None) => out.extend([[a, b, m], [a, m, c]]),
                        (None, None, Some(m)) => out.extend([[a, b, m], [m, b, c]]),
                        (Some(m), Some(n), None) => out.extend([[m, b, n], [a, m, n], [a, n, c]]),
                        (None, Some(m), Some(n)) => out.extend([[m, c, n], [a, b, m], [a, m, n]]),
                        (Some(m), None, Some(n)) => out.extend([[a, m, n], [m, b, c], [m, c, n]]),
                        (Some(m), Some(n), Some(o)) => out.extend([[a, m, o], [m, b, n], [o, n, c], [m, n, o]]),
                    }
                }
                group.triangles = out;
            }
            self.groups = groups;
        }
    }

    fn add_middle(&mut self, i: u32, j: u32) -> u32 {
        let (i, j) = (i as usize, j as usize);
        self.positions.push((self.positions[i] + self.positions[j]) / 2.0);
        self.normals.push((self.normals[i] + self.normals[j]).normalize_or(self.normals[i]));
        self.uvs.push((self.uvs[i] + self.uvs[j]) / 2.0);
        if !self.metric_uvs.is_empty() {
            self.metric_uvs.push((self.metric_uvs[i] + self.metric_uvs[j]) / 2.0);
        }
        if !self.colors.is_empty() {
            let (a, b) = (self.colors[i], self.colors[j]);
            self.colors.push(std::array::from_fn(|k| f32::midpoint(a[k], b[k])));
        }
        (self.positions.len() - 1) as u32
    }

    /// Replaces the normals by area-weighted face normals (smooth over shared vertices).
    pub fn recompute_normals(&mut self) {
        let mut normals = vec![Vec3::ZERO; self.positions.len()];
        for t in self.groups.iter().flat_map(|g| &g.triangles) {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            let n = (b - a).cross(c - a);
            for i in t {
                normals[*i as usize] += n;
            }
        }
        self.normals = normals.into_iter().map(|n| n.normalize_or(Vec3::Y)).collect();
    }

    /// Maps every position by `f` and every normal by the inverse transpose `g` (renormalised).
    pub fn map(&mut self, f: impl Fn(Vec3) -> Vec3, g: impl Fn(Vec3) -> Vec3) {
        for p in &mut self.positions {
            *p = f(*p);
        }
        for n in &mut self.normals {
            *n = g(*n).normalize_or(Vec3::Y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube's side of one metre from two triangles, and one beside it that shares an edge.
    fn sheet() -> Mesh {
        let at = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let positions = vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0), at(2.0, 0.5)];
        Mesh {
            normals: vec![Vec3::Y; 5],
            uvs: positions.iter().map(|p| Vec2::new(p.x, p.z)).collect(),
            positions,
            groups: vec![Group { material: 0, triangles: vec![[0, 2, 1], [0, 3, 2], [1, 2, 4]] }],
            materials: vec![Material::plain("top", [0.5; 3])],
            ..Mesh::default()
        }
    }

    fn area(mesh: &Mesh) -> f32 {
        let side = |t: [u32; 3]| t.map(|i| mesh.positions[i as usize]);
        mesh.triangles().map(side).map(|[a, b, c]| (b - a).cross(c - a).y / 2.0).sum()
    }

    #[test]
    fn long_edges_are_cut_without_gaps_or_folds() {
        let mut mesh = sheet();
        let before = area(&mesh);
        mesh.split_long_edges(Vec3::ONE, 0.3, 10_000);
        mesh.check().unwrap();
        assert!((area(&mesh) - before).abs() < 1e-5, "{} and {before}", area(&mesh));
        let mut sides = std::collections::BTreeMap::new();
        for [a, b, c] in mesh.triangles() {
            for (i, j) in [(a, b), (b, c), (c, a)] {
                assert!(mesh.positions[i as usize].distance(mesh.positions[j as usize]) <= 0.3);
                *sides.entry((i.min(j), i.max(j))).or_insert(0) += 1;
            }
        }
        // Inside every edge has two triangles: those of one triangle lie on the outline of the sheet.
        for ((i, j), _) in sides.iter().filter(|(_, n)| **n == 1) {
            let m = (mesh.positions[*i as usize] + mesh.positions[*j as usize]) / 2.0;
            let slanted = (m.z - 0.5 * (m.x - 1.0)).abs().min((m.z - 1.0 + 0.5 * (m.x - 1.0)).abs());
            assert!(m.x.abs() < 1e-5 || m.z.abs() < 1e-5 || (m.z - 1.0).abs() < 1e-5 || slanted < 1e-5, "{m}");
        }
        for (p, uv) in mesh.positions.iter().zip(&mesh.uvs) {
            assert!((Vec2::new(p.x, p.z) - *uv).length() < 1e-5);
        }
    }

    #[test]
    fn a_budget_ends_the_cutting() {
        let mut mesh = sheet();
        mesh.split_long_edges(Vec3::ONE, 0.001, 40);
        assert!(mesh.triangle_count() <= 80);
    }

    #[test]
    fn colors_become_their_mean() {
        let mut mesh = sheet();
        mesh.colors = vec![[0.5, 1.0, 0.0]; 5];
        mesh.average_colors();
        assert!(mesh.colors.is_empty());
        assert_eq!(mesh.materials[0].base_color, [0.25, 0.5, 0.0, 1.0]);
    }
}
