#!/usr/bin/env bash
# Installs the Debian packages of the named lists in tools/packages that are missing, and says how much that
# downloads. Asks for root only then.
#   tools/install_packages.sh [build|test|release|PACKAGE]...        default: build
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
[ $# -gt 0 ] || set -- build
list=$(mktemp)
for name; do
  if [ -f "$here/packages/$name.txt" ]; then sed '/^#/d' "$here/packages/$name.txt"; else echo "$name"; fi
done | while read -r package; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || echo "$package"
done >"$list"
mapfile -t missing <"$list"
rm "$list"
[ ${#missing[@]} -eq 0 ] && exit 0
as_root=()
[ "$(id -u)" -eq 0 ] || as_root=(sudo)
export DEBIAN_FRONTEND=noninteractive
"${as_root[@]}" apt-get update -qq
echo "isobrick: installing ${missing[*]}"
words=(install --no-install-recommends "${missing[@]}")
"${as_root[@]}" env LC_ALL=C apt-get --assume-no "${words[@]}" | sed -n 's/^Need to get \(.*\) of archives.*/isobrick: \1 to download/p' || true
"${as_root[@]}" apt-get -y -qq "${words[@]}" >/dev/null
