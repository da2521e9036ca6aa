//! Duplicate and spurious detections (paper App. C, "Containment and fragment removal"; key `detect.filter`).
//! Pure functions.

use harmony_catalogue::{Kind, Trait};
use harmony_imaging::polygon::filled;
use harmony_roles::Detection;
use harmony_scene::{ImageSize, Mask, PixelBox};

use crate::FilterSettings;

/// Why a detection was dropped.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Dropped {
    /// Its label.
    pub label: String,
    /// Its box, pixels.
    #[serde(rename = "box")]
    pub bounds: PixelBox,
    /// Why.
    #[serde(serialize_with = "in_words")]
    pub reason: Filtered,
}

fn in_words<S: serde::Serializer>(reason: &Filtered, to: S) -> Result<S::Ok, S::Error> {
    to.collect_str(reason)
}

/// Why a filter takes a detection out.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Filtered {
    /// Its box goes around several that were found singly.
    #[error("a group box around {members} {label}s found singly")]
    Group {
        /// How many.
        members: usize,
        /// Of what.
        label: String,
    },
    /// Another box of its label covers it.
    #[error("covered by another {0}")]
    Covered(String),
    /// There are more than a level can have.
    #[error("more than {0} candidates")]
    TooMany(usize),
    /// Its mask is nearly empty.
    #[error("the mask of {label} has {pixels} pixels, at least {least:.0} are needed")]
    TooSmall {
        /// Its label.
        label: String,
        /// Pixels of its mask.
        pixels: usize,
        /// Pixels that a mask must have.
        least: f64,
    },
    /// Another detection has its pixels, by another name.
    #[error("the {0} by another name")]
    OtherName(String),
    /// Another detection of its label has its pixels.
    #[error("the same {0} twice")]
    Twice(String),
    /// Its pixels are a part of another one of its label.
    #[error("a fragment of another {0}")]
    Fragment(String),
}

/// The order of belief: score first (a missing score counts as middling), larger area first among equals.
fn belief(d: &Detection) -> (f64, f64) {
    (d.score.unwrap_or(0.5), d.bounds.area())
}

/// What a detection takes of the photo: its outline filled, where it has one, and its box.
struct Region {
    bounds: PixelBox,
    filled: Option<Mask>,
}

impl Region {
    /// `size`: that of the photo that the detection is of. An outline around no pixel is none.
    fn of(detection: &Detection, size: ImageSize) -> Self {
        let filled = detection.outline.as_ref().map(|outline| filled(outline, size)).filter(|mask| mask.count() > 0);
        Self { bounds: detection.bounds, filled }
    }

    /// Areas of this one, the other one and both, pixels: of the outlines where both have one, of the boxes otherwise.
    fn areas(&self, other: &Self) -> [f64; 3] {
        if let (Some(own), Some(others)) = (&self.filled, &other.filled) {
            return [own.count(), others.count(), own.and(others).count()].map(|n| n as f64);
        }
        let both = self.bounds.intersection(&other.bounds);
        [self.bounds, other.bounds, both].map(|bounds| bounds.area())
    }

    /// Share of this one that the other one covers.
    fn covered_by(&self, other: &Self) -> f64 {
        let [own, _, both] = self.areas(other);
        if own > 0.0 { both / own } else { 0.0 }
    }

    /// Intersection over union.
    fn iou(&self, other: &Self) -> f64 {
        let [own, others, both] = self.areas(other);
        let union = own + others - both;
        if union > 0.0 { both / union } else { 0.0 }
    }
}

/// Words that make a label one of several things together.
const GROUP_WORDS: [&str; 7] = ["gallery", "set", "group", "collection", "arrangement", "cluster", "row"];

/// Share of a group's area that each of its members has less than: what is about as large is the same thing twice.
const MEMBER: f64 = 0.7;

/// IoU below which two members of a group are two things.
const APART: f64 = 0.3;

/// Whether a detection may be one of the several things that another one shows: it has its label, or the other's label
/// speaks of several (`gallery wall`) and names no other kind.
fn may_be_member(label: &str, group: &str) -> bool {
    let of_several = || harmony_catalogue::words(group).iter().any(|word| GROUP_WORDS.contains(&word.as_str()));
    let no_other = || harmony_catalogue::kind(group).is_none_or(|kind| is_kind(label, kind));
    label == group || (of_several() && no_other())
}

fn is_kind(label: &str, kind: &Kind) -> bool {
    harmony_catalogue::kind(label).is_some_and(|own| own.name == kind.name)
}

/// Whether two labels name one kind of thing.
pub fn one_kind(a: &str, b: &str) -> bool {
    a == b || harmony_catalogue::kind(a).is_some_and(|kind| is_kind(b, kind))
}

/// Drops boxes that another of equal or higher confidence covers, and group boxes whose members were found singly.
///
/// Where two detections have outlines, the filled outlines decide and not the boxes: that of a string of lights holds half of
/// what hangs on its wall. `size` is that of the photo.
///
/// # Reading of the paper
/// "Another box of equal or higher confidence covers most of its area" reads as if labels did not matter. Here only boxes of
/// one label compete. What is seen of one level lies before one another: a coffee table's box in its sofa's, a chair's in the
/// table's that it is pushed under, a blind's in its window's; all of them would go. Two names for one thing are found by
/// their masks ([`filter_masks`]). A group's box gives way to members of other labels too, when its label speaks of several.
pub fn filter_boxes(
    detections: Vec<Detection>,
    size: ImageSize,
    settings: &FilterSettings,
) -> (Vec<Detection>, Vec<Dropped>) {
    let mut dropped = Vec::new();
    let mut keep = vec![true; detections.len()];
    let regions: Vec<Region> = detections.iter().map(|d| Region::of(d, size)).collect();
    // What holds two or more others, which do not hold one another, shows them together.
    for (i, group) in detections.iter().enumerate() {
        let is_within = |j: &usize| {
            let [own, whole, both] = regions[*j].areas(&regions[i]);
            both >= settings.box_containment * own && own < MEMBER * whole
        };
        let may_be = |j: &usize| *j != i && may_be_member(&detections[*j].label, &group.label);
        let members: Vec<usize> = (0..detections.len()).filter(|j| may_be(j) && is_within(j)).collect();
        let two = |a: usize, b: usize| {
            one_kind(&detections[a].label, &detections[b].label) && regions[a].iou(&regions[b]) < APART
        };
        let apart = |a: &usize| members.iter().find(|b| *a < **b && two(*a, **b));
        if let Some(first) = members.iter().find(|a| apart(a).is_some()) {
            keep[i] = false;
            let label = detections[*first].label.clone();
            dropped.push(drop(group, Filtered::Group { members: members.len(), label }));
        }
    }
    for i in 0..detections.len() {
        for j in 0..detections.len() {
            if i == j || !keep[i] || !keep[j] || detections[i].label != detections[j].label {
                continue;
            }
            let (a, b) = (&detections[i], &detections[j]);
            let stronger = belief(b) > belief(a) || (belief(b) == belief(a) && j < i);
            let enough = b.score.unwrap_or(0.5) >= a.score.unwrap_or(0.5);
            if stronger && enough && regions[i].covered_by(&regions[j]) >= settings.box_containment {
                keep[i] = false;
                dropped.push(drop(a, Filtered::Covered(b.label.clone())));
            }
        }
    }
    let mut kept: Vec<Detection> = detections.into_iter().zip(&keep).filter(|(_, k)| **k).map(|(d, _)| d).collect();
    if kept.len() > settings.max_candidates {
        kept.sort_by(|a, b| belief(b).partial_cmp(&belief(a)).unwrap_or(std::cmp::Ordering::Equal));
        for extra in kept.split_off(settings.max_candidates) {
            dropped.push(drop(&extra, Filtered::TooMany(settings.max_candidates)));
        }
    }
    (kept, dropped)
}

fn drop(d: &Detection, reason: Filtered) -> Dropped {
    Dropped { label: d.label.clone(), bounds: d.bounds, reason }
}

/// Share of a mask that must be in another one to be the same pixels, and of a box to be within another.
const WITHIN: f64 = 0.8;

/// Share of a mask from which on it is all in another one.
const SAME: f64 = 0.9;

/// How far a mask may reach beyond the box that it was asked for, share of the box, and how much of it, before it is cut.
const BEYOND_BOX: f64 = 0.15;
const MAX_BEYOND: f64 = 0.1;

/// Raggedness of masks, one of so many parts of the image's width.
const RIM: u32 = 200;

/// Cuts off what a segmenter added far outside of the box that it was asked for; returns the labels.
pub fn cut_to_boxes(found: &mut [(Detection, Mask)]) -> Vec<String> {
    let mut cut = Vec::new();
    for (detection, mask) in found.iter_mut().filter(|(d, _)| d.outline.is_none()) {
        let b = detection.bounds.padded(BEYOND_BOX, mask.size());
        let own = Mask::from_fn(mask.size(), |x, y| {
            let (u, v) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
            mask.get(i64::from(x), i64::from(y)) && (b.x0..=b.x1).contains(&u) && (b.y0..=b.y1).contains(&v)
        });
        let (left, all) = (own.count() as f64, mask.count() as f64);
        if left > 0.0 && left < (1.0 - MAX_BEYOND) * all {
            *mask = own;
            cut.push(detection.label.clone());
        }
    }
    cut
}

/// Takes from each mask what a segmenter added of a neighbour: a mask of another detection that is nearly all in it,
/// though the other's box is not in its box. Returns the labels of who lost what to whom.
pub fn part_merged(found: &mut [(Detection, Mask)]) -> Vec<[String; 2]> {
    let mut parted = Vec::new();
    let taken: Vec<Vec<usize>> = found
        .iter()
        .enumerate()
        .map(|(i, (own, mask))| {
            let reach = mask.bounds();
            let merged = |(j, (other, others)): (usize, &(Detection, Mask))| {
                // The boxes tell of most pairs, without a look at every pixel.
                let beside = i != j && other.bounds.covered_by(&own.bounds) < WITHIN;
                let met = reach?.intersection(&others.bounds()?).area() > 0.0;
                if !beside || !met {
                    return None;
                }
                let shared = mask.and(others).count() as f64;
                (shared >= WITHIN * others.count() as f64 && shared < SAME * mask.count() as f64).then_some(j)
            };
            found.iter().enumerate().filter_map(merged).collect()
        })
        .collect();
    let masks: Vec<Mask> = found.iter().map(|(_, mask)| mask.clone()).collect();
    for (i, others) in taken.into_iter().enumerate() {
        for j in others {
            // The two outlines of the neighbour differ by their raggedness.
            let rim = i32::try_from(masks[j].size().width / RIM).unwrap_or(i32::MAX);
            found[i].1 = found[i].1.minus(&masks[j].dilated(rim.max(2)));
            parted.push([found[i].0.label.clone(), found[j].0.label.clone()]);
        }
    }
    parted
}

/// Which masks to keep: `None` = kept, `Some(reason)` = dropped.
///
/// Masks of one type with high IoU or near-full containment collapse onto the one of higher confidence.
pub fn filter_masks(found: &[(Detection, Mask)], settings: &FilterSettings) -> Vec<Option<Filtered>> {
    let mut verdict: Vec<Option<Filtered>> = vec![None; found.len()];
    let areas: Vec<usize> = found.iter().map(|(_, m)| m.count()).collect();
    for (i, (detection, mask)) in found.iter().enumerate() {
        let least = (settings.min_area * mask.size().pixels() as f64).max(4.0);
        if (areas[i] as f64) < least {
            verdict[i] = Some(Filtered::TooSmall { label: detection.label.clone(), pixels: areas[i], least });
        }
    }
    for i in 0..found.len() {
        for j in 0..found.len() {
            if i == j || verdict[i].is_some() || verdict[j].is_some() {
                continue;
            }
            let one_kind = found[i].0.label == found[j].0.label;
            let stronger = (belief(&found[j].0).0, areas[j], j) > (belief(&found[i].0).0, areas[i], i);
            if !stronger {
                continue;
            }
            let shared = found[i].1.and(&found[j].1).count() as f64;
            let union = (areas[i] + areas[j]) as f64 - shared;
            if !one_kind {
                // Two names for one thing: nothing else on one level covers the same pixels.
                if shared / union >= settings.same_object_iou {
                    verdict[i] = Some(Filtered::OtherName(found[j].0.label.clone()));
                }
                continue;
            }
            if shared / union >= settings.mask_iou {
                verdict[i] = Some(Filtered::Twice(found[i].0.label.clone()));
            } else if shared / areas[i] as f64 >= settings.mask_containment {
                verdict[i] = Some(Filtered::Fragment(found[i].0.label.clone()));
            }
        }
    }
    verdict
}

/// Share of its outline that an opening's mask has at least, where nothing hangs before it; and share of the outline that
/// what hangs before it takes.
const SHOWS: f64 = 0.5;
const VEILED: f64 = 0.4;

/// Gives windows and doors the whole of their outline (or box) where a curtain took it: who named both saw the one
/// through the other. Returns their labels.
pub fn unveil(found: &mut [(Detection, Mask)]) -> Vec<String> {
    let hangs: Vec<Mask> = found
        .iter()
        .filter(|(d, _)| {
            harmony_catalogue::has(&d.label, Trait::Hangs) && harmony_catalogue::opening(&d.label).is_none()
        })
        .map(|(_, mask)| mask.clone())
        .collect();
    let mut unveiled = Vec::new();
    for (detection, mask) in found.iter_mut().filter(|(d, _)| harmony_catalogue::opening(&d.label).is_some()) {
        let PixelBox { x0, y0, x1, y1 } = detection.bounds;
        let corners = detection.outline.clone().unwrap_or_else(|| vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]]);
        let whole = filled(&corners, mask.size());
        let area = whole.count() as f64;
        let veiled = hangs.iter().any(|h| h.and(&whole).count() as f64 >= VEILED * area);
        if veiled && (mask.count() as f64) < SHOWS * area {
            *mask = whole;
            unveiled.push(detection.label.clone());
        }
    }
    unveiled
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of the photo that the boxes below are in.
    const PHOTO: ImageSize = ImageSize { width: 120, height: 120 };

    fn detection(label: &str, b: [f64; 4], score: Option<f64>) -> Detection {
        Detection {
            label: label.into(),
            phrase: label.into(),
            bounds: PixelBox { x0: b[0], y0: b[1], x1: b[2], y1: b[3] },
            score,
            outline: None,
        }
    }

    #[test]
    fn a_mask_that_swallowed_its_neighbour_gives_it_back_and_one_with_a_part_of_itself_does_not() {
        let size = ImageSize { width: 100, height: 50 };
        let rows = |x0: u32, x1: u32| Mask::from_fn(size, |x, y| (x0..x1).contains(&x) && (10..40).contains(&y));
        let cupboard = |x0: f64, x1: f64| detection("cupboard", [x0, 10.0, x1, 40.0], None);
        let mut found = vec![(cupboard(10.0, 50.0), rows(10, 70)), (cupboard(50.0, 70.0), rows(50, 70))];
        assert_eq!(part_merged(&mut found).len(), 1);
        assert_eq!(found[0].1, rows(10, 48), "and the rim");
        assert_eq!(found[1].1, rows(50, 70));
        assert!(filter_masks(&found, &FilterSettings::default()).iter().all(Option::is_none));
        // A door of the cupboard is in its box.
        let whole = vec![(cupboard(10.0, 70.0), rows(10, 70)), (cupboard(50.0, 70.0), rows(50, 70))];
        let mut found = whole.clone();
        assert!(part_merged(&mut found).is_empty());
        assert_eq!(found[0].1, whole[0].1);
        // Both masks show both: nobody knows whose is what, but that it is in the boxes.
        let mut found = vec![(cupboard(10.0, 50.0), rows(10, 70)), (cupboard(50.0, 70.0), rows(10, 70))];
        assert!(part_merged(&mut found).is_empty());
        assert_eq!(cut_to_boxes(&mut found).len(), 2);
        assert!(found[0].1.bounds().unwrap().x1 <= 56.0 && found[1].1.bounds().unwrap().x0 >= 47.0);
        assert!(cut_to_boxes(&mut found).is_empty());
    }

    #[test]
    fn a_window_is_seen_through_its_curtain_and_one_beside_a_curtain_keeps_its_mask() {
        let size = ImageSize::new(100, 50);
        let rows = |x0: u32, x1: u32| Mask::from_fn(size, |x, y| (x0..x1).contains(&x) && (10..40).contains(&y));
        let window = detection("window", [20.0, 12.0, 60.0, 38.0], None);
        let mut found = vec![
            (detection("sheer curtain", [10.0, 10.0, 70.0, 40.0], None), rows(10, 70)),
            (window, Mask::empty(size)),
        ];
        assert_eq!(unveil(&mut found), ["window"]);
        assert_eq!(found[1].1.bounds().unwrap(), PixelBox { x0: 20.0, y0: 12.0, x1: 60.0, y1: 38.0 });
        assert_eq!(found[0].1, rows(10, 70), "the curtain keeps its own");
        assert!(unveil(&mut found).is_empty());
        let mut beside = vec![
            (detection("curtain", [60.0, 10.0, 70.0, 40.0], None), rows(60, 70)),
            (detection("window", [20.0, 12.0, 60.0, 38.0], None), rows(20, 30)),
        ];
        assert!(unveil(&mut beside).is_empty());
    }

    #[test]
    fn a_gallery_wall_box_gives_way_to_its_frames() {
        let all = vec![
            detection("painting", [0.0, 0.0, 100.0, 100.0], Some(0.9)),
            detection("painting", [5.0, 5.0, 40.0, 40.0], Some(0.6)),
            detection("painting", [60.0, 5.0, 95.0, 40.0], Some(0.6)),
        ];
        let (kept, dropped) = filter_boxes(all, PHOTO, &FilterSettings::default());
        assert_eq!(kept.len(), 2);
        assert!(kept.iter().all(|d| d.bounds.area() < 2000.0));
        assert_eq!(dropped.len(), 1);
    }

    #[test]
    fn a_gallery_wall_gives_way_to_frames_of_other_labels_and_a_board_keeps_what_is_pinned_to_it() {
        let within = |group: &str, labels: [&str; 2]| {
            let all = vec![
                detection(group, [0.0, 0.0, 100.0, 100.0], Some(0.9)),
                detection(labels[0], [5.0, 5.0, 40.0, 40.0], Some(0.6)),
                detection(labels[1], [60.0, 5.0, 95.0, 40.0], Some(0.6)),
            ];
            filter_boxes(all, PHOTO, &FilterSettings::default()).0.len()
        };
        assert_eq!(within("gallery wall", ["painting", "framed photo"]), 2);
        assert_eq!(within("set of pictures", ["painting", "painting"]), 2);
        assert_eq!(within("gallery wall", ["painting", "clock"]), 3, "two of no one kind");
        assert_eq!(within("bulletin board", ["photograph", "photograph"]), 3);
        assert_eq!(within("set of shelves", ["vase", "vase"]), 3);
        assert_eq!(within("window", ["curtain", "curtain"]), 3);
    }

    #[test]
    fn outlines_decide_where_there_are_some_and_boxes_otherwise() {
        // A string of lights along two edges of its box; two more of its kind hang within the box.
        let string = vec![[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [97.0, 100.0], [97.0, 3.0], [0.0, 3.0]];
        let square = |x0: f64| vec![[x0, 40.0], [x0 + 20.0, 40.0], [x0 + 20.0, 60.0], [x0, 60.0]];
        let at = |bounds, outline| Detection { outline, ..detection("string lights", bounds, None) };
        let all = |traced: bool| {
            vec![
                at([0.0, 0.0, 100.0, 100.0], traced.then(|| string.clone())),
                at([10.0, 40.0, 30.0, 60.0], traced.then(|| square(10.0))),
                at([60.0, 40.0, 80.0, 60.0], traced.then(|| square(60.0))),
            ]
        };
        let kept = |all: Vec<Detection>| filter_boxes(all, PHOTO, &FilterSettings::default()).0.len();
        assert_eq!(kept(all(true)), 3);
        assert_eq!(kept(all(false)), 2, "by boxes it is a group");
        assert_eq!(kept(all(true)[..2].to_vec()), 2);
        assert_eq!(kept(all(false)[..2].to_vec()), 1, "by boxes it is covered");
        // An outline that holds another one covers it.
        let whole = vec![[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]];
        assert_eq!(kept(vec![at([0.0, 0.0, 100.0, 100.0], Some(whole)), all(true).swap_remove(1)]), 1);
    }

    #[test]
    fn a_contained_box_of_the_same_label_goes_but_not_of_another() {
        let all = vec![
            detection("sofa", [0.0, 0.0, 100.0, 50.0], None),
            detection("sofa", [10.0, 10.0, 60.0, 40.0], None),
            detection("cushion", [20.0, 10.0, 30.0, 20.0], None),
        ];
        let (kept, dropped) = filter_boxes(all, PHOTO, &FilterSettings::default());
        assert_eq!(kept.iter().map(|d| d.label.as_str()).collect::<Vec<_>>(), ["sofa", "cushion"]);
        assert_eq!(dropped.len(), 1);
    }

    #[test]
    fn of_two_equal_masks_the_surer_stays() {
        let size = ImageSize::new(20, 20);
        let square = |x0: u32, x1: u32| Mask::from_fn(size, |x, y| (x0..x1).contains(&x) && y < 10);
        let found = vec![
            (detection("chair", [0.0, 0.0, 10.0, 10.0], Some(0.4)), square(0, 10)),
            (detection("chair", [0.0, 0.0, 10.0, 10.0], Some(0.8)), square(0, 10)),
            (detection("chair", [12.0, 0.0, 20.0, 10.0], Some(0.2)), square(12, 20)),
        ];
        let verdict = filter_masks(&found, &FilterSettings::default());
        assert!(verdict[0].is_some() && verdict[1].is_none() && verdict[2].is_none());
    }
}
