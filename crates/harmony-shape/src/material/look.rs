//! Slot materials as a mesh's materials.

use harmony_mesh::Material;

use super::bake::{mean_linear, roughness_factor};
use super::color::{bytes_of, hex, kelvin_to_rgb, linear, linear_hex, linear_of, luminance};
use super::space::{Rgb, times};
use super::{MaterialSpec, Pattern, kept};

/// Luminance that is drawn as scene-linear 1, cd/m2.
///
/// A white wall in a well-lit room (about 310 lx) has it. Emission is given in cd/m2 and written relative to it, so that
/// lamps and screens stand to a flat picture of the room (albedo as it is) as they do to a photo of it; whoever lights
/// the scene with an exposure of their own multiplies by that.
pub const WHITE_CD_M2: f64 = 100.0;
/// Largest emission relative to white: what is brighter is white in every picture, and a burden on renderers.
const MAX_EMISSION: f64 = 200.0;

/// The mean sRGB colour of a slot.
pub fn mean_color(spec: &MaterialSpec) -> [u8; 3] {
    bytes_of(mean(spec))
}

fn mean(spec: &MaterialSpec) -> Rgb {
    let slot = linear_hex(&spec.color);
    spec.map.as_ref().map_or(slot, |p| mean_linear(p, slot))
}

fn share(value: f64, default: f64) -> f64 {
    if value.is_finite() { value.clamp(0.0, 1.0) } else { default }
}

/// The mesh material of a slot; a pattern is baked at the texel that its scale asks for.
///
/// `photo` and `paint` of the spec are for those who have the photo: they set `texture` afterwards.
pub fn material(spec: &MaterialSpec) -> Material {
    let tile = spec.map.as_ref().map(|_| kept::tile(spec));
    let color = linear_hex(&spec.color);
    let alpha = share(spec.alpha, 1.0) as f32;
    let [r, g, b] = if tile.is_some() { [1.0; 3] } else { color.map(|c| c as f32) };
    let rough = if tile.is_some() { roughness_factor(spec) } else { share(spec.rough, 0.6) };
    Material {
        name: spec.name.clone(),
        base_color: [r, g, b, alpha],
        texture: None,
        sheen: share(spec.sheen, 0.0) as f32,
        roughness: rough as f32,
        metallic: share(spec.metal, 0.0) as f32,
        ior: if spec.ior.is_finite() { spec.ior.clamp(1.0, 2.5) as f32 } else { 1.45 },
        transmission: share(spec.transmission, 0.0) as f32,
        emissive: emission(spec, color),
        // Thin and open things are seen from both sides.
        double_sided: alpha < 1.0 && spec.transmission <= 0.0,
        hairy: false,
        tile,
    }
}

/// Linear RGB of emission, relative to [`WHITE_CD_M2`], whose luminance is the slot's `emit`.
fn emission(spec: &MaterialSpec, color: Rgb) -> [f32; 3] {
    if !(spec.emit.is_finite() && spec.emit > 0.0) {
        return [0.0; 3];
    }
    let hue = spec.kelvin.map_or(color, kelvin_to_rgb);
    let hue = if luminance(hue) > 1e-4 { times(hue, 1.0 / luminance(hue)) } else { [1.0; 3] };
    let strength = (spec.emit / WHITE_CD_M2).min(MAX_EMISSION);
    hue.map(|c| (c * strength) as f32)
}

/// A slot whose mean colour is another one; pattern colours keep their relation to each other as far as they fit.
pub fn recolored(spec: &MaterialSpec, mean_srgb: [u8; 3]) -> MaterialSpec {
    let wanted = linear_of(mean_srgb);
    let mut out = spec.clone();
    if spec.map.is_none() {
        out.color = hex(mean_srgb);
        return out;
    }
    for _ in 0..6 {
        let now = mean(&out);
        let factor: Rgb = std::array::from_fn(|k| (wanted[k] + 1e-4) / (now[k] + 1e-4));
        if factor.iter().all(|f| (f - 1.0).abs() < 2e-3) {
            break;
        }
        out.color = scaled(&out.color, factor);
        if let Some(p) = &mut out.map {
            scale(p, factor);
        }
    }
    out
}

fn scaled(color: &str, factor: Rgb) -> String {
    let c = linear_hex(color);
    // A channel of zero can only be raised by adding.
    hex(bytes_of(std::array::from_fn(|k| {
        if factor[k] > 1.0 { (c[k] + linear(0.5 / 255.0)) * factor[k] } else { c[k] * factor[k] }
    })))
}

fn scale(p: &mut Pattern, factor: Rgb) {
    for c in &mut p.colors {
        *c = scaled(c, factor);
    }
    for layer in &mut p.layers {
        scale(layer, factor);
    }
}
