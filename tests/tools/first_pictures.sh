#!/bin/sh
# The first picture of every real volume, and of a head in a scanner's circle whose outside is padding: by `render`, and by
# the viewer with its panel. To look at; nothing is checked.
#   tests/tools/first_pictures.sh DATA_FOLDER OUTPUT_FOLDER [FOLDER_OF_THE_COMMANDS]
# Needs python3 for the padded phantoms, and ImageMagick for the sheet of all.
set -eu
data=$1
out=$2
isobrick=${3:-build/release}/isobrick
mkdir -p "$out"

picture() {
  "$isobrick" build "$2" -o "$out/$1.isb" --no-curvature --rebuild > /dev/null
  "$isobrick" render "$out/$1.isb" --iso auto --size 320x320 -o "$out/$1.png" --force 2> "$out/$1.txt" > /dev/null
  printf '{"size": [960, 640], "steps": [{"wait": "settled"}, {"wait": 0.5}, {"frame": "%s-window.png"}]}' "$1" > "$out/$1.json"
  "$isobrick" view "$out/$1.isb" --offscreen --script "$out/$1.json" --out-dir "$out" --force > /dev/null
  echo "$1: $("$isobrick" info "$out/$1.isb" | sed -n 's/^isovalues *//p')"
}

# head.mhd of int16 with another value outside the circle.
pad() {
  python3 - "$out/head.raw" "$out/$1.raw" "$2" <<'PYTHON'
import array, sys
voxels = array.array("h", open(sys.argv[1], "rb").read())
size = round(len(voxels) ** (1 / 3))
middle = (size - 1) / 2
for i in range(len(voxels)):
    x, y = i % size, i // size % size
    voxels[i] = int(sys.argv[3]) if (x - middle) ** 2 + (y - middle) ** 2 > (0.97 * middle) ** 2 else voxels[i] - 1024
voxels.tofile(open(sys.argv[2], "wb"))
PYTHON
  sed "s/head.raw/$1.raw/" "$out/head.mhd" > "$out/$1.mhd"
}

rm -f "$out/head.mhd" "$out/head.raw"
"$isobrick" phantom head --voxels 128 --type i16 -o "$out/head.mhd" > /dev/null
pad padded_low -2000
pad padded_high 32767
picture vhf_head "$data/vhf_head_ct/vhf_head.nrrd"
picture headsq "$data/headsq_quarter/headsq_quarter.mhd"
picture tooth "$data/tooth_u16be/tooth.nhdr"
picture engine "$data/engine/engine.vti"
picture mr "$data/mr_nifti/MR.nii.gz"
picture aneurism "$data/aneurism/aneurism.vti"
picture fingers "$data/fingers_f32/fingers.vti"
picture smoke "$data/vdb/smoke.vdb"
picture sphere "$data/vdb/sphere.vdb"
picture head "$out/head.mhd"
picture padded_low "$out/padded_low.mhd"
picture padded_high "$out/padded_high.mhd"
if command -v montage > /dev/null; then
  for kind in "" -window; do
    sheet=
    for name in vhf_head headsq tooth engine mr aneurism fingers smoke sphere head padded_low padded_high; do
      sheet="$sheet $name$kind.png"
    done
    # shellcheck disable=SC2086
    (cd "$out" && montage -label '%t' $sheet -tile 4x -geometry 480x+4+4 "sheet$kind.png")
  done
fi
