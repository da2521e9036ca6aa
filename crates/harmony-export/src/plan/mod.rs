//! Drawings: a measured floor plan, wall elevations, and the list of furniture.
//!
//! SVG pages of A3 at a round scale, the same drawings as DXF in metres with layers, and a CSV list. Outlines are the true
//! silhouettes of the meshes with hidden lines removed, not boxes.
//!
//! # What is assumed
//! Walls have no thickness in a scene: they are drawn with 120 mm. Walls that the photo does not show are dashed. A door is
//! hinged across from its handle, where its mesh has one, else on the left seen from inside. All of this is said on the sheet.

mod drawing;
mod dxf;
mod elevation;
mod floor;
mod labels;
mod outline;
mod page;
mod schedule;
mod svg;

use crate::World;
use crate::files::Files;

pub(crate) use floor::WALL_M;
pub use schedule::{Row, csv, rows};

/// Floor plan, elevations and list.
pub(crate) fn write(world: &World) -> Files {
    let rows = rows(world);
    let (plan, walls) = rayon::join(|| floor::plan(world, &rows), || elevation::elevations(world, &rows));
    let mut files = Files::default();
    files.text("plan/floor_plan.svg", svg::svg(&plan));
    files.text("plan/floor_plan.dxf", dxf::dxf(&plan));
    files.text("plan/elevations.svg", svg::svg(&walls));
    files.text("plan/elevations.dxf", dxf::dxf(&walls));
    files.text("plan/furniture.csv", csv(world, &rows));
    files
}
