#!/usr/bin/env bash
# Remakes the results of the paper with isobrick, and writes them into docs/PAPER.md:
#   tools/reproduce.sh [FOLDER]
# FOLDER keeps pyramids, results (one JSON file a step) and pictures; default: build/reproduce. A step
# whose result is there is left out, so a run that was stopped goes on. It takes some minutes.
# ISOBRICK_DATA: the real volumes (../shared/data). Without them the steps that need them are left out,
# and the page goes to FOLDER, not to docs.
# ISOBRICK_BUILD: a build folder with tests (build/release, which is configured if it is missing).
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-build/reproduce}
data=${ISOBRICK_DATA:-../shared/data}
build=${ISOBRICK_BUILD:-build/release}
head_ct=$data/vhf_head_ct/vhf_head.nrrd
mkdir -p "$folder"/{pyramids,results,pictures}
made=0 kept=0 left_out=0
SECONDS=0

say() { printf '%4d s  %s\n' "$SECONDS" "$*"; }

# result NAME COMMAND...: what the command prints becomes results/NAME.json.
result() {
  local file=$folder/results/$1.json
  shift
  if [ -s "$file" ]; then
    kept=$((kept + 1))
    return
  fi
  say "$(basename "$file" .json)"
  "$@" >"$file.part"
  mv "$file.part" "$file"
  made=$((made + 1))
}

# picture NAME OPTION...: a picture of a surface by `isobrick render`, which writes it whole or not at all.
picture() {
  local file=$folder/pictures/paper-$1.png
  shift
  if [ -s "$file" ]; then
    kept=$((kept + 1))
    return
  fi
  say "picture $(basename "$file")"
  "$isobrick" render "$@" -o "$file" >/dev/null
  made=$((made + 1))
}

# pyramid NAME INPUT OPTION...: pyramids/NAME.isb, which `isobrick build` leaves alone if it is up to date.
pyramid() {
  local file=$folder/pyramids/$1.isb
  shift
  "$isobrick" build "$@" -o "$file" >/dev/null
}

# crop NAME INPUT BOX: pyramids/NAME.nrrd and its pyramid.
crop() {
  local file=$folder/pyramids/$1.nrrd
  [ -s "$file" ] || "$isobrick" convert "$2" --box "$3" -o "$file" >/dev/null
  pyramid "$1" "$file"
}

# Times of one query and of the finest surface, on one thread as in the paper: medians of 15, in 5 processes.
bench() { "$isobrick" bench "$@" --threads 1 --rows isobrick,isobrick-adaptive --no-distances --json; }

# ---- Building ------------------------------------------------------------------------------------

[ -f "$build/CMakeCache.txt" ] || cmake --preset release -B "$build" >"$folder/configure.log"
say "building in $build"
cmake --build "$build" --parallel "$(nproc)" --target isobrick isobrick-build paper_figures \
  >"$folder/build.log" || { tail -20 "$folder/build.log"; exit 1; }
isobrick=$build/isobrick
figures=$build/tests/house/paper_figures

# The last change of the code: results of another one must not stand beside these.
code=(CMakeLists.txt cmake storage preprocess extract viewer tools tests)
commit=$(git log -1 --format=%h -- "${code[@]}")
git diff --quiet HEAD -- "${code[@]}" || commit+=" and changes"
if [ "$(cat "$folder/commit" 2>/dev/null || echo "$commit")" != "$commit" ]; then
  echo "$folder has results of commit $(cat "$folder/commit"), and this is $commit: remove it, or name another folder" >&2
  exit 1
fi
echo "$commit" >"$folder/commit"

describeMachine() {
  printf '{"processor": "%s", "cores": %d, "memory_gib": %d, "commit": "%s", "version": "%s", "date": "%s"}\n' \
    "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1)" "$(nproc)" \
    "$(awk '/MemTotal/ {print int($2 / 1048576 + 0.5)}' /proc/meminfo)" "$commit" \
    "$("$isobrick" --version)" "$(date +%F)"
}
result machine describeMachine

# ---- Figure 2: average against subsampled pyramid ------------------------------------------------

# figure2 NAME INPUT ISOVALUE LEVELS
figure2() {
  local name=$1 input=$2 iso=$3 filter level
  for filter in average subsample; do
    pyramid "$name-$filter" "$input" --filter $filter
    for level in $4; do
      result "figure2-$name-$filter-$level" \
        "$isobrick" extract "$folder/pyramids/$name-$filter.isb" --iso "$iso" --level "$level" --components --json
    done
  done
}
figure2 phantom phantom:head:64 1240 "1 2"
if [ -f "$head_ct" ]; then
  figure2 ct "$head_ct" 1250 "0 1 2 3 4"
  for filter in average subsample; do
    picture figure2-$filter "$folder/pyramids/ct-$filter.isb" --iso 1250 --level 3 --size 400x400
  done
else
  say "left out: figures 2, 9 and 11 of the CT, the frames and half of figure 7: $head_ct is not there;"
  say "  set ISOBRICK_DATA to the folder of vhf_head_ct"
  left_out=1
fi

# ---- Figures 3 and 6: a crack, and its fan -------------------------------------------------------

pyramid sphere phantom:sphere:33
result figure3 "$figures" meshes "$folder/pyramids/sphere.isb" --iso 0 --focus 36,0,16 --radius 0 \
  --pictures "$folder/pictures/paper-figure3" --azimuth -60 --elevation 25 --box 15,4,17,17,8,23

# ---- Figure 5: the conforming split --------------------------------------------------------------

pyramid torus106 phantom:torus:106
for radius in 100 40 20; do
  tolerance=$(awk "BEGIN {print 0.5 / $radius / $radius}")
  look=()
  [ $radius -ne 40 ] ||
    look=(--pictures "$folder/pictures/paper-figure5" --azimuth 10 --elevation 40 --box '52,6,50,62,16,62')
  result figure5-curvature$radius \
    "$figures" meshes "$folder/pyramids/torus106.isb" --iso 0 --curvature "$tolerance" "${look[@]}"
  result figure5-curvature$radius-command \
    "$isobrick" extract "$folder/pyramids/torus106.isb" --iso 0 --curvature "$tolerance" --json
done
for radius in 5 40; do
  result figure5-focus$radius \
    "$figures" meshes "$folder/pyramids/torus106.isb" --iso 0 --focus 80,50,53 --radius $radius
  result figure5-focus$radius-command \
    "$isobrick" extract "$folder/pyramids/torus106.isb" --iso 0 --focus 80,50,53 --radius $radius --json
done

# ---- Figure 8: curvature tolerance ---------------------------------------------------------------

pyramid torus64 phantom:torus:64
query=("$folder/pyramids/torus64.isb" --iso 0 --focus '50,32,32' --radius 16)
for radius in 0 18 13 12; do
  tolerance=(--curvature-radius "$radius")
  [ $radius -ne 0 ] || tolerance=(--curvature 0)
  result figure8-$radius "$isobrick" extract "${query[@]}" "${tolerance[@]}" --json
  picture figure8-$radius "${query[@]}" "${tolerance[@]}" \
    --size 400x320 --wireframe --color-by-level --elevation 50
done

# ---- Figures 7, 9 and 11, and frames, on the CT --------------------------------------------------

result figure7-torus "$figures" cells "$folder/pyramids/torus64.isb" --at 54,32,32
pyramid marschner phantom:marschner-lobb:64
result figure7-marschner "$figures" cells "$folder/pyramids/marschner.isb" --at 40,34,32

# focus NAME PYRAMID ISOVALUE POINT RADII: the finest surface, and one around the point for each radius.
focus() {
  local name=$1 file=$folder/pyramids/$2.isb iso=$3 radius
  for radius in $5; do
    result "$name-$radius" bench "$file" --iso "$iso" --focus "$4" --radius "$radius"
  done
}
if [ -f "$head_ct" ]; then
  crop ct256 "$head_ct" 128,128,106,383,383,233
  crop ct512 "$head_ct" 0,0,106,511,511,233
  result figure7-bone "$figures" cells "$folder/pyramids/ct256.isb" --at 128,34,60
  result figure7-brain "$figures" cells "$folder/pyramids/ct256.isb" --at 128,110,70
  focus figure9 ct256 1250 128,40,30 "10 20 40 80"
  focus figure11 ct512 1000 256,168,30 "15 40 80"
  for radius in 10 20 400; do
    picture figure9-$radius "$folder/pyramids/ct256.isb" --iso 1250 --focus 128,40,30 --radius $radius \
      --show-focus --size 400x320 --azimuth 15 --elevation 5
  done
  for radius in 15 80 400; do
    picture figure11-$radius "$folder/pyramids/ct512.isb" --iso 1000 --focus 256,168,30 --radius $radius \
      --show-focus --size 400x320 --azimuth 15 --elevation 5
  done
  result frames-fixed "$figures" frames "$folder/pyramids/ct512.isb" --least 1000 --greatest 1000
  result frames-changing "$figures" frames "$folder/pyramids/ct512.isb" --least 900 --greatest 1300
fi

# As many triangles as in the paper's Figure 11, on a volume of its size.
if [ ! -s "$folder/pyramids/gyroid.isb" ]; then
  "$isobrick" phantom gyroid --voxels 512 -o "$folder/pyramids/gyroid512.nrrd" --force >/dev/null
  crop gyroid "$folder/pyramids/gyroid512.nrrd" 0,0,0,511,511,127
  rm "$folder/pyramids/gyroid512.nrrd"
fi
focus figure11-gyroid gyroid 128 256,256,64 "29 97 155"

# ---- Overheads (Sect. 2 and 5) -------------------------------------------------------------------

for type in u8 u16; do
  pyramid overhead-$type phantom:gyroid:257:$type --codec none
  result overhead-$type "$isobrick" info "$folder/pyramids/overhead-$type.isb" --json
done

# ---- The page ------------------------------------------------------------------------------------

page=docs/PAPER.md
[ $left_out -eq 0 ] || page=$folder/PAPER.md
python3 tools/paper_page.py "$folder" docs/PAPER.md "$page"
say "$made results and pictures were made, $kept were there; the page is $page"
