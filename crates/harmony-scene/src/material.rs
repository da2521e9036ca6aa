//! PBR factors and physical properties (paper App. C, "Material estimation").

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The paper's fixed set of surface materials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum MaterialCategory {
    Fabric,
    Leather,
    Wood,
    Metal,
    Glass,
    Plastic,
    Ceramic,
    Stone,
    Rattan,
    Foam,
    Paper,
    Other,
}

/// Factors written into the GLB's material.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PbrFactors {
    /// Perceptual roughness, 0 to 1.
    pub roughness: f64,
    /// 0 dielectric to 1 metal.
    pub metallic: f64,
    /// Index of refraction, 1 to 3.
    pub ior: f64,
    /// 0 opaque to 1 clear.
    pub transmission: f64,
}

/// Properties for physics, written to a sidecar.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Physical {
    /// Mass, kilograms.
    pub weight_kg: f64,
    /// Typical wall thickness, metres.
    pub thickness_m: f64,
    /// 0 rigid to 1 springy.
    pub elasticity: f64,
    /// Mass and friction as estimated for a rigid-body simulation, where somebody was asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rigid: Option<RigidEstimate>,
}

/// What was answered for a rigid-body simulation (paper, "Physical Simulations").
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RigidEstimate {
    /// Mass, kilograms.
    pub mass_kg: f64,
    /// Coefficient of friction against a wood floor.
    pub friction: f64,
}

/// An object's dominant material.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SurfaceMaterial {
    /// Category.
    pub category: MaterialCategory,
    /// Rendering factors.
    pub pbr: PbrFactors,
    /// Physical properties.
    pub physical: Physical,
}

impl MaterialCategory {
    /// All categories, in the paper's order.
    pub const ALL: [Self; 12] = [
        Self::Fabric,
        Self::Leather,
        Self::Wood,
        Self::Metal,
        Self::Glass,
        Self::Plastic,
        Self::Ceramic,
        Self::Stone,
        Self::Rattan,
        Self::Foam,
        Self::Paper,
        Self::Other,
    ];

    /// Default factors: they fill in what an answer leaves out.
    pub fn defaults(self) -> PbrFactors {
        let (roughness, metallic, ior, transmission) = match self {
            Self::Fabric => (0.90, 0.0, 1.5, 0.0),
            Self::Leather => (0.55, 0.0, 1.5, 0.0),
            Self::Wood => (0.55, 0.0, 1.5, 0.0),
            Self::Metal => (0.30, 1.0, 1.5, 0.0),
            Self::Glass => (0.05, 0.0, 1.5, 0.9),
            Self::Plastic => (0.45, 0.0, 1.46, 0.0),
            Self::Ceramic => (0.25, 0.0, 1.5, 0.0),
            Self::Stone => (0.60, 0.0, 1.55, 0.0),
            Self::Rattan => (0.75, 0.0, 1.5, 0.0),
            Self::Foam => (0.95, 0.0, 1.4, 0.0),
            Self::Paper => (0.90, 0.0, 1.5, 0.0),
            Self::Other => (0.60, 0.0, 1.5, 0.0),
        };
        PbrFactors { roughness, metallic, ior, transmission }
    }

    /// Brings factors into the range that is plausible for the category.
    ///
    /// Returns the clamped factors; values that are not finite become the default.
    pub fn clamp(self, given: PbrFactors) -> PbrFactors {
        let d = self.defaults();
        let fix = |value: f64, default: f64, low: f64, high: f64| {
            if value.is_finite() { value.clamp(low, high) } else { default }
        };
        let metallic_max = if matches!(self, Self::Metal | Self::Other) { 1.0 } else { 0.3 };
        let transmission_max = match self {
            Self::Glass => 1.0,
            Self::Plastic | Self::Other => 0.95,
            Self::Fabric | Self::Paper => 0.5,
            _ => 0.0,
        };
        PbrFactors {
            roughness: fix(given.roughness, d.roughness, 0.02, 1.0),
            metallic: fix(given.metallic, d.metallic, 0.0, metallic_max),
            ior: fix(given.ior, d.ior, 1.0, 2.5),
            transmission: fix(given.transmission, d.transmission, 0.0, transmission_max),
        }
    }
}
