#!/usr/bin/env bash
# Our rasteriser against pyrender on OSMesa: the same scene, the same cores, one run.
# Needs libosmesa6 (apt-get install libosmesa6) and python3 with venv; everything else goes into the cache folder.
set -euo pipefail
cd "$(dirname "$0")/.."
cache="${HARMONY_CACHE:-$HOME/.cache/harmony}"
venv="$cache/peer-pyrender"
scene="$cache/bench/scene"

if ! "$venv/bin/python" -c 'import pyrender' 2>/dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet pyrender==0.1.45 trimesh numpy pillow
    # pyrender pins 3.1.0, which lacks OSMesaCreateContextAttribs; pip warns about it.
    "$venv/bin/pip" install --quiet 'PyOpenGL>=3.1.7'
fi
cargo build --quiet --release -p harmony-render --example bench_scene
program="${CARGO_TARGET_DIR:-target}/release/examples/bench_scene"
"$program" --rounds 1 --out "$scene" >/dev/null
"$venv/bin/python" bench/render_vs_pyrender.py "$scene" "$program" "${1:-5}"
