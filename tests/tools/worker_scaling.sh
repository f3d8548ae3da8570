#!/usr/bin/env bash
# How much faster two processes of one thread are than one: they build the super-bricks of a gyroid, and extract
# its surface in shares. Medians of some rounds in turns; beside them processes of arithmetic alone, which show
# what the machine allows. No test, since the machine has to be quiet.
#   ISOBRICK=build/release/isobrick tests/tools/worker_scaling.sh [SIZE] [SUPER_BRICK] [ROUNDS]
set -euo pipefail
isobrick=$(realpath "${ISOBRICK:-build/release/isobrick}")
size=${1:-512} super_brick=${2:-128} rounds=${3:-5}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
options=(--super-brick "$super_brick" --threads 1)
build() { "$isobrick" build "phantom:gyroid:$size" -o scan.isbs "${options[@]}" --part "$1" >/dev/null; }
extract() { "$isobrick" extract scan.isbs --iso 128 --threads 1 --part "$1/16" -o "$1.isbm" --force >/dev/null; }
arithmetic() { awk 'BEGIN { for (i = 0; i < 5e6; ++i) x += i % 7 }'; }
seconds() { # seconds FILE WORK...
  local start=$EPOCHREALTIME file=$1
  shift
  "$@"
  echo "$EPOCHREALTIME $start" | awk '{ print $1 - $2 }' >>"$file"
}
both() { "$@" 1/2 & "$@" 2/2 & wait; }
shares() { local first; for first in $(seq "$1"); do (for i in $(seq "$first" "$1" 16); do extract "$i"; done) & done; wait; }
twice() { arithmetic & arithmetic; wait; }
once_each() { arithmetic; arithmetic; }
for _ in $(seq "$rounds"); do
  rm -rf scan.isbs
  seconds build.1 build 1/1
  rm -rf scan.isbs
  seconds build.2 both build
  "$isobrick" merge scan.isbs >/dev/null
  seconds extract.1 shares 1
  seconds extract.2 shares 2
  seconds arithmetic.1 once_each
  seconds arithmetic.2 twice
done
for work in build extract arithmetic; do
  paste <(sort -n $work.1) <(sort -n $work.2) | awk -v work=$work -v middle=$(((rounds + 1) / 2)) \
    'NR == middle { printf "%-10s  one %.2f s  two %.2f s  %.2f times as fast\n", work, $1, $2, $1 / $2 }'
done
