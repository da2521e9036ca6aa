//! Triangle meshes: the canonical object meshes, ray casting, convex parts, and part models.
//!
//! Canonical mesh frame (`docs/conventions.md`): +Y up, front faces +Z, bottom at `y = 0`, centred in x and z.

mod bvh;
mod mesh;
mod shell;

pub use bvh::{Bvh, Hit};
pub use mesh::{Bounds, Group, Material, Mesh, MeshError};
pub use shell::{ShellOptions, room_shell, room_shell_with, shell_material_name};
