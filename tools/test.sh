#!/usr/bin/env bash
# Builds isobrick and runs its tests; ends with a table of what took how long. Safe to run again.
#   tools/test.sh                  the first ring: a release and all tests of behaviour
#   tools/test.sh house            the second ring, after the first: everything else that is built, and the tests that
#                                  guard the house (label `house`: nested builds, other programs, drivers, the .deb);
#                                  the Python module with its tests and those of the documents; the sanitizers
#   tools/test.sh STEP...          single steps: behaviour, house-tests, python, or a preset of CMakePresets.json
#                                  (dev, asan-ubsan, clang), of which all tests run; for tsan: tests/house/tsan.sh
# With CI=true the presets are those of CI, which take warnings as errors.
# Tests on scans run where the real volumes are (../shared/data); ISOBRICK_REQUIRE_DATA=1 makes it a failure
# that they are not, ISOBRICK_REQUIRE_ALL=1 that anything else is skipped. ISOBRICK_REPETITIONS=N: random tests try
# N percent of what they do in a night (tools/nightly.sh); default: 20, and 5 with sanitizers.
set -euo pipefail
cd "$(dirname "$0")/.."
ci=
[ "${CI:-}" != true ] || ci=ci-
release=${ci}release
if [ $# -eq 0 ]; then
  set -- behaviour
elif [ "$*" = house ]; then
  set -- house-tests python asan-ubsan
fi
repetitions=${ISOBRICK_REPETITIONS:-}
results=$PWD/build/results
mkdir -p "$results"
trap 'python3 -B tests/house/results.py "$results" "$@"' EXIT

configure() { cmake --preset "$1" >build/configure.log 2>&1 || { cat build/configure.log; exit 1; }; }
build() { cmake --build --preset "$1" --parallel "$(nproc)" "${@:2}"; }
# tests STEP PRESET WORDS...: those that ctest chooses by the words.
tests() {
  local status=0
  rm -rf "build/$2/results"
  mkdir -p "build/$2/results"
  ctest --preset "$2" --parallel "$(nproc)" --output-junit "$results/$1.xml" --no-tests=error "${@:3}" || status=$?
  mv "build/$2/results" "$results/$1.shards"
  return "$status"
}
# timed STEP PART COMMAND...: its seconds, for the table.
timed() {
  local begin=$SECONDS status=0
  "${@:3}" || status=$?
  printf '%s\t%s\t%s\t%s\n' "$1" "$2" "$((SECONDS - begin))" "$status" >>"$results/$1.tsv"
  return "$status"
}

# The module on an installed release, in a venv of Debian's Python with packages from PyPI.
buildPython() {
  local werror=OFF venv=build/python/venv
  [ -z "$ci" ] || werror=ON
  configure "$release"
  build "$release" --target all
  cmake --install "build/$release" --prefix build/python/prefix >build/python-install.log
  [ -x $venv/bin/pip ] || /usr/bin/python3 -m venv $venv
  $venv/bin/pip install -q uv  # six times as fast as pip
  $venv/bin/uv pip install -q --python $venv/bin/python -r python/requirements-test.txt
  CMAKE_PREFIX_PATH=$PWD/build/python/prefix CMAKE_BUILD_PARALLEL_LEVEL=$(nproc) $venv/bin/pip install -q \
    --no-deps --no-build-isolation --config-settings cmake.define.ISOBRICK_PYTHON_WERROR=$werror .
}
testPython() { build/python/venv/bin/python -m pytest -q -n "$(nproc)" --dist loadfile --durations=15 --junitxml="$results/python.xml"; }

for step; do
  rm -rf "$results/$step".*
done
for step; do
  echo "== $step"
  export ISOBRICK_REPETITIONS=${repetitions:-20}
  case $step in
    behaviour)
      tools/install_packages.sh build test
      timed $step configure configure "$release"
      timed $step build build "$release" --target behaviour_tests
      timed $step tests tests $step "$release" --label-exclude house
      ;;
    house-tests)
      tools/install_packages.sh build test release
      timed $step page tools/web_page.sh
      timed $step configure configure "$release"
      timed $step build build "$release"
      timed $step tests tests $step "$release" --label-regex house
      ;;
    python)
      tools/install_packages.sh build test release
      timed $step page tools/web_page.sh
      timed $step build buildPython
      timed $step tests testPython
      ;;
    *)
      preset=$step
      [ "$step" != asan-ubsan ] || preset=$ci$step
      case $step in *san*) export ISOBRICK_REPETITIONS=${repetitions:-5} ;; esac  # ten times as slow
      tools/install_packages.sh build test release
      timed "$step" configure configure "$preset"
      timed "$step" build build "$preset"
      timed "$step" tests tests "$step" "$preset"
      ;;
  esac
done
