//! Surfaces that carry things: where they are under a footprint, and at which heights.
//!
//! Decorations rest on the highest surface under their footprint, found by rays on the host's mesh rather than by
//! its box, and on the right board of a shelf: the one at the level where the mask says the object stands.

use harmony_scene::{Pose, Vec3};

use crate::anchoring::{reach, size_of};
use crate::{Item, Placed};

/// Two surfaces closer than this are one, metres.
const SAME_SURFACE: f64 = 0.02;

/// How far the surface may be from the level where the object is looked for, metres.
const LEVEL_SLACK: f64 = 0.12;

/// Rays along each side of a footprint.
const FOOTPRINT_RAYS: usize = 4;

/// Share of the footprint that is asked: feet stand inside the outline.
const FOOTPRINT_SHARE: f64 = 0.7;

/// What is asked of a host.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SurfaceQuery {
    /// Height near which the surface is expected, metres.
    pub(crate) level: f64,
    /// Height of what is to stand there, metres.
    pub(crate) object_height: f64,
    /// Soft things sink in: the usual height counts, not the highest.
    pub(crate) soft: bool,
}

/// A surface under a footprint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Surface {
    /// Height, metres.
    pub(crate) height: f64,
    /// Share of the footprint's rays that met it, 0 to 1.
    pub(crate) share: f64,
}

/// A height at which a host can carry things.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Layer {
    /// Metres.
    pub(crate) height: f64,
    /// Share of the host's footprint at this height.
    pub(crate) share: f64,
}

/// Heights of the host's mesh along a vertical line, from `from` downwards, at most `limit` of them.
fn heights_below(host: &Placed, x: f64, z: f64, from: f64, limit: usize) -> Vec<f64> {
    let inverse = host.pose.linear().inverse();
    let down = inverse * Vec3::NEG_Y;
    let unit = down.length();
    let mut out = Vec::new();
    if !(unit > 0.0 && unit.is_finite()) {
        return out;
    }
    let bvh = host.item.shape.bvh();
    let mut start = from;
    for _ in 0..limit {
        let origin = inverse * (Vec3::new(x, start, z) - host.pose.position);
        let reach = (start - host.pose.position.y + 0.05).max(0.0) * unit;
        let Some(hit) = bvh.raycast(origin, down / unit, reach) else { break };
        let height = start - hit.distance / unit;
        out.push(height);
        start = height - 1e-3;
    }
    out
}

/// The surface of a host under an object's footprint near a level.
pub(crate) fn surface_under(host: &Placed, item: &Item, pose: &Pose, query: &SurfaceQuery) -> Option<Surface> {
    let linear = Pose { scale: 1.0, stretch: Vec3::ONE, ..*pose }.linear();
    let half = size_of(item, pose) / 2.0 * FOOTPRINT_SHARE;
    // Start above the level but under the next board.
    let from = query.level + LEVEL_SLACK.min(0.5 * query.object_height + 0.04);
    let mut found = Vec::new();
    let mut rays = 0;
    for i in 0..FOOTPRINT_RAYS {
        for j in 0..FOOTPRINT_RAYS {
            let t = |k: usize| 2.0 * k as f64 / (FOOTPRINT_RAYS - 1) as f64 - 1.0;
            let at = pose.position + linear * Vec3::new(half.x * t(i), 0.0, half.z * t(j));
            rays += 1;
            let first = heights_below(host, at.x, at.z, from, 1).first().copied();
            found.extend(first.filter(|h| *h >= query.level - LEVEL_SLACK));
        }
    }
    if found.is_empty() {
        return None;
    }
    found.sort_by(f64::total_cmp);
    let share = found.len() as f64 / f64::from(rays);
    let rank = if query.soft { found.len() / 2 } else { (found.len() * 9 / 10).min(found.len() - 1) };
    Some(Surface { height: found[rank], share })
}

/// All heights at which a host can carry something of a height, highest first.
pub(crate) fn layers(host: &Placed, object_height: f64) -> Vec<Layer> {
    const GRID: usize = 9;
    let (low, high) = reach(&host.item, &host.pose);
    let top = host.pose.position.y + high.y + 0.05;
    let mut heights: Vec<f64> = Vec::new();
    for i in 0..GRID {
        for j in 0..GRID {
            let t = |k: usize, a: f64, b: f64| a + (b - a) * (k as f64 + 0.5) / GRID as f64;
            let x = host.pose.position.x + t(i, low.x, high.x);
            let z = host.pose.position.z + t(j, low.z, high.z);
            let column = heights_below(host, x, z, top, 24);
            let mut above = f64::INFINITY;
            for h in column {
                // The underside of a board has the board's thickness above it, not room for an object.
                if above - h >= (0.6 * object_height).max(SAME_SURFACE) && h > host.pose.position.y + 0.03 {
                    heights.push(h);
                }
                above = h;
            }
        }
    }
    heights.sort_by(|a, b| b.total_cmp(a));
    let total = (GRID * GRID) as f64;
    let mut out: Vec<(f64, usize)> = Vec::new();
    for h in heights {
        match out.last_mut() {
            Some((top, count)) if *top - h <= SAME_SURFACE => *count += 1,
            _ => out.push((h, 1)),
        }
    }
    out.into_iter()
        .filter(|(_, count)| *count >= 2)
        .map(|(height, count)| Layer { height, share: count as f64 / total })
        .collect()
}

/// Free space between an object's back and what its host has behind it (a backrest, a headboard), metres, measured at
/// half the object's height; `None` when the host has nothing there.
pub(crate) fn gap_to_back(host: &Placed, item: &Item, pose: &Pose) -> Option<f64> {
    let size = item.shape.extent() * pose.scale * pose.stretch;
    let backward = -host.pose.front();
    let axes = [pose.linear() * Vec3::X, pose.linear() * Vec3::Z].map(Vec3::normalize_or_zero);
    let half = 0.5 * (size.x * axes[0].dot(backward).abs() + size.z * axes[1].dot(backward).abs());
    let middle = pose.position + Vec3::Y * (size.y / 2.0);
    let (hit, level) = ray_hit(host, middle, backward)?;
    // What is behind must be upright: the ray may leave a seat that it starts in.
    (!level).then(|| (hit - middle).dot(backward) - half)
}

/// Where a room ray first meets a placed object: the point and whether the surface there is level enough to stand on.
pub(crate) fn ray_hit(host: &Placed, origin: Vec3, direction: Vec3) -> Option<(Vec3, bool)> {
    let inverse = host.pose.linear().inverse();
    let local = inverse * direction;
    let unit = local.length();
    if !(unit > 0.0 && unit.is_finite()) {
        return None;
    }
    let hit = host.item.shape.bvh().raycast(inverse * (origin - host.pose.position), local / unit, 60.0 * unit)?;
    let normal = (inverse.transpose() * hit.normal).normalize_or(Vec3::Y);
    Some((origin + direction * (hit.distance / unit), normal.y.abs() > 0.7))
}

#[cfg(test)]
mod back_tests {
    use std::sync::Arc;

    use super::*;
    use crate::Shape;
    use crate::testing::{box_mesh, boxed, empty_room};

    #[test]
    fn the_gap_is_measured_to_the_backrest() {
        let scene = empty_room();
        // A backrest 0.2 deep and 0.9 high, its front at z = 1.1, of a host that looks along +z.
        let back = boxed(&scene, Vec3::new(2.0, 0.9, 0.2), Vec3::new(2.0, 0.0, 1.0), 0.0);
        let host = Placed {
            item: Arc::new(back),
            pose: Pose::new(Vec3::new(2.0, 0.0, 1.0), 0.0, 1.0),
            support: harmony_scene::Support::Floor,
            evidence: crate::Evidence::default(),
        };
        let cushion = boxed(&scene, Vec3::new(0.5, 0.4, 0.2), Vec3::new(2.0, 0.4, 1.5), 0.0);
        assert_eq!(cushion.shape.extent(), Shape::new(Arc::new(box_mesh(Vec3::new(0.5, 0.4, 0.2))), vec![]).extent());
        let gap = |z: f64| gap_to_back(&host, &cushion, &Pose::new(Vec3::new(2.0, 0.4, z), 0.0, 1.0));
        assert!((gap(1.5).unwrap() - 0.3).abs() < 1e-6);
        assert!(gap(1.2).unwrap().abs() < 1e-6);
        // Nothing behind it: above the backrest.
        assert_eq!(gap_to_back(&host, &cushion, &Pose::new(Vec3::new(2.0, 1.5, 1.5), 0.0, 1.0)), None);
    }
}
