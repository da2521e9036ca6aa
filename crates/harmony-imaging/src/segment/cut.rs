//! The cut itself: colour models and the minimum cut, in turns.
//!
//! C. Rother, V. Kolmogorov, A. Blake, "GrabCut: Interactive Foreground Extraction using Iterated Graph Cuts",
//! SIGGRAPH 2004. Ours works in Lab, bounds what a pixel's colour can say, and adds a prior for each pixel (from the
//! outline or the box). Known weak regime: an object in the colours of its surroundings follows the prior.

use super::mixture::Mixture;
use crate::maxflow::{GridGraph, STEPS};

/// What is known of a pixel beforehand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Known {
    /// To be decided.
    Free,
    Object,
    Background,
    /// Not the object, and no example of its surroundings either.
    Ignored,
}

/// Integer capacity of one unit of evidence.
const UNIT: f32 = 200.0;
/// Most that a pixel's colour can say for or against the object, natural log units.
const MAX_COLOR_ODDS: f32 = 5.0;
/// Usual strength of the pairwise term, in the same units.
const EDGE_STRENGTH: f32 = 14.0;

/// A picture to divide.
pub(super) struct Problem {
    pub width: usize,
    pub height: usize,
    pub lab: Vec<[f32; 3]>,
    pub known: Vec<Known>,
    /// Log odds of being object, before the colours are looked at.
    pub prior: Vec<f32>,
    /// Weight of the colours.
    pub color_weight: f32,
    /// Weight of the pairwise term, 1 = usual.
    pub smoothness: f32,
}

/// Colour models of object and background.
#[derive(Debug, Clone)]
pub(super) struct Models {
    pub object: Mixture,
    pub background: Mixture,
}

impl Problem {
    /// Colour models from a division; `None` when one side is empty.
    pub(super) fn models(&self, object: &[bool]) -> Option<Models> {
        let colors = |side: bool| -> Vec<[f32; 3]> {
            let members = self.lab.iter().zip(object).zip(&self.known);
            members.filter(|((_, o), k)| **o == side && **k != Known::Ignored).map(|((lab, _), _)| *lab).collect()
        };
        Some(Models { object: Mixture::fit(&colors(true))?, background: Mixture::fit(&colors(false))? })
    }

    /// Log odds of every free pixel from models and prior (from the prior alone without models).
    pub(super) fn odds(&self, models: Option<&Models>) -> Vec<f32> {
        let mut odds = self.prior.clone();
        if let Some(models) = models {
            for ((odds, lab), known) in odds.iter_mut().zip(&self.lab).zip(&self.known) {
                if *known == Known::Free {
                    let color = models.object.log_density(*lab) - models.background.log_density(*lab);
                    *odds += self.color_weight * color.clamp(-MAX_COLOR_ODDS, MAX_COLOR_ODDS);
                }
            }
        }
        odds
    }

    /// The best division for the odds, made `bias` more likely to be object everywhere.
    pub(super) fn cut(&self, odds: &[f32], bias: f32) -> Vec<bool> {
        let free: Vec<bool> = self.known.iter().map(|k| *k == Known::Free).collect();
        let mut graph = GridGraph::new(self.width, self.height, &free);
        let beta = self.contrast();
        let strength = EDGE_STRENGTH * self.smoothness;
        for node in 0..graph.pixels().len() {
            let pixel = graph.pixels()[node] as usize;
            graph.pull(node, ((odds[pixel] + bias) * UNIT) as i32);
            let (x, y) = ((pixel % self.width) as i32, (pixel / self.width) as i32);
            for (d, (dx, dy)) in STEPS.iter().enumerate() {
                let (nx, ny) = (x + dx, y + dy);
                if nx < 0 || ny < 0 || nx >= self.width as i32 || ny >= self.height as i32 {
                    continue;
                }
                let other = ny as usize * self.width + nx as usize;
                let to_node = graph.is_node(other);
                if to_node && d % 2 == 1 {
                    continue; // set from the other end
                }
                let difference = crate::color::distance_squared(self.lab[pixel], self.lab[other]);
                let length = if d < 4 { 1.0 } else { std::f32::consts::SQRT_2 };
                let amount = (strength * (-beta * difference).exp() / length * UNIT) as i32;
                match self.known[other] {
                    Known::Free => graph.connect(node, d, amount),
                    Known::Object => graph.pull(node, amount),
                    Known::Background | Known::Ignored => graph.pull(node, -amount),
                }
            }
        }
        let mut object: Vec<bool> = self.known.iter().map(|k| *k == Known::Object).collect();
        let pixels = graph.pixels().to_vec();
        for (pixel, on) in pixels.into_iter().zip(graph.solve()) {
            object[pixel as usize] = on;
        }
        object
    }

    /// GrabCut's beta: the inverse of twice the mean squared difference of neighbours.
    fn contrast(&self) -> f32 {
        let (mut sum, mut n) = (0.0_f64, 0.0_f64);
        for y in 0..self.height {
            for x in 0..self.width {
                let i = y * self.width + x;
                if x + 1 < self.width {
                    sum += f64::from(crate::color::distance_squared(self.lab[i], self.lab[i + 1]));
                    n += 1.0;
                }
                if y + 1 < self.height {
                    sum += f64::from(crate::color::distance_squared(self.lab[i], self.lab[i + self.width]));
                    n += 1.0;
                }
            }
        }
        // At least one Lab unit of noise, so that a flat picture has no edges.
        (1.0 / (2.0 * (sum / n.max(1.0)).max(1.0))) as f32
    }

    /// Models and division in turns, from a first division.
    pub(super) fn solve(&self, first: Vec<bool>, iterations: u32) -> (Vec<bool>, Vec<f32>, Option<Models>) {
        let mut object = first;
        let mut models = self.models(&object);
        let mut odds = self.odds(models.as_ref());
        for _ in 0..iterations.max(1) {
            let next = self.cut(&odds, 0.0);
            let changed = next.iter().zip(&object).filter(|(a, b)| a != b).count();
            object = next;
            if changed * 500 < self.lab.len() {
                break;
            }
            let Some(next_models) = self.models(&object) else { break };
            odds = self.odds(Some(&next_models));
            models = Some(next_models);
        }
        (object, odds, models)
    }
}
