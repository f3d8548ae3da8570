#!/bin/sh
# Packs the .deb of the clone that this lies in, with nothing but a bare Debian: ../isobrick.deb beside the clone.
set -eu
cd "$(dirname "$0")/../.."
tools/install_packages.sh build debhelper dpkg-dev
# The page of `isobrick serve`, if the clone does not bring it: by npm, which no build of a package may use itself.
[ -e viewer/web/dist/index.html ] || [ -e viewer/web/page.tar.gz ] || tools/web_page.sh
dpkg-buildpackage -b -us -uc
cp ../isobrick_[0-9]*.deb ../isobrick.deb
