#!/usr/bin/env bash
# The moving picture of the README: the isovalue goes from skin to bone, a plane cuts the skull, and all back.
#   tools/moving_picture.sh [DATA] [OUT]
# DATA: the folder of the scans (default: ../shared/data); OUT: default docs/figures/head.gif. $ISOBRICK is the command
# (default: build/release/isobrick), $PYTHON one that has Pillow (default: that of tools/test.sh python).
set -euo pipefail
cd "$(dirname "$0")/.."
data=${1:-../shared/data} out=${2:-docs/figures/head.gif}
isobrick=${ISOBRICK:-build/release/isobrick} python=${PYTHON:-build/python/venv/bin/python}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# stop NAME ISOVALUE COLOUR PLANE AZIMUTH: a view on the way; the plane cuts away x above PLANE.
stop() {
  cat >"$work/$1.json" <<VIEW
{"surfaces": [{"isovalue": $2, "color": $3}], "focus": {"everywhere": true}, "show_box": false,
 "clip_planes": [{"normal": [-1, 0, 0], "offset": -$4, "enabled": true, "cap": true}],
 "background_top": [1, 1, 1], "background_bottom": [1, 1, 1], "ambient_occlusion": true,
 "camera": {"pivot": [250, 250, 112], "azimuth": $5, "elevation": 10, "distance": 470}}
VIEW
}
skin='[0.88, 0.66, 0.56]' bone='[0.93, 0.9, 0.82]'
stop skin 500 "$skin" 420 20
stop bone 1250 "$bone" 420 50
stop cut 1250 "$bone" 256 75
"$isobrick" render "$data/vhf_head_ct/vhf_head.nrrd" --cache-folder "$work" --size 400x340 --frames 20 -o "$work/frames/%04d.png" \
  --state "$work/skin.json" --state "$work/bone.json" --state "$work/cut.json"
"$python" - "$work/frames" "$out" <<'PYTHON'
import sys
from pathlib import Path

from PIL import Image

frames = [Image.open(path).convert("RGB") for path in sorted(Path(sys.argv[1]).glob("*.png"))]
sheet = Image.new("RGB", (frames[0].width, frames[0].height * len(frames)))
for number, frame in enumerate(frames):
    sheet.paste(frame, (0, number * frame.height))
palette = sheet.quantize(80)  # one for all, so that what stands still does not flicker
first, *others = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames + frames[-2:0:-1]]
first.save(sys.argv[2], save_all=True, append_images=others, duration=110, loop=0)
PYTHON
ls -l "$out"
