#!/usr/bin/env bash
# Makes the root of an arm64 Debian to compile against, on a Debian of another processor:
#   tools/arm64_sysroot.sh FOLDER
#   cmake -B build/arm64 -G Ninja --toolchain cmake/arm64.cmake -D ISOBRICK_ARM64_SYSROOT=FOLDER -D ISOBRICK_WITH_ITK=OFF
# FOLDER gets the arm64 libraries that isobrick is built on and all that they need, unpacked, not installed: many of
# their packages do not go beside those of this machine, which stays as it is but for the cross compiler. An unpacked
# root of the same packages is used again. Needs the Debian mirror that apt is set up for, and root if the cross
# compiler or the emulator is missing.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
[ $# -eq 1 ] || { sed -n '2,4s/^# //p' "$0" >&2; exit 2; }
mkdir -p "$1"
root=$(cd "$1" && pwd)

tools=()
for package in crossbuild-essential-arm64 qemu-user-static pkg-config; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || tools+=("$package")
done
if [ ${#tools[@]} -gt 0 ]; then
  echo "isobrick: installing ${tools[*]}"
  as_root=()
  [ "$(id -u)" -eq 0 ] || as_root=(sudo)
  export DEBIAN_FRONTEND=noninteractive
  "${as_root[@]}" apt-get update -qq
  "${as_root[@]}" apt-get install -y -qq --no-install-recommends "${tools[@]}" >/dev/null
fi

# What isobrick is compiled with, but for ITK: Debian 12 has it for x86-64 alone.
mapfile -t packages < <(cat "$here"/packages/{build,test}.txt |
  grep -E '^[^# ]+-dev$' | grep -vxE 'libinsighttoolkit5-dev|python3-dev')
packages+=(libc6-dev "libstdc++-$(aarch64-linux-gnu-g++ -dumpversion | cut -d. -f1)-dev")
if [ "$(cat "$root/packages" 2>/dev/null)" = "${packages[*]}" ]; then exit 0; fi

# An apt of its own, with the mirrors, the proxies and the keys of this machine's, and nothing installed.
apt=$root/apt
rm -rf "$root"
mkdir -p "$apt"/{etc/{apt.conf.d,preferences.d,sources.list.d},state/lists/partial,cache/archives/partial}
: >"$apt/status"
apt-get indextargets --format 'deb $(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' 'Origin: Debian' |
  sort -u >"$apt/etc/sources.list"
[ -s "$apt/etc/sources.list" ] || { echo "arm64_sysroot: apt has no mirror of Debian; try apt-get update" >&2; exit 1; }
{
  apt-config dump | grep '^Acquire::' | grep -v '^Acquire::IndexTargets' || true
  cat <<END
APT::Architecture "arm64";
APT::Architectures "arm64";
APT::Install-Recommends "false";
Acquire::Languages "none";
Dir::Etc "$apt/etc";
Dir::Etc::Trusted "/etc/apt/trusted.gpg";
Dir::Etc::TrustedParts "/etc/apt/trusted.gpg.d";
Dir::State "$apt/state";
Dir::State::status "$apt/status";
Dir::Cache "$apt/cache";
END
} >"$apt/apt.conf"
export APT_CONFIG=$apt/apt.conf
apt-get update -qq
apt-get install -y -qq --download-only "${packages[@]}" >/dev/null

# As in an installed system, /lib is a part of /usr.
mkdir -p "$root"/usr/{bin,lib,sbin}
for folder in bin lib sbin; do ln -s "usr/$folder" "$root/$folder"; done
for package in "$apt"/cache/archives/*.deb; do
  dpkg-deb --fsys-tarfile "$package" | tar -x -C "$root" --keep-directory-symlink --no-same-owner
done
# A link to /usr/... would lead to this machine's files.
find "$root/usr" -type l -lname '/*' -printf '%p\t%l\n' | while IFS=$'\t' read -r link target; do
  ln -sfn "$(realpath -m --relative-to "$(dirname "$link")" "$root$target")" "$link"
done
# So would such a path in a package's description for CMake.
grep -rlZE '[";]/usr[/"]' "$root"/usr/{lib,share} --include='*.cmake' | xargs -0 sed -Ei 's|([";])/usr([/"])|\1${CMAKE_SYSROOT}/usr\2|g'
rm -rf "$apt"
echo "${packages[*]}" >"$root/packages"
