//! Fewer triangles and smaller textures, for all formats alike.
//!
//! Triangles are taken away by edge collapses (meshoptimizer), each mesh in its share; textures are halved by area.
//! Bounds of an object may shrink by the error of the simplification; [`crate::check()`] knows the scene as it was reduced.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;
use harmony_mesh::{Mesh, Tile};
use image::RgbaImage;
use image::imageops::FilterType;
use meshopt::{SimplifyOptions, VertexDataAdapter};
use rayon::prelude::*;

use crate::World;
use crate::world::Face;

/// A mesh keeps so many triangles, however small its share.
const FEWEST: usize = 64;
/// Farthest that collapses may move a surface, share of the mesh's extent, before the shape is given up for the count.
const MAX_ERROR: f32 = 0.02;

/// What a scene may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Budget {
    /// Triangles of the whole scene.
    pub faces: Option<usize>,
    /// Longest side of a texture, pixels.
    pub texture: Option<u32>,
}

impl World {
    /// The same scene within a budget.
    #[must_use]
    pub fn within(&self, budget: &Budget) -> Self {
        if *budget == Budget::default() {
            return self.clone();
        }
        let share = budget.faces.map_or(1.0, |faces| faces as f64 / self.triangles().max(1) as f64);
        let mut meshes: BTreeMap<usize, &Arc<Mesh>> = BTreeMap::new();
        for mesh in self.shell.iter().map(|f| &f.mesh).chain(self.items.iter().map(|i| &i.mesh)) {
            meshes.insert(Arc::as_ptr(mesh) as usize, mesh);
        }
        let mut images: BTreeMap<usize, Arc<RgbaImage>> = BTreeMap::new();
        if let Some(longest) = budget.texture {
            let all: BTreeMap<usize, &Arc<RgbaImage>> = meshes
                .values()
                .flat_map(|m| &m.materials)
                .flat_map(|m| m.texture.iter().chain(m.tile.iter().map(|t| &t.color)))
                .map(|t| (Arc::as_ptr(t) as usize, t))
                .collect();
            images = all.into_par_iter().map(|(k, t)| (k, Arc::new(shrunk(t, longest)))).collect();
        }
        let made: BTreeMap<usize, Arc<Mesh>> = meshes
            .into_par_iter()
            .map(|(key, mesh)| {
                let mut mesh = reduced(mesh, share);
                for m in &mut mesh.materials {
                    if let Some(t) = &mut m.texture {
                        *t = images.get(&(Arc::as_ptr(t) as usize)).map_or_else(|| Arc::clone(t), Arc::clone);
                    }
                    if let Some(tile) = &mut m.tile {
                        let color = images.get(&(Arc::as_ptr(&tile.color) as usize));
                        let longest = budget.texture.unwrap_or(u32::MAX);
                        let small = |image: &Arc<image::RgbImage>| {
                            let rgba = image::DynamicImage::ImageRgb8((**image).clone()).into_rgba8();
                            Arc::new(image::DynamicImage::ImageRgba8(shrunk(&rgba, longest)).into_rgb8())
                        };
                        *tile = Arc::new(Tile {
                            color: color.map_or_else(|| Arc::clone(&tile.color), Arc::clone),
                            normal: tile.normal.as_ref().map(small),
                            surface: tile.surface.as_ref().map(small),
                            ..(**tile).clone()
                        });
                    }
                }
                (key, Arc::new(mesh))
            })
            .collect();
        let of =
            |mesh: &Arc<Mesh>| made.get(&(Arc::as_ptr(mesh) as usize)).map_or_else(|| Arc::clone(mesh), Arc::clone);
        let shell = self.shell.iter().map(|f| Face { name: f.name.clone(), mesh: of(&f.mesh) }).collect();
        let items = self.items.iter().map(|i| i.with(i.object.clone(), of(&i.mesh))).collect();
        Self::new(self.scene.clone(), shell, items, self.notes.clone())
    }
}

fn shrunk(image: &RgbaImage, longest: u32) -> RgbaImage {
    let (w, h) = image.dimensions();
    let most = w.max(h);
    if most <= longest.max(1) || most == 0 {
        return image.clone();
    }
    let k = f64::from(longest.max(1)) / f64::from(most);
    let side = |s: u32| ((f64::from(s) * k).round() as u32).max(1);
    image::imageops::resize(image, side(w), side(h), FilterType::Triangle)
}

/// A mesh with about a share of its triangles, vertices that are no longer used left out.
pub(crate) fn reduced(mesh: &Mesh, share: f64) -> Mesh {
    let count = mesh.triangle_count();
    let mut out = mesh.clone();
    if share >= 1.0 || count <= FEWEST {
        return out;
    }
    let share = share.max(FEWEST as f64 / count as f64);
    let bytes = meshopt::typed_to_bytes(&mesh.positions);
    let Ok(vertices) = VertexDataAdapter::new(bytes, size_of::<Vec3>(), 0) else { return out };
    for group in &mut out.groups {
        let indices: Vec<u32> = group.triangles.iter().flatten().copied().collect();
        let target = ((group.triangles.len() as f64 * share).ceil() as usize).max(2) * 3;
        if indices.len() <= target {
            continue;
        }
        let mut fewer = meshopt::simplify(&indices, &vertices, target, MAX_ERROR, SimplifyOptions::empty(), None);
        if fewer.len() as f64 > 1.3 * target as f64 {
            let sloppy = meshopt::simplify_sloppy(&fewer, &vertices, target, 0.1, None);
            if !sloppy.is_empty() {
                fewer = sloppy;
            }
        }
        if !fewer.is_empty() {
            group.triangles = fewer.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        }
    }
    compacted(&out)
}

/// A mesh without the vertices that no triangle uses, and without empty groups.
pub(crate) fn compacted(mesh: &Mesh) -> Mesh {
    let mut place = vec![u32::MAX; mesh.positions.len()];
    let mut kept: Vec<usize> = Vec::new();
    let mut groups = mesh.groups.clone();
    groups.retain(|g| !g.triangles.is_empty());
    for i in groups.iter_mut().flat_map(|g| &mut g.triangles).flatten() {
        let slot = &mut place[*i as usize];
        if *slot == u32::MAX {
            *slot = kept.len() as u32;
            kept.push(*i as usize);
        }
        *i = *slot;
    }
    Mesh {
        positions: kept.iter().map(|i| mesh.positions[*i]).collect(),
        normals: kept.iter().map(|i| mesh.normals[*i]).collect(),
        uvs: kept.iter().map(|i| mesh.uvs[*i]).collect(),
        metric_uvs: if mesh.metric_uvs.is_empty() {
            Vec::new()
        } else {
            kept.iter().map(|i| mesh.metric_uvs[*i]).collect()
        },
        colors: if mesh.colors.is_empty() { Vec::new() } else { kept.iter().map(|i| mesh.colors[*i]).collect() },
        groups,
        materials: mesh.materials.clone(),
    }
}
