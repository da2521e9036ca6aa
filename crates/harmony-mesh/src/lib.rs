//! Triangle meshes: the canonical object meshes, ray casting, convex parts, and part models.
//!
//! Canonical mesh frame (`docs/conventions.md`): +Y up, front faces +Z, bottom at `y = 0`, centred in x and z.

mod mesh;

pub use mesh::{Bounds, Group, Material, Mesh, MeshError};
