//! How finely a photo shows a texture, and the detail that it cannot show.

use glam::{DMat2, DVec2};

use super::base::Color;

/// The fineness is looked up once a block of this many texels.
const BLOCK: usize = 8;
/// Finest part of a texel, in photo pixels, that counts as sharp.
const SHARP_PX: f64 = 0.6;
/// Texels that a photo pixel spans from which detail is lost.
const LOST: f64 = 1.5;
/// Most samples along a side of what a pixel spans.
const SAMPLES: usize = 10;
/// How far lost detail may change what the photo shows.
const RANGE: [f32; 2] = [0.5, 1.6];

/// How finely a photo shows the texels of a texture.
#[derive(Debug, Clone)]
pub struct Fineness {
    width: usize,
    /// Row of the whole texture that is the first one here.
    first: usize,
    /// Block by block: photo pixels of a texel's step to the right and down; `None` where the photo has no place of it.
    steps: Vec<Option<DMat2>>,
}

impl Fineness {
    /// Of a texture of so many texels; `place` is where the photo has a place of the texture, pixels of either.
    pub fn of(width: usize, height: usize, place: impl Fn(DVec2) -> Option<DVec2>) -> Self {
        let across = width.div_ceil(BLOCK);
        let steps = (0..across * height.div_ceil(BLOCK)).map(|i| {
            let middle = |k: usize| (k * BLOCK + BLOCK / 2) as f64 + 0.5;
            let at = DVec2::new(middle(i % across), middle(i / across));
            let (here, right, down) = (place(at)?, place(at + DVec2::X)?, place(at + DVec2::Y)?);
            Some(DMat2::from_cols(right - here, down - here))
        });
        Self { width, first: 0, steps: steps.collect() }
    }

    /// Of a texture that the photo shows texel by pixel.
    pub fn full(width: usize, height: usize) -> Self {
        Self::of(width, height, Some)
    }

    /// The same from a row on.
    #[must_use]
    pub fn from_row(&self, row: usize) -> Self {
        Self { first: self.first + row, ..self.clone() }
    }

    fn steps(&self, x: usize, y: usize) -> Option<&DMat2> {
        self.steps.get((y + self.first) / BLOCK * self.width.div_ceil(BLOCK) + x / BLOCK)?.as_ref()
    }

    /// Whether the photo shows a texel at least about as finely as the texture has it.
    pub fn is_sharp(&self, x: usize, y: usize) -> bool {
        self.steps(x, y).is_some_and(|s| s.x_axis.length().min(s.y_axis.length()) >= SHARP_PX)
    }

    /// What a pixel of the photo spans at a texel, along its two sides, texels; `None` where that is no more than one.
    fn span(&self, x: usize, y: usize) -> Option<DMat2> {
        let steps = self.steps(x, y).filter(|s| s.determinant().abs() > 1e-6)?;
        let span = steps.inverse();
        (span.x_axis.length().max(span.y_axis.length()) >= LOST).then_some(span)
    }

    /// What the photo has lost of a material at a texel, as a factor on what it shows: what a pixel averages stays. `of`
    /// is the material, as factors, over the whole texture of so many rows.
    pub(super) fn lost(&self, of: &[Color], x: usize, y: usize) -> Color {
        let Some(span) = self.span(x, y) else { return [1.0; 3] };
        let height = of.len() / self.width.max(1);
        let samples = |side: DVec2| (side.length().ceil() as usize).clamp(1, SAMPLES);
        let (n, m) = (samples(span.x_axis), samples(span.y_axis));
        let middle = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        let share = |k: usize, n: usize| (k as f64 + 0.5) / n as f64 - 0.5;
        let mut sum = [0.0_f32; 3];
        for (i, j) in (0..n).flat_map(|i| (0..m).map(move |j| (i, j))) {
            let at = middle + span * DVec2::new(share(i, n), share(j, m));
            let [u, v] = [at.x.clamp(0.0, self.width as f64 - 1.0), at.y.clamp(0.0, height as f64 - 1.0)];
            for (s, c) in sum.iter_mut().zip(of[v as usize * self.width + u as usize]) {
                *s += c;
            }
        }
        let own = of[y * self.width + x];
        std::array::from_fn(|c| (own[c] * (n * m) as f32 / sum[c].max(1e-3)).clamp(RANGE[0], RANGE[1]))
    }

    /// Whether the photo has lost detail of any of the texels.
    pub(super) fn loses(&self, mut texels: impl Iterator<Item = (usize, usize)>) -> bool {
        texels.any(|(x, y)| self.span(x, y).is_some())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dark lines, one texel wide, every `period` texels across.
    fn lines(width: usize, height: usize, period: usize) -> Vec<Color> {
        (0..width * height).map(|i| [if (i % width).is_multiple_of(period) { 0.4 } else { 1.0 }; 3]).collect()
    }

    #[test]
    fn lost_detail_is_what_a_pixel_averages_away_and_no_more() {
        let (width, height) = (96, 32);
        let of = lines(width, height, 16);
        // A pixel spans four texels across and one down.
        let coarse = Fineness::of(width, height, |p| Some(DVec2::new(p.x / 4.0, p.y)));
        assert!(!coarse.is_sharp(40, 10));
        let factor = |x: usize| coarse.lost(&of, x, 10)[0];
        assert!(factor(48) < 0.6 && factor(47) > 1.05 && (factor(56) - 1.0).abs() < 1e-6);
        // What the photo's pixel shows is as before: the factors times the averaged line average to it.
        let blurred = |x: usize| (0..4).map(|k| of[10 * width + x + k - 2][0]).sum::<f32>() / 4.0;
        let shown = (46..50).map(|x| factor(x) * blurred(x)).sum::<f32>() / 4.0;
        assert!((shown - 0.85).abs() < 0.08, "{shown}");
        let full = Fineness::full(width, height);
        assert!(full.is_sharp(40, 10) && full.lost(&of, 48, 10) == [1.0; 3]);
        assert!(!full.loses([(48, 10)].into_iter()) && coarse.loses([(48, 10)].into_iter()));
    }

    #[test]
    fn a_part_of_a_texture_has_the_fineness_of_its_rows() {
        let whole = Fineness::of(16, 64, |p| Some(DVec2::new(p.x, if p.y < 32.0 { p.y } else { p.y * 0.2 })));
        assert!(whole.is_sharp(5, 10) && !whole.is_sharp(5, 40));
        assert!(!whole.from_row(30).is_sharp(5, 10));
        assert!(!Fineness::of(16, 16, |_| None).is_sharp(0, 0));
    }
}
