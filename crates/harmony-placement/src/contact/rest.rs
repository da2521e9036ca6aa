//! Support: everything lies on what carries it.
//!
//! Hosts are settled before what they carry, so that a tray on a table follows both. An object stands on its lowest
//! points; the surfaces under them come from rays on the host's mesh (`scene::support`), and narrow rims from the edges
//! of its faces, which rays miss. What hangs in the air beside its host is moved towards the host's middle, no farther
//! than it must and never beyond a limit: then the host is wrong, not the place. Room frame, metres. Only level
//! surfaces carry; nothing tips over or leans here.

use harmony_scene::{PlacementType, Pose, Support, Vec3};

use crate::scene::attachment::{PoseConstraint, reach, sag_of};
use crate::scene::subtree::subtree;
use crate::scene::support::{Surface, SurfaceQuery, ray_hit, surface_under};
use crate::{PartialScene, Placed, PlacementSettings};

/// Share of a footprint that must be on the host, and how far the surface may be from where the object stands, metres.
const SUPPORTED: f64 = 0.5;
/// ... or nearly as much as anywhere on it, and at least this much.
const NEARLY: f64 = 0.8;
const MIN_SUPPORTED: f64 = 0.15;
const SAME_LEVEL: f64 = 0.05;
/// Height within which the lowest points of an object are what it stands on, metres; more is in the air.
const FOOT: f64 = 0.004;
/// Steps in which an object is moved towards its host's middle.
const STEPS: u32 = 40;
/// Rays along each side of an object's footprint that tell how far it can sink.
const SINK_RAYS: u32 = 9;
/// Distance of points on the edges of a host's faces, metres.
const RIM_STEP: f64 = 0.005;
/// What is farther from its host than this does not rest on it, metres: the host is wrong, not the place.
const FARTHEST_BACK: f64 = 0.4;

/// Gives objects new poses, and all of them their place on their supports again.
///
/// What stands on something keeps its share of the host's height: where a host grew by more than the slack within which
/// surfaces are looked for, nothing would find its top again.
pub(crate) fn take_poses(scene: &mut PartialScene, poses: Vec<(usize, Pose)>, settings: &PlacementSettings) {
    let share = |p: &Placed| {
        let Support::Object { id } = &p.support else { return None };
        let host = scene.position(id).filter(|h| scene.placed[*h].item.id != p.item.id)?;
        let height = p.pose.position.y + sag_of(&p.item, &p.pose) - scene.placed[host].pose.position.y;
        let share = height / scene.placed[host].size().height;
        share.is_finite().then_some((host, share))
    };
    let shares: Vec<Option<(usize, f64)>> = scene.placed.iter().map(share).collect();
    for (i, pose) in poses {
        scene.placed[i].pose = pose;
    }
    for (i, share) in shares.into_iter().enumerate() {
        if let Some((host, share)) = share {
            let host = &scene.placed[host];
            let level = host.pose.position.y + share * host.size().height;
            let placed = &mut scene.placed[i];
            placed.pose.position.y = level - sag_of(&placed.item, &placed.pose);
        }
    }
    settle_all(scene, settings);
}

/// Puts everything back onto its support, hosts before what they carry.
pub(crate) fn settle_all(scene: &mut PartialScene, settings: &PlacementSettings) {
    let order: Vec<usize> = {
        let carried = |i: usize| matches!(scene.placed[i].support, Support::Object { .. });
        let mut all: Vec<usize> = (0..scene.placed.len()).collect();
        all.sort_by_key(|i| carried(*i));
        all
    };
    for i in order {
        let pose = PoseConstraint::as_placed(scene, i, &settings.noise).settle(&scene.placed[i].pose);
        scene.placed[i].pose = pose;
        sink_onto_host(scene, i);
    }
}

/// Moves what hangs in the air beside its host back onto it, no farther than it must.
///
/// Host and object are refined each by what is seen of it; where both are half hidden they may part.
pub(crate) fn back_onto_hosts(scene: &mut PartialScene) {
    for i in 0..scene.placed.len() {
        let Some((object, host)) = with_host(scene, i) else { continue };
        let start = object.pose.position;
        let places = places_towards_middle(object, host);
        let feet = feet(object);
        let stands = |p: &&Place| p.carries && gap_below(&feet, host, p.at).is_some_and(|gap| gap < FOOT);
        let found = places.iter().find(stands).or_else(|| places.iter().find(|p| p.carries));
        let found = found.filter(|p| p.at.distance(start) <= FARTHEST_BACK);
        if let Some(place) = found {
            let by = place.at - start;
            for member in subtree(scene, i) {
                scene.placed[member].pose.position += by;
            }
        }
    }
}

/// Lets an object that stands on another one sink until it touches it: the surface under its footprint may be that of a
/// rim which its base is not on.
pub(crate) fn sink_onto_host(scene: &mut PartialScene, i: usize) {
    let Some((object, host)) = with_host(scene, i) else { return };
    let at = object.pose.position;
    let (low, high) = reach(&object.item, &object.pose);
    let underside = |x: f64, z: f64| {
        let from = Vec3::new(x, at.y + low.y - SAME_LEVEL, z);
        ray_hit(object, from, Vec3::Y).map(|(hit, _)| hit)
    };
    let share = |k: u32| f64::from(k) / f64::from(SINK_RAYS - 1);
    let grid = (0..SINK_RAYS * SINK_RAYS).map(|k| (share(k % SINK_RAYS), share(k / SINK_RAYS)));
    let points = grid.filter_map(|(u, v)| {
        let place = at + low + (high - low) * Vec3::new(u, 0.0, v);
        underside(place.x, place.z).map(|hit| hit - at)
    });
    let under: Vec<Vec3> = points.chain(feet(object)).collect();
    let Some(gap) = gap_below(&under, host, at).filter(|gap| *gap > FOOT) else { return };
    // A narrow rim shows in the edges of its faces.
    let (from, to) = (at + low - Vec3::Y * SAME_LEVEL, (at + high).with_y(at.y + low.y + SAME_LEVEL));
    let mesh = host.item.shape.mesh();
    let faces = mesh.triangles().map(|t| t.map(|i| host.pose.point(mesh.positions[i as usize].as_dvec3())));
    let near = faces.filter(|[p, q, r]| p.min(*q).min(*r).cmple(to).all() && p.max(*q).max(*r).cmpge(from).all());
    let over_rim = near
        .flat_map(|[p, q, r]| [[p, q], [q, r], [r, p]])
        .flat_map(|[p, q]| {
            let steps = (p.distance(q) / RIM_STEP).ceil().clamp(1.0, 500.0) as u32;
            (0..=steps).map(move |k| p.lerp(q, f64::from(k) / f64::from(steps)))
        })
        .filter(|p| p.cmpge(from).all() && p.cmple(to).all())
        .filter_map(|p| Some(underside(p.x, p.z)?.y - p.y));
    let gap = over_rim.fold(gap, f64::min);
    if gap > FOOT {
        scene.placed[i].pose.position.y -= gap;
    }
}

/// A place on a host.
struct Place {
    /// On the host's surface.
    at: Vec3,
    /// Whether the surface holds an object there: half of its footprint, or, as a narrow shelf carries what is deeper
    /// than it, nearly as much as anywhere on this host.
    carries: bool,
}

/// The places with a surface under them, from where an object stands to its host's middle.
fn places_towards_middle(object: &Placed, host: &Placed) -> Vec<Place> {
    let start = object.pose.position;
    let middle = Vec3::new(host.pose.position.x, start.y, host.pose.position.z);
    let surfaces: Vec<(Vec3, Surface)> = (0..=STEPS)
        .map(|k| start.lerp(middle, f64::from(k) / f64::from(STEPS)))
        .filter_map(|p| Some((p, surface_at(object, host, p)?)))
        .collect();
    let most = surfaces.iter().map(|(_, s)| s.share).fold(0.0, f64::max);
    let enough = SUPPORTED.min(NEARLY * most).max(MIN_SUPPORTED);
    let sag = sag_of(&object.item, &object.pose);
    let place = |(p, s): (Vec3, Surface)| Place { at: Vec3::new(p.x, s.height - sag, p.z), carries: s.share >= enough };
    surfaces.into_iter().map(place).collect()
}

/// The points on which an object stands, relative to its position.
fn feet(object: &Placed) -> Vec<Vec3> {
    let linear = object.pose.linear();
    let mut corners: Vec<Vec3> = object.item.shape.hulls().iter().flatten().map(|p| linear * *p).collect();
    let lowest = corners.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    corners.retain(|p| p.y < lowest + FOOT);
    corners
}

/// Height of the foot that is least above the host's surface when an object is at a place, metres, at most
/// [`SAME_LEVEL`]; `None` where all feet are beyond the host's edge or over lower surfaces.
fn gap_below(feet: &[Vec3], host: &Placed, at: Vec3) -> Option<f64> {
    let gap = |foot: Vec3| {
        let (hit, _) = ray_hit(host, foot + Vec3::Y * SAME_LEVEL, Vec3::NEG_Y)?;
        Some(foot.y - hit.y)
    };
    feet.iter().filter_map(|f| gap(at + *f)).min_by(f64::total_cmp).filter(|gap| *gap <= SAME_LEVEL)
}

/// An object that stands on another one, and that one.
fn with_host(scene: &PartialScene, i: usize) -> Option<(&Placed, &Placed)> {
    let Support::Object { id } = &scene.placed[i].support else { return None };
    let host = scene.position(id).filter(|h| *h != i)?;
    Some((&scene.placed[i], &scene.placed[host]))
}

/// The host's surface under an object at a place, near the height at which it is now.
fn surface_at(object: &Placed, host: &Placed, position: Vec3) -> Option<Surface> {
    let level = object.pose.position.y + sag_of(&object.item, &object.pose);
    let query = SurfaceQuery { level, object_height: object.size().height, soft: object.item.traits.soft };
    let pose = Pose { position, ..object.pose };
    surface_under(host, &object.item, &pose, &query).filter(|s| (s.height - level).abs() <= SAME_LEVEL)
}

/// Whether an object is said to stand on another one that does not carry it where it is.
pub(crate) fn hangs_in_the_air(scene: &PartialScene, i: usize) -> bool {
    with_host(scene, i).is_some_and(|(object, host)| {
        let at = object.pose.position;
        let here = |p: &Place| p.at.with_y(at.y) == at;
        object.item.placement.placement_type == PlacementType::OnSurface
            && !places_towards_middle(object, host).first().is_some_and(|p| here(p) && p.carries)
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_scene::ObjectId;

    use super::*;
    use crate::testing::{BACK_Z, add, armchair, empty_room, of_boxes, throw_over_an_edge};

    fn on(name: &str) -> Support {
        Support::Object { id: ObjectId::new(name).unwrap() }
    }

    #[test]
    fn a_narrow_shelf_carries_what_is_deeper_than_it() {
        let mut scene = empty_room();
        add(&mut scene, "shelf_01", Vec3::new(0.6, 0.05, 0.1), Vec3::new(2.0, 0.0, 2.0), |_| {});
        let vase = Vec3::new(0.3, 0.4, 0.3);
        add(&mut scene, "vase_01", vase, Vec3::new(2.5, 0.05, 2.06), |p| p.support = on("shelf_01"));
        assert!(hangs_in_the_air(&scene, 1));
        back_onto_hosts(&mut scene);
        let at = scene.placed[1].pose.position;
        assert!(at.x < 2.3 && at.x > 2.1, "{at}");
        assert!(!hangs_in_the_air(&scene, 1));
    }

    #[test]
    fn a_lamp_beside_its_table_comes_back_onto_it_and_one_on_it_stays() {
        let mut scene = empty_room();
        add(&mut scene, "table_01", Vec3::new(0.6, 0.5, 0.6), Vec3::new(2.0, 0.0, 2.0), |_| {});
        let lamp = Vec3::new(0.2, 0.4, 0.2);
        add(&mut scene, "lamp_01", lamp, Vec3::new(2.45, 0.5, 2.0), |p| p.support = on("table_01"));
        add(&mut scene, "lamp_02", lamp, Vec3::new(1.9, 0.5, 1.9), |p| p.support = on("table_01"));
        add(&mut scene, "cap_01", Vec3::splat(0.1), Vec3::new(2.45, 0.9, 2.0), |p| p.support = on("lamp_01"));
        back_onto_hosts(&mut scene);
        let at = |i: usize| scene.placed[i].pose.position;
        assert!(at(1).x > 2.2 && at(1).x <= 2.32, "{:?}", at(1));
        assert!((at(1).y - 0.5).abs() < 1e-6);
        assert_eq!(at(2), Vec3::new(1.9, 0.5, 1.9));
        // What stands on it goes along.
        assert!((at(3).x - at(1).x).abs() < 1e-9, "{:?}", at(3));
    }

    #[test]
    fn what_leans_over_an_edge_moves_until_it_stands_on_it() {
        let mut scene = empty_room();
        add(&mut scene, "shelf_01", Vec3::new(0.6, 0.05, 0.2), Vec3::new(2.0, 0.0, 2.0), |_| {});
        // A frame tilted forwards: its front edge is 6 mm lower than its back.
        let slab = Vec3::new(0.2, 0.25, 0.1);
        add(&mut scene, "frame_01", slab, Vec3::new(2.0, 0.05, 2.06), |p| {
            p.support = on("shelf_01");
            let mut item = (*p.item).clone();
            let mut mesh = crate::testing::box_mesh(slab);
            for p in &mut mesh.positions {
                p.y += if p.z < 0.0 { 0.006 } else { 0.0 };
            }
            let hull = mesh.positions.iter().map(|p| p.as_dvec3()).collect();
            item.shape = Arc::new(crate::Shape::new(Arc::new(mesh), vec![hull]));
            p.item = Arc::new(item);
        });
        assert!(!hangs_in_the_air(&scene, 1));
        back_onto_hosts(&mut scene);
        let at = scene.placed[1].pose.position;
        assert!(at.z <= 2.05 + 1e-6 && at.z > 2.03, "{at}");
    }

    #[test]
    fn a_wide_shade_over_a_rim_does_not_lift_a_lamp() {
        let y = |y: f64| Vec3::Y * y;
        let rim = (Vec3::new(0.1, 0.03, 0.6), Vec3::new(0.25, 0.5, 0.0));
        let lip = (Vec3::new(0.6, 0.01, 0.004), Vec3::new(0.0, 0.5, 0.043));
        let bump = (Vec3::new(0.04, 0.01, 0.6), y(0.5));
        for (on_table, height) in [(vec![rim], 0.5), (vec![rim, bump], 0.51), (vec![rim, lip], 0.51)] {
            let mut scene = empty_room();
            let with = |shape: crate::Shape| {
                move |p: &mut Placed| {
                    let mut item = (*p.item).clone();
                    item.shape = Arc::new(shape);
                    p.item = Arc::new(item);
                }
            };
            let table = of_boxes(&[vec![(Vec3::new(0.6, 0.5, 0.6), Vec3::ZERO)], on_table].concat());
            add(&mut scene, "table_01", Vec3::new(0.6, 0.53, 0.6), Vec3::new(2.0, 0.0, 2.0), with(table));
            let lamp = of_boxes(&[(Vec3::new(0.1, 0.2, 0.1), Vec3::ZERO), (Vec3::new(0.6, 0.2, 0.6), y(0.2))]);
            add(&mut scene, "lamp_01", Vec3::new(0.6, 0.4, 0.6), Vec3::new(2.0, 0.5, 2.0), |p| {
                with(lamp)(p);
                p.support = on("table_01");
            });
            settle_all(&mut scene, &PlacementSettings::default());
            let at = scene.placed[1].pose.position;
            assert!((at.y - height).abs() < 1e-3, "{at} {height}");
        }
    }

    /// A cloth 0.6 m wide that lies 0.4 m deep and hangs 0.35 m down at its front, on a seat 0.45 m high, as an item at a place.
    fn throw_on_a_seat(scene: &mut PartialScene, at: Vec3) -> crate::Item {
        add(scene, "sofa_01", Vec3::new(1.6, 0.45, 0.8), Vec3::new(2.0, 0.0, 2.0), |_| {});
        let top = (Vec3::new(0.6, 0.03, 0.4), Vec3::Y * 0.35);
        let front = (Vec3::new(0.6, 0.38, 0.02), Vec3::Z * 0.21);
        let shape = of_boxes(&[top, front]);
        let pose = Pose::new(at, 0.0, 1.0);
        let mut item = crate::testing::boxed(scene, shape.extent(), at, 0.0);
        item.id = ObjectId::new("throw_01").unwrap();
        item.mask = crate::testing::seen(scene, &shape, &pose).into();
        item.shape = Arc::new(shape);
        item.level = harmony_scene::Level::Decoration;
        item.relations.on_top_of = Some(ObjectId::new("sofa_01").unwrap());
        (item.traits.soft, item.traits.drapes) = (true, true);
        item
    }

    #[test]
    fn a_throw_lies_on_the_seat_and_hangs_over_its_edge() {
        let mut scene = empty_room();
        let at = Vec3::new(2.1, 0.1, 2.2);
        let item = throw_on_a_seat(&mut scene, at);
        let settings = PlacementSettings::default();
        let window = crate::observe::Window::new(&scene, &item, None, &[], &settings).unwrap();
        let found = crate::solve::local::solve(&scene, &item, &window, &settings);
        assert!(found.pose.position.distance(at) < 0.04, "{}", found.pose.position);
        assert!(found.energy.support < 1e-9, "all that lies on it is carried: {:?}", found.energy);
        drop(window);
        let lower = Pose::new(at - Vec3::Y * 0.03, 0.0, 1.0);
        let placed =
            Placed { item: Arc::new(item), pose: lower, support: on("sofa_01"), evidence: crate::Evidence::default() };
        scene.placed.push(placed);
        settle_all(&mut scene, &settings);
        assert!((scene.placed[1].pose.position.y - 0.1).abs() < 1e-6, "{}", scene.placed[1].pose.position);
        assert!(!hangs_in_the_air(&scene, 1));
        // A seat that is made lower takes it along.
        let seat = scene.placed[0].pose;
        take_poses(&mut scene, vec![(0, Pose { stretch: Vec3::new(1.0, 0.8, 1.0), ..seat })], &settings);
        assert!((scene.placed[1].pose.position.y - 0.01).abs() < 1e-6, "{}", scene.placed[1].pose.position);
    }

    #[test]
    fn a_throw_that_reaches_the_floor_is_around_what_it_is_thrown_over() {
        let mut scene = empty_room();
        let at = Vec3::new(2.0, 0.0, 2.0);
        add(&mut scene, "basket_01", Vec3::new(0.36, 0.4, 0.36), at, |_| {});
        add(&mut scene, "pouf_01", Vec3::new(0.6, 0.4, 0.6), Vec3::new(1.9, 0.0, 2.7), |_| {});
        let size = Vec3::new(0.46, 0.46, 0.46);
        let mut item = crate::testing::boxed(&scene, size, at, 0.0);
        item.id = ObjectId::new("throw_01").unwrap();
        item.level = harmony_scene::Level::Decoration;
        (item.traits.soft, item.traits.drapes) = (true, true);
        item.relations.on_top_of = Some(ObjectId::new("basket_01").unwrap());
        // The pouf hides a part of it.
        let (whole, before) = (item.mask.clone(), scene.placed[1].item.mask.clone());
        let mask = harmony_scene::Mask::from_fn(whole.size(), |x, y| {
            whole.get(i64::from(x), i64::from(y)) && !before.get(i64::from(x), i64::from(y))
        });
        item.mask = mask.into();
        let report = crate::place_level(&mut scene, vec![item], None, &PlacementSettings::default());
        let placed = &scene.placed[2];
        assert!(placed.pose.position.distance(at) < 0.04, "{}", placed.pose.position);
        assert!(report.unresolved.is_empty());
    }

    #[test]
    fn a_throw_over_the_back_of_a_chair_hangs_there() {
        let mut scene = empty_room();
        let (chair, at) = (Arc::new(armchair()), Vec3::new(1.2, 0.0, 1.5));
        add(&mut scene, "armchair_01", chair.extent(), at, |p| {
            p.pose.yaw = 0.4;
            let item = Arc::make_mut(&mut p.item);
            item.mask = crate::testing::seen(&empty_room(), &chair, &p.pose).into();
            item.shape = Arc::clone(&chair);
        });
        let [throw, before] = throw_over_an_edge();
        let host = scene.placed[0].pose;
        let there = Pose { position: host.point(Vec3::new(0.0, 0.98 - 0.586, BACK_Z)), ..host };
        let mut item = crate::testing::boxed(&scene, throw.extent(), there.position, there.yaw);
        item.mask = crate::testing::seen(&scene, &before, &there).into();
        item.id = ObjectId::new("throw_01").unwrap();
        item.shape = Arc::new(throw);
        item.level = harmony_scene::Level::Decoration;
        item.relations.on_top_of = Some(ObjectId::new("armchair_01").unwrap());
        item.placement.placement_type = PlacementType::AgainstBack;
        (item.traits.soft, item.traits.drapes) = (true, true);
        crate::place_level(&mut scene, vec![item], None, &PlacementSettings::default());
        let placed = &scene.placed[1];
        let off = placed.pose.position.distance(there.position);
        let (pose, support, evidence) = (placed.pose, &placed.support, &placed.evidence);
        assert!(
            off < 0.06 && *support == on("armchair_01"),
            "{off} {pose:?} for {there:?} on {support:?}, {evidence:?}"
        );
    }

    #[test]
    fn what_is_rigid_or_round_below_stands_on_its_lowest_points() {
        let mut scene = empty_room();
        let mut item = throw_on_a_seat(&mut scene, Vec3::new(2.1, 0.1, 2.2));
        let pose = Pose::new(Vec3::ZERO, 0.0, 2.0);
        assert!((sag_of(&item, &pose) - 0.7).abs() < 1e-6);
        item.traits.drapes = false;
        assert_eq!(sag_of(&item, &pose), 0.0);
        // A cushion: rings of an ellipsoid, each a box of its width there.
        let ring = |k: i32| {
            let height = f64::from(k) / 10.0;
            let width = 2.0 * (0.25 - (height - 0.45).powi(2)).max(0.0).sqrt();
            (Vec3::new(width, 0.1, width), Vec3::Y * height)
        };
        item.shape = Arc::new(of_boxes(&(0..10).map(ring).collect::<Vec<_>>()));
        (item.traits.soft, item.traits.drapes) = (true, true);
        assert_eq!(sag_of(&item, &pose), 0.0);
    }

    #[test]
    fn a_lamp_far_from_its_host_is_not_carried_across_the_room() {
        let mut scene = empty_room();
        add(&mut scene, "sofa_01", Vec3::new(1.6, 0.5, 0.8), Vec3::new(1.0, 0.0, 2.0), |_| {});
        let far = Vec3::new(2.6, 0.5, 2.0);
        add(&mut scene, "lamp_01", Vec3::new(0.2, 0.4, 0.2), far, |p| p.support = on("sofa_01"));
        back_onto_hosts(&mut scene);
        assert_eq!(scene.placed[1].pose.position, far);
        // But it is told of.
        assert!(hangs_in_the_air(&scene, 1));
        scene.placed[1].pose.position.x = 1.2;
        assert!(!hangs_in_the_air(&scene, 1));
    }
}
