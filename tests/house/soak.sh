#!/usr/bin/env bash
# A long run of everything at once, in three parts of the same length (tests/tools/soak.py): files within a memory group of 256 MiB,
# the server with 20 clients, a window with random events. Memory, descriptors, threads and temporary files are level at the end,
# and sampled meshes are checked.
#   tests/house/soak.sh [MINUTES [BUILD]]
# MINUTES: of all parts together (120). BUILD: the folder of the build (build/release). ISOBRICK_PYTHON: a Python with numpy and
# websockets (default: that of tools/test.sh python); without one, and without Xvfb, a part is left out. ISOBRICK_SEED: of the
# random choices, as an earlier run said it.
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
build=$(cd "${2:-$here/../build/release}" && pwd)
seconds=$(awk "BEGIN {print ${1:-120} * 60 / 3}")
python=${ISOBRICK_PYTHON:-$here/../build/python/venv/bin/python}
source "$here/tools/memory_group.sh"
status=0
# part NAME IN... : `IN...` starts it.
part() {
  local name=$1
  shift
  mkdir "$work/$name"
  "$@" "$here/tools/soak.py" "$name" "$seconds" "$build/isobrick" "$build/tests" "$work/$name" || { echo "$name: FAILS"; status=1; }
}
make_group 256
[ -n "$group" ] || echo "no memory cgroup can be made here: nothing bounds the part of files"
TMPDIR=$work XDG_CACHE_HOME=$work/cache part files in_group python3 -B
if [ -n "$group" ]; then echo "in the group at most $(($(cat "$peak_file") >> 20)) of 256 MiB, pages of files included"; fi
if "$python" -c 'import numpy, websockets' 2>/dev/null; then part serve "$python" -B; else echo "serve: left out, without websockets"; fi
if command -v Xvfb >/dev/null; then part window python3 -B; else echo "window: left out, without Xvfb"; fi
exit $status
