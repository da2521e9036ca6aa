//! How two runs lie together, and whether they show one room: hypotheses, each scored in nats.
//!
//! The score is the logarithm of the odds that both runs show one room laid so, against two rooms whose things lie near each
//! other by chance: for each pair of things that may be one, how much nearer they are (in place, size, colour, name) than
//! things of two rooms; for each wall and the height likewise; and against it, things that one photo should show and does
//! not. What the search over turns and places wins by chance is taken off at the end.
//!
//! Key `join.pair` of `docs/paper-map.md`.

use glam::DVec2;
use harmony_scene::{QuarterTurn, Surface, Wall};
use serde::Serialize;

use crate::assign::assign;
use crate::depth::Sight;
use crate::noise::{JoinNoise, for_one};
use crate::placing::{PlaceNoise, Placing, is_across};
use crate::source::{SeenObject, Source, flat};

/// Rounds of matching and moving of one hypothesis.
const ROUNDS: usize = 4;
/// Hypotheses whose places are nearer than this are one, metres.
const SAME_M: f64 = 0.6;
/// Nats by which a good pair of things can speak for one room at most: one coincidence must not decide.
const MAX_A_PAIR: f64 = 9.0;
/// Walls by chance lie anywhere in so many metres.
const WALLS_SPREAD: f64 = 2.0;

/// One way to lay two runs together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Overlap {
    /// The second run in the first one's frame.
    pub placing: Placing,
    /// Nats for one room against two.
    pub odds: f64,
    /// Things taken for one: places in the lists of objects of the first and the second run.
    pub pairs: Vec<(usize, usize)>,
    /// Things that one photo should show and does not.
    pub missing: u32,
}

/// The best way and what speaks against it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pairing {
    /// The best way; `None` without any thing or wall in common.
    pub best: Option<Overlap>,
    /// Nats by which it leads before the best quite different way.
    pub lead: f64,
}

/// Noise of a thing's place in its run's frame.
pub fn place_noise(source: &Source, object: &SeenObject, noise: &JoinNoise) -> PlaceNoise {
    let way = flat(object.place() - source.camera.centre());
    let distance = way.length();
    let factor = (1.0 + (noise.hidden - 1.0) * 2.0 * object.hidden) * if object.cut { noise.cut } else { 1.0 };
    PlaceNoise {
        along: way.try_normalize().unwrap_or(DVec2::Y),
        across_m: factor * (noise.across[0] * distance).hypot(noise.across[1]),
        along_m: factor * (noise.along[0] * distance).hypot(noise.along[1]),
    }
}

/// Lays the second run together with the first.
pub fn pair(first: &Source, second: &Source, noise: &JoinNoise) -> Pairing {
    use rayon::prelude::*;
    let starts = starts(first, second);
    let mut ways: Vec<Overlap> = starts.par_iter().map(|start| settled(first, second, start, noise)).collect();
    ways.sort_by(|a, b| b.odds.total_cmp(&a.odds));
    let Some(best) = ways.first().cloned() else { return Pairing { best: None, lead: 0.0 } };
    let other = |w: &&Overlap| {
        let apart = DVec2::new(w.placing.x - best.placing.x, w.placing.z - best.placing.z).length();
        w.placing.turn != best.placing.turn || apart > SAME_M
    };
    let lead = best.odds - ways.iter().find(other).map_or(0.0, |w| w.odds.max(0.0));
    Pairing { best: Some(best), lead }
}

/// What the search wins by chance, nats: the logarithm of how many ways there are to lay a room on another one.
fn chance(first: &Source) -> f64 {
    let e = first.scene.room.extents;
    (4.0 * e.width * e.depth / (std::f64::consts::TAU * 0.15 * 0.15)).max(4.0).ln()
}

/// Ways to begin with: each pair of one kind on each other, and the rooms' boxes in each other's corners.
fn starts(first: &Source, second: &Source) -> Vec<Placing> {
    let mut out = Vec::new();
    let (e, f) = (first.scene.room.extents, second.scene.room.extents);
    for turn in QuarterTurn::ALL {
        let own = turn.extents(&f);
        let origin = turn.origin(&f);
        for (x, z) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (x, z) = (x * (e.width - own.width) + origin.x, z * (e.depth - own.depth) + origin.z);
            out.push(Placing { turn, yaw: 0.0, ln_scale: 0.0, x, z });
        }
        let rotation = turn.rotation();
        for a in &first.objects {
            for b in second.objects.iter().filter(|b| a.same_kind(b)) {
                let t = a.place() - rotation * b.place();
                out.push(Placing { turn, yaw: 0.0, ln_scale: 0.0, x: t.x, z: t.z });
            }
        }
    }
    out
}

/// A hypothesis moved to where its own pairs and walls want it.
fn settled(first: &Source, second: &Source, start: &Placing, noise: &JoinNoise) -> Overlap {
    // Far starts find their pairs in a wider net.
    let mut placing = *start;
    let mut pairs = Vec::new();
    for round in 0..ROUNDS {
        let net = [3.0, 2.0, 1.4, 1.0][round.min(3)];
        pairs = matched(first, second, &placing, noise, net);
        placing = moved(first, second, &placing, &pairs, noise);
    }
    let (odds, missing) = odds(first, second, &placing, &pairs, noise);
    Overlap { placing, odds, pairs, missing }
}

fn matched(first: &Source, second: &Source, placing: &Placing, noise: &JoinNoise, net: f64) -> Vec<(usize, usize)> {
    let gains: Vec<Vec<f64>> = first
        .objects
        .iter()
        .map(|a| second.objects.iter().map(|b| gain(first, a, second, b, placing, noise, net)).collect())
        .collect();
    assign(&gains)
}

/// Nats that speak for two things being one. `net` times the sigmas of their places.
pub fn gain(
    first: &Source,
    a: &SeenObject,
    second: &Source,
    b: &SeenObject,
    placing: &Placing,
    noise: &JoinNoise,
    net: f64,
) -> f64 {
    if !a.same_kind(b) {
        return f64::NEG_INFINITY;
    }
    let difference = placing.point(b.place()) - a.place();
    let sigma = net * joint_sigma(first, a, second, b, noise);
    let e = first.scene.room.extents;
    let r = flat(difference).length() / sigma;
    let place = (e.width * e.depth / (std::f64::consts::TAU * sigma * sigma)).ln() - 0.5 * r * r;
    let rise = for_one(difference.y, (net * 0.08).hypot(0.02 * a.place().y), 0.7);
    let grown = |axis: usize| {
        let (x, y) = (a.object.size.as_vec()[axis], b.object.size.as_vec()[axis]);
        (y.max(1e-3) / x.max(1e-3)).ln() + placing.ln_scale
    };
    let size = for_one(grown(1), 2.0 * noise.size, noise.size_kind).max(-3.0);
    let color = a.lab.zip(b.lab).map_or(0.0, |(p, q)| {
        // Lightness differs from photo to photo: half of it counts.
        let d = [0.5 * (p[0] - q[0]), p[1] - q[1], p[2] - q[2]];
        (0..3).map(|i| for_one(d[i], noise.color, noise.color_kind)).sum::<f64>().max(-3.0)
    });
    let kind = -noise.same_kind.ln();
    (place + rise + size + color + kind).min(MAX_A_PAIR)
}

/// One sigma of the distance between what two runs say of one place, the same in all directions.
fn joint_sigma(first: &Source, a: &SeenObject, second: &Source, b: &SeenObject, noise: &JoinNoise) -> f64 {
    let mean = |n: PlaceNoise| (0.5 * (n.across_m * n.across_m + n.along_m * n.along_m)).sqrt();
    let distance = a.place().distance(first.camera.centre()) + b.place().distance(second.camera.centre());
    let (p, q) = (mean(place_noise(first, a, noise)), mean(place_noise(second, b, noise)));
    // The scales are fitted, but only so well.
    noise.pairing * p.hypot(q).hypot(0.5 * noise.scale * distance)
}

/// The placing that pairs and walls want: turns and scales of few things say little, so that only the shift is free until
/// there are three.
fn moved(first: &Source, second: &Source, placing: &Placing, pairs: &[(usize, usize)], noise: &JoinNoise) -> Placing {
    let start = [placing.yaw, placing.ln_scale, placing.x, placing.z];
    let with = |p: &[f64]| Placing { yaw: p[0], ln_scale: p[1], x: p[2], z: p[3], ..*placing };
    let sigmas: Vec<f64> =
        pairs.iter().map(|(i, j)| joint_sigma(first, &first.objects[*i], second, &second.objects[*j], noise)).collect();
    let walls = common_walls(first, second, placing.turn);
    let scales = noise.pairing * noise.scale * std::f64::consts::SQRT_2;
    let residuals = |p: &[f64], out: &mut Vec<f64>| {
        let trial = with(p);
        out.push(p[0] / (2.0 * noise.askew));
        out.push(p[1] / scales);
        for ((i, j), sigma) in pairs.iter().zip(&sigmas) {
            let d = flat(trial.point(second.objects[*j].place()) - first.objects[*i].place());
            let r = d.length() / sigma;
            // Geman and McClure: what does not fit counts little.
            let weight = 1.0 / (1.0 + (r / noise.limit).powi(2)).sqrt();
            out.extend((d / *sigma * weight).to_array());
        }
        for (own, wall) in &walls {
            let (off, sigma) = wall_off(first, second, &trial, *own, *wall, noise);
            out.push(off / sigma);
        }
        if pairs.is_empty() && walls.is_empty() {
            out.extend([p[2] - start[2], p[3] - start[3]]);
        }
    };
    let found = harmony_geometry::least_squares::minimise(&start, &[1e-5, 1e-5, 1e-4, 1e-4], 12, residuals);
    if found.parameters.iter().all(|v| v.is_finite()) { with(&found.parameters) } else { *placing }
}

/// Walls that both photos show: of the second run, and the first's that each is.
fn common_walls(first: &Source, second: &Source, turn: QuarterTurn) -> Vec<(Wall, Wall)> {
    let both = Wall::ALL.into_iter().filter(|w| second.saw(w.surface()));
    both.map(|w| (w, turn.wall(w))).filter(|(_, w)| first.saw(w.surface())).collect()
}

/// How far apart two runs have one wall, metres, and one sigma of it.
fn wall_off(
    first: &Source,
    second: &Source,
    placing: &Placing,
    own: Wall,
    wall: Wall,
    noise: &JoinNoise,
) -> (f64, f64) {
    let e = first.scene.room.extents;
    let at = placing.wall_offset(own, &second.scene.room.extents, second.camera.centre());
    let here = match wall {
        Wall::Left | Wall::Back => 0.0,
        Wall::Right => e.width,
        Wall::Front => e.depth,
    };
    let sigma = |d: f64| (noise.wall[0] * d).hypot(noise.wall[1]);
    (at - here, noise.pairing * sigma(first.distance_to(wall)).hypot(sigma(second.distance_to(own))))
}

fn odds(first: &Source, second: &Source, placing: &Placing, pairs: &[(usize, usize)], noise: &JoinNoise) -> (f64, u32) {
    let mut odds = -chance(first);
    for (i, j) in pairs {
        odds += gain(first, &first.objects[*i], second, &second.objects[*j], placing, noise, 1.0);
    }
    for (own, wall) in common_walls(first, second, placing.turn) {
        let (off, sigma) = wall_off(first, second, placing, own, wall, noise);
        odds += for_one(off, 2.0 * sigma, WALLS_SPREAD).max(-4.0);
    }
    if first.saw(Surface::Ceiling) && second.saw(Surface::Ceiling) {
        let ratio = second.scene.room.extents.height / first.scene.room.extents.height;
        odds += for_one(ratio.ln() + placing.ln_scale, 2.0 * noise.height[0], noise.rooms_height).max(-4.0);
    }
    let (missing, against) = missing(first, second, placing, pairs, noise);
    (odds - against, missing)
}

/// Things of each run without a counterpart where the other photo should show one: how many are at a place that it sees
/// past, and the nats against one room. Where it sees some surface there may be a thing of another name.
fn missing(
    first: &Source,
    second: &Source,
    placing: &Placing,
    pairs: &[(usize, usize)],
    noise: &JoinNoise,
) -> (u32, f64) {
    let back = placing.inverse();
    let (mut past, mut other) = (0, 0);
    let mut count = |own: &Source, there: &Source, way: &Placing, paired: &dyn Fn(usize) -> bool| {
        for (_, o) in own.objects.iter().enumerate().filter(|(k, _)| !paired(*k)) {
            let middle = o.place() + glam::DVec3::Y * o.object.size.height * 0.5;
            match there.depth.sight(way.point(middle)) {
                Sight::Past => past += 1,
                Sight::There => other += 1,
                Sight::Hidden | Sight::Outside => {}
            }
        }
    };
    count(first, second, &back, &|k| pairs.iter().any(|(i, _)| *i == k));
    count(second, first, placing, &|k| pairs.iter().any(|(_, j)| *j == k));
    (past, -noise.missed.ln() * f64::from(past) - noise.named_otherwise.ln() * f64::from(other))
}

/// Whether a wall of the joined room runs along x or along z, and its plane's offset there.
pub fn plane_of(wall: Wall, width: f64, depth: f64) -> f64 {
    match wall {
        Wall::Left | Wall::Back => 0.0,
        _ if is_across(wall) => width,
        _ => depth,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{ROOM, furnished, source, thing};

    fn laid(first: &Source, second: &Source) -> Pairing {
        pair(first, second, &JoinNoise::default())
    }

    #[test]
    fn the_turn_and_the_place_are_found_whichever_wall_the_second_photo_faces() {
        let things = furnished();
        let first = source("a", ROOM, &things, QuarterTurn::ALL[0], 1.0, &[]);
        for turn in &QuarterTurn::ALL[1..] {
            let second = source("b", ROOM, &things, *turn, 1.04, &[0.05, -0.04, 0.03, 0.06, -0.05, 0.02]);
            let pairing = laid(&first, &second);
            let best = pairing.best.unwrap();
            assert!(best.odds > JoinNoise::default().least_odds, "{turn:?}: {best:?}");
            assert!(pairing.lead > JoinNoise::default().least_lead, "{turn:?}: {}", pairing.lead);
            assert_eq!(best.placing.turn, turn.inverse());
            // A place of the second run's frame, scaled as that is, comes to where it is in the first one's.
            let truth = glam::DVec3::new(2.0, 0.0, 1.5);
            let found = best.placing.point(turn.point(&ROOM, truth) * 1.04);
            assert!(found.distance(truth) < 0.08, "{turn:?}: {found} {truth}");
            assert!(best.pairs.iter().all(|(i, j)| first.objects[*i].object.label == second.objects[*j].object.label));
        }
    }

    #[test]
    fn another_room_is_not_the_same() {
        let first = source("a", ROOM, &furnished(), QuarterTurn::ALL[0], 1.0, &[]);
        let other = vec![
            thing("bed", [1.6, 1.1], 0.0, [1.6, 0.6, 2.0]),
            thing("wardrobe", [3.2, 0.4], 0.0, [1.2, 2.1, 0.6]),
            thing("armchair", [0.6, 2.9], 0.4, [0.7, 0.9, 0.75]),
            thing("waste bin", [2.9, 2.6], 0.0, [0.2, 0.3, 0.2]),
        ];
        let extents = harmony_scene::Extents { width: 3.7, height: 2.8, depth: 4.1 };
        for turn in QuarterTurn::ALL {
            let second = source("b", extents, &other, turn, 1.0, &[]);
            let odds = laid(&first, &second).best.map_or(f64::NEG_INFINITY, |b| b.odds);
            assert!(odds < JoinNoise::default().least_odds, "{turn:?}: {odds}");
        }
    }

    #[test]
    fn a_room_that_looks_the_same_from_both_ends_fits_in_two_ways() {
        // Point-symmetric about the middle of the floor.
        let chairs = [[1.0, 1.0], [3.2, 2.4], [1.0, 2.4], [3.2, 1.0]];
        let things: Vec<_> = chairs.iter().map(|at| thing("chair", *at, 0.0, [0.45, 0.9, 0.45])).collect();
        let first = source("a", ROOM, &things, QuarterTurn::ALL[0], 1.0, &[]);
        let second = source("b", ROOM, &things, QuarterTurn::ALL[2], 1.0, &[]);
        let pairing = laid(&first, &second);
        assert!(pairing.lead < JoinNoise::default().least_lead, "{pairing:?}");
    }
}
