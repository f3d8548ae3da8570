#!/usr/bin/env bash
# Installs the wheel of tools/build_wheel.sh in a bare Debian 12 with nothing but python3, and uses it:
#   tests/house/wheel_in_bare_root.sh [WHEEL] [DICOM_FOLDER] [WORK_FOLDER]
# Needs root (chroot), debootstrap, the Debian mirror that apt is set up for, and PyPI for numpy and pip. Builds a
# pyramid of the folder of DICOM, by the module and by the command; extracts, renders, and runs the viewer
# off screen. Ends with "wheel: works". A root of an earlier run that lies in WORK_FOLDER is used again.
set -euo pipefail
source=$(cd "$(dirname "$0")/../.." && pwd)
wheel=${1:-}
[ -n "$wheel" ] || wheel=$(echo "$source"/build/wheel/isobrick-*.whl)
dicom=${2:-}
[ -n "$dicom" ] || dicom=$source/../shared/data/vhf_head_ct/dicom
given=${3:-}
work=${given:-$(mktemp -d /tmp/isobrick_wheel_XXXXXX)}
root=$work/root
mkdir -p "$work"
mirror=$(apt-get indextargets --format '$(SITE)' 2>/dev/null | grep -v security | head -n 1)

cleanUp() {
  umount "$root/proc" 2>/dev/null || true
  [ -n "$given" ] || rm -rf "$work"
}
trap cleanUp EXIT

[ -x "$root/usr/bin/python3" ] ||
  debootstrap --variant=minbase --include=python3 bookworm "$root" "$mirror" >"$work/debootstrap.log"
mount --bind /proc "$root/proc"
rm -rf "$root/tmp/try"
mkdir -p "$root/tmp/try/wheels"
/usr/bin/python3 -m pip download -q --no-deps -d "$root/tmp/try/wheels" numpy pip
cp "$wheel" "$root/tmp/try/wheels/"
cp -r "$dicom" "$root/tmp/try/dicom"

inRoot() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root sh -c "cd /tmp/try && $1"; }
inRoot 'python3 "$(echo wheels/pip-*.whl)/pip" install -q --break-system-packages --no-index --find-links wheels \
  --root-user-action ignore --target module isobrick'
cat >"$root/tmp/try/use.py" <<'PYTHON'
import isobrick

print(isobrick.build("dicom", "module.isb", memory="256M"))
with isobrick.open("module.isb") as pyramid:
    print(pyramid, pyramid.isovalues())
    mesh = pyramid.extract()
    print(mesh)
    assert len(mesh.faces) > 100_000
    mesh.save("module.ply")
PYTHON
inRoot 'PYTHONPATH=module python3 use.py'
cat >"$root/tmp/try/view.json" <<'JSON'
{"steps": [{"wait": "settled"}, {"picture": "view.png"}]}
JSON
inRoot 'export PYTHONPATH=module; isobrick="python3 module/bin/isobrick" &&
  $isobrick --version && $isobrick build dicom -o command.isb && $isobrick verify command.isb &&
  $isobrick extract command.isb --iso auto -o command.ply && cmp module.ply command.ply &&
  $isobrick render command.isb --iso auto --size 200x200 -o bone.png &&
  $isobrick view command.isb --offscreen --script view.json --size 200x200 && ls -l bone.png view.png'
cp "$root"/tmp/try/*.png "$work/" 2>/dev/null || true
echo "wheel: works"
