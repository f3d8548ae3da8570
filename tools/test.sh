#!/usr/bin/env bash
# Builds isobrick and runs all tests. Safe to run again. A preset of CMakePresets.json may be named:
#   tools/test.sh [release|dev|asan-ubsan|tsan]
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-release}
tools/install_packages.sh
mkdir -p build
cmake --preset "$preset" >build/configure.log 2>&1 || { cat build/configure.log; exit 1; }
cmake --build --preset "$preset" --parallel "$(nproc)"
ctest --preset "$preset" --parallel "$(nproc)"
