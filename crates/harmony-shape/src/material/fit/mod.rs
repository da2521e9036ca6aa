//! placeholder
use image::RgbaImage;
use super::Pattern;
/// Fit.
#[derive(Debug, Clone)]
pub struct PatternFit { /// Pattern.
    pub pattern: Pattern }
/// Fit.
pub fn fit_pattern(hint: &Pattern, _seen: &RgbaImage, _px_per_m: f64) -> Pattern { hint.clone() }
/// Fit.
pub fn fit_evidence(hint: &Pattern, _seen: &RgbaImage, _px_per_m: f64) -> PatternFit { PatternFit { pattern: hint.clone() } }
