#!/usr/bin/env bash
# Our metrics against SciPy and Pillow: the same numbers, the same cores, one run.
# Usage: metrics_vs_scipy.sh [ROUNDS] [FOLDER]; a FOLDER with prediction.f64, truth.f64 (little-endian x, y, z),
# render.png and target.png is taken as it is, without one a furnished room of 1,000,000 points a side is made.
# Needs python3 with venv; everything else goes into the cache folder. Fails when a number differs.
set -euo pipefail
cd "$(dirname "$0")/.."
cache="${HARMONY_CACHE:-$HOME/.cache/harmony}"
venv="$cache/bench-venv"
folder="${2:-$cache/bench/metrics}"

if ! "$venv/bin/python" -c 'import numpy, scipy, PIL' 2>/dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet numpy scipy pillow
fi
cargo build --quiet --release -p harmony-bench --example metrics_bench
program="${CARGO_TARGET_DIR:-target}/release/examples/metrics_bench"
[ $# -ge 2 ] || "$program" make "$folder" 1000000
"$venv/bin/python" bench/metrics_vs_scipy.py "$folder" "$program" "${1:-5}"
