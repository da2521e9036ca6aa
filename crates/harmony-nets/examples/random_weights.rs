//! Writes weight files of published sizes with seeded random values: to try programs and machines without real weights.
//!
//! ```text
//! random_weights FOLDER NAME...
//! ```
//!
//! NAME is `sam2.1-{tiny,small,base-plus,large}`, `owlv2-{base,large}` (without a vocabulary), `clip-vit-b32` or
//! `lpips-{alex,vgg}` (the trunk). Each is written as `FOLDER/NAME/FILE`, under the names of the published files.
//! VGGT's are made by `tests/parity/make_vggt.py full`.
//!
//! Nothing is known here of keys and shapes: a network is loaded from a source that has whatever it is asked for, and
//! what it asked for is written down.

#![expect(clippy::print_stdout, reason = "a program")]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};

use harmony_nets::clip::{ClipConfig, ClipImageEncoder};
use harmony_nets::cpu::Cpu;
use harmony_nets::detector::{Owlv2, Owlv2Config, Owlv2Size};
use harmony_nets::lpips::{Lpips, LpipsNet};
use harmony_nets::params::WeightSource;
use harmony_nets::sam2::{Sam2, Sam2Config, Sam2Size};
use harmony_nets::{HostTensor, WeightError};
use serde_json::{Map, Value, json};

#[path = "../tests/it/image_nets/seeded.rs"]
#[expect(dead_code, reason = "its picture is for others")]
mod seeded;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Has every tensor of every shape; remembers which were wanted.
#[derive(Default)]
struct Inventor(Mutex<BTreeMap<String, Vec<usize>>>);

/// As `tensor` of `tests/parity/seeded.py`: matrices and filters by their inputs, norms about one.
fn values(key: &str, shape: &[usize]) -> Vec<f32> {
    let mut values = seeded::uniform(key, shape.iter().product());
    let (offset, factor) = match shape {
        [_, inputs @ ..] if !inputs.is_empty() => {
            (0.0, (3.0 / inputs.iter().product::<usize>().max(1) as f64).sqrt() as f32)
        }
        _ if key.ends_with(".weight") => (1.0, 0.1),
        _ => (0.0, 0.1),
    };
    for v in &mut values {
        *v = offset + factor * *v;
    }
    values
}

impl WeightSource for Inventor {
    fn tensor(&self, key: &str, shape: &[usize]) -> Result<HostTensor, WeightError> {
        self.0.lock().expect("one thread").insert(key.to_owned(), shape.to_vec());
        Ok(HostTensor::from_f32(shape, values(key, shape)))
    }

    fn has(&self, key: &str) -> bool {
        // OpenAI's names of CLIP's weights are not wanted.
        key != "visual.conv1.weight"
    }
}

fn main() -> Outcome {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [folder, names @ ..] = &args[..] else { return Err("usage: random_weights FOLDER NAME...".into()) };
    for name in names {
        one(Path::new(folder), name)?;
    }
    Ok(())
}

fn one(folder: &Path, name: &str) -> Outcome {
    let (weights, heads) = (Inventor::default(), Inventor::default());
    let cpu = Arc::new(Cpu::new());
    let file = match name {
        "owlv2-base" | "owlv2-large" => {
            let size = if name.ends_with("large") { Owlv2Size::Large } else { Owlv2Size::Base };
            Owlv2::load(cpu, &weights, Owlv2Config::of(size))?;
            "model.safetensors".to_owned()
        }
        "clip-vit-b32" => {
            ClipImageEncoder::load(cpu, &weights, &ClipConfig::vit_b32())?;
            "pytorch_model.bin".to_owned()
        }
        "lpips-alex" => {
            Lpips::load(cpu, &weights, &heads, LpipsNet::Alex)?;
            "alexnet-owt-7be5be79.pth".to_owned()
        }
        "lpips-vgg" => {
            Lpips::load(cpu, &weights, &heads, LpipsNet::Vgg)?;
            "vgg16-397923af.pth".to_owned()
        }
        _ => {
            let size = name.strip_prefix("sam2.1-").map(|size| size.replace('-', "_"));
            let size =
                size.and_then(|size| Sam2Size::from_name(&size)).ok_or_else(|| format!("no such model: {name}"))?;
            Sam2::load(cpu, &weights, Sam2Config::of(size))?;
            format!("sam2.1_hiera_{}.pt", size.name())
        }
    };
    let folder = folder.join(name);
    std::fs::create_dir_all(&folder)?;
    let path = folder.join(file);
    let asked = weights.0.into_inner()?;
    write(&path, &asked)?;
    println!("{}: {} tensors", path.display(), asked.len());
    Ok(())
}

/// A safetensors file.
fn write(path: &Path, tensors: &BTreeMap<String, Vec<usize>>) -> Outcome {
    let (mut header, mut end) = (Map::<String, Value>::new(), 0);
    for (key, shape) in tensors {
        let start = end;
        end += 4 * shape.iter().product::<usize>();
        header.insert(key.clone(), json!({ "dtype": "F32", "shape": shape, "data_offsets": [start, end] }));
    }
    let header = serde_json::to_vec(&header)?;
    let mut out = BufWriter::new(File::create(path)?);
    out.write_all(&(header.len() as u64).to_le_bytes())?;
    out.write_all(&header)?;
    for (key, shape) in tensors {
        for v in values(key, shape) {
            out.write_all(&v.to_le_bytes())?;
        }
    }
    Ok(out.flush()?)
}
