#!/usr/bin/env bash
# Networks on the CPU, two threads, f32: ours and PyTorch in turn within one run, wall-clock and processor time, peak memory;
# and their parity at full size. What `cargo xtask parity --rounds N` does, for machines without cargo.
#
#   bench/cpu_nets.sh time|parity NET..    NET: vggt sam2_large clip owlv2_base ..; variables as for gpu_nets.sh
#
#   ROUNDS  passes of each side (default 3); the first warms up
#   CORES   the cores that both sides are kept on (default 0,1)
# DATA must hold what gpu_nets.sh makes.
set -uo pipefail
here="$(cd "$(dirname "$0")/.." && pwd)"
BIN="${BIN:-$here/target/release/examples}"
PYTHON="${PYTHON:-python3}"
DATA="${DATA:-${HARMONY_CACHE:-$HOME/.cache/harmony}/parity-gpu}"
SCRIPTS="${SCRIPTS:-$here/crates/harmony-nets/tests/parity}"
ROUNDS="${ROUNDS:-3}" CORES="${CORES:-0,1}"
export SAM2_REPO="${HARMONY_SAM2:-}" PYTHONUNBUFFERED=1
mode="$1"
shift
grep -m1 'model name' /proc/cpuinfo
pipes="$(mktemp -d)"
trap 'rm -rf "$pipes"' EXIT
for net in "$@"; do
  folder="$DATA/$net" size="${net#*_}"
  vggt=("$DATA/vggt/vggt_full_weights.safetensors" "$DATA/vggt/vggt_full_expected.safetensors")
  case "$net" in
    vggt) ours=("$BIN/parity" "${mode/parity/compare}" "${vggt[@]}")
      theirs=("$SCRIPTS/make_vggt.py" time "${HARMONY_VGGT:-}" "$DATA/vggt" "$ROUNDS") ;;
    sam2_*) theirs=("$SCRIPTS/sam2.py" turns "$size" "$folder") ;;
    owlv2_*) theirs=("$SCRIPTS/owlv2.py" turns "$size" "$folder") ;;
    clip) theirs=("$SCRIPTS/clip.py" turns "$folder") ;;
    *) theirs=() ;;
  esac
  [ "$net" = vggt ] || ours=("$BIN/image_nets" "${mode/time/turns}" "$net" "$folder")
  if [ "$mode" = parity ]; then "${ours[@]}"; continue; fi
  echo "== $net"
  mkfifo "$pipes"/{to,from}_{ours,theirs}
  RAYON_NUM_THREADS=2 taskset -c "$CORES" "${ours[@]}" <"$pipes/to_ours" >"$pipes/from_ours" &
  taskset -c "$CORES" "$PYTHON" -W ignore "${theirs[@]}" <"$pipes/to_theirs" >"$pipes/from_theirs" &
  exec 3>"$pipes/to_ours" 4<"$pipes/from_ours" 5>"$pipes/to_theirs" 6<"$pipes/from_theirs"
  for _ in $(seq "$ROUNDS"); do
    echo >&3 && read -r line <&4 && echo "$line"
    echo >&5 && read -r line <&6 && echo "$line"
  done
  exec 3>&- 4<&- 5>&- 6<&-
  wait
  rm "$pipes"/*
done
