//! Developer commands: `cargo xtask parity [--rounds N]`.
#![expect(clippy::print_stdout, reason = "a program")]

mod parity;

use anyhow::{Result, bail};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["parity"] => parity::run(0),
        ["parity", "--rounds", n] => parity::run(n.parse()?),
        _ => bail!(
            "cargo xtask parity [--rounds N]\n\
             \n  Compares networks of full size with their reference implementations in PyTorch, with seeded random\
             \n  weights; with --rounds, also times both in turn. About 25 GB of disk, 12 GB of memory.\
             \n  HARMONY_VGGT    a checkout of the VGGT authors' repository (default: the cache's folder vggt)\
             \n  HARMONY_CACHE   where Python, weights and outputs go (default: ~/.cache/harmony)"
        ),
    }
}
