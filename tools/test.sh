#!/usr/bin/env bash
# Builds isobrick and runs all tests, the check of the format among them: a release, and then again
# under AddressSanitizer and UndefinedBehaviorSanitizer. Safe to run again. Or only the presets of
# CMakePresets.json that are named:
#   tools/test.sh [release|dev|asan-ubsan|tsan|clang]...
# With CI=true the presets are those of CI, which take warnings as errors.
# Further tests run where the real volumes are (../shared/data); ISOBRICK_REQUIRE_DATA=1 makes it a
# failure that they are not, ISOBRICK_REQUIRE_ALL=1 that anything else is skipped.
set -euo pipefail
cd "$(dirname "$0")/.."
if [ $# -eq 0 ]; then
  set -- release asan-ubsan
  [ "${CI:-}" != true ] || set -- ci-release ci-asan-ubsan
fi
tools/install_packages.sh
mkdir -p build
for preset; do
  echo "== $preset"
  cmake --preset "$preset" >build/configure.log 2>&1 || { cat build/configure.log; exit 1; }
  grep '^-- isobrick: ' build/configure.log || true
  cmake --build --preset "$preset" --parallel "$(nproc)"
  ctest --preset "$preset" --parallel "$(nproc)"
done
