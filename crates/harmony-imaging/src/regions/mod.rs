//! Finds object-like regions without any model: what differs from the colours of floor, walls and ceiling.

use glam::DVec2;
use harmony_scene::{Camera, Extents, Mask, PixelBox, Surface};
use image::RgbImage;
use rayon::prelude::*;

/// Label of a pixel that shows no known surface.
pub const UNKNOWN_SURFACE: u8 = 255;

/// The label of a room face in a surface label map: its place in [`Surface::ALL`].
pub fn surface_id(surface: Surface) -> u8 {
    match surface {
        Surface::Floor => 0,
        Surface::Ceiling => 1,
        Surface::Back => 2,
        Surface::Left => 3,
        Surface::Right => 4,
        Surface::Front => 5,
    }
}

/// Which room face each pixel's ray leaves the box through, row-major, as [`surface_id`].
///
/// All [`UNKNOWN_SURFACE`] when the camera is outside the box.
pub fn surface_labels(camera: &Camera, extents: &Extents) -> Vec<u8> {
    if !extents.contains(camera.centre(), 1e-6) {
        return vec![UNKNOWN_SURFACE; camera.size.pixels()];
    }
    let width = camera.size.width.max(1) as usize;
    (0..camera.size.pixels())
        .into_par_iter()
        .map(|i| {
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            extents.exit(&camera.ray(pixel)).map_or(UNKNOWN_SURFACE, |(surface, _)| surface_id(surface))
        })
        .collect()
}

/// Parameters of the search.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionSettings {
    /// Longest side of the image that is analysed, pixels.
    pub working_px: u32,
    /// Most regions returned.
    pub max_regions: usize,
    /// Smallest region, as a fraction of the image.
    pub min_area: f64,
}

impl Default for RegionSettings {
    fn default() -> Self {
        Self { working_px: 400, max_regions: 24, min_area: 0.002 }
    }
}

/// A candidate object region.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Full-frame mask.
    pub mask: Mask,
    /// Tight box of the mask.
    pub bounds: PixelBox,
    /// Share of the image.
    pub area: f64,
    /// Mean colour, sRGB.
    pub color: [u8; 3],
    /// Share of the region before floor, ceiling and the walls (all four together); what is missing to 1 is unknown.
    pub on_floor: f64,
    /// See `on_floor`.
    pub on_ceiling: f64,
    /// See `on_floor`.
    pub on_walls: f64,
    /// The face that most of the region is seen against; `None` when that is unknown.
    pub surface: Option<Surface>,
    /// The region crosses or touches the boundary of floor and wall.
    pub touches_floor_boundary: bool,
    /// Image borders touched: left, top, right, bottom.
    pub touches_border: [bool; 4],
    /// How much it looks like a thing, 0 to 1: contrast to its surface, compactness, size, edge strength around it.
    pub objectness: f64,
}

/// Proposes regions, best first. `surfaces` has one label a pixel ([`surface_id`]); another length counts as unknown.
pub fn propose_regions(photo: &RgbImage, surfaces: &[u8], settings: &RegionSettings) -> Vec<Region> {
    let _ = (photo, surfaces, settings);
    Vec::new()
}
