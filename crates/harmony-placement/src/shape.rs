//! Canonical geometry of an object, prepared for many renders and distance queries.

use std::sync::{Arc, OnceLock};

use harmony_mesh::{Bounds, Bvh, ConvexPart, Mesh};
use harmony_scene::Vec3;

use crate::proxy::Proxy;

/// A canonical mesh with what placement derives from it once.
#[derive(Debug, Clone)]
pub struct Shape {
    mesh: Arc<Mesh>,
    proxy: Arc<Proxy>,
    hulls: Vec<Vec<Vec3>>,
    bounds: Bounds,
    bvh: OnceLock<Arc<Bvh>>,
}

impl Shape {
    /// Prepares a canonical mesh (bottom at y = 0, centred, front +Z) and its convex parts (hull points in the
    /// same frame). Without usable parts the mesh's box stands in.
    pub fn new(mesh: Arc<Mesh>, hulls: Vec<Vec<Vec3>>) -> Self {
        let form = harmony_mesh::simple_form(&mesh);
        Self::with_form(mesh, &form, hulls)
    }

    fn with_form(mesh: Arc<Mesh>, form: &Mesh, hulls: Vec<Vec<Vec3>>) -> Self {
        let unit = Bounds { min: Vec3::new(-0.5, 0.0, -0.5), max: Vec3::new(0.5, 1.0, 0.5) };
        let bounds = mesh.bounds().filter(|b| b.min.is_finite() && b.max.is_finite()).unwrap_or(unit);
        let mut hulls: Vec<Vec<Vec3>> =
            hulls.into_iter().filter(|h| h.len() >= 4 && h.iter().all(|p| p.is_finite())).collect();
        if hulls.is_empty() {
            hulls.push(corners(&bounds).to_vec());
        }
        let proxy = Arc::new(Proxy::new(form));
        Self { mesh, proxy, hulls, bounds, bvh: OnceLock::new() }
    }

    /// The same with convex parts from elsewhere, or those of [`harmony_mesh::convex_parts`].
    pub fn from_parts(mesh: Arc<Mesh>, parts: Option<&[ConvexPart]>) -> Self {
        let form = harmony_mesh::simple_form(&mesh);
        let made = if parts.is_none() { harmony_mesh::convex_parts(&form) } else { Vec::new() };
        let hulls = parts.unwrap_or(&made).iter().map(|p| p.points.iter().map(|q| q.as_dvec3()).collect());
        Self::with_form(mesh, &form, hulls.collect())
    }

    /// The mesh.
    pub fn mesh(&self) -> &Arc<Mesh> {
        &self.mesh
    }

    /// What silhouettes are drawn from.
    pub(crate) fn proxy(&self) -> &Proxy {
        &self.proxy
    }

    /// Hull points of the convex parts, canonical frame.
    pub fn hulls(&self) -> &[Vec<Vec3>] {
        &self.hulls
    }

    /// Bounds in canonical units.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Width, height and depth in canonical units, none of them zero.
    pub fn extent(&self) -> Vec3 {
        self.bounds.size().max(Vec3::splat(1e-6))
    }

    /// Ray queries on the mesh, canonical frame; built at the first call.
    pub fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Arc::new(Bvh::new(&self.mesh)))
    }
}

/// The eight corners of a box.
pub(crate) fn corners(b: &Bounds) -> [Vec3; 8] {
    std::array::from_fn(|i| {
        Vec3::new(
            if i & 1 == 0 { b.min.x } else { b.max.x },
            if i & 2 == 0 { b.min.y } else { b.max.y },
            if i & 4 == 0 { b.min.z } else { b.max.z },
        )
    })
}
