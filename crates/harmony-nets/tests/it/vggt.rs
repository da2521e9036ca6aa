//! VGGT against the reference implementation in PyTorch, small configurations with seeded random weights.
//! Arrays: `tests/parity/vggt_small.*`, made by `tests/parity/make_vggt.py` (seed and versions stand there).
#![cfg(feature = "vggt")]
#![allow(clippy::print_stdout, reason = "tests; the worst element is said")]

use std::path::Path;

use crate::common::{compare, crc32, hashed_weights, uniform};
use harmony_nets::cpu::Cpu;
use harmony_nets::reference::Reference;
use harmony_nets::vggt::{Frame, Heads, Photo, Vggt, WIDTH, preprocess};
use harmony_nets::{Backend, WeightFile};

fn frames(expected: &WeightFile, name: &str) -> Vec<Frame> {
    let images = expected.find(&format!("{name}.images")).expect("the images");
    let [_, height, width, _] = *images.shape() else { panic!("images have four axes") };
    let one = |rgb: &[f32]| Frame { width, height, rgb: rgb.to_vec(), photo: [0, 0, width, height] };
    images.to_f32().chunks_exact(height * width * 3).map(one).collect()
}

fn agrees<B: Backend>(backend: &B, limit: f64) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/parity");
    let expected = WeightFile::open(&folder.join("vggt_small.safetensors")).unwrap();
    let weights = hashed_weights(&folder.join("vggt_small.json"));
    let file = WeightFile::open(weights.path()).unwrap();
    let network = Vggt::load(backend, &file.at("")).unwrap();
    for name in ["one", "three", "square"] {
        let found = network.run(backend, &frames(&expected, name), Heads { depth: true, points: true }).unwrap();
        let join =
            |f: &dyn Fn(&harmony_nets::vggt::FrameGeometry) -> Vec<f32>| found.iter().flat_map(f).collect::<Vec<f32>>();
        for (output, values) in [
            ("pose_enc", join(&|f| f.pose.to_vec())),
            ("depth", join(&|f| f.depth.clone())),
            ("depth_conf", join(&|f| f.depth_confidence.clone())),
            ("world_points", join(&|f| f.points.concat())),
            ("world_points_conf", join(&|f| f.point_confidence.clone())),
        ] {
            let wanted = expected.find(&format!("{name}.{output}")).expect("an output").to_f32();
            let worst = compare(&wanted, &values);
            println!("{} {name} {output}: worst element {worst:.2e}", backend.device());
            assert!(worst <= limit, "{name} {output}: worst element {worst:.2e}");
        }
    }
}

#[test]
fn small_networks_on_the_quick_backend_agree_with_pytorch() {
    agrees(&Cpu::new(), 1e-4);
}

#[test]
fn small_networks_on_the_reference_backend_agree_with_pytorch() {
    agrees(&Reference, 1e-4);
}

/// The tests of this file with the kernels of lesser processors, in processes of their own: the level is chosen once.
#[test]
fn lower_levels_agree() {
    if std::env::var_os("HARMONY_SIMD").is_some() {
        return;
    }
    for level in ["avx2", "portable"] {
        let mut tests = std::process::Command::new(std::env::current_exe().unwrap());
        let run = tests
            .args(["vggt::", "--skip", "lower_levels", "--nocapture"])
            .env("HARMONY_SIMD", level)
            .output()
            .unwrap();
        let said = [run.stdout, run.stderr].map(|s| String::from_utf8_lossy(&s).into_owned()).concat();
        assert!(run.status.success(), "{level}: {said}");
        assert!(said.contains("test result: ok.") && !said.contains("ok. 0 passed"), "{level}: {said}");
    }
}

/// What `tests/parity/vggt_preprocess.py` feeds.
fn picture(width: usize, height: usize) -> Vec<u8> {
    let values = uniform(&format!("picture {width}x{height}"), width * height * 3);
    values.into_iter().map(|u| ((u + 1.0) * 128.0) as u8).collect()
}

#[test]
fn photos_are_prepared_as_by_the_authors_code_to_the_last_bit() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/parity/vggt_preprocess.json");
    let wanted: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let cases = wanted["cases"].as_array().unwrap();
    assert!(cases.len() >= 6);
    for case in cases {
        let number = |v: &serde_json::Value| usize::try_from(v.as_u64().unwrap()).unwrap();
        let [width, height] = [&case["size"][0], &case["size"][1]].map(number);
        let frame = preprocess(Photo { width, height, rgb: &picture(width, height) }, WIDTH, 14);
        let found = [frame.width, frame.height];
        assert_eq!(found, [&case["result"][0], &case["result"][1]].map(number), "{width}x{height}");
        let bytes: Vec<u8> = frame.rgb.iter().map(|v| (v * 255.0).round() as u8).collect();
        let middle = (frame.height / 2 * frame.width + frame.width / 2) * 3;
        let some: Vec<usize> = bytes[middle..][..12].iter().map(|v| usize::from(*v)).collect();
        let theirs: Vec<usize> = case["middle"].as_array().unwrap().iter().map(number).collect();
        assert_eq!(some, theirs, "{width}x{height}");
        assert_eq!(u64::from(crc32(&bytes)), case["crc32"].as_u64().unwrap(), "{width}x{height}");
    }
}
