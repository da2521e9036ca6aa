//! What is known beforehand about categories of things in rooms.

mod table;

use harmony_scene::{Level, MaterialCategory, Size};

pub use table::CATEGORIES;

/// What a back has that a front has not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Back {
    /// It is higher: seats, beds.
    High,
    /// It is closed, where the front may be open: storage.
    Closed,
}

/// What a category usually is like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Category {
    /// Name, also the template's.
    pub name: &'static str,
    /// Where it is found.
    pub level: Level,
    /// Usual width, height, depth, metres.
    pub size: [f64; 3],
    /// Smallest plausible width, height, depth, metres.
    pub min: [f64; 3],
    /// Largest plausible width, height, depth, metres.
    pub max: [f64; 3],
    /// Dominant material.
    pub material: MaterialCategory,
    /// Whether one side is the front.
    pub front: bool,
    /// What its back has that its front has not.
    pub back: Option<Back>,
    /// Whether it is a thin slab that can carry a rectified image.
    pub planar: bool,
    /// For light sources the slot that shines.
    pub light: Option<&'static str>,
    /// Whether other things stand on it.
    pub supports: bool,
    /// Words and phrases that mean it.
    pub synonyms: &'static [&'static str],
}

/// The category of a label, by its name or a synonym.
pub fn category(label: &str) -> Option<&'static Category> {
    let name = crate::template_name(label)?;
    CATEGORIES.iter().find(|c| c.name == name)
}

/// Usual size of a category, metres; half a metre each way when unknown.
pub fn default_size(label: &str) -> Size {
    let s = category(label).map_or([0.5; 3], |c| c.size);
    Size { width: s[0], height: s[1], depth: s[2] }
}

/// Smallest and largest plausible size of a category, metres.
pub fn size_range(label: &str) -> (Size, Size) {
    let (a, b) = category(label).map_or(([0.02; 3], [4.0; 3]), |c| (c.min, c.max));
    (Size { width: a[0], height: a[1], depth: a[2] }, Size { width: b[0], height: b[1], depth: b[2] })
}

/// Dominant material of a category.
pub fn default_material(label: &str) -> MaterialCategory {
    category(label).map_or(MaterialCategory::Other, |c| c.material)
}

/// Whether one side is the front; unknown things have one.
pub fn has_front(label: &str) -> bool {
    category(label).is_none_or(|c| c.front)
}

/// What the back of a label's category has that its front has not.
pub fn back(label: &str) -> Option<Back> {
    category(label).and_then(|c| c.back)
}

/// Whether it is a thin slab that can carry a rectified image.
pub fn is_planar(label: &str) -> bool {
    category(label).is_some_and(|c| c.planar)
}

/// Level at which the category is usually found.
pub fn level(label: &str) -> Option<Level> {
    category(label).map(|c| c.level)
}

/// Slot that shines, for light sources.
pub fn light_slot(label: &str) -> Option<&'static str> {
    category(label).and_then(|c| c.light)
}

/// Whether other things stand on it.
pub fn supports_objects(label: &str) -> bool {
    category(label).is_some_and(|c| c.supports)
}
