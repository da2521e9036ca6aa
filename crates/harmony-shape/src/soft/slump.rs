//! Soft things that give way.

use glam::DVec3;

use super::noise::{noise3, smoothstep};
use super::refine::{deform, refine};
use crate::Piece;

/// A soft thing flattened where it stands and bulged around, its lowest point where it was; `amount` 0 to 1.
///
/// Height goes down by up to a third; the lower part widens by what was pressed out of it, the ground flattens it.
pub fn slump(child: &Piece, amount: f64) -> Piece {
    let amount = amount.clamp(0.0, 1.0);
    let Some((lo, hi)) = child.bounds() else { return child.clone() };
    let size = hi - lo;
    if amount == 0.0 || size.y < 1e-6 {
        return child.clone();
    }
    let largest = size.max_element();
    let mut out = refine(child, largest / 28.0, child.triangles.len().max(24_000), |_| true);
    let (height, contact) = (size.y * (1.0 - 0.33 * amount), 0.16 * amount);
    let middle = (lo + hi) / 2.0;
    deform(&mut out, |p| {
        let t = (p.y - lo.y) / size.y;
        // Flat at the ground: what was within the contact is pressed into its plane.
        let soft = contact * 0.5;
        let up = (t - contact) / (1.0 - contact);
        let up = if up > soft { up } else { soft * libm::exp((up - soft) / soft.max(1e-6)) };
        let up = (up - soft * libm::exp(-(contact / (1.0 - contact) + soft) / soft.max(1e-6))).max(0.0);
        let bulge = libm::sin(std::f64::consts::PI * libm::pow(t.clamp(0.0, 1.0), 0.6));
        let wide = 1.0 + amount * (0.24 * bulge + 0.10 * (1.0 - t));
        // Uneven filling: a lean and lumps, less at the ground.
        let lump = noise3((p - lo) * (2.2 / largest), 11) * 0.07 + noise3((p - lo) * (5.0 / largest), 12) * 0.03;
        let wide = wide * (1.0 + amount * lump * smoothstep(0.0, 0.4, t));
        let (x, z) = ((p.x - middle.x) * wide, (p.z - middle.z) * wide);
        // A dimple where one sits.
        let r = ((x / size.x).powi(2) + (z / size.z).powi(2)).sqrt();
        let dent = 0.10 * amount * smoothstep(0.6, 1.0, t) * (1.0 - smoothstep(0.0, 0.42, r));
        let y = lo.y + height * (up - dent * up);
        DVec3::new(middle.x + x, y, middle.z + z)
    });
    out
}

#[cfg(test)]
mod tests {
    use super::super::grid::ball;
    use super::super::grid::testing::{sound, volume};
    use super::*;

    #[test]
    fn a_ball_gets_lower_wider_and_flat_below() {
        let mut child = Piece { closed: true, ..Piece::default() };
        ball(&mut child, DVec3::Y * 0.4, DVec3::X, DVec3::Y, DVec3::splat(0.4), 24, 32);
        let soft = slump(&child, 1.0);
        sound(&soft);
        let (lo, hi) = soft.bounds().unwrap();
        assert!(lo.y.abs() < 0.01 && (0.4..0.62).contains(&hi.y), "{lo} {hi}");
        assert!(hi.x - lo.x > 0.85, "{}", hi.x - lo.x);
        // The foot print is a disc, not a point.
        let foot = soft.positions.iter().filter(|p| p.y < 0.01).map(|p| p.x.hypot(p.z)).fold(0.0, f64::max);
        assert!(foot > 0.2, "{foot}");
        let kept = volume(&soft) / volume(&child);
        assert!((0.7..1.3).contains(&kept), "volume {kept}");
        assert_eq!(slump(&child, 0.0), child);
    }
}
