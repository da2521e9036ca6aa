//! All runs, the room and the places of all things as one least squares.
//!
//! Unknown are the room's size, of each run its scale, shift and what its walls are askew, and of each thing its place on the
//! floor plan. Each photo holds a thing well across its line of sight and less well along it, so that photos from other sides
//! hold what one leaves open; each holds the walls that it shows; a thing stays where it is on what carries it and before its
//! wall. Places that do not fit count little (Geman and McClure).
//!
//! Key `join.solve` of `docs/paper-map.md`.

use glam::{DMat2, DVec2};
use harmony_geometry::least_squares::minimise;
use harmony_scene::{Extents, Support, Wall};
use serde::Serialize;

use crate::noise::JoinNoise;
use crate::pair::{place_noise, plane_of};
use crate::placing::{PlaceNoise, Placing, is_across};
use crate::source::{Source, flat};
use crate::tracks::Track;

/// Unknowns: width, depth, ln height; then four a run; then two a thing.
const ROOM: usize = 3;
const EACH_RUN: usize = 4;
const EACH_THING: usize = 2;
/// Iterations of the least squares.
const ITERATIONS: usize = 25;
/// One sigma of where a thing is on what carries it, metres.
const ON_HOST_M: f64 = 0.03;

/// What the least squares found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Joint {
    /// Each run in the joined room, whose back-left floor corner is the origin.
    pub placings: Vec<Placing>,
    /// The room.
    pub extents: Extents,
    /// Places of the things, `(x, z)`.
    pub places: Vec<[f64; 2]>,
    /// One sigma of each place (root of the summed variances), metres.
    pub sigmas: Vec<f64>,
    /// Half the squared residuals, nats.
    pub energy: f64,
}

/// A thing as one run has it.
struct Sighting {
    run: usize,
    track: usize,
    /// Place in the run's frame.
    place: glam::DVec3,
    noise: PlaceNoise,
    /// Wall of the run that it hangs on or stands at.
    wall: Option<(Wall, f64)>,
    /// Track of what carries it, and the way from there, run's frame.
    host: Option<(usize, DVec2)>,
}

fn sightings(sources: &[Source], tracks: &[Track], noise: &JoinNoise) -> Vec<Sighting> {
    let mut out = Vec::new();
    for (track, t) in tracks.iter().enumerate() {
        for (run, seen) in t.objects(sources) {
            let source = &sources[run];
            let wall = match &seen.object.support {
                Support::Wall { wall } => Some(*wall),
                Support::Floor => seen.object.relations.wall_affinity.wall(),
                _ => None,
            };
            let host = match &seen.object.support {
                Support::Object { id } => source.objects.iter().position(|o| o.object.id == *id),
                _ => None,
            };
            let host = host.and_then(|h| {
                let of = tracks.iter().position(|t| t.members.contains(&(run, h)))?;
                Some((of, flat(seen.place() - source.objects[h].place())))
            });
            out.push(Sighting {
                run,
                track,
                place: seen.place(),
                noise: place_noise(source, seen, noise),
                wall: wall.map(|w| (w, w.distance(&source.scene.room.extents, seen.place()))),
                host,
            });
        }
    }
    out
}

/// A run's placing by the unknowns.
fn placing_of(start: &Placing, u: &[f64], run: usize) -> Placing {
    let at = ROOM + EACH_RUN * run;
    Placing { turn: start.turn, yaw: u[at], ln_scale: u[at + 1], x: u[at + 2], z: u[at + 3] }
}

/// The numbers of the unknowns.
struct Layout {
    runs: usize,
}

impl Layout {
    fn thing(&self, track: usize) -> usize {
        ROOM + EACH_RUN * self.runs + EACH_THING * track
    }
}

/// Solves for everything, from placings of the runs in the first one's frame.
pub fn solve(sources: &[Source], start: &[Placing], tracks: &[Track], noise: &JoinNoise) -> Joint {
    let layout = Layout { runs: sources.len() };
    let sightings = sightings(sources, tracks, noise);
    let first = sources[0].scene.room.extents;
    let mut u = vec![first.width, first.depth, first.height.ln()];
    for placing in start {
        u.extend([placing.yaw, placing.ln_scale, placing.x, placing.z]);
    }
    for track in 0..tracks.len() {
        let of = sightings.iter().filter(|s| s.track == track);
        let (sum, count) =
            of.fold((DVec2::ZERO, 0.0), |(sum, n), s| (sum + flat(start[s.run].point(s.place)), n + 1.0));
        u.extend((sum / f64::max(count, 1.0)).to_array());
    }
    let steps = vec![1e-5; u.len()];
    let residuals = |u: &[f64], out: &mut Vec<f64>| {
        for (run, source) in sources.iter().enumerate() {
            let placing = placing_of(&start[run], u, run);
            of_run(source, &placing, u, noise, out);
        }
        for s in &sightings {
            of_sighting(s, &placing_of(&start[s.run], u, s.run), u, &layout, noise, out);
        }
    };
    let found = minimise(&u, &steps, ITERATIONS, residuals);
    let u = found.parameters;
    let places = (0..tracks.len()).map(|t| [u[layout.thing(t)], u[layout.thing(t) + 1]]).collect();
    let sigmas =
        (0..tracks.len()).map(|t| found.sigmas[layout.thing(t)].hypot(found.sigmas[layout.thing(t) + 1])).collect();
    Joint {
        placings: (0..sources.len()).map(|run| placing_of(&start[run], &u, run)).collect(),
        extents: Extents { width: u[0], depth: u[1], height: u[2].exp() },
        places,
        sigmas,
        energy: found.cost,
    }
}

/// What a run says of its own scale, and of the room.
fn of_run(source: &Source, placing: &Placing, u: &[f64], noise: &JoinNoise, out: &mut Vec<f64>) {
    let e = &source.scene.room.extents;
    out.push(placing.ln_scale / noise.scale);
    out.push(placing.yaw / noise.askew);
    for wall in Wall::ALL {
        let off = placing.wall_offset(wall, e, source.camera.centre()) - plane_of(placing.turn.wall(wall), u[0], u[1]);
        let distance = source.distance_to(wall);
        let sigma = if source.saw(wall.surface()) {
            (noise.wall[0] * distance).hypot(noise.wall[1])
        } else {
            noise.wall_unseen
        };
        out.push(off / sigma);
    }
    let known = usize::from(!source.saw_height());
    out.push((e.height.ln() + placing.ln_scale - u[2]) / noise.height[known]);
}

fn of_sighting(s: &Sighting, placing: &Placing, u: &[f64], layout: &Layout, noise: &JoinNoise, out: &mut Vec<f64>) {
    let thing = |track: usize| DVec2::new(u[layout.thing(track)], u[layout.thing(track) + 1]);
    let at = thing(s.track);
    // The difference in the run's frame, where its line of sight is known. Ry turns (x, z) by -angle in this plane.
    let turn = DMat2::from_angle(placing.turn.angle() + placing.yaw);
    let scale = placing.ln_scale.exp();
    let r = s.noise.sigmas(turn * (at - flat(placing.point(s.place))) / scale);
    let weight = 1.0 / (1.0 + (r.length() / noise.limit).powi(2)).sqrt();
    out.extend((r * weight).to_array());
    out.push(s.wall.map_or(0.0, |(own, gap)| {
        let wall = placing.turn.wall(own);
        let along = if is_across(wall) { at.x } else { at.y };
        let off = (along - plane_of(wall, u[0], u[1])).abs() - scale * gap;
        let r = off / noise.wall_gap;
        r / (1.0 + (r / noise.limit).powi(2)).sqrt()
    }));
    let on_host = s.host.map_or(DVec2::ZERO, |(host, way)| {
        let r = (turn * (at - thing(host)) / scale - way) / ON_HOST_M;
        r / (1.0 + (r.length() / noise.limit).powi(2)).sqrt()
    });
    out.extend(on_host.to_array());
}

#[cfg(test)]
mod tests {
    use harmony_scene::QuarterTurn;

    use super::*;
    use crate::testing::{ROOM, furnished, source};
    use crate::tracks::tracks;

    /// What four photos, one before each wall, say together where each has every thing 12 cm too near or too far.
    fn joined(runs: usize) -> (Vec<Source>, Joint, Vec<Track>) {
        let noise = JoinNoise::default();
        let off = |run: usize| -> Vec<f64> {
            (0..6).map(|k| if (run + k).is_multiple_of(2) { 0.12 } else { -0.12 }).collect()
        };
        let scale = [1.03, 0.98, 1.01, 0.97];
        let sources: Vec<Source> = (0..runs)
            .map(|r| source(&format!("{r}"), ROOM, &furnished(), QuarterTurn::ALL[[0, 1, 2, 3][r]], scale[r], &off(r)))
            .collect();
        let links = crate::tree::links(&sources, &noise);
        let (placings, order) = crate::tree::spanned(runs, &links, &noise);
        let start: Vec<Placing> = placings.into_iter().map(|p| p.expect("all show one room")).collect();
        let found = tracks(&sources, &start, &order, &noise);
        let joint = solve(&sources, &start, &found, &noise);
        (sources, joint, found)
    }

    fn errors(sources: &[Source], joint: &Joint, tracks: &[Track]) -> Vec<f64> {
        let mut out = Vec::new();
        for (track, place) in tracks.iter().zip(&joint.places) {
            let label = &track.objects(sources).next().unwrap().1.object.label;
            let truth = furnished().into_iter().find(|t| t.label == label).unwrap();
            out.push((place[0] - truth.at[0]).hypot(place[1] - truth.at[1]));
        }
        out
    }

    #[test]
    fn photos_from_other_sides_hold_what_one_leaves_open() {
        let (sources, joint, tracks) = joined(4);
        assert_eq!(tracks.len(), 6, "{tracks:?}");
        let errors = errors(&sources, &joint, &tracks);
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        // One photo has 12 cm along the line of sight, and its scale beside; the errors here conspire with the scales.
        assert!(mean < 0.75 * 0.12, "{errors:?}");
        assert!((joint.extents.width - ROOM.width).abs() < 0.06 && (joint.extents.depth - ROOM.depth).abs() < 0.06);
        assert!(joint.sigmas.iter().all(|s| s.is_finite() && *s < 0.1), "{:?}", joint.sigmas);
    }

    #[test]
    fn more_photos_leave_less_open() {
        let sigma = |runs: usize| {
            let joint = joined(runs).1;
            joint.sigmas.iter().sum::<f64>() / joint.sigmas.len() as f64
        };
        assert!(sigma(4) < 0.85 * sigma(2), "{} {}", sigma(4), sigma(2));
    }
}
