//! What a slot looks like by its material alone, in the colour that was observed.

use std::sync::Arc;

use glam::Vec2;
use harmony_mesh::{Mesh, Tile};

use super::texels::Texel;
use crate::mips::Pyramid;
use crate::srgb::tables;

/// Least weight of observed texels that gives a slot its colour.
const ENOUGH: f32 = 8.0;
/// Largest factor on a channel, and its reciprocal the least.
const LARGEST: f32 = 6.0;
/// Share of the darkest and of the brightest observations that are left out of the mean.
const TRIM: f32 = 0.2;

/// A slot's material.
#[derive(Debug)]
pub(super) struct Base {
    /// Linear.
    color: [f32; 3],
    tile: Option<(Arc<Pyramid>, Vec2)>,
    /// On the linear colour, to meet what was observed.
    gain: [f32; 3],
}

/// The materials of a mesh.
pub(super) fn of(mesh: &Mesh) -> Vec<Base> {
    let metric = mesh.metric_uvs.len() == mesh.positions.len();
    mesh.materials
        .iter()
        .map(|m| {
            let usable = |t: &&Arc<Tile>| metric && m.texture.is_none() && t.size.iter().all(|s| *s > 1e-6);
            let tile = m.tile.as_ref().filter(usable);
            let [r, g, b, _] = m.base_color;
            Base {
                color: [r, g, b],
                tile: tile.map(|t| (Arc::new(Pyramid::new(Arc::clone(&t.color))), Vec2::from_array(t.size).recip())),
                gain: [1.0; 3],
            }
        })
        .collect()
}

impl Base {
    /// Whether it has a pattern of its own.
    pub(super) fn is_tiled(&self) -> bool {
        self.tile.is_some()
    }

    fn plain(&self, texel: &Texel) -> [f32; 3] {
        let Some((tile, per_metre)) = &self.tile else { return self.color };
        let uv = texel.metric * *per_metre;
        let (w, h) = tile.size();
        let size = Vec2::new(w, h);
        let footprint = texel.metric_steps.map(|s| (s * *per_metre * size).length_squared());
        let t = tile.sample(uv.x - uv.x.floor(), uv.y - uv.y.floor(), footprint[0].max(footprint[1]));
        [0, 1, 2].map(|k| t[k] * self.color[k])
    }

    /// sRGB colour of a texel, 0 to 255.
    pub(super) fn at(&self, texel: &Texel) -> [f32; 3] {
        let c = self.plain(texel);
        [0, 1, 2].map(|k| srgb(c[k] * self.gain[k]))
    }

    /// sRGB mean colour by the material, 0 to 255.
    pub(super) fn named(&self) -> [f32; 3] {
        let t = self.tile.as_ref().map_or([1.0; 4], |(tile, _)| tile.sample(0.5, 0.5, f32::MAX));
        [0, 1, 2].map(|k| srgb(t[k] * self.color[k]))
    }

    /// Linear mean colour by the material.
    pub(super) fn linear(&self) -> [f32; 3] {
        let t = self.tile.as_ref().map_or([1.0; 4], |(tile, _)| tile.sample(0.5, 0.5, f32::MAX));
        [0, 1, 2].map(|k| t[k] * self.color[k])
    }

    /// Takes the robust mean of what was observed of the slot.
    ///
    /// The mean of the material is taken over the same texels, so that what is seen of a pattern by chance does not matter.
    ///
    /// Returns whether enough was observed.
    pub(super) fn meet(&mut self, seen: &[&Texel]) -> bool {
        let weight = |t: &Texel| t.share;
        let total: f32 = seen.iter().map(|t| weight(t)).sum();
        if total < ENOUGH {
            return false;
        }
        // By luminance, so that a texel is in or out as a whole.
        let mut order: Vec<(&Texel, [f32; 3])> = seen.iter().filter_map(|t| Some((*t, t.color?.map(linear)))).collect();
        let luminance = |c: &[f32; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        order.sort_by(|a, b| luminance(&a.1).total_cmp(&luminance(&b.1)).then(a.0.at.cmp(&b.0.at)));
        // A pattern's darkest texels are part of it.
        let trim = if self.is_tiled() { 0.02 } else { TRIM };
        let (mut below, mut observed, mut own, mut kept) = (0.0, [0.0; 3], [0.0; 3], 0.0);
        for (texel, color) in order {
            let w = weight(texel);
            below += w;
            if below < trim * total || below - w > (1.0 - trim) * total {
                continue;
            }
            let plain = self.plain(texel);
            for k in 0..3 {
                observed[k] += w * color[k];
                own[k] += w * plain[k];
            }
            kept += w;
        }
        if kept > 0.0 {
            // A little is added, so that black materials can become dark ones.
            let air = 0.002 * kept;
            self.gain = [0, 1, 2].map(|k| ((observed[k] + air) / (own[k] + air)).clamp(1.0 / LARGEST, LARGEST));
            if self.tile.is_none() {
                self.color = [0, 1, 2].map(|k| observed[k] / kept);
                self.gain = [1.0; 3];
            }
        }
        true
    }

    /// Takes an sRGB colour as the mean: for a slot that is seen by too few texels to meet, where the model's is far off.
    pub(super) fn take(&mut self, rgb: [u8; 3]) {
        let mean = self.linear();
        let wanted = rgb.map(|c| linear(f32::from(c)));
        if self.tile.is_none() {
            self.color = wanted;
        } else {
            self.gain = [0, 1, 2].map(|k| ((wanted[k] + 0.002) / (mean[k] + 0.002)).clamp(1.0 / LARGEST, LARGEST));
        }
    }

    /// Largest difference, in any channel, of an sRGB colour from the material's mean, sRGB steps.
    pub(super) fn off(&self, rgb: [u8; 3]) -> f32 {
        let named = self.named();
        (0..3).map(|k| (named[k] - f32::from(rgb[k])).abs()).fold(0.0, f32::max)
    }
}

/// sRGB, 0 to 255, of a linear value.
pub(super) fn srgb(linear: f32) -> f32 {
    let c = linear.clamp(0.0, 1.0);
    255.0 * if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

/// Linear value of an sRGB one, 0 to 255.
pub(super) fn linear(srgb: f32) -> f32 {
    tables().decode[srgb.round().clamp(0.0, 255.0) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use harmony_mesh::Material;

    fn texel(color: [f32; 3]) -> Texel {
        Texel {
            at: 0,
            slot: 0,
            point: Vec3::ZERO,
            normal: Vec3::Y,
            steps: [Vec3::X, Vec3::Z],
            metric: Vec2::ZERO,
            metric_steps: [Vec2::ZERO; 2],
            chart: 0,
            color: Some(color),
            weight: 1.0,
            direct: true,
            share: 1.0,
        }
    }

    fn plain(linear: [f32; 3]) -> Base {
        of(&Mesh { materials: vec![Material::plain("m", linear)], ..Mesh::default() }).remove(0)
    }

    #[test]
    fn a_few_glints_and_shadows_do_not_change_the_colour_that_is_met() {
        let mut base = plain([0.9, 0.1, 0.1]);
        let mut all = vec![texel([80.0, 120.0, 160.0]); 80];
        all.extend(vec![texel([255.0; 3]); 10]);
        all.extend(vec![texel([2.0; 3]); 10]);
        assert!(base.meet(&all.iter().collect::<Vec<_>>()));
        let got = base.at(&all[0]);
        for (g, w) in got.iter().zip([80.0, 120.0, 160.0]) {
            assert!((g - w).abs() < 1.0, "{got:?}");
        }
    }

    #[test]
    fn a_handful_of_texels_says_nothing() {
        let mut base = plain([0.9, 0.1, 0.1]);
        let all = vec![texel([80.0, 120.0, 160.0]); 5];
        let before = base.at(&all[0]);
        assert!(!base.meet(&all.iter().collect::<Vec<_>>()));
        assert_eq!(base.at(&all[0]), before);
        base.take([80, 120, 160]);
        assert!((base.at(&all[0])[2] - 160.0).abs() < 1.0 && base.off([80, 120, 200]) > 39.0);
    }
}
