//! Figures of a picture against what should be there, over regions of it.
//!
//! They follow the independent judge of new views: PL is the mean squared difference of sRGB values in [0, 1] over
//! pixels and channels; SSIM (Wang et al., "Image quality assessment", IEEE TIP 2004, eq. 13) is taken of luminance
//! over whole blocks of 8 x 8 pixels, unweighted, and a block counts for a region when more than 60 % of it lies there.

use harmony_scene::Mask;
use image::RgbImage;

/// Side of a block, pixels.
const BLOCK: usize = 8;
/// Share of a block that has to lie in the region.
const IN_REGION: f64 = 0.6;
/// `(K1 L)^2` of SSIM with L = 1.
const C1: f64 = 0.01 * 0.01;
/// `(K2 L)^2`.
const C2: f64 = 0.03 * 0.03;
/// Weights of sRGB values in luminance (Rec. 709), as the judge takes them: without linearising.
const LUMA: [f64; 3] = [0.2126, 0.7152, 0.0722];
/// Darkest luminance that is told apart in stops, linear: an sRGB value of about 13 of 255, eight stops under white.
const DARKEST: f64 = 1.0 / 256.0;

/// Pixel loss over a region; `None` when it is empty or the sizes differ.
pub fn loss(render: &RgbImage, target: &RgbImage, region: &Mask) -> Option<f64> {
    if !fits(render, target, region) {
        return None;
    }
    let (mut squares, mut count) = (0_u64, 0_u64);
    let pairs = render.pixels().zip(target.pixels()).zip(region.bits());
    for ((a, b), _) in pairs.filter(|(_, on)| **on) {
        squares += (0..3).map(|c| u64::from(a.0[c].abs_diff(b.0[c])).pow(2)).sum::<u64>();
        count += 3;
    }
    (count > 0).then(|| squares as f64 / (255.0 * 255.0) / count as f64)
}

/// Pixel loss of the whole picture after the best gain of each channel: what is left when only brightness and tone
/// are set right. Not clipped, as the judge does it.
pub fn loss_with_gain(render: &RgbImage, target: &RgbImage) -> Option<f64> {
    if render.dimensions() != target.dimensions() || render.as_raw().is_empty() {
        return None;
    }
    let mut sums = [[0_u64; 3]; 3];
    for (a, b) in render.pixels().zip(target.pixels()) {
        for (c, sums) in sums.iter_mut().enumerate() {
            let (a, b) = (u64::from(a.0[c]), u64::from(b.0[c]));
            for (sum, product) in sums.iter_mut().zip([a * a, a * b, b * b]) {
                *sum += product;
            }
        }
    }
    // Sum of (g a - b)^2 with g = ab / aa.
    let left: f64 = sums
        .iter()
        .map(|[aa, ab, bb]| {
            let (aa, ab, bb) = (*aa as f64, *ab as f64, *bb as f64);
            if aa > 0.0 { bb - ab * ab / aa } else { bb }
        })
        .sum();
    Some(left / (255.0 * 255.0) / render.as_raw().len() as f64)
}

/// SSIM over a region; `None` without a block in it, or when the sizes differ.
pub fn ssim(render: &RgbImage, target: &RgbImage, region: &Mask) -> Option<f64> {
    if !fits(render, target, region) {
        return None;
    }
    let (a, b) = (luma(render), luma(target));
    let width = render.width() as usize;
    let (columns, rows) = (width / BLOCK, render.height() as usize / BLOCK);
    let n = (BLOCK * BLOCK) as f64;
    let (mut sum, mut count) = (0.0, 0_usize);
    for at in (0..rows).flat_map(|y| (0..columns).map(move |x| y * BLOCK * width + x * BLOCK)) {
        let pixels = || (0..BLOCK).flat_map(move |y| (0..BLOCK).map(move |x| at + y * width + x));
        let there = pixels().filter(|i| region.bits()[*i]).count();
        if there as f64 / n <= IN_REGION {
            continue;
        }
        let mean = |of: &[f64]| pixels().map(|i| of[i]).sum::<f64>() / n;
        let (ma, mb) = (mean(&a), mean(&b));
        let covariance =
            |f: &[f64], mf: f64, g: &[f64], mg: f64| pixels().map(|i| (f[i] - mf) * (g[i] - mg)).sum::<f64>() / n;
        let (va, vb, cov) = (covariance(&a, ma, &a, ma), covariance(&b, mb, &b, mb), covariance(&a, ma, &b, mb));
        sum += (2.0 * ma * mb + C1) * (2.0 * cov + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2));
        count += 1;
    }
    (count > 0).then(|| sum / count as f64)
}

/// How far a picture's brightness is off, in stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stops {
    /// Median of the absolute log2 ratio of linear luminances over the pixels.
    pub error: f64,
    /// Median of the signed one; positive = the render is brighter.
    pub bias: f64,
}

/// Log2 ratio of the linear luminance of each pixel. Below about eight stops under white nothing is told apart.
pub fn stops(render: &RgbImage, target: &RgbImage) -> Option<Stops> {
    if render.dimensions() != target.dimensions() || render.as_raw().is_empty() {
        return None;
    }
    let log = |p: &image::Rgb<u8>| {
        let linear = harmony_imaging::color::linear_from_rgb8(p.0);
        let y: f64 = linear.iter().zip(LUMA).map(|(v, w)| f64::from(*v) * w).sum();
        y.max(DARKEST).log2()
    };
    let signed: Vec<f64> = render.pixels().zip(target.pixels()).map(|(a, b)| log(a) - log(b)).collect();
    let absolute: Vec<f64> = signed.iter().map(|v| v.abs()).collect();
    Some(Stops { error: crate::summary::quantile(&absolute, 0.5), bias: crate::summary::quantile(&signed, 0.5) })
}

/// `render` inside the region, `target` outside.
pub fn pasted(render: &RgbImage, target: &RgbImage, region: &Mask) -> RgbImage {
    let mut out = target.clone();
    for ((o, r), on) in out.pixels_mut().zip(render.pixels()).zip(region.bits()) {
        if *on {
            *o = *r;
        }
    }
    out
}

fn luma(picture: &RgbImage) -> Vec<f64> {
    picture.pixels().map(|p| p.0.iter().zip(LUMA).map(|(v, w)| f64::from(*v) / 255.0 * w).sum()).collect()
}

fn fits(render: &RgbImage, target: &RgbImage, region: &Mask) -> bool {
    let size = region.size();
    render.dimensions() == target.dimensions() && render.dimensions() == (size.width, size.height)
}

#[cfg(test)]
mod tests {
    use harmony_scene::ImageSize;
    use image::Rgb;

    use super::*;

    fn everywhere(w: u32, h: u32) -> Mask {
        Mask::from_fn(ImageSize::new(w, h), |_, _| true)
    }

    fn grey(w: u32, h: u32, v: u8) -> RgbImage {
        RgbImage::from_pixel(w, h, Rgb([v; 3]))
    }

    #[test]
    fn loss_is_the_mean_square_of_the_region_alone() {
        let (mut a, b) = (grey(4, 2, 51), grey(4, 2, 0));
        a.put_pixel(3, 1, Rgb([255, 0, 0]));
        // 51 / 255 = 0.2: squares of 0.04.
        let left = Mask::from_fn(ImageSize::new(4, 2), |x, _| x < 2);
        assert!((loss(&a, &b, &left).unwrap() - 0.04).abs() < 1e-12);
        // Seven pixels of 0.04 and one with a third of 1.
        let all = loss(&a, &b, &everywhere(4, 2)).unwrap();
        assert!((all - (7.0 * 0.04 + 1.0 / 3.0) / 8.0).abs() < 1e-12, "{all}");
        assert_eq!(loss(&a, &b, &Mask::empty(ImageSize::new(4, 2))), None);
        assert_eq!(loss(&a, &grey(4, 3, 0), &left), None);
    }

    #[test]
    fn a_gain_takes_away_brightness_and_nothing_else() {
        let a = RgbImage::from_fn(8, 8, |x, _| Rgb([(10 * x) as u8 + 20; 3]));
        let double = RgbImage::from_fn(8, 8, |x, _| Rgb([(20 * x) as u8 + 40; 3]));
        assert!(loss_with_gain(&a, &double).unwrap() < 1e-12);
        // Black cannot be made brighter: the loss is the target's own square.
        assert!((loss_with_gain(&grey(8, 8, 0), &grey(8, 8, 51)).unwrap() - 0.04).abs() < 1e-12);
    }

    #[test]
    fn ssim_of_flat_blocks_is_the_luminance_term() {
        let (a, b) = (grey(16, 16, 102), grey(16, 16, 204));
        // Means 0.4 and 0.8, no variance: (2 ab + c1) / (a^2 + b^2 + c1).
        let expected = (0.64 + 1e-4) / (0.16 + 0.64 + 1e-4);
        assert!((ssim(&a, &b, &everywhere(16, 16)).unwrap() - expected).abs() < 1e-9);
        assert!((ssim(&a, &a, &everywhere(16, 16)).unwrap() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn ssim_of_opposite_checks_is_nearly_minus_one() {
        let checks = |odd: u32| RgbImage::from_fn(8, 8, |x, y| Rgb([if (x + y) % 2 == odd { 255 } else { 0 }; 3]));
        // Equal means of 0.5, variances of 0.25, covariance of -0.25.
        let expected = (-0.5 + 9e-4) / (0.5 + 9e-4);
        assert!((ssim(&checks(0), &checks(1), &everywhere(8, 8)).unwrap() - expected).abs() < 1e-9);
    }

    #[test]
    fn a_block_counts_when_more_than_six_tenths_of_it_lie_in_the_region() {
        let (a, mut b) = (grey(16, 8, 102), grey(16, 8, 102));
        for y in 0..8 {
            for x in 8..16 {
                b.put_pixel(x, y, Rgb([204; 3]));
            }
        }
        // 38 of the 64 pixels of the right block are 0.594 of it, 39 are 0.609.
        let with = |n: u32| Mask::from_fn(ImageSize::new(16, 8), |x, y| x < 8 || (x - 8) + y * 8 < n);
        assert!((ssim(&a, &b, &with(38)).unwrap() - 1.0).abs() < 1e-12);
        assert!(ssim(&a, &b, &with(39)).unwrap() < 0.95);
        assert_eq!(ssim(&a, &b, &Mask::empty(ImageSize::new(16, 8))), None);
    }

    #[test]
    fn stops_are_powers_of_two_of_linear_light() {
        // sRGB 188 is 0.5029 linear: just under one stop below white.
        let found = stops(&grey(3, 3, 188), &grey(3, 3, 255)).unwrap();
        assert!((found.error - 0.992).abs() < 0.005 && (found.bias + 0.992).abs() < 0.005, "{found:?}");
        // Both darker than what is told apart.
        assert_eq!(stops(&grey(3, 3, 0), &grey(3, 3, 9)).unwrap().error, 0.0);
        // Half the pixels wrong by much do not move the median of the rest beyond the middle.
        let mut mixed = grey(5, 1, 255);
        mixed.put_pixel(0, 0, Rgb([0; 3]));
        mixed.put_pixel(1, 0, Rgb([0; 3]));
        assert_eq!(stops(&mixed, &grey(5, 1, 255)).unwrap().error, 0.0);
    }

    #[test]
    fn pasted_pictures_differ_in_the_region_alone() {
        let region = Mask::from_fn(ImageSize::new(4, 1), |x, _| x == 2);
        let out = pasted(&grey(4, 1, 9), &grey(4, 1, 200), &region);
        assert_eq!(out.pixels().map(|p| p.0[0]).collect::<Vec<_>>(), [200, 200, 9, 200]);
    }
}
