//! From a logit for every patch and phrase to detections.
//!
//! Scores of an open-vocabulary network are comparable between boxes of one phrase, less so between phrases: a rare
//! phrase gets low scores everywhere. So the threshold for being sure is high, and a phrase that somebody counted
//! instances of may fill up to that count with its own best boxes from well below.

use harmony_scene::PixelBox;

/// How boxes are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChoiceSettings {
    /// Probability from which a box is taken whatever was counted.
    pub sure: f64,
    /// Probability from which a box may fill up to the count.
    pub least: f64,
    /// Two boxes of one label that overlap more than this (intersection over union) are one object.
    pub same_label_iou: f64,
    /// The same for boxes of different labels, where a label fills up to its count.
    pub other_label_iou: f64,
    /// Most boxes a label.
    pub most: usize,
}

impl Default for ChoiceSettings {
    /// Thresholds within what upstream's demos use for the ensemble checkpoints (0.1 to 0.3). Not tuned on real weights.
    fn default() -> Self {
        Self { sure: 0.25, least: 0.1, same_label_iou: 0.6, other_label_iou: 0.6, most: 100 }
    }
}

/// A box of a label.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Index of the label.
    pub label: usize,
    /// Box in pixels.
    pub bounds: PixelBox,
    /// Probability.
    pub score: f64,
}

/// Chooses boxes. `scores` has a row a box and a column a label; `counts` says how many of each label are expected
/// (0 = not counted). Labels keep their order, best boxes first within one.
///
/// 1. Every box speaks for the label that fits it best. Those at least `sure` are taken, best first, unless they overlap
///    one of their label that was taken before.
/// 2. A label short of its count takes its best boxes of at least `least`, unless they overlap anything taken.
pub fn choose(boxes: &[PixelBox], scores: &[Vec<f64>], counts: &[usize], settings: &ChoiceSettings) -> Vec<Candidate> {
    let order = |candidates: &mut Vec<(usize, Candidate)>| {
        // Ties by the index of the box, so that the same input gives the same answer.
        candidates.sort_by(|(i, a), (j, b)| b.score.total_cmp(&a.score).then(i.cmp(j)));
    };
    let usable = |i: usize| boxes[i].area() > 0.0;
    let mut taken: Vec<Candidate> = Vec::new();
    let count_of = |taken: &[Candidate], label: usize| taken.iter().filter(|t| t.label == label).count();

    let mut sure: Vec<(usize, Candidate)> = Vec::new();
    for (i, row) in scores.iter().enumerate().filter(|(i, _)| usable(*i)) {
        let best = row.iter().enumerate().max_by(|(i, a), (j, b)| a.total_cmp(b).then(j.cmp(i)));
        if let Some((label, score)) = best.filter(|(_, score)| **score >= settings.sure) {
            sure.push((i, Candidate { label, bounds: boxes[i], score: *score }));
        }
    }
    order(&mut sure);
    for (_, c) in sure {
        let same = |t: &Candidate| t.label == c.label && t.bounds.iou(&c.bounds) > settings.same_label_iou;
        if count_of(&taken, c.label) < settings.most && !taken.iter().any(same) {
            taken.push(c);
        }
    }

    let mut fill: Vec<(usize, Candidate)> = Vec::new();
    for (label, wanted) in counts.iter().enumerate() {
        if count_of(&taken, label) < *wanted {
            let fits = |(i, row): (usize, &Vec<f64>)| {
                let score = *row.get(label)?;
                let candidate = Candidate { label, bounds: boxes[i], score };
                (usable(i) && score >= settings.least).then_some((i, candidate))
            };
            fill.extend(scores.iter().enumerate().filter_map(fits));
        }
    }
    order(&mut fill);
    for (_, c) in fill {
        let overlaps = |t: &Candidate| {
            let limit = if t.label == c.label { settings.same_label_iou } else { settings.other_label_iou };
            t.bounds.iou(&c.bounds) > limit
        };
        let wanted = counts[c.label].min(settings.most);
        if count_of(&taken, c.label) < wanted && !taken.iter().any(overlaps) {
            taken.push(c);
        }
    }
    // Stable: best first stays within a label.
    taken.sort_by(|a, b| a.label.cmp(&b.label).then(b.score.total_cmp(&a.score)));
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> PixelBox {
        PixelBox { x0: x, y0: 0.0, x1: x + 10.0, y1: 10.0 }
    }

    fn labels(found: &[Candidate]) -> Vec<(usize, f64)> {
        found.iter().map(|c| (c.label, c.bounds.x0)).collect()
    }

    #[test]
    fn sure_boxes_are_taken_once_by_the_label_that_fits_best() {
        let boxes = [at(0.0), at(1.0), at(50.0), at(80.0)];
        let scores = vec![vec![0.6, 0.5], vec![0.7, 0.1], vec![0.3, 0.4], vec![0.2, 0.1]];
        let found = choose(&boxes, &scores, &[0, 0], &ChoiceSettings::default());
        // Box 0 repeats box 1; box 3 is not sure and nobody counted.
        assert_eq!(labels(&found), [(0, 1.0), (1, 50.0)]);
    }

    #[test]
    fn a_label_fills_up_to_its_count_and_not_beyond() {
        let boxes = [at(0.0), at(20.0), at(40.0), at(60.0), at(80.0)];
        let scores = vec![vec![0.9], vec![0.2], vec![0.15], vec![0.12], vec![0.05]];
        let found = choose(&boxes, &scores, &[3], &ChoiceSettings::default());
        assert_eq!(labels(&found), [(0, 0.0), (0, 20.0), (0, 40.0)]);
        // What was not counted stays at the sure ones; what is hardly there is never taken.
        assert_eq!(choose(&boxes, &scores, &[0], &ChoiceSettings::default()).len(), 1);
        assert_eq!(choose(&boxes, &scores, &[9], &ChoiceSettings::default()).len(), 4);
    }

    #[test]
    fn a_label_that_fills_up_does_not_take_the_object_of_another() {
        let boxes = [at(0.0), at(1.0), at(40.0)];
        let scores = vec![vec![0.8, 0.2], vec![0.1, 0.24], vec![0.0, 0.13]];
        let found = choose(&boxes, &scores, &[1, 1], &ChoiceSettings::default());
        assert_eq!(labels(&found), [(0, 0.0), (1, 40.0)]);
    }

    #[test]
    fn empty_boxes_and_nonsense_scores_are_left_out() {
        let flat = PixelBox { x0: 5.0, y0: 5.0, x1: 5.0, y1: 9.0 };
        let found = choose(&[flat, at(0.0)], &[vec![0.9], vec![f64::NAN]], &[2], &ChoiceSettings::default());
        assert_eq!(found, []);
    }
}
