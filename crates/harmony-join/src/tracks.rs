//! Which objects of the runs are one thing.
//!
//! Key `join.match` of `docs/paper-map.md`.

use serde::Serialize;

use crate::assign::assign;
use crate::noise::JoinNoise;
use crate::pair::gain;
use crate::placing::Placing;
use crate::source::{SeenObject, Source};

/// One thing, as some runs have it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Track {
    /// Run and place in its list of objects, at most one a run.
    pub members: Vec<(usize, usize)>,
}

impl Track {
    /// Its objects.
    pub fn objects<'a>(&'a self, sources: &'a [Source]) -> impl Iterator<Item = (usize, &'a SeenObject)> {
        self.members.iter().map(|(run, object)| (*run, &sources[*run].objects[*object]))
    }

    /// The run that sees it best, and its object there.
    pub fn best<'a>(&'a self, sources: &'a [Source]) -> (usize, &'a SeenObject) {
        let seen = self.objects(sources).max_by(|a, b| a.1.quality().total_cmp(&b.1.quality()));
        seen.expect("a track has a member")
    }
}

/// Matches the objects of all runs, run by run in the order in which these were reached.
pub fn tracks(sources: &[Source], placings: &[Placing], order: &[usize], noise: &JoinNoise) -> Vec<Track> {
    let mut tracks: Vec<Track> = Vec::new();
    for run in order {
        let source = &sources[*run];
        let relative: Vec<Placing> = placings.iter().map(|of| of.inverse().after(&placings[*run])).collect();
        let for_one = |track: &Track, object: &SeenObject| {
            let each = track
                .objects(sources)
                .map(|(other, seen)| gain(&sources[other], seen, source, object, &relative[other], noise, 1.0));
            each.sum::<f64>() / track.members.len().max(1) as f64
        };
        let gains: Vec<Vec<f64>> =
            tracks.iter().map(|track| source.objects.iter().map(|o| for_one(track, o)).collect()).collect();
        let mut taken = vec![false; source.objects.len()];
        for (track, object) in assign(&gains) {
            tracks[track].members.push((*run, object));
            taken[object] = true;
        }
        let alone = (0..source.objects.len()).filter(|k| !taken[*k]);
        tracks.extend(alone.map(|k| Track { members: vec![(*run, k)] }));
    }
    tracks
}
