//! The table of several photos beside one.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::{ObjectError, RoomOfPhotos, Scene};
use crate::summary::quantile;

/// A number of photos over all rooms.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Line {
    /// Photos of a room.
    pub photos: usize,
    /// Rooms, those whose runs were joined, and those of which none was left out.
    pub rooms: [usize; 3],
    /// Objects that are compared with the first photo's run.
    pub objects: usize,
    /// Their errors of place, metres, raw: median and 90th percentile.
    pub raw_m: [f64; 2],
    /// ... after scale alignment.
    pub aligned_m: [f64; 2],
    /// These four over those of one photo on the same objects.
    pub ratios: [f64; 4],
    /// Ratios of the medians, raw and aligned, of those objects that two photos or more have; how many they are.
    pub shared: ([f64; 2], usize),
    /// Mean over the rooms of the logarithm of the ratio of the room's median raw errors, and its standard error.
    pub by_room: [f64; 2],
    /// Errors of size, median.
    pub size: f64,
    /// Mean relative error of width, height and depth: median over rooms.
    pub extents: f64,
    /// Share of the objects that any photo of the room shows.
    pub recall: f64,
    /// Median raw error of place of all of them, metres.
    pub all_m: f64,
    /// Objects that are nothing, or there twice; things made of different ones.
    pub faults: [usize; 2],
    /// Share of the true objects' surface that the photos show.
    pub seen_objects: f64,
    /// Share of the room's.
    pub seen_room: f64,
}

/// One line for one photo and one for each number of several.
pub fn lines(rooms: &[RoomOfPhotos], photos: &[usize]) -> Vec<Line> {
    let one = line(1, rooms, |room| Some(&room.single));
    let several = photos.iter().map(|n| {
        line(*n, rooms, |room| room.joined.iter().find(|(k, _)| k == n).and_then(|(_, scene)| scene.as_ref().ok()))
    });
    std::iter::once(one).chain(several).collect()
}

fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

fn line<'a>(photos: usize, rooms: &'a [RoomOfPhotos], of: impl Fn(&'a RoomOfPhotos) -> Option<&'a Scene>) -> Line {
    let mut pairs: Vec<(&ObjectError, &ObjectError)> = Vec::new();
    let mut logs = Vec::new();
    let (mut all, mut found, mut there, mut faults, mut joined) = (Vec::new(), 0, 0, [0, 0], [0, 0]);
    let (mut extents, mut seen) = (Vec::new(), [Vec::new(), Vec::new()]);
    for room in rooms {
        joined[0] += usize::from(of(room).is_some());
        joined[1] += usize::from(of(room).is_some_and(|scene| scene.photos == photos));
        // Runs that are not joined leave the first photo's scene.
        let scene = of(room).unwrap_or(&room.single);
        let by_id: BTreeMap<&str, &ObjectError> = scene.objects.iter().map(|o| (o.truth.as_str(), o)).collect();
        let own: Vec<(&ObjectError, &ObjectError)> =
            room.single.objects.iter().filter_map(|o| Some((o, *by_id.get(o.truth.as_str())?))).collect();
        if !own.is_empty() {
            let middle = |side: &dyn Fn(&(&ObjectError, &ObjectError)) -> f64| {
                median(&own.iter().map(side).collect::<Vec<_>>()).max(1e-4)
            };
            logs.push((middle(&|p| p.1.raw_m) / middle(&|p| p.0.raw_m)).ln());
        }
        pairs.extend(own);
        all.extend(scene.objects.iter().map(|o| o.raw_m));
        found += scene.objects.len();
        there += scene.there;
        faults[0] += scene.false_or_double.len();
        faults[1] += scene.mixed.len();
        extents.push(scene.extents.iter().map(|e| e.abs()).sum::<f64>() / 3.0);
        seen[0].push(scene.seen_objects);
        seen[1].push(scene.seen_room);
    }
    let both = |f: &dyn Fn(&ObjectError) -> f64, q: f64| both_sides(&pairs, f, q);
    let shared: Vec<_> = pairs.iter().copied().filter(|p| p.1.photos > 1).collect();
    let share = |f: &dyn Fn(&ObjectError) -> f64| {
        let [one, several] = both_sides(&shared, f, 0.5);
        several / one
    };
    let measures =
        [both(&|o| o.raw_m, 0.5), both(&|o| o.raw_m, 0.9), both(&|o| o.aligned_m, 0.5), both(&|o| o.aligned_m, 0.9)];
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
    let log = mean(&logs);
    let spread = logs.iter().map(|l| (l - log).powi(2)).sum::<f64>() / (logs.len().max(2) - 1) as f64;
    Line {
        photos,
        rooms: [rooms.len(), joined[0], joined[1]],
        objects: pairs.len(),
        raw_m: [measures[0][1], measures[1][1]],
        aligned_m: [measures[2][1], measures[3][1]],
        ratios: measures.map(|[one, several]| several / one),
        shared: ([share(&|o| o.raw_m), share(&|o| o.aligned_m)], shared.len()),
        by_room: [log, (spread / logs.len().max(1) as f64).sqrt()],
        size: both(&|o| o.size.abs(), 0.5)[1],
        extents: median(&extents),
        recall: found as f64 / (there.max(1)) as f64,
        all_m: median(&all),
        faults,
        seen_objects: mean(&seen[0]),
        seen_room: mean(&seen[1]),
    }
}

/// A quantile of the first photo's errors and of those of several.
fn both_sides(pairs: &[(&ObjectError, &ObjectError)], f: &dyn Fn(&ObjectError) -> f64, q: f64) -> [f64; 2] {
    let of =
        |side: &dyn Fn(&(&ObjectError, &ObjectError)) -> f64| quantile(&pairs.iter().map(side).collect::<Vec<_>>(), q);
    [of(&|p| f(p.0)), of(&|p| f(p.1))]
}

/// The lines as a table in Markdown.
pub fn markdown(lines: &[Line]) -> String {
    let mut out = String::from(
        "| photos | rooms joined (of all photos) | objects compared | place, median | p90 | aligned, median | p90 | ratio to one photo: median | p90 | aligned median | p90 | in two photos or more: median | aligned median | by room (log) | size | room's size | recall | all: median | nothing or double | mixed | seen of objects | seen of room |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for l in lines {
        let ratio = |k: usize| if l.photos == 1 { "1".to_owned() } else { format!("{:.2}", l.ratios[k]) };
        let shared = |k: usize| {
            if l.photos == 1 { String::new() } else { format!("{:.2} ({})", l.shared.0[k], l.shared.1) }
        };
        let by_room =
            if l.photos == 1 { "0".to_owned() } else { format!("{:+.2} +- {:.2}", l.by_room[0], l.by_room[1]) };
        let _ = writeln!(
            out,
            "| {} | {} ({}) of {} | {} | {:.3} m | {:.3} m | {:.3} m | {:.3} m | {} | {} | {} | {} | {} | {} | {} | {:.1} % | {:.1} % | {:.0} % | {:.3} m | {} | {} | {:.0} % | {:.0} % |",
            l.photos,
            l.rooms[1],
            l.rooms[2],
            l.rooms[0],
            l.objects,
            l.raw_m[0],
            l.raw_m[1],
            l.aligned_m[0],
            l.aligned_m[1],
            ratio(0),
            ratio(1),
            ratio(2),
            ratio(3),
            shared(0),
            shared(1),
            by_room,
            100.0 * l.size,
            100.0 * l.extents,
            100.0 * l.recall,
            l.all_m,
            l.faults[0],
            l.faults[1],
            100.0 * l.seen_objects,
            100.0 * l.seen_room,
        );
    }
    out
}
