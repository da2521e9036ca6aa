//! What can be switched and tuned.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Switches (one per ablation row of the paper's table) and limits of placement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[expect(clippy::struct_excessive_bools, reason = "each is one ablation row")]
pub struct PlacementSettings {
    /// Depth-first traversal from the anchor corner; off: breadth by distance alone.
    pub depth_first: bool,
    /// Reasoned placement order; off: the order in which the items are given.
    pub placement_order: bool,
    /// Relations (walls, facing, support) steer the first pose; off: mask and size alone ("w/o VLM placement reasoning").
    pub relations: bool,
    /// Silhouette and depth refinement; off: the first pose stands ("w/o placement refinement").
    pub refinement: bool,
    /// Depth step on the point map; off: floor contact only ("w/o VGGT refinement").
    pub point_map: bool,
    /// The local optimiser after the paper's steps.
    pub optimiser: bool,
    /// A second look at every object when its level is complete.
    pub second_look: bool,
    /// Collision resolution.
    pub collision: bool,
    /// Group refinement (sizes, facing, swaps, copies).
    pub groups: bool,
    /// Refinement of all poses, camera, room and scale together after each level.
    pub global_refinement: bool,
    /// Rounds of silhouette and depth step, at most.
    pub max_rounds: usize,
    /// Renders the optimiser may spend on one object.
    pub renders_per_object: usize,
    /// Longest side of the window an object is compared in, pixels.
    pub window_px: u32,
    /// Gap left between a wall and what is flush with it, metres.
    pub wall_gap: f64,
    /// Relative uncertainty (one sigma) of the sizes given by the VLM.
    pub size_sigma: f64,
    /// Penetration that is still called contact, metres.
    pub collision_tolerance: f64,
}

impl Default for PlacementSettings {
    fn default() -> Self {
        Self {
            depth_first: true,
            placement_order: true,
            relations: true,
            refinement: true,
            point_map: true,
            optimiser: true,
            second_look: true,
            collision: true,
            groups: true,
            global_refinement: true,
            max_rounds: 5,
            renders_per_object: 160,
            window_px: 128,
            wall_gap: 0.003,
            size_sigma: 0.2,
            collision_tolerance: 0.002,
        }
    }
}
