//! Surface materials of objects (paper App. C, "Material estimation").

use harmony_catalogue::Trait;
use harmony_scene::{MaterialCategory, ObjectId, PbrFactors, Physical, Size, SurfaceMaterial};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::delta::bounds::shortened;

/// The paper's material answer, field by field; null = the category's default.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct MaterialAnswer {
    /// One of the fixed set; null = unknown.
    pub material_category: Option<MaterialCategory>,
    /// 0 mirror to 1 matt.
    pub roughness: Option<f64>,
    /// 0 dielectric to 1 metal.
    pub metallic: Option<f64>,
    /// Index of refraction.
    pub ior: Option<f64>,
    /// 0 opaque to 1 clear.
    pub transmission: Option<f64>,
    /// Mass, kilograms.
    pub weight_kg: Option<f64>,
    /// Typical wall thickness, metres.
    pub thickness_m: Option<f64>,
    /// 0 rigid to 1 springy.
    pub elasticity: Option<f64>,
}

/// An answered weight may differ from the default by this factor, either way.
pub const WEIGHT_FACTOR: f64 = 8.0;
/// Mass of anything, kilograms.
pub const WEIGHT_KG: [f64; 2] = [0.01, 500.0];

/// Wall thickness, metres, never more than half of the object's smallest side.
fn default_thickness(label: &str, category: MaterialCategory, size: Size) -> f64 {
    let typical = harmony_catalogue::wall_thickness(label, category);
    let thinnest = size.as_vec().min_element();
    if thinnest.is_finite() && thinnest > 0.0 { f64::min(typical, thinnest / 2.0).max(0.0002) } else { typical }
}

/// Weight by the kind's and the material's mass over the bounding box, kilograms.
fn default_weight(label: &str, category: MaterialCategory, size: Size) -> f64 {
    let volume = size.as_vec().max(glam::DVec3::splat(0.002)).element_product();
    let weight = harmony_catalogue::box_density(label, category) * volume;
    if weight.is_finite() { weight.clamp(WEIGHT_KG[0], WEIGHT_KG[1]) } else { 1.0 }
}

/// The material of an object: the answer where it is sensible, the defaults of its kind and material elsewhere.
///
/// Returns what was left out of range, in words.
pub fn material_for(label: &str, size: Size, answer: Option<&MaterialAnswer>) -> (SurfaceMaterial, Vec<String>) {
    let empty = MaterialAnswer::default();
    let answer = answer.unwrap_or(&empty);
    let category = answer.material_category.unwrap_or_else(|| harmony_catalogue::material_category(label));
    let d = category.defaults();
    let mut notes = Vec::new();
    let given = PbrFactors {
        roughness: answer.roughness.unwrap_or(d.roughness),
        metallic: answer.metallic.unwrap_or(d.metallic),
        ior: answer.ior.unwrap_or(d.ior),
        // A window or a glass table is clear, but a generated texture on "glass" is what the photo shows behind it:
        // without an answer a window stays opaque, since its picture stands for the view.
        transmission: answer.transmission.unwrap_or(if harmony_catalogue::has(label, Trait::Pictured) {
            0.0
        } else {
            d.transmission
        }),
    };
    let pbr = category.clamp(given);
    let said = shortened(label);
    for (name, was, is) in [
        ("roughness", given.roughness, pbr.roughness),
        ("metallic", given.metallic, pbr.metallic),
        ("IOR", given.ior, pbr.ior),
        ("transmission", given.transmission, pbr.transmission),
    ] {
        if was != is {
            notes.push(format!("{said}: {name} {was} brought to {is} for {category:?}"));
        }
    }
    let mut keep = |name: &str, given: Option<f64>, default: f64, low: f64, high: f64| {
        let Some(value) = given else { return default };
        let kept = if value.is_finite() { value.clamp(low, high) } else { default };
        if kept != value {
            notes.push(format!("{said}: {name} {value} brought to {kept}"));
        }
        kept
    };
    let weight = default_weight(label, category, size);
    let low = (weight / WEIGHT_FACTOR).max(WEIGHT_KG[0]);
    let high = (weight * WEIGHT_FACTOR).min(WEIGHT_KG[1]);
    let thickness = default_thickness(label, category, size);
    let physical = Physical {
        weight_kg: keep("weight in kg", answer.weight_kg, weight, low, high),
        thickness_m: keep("thickness in m", answer.thickness_m, thickness, 0.0002, 0.5),
        elasticity: keep("elasticity", answer.elasticity, harmony_catalogue::material(category).elasticity, 0.0, 1.0),
        rigid: None,
    };
    (SurfaceMaterial { category, pbr, physical }, notes)
}

/// The sidecar for downstream physics, one object a file (`<id>.physics.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PhysicsSidecar {
    /// The object.
    pub object: ObjectId,
    /// Its label.
    pub label: String,
    /// Category.
    pub material_category: MaterialCategory,
    /// Size before rotation, metres.
    pub size: Size,
    /// Mass, thickness, elasticity.
    #[serde(flatten)]
    pub physical: Physical,
}

impl PhysicsSidecar {
    /// The sidecar of an object's material.
    pub fn new(object: ObjectId, label: &str, size: Size, material: &SurfaceMaterial) -> Self {
        Self {
            object,
            label: label.to_owned(),
            material_category: material.category,
            size,
            physical: material.physical,
        }
    }

    /// Its text, ready to be written.
    ///
    /// # Errors
    /// Never for finite values; `serde_json`'s otherwise.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHAIR: Size = Size { width: 0.5, height: 0.9, depth: 0.5 };

    #[test]
    fn what_shows_the_view_stays_opaque_without_an_answer() {
        let transmission = |label| material_for(label, CHAIR, None).0.pbr.transmission;
        assert_eq!([transmission("window"), transmission("glass door"), transmission("wall mirror")], [0.0; 3]);
        assert!(transmission("glass coffee table") > 0.5);
    }

    #[test]
    fn an_absurd_answer_is_brought_into_range_and_said() {
        let answer: MaterialAnswer = serde_json::from_str(
            r#"{"material_category": "wood", "roughness": -3, "metallic": 1.0, "ior": null, "transmission": 0.8,
                "weight_kg": 90000, "thickness_m": 0.02, "elasticity": 7}"#,
        )
        .unwrap();
        let (material, notes) = material_for("chair", CHAIR, Some(&answer));
        assert_eq!(material.category, MaterialCategory::Wood);
        assert_eq!(material.pbr.roughness, 0.02);
        assert_eq!(material.pbr.metallic, 0.3);
        assert_eq!(material.pbr.transmission, 0.0);
        assert_eq!(material.pbr.ior, 1.5);
        assert!(material.physical.weight_kg <= 300.0);
        assert_eq!(material.physical.elasticity, 1.0);
        assert_eq!(notes.len(), 5, "{notes:?}");
    }

    #[test]
    fn without_an_answer_the_weight_follows_the_size() {
        let (chair, notes) = material_for("chair", CHAIR, None);
        assert!(notes.is_empty());
        assert!((4.0..10.0).contains(&chair.physical.weight_kg), "{chair:?}");
        let flat = Size { width: 2.0, height: 0.0, depth: f64::NAN };
        let (odd, _) = material_for("rug", flat, None);
        assert!(odd.physical.weight_kg > 0.0 && odd.physical.weight_kg.is_finite());
    }

    #[test]
    fn a_sidecar_reads_back() {
        let (material, _) = material_for("chair", CHAIR, None);
        let sidecar = PhysicsSidecar::new(ObjectId::numbered("chair", 1), "chair", CHAIR, &material);
        let back: PhysicsSidecar = serde_json::from_str(&sidecar.to_json().unwrap()).unwrap();
        assert_eq!(back, sidecar);
    }
}
