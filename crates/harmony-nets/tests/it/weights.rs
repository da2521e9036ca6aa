//! Weight files made by PyTorch and safetensors (`tests/parity/make_weights.py`), and ones that are broken on purpose.

use std::path::{Path, PathBuf};

use harmony_nets::{DType, WeightError, WeightFile};

fn parity(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/parity").join(name)
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(parity(name)).unwrap()
}

fn open(bytes: &[u8]) -> Result<WeightFile, WeightError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.bin");
    std::fs::write(&path, bytes).unwrap();
    WeightFile::open(&path)
}

fn safetensors(header: &str, data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), data].concat()
}

#[test]
fn every_format_gives_the_same_tensors() {
    for (name, prefix) in [
        ("weights.safetensors", ""),
        ("weights_zip.pt", ""),
        ("weights_legacy.pth", ""),
        ("weights_nested.pt", "model"),
    ] {
        let file = WeightFile::open(&parity(name)).unwrap();
        let at = file.at(prefix);
        assert_eq!(at.get("a", &[2, 3]).unwrap().to_f32(), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "{name}");
        let b = at.get("b", &[2]).unwrap();
        assert_eq!((b.dtype(), b.to_f32()), (DType::BF16, vec![1.5, -2.0]), "{name}");
        let c = at.get("c", &[1]).unwrap();
        assert_eq!((c.dtype(), c.to_f32()), (DType::F16, vec![0.25]), "{name}");
        assert_eq!(at.get("t", &[3, 2]).unwrap().to_f32(), [0.0, 3.0, 1.0, 4.0, 2.0, 5.0], "{name}");
        assert!(matches!(at.get("i", &[1]), Err(WeightError::WrongType { found: DType::I64, .. })), "{name}");
    }
    let file = WeightFile::open(&parity("weights_parameter.pt")).unwrap();
    assert_eq!(file.get("a", &[2, 3]).unwrap().to_f32()[5], 5.0);
}

#[test]
fn aligned_f32_is_used_in_place() {
    let file = WeightFile::open(&parity("weights_zip.pt")).unwrap();
    assert!(file.get("a", &[2, 3]).unwrap().as_f32().is_some());
}

#[test]
fn errors_name_file_key_wanted_and_found_shape() {
    let file = WeightFile::open(&parity("weights_nested.pt")).unwrap();
    let wrong = file.at("model").get("a", &[3, 3]).unwrap_err().to_string();
    for part in ["model.a", "[3, 3]", "[2, 3]", "weights_nested.pt"] {
        assert!(wrong.contains(part), "{wrong}");
    }
    let missing = file.at("model").get("gamma", &[4]).unwrap_err().to_string();
    for part in ["model.gamma", "[4]", "model.", "weights_nested.pt"] {
        assert!(missing.contains(part), "{missing}");
    }
    let absent = WeightFile::open(Path::new("no/such/file.pt")).unwrap_err();
    assert!(matches!(&absent, WeightError::Io { .. }) && absent.to_string().contains("no/such/file.pt"));
    assert!(matches!(WeightFile::open(Path::new(env!("CARGO_MANIFEST_DIR"))), Err(WeightError::Io { .. })));
}

#[test]
fn code_in_a_checkpoint_is_refused_by_name_and_not_run() {
    let error = WeightFile::open(&parity("weights_evil.pt")).unwrap_err();
    assert!(matches!(&error, WeightError::Refused { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("system") && text.contains("weights_evil.pt"), "{text}");
}

#[test]
fn files_cut_off_anywhere_are_errors() {
    for name in ["weights.safetensors", "weights_zip.pt", "weights_legacy.pth", "weights_nested.pt"] {
        let whole = bytes(name);
        for end in (0..whole.len()).rev().step_by(3) {
            assert!(open(&whole[..end]).is_err(), "{name} cut to {end} of {} bytes", whole.len());
        }
    }
}

#[test]
fn changed_bytes_never_panic() {
    for name in ["weights.safetensors", "weights_zip.pt", "weights_legacy.pth"] {
        let whole = bytes(name);
        for at in 0..whole.len() {
            let mut changed = whole.clone();
            changed[at] = [0x00, 0x2e, 0x7f, 0xff][at % 4];
            if let Ok(file) = open(&changed) {
                for key in file.keys() {
                    let _ = file.find(key).map(harmony_nets::HostTensor::to_f32);
                }
            }
        }
    }
}

#[test]
fn headers_that_lie_are_refused() {
    let entry =
        |shape: &str, offsets: &str| format!(r#"{{"a":{{"dtype":"F32","shape":{shape},"data_offsets":{offsets}}}}}"#);
    assert!(open(&safetensors(&entry("[2]", "[0,8]"), &[0; 8])).is_ok());
    for (shape, offsets) in [
        ("[2]", "[0,12]"),
        ("[2]", "[4,12]"),
        ("[2]", "[8,0]"),
        ("[3]", "[0,8]"),
        ("[-1]", "[0,8]"),
        ("[4294967296,4294967296,4]", "[0,8]"),
        ("[2]", "[0,18446744073709551615]"),
        ("[1e300]", "[0,8]"),
    ] {
        let error = open(&safetensors(&entry(shape, offsets), &[0; 8])).unwrap_err();
        assert!(error.to_string().contains("tensor a"), "{shape} {offsets}: {error}");
    }
    let twice = r#"{"a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]},"b":{"dtype":"F32","shape":[1],"data_offsets":[4,8]}}"#;
    assert!(open(&safetensors(twice, &[0; 8])).unwrap_err().to_string().contains("overlap"));
    let odd = r#"{"a":{"dtype":"F4","shape":[2],"data_offsets":[0,8]}}"#;
    assert!(open(&safetensors(odd, &[0; 8])).unwrap_err().to_string().contains("F4"));
    assert!(open(&u64::MAX.to_le_bytes().repeat(4)).is_err());
    assert!(open(b"<html>this is not a weight file</html>").is_err());
}

#[test]
fn pickles_that_go_round_in_circles_or_nest_deeply_end() {
    let magic = &bytes("weights_legacy.pth")[..15];
    let legacy = |object: &[u8]| {
        let mut file = magic.to_vec();
        file.extend_from_slice(b"\x80\x02M\xe9\x03.\x80\x02}.\x80\x02");
        file.extend_from_slice(object);
        file.extend_from_slice(b"\x80\x02].");
        file
    };
    // d = {}; d["x"] = d
    assert!(open(&legacy(b"}q\x00U\x01xh\x00s.")).is_err());
    // A million tuples, each in the next.
    let mut nested = b")".to_vec();
    nested.extend(std::iter::repeat_n(0x85, 1_000_000));
    nested.push(b'.');
    assert!(open(&legacy(&nested)).is_err());
    // Values taken that were never made, a memo that was never set, an unknown opcode.
    for object in [&b"0."[..], b"h\x07.", b"R.", b"t.", b"i.", b"\xfe.", b"cos\nsystem\n."] {
        assert!(open(&legacy(object)).is_err(), "{object:?}");
    }
}
