#!/usr/bin/env bash
# Installs the Debian packages of the named lists in tools/packages that are missing, and says how much that
# downloads. Asks for root only then.
#   tools/install_packages.sh [build|test|release]...        default: build
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
[ $# -gt 0 ] || set -- build
missing=()
for list; do
  [ -f "$here/packages/$list.txt" ] || { echo "install_packages.sh: '$list' is none of build, test and release" >&2; exit 2; }
  while read -r package; do
    case "$package" in '' | '#'*) continue ;; esac
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing+=("$package")
  done <"$here/packages/$list.txt"
done
[ ${#missing[@]} -eq 0 ] && exit 0
as_root=()
[ "$(id -u)" -eq 0 ] || as_root=(sudo)
export DEBIAN_FRONTEND=noninteractive
"${as_root[@]}" apt-get update -qq
echo "isobrick: installing ${missing[*]}"
words=(install --no-install-recommends "${missing[@]}")
LC_ALL=C apt-get --assume-no "${words[@]}" | sed -n 's/^Need to get \(.*\) of archives.*/isobrick: \1 to download/p' || true
"${as_root[@]}" apt-get -y -qq "${words[@]}" >/dev/null
