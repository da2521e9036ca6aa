//! Colours and procedural textures.

use std::sync::Arc;

use harmony_mesh::{Material, linear_rgb};
use image::{Rgba, RgbaImage};

use super::dice::{Dice, hash_unit};

/// An sRGB colour.
pub(super) type Rgb = [u8; 3];

const WOODS: [Rgb; 9] = [
    [176, 128, 82],
    [140, 92, 54],
    [92, 58, 38],
    [201, 164, 116],
    [222, 196, 158],
    [66, 46, 38],
    [158, 112, 74],
    [120, 104, 88],
    [232, 226, 214],
];
const FABRICS: [Rgb; 16] = [
    [96, 112, 132],
    [168, 150, 128],
    [206, 198, 184],
    [92, 104, 78],
    [156, 76, 60],
    [56, 70, 98],
    [128, 128, 130],
    [190, 148, 74],
    [70, 98, 100],
    [214, 184, 172],
    [112, 62, 74],
    [58, 58, 62],
    [148, 168, 170],
    [226, 218, 202],
    [176, 104, 84],
    [104, 86, 118],
];
const WALLS: [Rgb; 14] = [
    [232, 228, 218],
    [214, 206, 190],
    [198, 208, 206],
    [176, 190, 172],
    [202, 178, 148],
    [150, 168, 182],
    [222, 204, 194],
    [118, 136, 118],
    [206, 206, 210],
    [236, 224, 196],
    [168, 148, 150],
    [96, 118, 134],
    [196, 156, 132],
    [240, 238, 234],
];
const METALS: [Rgb; 5] = [[50, 50, 52], [168, 170, 172], [186, 152, 92], [120, 90, 66], [226, 226, 224]];
const GLAZES: [Rgb; 10] = [
    [236, 232, 224],
    [68, 104, 132],
    [170, 92, 64],
    [88, 120, 96],
    [210, 176, 110],
    [52, 56, 64],
    [154, 176, 188],
    [196, 126, 120],
    [122, 100, 132],
    [226, 208, 180],
];

/// The colours that a room keeps to.
#[derive(Debug, Clone)]
pub(super) struct Palette {
    /// Main and second wood.
    pub(super) woods: [Rgb; 2],
    /// Upholstery, bedding, accents.
    pub(super) fabrics: [Rgb; 4],
    /// Handles and thin legs.
    pub(super) metal: Rgb,
    /// Paint of the walls and of the back wall.
    pub(super) walls: [Rgb; 2],
    /// Painted wood: skirting, window frames, doors.
    pub(super) trim: Rgb,
}

impl Palette {
    pub(super) fn new(dice: &mut Dice) -> Self {
        let mut fabrics = [[0; 3]; 4];
        for f in &mut fabrics {
            *f = vary(dice, FABRICS, 12.0);
        }
        let wall = vary(dice, WALLS, 10.0);
        let accent = if dice.chance(0.45) { vary(dice, WALLS, 10.0) } else { wall };
        let trim = if dice.chance(0.75) { vary(dice, [[238, 236, 230]], 8.0) } else { vary(dice, WOODS, 8.0) };
        Self {
            woods: [vary(dice, WOODS, 10.0), vary(dice, WOODS, 10.0)],
            fabrics,
            metal: vary(dice, METALS, 6.0),
            walls: [wall, accent],
            trim,
        }
    }

    /// One of the woods, now and then another one or a paint.
    pub(super) fn wood(&self, dice: &mut Dice) -> Rgb {
        match dice.int(0, 9) {
            0..=5 => self.woods[0],
            6 | 7 => self.woods[1],
            8 => vary(dice, WOODS, 10.0),
            _ => vary(dice, WALLS, 10.0),
        }
    }

    /// One of the fabrics.
    pub(super) fn fabric(&self, dice: &mut Dice) -> Rgb {
        if dice.chance(0.85) { dice.pick(&self.fabrics) } else { vary(dice, FABRICS, 12.0) }
    }

    /// A glaze for vases, bowls and pots.
    #[expect(clippy::unused_self, reason = "asked of the palette as the others are")]
    pub(super) fn glaze(&self, dice: &mut Dice) -> Rgb {
        vary(dice, GLAZES, 14.0)
    }
}

fn vary<const N: usize>(dice: &mut Dice, list: [Rgb; N], spread: f64) -> Rgb {
    let base = dice.pick(&list);
    let shift = dice.bell() * spread;
    base.map(|c| (f64::from(c) + shift + dice.bell() * spread * 0.3).clamp(8.0, 250.0) as u8)
}

/// A colour made lighter (above 1) or darker.
pub(super) fn scaled(color: Rgb, k: f32) -> Rgb {
    color.map(|c| (f32::from(c) * k).clamp(0.0, 255.0) as u8)
}

/// A material and how its texture lies.
#[derive(Debug, Clone)]
pub(super) struct Look {
    pub(super) material: Material,
    /// Metres that the texture covers; 0 = stretched once over the patch.
    pub(super) tile: f32,
}

impl Look {
    /// One colour.
    pub(super) fn plain(name: &str, color: Rgb, roughness: f32) -> Self {
        let mut material = Material::plain(name, linear_rgb(color));
        material.roughness = roughness;
        Self { material, tile: 1.0 }
    }

    /// Painted or polished smooth.
    pub(super) fn gloss(name: &str, color: Rgb) -> Self {
        Self::plain(name, color, 0.25)
    }

    /// A metal.
    pub(super) fn metal(color: Rgb) -> Self {
        let mut look = Self::plain("metal", color, 0.3);
        look.material.metallic = 0.8;
        look
    }

    /// Wood with grain along the texture's u.
    pub(super) fn wood(dice: &mut Dice, color: Rgb) -> Self {
        let seed = dice.number();
        let contrast = dice.f(0.10, 0.28);
        let image = draw(128, 128, |u, v| {
            let bend = noise(u, v, 2, 4, seed) * 0.35;
            let grain = noise(u, v + bend * 0.1, 3, 40, seed ^ 1);
            let rings = ((v + bend * 0.25) * std::f32::consts::TAU * 5.0).sin() * 0.5 + 0.5;
            shade(color, 1.0 - contrast + contrast * (0.9 * grain + 0.6 * rings))
        });
        Self::textured("wood", image, 0.55, 0.7)
    }

    /// Cloth: a weave, stripes or a print.
    pub(super) fn fabric(dice: &mut Dice, color: Rgb) -> Self {
        let seed = dice.number();
        let pattern = dice.int(0, 6);
        let second = if dice.chance(0.5) { scaled(color, 0.72) } else { vary(dice, FABRICS, 10.0) };
        let image = draw(128, 128, |u, v| {
            let base = match pattern {
                0 if ((u * 8.0) as u32).is_multiple_of(2) => second,
                1 if ((u * 6.0) as u32 + (v * 6.0) as u32).is_multiple_of(2) => second,
                2 if (u * 5.0).fract() < 0.18 || (v * 5.0).fract() < 0.18 => second,
                _ => color,
            };
            let k = 0.86 + 0.14 * hash_unit((u * 128.0) as u32, (v * 128.0) as u32, seed);
            shade(base, k * (0.92 + 0.14 * noise(u, v, 4, 4, seed)))
        });
        Self::textured("fabric", image, 0.9, dice.f(0.3, 0.6))
    }

    /// A texture that covers `tile` metres.
    pub(super) fn textured(name: &str, image: RgbaImage, roughness: f32, tile: f32) -> Self {
        let mut look = Self::plain(name, [255; 3], roughness);
        look.material.texture = Some(Arc::new(image));
        look.tile = tile;
        look
    }

    /// A texture laid once over the patch.
    pub(super) fn picture(name: &str, image: RgbaImage) -> Self {
        Self::textured(name, image, 0.6, 0.0)
    }

    /// Gives light: `strength` times the colour, whatever shines on it.
    pub(super) fn glow(name: &str, color: Rgb, strength: f32) -> Self {
        let mut look = Self::plain(name, [0; 3], 0.9);
        look.material.emissive = linear_rgb(color).map(|c| c * strength);
        look
    }
}

/// An image from a function of (u, v) at the pixel centres.
pub(super) fn draw(width: u32, height: u32, f: impl Fn(f32, f32) -> Rgb) -> RgbaImage {
    RgbaImage::from_fn(width, height, |x, y| {
        let [r, g, b] = f((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
        Rgba([r, g, b, 255])
    })
}

/// A colour times a factor.
pub(super) fn shade(color: Rgb, k: f32) -> Rgb {
    scaled(color, k)
}

/// Smooth value noise in 0..1 that wraps around with u and v.
pub(super) fn noise(u: f32, v: f32, nu: u32, nv: u32, seed: u32) -> f32 {
    let (x, y) = (u.rem_euclid(1.0) * nu as f32, v.rem_euclid(1.0) * nv as f32);
    let (i, j) = (x as u32, y as u32);
    let soft = |t: f32| t * t * (3.0 - 2.0 * t);
    let (s, t) = (soft(x.fract()), soft(y.fract()));
    let at = |di: u32, dj: u32| hash_unit((i + di) % nu, (j + dj) % nv, seed);
    let low = at(0, 0) + (at(1, 0) - at(0, 0)) * s;
    let high = at(0, 1) + (at(1, 1) - at(0, 1)) * s;
    low + (high - low) * t
}
