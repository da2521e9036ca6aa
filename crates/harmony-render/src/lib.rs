//! The renderer of the loop: a deterministic CPU rasteriser that draws colour, depth and object id in one pass
//! (key `render.flat`).
//!
//! ```
//! use harmony_mesh::{Group, Material, Mesh};
//! use harmony_render::{Instance, RenderOptions, Renderer};
//! use harmony_scene::{Camera, ImageSize, Intrinsics, Vec3};
//!
//! let mut mesh = Mesh {
//!     positions: vec![[-1.0, 0.0, 0.0].into(), [1.0, 0.0, 0.0].into(), [0.0, 2.0, 0.0].into()],
//!     uvs: vec![glam::Vec2::ZERO; 3],
//!     groups: vec![Group { material: 0, triangles: vec![[0, 1, 2]] }],
//!     materials: vec![Material::plain("paint", [0.5, 0.2, 0.1])],
//!     ..Mesh::default()
//! };
//! mesh.recompute_normals();
//! let size = ImageSize::new(64, 48);
//! let lens = Intrinsics::from_horizontal_fov(size, 1.0);
//! let camera = Camera::looking(size, lens, Vec3::new(0.0, 1.0, 4.0), Vec3::NEG_Z);
//! let frame = Renderer::new().render(&camera, &[Instance::in_room(&mesh, 7)], &RenderOptions::default());
//! assert_eq!(frame.ids[24 * 64 + 32], 7);
//! assert!((frame.depth[24 * 64 + 32] - 4.0).abs() < 1e-5);
//! ```

mod assemble;
mod bake;
mod cameras;
mod frame;
mod glass;
mod mips;
mod prepare;
mod raster;
mod renderer;
mod resolve;
mod shade;
mod shading;
mod srgb;

pub use bake::{BakeOptions, BakedMesh, SlotColour, bake_texture};
pub use cameras::{OUTSIDE, RoomView, canonical_camera, mesh_view_camera, orbit_cameras};
pub use frame::{DepthFrame, Frame, Glass, Instance, Lighting, RenderOptions, Window, WindowFrame};
pub use glass::{SOLID, opacity};
pub use renderer::{Renderer, projected_window, render, render_depth_ids, render_window};
pub use shading::{LightLaw, Shaded, Stands, shade};
