//! CLIP against transformers on a small configuration: `tests/parity/clip.py` made the arrays.

#![cfg(feature = "clip")]

use std::sync::Arc;

use crate::image_nets::{Seeded, array, arrays, close, data, photo, uniform};
use harmony_nets::clip::{
    ClipConfig, ClipImageEncoder, ClipTextEncoder, Layout, TextConfig, Tokenizer, VisionConfig, VisionTower, cosine,
    preprocess,
};
use harmony_nets::params::{Params, WeightSource};
use harmony_nets::reference::Reference;
use harmony_nets::resample::{Filter, Pixels, resize_8bit};
use harmony_nets::{Backend, DType, HostTensor, WeightError};

const LIMIT: f64 = 1e-5;

fn small() -> ClipConfig {
    ClipConfig {
        vision: VisionConfig { width: 32, hidden: 128, layers: 2, heads: 2, image_size: 32, patch: 8 },
        text: TextConfig { width: 24, hidden: 96, layers: 2, heads: 3, vocabulary: 60, positions: 12 },
        features: 16,
    }
}

fn seeded() -> Seeded {
    Seeded { small: |key| key.contains("embedding") && !key.contains("patch"), ..Seeded::default() }
}

/// What the scripts feed: `[3, side, side]` by channels.
fn pixels(index: usize, side: usize) -> Pixels {
    let planes = uniform(&format!("pixels{index}"), 3 * side * side);
    let at = |i: usize| (0..3).map(move |c| c * side * side + i);
    let data = (0..side * side).flat_map(at).map(|i| planes[i] * 1.7).collect();
    Pixels { width: side, height: side, data }
}

fn tokenizer() -> Tokenizer {
    Tokenizer::open(&data("clip_tokens")).expect("the committed vocabulary")
}

#[test]
fn image_features_agree() {
    let wanted = arrays("clip_small.safetensors");
    let (b, weights, images) = (Reference, seeded(), [pixels(0, 32), pixels(1, 32)]);
    let p = Params::new(&b, &weights, DType::F32);
    let tower = VisionTower::load(&p, small().vision, Layout::Transformers, Layout::CLIP_PRE_NORM).expect("loads");
    let tokens = b.read(&tower.forward(&b, images[..1].to_vec()).expect("runs")).expect("readable");
    close("last tokens", &tokens, &array(&wanted, "vision.hidden2"), LIMIT);

    let encoder = ClipImageEncoder::load(Arc::new(Reference), &weights, &small()).expect("loads");
    let found = encoder.embed_pixels(&images).expect("embeds");
    close("features", &found.concat(), &array(&wanted, "image_embeds"), LIMIT);
}

#[test]
fn text_features_agree_and_rows_of_other_lengths_do_not_matter() {
    let wanted = array(&arrays("clip_small.safetensors"), "text_embeds");
    let encoder = ClipTextEncoder::load(Arc::new(Reference), &seeded(), &small(), tokenizer()).expect("loads");
    let rows = [vec![58, 3, 17, 9, 59], vec![58, 44, 59], vec![58, 1, 2, 3, 4, 5, 59]];
    close("together", &encoder.embed_ids(&rows).expect("embeds").concat(), &wanted, LIMIT);
    for (row, wanted) in rows.iter().zip(wanted.chunks_exact(16)) {
        close("alone", &encoder.embed_ids(std::slice::from_ref(row)).expect("embeds").concat(), wanted, LIMIT);
    }
    assert!(encoder.embed_ids(&[vec![1; 13]]).is_err());
    assert!(encoder.embed_ids(&[vec![]]).is_err());
}

/// The same weights under OpenAI's names.
struct OpenAi(Seeded);

impl OpenAi {
    fn renamed(key: &str) -> String {
        let tower =
            if let Some(rest) = key.strip_prefix("visual.") { ("vision_model", rest) } else { ("text_model", key) };
        let (prefix, rest) = tower;
        let rest = match rest {
            "conv1.weight" => "embeddings.patch_embedding.weight".to_owned(),
            "class_embedding" => "embeddings.class_embedding".to_owned(),
            "positional_embedding" => "embeddings.position_embedding.weight".to_owned(),
            "token_embedding.weight" => "embeddings.token_embedding.weight".to_owned(),
            rest => rest
                .replace("transformer.resblocks", "encoder.layers")
                .replace("ln_1", "layer_norm1")
                .replace("ln_2", "layer_norm2")
                .replace("ln_pre", "pre_layrnorm")
                .replace("ln_post", "post_layernorm")
                .replace("ln_final", "final_layer_norm")
                .replace("attn.out_proj", "self_attn.out_proj")
                .replace("mlp.c_fc", "mlp.fc1")
                .replace("mlp.c_proj", "mlp.fc2"),
        };
        format!("{prefix}.{rest}")
    }
}

impl WeightSource for OpenAi {
    fn tensor(&self, key: &str, shape: &[usize]) -> Result<HostTensor, WeightError> {
        if let Some((block, kind)) = key.split_once("attn.in_proj_") {
            let part = |name: &str| {
                let key = format!("{}self_attn.{name}_proj.{kind}", OpenAi::renamed(block));
                let mut shape = shape.to_vec();
                shape[0] /= 3;
                self.0.tensor(&key, &shape).map(|t| t.to_f32())
            };
            return Ok(HostTensor::from_f32(shape, [part("q")?, part("k")?, part("v")?].concat()));
        }
        if let Some(name) = match key {
            "visual.proj" => Some("visual_projection.weight"),
            "text_projection" => Some("text_projection.weight"),
            _ => None,
        } {
            let &[input, out] = shape else { panic!("{key} with {shape:?}") };
            let data = self.0.tensor(name, &[out, input])?.to_f32();
            let turned = (0..input).flat_map(|i| (0..out).map(move |o| (o, i))).map(|(o, i)| data[o * input + i]);
            return Ok(HostTensor::from_f32(shape, turned.collect()));
        }
        self.0.tensor(&Self::renamed(key), shape)
    }

    fn has(&self, key: &str) -> bool {
        key == "visual.conv1.weight"
    }
}

#[test]
fn the_names_of_openai_give_the_same_features() {
    let wanted = arrays("clip_small.safetensors");
    let weights = OpenAi(seeded());
    let images = ClipImageEncoder::load(Arc::new(Reference), &weights, &small()).expect("loads");
    let found = images.embed_pixels(&[pixels(0, 32), pixels(1, 32)]).expect("embeds");
    close("images", &found.concat(), &array(&wanted, "image_embeds"), LIMIT);
    let text = ClipTextEncoder::load(Arc::new(Reference), &weights, &small(), tokenizer()).expect("loads");
    let found = text.embed_ids(&[vec![58, 3, 17, 9, 59]]).expect("embeds");
    close("text", &found[0], &array(&wanted, "text_embeds")[..16], LIMIT);
}

#[test]
fn photos_are_resized_and_cut_as_by_pillow() {
    let wanted = arrays("clip_preprocess.safetensors");
    for (name, (w, h)) in [("wide", (97, 61)), ("tall", (40, 93)), ("grow", (21, 13)), ("odd", (45, 32))] {
        // Exact 8-bit pixels: what is left is the rounding of the normalisation.
        close(name, &preprocess(&photo(w, h), 32).data, &array(&wanted, name), 1e-6);
        let triangle = resize_8bit(&photo(w, h), 24, 24, Filter::Triangle);
        let found: Vec<f32> = triangle.as_raw().iter().map(|v| f32::from(*v)).collect();
        assert_eq!(found, array(&wanted, &format!("{name}.bilinear8")), "{name}, to the last bit");
    }
}

#[test]
fn sentences_become_the_tokens_of_transformers() {
    #[derive(serde::Deserialize)]
    struct Case {
        text: String,
        ids: Vec<u32>,
        max: Option<usize>,
    }
    let cases = std::fs::read_to_string(data("clip_tokens/cases.json")).expect("committed cases");
    let cases: Vec<Case> = serde_json::from_str(&cases).expect("cases");
    assert!(cases.len() >= 10);
    // `tokenizer.json` alone, as in newer folders.
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::copy(data("clip_tokens/tokenizer.json"), folder.path().join("tokenizer.json")).expect("copied");
    for tokenizer in [tokenizer(), Tokenizer::open(folder.path()).expect("reads")] {
        for case in &cases {
            assert_eq!(tokenizer.encode(&case.text, case.max.unwrap_or(1000)), case.ids, "{:?}", case.text);
        }
        // Marks in a sentence are text.
        let marked = tokenizer.encode("<|endoftext|>", 100);
        assert!(marked.len() > 3 && marked[1..marked.len() - 1].iter().all(|id| *id != marked[marked.len() - 1]));
    }
}

#[test]
fn a_folder_without_a_usable_vocabulary_says_which_file_and_why() {
    let folder = tempfile::tempdir().expect("a folder");
    let message = |what: &str| {
        let error = Tokenizer::open(folder.path()).expect_err(what).to_string();
        assert!(error.contains(&folder.path().display().to_string()), "{error}");
        error
    };
    assert!(message("nothing there").contains("tokenizer.json"));
    std::fs::write(folder.path().join("vocab.json"), "{\"a\": 1}").expect("written");
    assert!(message("no merges").contains("merges.txt"));
    std::fs::write(folder.path().join("merges.txt"), "#version: 0.2\na b\n").expect("written");
    assert!(message("no marks").contains("<|startoftext|>"));
    std::fs::write(folder.path().join("vocab.json"), "{\"a\": 1").expect("written");
    assert!(message("cut off").contains("vocab.json"));
}

#[test]
fn cosines_do_not_depend_on_lengths() {
    assert!((cosine(&[1.0, 0.0], &[3.0, 3.0]) - 0.5f64.sqrt()).abs() <= 1e-7);
    assert_eq!(cosine(&[0.0, 0.0], &[3.0, 3.0]), 0.0);
}
