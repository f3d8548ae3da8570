#!/usr/bin/env bash
# From a fresh Debian machine to a mesh and a picture of it: installs what is needed, builds a release, writes a
# CT-like head of 256^3 voxels, builds its pyramid, draws the whole skull, and extracts the bone around a focus
# point, coarser with distance. Safe to run again.
#   tools/quickstart.sh [FOLDER]        default: quickstart-out
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-quickstart-out}
tools/install_packages.sh build
mkdir -p build
cmake --preset release -DISOBRICK_TESTS=OFF >build/quickstart-configure.log 2>&1 ||
  { cat build/quickstart-configure.log; exit 1; }
cmake --build --preset release --parallel "$(nproc)" --target isobrick
isobrick=build/release/isobrick
mkdir -p "$out"

echo; echo "== a volume"
"$isobrick" phantom head --voxels 256 -o "$out/head.nrrd" --force
echo; echo "== its pyramid"
"$isobrick" build "$out/head.nrrd" -o "$out/head.isb" --force
echo; echo "== a picture of all of it: skin, translucent, over bone"
cat >"$out/skull.view.json" <<'JSON'
{"surfaces": [{"isovalue": 530, "color": [0.86, 0.62, 0.52], "opacity": 0.3},
              {"isovalue": 1160, "color": [0.93, 0.9, 0.82]}],
 "focus": {"everywhere": true}, "show_box": false, "ambient_occlusion": true,
 "background_top": [1, 1, 1], "background_bottom": [1, 1, 1],
 "camera": {"pivot": [128, 128, 122], "azimuth": 40, "elevation": 10, "distance": 500}}
JSON
"$isobrick" render "$out/head.isb" --state "$out/skull.view.json" -o "$out/skull.png" --force
echo; echo "== the bone around a focus point, coarser with distance, and its levels in colours"
"$isobrick" extract "$out/head.isb" --iso 1324 --focus 150,60,150 --radius 40 -o "$out/bone.ply" --force
"$isobrick" render "$out/head.isb" --iso 1324 --focus 150,60,150 --radius 40 --color-by-level -o "$out/levels.png" --force
echo
echo "mesh:     $out/bone.ply"
echo "pictures: $out/skull.png, $out/levels.png"
