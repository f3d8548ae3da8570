#!/usr/bin/env bash
# Compiles isobrick for arm64, runs the tests of storage, extract and preprocess under qemu, and compares pyramids and
# meshes, byte by byte, with those of x86-64:
#   tests/house/arm64.sh [WORK_FOLDER [FOLDER_OF_THE_COMMAND]]
# Needs what tools/arm64_sysroot.sh needs, and an hour of a core. FOLDER_OF_THE_COMMAND has `isobrick` and
# `isobrick-build` of this machine; without it they are compiled, too. A root and builds of an earlier run that lie in
# WORK_FOLDER are used again. Prints what is compared; ends with "arm64: works".
set -euo pipefail
source=$(cd "$(dirname "$0")/../.." && pwd)
given=${1:-}
work=${given:-$(mktemp -d /tmp/isobrick_arm64_XXXXXX)}
mkdir -p "$work"
work=$(cd "$work" && pwd)
here=$(realpath -m "${2:-$work/x86}")
jobs=${ISOBRICK_JOBS:-$(nproc)}
cleanUp() { [ -n "$given" ] || rm -rf "$work"; }
trap cleanUp EXIT
say() { echo "arm64: $*"; }

# ---- compile

say "the root of arm64's Debian"
"$source/tools/arm64_sysroot.sh" "$work/root"
# ITK is not there for arm64; what has no tests here is left out.
options=(-G Ninja -D ISOBRICK_WITH_ITK=OFF -D ISOBRICK_WITH_OPENVDB=OFF -D ISOBRICK_WITH_VIEWER=OFF)
compile() {  # FOLDER [OPTION...] -- TARGET...
  local folder=$1
  shift
  local words=()
  while [ "$1" != -- ]; do words+=("$1"); shift; done
  shift
  if ! { cmake -S "$source" -B "$folder" "${options[@]}" "${words[@]}" && cmake --build "$folder" -j "$jobs" -t "$@"; } \
    >"$folder.log" 2>&1; then
    tail -n 50 "$folder.log" >&2
    exit 1
  fi
}
say "the libraries, the command and the tests"
tests=(storage extract preprocess)
targets=()
for room in "${tests[@]}"; do targets+=("isobrick_${room}_tests"); done
compile "$work/arm64" --toolchain "$source/cmake/arm64.cmake" -D ISOBRICK_ARM64_SYSROOT="$work/root" \
  -D ISOBRICK_TESTS=ON -- isobrick "${targets[@]}"
[ -n "${2:-}" ] || { say "the command of this machine"; compile "$here" -- isobrick; }

# ---- the tests

# Signals, system calls and resident pages are qemu's own, not the program's; what opens a pyramid thousands of times
# takes minutes here and proves the same. qemu keeps a record of each page that a program ever mapped. Of extract's tests,
# which reserve addresses for meshes, -R bounds it: addresses are used again, and a process takes 7 GiB at most.
qemu() { qemu-aarch64-static "${addresses[@]}" -L "$work/root" "$@"; }
left_out='HollowFile.*:HostileFile.NastyNumbers*:BusErrorGuardTest.*:*AHitMakesNoSystemCall*:Soak.*'
left_out+=':BufferSlab.CountsAsUsedOnlyAsFarAsBuffersReach:PagerSlab.WithoutAddressesTheHeapServes'
left_out+=':HttpRangesTest.ManyFilesAreAskedForAtOnce:DamagedFile.*Flip*:*FailingFile*CutEnds*:*FailingFile*ThatIsCut*'
left_out+=':*FailingFile*ACutAtAnyMoment*:SurfaceMesh.WithoutMemoryOrAddresses*'
shards=40
runShard() {  # ROOM SHARD
  local addresses=()
  [ "$1" != extract ] || addresses=(-R 0x10000000000)
  GTEST_TOTAL_SHARDS=$shards GTEST_SHARD_INDEX=$2 ISOBRICK_REPETITIONS=5 \
    qemu "$work/arm64/tests/isobrick_$1_tests" --gtest_brief=1 --gtest_filter="-$left_out" >"$work/$1.$2.log" 2>&1 ||
    { tail -n 50 "$work/$1.$2.log" >&2; return 1; }
}
export -f qemu runShard
export work shards left_out
rm -f "$work"/{storage,extract,preprocess}.*.log
for room in "${tests[@]}"; do
  seq 0 $((shards - 1)) | xargs -P "$jobs" -I{} bash -c "runShard $room {}" || exit 1
  say "tests of $room: $(sed -n 's/^\[  PASSED  \] \([0-9]*\) test.*/\1/p' "$work/$room".*.log |
    awk '{ sum += $1 } END { print sum + 0 }') passed"
done

# ---- pyramids and meshes

# Makes the same files by either command, in a folder of its own. Pyramids are made by isobrick-build, which `isobrick`
# starts: qemu starts no other program of arm64 without the kernel's help.
makeAll() {  # FOLDER FOLDER_OF_THE_COMMAND [EMULATOR...]
  local folder=$1 command=$2 kind type codec threads
  shift 2
  rm -rf "$folder"
  mkdir -p "$folder"
  cd "$folder"
  build() { "${run[@]}" "$command/isobrick-build" build "$@" >>made.log 2>&1; }
  extract() { "${run[@]}" "$command/isobrick" extract "$@" >>made.log 2>&1; }
  local run=("$@")
  for kind in head sphere torus gyroid marschner-lobb plane; do
    for type in u8 i8 u16 i16 f32; do build "phantom:$kind:50:$type" -o "$kind-$type.isb"; done
  done
  for codec in none lz4 zstd; do
    for type in u8 u16 f32; do build "phantom:head:90:$type" --codec "$codec" --brick 32 -o "$codec-$type.isb"; done
  done
  build phantom:gyroid:80:i16 --filter subsample --no-curvature -o subsample.isb
  build phantom:head:100 --super-brick 64 -o divided.isbs
  build phantom:head:150 --threads 3 -o large.isb
  for kind in sphere torus gyroid plane; do
    for type in u8 i16 f32; do extract "$kind-$type.isb" --iso auto -o "$kind-$type.ply"; done
  done
  for threads in 1 3; do
    surface() { extract large.isb --threads "$threads" "${@:2}" -o "$1-$threads.ply"; }
    surface whole --iso 1324
    surface skin --iso 400
    surface level --iso 1324 --level 1
    surface focus --iso 1324 --focus 90,40,80 --radius 20
    surface curvature --iso 1324 --focus 90,40,80 --radius 40 --curvature-radius 20
    surface eye --iso 1324 --eye -100,40,80 --look-at 75,75,75 --pixels 4
    surface box --iso 1324 --box 20,20,20,90,100,110
    surface simplify --iso 1324 --simplify 0.5
    surface few --iso 1324 --triangles 20000
    surface largest --iso 1324 --focus 90,40,80 --radius 20 --simplify 1 --keep-largest 2 --attribute component
  done
  extract divided.isbs --iso 1324 --simplify 0.3 -o divided.ply
  for kind in stl obj glb vtp; do extract large.isb --iso 1324 --level 1 -o "level.$kind"; done
  extract large.isb --iso 1324 --level 1 --meshopt -o meshopt.glb
}
say "pyramids and meshes"
(makeAll "$work/files_arm64" "$work/arm64" qemu-aarch64-static -L "$work/root") & arm=$!
(makeAll "$work/files_x86" "$here")
wait "$arm"
sums() { (cd "$1" && find . -type f ! -name made.log | LC_ALL=C sort | xargs sha256sum); }
diff <(sums "$work/files_x86") <(sums "$work/files_arm64") || { say "these files differ" >&2; exit 1; }
count() { find "$work/files_x86" -name "*.$1" | wc -l; }
say "$(count isb) pyramids and $(count ply) meshes in .ply are those of x86-64 to the byte, so are .stl, .obj, .glb, .vtp"
echo "arm64: works"
