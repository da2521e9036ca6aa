//! OWLv2 against transformers on a small configuration: `tests/parity/owlv2.py` made the arrays.

#![cfg(all(feature = "detector", feature = "players"))]

use std::sync::Arc;

use crate::image_nets::{Seeded, array, arrays, close, data, photo, uniform};
use harmony_nets::clip::{TextConfig, Tokenizer, VisionConfig};
use harmony_nets::detector::{ChoiceSettings, DetectorSettings, Owlv2, Owlv2Config, Owlv2Detector, preprocess};
use harmony_nets::reference::Reference;
use harmony_nets::resample::Pixels;
use harmony_roles::{DetectRequest, Detector, PhraseRequest};
use harmony_scene::Level;

const LIMIT: f64 = 1e-5;

fn small(vocabulary: usize) -> Owlv2Config {
    Owlv2Config {
        vision: VisionConfig { width: 32, hidden: 128, layers: 2, heads: 2, image_size: 48, patch: 8 },
        text: TextConfig { width: 24, hidden: 96, layers: 2, heads: 3, vocabulary, positions: 16 },
    }
}

fn seeded() -> Seeded {
    Seeded { small: |key| key.contains("embedding") && !key.contains("patch"), ..Seeded::default() }
}

fn pixels(side: usize) -> Pixels {
    let planes = uniform("pixels0", 3 * side * side);
    let at = |i: usize| (0..3).map(move |c| c * side * side + i);
    let data = (0..side * side).flat_map(at).map(|i| planes[i] * 1.7).collect();
    Pixels { width: side, height: side, data }
}

#[test]
fn boxes_logits_and_phrases_agree() {
    let wanted = arrays("owlv2_small.safetensors");
    let net = Owlv2::load(Arc::new(Reference), &seeded(), small(60)).expect("loads");
    let image = net.encode_pixels(pixels(48)).expect("encodes");
    close("boxes", image.boxes.as_flattened(), &array(&wanted, "boxes"), LIMIT);
    // Ids are padded with zeros behind the end mark.
    let ids = array(&wanted, "ids");
    let row = |row: &[f32]| row.iter().take_while(|id| **id > 0.0).map(|id| *id as u32).collect::<Vec<_>>();
    let ids: Vec<Vec<u32>> = ids.chunks_exact(16).map(row).collect();
    let phrases = net.embed_text(&ids).expect("embeds");
    close("phrases", &phrases.concat(), &array(&wanted, "text_embeds"), LIMIT);
    let logits = net.logits(&image, &phrases).expect("compares");
    close("logits", &logits.concat(), &array(&wanted, "logits"), LIMIT);
    assert_eq!(net.logits(&image, &[]).expect("nothing asked").len(), 36);
}

#[test]
fn photos_are_filled_up_blurred_and_resized_as_by_transformers() {
    let wanted = arrays("owlv2_preprocess.safetensors");
    for (name, (w, h)) in [("wide", (97, 61)), ("tall", (40, 93)), ("grow", (21, 13)), ("slight", (35, 30))] {
        close(name, &preprocess(&photo(w, h), 32).data, &array(&wanted, name), 2e-6);
    }
}

fn player(choice: ChoiceSettings) -> Owlv2Detector<Reference> {
    let tokenizer = Tokenizer::open(&data("clip_tokens")).expect("the committed vocabulary");
    let net = Owlv2::load(Arc::new(Reference), &seeded(), small(555)).expect("loads");
    Owlv2Detector::new(net, tokenizer, DetectorSettings { choice, ..DetectorSettings::default() }, "small, seeded")
}

fn request(phrases: &[(&str, &str, usize)]) -> DetectRequest {
    let phrase = |(label, phrase, count): &(&str, &str, usize)| PhraseRequest {
        label: (*label).to_owned(),
        phrase: (*phrase).to_owned(),
        count: *count,
    };
    DetectRequest {
        name: "test".to_owned(),
        image: Arc::new(photo(96, 64)),
        level: Level::Furniture,
        phrases: phrases.iter().map(phrase).collect(),
    }
}

#[tokio::test]
async fn the_player_answers_in_pixels_best_first_and_no_more_than_is_asked() {
    let all = ChoiceSettings { sure: 0.0, least: 0.0, same_label_iou: 0.5, ..ChoiceSettings::default() };
    let asked = request(&[("chair", "chair . armchair", 0), ("lamp", "floor lamp", 0)]);
    let found = player(all).detect(&asked).await.expect("detects").detections;
    assert!(!found.is_empty());
    for d in &found {
        assert!(d.bounds.x0 >= 0.0 && d.bounds.x1 <= 96.0 && d.bounds.y0 >= 0.0 && d.bounds.y1 <= 64.0, "{d:?}");
        assert!(d.bounds.area() > 0.0);
        assert!((0.0..=1.0).contains(&d.score.expect("a score")));
        assert_eq!(d.phrase, if d.label == "chair" { "chair . armchair" } else { "floor lamp" });
    }
    for pair in found.windows(2).filter(|p| p[0].label == p[1].label) {
        assert!(pair[0].score >= pair[1].score);
        assert!(pair[0].bounds.iou(&pair[1].bounds) <= 0.5);
    }
    // Nobody is sure of anything, but one lamp was counted.
    let unsure = ChoiceSettings { sure: 1.1, least: 0.0, ..ChoiceSettings::default() };
    let asked = request(&[("chair", "chair", 0), ("lamp", "floor lamp", 1)]);
    let found = player(unsure).detect(&asked).await.expect("detects").detections;
    assert_eq!(found.iter().map(|d| d.label.as_str()).collect::<Vec<_>>(), ["lamp"]);
    // Nothing asked, nothing found.
    assert!(player(all).detect(&request(&[])).await.expect("detects").detections.is_empty());
}

#[tokio::test]
async fn a_phrase_gets_the_same_boxes_whatever_is_asked_beside_it_when_nothing_competes() {
    let fill = ChoiceSettings { sure: 1.1, least: 0.0, ..ChoiceSettings::default() };
    let player = player(fill);
    let alone = player.detect(&request(&[("lamp", "floor lamp", 3)])).await.expect("detects").detections;
    let beside = request(&[("lamp", "floor lamp", 3), ("nothing", "a tall sideboard of the chairs", 0)]);
    let beside = player.detect(&beside).await.expect("detects").detections;
    assert_eq!(alone.len(), beside.len());
    for (a, b) in alone.iter().zip(&beside) {
        assert!(a.bounds.iou(&b.bounds) > 0.9999);
        assert!((a.score.expect("a score") - b.score.expect("a score")).abs() <= 1e-6);
    }
}
