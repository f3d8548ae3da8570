#!/usr/bin/env bash
# Explores a pyramid that is larger than the memory for it, inside a memory cgroup of --memory and
# 64 MiB, which kills a process that holds more, file pages and buffers together; where no group can
# be made, the process's own peak is compared with the limit:
#
#   explore_bound.sh SIZE TYPE MEMORY_MIB FULL_MEMORY_MIB
#
# SIZE^3 voxels of TYPE (u8, u16) of the head phantom. 50 random focus queries in one process at
# MEMORY_MIB, mapped and read, must give the same bytes as with memory without bound; the whole of
# level 0 at FULL_MEMORY_MIB must give a closed surface. $ISOBRICK, $EXPLORE and $CHECK_MESH are the
# programs. All is written in $ISOBRICK_WORK (default: the system's folder for temporary files);
# $ISOBRICK_PYRAMID: a pyramid to take rather than make one.
# Exit status: 0 all is as it should be.
set -euo pipefail

size=$1 type=$2 memory_mib=$3 full_memory_mib=$4
isovalues=(60 140) isovalue=82.75
[ "$type" = u8 ] || { isovalues=(400 1100) isovalue=600.5; }
overhead_mib=64

source "$(dirname "$0")/memory_group.sh"

# The greatest sum of what processes of the group hold and map, as it is seen every 20 ms. What the
# kernel keeps of files beside that it takes back when it needs room.
watch_group() {
  local greatest=0 sum name value
  while [ -e "$work/running" ]; do
    sum=0
    while read -r name value; do
      case " $held_lines " in *" $name "*) sum=$((sum + value)) ;; esac
    done <"$group/memory.stat"
    ((sum <= greatest)) || greatest=$sum
    sleep 0.02
  done
  echo "$greatest" >"$work/group_peak"
}

# bounded MEMORY_MIB OUTPUT COMMAND...: runs it in a group; what it says it held at most, which is
# the last "peak_rss_bytes" of its output, must be within the limit, and what the group saw.
bounded() {
  local memory=$1 output=$2 limit=$(($1 + overhead_mib)) status=0 peak watcher=""
  shift 2
  # Pages of the file that are in memory are counted where they came in, which is to be the group.
  dd if="$pyramid" iflag=nocache count=0 status=none
  make_group "$limit"
  if [ -n "$group" ]; then
    touch "$work/running"
    watch_group &
    watcher=$!
  fi
  in_group "$@" >"$output" || status=$?
  rm -f "$work/running"
  [ -z "$watcher" ] || wait "$watcher"
  [ "$status" = 0 ] || { echo "failed with status $status (137: killed for its memory): $*"; exit 1; }
  peak=$(sed -n 's/.*"peak_rss_bytes": *\([0-9]*\).*/\1/p' "$output" | tail -n 1)
  echo "--memory ${memory}M, limit $limit MiB: peak of the process $((peak >> 20)) MiB"
  if [ "$((peak >> 20))" -gt "$limit" ]; then
    echo "the process held more than $limit MiB"
    exit 1
  fi
  [ -n "$group" ] || { echo "  no memory cgroup can be made here"; return 0; }
  rmdir "$group"
  local seen
  seen=$(cat "$work/group_peak")
  echo "  seen in the group $((seen >> 20)) MiB"
  # Pages of code and libraries may be counted in another group, so that the process has more.
  if [ "$((seen >> 20))" -gt "$(((peak >> 20) + 4))" ]; then
    echo "the group saw more than the process says it held"
    exit 1
  fi
}

pyramid=${ISOBRICK_PYRAMID:-$work/head.isb}
if [ ! -e "$pyramid" ]; then
  "$ISOBRICK" phantom head --voxels "$size" --type "$type" -o "$work/head.mhd" >/dev/null
  "$ISOBRICK" build "$work/head.mhd" -o "$pyramid" --codec none --no-curvature >/dev/null
  rm "$work"/head.mhd "$work"/*.raw
fi
echo "pyramid of $(($(stat -c %s "$pyramid") >> 20)) MiB"

explore() { "$EXPLORE" "$pyramid" "${isovalues[@]}" 50 "$@"; }
begin=$(date +%s.%N)
explore "$((1 << 50))" map >"$work/free"
echo "50 queries without bound: $(awk "BEGIN {printf \"%.1f\", $(date +%s.%N) - $begin}") s, $(tail -n 1 "$work/free")"
for access in map read; do
  begin=$(date +%s.%N)
  bounded "$memory_mib" "$work/bounded" \
    "$EXPLORE" "$pyramid" "${isovalues[@]}" 50 "$((memory_mib << 20))" "$access"
  echo "  $access: $(awk "BEGIN {printf \"%.1f\", $(date +%s.%N) - $begin}") s, $(tail -n 1 "$work/bounded")"
  cmp <(head -n 50 "$work/free") <(head -n 50 "$work/bounded") || { echo "the meshes differ"; exit 1; }
done

begin=$(date +%s.%N)
bounded "$full_memory_mib" "$work/json" \
  "$ISOBRICK" extract "$pyramid" --iso "$isovalue" --memory "${full_memory_mib}M" -o "$work/mesh.ply" --json
echo "  level 0 into a file: $(awk "BEGIN {printf \"%.1f\", $(date +%s.%N) - $begin}") s," \
  "$(sed -n 's/^ *"triangles": *\([0-9]*\).*/\1/p' "$work/json" | tail -n 1) triangles," \
  "$(($(stat -c %s "$work/mesh.ply") >> 20)) MiB"
last=$((size - 1))
"$CHECK_MESH" "$work/mesh.ply" --box 0 0 0 "$last" "$last" "$last"
