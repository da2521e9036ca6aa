#!/usr/bin/env bash
# Networks on an NVIDIA GPU: correctness against PyTorch (CPU, f32), time and memory against PyTorch on the same GPU, in one run.
#
#   bench/gpu_nets.sh [STEP..]    steps: ops parity time profile peer compiled; default: all but profile
#
# The programs may be built on a machine without CUDA:
#   cargo build --release -p harmony-nets --features cuda,vggt,sam2,clip,detector,lpips --examples
#
#   BIN             folder of the programs cuda_check and image_nets (default: target/release/examples)
#   PYTHON          a Python with torch (CUDA), torchvision, transformers, safetensors, hydra-core, iopath, lpips
#   HARMONY_VGGT    a checkout of facebookresearch/vggt
#   HARMONY_SAM2    a checkout of facebookresearch/sam2
#   NETS            networks (default: vggt clip owlv2_base owlv2_large sam2_large lpips)
#   DATA            where weights and expected outputs go (15 GB; default: the cache's folder parity-gpu)
#   LD_LIBRARY_PATH has the folders of libnvrtc and libcublasLt, if they are not where the system looks
set -uo pipefail
here="$(cd "$(dirname "$0")/.." && pwd)"
BIN="${BIN:-$here/target/release/examples}"
PYTHON="${PYTHON:-python3}"
DATA="${DATA:-${HARMONY_CACHE:-$HOME/.cache/harmony}/parity-gpu}"
SCRIPTS="${SCRIPTS:-$here/crates/harmony-nets/tests/parity}"
SAM2_REPO="${HARMONY_SAM2:?a checkout of facebookresearch/sam2}"
VGGT="${HARMONY_VGGT:?a checkout of facebookresearch/vggt}"
export SAM2_REPO PYTHONUNBUFFERED=1 HYDRA_FULL_ERROR=1
steps="${*:-ops parity time peer compiled}"
nets="${NETS:-vggt clip owlv2_base owlv2_large sam2_large lpips}"
failed=""
mkdir -p "$DATA"
py() { "$PYTHON" -W ignore "$@"; }
step() { case " $steps " in *" $1 "*) printf '\n== %s\n' "$1" ;; *) return 1 ;; esac; }
try() { timeout "${LIMIT:-240}" "$@" || { failed="$failed; $*"; echo "FAILED: $*"; }; }
made() { # folder, then the command that fills it
  [ -e "$DATA/$1/done" ] || { mkdir -p "$DATA/$1" && py "$SCRIPTS/$2" "${@:3}" "$DATA/$1" >"$DATA/$1/log" 2>&1 && touch "$DATA/$1/done"; }
}
nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv,noheader
wanted() { case " $nets " in *" $1 "*) ;; *) return 1 ;; esac; }
# Weights and expected outputs, all at once.
for net in $nets; do
  case "$net" in
    vggt) made vggt make_vggt.py full "$VGGT" & ;;
    sam2_* | owlv2_*) made "$net" "${net%%_*}.py" full "${net#*_}" & ;;
    clip) made clip clip.py full & ;;
    lpips) made lpips lpips_nets.py full & ;;
  esac
done
if step ops; then
  try "$BIN/cuda_check" ops
  # The kernels of other GPUs, on this one.
  HARMONY_CUDA=plain try "$BIN/cuda_check" ops
fi
wait
for net in $nets; do [ -e "$DATA/$net/done" ] || { failed="$failed; outputs of $net"; tail -3 "$DATA/$net/log"; }; done
vggt=("$DATA/vggt/vggt_full_weights.safetensors" "$DATA/vggt/vggt_full_expected.safetensors")
if step parity; then
  if wanted vggt; then try "$BIN/cuda_check" vggt "${vggt[@]}"; fi
  for net in ${nets//vggt/}; do for device in cuda-f32 cuda; do try "$BIN/image_nets" parity "$net" "$DATA/$net" "$device"; done; done
fi
if step time; then
  if wanted vggt; then
    try "$BIN/cuda_check" time "${vggt[@]}" 1 8 32
    try "$BIN/cuda_check" first "${vggt[@]}"
  fi
  for net in sam2_large owlv2_base owlv2_large clip; do
    if wanted "$net"; then try "$BIN/image_nets" time "$net" "$DATA/$net" 10 cuda; fi
  done
fi
if step profile; then
  if wanted vggt; then for count in 1 8 32; do try "$BIN/cuda_check" profile "${vggt[@]}" "$count"; done; fi
  for net in sam2_large owlv2_base; do
    if wanted "$net"; then try "$BIN/image_nets" profile "$net" "$DATA/$net" 1 cuda; fi
  done
fi
peer() { py "$SCRIPTS/gpu_peer.py" "$@"; }
export -f peer py
export PYTHON SCRIPTS
if step peer; then
  if wanted vggt; then try bash -c 'peer "$@"' - vggt "$VGGT" "$DATA/vggt" 1 8 32; fi
  if wanted sam2_large; then try bash -c 'peer "$@"' - sam2 "$DATA/sam2_large"; fi
  for size in base large; do
    if wanted "owlv2_$size"; then try bash -c 'peer "$@"' - owlv2 "$size" "$DATA/owlv2_$size"; fi
  done
  if wanted clip; then try bash -c 'peer "$@"' - clip "$DATA/clip"; fi
fi
if step compiled; then try bash -c 'peer "$@"' - compiled "$VGGT" "$DATA/vggt"; fi
if [ -n "$failed" ]; then echo "failed$failed"; exit 1; fi
