#!/usr/bin/env bash
# A fresh machine as the judge: a bare root of a suite of Debian, a clone of HEAD in it, and the README's two commands
# by a user who has sudo and nothing else. Says how long each takes, by the clock and by the processors.
#   tests/house/debian.sh SUITE [--house] [--deb] [--keep WORK_FOLDER]
# SUITE: bookworm, trixie, ...
# --house: the tests of the second ring there, too (tools/test.sh house-tests).
# --deb: packs the .deb there, and installs, uses and removes it in a second bare root.
# --keep: roots, packages and logs lie in this folder, and a bare root of an earlier run is used again.
# Needs root (chroot, mount), debootstrap, and the Debian mirror that apt is set up for. Ends with "SUITE: works".
set -euo pipefail
source=$(cd "$(dirname "$0")/../.." && pwd)
suite=${1:?give the suite: bookworm or trixie}
shift
house=0 deb=0 kept=
while [ $# -gt 0 ]; do
  case $1 in
    --house) house=1 ;;
    --deb) deb=1 ;;
    --keep) kept=$(realpath -m "$2") && shift ;;
    *) echo "debian.sh: '$1' is no option" >&2 && exit 2 ;;
  esac
  shift
done
source "$source/tests/house/bare_root.sh"
work=${kept:-$(mktemp -d /tmp/isobrick_debian_XXXXXX)}
root=$work/$suite
cleanUp() {
  unmountAll
  [ -n "$kept" ] || rm -rf --one-file-system "$work"
}
trap cleanUp EXIT
asNewcomer() { inRoot "$root" newcomer bash -c "cd ~/isobrick && $1"; }
# timed NAME COMMAND...
timed() {
  local name=$1
  shift
  TIMEFORMAT="$suite: $name: %R s by the clock, %U + %S s of processors"
  time "$@" >"$work/$suite-$name.log" 2>&1 || { tail -n 60 "$work/$suite-$name.log"; echo "$suite: $name FAILS"; exit 1; }
  tail -n 40 "$work/$suite-$name.log" | sed -n '/^step /,$p'
}

makeRoot "$suite" "$work" "$root"
inRoot "$root" root apt-get install -y -qq --no-install-recommends sudo git ca-certificates >/dev/null 2>&1
inRoot "$root" root useradd --create-home --shell /bin/bash newcomer
echo 'newcomer ALL=(ALL) NOPASSWD: ALL' >"$root/etc/sudoers.d/newcomer"
git clone --quiet --no-hardlinks "$source" "$root/home/newcomer/isobrick"
inRoot "$root" root chown -R newcomer: /home/newcomer/isobrick

timed packages asNewcomer "tools/install_packages.sh build"  # apart from the rest, for its time
sed -n '/to download/p' "$work/$suite-packages.log"
timed quickstart asNewcomer "tools/quickstart.sh"
[ -s "$root/home/newcomer/isobrick/quickstart-out/skull.png" ] || { echo "$suite: no picture"; exit 1; }
timed test asNewcomer "tools/test.sh"
[ $house = 0 ] || timed house asNewcomer "tools/test.sh house-tests"

if [ $deb = 1 ]; then
  # The steps of tools/container.
  timed deb asNewcomer "mkdir -p ../pack && git archive HEAD | tar -x -C ../pack && ../pack/tools/container/pack.sh"
  bare=$work/$suite-bare
  makeRoot "$suite" "$work" "$bare"
  cp "$root/home/newcomer/isobrick.deb" "$bare/tmp/"
  timed deb-install inRoot "$bare" root apt-get install -y -qq --no-install-recommends /tmp/isobrick.deb
  timed deb-use inRoot "$bare" root sh -c 'cd /tmp && isobrick --version &&
    isobrick phantom head --voxels 64 -o head.nrrd && isobrick build head.nrrd && isobrick info head.isb &&
    isobrick verify head.isb && isobrick extract head.isb --iso 1324 -o bone.ply &&
    isobrick render head.isb --iso 1324 --size 64x64 -o bone.png && ls -l bone.ply bone.png &&
    { timeout -s INT 3 isobrick serve head.isb 2>said || true; } && cat said && ! grep "no page" said'
  timed deb-remove inRoot "$bare" root sh -c 'apt-get remove -y -qq isobrick && ! command -v isobrick'
fi
echo "$suite: works"
