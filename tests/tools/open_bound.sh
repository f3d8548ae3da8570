#!/usr/bin/env bash
# Opens the pyramid of SIZE^3 voxels that are all the same and extracts from it, inside a memory
# cgroup of LIMIT_MIB, which kills a process that holds more; where no group can be made, the process's own
# peak is compared with the limit:
#
#   open_bound.sh SIZE LIMIT_MIB
#
# Prints how long the file took to open and what was held. $ISOBRICK and $WRITE_VAST are the programs;
# all is written in $ISOBRICK_WORK (default: the system's folder for temporary files).
# Exit status: 0 within the limit.
set -euo pipefail

size=$1 limit=$2
source "$(dirname "$0")/memory_group.sh"

pyramid=$work/vast.isb
"$WRITE_VAST" "$size" "$pyramid"
echo "a file of $(($(stat -c %s "$pyramid") >> 10)) KiB"
# Pages of the file that are in memory are counted where they came in, which is to be the group.
sync "$pyramid"
dd if="$pyramid" iflag=nocache count=0 status=none
make_group "$limit"
status=0
in_group "$ISOBRICK" extract "$pyramid" --iso 0.5 --memory 1M --json >"$work/report.json" || status=$?
[ "$status" = 0 ] || { echo "failed with status $status (137: killed for its memory)"; exit 1; }
[ -z "$group" ] || echo "in the group at most $(($(cat "$peak_file") >> 20)) of $limit MiB"
field() { sed -n "s/.*\"$1\": *\([0-9.e-]*\).*/\1/p" "$work/report.json" | head -n 1; }
peak=$(($(field peak_rss_bytes) >> 20))
echo "opened in $(field open) s, $(field triangles) triangles, peak of the process $peak MiB"
[ "$(field triangles)" = 0 ]
[ "$peak" -le "$limit" ]
