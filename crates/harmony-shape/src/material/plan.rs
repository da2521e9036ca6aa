//! What a pattern's numbers mean when they are left out, how large its tile is, and what share each colour has.

use super::color::{linear_hex, luminance};
use super::noise::unit;
use super::space::{Rgb, Space, times};
use super::{Pattern, PatternKind as K};

/// Largest side of a tile's image, pixels.
pub(super) const MAX_PX: f64 = 1024.0;
/// Usual side, pixels.
const USUAL_PX: f64 = 512.0;
/// Lengths that a pattern may have, metres.
const LENGTHS: std::ops::RangeInclusive<f64> = 2e-4..=8.0;

fn or(value: f64, default: f64) -> f64 {
    if value.is_finite() && value > 0.0 { value.clamp(*LENGTHS.start(), *LENGTHS.end()) } else { default }
}

/// Usual width of a kind, metres.
fn usual_width(p: &Pattern) -> f64 {
    match p.kind {
        K::Planks => 0.14,
        K::Parquet => match p.variant.as_str() {
            "basket" | "mosaic" | "squares" => 0.05,
            "chevron" => 0.09,
            _ => 0.07,
        },
        K::Tiles => match p.variant.as_str() {
            "hex" => 0.15,
            "running" | "metro" => 0.20,
            _ => 0.30,
        },
        K::Brick => 0.225,
        K::Checks => 0.10,
        K::Stripes => 0.05,
        K::Dots => 0.06,
        K::Motif => 0.12,
        K::Weave => 0.0012,
        K::Knit => 0.006,
        K::Terry => 0.0022,
        K::Boucle => 0.007,
        K::Pile => {
            if p.variant == "shag" {
                0.012
            } else {
                0.004
            }
        }
        K::Leather => 0.0022,
        K::Wood => 0.22,
        K::Marble => 0.60,
        K::Terrazzo => 0.018,
        K::Concrete => 0.90,
        K::Plaster => 0.25,
        K::Rattan => 0.008,
        K::Corrugated => 0.076,
        K::Quilting => 0.10,
        K::Grime => 0.50,
        K::Ramp => 1.0,
        K::Over | K::Tint => 0.3,
    }
}

/// Width, metres.
pub(super) fn width(p: &Pattern) -> f64 {
    if p.kind == K::Brick {
        return brick(p).0;
    }
    or(p.width, usual_width(p))
}

/// Length, metres.
pub(super) fn length(p: &Pattern) -> f64 {
    let w = width(p);
    let usual = match p.kind {
        K::Planks => (w * 9.0).clamp(0.9, 1.8),
        K::Parquet => match p.variant.as_str() {
            "basket" | "mosaic" | "squares" => 4.0 * w,
            "chevron" => 6.0 * w,
            _ => 5.0 * w,
        },
        K::Brick => return brick(p).1,
        K::Tiles if matches!(p.variant.as_str(), "running" | "metro") => w / 2.0,
        _ => w,
    };
    or(p.length, usual)
}

/// A brick's length and height with its joint, however the two were named.
fn brick(p: &Pattern) -> (f64, f64) {
    let (a, b) = (or(p.width, 0.0), or(p.length, 0.0));
    match (a > 0.0, b > 0.0) {
        (true, true) => (a.max(b), a.min(b)),
        (true, false) if a < 0.12 => (3.0 * a, a),
        (true, false) => (a, a / 3.0),
        (false, true) if b < 0.12 => (3.0 * b, b),
        (false, true) => (b, b / 3.0),
        _ => (0.225, 0.075),
    }
}

/// Width of joints or of what is second, metres.
pub(super) fn joint(p: &Pattern, default: f64) -> f64 {
    or(p.joint, default)
}

/// Amount, 0 to 1.
pub(super) fn amount(p: &Pattern, default: f64) -> f64 {
    if p.amount.is_finite() && p.amount > 0.0 { p.amount.min(1.0) } else { default }
}

/// Standard deviation of the pieces' tone, as natural logarithm of linear light.
pub(super) const SIGMA_OF_TONE: f64 = 0.35;

/// Spread of the pieces' tone; `default` where none is given.
pub(super) fn tone_sigma(p: &Pattern, default: f64) -> f64 {
    SIGMA_OF_TONE * if p.tone.is_finite() && p.tone > 0.0 { p.tone.min(1.0) } else { default }
}

/// Joint of tiles and bricks, metres.
pub(super) fn masonry_joint(p: &Pattern) -> f64 {
    joint(p, if p.kind == K::Brick { 0.010 } else { 0.003 })
}

/// Whether the last of a pattern's colours is the joints'.
pub(super) fn has_joint_color(p: &Pattern) -> bool {
    match p.kind {
        K::Planks | K::Parquet => p.joint > 0.0 && p.colors.len() >= 2,
        K::Tiles if p.variant == "checkerboard" => p.colors.len() >= 3,
        K::Tiles | K::Brick => p.colors.len() >= 2,
        _ => false,
    }
}

/// Colours of a pattern, linear.
#[derive(Debug, Clone)]
pub(super) struct Palette {
    /// Of pieces; at least one.
    pub main: Vec<Rgb>,
    /// Of what lies between them.
    pub joint: Rgb,
}

impl Palette {
    /// The pattern's own colours, else the slot's; `with_joint`: the last one of several is the joint's, else the joint
    /// is derived from the first.
    pub(super) fn of(p: &Pattern, space: &Space, with_joint: bool, derived: impl Fn(Rgb) -> Rgb) -> Self {
        let mut main: Vec<Rgb> = p.colors.iter().map(|c| linear_hex(c)).collect();
        if main.is_empty() {
            main.push(space.slot);
        }
        let own = if with_joint && main.len() >= 2 { main.pop() } else { None };
        Self { joint: own.unwrap_or_else(|| derived(main[0])), main }
    }

    /// One of the colours for a piece.
    pub(super) fn pick(&self, id: u64) -> Rgb {
        let n = self.main.len();
        self.main[((unit(id, 77) * n as f64) as usize).min(n - 1)]
    }
}

/// `n` colours: those given, or lighter and darker ones of the slot whose mean is the slot's colour.
pub(super) fn pair(p: &Pattern, space: &Space, contrast: f64) -> Vec<Rgb> {
    let given: Vec<Rgb> = p.colors.iter().map(|c| linear_hex(c)).collect();
    if given.len() >= 2 {
        return given;
    }
    let mean = given.first().copied().unwrap_or(space.slot);
    // A light slot gives way downwards only.
    let up = (0.92 / luminance(mean).max(0.02) - 1.0).clamp(0.0, contrast);
    vec![times(mean, 1.0 + up), times(mean, 1.0 - contrast)]
}

/// The colour that the whole has in the mean, linear; `None` where only the pattern itself can tell.
pub(super) fn mean(p: &Pattern, slot: Rgb) -> Option<Rgb> {
    if matches!(p.kind, K::Over | K::Tint) {
        return None;
    }
    match p.colors.len() {
        0 => Some(slot),
        1 => Some(linear_hex(&p.colors[0])),
        _ => {
            let shares = shares(p);
            let all: f64 = shares.iter().sum();
            let mut sum = [0.0; 3];
            for (c, s) in p.colors.iter().zip(&shares) {
                let c = linear_hex(c);
                for (t, v) in sum.iter_mut().zip(c) {
                    *t += v * s / all;
                }
            }
            Some(sum)
        }
    }
}

/// Share of each of two or more colours in the surface.
pub(super) fn shares(p: &Pattern) -> Vec<f64> {
    let n = p.colors.len();
    let first = |share: f64| -> Vec<f64> {
        (0..n).map(|k| if k == 0 { share } else { (1.0 - share) / (n - 1) as f64 }).collect()
    };
    match p.kind {
        K::Planks | K::Parquet | K::Tiles | K::Brick if has_joint_color(p) => {
            let j = masonry_joint(p);
            let (w, l) = (width(p), length(p));
            let share = match p.kind {
                K::Planks | K::Parquet => 0.85 * (j / w + j / l),
                _ => 1.0 - (1.0 - j / w).max(0.0) * (1.0 - j / l).max(0.0),
            }
            .clamp(0.0, 0.9);
            (0..n).map(|k| if k == n - 1 { share } else { (1.0 - share) / (n - 1) as f64 }).collect()
        }
        K::Checks | K::Weave => (0..n).map(|k| if k < 2 { 0.5 } else { 0.0 }).collect(),
        K::Stripes => stripe_widths(p),
        K::Dots => first(1.0 - dot_share(p)),
        K::Motif => first(1.0 - motif_share(p)),
        K::Leather | K::Corrugated | K::Quilting => first(1.0),
        K::Wood => first(0.75),
        K::Marble => first(1.0 - 0.22 * amount(p, 0.5)),
        K::Terrazzo => first(1.0 - chip_share(p)),
        _ => vec![1.0; n],
    }
}

/// Widths of stripes, metres; two at least.
pub(super) fn stripe_widths(p: &Pattern) -> Vec<f64> {
    let w = width(p);
    let second = joint(p, w);
    (0..p.colors.len().max(2)).map(|k| if k % 2 == 1 { second } else { w }).collect()
}

/// Diameter of dots, metres.
pub(super) fn dot_diameter(p: &Pattern) -> f64 {
    joint(p, 0.45 * width(p)).min(0.95 * width(p))
}

fn dot_share(p: &Pattern) -> f64 {
    let r = dot_diameter(p) / 2.0 / width(p);
    // A staggered pattern has two dots a square of the pitch; see `prints::dots`.
    let dots = if p.variant == "grid" { 1.0 } else { 2.0 };
    (std::f64::consts::PI * r * r * dots).min(0.9)
}

fn motif_share(p: &Pattern) -> f64 {
    let loops = super::prints::outline(p);
    let w = width(p);
    (super::prints::area(&loops) / (w * w)).clamp(0.0, 0.9)
}

/// Share of chips in terrazzo.
pub(super) fn chip_share(p: &Pattern) -> f64 {
    0.25 + 0.45 * amount(p, 0.5)
}

/// A tile's size and texel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plan {
    /// Width and height, metres.
    pub size: [f64; 2],
    /// Size of the images, pixels.
    pub px: [u32; 2],
}

/// What repeats, metres across and down, and the texel that shows it.
fn unit_of(p: &Pattern) -> ([f64; 2], f64) {
    let (w, l) = (width(p), length(p));
    let root = std::f64::consts::SQRT_2;
    // Fine enough for joints of small pieces, coarse enough for large ones to repeat often.
    let floor = |w: f64| (w / 60.0).clamp(0.0005, 0.002);
    match p.kind {
        K::Planks => match p.variant.as_str() {
            "half" | "brick" | "running" => ([l, 2.0 * w], floor(w)),
            "third" => ([l, 3.0 * w], floor(w)),
            _ => ([l, w], floor(w)),
        },
        K::Parquet => match p.variant.as_str() {
            "chevron" => ([l * root, w * root], floor(w)),
            "basket" | "mosaic" | "squares" => ([2.0 * l, 2.0 * l], floor(w)),
            _ => ([w * root * super::boards::block_count(p) as f64, w * root], floor(w)),
        },
        K::Tiles => match p.variant.as_str() {
            "running" | "metro" => ([w, 2.0 * l], floor(w.min(l))),
            "diagonal" => ([w * root, w * root], floor(w)),
            "hex" => ([w, w * 3.0_f64.sqrt()], floor(w)),
            "checkerboard" => ([2.0 * w, 2.0 * l], floor(w.min(l))),
            _ => ([w, l], floor(w.min(l))),
        },
        K::Brick => match p.variant.as_str() {
            "flemish" => ([1.5 * w, 2.0 * l], 0.002),
            "stack" => ([w, l], 0.002),
            "third" => ([w, 3.0 * l], 0.002),
            _ => ([w, 2.0 * l], 0.002),
        },
        K::Checks => ([2.0 * w; 2], floor(2.0 * w)),
        K::Stripes => {
            let all = stripe_widths(p).iter().sum::<f64>();
            ([all, all], floor(all))
        }
        K::Dots => ([w; 2], floor(w)),
        K::Motif => ([w; 2], floor(w)),
        K::Weave => ([12.0 * w; 2], (w / 5.0).clamp(0.000_15, 0.001)),
        K::Knit => ([w, w * 0.75], (w / 16.0).clamp(0.0002, 0.001)),
        K::Terry => ([8.0 * w; 2], (w / 6.0).clamp(0.0002, 0.001)),
        K::Boucle => ([4.0 * w; 2], (w / 14.0).clamp(0.0003, 0.001)),
        K::Pile => ([8.0 * w; 2], (w / 5.0).clamp(0.0004, 0.002)),
        K::Leather => ([8.0 * w; 2], (w / 8.0).clamp(0.000_15, 0.001)),
        K::Wood => ([1.2, w], 0.0012),
        K::Marble => ([2.0 * w; 2], (w / 300.0).clamp(0.0005, 0.002)),
        K::Terrazzo => ([10.0 * w; 2], (w / 16.0).clamp(0.0004, 0.002)),
        K::Concrete => ([1.5 * w; 2], 0.0025),
        K::Plaster => ([4.0 * w; 2], 0.002),
        K::Rattan => ([2.0 * w; 2], (w / 16.0).clamp(0.0003, 0.001)),
        K::Corrugated => ([w; 2], (w / 32.0).clamp(0.0005, 0.002)),
        K::Quilting => {
            ([w, w * if p.variant == "diamond" { 3.0_f64.sqrt() } else { 1.0 }], (w / 100.0).clamp(0.0005, 0.002))
        }
        K::Grime => ([2.0 * w; 2], 0.002),
        K::Ramp => ([0.5, 2.0 * l], (2.0 * l / 512.0).max(0.002)),
        K::Over | K::Tint => ([0.3; 2], 0.002),
    }
}

/// Whole repeats that fill about the usual image at a texel, two at least where they fit.
fn repeats(unit: f64, texel: f64, least: f64) -> f64 {
    let n = (USUAL_PX * 1.25 * texel / unit).floor().max(least);
    n.min((MAX_PX * texel / unit).floor().max(1.0))
}

/// How a pattern's tile is cut.
pub(super) fn plan(p: &Pattern, texel: Option<f64>) -> Plan {
    let (size, own) = tile_size(p, texel);
    let texel = texel.unwrap_or(own);
    let px = size.map(|s| (s / texel).round().clamp(16.0, MAX_PX) as u32);
    Plan { size, px }
}

fn tile_size(p: &Pattern, texel: Option<f64>) -> ([f64; 2], f64) {
    if let (K::Over | K::Tint, Some(below)) = (p.kind, p.below()) {
        let (mut size, own) = tile_size(below, texel);
        if p.kind == K::Over {
            // What lies above, and the mask, need some repeats too: the tile below is repeated.
            for other in p.layers.first().into_iter().chain(p.layers.get(2)) {
                let (own, _) = tile_size(other, texel);
                for (s, a) in size.iter_mut().zip(own) {
                    *s *= (a / *s).round().max(1.0);
                }
            }
        }
        // Relief below stays resolved as far as the largest image allows.
        return (size, own);
    }
    let (unit, own) = unit_of(p);
    let t = texel.unwrap_or(own);
    let least = match p.kind {
        K::Planks => [2.0, 6.0],
        K::Motif => [3.0, 3.0],
        K::Wood | K::Marble | K::Concrete | K::Ramp | K::Grime => [1.0, 2.0],
        _ => [2.0, 2.0],
    };
    let size = std::array::from_fn(|k| {
        // A long repeat is drawn coarser rather than once.
        let n = repeats(unit[k], t, least[k]).max(least[k].min(2.0));
        let n = if p.kind == K::Ramp || unit[k] > 2.5 { 1.0 } else { n };
        unit[k] * n
    });
    (size, own)
}
