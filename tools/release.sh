#!/usr/bin/env bash
# Makes a release of the commit that is checked out: source tarball, Debian packages, wheels, container files, checksums,
# in build/release-VERSION. RELEASING.md says what comes before and after.
#   tools/release.sh             all of it
#   tools/release.sh --source    the tarball and its checksum alone
set -euo pipefail
cd "$(dirname "$0")/.."
version=$(sed -n 's/^project(isobrick VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
out=$PWD/build/release-$version
fail() { echo "release: $1" >&2; exit 1; }
[ -z "$(git status --porcelain)" ] || fail "the tree has changes; commit them first"
cmake -DSOURCE="$PWD" -P tests/house/versions_test.cmake
rm -rf "$out"
mkdir -p "$out"
name=isobrick-$version

git archive --format=tar --prefix="$name/" HEAD | gzip -n9 >"$out/$name.tar.gz"
if [ "${1:-}" != --source ]; then
  if grep -q "^## $version (not released yet)" CHANGELOG.md; then fail "CHANGELOG.md says that $version is not released yet"; fi
  # From the tarball, as whoever downloads it would.
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
  tar -C "$work" -xzf "$out/$name.tar.gz"
  [ -e viewer/web/dist/index.html ] || tools/web_page.sh
  cp -r viewer/web/dist "$work/$name/viewer/web/"
  (cd "$work/$name" && dpkg-buildpackage -b -us -uc) >"$out/deb.log" 2>&1 || { tail -20 "$out/deb.log"; fail "no Debian package"; }
  cp "$work"/*.deb "$out/"
  rm "$out/deb.log"
  # What the package was made of, so that nothing is compiled twice.
  cmake --install "$work/$name/build/debian" --prefix "$work/prefix" --strip >"$work/install.log"
  (cd "$work/$name" && ISOBRICK_PREFIX=$work/prefix tools/build_wheel.sh "$work/wheel")
  [ "$(find "$work/wheel" -name '*manylinux*.whl' | wc -l)" -ge 2 ] ||
    fail "one wheel only; name a Python 3.11 and one from 3.12 on in ISOBRICK_PYTHONS"
  cp "$work"/wheel/isobrick-*manylinux*.whl "$out/"
  cp tools/container/Containerfile tools/container/isobrick.def "$out/"
fi
(cd "$out" && sha256sum -- * >SHA256SUMS)
ls -l "$out"
echo "tag it: git tag -a v$version -m 'isobrick $version'"
