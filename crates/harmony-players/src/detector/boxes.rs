//! How models write boxes, and whose boxes they are.

use harmony_roles::{Detection, PhraseRequest};
use harmony_scene::{ImageSize, PixelBox};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Order and unit of a model's boxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoxStyle {
    /// `[left, top, right, bottom]`, 0 to 1000: Qwen3-VL, GLM-4.xV, LocateAnything, and whoever is asked for it.
    Thousandths,
    /// `[top, left, bottom, right]`, 0 to 1000: Gemini.
    ThousandthsTopFirst,
    /// `[left, top, right, bottom]` in pixels of the picture as the model sees it: Qwen2.5-VL.
    Pixels,
}

impl BoxStyle {
    /// The order, in words for a prompt.
    pub fn order(self) -> &'static str {
        match self {
            Self::ThousandthsTopFirst => "[top, left, bottom, right]",
            Self::Thousandths | Self::Pixels => "[left, top, right, bottom]",
        }
    }

    /// A box in pixels of an image; `seen` is the size of the picture that the model saw. Pairs the wrong way round are
    /// swapped, what lies outside is cut off; `None` = nothing is left, or it is not a number.
    pub fn to_pixels(self, numbers: [f64; 4], seen: ImageSize, image: ImageSize) -> Option<PixelBox> {
        if !numbers.iter().all(|v| v.is_finite()) {
            return None;
        }
        let [x0, y0, x1, y1] = match self {
            Self::ThousandthsTopFirst => [numbers[1], numbers[0], numbers[3], numbers[2]],
            Self::Thousandths | Self::Pixels => numbers,
        };
        let (across, down) = match self {
            Self::Thousandths | Self::ThousandthsTopFirst => (1000.0, 1000.0),
            Self::Pixels => (f64::from(seen.width), f64::from(seen.height)),
        };
        let x = |v: f64| v / across * f64::from(image.width);
        let y = |v: f64| v / down * f64::from(image.height);
        let bounds = PixelBox { x0: x(x0.min(x1)), y0: y(y0.min(y1)), x1: x(x0.max(x1)), y1: y(y0.max(y1)) };
        let bounds = bounds.clamped(image);
        (bounds.width() >= 1.0 && bounds.height() >= 1.0).then_some(bounds)
    }
}

/// The alternatives of a phrase: `sofa . couch` is two.
pub fn alternatives(phrase: &PhraseRequest) -> Vec<String> {
    let text = if phrase.phrase.trim().is_empty() { &phrase.label } else { &phrase.phrase };
    text.split('.').map(|part| part.trim().to_lowercase()).filter(|part| !part.is_empty()).collect()
}

/// The phrase that a model's label belongs to. Models repeat a phrase, an alternative, several of them run together,
/// or a part; what shares no word with any phrase belongs to none.
pub fn phrase_of<'a>(label: &str, phrases: &'a [PhraseRequest]) -> Option<&'a PhraseRequest> {
    let label = label.trim().to_lowercase();
    let exact = phrases.iter().find(|p| p.label.to_lowercase() == label || alternatives(p).contains(&label));
    if exact.is_some() {
        return exact;
    }
    if let ([only], true) = (phrases, label.is_empty()) {
        return Some(only);
    }
    let words = |text: &str| text.split(|c: char| !c.is_alphanumeric()).map(str::to_owned).collect::<Vec<_>>();
    let said = words(&label);
    let shared = |p: &PhraseRequest| {
        let best = alternatives(p).into_iter().chain([p.label.to_lowercase()]).map(|alternative| {
            let own = words(&alternative);
            let common = own.iter().filter(|word| !word.is_empty() && said.contains(word)).count();
            common as f64 / own.len().max(said.len()) as f64
        });
        best.fold(0.0, f64::max)
    };
    let mut best: Option<(f64, &PhraseRequest)> = None;
    for phrase in phrases {
        let score = shared(phrase);
        if score > 0.0 && best.is_none_or(|(other, _)| score > other) {
            best = Some((score, phrase));
        }
    }
    best.map(|(_, phrase)| phrase)
}

/// Best first within a label; of two boxes of one label that overlap by more than `iou`, the better (or first) stays.
pub fn ordered(mut found: Vec<Detection>, phrases: &[PhraseRequest], iou: f64) -> Vec<Detection> {
    let rank = |d: &Detection| phrases.iter().position(|p| p.label == d.label).unwrap_or(phrases.len());
    found.sort_by(|a, b| {
        let scores = b.score.unwrap_or(0.0).total_cmp(&a.score.unwrap_or(0.0));
        rank(a).cmp(&rank(b)).then(scores)
    });
    let mut kept: Vec<Detection> = Vec::new();
    for detection in found {
        let twice = kept.iter().any(|k| k.label == detection.label && k.bounds.iou(&detection.bounds) > iou);
        if !twice {
            kept.push(detection);
        }
    }
    kept
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A phrase.
    pub fn phrase(label: &str, phrase: &str) -> PhraseRequest {
        PhraseRequest { label: label.into(), phrase: phrase.into(), count: 1 }
    }

    #[test]
    fn each_style_gives_the_same_box() {
        let (image, seen) = (ImageSize::new(800, 600), ImageSize::new(560, 420));
        let want = PixelBox { x0: 200.0, y0: 60.0, x1: 400.0, y1: 300.0 };
        for (style, numbers) in [
            (BoxStyle::Thousandths, [250.0, 100.0, 500.0, 500.0]),
            (BoxStyle::ThousandthsTopFirst, [100.0, 250.0, 500.0, 500.0]),
            (BoxStyle::Pixels, [140.0, 42.0, 280.0, 210.0]),
            (BoxStyle::Thousandths, [500.0, 500.0, 250.0, 100.0]),
        ] {
            let got = style.to_pixels(numbers, seen, image).unwrap();
            for (a, b) in [(got.x0, want.x0), (got.y0, want.y0), (got.x1, want.x1), (got.y1, want.y1)] {
                assert!((a - b).abs() < 1e-9, "{style:?} {got:?}");
            }
        }
    }

    #[test]
    fn impossible_boxes_are_left_out_and_large_ones_cut() {
        let size = ImageSize::new(100, 100);
        let of = |numbers| BoxStyle::Thousandths.to_pixels(numbers, size, size);
        assert_eq!(of([10.0, 10.0, 10.0, 500.0]), None);
        assert_eq!(of([f64::NAN, 0.0, 1.0, 1.0]), None);
        assert_eq!(of([2000.0, 2000.0, 3000.0, 3000.0]), None);
        assert_eq!(of([-50.0, 0.0, 2000.0, 500.0]), Some(PixelBox { x0: 0.0, y0: 0.0, x1: 100.0, y1: 50.0 }));
    }

    #[test]
    fn labels_find_their_phrase() {
        let phrases = [
            phrase("sofa", "leather sofa . leather couch"),
            phrase("dining chair", "wooden chair"),
            phrase("lamp", ""),
        ];
        let of = |label: &str| phrase_of(label, &phrases).map(|p| p.label.as_str());
        assert_eq!(of("leather couch"), Some("sofa"));
        assert_eq!(of("Sofa "), Some("sofa"));
        assert_eq!(of("leather sofa leather couch"), Some("sofa"));
        assert_eq!(of("chair"), Some("dining chair"));
        assert_eq!(of("lamp"), Some("lamp"));
        assert_eq!(of("dog"), None);
        assert_eq!(of(""), None);
        assert_eq!(phrase_of("", &phrases[..1]).map(|p| p.label.as_str()), Some("sofa"));
    }

    #[test]
    fn the_better_of_two_boxes_stays() {
        let at = |x: f64, score| Detection {
            label: "sofa".into(),
            phrase: "sofa".into(),
            bounds: PixelBox { x0: x, y0: 0.0, x1: x + 100.0, y1: 50.0 },
            score,
            outline: None,
        };
        let phrases = [phrase("sofa", "sofa")];
        let kept = ordered(vec![at(0.0, Some(0.4)), at(5.0, Some(0.9)), at(200.0, Some(0.5))], &phrases, 0.7);
        assert_eq!(kept.iter().map(|d| d.score).collect::<Vec<_>>(), [Some(0.9), Some(0.5)]);
        assert_eq!(ordered(vec![at(0.0, None), at(3.0, None)], &phrases, 0.7)[0].bounds.x0, 0.0);
    }
}
