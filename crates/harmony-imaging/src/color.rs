//! sRGB, linear light and CIE Lab; colours of a masked area.

use std::sync::LazyLock;

use harmony_scene::Mask;
use image::RgbImage;

/// Linear light (0 to 1) of an sRGB value (0 to 1). IEC 61966-2-1.
pub fn linear_from_srgb(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// sRGB value (0 to 1) of linear light (0 to 1; values outside are clamped). IEC 61966-2-1.
pub fn srgb_from_linear(value: f32) -> f32 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.003_130_8 { value * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

/// Linear light of every 8-bit sRGB value.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| linear_from_srgb(i as f32 / 255.0)));

/// Linear RGB (0 to 1) of an 8-bit sRGB colour.
pub fn linear_from_rgb8(color: [u8; 3]) -> [f32; 3] {
    color.map(|c| LINEAR[c as usize])
}

/// 8-bit sRGB of linear RGB, rounded and clamped.
pub fn rgb8_from_linear(color: [f32; 3]) -> [u8; 3] {
    color.map(|c| (srgb_from_linear(c) * 255.0).round() as u8)
}

/// CIE 1976 L*a*b* (D65, 2 degree observer) of an 8-bit sRGB colour; L is 0 to 100.
pub fn lab_from_rgb8(color: [u8; 3]) -> [f32; 3] {
    let [r, g, b] = linear_from_rgb8(color);
    let x = (0.412_456 * r + 0.357_576 * g + 0.180_437 * b) / 0.950_47;
    let y = 0.212_673 * r + 0.715_152 * g + 0.072_175 * b;
    let z = (0.019_334 * r + 0.119_192 * g + 0.950_304 * b) / 1.088_83;
    let f = |t: f32| if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 };
    let (fx, fy, fz) = (f(x), f(y), f(z));
    [116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz)]
}

/// 8-bit sRGB of a CIE L*a*b* colour, clamped into the gamut.
pub fn rgb8_from_lab(lab: [f32; 3]) -> [u8; 3] {
    let fy = (lab[0] + 16.0) / 116.0;
    let (fx, fz) = (fy + lab[1] / 500.0, fy - lab[2] / 200.0);
    let g = |t: f32| if t > 0.206_893 { t * t * t } else { (t - 16.0 / 116.0) / 7.787 };
    let (x, y, z) = (g(fx) * 0.950_47, g(fy), g(fz) * 1.088_83);
    rgb8_from_linear([
        3.240_454 * x - 1.537_139 * y - 0.498_531 * z,
        -0.969_266 * x + 1.876_011 * y + 0.041_556 * z,
        0.055_643 * x - 0.204_026 * y + 1.057_225 * z,
    ])
}

/// Distance of two colours in Lab (CIE76); about 2 is just noticeable.
pub fn lab_distance(a: [u8; 3], b: [u8; 3]) -> f64 {
    let (a, b) = (lab_from_rgb8(a), lab_from_rgb8(b));
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}

/// Channel-wise median colour of the masked pixels, or `None` when no pixel is set.
pub fn median_color(photo: &RgbImage, mask: &Mask) -> Option<[u8; 3]> {
    let mask = crate::fitted(mask, photo);
    let mut histogram = [[0_u32; 256]; 3];
    let mut count = 0_u32;
    for (pixel, on) in photo.pixels().zip(mask.bits()) {
        if *on {
            count += 1;
            for (h, c) in histogram.iter_mut().zip(pixel.0) {
                h[c as usize] += 1;
            }
        }
    }
    (count > 0).then(|| {
        histogram.map(|h| {
            let mut below = 0;
            for (value, n) in h.iter().enumerate() {
                below += n;
                if below * 2 >= count {
                    return value as u8;
                }
            }
            255
        })
    })
}

/// Squared distance of two Lab colours.
pub(crate) fn distance_squared(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Start centres: the median-lightness colour, then each time the colour farthest from all chosen.
pub(crate) fn farthest_points(labs: &[[f32; 3]], count: usize) -> Vec<[f32; 3]> {
    let mut by_lightness: Vec<[f32; 3]> = labs.to_vec();
    by_lightness.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let Some(first) = by_lightness.get(labs.len() / 2) else { return Vec::new() };
    let mut centres = vec![*first];
    let mut distance: Vec<f32> = labs.iter().map(|lab| distance_squared(*lab, *first)).collect();
    while centres.len() < count {
        let Some((k, d)) = distance.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) else { break };
        if *d <= 0.0 {
            break;
        }
        let centre = labs[k];
        centres.push(centre);
        for (d, lab) in distance.iter_mut().zip(labs) {
            *d = d.min(distance_squared(*lab, centre));
        }
    }
    centres
}

/// Index of the nearest centre.
pub(crate) fn nearest(centres: &[[f32; 3]], lab: [f32; 3]) -> usize {
    let mut best = (0, f32::INFINITY);
    for (k, centre) in centres.iter().enumerate() {
        let d = distance_squared(*centre, lab);
        if d < best.1 {
            best = (k, d);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmony_scene::ImageSize;

    #[test]
    fn lab_of_the_primaries_is_as_published() {
        // Lindbloom's table for sRGB, D65.
        for (rgb, lab) in [
            ([255, 255, 255], [100.0, 0.0, 0.0]),
            ([255, 0, 0], [53.24, 80.09, 67.20]),
            ([0, 255, 0], [87.73, -86.18, 83.18]),
            ([0, 0, 255], [32.30, 79.19, -107.86]),
        ] {
            for (a, b) in lab_from_rgb8(rgb).iter().zip(lab) {
                assert!((a - b).abs() < 0.1, "{rgb:?}");
            }
        }
    }

    #[test]
    fn every_grey_and_some_colours_survive_lab_and_linear() {
        for v in 0..=255_u8 {
            for c in [[v, v, v], [v, 255 - v, 40], [10, v, v / 2]] {
                assert_eq!(rgb8_from_linear(linear_from_rgb8(c)), c);
                for (a, b) in rgb8_from_lab(lab_from_rgb8(c)).iter().zip(c) {
                    assert!(a.abs_diff(b) <= 1, "{c:?}");
                }
            }
        }
    }

    #[test]
    fn the_median_of_a_two_colour_area_is_the_larger_one() {
        let size = ImageSize::new(40, 10);
        let photo = RgbImage::from_fn(40, 10, |x, _| image::Rgb(if x < 30 { [200, 30, 30] } else { [20, 40, 180] }));
        let all = Mask::from_fn(size, |_, _| true);
        assert_eq!(median_color(&photo, &all), Some([200, 30, 30]));
        assert_eq!(median_color(&photo, &Mask::empty(size)), None);
    }
}
