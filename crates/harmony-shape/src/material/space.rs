//! The torus that a tile covers, and what a pattern says about a place on it.

use super::noise::smooth;

/// Linear RGB.
pub(super) type Rgb = [f64; 3];

/// A tile's surface, both directions wrapped.
#[derive(Debug, Clone, Copy)]
pub(super) struct Space {
    /// Width, metres.
    pub w: f64,
    /// Height, metres.
    pub h: f64,
    /// Side of a texel, metres: what edges are filtered by.
    pub px: f64,
    /// Arrangement.
    pub seed: u64,
    /// The slot's colour, linear.
    pub slot: Rgb,
}

/// What a pattern is at a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Height of the surface, millimetres.
    pub height: f64,
    /// Linear colour.
    pub color: Rgb,
    /// Added to the slot's roughness.
    pub rough: f64,
    /// How much of what lies below is covered when it lies over another pattern.
    pub cover: f64,
    /// Which piece: equal for all of a plank, tile, cell. Tests and masks use it.
    pub id: u64,
}

impl Sample {
    /// A flat, opaque place.
    pub(super) fn flat(color: Rgb) -> Self {
        Self { height: 0.0, color, rough: 0.0, cover: 1.0, id: 0 }
    }
}

/// A pattern made ready for a space.
pub(super) type Paint = Box<dyn Fn(f64, f64) -> Sample + Send + Sync>;

impl Space {
    /// Whole repeats of about `unit` metres across the tile, and their exact length.
    pub(super) fn across(&self, unit: f64) -> (i64, f64) {
        let n = (self.w / unit).round().max(1.0);
        (n as i64, self.w / n)
    }

    /// Whole repeats of about `unit` metres down the tile, a multiple of `step`, and their exact length.
    pub(super) fn down(&self, unit: f64, step: i64) -> (i64, f64) {
        let n = ((self.h / unit / step as f64).round().max(1.0)) * step as f64;
        (n as i64, self.h / n)
    }

    /// Share of a texel inside an edge at signed distance `d` (negative inside).
    pub(super) fn inside(&self, d: f64) -> f64 {
        (0.5 - d / self.px).clamp(0.0, 1.0)
    }

    /// How far detail of a size shows at this texel: 0 below two texels, 1 from four on.
    pub(super) fn shows(&self, size: f64) -> f64 {
        smooth(1.8, 4.0, size / self.px)
    }
}

/// Between two colours.
pub(super) fn mix(a: Rgb, b: Rgb, t: f64) -> Rgb {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t)
}

/// A colour, brighter or darker by a factor.
pub(super) fn times(a: Rgb, k: f64) -> Rgb {
    a.map(|c| c * k)
}

/// A colour by factors.
pub(super) fn tinted(a: Rgb, k: Rgb) -> Rgb {
    std::array::from_fn(|i| a[i] * k[i])
}
