#!/usr/bin/env bash
# Measures isobrick beside every peer that can be had here, and writes docs/benchmarks.json and from it the page
# docs/BENCHMARKS.md with its plots:
#   tools/benchmark.sh [--quick] [FOLDER]
# FOLDER keeps the build, the peers, volumes and results (one JSON file a step); default: build/benchmarks. A step whose
# result is there is left out, so a run that was stopped goes on, and a finished one only writes the page again; remove
# FOLDER/full to measure anew. --quick: small phantoms, one round; the page goes to FOLDER/quick, not to docs.
# A full run needs 8 GB of disk, and 15 to 40 minutes on two cores after the build.
# ISOBRICK_DATA: the real volumes (../shared/data); phantoms without them. What cannot be had is left out, and the page says so.
set -euo pipefail
cd "$(dirname "$0")/.."
mode=full
[ "${1:-}" != --quick ] || { mode=quick; shift; }
case "${1:-}" in -*) echo "benchmark.sh: there is no option '$1'; usage: tools/benchmark.sh [--quick] [FOLDER]" >&2; exit 2 ;; esac
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

# ---- the peers -----------------------------------------------------------------------------------

# VTK of Debian: as it is installed, or else unpacked beside the build.
vtk=() vtk_version=$(dpkg-query -W -f='${Version}' libvtk9-dev 2>/dev/null || true)
if [ -z "$vtk_version" ]; then
  if [ ! -d "$folder/vtk/usr" ]; then
    say "VTK of Debian, unpacked into $folder/vtk"
    mkdir -p "$folder/vtk/packages"
    (cd "$folder/vtk/packages" && apt-get download -qq libvtk9.1 libvtk9-dev) >"$folder/log" 2>&1 ||
      say "left out: VTK of Debian cannot be downloaded: $(tail -1 "$folder/log")"
    for package in "$folder"/vtk/packages/*.deb; do [ ! -f "$package" ] || dpkg -x "$package" "$folder/vtk"; done
  fi
  if [ -d "$folder/vtk/usr" ]; then
    vtk=(-DVTK_DIR="$PWD/$suite/debian_vtk" -DISOBRICK_DEBIAN_VTK="$folder/vtk")
    vtk_version=$(ls "$folder"/vtk/packages/libvtk9-dev_*.deb | sed 's/.*libvtk9-dev_\([^_]*\)_.*/\1/; s/%3a/:/')
    export LD_LIBRARY_PATH=$(dirname "$folder"/vtk/usr/lib/*/libvtkCommonCore-9.1.so)${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
  fi
fi

say "building in $folder/build"
quietly cmake --preset release -B "$folder/build" "${vtk[@]}"
peers=()  # those that CMake has found
for peer in bench_peers bench_pyramid_peers; do
  [ ! -d "$folder/build/tools/CMakeFiles/$peer.dir" ] || peers+=("$peer")
done
quietly cmake --build "$folder/build" --parallel "$(nproc)" \
  --target isobrick isobrick-build isobrick-view progressive_times "${peers[@]}"

# Packages of PyPI, and the Python module on an installed isobrick.
venv=$folder/venv
if [ "$(cat "$venv/made" 2>/dev/null)" != "$commit $(cksum <$suite/requirements.txt)" ]; then
  say "Python packages in $venv"
  quietly /usr/bin/python3 -m venv "$venv"
  if "$venv/bin/pip" install -q -r $suite/requirements.txt >"$folder/log" 2>&1; then
    quietly cmake --build "$folder/build" --parallel "$(nproc)" --target isobrick_storage isobrick_extract \
      isobrick_preprocess isobrick_sources isobrick_export isobrick_view isobrick_viewer isobrick_pages
    quietly cmake --install "$folder/build" --prefix "$folder/prefix"
    CMAKE_PREFIX_PATH=$folder/prefix CMAKE_BUILD_PARALLEL_LEVEL=$(nproc) \
      quietly "$venv/bin/pip" install -q --no-deps --no-build-isolation --config-settings "build-dir=$folder/module" .
    echo "$commit $(cksum <$suite/requirements.txt)" >"$venv/made"
  else
    say "left out: the peers from PyPI cannot be installed: $(tail -1 "$folder/log")"
    venv=none
  fi
fi

# ---- measurements, and the page ------------------------------------------------------------------

echo "$commit" >"$work/commit"
/usr/bin/python3 $suite/measure.py "$work" "$folder/build" "$data" "$venv" --output "$work/benchmarks.json" \
  --commit "$commit" --vtk "${vtk_version:-none}" $([ $mode = full ] || echo --quick)
docs=docs
[ $mode = full ] || docs=$work
[ $mode = quick ] || cp "$work/benchmarks.json" docs/benchmarks.json
/usr/bin/python3 $suite/page.py "$work/benchmarks.json" "$docs"
say "the page is $docs/BENCHMARKS.md"
