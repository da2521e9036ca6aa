//! Several objects of one photo: each pixel to at most one.

use harmony_scene::{ImageSize, Mask};

use super::{CutOut, Exclusion, SegmentPrompt, Segmented};

/// Difference of mean log odds below which the smaller object is taken to be in front.
const CLEAR_ODDS: f32 = 1.5;

/// A prompt that also knows of the other prompts.
pub(super) fn informed(prompts: &[SegmentPrompt], index: usize) -> SegmentPrompt {
    let mut prompt = prompts[index].clone();
    for (i, other) in prompts.iter().enumerate() {
        // What is known to be behind hides nothing.
        let behind = matches!((other.layer, prompt.layer), (Some(o), Some(p)) if o < p);
        let apart = other.bounds.intersection(&prompt.bounds).area() <= 0.0;
        if i != index && !behind && !apart {
            prompt.not.push(Exclusion { bounds: other.bounds, outline: other.outline.clone() });
        }
    }
    prompt
}

/// Divides the overlaps: by layer where both have one, else by the evidence, else to the smaller.
pub(super) fn share_out(size: ImageSize, prompts: &[SegmentPrompt], mut cuts: Vec<Option<CutOut>>) -> Vec<Segmented> {
    let areas: Vec<usize> = cuts.iter().map(|c| c.as_ref().map_or(0, |c| c.mask.count())).collect();
    for a in 0..cuts.len() {
        for b in a + 1..cuts.len() {
            let (head, tail) = cuts.split_at_mut(b);
            let (Some(first), Some(second)) = (head[a].as_mut(), tail[0].as_mut()) else { continue };
            divide(first, second, (prompts[a].layer, prompts[b].layer), (areas[a], areas[b]));
        }
    }
    cuts.into_iter()
        .map(|cut| match cut {
            Some(cut) => Segmented { mask: cut.mask, score: cut.score },
            None => Segmented { mask: Mask::empty(size), score: 0.0 },
        })
        .collect()
}

fn divide(first: &mut CutOut, second: &mut CutOut, layers: (Option<i32>, Option<i32>), areas: (usize, usize)) {
    let overlap = first.mask.and(&second.mask);
    if overlap.count() == 0 {
        return;
    }
    let smaller_is_first = areas.0 <= areas.1;
    let (w, h) = (overlap.size().width as usize, overlap.size().height as usize);
    let (labels, counts) = harmony_scene::components(overlap.bits(), w, h);
    // Sum of the first's log odds less the second's, in each connected part.
    let mut sums = vec![0.0_f64; counts.len()];
    for (i, id) in labels.iter().enumerate() {
        if *id > 0 {
            let (x, y) = ((i % w) as f64 + 0.5, (i / w) as f64 + 0.5);
            sums[*id as usize] += f64::from(first.odds_at(x, y) - second.odds_at(x, y));
        }
    }
    let to_first: Vec<bool> = sums
        .iter()
        .zip(&counts)
        .map(|(sum, n)| match layers {
            (Some(a), Some(b)) if a != b => a > b,
            _ => {
                let mean = (sum / (*n).max(1) as f64) as f32;
                // A part that is most of the smaller object can't be taken from it.
                let most = n * 2 > areas.0.min(areas.1);
                if most || mean.abs() < CLEAR_ODDS { smaller_is_first } else { mean > 0.0 }
            }
        })
        .collect();
    for (i, id) in labels.iter().enumerate() {
        if *id > 0 {
            let loser = if to_first[*id as usize] { &mut second.mask } else { &mut first.mask };
            loser.bits_mut()[i] = false;
        }
    }
}

impl CutOut {
    /// Log odds at a position in photo pixels.
    fn odds_at(&self, x: f64, y: f64) -> f32 {
        let [x, y] = self.frame.to_work([x, y]);
        self.frame.sample(&self.odds, x, y)
    }
}
