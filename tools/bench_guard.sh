#!/usr/bin/env bash
# Compares the speed of two commits: fourteen jobs by both, in turns, and the time, the peak memory, the bytes
# read and the instructions of each.
#   tools/bench_guard.sh BASE [HEAD]
# HEAD is the last commit of this checkout by default. Prints a table. Ends with 1 if a job of HEAD is worse
# than a threshold (tools/bench_guard.py has them), with 2 if it could not compare.
# Takes some minutes after the builds, which are kept in build/guard and found again.
# ISOBRICK_GUARD_ROUNDS: runs of each job; default: 7. ISOBRICK_GUARD_VOXELS: of the phantom, per axis;
# default: 256. CI=true: builds as CI does.
set -euo pipefail
cd "$(dirname "$0")/.."
fail() { echo "bench_guard.sh: $*" >&2; exit 2; }
[ $# -eq 1 ] || [ $# -eq 2 ] || fail "give the commit to compare with, and perhaps another one: BASE [HEAD]"
folder=$PWD/build/guard
preset=release
[ "${CI:-}" != true ] || preset=ci-release
mkdir -p "$folder"

# commitOf NAME: its full hash.
commitOf() { git rev-parse --verify --quiet "$1^{commit}" || fail "'$1' is no commit of this repository"; }

# built COMMIT: builds its programs, in a worktree of its own that stays ('git worktree remove' takes it away).
built() {
  local tree=$folder/$1
  if [ ! -e "$tree/.git" ]; then
    git worktree prune
    git worktree add --quiet --detach "$tree" "$1"
  fi
  (
    cd "$tree"
    # Without the tree's name in what ccache compares, the second build finds the objects of the first one.
    export CCACHE_BASEDIR=$tree CCACHE_NOHASHDIR=1
    # Older commits have peers to compile, which are no part of the comparison.
    cmake --preset $preset -DISOBRICK_BENCH_PEERS=OFF &&
      cmake --build --preset $preset --parallel "$(nproc)" \
        --target isobrick isobrick-build isobrick-view
  ) >"$tree.log" 2>&1 || { tail -5 "$tree.log" >&2; fail "${1:0:7} cannot be built; all is in $tree.log"; }
}

base=$(commitOf "$1")
head=$(commitOf "${2:-HEAD}")
if [ -z "${2:-}" ] && ! git diff --quiet HEAD; then
  echo "bench_guard.sh: changes that are not committed are not measured" >&2
fi
command -v ccache >/dev/null ||
  echo "bench_guard.sh: ccache is missing, so both builds take their full time; 'apt-get install ccache'" >&2
for commit in "$base" "$head"; do
  echo "bench_guard.sh: building ${commit:0:7}" >&2
  built "$commit"
done
exec python3 tools/bench_guard.py "$folder/$base/build/$preset" "$folder/$head/build/$preset" --work "$folder/work" \
  --rounds "${ISOBRICK_GUARD_ROUNDS:-7}" --voxels "${ISOBRICK_GUARD_VOXELS:-256}"
