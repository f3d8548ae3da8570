#!/usr/bin/env bash
# Makes the page that `isobrick serve` carries (viewer/web/dist): run it before CMake, which takes what lies there.
#   tools/web_page.sh                  with node and npm, of which packages come by npm as package-lock.json has them
#   tools/web_page.sh --pack FILE      also packs it, for builds without a network: the .deb takes viewer/web/page.tar.gz
#   tools/web_page.sh --unpack FILE    takes it from such a file instead; needs neither node nor npm
set -euo pipefail
file=${2:+$(realpath -m "$2")}
cd "$(dirname "$0")/.."
page=viewer/web/dist
if [ "${1:-}" = --unpack ]; then
  rm -rf $page
  mkdir -p $page
  tar -xf "$file" -C $page
  exit
fi
command -v npm >/dev/null || tools/install_packages.sh web
(
  cd viewer/web
  # npm writes the second file when it is done.
  [ node_modules/.package-lock.json -nt package-lock.json ] || npm ci --ignore-scripts --no-audit --no-fund --silent
  npm run --silent check
  npm run --silent build
)
# The same bytes for the same page.
[ "${1:-}" != --pack ] || tar -c --owner=0 --group=0 --mtime=@0 --sort=name -C $page . | gzip -n9 >"$file"
