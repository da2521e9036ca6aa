//! Putting things on and against each other.

use std::f64::consts::TAU;

use glam::{DAffine3, DVec3};
use harmony_mesh::{Bvh, Group, Mesh};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::Built;
use super::expand::outward;
use crate::solid::math;
use crate::tree::Face;

/// Rays across a footprint.
const RAYS: usize = 7;
/// Tries for each scattered thing.
const TRIES: u32 = 40;

/// Triangles of all parts for rays.
pub(super) fn bvh(built: &Built) -> Bvh {
    let mut mesh = Mesh::default();
    let mut group = Group::default();
    for part in &built.parts {
        let base = mesh.positions.len() as u32;
        mesh.positions.extend(part.piece.positions.iter().map(|p| part.place.transform_point3(*p).as_vec3()));
        group.triangles.extend(part.piece.triangles.iter().map(|t| t.map(|i| i + base)));
    }
    mesh.groups.push(group);
    Bvh::new(&mesh)
}

fn need(built: &Built, what: &str) -> Result<(DVec3, DVec3), String> {
    built.bounds().ok_or_else(|| format!("{what} has no surface"))
}

/// Height of the surface below a point high above.
fn height(bvh: &Bvh, x: f64, z: f64, (lo, hi): (DVec3, DVec3)) -> Option<f64> {
    let from = hi.y + 1.0;
    bvh.raycast(DVec3::new(x, from, z), DVec3::NEG_Y, from - lo.y + 1.0).map(|hit| from - hit.distance)
}

/// The child on the top of the other one: the highest place under its footprint carries it.
pub(super) fn on(child: &Built, other: &Built, u: f64, v: f64) -> Result<Built, String> {
    let (lo, hi) = need(child, "what is put on something")?;
    let (other_lo, other_hi) = need(other, "what it is put on")?;
    let target = other_lo + (other_hi - other_lo) * DVec3::new(u, 1.0, v);
    let bvh = bvh(other);
    let half = (hi - lo) / 2.0 * 0.85;
    let mut top: Option<f64> = None;
    for i in 0..RAYS {
        for j in 0..RAYS {
            let share = |k: usize| 2.0 * k as f64 / (RAYS - 1) as f64 - 1.0;
            let (x, z) = (target.x + half.x * share(i), target.z + half.z * share(j));
            if let Some(y) = height(&bvh, x, z, (other_lo, other_hi)) {
                top = Some(top.map_or(y, |t| t.max(y)));
            }
        }
    }
    let y = top.unwrap_or(other_hi.y);
    let middle = (lo + hi) / 2.0;
    let mut out = Built::default();
    out.add(child, &DAffine3::from_translation(DVec3::new(target.x - middle.x, y - lo.y, target.z - middle.z)));
    Ok(out)
}

/// The child moved along one axis until their boxes touch.
pub(super) fn against(child: &Built, other: &Built, side: Face) -> Result<Built, String> {
    let (lo, hi) = need(child, "what is put against something")?;
    let (other_lo, other_hi) = need(other, "what it is put against")?;
    let d = outward(side);
    let gap = if d.cmpgt(DVec3::ZERO).any() { other_hi - lo } else { other_lo - hi };
    let mut out = Built::default();
    out.add(child, &DAffine3::from_translation(gap * d.abs()));
    Ok(out)
}

fn turn(angle: f64) -> DAffine3 {
    DAffine3::from_mat3(math::turn_deg([0.0, angle.to_degrees(), 0.0]))
}

/// Copies of the children in turn, at random places on the top of another one, apart from each other.
pub(super) fn scatter(children: &[&Built], on: &Built, count: u32, gap: f64, seed: u32) -> Result<Built, String> {
    if children.is_empty() {
        return Err("nothing to scatter".into());
    }
    let bounds = need(on, "what things are scattered on")?;
    let (lo, hi) = bounds;
    let bvh = bvh(on);
    let mut rng = ChaCha8Rng::seed_from_u64(u64::from(seed) ^ 0x5ca7_7e12);
    let mut placed: Vec<(f64, f64, f64)> = Vec::new();
    let mut out = Built::default();
    for k in 0..count as usize {
        let child = children[k % children.len()];
        let Some((child_lo, child_hi)) = child.bounds() else { continue };
        let size = child_hi - child_lo;
        let radius = f64::midpoint(size.x, size.z) / 2.0;
        for _ in 0..TRIES {
            let inner = DVec3::splat(radius).min((hi - lo) / 2.0);
            let x = rng.random_range(lo.x + inner.x..=hi.x - inner.x);
            let z = rng.random_range(lo.z + inner.z..=hi.z - inner.z);
            let angle = rng.random_range(0.0..TAU);
            let near = |(px, pz, pr): &(f64, f64, f64)| {
                let least = gap.max(0.0) + radius + pr;
                (px - x) * (px - x) + (pz - z) * (pz - z) < least * least
            };
            if placed.iter().any(near) {
                continue;
            }
            let Some(y) = height(&bvh, x, z, bounds) else { continue };
            let middle = (child_lo + child_hi) / 2.0;
            let to_origin = DAffine3::from_translation(-DVec3::new(middle.x, child_lo.y, middle.z));
            out.add(child, &(DAffine3::from_translation(DVec3::new(x, y, z)) * turn(angle) * to_origin));
            placed.push((x, z, radius));
            break;
        }
    }
    Ok(out)
}

/// Children on top of each other, a little askew.
pub(super) fn stack(children: &[&Built], gap: f64, jitter: f64, seed: u32) -> Built {
    let mut rng = ChaCha8Rng::seed_from_u64(u64::from(seed) ^ 0x57ac_4b00);
    let mut out = Built::default();
    let mut y = 0.0;
    for child in children {
        let Some((lo, hi)) = child.bounds() else { continue };
        let size = hi - lo;
        let mut random = || rng.random_range(-1.0..=1.0) * jitter;
        let (dx, dz, angle) = (random() * 0.06 * size.x, random() * 0.06 * size.z, random() * 0.14);
        let middle = DVec3::new(f64::midpoint(lo.x, hi.x), lo.y, f64::midpoint(lo.z, hi.z));
        let there = DVec3::new(middle.x + dx, y, middle.z + dz);
        out.add(child, &(DAffine3::from_translation(there) * turn(angle) * DAffine3::from_translation(-middle)));
        y += size.y + gap;
    }
    out
}
