#!/usr/bin/env bash
# ThreadSanitizer on the tests of storage, extract, and of what streams and serves (state, stream, session and serve of
# viewer). TBB is built with it, from Debian's source of the installed version: it sees no join of a library without it,
# and takes what follows for a race.
#   tests/house/tsan.sh [Storage|Extract|Viewer]...        default: all three
# Ends with a table; 1 if a test fails, or if there is a race that tests/races.supp has no reason for. TBB and the tests
# stay in build/tsan-tbb and build/tsan, and the reports in build/tsan/reports. Needs the Debian mirror that apt is set
# up for, and takes half an hour on two cores.
set -euo pipefail
cd "$(dirname "$0")/../.."
rooms=("$@")
[ $# -gt 0 ] || rooms=(Storage Extract Viewer)
jobs=${ISOBRICK_JOBS:-$(nproc)}
tools/install_packages.sh build test release

# ---- TBB

version=$(dpkg-query -W -f='${source:Version}' libtbb-dev)
tbb=$PWD/build/tsan-tbb/${version//[^0-9a-z.]/-}
buildTbb() {
  local apt=$tbb/apt words
  rm -rf "$tbb"
  mkdir -p "$apt"/{lists/partial,archives/partial,sources}
  apt-get indextargets --format 'deb-src $(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' 'Origin: Debian' |
    sort -u >"$apt/sources.list"
  # Lists of its own: those of this machine stay as they are.
  words=(-o Dir::Etc::SourceList="$apt/sources.list" -o Dir::Etc::SourceParts="$apt/sources" -o Dir::State::Lists="$apt/lists"
    -o Dir::Cache="$apt" -o APT::Sandbox::User=root -q)
  apt-get "${words[@]}" update
  cd "$tbb"
  apt-get "${words[@]}" source "onetbb=$version"
  # Without its allocator, which hides from the sanitizer that memory was freed; and without -Werror, since the sanitizer
  # of g++ warns of fences, which it leaves aside. TBB has them where threads fall asleep, and none hands over data.
  cmake -S onetbb-*/ -B build -G Ninja -D CMAKE_BUILD_TYPE=RelWithDebInfo -D CMAKE_INSTALL_PREFIX="$tbb" \
    -D CMAKE_INSTALL_LIBDIR=lib -D TBB_SANITIZE=thread -D TBB_TEST=OFF -D TBB_STRICT=OFF -D TBBMALLOC_BUILD=OFF \
    -D TBB_DISABLE_HWLOC_AUTOMATIC_SEARCH=ON
  cmake --build build --parallel "$jobs"
  cmake --install build
}
seconds=$SECONDS
if [ ! -e "$tbb/lib/cmake/TBB/TBBConfig.cmake" ]; then
  mkdir -p build
  (buildTbb) >build/tsan-tbb.log 2>&1 || { tail -n 40 build/tsan-tbb.log; exit 1; }
fi
echo "TBB $version: $((SECONDS - seconds)) s"

# ---- the tests

seconds=$SECONDS
declare -A executables=([Storage]=isobrick_storage_tests [Extract]=isobrick_extract_tests [Viewer]=isobrick_viewer_tests)
targets=()
for room in "${rooms[@]}"; do targets+=("${executables[$room]}"); done
{
  cmake --preset tsan -D TBB_DIR="$tbb/lib/cmake/TBB" &&
  cmake --build --preset tsan --parallel "$jobs" --target "${targets[@]}"
} >build/tsan.log 2>&1 || { tail -n 60 build/tsan.log; exit 1; }
echo "build: $((SECONDS - seconds)) s"

results=build/tsan/results reports=build/tsan/reports
rm -rf "$results" "$reports"
mkdir -p "$results"
export ISOBRICK_REPETITIONS=5  # what is tried a hundred times has the same threads each time
# The sanitizer's memory lies where the kernel may put the program's, up to GCC 13 and clang 17.
fixed=()
! setarch --addr-no-randomize true 2>/dev/null || fixed=(setarch --addr-no-randomize)
status=0
for room in "${rooms[@]}"; do
  mkdir -p "$reports/$room"
  # Tests fork while threads run; a child goes on with one. If it starts others, the sanitizer may end it.
  export GTEST_FILTER="-BusErrorGuardTest.FaultsWhileOthersOpenAndClose:TruncatedWhileMapped.*"
  export TSAN_OPTIONS="halt_on_error=0 exitcode=66 die_after_fork=0 history_size=4 print_suppressions=1
    suppressions=$PWD/tests/races.supp log_path=$PWD/$reports/$room/process"
  "${fixed[@]}" ctest --preset tsan --parallel "$jobs" --no-tests=error --tests-regex "^$room\\." \
    >"$reports/$room.log" 2>&1 || status=1
done

python3 - "$results" "$reports" "${rooms[@]}" <<'PYTHON' || status=1
"""The table. A report belongs to the process of a few tests, so it is counted for a whole executable."""
import collections
import pathlib
import re
import sys
import xml.etree.ElementTree as xml

results, reports = map(pathlib.Path, sys.argv[1:3])
total = 0
print(f"\n{'tests of':<18}{'passed':>8}{'failed':>8}{'skipped':>9}{'seconds':>9}{'reports':>9}{'suppressed':>12}")
for room in sys.argv[3:]:
    counts: dict[str, collections.Counter] = collections.defaultdict(collections.Counter)
    for shard in sorted(results.glob(f"{room}.*.xml")):
        for case in xml.parse(shard).iter("testcase"):
            folder = case.get("file", "").rpartition("/tests/")[2].rpartition("/")[0]
            folder = folder if room == "Viewer" else folder.partition("/")[0]
            failed, skipped = case.find("failure") is not None, case.find("skipped") is not None
            counts[folder]["failed" if failed else "skipped" if skipped else "passed"] += 1
            counts[folder]["seconds"] += float(case.get("time", 0))
            if failed:
                print(f"failed: {case.get('classname')}.{case.get('name')}")
    texts = [file.read_text(errors="replace") for file in (reports / room).iterdir()]
    found = [line for text in texts for line in re.findall("^SUMMARY: ThreadSanitizer: (.*)", text, re.M)]
    matched = [line for text in texts for line in re.findall(r"^ *(\d+) (\w+:\S+)$", text, re.M)]
    for folder, count in sorted(counts.items()):
        print(f"{folder:<18}{count['passed']:>8}{count['failed']:>8}{count['skipped']:>9}{count['seconds']:>9.0f}")
    print(f"{'  all of ' + room:<18}{'':>34}{len(found):>9}{sum(int(n) for n, _ in matched):>12}")
    for line, times in collections.Counter(found).most_common():
        print(f"    {times} x {line}")
    for name in sorted({name for _, name in matched}):
        print(f"    suppressed: {sum(int(n) for n, other in matched if other == name)} x {name}")
    total += len(found)
print(f"\n{total} reports")
sys.exit(total > 0)
PYTHON
[ $status = 0 ] || { echo "tsan: FAILS, see $reports"; exit 1; }
echo "tsan: works"
