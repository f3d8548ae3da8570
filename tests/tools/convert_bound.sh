#!/usr/bin/env bash
# Converts a volume into other formats and back inside a memory cgroup, which kills a process that holds
# more than the limit, file pages and buffers together; where no group can be made, the process's own
# peak is compared with the limit:
#
#   convert_bound.sh ISOBRICK SIZE LIMIT_MIB INTERRUPTIONS
#
# SIZE^3 uint8 voxels of the head phantom go into OpenVDB, OME-Zarr, NRRD and HDF5 with 64 MiB less than
# the limit as --memory, and from there into raw voxels, which must be the same; level 1 of their pyramid
# goes into OpenVDB with its ranges and curvature. Rates are voxels a
# second, beside that of `cp` and `sync` in the same group, from a cold file each. Then every conversion
# is interrupted as often as told at random moments ($RANDOM_SEED, default: the time), which must leave
# nothing. All is written in $ISOBRICK_WORK (default: the system's folder for temporary files).
# Exit status: 0 all is as it should be.
set -euo pipefail

isobrick=$(realpath "$1") size=$2 limit_mib=$3 interruptions=$4
source "$(dirname "$0")/memory_group.sh"
make_group "$limit_mib"
[ -n "$group" ] ||
  echo "no memory cgroup can be made here: the peak of each process is compared instead"
cd "$work"
memory=$((limit_mib - 64))M
"$isobrick" phantom head --voxels "$size" --type u8 -o volume.mhd >/dev/null
bytes=$((size * size * size))
RANDOM=${RANDOM_SEED:-$(date +%s)}

# A file or folder leaves the page cache, so that it is read from the disk.
make_cold() {
  find "$1" -type f -exec dd if={} iflag=nocache count=0 status=none \;
}

now() { date +%s%N; }

# report WHAT NANOSECONDS PEAK_MIB OUTPUT
report() {
  printf '%-24s %7.2f s %6.0f MB/s   peak %4s MiB   %5s MiB\n' "$1" "$(awk "BEGIN {print $2 / 1e9}")" \
    "$(awk "BEGIN {print $bytes * 1e3 / $2}")" "$3" "$(du -sm "$4" | cut -f 1)"
}

# convert WHAT INPUT OUTPUT OPTIONS...; $taken is how long it took.
convert() {
  local what=$1 input=$2 output=$3 status=0 begin peak
  shift 3
  make_cold "$input"
  begin=$(now)
  in_group "$isobrick" convert "$input" -o "$output" --memory "$memory" --json "$@" >json 2>messages ||
    status=$?
  taken=$(($(now) - begin))
  [ "$status" = 0 ] ||
    { cat messages; echo "$what failed with status $status (137: killed for its memory)"; exit 1; }
  peak=$(sed -n 's/.*"peak_rss_bytes": *\([0-9]*\).*/\1/p' json)
  report "$what" "$taken" "$((peak >> 20))" "$output"
  # Pages of code and libraries count here, though the system can take them back at any time.
  [ -n "$group" ] || [ "$((peak >> 20))" -le "$((limit_mib + 32))" ] ||
    { echo "the process held more than $((limit_mib + 32)) MiB"; exit 1; }
}

# interrupt NANOSECONDS INPUT OUTPUT OPTIONS...: Ctrl-C at a random moment of a run that takes as long.
interrupt() {
  local most=$1 input=$2 output=$3 process status=0 before
  shift 3
  before=$(ls -A)
  start_in_group "$isobrick" convert "$input" -o "$output" --memory "$memory" "$@" >/dev/null 2>&1
  process=$!
  sleep "$(awk "BEGIN {print $most / 1e9 * $RANDOM / 32768}")"
  kill -INT "$process" 2>/dev/null || true
  wait "$process" || status=$?
  if [ "$status" = 0 ]; then  # it was faster
    rm -r "$output"
  # 130: before its handler was there, the signal ended it, to which the shell gives the same number
  elif [ "$status" != 130 ]; then
    echo "an interruption ended with status $status"
    exit 1
  fi
  [ "$(ls -A)" = "$before" ] || { echo "an interruption left something:"; ls -A; exit 1; }
  stopped=$((stopped + (status != 0)))
}

echo "$size^3 uint8, limit $limit_mib MiB, --memory $memory"
make_cold volume.raw
begin=$(now)
in_group cp volume.raw copy.raw
sync copy.raw
report "cp and sync" "$(($(now) - begin))" - copy.raw
rm copy.raw
stopped=0
for format in volume.vdb volume.ome.zarr volume.nrrd volume.h5; do
  convert "into $format" volume.mhd "$format"
  into=$taken
  # OpenVDB has no integers of a byte: they come back as floats of the same values.
  options=()
  [ "$format" != volume.vdb ] || options=(--window 0,255 --type u8)
  convert "from $format" "$format" back.raw "${options[@]}"
  cmp volume.raw back.raw
  rm back.raw
  for ((i = 0; i < interruptions; ++i)); do
    interrupt "$into" volume.mhd "stopped.${format#volume.}"
    interrupt "$taken" "$format" stopped.raw "${options[@]}"
  done
  rm -r "$format"
done
"$isobrick" build volume.mhd --memory "$memory" >/dev/null
convert "level 1" volume.isb coarse.vdb --level 1 --with-ranges --with-curvature
[ -z "$group" ] || echo "peak of the group, page cache included: $(($(cat "$peak_file") >> 20)) MiB"
echo "$stopped of $((8 * interruptions)) runs were interrupted and left nothing"
[ "$interruptions" = 0 ] || [ "$stopped" -gt 0 ]
