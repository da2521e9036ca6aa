//! `6_lighting/physical`: mass and friction for rigid-body simulations, asked once a room (paper, "Physical Simulations").
//!
//! The wording is the paper's; sizes are added, and its map from label to numbers is a list, for strict schemas know no free
//! keys.

use std::collections::BTreeSet;
use std::fmt::{Display, Formatter};

use harmony_scene::Size;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, fill, in_range, lines};

/// Masses that are answered, kilograms: from a sheet of paper to a grand piano.
const MASS_KG: [f64; 2] = [0.001, 1000.0];
/// Coefficients of friction that are answered; the paper names 0.2 and 0.9.
const FRICTION: [f64; 2] = [0.05, 1.2];

/// Asks for mass and friction of every label.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhysicalQuestion {
    /// Labels of the room, each once.
    pub items: Vec<PhysicalLabel>,
}

/// A label.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhysicalLabel {
    /// As objects are called.
    pub label: String,
    /// Of the first object that is called so, metres.
    pub size: Size,
}

impl Display for PhysicalLabel {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let Size { width, height, depth } = self.size;
        write!(f, "- {}: {width:.2} x {height:.2} x {depth:.2}", self.label)
    }
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhysicalAnswer {
    /// One entry a label.
    pub items: Vec<PhysicalItem>,
}

/// Mass and friction of things of a label.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhysicalItem {
    /// As asked.
    pub label: String,
    /// Kilograms.
    pub mass_kg: f64,
    /// Coefficient of friction against a wood floor.
    pub friction: f64,
}

impl Ask for PhysicalQuestion {
    type Answer = PhysicalAnswer;

    fn prompt(&self) -> String {
        fill(include_str!("../templates/physical.md"), &[("labels", lines(&self.items))])
    }

    fn example(&self) -> PhysicalAnswer {
        let item = |label: &str, mass_kg, friction| PhysicalItem { label: label.into(), mass_kg, friction };
        PhysicalAnswer { items: vec![item("bean bag", 4.5, 0.6), item("wall clock", 1.2, 0.4)] }
    }

    /// Every label once: what is left out is the catalogue's.
    fn check(&self, answer: &PhysicalAnswer) -> Result<(), String> {
        let asked: BTreeSet<&str> = self.items.iter().map(|i| i.label.as_str()).collect();
        let mut seen = BTreeSet::new();
        for item in &answer.items {
            if !asked.contains(item.label.as_str()) {
                return Err(format!("{:?} was not asked for", item.label));
            }
            if !seen.insert(item.label.as_str()) {
                return Err(format!("{:?} is there twice", item.label));
            }
            in_range(&format!("the mass of {}", item.label), item.mass_kg, MASS_KG[0], MASS_KG[1])?;
            in_range(&format!("the friction of {}", item.label), item.friction, FRICTION[0], FRICTION[1])?;
        }
        Ok(())
    }

    /// The catalogue's stay.
    fn without_looking(&self) -> Option<PhysicalAnswer> {
        Some(PhysicalAnswer::default())
    }
}
