#!/usr/bin/env bash
# All tests of HARMONY, and the installation of what they need. Each step prints its time: docs/performance.md.
#
#   ./test.sh            everything
#   ./test.sh --quick    format, lints, maps and Rust tests only
#
# HARMONY_SHARED names a folder with test data (photos, RGB-D frames, rooms with truth); default ../shared.
# Tests that need it, or Blender, are skipped when it is absent: each is named at the end, with the time of every step.
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
HARMONY_SKIPS="$(mktemp)"
export HARMONY_SKIPS

STEP="" BEGUN=0 TIMES=""
# Ends the step before, and begins another; without a name only the former.
step() {
  if [ -n "$STEP" ]; then TIMES+="$(printf '%6d s  %s' $((SECONDS - BEGUN)) "$STEP")"$'\n'; fi
  STEP="${1:-}" BEGUN=$SECONDS
  if [ -n "$STEP" ]; then printf '\n== %s\n' "$STEP"; fi
}
# Whatever the end: what was skipped, and what took how long.
summary() {
  local status=$?
  if [ "$status" != 0 ]; then STEP="$STEP (failed)"; fi
  step
  printf '\n== %d tests skipped\n' "$(sort -u "$HARMONY_SKIPS" | wc -l)"
  sort -u "$HARMONY_SKIPS"
  printf '\n== time\n%s%6d s  total\n' "$TIMES" "$SECONDS"
  rm -f "$HARMONY_SKIPS"
}
trap summary EXIT

step "format"
cargo fmt --all --check
step "lints"
cargo clippy --quiet --workspace --all-targets --features "$NETS" -- -D warnings
# What is shipped by default: without the networks.
cargo clippy --quiet --workspace --all-targets -- -D warnings
step "maps of paper and crates"
cargo xtask paper
cargo xtask deps
# The outside judges come first: tests that start them are not skipped then.
if [ "${1:-}" != "--quick" ]; then
  step "outside judges"
  tools/setup.sh
fi
step "Rust tests"
if cargo nextest --version >/dev/null 2>&1; then
  cargo nextest run --workspace --lib --bins --tests --features "$NETS" --no-fail-fast
else
  cargo test --workspace --lib --bins --tests --features "$NETS" --no-fail-fast
fi
if [ "${1:-}" = "--quick" ]; then exit 0; fi

# The program that the tests were run with: a release build would cost as much as all tests, and says nothing else.
export HARMONY_BIN="$CARGO_TARGET_DIR/debug/harmony"
step "acceptance"
tools/acceptance.sh
step "licences"
"$HARMONY_CACHE/bpy/bin/python" tools/check_licences.py
