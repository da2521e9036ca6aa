//! All runs in the frame of the first: a spanning tree over the pairs that show one room beyond doubt.

use serde::Serialize;

use crate::noise::JoinNoise;
use crate::pair::{Overlap, Pairing, pair};
use crate::placing::Placing;
use crate::source::Source;

/// What two runs say of each other.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Link {
    /// The runs, by number.
    pub runs: [usize; 2],
    /// How they lie together best.
    pub pairing: Pairing,
}

impl Link {
    /// The best way, when it is beyond doubt.
    pub fn sure(&self, noise: &JoinNoise) -> Option<&Overlap> {
        let clear = |w: &&Overlap| w.odds >= noise.least_odds && self.pairing.lead >= noise.least_lead;
        self.pairing.best.as_ref().filter(clear)
    }
}

/// All pairs of runs.
pub fn links(sources: &[Source], noise: &JoinNoise) -> Vec<Link> {
    let pairs = (0..sources.len()).flat_map(|i| (i + 1..sources.len()).map(move |j| [i, j]));
    pairs.map(|[i, j]| Link { runs: [i, j], pairing: pair(&sources[i], &sources[j], noise) }).collect()
}

/// Where each run lies in the first one's frame, by the surest links; `None` for runs that none leads to. Also the order in
/// which they were reached.
pub fn spanned(count: usize, links: &[Link], noise: &JoinNoise) -> (Vec<Option<Placing>>, Vec<usize>) {
    let mut placings: Vec<Option<Placing>> = vec![None; count];
    let mut order = Vec::new();
    if count > 0 {
        placings[0] = Some(Placing::FIRST);
        order.push(0);
    }
    loop {
        let reached = |run: usize| placings[run].is_some();
        let next = links
            .iter()
            .filter(|link| reached(link.runs[0]) != reached(link.runs[1]))
            .filter_map(|link| Some((link, link.sure(noise)?)))
            .max_by(|a, b| a.1.odds.total_cmp(&b.1.odds));
        let Some((link, way)) = next else { break };
        let [i, j] = link.runs;
        // The tree grows from its known end.
        let (run, placing) = match (placings[i], placings[j]) {
            (Some(known), _) => (j, known.after(&way.placing)),
            (None, Some(known)) => (i, known.after(&way.placing.inverse())),
            (None, None) => break,
        };
        placings[run] = Some(placing);
        order.push(run);
    }
    (placings, order)
}

#[cfg(test)]
mod tests {
    use harmony_scene::QuarterTurn;

    use super::*;

    fn link(runs: [usize; 2], odds: f64, lead: f64, x: f64) -> Link {
        let placing = Placing { turn: QuarterTurn::ALL[1], x, ..Placing::FIRST };
        Link { runs, pairing: Pairing { best: Some(Overlap { placing, odds, pairs: Vec::new(), missing: 0 }), lead } }
    }

    #[test]
    fn a_run_is_reached_over_another_one_and_doubtful_links_are_not_taken() {
        let links = [link([0, 1], 30.0, 20.0, 1.0), link([0, 2], 90.0, 0.1, 7.0), link([1, 2], 22.0, 9.0, 2.0)];
        let (placings, order) = spanned(3, &links, &JoinNoise::default());
        assert_eq!(order, [0, 1, 2]);
        let last = placings[2].unwrap();
        assert_eq!(last.turn, QuarterTurn::ALL[2]);
        let both = links[0].pairing.best.as_ref().unwrap().placing;
        assert!((last.point(glam::DVec3::ZERO) - both.point(glam::DVec3::new(2.0, 0.0, 0.0))).length() < 1e-12);
        let unsure = [link([0, 1], 2.0, 2.0, 1.0)];
        assert_eq!(spanned(2, &unsure, &JoinNoise::default()).0[1], None);
    }
}
