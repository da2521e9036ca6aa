//! Developer commands: `cargo xtask parity [images] [--rounds N]`.
#![expect(clippy::print_stdout, reason = "a program")]

mod image_nets;
mod parity;

use anyhow::{Result, bail};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["parity"] => parity::run(0).and_then(|()| image_nets::run(0)),
        ["parity", "--rounds", n] => parity::run(n.parse()?).and_then(|()| image_nets::run(n.parse()?)),
        ["parity", "images"] => image_nets::run(0),
        ["parity", "images", "--rounds", n] => image_nets::run(n.parse()?),
        _ => bail!(
            "cargo xtask parity [images] [--rounds N]\n\
             \n  Compares networks of full size with their reference implementations in PyTorch, with seeded random\
             \n  weights; with --rounds, also times both in turn. About 25 GB of disk, 12 GB of memory.\
             \n  HARMONY_VGGT    a checkout of the VGGT authors' repository (default: the cache's folder vggt)\
             \n  HARMONY_SAM2    a checkout of facebookresearch/sam2 (default: the cache's folder sam2)\
             \n  HARMONY_CACHE   where Python, weights and outputs go (default: ~/.cache/harmony)"
        ),
    }
}
