#!/usr/bin/env bash
# The minute of dragging of docs/viewer_drag.json in a head phantom of SIZE^3 voxels, without a window,
# inside a memory cgroup (default: of --memory, --gpu-memory and 64 MiB), which kills a process that holds more;
# where no group can be made, the process's own peak is compared with the limit:
#
#   drag_bound.sh SIZE MEMORY_MIB GPU_MEMORY_MIB [LIMIT_MIB]
#
# The script's places and radii, made for 512^3, are scaled to SIZE. Prints the spreads of the report, and for the
# oldest surfaces what their age went into. $ISOBRICK is the program; all is written in $ISOBRICK_WORK
# (default: the system's folder for temporary files); $ISOBRICK_PYRAMID: a pyramid to take rather than
# make one; $ISOBRICK_REPORT: where the whole report is to be kept.
# Exit status: 0 within the limit.
set -euo pipefail

size=$1 memory_mib=$2 gpu_memory_mib=$3
limit=${4:-$((memory_mib + gpu_memory_mib + 64))}
tools=$(cd "$(dirname "$0")" && pwd)
source "$tools/memory_group.sh"

pyramid=${ISOBRICK_PYRAMID:-$work/head.isb}
[ -e "$pyramid" ] || "$ISOBRICK" build "phantom:head:$size" --codec lz4 --no-curvature -o "$pyramid" >/dev/null
python3 - "$size" "$tools/../../docs/viewer_drag.json" >"$work/drag.json" <<'PYTHON'
import json, sys
size, path = int(sys.argv[1]), sys.argv[2]
script = json.load(open(path))
for step in script["steps"]:
    focus = step.get("set", {}).get("focus")
    if focus:
        focus["center"] = [place * size / 512 for place in focus["center"]]
    if "radius" in step.get("sweep", {}):
        step["sweep"]["radius"] = [radius * size / 512 for radius in step["sweep"]["radius"]]
json.dump(script, sys.stdout)
PYTHON

# Pages of the file that are in memory are counted where they came in, which is to be the group.
dd if="$pyramid" iflag=nocache count=0 status=none
make_group "$limit"
in_group "$ISOBRICK" view "$pyramid" --offscreen --memory "${memory_mib}M" \
  --gpu-memory "${gpu_memory_mib}M" --script "$work/drag.json" --out-dir "$work" --report "$work/report.json" ||
  { echo "failed with status $? (137: killed for its memory)"; exit 1; }
[ -z "$group" ] || echo "in the group at most $(($(cat "$peak_file") >> 20)) of $limit MiB, pages of files included"
[ -z "${ISOBRICK_REPORT:-}" ] || cp "$work/report.json" "$ISOBRICK_REPORT"
python3 - "$limit" "$work/report.json" "$group" <<'PYTHON'
import json, sys
limit, report, group = int(sys.argv[1]), json.load(open(sys.argv[2])), sys.argv[3]

def show(name, spread):
    print(f"{name:24}" + ", ".join(f"{key} {value:.1f}" for key, value in spread.items()))

print(f'{report["frames"]} frames in {report["seconds"]:.0f} s, {report["passes"]} passes, by {report["device"]}')
for name, spread in report.items():
    if name == "surface_wait_ms":
        for part, spread_of_part in spread.items():
            show(f"  waited: {part}", spread_of_part)
    elif isinstance(spread, dict):
        show(name, spread)
for wait in sorted(report["each_surface"], key=lambda wait: -wait["total_ms"])[:5]:
    print("an oldest surface: " + ", ".join(f"{key} {value:.1f}" for key, value in wait.items()))
peak = report["peak_rss_bytes"] >> 20
print(f"peak memory of the process {peak} MiB, of libraries too that others have in memory already")
sys.exit(not group and peak > limit)
PYTHON
