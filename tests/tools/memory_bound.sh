#!/usr/bin/env bash
# Builds a pyramid inside a memory cgroup, which kills a process that holds more than the limit,
# file pages and buffers together; where no group can be made, the process's own peak is compared
# with the limit:
#
#   memory_bound.sh ISOBRICK LIMIT_MIB INPUT [BUILD OPTIONS...]
#
# INPUT is a file or a folder; or gyroid:N for an N^3 uint8 phantom, gzip:N and dicom:N for a head of
# N^3 voxels as a packed NRRD or a DICOM series (by $WRITE_HEAD), or tiled:X,Y,Z for raw uint8 voxels of
# these dimensions (the voxels of a phantom over and over). They are made, and the pyramid is written,
# in $ISOBRICK_WORK (default: the system's folder for temporary files).
# Exit status: 0 built and verified, else failed.
set -euo pipefail

isobrick=$1 limit_mib=$2 input=$3
shift 3

source "$(dirname "$0")/memory_group.sh"

make_input() {
  case $input in
    gyroid:*)
      "$isobrick" phantom gyroid --voxels "${input#gyroid:}" -o "$work/input.mhd" >/dev/null
      input=$work/input.mhd ;;
    tiled:*)
      local dims=${input#tiled:} x y z
      IFS=, read -r x y z <<<"$dims"
      "$isobrick" phantom gyroid --voxels 256 -o "$work/tile.raw" >/dev/null
      while cat "$work/tile.raw"; do :; done 2>/dev/null | head -c "$((x * y * z))" >"$work/input.raw"
      rm "$work/tile.raw"
      input=$work/input.raw
      set_options=(--raw-dims "$dims" --raw-type u8) ;;
    gzip:*)
      "$WRITE_HEAD" gzip "${input#gzip:}" "$work/input.nrrd"
      input=$work/input.nrrd ;;
    dicom:*)
      mkdir "$work/input"
      "$WRITE_HEAD" dicom "${input#dicom:}" "$work/input"
      input=$work/input ;;
  esac
}

set_options=()
make_group "$limit_mib"
[ -n "$group" ] ||
  echo "no memory cgroup can be made here: the peak of the process is compared instead"
make_input
echo "limit $limit_mib MiB: isobrick build $(basename "$input") ${set_options[*]-} $*"
begin=$(date +%s.%N)
status=0
in_group "$isobrick" build "$input" "${set_options[@]}" -o "$work/out.isb" "$@" --json \
  >"$work/json" || status=$?
end=$(date +%s.%N)
[ "$status" = 0 ] || { echo "the build failed with status $status (137: killed for its memory)"; exit 1; }
peak=$(sed -n 's/.*"peak_rss_bytes": *\([0-9]*\).*/\1/p' "$work/json")
sed -n 's/^ *"phases": */busy: /p' "$work/json"
echo "$(awk "BEGIN {printf \"%.1f\", $end - $begin}") s; peak of the process $((peak >> 20)) MiB"
if [ -n "$group" ]; then
  echo "peak of the group, page cache included: $(($(cat "$peak_file") >> 20)) MiB"
elif [ "$((peak >> 20))" -gt "$((limit_mib + 32))" ]; then
  # Pages of code and libraries count here, though the system can take them back at any time.
  echo "the process held more than $((limit_mib + 32)) MiB"
  exit 1
fi
"$isobrick" verify "$work/out.isb" | sed "s|$work/||"
