#!/usr/bin/env bash
# Makes the pictures and the counts of docs/ALGORITHM.md in docs/figures, with an isobrick that is
# built already:  docs/figures.sh [path of isobrick]
set -euo pipefail
cd "$(dirname "$0")/.."
isobrick=${1:-build/release/isobrick}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
look=(--size 400x400)

echo "Figure 2: average against subsampled pyramid, head of 64^3, skin, level 2 everywhere"
"$isobrick" phantom head --voxels 64 -o "$work/head.nrrd"
for filter in average subsample; do
  "$isobrick" build "$work/head.nrrd" -o "$work/head.isb" --filter $filter --force >/dev/null
  "$isobrick" render "$work/head.isb" --iso 500 --level 2 "${look[@]}" -o docs/figures/figure2-$filter.png --force
done

echo "Figure 8: growing curvature tolerance, torus of 64^3, focus on its right side"
"$isobrick" phantom torus --voxels 64 -o "$work/torus.nrrd"
"$isobrick" build "$work/torus.nrrd" -o "$work/torus.isb" >/dev/null
query=(--iso 0 --focus 50,32,32 --radius 16)
look+=(--wireframe --color-by-level --elevation 50)
"$isobrick" render "$work/torus.isb" "${query[@]}" "${look[@]}" --curvature 0 -o docs/figures/figure8-zero.png --force
for radius in 20 10 5; do
  "$isobrick" render "$work/torus.isb" "${query[@]}" --curvature-radius $radius "${look[@]}" \
    -o docs/figures/figure8-radius$radius.png --force
done
