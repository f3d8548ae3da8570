#!/usr/bin/env bash
# Kills a build with SIGKILL at random moments, goes on with --resume, and compares the pyramid with
# that of an undisturbed build:
#
#   kill_resume.sh ISOBRICK INPUT [ROUNDS] [BUILD OPTIONS...]
#
# Each round kills one to three times, every time at another moment of the build. Works in
# $ISOBRICK_WORK (default: the current folder).
set -euo pipefail

isobrick=$1 input=$2 rounds=${3:-50}
shift $(($# < 3 ? $# : 3))
work=$(mktemp -d "${ISOBRICK_WORK:-.}/isobrick-kill-XXXXXX")
trap 'rm -rf "$work"' EXIT

begin=$(date +%s%N)
"$isobrick" build "$input" -o "$work/whole.isb" "$@" >/dev/null
milliseconds=$((($(date +%s%N) - begin) / 1000000))
kills=0 resumed=0 same=0
for ((round = 1; round <= rounds; ++round)); do
  rm -f "$work"/a.isb*
  for ((kill = 0; kill < 1 + round % 3; ++kill)); do
    "$isobrick" build "$input" -o "$work/a.isb" --resume "$@" >/dev/null 2>&1 &
    pid=$!
    sleep "$(awk "BEGIN {srand($RANDOM + $round); printf \"%.3f\", rand() * $milliseconds / 1000}")"
    kill -KILL $pid 2>/dev/null && kills=$((kills + 1))
    wait $pid 2>/dev/null || true
  done
  [ ! -e "$work/a.isb" ] || rm "$work/a.isb"  # it was faster than the kill
  "$isobrick" build "$input" -o "$work/a.isb" --resume --json "$@" >"$work/json"
  grep -q '"bricks_resumed": 0' "$work/json" || resumed=$((resumed + 1))
  cmp "$work/whole.isb" "$work/a.isb" && same=$((same + 1))
  [ "$(ls "$work" | grep -c partial)" = 0 ] || { echo "a temporary was left"; exit 1; }
done
echo "an undisturbed build takes $milliseconds ms; $kills kills in $rounds rounds, $resumed resumed," \
  "$same the same bytes"
[ $same = "$rounds" ]
