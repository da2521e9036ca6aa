//! A picture with a hole, and its pyramid.

/// Colour of a pixel, 0 to 255 a channel; the fourth lane is unused (alignment).
pub(crate) type Texel = [f32; 4];

/// A picture to complete.
#[derive(Debug, Clone)]
pub(crate) struct Canvas {
    pub width: usize,
    pub height: usize,
    /// Colours; those of the hole are guesses.
    pub pixels: Vec<Texel>,
    /// To be filled.
    pub hole: Vec<bool>,
    /// May be copied from.
    pub source: Vec<bool>,
    /// A pixel is filled from pixels of its own label.
    pub label: Vec<u8>,
}

impl Canvas {
    /// Half the size: known pixels are averaged; a block with any hole is hole, with any non-source no source.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut half = Self {
            width,
            height,
            pixels: Vec::with_capacity(width * height),
            hole: Vec::with_capacity(width * height),
            source: Vec::with_capacity(width * height),
            label: Vec::with_capacity(width * height),
        };
        for y in 0..height {
            for x in 0..width {
                let (mut known, mut all) = (([0.0; 4], 0.0), ([0.0; 4], 0.0));
                let (mut hole, mut source) = (false, true);
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (sx, sy) = ((2 * x + dx).min(self.width - 1), (2 * y + dy).min(self.height - 1));
                    let i = sy * self.width + sx;
                    for (sum, on) in [(&mut all, true), (&mut known, !self.hole[i])] {
                        if on {
                            for (s, c) in sum.0.iter_mut().zip(self.pixels[i]) {
                                *s += c;
                            }
                            sum.1 += 1.0;
                        }
                    }
                    hole |= self.hole[i];
                    source &= self.source[i];
                }
                let (sum, n): (Texel, f32) = if known.1 > 0.0 { known } else { all };
                half.pixels.push(sum.map(|s| s / n));
                half.hole.push(hole);
                half.source.push(source);
                half.label.push(self.label[2 * y * self.width + 2 * x]);
            }
        }
        half
    }

    /// First guess for the hole: the smoothest surface through what is known of the same label (Laplace's equation),
    /// through everything known where the label has nothing.
    ///
    /// Meant for small pictures: the solver is plain successive over-relaxation.
    pub(super) fn fill_smoothly(&mut self) {
        let mut has_known = [false; 256];
        for ((hole, source), label) in self.hole.iter().zip(&self.source).zip(&self.label) {
            has_known[*label as usize] |= !hole && *source;
        }
        let any_source = has_known.contains(&true);
        // Which pixels hold the surface: sources; everything outside the hole when nothing is a source.
        let firm: Vec<bool> = self.hole.iter().zip(&self.source).map(|(h, s)| !h && (*s || !any_source)).collect();
        let mut mean = vec![([0.0_f64; 3], 0.0_f64); 256];
        let mut total = ([0.0_f64; 3], 0.0_f64);
        for (i, on) in firm.iter().enumerate() {
            if *on {
                for sum in [&mut mean[self.label[i] as usize], &mut total] {
                    for (s, c) in sum.0.iter_mut().zip(self.pixels[i]) {
                        *s += f64::from(c);
                    }
                    sum.1 += 1.0;
                }
            }
        }
        if total.1 == 0.0 {
            return;
        }
        for i in 0..self.pixels.len() {
            if self.hole[i] {
                let (sum, n) = match mean[self.label[i] as usize] {
                    m if m.1 > 0.0 => m,
                    _ => total,
                };
                self.pixels[i] = [(sum[0] / n) as f32, (sum[1] / n) as f32, (sum[2] / n) as f32, 0.0];
            }
        }
        let (w, h) = (self.width, self.height);
        let joined = |a: usize, b: usize| {
            (self.hole[b] || firm[b]) && (self.label[a] == self.label[b] || !has_known[self.label[a] as usize])
        };
        // Neighbours that count, fixed before the sweeps.
        let cells: Vec<(usize, [usize; 4], usize)> = (0..w * h)
            .filter(|i| self.hole[*i])
            .map(|i| {
                let (x, y) = (i % w, i / w);
                let mut next = [0; 4];
                let mut n = 0;
                let around = [
                    (x > 0).then(|| i - 1),
                    (x + 1 < w).then(|| i + 1),
                    (y > 0).then(|| i - w),
                    (y + 1 < h).then(|| i + w),
                ];
                for j in around.into_iter().flatten() {
                    if joined(i, j) {
                        next[n] = j;
                        n += 1;
                    }
                }
                (i, next, n)
            })
            .filter(|cell| cell.2 > 0)
            .collect();
        for sweep in 0..400 {
            let over = if sweep < 4 { 1.0 } else { 1.85 };
            let mut most = 0.0_f32;
            let mut relax = |(i, next, n): &(usize, [usize; 4], usize)| {
                for c in 0..3 {
                    let mean = next[..*n].iter().map(|j| self.pixels[*j][c]).sum::<f32>() / *n as f32;
                    let change = over * (mean - self.pixels[*i][c]);
                    self.pixels[*i][c] += change;
                    most = most.max(change.abs());
                }
            };
            if sweep % 2 == 0 {
                cells.iter().for_each(&mut relax);
            } else {
                cells.iter().rev().for_each(&mut relax);
            }
            if most < 0.02 {
                break;
            }
        }
    }

    /// Takes the hole's colours from a picture of half the size, interpolated.
    pub(super) fn guess_from_half(&mut self, half: &Self) {
        for y in 0..self.height {
            for x in 0..self.width {
                let i = y * self.width + x;
                if self.hole[i] {
                    self.pixels[i] = half.sample(x as f32 / 2.0 - 0.25, y as f32 / 2.0 - 0.25);
                }
            }
        }
    }

    /// Bilinear colour; (0, 0) is the centre of the first pixel here. Kept inside the picture.
    pub(super) fn sample(&self, x: f32, y: f32) -> Texel {
        let x = x.clamp(0.0, (self.width - 1) as f32);
        let y = y.clamp(0.0, (self.height - 1) as f32);
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (tx, ty) = (x - x0 as f32, y - y0 as f32);
        let at = |x: usize, y: usize| &self.pixels[y * self.width + x];
        std::array::from_fn(|c| {
            let top = at(x0, y0)[c] * (1.0 - tx) + at(x1, y0)[c] * tx;
            let bottom = at(x0, y1)[c] * (1.0 - tx) + at(x1, y1)[c] * tx;
            top * (1.0 - ty) + bottom * ty
        })
    }
}
