//! sRGB transfer by tables (IEC 61966-2-1).

use std::sync::LazyLock;

/// Entries of the encoding table: fine enough that every 8-bit value comes back through it (tested).
const ENCODE_STEPS: usize = 16_384;

/// Tables both ways between 8-bit sRGB and linear light.
pub(crate) struct Tables {
    /// Linear value of an sRGB byte.
    pub(crate) decode: [f32; 256],
    encode: Vec<u8>,
}

static TABLES: LazyLock<Tables> = LazyLock::new(|| Tables {
    decode: std::array::from_fn(|i| {
        let c = i as f64 / 255.0;
        (if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }) as f32
    }),
    encode: (0..=ENCODE_STEPS)
        .map(|i| {
            let l = i as f64 / ENCODE_STEPS as f64;
            let c = if l <= 0.003_130_8 { l * 12.92 } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
            (c * 255.0).round() as u8
        })
        .collect(),
});

/// The tables, made on first use.
pub(crate) fn tables() -> &'static Tables {
    &TABLES
}

impl Tables {
    /// The sRGB byte of a linear value, clamped to 0..=1; NaN is 0.
    #[inline]
    pub(crate) fn encode(&self, linear: f32) -> u8 {
        self.encode[(linear.clamp(0.0, 1.0) * ENCODE_STEPS as f32 + 0.5) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_the_way_through_linear_light() {
        for b in 0..=255_u8 {
            assert_eq!(tables().encode(tables().decode[b as usize]), b);
        }
        assert_eq!(tables().encode(f32::NAN), 0);
        assert_eq!(tables().encode(7.0), 255);
        // Half of linear white is sRGB 188, the well-known value.
        assert_eq!(tables().encode(0.5), 188);
    }
}
