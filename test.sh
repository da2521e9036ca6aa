#!/usr/bin/env bash
# All tests of HARMONY, and the installation of what they need. About 35 minutes on two cores from scratch.
#
#   ./test.sh            everything
#   ./test.sh --quick    format, lints and Rust tests only
#
# HARMONY_SHARED names a folder with test data (photos, RGB-D frames, rooms with truth); default ../shared.
# Tests that need it, or Blender, say that they are skipped when it is absent.
set -euo pipefail
cd "$(dirname "$0")"
export HARMONY_CACHE="${HARMONY_CACHE:-$HOME/.cache/harmony}"
# Builds are cached outside the checkout, so that a fresh clone does not start from nothing.
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$HARMONY_CACHE/target}"
export CARGO_INCREMENTAL=0
# Property tests draw the same cases every time; take the line out to look for new ones.
export PROPTEST_RNG_SEED="${PROPTEST_RNG_SEED:-2026}"
# The native networks are switched on for the tests; the plain program is built without them.
NETS="harmony-cli/cuda"
mkdir -p "$HARMONY_CACHE"
step() { printf '\n== %s\n' "$1"; }

step "format"
cargo fmt --all --check
step "lints"
cargo clippy --quiet --workspace --all-targets --features "$NETS" -- -D warnings
step "Rust tests"
if cargo nextest --version >/dev/null 2>&1; then
  cargo nextest run --workspace --features "$NETS" --no-fail-fast
else
  cargo test --workspace --features "$NETS" --no-fail-fast
fi
if [ "${1:-}" = "--quick" ]; then exit 0; fi

step "the program"
cargo build --release --quiet -p harmony-cli
export HARMONY_BIN="$CARGO_TARGET_DIR/release/harmony"
step "acceptance"
tools/setup.sh
tools/acceptance.sh
step "licences"
"$HARMONY_CACHE/bpy/bin/python" tools/check_licences.py
