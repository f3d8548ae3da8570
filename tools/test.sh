#!/usr/bin/env bash
# Builds isobrick and runs all tests, the check of the format among them: a release, and then again
# under AddressSanitizer and UndefinedBehaviorSanitizer. Safe to run again. Or only the presets of
# CMakePresets.json that are named:
#   tools/test.sh [release|dev|asan-ubsan|tsan|clang|python]...
# `python` builds the Python module on the release, in a venv under build/python, and runs its tests and those
# of the documents (tests/docs: all commands of the pages, and the site); it comes after the release by default.
# With CI=true the presets are those of CI, which take warnings as errors.
# Further tests run where the real volumes are (../shared/data); ISOBRICK_REQUIRE_DATA=1 makes it a
# failure that they are not, ISOBRICK_REQUIRE_ALL=1 that anything else is skipped.
set -euo pipefail
cd "$(dirname "$0")/.."
if [ $# -eq 0 ]; then
  set -- release python asan-ubsan
  [ "${CI:-}" != true ] || set -- ci-release python ci-asan-ubsan
fi

# The module on an installed release, in a venv of Debian's Python with packages from PyPI.
testPython() {
  local release=release werror=OFF
  [ "${CI:-}" != true ] || { release=ci-release werror=ON; }
  cmake --preset "$release" >build/configure.log 2>&1 || { cat build/configure.log; exit 1; }
  cmake --build --preset "$release" --parallel "$(nproc)" --target isobrick isobrick-build isobrick-view \
    isobrick_storage isobrick_extract isobrick_preprocess isobrick_sources isobrick_export isobrick_view isobrick_viewer
  cmake --install "build/$release" --prefix build/python/prefix >build/python-install.log
  local venv=build/python/venv
  [ -x $venv/bin/pip ] || /usr/bin/python3 -m venv $venv
  $venv/bin/pip install -q -r python/requirements-test.txt
  CMAKE_PREFIX_PATH=$PWD/build/python/prefix CMAKE_BUILD_PARALLEL_LEVEL=$(nproc) $venv/bin/pip install -q \
    --no-deps --no-build-isolation --config-settings cmake.define.ISOBRICK_PYTHON_WERROR=$werror .
  $venv/bin/python -m pytest -q
}
tools/install_packages.sh
mkdir -p build
for preset; do
  echo "== $preset"
  if [ "$preset" = python ]; then
    testPython
    continue
  fi
  cmake --preset "$preset" >build/configure.log 2>&1 || { cat build/configure.log; exit 1; }
  grep '^-- isobrick: ' build/configure.log || true
  cmake --build --preset "$preset" --parallel "$(nproc)"
  ctest --preset "$preset" --parallel "$(nproc)"
done
