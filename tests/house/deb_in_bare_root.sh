#!/usr/bin/env bash
# Packs isobrick and installs and uses the .deb in a bare Debian 12:
#   tests/house/deb_in_bare_root.sh [WORK_FOLDER]
# Needs root (chroot), debootstrap, debhelper and the Debian mirror that apt is set up for. Prints the log of the
# installation, and what `isobrick` says in there; ends with "deb: works". Packages and root of an earlier run
# that lie in WORK_FOLDER are used again.
set -euo pipefail
source=$(cd "$(dirname "$0")/../.." && pwd)
given=${1:-}
work=${given:-$(mktemp -d /tmp/isobrick_deb_XXXXXX)}
root=$work/root
mkdir -p "$work/source"
mirror=$(apt-get indextargets --format '$(SITE)' 2>/dev/null | grep -v security | head -n 1)

cleanUp() {
  umount "$root/proc" 2>/dev/null || true
  [ -n "$given" ] || rm -rf "$work"
}
trap cleanUp EXIT

if ! ls "$work"/isobrick_*.deb >/dev/null 2>&1; then
  (cd "$source" && git archive HEAD) | tar -x -C "$work/source"
  (cd "$work/source" && dpkg-buildpackage -b -us -uc >"$work/build.log" 2>&1) || { tail -50 "$work/build.log"; exit 1; }
fi
ls -l "$work"/*.deb
[ -d "$root/usr" ] || debootstrap --variant=minbase bookworm "$root" "$mirror" >"$work/debootstrap.log"
# As apt outside is set up, so that packages are found where this machine finds them.
cp -r /etc/apt/sources.list* /etc/apt/apt.conf.d "$root/etc/apt/" 2>/dev/null || true
cp /etc/resolv.conf /etc/hosts "$root/etc/" 2>/dev/null || true
mount --bind /proc "$root/proc"
cp "$work"/isobrick_*.deb "$root/tmp/isobrick.deb"

inRoot() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive "$@"; }
inRoot apt-get update -qq
inRoot apt-get install -y --no-install-recommends /tmp/isobrick.deb
inRoot sh -c 'cd /tmp && isobrick --version &&
  isobrick phantom head --size 64 -o head.nrrd && isobrick build head.nrrd && isobrick info head.isb &&
  isobrick verify head.isb && isobrick extract head.isb --iso 1324 -o bone.ply &&
  isobrick render head.isb --iso 1324 --size 64x64 -o bone.png && ls -l bone.ply bone.png'
inRoot apt-get remove -y -qq isobrick
inRoot sh -c '! command -v isobrick'
echo "deb: works"
