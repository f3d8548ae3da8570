#!/usr/bin/env bash
# Packs isobrick and installs and uses the .deb in a bare Debian 12:
#   tests/house/deb_in_bare_root.sh BUILD_FOLDER [WORK_FOLDER]
# Needs root (chroot), debootstrap and the Debian mirror that apt is set up for. Prints the log of the
# installation, and what `isobrick` says in there; ends with "deb: works".
set -euo pipefail
build=$(cd "$1" && pwd)
work=${2:-$(mktemp -d /tmp/isobrick_deb_XXXXXX)}
root=$work/root
mkdir -p "$work"
mirror=$(apt-get indextargets --format '$(SITE)' 2>/dev/null | grep -v security | head -n 1)

cleanUp() {
  umount "$root/proc" 2>/dev/null || true
  [ -n "${2:-}" ] || rm -rf "$work"
}
trap cleanUp EXIT

(cd "$build" && cpack -G DEB -B "$work/deb" >"$work/cpack.log") || { cat "$work/cpack.log"; exit 1; }
ls -l "$work"/deb/*.deb
[ -d "$root/usr" ] || debootstrap --variant=minbase bookworm "$root" "$mirror" >"$work/debootstrap.log"
# As apt outside is set up, so that packages are found where this machine finds them.
cp -r /etc/apt/sources.list* /etc/apt/apt.conf.d "$root/etc/apt/" 2>/dev/null || true
cp /etc/resolv.conf /etc/hosts "$root/etc/" 2>/dev/null || true
mount --bind /proc "$root/proc"
cp "$work"/deb/isobrick_*.deb "$root/tmp/isobrick.deb"

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
