#!/usr/bin/env bash
# All that takes a night: both rings with four times all random tries and every fault, the sanitizer for threads, two hours of
# everything at once, an hour of fuzzing for each group (tests/fuzz), each rule broken on purpose, fresh machines of both suites of
# Debian, and arm64. Goes on after a failure, and ends with a line for each.
#   tools/nightly.sh
# Needs root and debootstrap for the fresh machines.
set -euo pipefail
cd "$(dirname "$0")/.."
export ISOBRICK_REPETITIONS=${ISOBRICK_REPETITIONS:-400} ISOBRICK_ALL_FAULTS=1
mkdir -p build/nightly
said=()
part() {
  local name=$1 begin=$SECONDS how=works
  shift
  "$@" >"build/nightly/$name.log" 2>&1 || how="FAILS, see build/nightly/$name.log"
  said+=("$name: $how, $((SECONDS - begin)) s")
  echo "${said[-1]}"
}
part rings tools/test.sh behaviour house-tests python asan-ubsan
part every-byte env ISOBRICK_REPETITIONS=40000 build/release/tests/isobrick_storage_tests --gtest_filter='*EveryByte.IsFound*'
part repair env ISOBRICK_REPETITIONS=1000 build/release/tests/isobrick_preprocess_tests --gtest_filter='*Repair.Gives*'
part threads tests/house/tsan.sh
part soak tests/house/soak.sh
part fuzz bash -c 'cmake --preset fuzz && cmake --build --preset fuzz -j2 && tests/fuzz/run.sh all 60'
# In a copy of the tree at the commit that is checked out here.
part mutation env -u ISOBRICK_REPETITIONS bash -c '
  [ ! -e build/mutation ] || git -C build/mutation checkout -q --detach "$(git rev-parse HEAD)"
  tests/house/mutation.py build/mutation'
part bookworm tests/house/debian.sh bookworm --deb
part trixie tests/house/debian.sh trixie --deb
part arm64 tests/house/arm64.sh build/nightly/arm64 build/release
printf '%s\n' "${said[@]}" | grep -q FAILS && exit 1
echo "nightly: all works"
