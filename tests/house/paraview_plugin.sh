#!/usr/bin/env bash
# Tries the plugin for ParaView in pvbatch and in the client under Xvfb, with a picture and a state of each:
#   tests/house/paraview_plugin.sh PYTHON [OUT_FOLDER]
# PYTHON has the module isobrick; ParaView 5.11, or 5.13 of Debian 13: apt install paraview python3-paraview. Ends with
# "paraview: works".
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
python=$1
out=${2:-$(mktemp -d /tmp/isobrick_paraview_XXXXXX)}
mkdir -p "$out"
export TRY_PYRAMID=$out/head.isb
"$python" -c "import isobrick, sys; isobrick.build('phantom:head:128', sys.argv[1], force=True)" "$TRY_PYRAMID"
TRY_OUT=$out/batch xvfb-run -a -s '-screen 0 1280x900x24' "$python" -m isobrick.paraview pvbatch "$here/paraview_plugin.py"
TRY_OUT=$out/client TRY_CLIENT=1 timeout 300 xvfb-run -a -s '-screen 0 1280x900x24' \
  "$python" -m isobrick.paraview paraview --script="$here/paraview_plugin.py"
ls -l "$out"/*.png "$out"/*.py
echo "paraview: works"
