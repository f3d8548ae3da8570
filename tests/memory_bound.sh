#!/usr/bin/env bash
# Builds a pyramid inside a memory cgroup, which kills a process that holds more than the limit,
# file pages and buffers together:
#
#   memory_bound.sh ISOBRICK LIMIT_MIB INPUT [BUILD OPTIONS...]
#
# INPUT is a file or a folder; or gyroid:N for an N^3 uint8 phantom, or tiled:X,Y,Z for raw uint8
# voxels of these dimensions (the voxels of a phantom over and over). They are made, and the pyramid
# is written, in $ISOBRICK_WORK (default: the system's folder for temporary files).
# Exit status: 0 built and verified, 77 not possible here (says why), else failed.
set -euo pipefail

isobrick=$1 limit_mib=$2 input=$3
shift 3
skip() { echo "skipped: $*"; exit 77; }

work=$(mktemp -d "${ISOBRICK_WORK:-${TMPDIR:-/tmp}}/isobrick-memory-XXXXXX")
group=""
cleanup() {
  rm -rf "$work"
  [ -z "$group" ] || rmdir "$group" 2>/dev/null || true
}
trap cleanup EXIT

# A group of our own, in version 1 or 2 of the interface.
make_group() {
  local v1=/sys/fs/cgroup/memory/isobrick-$$ v2=/sys/fs/cgroup/isobrick-$$
  if [ -d /sys/fs/cgroup/memory ] && mkdir "$v1" 2>/dev/null; then
    group=$v1
    echo "$((limit_mib << 20))" >"$v1/memory.limit_in_bytes"
    peak_file=$v1/memory.max_usage_in_bytes
  elif grep -qw memory /sys/fs/cgroup/cgroup.subtree_control 2>/dev/null && mkdir "$v2" 2>/dev/null; then
    group=$v2
    echo "$((limit_mib << 20))" >"$v2/memory.max" 2>/dev/null || skip "no memory limit can be set"
    echo 0 >"$v2/memory.swap.max" 2>/dev/null || true
    peak_file=$v2/memory.peak
  else
    skip "no memory cgroup can be made here"
  fi
}

make_input() {
  case $input in
    gyroid:*)
      "$isobrick" phantom gyroid --size "${input#gyroid:}" -o "$work/input.mhd" >/dev/null
      input=$work/input.mhd ;;
    tiled:*)
      local dims=${input#tiled:} x y z
      IFS=, read -r x y z <<<"$dims"
      "$isobrick" phantom gyroid --size 256 -o "$work/tile.raw" >/dev/null
      while cat "$work/tile.raw"; do :; done 2>/dev/null | head -c "$((x * y * z))" >"$work/input.raw"
      rm "$work/tile.raw"
      input=$work/input.raw
      set_options=(--raw-dims "$dims" --raw-type u8) ;;
    *) [ -e "$input" ] || skip "'$input' is missing" ;;
  esac
}

set_options=()
make_group
make_input
# What was just written must not count: only the build's own pages are to be in the group.
echo "limit $limit_mib MiB: isobrick build $(basename "$input") ${set_options[*]-} $*"
begin=$(date +%s.%N)
bash -c 'echo $$ >"$0/cgroup.procs" && exec "$@"' "$group" \
  "$isobrick" build "$input" "${set_options[@]}" -o "$work/out.isb" "$@"
end=$(date +%s.%N)
echo "peak of the group, page cache included: $(($(cat "$peak_file") >> 20)) MiB;" \
  "$(awk "BEGIN {print $end - $begin}") s"
[ ! -e "$group/memory.failcnt" ] || echo "times that pages had to be given back: $(cat "$group/memory.failcnt")"
"$isobrick" verify "$work/out.isb" | sed "s|$work/||"
