#!/bin/sh
# Packs the .deb of the clone that this lies in, with nothing but a bare Debian: ../isobrick.deb beside the clone.
set -eu
cd "$(dirname "$0")/../.."
tools/install_packages.sh build debhelper dpkg-dev
dpkg-buildpackage -b -us -uc
cp ../isobrick_[0-9]*.deb ../isobrick.deb
