#!/usr/bin/env bash
# Bundles the report's 3D view into one minified file: crates/harmony-viewer/assets/viewer.js
# Needs npm packages (tools/setup.sh). The result is committed; it changes only when three.js or viewer/ does.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
[ -d node_modules/three ] || npm ci --silent
assets=../crates/harmony-viewer/assets
mkdir -p "$assets"
node_modules/.bin/esbuild viewer/main.js --bundle --minify --format=iife --global-name=HarmonyViewer \
  --target=es2020 --legal-comments=none --charset=ascii --log-level=warning --outfile="$assets/viewer.js.tmp"
version=$(node -p "require('./node_modules/three/package.json').version")
{
  echo "/* Bundled from tools/viewer with three.js $version (MIT, see three.LICENSE). */"
  # A closing tag inside a string would end the page's script element.
  sed 's#</script#<\\/script#g' "$assets/viewer.js.tmp"
} > "$assets/viewer.js"
rm "$assets/viewer.js.tmp"
cp node_modules/three/LICENSE "$assets/three.LICENSE"
size=$(wc -c < "$assets/viewer.js")
echo "viewer.js: $size bytes"
[ "$size" -lt 900000 ] || { echo "viewer.js is larger than 900 kB" >&2; exit 1; }
