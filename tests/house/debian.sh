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
[ "$(id -u)" -eq 0 ] || { echo "debian.sh: only root may make a root folder; use sudo" >&2; exit 2; }
command -v debootstrap >/dev/null || { echo "debian.sh: debootstrap is missing; apt-get install debootstrap" >&2; exit 2; }
work=${kept:-$(mktemp -d /tmp/isobrick_debian_XXXXXX)}
mkdir -p "$work/archives"
mirror=$(apt-get indextargets --format '$(SITE)' 2>/dev/null | grep -v security | grep debian | head -n 1)
root=$work/$suite

mounts=()
mountInto() { mkdir -p "$2"; mount "${@:3}" "$1" "$2"; mounts=("$2" "${mounts[@]}"); }
cleanUp() {
  local folder
  for folder in "${mounts[@]}"; do umount -l "$folder" 2>/dev/null || true; done
  mounts=()
  [ -n "$kept" ] || rm -rf --one-file-system "$work"
}
trap cleanUp EXIT

# makeRoot FOLDER: as debootstrap leaves it.
makeRoot() {
  local tar=$work/$suite.tar
  if [ ! -e "$tar" ]; then
    rm -rf --one-file-system "$work/making"
    debootstrap --variant=minbase "$suite" "$work/making" "$mirror" >"$work/debootstrap.log"
    tar -C "$work/making" -cf "$tar.part" . && mv "$tar.part" "$tar"
    rm -rf --one-file-system "$work/making"
  fi
  rm -rf --one-file-system "$1"
  mkdir -p "$1"
  tar -C "$1" -xf "$tar"
  cp /etc/resolv.conf /etc/hosts "$1/etc/"
  mountInto proc "$1/proc" -t proc
  mountInto /sys "$1/sys" --rbind
  mountInto /dev "$1/dev" --bind
  mountInto devpts "$1/dev/pts" -t devpts -o gid=5,mode=620,ptmxmode=666
  mountInto "$work/archives" "$1/var/cache/apt/archives" --bind  # what was downloaded once
  inRoot "$1" root apt-get update -qq
}
# inRoot FOLDER USER COMMAND...
inRoot() {
  local home=/root
  [ "$2" = root ] || home=/home/$2
  chroot --userspec="$2" "$1" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=$home \
    DEBIAN_FRONTEND=noninteractive "${@:3}"
}
asNewcomer() { inRoot "$root" newcomer bash -c "cd ~/isobrick && $1"; }
# timed NAME COMMAND...
timed() {
  local name=$1
  shift
  TIMEFORMAT="$suite: $name: %R s by the clock, %U + %S s of processors"
  time "$@" >"$work/$suite-$name.log" 2>&1 || { tail -n 60 "$work/$suite-$name.log"; echo "$suite: $name FAILS"; exit 1; }
  tail -n 40 "$work/$suite-$name.log" | sed -n '/^step /,$p'
}

makeRoot "$root"
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
  makeRoot "$bare"
  cp "$root/home/newcomer/isobrick.deb" "$bare/tmp/"
  timed deb-install inRoot "$bare" root apt-get install -y -qq --no-install-recommends /tmp/isobrick.deb
  timed deb-use inRoot "$bare" root sh -c 'cd /tmp && isobrick --version &&
    isobrick phantom head --size 64 -o head.nrrd && isobrick build head.nrrd && isobrick info head.isb &&
    isobrick verify head.isb && isobrick extract head.isb --iso 1324 -o bone.ply &&
    isobrick render head.isb --iso 1324 --size 64x64 -o bone.png && ls -l bone.ply bone.png'
  timed deb-remove inRoot "$bare" root sh -c 'apt-get remove -y -qq isobrick && ! command -v isobrick'
fi
echo "$suite: works"
