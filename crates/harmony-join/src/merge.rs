//! The things of the joined scene: each from the run that sees it best, where all runs together have it.
//!
//! Key `join.merge` of `docs/paper-map.md`.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

use glam::DVec3;
use harmony_mesh::Mesh;
use harmony_scene::{Confidence, Level, ObjectId, Pose, Relations, SceneObject, Size, Support, Wall, WallAffinity};
use serde::Serialize;

use crate::depth::Sight;
use crate::noise::JoinNoise;
use crate::placing::Placing;
use crate::solve::Joint;
use crate::source::{SeenObject, Source};
use crate::tracks::Track;

/// What is called right, as in placement: metres, radians, and the logarithm of 12 %.
const RIGHT: (f64, f64, f64) = (0.15, 0.174_533, 0.113);
/// Boxes of two kinds that share more of the smaller one's room than this are one place.
const OCCUPIED: f64 = 0.5;
/// Boxes of one kind that do so are one thing.
const SAME: f64 = 0.3;
/// Share of a thing's points in view past which another photo must see before its place counts as empty, and points in
/// view at least.
const EMPTY: (f64, usize) = (0.7, 12);
/// What stands is moved into the room by less than this, metres.
const MAX_INWARD_M: f64 = 0.3;
/// Agreement of a thing's outline with its mask from which its own photo surely shows it.
const OUTLINED: f64 = 0.6;
/// Runs that agree about a turn differ less, radians.
const SAME_TURN: f64 = 0.45;
/// A turn this near to a quarter in its own room is square there, radians.
const SQUARE: f64 = 0.01;

/// A thing of the joined scene.
#[derive(Debug, Clone)]
pub struct Thing {
    /// As in the joined `scene.json`.
    pub object: SceneObject,
    /// Canonical mesh.
    pub mesh: Arc<Mesh>,
    /// Who has it.
    pub track: Track,
    /// Run from which shape and look are, and its object there.
    pub from: (usize, usize),
    /// One sigma of its place, metres.
    pub sigma_m: f64,
    /// Largest distance of a run's own place to the joined one, metres.
    pub apart_m: f64,
}

/// Something that a run has and the joined scene has not.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Dropped {
    /// Run.
    pub run: String,
    /// Its id there.
    pub id: ObjectId,
    /// Why.
    pub reason: String,
}

/// Makes the things; `joint` and `tracks` go together.
pub fn things(sources: &[Source], tracks: &[Track], joint: &Joint, noise: &JoinNoise) -> (Vec<Thing>, Vec<Dropped>) {
    let made: Vec<Thing> = tracks.iter().enumerate().map(|(k, t)| thing(sources, t, joint, k, noise)).collect();
    let mut dropped = Vec::new();
    let kept = without_doubles(sources, made, &mut dropped);
    let mut kept = without_absent(sources, kept, joint, &mut dropped);
    kept.sort_by_key(|t| t.object.level);
    name(&mut kept);
    connect(sources, &mut kept, joint);
    (kept, dropped)
}

/// One thing, not yet named nor set on what carries it.
fn thing(sources: &[Source], track: &Track, joint: &Joint, number: usize, noise: &JoinNoise) -> Thing {
    let (_, best) = track.best(sources);
    let votes = turns(sources, track, &joint.placings, best);
    // Among those whose turn most of the evidence is for, the best seen one.
    let chosen = track
        .objects(sources)
        .zip(&votes)
        .filter(|(_, agrees)| **agrees)
        .map(|(member, _)| member)
        .max_by(|a, b| a.1.quality().total_cmp(&b.1.quality()));
    let (run, seen) = chosen.unwrap_or_else(|| track.best(sources));
    let at = track.members.iter().find(|m| m.0 == run).map_or(0, |m| m.1);
    let placing = &joint.placings[run];
    let own = placing.pose(&seen.object.pose);
    let (yaw, yaw_sigma) = yaw(sources, track, joint, run, seen, noise);
    let (factor, size_sigma) = growth(sources, track, joint, run, seen, noise);
    let scale = own.scale * factor;
    let [x, z] = joint.places[number];
    let pose = Pose { position: DVec3::new(x, height(sources, track, joint), z), yaw, scale, stretch: own.stretch };
    let by = placing.ln_scale.exp() * factor;
    let s = seen.object.size;
    let apart = track.objects(sources).map(|(run, o)| {
        let p = joint.placings[run].point(o.place());
        (p.x - x).hypot(p.z - z)
    });
    let within = |limit: f64, sigma: f64| libm::erf(limit / (std::f64::consts::SQRT_2 * sigma.max(1e-6)));
    let sigma_m = joint.sigmas[number];
    let of_runs = 1.0 - track.objects(sources).map(|(_, o)| 1.0 - o.object.confidence.overall).product::<f64>();
    let of_joint = within(RIGHT.0, sigma_m) * within(RIGHT.1, yaw_sigma) * within(RIGHT.2, size_sigma);
    let confidence = Confidence { overall: of_joint.min(of_runs), ..seen.object.confidence };
    let size = Size { width: s.width * by, height: s.height * by, depth: s.depth * by };
    Thing {
        object: SceneObject { pose, size, confidence, ..seen.object.clone() },
        mesh: Arc::clone(&seen.mesh),
        track: track.clone(),
        from: (run, at),
        sigma_m,
        apart_m: apart.fold(0.0, f64::max),
    }
}

/// The difference of two angles, within half a turn.
fn wrapped(angle: f64) -> f64 {
    (angle + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0
}

/// Which members agree with the turn that most of the confidence is for. Where a thing is as wide as it is deep in the one
/// run and its sides are exchanged in the other, its mesh was made with another side as its front: it stands the same.
fn turns(sources: &[Source], track: &Track, placings: &[Placing], best: &SeenObject) -> Vec<bool> {
    let members: Vec<(usize, &SeenObject)> = track.objects(sources).collect();
    if members.len() < 3 || !harmony_catalogue::has_front(&best.object.label) {
        return vec![true; members.len()];
    }
    let yaws: Vec<f64> = members.iter().map(|(run, o)| placings[*run].turned(o.object.pose.yaw)).collect();
    let agree = |i: usize, j: usize| wrapped(yaws[i] - yaws[j]).abs() < SAME_TURN;
    let weight = |i: usize| -> f64 {
        let of = members.iter().enumerate().filter(|(j, _)| agree(i, *j));
        of.map(|(_, (_, o))| o.object.confidence.overall.max(0.05)).sum()
    };
    let most = (0..members.len()).max_by(|a, b| weight(*a).total_cmp(&weight(*b))).unwrap_or(0);
    (0..members.len()).map(|i| agree(i, most)).collect()
}

/// The turn of the chosen member's mesh, and one sigma: what is square in its own room is square here; else the mean over
/// all members up to quarter turns, for meshes may have been made with another side as their front.
fn yaw(
    sources: &[Source],
    track: &Track,
    joint: &Joint,
    run: usize,
    seen: &SeenObject,
    noise: &JoinNoise,
) -> (f64, f64) {
    let placing = &joint.placings[run];
    let own = seen.object.pose.yaw;
    let quarter = (own / FRAC_PI_2).round() * FRAC_PI_2;
    let sigma_of = |o: &SeenObject| o.spread.map_or(noise.yaw, |s| s[1].max(0.01));
    let square = track.objects(sources).filter(|(_, o)| {
        let yaw = o.object.pose.yaw;
        (yaw - (yaw / FRAC_PI_2).round() * FRAC_PI_2).abs() < SQUARE
    });
    let square = square.count();
    if (own - quarter).abs() < SQUARE || 2 * square > track.members.len() && (own - quarter).abs() < 0.15 {
        return (wrapped(quarter + placing.turn.angle()), sigma_of(seen).min(noise.yaw));
    }
    let base = placing.turned(own);
    let (mut sum, mut information) = (0.0, 0.0);
    for (other, o) in track.objects(sources) {
        let off = wrapped(joint.placings[other].turned(o.object.pose.yaw) - base);
        let off = off - (off / FRAC_PI_2).round() * FRAC_PI_2;
        if off.abs() < SAME_TURN {
            let weight = sigma_of(o).max(0.02).powi(-2);
            sum += weight * off;
            information += weight;
        }
    }
    (wrapped(base + sum / information.max(1e-9)), information.max(1e-9).powf(-0.5))
}

/// Factor on the chosen member's size that brings it to the mean of all, and one relative sigma of that.
fn growth(
    sources: &[Source],
    track: &Track,
    joint: &Joint,
    run: usize,
    seen: &SeenObject,
    noise: &JoinNoise,
) -> (f64, f64) {
    let log = |run: usize, o: &SeenObject| {
        let s = o.object.size;
        (s.width.max(1e-3) * s.height.max(1e-3) * s.depth.max(1e-3)).ln() / 3.0 + joint.placings[run].ln_scale
    };
    let own = log(run, seen);
    let (mut sum, mut information) = (0.0, 0.0);
    for (other, o) in track.objects(sources) {
        let worse = (1.0 + 2.0 * o.hidden) * if o.cut { noise.cut } else { 1.0 };
        let sigma = worse * o.spread.map_or(noise.size, |s| s[2].clamp(0.01, 0.3));
        let off = log(other, o) - own;
        // Another shape altogether says nothing about this one's size.
        let weight = (1.0 + (off / (noise.limit * noise.size)).powi(2)).powi(-2) / (sigma * sigma);
        sum += weight * off;
        information += weight;
    }
    ((sum / information.max(1e-9)).exp(), information.max(1e-9).powf(-0.5))
}

/// Height of its bottom over the floor: under the ceiling the distance from it counts.
fn height(sources: &[Source], track: &Track, joint: &Joint) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (run, o) in track.objects(sources) {
        let scale = joint.placings[run].ln_scale.exp();
        let y = if o.object.support == Support::Ceiling {
            joint.extents.height - scale * (sources[run].scene.room.extents.height - o.place().y)
        } else {
            scale * o.place().y
        };
        let weight = o.quality().max(1e-3);
        sum += weight * y;
        weights += weight;
    }
    sum / weights
}

/// The axis-aligned box of a thing in the joined room.
fn bounds(t: &Thing) -> (DVec3, DVec3) {
    let half = t.object.size.as_vec() / 2.0;
    let (s, c) = (t.object.pose.yaw.sin().abs(), t.object.pose.yaw.cos().abs());
    let reach = DVec3::new(half.x * c + half.z * s, 0.0, half.x * s + half.z * c);
    let p = t.object.pose.position;
    // Flat things have a little height, so that they can overlap.
    (p - reach, p + reach + DVec3::Y * t.object.size.height.max(0.05))
}

/// Share of the smaller box that both have.
fn shared(a: &Thing, b: &Thing) -> f64 {
    let ((p, q), (r, s)) = (bounds(a), bounds(b));
    let both = (q.min(s) - p.max(r)).max(DVec3::ZERO);
    let volume = |v: DVec3| v.x * v.y * v.z;
    volume(both) / volume(q - p).min(volume(s - r)).max(1e-9)
}

/// Whether no run has both.
fn of_other_runs(a: &Thing, b: &Thing) -> bool {
    a.track.members.iter().all(|(run, _)| b.track.members.iter().all(|(other, _)| run != other))
}

fn quality(sources: &[Source], t: &Thing) -> f64 {
    t.track.objects(sources).map(|(_, o)| o.quality()).sum()
}

fn leave_out(sources: &[Source], t: &Thing, reason: &str, out: &mut Vec<Dropped>) {
    for (run, o) in t.track.objects(sources) {
        out.push(Dropped { run: sources[run].name.clone(), id: o.object.id.clone(), reason: reason.to_owned() });
    }
}

/// Leaves out what another run has under another name or a little farther off.
fn without_doubles(sources: &[Source], mut things: Vec<Thing>, dropped: &mut Vec<Dropped>) -> Vec<Thing> {
    things.sort_by(|a, b| quality(sources, b).total_cmp(&quality(sources, a)));
    let mut kept: Vec<Thing> = Vec::new();
    for t in things {
        let lies_flat = |t: &Thing| harmony_catalogue::has(&t.object.label, harmony_catalogue::Trait::Flat);
        let (_, own) = t.track.best(sources);
        let other = kept.iter().find(|k| {
            let same = k.track.best(sources).1.same_kind(own);
            let solid = !lies_flat(k) && !lies_flat(&t) && k.object.level == t.object.level;
            of_other_runs(k, &t) && if same { shared(k, &t) > SAME } else { solid && shared(k, &t) > OCCUPIED }
        });
        match other {
            Some(k) => {
                let reason = format!("another photo has a {} in its place", k.object.label);
                leave_out(sources, &t, &reason, dropped);
            }
            None => kept.push(t),
        }
    }
    kept
}

/// Leaves out what one run alone has where another photo sees past its place. A run without a point map knows of its photo
/// what it found itself: against a thing that its own photo outlines well that is not enough.
fn without_absent(sources: &[Source], things: Vec<Thing>, joint: &Joint, dropped: &mut Vec<Dropped>) -> Vec<Thing> {
    let mut kept = Vec::new();
    for t in things {
        let only = (t.track.members.len() == 1).then(|| t.track.members[0].0);
        let absent = only.and_then(|run| {
            let outlined = t.object.confidence.silhouette_iou.is_some_and(|iou| iou > OUTLINED);
            (0..sources.len()).filter(|other| *other != run).find(|other| {
                if outlined && !sources[*other].depth.measured {
                    return false;
                }
                let back = joint.placings[*other].inverse();
                let step = (t.mesh.positions.len() / 200).max(1);
                let sights: Vec<Sight> = t
                    .mesh
                    .positions
                    .iter()
                    .step_by(step)
                    .map(|p| sources[*other].depth.sight(back.point(t.object.pose.point(p.as_dvec3()))))
                    .filter(|s| *s != Sight::Outside)
                    .collect();
                let past = sights.iter().filter(|s| **s == Sight::Past).count();
                sights.len() >= EMPTY.1 && past as f64 > EMPTY.0 * sights.len() as f64
            })
        });
        match absent {
            Some(other) => {
                leave_out(
                    sources,
                    &t,
                    &format!("the photo of {} shows that its place is empty", sources[other].name),
                    dropped,
                );
            }
            None => kept.push(t),
        }
    }
    kept
}

/// Ids numbered by label, and the indices that pictures have.
fn name(things: &mut [Thing]) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for (k, t) in things.iter_mut().enumerate() {
        let count = counts.entry(t.object.label.clone()).or_default();
        *count += 1;
        t.object.id = ObjectId::numbered(&t.object.label, *count);
        t.object.index = 10 + k as u32;
        let folder = t.object.level.folder();
        t.object.mesh = format!("{folder}/meshes/{}.glb", t.object.id);
        let in_first = t.track.members.iter().any(|m| m.0 == 0);
        t.object.mask = in_first.then(|| format!("{folder}/masks/{}.png", t.object.id));
    }
}

/// Supports and relations in the joined scene's names, and everything set on what carries it.
fn connect(sources: &[Source], things: &mut [Thing], joint: &Joint) {
    let mut ids: BTreeMap<(usize, ObjectId), usize> = BTreeMap::new();
    for (k, t) in things.iter().enumerate() {
        for (run, o) in t.track.objects(sources) {
            ids.insert((run, o.object.id.clone()), k);
        }
    }
    let names: Vec<ObjectId> = things.iter().map(|t| t.object.id.clone()).collect();
    for k in 0..things.len() {
        let named = |run: usize, id: &Option<ObjectId>| {
            let found = ids.get(&(run, id.clone()?)).copied().filter(|found| *found != k)?;
            Some(names[found].clone())
        };
        let mut members = vec![(things[k].from.0, &sources[things[k].from.0].objects[things[k].from.1])];
        members.extend(things[k].track.objects(sources).filter(|m| m.0 != things[k].from.0));
        let supports = members.iter().filter_map(|(run, o)| match &o.object.support {
            Support::Wall { wall } => Some(Support::Wall { wall: joint.placings[*run].turn.wall(*wall) }),
            Support::Object { id } => Some(Support::Object { id: named(*run, &Some(id.clone()))? }),
            other => Some(other.clone()),
        });
        let support = supports.into_iter().next().unwrap_or(Support::Floor);
        let first = |pick: &dyn Fn(usize, &Relations) -> Option<ObjectId>| {
            members.iter().find_map(|(run, o)| pick(*run, &o.object.relations))
        };
        let wall = members
            .iter()
            .find_map(|(run, o)| Some(joint.placings[*run].turn.wall(o.object.relations.wall_affinity.wall()?)));
        let relations = Relations {
            wall_affinity: wall.map_or(WallAffinity::Centre, WallAffinity::from),
            on_top_of: first(&|run, r| named(run, &r.on_top_of)),
            in_front_of: first(&|run, r| named(run, &r.in_front_of)),
            behind: first(&|run, r| named(run, &r.behind)),
            facing_toward: first(&|run, r| named(run, &r.facing_toward)),
            group: members.iter().find_map(|(_, o)| o.object.relations.group.clone()),
            matched_set: members.iter().find_map(|(_, o)| o.object.relations.matched_set.clone()),
            joined_row: members.iter().find_map(|(_, o)| o.object.relations.joined_row.clone()),
        };
        let t = &mut things[k];
        t.object.support = support;
        t.object.relations = relations;
        let in_first = t.track.objects(sources).find(|(run, _)| *run == 0);
        t.object.seen_box = in_first.and_then(|(_, o)| o.object.seen_box);
    }
    at_walls(sources, things, joint);
    on_hosts(sources, things);
}

/// What hangs on a wall keeps the distance to it that its best run has (a flat picture a centimetre behind its place is
/// inside the wall), and what stands is inside the room as there.
fn at_walls(sources: &[Source], things: &mut [Thing], joint: &Joint) {
    for t in things {
        let (source, own) = (&sources[t.from.0], &sources[t.from.0].objects[t.from.1]);
        let by = t.object.size.depth / own.object.size.depth.max(1e-6);
        match (&t.object.support, &own.object.support) {
            (Support::Wall { wall }, Support::Wall { wall: there }) => {
                let gap = by * there.distance(&source.scene.room.extents, own.place());
                let off = gap - wall.distance(&joint.extents, t.object.pose.position);
                t.object.pose.position += wall.normal() * off;
            }
            (Support::Floor | Support::Object { .. } | Support::Block { .. } | Support::Niche { .. }, _) => {
                let (low, high) = bounds(t);
                for wall in Wall::ALL {
                    let nearest = if wall.normal().dot(DVec3::ONE) > 0.0 { low } else { high };
                    let out = -wall.distance(&joint.extents, nearest);
                    if (0.0..MAX_INWARD_M).contains(&out) {
                        t.object.pose.position += wall.normal() * out;
                    }
                }
            }
            _ => {}
        }
    }
}

/// Sets what stands on another thing at its host's height, from the floor up.
fn on_hosts(sources: &[Source], things: &mut [Thing]) {
    let host_of = |things: &[Thing], k: usize| match &things[k].object.support {
        Support::Object { id } => things.iter().position(|t| t.object.id == *id),
        _ => None,
    };
    let depth = |things: &[Thing], k: usize| {
        let (mut at, mut depth) = (k, 0);
        while let Some(host) = host_of(things, at).filter(|_| depth < things.len()) {
            (at, depth) = (host, depth + 1);
        }
        depth
    };
    let mut order: Vec<usize> = (0..things.len()).collect();
    order.sort_by_key(|k| depth(things, *k));
    for k in order {
        match &things[k].object.support {
            Support::Floor if things[k].object.level != Level::Ceiling => {
                // Furniture stands; what hung a little over the floor in its run keeps that.
                things[k].object.pose.position.y = things[k].object.pose.position.y.max(0.0);
            }
            Support::Object { .. } => {
                let Some(host) = host_of(things, k) else { continue };
                let (run, object) = things[k].from;
                let own = &sources[run].objects[object];
                let there = sources[run]
                    .objects
                    .iter()
                    .enumerate()
                    .find(|(i, _)| things[host].track.members.contains(&(run, *i)));
                let Some((_, there)) = there else { continue };
                let share = (own.place().y - there.place().y) / there.object.size.height.max(1e-3);
                let base = things[host].object.pose.position.y;
                things[k].object.pose.position.y = base + share * things[host].object.size.height;
            }
            _ => {}
        }
    }
}
