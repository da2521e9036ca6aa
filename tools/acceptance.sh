#!/usr/bin/env bash
# Replays the bundled example with the built program and lets outside judges look at the result: the Khronos validator,
# three.js in Chromium, Blender; a user study in Chromium, its server under kills, a gallery, a data set read by Python.
# Needs tools/setup.sh; HARMONY_LIT=0 leaves the path-traced render out.
set -euo pipefail
cd "$(dirname "$0")/.."
bin="${HARMONY_BIN:-target/release/harmony}"
cache="${HARMONY_CACHE:-$HOME/.cache/harmony}"
bpy="$cache/bpy/bin/python"
out="$(mktemp -d)"
trap 'rm -rf "$out"' EXIT
passed=0
check() { echo "acceptance: $1"; shift; "$@"; passed=$((passed + 1)); }
example=("$bin" reconstruct examples/home_office.jpg --out "$out/run" --replay examples/home_office_recording)
[ "${HARMONY_LIT:-1}" = 1 ] || example+=(--no-lit)
# Seconds and peak memory of a command, for the log.
measured() {
  if [ -x /usr/bin/time ]; then /usr/bin/time -f "acceptance: %e s, %M KiB at most" "$@"; else time "$@"; fi
}

check "the bundled example replays" measured "${example[@]}"
second() {
  local said
  said="$("${example[@]}")"
  case "$said" in *"finished already"*) ;; *) echo "$said"; return 1 ;; esac
}
check "a second run finds nothing to do" second
check "Khronos validator" node tools/validate_glb.mjs "$out/run/scene_full.glb"

# Extents and ids as the run's own files say; the judges find them in the GLB.
extents="$("$bpy" -c 'import json,sys; e = json.load(open(sys.argv[1]))["room"]["extents"]; print(e["width"], e["height"], e["depth"], sep=",")' "$out/run/scene.json")"
nodes="$("$bpy" -c 'import json,sys; print(*[o["id"] for o in json.load(open(sys.argv[1]))["objects"]], sep=",")' "$out/run/scene.json")"
check "three.js opens the scene" node tools/view_glb.mjs "$out/run/scene_full.glb" --extents "$extents" --nodes "$nodes"
check "the report page works by itself" node tools/report_shots.mjs "$out/run/report.html" "$out/shots"
check "the renderer's ids" "$bin" render "$out/run" --camera input --ids "$out/ids.png" --out "$out/input.png"
check "Blender opens the scene, and its view through camera.json is ours" "$bpy" tools/bpy_open.py \
  "$out/run/scene_full.glb" --extents "$extents" --nodes "$nodes" --camera "$out/run/camera.json" \
  --ids "$out/ids.png" --scene "$out/run/scene.json" --min-iou 0.98
check "a participant's session with a user study, from consent to submission" \
  node tools/study_session.mjs "$bin" "$out/study" "$out/study_shots"
check "answers that were acknowledged survive kills" \
  node tools/study_load.mjs "$bin" "$out/study/site" "$out/study/load.jsonl"
check "a gallery" "$bin" gallery "$out/run" --out "$out/gallery" --frames 8
dataset() {
  "$bin" dataset init "$out/rooms" --name example --licence CC0-1.0 --description "The bundled example."
  "$bpy" - "$out/rooms/dataset.json" "$out/run" <<'PY'
import json, sys
path, run = sys.argv[1:]
config = json.load(open(path))
players = {card["player"] for _, card in json.load(open(run + "/run.json"))["cast"]}
sources = {o["mesh_source"] for o in json.load(open(run + "/scene.json"))["objects"]}
own = {"licence": "CC0-1.0", "url": "https://creativecommons.org/publicdomain/zero/1.0/", "redistributable": True}
config["makers"].update({maker: own for maker in players | sources})
json.dump(config, open(path, "w"), indent=2)
PY
  "$bin" dataset add "$out/rooms" "$out/run" --split easy --source own --licence CC0-1.0 --retrieved-at 2026-01-01
  "$bin" dataset check "$out/rooms"
  "$bin" dataset build "$out/rooms" --out "$out/release"
  "$bin" dataset check "$out/release"
  "$cache/checkers/bin/python" tools/read_dataset.py "$out/release"
}
check "a data set is released, and Python reads it" dataset
echo "$passed passed, 0 failed"
