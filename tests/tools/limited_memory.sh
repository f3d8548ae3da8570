#!/usr/bin/env bash
# The rows of "Exploring with limited memory" in docs/BENCHMARKS.md: a minute of drags and flights (drag_bound.sh) in the
# head phantom of SIZE^3 voxels in memory groups of so many MiB, and ParaView in the same ones if pvpython is installed: it
# reads the volume, contours it, and drags the isovalue for a minute.
#
#   limited_memory.sh [SIZE] [MIB...]
#
# Of what is left beside 192 MiB (libraries of the software renderer, pictures) half goes to --memory, half to --gpu-memory. $ISOBRICK is the program. All is written in
# $ISOBRICK_WORK (default: the system's folder for temporary files); needs a memory cgroup, and Xvfb for ParaView.
set -euo pipefail
size=${1:-1024}
shift || true
[ $# -gt 0 ] || set -- 256 512 2048
source "$(dirname "$0")/memory_group.sh"
tools=$(cd "$(dirname "$0")" && pwd)

"$ISOBRICK" phantom head --voxels "$size" -o "$work/head.mhd" >/dev/null
"$ISOBRICK" build "$work/head.mhd" --codec lz4 --no-curvature -o "$work/head.isb" >/dev/null
echo "| | group, MiB | first picture, s | surfaces | age of a surface, ms: median, 99 % | a frame, ms: median, 99 % | peak, MiB |"
echo "|---|--:|--:|--:|--:|--:|--:|"
for limit in "$@"; do
  share=$(((limit - 192) / 2))
  ISOBRICK_PYRAMID=$work/head.isb ISOBRICK_REPORT=$work/report.json "$tools/drag_bound.sh" "$size" $share $share "$limit" >"$work/log" ||
    { echo "| isobrick | $limit | $(head -n 1 "$work/log") | | | | |"; continue; }
  python3 - "$work/report.json" "$limit" <<'PYTHON'
import json, statistics, sys
report = json.load(open(sys.argv[1]))
def spread(values):
    return f"{statistics.median(values):.0f}, {sorted(values)[int(0.99 * (len(values) - 1))]:.0f}"
first = next(f["seconds"] for f in report["each_frame"] if f["triangles"] > 0)
ages = [s["total_ms"] for s in report["each_surface"]]
frames = [f["interface_ms"] + f["draw_ms"] for f in report["each_frame"]]
print(f"| isobrick | {sys.argv[2]} | {first:.2f} | {len(ages):,} | {spread(ages)} | {spread(frames)} | {report['peak_rss_bytes'] >> 20} |", flush=True)
PYTHON
done

command -v pvpython >/dev/null || { echo "ParaView is not installed" >&2; exit 0; }
cat >"$work/drag.py" <<'PYTHON'
import statistics, sys, time
from paraview.simple import Contour, GetActiveViewOrCreate, OpenDataFile, Render, ResetCamera, Show
begin = time.time()
contour = Contour(Input=OpenDataFile(sys.argv[1]), ContourBy=["POINTS", "MetaImage"], Isosurfaces=[1324])
view = GetActiveViewOrCreate("RenderView")
view.ViewSize = [640, 400]
Show(contour, view)
ResetCamera(view)
Render(view)
first, ages = time.time() - begin, []
while time.time() - begin < 60 + first:
    start, t = time.time(), (time.time() - begin - first) % 8 / 4
    contour.Isosurfaces = [300 + 1200 * min(t, 2 - t)]
    Render(view)
    ages.append(1000 * (time.time() - start))
print(f"{first:.2f} | {len(ages)} | {statistics.median(ages):.0f}, {sorted(ages)[int(0.99 * (len(ages) - 1))]:.0f} | as the surface")
PYTHON
display=:$((RANDOM % 1000 + 100))
Xvfb $display -screen 0 800x600x24 >/dev/null 2>&1 &
trap 'kill %1; cleanup' EXIT
sleep 2
for limit in "$@"; do
  dd if="$work/head.raw" iflag=nocache count=0 status=none
  make_group "$limit"
  status=0
  DISPLAY=$display in_group pvpython "$work/drag.py" "$work/head.mhd" >"$work/log" 2>&1 || status=$?
  if [ $status = 0 ]; then row="$(tail -n 1 "$work/log") | $(($(cat "$peak_file") >> 20))"
  else row="ends with status $status | | | | "; fi
  echo "| ParaView | $limit | $row |"
  [ $status = 0 ] || tail -n 2 "$work/log" >&2
  sleep 1  # until the killed one is gone
  rmdir "$group"
done
