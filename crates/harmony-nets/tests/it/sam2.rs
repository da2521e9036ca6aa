//! SAM 2 against facebookresearch/sam2 on a small configuration: `tests/parity/sam2.py` made the arrays.

#![cfg(all(feature = "sam2", feature = "players"))]

use std::sync::Arc;

use crate::image_nets::{Seeded, array, arrays, close, photo, write_zeros};
use harmony_nets::backend::Backend;
use harmony_nets::reference::Reference;
use harmony_nets::sam2::{
    Encoded, Label, MaskPrediction, Masks, Prompt, Sam2, Sam2Config, Sam2Segmenter, Sam2Size, logits_at, preprocess,
};
use harmony_roles::{SegmentPrompt, SegmentRequest, Segmenter};
use harmony_scene::PixelBox;

/// Relative to the largest value; the reference backend sums in f64, PyTorch in f32.
const LIMIT: f64 = 2e-5;

fn small() -> Sam2Config {
    Sam2Config {
        image_size: 128,
        embed: 8,
        heads: 1,
        stages: [1, 2, 3, 2],
        global_blocks: vec![4],
        windows: [8, 4, 6, 3],
        background: 7,
        width: 32,
        hidden: 2048,
        iou_hidden: 256,
    }
}

/// As `special` of the script.
fn seeded() -> Seeded {
    Seeded {
        small: |key| {
            ["_token.weight", "mask_tokens.weight", "embed.weight"].iter().any(|end| key.ends_with(end))
                || ["pos_embed", "point_embeddings", "no_mem_embed", "gaussian"].iter().any(|part| key.contains(part))
        },
        gain: |key| {
            let end = key.ends_with("attn.proj.weight") || key.ends_with("mlp.layers.1.weight");
            if end && key.contains(".trunk.blocks.") { 0.2 } else { 1.0 }
        },
        about_one: |key| key.ends_with("pred_obj_score_head.layers.2.bias"),
        ..Seeded::default()
    }
}

fn network() -> Sam2<Reference> {
    Sam2::load(Arc::new(Reference), &seeded(), small()).expect("seeded weights load")
}

const BOX: [f64; 4] = [11.0, 7.5, 60.25, 40.0];
const POINTS: [([f64; 2], Label); 2] = [([20.0, 21.0], Label::Inside), ([70.5, 8.0], Label::Outside)];

fn prompts() -> [(&'static str, Prompt); 3] {
    let points = POINTS.to_vec();
    [
        ("box", Prompt::from_box(BOX)),
        ("points", Prompt { points: points.clone(), ..Prompt::default() }),
        ("both", Prompt { points, ..Prompt::from_box(BOX) }),
    ]
}

fn values(b: Reference, x: &<Reference as Backend>::Tensor) -> Vec<f32> {
    b.read(x).expect("readable")
}

/// Every fourth logit of every fourth row, as the script keeps them to save space.
fn thinned(masks: &[MaskPrediction]) -> Vec<f32> {
    let thin = |m: &MaskPrediction| {
        let side = m.logits.side;
        let at = move |y: usize| (0..side).step_by(4).map(move |x| y * side + x);
        (0..side).step_by(4).flat_map(at).map(|i| m.logits.values[i]).collect::<Vec<_>>()
    };
    masks.iter().flat_map(thin).collect()
}

#[test]
fn the_encoder_agrees_at_every_tap() {
    let wanted = arrays("sam2_small.safetensors");
    let net = network();
    let b = *net.backend();
    let stages = net.stages(preprocess(&photo(96, 64), 128)).expect("encodes");
    // Ends of stages 1, 3 and 4 are blocks 0, 5 and 7; the script keeps 0 and 7 of them.
    close("stage 1", &values(b, &stages[0]), &array(&wanted, "block0"), LIMIT);
    close("stage 4", &values(b, &stages[3]), &array(&wanted, "block7"), LIMIT);
    let encoded = net.encode(&photo(96, 64)).expect("encodes");
    close("image embedding", &values(b, &encoded.embedding), &array(&wanted, "image_embed"), LIMIT);
    close("fine features", &values(b, &encoded.fine), &array(&wanted, "high_res1"), LIMIT);
    close("finest features", &values(b, &encoded.finest), &array(&wanted, "high_res0"), LIMIT);
}

#[test]
fn masks_and_their_qualities_agree_for_boxes_points_and_both() {
    let wanted = arrays("sam2_small.safetensors");
    let net = network();
    let encoded = net.encode(&photo(96, 64)).expect("encodes");
    for (name, prompt) in prompts() {
        for (tag, masks, count) in [("best", Masks::Best, 1), ("multi", Masks::Three, 3)] {
            let found = net.predict(&encoded, std::slice::from_ref(&prompt), masks).expect("predicts").remove(0);
            assert_eq!(found.len(), count);
            let ious: Vec<f32> = found.iter().map(|m| m.iou).collect();
            close(&format!("{name}.{tag}.iou"), &ious, &array(&wanted, &format!("{name}.{tag}.iou")), LIMIT);
            let low = array(&wanted, &format!("{name}.{tag}.low"));
            let logits = if name == "box" {
                found.iter().flat_map(|m| m.logits.values.clone()).collect()
            } else {
                thinned(&found)
            };
            close(&format!("{name}.{tag}.low"), &logits, &low, LIMIT);
        }
    }
}

#[test]
fn full_resolution_logits_agree() {
    let wanted = arrays("sam2_small.safetensors");
    let net = network();
    let encoded = net.encode(&photo(96, 64)).expect("encodes");
    let best = net.predict(&encoded, &[Prompt::from_box(BOX)], Masks::Best).expect("predicts").remove(0).remove(0);
    close("masks", &logits_at(&best.logits, 96, 64), &array(&wanted, "box.best.masks"), LIMIT);
}

#[test]
fn all_four_masks_and_the_object_score_agree() {
    let wanted = arrays("sam2_small.safetensors");
    let net = network();
    let encoded = net.encode(&photo(96, 64)).expect("encodes");
    let raw = net.predict_raw(&encoded, &[Prompt::from_box(BOX)]).expect("predicts").remove(0);
    let logits: Vec<f32> = raw.masks.iter().flat_map(|m| m.logits.values.clone()).collect();
    close("masks", &logits, &array(&wanted, "all.masks"), LIMIT);
    close("object score", &[raw.object_score], &array(&wanted, "all.score"), LIMIT);
}

#[test]
fn a_mask_of_an_earlier_round_is_a_prompt() {
    let wanted = arrays("sam2_small.safetensors");
    let net = network();
    let encoded = net.encode(&photo(96, 64)).expect("encodes");
    // The script's last prediction before that: box and points, the first of three.
    let (_, both) = prompts()[2].clone();
    let first = net.predict(&encoded, &[both], Masks::Three).expect("predicts").remove(0).remove(0);
    let again = Prompt { mask: Some(first.logits.for_reuse()), ..Prompt::from_box(BOX) };
    let found = net.predict(&encoded, &[again], Masks::Best).expect("predicts").remove(0);
    close("refined iou", &[found[0].iou], &array(&wanted, "refined.iou"), LIMIT);
    close("refined mask", &found[0].logits.values, &array(&wanted, "refined.low"), LIMIT);
}

#[test]
fn prompts_together_get_what_each_gets_alone() {
    let net = network();
    let encoded = net.encode(&photo(96, 64)).expect("encodes");
    let boxes: Vec<Prompt> = (0..6)
        .map(|i| Prompt::from_box([f64::from(i) * 5.0, 3.0, 30.0 + f64::from(i) * 7.0, 50.0]))
        .chain([prompts()[1].1.clone()])
        .collect();
    let together = net.predict_raw(&encoded, &boxes).expect("predicts");
    assert_eq!(together.len(), boxes.len());
    for (one, found) in boxes.iter().zip(&together) {
        let alone = net.predict_raw(&encoded, std::slice::from_ref(one)).expect("predicts").remove(0);
        for (a, b) in alone.masks.iter().zip(&found.masks) {
            close("mask", &b.logits.values, &a.logits.values, 1e-5);
            assert!((a.iou - b.iou).abs() <= 1e-5);
        }
    }
}

#[test]
fn photos_are_resized_as_by_torchvision() {
    let wanted = arrays("sam2_resize.safetensors");
    for (name, (w, h)) in [("shrink", (97, 61)), ("grow", (20, 13)), ("mixed", (20, 61))] {
        close(name, &preprocess(&photo(w, h), 32).data, &array(&wanted, name), 2e-6);
    }
}

#[test]
fn prompts_that_say_nothing_are_refused() {
    let net = network();
    let encoded: Encoded<Reference> = net.encode(&photo(96, 64)).expect("encodes");
    for prompt in [Prompt::default(), Prompt::from_box([0.0, f64::NAN, 3.0, 4.0])] {
        let error = net.predict(&encoded, &[prompt], Masks::Best).expect_err("nothing to go by");
        assert!(error.to_string().contains("SAM 2"), "{error}");
    }
    assert!(net.encode(&image::RgbImage::new(0, 5)).is_err());
}

#[test]
fn checkpoints_of_another_size_or_layout_are_refused_with_file_key_and_shapes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sam2.1_hiera_large.safetensors");
    let message = |tensors: &[(&str, &[usize])]| {
        write_zeros(&path, tensors);
        let error =
            Sam2Segmenter::load(&path, Sam2Size::Large, Arc::new(Reference)).err().expect("refused").to_string();
        assert!(error.contains("sam2.1_hiera_large.safetensors"), "{error}");
        error
    };
    let patches = "model.image_encoder.trunk.patch_embed.proj.weight";
    let error = message(&[(patches, &[96, 3, 7, 7]), ("model.image_encoder.trunk.patch_embed.proj.bias", &[96])]);
    for part in [patches, "[96, 3, 7, 7]", "[144, 3, 7, 7]"] {
        assert!(error.contains(part), "{error}");
    }
    let error = message(&[(patches, &[144, 3, 7, 7]), ("model.image_encoder.trunk.patch_embed.proj.bias", &[144])]);
    assert!(error.contains("model.image_encoder.trunk.blocks.0.norm1.weight"), "{error}");
    let error = message(&[("vision_encoder.backbone.pos_embed", &[1, 144, 7, 7])]);
    assert!(error.contains("transformers"), "{error}");
}

#[tokio::test]
async fn the_player_gives_a_full_frame_mask_a_prompt_and_empty_ones_for_empty_boxes() {
    let segmenter = Sam2Segmenter::new(network(), "small, seeded");
    let prompt = |x0, y0, x1, y1| SegmentPrompt {
        key: "k".to_owned(),
        label: "chair".to_owned(),
        bounds: PixelBox { x0, y0, x1, y1 },
        outline: None,
    };
    let request = SegmentRequest {
        name: "test".to_owned(),
        image: Arc::new(photo(96, 64)),
        prompts: vec![prompt(200.0, 7.0, 300.0, 40.0), prompt(BOX[0], BOX[1], BOX[2], BOX[3])],
    };
    let masks = segmenter.segment(&request).await.expect("segments");
    assert_eq!(masks.len(), 2);
    assert_eq!((masks[0].mask.count(), masks[0].score), (0, None));
    let wanted = arrays("sam2_small.safetensors");
    let inside = array(&wanted, "box.best.masks").iter().filter(|v| **v > 0.0).count();
    // A logit next to zero may fall on either side.
    assert!(masks[1].mask.count().abs_diff(inside) <= 2, "{} instead of {inside}", masks[1].mask.count());
    let score = masks[1].score.expect("a score");
    assert!((score - f64::from(array(&wanted, "box.best.iou")[0])).abs() <= 1e-5);
}
