#!/usr/bin/env bash
# Replays the bundled example with the built program and lets outside judges look at the result.
set -euo pipefail
cd "$(dirname "$0")/.."
bin="${HARMONY_BIN:-target/release/harmony}"
out="$(mktemp -d)"
trap 'rm -rf "$out"' EXIT
passed=0
check() { echo "acceptance: $1"; shift; "$@"; passed=$((passed + 1)); }

check "the bundled example replays" "$bin" reconstruct examples/home_office.jpg --out "$out/run" --replay examples/home_office_recording --no-lit
second() {
  local said
  said="$("$bin" reconstruct examples/home_office.jpg --out "$out/run" --replay examples/home_office_recording --no-lit)"
  case "$said" in *"finished already"*) ;; *) echo "$said"; return 1 ;; esac
}
check "a second run finds nothing to do" second
check "Khronos validator" node tools/validate_glb.mjs "$out/run/scene_full.glb"
echo "$passed passed, 0 failed"
