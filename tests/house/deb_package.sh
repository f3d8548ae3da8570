#!/usr/bin/env bash
# The .deb of what is built already: dpkg-buildpackage packs it with the dependencies that it finds, and what is in it
# runs. tests/house/debian.sh SUITE --deb compiles it as Debian does, and installs it in a bare root.
#   deb_package.sh BUILD_FOLDER WORK_FOLDER
set -euo pipefail
source=$(cd "$(dirname "$0")/../.." && pwd)
build=$1 work=$2
command -v dh >/dev/null || { echo "skipped: debhelper was not found"; exit 0; }
rm -rf "$work"
mkdir -p "$work/source" "$work/root"
cp -r "$source"/{debian,CMakeLists.txt,LICENSE,NOTICE} "$work/source/"
[ -n "${ISOBRICK_REQUIRE_ALL:-}" ] || [ -e "$source/viewer/web/dist/index.html" ] || export ISOBRICK_WITHOUT_PAGE=1
(cd "$work/source" && ISOBRICK_BUILT=$build dpkg-buildpackage -b -d -us -uc) >"$work/log" 2>&1 || { tail -40 "$work/log"; exit 1; }
deb=$(echo "$work"/isobrick_*.deb)
dpkg-deb --extract "$deb" "$work/root"
dpkg-deb --extract "$(echo "$work"/libisobrick-dev_*.deb)" "$work/root"
for needed in libblosc libtbb libinsighttoolkit libopenvdb libegl1 libc6; do
  dpkg-deb --field "$deb" Depends | grep -q "$needed" || { echo "the package does not depend on $needed"; exit 1; }
done
for file in usr/libexec/isobrick/isobrick-build usr/libexec/isobrick/isobrick-view usr/share/applications/isobrick.desktop \
  usr/share/man/man1/isobrick.1.gz usr/share/bash-completion/completions/isobrick usr/include/isobrick/isobrick.h; do
  [ -e "$work/root/$file" ] || { echo "the package lacks $file"; exit 1; }
done
cd "$work"
root/usr/bin/isobrick build phantom:head:64 -o head.isb
root/usr/bin/isobrick extract head.isb --iso 1324 -o bone.ply
"$source/tests/house/served_page.sh" root/usr/bin/isobrick head.isb
echo "deb: works"
