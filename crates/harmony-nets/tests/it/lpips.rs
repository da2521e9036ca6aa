//! LPIPS against the `lpips` package, with seeded random trunks: `tests/parity/lpips_nets.py` made the values.

#![cfg(feature = "lpips")]

use std::path::PathBuf;
use std::sync::Arc;

use crate::image_nets::{Seeded, array, arrays, close, photo};
use harmony_nets::WeightFile;
use harmony_nets::cpu::Cpu;
use harmony_nets::lpips::{Lpips, LpipsNet};
use harmony_nets::params::WeightSource;
use image::RgbImage;

const LIMIT: f64 = 1e-5;

fn trunk(net: LpipsNet) -> Seeded {
    let prefix = if net == LpipsNet::Alex { "alex." } else { "vgg." };
    Seeded { prefix, gain: |_| 2f32.sqrt(), positive: |key| key.starts_with("lin"), ..Seeded::default() }
}

/// The second picture of the script: mirrored, its upper half inverted.
fn changed(photo: &RgbImage) -> RgbImage {
    let mut other = image::imageops::flip_horizontal(photo);
    let half = photo.height() / 2;
    for (_, y, pixel) in other.enumerate_pixels_mut() {
        if y < half {
            pixel.0 = pixel.0.map(|v| 255 - v);
        }
    }
    other
}

fn check(net: LpipsNet, heads: &dyn WeightSource, file: &str) {
    let wanted = arrays(file);
    let metric = Lpips::load(Arc::new(Cpu::default()), &trunk(net), heads, net).expect("loads");
    let (a, b) = (photo(96, 64), changed(&photo(96, 64)));
    let found = metric.distance(&a, &b).expect("compares");
    let layers: Vec<f32> = found.layers.iter().map(|v| *v as f32).collect();
    close("layers", &layers, &array(&wanted, &format!("{}.layers", net.name())), LIMIT);
    close("value", &[found.value as f32], &array(&wanted, &format!("{}.value", net.name())), LIMIT);
    assert_eq!(metric.distance(&a, &a).expect("compares").value, 0.0);
}

#[test]
fn alexnet_agrees_with_random_heads() {
    check(LpipsNet::Alex, &trunk(LpipsNet::Alex), "lpips_small.safetensors");
}

#[test]
fn vgg_agrees_with_random_heads() {
    check(LpipsNet::Vgg, &trunk(LpipsNet::Vgg), "lpips_small.safetensors");
}

/// The published heads, outside the repository.
fn heads(net: LpipsNet) -> Option<PathBuf> {
    harmony_testing::shared(&format!("weights/lpips_v0.1_{}_linear.pth", net.name()))
}

#[test]
fn the_published_heads_are_read_and_give_the_same_distances() {
    for net in [LpipsNet::Alex, LpipsNet::Vgg] {
        let Some(path) = heads(net) else { continue };
        let heads = WeightFile::open(&path).expect("a checkpoint of PyTorch");
        check(net, &heads, "lpips_heads.safetensors");
    }
}

#[test]
fn pictures_of_two_sizes_and_tiny_ones_are_refused() {
    let net = LpipsNet::Alex;
    let metric = Lpips::load(Arc::new(Cpu::default()), &trunk(net), &trunk(net), net).expect("loads");
    assert!(metric.distance(&photo(64, 64), &photo(64, 65)).is_err());
    assert!(metric.distance(&photo(64, 30), &photo(64, 30)).is_err());
    // The least side still works.
    assert!(metric.distance(&photo(31, 31), &photo(31, 31)).is_ok());
}

#[test]
fn heads_for_another_trunk_are_refused_with_key_and_shapes() {
    let Some(path) = heads(LpipsNet::Vgg) else { return };
    let heads = WeightFile::open(&path).expect("a checkpoint of PyTorch");
    let net = LpipsNet::Alex;
    let error = Lpips::load(Arc::new(Cpu::default()), &trunk(net), &heads, net).err().expect("VGG's heads").to_string();
    for part in ["lin1.model.1.weight", "192", "128", "lpips_v0.1_vgg_linear.pth"] {
        assert!(error.contains(part), "{error}");
    }
}
