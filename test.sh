#!/usr/bin/env bash
# All tests of HARMONY, and the installation of what they need. Takes about 25 minutes on two cores from scratch.
#
#   ./test.sh            everything
#   ./test.sh --quick    Rust tests only
#
# HARMONY_SHARED names a folder with test data (photos, RGB-D frames, rooms with truth); default ../shared.
# Tests that need it say that they are skipped when it is absent.
set -euo pipefail
cd "$(dirname "$0")"
export HARMONY_CACHE="${HARMONY_CACHE:-$HOME/.cache/harmony}"
# Builds are cached outside the checkout, so that a fresh clone does not start from nothing.
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$HARMONY_CACHE/target}"
mkdir -p "$HARMONY_CACHE"
step() { printf '\n== %s\n' "$1"; }

step "format"
cargo fmt --all --check
step "lints"
cargo clippy --workspace --all-targets --quiet -- -D warnings
step "Rust tests"
if cargo nextest --version >/dev/null 2>&1; then
  cargo nextest run --workspace --no-fail-fast
else
  cargo test --workspace --no-fail-fast
fi
step "documentation tests"
cargo test --workspace --doc --quiet
if [ "${1:-}" = "--quick" ]; then exit 0; fi

step "the program"
cargo build --release --quiet -p harmony-cli
export HARMONY_BIN="$CARGO_TARGET_DIR/release/harmony"
step "tools for acceptance tests"
tools/setup.sh
step "acceptance: Khronos validator, three.js, Blender"
tools/acceptance.sh
