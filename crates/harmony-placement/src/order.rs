//! In which order objects are placed. Paper Sec. 3.3 "VLM Placement Order Reasoning", App. C "Placement order".
//!
//! Hosts come before what they carry (a need), what is faced before who faces it (a wish); the rest goes from the
//! deepest floor corner along the walls and then from the far end to the camera. A given order is kept where it agrees
//! with the needs. The sort is stable and goes depth-first along dependants; circles are broken at wishes first, and
//! told. Distances are metres on the floor, of places estimated from mask and map alone: meshes are not asked, so that
//! they are rough.

use std::sync::Arc;

use harmony_scene::{Level, Mask, ObjectId, Vec2, Vec3};

use crate::stats::median;
use crate::{Item, PartialScene, PlacementSettings};

/// One place of the order.
#[derive(Debug, Clone, PartialEq)]
pub struct OrderEntry {
    /// Index into the items.
    pub item: usize,
    /// Distance of its estimated position to the anchor corner, metres.
    pub anchor_distance: f64,
}

/// The order, and what had to be repaired.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OrderReport {
    /// A permutation of the items.
    pub entries: Vec<OrderEntry>,
    /// Items whose dependencies formed a cycle that was broken at them.
    pub broken_cycles: Vec<ObjectId>,
    /// Items that had to move because the given order had them before what they depend on.
    pub moved: Vec<ObjectId>,
    /// Ids of the given order that are unknown, or given twice.
    pub ignored: Vec<ObjectId>,
}

/// How strongly one item waits for another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Edge {
    /// It stands on it: nothing to stand on before.
    Hard,
    /// It faces it, or stands before or behind it: better after it.
    Soft,
}

/// What the order is sorted by, smaller first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Key {
    tier: u8,
    distance: f64,
}

/// Works out the order: deepest corner first, wall-affine before centre, farther before nearer, dependants after
/// their anchors. A given order (the VLM's) is kept where it is consistent and repaired where it isn't.
///
/// The traversal is depth-first: once an anchor is placed, what depends on it comes next, before the traversal
/// goes on from the corner. Among equals the order in which the items were given decides, so that the result is
/// the same on every run.
pub fn placement_order(
    scene: &PartialScene,
    items: &[Arc<Item>],
    given: Option<&[ObjectId]>,
    settings: &PlacementSettings,
) -> OrderReport {
    let mut report = OrderReport::default();
    let places: Vec<Vec3> = items.iter().map(|i| rough_position(scene, i)).collect();
    let anchor_distance: Vec<f64> = places.iter().map(|p| level_distance(*p, scene.anchor)).collect();
    let rank = if settings.placement_order {
        let own = own_rank(scene, items, &places, &anchor_distance, settings);
        given.map_or(own.clone(), |g| given_rank(items, g, &own, &mut report))
    } else {
        (0..items.len()).collect()
    };
    let edges = dependencies(items, settings);
    let order = sorted(items, &rank, &edges, settings.depth_first && settings.placement_order, &mut report);
    if given.is_some() && settings.placement_order {
        report.moved = moved(items, &order, &rank, &edges);
    }
    report.entries =
        order.into_iter().map(|item| OrderEntry { item, anchor_distance: anchor_distance[item] }).collect();
    report
}

fn level_distance(a: Vec3, b: Vec3) -> f64 {
    Vec2::new(a.x - b.x, a.z - b.z).length()
}

/// Position in the paper's own order for each item.
fn own_rank(
    scene: &PartialScene,
    items: &[Arc<Item>],
    places: &[Vec3],
    anchor_distance: &[f64],
    settings: &PlacementSettings,
) -> Vec<usize> {
    let key = |i: usize| -> Key {
        let item = &items[i];
        // A rug lies under everything and hides nothing.
        let tier = match (item.traits.flat, item.relations.wall_affinity.wall()) {
            (true, _) => 0,
            (false, Some(_)) => 1,
            (false, None) => 2,
        };
        // Along the walls outward from the corner; in the middle from the far end to the camera.
        let far_first = -scene.camera.depth(places[i]);
        Key { tier, distance: if settings.depth_first && tier < 2 { anchor_distance[i] } else { far_first } }
    };
    let mut by_key: Vec<(Key, usize)> = (0..items.len()).map(|i| (key(i), i)).collect();
    by_key.sort_by(|(a, i), (b, j)| a.tier.cmp(&b.tier).then(a.distance.total_cmp(&b.distance)).then(i.cmp(j)));
    let mut rank = vec![0; items.len()];
    for (position, (_, i)) in by_key.into_iter().enumerate() {
        rank[i] = position;
    }
    rank
}

/// The given order first; what it forgot follows in our own order.
fn given_rank(items: &[Arc<Item>], given: &[ObjectId], own: &[usize], report: &mut OrderReport) -> Vec<usize> {
    let mut rank = vec![usize::MAX; items.len()];
    let mut next = 0;
    for id in given {
        match items.iter().position(|i| i.id == *id).filter(|i| rank[*i] == usize::MAX) {
            Some(i) => {
                rank[i] = next;
                next += 1;
            }
            None => report.ignored.push(id.clone()),
        }
    }
    for (i, r) in rank.iter_mut().enumerate() {
        if *r == usize::MAX {
            *r = items.len() + own[i];
        }
    }
    rank
}

/// For each item the items that must, or had better, come before it.
fn dependencies(items: &[Arc<Item>], settings: &PlacementSettings) -> Vec<Vec<(usize, Edge)>> {
    let find = |id: &Option<ObjectId>| id.as_ref().and_then(|id| items.iter().position(|i| i.id == *id));
    items
        .iter()
        .enumerate()
        .map(|(own, item)| {
            let r = &item.relations;
            let mut out: Vec<(usize, Edge)> = Vec::new();
            out.extend(find(&r.on_top_of).map(|i| (i, Edge::Hard)));
            if settings.placement_order {
                for other in [&r.facing_toward, &r.in_front_of, &r.behind] {
                    out.extend(find(other).map(|i| (i, Edge::Soft)));
                }
            }
            out.retain(|(i, _)| *i != own);
            out
        })
        .collect()
}

/// Stable topological sort; with `depth_first`, dependants follow their anchor at once.
fn sorted(
    items: &[Arc<Item>],
    rank: &[usize],
    edges: &[Vec<(usize, Edge)>],
    depth_first: bool,
    report: &mut OrderReport,
) -> Vec<usize> {
    let mut order: Vec<usize> = Vec::with_capacity(items.len());
    let mut position: Vec<Option<usize>> = vec![None; items.len()];
    while order.len() < items.len() {
        let waiting: Vec<usize> = (0..items.len()).filter(|i| position[*i].is_none()).collect();
        let blocked = |i: usize, hard_only: bool| {
            edges[i].iter().any(|(j, e)| position[*j].is_none() && (!hard_only || *e == Edge::Hard))
        };
        // The most recently placed anchor of an item: the deeper in the traversal, the sooner it goes on from there.
        let recent = |i: usize| {
            let latest = edges[i].iter().filter_map(|(j, _)| position[*j]).max();
            if depth_first { latest.map_or(0, |p| p + 1) } else { 0 }
        };
        let best = |hard_only: Option<bool>| {
            waiting
                .iter()
                .copied()
                .filter(|i| hard_only.is_none_or(|h| !blocked(*i, h)))
                .min_by_key(|i| (std::cmp::Reverse(recent(*i)), rank[*i], *i))
        };
        let next = best(Some(false)).or_else(|| {
            // Everybody waits for somebody: let go of the wishes first, which may be mutual (a sofa faces the table that stands
            // in front of it), then of the needs.
            best(Some(true)).or_else(|| {
                let broken = best(None);
                report.broken_cycles.extend(broken.map(|i| items[i].id.clone()));
                broken
            })
        });
        let Some(next) = next else { break };
        position[next] = Some(order.len());
        order.push(next);
    }
    order
}

/// Items that the given order had before something they depend on.
fn moved(items: &[Arc<Item>], order: &[usize], rank: &[usize], edges: &[Vec<(usize, Edge)>]) -> Vec<ObjectId> {
    let early = |i: &usize| edges[*i].iter().any(|(j, _)| rank[*j] > rank[*i]);
    order.iter().copied().filter(early).map(|i| items[i].id.clone()).collect()
}

/// Where an item is, as far as mask and point map tell without its mesh.
fn rough_position(scene: &PartialScene, item: &Item) -> Vec3 {
    if let Some(p) = by_points(scene, &item.mask) {
        return p;
    }
    let e = &scene.room.extents;
    let Some(b) = item.mask.bounds() else { return Vec3::new(e.width / 2.0, 0.0, e.depth / 2.0) };
    let pixel = match item.level {
        Level::Furniture | Level::Decoration => Vec2::new(b.centre().x, b.y1),
        Level::Wall => b.centre(),
        Level::Ceiling => Vec2::new(b.centre().x, b.y0),
    };
    scene.room.faces().exit(&scene.camera.ray(pixel)).map_or(Vec3::ZERO, |exit| exit.point)
}

fn by_points(scene: &PartialScene, mask: &Mask) -> Option<Vec3> {
    let points = scene.points.as_ref().filter(|p| p.is_dense())?;
    let (mw, mh) = (mask.size().width as usize, mask.size().height as usize);
    let (w, h) = (points.size.width as usize, points.size.height as usize);
    let bounds = mask.bounds()?;
    // A few hundred samples are enough for a median.
    let step = ((bounds.area() / 400.0).sqrt().ceil() as usize).max(1);
    let (mut xs, mut zs) = (Vec::new(), Vec::new());
    for y in (bounds.y0 as usize..bounds.y1 as usize).step_by(step) {
        for x in (bounds.x0 as usize..bounds.x1 as usize).step_by(step) {
            if !mask.get(x as i64, y as i64) {
                continue;
            }
            let i = (y * h / mh).min(h - 1) * w + (x * w / mw).min(w - 1);
            if let Some(p) = points.xyz.get(i).filter(|p| p.is_finite()) {
                xs.push(p.x);
                zs.push(p.z);
            }
        }
    }
    (!xs.is_empty()).then(|| Vec3::new(median(&mut xs), 0.0, median(&mut zs)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{boxed, empty_room};
    use harmony_scene::{Relations, WallAffinity};
    use proptest::prelude::*;

    fn id(i: usize) -> ObjectId {
        ObjectId::numbered("thing", i)
    }

    fn item(scene: &PartialScene, i: usize, x: f64, z: f64, relations: Relations) -> Arc<Item> {
        let mut item = boxed(scene, Vec3::new(0.4, 0.5, 0.4), Vec3::new(x, 0.0, z), 0.0);
        item.id = id(i);
        item.relations = relations;
        Arc::new(item)
    }

    fn wall() -> Relations {
        Relations { wall_affinity: WallAffinity::Back, ..Relations::default() }
    }

    fn ids(report: &OrderReport) -> Vec<usize> {
        report.entries.iter().map(|e| e.item).collect()
    }

    #[test]
    fn walls_come_from_the_corner_then_the_middle_from_far_to_near() {
        let scene = empty_room();
        let items = [
            item(&scene, 0, 2.0, 3.0, Relations::default()),
            item(&scene, 1, 3.0, 0.3, wall()),
            item(&scene, 2, 2.0, 1.8, Relations::default()),
            item(&scene, 3, 0.6, 0.3, wall()),
        ];
        let report = placement_order(&scene, &items, None, &PlacementSettings::default());
        let anchor_is_left = scene.anchor.x < 1.0;
        assert_eq!(ids(&report), if anchor_is_left { vec![3, 1, 2, 0] } else { vec![1, 3, 2, 0] });
    }

    #[test]
    fn a_given_order_is_kept_but_for_what_stands_on_something() {
        let scene = empty_room();
        let on = Relations { on_top_of: Some(id(2)), ..Relations::default() };
        let items = [
            item(&scene, 0, 2.0, 2.0, on),
            item(&scene, 1, 1.0, 2.0, Relations::default()),
            item(&scene, 2, 3.0, 2.0, Relations::default()),
        ];
        let given = [id(0), id(2), id(9), id(1), id(2)];
        let report = placement_order(&scene, &items, Some(&given), &PlacementSettings::default());
        assert_eq!(ids(&report), vec![2, 0, 1]);
        assert_eq!(report.moved, vec![id(0)]);
        assert_eq!(report.ignored, vec![id(9), id(2)]);
        assert!(report.broken_cycles.is_empty());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn the_order_is_a_permutation_with_anchors_before_dependants(
            on in proptest::collection::vec(proptest::option::of(0_usize..8), 1..8),
            faces in proptest::collection::vec(proptest::option::of(0_usize..8), 8),
            given in proptest::collection::vec(0_usize..10, 0..10),
            depth_first: bool,
        ) {
            let scene = empty_room();
            let n = on.len();
            let items: Vec<Arc<Item>> = (0..n)
                .map(|i| {
                    let relations = Relations {
                        // Only lower numbers: no cycle among the needs.
                        on_top_of: on[i].filter(|j| *j < i).map(id),
                        facing_toward: faces[i].map(id),
                        ..Relations::default()
                    };
                    item(&scene, i, 1.0 + 0.3 * i as f64, 2.0, relations)
                })
                .collect();
            let given: Vec<ObjectId> = given.into_iter().map(id).collect();
            let settings = PlacementSettings { depth_first, ..PlacementSettings::default() };
            let report = placement_order(&scene, &items, Some(&given), &settings);
            let order = ids(&report);
            let mut seen = order.clone();
            seen.sort_unstable();
            prop_assert_eq!(seen, (0..n).collect::<Vec<_>>());
            let at = |i: usize| order.iter().position(|k| *k == i).unwrap();
            for (i, host) in on.iter().enumerate() {
                if let Some(j) = host.filter(|j| *j < i) {
                    prop_assert!(at(j) < at(i));
                }
            }
        }
    }
}
