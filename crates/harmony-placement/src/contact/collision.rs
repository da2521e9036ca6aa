//! Bringing apart what is in one another. Paper Sec. 3.3 (key `collide.least_move`).
//!
//! The paper applies the smaller of the two least moves of a pair, then moves the group, and reports what stays. Here all pairs
//! share their least displacement round after round (position-based dynamics, Müller et al., 2007), the one that is surer of
//! its place moving less: with one pair that is the paper's rule, and a row of cupboards each a little too wide makes room
//! along the whole row. Objects move only in the directions that their support allows, what rests on them goes along.

use std::collections::BTreeMap;

use glam::Vec3Swizzles as _;
use harmony_scene::{Level, ObjectId, Support, Vec2, Vec3, Wall};

use super::solid::{Solid, directions_around, level_directions};
use crate::noise::Noise;
use crate::scene::attachment::{Attachment, attachment_of};
use crate::scene::subtree::{rests_on, subtree};
use crate::scene::support::{SurfaceQuery, surface_under};
use crate::{PartialScene, Placed, PlacementSettings};

/// Clearance left after a move, metres.
const CLEARANCE: f64 = 1e-3;

/// How many times farther an object may go in the end that agrees less with its mask than this.
const FARTHER: f64 = 5.0;
const GUESSED_IOU: f64 = 0.3;

/// Rounds in which all objects are brought apart together, and the share of a gap that is closed in each.
const ROUNDS: usize = 60;
const STEP: f64 = 0.6;

/// Weight of an object that agrees with nothing, beside one that agrees with its mask: it moves first.
const MIN_WEIGHT: f64 = 0.03;

/// How deep soft things may press into each other, share of the thinner one.
const LEANING: f64 = 0.4;

/// Share of a decoration's footprint that must still be on its host after a move.
const STILL_SUPPORTED: f64 = 0.5;

/// Two placed objects in one another.
#[derive(Debug, Clone, PartialEq)]
pub struct Collision {
    /// One.
    pub a: ObjectId,
    /// The other.
    pub b: ObjectId,
    /// The shortest way out, metres.
    pub penetration: f64,
}

/// How deep two objects may be in one another, or `None` when they may share space.
fn tolerance(scene: &PartialScene, a: usize, b: usize, settings: &PlacementSettings) -> Option<f64> {
    let (p, q) = (&scene.placed[a], &scene.placed[b]);
    let carried = |on: usize, by: usize| rests_on(scene, on, by) && !stands_in(scene, on, by);
    if p.item.traits.flat || q.item.traits.flat || carried(a, b) || carried(b, a) {
        return None;
    }
    let on_wall = |p: &Placed| p.item.level == Level::Wall;
    // Curtains and blinds hang before windows.
    if on_wall(p) && on_wall(q) && (p.item.traits.hangs || q.item.traits.hangs) {
        return None;
    }
    // What is thrown over something and reaches the floor has it inside.
    let over = |p: &Placed, q: &Placed| {
        let said = p.item.relations.on_top_of.as_ref();
        p.item.traits.drapes && p.support == Support::Floor && said == Some(&q.item.id)
    };
    if over(p, q) || over(q, p) {
        return None;
    }
    if p.item.traits.soft && q.item.traits.soft {
        // Pillows in a row lean on each other.
        let thin = [p, q].map(|p| p.size().as_vec().min_element());
        return Some(settings.noise.contact_soft.max(LEANING * thin[0].min(thin[1])));
    }
    if p.item.traits.soft || q.item.traits.soft {
        return Some(settings.noise.contact_soft);
    }
    Some(settings.noise.contact)
}

/// Whether an object that keeps its form stands on another or in it, by itself: it may be in what is beside it there.
fn stands_in(scene: &PartialScene, guest: usize, host: usize) -> bool {
    let Support::Object { id } = &scene.placed[guest].support else { return false };
    let traits = &scene.placed[guest].item.traits;
    !traits.soft && !traits.drapes && !scene.placed[host].item.traits.soft && scene.position(id) == Some(host)
}

/// Which of two stands in the other.
fn guest_and_host(scene: &PartialScene, a: usize, b: usize) -> Option<[usize; 2]> {
    [[a, b], [b, a]].into_iter().find(|[guest, host]| stands_in(scene, *guest, *host))
}

/// Solids of all placed objects, in their order.
pub(crate) fn solids(scene: &PartialScene) -> Vec<Solid> {
    scene.placed.iter().map(|p| Solid::new(&p.item, &p.pose)).collect()
}

/// How deep two placed objects are in one another beyond what is allowed to them; 0 when that is nothing.
fn excess(scene: &PartialScene, all: &[Solid], a: usize, b: usize, settings: &PlacementSettings) -> f64 {
    let Some(allowed) = tolerance(scene, a, b, settings) else { return 0.0 };
    if a == b || !all[a].near(&all[b], 0.0) {
        return 0.0;
    }
    let directions = directions_around();
    let depth = match guest_and_host(scene, a, b) {
        Some([guest, host]) => all[guest].penetration_beside(&all[host], &directions),
        None => all[a].penetration(&all[b], &directions),
    };
    if depth > allowed { depth } else { 0.0 }
}

/// All pairs of placed objects that are in one another, deepest first.
pub fn collisions(scene: &PartialScene, settings: &PlacementSettings) -> Vec<Collision> {
    let all = solids(scene);
    let mut out = Vec::new();
    for a in 0..all.len() {
        for b in a + 1..all.len() {
            let penetration = excess(scene, &all, a, b, settings);
            if penetration > 0.0 {
                let id = |i: usize| scene.placed[i].item.id.clone();
                out.push(Collision { a: id(a), b: id(b), penetration });
            }
        }
    }
    out.sort_by(|p, q| q.penetration.total_cmp(&p.penetration));
    out
}

/// Deepest penetration of one placed object, metres; `all` are the solids of the placed ones.
pub(crate) fn deepest(scene: &PartialScene, all: &[Solid], object: usize, settings: &PlacementSettings) -> f64 {
    (0..all.len()).map(|i| excess(scene, all, object, i, settings)).fold(0.0, f64::max)
}

/// Directions in which the support of an object lets it go.
fn free_directions(scene: &PartialScene, object: usize, noise: &Noise) -> Vec<Vec3> {
    let along = |normal: Vec3| vec![normal.cross(Vec3::Y), Vec3::Y.cross(normal)];
    match attachment_of(scene, object, noise) {
        // A curtain may hang between it and its wall.
        Attachment::AgainstWall(wall) => [along(wall.normal()), vec![wall.normal()]].concat(),
        Attachment::OnWall(wall) => [along(wall.normal()), vec![Vec3::Y, Vec3::NEG_Y]].concat(),
        Attachment::Floor | Attachment::Ceiling | Attachment::OnHost { .. } | Attachment::OnLedge(_) => {
            level_directions()
        }
    }
}

fn longest_move(size: &harmony_scene::Size, noise: &Noise) -> f64 {
    (noise.longest_move[0] * size.width.max(size.depth)).min(noise.longest_move[1])
}

/// Brings all placed objects apart together: every pair that collides shares the least displacement between its two,
/// the one that is surer of its place moving less, round after round, as in position-based dynamics (Müller et al.,
/// 2007). Where the paper moves one object clear of all its neighbours at once, a row of cupboards each a little too
/// wide makes room along the whole row.
///
/// What no short move parts may go farther in the end, where it agrees so little with its mask that its place is a guess:
/// a simulation should not start with things in each other.
///
/// Returns how far each object went, metres.
pub(crate) fn relax(scene: &mut PartialScene, settings: &PlacementSettings) -> Vec<f64> {
    let all = vec![true; scene.placed.len()];
    relax_around(scene, all, settings)
}

/// The same for objects that have come to a place (`come`, one for each placed one): they and whatever has to make room for
/// them, and what that moves, go apart. What stood in one another before stays.
pub(crate) fn relax_around(scene: &mut PartialScene, mut come: Vec<bool>, settings: &PlacementSettings) -> Vec<f64> {
    let mut gone = vec![Vec3::ZERO; scene.placed.len()];
    let mut longest: Vec<f64> = scene.placed.iter().map(|p| longest_move(&p.size(), &settings.noise)).collect();
    if !relaxed(scene, settings, &longest, &mut gone, &mut come) {
        for (longest, p) in longest.iter_mut().zip(&scene.placed) {
            if p.evidence.silhouette_iou.is_some_and(|iou| iou < GUESSED_IOU) {
                *longest *= FARTHER;
            }
        }
        relaxed(scene, settings, &longest, &mut gone, &mut come);
    }
    gone.into_iter().map(Vec3::length).collect()
}

/// Rounds of [`relax`] within the longest move of each object; whether nothing of what has come collides any more.
fn relaxed(
    scene: &mut PartialScene,
    settings: &PlacementSettings,
    longest: &[f64],
    gone: &mut [Vec3],
    come: &mut [bool],
) -> bool {
    let mut all = solids(scene);
    let n = all.len();
    let weights: Vec<f64> = scene
        .placed
        .iter()
        .map(|p| {
            let seen = p.evidence.silhouette_iou.unwrap_or(0.2);
            let whole = if p.item.traits.heavily_occluded { 0.5 } else { 1.0 };
            (whole * seen * seen).max(MIN_WEIGHT)
        })
        .collect();
    let free: Vec<Vec<Vec3>> = (0..n).map(|i| free_directions(scene, i, &settings.noise)).collect();
    // How often each object has moved, and for each pair how often its two had when it was found apart, or stuck with so
    // much in one another: asked again only when one of them has moved since.
    let mut moves = vec![0_u32; n];
    let mut settled: BTreeMap<(usize, usize), ([u32; 2], f64)> = BTreeMap::new();
    for _ in 0..ROUNDS {
        let (mut worst, mut any) = (0.0_f64, false);
        for a in 0..n {
            for b in a + 1..n {
                if !(come[a] || come[b]) {
                    continue;
                }
                if let Some((at, depth)) = settled.get(&(a, b))
                    && *at == [moves[a], moves[b]]
                {
                    worst = worst.max(*depth);
                    continue;
                }
                let depth = excess(scene, &all, a, b, settings);
                worst = worst.max(depth);
                let parting = || match guest_and_host(scene, a, b) {
                    Some(pair) => way_beside(scene, &all, pair, depth, (gone, longest), &settings.noise),
                    None => cheapest_parting(scene, &all, [a, b], &weights, &free, (gone, longest), &settings.noise),
                };
                let parting = (depth > 0.0).then(parting).flatten();
                let Some((who, by)) = parting else {
                    settled.insert((a, b), ([moves[a], moves[b]], depth));
                    continue;
                };
                for (object, by) in who.into_iter().zip(by) {
                    if by != Vec3::ZERO {
                        any = true;
                        for moved in shift(scene, &mut all, object, by) {
                            moves[moved] += 1;
                            come[moved] = true;
                        }
                        gone[object] += by;
                    }
                }
            }
        }
        if worst <= 0.0 {
            return true;
        }
        if !any {
            return false;
        }
    }
    false
}

/// The displacements of two colliding objects that cost least: squared lengths by weight.
fn cheapest_parting(
    scene: &PartialScene,
    all: &[Solid],
    pair: [usize; 2],
    weights: &[f64],
    free: &[Vec<Vec3>],
    (gone, longest): (&[Vec3], &[f64]),
    noise: &Noise,
) -> Option<([usize; 2], [Vec3; 2])> {
    let [a, b] = pair;
    let mut best: Option<(f64, [Vec3; 2])> = None;
    let mut asked: Vec<Vec3> = Vec::new();
    let (wa, wb) = (weights[a], weights[b]);
    let least = wa * wb / (wa + wb);
    for direction in free[a].iter().chain(&free[b]) {
        for d in [*direction, -*direction] {
            if asked.iter().any(|known| known.distance_squared(d) < 1e-12) {
                continue;
            }
            asked.push(d);
            // No longer than what costs as much as the best so far.
            let limit = best.map_or(f64::INFINITY, |(cost, _)| (cost / least).sqrt() / STEP);
            let Some(way) = all[a].way_out(&all[b], d, limit) else { continue };
            let depth = STEP * (way + CLEARANCE);
            let may = |object: usize, by: Vec3| {
                let goes = free[object].iter().any(|f| f.dot(by.normalize_or_zero()) > 0.999);
                let near = (gone[object] + by).length() <= longest[object];
                goes && near && feasible(scene, all, object, &subtree(scene, object), by, noise)
            };
            let share = wb / (wa + wb);
            let both = [d * depth * share, -d * depth * (1.0 - share)];
            let options = [
                (depth * depth * least, both),
                (depth * depth * wa, [d * depth, Vec3::ZERO]),
                (depth * depth * wb, [Vec3::ZERO, -d * depth]),
            ];
            for (cost, by) in options {
                let allowed = [(a, by[0]), (b, by[1])].into_iter().all(|(o, by)| by == Vec3::ZERO || may(o, by));
                if best.is_none_or(|(c, _)| cost < c) && allowed {
                    best = Some((cost, by));
                }
            }
        }
    }
    best.map(|(_, by)| (pair, by))
}

/// The level displacement of what stands in a host out of the parts beside it: its host stays. `None` when it is shortest to lift
/// it, which its support does not allow.
fn way_beside(
    scene: &PartialScene,
    all: &[Solid],
    [guest, host]: [usize; 2],
    depth: f64,
    (gone, longest): (&[Vec3], &[f64]),
    noise: &Noise,
) -> Option<([usize; 2], [Vec3; 2])> {
    let members = subtree(scene, guest);
    let may =
        |by: Vec3| (gone[guest] + by).length() <= longest[guest] && feasible(scene, all, guest, &members, by, noise);
    let ways = all[guest].ways_beside(&all[host], &level_directions(), depth + ROUNDING);
    let mut clear = ways.into_iter().map(|way| way + way.normalize_or_zero() * CLEARANCE);
    clear.find(|by| may(*by)).map(|by| ([guest, host], [by, Vec3::ZERO]))
}

/// A way as long as the depth counts as that, metres.
const ROUNDING: f64 = 1e-4;

/// How far an object may reach out of the room, in metres.
const SLACK: f64 = 5e-3;

/// Whether a displacement keeps an object in the room and on its host.
fn feasible(scene: &PartialScene, all: &[Solid], object: usize, members: &[usize], by: Vec3, noise: &Noise) -> bool {
    let e = scene.room.extents.as_vec();
    let open = |wall| if scene.is_loose(wall) { f64::INFINITY } else { SLACK };
    let below = Vec3::new(open(Wall::Left), SLACK, open(Wall::Back));
    let above = Vec3::new(open(Wall::Right), SLACK, open(Wall::Front));
    let slack = Vec2::splat(SLACK);
    let inside = members.iter().all(|m| {
        let (low, high) = (all[*m].low, all[*m].high);
        let (to_low, to_high) = (low + by, high + by);
        // What was outside already (a recessed window) must only not go further.
        let in_box = (0..3).all(|i| to_low[i] >= low[i].min(-below[i]) && to_high[i] <= high[i].max(e[i] + above[i]));
        let in_niche = || {
            let mut areas = scene.room.standing_areas(to_low.y);
            areas.any(|[from, to]| to_low.xz().cmpge(from - slack).all() && to_high.xz().cmple(to + slack).all())
        };
        in_box || in_niche()
    });
    if !inside {
        return false;
    }
    let (host, level) = match attachment_of(scene, object, noise) {
        Attachment::OnHost { host, level } => (host, level),
        Attachment::OnLedge(ledge) => {
            let at = scene.placed[object].pose.position + by;
            return scene.room.ledge_top(ledge).is_some_and(|top| top.is_under(at));
        }
        _ => return true,
    };
    let placed = &scene.placed[object];
    let mut pose = placed.pose;
    pose.position += by;
    let query = SurfaceQuery { level, object_height: placed.size().height, soft: placed.item.traits.soft };
    let surface = surface_under(&scene.placed[host], &placed.item, &pose, &query);
    surface.is_some_and(|s| s.share >= STILL_SUPPORTED && (s.height - level).abs() < 0.03)
}

/// Moves an object and what rests on it; who moved.
fn shift(scene: &mut PartialScene, all: &mut [Solid], object: usize, by: Vec3) -> Vec<usize> {
    let members = subtree(scene, object);
    for m in &members {
        scene.placed[*m].pose.position += by;
        all[*m] = all[*m].moved(by);
    }
    members
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_scene::{Pose, Support};
    use proptest::prelude::*;

    use super::*;
    use crate::Evidence;
    use crate::testing::{boxed, empty_room};

    fn with(boxes: &[(Vec3, f64, f64)]) -> PartialScene {
        let mut scene = empty_room();
        for (i, (size, x, z)) in boxes.iter().enumerate() {
            let position = Vec3::new(*x, 0.0, *z);
            let mut item = boxed(&scene, *size, position, 0.0);
            item.id = ObjectId::numbered("box", i);
            let pose = Pose::new(position, 0.0, 1.0);
            let (item, support, evidence) = (Arc::new(item), Support::Floor, Evidence::default());
            scene.placed.push(Placed { item, pose, support, evidence });
        }
        scene
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn a_pair_is_parted_by_no_more_than_the_shortest_way_out(deep in 0.005_f64..0.1, z in -0.2_f64..0.2, w in 0.3_f64..1.0) {
            let settings = PlacementSettings::default();
            let mut scene =
                with(&[(Vec3::new(1.0, 0.6, 0.6), 2.0, 2.5), (Vec3::new(w, 0.8, 0.5), 2.5 + w / 2.0 - deep, 2.5 + z)]);
            let all = solids(&scene);
            let depth = excess(&scene, &all, 1, 0, &settings);
            prop_assert!((depth - deep).abs() < 1e-3, "{depth}");
            let gone = relax(&mut scene, &settings);
            prop_assert!(collisions(&scene, &settings).is_empty());
            // Both together go as far as one had to, and the clearance.
            prop_assert!(gone[0] + gone[1] <= depth + 0.01, "{gone:?} {depth}");
        }
    }

    #[test]
    fn what_stands_at_a_wall_makes_room_for_what_hangs_there() {
        let settings = PlacementSettings::default();
        // A sofa with its back to the wall, and a curtain of 12 cm that is wider than it.
        let mut scene = with(&[(Vec3::new(1.6, 0.8, 0.8), 2.0, 0.41), (Vec3::new(3.0, 2.2, 0.12), 2.0, 0.06)]);
        for (i, p) in scene.placed.iter_mut().enumerate() {
            let mut item = (*p.item).clone();
            item.relations.wall_affinity = harmony_scene::WallAffinity::Back;
            if i == 1 {
                item.level = Level::Wall;
                p.support = Support::Wall { wall: Wall::Back };
            }
            p.item = Arc::new(item);
        }
        assert!(
            matches!(attachment_of(&scene, 0, &settings.noise), Attachment::AgainstWall(p) if p == Wall::Back.into())
        );
        relax(&mut scene, &settings);
        assert_eq!(collisions(&scene, &settings), vec![]);
        let (sofa, curtain) = (scene.placed[0].pose.position, scene.placed[1].pose.position);
        assert!((sofa.x - 2.0).abs() < 1e-9 && (0.51..0.53).contains(&sofa.z), "{sofa}");
        assert!((curtain.z - 0.06).abs() < 1e-9, "{curtain}");
        // It still stands at its wall.
        assert!(
            matches!(attachment_of(&scene, 0, &settings.noise), Attachment::AgainstWall(p) if p == Wall::Back.into())
        );
    }

    #[test]
    fn a_stool_may_stand_under_a_table_whose_box_it_is_in() {
        let settings = PlacementSettings::default();
        let mut scene = with(&[(Vec3::new(1.2, 0.75, 0.8), 2.0, 2.5), (Vec3::new(0.4, 0.45, 0.4), 2.0, 2.5)]);
        assert_eq!(collisions(&scene, &settings).len(), 1, "as boxes they collide");
        // The same table as a top and four legs.
        let slab = |x0: f64, x1: f64, y0: f64, y1: f64, z0: f64, z1: f64| {
            let b = harmony_mesh::Bounds { min: Vec3::new(x0, y0, z0), max: Vec3::new(x1, y1, z1) };
            crate::scene::shape::corners(&b).to_vec()
        };
        let mut hulls = vec![slab(-0.6, 0.6, 0.7, 0.75, -0.4, 0.4)];
        for (x, z) in [(-0.6, -0.4), (0.55, -0.4), (-0.6, 0.35), (0.55, 0.35)] {
            hulls.push(slab(x, x + 0.05, 0.0, 0.7, z, z + 0.05));
        }
        let mut table = (*scene.placed[0].item).clone();
        table.shape = Arc::new(crate::Shape::new(Arc::clone(table.shape.mesh()), hulls));
        scene.placed[0].item = Arc::new(table);
        assert!(collisions(&scene, &settings).is_empty());
    }

    #[test]
    fn what_stands_in_a_case_comes_forward_out_of_its_back() {
        let settings = PlacementSettings::default();
        // A case 1 m wide, 0.4 m deep and high, of boards of 2 cm, and a box on its lowest board.
        let case = |boards: &[(Vec3, Vec3)], z: f64| {
            let mut scene = with(&[(Vec3::new(1.0, 0.4, 0.4), 2.0, 2.5), (Vec3::new(0.2, 0.25, 0.2), 2.0, 2.5 + z)]);
            let mut host = (*scene.placed[0].item).clone();
            host.shape = Arc::new(crate::testing::of_boxes(boards));
            scene.placed[0].item = Arc::new(host);
            scene.placed[1].support = Support::Object { id: scene.placed[0].item.id.clone() };
            scene.placed[1].pose.position.y = 0.02;
            scene
        };
        let boards = [
            (Vec3::new(1.0, 0.02, 0.4), Vec3::new(0.0, 0.0, 0.0)),
            (Vec3::new(1.0, 0.02, 0.4), Vec3::new(0.0, 0.38, 0.0)),
            (Vec3::new(0.02, 0.36, 0.4), Vec3::new(-0.49, 0.02, 0.0)),
            (Vec3::new(0.02, 0.36, 0.4), Vec3::new(0.49, 0.02, 0.0)),
            (Vec3::new(1.0, 0.36, 0.02), Vec3::new(0.0, 0.02, -0.19)),
        ];
        // Its back stands out behind the panel by 2 cm.
        let mut scene = case(&boards, -0.12);
        assert!((collisions(&scene, &settings)[0].penetration - 0.04).abs() < 2e-3);
        let gone = relax(&mut scene, &settings);
        assert_eq!(collisions(&scene, &settings), vec![]);
        assert_eq!(gone[0], 0.0, "the case stays");
        let moved = scene.placed[1].pose.position - Vec3::new(2.0, 0.02, 2.38);
        assert!((moved.z - 0.041).abs() < 2e-3 && moved.x.abs() < 1e-9, "{moved}");
        // Where there is room nothing is in anything, and a case that is one solid says nothing about its inside.
        assert_eq!(collisions(&case(&boards, -0.05), &settings), vec![]);
        assert_eq!(collisions(&case(&[(Vec3::new(1.0, 0.4, 0.4), Vec3::ZERO)], -0.12), &settings), vec![]);
    }

    #[test]
    fn a_box_between_two_walls_of_furniture_pushes_its_neighbour() {
        let settings = PlacementSettings::default();
        let mut scene = with(&[
            (Vec3::new(1.6, 0.8, 0.6), 0.9, 2.0),
            (Vec3::new(1.0, 0.8, 0.6), 2.12, 2.0),
            (Vec3::new(0.6, 0.8, 0.6), 2.93, 2.0),
        ]);
        // Everything stands in a row along the back wall: to slide along it is much less than to come forward.
        for p in &mut scene.placed {
            let mut item = (*p.item).clone();
            item.relations.wall_affinity = harmony_scene::WallAffinity::Back;
            p.item = Arc::new(item);
            p.pose.position.z = 0.32;
        }
        relax(&mut scene, &settings);
        assert!(collisions(&scene, &settings).is_empty());
        assert!(scene.placed.iter().all(|p| (p.pose.position.z - 0.32).abs() < 1e-9), "backs stay at the wall");
    }

    #[test]
    fn a_row_a_little_too_tight_makes_room_along_itself() {
        let settings = PlacementSettings::default();
        let boxes: Vec<(Vec3, f64, f64)> =
            (0..4).map(|i| (Vec3::new(0.6, 0.8, 0.6), 1.0 + 0.57 * f64::from(i), 2.0)).collect();
        let mut scene = with(&boxes);
        assert!(!collisions(&scene, &settings).is_empty());
        let gone = relax(&mut scene, &settings);
        assert!(collisions(&scene, &settings).is_empty());
        assert!(gone.iter().all(|g| *g < 0.12), "{gone:?}");
        let x: Vec<f64> = scene.placed.iter().map(|p| p.pose.position.x).collect();
        assert!(x.windows(2).all(|w| w[0] < w[1]), "nobody jumps over a neighbour: {x:?}");
    }

    #[test]
    fn only_what_agrees_with_nothing_goes_farther_than_it_should() {
        let settings = PlacementSettings::default();
        let mut scene = with(&[(Vec3::new(1.0, 0.8, 1.0), 1.5, 2.0), (Vec3::new(1.0, 0.8, 1.0), 2.0, 2.0)]);
        let seen = |iou| Evidence { silhouette_iou: Some(iou), ..Evidence::default() };
        scene.placed[0].evidence = seen(0.9);
        scene.placed[1].evidence = seen(0.8);
        let mut sure = scene.clone();
        relax(&mut sure, &settings);
        assert!(!collisions(&sure, &settings).is_empty(), "both are where they are seen");
        scene.placed[1].evidence = seen(0.1);
        let gone = relax(&mut scene, &settings);
        assert!(collisions(&scene, &settings).is_empty());
        assert!(gone[0] <= settings.noise.longest_move[1] && gone[1] > settings.noise.longest_move[1], "{gone:?}");
    }
}
