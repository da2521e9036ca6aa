//! Colours: `#rrggbb`, linear light, black bodies.

use std::sync::LazyLock;

use super::space::Rgb;

/// Linear value of an sRGB value, both 0 to 1 (IEC 61966-2-1).
pub(crate) fn linear(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }
}

/// sRGB value of a linear value, both 0 to 1.
pub(crate) fn encoded(c: f64) -> f64 {
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * libm::pow(c, 1.0 / 2.4) - 0.055 }
}

/// sRGB bytes of `#rrggbb` or `#rgb`, with or without the sign; `None` for anything else.
pub fn parse_hex(text: &str) -> Option<[u8; 3]> {
    let digits = text.trim().trim_start_matches('#');
    if !digits.is_ascii() {
        return None;
    }
    match digits.len() {
        6 => {
            let part = |k: usize| u8::from_str_radix(&digits[2 * k..2 * k + 2], 16).ok();
            Some([part(0)?, part(1)?, part(2)?])
        }
        3 => {
            let part = |k: usize| u8::from_str_radix(&digits[k..=k], 16).ok().map(|v| v * 17);
            Some([part(0)?, part(1)?, part(2)?])
        }
        _ => None,
    }
}

/// `#rrggbb` of sRGB bytes.
pub fn hex(rgb: [u8; 3]) -> String {
    format!("#{:02x}{:02x}{:02x}", rgb[0], rgb[1], rgb[2])
}

/// Steps of linear light from which the byte of a value is looked for upwards: no byte begins and ends within one.
const STEPS: usize = 4096;

/// Bytes and linear light: every texel of a tile is converted several times, and powers were a quarter of a run.
struct Bytes {
    /// Linear value of each byte.
    linear: [f64; 256],
    /// Linear value from which each byte is the nearest.
    from: [f64; 256],
    /// Byte at each step of linear light.
    at: [u8; STEPS + 1],
}

static BYTES: LazyLock<Bytes> = LazyLock::new(|| Bytes {
    linear: std::array::from_fn(|k| linear(k as f64 / 255.0)),
    from: std::array::from_fn(|k| linear((k as f64 - 0.5).max(0.0) / 255.0)),
    at: std::array::from_fn(|i| (encoded(i as f64 / STEPS as f64) * 255.0).round() as u8),
});

/// Linear colour of sRGB bytes.
pub(crate) fn linear_of(rgb: [u8; 3]) -> Rgb {
    let bytes = &*BYTES;
    rgb.map(|c| bytes.linear[usize::from(c)])
}

/// sRGB bytes of a linear colour.
pub(crate) fn bytes_of(color: Rgb) -> [u8; 3] {
    let bytes = &*BYTES;
    color.map(|c| {
        let c = c.clamp(0.0, 1.0);
        let mut byte = bytes.at[(c * STEPS as f64) as usize];
        while byte < 255 && c >= bytes.from[usize::from(byte) + 1] {
            byte += 1;
        }
        byte
    })
}

/// Linear colour of a slot or pattern colour; mid grey for text that is no colour.
pub(crate) fn linear_hex(text: &str) -> Rgb {
    linear_of(parse_hex(text).unwrap_or([128; 3]))
}

/// Relative luminance of a linear colour (Rec. 709).
pub(crate) fn luminance(c: Rgb) -> f64 {
    0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
}

/// Linear sRGB colour of a black body, largest channel 1.
///
/// Planckian locus by the cubic fit of Kim et al. (US patent 7024034, 2002), good from 1667 to 25 000 K, to which the
/// temperature is held; colours outside sRGB (below about 1900 K) lose their negative blue.
pub fn kelvin_to_rgb(kelvin: f64) -> [f64; 3] {
    let t = if kelvin.is_finite() { kelvin.clamp(1667.0, 25_000.0) } else { 6500.0 };
    let (a, b, c) = (1e9 / (t * t * t), 1e6 / (t * t), 1e3 / t);
    let x = if t <= 4000.0 {
        -0.266_123_9 * a - 0.234_358_9 * b + 0.877_695_6 * c + 0.179_910
    } else {
        -3.025_846_9 * a + 2.107_037_9 * b + 0.222_634_7 * c + 0.240_390
    };
    let (x2, x3) = (x * x, x * x * x);
    let y = if t <= 2222.0 {
        -1.106_381_4 * x3 - 1.348_110_2 * x2 + 2.185_558_32 * x - 0.202_196_83
    } else if t <= 4000.0 {
        -0.954_947_6 * x3 - 1.374_185_93 * x2 + 2.091_370_15 * x - 0.167_488_67
    } else {
        3.081_758 * x3 - 5.873_386_7 * x2 + 3.751_129_97 * x - 0.370_014_83
    };
    let (cx, cz) = (x / y, (1.0 - x - y) / y);
    let rgb = [
        3.240_454_2 * cx - 1.537_138_5 - 0.498_531_4 * cz,
        -0.969_266 * cx + 1.876_010_8 + 0.041_556 * cz,
        0.055_643_4 * cx - 0.204_025_9 + 1.057_225_2 * cz,
    ]
    .map(|v: f64| v.max(0.0));
    let most = rgb.into_iter().fold(1e-9, f64::max);
    rgb.map(|v| v / most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hex_colours_are_read_and_written() {
        assert_eq!(parse_hex("#c81E0a"), Some([200, 30, 10]));
        assert_eq!(parse_hex("fa0"), Some([255, 170, 0]));
        assert_eq!((parse_hex("red"), parse_hex("#12345"), parse_hex("#ääx")), (None, None, None));
        assert_eq!(hex([200, 30, 10]), "#c81e0a");
        for c in 0..=255_u8 {
            assert_eq!(bytes_of(linear_of([c; 3])), [c; 3]);
        }
    }

    #[test]
    fn bytes_are_those_of_the_formula() {
        for i in 0..=300_000 {
            let c = f64::from(i) / 300_000.0;
            let byte = (encoded(c) * 255.0).round() as u8;
            assert_eq!(bytes_of([c; 3]), [byte; 3], "{c}");
        }
        assert_eq!(bytes_of([-1.0, 2.0, f64::NAN]), [0, 255, 0]);
    }

    #[test]
    fn black_bodies_have_the_known_colours() {
        // Charity's table (CIE 1964 observer) within 8 of 255: 2700 K, 4000 K, 6500 K, 10000 K.
        let known = [
            (2700.0, [255, 169, 87]),
            (4000.0, [255, 209, 163]),
            (6500.0, [255, 249, 253]),
            (10_000.0, [204, 219, 255]),
        ];
        for (kelvin, rgb) in known {
            let got = bytes_of(kelvin_to_rgb(kelvin));
            for (g, w) in got.into_iter().zip(rgb) {
                assert!((i32::from(g) - w).abs() <= 8, "{kelvin} K: {got:?}, not {rgb:?}");
            }
        }
    }
}
