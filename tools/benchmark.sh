#!/usr/bin/env bash
# Measures isobrick beside every peer that is here, and writes docs/benchmarks.json and from it the page
# docs/BENCHMARKS.md:
#   tools/benchmark.sh [--quick] [--steps NAME,...] [FOLDER]
# FOLDER keeps the build, the peers, volumes and results (one JSON file a step); default: build/benchmarks. A step whose
# result is there is left out, so a run that was stopped goes on, and a finished one only writes the page again; remove
# FOLDER/full to measure anew. --quick: small phantoms, one round; the page goes to FOLDER/quick, not to docs.
# --steps: only these (extraction, file, queries, first, cold, building, memory, conversion, simplification, array,
# kernels); the page keeps what it has of the others. A full run needs 8 GB of disk, and 15 to 40 minutes on two cores
# after the build.
# ISOBRICK_DATA: the real volumes (../shared/data); phantoms without them. What is not here is left out, and the page says so.
set -euo pipefail
cd "$(dirname "$0")/.."
mode=full steps=
while [ $# -gt 0 ]; do
  case $1 in
    --quick) mode=quick ;;
    --steps) steps=${2:?name the steps}; shift ;;
    -*) echo "benchmark.sh: there is no option '$1'; usage: tools/benchmark.sh [--quick] [--steps NAME,...] [FOLDER]" >&2; exit 2 ;;
    *) break ;;
  esac
  shift
done
folder=$(realpath -m "${1:-build/benchmarks}")
data=${ISOBRICK_DATA:-../shared/data}
[ -f "$data/vhf_head_ct/vhf_head.nrrd" ] || data=none
suite=tools/bench/suite
work=$folder/$mode
mkdir -p "$work"
SECONDS=0
say() { printf '%5d s  %s\n' "$SECONDS" "$*"; }
quietly() { "$@" >"$folder/log" 2>&1 || { tail -20 "$folder/log" >&2; echo "benchmark.sh: '$*' failed" >&2; exit 1; }; }

# The last change of what is measured: results of another one must not stand beside these.
code=(CMakeLists.txt cmake storage preprocess extract viewer python tools ":(exclude)$suite" ':(exclude)tools/*.sh')
commit=$(git log -1 --format=%h -- "${code[@]}")
git diff --quiet HEAD -- "${code[@]}" || commit+=" and changes"
if [ "$(cat "$work/commit" 2>/dev/null || echo "$commit")" != "$commit" ]; then
  echo "benchmark.sh: $work has results of commit $(cat "$work/commit"), and this is $commit: remove it, or name another folder" >&2
  exit 1
fi

say "building in $folder/build"
quietly cmake --preset release -B "$folder/build"
programs=(isobrick isobrick-build isobrick-view)
[ ! -d "$folder/build/tests/house/CMakeFiles/isobrick_benchmarks.dir" ] || programs+=(isobrick_benchmarks)
quietly cmake --build "$folder/build" --parallel "$(nproc)" --target "${programs[@]}"

# Packages of PyPI, and the Python module on an installed isobrick.
venv=$folder/venv
made="$commit $(cksum <$suite/requirements.txt)"
if [ "$(cat "$venv/made" 2>/dev/null)" != "$made" ]; then
  say "Python packages in $venv"
  quietly /usr/bin/python3 -m venv "$venv"
  if "$venv/bin/pip" install -q -r $suite/requirements.txt >"$folder/log" 2>&1; then
    quietly cmake --build "$folder/build" --parallel "$(nproc)" --target isobrick_storage isobrick_extract \
      isobrick_preprocess isobrick_sources isobrick_export isobrick_view isobrick_viewer isobrick_pages
    quietly cmake --install "$folder/build" --prefix "$folder/prefix"
    CMAKE_PREFIX_PATH=$folder/prefix CMAKE_BUILD_PARALLEL_LEVEL=$(nproc) \
      quietly "$venv/bin/pip" install -q --no-deps --no-build-isolation --config-settings "build-dir=$folder/module" .
    echo "$made" >"$venv/made"
  else
    say "left out: the peers from PyPI cannot be installed: $(tail -1 "$folder/log")"
    venv=none
  fi
fi

echo "$commit" >"$work/commit"
docs=docs
[ $mode = full ] || docs=$work
/usr/bin/python3 $suite/measure.py "$work" "$folder/build" "$data" "$venv" --output "$docs/benchmarks.json" \
  --commit "$commit" --steps "$steps" $([ $mode = full ] || echo --quick)
/usr/bin/python3 $suite/page.py "$docs/benchmarks.json" "$docs/BENCHMARKS.md"
say "the page is $docs/BENCHMARKS.md"
