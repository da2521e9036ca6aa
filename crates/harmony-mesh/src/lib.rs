//! Triangle meshes: the canonical object meshes, ray casting, convex parts, and part models.
//!
//! Canonical mesh frame (`docs/conventions.md`): +Y up, front faces +Z, bottom at `y = 0`, centred in x and z.

mod bvh;
mod clean;
mod connected;
mod convex;
mod front;
mod mesh;
mod part_model;
mod quickhull;
mod rest;
mod shell;
mod templates;
mod top;
mod upright;

pub use bvh::{Bvh, Hit, closest_on_triangle};
pub use clean::{CleanReport, canonicalise, clean, simple_form};
pub use connected::connected;
pub use convex::{ConvexPart, MAX_HULL_POINTS, convex_parts, hull_points};
pub use front::{broad_sides, front_by_form, front_by_size};
pub use mesh::{Bounds, Group, Material, Mesh, MeshError, Tile};
pub use part_model::{
    Axis, BuiltModel, ChartPlace, LeafHabit, MAX_PARTS, Mirror, PART_MODEL_GUIDE, Part, PartModel, PartModelError,
    Repeat, Repeats, Shape, Slot, TextureMode, hex_color, linear_rgb, pack_charts, parse_color,
};
pub use quickhull::quickhull;
pub use rest::{Stand, stand};
pub use shell::{
    ShellOptions, TRIMS, Trim, Trims, cove_name, is_cove_name, is_left_out, room_shell, room_shell_with,
    shell_material_name,
};
pub use templates::{
    ArmStyle, BackStyle, LegStyle, PlantHabit, ShadeShape, SlotColor, TemplateParams, template, template_name,
};
pub use top::level_top;
pub use upright::{Upright, upright};
