#!/usr/bin/env bash
# The ten pictures of docs/gallery.md: tools/gallery.sh [DATA] [OUT]
# DATA: the folder of the scans whose licence allows pictures (default: ../shared/data); OUT: a folder
# for the pictures (default: docs/figures). $ISOBRICK is the command (default: build/release/isobrick).
set -euo pipefail
cd "$(dirname "$0")/.."
data=${1:-../shared/data} out=${2:-docs/figures}
isobrick=${ISOBRICK:-build/release/isobrick}
cache=$(mktemp -d)
trap 'rm -rf "$cache"' EXIT

# picture NAME VOLUME OPTION...
picture() {
  local name=$1 volume=$2
  shift 2
  "$isobrick" render "$volume" "$@" --size 640x480 --cache-folder "$cache" --force -o "$out/gallery-$name.png"
}
# A view: the options that a picture of one surface does not have.
view() { printf '{%s, "focus": {"everywhere": true}, "show_box": false, "background_top": [1, 1, 1], "background_bottom": [1, 1, 1]}' "$1" >"$cache/view.json"; }

head=$data/vhf_head_ct/vhf_head.nrrd
picture bone "$head" --iso 1250 --ambient-occlusion --shadow --background white --azimuth 30
view '"surfaces": [{"isovalue": 500, "color": [0.86, 0.62, 0.52], "opacity": 0.35},
                   {"isovalue": 1250, "color": [0.93, 0.9, 0.82]}],
      "camera": {"pivot": [256, 240, 120], "azimuth": 30, "elevation": 12, "distance": 620}'
picture skin-and-bone "$head" --state "$cache/view.json"
picture pieces "$head" --iso 1250 --color-by-component --legend --background white --azimuth 25
view '"surfaces": [{"isovalue": 1250, "color": [0.93, 0.9, 0.82]}],
      "clip_planes": [{"normal": [-1, 0, 0], "offset": -256, "enabled": true, "cap": true}],
      "ambient_occlusion": true, "camera": {"pivot": [256, 240, 120], "azimuth": 60, "elevation": 15, "distance": 560}'
picture cut "$head" --state "$cache/view.json"
picture focus "$head" --iso 500 --focus 256,130,110 --radius 40 --color-by-level --wireframe --background light --azimuth 10
view '"surfaces": [{"isovalue": 520, "color": [0.8, 0.84, 0.9], "opacity": 0.3},
                   {"isovalue": 1000, "color": [0.96, 0.93, 0.85]}],
      "camera": {"pivot": [51, 47, 80], "azimuth": 40, "elevation": 10, "distance": 340}'
picture tooth "$data/tooth_u16be/tooth.nhdr" --state "$cache/view.json"
picture enamel "$data/tooth_u16be/tooth.nhdr" --iso 1000 --shadow --ambient-occlusion --scale-bar --background light --azimuth 40
picture mr "$data/mr_nifti/MR.nii.gz" --iso 130 --ambient-occlusion --background white --azimuth 50
picture gyroid phantom:gyroid:128 --iso auto --shadow --ambient-occlusion --background white
picture phantom phantom:head:256 --iso 1324 --shadow --axes --background light
