//! First poses on furniture: the ray of the mask's base against the host's surfaces. Paper App. C "Decoration
//! Placement". Key `deco.host`.
//!
//! A host has several level surfaces (shelves, a seat); those over which the mask's foot or middle lies are tried, and
//! of a place that carries nothing the nearest one towards the camera that does. Hosts that nobody named are tried
//! beside the given one, at the price of a wrong answer (nats). Room frame, metres. Poses here are starts: the local
//! solve moves them, and what none of the tried surfaces carries is found nowhere else.

use harmony_scene::{DepthPosition, Level, PixelBox, PlacementType, Pose, Support, SurfacePosition, Vec2, Vec3};

use super::{Hypothesis, Proposer};
use crate::noise::surprise;
use crate::scene::attachment::{Attachment, YawRule, hang_of, reach, sag_of, size_of};
use crate::scene::support::{self, Layer};
use crate::{Item, PartialScene, Placed, YawHint};

/// Hosts tried for one object, at most.
const MAX_HOSTS: usize = 3;

/// Below this overlap with the given host's box other candidates are tried too.
const DOUBTFUL_OVERLAP: f64 = 0.5;

/// How far about a mask's lowest row its foot is looked for, share of its height.
const FOOT: f64 = 0.1;

/// Heights of a host tried for one object, at most; places as far beside the host are alike, and those as far are as good
/// as none, metres.
const MAX_LAYERS: usize = 6;
const BESIDE_STEP_M: f64 = 0.1;
const MAX_BESIDE_M: f64 = 3.0;

/// How many steps from a place that carries nothing one is looked for that does, and how far each goes, metres.
const STEPS_NEAR: u32 = 25;
const NEAR_STEP_M: f64 = 0.02;

/// How far below the floor what hangs may reach, metres: it gives way there.
const THROUGH_FLOOR_M: f64 = 0.02;

pub(crate) fn hypotheses<'a>(proposer: &Proposer<'a, '_>) -> Vec<Hypothesis<'a>> {
    let mut out = Vec::new();
    let given = given_host(proposer);
    if let Some(host) = given {
        on_host(proposer, host, 0.0, &mut out);
    }
    out.extend(given.into_iter().flat_map(|host| around_it(proposer, host)));
    let lies_on = |g: usize| overlap(proposer.scene, &proposer.scene.placed[g], &proposer.window.mask_box);
    if given.is_none_or(|g| lies_on(g) < DOUBTFUL_OVERLAP) {
        out.extend(on_other_hosts(proposer));
    }
    out
}

/// First poses of cloth that is thrown over what stands on the floor and reaches down to it itself: around it.
fn around_it<'a>(proposer: &Proposer<'a, '_>, host: usize) -> Vec<Hypothesis<'a>> {
    let (item, placed) = (proposer.item, &proposer.scene.placed[host]);
    if !item.traits.drapes || placed.support != Support::Floor {
        return Vec::new();
    }
    let (low, high) = reach(&placed.item, &placed.pose);
    let (low, high) = (low + placed.pose.position, high + placed.pose.position);
    let covers = |h: &Hypothesis| {
        let (from, to) = reach(item, &h.pose);
        let (from, to) = (from + h.pose.position, to + h.pose.position);
        from.x < high.x && to.x > low.x && from.z < high.z && to.z > low.z
    };
    proposer.on_floor(surprise(proposer.settings.noise.wrong_host)).into_iter().filter(covers).collect()
}

/// First poses on other hosts than the given one, which have to earn it.
pub(crate) fn on_other_hosts<'a>(proposer: &Proposer<'a, '_>) -> Vec<Hypothesis<'a>> {
    let given = given_host(proposer);
    let is_told = given.is_some() || proposer.on_ledge().is_some();
    let price = if is_told { surprise(proposer.settings.noise.wrong_host) } else { 0.0 };
    let mut out = Vec::new();
    for host in other_hosts(proposer.scene, proposer.item, proposer.window.mask_box, given) {
        on_host(proposer, host, price, &mut out);
    }
    out
}

fn given_host(proposer: &Proposer) -> Option<usize> {
    proposer.item.relations.on_top_of.as_ref().and_then(|id| proposer.scene.position(id))
}

/// Share of a decoration's box that lies on a host: its lower half, or what is about its foot (a tall lamp stands on a
/// little table), against the host's seen or projected box.
fn overlap(scene: &PartialScene, host: &Placed, mask_box: &PixelBox) -> f64 {
    let lower = PixelBox { y0: f64::midpoint(mask_box.y0, mask_box.y1), ..*mask_box };
    let around = FOOT * mask_box.height();
    let foot = PixelBox { y0: mask_box.y1 - around, y1: mask_box.y1 + around, ..*mask_box };
    let area = |b: Option<PixelBox>| {
        let b = b.map(|b| b.padded(0.02, scene.camera.size));
        b.map_or(0.0, |b| lower.covered_by(&b).max(foot.covered_by(&b)))
    };
    area(host.item.mask.bounds()).max(area(projected_box(scene, host)))
}

fn projected_box(scene: &PartialScene, placed: &Placed) -> Option<PixelBox> {
    let mut out: Option<PixelBox> = None;
    for corner in crate::scene::shape::corners(&placed.item.shape.bounds()) {
        let p = scene.camera.project(placed.pose.point(corner))?;
        let b = out.get_or_insert(PixelBox { x0: p.x, y0: p.y, x1: p.x, y1: p.y });
        *b = PixelBox { x0: b.x0.min(p.x), y0: b.y0.min(p.y), x1: b.x1.max(p.x), y1: b.y1.max(p.y) };
    }
    out
}

/// Placed objects beside the given one that may carry a decoration, the most likely first: the consistency check of
/// Sec. 3.3.
fn other_hosts(scene: &PartialScene, item: &Item, mask_box: PixelBox, given: Option<usize>) -> Vec<usize> {
    let carries = |p: &Placed| !p.item.traits.flat && p.item.level != Level::Ceiling && p.item.id != item.id;
    let candidates: Vec<usize> = if item.host_candidates.is_empty() {
        (0..scene.placed.len()).filter(|i| carries(&scene.placed[*i])).collect()
    } else {
        item.host_candidates.iter().filter_map(|id| scene.position(id)).collect()
    };
    let mut ranked: Vec<(f64, usize)> = candidates
        .into_iter()
        .filter(|i| Some(*i) != given)
        .map(|i| (overlap(scene, &scene.placed[i], &mask_box), i))
        .filter(|(o, _)| *o > 0.2)
        .collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    ranked.into_iter().map(|(_, i)| i).take(MAX_HOSTS - given.map_or(0, |_| 1)).collect()
}

fn on_host<'a>(proposer: &Proposer<'a, '_>, host: usize, price: f64, out: &mut Vec<Hypothesis<'a>>) {
    let placed = &proposer.scene.placed[host];
    let pose = proposer.sized(Vec3::ZERO, placed.pose.yaw);
    let height = size_of(proposer.item, &pose).y;
    let layers = likely_layers(proposer, placed, height, sag_of(proposer.item, &pose));
    let mut places = spots(proposer, placed, &layers);
    let free = places.iter().filter_map(|place| carried_near_it(proposer, host, &pose, *place)).collect::<Vec<_>>();
    places.extend(free);
    for (level, position) in places {
        for (yaw, turn_price) in
            yaws(proposer, placed, position).into_iter().flat_map(|rule| proposer.quarter_turns(rule))
        {
            let constraint = proposer.constraint(Attachment::OnHost { host, level }, yaw);
            out.push(proposer.settled(constraint, position, price + turn_price));
        }
    }
}

/// The heights of a host that are tried, at most [`MAX_LAYERS`]: those above which the mask's foot or its middle lies over
/// the host, then large ones (the tray's rim is not the table). A case has more shelves than are tried.
fn likely_layers(proposer: &Proposer, host: &Placed, height: f64, sag: f64) -> Vec<Layer> {
    let mut layers = support::layers(host, height);
    // What hangs down farther than a surface is high would hang through the floor.
    layers.retain(|layer| layer.height - sag > -THROUGH_FLOOR_M);
    let (low, high) = reach(&host.item, &host.pose);
    let (low, high) = (low + host.pose.position, high + host.pose.position);
    let b = &proposer.window.mask_box;
    let rays = [(Vec2::new(b.centre().x, b.y1), -sag), (b.centre(), height / 2.0 - sag)]
        .map(|(pixel, above)| (proposer.scene.camera.ray(pixel), above));
    let miss = |layer: &Layer| {
        let beside = rays.iter().filter_map(|(ray, above)| {
            let k = (layer.height + above - ray.origin.y) / ray.direction.y;
            let p = (k.is_finite() && k > 0.0).then(|| ray.at(k))?;
            Some((low - p).max(p - high).max(Vec3::ZERO).with_y(0.0).length())
        });
        (beside.fold(MAX_BESIDE_M, f64::min) / BESIDE_STEP_M).floor()
    };
    let mut ranked: Vec<(f64, Layer)> = layers.into_iter().map(|layer| (miss(&layer), layer)).collect();
    ranked
        .sort_by(|(a, p), (b, q)| a.total_cmp(b).then(q.share.total_cmp(&p.share)).then(q.height.total_cmp(&p.height)));
    ranked.truncate(MAX_LAYERS);
    ranked.into_iter().map(|(_, layer)| layer).collect()
}

fn yaws(proposer: &Proposer, host: &Placed, position: Vec3) -> Vec<YawRule> {
    let item = proposer.item;
    let given = !matches!(item.yaw, YawHint::Unknown) || item.relations.facing_toward.is_some();
    let with_host = item.placement.faces_room
        || item.traits.has_front
        || item.placement.placement_type == PlacementType::AgainstBack;
    if with_host && !given {
        return vec![YawRule::About { yaw: host.pose.yaw, sigma: proposer.settings.noise.yaw_along }];
    }
    proposer.yaws(position, host.pose.yaw)
}

/// The nearest place towards the camera where a surface carries an object that would be in its host: before the books of a
/// shelf; and the nearest ridge behind it over which cloth can hang. `None` where it is carried, or nowhere.
fn carried_near_it(proposer: &Proposer, host: usize, pose: &Pose, (level, at): (f64, Vec3)) -> Option<(f64, Vec3)> {
    let constraint =
        proposer.constraint(Attachment::OnHost { host, level }, YawRule::Fixed(proposer.scene.placed[host].pose.yaw));
    let carried = |at: &Vec3| {
        constraint.supported_share(&Pose { position: at.with_y(level), ..*pose }) >= proposer.settings.noise.support[0]
    };
    if carried(&at) {
        return None;
    }
    let towards = (proposer.scene.camera.centre() - at).with_y(0.0).try_normalize()?;
    let along = |direction: Vec3| (1..=STEPS_NEAR).map(move |k| at + direction * (NEAR_STEP_M * f64::from(k)));
    let near = along(towards).find(carried).or_else(|| {
        // In the middle of what carries it, for a ridge is narrow.
        hang_of(proposer.item)?;
        let ridge: Vec<Vec3> = along(-towards).skip_while(|at| !carried(at)).take_while(carried).collect();
        ridge.get(ridge.len() / 2).copied()
    });
    near.map(|at| (level, at))
}

/// Places (surface height, base centre) on a host that fit the mask.
fn spots(proposer: &Proposer, host: &Placed, layers: &[Layer]) -> Vec<(f64, Vec3)> {
    let (window, camera) = (proposer.window, &proposer.scene.camera);
    let mut out: Vec<(f64, Vec3)> = Vec::new();
    let pose = proposer.sized(Vec3::ZERO, host.pose.yaw);
    let size = size_of(proposer.item, &pose);
    let b = &window.mask_box;
    // What hangs over an edge has its lowest points below the surface that carries it.
    let sag = sag_of(proposer.item, &pose);
    let constraint = proposer.constraint(Attachment::Floor, YawRule::Fixed(host.pose.yaw));
    if proposer.item.placement.placement_type == PlacementType::AgainstBack {
        let ray = camera.ray(b.centre());
        if let Some((hit, _)) = support::ray_hit(host, ray.origin, ray.direction) {
            let position = hit + host.pose.front() * (size.z / 2.0);
            let below = layers.iter().filter(|l| l.height <= hit.y + 0.05).map(|l| l.height).max_by(f64::total_cmp);
            out.push((below.unwrap_or(hit.y - size.y / 2.0), position));
        }
    }
    // The surface that the base's ray itself meets.
    if window.free[3] && sag == 0.0 {
        let ray = camera.ray(Vec2::new(b.centre().x, b.y1 - 0.02 * b.height()));
        if let Some((hit, true)) = support::ray_hit(host, ray.origin, ray.direction)
            && let Some(position) = proposer.by_contact(&constraint, &pose, hit.y, 3)
        {
            out.push((hit.y, position));
        }
    }
    for layer in layers {
        // What hangs over an edge is highest where it lies on it.
        if sag > 0.0
            && let Some(position) = steps::on_level(proposer, Vec2::new(b.centre().x, b.y0), layer.height)
        {
            out.push((layer.height, onto(host, position.with_y(layer.height - sag))));
        }
        let position = proposer
            .by_contact(&constraint, &pose, layer.height - sag, 3)
            .or_else(|| steps::hidden_base(proposer, layer.height - sag, size.y));
        if let Some(position) = position {
            out.push((layer.height, onto(host, position)));
        }
    }
    if let Some(points) = proposer.by_points(&pose) {
        let base = points.y - size.y / 2.0 + sag;
        let nearest = layers.iter().min_by(|a, b| (a.height - base).abs().total_cmp(&(b.height - base).abs()));
        if let Some(layer) = nearest {
            out.push((layer.height, onto(host, points)));
        }
    }
    if out.is_empty()
        && let Some(layer) = layers.first()
    {
        out.push((layer.height, by_words(proposer, host)));
    }
    out
}

/// The nearest point within the host's bounds, seen from above.
fn onto(host: &Placed, p: Vec3) -> Vec3 {
    let (low, high) = reach(&host.item, &host.pose);
    let (low, high) = (low + host.pose.position, high + host.pose.position);
    Vec3::new(p.x.clamp(low.x, high.x), p.y, p.z.clamp(low.z, high.z))
}

/// The place that the words left / centre / right and front / middle / back mean to the camera.
fn by_words(proposer: &Proposer, host: &Placed) -> Vec3 {
    let placement = proposer.item.placement;
    let across = match placement.surface_position {
        SurfacePosition::Left => -0.3,
        SurfacePosition::Center => 0.0,
        SurfacePosition::Right => 0.3,
    };
    let along = match placement.depth_position {
        DepthPosition::Front => -0.3,
        DepthPosition::Middle => 0.0,
        DepthPosition::Back => 0.3,
    };
    let (low, high) = reach(&host.item, &host.pose);
    let camera = &proposer.scene.camera;
    let level = |v: Vec3| Vec3::new(v.x, 0.0, v.z).normalize_or(Vec3::X);
    let extent = |d: Vec3| (high - low).dot(d.abs());
    let (right, forward) = (level(camera.right()), level(camera.forward()));
    host.pose.position + right * (across * extent(right)) + forward * (along * extent(forward))
}

mod steps {
    //! Where the base is not seen, the centre or the top has to do.
    use harmony_scene::{Vec2, Vec3};

    use crate::propose::Proposer;

    /// Base centre on a level when the mask's middle is the object's middle.
    pub(super) fn hidden_base(proposer: &Proposer, level: f64, height: f64) -> Option<Vec3> {
        on_level(proposer, proposer.window.mask_box.centre(), level + height / 2.0)
    }

    /// Where the ray of a pixel meets a height, metres.
    pub(super) fn on_level(proposer: &Proposer, pixel: Vec2, height: f64) -> Option<Vec3> {
        let ray = proposer.scene.camera.ray(pixel);
        let k = (height - ray.origin.y) / ray.direction.y;
        (k.is_finite() && k > 0.1 && k < 20.0).then(|| ray.at(k))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_scene::{Mask, ObjectId, Support};

    use super::*;
    use crate::testing::{add, boxed, empty_room, of_boxes, seen};
    use crate::{PlacementSettings, place_level};

    /// A case of nine boards, before each row of books a free stripe behind a lip, which hides what stands there at its foot.
    #[test]
    fn every_shelf_of_a_full_case_is_found_by_what_stands_on_it() {
        let boards = (0..9).map(|i| 0.1 + 0.26 * f64::from(i));
        let mut parts = vec![
            (Vec3::new(0.04, 2.3, 0.3), Vec3::new(-0.5, 0.0, 0.0)),
            (Vec3::new(0.04, 2.3, 0.3), Vec3::new(0.5, 0.0, 0.0)),
        ];
        for y in boards.clone() {
            parts.push((Vec3::new(0.96, 0.03, 0.3), Vec3::new(0.0, y - 0.03, 0.0)));
            parts.push((Vec3::new(0.9, 0.19, 0.16), Vec3::new(0.0, y, -0.06)));
            parts.push((Vec3::new(0.96, 0.05, 0.01), Vec3::new(0.0, y, 0.145)));
        }
        let case = Arc::new(of_boxes(&parts));
        let mut wrong = Vec::new();
        for (k, y) in boards.enumerate().take(8) {
            let mut scene = empty_room();
            add(&mut scene, "case_01", Vec3::new(1.04, 2.3, 0.3), Vec3::new(2.6, 0.0, 0.16), |p| {
                let item = Arc::make_mut(&mut p.item);
                item.mask = seen(&empty_room(), &case, &p.pose).into();
                item.shape = Arc::clone(&case);
            });
            let host = ObjectId::new("case_01").unwrap();
            let at = Vec3::new(2.4, y, 0.25);
            let mut item = boxed(&scene, Vec3::new(0.08, 0.14, 0.07), at, 0.0);
            item.id = ObjectId::new("figure_01").unwrap();
            item.level = Level::Decoration;
            item.relations.on_top_of = Some(host.clone());
            let front = scene.camera.project(Vec3::new(2.4, y + 0.05, 0.31)).unwrap().y;
            item.mask =
                Mask::from_fn(item.mask.size(), |x, row| f64::from(row) < front && item.mask.get(x.into(), row.into()))
                    .into();
            place_level(&mut scene, vec![item], None, &PlacementSettings::default());
            let placed = scene.find(&ObjectId::new("figure_01").unwrap()).unwrap();
            let off = placed.pose.position - at;
            // How deep on its shelf something stands is not told by a mask that the lip cuts.
            if off.y.abs() > 0.06 || off.with_y(0.0).length() > 0.12 || placed.support != (Support::Object { id: host })
            {
                wrong.push((k, off, placed.support.clone()));
            }
        }
        assert!(wrong.is_empty(), "{wrong:?}");
    }
}
