//! Surfaces that carry things: where they are under a footprint, and at which heights.
//!
//! Decorations rest on the highest surface under their footprint, found by rays on the host's mesh rather than by
//! its box, and on the right board of a shelf: the one at the level where the mask says the object stands.

use harmony_scene::{Pose, Vec3};

use crate::scene::attachment::{hang_of, reach, size_of};
use crate::{Item, Placed};

/// Two surfaces closer than this are one, metres.
const SAME_SURFACE: f64 = 0.02;

/// How far the surface may be from the level where the object is looked for, metres.
const LEVEL_SLACK: f64 = 0.12;

/// How deep in its host something may be that lies on it, metres; and the share of its footprint that must be.
const SUNK: f64 = 0.25;
const MOSTLY: f64 = 0.5;

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

/// A ray down a vertical line through a host, in its mesh's frame: origin, direction, and units of it a metre.
fn ray_down(host: &Placed, x: f64, z: f64, from: f64) -> Option<(Vec3, Vec3, f64)> {
    let inverse = host.pose.linear().inverse();
    let down = inverse * Vec3::NEG_Y;
    let unit = down.length();
    let origin = inverse * (Vec3::new(x, from, z) - host.pose.position);
    (unit > 0.0 && unit.is_finite()).then(|| (origin, down / unit, unit))
}

/// How far down a ray from a height goes, metres.
fn to_foot(host: &Placed, from: f64) -> f64 {
    (from - host.pose.position.y + 0.05).max(0.0)
}

/// The highest point of a host's mesh on a vertical line at or below `from`.
fn height_below(host: &Placed, x: f64, z: f64, from: f64) -> Option<f64> {
    let (origin, down, unit) = ray_down(host, x, z, from)?;
    let hit = host.item.shape.bvh().raycast(origin, down, to_foot(host, from) * unit)?;
    Some(from - hit.distance / unit)
}

/// Heights of a mesh that are looked at along a vertical line.
const MAX_CROSSINGS: usize = 128;

/// Two crossings of one side this near to each other are one, met on the edge of two triangles, metres.
const SAME_CROSSING: f64 = 1e-5;

/// All heights of the host's mesh along a vertical line, from its top downwards, and whether the surface there carries
/// something.
fn column(host: &Placed, x: f64, z: f64, top: f64) -> Vec<(f64, bool)> {
    let Some((origin, down, unit)) = ray_down(host, x, z, top) else { return Vec::new() };
    let hits = host.item.shape.bvh().crossings(origin, down, to_foot(host, top) * unit);
    let mut out: Vec<(f64, bool)> =
        hits.iter().map(|hit| (top - hit.distance / unit, hit.normal.dot(down) < 0.0)).collect();
    out.truncate(MAX_CROSSINGS);
    let Some(topmost) = out.first().map(|(_, up)| *up) else { return out };
    // Where one solid stands on another it ends before that begins.
    out.sort_by(|a, b| {
        let rounded = |h: f64| (h / SAME_CROSSING).round();
        rounded(b.0).total_cmp(&rounded(a.0)).then((a.1 == topmost).cmp(&(b.1 == topmost)))
    });
    out.dedup_by(|a, b| a.1 == b.1 && (a.0 - b.0).abs() < SAME_CROSSING);
    carrying(&mut out);
    out
}

/// Turns whether surfaces look up, from the topmost one downwards, into whether they carry. A surface carries that looks
/// the way of the topmost one (an underside looks the other way, and some meshes come inside out) and lies in none of the
/// mesh's other solids, as the base of a bed lies in its mattress where the two overlap; nor right under one, as the box of
/// a sideboard lies under its top.
fn carrying(column: &mut [(f64, bool)]) {
    let Some((_, topmost)) = column.first().copied() else { return };
    for (_, up) in &mut *column {
        *up = *up == topmost;
    }
    // In how many solids one is below each surface. Open sheets end in no underside: then nobody knows.
    let below: Vec<i32> = column
        .iter()
        .scan(0, |inside, (_, up)| {
            *inside += if *up { 1 } else { -1 };
            Some(*inside)
        })
        .collect();
    let is_closed = column.len() < MAX_CROSSINGS && below.last() == Some(&0) && below.iter().all(|n| *n >= 0);
    if is_closed {
        for ((_, carries), inside) in column.iter_mut().zip(below) {
            *carries &= inside == 1;
        }
    }
    for k in (1..column.len()).rev() {
        column[k].1 &= column[k - 1].0 - column[k].0 > SAME_SURFACE;
    }
}

/// What a host has at or below a point.
enum Below {
    /// A surface that carries something there: its height, metres.
    Carries(f64),
    /// The point is inside of the host: in the backrest on which a cushion leans.
    Inside,
    /// The point is beside the host.
    Nothing,
}

fn below(host: &Placed, x: f64, z: f64, from: f64) -> Below {
    let Some(height) = height_below(host, x, z, from) else { return Below::Nothing };
    let top = top_of(host);
    let is_topmost = || height_below(host, x, z, top).is_some_and(|h| (h - height).abs() < 1e-6);
    if is_topmost() {
        return Below::Carries(height);
    }
    let all = column(host, x, z, top);
    let nearest = all.into_iter().min_by(|a, b| (a.0 - height).abs().total_cmp(&(b.0 - height).abs()));
    if nearest.is_some_and(|(_, carries)| carries) { Below::Carries(height) } else { Below::Inside }
}

/// The lowest surface that carries something above a point inside of a host, if it is near.
fn top_above(host: &Placed, x: f64, z: f64, from: f64) -> Option<f64> {
    let heights =
        column(host, x, z, top_of(host)).into_iter().filter(|(_, carries)| *carries).map(|(height, _)| height);
    heights.filter(|h| (from..from + SUNK).contains(h)).min_by(f64::total_cmp)
}

/// The height at which a host carries cloth on a vertical line, near a level, metres.
pub(crate) fn lying_height(host: &Placed, x: f64, z: f64, level: f64) -> Option<f64> {
    let from = level + LEVEL_SLACK;
    let height = match below(host, x, z, from) {
        Below::Carries(h) => Some(h),
        Below::Inside => top_above(host, x, z, from),
        Below::Nothing => None,
    };
    height.filter(|h| (h - level).abs() <= SUNK)
}

/// How far a room point is inside of a host along a direction, metres: 0 outside of it, and in what is open.
pub(crate) fn way_out(host: &Placed, from: Vec3, direction: Vec3, max: f64) -> f64 {
    let inverse = host.pose.linear().inverse();
    let local = inverse * direction;
    let unit = local.length();
    if !(unit > 0.0 && unit.is_finite()) {
        return 0.0;
    }
    let reach = max + host.size().as_vec().length();
    let hits = host.item.shape.bvh().crossings(inverse * (from - host.pose.position), local / unit, reach * unit);
    let leaves = |normal: Vec3| normal.dot(local) > 0.0;
    // Of as many solids as it leaves more often than it enters them it is in the inside.
    let mut inside = hits.iter().map(|hit| if leaves(hit.normal) { 1 } else { -1 }).sum::<i32>();
    if inside <= 0 {
        return 0.0;
    }
    for hit in &hits {
        inside += if leaves(hit.normal) { -1 } else { 1 };
        if inside == 0 {
            let way = hit.distance / unit;
            return if way <= max { way } else { 0.0 };
        }
    }
    0.0
}

/// A height above all of a host, metres.
fn top_of(host: &Placed) -> f64 {
    host.pose.position.y + reach(&host.item, &host.pose).1.y + 0.05
}

/// Points of an object's footprint that ask what is below them: a grid, or, of what hangs over an edge, those under the part
/// that lies on something.
fn footprint(item: &Item, pose: &Pose) -> Vec<Vec3> {
    if let Some(hang) = hang_of(item) {
        return hang.under.iter().map(|p| pose.point(Vec3::new(p.x, 0.0, p.y))).collect();
    }
    let linear = Pose { scale: 1.0, stretch: Vec3::ONE, ..*pose }.linear();
    let half = size_of(item, pose) / 2.0 * FOOTPRINT_SHARE;
    grid().map(|[s, t]| pose.position + linear * Vec3::new(half.x * s, 0.0, half.z * t)).collect()
}

/// Points under the foot of what stands on a small one.
fn under_foot(item: &Item, pose: &Pose) -> Vec<Vec3> {
    let Some([low, high]) = item.shape.foot().filter(|_| hang_of(item).is_none()) else { return Vec::new() };
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0 * FOOTPRINT_SHARE);
    grid().map(|[s, t]| pose.point(Vec3::new(middle.x + half.x * s, 0.0, middle.y + half.y * t))).collect()
}

/// Places of the rays under a footprint, shares of its half sides.
fn grid() -> impl Iterator<Item = [f64; 2]> {
    let t = |k: usize| 2.0 * k as f64 / (FOOTPRINT_RAYS - 1) as f64 - 1.0;
    (0..FOOTPRINT_RAYS).flat_map(move |i| (0..FOOTPRINT_RAYS).map(move |j| [t(i), t(j)]))
}

/// The surface of a host under an object's footprint near a level.
pub(crate) fn surface_under(host: &Placed, item: &Item, pose: &Pose, query: &SurfaceQuery) -> Option<Surface> {
    let whole = footprint(item, pose);
    // A plant stands where its pot does: whether it is carried is asked there, how high it comes everywhere under it.
    let feet = under_foot(item, pose);
    let points = whole.len() + feet.len();
    // Start above the level but under the next board.
    let from = query.level + LEVEL_SLACK.min(0.5 * query.object_height + 0.04);
    let mut found = Vec::new();
    let mut above = Vec::new();
    let (mut inside, mut feet_carried) = (0, 0);
    for (k, at) in whole.iter().chain(&feet).enumerate() {
        match below(host, at.x, at.z, from) {
            Below::Carries(h) if h >= query.level - LEVEL_SLACK => {
                found.push(h);
                feet_carried += usize::from(k >= whole.len());
            }
            Below::Inside => {
                inside += 1;
                above.extend(top_above(host, at.x, at.z, from));
            }
            _ => {}
        }
    }
    if found.is_empty() {
        // All of it is in the host: it lies on what is above it, as a pillow on the seat that it has sunk into; but one that
        // stands at the height of the seat leans into an arm or a backrest.
        let share = above.len() as f64 / points as f64;
        above.sort_by(f64::total_cmp);
        let on_a_level =
            || layers(host, query.object_height).iter().any(|layer| (layer.height - query.level).abs() < LEVEL_SLACK);
        return (share > MOSTLY && !on_a_level()).then(|| Surface { height: above[above.len() / 2], share });
    }
    // Where a part is in the host (in a backrest) that says nothing about its surface; collisions have their say there.
    found.sort_by(f64::total_cmp);
    let share = if feet.is_empty() {
        found.len() as f64 / (points - inside) as f64
    } else {
        f64::from(feet_carried as u32) / feet.len() as f64
    };
    let rank = if query.soft { found.len() / 2 } else { (found.len() * 9 / 10).min(found.len() - 1) };
    Some(Surface { height: found[rank], share })
}

/// All heights at which a host can carry something of a height, highest first.
pub(crate) fn layers(host: &Placed, object_height: f64) -> Vec<Layer> {
    const GRID: usize = 9;
    let (low, high) = reach(&host.item, &host.pose);
    let top = top_of(host);
    let mut heights: Vec<f64> = Vec::new();
    for i in 0..GRID {
        for j in 0..GRID {
            let t = |k: usize, a: f64, b: f64| a + (b - a) * (k as f64 + 0.5) / GRID as f64;
            let x = host.pose.position.x + t(i, low.x, high.x);
            let z = host.pose.position.z + t(j, low.z, high.z);
            let mut above = f64::INFINITY;
            for (h, carries) in column(host, x, z, top) {
                let room = above - h >= (0.6 * object_height).max(SAME_SURFACE);
                if carries && room && h > host.pose.position.y + 0.03 {
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
    use crate::testing::{box_mesh, boxed, empty_room, of_boxes};

    fn standing(item: Item, at: Vec3) -> Placed {
        let pose = Pose::new(at, 0.0, 1.0);
        let support = harmony_scene::Support::Floor;
        Placed { item: Arc::new(item), pose, support, evidence: crate::Evidence::default() }
    }

    #[test]
    fn the_gap_is_measured_to_the_backrest() {
        let scene = empty_room();
        // A backrest 0.2 deep and 0.9 high, its front at z = 1.1, of a host that looks along +z.
        let back = boxed(&scene, Vec3::new(2.0, 0.9, 0.2), Vec3::new(2.0, 0.0, 1.0), 0.0);
        let host = standing(back, Vec3::new(2.0, 0.0, 1.0));
        let cushion = boxed(&scene, Vec3::new(0.5, 0.4, 0.2), Vec3::new(2.0, 0.4, 1.5), 0.0);
        assert_eq!(cushion.shape.extent(), Shape::new(Arc::new(box_mesh(Vec3::new(0.5, 0.4, 0.2))), vec![]).extent());
        let gap = |z: f64| gap_to_back(&host, &cushion, &Pose::new(Vec3::new(2.0, 0.4, z), 0.0, 1.0));
        assert!((gap(1.5).unwrap() - 0.3).abs() < 1e-6);
        assert!(gap(1.2).unwrap().abs() < 1e-6);
        // Nothing behind it: above the backrest.
        assert_eq!(gap_to_back(&host, &cushion, &Pose::new(Vec3::new(2.0, 1.5, 1.5), 0.0, 1.0)), None);
    }

    #[test]
    fn a_cushion_that_leans_into_an_arm_does_not_stand_on_it() {
        let scene = empty_room();
        // A seat 1.4 m wide and 0.42 m high beside an arm of 0.2 m that ends 0.2 m above it.
        let seat = (Vec3::new(1.4, 0.42, 0.8), Vec3::ZERO);
        let arm = (Vec3::new(0.3, 0.62, 0.8), Vec3::X * 0.84);
        let mut item = boxed(&scene, Vec3::new(2.0, 0.62, 0.8), Vec3::new(2.0, 0.0, 2.0), 0.0);
        item.shape = Arc::new(of_boxes(&[seat, arm]));
        let host = standing(item, Vec3::new(2.0, 0.0, 2.0));
        let cushion = boxed(&scene, Vec3::new(0.2, 0.35, 0.3), Vec3::new(2.0, 0.42, 2.0), 0.0);
        let under = |x: f64, level: f64| {
            let query = SurfaceQuery { level, object_height: 0.35, soft: true };
            surface_under(&host, &cushion, &Pose::new(Vec3::new(x, level, 2.0), 0.0, 1.0), &query).map(|s| s.height)
        };
        assert!(under(2.3, 0.42).is_some_and(|h| (h - 0.42).abs() < 1e-6));
        assert_eq!(under(2.84, 0.42), None, "it stays at the height of the seat");
        assert!(under(2.84, 0.6).is_some_and(|h| (h - 0.62).abs() < 1e-6), "what is put on the arm is on it");
    }

    #[test]
    fn a_plant_stands_where_its_pot_is() {
        let scene = empty_room();
        // A pot at one end of a wide crown.
        let parts = [(Vec3::new(0.16, 0.2, 0.16), Vec3::X * -0.2), (Vec3::new(0.6, 0.4, 0.6), Vec3::Y * 0.2)];
        let mut item = boxed(&scene, Vec3::new(0.6, 0.6, 0.6), Vec3::new(2.0, 0.8, 2.0), 0.0);
        item.shape = Arc::new(of_boxes(&parts));
        let table = boxed(&scene, Vec3::new(1.0, 0.8, 0.6), Vec3::new(2.0, 0.0, 2.0), 0.0);
        let host = standing(table, Vec3::new(2.0, 0.0, 2.0));
        let query = SurfaceQuery { level: 0.8, object_height: 0.6, soft: false };
        let under = |x: f64| surface_under(&host, &item, &Pose::new(Vec3::new(x, 0.8, 2.0), 0.0, 1.0), &query);
        // Its middle is beyond the table's end, its pot is on it, and the other way round.
        assert!(under(2.6).is_some_and(|s| s.share > 0.99));
        assert!(under(1.6).is_some_and(|s| s.share < 0.2));
    }

    #[test]
    fn the_box_under_a_top_is_no_shelf() {
        let scene = empty_room();
        // The top lies on the box without a gap, and reaches beyond it.
        let parts = [(Vec3::new(1.6, 0.52, 0.4), Vec3::ZERO), (Vec3::new(1.7, 0.06, 0.45), Vec3::Y * 0.52)];
        let mut item = boxed(&scene, Vec3::new(1.7, 0.58, 0.45), Vec3::new(2.0, 0.0, 2.0), 0.0);
        item.shape = Arc::new(of_boxes(&parts));
        let host = standing(item, Vec3::new(2.0, 0.0, 2.0));
        let heights: Vec<f64> = layers(&host, 0.05).iter().map(|layer| layer.height).collect();
        assert!(heights.len() == 1 && (heights[0] - 0.58).abs() < 1e-6, "{heights:?}");
        let tray = boxed(&scene, Vec3::new(0.35, 0.08, 0.26), Vec3::new(2.0, 0.5, 2.0), 0.0);
        let query = SurfaceQuery { level: 0.5, object_height: 0.08, soft: false };
        let surface = surface_under(&host, &tray, &Pose::new(Vec3::new(2.0, 0.5, 2.0), 0.0, 1.0), &query);
        assert!(surface.is_some_and(|s| (s.height - 0.58).abs() < 1e-6), "{surface:?}");
    }

    #[test]
    fn an_underside_is_no_shelf() {
        let scene = empty_room();
        // A base and, above it, a mattress.
        let parts = [(0.1, 0.05), (0.28, 0.32)].map(|(height, low)| (Vec3::new(2.0, height, 1.0), Vec3::Y * low));
        let mut bed = (**of_boxes(&parts).mesh()).clone();
        let host_of = |mesh: harmony_mesh::Mesh| {
            let mut item = boxed(&scene, Vec3::new(2.0, 0.6, 1.0), Vec3::new(2.0, 0.0, 2.0), 0.0);
            item.shape = Arc::new(Shape::new(Arc::new(mesh), Vec::new()));
            Placed {
                item: Arc::new(item),
                pose: Pose::new(Vec3::new(2.0, 0.0, 2.0), 0.3, 1.0),
                support: harmony_scene::Support::Floor,
                evidence: crate::Evidence::default(),
            }
        };
        let heights_of = |mesh: harmony_mesh::Mesh| {
            let layers = layers(&host_of(mesh), 0.25);
            layers.into_iter().map(|l| (l.height * 100.0).round()).collect::<Vec<_>>()
        };
        // Nor is the inside of the mattress a place from which something falls onto its underside: it lies on top.
        let bear = boxed(&scene, Vec3::new(0.2, 0.25, 0.2), Vec3::new(2.0, 0.4, 2.0), 0.0);
        let under = |level: f64| {
            let query = SurfaceQuery { level, object_height: 0.25, soft: false };
            surface_under(&host_of(bed.clone()), &bear, &Pose::new(Vec3::new(2.0, level, 2.0), 0.0, 1.0), &query)
        };
        assert!(under(0.4).is_some_and(|s| (s.height - 0.6).abs() < 1e-6));
        assert!(under(0.58).is_some_and(|s| (s.height - 0.6).abs() < 1e-6 && s.share > 0.99));
        // A cushion that leans into the mattress from beside it stands on what is beside it.
        let query = SurfaceQuery { level: 0.15, object_height: 0.25, soft: false };
        let leaning = Pose::new(Vec3::new(2.0, 0.15, 2.0), 0.0, 1.0);
        let stepped = |share: f32| {
            let mut mesh = bed.clone();
            mesh.positions[8..].iter_mut().for_each(|p| p.x += share);
            surface_under(&host_of(mesh), &bear, &leaning, &query)
        };
        assert!(stepped(1.03).is_some_and(|s| (s.height - 0.15).abs() < 1e-6 && s.share > 0.99));
        assert_eq!(heights_of(bed.clone()), [60.0, 15.0]);
        // The same with all faces inside out, as some meshes come.
        bed.groups.iter_mut().flat_map(|g| &mut g.triangles).for_each(|t| t.swap(1, 2));
        assert_eq!(heights_of(bed), [60.0, 15.0]);
        // A base that reaches into the mattress, as parts of a program do so that no gap shows: its top is no shelf.
        let parts = [(0.25, 0.0), (0.35, 0.24)].map(|(height, low)| (Vec3::new(2.0, height, 1.0), Vec3::Y * low));
        let overlapping = (**of_boxes(&parts).mesh()).clone();
        assert_eq!(heights_of(overlapping.clone()), [59.0]);
        let query = SurfaceQuery { level: 0.27, object_height: 0.25, soft: false };
        let sunk = Pose::new(Vec3::new(2.0, 0.27, 2.0), 0.0, 1.0);
        let surface = surface_under(&host_of(overlapping), &bear, &sunk, &query);
        assert!(surface.is_some_and(|s| (s.height - 0.59).abs() < 1e-6), "it lies on the mattress");
    }
}
