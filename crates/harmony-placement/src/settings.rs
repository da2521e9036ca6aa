//! What can be switched and tuned.
//!
//! Switches are the rows of the paper's ablation and of ours, limits bound the work; everything that says how far off
//! something can be is in [`Noise`]. The defaults are the program; a run's record holds the values that it had.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::noise::Noise;

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
    /// Collision resolution.
    pub collision: bool,
    /// Members of a matched set have one size.
    pub groups: bool,
    /// Refinement of all poses, camera, room and scale together after each level.
    pub global_refinement: bool,
    /// Rounds of silhouette and depth step, at most.
    pub max_rounds: usize,
    /// Renders the optimiser may spend on one object.
    pub renders_per_object: usize,
    /// Longest side of the window an object is compared in, pixels.
    pub window_px: u32,
    /// Every sigma and every probability that an answer is right.
    pub noise: Noise,
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
            collision: true,
            groups: true,
            global_refinement: true,
            max_rounds: 5,
            renders_per_object: 160,
            window_px: 128,
            noise: Noise::default(),
        }
    }
}
