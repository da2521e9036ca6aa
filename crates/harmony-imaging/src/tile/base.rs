//! The large-scale colour of a surface: what light and vignetting do to it.

use image::RgbaImage;

/// Colour planes of a texture: 0 to 255 a channel.
pub(super) type Color = [f32; 3];

/// Cells along the longer side of the grid on which the large-scale colour lives.
const CELLS: usize = 40;
/// Blur of the observed colours, cells.
const BLUR_CELLS: f32 = 2.0;
/// Cells over which the colour goes back to the median, away from what was observed.
const SETTLING_CELLS: f32 = 6.0;
/// How a field follows what was observed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Smoothing {
    /// Side of a cell, texels.
    pub cell: usize,
    /// Blur, cells.
    pub blur: f32,
    /// Cells over which the field goes back to the median.
    pub settling: f32,
}

impl Smoothing {
    /// What suits any texture of that size.
    fn usual(width: usize, height: usize) -> Self {
        Self { cell: width.max(height).div_ceil(CELLS).max(1), blur: BLUR_CELLS, settling: SETTLING_CELLS }
    }
}

/// A smooth colour field over a texture.
#[derive(Debug, Clone)]
pub(super) struct Base {
    width: usize,
    height: usize,
    scale: (f32, f32),
    cells: Vec<Color>,
    /// Channel-wise median of the observed texels.
    pub median: Color,
}

impl Base {
    /// The field of a texture's observed texels; `None` without any.
    pub(super) fn of(texture: &RgbaImage) -> Option<Self> {
        Self::smooth(texture, &Smoothing::usual(texture.width() as usize, texture.height() as usize))
    }

    /// [`Base::of`], as smooth as wanted.
    pub(super) fn smooth(texture: &RgbaImage, smoothing: &Smoothing) -> Option<Self> {
        let median = median(texture)?;
        let (tw, th) = (texture.width() as usize, texture.height() as usize);
        let cell = smoothing.cell.max(1);
        let (width, height) = (tw.div_ceil(cell), th.div_ceil(cell));
        let mut sums = vec![([0.0_f32; 3], 0.0_f32); width * height];
        for (x, y, p) in texture.enumerate_pixels() {
            if p.0[3] >= 128 {
                let (sum, n) = &mut sums[y as usize / cell * width + x as usize / cell];
                for (s, c) in sum.iter_mut().zip(p.0) {
                    *s += f32::from(c);
                }
                *n += 1.0;
            }
        }
        // Few texels in a cell say little about it.
        let full = (cell * cell) as f32;
        let observed: Vec<bool> = sums.iter().map(|(_, n)| *n > 0.12 * full).collect();
        let weighted: Vec<(Color, f32)> =
            sums.iter().map(|(sum, n)| if *n > 0.0 { (sum.map(|s| s / n), n / full) } else { (median, 0.0) }).collect();
        let blurred = blur(&weighted, width, height, smoothing.blur);
        let mut cells: Vec<Color> =
            blurred.iter().zip(&observed).map(|(b, seen)| if *seen { *b } else { median }).collect();
        settle(&mut cells, &observed, (width, height), median, smoothing.settling);
        Some(Self { width, height, scale: (1.0 / cell as f32, 1.0 / cell as f32), cells, median })
    }

    /// The field at a texel.
    pub(super) fn at(&self, x: u32, y: u32) -> Color {
        let fx = ((x as f32 + 0.5) * self.scale.0 - 0.5).clamp(0.0, (self.width - 1) as f32);
        let fy = ((y as f32 + 0.5) * self.scale.1 - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (x0, y0) = (fx as usize, fy as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        // Smoothstep hides the kinks of the grid.
        let ease = |t: f32| t * t * (3.0 - 2.0 * t);
        let (tx, ty) = (ease(fx - x0 as f32), ease(fy - y0 as f32));
        let cell = |x: usize, y: usize| &self.cells[y * self.width + x];
        std::array::from_fn(|c| {
            let top = cell(x0, y0)[c] * (1.0 - tx) + cell(x1, y0)[c] * tx;
            let bottom = cell(x0, y1)[c] * (1.0 - tx) + cell(x1, y1)[c] * tx;
            top * (1.0 - ty) + bottom * ty
        })
    }
}

/// Channel-wise median of the observed texels.
pub(super) fn median(texture: &RgbaImage) -> Option<Color> {
    let mut histogram = [[0_u32; 256]; 3];
    let mut count = 0_u32;
    for p in texture.pixels().filter(|p| p.0[3] >= 128) {
        count += 1;
        for (h, c) in histogram.iter_mut().zip(p.0) {
            h[c as usize] += 1;
        }
    }
    (count > 0).then(|| {
        histogram.map(|h| {
            let mut below = 0;
            h.iter()
                .position(|n| {
                    below += n;
                    below * 2 >= count
                })
                .unwrap_or(128) as f32
        })
    })
}

/// Gaussian mean of the weighted cells around each cell.
fn blur(cells: &[(Color, f32)], width: usize, height: usize, sigma: f32) -> Vec<Color> {
    let reach = (sigma * 2.5).ceil() as i32;
    (0..width * height)
        .map(|i| {
            let (x, y) = ((i % width) as i32, (i / width) as i32);
            let (mut sum, mut total) = ([0.0_f32; 3], 1e-9_f32);
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let (nx, ny) = (x + dx, y + dy);
                    if nx < 0 || ny < 0 || nx >= width as i32 || ny >= height as i32 {
                        continue;
                    }
                    let (color, n) = cells[ny as usize * width + nx as usize];
                    let weight = n * (-((dx * dx + dy * dy) as f32) / (2.0 * sigma * sigma)).exp();
                    for (s, c) in sum.iter_mut().zip(color) {
                        *s += weight * c;
                    }
                    total += weight;
                }
            }
            sum.map(|s| s / total)
        })
        .collect()
}

/// Fills the unobserved cells with the smooth field that leaves the observed ones and decays to the median (the
/// screened Laplace equation).
fn settle(cells: &mut [Color], observed: &[bool], (width, height): (usize, usize), median: Color, settling: f32) {
    let pull = 1.0 / (settling * settling);
    for _ in 0..300 {
        let mut most = 0.0_f32;
        for i in 0..cells.len() {
            if observed[i] {
                continue;
            }
            let (x, y) = (i % width, i / width);
            let mut sum = median.map(|m| m * pull);
            let mut n = pull;
            let around =
                [(x > 0, -1_i64), (x + 1 < width, 1), (y > 0, -(width as i64)), (y + 1 < height, width as i64)];
            for (ok, delta) in around {
                if ok {
                    let other = cells[(i as i64 + delta) as usize];
                    for (s, c) in sum.iter_mut().zip(other) {
                        *s += c;
                    }
                    n += 1.0;
                }
            }
            for (c, s) in cells[i].iter_mut().zip(sum) {
                let change = 1.7 * (s / n - *c);
                *c += change;
                most = most.max(change.abs());
            }
        }
        if most < 0.05 {
            break;
        }
    }
}
