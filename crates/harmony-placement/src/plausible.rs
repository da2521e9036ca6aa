//! Last corrections of a level, by what holds in rooms whatever the photo shows of it.

use std::collections::BTreeMap;

use harmony_scene::{Mask, ObjectId, PlacementType, Pose, Support, Vec3, Wall};

use crate::anchoring::{Anchoring, Frame, YawRule, reach, size_of};
use crate::cost::angle_between;
use crate::first_pose::facing;
use crate::level::{anchoring_of, neighbours};
use crate::solve::polish;
use crate::support::{Surface, SurfaceQuery, surface_under};
use crate::view::View;
use crate::{PartialScene, Placed, PlacementSettings};

/// Share of a footprint that must be on the host, and how far the surface may be from where the object stands, metres.
const SUPPORTED: f64 = 0.5;
/// ... or nearly as much as anywhere on it, and at least this much.
const NEARLY: f64 = 0.8;
const LEAST_SUPPORTED: f64 = 0.15;
const SAME_LEVEL: f64 = 0.05;
/// Height within which the lowest points of an object are what it stands on, metres.
const FOOT: f64 = 0.003;
/// Steps in which an object is moved towards its host's middle.
const STEPS: u32 = 40;
/// Height over its host from which an object hangs in the air, metres: less is the unevenness of meshes.
const IN_THE_AIR: f64 = 0.005;
/// Rays along each side of an object's footprint that tell how far it can sink.
const SINK_RAYS: u32 = 9;
/// Distance of points on the edges of a host's faces, metres.
const RIM_STEP: f64 = 0.005;
/// What is farther from its host than this does not rest on it, metres: the host is wrong, not the place.
const FARTHEST_BACK: f64 = 0.4;
/// How far beyond a window's end its curtains may end, share of the window's width.
const OVERHANG: f64 = 0.6;
/// Pixels beyond a mask's end in which what hides the rest is looked for.
const NEXT_TO: i64 = 6;
/// Agreement with the mask that a better place of a window, or a better turn, may cost.
const WINDOW_SLACK: f64 = 0.1;
const TURN_SLACK: f64 = 0.05;
/// The same where the turn shows the front to what it is said to face.
const FACING_SLACK: f64 = 0.1;
/// Most that a member of a row gives of its width, and what is left between two of them, metres.
const MOST_NARROWED: f64 = 0.2;
const SEAM: f64 = 5e-4;
/// Room that somebody needs before a front to use it, metres.
const BEFORE_FRONT: f64 = 0.3;

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
            for member in crate::collision::body(scene, i) {
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
        crate::support::ray_hit(object, from, Vec3::Y).map(|(hit, _)| hit)
    };
    let share = |k: u32| f64::from(k) / f64::from(SINK_RAYS - 1);
    let grid = (0..SINK_RAYS * SINK_RAYS).map(|k| (share(k % SINK_RAYS), share(k / SINK_RAYS)));
    let points = grid.filter_map(|(u, v)| {
        let place = at + low + (high - low) * Vec3::new(u, 0.0, v);
        underside(place.x, place.z).map(|hit| hit - at)
    });
    let under: Vec<Vec3> = points.chain(feet(object)).collect();
    let Some(gap) = gap_below(&under, host, at).filter(|gap| *gap > IN_THE_AIR) else { return };
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
    if gap > IN_THE_AIR {
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
    let enough = SUPPORTED.min(NEARLY * most).max(LEAST_SUPPORTED);
    let place = |(p, s): (Vec3, Surface)| Place { at: Vec3::new(p.x, s.height, p.z), carries: s.share >= enough };
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
        let (hit, _) = crate::support::ray_hit(host, foot + Vec3::Y * SAME_LEVEL, Vec3::NEG_Y)?;
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
    let level = object.pose.position.y;
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

/// Turns about what shows its front to a wall at which nobody could use it, has room behind, and does not face there
/// what it is said to face.
pub(crate) fn fronts_from_walls(scene: &mut PartialScene, settings: &PlacementSettings) {
    for i in 0..scene.placed.len() {
        let p = &scene.placed[i];
        if p.support != Support::Floor || !p.item.traits.has_front {
            continue;
        }
        let target = p.item.relations.facing_toward.as_ref().and_then(|id| scene.find(id));
        let faces = |yaw: f64| {
            let towards = facing(p.pose.position, target?)?;
            Some(angle_between(yaw, towards).abs() < std::f64::consts::FRAC_PI_2)
        };
        if p.item.relations.facing_toward.is_some() && faces(p.pose.yaw) != Some(false) {
            continue;
        }
        let front = Vec3::new(p.pose.yaw.sin(), 0.0, p.pose.yaw.cos());
        let room = |towards: Vec3| {
            let (low, high) = reach(&p.item, &p.pose);
            let wall =
                Wall::ALL.into_iter().min_by(|a, b| a.normal().dot(towards).total_cmp(&b.normal().dot(towards)))?;
            let half = (high - low).dot(towards.abs()) / 2.0;
            Some(wall.distance(&scene.room.extents, p.pose.position) - half)
        };
        let (Some(before), Some(behind)) = (room(front), room(-front)) else { continue };
        if before > BEFORE_FRONT || behind < 2.0 * BEFORE_FRONT {
            continue;
        }
        let others = neighbours(scene, &p.item, &[], Some(i));
        let Some(view) = View::new(scene, Some(i), &p.item.mask, &others, settings.window_px) else { continue };
        let turned = Pose { yaw: p.pose.yaw + std::f64::consts::PI, ..p.pose };
        let frame = Frame {
            scene,
            item: &p.item,
            anchoring: anchoring_of(scene, i),
            yaw: YawRule::About { yaw: turned.yaw, sigma: 0.1 },
            wall_gap: settings.wall_gap,
            fixed_size: false,
        };
        let turned = polish(frame, &turned, &view, settings, settings.renders_per_object / 3);
        let seen = view.compare(p.item.shape.proxy(), &p.pose).iou;
        let slack = if target.is_some() { FACING_SLACK } else { TURN_SLACK };
        if turned.seen.iou >= seen - slack {
            let pose = turned.pose;
            scene.placed[i].pose = pose;
        }
    }
}

/// Centres windows of which both ends are hidden between the curtains that hide them.
pub(crate) fn between_curtains(scene: &mut PartialScene, settings: &PlacementSettings) {
    for i in 0..scene.placed.len() {
        let p = &scene.placed[i];
        let Support::Wall { wall } = p.support else { continue };
        if !p.item.traits.opening || p.item.traits.to_floor {
            continue;
        }
        let hanging: Vec<usize> = (0..scene.placed.len())
            .filter(|k| *k != i && scene.placed[*k].item.traits.hangs && scene.placed[*k].support == p.support)
            .collect();
        if !ends_hidden(scene, &p.item.mask, &hanging) {
            continue;
        }
        let others = neighbours(scene, &p.item, &[], Some(i));
        let Some(view) = View::new(scene, Some(i), &p.item.mask, &others, settings.window_px) else { continue };
        let before = view.compare(p.item.shape.proxy(), &p.pose).iou;
        let width = size_of(&p.item, &p.pose).x;
        let own = along(scene, i, wall);
        let curtains: Vec<[f64; 2]> = hanging
            .into_iter()
            .map(|k| along(scene, k, wall))
            .filter(|c| c[0] < own[1] + OVERHANG * width && c[1] > own[0] - OVERHANG * width)
            .collect();
        let (low, high) = curtains.iter().fold((f64::MAX, f64::MIN), |(l, h), c| (l.min(c[0]), h.max(c[1])));
        // One curtain of a pair, the other unseen, says nothing about the middle.
        if high - low < width || high - low > (1.0 + 2.0 * OVERHANG) * width {
            continue;
        }
        let by = f64::midpoint(low, high) - f64::midpoint(own[0], own[1]);
        let mut pose = p.pose;
        pose.position += axis(wall) * by;
        if view.compare(p.item.shape.proxy(), &pose).iou >= before - WINDOW_SLACK {
            scene.placed[i].pose = pose;
        }
    }
}

/// Makes narrower what stands side by side at a wall and is still in one another after everything was brought apart: a
/// row of cupboards whose sizes, each a little off, are together longer than their wall. Tells which, and by what share.
pub(crate) fn narrow_rows(scene: &mut PartialScene, settings: &PlacementSettings) -> Vec<(ObjectId, f64)> {
    let mut narrowed: BTreeMap<usize, f64> = BTreeMap::new();
    for collision in crate::collision::collisions(scene, settings) {
        let (Some(a), Some(b)) = (scene.position(&collision.a), scene.position(&collision.b)) else { continue };
        let (Anchoring::AgainstWall(wall), Anchoring::AgainstWall(other)) =
            (anchoring_of(scene, a), anchoring_of(scene, b))
        else {
            continue;
        };
        let (span_a, span_b) = (along(scene, a, wall), along(scene, b, wall));
        let overlap = span_a[1].min(span_b[1]) - span_a[0].max(span_b[0]);
        let a_first = span_a[0] + span_a[1] < span_b[0] + span_b[1];
        let shares = [(a, span_a, a_first), (b, span_b, !a_first)].map(|(object, span, first)| {
            let taken = (overlap / 2.0 + SEAM) / (span[1] - span[0]);
            (object, taken, if first { -1.0 } else { 1.0 })
        });
        let total = |(object, taken, _): &(usize, f64, f64)| narrowed.get(object).unwrap_or(&0.0) + taken;
        if wall != other || overlap <= 0.0 || shares.iter().any(|share| total(share) > MOST_NARROWED) {
            continue;
        }
        for (object, taken, side) in shares {
            let pose = &mut scene.placed[object].pose;
            // What the wall's axis is to the room, the width is to the object.
            pose.stretch.x *= 1.0 - taken;
            pose.position += axis(wall) * side * (overlap / 2.0 + SEAM) / 2.0;
            *narrowed.entry(object).or_default() += taken;
        }
    }
    narrowed.into_iter().map(|(object, share)| (scene.placed[object].item.id.clone(), share)).collect()
}

/// Whether a mask ends at both sides where something that hangs, or the image's border, hides the rest.
fn ends_hidden(scene: &PartialScene, mask: &Mask, hanging: &[usize]) -> bool {
    let Some(b) = mask.bounds() else { return false };
    let width = i64::from(mask.size().width);
    let hidden = |x: i64, y: i64, towards: i64| {
        (1..=NEXT_TO)
            .map(|k| x + k * towards)
            .any(|x| x < 1 || x >= width - 1 || hanging.iter().any(|h| scene.placed[*h].item.mask.get(x, y)))
    };
    let (mut rows, mut cut) = (0, [0, 0]);
    for y in b.y0 as i64..b.y1 as i64 {
        let mut row = (b.x0 as i64..b.x1 as i64).filter(|x| mask.get(*x, y));
        let Some(first) = row.next() else { continue };
        let last = row.next_back().unwrap_or(first);
        rows += 1;
        cut[0] += i32::from(hidden(first, y, -1));
        cut[1] += i32::from(hidden(last, y, 1));
    }
    cut.into_iter().all(|c| 2 * c >= rows)
}

/// The room axis along a wall.
fn axis(wall: Wall) -> Vec3 {
    if wall.normal().x.abs() > 0.5 { Vec3::Z } else { Vec3::X }
}

/// From where to where an object reaches along a wall's axis, metres.
fn along(scene: &PartialScene, object: usize, wall: Wall) -> [f64; 2] {
    let p = &scene.placed[object];
    let (low, high) = reach(&p.item, &p.pose);
    let at = |v: Vec3| (p.pose.position + v).dot(axis(wall));
    [at(low), at(high)]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_scene::Level;

    use super::*;
    use crate::Evidence;
    use crate::testing::{boxed, empty_room, of_boxes};

    fn add(scene: &mut PartialScene, name: &str, size: Vec3, at: Vec3, change: impl FnOnce(&mut Placed)) {
        let mut item = boxed(scene, size, at, 0.0);
        item.id = ObjectId::new(name).unwrap();
        let mut placed = Placed {
            item: Arc::new(item),
            pose: Pose::new(at, 0.0, 1.0),
            support: Support::Floor,
            evidence: Evidence::default(),
        };
        change(&mut placed);
        scene.placed.push(placed);
    }

    fn on(name: &str) -> Support {
        Support::Object { id: ObjectId::new(name).unwrap() }
    }

    #[test]
    fn a_row_of_cupboards_that_is_longer_than_its_place_is_made_narrower() {
        let settings = PlacementSettings::default();
        let mut scene = empty_room();
        let row = [("a_01", 1.0), ("b_01", 1.55), ("c_01", 2.1)];
        for (name, x) in row {
            add(&mut scene, name, Vec3::new(0.6, 0.9, 0.6), Vec3::new(x, 0.0, 0.301), |p| {
                Arc::make_mut(&mut p.item).relations.wall_affinity = Wall::Back.into();
            });
        }
        // Another is in one of them, and not at the wall.
        add(&mut scene, "d_01", Vec3::new(0.6, 0.9, 0.6), Vec3::new(2.3, 0.0, 0.85), |_| {});
        let narrowed = narrow_rows(&mut scene, &settings);
        assert_eq!(narrowed.iter().map(|(id, _)| id.as_str()).collect::<Vec<_>>(), ["a_01", "b_01", "c_01"]);
        let left = crate::collision::collisions(&scene, &settings);
        assert_eq!(left.iter().map(|c| (c.a.as_str(), c.b.as_str())).collect::<Vec<_>>(), [("c_01", "d_01")]);
        // The middle one gave half of both overlaps, the outer sides of the row stay.
        let spans = [0, 1, 2].map(|i| along(&scene, i, Wall::Back));
        assert!((spans[0][0] - 0.7).abs() < 1e-6 && (spans[2][1] - 2.4).abs() < 1e-6, "{spans:?}");
        assert!((spans[1][1] - spans[1][0] - 0.549).abs() < 1e-6, "{spans:?}");
        // Half of a width is no error of a size.
        scene.placed[1].pose.position.x = 1.2;
        assert_eq!(narrow_rows(&mut scene, &settings), []);
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
            crate::global::settle_all(&mut scene, &PlacementSettings::default());
            let at = scene.placed[1].pose.position;
            assert!((at.y - height).abs() < 1e-3, "{at} {height}");
        }
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

    #[test]
    fn a_front_at_a_wall_turns_to_the_room_and_one_that_faces_something_does_not() {
        let turned = |z: f64, change: fn(&mut crate::Item)| {
            let mut scene = empty_room();
            add(&mut scene, "cabinet_01", Vec3::new(0.8, 1.2, 0.4), Vec3::new(2.0, 0.0, z), |p| {
                p.pose.yaw = std::f64::consts::PI;
                let mut item = (*p.item).clone();
                item.traits.has_front = true;
                change(&mut item);
                p.item = Arc::new(item);
            });
            add(&mut scene, "sofa_01", Vec3::new(1.8, 0.8, 0.8), Vec3::new(2.0, 0.0, 3.0), |_| {});
            fronts_from_walls(&mut scene, &PlacementSettings::default());
            scene.placed[0].pose.yaw.cos() > 0.0
        };
        assert!(turned(0.25, |_| {}));
        assert!(!turned(1.2, |_| {}), "there is room before it");
        assert!(!turned(0.25, |item| item.relations.facing_toward = Some(ObjectId::new("tv_01").unwrap())));
        assert!(turned(0.25, |item| item.relations.facing_toward = Some(ObjectId::new("sofa_01").unwrap())));
    }

    #[test]
    fn a_window_with_hidden_ends_is_in_the_middle_of_its_curtains() {
        let curtains = |scene: &mut PartialScene, pair: bool| {
            for (k, x) in [1.0, 3.0].into_iter().enumerate().take(if pair { 2 } else { 1 }) {
                let name = format!("curtain_0{k}");
                add(scene, &name, Vec3::new(0.5, 2.2, 0.1), Vec3::new(x, 0.1, 0.1), |p| {
                    p.support = Support::Wall { wall: Wall::Back };
                    let mut item = (*p.item).clone();
                    item.traits.hangs = true;
                    item.level = Level::Wall;
                    p.item = Arc::new(item);
                });
            }
        };
        for (pair, expected) in [(true, 2.0), (false, 2.4)] {
            let mut scene = empty_room();
            curtains(&mut scene, pair);
            let masks: Vec<Mask> = scene.placed.iter().map(|p| p.item.mask.clone()).collect();
            add(&mut scene, "window_01", Vec3::new(1.8, 1.2, 0.05), Vec3::new(2.0, 0.9, 0.03), |p| {
                p.support = Support::Wall { wall: Wall::Back };
                p.pose.position.x = 2.4;
                let mut item = (*p.item).clone();
                item.level = Level::Wall;
                item.traits.opening = true;
                item.traits.planar = true;
                // What the curtains leave of it.
                let full = item.mask.clone();
                item.mask = Mask::from_fn(full.size(), |x, y| {
                    let (x, y) = (i64::from(x), i64::from(y));
                    full.get(x, y) && !masks.iter().any(|m| m.get(x, y))
                });
                p.item = Arc::new(item);
            });
            between_curtains(&mut scene, &PlacementSettings::default());
            let window = scene.placed.last().unwrap();
            assert!((window.pose.position.x - expected).abs() < 0.02, "{pair}: {:?}", window.pose.position);
        }
    }
}
