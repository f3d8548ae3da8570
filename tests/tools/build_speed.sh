#!/usr/bin/env bash
# The time of `isobrick build` beside that of `dd conv=fdatasync` writing as many bytes, in turn, so
# that both meet the same machine:
#
#   build_speed.sh ISOBRICK INPUT [ROUNDS] [BUILD OPTIONS...]
#
# For every codec, with and without curvature: the median seconds of both, their ratio, and the
# least ratio of a round. Works in $ISOBRICK_WORK (default: the current folder); the input is read
# once before, so that it is warm.
set -euo pipefail

isobrick=$1 input=$2 rounds=${3:-5}
shift $(($# < 3 ? $# : 3))
work=$(mktemp -d "${ISOBRICK_WORK:-.}/isobrick-speed-XXXXXX")
trap 'rm -rf "$work"' EXIT

now() { date +%s.%N; }
seconds_of() {
  local begin end
  begin=$(now)
  "$@" >/dev/null 2>&1
  end=$(now)
  awk "BEGIN {printf \"%.4f\", $end - $begin}"
}
median() { sort -n | awk '{v[NR] = $1} END {print (v[int((NR + 1) / 2)] + v[int(NR / 2) + 1]) / 2}'; }

cat "${input%.*}"* >/dev/null
printf '%-6s %-10s %10s %9s %9s %7s %7s\n' codec curvature bytes build dd ratio least
for curvature in no yes; do
  for codec in none lz4 zstd; do
    options=(--codec "$codec" "$@")
    [ $curvature = yes ] || options+=(--no-curvature)
    : >"$work/builds" && : >"$work/dds" && : >"$work/ratios"
    for ((round = 0; round < rounds; ++round)); do
      # To free the blocks of an older file takes as long as to write them; neither is to pay for it.
      rm -f "$work/out.isb"
      build=$(seconds_of "$isobrick" build "$input" -o "$work/out.isb" "${options[@]}")
      bytes=$(stat -c %s "$work/out.isb")
      # The pyramid itself is what dd copies: warm, and not only zeros.
      rm -f "$work/dd"
      dd=$(seconds_of dd if="$work/out.isb" of="$work/dd" bs=1M conv=fdatasync)
      rm -f "$work/dd"
      echo "$build" >>"$work/builds"
      echo "$dd" >>"$work/dds"
      awk "BEGIN {print $build / $dd}" >>"$work/ratios"
    done
    printf '%-6s %-10s %10d %9.3f %9.3f %7.2f %7.2f\n' "$codec" "$curvature" "$bytes" \
      "$(median <"$work/builds")" "$(median <"$work/dds")" "$(median <"$work/ratios")" \
      "$(sort -n "$work/ratios" | head -1)"
  done
done
