//! Slot materials without their patterns.

use harmony_mesh::{Material, linear_rgb, parse_color};

use crate::material::MaterialSpec;

/// Luminance drawn as 1, cd/m2.
const WHITE: f64 = 100.0;

/// A slot's material by its numbers alone: name, colour, roughness, metalness, transmission, emission, sheen; no pattern.
pub fn plain_material(spec: &MaterialSpec) -> Material {
    let rgb = linear_rgb(parse_color(&spec.color).unwrap_or([150, 145, 138]));
    let glow = (spec.emit.max(0.0) / WHITE) as f32;
    Material {
        base_color: [rgb[0], rgb[1], rgb[2], spec.alpha.clamp(0.0, 1.0) as f32],
        roughness: spec.rough.clamp(0.0, 1.0) as f32,
        metallic: spec.metal.clamp(0.0, 1.0) as f32,
        ior: spec.ior.clamp(1.0, 2.5) as f32,
        transmission: spec.transmission.clamp(0.0, 1.0) as f32,
        sheen: spec.sheen.clamp(0.0, 1.0) as f32,
        emissive: rgb.map(|c| c * glow),
        ..Material::plain(&spec.name, [0.0; 3])
    }
}
