#!/usr/bin/env bash
# Installs a wheel of tools/build_wheel.sh in a bare Debian with nothing but python3, and uses it:
#   tests/house/wheel_in_bare_root.sh [WHEEL] [DICOM_FOLDER] [WORK_FOLDER] [SUITE]
# SUITE: bookworm (Python 3.11), or trixie (3.13). Without WHEEL it is the one of build/wheel for that.
# Needs root (chroot), debootstrap, the Debian mirror that apt is set up for, and PyPI for numpy and pip. Builds a
# pyramid of the folder of DICOM, by the module and by the command; extracts, renders, and runs the viewer
# off screen. Ends with "wheel: works with Python …". The root as debootstrap made it lies in WORK_FOLDER and is used again.
set -euo pipefail
source=$(cd "$(dirname "$0")/../.." && pwd)
wheel=${1:-}
suite=${4:-bookworm}
if [ -z "$wheel" ]; then
  [ "$suite" = bookworm ] && interface=cp311-cp311 || interface=cp312-abi3
  wheel=$(echo "$source"/build/wheel/isobrick-*-$interface-*.whl)
fi
dicom=${2:-}
[ -n "$dicom" ] || dicom=$source/../shared/data/vhf_head_ct/dicom
given=${3:-}
source "$source/tests/house/bare_root.sh"
work=${given:-$(mktemp -d /tmp/isobrick_wheel_XXXXXX)}
root=$work/root
cleanUp() {
  unmountAll
  [ -n "$given" ] || rm -rf --one-file-system "$work"
}
trap cleanUp EXIT

makeRoot "$suite" "$work" "$root"
inRoot "$root" root apt-get install -y -qq --no-install-recommends python3 >/dev/null
mkdir -p "$root/tmp/try/wheels"
version=$(inRoot "$root" root python3 -c 'import sys; print("%d.%d" % sys.version_info[:2])')
/usr/bin/python3 -m pip download -q --no-deps --only-binary :all: --python-version "$version" \
  -d "$root/tmp/try/wheels" numpy pip
cp "$wheel" "$root/tmp/try/wheels/"
cp -r "$dicom" "$root/tmp/try/dicom"

inTry() { inRoot "$root" root sh -c "cd /tmp/try && $1"; }
inTry 'python3 "$(echo wheels/pip-*.whl)/pip" install -q --break-system-packages --no-index --find-links wheels \
  --root-user-action ignore --target module isobrick'
cat >"$root/tmp/try/use.py" <<'PYTHON'
import urllib.request

import isobrick

print(isobrick.build("dicom", "module.isb", memory="256M"))
with isobrick.open("module.isb") as pyramid:
    print(pyramid, pyramid.isovalues())
    mesh = pyramid.extract()
    print(mesh)
    assert len(mesh.faces) > 100_000
    mesh.save("module.ply")
view = isobrick.show("module.isb", browser=False)
with urllib.request.urlopen(view.url.split("#")[0]) as page:
    assert b"<title>isobrick" in page.read()
view.close()
PYTHON
inTry 'PYTHONPATH=module python3 use.py'
cat >"$root/tmp/try/view.json" <<'JSON'
{"steps": [{"wait": "settled"}, {"picture": "view.png"}]}
JSON
inTry 'export PYTHONPATH=module; isobrick="python3 module/bin/isobrick" &&
  $isobrick --version && $isobrick build dicom -o command.isb && $isobrick verify command.isb &&
  $isobrick extract command.isb --iso auto -o command.ply && cmp module.ply command.ply &&
  $isobrick render command.isb --iso auto --size 200x200 -o bone.png &&
  $isobrick view command.isb --offscreen --script view.json --size 200x200 && ls -l bone.png view.png'
cp "$root"/tmp/try/*.png "$work/" 2>/dev/null || true
echo "wheel: works with Python $version"
